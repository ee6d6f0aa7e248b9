/* test_estimate.c - what a run is expected to hold, what it holds, and the limit on it. */
#include "test.h"

#include "drape.h"

/* ---- scenes ------------------------------------------------------------------------------------------ */

struct example {
    size_t side;
    double *positions, *pattern;
    uint32_t *triangle, *pin, *seam;
    drape_material material;
    drape_body body;
    drape_scene_desc desc;
    drape_options options;
};

static const double tetrahedron[12] = {0, -2, 0, 0.4, -2, 0, 0, -2, 0.4, 0, -1.6, 0};
static const uint32_t sides_of_it[12] = {0, 1, 2, 0, 3, 1, 1, 3, 2, 0, 2, 3};

/* `pieces` squares of side^2 vertices, half a metre wide, one over the other, the first held by an edge. */
static void make(struct example *e, size_t side, size_t pieces)
{
    size_t square = side * side, cells = (side - 1) * (side - 1);
    memset(e, 0, sizeof *e);
    e->side = side;
    e->positions = calloc(3 * square * pieces, sizeof *e->positions);
    e->pattern = calloc(2 * square * pieces, sizeof *e->pattern);
    e->triangle = calloc(6 * cells * pieces, sizeof *e->triangle);
    e->pin = calloc(side, sizeof *e->pin);
    uint32_t *t = e->triangle;
    for (size_t p = 0; p < pieces; p++) {
        for (size_t i = 0; i < square; i++) {
            double u = 0.5 * (double)(i % side) / (double)(side - 1);
            double v = 0.5 * (double)(i / side) / (double)(side - 1);
            double *x = e->positions + 3 * (p * square + i), *uv = e->pattern + 2 * (p * square + i);
            x[0] = uv[0] = u;
            x[1] = -0.05 * (double)p;
            x[2] = uv[1] = v;
        }
        for (size_t c = 0; c < cells; c++, t += 6) {
            uint32_t n = (uint32_t)side, a = (uint32_t)(p * square + c / (side - 1) * side + c % (side - 1));
            const uint32_t cell[] = {a, a + n, a + 1, a + 1, a + n, a + n + 1};
            memcpy(t, cell, sizeof cell);
        }
    }
    for (size_t i = 0; i < side; i++)
        e->pin[i] = (uint32_t)i;
    e->material = (drape_material){.density = 0.15,
                                   .stretch_weft = 400,
                                   .stretch_warp = 400,
                                   .stretch_shear = 150,
                                   .bend_weft = 1e-5,
                                   .bend_warp = 1e-5,
                                   .bend_twist = 5e-6};
    e->desc = drape_scene_desc_default();
    e->desc.vertices = square * pieces;
    e->desc.triangles = 2 * cells * pieces;
    e->desc.pins = side;
    e->desc.materials = 1;
    e->desc.positions = e->positions;
    e->desc.pattern = e->pattern;
    e->desc.triangle = e->triangle;
    e->desc.pin = e->pin;
    e->desc.material = &e->material;
    e->options = drape_options_default();
    e->options.max_iterations = 2;
}

/* Sews two pieces to a tube, along their left and right sides. */
static void sew(struct example *e)
{
    size_t n = e->side;
    e->seam = calloc(4 * n, sizeof *e->seam);
    for (size_t i = 0; i < n; i++) {
        const uint32_t left = (uint32_t)(i * n), right = (uint32_t)(left + n - 1), other = (uint32_t)(n * n);
        const uint32_t both[] = {right, other + right, left, other + left};
        memcpy(e->seam + 4 * i, both, sizeof both);
    }
    e->desc.seam = e->seam;
    e->desc.seams = 2 * n;
}

static void add_body(struct example *e)
{
    e->body = (drape_body){.kind = DRAPE_BODY_MESH,
                           .offset = DRAPE_DEFAULT_OFFSET,
                           .positions = tetrahedron,
                           .triangle = sides_of_it,
                           .vertices = 4,
                           .triangles = 4};
    e->desc.body = &e->body;
    e->desc.bodies = 1;
}

static void move_body(struct example *e)
{
    static const double there[12] = {0, -2.01, 0, 0.4, -2.01, 0, 0, -2.01, 0.4, 0, -1.61, 0};
    static const double *const keyframe[] = {there};
    e->body.keyframe = keyframe;
    e->body.keyframes = 1;
    e->body.motion_seconds = 0.1;
}

static void done(struct example *e)
{
    free(e->positions);
    free(e->pattern);
    free(e->triangle);
    free(e->pin);
    free(e->seam);
}

/* The status of the run, with its peak. */
static drape_status run(const struct example *e, size_t *ret_peak, drape_error *reterr)
{
    drape_scene *scene;
    drape_sim *sim;
    assert_true(drape_check(&e->desc, &e->options, reterr) >= 0);
    assert_int_equal(drape_scene_new(&e->desc, &scene, reterr), DRAPE_OK);
    assert_int_equal(drape_sim_new(scene, &e->options, &sim, reterr), DRAPE_OK);
    drape_status status = drape_sim_run(sim, reterr);
    *ret_peak = status < 0 ? 0 : drape_sim_report(sim)->peak_bytes;
    drape_sim_free(sim);
    drape_scene_free(scene);
    return status;
}

/* ---- the estimate ------------------------------------------------------------------------------------ */

static void test_estimate__is_within_a_fifth_of_the_truth(void **state)
{
    (void)state;
    static const struct {
        size_t side, pieces;
        drape_method method;
        drape_integrator integrator;
        bool body, moves, fit, certify;
        drape_coarse coarse;
    } cases[] = {
        {.side = 23, .pieces = 1}, /* 968 triangles, by auto */
        {.side = 71, .pieces = 1}, /* 9 800 */
        {.side = 23, .pieces = 2},
        {.side = 40, .pieces = 1, .coarse = DRAPE_COARSE_ON},
        {.side = 40, .pieces = 2, .coarse = DRAPE_COARSE_ON},
        {.side = 23, .pieces = 1, .body = true}, /* nearly all of it the body's field */
        {.side = 40, .pieces = 1, .body = true, .moves = true},
        {.side = 40, .pieces = 1, .certify = true},
        {.side = 40, .pieces = 1, .method = DRAPE_METHOD_STOP_AND_GO, .fit = true},
        {.side = 71, .pieces = 1, .method = DRAPE_METHOD_STOP_AND_GO},
        {.side = 40, .pieces = 2, .method = DRAPE_METHOD_STOP_AND_GO},
        {.side = 40, .pieces = 1, .method = DRAPE_METHOD_NEWTON},
        {.side = 40, .pieces = 1, .method = DRAPE_METHOD_STOP_AND_GO, .integrator = DRAPE_RK4},
        {.side = 40, .pieces = 2, .method = DRAPE_METHOD_STOP_AND_GO, .integrator = DRAPE_RK4},
    };
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct example e;
        drape_error error;
        size_t peak;
        make(&e, cases[c].side, cases[c].pieces);
        if (cases[c].pieces > 1)
            sew(&e);
        if (cases[c].body)
            add_body(&e);
        e.options.method = cases[c].method;
        e.options.integrator = cases[c].integrator;
        e.options.fit = cases[c].fit;
        e.options.certify = cases[c].certify;
        if (cases[c].certify)
            e.options.tolerance = 1e9; /* at rest as it is */
        if (cases[c].moves)
            move_body(&e);
        e.desc.coarse = cases[c].coarse;
        size_t estimate = drape_memory_estimate(&e.desc, &e.options);
        assert_true(run(&e, &peak, &error) >= 0);
        if (fabs((double)estimate - (double)peak) > 0.2 * (double)peak)
            fail_msg("case %zu: %zu bytes expected, %zu held", c, estimate, peak);
        done(&e);
    }
}

/* ---- the limit --------------------------------------------------------------------------------------- */

static bool fits(struct example *e, size_t limit)
{
    drape_error error;
    size_t peak;
    e->options.memory_limit = limit;
    drape_status status = run(e, &peak, &error);
    if (status >= 0)
        return true;
    assert_int_equal(status, DRAPE_ENOMEM);
    assert_int_equal(error.place, DRAPE_AT_OPTION);
    assert_string_equal(error.member, "memory_limit");
    return false;
}

/* The least limit that a run keeps, found by halving: what it counts is its peak, but for a few arrays. */
static void test_estimate__a_run_ends_one_byte_past_its_limit_and_not_at_it(void **state)
{
    (void)state;
    for (int sewn = 0; sewn < 2; sewn++) {
        struct example e;
        drape_error error;
        size_t peak;
        make(&e, 16, 1 + (size_t)sewn);
        if (sewn)
            sew(&e);
        e.desc.self_contact = DRAPE_SELF_CONTACT_OFF; /* contacts come and go: the report counts the last */
        assert_true(run(&e, &peak, &error) >= 0);
        size_t low = 0, high = peak;
        assert_true(fits(&e, peak));
        while (high - low > 1) {
            size_t middle = low + (high - low) / 2;
            *(fits(&e, middle) ? &high : &low) = middle;
        }
        assert_true((double)high > 0.9 * (double)peak);
        assert_true(fits(&e, high));
        assert_false(fits(&e, high - 1));
        done(&e);
    }
}

static void test_estimate__every_method_keeps_the_limit(void **state)
{
    (void)state;
    for (int m = 0; m <= DRAPE_METHOD_NEWTON; m++)
        for (int i = 0; i <= DRAPE_RK4; i++) {
            struct example e;
            make(&e, 12, 1);
            e.options.method = (drape_method)m;
            e.options.integrator = (drape_integrator)i;
            assert_false(fits(&e, 20000));
            done(&e);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_estimate__is_within_a_fifth_of_the_truth),
        cmocka_unit_test(test_estimate__a_run_ends_one_byte_past_its_limit_and_not_at_it),
        cmocka_unit_test(test_estimate__every_method_keeps_the_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
