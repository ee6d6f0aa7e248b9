/* test_matrix.c - assembly into slots and the solve, against dense arithmetic. */
#include "test.h"

#include "matrix.h"
#include "scarce.h"

/* A 4x4 grid of nodes with two diagonals' worth of triangles, nodes 0 and 5 held. */
#define SIDE  4
#define NODES (SIDE * SIDE)
#define N     (3 * NODES)

struct system {
    struct dr_mesh *mesh;
    struct dr_bend_stiffness *bend;
    double dense[N][N];
    uint32_t link[4];
};

static void add_dense(struct system *s, uint32_t a, uint32_t b, int i, int j, double value)
{
    s->dense[3 * a + (uint32_t)i][3 * b + (uint32_t)j] += value;
}

static void make(struct system *s)
{
    static double pattern[2 * NODES];
    static uint32_t triangle[6 * (SIDE - 1) * (SIDE - 1)];
    bool fixed[NODES] = {[0] = true, [5] = true};
    const double density = 0.3;
    size_t count = 0;
    memset(s, 0, sizeof *s);
    for (uint32_t i = 0; i < NODES; i++) {
        pattern[2 * i] = 0.1 * (i % SIDE);
        pattern[2 * i + 1] = 0.1 * (i / SIDE);
    }
    for (uint32_t j = 0; j + 1 < SIDE; j++)
        for (uint32_t i = 0; i + 1 < SIDE; i++) {
            uint32_t a = j * SIDE + i, cell[] = {a, a + 1, a + SIDE, a + 1, a + SIDE + 1, a + SIDE};
            memcpy(triangle + count, cell, sizeof cell);
            count += 6;
        }
    assert_int_equal(
        dr_mesh_new(NODES, count / 3, triangle, triangle, pattern, NULL, &density, fixed, &s->mesh, NULL), 0);

    /* A made-up bending stiffness: a chain 0-2-4-... far off the triangles' pattern. */
    s->bend = calloc(1, sizeof *s->bend);
    s->bend->nodes = NODES;
    s->bend->start = calloc(NODES + 1, sizeof *s->bend->start);
    s->bend->row = calloc(2 * NODES, sizeof *s->bend->row);
    s->bend->value = calloc(2 * NODES, sizeof *s->bend->value);
    size_t at = 0;
    for (uint32_t j = 0; j < NODES; j++) {
        s->bend->start[j] = at;
        s->bend->row[at] = j;
        s->bend->value[at++] = 2;
        if (j + 7 < NODES) {
            s->bend->row[at] = j + 7;
            s->bend->value[at++] = -0.25;
        }
    }
    s->bend->start[NODES] = at;
    s->link[0] = 3, s->link[1] = 12, s->link[2] = 5, s->link[3] = 15; /* the second touches a held node */
}

static void release(struct system *s)
{
    free(s->bend->start);
    free(s->bend->row);
    free(s->bend->value);
    free(s->bend);
    dr_mesh_free(s->mesh);
}

/* Assembles the same random but positive definite system both ways. */
static struct dr_matrix *assemble(struct system *s, enum dr_factor factor)
{
    struct dr_matrix *A = NULL;
    uint64_t seed = 5;
    const double dt = 0.1;
    assert_int_equal(dr_matrix_new(s->mesh, s->bend, s->link, 2, factor, NULL, &A, NULL), DRAPE_OK);
    dr_matrix_set_base(A, 1 / (dt * dt));
    dr_matrix_reset(A);
    for (uint32_t i = 0; i < NODES; i++)
        for (int d = 0; d < 3; d++)
            add_dense(s, i, i, d, d, s->mesh->mass[i] / (dt * dt));
    for (uint32_t j = 0; j < NODES; j++)
        for (size_t k = s->bend->start[j]; k < s->bend->start[j + 1]; k++)
            for (int d = 0; d < 3; d++) {
                add_dense(s, s->bend->row[k], j, d, d, s->bend->value[k]);
                if (s->bend->row[k] != j)
                    add_dense(s, j, s->bend->row[k], d, d, s->bend->value[k]);
            }
    for (size_t t = 0; t < s->mesh->triangles; t++) { /* a random positive semi-definite 9x9 each */
        double r[9][4], H[9][9];
        for (int i = 0; i < 9; i++)
            for (int k = 0; k < 4; k++)
                r[i][k] = test_random(&seed);
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++) {
                H[i][j] = 0;
                for (int k = 0; k < 4; k++)
                    H[i][j] += r[i][k] * r[j][k];
            }
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++)
                add_dense(s, s->mesh->triangle[3 * t + (size_t)(i / 3)],
                          s->mesh->triangle[3 * t + (size_t)(j / 3)], i % 3, j % 3, H[i][j]);
        for (int i = 0; i < 9; i++) /* only the lower triangle may be read */
            for (int j = i + 1; j < 9; j++)
                H[i][j] = NAN;
        dr_matrix_add_triangle(A, t, H);
    }
    for (uint32_t i = 0; i < NODES; i += 3) {
        const double H[6] = {3, 0.5, 2, -0.25, 0.125, 4};
        const int row[] = {0, 1, 1, 2, 2, 2}, column[] = {0, 0, 1, 0, 1, 2};
        dr_matrix_add_node(A, i, H);
        for (int k = 0; k < 6; k++) {
            add_dense(s, i, i, row[k], column[k], H[k]);
            if (row[k] != column[k])
                add_dense(s, i, i, column[k], row[k], H[k]);
        }
    }
    for (size_t i = 0; i < 2; i++) {
        dr_matrix_add_link(A, i, 1.5);
        for (int d = 0; d < 3; d++) {
            uint32_t a = s->link[2 * i], b = s->link[2 * i + 1];
            add_dense(s, a, a, d, d, 1.5);
            add_dense(s, b, b, d, d, 1.5);
            add_dense(s, a, b, d, d, -1.5);
            add_dense(s, b, a, d, d, -1.5);
        }
    }
    return A;
}

static void test_matrix__solve_leaves_no_residual_in_dense_arithmetic(void **state)
{
    (void)state;
    static struct system s;
    make(&s);
    struct dr_matrix *A = assemble(&s, DR_CHOLESKY);
    assert_int_equal(dr_matrix_free_nodes(A), NODES - 2);
    double b0[N], b1[N], w0[N], w1[N];
    uint64_t seed = 8;
    for (int i = 0; i < N; i++) {
        b0[i] = test_random(&seed);
        b1[i] = test_random(&seed);
    }
    bool memory;
    for (int round = 0; round < 2; round++) { /* the second factorisation reuses the first's memory */
        assert_true(dr_matrix_factorise(A, &memory));
        dr_matrix_solve(A, 2, (const double *[]){b0, b1}, (double *[]){w0, w1});
    }
    for (int i = 0; i < N; i++) {
        bool fixed = s.mesh->held[i / 3];
        double r0 = -b0[i], r1 = -b1[i];
        for (int j = 0; j < N; j++) {
            r0 += s.dense[i][j] * w0[j];
            r1 += s.dense[i][j] * w1[j];
        }
        if (fixed)
            assert_true(w0[i] == 0 && w1[i] == 0);
        else
            assert_true(fabs(r0) < 1e-12 && fabs(r1) < 1e-12);
    }
    dr_matrix_free(A);
    release(&s);
}

static void test_matrix__multiply_is_dense_arithmetic_on_the_free_nodes(void **state)
{
    (void)state;
    static struct system s;
    make(&s);
    struct dr_matrix *A = assemble(&s, DR_CHOLESKY);
    double p[N], q[N];
    uint64_t seed = 9;
    for (int i = 0; i < N; i++)
        p[i] = test_random(&seed);
    dr_matrix_multiply(A, p, q);
    for (int i = 0; i < N; i++) {
        double sum = 0;
        for (int j = 0; j < N; j++)
            sum += s.mesh->held[i / 3] || s.mesh->held[j / 3] ? 0 : s.dense[i][j] * p[j];
        assert_near(q[i], sum, 1e-12, 1);
    }
    dr_matrix_free(A);
    release(&s);
}

/* So many nodes that dissection orders them. */
static void test_matrix__a_dissected_matrix_is_solved(void **state)
{
    (void)state;
    enum { WIDE = 40, ALL = WIDE * WIDE };
    static double pattern[2 * ALL], b[3 * ALL], w[3 * ALL], q[3 * ALL];
    static uint32_t triangle[6 * (WIDE - 1) * (WIDE - 1)];
    static bool fixed[ALL] = {[3] = true, [ALL / 2] = true};
    const double density = 0.3;
    struct dr_mesh *mesh;
    struct dr_matrix *A;
    size_t count = 0;
    uint64_t seed = 2;
    for (uint32_t i = 0; i < ALL; i++) {
        pattern[2 * i] = 0.1 * (i % WIDE);
        pattern[2 * i + 1] = 0.1 * (i / WIDE);
        for (size_t d = 0; d < 3; d++)
            b[3 * i + d] = test_random(&seed);
    }
    for (uint32_t j = 0; j + 1 < WIDE; j++)
        for (uint32_t i = 0; i + 1 < WIDE; i++) {
            uint32_t a = j * WIDE + i, cell[] = {a, a + 1, a + WIDE, a + 1, a + WIDE + 1, a + WIDE};
            memcpy(triangle + count, cell, sizeof cell);
            count += 6;
        }
    assert_int_equal(
        dr_mesh_new(ALL, count / 3, triangle, triangle, pattern, NULL, &density, fixed, &mesh, NULL), 0);
    assert_int_equal(dr_matrix_new(mesh, NULL, NULL, 0, DR_CHOLESKY, NULL, &A, NULL), 0);
    dr_matrix_set_base(A, 100);
    dr_matrix_reset(A);
    for (size_t t = 0; t < mesh->triangles; t++) {
        double r[9], H[9][9];
        for (int i = 0; i < 9; i++)
            r[i] = test_random(&seed);
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++)
                H[i][j] = r[i] * r[j] + (i == j);
        dr_matrix_add_triangle(A, t, H);
    }
    bool memory;
    assert_true(dr_matrix_factorise(A, &memory));
    dr_matrix_solve(A, 1, (const double *[]){b}, (double *[]){w});
    dr_matrix_multiply(A, w, q);
    for (size_t i = 0; i < 3 * ALL; i++)
        assert_near(q[i], fixed[i / 3] ? 0 : b[i], 1e-12, 1);
    dr_matrix_free(A);
    dr_mesh_free(mesh);
}

static void test_matrix__one_and_two_right_hand_sides_give_the_same_bytes(void **state)
{
    (void)state;
    static struct system s;
    make(&s);
    struct dr_matrix *A = assemble(&s, DR_CHOLESKY), *B;
    memset(s.dense, 0, sizeof s.dense);
    B = assemble(&s, DR_CHOLESKY);
    double b[N], w0[N], w1[N];
    for (int i = 0; i < N; i++)
        b[i] = i;
    bool memory;
    assert_true(dr_matrix_factorise(A, &memory));
    assert_true(dr_matrix_factorise(B, &memory));
    dr_matrix_solve(A, 1, (const double *[]){b}, (double *[]){w0});
    dr_matrix_solve(B, 1, (const double *[]){b}, (double *[]){w1});
    assert_memory_equal(w0, w1, sizeof w0);
    dr_matrix_free(A);
    dr_matrix_free(B);
    release(&s);
}

static void test_matrix__an_indefinite_matrix_is_told_from_lack_of_memory(void **state)
{
    (void)state;
    static struct system s;
    make(&s);
    struct dr_matrix *A = assemble(&s, DR_CHOLESKY);
    dr_matrix_add_node(A, 9, (const double[6]){-1000, 0, 0, 0, 0, 0});
    bool memory = true;
    assert_false(dr_matrix_factorise(A, &memory));
    assert_false(memory);
    dr_matrix_free(A);
    release(&s);
}

/* One free node: the factor's fullest row has three entries. Definite, and proven so, while the lowest
 * curvature is above c. */
static void test_matrix__lowered_by_round_off_it_still_stands_or_is_not_proven(void **state)
{
    (void)state;
    const double pattern[] = {0, 0, 1, 0, 0, 1}, density = 1;
    const uint32_t one[] = {0, 1, 2};
    const bool fixed[] = {false, true, true};
    struct dr_mesh *mesh;
    struct dr_matrix *A;
    assert_int_equal(dr_mesh_new(3, 1, one, one, pattern, NULL, &density, fixed, &mesh, NULL), 0);
    assert_int_equal(dr_matrix_new(mesh, NULL, NULL, 0, DR_CHOLESKY, NULL, &A, NULL), 0);
    const double g = (3 + 2) * 0x1p-53, large = 1e6;
    const double c = g / (1 - 2 * g) * 3 * large;
    const double curvature[] = {large, 1e-3, 1.01 * c, 0.99 * c, 0, -1e-3};
    for (size_t i = 0; i < sizeof curvature / sizeof *curvature; i++) {
        /* two stiff directions and one of the curvature in question */
        const double stiff = (3 * large - curvature[i]) / 2;
        bool memory;
        dr_matrix_set_base(A, 0);
        dr_matrix_reset(A);
        dr_matrix_add_node(A, 0, (const double[6]){stiff, 0, curvature[i], 0, 0, stiff});
        dr_matrix_lower_by_round_off(A);
        bool proven = dr_matrix_factorise(A, &memory);
        print_message("  curvature %g beside %g: %s\n", curvature[i], large,
                      proven ? "proven" : "not proven");
        assert_int_equal(proven, curvature[i] > c);
    }
    dr_matrix_free(A);
    dr_mesh_free(mesh);
}

static void test_matrix__a_cloth_held_everywhere_has_nothing_to_solve(void **state)
{
    (void)state;
    const double pattern[] = {0, 0, 1, 0, 0, 1}, density = 1;
    const uint32_t one[] = {0, 1, 2};
    const bool fixed[] = {true, true, true};
    struct dr_mesh *mesh;
    struct dr_matrix *A;
    assert_int_equal(dr_mesh_new(3, 1, one, one, pattern, NULL, &density, fixed, &mesh, NULL), 0);
    assert_int_equal(dr_matrix_new(mesh, NULL, one, 1, DR_CHOLESKY, NULL, &A, NULL), 0);
    double b[9] = {1, 2, 3}, w[9] = {7, 7, 7, 7, 7, 7, 7, 7, 7}, H[9][9] = {{0}};
    bool memory;
    dr_matrix_set_base(A, 100);
    dr_matrix_reset(A);
    dr_matrix_add_triangle(A, 0, H);
    dr_matrix_add_triangles(A, 0, 1, (const double[45][DR_MATRIX_BATCH]){{0}});
    dr_matrix_add_link(A, 0, 100);
    dr_matrix_add_pair(A, 0, H[0]);
    dr_matrix_add_between(A, 0, 1, (const double[3][3]){{0}});
    assert_true(dr_matrix_has(A, 0, 1));
    assert_true(dr_matrix_factorise(A, &memory));
    dr_matrix_solve(A, 1, (const double *[]){b}, (double *[]){w});
    for (int i = 0; i < 9; i++)
        assert_true(w[i] == 0);
    assert_true(dr_matrix_bytes(A) > 0);
    dr_matrix_free(A);
    dr_mesh_free(mesh);
}

static void test_matrix__batches_of_triangles_add_the_bytes_of_each(void **state)
{
    (void)state;
    struct system s;
    make(&s);
    for (size_t size = 1; size <= DR_MATRIX_BATCH; size++) {
        struct dr_matrix *A[2];
        double p[3 * NODES], q[2][3 * NODES];
        uint64_t seed = 17;
        for (int i = 0; i < 3 * NODES; i++)
            p[i] = test_random(&seed);
        for (int k = 0; k < 2; k++) {
            assert_int_equal(dr_matrix_new(s.mesh, s.bend, s.link, 2, DR_CHOLESKY, NULL, &A[k], NULL),
                             DRAPE_OK);
            dr_matrix_set_base(A[k], 1);
            dr_matrix_reset(A[k]);
        }
        for (size_t t = 0; t < s.mesh->triangles; t += size) {
            size_t count = s.mesh->triangles - t < size ? s.mesh->triangles - t : size;
            double batch[45][DR_MATRIX_BATCH];
            memset(batch, 0xff, sizeof batch); /* NaN where nothing may be read */
            for (size_t k = 0; k < count; k++) {
                double H[9][9] = {{0}};
                for (size_t i = 0; i < 9; i++)
                    for (size_t j = 0; j <= i; j++)
                        H[i][j] = batch[i * (i + 1) / 2 + j][k] = test_random(&seed);
                dr_matrix_add_triangle(A[0], t + k, H);
            }
            dr_matrix_add_triangles(A[1], t, count, batch);
        }
        for (int k = 0; k < 2; k++) {
            dr_matrix_multiply(A[k], p, q[k]);
            dr_matrix_free(A[k]);
        }
        assert_true(fabs(q[0][3 * s.link[0]]) > 0.01); /* of a free node */
        assert_memory_equal(q[0], q[1], sizeof q[0]);
    }
    release(&s);
}

static void test_matrix__one_that_could_not_be_linked_anew_can_be_counted_and_freed(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct system s;
    const uint32_t link[] = {0, 15, 3, 12};
    make(&s);
    long before = held, n = 0;
    for (bool failed = true; failed; n++) {
        struct dr_matrix *A;
        assert_int_equal(dr_matrix_new(s.mesh, s.bend, s.link, 2, DR_SINGLE, NULL, &A, NULL), 0);
        size_t whole = dr_matrix_bytes(A);
        fail_at(n);
        drape_status status = dr_matrix_relink(A, link, 2, NULL);
        failed = has_failed();
        assert_int_equal(status, failed ? DRAPE_ENOMEM : DRAPE_OK);
        assert_in_range(dr_matrix_bytes(A), 1, failed ? whole : 2 * whole);
        dr_matrix_free(A);
        assert_int_equal(held, before);
    }
    assert_true(n > 30);
    release(&s);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_matrix__batches_of_triangles_add_the_bytes_of_each),
        cmocka_unit_test(test_matrix__solve_leaves_no_residual_in_dense_arithmetic),
        cmocka_unit_test(test_matrix__multiply_is_dense_arithmetic_on_the_free_nodes),
        cmocka_unit_test(test_matrix__a_dissected_matrix_is_solved),
        cmocka_unit_test(test_matrix__one_and_two_right_hand_sides_give_the_same_bytes),
        cmocka_unit_test(test_matrix__an_indefinite_matrix_is_told_from_lack_of_memory),
        cmocka_unit_test(test_matrix__lowered_by_round_off_it_still_stands_or_is_not_proven),
        cmocka_unit_test(test_matrix__a_cloth_held_everywhere_has_nothing_to_solve),
        cmocka_unit_test(test_matrix__one_that_could_not_be_linked_anew_can_be_counted_and_freed),
    };
    return cmocka_run_group_tests_name("matrix", tests, NULL, NULL);
}
