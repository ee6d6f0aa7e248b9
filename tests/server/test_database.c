/* test_database.c - every step of every transaction and every allocation made to fail in turn; a full disk; a
 * damaged file.
 *
 * Steps fail by SQLite's progress handler, which stops the nth instruction of a statement; the disk is full
 * by a VFS between SQLite and the files, which lets no file grow as long as the reserve is there. */
#include "../solver/scarce.h"

#include "shelf.h"

#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>

#include "database.h"

static sqlite3 *connection; /* of the store that was opened last */

static int on_commit(void *data);

static int catch_connection(sqlite3 *db, char **message, const struct sqlite3_api_routines *api)
{
    (void)message, (void)api;
    connection = db;
    sqlite3_commit_hook(db, on_commit, NULL);
    return SQLITE_OK;
}

/* ---- steps that fail ---------------------------------------------------------------------------- */

static long steps_left; /* instructions until the one that is stopped */
static bool committing, refuse_commit;

/* The last look comes when the commit is done, which no fault could take back: it does not count. */
static int stop_once(void *data)
{
    (void)data;
    bool late = committing;
    committing = false;
    return !late && steps_left-- == 0;
}

/* Nonzero makes the commit fail. */
static int on_commit(void *data)
{
    (void)data;
    committing = true;
    return refuse_commit;
}

#define DIGEST "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"

struct stage { /* what a swept operation works on */
    struct store *store;
    struct job queued, running, ended, fresh; /* of owner "", the last not added yet */
};

static const struct store_mesh mesh = {.sha256 = DIGEST, .format = 1, .bytes = 3};
static const char named[][SHA256_SIZE] = {DIGEST};

static struct store_submission keyed(void)
{
    return (struct store_submission){.document = "{}",
                                     .bytes = 2,
                                     .mesh = named,
                                     .meshes = 1,
                                     .key = "k",
                                     .digest = DIGEST,
                                     .answer = "{}",
                                     .at_ms = 1};
}

static int do_add(struct stage *s, struct problem *problem)
{
    struct store_submission submission = keyed();
    return store_job_add(s->store, &s->fresh, &submission, problem);
}

static int do_start(struct stage *s, struct problem *problem)
{
    return store_job_start(s->store, &s->queued, problem);
}

static int do_cancel_queued(struct stage *s, struct problem *problem)
{
    return store_job_cancel_queued(s->store, &s->queued, problem);
}

static int do_cancel_running(struct stage *s, struct problem *problem)
{
    return store_job_cancel_running(s->store, &s->running, problem);
}

static int do_requeue(struct stage *s, struct problem *problem)
{
    return store_job_requeue(s->store, &s->running, problem);
}

static int do_finish(struct stage *s, struct problem *problem)
{
    s->running.status = JOB_SUCCEEDED;
    return store_job_finish(s->store, &s->running, problem);
}

static int do_get(struct stage *s, struct problem *problem)
{
    struct job job = {0};
    int result = store_job_get(s->store, "", s->ended.id, &job, problem);
    job_done(&job);
    return result;
}

static int do_get_none(struct stage *s, struct problem *problem)
{
    struct job job = {0};
    int result = store_job_get(s->store, "", s->fresh.id, &job, problem);
    return result == STORE_NONE ? 0 : result;
}

static int do_remove(struct stage *s, struct problem *problem)
{
    return store_job_remove(s->store, "", s->ended.id, 1, problem);
}

static int do_list(struct stage *s, struct problem *problem)
{
    struct store_filter filter = {
        .owner = "", .status = -1, .created_after_ms = -1, .before = INT64_MAX, .limit = 9};
    struct found found = {0};
    int64_t last;
    bool more;
    return store_job_list(s->store, &filter, note_job, &found, &last, &more, problem);
}

static int do_recover(struct stage *s, struct problem *problem)
{
    struct found found = {0};
    char *text = NULL;
    size_t bytes;
    int result = store_recover(s->store, 3, 1, note_job, &found, problem);
    /* Whatever it could not find out, it has removed nothing that is needed. */
    assert_int_equal(store_job_document(s->store, s->ended.id, &text, &bytes, problem), 0);
    free(text);
    assert_int_equal(store_job_document(s->store, s->running.id, &text, &bytes, problem), 0);
    free(text);
    return result;
}

static int do_answer(struct stage *s, struct problem *problem)
{
    struct store_answer answer = {.body = NULL};
    int result = store_answer_get(s->store, "", "held", 1, &answer, problem);
    free(answer.body);
    return result;
}

static int do_mesh_add(struct stage *s, struct problem *problem)
{
    return store_mesh_add(s->store, "shop", &mesh, "abc", 1, problem);
}

static int do_mesh_get(struct stage *s, struct problem *problem)
{
    struct store_mesh back;
    return store_mesh_get(s->store, "", DIGEST, &back, problem);
}

static int do_mesh_touch(struct stage *s, struct problem *problem)
{
    return store_mesh_touch(s->store, "", DIGEST, (int64_t)1 << 40, problem);
}

static int do_mesh_remove(struct stage *s, struct problem *problem)
{
    return store_mesh_remove(s->store, "", DIGEST, problem);
}

static int do_prune(struct stage *s, struct problem *problem)
{
    struct store_policy policy = {0, 0, 1};
    struct store_pruned pruned;
    return store_prune(s->store, &policy, (int64_t)1 << 40, &pruned, problem);
}

static int do_start_keep(struct stage *s, struct problem *problem)
{
    return store_start_keep(s->store, "", s->fresh.id, s->ended.id, "f", problem);
}

static void set_stage(struct stage *s, const char *dir)
{
    struct problem problem;
    struct job other = {.revision = {1, 1}};
    struct store_submission submission = keyed();
    s->store = open_store(dir);
    assert_int_equal(store_mesh_add(s->store, "", &mesh, "abc", 1, &problem), 0);
    add_job(s->store, &s->queued);
    add_job(s->store, &s->running);
    start_job(s->store, &s->running);
    add_finished(s->store, "f", &s->ended);
    id_new(other.id);
    submission.key = "held";
    submission.meshes = 0;
    assert_int_equal(store_job_add(s->store, &other, &submission, &problem), 0);
    s->fresh = (struct job){.revision = {1, 1}};
    id_new(s->fresh.id);
}

static void clear_stage(struct stage *s, const char *dir)
{
    char command[512];
    store_close(s->store);
    snprintf(command, sizeof command, "rm -r '%s'/*", dir);
    assert_int_equal(system(command), 0);
}

/* What all tables hold, as one number; what is left over of a failed transaction would change it. */
static int64_t sum_of_rows(void)
{
    int64_t sum = 0;
    const char *const sql[] = {
        "SELECT count(*)+sum(length(id)+length(status)*7+attempt*11+counter*13+cancel*17) FROM job",
        "SELECT 1000*count(*) FROM gone", "SELECT 100000*count(*)+sum(touched_ms%997) FROM mesh",
        "SELECT 1000000*count(*) FROM job_mesh", "SELECT 10000000*count(*) FROM idempotency"};
    for (size_t i = 0; i < sizeof sql / sizeof *sql; i++) {
        sqlite3_stmt *s;
        assert_int_equal(sqlite3_prepare_v2(connection, sql[i], -1, &s, NULL), SQLITE_OK);
        assert_int_equal(sqlite3_step(s), SQLITE_ROW);
        sum += sqlite3_column_int64(s, 0);
        sqlite3_finalize(s);
    }
    return sum;
}

struct swept {
    const char *name;
    int (*run)(struct stage *s, struct problem *problem);
    bool reads;    /* there is nothing to commit */
    bool in_parts; /* several transactions: what the first changed stays changed */
};

static const struct swept swept[] = {
    {"add", do_add, false, false},
    {"start", do_start, false, false},
    {"cancel queued", do_cancel_queued, false, false},
    {"cancel running", do_cancel_running, false, false},
    {"requeue", do_requeue, false, false},
    {"finish", do_finish, false, false},
    {"get", do_get, true, false},
    {"get none", do_get_none, true, false},
    {"remove", do_remove, false, false},
    {"list", do_list, true, false},
    {"recover", do_recover, false, true},
    {"answer", do_answer, true, false},
    {"mesh add", do_mesh_add, false, false},
    {"mesh get", do_mesh_get, true, false},
    {"mesh touch", do_mesh_touch, false, false},
    {"mesh remove", do_mesh_remove, false, false},
    {"start keep", do_start_keep, true, false},
    {"prune", do_prune, false, true},
};

/* A refusal that has changed nothing. */
static int expect_refusal(struct stage *stage, const struct swept *op, long step)
{
    struct problem problem = {.code = PROBLEM_NONE};
    int64_t before = sum_of_rows();
    committing = false;
    sqlite3_progress_handler(connection, 1, stop_once, NULL);
    int result = op->run(stage, &problem);
    if (result != 0 && (result != -1 || problem.code != PROBLEM_STORAGE))
        fail_msg("%s, step %ld: %d, %s", op->name, step, result, problem_name(problem.code));
    if (!sqlite3_get_autocommit(connection))
        fail_msg("%s, step %ld: a transaction is left open", op->name, step);
    sqlite3_progress_handler(connection, 0, NULL, NULL);
    if (result != 0 && !op->in_parts && sum_of_rows() != before)
        fail_msg("%s, step %ld: rows have changed", op->name, step);
    return result;
}

/* Stops instruction n of the operation, for each n until none is stopped any more. */
static void sweep(const char *dir, const struct swept *op)
{
    struct stage stage;
    long n = 0, failed = 0;
    set_stage(&stage, dir);
    do {
        steps_left = n++;
        int result = expect_refusal(&stage, op, n);
        failed += result != 0;
        if (result == 0 && steps_left < 0) { /* it could do without */
            clear_stage(&stage, dir);
            set_stage(&stage, dir);
        }
    } while (steps_left < 0);
    print_message("%-14s %ld steps stopped, %ld refusals\n", op->name, n - 1, failed);
    assert_true(failed > 3);
    clear_stage(&stage, dir);
}

static void test_database__each_step_that_fails_changes_nothing_and_may_be_tried_again(void **state)
{
    for (size_t i = 0; i < sizeof swept / sizeof *swept; i++)
        sweep(*state, &swept[i]);
}

static void test_database__so_does_a_commit_that_fails(void **state)
{
    for (size_t i = 0; i < sizeof swept / sizeof *swept; i++) {
        struct stage stage;
        struct problem problem;
        if (swept[i].reads)
            continue;
        set_stage(&stage, *state);
        refuse_commit = true;
        steps_left = -1; /* no step of its own fails */
        assert_int_equal(expect_refusal(&stage, &swept[i], 0), -1);
        refuse_commit = false;
        assert_int_equal(swept[i].run(&stage, &problem), 0);
        clear_stage(&stage, *state);
    }
}

#ifdef CAN_FAIL_ALLOCATIONS
/* Fails allocation n of the operation, for each n until none is asked for any more. */
static void sweep_allocations(const char *dir, const struct swept *op)
{
    struct stage stage;
    long failed = 0;
    bool over = false;
    set_stage(&stage, dir);
    for (long n = 0; !over; n++) {
        struct problem problem = {.code = PROBLEM_NONE};
        int64_t before = sum_of_rows();
        countdown = n;
        int result = op->run(&stage, &problem);
        over = countdown >= 0;
        countdown = -1;
        if (result != 0 &&
            (result != -1 || over || (problem.code != PROBLEM_STORAGE && problem.code != PROBLEM_INTERNAL)))
            fail_msg("%s, allocation %ld: %d, %s", op->name, n, result, problem_name(problem.code));
        if (!sqlite3_get_autocommit(connection))
            fail_msg("%s, allocation %ld: a transaction is left open", op->name, n);
        if (result != 0 && !op->in_parts && sum_of_rows() != before)
            fail_msg("%s, allocation %ld: rows have changed", op->name, n);
        failed += result != 0;
        if (result == 0) {
            clear_stage(&stage, dir);
            set_stage(&stage, dir);
        }
    }
    print_message("%-14s %ld refusals\n", op->name, failed);
    assert_true(failed > 0);
    clear_stage(&stage, dir);
}

static void test_database__each_allocation_that_fails_changes_nothing(void **state)
{
    for (size_t i = 0; i < sizeof swept / sizeof *swept; i++)
        sweep_allocations(*state, &swept[i]);
}

static void test_database__a_store_opens_or_does_not_when_memory_is_short(void **state)
{
    struct store *store = NULL;
    struct problem problem;
    long refusals = 0;
    bool over = false;
    store_close(open_store(*state));
    for (long n = 0; !over; n += 41) { /* of some three thousand */
        countdown = n;
        int result = store_open(*state, NULL, &store, &problem);
        over = countdown >= 0;
        countdown = -1;
        assert_true(result == 0 || (result == -1 && !over && problem.code == PROBLEM_STORAGE));
        refusals -= result;
        store = result == 0 ? store_close(store) : NULL;
    }
    print_message("%ld refusals\n", refusals);
    assert_true(refusals > 10);
}
#endif

/* ---- a full disk -------------------------------------------------------------------------------- */

struct shim { /* a file behind ours; what comes after it in memory is the other VFS's */
    sqlite3_file base;
    sqlite3_file *real;
};

static enum { ROOMY = 0, FULL_BUT_RESERVE, FULL } disk;
static char reserve_path[256];
static int refused; /* writes */

/* Whether a write at the end of a file finds room: the reserve's blocks serve as long as they are free. */
static bool disk_takes(void)
{
    struct stat st;
    if (disk == ROOMY || (disk == FULL_BUT_RESERVE && stat(reserve_path, &st) == 0 && st.st_size == 0))
        return true;
    refused++;
    return false;
}

#define REAL(file) (((struct shim *)(file))->real)

static int shim_close(sqlite3_file *f)
{
    return REAL(f)->pMethods->xClose(REAL(f));
}

static int shim_read(sqlite3_file *f, void *data, int bytes, sqlite3_int64 at)
{
    return REAL(f)->pMethods->xRead(REAL(f), data, bytes, at);
}

static int shim_write(sqlite3_file *f, const void *data, int bytes, sqlite3_int64 at)
{
    sqlite3_int64 size;
    if (REAL(f)->pMethods->xFileSize(REAL(f), &size) == SQLITE_OK && at + bytes > size && !disk_takes())
        return SQLITE_FULL;
    return REAL(f)->pMethods->xWrite(REAL(f), data, bytes, at);
}

static int shim_truncate(sqlite3_file *f, sqlite3_int64 size)
{
    return REAL(f)->pMethods->xTruncate(REAL(f), size);
}

static int shim_sync(sqlite3_file *f, int flags)
{
    return REAL(f)->pMethods->xSync(REAL(f), flags);
}

static int shim_size(sqlite3_file *f, sqlite3_int64 *size)
{
    return REAL(f)->pMethods->xFileSize(REAL(f), size);
}

static int shim_lock(sqlite3_file *f, int kind)
{
    return REAL(f)->pMethods->xLock(REAL(f), kind);
}

static int shim_unlock(sqlite3_file *f, int kind)
{
    return REAL(f)->pMethods->xUnlock(REAL(f), kind);
}

static int shim_check(sqlite3_file *f, int *ret)
{
    return REAL(f)->pMethods->xCheckReservedLock(REAL(f), ret);
}

static int shim_control(sqlite3_file *f, int op, void *arg)
{
    return op == SQLITE_FCNTL_SIZE_HINT ? SQLITE_OK : REAL(f)->pMethods->xFileControl(REAL(f), op, arg);
}

static int shim_sector(sqlite3_file *f)
{
    return REAL(f)->pMethods->xSectorSize(REAL(f));
}

static int shim_traits(sqlite3_file *f)
{
    return REAL(f)->pMethods->xDeviceCharacteristics(REAL(f));
}

static const sqlite3_io_methods shim_methods = {
    .iVersion = 1, /* no shared memory: the log's index lies on the heap, as one connection may have it */
    .xClose = shim_close,
    .xRead = shim_read,
    .xWrite = shim_write,
    .xTruncate = shim_truncate,
    .xSync = shim_sync,
    .xFileSize = shim_size,
    .xLock = shim_lock,
    .xUnlock = shim_unlock,
    .xCheckReservedLock = shim_check,
    .xFileControl = shim_control,
    .xSectorSize = shim_sector,
    .xDeviceCharacteristics = shim_traits,
};

static sqlite3_vfs *real_vfs, shim_vfs;

static int shim_open(sqlite3_vfs *vfs, const char *name, sqlite3_file *f, int flags, int *ret_flags)
{
    struct shim *shim = (struct shim *)f;
    (void)vfs;
    shim->real = (sqlite3_file *)(shim + 1);
    int code = real_vfs->xOpen(real_vfs, name, shim->real, flags, ret_flags);
    f->pMethods = code == SQLITE_OK ? &shim_methods : NULL;
    return code;
}

static void use_shim(const char *dir)
{
    snprintf(reserve_path, sizeof reserve_path, "%s/draped.reserve", dir);
    real_vfs = sqlite3_vfs_find(NULL);
    shim_vfs = *real_vfs;
    shim_vfs.zName = "shim";
    shim_vfs.szOsFile += (int)sizeof(struct shim);
    shim_vfs.xOpen = shim_open;
    assert_int_equal(sqlite3_vfs_register(&shim_vfs, 1), SQLITE_OK);
    refused = 0;
}

static void drop_shim(void)
{
    disk = ROOMY;
    sqlite3_vfs_unregister(&shim_vfs);
}

static bool reserve_is_there(void)
{
    struct stat st;
    return stat(reserve_path, &st) == 0 && st.st_size == DB_RESERVE_BYTES;
}

/* A file size limit keeps the reserve from being made whole again: the disk's room is somebody else's now. */
static void limit_files(bool limited)
{
    static struct rlimit old;
    struct rlimit small;
    signal(SIGXFSZ, SIG_IGN);
    if (limited) {
        assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
        small = (struct rlimit){DB_RESERVE_BYTES - 1, old.rlim_max};
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    } else {
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    }
}

static void test_database__on_a_full_disk_jobs_may_still_be_cancelled_ended_and_removed(void **state)
{
    struct stage stage;
    struct problem problem;
    struct store_pruned pruned;
    struct store_policy policy = {0, 0, 1};
    struct job job;
    use_shim(*state);
    set_stage(&stage, *state);
    assert_true(reserve_is_there());
    disk = FULL_BUT_RESERVE;
    /* What adds is refused, and takes nothing of the reserve. */
    assert_int_equal(do_add(&stage, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    assert_int_equal(do_mesh_add(&stage, &problem), -1);
    assert_true(refused > 0 && reserve_is_there());
    /* What frees is not. */
    limit_files(true);
    assert_int_equal(do_remove(&stage, &problem), 0);
    assert_false(reserve_is_there());
    assert_int_equal(store_job_get(stage.store, "", stage.ended.id, &job, &problem), STORE_GONE);
    assert_int_equal(do_cancel_queued(&stage, &problem), 0);
    assert_int_equal(do_cancel_running(&stage, &problem), 0);
    assert_int_equal(do_finish(&stage, &problem), 0);
    /* Before the reserve is whole again nothing is added, although there is room for it. */
    refused = 0;
    assert_int_equal(do_add(&stage, &problem), -1);
    assert_int_equal(do_start(&stage, &problem), -1);
    assert_int_equal(refused, 0);
    assert_int_equal(store_prune(stage.store, &policy, (int64_t)1 << 40, &pruned, &problem), 0);
    assert_int_equal(pruned.jobs, 2);
    assert_int_equal(pruned.meshes, 1);
    limit_files(false);
    /* Relief: the next one that asks finds all as it was. */
    disk = ROOMY;
    assert_int_equal(store_mesh_add(stage.store, "", &mesh, "abc", 1, &problem), 0);
    assert_int_equal(do_add(&stage, &problem), 0);
    assert_true(reserve_is_there());
    store_close(stage.store);
    drop_shim();
}

static void test_database__a_disk_fuller_than_the_reserve_is_a_refusal(void **state)
{
    struct stage stage;
    struct problem problem;
    use_shim(*state);
    set_stage(&stage, *state);
    disk = FULL;
    limit_files(true);
    assert_int_equal(do_remove(&stage, &problem), -1); /* spends the reserve in vain */
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    assert_int_equal(do_remove(&stage, &problem), -1); /* has none to spend */
    limit_files(false);
    disk = ROOMY;
    assert_int_equal(do_remove(&stage, &problem), 0);
    store_close(stage.store);
    drop_shim();
}

static void test_database__a_store_opens_on_a_full_disk_and_recovers(void **state)
{
    struct stage stage;
    struct problem problem;
    struct found found = {0};
    use_shim(*state);
    set_stage(&stage, *state);
    store_close(stage.store);
    disk = FULL_BUT_RESERVE;
    limit_files(true);
    stage.store = open_store(*state);
    assert_int_equal(store_recover(stage.store, 3, 1, note_job, &found, &problem), 0);
    assert_int_equal(found.count, 3);
    store_close(stage.store);
    stage.store = open_store(*state); /* and without its reserve */
    assert_int_equal(do_add(&stage, &problem), -1);
    limit_files(false);
    assert_int_equal(do_add(&stage, &problem), -1); /* the disk is full as before */
    disk = ROOMY;
    assert_int_equal(do_add(&stage, &problem), 0);
    store_close(stage.store);
    drop_shim();
}

/* ---- opening ------------------------------------------------------------------------------------ */

static void test_database__a_damaged_one_is_not_opened(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job;
    char path[256];
    for (int i = 0; i < 100; i++)
        add_job(store, &job);
    store_close(store);
    snprintf(path, sizeof path, "%s/draped.db", (char *)*state);
    for (int page = 1; page < 12; page++) { /* the header stays */
        int fd = open(path, O_WRONLY);
        assert_int_equal(pwrite(fd, "rubbish rubbish rubbish rubbish", 31, page * 4096), 31);
        close(fd);
    }
    store = NULL;
    assert_int_equal(store_open(*state, NULL, &store, &problem), -1);
    assert_non_null(strstr(problem.detail, "damaged"));
    assert_null(store);
    int fd = open(path, O_WRONLY | O_TRUNC);
    assert_int_equal(write(fd, "this is no database, but a text of more than a header", 53), 53);
    close(fd);
    assert_int_equal(store_open(*state, NULL, &store, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
}

static void test_database__a_folder_it_cannot_use_is_refused(void **state)
{
    struct store *store = NULL;
    struct problem problem;
    char path[256], name[5000];
    const char *const blocked[] = {"draped.reserve", "draped.db"};
    for (size_t i = 0; i < sizeof blocked / sizeof *blocked; i++) {
        snprintf(path, sizeof path, "%s/%s", (char *)*state, blocked[i]);
        assert_int_equal(mkdir(path, 0700), 0);
        assert_int_equal(store_open(*state, NULL, &store, &problem), -1);
        assert_int_equal(problem.code, PROBLEM_STORAGE);
        assert_int_equal(rmdir(path), 0);
    }
    memset(name, '/', sizeof name - 1); /* a folder by any number of slashes */
    memcpy(name, *state, strlen(*state));
    name[4090] = '\0';
    assert_int_equal(store_open(name, NULL, &store, &problem), -1);
    store_close(open_store(*state));
}

/* Each statement of the upgrade made to fail: the old tables stay, and the next start does it all. */
static int upgrade_steps;

static int stop_upgrade(void *data)
{
    (void)data;
    return upgrade_steps-- == 0;
}

static int arm_upgrade(sqlite3 *db, char **message, const struct sqlite3_api_routines *api)
{
    (void)message, (void)api;
    sqlite3_progress_handler(db, 1, stop_upgrade, NULL);
    return SQLITE_OK;
}

static void test_database__an_upgrade_that_fails_leaves_the_old_tables(void **state)
{
    struct problem problem;
    int failures = 0;
    make_old_database(*state, 1, OLD_ROWS);
    sqlite3_auto_extension((void (*)(void))arm_upgrade);
    for (int n = 0;; n += 7) {
        struct store *store = NULL;
        upgrade_steps = n;
        if (store_open(*state, NULL, &store, &problem) == 0) {
            store_close(store);
            break;
        }
        assert_int_equal(problem.code, PROBLEM_STORAGE);
        failures++;
    }
    sqlite3_cancel_auto_extension((void (*)(void))arm_upgrade);
    print_message("%d failures\n", failures);
    assert_true(failures > 20);
    struct store *store = open_store(*state);
    struct job job;
    get_job(store, OLD_ID, &job);
    job_done(&job);
    store_close(store);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_database__each_step_that_fails_changes_nothing_and_may_be_tried_again),
        TEST(test_database__so_does_a_commit_that_fails),
#ifdef CAN_FAIL_ALLOCATIONS
        TEST(test_database__each_allocation_that_fails_changes_nothing),
        TEST(test_database__a_store_opens_or_does_not_when_memory_is_short),
#endif
        TEST(test_database__on_a_full_disk_jobs_may_still_be_cancelled_ended_and_removed),
        TEST(test_database__a_disk_fuller_than_the_reserve_is_a_refusal),
        TEST(test_database__a_store_opens_on_a_full_disk_and_recovers),
        TEST(test_database__a_damaged_one_is_not_opened),
        TEST(test_database__a_folder_it_cannot_use_is_refused),
        TEST(test_database__an_upgrade_that_fails_leaves_the_old_tables),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    sqlite3_auto_extension((void (*)(void))catch_connection);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
