/* test_patch.c - uniform states: exact energies, no force inside, and one triangle on its own. */
#include "run.h"
#include "scene.h"

static const drape_material CLOTH = {.density = 0.15,
                                     .stretch_weft = 300,
                                     .stretch_warp = 800,
                                     .stretch_shear = 50,
                                     .poisson = 0.2,
                                     .bend_weft = 2e-5,
                                     .bend_warp = 5e-5,
                                     .bend_twist = 1e-5};

#define DEMAND 1e-12

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
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        double worst = 0;
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
            worst = fmax(worst, fabs(energy->stretch / expected - 1));
            assert_close(energy->stretch, expected, DEMAND);
            assert_true(energy->bend < 1e-20);
            assert_true(energy->gravity == 0 && energy->kinetic == 0 && energy->contact == 0);
            assert_close(energy->potential, expected, DEMAND);
            assert_memory_equal(run.x, setup->x, 3 * setup->grid.vertices * sizeof *run.x);
            run_done(&run);
            setup_free(setup);
        }
        print_message("  %-16s worst relative error %.1e (demand %.0e)\n", grid_name[kind], worst, DEMAND);
    }
}

static void test_patch__rigid_motions_have_no_energy(void **state)
{
    (void)state;
    /* columns orthonormal: (2, 3, 6)/7 and (6, 2, -3)/7 */
    const double F[3][2] = {{2.0 / 7, 6.0 / 7}, {3.0 / 7, 2.0 / 7}, {6.0 / 7, -3.0 / 7}};
    drape_options options = evaluate_only();
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 12, 12, 0.5, 0.5, 0), CLOTH);
        pin_columns(setup, 1);
        deform(setup, F);
        struct run run = run_new(&setup->desc, &options);
        assert_true(run.report->state.energy.stretch < 1e-26);
        assert_true(run.report->state.energy.bend < 1e-26);
        run_done(&run);
        setup_free(setup);
    }
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
        double bend = run.report->state.energy.bend;
        double expected = CLOTH.bend_weft * curvature * curvature / 2 * area;
        print_message("  %-16s relative error %.1e (demand %.0e)\n", grid_name[kind],
                      fabs(bend / expected - 1), DEMAND);
        assert_close(bend, expected, DEMAND);
        run_done(&run);
        setup_free(setup);
    }
}

/* What the triangle with pattern corners P (2 each) does to its corner 0, N: F S times the edge opposite,
 * turned outwards, over 2. */
static double corner_force(const drape_material *m, const double F[3][2], const double *const P[3])
{
    double C[2][2] = {{0}}, nu = m->poisson, den = 1 - nu * nu, sum = 0;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            for (int k = 0; k < 3; k++)
                C[i][j] += F[k][i] * F[k][j];
    double e[2] = {(C[0][0] - 1) / 2, (C[1][1] - 1) / 2};
    double lateral = nu * sqrt(m->stretch_weft * m->stretch_warp) / den, s_uv = m->stretch_shear * C[0][1];
    double s_uu = m->stretch_weft / den * e[0] + lateral * e[1];
    double s_vv = m->stretch_warp / den * e[1] + lateral * e[0];
    double out[2] = {(P[2][1] - P[1][1]) / 2, (P[1][0] - P[2][0]) / 2};
    double pull[2] = {s_uu * out[0] + s_uv * out[1], s_uv * out[0] + s_vv * out[1]};
    for (int k = 0; k < 3; k++)
        sum += pow(F[k][0] * pull[0] + F[k][1] * pull[1], 2);
    return sqrt(sum);
}

/* The largest force left on a free vertex, N. */
static double force_left(const struct run *run, double mass)
{
    return run->report->state.residual_force * 9.81 * mass / (double)run->report->nodes;
}

static void test_patch__uniform_stress_leaves_no_force_inside(void **state)
{
    (void)state;
    drape_options options = evaluate_only();
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, 12, 12, 0.4, 0.4, 0), CLOTH);
        const struct grid *grid = &setup->grid;
        double largest = 0;
        memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
        pin_border(setup);
        deform(setup, STATE[2]);
        for (size_t i = 0; i < 3 * grid->triangles; i++) {
            const uint32_t *c = grid->triangle + i / 3 * 3;
            const double *P[3];
            for (size_t k = 0; k < 3; k++)
                P[k] = grid->uv + 2 * (size_t)c[(i + k) % 3];
            largest = fmax(largest, corner_force(&CLOTH, STATE[2], P));
        }
        struct run run = run_new(&setup->desc, &options);
        double left = force_left(&run, CLOTH.density * 0.4 * 0.4) / largest;
        print_message("  %-16s force left %.1e of what a triangle pulls with (demand %.0e)\n",
                      grid_name[kind], left, DEMAND);
        assert_true(run.report->state.energy.stretch > 0.1);
        assert_int_equal(run.report->free_nodes, 121);
        assert_true(left < DEMAND);
        run_done(&run);
        setup_free(setup);
    }
}

/* Bent to a quadratic the cloth has a uniform moment, which does nothing to vertices inside: the slopes of
 * the border's triangles are computed from vertices up to 4 rows in. Forces over the moment (N m per m). */
static void test_patch__uniform_moment_leaves_no_force_inside(void **state)
{
    (void)state;
    enum { CELLS = 16, BORDER = 5 };
    const double curvature = 0.3;
    const double rigidity[] = {CLOTH.bend_weft, CLOTH.bend_warp, 2 * CLOTH.bend_twist};
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct setup *setup = setup_new(grid_new(kind, CELLS, CELLS, 0.4, 0.4, 0), CLOTH);
        const struct grid *grid = &setup->grid;
        drape_scene *scene;
        double worst = 0, border = 0, *force = malloc(3 * grid->vertices * sizeof *force);
        assert_non_null(force);
        setup->pin[setup->desc.pins++] = 0;
        assert_int_equal(drape_scene_new(&setup->desc, &scene, NULL), DRAPE_OK);
        for (int which = 0; which < 3; which++) {
            for (size_t i = 0; i < grid->vertices; i++) {
                double u = grid->uv[2 * i] - 0.2, v = grid->uv[2 * i + 1] - 0.2;
                setup->x[3 * i + 1] = curvature * (which == 0 ? u * u / 2 : which == 1 ? v * v / 2 : u * v);
            }
            memset(force, 0, 3 * grid->vertices * sizeof *force);
            dr_bend_energy(scene->bend, setup->x, force);
            for (size_t j = 0; j <= CELLS; j++)
                for (size_t i = 0; i <= CELLS; i++) {
                    bool inside = i >= BORDER && j >= BORDER && i <= CELLS - BORDER && j <= CELLS - BORDER;
                    double f =
                        fabs(force[3 * (size_t)grid_at(grid, i, j) + 1]) / (rigidity[which] * curvature);
                    *(inside ? &worst : &border) = fmax(inside ? worst : border, f);
                }
        }
        print_message("  %-16s force left %.1e of the moment (demand %.0e), %.2f at the border\n",
                      grid_name[kind], worst, DEMAND, border);
        assert_true(border > 0.1);
        assert_true(worst < DEMAND);
        drape_scene_free(scene);
        free(force);
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
        options.tolerance = 1e-8;
        struct run run = run_new(&setup->desc, &options);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        for (size_t i = 0; i < 3 * n; i++)
            worst = fmax(worst, fabs(run.x[i] - expected[i]));
        print_message("  %-16s back within %.1e of its width after %u iterations (demand %.0e)\n",
                      grid_name[kind], worst / 0.4, run.report->iterations, DEMAND);
        assert_true(worst / 0.4 < DEMAND);
        free(expected);
        run_done(&run);
        setup_free(setup);
    }
}

/* A triangle of any shape in any state, all but corner 0 held. */
static void test_patch__any_triangle_has_the_energy_and_force_computed_by_hand(void **state)
{
    (void)state;
    uint64_t seed = 5;
    double worst_energy = 0, worst_force = 0;
    for (int n = 0; n < 200; n++) {
        double pattern[6], F[3][2], start[9];
        const double *const P[3] = {pattern, pattern + 2, pattern + 4};
        const uint32_t triangle[] = {0, 1, 2}, pin[] = {1, 2};
        double area;
        do {
            for (int i = 0; i < 6; i++)
                pattern[i] = 0.1 * test_random(&seed);
            area =
                ((P[1][0] - P[0][0]) * (P[2][1] - P[0][1]) - (P[1][1] - P[0][1]) * (P[2][0] - P[0][0])) / 2;
        } while (area < 5e-4);
        for (int k = 0; k < 3; k++) {
            F[k][0] = 1.5 * test_random(&seed);
            F[k][1] = 1.5 * test_random(&seed);
            for (int i = 0; i < 3; i++)
                start[3 * i + k] = F[k][0] * P[i][0] + F[k][1] * P[i][1];
        }
        drape_scene_desc desc = drape_scene_desc_default();
        desc.vertices = 3;
        desc.triangles = 1;
        desc.positions = start;
        desc.pattern = pattern;
        desc.triangle = triangle;
        desc.pin = pin;
        desc.pins = 2;
        desc.material = &CLOTH;
        desc.materials = 1;
        memset(desc.gravity, 0, sizeof desc.gravity);
        drape_options options = evaluate_only();
        struct run run = run_new(&desc, &options);
        double energy = area * membrane_density(&CLOTH, F), force = corner_force(&CLOTH, F, P);
        double left = force_left(&run, CLOTH.density * area);
        worst_energy = fmax(worst_energy, fabs(run.report->state.energy.stretch / energy - 1));
        worst_force = fmax(worst_force, fabs(left / force - 1));
        assert_close(run.report->state.energy.stretch, energy, DEMAND);
        assert_close(left, force, DEMAND);
        run_done(&run);
    }
    print_message(
        "  200 triangles: worst relative error of the energy %.1e, of the force %.1e (demand %.0e)\n",
        worst_energy, worst_force, DEMAND);
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
    options.tolerance = 1e-12;
    struct run run = run_new(&desc, &options);
    double lambda = 1, load = 0.2 * 9.81 * 0.3 / 3;
    for (int i = 0; i < 50; i++)
        lambda -= (lambda * (lambda * lambda - 1) - load) / (3 * lambda * lambda - 1);
    print_message("  apex %.9f m below its side, relative error %.1e (demand %.0e), %u iterations\n",
                  1 - run.x[7], fabs((1 - run.x[7]) / (0.3 * lambda) - 1), DEMAND, run.report->iterations);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_true(lambda > 1.05);
    assert_close(1 - run.x[7], 0.3 * lambda, DEMAND);
    assert_near(run.x[6], 0.1, DEMAND, 1);
    assert_near(run.x[8], 0, DEMAND, 1);
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
        cmocka_unit_test(test_patch__uniform_moment_leaves_no_force_inside),
        cmocka_unit_test(test_patch__any_triangle_has_the_energy_and_force_computed_by_hand),
        cmocka_unit_test(test_patch__disturbed_uniform_state_comes_back),
        cmocka_unit_test(test_patch__one_triangle_hangs_as_computed_by_hand),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
