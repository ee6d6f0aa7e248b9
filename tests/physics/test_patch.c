/* test_patch.c - uniform states: exact energies, no force inside, and one triangle on its own. */
#include "run.h"

static const drape_material CLOTH = {.density = 0.15,
                                     .stretch_weft = 300,
                                     .stretch_warp = 800,
                                     .stretch_shear = 50,
                                     .poisson = 0.2,
                                     .bend_weft = 2e-5,
                                     .bend_warp = 5e-5,
                                     .bend_twist = 1e-5};

static drape_options evaluate_only(void)
{
    drape_options options = drape_options_default();
    options.max_iterations = 0;
    return options;
}

static void pin_border(struct setup *setup)
{
    const struct grid *grid = &setup->grid;
    for (size_t j = 0; j <= grid->ny; j++)
        for (size_t i = 0; i <= grid->nx; i++)
            if (i == 0 || j == 0 || i == grid->nx || j == grid->ny)
                setup->pin[setup->desc.pins++] = grid_at(grid, i, j);
}

/* x = F (u, v), F: 3 x 2. */
static void deform(struct setup *setup, const double F[3][2])
{
    for (size_t i = 0; i < setup->grid.vertices; i++)
        for (size_t k = 0; k < 3; k++)
            setup->x[3 * i + k] = F[k][0] * setup->grid.uv[2 * i] + F[k][1] * setup->grid.uv[2 * i + 1];
}

/* Energy per rest area as drape.h defines it. */
static double membrane_density(const drape_material *m, const double F[3][2])
{
    double C[2][2] = {{0}};
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            for (int k = 0; k < 3; k++)
                C[i][j] += F[k][i] * F[k][j];
    double e[3] = {(C[0][0] - 1) / 2, (C[1][1] - 1) / 2, C[0][1]}, nu = m->poisson, den = 1 - nu * nu;
    return (m->stretch_weft * e[0] * e[0] + m->stretch_warp * e[1] * e[1] +
            2 * nu * sqrt(m->stretch_weft * m->stretch_warp) * e[0] * e[1]) /
               (2 * den) +
           m->stretch_shear * e[2] * e[2] / 2;
}

/* Stretched, sheared, both and turned out of the plane, squeezed, mirrored. */
static const double STATE[][3][2] = {
    {{1.03, 0}, {0, 0.98}, {0, 0}}, {{1, 0.05}, {0, 1}, {0, 0}}, {{0.8, -0.3}, {0.5, 0.7}, {0.4, 0.6}},
    {{0.1, 0}, {0, 0.1}, {0, 0}},   {{10, 0}, {0, 10}, {0, 0}},  {{-1.1, 0}, {0, 1.2}, {0, 0}},
};

static void test_patch__uniform_states_have_exact_energies_on_every_mesh(void **state)
{
    (void)state;
    drape_options options = evaluate_only();
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++)
        for (size_t i = 0; i < sizeof STATE / sizeof *STATE; i++) {
            struct setup *setup = setup_new(grid_new(kind, 9, 7, 0.4, 0.3, 0), CLOTH);
            pin_columns(setup, 1);
            deform(setup, STATE[i]);
            struct run run = run_new(&setup->desc, &options);
            const drape_energies *energy = &run.report->state.energy;
            double expected = 0.4 * 0.3 * membrane_density(&CLOTH, STATE[i]);
            assert_int_equal(run.status, DRAPE_NOT_AT_REST);
            assert_int_equal(run.report->iterations, 0);
            assert_true(expected > 1e-4);
            assert_close(energy->stretch, expected, 1e-12);
            assert_true(energy->bend < 1e-20);
            assert_true(energy->gravity == 0 && energy->kinetic == 0 && energy->contact == 0);
            assert_close(energy->potential, expected, 1e-12);
            assert_memory_equal(run.x, setup->x, 3 * setup->grid.vertices * sizeof *run.x);
            run_done(&run);
            setup_free(setup);
        }
}

static void test_patch__rigid_motions_have_no_energy(void **state)
{
    (void)state;
    /* columns orthonormal: (2, 3, 6)/7 and (6, 2, -3)/7 */
    const double F[3][2] = {{2.0 / 7, 6.0 / 7}, {3.0 / 7, 2.0 / 7}, {6.0 / 7, -3.0 / 7}};
    drape_options options = evaluate_only();
    struct setup *setup = setup_new(grid_new(GRID_GRADED, 12, 12, 0.5, 0.5, 0), CLOTH);
    pin_columns(setup, 1);
    deform(setup, F);
    struct run run = run_new(&setup->desc, &options);
    assert_true(run.report->state.energy.stretch < 1e-26);
    assert_true(run.report->state.energy.bend < 1e-26);
    run_done(&run);
    setup_free(setup);
}

/* Bent to w = c u^2/2: the curvature is c everywhere, but a triangle with a free edge along v lets it
 * go (no moment crosses that edge), so it does not count. */
static void test_patch__uniform_curvature_has_exact_energy_on_every_mesh(void **state)
{
    (void)state;
    const double curvature = 0.3;
    drape_options options = evaluate_only();
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 10, 8, 0.5, 0.4, 0), CLOTH);
        const struct grid *grid = &setup->grid;
        double area = 0;
        for (size_t t = 0; t < grid->triangles; t++) {
            const uint32_t *c = grid->triangle + 3 * t;
            int left = 0, right = 0;
            for (int k = 0; k < 3; k++) {
                left += c[k] % (grid->nx + 1) == 0;
                right += c[k] % (grid->nx + 1) == grid->nx;
            }
            if (left < 2 && right < 2)
                area += grid_area2(grid, c[0], c[1], c[2]) / 2;
        }
        for (size_t i = 0; i < grid->vertices; i++)
            setup->x[3 * i + 1] = curvature * grid->uv[2 * i] * grid->uv[2 * i] / 2;
        setup->pin[setup->desc.pins++] = 0;
        struct run run = run_new(&setup->desc, &options);
        assert_true(area > 0.15 && area < 0.2);
        assert_close(run.report->state.energy.bend, CLOTH.bend_weft * curvature * curvature / 2 * area,
                     1e-11);
        run_done(&run);
        setup_free(setup);
    }
}

static void test_patch__uniform_stress_leaves_no_force_inside(void **state)
{
    (void)state;
    drape_options options = evaluate_only();
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 12, 12, 0.4, 0.4, 0), CLOTH);
        memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
        pin_border(setup);
        deform(setup, STATE[2]);
        struct run run = run_new(&setup->desc, &options);
        assert_true(run.report->state.energy.stretch > 0.1);
        assert_int_equal(run.report->free_nodes, 121);
        assert_true(run.report->state.residual_force <
                    1e-9); /* of a vertex's weight; the stress is 1e4 of them */
        run_done(&run);
        setup_free(setup);
    }
}

/* Pinned along its border in a uniform state, disturbed inside, cloth goes back to that state. */
static void test_patch__disturbed_uniform_state_comes_back(void **state)
{
    (void)state;
    const double F[3][2] = {{1.1, 0.03}, {0, 0.1}, {0.02, 1.15}};
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 10, 10, 0.4, 0.4, 0), CLOTH);
        size_t n = setup->grid.vertices;
        uint64_t seed = 11;
        memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
        pin_border(setup);
        deform(setup, F);
        double *expected = malloc(3 * n * sizeof *expected), worst = 0;
        assert_non_null(expected);
        memcpy(expected, setup->x, 3 * n * sizeof *expected);
        for (size_t j = 1; j < 10; j++)
            for (size_t i = 1; i < 10; i++)
                for (size_t k = 0; k < 3; k++)
                    setup->x[3 * (size_t)grid_at(&setup->grid, i, j) + k] += 0.01 * test_random(&seed);
        drape_options options = drape_options_default();
        options.tolerance = 1e-5;
        struct run run = run_new(&setup->desc, &options);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        for (size_t i = 0; i < 3 * n; i++)
            worst = fmax(worst, fabs(run.x[i] - expected[i]));
        print_message("  %-16s back within %.1e m after %u iterations\n", grid_name[kind], worst,
                      run.report->iterations);
        assert_true(worst < 1e-7);
        free(expected);
        run_done(&run);
        setup_free(setup);
    }
}

/* Hung by its side of length b, a triangle of height h carries a third of its weight at the apex:
 * k/2 lambda (lambda^2 - 1) b/2 = density g (b h/2) / 3. */
static void test_patch__one_triangle_hangs_as_computed_by_hand(void **state)
{
    (void)state;
    const double pattern[] = {0, 0, 0.2, 0, 0.1, 0.3}, start[] = {0, 1, 0, 0.2, 1, 0, 0.1, 1, 0.3};
    const uint32_t triangle[] = {0, 1, 2}, pin[] = {0, 1};
    const drape_material material = isotropic(0.2, 2, 1e-4);
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = 3;
    desc.triangles = 1;
    desc.positions = start;
    desc.pattern = pattern;
    desc.triangle = triangle;
    desc.pin = pin;
    desc.pins = 2;
    desc.material = &material;
    desc.materials = 1;
    drape_options options = drape_options_default();
    options.tolerance = 1e-6;
    struct run run = run_new(&desc, &options);
    double lambda = 1, load = 0.2 * 9.81 * 0.3 / 3;
    for (int i = 0; i < 50; i++)
        lambda -= (lambda * (lambda * lambda - 1) - load) / (3 * lambda * lambda - 1);
    print_message("  apex %.9f m below its side, %.9f by hand, %u iterations\n", 1 - run.x[7], 0.3 * lambda,
                  run.report->iterations);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_true(lambda > 1.05);
    assert_near(1 - run.x[7], 0.3 * lambda, 1e-7, 1);
    assert_near(run.x[6], 0.1, 1e-6, 1);
    assert_near(run.x[8], 0, 1e-5, 1);
    assert_true(run.report->state.energy.bend == 0);
    run_done(&run);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_patch__uniform_states_have_exact_energies_on_every_mesh),
        cmocka_unit_test(test_patch__rigid_motions_have_no_energy),
        cmocka_unit_test(test_patch__uniform_curvature_has_exact_energy_on_every_mesh),
        cmocka_unit_test(test_patch__uniform_stress_leaves_no_force_inside),
        cmocka_unit_test(test_patch__disturbed_uniform_state_comes_back),
        cmocka_unit_test(test_patch__one_triangle_hangs_as_computed_by_hand),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
