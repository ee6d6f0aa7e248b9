/* test_place.c - garments made larger, and their pieces moved outwards. */
#include "test.h"

#include "place.h"

/* Three triangles, apart: one faces the front (+z), one the right and up (+x +y), one up (+y). */
static struct surface three_pieces(void)
{
    const double x[27] = {0, 0, 1, 1, 0, 1, 0, 1, 1,  /* front */
                          2, 1, 0, 3, 0, 0, 2, 1, -1, /* right and up */
                          0, 3, 0, 0, 3, 1, 1, 3, 0}; /* up */
    struct surface s;
    assert_int_equal(surface_new(9, 3, true, &s), 0);
    memcpy(s.positions, x, sizeof x);
    for (uint32_t i = 0; i < 9; i++) {
        s.triangle[i] = i;
        s.pattern[2 * i] = i;
        s.pattern[2 * i + 1] = -1;
    }
    return s;
}

static void test_place__scales_the_start_about_its_middle_and_the_pattern(void **state)
{
    (void)state;
    struct surface s = three_pieces(), before = three_pieces();
    const double middle[3] = {1.5, 1.5, 0};
    place_scale(&s, 1.5);
    for (size_t i = 0; i < 27; i++) {
        assert_close(s.positions[i], middle[i % 3] + 1.5 * (before.positions[i] - middle[i % 3]), 1e-14);
    }
    for (size_t i = 0; i < 18; i++) {
        assert_close(s.pattern[i], 1.5 * before.pattern[i], 0);
    }
    surface_done(&s);
    surface_done(&before);
}

static void test_place__moves_pieces_along_the_level_part_of_their_normals(void **state)
{
    (void)state;
    struct surface s = three_pieces(), before = three_pieces();
    const double way[3][3] = {{0, 0, 0.1}, {0.1, 0, 0}, {0, 0, 0}};
    assert_int_equal(place_outwards(&s, 0.1), 0);
    for (size_t i = 0; i < 27; i++) {
        assert_near(s.positions[i] - before.positions[i], way[i / 9][i % 3], 1e-15, 1);
    }
    assert_memory_equal(s.pattern, before.pattern, 18 * sizeof *s.pattern);
    surface_done(&s);
    surface_done(&before);
}

/* A bent piece is moved as one. */
static void test_place__what_triangles_join_stays_joined(void **state)
{
    (void)state;
    const double x[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, -1};
    const uint32_t corner[6] = {0, 1, 2, 0, 2, 3}; /* one faces +z, the other -x */
    struct surface s;
    assert_int_equal(surface_new(4, 2, true, &s), 0);
    memcpy(s.positions, x, sizeof x);
    memcpy(s.triangle, corner, sizeof corner);
    assert_int_equal(place_outwards(&s, -2), 0);
    for (size_t i = 0; i < 4; i++) {
        assert_close(s.positions[3 * i] - x[3 * i], sqrt(2), 1e-15);
        assert_close(s.positions[3 * i + 1], x[3 * i + 1], 0);
        assert_close(s.positions[3 * i + 2] - x[3 * i + 2], -sqrt(2), 1e-15);
    }
    surface_done(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_place__scales_the_start_about_its_middle_and_the_pattern),
        cmocka_unit_test(test_place__moves_pieces_along_the_level_part_of_their_normals),
        cmocka_unit_test(test_place__what_triangles_join_stays_joined),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
