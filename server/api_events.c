/* api_events.c - jobs followed as server-sent events: one, or several in one stream. */
#include "api.h"

#include <stdlib.h>
#include <string.h>

#include "negotiate.h"

/* A look at a job that is committed and not in the queue yet, or that just left it, is repeated so often. */
#define LOOKS 3

struct feed { /* a follower and the connection it feeds */
    struct follower *follower;
    struct http_wake *wake;
};

static ssize_t pull_feed(void *data, char *buffer, size_t max)
{
    return follower_pull(((struct feed *)data)->follower, buffer, max);
}

static void end_feed(void *data)
{
    struct feed *feed = data;
    follower_free(feed->follower);
    free(feed);
}

static void wake_feed(void *data)
{
    http_wake(((struct feed *)data)->wake);
}

/* ---- opening a stream ------------------------------------------------------------------------------- */

static struct http_answer *answer_feed(struct call *call, size_t jobs, bool named, struct feed **ret,
                                       struct problem *reterr)
{
    struct feed *feed = calloc(1, sizeof *feed);
    struct http_answer *answer = feed == NULL
                                     ? NULL
                                     : http_answer_stream(http_of(call->request), "text/event-stream",
                                                          pull_feed, end_feed, feed, &feed->wake);
    int full = answer == NULL
                   ? -1
                   : follower_new(call->api->hub, call->owner, jobs, named, wake_feed, feed, &feed->follower);
    if (full) {
        http_answer_free(answer);
        problem_set(reterr, full < 0 ? PROBLEM_INTERNAL : PROBLEM_TOO_MANY_STREAMS, "%s",
                    full < 0                    ? "Out of memory."
                    : full == STREAM_OWNER_FULL ? "This key has too many event streams open."
                                                : "Too many event streams are open.");
        reterr->retry_s = queue_retry_s(call->api->queue, 1); /* streams end with their jobs */
        return NULL;
    }
    http_answer_header(answer, "Cache-Control", "no-store");
    http_answer_header(answer, "X-Accel-Buffering", "no");
    *ret = feed;
    return answer;
}

/* Begins the answer to a request for events of so many jobs; NULL when it was refused. */
static struct http_answer *open_feed(struct call *call, size_t jobs, bool named, struct feed **ret)
{
    static const char *const offer[] = {"text/event-stream"};
    struct problem problem;
    struct http_answer *answer = NULL;
    call->untimed = true;
    if (negotiate_accept(http_header(call->request, "Accept"), offer, 1) < 0)
        problem_set(&problem, PROBLEM_NOT_ACCEPTABLE, "Events come as text/event-stream.");
    else
        answer = answer_feed(call, jobs, named, ret, &problem);
    if (answer == NULL)
        call_problem(call, &problem);
    return answer;
}

/* Sends it, or 204 to whoever has seen the end of all: a browser then comes back no more. */
static void send_feed(struct call *call, struct http_answer *answer, const struct feed *feed)
{
    if (follower_over(feed->follower)) {
        http_answer_free(answer);
        answer = http_answer_empty(204);
    }
    http_send(call->request, answer);
}

/* On the clerk's thread. 0, STORE_NONE, STORE_GONE, or -1 with *reterr. */
static int follow(struct call *call, const char *id, struct revision seen, struct follower *follower,
                  struct problem *reterr)
{
    struct revision revision;
    char *body;
    bool ended;
    for (int look = 0; look < LOOKS; look++) {
        int found = job_look_up(call->api, call->owner, id, &body, &revision, &ended, reterr);
        if (found != 0)
            return found;
        int result = ended ? follower_add_ended(follower, id, seen, revision, body)
                           : queue_follow(call->api->queue, call->owner, id, seen, follower);
        free(body);
        if (result != QUEUE_NONE)
            return result == 0 ? 0 : problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    }
    return problem_set(reterr, PROBLEM_BUSY, "The job is changing hands.");
}

/* ---- one job ---------------------------------------------------------------------------------------- */

static struct revision last_event_id(const struct call *call)
{
    const char *header = http_header(call->request, "Last-Event-ID");
    struct revision seen = {0, 0};
    if (header != NULL && revision_parse(header, &seen) != 0) /* one that is none of ours starts afresh */
        seen = stream_seen(header, call->id);
    return seen;
}

/* On the clerk's thread. */
static void follow_stored(struct call *call)
{
    struct problem problem;
    struct feed *feed;
    struct http_answer *answer = open_feed(call, 1, false, &feed);
    if (answer == NULL)
        return;
    int found = follow(call, call->id, last_event_id(call), feed->follower, &problem);
    if (found == 0) {
        send_feed(call, answer, feed);
    } else {
        http_answer_free(answer);
        job_refuse_unknown(call, found, &problem);
    }
}

void job_events(struct call *call)
{
    struct feed *feed;
    struct http_answer *answer = open_feed(call, 1, false, &feed);
    if (answer == NULL)
        return;
    int found = queue_follow(call->api->queue, call->owner, call->id, last_event_id(call), feed->follower);
    if (found == 0) {
        http_send(call->request, answer);
        return;
    }
    http_answer_free(answer);
    if (found == QUEUE_NONE)
        call_defer(call, call->api->clerk, follow_stored);
    else
        http_send(call->request, NULL);
}

/* ---- several jobs ----------------------------------------------------------------------------------- */

/* The ids that the query names, malloc'd; NULL with *reterr. */
static char (*read_jobs(const struct call *call, size_t *ret_count, struct problem *reterr))[ID_SIZE]
{
    size_t limit = call->api->config->limits.stream_jobs, n = 0;
    char(*id)[ID_SIZE] = calloc(limit, sizeof *id), next[ID_SIZE];
    int given = 1;
    if (id == NULL) {
        problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
        return NULL;
    }
    for (; (given = http_query_nth(call->request, "job", n, next, sizeof next)) == 0; n++) {
        bool twice = false;
        for (size_t i = 0; i < n && n < limit; i++)
            twice |= strcmp(id[i], next) == 0;
        if (n == limit || twice || !id_valid(next))
            break;
        memcpy(id[n], next, sizeof next);
    }
    *ret_count = n;
    if (n > 0 && given > 0)
        return id;
    free(id);
    if (n == limit)
        problem_set(reterr, PROBLEM_BAD_REQUEST, "One stream follows at most %zu jobs.", limit);
    else if (given > 0)
        problem_set(reterr, PROBLEM_BAD_REQUEST, "The query must name the jobs: ?job=ID&job=ID.");
    else
        problem_set(reterr, PROBLEM_BAD_REQUEST,
                    "Argument %zu named job is no job's id, or one given before.", n + 1);
    return NULL;
}

/* Adds all of them; 0, or answers. */
static int follow_all(struct call *call, char (*id)[ID_SIZE], size_t jobs, struct follower *follower)
{
    struct problem problem;
    const char *header = http_header(call->request, "Last-Event-ID");
    for (size_t i = 0; i < jobs; i++) {
        int found = follow(call, id[i], stream_seen(header, id[i]), follower, &problem);
        if (found == 0)
            continue;
        if (found > 0)
            problem_set(&problem, found == STORE_GONE ? PROBLEM_GONE : PROBLEM_NOT_FOUND,
                        found == STORE_GONE ? "The job %s was removed." : "There is no job %s.", id[i]);
        call_problem(call, &problem);
        return -1;
    }
    return 0;
}

void jobs_events(struct call *call)
{
    struct problem problem;
    struct feed *feed;
    size_t jobs;
    char(*id)[ID_SIZE] = read_jobs(call, &jobs, &problem);
    if (id == NULL) {
        call_problem(call, &problem);
        return;
    }
    struct http_answer *answer = open_feed(call, jobs, true, &feed);
    if (answer != NULL && follow_all(call, id, jobs, feed->follower) == 0)
        send_feed(call, answer, feed);
    else
        http_answer_free(answer);
    free(id);
}
