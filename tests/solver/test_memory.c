/* test_memory.c - whole runs that memory is short for: whatever allocation fails, alone or with all that come
 * after it, the run says so or ends as it would have, and nothing is left behind.
 *
 * Every SOME-th of them is met, with DRAPED_TEST_FAULTS=all each one (two minutes). */
#include "test.h"

#include "drape.h"
#include "scarce.h"

#ifdef CAN_FAIL_ALLOCATIONS

/* ---- scenes ------------------------------------------------------------------------------------- */

#define CELLS    4 /* along a side of a panel */
#define ROW      (CELLS + 1)
#define PER      (ROW * ROW)
#define VERTICES (2 * PER)

/* Two panels of 0.2 m, one 1.5 mm above the other, so that cloth touches cloth; nothing else yet. */
struct example {
    double positions[3 * VERTICES], pattern[2 * VERTICES], smaller[2 * VERTICES], curve[4];
    uint32_t triangle[12 * CELLS * CELLS], seam[2 * ROW], pin[2], edge[4];
    drape_material material;
    drape_body ball, table;
    drape_elastic elastic;
    drape_fold fold;
    drape_tack tack;
    drape_scene_desc desc;
    drape_options options;
};

static const double corner[] = {0, -0.1, 0, 0.3, -0.1, 0, 0, -0.1, 0.3, 0, -0.4, 0};
static const double moved[] = {0.01, -0.1, 0, 0.31, -0.1, 0, 0.01, -0.1, 0.3, 0.01, -0.4, 0};
static const double *const keyframe[] = {moved};
static const uint32_t side[] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};

static void make(struct example *e)
{
    memset(e, 0, sizeof *e);
    uint32_t *t = e->triangle;
    for (uint32_t v = 0; v < VERTICES; v++) {
        double u = 0.2 * (v % ROW) / CELLS, w = 0.2 * (v % PER / ROW) / CELLS;
        e->pattern[2 * v] = e->positions[3 * v] = u;
        e->pattern[2 * v + 1] = e->positions[3 * v + 2] = w;
        e->positions[3 * v + 1] = v < PER ? 0.0015 : 0;
        e->smaller[2 * v] = u / 1.2;
        e->smaller[2 * v + 1] = w / 1.2;
    }
    for (uint32_t c = 0; c < 2 * CELLS * CELLS; c++, t += 6) {
        uint32_t cell = c % (CELLS * CELLS),
                 a = c / (CELLS * CELLS) * PER + cell / CELLS * ROW + cell % CELLS;
        const uint32_t up[] = {a, a + ROW, a + 1, a + 1, a + ROW, a + ROW + 1};
        memcpy(t, up, sizeof up);
    }
    for (uint32_t i = 0; i < 2; i++)
        e->pin[i] = i * CELLS;
    e->material = (drape_material){.density = 0.1,
                                   .stretch_weft = 10,
                                   .stretch_warp = 10,
                                   .stretch_shear = 5,
                                   .bend_weft = 1e-5,
                                   .bend_warp = 1e-5,
                                   .bend_twist = 5e-6};
    e->ball = (drape_body){.kind = DRAPE_BODY_SPHERE,
                           .offset = 0.003,
                           .friction = 0.3,
                           .point = {0.1, -0.052, 0.1},
                           .radius = 0.05};
    e->desc = drape_scene_desc_default();
    e->desc.vertices = VERTICES;
    e->desc.triangles = 4 * CELLS * CELLS;
    e->desc.pins = 2;
    e->desc.materials = 1;
    e->desc.positions = e->positions;
    e->desc.pattern = e->pattern;
    e->desc.triangle = e->triangle;
    e->desc.pin = e->pin;
    e->desc.material = &e->material;
    e->options = drape_options_default();
    e->options.max_iterations = 2;
}

/* One edge of the panels sewn to the other's, 30 mm away; both touch a ball, and one another. */
static void dress(struct example *e)
{
    for (uint32_t i = 0; i < ROW; i++) {
        e->seam[2 * i] = CELLS * ROW + i;
        e->seam[2 * i + 1] = PER + CELLS * ROW + i;
        e->positions[3 * (PER + CELLS * ROW + i) + 2] += 0.03;
    }
    e->desc.seams = ROW;
    e->desc.seam = e->seam;
    e->desc.bodies = 1;
    e->desc.body = &e->ball;
    e->desc.self_contact = DRAPE_SELF_CONTACT_ON;
}

static void trim(struct example *e)
{
    static const uint32_t edge[] = {ROW, ROW + 1, ROW + 1, ROW + 2};
    memcpy(e->edge, edge, sizeof edge);
    e->elastic = (drape_elastic){e->edge, 2, 0.9, 5};
    e->fold = (drape_fold){e->edge, 2, 0.5, 1e-4};
    e->tack = (drape_tack){.vertex = 2 * ROW + 2, .triangle = DRAPE_NO_TRIANGLE, .point = {0.1, 0, 0.1}};
    e->desc.elastics = e->desc.folds = e->desc.tacks = 1;
    e->desc.elastic = &e->elastic;
    e->desc.fold = &e->fold;
    e->desc.tack = &e->tack;
    const double curve[] = {0.1, 1, 0.2, 3};
    memcpy(e->curve, curve, sizeof curve);
    e->material.curve_weft = (drape_curve){2, e->curve};
}

/* Whatever it comes to is rest, and is to be certified: in 20 to 40 factorisations it is not. */
static void prove(struct example *e)
{
    e->options.certify = true;
    e->options.tolerance = 1e6;
    e->options.max_iterations = 1;
}

/* ---- running ------------------------------------------------------------------------------------ */

static void see(const drape_preview *preview, void *data)
{
    size_t *seen = data;
    *seen = preview->vertices;
}

struct end {
    bool failed; /* an allocation */
    drape_status status;
    drape_verdict verdict;
    double positions[3 * VERTICES];
};

static void run(struct example *e, struct end *ret)
{
    drape_scene *scene = NULL;
    drape_sim *sim = NULL;
    drape_error error = {0};
    size_t vertices;
    ret->status = drape_scene_new(&e->desc, &scene, &error);
    if (ret->status >= 0)
        ret->status = drape_sim_new(scene, &e->options, &sim, &error);
    if (ret->status >= 0)
        ret->status = drape_sim_run(sim, &error);
    ret->failed = has_failed();
    if (ret->status >= 0) {
        ret->verdict = drape_sim_report(sim)->verdict;
        memcpy(ret->positions, drape_sim_positions(sim, &vertices), sizeof ret->positions);
    } else {
        assert_int_equal(error.status, ret->status);
    }
    drape_sim_free(sim);
    drape_scene_free(scene);
}

#define SOME 11 /* prime, so that no loop of the solver is met at the same place each time */

static long stride(void)
{
    const char *faults = getenv("DRAPED_TEST_FAULTS");
    return faults && !strcmp(faults, "all") ? 1 : SOME;
}

/* Runs the example once for each allocation of a run, which fails, and again with all that follow it. */
static void starve(struct example *e, const char *what)
{
    struct end whole, end;
    long told = 0, survived = 0;
    run(e, &whole);
    if (whole.status < 0)
        fail_msg("%s: status %d", what, whole.status);
    for (int all = 0; all < 2; all++) {
        for (long n = 0;; n += stride()) {
            long before = held;
            lasting = all;
            fail_at(n);
            run(e, &end);
            if (held != before)
                fail_msg("%s: %ld blocks left after allocation %ld failed", what, held - before, n);
            if (!end.failed)
                break;
            if (end.status < 0) {
                assert_int_equal(end.status, DRAPE_ENOMEM);
                told++;
                continue;
            }
            survived++;
            if (memcmp(end.positions, whole.positions, sizeof end.positions) || end.verdict != whole.verdict)
                fail_msg("%s: another result after allocation %ld failed", what, n);
        }
    }
    lasting = false;
    print_message("  %-24s %ld failures told, %ld survived\n", what, told, survived);
    assert_true(told > 40);
}

static void test_memory__of_every_method(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        drape_method method;
        drape_integrator integrator;
        const char *certified; /* of each way to get a matrix for it, one; NULL: of another */
    } way[] = {
        {"auto", DRAPE_METHOD_AUTO, DRAPE_BACKWARD_EULER, "certified, exact for it"},
        {"stop-and-go", DRAPE_METHOD_STOP_AND_GO, DRAPE_BACKWARD_EULER, "certified, exact"},
        {"stop-and-go, bdf2", DRAPE_METHOD_STOP_AND_GO, DRAPE_BDF2, NULL},
        {"stop-and-go, midpoint", DRAPE_METHOD_STOP_AND_GO, DRAPE_IMPLICIT_MIDPOINT, NULL},
        {"stop-and-go, rk4", DRAPE_METHOD_STOP_AND_GO, DRAPE_RK4, "certified, its own"},
        {"dynamic", DRAPE_METHOD_DYNAMIC, DRAPE_BACKWARD_EULER, NULL},
        {"velocity-correction", DRAPE_METHOD_VELOCITY_CORRECTION, DRAPE_BDF2, NULL},
        {"quasi-static", DRAPE_METHOD_QUASI_STATIC, DRAPE_BACKWARD_EULER, NULL},
        {"newton", DRAPE_METHOD_NEWTON, DRAPE_BACKWARD_EULER, NULL},
    };
    for (size_t k = 0; k < sizeof way / sizeof *way; k++) {
        struct example e;
        make(&e);
        dress(&e);
        e.options.method = way[k].method;
        e.options.integrator = way[k].integrator;
        if (way[k].integrator == DRAPE_RK4)
            e.options.time_step = 1e-4;
        if (way[k].method == DRAPE_METHOD_NEWTON)
            e.desc.self_contact = DRAPE_SELF_CONTACT_OFF;
        starve(&e, way[k].name);
        if (way[k].certified) {
            prove(&e);
            starve(&e, way[k].certified);
        }
    }
}

static void test_memory__of_all_that_a_scene_may_have(void **state)
{
    (void)state;
    struct example e;
    size_t seen = 0;
    make(&e);
    dress(&e);
    for (size_t v = 0; v < PER; v++) /* or the coarse cloth would cross itself when it is carried up */
        e.positions[3 * v + 1] = 0.004;
    e.options.max_iterations = 1;
    e.desc.coarse = DRAPE_COARSE_ON;
    e.options.preview = see;
    e.options.preview_data = &seen;
    starve(&e, "coarse");
    assert_true(seen > 0);
    make(&e);
    dress(&e);
    trim(&e);
    e.options.fit = true;
    starve(&e, "lines, curves, fit");
    make(&e);
    dress(&e);
    e.desc.start_pattern = e.smaller;
    starve(&e, "ramp");
    make(&e);
    dress(&e);
    e.table = (drape_body){.offset = 0.003,
                           .friction = 0.3,
                           .positions = corner,
                           .triangle = side,
                           .vertices = 4,
                           .triangles = 4,
                           .keyframes = 1,
                           .keyframe = keyframe,
                           .motion_seconds = 0.04};
    e.desc.body = &e.table;
    starve(&e, "motion");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_memory__of_every_method),
        cmocka_unit_test(test_memory__of_all_that_a_scene_may_have),
    };
    return cmocka_run_group_tests_name("memory", tests, NULL, NULL);
}
#else
static void test_memory__of_every_method(void **state)
{
    (void)state;
    skip(); /* allocations cannot be made to fail here */
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_memory__of_every_method)};
    return cmocka_run_group_tests_name("memory", tests, NULL, NULL);
}
#endif
