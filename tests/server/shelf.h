/* shelf.h - what the tests of the store share: stores, jobs in each state, and a look at what is there. */
#ifndef DRAPED_SHELF_H
#define DRAPED_SHELF_H

#include "scratch.h"

#include <fcntl.h>
#include <sqlite3.h>
#include <sys/stat.h>

#include "log.h"
#include "store.h"

static inline struct store *open_store(const char *dir)
{
    struct store *store = NULL;
    struct problem problem;
    assert_int_equal(store_open(dir, NULL, &store, &problem), 0);
    return store;
}

static inline int add_row(struct store *store, const struct job *job, const void *document, size_t bytes,
                          struct problem *reterr)
{
    struct store_submission submission = {.document = document, .bytes = bytes};
    return store_job_add(store, job, &submission, reterr);
}

/* Adds a queued job with a document; *ret is what a worker would hold of it. */
static inline void add_job(struct store *store, struct job *ret)
{
    struct problem problem;
    memset(ret, 0, sizeof *ret);
    id_new(ret->id);
    ret->revision = (struct revision){1, 1};
    ret->created_ms = 1000;
    assert_int_equal(add_row(store, ret, "{}", 2, &problem), 0);
}

static inline void get_job(struct store *store, const char *id, struct job *ret)
{
    struct problem problem;
    assert_int_equal(store_job_get(store, "", id, ret, &problem), 0);
}

struct found {
    size_t count;
    struct job last;
};

static inline int note_job(const struct job *job, void *data)
{
    struct found *found = data;
    found->count++;
    memcpy(found->last.id, job->id, sizeof job->id);
    found->last.revision = job->revision;
    found->last.crashes = job->crashes;
    return 0;
}

static inline size_t recover(struct store *store, struct found *found)
{
    struct problem problem;
    memset(found, 0, sizeof *found);
    assert_int_equal(store_recover(store, 3, 5000, note_job, found, &problem), 0);
    return found->count;
}

/* Starts the job and leaves one file in the folder of its attempt's results. */
static inline void start_job(struct store *store, struct job *job)
{
    struct problem problem;
    int dirfd;
    job->started_ms = 2000;
    assert_int_equal(store_job_start(store, job, &problem), 0);
    assert_int_equal(store_results_begin(store, job->id, job->revision.attempt, &dirfd, &problem), 0);
    int fd = openat(dirfd, "result.json", O_WRONLY | O_CREAT | O_EXCL, 0600);
    assert_true(fd >= 0);
    assert_int_equal(write(fd, "[]", 2), 2);
    close(fd);
    close(dirfd);
    job->status = JOB_RUNNING;
}

static inline size_t count_entries(const char *dir, const char *folder)
{
    char command[512];
    snprintf(command, sizeof command, "ls -A '%s/%s' | wc -l", dir, folder);
    FILE *pipe = popen(command, "r");
    unsigned n = 999;
    assert_int_equal(fscanf(pipe, "%u", &n), 1);
    pclose(pipe);
    return n;
}

/* A finished job with one file of results; *ret has its id. */
static inline void add_finished(struct store *store, const char *file, struct job *ret)
{
    struct problem problem;
    int dirfd;
    add_job(store, ret);
    assert_int_equal(store_job_start(store, ret, &problem), 0);
    assert_int_equal(store_results_begin(store, ret->id, 1, &dirfd, &problem), 0);
    int fd = openat(dirfd, file, O_WRONLY | O_CREAT, 0600);
    assert_int_equal(write(fd, "drape", 5), 5);
    close(fd);
    close(dirfd);
    ret->status = JOB_SUCCEEDED;
    assert_int_equal(store_job_finish(store, ret, &problem), 0);
}

/* The database as version 1 or 2 made it, with `rows` in it. */
static inline void make_old_database(const char *dir, int version, const char *rows)
{
    char path[256], pragma[64];
    sqlite3 *db;
    snprintf(path, sizeof path, "%s/draped.db", dir);
    snprintf(pragma, sizeof pragma, "PRAGMA user_version=%d;", version);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    const char *sql[] = {
        "CREATE TABLE job(seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE,"
        " status TEXT NOT NULL, verdict TEXT NOT NULL, attempt INTEGER NOT NULL, counter INTEGER NOT NULL,"
        " crashes INTEGER NOT NULL, cancel INTEGER NOT NULL, created_ms INTEGER NOT NULL,"
        " started_ms INTEGER NOT NULL, finished_ms INTEGER NOT NULL, name TEXT, labels TEXT, progress TEXT,"
        " report TEXT, error TEXT);"
        "CREATE INDEX job_status ON job(status, seq);"
        "CREATE TABLE gone(seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, at_ms INTEGER NOT "
        "NULL);"
        "CREATE TABLE mesh(sha256 TEXT PRIMARY KEY, format INTEGER NOT NULL, bytes INTEGER NOT NULL,"
        " vertices INTEGER NOT NULL, triangles INTEGER NOT NULL, created_ms INTEGER NOT NULL) WITHOUT ROWID;",
        version >= 2 ? "ALTER TABLE job ADD COLUMN warnings TEXT;" : "",
        pragma,
        rows,
    };
    for (size_t i = 0; i < sizeof sql / sizeof *sql; i++)
        assert_int_equal(sqlite3_exec(db, sql[i], NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
}

#define OLD_ID      "00000000000000000000000000000001"
#define OLD_GONE    "00000000000000000000000000000002"
#define OLD_DIGEST  "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
#define OLD_COLUMNS "id,status,verdict,attempt,counter,crashes,cancel,created_ms,started_ms,finished_ms,name"
#define OLD_ROWS                                                                                             \
    "INSERT INTO job(" OLD_COLUMNS ") VALUES('" OLD_ID "','queued','',2,3,1,0,4,0,0,'old');"                 \
    "INSERT INTO gone(id,at_ms) VALUES('" OLD_GONE "',5);"                                                   \
    "INSERT INTO mesh VALUES('" OLD_DIGEST "',1,3,4,5,6);"

#endif
