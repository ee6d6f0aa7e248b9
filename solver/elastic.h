/* elastic.h - elastics: a bar along each of some edges of the mesh, of its own rest length.
 *
 * At length l a bar of rest length R and stiffness k (N) has the energy k R/2 (l/R - 1)^2 and pulls with
 * T = k (l/R - 1): linear in elongation, as a tape on a tensile tester is. (On Green strain, as the cloth, a
 * tape of factor 0.7 would pull 1.7 times as hard when laid flat, one of 0.5 three times.) With d the unit
 * vector along it, its Hessian with respect to the difference of its ends is
 *
 *     k/R d d' + T/l (I - d d'),
 *
 * positive semi-definite without the second part where T < 0. As the membrane's, that part is built from the
 * tension that the last linear step predicted. Belongs to one thread. */
#ifndef DR_ELASTIC_H
#define DR_ELASTIC_H

#include "matrix.h"

struct dr_bar {
    uint32_t node[2];
    double rest;      /* m, > 0 */
    double stiffness; /* N, > 0 */
};

struct dr_elastic;

/* `bar` must outlive it. Bar i is link `first_link` + i of the matrix that the Hessian goes to; without one
 * no tension is kept. */
drape_status dr_elastic_new(const struct dr_bar *bar, size_t bars, size_t first_link, bool matrix,
                            struct dr_elastic **ret, drape_error *reterr);
struct dr_elastic *dr_elastic_free(struct dr_elastic *elastic); /* NULL is fine; returns NULL */
size_t dr_elastic_bytes(const struct dr_elastic *elastic);      /* without the bars */

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. */
double dr_elastic_energy(const struct dr_elastic *elastic, const double *x, double *g);

/* Keeps the tension at x, or with w (3*nodes, else NULL) what the linear step w predicts, for the next two.
 */
void dr_elastic_tension(struct dr_elastic *elastic, const double *x, const double *w);

/* Adds the Hessian at x to A, of compressive tension `compression` times. 0: positive semi-definite; 1, with
 * the tension at x: the true Hessian. */
void dr_elastic_hessian(const struct dr_elastic *elastic, const double *x, double compression,
                        struct dr_matrix *A);

/* q += (H(1) - H(0)) p; p and q are 3*nodes. */
void dr_elastic_left_out(const struct dr_elastic *elastic, const double *x, const double *p, double *q);

/* The energy (J) of the second-order elongation of a linear step w from x. */
double dr_elastic_second_order(const struct dr_elastic *elastic, const double *x, const double *w);

#endif
