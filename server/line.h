/* line.h - the jobs that wait for a worker, and which is next.
 *
 * Each owner has a share of the line: its own jobs, those of higher priority first, else as they came. Owners
 * take turns: the next job is the first of the owner whose last turn is longest ago and who has fewer jobs
 * with workers than its key's quota. So one key's hundred jobs do not keep another's one waiting, whatever
 * the priorities; and a priority counts among its owner's jobs only. Where that job does not fit into the
 * memory that is left, nothing starts until it does: it is not overtaken for ever by smaller ones. A job
 * alone always fits.
 *
 * A turn costs O(owners with jobs). Locking must be supplied by the caller. */
#ifndef DRAPED_LINE_H
#define DRAPED_LINE_H

#include "job.h"
#include "limits.h"

struct line;

struct share { /* an owner's */
    char owner[KEY_NAME_SIZE];
    size_t queued; /* the caller's count of jobs that no worker has begun, those being accepted included */
    size_t taken;  /* jobs with workers */
    size_t waiting;
    struct place *first[JOB_PRIORITIES], *last[JOB_PRIORITIES];
    struct share *prev, *next; /* in turn */
    size_t holds;
};

struct place { /* a job's, whose owner keeps it; zero-initialise */
    struct share *share;
    int priority;    /* enum job_priority */
    uint64_t memory; /* bytes that the job is expected to need */
    struct place *prev, *next;
    bool waiting;
};

/* `keys` tells quotas; NULL: there are none. NULL when out of memory. */
struct line *line_new(struct keys *keys, const struct limits *limits);
struct line *line_free(struct line *line); /* with whoever is still in it; NULL is fine; returns NULL */

/* The owner's share, held once more; NULL when out of memory. It lasts until all holds are let go. */
struct share *line_hold(struct line *line, const char *owner);
void line_let_go(struct line *line, struct share *share);

/* How many jobs the owner has queued, see struct share. */
size_t line_queued(const struct line *line, const char *owner);

/* `first`: before all of its owner's and priority, as a job that was taken and could not begin. */
void line_enter(struct line *line, struct place *place, bool first);
void line_leave(struct line *line, struct place *place); /* one that does not wait is fine */

/* The next job out of the line, to be given back when its worker has done with it; NULL: none may start. */
struct place *line_take(struct line *line);
void line_give_back(struct line *line, struct share *share, uint64_t memory);

/* How many jobs start until this one has, counting itself, if no more come and neither quota nor memory holds
 * anybody up; 0: it does not wait. */
size_t line_position(const struct line *line, const struct place *place);

/* The line_position of the owner's next job; 0: none waits. */
size_t line_next(const struct line *line, const char *owner);

/* Calls `each` for the first of every owner and priority. */
void line_heads(const struct line *line, void (*each)(const struct place *place, void *data), void *data);

uint64_t line_memory(const struct line *line); /* of all jobs with workers */

#endif
