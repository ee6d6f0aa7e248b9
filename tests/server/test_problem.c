/* test_problem.c - the table of errors is complete, and bodies are RFC 9457. */
#include "test.h"

#include "problem.h"

static void test_problem__every_code_has_a_name_a_title_and_an_error_status(void **state)
{
    (void)state;
    for (int i = PROBLEM_NONE + 1; i < PROBLEM_CODES; i++) {
        enum problem_code code = (enum problem_code)i;
        assert_non_null(problem_name(code));
        assert_true(strlen(problem_title(code)) > 5);
        assert_in_range(problem_status(code), 400, 599);
        assert_int_equal(strspn(problem_name(code), "abcdefghijklmnopqrstuvwxyz-"),
                         strlen(problem_name(code)));
    }
}

static void test_problem__names_are_unique(void **state)
{
    (void)state;
    for (int i = 0; i < PROBLEM_CODES; i++)
        for (int j = 0; j < i; j++)
            assert_string_not_equal(problem_name((enum problem_code)i), problem_name((enum problem_code)j));
}

static void test_problem__what_passes_by_itself_is_retryable(void **state)
{
    (void)state;
    assert_true(problem_retryable(PROBLEM_QUEUE_FULL));
    assert_true(problem_retryable(PROBLEM_DRAINING));
    assert_true(problem_retryable(PROBLEM_TOO_MANY_STREAMS));
    assert_true(problem_retryable(PROBLEM_NOT_READY));
    assert_false(problem_retryable(PROBLEM_INVALID));
    assert_false(problem_retryable(PROBLEM_NO_RESULT));
}

static void test_problem__json_has_every_member_of_the_contract(void **state)
{
    (void)state;
    struct problem p;
    assert_int_equal(problem_at(&p, PROBLEM_INVALID, "/cloth/pins/1", "there is no vertex %d", 25), -1);
    json_t *json = problem_json(&p, "/v1/jobs", "r-1");
    assert_non_null(json);
    assert_string_equal(json_string_value(json_object_get(json, "code")), "invalid");
    assert_int_equal(json_integer_value(json_object_get(json, "status")), 422);
    assert_string_equal(json_string_value(json_object_get(json, "instance")), "/v1/jobs");
    assert_string_equal(json_string_value(json_object_get(json, "request_id")), "r-1");
    assert_true(json_is_false(json_object_get(json, "retryable")));
    assert_non_null(strstr(json_string_value(json_object_get(json, "type")), "invalid"));
    assert_true(strlen(json_string_value(json_object_get(json, "title"))) > 5);
    assert_non_null(strstr(json_string_value(json_object_get(json, "detail")), "there is no vertex 25"));
    json_t *errors = json_object_get(json, "errors");
    assert_int_equal(json_array_size(errors), 1);
    assert_string_equal(json_string_value(json_object_get(json_array_get(errors, 0), "pointer")),
                        "/cloth/pins/1");
    json_decref(json);
}

static void test_problem__bytes_that_are_not_utf8_do_not_spoil_the_body(void **state)
{
    (void)state;
    struct problem p;
    problem_set(&p, PROBLEM_BAD_REQUEST, "bad byte \xff here");
    json_t *json = problem_json(&p, "/\xfe", NULL);
    assert_non_null(json);
    assert_string_equal(json_string_value(json_object_get(json, "detail")), "bad byte ? here");
    assert_string_equal(json_string_value(json_object_get(json, "instance")), "/?");
    assert_null(json_object_get(json, "request_id"));
    json_decref(json);
}

static void test_problem__what_there_is_no_memory_to_say_is_said_alike(void **state)
{
    (void)state;
    struct problem p;
    problem_set(&p, PROBLEM_INTERNAL, "out of memory");
    json_t *made = problem_json(&p, NULL, NULL), *kept = json_loads(problem_no_memory, 0, NULL);
    assert_non_null(kept);
    assert_true(json_equal(made, kept));
    json_decref(made);
    json_decref(kept);
}

static void test_problem__a_null_problem_is_not_written(void **state)
{
    (void)state;
    assert_int_equal(problem_set(NULL, PROBLEM_INVALID, "x"), -1);
    assert_int_equal(problem_at(NULL, PROBLEM_INVALID, "", "x"), -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_problem__every_code_has_a_name_a_title_and_an_error_status),
        cmocka_unit_test(test_problem__names_are_unique),
        cmocka_unit_test(test_problem__what_passes_by_itself_is_retryable),
        cmocka_unit_test(test_problem__json_has_every_member_of_the_contract),
        cmocka_unit_test(test_problem__bytes_that_are_not_utf8_do_not_spoil_the_body),
        cmocka_unit_test(test_problem__what_there_is_no_memory_to_say_is_said_alike),
        cmocka_unit_test(test_problem__a_null_problem_is_not_written),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
