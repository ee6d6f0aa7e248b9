/* test_sewing.c - pieces that start apart are sewn shut, without folding over: seams of equal and unequal
 * length. */
#include "run.h"

enum { UPPER = 24, ROWS = 8 }; /* cells along the seam and across each piece */
static const double CELL = 0.01;

/* Two pieces in one plane, 50 mm apart, the upper one held by its upper edge, the lower one `ratio` times as
 * wide with `between` cells for each of the upper one's: every point of the upper edge of the seam is sewn,
 * of the lower one every between-th. The lower one is shaken by a tenth of a millimetre, for what lies in one
 * plane stays there. */
struct gather {
    struct grid grid[2];
    double *x, *pattern;
    uint32_t *triangle, seam[2 * (UPPER + 1)], pin[UPPER + 1];
    drape_material material;
    drape_scene_desc desc;
};

static void place_piece(struct gather *g, size_t which, size_t first)
{
    const struct grid *grid = &g->grid[which];
    uint64_t seed = 5;
    double width = grid->uv[2 * grid->nx], low = which ? -ROWS * CELL - 0.05 : 0;
    for (size_t v = 0; v < grid->vertices; v++) {
        double *x = g->x + 3 * (first + v);
        x[0] = grid->uv[2 * v] - width / 2;
        x[1] = grid->uv[2 * v + 1] + low;
        x[2] = which ? 1e-4 * test_random(&seed) : 0;
        memcpy(g->pattern + 2 * (first + v), grid->uv + 2 * v, 2 * sizeof *g->pattern);
    }
    for (size_t i = 0; i < 3 * grid->triangles; i++)
        g->triangle[3 * (which ? g->grid[0].triangles : 0) + i] = grid->triangle[i] + (uint32_t)first;
}

static struct gather *gather_new(double ratio, size_t between)
{
    struct gather *g = calloc(1, sizeof *g);
    assert_non_null(g);
    g->grid[0] = grid_new(GRID_ALTERNATING, UPPER, ROWS, UPPER * CELL, ROWS * CELL, 0);
    g->grid[1] = grid_new(GRID_ALTERNATING, UPPER * between, ROWS, ratio * UPPER * CELL, ROWS * CELL, 0);
    size_t first = g->grid[0].vertices;
    g->desc = drape_scene_desc_default();
    g->desc.vertices = first + g->grid[1].vertices;
    g->desc.triangles = g->grid[0].triangles + g->grid[1].triangles;
    g->desc.positions = g->x = calloc(3 * g->desc.vertices, sizeof *g->x);
    g->desc.pattern = g->pattern = calloc(2 * g->desc.vertices, sizeof *g->pattern);
    g->desc.triangle = g->triangle = calloc(3 * g->desc.triangles, sizeof *g->triangle);
    assert_true(g->x && g->pattern && g->triangle);
    for (size_t which = 0; which < 2; which++)
        place_piece(g, which, which * first);
    for (uint32_t i = 0; i <= UPPER; i++) {
        g->seam[2 * i] = grid_at(&g->grid[0], i, 0);
        g->seam[2 * i + 1] = (uint32_t)first + grid_at(&g->grid[1], i * between, ROWS);
        g->pin[i] = grid_at(&g->grid[0], i, ROWS);
    }
    g->material = isotropic(0.17, 400, 1e-5);
    g->desc.seam = g->seam;
    g->desc.pin = g->pin;
    g->desc.material = &g->material;
    g->desc.seams = g->desc.pins = UPPER + 1;
    g->desc.materials = 1;
    return g;
}

static void gather_free(struct gather *g)
{
    grid_done(&g->grid[0]);
    grid_done(&g->grid[1]);
    free(g->x);
    free(g->pattern);
    free(g->triangle);
    free(g);
}

static void normal_of(const uint32_t corner[3], const double *x, double ret[3])
{
    double a[3], b[3];
    for (int d = 0; d < 3; d++) {
        a[d] = x[3 * (size_t)corner[1] + (size_t)d] - x[3 * (size_t)corner[0] + (size_t)d];
        b[d] = x[3 * (size_t)corner[2] + (size_t)d] - x[3 * (size_t)corner[0] + (size_t)d];
    }
    for (int d = 0; d < 3; d++)
        ret[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
    double length = sqrt(ret[0] * ret[0] + ret[1] * ret[1] + ret[2] * ret[2]);
    for (int d = 0; d < 3; d++)
        ret[d] /= length;
}

static bool share_edge(const uint32_t a[3], const uint32_t b[3])
{
    int shared = 0;
    for (int i = 0; i < 9; i++)
        shared += a[i / 3] == b[i % 3];
    return shared == 2;
}

/* Pairs of neighbours of one piece folded by more than the angle of that cosine. */
static size_t count_folds(const struct gather *g, const double *x, double cosine)
{
    size_t folds = 0;
    for (size_t t = 0; t < g->desc.triangles; t++)
        for (size_t s = 0; s < t; s++) {
            const uint32_t *a = g->triangle + 3 * t, *b = g->triangle + 3 * s;
            double n[3], m[3];
            if (!share_edge(a, b))
                continue;
            normal_of(a, x, n);
            normal_of(b, x, m);
            folds += n[0] * m[0] + n[1] * m[1] + n[2] * m[2] < cosine;
        }
    return folds;
}

/* As sewing leaves them: one step of a microsecond. */
static void test_sewing__sides_of_unequal_length_close_without_folding_over(void **state)
{
    (void)state;
    static const struct {
        double ratio;
        size_t between, folds; /* the last: at most so many beyond 90 degrees */
    } cases[] = {{1, 1, 0},   {1.3, 1, 0}, {1 / 1.3, 1, 0}, {2, 1, 0},
                 {0.5, 1, 0}, {2, 2, 0},   {3, 3, 8},       {1.0 / 3, 1, 0}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct gather *g = gather_new(cases[c].ratio, cases[c].between);
        drape_options options = drape_options_default();
        options.method = DRAPE_METHOD_DYNAMIC;
        options.time_step = DRAPE_MIN_TIME_STEP;
        options.max_iterations = 1;
        struct run run = run_new(&g->desc, &options);
        size_t beyond = count_folds(g, run.x, 0), over = count_folds(g, run.x, -0.9);
        print_message(
            "  %.2f to 1, %zu cells a stitch: %u iterations, gap %.2f mm, %zu folds beyond 90 degrees\n",
            cases[c].ratio, cases[c].between, run.report->sewing_iterations, 1e3 * run.report->seam_gap,
            beyond);
        assert_true(run.report->seam_gap <= 1e-3);
        assert_in_range(run.report->sewing_iterations, 10, 100);
        assert_true(beyond <= cases[c].folds && over == 0);
        for (size_t i = 0; i <= UPPER; i++)
            assert_memory_equal(run.x + 3 * (size_t)g->seam[2 * i], run.x + 3 * (size_t)g->seam[2 * i + 1],
                                3 * sizeof *run.x);
        run_done(&run);
        gather_free(g);
    }
}

static void test_sewing__eased_and_gathered_seams_come_to_rest(void **state)
{
    (void)state;
    for (size_t between = 1; between <= 2; between++) {
        struct gather *g = gather_new(between == 1 ? 1.3 : 2, between);
        drape_options options = drape_options_default();
        struct run run = run_new(&g->desc, &options);
        print_message("  %zu cells a stitch: %s after %u iterations\n", between,
                      drape_verdict_name(run.report->verdict), run.report->iterations);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        run_done(&run);
        gather_free(g);
    }
}

/* Triangles wound against each other are warned of, not refused: the same cloth comes of them. */
static void test_sewing__the_mechanics_do_not_mind_how_triangles_are_wound(void **state)
{
    (void)state;
    double potential[2];
    for (size_t mixed = 0; mixed < 2; mixed++) {
        struct gather *g = gather_new(1, 1);
        for (size_t t = 0; mixed && t < g->desc.triangles; t += 3) {
            uint32_t kept = g->triangle[3 * t];
            g->triangle[3 * t] = g->triangle[3 * t + 1];
            g->triangle[3 * t + 1] = kept;
        }
        drape_options options = drape_options_default();
        options.tolerance = 1e-6;
        struct run run = run_new(&g->desc, &options);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        potential[mixed] = run.report->state.energy.potential;
        run_done(&run);
        gather_free(g);
    }
    print_message("  %.12g J, %.12g J\n", potential[0], potential[1]);
    assert_close(potential[0], potential[1], 1e-6);
}

/* ---- one garment over another ------------------------------------------------------------------ */

enum { WIDE = 16, HIGH = 6, CUFF = 2, TUBES = 2 }; /* cells round half of a tube, and along the two */

/* A tube and a cuff round its middle, about an upright capsule of 50 mm, each of two flat halves in front and
 * behind, `girth` all round and starting `away` from the axis. */
struct tubes {
    struct grid grid[TUBES];
    double *x, *pattern;
    uint32_t *triangle, seam[2 * 2 * (HIGH + 1 + CUFF + 1)];
    drape_material material;
    drape_body body;
    drape_scene_desc desc;
};

static void place_half(struct tubes *t, size_t tube, size_t side, double away)
{
    const struct grid *grid = &t->grid[tube];
    size_t first = 2 * tube * t->grid[0].vertices + side * grid->vertices,
           other = 2 * tube * t->grid[0].vertices + (1 - side) * grid->vertices;
    double width = grid->uv[2 * grid->nx], low = -(double)grid->ny * CELL / 2;
    for (size_t v = 0; v < grid->vertices; v++) {
        double *x = t->x + 3 * (first + v), right = grid->uv[2 * v] - width / 2;
        x[0] = side ? -right : right;
        x[1] = grid->uv[2 * v + 1] + low;
        x[2] = side ? -away : away;
        memcpy(t->pattern + 2 * (first + v), grid->uv + 2 * v, 2 * sizeof *t->pattern);
    }
    for (size_t i = 0; i < 3 * grid->triangles; i++)
        t->triangle[3 * t->desc.triangles + i] = grid->triangle[i] + (uint32_t)first;
    t->desc.triangles += grid->triangles;
    for (size_t j = 0; j <= grid->ny; j++) { /* its right edge to the left one of the other half */
        uint32_t *seam = t->seam + 2 * t->desc.seams++;
        seam[0] = (uint32_t)first + grid_at(grid, WIDE, j);
        seam[1] = (uint32_t)other + grid_at(grid, 0, j);
    }
}

static struct tubes *tubes_new(const double girth[TUBES], const double away[TUBES])
{
    struct tubes *t = calloc(1, sizeof *t);
    assert_non_null(t);
    for (size_t i = 0; i < TUBES; i++)
        t->grid[i] =
            grid_new(GRID_ALTERNATING, WIDE, i ? CUFF : HIGH, girth[i] / 2, (i ? CUFF : HIGH) * CELL, 0);
    t->desc = drape_scene_desc_default();
    t->desc.vertices = 2 * (t->grid[0].vertices + t->grid[1].vertices);
    size_t triangles = 2 * (t->grid[0].triangles + t->grid[1].triangles);
    t->desc.positions = t->x = calloc(3 * t->desc.vertices, sizeof *t->x);
    t->desc.pattern = t->pattern = calloc(2 * t->desc.vertices, sizeof *t->pattern);
    t->desc.triangle = t->triangle = calloc(3 * triangles, sizeof *t->triangle);
    assert_true(t->x && t->pattern && t->triangle);
    for (size_t i = 0; i < TUBES; i++)
        for (size_t side = 0; side < 2; side++)
            place_half(t, i, side, away[i]);
    t->material = isotropic(0.17, 400, 1e-5);
    t->body = (drape_body){.kind = DRAPE_BODY_CAPSULE,
                           .offset = DRAPE_DEFAULT_OFFSET,
                           .friction = 0.3,
                           .point = {0, -0.2, 0},
                           .axis = {0, 0.3, 0},
                           .radius = 0.05};
    t->desc.seam = t->seam;
    t->desc.material = &t->material;
    t->desc.body = &t->body;
    t->desc.materials = t->desc.bodies = 1;
    return t;
}

static void tubes_free(struct tubes *t)
{
    for (size_t i = 0; i < TUBES; i++)
        grid_done(&t->grid[i]);
    free(t->x);
    free(t->pattern);
    free(t->triangle);
    free(t);
}

/* It may start outside of the tube's halves, or between where these start and where they are once sewn; and
 * it may be so narrow that it has to stretch by a seventh, to pull harder than what suffices for others. */
static void test_sewing__a_cuff_closes_over_a_tube_without_crossing_it(void **state)
{
    (void)state;
    static const struct {
        double girth[TUBES], away[TUBES];
    } cases[] = {{{0.38, 0.45}, {0.08, 0.12}}, {{0.38, 0.45}, {0.15, 0.1}}, {{0.345, 0.3}, {0.08, 0.12}}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct tubes *t = tubes_new(cases[c].girth, cases[c].away);
        drape_options options = drape_options_default();
        options.method = DRAPE_METHOD_DYNAMIC; /* as sewing leaves them */
        options.time_step = DRAPE_MIN_TIME_STEP;
        options.max_iterations = 1;
        struct run run = run_new(&t->desc, &options);
        print_message("  %.2f m over %.2f m: %u iterations, gap %.2f mm, %u crossings\n", cases[c].girth[1],
                      cases[c].girth[0], run.report->sewing_iterations, 1e3 * run.report->seam_gap,
                      run.report->self_intersections);
        assert_true(run.report->seam_gap <= 1e-3);
        assert_int_equal(run.report->self_intersections, 0);
        assert_int_equal(run.report->penetrations, 0);
        run_done(&run);
        tubes_free(t);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sewing__sides_of_unequal_length_close_without_folding_over),
        cmocka_unit_test(test_sewing__eased_and_gathered_seams_come_to_rest),
        cmocka_unit_test(test_sewing__the_mechanics_do_not_mind_how_triangles_are_wound),
        cmocka_unit_test(test_sewing__a_cuff_closes_over_a_tube_without_crossing_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
