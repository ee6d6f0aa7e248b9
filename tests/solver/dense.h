/* dense.h - a dense matrix in the place of the sparse one, and an energy's derivatives checked against it.
 *
 * Include it in one file of a test program that needs no other function of solver/matrix.h. */
#ifndef DRAPED_TEST_DENSE_H
#define DRAPED_TEST_DENSE_H

#include "matrix.h"
#include "test.h"

#define DENSE_NODES 8
#define DENSE       (3 * DENSE_NODES)

struct dr_matrix {
    double a[DENSE][DENSE];
    const uint32_t *link; /* pairs of nodes, as dr_matrix_new gets them */
};

void dr_matrix_add_node(struct dr_matrix *A, uint32_t node, const double H[6])
{
    static const int entry[3][3] = {{0, 1, 3}, {1, 2, 4}, {3, 4, 5}};
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3; j++)
            A->a[3 * node + i][3 * node + j] += H[entry[i][j]];
}

void dr_matrix_add_pair(struct dr_matrix *A, size_t link, const double H[9])
{
    size_t row = 3 * (size_t)A->link[2 * link], column = 3 * (size_t)A->link[2 * link + 1];
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3; j++) {
            A->a[row + i][column + j] += H[3 * i + j];
            A->a[column + j][row + i] += H[3 * i + j];
        }
}

typedef double dense_energy(const void *term, const double *x, double *g);
typedef void dense_hessian(const void *term, const double *x, double exact, struct dr_matrix *A);

/* The gradient is the energy's difference and the true Hessian the gradient's, both more than nothing. */
static inline void dense_check_derivatives(dense_energy *energy, dense_hessian *hessian, const void *term,
                                           const uint32_t *link, const double *at, size_t nodes, double step,
                                           double tolerance)
{
    double x[DENSE], g[DENSE] = {0}, largest = 0, stiffest = 0;
    struct dr_matrix exact = {.link = link};
    memcpy(x, at, 3 * nodes * sizeof *x);
    energy(term, x, g);
    hessian(term, x, 1, &exact);
    for (size_t i = 0; i < 3 * nodes; i++) {
        largest = fmax(largest, fabs(g[i]));
        stiffest = fmax(stiffest, fabs(exact.a[i][i]));
    }
    assert_true(largest > 0 && stiffest > 0);
    for (size_t i = 0; i < 3 * nodes; i++) {
        double above[DENSE] = {0}, below[DENSE] = {0}, kept = x[i];
        x[i] = kept + step;
        double high = energy(term, x, above);
        x[i] = kept - step;
        double low = energy(term, x, below);
        x[i] = kept;
        assert_near((high - low) / (2 * step), g[i], tolerance, largest);
        for (size_t j = 0; j < 3 * nodes; j++)
            assert_near((above[j] - below[j]) / (2 * step), exact.a[i][j], tolerance, stiffest);
    }
}

/* y'Ay is not negative for any of many y, and positive for some. */
static inline void dense_check_semidefinite(const struct dr_matrix *A, size_t nodes)
{
    uint64_t seed = 17;
    double highest = 0;
    for (int trial = 0; trial < 400; trial++) {
        double y[DENSE], quadratic = 0, size = 0;
        for (size_t i = 0; i < 3 * nodes; i++)
            y[i] = test_random(&seed);
        for (size_t i = 0; i < 3 * nodes; i++)
            for (size_t j = 0; j < 3 * nodes; j++) {
                quadratic += y[i] * A->a[i][j] * y[j];
                size += fabs(y[i] * A->a[i][j] * y[j]);
            }
        assert_true(quadratic >= -1e-13 * size);
        highest = fmax(highest, quadratic);
    }
    assert_true(highest > 0);
}

/* x turned about the origin and moved. */
static inline void dense_move_rigidly(const double *x, size_t nodes, double *ret)
{
    static const double R[3][3] = {{0.36, 0.48, -0.8}, {-0.8, 0.6, 0}, {0.48, 0.64, 0.6}};
    static const double far[3] = {1, -2, 3};
    for (size_t v = 0; v < nodes; v++)
        for (size_t d = 0; d < 3; d++)
            ret[3 * v + d] = R[d][0] * x[3 * v] + R[d][1] * x[3 * v + 1] + R[d][2] * x[3 * v + 2] + far[d];
}

#endif
