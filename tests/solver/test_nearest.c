/* test_nearest.c - nearest points and signed distances against brute force and closed forms. */
#include "test.h"

#include "nearest.h"
#include "scarce.h"
#include "shapes.h"

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* By minimising over the triangle on a fine grid of weights, then a finer one around the best: knows nothing
 * of Voronoi regions. */
static double grid_distance(const struct shape *shape, size_t t, const double p[3])
{
    double best = INFINITY, at[2] = {0, 0}, span = 1;
    for (int round = 0; round < 12; round++, span *= 0.3) {
        double from[2] = {at[0], at[1]};
        for (int i = -8; i <= 8; i++)
            for (int j = -8; j <= 8; j++) {
                double v = fmin(fmax(from[0] + span * i / 8, 0), 1);
                double w = fmin(fmax(from[1] + span * j / 8, 0), 1 - v), gap[3];
                for (size_t d = 0; d < 3; d++)
                    gap[d] = p[d] - (1 - v - w) * shape->x[3 * (size_t)shape->triangle[3 * t] + d] -
                             v * shape->x[3 * (size_t)shape->triangle[3 * t + 1] + d] -
                             w * shape->x[3 * (size_t)shape->triangle[3 * t + 2] + d];
                if (sqrt(dot(gap, gap)) < best) {
                    best = sqrt(dot(gap, gap));
                    at[0] = v;
                    at[1] = w;
                }
            }
    }
    return best;
}

static void check_places(const struct dr_nearest *nearest, const struct shape *shape, uint64_t *seed)
{
    for (int n = 0; n < 40; n++) {
        double p[3] = {test_random(seed), test_random(seed), test_random(seed)}, least = INFINITY, gap[3];
        struct dr_place place;
        for (size_t t = 0; t < shape->triangles; t++)
            least = fmin(least, grid_distance(shape, t, p));
        assert_true(dr_nearest_find(nearest, p, INFINITY, &place));
        assert_near(sqrt(place.square), least, 1e-4, 1e-2);
        assert_near(place.weight[0] + place.weight[1] + place.weight[2], 1, 1e-12, 1);
        for (size_t d = 0; d < 3; d++) {
            gap[d] = p[d];
            for (size_t k = 0; k < 3; k++)
                gap[d] -= place.weight[k] * shape->x[3 * (size_t)shape->triangle[3 * place.triangle + k] + d];
        }
        assert_near(sqrt(dot(gap, gap)), sqrt(place.square), 1e-12, 1);
        assert_false(dr_nearest_find(nearest, p, 0.999 * sqrt(place.square), &place));
    }
}

static void test_nearest__finds_the_nearest_point_and_follows_the_mesh(void **state)
{
    (void)state;
    uint64_t seed = 11;
    struct shape shape = shape_sphere((double[3]){0.1, 0, 0}, 0.6, 3);
    struct dr_nearest *nearest = NULL;
    assert_int_equal(dr_nearest_new(shape.x, shape.vertices, shape.triangle, shape.triangles, &nearest, NULL),
                     DRAPE_OK);
    check_places(nearest, &shape, &seed);
    for (size_t i = 0; i < 3 * shape.vertices; i++)
        shape.x[i] += 0.2 * test_random(&seed);
    dr_nearest_move(nearest);
    check_places(nearest, &shape, &seed);
    dr_nearest_free(nearest);
    shape_free(&shape);
}

/* A box from inside and outside: faces, edges and corners have closed forms. */
static void test_nearest__a_box_has_the_signed_distances_of_a_box(void **state)
{
    (void)state;
    uint64_t seed = 5;
    struct shape box = shape_box((double[3]){-0.3, -0.2, -0.5}, (double[3]){0.3, 0.2, 0.5});
    const double half[3] = {0.3, 0.2, 0.5};
    struct dr_nearest *nearest = NULL;
    assert_int_equal(dr_nearest_new(box.x, box.vertices, box.triangle, box.triangles, &nearest, NULL),
                     DRAPE_OK);
    int inside = 0;
    for (int n = 0; n < 2000; n++) {
        double p[3], out[3], phi, grad[3], most = -INFINITY, expected;
        for (int d = 0; d < 3; d++) {
            p[d] = 0.8 * test_random(&seed);
            out[d] = fmax(fabs(p[d]) - half[d], 0);
            most = fmax(most, fabs(p[d]) - half[d]);
        }
        expected = most < 0 ? most : sqrt(dot(out, out));
        inside += most < 0;
        assert_true(dr_nearest_distance(nearest, p, INFINITY, &phi, grad));
        assert_near(phi, expected, 1e-12, 1);
        assert_near(dot(grad, grad), 1, 1e-12, 1);
        double further[3], unused[3], next; /* along the gradient the distance grows as the way does */
        for (int d = 0; d < 3; d++)
            further[d] = p[d] + 1e-7 * grad[d];
        assert_true(dr_nearest_distance(nearest, further, INFINITY, &next, unused));
        assert_near((next - phi) / 1e-7, 1, 1e-5, 1);
    }
    assert_true(inside > 100);
    dr_nearest_free(nearest);
    shape_free(&box);
}

/* A needle's tip, where the nearest triangle alone would give the wrong sign. */
static void test_nearest__a_sharp_edge_has_the_right_sign(void **state)
{
    (void)state;
    double x[12] = {0, 0, 0, 1, 0.01, 0.4, 1, -0.01, 0.4, 1, 0, -0.4};
    uint32_t triangle[12] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
    struct dr_nearest *nearest = NULL;
    double phi, grad[3];
    assert_int_equal(dr_nearest_new(x, 4, triangle, 4, &nearest, NULL), DRAPE_OK);
    for (int i = -20; i <= 20; i++) {
        assert_true(dr_nearest_distance(nearest, (double[3]){-0.01, 0.002 * i, 0.003 * i}, 1, &phi, grad));
        assert_true(phi > 0);
    }
    assert_true(dr_nearest_distance(nearest, (double[3]){0.9, 0, 0.1}, 1, &phi, grad));
    assert_true(phi < 0);
    dr_nearest_free(nearest);
}

static void test_nearest__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct shape box = shape_box((double[3]){0, 0, 0}, (double[3]){1, 1, 1});
    struct dr_nearest *nearest = NULL;
    long before = held, n = 0;
    for (drape_status status = DRAPE_ENOMEM; status != DRAPE_OK; n++) {
        drape_error error = {0};
        countdown = n;
        status = dr_nearest_new(box.x, box.vertices, box.triangle, box.triangles, &nearest, &error);
        countdown = -1;
        assert_true(status == DRAPE_OK || (status == DRAPE_ENOMEM && error.status == status));
        assert_true(status == DRAPE_OK || held == before);
    }
    assert_true(n > 5);
    dr_nearest_free(nearest);
    assert_int_equal(held, before);
    shape_free(&box);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nearest__finds_the_nearest_point_and_follows_the_mesh),
        cmocka_unit_test(test_nearest__a_box_has_the_signed_distances_of_a_box),
        cmocka_unit_test(test_nearest__a_sharp_edge_has_the_right_sign),
        cmocka_unit_test(test_nearest__every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
