/* retention.h - the thread that prunes what the store has kept long enough, step by step, now and then. */
#ifndef DRAPED_RETENTION_H
#define DRAPED_RETENTION_H

#include "store.h"

struct retention;

#define RETENTION_PERIOD_MS 5000 /* between two looks */

/* Monotonic: when it last got on; now while it sleeps, and not during a step, which is small. Any thread. */
int64_t retention_seen_ms(struct retention *retention);

/* Starts at once. `store` must outlive it. NULL when out of memory or threads. */
struct retention *retention_new(struct store *store, const struct store_policy *policy,
                                struct metrics *metrics);
struct retention *retention_free(struct retention *retention); /* waits for the step; NULL is fine */

#endif
