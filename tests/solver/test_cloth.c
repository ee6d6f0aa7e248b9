/* test_cloth.c - all terms together: force, step matrix and seams against finite differences. */
#include "test.h"

#include "sim.h"

#define SIDE      4
#define NODES     (SIDE * SIDE)
#define TRIANGLES (2 * (SIDE - 1) * (SIDE - 1))

struct example {
    double positions[3 * NODES], pattern[2 * NODES];
    uint32_t triangle[3 * TRIANGLES], pin[1];
    drape_material material;
    drape_body body;
    drape_scene *scene;
    struct dr_cloth *cloth;
    double x[3 * NODES];
};

/* A small panel, crumpled a little, pressed into a ball. */
static void make(struct example *e, double rigidity)
{
    memset(e, 0, sizeof *e);
    size_t at = 0;
    for (uint32_t i = 0; i < NODES; i++) {
        e->pattern[2 * i] = 0.02 * (i % SIDE);
        e->pattern[2 * i + 1] = 0.02 * (i / SIDE);
        e->positions[3 * i] = e->pattern[2 * i];
        e->positions[3 * i + 2] = e->pattern[2 * i + 1];
    }
    for (uint32_t j = 0; j + 1 < SIDE; j++)
        for (uint32_t i = 0; i + 1 < SIDE; i++) {
            uint32_t a = j * SIDE + i, cell[] = {a, a + SIDE, a + 1, a + 1, a + SIDE, a + SIDE + 1};
            memcpy(e->triangle + at, cell, sizeof cell);
            at += 6;
        }
    e->material = (drape_material){.density = 0.2,
                                   .stretch_weft = 40,
                                   .stretch_warp = 60,
                                   .stretch_shear = 20,
                                   .poisson = 0.2,
                                   .bend_weft = rigidity,
                                   .bend_warp = 2 * rigidity,
                                   .bend_twist = rigidity};
    e->body = (drape_body){
        .kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {0.03, -0.0485, 0.03}, .radius = 0.05};
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = NODES;
    desc.triangles = TRIANGLES;
    desc.pins = 1;
    desc.materials = desc.bodies = 1;
    desc.positions = e->positions;
    desc.pattern = e->pattern;
    desc.triangle = e->triangle;
    desc.pin = e->pin;
    desc.material = &e->material;
    desc.body = &e->body;
    assert_int_equal(drape_scene_new(&desc, &e->scene, NULL), DRAPE_OK);
    const struct dr_cloth_plan plan = {.scene = e->scene,
                                       .mesh = e->scene->mesh,
                                       .bend = e->scene->bend,
                                       .gravity = true,
                                       .contact = true,
                                       .matrix = DR_MATRIX_CHOLESKY};
    assert_int_equal(dr_cloth_new(&plan, e->positions, &e->cloth, NULL), DRAPE_OK);
    uint64_t seed = 11;
    for (int i = 0; i < 3 * NODES; i++)
        e->x[i] = e->positions[i] + 5e-4 * test_random(&seed);
}

static void release(struct example *e)
{
    dr_cloth_free(e->cloth);
    drape_scene_free(e->scene);
}

static void test_cloth__force_is_minus_the_difference_of_the_potential(void **state)
{
    (void)state;
    struct example e;
    make(&e, 1e-4);
    double f[3 * NODES], scratch[3 * NODES], scale = 0;
    drape_energies energy = {0}, other;
    double potential = dr_cloth_energy(e.cloth, e.x, &energy, f);
    assert_true(energy.stretch > 0 && energy.bend > 0 && energy.contact > 0 && energy.gravity != 0);
    assert_close(potential, energy.stretch + energy.bend + energy.contact + energy.gravity, 1e-14);
    for (int i = 0; i < 3 * NODES; i++)
        scale = fmax(scale, fabs(f[i]));
    for (int i = 0; i < 3 * NODES; i++) {
        const double h = 1e-7;
        double keep = e.x[i];
        e.x[i] = keep + h;
        double up = dr_cloth_energy(e.cloth, e.x, &other, scratch);
        e.x[i] = keep - h;
        double down = dr_cloth_energy(e.cloth, e.x, &other, scratch);
        e.x[i] = keep;
        assert_near((down - up) / (2 * h), f[i], 1e-6, scale);
    }
    assert_near(dr_cloth_mean_weight(e.cloth), 0.2 * 0.06 * 0.06 * 9.81 / NODES, 1e-14, 0);
    release(&e);
}

static void test_cloth__step_matrix_solves_the_linearised_step(void **state)
{
    (void)state;
    /* Near rest, with every stress tensile and no contact, A is M/dt^2 + the exact Hessian: a solve must
     * undo the finite difference of the force along any direction. */
    struct example e;
    make(&e, 1e-4);
    for (int i = 0; i < NODES; i++) { /* pulled two per cent both ways, far above the ball */
        e.x[3 * i] = 1.02 * e.pattern[2 * i];
        e.x[3 * i + 1] = 0.5;
        e.x[3 * i + 2] = 1.02 * e.pattern[2 * i + 1];
    }
    const double dt = 0.01, h = 1e-7;
    double y[3 * NODES] = {0}, up[3 * NODES], down[3 * NODES], b[3 * NODES], w[3 * NODES], moved[3 * NODES];
    uint64_t seed = 3;
    for (int i = 3; i < 3 * NODES; i++) /* node 0 is held */
        y[i] = test_random(&seed);
    drape_energies energy;
    for (int i = 0; i < 3 * NODES; i++)
        moved[i] = e.x[i] + h * y[i];
    dr_cloth_energy(e.cloth, moved, &energy, up);
    for (int i = 0; i < 3 * NODES; i++)
        moved[i] = e.x[i] - h * y[i];
    dr_cloth_energy(e.cloth, moved, &energy, down);
    for (int i = 0; i < 3 * NODES; i++) /* b = A y */
        b[i] = (down[i] - up[i]) / (2 * h) + e.cloth->mesh->mass[i / 3] / (dt * dt) * y[i];
    bool memory;
    dr_matrix_set_base(e.cloth->A, 1 / (dt * dt));
    dr_stretch_stress(e.cloth->stretch, e.x, NULL, e.cloth->stress);
    assert_int_equal(dr_cloth_assemble(e.cloth, e.x, 0, NULL), 0);
    assert_true(dr_matrix_factorise(e.cloth->A, &memory));
    dr_matrix_solve(e.cloth->A, 1, (const double *[]){b}, (double *[]){w});
    for (int i = 0; i < 3 * NODES; i++)
        assert_near(w[i], y[i], 1e-5, 1);
    release(&e);
}

static void test_cloth__a_limp_fabric_has_no_bending_term(void **state)
{
    (void)state;
    struct example e;
    make(&e, 0);
    assert_null(e.scene->bend);
    assert_null(e.cloth->bend);
    drape_energies energy;
    double f[3 * NODES];
    dr_cloth_energy(e.cloth, e.x, &energy, f);
    assert_true(energy.bend == 0);
    release(&e);
}

static void test_cloth__the_largest_force_passes_over_held_nodes_and_sees_nan(void **state)
{
    (void)state;
    struct example e;
    make(&e, 0);
    double f[3 * NODES] = {100, 0, 0, 0, 3, 4};
    assert_close(dr_cloth_largest_force(e.cloth, f), 5, 1e-15);
    f[7] = NAN;
    assert_true(isnan(dr_cloth_largest_force(e.cloth, f)));
    release(&e);
}

static void test_cloth__seam_springs_pull_as_their_energy_says(void **state)
{
    (void)state;
    const uint32_t seam[] = {0, 2, 2, 1};
    double x[9], f[9] = {0}, scratch[9], gap, ignored;
    uint64_t seed = 7;
    for (int i = 0; i < 9; i++)
        x[i] = test_random(&seed);
    double energy = dr_seam_energy(seam, 2, 3.5, INFINITY, x, f, &gap);
    double d02 = 0, d21 = 0;
    for (int d = 0; d < 3; d++) {
        d02 += (x[d] - x[6 + d]) * (x[d] - x[6 + d]);
        d21 += (x[6 + d] - x[3 + d]) * (x[6 + d] - x[3 + d]);
    }
    assert_close(energy, 1.75 * (d02 + d21), 1e-14);
    assert_close(gap, sqrt(fmax(d02, d21)), 1e-14);
    for (int i = 0; i < 9; i++) {
        const double h = 1e-4; /* the energy is quadratic: central differences are exact */
        double keep = x[i];
        x[i] = keep + h;
        double up = dr_seam_energy(seam, 2, 3.5, INFINITY, x, scratch, &ignored);
        x[i] = keep - h;
        double down = dr_seam_energy(seam, 2, 3.5, INFINITY, x, scratch, &ignored);
        x[i] = keep;
        assert_near((down - up) / (2 * h), f[i], 1e-10, 1);
    }
}

static void test_cloth__bounded_seam_springs_pull_no_harder(void **state)
{
    (void)state;
    const uint32_t seam[] = {0, 1};
    const double stiffness = 100, most = 0.5; /* reached at 5 mm */
    const double gap[] = {0.001, 0.0049, 0.0051, 0.3};
    double f[6], up, down, width;
    for (int i = 0; i < 4; i++) {
        const double h = 1e-7;
        double x[6] = {0, 0, 0, gap[i], 0, 0};
        memset(f, 0, sizeof f);
        dr_seam_energy(seam, 1, stiffness, most, x, f, &width);
        assert_close(f[0], fmin(stiffness * gap[i], most), 1e-14);
        assert_close(f[3], -f[0], 0);
        assert_close(width, gap[i], 1e-14);
        assert_close(dr_seam_stiffness(gap[i], stiffness, most) * gap[i], f[0], 1e-14);
        x[3] = gap[i] + h;
        up = dr_seam_energy(seam, 1, stiffness, most, x, f, &width);
        x[3] = gap[i] - h;
        down = dr_seam_energy(seam, 1, stiffness, most, x, f, &width);
        assert_near((up - down) / (2 * h), fmin(stiffness * gap[i], most), 1e-6, 1);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cloth__force_is_minus_the_difference_of_the_potential),
        cmocka_unit_test(test_cloth__step_matrix_solves_the_linearised_step),
        cmocka_unit_test(test_cloth__a_limp_fabric_has_no_bending_term),
        cmocka_unit_test(test_cloth__the_largest_force_passes_over_held_nodes_and_sees_nan),
        cmocka_unit_test(test_cloth__seam_springs_pull_as_their_energy_says),
        cmocka_unit_test(test_cloth__bounded_seam_springs_pull_no_harder),
    };
    return cmocka_run_group_tests_name("cloth", tests, NULL, NULL);
}
