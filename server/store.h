/* store.h - what must survive: jobs, results and meshes in the data folder.
 *
 *   draped.db               SQLite: one row per job, and per mesh and owner
 *   draped.reserve          empty blocks, see database.h
 *   draped.lock             held by the one daemon that may use the folder
 *   jobs/<id>.json          the document as it was posted
 *   jobs/<id>.from, .start  of a re-drape that has not ended: document and drape of the job it starts from
 *   results/<id>.<attempt>/ the files of output.h, complete and synced before the row says so
 *   results/<id>.<attempt>.tmp/   the same while that attempt writes them
 *   meshes/<sha256>         an uploaded mesh, byte for byte
 *
 * Every file is written under a temporary name, synced, renamed and its folder synced before the row
 * that speaks of it is committed; so a row never promises a file that is not there, and what no row
 * speaks of is removed at the next start.
 *
 * Any thread may call anything but open and close. One lock (inside, database.h) serialises the one
 * connection; it is held for one short transaction, never while files are written, and nothing else
 * is locked under it. Every call may wait for the disk: not for the HTTP thread.
 *
 * Every job and mesh has an owner (job.h). Functions that take one find nothing of anybody else's; those
 * without are for the queue and its workers, which act for the owner of the job they hold.
 *
 * Functions return 0; STORE_NONE when there is no such row, or none in that state at that attempt
 * (*reterr is untouched); or -1 with *reterr filled (PROBLEM_STORAGE, nothing changed). */
#ifndef DRAPED_STORE_H
#define DRAPED_STORE_H

#include <stddef.h>
#include <stdint.h>

#include "job.h"
#include "problem.h"

struct metrics;
struct store;

#define STORE_NONE       1
#define STORE_GONE       2 /* there was such a job; it was removed */
#define STORE_UNFINISHED 3 /* there is such a job, and it has not ended */
#define STORE_WITHOUT    4 /* there is, without what it should have */
#define STORE_TAKEN      5 /* somebody else was first */
#define STORE_IN_USE     6 /* a job that has not ended needs it */

/* Creates the folder when it is missing. `metrics` may be NULL. */
int store_open(const char *dir, struct metrics *metrics, struct store **ret, struct problem *reterr);
struct store *store_close(struct store *store); /* NULL is fine; returns NULL */

/* Asks the database something small, behind whatever is being written: for who wants to know if it still
 * lives. */
int store_ask(struct store *store, struct problem *reterr);

/* ---- jobs ---------------------------------------------------------------------------------------- */

typedef int store_job_fn(const struct job *job, void *data); /* borrowed; nonzero stops */

/* Once, before the first worker: jobs found running had their daemon die under them. They go back to
 * the queue at the next attempt, or fail as worker-crash at crash number `max_crashes`, or end as
 * canceled when that had been asked for. Removes what no row speaks of, then calls `each` for every
 * queued job, oldest first. */
int store_recover(struct store *store, unsigned max_crashes, int64_t now_ms, store_job_fn *each, void *data,
                  struct problem *reterr);

struct store_submission { /* what comes with a new job; all borrowed */
    const void *document;
    size_t bytes;
    const char (*mesh)[SHA256_SIZE]; /* those that it needs, each once; kept until it has ended */
    size_t meshes;
    const char *key;    /* its Idempotency-Key; NULL: none */
    const char *digest; /* with a key: SHA-256 of the request's body, hex */
    const char *answer; /* with a key: the body of the answer to it */
    int64_t at_ms;      /* with a key: now, by clock_steady_ms */
};

/* A queued job with its document and the answer under its key, all in one transaction: durable once this
 * returns 0; else what store_start_keep kept is dropped. STORE_WITHOUT: a mesh of it is not there (any
 * more); STORE_TAKEN: there is an answer under that key. */
int store_job_add(struct store *store, const struct job *job, const struct store_submission *submission,
                  struct problem *reterr);

/* Each of these is one compare-and-set on (state, attempt); exactly one of two racing calls wins.
 * `job` carries the id, the revision to write, and whose attempt is compared.  */
int store_job_start(struct store *store, const struct job *job, struct problem *reterr);
int store_job_cancel_queued(struct store *store, const struct job *job, struct problem *reterr);
int store_job_cancel_running(struct store *store, const struct job *job, struct problem *reterr);

/* running -> queued at attempt + 1: the daemon stops before the job ended. Not a crash. */
int store_job_requeue(struct store *store, const struct job *job, struct problem *reterr);

/* running -> ended, with everything `job` holds. A job that succeeded has its results published first
 * (see store_results_begin); one that did not has them dropped. After -1 it may be called again. */
int store_job_finish(struct store *store, const struct job *job, struct problem *reterr);

int store_job_get(struct store *store, const char *owner, const char *id, struct job *ret,
                  struct problem *reterr);

/* The posted document, for whoever has got the job; the caller frees *ret. */
int store_job_document(struct store *store, const char *id, char **ret, size_t *ret_bytes,
                       struct problem *reterr);

/* Removes an ended job and all its files; its id is remembered as gone. STORE_GONE: already;
 * STORE_NONE: no such job, or it has not ended. */
int store_job_remove(struct store *store, const char *owner, const char *id, int64_t now_ms,
                     struct problem *reterr);

struct store_filter {
    const char *owner;
    int status;             /* enum job_status; -1: any */
    const char *label_name; /* NULL: any */
    const char *label_value;
    int64_t created_after_ms; /* only jobs created later; -1: any */
    int64_t before;           /* only jobs older than this position; INT64_MAX: from the newest */
    size_t limit;
};

/* Newest first. *ret_last is the position of the last one given, *ret_more tells whether older ones
 * remain. */
int store_job_list(struct store *store, const struct store_filter *filter, store_job_fn *each, void *data,
                   int64_t *ret_last, bool *ret_more, struct problem *reterr);

/* ---- answers -------------------------------------------------------------------------------------
 * What was answered to the request that made a job is kept under its Idempotency-Key for a day. */

#define STORE_ANSWER_MS ((int64_t)24 * 60 * 60 * 1000)

struct store_answer {
    char digest[SHA256_SIZE]; /* of the request's body */
    char job[ID_SIZE];
    char *body; /* of the answer; the caller frees it */
};

/* What was answered at most STORE_ANSWER_MS before `now_ms` (clock_steady_ms). */
int store_answer_get(struct store *store, const char *owner, const char *key, int64_t now_ms,
                     struct store_answer *ret, struct problem *reterr);

/* ---- results ------------------------------------------------------------------------------------- */

/* An empty folder for this attempt's files; the caller closes *ret_dirfd. */
int store_results_begin(struct store *store, const char *id, uint32_t attempt, int *ret_dirfd,
                        struct problem *reterr);
void store_results_drop(struct store *store, const char *id, uint32_t attempt);

/* One file of the results of a job that succeeded at `attempt`, open for reading; the caller closes
 * *ret_fd. */
int store_result_open(struct store *store, const char *id, uint32_t attempt, const char *file, int *ret_fd,
                      uint64_t *ret_bytes, struct problem *reterr);

/* ---- starts --------------------------------------------------------------------------------------
 * A re-drape begins at the result of another job. It keeps document and drape of that job under its own name
 * (hard links: no copy, and they outlive whatever becomes of the other job) until it has ended. */

/* For job `id`, which is added afterwards, what `from` has; `file` is that of its drape among the results.
 * STORE_NONE or STORE_GONE as store_job_get of `from`; STORE_UNFINISHED where it has not ended,
 * STORE_WITHOUT where it ended without that file. */
int store_start_keep(struct store *store, const char *owner, const char *id, const char *from,
                     const char *file, struct problem *reterr);
void store_start_drop(struct store *store, const char *id);

/* The document of the job that `id` starts from, and its drape; the caller frees both. */
int store_start_document(struct store *store, const char *id, char **ret, size_t *ret_bytes,
                         struct problem *reterr);
int store_start_drape(struct store *store, const char *id, char **ret, size_t *ret_bytes,
                      struct problem *reterr);

/* ---- meshes --------------------------------------------------------------------------------------
 * Each owner has rows of its own, and sees no other's; equal bytes are one file. */

struct store_mesh {
    char sha256[SHA256_SIZE];
    int format; /* enum mesh_format of meshfile.h */
    uint64_t bytes;
    size_t vertices, triangles;
};

/* Keeps `data` (mesh->bytes of it) under its digest. A mesh that is there already stays as it is, but counts
 * as touched. */
int store_mesh_add(struct store *store, const char *owner, const struct store_mesh *mesh, const void *data,
                   int64_t now_ms, struct problem *reterr);
int store_mesh_get(struct store *store, const char *owner, const char *sha256, struct store_mesh *ret,
                   struct problem *reterr);
/* The same with the mesh's bytes, open for reading; the caller closes *ret_fd. */
int store_mesh_open(struct store *store, const char *owner, const char *sha256, struct store_mesh *ret,
                    int *ret_fd, struct problem *reterr);

/* Of all meshes of the owner together. */
int store_mesh_bytes(struct store *store, const char *owner, uint64_t *ret, struct problem *reterr);

/* Puts off the mesh's pruning, now and then: at most one write an hour. */
int store_mesh_touch(struct store *store, const char *owner, const char *sha256, int64_t now_ms,
                     struct problem *reterr);

/* STORE_IN_USE: a job that has not ended needs it. Jobs that have ended do not hold it. */
int store_mesh_remove(struct store *store, const char *owner, const char *sha256, struct problem *reterr);

/* A mesh's bytes once more in a content coding ("gz"), made when somebody first asks and forgotten at the
 * next start; 0 bytes where that is not worth it. STORE_NONE: not made yet. The caller closes *ret_fd. */
int store_mesh_coded_open(struct store *store, const char *sha256, const char *coding, int *ret_fd,
                          uint64_t *ret_bytes, struct problem *reterr);
int store_mesh_coded_add(struct store *store, const char *sha256, const char *coding, const void *data,
                         size_t bytes, struct problem *reterr);

/* ---- pruning ------------------------------------------------------------------------------------- */

struct store_policy {
    uint64_t jobs;  /* ended jobs kept, */
    uint64_t bytes; /* with that much of documents and results, */
    int64_t age_ms; /* for that long after their end */
};

struct store_pruned {
    size_t jobs, meshes;
    uint64_t bytes; /* of the jobs */
};

/* One small step: removes the oldest ended jobs beyond `policy`, as store_job_remove does; meshes that no job
 * names and nobody has touched for age_ms; answers and tombstones (after STORE_GONE_MS) that are too old.
 * 0 with *ret, all zeros when nothing was left to do. */
#define STORE_GONE_MS ((int64_t)30 * 24 * 60 * 60 * 1000)
int store_prune(struct store *store, const struct store_policy *policy, int64_t now_ms,
                struct store_pruned *ret, struct problem *reterr);

#endif
