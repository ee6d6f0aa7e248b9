/* test_idempotency.c - what a key is, who holds one, what is answered under it; and that many who post the
 * same at once make one job. */
#include "../solver/scarce.h"

#include "shelf.h"

#include <pthread.h>
#include <stdatomic.h>

#include "idempotency.h"

/* ---- keys --------------------------------------------------------------------------------------- */

static void expect_key(const char *header, const char *key)
{
    char got[IDEMPOTENCY_KEY_SIZE];
    int result = idempotency_key_parse(header, got);
    if ((result == 0) != (key != NULL) || (key != NULL && strcmp(got, key) != 0))
        fail_msg("<%s> gave %d, <%s>", header, result, result == 0 ? got : "");
}

static void test_idempotency__a_key_is_a_string_or_the_same_bare(void **state)
{
    (void)state;
    expect_key("8e03978e-40d5-43dd-bc93-6894a57f9324", "8e03978e-40d5-43dd-bc93-6894a57f9324");
    expect_key("\"8e03978e-40d5-43dd-bc93-6894a57f9324\"", "8e03978e-40d5-43dd-bc93-6894a57f9324");
    expect_key("\"a\\\"b\\\\c\"", "a\"b\\c");
    expect_key("a\\b", "a\\b");
    expect_key("!~", "!~");
}

static void test_idempotency__what_is_no_key_is_refused(void **state)
{
    (void)state;
    const char *refused[] = {"",         "\"\"",      "\"",    "\"a",       "a\"",        "a b",
                             "\"a b\"",  " a",        "a\x7f", "\"a\x1f\"", "\"a\" ;x=1", "\"a\"b",
                             "\"a\\b\"", "k\xc3\xa4", "\"a\\", "\"a\\\""};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        expect_key(refused[i], NULL);
}

static void test_idempotency__a_key_has_255_characters_at_most(void **state)
{
    (void)state;
    char text[600], escaped[600] = "\"";
    for (int n = 255; n <= 256; n++) {
        memset(text, 'k', (size_t)n);
        text[n] = '\0';
        expect_key(text, n == 255 ? text : NULL);
        for (int i = 0; i < n; i++)
            memcpy(escaped + 1 + 2 * i, "\\\"", 2);
        memcpy(escaped + 1 + 2 * n, "\"", 2);
        memset(text, '"', (size_t)n);
        expect_key(escaped, n == 255 ? text : NULL);
    }
}

/* ---- claims ------------------------------------------------------------------------------------- */

static void test_idempotency__a_key_is_held_by_one_of_each_owner(void **state)
{
    (void)state;
    struct claims *claims = claims_new();
    struct claim a = {0}, b = {0}, c = {0};
    assert_true(claims_take(claims, &a, "shop", "k"));
    assert_false(claims_take(claims, &b, "shop", "k"));
    assert_false(b.held);
    claims_release(claims, &b); /* changes nothing */
    assert_false(claims_take(claims, &b, "shop", "k"));
    assert_true(claims_take(claims, &b, "studio", "k"));
    assert_true(claims_take(claims, &c, "shop", "l"));
    claims_release(claims, &a); /* neither the first nor the last in the list */
    claims_release(claims, &a);
    assert_true(claims_take(claims, &a, "shop", "k"));
    claims_release(claims, &c);
    claims_release(claims, &b);
    claims_release(claims, &a);
    assert_null(claims_free(claims));
    assert_null(claims_free(NULL));
}

#ifdef CAN_FAIL_ALLOCATIONS
static void test_idempotency__without_memory_there_are_no_claims(void **state)
{
    (void)state;
    countdown = 0;
    assert_null(claims_new());
    assert_int_equal(countdown, -1);
    struct claims *claims = claims_new();
    assert_non_null(claims);
    claims_free(claims);
}
#endif

/* ---- answers ------------------------------------------------------------------------------------ */

#define DIGEST "00000000000000000000000000000000000000000000000000000000000000aa"

static int add_keyed(struct store *store, const char *owner, const char *key, int64_t at_ms, struct job *ret)
{
    struct store_submission submission = {
        .document = "{}", .bytes = 2, .key = key, .digest = DIGEST, .answer = "{\"a\":1}", .at_ms = at_ms};
    struct problem problem;
    memset(ret, 0, sizeof *ret);
    id_new(ret->id);
    snprintf(ret->owner, sizeof ret->owner, "%s", owner);
    ret->revision = (struct revision){1, 1};
    return store_job_add(store, ret, &submission, &problem);
}

static int ask(struct store *store, const char *owner, const char *key, int64_t now_ms,
               struct store_answer *ret)
{
    struct problem problem;
    return store_answer_get(store, owner, key, now_ms, ret, &problem);
}

static void test_idempotency__an_answer_is_kept_with_the_job_for_a_day(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_answer answer;
    struct job job, other;
    const int64_t at = 1000000;
    assert_int_equal(ask(store, "shop", "k", at, &answer), STORE_NONE);
    assert_int_equal(add_keyed(store, "shop", "k", at, &job), 0);
    store = store_close(store);
    store = open_store(*state);
    assert_int_equal(ask(store, "shop", "k", at + STORE_ANSWER_MS - 1, &answer), 0);
    assert_string_equal(answer.job, job.id);
    assert_string_equal(answer.digest, DIGEST);
    assert_string_equal(answer.body, "{\"a\":1}");
    free(answer.body);
    assert_int_equal(ask(store, "shop", "k", at + STORE_ANSWER_MS, &answer), STORE_NONE);
    assert_int_equal(ask(store, "studio", "k", at, &answer), STORE_NONE);
    assert_int_equal(ask(store, "shop", "K", at, &answer), STORE_NONE);
    assert_int_equal(add_keyed(store, "studio", "k", at, &other), 0);
    /* It outlives its job. */
    assert_int_equal(store_job_cancel_queued(store, &job, &problem), 0);
    assert_int_equal(store_job_remove(store, "shop", job.id, 1, &problem), 0);
    assert_int_equal(ask(store, "shop", "k", at, &answer), 0);
    free(answer.body);
    store_close(store);
}

static void test_idempotency__a_key_that_is_taken_makes_no_job(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_answer answer;
    struct job first, second, back;
    assert_int_equal(add_keyed(store, "", "k", 1000, &first), 0);
    assert_int_equal(add_keyed(store, "", "k", 1000 + STORE_ANSWER_MS - 1, &second), STORE_TAKEN);
    assert_int_equal(store_job_get(store, "", second.id, &back, &problem), STORE_NONE);
    assert_int_equal(count_entries(*state, "jobs"), 1);
    /* A day later it is free, and the new answer is in its place. */
    assert_int_equal(add_keyed(store, "", "k", 1000 + STORE_ANSWER_MS, &second), 0);
    assert_int_equal(ask(store, "", "k", 1001 + STORE_ANSWER_MS, &answer), 0);
    assert_string_equal(answer.job, second.id);
    free(answer.body);
    store_close(store);
}

static void test_idempotency__a_job_that_is_not_taken_leaves_its_key_free(void **state)
{
    struct store *store = open_store(*state);
    struct problem problem;
    struct store_answer answer;
    struct job job = {.revision = {1, 1}};
    const char mesh[][SHA256_SIZE] = {DIGEST}; /* never uploaded */
    struct store_submission submission = {.document = "{}",
                                          .bytes = 2,
                                          .mesh = mesh,
                                          .meshes = 1,
                                          .key = "k",
                                          .digest = DIGEST,
                                          .answer = "{}"};
    id_new(job.id);
    assert_int_equal(store_job_add(store, &job, &submission, &problem), STORE_WITHOUT);
    assert_int_equal(ask(store, "", "k", 0, &answer), STORE_NONE);
    assert_int_equal(count_entries(*state, "jobs"), 0);
    store_close(store);
}

/* ---- the race ----------------------------------------------------------------------------------- */

#define THREADS 8
#define KEYS    60

struct race {
    struct store *store;
    struct claims *claims; /* NULL: the store alone must keep them apart */
    atomic_int made, in_flight, taken, replayed, wrong;
    char id[KEYS][ID_SIZE]; /* as each thread was told; the first writes, the others compare */
    pthread_mutex_t lock;
};

static void note_answer(struct race *race, int key, const char *id)
{
    pthread_mutex_lock(&race->lock);
    if (race->id[key][0] == '\0')
        memcpy(race->id[key], id, ID_SIZE);
    else if (strcmp(race->id[key], id) != 0)
        atomic_fetch_add(&race->wrong, 1);
    pthread_mutex_unlock(&race->lock);
}

/* Posts until there is an answer, as a client would; as api_jobs.c does it. */
static void post(struct race *race, int number)
{
    char key[16];
    snprintf(key, sizeof key, "key-%d", number);
    for (;;) {
        struct claim claim = {0};
        struct store_answer answer;
        struct job job;
        if (race->claims != NULL && !claims_take(race->claims, &claim, "shop", key)) {
            atomic_fetch_add(&race->in_flight, 1);
            sched_yield();
            continue;
        }
        int found = ask(race->store, "shop", key, 1000, &answer);
        int added = found == STORE_NONE ? add_keyed(race->store, "shop", key, 1000, &job) : -2;
        if (race->claims != NULL)
            claims_release(race->claims, &claim);
        if (added == STORE_TAKEN) {
            atomic_fetch_add(&race->taken, 1);
            continue;
        }
        atomic_fetch_add(found == 0 ? &race->replayed : &race->made, 1);
        if (found < 0 || added == -1)
            atomic_fetch_add(&race->wrong, 1);
        note_answer(race, number, found == 0 ? answer.job : job.id);
        if (found == 0)
            free(answer.body);
        return;
    }
}

static void *race_main(void *data)
{
    for (int k = 0; k < KEYS; k++) {
        post(data, k);
        post(data, k); /* each posts twice */
    }
    return NULL;
}

static void run_race(const char *dir, bool claimed)
{
    struct race race = {.store = open_store(dir), .claims = claimed ? claims_new() : NULL};
    struct found found;
    pthread_t thread[THREADS];
    pthread_mutex_init(&race.lock, NULL);
    for (int i = 0; i < THREADS; i++)
        assert_int_equal(pthread_create(&thread[i], NULL, race_main, &race), 0);
    for (int i = 0; i < THREADS; i++)
        pthread_join(thread[i], NULL);
    print_message("%d made, %d replayed, %d in flight, %d taken\n", race.made, race.replayed, race.in_flight,
                  race.taken);
    assert_int_equal(race.wrong, 0);
    assert_int_equal(race.made, KEYS);
    assert_int_equal(race.replayed, 2 * THREADS * KEYS - KEYS);
    if (claimed)
        assert_int_equal(race.taken, 0);
    assert_int_equal(recover(race.store, &found), KEYS);
    assert_int_equal(count_entries(dir, "jobs"), KEYS);
    pthread_mutex_destroy(&race.lock);
    claims_free(race.claims);
    store_close(race.store);
}

static void test_idempotency__of_many_who_post_the_same_one_makes_the_job(void **state)
{
    run_race(*state, true);
}

static void test_idempotency__the_store_keeps_them_apart_by_itself(void **state)
{
    run_race(*state, false);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_idempotency__a_key_is_a_string_or_the_same_bare),
        cmocka_unit_test(test_idempotency__what_is_no_key_is_refused),
        cmocka_unit_test(test_idempotency__a_key_has_255_characters_at_most),
        cmocka_unit_test(test_idempotency__a_key_is_held_by_one_of_each_owner),
#ifdef CAN_FAIL_ALLOCATIONS
        cmocka_unit_test(test_idempotency__without_memory_there_are_no_claims),
#endif
        TEST(test_idempotency__an_answer_is_kept_with_the_job_for_a_day),
        TEST(test_idempotency__a_key_that_is_taken_makes_no_job),
        TEST(test_idempotency__a_job_that_is_not_taken_leaves_its_key_free),
        TEST(test_idempotency__of_many_who_post_the_same_one_makes_the_job),
        TEST(test_idempotency__the_store_keeps_them_apart_by_itself),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
