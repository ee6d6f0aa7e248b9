/* fold.h - creases and pleats: hinges with a rest angle between the two triangles of an edge.
 *
 * The edge runs from x0 to x1 with the corner x2 of one triangle on its left, seen from where the triangle's
 * normal points, and x3 of the other on its right:
 *
 *                x2                  n_A = e x (x2 - x0),  n_B = (x3 - x0) x e,  e = x1 - x0,
 *               /  \
 *           x0 ------> x1            theta = atan2((n_A x n_B).e/|e|, n_A.n_B),
 *               \  /
 *                x3                  > 0 where the edge is a mountain seen from the normals' side.
 *
 * Energy: weight/2 (theta - rest)^2 (Grinspun, Hirani, Desbrun and Schroeder, "Discrete shells", SCA 2003,
 * with the weights of a crease: stiffness times length). Its Hessian is weight (g g' + (theta - rest) G), g
 * and G the first and second derivatives of theta; the first part alone is positive semi-definite. The
 * bending of bend.c is cut along the edge (scene.c). Immutable once made; shareable by threads. */
#ifndef DR_FOLD_H
#define DR_FOLD_H

#include "matrix.h"

struct dr_hinge {
    uint32_t node[4]; /* x0 x1 x2 x3, all different */
    double weight;    /* N m per rad: stiffness times length */
    double rest;      /* rad, -pi to pi */
};

#define DR_HINGE_LINKS 6 /* pairs of nodes: 10 20 21 30 31 32 */

struct dr_fold;

/* `hinge` must outlive it. The links of hinge i in the matrix that the Hessian goes to begin with
 * `first_link`
 * + DR_HINGE_LINKS i. */
drape_status dr_fold_new(const struct dr_hinge *hinge, size_t hinges, size_t first_link, struct dr_fold **ret,
                         drape_error *reterr);
struct dr_fold *dr_fold_free(struct dr_fold *fold); /* NULL is fine; returns NULL */
size_t dr_fold_bytes(const struct dr_fold *fold);   /* without the hinges */

/* The angle of a hinge at x (3*nodes), rad, within half a turn of half its rest angle. */
double dr_hinge_angle(const struct dr_hinge *hinge, const double *x);

/* The pairs of nodes of a hinge, in the order of its links. */
void dr_hinge_links(const struct dr_hinge *hinge, uint32_t link[2 * DR_HINGE_LINKS]);

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. */
double dr_fold_energy(const struct dr_fold *fold, const double *x, double *g);

/* Adds the Hessian at x to A, of the second derivatives of the angle `exact` times. 0: positive
 * semi-definite; 1: the true Hessian. */
void dr_fold_hessian(const struct dr_fold *fold, const double *x, double exact, struct dr_matrix *A);

/* q += (H(1) - H(0)) p; p and q are 3*nodes. */
void dr_fold_left_out(const struct dr_fold *fold, const double *x, const double *p, double *q);

#endif
