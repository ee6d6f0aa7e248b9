/* test_field.c - reading a field with what this processor has, and without. Distances: test_body.c. */
#include "test.h"

#include "shapes.h"

#include "field.c"

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
        dr_field_new(ball.x, ball.vertices, ball.triangle, ball.triangles, 0.06, 0, &field, NULL), DRAPE_OK);
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

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_field__every_processor_reads_the_same_bytes)};
    return cmocka_run_group_tests_name("field", tests, NULL, NULL);
}
