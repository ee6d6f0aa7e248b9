/* store.c - SQLite for the rows, plain files for the rest; see store.h for what is where and when.
 *
 * One connection does all writes and all checkpoints and keeps others out (locking_mode EXCLUSIVE):
 * SQLite before 3.51.3 can corrupt a WAL that two connections reset at once. synchronous=FULL, since
 * an acknowledged job must outlive a power cut. */
#include "store.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <sqlite3.h>

#include "clock.h"
#include "files.h"
#include "jsonout.h"
#include "log.h"
#include "metrics.h"

#define SCHEMA_VERSION 3

/* Ids of removed jobs that are remembered, so that they answer 410 and not 404; about 10 MB. */
#define MAX_GONE "100000"

#define JOB_COLUMNS                                                                                          \
    "seq,id,status,verdict,attempt,counter,crashes,cancel,created_ms,started_ms,finished_ms,"                \
    "name,labels,progress,report,error,warnings,owner,priority,memory"

enum statement {
    SQL_BEGIN = 0,
    SQL_COMMIT,
    SQL_ROLLBACK,
    SQL_JOB_ADD,
    SQL_JOB_START,
    SQL_JOB_CANCEL_QUEUED,
    SQL_JOB_CANCEL_RUNNING,
    SQL_JOB_REQUEUE,
    SQL_JOB_FINISH,
    SQL_JOB_GET,
    SQL_JOB_LIST,
    SQL_JOB_REMOVE,
    SQL_GONE_ADD,
    SQL_GONE_TRIM,
    SQL_GONE_GET,
    SQL_RECOVER_CANCELED,
    SQL_RECOVER_FAILED,
    SQL_RECOVER_QUEUED,
    SQL_QUEUED,
    SQL_MESH_ADD,
    SQL_MESH_GET,
    SQL_MESH_KNOWN,
    SQL_MESH_BYTES,
    SQL_JOB_KNOWN,
    STATEMENTS
};

#define ENDED "status IN ('succeeded','failed','canceled')"

#define INDICES                                                                                              \
    "CREATE INDEX job_owner ON job(owner, seq);"                                                             \
    "CREATE INDEX job_ended ON job(finished_ms, bytes) WHERE " ENDED ";"                                     \
    "CREATE INDEX mesh_sha256 ON mesh(sha256);"                                                              \
    "CREATE INDEX mesh_touched ON mesh(touched_ms);"                                                         \
    "CREATE INDEX job_mesh_sha256 ON job_mesh(sha256);"                                                      \
    "CREATE INDEX idempotency_at ON idempotency(at_ms);"

/* touched_ms: when it was last uploaded or named by a new job. */
#define MESH_TABLE                                                                                           \
    "CREATE TABLE mesh(owner TEXT NOT NULL, sha256 TEXT NOT NULL, format INTEGER NOT NULL,"                  \
    " bytes INTEGER NOT NULL, vertices INTEGER NOT NULL, triangles INTEGER NOT NULL,"                        \
    " created_ms INTEGER NOT NULL, touched_ms INTEGER NOT NULL, PRIMARY KEY(owner, sha256)) WITHOUT ROWID;"

/* The meshes that a job needs, all of its owner's; '*': any, for a job from before this was noted. */
#define JOB_MESH_TABLE                                                                                       \
    "CREATE TABLE job_mesh(job INTEGER NOT NULL REFERENCES job(seq) ON DELETE CASCADE, sha256 TEXT NOT "     \
    "NULL, PRIMARY KEY(job, sha256)) WITHOUT ROWID;"

/* What was answered to a request with an Idempotency-Key; body: SHA-256 of the request's. */
#define IDEMPOTENCY_TABLE                                                                                    \
    "CREATE TABLE idempotency(owner TEXT NOT NULL, route TEXT NOT NULL, key TEXT NOT NULL,"                  \
    " body TEXT NOT NULL, job TEXT NOT NULL, answer TEXT NOT NULL, at_ms INTEGER NOT NULL,"                  \
    " PRIMARY KEY(owner, route, key)) WITHOUT ROWID;"

static const char create_sql[] =
    "CREATE TABLE job(seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE,"
    " status TEXT NOT NULL, verdict TEXT NOT NULL, attempt INTEGER NOT NULL, counter INTEGER NOT NULL,"
    " crashes INTEGER NOT NULL, cancel INTEGER NOT NULL, created_ms INTEGER NOT NULL,"
    " started_ms INTEGER NOT NULL, finished_ms INTEGER NOT NULL, name TEXT, labels TEXT, progress TEXT,"
    " report TEXT, error TEXT, warnings TEXT, owner TEXT NOT NULL, priority INTEGER NOT NULL,"
    " memory INTEGER NOT NULL, bytes INTEGER NOT NULL);"
    "CREATE INDEX job_status ON job(status, seq);"
    "CREATE TABLE gone(seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE,"
    " at_ms INTEGER NOT NULL, owner TEXT NOT NULL);" MESH_TABLE JOB_MESH_TABLE IDEMPOTENCY_TABLE INDICES
    "PRAGMA user_version=3;";

/* What the version before lacks, by that version. A mesh of version 2 counts as just touched: which jobs
 * name it is not known, but for those that have not ended, which hold them all. */
static const char *const upgrade_sql[SCHEMA_VERSION] = {
    [1] = "ALTER TABLE job ADD COLUMN warnings TEXT; PRAGMA user_version=2;",
    [2] =
        "ALTER TABLE job ADD COLUMN owner TEXT NOT NULL DEFAULT '';"
        "ALTER TABLE job ADD COLUMN priority INTEGER NOT NULL DEFAULT 0;"
        "ALTER TABLE job ADD COLUMN memory INTEGER NOT NULL DEFAULT 0;"
        "ALTER TABLE job ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0;"
        "ALTER TABLE gone ADD COLUMN owner TEXT NOT NULL DEFAULT '';"
        "ALTER TABLE mesh RENAME TO mesh_2;" MESH_TABLE JOB_MESH_TABLE IDEMPOTENCY_TABLE
        "INSERT INTO mesh SELECT '',sha256,format,bytes,vertices,triangles,created_ms,1000*unixepoch()"
        " FROM mesh_2;"
        "DROP TABLE mesh_2;"
        "INSERT INTO job_mesh SELECT seq,'*' FROM job WHERE NOT " ENDED ";" INDICES "PRAGMA user_version=3;",
};

/* Parameters are numbered as bind_job gives them: id 1, attempt 2, counter 3, status 4, verdict 5,
 * started 6, finished 7, progress 8, report 9, error 10, crashes 11, cancel 12, created 13, name 14,
 * labels 15, warnings 16, owner 17, priority 18, memory 19. */
static const char *const sql_text[STATEMENTS] = {
    [SQL_BEGIN] = "BEGIN IMMEDIATE",
    [SQL_COMMIT] = "COMMIT",
    [SQL_ROLLBACK] = "ROLLBACK",
    [SQL_JOB_ADD] = "INSERT INTO job(id,status,verdict,attempt,counter,crashes,cancel,created_ms,started_ms,"
                    "finished_ms,name,labels,progress,report,error,warnings,owner,priority,memory,bytes)"
                    " VALUES(?1,?4,?5,?2,?3,?11,?12,?13,?6,?7,?14,?15,?8,?9,?10,?16,?17,?18,?19,0)",
    [SQL_JOB_START] = "UPDATE job SET status='running',counter=?3,started_ms=?6"
                      " WHERE id=?1 AND status='queued' AND attempt=?2",
    [SQL_JOB_CANCEL_QUEUED] = "UPDATE job SET status='canceled',counter=?3,finished_ms=?7,cancel=1"
                              " WHERE id=?1 AND status='queued' AND attempt=?2",
    [SQL_JOB_CANCEL_RUNNING] = "UPDATE job SET cancel=1 WHERE id=?1 AND status='running' AND attempt=?2",
    [SQL_JOB_REQUEUE] = "UPDATE job SET status='queued',attempt=?2+1,counter=1,started_ms=0,progress=NULL"
                        " WHERE id=?1 AND status='running' AND attempt=?2",
    [SQL_JOB_FINISH] = "UPDATE job SET status=?4,verdict=?5,counter=?3,finished_ms=?7,progress=?8,report=?9,"
                       "error=?10 WHERE id=?1 AND status='running' AND attempt=?2",
    [SQL_JOB_GET] = "SELECT " JOB_COLUMNS " FROM job WHERE id=?1 AND owner=?2",
    [SQL_JOB_LIST] = "SELECT " JOB_COLUMNS " FROM job WHERE owner=?6 AND seq<?1 AND (?2 IS NULL OR status=?2)"
                     " AND (?3 IS NULL OR EXISTS(SELECT 1 FROM json_each(labels) WHERE key=?3 AND value=?4))"
                     " ORDER BY seq DESC LIMIT ?5",
    [SQL_JOB_REMOVE] = "DELETE FROM job WHERE id=?1 AND " ENDED,
    [SQL_GONE_ADD] = "INSERT INTO gone(id,at_ms,owner) VALUES(?1,?2,?3)",
    [SQL_GONE_TRIM] = "DELETE FROM gone WHERE seq<=(SELECT max(seq) FROM gone)-" MAX_GONE,
    [SQL_GONE_GET] = "SELECT 1 FROM gone WHERE id=?1 AND owner=?2",
    [SQL_RECOVER_CANCELED] = "UPDATE job SET status='canceled',crashes=crashes+1,attempt=attempt+1,counter=1,"
                             "finished_ms=?1 WHERE status='running' AND cancel=1",
    [SQL_RECOVER_FAILED] = "UPDATE job SET status='failed',crashes=crashes+1,attempt=attempt+1,counter=1,"
                           "finished_ms=?1,error=?3 WHERE status='running' AND crashes+1>=?2",
    [SQL_RECOVER_QUEUED] = "UPDATE job SET status='queued',crashes=crashes+1,attempt=attempt+1,counter=1,"
                           "started_ms=0,progress=NULL WHERE status='running'",
    [SQL_QUEUED] = "SELECT " JOB_COLUMNS " FROM job WHERE status='queued' ORDER BY seq",
    [SQL_MESH_ADD] = "INSERT OR IGNORE INTO mesh VALUES(?1,?2,?3,?4,?5,?6,?7,?7)",
    [SQL_MESH_GET] = "SELECT format,bytes,vertices,triangles FROM mesh WHERE owner=?1 AND sha256=?2",
    [SQL_MESH_KNOWN] = "SELECT 1 FROM mesh WHERE sha256=?1",
    [SQL_MESH_BYTES] = "SELECT coalesce(sum(bytes),0) FROM mesh WHERE owner=?1",
    [SQL_JOB_KNOWN] = "SELECT attempt,status FROM job WHERE id=?1",
};

struct store {
    pthread_mutex_t lock; /* the connection and its statements */
    sqlite3 *db;
    sqlite3_stmt *statement[STATEMENTS];
    struct metrics *metrics;
    int dir, jobs, results, meshes; /* open folders */
    int lock_file;
};

/* ---- errors ----------------------------------------------------------------------------------- */

static int fail_file(struct store *store, const char *what, struct problem *reterr)
{
    int error = errno;
    metrics_add(store->metrics, METRIC_STORE_ERRORS, 1);
    log_event(LOG_LEVEL_ERROR, "store.file", "what=%s errno=%d error=\"%s\"", what, error, strerror(error));
    return problem_set(reterr, PROBLEM_STORAGE, "The data folder refused to %s: %s.", what, strerror(error));
}

static int fail_db(struct store *store, const char *what, struct problem *reterr)
{
    int code = store->db == NULL ? SQLITE_NOMEM : sqlite3_extended_errcode(store->db);
    const char *message = store->db == NULL ? "out of memory" : sqlite3_errmsg(store->db);
    metrics_add(store->metrics, METRIC_STORE_ERRORS, 1);
    log_event(LOG_LEVEL_ERROR, "store.database", "what=%s code=%d error=\"%s\"", what, code, message);
    return problem_set(reterr, PROBLEM_STORAGE, "The database refused to %s: %s.", what, message);
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

/* ---- statements; all under the lock ------------------------------------------------------------- */

/* Steps once and resets: SQLITE_DONE or an error, never a row. */
static int run(struct store *store, enum statement which)
{
    sqlite3_stmt *s = store->statement[which];
    int code = sqlite3_step(s);
    sqlite3_reset(s);
    return code == SQLITE_DONE || code == SQLITE_ROW ? 0 : -1;
}

static void bind_text(sqlite3_stmt *s, int index, const char *text)
{
    if (text == NULL)
        sqlite3_bind_null(s, index);
    else
        sqlite3_bind_text(s, index, text, -1, SQLITE_STATIC);
}

static void bind_job(sqlite3_stmt *s, const struct job *job)
{
    const char *text[] = {job->progress, job->report, job->error};
    int count = sqlite3_bind_parameter_count(s);
    bind_text(s, 1, job->id);
    sqlite3_bind_int64(s, 2, job->revision.attempt);
    sqlite3_bind_int64(s, 3, job->revision.counter);
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
    if (count < 19)
        return;
    sqlite3_bind_int64(s, 11, job->crashes);
    sqlite3_bind_int64(s, 12, job->cancel);
    sqlite3_bind_int64(s, 13, job->created_ms);
    bind_text(s, 14, job->name);
    bind_text(s, 15, job->labels);
    bind_text(s, 16, job->warnings);
    bind_text(s, 17, job->owner);
    sqlite3_bind_int(s, 18, job->priority);
    sqlite3_bind_int64(s, 19, (int64_t)job->memory);
}

/* Begins a transaction; 0 or -1. */
static int begin(struct store *store, int64_t *ret_started)
{
    *ret_started = clock_monotonic_ms();
    return run(store, SQL_BEGIN);
}

/* Commits, or rolls back when `ok` is false or the commit fails; 0 when committed. */
static int end(struct store *store, bool ok, int64_t started)
{
    ok = ok && run(store, SQL_COMMIT) == 0;
    if (!ok && !sqlite3_get_autocommit(store->db))
        run(store, SQL_ROLLBACK);
    metrics_observe(store->metrics, METRIC_COMMIT_SECONDS, (double)(clock_monotonic_ms() - started) / 1000);
    return ok ? 0 : -1;
}

/* One statement on one job in a transaction of its own: 0, STORE_NONE when no row matched, or -1. */
static int write_job(struct store *store, enum statement which, const struct job *job, const char *what,
                     struct problem *reterr)
{
    int64_t started;
    int result = 0;
    pthread_mutex_lock(&store->lock);
    if (begin(store, &started) != 0) {
        result = fail_db(store, what, reterr);
        goto cleanup;
    }
    bind_job(store->statement[which], job);
    bool ok = run(store, which) == 0;
    int changes = sqlite3_changes(store->db);
    if (!ok)
        result = fail_db(store, what, reterr); /* before the rollback clears the message */
    if (end(store, ok, started) != 0 && ok)
        result = fail_db(store, what, reterr);
    if (result == 0 && changes == 0)
        result = STORE_NONE;

cleanup:
    pthread_mutex_unlock(&store->lock);
    return result;
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
    int number = status == NULL ? -1 : job_status_from_name(status);
    if (id == NULL || verdict == NULL || owner == NULL || number < 0)
        return -1;
    snprintf(job.id, sizeof job.id, "%s", id);
    snprintf(job.verdict, sizeof job.verdict, "%s", verdict);
    snprintf(job.owner, sizeof job.owner, "%s", owner);
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

/* Reads up to `limit` rows of a bound statement into fresh memory. -1: the database or memory failed. */
static int read_jobs(struct store *store, enum statement which, size_t limit, struct job **ret,
                     int64_t **ret_seq, size_t *ret_count)
{
    sqlite3_stmt *s = store->statement[which];
    struct job *job = NULL;
    int64_t *seq = NULL;
    size_t count = 0, room = 0;
    int code;
    while ((code = count < limit ? sqlite3_step(s) : SQLITE_DONE) == SQLITE_ROW) {
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
    sqlite3_reset(s);
    *ret = job;
    *ret_seq = seq;
    *ret_count = count;
    return code == SQLITE_DONE ? 0 : -1;
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
        return fail_file(store, "open it", reterr);
    store->lock_file = openat(store->dir, "draped.lock", O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (store->lock_file < 0)
        return fail_file(store, "make its lock file", reterr);
    if (flock(store->lock_file, LOCK_EX | LOCK_NB) != 0)
        return problem_set(reterr, PROBLEM_STORAGE, "The data folder is in use by another daemon.");
    if (files_make_dir(store->dir, "jobs", &store->jobs) != 0 ||
        files_make_dir(store->dir, "results", &store->results) != 0 ||
        files_make_dir(store->dir, "meshes", &store->meshes) != 0 || fsync(store->dir) != 0)
        return fail_file(store, "make its folders", reterr);
    return 0;
}

static int schema_version(sqlite3 *db)
{
    sqlite3_stmt *s = NULL;
    int version = -1;
    if (sqlite3_prepare_v2(db, "PRAGMA user_version", -1, &s, NULL) == SQLITE_OK &&
        sqlite3_step(s) == SQLITE_ROW)
        version = sqlite3_column_int(s, 0);
    sqlite3_finalize(s);
    return version;
}

static int create_tables(struct store *store, struct problem *reterr)
{
    int version = schema_version(store->db);
    if (version < 0 || version > SCHEMA_VERSION)
        return problem_set(reterr, PROBLEM_STORAGE, "The data folder was written by another version (%d).",
                           version);
    if (version == SCHEMA_VERSION)
        return 0;
    bool ok = sqlite3_exec(store->db, "BEGIN IMMEDIATE", NULL, NULL, NULL) == SQLITE_OK;
    if (version == 0)
        ok = ok && sqlite3_exec(store->db, create_sql, NULL, NULL, NULL) == SQLITE_OK;
    else
        for (int v = version; v < SCHEMA_VERSION; v++)
            ok = ok && sqlite3_exec(store->db, upgrade_sql[v], NULL, NULL, NULL) == SQLITE_OK;
    if (!ok || sqlite3_exec(store->db, "COMMIT", NULL, NULL, NULL) != SQLITE_OK)
        return fail_db(store, "make its tables", reterr);
    return 0;
}

static int open_database(struct store *store, const char *dir, struct problem *reterr)
{
    char path[4096];
    if (snprintf(path, sizeof path, "%s/draped.db", dir) >= (int)sizeof path)
        return problem_set(reterr, PROBLEM_STORAGE, "The data folder's name is too long.");
    /* NOMUTEX: our lock serialises all use of the connection. */
    int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
    if (sqlite3_open_v2(path, &store->db, flags, NULL) != SQLITE_OK)
        return fail_db(store, "open", reterr);
    sqlite3_busy_timeout(store->db, 2000);
    if (sqlite3_exec(store->db,
                     "PRAGMA locking_mode=EXCLUSIVE; PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL;"
                     "PRAGMA foreign_keys=ON; PRAGMA trusted_schema=OFF;",
                     NULL, NULL, NULL) != SQLITE_OK)
        return fail_db(store, "set its modes", reterr);
    if (create_tables(store, reterr) != 0)
        return -1;
    for (int i = 0; i < STATEMENTS; i++)
        if (sqlite3_prepare_v3(store->db, sql_text[i], -1, SQLITE_PREPARE_PERSISTENT, &store->statement[i],
                               NULL) != SQLITE_OK)
            return fail_db(store, "prepare its statements", reterr);
    return 0;
}

int store_open(const char *dir, struct metrics *metrics, struct store **ret, struct problem *reterr)
{
    struct store *store = calloc(1, sizeof *store);
    if (store == NULL)
        return problem_set(reterr, PROBLEM_STORAGE, "Out of memory.");
    store->dir = store->jobs = store->results = store->meshes = store->lock_file = -1;
    store->metrics = metrics;
    pthread_mutex_init(&store->lock, NULL);
    if (open_folders(store, dir, reterr) != 0 || open_database(store, dir, reterr) != 0) {
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
    for (int i = 0; i < STATEMENTS; i++)
        sqlite3_finalize(store->statement[i]);
    sqlite3_close(store->db); /* checkpoints the WAL */
    int fd[] = {store->jobs, store->results, store->meshes, store->dir, store->lock_file};
    for (size_t i = 0; i < sizeof fd / sizeof *fd; i++)
        if (fd[i] >= 0)
            close(fd[i]);
    pthread_mutex_destroy(&store->lock);
    free(store);
    return NULL;
}

/* ---- recovery ------------------------------------------------------------------------------------- */

static char *crash_error(void)
{
    struct problem problem;
    problem_set(&problem, PROBLEM_WORKER_CRASH, "The daemon died each time it ran this job.");
    json_t *json = problem_json(&problem, NULL, NULL);
    return jsonout_text(json);
}

static int recover_rows(struct store *store, unsigned max_crashes, int64_t now_ms, struct problem *reterr)
{
    char *error = crash_error();
    if (error == NULL)
        return problem_set(reterr, PROBLEM_STORAGE, "Out of memory.");
    int64_t started;
    int result = 0;
    pthread_mutex_lock(&store->lock);
    sqlite3_bind_int64(store->statement[SQL_RECOVER_CANCELED], 1, now_ms);
    sqlite3_bind_int64(store->statement[SQL_RECOVER_FAILED], 1, now_ms);
    sqlite3_bind_int64(store->statement[SQL_RECOVER_FAILED], 2, max_crashes);
    bind_text(store->statement[SQL_RECOVER_FAILED], 3, error);
    bool ok = begin(store, &started) == 0 && run(store, SQL_RECOVER_CANCELED) == 0 &&
              run(store, SQL_RECOVER_FAILED) == 0 && run(store, SQL_RECOVER_QUEUED) == 0;
    if (!ok)
        result = fail_db(store, "recover", reterr);
    if (end(store, ok, started) != 0 && ok)
        result = fail_db(store, "recover", reterr);
    sqlite3_clear_bindings(store->statement[SQL_RECOVER_FAILED]);
    pthread_mutex_unlock(&store->lock);
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
    pthread_mutex_lock(&store->lock);
    sqlite3_stmt *s = store->statement[SQL_JOB_KNOWN];
    bind_text(s, 1, id);
    int code = sqlite3_step(s);
    if (code == SQLITE_ROW) {
        *ret_attempt = (uint32_t)sqlite3_column_int64(s, 0);
        *ret_status = (enum job_status)job_status_from_name((const char *)sqlite3_column_text(s, 1));
    }
    sqlite3_reset(s);
    pthread_mutex_unlock(&store->lock);
    return code == SQLITE_ROW ? 0 : code == SQLITE_DONE ? STORE_NONE : -1;
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

static bool mesh_wanted(struct store *store, const char *name)
{
    pthread_mutex_lock(&store->lock);
    bind_text(store->statement[SQL_MESH_KNOWN], 1, name);
    int code = sqlite3_step(store->statement[SQL_MESH_KNOWN]);
    sqlite3_reset(store->statement[SQL_MESH_KNOWN]);
    pthread_mutex_unlock(&store->lock);
    return code != SQLITE_DONE;
}

static void sweep_orphans(struct store *store)
{
    struct sweep sweep[] = {
        {store, store->jobs, document_wanted, 0},
        {store, store->results, result_wanted, 0},
        {store, store->meshes, mesh_wanted, 0},
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
    pthread_mutex_lock(&store->lock);
    int failed = read_jobs(store, SQL_QUEUED, SIZE_MAX, &job, &seq, &count);
    pthread_mutex_unlock(&store->lock);
    for (size_t i = 0; !failed && i < count; i++)
        failed = each(&job[i], data);
    free_jobs(job, seq, count);
    return failed ? problem_set(reterr, PROBLEM_STORAGE, "The queued jobs could not be read.") : 0;
}

int store_ask(struct store *store, struct problem *reterr)
{
    pthread_mutex_lock(&store->lock);
    int code = sqlite3_exec(store->db, "SELECT 1 FROM sqlite_schema LIMIT 1", NULL, NULL, NULL);
    int result = code == SQLITE_OK ? 0 : fail_db(store, "answer", reterr);
    pthread_mutex_unlock(&store->lock);
    return result;
}

/* ---- jobs --------------------------------------------------------------------------------------- */

int store_job_add(struct store *store, const struct job *job, const void *document, size_t bytes,
                  struct problem *reterr)
{
    char name[NAME_SIZE];
    document_name(job->id, name);
    if (files_write_durably(store->jobs, name, document, bytes) != 0) {
        int failed = fail_file(store, "keep the job", reterr);
        store_start_drop(store, job->id);
        return failed;
    }
    int result = write_job(store, SQL_JOB_ADD, job, "add the job", reterr);
    if (result != 0) {
        files_remove(store->jobs, name);
        store_start_drop(store, job->id);
    }
    return result;
}

int store_job_start(struct store *store, const struct job *job, struct problem *reterr)
{
    return write_job(store, SQL_JOB_START, job, "start the job", reterr);
}

int store_job_cancel_queued(struct store *store, const struct job *job, struct problem *reterr)
{
    int result = write_job(store, SQL_JOB_CANCEL_QUEUED, job, "cancel the job", reterr);
    if (result == 0)
        store_start_drop(store, job->id);
    return result;
}

int store_job_cancel_running(struct store *store, const struct job *job, struct problem *reterr)
{
    return write_job(store, SQL_JOB_CANCEL_RUNNING, job, "cancel the job", reterr);
}

int store_job_requeue(struct store *store, const struct job *job, struct problem *reterr)
{
    store_results_drop(store, job->id, job->revision.attempt);
    return write_job(store, SQL_JOB_REQUEUE, job, "requeue the job", reterr);
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
        return fail_file(store, "publish the result", reterr);
    int result = write_job(store, SQL_JOB_FINISH, job, "finish the job", reterr);
    if (publish && result == STORE_NONE)
        files_remove(store->results, name);
    if (result == 0)
        store_start_drop(store, job->id);
    return result;
}

int store_job_get(struct store *store, const char *owner, const char *id, struct job *ret,
                  struct problem *reterr)
{
    int result;
    int64_t seq;
    pthread_mutex_lock(&store->lock);
    sqlite3_stmt *s = store->statement[SQL_JOB_GET];
    bind_text(s, 1, id);
    bind_text(s, 2, owner);
    int code = sqlite3_step(s);
    if (code == SQLITE_ROW)
        result = read_job(s, ret, &seq) == 0 ? 0 : fail_db(store, "read the job", reterr);
    else
        result = code == SQLITE_DONE ? STORE_NONE : fail_db(store, "read the job", reterr);
    sqlite3_reset(s);
    if (result == STORE_NONE) {
        bind_text(store->statement[SQL_GONE_GET], 1, id);
        bind_text(store->statement[SQL_GONE_GET], 2, owner);
        if (sqlite3_step(store->statement[SQL_GONE_GET]) == SQLITE_ROW)
            result = STORE_GONE;
        sqlite3_reset(store->statement[SQL_GONE_GET]);
    }
    pthread_mutex_unlock(&store->lock);
    return result;
}

int store_job_document(struct store *store, const char *id, char **ret, size_t *ret_bytes,
                       struct problem *reterr)
{
    char name[NAME_SIZE];
    document_name(id, name);
    if (files_read(store->jobs, name, ret, ret_bytes) != 0)
        return fail_file(store, "give the job back", reterr);
    return 0;
}

/* The rows' part of a removal, in one transaction; *ret_changes tells whether there was one to remove. */
static int remove_row(struct store *store, const char *owner, const char *id, int64_t now_ms,
                      int *ret_changes, struct problem *reterr)
{
    int64_t started;
    int result = 0;
    pthread_mutex_lock(&store->lock);
    bind_text(store->statement[SQL_JOB_REMOVE], 1, id);
    bind_text(store->statement[SQL_GONE_ADD], 1, id);
    sqlite3_bind_int64(store->statement[SQL_GONE_ADD], 2, now_ms);
    bind_text(store->statement[SQL_GONE_ADD], 3, owner);
    bool ok = begin(store, &started) == 0 && run(store, SQL_JOB_REMOVE) == 0;
    *ret_changes = ok ? sqlite3_changes(store->db) : 0;
    if (*ret_changes > 0)
        ok = run(store, SQL_GONE_ADD) == 0 && run(store, SQL_GONE_TRIM) == 0;
    if (!ok)
        result = fail_db(store, "remove the job", reterr);
    if (end(store, ok, started) != 0 && ok)
        result = fail_db(store, "remove the job", reterr);
    pthread_mutex_unlock(&store->lock);
    return result;
}

int store_job_remove(struct store *store, const char *owner, const char *id, int64_t now_ms,
                     struct problem *reterr)
{
    char name[NAME_SIZE];
    struct job job;
    int changes;
    int result = store_job_get(store, owner, id, &job, reterr);
    if (result != 0)
        return result;
    result = remove_row(store, owner, id, now_ms, &changes, reterr);
    if (result == 0 && changes == 0)
        result = STORE_NONE;
    if (result == 0) {
        /* Row first: should these fail, they are orphans and go at the next start. */
        document_name(id, name);
        files_remove(store->jobs, name);
        results_name(id, job.revision.attempt, "", name);
        files_remove(store->results, name);
    }
    job_done(&job);
    return result;
}

int store_job_list(struct store *store, const struct store_filter *filter, store_job_fn *each, void *data,
                   int64_t *ret_last, bool *ret_more, struct problem *reterr)
{
    struct job *job;
    int64_t *seq;
    size_t count;
    pthread_mutex_lock(&store->lock);
    sqlite3_stmt *s = store->statement[SQL_JOB_LIST];
    sqlite3_bind_int64(s, 1, filter->before);
    bind_text(s, 2, filter->status < 0 ? NULL : job_status_name((enum job_status)filter->status));
    bind_text(s, 3, filter->label_name);
    bind_text(s, 4, filter->label_value);
    sqlite3_bind_int64(s, 5, (int64_t)filter->limit + 1); /* one more tells whether there are more */
    bind_text(s, 6, filter->owner);
    int failed = read_jobs(store, SQL_JOB_LIST, SIZE_MAX, &job, &seq, &count);
    if (failed)
        fail_db(store, "list the jobs", reterr);
    sqlite3_clear_bindings(s);
    pthread_mutex_unlock(&store->lock);
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
        return fail_file(store, "make a result folder", reterr);
    return 0;
}

void store_results_drop(struct store *store, const char *id, uint32_t attempt)
{
    char name[NAME_SIZE];
    results_name(id, attempt, ".tmp", name);
    if (files_remove(store->results, name) != 0)
        fail_file(store, "drop a result folder", NULL);
}

int store_result_open(struct store *store, const char *id, uint32_t attempt, const char *file, int *ret_fd,
                      uint64_t *ret_bytes, struct problem *reterr)
{
    char folder[NAME_SIZE], path[NAME_SIZE + 32];
    struct stat st;
    results_name(id, attempt, "", folder);
    snprintf(path, sizeof path, "%s/%s", folder, file);
    int fd = openat(store->results, path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return errno == ENOENT ? STORE_NONE : fail_file(store, "open the result", reterr);
    if (fstat(fd, &st) != 0) {
        int failed = fail_file(store, "open the result", reterr);
        close(fd);
        return failed;
    }
    *ret_fd = fd;
    *ret_bytes = (uint64_t)st.st_size;
    return 0;
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
    int failed = missing ? 0 : fail_file(store, "keep the start", reterr);
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
        return fail_file(store, "give the start back", reterr);
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

/* ---- meshes ------------------------------------------------------------------------------------- */

int store_mesh_add(struct store *store, const char *owner, const struct store_mesh *mesh, const void *data,
                   int64_t now_ms, struct problem *reterr)
{
    if (files_write_durably(store->meshes, mesh->sha256, data, mesh->bytes) != 0)
        return fail_file(store, "keep the mesh", reterr);
    int64_t started;
    int result = 0;
    pthread_mutex_lock(&store->lock);
    sqlite3_stmt *s = store->statement[SQL_MESH_ADD];
    bind_text(s, 1, owner);
    bind_text(s, 2, mesh->sha256);
    sqlite3_bind_int(s, 3, mesh->format);
    sqlite3_bind_int64(s, 4, (int64_t)mesh->bytes);
    sqlite3_bind_int64(s, 5, (int64_t)mesh->vertices);
    sqlite3_bind_int64(s, 6, (int64_t)mesh->triangles);
    sqlite3_bind_int64(s, 7, now_ms);
    bool ok = begin(store, &started) == 0 && run(store, SQL_MESH_ADD) == 0;
    if (!ok)
        result = fail_db(store, "add the mesh", reterr);
    if (end(store, ok, started) != 0 && ok)
        result = fail_db(store, "add the mesh", reterr);
    pthread_mutex_unlock(&store->lock);
    return result;
}

int store_mesh_get(struct store *store, const char *owner, const char *sha256, struct store_mesh *ret,
                   struct problem *reterr)
{
    int result = 0;
    pthread_mutex_lock(&store->lock);
    sqlite3_stmt *s = store->statement[SQL_MESH_GET];
    bind_text(s, 1, owner);
    bind_text(s, 2, sha256);
    int code = sqlite3_step(s);
    if (code == SQLITE_ROW) {
        snprintf(ret->sha256, sizeof ret->sha256, "%s", sha256);
        ret->format = sqlite3_column_int(s, 0);
        ret->bytes = (uint64_t)sqlite3_column_int64(s, 1);
        ret->vertices = (size_t)sqlite3_column_int64(s, 2);
        ret->triangles = (size_t)sqlite3_column_int64(s, 3);
    } else {
        result = code == SQLITE_DONE ? STORE_NONE : fail_db(store, "read the mesh", reterr);
    }
    sqlite3_reset(s);
    pthread_mutex_unlock(&store->lock);
    return result;
}

int store_mesh_bytes(struct store *store, const char *owner, uint64_t *ret, struct problem *reterr)
{
    int result = 0;
    pthread_mutex_lock(&store->lock);
    sqlite3_stmt *s = store->statement[SQL_MESH_BYTES];
    bind_text(s, 1, owner);
    if (sqlite3_step(s) == SQLITE_ROW)
        *ret = (uint64_t)sqlite3_column_int64(s, 0);
    else
        result = fail_db(store, "count the meshes", reterr);
    sqlite3_reset(s);
    pthread_mutex_unlock(&store->lock);
    return result;
}

int store_mesh_open(struct store *store, const char *owner, const char *sha256, struct store_mesh *ret,
                    int *ret_fd, struct problem *reterr)
{
    int found = store_mesh_get(store, owner, sha256, ret, reterr);
    if (found != 0)
        return found;
    int fd = openat(store->meshes, sha256, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return errno == ENOENT ? STORE_NONE : fail_file(store, "open the mesh", reterr);
    *ret_fd = fd;
    return 0;
}
