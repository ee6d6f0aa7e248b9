/* test_trace.c - traces are read by the names of their columns, with null where nothing is known. */
#include "test.h"

#include "trace.h"

static int parse(const char *text, struct trace *ret)
{
    struct failure failure = {0};
    int status = trace_parse(text, strlen(text), ret, &failure);
    if (status < 0) {
        assert_int_equal(failure.code, EXIT_REFUSED);
    }
    return status;
}

static void test_trace__finds_columns_by_name(void **state)
{
    struct trace trace;
    (void)state;
    assert_int_equal(
        parse("{\"rows\":[[-2.5,\"new\",3,1,null],[4]],"
              "\"columns\":[\"potential\",\"unheard-of\",\"iteration\",\"stop\",\"residual_energy\"]}",
              &trace),
        0);
    assert_int_equal(trace.rows, 2);
    assert_close(trace.row[0].potential, -2.5, 0);
    assert_close(trace.row[0].iteration, 3, 0);
    assert_close(trace.row[0].stop, 1, 0);
    assert_true(isnan(trace.row[0].residual_energy)); /* null */
    assert_true(isnan(trace.row[0].factorizations));  /* no such column */
    assert_close(trace.row[1].potential, 4, 0);
    assert_true(isnan(trace.row[1].iteration)); /* a row cut short */
    trace_done(&trace);
}

static void test_trace__no_rows_are_a_trace_and_other_things_are_none(void **state)
{
    struct trace trace;
    const char *const wrong[] = {
        "", "[]", "{}", "{\"columns\":[]}", "{\"columns\":[],\"rows\":{}}", "{\"columns\""};
    (void)state;
    assert_int_equal(parse("{\"columns\":[\"potential\"],\"rows\":[]}", &trace), 0);
    assert_int_equal(trace.rows, 0);
    trace_done(&trace);
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        assert_int_equal(parse(wrong[i], &trace), -1);
        assert_null(trace.row);
    }
}

static void test_trace__resolution_is_half_a_unit_of_the_last_digit(void **state)
{
    struct trace_row row[] = {{.potential = NAN}, {.potential = 0.125}, {.potential = -0.0622794174}};
    struct trace trace = {row, 3};
    (void)state;
    assert_close(trace_resolution(&trace, row[2].potential), 0.5e-10, 1e-12); /* 9 digits from 1e-2 down */
    assert_close(trace_resolution(&trace, 5), 0.5e-8, 1e-12);
    row[1].potential = 0.1 + 0.2; /* needs 17 */
    assert_close(trace_resolution(&trace, 5), 0.5e-16, 1e-12);
    assert_true(trace_resolution(&trace, 0) == 0);
    trace.rows = 0;
    assert_true(trace_resolution(&trace, 5) == 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_trace__finds_columns_by_name),
        cmocka_unit_test(test_trace__no_rows_are_a_trace_and_other_things_are_none),
        cmocka_unit_test(test_trace__resolution_is_half_a_unit_of_the_last_digit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
