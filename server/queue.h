/* queue.h - the jobs that have not ended: how many there may be, the workers that solve them, their states.
 * In which order they start is line.h's matter.
 *
 *   queued -> running -> succeeded | failed | canceled
 *
 * Every change is first committed to the store, as a compare-and-set on (state, attempt), then made
 * visible here, then published to the job's stream and to `changed`. A job that has ended leaves; from
 * then on only the store knows it.
 *
 * Any thread may call anything but new, start and free. One lock inside; under it only the hub's lock
 * and whatever `changed` takes are taken, and no file is touched. Functions that say "store" may wait
 * for the disk: not for the HTTP thread. */
#ifndef DRAPED_QUEUE_H
#define DRAPED_QUEUE_H

#include <stddef.h>

#include "job.h"
#include "limits.h"
#include "problem.h"
#include "store.h"
#include "stream.h"

struct drape_analyses;
struct drape_processors;
struct fields;
struct metrics;
struct queue;

/* How many times the daemon may die under a job before the job is given up. */
#define QUEUE_MAX_CRASHES 3

struct queue_setup {
    struct store *store;
    struct hub *hub;
    struct metrics *metrics;
    const struct limits *limits;
    struct keys *keys; /* NULL: there are none, and no quotas */
    unsigned workers;
    /* After each change, in order, with the queue's lock held; `body` is lent. May be NULL. */
    void (*changed)(const char *id, struct revision revision, bool ended, const char *body, void *data);
    void *data;
    struct fields *fields;           /* NULL: each job builds the distance fields of its bodies for itself */
    struct drape_analyses *analyses; /* NULL: each job analyses its matrices for itself */
    struct drape_processors *processors; /* NULL: each job has one */
};

struct queue *queue_new(const struct queue_setup *setup); /* NULL when out of memory */

/* Store. Takes over what an earlier daemon left, then starts the workers. 0, or -1 with *reterr. */
int queue_start(struct queue *queue, struct problem *reterr);

/* Whether a job of `owner` would be taken now; 0, or -1 with *reterr (queue-full, quota-queued, draining),
 * and when to come again. */
int queue_admits(struct queue *queue, const char *owner, struct problem *reterr);

/* When to come again, s, for what is there once `ahead` more jobs have been worked off: by the mean time that
 * jobs ran of late, 1 where none has ended yet, and at most QUEUE_RETRY_MAX_S, for much may change. */
unsigned queue_retry_s(struct queue *queue, size_t ahead);
#define QUEUE_RETRY_MAX_S 60

/* Store. Takes the texts of *job (emptying it) whose id, owner, priority and texts are set, and what was kept
 * for it to start from; submission->answer is set here. On success (0) the job is durable and *ret_body its
 * body, which the caller frees. QUEUE_TAKEN: there is an answer under that key. */
int queue_submit(struct queue *queue, struct job *job, struct store_submission *submission, char **ret_body,
                 struct problem *reterr);

#define QUEUE_TAKEN 2

#define QUEUE_NONE 1 /* not here: ended, never was, or another owner's */

/* The body of a job as it stands; the caller frees it. 0, QUEUE_NONE, or -1 when out of memory. */
int queue_body(struct queue *queue, const char *owner, const char *id, char **ret_body,
               struct revision *ret_revision);

/* The newest preview of a job, a GLB that the caller frees, and the job's revision when it came. 0, QUEUE_NONE
 * (also while there is none), or -1 when out of memory. */
int queue_preview(struct queue *queue, const char *owner, const char *id, char **ret, size_t *ret_bytes,
                  struct revision *ret_since);

/* Has the follower follow a job (see follower_add). 0, QUEUE_NONE, or -1 when out of memory. */
int queue_follow(struct queue *queue, const char *owner, const char *id, struct revision seen,
                 struct follower *follower);

/* Store. A queued job ends at once, a running one at its next iteration; either way 0 and the body as it
 * stands. QUEUE_NONE, or -1 with *reterr. */
int queue_cancel(struct queue *queue, const char *owner, const char *id, char **ret_body,
                 struct problem *reterr);

/* While held nothing is started: what would come of it could not be kept. */
void queue_hold(struct queue *queue, bool held);

/* Stopping: drain (nothing more is taken or started), wait for queue_running to be 0 or for patience to
 * end, interrupt (what still runs goes back to the line, in the store), free. */
void queue_drain(struct queue *queue);
unsigned queue_running(struct queue *queue);
void queue_interrupt(struct queue *queue);
struct queue *queue_free(struct queue *queue); /* waits for the workers; NULL is fine; returns NULL */

void queue_reconsider(struct queue *queue); /* quotas may have changed: more may start now */

struct queue_counts {
    size_t queued, running;
    int64_t seen_ms; /* monotonic; when an idle worker last looked for work: now while all solve */
};

/* Sets the gauges of metrics.h that it knows, too. */
void queue_measure(struct queue *queue, struct queue_counts *ret);
void queue_count(struct queue *queue, size_t *ret_queued, size_t *ret_running);

#endif
