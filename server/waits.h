/* waits.h - requests that wait for a job to change or to end (Prefer: wait), until their time is up.
 *
 * One lock inside, a leaf but for the locks that answering takes (http's). Each waiting request is
 * answered exactly once: by waits_changed, by waits_tick, or by waits_close. */
#ifndef DRAPED_WAITS_H
#define DRAPED_WAITS_H

#include <stdbool.h>
#include <stdint.h>

#include "job.h"

struct http_request;
struct waits;

struct wait_answers {
    /* The job changed as wished for; must not block. May run with the queue's lock held. */
    void (*changed)(struct http_request *request, struct revision revision, bool ended, const char *body,
                    void *data);
    /* Time is up (or the client has gone, or the server stops): answer with the job as it stands. */
    void (*expired)(struct http_request *request, void *data);
    bool (*deserted)(const struct http_request *request); /* whether the client has gone; must not block */
    void *data;
};

/* As long as a request may wait, whatever it asks for, s. */
#define WAIT_MAX_S 25

struct waits *waits_new(const struct wait_answers *answers); /* NULL when out of memory */
struct waits *waits_free(struct waits *waits);               /* none may be waiting any more */

/* Waits for job `id` to end, or with `seen` not {0,0} to pass that revision. `request` is suspended.
 * After it the caller looks whether that happened just before, and calls waits_changed itself if so.
 * 0, or -1 when out of memory or closed: then the caller answers. */
int waits_add(struct waits *waits, struct http_request *request, const char *id, struct revision seen,
              int64_t deadline_ms);

/* What became of a job: answers those it satisfies. The queue's `changed` hook. */
void waits_changed(struct waits *waits, const char *id, struct revision revision, bool ended,
                   const char *body);
/* Monotonic: answers those whose time is up, and those whose clients have gone: their connections are free.
 */
void waits_tick(struct waits *waits, int64_t now_ms);
void waits_close(struct waits *waits); /* answers all; no more are taken */

#endif
