/* sse.h - takes a text/event-stream apart (WHATWG HTML, "Server-sent events"); knows no sockets. */
#ifndef DRAPE_CLIENT_SSE_H
#define DRAPE_CLIENT_SSE_H

#include <stdbool.h>
#include <stddef.h>

/* A line or an event's data longer than this ends the stream with an error. */
#define SSE_MAX_BYTES 65536
#define SSE_ID_SIZE   128
#define SSE_NAME_SIZE 64

/* One event with data. Nonzero return ends the parsing. */
typedef int sse_event_fn(const char *name, const char *data, size_t bytes, void *user);

struct sse { /* zero-initialise, then set the first two members */
    sse_event_fn *on_event;
    void *user;
    char last_id[SSE_ID_SIZE]; /* of the newest whole event; survives reconnection */
    char id[SSE_ID_SIZE];      /* of the event being read */
    char name[SSE_NAME_SIZE];
    char line[SSE_MAX_BYTES], data[SSE_MAX_BYTES];
    size_t line_bytes, data_bytes;
    bool after_return; /* the last byte was a CR: a LF belongs to it */
};

/* Before a new connection: forgets what is half read, keeps last_id. */
void sse_restart(struct sse *sse);

/* Feeds bytes as they arrive, cut anywhere. 0, 1 when on_event asked to end, -1 when too long. */
int sse_feed(struct sse *sse, const char *bytes, size_t count);

#endif
