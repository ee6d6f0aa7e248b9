/* test_coarsen.c - fewer, larger triangles that are still the same garment. */
#include "test.h"

#include "coarsen.h"
#include "mesh.h"
#include "scarce.h"
#include "shapes.h"

#define SIDE 0.4 /* m: of a panel */

/* Two square panels of n x n cells, of the same pattern, sewn along their sides u = 0 and u = SIDE: a tube.
 * The left third is of material 1. */
struct tube {
    size_t row;
    double *x, *pattern;
    uint32_t *triangle, *seam, *material;
    drape_scene_desc desc;
};

static const drape_material fabric[2] = {
    {.density = 0.2, .stretch_weft = 400, .stretch_warp = 400, .stretch_shear = 100},
    {.density = 0.3, .stretch_weft = 800, .stretch_warp = 800, .stretch_shear = 200}};

static struct tube tube_new(size_t n)
{
    size_t row = n + 1, per = row * row, s = 0, t = 0;
    struct tube tube = {row,
                        calloc(6 * per, sizeof(double)),
                        calloc(4 * per, sizeof(double)),
                        calloc(12 * n * n, sizeof(uint32_t)),
                        calloc(4 * row, sizeof(uint32_t)),
                        calloc(4 * n * n, sizeof(uint32_t)),
                        drape_scene_desc_default()};
    assert_true(tube.x && tube.pattern && tube.triangle && tube.seam && tube.material);
    for (size_t v = 0; v < 2 * per; v++) {
        double *x = tube.x + 3 * v, *p = tube.pattern + 2 * v;
        p[0] = SIDE * (double)(v % row) / (double)n;
        p[1] = SIDE * (double)(v % per / row) / (double)n;
        x[0] = p[0];
        x[1] = p[1];
        x[2] = v < per ? 0 : 0.3;
    }
    for (size_t c = 0; c < 2 * n * n; c++, t += 2) {
        uint32_t a = (uint32_t)(c / (n * n) * per + c % (n * n) / n * row + c % n), b = a + 1,
                 d = a + (uint32_t)row, e = d + 1;
        memcpy(tube.triangle + 3 * t, c % 2 ? (uint32_t[]){a, b, e, a, e, d} : (uint32_t[]){a, b, d, b, e, d},
               6 * sizeof a);
        tube.material[t] = tube.material[t + 1] = c % n < n / 3;
    }
    for (uint32_t i = 0; i < 2 * row; i++) {
        uint32_t a = i / 2 * (uint32_t)row + i % 2 * (uint32_t)n;
        tube.seam[s++] = a;
        tube.seam[s++] = a + (uint32_t)per;
    }
    tube.desc.vertices = 2 * per;
    tube.desc.triangles = t;
    tube.desc.seams = s / 2;
    tube.desc.materials = 2;
    tube.desc.positions = tube.x;
    tube.desc.pattern = tube.pattern;
    tube.desc.triangle = tube.triangle;
    tube.desc.seam = tube.seam;
    tube.desc.material = fabric;
    tube.desc.triangle_material = tube.material;
    return tube;
}

static void tube_free(struct tube *tube)
{
    free(tube->x);
    free(tube->pattern);
    free(tube->triangle);
    free(tube->seam);
    free(tube->material);
}

static struct dr_coarse *coarsen(const drape_scene_desc *desc, double edge)
{
    struct dr_coarse *coarse = NULL;
    drape_error error = {0};
    if (dr_coarsen(desc, edge, &coarse, &error) < 0)
        fail_msg("%s", error.message);
    return coarse;
}

/* Nothing is refused of what is sewn, held by a body far away. */
static void assert_scene(const drape_scene_desc *desc)
{
    drape_body ground = {
        .kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {0, -10, 0}, .radius = 1, .friction = 0.3};
    drape_scene_desc scene = *desc;
    drape_error error = {0};
    if (!scene.bodies) {
        scene.body = &ground;
        scene.bodies = 1;
    }
    if (drape_scene_check(&scene, &error) < 0)
        fail_msg("%s at %d %d", error.message, (int)error.place, (int)error.element);
}

/* Twice the signed area in the pattern, and over the sum of squared sides: 1 for equal sides. */
static double area2(const drape_scene_desc *desc, size_t t, double *ret_shape)
{
    const double *p[3];
    double squares = 0;
    for (size_t k = 0; k < 3; k++)
        p[k] = desc->pattern + 2 * (size_t)desc->triangle[3 * t + k];
    for (size_t k = 0; k < 3; k++) {
        double u = p[(k + 1) % 3][0] - p[k][0], v = p[(k + 1) % 3][1] - p[k][1];
        squares += u * u + v * v;
    }
    double twice = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[2][0] - p[0][0]) * (p[1][1] - p[0][1]);
    *ret_shape = 2 * sqrt(3) * twice / squares;
    return twice;
}

/* Of the triangles of one material; none is turned over or a sliver. */
static double area_of(const drape_scene_desc *desc, uint32_t material, double least_shape)
{
    double sum = 0, shape;
    for (size_t t = 0; t < desc->triangles; t++) {
        double twice = area2(desc, t, &shape);
        assert_true(shape > least_shape);
        if (!desc->triangle_material || desc->triangle_material[t] == material)
            sum += twice / 2;
    }
    return sum;
}

/* The fine vertex at that place with that pattern. */
static uint32_t fine_of(const drape_scene_desc *fine, const drape_scene_desc *coarse, uint32_t v)
{
    for (uint32_t i = 0; i < fine->vertices; i++)
        if (!memcmp(fine->positions + 3 * (size_t)i, coarse->positions + 3 * (size_t)v, 3 * sizeof(double)) &&
            !memcmp(fine->pattern + 2 * (size_t)i, coarse->pattern + 2 * (size_t)v, 2 * sizeof(double)))
            return i;
    fail_msg("no vertex of the fine mesh is where %u of the coarse one is", v);
    return 0;
}

static void test_coarsen__a_mesh_that_is_coarse_already_stays(void **state)
{
    (void)state;
    struct tube tube = tube_new(10);
    struct dr_coarse *coarse = coarsen(&tube.desc, SIDE / 10);
    const drape_scene_desc *desc = &coarse->desc;
    assert_int_equal(desc->vertices, tube.desc.vertices);
    assert_int_equal(desc->triangles, tube.desc.triangles);
    assert_int_equal(desc->seams, tube.desc.seams);
    assert_memory_equal(desc->positions, tube.x, 3 * desc->vertices * sizeof *tube.x);
    assert_memory_equal(desc->pattern, tube.pattern, 2 * desc->vertices * sizeof *tube.x);
    assert_memory_equal(desc->triangle, tube.triangle, 3 * desc->triangles * sizeof *tube.triangle);
    assert_memory_equal(desc->seam, tube.seam, 2 * desc->seams * sizeof *tube.seam);
    double *x = calloc(3 * desc->vertices, sizeof *x);
    dr_coarse_carry(coarse, desc->positions, x);
    assert_memory_equal(x, tube.x, 3 * desc->vertices * sizeof *x);
    free(x);
    dr_coarse_free(coarse);
    tube_free(&tube);
}

static void test_coarsen__triangles_are_as_many_as_their_size_says(void **state)
{
    (void)state;
    static const double edge[] = {0.02, 0.03, 0.05};
    for (size_t i = 0; i < 3; i++) {
        struct tube tube = tube_new(40);
        struct dr_coarse *coarse = coarsen(&tube.desc, edge[i]);
        double equal = 2 * SIDE * SIDE / (sqrt(3) / 4 * edge[i] * edge[i]);
        assert_true((double)coarse->desc.triangles > 0.9 * equal);
        assert_true((double)coarse->desc.triangles < 1.4 * equal);
        assert_scene(&coarse->desc);
        dr_coarse_free(coarse);
        tube_free(&tube);
    }
}

static void test_coarsen__pieces_and_fabrics_keep_their_area(void **state)
{
    (void)state;
    struct tube tube = tube_new(42);
    struct dr_coarse *coarse = coarsen(&tube.desc, 0.035);
    assert_true(coarse->desc.triangles < tube.desc.triangles / 6);
    assert_close(area_of(&coarse->desc, 1, 0.3), 2 * SIDE * SIDE / 3, 1e-12);
    assert_close(area_of(&coarse->desc, 0, 0.3), 2 * SIDE * SIDE / 3 * 2, 1e-12);
    dr_coarse_free(coarse);
    tube_free(&tube);
}

static void test_coarsen__seams_match_one_to_one(void **state)
{
    (void)state;
    struct tube tube = tube_new(40);
    struct dr_coarse *coarse = coarsen(&tube.desc, 0.03);
    const drape_scene_desc *desc = &coarse->desc;
    assert_true(desc->seams < tube.desc.seams / 2);
    size_t at_sides = 0;
    for (size_t s = 0; s < desc->seams; s++) {
        uint32_t a = fine_of(&tube.desc, desc, desc->seam[2 * s]);
        assert_int_equal(fine_of(&tube.desc, desc, desc->seam[2 * s + 1]), a + tube.row * tube.row);
    }
    for (size_t v = 0; v < desc->vertices; v++)
        at_sides += desc->pattern[2 * v] == 0 || desc->pattern[2 * v] == SIDE;
    assert_int_equal(at_sides, 2 * desc->seams); /* no vertex between them is left alone */
    dr_coarse_free(coarse);
    tube_free(&tube);
}

static void test_coarsen__what_is_held_or_lined_is_kept(void **state)
{
    (void)state;
    struct tube tube = tube_new(40);
    uint32_t pin[] = {845, 846, 1000}, line[16], row = (uint32_t)tube.row;
    for (uint32_t i = 0; i < 8; i++) { /* along a row, and along a column */
        line[2 * i] = 20 * row + 20 + (i < 4 ? i : (i - 4) * row);
        line[2 * i + 1] = line[2 * i] + (i < 4 ? 1 : row);
    }
    drape_elastic elastic = {line, 4, 0.8, 10};
    drape_fold fold = {line + 8, 4, 1, 0.01};
    drape_tack tack = {.vertex = 1700, .triangle = DRAPE_NO_TRIANGLE, .point = {0, -9, 0}};
    drape_body ball = {.kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {0, -10, 0}, .radius = 1};
    tube.desc.pins = 3;
    tube.desc.pin = pin;
    tube.desc.elastics = tube.desc.folds = tube.desc.tacks = tube.desc.bodies = 1;
    tube.desc.elastic = &elastic;
    tube.desc.fold = &fold;
    tube.desc.tack = &tack;
    tube.desc.body = &ball;
    struct dr_coarse *coarse = coarsen(&tube.desc, 0.04);
    const drape_scene_desc *desc = &coarse->desc;
    assert_true(desc->triangles < tube.desc.triangles / 4);
    assert_int_equal(desc->pins, 3);
    for (size_t i = 0; i < 3; i++)
        assert_int_equal(fine_of(&tube.desc, desc, desc->pin[i]), pin[i]);
    assert_int_equal(desc->elastic[0].edges, 4);
    assert_int_equal(desc->fold[0].edges, 4);
    for (size_t i = 0; i < 8; i++) {
        assert_int_equal(fine_of(&tube.desc, desc, desc->elastic[0].edge[i]), line[i]);
        assert_int_equal(fine_of(&tube.desc, desc, desc->fold[0].edge[i]), line[8 + i]);
    }
    assert_int_equal(fine_of(&tube.desc, desc, desc->tack[0].vertex), 1700);
    assert_scene(desc); /* edges of lines are edges of the cloth */
    dr_coarse_free(coarse);
    tube_free(&tube);
}

static void test_coarsen__carried_up_an_affine_map_stays_one(void **state)
{
    (void)state;
    static const double map[2][3][3] = {{{1, 2, 3}, {-1, 0.5, 0}, {0, 0.2, 5}},
                                        {{0, 1, -7}, {2, 2, 1}, {1, -1, 0}}}; /* panels of one pattern */
    struct tube tube = tube_new(30);
    struct dr_coarse *coarse = coarsen(&tube.desc, 0.035);
    const drape_scene_desc *desc = &coarse->desc;
    double *x = calloc(3 * desc->vertices, sizeof *x), *fine = calloc(3 * tube.desc.vertices, sizeof *fine);
    size_t per = tube.row * tube.row;
    assert_true(x && fine);
    for (size_t v = 0; v < desc->vertices; v++)
        for (size_t d = 0; d < 3; d++) {
            const double *row = map[desc->positions[3 * v + 2] > 0][d];
            x[3 * v + d] = row[0] * desc->pattern[2 * v] + row[1] * desc->pattern[2 * v + 1] + row[2];
        }
    dr_coarse_carry(coarse, x, fine);
    for (size_t v = 0; v < tube.desc.vertices; v++)
        for (size_t d = 0; d < 3; d++) {
            const double *row = map[v >= per][d];
            assert_near(fine[3 * v + d],
                        row[0] * tube.pattern[2 * v] + row[1] * tube.pattern[2 * v + 1] + row[2], 1e-12, 1);
        }
    for (size_t i = 0; i < 3 * tube.desc.vertices; i++) /* outlines are straight: all lie within */
        assert_true(coarse->weight[i] > -1e-9);
    free(x);
    free(fine);
    dr_coarse_free(coarse);
    tube_free(&tube);
}

static void test_coarsen__round_outlines_stay_round(void **state)
{
    (void)state;
    struct tube tube = tube_new(40); /* its first panel becomes a disc */
    for (size_t v = 0; v < tube.desc.vertices; v++) {
        double *p = tube.pattern + 2 * v, x = 2 * p[0] / SIDE - 1, y = 2 * p[1] / SIDE - 1;
        p[0] = SIDE / 2 * x * sqrt(1 - y * y / 2);
        p[1] = SIDE / 2 * y * sqrt(1 - x * x / 2);
    }
    tube.desc.seams = 0;
    tube.desc.vertices /= 2;
    tube.desc.triangles /= 2;
    tube.desc.triangle_material = NULL;
    const double edge = 0.03;
    struct dr_coarse *coarse = coarsen(&tube.desc, edge);
    assert_true(coarse->desc.triangles < tube.desc.triangles / 4);
    double flat = area_of(&tube.desc, 0, 0), area = area_of(&coarse->desc, 0, 0.1);
    assert_true(area < flat && area > flat * 0.98);
    size_t outline = 0;
    for (size_t v = 0; v < coarse->desc.vertices; v++) {
        const double *p = coarse->desc.pattern + 2 * v;
        outline += hypot(p[0], p[1]) > SIDE / 2 - 1e-9;
    }
    assert_true(outline > 20 && outline < 60); /* of 160; a sixteenth of 30 mm allows chords of 39 mm */
    dr_coarse_free(coarse);
    tube_free(&tube);
}

static void test_coarsen__a_vertex_of_no_triangle_is_left_out(void **state)
{
    (void)state;
    struct tube tube = tube_new(20);
    size_t last = tube.desc.vertices - 1; /* a corner of the second panel; its triangles go */
    size_t count = 0;
    for (size_t t = 0; t < tube.desc.triangles; t++) {
        const uint32_t *corner = tube.triangle + 3 * t;
        if (corner[0] != last && corner[1] != last && corner[2] != last)
            memmove(tube.triangle + 3 * count++, corner, 3 * sizeof *corner);
    }
    assert_true(count < tube.desc.triangles);
    tube.desc.triangles = count;
    tube.desc.triangle_material = NULL;
    tube.desc.seams--; /* its seam was the last */
    uint32_t pin[] = {(uint32_t)last, 0};
    tube.desc.pin = pin;
    tube.desc.pins = 2;
    struct dr_coarse *coarse = coarsen(&tube.desc, 0.04);
    double *fine = calloc(3 * tube.desc.vertices, sizeof *fine);
    fine[3 * last] = 42;
    dr_coarse_carry(coarse, coarse->desc.positions, fine);
    assert_true(fine[3 * last] == 42 && fine[3 * last + 1] == 0);
    assert_int_equal(coarse->desc.pins, 1);
    assert_scene(&coarse->desc);
    free(fine);
    dr_coarse_free(coarse);
    tube_free(&tube);
}

/* The pattern ("vt u v" lines, one for each vertex) and the seams of a garment beside its mesh. */
static void read_pattern(const char *path, double *pattern, uint32_t *seam, size_t *ret_seams)
{
    char name[256], line[256];
    size_t v = 0, s = 0;
    snprintf(name, sizeof name, "%s.obj", path);
    FILE *file = fopen(name, "r");
    while (fgets(line, sizeof line, file))
        v += sscanf(line, "vt %lf %lf", pattern + 2 * v, pattern + 2 * v + 1) == 2;
    fclose(file);
    snprintf(name, sizeof name, "%s.seams", path);
    assert_non_null(file = fopen(name, "r"));
    for (unsigned i, j; fgets(line, sizeof line, file);)
        if (sscanf(line, "%u %u", &i, &j) == 2) {
            seam[s++] = i - 1;
            seam[s++] = j - 1;
        }
    fclose(file);
    *ret_seams = s / 2;
}

static void test_coarsen__garments_stay_garments(void **state)
{
    (void)state;
    static const char *const path[] = {"../shared/data/garments/shirt", "../shared/data/garments/skirt8",
                                       "../shared/data/garments/dress"};
    for (size_t g = 0; g < 3; g++) {
        struct shape shape = {NULL, NULL, 0, 0};
        char name[256];
        snprintf(name, sizeof name, "%s.obj", path[g]);
        if (!shape_read(name, &shape))
            skip();
        drape_scene_desc desc = drape_scene_desc_default();
        double *pattern = calloc(2 * shape.vertices, sizeof *pattern);
        uint32_t *seam = calloc(2 * shape.vertices, sizeof *seam);
        read_pattern(path[g], pattern, seam, &desc.seams);
        desc.vertices = shape.vertices;
        desc.triangles = shape.triangles;
        desc.materials = 1;
        desc.positions = shape.x;
        desc.pattern = pattern;
        desc.triangle = shape.triangle;
        desc.seam = seam;
        desc.material = fabric;
        struct dr_coarse *coarse = coarsen(&desc, 0.024);
        assert_true(coarse->desc.triangles < desc.triangles * 3 / 10);
        assert_close(area_of(&coarse->desc, 0, 0.3), area_of(&desc, 0, 0), 1e-3);
        assert_scene(&coarse->desc);
        for (size_t i = 0; i < 3 * coarse->fine; i++)
            assert_true(coarse->weight[i] > -0.15); /* beside curved outlines */
        dr_coarse_free(coarse);
        free(pattern);
        free(seam);
        shape_free(&shape);
    }
}

static void test_coarsen__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct tube tube = tube_new(12);
    uint32_t line[] = {6, 7};
    drape_elastic elastic = {line, 1, 0.8, 10};
    drape_fold fold = {line, 1, 1, 0.01};
    tube.desc.elastics = tube.desc.folds = 1;
    tube.desc.elastic = &elastic;
    tube.desc.fold = &fold;
    long before = held, n = 0;
    bool failed = true;
    for (; failed; n++) {
        struct dr_coarse *coarse = NULL;
        countdown = n;
        drape_status status = dr_coarsen(&tube.desc, 0.06, &coarse, NULL);
        failed = countdown < 0;
        countdown = -1;
        assert_true(failed || status == DRAPE_OK); /* qsort can do without */
        assert_true((status == DRAPE_OK) == (coarse != NULL));
        dr_coarse_free(coarse);
        assert_int_equal(held, before);
    }
    assert_true(n > 20);
    tube_free(&tube);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_coarsen__a_mesh_that_is_coarse_already_stays),
        cmocka_unit_test(test_coarsen__triangles_are_as_many_as_their_size_says),
        cmocka_unit_test(test_coarsen__pieces_and_fabrics_keep_their_area),
        cmocka_unit_test(test_coarsen__seams_match_one_to_one),
        cmocka_unit_test(test_coarsen__what_is_held_or_lined_is_kept),
        cmocka_unit_test(test_coarsen__carried_up_an_affine_map_stays_one),
        cmocka_unit_test(test_coarsen__round_outlines_stay_round),
        cmocka_unit_test(test_coarsen__a_vertex_of_no_triangle_is_left_out),
        cmocka_unit_test(test_coarsen__garments_stay_garments),
        cmocka_unit_test(test_coarsen__every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
