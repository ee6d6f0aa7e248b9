/* test_stretch.c - the membrane against closed forms and finite differences. */
#include "test.h"

#include "stretch.c"

/* The Hessian lands in a dense matrix here, so that this test needs no sparse one. */
#define MOST_NODES 9
static double dense[3 * MOST_NODES][3 * MOST_NODES];
static size_t dense_nodes;
static const uint32_t *dense_triangle;

void dr_matrix_add_triangles(struct dr_matrix *A, size_t t, size_t count, const double H[45][DR_MATRIX_BATCH])
{
    (void)A;
    assert_in_range(count, 1, DR_MATRIX_BATCH);
    for (size_t k = 0; k < 81 * count; k++) {
        size_t i = k / 9 % 9, j = k % 9, row = i > j ? i : j, column = i > j ? j : i;
        const uint32_t *node = dense_triangle + 3 * (t + k / 81);
        dense[3 * node[i / 3] + i % 3][3 * node[j / 3] + j % 3] += H[row * (row + 1) / 2 + column][k / 81];
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
    dr_stretch_hessian(m.stretch, m.x, stress, 0, NULL);
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

/* y'Hy >= 0 for random y. */
static void assert_semidefinite(struct membrane *m, const double *stress, uint64_t seed)
{
    memset(dense, 0, sizeof dense);
    dr_stretch_hessian(m->stretch, m->x, stress, 0, NULL);
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
}

static void test_stretch__hessian_is_positive_semidefinite_under_compression(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 50; seed++) {
        struct membrane m;
        make(&m, 0.02, seed);
        double stress[9];
        dr_stretch_stress(m.stretch, m.x, NULL, stress);
        assert_semidefinite(&m, stress, seed);
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

/* ---- strain-stress curves ----------------------------------------------------------------------- */

/* Weft stiffens like a woven cloth, warp softens (so that dS/dE < 0 somewhere), shear is in between. */
static const double WEFT[] = {0.02, 3, 0.05, 12, 0.1, 60, 0.2, 260};
static const double WARP[] = {0.02, 30, 0.05, 40, 0.3, 42, 0.6, 45};
static const double SHEAR[] = {0, 0, 0.1, 2, 0.2, 9, 0.5, 20};
static const drape_material CURVED = {.density = 0.2,
                                      .stretch_weft = NAN, /* not to be read */
                                      .stretch_warp = NAN,
                                      .stretch_shear = NAN,
                                      .curve_weft = {4, WEFT},
                                      .curve_warp = {4, WARP},
                                      .curve_shear = {4, SHEAR}};

/* The first triangle is linear with Poisson coupling, the second curved in part, the third in all. */
static void make_curved(struct membrane *m, double size, uint64_t seed)
{
    const drape_material mixed[3] = {
        material, {.stretch_weft = 300, .stretch_shear = 20, .curve_warp = {4, WARP}}, CURVED};
    const uint32_t of[] = {0, 1, 2};
    const double density[] = {0.2, 0.2, 0.2};
    make(m, size, seed);
    release(m);
    assert_int_equal(dr_mesh_new(NODES, 3, triangle, triangle, pattern, of, density, NULL, &m->mesh, NULL),
                     0);
    assert_int_equal(dr_stretch_new(m->mesh, mixed, 3, &m->stretch, NULL), 0);
}

/* g' = (E(x + h) - E(x - h)) / 2h and H = (g(x + h) - g(x - h)) / 2h at m->x. */
static void assert_gradient_and_hessian(struct membrane *m, bool hessian)
{
    double g[3 * NODES] = {0};
    dr_stretch_energy(m->stretch, m->x, g);
    for (int j = 0; j < 3 * NODES; j++) {
        const double h = 1e-7;
        double up[3 * NODES] = {0}, down[3 * NODES] = {0}, keep = m->x[j];
        m->x[j] = keep + h;
        double high = dr_stretch_energy(m->stretch, m->x, up);
        m->x[j] = keep - h;
        double low = dr_stretch_energy(m->stretch, m->x, down);
        m->x[j] = keep;
        assert_near((high - low) / (2 * h), g[j], 1e-6, 0.1);
        for (int i = 0; hessian && i < 3 * NODES; i++)
            assert_near((up[i] - down[i]) / (2 * h), dense[i][j], 1e-6, 100);
    }
}

static void test_stretch__curved_gradient_and_true_hessian_are_the_differences(void **state)
{
    (void)state;
    double softest = 0;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        struct membrane m;
        make_curved(&m, 0.004, seed); /* stretched, compressed and sheared by tens of percent */
        double stress[9];
        dr_stretch_stress(m.stretch, m.x, NULL, stress);
        memset(dense, 0, sizeof dense);
        dr_stretch_hessian(m.stretch, m.x, stress, 1, NULL);
        assert_gradient_and_hessian(&m, true);
        for (int i = 0; i < 3 * NODES; i++)
            softest = fmin(softest, dense[i][i]);
        release(&m);
    }
    assert_true(softest < -1); /* N/m: compression and softening were there */
}

static void test_stretch__curved_hessian_in_tension_is_the_difference_of_gradients(void **state)
{
    (void)state;
    struct membrane m;
    make_curved(&m, 0, 1);
    for (int i = 0; i < NODES; i++) { /* stiffening curves, all stresses tensile */
        double u = pattern[2 * i], v = pattern[2 * i + 1];
        m.x[3 * i] = 1.15 * u + 0.01 * v;
        m.x[3 * i + 1] = 1.015 * v;
        m.x[3 * i + 2] = 0.01 * u;
    }
    double stress[9];
    dr_stretch_stress(m.stretch, m.x, NULL, stress);
    for (int t = 0; t < 3; t++)
        assert_true(stress[3 * t] > 0 &&
                    stress[3 * t] * stress[3 * t + 1] > stress[3 * t + 2] * stress[3 * t + 2]);
    memset(dense, 0, sizeof dense);
    dr_stretch_hessian(m.stretch, m.x, stress, 0, NULL);
    assert_gradient_and_hessian(&m, true);
    release(&m);
}

static void test_stretch__curved_hessian_is_positive_semidefinite_anywhere(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 50; seed++) {
        struct membrane m;
        make_curved(&m, 0.02, seed);
        double stress[9];
        dr_stretch_stress(m.stretch, m.x, NULL, stress);
        assert_semidefinite(&m, stress, seed);
        release(&m);
    }
}

static void test_stretch__what_the_projection_left_out_is_the_difference_of_the_hessians(void **state)
{
    (void)state;
    double most[2] = {0, 0};
    for (uint64_t seed = 1; seed <= 40; seed++) {
        struct membrane m;
        (seed % 2 ? make : make_curved)(&m, 0.004, seed);
        double stress[9], p[3 * NODES], q[3 * NODES] = {0}, expected[3 * NODES] = {0};
        uint64_t random = seed + 1000;
        dr_stretch_stress(m.stretch, m.x, NULL, stress);
        for (int i = 0; i < 3 * NODES; i++)
            p[i] = test_random(&random);
        for (int whole = 0; whole < 2; whole++) {
            memset(dense, 0, sizeof dense);
            dr_stretch_hessian(m.stretch, m.x, stress, whole, NULL);
            for (int i = 0; i < 3 * NODES; i++)
                for (int j = 0; j < 3 * NODES; j++)
                    expected[i] += (whole ? 1 : -1) * dense[i][j] * p[j];
        }
        dr_stretch_left_out(m.stretch, m.x, stress, p, q);
        for (int i = 0; i < 3 * NODES; i++) {
            assert_near(q[i], expected[i], 1e-11, 1000); /* N/m: the Hessian's entries */
            most[seed % 2] = fmax(most[seed % 2], fabs(q[i]));
        }
        release(&m);
    }
    assert_true(most[0] > 10 && most[1] > 10); /* N/m: compression and softening were there */
}

/* y'Hy for the pull y = v e_y of the unit right triangle stretched by l along the warp, without stress. */
static double pull_stiffness(const struct dr_stretch *stretch, double l, double compression)
{
    const double x[] = {0, 0, 0, 1, 0, 0, 0, l, 0}, none[3] = {0};
    memset(dense, 0, sizeof dense);
    dr_stretch_hessian(stretch, x, none, compression, NULL);
    return dense[7][7];
}

static void test_stretch__a_softening_curve_adds_no_negative_stiffness_unless_asked(void **state)
{
    (void)state;
    const double unit[] = {0, 0, 1, 0, 0, 1}, density = 0.2, slope = 30; /* 3 / 0.1 in its last step */
    const uint32_t one[] = {0, 1, 2};
    struct dr_mesh *mesh;
    struct dr_stretch *stretch;
    dense_triangle = one;
    assert_int_equal(dr_mesh_new(3, 1, one, one, unit, NULL, &density, NULL, &mesh, NULL), 0);
    const double soft[] = {0.1, 100, 0.2, 103};
    drape_material material_soft = CURVED;
    material_soft.curve_warp = (drape_curve){2, soft};
    assert_int_equal(dr_stretch_new(mesh, &material_soft, 1, &stretch, NULL), 0);
    const double l = 1.4, P = 103 + slope * 0.2; /* l^2 dS/dE = P' - P/l, on half a square metre */
    assert_near(pull_stiffness(stretch, l, 0), 0, 0, 1);
    assert_close(pull_stiffness(stretch, l, 1), 0.5 * (slope - P / l), 1e-13);
    assert_close(pull_stiffness(stretch, l, 0.25), 0.125 * (slope - P / l), 1e-13);
    dr_stretch_free(stretch);
    dr_mesh_free(mesh);
}

static void test_stretch__uniaxial_pulls_reproduce_the_curves(void **state)
{
    (void)state;
    /* A strip 0.1 m wide along the weft or warp: at each point of the curve the tester reads its force. */
    const uint32_t two[] = {0, 1, 2, 1, 3, 2};
    for (int warp = 0; warp < 2; warp++) {
        const double *curve = warp ? WARP : WEFT;
        double strip[] = {0, 0, 0.1, 0, 0, 0.3, 0.1, 0.3};
        for (int i = 0; i < 4 && !warp; i++) {
            double swap = strip[2 * i];
            strip[2 * i] = strip[2 * i + 1];
            strip[2 * i + 1] = swap;
        }
        struct dr_mesh *mesh;
        struct dr_stretch *stretch;
        assert_int_equal(dr_mesh_new(4, 2, two, two, strip, NULL, &CURVED.density, NULL, &mesh, NULL), 0);
        assert_int_equal(dr_stretch_new(mesh, &CURVED, 1, &stretch, NULL), 0);
        for (int point = 0; point < 4; point++) {
            double x[12] = {0}, g[12] = {0}, l = 1 + curve[2 * point];
            for (int i = 0; i < 4; i++) {
                x[3 * i + 2] = strip[2 * i + (warp ? 0 : 1)];
                x[3 * i + 1] = l * strip[2 * i + (warp ? 1 : 0)];
            }
            dr_stretch_energy(stretch, x, g);
            assert_close((g[7] + g[10]) / 0.1, curve[2 * point + 1], 1e-13);
            assert_near(g[8], 0, 1e-13, 1); /* nothing across: no Poisson effect */
        }
        dr_stretch_free(stretch);
        dr_mesh_free(mesh);
    }
}

static void test_stretch__simple_shear_reproduces_its_curve(void **state)
{
    (void)state;
    const double unit[] = {0, 0, 1, 0, 0, 1}, density = 0.2;
    const uint32_t one[] = {0, 1, 2};
    struct dr_mesh *mesh;
    struct dr_stretch *stretch;
    assert_int_equal(dr_mesh_new(3, 1, one, one, unit, NULL, &density, NULL, &mesh, NULL), 0);
    assert_int_equal(dr_stretch_new(mesh, &CURVED, 1, &stretch, NULL), 0);
    for (int point = 1; point < 4; point++)
        for (int sign = -1; sign <= 1; sign += 2) {
            /* two unit yarns at an angle: 2 E_uv is the cosine between them, E_uu = E_vv = 0 */
            double c = sign * SHEAR[2 * point], s[3], x[] = {0, 0, 0, 1, 0, 0, c, sqrt(1 - c * c), 0};
            dr_stretch_stress(stretch, x, NULL, s);
            assert_close(s[2], sign * SHEAR[2 * point + 1], 1e-13);
            assert_near(s[0], 0, 1e-12, 1);
        }
    dr_stretch_free(stretch);
    dr_mesh_free(mesh);
}

static void test_stretch__compressed_curves_are_linear_and_stay_finite_to_a_point(void **state)
{
    (void)state;
    const double unit[] = {0, 0, 1, 0, 0, 1}, density = 0.2;
    const uint32_t one[] = {0, 1, 2};
    struct dr_mesh *mesh;
    struct dr_stretch *stretch;
    assert_int_equal(dr_mesh_new(3, 1, one, one, unit, NULL, &density, NULL, &mesh, NULL), 0);
    assert_int_equal(dr_stretch_new(mesh, &CURVED, 1, &stretch, NULL), 0);
    for (double l = 0; l <= 1; l += 0.125) {
        double x[] = {0, 0, 0, l, 0, 0, 0, 1, 0}, s[3], E = 0.5 * (l * l - 1);
        dr_stretch_stress(stretch, x, NULL, s);
        assert_near(s[0], 150 * E, 1e-14, 1);
        assert_near(dr_stretch_energy(stretch, x, NULL), 0.5 * 75 * E * E, 1e-14, 1);
    }
    const double collapsed[9] = {0};
    double s[3];
    dr_stretch_stress(stretch, collapsed, collapsed, s);
    assert_close(s[0], -75, 1e-15);
    assert_close(s[1], -750, 1e-15);
    dr_stretch_free(stretch);
    dr_mesh_free(mesh);
}

/* x at s in [0, 1] of a closed-form random path, and dx/ds. */
static void path_at(const double *start, const double *wave, double s, double *x, double *dx)
{
    for (int i = 0; i < 3 * NODES; i++) {
        const double *a = wave + 3 * i;
        x[i] = start[i] + a[0] * s + a[1] * sin(3 * s) + a[2] * (1 - cos(5 * s));
        dx[i] = a[0] + 3 * a[1] * cos(3 * s) + 5 * a[2] * sin(5 * s);
    }
}

static double power_at(const struct membrane *m, const double *wave, double s)
{
    double x[3 * NODES], dx[3 * NODES], g[3 * NODES] = {0}, power = 0;
    path_at(m->x, wave, s, x, dx);
    dr_stretch_energy(m->stretch, x, g);
    for (int i = 0; i < 3 * NODES; i++)
        power += g[i] * dx[i];
    return power;
}

static void test_stretch__energy_is_the_integral_of_force_along_random_paths(void **state)
{
    (void)state;
    double worst = 0;
    for (uint64_t seed = 1; seed <= 20; seed++) {
        struct membrane m;
        double wave[9 * NODES], x[3 * NODES], dx[3 * NODES], work = 0, travelled = 0;
        uint64_t random = seed + 100;
        make_curved(&m, 0.002, seed);
        for (int i = 0; i < 9 * NODES; i++)
            wave[i] = 0.006 * test_random(&random);
        const int panels = 4000; /* of Simpson's rule; at knots the integrand is only C1 */
        for (int k = 0; k < panels; k++) {
            double s = (double)k / panels, h = 1.0 / panels;
            double part =
                h / 6 *
                (power_at(&m, wave, s) + 4 * power_at(&m, wave, s + h / 2) + power_at(&m, wave, s + h));
            work += part;
            travelled += fabs(part);
        }
        path_at(m.x, wave, 1, x, dx);
        double gain = dr_stretch_energy(m.stretch, x, NULL) - dr_stretch_energy(m.stretch, m.x, NULL);
        assert_true(travelled > 1e-3); /* J */
        worst = fmax(worst, fabs(work - gain) / fabs(gain));
        assert_close(work, gain, 1e-8);
        release(&m);
    }
    print_message("  largest relative error %.1e\n", worst);
}

static void test_stretch__predicted_curve_stress_follows_the_tangent(void **state)
{
    (void)state;
    struct membrane m;
    make_curved(&m, 0, 1);
    for (int i = 0; i < NODES; i++) { /* all tangents positive, as in the Hessian's test */
        m.x[3 * i] = 1.15 * pattern[2 * i] + 0.01 * pattern[2 * i + 1];
        m.x[3 * i + 1] = 1.015 * pattern[2 * i + 1];
    }
    double w[3 * NODES], x[3 * NODES], at[9], predicted[9], up[9], down[9];
    uint64_t seed = 9;
    for (int i = 0; i < 3 * NODES; i++)
        w[i] = 1e-7 * test_random(&seed);
    dr_stretch_stress(m.stretch, m.x, NULL, at);
    dr_stretch_stress(m.stretch, m.x, w, predicted);
    for (int sign = -1; sign <= 1; sign += 2) {
        for (int i = 0; i < 3 * NODES; i++)
            x[i] = m.x[i] + 0.5 * sign * w[i];
        dr_stretch_stress(m.stretch, x, NULL, sign < 0 ? down : up);
    }
    for (int i = 0; i < 9; i++)
        assert_near(predicted[i] - at[i], up[i] - down[i], 1e-6, 1e-3);
    assert_true(fabs(predicted[6] - at[6]) > 1e-4);
    release(&m);
}

static void test_stretch__second_order_energy_is_what_the_step_adds_beyond_the_linear_strain(void **state)
{
    (void)state;
    for (int curved = 0; curved < 2; curved++) {
        struct membrane m;
        if (curved)
            make_curved(&m, 0, 5);
        else
            make(&m, 0, 5);
        /* From the flat rest shape a step w out of the plane has no linear strain: all of its energy is of
         * second order. On curves the tangent at rest stands for them, so w is small there. */
        double w[3 * NODES] = {0}, x[3 * NODES], strain, seen = 0, size = curved ? 1e-5 : 0.02;
        uint64_t seed = 11;
        for (int i = 0; i < NODES; i++) {
            m.x[3 * i] = pattern[2 * i];
            m.x[3 * i + 1] = pattern[2 * i + 1];
            m.x[3 * i + 2] = 0;
            w[3 * i + 2] = size * test_random(&seed);
        }
        double Q = dr_stretch_second_order(m.stretch, m.x, w, &strain);
        for (int i = 0; i < 3 * NODES; i++)
            x[i] = m.x[i] + w[i];
        double E = dr_stretch_energy(m.stretch, x, NULL);
        assert_true(E > 0);
        assert_close(Q, E, curved ? 1e-3 : 1e-12);
        for (int t = 0; t < 3; t++) { /* E_uu and E_vv of the same step */
            const double *grad = m.mesh->grad + 6 * t;
            for (int k = 0; k < 2; k++) {
                double slope = 0;
                for (int a = 0; a < 3; a++)
                    slope += w[3 * triangle[3 * t + a] + 2] * grad[2 * a + k];
                seen = fmax(seen, 0.5 * slope * slope);
            }
        }
        assert_close(strain, seen, 1e-12);
        release(&m);
    }
}

static void test_stretch__linear_cloth_holds_no_curves(void **state)
{
    (void)state;
    struct membrane m, c;
    make(&m, 0, 1);
    const size_t linear = dr_stretch_bytes(m.stretch);
    make_curved(&c, 0, 1);
    assert_true(linear < 128); /* four stiffnesses and a few pointers */
    assert_true(dr_stretch_bytes(c.stretch) > linear + 1000);
    release(&m);
    release(&c);
}

/* The Hessian of `triangles` of a strip, with this compression. */
static void hessian_of_strip(size_t triangles, const uint32_t *of, const double *x,
                             const drape_material *cloth, double compression)
{
    double rest[2 * MOST_NODES], stress[3 * MOST_NODES];
    struct dr_mesh *mesh;
    struct dr_stretch *stretch;
    for (int i = 0; i < MOST_NODES; i++) {
        rest[2 * i] = 0.02 * i;
        rest[2 * i + 1] = 0.03 * (i % 2) + 0.001 * i;
    }
    assert_int_equal(
        dr_mesh_new(MOST_NODES, triangles, of, of, rest, NULL, &cloth->density, NULL, &mesh, NULL), 0);
    assert_int_equal(dr_stretch_new(mesh, cloth, 1, &stretch, NULL), 0);
    dense_triangle = of;
    dr_stretch_stress(stretch, x, NULL, stress);
    dr_stretch_hessian(stretch, x, stress, compression, NULL);
    dense_triangle = triangle;
    dr_stretch_free(stretch);
    dr_mesh_free(mesh);
}

static void test_stretch__hessians_of_many_are_those_of_each_to_the_byte(void **state)
{
    (void)state;
    static double many[3 * MOST_NODES][3 * MOST_NODES];
    double x[3 * MOST_NODES];
    uint32_t strip[3 * (MOST_NODES - 2)];
    uint64_t seed = 9;
    for (uint32_t t = 0; t < MOST_NODES - 2; t++) {
        strip[3 * t] = t;
        strip[3 * t + 1] = t + 1 + t % 2;
        strip[3 * t + 2] = t + 2 - t % 2;
    }
    for (int trial = 0; trial < 40; trial++) {
        const drape_material *cloth = trial % 2 ? &CURVED : &material;
        size_t triangles = 1 + (size_t)trial % (MOST_NODES - 2);
        for (int i = 0; i < 3 * MOST_NODES; i++)
            x[i] = (i % 3 ? 0 : 0.02 * (i / 3)) + (i % 3 == 1 ? 0.03 * (i / 3 % 2) : 0) +
                   0.005 * test_random(&seed);
        memset(dense, 0, sizeof dense);
        hessian_of_strip(triangles, strip, x, cloth, trial % 3 * 0.5);
        memcpy(many, dense, sizeof many);
        memset(dense, 0, sizeof dense);
        for (size_t t = 0; t < triangles; t++)
            hessian_of_strip(1, strip + 3 * t, x, cloth, trial % 3 * 0.5);
        assert_true(fabs(dense[0][0]) > 1e-3);
        assert_memory_equal(many, dense, sizeof many);
    }
}

static void test_stretch__every_processor_finds_the_same_hessians(void **state)
{
    (void)state;
#ifdef __x86_64__
    if (!__builtin_cpu_supports("avx2"))
        skip();
    uint64_t seed = 4;
    for (int trial = 0; trial < 200; trial++) {
        struct batch batch;
        double H[45][LANES], plain[45][LANES], *number = &batch.fu[0][0];
        for (size_t i = 0; i < sizeof batch / sizeof *number; i++)
            number[i] = 10 * test_random(&seed);
        find_hessians_fast(&batch, H);
        find_hessians_in(&batch, plain);
        assert_memory_equal(H, plain, sizeof H);
    }
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_stretch__hessians_of_many_are_those_of_each_to_the_byte),
        cmocka_unit_test(test_stretch__every_processor_finds_the_same_hessians),
        cmocka_unit_test(test_stretch__gradient_is_the_difference_of_energies),
        cmocka_unit_test(test_stretch__hessian_is_the_difference_of_gradients_in_tension),
        cmocka_unit_test(test_stretch__hessian_is_positive_semidefinite_under_compression),
        cmocka_unit_test(test_stretch__uniaxial_pull_follows_the_closed_form),
        cmocka_unit_test(test_stretch__rigid_motion_costs_nothing_even_a_kilometre_away),
        cmocka_unit_test(test_stretch__predicted_stress_is_the_linear_part),
        cmocka_unit_test(test_stretch__curved_gradient_and_true_hessian_are_the_differences),
        cmocka_unit_test(test_stretch__curved_hessian_in_tension_is_the_difference_of_gradients),
        cmocka_unit_test(test_stretch__curved_hessian_is_positive_semidefinite_anywhere),
        cmocka_unit_test(test_stretch__what_the_projection_left_out_is_the_difference_of_the_hessians),
        cmocka_unit_test(test_stretch__a_softening_curve_adds_no_negative_stiffness_unless_asked),
        cmocka_unit_test(test_stretch__uniaxial_pulls_reproduce_the_curves),
        cmocka_unit_test(test_stretch__simple_shear_reproduces_its_curve),
        cmocka_unit_test(test_stretch__compressed_curves_are_linear_and_stay_finite_to_a_point),
        cmocka_unit_test(test_stretch__energy_is_the_integral_of_force_along_random_paths),
        cmocka_unit_test(test_stretch__predicted_curve_stress_follows_the_tangent),
        cmocka_unit_test(test_stretch__second_order_energy_is_what_the_step_adds_beyond_the_linear_strain),
        cmocka_unit_test(test_stretch__linear_cloth_holds_no_curves),
    };
    return cmocka_run_group_tests_name("stretch", tests, NULL, NULL);
}
