/* test_buckling.c - a strip on edge, or standing, falls over at the exact load: bending and twist together.
 */
#include "run.h"

#define GRAVITY 9.81
#define LENGTH  0.1 /* m, beyond the clamp */
#define DENSITY 0.2 /* kg/m^2 */

/* Critical Gamma = density g L^3 / B: Greenhill's standing column (first zero of the Bessel function
 * J_-1/3), and lateral buckling of a strip held on edge by one end, width L/5, Poisson ratio 0. */
#define COLUMN  7.837
#define ON_EDGE 20.64

enum pose { STANDING, EDGEWISE };

/* Starts the strip bent sideways by 5 % of its length and returns how far its tip is off in the end. */
static double tip_offset(enum pose pose, enum grid_kind kind, double gamma)
{
    size_t cells = pose == STANDING ? 40 : 50, across = pose == STANDING ? 6 : 10;
    double h = LENGTH / (double)cells;
    drape_material material = isotropic(DENSITY, 1000, DENSITY * GRAVITY * LENGTH * LENGTH * LENGTH / gamma);
    struct setup *setup =
        setup_new(grid_new(kind, cells + 1, across, LENGTH + h, h * (double)across, 2), material);
    pin_columns(setup, 2);
    size_t along = pose == STANDING ? 1 : 0, aside = pose == STANDING ? 0 : 2,
           wide = pose == STANDING ? 2 : 1;
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        double s = setup->grid.uv[2 * i] - h, bent = s > 0 ? s / LENGTH : 0;
        setup->x[3 * i + along] = s;
        setup->x[3 * i + aside] = 0.05 * LENGTH * bent * bent;
        setup->x[3 * i + wide] = setup->grid.uv[2 * i + 1];
    }
    drape_options options = drape_options_default();
    options.method = DRAPE_METHOD_STOP_AND_GO;
    options.time_step = 1; /* s: nearly neutral states move slowly */
    options.tolerance = 1e-5;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    double offset = run.x[3 * (size_t)grid_at(&setup->grid, cells + 1, across / 2) + aside] / LENGTH;
    run_done(&run);
    setup_free(setup);
    return fabs(offset);
}

/* `margin`: relative distance from the critical load at which the strip must stand, and must fall. */
static void check_buckling(enum pose pose, double critical, double margin)
{
    const enum grid_kind kind[] = {GRID_ONE, GRID_ALTERNATING, GRID_DELAUNAY};
    for (size_t i = 0; i < sizeof kind / sizeof *kind; i++) {
        double below = tip_offset(pose, kind[i], critical * (1 - margin));
        double above = tip_offset(pose, kind[i], critical * (1 + margin));
        print_message("  %-16s tip off by %.5f L at %.0f %% of the load, %.3f L at %.0f %%\n",
                      grid_name[kind[i]], below, 100 * (1 - margin), above, 100 * (1 + margin));
        assert_true(below < 1e-3);
        assert_true(above > 0.1);
    }
}

static void test_buckling__a_column_falls_over_at_greenhills_load(void **state)
{
    (void)state;
    check_buckling(STANDING, COLUMN, 0.03);
}

static void test_buckling__a_strip_on_edge_tips_over_at_the_exact_load(void **state)
{
    (void)state;
    check_buckling(EDGEWISE, ON_EDGE, 0.05);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_buckling__a_column_falls_over_at_greenhills_load),
        cmocka_unit_test(test_buckling__a_strip_on_edge_tips_over_at_the_exact_load),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
