/* main.c - draped: flags, signals, wiring, and the order of starting and stopping. */
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <sysexits.h>
#include <time.h>
#include <unistd.h>

#include <systemd/sd-daemon.h>

#include "api.h"
#include "clock.h"
#include "drape.h"
#include "files.h"
#include "routes.h"

#define TICK_MS 250

/* Of the admin listener: a scraper, a few probes, a person. */
#define ADMIN_CONNECTIONS 32

#define FREE_SPACE_MS 5000 /* between two looks at the data folder and the space left */

/* For answers on their way out once everything has been answered; slow readers are then cut. */
#define LAST_ANSWERS_MS 5000

struct server {
    struct config config;
    struct api api;
    struct routes api_routes, admin_routes;
    struct http *http, *admin;
    unsigned port, admin_port;
    int64_t space_ms;
    sigset_t signals;
};

/* ---- what happens four times a second --------------------------------------------------------------- */

static void measure(struct server *s, int64_t now)
{
    struct statvfs space;
    queue_measure(s->api.queue);
    metrics_set(s->api.metrics, METRIC_STREAMS, hub_followers(s->api.hub));
    metrics_set(s->api.metrics, METRIC_CONNECTIONS, http_connections(s->http));
    if (now - s->space_ms < FREE_SPACE_MS)
        return;
    s->space_ms = now;
    atomic_store(&s->api.writable, files_probe(s->config.data) == 0);
    if (statvfs(s->config.data, &space) == 0)
        metrics_set(s->api.metrics, METRIC_BYTES_FREE, (double)space.f_bavail * (double)space.f_frsize);
}

static void tick(struct server *s)
{
    int64_t now = clock_monotonic_ms();
    http_tick(s->http);
    http_tick(s->admin);
    waits_tick(s->api.waits, now);
    hub_tick(s->api.hub, now);
    measure(s, now);
}

/* SIGHUP. */
static void reload_keys(struct server *s)
{
    struct problem problem;
    char why[LOG_QUOTE_SIZE];
    if (s->api.keys == NULL)
        return;
    if (keys_reload(s->api.keys, &problem) != 0)
        log_event(LOG_LEVEL_ERROR, "keys.refused", "why=%s", log_quote(problem.detail, why));
    else
        queue_reconsider(s->api.queue);
}

/* Ticks, and waits up to `ms` for a signal that ends us; its number, or 0. */
static int wait_for_signal(struct server *s, int ms)
{
    struct timespec t = {ms / 1000, ms % 1000 * 1000000L};
    tick(s);
    int signal_number = sigtimedwait(&s->signals, NULL, &t);
    if (signal_number == SIGHUP) {
        reload_keys(s);
        return 0;
    }
    return signal_number > 0 ? signal_number : 0;
}

/* ---- starting ----------------------------------------------------------------------------------------- */

static int fail(const char *what, const char *why)
{
    char quoted[LOG_QUOTE_SIZE];
    log_event(LOG_LEVEL_ERROR, "start.failed", "what=%s why=%s", what, log_quote(why, quoted));
    return -1;
}

/* One listener with its loop. 0 or -1. */
static int start_listener(const struct sockaddr_storage *address, unsigned connections, const char *spool_dir,
                          size_t spool_bytes, struct routes *routes, struct http **ret, unsigned *ret_port)
{
    struct http_setup setup = {
        .connections = connections,
        .spool_bytes = spool_bytes,
        .spool_dir = spool_dir,
        .begin = routes_begin,
        .handle = routes_handle,
        .finished = routes_finished,
        .data = routes,
    };
    if (http_listen((const struct sockaddr *)address, config_address_size(address), &setup.listen_fd,
                    ret_port) != 0)
        return fail("listen", strerror(errno));
    if (http_start(&setup, ret) != 0) {
        close(setup.listen_fd);
        return fail("http", "no event loop");
    }
    return 0;
}

static void on_job_changed(const char *id, struct revision revision, bool ended, const char *body, void *data)
{
    struct api *api = data;
    waits_changed(api->waits, id, revision, ended, body);
}

static int make_rooms(struct server *s)
{
    struct api *api = &s->api;
    struct wait_answers answers = {job_wait_changed, job_wait_expired, NULL};
    struct problem problem;
    api->config = &s->config;
    if ((api->metrics = metrics_new()) == NULL || (api->hub = hub_new(s->config.limits.streams)) == NULL ||
        (api->waits = waits_new(&answers)) == NULL ||
        (api->fields = fields_new(s->config.field_cache_bytes, api->metrics)) == NULL)
        return fail("rooms", "out of memory");
    if (s->config.keys[0] != '\0' &&
        keys_open(s->config.keys, &s->config.limits.key, &api->keys, &problem) != 0)
        return fail("keys", problem.detail);
    metrics_set(api->metrics, METRIC_START_TIME, (double)clock_wall_ms() / 1000);
    if (store_open(s->config.data, api->metrics, &api->store, &problem) != 0)
        return fail("store", problem.detail);
    struct queue_setup setup = {.store = api->store,
                                .hub = api->hub,
                                .metrics = api->metrics,
                                .limits = &s->config.limits,
                                .keys = api->keys,
                                .workers = s->config.workers,
                                .changed = on_job_changed,
                                .data = api,
                                .fields = api->fields};
    api->queue = queue_new(&setup);
    /* Every connection may have one thing waiting at the clerk's, and a wait that expires. */
    api->clerk = executor_new("draped-clerk", s->config.limits.connections + 1);
    api->reader = executor_new("draped-reader", s->config.limits.reading);
    if (api->queue == NULL || api->clerk == NULL || api->reader == NULL)
        return fail("rooms", "out of memory");
    return 0;
}

static int start_listeners(struct server *s)
{
    const struct limits *limits = &s->config.limits;
    /* A dribbler holds what it has sent; honest bodies need their room beside it. */
    size_t spool_bytes = limits->reading * limits->body_bytes;
    s->api_routes = (struct routes){&s->api, ROUTES_API};
    s->admin_routes = (struct routes){&s->api, ROUTES_ADMIN};
    if (start_listener(&s->config.listen, (unsigned)limits->connections, s->config.data, spool_bytes,
                       &s->api_routes, &s->http, &s->port) != 0)
        return -1;
    return start_listener(&s->config.admin, ADMIN_CONNECTIONS, NULL, 0, &s->admin_routes, &s->admin,
                          &s->admin_port);
}

static void format_url(const struct sockaddr_storage *address, unsigned port, char *ret, size_t size)
{
    char host[INET6_ADDRSTRLEN] = "";
    if (address->ss_family == AF_INET) {
        inet_ntop(AF_INET, &((const struct sockaddr_in *)address)->sin_addr, host, sizeof host);
        snprintf(ret, size, "http://%s:%u", host, port);
    } else {
        inet_ntop(AF_INET6, &((const struct sockaddr_in6 *)address)->sin6_addr, host, sizeof host);
        snprintf(ret, size, "http://[%s]:%u", host, port);
    }
}

/* Tells whoever started us: the URL file appears whole or not at all. */
static int announce(struct server *s)
{
    char api[96], admin[96], text[200];
    format_url(&s->config.listen, s->port, api, sizeof api);
    format_url(&s->config.admin, s->admin_port, admin, sizeof admin);
    snprintf(text, sizeof text, "%s\n%s\n", api, admin);
    if (s->config.url_file[0] != '\0' && files_write_whole(s->config.url_file, text, strlen(text)) != 0)
        return fail("url-file", strerror(errno));
    log_event(LOG_LEVEL_INFO, "started", "version=%s api=%s admin=%s workers=%u blas=%s pid=%d",
              drape_version(), api, admin, s->config.workers, s->api.blas, (int)getpid());
    sd_notifyf(0, "READY=1\nSTATUS=Serving %s", api);
    return 0;
}

static int start(struct server *s)
{
    struct problem problem;
    if (id_init() != 0)
        return fail("random", "the system has no randomness");
    if (s->config.url_file[0] != '\0')
        unlink(s->config.url_file); /* an earlier daemon's would send somebody astray */
    s->api.blas = drape_blas_prepare();
    if (make_rooms(s) != 0)
        return -1;
    if (queue_start(s->api.queue, &problem) != 0)
        return fail("queue", problem.detail);
    if (start_listeners(s) != 0)
        return -1;
    atomic_store(&s->api.writable, true);
    atomic_store(&s->api.ready, true);
    return announce(s);
}

/* ---- stopping ------------------------------------------------------------------------------------------ */

/* Lets running jobs finish, up to the drain timeout or the next signal; then puts them back. */
static void drain_jobs(struct server *s)
{
    int64_t patience = clock_monotonic_ms() + 1000 * (int64_t)s->config.drain_seconds;
    queue_drain(s->api.queue);
    while (queue_running(s->api.queue) > 0 && clock_monotonic_ms() < patience)
        if (wait_for_signal(s, 20) != 0)
            break;
    queue_interrupt(s->api.queue);
    while (queue_running(s->api.queue) > 0)
        wait_for_signal(s, 5);
}

/* libmicrohttpd aborts when it is stopped with a connection suspended: first everyone is answered. */
static void stop_listeners(struct server *s)
{
    if (s->http == NULL)
        return;
    http_quiesce(s->http);
    waits_close(s->api.waits);
    hub_close(s->api.hub);
    int64_t patience = clock_monotonic_ms() + LAST_ANSWERS_MS;
    while (http_suspended(s->http) > 0 || (http_active(s->http) > 0 && clock_monotonic_ms() < patience)) {
        struct timespec t = {0, 2000000};
        nanosleep(&t, NULL);
    }
    s->http = http_stop(s->http);
    s->admin = http_stop(s->admin);
}

static void stop(struct server *s)
{
    struct api *api = &s->api;
    atomic_store(&api->ready, false);
    if (s->http != NULL && s->admin != NULL) {
        sd_notify(0, "STOPPING=1");
        log_event(LOG_LEVEL_INFO, "stopping", "running=%u", queue_running(api->queue));
        drain_jobs(s);
    } else if (api->queue != NULL) {
        queue_interrupt(api->queue);
    }
    stop_listeners(s);
    api->clerk = executor_free(api->clerk);
    api->reader = executor_free(api->reader);
    api->queue = queue_free(api->queue);
    api->fields = fields_free(api->fields);
    api->waits = waits_free(api->waits);
    api->hub = hub_free(api->hub);
    api->store = store_close(api->store);
    api->metrics = metrics_free(api->metrics);
    api->keys = keys_free(api->keys);
}

/* ---- main -----------------------------------------------------------------------------------------------
 */

/* Blocked in every thread, and taken only where main waits for them. */
static void block_signals(struct server *s)
{
    sigemptyset(&s->signals);
    sigaddset(&s->signals, SIGTERM);
    sigaddset(&s->signals, SIGINT);
    sigaddset(&s->signals, SIGHUP);
    pthread_sigmask(SIG_BLOCK, &s->signals, NULL);
    signal(SIGPIPE, SIG_IGN);
}

/* The key and its entry, a line each; this is the only time that anybody sees the key. */
static int make_key(const char *name)
{
    char key[KEY_TEXT_SIZE], *entry;
    if (id_init() != 0 || keys_make(name, key, &entry) != 0) {
        fprintf(stderr, "draped: a key's name has 1 to %d letters, digits, dots, hyphens or underscores\n",
                KEY_NAME_SIZE - 1);
        return EX_USAGE;
    }
    printf("%s\n%s\n", key, entry);
    free(entry);
    return fflush(stdout) == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

int main(int argc, char **argv)
{
    static struct server server; /* outlives main's frame: threads hold pointers to it */
    char message[CONFIG_MESSAGE_SIZE];
    int refused = config_parse(argc, argv, &server.config, message, sizeof message);
    if (refused) {
        fprintf(stderr, "draped: %s\nTry `draped --help' for more information.\n", message);
        return refused;
    }
    if (server.config.check_only) {
        config_print(stdout, &server.config);
        return fflush(stdout) == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
    }
    if (server.config.make_key != NULL)
        return make_key(server.config.make_key);
    log_open(server.config.log_level);
    block_signals(&server);
    int failed = start(&server);
    if (!failed)
        while (wait_for_signal(&server, TICK_MS) == 0)
            continue;
    stop(&server);
    if (!failed)
        log_event(LOG_LEVEL_INFO, "stopped", "status=0");
    return failed ? EXIT_FAILURE : EXIT_SUCCESS;
}
