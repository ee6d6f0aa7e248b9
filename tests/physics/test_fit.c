/* test_fit.c - strain, stress, pressure and gap of drapes whose fit is known in closed form. */
#include "run.h"

#define GRAVITY 9.81

static const drape_fit *fit_of(const struct setup *setup, const struct run *run)
{
    const drape_fit *fit = drape_sim_fit(run->sim);
    assert_non_null(fit);
    assert_int_equal(fit->vertices, setup->grid.vertices);
    assert_int_equal(fit->triangles, setup->grid.triangles);
    return fit;
}

static drape_options the_start(void)
{
    drape_options options = drape_options_default();
    options.max_iterations = 0;
    options.fit = true;
    return options;
}

/* ---- the cloth ---- */

/* x = a u + b v: the same gradient everywhere. Something must be held. */
static void lay_evenly(struct setup *setup, const double a[3], const double b[3])
{
    setup->desc.pins = 1;
    for (size_t i = 0; i < setup->grid.vertices; i++)
        for (size_t d = 0; d < 3; d++)
            setup->x[3 * i + d] = a[d] * setup->grid.uv[2 * i] + b[d] * setup->grid.uv[2 * i + 1];
}

static void test_fit__an_even_stretch_gives_its_strain_and_stress(void **state)
{
    (void)state;
    struct setup *setup = setup_new(grid_new(GRID_DELAUNAY, 12, 9, 0.6, 0.4, 0), isotropic(0.1, 100, 0));
    setup->material.stretch_warp = 400;
    setup->material.stretch_shear = 30;
    setup->material.poisson = 0.3;
    const double a[3] = {0.9, 0.5, 0.1}, b[3] = {-0.2, 0.3, 0.8};
    lay_evenly(setup, a, b);
    drape_options options = the_start();
    struct run run = run_new(&setup->desc, &options);
    const drape_fit *fit = fit_of(setup, &run);
    const double e[3] = {(0.81 + 0.25 + 0.01 - 1) / 2, (0.04 + 0.09 + 0.64 - 1) / 2, -0.18 + 0.15 + 0.08};
    const double s[3] = {(100 * e[0] + 0.3 * 200 * e[1]) / 0.91, (400 * e[1] + 0.3 * 200 * e[0]) / 0.91,
                         30 * e[2]};
    for (size_t i = 0; i < 3 * fit->triangles; i++) {
        assert_near(fit->strain[i], e[i % 3], 1e-12, 1);
        assert_near(fit->stress[i], s[i % 3], 1e-12, 100);
    }
    assert_null(fit->utilization);
    for (size_t i = 0; i < fit->vertices; i++) {
        assert_true(fit->pressure[i] == 0);
        assert_true(isnan(fit->gap[i])); /* there is no body */
    }
    run_done(&run);
    setup_free(setup);
}

/* Weft stretched by 6 % on a curve that ends at 8 %, warp pressed together on one, shear without a curve. */
static void test_fit__curves_give_the_stress_and_the_share_of_the_limit(void **state)
{
    (void)state;
    static const double weft[] = {0, 0, 0.02, 1, 0.06, 9, 0.08, 30}, warp[] = {0.1, 50};
    struct setup *setup = setup_new(grid_new(GRID_ONE, 4, 4, 0.2, 0.2, 0), isotropic(0.1, 100, 0));
    setup->material.curve_weft = (drape_curve){4, weft};
    setup->material.curve_warp = (drape_curve){1, warp};
    const double a[3] = {1.06, 0, 0}, b[3] = {0, 0, 0.99};
    lay_evenly(setup, a, b);
    drape_options options = the_start();
    struct run run = run_new(&setup->desc, &options);
    const drape_fit *fit = fit_of(setup, &run);
    assert_non_null(fit->utilization);
    for (size_t t = 0; t < fit->triangles; t++) {
        assert_close(fit->stress[3 * t], 9 / 1.06, 1e-12); /* S l is the force on the tester */
        assert_close(fit->utilization[3 * t], 0.06 / 0.08, 1e-12);
        assert_true(fit->strain[3 * t + 1] < 0 && fit->stress[3 * t + 1] < 0);
        assert_true(fit->utilization[3 * t + 1] == 0);
        assert_true(isnan(fit->utilization[3 * t + 2]));
    }
    run_done(&run);
    setup_free(setup);
}

static void test_fit__shear_has_a_limit_of_its_own(void **state)
{
    (void)state;
    static const double shear[] = {0.2, 5};
    struct setup *setup = setup_new(grid_new(GRID_ONE, 2, 2, 0.2, 0.2, 0), isotropic(0.1, 100, 0));
    setup->material.curve_shear = (drape_curve){1, shear};
    const double a[3] = {1, 0, 0}, b[3] = {-0.05, 0, sqrt(1 - 0.0025)};
    lay_evenly(setup, a, b);
    drape_options options = the_start();
    struct run run = run_new(&setup->desc, &options);
    const drape_fit *fit = fit_of(setup, &run);
    for (size_t t = 0; t < fit->triangles; t++) {
        assert_true(isnan(fit->utilization[3 * t]) && isnan(fit->utilization[3 * t + 1]));
        assert_close(fit->utilization[3 * t + 2], 0.25, 1e-12);
        assert_close(fit->stress[3 * t + 2], -0.05 * 5 / 0.2, 1e-12);
    }
    run_done(&run);
    setup_free(setup);
}

/* A strip of a tenth of a metre hung along one yarn: each row carries the nodes below it. */
static void check_hanging(bool along_warp)
{
    enum { ROWS = 40, ACROSS = 8 };
    const double length = 0.5, density = 0.1;
    struct setup *setup =
        setup_new(grid_new(GRID_ONE, ROWS, ACROSS, length, 0.1, 0), isotropic(density, 20, 0));
    pin_columns(setup, 1);
    if (along_warp)
        for (size_t i = 0; i < setup->grid.vertices; i++) { /* the flat shape is turned, the start is not */
            double *uv = setup->grid.uv + 2 * i, u = uv[0];
            uv[0] = -uv[1];
            uv[1] = u;
        }
    drape_options options = drape_options_default();
    options.tolerance = 1e-6;
    options.fit = true;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    const drape_fit *fit = fit_of(setup, &run);
    double force[ROWS] = {0}, worst = 0;
    for (size_t t = 0; t < fit->triangles; t++) {
        double depth = 0;
        for (size_t k = 0; k < 3; k++)
            depth += setup->grid.uv[2 * (size_t)setup->grid.triangle[3 * t + k] + along_warp] / 3;
        size_t yarn = 3 * t + along_warp;
        force[(size_t)(depth / length * ROWS)] +=
            fit->stress[yarn] * sqrt(1 + 2 * fit->strain[yarn]) / (2 * ACROSS);
    }
    for (int row = 0; row < ROWS; row++) {
        double weight = density * GRAVITY * length * (ROWS - row - 0.5) / ROWS;
        worst = fmax(worst, fabs(force[row] / weight - 1));
        assert_close(force[row], weight, 1e-3);
    }
    print_message("  along the %s: N/m at the top %.6f, S l there %.6f; off by %.1e at most\n",
                  along_warp ? "warp" : "weft", density * GRAVITY * length * (ROWS - 0.5) / ROWS, force[0],
                  worst);
    run_done(&run);
    setup_free(setup);
}

static void test_fit__each_row_of_a_hanging_strip_carries_what_is_below_it(void **state)
{
    (void)state;
    check_hanging(false);
    check_hanging(true);
}

/* ---- bodies ---- */

static const drape_body ground = {
    .kind = DRAPE_BODY_PLANE, .offset = 0.003, .point = {0, 0, 0}, .axis = {0, 1, 0}};

/* A patch of 0.1 m and 0.2 kg/m^2 that lies on the ground. */
static struct setup *patch(enum grid_kind kind)
{
    struct setup *setup = setup_new(grid_new(kind, 12, 12, 0.1, 0.1, 0), isotropic(0.2, 400, 1e-4));
    for (size_t i = 0; i < setup->grid.vertices; i++)
        setup->x[3 * i + 1] = 0.0029;
    setup->desc.body = &ground;
    setup->desc.bodies = 1;
    return setup;
}

static double area_at(const struct grid *grid, size_t vertex)
{
    double area = 0;
    for (size_t t = 0; t < grid->triangles; t++) {
        const uint32_t *corner = grid->triangle + 3 * t;
        if (corner[0] == vertex || corner[1] == vertex || corner[2] == vertex)
            area += grid_area2(grid, corner[0], corner[1], corner[2]) / 6;
    }
    return area;
}

static void test_fit__pressure_carries_the_weight_and_the_gap_is_the_height(void **state)
{
    (void)state;
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = patch(kind);
        drape_options options = drape_options_default();
        options.tolerance = 1e-5;
        options.fit = true;
        struct run run = run_new(&setup->desc, &options);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        const drape_fit *fit = fit_of(setup, &run);
        double force = 0, least = INFINITY, most = 0;
        for (size_t i = 0; i < fit->vertices; i++) {
            force += fit->pressure[i] * area_at(&setup->grid, i);
            least = fmin(least, fit->pressure[i]);
            most = fmax(most, fit->pressure[i]);
            assert_near(fit->gap[i], run.x[3 * i + 1], 1e-12, 1);
            assert_true(fit->gap[i] < 0.003);
        }
        print_message("  %-16s pressure %.4f to %.4f Pa, mean %.6f (the weight: %.6f)\n", grid_name[kind],
                      least, most, force / 0.01, 0.2 * GRAVITY);
        assert_close(force, 0.2 * GRAVITY * 0.01, 1e-3);
        assert_true(least > 0);
        run_done(&run);
        setup_free(setup);
    }
}

/* The contact's force on a sample is its penalty's slope: of 1 mm depth in an offset of 3 mm, w = 1.5 mm,
 * kappa s^2/(2w). Gaps are of the nearer of two bodies, negative inside, and end where bodies do. */
static void test_fit__pressure_and_gap_of_a_flat_start(void **state)
{
    (void)state;
    static const struct {
        double height, pressure, gap;
    } cases[] = {{0.0021, 1e7 * 0.9e-3 * 0.9e-3 / 3e-3, 0.0021},
                 {0.0031, 0, 0.0031},
                 {0.0299, 0, 0.0299},
                 {0.0301, 0, NAN},
                 {-0.001, 1e7 * (0.75e-3 + 2.5e-3), -0.001}};
    const drape_body below = {
        .kind = DRAPE_BODY_PLANE, .offset = 0.003, .point = {0, -0.02, 0}, .axis = {0, 1, 0}};
    const drape_body three[3] = {below, ground, below}; /* the nearer one last, then first */
    for (size_t c = 0; c < 2 * (sizeof cases / sizeof *cases); c++) {
        const double height = cases[c / 2].height, pressure = cases[c / 2].pressure, gap = cases[c / 2].gap;
        struct setup *setup = patch(GRID_ONE);
        setup->desc.body = three + c % 2;
        setup->desc.bodies = 2;
        for (size_t i = 0; i < setup->grid.vertices; i++)
            setup->x[3 * i + 1] = height;
        drape_options options = the_start();
        struct run run = run_new(&setup->desc, &options);
        const drape_fit *fit = fit_of(setup, &run);
        for (size_t i = 0; i < fit->vertices; i++) {
            assert_near(fit->pressure[i], pressure, 1e-9, 1);
            if (isnan(gap))
                assert_true(isnan(fit->gap[i]));
            else
                assert_near(fit->gap[i], gap, 1e-12, 1);
        }
        run_done(&run);
        setup_free(setup);
    }
}

/* The last two columns are sewn to each other; a vertex of no triangle comes last. */
static void test_fit__sewn_vertices_share_it_and_a_loose_one_has_none(void **state)
{
    (void)state;
    const double x[] = {0, 0.002, 0,      0.01, 0.002, 0,     0,     0.002, -0.01, 0.01, 0.002,
                        0, 0.02,  0.0025, 0,    0,     0.002, -0.01, 0,     0,     0};
    const double uv[] = {0, 0, 0.01, 0, 0, 0.01, 0.01, 0, 0.02, 0, 0, 0.01, 1, 1};
    const uint32_t triangle[] = {0, 1, 2, 3, 4, 5}, seam[] = {1, 3, 2, 5};
    const drape_material material = isotropic(0.2, 400, 0);
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = 7;
    desc.triangles = 2;
    desc.positions = x;
    desc.pattern = uv;
    desc.triangle = triangle;
    desc.seam = seam;
    desc.seams = 2;
    desc.material = &material;
    desc.materials = 1;
    desc.body = &ground;
    desc.bodies = 1;
    drape_options options = the_start();
    struct run run = run_new(&desc, &options);
    const drape_fit *fit = drape_sim_fit(run.sim);
    assert_int_equal(fit->vertices, 7);
    assert_true(fit->pressure[1] > 0 && fit->pressure[1] == fit->pressure[3]);
    assert_true(fit->pressure[2] > 0 && fit->pressure[2] == fit->pressure[5]);
    assert_true(fit->gap[1] == fit->gap[3] && fit->gap[2] == fit->gap[5]);
    assert_true(fit->pressure[6] == 0 && isnan(fit->gap[6]));
    run_done(&run);
}

static void test_fit__not_asked_for_there_is_none_and_nothing_else_changes(void **state)
{
    (void)state;
    struct setup *setup = patch(GRID_ALTERNATING);
    drape_options options = drape_options_default();
    struct run without = run_new(&setup->desc, &options);
    options.fit = true;
    struct run with = run_new(&setup->desc, &options);
    assert_null(drape_sim_fit(without.sim));
    assert_int_equal(with.rows, without.rows);
    assert_memory_equal(with.x, without.x, 3 * setup->grid.vertices * sizeof *with.x);
    run_done(&with);
    run_done(&without);
    setup_free(setup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fit__an_even_stretch_gives_its_strain_and_stress),
        cmocka_unit_test(test_fit__curves_give_the_stress_and_the_share_of_the_limit),
        cmocka_unit_test(test_fit__shear_has_a_limit_of_its_own),
        cmocka_unit_test(test_fit__each_row_of_a_hanging_strip_carries_what_is_below_it),
        cmocka_unit_test(test_fit__pressure_carries_the_weight_and_the_gap_is_the_height),
        cmocka_unit_test(test_fit__pressure_and_gap_of_a_flat_start),
        cmocka_unit_test(test_fit__sewn_vertices_share_it_and_a_loose_one_has_none),
        cmocka_unit_test(test_fit__not_asked_for_there_is_none_and_nothing_else_changes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
