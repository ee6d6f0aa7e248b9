/* test_lines.c - lengths of lines on bent, stretched and sewn cloth against closed forms. */
#include "test.h"

#include "lines.h"

enum { SIDE = 9, CELLS = SIDE - 1, POINTS = SIDE * SIDE, TRIANGLES = 2 * CELLS * CELLS };

static const double PI = 3.14159265358979323846;

/* A square of side 1, u = column, v = row; `copies` of them, the pattern of each at its own place. */
struct cloth {
    double pattern[2 * 2 * POINTS], positions[2 * 3 * POINTS];
    uint32_t triangle[2 * 3 * TRIANGLES], seam[2 * SIDE];
    drape_scene_desc scene;
};

static uint32_t at(uint32_t row, uint32_t column)
{
    return row * SIDE + column;
}

static void make(struct cloth *cloth, size_t copies)
{
    memset(cloth, 0, sizeof *cloth);
    uint32_t *t = cloth->triangle;
    for (size_t i = 0; i < copies * POINTS; i++) {
        double *p = cloth->pattern + 2 * i;
        p[0] = (double)(i % POINTS % SIDE) / CELLS + (i >= POINTS ? 0.3 : 0); /* the copies overlap */
        p[1] = (double)(i % POINTS / SIDE) / CELLS;
    }
    for (uint32_t c = 0; c < copies; c++)
        for (uint32_t i = 0; i < CELLS; i++)
            for (uint32_t j = 0; j < CELLS; j++) {
                uint32_t a = c * POINTS + at(i, j), b = a + SIDE;
                const uint32_t cell[6] = {a, a + 1, b + 1, a, b + 1, b};
                memcpy(t, cell, sizeof cell);
                t += 6;
            }
    cloth->scene = drape_scene_desc_default();
    cloth->scene.vertices = copies * POINTS;
    cloth->scene.triangles = copies * TRIANGLES;
    cloth->scene.pattern = cloth->pattern;
    cloth->scene.positions = cloth->positions;
    cloth->scene.triangle = cloth->triangle;
    cloth->scene.seam = cloth->seam;
}

/* `place` takes a pattern point to space. */
static void put(struct cloth *cloth, void (*place)(const double p[2], double x[3]))
{
    for (size_t i = 0; i < cloth->scene.vertices; i++)
        place(cloth->pattern + 2 * i, cloth->positions + 3 * i);
}

static struct lines *one_line(const uint32_t *vertex, size_t vertices, bool closed)
{
    struct lines *lines = lines_new(1);
    assert_non_null(lines);
    struct line *line = lines->line;
    line->vertex = malloc(vertices * sizeof *vertex);
    assert_non_null(line->vertex);
    memcpy(line->vertex, vertex, vertices * sizeof *vertex);
    line->vertices = vertices;
    line->closed = closed;
    return lines;
}

static struct line_length measure(const struct cloth *cloth, const uint32_t *vertex, size_t vertices,
                                  bool closed)
{
    struct lines *lines = one_line(vertex, vertices, closed);
    struct line_length length;
    size_t line, place;
    assert_int_equal(lines_join(lines, &cloth->scene, &line, &place), 0);
    assert_int_equal(lines_measure(lines, &cloth->scene, cloth->positions, &length), 0);
    lines_free(lines);
    return length;
}

static void flat(const double p[2], double x[3])
{
    x[0] = p[0], x[1] = 0.5, x[2] = p[1];
}

static void stretched(const double p[2], double x[3])
{
    x[0] = 1.1 * p[0], x[1] = 0, x[2] = 0.9 * p[1];
}

static void folded(const double p[2], double x[3]) /* by a right angle along the middle */
{
    x[0] = fmin(p[0], 0.5), x[1] = fmax(p[0] - 0.5, 0), x[2] = p[1];
}

static void rolled(const double p[2], double x[3]) /* once round */
{
    double angle = 2 * PI * p[0];
    x[0] = cos(angle) / (2 * PI), x[1] = sin(angle) / (2 * PI), x[2] = p[1];
}

static void test_lines__stretched_cloth_has_the_lengths_of_the_map(void **state)
{
    (void)state;
    struct cloth cloth;
    make(&cloth, 1);
    put(&cloth, stretched);
    const uint32_t weft[] = {at(3, 0), at(3, 8)}, warp[] = {at(0, 5), at(4, 5), at(8, 5)},
                   slant[] = {at(0, 0), at(3, 7)}, round[] = {0, 8, at(8, 8), at(8, 0)};
    struct line_length length = measure(&cloth, weft, 2, false);
    assert_close(length.rest, 1, 1e-15);
    assert_close(length.draped, 1.1, 1e-14);
    length = measure(&cloth, warp, 3, false);
    assert_close(length.draped, 0.9, 1e-14);
    length = measure(&cloth, slant, 2, false); /* through triangles, along no edge */
    assert_close(length.rest, hypot(7, 3) / 8, 1e-15);
    assert_close(length.draped, hypot(1.1 * 7, 0.9 * 3) / 8, 1e-14);
    length = measure(&cloth, round, 4, true);
    assert_close(length.rest, 4, 1e-15);
    assert_close(length.draped, 4, 1e-14); /* 2 (1.1 + 0.9) */
    length = measure(&cloth, round, 4, false);
    assert_close(length.rest, 3, 1e-15);
}

static void test_lines__lie_on_the_cloth_and_not_in_the_air(void **state)
{
    (void)state;
    struct cloth cloth;
    make(&cloth, 1);
    put(&cloth, folded);
    const uint32_t across[] = {at(2, 0), at(2, 8)}, slant[] = {at(0, 1), at(7, 8)};
    assert_close(measure(&cloth, across, 2, false).draped, 1, 1e-11);
    assert_close(measure(&cloth, slant, 2, false).draped, hypot(7, 7) / 8, 1e-11);
    put(&cloth, rolled); /* a chord of each of eight edges */
    assert_close(measure(&cloth, across, 2, false).draped, 8 * 2 * sin(PI / 8) / (2 * PI), 1e-11);
}

static void test_lines__go_round_a_garment_through_its_seams(void **state)
{
    (void)state;
    struct cloth cloth;
    make(&cloth, 2); /* the right of the first is sewn to the left of the second */
    put(&cloth, flat);
    for (uint32_t i = 0; i < SIDE; i++) {
        cloth.seam[2 * i] = at(i, 8);
        cloth.seam[2 * i + 1] = POINTS + at(i, 0);
    }
    for (size_t i = POINTS; i < 2 * POINTS; i++)
        cloth.positions[3 * i] = 1 + 2 * (cloth.pattern[2 * i] - 0.3); /* stretched to twice its width */
    cloth.scene.seams = SIDE;
    const uint32_t both[] = {at(4, 0), at(4, 8), POINTS + at(4, 0), POINTS + at(4, 8)},
                   one[] = {at(4, 0), at(4, 8), POINTS + at(4, 8)},
                   other[] = {at(4, 0), POINTS + at(4, 0), POINTS + at(4, 8)},
                   apart[] = {at(4, 0), at(4, 8), at(4, 7), POINTS + at(4, 1)};
    struct line_length length = measure(&cloth, both, 4, false);
    assert_close(length.rest, 2, 1e-14);
    assert_close(length.draped, 3, 1e-14);
    length = measure(&cloth, one, 3, false);
    assert_close(length.rest, 2, 1e-14);
    assert_close(length.draped, 3, 1e-14);
    length = measure(&cloth, other, 3, false);
    assert_close(length.rest, 2, 1e-14);
    assert_close(length.draped, 3, 1e-14);

    struct lines *lines = one_line(apart, 4, false);
    size_t line = 9, place = 9;
    assert_int_equal(lines_join(lines, &cloth.scene, &line, &place), LINES_APART);
    assert_int_equal(line, 0);
    assert_int_equal(place, 2);
    lines_free(lines);
    lines = one_line(one, 3, true); /* nor is the last sewn to the first */
    assert_int_equal(lines_join(lines, &cloth.scene, &line, &place), LINES_APART);
    assert_int_equal(place, 2);
    lines_free(lines);
}

static void test_lines__go_straight_on_where_there_is_no_cloth(void **state)
{
    (void)state;
    struct cloth cloth;
    make(&cloth, 1);
    put(&cloth, folded);
    size_t kept = 0; /* without the four columns about the fold, above row 1 */
    for (size_t t = 0; t < TRIANGLES; t++) {
        const uint32_t *corner = cloth.triangle + 3 * t;
        double u = 0, v = 0;
        for (int k = 0; k < 3; k++) {
            u += cloth.pattern[2 * corner[k]] / 3;
            v += cloth.pattern[2 * corner[k] + 1] / 3;
        }
        if (!(u > 0.25 && u < 0.75 && v > 0.125))
            memmove(cloth.triangle + 3 * kept++, corner, 3 * sizeof *corner);
    }
    cloth.scene.triangles = kept;
    const uint32_t across[] = {at(4, 0), at(4, 8)}, below[] = {at(1, 0), at(1, 8)};
    struct line_length length = measure(&cloth, across, 2, false);
    assert_close(length.rest, 1, 1e-15);
    assert_close(length.draped, 0.5 + hypot(0.25, 0.25), 1e-11);
    assert_close(measure(&cloth, below, 2, false).draped, 1, 1e-11);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines__stretched_cloth_has_the_lengths_of_the_map),
        cmocka_unit_test(test_lines__lie_on_the_cloth_and_not_in_the_air),
        cmocka_unit_test(test_lines__go_round_a_garment_through_its_seams),
        cmocka_unit_test(test_lines__go_straight_on_where_there_is_no_cloth),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
