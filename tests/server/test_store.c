/* test_store.c - what survives: recovery, fencing, attempts, the third crash, refused writes. */
#include "shelf.h"

#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "log.h"
#include "store.h"

static void test_store__a_job_comes_back_as_it_was_added(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job = {.created_ms = 1234,
                      .revision = {1, 1},
                      .name = strdup("blue"),
                      .labels = strdup("{\"a\":\"b\"}"),
                      .warnings = strdup("[1]")};
    id_new(job.id);
    assert_int_equal(add_row(store, &job, "[1,2]", 5, &problem), 0);
    store = store_close(store);
    store = open_store(*state);
    struct job back;
    get_job(store, job.id, &back);
    assert_string_equal(back.name, "blue");
    assert_string_equal(back.labels, "{\"a\":\"b\"}");
    assert_string_equal(back.warnings, "[1]");
    assert_int_equal(back.status, JOB_QUEUED);
    assert_int_equal(back.created_ms, 1234);
    assert_null(back.report);
    char *text;
    size_t bytes;
    assert_int_equal(store_job_document(store, job.id, &text, &bytes, &problem), 0);
    assert_int_equal(bytes, 5);
    assert_string_equal(text, "[1,2]");
    free(text);
    job_done(&back);
    job_done(&job);
    store_close(store);
}

/* Version 1 had no warnings; version 2 no owners: what it kept is that of a daemon without keys. */
static void test_store__a_folder_of_an_earlier_version_is_read_on(void **state)
{
    struct problem problem;
    struct job back;
    struct found found;
    struct store_mesh mesh;
    for (int version = 1; version <= 2; version++) {
        char path[256];
        make_old_database(*state, version, OLD_ROWS);
        for (int open = 0; open < 2; open++) { /* the second time there is nothing to do */
            struct store *store = open_store(*state);
            get_job(store, OLD_ID, &back);
            assert_string_equal(back.name, "old");
            assert_string_equal(back.owner, "");
            assert_string_equal(back.trace_id, "");
            assert_int_equal(back.priority, JOB_PRIORITY_NORMAL);
            assert_int_equal(back.revision.attempt, 2);
            assert_int_equal(back.revision.counter, 3);
            assert_int_equal(back.crashes, 1);
            assert_null(back.warnings);
            job_done(&back);
            assert_int_equal(store_job_get(store, "", OLD_GONE, &back, &problem), STORE_GONE);
            assert_int_equal(store_job_get(store, "shop", OLD_ID, &back, &problem), STORE_NONE);
            assert_int_equal(store_mesh_get(store, "", OLD_DIGEST, &mesh, &problem), 0);
            assert_int_equal(mesh.bytes, 3);
            assert_int_equal(mesh.vertices, 4);
            assert_int_equal(mesh.triangles, 5);
            assert_int_equal(store_mesh_get(store, "shop", OLD_DIGEST, &mesh, &problem), STORE_NONE);
            assert_int_equal(recover(store, &found), 1);
            store_close(store);
        }
        snprintf(path, sizeof path, "%s/draped.db", (char *)*state);
        assert_int_equal(remove(path), 0);
    }
}

static void test_store__a_folder_of_a_later_version_is_left_alone(void **state)
{
    struct store *store = NULL;
    struct problem problem;
    char path[256];
    sqlite3 *db;
    snprintf(path, sizeof path, "%s/draped.db", (char *)*state);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "PRAGMA user_version=4;", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    assert_int_equal(store_open(*state, NULL, &store, &problem), -1);
    assert_non_null(strstr(problem.detail, "another version (4)"));
}

/* Both have the same mesh, and a job each. */
static void test_store__an_owner_finds_nothing_of_anothers(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_mesh mesh = {.format = 2, .bytes = 3, .vertices = 4, .triangles = 5}, back;
    uint64_t held;
    const char *const owner[] = {"shop", "studio"};
    struct job job[2], got;
    struct found found;
    int64_t last;
    bool more;
    int fd;
    sha256_hex("abc", 3, mesh.sha256);
    assert_int_equal(store_mesh_add(store, owner[0], &mesh, "abc", 1, &problem), 0);
    assert_int_equal(store_mesh_get(store, owner[1], mesh.sha256, &back, &problem), STORE_NONE);
    assert_int_equal(store_mesh_open(store, owner[1], mesh.sha256, &back, &fd, &problem), STORE_NONE);
    mesh.format = 3;
    assert_int_equal(store_mesh_add(store, owner[1], &mesh, "abc", 1, &problem), 0);
    assert_int_equal(count_entries(*state, "meshes"), 1);
    mesh.bytes = 4;
    sha256_hex("abcd", 4, mesh.sha256);
    assert_int_equal(store_mesh_add(store, owner[1], &mesh, "abcd", 1, &problem), 0);
    assert_int_equal(store_mesh_bytes(store, owner[0], &held, &problem), 0);
    assert_int_equal(held, 3);
    assert_int_equal(store_mesh_bytes(store, owner[1], &held, &problem), 0);
    assert_int_equal(held, 7);
    assert_int_equal(store_mesh_bytes(store, "nobody", &held, &problem), 0);
    assert_int_equal(held, 0);
    sha256_hex("abc", 3, mesh.sha256);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(store_mesh_get(store, owner[i], mesh.sha256, &back, &problem), 0);
        assert_int_equal(back.format, 2 + i);
        job[i] = (struct job){.revision = {1, 1},
                              .priority = i ? JOB_PRIORITY_LOW : JOB_PRIORITY_HIGH,
                              .memory = 5000000000 + (uint64_t)i};
        id_new(job[i].id);
        strcpy(job[i].owner, owner[i]);
        snprintf(job[i].trace_id, sizeof job[i].trace_id, "%032x", (unsigned)i + 1);
        assert_int_equal(add_row(store, &job[i], "{}", 2, &problem), 0);
    }
    store = store_close(store);
    store = open_store(*state);
    assert_int_equal(recover(store, &found), 2); /* the queue takes them all */
    for (int i = 0; i < 2; i++) {
        struct store_filter filter = {
            .owner = owner[i], .created_after_ms = -1, .status = -1, .before = INT64_MAX, .limit = 9};
        assert_int_equal(store_job_get(store, owner[1 - i], job[i].id, &got, &problem), STORE_NONE);
        assert_int_equal(store_job_get(store, "", job[i].id, &got, &problem), STORE_NONE);
        assert_int_equal(store_job_get(store, owner[i], job[i].id, &got, &problem), 0);
        assert_string_equal(got.owner, owner[i]);
        assert_string_equal(got.trace_id, job[i].trace_id);
        assert_int_equal(got.priority, job[i].priority);
        assert_int_equal(got.memory, job[i].memory);
        job_done(&got);
        memset(&found, 0, sizeof found);
        assert_int_equal(store_job_list(store, &filter, note_job, &found, &last, &more, &problem), 0);
        assert_int_equal(found.count, 1);
        assert_string_equal(found.last.id, job[i].id);
    }
    assert_int_equal(store_start_keep(store, owner[0], job[0].id, job[1].id, "f", &problem), STORE_NONE);
    assert_int_equal(store_job_cancel_queued(store, &job[0], &problem), 0);
    assert_int_equal(store_job_remove(store, owner[1], job[0].id, 1, &problem), STORE_NONE);
    assert_int_equal(store_job_remove(store, owner[0], job[0].id, 1, &problem), 0);
    assert_int_equal(store_job_get(store, owner[0], job[0].id, &got, &problem), STORE_GONE);
    assert_int_equal(store_job_get(store, owner[1], job[0].id, &got, &problem), STORE_NONE);
    store_close(store);
}

static void expect_start(struct store *store, const char *id, bool there)
{
    struct problem problem;
    char *text;
    size_t bytes;
    assert_int_equal(store_start_drape(store, id, &text, &bytes, &problem), there ? 0 : -1);
    if (!there)
        return;
    assert_string_equal(text, "drape");
    free(text);
    assert_int_equal(store_start_document(store, id, &text, &bytes, &problem), 0);
    assert_string_equal(text, "{}");
    free(text);
}

static void test_store__a_start_outlives_its_job_and_goes_with_the_one_that_needs_it(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct found found;
    struct job from, job = {.revision = {1, 1}}, orphan = {.revision = {1, 1}};
    add_finished(store, "positions", &from);
    id_new(job.id);
    id_new(orphan.id);
    assert_int_equal(store_start_keep(store, "", job.id, from.id, "positions", &problem), 0);
    assert_int_equal(store_start_keep(store, "", orphan.id, from.id, "positions", &problem), 0);
    assert_int_equal(add_row(store, &job, "[]", 2, &problem), 0);
    assert_int_equal(store_job_remove(store, "", from.id, 1, &problem), 0);
    store = store_close(store);
    store = open_store(*state);
    recover(store, &found);
    expect_start(store, job.id, true);
    expect_start(store, orphan.id, false); /* its job was never added */
    assert_int_equal(store_job_cancel_queued(store, &job, &problem), 0);
    expect_start(store, job.id, false);
    store_close(store);
}

static void test_store__a_start_needs_a_finished_job_with_that_file(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job queued, from;
    char id[ID_SIZE], none[ID_SIZE];
    id_new(id);
    id_new(none);
    add_job(store, &queued);
    add_finished(store, "positions", &from);
    assert_int_equal(store_start_keep(store, "", id, none, "positions", &problem), STORE_NONE);
    assert_int_equal(store_start_keep(store, "", id, queued.id, "positions", &problem), STORE_UNFINISHED);
    assert_int_equal(store_start_keep(store, "", id, from.id, "drape", &problem), STORE_WITHOUT);
    assert_int_equal(store_job_cancel_queued(store, &queued, &problem), 0);
    assert_int_equal(store_start_keep(store, "", id, queued.id, "positions", &problem), STORE_WITHOUT);
    assert_int_equal(store_job_remove(store, "", from.id, 1, &problem), 0);
    assert_int_equal(store_start_keep(store, "", id, from.id, "positions", &problem), STORE_GONE);
    expect_start(store, id, false);
    store_close(store);
}

static void test_store__a_second_daemon_is_kept_out(void **state)
{
    struct store *store = open_store(*state), *second = NULL;
    struct problem problem;
    assert_int_equal(store_open(*state, NULL, &second, &problem), -1);
    assert_non_null(strstr(problem.detail, "in use"));
    store_close(store);
    second = open_store(*state);
    store_close(second);
}

static void test_store__queued_jobs_are_recovered_oldest_first_at_their_attempt(void **state)
{
    struct store *store = open_store(*state);
    struct job a, b;
    struct found found;
    add_job(store, &a);
    add_job(store, &b);
    store_close(store);
    store = open_store(*state);
    assert_int_equal(recover(store, &found), 2);
    assert_string_equal(found.last.id, b.id);
    assert_int_equal(found.last.revision.attempt, 1);
    assert_int_equal(found.last.crashes, 0);
    store_close(store);
}

static void test_store__a_crash_requeues_at_the_next_attempt_and_the_third_fails(void **state)
{
    struct store *store = open_store(*state);
    struct job job, back;
    struct found found;
    add_job(store, &job);
    for (unsigned crash = 1; crash <= 3; crash++) {
        start_job(store, &job);
        store_close(store); /* nobody wrote an end: the daemon died */
        store = open_store(*state);
        size_t queued = recover(store, &found);
        assert_int_equal(count_entries(*state, "results"), 0); /* half a result is no result */
        if (crash < 3) {
            assert_int_equal(queued, 1);
            assert_int_equal(found.last.revision.attempt, crash + 1);
            assert_int_equal(found.last.crashes, crash);
            job.revision = (struct revision){crash + 1, 1};
        } else {
            assert_int_equal(queued, 0);
        }
    }
    get_job(store, job.id, &back);
    assert_int_equal(back.status, JOB_FAILED);
    assert_int_equal(back.finished_ms, 5000);
    assert_non_null(strstr(back.error, "\"worker-crash\""));
    assert_true(revision_compare(back.revision, job.revision) > 0);
    job_done(&back);
    store_close(store);
}

static void test_store__a_requeue_is_no_crash(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job, back;
    add_job(store, &job);
    for (uint32_t i = 1; i <= 5; i++) {
        start_job(store, &job);
        assert_int_equal(store_job_requeue(store, &job, &problem), 0);
        job.revision = (struct revision){i + 1, 1};
    }
    get_job(store, job.id, &back);
    assert_int_equal(back.status, JOB_QUEUED);
    assert_int_equal(back.revision.attempt, 6);
    assert_int_equal(back.crashes, 0);
    job_done(&back);
    store_close(store);
}

static void test_store__a_cancel_that_a_crash_cut_short_holds(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job, back;
    struct found found;
    add_job(store, &job);
    start_job(store, &job);
    assert_int_equal(store_job_cancel_running(store, &job, &problem), 0);
    store_close(store);
    store = open_store(*state);
    assert_int_equal(recover(store, &found), 0);
    get_job(store, job.id, &back);
    assert_int_equal(back.status, JOB_CANCELED);
    job_done(&back);
    store_close(store);
}

static void test_store__of_two_racing_writes_one_wins(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job;
    add_job(store, &job);
    assert_int_equal(store_job_cancel_running(store, &job, &problem), STORE_NONE); /* it does not run */
    start_job(store, &job);
    assert_int_equal(store_job_start(store, &job, &problem), STORE_NONE);
    assert_int_equal(store_job_cancel_queued(store, &job, &problem), STORE_NONE);
    job.status = JOB_SUCCEEDED;
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    job.status = JOB_FAILED;
    assert_int_equal(store_job_finish(store, &job, &problem), STORE_NONE);
    assert_int_equal(store_job_requeue(store, &job, &problem), STORE_NONE);
    store_close(store);
}

static void test_store__a_stale_attempt_writes_nothing_and_harms_no_result(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job stale, job, back;
    int fd;
    uint64_t bytes;
    add_job(store, &job);
    start_job(store, &job);
    stale = job;
    assert_int_equal(store_job_requeue(store, &job, &problem), 0);
    job.revision = (struct revision){2, 1};
    start_job(store, &job);
    job.status = JOB_SUCCEEDED;
    strcpy(job.verdict, "at-rest");
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    /* The first attempt wakes up, with a result of its own. */
    assert_int_equal(store_results_begin(store, stale.id, 1, &fd, &problem), 0);
    close(fd);
    stale.status = JOB_SUCCEEDED;
    strcpy(stale.verdict, "slid-off");
    assert_int_equal(store_job_finish(store, &stale, &problem), STORE_NONE);
    get_job(store, job.id, &back);
    assert_string_equal(back.verdict, "at-rest");
    assert_int_equal(back.revision.attempt, 2);
    assert_int_equal(store_result_open(store, job.id, 2, "result.json", &fd, &bytes, &problem), 0);
    assert_int_equal(bytes, 2);
    close(fd);
    assert_int_equal(store_result_open(store, job.id, 1, "result.json", &fd, &bytes, &problem), STORE_NONE);
    job_done(&back);
    store_close(store);
}

static void test_store__results_outlive_a_restart_and_orphans_do_not(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job, cut;
    struct found found;
    int fd;
    uint64_t bytes;
    add_job(store, &job);
    start_job(store, &job);
    job.status = JOB_SUCCEEDED;
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    add_job(store, &cut);
    start_job(store, &cut);
    store_close(store);
    char path[256];
    snprintf(path, sizeof path, "%s/jobs/0123.json", (char *)*state);
    close(open(path, O_CREAT | O_WRONLY, 0600));
    snprintf(path, sizeof path, "%s/meshes/%064d.77.tmp", (char *)*state, 0);
    close(open(path, O_CREAT | O_WRONLY, 0600));
    snprintf(path, sizeof path, "%s/jobs/%s.json.77.tmp", (char *)*state, job.id);
    close(open(path, O_CREAT | O_WRONLY, 0600));
    snprintf(path, sizeof path, "%s/results/%s.2", (char *)*state, job.id); /* of no attempt that ended */
    assert_int_equal(mkdir(path, 0700), 0);
    store = open_store(*state);
    recover(store, &found);
    assert_int_equal(count_entries(*state, "jobs"), 2);
    assert_int_equal(count_entries(*state, "results"), 1);
    assert_int_equal(count_entries(*state, "meshes"), 0);
    assert_int_equal(store_result_open(store, job.id, 1, "result.json", &fd, &bytes, &problem), 0);
    close(fd);
    store_close(store);
}

static void test_store__removal_takes_the_files_and_leaves_a_tombstone(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job, back;
    add_job(store, &job);
    assert_int_equal(store_job_remove(store, "", job.id, 1, &problem), STORE_NONE); /* it has not ended */
    start_job(store, &job);
    assert_int_equal(store_job_remove(store, "", job.id, 1, &problem), STORE_NONE);
    job.status = JOB_SUCCEEDED;
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    assert_int_equal(store_job_remove(store, "", job.id, 1, &problem), 0);
    assert_int_equal(store_job_get(store, "", job.id, &back, &problem), STORE_GONE);
    assert_int_equal(store_job_remove(store, "", job.id, 1, &problem), STORE_GONE);
    assert_int_equal(store_job_get(store, "", "00000000000000000000000000000000", &back, &problem),
                     STORE_NONE);
    assert_int_equal(count_entries(*state, "jobs"), 0);
    assert_int_equal(count_entries(*state, "results"), 0);
    store_close(store);
}

static void test_store__lists_come_in_pages_newest_first_and_filtered(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job;
    struct found found = {0};
    struct store_filter filter = {
        .owner = "", .created_after_ms = -1, .status = -1, .before = INT64_MAX, .limit = 3};
    char first[ID_SIZE] = "";
    int64_t last;
    bool more;
    for (int i = 0; i < 7; i++) {
        add_job(store, &job);
        if (i == 0)
            strcpy(first, job.id);
    }
    size_t pages = 0;
    do {
        assert_int_equal(store_job_list(store, &filter, note_job, &found, &last, &more, &problem), 0);
        filter.before = last;
        pages++;
    } while (more);
    assert_int_equal(pages, 3);
    assert_int_equal(found.count, 7);
    assert_string_equal(found.last.id, first);
    filter = (struct store_filter){
        .owner = "", .created_after_ms = -1, .status = JOB_RUNNING, .before = INT64_MAX, .limit = 3};
    found.count = 0;
    assert_int_equal(store_job_list(store, &filter, note_job, &found, &last, &more, &problem), 0);
    assert_int_equal(found.count, 0);
    struct job labelled = {.revision = {1, 1}, .labels = strdup("{\"order\":\"4711\",\"x\":\"y\"}")};
    id_new(labelled.id);
    assert_int_equal(add_row(store, &labelled, "{}", 2, &problem), 0);
    filter = (struct store_filter){.owner = "",
                                   .status = -1,
                                   .label_name = "order",
                                   .label_value = "4711",
                                   .created_after_ms = -1,
                                   .before = INT64_MAX,
                                   .limit = 3};
    assert_int_equal(store_job_list(store, &filter, note_job, &found, &last, &more, &problem), 0);
    assert_int_equal(found.count, 1);
    assert_string_equal(found.last.id, labelled.id);
    filter.label_value = "471";
    assert_int_equal(store_job_list(store, &filter, note_job, &found, &last, &more, &problem), 0);
    assert_int_equal(found.count, 1);
    job_done(&labelled);
    store_close(store);
}

/* A file size limit stands in for a full disk. */
static void test_store__a_disk_that_refuses_means_not_accepted_and_nothing_left(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job = {.revision = {1, 1}}, back;
    struct rlimit old, small = {1000, RLIM_INFINITY};
    char *document = calloc(1, 5000);
    id_new(job.id);
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    small.rlim_max = old.rlim_max;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    int added_file = add_row(store, &job, document, 5000, &problem); /* the document fails */
    enum problem_code code_file = problem.code;
    int added_row = add_row(store, &job, document, 10, &problem); /* the database does */
    enum problem_code code_row = problem.code;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    assert_int_equal(added_file, -1);
    assert_int_equal(code_file, PROBLEM_STORAGE);
    assert_int_equal(added_row, -1);
    assert_int_equal(code_row, PROBLEM_STORAGE);
    assert_int_equal(count_entries(*state, "jobs"), 0);
    assert_int_equal(store_job_get(store, "", job.id, &back, &problem), STORE_NONE);
    assert_int_equal(add_row(store, &job, document, 5000, &problem), 0); /* normal once relieved */
    free(document);
    store_close(store);
}

static void test_store__a_finish_may_be_tried_again_after_a_refusal(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job;
    struct rlimit old, small = {1000, RLIM_INFINITY};
    int fd;
    uint64_t bytes;
    add_job(store, &job);
    start_job(store, &job);
    job.status = JOB_SUCCEEDED;
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    small.rlim_max = old.rlim_max;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    int finished = store_job_finish(store, &job, &problem);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    assert_int_equal(finished, -1);
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    assert_int_equal(store_result_open(store, job.id, 1, "result.json", &fd, &bytes, &problem), 0);
    close(fd);
    store_close(store);
}

/* Runs a command with the folder as $0. */
static void shell(const char *dir, const char *command)
{
    char whole[1024];
    snprintf(whole, sizeof whole, "sh -c '%s' '%s'", command, dir);
    assert_int_equal(system(whole), 0);
}

static void test_store__a_folder_whose_rooms_are_taken_is_refused(void **state)
{
    const char *const taken[] = {"jobs", "results", "meshes"};
    struct store *store = NULL;
    struct problem problem;
    char command[64], path[256];
    for (size_t i = 0; i < sizeof taken / sizeof *taken; i++) {
        snprintf(command, sizeof command, "touch $0/%s", taken[i]);
        shell(*state, command);
        assert_int_equal(store_open(*state, NULL, &store, &problem), -1);
        assert_int_equal(problem.code, PROBLEM_STORAGE);
        shell(*state, "rm -r $0/*");
    }
    shell(*state, "mkdir $0/draped.lock");
    assert_int_equal(store_open(*state, NULL, &store, &problem), -1);
    assert_non_null(strstr(problem.detail, "lock"));
    shell(*state, "rmdir $0/draped.lock; touch $0/file");
    snprintf(path, sizeof path, "%s/file", (const char *)*state);
    assert_int_equal(store_open(path, NULL, &store, &problem), -1);
    assert_null(store);
    store_close(open_store(*state));
}

static int none_asked(const struct job *job, void *data)
{
    (void)job, (void)data;
    fail();
    return 0;
}

static void test_store__a_row_that_makes_no_sense_is_a_refusal(void **state)
{
    struct store *store = open_store(*state);
    struct store_filter filter = {
        .owner = "", .status = -1, .created_after_ms = -1, .before = INT64_MAX, .limit = 9};
    struct problem problem = {.code = PROBLEM_NONE};
    struct job job, back;
    char path[256];
    sqlite3 *db;
    int64_t last;
    bool more;
    add_job(store, &job);
    store_close(store);
    snprintf(path, sizeof path, "%s/draped.db", (const char *)*state);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "UPDATE job SET status='sleeping'", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    store = open_store(*state);
    assert_int_equal(store_job_get(store, "", job.id, &back, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    problem.code = PROBLEM_NONE;
    assert_int_equal(store_job_list(store, &filter, none_asked, NULL, &last, &more, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    store_close(store);
}

static void test_store__what_is_not_there_or_in_the_way_is_a_refusal(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem = {.code = PROBLEM_NONE};
    struct job job;
    char *text, command[256];
    size_t bytes;
    int dirfd;
    add_job(store, &job);
    shell(*state, "rm $0/jobs/*");
    assert_int_equal(store_job_document(store, job.id, &text, &bytes, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    problem.code = PROBLEM_NONE;
    assert_int_equal(store_job_start(store, &job, &problem), 0);
    snprintf(command, sizeof command, "mkdir -p $0/results/%s.1.tmp/deep", job.id);
    shell(*state, command);
    assert_int_equal(store_results_begin(store, job.id, 1, &dirfd, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    problem.code = PROBLEM_NONE;
    snprintf(command, sizeof command, "rm -r $0/results/%s.1.tmp", job.id);
    shell(*state, command);
    job.status = JOB_SUCCEEDED; /* without results there is nothing to publish */
    assert_int_equal(store_job_finish(store, &job, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    job.status = JOB_FAILED;
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    store_close(store);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_store__a_job_comes_back_as_it_was_added),
        TEST(test_store__a_folder_of_an_earlier_version_is_read_on),
        TEST(test_store__a_folder_of_a_later_version_is_left_alone),
        TEST(test_store__an_owner_finds_nothing_of_anothers),
        TEST(test_store__a_start_outlives_its_job_and_goes_with_the_one_that_needs_it),
        TEST(test_store__a_start_needs_a_finished_job_with_that_file),
        TEST(test_store__a_second_daemon_is_kept_out),
        TEST(test_store__queued_jobs_are_recovered_oldest_first_at_their_attempt),
        TEST(test_store__a_crash_requeues_at_the_next_attempt_and_the_third_fails),
        TEST(test_store__a_requeue_is_no_crash),
        TEST(test_store__a_cancel_that_a_crash_cut_short_holds),
        TEST(test_store__of_two_racing_writes_one_wins),
        TEST(test_store__a_stale_attempt_writes_nothing_and_harms_no_result),
        TEST(test_store__results_outlive_a_restart_and_orphans_do_not),
        TEST(test_store__removal_takes_the_files_and_leaves_a_tombstone),
        TEST(test_store__lists_come_in_pages_newest_first_and_filtered),
        TEST(test_store__a_disk_that_refuses_means_not_accepted_and_nothing_left),
        TEST(test_store__a_finish_may_be_tried_again_after_a_refusal),
        TEST(test_store__a_folder_whose_rooms_are_taken_is_refused),
        TEST(test_store__a_row_that_makes_no_sense_is_a_refusal),
        TEST(test_store__what_is_not_there_or_in_the_way_is_a_refusal),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
