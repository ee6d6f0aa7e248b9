/* test_stream.c - what a follower is given: order, numbers, resuming, heartbeats, the end. */
#include "test.h"

#include <pthread.h>

#include "clock.h"
#include "stream.h"

struct rig {
    struct hub *hub;
    struct stream *stream;
    int wakes;
};

static int rig_new(void **state)
{
    static struct rig rig;
    rig = (struct rig){.hub = hub_new(3, 2)};
    rig.stream = stream_new(rig.hub);
    *state = &rig;
    return rig.hub == NULL || rig.stream == NULL;
}

static int rig_free(void **state)
{
    struct rig *rig = *state;
    stream_release(rig->stream);
    assert_int_equal(hub_followers(rig->hub), 0);
    hub_free(rig->hub);
    return 0;
}

static void on_wake(void *data)
{
    ((struct rig *)data)->wakes++; /* under the hub's lock */
}

static struct revision at(uint32_t attempt, uint32_t counter)
{
    return (struct revision){attempt, counter};
}

/* Job ids of the right form that differ in their first digit; constant, for threads ask too. */
static const char *job(unsigned digit)
{
    static const char id[][ID_SIZE] = {
        "00123456789abcdef0123456789abcde", "10123456789abcdef0123456789abcde",
        "20123456789abcdef0123456789abcde", "30123456789abcdef0123456789abcde",
        "40123456789abcdef0123456789abcde",
    };
    return id[digit];
}

static struct follower *new_follower(struct rig *rig, size_t jobs, bool named)
{
    struct follower *f = NULL;
    assert_int_equal(follower_new(rig->hub, "", jobs, named, on_wake, rig, &f), 0);
    return f;
}

static struct follower *follow(struct rig *rig, struct revision seen, struct revision now)
{
    struct follower *f = new_follower(rig, 1, false);
    assert_int_equal(follower_add(f, job(1), rig->stream, seen, now, "{\"now\":1}"), 0);
    return f;
}

/* Everything there is to pull, through a buffer small enough to cut events in pieces. */
static ssize_t pull_all(struct follower *f, char text[4096])
{
    size_t n = 0;
    ssize_t got;
    while ((got = follower_pull(f, text + n, 7)) > 0)
        n += (size_t)got;
    text[n] = '\0';
    return got;
}

static void test_stream__a_fresh_follower_begins_with_what_stands_now(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    stream_publish(rig->stream, STREAM_STATE, at(1, 1), "{\"a\":1}");
    stream_publish(rig->stream, STREAM_PROGRESS, at(1, 2), "{\"a\":2}");
    struct follower *f = follow(rig, at(0, 0), at(1, 2));
    assert_int_equal(pull_all(f, text), 0);
    assert_string_equal(text, "retry: 3000\n\nid: 1.2\nevent: state\ndata: {\"now\":1}\n\n");
    stream_publish(rig->stream, STREAM_PROGRESS, at(1, 3), "{\"a\":3}");
    assert_int_equal(rig->wakes, 1);
    assert_int_equal(pull_all(f, text), 0);
    assert_string_equal(text, "id: 1.3\nevent: progress\ndata: {\"a\":3}\n\n");
    follower_free(f);
}

static void test_stream__a_resumed_follower_gets_every_newer_state_and_the_newest_progress(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    stream_publish(rig->stream, STREAM_STATE, at(1, 1), "\"queued\"");
    stream_publish(rig->stream, STREAM_STATE, at(1, 2), "\"running\"");
    stream_publish(rig->stream, STREAM_PROGRESS, at(1, 3), "\"p3\"");
    stream_publish(rig->stream, STREAM_PROGRESS, at(1, 4), "\"p4\"");
    stream_publish(rig->stream, STREAM_END, at(1, 5), "\"end\"");
    struct follower *f = follow(rig, at(1, 1), at(1, 5));
    assert_int_equal(pull_all(f, text), -1);
    assert_string_equal(text, "retry: 3000\n\nid: 1.2\nevent: state\ndata: \"running\"\n\n"
                              "id: 1.4\nevent: progress\ndata: \"p4\"\n\n"
                              "id: 1.5\nevent: end\ndata: \"end\"\n\n");
    follower_free(f);
}

static void test_stream__a_preview_is_kept_as_states_are(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    stream_publish(rig->stream, STREAM_STATE, at(1, 1), "\"running\"");
    stream_publish(rig->stream, STREAM_PREVIEW, at(1, 2), "\"look\"");
    stream_publish(rig->stream, STREAM_PROGRESS, at(1, 3), "\"p3\"");
    struct follower *f = follow(rig, at(1, 1), at(1, 3));
    assert_int_equal(pull_all(f, text), 0);
    assert_string_equal(text, "retry: 3000\n\nid: 1.2\nevent: preview\ndata: \"look\"\n\n"
                              "id: 1.3\nevent: progress\ndata: \"p3\"\n\n");
    follower_free(f);
}

static void test_stream__an_attempt_later_numbers_still_rise(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    stream_publish(rig->stream, STREAM_STATE, at(2, 1), "\"again\"");
    struct follower *f = follow(rig, at(1, 900), at(2, 1));
    assert_int_equal(pull_all(f, text), 0);
    assert_non_null(strstr(text, "id: 2.1\nevent: state"));
    follower_free(f);
}

static void test_stream__old_states_make_room_for_new_ones(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    for (uint32_t i = 1; i <= 20; i++)
        stream_publish(rig->stream, STREAM_STATE, at(i, 1), "1");
    struct follower *f = follow(rig, at(1, 1), at(20, 1));
    assert_int_equal(pull_all(f, text), 0);
    assert_null(strstr(text, "id: 4.1\n"));
    assert_non_null(strstr(text, "id: 5.1\n"));
    assert_non_null(strstr(text, "id: 20.1\n"));
    follower_free(f);
}

static void test_stream__the_end_is_the_last_that_is_sent(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct follower *f = new_follower(rig, 1, false);
    assert_int_equal(follower_add_ended(f, job(1), at(0, 0), at(1, 9), "\"done\""), 0);
    assert_int_equal(pull_all(f, text), -1);
    assert_string_equal(text, "retry: 3000\n\nid: 1.9\nevent: end\ndata: \"done\"\n\n");
    hub_tick(rig->hub, clock_monotonic_ms() + 10 * STREAM_HEARTBEAT_MS);
    assert_int_equal(pull_all(f, text), -1);
    follower_free(f);
}

static void test_stream__silence_is_broken_by_heartbeats(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct follower *f = follow(rig, at(0, 0), at(1, 1));
    pull_all(f, text);
    hub_tick(rig->hub, clock_monotonic_ms() + STREAM_HEARTBEAT_MS / 2);
    assert_int_equal(rig->wakes, 0);
    assert_int_equal(follower_pull(f, text, 100), 0);
    hub_tick(rig->hub, clock_monotonic_ms() + STREAM_HEARTBEAT_MS + 1000);
    assert_int_equal(rig->wakes, 1);
    assert_int_equal(pull_all(f, text), 0);
    assert_string_equal(text, ":\n\n");
    follower_free(f);
}

static void test_stream__the_followers_are_bounded(void **state)
{
    struct rig *rig = *state;
    struct follower *f[3], *more = NULL;
    for (int i = 0; i < 3; i++)
        f[i] = follow(rig, at(0, 0), at(1, 1));
    assert_int_equal(follower_new(rig->hub, "", 1, false, on_wake, rig, &more), STREAM_FULL);
    assert_null(more);
    follower_free(f[1]);
    f[1] = follow(rig, at(0, 0), at(1, 1));
    for (int i = 0; i < 3; i++)
        follower_free(f[i]);
}

static void test_stream__the_followers_of_one_owner_are_bounded(void **state)
{
    struct rig *rig = *state;
    struct follower *f[3], *more = NULL;
    for (int i = 0; i < 2; i++)
        assert_int_equal(follower_new(rig->hub, "ann", 1, false, NULL, NULL, &f[i]), 0);
    assert_int_equal(follower_new(rig->hub, "ann", 1, false, NULL, NULL, &more), STREAM_OWNER_FULL);
    assert_int_equal(follower_new(rig->hub, "anna", 1, false, NULL, NULL, &f[2]), 0);
    assert_int_equal(follower_new(rig->hub, "anna", 1, false, NULL, NULL, &more), STREAM_FULL);
    assert_null(more);
    for (int i = 0; i < 3; i++)
        follower_free(f[i]);
}

static void test_stream__closing_the_hub_ends_everybody(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct follower *f = follow(rig, at(0, 0), at(1, 1));
    pull_all(f, text);
    hub_close(rig->hub);
    assert_int_equal(rig->wakes, 1);
    assert_int_equal(pull_all(f, text), -1);
    assert_string_equal(text, "");
    follower_free(f);
}

static void test_stream__a_follower_outlives_the_job(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct stream *stream = stream_new(rig->hub);
    struct follower *f = new_follower(rig, 1, false);
    assert_int_equal(follower_add(f, job(1), stream, at(1, 1), at(1, 1), "1"), 0);
    stream_publish(stream, STREAM_END, at(1, 2), "\"end\"");
    stream_release(stream);
    assert_int_equal(pull_all(f, text), -1);
    assert_non_null(strstr(text, "event: end"));
    follower_free(f);
}

static void test_stream__who_comes_back_after_the_end_gets_the_states_between(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct stream *stream = stream_new(rig->hub);
    stream_publish(stream, STREAM_STATE, at(1, 1), "\"queued\"");
    stream_publish(stream, STREAM_STATE, at(1, 2), "\"running\"");
    stream_publish(stream, STREAM_PROGRESS, at(1, 3), "\"p3\"");
    stream_publish(stream, STREAM_END, at(1, 4), "\"end\"");
    stream_retire(stream, job(1));
    struct follower *f = new_follower(rig, 1, false);
    assert_int_equal(follower_add_ended(f, job(1), at(1, 1), at(1, 4), "\"stored\""), 0);
    assert_int_equal(pull_all(f, text), -1);
    assert_string_equal(text, "retry: 3000\n\nid: 1.2\nevent: state\ndata: \"running\"\n\n"
                              "id: 1.4\nevent: end\ndata: \"end\"\n\n");
    follower_free(f);

    /* Later only the store knows: there is the end at least. */
    hub_tick(rig->hub, clock_monotonic_ms() + STREAM_RETIRED_MS + 1);
    f = new_follower(rig, 1, false);
    assert_int_equal(follower_add_ended(f, job(1), at(1, 1), at(1, 4), "\"stored\""), 0);
    assert_int_equal(pull_all(f, text), -1);
    assert_string_equal(text, "retry: 3000\n\nid: 1.4\nevent: end\ndata: \"stored\"\n\n");
    follower_free(f);
}

static void retire_one(struct rig *rig, unsigned number)
{
    char id[ID_SIZE];
    snprintf(id, sizeof id, "%032x", number);
    struct stream *stream = stream_new(rig->hub);
    stream_publish(stream, STREAM_STATE, at(1, 2), "\"running\"");
    stream_publish(stream, STREAM_END, at(1, 3), "\"end\"");
    stream_retire(stream, id);
}

/* Whether the state between is still known of that job. */
static bool is_kept(struct rig *rig, unsigned number)
{
    char id[ID_SIZE], text[4096];
    snprintf(id, sizeof id, "%032x", number);
    struct follower *f = new_follower(rig, 1, false);
    assert_int_equal(follower_add_ended(f, id, at(1, 1), at(1, 3), "\"end\""), 0);
    assert_int_equal(pull_all(f, text), -1);
    assert_non_null(strstr(text, "event: end"));
    follower_free(f);
    return strstr(text, "running") != NULL;
}

static void test_stream__so_many_ended_jobs_are_kept_and_no_more(void **state)
{
    struct rig *rig = *state;
    for (unsigned i = 0; i < STREAM_RETIRED; i++)
        retire_one(rig, i);
    assert_true(is_kept(rig, 0));
    retire_one(rig, STREAM_RETIRED);
    assert_false(is_kept(rig, 0));
    assert_true(is_kept(rig, 1));
    assert_true(is_kept(rig, STREAM_RETIRED));
}

static void test_stream__a_job_that_leaves_without_an_end_sends_its_followers_to_the_store(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct stream *stream = stream_new(rig->hub);
    stream_publish(stream, STREAM_STATE, at(1, 2), "\"running\"");
    struct follower *f = new_follower(rig, 1, false);
    assert_int_equal(follower_add(f, job(1), stream, at(1, 2), at(1, 2), "1"), 0);
    pull_all(f, text);
    stream_retire(stream, job(1)); /* its end found no memory */
    assert_int_equal(rig->wakes, 1);
    assert_int_equal(pull_all(f, text), -1);
    assert_string_equal(text, "");
    follower_free(f);
}

static void test_stream__one_follower_of_several_jobs_is_told_which(void **state)
{
    struct rig *rig = *state;
    char text[4096], wanted[4096];
    struct stream *other = stream_new(rig->hub);
    struct follower *f = new_follower(rig, 3, true);
    assert_int_equal(follower_add(f, job(1), rig->stream, at(0, 0), at(1, 1), "\"a\""), 0);
    assert_int_equal(follower_add(f, job(2), other, at(0, 0), at(1, 1), "\"b\""), 0);
    assert_int_equal(follower_add_ended(f, job(3), at(0, 0), at(2, 7), "\"c\""), 0);
    assert_int_equal(pull_all(f, text), 0);
    snprintf(wanted, sizeof wanted,
             "retry: 3000\n\nid: %s=1.1\nevent: state\ndata: \"a\"\n\n"
             "id: %s=1.1,%s=1.1\nevent: state\ndata: \"b\"\n\n"
             "id: %s=1.1,%s=1.1,%s=2.7\nevent: end\ndata: \"c\"\n\n",
             job(1), job(1), job(2), job(1), job(2), job(3));
    assert_string_equal(text, wanted);
    stream_publish(other, STREAM_END, at(1, 2), "\"b2\"");
    assert_int_equal(pull_all(f, text), 0); /* the first goes on */
    snprintf(wanted, sizeof wanted, "id: %s=1.1,%s=1.2,%s=2.7\nevent: end\ndata: \"b2\"\n\n", job(1), job(2),
             job(3));
    assert_string_equal(text, wanted);
    assert_false(follower_over(f));
    stream_publish(rig->stream, STREAM_END, at(1, 2), "\"a2\"");
    assert_int_equal(pull_all(f, text), -1);
    assert_true(follower_over(f));
    follower_free(f);
    stream_release(other);
}

static void test_stream__several_jobs_are_resumed_each_where_it_was(void **state)
{
    struct rig *rig = *state;
    char text[4096], id[512];
    struct stream *other = stream_new(rig->hub);
    stream_publish(rig->stream, STREAM_STATE, at(1, 2), "\"a2\"");
    stream_publish(other, STREAM_STATE, at(1, 2), "\"b2\"");
    snprintf(id, sizeof id, "%s=1.2,%s=1.1,%s=2.7", job(1), job(2), job(3));
    struct follower *f = new_follower(rig, 4, true);
    assert_int_equal(follower_add(f, job(1), rig->stream, stream_seen(id, job(1)), at(1, 2), "1"), 0);
    assert_int_equal(follower_add(f, job(2), other, stream_seen(id, job(2)), at(1, 2), "1"), 0);
    assert_int_equal(follower_add_ended(f, job(3), stream_seen(id, job(3)), at(2, 7), "\"c\""), 0);
    assert_int_equal(follower_add(f, job(4), rig->stream, stream_seen(id, job(4)), at(1, 2), "\"new\""), 0);
    assert_int_equal(pull_all(f, text), 0);
    assert_null(strstr(text, "\"a2\""));
    assert_non_null(strstr(text, "\"b2\""));
    assert_null(strstr(text, "\"c\""));
    assert_non_null(strstr(text, "\"new\""));
    follower_free(f);
    stream_release(other);
}

static void test_stream__who_has_seen_every_end_is_told_nothing(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct follower *f = new_follower(rig, 2, true);
    assert_int_equal(follower_add_ended(f, job(1), at(1, 5), at(1, 5), "1"), 0);
    assert_true(follower_over(f));
    assert_int_equal(follower_add_ended(f, job(2), at(1, 4), at(1, 5), "1"), 0);
    assert_false(follower_over(f));
    assert_int_equal(pull_all(f, text), -1);
    assert_non_null(strstr(text, job(1))); /* in the id: who comes back again is not told then either */
    follower_free(f);
}

static void test_stream__a_job_with_much_to_say_does_not_silence_the_others(void **state)
{
    struct rig *rig = *state;
    char text[8192];
    struct stream *other = stream_new(rig->hub);
    for (uint32_t i = 2; i < 8; i++)
        stream_publish(rig->stream, STREAM_STATE, at(1, i), "\"loud\"");
    stream_publish(other, STREAM_STATE, at(1, 2), "\"quiet\"");
    struct follower *f = new_follower(rig, 2, true);
    assert_int_equal(follower_add(f, job(1), rig->stream, at(1, 1), at(1, 7), "1"), 0);
    assert_int_equal(follower_add(f, job(2), other, at(1, 1), at(1, 2), "1"), 0);
    size_t n = 0;
    for (ssize_t got; (got = follower_pull(f, text + n, sizeof text - n - 1)) > 0;)
        n += (size_t)got;
    text[n] = '\0';
    const char *second = strstr(strstr(text, "loud") + 1, "loud");
    assert_true(strstr(text, "quiet") < second);
    follower_free(f);
    stream_release(other);
}

static void test_stream__lists_of_ids_that_are_none_say_nothing(void **state)
{
    (void)state;
    char good[256], bad[300];
    snprintf(good, sizeof good, "%s=1.2,%s=3.4", job(1), job(2));
    assert_int_equal(stream_seen(good, job(1)).counter, 2);
    assert_int_equal(stream_seen(good, job(2)).attempt, 3);
    assert_int_equal(stream_seen(good, job(3)).attempt, 0);
    assert_int_equal(stream_seen(NULL, job(1)).attempt, 0);
    const char *const form[] = {"",     ",",       "%s",       "%s=",      "%s=1",      "%s=1.2,", ",%s=1.2",
                                "%s=x", "%s==1.2", "%s=1.2,,", "%s=1.2;x", "%s=1.2, x", "%s1=1.2", "=1.2%s"};
    for (size_t i = 0; i < sizeof form / sizeof *form; i++) {
        const char *at_s = strstr(form[i], "%s");
        size_t before = at_s == NULL ? strlen(form[i]) : (size_t)(at_s - form[i]);
        snprintf(bad, sizeof bad, "%.*s%s%s", (int)before, form[i], at_s == NULL ? "" : job(1),
                 at_s == NULL ? "" : at_s + 2);
        if (stream_seen(bad, job(1)).attempt != 0)
            fail_msg("\"%s\" was taken for a list", bad);
    }
}

#define RACE_EVENTS 3000

static void *publish_many(void *data)
{
    struct stream *stream = data;
    for (uint32_t i = 2; i < RACE_EVENTS; i++)
        stream_publish(stream, i % 5 == 0 ? STREAM_STATE : STREAM_PROGRESS, at(1, i), "1");
    stream_publish(stream, STREAM_END, at(1, RACE_EVENTS), "1");
    stream_retire(stream, job(1));
    return NULL;
}

static void *come_and_go(void *data)
{
    struct rig *rig = data;
    char text[256];
    for (int i = 0; i < 300; i++) {
        struct follower *f = NULL;
        if (follower_new(rig->hub, "", 1, true, NULL, NULL, &f) != 0)
            continue;
        /* The caller holds the rig's stream, so it is there, whatever becomes of its job. */
        assert_int_equal(follower_add(f, job(1), rig->stream, at(1, 1), at(1, 1), "1"), 0);
        for (int pulls = 0; pulls < 20 && follower_pull(f, text, sizeof text) >= 0;)
            pulls++;
        follower_free(f);
        hub_tick(rig->hub, clock_monotonic_ms());
    }
    return NULL;
}

/* Its point is ThreadSanitizer's: publishing, pulling, leaving and retiring at once. */
static void test_stream__publishers_followers_and_the_clock_do_not_collide(void **state)
{
    struct rig *rig = *state;
    pthread_t publisher, visitor[2];
    char text[4096];
    struct stream *stream = rig->stream;
    struct follower *holder = new_follower(rig, 1, false);
    assert_int_equal(follower_add(holder, job(1), stream, at(1, 1), at(1, 1), "1"), 0);
    assert_int_equal(pthread_create(&publisher, NULL, publish_many, stream), 0);
    for (int i = 0; i < 2; i++)
        assert_int_equal(pthread_create(&visitor[i], NULL, come_and_go, rig), 0);
    for (int i = 0; i < 2; i++)
        pthread_join(visitor[i], NULL);
    pthread_join(publisher, NULL);
    assert_int_equal(pull_all(holder, text), -1);
    assert_non_null(strstr(text, "event: end"));
    follower_free(holder);
    rig->stream = NULL; /* the hub has it, or let it go */
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, rig_new, rig_free)
    const struct CMUnitTest tests[] = {
        TEST(test_stream__a_fresh_follower_begins_with_what_stands_now),
        TEST(test_stream__a_resumed_follower_gets_every_newer_state_and_the_newest_progress),
        TEST(test_stream__a_preview_is_kept_as_states_are),
        TEST(test_stream__an_attempt_later_numbers_still_rise),
        TEST(test_stream__old_states_make_room_for_new_ones),
        TEST(test_stream__the_end_is_the_last_that_is_sent),
        TEST(test_stream__silence_is_broken_by_heartbeats),
        TEST(test_stream__the_followers_are_bounded),
        TEST(test_stream__the_followers_of_one_owner_are_bounded),
        TEST(test_stream__closing_the_hub_ends_everybody),
        TEST(test_stream__a_follower_outlives_the_job),
        TEST(test_stream__who_comes_back_after_the_end_gets_the_states_between),
        TEST(test_stream__so_many_ended_jobs_are_kept_and_no_more),
        TEST(test_stream__a_job_that_leaves_without_an_end_sends_its_followers_to_the_store),
        TEST(test_stream__one_follower_of_several_jobs_is_told_which),
        TEST(test_stream__several_jobs_are_resumed_each_where_it_was),
        TEST(test_stream__who_has_seen_every_end_is_told_nothing),
        TEST(test_stream__a_job_with_much_to_say_does_not_silence_the_others),
        TEST(test_stream__publishers_followers_and_the_clock_do_not_collide),
        TEST(test_stream__lists_of_ids_that_are_none_say_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
