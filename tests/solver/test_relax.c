/* test_relax.c - the trace is exact: each row tells what its state has, as another run finds it. */
#include "test.h"

#include "drape.h"

#define SIDE      9
#define VERTICES  (SIDE * SIDE)
#define TRIANGLES (2 * (SIDE - 1) * (SIDE - 1))

static const double warp_curve[] = {0.05, 1, 0.1, 3};

struct example {
    double positions[3 * VERTICES], pattern[2 * VERTICES], mass[VERTICES];
    uint32_t triangle[3 * TRIANGLES], pin[1];
    drape_material material;
    drape_body ball;
    drape_scene_desc desc;
};

/* A square held by a corner above a ball that it begins to touch, of a fabric with a curve. */
static void make(struct example *e)
{
    memset(e, 0, sizeof *e);
    const double cell = 0.02, density = 0.15;
    uint32_t *t = e->triangle;
    for (uint32_t i = 0; i < VERTICES; i++) {
        e->positions[3 * i] = e->pattern[2 * i] = cell * (i % SIDE);
        e->positions[3 * i + 2] = e->pattern[2 * i + 1] = cell * (i / SIDE);
    }
    for (uint32_t j = 0; j + 1 < SIDE; j++)
        for (uint32_t i = 0; i + 1 < SIDE; i++, t += 6) {
            uint32_t a = j * SIDE + i, corner[] = {a, a + SIDE, a + 1, a + 1, a + SIDE, a + SIDE + 1};
            memcpy(t, corner, sizeof corner);
            for (int k = 0; k < 6; k++)
                e->mass[corner[k]] += density * cell * cell / 6;
        }
    e->material = (drape_material){.density = density,
                                   .stretch_weft = 20,
                                   .stretch_shear = 8,
                                   .curve_warp = {2, warp_curve},
                                   .bend_weft = 1e-5,
                                   .bend_warp = 2e-5,
                                   .bend_twist = 5e-6};
    e->ball = (drape_body){
        .kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {0.08, -0.052, 0.08}, .radius = 0.05};
    e->desc = drape_scene_desc_default();
    e->desc.vertices = VERTICES;
    e->desc.triangles = TRIANGLES;
    e->desc.pins = 1;
    e->desc.materials = 1;
    e->desc.positions = e->positions;
    e->desc.pattern = e->pattern;
    e->desc.triangle = e->triangle;
    e->desc.pin = e->pin;
    e->desc.material = &e->material;
    e->desc.body = &e->ball;
    e->desc.bodies = 1;
}

/* Runs, gives the row of the state returned, and its positions into x. */
static drape_row run(const drape_scene_desc *desc, const drape_options *options, double x[3 * VERTICES])
{
    drape_scene *scene = NULL;
    drape_sim *sim = NULL;
    size_t rows, vertices;
    assert_int_equal(drape_scene_new(desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(drape_sim_new(scene, options, &sim, NULL), DRAPE_OK);
    assert_true(drape_sim_run(sim, NULL) >= 0);
    drape_row state = drape_sim_report(sim)->state;
    const drape_row *row = drape_sim_trace(sim, &rows);
    assert_true(state.iteration < rows);
    assert_memory_equal(&state, row + state.iteration, sizeof state);
    memcpy(x, drape_sim_positions(sim, &vertices), 3 * VERTICES * sizeof *x);
    drape_sim_free(sim);
    drape_scene_free(scene);
    return state;
}

static double weigh(const struct example *e, const double *x) /* gravity's energy against the start, J */
{
    double sum = 0;
    for (size_t i = 0; i < VERTICES; i++)
        sum += e->mass[i] * 9.81 * (x[3 * i + 1] - e->positions[3 * i + 1]);
    return sum;
}

/* ---- tests -------------------------------------------------------------------------------------- */

static void test_relax__a_row_holds_what_a_fresh_run_finds_at_its_state(void **state)
{
    (void)state;
    static const struct {
        drape_method method;
        drape_integrator integrator;
        bool ball;
    } way[] = {
        {DRAPE_METHOD_AUTO, DRAPE_BACKWARD_EULER, false},
        {DRAPE_METHOD_AUTO, DRAPE_BACKWARD_EULER, true},
        {DRAPE_METHOD_STOP_AND_GO, DRAPE_BACKWARD_EULER, true},
        {DRAPE_METHOD_STOP_AND_GO, DRAPE_BDF2, true},
        {DRAPE_METHOD_DYNAMIC, DRAPE_IMPLICIT_MIDPOINT, true},
        {DRAPE_METHOD_DYNAMIC, DRAPE_RK4, true},
        {DRAPE_METHOD_QUASI_STATIC, DRAPE_BACKWARD_EULER, true},
        {DRAPE_METHOD_NEWTON, DRAPE_BACKWARD_EULER, true},
    };
    unsigned touching = 0, moved = 0;
    for (size_t w = 0; w < sizeof way / sizeof *way; w++)
        for (uint32_t k = 1; k <= 24; k += 1 + k / 4) {
            struct example e;
            make(&e);
            e.desc.bodies = way[w].ball;
            drape_options options = drape_options_default();
            options.method = way[w].method;
            options.integrator = way[w].integrator;
            options.line_search = true;
            options.time_step = way[w].integrator == DRAPE_RK4 ? 5e-4 : 0.01;
            options.tolerance = 1e-300;
            options.max_iterations = k;
            double x[3 * VERTICES], same[3 * VERTICES];
            drape_row row = run(&e.desc, &options, x);
            drape_scene_desc there = e.desc;
            there.positions = x;
            options.max_iterations = 0;
            drape_row fresh = run(&there, &options, same);
            assert_memory_equal(x, same, sizeof x);
            assert_true(row.energy.stretch == fresh.energy.stretch && row.energy.bend == fresh.energy.bend &&
                        row.energy.contact == fresh.energy.contact &&
                        row.residual_force == fresh.residual_force);
            assert_true(fresh.energy.gravity == 0 && fresh.energy.kinetic == 0);
            assert_near(row.energy.gravity, weigh(&e, x), 1e-13,
                        e.mass[VERTICES / 2] * 9.81 * VERTICES * 0.1);
            assert_near(row.energy.potential,
                        row.energy.stretch + row.energy.bend + row.energy.contact + row.energy.gravity, 1e-15,
                        row.energy.stretch + fabs(row.energy.gravity));
            touching += row.energy.contact > 0;
            moved += row.iteration > 0;
        }
    assert_true(touching > 30 && moved > 60);
}

static void test_relax__kinetic_energy_is_that_of_the_step_just_made(void **state)
{
    (void)state;
    struct example e;
    make(&e);
    double before[3 * VERTICES], x[3 * VERTICES];
    memcpy(before, e.positions, sizeof before);
    for (uint32_t k = 1; k <= 8; k++) {
        drape_options options = drape_options_default();
        options.method = DRAPE_METHOD_DYNAMIC;
        options.time_step = 0.01;
        options.tolerance = 1e-300;
        options.max_iterations = k;
        drape_row row = run(&e.desc, &options, x);
        assert_int_equal(row.iteration, k); /* while it falls, the last state is the lowest */
        double sum = 0;
        for (size_t i = 0; i < 3 * VERTICES; i++) {
            double v = (x[i] - before[i]) / options.time_step;
            sum += 0.5 * e.mass[i / 3] * v * v;
        }
        assert_close(row.energy.kinetic, sum, 1e-12);
        memcpy(before, x, sizeof x);
    }
}

int main(void)
{
    drape_blas_prepare();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_relax__a_row_holds_what_a_fresh_run_finds_at_its_state),
        cmocka_unit_test(test_relax__kinetic_energy_is_that_of_the_step_just_made),
    };
    return cmocka_run_group_tests_name("relax", tests, NULL, NULL);
}
