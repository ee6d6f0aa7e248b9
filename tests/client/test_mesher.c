/* test_mesher.c - flat outlines come back full of good triangles, their own points first. */
#include "check_surface.h"
#include "mesher.h"

/* An L of sides 1 and arms 0.4, sampled `n` points per unit length. */
static double *outline_l(size_t n, size_t *ret_points)
{
    const double corner[7][2] = {{0, 0}, {1, 0}, {1, 0.4}, {0.4, 0.4}, {0.4, 1}, {0, 1}, {0, 0}};
    double *uv = calloc(2 * 10 * n, sizeof *uv);
    size_t points = 0;
    assert_non_null(uv);
    for (int side = 0; side < 6; side++) {
        double length = hypot(corner[side + 1][0] - corner[side][0], corner[side + 1][1] - corner[side][1]);
        size_t parts = (size_t)lround(length * (double)n);
        for (size_t i = 0; i < parts; i++, points++) {
            double t = (double)i / (double)parts;
            uv[2 * points] = (1 - t) * corner[side][0] + t * corner[side + 1][0];
            uv[2 * points + 1] = (1 - t) * corner[side][1] + t * corner[side + 1][1];
        }
    }
    *ret_points = points;
    return uv;
}

static void test_mesher__fills_an_outline_with_a_reentrant_corner(void **state)
{
    (void)state;
    for (size_t n = 10; n <= 80; n *= 2) {
        struct failure failure;
        struct surface s;
        size_t points = 0, edges = 0, rim = 0;
        double smallest = 0, *outline = outline_l(n, &points);
        assert_int_equal(mesher_fill(outline, points, 1.0 / (double)n, &s, &failure), 0);
        assert_memory_equal(s.pattern, outline, 2 * points * sizeof *outline);
        assert_close(pattern_area(&s, &smallest), 0.64, 1e-12);
        assert_true(smallest > 0);
        assert_true(worst_quality(&s, true) > 0.5);
        struct edge_use *edge = surface_edges(&s, &edges);
        for (size_t i = 0; i < edges; i++) {
            rim += edge[i].forward + edge[i].backward == 1;
            assert_true(edge[i].forward <= 1 && edge[i].backward <= 1);
        }
        assert_int_equal(rim, points);
        /* as many as equilateral triangles would be, but for the border, whose share falls with n */
        assert_near((double)s.triangles, 0.64 * 4 / sqrt(3) * (double)(n * n), 0.02 + 1.5 / (double)n, 0);
        free(edge);
        free(outline);
        surface_done(&s);
    }
}

static void test_mesher__refuses_an_outline_that_crosses_itself(void **state)
{
    const double bow[8] = {0, 0, 1, 1, 1, 0, 0, 1};
    struct failure failure;
    struct surface s;
    (void)state;
    assert_int_equal(mesher_fill(bow, 4, 0.2, &s, &failure), -1);
    assert_int_equal(failure.code, EXIT_USAGE);
}

static void test_mesher__gives_the_same_mesh_twice(void **state)
{
    struct failure failure;
    struct surface a, b;
    size_t points = 0;
    double *outline = outline_l(20, &points);
    (void)state;
    assert_int_equal(mesher_fill(outline, points, 0.05, &a, &failure), 0);
    assert_int_equal(mesher_fill(outline, points, 0.05, &b, &failure), 0);
    assert_int_equal(a.triangles, b.triangles);
    assert_memory_equal(a.pattern, b.pattern, 2 * a.vertices * sizeof *a.pattern);
    assert_memory_equal(a.triangle, b.triangle, 3 * a.triangles * sizeof *a.triangle);
    free(outline);
    surface_done(&a);
    surface_done(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mesher__fills_an_outline_with_a_reentrant_corner),
        cmocka_unit_test(test_mesher__refuses_an_outline_that_crosses_itself),
        cmocka_unit_test(test_mesher__gives_the_same_mesh_twice),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
