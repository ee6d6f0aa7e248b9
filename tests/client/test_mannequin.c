/* test_mannequin.c - the form must be a body that any solver may trust: closed, oriented, one piece. */
#include "check_surface.h"
#include "mannequin.h"

static double volume(const struct surface *s)
{
    double six = 0;
    for (size_t t = 0; t < s->triangles; t++) {
        const double *a = s->positions + 3 * s->triangle[3 * t],
                     *b = s->positions + 3 * s->triangle[3 * t + 1];
        const double *c = s->positions + 3 * s->triangle[3 * t + 2];
        six += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    return six / 6;
}

/* Pieces, by spreading the lowest vertex number of each over its edges. */
static size_t pieces(const struct surface *s)
{
    uint32_t *root = malloc(s->vertices * sizeof *root);
    size_t count = 0;
    assert_non_null(root);
    for (size_t i = 0; i < s->vertices; i++) {
        root[i] = (uint32_t)i;
    }
    for (bool changed = true; changed;) {
        changed = false;
        for (size_t i = 0; i < 3 * s->triangles; i++) {
            size_t next = i - i % 3 + (i + 1) % 3;
            uint32_t a = s->triangle[i], b = s->triangle[next], low = root[a] < root[b] ? root[a] : root[b];
            changed = changed || root[a] != low || root[b] != low;
            root[a] = root[b] = low;
        }
    }
    for (size_t i = 0; i < s->vertices; i++) {
        count += root[i] == i;
    }
    free(root);
    return count;
}

static void check_form(double spacing, size_t least, size_t most)
{
    struct surface s;
    size_t edges = 0;
    assert_int_equal(mannequin_build(spacing, &s), 0);
    struct edge_use *edge = surface_edges(&s, &edges);
    for (size_t i = 0; i < edges; i++) {
        assert_int_equal(edge[i].forward, 1);
        assert_int_equal(edge[i].backward, 1);
    }
    assert_int_equal((long)s.vertices - (long)edges + (long)s.triangles, 2); /* genus 0 */
    assert_int_equal(pieces(&s), 1);
    assert_in_range(s.triangles, least, most);
    assert_true(worst_quality(&s, false) > 0.3);
    /* a torso without arms and legs: some 35 litres */
    assert_near(volume(&s), 0.040, 0.35, 0);
    free(edge);
    surface_done(&s);
}

static void test_mannequin__is_closed_oriented_and_of_genus_0_at_every_spacing(void **state)
{
    (void)state;
    check_form(MANNEQUIN_SPACING, 5000, 10000);
    check_form(0.01, 15000, 30000);
    check_form(0.03, 1000, 4000);
}

static void test_mannequin__is_the_same_on_both_sides(void **state)
{
    struct surface s;
    double sum = 0, widest = 0;
    (void)state;
    assert_int_equal(mannequin_build(MANNEQUIN_SPACING, &s), 0);
    for (size_t i = 0; i < s.vertices; i++) {
        sum += s.positions[3 * i];
        widest = fmax(widest, fabs(s.positions[3 * i]));
        assert_true(s.positions[3 * i + 1] >= MANNEQUIN_BOTTOM - 1e-9 &&
                    s.positions[3 * i + 1] <= MANNEQUIN_TOP + 1e-9);
    }
    assert_near(sum, 0, 1e-9, (double)s.vertices);
    assert_near(widest, 0.19, 0.05, 0); /* the shoulders */
    surface_done(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mannequin__is_closed_oriented_and_of_genus_0_at_every_spacing),
        cmocka_unit_test(test_mannequin__is_the_same_on_both_sides),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
