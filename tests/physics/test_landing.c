/* test_landing.c - cloth dropped on static bodies: it rests on them, not in them, or says that it slid off.
 */
#include "run.h"

#define GRAVITY 9.81
#define OFFSET  0.003 /* m: where the body is felt */

/* A square sheet of 0.5 m at height y, its middle above the origin, over one body: stiff to bend, as a
 * denim is. (A limp one creeps around a frictionless sphere for thousands of iterations.) */
static struct setup *sheet_over(enum grid_kind kind, size_t cells, double y, const drape_body *body)
{
    struct setup *setup = setup_new(grid_new(kind, cells, cells, 0.5, 0.5, 0), isotropic(0.15, 50, 1e-4));
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        setup->x[3 * i] -= 0.25;
        setup->x[3 * i + 1] = y;
        setup->x[3 * i + 2] += 0.25;
    }
    setup->desc.body = body;
    setup->desc.bodies = 1;
    return setup;
}

static struct run land(const struct setup *setup, drape_stop_rule rule)
{
    drape_options options = drape_options_default();
    options.method = DRAPE_METHOD_STOP_AND_GO;
    options.stop_on = rule;
    options.tolerance = 1e-2;
    return run_new(&setup->desc, &options);
}

/* The sheet floats a little inside the offset, s = offset - height, where the contact pressure, a
 * parabola in s, carries its weight per area: density g. The energy of that parabola is density g s/3. */
static void test_landing__a_sheet_lies_flat_on_a_plane_at_the_offset(void **state)
{
    (void)state;
    const drape_body plane = {.kind = DRAPE_BODY_PLANE, .offset = OFFSET, .axis = {0, 2, 0}};
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = sheet_over(kind, 16, 0.05, &plane);
        struct run run = land(setup, kind % 2 ? DRAPE_STOP_ON_POTENTIAL : DRAPE_STOP_ON_KINETIC);
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < setup->grid.vertices; i++) {
            low = fmin(low, run.x[3 * i + 1]);
            high = fmax(high, run.x[3 * i + 1]);
        }
        double s = OFFSET - (low + high) / 2;
        print_message("  %-16s %u iterations, height %.4f to %.4f mm\n", grid_name[kind],
                      run.report->iterations, low * 1e3, high * 1e3);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_int_equal(run.report->penetrations, 0);
        assert_true(s > 0 && s < 1e-4);
        assert_true(high - low < 1e-6);
        assert_near(run.report->state.energy.contact, 0.25 * 0.15 * GRAVITY * s / 3, 0.05, 0);
        assert_close(run.report->state.energy.gravity, -0.25 * 0.15 * GRAVITY * (0.05 - OFFSET + s), 1e-4);
        run_done(&run);
        setup_free(setup);
    }
}

static double norm(const double x[3])
{
    return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
}

/* Distance of the nearest vertex or triangle middle from the origin. */
static double nearest(const struct grid *grid, const double *x)
{
    double least = INFINITY;
    for (size_t i = 0; i < grid->vertices; i++)
        least = fmin(least, norm(x + 3 * i));
    for (size_t t = 0; t < grid->triangles; t++) {
        double middle[3] = {0};
        for (size_t i = 3 * t; i < 3 * t + 3; i++)
            for (size_t k = 0; k < 3; k++)
                middle[k] += x[3 * (size_t)grid->triangle[i] + k] / 3;
        least = fmin(least, norm(middle));
    }
    return least;
}

/* Without friction a sheet slides off in the end; one stitch at the top keeps it. */
static void test_landing__a_sheet_drapes_over_a_sphere_without_entering_it(void **state)
{
    (void)state;
    const drape_body sphere = {.kind = DRAPE_BODY_SPHERE, .offset = OFFSET, .radius = 0.1};
    const enum grid_kind kind[] = {GRID_ONE, GRID_DELAUNAY};
    for (size_t i = 0; i < sizeof kind / sizeof *kind; i++)
        for (drape_stop_rule rule = DRAPE_STOP_ON_POTENTIAL; rule <= DRAPE_STOP_ON_KINETIC; rule++) {
            struct setup *setup = sheet_over(kind[i], 24, 0.1 + OFFSET, &sphere);
            setup->pin[setup->desc.pins++] = grid_at(&setup->grid, 12, 12);
            struct run run = land(setup, rule);
            double low = INFINITY, close = nearest(&setup->grid, run.x);
            for (size_t v = 0; v < setup->grid.vertices; v++)
                low = fmin(low, run.x[3 * v + 1]);
            print_message("  %-16s rule %d: %s after %u iterations, nearest %.3f mm from the sphere, corner "
                          "at %.3f m\n",
                          grid_name[kind[i]], rule, drape_verdict_name(run.report->verdict),
                          run.report->iterations, (close - 0.1) * 1e3, low);
            assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
            assert_int_equal(run.report->penetrations, 0);
            assert_true(close > 0.1 && close < 0.1 + OFFSET);
            assert_true(low < -0.1); /* it hangs down past the sphere */
            assert_true(run.report->state.energy.contact > 0);
            run_done(&run);
            setup_free(setup);
        }
}

static void test_landing__a_sheet_dropped_off_centre_says_that_it_slid_off(void **state)
{
    (void)state;
    const drape_body sphere = {
        .kind = DRAPE_BODY_SPHERE, .offset = OFFSET, .radius = 0.1, .point = {0.1, 0, 0}};
    struct setup *setup = sheet_over(GRID_DELAUNAY, 16, 0.11, &sphere);
    struct run run = land(setup, DRAPE_STOP_ON_POTENTIAL);
    print_message("  %s after %u iterations: %s\n", drape_verdict_name(run.report->verdict),
                  run.report->iterations, run.report->reason);
    assert_int_equal(run.status, DRAPE_NOT_AT_REST);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_SLID_OFF);
    run_done(&run);
    setup_free(setup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_landing__a_sheet_lies_flat_on_a_plane_at_the_offset),
        cmocka_unit_test(test_landing__a_sheet_drapes_over_a_sphere_without_entering_it),
        cmocka_unit_test(test_landing__a_sheet_dropped_off_centre_says_that_it_slid_off),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
