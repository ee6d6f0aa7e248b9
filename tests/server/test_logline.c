/* test_logline.c - a log event in each of its forms; nothing that a value holds can forge another. */
#include "test.h"

#include <jansson.h>

#include "logline.h"

static struct log_record record;

__attribute__((format(printf, 1, 2))) static void take(const char *format, ...)
{
    va_list args;
    memset(&record, 0, sizeof record);
    logline_add(&record, "time", "T");
    logline_add(&record, "level", "info");
    logline_add(&record, "event", "job.ended");
    va_start(args, format);
    logline_take(&record, format, args);
    va_end(args);
}

static const char *text(void)
{
    static char line[LOGLINE_SIZE];
    line[logline_text(&record, line)] = '\0';
    return line;
}

/* The line as JSON, of which jansson, strict about UTF-8, is the judge. The caller frees it. */
static json_t *json(void)
{
    char line[LOGLINE_SIZE];
    json_error_t error;
    size_t bytes = logline_json(&record, line);
    assert_null(memchr(line, '\n', bytes));
    json_t *value = json_loadb(line, bytes, JSON_REJECT_DUPLICATES, &error);
    if (value == NULL)
        print_error("%s: %.*s\n", error.text, (int)bytes, line);
    assert_non_null(value);
    return value;
}

static void assert_member(const char *name, const char *wanted)
{
    json_t *value = json();
    assert_string_equal(json_string_value(json_object_get(value, name)), wanted);
    json_decref(value);
}

static void test_logline__a_format_becomes_fields(void **state)
{
    (void)state;
    take("job=%s attempt=%u ms=%lld bytes=%zu at=%d.%d why=\"%s\" committed=%d ratio=%g part=%.3s fixed=0",
         "4f", 3u, -5ll, (size_t)7, 1, 2, "no room", 1, 0.5, "abcdef");
    assert_string_equal(text(), "T level=info event=job.ended job=4f attempt=3 ms=-5 bytes=7 at=1.2 "
                                "why=\"no room\" committed=1 ratio=0.5 part=abc fixed=0");
    json_t *value = json();
    assert_int_equal(json_integer_value(json_object_get(value, "attempt")), 3);
    assert_int_equal(json_integer_value(json_object_get(value, "ms")), -5);
    assert_string_equal(json_string_value(json_object_get(value, "at")), "1.2");
    assert_string_equal(json_string_value(json_object_get(value, "why")), "no room");
    json_decref(value);
}

static void test_logline__what_is_empty_is_left_out(void **state)
{
    (void)state;
    take("job=%s status=%d", "", 0);
    assert_string_equal(text(), "T level=info event=job.ended status=0");
}

static void test_logline__a_value_cannot_forge_a_line_or_a_field(void **state)
{
    (void)state;
    static const char hostile[] = "x\n2026 level=error event=forged\r\t\"} \\ \x1b[31m \x7f job=1";
    take("name=%s job=%s", hostile, "4f");
    assert_string_equal(
        text(), "T level=info event=job.ended name=\"x\\u000a2026 level=error event=forged\\u000d\\u0009"
                "\\\"} \\\\ \\u001b[31m \\u007f job=1\" job=4f");
    assert_member("name", hostile);
    assert_member("job", "4f");
}

static void test_logline__bytes_that_are_no_text_are_marked(void **state)
{
    (void)state;
    take("name=%s", "\xc3\xa9 \xe2\x82\xac \xf0\x9f\x91\x97");
    assert_member("name", "\xc3\xa9 \xe2\x82\xac \xf0\x9f\x91\x97");
    static const char *const broken[] = {
        "\xff", "\xc3",    "\xc0\xaf", "\xed\xa0\x80", "\xf5\x80\x80\x80", "\xe0\x80\xaf", "\xf4\x90\x80\x80",
        "\x80", "\xe2\x82"};
    for (size_t i = 0; i < sizeof broken / sizeof *broken; i++) {
        take("name=%s", broken[i]);
        json_t *value = json();
        assert_non_null(strstr(json_string_value(json_object_get(value, "name")), "\xef\xbf\xbd"));
        json_decref(value);
    }
    take("name=%s", "\xc2\x9b"); /* a control sequence in one character, to some terminals */
    assert_non_null(strstr(text(), "\\u009b"));
    assert_member("name", "\xc2\x9b");
}

static void test_logline__long_values_are_cut_and_lines_stay_whole(void **state)
{
    (void)state;
    char longest[LOGLINE_VALUE + 1];
    memset(longest, 'x', sizeof longest - 1);
    longest[sizeof longest - 1] = '\0';
    take("name=%s", longest);
    assert_int_equal(strlen(record.field[3].value), LOGLINE_VALUE - 1);
    longest[sizeof longest - 2] = '\0';
    take("name=%s", longest);
    assert_string_equal(record.field[3].value, longest);
    /* A character in two at the cut. */
    longest[LOGLINE_VALUE - 2] = '\xc3';
    longest[LOGLINE_VALUE - 1] = '\xa9';
    take("name=%s", longest);
    json_decref(json());
    /* Escaped, thirteen of these do not fit in a line. */
    memset(longest, '\1', sizeof longest - 1);
    take("a=%s b=%s c=%s d=%s e=%s f=%s g=%s h=%s i=%s j=%s k=%s l=%s m=%s", longest, longest, longest,
         longest, longest, longest, longest, longest, longest, longest, longest, longest, longest);
    json_t *value = json();
    assert_non_null(json_object_get(value, "e"));
    assert_null(json_object_get(value, "m"));
    json_decref(value);
    assert_true(strlen(text()) < LOGLINE_SIZE);
}

static void test_logline__more_fields_than_there_is_room_for_are_left_out(void **state)
{
    (void)state;
    take("a=%d b=%d c=%d d=%d e=%d f=%d g=%d h=%d i=%d j=%d k=%d l=%d m=%d n=%d", 1, 2, 3, 4, 5, 6, 7, 8, 9,
         10, 11, 12, 13, 14);
    assert_int_equal(record.fields, LOGLINE_FIELDS);
    assert_string_equal(record.field[LOGLINE_FIELDS - 1].name, "m");
}

static void test_logline__the_journal_gets_fields_of_its_own_names(void **state)
{
    (void)state;
    static struct log_entry entry;
    take("job=%s request=%s trace=%s route=%s status=%d ms=%d name=%s", "4f", "91", "0af7", "/v1/jobs", 202,
         5, "a\nPRIORITY=0");
    logline_entry(&record, 2, 6, &entry);
    static const char *const wanted[] = {
        "MESSAGE=job.ended job=4f request=91 trace=0af7 route=/v1/jobs status=202 ms=5 "
        "name=\"a\\u000aPRIORITY=0\"",
        "PRIORITY=6",
        "EVENT=job.ended",
        "JOB_ID=4f",
        "REQUEST_ID=91",
        "TRACE_ID=0af7",
        "ROUTE=/v1/jobs",
        "STATUS=202",
        "DURATION_MS=5",
        "NAME=a\nPRIORITY=0", /* sent with its length: no field of its own */
    };
    assert_int_equal(entry.parts, sizeof wanted / sizeof *wanted);
    for (int i = 0; i < entry.parts; i++) {
        assert_int_equal(entry.part[i].iov_len, strlen(wanted[i]));
        assert_memory_equal(entry.part[i].iov_base, wanted[i], strlen(wanted[i]));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_logline__a_format_becomes_fields),
        cmocka_unit_test(test_logline__what_is_empty_is_left_out),
        cmocka_unit_test(test_logline__a_value_cannot_forge_a_line_or_a_field),
        cmocka_unit_test(test_logline__bytes_that_are_no_text_are_marked),
        cmocka_unit_test(test_logline__long_values_are_cut_and_lines_stay_whole),
        cmocka_unit_test(test_logline__more_fields_than_there_is_room_for_are_left_out),
        cmocka_unit_test(test_logline__the_journal_gets_fields_of_its_own_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
