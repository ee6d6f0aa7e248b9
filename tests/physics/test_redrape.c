/* test_redrape.c - a finished drape, draped again: nothing changed, another size, another place of the
 * pattern. */
#include "run.h"

#define GRAVITY 9.81

/* A square of 0.3 m held along one edge; alternate diagonals. */
static struct setup *hanging(double bend)
{
    struct setup *setup =
        setup_new(grid_new(GRID_ALTERNATING, 12, 12, 0.3, 0.3, 0), isotropic(0.2, 400, bend));
    pin_columns(setup, 1);
    return setup;
}

/* The setup starts where a run ended, as a drape of the pattern it had, which is copied to `pattern`. */
static void start_from(struct setup *setup, const struct run *run, double *pattern)
{
    memcpy(setup->x, run->x, 3 * setup->grid.vertices * sizeof *setup->x);
    memcpy(pattern, setup->grid.uv, 2 * setup->grid.vertices * sizeof *pattern);
    setup->desc.start_pattern = pattern;
}

static void scale_pattern(struct setup *setup, double by)
{
    for (size_t i = 0; i < 2 * setup->grid.vertices; i++)
        setup->grid.uv[i] *= by;
}

/* The weight's energy from the origin, so that runs of several starts compare. */
static double energy_at(const struct setup *setup, const struct run *run)
{
    const drape_energies *e = &run->report->state.energy;
    double sum = e->stretch + e->bend + e->contact;
    for (size_t t = 0; t < setup->grid.triangles; t++) {
        const uint32_t *v = setup->grid.triangle + 3 * t;
        double mass = setup->material.density * grid_area2(&setup->grid, v[0], v[1], v[2]) / 2;
        for (int k = 0; k < 3; k++)
            for (int d = 0; d < 3; d++)
                sum -= mass / 3 * setup->desc.gravity[d] * run->x[3 * (size_t)v[k] + (size_t)d];
    }
    return sum;
}

static void tell(const char *what, const struct setup *setup, const struct run *run)
{
    const drape_report *report = run->report;
    print_message("  %s: %s after %u iterations, ramp of %u steps and %u iterations, %.9g J\n", what,
                  drape_verdict_name(report->verdict), report->iterations, report->ramp_steps,
                  report->ramp_iterations, energy_at(setup, run));
}

static const drape_term *term_of(const drape_report *report, const char *name)
{
    for (size_t i = 0; i < report->terms; i++)
        if (strcmp(report->term[i].name, name) == 0)
            return report->term + i;
    fail_msg("no term %s", name);
    return NULL;
}

static void test_redrape__what_did_not_change_rests_at_once(void **state)
{
    (void)state;
    struct setup *setup = hanging(1e-4);
    double pattern[2 * 13 * 13];
    drape_options options = drape_options_default();
    struct run first = run_new(&setup->desc, &options);
    tell("first", setup, &first);
    assert_int_equal(first.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_string_equal(term_of(first.report, "ramp")->reason, "the start is not a drape");
    double before = energy_at(setup, &first);
    start_from(setup, &first, pattern);
    struct run again = run_new(&setup->desc, &options);
    tell("again", setup, &again);
    assert_int_equal(again.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(again.report->iterations, 1);
    assert_close(energy_at(setup, &again), before, 1e-6);
    assert_false(term_of(again.report, "ramp")->kept);
    assert_string_equal(term_of(again.report, "ramp")->reason, "the start is a drape of this pattern");
    run_done(&first);
    run_done(&again);
    setup_free(setup);
}

/* A load that friction holds is held from the first: without that it slips anew, by DR_FRICTION_SLIP or so.
 */
static void test_redrape__friction_holds_from_the_first(void **state)
{
    (void)state;
    struct setup *setup = setup_new(grid_new(GRID_ALTERNATING, 8, 8, 0.1, 0.1, 0), isotropic(0.2, 400, 1e-4));
    drape_body ground = {.kind = DRAPE_BODY_PLANE, .offset = 0.003, .friction = 0.3, .axis = {0, 1, 0}};
    double pattern[2 * 81], slope = atan(0.25);
    for (size_t i = 0; i < setup->grid.vertices; i++)
        setup->x[3 * i + 1] = 0.0029;
    setup->desc.body = &ground;
    setup->desc.bodies = 1;
    setup->desc.gravity[0] = GRAVITY * sin(slope);
    setup->desc.gravity[1] = -GRAVITY * cos(slope);
    drape_options options = drape_options_default();
    struct run first = run_new(&setup->desc, &options);
    tell("on a slope", setup, &first);
    start_from(setup, &first, pattern);
    struct run again = run_new(&setup->desc, &options);
    tell("again", setup, &again);
    assert_int_equal(again.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_in_range(again.report->iterations, 1, 2);
    for (size_t i = 0; i < 3 * setup->grid.vertices; i++)
        assert_near(again.x[i], first.x[i], 1e-6, 1);
    setup->desc.start_pattern = NULL; /* the test could fail: a placement there slips */
    struct run placed = run_new(&setup->desc, &options);
    assert_true(placed.x[0] > first.x[0] + 1e-4);
    run_done(&first);
    run_done(&again);
    run_done(&placed);
    setup_free(setup);
}

/* And so is a load that passes from layer to layer. */
static void test_redrape__friction_of_layers_holds_from_the_first(void **state)
{
    (void)state;
    struct setup *setup = setup_layers();
    drape_body ground = {.kind = DRAPE_BODY_PLANE, .offset = 0.003, .friction = 0.3, .axis = {0, 1, 0}};
    double pattern[2 * 14 * 7], slope = atan(0.2);
    setup->desc.body = &ground;
    setup->desc.bodies = 1;
    setup->desc.self_contact = DRAPE_SELF_CONTACT_ON;
    setup->desc.gravity[0] = GRAVITY * sin(slope);
    setup->desc.gravity[1] = -GRAVITY * cos(slope);
    drape_options options = drape_options_default();
    options.certify = true;
    struct run first = run_new(&setup->desc, &options);
    tell("layers on a slope", setup, &first);
    assert_int_equal(first.report->verdict, DRAPE_VERDICT_AT_REST);
    start_from(setup, &first, pattern);
    struct run again = run_new(&setup->desc, &options);
    tell("again", setup, &again);
    assert_int_equal(again.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_true(again.report->certificate.certified);
    assert_in_range(again.report->iterations, 1, 2);
    for (size_t i = 0; i < 3 * setup->grid.vertices; i++)
        assert_near(again.x[i], first.x[i], 1e-5, 1);
    run_done(&first);
    run_done(&again);
    setup_free(setup);
}

/* The same minimum as from scratch, in fewer iterations: near rest both take the same few of Newton. */
static void test_redrape__another_size_is_the_drape_from_scratch(void **state)
{
    (void)state;
    const double by[] = {1.05, 0.95, 1.4, 0.7};
    for (size_t n = 0; n < sizeof by / sizeof *by; n++) {
        struct setup *setup = hanging(1e-3);
        double pattern[2 * 13 * 13];
        drape_options options = drape_options_default();
        options.tolerance = 1e-6;
        for (size_t i = 0; i < setup->grid.vertices; i++) /* held where the larger pattern has it, too */
            setup->x[3 * i + 2] *= setup->x[3 * i] == 0 ? by[n] : 1;
        struct run first = run_new(&setup->desc, &options);
        start_from(setup, &first, pattern);
        scale_pattern(setup, by[n]);
        struct run warm = run_new(&setup->desc, &options);
        setup->desc.start_pattern = NULL;
        for (size_t i = 0; i < setup->grid.vertices; i++) {
            setup->x[3 * i] = setup->grid.uv[2 * i];
            setup->x[3 * i + 1] = 0;
            setup->x[3 * i + 2] = -setup->grid.uv[2 * i + 1];
        }
        struct run scratch = run_new(&setup->desc, &options);
        print_message("  pattern x%g\n", by[n]);
        tell("from scratch", setup, &scratch);
        tell("from the other", setup, &warm);
        assert_int_equal(warm.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_near(warm.report->change, fmax(by[n], 1 / by[n]) - 1, 1e-9, 1);
        assert_int_equal(warm.report->ramp_steps, ceil(fabs(log(by[n])) / 0.06));
        assert_near(energy_at(setup, &warm), energy_at(setup, &scratch), 1e-3,
                    fabs(energy_at(setup, &scratch)));
        assert_true(warm.report->iterations <= scratch.report->iterations);
        run_done(&first);
        run_done(&warm);
        run_done(&scratch);
        setup_free(setup);
    }
}

/* Growing alone: a flat sheet without gravity, held at one corner, is as flat in its new size. */
static void test_redrape__cloth_grows_with_its_pattern(void **state)
{
    (void)state;
    for (int mirrored = 0; mirrored < 2; mirrored++) {
        struct setup *setup = setup_new(grid_new(GRID_RANDOM, 6, 6, 0.1, 0.1, 0), isotropic(0.2, 400, 1e-4));
        double pattern[2 * 49];
        memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
        setup->pin[0] = grid_at(&setup->grid, 0, 0);
        setup->desc.pins = 1;
        memcpy(pattern, setup->grid.uv, sizeof pattern);
        setup->desc.start_pattern = pattern;
        for (size_t i = 0; i < setup->grid.vertices; i++) {
            setup->grid.uv[2 * i] *= 1.05;
            setup->grid.uv[2 * i + 1] *= 1.03;
            if (mirrored) { /* the old pattern laid out elsewhere, the other way up, turned */
                double u = pattern[2 * i], v = pattern[2 * i + 1];
                pattern[2 * i] = 3 + 0.6 * u + 0.8 * v;
                pattern[2 * i + 1] = 0.8 * u - 0.6 * v;
            }
        }
        drape_options options = drape_options_default();
        struct run run = run_new(&setup->desc, &options);
        tell("a flat sheet", setup, &run);
        assert_near(run.report->change, 0.05, 1e-9, 1);
        assert_true(run.row[0].energy.potential < 1e-9); /* 2 % of strain would be 1e-3 J */
        for (size_t i = 0; i < setup->grid.vertices; i++) {
            assert_near(run.x[3 * i], setup->grid.uv[2 * i], 1e-5, 1);
            assert_near(run.x[3 * i + 2], -setup->grid.uv[2 * i + 1], 1e-5, 1);
        }
        run_done(&run);
        setup_free(setup);
    }
}

/* A strip wound up in two turns, of which the inner one is held: shrunk by 8 %, the outer one would come to
 * lie 7 mm farther in, on the other side of the inner one. */
static void test_redrape__cloth_does_not_shrink_through_itself(void **state)
{
    (void)state;
    const double radius = 0.05, apart = 0.004, turn = 2 * 3.14159265358979323846;
    struct setup *setup =
        setup_new(grid_new(GRID_ALTERNATING, 64, 3, 2 * turn * radius, 0.03, 0), isotropic(0.2, 400, 1e-5));
    double pattern[2 * 65 * 4];
    memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
    setup->desc.self_contact = DRAPE_SELF_CONTACT_ON;
    memcpy(pattern, setup->grid.uv, sizeof pattern);
    setup->desc.start_pattern = pattern;
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        double angle = setup->grid.uv[2 * i] / radius, r = radius + apart * angle / turn;
        setup->x[3 * i] = r * cos(angle);
        setup->x[3 * i + 1] = r * sin(angle);
    }
    pin_columns(setup, 33);
    scale_pattern(setup, 0.92);
    drape_options options = drape_options_default();
    options.max_iterations = 30;
    struct run run = run_new(&setup->desc, &options);
    tell("a strip wound up", setup, &run);
    assert_in_range(run.report->ramp_steps, 1, 2);
    assert_int_equal(run.report->self_intersections, 0);
    run_done(&run);
    setup_free(setup);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_redrape__what_did_not_change_rests_at_once),
        cmocka_unit_test(test_redrape__friction_holds_from_the_first),
        cmocka_unit_test(test_redrape__friction_of_layers_holds_from_the_first),
        cmocka_unit_test(test_redrape__another_size_is_the_drape_from_scratch),
        cmocka_unit_test(test_redrape__cloth_grows_with_its_pattern),
        cmocka_unit_test(test_redrape__cloth_does_not_shrink_through_itself),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
