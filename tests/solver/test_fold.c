/* test_fold.c - hinges with a rest angle: the angle and its sign, derivatives, what is left out. */
#include "test.h"

#include "dense.h"
#include "fold.h"

enum { NODES = 5, HINGES = 2 };

#define DEGREE (M_PI / 180)

/* Two hinges, one the other way round, on three triangles; nodes 1 and 2 are the edge of both. */
static const struct dr_hinge hinges[HINGES] = {{{0, 1, 2, 3}, 0.02, 1.1}, {{2, 0, 1, 4}, 0.03, -0.4}};
static const double positions[3 * NODES] = {0.001, 0.002, -0.001, 0.02,  0.001, 0.003,  0.008, 0.017,
                                            0.006, 0.012, -0.014, 0.009, -0.01, 0.0115, -0.004};

struct crease {
    struct dr_fold *fold;
    uint32_t link[2 * (1 + DR_HINGE_LINKS * HINGES)]; /* the first is not ours */
};

static void make(struct crease *crease)
{
    crease->link[0] = crease->link[1] = 0;
    for (int i = 0; i < HINGES; i++)
        dr_hinge_links(hinges + i, crease->link + 2 * (1 + DR_HINGE_LINKS * i));
    assert_int_equal(dr_fold_new(hinges, HINGES, 1, &crease->fold, NULL), DRAPE_OK);
}

static double energy(const void *term, const double *x, double *g)
{
    return dr_fold_energy(term, x, g);
}

static void hessian(const void *term, const double *x, double exact, struct dr_matrix *A)
{
    dr_fold_hessian(term, x, exact, A);
}

static void test_fold__moments_and_true_hessian_are_the_differences(void **state)
{
    (void)state;
    struct crease crease;
    make(&crease);
    dense_check_derivatives(energy, hessian, crease.fold, crease.link, positions, NODES, 1e-8, 1e-6);
    dr_fold_free(crease.fold);
}

static void test_fold__without_the_second_derivatives_the_hessian_is_semidefinite(void **state)
{
    (void)state;
    struct crease crease;
    make(&crease);
    struct dr_matrix semi = {.link = crease.link}, whole = {.link = crease.link};
    double p[3 * NODES], q[3 * NODES] = {0}, largest = 0;
    uint64_t seed = 5;
    dr_fold_hessian(crease.fold, positions, 0, &semi);
    dr_fold_hessian(crease.fold, positions, 1, &whole);
    dense_check_semidefinite(&semi, NODES);
    for (size_t i = 0; i < 3 * NODES; i++)
        p[i] = test_random(&seed);
    dr_fold_left_out(crease.fold, positions, p, q);
    for (size_t i = 0; i < 3 * NODES; i++)
        largest = fmax(largest, fabs(q[i]));
    assert_true(largest > 10); /* N/m */
    for (size_t i = 0; i < 3 * NODES; i++) {
        double expected = 0;
        for (size_t j = 0; j < 3 * NODES; j++)
            expected += (whole.a[i][j] - semi.a[i][j]) * p[j];
        assert_near(q[i], expected, 1e-12, largest);
    }
    dr_fold_free(crease.fold);
}

static void test_fold__does_not_see_rigid_motions(void **state)
{
    (void)state;
    struct crease crease;
    double moved[3 * NODES];
    make(&crease);
    dense_move_rigidly(positions, NODES, moved);
    assert_close(dr_fold_energy(crease.fold, moved, NULL), dr_fold_energy(crease.fold, positions, NULL),
                 1e-11);
    dr_fold_free(crease.fold);
}

/* A sheet in the plane z = 0, its normals up, bent down by `angle` along the x axis: a mountain from above.
 */
static void bend_down(double angle, double x[12])
{
    const double flat[12] = {0, 0, 0, 0.02, 0, 0, 0.013, 0.015, 0, 0.005, 0, 0};
    memcpy(x, flat, sizeof flat);
    x[10] = -0.012 * cos(angle);
    x[11] = -0.012 * sin(angle);
}

static void test_fold__a_mountain_seen_from_the_normals_side_is_positive(void **state)
{
    (void)state;
    double x[12];
    for (int degrees = -179; degrees <= 179; degrees += 2) {
        const struct dr_hinge from_left = {{0, 1, 2, 3}, 1, 0}, from_right = {{1, 0, 3, 2}, 1, 0};
        bend_down(degrees * DEGREE, x);
        assert_near(dr_hinge_angle(&from_left, x), degrees * DEGREE, 1e-13, 1);
        assert_near(dr_hinge_angle(&from_right, x), degrees * DEGREE, 1e-13, 1);
    }
}

/* Past a half turn the angle goes on, up to half a turn from half the rest angle. */
static void test_fold__angles_go_on_past_a_full_fold(void **state)
{
    (void)state;
    const struct dr_hinge full = {{0, 1, 2, 3}, 1, M_PI}, other = {{0, 1, 2, 3}, 1, -M_PI};
    double x[12];
    for (int degrees = -89; degrees < 270; degrees += 2) {
        bend_down(degrees * DEGREE, x);
        assert_near(dr_hinge_angle(&full, x), degrees * DEGREE, 1e-13, 1);
        bend_down(-degrees * DEGREE, x);
        assert_near(dr_hinge_angle(&other, x), -degrees * DEGREE, 1e-13, 1);
    }
}

/* A triangle pressed flat onto its edge has no angle: nothing is pulled, nothing becomes infinite. */
static void test_fold__a_collapsed_triangle_stays_finite(void **state)
{
    (void)state;
    const struct dr_hinge hinge = {{0, 1, 2, 3}, 1, 1};
    uint32_t link[2 * DR_HINGE_LINKS];
    double x[12], g[12] = {0}, q[12] = {0};
    struct dr_fold *fold;
    dr_hinge_links(&hinge, link);
    struct dr_matrix A = {.link = link};
    bend_down(0, x);
    x[10] = 0;
    assert_int_equal(dr_fold_new(&hinge, 1, 0, &fold, NULL), DRAPE_OK);
    assert_true(dr_fold_energy(fold, x, g) == 0);
    dr_fold_hessian(fold, x, 1, &A);
    dr_fold_left_out(fold, x, x, q);
    for (int i = 0; i < 12; i++)
        assert_true(g[i] == 0 && q[i] == 0 && A.a[i][i] == 0);
    dr_fold_free(fold);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fold__moments_and_true_hessian_are_the_differences),
        cmocka_unit_test(test_fold__without_the_second_derivatives_the_hessian_is_semidefinite),
        cmocka_unit_test(test_fold__does_not_see_rigid_motions),
        cmocka_unit_test(test_fold__a_mountain_seen_from_the_normals_side_is_positive),
        cmocka_unit_test(test_fold__angles_go_on_past_a_full_fold),
        cmocka_unit_test(test_fold__a_collapsed_triangle_stays_finite),
    };
    return cmocka_run_group_tests_name("fold", tests, NULL, NULL);
}
