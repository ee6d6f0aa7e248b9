/* queue.c - see queue.h. */
#include "queue.h"

#include <math.h>
#include <pthread.h>
#include <search.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "clock.h"
#include "jsonout.h"
#include "keys.h"
#include "line.h"
#include "log.h"
#include "metrics.h"
#include "solve.h"
#include "store.h"

/* As the main thread's; OpenBLAS and CHOLMOD keep some of their work on the stack. */
#define WORKER_STACK_BYTES (8u << 20)

/* Between two tries at a store that refuses writes. */
#define RETRY_MS 1000

/* Looks at a job that is to be cancelled, a millisecond apart: between its end in the store and here lies
 * far less than all of them, but a row that somebody else has changed would never match. */
#define CANCEL_LOOKS 200

/* An idle worker looks at the line again after this long even if nobody wakes it; so it is seen to live. */
#define LOOK_MS 1000

#define RUNS_OF_LATE 8

struct item {           /* a job that has not ended: in the tree, and in the line while it waits */
    struct place place; /* the first member: a place of the line is its item */
    struct job job;
    struct queue *queue;
    struct stream *stream;
    bool entered;        /* the store has it; until then it only keeps its place in the tree */
    int64_t accepted_ms; /* monotonic */
    int64_t started_ms;  /* monotonic */
    atomic_bool stop;
    char *preview; /* a GLB, malloc'd; NULL: none yet */
    size_t preview_bytes;
    struct revision preview_since; /* the job's, with it */
};

struct queue {
    struct queue_setup setup;
    pthread_mutex_t lock; /* guards all below and all items */
    pthread_cond_t work;
    void *tree; /* of items by id: tsearch(3) */
    struct line *line;
    size_t queued, running; /* queued: with those that are being committed to the store */
    bool draining, interrupted, held;
    double run_ms;     /* mean of late, over the last RUNS_OF_LATE or so; 0: none has ended */
    unsigned busy;     /* workers that have a job, or try to get one started */
    int64_t looked_ms; /* monotonic; when an idle worker last looked at the line */
    pthread_t *worker;
    unsigned workers;
};

static int compare_items(const void *a, const void *b)
{
    return strcmp(((const struct item *)a)->job.id, ((const struct item *)b)->job.id);
}

/* ---- items; all under the lock --------------------------------------------------------------------- */

static struct item *find(struct queue *queue, const char *owner, const char *id)
{
    struct item key = {0};
    memcpy(key.job.id, id, strnlen(id, ID_SIZE - 1));
    struct item **found = tfind(&key, &queue->tree, compare_items);
    return found == NULL || !(*found)->entered || strcmp((*found)->job.owner, owner) != 0 ? NULL : *found;
}

static char *body_of(const struct queue *queue, const struct item *item)
{
    return job_body(&item->job, line_position(queue->line, &item->place));
}

/* A job more (1) or less (-1) that no worker has begun. */
static void count_queued(struct queue *queue, struct item *item, int more)
{
    queue->queued += (size_t)more;
    item->place.share->queued += (size_t)more;
}

static void free_item(struct item *item) /* NULL is fine */
{
    if (item == NULL)
        return;
    job_done(&item->job);
    stream_release(item->stream);
    free(item->preview);
    free(item);
}

/* Tells everybody about the job as it now is. Without memory for its body nobody hears of this change;
 * those who wait for the end then hear when their time is up. */
static void publish(struct queue *queue, struct item *item, enum stream_kind kind)
{
    char *body = body_of(queue, item);
    if (body == NULL)
        return;
    stream_publish(item->stream, kind, item->job.revision, body);
    if (queue->setup.changed != NULL)
        queue->setup.changed(item->job.id, item->job.revision, kind == STREAM_END, body, queue->setup.data);
    free(body);
}

static void count_end(struct queue *queue, enum job_status status)
{
    static const enum metric metric[JOB_STATUSES] = {[JOB_SUCCEEDED] = METRIC_JOBS_SUCCEEDED,
                                                     [JOB_FAILED] = METRIC_JOBS_FAILED,
                                                     [JOB_CANCELED] = METRIC_JOBS_CANCELED};
    metrics_add(queue->setup.metrics, metric[status], 1);
}

/* The item's job has ended and the store knows: publishes that, forgets the item. */
static void end_item(struct queue *queue, struct item *item)
{
    line_leave(queue->line, &item->place);
    count_end(queue, item->job.status);
    publish(queue, item, STREAM_END);
    tdelete(item, &queue->tree, compare_items);
    line_let_go(queue->line, item->place.share);
    stream_retire(item->stream, item->job.id);
    item->stream = NULL;
    free_item(item);
}

/* A new item with the texts of *job, which it takes; not its owner's yet. NULL when out of memory. */
static struct item *item_new(struct queue *queue, struct job *job)
{
    struct item *item = calloc(1, sizeof *item);
    if (item == NULL || (item->stream = stream_new(queue->setup.hub)) == NULL) {
        free(item);
        return NULL;
    }
    item->queue = queue;
    item->accepted_ms = clock_monotonic_ms();
    item->job = *job;
    item->place.priority = job->priority < 0   ? JOB_PRIORITY_LOW
                           : job->priority > 0 ? JOB_PRIORITY_HIGH
                                               : JOB_PRIORITY_NORMAL;
    item->place.memory = job->memory;
    memset(job, 0, sizeof *job);
    return item;
}

/* Makes it a queued job of its owner, in the tree and in no line yet. 0, or -1 when out of memory. */
static int own_item(struct queue *queue, struct item *item)
{
    item->place.share = line_hold(queue->line, item->job.owner);
    if (item->place.share == NULL)
        return -1;
    if (tsearch(item, &queue->tree, compare_items) == NULL) {
        line_let_go(queue->line, item->place.share);
        return -1;
    }
    count_queued(queue, item, 1);
    return 0;
}

static void disown_item(struct queue *queue, struct item *item)
{
    count_queued(queue, item, -1);
    tdelete(item, &queue->tree, compare_items);
    line_let_go(queue->line, item->place.share);
}

static void enter_item(struct queue *queue, struct item *item)
{
    item->entered = true;
    line_enter(queue->line, &item->place, false);
    publish(queue, item, STREAM_STATE);
    pthread_cond_signal(&queue->work);
}

/* ---- solving ---------------------------------------------------------------------------------------- */

static void wait_ms(long ms)
{
    struct timespec t = {ms / 1000, ms % 1000 * 1000000L};
    nanosleep(&t, NULL);
}

static void on_progress(char *json, void *data)
{
    struct item *item = data;
    struct queue *queue = item->queue;
    pthread_mutex_lock(&queue->lock);
    free(item->job.progress);
    item->job.progress = json;
    item->job.revision.counter++;
    publish(queue, item, STREAM_PROGRESS);
    pthread_mutex_unlock(&queue->lock);
}

static void on_preview(char *glb, size_t bytes, void *data)
{
    struct item *item = data;
    struct queue *queue = item->queue;
    pthread_mutex_lock(&queue->lock);
    free(item->preview);
    item->preview = glb;
    item->preview_bytes = bytes;
    item->job.preview = true;
    item->job.revision.counter++;
    item->preview_since = item->job.revision;
    publish(queue, item, STREAM_PREVIEW);
    pthread_mutex_unlock(&queue->lock);
}

/* The time, but never before `earlier`: the clock may be set back, and nothing lasts less than no time. */
static int64_t time_after(int64_t earlier)
{
    int64_t now = clock_wall_ms();
    return now > earlier ? now : earlier;
}

/* The store has the start of `job`. Under the lock. */
static void show_start(struct queue *queue, struct item *item, const struct job *job)
{
    count_queued(queue, item, -1);
    queue->running++;
    item->started_ms = clock_monotonic_ms();
    item->job.status = JOB_RUNNING;
    item->job.started_ms = job->started_ms;
    item->job.revision = job->revision;
    if (queue->interrupted)
        atomic_store(&item->stop, true);
    publish(queue, item, STREAM_STATE);
    metrics_observe(queue->setup.metrics, METRIC_QUEUE_SECONDS,
                    (double)(item->started_ms - item->accepted_ms) / 1000);
}

/* Commits queued -> running. The item, or NULL: cancelled meanwhile, or back in the line because the
 * store refused. */
static struct item *start_job(struct queue *queue, struct job *job)
{
    job->started_ms = time_after(job->created_ms);
    job->revision.counter++;
    int result = store_job_start(queue->setup.store, job, NULL);
    pthread_mutex_lock(&queue->lock);
    struct item *item = find(queue, job->owner, job->id);
    if (result == 0) { /* so it is here: nobody but its worker ends a running job */
        show_start(queue, item, job);
    } else {
        if (result < 0 && item != NULL)
            line_enter(queue->line, &item->place, true);
        item = NULL;
    }
    pthread_mutex_unlock(&queue->lock);
    if (result < 0)
        wait_ms(RETRY_MS);
    return item;
}

static char *error_text(const struct problem *problem, const char *id)
{
    char instance[64] = "/v1/jobs/";
    strcat(instance, id);
    json_t *json = problem_json(problem, instance, NULL);
    return jsonout_text(json);
}

/* The last progress, which may have come too soon after the one before to be told. Under the lock. */
static void take_progress(struct queue *queue, struct item *item, struct solve_outcome *outcome)
{
    if (outcome->progress == NULL)
        return;
    free(item->job.progress);
    item->job.progress = outcome->progress;
    outcome->progress = NULL;
    item->job.revision.counter++;
    publish(queue, item, STREAM_PROGRESS);
}

/* Moves what came of the run into the item's job; the status it ends with, or JOB_QUEUED when it is to
 * be put back. Under the lock. */
static enum job_status take_outcome(struct item *item, struct solve_outcome *outcome)
{
    struct job *job = &item->job;
    if (outcome->end == SOLVE_STOPPED)
        return job->cancel ? JOB_CANCELED : JOB_QUEUED;
    if (outcome->end == SOLVE_FAILED) {
        job->error = error_text(&outcome->error, job->id);
        return JOB_FAILED;
    }
    memcpy(job->verdict, outcome->verdict, sizeof job->verdict);
    job->report = outcome->report;
    outcome->report = NULL;
    return JOB_SUCCEEDED;
}

/* Commits the end, trying again while the store refuses. A daemon that is told to stop meanwhile leaves
 * the job to the recovery of the next one. 0, or -1 when given up. */
static int commit_end(struct queue *queue, const struct job *job)
{
    for (;;) {
        int result = job->status == JOB_QUEUED ? store_job_requeue(queue->setup.store, job, NULL)
                                               : store_job_finish(queue->setup.store, job, NULL);
        if (result >= 0)
            return result == 0 ? 0 : -1;
        pthread_mutex_lock(&queue->lock);
        bool give_up = queue->draining;
        pthread_mutex_unlock(&queue->lock);
        if (give_up)
            return -1;
        wait_ms(RETRY_MS);
    }
}

static void show_end(struct queue *queue, struct item *item)
{
    double run_ms = (double)(clock_monotonic_ms() - item->started_ms);
    queue->running--;
    queue->run_ms += queue->run_ms == 0 ? run_ms : (run_ms - queue->run_ms) / RUNS_OF_LATE;
    metrics_observe(queue->setup.metrics, METRIC_RUN_SECONDS, run_ms / 1000);
    if (item->job.status != JOB_QUEUED) {
        end_item(queue, item);
        return;
    }
    item->job.revision = (struct revision){item->job.revision.attempt + 1, 1};
    item->job.started_ms = 0;
    free(item->job.progress);
    item->job.progress = NULL;
    count_queued(queue, item, 1);
    metrics_add(queue->setup.metrics, METRIC_JOBS_REQUEUED, 1);
    publish(queue, item, STREAM_STATE);
}

/* The attempt that it was of is over. */
static void drop_preview(struct item *item)
{
    free(item->preview);
    item->preview = NULL;
    item->job.preview = false;
}

/* From a solved job to its end in the store and here. */
static void finish_job(struct queue *queue, struct item *item, struct solve_outcome *outcome)
{
    pthread_mutex_lock(&queue->lock);
    take_progress(queue, item, outcome);
    enum job_status status = take_outcome(item, outcome);
    struct job end = item->job; /* its texts are lent: nobody but we changes those of a running job */
    pthread_mutex_unlock(&queue->lock);
    end.status = status;
    if (status != JOB_QUEUED) {
        end.finished_ms = time_after(end.started_ms);
        end.revision.counter++;
    }
    int failed = commit_end(queue, &end);
    log_event(LOG_LEVEL_INFO, "job.ended",
              "job=%s attempt=%u status=%s verdict=%s iterations=%u committed=%d trace=%s", end.id,
              end.revision.attempt, job_status_name(status), end.verdict[0] ? end.verdict : "-",
              outcome->iterations, !failed, end.trace_id);
    pthread_mutex_lock(&queue->lock);
    if (!failed) {
        item->job.status = status;
        item->job.finished_ms = end.finished_ms;
        item->job.revision = end.revision;
        drop_preview(item);
        show_end(queue, item);
    } else {
        queue->running--; /* it stays as it was in the store: the next start recovers it */
    }
    pthread_mutex_unlock(&queue->lock);
}

static void work_on(struct queue *queue, struct job *job)
{
    struct item *item = start_job(queue, job);
    if (item == NULL)
        return;
    log_event(LOG_LEVEL_INFO, "job.started", "job=%s attempt=%u", job->id, job->revision.attempt);
    /* The item stays: nobody but its worker ends a running job. */
    struct solve_task task = {
        queue->setup.store,
        queue->setup.limits,
        job->owner,
        job->id,
        job->revision.attempt,
        &item->stop,
        on_progress,
        item,
        queue->setup.fields,
        queue->setup.analyses,
        queue->setup.processors,
        on_preview,
    };
    struct solve_outcome outcome;
    solve_job(&task, &outcome);
    metrics_add(queue->setup.metrics, METRIC_ITERATIONS, outcome.iterations);
    finish_job(queue, item, &outcome);
    free(outcome.report);
    free(outcome.progress);
}

/* Under the lock. */
static void wait_for_work(struct queue *queue)
{
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += LOOK_MS / 1000;
    pthread_cond_timedwait(&queue->work, &queue->lock, &until);
    queue->looked_ms = clock_monotonic_ms();
}

static void *worker_main(void *arg)
{
    struct queue *queue = arg;
    pthread_mutex_lock(&queue->lock);
    while (!queue->draining) {
        struct item *item = queue->held ? NULL : (struct item *)line_take(queue->line);
        if (item == NULL) {
            wait_for_work(queue);
            continue;
        }
        struct place place = item->place; /* the item may be gone when its worker has done with it */
        struct job job = {
            .status = JOB_RUNNING, .revision = item->job.revision, .created_ms = item->job.created_ms};
        memcpy(job.id, item->job.id, sizeof job.id);
        memcpy(job.owner, item->job.owner, sizeof job.owner);
        queue->busy++;
        pthread_mutex_unlock(&queue->lock);
        work_on(queue, &job);
        pthread_mutex_lock(&queue->lock);
        queue->busy--;
        queue->looked_ms = clock_monotonic_ms();
        line_give_back(queue->line, place.share, place.memory);
        pthread_cond_broadcast(&queue->work); /* quota and memory may be there for more than one */
    }
    pthread_mutex_unlock(&queue->lock);
    return NULL;
}

/* ---- the interface ------------------------------------------------------------------------------------ */

struct queue *queue_new(const struct queue_setup *setup)
{
    struct queue *queue = calloc(1, sizeof *queue);
    if (queue == NULL)
        return NULL;
    queue->line = line_new(setup->keys, setup->limits);
    queue->worker = calloc(setup->workers, sizeof *queue->worker);
    if (queue->line == NULL || queue->worker == NULL) {
        line_free(queue->line);
        free(queue->worker);
        free(queue);
        return NULL;
    }
    queue->setup = *setup;
    pthread_mutex_init(&queue->lock, NULL);
    pthread_condattr_t attr;
    pthread_condattr_init(&attr);
    pthread_condattr_setclock(&attr, CLOCK_MONOTONIC);
    pthread_cond_init(&queue->work, &attr);
    pthread_condattr_destroy(&attr);
    queue->looked_ms = clock_monotonic_ms();
    return queue;
}

static int restore(const struct job *job, void *data)
{
    struct queue *queue = data;
    struct job copy;
    if (job_copy(job, &copy) != 0)
        return -1;
    struct item *item = item_new(queue, &copy);
    pthread_mutex_lock(&queue->lock);
    int failed = item == NULL ? -1 : own_item(queue, item);
    if (!failed)
        enter_item(queue, item);
    pthread_mutex_unlock(&queue->lock);
    if (failed)
        free_item(item);
    job_done(&copy);
    return failed;
}

int queue_start(struct queue *queue, struct problem *reterr)
{
    if (store_recover(queue->setup.store, QUEUE_MAX_CRASHES, clock_wall_ms(), restore, queue, reterr) != 0)
        return -1;
    pthread_attr_t attr;
    pthread_attr_init(&attr);
    pthread_attr_setstacksize(&attr, WORKER_STACK_BYTES);
    for (; queue->workers < queue->setup.workers; queue->workers++) {
        if (pthread_create(&queue->worker[queue->workers], &attr, worker_main, queue) != 0)
            break;
        pthread_setname_np(queue->worker[queue->workers], "drape-worker");
    }
    pthread_attr_destroy(&attr);
    if (queue->workers < queue->setup.workers)
        return problem_set(reterr, PROBLEM_INTERNAL, "A worker thread could not be started.");
    return 0;
}

/* See queue_retry_s. Under the lock. */
static unsigned retry_s(const struct queue *queue, size_t ahead)
{
    double s = ceil(queue->run_ms * (double)ahead / queue->setup.workers / 1000);
    return s < 1 ? 1 : s < QUEUE_RETRY_MAX_S ? (unsigned)s : QUEUE_RETRY_MAX_S;
}

unsigned queue_retry_s(struct queue *queue, size_t ahead)
{
    pthread_mutex_lock(&queue->lock);
    unsigned s = retry_s(queue, ahead);
    pthread_mutex_unlock(&queue->lock);
    return s;
}

/* The same refusal, with when to come again. Under the lock. */
static int come_again(const struct queue *queue, size_t ahead, struct problem *reterr)
{
    if (reterr != NULL)
        reterr->retry_s = retry_s(queue, ahead);
    return -1;
}

/* A place is free once a job ends; one of the owner's, once its next job starts. Under the lock. */
static int admits(const struct queue *queue, const char *owner, struct problem *reterr)
{
    size_t limit = queue->setup.limits->queued_jobs, queued = line_queued(queue->line, owner);
    if (queue->draining)
        return problem_set(reterr, PROBLEM_DRAINING, "The server is shutting down.");
    if (queue->queued + queue->running >= limit) {
        problem_set(reterr, PROBLEM_QUEUE_FULL, "All %zu places are taken.", limit);
        return come_again(queue, 1, reterr);
    }
    if (queue->setup.keys == NULL || queued < keys_quota(queue->setup.keys, owner).queued)
        return 0;
    problem_set(reterr, PROBLEM_QUOTA_QUEUED, "%zu jobs of the key %s are queued.", queued, owner);
    return come_again(queue, line_next(queue->line, owner), reterr);
}

int queue_admits(struct queue *queue, const char *owner, struct problem *reterr)
{
    pthread_mutex_lock(&queue->lock);
    int result = admits(queue, owner, reterr);
    pthread_mutex_unlock(&queue->lock);
    return result;
}

/* The body that a job has as soon as it is in the line. It is made before the commit: what is answered is
 * kept with the job, to be given again word for word. */
static char *body_to_be(struct queue *queue, struct item *item)
{
    line_enter(queue->line, &item->place, false);
    char *body = body_of(queue, item);
    line_leave(queue->line, &item->place);
    return body;
}

/* Takes the item's place among the queued jobs, which it has from here on. 0 with the body that is answered,
 * or -1 with *reterr. */
static int reserve(struct queue *queue, struct item *item, char **ret_body, struct problem *reterr)
{
    if (item == NULL)
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    pthread_mutex_lock(&queue->lock);
    int failed = admits(queue, item->job.owner, reterr);
    if (!failed && own_item(queue, item) != 0)
        failed = problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    if (!failed && (*ret_body = body_to_be(queue, item)) == NULL) {
        disown_item(queue, item);
        failed = problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    }
    pthread_mutex_unlock(&queue->lock);
    return failed;
}

/* The store did not take a job: -1 with *reterr, or QUEUE_TAKEN. */
static int refuse_submission(int result, struct problem *reterr)
{
    if (result == STORE_TAKEN)
        return QUEUE_TAKEN;
    return result == STORE_WITHOUT
               ? problem_set(reterr, PROBLEM_INVALID, "A mesh of the job has just been removed.")
               : -1;
}

int queue_submit(struct queue *queue, struct job *job, struct store_submission *submission, char **ret_body,
                 struct problem *reterr)
{
    job->status = JOB_QUEUED;
    job->revision = (struct revision){1, 1};
    job->created_ms = clock_wall_ms();
    char id[ID_SIZE], *body = NULL;
    memcpy(id, job->id, sizeof id);
    struct item *item = item_new(queue, job);
    if (reserve(queue, item, &body, reterr) != 0) {
        store_start_drop(queue->setup.store, id);
        free_item(item);
        return -1;
    }
    submission->answer = body;
    int failed = store_job_add(queue->setup.store, &item->job, submission, reterr);
    pthread_mutex_lock(&queue->lock);
    if (failed)
        disown_item(queue, item);
    else
        enter_item(queue, item);
    pthread_mutex_unlock(&queue->lock);
    if (failed) {
        free_item(item);
        free(body);
        return refuse_submission(failed, reterr);
    }
    metrics_add(queue->setup.metrics, METRIC_JOBS_ACCEPTED, 1);
    *ret_body = body;
    return 0;
}

int queue_body(struct queue *queue, const char *owner, const char *id, char **ret_body,
               struct revision *ret_revision)
{
    int result = QUEUE_NONE;
    pthread_mutex_lock(&queue->lock);
    const struct item *item = find(queue, owner, id);
    if (item != NULL) {
        *ret_body = body_of(queue, item);
        *ret_revision = item->job.revision;
        result = *ret_body == NULL ? -1 : 0;
    }
    pthread_mutex_unlock(&queue->lock);
    return result;
}

int queue_preview(struct queue *queue, const char *owner, const char *id, char **ret, size_t *ret_bytes,
                  struct revision *ret_since)
{
    int result = QUEUE_NONE;
    pthread_mutex_lock(&queue->lock);
    const struct item *item = find(queue, owner, id);
    if (item != NULL && item->preview != NULL) {
        if ((*ret = malloc(item->preview_bytes)) != NULL)
            memcpy(*ret, item->preview, item->preview_bytes);
        *ret_bytes = item->preview_bytes;
        *ret_since = item->preview_since;
        result = *ret == NULL ? -1 : 0;
    }
    pthread_mutex_unlock(&queue->lock);
    return result;
}

int queue_follow(struct queue *queue, const char *owner, const char *id, struct revision seen,
                 struct follower *follower)
{
    int result = QUEUE_NONE;
    pthread_mutex_lock(&queue->lock);
    const struct item *item = find(queue, owner, id);
    char *body = item == NULL ? NULL : body_of(queue, item);
    if (item != NULL)
        result = body == NULL ? -1 : follower_add(follower, id, item->stream, seen, item->job.revision, body);
    pthread_mutex_unlock(&queue->lock);
    free(body);
    return result;
}

/* What cancelling needs to know of a job, read in one go. */
static bool look_at(struct queue *queue, const char *owner, const char *id, struct job *ret)
{
    memset(ret, 0, sizeof *ret);
    pthread_mutex_lock(&queue->lock);
    const struct item *item = find(queue, owner, id);
    if (item != NULL) {
        memcpy(ret->id, item->job.id, sizeof ret->id);
        memcpy(ret->owner, item->job.owner, sizeof ret->owner);
        ret->status = item->job.status;
        ret->revision = item->job.revision;
        ret->created_ms = item->job.created_ms;
    }
    pthread_mutex_unlock(&queue->lock);
    return item != NULL;
}

/* The store has the cancellation: makes it so here. Returns the body, NULL when out of memory. */
static char *show_cancel(struct queue *queue, const struct job *job, bool ended)
{
    char *body = NULL;
    pthread_mutex_lock(&queue->lock);
    struct item *item = find(queue, job->owner, job->id);
    if (item != NULL) {
        item->job.cancel = true;
        atomic_store(&item->stop, true);
        if (ended) {
            count_queued(queue, item, -1);
            item->job.status = JOB_CANCELED;
            item->job.finished_ms = job->finished_ms;
            item->job.revision = job->revision;
        }
        body = body_of(queue, item);
        if (ended)
            end_item(queue, item);
    }
    pthread_mutex_unlock(&queue->lock);
    return body;
}

int queue_cancel(struct queue *queue, const char *owner, const char *id, char **ret_body,
                 struct problem *reterr)
{
    struct job job;
    /* A job that starts or ends between the look and the write makes the write miss; then look again. */
    for (int look = 0; look_at(queue, owner, id, &job); look++) {
        bool waiting = job.status == JOB_QUEUED;
        job.finished_ms = time_after(job.created_ms);
        job.revision.counter += waiting;
        int result = waiting ? store_job_cancel_queued(queue->setup.store, &job, reterr)
                             : store_job_cancel_running(queue->setup.store, &job, reterr);
        if (result < 0)
            return -1;
        if (result == 0 && (*ret_body = show_cancel(queue, &job, waiting)) != NULL)
            return 0;
        if (look == CANCEL_LOOKS)
            return problem_set(reterr, PROBLEM_STORAGE, "The database does not know the job as it is.");
        wait_ms(1);
    }
    return QUEUE_NONE;
}

void queue_hold(struct queue *queue, bool held)
{
    pthread_mutex_lock(&queue->lock);
    if (queue->held && !held)
        pthread_cond_broadcast(&queue->work);
    queue->held = held;
    pthread_mutex_unlock(&queue->lock);
}

void queue_drain(struct queue *queue)
{
    pthread_mutex_lock(&queue->lock);
    queue->draining = true;
    pthread_cond_broadcast(&queue->work);
    pthread_mutex_unlock(&queue->lock);
}

unsigned queue_running(struct queue *queue)
{
    pthread_mutex_lock(&queue->lock);
    unsigned running = (unsigned)queue->running;
    pthread_mutex_unlock(&queue->lock);
    return running;
}

static void stop_item(const void *node, VISIT visit, void *data)
{
    struct item *item = *(struct item *const *)node;
    (void)data;
    if ((visit == postorder || visit == leaf) && item->job.status == JOB_RUNNING)
        atomic_store(&item->stop, true);
}

void queue_interrupt(struct queue *queue)
{
    queue_drain(queue);
    pthread_mutex_lock(&queue->lock);
    queue->interrupted = true;
    twalk_r(queue->tree, stop_item, NULL);
    pthread_mutex_unlock(&queue->lock);
}

static void free_node(void *item)
{
    free_item(item);
}

struct queue *queue_free(struct queue *queue)
{
    if (queue == NULL)
        return NULL;
    queue_drain(queue);
    for (unsigned i = 0; i < queue->workers; i++)
        pthread_join(queue->worker[i], NULL);
    tdestroy(queue->tree, free_node);
    line_free(queue->line);
    pthread_cond_destroy(&queue->work);
    pthread_mutex_destroy(&queue->lock);
    free(queue->worker);
    free(queue);
    return NULL;
}

void queue_count(struct queue *queue, size_t *ret_queued, size_t *ret_running)
{
    pthread_mutex_lock(&queue->lock);
    *ret_queued = queue->queued;
    *ret_running = queue->running;
    pthread_mutex_unlock(&queue->lock);
}

void queue_reconsider(struct queue *queue)
{
    pthread_mutex_lock(&queue->lock);
    pthread_cond_broadcast(&queue->work);
    pthread_mutex_unlock(&queue->lock);
}

static void find_oldest(const struct place *place, void *data)
{
    int64_t *oldest_ms = data, accepted_ms = ((const struct item *)place)->accepted_ms;
    if (accepted_ms < *oldest_ms)
        *oldest_ms = accepted_ms;
}

void queue_measure(struct queue *queue, struct queue_counts *ret)
{
    int64_t now = clock_monotonic_ms(), oldest_ms = now;
    pthread_mutex_lock(&queue->lock);
    ret->queued = queue->queued;
    ret->running = queue->running;
    ret->seen_ms = queue->busy < queue->workers && !queue->draining ? queue->looked_ms : now;
    line_heads(queue->line, find_oldest, &oldest_ms);
    pthread_mutex_unlock(&queue->lock);
    double oldest = (double)(now - oldest_ms) / 1000;
    metrics_set(queue->setup.metrics, METRIC_JOBS_QUEUED, (double)ret->queued);
    metrics_set(queue->setup.metrics, METRIC_JOBS_RUNNING, (double)ret->running);
    metrics_set(queue->setup.metrics, METRIC_OLDEST_QUEUED, oldest);
}
