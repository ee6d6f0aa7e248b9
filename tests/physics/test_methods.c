/* test_methods.c - every method on scenes that have one rest state: where each ends and at what cost. */
#include "test.h"

#include "run.h"

/* The paper's square of 0.5 m in 800 triangles, held by one edge; start: 0 flat, 1 shaken by 5 mm, 2 folded
 * upwards over itself. */
static struct setup *square(double k, double rigidity, int start)
{
    struct setup *setup =
        setup_new(grid_new(GRID_ALTERNATING, 20, 20, 0.5, 0.5, 1), isotropic(0.1, k, rigidity));
    uint64_t seed = 77;
    pin_columns(setup, 1);
    for (size_t i = 0; i < setup->desc.vertices; i++) {
        double *x = setup->x + 3 * i;
        if (start == 1 && x[0] > 0)
            for (int d = 0; d < 3; d++)
                x[d] += 0.005 * test_random(&seed);
        if (start == 2 && x[0] > 0.25) {
            x[0] = 0.5 - x[0];
            x[1] = 0.002;
        }
    }
    return setup;
}

static drape_options options_of(drape_method method)
{
    drape_options options = drape_options_default();
    options.method = method;
    options.tolerance = 1e-6;
    options.max_iterations = 400;
    return options;
}

static void test_methods__auto_ends_where_stop_and_go_ends_for_a_fraction_of_the_factors(void **state)
{
    (void)state;
    static const double stiffness[] = {10, 1000, 10000};
    uint32_t all[2] = {0, 0};
    for (int start = 0; start < 3; start++)
        for (int i = 0; i < 3; i++) {
            struct setup *setup = square(stiffness[i], 1e-5, start);
            drape_options fast = options_of(DRAPE_METHOD_AUTO), paper = options_of(DRAPE_METHOD_STOP_AND_GO);
            struct run a = run_new(&setup->desc, &fast), b = run_new(&setup->desc, &paper);
            print_message("start %d, %g N/m: auto %u factorisations, stop-and-go %u\n", start, stiffness[i],
                          a.report->factorizations, b.report->factorizations);
            assert_int_equal(a.report->verdict, DRAPE_VERDICT_AT_REST);
            assert_int_equal(b.report->verdict, DRAPE_VERDICT_AT_REST);
            assert_int_equal(a.report->method, DRAPE_METHOD_AUTO);
            assert_close(a.report->state.energy.potential, b.report->state.energy.potential, 1e-8);
            for (size_t j = 0; j < 3 * setup->desc.vertices; j++)
                assert_near(a.x[j], b.x[j], 1e-5, 1); /* m */
            all[0] += a.report->factorizations;
            all[1] += b.report->factorizations;
            run_done(&a);
            run_done(&b);
            setup_free(setup);
        }
    assert_true(5 * all[0] < all[1]);
}

static void test_methods__auto_never_returns_worse_than_it_saw(void **state)
{
    (void)state;
    for (uint32_t most = 1; most <= 20; most++) { /* cut off everywhere on the way, energy peaks included */
        struct setup *setup = square(10000, 1e-7, 1);
        drape_options options = options_of(DRAPE_METHOD_AUTO);
        options.max_iterations = most;
        struct run run = run_new(&setup->desc, &options);
        for (size_t i = 0; i < run.rows; i++)
            assert_true(run.report->state.energy.potential <= run.row[i].energy.potential);
        run_done(&run);
        setup_free(setup);
    }
}

static void test_methods__auto_hands_over_to_stop_and_go_when_nothing_improves(void **state)
{
    (void)state;
    struct setup *setup = square(10, 1e-5, 0);
    drape_options options = options_of(DRAPE_METHOD_AUTO);
    struct run rest = run_new(&setup->desc, &options);
    options.tolerance = 1e-300; /* never at rest: the watchdog must bite three times */
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(rest.report->method, DRAPE_METHOD_AUTO);
    assert_int_equal(run.report->method, DRAPE_METHOD_STOP_AND_GO);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_NOT_AT_REST);
    assert_int_equal(run.report->iterations, options.max_iterations);
    assert_close(run.report->state.energy.potential, rest.report->state.energy.potential, 1e-9);
    assert_true(run.row[run.rows - 1].time_step == options.time_step); /* steps in time again */
    run_done(&run);
    run_done(&rest);
    setup_free(setup);
}

static void test_methods__the_papers_baselines_end_as_it_says(void **state)
{
    (void)state;
    struct setup *setup = square(10, 1e-5, 0);
    drape_options options = options_of(DRAPE_METHOD_STOP_AND_GO);
    struct run best = run_new(&setup->desc, &options);
    double least = best.report->state.energy.potential;
    run_done(&best);

    options = options_of(DRAPE_METHOD_NEWTON);
    options.line_search = true;
    struct run newton = run_new(&setup->desc, &options);
    assert_int_equal(newton.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_close(newton.report->state.energy.potential, least, 1e-8);
    assert_int_equal(newton.report->stops, 0);
    run_done(&newton);

    options = options_of(DRAPE_METHOD_QUASI_STATIC); /* creeps: no momentum carries it along */
    struct run quasi = run_new(&setup->desc, &options);
    assert_int_equal(quasi.report->verdict, DRAPE_VERDICT_NOT_AT_REST);
    for (size_t i = 1; i < quasi.rows; i++) {
        assert_true(quasi.row[i].energy.kinetic == 0);
        assert_true(quasi.row[i].energy.potential <= quasi.row[i - 1].energy.potential + 1e-15);
    }
    run_done(&quasi);

    options = options_of(DRAPE_METHOD_STOP_AND_GO);
    options.integrator = DRAPE_BDF2;
    struct run bdf2 = run_new(&setup->desc, &options);
    assert_int_equal(bdf2.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_close(bdf2.report->state.energy.potential, least, 1e-8);
    run_done(&bdf2);
    setup_free(setup);
}

static void test_methods__explicit_steps_too_long_end_honestly(void **state)
{
    (void)state;
    struct setup *setup = square(1000, 1e-5, 0);
    drape_options options = options_of(DRAPE_METHOD_STOP_AND_GO);
    options.integrator = DRAPE_RK4;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_NOT_AT_REST);
    assert_string_equal(run.report->reason, "the energy grew past every bound");
    assert_int_equal(run.report->factorizations, 0);
    for (size_t i = 0; i < 3 * setup->desc.vertices; i++)
        assert_true(isfinite(run.x[i]));
    run_done(&run);

    options.time_step = 1e-4; /* below 2.8 over the highest frequency */
    run = run_new(&setup->desc, &options);
    assert_string_equal(run.report->reason, "the iterations ran out");
    assert_true(run.report->state.energy.potential < 0);
    for (size_t i = 0; i < run.rows; i++)
        assert_true(isnan(run.row[i].residual_energy)); /* no Jacobian, no estimate */
    run_done(&run);
    setup_free(setup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_methods__auto_ends_where_stop_and_go_ends_for_a_fraction_of_the_factors),
        cmocka_unit_test(test_methods__auto_never_returns_worse_than_it_saw),
        cmocka_unit_test(test_methods__auto_hands_over_to_stop_and_go_when_nothing_improves),
        cmocka_unit_test(test_methods__the_papers_baselines_end_as_it_says),
        cmocka_unit_test(test_methods__explicit_steps_too_long_end_honestly),
    };
    return cmocka_run_group_tests_name("methods", tests, NULL, NULL);
}
