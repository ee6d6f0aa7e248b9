/* test_store_prune.c - what is kept, and for how long: ended jobs, idle meshes, answers, tombstones. */
#include "shelf.h"

#include "clock.h"
#include "retention.h"

#define KEEP_ALL ((struct store_policy){1000, 1 << 30, 1000000})
#define DIGEST   "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"

/* A job of `owner` that failed at `finished_ms`, with a document of 10 bytes and no result. */
static void add_failed(struct store *store, const char *owner, int64_t finished_ms, struct job *ret)
{
    struct problem problem;
    struct job job = {.revision = {1, 1}, .created_ms = 1};
    id_new(job.id);
    snprintf(job.owner, sizeof job.owner, "%s", owner);
    assert_int_equal(add_row(store, &job, "0123456789", 10, &problem), 0);
    assert_int_equal(store_job_start(store, &job, &problem), 0);
    job.status = JOB_FAILED;
    job.finished_ms = finished_ms;
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    *ret = job;
}

/* Prunes until nothing is left to do; what went in all. */
static struct store_pruned prune(struct store *store, struct store_policy policy, int64_t now_ms)
{
    struct problem problem;
    struct store_pruned all = {0}, step;
    do {
        assert_int_equal(store_prune(store, &policy, now_ms, &step, &problem), 0);
        all.jobs += step.jobs;
        all.meshes += step.meshes;
        all.bytes += step.bytes;
    } while (step.jobs + step.meshes > 0);
    return all;
}

static void expect_job(struct store *store, const char *owner, const char *id, int expected)
{
    struct problem problem;
    struct job job = {0};
    assert_int_equal(store_job_get(store, owner, id, &job, &problem), expected);
    job_done(&job);
}

static void test_store_prune__the_jobs_that_ended_first_go_beyond_the_number(void **state)
{
    struct store *store = open_store(*state);
    struct job job[4], queued;
    add_job(store, &queued);
    const int64_t ended[] = {400, 100, 300, 200}; /* not in the order in which they were posted */
    for (int i = 0; i < 4; i++)
        add_failed(store, "shop", ended[i], &job[i]);
    struct store_policy policy = KEEP_ALL;
    policy.jobs = 4;
    assert_int_equal(prune(store, policy, 1000).jobs, 0);
    policy.jobs = 3;
    assert_int_equal(prune(store, policy, 1000).jobs, 1);
    expect_job(store, "shop", job[1].id, STORE_GONE);
    expect_job(store, "studio", job[1].id, STORE_NONE);
    policy.jobs = 0;
    assert_int_equal(prune(store, policy, 1000).jobs, 3);
    expect_job(store, "", queued.id, 0);
    assert_int_equal(count_entries(*state, "jobs"), 1);
    store_close(store);
}

static void test_store_prune__jobs_go_at_their_age_and_not_before(void **state)
{
    struct store *store = open_store(*state);
    struct job job[2], done;
    struct store_policy policy = KEEP_ALL;
    policy.age_ms = 5000;
    add_failed(store, "", 1000, &job[0]);
    add_failed(store, "", 1001, &job[1]);
    add_finished(store, "f", &done);
    assert_int_equal(prune(store, policy, 5000).jobs, 1); /* the one that finished at 0 */
    expect_job(store, "", done.id, STORE_GONE);
    assert_int_equal(count_entries(*state, "results"), 0);
    assert_int_equal(prune(store, policy, 5999).jobs, 0);
    assert_int_equal(prune(store, policy, 6000).jobs, 1);
    expect_job(store, "", job[0].id, STORE_GONE);
    expect_job(store, "", job[1].id, 0);
    store_close(store);
}

static void test_store_prune__documents_and_results_count_as_bytes(void **state)
{
    struct store *store = open_store(*state);
    struct job job, done;
    struct store_policy policy = KEEP_ALL;
    add_finished(store, "f", &done); /* "{}" and "drape" */
    add_failed(store, "", 2000, &job);
    policy.bytes = 17;
    assert_int_equal(prune(store, policy, 3000).jobs, 0);
    policy.bytes = 16;
    struct store_pruned pruned = prune(store, policy, 3000);
    assert_int_equal(pruned.jobs, 1);
    assert_int_equal(pruned.bytes, 7);
    expect_job(store, "", done.id, STORE_GONE);
    policy.bytes = 9;
    assert_int_equal(prune(store, policy, 3000).bytes, 10);
    store_close(store);
}

static void test_store_prune__many_go_in_small_steps(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_policy policy = KEEP_ALL;
    struct store_pruned step;
    struct job job;
    for (int i = 0; i < 150; i++)
        add_failed(store, "", 1000 + i, &job);
    policy.jobs = 1;
    size_t steps = 0, jobs = 0;
    do {
        assert_int_equal(store_prune(store, &policy, 2000, &step, &problem), 0);
        assert_true(step.jobs <= 64);
        jobs += step.jobs;
        steps += step.jobs > 0;
    } while (step.jobs > 0);
    assert_int_equal(jobs, 149);
    assert_int_equal(steps, 3);
    expect_job(store, "", job.id, 0);
    store_close(store);
}

static void test_store_prune__a_mesh_goes_once_no_job_names_it_and_its_time_is_over(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_mesh mesh = {.sha256 = DIGEST, .bytes = 3};
    const char named[][SHA256_SIZE] = {DIGEST};
    struct store_submission submission = {.document = "{}", .bytes = 2, .mesh = named, .meshes = 1};
    struct store_policy policy = KEEP_ALL;
    struct job job = {.revision = {1, 1}, .created_ms = 20000, .owner = "shop"};
    policy.age_ms = 5000;
    id_new(job.id);
    assert_int_equal(store_mesh_add(store, "shop", &mesh, "abc", 10000, &problem), 0);
    assert_int_equal(store_mesh_add(store, "studio", &mesh, "abc", 10000, &problem), 0);
    assert_int_equal(prune(store, policy, 15000).meshes, 0);
    assert_int_equal(store_job_add(store, &job, &submission, &problem), 0);
    assert_int_equal(prune(store, policy, 15001).meshes, 1); /* the one nobody names */
    assert_int_equal(store_mesh_get(store, "studio", DIGEST, &mesh, &problem), STORE_NONE);
    assert_int_equal(store_mesh_get(store, "shop", DIGEST, &mesh, &problem), 0);
    assert_int_equal(count_entries(*state, "meshes"), 1);
    /* A job that has ended keeps it for as long as it is kept itself: somebody may drape it again. */
    assert_int_equal(store_job_start(store, &job, &problem), 0);
    job.status = JOB_FAILED;
    job.finished_ms = 30000;
    assert_int_equal(store_job_finish(store, &job, &problem), 0);
    assert_int_equal(prune(store, policy, 34999).meshes, 0);
    struct store_pruned pruned = prune(store, policy, 35000);
    assert_int_equal(pruned.jobs, 1);
    assert_int_equal(pruned.meshes, 1);
    assert_int_equal(count_entries(*state, "meshes"), 0);
    store_close(store);
}

static void test_store_prune__a_mesh_that_is_touched_stays(void **state)
{
    const int64_t hour = 3600000;
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_mesh mesh = {.sha256 = DIGEST, .bytes = 3};
    struct store_policy policy = KEEP_ALL;
    policy.age_ms = 10 * hour;
    assert_int_equal(store_mesh_add(store, "", &mesh, "abc", 0, &problem), 0);
    assert_int_equal(store_mesh_touch(store, "", DIGEST, hour, &problem), 0); /* too soon to be noted */
    assert_int_equal(store_mesh_touch(store, "", DIGEST, 9 * hour, &problem), 0);
    assert_int_equal(prune(store, policy, 19 * hour).meshes, 0);
    assert_int_equal(store_mesh_add(store, "", &mesh, "abc", 19 * hour, &problem), 0); /* uploaded again */
    assert_int_equal(prune(store, policy, 29 * hour).meshes, 0);
    assert_int_equal(store_mesh_touch(store, "", DIGEST, 20 * hour, &problem), 0);
    assert_int_equal(prune(store, policy, 29 * hour + 1).meshes, 1);
    store_close(store);
}

static void test_store_prune__answers_and_tombstones_are_forgotten(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_answer answer;
    struct store_submission submission = {
        .document = "{}", .bytes = 2, .key = "k", .digest = DIGEST, .answer = "{}", .at_ms = 1000};
    struct job job = {.revision = {1, 1}}, gone;
    id_new(job.id);
    assert_int_equal(store_job_add(store, &job, &submission, &problem), 0);
    add_failed(store, "", 1000, &gone);
    assert_int_equal(store_job_remove(store, "", gone.id, 2000, &problem), 0);
    prune(store, KEEP_ALL, 999 + STORE_ANSWER_MS);
    assert_int_equal(store_answer_get(store, "", "k", 1000, &answer, &problem), 0);
    free(answer.body);
    prune(store, KEEP_ALL, 1000 + STORE_ANSWER_MS);
    assert_int_equal(store_answer_get(store, "", "k", 1000, &answer, &problem), STORE_NONE);
    prune(store, KEEP_ALL, 1999 + STORE_GONE_MS);
    expect_job(store, "", gone.id, STORE_GONE);
    prune(store, KEEP_ALL, 2000 + STORE_GONE_MS);
    expect_job(store, "", gone.id, STORE_NONE);
    store_close(store);
}

/* Whoever leafs through the list sees each job once that was there all the time, whatever comes and goes. */
static void test_store_prune__cursors_hold_while_jobs_come_and_go(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct job job[30], more;
    struct found found;
    struct store_filter filter = {
        .owner = "", .status = -1, .created_after_ms = -1, .before = INT64_MAX, .limit = 4};
    int64_t last;
    bool again;
    char seen[30] = "";
    for (int i = 0; i < 30; i++)
        add_failed(store, "", 1000 + i, &job[i]);
    for (int page = 0; page < 12; page++) {
        filter.limit = 1; /* note_job keeps the last one only */
        memset(&found, 0, sizeof found);
        for (int i = 0; i < 4; i++) {
            assert_int_equal(store_job_list(store, &filter, note_job, &found, &last, &again, &problem), 0);
            if (found.count == 0)
                break;
            filter.before = last;
            for (int k = 0; k < 30; k++)
                seen[k] += strcmp(found.last.id, job[k].id) == 0;
            found.count = 0;
        }
        add_job(store, &more); /* newer ones: behind whoever goes back in time */
        store_job_remove(store, "", job[2 * page + 1].id, 1, &problem);
        store_job_remove(store, "", job[29 - 2 * page].id, 1, &problem);
    }
    for (int k = 0; k < 30; k += 2)
        assert_int_equal(seen[k], 1);
    for (int k = 1; k < 30; k += 2)
        assert_true(seen[k] <= 1);
    store_close(store);
}

static void test_store_prune__lists_may_begin_after_a_moment(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct found found = {0};
    struct store_filter filter = {.owner = "", .status = -1, .before = INT64_MAX, .limit = 9};
    struct job job;
    int64_t last;
    bool more;
    for (int i = 0; i < 3; i++) {
        job = (struct job){.revision = {1, 1}, .created_ms = 1000 + i};
        id_new(job.id);
        assert_int_equal(add_row(store, &job, "{}", 2, &problem), 0);
    }
    for (int i = 0; i < 4; i++) {
        found.count = 0;
        filter.created_after_ms = 999 + i;
        assert_int_equal(store_job_list(store, &filter, note_job, &found, &last, &more, &problem), 0);
        assert_int_equal(found.count, 3 - i);
    }
    store_close(store);
}

static void test_store_prune__the_thread_prunes_at_once_and_stops_when_told(void **state)
{
    struct store *store = open_store(*state);
    struct store_policy policy = KEEP_ALL;
    struct job job, back;
    struct problem problem;
    int found = 0;
    policy.age_ms = 100 * 365 * (int64_t)86400000; /* nothing is so old */
    policy.jobs = 0;
    for (int i = 0; i < 100; i++)
        add_failed(store, "", 1000 + i, &job);
    struct retention *retention = retention_new(store, &policy, NULL);
    assert_non_null(retention);
    for (int64_t limit = clock_monotonic_ms() + 60000; found != STORE_GONE; usleep(1000)) {
        assert_true(clock_monotonic_ms() < limit);
        found = store_job_get(store, "", job.id, &back, &problem);
        if (found == 0)
            job_done(&back);
    }
    assert_null(retention_free(retention));
    assert_null(retention_free(NULL));
    store_close(store);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_store_prune__the_jobs_that_ended_first_go_beyond_the_number),
        TEST(test_store_prune__jobs_go_at_their_age_and_not_before),
        TEST(test_store_prune__documents_and_results_count_as_bytes),
        TEST(test_store_prune__many_go_in_small_steps),
        TEST(test_store_prune__a_mesh_goes_once_no_job_names_it_and_its_time_is_over),
        TEST(test_store_prune__a_mesh_that_is_touched_stays),
        TEST(test_store_prune__answers_and_tombstones_are_forgotten),
        TEST(test_store_prune__cursors_hold_while_jobs_come_and_go),
        TEST(test_store_prune__lists_may_begin_after_a_moment),
        TEST(test_store_prune__the_thread_prunes_at_once_and_stops_when_told),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
