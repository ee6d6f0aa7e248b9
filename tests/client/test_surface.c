/* test_surface.c - joining meshes, and normals that see through seams. */
#include "check_surface.h"

/* The unit square in the plane z = 0, cut along its diagonal: vertices 0 3 and 2 5 are at the same place. */
static struct surface cut_square(void)
{
    const double x[18] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, 1, 0, 1, 1, 0};
    const uint32_t v[6] = {0, 1, 2, 3, 5, 4};
    struct surface s;
    assert_int_equal(surface_new(6, 2, false, &s), 0);
    memcpy(s.positions, x, sizeof x);
    memcpy(s.triangle, v, sizeof v);
    return s;
}

static void test_surface__normals_are_shared_across_a_seam(void **state)
{
    struct surface s = cut_square();
    (void)state;
    s.positions[14] = 1; /* fold the second triangle up by 45 degrees */
    float *n = surface_normals(&s);
    assert_non_null(n);
    assert_memory_equal(n, n + 9, 3 * sizeof *n);
    assert_memory_equal(n + 6, n + 15, 3 * sizeof *n);
    assert_true(n[2] > 0.7f && n[2] < 0.99f); /* between the two triangles' own */
    assert_close(n[5], 1, 1e-6);              /* the free corner keeps its own */
    free(n);
    surface_done(&s);
}

static void test_surface__append_shifts_indices_and_keeps_patterns(void **state)
{
    struct surface whole = {0}, part;
    (void)state;
    assert_int_equal(surface_new(3, 1, true, &part), 0);
    part.triangle[1] = 1;
    part.triangle[2] = 2;
    part.pattern[5] = 7;
    part.positions[8] = 9;
    assert_int_equal(surface_append(&whole, &part), 0);
    assert_int_equal(surface_append(&whole, &part), 0);
    assert_int_equal(whole.vertices, 6);
    assert_int_equal(whole.triangle[5], 5);
    assert_close(whole.pattern[11], 7, 0);
    assert_close(whole.positions[17], 9, 0);
    surface_done(&part);
    surface_done(&whole);
}

static void test_surface__refuses_sizes_beyond_its_limit(void **state)
{
    struct surface s;
    (void)state;
    assert_int_equal(surface_new(SURFACE_MAX + 1, 1, false, &s), -1);
    assert_int_equal(surface_new(1, (size_t)-1, false, &s), -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_surface__normals_are_shared_across_a_seam),
        cmocka_unit_test(test_surface__append_shifts_indices_and_keeps_patterns),
        cmocka_unit_test(test_surface__refuses_sizes_beyond_its_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
