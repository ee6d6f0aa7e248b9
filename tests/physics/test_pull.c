/* test_pull.c - what a tensile tester reads from cloth with strain-stress curves, through the public
 * interface. */
#include "run.h"

#define DEMAND 1e-6

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
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 6, 9, width, length, 0), cloth());
        double worst = 0;
        pin_columns(setup, 1);
        for (int i = 0; i < 2 * POINTS; i++) {
            const double *point = i < POINTS ? WEFT + 2 * i : WARP + 2 * (i - POINTS);
            double weft = i < POINTS ? point[0] : 0, warp = i < POINTS ? 0 : point[0];
            double up = energy_at(setup, weft + (weft > 0 ? h : 0), warp + (warp > 0 ? h : 0));
            double down = energy_at(setup, weft - (weft > 0 ? h : 0), warp - (warp > 0 ? h : 0));
            double read = (up - down) / (2 * h * width * length); /* N per metre of width */
            worst = fmax(worst, fabs(read / point[1] - 1));
            assert_close(read, point[1], DEMAND);
        }
        print_message("  %-16s largest relative error %.1e (demand %.0e)\n", grid_name[kind], worst, DEMAND);
        setup_free(setup);
    }
}

/* ---- the same, let come to rest ---- */

/* Energy at rest of a strip held by its two ends at a strain, after a disturbance of all that is free. */
static double energy_at_rest(struct setup *setup, size_t axis, double strain)
{
    const struct grid *grid = &setup->grid;
    uint64_t seed = 3;
    setup->desc.pins = 0;
    for (size_t j = 0; j <= grid->ny; j++)
        for (size_t i = 0; i <= grid->nx; i++) {
            uint32_t n = grid_at(grid, i, j);
            const double *uv = grid->uv + 2 * (size_t)n;
            double *x = setup->x + 3 * (size_t)n;
            bool end = axis == 0 ? i == 0 || i == grid->nx : j == 0 || j == grid->ny;
            x[0] = uv[0] * (axis == 0 ? 1 + strain : 1);
            x[1] = 0;
            x[2] = -uv[1] * (axis == 1 ? 1 + strain : 1);
            for (int d = 0; d < 3; d++)
                x[d] += end ? 0 : 0.0003 * test_random(&seed); /* m: a hundredth of a cell */
            if (end)
                setup->pin[setup->desc.pins++] = n;
        }
    drape_options options = drape_options_default();
    options.tolerance = 1e-7;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    double energy = run.report->state.energy.stretch;
    run_done(&run);
    return energy;
}

static void test_pull__a_strip_between_two_jaws_follows_the_curves_on_every_mesh(void **state)
{
    (void)state;
    const double width = 0.2, length = 0.3, h = 1e-6;
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 6, 9, width, length, 0), cloth());
        double worst[2] = {0};
        memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
        for (int i = 0; i < 2 * POINTS; i++) {
            size_t axis = i / POINTS;
            const double *point = axis == 0 ? WEFT + 2 * i : WARP + 2 * (i - POINTS);
            double up = energy_at_rest(setup, axis, point[0] + h);
            double down = energy_at_rest(setup, axis, point[0] - h);
            double read = (up - down) / (2 * h * width * length);
            worst[axis] = fmax(worst[axis], fabs(read / point[1] - 1));
            assert_close(read, point[1], DEMAND);
        }
        print_message("  %-16s largest relative error along the weft %.1e, the warp %.1e (demand %.0e)\n",
                      grid_name[kind], worst[0], worst[1], DEMAND);
        setup_free(setup);
    }
}

/* ---- shear ---- */

/* Stretch energy in a picture frame: threads keep their length and turn until 2 E_uv is the strain. */
static double energy_sheared(struct setup *setup, double strain)
{
    drape_options options = drape_options_default();
    options.max_iterations = 0;
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        double u = setup->grid.uv[2 * i], v = setup->grid.uv[2 * i + 1];
        setup->x[3 * i] = u + strain * v;
        setup->x[3 * i + 2] = -sqrt(1 - strain * strain) * v;
    }
    struct run run = run_new(&setup->desc, &options);
    double energy = run.report->state.energy.stretch;
    run_done(&run);
    return energy;
}

static void test_pull__a_picture_frame_reads_the_shear_curve_on_every_mesh(void **state)
{
    (void)state;
    const double width = 0.2, length = 0.3, h = 1e-6;
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 6, 9, width, length, 0), cloth());
        double worst = 0;
        pin_columns(setup, 1);
        for (int i = 0; i < 4; i++) {
            double sign = i % 2 ? -1 : 1, strain = sign * SHEAR[i / 2 * 2],
                   stress = sign * SHEAR[i / 2 * 2 + 1];
            double up = energy_sheared(setup, strain + h), down = energy_sheared(setup, strain - h);
            double read = (up - down) / (2 * h * width * length);
            worst = fmax(worst, fabs(read / stress - 1));
            assert_close(read, stress, DEMAND);
        }
        print_message("  %-16s largest relative error %.1e (demand %.0e)\n", grid_name[kind], worst, DEMAND);
        setup_free(setup);
    }
}

/* ---- a weight ---- */

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
        worst = fmax(worst, fmax(fabs(weft / WEFT[2 * i] - 1), fabs(warp / WARP[2 * i] - 1)));
        assert_near(weft, WEFT[2 * i], DEMAND, 0);
        assert_near(warp, WARP[2 * i], DEMAND, 0);
    }
    print_message("  largest relative error of a strain %.1e (demand %.0e)\n", worst, DEMAND);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pull__work_over_elongation_is_the_curve_on_every_mesh),
        cmocka_unit_test(test_pull__a_strip_between_two_jaws_follows_the_curves_on_every_mesh),
        cmocka_unit_test(test_pull__a_picture_frame_reads_the_shear_curve_on_every_mesh),
        cmocka_unit_test(test_pull__a_hung_weight_stretches_cloth_to_its_curve),
    };
    return cmocka_run_group_tests_name("pull", tests, NULL, NULL);
}
