/* streams.c - many event streams that break off and come back while jobs are posted; long polls beside them.
 *
 * usage: streams URL JOB.json [-n STREAMS] [-w WAITERS] [-j JOBS] [-k CHUNK] [-c CANCEL] [-s SEED] [-t
 * SECONDS]
 *
 * Posts JOBS jobs, CHUNK at a time, and cancels about one in CANCEL. Each of STREAMS follows one of the
 * newest jobs, or three of them in one stream, drops its connection at a random byte, comes back with the id
 * of the last event that it got whole, and turns to other jobs after the end. WAITERS do long polls (Prefer:
 * wait=1) for a change of one job, over and over.
 *
 * Holds, or is reported and ends with status 1: of each job a stream sees every state once and in order and
 * the end, revisions rise, and nothing comes after the end; each poll gets one answer, with a later revision
 * or 304. One line of counts. Shares no code with the server. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define ID_BYTES   32
#define MAX_JOBS   3 /* of one stream */
#define TEXT_BYTES 65536
#define STUCK_MS   60000 /* nothing at all happened for so long */

enum status { NOTHING = 0, QUEUED, RUNNING, ENDED };

struct seen { /* of one job, by one stream */
    char id[ID_BYTES + 1];
    enum status status;
    unsigned attempt, counter;
};

enum kind { STREAM = 0, WAITER };

struct client {
    enum kind kind;
    int fd; /* -1: not connected */
    int64_t again_ms;
    struct seen job[MAX_JOBS];
    size_t jobs;
    char last_id[512]; /* of the last whole event, or the ETag last seen by a waiter */
    long budget;       /* bytes until it drops the connection; < 0: never */
    /* the answer as it comes in */
    char *text; /* TEXT_BYTES: what is not yet taken apart */
    size_t bytes;
    bool head_done, chunked, old; /* old: it speaks HTTP/1.0 */
    int code;
    long chunk;    /* bytes left of the current one; 0: its size comes next */
    char *payload; /* TEXT_BYTES: of the event being read, or of the body */
    size_t payload_bytes;
};

static struct {
    struct sockaddr_in address;
    char host[64];
    char *job_text;
    size_t job_bytes;
    size_t clients, streams, jobs, chunk, posted, ended;
    unsigned cancel;
    char (*id)[ID_BYTES + 1]; /* of all jobs */
    struct client *client;
    int epoll;
    uint64_t random;
    int64_t now_ms, moved_ms;
    /* counts */
    size_t connections, drops, comebacks, events, states, ends, polls, changes, unchanged, lists, gone,
        faults;
} run;

/* ---- small things -------------------------------------------------------------------------------------- */

static int64_t clock_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000LL + t.tv_nsec / 1000000;
}

static unsigned draw(unsigned n) /* 0 .. n - 1 */
{
    run.random ^= run.random << 13;
    run.random ^= run.random >> 7;
    run.random ^= run.random << 17;
    return (unsigned)((run.random >> 11) % n);
}

__attribute__((format(printf, 2, 3))) static void fault(const struct client *c, const char *format, ...)
{
    va_list args;
    if (run.faults++ > 20)
        return;
    va_start(args, format);
    printf("# %s %td: ", c->kind == STREAM ? "stream" : "waiter", c - run.client);
    vprintf(format, args);
    printf(" (job %s, last id \"%.80s\")\n", c->job[0].id, c->last_id);
    va_end(args);
}

static void die(const char *what)
{
    printf("# %s: %s\n", what, strerror(errno));
    exit(2);
}

/* The text of a string member, for members whose names are nowhere else in the body. */
static bool member(const char *json, const char *name, char *ret, size_t size)
{
    char key[32];
    snprintf(key, sizeof key, "\"%s\":\"", name);
    const char *at = strstr(json, key);
    if (at == NULL)
        return false;
    at += strlen(key);
    snprintf(ret, size, "%.*s", (int)strcspn(at, "\""), at);
    return true;
}

/* ---- posting: blocking, a few milliseconds each ----------------------------------------------------------
 */

static int dial(bool blocking)
{
    int on = 1, fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | (blocking ? 0 : SOCK_NONBLOCK), 0);
    if (fd < 0)
        die("socket");
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (connect(fd, (struct sockaddr *)&run.address, sizeof run.address) != 0 && errno != EINPROGRESS)
        die("connect");
    return fd;
}

/* The answer, without its connection; static. */
static const char *ask(const char *head, const char *body, size_t bytes)
{
    static char answer[TEXT_BYTES];
    size_t n = 0;
    ssize_t got;
    int fd = dial(true);
    if (send(fd, head, strlen(head), MSG_NOSIGNAL) < 0 ||
        (bytes > 0 && send(fd, body, bytes, MSG_NOSIGNAL) < 0))
        die("send");
    while (n < sizeof answer - 1 && (got = recv(fd, answer + n, sizeof answer - 1 - n, 0)) > 0)
        n += (size_t)got;
    answer[n] = '\0';
    close(fd);
    return answer;
}

static void post_job(void)
{
    char head[256];
    snprintf(head, sizeof head,
             "POST /v1/jobs HTTP/1.1\r\nHost: %s\r\nContent-Type: application/json\r\nContent-Length: %zu\r\n"
             "Connection: close\r\n\r\n",
             run.host, run.job_bytes);
    const char *answer = ask(head, run.job_text, run.job_bytes);
    if (strncmp(answer, "HTTP/1.1 202", 12) != 0 || !member(answer, "id", run.id[run.posted], ID_BYTES + 1)) {
        printf("# POST was answered: %.300s\n", answer);
        exit(2);
    }
    run.posted++;
}

static void cancel_job(const char *id)
{
    char head[256];
    snprintf(head, sizeof head, "DELETE /v1/jobs/%s HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n", id,
             run.host);
    ask(head, "", 0);
}

/* More jobs as soon as few of the clients' are unfinished; each is new to all. */
static void post_some(void)
{
    for (size_t i = 0; i < run.chunk && run.posted < run.jobs; i++)
        post_job();
    if (run.cancel > 0 && run.posted > 0 && draw(run.cancel) < run.chunk)
        cancel_job(
            run.id[run.posted - 1 - draw((unsigned)(run.posted < run.chunk ? run.posted : run.chunk))]);
}

/* ---- connections -----------------------------------------------------------------------------------------
 */

static void hang_up(struct client *c, unsigned pause_ms)
{
    if (c->fd >= 0)
        close(c->fd);
    c->fd = -1;
    c->again_ms = run.now_ms + pause_ms;
}

/* Other jobs, among the newest. */
static void choose_jobs(struct client *c)
{
    size_t newest = run.posted < 2 * run.chunk ? run.posted : 2 * run.chunk;
    c->jobs = c->kind == STREAM && newest >= MAX_JOBS && draw(3) == 0 ? MAX_JOBS : 1;
    size_t first = run.posted - newest + draw((unsigned)(newest - c->jobs + 1));
    for (size_t i = 0; i < c->jobs; i++) {
        c->job[i] = (struct seen){.status = NOTHING};
        memcpy(c->job[i].id, run.id[first + i], ID_BYTES + 1);
    }
    c->last_id[0] = '\0';
}

static void write_request(struct client *c, char *text, size_t size)
{
    char path[256], resume[600] = "";
    if (c->kind == WAITER) {
        snprintf(path, sizeof path, "/v1/jobs/%s", c->job[0].id);
        if (c->last_id[0] != '\0')
            snprintf(resume, sizeof resume, "If-None-Match: %s\r\n", c->last_id);
    } else {
        size_t n = (size_t)snprintf(path, sizeof path, c->jobs > 1 ? "/v1/events" : "/v1/jobs/%s/events",
                                    c->job[0].id);
        for (size_t i = 0; c->jobs > 1 && i < c->jobs; i++)
            n += (size_t)snprintf(path + n, sizeof path - n, "%cjob=%s", i ? '&' : '?', c->job[i].id);
        if (c->last_id[0] != '\0')
            snprintf(resume, sizeof resume, "Last-Event-ID: %s\r\n", c->last_id);
    }
    snprintf(text, size, "GET %s HTTP/1.%d\r\nHost: %s\r\n%s%sConnection: close\r\n\r\n", path, !c->old,
             run.host, resume, c->kind == WAITER ? "Prefer: wait=1\r\n" : "");
}

static void connect_client(struct client *c)
{
    struct epoll_event event = {.events = EPOLLIN | EPOLLOUT | EPOLLET, .data.ptr = c};
    c->fd = dial(false);
    c->bytes = c->payload_bytes = 0;
    c->head_done = c->chunked = false;
    c->chunk = 0;
    c->code = 0;
    c->old = draw(4) == 0;
    c->budget = c->kind == STREAM && draw(5) != 0 ? (long)draw(4000) : -1;
    run.connections++;
    run.comebacks += c->kind == STREAM && c->last_id[0] != '\0';
    run.lists += c->jobs > 1;
    if (epoll_ctl(run.epoll, EPOLL_CTL_ADD, c->fd, &event) != 0)
        die("epoll");
}

/* The connection stands: the request is small enough to go out at once. */
static void send_request(struct client *c)
{
    char text[1200];
    struct epoll_event event = {.events = EPOLLIN, .data.ptr = c};
    write_request(c, text, sizeof text);
    if (send(c->fd, text, strlen(text), MSG_NOSIGNAL) != (ssize_t)strlen(text))
        fault(c, "the request did not go out: %s", strerror(errno));
    epoll_ctl(run.epoll, EPOLL_CTL_MOD, c->fd, &event);
}

/* ---- what a stream may see
 * --------------------------------------------------------------------------------- */

static enum status status_of(const char *json)
{
    char text[16] = "";
    member(json, "status", text, sizeof text);
    return strcmp(text, "queued") == 0    ? QUEUED
           : strcmp(text, "running") == 0 ? RUNNING
           : text[0]                      ? ENDED
                                          : NOTHING;
}

static bool all_ended(const struct client *c)
{
    for (size_t i = 0; i < c->jobs; i++)
        if (c->job[i].status != ENDED)
            return false;
    return true;
}

static struct seen *job_of(struct client *c, const char *json)
{
    char id[ID_BYTES + 1] = "";
    member(json, "id", id, sizeof id);
    for (size_t i = 0; i < c->jobs; i++)
        if (strcmp(c->job[i].id, id) == 0)
            return &c->job[i];
    return NULL;
}

/* queued, running, end, none left out: but a job may be cancelled before it runs, and a stream may begin
 * late. */
static void check_state(struct client *c, struct seen *job, const char *event, enum status status,
                        const char *json)
{
    bool ends = strcmp(event, "end") == 0;
    if (ends != (status == ENDED))
        fault(c, "a %s event of a job that is %s", event, status == ENDED ? "over" : "not over");
    if (job->status == ENDED || (job->status != NOTHING && status == job->status))
        fault(c, "state %d came again", (int)status);
    bool never_ran = strstr(json, "\"started_at\":null") != NULL;
    if (job->status != NOTHING && (int)status != (int)job->status + 1 && !(ends && never_ran))
        fault(c, "from state %d to %d: one was lost", (int)job->status, (int)status);
    job->status = status;
    run.states++;
    run.ends += ends;
}

static void take_event(struct client *c, const char *id, const char *event, const char *json)
{
    unsigned attempt, counter;
    char revision[32] = "";
    struct seen *job = job_of(c, json);
    run.events++;
    run.moved_ms = run.now_ms;
    if (job == NULL || !member(json, "revision", revision, sizeof revision) ||
        sscanf(revision, "%u.%u", &attempt, &counter) != 2) {
        fault(c, "an event of no job of ours: %.120s", json);
        return;
    }
    if (attempt < job->attempt || (attempt == job->attempt && counter <= job->counter))
        fault(c, "revision %s after %u.%u", revision, job->attempt, job->counter);
    if (strstr(id, revision) == NULL)
        fault(c, "revision %s under the id %s", revision, id);
    job->attempt = attempt;
    job->counter = counter;
    snprintf(c->last_id, sizeof c->last_id, "%s", id);
    if (strcmp(event, "progress") != 0)
        check_state(c, job, event, status_of(json), json);
    else if (job->status == ENDED)
        fault(c, "progress after the end");
}

/* One whole event, or a comment, or the line that says when to come back. */
static void take_block(struct client *c, char *block)
{
    const char *id = NULL, *event = NULL, *data = NULL;
    char *rest = block;
    for (char *line; (line = strsep(&rest, "\n")) != NULL;) {
        if (strncmp(line, "id: ", 4) == 0)
            id = line + 4;
        else if (strncmp(line, "event: ", 7) == 0)
            event = line + 7;
        else if (strncmp(line, "data: ", 6) == 0)
            data = line + 6;
        else if (line[0] != '\0' && line[0] != ':' && strcmp(line, "retry: 3000") != 0)
            fault(c, "a line that is none: %.80s", line);
    }
    if (data != NULL && id != NULL && event != NULL)
        take_event(c, id, event, data);
    else if (data != NULL || id != NULL || event != NULL)
        fault(c, "half an event");
}

static void take_blocks(struct client *c)
{
    char *end;
    while ((end = strstr(c->payload, "\n\n")) != NULL) {
        *end = '\0';
        take_block(c, c->payload);
        size_t taken = (size_t)(end + 2 - c->payload);
        c->payload_bytes -= taken;
        memmove(c->payload, end + 2, c->payload_bytes + 1);
    }
}

/* ---- taking answers apart
 * ----------------------------------------------------------------------------------- */

static bool take_head(struct client *c)
{
    char *end = strstr(c->text, "\r\n\r\n");
    if (end == NULL)
        return false;
    *end = '\0';
    c->code = atoi(c->text + 9);
    c->chunked = strcasestr(c->text, "\r\nTransfer-Encoding: chunked") != NULL;
    c->head_done = true;
    if (c->kind == WAITER) {
        const char *etag = strcasestr(c->text, "\r\nETag: ");
        char next[64] = "";
        if (etag != NULL)
            snprintf(next, sizeof next, "%.*s", (int)strcspn(etag + 8, "\r"), etag + 8);
        bool same = strcmp(next, c->last_id) == 0;
        if ((c->code != 200 && c->code != 304) || (c->code == 304) != same)
            fault(c, "a poll got %d with the tag %s", c->code, next);
        run.changes += c->code == 200;
        run.unchanged += c->code == 304;
        snprintf(c->last_id, sizeof c->last_id, "%s", next);
    } else if (c->code != 200 && c->code != 204) {
        fault(c, "status %d", c->code);
    } else if (c->code == 204 && !all_ended(c)) {
        fault(c, "204, but not every end was seen");
    }
    size_t taken = (size_t)(end + 4 - c->text);
    c->bytes -= taken;
    memmove(c->text, end + 4, c->bytes + 1);
    return true;
}

/* Moves what has come of the body to the payload, out of its chunks. */
static void take_body(struct client *c)
{
    size_t at = 0;
    while (at < c->bytes) {
        size_t n = c->bytes - at;
        if (c->chunked && c->chunk == 0) {
            char *line = strstr(c->text + at, "\r\n");
            if (line == c->text + at) { /* the end of the chunk before */
                at += 2;
                continue;
            }
            if (line == NULL)
                break;
            c->chunk = strtol(c->text + at, NULL, 16);
            at = (size_t)(line + 2 - c->text);
            if (c->chunk == 0)
                break;
            continue;
        }
        if (c->chunked && n > (size_t)c->chunk)
            n = (size_t)c->chunk;
        if (c->payload_bytes + n >= TEXT_BYTES) {
            fault(c, "an event of more than %d bytes", TEXT_BYTES);
            break;
        }
        memcpy(c->payload + c->payload_bytes, c->text + at, n);
        c->payload_bytes += n;
        c->payload[c->payload_bytes] = '\0';
        c->chunk -= c->chunked ? (long)n : 0;
        at += n;
    }
    c->bytes -= at;
    memmove(c->text, c->text + at, c->bytes + 1);
    if (c->kind == STREAM)
        take_blocks(c);
}

static void start_over(struct client *c)
{
    if (run.posted < run.jobs || !all_ended(c))
        choose_jobs(c);
}

/* The server closed the connection. */
static void take_end(struct client *c)
{
    run.moved_ms = run.now_ms;
    if (!c->head_done)
        fault(c, "the connection ended without an answer");
    if (c->kind == WAITER) {
        run.polls++;
        if (status_of(c->payload) == ENDED || c->code != 304)
            c->job[0].status = status_of(c->payload);
        if (c->job[0].status == ENDED)
            start_over(c);
    } else if (all_ended(c)) {
        start_over(c);
    } else if (c->code == 200) {
        fault(c, "the stream ended before its jobs");
    }
    hang_up(c, draw(20));
}

static void read_client(struct client *c)
{
    for (;;) {
        size_t room = TEXT_BYTES - 1 - c->bytes;
        if (c->budget >= 0 && room > (size_t)c->budget)
            room = (size_t)c->budget;
        ssize_t n = room == 0 ? 0 : recv(c->fd, c->text + c->bytes, room, MSG_DONTWAIT);
        if (n < 0 && (errno == EAGAIN || errno == EINTR))
            return;
        if (room == 0) { /* as if the line went down, in the midst of whatever came */
            run.drops++;
            hang_up(c, draw(50));
            return;
        }
        if (n <= 0) {
            if (n < 0)
                fault(c, "%s", strerror(errno));
            take_end(c);
            return;
        }
        c->bytes += (size_t)n;
        c->text[c->bytes] = '\0';
        if (c->budget >= 0)
            c->budget -= n;
        if (c->head_done || take_head(c))
            take_body(c);
    }
}

/* ---- the run ----------------------------------------------------------------------------------------------
 */

/* Whether all jobs are posted and every stream has seen the end of its last. */
static bool is_done(void)
{
    if (run.posted < run.jobs)
        return false;
    for (size_t i = 0; i < run.streams; i++)
        if (run.client[i].fd >= 0 || !all_ended(&run.client[i]))
            return false;
    return true;
}

static void go_on(int64_t end_ms)
{
    struct epoll_event event[256];
    size_t ends = 0;
    while (!is_done() && run.now_ms < end_ms && run.now_ms - run.moved_ms < STUCK_MS) {
        bool last = run.posted == run.jobs;
        for (size_t i = 0; i < run.clients; i++) {
            struct client *c = &run.client[i];
            if (c->fd < 0 && run.now_ms >= c->again_ms && !(last && all_ended(c)))
                connect_client(c);
        }
        int n = epoll_wait(run.epoll, event, 256, 5);
        run.now_ms = clock_ms();
        for (int i = 0; i < n; i++) {
            struct client *c = event[i].data.ptr;
            if (event[i].events & EPOLLOUT)
                send_request(c);
            else if (c->fd >= 0)
                read_client(c);
        }
        /* As many ends as there are streams: most have turned to the newest jobs, which then are few. */
        if (run.ends - ends >= run.streams / 2 + 1) {
            ends = run.ends;
            post_some();
        }
    }
}

static char *read_all(const char *path, size_t *ret_bytes)
{
    FILE *file = fopen(path, "r");
    char *text = malloc(1 << 20);
    if (file == NULL || text == NULL)
        die(path);
    *ret_bytes = fread(text, 1, 1 << 20, file);
    fclose(file);
    return text;
}

static void raise_descriptors(void)
{
    struct rlimit limit;
    getrlimit(RLIMIT_NOFILE, &limit);
    limit.rlim_cur = limit.rlim_max;
    setrlimit(RLIMIT_NOFILE, &limit);
}

static void prepare(const char *url, const char *path, size_t waiters)
{
    char host[48];
    unsigned port;
    if (sscanf(url, "http://%47[0-9.]:%u", host, &port) != 2)
        die("the URL must be http://ADDRESS:PORT");
    run.address = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    inet_pton(AF_INET, host, &run.address.sin_addr);
    snprintf(run.host, sizeof run.host, "%s:%u", host, port);
    run.job_text = read_all(path, &run.job_bytes);
    run.clients = run.streams + waiters;
    run.client = calloc(run.clients, sizeof *run.client);
    run.id = calloc(run.jobs, sizeof *run.id);
    run.epoll = epoll_create1(EPOLL_CLOEXEC);
    if (run.client == NULL || run.id == NULL || run.epoll < 0)
        die("prepare");
    run.now_ms = run.moved_ms = clock_ms();
    post_some();
    for (size_t i = 0; i < run.clients; i++) {
        struct client *c = &run.client[i];
        c->kind = i < run.streams ? STREAM : WAITER;
        c->fd = -1;
        c->text = calloc(1, TEXT_BYTES);
        c->payload = calloc(1, TEXT_BYTES);
        if (c->text == NULL || c->payload == NULL)
            die("memory");
        choose_jobs(c);
    }
}

int main(int argc, char **argv)
{
    size_t waiters = 20;
    int64_t seconds = 600;
    run.streams = 100, run.jobs = 100, run.chunk = 10, run.random = 1;
    for (int option; (option = getopt(argc, argv, "n:w:j:k:c:s:t:")) != -1;) {
        unsigned long value = option == '?' ? 0 : strtoul(optarg, NULL, 10);
        switch (option) {
        case 'n':
            run.streams = value;
            break;
        case 'w':
            waiters = value;
            break;
        case 'j':
            run.jobs = value;
            break;
        case 'k':
            run.chunk = value;
            break;
        case 'c':
            run.cancel = (unsigned)value;
            break;
        case 's':
            run.random = value | 1;
            break;
        case 't':
            seconds = (int64_t)value;
            break;
        default:
            return 2;
        }
    }
    if (argc - optind != 2 || run.streams == 0 || run.jobs == 0 || run.chunk == 0)
        return 2;
    raise_descriptors();
    prepare(argv[optind], argv[optind + 1], waiters);
    go_on(run.now_ms + 1000 * seconds);
    bool done = is_done();
    if (!done) {
        size_t waiting = 0;
        for (size_t i = 0; i < run.streams; i++)
            waiting += !all_ended(&run.client[i]);
        printf("# %zu streams never saw the end of their jobs\n", waiting);
    }
    printf("%zu streams (%zu connections with several jobs), %zu jobs, %zu events, %zu states, %zu ends, %zu "
           "dropped in "
           "the midst, %zu resumed, %zu polls (%zu changed, %zu not), %zu faults\n",
           run.streams, run.lists, run.posted, run.events, run.states, run.ends, run.drops, run.comebacks,
           run.polls, run.changes, run.unchanged, run.faults);
    return done && run.faults == 0 ? 0 : 1;
}
