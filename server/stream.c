/* stream.c - see stream.h. */
#include "stream.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"

/* queued, running, a preview and one more for each doubling of the iterations, end: what an attempt tells. */
#define KEPT_STATES 16

/* What browsers should wait before they come back, ms. */
#define RETRY_LINE "retry: 3000\n\n"

/* A comment: nobody is told anything by it, but a peer that is gone shows. */
#define HEARTBEAT ":\n\n"

struct event { /* shared by the stream and by those sending it; count under the hub's lock */
    unsigned holders;
    enum stream_kind kind;
    struct revision revision;
    size_t bytes;
    char text[]; /* as it goes over the wire, after the line of the id */
};

struct stream {
    struct hub *hub;
    unsigned holders;
    struct track *tracks;             /* of those who follow it */
    struct event *state[KEPT_STATES]; /* oldest first */
    size_t states;
    struct event *progress; /* newest; NULL: none yet */
};

struct track {                 /* one job of a follower */
    struct track *prev, *next; /* of the same stream */
    struct follower *follower;
    struct stream *stream;
    char id[ID_SIZE];
    struct revision seen; /* newer events are still to come */
    struct revision told; /* the newest that went out, now or to an earlier stream; {0,0}: none */
    struct event *first;  /* the snapshot to begin with; NULL: none, or taken */
    bool ended;           /* its end was told */
};

struct part { /* of what is going out */
    const char *at;
    size_t bytes;
};

struct follower {
    struct follower *prev, *next;
    struct hub *hub;
    char owner[KEY_NAME_SIZE];
    bool named;            /* its ids name the job of each revision */
    struct event *sending; /* NULL: none */
    struct part part[2];   /* what is left of the line of the id and of the event, or of something fixed */
    char *id_line;
    size_t id_size;
    bool beat; /* a heartbeat is due */
    int64_t active_ms;
    void (*wake)(void *data);
    void *data;
    size_t tracks, room, turn; /* turn: the track that is asked first for the next event */
    struct track track[];
};

struct retired { /* the stream of a job that has ended, for those who come back */
    char id[ID_SIZE];
    struct stream *stream;
    int64_t ended_ms;
};

struct hub {
    pthread_mutex_t lock; /* guards everything in this file */
    struct follower *followers;
    size_t count, max, max_of_owner;
    struct retired retired[STREAM_RETIRED]; /* a ring, oldest first */
    size_t oldest, retireds;
    bool closed;
};

static const char *const kind_name[] = {"state", "progress", "preview", "end"};

struct hub *hub_new(size_t max_followers, size_t max_of_owner)
{
    struct hub *hub = calloc(1, sizeof *hub);
    if (hub == NULL)
        return NULL;
    pthread_mutex_init(&hub->lock, NULL);
    hub->max = max_followers;
    hub->max_of_owner = max_of_owner;
    return hub;
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

/* ---- events and streams; helpers run under the lock --------------------------------------------------- */

static struct event *event_new(enum stream_kind kind, struct revision revision, const char *body)
{
    size_t room = strlen(body) + 64;
    struct event *event = malloc(sizeof *event + room);
    if (event == NULL)
        return NULL;
    event->holders = 1;
    event->kind = kind;
    event->revision = revision;
    event->bytes = (size_t)snprintf(event->text, room, "event: %s\ndata: %s\n\n", kind_name[kind], body);
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
    for (struct track *t = stream->tracks; t != NULL; t = t->next)
        wake(t->follower);
    pthread_mutex_unlock(&hub->lock);
}

/* ---- streams of jobs that have ended ------------------------------------------------------------------ */

/* Under the lock. */
static void drop_oldest(struct hub *hub)
{
    release_stream(hub->retired[hub->oldest].stream);
    hub->oldest = (hub->oldest + 1) % STREAM_RETIRED;
    hub->retireds--;
}

/* For want of memory the end may not be there: those who wait for it come back, and get the store's. */
static bool has_end(const struct stream *stream)
{
    return stream->states > 0 && stream->state[stream->states - 1]->kind == STREAM_END;
}

static void send_away(struct stream *stream)
{
    for (struct track *t = stream->tracks; t != NULL; t = t->next) {
        t->ended = true;
        wake(t->follower);
    }
    release_stream(stream);
}

void stream_retire(struct stream *stream, const char *id)
{
    struct hub *hub = stream->hub;
    pthread_mutex_lock(&hub->lock);
    if (!has_end(stream)) {
        send_away(stream);
        pthread_mutex_unlock(&hub->lock);
        return;
    }
    event_release(stream->progress); /* the end says more */
    stream->progress = NULL;
    if (hub->retireds == STREAM_RETIRED)
        drop_oldest(hub);
    struct retired *r = &hub->retired[(hub->oldest + hub->retireds++) % STREAM_RETIRED];
    memcpy(r->id, id, strnlen(id, sizeof r->id - 1) + 1);
    r->stream = stream;
    r->ended_ms = clock_monotonic_ms();
    pthread_mutex_unlock(&hub->lock);
}

/* NULL: none, or no longer. Under the lock. */
static struct stream *find_retired(const struct hub *hub, const char *id)
{
    for (size_t i = 0; i < hub->retireds; i++) {
        const struct retired *r = &hub->retired[(hub->oldest + i) % STREAM_RETIRED];
        if (strcmp(r->id, id) == 0)
            return r->stream;
    }
    return NULL;
}

struct hub *hub_free(struct hub *hub)
{
    if (hub == NULL)
        return NULL;
    while (hub->retireds > 0)
        drop_oldest(hub);
    pthread_mutex_destroy(&hub->lock);
    free(hub);
    return NULL;
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
    while (hub->retireds > 0 && now_ms - hub->retired[hub->oldest].ended_ms >= STREAM_RETIRED_MS)
        drop_oldest(hub);
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

/* ---- event ids ---------------------------------------------------------------------------------------- */

/* One id=revision of a list, moving *at behind it; false where it is none. */
static bool take_entry(const char **at, char ret_id[ID_SIZE], struct revision *ret)
{
    char text[REVISION_SIZE];
    size_t bytes = strcspn(*at, "=");
    if (bytes != ID_SIZE - 1 || (*at)[bytes] != '=')
        return false;
    memcpy(ret_id, *at, bytes);
    ret_id[bytes] = '\0';
    *at += bytes + 1;
    bytes = strcspn(*at, ",");
    if (bytes >= sizeof text || !id_valid(ret_id))
        return false;
    memcpy(text, *at, bytes);
    text[bytes] = '\0';
    *at += bytes;
    return revision_parse(text, ret) == 0;
}

struct revision stream_seen(const char *last_event_id, const char *id)
{
    const struct revision none = {0, 0};
    struct revision seen = none, revision;
    char entry[ID_SIZE];
    for (const char *at = last_event_id; at != NULL; at++) {
        if (!take_entry(&at, entry, &revision))
            return none;
        if (strcmp(entry, id) == 0)
            seen = revision;
        if (*at == '\0')
            break;
    }
    return seen;
}

static size_t id_line_size(size_t jobs)
{
    return sizeof "id: \n" + jobs * (ID_SIZE + REVISION_SIZE);
}

/* What this follower has been told by now, as stream_seen reads it. Under the lock. */
static struct part write_id(struct follower *f)
{
    char text[REVISION_SIZE];
    size_t n = (size_t)snprintf(f->id_line, f->id_size, "id: ");
    size_t empty = n;
    for (size_t i = 0; i < f->tracks; i++) {
        const struct track *t = &f->track[i];
        if (t->told.attempt == 0)
            continue;
        revision_format(t->told, text);
        const char *comma = n > empty ? "," : "";
        n += (size_t)snprintf(f->id_line + n, f->id_size - n, f->named ? "%s%s=%s" : "%.0s%.0s%s", comma,
                              t->id, text);
    }
    n += (size_t)snprintf(f->id_line + n, f->id_size - n, "\n");
    return (struct part){f->id_line, n};
}

/* ---- followers ---------------------------------------------------------------------------------------- */

static bool is_none(struct revision revision)
{
    return revision.attempt == 0 && revision.counter == 0;
}

/* How many followers one owner has. Under the lock. */
static size_t count_of(const struct hub *hub, const char *owner)
{
    size_t count = 0;
    for (const struct follower *f = hub->followers; f != NULL; f = f->next)
        count += strcmp(f->owner, owner) == 0;
    return count;
}

/* Enters it in the hub; see follower_new for what it returns. */
static int enter_follower(struct hub *hub, struct follower *f)
{
    int full = 0;
    pthread_mutex_lock(&hub->lock);
    if (hub->count >= hub->max)
        full = STREAM_FULL;
    else if (f->owner[0] != '\0' && count_of(hub, f->owner) >= hub->max_of_owner)
        full = STREAM_OWNER_FULL;
    if (!full) {
        f->next = hub->followers;
        if (f->next != NULL)
            f->next->prev = f;
        hub->followers = f;
        hub->count++;
    }
    pthread_mutex_unlock(&hub->lock);
    return full;
}

int follower_new(struct hub *hub, const char *owner, size_t jobs, bool named, void (*wake_fn)(void *data),
                 void *data, struct follower **ret)
{
    struct follower *f = calloc(1, sizeof *f + jobs * sizeof f->track[0]);
    if (f == NULL || (f->id_line = malloc(id_line_size(jobs))) == NULL) {
        free(f);
        return -1;
    }
    snprintf(f->owner, sizeof f->owner, "%s", owner);
    f->hub = hub;
    f->id_size = id_line_size(jobs);
    f->room = jobs;
    f->named = named;
    f->wake = wake_fn;
    f->data = data;
    f->active_ms = clock_monotonic_ms();
    f->part[0] = (struct part){RETRY_LINE, strlen(RETRY_LINE)};
    int full = enter_follower(hub, f);
    if (full) {
        free(f->id_line);
        free(f);
        return full;
    }
    *ret = f;
    return 0;
}

/* The follower's next track, of `stream`, which it holds. Under the lock. */
static struct track *add_track(struct follower *f, const char *id, struct stream *stream,
                               struct revision seen)
{
    struct track *t = &f->track[f->tracks++];
    *t = (struct track){.follower = f, .stream = stream, .seen = seen, .told = seen, .next = stream->tracks};
    memcpy(t->id, id, strnlen(id, sizeof t->id - 1) + 1);
    if (t->next != NULL)
        t->next->prev = t;
    stream->tracks = t;
    stream->holders++;
    return t;
}

int follower_add(struct follower *follower, const char *id, struct stream *stream, struct revision seen,
                 struct revision revision, const char *body)
{
    struct event *first = NULL;
    if (is_none(seen) && (first = event_new(STREAM_STATE, revision, body)) == NULL)
        return -1;
    pthread_mutex_lock(&follower->hub->lock);
    struct track *t = add_track(follower, id, stream, seen);
    t->first = first;
    if (first != NULL)
        t->seen = revision;
    pthread_mutex_unlock(&follower->hub->lock);
    return 0;
}

int follower_add_ended(struct follower *follower, const char *id, struct revision seen,
                       struct revision revision, const char *body)
{
    struct hub *hub = follower->hub;
    struct stream *stream = stream_new(hub);
    if (stream == NULL)
        return -1;
    stream_publish(stream, STREAM_END, revision, body);
    pthread_mutex_lock(&hub->lock);
    /* Who comes back is owed the states since; who comes first is served with how it ended. */
    struct stream *retired = is_none(seen) ? NULL : find_retired(hub, id);
    struct track *t = add_track(follower, id, retired != NULL ? retired : stream, seen);
    t->ended = revision_compare(seen, revision) >= 0;
    release_stream(stream);
    bool told = t->ended || t->stream->states > 0;
    pthread_mutex_unlock(&hub->lock);
    return told ? 0 : -1;
}

/* The oldest kept event that this follower of the job has not seen; NULL: none. */
static struct event *next_event(const struct track *t)
{
    const struct stream *stream = t->stream;
    struct event *next = stream->progress;
    if (next != NULL && revision_compare(next->revision, t->seen) <= 0)
        next = NULL;
    for (size_t i = 0; i < stream->states; i++) {
        struct event *state = stream->state[i];
        if (revision_compare(state->revision, t->seen) > 0)
            return next == NULL || revision_compare(state->revision, next->revision) < 0 ? state : next;
    }
    return next;
}

/* The event of one job to send next, held for the follower; NULL: none. */
static struct event *take_event(struct track *t)
{
    struct event *event = t->first;
    if (event != NULL) {
        t->first = NULL; /* its hold passes on */
    } else if ((event = t->ended ? NULL : next_event(t)) != NULL) {
        event->holders++;
        t->seen = event->revision;
    } else {
        return NULL;
    }
    t->told = event->revision;
    t->ended |= event->kind == STREAM_END;
    return event;
}

/* Of all its jobs, each in its turn: one that has much to say does not silence the others. */
static struct event *take_any(struct follower *f)
{
    struct event *event = NULL;
    for (size_t i = 0; i < f->tracks && event == NULL; i++) {
        event = take_event(&f->track[f->turn]);
        f->turn = (f->turn + 1) % f->tracks;
    }
    return event;
}

/* Picks what goes out next; false: nothing. Under the lock. */
static bool pick(struct follower *f)
{
    event_release(f->sending);
    f->sending = take_any(f);
    if (f->sending != NULL) {
        f->part[0] = write_id(f);
        f->part[1] = (struct part){f->sending->text, f->sending->bytes};
    } else if (f->beat) {
        f->part[0] = (struct part){HEARTBEAT, strlen(HEARTBEAT)};
    } else {
        return false;
    }
    f->beat = false;
    return true;
}

/* Under the lock. */
static bool is_over(const struct follower *f)
{
    for (size_t i = 0; i < f->tracks; i++)
        if (!f->track[i].ended)
            return false;
    return true;
}

bool follower_over(struct follower *follower)
{
    pthread_mutex_lock(&follower->hub->lock);
    bool over = is_over(follower);
    pthread_mutex_unlock(&follower->hub->lock);
    return over;
}

static size_t copy_part(struct part *part, char *buffer, size_t max)
{
    size_t n = part->bytes < max ? part->bytes : max;
    if (n > 0)
        memcpy(buffer, part->at, n);
    part->at += n;
    part->bytes -= n;
    return n;
}

ssize_t follower_pull(struct follower *follower, char *buffer, size_t max)
{
    struct follower *f = follower;
    ssize_t result = -1;
    pthread_mutex_lock(&f->hub->lock);
    bool out = f->part[0].bytes + f->part[1].bytes == 0;
    if (out && (f->hub->closed || is_over(f)))
        goto cleanup;
    if (out && !pick(f)) {
        result = 0;
        goto cleanup;
    }
    size_t n = copy_part(&f->part[0], buffer, max);
    n += copy_part(&f->part[1], buffer + n, max - n);
    f->active_ms = clock_monotonic_ms();
    result = (ssize_t)n;

cleanup:
    pthread_mutex_unlock(&f->hub->lock);
    return result;
}

/* Under the lock. */
static void leave_stream(struct track *t)
{
    if (t->next != NULL)
        t->next->prev = t->prev;
    *(t->prev != NULL ? &t->prev->next : &t->stream->tracks) = t->next;
    event_release(t->first);
    release_stream(t->stream);
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
    for (size_t i = 0; i < f->tracks; i++)
        leave_stream(&f->track[i]);
    pthread_mutex_unlock(&hub->lock);
    free(f->id_line);
    free(f);
}
