/* test_example.c - the paper's scenes have its sizes, its held edges, and flat unstrained starts. */
#include "check_surface.h"
#include "example.h"

static struct scene build(const char *name, size_t triangles)
{
    struct scene scene;
    struct failure failure;
    const struct example *example = example_find(name);
    assert_non_null(example);
    assert_int_equal(example_build(example, triangles, &scene, &failure), 0);
    return scene;
}

/* Start and rest shape agree, everything is level and faces up. */
static void check_flat(const struct scene *scene, double area)
{
    double smallest = 0;
    const struct surface *s = &scene->cloth;
    assert_near(pattern_area(s, &smallest), area, 0.001, 0);
    assert_true(smallest > 0);
    for (size_t i = 0; i < s->vertices; i++) {
        assert_close(s->positions[3 * i], s->pattern[2 * i], 0);
        assert_close(s->positions[3 * i + 2], -s->pattern[2 * i + 1], 0);
        assert_close(s->positions[3 * i + 1], s->positions[1], 0);
    }
}

static void test_example__square_is_half_a_metre_held_by_one_edge(void **state)
{
    struct scene scene = build("square", 0);
    (void)state;
    assert_int_equal(scene.cloth.triangles, 5000);
    check_flat(&scene, 0.25);
    assert_int_equal(scene.pins, 51);
    for (size_t i = 0; i < scene.pins; i++) {
        assert_close(scene.cloth.pattern[2 * scene.pin[i] + 1], 0, 0);
    }
    assert_close(scene.material[0].density, 0.1, 0);
    assert_close(scene.material[0].warp, 10, 0);
    assert_close(scene.solver.time_step, 0.02, 0);
    scene_done(&scene);
}

static void check_held_along(const struct scene *scene, double radius)
{
    size_t on_arc = 0;
    for (size_t i = 0; i < scene->cloth.vertices; i++) {
        on_arc += fabs(hypot(scene->cloth.pattern[2 * i], scene->cloth.pattern[2 * i + 1]) - radius) < 1e-9;
    }
    for (size_t i = 0; i < scene->pins; i++) {
        const double *uv = scene->cloth.pattern + 2 * (size_t)scene->pin[i];
        assert_close(hypot(uv[0], uv[1]), radius, 1e-12);
    }
    assert_int_equal(on_arc, scene->pins);
}

static void test_example__arc_is_held_along_its_half_circle(void **state)
{
    struct scene scene = build("arc", 19000);
    (void)state;
    check_flat(&scene, 0.25 + M_PI * 0.25 * 0.25 / 2);
    check_held_along(&scene, 0.25);
    assert_near((double)scene.cloth.triangles, 19000, 0.05, 0);
    scene_done(&scene);
}

static void test_example__skirt_is_half_an_annulus_held_inside(void **state)
{
    struct scene scene = build("skirt", 19000);
    (void)state;
    check_flat(&scene, M_PI / 2 * (0.45 * 0.45 - 0.15 * 0.15));
    check_held_along(&scene, 0.15);
    assert_near((double)scene.cloth.triangles, 19000, 0.05, 0);
    scene_done(&scene);
}

static void test_example__every_one_meets_requests_at_both_ends_of_its_range(void **state)
{
    struct failure failure;
    struct scene scene;
    (void)state;
    for (const struct example *e = example_list; e->name; e++) {
        assert_int_equal(example_build(e, e->min_triangles, &scene, &failure), 0);
        assert_near((double)scene.cloth.triangles, (double)e->min_triangles, 0.25, 0);
        assert_true(worst_quality(&scene.cloth, true) > 0.3);
        scene_done(&scene);
        assert_int_equal(example_build(e, e->min_triangles - 1, &scene, &failure), -1);
        assert_int_equal(example_build(e, EXAMPLE_MAX_TRIANGLES + 1, &scene, &failure), -1);
        assert_int_equal(failure.code, EXIT_USAGE);
    }
    assert_null(example_find("triangle"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_example__square_is_half_a_metre_held_by_one_edge),
        cmocka_unit_test(test_example__arc_is_held_along_its_half_circle),
        cmocka_unit_test(test_example__skirt_is_half_an_annulus_held_inside),
        cmocka_unit_test(test_example__every_one_meets_requests_at_both_ends_of_its_range),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
