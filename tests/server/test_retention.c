/* test_retention.c - the thread that prunes is seen while it sleeps, and not while a step is stuck. */
#include "test.h"

#include "clock.h"
#include "retention.h"
#include "shelf.h"
#include "store_rooms.h"

#include <time.h>

static const struct store_policy keep_all = {1000, 1000000, 1000000000};

static void pause_ms(long ms)
{
    struct timespec t = {0, ms * 1000000L};
    nanosleep(&t, NULL);
}

/* Waits until the thread is seen later than `after`. */
static void wait_seen(struct retention *retention, int64_t after)
{
    for (int64_t limit = clock_monotonic_ms() + 60000; retention_seen_ms(retention) <= after; pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
}

static void test_retention__a_thread_that_sleeps_is_seen(void **state)
{
    struct store *store = open_store(*state);
    struct retention *retention = retention_new(store, &keep_all, NULL);
    assert_non_null(retention);
    wait_seen(retention, clock_monotonic_ms() + 50); /* which only now, told anew, can pass */
    assert_null(retention_free(retention));
    assert_null(store_close(store));
}

static void test_retention__a_step_that_is_stuck_is_not(void **state)
{
    struct store *store = open_store(*state);
    db_lock(store->db);
    struct retention *retention = retention_new(store, &keep_all, NULL);
    assert_non_null(retention);
    int64_t limit = clock_monotonic_ms() + 60000, before, seen = 0;
    do { /* the thread may take its time to begin */
        assert_true(clock_monotonic_ms() < limit);
        before = seen;
        pause_ms(50);
        seen = retention_seen_ms(retention);
    } while (seen != before);
    db_unlock(store->db);
    wait_seen(retention, seen);
    assert_null(retention_free(retention));
    assert_null(store_close(store));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_retention__a_thread_that_sleeps_is_seen, scratch_new,
                                        scratch_free),
        cmocka_unit_test_setup_teardown(test_retention__a_step_that_is_stuck_is_not, scratch_new,
                                        scratch_free),
    };
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
