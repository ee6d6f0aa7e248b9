/* stream.h - the numbered events of each job, and those who follow them, as server-sent events.
 *
 * A job's stream keeps its last few `state` events, a `preview` among them, and its newest `progress`. A
 * follower has for each of its jobs a revision, the newest it has seen, and is given what is newer, in order.
 * Progress that a slow or broken connection missed is not kept, by design; states are, and for a minute
 * beyond the job's end. Every event carries the whole job as GET would show it, so one event is enough to
 * know where things stand.
 *
 * The id of an event is what its follower has been told by then. For one job that is the revision, "1.5"; for
 * several it is a list of job=revision with commas in between, without the jobs of which nothing was told.
 *
 * A hub has one lock, which guards all its streams and followers. It may be taken under the queue's
 * lock; under it only a follower's `wake` runs, which may take the lock of http, and nothing else. */
#ifndef DRAPED_STREAM_H
#define DRAPED_STREAM_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

#include "job.h"

struct hub;
struct stream;
struct follower;

enum stream_kind { STREAM_STATE = 0, STREAM_PROGRESS, STREAM_PREVIEW, STREAM_END };

#define STREAM_HEARTBEAT_MS 15000

/* The streams of so many jobs that ended are kept for those who come back, for so long (ms): browsers
 * do after `retry`. Some ten kilobytes each. */
#define STREAM_RETIRED    1024
#define STREAM_RETIRED_MS 60000

struct hub *hub_new(size_t max_followers, size_t max_of_owner); /* NULL when out of memory */
struct hub *hub_free(struct hub *hub);                          /* after its last follower */
unsigned hub_followers(struct hub *hub);
void hub_tick(struct hub *hub, int64_t now_ms); /* monotonic; heartbeats to those long without news */
void hub_close(struct hub *hub);                /* ends every follower, now and from now on */

/* One job's stream, held by the job and by its followers; freed with the last. NULL: out of memory. */
struct stream *stream_new(struct hub *hub);
void stream_release(struct stream *stream);                /* the job's hold; NULL is fine */
void stream_retire(struct stream *stream, const char *id); /* the same, once job `id` has ended */

/* `body` is a job body (one line of JSON), copied. Without memory the event is lost, and whoever
 * follows sees the next. STREAM_END is the last. */
void stream_publish(struct stream *stream, enum stream_kind kind, struct revision revision, const char *body);

/* A follower of up to `jobs` jobs, to be added before the first pull. With `named` its ids are lists.
 * `wake` is called with the hub's lock held whenever there may be something to pull. 0, -1 when out of
 * memory, STREAM_FULL when the hub has max_followers, STREAM_OWNER_FULL when `owner` has max_of_owner ("":
 * nobody's, not counted). */
int follower_new(struct hub *hub, const char *owner, size_t jobs, bool named, void (*wake)(void *data),
                 void *data, struct follower **ret);
#define STREAM_FULL       1
#define STREAM_OWNER_FULL 2

/* Follows job `id` from after `seen` on. With `seen` {0,0} it first gets what stands now, as a `state` event:
 * `body` at `revision`, which must be the newest published (hold the lock that orders publishing). 0, or -1
 * when out of memory. */
int follower_add(struct follower *follower, const char *id, struct stream *stream, struct revision seen,
                 struct revision revision, const char *body);

/* The same for a job that has ended with `body` at `revision`: what is kept of the states after `seen`, and
 * the end, unless that was seen. */
int follower_add_ended(struct follower *follower, const char *id, struct revision seen,
                       struct revision revision, const char *body);

bool follower_over(struct follower *follower); /* whether all its jobs have ended, and it was told */

/* What a list of job=revision says of job `id`; {0,0}: nothing, or it is no such list. NULL is fine. */
struct revision stream_seen(const char *last_event_id, const char *id);

/* The next bytes of the event stream (> 0), 0 for none yet, -1 after the end. */
ssize_t follower_pull(struct follower *follower, char *buffer, size_t max);
void follower_free(struct follower *follower); /* NULL is fine */

#endif
