/* test_stream.c - what a follower is given: order, numbers, resuming, heartbeats, the end. */
#include "test.h"

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
    rig = (struct rig){.hub = hub_new(3)};
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
    ((struct rig *)data)->wakes++;
}

static struct revision at(uint32_t attempt, uint32_t counter)
{
    return (struct revision){attempt, counter};
}

static struct follower *follow(struct rig *rig, struct revision seen, struct revision now)
{
    struct follower *f = NULL;
    assert_int_equal(follower_new(rig->stream, seen, now, "{\"now\":1}", on_wake, rig, &f), 0);
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
    assert_null(strstr(text, "id: 12.1\n"));
    assert_non_null(strstr(text, "id: 13.1\n"));
    assert_non_null(strstr(text, "id: 20.1\n"));
    follower_free(f);
}

static void test_stream__the_end_is_the_last_that_is_sent(void **state)
{
    struct rig *rig = *state;
    char text[4096];
    struct follower *f = NULL;
    assert_int_equal(follower_new_ended(rig->hub, at(1, 9), "\"done\"", &f), 0);
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
    assert_int_equal(follower_new(rig->stream, at(0, 0), at(1, 1), "1", on_wake, rig, &more), 1);
    assert_int_equal(follower_new_ended(rig->hub, at(1, 1), "1", &more), 1);
    assert_null(more);
    follower_free(f[1]);
    f[1] = follow(rig, at(0, 0), at(1, 1));
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
    struct follower *f = NULL;
    assert_int_equal(follower_new(stream, at(1, 1), at(1, 1), "1", on_wake, rig, &f), 0);
    stream_publish(stream, STREAM_END, at(1, 2), "\"end\"");
    stream_release(stream);
    assert_int_equal(pull_all(f, text), -1);
    assert_non_null(strstr(text, "event: end"));
    follower_free(f);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, rig_new, rig_free)
    const struct CMUnitTest tests[] = {
        TEST(test_stream__a_fresh_follower_begins_with_what_stands_now),
        TEST(test_stream__a_resumed_follower_gets_every_newer_state_and_the_newest_progress),
        TEST(test_stream__an_attempt_later_numbers_still_rise),
        TEST(test_stream__old_states_make_room_for_new_ones),
        TEST(test_stream__the_end_is_the_last_that_is_sent),
        TEST(test_stream__silence_is_broken_by_heartbeats),
        TEST(test_stream__the_followers_are_bounded),
        TEST(test_stream__closing_the_hub_ends_everybody),
        TEST(test_stream__a_follower_outlives_the_job),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
