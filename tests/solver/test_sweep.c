/* test_sweep.c - steps end before parts of the cloth meet, and not long before; judged by fine sampling. */
#include "test.h"

#include "sheets.h"
#include "sweep.h"

#define KEEP 0.2

struct cloth {
    struct shape shape;
    struct dr_mesh *mesh;
    struct dr_pairs *pairs;
    double *w; /* 3*nodes, all 0 */
};

static struct cloth cloth_new(struct shape shape)
{
    struct cloth cloth = {.shape = shape};
    cloth.mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    assert_int_equal(dr_pairs_new(cloth.mesh, &cloth.pairs, NULL), DRAPE_OK);
    cloth.w = calloc(3 * shape.vertices, sizeof *cloth.w);
    assert_non_null(cloth.w);
    return cloth;
}

static void cloth_free(struct cloth *cloth)
{
    dr_pairs_free(cloth->pairs);
    dr_mesh_free(cloth->mesh);
    shape_free(&cloth->shape);
    free(cloth->w);
}

/* Two triangles side by side in the plane y = 0, and far from each other. */
static struct shape two_triangles(void)
{
    static const double x[] = {0, 0, 0, 1, 0, 0, 0, 0, 1, 5, 0, 0, 6, 0, 0, 5, 0, 1};
    static const uint32_t triangle[] = {0, 1, 2, 3, 4, 5};
    struct shape shape = shape_new(6, 2);
    memcpy(shape.x, x, sizeof x);
    memcpy(shape.triangle, triangle, sizeof triangle);
    return shape;
}

static void random_moves(const struct cloth *cloth, double size, uint64_t *random)
{
    for (size_t i = 0; i < 3 * cloth->mesh->nodes; i++)
        cloth->w[i] = size * test_random(random);
}

static void move(const struct cloth *cloth, double t, double *ret)
{
    for (size_t i = 0; i < 3 * cloth->mesh->nodes; i++)
        ret[i] = cloth->shape.x[i] + t * cloth->w[i];
}

/* What a pair has left of the distance that counts. */
static double left_of(double square, double start)
{
    return sqrt(square) / fmin(sqrt(start), DR_SWEEP_NEAR);
}

/* Least over all pairs of what they have left at `now` of their distance at `start`; 1 if there is none. */
static double least_left(const struct cloth *cloth, const double *start, const double *now)
{
    const struct dr_pairs *pairs = cloth->pairs;
    double least = 1;
    for (uint32_t v = 0; v < cloth->mesh->nodes; v++) {
        for (size_t t = 0; t < cloth->mesh->triangles; t++) {
            const uint32_t *corner = cloth->mesh->triangle + 3 * t;
            const uint32_t node[4] = {v, corner[0], corner[1], corner[2]};
            if (!dr_pairs_shares_node(corner, v))
                least = fmin(least, left_of(dr_closest_vertex_face(now, node).square,
                                            dr_closest_vertex_face(start, node).square));
        }
    }
    for (size_t a = 0; a < pairs->sides; a++) {
        for (size_t b = 0; b < a; b++) {
            const uint32_t *p = pairs->side + 2 * a, *q = pairs->side + 2 * b;
            const uint32_t node[4] = {p[0], p[1], q[0], q[1]};
            if (p[0] != q[0] && p[0] != q[1] && p[1] != q[0] && p[1] != q[1])
                least = fmin(least, left_of(dr_closest_edge_edge(now, node).square,
                                            dr_closest_edge_edge(start, node).square));
        }
    }
    return least;
}

/* On all the way to t, no pair has less than KEEP of its distance, and nothing comes to cross. */
static void check_way(const struct cloth *cloth, double t, int samples)
{
    double *now = malloc(3 * cloth->mesh->nodes * sizeof *now);
    assert_non_null(now);
    for (int i = 1; i <= samples; i++) {
        move(cloth, t * i / samples, now);
        double left = least_left(cloth, cloth->shape.x, now);
        if (!(left >= KEEP * (1 - 1e-9)))
            print_error("at %g of %g: %.17g of a distance is left\n", t * i / samples, t, left);
        assert_true(left >= KEEP * (1 - 1e-9));
        assert_int_equal(dr_pairs_crossings(cloth->pairs, now, NULL), 0);
    }
    free(now);
}

/* What ended the step at t < 1: a pair has closed that part of what it may. */
static void check_end(const struct cloth *cloth, double t)
{
    double *now = malloc(3 * cloth->mesh->nodes * sizeof *now);
    assert_non_null(now);
    move(cloth, t, now);
    assert_true(least_left(cloth, cloth->shape.x, now) <= 1 - DR_SWEEP_CLOSED * (1 - KEEP) + 1e-9);
    free(now);
}

static const double known[] = {0.0004, 0.002, 0.01}; /* m */

/* With lists of pairs or without, a sweep finds the same. */
static double sweep(const struct cloth *cloth)
{
    double t = dr_sweep(cloth->pairs, cloth->shape.x, cloth->w, KEEP, 0);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        assert_int_equal(dr_pairs_find(cloth->pairs, cloth->shape.x, known[i], NULL), DRAPE_OK);
        double near = cloth->pairs->radius;
        assert_true(dr_sweep(cloth->pairs, cloth->shape.x, cloth->w, KEEP, near) == t);
    }
    return t;
}

/* Likewise of single moves. */
static size_t clip(struct cloth *cloth)
{
    size_t size = 3 * cloth->mesh->nodes * sizeof *cloth->w;
    double *wanted = malloc(size), *w = malloc(size);
    assert_true(wanted && w);
    memcpy(wanted, cloth->w, size);
    size_t shortened = dr_sweep_clip(cloth->pairs, cloth->shape.x, cloth->w, KEEP, 0);
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        memcpy(w, wanted, size);
        assert_int_equal(dr_pairs_find(cloth->pairs, cloth->shape.x, known[i], NULL), DRAPE_OK);
        double near = cloth->pairs->radius;
        assert_int_equal(dr_sweep_clip(cloth->pairs, cloth->shape.x, w, KEEP, near), shortened);
        assert_memory_equal(w, cloth->w, size);
    }
    free(wanted);
    free(w);
    return shortened;
}

/* ---- one t for all ---------------------------------------------------------------------------- */

static void test_sweep__a_vertex_stops_before_a_face(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(two_triangles());
    double *x = cloth.shape.x;
    const double above[] = {0.3, 4e-4, 0.3, 0.3, 1, 0.4, 0.3, 1, 0.2}; /* a tip 0.4 mm over the other */
    memcpy(x + 9, above, sizeof above);
    for (int i = 3; i < 6; i++)
        cloth.w[3 * i + 1] = -8e-4; /* through it at 0.5, a fifth of the distance left at 0.4 */
    double t = sweep(&cloth);
    assert_true(t <= 0.4 && t >= 0.36 - 1e-12);
    check_way(&cloth, t, 50);
    for (int i = 3; i < 6; i++)
        cloth.w[3 * i + 1] = -2.8e-4; /* ends just before it counts as met */
    assert_true(sweep(&cloth) == 1);
    x[10] = 0.01; /* from farther than DR_SWEEP_NEAR */
    for (int i = 3; i < 6; i++)
        cloth.w[3 * i + 1] = -0.02;
    t = sweep(&cloth);
    assert_true(t <= 0.495 + 1e-12 && t >= 0.493 - 1e-12); /* 0.1 to 0.14 mm over it */
    cloth_free(&cloth);
}

static void test_sweep__edges_stop_before_each_other(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(two_triangles());
    double *x = cloth.shape.x;
    const double crossed[] = {0, 0, 0, 1, 0, 0, 0.5, -1, 0.1, 0.5, 4e-4, -0.5, 0.5, 4e-4, 0.5, 0.4, 1, 0};
    memcpy(x, crossed, sizeof crossed);
    for (int i = 0; i < 3; i++)
        cloth.w[3 * i + 1] = 8e-4;
    double t = sweep(&cloth);
    assert_true(t <= 0.4 && t >= 0.36 - 1e-12);
    check_way(&cloth, t, 50);
    cloth_free(&cloth);
}

static void test_sweep__two_triangles_tumbling_at_random(void **state)
{
    (void)state;
    uint64_t random = 19;
    struct cloth cloth = cloth_new(two_triangles());
    int stopped = 0, free = 0;
    for (int i = 0; i < 1500; i++) {
        for (int k = 0; k < 18; k++)
            cloth.shape.x[k] = test_random(&random) + (k == 10 || k == 13 || k == 16 ? 1 : 0);
        random_moves(&cloth, i % 3 ? 1 : 3, &random);
        if (dr_pairs_crossings(cloth.pairs, cloth.shape.x, NULL))
            continue;
        double t = sweep(&cloth);
        assert_true(t > 0 && t <= 1);
        check_way(&cloth, t, 20);
        stopped += t < 1;
        free += t == 1;
        if (t < 1)
            check_end(&cloth, t);
    }
    assert_true(stopped > 200 && free > 200);
    cloth_free(&cloth);
}

static void test_sweep__crumpled_sheets_never_pass(void **state)
{
    (void)state;
    uint64_t random = 23;
    int stopped = 0;
    for (int i = 0; i < 12; i++) {
        struct cloth cloth = cloth_new(sheets_stack(4, 3, 0.01, 0.004));
        sheets_shake(&cloth.shape, 0.0015, &random);
        assert_int_equal(dr_pairs_crossings(cloth.pairs, cloth.shape.x, NULL), 0);
        random_moves(&cloth, i % 2 ? 0.01 : 0.002, &random);
        for (size_t v = 0; v < cloth.mesh->nodes; v++) /* the whole falls, layers at different speeds */
            cloth.w[3 * v + 1] -= 0.5 + (i % 4 > 1 ? 0.004 * (double)(v / 25) : 0);
        double t = sweep(&cloth);
        check_way(&cloth, t, 20);
        stopped += t < 1;
        if (t < 1)
            check_end(&cloth, t);
        cloth_free(&cloth);
    }
    assert_true(stopped > 4);
}

static void test_sweep__what_moves_together_is_free(void **state)
{
    (void)state;
    uint64_t random = 29;
    struct cloth cloth = cloth_new(sheets_stack(6, 2, 0.01, 0.0005));
    for (size_t v = 0; v < cloth.mesh->nodes; v++)
        cloth.w[3 * v + 1] = -7;
    assert_true(sweep(&cloth) == 1);
    for (size_t i = 0; i < 3 * cloth.mesh->nodes; i++)
        cloth.w[i] += 1e-4 * test_random(&random);
    assert_true(sweep(&cloth) == 1);
    cloth_free(&cloth);
}

/* What is just too far to be in a list comes near by a little less than that. */
static void test_sweep__the_nearest_of_what_is_not_listed_is_seen(void **state)
{
    (void)state;
    for (size_t i = 1; i < sizeof known / sizeof *known; i++) {
        struct cloth cloth = cloth_new(sheets_stack(6, 2, 0.01, 1.001 * known[i]));
        for (size_t v = cloth.mesh->nodes / 2; v < cloth.mesh->nodes; v++)
            cloth.w[3 * v + 1] = 1e-5 - known[i];
        double t = sweep(&cloth);
        assert_true(t > 0.5 && t < 1);
        assert_true(clip(&cloth) > 0);
        cloth_free(&cloth);
    }
}

static void test_sweep__close_sheets_slide_past_each_other(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(sheets_stack(6, 2, 0.01, 1.5e-4));
    for (size_t v = cloth.mesh->nodes / 2; v < cloth.mesh->nodes; v++)
        cloth.w[3 * v] = 0.02;
    assert_true(sweep(&cloth) == 1);
    assert_int_equal(clip(&cloth), 0);
    cloth_free(&cloth);
}

static void test_sweep__a_kilometre_away_is_as_here(void **state)
{
    (void)state;
    uint64_t random = 31;
    struct cloth cloth = cloth_new(sheets_stack(4, 2, 0.01, 0.004));
    sheets_shake(&cloth.shape, 0.001, &random);
    random_moves(&cloth, 0.01, &random);
    double here = sweep(&cloth);
    assert_true(here < 1);
    for (size_t i = 0; i < 3 * cloth.mesh->nodes; i++)
        cloth.shape.x[i] += 1000;
    assert_near(sweep(&cloth), here, 1e-6, 0);
    cloth_free(&cloth);
}

static void test_sweep__touching_and_crossing_parts_do_not_hold_the_cloth(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(two_triangles());
    const double pierced[] = {0.3, 0, 0.3, 0.3, 1, 0.4, 0.3, 1, 0.2}; /* a tip that touches the other */
    memcpy(cloth.shape.x + 9, pierced, sizeof pierced);
    for (int sign = -1; sign < 2; sign += 2) {
        for (int i = 3; i < 6; i++)
            cloth.w[3 * i + 1] = sign * 0.02;
        assert_true(sweep(&cloth) == 1);
    }
    cloth.shape.x[10] = -0.01; /* a tip that has gone through may come back, or go on */
    assert_int_equal(dr_pairs_crossings(cloth.pairs, cloth.shape.x, NULL), 2);
    for (int sign = -1; sign < 2; sign += 2) {
        for (int i = 3; i < 6; i++)
            cloth.w[3 * i + 1] = sign * 0.02;
        assert_true(sweep(&cloth) == 1);
        assert_int_equal(clip(&cloth), 0);
    }
    /* Out by the side: an edge that crosses passes an edge of the triangle that it crosses. */
    for (int i = 3; i < 6; i++) {
        cloth.w[3 * i] = -1;
        cloth.w[3 * i + 1] = 0;
    }
    assert_true(sweep(&cloth) == 1);
    cloth_free(&cloth);
}

/* A tip comes down on a triangle: it stops unless it is to be one with a corner of that. */
static void test_sweep__what_is_to_be_welded_may_meet(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(two_triangles());
    const double above[] = {0.3, 0.1, 0.3, 0.3, 1, 0.4, 0.3, 1, 0.2};
    uint32_t weld[] = {0, 1, 2, 3, 4, 5};
    memcpy(cloth.shape.x + 9, above, sizeof above);
    for (int i = 3; i < 6; i++)
        cloth.w[3 * i + 1] = -0.2;
    dr_pairs_weld(cloth.pairs, weld);
    double t = sweep(&cloth);
    assert_true(t > 0.49 && t < 0.5);
    weld[4] = 1; /* another corner: this tip and its two edges are held, but for what that corner has */
    assert_true(sweep(&cloth) == t);
    weld[3] = 0;
    weld[4] = 4;
    assert_true(sweep(&cloth) == 1);
    cloth_free(&cloth);
}

static void test_sweep__any_numbers_end(void **state)
{
    (void)state;
    const double odd[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 1e200, 1e-320, 0};
    for (size_t every = 1; every < 50; every += 7) {
        struct cloth cloth = cloth_new(sheets_stack(6, 2, 0.01, 0.003));
        uint64_t random = every;
        for (int round = 0; round < 3; round++) {
            random_moves(&cloth, 0.01, &random);
            for (size_t i = 0; i < 3 * cloth.mesh->nodes; i += every) {
                if (round % 2 == 0)
                    cloth.w[i] = odd[(i / every) % 8];
                if (round)
                    cloth.shape.x[i] = odd[(i / every + 3) % 8];
            }
            assert_int_equal(dr_pairs_find(cloth.pairs, cloth.shape.x, 0.01, NULL), DRAPE_OK);
            for (int listed = 0; listed < 2; listed++) {
                double near = listed ? cloth.pairs->radius : 0;
                double t = dr_sweep(cloth.pairs, cloth.shape.x, cloth.w, KEEP, near);
                assert_true(t >= 0 && t <= 1);
                dr_sweep_clip(cloth.pairs, cloth.shape.x, cloth.w, KEEP, near);
            }
        }
        cloth_free(&cloth);
    }
}

static void test_sweep__wild_moves_of_a_crowd_end(void **state)
{
    (void)state;
    uint64_t random = 37;
    struct cloth cloth = cloth_new(sheets_stack(30, 1, 0.01, 0)); /* 1800 triangles: 1.6 million pairs */
    sheets_shake(&cloth.shape, 0.0002, &random);
    random_moves(&cloth, 10, &random);
    double t = sweep(&cloth);
    assert_true(t > 0 && t < 1e-2);
    double *w = cloth.w;
    assert_true(dr_sweep_clip(cloth.pairs, cloth.shape.x, w, KEEP, 0) > 0);
    assert_true(sweep(&cloth) == 1);
    memset(cloth.shape.x, 0, 3 * cloth.mesh->nodes * sizeof *w); /* all in one point: nothing to keep */
    random_moves(&cloth, 0.01, &random);
    assert_true(sweep(&cloth) == 1);
    cloth_free(&cloth);
}

/* ---- single moves ----------------------------------------------------------------------------- */

static void test_clip__shortens_only_what_would_meet(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(sheets_stack(8, 2, 0.01, 0.003));
    uint64_t random = 41;
    sheets_shake(&cloth.shape, 0.0002, &random);
    size_t nodes = cloth.mesh->nodes, middle = nodes / 2 + 40; /* of the upper layer */
    for (size_t v = 0; v < nodes; v++)
        cloth.w[3 * v + 1] = -0.02;
    cloth.w[3 * middle + 1] = -0.026;
    double before[3] = {cloth.w[0], cloth.w[1], cloth.w[2]};
    size_t shortened = clip(&cloth);
    assert_true(shortened >= 4 && shortened < nodes / 3);
    assert_memory_equal(before, cloth.w, sizeof before);
    assert_true(cloth.w[3 * middle + 1] > -0.026);
    assert_true(sweep(&cloth) == 1);
    check_way(&cloth, 1, 10);
    assert_int_equal(clip(&cloth), 0);
    cloth_free(&cloth);
}

static void test_clip__random_moves_end_without_a_meeting(void **state)
{
    (void)state;
    uint64_t random = 43;
    for (int i = 0; i < 8; i++) {
        struct cloth cloth = cloth_new(sheets_stack(4, 3, 0.01, 0.004));
        sheets_shake(&cloth.shape, 0.0015, &random);
        random_moves(&cloth, i % 2 ? 0.03 : 0.004, &random);
        double *wanted = malloc(3 * cloth.mesh->nodes * sizeof *wanted);
        assert_non_null(wanted);
        memcpy(wanted, cloth.w, 3 * cloth.mesh->nodes * sizeof *wanted);
        size_t shortened = clip(&cloth), differ = 0;
        for (size_t v = 0; v < cloth.mesh->nodes; v++)
            differ += memcmp(wanted + 3 * v, cloth.w + 3 * v, 3 * sizeof *wanted) != 0;
        assert_int_equal(shortened, differ);
        assert_true(shortened > 0);
        assert_true(sweep(&cloth) == 1);
        check_way(&cloth, 1, 20);
        free(wanted);
        cloth_free(&cloth);
    }
}

static void test_clip__on_a_borrowed_processor_is_the_same(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(sheets_stack(40, 2, 0.01, 0.004));
    size_t size = 3 * cloth.mesh->nodes * sizeof *cloth.w;
    double *wanted = malloc(size), *alone = malloc(size);
    assert_true(wanted && alone);
    drape_processors *processors = drape_processors_new(2);
    assert_non_null(processors);
    struct dr_hand hand = {.processors = processors};
    dr_processors_enter(processors);
    uint64_t random = 59;
    sheets_shake(&cloth.shape, 0.001, &random);
    for (int round = 0; round < 4; round++) {
        random_moves(&cloth, 0.004, &random);
        memcpy(wanted, cloth.w, size);
        dr_pairs_lend(cloth.pairs, NULL);
        double t = dr_sweep(cloth.pairs, cloth.shape.x, cloth.w, KEEP, 0);
        size_t shortened = dr_sweep_clip(cloth.pairs, cloth.shape.x, cloth.w, KEEP, 0);
        memcpy(alone, cloth.w, size);
        memcpy(cloth.w, wanted, size);
        dr_pairs_lend(cloth.pairs, &hand);
        assert_true(t > 0 && t < 1 && dr_sweep(cloth.pairs, cloth.shape.x, cloth.w, KEEP, 0) == t);
        assert_int_equal(dr_sweep_clip(cloth.pairs, cloth.shape.x, cloth.w, KEEP, 0), shortened);
        assert_memory_equal(cloth.w, alone, size);
    }
    assert_true(hand.seconds > 0);
    dr_processors_leave(processors);
    drape_processors_free(processors);
    cloth_free(&cloth);
    free(wanted);
    free(alone);
}

static void test_clip__a_real_dress_falls_unshortened(void **state)
{
    (void)state;
    struct shape shape;
    if (!sheets_garment("../shared/data/garments/dress", &shape))
        skip();
    struct cloth cloth = cloth_new(shape);
    for (size_t v = 0; v < cloth.mesh->nodes; v++)
        for (size_t d = 0; d < 3; d++)
            cloth.w[3 * v + d] = (d == 1 ? -0.02 : 0) + 0.003 * sin(30 * shape.x[3 * v + 1] + (double)d);
    assert_true(sweep(&cloth) == 1);
    assert_int_equal(clip(&cloth), 0);
    uint64_t random = 47;
    random_moves(&cloth, 0.006, &random);
    size_t shortened = clip(&cloth);
    assert_true(shortened > 0 && shortened < cloth.mesh->nodes / 4);
    assert_true(sweep(&cloth) == 1);
    cloth_free(&cloth);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sweep__a_vertex_stops_before_a_face),
        cmocka_unit_test(test_sweep__edges_stop_before_each_other),
        cmocka_unit_test(test_sweep__two_triangles_tumbling_at_random),
        cmocka_unit_test(test_sweep__crumpled_sheets_never_pass),
        cmocka_unit_test(test_sweep__what_moves_together_is_free),
        cmocka_unit_test(test_sweep__the_nearest_of_what_is_not_listed_is_seen),
        cmocka_unit_test(test_sweep__close_sheets_slide_past_each_other),
        cmocka_unit_test(test_sweep__a_kilometre_away_is_as_here),
        cmocka_unit_test(test_sweep__touching_and_crossing_parts_do_not_hold_the_cloth),
        cmocka_unit_test(test_sweep__what_is_to_be_welded_may_meet),
        cmocka_unit_test(test_sweep__any_numbers_end),
        cmocka_unit_test(test_sweep__wild_moves_of_a_crowd_end),
        cmocka_unit_test(test_clip__shortens_only_what_would_meet),
        cmocka_unit_test(test_clip__random_moves_end_without_a_meeting),
        cmocka_unit_test(test_clip__on_a_borrowed_processor_is_the_same),
        cmocka_unit_test(test_clip__a_real_dress_falls_unshortened),
    };
    return cmocka_run_group_tests_name("sweep", tests, NULL, NULL);
}
