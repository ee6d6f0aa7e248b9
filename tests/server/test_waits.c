/* test_waits.c - each waiting request is answered once: by the change, by the clock, or at the stop. */
#include "test.h"

#include <pthread.h>

#include "waits.h"

struct request { /* requests are opaque to waits: any address will do */
    int changed, expired;
    bool deserted;
    struct revision revision;
};

static struct request *of(struct http_request *request)
{
    return (struct request *)(void *)request;
}

static struct http_request *as(struct request *request)
{
    return (struct http_request *)(void *)request;
}

static void on_changed(struct http_request *request, struct revision revision, bool ended, const char *body,
                       void *data)
{
    (void)ended, (void)data;
    assert_string_equal(body, "{}");
    of(request)->changed++;
    of(request)->revision = revision;
}

static void on_expired(struct http_request *request, void *data)
{
    (void)data;
    of(request)->expired++;
}

static bool is_deserted(const struct http_request *request)
{
    return ((const struct request *)(const void *)request)->deserted;
}

static const struct wait_answers answers = {on_changed, on_expired, is_deserted, NULL};

static struct revision at(uint32_t attempt, uint32_t counter)
{
    return (struct revision){attempt, counter};
}

static void test_waits__for_the_end_only_the_end_counts(void **state)
{
    (void)state;
    struct waits *waits = waits_new(&answers);
    struct request r = {0};
    assert_int_equal(waits_add(waits, as(&r), "job", at(0, 0), 1000), 0);
    waits_changed(waits, "job", at(1, 5), false, "{}");
    waits_changed(waits, "other", at(1, 5), true, "{}");
    assert_int_equal(r.changed, 0);
    waits_changed(waits, "job", at(1, 6), true, "{}");
    waits_changed(waits, "job", at(1, 6), true, "{}");
    waits_tick(waits, 2000);
    assert_int_equal(r.changed, 1);
    assert_int_equal(r.expired, 0);
    waits_free(waits);
}

static void test_waits__for_a_change_the_next_revision_counts(void **state)
{
    (void)state;
    struct waits *waits = waits_new(&answers);
    struct request r = {0};
    assert_int_equal(waits_add(waits, as(&r), "job", at(1, 5), 1000), 0);
    waits_changed(waits, "job", at(1, 5), false, "{}");
    assert_int_equal(r.changed, 0);
    waits_changed(waits, "job", at(2, 1), false, "{}");
    assert_int_equal(r.changed, 1);
    assert_int_equal(r.revision.attempt, 2);
    waits_free(waits);
}

static void test_waits__time_runs_out_for_each_at_its_own_moment(void **state)
{
    (void)state;
    struct waits *waits = waits_new(&answers);
    struct request r[3] = {{0}};
    for (int i = 0; i < 3; i++)
        assert_int_equal(waits_add(waits, as(&r[i]), "job", at(0, 0), 1000 * (i + 1)), 0);
    waits_tick(waits, 999);
    assert_int_equal(r[0].expired, 0);
    waits_tick(waits, 2000);
    assert_int_equal(r[0].expired + r[1].expired, 2);
    assert_int_equal(r[2].expired, 0);
    waits_close(waits);
    assert_int_equal(r[2].expired, 1);
    assert_int_equal(waits_add(waits, as(&r[0]), "job", at(0, 0), 5000), -1);
    waits_free(waits);
}

static void test_waits__who_has_hung_up_is_let_go_before_the_time_is_up(void **state)
{
    (void)state;
    struct waits *waits = waits_new(&answers);
    struct request r[3] = {{0}};
    for (int i = 0; i < 3; i++)
        assert_int_equal(waits_add(waits, as(&r[i]), "job", at(0, 0), 1000), 0);
    r[1].deserted = true;
    waits_tick(waits, 1);
    assert_int_equal(r[1].expired, 1);
    assert_int_equal(r[0].expired + r[2].expired, 0);
    waits_tick(waits, 1000);
    assert_int_equal(r[0].expired + r[1].expired + r[2].expired, 3);
    waits_free(waits);
}

struct race {
    struct waits *waits;
    struct request request[1000];
};

static void *change(void *data)
{
    struct race *race = data;
    for (int i = 0; i < 2000; i++)
        waits_changed(race->waits, "job", at(1, 1), true, "{}");
    return NULL;
}

static void test_waits__change_and_clock_together_answer_once(void **state)
{
    (void)state;
    static struct race race;
    pthread_t thread;
    race.waits = waits_new(&answers);
    assert_int_equal(pthread_create(&thread, NULL, change, &race), 0);
    for (int i = 0; i < 1000; i++) {
        assert_int_equal(waits_add(race.waits, as(&race.request[i]), "job", at(0, 0), 0), 0);
        waits_tick(race.waits, 1);
    }
    pthread_join(thread, NULL);
    for (int i = 0; i < 1000; i++)
        assert_int_equal(race.request[i].changed + race.request[i].expired, 1);
    waits_free(race.waits);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_waits__for_the_end_only_the_end_counts),
        cmocka_unit_test(test_waits__for_a_change_the_next_revision_counts),
        cmocka_unit_test(test_waits__time_runs_out_for_each_at_its_own_moment),
        cmocka_unit_test(test_waits__who_has_hung_up_is_let_go_before_the_time_is_up),
        cmocka_unit_test(test_waits__change_and_clock_together_answer_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
