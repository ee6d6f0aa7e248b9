/* executor.c - see executor.h. */
#include "executor.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdlib.h>

#include "clock.h"

/* jansson recurses some 100 bytes a level and the solver's check little more; 8 MB as any main thread. */
#define STACK_BYTES (8u << 20)

struct task {
    executor_fn *run;
    void *data;
};

struct executor {
    pthread_t thread;
    pthread_mutex_t lock; /* guards all below */
    pthread_cond_t work;
    struct task *ring;
    size_t capacity, first, count; /* count includes the one that runs */
    int64_t since_ms;              /* since when that one runs, or waits to; monotonic */
    bool stopping;
};

static void *executor_main(void *arg)
{
    struct executor *e = arg;
    pthread_mutex_lock(&e->lock);
    for (;;) {
        while (e->count == 0 && !e->stopping)
            pthread_cond_wait(&e->work, &e->lock);
        if (e->count == 0)
            break;
        struct task task = e->ring[e->first];
        pthread_mutex_unlock(&e->lock);
        task.run(task.data);
        pthread_mutex_lock(&e->lock);
        e->first = (e->first + 1) % e->capacity;
        e->count--;
        e->since_ms = clock_monotonic_ms();
    }
    pthread_mutex_unlock(&e->lock);
    return NULL;
}

struct executor *executor_new(const char *name, size_t capacity)
{
    struct executor *e = calloc(1, sizeof *e);
    if (e == NULL || (e->ring = calloc(capacity, sizeof *e->ring)) == NULL) {
        free(e);
        return NULL;
    }
    e->capacity = capacity;
    pthread_mutex_init(&e->lock, NULL);
    pthread_cond_init(&e->work, NULL);
    pthread_attr_t attr;
    pthread_attr_init(&attr);
    pthread_attr_setstacksize(&attr, STACK_BYTES);
    int failed = pthread_create(&e->thread, &attr, executor_main, e);
    pthread_attr_destroy(&attr);
    if (failed) {
        pthread_cond_destroy(&e->work);
        pthread_mutex_destroy(&e->lock);
        free(e->ring);
        free(e);
        return NULL;
    }
    pthread_setname_np(e->thread, name);
    return e;
}

int executor_submit(struct executor *executor, executor_fn *run, void *data)
{
    pthread_mutex_lock(&executor->lock);
    bool room = executor->count < executor->capacity && !executor->stopping;
    if (room) {
        if (executor->count == 0)
            executor->since_ms = clock_monotonic_ms();
        executor->ring[(executor->first + executor->count) % executor->capacity] = (struct task){run, data};
        executor->count++;
        pthread_cond_signal(&executor->work);
    }
    pthread_mutex_unlock(&executor->lock);
    return room ? 0 : -1;
}

int64_t executor_seen_ms(struct executor *executor)
{
    pthread_mutex_lock(&executor->lock);
    int64_t seen = executor->count == 0 ? clock_monotonic_ms() : executor->since_ms;
    pthread_mutex_unlock(&executor->lock);
    return seen;
}

struct executor *executor_free(struct executor *executor)
{
    if (executor == NULL)
        return NULL;
    pthread_mutex_lock(&executor->lock);
    executor->stopping = true;
    pthread_cond_signal(&executor->work);
    pthread_mutex_unlock(&executor->lock);
    pthread_join(executor->thread, NULL);
    pthread_cond_destroy(&executor->work);
    pthread_mutex_destroy(&executor->lock);
    free(executor->ring);
    free(executor);
    return NULL;
}
