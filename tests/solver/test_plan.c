/* test_plan.c - what a run keeps and leaves out, and whose its bytes are. */
#include "test.h"

#include "plan.h"

#define SIDE      7
#define VERTICES  (SIDE * SIDE)
#define TRIANGLES (2 * (SIDE - 1) * (SIDE - 1))

static const double line[] = {0.1, 1};

struct example {
    double positions[3 * VERTICES], pattern[2 * VERTICES];
    double another[2 * VERTICES]; /* pattern, larger by a fifth */
    uint32_t triangle[3 * TRIANGLES], pin[SIDE], seam[2 * SIDE];
    drape_material material;
    drape_body ball;
    drape_scene_desc desc;
    drape_options options;
};

/* A horizontal square of linear, isotropic cloth, held by one edge, by the paper's method. */
static void make(struct example *e)
{
    memset(e, 0, sizeof *e);
    uint32_t *t = e->triangle;
    for (uint32_t i = 0; i < VERTICES; i++) {
        e->positions[3 * i] = e->pattern[2 * i] = 0.03 * (i % SIDE);
        e->positions[3 * i + 2] = e->pattern[2 * i + 1] = 0.03 * (i / SIDE);
    }
    for (size_t i = 0; i < sizeof e->another / sizeof *e->another; i++)
        e->another[i] = 1.2 * e->pattern[i];
    for (uint32_t j = 0; j + 1 < SIDE; j++)
        for (uint32_t i = 0; i + 1 < SIDE; i++, t += 6) {
            uint32_t a = j * SIDE + i, cell[] = {a, a + SIDE, a + 1, a + 1, a + SIDE, a + SIDE + 1};
            memcpy(t, cell, sizeof cell);
        }
    for (uint32_t i = 0; i < SIDE; i++)
        e->pin[i] = i;
    e->material = (drape_material){.density = 0.1,
                                   .stretch_weft = 10,
                                   .stretch_warp = 10,
                                   .stretch_shear = 5,
                                   .bend_weft = 1e-5,
                                   .bend_warp = 1e-5,
                                   .bend_twist = 5e-6};
    e->ball = (drape_body){.kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {9, 9, 9}, .radius = 0.1};
    e->desc = drape_scene_desc_default();
    e->desc.vertices = VERTICES;
    e->desc.triangles = TRIANGLES;
    e->desc.pins = SIDE;
    e->desc.materials = 1;
    e->desc.positions = e->positions;
    e->desc.pattern = e->pattern;
    e->desc.triangle = e->triangle;
    e->desc.pin = e->pin;
    e->desc.material = &e->material;
    e->options = drape_options_default();
    e->options.method = DRAPE_METHOD_STOP_AND_GO;
    e->options.max_iterations = 3;
    e->options.tolerance = 1e-300;
}

/* Cuts it in two, `gap` apart, to be sewn: the strip of triangles beside the middle row goes. */
static void cut(struct example *e, double gap)
{
    size_t kept = 0;
    for (size_t t = 0; t < TRIANGLES; t++) {
        uint32_t *corner = e->triangle + 3 * t, low = 0;
        for (int k = 0; k < 3; k++)
            low += corner[k] / SIDE < 3;
        if (low == 0 || low == 3)
            memmove(e->triangle + 3 * kept++, corner, 3 * sizeof *corner);
    }
    e->desc.triangles = kept;
    for (uint32_t i = 0; i < SIDE; i++) {
        e->seam[2 * i] = 2 * SIDE + i;
        e->seam[2 * i + 1] = 3 * SIDE + i;
    }
    e->desc.seams = SIDE;
    e->desc.seam = e->seam;
    for (uint32_t i = 3 * SIDE; i < VERTICES; i++)
        e->positions[3 * i + 2] += gap - 0.03;
}

static drape_report run(const struct example *e)
{
    drape_scene *scene = NULL;
    drape_sim *sim = NULL;
    drape_error error = {0};
    drape_status status = drape_scene_new(&e->desc, &scene, &error);
    if (status >= 0)
        status = drape_sim_new(scene, &e->options, &sim, &error);
    if (status >= 0)
        status = drape_sim_run(sim, &error);
    if (status < 0)
        fail_msg("%s: %s", drape_status_name(status), error.message);
    drape_report report = *drape_sim_report(sim);
    drape_sim_free(sim);
    drape_scene_free(scene);
    return report;
}

static const drape_term *term_of(const drape_report *report, const char *name)
{
    for (size_t i = 0; i < report->terms; i++)
        if (!strcmp(report->term[i].name, name))
            return &report->term[i];
    fail_msg("no term %s", name);
    return NULL;
}

static size_t sum(const drape_report *report)
{
    size_t bytes = 0;
    for (size_t i = 0; i < report->terms; i++)
        bytes += report->term[i].bytes;
    return bytes;
}

/* ---- tests -------------------------------------------------------------------------------------- */

static void test_plan__a_plain_scene_keeps_the_least(void **state)
{
    (void)state;
    struct example e;
    make(&e);
    drape_report report = run(&e);
    char kept[256] = "", left_out[256] = "";
    for (size_t i = 0; i < report.terms; i++) {
        const drape_term *term = &report.term[i];
        assert_int_equal(term->kept, term->bytes > 0);
        assert_int_equal(term->kept, term->reason[0] == '\0');
        strcat(strcat(term->kept ? kept : left_out, " "), term->name);
    }
    assert_string_equal(kept, " state trace stretch bend gravity jacobian geometric-stiffness velocities");
    assert_string_equal(left_out, " strain-stress-curves elastics folds contact friction tacks self-contact "
                                  "sewing coarse motion ramp conjugate-gradients certificate fit");
    assert_int_equal(term_of(&report, "trace")->bytes, 4 * sizeof(drape_row));
    assert_int_equal(term_of(&report, "gravity")->bytes, 3 * VERTICES * sizeof(double));
    assert_int_equal(term_of(&report, "geometric-stiffness")->bytes, 3 * TRIANGLES * sizeof(double));
    assert_int_equal(term_of(&report, "velocities")->bytes, (1 + 2) * 3 * VERTICES * sizeof(double));
    /* At least the 3x3 blocks of the factor's diagonal. */
    assert_true(term_of(&report, "jacobian")->bytes > 9 * (VERTICES - SIDE) * sizeof(double));
}

static void add_ball(struct example *e)
{
    e->desc.body = &e->ball;
    e->desc.bodies = 1;
}

static void add_curve(struct example *e)
{
    e->material.curve_warp = (drape_curve){1, line};
}

static const uint32_t edge[] = {3 * SIDE, 3 * SIDE + 1, 4 * SIDE + 1, 4 * SIDE + 2};

static void add_elastic(struct example *e)
{
    static const drape_elastic elastic = {edge, 2, 0.7, 30};
    e->desc.elastic = &elastic;
    e->desc.elastics = 1;
}

static void add_fold(struct example *e)
{
    static const drape_fold fold = {edge, 2, 1, 1e-3};
    e->desc.fold = &fold;
    e->desc.folds = 1;
}

static void add_tack(struct example *e)
{
    static const drape_tack tack = {.vertex = VERTICES - 1, .triangle = DRAPE_NO_TRIANGLE};
    add_ball(e);
    e->desc.tack = &tack;
    e->desc.tacks = 1;
}

static void take_bending(struct example *e)
{
    e->material.bend_weft = e->material.bend_warp = e->material.bend_twist = 0;
}

static void take_gravity(struct example *e)
{
    e->desc.gravity[1] = 0;
}

static void take_integrator(struct example *e)
{
    e->options.integrator = DRAPE_RK4;
    e->options.time_step = 1e-4;
}

static void take_quasi_static(struct example *e)
{
    e->options.method = DRAPE_METHOD_QUASI_STATIC;
}

static void take_auto(struct example *e)
{
    e->options.method = DRAPE_METHOD_AUTO;
}

static void take_newton(struct example *e)
{
    e->options.method = DRAPE_METHOD_NEWTON;
}

static void ask_for_the_fit(struct example *e)
{
    e->options.fit = true;
}

static void start_from_another_size(struct example *e)
{
    e->desc.start_pattern = e->another;
}

static void ask_for_more_iterations(struct example *e)
{
    e->options.max_iterations = 5;
}

static void test_plan__a_change_moves_its_own_terms_alone(void **state)
{
    (void)state;
    static const struct {
        void (*change)(struct example *e);
        const char *terms; /* that are kept or left out, or hold other bytes, because of it */
    } cases[] = {
        {add_ball, " contact self-contact"}, /* by itself, as a body may fold the cloth */
        {add_tack, " contact tacks self-contact"},
        {add_elastic, " elastics jacobian"}, /* its links */
        {add_fold, " bend folds jacobian"},  /* which it cuts */
        {add_curve, " strain-stress-curves"},
        {take_bending, " bend jacobian"}, /* the pattern is the mesh's alone */
        {take_gravity, " gravity"},
        {take_integrator, " jacobian geometric-stiffness velocities"},
        {take_quasi_static, " velocities"},
        {take_auto, " jacobian velocities conjugate-gradients"}, /* whose factor has hinges only */
        {take_newton, " jacobian velocities"},
        {ask_for_the_fit, " fit"},
        {start_from_another_size, " ramp"},
        {ask_for_more_iterations, " trace"},
    };
    struct example e;
    make(&e);
    const drape_report plain = run(&e);
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        make(&e);
        cases[c].change(&e);
        drape_report report = run(&e);
        char moved[256] = "";
        for (size_t i = 0; i < report.terms; i++) {
            assert_string_equal(report.term[i].name, plain.term[i].name);
            assert_int_equal(report.term[i].kept, report.term[i].bytes > 0);
            if (report.term[i].bytes != plain.term[i].bytes)
                strcat(strcat(moved, " "), report.term[i].name);
        }
        assert_string_equal(moved, cases[c].terms);
        assert_int_equal(report.peak_bytes, sum(&report));
    }
}

static void test_plan__sewing_has_its_own_bytes_and_gives_them_back(void **state)
{
    (void)state;
    struct example e;
    make(&e);
    cut(&e, 0.02);
    drape_report report = run(&e);
    assert_true(report.sewing_iterations > 0);
    const drape_term *sewing = term_of(&report, "sewing");
    assert_true(sewing->kept && sewing->bytes > term_of(&report, "jacobian")->bytes);
    assert_true(report.peak_bytes < sum(&report) && report.peak_bytes > sum(&report) - sewing->bytes);
    const size_t *phase = report.phase_bytes;
    assert_true(phase[DRAPE_PHASE_SEWING] && phase[DRAPE_PHASE_DRAPING]);
    assert_int_equal(report.peak_bytes, phase[DRAPE_PHASE_SEWING] > phase[DRAPE_PHASE_DRAPING]
                                            ? phase[DRAPE_PHASE_SEWING]
                                            : phase[DRAPE_PHASE_DRAPING]);
    assert_int_equal(phase[DRAPE_PHASE_MOVING] + phase[DRAPE_PHASE_CERTIFYING] + phase[DRAPE_PHASE_COARSE],
                     0);

    e.options.max_iterations = 0;
    report = run(&e);
    assert_false(term_of(&report, "sewing")->kept);
    assert_int_equal(report.phase_bytes[DRAPE_PHASE_SEWING], 0);
    assert_string_equal(term_of(&report, "sewing")->reason, "only the start is evaluated");
    assert_int_equal(report.peak_bytes, sum(&report));

    make(&e);
    cut(&e, 5e-4);
    report = run(&e);
    assert_string_equal(term_of(&report, "sewing")->reason, "the seams start closed");
    assert_int_equal(report.sewing_iterations, 0);

    make(&e);
    report = run(&e);
    assert_string_equal(term_of(&report, "sewing")->reason, "no seams");
}

static void test_plan__motion_has_its_own_bytes_and_gives_them_back(void **state)
{
    (void)state;
    static const double here[] = {9, 9, 9, 10, 9, 9, 9, 10, 9, 9, 9, 10};
    static const double there[] = {9, 9, 8, 10, 9, 8, 9, 10, 8, 9, 9, 9};
    static const double *const keyframe[] = {there};
    static const uint32_t sides[] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
    const drape_body body = {.offset = 0.003,
                             .positions = here,
                             .vertices = 4,
                             .triangle = sides,
                             .triangles = 4,
                             .keyframes = 1,
                             .keyframe = keyframe,
                             .motion_seconds = 0.1};
    struct example e;
    for (int sewn = 0; sewn < 2; sewn++) {
        make(&e);
        if (sewn)
            cut(&e, 0.02);
        e.ball = body;
        add_ball(&e);
        drape_report report = run(&e);
        const drape_term *motion = term_of(&report, "motion"), *jacobian = term_of(&report, "jacobian");
        assert_true(motion->kept && motion->bytes > jacobian->bytes);
        assert_int_equal(term_of(&report, "sewing")->kept, sewn);
        assert_true(report.peak_bytes < sum(&report));
        assert_true(report.motion_frames > 0);
        assert_true(report.phase_bytes[DRAPE_PHASE_MOVING] > report.phase_bytes[DRAPE_PHASE_DRAPING]);
        assert_int_equal(report.phase_bytes[DRAPE_PHASE_SEWING] > 0, sewn);

        e.options.max_iterations = 0;
        report = run(&e);
        assert_false(term_of(&report, "motion")->kept);
        assert_string_equal(term_of(&report, "motion")->reason, "only the start is evaluated");
        assert_int_equal(report.peak_bytes, sum(&report));
        assert_int_equal(report.motion_frames, 0);
    }
    make(&e);
    drape_report report = run(&e);
    assert_string_equal(term_of(&report, "motion")->reason, "no body moves");
}

static void test_plan__the_coarse_mesh_has_its_own_bytes_and_gives_them_back(void **state)
{
    (void)state;
    struct example e;
    make(&e);
    const drape_report plain = run(&e);
    e.desc.coarse = DRAPE_COARSE_ON;
    drape_report report = run(&e);
    assert_true(report.coarse_carried);
    const drape_term *coarse = term_of(&report, "coarse");
    for (size_t i = 0; i < report.terms; i++)
        if (strcmp(report.term[i].name, "coarse"))
            assert_int_equal(report.term[i].bytes, plain.term[i].bytes);
    assert_true(coarse->kept && coarse->bytes > 0);
    assert_true(report.peak_bytes < sum(&report) && report.peak_bytes > sum(&report) - coarse->bytes);
    assert_int_equal(report.phase_bytes[DRAPE_PHASE_DRAPING], report.peak_bytes);
    assert_true(report.phase_bytes[DRAPE_PHASE_COARSE] > 0);
    assert_true(report.phase_bytes[DRAPE_PHASE_COARSE] < report.peak_bytes);
}

/* Of what a phase held at several times the most counts, as a whole. */
static void test_plan__the_most_that_a_phase_held_stays(void **state)
{
    (void)state;
    static const size_t held[][2] = {{100, 20}, {30, 60}, {10, 130}, {120, 0}};
    static const size_t expected[] = {0, 0, 2, 2}; /* whose is the most so far */
    struct dr_plan plan = {.held[DRAPE_PHASE_DRAPING].ran = false};
    for (size_t i = 0; i < sizeof held / sizeof *held; i++) {
        drape_report report = {.terms = 0};
        dr_plan_hold(&plan, DRAPE_PHASE_DRAPING,
                     (const size_t[DR_TERMS]){[DR_TERM_STATE] = held[i][0], [DR_TERM_JACOBIAN] = held[i][1]});
        dr_plan_report(&plan, &report);
        const size_t *most = held[expected[i]];
        assert_int_equal(report.term[DR_TERM_STATE].bytes, most[0]);
        assert_int_equal(report.term[DR_TERM_JACOBIAN].bytes, most[1]);
        assert_int_equal(report.phase_bytes[DRAPE_PHASE_DRAPING], most[0] + most[1]);
        assert_int_equal(report.peak_bytes, most[0] + most[1]);
    }
}

/* The matrix of auto makes room for one of the whole bending, in double; the others' stays, or one comes. */
static void test_plan__the_certificate_has_its_own_bytes_and_gives_them_back(void **state)
{
    (void)state;
    static const drape_method method[] = {DRAPE_METHOD_AUTO, DRAPE_METHOD_STOP_AND_GO, DRAPE_METHOD_NEWTON};
    for (size_t m = 0; m < sizeof method / sizeof *method; m++) {
        struct example e;
        make(&e);
        e.options.method = method[m];
        e.options.max_iterations = 500;
        e.options.tolerance = 1e-3;
        const drape_report plain = run(&e);
        e.options.certify = true;
        drape_report report = run(&e);
        assert_true(report.certificate.certified);
        const drape_term *certificate = term_of(&report, "certificate"),
                         *jacobian = term_of(&report, "jacobian");
        const size_t *phase = report.phase_bytes;
        for (size_t i = 0; i < report.terms; i++)
            if (strcmp(report.term[i].name, "certificate"))
                assert_int_equal(report.term[i].bytes, plain.term[i].bytes);
        assert_int_equal(phase[DRAPE_PHASE_DRAPING], plain.peak_bytes);
        assert_int_equal(phase[DRAPE_PHASE_CERTIFYING],
                         plain.peak_bytes + certificate->bytes - (m ? 0 : jacobian->bytes));
        assert_int_equal(report.peak_bytes, phase[DRAPE_PHASE_CERTIFYING]);
    }
}

int main(void)
{
    drape_blas_prepare();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_plan__a_plain_scene_keeps_the_least),
        cmocka_unit_test(test_plan__a_change_moves_its_own_terms_alone),
        cmocka_unit_test(test_plan__motion_has_its_own_bytes_and_gives_them_back),
        cmocka_unit_test(test_plan__the_coarse_mesh_has_its_own_bytes_and_gives_them_back),
        cmocka_unit_test(test_plan__the_certificate_has_its_own_bytes_and_gives_them_back),
        cmocka_unit_test(test_plan__the_most_that_a_phase_held_stays),
        cmocka_unit_test(test_plan__sewing_has_its_own_bytes_and_gives_them_back),
    };
    return cmocka_run_group_tests_name("plan", tests, NULL, NULL);
}
