/* test_mesh.c - rest frames, neighbours, masses; what a mesh refuses. */
#include "test.h"

#include "mesh.h"

/* Two triangles on a unit square: 0 1 2 and 1 3 2. */
static const double square[] = {0, 0, 1, 0, 0, 1, 1, 1};
static const uint32_t two[] = {0, 1, 2, 1, 3, 2};
static const double density[] = {0.6};

static drape_status make(size_t nodes, size_t triangles, const uint32_t *triangle, const double *pattern,
                         struct dr_mesh **ret, drape_error *reterr)
{
    return dr_mesh_new(nodes, triangles, triangle, triangle, pattern, NULL, density, NULL, ret, reterr);
}

static void test_mesh__areas_masses_and_neighbors_of_a_square(void **state)
{
    (void)state;
    struct dr_mesh *mesh = NULL;
    assert_int_equal(make(4, 2, two, square, &mesh, NULL), DRAPE_OK);
    assert_close(mesh->area[0], 0.5, 1e-15);
    assert_close(mesh->area[1], 0.5, 1e-15);
    assert_close(mesh->mass[0], 0.1, 1e-15); /* 0.6 kg/m^2 * 0.5 m^2 / 3 */
    assert_close(mesh->mass[1], 0.2, 1e-15);
    double total = 0;
    for (int i = 0; i < 4; i++)
        total += mesh->mass[i];
    assert_close(total, 0.6, 1e-15);
    /* The shared edge 1-2 lies opposite corner 0 of triangle 0 and corner 1 of triangle 1. */
    assert_int_equal(mesh->neighbor[0], 1);
    assert_int_equal(mesh->across[0], 1);
    assert_int_equal(mesh->neighbor[4], 0);
    assert_int_equal(mesh->across[4], 0);
    for (int i = 0; i < 6; i++)
        if (i != 0 && i != 4)
            assert_int_equal(mesh->neighbor[i], DR_NONE);
    dr_mesh_free(mesh);
}

static void test_mesh__the_mean_edge_is_that_of_equal_triangles_of_the_same_area(void **state)
{
    (void)state;
    const double rhombus[] = {0, 0, 0.3, 0, 0.15, 0.15 * sqrt(3), 0.45, 0.15 * sqrt(3)};
    const double stretched[] = {2, 2};
    struct dr_mesh *mesh = NULL;
    assert_int_equal(make(4, 2, two, rhombus, &mesh, NULL), DRAPE_OK);
    assert_close(dr_mesh_area(mesh), 0.045 * sqrt(3), 1e-15);
    assert_close(dr_mesh_edge(mesh), 0.3, 1e-15);
    dr_mesh_shrink(mesh, stretched);
    assert_close(dr_mesh_area(mesh), 0.18 * sqrt(3), 1e-15);
    assert_close(dr_mesh_edge(mesh), 0.6, 1e-15);
    dr_mesh_free(mesh);
}

static void test_mesh__gradients_reproduce_a_linear_field_far_from_the_origin(void **state)
{
    (void)state;
    const double far[] = {1000, 2000, 1000.03, 2000.01, 1000.01, 2000.04};
    const uint32_t one[] = {0, 1, 2};
    struct dr_mesh *mesh = NULL;
    assert_int_equal(make(3, 1, one, far, &mesh, NULL), DRAPE_OK);
    double du = 0, dv = 0;
    for (int a = 0; a < 3; a++) { /* the field 3u - 7v */
        double value = 3 * far[2 * a] - 7 * far[2 * a + 1];
        du += value * mesh->grad[2 * a];
        dv += value * mesh->grad[2 * a + 1];
    }
    assert_near(du, 3, 1e-8, 1);
    assert_near(dv, -7, 1e-8, 1);
    dr_mesh_free(mesh);
}

static void test_mesh__refuses_a_collapsed_rest_shape(void **state)
{
    (void)state;
    const double line[] = {0, 0, 1, 0, 0.5, 1e-7, 0.5, 1};
    const uint32_t triangles[] = {0, 1, 3, 0, 1, 2};
    struct dr_mesh *mesh = NULL;
    drape_error error;
    assert_int_equal(make(4, 2, triangles, line, &mesh, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, DRAPE_AT_TRIANGLE);
    assert_int_equal(error.element, 1);
    assert_null(mesh);
}

static void test_mesh__accepts_a_sliver_of_one_to_a_thousand(void **state)
{
    (void)state;
    const double sliver[] = {0, 0, 1, 0, 0.5, 1e-3};
    const uint32_t one[] = {0, 1, 2};
    struct dr_mesh *mesh = NULL;
    assert_int_equal(make(3, 1, one, sliver, &mesh, NULL), DRAPE_OK);
    assert_close(mesh->area[0], 5e-4, 1e-12);
    dr_mesh_free(mesh);
}

static void test_mesh__refuses_equal_corners_and_edges_of_three(void **state)
{
    (void)state;
    struct dr_mesh *mesh = NULL;
    drape_error error;
    const uint32_t equal[] = {0, 1, 1};
    assert_int_equal(make(4, 1, equal, square, &mesh, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, DRAPE_AT_TRIANGLE);
    assert_int_equal(error.element, 0);

    const double five[] = {0, 0, 1, 0, 0, 1, 1, 1, 2, 2};
    const uint32_t book[] = {0, 1, 2, 1, 3, 2, 1, 2, 4}; /* edge 1-2 three times */
    assert_int_equal(make(5, 3, book, five, &mesh, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, DRAPE_AT_TRIANGLE);
    assert_int_equal(error.element, 2);
    assert_null(mesh);
}

static void test_mesh__refuses_the_same_triangle_twice(void **state)
{
    (void)state;
    struct dr_mesh *mesh = NULL;
    drape_error error;
    const uint32_t again[] = {0, 1, 2, 2, 0, 1}, back[] = {0, 1, 2, 0, 2, 1},
                   fan[] = {0, 1, 2, 1, 3, 2, 2, 3, 1};
    assert_int_equal(make(4, 2, again, square, &mesh, &error), DRAPE_EINVAL);
    assert_int_equal(error.element, 1);
    assert_string_equal(error.message, "it has the same corners as triangle 0");
    assert_int_equal(make(4, 2, back, square, &mesh, &error), DRAPE_EINVAL);
    assert_int_equal(error.element, 1);
    assert_int_equal(make(4, 3, fan, square, &mesh, &error), DRAPE_EINVAL); /* an edge of three, then */
    assert_null(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mesh__areas_masses_and_neighbors_of_a_square),
        cmocka_unit_test(test_mesh__the_mean_edge_is_that_of_equal_triangles_of_the_same_area),
        cmocka_unit_test(test_mesh__gradients_reproduce_a_linear_field_far_from_the_origin),
        cmocka_unit_test(test_mesh__refuses_a_collapsed_rest_shape),
        cmocka_unit_test(test_mesh__accepts_a_sliver_of_one_to_a_thousand),
        cmocka_unit_test(test_mesh__refuses_equal_corners_and_edges_of_three),
        cmocka_unit_test(test_mesh__refuses_the_same_triangle_twice),
    };
    return cmocka_run_group_tests_name("mesh", tests, NULL, NULL);
}
