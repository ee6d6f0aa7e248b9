/* test_meshref.c - uploaded meshes that jobs name: loaded, listed once each, and refused. */
#include "shelf.h"

#include "meshref.h"

/* Puts a triangle in the store, with blanks behind so that the file has several pages. */
static void add_mesh(struct store *store, int i, char sha256[SHA256_SIZE])
{
    struct problem problem;
    static char text[9000];
    memset(text, ' ', sizeof text);
    int n = snprintf(text, sizeof text, "{\"positions\":[0,0,0,%d,0,0,0,1,0],\"triangles\":[0,1,2]}", i + 1);
    text[n] = ' ';
    struct store_mesh mesh = {.format = MESH_JSON, .bytes = sizeof text, .vertices = 3, .triangles = 1};
    sha256_hex(text, sizeof text, mesh.sha256);
    memcpy(sha256, mesh.sha256, SHA256_SIZE);
    assert_int_equal(store_mesh_add(store, "shop", &mesh, text, 1, &problem), 0);
}

static void test_meshref__what_is_loaded_is_listed_once(void **state)
{
    struct meshref_list list = {0};
    struct meshref ref = {open_store(*state), "shop", &limits_default, &list};
    struct problem problem;
    for (int i = 0; i < 20; i++) {
        char sha256[SHA256_SIZE];
        add_mesh(ref.store, i, sha256);
        for (int times = 0; times < 2; times++) {
            struct mesh mesh = {0};
            assert_int_equal(meshref_load(sha256, &mesh, &problem, &ref), 0);
            assert_int_equal(mesh.vertices, 3);
            assert_true(mesh.positions[3] == i + 1);
            mesh_done(&mesh);
        }
        assert_int_equal(list.count, i + 1);
        assert_string_equal(list.sha256[i], sha256);
    }
    meshref_list_done(&list);
    assert_int_equal(list.count, 0);
    store_close(ref.store);
}

static void test_meshref__anothers_mesh_is_none(void **state)
{
    struct meshref ref = {open_store(*state), "studio", &limits_default, NULL};
    struct problem problem;
    struct mesh mesh = {0};
    char sha256[SHA256_SIZE];
    add_mesh(ref.store, 0, sha256);
    assert_int_equal(meshref_load(sha256, &mesh, &problem, &ref), -1);
    assert_int_equal(problem.code, PROBLEM_INVALID);
    ref.owner = "shop";
    assert_int_equal(meshref_load(sha256, &mesh, &problem, &ref), 0);
    mesh_done(&mesh);
    store_close(ref.store);
}

/* Reading past the end of a mapped file would end the daemon. */
static void test_meshref__a_file_that_has_become_shorter_is_refused(void **state)
{
    struct meshref ref = {open_store(*state), "shop", &limits_default, NULL};
    struct problem problem;
    struct mesh mesh = {0};
    char sha256[SHA256_SIZE], path[512];
    add_mesh(ref.store, 0, sha256);
    snprintf(path, sizeof path, "%s/meshes/%s", (char *)*state, sha256);
    const off_t size[] = {8999, 0};
    for (int i = 0; i < 2; i++) {
        assert_int_equal(truncate(path, size[i]), 0);
        assert_int_equal(meshref_load(sha256, &mesh, &problem, &ref), -1);
        assert_int_equal(problem.code, PROBLEM_STORAGE);
    }
    store_close(ref.store);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_meshref__what_is_loaded_is_listed_once),
        TEST(test_meshref__anothers_mesh_is_none),
        TEST(test_meshref__a_file_that_has_become_shorter_is_refused),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
