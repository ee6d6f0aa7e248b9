/* test_scarce.c - the allocator of the tests: what fails, what is counted, and for whom. */
#include "test.h"

#include "scarce.h"

#include <pthread.h>

#ifdef CAN_FAIL_ALLOCATIONS
static pthread_barrier_t barrier;

/* Four allocations of another thread's, once the test is ready; whether each succeeded. */
static void *take(void *all)
{
    *(bool *)all = true;
    pthread_barrier_wait(&barrier);
    for (int n = 0; n < 4; n++) {
        void *volatile p = malloc(16);
        if (p == NULL)
            *(bool *)all = false;
        free(p);
    }
    return NULL;
}
#endif

static void test_scarce__the_one_asked_for_fails(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    long before = held, of = asked;
    fail_at(1);
    void *volatile a = malloc(16), *volatile b = malloc(16), *volatile c = malloc(16);
    assert_non_null(a);
    assert_null(b);
    assert_non_null(c);
    assert_true(has_failed());
    assert_int_equal(held - before, 2);
    assert_int_equal(asked - of, 3);
    free(a);
    free(c);
    assert_int_equal(held, before);
#else
    skip();
#endif
}

/* OpenBLAS's threads start when they like. */
static void test_scarce__another_thread_is_not_concerned(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    pthread_t thread;
    bool all;
    pthread_barrier_init(&barrier, NULL, 2);
    assert_int_equal(pthread_create(&thread, NULL, take, &all), 0);
    long before = held, of = asked;
    fail_at(2);
    pthread_barrier_wait(&barrier);
    pthread_join(thread, NULL);
    assert_true(all);
    assert_int_equal(countdown, 2);
    assert_int_equal(asked, of);
    assert_int_equal(held, before);
    assert_false(has_failed());
    pthread_barrier_destroy(&barrier);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scarce__the_one_asked_for_fails),
        cmocka_unit_test(test_scarce__another_thread_is_not_concerned),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
