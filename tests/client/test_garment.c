/* test_garment.c - the dress is cut so that it can be sewn, and starts where nothing touches. */
#include "check_surface.h"
#include "example.h"
#include "garment.h"

static struct scene build(size_t triangles)
{
    struct scene scene = scene_default();
    struct failure failure;
    assert_int_equal(garment_build(triangles, &scene, &failure), 0);
    return scene;
}

static double pattern_distance(const struct surface *s, uint32_t a, uint32_t b)
{
    return hypot(s->pattern[2 * a] - s->pattern[2 * b], s->pattern[2 * a + 1] - s->pattern[2 * b + 1]);
}

static void test_garment__meets_the_request_with_good_triangles(void **state)
{
    (void)state;
    const size_t wanted[] = {GARMENT_MIN_TRIANGLES, 1000, 4000, 20000};
    for (size_t i = 0; i < 4; i++) {
        struct scene scene = build(wanted[i]);
        double smallest = 0;
        assert_near((double)scene.cloth.triangles, (double)wanted[i], 0.1, 0);
        pattern_area(&scene.cloth, &smallest);
        assert_true(smallest > 0);
        assert_true(worst_quality(&scene.cloth, true) > 0.45);
        /* hung round the form the pieces are hardly strained: shapes stay good */
        assert_true(worst_quality(&scene.cloth, false) > 0.4);
        scene_done(&scene);
    }
}

static void test_garment__sews_edges_of_the_same_length_vertex_by_vertex(void **state)
{
    struct scene scene = build(4000);
    const struct surface *s = &scene.cloth;
    unsigned char *used = calloc(s->vertices, 1);
    size_t panels[2] = {0, 0}, steps = 0;
    (void)state;
    assert_non_null(used);
    for (size_t i = 0; i < scene.seams; i++) {
        uint32_t a = scene.seam[2 * i], b = scene.seam[2 * i + 1];
        assert_true(a < s->vertices && b < s->vertices);
        assert_false(used[a] || used[b]);
        used[a] = used[b] = 1;
        panels[0] += s->positions[3 * a + 2] > s->positions[3 * b + 2]; /* front vertex comes first */
        if (i > 0 && scene.seam[2 * i - 2] + 1 == a) {
            /* the next stitch of the same seam: the steps along both edges agree */
            assert_near(pattern_distance(s, a, a - 1), pattern_distance(s, b, scene.seam[2 * i - 1]), 0.01,
                        0);
            steps++;
        }
    }
    assert_int_equal(panels[0], scene.seams);
    /* four seams have four beginnings, and the last stitch is at vertex 0 again */
    assert_int_equal(steps, scene.seams - 5);
    free(used);
    scene_done(&scene);
}

/* Solid angle of a triangle seen from p over 4 pi (Van Oosterom & Strackee 1983); summed over a closed
 * surface it is 1 inside and 0 outside. */
static double winding(const struct surface *body, const double *p)
{
    double sum = 0;
    for (size_t t = 0; t < body->triangles; t++) {
        double v[3][3], length[3];
        for (int k = 0; k < 3; k++) {
            const double *x = body->positions + 3 * body->triangle[3 * t + (size_t)k];
            length[k] = 0;
            for (int d = 0; d < 3; d++) {
                v[k][d] = x[d] - p[d];
                length[k] += v[k][d] * v[k][d];
            }
            length[k] = sqrt(length[k]);
        }
        double det = v[0][0] * (v[1][1] * v[2][2] - v[1][2] * v[2][1]) -
                     v[0][1] * (v[1][0] * v[2][2] - v[1][2] * v[2][0]) +
                     v[0][2] * (v[1][0] * v[2][1] - v[1][1] * v[2][0]);
        double dot01 = v[0][0] * v[1][0] + v[0][1] * v[1][1] + v[0][2] * v[1][2];
        double dot12 = v[1][0] * v[2][0] + v[1][1] * v[2][1] + v[1][2] * v[2][2];
        double dot20 = v[2][0] * v[0][0] + v[2][1] * v[0][1] + v[2][2] * v[0][2];
        sum += 2 * atan2(det, length[0] * length[1] * length[2] + dot01 * length[2] + dot12 * length[0] +
                                  dot20 * length[1]);
    }
    return sum / (4 * M_PI);
}

static double nearest_vertex(const struct surface *body, const double *p)
{
    double nearest = INFINITY;
    for (size_t i = 0; i < body->vertices; i++) {
        const double *x = body->positions + 3 * i;
        nearest = fmin(nearest, hypot(hypot(x[0] - p[0], x[1] - p[1]), x[2] - p[2]));
    }
    return nearest;
}

static void test_garment__starts_outside_the_mannequin_with_room_to_spare(void **state)
{
    struct scene scene = build(1500);
    double nearest = INFINITY;
    (void)state;
    assert_int_equal(scene.bodies, 1);
    const double inside[3] = {0, 1.1, 0};
    assert_near(winding(&scene.body[0], inside), 1, 1e-6, 0); /* the measure itself works */
    for (size_t i = 0; i < scene.cloth.vertices; i++) {
        assert_near(winding(&scene.body[0], scene.cloth.positions + 3 * i), 0, 1e-6, 1);
        nearest = fmin(nearest, nearest_vertex(&scene.body[0], scene.cloth.positions + 3 * i));
    }
    assert_true(nearest > 0.010);
    scene_done(&scene);
}

static void test_garment__faces_outwards(void **state)
{
    struct scene scene = build(1000);
    (void)state;
    for (size_t t = 0; t < scene.cloth.triangles; t++) {
        const uint32_t *v = scene.cloth.triangle + 3 * t;
        const double *a = scene.cloth.positions + 3 * v[0], *b = scene.cloth.positions + 3 * v[1];
        const double *c = scene.cloth.positions + 3 * v[2];
        double nx = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1]);
        double nz = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        assert_true(nx * a[0] + nz * a[2] > 0);
    }
    scene_done(&scene);
}

static void test_garment__refuses_too_few_triangles(void **state)
{
    struct scene scene = scene_default();
    struct failure failure;
    (void)state;
    assert_int_equal(garment_build(GARMENT_MIN_TRIANGLES - 1, &scene, &failure), -1);
    assert_int_equal(failure.code, EXIT_USAGE);
    scene_done(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_garment__meets_the_request_with_good_triangles),
        cmocka_unit_test(test_garment__sews_edges_of_the_same_length_vertex_by_vertex),
        cmocka_unit_test(test_garment__starts_outside_the_mannequin_with_room_to_spare),
        cmocka_unit_test(test_garment__faces_outwards),
        cmocka_unit_test(test_garment__refuses_too_few_triangles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
