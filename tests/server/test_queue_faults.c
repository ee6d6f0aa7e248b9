/* test_queue_faults.c - the queue where memory, the store or threads fail, and where cancels, ends and stops
 * come at the worst moment.
 *
 * Allocations fail by scarce.h, in the thread that asks for it. Commits fail, or wait, by SQLite's commit
 * hook. pthread_create fails, and a thread that has just let go of its last lock can be held up there: the
 * mutexes of this program are ours. */
#include "../solver/scarce.h"

#include "rig.h"
#include "shelf.h"

#include <dlfcn.h>
#include <pthread.h>

#include "drape.h"
#include "log.h"

/* ---- commits ------------------------------------------------------------------------------------ */

static atomic_int commits_let;         /* so many go through, */
static atomic_int refused;             /* and the others, counted here, do not */
static int (*_Atomic at_commit)(void); /* asked once, instead: nonzero refuses */
static struct rig *rig;                /* of the test that runs, for those hooks */
static char hooked[ID_SIZE];           /* the job that they are about */

static int on_commit(void *data)
{
    (void)data;
    int (*ask)(void) = atomic_exchange(&at_commit, NULL);
    if (ask != NULL)
        return ask();
    if (atomic_fetch_sub(&commits_let, 1) > 0)
        return 0;
    atomic_fetch_add(&refused, 1);
    return 1;
}

static int hook_commits(sqlite3 *db, char **message, const struct sqlite3_api_routines *api)
{
    (void)message, (void)api;
    sqlite3_commit_hook(db, on_commit, NULL);
    return SQLITE_OK;
}

static void let_commits(int n)
{
    atomic_store(&refused, 0);
    atomic_store(&commits_let, n);
}

static void let_all_commits(void)
{
    let_commits(1 << 30);
}

/* ---- threads and locks -------------------------------------------------------------------------- */

static atomic_int threads_left = -1; /* until one fails to start; -1: none does */

/* The function of that name that would have been called without us. */
#define NEXT(name) ((__typeof__(&name))(uintptr_t)dlsym(RTLD_NEXT, #name))

int pthread_create(pthread_t *thread, const pthread_attr_t *attr, void *(*run)(void *), void *arg)
{
    int left = atomic_load(&threads_left);
    if (left >= 0)
        atomic_store(&threads_left, left - 1);
    return left == 0 ? EAGAIN : NEXT(pthread_create)(thread, attr, run, arg);
}

static _Thread_local int locks;               /* that this thread holds */
static _Thread_local void (*when_free)(void); /* called once it holds none */

int pthread_mutex_lock(pthread_mutex_t *mutex)
{
    static __typeof__(&pthread_mutex_lock) next;
    if (next == NULL)
        next = NEXT(pthread_mutex_lock);
    locks++;
    return next(mutex);
}

int pthread_mutex_trylock(pthread_mutex_t *mutex)
{
    int result = NEXT(pthread_mutex_trylock)(mutex);
    locks += result == 0;
    return result;
}

int pthread_mutex_unlock(pthread_mutex_t *mutex)
{
    static __typeof__(&pthread_mutex_unlock) next;
    if (next == NULL)
        next = NEXT(pthread_mutex_unlock);
    int result = next(mutex);
    void (*run)(void) = --locks == 0 ? when_free : NULL;
    if (run != NULL) {
        when_free = NULL;
        run();
    }
    return result;
}

/* ---- what they share ---------------------------------------------------------------------------- */

static int set_up(void **state)
{
    if (rig_new(state) != 0)
        return -1;
    rig = *state;
    let_all_commits();
    return 0;
}

/* Waits until the body of a job has `text`; "": until it is not here. */
static void wait_body(const char *id, const char *text)
{
    for (int64_t limit = clock_monotonic_ms() + 60000; clock_monotonic_ms() < limit; pause_ms(1)) {
        char *body = NULL;
        struct revision revision;
        int found = queue_body(rig->queue, "", id, &body, &revision);
        bool hit = text[0] == '\0' ? found == QUEUE_NONE : found == 0 && strstr(body, text) != NULL;
        free(body);
        if (hit)
            return;
    }
    fail_msg("job %s: waited in vain for '%s'", id, text);
}

static void wait_refusals(int n)
{
    for (int64_t limit = clock_monotonic_ms() + 60000; atomic_load(&refused) < n; pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
}

static void expect_row(const char *id, enum job_status status, unsigned attempt, unsigned crashes)
{
    struct job job;
    get_job(rig->store, id, &job);
    assert_int_equal(job.status, status);
    assert_int_equal(job.revision.attempt, attempt);
    assert_int_equal(job.crashes, crashes);
    job_done(&job);
}

/* A queue that holds still, with one job in it: hooked. `ask` is asked when that is committed. */
static void open_with_one_asking(const char *document, int (*ask)(void))
{
    struct problem problem;
    open_rig(rig, 1, 10);
    queue_hold(rig->queue, true);
    atomic_store(&at_commit, ask);
    assert_int_equal(submit(rig, document, hooked, &problem), 0);
}

static void open_with_one(const char *document)
{
    open_with_one_asking(document, NULL);
}

static void expect_end(enum job_status status)
{
    struct job job;
    wait_end(rig, hooked, &job);
    assert_int_equal(job.status, status);
    assert_int_equal(job.revision.attempt, 1);
    job_done(&job);
    wait_body(hooked, "");
    assert_int_equal(rig->ends, 1);
}

static void expect_counts(size_t queued, size_t running)
{
    size_t are_queued, are_running;
    queue_count(rig->queue, &are_queued, &are_running);
    assert_int_equal(are_queued, queued);
    assert_int_equal(are_running, running);
}

/* ---- a store that refuses ----------------------------------------------------------------------- */

static void test_queue_faults__a_job_that_the_store_refuses_leaves_nothing(void **state)
{
    (void)state;
    struct problem problem;
    char id[ID_SIZE];
    open_rig(rig, 1, 1);
    let_commits(0);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(submit(rig, "{}", id, &problem), -1);
        assert_int_equal(problem.code, PROBLEM_STORAGE);
        expect_counts(0, 0);
        wait_body(id, "");
        assert_int_equal(count_entries(rig->dir, "jobs"), 0);
    }
    assert_int_equal(rig->changes, 0);
    let_all_commits();
    assert_int_equal(submit(rig, "{}", id, &problem), 0);
    close_rig(rig);
}

static void test_queue_faults__a_job_whose_start_is_refused_stays_first_and_runs_later(void **state)
{
    (void)state;
    struct problem problem;
    char second[ID_SIZE], order[2 * ID_SIZE + 1], *text = scratch_square(2, "auto", 50);
    open_with_one(text);
    assert_int_equal(submit(rig, text, second, &problem), 0);
    let_commits(0);
    queue_hold(rig->queue, false);
    wait_refusals(1);
    wait_body(hooked, "\"queue_position\":1,");
    wait_body(second, "\"queue_position\":2,");
    expect_counts(2, 0);
    expect_row(hooked, JOB_QUEUED, 1, 0);
    let_all_commits();
    wait_body(hooked, "");
    wait_body(second, "");
    expect_row(hooked, JOB_SUCCEEDED, 1, 0);
    snprintf(order, sizeof order, "%s %s ", hooked, second);
    assert_string_equal(rig->started, order);
    free(text);
    close_rig(rig);
}

static void test_queue_faults__an_end_that_is_refused_is_tried_again(void **state)
{
    (void)state;
    char *text = scratch_square(2, "auto", 50);
    open_with_one(text);
    let_commits(1); /* its start */
    queue_hold(rig->queue, false);
    wait_refusals(1);
    wait_body(hooked, "\"status\":\"running\"");
    expect_row(hooked, JOB_RUNNING, 1, 0);
    assert_int_equal(rig->ends, 0);
    let_all_commits();
    expect_end(JOB_SUCCEEDED);
    free(text);
    close_rig(rig);
}

static void test_queue_faults__an_end_that_is_refused_until_the_stop_is_left_to_the_next_start(void **state)
{
    (void)state;
    char *text = scratch_square(2, "auto", 50);
    open_with_one(text);
    let_commits(1);
    queue_hold(rig->queue, false);
    wait_refusals(1);
    close_rig(rig);
    let_all_commits();
    assert_int_equal(rig->ends, 0);
    open_rig(rig, 1, 10);
    wait_body(hooked, "");
    expect_row(hooked, JOB_SUCCEEDED, 2, 1);
    free(text);
    close_rig(rig);
}

static void test_queue_faults__a_cancel_that_is_refused_cancels_nothing(void **state)
{
    (void)state;
    struct problem problem;
    char *body = NULL, *text = long_job();
    open_with_one(text);
    let_commits(0);
    assert_int_equal(queue_cancel(rig->queue, "", hooked, &body, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    wait_body(hooked, "\"queue_position\":1,");
    let_all_commits();
    queue_hold(rig->queue, false);
    wait_body(hooked, "\"status\":\"running\"");
    let_commits(0);
    assert_int_equal(queue_cancel(rig->queue, "", hooked, &body, &problem), -1);
    let_all_commits();
    pause_ms(20);
    expect_counts(0, 1);
    assert_int_equal(queue_cancel(rig->queue, "", hooked, &body, &problem), 0);
    free(body);
    expect_end(JOB_CANCELED);
    free(text);
    close_rig(rig);
}

static void test_queue_faults__a_start_fails_where_nothing_can_be_recovered(void **state)
{
    (void)state;
    struct problem problem;
    make_rig(rig, 1, 10);
    let_commits(0);
    assert_int_equal(queue_start(rig->queue, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    let_all_commits();
    assert_int_equal(queue_start(rig->queue, &problem), 0);
    close_rig(rig);
}

static void test_queue_faults__a_start_fails_where_a_worker_cannot_be_had(void **state)
{
    (void)state;
    struct problem problem;
    make_rig(rig, 3, 10);
    atomic_store(&threads_left, 2);
    assert_int_equal(queue_start(rig->queue, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_INTERNAL);
    assert_int_equal(atomic_load(&threads_left), -1);
    close_rig(rig); /* with the two that there are */
}

/* ---- moments ------------------------------------------------------------------------------------ */

static void expect_not_here(void)
{
    struct problem problem;
    char *body;
    expect_row(hooked, JOB_QUEUED, 1, 0);
    assert_int_equal(queue_cancel(rig->queue, "", hooked, &body, &problem), QUEUE_NONE);
}

static int look_before_it_is_in_line(void)
{
    when_free = expect_not_here;
    return 0;
}

/* Somebody may read of it in the list as soon as the store has it. */
static void test_queue_faults__a_job_is_not_here_before_it_is_in_line(void **state)
{
    (void)state;
    char *text = scratch_square(2, "auto", 50);
    open_with_one_asking(text, look_before_it_is_in_line);
    wait_body(hooked, "\"queue_position\":1,");
    queue_hold(rig->queue, false);
    expect_end(JOB_SUCCEEDED);
    free(text);
    close_rig(rig);
}

static int let_it_be_taken(void)
{
    queue_hold(rig->queue, false);
    wait_body(hooked, "\"queue_position\":null"); /* a worker has it, and waits for the database */
    return 0;
}

static void test_queue_faults__a_job_canceled_between_its_turn_and_its_start_does_not_run(void **state)
{
    (void)state;
    struct problem problem;
    char *body, *text = long_job();
    open_with_one(text);
    atomic_store(&at_commit, let_it_be_taken);
    assert_int_equal(queue_cancel(rig->queue, "", hooked, &body, &problem), 0);
    assert_non_null(strstr(body, "\"status\":\"canceled\""));
    free(body);
    expect_end(JOB_CANCELED);
    assert_string_equal(rig->started, "");
    expect_counts(0, 0);
    free(text);
    close_rig(rig);
}

static void cancel_hooked(void)
{
    struct problem problem;
    char *body;
    assert_int_equal(queue_cancel(rig->queue, "", hooked, &body, &problem), 0);
    free(body);
}

static int refuse_then_cancel(void)
{
    when_free = cancel_hooked;
    return 1;
}

static void test_queue_faults__a_job_canceled_after_its_start_was_refused_is_not_put_back(void **state)
{
    (void)state;
    char *text = long_job();
    open_with_one(text);
    atomic_store(&at_commit, refuse_then_cancel);
    queue_hold(rig->queue, false);
    expect_end(JOB_CANCELED);
    expect_counts(0, 0);
    free(text);
    close_rig(rig);
}

static atomic_bool may_go;

static void wait_to_go(void)
{
    for (int64_t limit = clock_monotonic_ms() + 60000; !atomic_load(&may_go); pause_ms(1))
        assert_true(clock_monotonic_ms() < limit);
}

static void wait_next_time(void)
{
    when_free = wait_to_go;
}

/* The start is committed, then shown: behind that the worker waits. */
static int wait_when_running(void)
{
    when_free = wait_next_time;
    return 0;
}

static void let_it_end(void)
{
    atomic_store(&may_go, true);
    wait_body(hooked, "");
}

static int end_before_the_cancel_is_shown(void)
{
    when_free = let_it_end;
    return 0;
}

static void test_queue_faults__a_job_may_end_before_its_cancel_is_shown(void **state)
{
    (void)state;
    struct problem problem;
    char *body = NULL, *text = scratch_square(2, "auto", 50);
    atomic_store(&may_go, false);
    open_with_one(text);
    atomic_store(&at_commit, wait_when_running);
    queue_hold(rig->queue, false);
    wait_body(hooked, "\"status\":\"running\"");
    atomic_store(&at_commit, end_before_the_cancel_is_shown);
    assert_int_equal(queue_cancel(rig->queue, "", hooked, &body, &problem), QUEUE_NONE);
    assert_null(body);
    expect_end(JOB_SUCCEEDED);
    free(text);
    close_rig(rig);
}

static int interrupt_queue(void)
{
    queue_interrupt(rig->queue);
    return 0;
}

static void test_queue_faults__a_stop_between_its_turn_and_its_start_puts_a_job_back(void **state)
{
    (void)state;
    char *text = long_job();
    open_with_one(text);
    atomic_store(&at_commit, interrupt_queue);
    queue_hold(rig->queue, false);
    wait_body(hooked, "\"revision\":\"2.1\"");
    expect_row(hooked, JOB_QUEUED, 2, 0);
    expect_counts(1, 0);
    free(text);
    close_rig(rig);
}

/* ---- memory ------------------------------------------------------------------------------------- */

#ifdef CAN_FAIL_ALLOCATIONS

/* Whether the allocation that was to fail was asked for. */
static bool over(void)
{
    bool was_asked = countdown < 0;
    countdown = -1;
    return was_asked;
}

static void test_queue_faults__a_queue_is_made_or_nothing_is_held(void **state)
{
    (void)state;
    struct queue_setup setup = {.limits = &limits_default, .workers = 2};
    bool failed;
    long n = 0;
    do {
        long before = held;
        countdown = n++;
        struct queue *queue = queue_new(&setup);
        failed = over();
        assert_int_equal(queue == NULL, failed);
        assert_null(queue_free(queue));
        assert_int_equal(held, before);
    } while (failed);
    assert_int_equal(n, 4);
}

/* A re-drape under a key: what it starts from is kept before it is submitted. */
static int submit_start(const char *from, long n, char id[ID_SIZE], bool *ret_failed, struct problem *reterr)
{
    struct job job = {.name = strdup("again")};
    struct store_submission submission = {
        .document = "{}", .bytes = 2, .key = id, .digest = OLD_DIGEST, .at_ms = 1000};
    char *body = NULL;
    id_new(job.id);
    memcpy(id, job.id, ID_SIZE);
    assert_int_equal(store_start_keep(rig->store, "", id, from, "f", reterr), 0);
    countdown = n;
    int result = queue_submit(rig->queue, &job, &submission, &body, reterr);
    *ret_failed = over();
    if (result == 0)
        assert_non_null(strstr(body, id));
    if (result == 0)
        free(body);
    job_done(&job);
    return result;
}

static void expect_nothing_of(const char *id, size_t documents)
{
    struct problem problem;
    struct job job;
    assert_int_equal(store_job_get(rig->store, "", id, &job, &problem), STORE_NONE);
    assert_int_equal(count_entries(rig->dir, "jobs"), documents);
    wait_body(id, "");
    expect_counts(0, 0);
}

static void test_queue_faults__a_job_is_taken_or_nothing_is_left_of_it(void **state)
{
    (void)state;
    struct problem problem;
    struct job ended;
    char id[ID_SIZE], *body;
    long refusals = 0, n = 0;
    bool failed;
    open_rig(rig, 1, 1);
    queue_hold(rig->queue, true);
    add_finished(rig->store, "f", &ended);
    do {
        int result = submit_start(ended.id, n++, id, &failed, &problem);
        if (result != 0) {
            refusals++;
            assert_true(failed && result == -1);
            assert_true(problem.code == PROBLEM_INTERNAL || problem.code == PROBLEM_STORAGE);
            expect_nothing_of(id, 1);
        } else {
            wait_body(id, "\"queue_position\":1,");
            expect_row(id, JOB_QUEUED, 1, 0);
            assert_int_equal(queue_cancel(rig->queue, "", id, &body, &problem), 0);
            free(body);
            assert_int_equal(store_job_remove(rig->store, "", id, 1, &problem), 0);
        }
    } while (failed);
    print_message("%ld allocations, %ld refusals\n", n - 1, refusals);
    assert_true(refusals > 10);
    close_rig(rig);
}

/* What an earlier daemon left is taken up, or there is no start: never half of it. */
static void test_queue_faults__earlier_jobs_are_taken_up_or_the_start_fails(void **state)
{
    (void)state;
    struct problem problem;
    char name[] = "left over";
    struct job job = {.name = name, .revision = {1, 1}};
    long refusals = 0, n = 0;
    bool failed;
    rig->store = open_store(rig->dir);
    id_new(job.id);
    assert_int_equal(add_row(rig->store, &job, "{}", 2, &problem), 0);
    store_close(rig->store);
    do {
        make_rig(rig, 1, 10);
        queue_hold(rig->queue, true);
        countdown = n++;
        int result = queue_start(rig->queue, &problem);
        failed = over();
        refusals += result != 0;
        assert_true(result == 0 || (failed && result == -1));
        if (result == 0)
            wait_body(job.id, "\"name\":\"left over\"");
        close_rig(rig);
    } while (failed);
    print_message("%ld allocations, %ld refusals\n", n - 1, refusals);
    assert_true(refusals > 10);
}

/* With allocation n failing; *ret_failed: whether it was asked for. */
static int try_body(const char *id, long n, bool *ret_failed)
{
    char *body = NULL;
    struct revision revision;
    countdown = n;
    int result = queue_body(rig->queue, "", id, &body, &revision);
    *ret_failed = over();
    assert_int_equal(body == NULL, result != 0);
    free(body);
    return result;
}

static int try_follow(const char *id, long n, bool *ret_failed)
{
    struct follower *follower;
    char chunk[4096];
    assert_int_equal(follower_new(rig->hub, "", 1, false, NULL, NULL, &follower), 0);
    countdown = n;
    int result = queue_follow(rig->queue, "", id, (struct revision){0, 0}, follower);
    *ret_failed = over();
    if (result == 0)
        assert_true(follower_pull(follower, chunk, sizeof chunk) > 0);
    follower_free(follower);
    return result;
}

static void test_queue_faults__a_job_is_shown_and_followed_or_that_fails(void **state)
{
    (void)state;
    int (*const try[])(const char *id, long n, bool *ret_failed) = {try_body, try_follow};
    open_with_one("{}");
    for (size_t i = 0; i < sizeof try / sizeof *try; i++) {
        bool failed = true;
        int refusals = 0;
        for (long n = 0; failed; n++) {
            int result = try[i](hooked, n, &failed);
            assert_true(result == 0 || (failed && result == -1));
            refusals -= result;
        }
        assert_true(refusals > 1);
    }
    close_rig(rig);
}

static void test_queue_faults__a_cancel_holds_whether_or_not_its_answer_can_be_told(void **state)
{
    (void)state;
    struct problem problem;
    int refusals = 0, untold = 0;
    bool failed = true;
    open_rig(rig, 1, 1);
    queue_hold(rig->queue, true);
    for (long n = 0; failed; n++) {
        char id[ID_SIZE], *body = NULL;
        assert_int_equal(submit(rig, "{}", id, &problem), 0);
        countdown = n;
        int result = queue_cancel(rig->queue, "", id, &body, &problem);
        failed = over();
        free(result == 0 ? body : NULL);
        refusals += result == -1;
        untold += result == QUEUE_NONE;
        expect_row(id, result == -1 ? JOB_QUEUED : JOB_CANCELED, 1, 0);
        wait_body(id, result == -1 ? "\"queue_position\":1," : "");
        if (result == -1)
            assert_int_equal(queue_cancel(rig->queue, "", id, &body, &problem), 0);
        if (result == -1)
            free(body);
        expect_counts(0, 0);
    }
    print_message("%d refusals, %d untold\n", refusals, untold);
    assert_true(refusals > 0 && untold > 0);
    close_rig(rig);
}

/* The last that the worker tells of a job's way: from here on it ends it. */
static void lack_memory_at_last(const char *body)
{
    if (strstr(body, "\"iteration\":5,") != NULL && strstr(body, "\"status\":\"running\"") != NULL)
        countdown = 0;
}

static void test_queue_faults__a_job_ends_though_memory_is_short_at_its_end(void **state)
{
    (void)state;
    char *text = scratch_square(2, "dynamic", 5);
    rig->heard = lack_memory_at_last;
    open_with_one(text);
    queue_hold(rig->queue, false);
    expect_end(JOB_SUCCEEDED);
    expect_counts(0, 0);
    free(text);
    close_rig(rig);
}
#endif

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, rig_free)
    const struct CMUnitTest tests[] = {
        TEST(test_queue_faults__a_job_that_the_store_refuses_leaves_nothing),
        TEST(test_queue_faults__a_job_whose_start_is_refused_stays_first_and_runs_later),
        TEST(test_queue_faults__an_end_that_is_refused_is_tried_again),
        TEST(test_queue_faults__an_end_that_is_refused_until_the_stop_is_left_to_the_next_start),
        TEST(test_queue_faults__a_cancel_that_is_refused_cancels_nothing),
        TEST(test_queue_faults__a_start_fails_where_nothing_can_be_recovered),
        TEST(test_queue_faults__a_start_fails_where_a_worker_cannot_be_had),
        TEST(test_queue_faults__a_job_is_not_here_before_it_is_in_line),
        TEST(test_queue_faults__a_job_canceled_between_its_turn_and_its_start_does_not_run),
        TEST(test_queue_faults__a_job_canceled_after_its_start_was_refused_is_not_put_back),
        TEST(test_queue_faults__a_job_may_end_before_its_cancel_is_shown),
        TEST(test_queue_faults__a_stop_between_its_turn_and_its_start_puts_a_job_back),
#ifdef CAN_FAIL_ALLOCATIONS
        TEST(test_queue_faults__a_queue_is_made_or_nothing_is_held),
        TEST(test_queue_faults__a_job_is_taken_or_nothing_is_left_of_it),
        TEST(test_queue_faults__earlier_jobs_are_taken_up_or_the_start_fails),
        TEST(test_queue_faults__a_job_is_shown_and_followed_or_that_fails),
        TEST(test_queue_faults__a_cancel_holds_whether_or_not_its_answer_can_be_told),
        TEST(test_queue_faults__a_job_ends_though_memory_is_short_at_its_end),
#endif
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    drape_blas_prepare();
    sqlite3_auto_extension((void (*)(void))hook_commits);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
