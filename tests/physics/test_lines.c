/* test_lines.c - elastics, folds, shrinkage, interfacing and tacks at rest, against closed forms. */
#include "../solver/shapes.h"
#include "run.h"

#define GRAVITY 9.81
#define DEGREE  (M_PI / 180)
#define LENGTH  0.12 /* m, of a strip */
#define DENSITY 0.2

/* Those whose rows and columns of points are straight. */
static const enum grid_kind straight[] = {GRID_ONE, GRID_ALTERNATING, GRID_RANDOM};

#define STRAIGHT (sizeof straight / sizeof *straight)

/* ---- scenes ---- */

/* A strip clamped by its first two columns, without gravity: `cells` by `across` cells beyond the clamp line,
 * LENGTH long. */
static struct setup *strip_new(enum grid_kind kind, size_t cells, size_t across, double k, double B)
{
    struct setup *setup = setup_new(grid_strip(kind, cells, across, LENGTH), isotropic(DENSITY, k, B));
    pin_columns(setup, 2);
    memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
    return setup;
}

/* Pairs of vertices along column i, ny of them; the caller frees them. */
static uint32_t *column_edges(const struct grid *grid, size_t i)
{
    uint32_t *edge = malloc(2 * grid->ny * sizeof *edge);
    assert_non_null(edge);
    for (size_t j = 0; j < grid->ny; j++) {
        edge[2 * j] = grid_at(grid, i, j);
        edge[2 * j + 1] = grid_at(grid, i, j + 1);
    }
    return edge;
}

static drape_options tight(bool certify)
{
    drape_options options = drape_options_default();
    options.tolerance = 1e-6;
    options.certify = certify;
    return options;
}

/* Mean position of the last column. */
static void tip_of(const struct setup *setup, const double *x, double ret[3])
{
    const struct grid *grid = &setup->grid;
    memset(ret, 0, 3 * sizeof *ret);
    for (size_t j = 0; j <= grid->ny; j++)
        for (size_t d = 0; d < 3; d++)
            ret[d] += x[3 * (size_t)grid_at(grid, grid->nx, j) + d] / (double)(grid->ny + 1);
}

static drape_body floor_at(double height)
{
    return (drape_body){
        .kind = DRAPE_BODY_PLANE, .offset = 0.003, .point = {0, height, 0}, .axis = {0, 1, 0}};
}

/* ---- folds ---- */

/* By how much row j goes down steeper to the right of the column than to the left of it, rad. */
static double angle_at(const struct setup *setup, const struct run *run, size_t column, size_t j)
{
    double slope[2];
    for (size_t side = 0; side < 2; side++) {
        const double *a = run->x + 3 * (size_t)grid_at(&setup->grid, column + side - 1, j), *b = a + 3;
        slope[side] = atan2(-(b[1] - a[1]), b[0] - a[0]);
    }
    return slope[1] - slope[0];
}

struct folded { /* a strip with a fold along a column; the setup points into it */
    struct setup *setup;
    uint32_t *edge;
    drape_fold fold;
};

static void fold_at(struct folded *f, struct setup *setup, size_t column, double angle, double stiffness)
{
    f->setup = setup;
    f->edge = column_edges(&setup->grid, column);
    f->fold = (drape_fold){f->edge, setup->grid.ny, angle, stiffness};
    setup->desc.folds = 1;
    setup->desc.fold = &f->fold;
}

static void folded_free(struct folded *f)
{
    setup_free(f->setup);
    free(f->edge);
}

/* Nothing else has a say: the fold takes its angle, a mountain seen from the front (up) downwards, and no
 * energy is left, although the cloth beside it would bend. */
static void test_lines__a_fold_without_load_takes_its_angle(void **state)
{
    (void)state;
    static const double degrees[] = {30, -60, 90, -150, 170, 180};
    for (size_t kind = 0; kind < STRAIGHT; kind++)
        for (size_t k = 0; k < sizeof degrees / sizeof *degrees; k++) {
            struct folded f;
            drape_options options = tight(false);
            fold_at(&f, strip_new(straight[kind], 12, 4, 500, 1e-5), 5, degrees[k] * DEGREE, 1e-3);
            struct run run = run_new(&f.setup->desc, &options);
            assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
            assert_true(run.report->iterations < 30);
            for (size_t j = 0; j <= f.setup->grid.ny; j++) { /* as a direction: 180 and -180 are one */
                double angle = angle_at(f.setup, &run, 5, j) - degrees[k] * DEGREE;
                assert_near(sin(angle), 0, 1e-6, 1);
                assert_true(cos(angle) > 0);
            }
            run_done(&run);
            folded_free(&f);
        }
}

/* Beyond the fold lies a board of length a: stiffness (theta - rest) = weight a/2 cos(theta) per metre. */
static double hinge_angle(double rest, double stiffness, double a)
{
    double moment = DENSITY * GRAVITY * a * a / 2, theta = rest;
    for (int i = 0; i < 100; i++)
        theta -= (stiffness * (theta - rest) - moment * cos(theta)) / (stiffness + moment * sin(theta));
    return theta;
}

static void test_lines__a_stiff_flap_on_a_fold_hangs_as_on_a_spring(void **state)
{
    (void)state;
    static const double degrees[] = {0, -60, 50, -120};
    const double stiffness = 0.01;
    for (size_t kind = 0; kind < STRAIGHT; kind++)
        for (size_t k = 0; k < sizeof degrees / sizeof *degrees; k++) {
            struct folded f;
            drape_options options = tight(true);
            size_t column = 5;
            fold_at(&f, strip_new(straight[kind], 12, 4, 1e5, 50), column, degrees[k] * DEGREE, stiffness);
            f.setup->desc.gravity[1] = -GRAVITY;
            const double *uv = f.setup->grid.uv;
            double a = LENGTH - (uv[2 * column] - uv[2]);
            double exact = hinge_angle(f.fold.angle, stiffness, a);
            struct run run = run_new(&f.setup->desc, &options);
            assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
            assert_true(run.report->certificate.certified);
            assert_true(fabs(exact - f.fold.angle) > 0.1);
            assert_near(angle_at(f.setup, &run, column, 2), exact, 1e-3, 1);
            run_done(&run);
            folded_free(&f);
        }
}

/* Of a strip that bends a little, too: the sum of a cantilever's sag and a hinge's,
 * q L^4/(8 B) + q (L - c)^3/(2 stiffness). The fold adds to the error what the fold is wrong by. */
static double soft_error(enum grid_kind kind, size_t cells, double stiffness)
{
    const double B = 0.1, q = DENSITY * GRAVITY;
    struct folded f;
    drape_options options = tight(false);
    fold_at(&f, strip_new(kind, cells, cells / 2, 5000, B), cells / 2 + 1, 0, stiffness);
    f.setup->desc.gravity[1] = -GRAVITY;
    struct run run = run_new(&f.setup->desc, &options);
    double tip[3], exact = q * pow(LENGTH, 4) / (8 * B) + q * pow(LENGTH / 2, 3) / (2 * stiffness);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    tip_of(f.setup, run.x, tip);
    run_done(&run);
    folded_free(&f);
    return fabs(-tip[1] / exact - 1);
}

static void test_lines__a_fold_in_soft_cloth_converges_on_beam_and_hinge(void **state)
{
    (void)state;
    static const size_t cells[] = {6, 12, 24};
    static const double stiffness[] = {0.1, 1, 100}; /* N; cloth over one cell of 5 mm has 20 */
    for (size_t kind = 0; kind < STRAIGHT; kind++)
        for (size_t s = 0; s < 3; s++) {
            double error[3];
            for (size_t i = 0; i < 3; i++)
                error[i] = soft_error(straight[kind], cells[i], stiffness[s]);
            print_message("  %s, %g N: errors %.4f %.4f %.4f, order %.2f\n", grid_name[straight[kind]],
                          stiffness[s], error[0], error[1], error[2], observed_order(3, cells, error));
            assert_true(error[2] < 0.007);
            assert_true(observed_order(3, cells, error) > 1.4);
        }
}

enum { ROWS = 4 };

/* Two halves of 20 mm by 30 mm, vertices column by column, sewn along the middle. */
struct sewn {
    double x[3 * 4 * ROWS], uv[2 * 4 * ROWS];
    uint32_t triangle[12 * (ROWS - 1)], seam[2 * ROWS], pin[ROWS], edge[2 * (ROWS - 1)]; /* of the seam */
    drape_material material;
    drape_scene_desc desc;
};

/* They start `gap` apart (m), the first column pinned. */
static void sewn_init(struct sewn *s, double gap)
{
    uint32_t *t = s->triangle;
    *s = (struct sewn){.material = isotropic(DENSITY, 500, 1e-4)};
    for (uint32_t v = 0; v < 4 * ROWS; v++) {
        uint32_t column = v / ROWS, row = v % ROWS;
        s->uv[2 * v] = column == 0 ? 0 : column == 3 ? 0.04 : 0.02;
        s->uv[2 * v + 1] = 0.01 * row;
        s->x[3 * v] = s->uv[2 * v] + (column > 1 ? gap : 0);
        s->x[3 * v + 2] = -s->uv[2 * v + 1];
    }
    for (uint32_t half = 0; half < 2; half++)
        for (uint32_t j = 0; j + 1 < ROWS; j++, t += 6) {
            uint32_t a = 2 * half * ROWS + j, b = a + ROWS;
            memcpy(t, (uint32_t[6]){a, b, b + 1, a, b + 1, a + 1}, 6 * sizeof *t);
        }
    for (uint32_t j = 0; j < ROWS; j++) {
        s->seam[2 * j] = ROWS + j;
        s->seam[2 * j + 1] = 2 * ROWS + j;
        s->pin[j] = j;
        if (j + 1 < ROWS) {
            s->edge[2 * j] = 2 * ROWS + j;
            s->edge[2 * j + 1] = 2 * ROWS + j + 1;
        }
    }
    s->desc = (drape_scene_desc){.thickness = DRAPE_DEFAULT_THICKNESS,
                                 .vertices = 4 * ROWS,
                                 .triangles = 4 * (ROWS - 1),
                                 .seams = ROWS,
                                 .pins = ROWS,
                                 .materials = 1,
                                 .positions = s->x,
                                 .pattern = s->uv,
                                 .triangle = s->triangle,
                                 .seam = s->seam,
                                 .pin = s->pin,
                                 .material = &s->material};
}

/* A seam's edge is one as any other, whether it was sewn first or not. */
static void test_lines__a_fold_lies_along_a_seam_as_within_a_piece(void **state)
{
    (void)state;
    static const double gap[] = {0, 0.01};
    for (size_t i = 0; i < 2; i++) {
        struct sewn s;
        drape_options options = tight(false);
        sewn_init(&s, gap[i]);
        drape_fold fold = {s.edge, ROWS - 1, 70 * DEGREE, 1e-3};
        s.desc.folds = 1;
        s.desc.fold = &fold;
        struct run run = run_new(&s.desc, &options);
        const double *a = run.x, *b = run.x + 3 * ROWS, *c = run.x + 9 * ROWS;
        double first = atan2(-(b[1] - a[1]), b[0] - a[0]), second = atan2(-(c[1] - b[1]), c[0] - b[0]);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_int_equal(run.report->sewing_iterations > 0, gap[i] > 0);
        assert_near(second - first, 70 * DEGREE, 1e-6, 1);
        run_done(&run);
    }
}

/* Sewing, without gravity, already brings a tacked vertex to its point; the drape then hangs there. */
static void test_lines__a_tack_holds_while_the_pieces_are_sewn(void **state)
{
    (void)state;
    struct sewn s;
    drape_body ground = floor_at(-2);
    drape_tack tack = {.vertex = 3 * ROWS, .triangle = DRAPE_NO_TRIANGLE, .point = {0.1, 0.02, 0}};
    drape_options options = tight(false);
    sewn_init(&s, 0.05);
    s.desc.pins = 0;
    s.desc.bodies = s.desc.tacks = 1;
    s.desc.body = &ground;
    s.desc.tack = &tack;
    s.desc.gravity[1] = -GRAVITY;
    struct run run = run_new(&s.desc, &options);
    const double *x = run.x + 3 * (size_t)tack.vertex;
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_true(run.report->sewing_iterations > 0 && run.report->seam_gap <= 1e-3);
    assert_near(x[0], 0.1, 1e-9, 1);
    assert_near(0.02 - x[1], DENSITY * 0.04 * 0.03 * GRAVITY / DRAPE_TACK_STIFFNESS, 1e-4, 0);
    assert_near(x[2], 0, 1e-9, 1);
    run_done(&run);
}

/* ---- elastics ---- */

struct taped { /* cloth with an elastic along every row, half as strong along the outer two */
    struct setup *setup;
    uint32_t *edge; /* 2*nx per row */
    drape_elastic elastic[2];
};

/* In all `stiffness` N. */
static void tape(struct taped *t, struct setup *setup, double factor, double stiffness)
{
    const struct grid *grid = &setup->grid;
    size_t edges = 0;
    double each = stiffness / (double)grid->ny;
    t->setup = setup;
    t->edge = malloc(2 * (grid->ny + 1) * grid->nx * sizeof *t->edge);
    assert_non_null(t->edge);
    for (size_t n = 0; n <= grid->ny; n++) { /* rows 0, ny, then those between */
        size_t j = n == 0 ? 0 : n == 1 ? grid->ny : n - 1;
        for (size_t i = 0; i < grid->nx; i++, edges++) {
            t->edge[2 * edges] = grid_at(grid, i, j);
            t->edge[2 * edges + 1] = grid_at(grid, i + 1, j);
        }
    }
    t->elastic[0] = (drape_elastic){t->edge, 2 * grid->nx, factor, each / 2};
    t->elastic[1] = (drape_elastic){t->edge + 4 * grid->nx, (grid->ny - 1) * grid->nx, factor, each};
    setup->desc.elastics = 2;
    setup->desc.elastic = t->elastic;
}

static void taped_free(struct taped *t)
{
    setup_free(t->setup);
    free(t->edge);
}

#define WIDTH 0.06 /* m, of a taped strip */

/* Without rigidity, held by its first column. */
static struct setup *limp_strip_new(enum grid_kind kind, size_t cells, double k)
{
    struct setup *setup =
        setup_new(grid_new(kind, cells, cells / 2, LENGTH, WIDTH, 0), isotropic(DENSITY, k, 0));
    pin_columns(setup, 1);
    memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
    return setup;
}

/* lambda at which k/2 lambda (lambda^2 - 1) WIDTH + T (lambda/factor - 1) = P: cloth and tape side by side.
 */
static double stretch_under(double P, double k, double T, double factor)
{
    double lambda = 1;
    for (int i = 0; i < 60; i++)
        lambda -= (0.5 * k * WIDTH * lambda * (lambda * lambda - 1) + T * (lambda / factor - 1) - P) /
                  (0.5 * k * WIDTH * (3 * lambda * lambda - 1) + T / factor);
    return lambda;
}

/* Gathered or flared in its plane, out of which nothing pushes it. */
static void test_lines__elastic_and_cloth_share_the_force_at_rest(void **state)
{
    (void)state;
    static const double factor[] = {0.6, 0.9, 1.2, 2};
    const double k = 400, T = 6;
    for (size_t kind = 0; kind < STRAIGHT; kind++)
        for (size_t i = 0; i < sizeof factor / sizeof *factor; i++) {
            struct taped t;
            double tip[3];
            drape_options options = tight(false);
            tape(&t, limp_strip_new(straight[kind], 8, k), factor[i], T);
            struct run run = run_new(&t.setup->desc, &options);
            double lambda = stretch_under(0, k, T, factor[i]);
            tip_of(t.setup, run.x, tip);
            assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
            assert_true(fabs(lambda - 1) > 0.02);
            assert_near(tip[0], lambda * LENGTH, 1e-6, 0);
            assert_near(run.report->state.energy.stretch,
                        LENGTH * (k * WIDTH * pow(lambda * lambda - 1, 2) / 8 +
                                  T * factor[i] * pow(lambda / factor[i] - 1, 2) / 2),
                        1e-6, 0);
            run_done(&run);
            taped_free(&t);
        }
}

/* By Simpson's rule in the distance s from the lower edge. The certificate reads the true Hessian, that of
 * the flared tape under pressure included. */
static void test_lines__a_taped_strip_hangs_as_the_closed_form_says(void **state)
{
    (void)state;
    enum { PANELS = 200 };
    static const double factor[] = {0.8, 1.1};
    const double k = 30, T = 1, g = 5 * GRAVITY;
    for (size_t i = 0; i < sizeof factor / sizeof *factor; i++) {
        struct taped t;
        double tip[3], length = 0;
        drape_options options = tight(true);
        for (int n = 0; n <= PANELS; n++) {
            double s = LENGTH * n / PANELS, weight = n == 0 || n == PANELS ? 1 : n % 2 ? 4 : 2;
            length += weight * LENGTH / PANELS / 3 * stretch_under(DENSITY * g * s * WIDTH, k, T, factor[i]);
        }
        tape(&t, limp_strip_new(GRID_ALTERNATING, 16, k), factor[i], T);
        t.setup->desc.gravity[0] = g; /* along the strip */
        struct run run = run_new(&t.setup->desc, &options);
        tip_of(t.setup, run.x, tip);
        print_message("  %.6f m of %.6f m, %s\n", tip[0], length, run.report->certificate.reason);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_near(tip[0], length, 1e-3, 0);
        run_done(&run);
        taped_free(&t);
    }
}

/* A square that hangs by two corners from horizontal, tapes along the sides that turn by a right angle: auto
 * takes no more iterations however stiff they are (17 to 30; 57 to 124 if their tension were not predicted,
 * and more than 1500 if what a step gets wrong about them were not counted). */
static void test_lines__stiff_tapes_are_free_to_turn(void **state)
{
    (void)state;
    enum { CELLS = 8 };
    static const double stiffness[] = {100, 1e4, 1e6};
    for (size_t i = 0; i < sizeof stiffness / sizeof *stiffness; i++) {
        struct setup *setup =
            setup_new(grid_new(GRID_ONE, CELLS, CELLS, 0.2, 0.2, 0), isotropic(0.15, 400, 1e-5));
        uint32_t edge[4 * CELLS];
        for (size_t j = 0; j < CELLS; j++) {
            edge[4 * j] = grid_at(&setup->grid, j, 0);
            edge[4 * j + 1] = grid_at(&setup->grid, j + 1, 0);
            edge[4 * j + 2] = grid_at(&setup->grid, j, CELLS);
            edge[4 * j + 3] = grid_at(&setup->grid, j + 1, CELLS);
        }
        drape_elastic elastic = {edge, 2 * CELLS, 1, stiffness[i]};
        drape_options options = drape_options_default();
        setup->pin[setup->desc.pins++] = grid_at(&setup->grid, 0, 0);
        setup->pin[setup->desc.pins++] = grid_at(&setup->grid, 0, CELLS);
        setup->desc.elastics = 1;
        setup->desc.elastic = &elastic;
        struct run run = run_new(&setup->desc, &options);
        print_message("  %g N: %u iterations\n", stiffness[i], run.report->iterations);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_true(run.report->iterations <= 40);
        run_done(&run);
        setup_free(setup);
    }
}

/* A flared edge ruffles: auto rests in about 94 iterations, and in more than 1500 without what the projection
 * leaves out of the bars' Hessian, as stop-and-go. */
static void test_lines__a_flared_edge_comes_to_rest(void **state)
{
    (void)state;
    struct setup *setup = setup_new(grid_new(GRID_ONE, 8, 8, 0.2, 0.2, 0), isotropic(0.15, 400, 1e-5));
    uint32_t *edge = column_edges(&setup->grid, 8);
    drape_elastic elastic = {edge, 8, 1.3, 3};
    drape_options options = drape_options_default();
    options.tolerance = 1e-4;
    pin_columns(setup, 2);
    setup->desc.elastics = 1;
    setup->desc.elastic = &elastic;
    struct run run = run_new(&setup->desc, &options);
    print_message("  %u iterations\n", run.report->iterations);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(run.report->method, DRAPE_METHOD_AUTO);
    assert_true(run.report->iterations <= 400);
    run_done(&run);
    setup_free(setup);
    free(edge);
}

/* Every method comes to the same rest with an elastic, a fold and soft cloth: one energy. */
static void test_lines__every_method_finds_the_same_rest(void **state)
{
    (void)state;
    static const drape_method method[] = {DRAPE_METHOD_AUTO, DRAPE_METHOD_STOP_AND_GO,
                                          DRAPE_METHOD_QUASI_STATIC, DRAPE_METHOD_NEWTON};
    double reference = 0;
    for (size_t m = 0; m < sizeof method / sizeof *method; m++) {
        struct folded f;
        struct taped t;
        drape_options options = tight(false);
        options.method = method[m];
        options.line_search = true;
        struct setup *setup = strip_new(GRID_ONE, 8, 4, 100, 1e-2);
        setup->desc.gravity[1] = -GRAVITY;
        fold_at(&f, setup, 5, 0.8, 0.02);
        tape(&t, setup, 0.9, 1);
        struct run run = run_new(&setup->desc, &options);
        double potential = run.report->state.energy.potential;
        print_message("  %s: %u iterations, %.12g J\n", drape_method_name(method[m]), run.report->iterations,
                      potential);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        reference = m ? reference : potential;
        assert_near(potential, reference, 1e-7, 0);
        run_done(&run);
        free(t.edge);
        folded_free(&f);
    }
}

/* ---- shrinkage and interfacing ---- */

/* One pin, no gravity: it rests without energy in the size that it shrank to. Hung by a tack, it weighs what
 * was cut. */
static void test_lines__shrunk_cloth_rests_smaller_and_weighs_the_same(void **state)
{
    (void)state;
    struct setup *setup =
        setup_new(grid_new(GRID_DELAUNAY, 8, 6, 0.2, 0.1, 0), isotropic(DENSITY, 300, 1e-3));
    drape_body ground = floor_at(-2);
    drape_tack tack = {.triangle = DRAPE_NO_TRIANGLE};
    drape_options options = tight(false);
    setup->material.shrink_weft = 0.05;
    setup->material.shrink_warp = -0.1; /* it gave */
    setup->pin[setup->desc.pins++] = 0;
    memset(setup->desc.gravity, 0, sizeof setup->desc.gravity);
    struct run run = run_new(&setup->desc, &options);
    const double *corner = run.x + 3 * (setup->grid.vertices - 1);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_near(hypot(hypot(corner[0], corner[1]), corner[2]), hypot(0.19, 0.11), 1e-6, 0);
    assert_near(run.report->state.energy.potential, 0, 1e-10, 1);
    run_done(&run);

    setup->desc.gravity[1] = -GRAVITY;
    setup->desc.pins = 0;
    setup->desc.bodies = setup->desc.tacks = 1;
    setup->desc.body = &ground;
    setup->desc.tack = &tack;
    run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_near(-run.x[1], DENSITY * 0.2 * 0.1 * GRAVITY / DRAPE_TACK_STIFFNESS, 1e-4, 0);
    run_done(&run);
    setup_free(setup);
}

/* A cantilever interfaced over its first half: q/2 times the integral of (L - s)^3/B. What its sag lacks, of
 * the whole. */
static double interfaced_error(enum grid_kind kind, size_t cells)
{
    const double B[2] = {1, 0.1}, q = DENSITY * GRAVITY, half = LENGTH / 2;
    double exact = q / 8 * ((pow(LENGTH, 4) - pow(half, 4)) / B[0] + pow(half, 4) / B[1]), tip[3];
    struct setup *setup = strip_new(kind, cells, cells / 2, 5000, 0);
    drape_material material[] = {isotropic(DENSITY, 5000, B[0]), isotropic(DENSITY, 5000, B[1])};
    const struct grid *grid = &setup->grid;
    uint32_t *of = calloc(grid->triangles, sizeof *of);
    assert_non_null(of);
    for (size_t t = 0; t < grid->triangles; t++) {
        double u = 0;
        for (size_t c = 0; c < 3; c++)
            u += grid->uv[2 * (size_t)grid->triangle[3 * t + c]] / 3;
        of[t] = u > grid->uv[2] + half;
    }
    setup->desc.materials = 2;
    setup->desc.material = material;
    setup->desc.triangle_material = of;
    setup->desc.gravity[1] = -GRAVITY;
    drape_options options = tight(false);
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    tip_of(setup, run.x, tip);
    run_done(&run);
    setup_free(setup);
    free(of);
    return fabs(1 + tip[1] / exact);
}

static void test_lines__an_interfaced_strip_converges_on_the_beam_of_two_rigidities(void **state)
{
    (void)state;
    static const size_t cells[] = {6, 12, 24};
    for (size_t kind = 0; kind < STRAIGHT; kind++) {
        double error[3];
        for (size_t i = 0; i < 3; i++)
            error[i] = interfaced_error(straight[kind], cells[i]);
        print_message("  %s: errors %.4f %.4f %.4f, order %.2f\n", grid_name[straight[kind]], error[0],
                      error[1], error[2], observed_order(3, cells, error));
        assert_true(error[2] < 0.005);
        assert_true(observed_order(3, cells, error) > 1.8);
    }
}

/* ---- tacks ---- */

/* A cloth that one tack holds half a metre from where it starts hangs there, its weight over the stiffness
 * lower, and has not slid off. */
static void test_lines__a_tack_carries_a_cloth_to_its_point_and_holds_its_weight(void **state)
{
    (void)state;
    struct setup *setup =
        setup_new(grid_new(GRID_DELAUNAY, 6, 6, 0.1, 0.1, 0), isotropic(DENSITY, 300, 1e-4));
    drape_body ground = floor_at(-2);
    drape_tack tack = {.vertex = 3, .triangle = DRAPE_NO_TRIANGLE, .point = {0.3, 0.3, -0.2}};
    drape_options options = tight(false);
    setup->desc.bodies = setup->desc.tacks = 1;
    setup->desc.body = &ground;
    setup->desc.tack = &tack;
    struct run run = run_new(&setup->desc, &options);
    const double *x = run.x + 9;
    double sag = DENSITY * 0.01 * GRAVITY / DRAPE_TACK_STIFFNESS;
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_near(x[0], 0.3, 1e-9, 1);
    assert_near(0.3 - x[1], sag, 1e-4, 0);
    assert_near(x[2], -0.2, 1e-9, 1);
    assert_near(run.report->state.energy.contact, 0.5 * DRAPE_TACK_STIFFNESS * sag * sag, 1e-3, 0);
    run_done(&run);
    setup_free(setup);
}

/* Tacked to the side of a ball of triangles, at points of its very surface: cloth rests against it there, a
 * body's offset out, and no vertex is inside. */
static void test_lines__tacks_on_a_bodys_surface_hold_cloth_against_it(void **state)
{
    (void)state;
    struct shape ball = shape_sphere((const double[3]){0, -0.2, 0}, 0.15, 12);
    struct setup *setup =
        setup_new(grid_new(GRID_DELAUNAY, 8, 8, 0.1, 0.1, 0), isotropic(DENSITY, 300, 1e-5));
    drape_body body = shape_body(&ball);
    drape_tack tack[2] = {{.vertex = 0, .barycentric = {0.2, 0.3}}, {.vertex = 8, .barycentric = {1, 0}}};
    drape_options options = drape_options_default();
    double at[2] = {INFINITY, INFINITY};
    for (uint32_t t = 0; t < ball.triangles; t++) { /* nearest to two points of the ball's side */
        const double *p = ball.x + 3 * (size_t)ball.triangle[3 * t];
        for (int k = 0; k < 2; k++) {
            double far = hypot(hypot(p[0] - 0.145, p[1] + 0.17), p[2] - (k ? -0.04 : 0.04));
            if (far < at[k]) {
                at[k] = far;
                tack[k].triangle = t;
            }
        }
    }
    for (size_t v = 0; v < setup->grid.vertices; v++) { /* upright beside the ball */
        setup->x[3 * v] = 0.18;
        setup->x[3 * v + 1] = -0.17 - setup->grid.uv[2 * v + 1];
        setup->x[3 * v + 2] = 0.05 - setup->grid.uv[2 * v];
    }
    setup->desc.bodies = 1;
    setup->desc.tacks = 2;
    setup->desc.body = &body;
    setup->desc.tack = tack;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(run.report->penetrations, 0);
    for (int k = 0; k < 2; k++) {
        const double *x = run.x + 3 * (size_t)tack[k].vertex;
        assert_near(hypot(hypot(x[0], x[1] + 0.2), x[2]), 0.153, 5e-3, 0);
    }
    run_done(&run);
    setup_free(setup);
    shape_free(&ball);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines__a_fold_without_load_takes_its_angle),
        cmocka_unit_test(test_lines__a_stiff_flap_on_a_fold_hangs_as_on_a_spring),
        cmocka_unit_test(test_lines__a_fold_in_soft_cloth_converges_on_beam_and_hinge),
        cmocka_unit_test(test_lines__a_fold_lies_along_a_seam_as_within_a_piece),
        cmocka_unit_test(test_lines__a_tack_holds_while_the_pieces_are_sewn),
        cmocka_unit_test(test_lines__elastic_and_cloth_share_the_force_at_rest),
        cmocka_unit_test(test_lines__a_taped_strip_hangs_as_the_closed_form_says),
        cmocka_unit_test(test_lines__stiff_tapes_are_free_to_turn),
        cmocka_unit_test(test_lines__a_flared_edge_comes_to_rest),
        cmocka_unit_test(test_lines__every_method_finds_the_same_rest),
        cmocka_unit_test(test_lines__shrunk_cloth_rests_smaller_and_weighs_the_same),
        cmocka_unit_test(test_lines__an_interfaced_strip_converges_on_the_beam_of_two_rigidities),
        cmocka_unit_test(test_lines__a_tack_carries_a_cloth_to_its_point_and_holds_its_weight),
        cmocka_unit_test(test_lines__tacks_on_a_bodys_surface_hold_cloth_against_it),
    };
    return cmocka_run_group_tests_name("lines", tests, NULL, NULL);
}
