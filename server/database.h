/* database.h - the store's one SQLite connection: its tables, its statements, its transactions.
 *
 * One connection does all writes and all checkpoints and keeps others out (locking_mode EXCLUSIVE): SQLite
 * before 3.51.3 can corrupt a WAL that two connections reset at once. synchronous=FULL, since an
 * acknowledged job must outlive a power cut.
 *
 * Removing needs room too: every change goes into the log first. So a file of DB_RESERVE_BYTES is kept that
 * holds nothing. A transaction that DB_FREES room and finds the disk full gets those blocks and is tried
 * again; until the file is whole again, nothing that DB_ADDS is begun. */
#ifndef DRAPED_DATABASE_H
#define DRAPED_DATABASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <sqlite3.h>

#include "problem.h"

struct db;
struct metrics;

/* Measured with 100 000 jobs: to remove one takes up to 62 kB of log, to prune 64 of them 0.65 MB, and the
 * log, which goes into the tables and starts anew at 4 MB, never had more than 4.7 MB. */
#define DB_RESERVE_BYTES ((off_t)8 << 20)

#define JOB_COLUMNS                                                                                          \
    "seq,id,status,verdict,attempt,counter,crashes,cancel,created_ms,started_ms,finished_ms,"                \
    "name,labels,progress,report,error,warnings,owner,priority,memory,trace_id"

enum statement {
    SQL_BEGIN = 0,
    SQL_COMMIT,
    SQL_ROLLBACK,
    SQL_ASK,
    SQL_JOB_ADD,
    SQL_JOB_START,
    SQL_JOB_CANCEL_QUEUED,
    SQL_JOB_CANCEL_RUNNING,
    SQL_JOB_REQUEUE,
    SQL_JOB_FINISH,
    SQL_JOB_GET,
    SQL_JOB_KNOWN,
    SQL_JOB_LIST,
    SQL_JOB_REMOVE,
    SQL_JOB_TOTALS,
    SQL_JOB_OLDEST,
    SQL_GONE_ADD,
    SQL_GONE_TRIM,
    SQL_GONE_FORGET,
    SQL_GONE_GET,
    SQL_RECOVER_CANCELED,
    SQL_RECOVER_FAILED,
    SQL_RECOVER_QUEUED,
    SQL_QUEUED,
    SQL_MESH_ADD,
    SQL_MESH_GET,
    SQL_MESH_KNOWN,
    SQL_MESH_BYTES,
    SQL_MESH_TOUCH,
    SQL_MESH_NEEDED,
    SQL_MESH_REMOVE,
    SQL_MESH_STALE,
    SQL_JOB_MESH_ADD,
    SQL_ANSWER_ADD,
    SQL_ANSWER_GET,
    SQL_ANSWER_FORGET,
    STATEMENTS
};

/* Opens or makes `dir`/draped.db (dirfd: the same folder), checks that it is sound, brings it up to this
 * version. `metrics` may be NULL. 0, or -1 with *reterr. */
int db_open(const char *dir, int dirfd, struct metrics *metrics, struct db **ret, struct problem *reterr);
struct db *db_close(struct db *db); /* NULL is fine; returns NULL */

/* ---- statements: all under the lock --------------------------------------------------------------- */

void db_lock(struct db *db);
void db_unlock(struct db *db);

/* Binds from the first parameter on, by letter: t text (may be NULL; borrowed), i int64_t. */
sqlite3_stmt *db_bind(struct db *db, enum statement which, const char *types, ...);

int db_row(struct db *db, enum statement which);    /* steps: 1 with a row, 0 at the end, -1 */
void db_reset(struct db *db, enum statement which); /* after db_row */
int db_run(struct db *db, enum statement which);    /* steps once and resets: 0 or -1 */
int64_t db_changes(struct db *db);                  /* rows that the last db_run changed */
int64_t db_last_row(struct db *db);                 /* the number of the row that it added */

/* Logs and counts the last error; -1 with *reterr. */
int db_fail(struct db *db, const char *what, struct problem *reterr);

/* ---- transactions: take the lock ------------------------------------------------------------------ */

enum db_need { DB_ADDS = 0, DB_FREES };

/* 0: commit; > 0: roll back, and give that number; -1: the database failed. May run twice. */
typedef int db_work(struct db *db, void *data);

/* What `work` gave, or -1 with *reterr; anything but 0 has changed nothing. */
int db_transact(struct db *db, enum db_need need, const char *what, db_work *work, void *data,
                struct problem *reterr);

/* Makes the reserve whole where it is not; whether it is. */
bool db_restore_reserve(struct db *db);

#endif
