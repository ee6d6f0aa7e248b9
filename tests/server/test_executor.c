/* test_executor.c - tasks run in order, none is lost, and the queue has an end. */
#include "test.h"

#include "../solver/scarce.h"

#include <pthread.h>
#include <stdatomic.h>

#include "executor.h"

static bool no_threads;

int pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*run)(void *), void *arg)
{
    __typeof__(&pthread_create) next =
        (__typeof__(&pthread_create))(uintptr_t)dlsym(RTLD_NEXT, "pthread_create");
    return no_threads ? EAGAIN : next(thread, attr, run, arg);
}

static atomic_int ran, last;
static pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;

static void note(void *data)
{
    int number = *(int *)data;
    assert_int_equal(number, last + 1);
    last = number;
    ran++;
}

static void wait_at_gate(void *data)
{
    (void)data;
    pthread_mutex_lock(&gate);
    pthread_mutex_unlock(&gate);
}

static void test_executor__tasks_run_in_order_and_freeing_waits_for_them(void **state)
{
    (void)state;
    int number[500];
    struct executor *executor = executor_new("test", 500);
    assert_non_null(executor);
    ran = last = 0;
    for (int i = 0; i < 500; i++) {
        number[i] = i + 1;
        assert_int_equal(executor_submit(executor, note, &number[i]), 0);
    }
    assert_null(executor_free(executor));
    assert_int_equal(ran, 500);
}

static void test_executor__what_does_not_fit_is_refused(void **state)
{
    (void)state;
    struct executor *executor = executor_new("test", 3);
    int one = 1;
    ran = last = 0;
    pthread_mutex_lock(&gate);
    assert_int_equal(executor_submit(executor, wait_at_gate, NULL), 0);
    assert_int_equal(executor_submit(executor, wait_at_gate, NULL), 0);
    assert_int_equal(executor_submit(executor, note, &one), 0);
    assert_int_equal(executor_submit(executor, note, &one), -1); /* the running one counts */
    pthread_mutex_unlock(&gate);
    executor_free(executor);
    assert_int_equal(ran, 1);
}

static void test_executor__without_a_thread_there_is_none(void **state)
{
    (void)state;
    no_threads = true;
    assert_null(executor_new("test", 3));
    no_threads = false;
    assert_null(executor_free(NULL));
}

#ifdef CAN_FAIL_ALLOCATIONS
static void test_executor__without_memory_there_is_none(void **state)
{
    (void)state;
    for (long n = 0; n < 2; n++) {
        long before = held;
        countdown = n;
        assert_null(executor_new("test", 3));
        assert_int_equal(countdown, -1);
        assert_int_equal(held, before);
    }
}
#endif

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_executor__tasks_run_in_order_and_freeing_waits_for_them),
        cmocka_unit_test(test_executor__what_does_not_fit_is_refused),
        cmocka_unit_test(test_executor__without_a_thread_there_is_none),
#ifdef CAN_FAIL_ALLOCATIONS
        cmocka_unit_test(test_executor__without_memory_there_is_none),
#endif
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
