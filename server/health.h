/* health.h - whether the daemon is well: when each of its parts was last seen to work, and what stands in the
 * way of taking jobs.
 *
 * Main writes, but for what the clerk's look at the data folder finds; any thread may ask, without a lock. */
#ifndef DRAPED_HEALTH_H
#define DRAPED_HEALTH_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include <jansson.h>

#include "problem.h"

/* The parts that must get on. A solver's iteration is none: it may take its time. */
enum pulse_of {
    PULSE_MAIN = 0, /* the ticks of main, which take every lock but the store's */
    PULSE_API,      /* the loop of the API listener */
    PULSE_ADMIN,    /* the loop of the admin listener */
    PULSE_WORKERS,  /* idle workers look for work */
    PULSE_CLERK,    /* its task is not stuck */
    PULSE_READER,   /* its body is not stuck */
    PULSE_STORE,    /* a look at the data folder and a question to the database came back */
    PULSE_PRUNING,  /* the step of the thread that prunes is not stuck */
    PULSES
};

/* Without a watchdog, a part that has not been seen for so long is told of as stale. */
#define HEALTH_PATIENCE_MS 30000

struct health {
    int64_t patience_ms; /* these two are set before the first thread */
    uint64_t min_free_bytes;
    _Atomic int64_t seen_ms[PULSES]; /* monotonic */
    atomic_bool started, stopping;
    atomic_bool writable; /* the data folder took a write when last asked */
    _Atomic uint64_t free_bytes;
    atomic_bool queue_full;
};

/* All parts seen now; not started. */
void health_init(struct health *health, int64_t patience_ms, uint64_t min_free_bytes, int64_t now_ms);
void health_see(struct health *health, enum pulse_of part, int64_t at_ms);

/* The name of a part that has not been seen for longer than the patience; NULL: there is none. */
const char *health_stale(const struct health *health, int64_t now_ms);

/* {"ready": ..., "checks": {"name": "ok" or why not, ...}}; NULL when out of memory. */
json_t *health_json(const struct health *health, int64_t now_ms, bool *ret_ready);

/* Whether there is room on the disk for something new; 0, or -1 with *reterr. What is queued, running or to
 * be read goes on below it: there must be room left to write down how jobs end. */
int health_has_space(const struct health *health, struct problem *reterr);

/* Whether what a job leaves behind could be kept now. */
bool health_can_keep(const struct health *health);

#endif
