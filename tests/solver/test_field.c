/* test_field.c - making and reading a field with what this processor has, and without. Distances:
 * test_body.c. */
#include "test.h"

#include "shapes.h"

#include "field.c"
#include "field_build.c"

static void test_field__every_processor_reads_the_same_bytes(void **state)
{
    (void)state;
#ifdef __x86_64__
    if (!__builtin_cpu_supports("avx2"))
        skip();
    struct shape ball = shape_sphere((double[]){0, 0, 0}, 0.05, 12);
    struct dr_field *field = NULL;
    uint64_t random = 3;
    size_t within = 0;
    assert_int_equal(
        dr_field_new(ball.x, ball.vertices, ball.triangle, ball.triangles, 0.06, 0, NULL, &field, NULL),
        DRAPE_OK);
    for (int i = 0; i < 20000; i++) {
        double x[3], phi[2] = {7, 7}, grad[2][3] = {{7, 7, 7}, {7, 7, 7}};
        for (int d = 0; d < 3; d++)
            x[d] = (i % 2 ? 0.06 : 0.2) * test_random(&random);
        bool fast = interpolate_fast(field, x, &phi[0], grad[0]);
        assert_int_equal(interpolate_in(field, x, &phi[1], grad[1]), fast);
        assert_memory_equal(&phi[0], &phi[1], sizeof phi[0]);
        assert_memory_equal(grad[0], grad[1], sizeof grad[0]);
        within += fast;
    }
    assert_in_range(within, 10000, 19000);
    dr_field_unref(field);
    shape_free(&ball);
#else
    skip();
#endif
}

/* Of a body that is longest along any of the axes. */
static void test_field__a_lent_processor_changes_nothing(void **state)
{
    (void)state;
    drape_processors *processors = drape_processors_new(2);
    assert_non_null(processors);
    for (int axis = 0; axis < 3; axis++) {
        struct shape ball = shape_sphere((double[]){0, 0, 0}, 0.05, 12);
        drape_field *field[2] = {NULL, NULL};
        drape_body body = {.kind = DRAPE_BODY_MESH,
                           .positions = ball.x,
                           .triangle = ball.triangle,
                           .vertices = ball.vertices,
                           .triangles = ball.triangles};
        for (size_t v = 0; v < ball.vertices; v++)
            ball.x[3 * v + (size_t)axis] *= 2;
        for (int lent = 0; lent < 2; lent++)
            assert_int_equal(drape_field_new(&body, 0, lent ? processors : NULL, &field[lent], NULL),
                             DRAPE_OK);
        assert_int_equal(field[0]->blocks, field[1]->blocks);
        assert_memory_equal(field[0]->value, field[1]->value,
                            field[0]->blocks * DR_BLOCK_NODES * sizeof *field[0]->value);
        for (int lent = 0; lent < 2; lent++)
            drape_field_unref(field[lent]);
        shape_free(&ball);
    }
    drape_processors_free(processors);
}

/* A triangle of a few units; every fourth is a needle, an edge or a point. */
static void make_facet(struct facet *f, int number, uint64_t *random)
{
    double corner[3][3];
    for (int c = 0; c < 3; c++)
        for (int d = 0; d < 3; d++)
            corner[c][d] = 20 + 3 * test_random(random);
    if (number % 4 == 0)
        for (int d = 0; d < 3; d++)
            corner[2][d] = (corner[0][d] + corner[1][d]) / 2 + (number % 8 ? 0 : 1e-9 * test_random(random));
    if (number % 16 == 4)
        memcpy(corner[1], corner[0], sizeof corner[1]);
    if (number % 32 == 20)
        memcpy(corner[2], corner[0], sizeof corner[2]);
    facet_init(f, corner[0], corner[1], corner[2]);
}

static void test_field__a_row_takes_what_each_of_its_nodes_would(void **state)
{
    (void)state;
    uint64_t random = 5;
    size_t taken = 0, left = 0;
    for (int n = 0; n < 40000; n++) {
        struct facet facet;
        struct row row = {.first = 18, .from = 18, .to = 22, .j = 16 + (uint32_t)n % 9, .k = 15};
        float value[LANES], expected[LANES], plain[LANES];
        uint32_t nearest[LANES], expected_nearest[LANES], plain_nearest[LANES];
        make_facet(&facet, n, &random);
        row.from += (uint32_t)n / 9 % 3;
        row.to -= (uint32_t)n / 27 % 2;
        for (uint32_t i = 0; i < LANES; i++) {
            double p[3] = {row.first + i, row.j, row.k}, square = facet_square(&facet, p);
            /* at what it has, a round-off to either side, or anywhere */
            value[i] = n % 3 ? (float)(square * (1 + 0.2 * test_random(&random))) : (float)square;
            value[i] = n % 7 ? value[i] : nextafterf((float)square, n % 2 ? FLT_MAX : 0);
            value[i] = n % 11 ? value[i] : FLT_MAX;
            nearest[i] = 77;
            bool nearer = row.first + i >= row.from && row.first + i < row.to && (float)square < value[i];
            expected[i] = nearer ? (float)square : value[i];
            expected_nearest[i] = nearer ? (uint32_t)n : 77;
            taken += nearer;
            left += !nearer;
        }
        memcpy(plain, value, sizeof plain);
        memcpy(plain_nearest, nearest, sizeof plain_nearest);
        offer_row_in(&facet, (uint32_t)n, &row, plain, plain_nearest);
        offer_row(&facet, (uint32_t)n, &row, value, nearest);
        assert_memory_equal(plain, expected, sizeof plain);
        assert_memory_equal(plain_nearest, expected_nearest, sizeof plain_nearest);
        assert_memory_equal(value, expected, sizeof value);
        assert_memory_equal(nearest, expected_nearest, sizeof nearest);
    }
    assert_in_range(taken, 20000, 140000);
    assert_in_range(left, 20000, 140000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_field__a_lent_processor_changes_nothing),
        cmocka_unit_test(test_field__every_processor_reads_the_same_bytes),
        cmocka_unit_test(test_field__a_row_takes_what_each_of_its_nodes_would),
    };
    return cmocka_run_group_tests_name("field", tests, NULL, NULL);
}
