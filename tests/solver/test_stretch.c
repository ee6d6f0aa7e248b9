/* test_stretch.c - the membrane against closed forms and finite differences. */
#include "test.h"

#include "stretch.h"

/* The Hessian lands in a dense matrix here, so that this test needs no sparse one. */
static double dense[18][18];
static size_t dense_nodes;
static const uint32_t *dense_triangle;

void dr_matrix_add_triangle(struct dr_matrix *A, size_t t, const double H[9][9])
{
    (void)A;
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++) {
            size_t row = 3 * dense_triangle[3 * t + (size_t)(i / 3)] + (size_t)(i % 3);
            size_t column = 3 * dense_triangle[3 * t + (size_t)(j / 3)] + (size_t)(j % 3);
            dense[row][column] += i >= j ? H[i][j] : H[j][i];
        }
}

#define NODES 5
static const double pattern[2 * NODES] = {0, 0, 0.03, 0.002, 0.001, 0.04, 0.035, 0.041, 0.07, 0.03};
static const uint32_t triangle[] = {0, 1, 2, 1, 3, 2, 1, 4, 3};
static const drape_material material = {
    .density = 0.2, .stretch_weft = 300, .stretch_warp = 500, .stretch_shear = 90, .poisson = 0.3};

struct membrane {
    struct dr_mesh *mesh;
    struct dr_stretch *stretch;
    double x[3 * NODES];
};

static void make(struct membrane *m, double size, uint64_t seed)
{
    const double density = material.density;
    assert_int_equal(dr_mesh_new(NODES, 3, triangle, triangle, pattern, NULL, &density, NULL, &m->mesh, NULL),
                     0);
    assert_int_equal(dr_stretch_new(m->mesh, &material, 1, &m->stretch, NULL), 0);
    dense_nodes = NODES;
    dense_triangle = triangle;
    for (int i = 0; i < NODES; i++)
        for (int d = 0; d < 3; d++)
            m->x[3 * i + d] = (d < 2 ? 1.05 * pattern[2 * i + d] : 0) + size * test_random(&seed);
}

static void release(struct membrane *m)
{
    dr_stretch_free(m->stretch);
    dr_mesh_free(m->mesh);
}

static void test_stretch__gradient_is_the_difference_of_energies(void **state)
{
    (void)state;
    struct membrane m;
    make(&m, 0.01, 1);
    double g[3 * NODES] = {0}, scale = 0, scratch;
    dr_stretch_energy(m.stretch, m.x, g);
    for (int i = 0; i < 3 * NODES; i++)
        scale = fmax(scale, fabs(g[i]));
    assert_true(scale > 0.1); /* N: the test would say nothing about a slack cloth */
    for (int i = 0; i < 3 * NODES; i++) {
        const double h = 1e-6;
        double keep = m.x[i];
        m.x[i] = keep + h;
        double up = dr_stretch_energy(m.stretch, m.x, NULL);
        m.x[i] = keep - h;
        double down = dr_stretch_energy(m.stretch, m.x, NULL);
        m.x[i] = keep;
        scratch = (up - down) / (2 * h);
        assert_near(scratch, g[i], 1e-7, scale);
    }
    release(&m);
}

static void test_stretch__hessian_is_the_difference_of_gradients_in_tension(void **state)
{
    (void)state;
    struct membrane m;
    make(&m, 0, 2);
    for (int i = 0; i < NODES; i++) { /* pulled both ways, sheared, rotated: all stresses tensile */
        double u = pattern[2 * i], v = pattern[2 * i + 1];
        m.x[3 * i] = 1.2 * u + 0.02 * v;
        m.x[3 * i + 1] = 0.9 * v;
        m.x[3 * i + 2] = 0.8 * v + 10 * u * v;
    }
    double stress[9];
    dr_stretch_stress(m.stretch, m.x, NULL, stress);
    for (int t = 0; t < 3; t++)
        assert_true(stress[3 * t] > 0 &&
                    stress[3 * t] * stress[3 * t + 1] > stress[3 * t + 2] * stress[3 * t + 2]);
    memset(dense, 0, sizeof dense);
    dr_stretch_hessian(m.stretch, m.x, stress, NULL);
    for (int j = 0; j < 3 * NODES; j++) {
        const double h = 1e-6;
        double up[3 * NODES] = {0}, down[3 * NODES] = {0}, keep = m.x[j];
        m.x[j] = keep + h;
        dr_stretch_energy(m.stretch, m.x, up);
        m.x[j] = keep - h;
        dr_stretch_energy(m.stretch, m.x, down);
        m.x[j] = keep;
        for (int i = 0; i < 3 * NODES; i++)
            assert_near((up[i] - down[i]) / (2 * h), dense[i][j], 1e-7, 100);
    }
    release(&m);
}

static void test_stretch__hessian_is_positive_semidefinite_under_compression(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 50; seed++) {
        struct membrane m;
        make(&m, 0.02, seed);
        double stress[9];
        dr_stretch_stress(m.stretch, m.x, NULL, stress);
        memset(dense, 0, sizeof dense);
        dr_stretch_hessian(m.stretch, m.x, stress, NULL);
        uint64_t random = seed + 1000;
        for (int trial = 0; trial < 50; trial++) {
            double y[3 * NODES], quadratic = 0, size = 0;
            for (int i = 0; i < 3 * NODES; i++)
                y[i] = test_random(&random);
            for (int i = 0; i < 3 * NODES; i++)
                for (int j = 0; j < 3 * NODES; j++) {
                    quadratic += y[i] * dense[i][j] * y[j];
                    size += fabs(y[i] * dense[i][j] * y[j]);
                }
            assert_true(quadratic >= -1e-12 * size);
        }
        release(&m);
    }
}

static void test_stretch__uniaxial_pull_follows_the_closed_form(void **state)
{
    (void)state;
    /* nu = 0: a strip stretched by lambda carries P = k/2 lambda (lambda^2 - 1) per width, energy
     * k/8 (lambda^2 - 1)^2 per rest area. */
    const double strip[] = {0, 0, 0.1, 0, 0, 0.3, 0.1, 0.3};
    const uint32_t two[] = {0, 1, 2, 1, 3, 2};
    const drape_material plain = {.density = 0.1, .stretch_weft = 10, .stretch_warp = 20, .stretch_shear = 5};
    struct dr_mesh *mesh;
    struct dr_stretch *stretch;
    assert_int_equal(dr_mesh_new(4, 2, two, two, strip, NULL, &plain.density, NULL, &mesh, NULL), 0);
    assert_int_equal(dr_stretch_new(mesh, &plain, 1, &stretch, NULL), 0);
    for (double lambda = 0.5; lambda < 3; lambda += 0.25) {
        double x[12] = {0}, g[12] = {0};
        for (int i = 0; i < 4; i++) { /* laid along z and y: orientation must not matter */
            x[3 * i + 2] = strip[2 * i];
            x[3 * i + 1] = -lambda * strip[2 * i + 1];
        }
        double energy = dr_stretch_energy(stretch, x, g), rise = lambda * lambda - 1;
        assert_near(energy, 20.0 / 8 * rise * rise * 0.03, 1e-14, 1e-3);
        assert_near(-(g[7] + g[10]), 20.0 / 2 * lambda * rise * 0.1, 1e-13, 1e-2);
        assert_near(g[2], 0, 1e-14, 1);
    }
    dr_stretch_free(stretch);
    dr_mesh_free(mesh);
}

static void test_stretch__rigid_motion_costs_nothing_even_a_kilometre_away(void **state)
{
    (void)state;
    struct membrane m;
    make(&m, 0, 3);
    double c = cos(0.7), s = sin(0.7), g[3 * NODES] = {0};
    for (int i = 0; i < NODES; i++) {
        double u = pattern[2 * i], v = pattern[2 * i + 1];
        m.x[3 * i] = 1000 + c * u - s * v;
        m.x[3 * i + 1] = -1000 + s * u + c * v;
        m.x[3 * i + 2] = 1000;
    }
    /* positions are rounded to 1e-13 m, strains to about 1e-11 */
    assert_true(dr_stretch_energy(m.stretch, m.x, g) < 1e-18);
    release(&m);
}

static void test_stretch__predicted_stress_is_the_linear_part(void **state)
{
    (void)state;
    struct membrane m;
    make(&m, 0.01, 4);
    double w[3 * NODES], at[9], predicted[9], up[9], down[9], x[3 * NODES];
    uint64_t seed = 9;
    for (int i = 0; i < 3 * NODES; i++)
        w[i] = 0.01 * test_random(&seed);
    dr_stretch_stress(m.stretch, m.x, NULL, at);
    dr_stretch_stress(m.stretch, m.x, w, predicted);
    for (int sign = -1; sign <= 1;
         sign += 2) { /* the stress is quadratic in x: central differences are exact */
        for (int i = 0; i < 3 * NODES; i++)
            x[i] = m.x[i] + 0.5 * sign * w[i];
        dr_stretch_stress(m.stretch, x, NULL, sign < 0 ? down : up);
    }
    for (int i = 0; i < 9; i++)
        assert_near(predicted[i] - at[i], up[i] - down[i], 1e-12, 100);
    release(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_stretch__gradient_is_the_difference_of_energies),
        cmocka_unit_test(test_stretch__hessian_is_the_difference_of_gradients_in_tension),
        cmocka_unit_test(test_stretch__hessian_is_positive_semidefinite_under_compression),
        cmocka_unit_test(test_stretch__uniaxial_pull_follows_the_closed_form),
        cmocka_unit_test(test_stretch__rigid_motion_costs_nothing_even_a_kilometre_away),
        cmocka_unit_test(test_stretch__predicted_stress_is_the_linear_part),
    };
    return cmocka_run_group_tests_name("stretch", tests, NULL, NULL);
}
