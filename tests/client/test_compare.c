/* test_compare.c - E*, the price of each level, and minima that differ. */
#include "comparing.h"

static void test_compare__a_level_counts_from_where_the_run_stays_below(void **state)
{
    /* touches 1e-3 at row 2, leaves it, comes back at row 4 */
    struct compare_run run[] = {MADE_RUN("a", 1, 0.1, 0.0005, 0.01, 0.0009, 0.0001, 1e-7, 0)};
    struct comparison c = {.run = run, .runs = 1};
    (void)state;
    compare_reckon(&c);
    assert_close(c.start, 1, 0);
    assert_close(c.best, 0, 0);
    assert_close(run[0].level[0].iterations, 4, 0);
    assert_close(run[0].level[0].seconds, 2, 1e-15);
    assert_close(run[0].level[0].factorizations, 10, 0); /* the start has its own */
    assert_close(run[0].level[1].iterations, 6, 0);
    assert_close(run[0].level[2].iterations, 7, 0);
    assert_close(run[0].rest.iterations, 7, 0);
    assert_close(run[0].rest.factorizations, 16, 0);
    free_runs(&c);
}

static void test_compare__the_lowest_energy_is_the_measure_of_all(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 3, 1.004, 1.002), MADE_RUN("b", 3, 1.5, 1)};
    struct comparison c = {.run = run, .runs = 2};
    (void)state;
    compare_reckon(&c);
    assert_ptr_equal(c.from, &run[1]);
    assert_false(c.certified);
    assert_close(run[0].distance, 0.001, 1e-12);
    assert_true(isnan(run[0].level[1].iterations)); /* 1e-6 of b's minimum: never */
    assert_close(run[1].level[1].iterations, 2, 0);
    free_runs(&c);
}

static void test_compare__a_certified_energy_comes_before_a_lower_one(void **state)
{
    struct compare_run run[] = {MADE_RUN("low", 2, 1, 0.5), MADE_RUN("sure", 2, 1, 0.75),
                                MADE_RUN("surer", 2, 1, 0.625), MADE_RUN("not", 2, 1, 0.25)};
    struct comparison c = {.run = run, .runs = 4};
    (void)state;
    replace_job(&run[1], made_job("at-rest", 0.75, ",\"certificate\":{\"certified\":true}"));
    replace_job(&run[2], made_job("at-rest", 0.625, ",\"certificate\":{\"certified\":true}"));
    replace_job(&run[3], made_job("at-rest", 0.25, ",\"certificate\":{\"certified\":false}"));
    compare_reckon(&c);
    assert_ptr_equal(c.from, &run[2]);
    assert_true(c.certified);
    assert_true(c.below_best);
    assert_close(c.best, 0.625, 0);
    free_runs(&c);
}

static void test_compare__minima_differ_past_the_threshold_only(void **state)
{
    const double within = 0.9 * COMPARE_SAME_MINIMUM, beyond = 1.1 * COMPARE_SAME_MINIMUM;
    struct compare_run run[] = {MADE_RUN("best", 1, 0), MADE_RUN("near", 1, within),
                                MADE_RUN("far", 1, beyond)};
    struct comparison c = {.run = run, .runs = 3};
    (void)state;
    c.runs = 2;
    compare_reckon(&c);
    assert_false(c.minima_differ);
    c.runs = 3;
    compare_reckon(&c);
    assert_true(c.minima_differ);
    assert_false(run[1].other_minimum);
    assert_true(run[2].other_minimum);
    replace_job(&run[2], made_job("not-at-rest", beyond, "")); /* on its way: no minimum at all */
    compare_reckon(&c);
    assert_false(c.minima_differ);
    free_runs(&c);
}

static void test_compare__a_run_at_rest_also_counts_to_its_own_end(void **state)
{
    struct compare_run run[] = {MADE_RUN("best", 2, 0), MADE_RUN("other", 2, 1.0005, 1),
                                MADE_RUN("above", 2, 3)};
    struct comparison c = {.run = run, .runs = 3};
    (void)state;
    compare_reckon(&c);
    assert_true(isnan(run[1].level[0].iterations));
    assert_close(run[1].own[0].iterations, 1, 0); /* 0.0005 of its own way of 1 */
    assert_close(run[1].own[0].factorizations, 4, 0);
    assert_close(run[1].own[1].iterations, 2, 0);
    assert_close(run[0].own[2].iterations, run[0].level[2].iterations, 0);
    assert_true(isnan(run[2].own[0].iterations)); /* there was no way down */
    replace_job(&run[1], made_job("not-at-rest", 1, ""));
    compare_reckon(&c);
    assert_true(isnan(run[1].own[0].iterations)); /* where it goes is not known */
    free_runs(&c);
}

static void test_compare__traces_without_factorisations_have_no_price_in_them(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1, 0)};
    struct comparison c = {.run = run, .runs = 1};
    (void)state;
    run[0].trace.row[0].factorizations = run[0].trace.row[1].factorizations = NAN;
    compare_reckon(&c);
    assert_close(run[0].level[2].iterations, 1, 0);
    assert_true(isnan(run[0].level[2].factorizations));
    assert_close(run[0].rest.factorizations, 9, 0); /* the report's */
    free_runs(&c);
}

static void test_compare__what_fell_off_or_broke_is_no_measure(void **state)
{
    struct compare_run run[] = {MADE_RUN("fine", 1, 0.5), MADE_RUN("fallen", 1, -9),
                                MADE_RUN("inside", 1, -8), MADE_RUN("broken", 1, NAN),
                                refused_run("unknown", "no such method")};
    struct comparison c = {.run = run, .runs = 5};
    (void)state;
    replace_job(&run[1], made_job("slid-off", -9, ""));
    replace_job(&run[2], made_job("intersecting", -8, ""));
    replace_job(&run[3], json_loads("{\"id\":\"j\",\"status\":\"failed\",\"verdict\":null,\"report\":null,"
                                    "\"error\":{\"detail\":\"not finite\"}}",
                                    0, NULL));
    compare_reckon(&c);
    assert_ptr_equal(c.from, &run[0]);
    for (size_t i = 1; i < 5; i++) {
        assert_false(run[i].usable);
        assert_true(isnan(run[i].level[0].iterations));
        assert_false(run[i].other_minimum);
    }
    assert_string_equal(compare_outcome(&run[3]), "failed");
    assert_string_equal(compare_reason(&run[3]), "not finite");
    assert_string_equal(compare_outcome(&run[4]), "refused");
    assert_string_equal(compare_reason(&run[4]), "no such method");
    free_runs(&c);
}

static void test_compare__above_the_start_equal_or_empty_has_no_distance(void **state)
{
    struct compare_run above[] = {MADE_RUN("up", 1, 2)}, equal[] = {MADE_RUN("a", 1, 1), MADE_RUN("b", 1, 1)};
    struct compare_run empty[] = {made_run("none", NULL, 0)};
    struct comparison all[] = {
        {.run = above, .runs = 1}, {.run = equal, .runs = 2}, {.run = empty, .runs = 1}};
    (void)state;
    for (size_t i = 0; i < 3; i++) {
        struct comparison *c = &all[i];
        compare_reckon(c);
        assert_true(isnan(c->drop));
        assert_true(isnan(c->run[0].distance));
        assert_true(isnan(c->run[0].level[0].iterations));
        assert_false(c->minima_differ);
        free_runs(c);
    }
    assert_null(all[2].from);
}

static void test_compare__a_row_that_is_not_finite_is_not_near(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1, 0.5, 0, NAN, 0)};
    struct comparison c = {.run = run, .runs = 1};
    (void)state;
    compare_reckon(&c);
    assert_close(run[0].level[0].iterations, 4, 0);
    free_runs(&c);
}

static void test_compare__the_floor_is_what_is_known_of_the_best(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 2, 0.25, 0.5), MADE_RUN("b", 2, 1)};
    struct comparison c = {.run = run, .runs = 2};
    (void)state;
    compare_reckon(&c);
    assert_close(c.floor, 0.25 / 1.5, 1e-12); /* a itself swung below E* */
    run[0].trace.row[1].potential = 0.75;
    replace_job(&run[0], made_job("at-rest", 0.5, ",\"residual_energy\":0.0625"));
    compare_reckon(&c);
    assert_close(c.floor, 0.0625 / 1.5, 1e-12); /* its own word; coarser than two digits, 0.005 */
    replace_job(&run[0], made_job("at-rest", 0.5, ",\"residual_energy\":null"));
    compare_reckon(&c);
    assert_close(c.floor, 0.005 / 1.5, 1e-12);
    free_runs(&c);
}

static void test_compare__different_starts_are_noticed(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1.25, 0.5), MADE_RUN("b", 1.25, 0.5)};
    struct comparison c = {.run = run, .runs = 2};
    (void)state;
    compare_reckon(&c);
    assert_false(c.starts_differ);
    run[1].trace.row[0].potential = 1.5;
    compare_reckon(&c);
    assert_true(c.starts_differ);
    free_runs(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_compare__a_level_counts_from_where_the_run_stays_below),
        cmocka_unit_test(test_compare__the_lowest_energy_is_the_measure_of_all),
        cmocka_unit_test(test_compare__a_certified_energy_comes_before_a_lower_one),
        cmocka_unit_test(test_compare__minima_differ_past_the_threshold_only),
        cmocka_unit_test(test_compare__a_run_at_rest_also_counts_to_its_own_end),
        cmocka_unit_test(test_compare__traces_without_factorisations_have_no_price_in_them),
        cmocka_unit_test(test_compare__what_fell_off_or_broke_is_no_measure),
        cmocka_unit_test(test_compare__above_the_start_equal_or_empty_has_no_distance),
        cmocka_unit_test(test_compare__a_row_that_is_not_finite_is_not_near),
        cmocka_unit_test(test_compare__the_floor_is_what_is_known_of_the_best),
        cmocka_unit_test(test_compare__different_starts_are_noticed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
