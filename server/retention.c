/* retention.c - see retention.h. */
#include "retention.h"

#include <pthread.h>
#include <stdlib.h>
#include <time.h>

#include "clock.h"
#include "log.h"
#include "metrics.h"

struct retention {
    struct store *store;
    struct store_policy policy;
    struct metrics *metrics;
    pthread_t thread;
    pthread_mutex_t lock; /* guards all below */
    pthread_cond_t wake;
    bool stop;
    int64_t since_ms; /* monotonic; when its step began; 0: it sleeps */
};

/* Whether there may be more to do. */
static bool prune(struct retention *r)
{
    struct store_pruned pruned;
    if (store_prune(r->store, &r->policy, clock_steady_ms(), &pruned, NULL) != 0)
        return false; /* the store has said why; the next look tries again */
    if (pruned.jobs + pruned.meshes == 0)
        return false;
    metrics_add(r->metrics, METRIC_JOBS_PRUNED, (double)pruned.jobs);
    log_event(LOG_LEVEL_INFO, "store.pruned", "jobs=%zu bytes=%llu meshes=%zu", pruned.jobs,
              (unsigned long long)pruned.bytes, pruned.meshes);
    return true;
}

/* Under the lock. */
static void sleep_until_next(struct retention *r)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += RETENTION_PERIOD_MS / 1000;
    r->since_ms = 0;
    while (!r->stop && pthread_cond_timedwait(&r->wake, &r->lock, &until) == 0)
        continue;
}

static void *retention_main(void *data)
{
    struct retention *r = data;
    pthread_mutex_lock(&r->lock);
    while (!r->stop) {
        r->since_ms = clock_monotonic_ms();
        pthread_mutex_unlock(&r->lock);
        bool more = prune(r);
        pthread_mutex_lock(&r->lock);
        if (!more)
            sleep_until_next(r);
    }
    pthread_mutex_unlock(&r->lock);
    return NULL;
}

struct retention *retention_new(struct store *store, const struct store_policy *policy,
                                struct metrics *metrics)
{
    struct retention *r = calloc(1, sizeof *r);
    if (r == NULL)
        return NULL;
    r->store = store;
    r->policy = *policy;
    r->metrics = metrics;
    r->since_ms = clock_monotonic_ms();
    pthread_condattr_t monotonic;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_mutex_init(&r->lock, NULL);
    pthread_cond_init(&r->wake, &monotonic);
    pthread_condattr_destroy(&monotonic);
    if (pthread_create(&r->thread, NULL, retention_main, r) == 0) {
        pthread_setname_np(r->thread, "draped-retain");
        return r;
    }
    pthread_cond_destroy(&r->wake);
    pthread_mutex_destroy(&r->lock);
    free(r);
    return NULL;
}

int64_t retention_seen_ms(struct retention *retention)
{
    pthread_mutex_lock(&retention->lock);
    int64_t seen = retention->since_ms == 0 ? clock_monotonic_ms() : retention->since_ms;
    pthread_mutex_unlock(&retention->lock);
    return seen;
}

struct retention *retention_free(struct retention *r)
{
    if (r == NULL)
        return NULL;
    pthread_mutex_lock(&r->lock);
    r->stop = true;
    pthread_cond_signal(&r->wake);
    pthread_mutex_unlock(&r->lock);
    pthread_join(r->thread, NULL);
    pthread_cond_destroy(&r->wake);
    pthread_mutex_destroy(&r->lock);
    free(r);
    return NULL;
}
