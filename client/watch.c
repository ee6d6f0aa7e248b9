/* watch.c - see watch.h. */
#include "watch.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "interrupt.h"
#include "job.h"
#include "sse.h"

/* The server sends a heartbeat each 15 s: three missed ones and the connection counts as dead. */
#define STREAM_SILENCE_S 45L
/* Streams in a row that brought no event before polling takes over. */
#define BARREN_STREAMS 3
/* Between two streams (ms). */
#define RECONNECT_MS 500L
/* A long poll, within the contract's 25 s; short enough to show that something moves. */
#define POLL_S 2
/* Polls in a row that found no server before giving up: with RECONNECT_MS each, a restart's time. */
#define LOST_POLLS 20

struct watcher {
    struct meter *meter;
    FILE *lines;
    bool ended;
    size_t events; /* of the stream now open */
    struct sse sse;
};

static void pause_ms(long milliseconds)
{
    struct timespec t = {milliseconds / 1000, milliseconds % 1000 * 1000000L};
    nanosleep(&t, NULL); /* cut short by a signal, which is what we want */
}

static void print_line(const struct watcher *watcher, const char *name, json_t *data)
{
    json_t *line = json_pack("{s:s, s:s, s:O}", "event", name, "id", watcher->sse.last_id, "data", data);
    if (line) {
        json_dumpf(line, watcher->lines, JSON_COMPACT | JSON_PRESERVE_ORDER);
        fputc('\n', watcher->lines);
        fflush(watcher->lines);
    }
    json_decref(line);
}

/* The data of an event is a job body, or its progress alone. */
static void show(struct meter *meter, const json_t *data)
{
    const char *status = json_string_value(json_object_get(data, "status"));
    const json_t *progress = json_object_get(data, "progress");
    meter_progress(meter, progress ? progress : json_object_get(data, "iteration") ? data : NULL);
    if (status) {
        meter_status(meter, status);
    }
}

static int on_event(const char *name, const char *data, size_t bytes, void *user)
{
    struct watcher *watcher = user;
    json_t *json = json_loadb(data, bytes, 0, NULL);
    watcher->events++;
    if (json) {
        show(watcher->meter, json);
        if (watcher->lines) {
            print_line(watcher, name, json);
        }
    }
    json_decref(json);
    watcher->ended = strcmp(name, "end") == 0;
    return watcher->ended;
}

static int on_bytes(const char *data, size_t bytes, void *user)
{
    return sse_feed(&((struct watcher *)user)->sse, data, bytes);
}

/* One connection, until it ends. 0 when another may be tried, -1 when the server refuses (or Ctrl-C). */
static int stream_once(struct http *http, const char *path, struct watcher *watcher, struct failure *failure)
{
    struct http_request request = {.method = "GET",
                                   .path = path,
                                   .accept = "text/event-stream",
                                   .sink = on_bytes,
                                   .user = watcher,
                                   .silence_s = STREAM_SILENCE_S};
    struct http_reply reply;
    request.last_event_id = watcher->sse.last_id[0] ? watcher->sse.last_id : NULL;
    watcher->events = 0;
    sse_restart(&watcher->sse);
    int sent = http_send(http, &request, &reply, failure);
    bool refused = sent == 0 && reply.status != 200 && reply.status != 204;
    if (sent == 0 && reply.status == 204) {
        watcher->ended = true; /* the end was seen before */
    }
    http_reply_done(&reply);
    return refused || (sent < 0 && failure->code != EXIT_UNREACHABLE) ? -1 : 0;
}

static void stream(struct http *http, const char *path, struct watcher *watcher)
{
    struct failure ignored; /* polling reports what is still wrong */
    for (int barren = 0; barren < BARREN_STREAMS && !watcher->ended && !interrupt_seen();) {
        if (stream_once(http, path, watcher, &ignored) < 0) {
            break;
        }
        barren = watcher->events > 0 ? 0 : barren + 1;
        if (!watcher->ended) {
            pause_ms(RECONNECT_MS);
        }
    }
}

static int poll(struct http *http, const char *id, struct meter *meter, json_t **ret, struct failure *failure)
{
    for (int lost = 0; !interrupt_seen();) {
        json_t *job = NULL;
        if (job_get(http, id, POLL_S, &job, failure) < 0) {
            if (failure->code != EXIT_UNREACHABLE || ++lost >= LOST_POLLS) {
                return -1;
            }
            pause_ms(RECONNECT_MS);
            continue;
        }
        lost = 0;
        show(meter, job);
        if (job_ended(job)) {
            *ret = job;
            return 0;
        }
        json_decref(job);
        pause_ms(RECONNECT_MS); /* a server that does not know "wait" is not asked without pause */
    }
    return failure_set(failure, EXIT_INTERRUPTED, "interrupted");
}

int watch_job(struct http *http, const char *id, struct meter *meter, FILE *lines, json_t **ret,
              struct failure *failure)
{
    char path[JOB_PATH_SIZE];
    if (job_path(id, "/events", path, failure) < 0) {
        return -1;
    }
    struct watcher *watcher = calloc(1, sizeof *watcher);
    if (!watcher) {
        return failure_no_memory(failure);
    }
    watcher->meter = meter;
    watcher->lines = lines;
    watcher->sse.on_event = on_event;
    watcher->sse.user = watcher;
    interrupt_arm();
    stream(http, path, watcher);
    int status = poll(http, id, meter, ret, failure);
    meter_close(meter);
    free(watcher);
    if (status < 0 && interrupt_seen()) {
        failure_set(failure, EXIT_INTERRUPTED, "interrupted: job %s goes on at the server", id);
        failure_add(failure, "try: `drape watch %s` to follow it again, `drape cancel %s` to stop it", id,
                    id);
    }
    return status;
}
