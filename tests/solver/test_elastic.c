/* test_elastic.c - bars of their own rest length: derivatives, what is left out, what a tape pulls with. */
#include "test.h"

#include "dense.h"
#include "elastic.h"

enum { NODES = 4, BARS = 4 };

static const uint32_t link[2 * (BARS + 1)] = {3, 3, 0, 1, 1, 2, 3, 2, 1, 0}; /* the first is not ours */
static const double positions[3 * NODES] = {0,     0,     0,     0.02, 0.004, -0.003,
                                            0.035, 0.015, 0.007, 0.05, -0.01, 0.012};

struct tape {
    struct dr_bar bar[BARS];
    struct dr_elastic *elastic;
};

/* Two taut bars, one slack, one hardly. */
static void make(struct tape *tape)
{
    static const double factor[BARS] = {0.6, 0.9, 1.7, 1.01};
    for (size_t i = 0; i < BARS; i++) {
        const uint32_t *node = link + 2 * (i + 1);
        double square = 0;
        for (size_t d = 0; d < 3; d++)
            square += pow(positions[3 * node[1] + d] - positions[3 * node[0] + d], 2);
        tape->bar[i] = (struct dr_bar){{node[0], node[1]}, factor[i] * sqrt(square), 20 + (double)i};
    }
    assert_int_equal(dr_elastic_new(tape->bar, BARS, 1, true, &tape->elastic, NULL), DRAPE_OK);
}

static double energy(const void *term, const double *x, double *g)
{
    return dr_elastic_energy(term, x, g);
}

static void hessian(const void *term, const double *x, double exact, struct dr_matrix *A)
{
    dr_elastic_hessian(term, x, exact, A);
}

static void test_elastic__forces_and_true_hessian_are_the_differences(void **state)
{
    (void)state;
    struct tape tape;
    make(&tape);
    dr_elastic_tension(tape.elastic, positions, NULL);
    dense_check_derivatives(energy, hessian, tape.elastic, link, positions, NODES, 1e-8, 1e-6);
    dr_elastic_free(tape.elastic);
}

static void test_elastic__without_compression_the_hessian_is_semidefinite(void **state)
{
    (void)state;
    struct tape tape;
    struct dr_matrix semi = {.link = link}, whole = {.link = link};
    double p[3 * NODES], q[3 * NODES] = {0};
    uint64_t seed = 5;
    make(&tape);
    dr_elastic_tension(tape.elastic, positions, NULL);
    dr_elastic_hessian(tape.elastic, positions, 0, &semi);
    dr_elastic_hessian(tape.elastic, positions, 1, &whole);
    dense_check_semidefinite(&semi, NODES);
    for (size_t i = 0; i < 3 * NODES; i++)
        p[i] = test_random(&seed);
    dr_elastic_left_out(tape.elastic, positions, p, q);
    double largest = 0;
    for (size_t i = 0; i < 3 * NODES; i++)
        largest = fmax(largest, fabs(q[i]));
    assert_true(largest > 10); /* N/m */
    for (size_t i = 0; i < 3 * NODES; i++) {
        double expected = 0;
        for (size_t j = 0; j < 3 * NODES; j++)
            expected += (whole.a[i][j] - semi.a[i][j]) * p[j];
        assert_near(q[i], expected, 1e-12, largest);
    }
    dr_elastic_free(tape.elastic);
}

/* A tape of 0.6 laid flat is longer by two thirds of what it was: it pulls with two thirds of its stiffness.
 */
static void test_elastic__pulls_in_proportion_to_its_elongation(void **state)
{
    (void)state;
    static const double factor[] = {0.1, 0.5, 0.6, 1, 2};
    for (size_t k = 0; k < sizeof factor / sizeof *factor; k++) {
        const struct dr_bar bar = {{0, 1}, 0.03 * factor[k], 25};
        const double x[6] = {0.03, 0, 0, 0, 0, 0};
        double g[6] = {0}, elongation = 1 / factor[k] - 1;
        struct dr_elastic *elastic;
        assert_int_equal(dr_elastic_new(&bar, 1, 0, false, &elastic, NULL), DRAPE_OK);
        assert_close(dr_elastic_energy(elastic, x, g), 0.5 * 25 * bar.rest * elongation * elongation, 1e-13);
        assert_near(g[0], 25 * elongation, 1e-13, 1);
        assert_near(g[3], -25 * elongation, 1e-13, 1);
        dr_elastic_free(elastic);
    }
}

static void test_elastic__does_not_see_rigid_motions(void **state)
{
    (void)state;
    struct tape tape;
    double moved[3 * NODES];
    make(&tape);
    dense_move_rigidly(positions, NODES, moved);
    assert_close(dr_elastic_energy(tape.elastic, moved, NULL),
                 dr_elastic_energy(tape.elastic, positions, NULL), 1e-12);
    dr_elastic_free(tape.elastic);
}

/* Of a step across a bar the tension predicted is that of the start, and the error of second order is the
 * energy that it has too much, but for higher orders. */
static void test_elastic__knows_what_a_linear_step_gets_wrong(void **state)
{
    (void)state;
    const struct dr_bar bar = {{0, 1}, 0.03, 25};
    const uint32_t own[] = {0, 1};
    const double x[6] = {0, 0, 0, 0.03, 0, 0}, across[6] = {0, 0, 0, 0, 1e-3, 0};
    double there[6];
    struct dr_elastic *elastic;
    struct dr_matrix A = {.link = own};
    assert_int_equal(dr_elastic_new(&bar, 1, 0, true, &elastic, NULL), DRAPE_OK);
    dr_elastic_tension(elastic, x, across);
    dr_elastic_hessian(elastic, x, 1, &A);
    assert_near(A.a[4][4], 0, 1e-12, A.a[3][3]); /* no tension: free to turn */
    for (int i = 0; i < 6; i++)
        there[i] = x[i] + across[i];
    assert_close(dr_elastic_second_order(elastic, x, across), dr_elastic_energy(elastic, there, NULL), 1e-3);
    assert_true(dr_elastic_second_order(elastic, x, x) == 0); /* along the bar nothing is wrong */
    dr_elastic_free(elastic);
}

/* Its ends in one place: finite, and still stiff in no direction it could know. */
static void test_elastic__a_bar_of_no_length_stays_finite(void **state)
{
    (void)state;
    const struct dr_bar bar = {{0, 1}, 0.03, 25};
    const uint32_t own[] = {0, 1};
    const double x[6] = {0.1, 0.1, 0.1, 0.1, 0.1, 0.1};
    double g[6] = {0};
    struct dr_elastic *elastic;
    struct dr_matrix A = {.link = own};
    assert_int_equal(dr_elastic_new(&bar, 1, 0, true, &elastic, NULL), DRAPE_OK);
    assert_close(dr_elastic_energy(elastic, x, g), 0.5 * 25 * 0.03, 1e-13);
    dr_elastic_tension(elastic, x, NULL);
    dr_elastic_hessian(elastic, x, 1, &A);
    for (int i = 0; i < 6; i++)
        assert_true(g[i] == 0 && isfinite(A.a[i][i]));
    dr_elastic_free(elastic);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_elastic__forces_and_true_hessian_are_the_differences),
        cmocka_unit_test(test_elastic__without_compression_the_hessian_is_semidefinite),
        cmocka_unit_test(test_elastic__pulls_in_proportion_to_its_elongation),
        cmocka_unit_test(test_elastic__does_not_see_rigid_motions),
        cmocka_unit_test(test_elastic__knows_what_a_linear_step_gets_wrong),
        cmocka_unit_test(test_elastic__a_bar_of_no_length_stays_finite),
    };
    return cmocka_run_group_tests_name("elastic", tests, NULL, NULL);
}
