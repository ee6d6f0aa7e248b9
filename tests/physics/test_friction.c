/* test_friction.c - Coulomb's law: what it holds, what it lets go, and that what is held does not creep. */
#include "run.h"

#define GRAVITY 9.81
#define MU      0.3

/* A patch of 0.1 m lying on a plane at 3 mm, gravity turned by `slope` (the tangent) instead of the plane. */
static struct setup *patch(drape_body *ground, double mu, double slope)
{
    struct setup *setup = setup_new(grid_new(GRID_ALTERNATING, 8, 8, 0.1, 0.1, 0), isotropic(0.2, 400, 1e-4));
    double steepness = atan(slope);
    for (size_t i = 0; i < setup->grid.vertices; i++)
        setup->x[3 * i + 1] = 0.0029;
    *ground = (drape_body){
        .kind = DRAPE_BODY_PLANE, .offset = 0.003, .friction = mu, .point = {0, 0, 0}, .axis = {0, 1, 0}};
    setup->desc.body = ground;
    setup->desc.bodies = 1;
    setup->desc.gravity[0] = GRAVITY * sin(steepness);
    setup->desc.gravity[1] = -GRAVITY * cos(steepness);
    return setup;
}

static double mean_u(const struct setup *setup, const double *x)
{
    double sum = 0;
    for (size_t i = 0; i < setup->grid.vertices; i++)
        sum += x[3 * i];
    return sum / (double)setup->grid.vertices;
}

static void tell(const char *what, const struct setup *setup, const struct run *run)
{
    print_message("  %s: %s after %u iterations, %u stops, moved %.4g mm, residual %.3g: %s\n", what,
                  drape_verdict_name(run->report->verdict), run->report->iterations, run->report->stops,
                  (mean_u(setup, run->x) - mean_u(setup, setup->x)) * 1e3, run->report->state.residual_force,
                  run->report->reason);
}

static void test_friction__a_patch_on_a_slope_is_held_below_the_angle_and_slides_above(void **state)
{
    (void)state;
    const drape_method method[] = {DRAPE_METHOD_AUTO, DRAPE_METHOD_STOP_AND_GO, DRAPE_METHOD_QUASI_STATIC};
    for (size_t m = 0; m < sizeof method / sizeof *method; m++)
        for (int above = 0; above < 2; above++) {
            drape_body ground;
            struct setup *setup = patch(&ground, MU, (above ? 1.02 : 0.98) * MU);
            drape_options options = drape_options_default();
            options.method = method[m];
            options.max_iterations = 500;
            struct run run = run_new(&setup->desc, &options);
            tell(above ? "above" : "below", setup, &run);
            double moved = mean_u(setup, run.x) - mean_u(setup, setup->x);
            if (above) {
                assert_int_not_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
                assert_true(moved > 2e-3);
            } else { /* E'(l) = 0.98 mu N at l = (1 - sqrt(0.02)) of the slip */
                assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
                assert_near(moved, 0.5e-3 * (1 - sqrt(0.02)), 2e-5, 1);
            }
            run_done(&run);
            setup_free(setup);
        }
}

/* The tolerance is out of reach, so that the iterations go on. */
static void test_friction__what_is_held_does_not_creep(void **state)
{
    (void)state;
    const uint32_t iterations[2] = {500, 10500};
    double where[2];
    for (int late = 0; late < 2; late++) {
        drape_body ground;
        struct setup *setup = patch(&ground, MU, 0.98 * MU);
        drape_options options = drape_options_default();
        options.tolerance = 1e-300;
        options.max_iterations = iterations[late];
        struct run run = run_new(&setup->desc, &options);
        tell("for long", setup, &run);
        where[late] = mean_u(setup, run.x);
        run_done(&run);
        setup_free(setup);
    }
    print_message("  crept by %.3g m in 10 000 iterations\n", where[1] - where[0]);
    assert_near(where[0], where[1], 1e-6, 1);
}

/* A coefficient of 10 on one half of the cloth, 0.1 on the other: the mean of both holds. */
static void test_friction__a_fabric_may_have_its_own(void **state)
{
    (void)state;
    for (int own = 0; own < 2; own++) {
        drape_body ground;
        struct setup *setup = patch(&ground, own ? 0.01 : MU, 0.9 * MU);
        setup->material.friction = own ? MU : 0.01;
        drape_options options = drape_options_default();
        options.max_iterations = 300;
        struct run run = run_new(&setup->desc, &options);
        tell(own ? "the fabric's grip" : "a slippery fabric", setup, &run);
        if (own)
            assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        else
            assert_int_not_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        run_done(&run);
        setup_free(setup);
    }
}

static void test_friction__a_held_patch_is_certified(void **state)
{
    (void)state;
    drape_body ground;
    struct setup *setup = patch(&ground, MU, 0.9 * MU);
    drape_options options = drape_options_default();
    options.certify = true;
    struct run run = run_new(&setup->desc, &options);
    tell("certified", setup, &run);
    print_message("  %s, %.3g m to go\n", run.report->certificate.reason,
                  run.report->certificate.largest_move);
    assert_true(run.report->certificate.certified);
    assert_false(run.report->reference_rows); /* anchors have changed on the way */
    const drape_energies *first = &run.row[0].energy, *last = &run.row[run.rows - 1].energy;
    assert_true(run.row[0].residual_energy != first->potential - last->potential);
    run_done(&run);
    setup_free(setup);
}

/* Cloth on a sphere, which without friction slides off and with speed-dependent friction creeps for ever. */
static void test_friction__cloth_comes_to_rest_on_a_sphere(void **state)
{
    (void)state;
    struct setup *setup =
        setup_new(grid_new(GRID_ALTERNATING, 24, 24, 0.4, 0.4, 0), isotropic(0.2, 400, 1e-4));
    const drape_body ball = {.kind = DRAPE_BODY_SPHERE,
                             .offset = 0.003,
                             .friction = MU,
                             .point = {0.2, -0.1525, -0.2},
                             .radius = 0.15};
    setup->desc.body = &ball;
    setup->desc.bodies = 1;
    drape_options options = drape_options_default();
    options.certify = true;
    struct run run = run_new(&setup->desc, &options);
    tell("sphere", setup, &run);
    print_message("  certified %d after %u factorisations: %s\n", run.report->certificate.certified,
                  run.report->certificate.factorizations, run.report->certificate.reason);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(run.report->penetrations, 0);
    run_done(&run);
    setup_free(setup);
}

/* The undamped swing throws it up, with other anchors every few states. */
static void test_friction__what_is_returned_is_not_worse_than_the_start(void **state)
{
    (void)state;
    struct setup *setup = setup_new(grid_new(GRID_DELAUNAY, 8, 8, 0.4, 0.4, 0), isotropic(0.1, 50, 1e-5));
    const drape_body ball = {.kind = DRAPE_BODY_SPHERE,
                             .offset = 0.003,
                             .friction = 10,
                             .point = {0.2, -0.12, -0.2},
                             .radius = 0.1};
    setup->desc.body = &ball;
    setup->desc.bodies = 1;
    drape_options options = drape_options_default();
    options.method = DRAPE_METHOD_DYNAMIC;
    options.integrator = DRAPE_IMPLICIT_MIDPOINT;
    options.max_iterations = 300;
    struct run run = run_new(&setup->desc, &options);
    tell("thrown", setup, &run);
    print_message("  %.3g J above the start\n",
                  run.report->state.energy.potential - run.row[0].energy.potential);
    assert_int_not_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_true(run.report->state.energy.potential <= run.row[0].energy.potential);
    run_done(&run);
    setup_free(setup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_friction__a_patch_on_a_slope_is_held_below_the_angle_and_slides_above),
        cmocka_unit_test(test_friction__what_is_held_does_not_creep),
        cmocka_unit_test(test_friction__a_fabric_may_have_its_own),
        cmocka_unit_test(test_friction__a_held_patch_is_certified),
        cmocka_unit_test(test_friction__cloth_comes_to_rest_on_a_sphere),
        cmocka_unit_test(test_friction__what_is_returned_is_not_worse_than_the_start),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
