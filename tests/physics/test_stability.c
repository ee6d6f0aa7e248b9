/* test_stability.c - the short form of the stability suite: whatever comes in, what goes out is finite
 * and never worse than the start. `make check-stability` runs every case under every method. */
#include "../stability/rows.h"

#include "test.h"

#define ITERATIONS          60
#define EXPLICIT_ITERATIONS 600
#define TIME_LIMIT          10.0 /* s */
#define PATIENCE            60.0
#define OTHERS              2 /* methods beside auto that each case runs under, in turn */
#define TWICE_EVERY         2 /* rows, one of which is run twice */
#define WORKERS             2

static struct row_job make_job(const struct stability_case *which, const struct stability_method *method,
                               size_t number)
{
    return (struct row_job){
        .which = which,
        .method = method,
        .max_iterations = method->integrator == DRAPE_RK4 ? EXPLICIT_ITERATIONS : ITERATIONS,
        .time_limit = TIME_LIMIT,
        .patience = PATIENCE,
        .twice = number % TWICE_EVERY == 0,
    };
}

/* Each case of the group under auto and, as the cases go by, under each other method in its turn. */
static void check_group(enum group group)
{
    FILE *const out[] = {stdout, NULL};
    struct row_job *job = calloc(stability_cases * (1 + OTHERS), sizeof *job);
    size_t jobs = 0, turn = 0;
    assert_non_null(job);
    for (size_t c = 0; c < stability_cases; c++) {
        const struct stability_case *which = stability_case + c;
        if (which->group != group || which->large)
            continue;
        job[jobs] = make_job(which, stability_method, jobs);
        jobs++;
        for (size_t k = 0; k < OTHERS && which->expectation != MUST_REFUSE; k++, turn++, jobs++)
            job[jobs] = make_job(which, stability_method + 1 + turn % (stability_methods - 1), jobs);
    }
    assert_true(jobs > 0);
    rows_head(out);
    size_t violations = rows_run(job, jobs, WORKERS, out);
    free(job);
    assert_int_equal(violations, 0);
}

static void test_stability__any_material(void **state)
{
    (void)state;
    check_group(IN_MATERIAL);
}

static void test_stability__any_time_step(void **state)
{
    (void)state;
    check_group(IN_STEP);
}

static void test_stability__any_mesh(void **state)
{
    (void)state;
    check_group(IN_MESH);
}

static void test_stability__any_start(void **state)
{
    (void)state;
    check_group(IN_START);
}

static void test_stability__any_gravity(void **state)
{
    (void)state;
    check_group(IN_GRAVITY);
}

static void test_stability__any_seams(void **state)
{
    (void)state;
    check_group(IN_SEAMS);
}

static void test_stability__any_bodies(void **state)
{
    (void)state;
    check_group(IN_BODIES);
}

static void test_stability__any_layers(void **state)
{
    (void)state;
    check_group(IN_LAYERS);
}

static void test_stability__what_cannot_be_draped_is_refused_by_name(void **state)
{
    (void)state;
    check_group(IN_REFUSALS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_stability__any_material),
        cmocka_unit_test(test_stability__any_time_step),
        cmocka_unit_test(test_stability__any_mesh),
        cmocka_unit_test(test_stability__any_start),
        cmocka_unit_test(test_stability__any_gravity),
        cmocka_unit_test(test_stability__any_seams),
        cmocka_unit_test(test_stability__any_bodies),
        cmocka_unit_test(test_stability__any_layers),
        cmocka_unit_test(test_stability__what_cannot_be_draped_is_refused_by_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
