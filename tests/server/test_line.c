/* test_line.c - who is next: turns of owners, priorities, quotas, memory; and the positions that are told. */
#include "scratch.h"

#include "keys.h"
#include "line.h"
#include "log.h"

#define PLACES 32

struct rig {
    char *dir;
    struct limits limits;
    struct keys *keys;
    struct line *line;
    struct place place[PLACES];
    size_t places;
    char order[4 * PLACES];
};

static int rig_new(void **state)
{
    static struct rig rig;
    void *dir;
    memset(&rig, 0, sizeof rig);
    if (scratch_new(&dir) != 0)
        return -1;
    rig.dir = dir;
    rig.limits = limits_default;
    rig.line = line_new(NULL, &rig.limits);
    *state = &rig;
    return rig.line == NULL ? -1 : 0;
}

static int rig_free(void **state)
{
    struct rig *rig = *state;
    void *dir = rig->dir;
    line_free(rig->line);
    keys_free(rig->keys);
    return scratch_free(&dir);
}

/* A job of a one-letter owner; its name is the owner and its number among all. */
static struct place *add(struct rig *rig, const char *owner, int priority, uint64_t memory)
{
    assert_true(rig->places < PLACES);
    struct place *place = &rig->place[rig->places++];
    *place = (struct place){.priority = priority, .memory = memory};
    place->share = line_hold(rig->line, owner);
    assert_non_null(place->share);
    line_enter(rig->line, place, false);
    return place;
}

/* The next job's worker begins; its name goes to rig->order. NULL: none may. */
static struct place *take(struct rig *rig)
{
    struct place *place = line_take(rig->line);
    char name[KEY_NAME_SIZE + 16];
    if (place != NULL) {
        snprintf(name, sizeof name, "%s%d ", place->share->owner, (int)(place - rig->place));
        strcat(rig->order, name);
        assert_false(place->waiting);
        assert_int_equal(line_position(rig->line, place), 0);
    }
    return place;
}

static void end(struct rig *rig, struct place *place)
{
    struct share *share = place->share;
    line_let_go(rig->line, share); /* the job's own hold */
    line_give_back(rig->line, share, place->memory);
}

/* One worker that takes whatever is next, until nothing is. */
static const char *run_all(struct rig *rig)
{
    struct place *place;
    while ((place = take(rig)) != NULL)
        end(rig, place);
    return rig->order;
}

static void test_line__one_owners_jobs_start_as_they_came(void **state)
{
    struct rig *rig = *state;
    for (int i = 0; i < 3; i++)
        add(rig, "a", 0, 0);
    assert_string_equal(run_all(rig), "a0 a1 a2 ");
    assert_null(line_take(rig->line));
}

static void test_line__owners_take_turns_however_many_jobs_one_has(void **state)
{
    struct rig *rig = *state;
    for (int i = 0; i < 4; i++)
        add(rig, "a", 0, 0);
    add(rig, "b", 0, 0);
    add(rig, "c", 0, 0);
    add(rig, "b", 0, 0);
    assert_string_equal(run_all(rig), "a0 b4 c5 a1 b6 a2 a3 ");
}

static void test_line__an_owner_that_comes_later_waits_one_turn_of_each_other(void **state)
{
    struct rig *rig = *state;
    for (int i = 0; i < 3; i++)
        add(rig, "a", 0, 0);
    struct place *running = take(rig);
    add(rig, "b", 0, 0);
    end(rig, running);
    assert_string_equal(run_all(rig), "a0 a1 b3 a2 ");
}

static void test_line__higher_priority_goes_first_among_its_owners_jobs_only(void **state)
{
    struct rig *rig = *state;
    add(rig, "a", JOB_PRIORITY_LOW, 0);
    add(rig, "a", JOB_PRIORITY_NORMAL, 0);
    add(rig, "a", JOB_PRIORITY_HIGH, 0);
    add(rig, "a", JOB_PRIORITY_HIGH, 0);
    add(rig, "b", JOB_PRIORITY_LOW, 0);
    assert_string_equal(run_all(rig), "a2 b4 a3 a1 a0 ");
}

static void test_line__a_job_that_could_not_begin_is_next_again(void **state)
{
    struct rig *rig = *state;
    add(rig, "a", 0, 0);
    add(rig, "a", 0, 0);
    struct place *place = take(rig);
    line_enter(rig->line, place, true);
    line_give_back(rig->line, place->share, place->memory);
    assert_string_equal(run_all(rig), "a0 a0 a1 ");
}

static void test_line__who_leaves_from_the_middle_is_not_missed(void **state)
{
    struct rig *rig = *state;
    struct place *gone[] = {add(rig, "a", 0, 0), NULL, NULL};
    add(rig, "a", 0, 0);
    gone[1] = add(rig, "a", 0, 0);
    add(rig, "a", 0, 0);
    gone[2] = add(rig, "a", 0, 0);
    for (int i = 0; i < 3; i++) {
        line_leave(rig->line, gone[i]);
        line_leave(rig->line, gone[i]); /* a second time is fine */
        line_let_go(rig->line, gone[i]->share);
    }
    assert_string_equal(run_all(rig), "a1 a3 ");
}

/* ---- quotas ------------------------------------------------------------------------------------------ */

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
    if (rig->keys != NULL) {
        assert_int_equal(keys_reload(rig->keys, &problem), 0);
        return;
    }
    assert_int_equal(keys_open(path, &rig->limits.key, &rig->keys, &problem), 0);
    line_free(rig->line);
    rig->line = line_new(rig->keys, &rig->limits);
    assert_non_null(rig->line);
}

static void test_line__an_owner_at_its_quota_of_running_jobs_lets_others_pass(void **state)
{
    struct rig *rig = *state;
    open_keys(rig, ",\"running\":2");
    for (int i = 0; i < 4; i++)
        add(rig, "a", 0, 0);
    struct place *first = take(rig);
    assert_non_null(take(rig)); /* the second is at the quota */
    assert_null(take(rig));     /* the third past it */
    add(rig, "b", 0, 0);
    assert_non_null(take(rig));
    assert_null(take(rig));
    end(rig, first);
    assert_non_null(take(rig));
    assert_null(take(rig));
    open_keys(rig, ",\"running\":3");
    assert_non_null(take(rig));
    assert_string_equal(rig->order, "a0 a1 b4 a2 a3 ");
}

/* ---- memory ------------------------------------------------------------------------------------------- */

static void test_line__jobs_run_together_up_to_the_limit_and_not_a_byte_past_it(void **state)
{
    struct rig *rig = *state;
    rig->limits.memory = 100;
    add(rig, "a", 0, 60);
    add(rig, "b", 0, 40);
    add(rig, "a", 0, 1);
    struct place *first = take(rig);
    assert_non_null(take(rig)); /* 100 of 100 */
    assert_int_equal(line_memory(rig->line), 100);
    assert_null(take(rig));
    end(rig, first);
    assert_non_null(take(rig));
    assert_int_equal(line_memory(rig->line), 41);
}

static void test_line__a_large_job_is_not_overtaken_and_runs_alone_at_last(void **state)
{
    struct rig *rig = *state;
    rig->limits.memory = 100;
    add(rig, "a", 0, 10);
    add(rig, "b", 0, 1000); /* of a time when there was more */
    add(rig, "a", 0, 10);
    struct place *small = take(rig), *large;
    assert_null(take(rig));
    end(rig, small);
    assert_non_null(large = take(rig));
    assert_null(take(rig));
    end(rig, large);
    assert_non_null(take(rig));
    assert_string_equal(rig->order, "a0 b1 a2 ");
}

/* ---- positions ---------------------------------------------------------------------------------------- */

/* What is told of the jobs from number `first` on is how they come. */
static void expect_positions(struct rig *rig, size_t first, const size_t *expected)
{
    for (size_t i = first; i < rig->places; i++)
        assert_int_equal(line_position(rig->line, &rig->place[i]), expected[i - first]);
    for (size_t n = 1; n <= rig->places - first; n++) {
        struct place *place = take(rig);
        assert_non_null(place);
        assert_int_equal(expected[(size_t)(place - rig->place) - first], n);
        end(rig, place);
    }
}

static void test_line__positions_are_the_order_of_starts(void **state)
{
    struct rig *rig = *state;
    add(rig, "a", 0, 0);
    add(rig, "a", 0, 0);
    add(rig, "a", 0, 0);
    add(rig, "b", 0, 0);
    add(rig, "c", JOB_PRIORITY_LOW, 0);
    add(rig, "c", JOB_PRIORITY_HIGH, 0);
    assert_int_equal(line_next(rig->line, "a"), 1);
    assert_int_equal(line_next(rig->line, "b"), 2);
    assert_int_equal(line_next(rig->line, "c"), 3);
    expect_positions(rig, 0, (const size_t[]){1, 4, 6, 2, 5, 3});
    assert_int_equal(line_next(rig->line, "a"), 0);
    assert_int_equal(line_next(rig->line, "nobody"), 0);
}

/* As while the jobs of a key are being committed: they are queued, and none is in the line yet. */
static void test_line__an_owner_of_whom_nothing_waits_has_no_next_job(void **state)
{
    struct rig *rig = *state;
    struct share *share = line_hold(rig->line, "a");
    assert_non_null(share);
    share->queued = 1;
    assert_int_equal(line_next(rig->line, "a"), 0);
    add(rig, "a", JOB_PRIORITY_LOW, 0);
    assert_int_equal(line_next(rig->line, "a"), 1);
    end(rig, take(rig)); /* the first hold is left */
    assert_int_equal(line_next(rig->line, "a"), 0);
    assert_null(take(rig));
    line_let_go(rig->line, share);
}

static void test_line__positions_hold_in_the_middle_of_a_round(void **state)
{
    struct rig *rig = *state;
    add(rig, "a", 0, 0);
    add(rig, "a", 0, 0);
    add(rig, "b", 0, 0);
    add(rig, "b", 0, 0);
    end(rig, take(rig));
    expect_positions(rig, 1, (const size_t[]){2, 1, 3});
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, rig_new, rig_free)
    const struct CMUnitTest tests[] = {
        TEST(test_line__one_owners_jobs_start_as_they_came),
        TEST(test_line__owners_take_turns_however_many_jobs_one_has),
        TEST(test_line__an_owner_that_comes_later_waits_one_turn_of_each_other),
        TEST(test_line__higher_priority_goes_first_among_its_owners_jobs_only),
        TEST(test_line__a_job_that_could_not_begin_is_next_again),
        TEST(test_line__who_leaves_from_the_middle_is_not_missed),
        TEST(test_line__an_owner_at_its_quota_of_running_jobs_lets_others_pass),
        TEST(test_line__jobs_run_together_up_to_the_limit_and_not_a_byte_past_it),
        TEST(test_line__a_large_job_is_not_overtaken_and_runs_alone_at_last),
        TEST(test_line__positions_are_the_order_of_starts),
        TEST(test_line__an_owner_of_whom_nothing_waits_has_no_next_job),
        TEST(test_line__positions_hold_in_the_middle_of_a_round),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
