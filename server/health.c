/* health.c - see health.h. */
#include "health.h"

#include <stdio.h>

static const char *const part_name[PULSES] = {
    [PULSE_MAIN] = "main",       [PULSE_API] = "api loop",    [PULSE_ADMIN] = "admin loop",
    [PULSE_WORKERS] = "workers", [PULSE_CLERK] = "clerk",     [PULSE_READER] = "reader",
    [PULSE_STORE] = "store",     [PULSE_PRUNING] = "pruning",
};

void health_init(struct health *health, int64_t patience_ms, uint64_t min_free_bytes, int64_t now_ms)
{
    health->patience_ms = patience_ms;
    health->min_free_bytes = min_free_bytes;
    for (int i = 0; i < PULSES; i++)
        atomic_store(&health->seen_ms[i], now_ms);
    atomic_store(&health->started, false);
    atomic_store(&health->stopping, false);
    atomic_store(&health->writable, true);
    atomic_store(&health->free_bytes, UINT64_MAX);
    atomic_store(&health->queue_full, false);
}

void health_see(struct health *health, enum pulse_of part, int64_t at_ms)
{
    atomic_store(&health->seen_ms[part], at_ms);
}

const char *health_stale(const struct health *health, int64_t now_ms)
{
    for (int i = 0; i < PULSES; i++)
        if (now_ms - atomic_load(&health->seen_ms[i]) > health->patience_ms)
            return part_name[i];
    return NULL;
}

/* ---- what /readyz tells: one line for each check, `why` if it fails ------------------------------------ */

typedef bool check_fn(const struct health *health, int64_t now_ms, char *why, size_t size);

static bool check_serving(const struct health *health, int64_t now_ms, char *why, size_t size)
{
    (void)now_ms;
    bool stopping = atomic_load(&health->stopping);
    snprintf(why, size, stopping ? "draining: the server is shutting down" : "the server is starting");
    return atomic_load(&health->started) && !stopping;
}

static bool check_store(const struct health *health, int64_t now_ms, char *why, size_t size)
{
    (void)now_ms;
    snprintf(why, size, "the data folder takes no writes");
    return atomic_load(&health->writable);
}

static bool check_space(const struct health *health, int64_t now_ms, char *why, size_t size)
{
    (void)now_ms;
    unsigned long long bytes = atomic_load(&health->free_bytes), wanted = health->min_free_bytes;
    snprintf(why, size, "%llu bytes are left for the data folder, fewer than min-free, %llu", bytes, wanted);
    return bytes >= wanted;
}

static bool check_queue(const struct health *health, int64_t now_ms, char *why, size_t size)
{
    (void)now_ms;
    snprintf(why, size, "full: all places for jobs are taken");
    return !atomic_load(&health->queue_full);
}

static bool check_watchdog(const struct health *health, int64_t now_ms, char *why, size_t size)
{
    const char *stale = health_stale(health, now_ms);
    snprintf(why, size, "stale: the %s has not got on for %lld s", stale != NULL ? stale : "",
             (long long)health->patience_ms / 1000);
    return stale == NULL;
}

static const struct {
    const char *name;
    check_fn *holds;
} check_table[] = {
    {"serving", check_serving}, {"store", check_store},       {"space", check_space},
    {"queue", check_queue},     {"watchdog", check_watchdog},
};

json_t *health_json(const struct health *health, int64_t now_ms, bool *ret_ready)
{
    json_t *checks = json_object();
    *ret_ready = true;
    for (size_t i = 0; i < sizeof check_table / sizeof *check_table; i++) {
        char why[200];
        bool holds = check_table[i].holds(health, now_ms, why, sizeof why);
        *ret_ready &= holds;
        json_object_set_new(checks, check_table[i].name, json_string(holds ? "ok" : why));
    }
    return json_pack("{s:b, s:o}", "ready", *ret_ready, "checks", checks);
}

int health_has_space(const struct health *health, struct problem *reterr)
{
    char why[200];
    return check_space(health, 0, why, sizeof why) ? 0 : problem_set(reterr, PROBLEM_STORAGE, "%s.", why);
}

bool health_can_keep(const struct health *health)
{
    return atomic_load(&health->writable) && health_has_space(health, NULL) == 0;
}
