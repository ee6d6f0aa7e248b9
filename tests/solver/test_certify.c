/* test_certify.c - rest carried on to round-off and proven a minimum; saddles found out and left. */
#include <time.h>

#include "clock.h"
#include "physics/run.h"

/* In place of the solver's: each look at it takes `tick` s; 0: it is a clock. */
static double tick, ticked;

double dr_clock(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    ticked += tick;
    return tick > 0 ? ticked : (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static drape_options certifying(drape_method method)
{
    drape_options options = drape_options_default();
    options.method = method;
    options.certify = true;
    return options;
}

static void tell(const struct run *run)
{
    const drape_certificate *c = &run->report->certificate;
    print_message(
        "  %s, %s after %u iterations; certified %d: move %.1e m, energy %.1e J, curvature %.4g /s2, "
        "%u escapes, %u steps, %u factorisations: %s\n",
        drape_method_name(run->report->method), drape_verdict_name(run->report->verdict),
        run->report->iterations, c->certified, c->largest_move, c->energy_left, c->curvature, c->escapes,
        c->steps, c->factorizations, c->reason);
}

static struct setup *hanging(enum grid_kind kind, size_t cells, double k, double B)
{
    struct setup *setup = setup_new(grid_new(kind, cells, cells, 0.5, 0.5, 0), isotropic(0.1, k, B));
    pin_columns(setup, 1);
    return setup;
}

static void test_certify__not_asked_for_says_nothing(void **state)
{
    (void)state;
    struct setup *setup = hanging(GRID_ONE, 6, 100, 1e-5);
    drape_options options = drape_options_default();
    struct run run = run_new(&setup->desc, &options);
    assert_null(run.report->certificate.reason);
    assert_false(run.report->certificate.certified);
    assert_int_equal(run.report->certificate.factorizations, 0);
    run_done(&run);
    setup_free(setup);
}

/* A heavy chain's slowest swing has omega^2 = (j0/2)^2 g/L, j0 = 2.40483 the first zero of the Bessel
 * function J0; what is proven is half of the lowest curvature. Some bending keeps the cloth's edges from
 * curling, which would be slower; it adds about a per cent. */
static void test_certify__a_hanging_cloth_is_a_minimum_as_stiff_as_a_chain(void **state)
{
    (void)state;
    const double chain = pow(2.404826 / 2, 2) * 9.81 / 0.5;
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = hanging(kind, 24, 1e4, 1e-5);
        drape_options options = certifying(DRAPE_METHOD_AUTO);
        struct run run = run_new(&setup->desc, &options);
        const drape_certificate *certificate = &run.report->certificate;
        tell(&run);
        assert_true(certificate->certified);
        assert_int_equal(certificate->escapes, 0);
        assert_true(certificate->largest_move < 1e-14);
        assert_true(certificate->energy_left >= 0 && certificate->energy_left < 1e-25);
        assert_close(2 * certificate->curvature, chain, 0.015);
        assert_true(run.report->state.residual_energy == certificate->energy_left);
        assert_true(run.report->reference_rows);
        const drape_row *first = &run.row[0], *last = &run.row[run.rows - 1];
        assert_close(first->residual_energy, first->energy.potential - last->energy.potential, 1e-6);
        assert_true(run.report->state.residual_force < 1e-7);
        run_done(&run);
        setup_free(setup);
    }
}

/* Explicit steps have no matrix, Newton an indefinite one: the certificate brings its own. */
static void test_certify__every_method_ends_in_the_same_point(void **state)
{
    (void)state;
    struct setup *setup = hanging(GRID_DELAUNAY, 8, 10, 1e-5);
    static const struct {
        drape_method method;
        drape_integrator integrator;
        double time_step;
    } way[] = {{DRAPE_METHOD_AUTO, 0, 0.02},
               {DRAPE_METHOD_STOP_AND_GO, DRAPE_BACKWARD_EULER, 0.02},
               {DRAPE_METHOD_STOP_AND_GO, DRAPE_BDF2, 0.02},
               {DRAPE_METHOD_STOP_AND_GO, DRAPE_RK4, 1e-3},
               {DRAPE_METHOD_NEWTON, 0, 0.02}};
    double *first = NULL, energy = 0;
    for (size_t i = 0; i < sizeof way / sizeof *way; i++) {
        drape_options options = certifying(way[i].method), plain;
        options.integrator = way[i].integrator;
        options.time_step = way[i].time_step;
        options.line_search = true;
        options.max_iterations = 20000;
        plain = options;
        plain.certify = false;
        struct run run = run_new(&setup->desc, &options), without = run_new(&setup->desc, &plain);
        tell(&run);
        assert_true(run.report->certificate.certified);
        /* the method's own record is not touched */
        assert_int_equal(run.report->iterations, without.report->iterations);
        assert_int_equal(run.report->factorizations, without.report->factorizations);
        assert_int_equal(run.report->solves, without.report->solves);
        assert_int_equal(run.rows, without.rows);
        assert_memory_equal(&run.row[run.rows - 1].energy, &without.row[run.rows - 1].energy,
                            sizeof(drape_energies));
        assert_true(run.report->state.energy.potential <= without.report->state.energy.potential);
        if (!first) {
            first = malloc(3 * setup->desc.vertices * sizeof *first);
            memcpy(first, run.x, 3 * setup->desc.vertices * sizeof *first);
            energy = run.report->state.energy.potential;
        }
        assert_close(run.report->state.energy.potential, energy, 1e-14);
        for (size_t j = 0; j < 3 * setup->desc.vertices; j++)
            assert_near(run.x[j], first[j], 1e-13, 1);
        run_done(&run);
        run_done(&without);
    }
    free(first);
    setup_free(setup);
}

/* ---- saddles ---- */

/* An upright strip heavier than Greenhill's column, exactly straight: every method leaves it standing, as
 * nothing says to which side to fall. */
static struct setup *column(double length, double times_critical)
{
    const double density = 0.1, B = density * 9.81 * pow(length, 3) / (7.837 * times_critical);
    enum { CELLS = 20, ACROSS = 4 };
    double h = length / CELLS;
    struct setup *setup = setup_new(grid_new(GRID_ONE, CELLS + 1, ACROSS, length + h, h * ACROSS, 0),
                                    isotropic(density, 1e4, B));
    pin_columns(setup, 2);
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        setup->x[3 * i + 1] = setup->grid.uv[2 * i] - h;
        setup->x[3 * i] = 0;
    }
    return setup;
}

static double height(const struct setup *setup, const struct run *run)
{
    return run->x[3 * (size_t)grid_at(&setup->grid, setup->grid.nx, setup->grid.ny / 2) + 1];
}

static void test_certify__a_column_past_its_load_is_a_saddle_and_falls(void **state)
{
    (void)state;
    const drape_method method[] = {DRAPE_METHOD_AUTO, DRAPE_METHOD_STOP_AND_GO, DRAPE_METHOD_NEWTON};
    for (size_t i = 0; i < sizeof method / sizeof *method; i++) {
        struct setup *setup = column(0.2, 1.5);
        drape_options options = certifying(method[i]), plain;
        options.line_search = true;
        plain = options;
        plain.certify = false;
        struct run stands = run_new(&setup->desc, &plain), falls = run_new(&setup->desc, &options);
        tell(&falls);
        assert_int_equal(stands.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_near(height(setup, &stands), 0.2, 1e-4, 1);
        assert_int_equal(falls.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_true(falls.report->certificate.certified);
        assert_true(falls.report->certificate.escapes > 0);
        assert_true(height(setup, &falls) < 0.15);
        assert_true(falls.report->state.energy.potential < stands.report->state.energy.potential);
        run_done(&stands);
        run_done(&falls);
        setup_free(setup);
    }
}

static void test_certify__a_column_below_its_load_is_a_minimum(void **state)
{
    (void)state;
    struct setup *setup = column(0.2, 0.9);
    drape_options options = certifying(DRAPE_METHOD_AUTO);
    struct run run = run_new(&setup->desc, &options);
    tell(&run);
    assert_true(run.report->certificate.certified);
    assert_int_equal(run.report->certificate.escapes, 0);
    assert_near(height(setup, &run), 0.2, 1e-4, 1);
    run_done(&run);
    setup_free(setup);
}

/* When the iterations end on the way down from the saddle, the state at rest is given back. */
static void test_certify__without_iterations_left_the_saddle_is_told_and_kept(void **state)
{
    (void)state;
    struct setup *setup = column(0.2, 1.5);
    drape_options options = certifying(DRAPE_METHOD_AUTO), plain;
    plain = options;
    plain.certify = false;
    struct run stands = run_new(&setup->desc, &plain);
    options.max_iterations = stands.report->iterations;
    struct run run = run_new(&setup->desc, &options);
    tell(&run);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_false(run.report->certificate.certified);
    assert_int_equal(run.report->certificate.escapes, 1);
    assert_true(run.report->certificate.curvature < 0);
    assert_memory_equal(run.x, stands.x, 3 * setup->desc.vertices * sizeof *run.x);
    run_done(&stands);
    run_done(&run);
    setup_free(setup);
}

/* ---- what cannot be certified ---- */

static void test_certify__cloth_that_may_slide_freely_is_not_a_strict_minimum(void **state)
{
    (void)state;
    struct setup *setup = hanging(GRID_ALTERNATING, 8, 100, 1e-4);
    setup->desc.pins = 0;
    const drape_body ground = {
        .kind = DRAPE_BODY_PLANE, .offset = 0.003, .point = {0, -0.001, 0}, .axis = {0, 1, 0}};
    setup->desc.body = &ground;
    setup->desc.bodies = 1;
    drape_options options = certifying(DRAPE_METHOD_AUTO);
    struct run run = run_new(&setup->desc, &options);
    tell(&run);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_false(run.report->certificate.certified);
    run_done(&run);
    setup_free(setup);
}

static void test_certify__what_is_not_at_rest_is_not_tried(void **state)
{
    (void)state;
    struct setup *setup = hanging(GRID_ONE, 8, 100, 1e-5);
    drape_options options = certifying(DRAPE_METHOD_DYNAMIC);
    options.max_iterations = 5;
    struct run run = run_new(&setup->desc, &options);
    tell(&run);
    assert_false(run.report->certificate.certified);
    assert_string_equal(run.report->certificate.reason, "the drape is not at rest");
    assert_int_equal(run.report->certificate.factorizations, 0);
    run_done(&run);
    setup_free(setup);
}

static int cancel_when_certifying(const drape_progress *progress, void *data)
{
    size_t *calls = data;
    *calls += progress->phase == DRAPE_PHASE_CERTIFYING;
    return progress->phase == DRAPE_PHASE_CERTIFYING;
}

static void test_certify__can_be_cancelled_and_keeps_the_rest(void **state)
{
    (void)state;
    struct setup *setup = hanging(GRID_ONE, 8, 100, 1e-5);
    drape_options options = certifying(DRAPE_METHOD_AUTO);
    size_t calls = 0;
    options.progress = cancel_when_certifying;
    options.progress_data = &calls;
    struct run run = run_new(&setup->desc, &options);
    tell(&run);
    assert_int_equal(run.status, DRAPE_CANCELLED);
    assert_int_equal(calls, 1);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_false(run.report->certificate.certified);
    assert_string_equal(run.report->certificate.reason, "cancelled");
    run_done(&run);
    setup_free(setup);
}

/* ---- out of time ---- */

/* Whenever the time runs out, that is the reason: also between Newton's end and the proof. */
static void test_certify__a_proof_that_there_is_no_time_for_is_not_called_impossible(void **state)
{
    (void)state;
    struct setup *setup = hanging(GRID_ONE, 8, 100, 1e-5);
    drape_options options = certifying(DRAPE_METHOD_AUTO);
    const double most = 4000;
    size_t certified = 0, unproven = 0;
    tick = 2; /* s: longer than what always begins */
    options.time_limit = most;
    for (double left = 0; left < 100; left += tick) {
        struct run run = run_new(&setup->desc, &options);
        const drape_certificate *c = &run.report->certificate;
        bool late = c->reason && strstr(c->reason, "time limit");
        certified += c->certified;
        if (run.report->verdict == DRAPE_VERDICT_AT_REST && !c->certified)
            assert_true(late);
        unproven += late && c->largest_move < 1e-14 && c->curvature > 0;
        if (left == 0)
            options.time_limit = run.report->seconds;
        options.time_limit -= tick;
        run_done(&run);
    }
    tick = 0;
    print_message("  %zu certified, %zu without time for the proof alone\n", certified, unproven);
    assert_true(certified > 0 && unproven > 0);
    setup_free(setup);
}

/* ---- layers ---- */

/* A sheet on a slope of cloth that is held, itself held at a corner: without friction it would swing about
 * that until it hung down the slope. */
static struct setup *slope_of_cloth(void)
{
    struct setup *setup = setup_layers();
    const double slope = atan(0.2);
    size_t columns = setup->grid.nx + 1;
    for (size_t i = 0; i < setup->grid.vertices; i++)
        if (i % columns <= (i < columns ? columns / 2 : columns / 2 - 1))
            setup->pin[setup->desc.pins++] = (uint32_t)i;
    setup->material.friction = 0.4;
    setup->desc.self_contact = DRAPE_SELF_CONTACT_ON;
    setup->desc.gravity[0] = 9.81 * sin(slope);
    setup->desc.gravity[1] = -9.81 * cos(slope);
    return setup;
}

/* Explicit steps have no matrix to lend: that of the certificate has the layers' anchors all the same. And
 * where these were renewed, the energies of a trace do not compare. */
static void test_certify__friction_of_layers_alone_is_in_it(void **state)
{
    (void)state;
    struct setup *setup = slope_of_cloth();
    drape_options options = certifying(DRAPE_METHOD_AUTO);
    struct run first = run_new(&setup->desc, &options);
    tell(&first);
    assert_true(first.report->certificate.certified);
    assert_false(first.report->reference_rows);
    memcpy(setup->x, first.x, 3 * setup->grid.vertices * sizeof *setup->x);
    setup->desc.start_pattern = setup->grid.uv;
    options.method = DRAPE_METHOD_DYNAMIC;
    options.integrator = DRAPE_RK4;
    options.time_step = 1e-5;
    struct run again = run_new(&setup->desc, &options);
    tell(&again);
    assert_true(again.report->certificate.certified);
    for (size_t i = 0; i < 3 * setup->grid.vertices; i++)
        assert_near(again.x[i], first.x[i], 1e-5, 1);
    run_done(&first);
    run_done(&again);
    setup_free(setup);
}

/* ---- over a body ---- */

/* Held along one edge beside a ball and draped over it: the ball's curvature is in the Hessian, else Newton
 * would not come down to round-off in a few steps. */
static void test_certify__cloth_over_a_ball_is_certified_with_the_contact(void **state)
{
    (void)state;
    struct setup *setup = hanging(GRID_ALTERNATING, 20, 100, 1e-4);
    const drape_body ball = {
        .kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {0.25, -0.13, -0.25}, .radius = 0.1};
    setup->desc.body = &ball;
    setup->desc.bodies = 1;
    drape_options options = certifying(DRAPE_METHOD_STOP_AND_GO);
    options.stop_on = DRAPE_STOP_ON_KINETIC;
    struct run run = run_new(&setup->desc, &options);
    tell(&run);
    assert_true(run.report->state.energy.contact > 0);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_true(run.report->certificate.certified);
    assert_true(run.report->certificate.largest_move < 1e-12);
    assert_true(run.report->certificate.steps <= 15);
    run_done(&run);
    setup_free(setup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_certify__not_asked_for_says_nothing),
        cmocka_unit_test(test_certify__a_hanging_cloth_is_a_minimum_as_stiff_as_a_chain),
        cmocka_unit_test(test_certify__every_method_ends_in_the_same_point),
        cmocka_unit_test(test_certify__a_column_past_its_load_is_a_saddle_and_falls),
        cmocka_unit_test(test_certify__a_column_below_its_load_is_a_minimum),
        cmocka_unit_test(test_certify__without_iterations_left_the_saddle_is_told_and_kept),
        cmocka_unit_test(test_certify__cloth_that_may_slide_freely_is_not_a_strict_minimum),
        cmocka_unit_test(test_certify__what_is_not_at_rest_is_not_tried),
        cmocka_unit_test(test_certify__can_be_cancelled_and_keeps_the_rest),
        cmocka_unit_test(test_certify__a_proof_that_there_is_no_time_for_is_not_called_impossible),
        cmocka_unit_test(test_certify__friction_of_layers_alone_is_in_it),
        cmocka_unit_test(test_certify__cloth_over_a_ball_is_certified_with_the_contact),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
