/* test_scene.c - what is printed is JSON of the contract, with arrays of the right lengths. */
#include "test.h"

#include <jansson.h>

#include "example.h"

static json_t *print_and_parse(const struct scene *scene)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&text, &bytes);
    json_error_t error;
    assert_non_null(file);
    assert_int_equal(scene_write(file, scene), 0);
    fclose(file);
    json_t *json = json_loadb(text, bytes, JSON_REJECT_DUPLICATES, &error);
    if (!json) {
        print_error("line %d: %s\n", error.line, error.text);
    }
    assert_non_null(json);
    free(text);
    return json;
}

/* Follows a path of member names and array indices such as "cloth.mesh.positions". */
static json_t *at(json_t *json, const char *path)
{
    char name[64];
    while (*path) {
        size_t n = strcspn(path, ".");
        snprintf(name, sizeof name, "%.*s", (int)n, path);
        json = json_is_array(json) ? json_array_get(json, (size_t)atoi(name)) : json_object_get(json, name);
        path += n + (path[n] == '.');
    }
    return json;
}

static void test_scene__every_example_is_a_whole_job(void **state)
{
    (void)state;
    for (const struct example *e = example_list; e->name; e++) {
        struct scene scene;
        struct failure failure;
        assert_int_equal(example_build(e, 0, &scene, &failure), 0);
        json_t *job = print_and_parse(&scene);
        size_t vertices = scene.cloth.vertices;
        assert_int_equal(json_array_size(at(job, "cloth.mesh.positions")), 3 * vertices);
        assert_int_equal(json_array_size(at(job, "cloth.mesh.pattern")), 2 * vertices);
        assert_int_equal(json_array_size(at(job, "cloth.mesh.triangles")), 3 * scene.cloth.triangles);
        assert_int_equal(json_array_size(at(job, "cloth.seams")), 2 * scene.seams);
        assert_int_equal(json_array_size(at(job, "cloth.pins")), scene.pins);
        assert_int_equal(json_array_size(at(job, "bodies")), scene.bodies);
        assert_true(json_number_value(at(job, "cloth.materials.0.density")) > 0);
        assert_true(json_number_value(at(job, "solver.tolerance")) > 0);
        size_t i;
        json_t *value;
        json_array_foreach(at(job, "cloth.mesh.triangles"), i, value)
        {
            assert_true(json_is_integer(value) && (size_t)json_integer_value(value) < vertices);
        }
        json_array_foreach(at(job, "cloth.mesh.positions"), i, value)
        {
            assert_near(json_number_value(value), scene.cloth.positions[i], 1e-8, 1);
        }
        json_decref(job);
        scene_done(&scene);
    }
}

static void test_scene__writes_only_what_was_set_and_escapes_names(void **state)
{
    struct scene scene = scene_default();
    (void)state;
    scene.name = "say \"hello\"\n\xc3\xa9";
    scene.material[0].preset = "denim";
    assert_int_equal(surface_new(3, 1, true, &scene.cloth), 0);
    json_t *job = print_and_parse(&scene);
    assert_string_equal(json_string_value(at(job, "name")), scene.name);
    assert_string_equal(json_string_value(at(job, "cloth.materials.0.preset")), "denim");
    assert_int_equal(json_object_size(at(job, "solver")), 0);
    assert_null(at(job, "bodies"));
    assert_null(at(job, "cloth.pins"));
    assert_null(at(job, "cloth.thickness"));
    assert_null(at(job, "lines"));
    assert_null(at(job, "fit"));
    json_decref(job);
    scene.line = calloc(1, sizeof *scene.line);
    assert_non_null(scene.line);
    scene.lines = 1;
    scene.line->name = strdup("Brust \"A\"");
    scene.line->vertex = calloc(2, sizeof *scene.line->vertex);
    assert_non_null(scene.line->vertex);
    scene.line->vertices = 2;
    scene.line->vertex[1] = 2;
    scene.thickness = 0.001;
    scene.fit = true;
    scene.solver.method = "auto";
    scene.solver.max_iterations = 0;
    scene.body_friction = 0;
    scene.body = calloc(1, sizeof *scene.body);
    assert_non_null(scene.body);
    scene.bodies = 1;
    assert_int_equal(surface_new(3, 1, false, &scene.body[0]), 0);
    job = print_and_parse(&scene);
    assert_int_equal(json_object_size(at(job, "solver")), 2);
    assert_int_equal(json_integer_value(at(job, "solver.max_iterations")), 0);
    assert_true(json_is_number(at(job, "bodies.0.friction")));
    assert_null(at(job, "bodies.0.offset"));
    assert_true(json_is_true(at(job, "fit")));
    assert_string_equal(json_string_value(at(job, "lines.0.name")), "Brust \"A\"");
    assert_int_equal(json_array_size(at(job, "lines.0.vertices")), 2);
    assert_int_equal(json_integer_value(at(job, "lines.0.vertices.1")), 2);
    assert_near(json_number_value(at(job, "cloth.thickness")), 0.001, 1e-12, 1);
    assert_null(at(job, "bodies.0.motion"));
    json_decref(job);
    scene.keyframe = calloc(2, sizeof *scene.keyframe);
    assert_non_null(scene.keyframe);
    for (; scene.keyframes < 2; scene.keyframes++) {
        assert_int_equal(surface_new(3, 1, false, &scene.keyframe[scene.keyframes]), 0);
    }
    job = print_and_parse(&scene);
    assert_int_equal(json_array_size(at(job, "bodies.0.motion")), 2);
    assert_int_equal(json_array_size(at(job, "bodies.0.motion.1.positions")), 9);
    assert_null(at(job, "bodies.0.motion_seconds"));
    json_decref(job);
    scene.motion_seconds = 2;
    job = print_and_parse(&scene);
    assert_true(json_number_value(at(job, "bodies.0.motion_seconds")) == 2);
    json_decref(job);
    scene_done(&scene);
}

static void test_scene__refuses_a_name_that_is_not_utf8(void **state)
{
    struct scene scene = scene_default();
    FILE *file = fopen("/dev/null", "w");
    (void)state;
    assert_non_null(file);
    scene.name = "\xff\xfe";
    assert_int_equal(scene_write(file, &scene), -1);
    fclose(file);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scene__every_example_is_a_whole_job),
        cmocka_unit_test(test_scene__writes_only_what_was_set_and_escapes_names),
        cmocka_unit_test(test_scene__refuses_a_name_that_is_not_utf8),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
