/* test_traceparent.c - valid and invalid trace contexts, after the cases of the specification. */
#include "test.h"

#include "traceparent.h"

#define TRACE  "0af7651916cd43dd8448eb211c80319c"
#define PARENT "b7ad6b7169203331"

static void test_traceparent__valid_ones_give_their_trace_id(void **state)
{
    (void)state;
    static const char *const valid[] = {
        "00-" TRACE "-" PARENT "-01",  "00-" TRACE "-" PARENT "-00",
        "00-" TRACE "-" PARENT "-ff",  "01-" TRACE "-" PARENT "-01",
        "fe-" TRACE "-" PARENT "-01",  "cc-" TRACE "-" PARENT "-01-what-the-future",
        "cc-" TRACE "-" PARENT "-01-",
    };
    char id[TRACE_ID_SIZE];
    for (size_t i = 0; i < sizeof valid / sizeof *valid; i++) {
        assert_true(traceparent_parse(valid[i], id));
        assert_string_equal(id, TRACE);
    }
}

static void test_traceparent__others_are_as_if_not_there(void **state)
{
    (void)state;
    static const char *const invalid[] = {
        NULL,
        "",
        "00",
        "ff-" TRACE "-" PARENT "-01", /* a version that is none */
        "0-" TRACE "-" PARENT "-01",  /* short */
        "000-" TRACE "-" PARENT "-01",
        "0x-" TRACE "-" PARENT "-01",
        "00-" TRACE "-" PARENT "-0",
        "00-" TRACE "-" PARENT "-001",
        "00-" TRACE "-" PARENT "-0x",
        "00-" TRACE "-" PARENT "-01-", /* version 0 ends there */
        "00-" TRACE "-" PARENT "-01-more",
        "cc-" TRACE "-" PARENT "-01.more",
        "00-" TRACE "-" PARENT "-01 ",
        " 00-" TRACE "-" PARENT "-01",
        "00-00000000000000000000000000000000-" PARENT "-01", /* no trace */
        "00-" TRACE "-0000000000000000-01",                  /* no parent */
        "00-0AF7651916CD43DD8448EB211C80319C-" PARENT "-01", /* upper case */
        "00-" TRACE "-B7AD6B7169203331-01",
        "00-" TRACE "-" PARENT "-0F",
        "00-0af7651916cd43dd8448eb211c80319-b" PARENT "-01", /* a dash out of place */
        "00_" TRACE "-" PARENT "-01",
        "00-" TRACE "_" PARENT "-01",
        "00-" TRACE "-" PARENT "_01",
        "00-" TRACE "-" PARENT "-01, 00-" TRACE "-" PARENT "-01", /* two */
    };
    char id[TRACE_ID_SIZE];
    for (size_t i = 0; i < sizeof invalid / sizeof *invalid; i++) {
        if (traceparent_parse(invalid[i], id))
            fail_msg("\"%s\" was taken", invalid[i]);
        assert_string_equal(id, "");
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_traceparent__valid_ones_give_their_trace_id),
        cmocka_unit_test(test_traceparent__others_are_as_if_not_there),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
