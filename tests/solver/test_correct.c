/* test_correct.c - what a local velocity correction takes from a node, and what it leaves alone. */
#include "test.h"

#include "state.h"

#define NODES 64

struct example {
    struct dr_mesh mesh;
    struct dr_cloth cloth;
    struct dr_method method;
    struct dr_state s;
    bool held[NODES];
    double mass[NODES], v[3 * NODES], f[3 * NODES], scratch[3 * NODES], past[2][3 * NODES];
};

/* Random velocities, forces of `size` newtons and a random past; every fifth node is held and at rest. */
static void make(struct example *e, double size, unsigned history)
{
    uint64_t seed = 2007;
    memset(e, 0, sizeof *e);
    e->mesh = (struct dr_mesh){.nodes = NODES, .held = e->held, .mass = e->mass};
    e->cloth.mesh = &e->mesh;
    e->method = (struct dr_method){.moves = true, .extra = 1 + history, .scheme = {.history = history}};
    e->s = (struct dr_state){.cloth = &e->cloth,
                             .method = &e->method,
                             .v = e->v,
                             .f = e->f,
                             .extra = {e->scratch, e->past[0], e->past[1]}};
    for (size_t i = 0; i < 3 * NODES; i++) {
        e->held[i / 3] = i / 3 % 5 == 0;
        e->mass[i / 3] = 1 + 0.01 * (double)(i / 3);
        e->v[i] = e->held[i / 3] ? 0 : test_random(&seed);
        e->f[i] = size * test_random(&seed);
        e->scratch[i] = test_random(&seed);
        e->past[0][i] = test_random(&seed);
        e->past[1][i] = test_random(&seed);
    }
    e->s.row.energy.kinetic = dr_state_kinetic(&e->s);
}

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double length(const double *a)
{
    return sqrt(dot(a, a));
}

static void test_correct__only_what_runs_against_the_force_is_dropped(void **state)
{
    (void)state;
    static const double size[] = {1, 1e-200, 1e200}; /* N: squares of the last two leave the doubles */
    for (size_t k = 0; k < sizeof size / sizeof *size; k++) {
        struct example e, was;
        size_t corrected = 0, free_nodes = 0;
        make(&e, size[k], 0);
        was = e;
        dr_state_correct(&e.s);
        for (size_t i = 0; i < NODES; i++) {
            const double *v = e.v + 3 * i, *old = was.v + 3 * i, *f = e.f + 3 * i;
            double unit[3] = {f[0] / size[k], f[1] / size[k], f[2] / size[k]};
            free_nodes += !e.held[i];
            if (e.held[i] || dot(old, unit) >= 0) {
                assert_memory_equal(v, old, 3 * sizeof *v);
                continue;
            }
            corrected++;
            assert_true(dot(v, unit) >= -1e-15 * length(old) * length(unit));
            assert_true(length(v) <= length(old));
            double share = dot(old, unit) / dot(unit, unit); /* v + share f is the old v again */
            for (int d = 0; d < 3; d++)
                assert_near(v[d] + share * unit[d], old[d], 1e-14, 1);
        }
        assert_true(corrected > free_nodes / 4 && corrected < free_nodes * 3 / 4);
        assert_true(e.s.row.energy.kinetic < was.s.row.energy.kinetic);
        assert_true(e.s.row.energy.kinetic == dr_state_kinetic(&e.s));
        assert_memory_equal(e.scratch, was.scratch, sizeof e.scratch);
    }
}

static void test_correct__the_history_forgets_the_same_direction(void **state)
{
    (void)state;
    struct example e, was;
    make(&e, 1, 2);
    was = e;
    dr_state_correct(&e.s);
    for (size_t i = 0; i < NODES; i++)
        for (int k = 0; k < 2; k++) {
            const double *past = e.past[k] + 3 * i, *old = was.past[k] + 3 * i, *f = e.f + 3 * i;
            if (!memcmp(e.v + 3 * i, was.v + 3 * i, 3 * sizeof *e.v)) {
                assert_memory_equal(past, old, 3 * sizeof *past);
                continue;
            }
            assert_near(dot(past, f), 0, 1e-15, 1);
            double share = dot(old, f) / dot(f, f);
            for (int d = 0; d < 3; d++)
                assert_near(past[d] + share * f[d], old[d], 1e-14, 1);
        }
    assert_memory_equal(e.scratch, was.scratch, sizeof e.scratch);
}

static void test_correct__no_force_corrects_nothing(void **state)
{
    (void)state;
    struct example e, was;
    make(&e, 0, 2);
    was = e;
    dr_state_correct(&e.s);
    assert_memory_equal(e.v, was.v, sizeof e.v);
    assert_memory_equal(e.past, was.past, sizeof e.past);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_correct__only_what_runs_against_the_force_is_dropped),
        cmocka_unit_test(test_correct__the_history_forgets_the_same_direction),
        cmocka_unit_test(test_correct__no_force_corrects_nothing),
    };
    return cmocka_run_group_tests_name("correct", tests, NULL, NULL);
}
