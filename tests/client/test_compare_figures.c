/* test_compare_figures.c - the same figures as CSV, JSON, a table and sentences. */
#include "comparing.h"

#include "compare_figures.h"

typedef void put_fn(FILE *file, const struct comparison *c);

static char *text_of(put_fn *put, const struct comparison *c)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&text, &bytes);
    assert_non_null(file);
    put(file, c);
    fclose(file);
    return text;
}

static void test_compare_figures__csv_quotes_methods_and_leaves_out_what_is_unknown(void **state)
{
    struct compare_run run[] = {MADE_RUN("a:x=\"1\",y=2", 1, 0.1), MADE_RUN("b", 1, 0),
                                refused_run("c", "no")};
    struct comparison c = {.run = run, .runs = 3};
    (void)state;
    run[1].trace.row[1].seconds = 0.1 + 0.2;
    compare_reckon(&c);
    char *text = text_of(compare_put_csv, &c);
    assert_string_equal(text,
                        "method,iteration,seconds,distance,stretch,bend,elastic,gravity,contact,kinetic,"
                        "potential,residual_energy,residual_force,stop,time_step,factorizations\r\n"
                        "\"a:x=\"\"1\"\",y=2\",0,0,1,0,0,0,1,0,0,1,,0,0,0,2\r\n"
                        "\"a:x=\"\"1\"\",y=2\",1,0.5,0.1,0,0,0,0.1,0,0,0.1,,0,0,0,2\r\n"
                        "b,0,0,1,0,0,0,1,0,0,1,,0,0,0,2\r\n"
                        "b,1,0.30000000000000004,0,0,0,0,0,0,0,0,,0,0,0,2\r\n");
    free(text);
    free_runs(&c);
}

static void test_compare_figures__json_has_null_for_what_was_never_reached(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1, 0.5, 0.25), MADE_RUN("b", 1, 0),
                                refused_run("c", "no \"c\"")};
    struct comparison c = {.run = run, .runs = 3};
    (void)state;
    compare_reckon(&c);
    json_t *figures = compare_to_json(&c), *methods = json_object_get(figures, "methods");
    assert_non_null(figures);
    assert_true(json_is_true(json_object_get(figures, "minima_differ")));
    assert_string_equal(json_string_value(json_object_get(figures, "best_method")), "b");
    const json_t *never = json_object_get(json_array_get(methods, 0), "to_1e-06");
    assert_true(json_is_null(json_object_get(never, "iterations")));
    const json_t *own = json_object_get(json_array_get(methods, 0), "own_1e-06");
    assert_close(json_number_value(json_object_get(own, "iterations")), 2, 0);
    assert_close(json_number_value(json_object_get(own, "factorizations")), 6, 0);
    const json_t *reached = json_object_get(json_array_get(methods, 1), "to_1e-06");
    assert_close(json_number_value(json_object_get(reached, "iterations")), 1, 0);
    const json_t *refused = json_array_get(methods, 2);
    assert_string_equal(json_string_value(json_object_get(refused, "reason")), "no \"c\"");
    assert_true(json_is_null(json_object_get(refused, "id")));
    json_decref(figures);
    free_runs(&c);
}

static void test_compare_figures__sentences_tell_what_to_beware_of(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1, 0.5, 0.25), MADE_RUN("b", 1, 0.001),
                                refused_run("c", "not today")};
    struct comparison c = {.run = run, .runs = 3};
    (void)state;
    compare_reckon(&c);
    char *text = text_of(compare_put_table, &c);
    const char *const words[] = {"E* = 0.001 J",
                                 "uncertified",
                                 "The minima differ: a rests at 0.25 J",
                                 "more than 1e-04",
                                 "to its own         2       6    1.000", /* of a */
                                 "not today",
                                 "are not known (marked *)",
                                 "1*"};
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (!strstr(text, words[i])) {
            print_error("no \"%s\" in\n%s", words[i], text);
            fail();
        }
    }
    assert_null(strstr(text, "did not start"));
    assert_null(strstr(text, "nan"));
    free(text);
    free_runs(&c);
}

static void test_compare_figures__a_certified_best_says_so(void **state)
{
    struct compare_run run[] = {MADE_RUN("sure", 1, 0.5)};
    struct comparison c = {.run = run, .runs = 1};
    (void)state;
    replace_job(&run[0], made_job("at-rest", 0.5, ",\"certificate\":{\"certified\":true}"));
    compare_reckon(&c);
    char *text = text_of(compare_put_table, &c);
    assert_non_null(strstr(text, "the lowest certified energy, of sure"));
    assert_null(strstr(text, "uncertified"));
    assert_non_null(strstr(text, "All methods that came to rest did so within 1e-04"));
    free(text);
    replace_job(&run[0], made_job("not-at-rest", 0.5, ""));
    compare_reckon(&c);
    text = text_of(compare_put_table, &c);
    assert_non_null(strstr(text, "No method came to rest"));
    assert_null(strstr(text, "All methods"));
    assert_non_null(strstr(text, "that method had not come to rest"));
    free(text);
    free_runs(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_compare_figures__csv_quotes_methods_and_leaves_out_what_is_unknown),
        cmocka_unit_test(test_compare_figures__json_has_null_for_what_was_never_reached),
        cmocka_unit_test(test_compare_figures__sentences_tell_what_to_beware_of),
        cmocka_unit_test(test_compare_figures__a_certified_best_says_so),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
