/* test_coarse.c - runs that drape a coarse mesh first: what comes of them, what they say, how they end. */
#include "test.h"

#include "scarce.h"
#include "scene.h"
#include "sim.h"

#define MOST     23 /* cells along a side of a panel */
#define VERTICES (2 * (MOST + 1) * (MOST + 1))

#define COLUMNS 40 /* cells of the sheet: 2000 triangles */
#define ROWS    25

/* Two panels of n x n cells, 0.4 m wide, above and below a beam, sewn into a tube that comes to hang from it.
 */
struct example {
    double positions[3 * VERTICES], pattern[2 * VERTICES];
    uint32_t triangle[12 * MOST * MOST], seam[4 * (MOST + 1)], pin[ROWS + 1];
    drape_material material;
    drape_body beam;
    drape_scene_desc desc;
    drape_options options;
};

static void make(struct example *e, uint32_t n)
{
    memset(e, 0, sizeof *e);
    uint32_t row = n + 1, per = row * row;
    uint32_t *t = e->triangle;
    for (uint32_t v = 0; v < 2 * per; v++) {
        double u = 0.4 * (v % row) / n, w = 0.4 * (v % per / row) / n;
        e->pattern[2 * v] = e->positions[3 * v] = u;
        e->pattern[2 * v + 1] = w;
        e->positions[3 * v + 1] = v < per ? 0.06 : -0.06;
        e->positions[3 * v + 2] = w - 0.2;
    }
    for (uint32_t c = 0; c < 2 * n * n; c++, t += 6) {
        uint32_t a = c / (n * n) * per + c % (n * n) / n * row + c % n, b = a + row;
        const uint32_t above[] = {a, b, a + 1, a + 1, b, b + 1}, below[] = {a, a + 1, b, a + 1, b + 1, b};
        memcpy(t, c < n * n ? above : below, sizeof above);
    }
    for (uint32_t i = 0; i < row; i++) {
        const uint32_t pair[] = {i, i + per, n * row + i, n * row + i + per};
        memcpy(e->seam + 4 * i, pair, sizeof pair);
    }
    e->material = (drape_material){.density = 0.2,
                                   .stretch_weft = 200,
                                   .stretch_warp = 200,
                                   .stretch_shear = 60,
                                   .bend_weft = 1e-4,
                                   .bend_warp = 1e-4,
                                   .bend_twist = 5e-5};
    e->beam = (drape_body){.kind = DRAPE_BODY_CAPSULE,
                           .offset = 0.003,
                           .friction = 0.3,
                           .point = {-0.2, 0, 0},
                           .axis = {0.6, 0, 0},
                           .radius = 0.04};
    e->desc = drape_scene_desc_default();
    e->desc.vertices = 2 * per;
    e->desc.triangles = 4 * n * n;
    e->desc.seams = 2 * row;
    e->desc.materials = e->desc.bodies = 1;
    e->desc.positions = e->positions;
    e->desc.pattern = e->pattern;
    e->desc.triangle = e->triangle;
    e->desc.seam = e->seam;
    e->desc.material = &e->material;
    e->desc.body = &e->beam;
    e->desc.coarse = DRAPE_COARSE_ON;
    e->options = drape_options_default();
    e->options.time_limit = 600;
}

/* A level sheet of 0.5 m by 0.3125 m instead, hung by a short edge; as much of it as is asked for. */
static void make_sheet(struct example *e, uint32_t columns)
{
    make(e, 1);
    uint32_t row = columns + 1, *t = e->triangle;
    for (uint32_t v = 0; v < row * (ROWS + 1); v++) {
        double u = 0.0125 * (v % row), w = 0.0125 * (v / row);
        e->pattern[2 * v] = e->positions[3 * v] = u;
        e->pattern[2 * v + 1] = w;
        e->positions[3 * v + 1] = 0;
        e->positions[3 * v + 2] = -w;
    }
    for (uint32_t c = 0; c < columns * ROWS; c++, t += 6) {
        uint32_t a = c / columns * row + c % columns, b = a + row;
        const uint32_t cell[] = {a, a + 1, b + 1, a, b + 1, b};
        memcpy(t, cell, sizeof cell);
    }
    for (uint32_t i = 0; i <= ROWS; i++)
        e->pin[i] = i * row;
    e->desc.vertices = row * (ROWS + 1);
    e->desc.triangles = 2 * columns * ROWS;
    e->desc.pin = e->pin;
    e->desc.pins = ROWS + 1;
    e->desc.seams = e->desc.bodies = 0;
    e->desc.coarse = DRAPE_COARSE_AUTO;
}

static drape_sim *run(struct example *e, drape_scene **ret_scene, drape_status expected)
{
    drape_sim *sim = NULL;
    drape_error error = {0};
    if (drape_scene_new(&e->desc, ret_scene, &error) < 0 ||
        drape_sim_new(*ret_scene, &e->options, &sim, &error) < 0)
        fail_msg("%s", error.message);
    drape_status status = drape_sim_run(sim, &error);
    if (status != expected)
        fail_msg("%s: %s %s", drape_status_name(status), error.message, drape_sim_report(sim)->reason);
    return sim;
}

static const drape_term *term_of(const drape_report *report, const char *name)
{
    for (size_t i = 0; i < report->terms; i++)
        if (!strcmp(report->term[i].name, name))
            return &report->term[i];
    fail_msg("there is no term %s", name);
    return NULL;
}

static double stage_of(const drape_report *report, const char *name)
{
    for (size_t i = 0; i < report->stages; i++)
        if (!strcmp(report->stage[i].name, name))
            return report->stage[i].seconds;
    fail_msg("there is no stage %s", name);
    return 0;
}

static void test_coarse__a_garment_is_sewn_coarse_and_says_so(void **state)
{
    (void)state;
    struct example e;
    drape_scene *scene;
    make(&e, MOST);
    drape_sim *sim = run(&e, &scene, DRAPE_OK);
    const drape_report *report = drape_sim_report(sim);
    assert_true(report->coarse_carried);
    assert_in_range(report->coarse_triangles, e.desc.triangles / 14, e.desc.triangles / 6);
    assert_true(report->coarse_iterations > 0);
    assert_true(report->coarse_factorizations >= report->sewing_iterations + report->coarse_iterations);
    assert_true(report->sewing_iterations > 0 && report->seam_gap <= DR_WELD_GAP && report->seam_gap > 0);
    assert_true(term_of(report, "coarse")->kept && term_of(report, "coarse")->bytes > 100000);
    assert_true(stage_of(report, "coarse") > 0);
    assert_true(stage_of(report, "sew") == 0);
    assert_int_equal(report->penetrations, 0);
    assert_int_equal(report->self_intersections, 0);
    size_t rows;
    const drape_row *row = drape_sim_trace(sim, &rows);
    assert_int_equal(rows, report->iterations + 1); /* of the whole mesh alone */
    assert_true(row[0].seconds >= stage_of(report, "coarse"));
    drape_sim_free(sim);
    drape_scene_free(scene);
}

static void test_coarse__the_same_input_gives_the_same_bytes(void **state)
{
    (void)state;
    static double first[3 * VERTICES];
    drape_analyses *analyses = drape_analyses_new(1 << 26);
    for (int again = 0; again < 3; again++) {
        struct example e;
        drape_scene *scene;
        size_t vertices;
        make(&e, 12);
        e.options.analyses = again ? analyses : NULL;
        drape_sim *sim = run(&e, &scene, DRAPE_OK);
        assert_true(drape_sim_report(sim)->coarse_carried);
        const double *x = drape_sim_positions(sim, &vertices);
        if (again)
            assert_memory_equal(x, first, 3 * vertices * sizeof *x);
        memcpy(first, x, 3 * vertices * sizeof *x);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
    drape_analyses_free(analyses);
}

struct seen {
    struct example *e;
    unsigned previews, coarse, draped; /* coarse, draped: rows so far, of the coarse and the whole cloth */
};

static void look(const drape_preview *preview, void *data)
{
    struct seen *seen = data;
    if (seen->previews == 0)
        assert_int_equal(seen->coarse, 0); /* sewn, then after iterations 1, 2, 4 of the whole cloth */
    assert_int_equal(seen->draped, seen->previews ? 1 << (seen->previews - 1) : 0);
    seen->previews++;
    assert_true(preview->triangles > 0 && preview->triangles < seen->e->desc.triangles / 6);
    assert_true(preview->seams > 0 && preview->seams < seen->e->desc.seams);
    for (size_t s = 0; s < preview->seams; s++) /* sewn */
        assert_memory_equal(preview->positions + 3 * (size_t)preview->seam[2 * s],
                            preview->positions + 3 * (size_t)preview->seam[2 * s + 1], 3 * sizeof(double));
    for (size_t i = 0; i < 3 * preview->triangles; i++)
        assert_in_range(preview->triangle[i], 0, preview->vertices - 1);
    for (size_t v = 0; v < preview->vertices; v++) {
        const double *p = seen->e->pattern + 2 * (size_t)preview->vertex[v], *x = preview->positions + 3 * v;
        assert_in_range(preview->vertex[v], 0, seen->e->desc.vertices - 1);
        assert_near(x[0], p[0], 0.05, 1); /* along the beam it stays where it was */
        assert_true(hypot(x[1], x[2]) > 0.04);
    }
}

static int count_rows(const drape_progress *progress, void *data)
{
    ((struct seen *)data)->coarse += progress->phase == DRAPE_PHASE_COARSE;
    ((struct seen *)data)->draped += progress->phase == DRAPE_PHASE_DRAPING;
    return 0;
}

static void test_coarse__the_drape_is_shown_as_it_comes(void **state)
{
    (void)state;
    for (int on = 0; on < 2; on++) {
        struct example e;
        drape_scene *scene;
        struct seen seen = {&e, 0, 0, 0};
        make(&e, 10);
        e.options.max_iterations = 5;
        e.options.progress = count_rows;
        e.options.preview = look;
        e.options.progress_data = e.options.preview_data = &seen;
        e.desc.coarse = on ? DRAPE_COARSE_ON : DRAPE_COARSE_OFF;
        drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
        assert_int_equal(seen.previews, 4 * on);
        assert_int_equal(seen.draped, 6);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

/* A sheet of some stiffness hung by an edge has one state of rest. */
static void test_coarse__the_rest_is_that_of_the_whole_mesh(void **state)
{
    (void)state;
    static double coarse_first[3 * VERTICES];
    for (int whole = 0; whole < 2; whole++) {
        struct example e;
        drape_scene *scene;
        size_t vertices;
        make(&e, MOST);
        e.desc.seams = e.desc.bodies = 0;
        e.desc.vertices /= 2;
        e.desc.triangles /= 2;
        e.material.bend_weft = e.material.bend_warp = e.material.bend_twist = 1e-2;
        for (uint32_t i = 0; i <= MOST; i++)
            e.pin[i] = i;
        e.desc.pin = e.pin;
        e.desc.pins = MOST + 1;
        e.options.tolerance = 1e-9;
        e.desc.coarse = whole ? DRAPE_COARSE_OFF : DRAPE_COARSE_ON;
        drape_sim *sim = run(&e, &scene, DRAPE_OK);
        assert_int_equal(drape_sim_report(sim)->coarse_carried, !whole);
        const double *x = drape_sim_positions(sim, &vertices);
        for (size_t i = 0; whole && i < 3 * vertices; i++)
            assert_near(x[i], coarse_first[i], 1e-7, 1);
        memcpy(coarse_first, x, 3 * vertices * sizeof *x);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

/* What hangs from flat is draped coarse first, unasked: it rests where it would without, for less. */
static void test_coarse__a_flat_sheet_is_draped_coarse(void **state)
{
    (void)state;
    static double without[3 * VERTICES];
    drape_row start = {0}, rest = {0};
    uint32_t iterations = 0;
    for (int coarse = 0; coarse < 2; coarse++) {
        struct example e;
        drape_scene *scene;
        size_t vertices, rows;
        make_sheet(&e, COLUMNS);
        e.desc.coarse = coarse ? DRAPE_COARSE_AUTO : DRAPE_COARSE_OFF;
        e.options.tolerance = 1e-9;
        drape_sim *sim = run(&e, &scene, DRAPE_OK);
        const drape_report *report = drape_sim_report(sim);
        const drape_row *row = drape_sim_trace(sim, &rows);
        const double *x = drape_sim_positions(sim, &vertices);
        assert_int_equal(report->coarse_carried, coarse);
        assert_int_equal(rows, report->iterations + 1);
        for (size_t k = 0; k < rows; k++)
            assert_int_equal(row[k].iteration, k);
        if (coarse) {
            /* The first row is the job's own start, the second what was carried up, and all but there. */
            assert_near(row[0].energy.potential, start.energy.potential, 1e-15, 1);
            assert_near(row[0].residual_force, start.residual_force, 1e-12, 1);
            assert_int_equal(row[0].factorizations, 0);
            assert_true(isnan(row[0].residual_energy));
            double drop = start.energy.potential - rest.energy.potential;
            assert_true(row[1].energy.potential - rest.energy.potential < 1e-3 * drop);
            assert_near(row[rows - 1].energy.potential, rest.energy.potential, 1e-12, drop);
            assert_true(3 * report->iterations < 2 * iterations);
            assert_in_range(report->coarse_triangles, e.desc.triangles / 14, e.desc.triangles / 6);
            assert_true(term_of(report, "coarse")->kept && stage_of(report, "coarse") > 0);
            assert_true(report->seconds >= stage_of(report, "coarse"));
            for (size_t i = 0; i < 3 * vertices; i++)
                assert_near(x[i], without[i], 1e-7, 1);
        }
        start = row[0];
        rest = row[rows - 1];
        iterations = report->iterations;
        memcpy(without, x, 3 * vertices * sizeof *x);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

/* As the coarse cloth rests, then after iterations 2, 4... of the whole one, whose first is the coarse one.
 */
static void look_at_sheet(const drape_preview *preview, void *data)
{
    struct seen *seen = data;
    assert_int_equal(seen->draped, seen->previews ? 1 << seen->previews : 0);
    assert_true(seen->coarse > 1);
    assert_true(preview->triangles > 0 && preview->triangles < seen->e->desc.triangles / 6);
    double lowest = 0;
    for (size_t v = 0; v < preview->vertices; v++)
        lowest = fmin(lowest, preview->positions[3 * v + 1]);
    assert_near(lowest, -0.48, 0.05, 1); /* it hangs */
    seen->previews++;
}

static void test_coarse__a_sheet_is_shown_as_it_comes(void **state)
{
    (void)state;
    struct example e;
    drape_scene *scene;
    struct seen seen = {&e, 0, 0, 0};
    make_sheet(&e, COLUMNS);
    e.options.tolerance = 1e-15; /* never at rest */
    e.options.max_iterations = 20;
    e.options.progress = count_rows;
    e.options.preview = look_at_sheet;
    e.options.progress_data = e.options.preview_data = &seen;
    drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
    assert_int_equal(seen.previews, 5);
    assert_int_equal(seen.draped, 21);
    drape_sim_free(sim);
    drape_scene_free(scene);
}

/* Where something tells against it. */
static void test_coarse__another_sheet_is_draped_as_it_is(void **state)
{
    (void)state;
    static const char *const reason[] = {"",
                                         "",
                                         "auto: nothing has to be sewn",
                                         "auto: nothing has to be sewn",
                                         "auto: nothing has to be sewn, and there are bodies",
                                         "auto: nothing has to be sewn, and the start is not flat",
                                         "auto: nothing has to be sewn, and the start is not flat",
                                         "auto: the mesh is coarse itself"};
    for (size_t c = 0; c < sizeof reason / sizeof *reason; c++) {
        struct example e;
        drape_scene *scene;
        make_sheet(&e, COLUMNS);
        e.options.max_iterations = 1;
        for (uint32_t v = 0; c == 1 && v < e.desc.vertices; v++) /* flat, but not level */
            e.positions[3 * v + 1] = 3 + 0.7 * e.positions[3 * v] - 0.3 * e.positions[3 * v + 2];
        if (c == 2)
            e.options.method = DRAPE_METHOD_STOP_AND_GO;
        if (c == 3)
            e.desc.coarse = DRAPE_COARSE_SEWN;
        e.desc.bodies = c == 4;
        e.beam.point[1] = -3;
        if (c == 5)
            e.positions[3 * (size_t)(COLUMNS + 5) + 1] = 1e-5;
        for (uint32_t v = 0; c == 6 && v < e.desc.vertices; v++) /* on one line */
            e.positions[3 * v + 2] = 0;
        e.desc.triangles -= c == 7;
        drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
        const drape_term *coarse = term_of(drape_sim_report(sim), "coarse");
        assert_string_equal(coarse->reason, reason[c]);
        assert_int_equal(coarse->kept, c < 2);
        assert_int_equal(drape_sim_report(sim)->coarse_carried, c < 2);
        assert_int_equal(scene->coarse != NULL, c < 3); /* SEWN saves it */
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

/* 320 by 160 cells: the coarse mesh has more than 10 000 triangles, and a coarse one of its own, which has
 * none. */
static void test_coarse__a_coarse_mesh_may_have_one(void **state)
{
    (void)state;
    enum { ACROSS = 320, DOWN = 160, ALL = (ACROSS + 1) * (DOWN + 1) };
    struct example e;
    drape_scene *scene;
    double *position = calloc(3 * ALL, sizeof *position), *pattern = malloc(2 * ALL * sizeof *pattern);
    uint32_t *triangle = malloc(6 * ACROSS * DOWN * sizeof *triangle), pin[DOWN + 1], *t = triangle;
    make_sheet(&e, 1);
    for (uint32_t v = 0; v < ALL; v++) {
        pattern[2 * v] = position[3 * v] = 0.002 * (v % (ACROSS + 1));
        pattern[2 * v + 1] = position[3 * v + 2] = 0.002 * (v / (ACROSS + 1));
    }
    for (uint32_t c = 0; c < ACROSS * DOWN; c++, t += 6) {
        uint32_t a = c / ACROSS * (ACROSS + 1) + c % ACROSS, b = a + ACROSS + 1;
        const uint32_t cell[] = {a, a + 1, b + 1, a, b + 1, b};
        memcpy(t, cell, sizeof cell);
    }
    for (uint32_t i = 0; i <= DOWN; i++)
        pin[i] = i * (ACROSS + 1);
    e.desc.vertices = ALL;
    e.desc.triangles = 2 * ACROSS * DOWN;
    e.desc.positions = position;
    e.desc.pattern = pattern;
    e.desc.triangle = triangle;
    e.desc.pin = pin;
    e.desc.pins = DOWN + 1;
    drape_sim *sim = run(&e, &scene, DRAPE_OK);
    const drape_scene *coarse = scene->coarse_scene;
    assert_true(coarse->coarse && !coarse->coarse_scene->coarse);
    assert_true(drape_sim_report(sim)->coarse_carried);
    drape_sim_free(sim);
    drape_scene_free(scene);
    free(triangle);
    free(pattern);
    free(position);
}

/* 2000 triangles are fine, 1999 are not. */
static void test_coarse__a_fine_garment_is_sewn_coarse_unasked(void **state)
{
    (void)state;
    for (size_t short_by = 0; short_by < 2; short_by++) {
        struct example e;
        drape_scene *scene;
        make(&e, MOST);
        size_t most = DRAPE_COARSE_FROM - short_by, left = 0, all = e.desc.triangles;
        for (size_t t = 0; t < all; t++) /* with a hole here and there */
            if (t % 18 != 9 || all - t + left <= most)
                memmove(e.triangle + 3 * left++, e.triangle + 3 * t, 3 * sizeof *e.triangle);
        assert_int_equal(left, most);
        e.desc.triangles = left;
        e.desc.coarse = DRAPE_COARSE_AUTO;
        e.options.max_iterations = 1;
        drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
        assert_int_equal(term_of(drape_sim_report(sim), "coarse")->kept, !short_by);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

/* Without the middle column of cells there are two tubes. */
static void test_coarse__several_garments_are_sewn_as_they_are(void **state)
{
    (void)state;
    struct example e;
    drape_scene *scene;
    size_t left = 0;
    make(&e, MOST);
    for (size_t t = 0; t < e.desc.triangles; t++)
        if (t / 2 % MOST != MOST / 2)
            memmove(e.triangle + 3 * left++, e.triangle + 3 * t, 3 * sizeof *e.triangle);
    assert_true(left >= DRAPE_COARSE_FROM);
    e.desc.triangles = left;
    e.desc.coarse = DRAPE_COARSE_AUTO;
    e.options.max_iterations = 1;
    drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
    assert_string_equal(term_of(drape_sim_report(sim), "coarse")->reason,
                        "auto: garments are sewn one after the other");
    drape_sim_free(sim);
    drape_scene_free(scene);
}

static void test_coarse__what_is_left_out_says_why(void **state)
{
    (void)state;
    static const char *const reason[] = {"switched off",
                                         "auto: the mesh is coarse itself",
                                         "the start is a drape",
                                         "a body moves",
                                         "only the start is evaluated",
                                         "what has to be kept leaves too many triangles",
                                         "auto: nothing has to be sewn, and there are bodies"};
    static const double here[] = {0, -9, 0, 0.3, -9, 0, 0, -9, 0.3, 0, -9.4, 0};
    static const double *const keyframe[] = {here};
    static const uint32_t sides[] = {0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3};
    static uint32_t all[VERTICES];
    for (size_t c = 0; c < sizeof reason / sizeof *reason; c++) {
        struct example e;
        drape_scene *scene;
        drape_sim *sim = NULL;
        drape_error error;
        make(&e, 6);
        drape_body table = {.offset = 0.003,
                            .positions = here,
                            .triangle = sides,
                            .vertices = 4,
                            .triangles = 4,
                            .keyframes = 1,
                            .keyframe = keyframe,
                            .motion_seconds = 0.04};
        e.desc.coarse = c == 0 ? DRAPE_COARSE_OFF : c == 1 || c == 6 ? DRAPE_COARSE_AUTO : DRAPE_COARSE_ON;
        if (c == 2)
            e.desc.start_pattern = e.pattern;
        if (c == 3)
            e.desc.body = &table;
        e.options.max_iterations = c != 4;
        for (uint32_t v = 0; v < e.desc.vertices; v++)
            all[v] = v;
        if (c == 5) {
            e.desc.pin = all;
            e.desc.pins = e.desc.vertices / 2;
        }
        if (c == 6)
            e.desc.seams = 0;
        if (drape_scene_new(&e.desc, &scene, &error) < 0 ||
            drape_sim_new(scene, &e.options, &sim, &error) < 0 || drape_sim_run(sim, &error) < 0)
            fail_msg("%s", error.message);
        const drape_report *report = drape_sim_report(sim);
        assert_false(term_of(report, "coarse")->kept);
        assert_string_equal(term_of(report, "coarse")->reason, reason[c]);
        assert_int_equal(term_of(report, "coarse")->bytes, 0);
        assert_true(!report->coarse_carried && !report->coarse_triangles && !report->coarse_iterations);
        assert_true(stage_of(report, "coarse") == 0);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

static void test_coarse__any_method_may_begin_from_it(void **state)
{
    (void)state;
    static const drape_method method[] = {DRAPE_METHOD_STOP_AND_GO, DRAPE_METHOD_QUASI_STATIC};
    for (size_t m = 0; m < 2; m++) {
        struct example e;
        drape_scene *scene;
        make(&e, 6);
        e.options.method = method[m];
        e.options.max_iterations = 1;
        drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
        assert_true(drape_sim_report(sim)->coarse_carried);
        assert_int_equal(drape_sim_report(sim)->coarse_iterations, 1); /* no more than the job's own */
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

/* Round a beam that is too thick the seams cannot close: then all is as if there were no coarse mesh. */
static void test_coarse__what_does_not_come_out_well_is_begun_anew(void **state)
{
    (void)state;
    static double without[3 * VERTICES];
    uint32_t sewing = 0;
    for (int on = 0; on < 2; on++) {
        struct example e;
        drape_scene *scene;
        size_t vertices;
        make(&e, 6);
        e.material.stretch_weft = e.material.stretch_warp = 1e6;
        e.beam.radius = 0.2;
        for (uint32_t v = 0; v < e.desc.vertices; v++)
            e.positions[3 * v + 1] *= 4;
        e.options.max_iterations = 1;
        e.desc.coarse = on ? DRAPE_COARSE_ON : DRAPE_COARSE_OFF;
        drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
        const drape_report *report = drape_sim_report(sim);
        const double *x = drape_sim_positions(sim, &vertices);
        assert_false(report->coarse_carried);
        assert_true(report->seam_gap > DR_WELD_GAP);
        assert_int_equal(report->coarse_triangles > 0, on);
        if (on) {
            assert_memory_equal(x, without, 3 * vertices * sizeof *x);
            assert_int_equal(report->sewing_iterations, sewing);
        }
        sewing = report->sewing_iterations;
        memcpy(without, x, 3 * vertices * sizeof *x);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
}

/* Counts the calls of each phase, and cancels at the first of the coarse cloth's draping. */
static int cancel_coarse(const drape_progress *progress, void *data)
{
    ((unsigned *)data)[progress->phase]++;
    return progress->phase == DRAPE_PHASE_COARSE;
}

static void test_coarse__the_callback_cancels_the_coarse_cloth(void **state)
{
    (void)state;
    struct example e;
    drape_scene *scene;
    unsigned seen[DRAPE_PHASE_COARSE + 1] = {0};
    make(&e, 8);
    e.options.progress = cancel_coarse;
    e.options.progress_data = seen;
    drape_scene_new(&e.desc, &scene, NULL);
    drape_sim *sim = NULL;
    assert_int_equal(drape_sim_new(scene, &e.options, &sim, NULL), DRAPE_OK);
    assert_int_equal(drape_sim_run(sim, NULL), DRAPE_CANCELLED);
    assert_int_equal(drape_sim_report(sim)->iterations, 0);
    assert_true(seen[DRAPE_PHASE_SEWING] > 1);
    assert_int_equal(seen[DRAPE_PHASE_COARSE], 1);
    assert_int_equal(seen[DRAPE_PHASE_DRAPING], 1); /* where it ends */
    drape_sim_free(sim);
    drape_scene_free(scene);
}

static void test_coarse__the_limits_hold_for_it(void **state)
{
    (void)state;
    struct example e;
    drape_scene *scene;
    drape_error error;
    make(&e, 8);
    e.options.time_limit = 1e-9;
    drape_sim *sim = run(&e, &scene, DRAPE_NOT_AT_REST);
    assert_int_equal(drape_sim_report(sim)->coarse_triangles, 0); /* not even begun */
    drape_sim_free(sim);

    e.options.time_limit = 600;
    e.options.memory_limit = dr_scene_bytes(scene) + (1 << 16); /* next to nothing to work with */
    assert_int_equal(drape_sim_new(scene, &e.options, &sim, NULL), DRAPE_OK);
    assert_int_equal(drape_sim_run(sim, &error), DRAPE_ENOMEM);
    assert_string_equal(error.member, "memory_limit");
    drape_sim_free(sim);
    drape_scene_free(scene);
}

#ifdef CAN_FAIL_ALLOCATIONS
/* Lets each allocation of a run fail in turn; returns how many made the run fail. */
static long starve(const struct example *e)
{
    long failed = 0;
    for (long n = 0;; n++) {
        drape_scene *scene = NULL;
        drape_sim *sim = NULL;
        drape_error error = {0};
        long before = held;
        countdown = n;
        drape_status status = drape_scene_new(&e->desc, &scene, &error);
        if (status >= 0)
            status = drape_sim_new(scene, &e->options, &sim, &error);
        if (status >= 0)
            status = drape_sim_run(sim, &error);
        bool reached = countdown < 0;
        countdown = -1;
        drape_sim_free(sim);
        drape_scene_free(scene);
        assert_int_equal(held, before);
        if (!reached)
            return failed;
        if (status < 0) { /* a failure may also be survived, as by CHOLMOD's second try */
            assert_int_equal(status, DRAPE_ENOMEM);
            failed++;
        }
    }
}
#endif

static void test_coarse__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct example e;
    make(&e, 4);
    e.options.max_iterations = 1;
    assert_true(starve(&e) > 200);
    make_sheet(&e, 4);
    e.options.max_iterations = 1;
    e.desc.coarse = DRAPE_COARSE_ON;
    assert_true(starve(&e) > 100);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_coarse__a_garment_is_sewn_coarse_and_says_so),
        cmocka_unit_test(test_coarse__the_same_input_gives_the_same_bytes),
        cmocka_unit_test(test_coarse__the_drape_is_shown_as_it_comes),
        cmocka_unit_test(test_coarse__the_rest_is_that_of_the_whole_mesh),
        cmocka_unit_test(test_coarse__a_flat_sheet_is_draped_coarse),
        cmocka_unit_test(test_coarse__a_sheet_is_shown_as_it_comes),
        cmocka_unit_test(test_coarse__another_sheet_is_draped_as_it_is),
        cmocka_unit_test(test_coarse__a_coarse_mesh_may_have_one),
        cmocka_unit_test(test_coarse__a_fine_garment_is_sewn_coarse_unasked),
        cmocka_unit_test(test_coarse__several_garments_are_sewn_as_they_are),
        cmocka_unit_test(test_coarse__what_is_left_out_says_why),
        cmocka_unit_test(test_coarse__any_method_may_begin_from_it),
        cmocka_unit_test(test_coarse__what_does_not_come_out_well_is_begun_anew),
        cmocka_unit_test(test_coarse__the_callback_cancels_the_coarse_cloth),
        cmocka_unit_test(test_coarse__the_limits_hold_for_it),
        cmocka_unit_test(test_coarse__every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
