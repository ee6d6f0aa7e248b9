/* stream.h - the numbered events of each job, and those who follow them, as server-sent events.
 *
 * A job's stream keeps its last few `state` events and its newest `progress`. A follower has a
 * revision, the newest it has seen, and is given what is newer, in order. Progress that a slow or broken
 * connection missed is not kept, by design; states are. Every event carries the whole job as GET would
 * show it, so one event is enough to know where things stand.
 *
 * A hub has one lock, which guards all its streams and followers. It may be taken under the queue's
 * lock; under it only a follower's `wake` runs, which may take the lock of http, and nothing else. */
#ifndef DRAPED_STREAM_H
#define DRAPED_STREAM_H

#include <stdint.h>
#include <sys/types.h>

#include "job.h"

struct hub;
struct stream;
struct follower;

enum stream_kind { STREAM_STATE = 0, STREAM_PROGRESS, STREAM_END };

#define STREAM_HEARTBEAT_MS 15000

struct hub *hub_new(size_t max_followers); /* NULL when out of memory */
struct hub *hub_free(struct hub *hub);     /* after its last stream and follower */
unsigned hub_followers(struct hub *hub);
void hub_tick(struct hub *hub, int64_t now_ms); /* monotonic; heartbeats to those long without news */
void hub_close(struct hub *hub);                /* ends every follower, now and from now on */

/* One job's stream, held by the job and by its followers; freed with the last. NULL: out of memory. */
struct stream *stream_new(struct hub *hub);
void stream_release(struct stream *stream); /* the job's hold; NULL is fine */

/* `body` is a job body (one line of JSON), copied. Without memory the event is lost, and whoever
 * follows sees the next. STREAM_END is the last. */
void stream_publish(struct stream *stream, enum stream_kind kind, struct revision revision, const char *body);

/* Follows from after `seen` on. With `seen` {0,0} it first gets what stands now, as a `state` event:
 * `body` at `revision`, which must be the newest published (hold the lock that orders publishing).
 * `wake` is called with the hub's lock held whenever there may be something to pull. 0, -1 when out of
 * memory, 1 when the hub has max_followers. */
int follower_new(struct stream *stream, struct revision seen, struct revision revision, const char *body,
                 void (*wake)(void *data), void *data, struct follower **ret);

/* A follower of a job that ended before: it gets `body` as its one and last event. */
int follower_new_ended(struct hub *hub, struct revision revision, const char *body, struct follower **ret);

/* The next bytes of the event stream (> 0), 0 for none yet, -1 after the end. */
ssize_t follower_pull(struct follower *follower, char *buffer, size_t max);
void follower_free(struct follower *follower); /* NULL is fine */

#endif
