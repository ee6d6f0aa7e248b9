/* test_tack.c - stitches to points of bodies: the spring's derivatives, the point, where it is lifted to. */
#include "test.h"

#include "dense.h"
#include "tack.h"

enum { NODES = 3 };

static const struct dr_tack tacks[] = {
    {.vertex = 7, .node = 2, .at = {0.1, 0.2, 0.3}},
    {.vertex = 1, .node = 0, .first = {0.11, 0.2, 0.3}, .at = {-0.1, 0, 0.05}},
    {.vertex = 0, .node = 2, .first = {-0.1, 0, 0.05}, .at = {0.11, 0.2, 0.3}}, /* two at one node */
};

static double energy(const void *term, const double *x, double *g)
{
    return dr_tacks_energy(term, x, g);
}

static void hessian(const void *term, const double *x, double exact, struct dr_matrix *A)
{
    (void)x, (void)exact;
    dr_tacks_hessian(term, A);
}

static void test_tack__forces_and_hessian_are_the_differences(void **state)
{
    (void)state;
    const double x[3 * NODES] = {0.01, 0.02, 0.03, 0, 0, 0, 0.1, 0.21, 0.29};
    struct dr_tacks *made;
    assert_int_equal(dr_tacks_new(tacks, 3, false, &made, NULL), DRAPE_OK);
    dense_check_derivatives(energy, hessian, made, NULL, x, NODES, 1e-4, 1e-9); /* quadratic: exact */
    struct dr_matrix A = {0};
    dr_tacks_hessian(made, &A);
    assert_true(A.a[0][0] == DRAPE_TACK_STIFFNESS && A.a[3][3] == 0 && A.a[6][6] == 2 * DRAPE_TACK_STIFFNESS);
    dr_tacks_free(made);
}

static void test_tack__holds_by_vertex_where_the_pieces_are_apart_and_moves(void **state)
{
    (void)state;
    double x[3 * NODES] = {-0.1, 0, 0.05, 0.11, 0.2, 0.3}; /* where they hold at first */
    const double further[3] = {0.11, 0.2, 0.31};
    struct dr_tacks *made;
    assert_int_equal(dr_tacks_new(tacks + 1, 2, true, &made, NULL), DRAPE_OK);
    assert_true(dr_tacks_energy(made, x, NULL) == 0);
    dr_tacks_move(made, 0, further);
    assert_close(dr_tacks_energy(made, x, NULL), 0.5 * DRAPE_TACK_STIFFNESS * 1e-4, 1e-12);
    dr_tacks_free(made);
}

static void test_tack__a_triangles_point_goes_with_the_triangle(void **state)
{
    (void)state;
    const uint32_t triangle[3] = {2, 0, 1};
    const double positions[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, weight[2] = {0.5, 0.2};
    double point[3];
    dr_tack_point(triangle, positions, weight, point);
    assert_close(point[2], 0.5, 1e-15);
    assert_close(point[0], 0.2, 1e-15);
    assert_close(point[1], 0.3, 1e-15);
}

static void test_tack__lies_no_nearer_than_the_offset(void **state)
{
    (void)state;
    const drape_body ball = {.kind = DRAPE_BODY_SPHERE, .offset = 0.004, .radius = 0.1};
    struct dr_body *body;
    assert_int_equal(dr_body_new(&ball, 0, &body, NULL), 0);
    static const struct {
        double radius, lifted;
    } cases[] = {{0.1, 0.104}, {0.1001, 0.104}, {0.104, 0.104}, {0.12, 0.12},
                 {0.5, 0.5},   {0.0701, 0.104}, {0.05, 0.05}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const double direction[3] = {0.48, -0.6, 0.64};
        double point[3];
        for (int d = 0; d < 3; d++)
            point[d] = cases[i].radius * direction[d];
        dr_tack_lift(body, point);
        for (int d = 0; d < 3; d++)
            assert_near(point[d], cases[i].lifted * direction[d], 1e-12, 1);
    }
    dr_body_free(body);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_tack__forces_and_hessian_are_the_differences),
        cmocka_unit_test(test_tack__holds_by_vertex_where_the_pieces_are_apart_and_moves),
        cmocka_unit_test(test_tack__a_triangles_point_goes_with_the_triangle),
        cmocka_unit_test(test_tack__lies_no_nearer_than_the_offset),
    };
    return cmocka_run_group_tests_name("tack", tests, NULL, NULL);
}
