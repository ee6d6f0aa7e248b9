/* test_turn.c - rotations of the cloth between two states, and what they make of a stale factor. */
#include "test.h"

#include "matrix.h"
#include "stretch.h"
#include "turn.h"

enum { SIDE = 6, NODES = SIDE * SIDE, N = 3 * NODES, TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1) };

static const drape_material cloth = {
    .density = 0.2, .stretch_weft = 4000, .stretch_warp = 3000, .stretch_shear = 500};

struct sheet {
    struct dr_mesh *mesh;
    struct dr_stretch *stretch;
    struct dr_matrix *A;
    double x0[N], x1[N], turn[N], weight[NODES];
};

/* A shaken sheet of 50 mm, held nowhere. */
static void make(struct sheet *s)
{
    static double pattern[2 * NODES];
    static uint32_t triangle[3 * TRIANGLES];
    uint64_t seed = 6;
    size_t count = 0;
    for (uint32_t j = 0; j + 1 < SIDE; j++)
        for (uint32_t i = 0; i + 1 < SIDE; i++) {
            uint32_t a = j * SIDE + i, cell[] = {a, a + 1, a + SIDE, a + 1, a + SIDE + 1, a + SIDE};
            memcpy(triangle + count, cell, sizeof cell);
            count += 6;
        }
    for (size_t v = 0; v < NODES; v++) {
        pattern[2 * v] = 0.01 * (double)(v % SIDE);
        pattern[2 * v + 1] = 0.01 * (double)(v / SIDE);
        for (size_t d = 0; d < 3; d++)
            s->x0[3 * v + d] = (d < 2 ? pattern[2 * v + d] : 0) + 0.001 * test_random(&seed);
    }
    assert_int_equal(dr_mesh_new(NODES, TRIANGLES, triangle, triangle, pattern, NULL, &cloth.density, NULL,
                                 &s->mesh, NULL),
                     0);
    assert_int_equal(dr_stretch_new(s->mesh, &cloth, 1, &s->stretch, NULL), 0);
    assert_int_equal(dr_matrix_new(s->mesh, NULL, NULL, 0, DR_CHOLESKY, NULL, &s->A, NULL), 0);
}

static void release(struct sheet *s)
{
    dr_matrix_free(s->A);
    dr_stretch_free(s->stretch);
    dr_mesh_free(s->mesh);
}

/* x1 = x0 turned by `angle` about (2, -1, 2)/3 (Rodrigues), and moved. */
static void turn_sheet(struct sheet *s, double angle)
{
    const double k[3] = {2.0 / 3, -1.0 / 3, 2.0 / 3};
    for (size_t v = 0; v < NODES; v++) {
        const double *x = s->x0 + 3 * v, along = k[0] * x[0] + k[1] * x[1] + k[2] * x[2];
        const double across[3] = {k[1] * x[2] - k[2] * x[1], k[2] * x[0] - k[0] * x[2],
                                  k[0] * x[1] - k[1] * x[0]};
        for (size_t d = 0; d < 3; d++)
            s->x1[3 * v + d] = cos(angle) * x[d] + sin(angle) * across[d] + (1 - cos(angle)) * along * k[d] +
                               0.1 * (double)d;
    }
}

static void newton_step(struct sheet *s, const double *x, const double *b, double *w)
{
    static double stress[3 * TRIANGLES];
    bool out_of_memory;
    dr_stretch_stress(s->stretch, x, NULL, stress);
    dr_matrix_set_base(s->A, 100);
    dr_matrix_reset(s->A);
    dr_stretch_hessian(s->stretch, x, stress, 0, s->A);
    assert_true(dr_matrix_factorise(s->A, &out_of_memory));
    dr_matrix_solve(s->A, 1, (const double *[]){b}, (double *[]){w});
}

static double distance(const double *a, const double *b)
{
    double sum = 0;
    for (size_t i = 0; i < N; i++)
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    return sqrt(sum);
}

static void test_turn__a_stale_factor_turned_gives_the_newton_step(void **state)
{
    (void)state;
    struct sheet s;
    static const double none[N];
    double f[N] = {0}, exact[N], stale[N], b[N], unused[N];
    make(&s);
    turn_sheet(&s, 0.8);
    dr_stretch_energy(s.stretch, s.x1, f);
    newton_step(&s, s.x1, f, exact);
    newton_step(&s, s.x0, f, unused); /* the factor is that of x0 now */
    assert_true(distance(unused, exact) > 10 * distance(exact, none));
    dr_turn_take(s.mesh, s.x0, s.x1, s.weight, s.turn);
    dr_turn_apply(NODES, s.turn, true, f, b);
    dr_matrix_solve(s.A, 1, (const double *[]){b}, (double *[]){stale});
    dr_turn_apply(NODES, s.turn, false, stale, stale);
    assert_true(distance(stale, exact) < 1e-9 * distance(exact, none));
    release(&s);
}

static void test_turn__large_turns_and_collapsed_triangles_count_as_none(void **state)
{
    (void)state;
    struct sheet s;
    make(&s);
    for (int large = 0; large < 2; large++) {
        double angle = (large ? 121 : 119) * acos(-1) / 180, expected = large ? 0 : tan(angle / 2) * 2 / 3;
        turn_sheet(&s, angle);
        dr_turn_take(s.mesh, s.x0, s.x1, s.weight, s.turn);
        for (size_t v = 0; v < NODES; v++)
            assert_near(s.turn[3 * v], expected, 1e-9, 1);
    }
    memset(s.x1, 0, sizeof s.x1);
    dr_turn_take(s.mesh, s.x0, s.x1, s.weight, s.turn);
    for (size_t i = 0; i < N; i++)
        assert_true(s.turn[i] == 0);
    release(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_turn__a_stale_factor_turned_gives_the_newton_step),
        cmocka_unit_test(test_turn__large_turns_and_collapsed_triangles_count_as_none),
    };
    return cmocka_run_group_tests_name("turn", tests, NULL, NULL);
}
