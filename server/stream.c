/* stream.c - see stream.h. */
#include "stream.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"

/* queued, running, end: an attempt has three states; more are kept for jobs that a drain put back. */
#define KEPT_STATES 8

/* What browsers should wait before they come back, ms. */
#define RETRY_LINE "retry: 3000\n\n"

struct event { /* shared by the stream and by those sending it; count under the hub's lock */
    unsigned holders;
    enum stream_kind kind;
    struct revision revision;
    size_t bytes;
    char text[]; /* as it goes over the wire */
};

struct stream {
    struct hub *hub;
    unsigned holders;
    struct event *state[KEPT_STATES]; /* oldest first */
    size_t states;
    struct event *progress; /* newest; NULL: none yet */
};

struct follower {
    struct follower *prev, *next;
    struct hub *hub;
    struct stream *stream;
    struct revision seen;
    struct event *first;   /* the snapshot to begin with; NULL: none, or taken */
    struct event *sending; /* NULL: none */
    const char *text;      /* what is going out: of the event, a heartbeat, or the first line */
    size_t bytes, sent;
    bool beat;  /* a heartbeat is due */
    bool ended; /* the end event was taken */
    int64_t active_ms;
    void (*wake)(void *data);
    void *data;
};

struct hub {
    pthread_mutex_t lock; /* guards everything in this file */
    struct follower *followers;
    size_t count, max;
    bool closed;
};

static const char *const kind_name[] = {"state", "progress", "end"};

struct hub *hub_new(size_t max_followers)
{
    struct hub *hub = calloc(1, sizeof *hub);
    if (hub == NULL)
        return NULL;
    pthread_mutex_init(&hub->lock, NULL);
    hub->max = max_followers;
    return hub;
}

struct hub *hub_free(struct hub *hub)
{
    if (hub != NULL)
        pthread_mutex_destroy(&hub->lock);
    free(hub);
    return NULL;
}

unsigned hub_followers(struct hub *hub)
{
    pthread_mutex_lock(&hub->lock);
    unsigned count = (unsigned)hub->count;
    pthread_mutex_unlock(&hub->lock);
    return count;
}

static void wake(struct follower *f)
{
    if (f->wake != NULL)
        f->wake(f->data);
}

void hub_tick(struct hub *hub, int64_t now_ms)
{
    pthread_mutex_lock(&hub->lock);
    for (struct follower *f = hub->followers; f != NULL; f = f->next) {
        if (now_ms - f->active_ms < STREAM_HEARTBEAT_MS)
            continue;
        f->active_ms = now_ms;
        f->beat = true;
        wake(f);
    }
    pthread_mutex_unlock(&hub->lock);
}

void hub_close(struct hub *hub)
{
    pthread_mutex_lock(&hub->lock);
    hub->closed = true;
    for (struct follower *f = hub->followers; f != NULL; f = f->next)
        wake(f);
    pthread_mutex_unlock(&hub->lock);
}

/* ---- events and streams; helpers run under the lock --------------------------------------------------- */

static struct event *event_new(enum stream_kind kind, struct revision revision, const char *body)
{
    char id[REVISION_SIZE];
    revision_format(revision, id);
    size_t room = strlen(body) + 128;
    struct event *event = malloc(sizeof *event + room);
    if (event == NULL)
        return NULL;
    event->holders = 1;
    event->kind = kind;
    event->revision = revision;
    event->bytes =
        (size_t)snprintf(event->text, room, "id: %s\nevent: %s\ndata: %s\n\n", id, kind_name[kind], body);
    return event;
}

static void event_release(struct event *event)
{
    if (event != NULL && --event->holders == 0)
        free(event);
}

struct stream *stream_new(struct hub *hub)
{
    struct stream *stream = calloc(1, sizeof *stream);
    if (stream == NULL)
        return NULL;
    stream->hub = hub;
    stream->holders = 1;
    return stream;
}

static void release_stream(struct stream *stream)
{
    if (stream == NULL || --stream->holders > 0)
        return;
    for (size_t i = 0; i < stream->states; i++)
        event_release(stream->state[i]);
    event_release(stream->progress);
    free(stream);
}

void stream_release(struct stream *stream)
{
    if (stream == NULL)
        return;
    struct hub *hub = stream->hub;
    pthread_mutex_lock(&hub->lock);
    release_stream(stream);
    pthread_mutex_unlock(&hub->lock);
}

static void keep_event(struct stream *stream, struct event *event)
{
    if (event->kind == STREAM_PROGRESS) {
        event_release(stream->progress);
        stream->progress = event;
        return;
    }
    if (stream->states == KEPT_STATES) {
        event_release(stream->state[0]);
        memmove(stream->state, stream->state + 1, (KEPT_STATES - 1) * sizeof *stream->state);
        stream->states--;
    }
    stream->state[stream->states++] = event;
}

void stream_publish(struct stream *stream, enum stream_kind kind, struct revision revision, const char *body)
{
    struct event *event = event_new(kind, revision, body);
    if (event == NULL)
        return;
    struct hub *hub = stream->hub;
    pthread_mutex_lock(&hub->lock);
    keep_event(stream, event);
    for (struct follower *f = hub->followers; f != NULL; f = f->next)
        if (f->stream == stream)
            wake(f);
    pthread_mutex_unlock(&hub->lock);
}

/* The oldest kept event that the follower has not seen; NULL: none. */
static struct event *next_event(const struct follower *f)
{
    const struct stream *stream = f->stream;
    struct event *next = stream->progress;
    if (next != NULL && revision_compare(next->revision, f->seen) <= 0)
        next = NULL;
    for (size_t i = 0; i < stream->states; i++) {
        struct event *state = stream->state[i];
        if (revision_compare(state->revision, f->seen) > 0)
            return next == NULL || revision_compare(state->revision, next->revision) < 0 ? state : next;
    }
    return next;
}

/* ---- followers ---------------------------------------------------------------------------------------- */

/* Fills in the rest and enters it in the hub; takes over the caller's hold on f->stream. */
static int enter_follower(struct hub *hub, struct follower *f)
{
    f->hub = hub;
    f->active_ms = clock_monotonic_ms();
    f->text = RETRY_LINE;
    f->bytes = strlen(RETRY_LINE);
    pthread_mutex_lock(&hub->lock);
    bool full = hub->count >= hub->max;
    if (!full) {
        f->next = hub->followers;
        if (f->next != NULL)
            f->next->prev = f;
        hub->followers = f;
        hub->count++;
    } else {
        release_stream(f->stream);
        event_release(f->first);
    }
    pthread_mutex_unlock(&hub->lock);
    if (full)
        free(f);
    return full;
}

int follower_new(struct stream *stream, struct revision seen, struct revision revision, const char *body,
                 void (*wake_fn)(void *data), void *data, struct follower **ret)
{
    bool fresh = seen.attempt == 0 && seen.counter == 0;
    struct follower *f = calloc(1, sizeof *f);
    if (f == NULL || (fresh && (f->first = event_new(STREAM_STATE, revision, body)) == NULL)) {
        free(f);
        return -1;
    }
    pthread_mutex_lock(&stream->hub->lock);
    stream->holders++;
    pthread_mutex_unlock(&stream->hub->lock);
    f->seen = fresh ? revision : seen;
    f->stream = stream;
    f->wake = wake_fn;
    f->data = data;
    if (enter_follower(stream->hub, f) != 0)
        return 1;
    *ret = f;
    return 0;
}

int follower_new_ended(struct hub *hub, struct revision revision, const char *body, struct follower **ret)
{
    struct stream *stream = stream_new(hub);
    struct follower *f = calloc(1, sizeof *f);
    if (stream == NULL || f == NULL) {
        stream_release(stream);
        free(f);
        return -1;
    }
    stream_publish(stream, STREAM_END, revision, body);
    f->stream = stream;
    if (enter_follower(hub, f) != 0)
        return 1;
    *ret = f;
    return 0;
}

/* The event to send next, held for the follower; NULL: none. */
static struct event *take_event(struct follower *f)
{
    struct event *event = f->first;
    f->first = NULL;
    if (event != NULL)
        return event;
    event = next_event(f);
    if (event != NULL) {
        event->holders++;
        f->seen = event->revision;
    }
    return event;
}

/* Picks what goes out next; false: nothing. Under the lock. */
static bool pick(struct follower *f)
{
    event_release(f->sending);
    f->sending = take_event(f);
    if (f->sending != NULL) {
        f->ended = f->sending->kind == STREAM_END;
        f->text = f->sending->text;
        f->bytes = f->sending->bytes;
    } else if (f->beat) {
        f->text = ":\n\n";
        f->bytes = 3;
    } else {
        return false;
    }
    f->beat = false;
    f->sent = 0;
    return true;
}

ssize_t follower_pull(struct follower *follower, char *buffer, size_t max)
{
    struct follower *f = follower;
    ssize_t result = -1;
    pthread_mutex_lock(&f->hub->lock);
    if (f->sent == f->bytes && (f->ended || f->hub->closed))
        goto cleanup;
    if (f->sent == f->bytes && !pick(f)) {
        result = 0;
        goto cleanup;
    }
    size_t left = f->bytes - f->sent;
    size_t n = left < max ? left : max;
    memcpy(buffer, f->text + f->sent, n);
    f->sent += n;
    f->active_ms = clock_monotonic_ms();
    result = (ssize_t)n;

cleanup:
    pthread_mutex_unlock(&f->hub->lock);
    return result;
}

void follower_free(struct follower *follower)
{
    struct follower *f = follower;
    if (f == NULL)
        return;
    struct hub *hub = f->hub;
    pthread_mutex_lock(&hub->lock);
    if (f->next != NULL)
        f->next->prev = f->prev;
    *(f->prev != NULL ? &f->prev->next : &hub->followers) = f->next;
    hub->count--;
    event_release(f->sending);
    event_release(f->first);
    release_stream(f->stream);
    pthread_mutex_unlock(&hub->lock);
    free(f);
}
