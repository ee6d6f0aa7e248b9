/* executor.h - one thread that runs tasks in the order they came, from a bounded queue.
 *
 * It keeps what may block (the disk, a large body) off the HTTP thread. Tasks run without any lock
 * held. */
#ifndef DRAPED_EXECUTOR_H
#define DRAPED_EXECUTOR_H

#include <stddef.h>
#include <stdint.h>

struct executor;

typedef void executor_fn(void *data);

/* `name` shows in debuggers (15 bytes at most); NULL when out of memory or threads. */
struct executor *executor_new(const char *name, size_t capacity);

/* Any thread. 0, or -1 when `capacity` tasks are waiting or running: then nothing was done. */
int executor_submit(struct executor *executor, executor_fn *run, void *data);

/* Any thread. The monotonic time at which it was last seen to get on: now where nothing waits or runs, else
 * when the task that runs began. */
int64_t executor_seen_ms(struct executor *executor);

/* Runs what is waiting, ends the thread, frees. NULL is fine; returns NULL. */
struct executor *executor_free(struct executor *executor);

#endif
