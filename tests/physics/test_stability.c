/* test_stability.c - absurd scenes: whatever comes in, what goes out is finite and never worse than the
 * start. */
#include "run.h"

#define CELLS 8

/* One scene of 8 x 8 cells, hung by one edge; each test bends one thing out of shape. */
static struct setup *plain_scene(void)
{
    struct setup *setup =
        setup_new(grid_new(GRID_DELAUNAY, CELLS, CELLS, 0.4, 0.4, 0), isotropic(0.1, 50, 1e-5));
    pin_columns(setup, 1);
    return setup;
}

static drape_options few_iterations(void)
{
    drape_options options = drape_options_default();
    options.max_iterations = 60;
    options.time_limit = 20;
    return options;
}

/* Runs twice; takes the setup over. */
static void check_survives(struct setup *setup, const drape_options *options, const char *what)
{
    size_t count = 3 * setup->grid.vertices;
    struct run run = run_new(&setup->desc, options), again = run_new(&setup->desc, options);
    const drape_row *end = &run.report->state;
    print_message("  %-34s %-12s %3u iterations, E %.4g -> %.4g J, residual force %.2g\n", what,
                  drape_verdict_name(run.report->verdict), run.report->iterations,
                  run.row[0].energy.potential, end->energy.potential, end->residual_force);
    for (size_t i = 0; i < count; i++)
        assert_true(isfinite(run.x[i]));
    for (size_t i = 0; i < run.rows; i++) {
        assert_true(isfinite(run.row[i].energy.potential) && isfinite(run.row[i].energy.kinetic));
        assert_true(isfinite(run.row[i].residual_energy) && isfinite(run.row[i].residual_force));
    }
    assert_true(end->energy.potential <= run.row[0].energy.potential);
    assert_true(run.report->reason && *run.report->reason);
    assert_int_equal(run.rows, again.rows);
    assert_memory_equal(run.x, again.x, count * sizeof *run.x);
    run_done(&run);
    run_done(&again);
    setup_free(setup);
}

static void test_stability__any_ratio_of_membrane_to_bending(void **state)
{
    (void)state;
    drape_options options = few_iterations();
    for (double ratio = 1e3; ratio < 2e10; ratio *= 10) {
        char what[64];
        struct setup *setup = plain_scene();
        setup->material = isotropic(0.1, 1000, 1000 * 0.16 / ratio); /* k L^2 / B */
        snprintf(what, sizeof what, "k L^2/B = %.0e", ratio);
        check_survives(setup, &options, what);
    }
    struct setup *setup = plain_scene();
    setup->material = isotropic(0.1, 1000, 0);
    check_survives(setup, &options, "no bending");
}

static void test_stability__any_density(void **state)
{
    (void)state;
    drape_options options = few_iterations();
    for (double density = 1e-4; density < 200; density *= 100) {
        char what[64];
        struct setup *setup = plain_scene();
        setup->material.density = density;
        snprintf(what, sizeof what, "%g kg/m^2", density);
        check_survives(setup, &options, what);
    }
}

static void test_stability__any_time_step(void **state)
{
    (void)state;
    for (drape_method method = DRAPE_METHOD_STOP_AND_GO; method <= DRAPE_METHOD_DYNAMIC; method++)
        for (double step = 1e-4; step < 2e3; step *= 100) {
            char what[64];
            drape_options options = few_iterations();
            options.method = method;
            options.time_step = step;
            snprintf(what, sizeof what, "%s, step %g s",
                     method == DRAPE_METHOD_DYNAMIC ? "dynamic" : "stop-and-go", step);
            check_survives(plain_scene(), &options, what);
        }
}

static void test_stability__slivers_of_1_to_1000(void **state)
{
    (void)state;
    drape_options options = few_iterations();
    for (size_t k = 0; k < 2; k++) {
        struct setup *setup = plain_scene();
        for (size_t i = 0; i < setup->grid.vertices; i++) {
            setup->grid.uv[2 * i + k] *= 1e-3;
            setup->x[3 * i + (k == 0 ? 0 : 2)] *= 1e-3;
        }
        check_survives(setup, &options,
                       k == 0 ? "a thousand times too short" : "a thousand times too narrow");
    }
}

/* Starting positions: x -> scale * x per axis; pins stay where they start. */
static void check_scaled(double x, double y, double z, const char *what)
{
    drape_options options = few_iterations();
    struct setup *setup = plain_scene();
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        setup->x[3 * i] *= x;
        setup->x[3 * i + 1] *= y;
        setup->x[3 * i + 2] *= z;
    }
    check_survives(setup, &options, what);
}

static void test_stability__any_start(void **state)
{
    (void)state;
    check_scaled(10, 10, 10, "stretched 10 times");
    check_scaled(0.1, 0.1, 0.1, "compressed 10 times");
    check_scaled(1, 1, 0, "all vertices on a line");
    check_scaled(0, 0, 0, "all vertices in one point");
    check_scaled(-1, 1, 1, "mirrored");

    drape_options options = few_iterations();
    struct setup *setup = plain_scene();
    uint64_t seed = 4;
    for (size_t i = 0; i < 3 * setup->grid.vertices; i++)
        setup->x[i] = test_random(&seed);
    check_survives(setup, &options, "random vertices");

    setup = plain_scene();
    for (size_t i = 0; i < setup->grid.vertices; i++)
        setup->x[3 * i] = fmin(setup->x[3 * i], 0.4 - setup->x[3 * i]);
    check_survives(setup, &options, "folded by half a turn");

    setup = plain_scene();
    for (size_t i = 0; i < setup->grid.vertices; i++) { /* exactly flat and hanging upwards: a saddle */
        setup->x[3 * i + 1] = setup->x[3 * i];
        setup->x[3 * i] = 0;
    }
    check_survives(setup, &options, "standing on its edge, exactly flat");

    setup = plain_scene();
    for (size_t i = 0; i < 3 * setup->grid.vertices; i++)
        setup->x[i] *= 1 + 1e-310; /* changes nothing but puts denormals in the zeros */
    setup->x[1] = 1e-310;
    check_survives(setup, &options, "denormals");
}

static void test_stability__start_inside_a_body(void **state)
{
    (void)state;
    drape_options options = few_iterations();
    const drape_body sphere = {
        .kind = DRAPE_BODY_SPHERE, .offset = 0.003, .radius = 0.1, .point = {0.3, 0, -0.2}};
    struct setup *setup = plain_scene();
    setup->desc.body = &sphere;
    setup->desc.bodies = 1;
    check_survives(setup, &options, "a sphere in the middle of it");
}

static void test_stability__numbers_that_are_none_are_refused_by_name(void **state)
{
    (void)state;
    const double bad[] = {NAN, INFINITY, -INFINITY};
    for (size_t i = 0; i < 3; i++) {
        drape_error error = {0};
        drape_scene *scene = NULL;
        struct setup *setup = plain_scene();
        setup->x[3 * 7 + 1] = bad[i];
        assert_int_equal(drape_scene_new(&setup->desc, &scene, &error), DRAPE_EINVAL);
        assert_int_equal(error.place, DRAPE_AT_VERTEX);
        assert_int_equal(error.element, 7);
        setup->x[3 * 7 + 1] = 0;
        setup->grid.uv[2 * 5] = bad[i];
        assert_int_equal(drape_scene_new(&setup->desc, &scene, &error), DRAPE_EINVAL);
        assert_int_equal(error.place, DRAPE_AT_PATTERN);
        assert_int_equal(error.element, 5);
        setup->grid.uv[2 * 5] = 0;
        setup->material.bend_twist = bad[i];
        assert_int_equal(drape_scene_new(&setup->desc, &scene, &error), DRAPE_EINVAL);
        assert_int_equal(error.place, DRAPE_AT_MATERIAL);
        assert_string_equal(error.member, "bend_twist");
        assert_null(scene);
        setup_free(setup);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_stability__any_ratio_of_membrane_to_bending),
        cmocka_unit_test(test_stability__any_density),
        cmocka_unit_test(test_stability__any_time_step),
        cmocka_unit_test(test_stability__slivers_of_1_to_1000),
        cmocka_unit_test(test_stability__any_start),
        cmocka_unit_test(test_stability__start_inside_a_body),
        cmocka_unit_test(test_stability__numbers_that_are_none_are_refused_by_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
