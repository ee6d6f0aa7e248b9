/* database.c - see database.h. */
#include "database.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "clock.h"
#include "log.h"
#include "metrics.h"

#define SCHEMA_VERSION 3

/* Ids of removed jobs that are remembered, so that they answer 410 and not 404; about 10 MB. */
#define MAX_GONE "100000"

/* How much one transaction of the housekeeping takes in hand: some ten milliseconds. */
#define BATCH "500"

struct db {
    pthread_mutex_t lock; /* everything below */
    sqlite3 *connection;
    sqlite3_stmt *statement[STATEMENTS];
    struct metrics *metrics;
    int reserve;            /* the file; -1: not open yet */
    bool spent;             /* its blocks have been given up */
    int error, error_errno; /* of the transaction that failed last, from before its rollback */
    char message[160];
};

/* ---- tables ------------------------------------------------------------------------------------- */

#define ENDED "status IN ('succeeded','failed','canceled')"

#define INDICES                                                                                              \
    "CREATE INDEX job_owner ON job(owner, seq, created_ms, status);"                                         \
    "CREATE INDEX job_ended ON job(finished_ms, seq, bytes) WHERE " ENDED ";"                                \
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
    " memory INTEGER NOT NULL, trace_id TEXT NOT NULL, bytes INTEGER NOT NULL);"
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
        "ALTER TABLE job ADD COLUMN trace_id TEXT NOT NULL DEFAULT '';"
        "ALTER TABLE job ADD COLUMN bytes INTEGER NOT NULL DEFAULT 0;"
        "ALTER TABLE gone ADD COLUMN owner TEXT NOT NULL DEFAULT '';"
        "ALTER TABLE mesh RENAME TO mesh_2;" MESH_TABLE JOB_MESH_TABLE IDEMPOTENCY_TABLE
        "INSERT INTO mesh SELECT '',sha256,format,bytes,vertices,triangles,created_ms,1000*unixepoch()"
        " FROM mesh_2;"
        "DROP TABLE mesh_2;"
        "INSERT INTO job_mesh SELECT seq,'*' FROM job WHERE NOT " ENDED ";" INDICES "PRAGMA user_version=3;",
};

/* ---- statements ---------------------------------------------------------------------------------- */

/* Parameters are numbered as bind_job gives them: id 1, attempt 2, counter 3, status 4, verdict 5,
 * started 6, finished 7, progress 8, report 9, error 10, crashes 11, cancel 12, created 13, name 14,
 * labels 15, warnings 16, owner 17, priority 18, memory 19, trace 20; store.c adds the bytes: 21, and 11 when
 * a job ends. */
static const char *const sql_text[STATEMENTS] = {
    [SQL_BEGIN] = "BEGIN IMMEDIATE",
    [SQL_COMMIT] = "COMMIT",
    [SQL_ROLLBACK] = "ROLLBACK",
    [SQL_ASK] = "SELECT count(*) FROM (SELECT 1 FROM sqlite_schema LIMIT 1)",
    [SQL_JOB_ADD] =
        "INSERT INTO job(id,status,verdict,attempt,counter,crashes,cancel,created_ms,started_ms,"
        "finished_ms,name,labels,progress,report,error,warnings,owner,priority,memory,trace_id,bytes)"
        " VALUES(?1,?4,?5,?2,?3,?11,?12,?13,?6,?7,?14,?15,?8,?9,?10,?16,?17,?18,?19,?20,?21)",
    [SQL_JOB_START] = "UPDATE job SET status='running',counter=?3,started_ms=?6"
                      " WHERE id=?1 AND status='queued' AND attempt=?2",
    [SQL_JOB_CANCEL_QUEUED] = "UPDATE job SET status='canceled',counter=?3,finished_ms=?7,cancel=1"
                              " WHERE id=?1 AND status='queued' AND attempt=?2",
    [SQL_JOB_CANCEL_RUNNING] = "UPDATE job SET cancel=1 WHERE id=?1 AND status='running' AND attempt=?2",
    [SQL_JOB_REQUEUE] = "UPDATE job SET status='queued',attempt=?2+1,counter=1,started_ms=0,progress=NULL"
                        " WHERE id=?1 AND status='running' AND attempt=?2",
    [SQL_JOB_FINISH] = "UPDATE job SET status=?4,verdict=?5,counter=?3,finished_ms=?7,progress=?8,report=?9,"
                       "error=?10,bytes=bytes+?11 WHERE id=?1 AND status='running' AND attempt=?2",
    [SQL_JOB_GET] = "SELECT " JOB_COLUMNS " FROM job WHERE id=?1 AND owner=?2",
    [SQL_JOB_KNOWN] = "SELECT attempt,status FROM job WHERE id=?1",
    [SQL_JOB_LIST] = "SELECT " JOB_COLUMNS
                     " FROM job WHERE owner=?6 AND seq<?1 AND (?2 IS NULL OR status=?2) AND created_ms>?7"
                     " AND (?3 IS NULL OR EXISTS(SELECT 1 FROM json_each(labels) WHERE key=?3 AND value=?4))"
                     " ORDER BY seq DESC LIMIT ?5",
    [SQL_JOB_REMOVE] = "DELETE FROM job WHERE id=?1 AND " ENDED,
    [SQL_JOB_TOTALS] = "SELECT count(*),coalesce(sum(bytes),0) FROM job INDEXED BY job_ended WHERE " ENDED,
    [SQL_JOB_OLDEST] = "SELECT id,owner,attempt,finished_ms,bytes FROM job INDEXED BY job_ended WHERE " ENDED
                       " ORDER BY finished_ms,seq LIMIT ?1",
    [SQL_GONE_ADD] = "INSERT INTO gone(id,at_ms,owner) VALUES(?1,?2,?3)",
    [SQL_GONE_TRIM] = "DELETE FROM gone WHERE seq<=(SELECT max(seq) FROM gone)-" MAX_GONE,
    [SQL_GONE_FORGET] = "DELETE FROM gone WHERE at_ms<=?1 AND seq IN"
                        " (SELECT seq FROM gone ORDER BY seq LIMIT " BATCH ")",
    [SQL_GONE_GET] = "SELECT 1 FROM gone WHERE id=?1 AND owner=?2",
    [SQL_RECOVER_CANCELED] = "UPDATE job SET status='canceled',crashes=crashes+1,attempt=attempt+1,counter=1,"
                             "finished_ms=?1 WHERE status='running' AND cancel=1",
    [SQL_RECOVER_FAILED] = "UPDATE job SET status='failed',crashes=crashes+1,attempt=attempt+1,counter=1,"
                           "finished_ms=?1,error=?3 WHERE status='running' AND crashes+1>=?2",
    [SQL_RECOVER_QUEUED] = "UPDATE job SET status='queued',crashes=crashes+1,attempt=attempt+1,counter=1,"
                           "started_ms=0,progress=NULL WHERE status='running'",
    [SQL_QUEUED] = "SELECT " JOB_COLUMNS " FROM job WHERE status='queued' ORDER BY seq",
    [SQL_MESH_ADD] =
        "INSERT INTO mesh VALUES(?1,?2,?3,?4,?5,?6,?7,?7) ON CONFLICT DO UPDATE SET touched_ms=?7",
    [SQL_MESH_GET] = "SELECT format,bytes,vertices,triangles FROM mesh WHERE owner=?1 AND sha256=?2",
    [SQL_MESH_KNOWN] = "SELECT 1 FROM mesh WHERE sha256=?1",
    [SQL_MESH_BYTES] = "SELECT coalesce(sum(bytes),0) FROM mesh WHERE owner=?1",
    [SQL_MESH_TOUCH] = "UPDATE mesh SET touched_ms=?3 WHERE owner=?1 AND sha256=?2 AND touched_ms<?3-?4",
    [SQL_MESH_NEEDED] = "SELECT 1 FROM job_mesh JOIN job ON seq=job WHERE sha256 IN (?2,'*') AND owner=?1"
                        " AND NOT " ENDED,
    [SQL_MESH_REMOVE] = "DELETE FROM mesh WHERE owner=?1 AND sha256=?2",
    [SQL_MESH_STALE] =
        "SELECT owner,sha256 FROM mesh WHERE touched_ms<?1 AND NOT EXISTS(SELECT 1 FROM job_mesh"
        " JOIN job ON seq=job WHERE job_mesh.sha256 IN (mesh.sha256,'*')"
        " AND job.owner=mesh.owner) ORDER BY touched_ms LIMIT ?2",
    [SQL_JOB_MESH_ADD] = "INSERT INTO job_mesh SELECT ?1,sha256 FROM mesh WHERE owner=?2 AND sha256=?3",
    [SQL_ANSWER_ADD] = "INSERT INTO idempotency VALUES(?1,?2,?3,?4,?5,?6,?7) ON CONFLICT DO UPDATE SET"
                       " body=excluded.body,job=excluded.job,answer=excluded.answer,at_ms=excluded.at_ms"
                       " WHERE at_ms<=?8",
    [SQL_ANSWER_GET] = "SELECT body,job,answer FROM idempotency WHERE owner=?1 AND route=?2 AND key=?3"
                       " AND at_ms>?4",
    [SQL_ANSWER_FORGET] = "DELETE FROM idempotency WHERE (owner,route,key) IN (SELECT owner,route,key"
                          " FROM idempotency WHERE at_ms<=?1 ORDER BY at_ms LIMIT " BATCH ")",
};

void db_lock(struct db *db)
{
    pthread_mutex_lock(&db->lock);
}

void db_unlock(struct db *db)
{
    pthread_mutex_unlock(&db->lock);
}

sqlite3_stmt *db_bind(struct db *db, enum statement which, const char *types, ...)
{
    sqlite3_stmt *s = db->statement[which];
    va_list args;
    va_start(args, types);
    for (int i = 0; types[i] != '\0'; i++) {
        if (types[i] == 't')
            sqlite3_bind_text(s, i + 1, va_arg(args, const char *), -1, SQLITE_STATIC); /* NULL binds NULL */
        else
            sqlite3_bind_int64(s, i + 1, va_arg(args, int64_t));
    }
    va_end(args);
    return s;
}

int db_row(struct db *db, enum statement which)
{
    int code = sqlite3_step(db->statement[which]);
    return code == SQLITE_ROW ? 1 : code == SQLITE_DONE ? 0 : -1;
}

void db_reset(struct db *db, enum statement which)
{
    sqlite3_reset(db->statement[which]);
}

int db_run(struct db *db, enum statement which)
{
    int code = db_row(db, which);
    db_reset(db, which);
    return code < 0 ? -1 : 0;
}

int64_t db_changes(struct db *db)
{
    return sqlite3_changes(db->connection);
}

int64_t db_last_row(struct db *db)
{
    return sqlite3_last_insert_rowid(db->connection);
}

/* ---- errors ------------------------------------------------------------------------------------- */

/* Keeps the last error: a rollback would clear it. Returns -1. */
static int note_error(struct db *db)
{
    bool open = db->connection != NULL;
    db->error = open ? sqlite3_extended_errcode(db->connection) : SQLITE_NOMEM;
    db->error_errno = open ? sqlite3_system_errno(db->connection) : 0;
    snprintf(db->message, sizeof db->message, "%s",
             open ? sqlite3_errmsg(db->connection) : sqlite3_errstr(SQLITE_NOMEM));
    return -1;
}

static int tell_error(struct db *db, const char *what, struct problem *reterr)
{
    metrics_add(db->metrics, METRIC_STORE_ERRORS, 1);
    log_event(LOG_LEVEL_ERROR, "store.database", "what=%s code=%d error=\"%s\"", what, db->error,
              db->message);
    return problem_set(reterr, PROBLEM_STORAGE, "The database refused to %s: %s.", what, db->message);
}

int db_fail(struct db *db, const char *what, struct problem *reterr)
{
    note_error(db);
    return tell_error(db, what, reterr);
}

/* ---- the reserve -------------------------------------------------------------------------------- */

static bool reserve_is_whole(const struct db *db)
{
    struct stat st;
    return fstat(db->reserve, &st) == 0 && st.st_size >= DB_RESERVE_BYTES;
}

/* Under the lock. Failing that, nothing of it is kept: what there is of room is for removing. */
static bool restore_reserve(struct db *db)
{
    if (!db->spent)
        return true;
    if (posix_fallocate(db->reserve, 0, DB_RESERVE_BYTES) == 0)
        db->spent = false;
    else if (ftruncate(db->reserve, 0) != 0)
        log_event(LOG_LEVEL_WARNING, "store.reserve", "error=\"%s\"", strerror(errno));
    return !db->spent;
}

bool db_restore_reserve(struct db *db)
{
    db_lock(db);
    bool whole = restore_reserve(db);
    db_unlock(db);
    return whole;
}

static int open_reserve(struct db *db, int dirfd, struct problem *reterr)
{
    db->reserve = openat(dirfd, "draped.reserve", O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    if (db->reserve < 0)
        return problem_set(reterr, PROBLEM_STORAGE, "The data folder refused a file: %s.", strerror(errno));
    db->spent = !reserve_is_whole(db);
    if (!restore_reserve(db))
        log_event(LOG_LEVEL_WARNING, "store.reserve", "error=\"no room for %lld bytes\"",
                  (long long)DB_RESERVE_BYTES);
    return 0;
}

/* Whether the transaction that failed wanted room, and there now is more. */
static bool spend_reserve(struct db *db)
{
    bool full = db->error == SQLITE_FULL || db->error_errno == ENOSPC || db->error_errno == EDQUOT;
    if (!full || db->spent || ftruncate(db->reserve, 0) != 0)
        return false;
    db->spent = true;
    log_event(LOG_LEVEL_WARNING, "store.reserve", "spent=%lld", (long long)DB_RESERVE_BYTES);
    return true;
}

/* ---- transactions ------------------------------------------------------------------------------- */

/* The error is noted when it gives -1. */
static int try_once(struct db *db, db_work *work, void *data)
{
    double started = clock_monotonic_s();
    int result = db_run(db, SQL_BEGIN);
    if (result == 0)
        result = work(db, data);
    if (result == 0)
        result = db_run(db, SQL_COMMIT);
    if (result < 0)
        note_error(db);
    if (!sqlite3_get_autocommit(db->connection))
        db_run(db, SQL_ROLLBACK);
    metrics_observe(db->metrics, METRIC_COMMIT_SECONDS, clock_monotonic_s() - started);
    return result;
}

int db_transact(struct db *db, enum db_need need, const char *what, db_work *work, void *data,
                struct problem *reterr)
{
    int result;
    db_lock(db);
    if (need == DB_ADDS && !restore_reserve(db)) {
        result =
            problem_set(reterr, PROBLEM_STORAGE, "The disk is full; what room is left is for removing jobs.");
    } else {
        result = try_once(db, work, data);
        if (result < 0 && need == DB_FREES && spend_reserve(db))
            result = try_once(db, work, data);
        if (result < 0)
            tell_error(db, what, reterr);
    }
    db_unlock(db);
    return result;
}

/* ---- opening ------------------------------------------------------------------------------------ */

/* The one value of a PRAGMA as text; *ret is "" where there is none. */
static void ask(sqlite3 *connection, const char *pragma, char *ret, size_t size)
{
    sqlite3_stmt *s = NULL;
    ret[0] = '\0';
    if (sqlite3_prepare_v2(connection, pragma, -1, &s, NULL) == SQLITE_OK && sqlite3_step(s) == SQLITE_ROW)
        snprintf(ret, size, "%s", (const char *)sqlite3_column_text(s, 0));
    sqlite3_finalize(s);
}

static int check(struct db *db, struct problem *reterr)
{
    char said[160];
    ask(db->connection, "PRAGMA quick_check(1)", said, sizeof said);
    if (strcmp(said, "ok") == 0)
        return 0;
    return said[0] == '\0' ? db_fail(db, "be checked", reterr)
                           : problem_set(reterr, PROBLEM_STORAGE, "The database is damaged: %.100s.", said);
}

static int execute(struct db *db, const char *sql)
{
    return sqlite3_exec(db->connection, sql, NULL, NULL, NULL) == SQLITE_OK ? 0 : -1;
}

static int make_tables(struct db *db, struct problem *reterr)
{
    char text[32];
    ask(db->connection, "PRAGMA user_version", text, sizeof text);
    int version = text[0] == '\0' ? -1 : atoi(text);
    if (version < 0 || version > SCHEMA_VERSION)
        return problem_set(reterr, PROBLEM_STORAGE, "The data folder was written by another version (%d).",
                           version);
    if (version == SCHEMA_VERSION)
        return 0;
    int failed = execute(db, "BEGIN IMMEDIATE");
    if (version == 0 && !failed)
        failed = execute(db, create_sql);
    for (int v = version; v > 0 && v < SCHEMA_VERSION && !failed; v++)
        failed = execute(db, upgrade_sql[v]);
    if (failed || execute(db, "COMMIT") != 0)
        return db_fail(db, "make its tables", reterr);
    return 0;
}

static int connect_to(struct db *db, const char *dir, struct problem *reterr)
{
    char path[4096];
    if (snprintf(path, sizeof path, "%s/draped.db", dir) >= (int)sizeof path)
        return problem_set(reterr, PROBLEM_STORAGE, "The data folder's name is too long.");
    /* NOMUTEX: our lock serialises all use of the connection. */
    int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
    if (sqlite3_open_v2(path, &db->connection, flags, NULL) != SQLITE_OK)
        return db_fail(db, "open", reterr);
    sqlite3_busy_timeout(db->connection, 2000);
    if (execute(db, "PRAGMA locking_mode=EXCLUSIVE; PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL;"
                    "PRAGMA foreign_keys=ON; PRAGMA trusted_schema=OFF;") != 0)
        return db_fail(db, "set its modes", reterr);
    if (check(db, reterr) != 0 || make_tables(db, reterr) != 0)
        return -1;
    for (int i = 0; i < STATEMENTS; i++)
        if (sqlite3_prepare_v3(db->connection, sql_text[i], -1, SQLITE_PREPARE_PERSISTENT, &db->statement[i],
                               NULL) != SQLITE_OK)
            return db_fail(db, "prepare its statements", reterr);
    return 0;
}

int db_open(const char *dir, int dirfd, struct metrics *metrics, struct db **ret, struct problem *reterr)
{
    struct db *db = calloc(1, sizeof *db);
    if (db == NULL)
        return problem_set(reterr, PROBLEM_STORAGE, "Out of memory.");
    db->reserve = -1;
    db->metrics = metrics;
    pthread_mutex_init(&db->lock, NULL);
    if (open_reserve(db, dirfd, reterr) != 0 || connect_to(db, dir, reterr) != 0) {
        db_close(db);
        return -1;
    }
    *ret = db;
    return 0;
}

struct db *db_close(struct db *db)
{
    if (db == NULL)
        return NULL;
    for (int i = 0; i < STATEMENTS; i++)
        sqlite3_finalize(db->statement[i]);
    sqlite3_close(db->connection); /* checkpoints the WAL */
    if (db->reserve >= 0)
        close(db->reserve);
    pthread_mutex_destroy(&db->lock);
    free(db);
    return NULL;
}
