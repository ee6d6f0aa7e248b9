/* test_queue.c - states, order, limits, cancelling, draining, with real small jobs. */
#include "rig.h"

#include "drape.h"
#include "log.h"
#include "solve.h"

static void test_queue__a_job_succeeds_and_its_result_is_there_before_it_says_so(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    char id[ID_SIZE], *text = scratch_square(4, "auto", 400);
    int fd;
    uint64_t bytes;
    open_rig(rig, 1, 10);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    wait_end(rig, id, &job);
    assert_int_equal(job.status, JOB_SUCCEEDED);
    assert_string_equal(job.verdict, "at-rest");
    assert_non_null(job.report);
    assert_non_null(job.progress);
    assert_null(job.error);
    assert_int_equal(job.revision.attempt, 1);
    assert_true(job.created_ms <= job.started_ms && job.started_ms <= job.finished_ms);
    assert_int_equal(store_result_open(rig->store, id, 1, "result.json", &fd, &bytes, &problem), 0);
    assert_true(bytes > 100);
    close(fd);
    job_done(&job);
    free(text);
    close_rig(rig);
    assert_int_equal(rig->ends, 1);
    assert_true(rig->changes >= 3); /* queued, running, end */
}

static void test_queue__a_document_that_no_longer_parses_fails_with_its_problem(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    char id[ID_SIZE];
    open_rig(rig, 1, 10);
    assert_int_equal(submit(rig, "{\"cloth\":1}", id, &problem), 0);
    wait_end(rig, id, &job);
    assert_int_equal(job.status, JOB_FAILED);
    assert_non_null(strstr(job.error, "\"code\":\"invalid\""));
    assert_non_null(strstr(job.error, id)); /* the instance */
    assert_string_equal(job.verdict, "");
    job_done(&job);
    close_rig(rig);
}

static void test_queue__jobs_queued_and_running_are_bounded(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    char first[ID_SIZE], id[ID_SIZE], *body, *text = long_job();
    open_rig(rig, 1, 2);
    assert_int_equal(submit(rig, text, first, &problem), 0);
    wait_status(rig, first, "running");
    assert_int_equal(queue_admits(rig->queue, "", &problem), 0);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    assert_int_equal(queue_admits(rig->queue, "", &problem), -1);
    assert_int_equal(submit(rig, text, first, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_QUEUE_FULL);
    assert_int_equal(queue_cancel(rig->queue, "", id, &body, &problem), 0);
    free(body);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    free(text);
    close_rig(rig);
}

static void test_queue__positions_count_from_one_and_move_up(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct revision revision;
    char running[ID_SIZE], id[3][ID_SIZE], *body, *text = long_job();
    open_rig(rig, 1, 10);
    assert_int_equal(submit(rig, text, running, &problem), 0);
    wait_status(rig, running, "running");
    for (int i = 0; i < 3; i++)
        assert_int_equal(submit(rig, text, id[i], &problem), 0);
    assert_int_equal(queue_body(rig->queue, "", id[2], &body, &revision), 0);
    assert_non_null(strstr(body, "\"queue_position\":3"));
    free(body);
    assert_int_equal(queue_cancel(rig->queue, "", id[1], &body, &problem), 0);
    assert_non_null(strstr(body, "\"status\":\"canceled\"")); /* at once */
    free(body);
    assert_int_equal(queue_body(rig->queue, "", id[1], &body, &revision), QUEUE_NONE);
    assert_int_equal(queue_body(rig->queue, "", id[2], &body, &revision), 0);
    assert_non_null(strstr(body, "\"queue_position\":2"));
    free(body);
    free(text);
    close_rig(rig);
}

static void test_queue__a_running_job_stops_soon_after_its_cancel(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    char id[ID_SIZE], *body, *text = long_job();
    open_rig(rig, 1, 10);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    wait_status(rig, id, "running");
    int64_t from = clock_monotonic_ms();
    assert_int_equal(queue_cancel(rig->queue, "", id, &body, &problem), 0);
    free(body);
    wait_end(rig, id, &job);
    assert_int_equal(job.status, JOB_CANCELED);
    assert_string_equal(job.verdict, "");
    assert_null(job.report);
    assert_true(clock_monotonic_ms() - from < 10000);
    job_done(&job);
    while (queue_running(rig->queue) > 0)
        pause_ms(1);
    assert_int_equal(queue_cancel(rig->queue, "", id, &body, &problem), QUEUE_NONE);
    free(text);
    close_rig(rig);
}

struct stopping {
    atomic_bool stop;
    char told[512]; /* the progress at which it was stopped */
};

static void stop_at_once(char *json, void *data)
{
    struct stopping *stopping = data;
    if (!atomic_load(&stopping->stop))
        snprintf(stopping->told, sizeof stopping->told, "%s", json);
    atomic_store(&stopping->stop, true);
    free(json);
}

static void test_queue__a_solve_that_is_stopped_ends_within_its_iteration(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job = {.revision = {1, 1}};
    struct stopping stopping = {.told = ""};
    struct solve_outcome outcome;
    char *text = long_job();
    id_new(job.id);
    assert_int_equal(store_open(rig->dir, NULL, &rig->store, &problem), 0);
    struct store_submission submission = {.document = text, .bytes = strlen(text)};
    assert_int_equal(store_job_add(rig->store, &job, &submission, &problem), 0);
    struct solve_task task = {.store = rig->store,
                              .limits = &limits_default,
                              .owner = "",
                              .id = job.id,
                              .attempt = 1,
                              .stop = &stopping.stop,
                              .progress = stop_at_once,
                              .data = &stopping};
    solve_job(&task, &outcome);
    assert_int_equal(outcome.end, SOLVE_STOPPED);
    assert_non_null(strstr(stopping.told, "\"iteration\""));
    assert_string_equal(outcome.progress, stopping.told);
    free(outcome.report);
    free(outcome.progress);
    free(text);
    rig->store = store_close(rig->store);
}

static void test_queue__a_cancel_that_the_store_never_matches_is_given_up(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job = {0};
    char id[ID_SIZE], *body, *text = long_job();
    open_rig(rig, 1, 10);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    wait_status(rig, id, "running");
    memcpy(job.id, id, sizeof id);
    job.revision.attempt = 1;
    assert_int_equal(store_job_requeue(rig->store, &job, &problem), 0); /* behind the queue's back */
    assert_int_equal(queue_cancel(rig->queue, "", id, &body, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    free(text);
    close_rig(rig);
}

static void test_queue__draining_refuses_and_interrupting_puts_back(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    char running[ID_SIZE], waiting[ID_SIZE], *text = long_job();
    open_rig(rig, 1, 10);
    assert_int_equal(submit(rig, text, running, &problem), 0);
    wait_status(rig, running, "running");
    assert_int_equal(submit(rig, text, waiting, &problem), 0);
    queue_drain(rig->queue);
    assert_int_equal(queue_running(rig->queue), 1);
    assert_int_equal(submit(rig, text, waiting, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_DRAINING);
    close_rig(rig);
    assert_int_equal(store_open(rig->dir, NULL, &rig->store, &problem), 0);
    assert_int_equal(store_job_get(rig->store, "", running, &job, &problem), 0);
    assert_int_equal(job.status, JOB_QUEUED);
    assert_int_equal(job.revision.attempt, 2);
    assert_int_equal(job.crashes, 0);
    job_done(&job);
    store_close(rig->store);
    free(text);
}

static void test_queue__nothing_starts_while_it_is_held(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    struct queue_counts counts;
    char id[ID_SIZE], *document = scratch_square(2, "auto", 50);
    open_rig(rig, 1, 4);
    queue_hold(rig->queue, true);
    assert_int_equal(submit(rig, document, id, &problem), 0);
    queue_hold(rig->queue, true); /* once more holds no more */
    pause_ms(200);
    queue_measure(rig->queue, &counts);
    assert_int_equal(counts.queued, 1);
    assert_int_equal(counts.running, 0);
    queue_hold(rig->queue, false);
    wait_end(rig, id, &job);
    assert_int_equal(job.status, JOB_SUCCEEDED);
    job_done(&job);
    free(document);
    close_rig(rig);
}

static void test_queue__idle_workers_are_seen_to_look_for_work(void **state)
{
    struct rig *rig = *state;
    struct queue_counts counts;
    open_rig(rig, 2, 4);
    int64_t since = clock_monotonic_ms(), limit = since + 60000;
    do
        queue_measure(rig->queue, &counts);
    while (counts.seen_ms <= since && clock_monotonic_ms() < limit);
    assert_true(counts.seen_ms > since);
    close_rig(rig);
}

static void cancel(struct rig *rig, const char *owner, const char *id)
{
    struct problem problem;
    char *body;
    if (queue_cancel(rig->queue, owner, id, &body, &problem) == 0)
        free(body);
}

/* All workers solve, or are told to stop: nobody is missed who looks for no work. */
static void test_queue__busy_and_stopping_workers_are_seen_as_well(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct queue_counts counts;
    char id[ID_SIZE], *text = long_job();
    open_rig(rig, 1, 4);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    wait_status(rig, id, "running");
    pause_ms(20);
    int64_t since = clock_monotonic_ms();
    queue_measure(rig->queue, &counts);
    assert_int_equal(counts.running, 1);
    assert_true(counts.seen_ms >= since);
    cancel(rig, "", id);
    while (queue_running(rig->queue) > 0)
        pause_ms(1);
    queue_drain(rig->queue);
    pause_ms(20);
    since = clock_monotonic_ms();
    queue_measure(rig->queue, &counts);
    assert_true(counts.seen_ms >= since);
    free(text);
    close_rig(rig);
}

/* The gauge, in seconds. */
static double oldest_queued(struct rig *rig)
{
    struct queue_counts counts;
    queue_measure(rig->queue, &counts);
    char *text = metrics_text(rig->metrics), *at = strstr(text, "\ndraped_oldest_queued_seconds ");
    assert_non_null(at);
    double seconds = strtod(strchr(at + 1, ' '), NULL);
    free(text);
    return seconds;
}

static void test_queue__the_oldest_that_waits_is_told_whatever_its_priority(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    const int first[] = {JOB_PRIORITY_LOW, JOB_PRIORITY_HIGH};
    open_rig(rig, 1, 4);
    queue_hold(rig->queue, true);
    for (size_t i = 0; i < 2; i++) {
        char old[ID_SIZE], young[ID_SIZE];
        struct job job = {.priority = first[i]};
        assert_int_equal(submit_as(rig, job, "{}", old, &problem), 0);
        pause_ms(200);
        job.priority = first[1 - i];
        assert_int_equal(submit_as(rig, job, "{}", young, &problem), 0);
        assert_true(oldest_queued(rig) >= 0.2);
        cancel(rig, "", old);
        cancel(rig, "", young);
        assert_true(oldest_queued(rig) == 0);
    }
    close_rig(rig);
}

static void test_queue__jobs_run_where_nobody_listens(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    char id[ID_SIZE], *text = scratch_square(2, "auto", 50);
    make_rig(rig, 1, 4);
    struct queue_setup silent = {
        .store = rig->store, .hub = rig->hub, .metrics = rig->metrics, .limits = &rig->limits, .workers = 1};
    queue_free(rig->queue);
    rig->queue = queue_new(&silent);
    assert_int_equal(queue_start(rig->queue, &problem), 0);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    wait_end(rig, id, &job);
    assert_int_equal(job.status, JOB_SUCCEEDED);
    assert_int_equal(rig->changes, 0);
    job_done(&job);
    free(text);
    close_rig(rig);
}

static void test_queue__an_earlier_daemons_jobs_are_taken_up(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job = {.revision = {1, 1}}, back;
    char *text = scratch_square(4, "auto", 400);
    assert_int_equal(store_open(rig->dir, NULL, &rig->store, &problem), 0);
    id_new(job.id);
    assert_int_equal(store_job_add(rig->store, &job,
                                   &(struct store_submission){.document = text, .bytes = strlen(text)},
                                   &problem),
                     0);
    assert_int_equal(store_job_start(rig->store, &job, &problem), 0);
    store_close(rig->store); /* died under it */
    open_rig(rig, 1, 10);
    wait_end(rig, job.id, &back);
    assert_int_equal(back.status, JOB_SUCCEEDED);
    assert_int_equal(back.revision.attempt, 2);
    assert_int_equal(back.crashes, 1);
    job_done(&back);
    free(text);
    close_rig(rig);
}

static void test_queue__two_workers_end_every_job_once(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    char id[12][ID_SIZE], *text = scratch_square(3, "auto", 50);
    open_rig(rig, 2, 100);
    for (int i = 0; i < 12; i++)
        assert_int_equal(submit(rig, text, id[i], &problem), 0);
    for (int i = 0; i < 12; i++) {
        wait_end(rig, id[i], &job);
        assert_int_equal(job.status, JOB_SUCCEEDED);
        assert_int_equal(job.revision.attempt, 1);
        job_done(&job);
    }
    free(text);
    close_rig(rig);
    assert_int_equal(rig->ends, 12);
}

static void test_queue__a_race_of_cancel_and_end_has_one_outcome(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    int outcomes[JOB_STATUSES] = {0};
    char id[ID_SIZE], *body, *text = scratch_square(12, "dynamic", 60);
    open_rig(rig, 1, 100);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    int64_t from = clock_monotonic_ms();
    wait_end(rig, id, &job);
    int64_t whole = clock_monotonic_ms() - from; /* the cancels below fall all over it, and behind it */
    job_done(&job);
    for (int i = 0; i < 40; i++) {
        assert_int_equal(submit(rig, text, id, &problem), 0);
        pause_ms((long)(2 * whole * i / 40));
        int found = queue_cancel(rig->queue, "", id, &body, &problem);
        assert_true(found == 0 || found == QUEUE_NONE);
        if (found == 0)
            free(body);
        wait_end(rig, id, &job);
        outcomes[job.status]++;
        job_done(&job);
    }
    free(text);
    close_rig(rig);
    assert_int_equal(outcomes[JOB_SUCCEEDED] + outcomes[JOB_CANCELED], 40);
    assert_true(outcomes[JOB_CANCELED] > 0);
    assert_int_equal(rig->ends, 41);
}

static void test_queue__followers_see_states_progress_and_the_end_in_rising_order(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct follower *f;
    struct job job;
    char id[ID_SIZE], *text = scratch_square(8, "auto", 400);
    char all[65536], chunk[512];
    size_t n = 0;
    open_rig(rig, 1, 10);
    assert_int_equal(follower_new(rig->hub, "", 1, false, NULL, NULL, &f), 0);
    assert_int_equal(
        queue_follow(rig->queue, "", "00000000000000000000000000000000", (struct revision){0, 0}, f),
        QUEUE_NONE);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    assert_int_equal(queue_follow(rig->queue, "", id, (struct revision){0, 0}, f), 0);
    for (;;) {
        ssize_t got = follower_pull(f, chunk, sizeof chunk);
        if (got < 0)
            break;
        assert_true(n + (size_t)got < sizeof all);
        memcpy(all + n, chunk, (size_t)got);
        n += (size_t)got;
        if (got == 0)
            pause_ms(2);
    }
    all[n] = '\0';
    struct revision last = {0, 0}, revision;
    for (char *p = all; (p = strstr(p, "id: ")) != NULL; p++) {
        assert_int_equal(sscanf(p, "id: %u.%u", &revision.attempt, &revision.counter), 2);
        assert_true(revision_compare(revision, last) > 0);
        last = revision;
    }
    wait_end(rig, id, &job);
    assert_int_equal(revision_compare(last, job.revision), 0);
    assert_non_null(strstr(all, "event: state\n"));
    assert_non_null(strstr(all, "event: progress\n"));
    assert_non_null(strstr(all, "event: end\n"));
    job_done(&job);
    follower_free(f);
    free(text);
    close_rig(rig);
}

static void test_queue__a_job_is_not_here_for_another_owner(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct revision revision;
    struct follower *follower;
    struct job job = {.owner = "shop"};
    char *text = long_job(), *body = NULL;
    open_rig(rig, 1, 10);
    id_new(job.id);
    char id[ID_SIZE];
    memcpy(id, job.id, sizeof id);
    struct store_submission submission = {.document = text, .bytes = strlen(text)};
    assert_int_equal(queue_submit(rig->queue, &job, &submission, &body, &problem), 0);
    free(body);
    free(text);
    const char *const other[] = {"", "studio"};
    for (size_t i = 0; i < sizeof other / sizeof *other; i++) {
        assert_int_equal(queue_body(rig->queue, other[i], id, &body, &revision), QUEUE_NONE);
        assert_int_equal(queue_cancel(rig->queue, other[i], id, &body, &problem), QUEUE_NONE);
        assert_int_equal(follower_new(rig->hub, other[i], 1, false, NULL, NULL, &follower), 0);
        assert_int_equal(queue_follow(rig->queue, other[i], id, (struct revision){0, 0}, follower),
                         QUEUE_NONE);
        follower_free(follower);
    }
    assert_int_equal(queue_cancel(rig->queue, "shop", id, &body, &problem), 0);
    free(body);
    close_rig(rig);
}

/* ---- owners ------------------------------------------------------------------------------------------ */

/* Keys of the owners a and b; the rig opened afterwards has them. */
static void open_keys(struct rig *rig, const char *quotas_of_a)
{
    struct problem problem;
    char path[512];
    snprintf(path, sizeof path, "%s/keys.json", rig->dir);
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    fprintf(out, "{\"keys\":[{\"name\":\"a\",\"sha256\":\"%064d\"%s},{\"name\":\"b\",\"sha256\":\"%064d\"}]}",
            1, quotas_of_a, 2);
    assert_int_equal(fclose(out), 0);
    if (rig->keys != NULL)
        assert_int_equal(keys_reload(rig->keys, &problem), 0);
    else
        assert_int_equal(keys_open(path, &limits_default.key, &rig->keys, &problem), 0);
}

static const struct job job_of_a = {.owner = "a"}, job_of_b = {.owner = "b"};

static void test_queue__a_key_has_as_many_jobs_queued_as_its_quota_and_none_more(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    char running[ID_SIZE], id[2][ID_SIZE], more[ID_SIZE], *text = long_job();
    open_keys(rig, ",\"queued\":2");
    open_rig(rig, 1, 10);
    assert_int_equal(submit_as(rig, job_of_a, text, running, &problem), 0);
    for (int64_t limit = clock_monotonic_ms() + 60000; queue_running(rig->queue) == 0; pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(queue_admits(rig->queue, "a", &problem), 0);
        assert_int_equal(submit_as(rig, job_of_a, text, id[i], &problem), 0);
    }
    assert_int_equal(queue_admits(rig->queue, "a", &problem), -1);
    assert_int_equal(submit_as(rig, job_of_a, text, more, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_QUOTA_QUEUED);
    assert_int_equal(queue_admits(rig->queue, "b", &problem), 0);
    cancel(rig, "a", id[0]);
    assert_int_equal(submit_as(rig, job_of_a, text, more, &problem), 0);
    assert_int_equal(queue_admits(rig->queue, "a", &problem), -1);
    free(text);
    close_rig(rig);
}

static void test_queue__when_to_come_again_is_known_once_a_job_has_ended(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    char id[ID_SIZE], *text = scratch_square(4, "auto", 400);
    const size_t many = 1000000000;
    open_rig(rig, 1, 10);
    assert_int_equal(queue_retry_s(rig->queue, many), 1);
    assert_int_equal(submit(rig, text, id, &problem), 0);
    for (int64_t limit = clock_monotonic_ms() + 60000; queue_retry_s(rig->queue, many) == 1; pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
    assert_int_equal(queue_retry_s(rig->queue, many), QUEUE_RETRY_MAX_S);
    assert_int_equal(queue_retry_s(rig->queue, 0), 1);
    free(text);
    close_rig(rig);
}

static void test_queue__a_job_past_its_keys_running_quota_waits_beside_an_idle_worker(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    char a[2][ID_SIZE], b[ID_SIZE], order[3 * ID_SIZE + 1], *text = long_job();
    open_keys(rig, ",\"running\":1");
    open_rig(rig, 3, 10);
    for (int i = 0; i < 2; i++)
        assert_int_equal(submit_as(rig, job_of_a, text, a[i], &problem), 0);
    assert_int_equal(submit_as(rig, job_of_b, text, b, &problem), 0);
    for (int64_t limit = clock_monotonic_ms() + 60000; queue_running(rig->queue) < 2; pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
    pause_ms(50);
    assert_int_equal(queue_running(rig->queue), 2);
    open_keys(rig, ",\"running\":2");
    queue_reconsider(rig->queue);
    for (int64_t limit = clock_monotonic_ms() + 60000; queue_running(rig->queue) < 3; pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
    snprintf(order, sizeof order, "%s ", a[1]);
    assert_string_equal(rig->started + 2 * ID_SIZE, order); /* the last of the three */
    free(text);
    close_rig(rig);
}

/* The three of one owner are there first; the one of another does not wait for them all. */
static void test_queue__owners_take_turns_and_priorities_go_first_among_ones_own(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job, low = {.owner = "a", .priority = JOB_PRIORITY_LOW},
                    high = {.owner = "a", .priority = JOB_PRIORITY_HIGH};
    char first[ID_SIZE], id[4][ID_SIZE], order[6 * ID_SIZE], *text = long_job(), *little;
    little = scratch_square(3, "auto", 5);
    open_rig(rig, 1, 10);
    assert_int_equal(submit_as(rig, job_of_a, text, first, &problem), 0);
    for (int64_t limit = clock_monotonic_ms() + 60000; queue_running(rig->queue) == 0; pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
    assert_int_equal(submit_as(rig, low, little, id[0], &problem), 0);
    assert_int_equal(submit_as(rig, job_of_a, little, id[1], &problem), 0);
    assert_int_equal(submit_as(rig, high, little, id[2], &problem), 0);
    assert_int_equal(submit_as(rig, job_of_b, little, id[3], &problem), 0);
    cancel(rig, "a", first);
    wait_end_of(rig, "a", id[0], &job);
    job_done(&job);
    snprintf(order, sizeof order, "%s %s %s %s %s ", first, id[2], id[3], id[1], id[0]);
    assert_string_equal(rig->started, order);
    free(text);
    free(little);
    close_rig(rig);
}

/* The estimate that admits jobs may be too low: nothing else stops this one. */
static void test_queue__a_job_that_needs_too_much_memory_fails_and_the_next_one_runs(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job;
    char large[ID_SIZE], small[ID_SIZE], *text = scratch_square(20, "auto", 5), *little;
    little = scratch_square(2, "auto", 5);
    rig->job_memory = 500000;
    open_rig(rig, 1, 10);
    assert_int_equal(submit(rig, text, large, &problem), 0);
    assert_int_equal(submit(rig, little, small, &problem), 0);
    wait_end(rig, large, &job);
    assert_int_equal(job.status, JOB_FAILED);
    assert_non_null(strstr(job.error, "\"code\":\"memory-limit\""));
    job_done(&job);
    wait_end(rig, small, &job);
    assert_int_equal(job.status, JOB_SUCCEEDED);
    job_done(&job);
    free(text);
    free(little);
    close_rig(rig);
}

static void test_queue__a_job_waits_for_the_memory_that_another_holds(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct job job = {.memory = 60};
    char first[ID_SIZE], second[ID_SIZE], *text = long_job();
    rig->memory = 100;
    open_rig(rig, 2, 10);
    assert_int_equal(submit_as(rig, job, text, first, &problem), 0);
    wait_status(rig, first, "running");
    assert_int_equal(submit_as(rig, job, text, second, &problem), 0);
    pause_ms(50);
    assert_int_equal(queue_running(rig->queue), 1);
    cancel(rig, "", first);
    wait_status(rig, second, "running");
    free(text);
    close_rig(rig);
}

static void test_queue__a_key_makes_one_job_and_a_lost_mesh_none(void **state)
{
    struct rig *rig = *state;
    struct problem problem;
    struct store_answer answer;
    const char lost[][SHA256_SIZE] = {"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"};
    struct store_submission submission = {
        .document = "{}", .bytes = 2, .key = "k", .digest = lost[0], .at_ms = 1000};
    char *body = NULL;
    open_rig(rig, 1, 2);
    for (int i = 0; i < 4; i++) {
        struct job job = {.revision = {1, 1}};
        id_new(job.id);
        submission.mesh = i == 0 ? lost : NULL;
        submission.meshes = i == 0;
        int result = queue_submit(rig->queue, &job, &submission, &body, &problem);
        if (i == 0) {
            assert_int_equal(result, -1);
            assert_int_equal(problem.code, PROBLEM_INVALID);
        } else if (i == 1) {
            assert_int_equal(result, 0);
            assert_int_equal(store_answer_get(rig->store, "", "k", 1000, &answer, &problem), 0);
            assert_string_equal(answer.body, body); /* word for word */
            free(answer.body);
            free(body);
        } else { /* each time: no place is lost by it */
            assert_int_equal(result, QUEUE_TAKEN);
        }
        job_done(&job);
    }
    assert_int_equal(queue_admits(rig->queue, "", &problem), 0);
    close_rig(rig);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, rig_new, rig_free)
    const struct CMUnitTest tests[] = {
        TEST(test_queue__a_job_succeeds_and_its_result_is_there_before_it_says_so),
        TEST(test_queue__a_document_that_no_longer_parses_fails_with_its_problem),
        TEST(test_queue__jobs_queued_and_running_are_bounded),
        TEST(test_queue__positions_count_from_one_and_move_up),
        TEST(test_queue__a_running_job_stops_soon_after_its_cancel),
        TEST(test_queue__a_cancel_that_the_store_never_matches_is_given_up),
        TEST(test_queue__draining_refuses_and_interrupting_puts_back),
        TEST(test_queue__nothing_starts_while_it_is_held),
        TEST(test_queue__idle_workers_are_seen_to_look_for_work),
        TEST(test_queue__busy_and_stopping_workers_are_seen_as_well),
        TEST(test_queue__the_oldest_that_waits_is_told_whatever_its_priority),
        TEST(test_queue__jobs_run_where_nobody_listens),
        TEST(test_queue__an_earlier_daemons_jobs_are_taken_up),
        TEST(test_queue__two_workers_end_every_job_once),
        TEST(test_queue__a_race_of_cancel_and_end_has_one_outcome),
        TEST(test_queue__followers_see_states_progress_and_the_end_in_rising_order),
        TEST(test_queue__a_key_has_as_many_jobs_queued_as_its_quota_and_none_more),
        TEST(test_queue__when_to_come_again_is_known_once_a_job_has_ended),
        TEST(test_queue__a_job_past_its_keys_running_quota_waits_beside_an_idle_worker),
        TEST(test_queue__owners_take_turns_and_priorities_go_first_among_ones_own),
        TEST(test_queue__a_job_that_needs_too_much_memory_fails_and_the_next_one_runs),
        TEST(test_queue__a_solve_that_is_stopped_ends_within_its_iteration),
        TEST(test_queue__a_job_waits_for_the_memory_that_another_holds),
        TEST(test_queue__a_job_is_not_here_for_another_owner),
        TEST(test_queue__a_key_makes_one_job_and_a_lost_mesh_none),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    drape_blas_prepare();
    return cmocka_run_group_tests(tests, NULL, NULL);
}
