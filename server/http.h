/* http.h - libmicrohttpd behind a border: listeners, framing checks, deadlines, spooled bodies,
 * answers from any thread. Knows no routes and no jobs.
 *
 * Each struct http has one loop thread that owns its sockets. It calls, in this order for a request:
 *
 *   begin     the headers are in. May answer (http_send), or ask for a body (http_expect_body).
 *   handle    the whole body, if any, is in a spool file. Must answer, or call http_suspend and see to
 *             it that some thread answers later, exactly once.
 *   finished  the answer is out, or the client is gone. The request is freed after it.
 *
 * None of the three may block. A request may be read by whoever is to answer it, until it does. One
 * lock inside guards the connection list and the suspended flags; libmicrohttpd's own lock is taken
 * under it and never the other way round, and none of the callbacks is called with it held. */
#ifndef DRAPED_HTTP_H
#define DRAPED_HTTP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/socket.h>
#include <sys/types.h>

#include "encoding.h"
#include "problem.h"

struct http;
struct http_request;
struct http_answer;
struct http_wake;

struct http_setup {
    int listen_fd;         /* bound and listening; owned by the http from a successful start on */
    unsigned connections;  /* limit; further ones wait in the backlog */
    size_t spool_bytes;    /* of all bodies being held together; 503 busy beyond */
    const char *spool_dir; /* where unnamed temporary files are made; NULL: no bodies at all */
    void (*begin)(struct http_request *request, void *data);
    void (*handle)(struct http_request *request, void *data);
    /* NULL: nobody. An answer is about to leave, on the loop thread: the last moment to add headers. */
    void (*leaving)(struct http_request *request, struct http_answer *answer, void *data);
    void (*finished)(struct http_request *request, int status, int64_t milliseconds, void *data);
    void *data;
};

/* Slow clients are cut: a head has this long from the connection's start or its last answer; a body,
 * and an answer's way out, this long plus what HTTP_SLOWEST allows for its bytes. */
#define HTTP_HEAD_MS 15000
#define HTTP_BODY_MS 60000
#define HTTP_SLOWEST 64 /* bytes per millisecond, that is 64 kB/s */

/* ---- listeners ------------------------------------------------------------------------------------ */

/* A listening, non-blocking TCP socket; *ret_port is the port in the end (0 asks for any). 0, or -1
 * with errno. */
int http_listen(const struct sockaddr *address, socklen_t size, int *ret_fd, unsigned *ret_port);

int http_start(const struct http_setup *setup, struct http **ret); /* 0, or -1 (logged) */
void http_tick(struct http *http); /* about four times a second: cuts slow clients, asks the loop */
int64_t http_answered_ms(const struct http *http); /* monotonic; when the loop last answered http_tick */
unsigned http_turns(const struct http *http);      /* how often it has; for the thread that ticks */
unsigned http_connections(struct http *http);

/* Stopping: quiesce (no new connections; requests on old ones get 503), have every suspended request
 * answered and every stream end, wait until http_suspended is 0, then stop. libmicrohttpd aborts when it
 * is stopped with a connection suspended. What the loop was about to accept shows in http_active once the
 * loop has answered two ticks more: the second was asked after quiescing. */
void http_quiesce(struct http *http);
unsigned http_suspended(struct http *http);
/* Requests that are not finished, and connections so fresh that one is on its way: worth a moment's wait. */
unsigned http_active(struct http *http);
struct http *http_stop(struct http *http); /* NULL is fine; returns NULL */

/* ---- requests ------------------------------------------------------------------------------------- */

const char *http_method(const struct http_request *request);
const char *http_path(const struct http_request *request);       /* as sent: nothing unescaped */
const char *http_request_id(const struct http_request *request); /* the client's, or a new one */
/* NULL: none. One that was given several times is given with commas between its values. */
const char *http_header(const struct http_request *request, const char *name);

/* Decodes a query argument into `buffer`; 0, 1 when there is none, -1 when it is malformed or too long. */
int http_query(const struct http_request *request, const char *name, char *buffer, size_t size);
/* The same for one that is given several times: the n-th of them, from 0. */
int http_query_nth(const struct http_request *request, const char *name, size_t n, char *buffer, size_t size);

/* Calls `each` for every query argument, its name as it was sent (nothing unescaped); nonzero stops and is
 * returned. */
int http_each_argument(const struct http_request *request, int (*each)(const char *name, void *data),
                       void *data);

/* The caller's own pointer; NULL at first. `finished` is the place to free it. */
void http_set_context(struct http_request *request, void *context);
void *http_context(const struct http_request *request);

/* From `begin`: a body of up to `cap` bytes is welcome. Without it any body is refused (413). */
void http_expect_body(struct http_request *request, size_t cap);

/* The body, mapped; valid until http_drop_body or the answer's end. 0, or -1 with errno. */
int http_body(struct http_request *request, const void **ret, size_t *ret_bytes);

/* Puts in its place what it decodes to, which may have as many bytes as were welcome; on a thread that may
 * block. 0, or -1 with *reterr: PROBLEM_BAD_ENCODING, _LENGTH, _BUSY, _STORAGE or _INTERNAL. */
int http_decode_body(struct http_request *request, enum coding coding, struct problem *reterr);
void http_drop_body(struct http_request *request); /* no longer needed; frees the spool early */

/* From `handle`: the answer will come later. */
void http_suspend(struct http_request *request);

/* Whether the client has hung up, or will send nothing more: nobody listens to a suspended connection. Any
 * thread, while the request is suspended. */
bool http_deserted(const struct http_request *request);

/* ---- answers -------------------------------------------------------------------------------------- */

/* Any thread, once per request; takes the answer. NULL (out of memory) sends a bare 500. */
void http_send(struct http_request *request, struct http_answer *answer);
void http_send_problem(struct http_request *request, const struct problem *problem);

/* All return NULL when out of memory, freeing what they were given. `type` NULL: no Content-Type. */
struct http_answer *http_answer_text(int status, const char *type, char *text); /* malloc'd; taken */
struct http_answer *http_answer_bytes(int status, const char *type, void *data, size_t bytes); /* likewise */
struct http_answer *http_answer_static(int status, const char *type, const void *data, size_t bytes);
struct http_answer *http_answer_empty(int status);
/* Makes a 304 of an answer of 200: its length is told, its body stays. */
struct http_answer *http_answer_unmodified(struct http_answer *answer);
struct http_answer *http_answer_file(int status, const char *type, int fd, uint64_t bytes); /* takes fd */
struct http_answer *http_answer_problem(const struct http_request *request, const struct problem *problem);

/* An answer that goes on. `pull` gives the next bytes (> 0), 0 for none yet, -1 for the end; it runs
 * on the loop thread and must not block. After 0 it sleeps until http_wake. `end` runs once, last. */
typedef ssize_t http_pull_fn(void *data, char *buffer, size_t max);
struct http_answer *http_answer_stream(struct http *http, const char *type, http_pull_fn *pull,
                                       void (*end)(void *data), void *data, struct http_wake **ret_wake);
void http_wake(struct http_wake *wake); /* any thread, from creation until `end` is called */

/* Adds a header; NULL answers are fine. `format` must not yield line breaks. An answer that there was no
 * memory to add one to is sent as a bare 500, like one that is NULL. */
__attribute__((format(printf, 3, 4))) void http_answer_header(struct http_answer *answer, const char *name,
                                                              const char *format, ...);
struct http_answer *http_answer_free(struct http_answer *answer); /* one that was never sent */

struct http *http_of(const struct http_request *request);

#endif
