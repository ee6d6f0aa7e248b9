/* rig.h - what the tests of the queue share: a queue with its store and hub, jobs posted to it, and waits. */
#ifndef DRAPED_RIG_H
#define DRAPED_RIG_H

#include "scratch.h"

#include <stdatomic.h>
#include <time.h>

#include "clock.h"
#include "keys.h"
#include "metrics.h"
#include "queue.h"
#include "store.h"

struct rig {
    char *dir;
    struct limits limits;
    uint64_t memory, job_memory; /* 0: the default */
    struct keys *keys;           /* NULL: none */
    struct store *store;
    struct hub *hub;
    struct metrics *metrics;
    struct queue *queue;
    atomic_int changes, ends;
    void (*heard)(const char *body); /* with the queue's lock held; may be NULL */
    char started[1024]; /* ids in the order of starts, a blank behind each; with the queue's lock held */
};

static inline void on_changed(const char *id, struct revision revision, bool ended, const char *body,
                              void *data)
{
    struct rig *rig = data;
    (void)revision;
    atomic_fetch_add(&rig->changes, 1);
    if (ended)
        atomic_fetch_add(&rig->ends, 1);
    if (strstr(body, id) == NULL)
        abort();
    if (strstr(body, "\"status\":\"running\"") != NULL && strstr(rig->started, id) == NULL &&
        strlen(rig->started) + ID_SIZE < sizeof rig->started) {
        strcat(rig->started, id);
        strcat(rig->started, " ");
    }
    if (rig->heard != NULL)
        rig->heard(body);
}

/* A store, a hub and a queue over it that is not started yet. */
static inline void make_rig(struct rig *rig, unsigned workers, size_t queued)
{
    struct problem problem;
    rig->limits = limits_default;
    rig->limits.queued_jobs = queued;
    if (rig->memory > 0)
        rig->limits.memory = rig->memory;
    if (rig->job_memory > 0)
        rig->limits.job_memory = rig->job_memory;
    assert_int_equal(store_open(rig->dir, NULL, &rig->store, &problem), 0);
    rig->hub = hub_new(8, 8);
    rig->metrics = metrics_new();
    rig->queue = queue_new(&(struct queue_setup){.store = rig->store,
                                                 .hub = rig->hub,
                                                 .metrics = rig->metrics,
                                                 .limits = &rig->limits,
                                                 .keys = rig->keys,
                                                 .workers = workers,
                                                 .changed = on_changed,
                                                 .data = rig});
    assert_non_null(rig->queue);
}

static inline void open_rig(struct rig *rig, unsigned workers, size_t queued)
{
    struct problem problem;
    make_rig(rig, workers, queued);
    assert_int_equal(queue_start(rig->queue, &problem), 0);
}

static inline void close_rig(struct rig *rig)
{
    queue_interrupt(rig->queue);
    rig->queue = queue_free(rig->queue);
    rig->keys = keys_free(rig->keys);
    rig->hub = hub_free(rig->hub);
    rig->metrics = metrics_free(rig->metrics);
    rig->store = store_close(rig->store);
}

static inline int rig_new(void **state)
{
    static struct rig rig;
    void *dir;
    memset(&rig, 0, sizeof rig);
    if (scratch_new(&dir) != 0)
        return -1;
    rig.dir = dir;
    *state = &rig;
    return 0;
}

static inline int rig_free(void **state)
{
    void *dir = ((struct rig *)*state)->dir;
    return scratch_free(&dir);
}

static inline int submit_as(struct rig *rig, struct job job, const char *document, char id[ID_SIZE],
                            struct problem *problem)
{
    struct store_submission submission = {.document = document, .bytes = strlen(document)};
    char *body = NULL;
    id_new(job.id);
    memcpy(id, job.id, ID_SIZE);
    int result = queue_submit(rig->queue, &job, &submission, &body, problem);
    if (result == 0) {
        assert_non_null(strstr(body, "\"status\":\"queued\""));
        assert_non_null(strstr(body, id));
    }
    free(body);
    job_done(&job);
    return result;
}

static inline int submit(struct rig *rig, const char *document, char id[ID_SIZE], struct problem *problem)
{
    return submit_as(rig, (struct job){0}, document, id, problem);
}

static inline void pause_ms(long ms)
{
    struct timespec t = {ms / 1000, ms % 1000 * 1000000L};
    nanosleep(&t, NULL);
}

/* Waits until the job has ended and gives its row; fails after a minute. */
static inline void wait_end_of(struct rig *rig, const char *owner, const char *id, struct job *ret)
{
    struct problem problem;
    for (int64_t limit = clock_monotonic_ms() + 60000; clock_monotonic_ms() < limit; pause_ms(2)) {
        assert_int_equal(store_job_get(rig->store, owner, id, ret, &problem), 0);
        if (job_status_ended(ret->status))
            return;
        job_done(ret);
    }
    fail_msg("job %s did not end", id);
}

static inline void wait_end(struct rig *rig, const char *id, struct job *ret)
{
    wait_end_of(rig, "", id, ret);
}

static inline void wait_status(struct rig *rig, const char *id, const char *status)
{
    char wanted[32];
    snprintf(wanted, sizeof wanted, "\"status\":\"%s\"", status);
    for (int64_t limit = clock_monotonic_ms() + 60000; clock_monotonic_ms() < limit; pause_ms(1)) {
        char *body = NULL;
        struct revision revision;
        int found = queue_body(rig->queue, "", id, &body, &revision);
        bool hit = found == 0 && strstr(body, wanted) != NULL;
        free(body);
        if (hit)
            return;
        assert_int_equal(found, 0);
    }
    fail_msg("job %s did not become %s", id, status);
}

/* Runs far longer than any test waits for it. */
static inline char *long_job(void)
{
    return scratch_square(40, "dynamic", 100000);
}

#endif
