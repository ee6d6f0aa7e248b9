/* test_seam.c - which seams and windings are warned of, where, and which are not. */
#include "test.h"

#include "scarce.h"
#include "scene.h"

enum { CELLS = 6, ROW = CELLS + 1, STRIP = 2 * ROW, VERTICES = 2 * STRIP, TRIANGLES = 4 * CELLS };

/* Two upright strips side by side, each 2 points wide and ROW points high; vertex 2 j + side of each. Both
 * are wound counter-clockwise as seen from the front; the right side of the left one is sewn to the left side
 * of the right one, from below. */
struct strips {
    double positions[3 * VERTICES], pattern[2 * VERTICES];
    uint32_t triangle[3 * TRIANGLES], seam[2 * ROW], pin[1];
    drape_material material;
    drape_scene_desc desc;
    drape_error warning[DRAPE_MAX_WARNINGS];
    size_t warnings;
};

static void bind(struct strips *s)
{
    s->desc.positions = s->positions;
    s->desc.pattern = s->pattern;
    s->desc.triangle = s->triangle;
    s->desc.seam = s->seam;
    s->desc.pin = s->pin;
    s->desc.material = &s->material;
}

static void make(struct strips *s)
{
    memset(s, 0, sizeof *s);
    for (uint32_t v = 0; v < VERTICES; v++) {
        double across = 0.1 * (v % 2) + (v < STRIP ? 0 : 0.15), up = 0.1 * (v % STRIP / 2);
        memcpy(s->positions + 3 * v, (double[3]){across, up, 0}, 3 * sizeof(double));
        memcpy(s->pattern + 2 * v, (double[2]){across, up}, 2 * sizeof(double));
    }
    for (uint32_t c = 0; c < 2 * CELLS; c++) {
        uint32_t a = 2 * (c % CELLS) + (c < CELLS ? 0 : STRIP);
        memcpy(s->triangle + 6 * c, (uint32_t[6]){a, a + 1, a + 3, a, a + 3, a + 2}, 6 * sizeof a);
    }
    for (uint32_t j = 0; j < ROW; j++) {
        s->seam[2 * j] = 2 * j + 1;
        s->seam[2 * j + 1] = STRIP + 2 * j;
    }
    s->material = (drape_material){
        .density = 0.1, .stretch_weft = 10, .stretch_warp = 10, .stretch_shear = 5, .bend_weft = 1e-5};
    s->desc = drape_scene_desc_default();
    s->desc.vertices = VERTICES;
    s->desc.triangles = TRIANGLES;
    s->desc.seams = ROW;
    s->desc.pins = s->desc.materials = 1;
    bind(s);
}

static void find(struct strips *s)
{
    drape_error error = {.message = ""};
    if (drape_scene_check(&s->desc, &error) < 0)
        fail_msg("refused: %s", error.message);
    assert_int_equal(drape_scene_warnings(&s->desc, s->warning, &s->warnings, &error), DRAPE_OK);
}

static void expect(struct strips *s, size_t which, drape_place place, int64_t element, const char *says)
{
    assert_true(which < s->warnings);
    const drape_error *warning = s->warning + which;
    if (warning->place != place || warning->element != element || !strstr(warning->message, says))
        fail_msg("place %d element %lld: %s", warning->place, (long long)warning->element, warning->message);
    assert_int_equal(warning->status, DRAPE_OK);
}

/* The other way up: the right strip's points of the seam from above. */
static void cross(struct strips *s)
{
    for (uint32_t j = 0; j < ROW; j++)
        s->seam[2 * j + 1] = STRIP + 2 * (CELLS - j);
}

static void turn_inside_out(struct strips *s, size_t first, size_t count)
{
    for (size_t t = first; t < first + count; t++) {
        uint32_t kept = s->triangle[3 * t];
        s->triangle[3 * t] = s->triangle[3 * t + 1];
        s->triangle[3 * t + 1] = kept;
    }
}

static void test_seam__a_good_seam_is_not_warned_of(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    find(&s);
    assert_int_equal(s.warnings, 0);
    s.desc.seams = 0;
    s.desc.pins = 0;
    assert_int_equal(drape_scene_warnings(&s.desc, s.warning, &s.warnings, NULL), DRAPE_OK);
    assert_int_equal(s.warnings, 0);
}

static void test_seam__crossed_directions_are_named_by_their_first_and_last_pair(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    cross(&s);
    find(&s);
    assert_int_equal(s.warnings, 1);
    expect(&s, 0, DRAPE_AT_SEAM, 0, "to seam 6 the sides are sewn in crossed directions: the front of one");
}

static void test_seam__pairs_in_any_order_are_told_of(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    cross(&s);
    const uint32_t order[] = {3, 0, 5, 2, 6, 4, 1};
    uint32_t mixed[2 * ROW];
    for (size_t j = 0; j < ROW; j++)
        memcpy(mixed + 2 * j, s.seam + 2 * order[j], 2 * sizeof *mixed);
    memcpy(s.seam, mixed, sizeof mixed);
    find(&s);
    assert_int_equal(s.warnings, 1);
    expect(&s, 0, DRAPE_AT_SEAM, 1,
           "run opposite ways round"); /* at vertex 1, the first in the order of nodes */
}

static void test_seam__a_piece_wound_inside_out_is_told_from_a_crossed_seam(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    turn_inside_out(&s, 2 * CELLS, 2 * CELLS);
    find(&s);
    assert_int_equal(s.warnings, 1);
    expect(&s, 0, DRAPE_AT_SEAM, 0, "wound inside out");
    cross(&s); /* now the windings agree, and only the start tells */
    find(&s);
    assert_int_equal(s.warnings, 1);
    expect(&s, 0, DRAPE_AT_SEAM, 0, "start the other way round");
}

static void test_seam__a_twisted_ring_is_told_of(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    s.desc.triangles = 2 * CELLS; /* the left strip: its lower end to its upper one */
    s.desc.seams = 2;
    memcpy(s.seam, (uint32_t[4]){0, 2 * CELLS, 1, 2 * CELLS + 1}, 4 * sizeof *s.seam);
    find(&s);
    assert_int_equal(s.warnings, 0);
    memcpy(s.seam, (uint32_t[4]){0, 2 * CELLS + 1, 1, 2 * CELLS}, 4 * sizeof *s.seam);
    find(&s);
    assert_int_equal(s.warnings, 1);
    expect(&s, 0, DRAPE_AT_SEAM, 0,
           "to seam 1 the sides are sewn in crossed directions: the piece is closed");
}

/* Its two radii point away from each other, and are sewn as they should be. */
static void test_seam__a_half_disc_laid_flat_is_sewn_into_a_cone(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    for (uint32_t v = 0; v < VERTICES; v++) { /* rings of 4 points: v = 4 ring + spoke */
        double radius = 0.1 * (v / 4 + 1), angle = M_PI * (v % 4) / 3;
        memcpy(s.pattern + 2 * v, (double[2]){radius * cos(angle), radius * sin(angle)}, 2 * sizeof(double));
        memcpy(s.positions + 3 * v, (double[3]){radius * cos(angle), radius * sin(angle), 0},
               3 * sizeof(double));
    }
    s.desc.triangles = 0;
    for (uint32_t a = 0; a + 7 < 2 * STRIP && s.desc.triangles + 2 <= TRIANGLES; a += a % 4 == 2 ? 2 : 1) {
        memcpy(s.triangle + 3 * s.desc.triangles, (uint32_t[6]){a, a + 4, a + 5, a, a + 5, a + 1},
               6 * sizeof a);
        s.desc.triangles += 2;
    }
    s.desc.seams = 5; /* 24 triangles: 4 rows of cells */
    for (uint32_t j = 0; j < 5; j++) {
        s.seam[2 * j] = 4 * j;
        s.seam[2 * j + 1] = 4 * j + 3;
    }
    find(&s);
    assert_int_equal(s.warnings, 0);
}

static void test_seam__triangles_wound_against_each_other_are_named(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    turn_inside_out(&s, 5, 1);
    find(&s);
    assert_int_equal(s.warnings, 1);
    expect(&s, 0, DRAPE_AT_TRIANGLE, 5, "its neighbour, triangle 4");
    assert_non_null(strstr(s.warning[0].message, "2 such edges"));
}

static void test_seam__a_corner_ends_a_seam(void **state)
{
    (void)state;
    struct strips s;
    make(&s);
    cross(&s);
    for (uint32_t j = 4; j < ROW; j++) /* the patterns of both turn by a right angle at the fifth pair */
        for (uint32_t side = 0; side < 4; side++) {
            size_t v = 2 * j + side % 2 + (side < 2 ? 0 : STRIP);
            s.pattern[2 * v] += 0.1 * (j - 3.0);
            s.pattern[2 * v + 1] =
                s.pattern[2 * (size_t)(v % 2 + 6 + (side < 2 ? 0 : STRIP)) + 1] + 1e-3 * (double)(j - 3);
        }
    find(&s);
    assert_true(s.warnings >= 2);
    expect(&s, 0, DRAPE_AT_SEAM, 0, "to seam 3");
}

static void test_seam__only_so_many_warnings_are_written(void **state)
{
    (void)state;
    enum { PATCHES = DRAPE_MAX_WARNINGS + 4 };
    double *positions = calloc(PATCHES * 3 * 8, sizeof *positions);
    double *pattern = calloc(PATCHES * 2 * 8, sizeof *pattern);
    uint32_t *triangle = calloc(PATCHES * 12, sizeof *triangle), *seam = calloc(PATCHES * 4, sizeof *seam);
    uint32_t pin[PATCHES];
    assert_true(positions && pattern && triangle && seam);
    for (uint32_t p = 0; p < PATCHES; p++) { /* two squares each, sewn crosswise */
        for (uint32_t v = 0; v < 8; v++) {
            double u = v % 2 + 2.0 * (v / 4), w = v / 2 % 2;
            memcpy(positions + 3 * (8 * p + v), (double[3]){u, w, p}, 3 * sizeof u);
            memcpy(pattern + 2 * (8 * p + v), (double[2]){u, w}, 2 * sizeof u);
        }
        uint32_t a = 8 * p;
        memcpy(triangle + 12 * p, (uint32_t[]){a, a + 1, a + 2, a + 1, a + 3, a + 2}, 6 * sizeof a);
        memcpy(triangle + 12 * p + 6, (uint32_t[]){a + 4, a + 5, a + 6, a + 5, a + 7, a + 6}, 6 * sizeof a);
        memcpy(seam + 4 * p, (uint32_t[]){a + 1, a + 6, a + 3, a + 4}, 4 * sizeof a);
        pin[p] = a;
    }
    struct strips s;
    make(&s);
    s.desc.vertices = PATCHES * 8;
    s.desc.triangles = PATCHES * 4;
    s.desc.seams = PATCHES * 2;
    s.desc.pins = PATCHES;
    s.desc.positions = positions;
    s.desc.pattern = pattern;
    s.desc.triangle = triangle;
    s.desc.seam = seam;
    s.desc.pin = pin;
    find(&s);
    assert_int_equal(s.warnings, PATCHES);
    expect(&s, DRAPE_MAX_WARNINGS - 1, DRAPE_AT_SEAM, 2 * (DRAPE_MAX_WARNINGS - 1), "crossed");
    free(positions);
    free(pattern);
    free(triangle);
    free(seam);
}

static void test_seam__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct strips s;
    make(&s);
    long before = held;
    int failed = 0;
    for (long n = 0;; n++) {
        drape_error error = {0};
        countdown = n;
        drape_status status = drape_scene_warnings(&s.desc, s.warning, &s.warnings, &error);
        if (countdown >= 0)
            break;
        assert_int_equal(status, error.status); /* qsort asks for memory, too, and can do without */
        assert_true(status == DRAPE_OK || status == DRAPE_ENOMEM);
        assert_int_equal(held, before);
        failed += status == DRAPE_ENOMEM;
    }
    countdown = -1;
    assert_int_equal(failed, 6);
#else
    print_message("SKIP: allocations cannot be made to fail in this flavour\n");
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_seam__a_good_seam_is_not_warned_of),
        cmocka_unit_test(test_seam__crossed_directions_are_named_by_their_first_and_last_pair),
        cmocka_unit_test(test_seam__pairs_in_any_order_are_told_of),
        cmocka_unit_test(test_seam__a_piece_wound_inside_out_is_told_from_a_crossed_seam),
        cmocka_unit_test(test_seam__a_twisted_ring_is_told_of),
        cmocka_unit_test(test_seam__a_half_disc_laid_flat_is_sewn_into_a_cone),
        cmocka_unit_test(test_seam__triangles_wound_against_each_other_are_named),
        cmocka_unit_test(test_seam__a_corner_ends_a_seam),
        cmocka_unit_test(test_seam__only_so_many_warnings_are_written),
        cmocka_unit_test(test_seam__every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
