/* http.h - one request to the server at a time, over libcurl; knows no routes. */
#ifndef DRAPE_CLIENT_HTTP_H
#define DRAPE_CLIENT_HTTP_H

#include <stdbool.h>
#include <stddef.h>

#include "failure.h"

struct http; /* a connection kept alive between requests; one thread at a time */

/* Bodies of answers beyond this are refused (a million vertices as JSON text are about 0.2 GB). */
#define HTTP_MAX_BODY ((size_t)1 << 30)

/* `url` such as "http://127.0.0.1:8080"; `key` is sent as a bearer token, NULL: none. Both are copied. */
int http_new(const char *url, const char *key, struct http **ret, struct failure *failure);
struct http *http_free(struct http *http);     /* NULL is fine; returns NULL */
const char *http_url(const struct http *http); /* without a final slash; lives as long as http */

/* A piece of the body as it arrives; a nonzero return ends the transfer, which then counts as complete. */
typedef int http_sink_fn(const char *data, size_t bytes, void *user);

struct http_request {
    const char *method; /* "GET" */
    const char *path;   /* "/v1/jobs" */
    const char *body;   /* NULL: none; JSON */
    size_t bytes;
    const char *prefer; /* header values; NULL: not sent */
    const char *accept, *last_event_id;
    http_sink_fn *sink; /* where a body of status 200 goes; NULL: into the reply */
    void *user;
    long silence_s; /* give up when nothing has come for so long; 0: the default, 60 */
};

struct http_reply { /* zero-initialise */
    long status;
    char *body; /* NUL-terminated; never NULL after success */
    size_t bytes;
    char content_type[128], request_id[128], retry_after[64]; /* "" when absent */
    char link[1024];
};

void http_reply_done(struct http_reply *reply); /* empties without freeing the struct */

/* 0 when an answer came, whatever its status; -1 with *failure (EXIT_UNREACHABLE, EXIT_INTERRUPTED,
 * EXIT_LOCAL) when none did. *reply is to be emptied in both cases. */
int http_send(struct http *http, const struct http_request *request, struct http_reply *reply,
              struct failure *failure);

#endif
