/* test_carry.c - cloth goes where the body under it goes. */
#include "test.h"

#include "carry.h"
#include "scarce.h"
#include "shapes.h"

#define BODY_A "../shared/data/bodies/body_f_A.obj"
#define BODY_B "../shared/data/bodies/body_f_standing05_half.obj"

/* A square sheet of n x n cells. */
struct sheet {
    double *x;
    uint32_t *triangle;
    drape_scene_desc desc;
};

static struct sheet sheet_new(size_t n, double side, double height)
{
    struct sheet sheet = {calloc(3 * (n + 1) * (n + 1), sizeof(double)), calloc(6 * n * n, sizeof(uint32_t)),
                          drape_scene_desc_default()};
    assert_non_null(sheet.x);
    assert_non_null(sheet.triangle);
    for (size_t i = 0; i <= n; i++)
        for (size_t j = 0; j <= n; j++) {
            double *x = sheet.x + 3 * (i * (n + 1) + j);
            x[0] = side * ((double)i / (double)n - 0.5);
            x[1] = height;
            x[2] = side * ((double)j / (double)n - 0.5);
        }
    uint32_t *t = sheet.triangle;
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; j < n; j++, t += 6) {
            uint32_t a = i * (uint32_t)(n + 1) + j, b = a + (uint32_t)n + 1;
            memcpy(t, (uint32_t[6]){a, a + 1, b, b, a + 1, b + 1}, 6 * sizeof *t);
        }
    sheet.desc.vertices = (n + 1) * (n + 1);
    sheet.desc.triangles = 2 * n * n;
    sheet.desc.triangle = sheet.triangle;
    return sheet;
}

static void sheet_free(struct sheet *sheet)
{
    free(sheet->x);
    free(sheet->triangle);
}

static double *copy_of(const double *x, size_t count)
{
    double *copy = malloc(count * sizeof *copy);
    assert_non_null(copy);
    memcpy(copy, x, count * sizeof *copy);
    return copy;
}

/* Turns x about the axis through the origin by an angle, and shifts it. */
static void move_rigidly(const double axis[3], double angle, const double shift[3], double x[3])
{
    double length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]), along = 0, turned[3];
    for (int d = 0; d < 3; d++)
        along += axis[d] / length * x[d];
    for (int d = 0; d < 3; d++) {
        double e = axis[d] / length,
               cross = (axis[(d + 1) % 3] * x[(d + 2) % 3] - axis[(d + 2) % 3] * x[(d + 1) % 3]) / length;
        turned[d] = cos(angle) * x[d] + sin(angle) * cross + (1 - cos(angle)) * along * e;
    }
    for (int d = 0; d < 3; d++)
        x[d] = turned[d] + shift[d];
}

static void test_carry__a_rigid_motion_of_the_body_is_that_of_the_cloth(void **state)
{
    (void)state;
    static const double angle[] = {0, 0.3, -1.2, 3.14159265358979, 2.9, -3.0};
    static const double axis[3] = {0.3, -1, 2}, shift[3] = {3, -2, 0.7};
    struct shape body = shape_sphere((double[3]){0, 0, 0}, 0.2, 6);
    for (size_t n = 0; n < sizeof angle / sizeof *angle; n++) {
        struct sheet sheet = sheet_new(12, 0.8, 0.205);
        struct shape moved = body;
        moved.x = copy_of(body.x, 3 * body.vertices);
        double *expected = copy_of(sheet.x, 3 * sheet.desc.vertices);
        for (size_t v = 0; v < body.vertices; v++)
            move_rigidly(axis, angle[n], shift, moved.x + 3 * v);
        for (size_t v = 0; v < sheet.desc.vertices; v++)
            move_rigidly(axis, angle[n], shift, expected + 3 * v);
        drape_body from = shape_body(&body), to = shape_body(&moved);
        assert_int_equal(drape_carry(&sheet.desc, &from, &to, sheet.x, NULL), DRAPE_OK);
        for (size_t i = 0; i < 3 * sheet.desc.vertices; i++)
            assert_near(sheet.x[i], expected[i], 1e-12, 1);
        free(moved.x);
        free(expected);
        sheet_free(&sheet);
    }
    shape_free(&body);
}

static void test_carry__a_body_that_stays_leaves_every_bit(void **state)
{
    (void)state;
    struct shape body = shape_sphere((double[3]){0.1, 0.2, 0.3}, 0.2, 6);
    struct sheet sheet = sheet_new(12, 0.8, 0.405);
    double *before = copy_of(sheet.x, 3 * sheet.desc.vertices);
    drape_body from = shape_body(&body);
    assert_int_equal(drape_carry(&sheet.desc, &from, &from, sheet.x, NULL), DRAPE_OK);
    assert_memory_equal(sheet.x, before, 3 * sheet.desc.vertices * sizeof *before);
    free(before);
    sheet_free(&sheet);
    shape_free(&body);
}

/* Cloth over a ball that grows keeps its distance from it. */
static void test_carry__cloth_keeps_its_distance_from_a_body_that_grows(void **state)
{
    (void)state;
    struct shape body = shape_sphere((double[3]){0, 0, 0}, 0.2, 16);
    struct shape cloth = shape_sphere((double[3]){0, 0, 0}, 0.205, 12), large = body;
    large.x = copy_of(body.x, 3 * body.vertices);
    for (size_t i = 0; i < 3 * body.vertices; i++)
        large.x[i] *= 1.1;
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = cloth.vertices;
    desc.triangles = cloth.triangles;
    desc.triangle = cloth.triangle;
    drape_body from = shape_body(&body), to = shape_body(&large);
    assert_int_equal(drape_carry(&desc, &from, &to, cloth.x, NULL), DRAPE_OK);
    for (size_t v = 0; v < cloth.vertices; v++) {
        const double *x = cloth.x + 3 * v;
        assert_near(sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]), 0.225, 1e-3, 1);
    }
    free(large.x);
    shape_free(&cloth);
    shape_free(&body);
}

/* Two balls part under one sheet: no edge may take up all of it, as the one half-way would if each vertex
 * followed the nearer ball alone. A seam across the middle stays shut. */
static void test_carry__cloth_between_two_limbs_is_stretched_not_torn(void **state)
{
    (void)state;
    const double apart = 0.05;
    const size_t n = 20;
    struct shape body = shape_join(shape_sphere((double[3]){-0.2, -0.1, 0}, 0.1, 5),
                                   shape_sphere((double[3]){0.2, -0.1, 0}, 0.1, 5));
    struct shape moved = body;
    struct sheet sheet = sheet_new(n, 0.6, 0.005);
    moved.x = copy_of(body.x, 3 * body.vertices);
    for (size_t v = 0; v < body.vertices; v++)
        moved.x[3 * v] += body.x[3 * v] > 0 ? apart : -apart;
    drape_body from = shape_body(&body), to = shape_body(&moved);
    assert_int_equal(drape_carry(&sheet.desc, &from, &to, sheet.x, NULL), DRAPE_OK);
    double longest = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j <= n; j++)
            longest = fmax(longest, sheet.x[3 * ((i + 1) * (n + 1) + j)] - sheet.x[3 * (i * (n + 1) + j)]);
    assert_true(longest < 0.03 + 0.5 * 2 * apart); /* an edge of 30 mm */
    /* Above a ball the cloth follows it. */
    const double *over = sheet.x + 3 * (3 * (n + 1) + n / 2);
    assert_near(over[0], -0.21 - apart, 5e-3, 1);
    free(moved.x);
    sheet_free(&sheet);
    shape_free(&body);
}

static void test_carry__sewn_vertices_move_as_one(void **state)
{
    (void)state;
    struct shape body = shape_sphere((double[3]){0, -0.1, 0}, 0.1, 5), moved = body;
    /* Two triangles that meet at a sewn side, each with its own copy of it. */
    double x[18] = {0, 0, 0, 0, 0, 0.1, -0.1, 0, 0, 0, 0, 0, 0, 0, 0.1, 0.1, 0, 0};
    const uint32_t triangle[6] = {0, 1, 2, 3, 5, 4}, seam[4] = {0, 3, 4, 1};
    uint64_t seed = 3;
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = 6;
    desc.triangles = 2;
    desc.triangle = triangle;
    desc.seams = 2;
    desc.seam = seam;
    moved.x = copy_of(body.x, 3 * body.vertices);
    for (size_t i = 0; i < 3 * body.vertices; i++)
        moved.x[i] += 0.01 * test_random(&seed);
    drape_body from = shape_body(&body), to = shape_body(&moved);
    assert_int_equal(drape_carry(&desc, &from, &to, x, NULL), DRAPE_OK);
    assert_memory_equal(x, x + 9, 3 * sizeof *x);
    assert_memory_equal(x + 3, x + 12, 3 * sizeof *x);
    assert_true(x[0] != 0);
    free(moved.x);
    shape_free(&body);
}

static void test_carry__refuses_bodies_that_are_not_the_same_mesh(void **state)
{
    (void)state;
    struct shape body = shape_sphere((double[3]){0, 0, 0}, 0.2, 3), other = body;
    struct sheet sheet = sheet_new(2, 0.1, 0.3);
    double *before = copy_of(sheet.x, 3 * sheet.desc.vertices);
    drape_body from = shape_body(&body), to = from;
    drape_error error = {0};
    to.vertices--;
    assert_int_equal(drape_carry(&sheet.desc, &from, &to, sheet.x, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, DRAPE_AT_BODY_KEYFRAME);
    assert_string_equal(error.member, "positions");
    to = from;
    to.triangles--;
    assert_int_equal(drape_carry(&sheet.desc, &from, &to, sheet.x, &error), DRAPE_EINVAL);
    assert_string_equal(error.member, "triangle");
    other.triangle = malloc(3 * body.triangles * sizeof *other.triangle);
    assert_non_null(other.triangle);
    memcpy(other.triangle, body.triangle, 3 * body.triangles * sizeof *other.triangle);
    shape_reverse(&other);
    to.triangles++;
    to.triangle = other.triangle;
    assert_int_equal(drape_carry(&sheet.desc, &from, &to, sheet.x, &error), DRAPE_EINVAL);
    assert_string_equal(error.member, "triangle");
    to = from;
    to.kind = DRAPE_BODY_SPHERE;
    assert_int_equal(drape_carry(&sheet.desc, &from, &to, sheet.x, &error), DRAPE_EINVAL);
    assert_string_equal(error.member, "kind");
    to = from;
    sheet.x[4] = before[4] = NAN;
    assert_int_equal(drape_carry(&sheet.desc, &from, &to, sheet.x, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, DRAPE_AT_VERTEX);
    assert_int_equal(error.element, 1);
    assert_memory_equal(sheet.x, before, 3 * sheet.desc.vertices * sizeof *before);
    free(other.triangle);
    free(before);
    sheet_free(&sheet);
    shape_free(&body);
}

/* Points a few millimetres off a person go with the person. */
static void test_carry__a_person_takes_cloth_along(void **state)
{
    (void)state;
    struct shape a, b;
    if (!shape_read(BODY_A, &a))
        skip();
    assert_true(shape_read(BODY_B, &b));
    struct dr_nearest *on_a = NULL, *on_b = NULL;
    assert_int_equal(dr_nearest_new(a.x, a.vertices, a.triangle, a.triangles, &on_a, NULL), DRAPE_OK);
    assert_int_equal(dr_nearest_new(b.x, b.vertices, b.triangle, b.triangles, &on_b, NULL), DRAPE_OK);
    /* The cloth is the skin itself, 5 mm out. */
    double *x = copy_of(a.x, 3 * a.vertices), worst = 0, sum = 0, phi, n[3];
    for (size_t v = 0; v < a.vertices; v++) {
        assert_true(dr_nearest_distance(on_a, a.x + 3 * v, 1, &phi, n));
        for (size_t d = 0; d < 3; d++)
            x[3 * v + d] += 0.005 * n[d];
    }
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = a.vertices;
    desc.triangles = a.triangles;
    desc.triangle = a.triangle;
    drape_body from = shape_body(&a), to = shape_body(&b);
    double *again = copy_of(x, 3 * a.vertices);
    assert_int_equal(drape_carry(&desc, &from, &to, x, NULL), DRAPE_OK);
    assert_int_equal(drape_carry(&desc, &from, &to, again, NULL), DRAPE_OK);
    assert_memory_equal(x, again, 3 * a.vertices * sizeof *x);
    for (size_t v = 0; v < a.vertices; v++) {
        double gap = 0;
        for (size_t d = 0; d < 3; d++)
            gap += (x[3 * v + d] - b.x[3 * v + d]) * (x[3 * v + d] - b.x[3 * v + d]);
        worst = fmax(worst, sqrt(gap));
        sum += sqrt(gap);
    }
    print_message("of 5 mm: %.2f mm in the mean, %.2f mm at worst\n", 1e3 * sum / (double)a.vertices,
                  1e3 * worst);
    assert_near(sum / (double)a.vertices, 0.005, 0.0002, 1);
    assert_true(worst < 0.01);
    dr_nearest_free(on_a);
    dr_nearest_free(on_b);
    free(x);
    free(again);
    shape_free(&a);
    shape_free(&b);
}

static void test_carry__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct shape body = shape_box((double[3]){-1, -1, -1}, (double[3]){1, 0, 1}), moved = body;
    struct sheet sheet = sheet_new(2, 0.1, 0.3);
    moved.x = copy_of(body.x, 3 * body.vertices);
    for (size_t v = 0; v < body.vertices; v++)
        moved.x[3 * v] += 0.1;
    drape_body from = shape_body(&body), to = shape_body(&moved);
    long before = held, n = 0;
    for (drape_status status = DRAPE_ENOMEM; status != DRAPE_OK; n++) {
        countdown = n;
        status = drape_carry(&sheet.desc, &from, &to, sheet.x, NULL);
        countdown = -1;
        assert_true(status == DRAPE_OK || status == DRAPE_ENOMEM);
        assert_int_equal(held, before);
    }
    assert_true(n > 10);
    assert_near(sheet.x[0], 0.05, 1e-12, 1); /* once, by the call that went well */
    free(moved.x);
    sheet_free(&sheet);
    shape_free(&body);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_carry__a_rigid_motion_of_the_body_is_that_of_the_cloth),
        cmocka_unit_test(test_carry__a_body_that_stays_leaves_every_bit),
        cmocka_unit_test(test_carry__cloth_keeps_its_distance_from_a_body_that_grows),
        cmocka_unit_test(test_carry__cloth_between_two_limbs_is_stretched_not_torn),
        cmocka_unit_test(test_carry__sewn_vertices_move_as_one),
        cmocka_unit_test(test_carry__refuses_bodies_that_are_not_the_same_mesh),
        cmocka_unit_test(test_carry__a_person_takes_cloth_along),
        cmocka_unit_test(test_carry__every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
