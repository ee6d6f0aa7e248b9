/* test_elastica.c - a heavy strip clamped horizontally by two held rows, against the exact elastica. */
#include "run.h"

#define GRAVITY   9.81
#define LENGTH    0.1  /* m, from the clamp to the tip */
#define DENSITY   0.2  /* kg/m^2 */
#define MEMBRANE  1000 /* N/m: stretches by 1e-4 at most */
#define ACROSS    6    /* cells */
#define REFERENCE "../shared/data/reference/cantilever_elastica.csv"

/* Rigidity for Gamma = density g L^3 / B. */
static double rigidity_for(double gamma)
{
    return DENSITY * GRAVITY * LENGTH * LENGTH * LENGTH / gamma;
}

/* A strip with `cells` cells beyond the clamp line, which is the second column of points. */
static struct setup *strip_new(enum grid_kind kind, size_t cells, drape_material material)
{
    double h = LENGTH / (double)cells, width = LENGTH + h;
    if (kind == GRID_GRADED) { /* its columns are not even: let those beyond the first take up LENGTH */
        struct grid probe = grid_new(kind, cells + 1, ACROSS, 1, 1, 2);
        width = LENGTH / (1 - probe.uv[2]);
        grid_done(&probe);
    }
    struct setup *setup = setup_new(grid_new(kind, cells + 1, ACROSS, width, ACROSS * h, 2), material);
    pin_columns(setup, 2);
    return setup;
}

struct tip {
    double W, H; /* how far out and how far down, over LENGTH */
};

/* Drapes and measures: clamp line and tip are taken in the middle of the strip. */
static struct tip drape_strip(const struct setup *setup, size_t first_vertex_of_tip_half)
{
    const struct grid *grid = &setup->grid;
    drape_options options = drape_options_default();
    options.method = DRAPE_METHOD_STOP_AND_GO;
    options.stop_on = DRAPE_STOP_ON_POTENTIAL;
    options.time_step = 0.1;
    options.tolerance = 1e-4;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.status, DRAPE_OK);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    const double *clamp = run.x + 3 * (size_t)grid_at(grid, 1, ACROSS / 2);
    const double *end = run.x + 3 * (first_vertex_of_tip_half + grid_at(grid, grid->nx, ACROSS / 2));
    struct tip tip = {(end[0] - clamp[0]) / LENGTH, (clamp[1] - end[1]) / LENGTH};
    assert_true(run.report->state.energy.bend > 0);
    run_done(&run);
    return tip;
}

static struct tip hang(enum grid_kind kind, size_t cells, double gamma)
{
    struct setup *setup = strip_new(kind, cells, isotropic(DENSITY, MEMBRANE, rigidity_for(gamma)));
    struct tip tip = drape_strip(setup, 0);
    setup_free(setup);
    return tip;
}

static const struct tip EXACT_10 = {0.65635, 0.70020}; /* Gamma = 10 */

static void test_elastica__at_gamma_10_is_within_half_a_percent_on_every_mesh(void **state)
{
    (void)state;
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct tip tip = hang(kind, 40, 10);
        print_message("  %-16s H/L %.5f (%+.2f %%), W/L %.5f (%+.2f %%)\n", grid_name[kind], tip.H,
                      100 * (tip.H / EXACT_10.H - 1), tip.W, 100 * (tip.W / EXACT_10.W - 1));
        assert_close(tip.H, EXACT_10.H, 0.005);
        assert_close(tip.W, EXACT_10.W, 0.01);
    }
}

static void test_elastica__error_falls_with_the_square_of_the_cell(void **state)
{
    (void)state;
    const enum grid_kind kind[] = {GRID_ONE, GRID_ALTERNATING, GRID_DELAUNAY};
    for (size_t i = 0; i < sizeof kind / sizeof *kind; i++) {
        double error[3];
        for (int r = 0; r < 3; r++)
            error[r] = hang(kind[i], (size_t)10 << r, 10).H - EXACT_10.H;
        print_message("  %-16s errors of H/L %+.5f %+.5f %+.5f\n", grid_name[kind[i]], error[0], error[1],
                      error[2]);
        assert_true(fabs(error[0]) < 0.008);
        assert_true(error[0] / error[1] > 3);
        assert_true(error[1] / error[2] > 3);
    }
}

/* Finds the row of the reference for this Gamma. */
static bool reference_tip(FILE *file, double gamma, struct tip *ret)
{
    char line[256];
    rewind(file);
    while (fgets(line, sizeof line, file)) {
        double at, x, drop;
        if (sscanf(line, "%lf,%lf,%lf", &at, &x, &drop) == 3 && at == gamma) {
            *ret = (struct tip){x, drop};
            return true;
        }
    }
    return false;
}

static void test_elastica__follows_the_reference_from_stiff_to_limp(void **state)
{
    (void)state;
    const double gamma[] = {0.1, 1, 5, 10, 20, 50, 100};
    FILE *file = fopen(REFERENCE, "r");
    if (!file) {
        print_message("SKIP: %s is not there\n", REFERENCE);
        skip();
    }
    for (size_t i = 0; i < sizeof gamma / sizeof *gamma; i++) {
        struct tip exact = {0}, tip = hang(GRID_DELAUNAY, 40, gamma[i]);
        assert_true(reference_tip(file, gamma[i], &exact));
        print_message("  Gamma %-4g H/L %.5f against %.5f, W/L %.5f against %.5f\n", gamma[i], tip.H, exact.H,
                      tip.W, exact.W);
        assert_near(tip.H, exact.H, 0.005, 0);
        assert_near(tip.W, exact.W, 0.01, 0);
    }
    fclose(file);
}

/* Cut along the warp the strip bends about the weft: bend_warp alone counts. */
static void test_elastica__the_rigidity_along_the_strip_is_the_one_that_counts(void **state)
{
    (void)state;
    double B = rigidity_for(10);
    drape_material along_weft = isotropic(DENSITY, MEMBRANE, B), along_warp = along_weft;
    along_weft.bend_warp = along_warp.bend_weft = 30 * B;
    along_weft.bend_twist = along_warp.bend_twist = 7 * B;
    struct setup *weft = strip_new(GRID_ALTERNATING, 40, along_weft),
                 *warp = strip_new(GRID_ALTERNATING, 40, along_warp);
    for (size_t i = 0; i < warp->grid.vertices; i++) { /* the same strip lying the other way in its pattern */
        double *uv = warp->grid.uv + 2 * i, u = uv[0];
        uv[0] = uv[1];
        uv[1] = u;
    }
    struct tip a = drape_strip(weft, 0), b = drape_strip(warp, 0);
    print_message("  H/L %.5f along the weft, %.5f along the warp\n", a.H, b.H);
    assert_close(a.H, EXACT_10.H, 0.005);
    assert_close(a.H, b.H, 1e-6);
    assert_close(a.W, b.W, 1e-6);
    setup_free(weft);
    setup_free(warp);
}

/* Gives every vertex a second copy: the same place, but laid elsewhere in the pattern, turned and
 * perhaps mirrored. */
static void copy_vertices(const struct setup *whole, bool mirror, struct setup *sewn)
{
    size_t n = whole->grid.vertices;
    sewn->x = malloc(6 * n * sizeof *sewn->x);
    sewn->grid.uv = malloc(4 * n * sizeof *sewn->grid.uv);
    assert_non_null(sewn->x);
    assert_non_null(sewn->grid.uv);
    memcpy(sewn->x, whole->x, 3 * n * sizeof *sewn->x);
    memcpy(sewn->x + 3 * n, whole->x, 3 * n * sizeof *sewn->x);
    memcpy(sewn->grid.uv, whole->grid.uv, 2 * n * sizeof *sewn->grid.uv);
    for (size_t i = 0; i < n; i++) {
        double u = whole->grid.uv[2 * i], v = whole->grid.uv[2 * i + 1] * (mirror ? -1 : 1);
        sewn->grid.uv[2 * (n + i)] = 4 + cos(2.2) * u - sin(2.2) * v;
        sewn->grid.uv[2 * (n + i) + 1] = -3 + sin(2.2) * u + cos(2.2) * v;
    }
}

/* Triangles beyond column `half` of points get the second copy of their vertices. */
static void cut_triangles(const struct grid *whole, size_t half, struct grid *sewn)
{
    double line = whole->uv[2 * (size_t)grid_at(whole, half, 0)];
    sewn->triangle = malloc(3 * whole->triangles * sizeof *sewn->triangle);
    assert_non_null(sewn->triangle);
    for (size_t t = 0; t < whole->triangles; t++) {
        const uint32_t *corner = whole->triangle + 3 * t;
        double u = 0;
        for (size_t k = 0; k < 3; k++)
            u += whole->uv[2 * (size_t)corner[k]] / 3;
        for (size_t k = 0; k < 3; k++)
            sewn->triangle[3 * t + k] = corner[k] + (uint32_t)(u > line ? whole->vertices : 0);
    }
}

/* The strip cut in two along a column of points and sewn up again. */
static struct tip hang_sewn(enum grid_kind kind, bool mirror)
{
    struct setup *whole = strip_new(kind, 40, isotropic(DENSITY, MEMBRANE, rigidity_for(10)));
    size_t n = whole->grid.vertices, half = whole->grid.nx / 2;
    struct setup sewn = *whole;
    uint32_t seam[2 * (ACROSS + 1)];
    copy_vertices(whole, mirror, &sewn);
    cut_triangles(&whole->grid, half, &sewn.grid);
    for (size_t j = 0; j <= ACROSS; j++) {
        seam[2 * j] = grid_at(&whole->grid, half, j);
        seam[2 * j + 1] = seam[2 * j] + (uint32_t)n;
    }
    sewn.desc.vertices = 2 * n;
    sewn.desc.positions = sewn.x;
    sewn.desc.pattern = sewn.grid.uv;
    sewn.desc.triangle = sewn.grid.triangle;
    sewn.desc.seam = seam;
    sewn.desc.seams = ACROSS + 1;
    struct tip tip = drape_strip(&sewn, n);
    free(sewn.x);
    grid_done(&sewn.grid);
    setup_free(whole);
    return tip;
}

static void test_elastica__does_not_notice_a_seam(void **state)
{
    (void)state;
    const enum grid_kind kind[] = {GRID_ONE, GRID_ALTERNATING, GRID_RANDOM};
    for (size_t i = 0; i < sizeof kind / sizeof *kind; i++) {
        struct tip whole = hang(kind[i], 40, 10), sewn = hang_sewn(kind[i], false),
                   turned = hang_sewn(kind[i], true);
        print_message("  %-16s H/L %.7f whole, %.7f sewn, %.7f mirrored\n", grid_name[kind[i]], whole.H,
                      sewn.H, turned.H);
        assert_close(sewn.H, whole.H, 1e-7);
        assert_close(turned.H, whole.H, 1e-7);
        assert_close(turned.W, whole.W, 1e-7);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_elastica__at_gamma_10_is_within_half_a_percent_on_every_mesh),
        cmocka_unit_test(test_elastica__error_falls_with_the_square_of_the_cell),
        cmocka_unit_test(test_elastica__follows_the_reference_from_stiff_to_limp),
        cmocka_unit_test(test_elastica__the_rigidity_along_the_strip_is_the_one_that_counts),
        cmocka_unit_test(test_elastica__does_not_notice_a_seam),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
