/* test_hand.c - processors that are lent: to whom, when, and that both halves are always done. */
#include "hand.h"

#include <pthread.h>
#include <stdatomic.h>

#include "test.h"

/* What two halves leave. */
struct job {
    int runs[2];
    pthread_t thread[2];
    void (*inside)(struct job *job); /* in half 0; may be NULL */
    drape_processors *processors;
    bool lent; /* what `inside` found */
};

static void run(void *data, int half)
{
    struct job *job = data;
    job->runs[half]++;
    job->thread[half] = pthread_self();
    if (half == 0 && job->inside)
        job->inside(job);
}

/* Whether the second half was another thread's. */
static bool borrows(drape_processors *processors, void (*inside)(struct job *job))
{
    struct dr_hand hand = {.processors = processors};
    struct job job = {.inside = inside, .processors = processors};
    dr_hand_both(&hand, run, &job);
    assert_int_equal(job.runs[0], 1);
    assert_int_equal(job.runs[1], 1);
    assert_true(pthread_equal(job.thread[0], pthread_self()));
    bool other = !pthread_equal(job.thread[1], pthread_self());
    assert_true(other == (hand.seconds > 0));
    if (inside)
        assert_true(!job.lent);
    return other;
}

static void test_hand__one_processor_does_both_halves(void **state)
{
    (void)state;
    struct job job = {.runs = {0, 0}};
    dr_hand_both(NULL, run, &job);
    dr_hand_both(&(struct dr_hand){NULL, 0}, run, &job);
    assert_int_equal(job.runs[0], 2);
    assert_int_equal(job.runs[1], 2);
    for (size_t count = 0; count < 2; count++) {
        drape_processors *processors = drape_processors_new(count);
        assert_non_null(processors);
        dr_processors_enter(processors);
        assert_false(borrows(processors, NULL));
        dr_processors_leave(processors);
        drape_processors_free(processors);
    }
    drape_processors_free(NULL);
}

static void test_hand__a_processor_is_lent_while_nobody_uses_it(void **state)
{
    (void)state;
    drape_processors *processors = drape_processors_new(2);
    assert_non_null(processors);
    dr_processors_enter(processors);
    for (int i = 0; i < 100; i++)
        assert_true(borrows(processors, NULL));
    dr_processors_enter(processors); /* another sim */
    assert_false(borrows(processors, NULL));
    dr_processors_leave(processors);
    assert_true(borrows(processors, NULL));
    dr_processors_leave(processors);
    drape_processors_free(processors);
}

static void borrow_inside(struct job *job)
{
    job->lent = borrows(job->processors, NULL);
}

static void test_hand__a_processor_is_lent_to_one_at_a_time(void **state)
{
    (void)state;
    drape_processors *processors = drape_processors_new(3);
    assert_non_null(processors);
    dr_processors_enter(processors);
    assert_true(borrows(processors, borrow_inside)); /* three there are, but one helper */
    dr_processors_enter(processors);
    assert_true(borrows(processors, borrow_inside)); /* and now none that is idle */
    dr_processors_leave(processors);
    dr_processors_leave(processors);
    drape_processors_free(processors);
}

#define SIMS  4
#define TURNS 500

struct crowd {
    drape_processors *processors;
    atomic_int at_work, most;
};

struct member {
    struct crowd *crowd;
    long sum[2];
    double seconds;
};

static void add_up(void *data, int half)
{
    struct member *member = data;
    int working = atomic_fetch_add(&member->crowd->at_work, 1) + 1, most = atomic_load(&member->crowd->most);
    while (working > most && !atomic_compare_exchange_weak(&member->crowd->most, &most, working))
        ;
    for (int i = 0; i < 100; i++)
        member->sum[half] += i;
    atomic_fetch_sub(&member->crowd->at_work, 1);
}

static void *take_turns(void *data)
{
    struct member *member = data;
    struct dr_hand hand = {.processors = member->crowd->processors};
    for (int i = 0; i < TURNS; i++) {
        dr_processors_enter(hand.processors);
        dr_hand_both(&hand, add_up, member);
        dr_processors_leave(hand.processors);
    }
    member->seconds = hand.seconds;
    return NULL;
}

/* Also what ThreadSanitizer looks at. */
static void test_hand__a_crowd_never_has_more_than_there_are(void **state)
{
    (void)state;
    struct crowd crowd = {.processors = drape_processors_new(SIMS)};
    assert_non_null(crowd.processors);
    pthread_t thread[SIMS];
    struct member member[SIMS];
    for (int i = 0; i < SIMS; i++) {
        member[i] = (struct member){.crowd = &crowd};
        assert_int_equal(pthread_create(&thread[i], NULL, take_turns, &member[i]), 0);
    }
    for (int i = 0; i < SIMS; i++) {
        pthread_join(thread[i], NULL);
        assert_int_equal(member[i].sum[0], TURNS * 4950);
        assert_int_equal(member[i].sum[1], TURNS * 4950);
    }
    assert_true(atomic_load(&crowd.most) <= SIMS);
    drape_processors_free(crowd.processors);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_hand__one_processor_does_both_halves),
        cmocka_unit_test(test_hand__a_processor_is_lent_while_nobody_uses_it),
        cmocka_unit_test(test_hand__a_processor_is_lent_to_one_at_a_time),
        cmocka_unit_test(test_hand__a_crowd_never_has_more_than_there_are),
    };
    return cmocka_run_group_tests_name("hand", tests, NULL, NULL);
}
