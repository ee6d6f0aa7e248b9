/* main.c - draped: flags, signals, wiring, and the order of starting and stopping. */
#include <dirent.h>
#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <sys/un.h>
#include <sysexits.h>
#include <time.h>
#include <unistd.h>

#include "api.h"
#include "clock.h"
#include "drape.h"
#include "files.h"
#include "retention.h"
#include "routes.h"
#include "service.h"

#define TICK_MS 250

/* Of the admin listener: a scraper, a few probes, a person. */
#define ADMIN_CONNECTIONS 32

#define LOOK_MS 1000 /* between two looks at the data folder and the space left */

/* How long an iteration may take that is under way when jobs are told to stop: a factorisation cannot be
 * interrupted. */
#define LAST_STEP_MS 60000

/* For answers on their way out once everything has been answered; slow readers are then cut. */
#define LAST_ANSWERS_MS 5000

/* For the loop to come round, after which it accepts nothing more: a moment, unless it is stuck. */
#define LAST_ACCEPT_MS 500

struct server {
    struct config config;
    struct service service;
    struct api api;
    struct routes api_routes, admin_routes;
    struct retention *retention;
    struct http *http, *admin;
    struct sockaddr_storage address, admin_address; /* where they listen */
    int64_t stop_by_ms;                             /* 0: not stopping */
    atomic_bool looking;                            /* the clerk is at the data folder */
    int64_t looked_ms;
    const char *stale; /* the part last told of as stale; NULL: none */
    sigset_t signals;
};

/* ---- what happens four times a second --------------------------------------------------------------- */

static double seconds(struct timeval t)
{
    return (double)t.tv_sec + (double)t.tv_usec / 1e6;
}

static unsigned open_fds(void)
{
    unsigned count = 0;
    DIR *dir = opendir("/proc/self/fd");
    if (dir == NULL)
        return 0;
    while (readdir(dir) != NULL)
        count++;
    closedir(dir);
    return count < 3 ? 0 : count - 3; /* ".", ".." and the one that reads them */
}

/* In pages: "size resident ..."; see proc(5). */
static double resident_bytes(void)
{
    unsigned long size, resident = 0;
    FILE *in = fopen("/proc/self/statm", "re");
    if (in == NULL)
        return 0;
    if (fscanf(in, "%lu %lu", &size, &resident) != 2)
        resident = 0;
    fclose(in);
    return (double)resident * (double)sysconf(_SC_PAGESIZE);
}

static void measure_process(struct metrics *metrics)
{
    struct rusage usage;
    struct rlimit files;
    if (getrusage(RUSAGE_SELF, &usage) == 0)
        metrics_set(metrics, METRIC_CPU_SECONDS, seconds(usage.ru_utime) + seconds(usage.ru_stime));
    if (getrlimit(RLIMIT_NOFILE, &files) == 0)
        metrics_set(metrics, METRIC_MAX_FDS, (double)files.rlim_cur);
    metrics_set(metrics, METRIC_OPEN_FDS, open_fds());
    metrics_set(metrics, METRIC_RESIDENT_BYTES, resident_bytes());
}

static void measure_analyses(const struct api *api)
{
    drape_analyses_counts counts = drape_analyses_count(api->analyses);
    metrics_set(api->metrics, METRIC_ANALYSIS_HITS, (double)counts.hits);
    metrics_set(api->metrics, METRIC_ANALYSIS_MISSES, (double)counts.misses);
    metrics_set(api->metrics, METRIC_ANALYSIS_BYTES, (double)counts.bytes);
}

/* On the clerk's thread: what asks the disk, and so may never come back. */
static void look_at_data(void *data)
{
    struct server *s = data;
    struct health *health = &s->api.health;
    struct statvfs space;
    atomic_store(&health->writable, files_probe(s->config.data) == 0);
    if (statvfs(s->config.data, &space) == 0) {
        atomic_store(&health->free_bytes, (uint64_t)space.f_bavail * space.f_frsize);
        metrics_set(s->api.metrics, METRIC_BYTES_FREE, (double)space.f_bavail * (double)space.f_frsize);
    }
    measure_process(s->api.metrics);
    measure_analyses(&s->api);
    store_ask(s->api.store, NULL); /* that it answers is what counts: what it refuses, it logs */
    health_see(health, PULSE_STORE, clock_monotonic_ms());
    atomic_store(&s->looking, false);
}

static void send_clerk_to_data(struct server *s, int64_t now)
{
    int64_t patience = s->api.health.patience_ms;
    if (now - s->looked_ms < (patience / 4 < LOOK_MS ? patience / 4 : LOOK_MS) || atomic_load(&s->looking))
        return;
    s->looked_ms = now;
    atomic_store(&s->looking, true);
    if (executor_submit(s->api.clerk, look_at_data, s) != 0)
        atomic_store(&s->looking, false);
}

static void see_parts(struct server *s, const struct queue_counts *counts, int64_t now)
{
    struct health *health = &s->api.health;
    health_see(health, PULSE_MAIN, now);
    health_see(health, PULSE_API, http_answered_ms(s->http));
    health_see(health, PULSE_ADMIN, http_answered_ms(s->admin));
    health_see(health, PULSE_WORKERS, counts->seen_ms);
    health_see(health, PULSE_CLERK, executor_seen_ms(s->api.clerk));
    health_see(health, PULSE_READER, executor_seen_ms(s->api.reader));
    health_see(health, PULSE_PRUNING, retention_seen_ms(s->retention));
    atomic_store(&health->queue_full, counts->queued + counts->running >= s->config.limits.queued_jobs);
}

/* Whether all parts work; a part that does not is logged once. */
static bool is_well(struct server *s, int64_t now)
{
    const char *stale = health_stale(&s->api.health, now);
    if (stale != NULL && stale != s->stale)
        log_event(LOG_LEVEL_ERROR, "health.stale", "part=\"%s\"", stale);
    s->stale = stale;
    return stale == NULL;
}

static void tell_service(struct server *s, const struct queue_counts *counts, int64_t now)
{
    char status[128];
    snprintf(status, sizeof status, "%s: %zu running, %zu queued, %u streams",
             s->stop_by_ms == 0 ? "Serving" : "Stopping", counts->running, counts->queued,
             hub_followers(s->api.hub));
    service_tick(&s->service, now, is_well(s, now), now < s->stop_by_ms, status);
}

static void tick(struct server *s)
{
    int64_t now = clock_monotonic_ms();
    struct queue_counts counts;
    http_tick(s->http);
    http_tick(s->admin);
    waits_tick(s->api.waits, now);
    hub_tick(s->api.hub, now);
    queue_measure(s->api.queue, &counts);
    metrics_set(s->api.metrics, METRIC_STREAMS, hub_followers(s->api.hub));
    metrics_set(s->api.metrics, METRIC_CONNECTIONS, http_connections(s->http));
    send_clerk_to_data(s, now);
    queue_hold(s->api.queue, !health_can_keep(&s->api.health));
    see_parts(s, &counts, now);
    tell_service(s, &counts, now);
}

/* SIGHUP. */
static void reload_keys(struct server *s)
{
    struct problem problem;
    if (s->api.keys == NULL)
        return;
    if (keys_reload(s->api.keys, &problem) != 0)
        log_event(LOG_LEVEL_ERROR, "keys.refused", "why=\"%s\"", problem.detail);
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
    log_event(LOG_LEVEL_ERROR, "start.failed", "what=%s why=\"%s\"", what, why);
    return -1;
}

/* The socket that systemd passes under this name, else one of our own; *ret is where it listens. */
static int open_listener(struct server *s, const char *name, const struct sockaddr_storage *wanted,
                         int *ret_fd, struct sockaddr_storage *ret)
{
    socklen_t size = sizeof *ret;
    unsigned port;
    int fd = service_take_socket(&s->service, name);
    if (fd < 0 && http_listen((const struct sockaddr *)wanted, config_address_size(wanted), &fd, &port) != 0)
        return fail(name, strerror(errno));
    if (getsockname(fd, (struct sockaddr *)ret, &size) != 0)
        return fail(name, strerror(errno));
    if (s->config.keys[0] == '\0' && ret->ss_family != AF_UNIX && !config_is_loopback(ret))
        return fail(name, "without keys only this machine is served");
    *ret_fd = fd;
    return 0;
}

static int start_http(int fd, unsigned connections, const char *spool_dir, size_t spool_bytes,
                      struct routes *routes, struct http **ret)
{
    struct http_setup setup = {
        .listen_fd = fd,
        .connections = connections,
        .spool_bytes = spool_bytes,
        .spool_dir = spool_dir,
        .begin = routes_begin,
        .handle = routes_handle,
        .leaving = routes_leaving,
        .finished = routes_finished,
        .data = routes,
    };
    if (http_start(&setup, ret) == 0)
        return 0;
    close(fd);
    return fail("http", "no event loop");
}

static void on_job_changed(const char *id, struct revision revision, bool ended, const char *body, void *data)
{
    struct api *api = data;
    waits_changed(api->waits, id, revision, ended, body);
}

static int make_rooms(struct server *s)
{
    struct api *api = &s->api;
    struct wait_answers answers = {job_wait_changed, job_wait_expired, http_deserted, NULL};
    struct problem problem;
    api->config = &s->config;
    if (about_open(api) != 0 || (api->metrics = metrics_new()) == NULL ||
        (api->hub = hub_new(s->config.limits.streams, s->config.limits.streams_per_key)) == NULL ||
        (api->waits = waits_new(&answers)) == NULL || (api->claims = claims_new()) == NULL ||
        (api->fields = fields_new(s->config.field_cache_bytes, api->metrics)) == NULL ||
        (api->analyses = drape_analyses_new(s->config.analysis_cache_bytes)) == NULL ||
        (api->processors = drape_processors_new(s->config.workers)) == NULL)
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
                                .fields = api->fields,
                                .analyses = api->analyses,
                                .processors = api->processors};
    api->queue = queue_new(&setup);
    /* Every connection may have one thing waiting at the clerk's; and a wait that expires, and our own look.
     */
    api->clerk = executor_new("draped-clerk", s->config.limits.connections + 2);
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
    int fd, admin_fd;
    s->api_routes = (struct routes){&s->api, ROUTES_API};
    s->admin_routes = (struct routes){&s->api, ROUTES_ADMIN};
    if (open_listener(s, SERVICE_API, &s->config.listen, &fd, &s->address) != 0 ||
        open_listener(s, SERVICE_ADMIN, &s->config.admin, &admin_fd, &s->admin_address) != 0)
        return -1;
    if (start_http(fd, (unsigned)limits->connections, s->config.data, spool_bytes, &s->api_routes,
                   &s->http) != 0)
        return -1;
    return start_http(admin_fd, ADMIN_CONNECTIONS, NULL, 0, &s->admin_routes, &s->admin);
}

static void format_url(const struct sockaddr_storage *address, char *ret, size_t size)
{
    char text[CONFIG_ADDRESS_SIZE];
    if (address->ss_family == AF_UNIX) {
        snprintf(ret, size, "unix:%s", ((const struct sockaddr_un *)address)->sun_path);
        return;
    }
    config_format_address(address, text);
    snprintf(ret, size, "http://%s", text);
}

/* Tells whoever started us: the URL file appears whole or not at all. */
static int announce(struct server *s)
{
    char api[128], admin[128], text[260];
    format_url(&s->address, api, sizeof api);
    format_url(&s->admin_address, admin, sizeof admin);
    snprintf(text, sizeof text, "%s\n%s\n", api, admin);
    if (s->config.url_file[0] != '\0' && files_write_whole(s->config.url_file, text, strlen(text)) != 0)
        return fail("url-file", strerror(errno));
    log_event(LOG_LEVEL_INFO, "started", "version=%s api=%s admin=%s workers=%u blas=%s kernels=%s pid=%d",
              drape_version(), api, admin, s->config.workers, s->api.blas, drape_kernels(), (int)getpid());
    service_ready("Serving");
    return 0;
}

static int start(struct server *s)
{
    struct problem problem;
    char why[128];
    if (service_open(&s->service, why, sizeof why) != 0)
        return fail("sockets", why);
    int64_t patience = service_patience_ms(&s->service);
    health_init(&s->api.health, patience > 0 ? patience : HEALTH_PATIENCE_MS, s->config.min_free_bytes,
                clock_monotonic_ms());
    if (id_init() != 0)
        return fail("random", "the system has no randomness");
    if (s->config.url_file[0] != '\0')
        unlink(s->config.url_file); /* an earlier daemon's would send somebody astray */
    s->api.blas = drape_blas_prepare();
    if (make_rooms(s) != 0)
        return -1;
    if (queue_start(s->api.queue, &problem) != 0)
        return fail("queue", problem.detail);
    if ((s->retention = retention_new(s->api.store, &s->config.retain, s->api.metrics)) == NULL)
        return fail("retention", "out of memory");
    if (start_listeners(s) != 0)
        return -1;
    health_see(&s->api.health, PULSE_STORE, clock_monotonic_ms());
    atomic_store(&s->api.health.started, true);
    return announce(s);
}

/* ---- stopping ------------------------------------------------------------------------------------------ */

/* Lets running jobs finish, up to the drain timeout or the next signal; then puts them back. */
static void drain_jobs(struct server *s)
{
    int64_t patience = clock_monotonic_ms() + 1000 * (int64_t)s->config.drain_seconds;
    s->stop_by_ms = patience + LAST_STEP_MS;
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
    unsigned turns = http_turns(s->http) + 2;
    http_quiesce(s->http);
    waits_close(s->api.waits);
    hub_close(s->api.hub);
    int64_t now = clock_monotonic_ms(), patience = now + LAST_ANSWERS_MS, accepted = now + LAST_ACCEPT_MS;
    while (http_suspended(s->http) > 0 || (http_active(s->http) > 0 && now < patience) ||
           ((int)(http_turns(s->http) - turns) < 0 && now < accepted)) {
        struct timespec t = {0, 2000000};
        nanosleep(&t, NULL);
        http_tick(s->http);
        now = clock_monotonic_ms();
    }
    s->http = http_stop(s->http);
    s->admin = http_stop(s->admin);
}

static void stop(struct server *s)
{
    struct api *api = &s->api;
    atomic_store(&api->health.stopping, true);
    if (s->http != NULL && s->admin != NULL) {
        service_stopping();
        log_event(LOG_LEVEL_INFO, "stopping", "running=%u", queue_running(api->queue));
        drain_jobs(s);
    } else if (api->queue != NULL) {
        queue_interrupt(api->queue);
    }
    stop_listeners(s);
    api->clerk = executor_free(api->clerk);
    api->reader = executor_free(api->reader);
    api->queue = queue_free(api->queue);
    s->retention = retention_free(s->retention);
    api->fields = fields_free(api->fields);
    api->analyses = drape_analyses_free(api->analyses);
    api->processors = drape_processors_free(api->processors);
    api->waits = waits_free(api->waits);
    api->claims = claims_free(api->claims);
    api->hub = hub_free(api->hub);
    api->store = store_close(api->store);
    api->metrics = metrics_free(api->metrics);
    api->keys = keys_free(api->keys);
    about_close(api);
}

/* ---- main -----------------------------------------------------------------------------------------------
 */

/* Blocked in every thread, and taken only where main waits for them. */
static pthread_t main_thread;

/* OpenBLAS starts threads before main does anything: they do not have the signals blocked, and hand them on.
 */
static void hand_to_main(int signal_number)
{
    pthread_kill(main_thread, signal_number);
}

static void block_signals(struct server *s)
{
    main_thread = pthread_self();
    signal(SIGTERM, hand_to_main);
    signal(SIGINT, hand_to_main);
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
    block_signals(&server); /* first: who is told to stop while he starts stops in order, too */
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
    log_choose(server.config.log_format);
    int failed = start(&server);
    if (!failed)
        while (wait_for_signal(&server, TICK_MS) == 0)
            continue;
    stop(&server);
    if (!failed)
        log_event(LOG_LEVEL_INFO, "stopped", "status=0");
    return failed ? EXIT_FAILURE : EXIT_SUCCESS;
}
