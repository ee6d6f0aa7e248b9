/* test_weld.c - what is welded of a body, and what is left as it is. */
#include "test.h"

#include "weld.h"

/* A cube of eight vertices, counter-clockwise from outside. */
static const uint32_t CUBE[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                  2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};

/* `vertices` corners taken from CUBE by `corner`, so that vertex i is corner[i] of the cube. */
static struct mesh make(const uint32_t *corner, size_t vertices, size_t triangles)
{
    struct mesh mesh = {.vertices = vertices, .triangles = triangles};
    mesh.positions = calloc(3 * vertices, sizeof *mesh.positions);
    mesh.triangle = calloc(3 * triangles, sizeof *mesh.triangle);
    assert_true(mesh.positions && mesh.triangle);
    for (size_t i = 0; i < vertices; i++)
        for (size_t k = 0; k < 3; k++)
            mesh.positions[3 * i + k] = corner[i] >> k & 1 ? 1 : i % 2 ? 0.0 : -0.0;
    return mesh;
}

static void test_weld__a_cube_of_36_vertices_becomes_one_of_eight(void **state)
{
    (void)state;
    struct mesh mesh = make(CUBE, 36, 12);
    for (uint32_t i = 0; i < 36; i++)
        mesh.triangle[i] = i;
    assert_int_equal(weld_body(&mesh), 0);
    size_t used = 0;
    for (uint32_t i = 0; i < 36; i++) {
        assert_int_equal(CUBE[mesh.triangle[i]], CUBE[i]); /* in the same place */
        used += mesh.triangle[i] == i;
    }
    assert_int_equal(used, 8);
    mesh_done(&mesh);
}

static void test_weld__closed_pieces_that_touch_are_left_apart(void **state)
{
    (void)state;
    static const uint32_t TWICE[16] = {0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7};
    struct mesh mesh = make(TWICE, 16, 24);
    for (uint32_t i = 0; i < 36; i++) {
        mesh.triangle[i] = CUBE[i];
        mesh.triangle[36 + i] = 8 + CUBE[i];
    }
    assert_int_equal(weld_body(&mesh), 0);
    for (uint32_t i = 0; i < 36; i++) {
        assert_int_equal(mesh.triangle[i], CUBE[i]);
        assert_int_equal(mesh.triangle[36 + i], 8 + CUBE[i]);
    }
    mesh_done(&mesh);
}

static void test_weld__without_vertices_at_one_place_nothing_changes(void **state)
{
    (void)state;
    static const uint32_t CORNERS[8] = {0, 1, 2, 3, 4, 5, 6, 7};
    struct mesh mesh = make(CORNERS, 8, 11); /* open: a triangle is missing */
    memcpy(mesh.triangle, CUBE, 33 * sizeof *CUBE);
    assert_int_equal(weld_body(&mesh), 0);
    assert_memory_equal(mesh.triangle, CUBE, 33 * sizeof *CUBE);
    mesh_done(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_weld__a_cube_of_36_vertices_becomes_one_of_eight),
        cmocka_unit_test(test_weld__closed_pieces_that_touch_are_left_apart),
        cmocka_unit_test(test_weld__without_vertices_at_one_place_nothing_changes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
