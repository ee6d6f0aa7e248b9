/* test_clock.c - times written and read. */
#include "test.h"

#include <string.h>

#include "clock.h"

static void test_clock__a_time_is_written_and_read_back(void **state)
{
    (void)state;
    const int64_t times[] = {0, 1182763800125, 951782400000, 253402300799999};
    for (size_t i = 0; i < sizeof times / sizeof *times; i++) {
        char text[CLOCK_TEXT_SIZE];
        int64_t back = -1;
        clock_format(times[i], text);
        assert_int_equal(clock_parse(text, &back), 0);
        assert_int_equal(back, times[i]);
    }
}

static void test_clock__other_ways_to_write_it_are_read_too(void **state)
{
    (void)state;
    const char *same[] = {"2007-06-25T09:30:00.125Z", "2007-06-25t09:30:00.1259z",
                          "2007-06-25T11:00:00.125+01:30", "2007-06-24T23:30:00.12500000000000000-10:00"};
    int64_t ms;
    for (size_t i = 0; i < sizeof same / sizeof *same; i++) {
        assert_int_equal(clock_parse(same[i], &ms), 0);
        assert_int_equal(ms, 1182763800125);
    }
    assert_int_equal(clock_parse("2016-12-31T23:59:60Z", &ms), 0); /* that minute had 61 seconds */
    assert_int_equal(ms, 1483228800000);
}

static void test_clock__what_is_no_time_is_refused(void **state)
{
    (void)state;
    const char *refused[] = {"",
                             "2007",
                             "2007-06-25",
                             "2007-06-25T09:30Z",
                             "2007-06-25 09:30:00Z",
                             "2007-06-25T09:30:00",
                             "2007-06-25T09:30:00.Z",
                             "2007-06-25T09:30:00Zx",
                             "2007-06-25T09:30:00+0130",
                             "2007-06-25T09:30:00+24:00",
                             "2007-06-25T09:30:00+01:60",
                             "2007-06-31T09:30:00Z",
                             "2007-02-29T09:30:00Z",
                             "2007-13-25T09:30:00Z",
                             "2007-00-25T09:30:00Z",
                             "2007-06-00T09:30:00Z",
                             "2007-06-25T24:30:00Z",
                             "2007-06-25T09:60:00Z",
                             "2007-06-25T09:30:61Z",
                             "1969-06-25T09:30:00Z",
                             "+007-06-25T09:30:00Z",
                             " 2007-06-25T09:30:00Z"};
    int64_t ms = 7;
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        if (clock_parse(refused[i], &ms) != -1)
            fail_msg("<%s> was read as %lld", refused[i], (long long)ms);
    assert_int_equal(ms, 7);
}

static void test_clock__the_steady_clock_keeps_near_the_wall(void **state)
{
    (void)state;
    int64_t first = clock_steady_ms(), wall = clock_wall_ms();
    assert_true(clock_steady_ms() >= first);
    assert_true(first - wall < 60000 && wall - first < 60000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clock__a_time_is_written_and_read_back),
        cmocka_unit_test(test_clock__other_ways_to_write_it_are_read_too),
        cmocka_unit_test(test_clock__what_is_no_time_is_refused),
        cmocka_unit_test(test_clock__the_steady_clock_keeps_near_the_wall),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
