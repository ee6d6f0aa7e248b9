/* test_health.c - each part that stops is told by name, and so is each reason not to be ready. */
#include "test.h"

#include "clock.h"
#include "executor.h"
#include "health.h"

#include <pthread.h>
#include <time.h>

#define PATIENCE 1000

static struct health health;

static int set_up(void **state)
{
    (void)state;
    health_init(&health, PATIENCE, 1000, 0);
    atomic_store(&health.started, true);
    return 0;
}

/* What /readyz says of a check at `now`. */
static void assert_check(int64_t now, const char *check, const char *said, bool want_ready)
{
    bool ready;
    json_t *json = health_json(&health, now, &ready);
    assert_non_null(json);
    assert_int_equal(ready, want_ready);
    assert_int_equal(json_is_true(json_object_get(json, "ready")), want_ready);
    const char *text = json_string_value(json_object_get(json_object_get(json, "checks"), check));
    assert_non_null(text);
    if (strstr(text, said) == NULL)
        print_error("%s: %s, wanted %s\n", check, text, said);
    assert_non_null(strstr(text, said));
    json_decref(json);
}

static void test_health__a_part_is_stale_just_past_the_patience(void **state)
{
    (void)state;
    for (int part = 0; part < PULSES; part++) {
        health_init(&health, PATIENCE, 0, 0);
        for (int other = 0; other < PULSES; other++)
            if (other != part)
                health_see(&health, (enum pulse_of)other, 5 * PATIENCE);
        health_see(&health, (enum pulse_of)part, 1);
        assert_null(health_stale(&health, 1 + PATIENCE));
        assert_non_null(health_stale(&health, 2 + PATIENCE));
        health_see(&health, (enum pulse_of)part, 2);
        assert_null(health_stale(&health, 2 + PATIENCE));
    }
}

static void test_health__each_reason_not_to_be_ready_is_told(void **state)
{
    (void)state;
    assert_check(0, "serving", "ok", true);
    atomic_store(&health.started, false);
    assert_check(0, "serving", "starting", false);
    atomic_store(&health.started, true);
    atomic_store(&health.stopping, true);
    assert_check(0, "serving", "draining", false);
    atomic_store(&health.stopping, false);
    atomic_store(&health.writable, false);
    assert_check(0, "store", "takes no writes", false);
    atomic_store(&health.writable, true);
    atomic_store(&health.queue_full, true);
    assert_check(0, "queue", "full", false);
    atomic_store(&health.queue_full, false);
    health_see(&health, PULSE_CLERK, -1);
    assert_check(PATIENCE, "watchdog", "the clerk has not got on", false);
    health_see(&health, PULSE_CLERK, 0);
    assert_check(PATIENCE, "watchdog", "ok", true);
}

static void test_health__space_is_short_below_the_limit(void **state)
{
    (void)state;
    struct problem problem = {0};
    atomic_store(&health.free_bytes, 1000);
    assert_check(0, "space", "ok", true);
    assert_int_equal(health_has_space(&health, &problem), 0);
    atomic_store(&health.free_bytes, 999);
    assert_check(0, "space", "999 bytes are left", false);
    assert_int_equal(health_has_space(&health, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
}

static pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;

static void wait_at_gate(void *data)
{
    (void)data;
    pthread_mutex_lock(&gate);
    pthread_mutex_unlock(&gate);
}

static void wait_ms(long ms)
{
    struct timespec t = {ms / 1000, ms % 1000 * 1000000L};
    nanosleep(&t, NULL);
}

/* As main sees to it at each tick. */
static const char *stale_with(struct executor *clerk)
{
    int64_t now = clock_monotonic_ms();
    for (int part = 0; part < PULSES; part++)
        health_see(&health, (enum pulse_of)part, now);
    health_see(&health, PULSE_CLERK, executor_seen_ms(clerk));
    return health_stale(&health, now);
}

static void test_health__a_clerk_that_is_stuck_is_stale_and_an_idle_one_is_not(void **state)
{
    (void)state;
    struct executor *clerk = executor_new("test", 100);
    health_init(&health, 50, 0, clock_monotonic_ms());
    wait_ms(120); /* idle for longer than the patience */
    assert_null(stale_with(clerk));
    pthread_mutex_lock(&gate);
    for (int i = 0; i < 3; i++)
        assert_int_equal(executor_submit(clerk, wait_at_gate, NULL), 0);
    wait_ms(120);
    const char *stale = stale_with(clerk);
    pthread_mutex_unlock(&gate);
    assert_string_equal(stale, "clerk");
    assert_null(executor_free(clerk));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(test_health__a_part_is_stale_just_past_the_patience, set_up),
        cmocka_unit_test_setup(test_health__each_reason_not_to_be_ready_is_told, set_up),
        cmocka_unit_test_setup(test_health__space_is_short_below_the_limit, set_up),
        cmocka_unit_test_setup(test_health__a_clerk_that_is_stuck_is_stale_and_an_idle_one_is_not, set_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
