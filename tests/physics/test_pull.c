/* test_pull.c - what a tensile tester reads from cloth with strain-stress curves, through the public
 * interface. */
#include "run.h"

/* Crimp first, then the yarns; and a cloth that softens. Strain, N/m. */
enum { POINTS = 5 };
static const double WEFT[2 * POINTS] = {0.01, 4, 0.03, 22, 0.06, 90, 0.1, 260, 0.15, 600};
static const double WARP[2 * POINTS] = {0.02, 40, 0.05, 70, 0.1, 90, 0.2, 100, 0.3, 105};
static const double SHEAR[] = {0.1, 2, 0.3, 12};

static drape_material cloth(void)
{
    drape_material material = isotropic(0.2, 1, 0);
    material.curve_weft = (drape_curve){POINTS, WEFT};
    material.curve_warp = (drape_curve){POINTS, WARP};
    material.curve_shear = (drape_curve){2, SHEAR};
    return material;
}

/* Stretch energy (J) of a grid pulled evenly to 1 + weft by 1 + warp. */
static double energy_at(struct setup *setup, double weft, double warp)
{
    drape_options options = drape_options_default();
    options.max_iterations = 0;
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        setup->x[3 * i] = (1 + weft) * setup->grid.uv[2 * i];
        setup->x[3 * i + 2] = -(1 + warp) * setup->grid.uv[2 * i + 1];
    }
    struct run run = run_new(&setup->desc, &options);
    double energy = run.report->state.energy.stretch;
    run_done(&run);
    return energy;
}

static void test_pull__work_over_elongation_is_the_curve_on_every_mesh(void **state)
{
    (void)state;
    const double width = 0.2, length = 0.3, h = 1e-6;
    double worst = 0;
    for (int kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new((enum grid_kind)kind, 6, 9, width, length, 3), cloth());
        pin_columns(setup, 1);
        for (int i = 0; i < 2 * POINTS; i++) {
            const double *point = i < POINTS ? WEFT + 2 * i : WARP + 2 * (i - POINTS);
            double weft = i < POINTS ? point[0] : 0, warp = i < POINTS ? 0 : point[0];
            double up = energy_at(setup, weft + (weft > 0 ? h : 0), warp + (warp > 0 ? h : 0));
            double down = energy_at(setup, weft - (weft > 0 ? h : 0), warp - (warp > 0 ? h : 0));
            double read = (up - down) / (2 * h * width * length); /* N per metre of width */
            worst = fmax(worst, fabs(read / point[1] - 1));
            assert_close(read, point[1], 1e-6);
        }
        setup_free(setup);
    }
    print_message("  largest relative error of a reading %.1e\n", worst);
}

/* A triangle held by its side of length b and hanging by its height h carries a third of its weight at
 * the apex: P b/2 = density g (b h/2)/3. The density is chosen so that P is a point of the curve. */
static double hang(double stress, bool weft)
{
    const double flat[] = {0, 0, 0.2, 0, 0.1, 0.3}, across[] = {0, 0.2, 0, 0, 0.3, 0.1};
    const double start[] = {0, 1, 0, 0.2, 1, 0, 0.1, 0.7, 0};
    const uint32_t triangle[] = {0, 1, 2}, pin[] = {0, 1};
    drape_material material = cloth();
    material.density = 3 * stress / (9.81 * 0.3);
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = 3;
    desc.triangles = 1;
    desc.positions = start;
    desc.pattern = weft ? across : flat;
    desc.triangle = triangle;
    desc.pin = pin;
    desc.pins = 2;
    desc.material = &material;
    desc.materials = 1;
    drape_options options = drape_options_default();
    options.tolerance = 1e-9;
    struct run run = run_new(&desc, &options);
    if (run.report->verdict != DRAPE_VERDICT_AT_REST)
        fail_msg("%s: %s", drape_verdict_name(run.report->verdict), run.report->reason);
    double strain = (1 - run.x[7]) / 0.3 - 1;
    run_done(&run);
    return strain;
}

static void test_pull__a_hung_weight_stretches_cloth_to_its_curve(void **state)
{
    (void)state;
    double worst = 0;
    for (int i = 0; i < POINTS; i++) {
        double weft = hang(WEFT[2 * i + 1], true), warp = hang(WARP[2 * i + 1], false);
        worst = fmax(worst, fmax(fabs(weft - WEFT[2 * i]), fabs(warp - WARP[2 * i])));
        assert_near(weft, WEFT[2 * i], 1e-6, 0);
        assert_near(warp, WARP[2 * i], 1e-6, 0);
    }
    print_message("  largest error of a strain %.1e\n", worst);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pull__work_over_elongation_is_the_curve_on_every_mesh),
        cmocka_unit_test(test_pull__a_hung_weight_stretches_cloth_to_its_curve),
    };
    return cmocka_run_group_tests_name("pull", tests, NULL, NULL);
}
