/* store.c - jobs, their documents, results and starts; see store.h for what is where and when. */
#include "store_rooms.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "files.h"
#include "jsonout.h"
#include "log.h"
#include "metrics.h"

/* ---- errors ----------------------------------------------------------------------------------- */

int store_fail_file(struct store *store, const char *what, struct problem *reterr)
{
    int error = errno;
    metrics_add(store->metrics, METRIC_STORE_ERRORS, 1);
    log_event(LOG_LEVEL_ERROR, "store.file", "what=%s errno=%d error=\"%s\"", what, error, strerror(error));
    return problem_set(reterr, PROBLEM_STORAGE, "The data folder refused to %s: %s.", what, strerror(error));
}

/* ---- names -------------------------------------------------------------------------------------- */

#define NAME_SIZE 64 /* an id, an attempt, a suffix */

static void document_name(const char *id, char ret[NAME_SIZE])
{
    snprintf(ret, NAME_SIZE, "%s.json", id);
}

static void start_name(const char *id, const char *suffix, char ret[NAME_SIZE])
{
    snprintf(ret, NAME_SIZE, "%s%s", id, suffix);
}

#define FROM_SUFFIX  ".from"
#define START_SUFFIX ".start"

/* An attempt writes and publishes under its own name: a stale one can never touch another's files. */
static void results_name(const char *id, uint32_t attempt, const char *suffix, char ret[NAME_SIZE])
{
    snprintf(ret, NAME_SIZE, "%s.%" PRIu32 "%s", id, attempt, suffix);
}

/* ---- jobs to rows ------------------------------------------------------------------------------- */

static void bind_text(sqlite3_stmt *s, int index, const char *text)
{
    sqlite3_bind_text(s, index, text, -1, SQLITE_STATIC);
}

static sqlite3_stmt *bind_job(struct db *db, enum statement which, const struct job *job)
{
    sqlite3_stmt *s =
        db_bind(db, which, "tii", job->id, (int64_t)job->revision.attempt, (int64_t)job->revision.counter);
    const char *text[] = {job->progress, job->report, job->error};
    int count = sqlite3_bind_parameter_count(s);
    if (count >= 4)
        bind_text(s, 4, job_status_name(job->status));
    if (count >= 5)
        bind_text(s, 5, job->verdict);
    if (count >= 6)
        sqlite3_bind_int64(s, 6, job->started_ms);
    if (count >= 7)
        sqlite3_bind_int64(s, 7, job->finished_ms);
    for (int i = 0; i < 3 && count >= 8 + i; i++)
        bind_text(s, 8 + i, text[i]);
    if (count < 20)
        return s;
    sqlite3_bind_int64(s, 11, job->crashes);
    sqlite3_bind_int64(s, 12, job->cancel);
    sqlite3_bind_int64(s, 13, job->created_ms);
    bind_text(s, 14, job->name);
    bind_text(s, 15, job->labels);
    bind_text(s, 16, job->warnings);
    bind_text(s, 17, job->owner);
    sqlite3_bind_int(s, 18, job->priority);
    sqlite3_bind_int64(s, 19, (int64_t)job->memory);
    bind_text(s, 20, job->trace_id);
    return s;
}

struct job_write {
    enum statement which;
    const struct job *job;
    int64_t bytes; /* of the results; JOB_FINISH only */
};

static int run_job_write(struct db *db, void *data)
{
    const struct job_write *write = data;
    sqlite3_stmt *s = bind_job(db, write->which, write->job);
    if (write->which == SQL_JOB_FINISH)
        sqlite3_bind_int64(s, 11, write->bytes);
    if (db_run(db, write->which) != 0)
        return -1;
    return db_changes(db) > 0 ? 0 : STORE_NONE;
}

/* One statement on one job in a transaction of its own: 0, STORE_NONE when no row matched, or -1. */
static int write_job(struct store *store, enum db_need need, enum statement which, const struct job *job,
                     const char *what, struct problem *reterr)
{
    struct job_write write = {which, job, 0};
    return db_transact(store->db, need, what, run_job_write, &write, reterr);
}

/* ---- rows to jobs ------------------------------------------------------------------------------- */

static char *column_text(sqlite3_stmt *s, int column, bool *ok)
{
    const char *text = (const char *)sqlite3_column_text(s, column);
    if (text == NULL)
        return NULL;
    char *copy = strdup(text);
    *ok = *ok && copy != NULL;
    return copy;
}

/* 0, or -1 when out of memory or the row makes no sense. */
static int read_job(sqlite3_stmt *s, struct job *ret, int64_t *ret_seq)
{
    struct job job = {0};
    bool ok = true;
    const char *id = (const char *)sqlite3_column_text(s, 1);
    const char *status = (const char *)sqlite3_column_text(s, 2);
    const char *verdict = (const char *)sqlite3_column_text(s, 3);
    const char *owner = (const char *)sqlite3_column_text(s, 17);
    const char *trace_id = (const char *)sqlite3_column_text(s, 20);
    int number = status == NULL ? -1 : job_status_from_name(status);
    if (id == NULL || verdict == NULL || owner == NULL || trace_id == NULL || number < 0)
        return -1;
    snprintf(job.id, sizeof job.id, "%s", id);
    snprintf(job.verdict, sizeof job.verdict, "%s", verdict);
    snprintf(job.owner, sizeof job.owner, "%s", owner);
    snprintf(job.trace_id, sizeof job.trace_id, "%s", trace_id);
    job.priority = sqlite3_column_int(s, 18);
    job.memory = (uint64_t)sqlite3_column_int64(s, 19);
    job.status = (enum job_status)number;
    job.revision.attempt = (uint32_t)sqlite3_column_int64(s, 4);
    job.revision.counter = (uint32_t)sqlite3_column_int64(s, 5);
    job.crashes = (unsigned)sqlite3_column_int(s, 6);
    job.cancel = sqlite3_column_int(s, 7) != 0;
    job.created_ms = sqlite3_column_int64(s, 8);
    job.started_ms = sqlite3_column_int64(s, 9);
    job.finished_ms = sqlite3_column_int64(s, 10);
    job.name = column_text(s, 11, &ok);
    job.labels = column_text(s, 12, &ok);
    job.progress = column_text(s, 13, &ok);
    job.report = column_text(s, 14, &ok);
    job.error = column_text(s, 15, &ok);
    job.warnings = column_text(s, 16, &ok);
    if (!ok) {
        job_done(&job);
        return -1;
    }
    *ret_seq = sqlite3_column_int64(s, 0);
    *ret = job;
    return 0;
}

/* Reads the rows of a bound statement into fresh memory. -1: the database or memory failed. */
static int read_jobs(struct db *db, enum statement which, struct job **ret, int64_t **ret_seq,
                     size_t *ret_count)
{
    sqlite3_stmt *s = db_bind(db, which, "");
    struct job *job = NULL;
    int64_t *seq = NULL;
    size_t count = 0, room = 0;
    int more;
    while ((more = db_row(db, which)) > 0) {
        if (count == room) {
            room = room ? 2 * room : 64;
            struct job *more_jobs = reallocarray(job, room, sizeof *job);
            job = more_jobs != NULL ? more_jobs : job;
            int64_t *more_seq = reallocarray(seq, room, sizeof *seq);
            seq = more_seq != NULL ? more_seq : seq;
            if (more_jobs == NULL || more_seq == NULL)
                break;
        }
        if (read_job(s, &job[count], &seq[count]) != 0)
            break;
        count++;
    }
    db_reset(db, which);
    *ret = job;
    *ret_seq = seq;
    *ret_count = count;
    return more == 0 ? 0 : -1;
}

static void free_jobs(struct job *job, int64_t *seq, size_t count)
{
    for (size_t i = 0; i < count; i++)
        job_done(&job[i]);
    free(job);
    free(seq);
}

/* ---- opening ------------------------------------------------------------------------------------ */

static int open_folders(struct store *store, const char *dir, struct problem *reterr)
{
    if (files_make_dir(AT_FDCWD, dir, &store->dir) != 0)
        return store_fail_file(store, "open it", reterr);
    store->lock_file = openat(store->dir, "draped.lock", O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (store->lock_file < 0)
        return store_fail_file(store, "make its lock file", reterr);
    if (flock(store->lock_file, LOCK_EX | LOCK_NB) != 0)
        return problem_set(reterr, PROBLEM_STORAGE, "The data folder is in use by another daemon.");
    if (files_make_dir(store->dir, "jobs", &store->jobs) != 0 ||
        files_make_dir(store->dir, "results", &store->results) != 0 ||
        files_make_dir(store->dir, "meshes", &store->meshes) != 0 || fsync(store->dir) != 0)
        return store_fail_file(store, "make its folders", reterr);
    return 0;
}

int store_open(const char *dir, struct metrics *metrics, struct store **ret, struct problem *reterr)
{
    struct store *store = calloc(1, sizeof *store);
    if (store == NULL)
        return problem_set(reterr, PROBLEM_STORAGE, "Out of memory.");
    store->dir = store->jobs = store->results = store->meshes = store->lock_file = -1;
    store->metrics = metrics;
    if (open_folders(store, dir, reterr) != 0 || db_open(dir, store->dir, metrics, &store->db, reterr) != 0) {
        store_close(store);
        return -1;
    }
    *ret = store;
    return 0;
}

struct store *store_close(struct store *store)
{
    if (store == NULL)
        return NULL;
    db_close(store->db);
    int fd[] = {store->jobs, store->results, store->meshes, store->dir, store->lock_file};
    for (size_t i = 0; i < sizeof fd / sizeof *fd; i++)
        if (fd[i] >= 0)
            close(fd[i]);
    free(store);
    return NULL;
}

/* ---- recovery ------------------------------------------------------------------------------------- */

static char *crash_error(void)
{
    struct problem problem;
    problem_set(&problem, PROBLEM_WORKER_CRASH, "The daemon died each time it ran this job.");
    return jsonout_text(problem_json(&problem, NULL, NULL));
}

struct recovery {
    int64_t max_crashes, now_ms;
    const char *error;
};

static int run_recovery(struct db *db, void *data)
{
    const struct recovery *r = data;
    db_bind(db, SQL_RECOVER_CANCELED, "i", r->now_ms);
    db_bind(db, SQL_RECOVER_FAILED, "iit", r->now_ms, r->max_crashes, r->error);
    return db_run(db, SQL_RECOVER_CANCELED) || db_run(db, SQL_RECOVER_FAILED) ||
                   db_run(db, SQL_RECOVER_QUEUED)
               ? -1
               : 0;
}

static int recover_rows(struct store *store, unsigned max_crashes, int64_t now_ms, struct problem *reterr)
{
    char *error = crash_error();
    if (error == NULL)
        return problem_set(reterr, PROBLEM_STORAGE, "Out of memory.");
    struct recovery recovery = {max_crashes, now_ms, error};
    int result = db_transact(store->db, DB_FREES, "recover", run_recovery, &recovery, reterr);
    free(error);
    return result;
}

/* What a sweep of one folder needs to tell an orphan. */
struct sweep {
    struct store *store;
    int dirfd;
    bool (*wanted)(struct store *store, const char *name);
    size_t removed;
};

static void sweep_entry(const char *name, void *data)
{
    struct sweep *sweep = data;
    if (sweep->wanted(sweep->store, name))
        return;
    if (files_remove(sweep->dirfd, name) == 0)
        sweep->removed++;
}

/* Whosever it is. 0, STORE_NONE or -1. */
static int find_job(struct store *store, const char *id, uint32_t *ret_attempt, enum job_status *ret_status)
{
    db_lock(store->db);
    sqlite3_stmt *s = db_bind(store->db, SQL_JOB_KNOWN, "t", id);
    int found = db_row(store->db, SQL_JOB_KNOWN);
    if (found > 0) {
        *ret_attempt = (uint32_t)sqlite3_column_int64(s, 0);
        *ret_status = (enum job_status)job_status_from_name((const char *)sqlite3_column_text(s, 1));
    }
    db_reset(store->db, SQL_JOB_KNOWN);
    db_unlock(store->db);
    return found > 0 ? 0 : found == 0 ? STORE_NONE : -1;
}

/* The names of a start are wanted until their job has ended. */
static bool start_wanted(const char *suffix, enum job_status status)
{
    return !job_status_ended(status) &&
           (strcmp(suffix, FROM_SUFFIX) == 0 || strcmp(suffix, START_SUFFIX) == 0);
}

/* Whether a document or result folder `name` is what the row of its job, if there is one, speaks of. */
static bool job_entry_wanted(struct store *store, const char *name, bool result)
{
    char id[ID_SIZE], expected[NAME_SIZE];
    uint32_t attempt;
    enum job_status status;
    snprintf(id, sizeof id, "%s", name);
    int found = find_job(store, id, &attempt, &status);
    if (found != 0)
        return found < 0; /* a database that cannot tell is no reason to remove anything */
    if (result)
        results_name(id, attempt, "", expected);
    else
        document_name(id, expected);
    return strcmp(name, expected) == 0 ? !result || status == JOB_SUCCEEDED
                                       : !result && start_wanted(name + strlen(id), status);
}

static bool document_wanted(struct store *store, const char *name)
{
    return job_entry_wanted(store, name, false);
}

static bool result_wanted(struct store *store, const char *name)
{
    return job_entry_wanted(store, name, true);
}

static void sweep_orphans(struct store *store)
{
    struct sweep sweep[] = {
        {store, store->jobs, document_wanted, 0},
        {store, store->results, result_wanted, 0},
        {store, store->meshes, store_mesh_wanted, 0},
    };
    size_t removed = 0;
    for (size_t i = 0; i < sizeof sweep / sizeof *sweep; i++) {
        files_list(sweep[i].dirfd, sweep_entry, &sweep[i]);
        removed += sweep[i].removed;
    }
    if (removed > 0)
        log_event(LOG_LEVEL_INFO, "store.swept", "orphans=%zu", removed);
}

int store_recover(struct store *store, unsigned max_crashes, int64_t now_ms, store_job_fn *each, void *data,
                  struct problem *reterr)
{
    if (recover_rows(store, max_crashes, now_ms, reterr) != 0)
        return -1;
    sweep_orphans(store);
    struct job *job;
    int64_t *seq;
    size_t count;
    db_lock(store->db);
    int failed = read_jobs(store->db, SQL_QUEUED, &job, &seq, &count);
    db_unlock(store->db);
    for (size_t i = 0; !failed && i < count; i++)
        failed = each(&job[i], data);
    free_jobs(job, seq, count);
    return failed ? problem_set(reterr, PROBLEM_STORAGE, "The queued jobs could not be read.") : 0;
}

int store_ask(struct store *store, struct problem *reterr)
{
    db_lock(store->db);
    int result = db_row(store->db, SQL_ASK) > 0 ? 0 : db_fail(store->db, "answer", reterr);
    db_reset(store->db, SQL_ASK);
    db_unlock(store->db);
    return result;
}

/* ---- jobs --------------------------------------------------------------------------------------- */

struct addition {
    const struct job *job;
    const struct store_submission *submission;
};

/* The job needs the mesh from now on; STORE_WITHOUT: its owner has none of that digest. */
static int add_mesh_need(struct db *db, int64_t seq, const struct job *job, const char *sha256)
{
    db_bind(db, SQL_JOB_MESH_ADD, "itt", seq, job->owner, sha256);
    if (db_run(db, SQL_JOB_MESH_ADD) != 0)
        return -1;
    if (db_changes(db) == 0)
        return STORE_WITHOUT;
    db_bind(db, SQL_MESH_TOUCH, "ttii", job->owner, sha256, job->created_ms, (int64_t)0);
    return db_run(db, SQL_MESH_TOUCH);
}

static int run_addition(struct db *db, void *data)
{
    const struct addition *addition = data;
    const struct store_submission *submission = addition->submission;
    const struct job *job = addition->job;
    sqlite3_bind_int64(bind_job(db, SQL_JOB_ADD, job), 21, (int64_t)submission->bytes);
    if (db_run(db, SQL_JOB_ADD) != 0)
        return -1;
    int64_t seq = db_last_row(db);
    int result = 0;
    for (size_t i = 0; i < submission->meshes && result == 0; i++)
        result = add_mesh_need(db, seq, job, submission->mesh[i]);
    return result == 0 && submission->key != NULL ? store_answer_add(db, job, submission) : result;
}

int store_job_add(struct store *store, const struct job *job, const struct store_submission *submission,
                  struct problem *reterr)
{
    char name[NAME_SIZE];
    struct addition addition = {job, submission};
    int result;
    document_name(job->id, name);
    if (!db_restore_reserve(store->db)) {
        errno = ENOSPC;
        result = store_fail_file(store, "keep the job", reterr);
    } else if (files_write_durably(store->jobs, name, submission->document, submission->bytes) != 0) {
        result = store_fail_file(store, "keep the job", reterr);
    } else {
        result = db_transact(store->db, DB_ADDS, "add the job", run_addition, &addition, reterr);
        if (result != 0)
            files_remove(store->jobs, name);
    }
    if (result != 0)
        store_start_drop(store, job->id);
    return result;
}

int store_job_start(struct store *store, const struct job *job, struct problem *reterr)
{
    return write_job(store, DB_ADDS, SQL_JOB_START, job, "start the job", reterr);
}

int store_job_cancel_queued(struct store *store, const struct job *job, struct problem *reterr)
{
    int result = write_job(store, DB_FREES, SQL_JOB_CANCEL_QUEUED, job, "cancel the job", reterr);
    if (result == 0)
        store_start_drop(store, job->id);
    return result;
}

int store_job_cancel_running(struct store *store, const struct job *job, struct problem *reterr)
{
    return write_job(store, DB_FREES, SQL_JOB_CANCEL_RUNNING, job, "cancel the job", reterr);
}

int store_job_requeue(struct store *store, const struct job *job, struct problem *reterr)
{
    store_results_drop(store, job->id, job->revision.attempt);
    return write_job(store, DB_FREES, SQL_JOB_REQUEUE, job, "requeue the job", reterr);
}

int store_job_finish(struct store *store, const struct job *job, struct problem *reterr)
{
    char aside[NAME_SIZE], name[NAME_SIZE];
    results_name(job->id, job->revision.attempt, ".tmp", aside);
    results_name(job->id, job->revision.attempt, "", name);
    bool publish = job->status == JOB_SUCCEEDED;
    if (!publish)
        store_results_drop(store, job->id, job->revision.attempt);
    else if (files_publish_dir(store->results, aside, name) != 0 &&
             (errno != ENOENT || faccessat(store->results, name, F_OK, 0) != 0)) /* published before */
        return store_fail_file(store, "publish the result", reterr);
    struct job_write write = {SQL_JOB_FINISH, job, publish ? (int64_t)files_size(store->results, name) : 0};
    int result = db_transact(store->db, DB_FREES, "finish the job", run_job_write, &write, reterr);
    if (publish && result == STORE_NONE)
        files_remove(store->results, name);
    if (result == 0)
        store_start_drop(store, job->id);
    return result;
}

static int read_one(struct store *store, const char *owner, const char *id, struct job *ret,
                    struct problem *reterr)
{
    int64_t seq;
    sqlite3_stmt *s = db_bind(store->db, SQL_JOB_GET, "tt", id, owner);
    int found = db_row(store->db, SQL_JOB_GET);
    if (found < 0 || (found > 0 && read_job(s, ret, &seq) != 0))
        found = db_fail(store->db, "read the job", reterr);
    db_reset(store->db, SQL_JOB_GET);
    if (found != 0)
        return found > 0 ? 0 : -1;
    db_bind(store->db, SQL_GONE_GET, "tt", id, owner);
    found = db_row(store->db, SQL_GONE_GET);
    if (found < 0)
        db_fail(store->db, "look for the job", reterr);
    db_reset(store->db, SQL_GONE_GET);
    return found > 0 ? STORE_GONE : found == 0 ? STORE_NONE : -1;
}

int store_job_get(struct store *store, const char *owner, const char *id, struct job *ret,
                  struct problem *reterr)
{
    db_lock(store->db);
    int result = read_one(store, owner, id, ret, reterr);
    db_unlock(store->db);
    return result;
}

int store_job_document(struct store *store, const char *id, char **ret, size_t *ret_bytes,
                       struct problem *reterr)
{
    char name[NAME_SIZE];
    document_name(id, name);
    if (files_read(store->jobs, name, ret, ret_bytes) != 0)
        return store_fail_file(store, "give the job back", reterr);
    return 0;
}

struct removal {
    const char *owner, *id;
    int64_t now_ms;
};

static int run_removal(struct db *db, void *data)
{
    const struct removal *removal = data;
    int result = store_row_remove(db, removal->owner, removal->id, removal->now_ms);
    return result == 0 ? db_run(db, SQL_GONE_TRIM) : result;
}

int store_row_remove(struct db *db, const char *owner, const char *id, int64_t now_ms)
{
    db_bind(db, SQL_JOB_REMOVE, "t", id);
    if (db_run(db, SQL_JOB_REMOVE) != 0)
        return -1;
    if (db_changes(db) == 0)
        return STORE_NONE;
    db_bind(db, SQL_GONE_ADD, "tit", id, now_ms, owner);
    return db_run(db, SQL_GONE_ADD);
}

void store_files_remove(struct store *store, const char *id, uint32_t attempt)
{
    char name[NAME_SIZE];
    document_name(id, name);
    files_remove(store->jobs, name);
    results_name(id, attempt, "", name);
    files_remove(store->results, name);
}

int store_job_remove(struct store *store, const char *owner, const char *id, int64_t now_ms,
                     struct problem *reterr)
{
    struct removal removal = {owner, id, now_ms};
    struct job job;
    int result = store_job_get(store, owner, id, &job, reterr);
    if (result != 0)
        return result;
    result = db_transact(store->db, DB_FREES, "remove the job", run_removal, &removal, reterr);
    if (result == 0)
        store_files_remove(store, id, job.revision.attempt);
    job_done(&job);
    return result;
}

int store_job_list(struct store *store, const struct store_filter *filter, store_job_fn *each, void *data,
                   int64_t *ret_last, bool *ret_more, struct problem *reterr)
{
    struct job *job;
    int64_t *seq;
    size_t count;
    const char *status = filter->status < 0 ? NULL : job_status_name((enum job_status)filter->status);
    db_lock(store->db);
    db_bind(store->db, SQL_JOB_LIST, "itttiti", filter->before, status, filter->label_name,
            filter->label_value, (int64_t)filter->limit + 1, /* one more tells whether there are more */
            filter->owner, filter->created_after_ms);
    int failed = read_jobs(store->db, SQL_JOB_LIST, &job, &seq, &count);
    if (failed)
        db_fail(store->db, "list the jobs", reterr);
    db_unlock(store->db);
    size_t shown = count > filter->limit ? filter->limit : count;
    *ret_more = count > shown;
    *ret_last = 0;
    for (size_t i = 0; !failed && i < shown; i++) {
        *ret_last = seq[i];
        if (each(&job[i], data) != 0)
            failed = problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    }
    free_jobs(job, seq, count);
    return failed ? -1 : 0;
}

/* ---- results ------------------------------------------------------------------------------------ */

int store_results_begin(struct store *store, const char *id, uint32_t attempt, int *ret_dirfd,
                        struct problem *reterr)
{
    char name[NAME_SIZE];
    results_name(id, attempt, ".tmp", name);
    if (files_remove(store->results, name) != 0 || files_make_dir(store->results, name, ret_dirfd) != 0)
        return store_fail_file(store, "make a result folder", reterr);
    return 0;
}

void store_results_drop(struct store *store, const char *id, uint32_t attempt)
{
    char name[NAME_SIZE];
    results_name(id, attempt, ".tmp", name);
    if (files_remove(store->results, name) != 0)
        store_fail_file(store, "drop a result folder", NULL);
}

int store_open_file(struct store *store, int dirfd, const char *path, const char *what, int *ret_fd,
                    uint64_t *ret_bytes, struct problem *reterr)
{
    struct stat st;
    int fd = openat(dirfd, path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return errno == ENOENT ? STORE_NONE : store_fail_file(store, what, reterr);
    if (fstat(fd, &st) != 0) {
        int failed = store_fail_file(store, what, reterr);
        close(fd);
        return failed;
    }
    *ret_fd = fd;
    *ret_bytes = (uint64_t)st.st_size;
    return 0;
}

int store_result_open(struct store *store, const char *id, uint32_t attempt, const char *file, int *ret_fd,
                      uint64_t *ret_bytes, struct problem *reterr)
{
    char folder[NAME_SIZE], path[NAME_SIZE + 32];
    results_name(id, attempt, "", folder);
    snprintf(path, sizeof path, "%s/%s", folder, file);
    return store_open_file(store, store->results, path, "open the result", ret_fd, ret_bytes, reterr);
}

/* ---- starts ------------------------------------------------------------------------------------- */

/* Gives an existing file a second name, that of job `id` with `suffix`; 0, or -1 with errno. */
static int link_start(struct store *store, int dirfd, const char *path, const char *id, const char *suffix)
{
    char name[NAME_SIZE];
    start_name(id, suffix, name);
    return linkat(dirfd, path, store->jobs, name, 0);
}

int store_start_keep(struct store *store, const char *owner, const char *id, const char *from,
                     const char *file, struct problem *reterr)
{
    struct job job;
    char document[NAME_SIZE], folder[NAME_SIZE], path[NAME_SIZE + 32];
    int found = store_job_get(store, owner, from, &job, reterr);
    if (found != 0)
        return found;
    enum job_status status = job.status;
    document_name(from, document);
    results_name(from, job.revision.attempt, "", folder);
    snprintf(path, sizeof path, "%s/%s", folder, file);
    job_done(&job);
    if (!job_status_ended(status))
        return STORE_UNFINISHED;
    if (status != JOB_SUCCEEDED)
        return STORE_WITHOUT;
    if (link_start(store, store->jobs, document, id, FROM_SUFFIX) == 0 &&
        link_start(store, store->results, path, id, START_SUFFIX) == 0 && fsync(store->jobs) == 0)
        return 0;
    bool missing = errno == ENOENT;
    int failed = missing ? 0 : store_fail_file(store, "keep the start", reterr);
    store_start_drop(store, id);
    if (!missing)
        return failed;
    found = store_job_get(store, owner, from, &job, reterr); /* it may just have been removed */
    if (found == 0)
        job_done(&job);
    return found == 0 ? STORE_WITHOUT : found;
}

void store_start_drop(struct store *store, const char *id)
{
    static const char *const suffix[] = {FROM_SUFFIX, START_SUFFIX};
    for (size_t i = 0; i < sizeof suffix / sizeof *suffix; i++) {
        char name[NAME_SIZE];
        start_name(id, suffix[i], name);
        files_remove(store->jobs, name); /* else it goes at the next start */
    }
}

static int read_start(struct store *store, const char *id, const char *suffix, char **ret, size_t *ret_bytes,
                      struct problem *reterr)
{
    char name[NAME_SIZE];
    start_name(id, suffix, name);
    if (files_read(store->jobs, name, ret, ret_bytes) != 0)
        return store_fail_file(store, "give the start back", reterr);
    return 0;
}

int store_start_document(struct store *store, const char *id, char **ret, size_t *ret_bytes,
                         struct problem *reterr)
{
    return read_start(store, id, FROM_SUFFIX, ret, ret_bytes, reterr);
}

int store_start_drape(struct store *store, const char *id, char **ret, size_t *ret_bytes,
                      struct problem *reterr)
{
    return read_start(store, id, START_SUFFIX, ret, ret_bytes, reterr);
}
