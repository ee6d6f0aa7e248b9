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

/* The square held by an edge pushed together to `share` of its length: wrinkles, and more than one rest. */
static struct setup *curtain(double k, double rigidity, double share)
{
    struct setup *setup = square(k, rigidity, 1);
    for (size_t i = 0; i < setup->desc.vertices; i++)
        setup->x[3 * i + 2] *= share;
    return setup;
}

/* Cut off anywhere on the way, energy peaks included, the state is the lowest of all that were passed. */
static void assert_returns_the_best(const struct setup *setup)
{
    bool rose = false;
    for (uint32_t most = 1; most <= 20; most++) {
        drape_options options = options_of(DRAPE_METHOD_AUTO);
        options.max_iterations = most;
        options.tolerance = 1e-15;
        struct run run = run_new(&setup->desc, &options);
        double lowest = INFINITY;
        for (size_t i = 0; i < run.rows; i++)
            lowest = fmin(lowest, run.row[i].energy.potential);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_NOT_AT_REST);
        assert_true(run.report->state.energy.potential == lowest);
        rose = rose || run.row[run.rows - 1].energy.potential > lowest;
        run_done(&run);
    }
    assert_true(rose);
}

static void test_methods__auto_never_returns_worse_than_it_saw(void **state)
{
    (void)state;
    struct setup *swinging = square(10000, 1e-7, 1), *wrinkling = curtain(1000, 1e-6, 0.8);
    assert_returns_the_best(swinging);
    assert_returns_the_best(wrinkling);
    setup_free(swinging);
    setup_free(wrinkling);
}

static void test_methods__auto_leaves_the_saddles_of_wrinkled_cloth(void **state)
{
    (void)state;
    static const double stiffness[] = {10, 1000};
    for (int i = 0; i < 2; i++) {
        struct setup *setup = curtain(stiffness[i], 1e-6, 0.8);
        drape_options fast = options_of(DRAPE_METHOD_AUTO), paper = options_of(DRAPE_METHOD_STOP_AND_GO);
        fast.max_iterations = 100;
        struct run a = run_new(&setup->desc, &fast), b = run_new(&setup->desc, &paper);
        print_message("%g N/m: auto %u factorisations, %u back-solves, %.6e J, stop-and-go %u, %.6e J\n",
                      stiffness[i], a.report->factorizations, a.report->solves,
                      a.report->state.energy.potential, b.report->factorizations,
                      b.report->state.energy.potential);
        assert_int_equal(a.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_int_equal(a.report->method, DRAPE_METHOD_AUTO);
        assert_true(a.report->solves > a.report->iterations + 1); /* conjugate gradients took part */
        uint32_t solves = 0;
        for (size_t j = 0; j < a.rows; j++)
            solves += a.row[j].linear_iterations;
        assert_true(solves < a.report->solves); /* the last state's own step is not taken */
        assert_true(2 * a.report->factorizations < b.report->factorizations);
        run_done(&a);
        run_done(&b);
        setup_free(setup);
    }
}

/* Never at rest: the watchdog must bite three times. Without friction, be it far away, the run would end
 * where the force is round-off. */
static void test_methods__auto_hands_over_to_stop_and_go_when_nothing_improves(void **state)
{
    (void)state;
    const drape_body floor = {
        .kind = DRAPE_BODY_PLANE, .offset = 0.003, .friction = 0.3, .point = {0, -10, 0}, .axis = {0, 1, 0}};
    struct setup *setup = square(10, 1e-5, 0);
    drape_options options = options_of(DRAPE_METHOD_AUTO);
    setup->desc.bodies = 1;
    setup->desc.body = &floor;
    setup->desc.self_contact = DRAPE_SELF_CONTACT_OFF;
    struct run rest = run_new(&setup->desc, &options);
    options.tolerance = 1e-300;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(rest.report->method, DRAPE_METHOD_AUTO);
    assert_int_equal(run.report->method, DRAPE_METHOD_STOP_AND_GO);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_NOT_AT_REST);
    assert_int_equal(run.report->iterations, options.max_iterations);
    assert_close(run.report->state.energy.potential, rest.report->state.energy.potential, 1e-9);
    assert_true(run.row[run.rows - 1].time_step == options.time_step); /* steps in time again */
    for (size_t i = 0; i < run.report->terms; i++) /* for which it has velocities after all */
        if (!strcmp(run.report->term[i].name, "velocities"))
            assert_true(run.report->term[i].kept && run.report->term[i].bytes > 0 &&
                        !rest.report->term[i].kept && rest.report->term[i].bytes == 0);
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

/* A square in free fall far above a body: weight and velocity point the same way. */
static struct setup *falling(drape_body *body)
{
    struct setup *setup = square(1000, 1e-5, 0);
    *body = (drape_body){.kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {0, -100, 0}, .radius = 1};
    setup->desc.pins = 0;
    setup->desc.body = body;
    setup->desc.bodies = 1;
    return setup;
}

static void test_methods__velocity_correction_is_dynamics_where_nothing_runs_against_the_force(void **state)
{
    (void)state;
    for (int integrator = DRAPE_BACKWARD_EULER; integrator <= DRAPE_RK4; integrator++) {
        drape_body body;
        struct setup *setup = falling(&body);
        drape_options options = options_of(DRAPE_METHOD_DYNAMIC);
        options.integrator = (drape_integrator)integrator;
        options.time_step = integrator == DRAPE_RK4 ? 1e-4 : 0.01;
        options.max_iterations = 20;
        struct run plain = run_new(&setup->desc, &options);
        options.method = DRAPE_METHOD_VELOCITY_CORRECTION;
        struct run corrected = run_new(&setup->desc, &options);
        assert_int_equal(corrected.report->method, DRAPE_METHOD_VELOCITY_CORRECTION);
        assert_int_equal(corrected.report->integrator, integrator);
        assert_true(plain.row[20].energy.kinetic > 0);
        assert_memory_equal(corrected.x, plain.x, 3 * setup->desc.vertices * sizeof *plain.x);
        for (size_t i = 0; i <= 20; i++)
            assert_memory_equal(&corrected.row[i].energy, &plain.row[i].energy, sizeof plain.row[i].energy);
        run_done(&plain);
        run_done(&corrected);
        setup_free(setup);
    }
}

/* J: the most that the total energy rises over one iteration. */
static double largest_rise(const struct run *run)
{
    double largest = 0;
    for (size_t i = 1; i < run->rows; i++)
        largest = fmax(largest, total_energy(run->row + i) - total_energy(run->row + i - 1));
    return largest;
}

static void test_methods__velocity_correction_never_raises_the_total_energy(void **state)
{
    (void)state;
    struct setup *setup = square(10, 1e-5, 0);
    drape_options options = options_of(DRAPE_METHOD_VELOCITY_CORRECTION);
    options.time_step = 0.005; /* resolves the swing: far longer, backward Euler itself may gain a little */
    options.max_iterations = 250;
    struct run run = run_new(&setup->desc, &options);
    double fastest = 0;
    for (size_t i = 1; i < run.rows; i++) {
        assert_false(run.row[i].stop);
        fastest = fmax(fastest, run.row[i].energy.kinetic);
    }
    assert_true(fastest > 1e-3); /* J */
    assert_true(largest_rise(&run) < 1e-15);
    assert_int_equal(run.report->stops, 0);
    run_done(&run);

    /* BDF-2 is of second order and no such bound holds; but with the dropped motion left in its history it
     * would rise by 1e-2 J in one step. */
    options.integrator = DRAPE_BDF2;
    run = run_new(&setup->desc, &options);
    print_message("bdf2: rises by %.3g J at most\n", largest_rise(&run));
    assert_true(largest_rise(&run) < 1e-5);
    run_done(&run);
    setup_free(setup);
}

static void test_methods__velocity_correction_rests_later_than_stop_and_go(void **state)
{
    (void)state;
    struct setup *setup = square(10, 1e-5, 0);
    drape_options options = options_of(DRAPE_METHOD_STOP_AND_GO);
    options.tolerance = 1e-3;
    struct run stop = run_new(&setup->desc, &options);
    options.method = DRAPE_METHOD_VELOCITY_CORRECTION;
    struct run correct = run_new(&setup->desc, &options);
    options.integrator = DRAPE_BDF2;
    struct run bdf2 = run_new(&setup->desc, &options);
    options.integrator = DRAPE_BACKWARD_EULER;
    options.method = DRAPE_METHOD_DYNAMIC;
    struct run plain = run_new(&setup->desc, &options);
    print_message("stop-and-go %u iterations, velocity-correction %u, by bdf2 %u\n", stop.report->iterations,
                  correct.report->iterations, bdf2.report->iterations);
    assert_int_equal(stop.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(correct.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(plain.report->verdict, DRAPE_VERDICT_NOT_AT_REST);
    assert_true(stop.report->iterations < correct.report->iterations);
    assert_close(correct.report->state.energy.potential, stop.report->state.energy.potential, 1e-6);
    assert_true(correct.report->state.energy.kinetic < 1e-9); /* at rest: the momentum is gone as well */
    assert_int_equal(bdf2.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_close(bdf2.report->state.energy.potential, stop.report->state.energy.potential, 1e-6);
    run_done(&plain);
    run_done(&bdf2);
    run_done(&correct);
    run_done(&stop);
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

static void test_methods__a_large_cloth_and_a_short_limit_end_at_once(void **state)
{
    (void)state;
    static const struct {
        drape_method method;
        double time_limit; /* s */
        const char *reason;
    } row[] = {
        /* 8e9 operations: more than a second at the 5e9 a second foreseen, 8 s of plain Newton's */
        {DRAPE_METHOD_STOP_AND_GO, 0.5, "the time limit is too short for one iteration"},
        {DRAPE_METHOD_NEWTON, 5, "the time limit is too short for one iteration"},
        {DRAPE_METHOD_STOP_AND_GO, 600, "the iterations ran out"},
    };
    struct setup *setup =
        setup_new(grid_new(GRID_ALTERNATING, 130, 130, 0.5, 0.5, 1), isotropic(0.1, 10, 1e-5));
    pin_columns(setup, 1);
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        drape_options options = options_of(row[i].method);
        options.time_limit = row[i].time_limit;
        options.max_iterations = 1;
        struct run run = run_new(&setup->desc, &options);
        assert_string_equal(run.report->reason, row[i].reason);
        run_done(&run);
    }
    setup_free(setup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_methods__auto_ends_where_stop_and_go_ends_for_a_fraction_of_the_factors),
        cmocka_unit_test(test_methods__auto_never_returns_worse_than_it_saw),
        cmocka_unit_test(test_methods__auto_leaves_the_saddles_of_wrinkled_cloth),
        cmocka_unit_test(test_methods__auto_hands_over_to_stop_and_go_when_nothing_improves),
        cmocka_unit_test(test_methods__the_papers_baselines_end_as_it_says),
        cmocka_unit_test(test_methods__velocity_correction_is_dynamics_where_nothing_runs_against_the_force),
        cmocka_unit_test(test_methods__velocity_correction_never_raises_the_total_energy),
        cmocka_unit_test(test_methods__velocity_correction_rests_later_than_stop_and_go),
        cmocka_unit_test(test_methods__explicit_steps_too_long_end_honestly),
        cmocka_unit_test(test_methods__a_large_cloth_and_a_short_limit_end_at_once),
    };
    return cmocka_run_group_tests_name("methods", tests, NULL, NULL);
}
