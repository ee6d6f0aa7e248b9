/* test_store_mesh.c - meshes: shared files, whom they serve, and when they may go. */
#include "shelf.h"

#include <pthread.h>
#include <sqlite3.h>
#include <stdatomic.h>

#define ABC "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"

static const struct store_mesh abc = {.sha256 = ABC, .format = 2, .bytes = 3, .vertices = 4, .triangles = 5};

static void add_abc(struct store *store, const char *owner, int64_t now_ms)
{
    struct problem problem;
    assert_int_equal(store_mesh_add(store, owner, &abc, "abc", now_ms, &problem), 0);
}

/* A queued job of `owner` that needs the mesh. */
static void add_user(struct store *store, const char *owner, struct job *ret)
{
    struct problem problem;
    const char mesh[][SHA256_SIZE] = {ABC};
    struct store_submission submission = {.document = "{}", .bytes = 2, .mesh = mesh, .meshes = 1};
    *ret = (struct job){.revision = {1, 1}, .created_ms = 1000};
    id_new(ret->id);
    snprintf(ret->owner, sizeof ret->owner, "%s", owner);
    assert_int_equal(store_job_add(store, ret, &submission, &problem), 0);
}

static void test_store_mesh__its_first_bytes_stay(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_mesh mesh = abc, back;
    int fd;
    char data[4] = "";
    sha256_hex("abc", 3, mesh.sha256);
    assert_string_equal(mesh.sha256, ABC);
    assert_int_equal(store_mesh_get(store, "", ABC, &back, &problem), STORE_NONE);
    assert_int_equal(store_mesh_open(store, "", ABC, &back, &fd, &problem), STORE_NONE);
    add_abc(store, "", 1);
    mesh.vertices = 99;
    assert_int_equal(store_mesh_add(store, "", &mesh, "abc", 2, &problem), 0);
    assert_int_equal(store_mesh_get(store, "", ABC, &back, &problem), 0);
    assert_int_equal(back.vertices, 4);
    assert_int_equal(back.format, 2);
    assert_int_equal(store_mesh_open(store, "", ABC, &back, &fd, &problem), 0);
    assert_int_equal(read(fd, data, 4), 3);
    assert_string_equal(data, "abc");
    close(fd);
    store_close(store);
}

static void test_store_mesh__its_file_goes_with_its_last_owner(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_mesh back;
    add_abc(store, "shop", 1);
    add_abc(store, "studio", 1);
    assert_int_equal(store_mesh_remove(store, "nobody", ABC, &problem), STORE_NONE);
    assert_int_equal(store_mesh_remove(store, "shop", ABC, &problem), 0);
    assert_int_equal(store_mesh_get(store, "shop", ABC, &back, &problem), STORE_NONE);
    assert_int_equal(store_mesh_get(store, "studio", ABC, &back, &problem), 0);
    assert_int_equal(count_entries(*state, "meshes"), 1);
    assert_int_equal(store_mesh_remove(store, "studio", ABC, &problem), 0);
    assert_int_equal(store_mesh_remove(store, "studio", ABC, &problem), STORE_NONE);
    assert_int_equal(count_entries(*state, "meshes"), 0);
    store_close(store);
}

static void test_store_mesh__a_job_of_its_owner_holds_it_until_it_has_ended(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job, other;
    add_abc(store, "shop", 1);
    add_abc(store, "studio", 1);
    add_user(store, "shop", &job);
    add_user(store, "studio", &other);
    assert_int_equal(store_mesh_remove(store, "shop", ABC, &problem), STORE_IN_USE);
    assert_int_equal(store_job_cancel_queued(store, &other, &problem), 0);
    assert_int_equal(store_mesh_remove(store, "studio", ABC, &problem), 0); /* the other's does not */
    store = store_close(store);
    store = open_store(*state);
    start_job(store, &job);
    assert_int_equal(store_mesh_remove(store, "shop", ABC, &problem), STORE_IN_USE);
    job.status = JOB_SUCCEEDED;
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    assert_int_equal(store_mesh_remove(store, "shop", ABC, &problem), 0);
    store_close(store);
}

static void test_store_mesh__a_job_whose_mesh_is_gone_is_not_taken(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job = {.revision = {1, 1}, .owner = "studio"}, back;
    const char mesh[][SHA256_SIZE] = {ABC};
    struct store_submission submission = {.document = "{}", .bytes = 2, .mesh = mesh, .meshes = 1};
    id_new(job.id);
    add_abc(store, "shop", 1); /* not its own */
    assert_int_equal(store_job_add(store, &job, &submission, &problem), STORE_WITHOUT);
    assert_int_equal(store_job_get(store, "studio", job.id, &back, &problem), STORE_NONE);
    assert_int_equal(count_entries(*state, "jobs"), 0);
    store_close(store);
}

/* Nobody noted what the jobs of version 2 name. */
static void test_store_mesh__an_earlier_versions_job_holds_any_until_it_has_ended(void **state)
{
    struct problem problem;
    struct job job = {.revision = {1, 1}};
    make_old_database(*state, 2, OLD_ROWS);
    struct store *store = open_store(*state);
    assert_int_equal(store_mesh_remove(store, "", OLD_DIGEST, &problem), STORE_IN_USE);
    add_abc(store, "shop", 1);
    assert_int_equal(store_mesh_remove(store, "shop", ABC, &problem), 0);
    strcpy(job.id, OLD_ID);
    job.revision = (struct revision){2, 4};
    assert_int_equal(store_job_cancel_queued(store, &job, &problem), 0);
    assert_int_equal(store_mesh_remove(store, "", OLD_DIGEST, &problem), 0);
    store_close(store);
}

static void test_store_mesh__one_without_its_file_is_not_there(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_mesh back;
    char path[256];
    int fd;
    add_abc(store, "", 1);
    snprintf(path, sizeof path, "%s/meshes/%s", (char *)*state, ABC);
    assert_int_equal(remove(path), 0);
    assert_int_equal(store_mesh_open(store, "", ABC, &back, &fd, &problem), STORE_NONE);
    assert_int_equal(mkdir(path, 0), 0);
    assert_int_equal(store_mesh_remove(store, "", ABC, &problem), 0);
    store_close(store);
}

/* ---- owners who come and go --------------------------------------------------------------------- */

#define THREADS 4
#define ROUNDS  60

struct coming {
    struct store *store;
    int number;
    atomic_int *wrong;
};

/* Its own mesh must be whole from when it was added until it is removed, whatever the others do. */
static void *come_and_go(void *data)
{
    const struct coming *c = data;
    struct problem problem;
    struct store_mesh mesh;
    char owner[16], bytes[4] = "";
    int fd;
    snprintf(owner, sizeof owner, "owner-%d", c->number);
    for (int i = 0; i < ROUNDS; i++) {
        int failed = store_mesh_add(c->store, owner, &abc, "abc", 1, &problem);
        if (failed || store_mesh_open(c->store, owner, ABC, &mesh, &fd, &problem) != 0) {
            atomic_fetch_add(c->wrong, 1);
            continue;
        }
        if (read(fd, bytes, 4) != 3 || strcmp(bytes, "abc") != 0)
            atomic_fetch_add(c->wrong, 1);
        close(fd);
        if (store_mesh_remove(c->store, owner, ABC, &problem) != 0)
            atomic_fetch_add(c->wrong, 1);
    }
    return NULL;
}

static void test_store_mesh__owners_who_come_and_go_do_not_take_it_from_each_other(void **state)
{
    struct store *store = open_store(*state);
    atomic_int wrong = 0;
    struct coming coming[THREADS];
    pthread_t thread[THREADS];
    for (int i = 0; i < THREADS; i++) {
        coming[i] = (struct coming){store, i, &wrong};
        assert_int_equal(pthread_create(&thread[i], NULL, come_and_go, &coming[i]), 0);
    }
    for (int i = 0; i < THREADS; i++)
        pthread_join(thread[i], NULL);
    assert_int_equal(wrong, 0);
    assert_int_equal(count_entries(*state, "meshes"), 0);
    store_close(store);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_store_mesh__its_first_bytes_stay),
        TEST(test_store_mesh__its_file_goes_with_its_last_owner),
        TEST(test_store_mesh__a_job_of_its_owner_holds_it_until_it_has_ended),
        TEST(test_store_mesh__a_job_whose_mesh_is_gone_is_not_taken),
        TEST(test_store_mesh__an_earlier_versions_job_holds_any_until_it_has_ended),
        TEST(test_store_mesh__one_without_its_file_is_not_there),
        TEST(test_store_mesh__owners_who_come_and_go_do_not_take_it_from_each_other),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
