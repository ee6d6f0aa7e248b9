/* http.c - see http.h. Every rule without an obvious reason works round a trap of libmicrohttpd 0.9.75. */
#include "http.h"

#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <unistd.h>

#include <microhttpd.h>

#include "clock.h"
#include "files.h"
#include "framing.h"
#include "id.h"
#include "jsonout.h"
#include "log.h"
#include "pulse.h"

#define HEAD_BYTES   (32 * 1024) /* of memory per connection: bounds request lines and headers */
#define IDLE_SECONDS 30          /* a peer that takes no byte of its answer for so long is gone */
#define STREAM_BLOCK 4096
/* A stream's peer whose TCP says nothing for so long is gone: after one heartbeat, before the next but one.
 */
#define STREAM_SILENCE_MS 20000
#define REQUEST_ID_BYTES  64
#define LINGER_MS         2000 /* at most, for a peer that still sends after its last answer */
#define LINGERING         64   /* at most; beyond, peers may lose an answer to a reset */
#define FRESH_MS          500  /* a peer that connects to ask something has sent it by then */

struct connection { /* one TCP connection; in the list of its http, under its lock */
    struct connection *prev, *next;
    int fd;
    int64_t deadline_ms;      /* monotonic; 0: none */
    int64_t fresh_ms;         /* until then its first request is awaited; 0 once that has begun */
    struct http_wake *stream; /* that it carries; NULL: none */
    struct framing framing;   /* of the request that is coming in; the loop's alone */
};

struct lingering { /* a connection that is over for the library but not for TCP */
    int fd;
    int64_t deadline_ms;
};

struct http {
    struct http_setup setup;
    struct MHD_Daemon *daemon;
    struct pulse *pulse;
    bool quiesced;        /* by the thread that stops it */
    pthread_mutex_t lock; /* guards all below, and the `suspended` of requests and wakes */
    struct connection *connections;
    unsigned connection_count;
    unsigned suspended, handling; /* handling: inside the handle callback */
    unsigned active;              /* requests begun and not finished */
    bool stopping;
    struct lingering lingering[LINGERING];
    size_t lingerers;
    size_t spooled; /* bytes of all bodies held */
};

enum body_state { BODY_NONE = 0, BODY_SPOOLING, BODY_TOO_LARGE, BODY_NO_ROOM, BODY_FAILED };

struct joined { /* a header that was given several times */
    struct joined *next;
    char *name, *value; /* the values, with commas between them */
};

struct http_request {
    struct http *http;
    struct MHD_Connection *mhd;
    struct connection *connection;
    char method[16], *target; /* as sent, without its query */
    const char *path;         /* within it */
    char id[REQUEST_ID_BYTES + 1];
    struct joined *joined;
    bool unjoined; /* there was no memory to join some */
    void *context;
    int64_t started_ms, body_started_ms;
    /* the body */
    enum body_state body_state;
    int spool;                              /* -1: none */
    size_t body_cap, body_bytes, body_seen; /* allowed; kept; arrived */
    void *map;
    /* the answer */
    bool alone;                 /* the connection is closed behind it */
    bool handled, parked;       /* parked: suspended within the current callback */
    bool suspended;             /* under the lock */
    struct http_answer *answer; /* under the lock; waiting to be queued */
    bool sent;                  /* under the lock */
    int status;                 /* queued; 0: none yet */
};

struct http_wake {
    struct http *http;
    struct MHD_Connection *mhd; /* set when the answer is queued */
    http_pull_fn *pull;
    void (*end)(void *data);
    void *data;
    struct connection *connection;    /* under the lock; NULL: none yet, or closed */
    bool kicked, suspended, deserted; /* under the lock; deserted: its peer hung up */
};

struct http_answer {
    struct MHD_Response *response;
    int status;
    uint64_t bytes;
    struct http_wake *wake; /* of a stream; owned by the response */
    bool close;
    bool lacks; /* a header, for want of memory: not to be sent */
};

/* ---- connections and their deadlines ---------------------------------------------------------------- */

/* Reads and drops what has arrived; 1 when the peer is done too (or gone), else 0. */
static int drain(int fd)
{
    char waste[16384];
    /* Bounded: a peer that sends faster than this reads is cut off at the deadline. */
    for (int i = 0; i < 64; i++) {
        ssize_t n = recv(fd, waste, sizeof waste, MSG_DONTWAIT);
        if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR))
            return 1;
        if (n < 0 && errno == EAGAIN)
            return 0;
    }
    return 0;
}

/* Closing a socket on which bytes arrive makes TCP send a reset, which can overtake the last answer: the
 * client then sees no status at all. So a duplicate is kept open for a moment, and drained by http_tick
 * (RFC 9112 section 9.6). Under the lock. */
static void linger(struct http *http, int fd)
{
    if (shutdown(fd, SHUT_WR) != 0 || http->lingerers == LINGERING || drain(fd))
        return;
    int copy = fcntl(fd, F_DUPFD_CLOEXEC, 0);
    if (copy >= 0)
        http->lingering[http->lingerers++] = (struct lingering){copy, clock_monotonic_ms() + LINGER_MS};
}

/* Under the lock. */
static void drain_lingerers(struct http *http, int64_t now)
{
    for (size_t i = 0; i < http->lingerers;) {
        if (now < http->lingering[i].deadline_ms && !drain(http->lingering[i].fd)) {
            i++;
            continue;
        }
        close(http->lingering[i].fd);
        http->lingering[i] = http->lingering[--http->lingerers];
    }
}

static void on_connection(void *cls, struct MHD_Connection *mhd, void **socket_context,
                          enum MHD_ConnectionNotificationCode code)
{
    struct http *http = cls;
    struct connection *c = *socket_context;
    if (pulse_connection(http->pulse, mhd, socket_context, code))
        return;
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
        const union MHD_ConnectionInfo *info =
            MHD_get_connection_info(mhd, MHD_CONNECTION_INFO_CONNECTION_FD);
        c = calloc(1, sizeof *c);
        if (c == NULL || info == NULL) {
            free(c);
            return; /* requests on it are refused for want of a connection */
        }
        c->fd = info->connect_fd;
        c->fresh_ms = clock_monotonic_ms() + FRESH_MS;
        c->deadline_ms = clock_monotonic_ms() + HTTP_HEAD_MS;
        *socket_context = c;
        pthread_mutex_lock(&http->lock);
        c->next = http->connections;
        if (c->next != NULL)
            c->next->prev = c;
        http->connections = c;
        http->connection_count++;
        pthread_mutex_unlock(&http->lock);
    } else if (c != NULL) {
        /* The descriptor is closed after this returns: http_tick cannot hit a stranger's. */
        pthread_mutex_lock(&http->lock);
        if (c->next != NULL)
            c->next->prev = c->prev;
        *(c->prev != NULL ? &c->prev->next : &http->connections) = c->next;
        http->connection_count--;
        if (c->stream != NULL)
            c->stream->connection = NULL;
        linger(http, c->fd);
        pthread_mutex_unlock(&http->lock);
        free(c);
        *socket_context = NULL;
    }
}

static void set_deadline(struct http_request *r, int64_t deadline_ms)
{
    pthread_mutex_lock(&r->http->lock);
    r->connection->deadline_ms = deadline_ms;
    pthread_mutex_unlock(&r->http->lock);
}

/* Under the lock. */
static void resume_stream(struct http_wake *wake)
{
    wake->kicked = true;
    if (!wake->suspended)
        return;
    wake->suspended = false;
    wake->http->suspended--;
    MHD_resume_connection(wake->mhd);
}

/* Whether its peer has hung up, or will send nothing more. */
static bool is_deserted(const struct connection *c)
{
    struct pollfd peer = {.fd = c->fd, .events = POLLRDHUP};
    return poll(&peer, 1, 0) == 1;
}

/* Nobody listens to a suspended connection: without this look, clients that come and go would fill the places
 * for streams until the next heartbeats. Under the lock. */
static void look_after_stream(struct connection *c)
{
    if (c->stream == NULL || !c->stream->suspended || !is_deserted(c))
        return;
    c->stream->deserted = true;
    resume_stream(c->stream);
}

/* libmicrohttpd's own timeout is idle time: one byte a second keeps a connection for ever. */
void http_tick(struct http *http)
{
    pulse_tick(http->pulse, http->daemon);
    int64_t now = clock_monotonic_ms();
    unsigned cut = 0;
    pthread_mutex_lock(&http->lock);
    for (struct connection *c = http->connections; c != NULL; c = c->next) {
        look_after_stream(c);
        if (c->deadline_ms == 0 || now < c->deadline_ms)
            continue;
        shutdown(c->fd, SHUT_RDWR);
        c->deadline_ms = 0;
        cut++;
    }
    drain_lingerers(http, now);
    pthread_mutex_unlock(&http->lock);
    if (cut > 0)
        log_event(LOG_LEVEL_DEBUG, "http.cut", "connections=%u", cut);
}

int64_t http_answered_ms(const struct http *http)
{
    return pulse_answered_ms(http->pulse);
}

unsigned http_turns(const struct http *http)
{
    return pulse_answers(http->pulse);
}

unsigned http_connections(struct http *http)
{
    pthread_mutex_lock(&http->lock);
    unsigned count = http->connection_count;
    pthread_mutex_unlock(&http->lock);
    return count;
}

unsigned http_suspended(struct http *http)
{
    pthread_mutex_lock(&http->lock);
    unsigned count = http->suspended + http->handling;
    pthread_mutex_unlock(&http->lock);
    return count;
}

unsigned http_active(struct http *http)
{
    int64_t now = clock_monotonic_ms();
    pthread_mutex_lock(&http->lock);
    unsigned count = http->active;
    for (const struct connection *c = http->connections; c != NULL; c = c->next)
        count += now < c->fresh_ms;
    pthread_mutex_unlock(&http->lock);
    return count;
}

/* ---- framing ---------------------------------------------------------------------------------------- */

/* Where this version of the library leaves the pieces of a head is known; others may do it otherwise (and
 * refuse by themselves what only the places would tell). */
static bool parses_in_place(void)
{
    return strcmp(MHD_get_version(), "0.9.75") == 0;
}

static struct connection *connection_of(struct MHD_Connection *mhd)
{
    const union MHD_ConnectionInfo *info = MHD_get_connection_info(mhd, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    return info == NULL ? NULL : info->socket_context;
}

/* Sees the request target before the library takes its query apart. */
static void *on_target(void *cls, const char *target, struct MHD_Connection *mhd)
{
    struct http *http = cls;
    struct connection *c = pulse_is_mine(http->pulse, mhd) ? NULL : connection_of(mhd);
    if (c != NULL)
        framing_target(&c->framing, parses_in_place(), target == NULL ? "" : target);
    return NULL;
}

static enum MHD_Result on_header(void *cls, enum MHD_ValueKind kind, const char *name, size_t name_bytes,
                                 const char *value, size_t value_bytes)
{
    (void)kind;
    framing_header(cls, name, name_bytes, value, value_bytes);
    return MHD_YES;
}

/* NULL when the request's frame is sound, else what is wrong with it. */
static const char *framing_fault(struct http_request *r, const char *method, const char *version,
                                 enum problem_code *ret_code, bool *ret_body)
{
    struct framing *f = &r->connection->framing;
    const union MHD_ConnectionInfo *head =
        MHD_get_connection_info(r->mhd, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE);
    framing_line(f, method, version);
    MHD_get_connection_values_n(r->mhd, MHD_HEADER_KIND, on_header, f);
    return framing_end(f, head == NULL ? 0 : head->header_size, ret_code, ret_body);
}

/* ---- requests ---------------------------------------------------------------------------------------- */

static void choose_request_id(struct http_request *r)
{
    const char *given = MHD_lookup_connection_value(r->mhd, MHD_HEADER_KIND, "X-Request-Id");
    size_t n = given == NULL ? 0 : strlen(given);
    bool visible = n > 0 && n <= REQUEST_ID_BYTES;
    for (size_t i = 0; visible && i < n; i++)
        visible = given[i] > ' ' && given[i] < 0x7f;
    if (visible)
        snprintf(r->id, sizeof r->id, "%s", given);
    else
        id_new(r->id);
}

static struct http_request *request_new(struct http *http, struct MHD_Connection *mhd, const char *url,
                                        const char *method)
{
    struct connection *c = connection_of(mhd);
    if (c == NULL)
        return NULL;
    struct http_request *r = calloc(1, sizeof *r);
    if (r == NULL || (r->target = strdup(url)) == NULL) {
        free(r);
        return NULL;
    }
    r->path = r->target;
    r->http = http;
    r->mhd = mhd;
    r->connection = c;
    r->spool = -1;
    r->started_ms = clock_monotonic_ms();
    snprintf(r->method, sizeof r->method, "%s", method);
    choose_request_id(r);
    pthread_mutex_lock(&http->lock);
    http->active++;
    r->connection->fresh_ms = 0;
    pthread_mutex_unlock(&http->lock);
    return r;
}

const char *http_method(const struct http_request *request)
{
    return request->method;
}

const char *http_path(const struct http_request *request)
{
    return request->path;
}

const char *http_request_id(const struct http_request *request)
{
    return request->id;
}

struct http *http_of(const struct http_request *request)
{
    return request->http;
}

static struct joined *find_joined(const struct http_request *r, const char *name)
{
    struct joined *j = r->joined;
    while (j != NULL && strcasecmp(j->name, name) != 0)
        j = j->next;
    return j;
}

/* Puts what is given again behind what was given before (RFC 9110 section 5.3). */
static enum MHD_Result join_header(void *cls, enum MHD_ValueKind kind, const char *name, const char *value)
{
    struct http_request *r = cls;
    const char *first = MHD_lookup_connection_value(r->mhd, kind, name);
    char *text;
    if (first == value)
        return MHD_YES;
    r->unjoined = true;
    struct joined *j = find_joined(r, name);
    if (asprintf(&text, "%s, %s", j == NULL ? first : j->value, value) < 0)
        return MHD_NO;
    if (j == NULL) {
        j = calloc(1, sizeof *j);
        if (j == NULL || (j->name = strdup(name)) == NULL) {
            free(text);
            free(j);
            return MHD_NO;
        }
        j->next = r->joined;
        r->joined = j;
    }
    free(j->value);
    j->value = text;
    r->unjoined = false;
    return MHD_YES;
}

/* 0, or -1 when out of memory. */
static int join_headers(struct http_request *r)
{
    MHD_get_connection_values(r->mhd, MHD_HEADER_KIND, join_header, r);
    return r->unjoined ? -1 : 0;
}

static void free_joined(struct joined *j)
{
    while (j != NULL) {
        struct joined *next = j->next;
        free(j->name);
        free(j->value);
        free(j);
        j = next;
    }
}

const char *http_header(const struct http_request *request, const char *name)
{
    const struct joined *joined = find_joined(request, name);
    if (joined != NULL)
        return joined->value;
    return MHD_lookup_connection_value(request->mhd, MHD_HEADER_KIND, name);
}

void http_set_context(struct http_request *request, void *context)
{
    request->context = context;
}

void *http_context(const struct http_request *request)
{
    return request->context;
}

static int hex_digit(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    c |= 0x20;
    return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* 0, or -1 when it is malformed or too long. */
static int unescape(const char *text, char *buffer, size_t size)
{
    size_t n = 0;
    for (const char *p = text; *p != '\0'; p++) {
        int c = (unsigned char)*p;
        if (c == '%') {
            int high = hex_digit(p[1]), low = high < 0 ? -1 : hex_digit(p[2]);
            c = high < 0 || low < 0 ? 0 : 16 * high + low;
            p += 2;
        }
        if (c == 0 || n + 1 >= size)
            return -1;
        buffer[n++] = (char)c;
    }
    buffer[n] = '\0';
    return 0;
}

struct argument { /* one that is looked for */
    const char *name;
    size_t n; /* how many of the name come before it */
    const char *value;
};

static enum MHD_Result find_argument(void *cls, enum MHD_ValueKind kind, const char *name, const char *value)
{
    struct argument *wanted = cls;
    (void)kind;
    if (strcmp(name, wanted->name) != 0 || wanted->n-- > 0)
        return MHD_YES;
    wanted->value = value == NULL ? "" : value;
    return MHD_NO;
}

int http_query_nth(const struct http_request *request, const char *name, size_t n, char *buffer, size_t size)
{
    struct argument wanted = {name, n, NULL};
    MHD_get_connection_values(request->mhd, MHD_GET_ARGUMENT_KIND, find_argument, &wanted);
    return wanted.value == NULL ? 1 : unescape(wanted.value, buffer, size);
}

int http_query(const struct http_request *request, const char *name, char *buffer, size_t size)
{
    return http_query_nth(request, name, 0, buffer, size);
}

struct argument_walk {
    int (*each)(const char *name, void *data);
    void *data;
    int result;
};

static enum MHD_Result on_argument(void *cls, enum MHD_ValueKind kind, const char *name, const char *value)
{
    struct argument_walk *walk = cls;
    (void)kind, (void)value;
    walk->result = walk->each(name, walk->data);
    return walk->result == 0 ? MHD_YES : MHD_NO;
}

int http_each_argument(const struct http_request *request, int (*each)(const char *name, void *data),
                       void *data)
{
    struct argument_walk walk = {each, data, 0};
    MHD_get_connection_values(request->mhd, MHD_GET_ARGUMENT_KIND, on_argument, &walk);
    return walk.result;
}

/* libmicrohttpd unescapes paths in place, so that %00 cuts them and %2f becomes a slash; with this
 * nothing is unescaped before somebody knows what it is. */
static size_t unescape_nothing(void *cls, struct MHD_Connection *mhd, char *text)
{
    (void)cls, (void)mhd;
    return strlen(text);
}

/* ---- bodies ------------------------------------------------------------------------------------------ */

void http_expect_body(struct http_request *request, size_t cap)
{
    request->body_cap = cap;
}

/* Reserves room for `bytes` more of spooled bodies. */
static bool reserve_spool(struct http *http, size_t bytes)
{
    pthread_mutex_lock(&http->lock);
    bool room = bytes <= http->setup.spool_bytes && http->spooled <= http->setup.spool_bytes - bytes;
    if (room)
        http->spooled += bytes;
    pthread_mutex_unlock(&http->lock);
    return room;
}

static void take_body(struct http_request *r, const char *data, size_t bytes)
{
    r->body_seen += bytes;
    set_deadline(r, r->body_started_ms + HTTP_BODY_MS + (int64_t)(r->body_seen / HTTP_SLOWEST));
    if (r->body_state != BODY_SPOOLING)
        return; /* refused already: what still comes is only drained */
    if (r->body_seen > r->body_cap) {
        r->body_state = BODY_TOO_LARGE;
    } else if (!reserve_spool(r->http, bytes)) {
        r->body_state = BODY_NO_ROOM;
    } else {
        r->body_bytes += bytes;
        if (r->spool < 0)
            r->spool = files_open_unnamed(r->http->setup.spool_dir);
        if (r->spool < 0 || files_write_all(r->spool, data, bytes) != 0)
            r->body_state = BODY_FAILED;
    }
    if (r->body_state != BODY_SPOOLING)
        http_drop_body(r);
}

int http_body(struct http_request *request, const void **ret, size_t *ret_bytes)
{
    if (request->body_bytes == 0) {
        *ret = "";
        *ret_bytes = 0;
        return 0;
    }
    if (request->map == NULL) {
        void *map = mmap(NULL, request->body_bytes, PROT_READ, MAP_PRIVATE, request->spool, 0);
        if (map == MAP_FAILED)
            return -1;
        request->map = map;
    }
    *ret = request->map;
    *ret_bytes = request->body_bytes;
    return 0;
}

void http_drop_body(struct http_request *request)
{
    if (request->map != NULL)
        munmap(request->map, request->body_bytes);
    if (request->spool >= 0)
        close(request->spool);
    pthread_mutex_lock(&request->http->lock);
    request->http->spooled -= request->body_bytes;
    pthread_mutex_unlock(&request->http->lock);
    request->map = NULL;
    request->spool = -1;
    request->body_bytes = 0;
}

struct decoded { /* grows beside the body that it is to replace */
    struct http *http;
    const char *why; /* NULL: nothing failed */
    int fd;
    size_t bytes;
    enum problem_code code;
};

static int keep_decoded(const void *data, size_t bytes, void *sink_data)
{
    struct decoded *decoded = sink_data;
    if (!reserve_spool(decoded->http, bytes)) {
        decoded->code = PROBLEM_BUSY;
        decoded->why = "Too many bodies are being read.";
        return -1;
    }
    decoded->bytes += bytes;
    if (files_write_all(decoded->fd, data, bytes) == 0)
        return 0;
    decoded->code = PROBLEM_STORAGE;
    decoded->why = "The body could not be spooled.";
    return -1;
}

/* What became of decoding, in words; 0 when all went well. */
static int decoding_problem(const struct http_request *r, enum coding coding, enum decoding result,
                            const char *why, const struct decoded *decoded, struct problem *reterr)
{
    switch (result) {
    case DECODING_OK:
        return 0;
    case DECODING_CORRUPT:
        return problem_set(reterr, PROBLEM_BAD_ENCODING, "The body cannot be decoded from %s: %s.",
                           coding_name(coding), why);
    case DECODING_TOO_LARGE:
        return problem_set(reterr, PROBLEM_LENGTH, "The body may have %zu bytes when decoded.", r->body_cap);
    case DECODING_STOPPED:
        return problem_set(reterr, decoded->code, "%s", decoded->why);
    case DECODING_NO_MEMORY:
        break;
    }
    return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
}

int http_decode_body(struct http_request *r, enum coding coding, struct problem *reterr)
{
    struct decoded decoded = {.http = r->http, .fd = files_open_unnamed(r->http->setup.spool_dir)};
    const void *data;
    size_t bytes;
    const char *why = "";
    if (decoded.fd < 0 || http_body(r, &data, &bytes) != 0) {
        if (decoded.fd >= 0)
            close(decoded.fd);
        return problem_set(reterr, PROBLEM_STORAGE, "The body could not be spooled.");
    }
    enum decoding result = encoding_decode(coding, data, bytes, r->body_cap, keep_decoded, &decoded, &why);
    int failed = decoding_problem(r, coding, result, why, &decoded, reterr);
    http_drop_body(r);
    r->spool = decoded.fd; /* a part of it goes with the request */
    r->body_bytes = decoded.bytes;
    return failed;
}

/* The problem to answer with once a refused body has been drained; false when the body is fine. */
static bool body_problem(const struct http_request *r, struct problem *ret)
{
    switch (r->body_state) {
    case BODY_TOO_LARGE:
        problem_set(ret, PROBLEM_LENGTH, "The body may have %zu bytes.", r->body_cap);
        return true;
    case BODY_NO_ROOM:
        problem_set(ret, PROBLEM_BUSY, "Too many bodies are being read.");
        return true;
    case BODY_FAILED:
        problem_set(ret, PROBLEM_STORAGE, "The body could not be spooled.");
        return true;
    case BODY_NONE:
    case BODY_SPOOLING:
        break;
    }
    return false;
}

/* ---- answers ----------------------------------------------------------------------------------------- */

static struct http_answer *wrap(int status, const char *type, struct MHD_Response *response, uint64_t bytes)
{
    struct http_answer *answer = response == NULL ? NULL : calloc(1, sizeof *answer);
    if (answer == NULL) {
        if (response != NULL)
            MHD_destroy_response(response);
        return NULL;
    }
    answer->response = response;
    answer->status = status;
    answer->bytes = bytes;
    if (type != NULL)
        http_answer_header(answer, "Content-Type", "%s", type);
    return answer;
}

struct http_answer *http_answer_text(int status, const char *type, char *text)
{
    return text == NULL ? NULL : http_answer_bytes(status, type, text, strlen(text));
}

struct http_answer *http_answer_bytes(int status, const char *type, void *data, size_t bytes)
{
    struct MHD_Response *response = MHD_create_response_from_buffer(bytes, data, MHD_RESPMEM_MUST_FREE);
    if (response == NULL)
        free(data);
    return wrap(status, type, response, bytes);
}

struct http_answer *http_answer_static(int status, const char *type, const void *data, size_t bytes)
{
    union { /* the library only reads it, but asks for a writable pointer */
        const void *in;
        void *out;
    } cast = {data};
    return wrap(status, type, MHD_create_response_from_buffer(bytes, cast.out, MHD_RESPMEM_PERSISTENT),
                bytes);
}

struct http_answer *http_answer_empty(int status)
{
    return http_answer_static(status, NULL, "", 0);
}

/* The library sends no body with a 304, but the length of what it would be, which is all it may tell (RFC
 * 9110 section 8.6): of an empty answer that would be 0. */
struct http_answer *http_answer_unmodified(struct http_answer *answer)
{
    if (answer == NULL)
        return NULL;
    const char *type = MHD_get_response_header(answer->response, "Content-Type");
    if (type != NULL)
        MHD_del_response_header(answer->response, "Content-Type", type);
    answer->status = 304;
    answer->bytes = 0;
    return answer;
}

struct http_answer *http_answer_file(int status, const char *type, int fd, uint64_t bytes)
{
    struct MHD_Response *response = MHD_create_response_from_fd64(bytes, fd);
    if (response == NULL)
        close(fd);
    return wrap(status, type, response, bytes);
}

struct http_answer *http_answer_problem(const struct http_request *request, const struct problem *problem)
{
    json_t *body = problem_json(problem, request->path, request->id);
    char *text = jsonout_text(body);
    struct http_answer *answer =
        http_answer_text(problem_status(problem->code), "application/problem+json", text);
    if (problem_status(problem->code) == 503 || problem_status(problem->code) == 429)
        http_answer_header(answer, "Retry-After", "%u", problem->retry_s > 0 ? problem->retry_s : 1);
    return answer;
}

void http_answer_header(struct http_answer *answer, const char *name, const char *format, ...)
{
    char value[2048];
    if (answer == NULL)
        return;
    va_list args;
    va_start(args, format);
    vsnprintf(value, sizeof value, format, args);
    va_end(args);
    if (MHD_add_response_header(answer->response, name, value) != MHD_YES)
        answer->lacks = true;
}

struct http_answer *http_answer_free(struct http_answer *answer)
{
    if (answer != NULL)
        MHD_destroy_response(answer->response);
    free(answer);
    return NULL;
}

void http_send(struct http_request *request, struct http_answer *answer)
{
    if (answer != NULL && answer->lacks)
        answer = http_answer_free(answer);
    if (answer == NULL)
        answer = http_answer_static(problem_status(PROBLEM_INTERNAL), "application/problem+json",
                                    problem_no_memory, strlen(problem_no_memory));
    pthread_mutex_lock(&request->http->lock);
    request->answer = answer;
    request->sent = true;
    if (request->suspended) {
        request->suspended = false;
        request->http->suspended--;
        MHD_resume_connection(request->mhd);
    }
    pthread_mutex_unlock(&request->http->lock);
}

void http_send_problem(struct http_request *request, const struct problem *problem)
{
    http_send(request, http_answer_problem(request, problem));
}

void http_suspend(struct http_request *request)
{
    pthread_mutex_lock(&request->http->lock);
    MHD_suspend_connection(request->mhd);
    request->suspended = true;
    request->http->suspended++;
    pthread_mutex_unlock(&request->http->lock);
    request->parked = true;
}

bool http_deserted(const struct http_request *request)
{
    return is_deserted(request->connection);
}

/* ---- streams ----------------------------------------------------------------------------------------- */

/* A reader that returns 0 without being suspended is called again at once: a third of a core for one
 * idle stream. The pull runs without the lock, so a wake in between is remembered as `kicked`. */
static ssize_t pull_stream(void *cls, uint64_t position, char *buffer, size_t max)
{
    struct http_wake *wake = cls;
    (void)position;
    for (;;) {
        pthread_mutex_lock(&wake->http->lock);
        wake->kicked = false;
        bool deserted = wake->deserted;
        pthread_mutex_unlock(&wake->http->lock);
        if (deserted)
            return MHD_CONTENT_READER_END_WITH_ERROR;
        ssize_t n = wake->pull(wake->data, buffer, max);
        if (n != 0)
            return n > 0 ? n : MHD_CONTENT_READER_END_OF_STREAM;
        pthread_mutex_lock(&wake->http->lock);
        bool sleep = !wake->kicked;
        if (sleep) {
            MHD_suspend_connection(wake->mhd);
            wake->suspended = true;
            wake->http->suspended++;
        }
        pthread_mutex_unlock(&wake->http->lock);
        if (sleep)
            return 0;
    }
}

static void end_stream(void *cls)
{
    struct http_wake *wake = cls;
    wake->end(wake->data); /* after it nobody wakes */
    pthread_mutex_lock(&wake->http->lock);
    if (wake->connection != NULL)
        wake->connection->stream = NULL;
    pthread_mutex_unlock(&wake->http->lock);
    free(wake);
}

struct http_answer *http_answer_stream(struct http *http, const char *type, http_pull_fn *pull,
                                       void (*end)(void *data), void *data, struct http_wake **ret_wake)
{
    struct http_wake *wake = calloc(1, sizeof *wake);
    if (wake == NULL) {
        end(data);
        return NULL;
    }
    *wake = (struct http_wake){.http = http, .pull = pull, .end = end, .data = data};
    *ret_wake = wake; /* before the response can fail and take it back through end_stream */
    struct MHD_Response *response =
        MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, STREAM_BLOCK, pull_stream, wake, end_stream);
    if (response == NULL)
        end_stream(wake);
    struct http_answer *answer = wrap(200, type, response, 0);
    if (answer != NULL)
        answer->wake = wake;
    return answer;
}

void http_wake(struct http_wake *wake)
{
    pthread_mutex_lock(&wake->http->lock);
    resume_stream(wake);
    pthread_mutex_unlock(&wake->http->lock);
}

/* ---- the loop's callbacks ------------------------------------------------------------------------------ */

/* A sleeping stream meets a dead peer only when it writes, and TCP itself would try again for a quarter of an
 * hour. (On a socket that is not TCP's this fails, and need not hold.) */
static void watch_peer(int fd)
{
    unsigned milliseconds = STREAM_SILENCE_MS;
    setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &milliseconds, sizeof milliseconds);
}

/* Hands an answer that is there to libmicrohttpd; YES too when there is none yet. */
static enum MHD_Result queue_answer(struct http_request *r)
{
    pthread_mutex_lock(&r->http->lock);
    struct http_answer *answer = r->answer;
    bool sent = r->sent;
    r->answer = NULL;
    if (answer != NULL && answer->wake != NULL) {
        answer->wake->mhd = r->mhd;
        answer->wake->connection = r->connection;
        r->connection->stream = answer->wake;
    }
    pthread_mutex_unlock(&r->http->lock);
    if (answer == NULL)
        return sent ? MHD_NO : MHD_YES; /* sent, yet no memory for the barest answer */
    r->status = answer->status;
    http_answer_header(answer, "X-Request-Id", "%s", r->id);
    if (r->http->setup.leaving != NULL)
        r->http->setup.leaving(r, answer, r->http->setup.data);
    if (answer->close || r->alone)
        http_answer_header(answer, "Connection", "close");
    if (answer->wake != NULL)
        watch_peer(r->connection->fd);
    set_deadline(r, answer->wake != NULL
                        ? 0
                        : clock_monotonic_ms() + HTTP_BODY_MS + (int64_t)(answer->bytes / HTTP_SLOWEST));
    enum MHD_Result result = MHD_queue_response(r->mhd, (unsigned)answer->status, answer->response);
    http_answer_free(answer);
    return result;
}

/* Answers now and hangs up after it: the rest of the request cannot be trusted, or is unwanted. */
static void refuse(struct http_request *r, enum problem_code code, const char *detail)
{
    struct problem problem;
    problem_set(&problem, code, "%s", detail);
    struct http_answer *answer = http_answer_problem(r, &problem);
    if (answer != NULL)
        answer->close = true;
    http_send(r, answer);
}

/* With a known length an early 413 reaches the client; in the midst of an upload nothing does. */
static bool too_long(const struct http_request *r, bool has_body)
{
    const char *text = http_header(r, "Content-Length");
    if (text == NULL)
        return has_body && r->body_cap == 0;
    errno = 0;
    unsigned long long length = strtoull(text, NULL, 10);
    return errno != 0 || length > r->body_cap;
}

static void begin_request(struct http_request *r, const char *method, const char *version)
{
    bool has_body;
    enum problem_code code;
    const char *fault = framing_fault(r, method, version, &code, &has_body);
    const char *path = framing_path(r->method, r->target, http_header(r, "Host"));
    set_deadline(r, 0);
    if (fault == NULL && path == NULL) {
        fault = "The request target must be a path here.";
        code = PROBLEM_BAD_REQUEST;
    }
    if (fault == NULL && join_headers(r) != 0) {
        fault = "Out of memory.";
        code = PROBLEM_INTERNAL;
    }
    if (fault != NULL) {
        refuse(r, code, fault);
        return;
    }
    r->path = path;
    /* The library is lax about the lines between chunks, and they cannot be seen from here: what comes
     * behind such a body is not trusted to be a request. */
    r->alone = r->connection->framing.transfer_encodings > 0;
    r->http->setup.begin(r, r->http->setup.data);
    if (r->sent) {
        if (r->answer != NULL)
            r->answer->close |= has_body; /* what follows is an unread body, not a request */
    } else if (too_long(r, has_body)) {
        char detail[96];
        snprintf(detail, sizeof detail, "The body may have %zu bytes.", r->body_cap);
        refuse(r, PROBLEM_LENGTH, detail);
    } else if (has_body) {
        r->body_state = BODY_SPOOLING;
        r->body_started_ms = clock_monotonic_ms();
        set_deadline(r, r->body_started_ms + HTTP_BODY_MS);
    }
}

/* Enters or leaves the handle callback; false when the server stops: then nothing may be suspended. */
static bool count_handling(struct http *http, bool enter)
{
    pthread_mutex_lock(&http->lock);
    bool allowed = !enter || !http->stopping;
    if (allowed)
        http->handling += enter ? 1 : -1u;
    pthread_mutex_unlock(&http->lock);
    return allowed;
}

static void handle_request(struct http_request *r)
{
    struct problem problem;
    r->handled = true;
    set_deadline(r, 0);
    if (body_problem(r, &problem)) {
        http_send_problem(r, &problem);
    } else if (!count_handling(r->http, true)) {
        refuse(r, PROBLEM_DRAINING, "The server is shutting down.");
    } else {
        r->http->setup.handle(r, r->http->setup.data);
        count_handling(r->http, false);
    }
}

static enum MHD_Result on_request(void *cls, struct MHD_Connection *mhd, const char *url, const char *method,
                                  const char *version, const char *upload, size_t *upload_bytes,
                                  void **con_cls)
{
    struct http_request *r = *con_cls;
    if (r == NULL) {
        if (pulse_is_mine(((struct http *)cls)->pulse, mhd))
            return pulse_answer(mhd);
        r = request_new(cls, mhd, url, method);
        if (r == NULL)
            return MHD_NO;
        *con_cls = r;
        begin_request(r, method, version);
        return queue_answer(r);
    }
    if (*upload_bytes > 0) {
        take_body(r, upload, *upload_bytes);
        *upload_bytes = 0;
        /* A refused body is drained, so that the client reads its answer, but only so far. */
        return r->body_seen / 2 > r->body_cap ? MHD_NO : MHD_YES;
    }
    if (!r->handled)
        handle_request(r);
    if (r->parked) {
        r->parked = false; /* even if answered meanwhile: we are called again once resumed */
        return MHD_YES;
    }
    return queue_answer(r);
}

static void on_completed(void *cls, struct MHD_Connection *mhd, void **con_cls,
                         enum MHD_RequestTerminationCode code)
{
    struct http_request *r = *con_cls;
    (void)mhd;
    if (r == NULL)
        return;
    struct http *http = cls;
    int status = code == MHD_REQUEST_TERMINATED_COMPLETED_OK ? r->status : 0;
    http->setup.finished(r, status, clock_monotonic_ms() - r->started_ms, http->setup.data);
    http_drop_body(r);
    pthread_mutex_lock(&http->lock);
    r->connection->deadline_ms = clock_monotonic_ms() + HTTP_HEAD_MS;
    http->active--;
    pthread_mutex_unlock(&http->lock);
    http_answer_free(r->answer);
    free_joined(r->joined);
    free(r->target);
    free(r);
    *con_cls = NULL;
}

static void on_log(void *cls, const char *format, va_list args)
{
    char text[256];
    (void)cls;
    /* Of UNIX sockets, as the pulse's, the library tells at each answer that they have no TCP options. */
    if (strncmp(format, "Setting TCP_", 12) == 0 || strncmp(format, "Failed to push the data", 23) == 0)
        return;
    vsnprintf(text, sizeof text, format, args);
    text[strcspn(text, "\n")] = '\0';
    log_event(LOG_LEVEL_DEBUG, "http.library", "message=%s", text);
}

/* ---- listeners --------------------------------------------------------------------------------------- */

int http_listen(const struct sockaddr *address, socklen_t size, int *ret_fd, unsigned *ret_port)
{
    union {
        struct sockaddr_in6 v6;
        struct sockaddr_in v4;
        struct sockaddr any;
    } bound = {0};
    socklen_t bound_size = sizeof bound;
    int on = 1;
    int fd = socket(address->sa_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd < 0)
        return -1;
    if (setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 || bind(fd, address, size) != 0 ||
        listen(fd, SOMAXCONN) != 0 || getsockname(fd, &bound.any, &bound_size) != 0) {
        int error = errno;
        close(fd);
        errno = error;
        return -1;
    }
    *ret_port = ntohs(bound.any.sa_family == AF_INET6 ? bound.v6.sin6_port : bound.v4.sin_port);
    *ret_fd = fd;
    return 0;
}

int http_start(const struct http_setup *setup, struct http **ret)
{
    struct http *http = calloc(1, sizeof *http);
    if (http == NULL || (http->pulse = pulse_new()) == NULL) {
        free(http);
        return -1;
    }
    http->setup = *setup;
    pthread_mutex_init(&http->lock, NULL);
    http->daemon = MHD_start_daemon(
        MHD_USE_EPOLL_INTERNAL_THREAD | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ERROR_LOG, 0, NULL, NULL,
        on_request, http, MHD_OPTION_EXTERNAL_LOGGER, on_log, NULL, MHD_OPTION_LISTEN_SOCKET,
        setup->listen_fd, MHD_OPTION_CONNECTION_LIMIT, setup->connections + 1 /* the pulse */,
        MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)IDLE_SECONDS, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        (size_t)HEAD_BYTES, MHD_OPTION_URI_LOG_CALLBACK, on_target, http, MHD_OPTION_UNESCAPE_CALLBACK,
        unescape_nothing, NULL, MHD_OPTION_NOTIFY_CONNECTION, on_connection, http,
        MHD_OPTION_NOTIFY_COMPLETED, on_completed, http, MHD_OPTION_END);
    if (http->daemon == NULL) {
        log_event(LOG_LEVEL_ERROR, "http.start", "errno=%d error=\"%s\"", errno, strerror(errno));
        pthread_mutex_destroy(&http->lock);
        pulse_free(http->pulse);
        free(http);
        return -1;
    }
    *ret = http;
    return 0;
}

void http_quiesce(struct http *http)
{
    /* The loop may be about to accept on it: closed only once the loop has ended. */
    pthread_mutex_lock(&http->lock);
    http->stopping = true;
    pthread_mutex_unlock(&http->lock);
    http->quiesced = MHD_quiesce_daemon(http->daemon) != MHD_INVALID_SOCKET;
}

struct http *http_stop(struct http *http)
{
    if (http == NULL)
        return NULL;
    MHD_stop_daemon(http->daemon);
    pulse_free(http->pulse);
    if (http->quiesced)
        close(http->setup.listen_fd); /* else the library closed it */
    for (size_t i = 0; i < http->lingerers; i++)
        close(http->lingering[i].fd);
    pthread_mutex_destroy(&http->lock);
    free(http);
    return NULL;
}
