/* bend.h - thin-plate bending on positions alone: the Morley-type element "SM8".
 *
 * Curvature of triangle t: K_t = sum_j C_tj x_j, a 3x3 (rows k_uu, k_vv, 2k_uv; columns x y z),
 * E = 1/2 sum_t K_t : A_t D_t K_t. C depends on rest data only, so the Hessian Q (x) I3 is constant.
 * Immutable once made; shareable by threads. */
#ifndef DR_BEND_H
#define DR_BEND_H

#include "mesh.h"

struct dr_bend {
    size_t triangles;
    uint32_t *start; /* triangles+1: entries of triangle t are start[t] .. start[t+1]-1 */
    uint32_t *node;  /* start[triangles]: their nodes; none twice within a triangle */
    double *c;       /* 3 per entry: coefficients of k_uu, k_vv, 2k_uv, 1/m^2 */
    double *d;       /* 6 per triangle: area times rigidity, lower triangle (11,21,22,31,32,33), N m^3 */
};

/* `rigidity`: 3 per material (weft, warp, twist), N m, each >= 0. Triangles without entries, that is
 * without energy: those without rigidity (all zero), those whose corners are all held, those with
 * three free edges. An edge beside cloth without rigidity is free (held or not, such cloth passes no
 * moment); one beside any other held triangle is clamped to that triangle's slope. Seams need nothing:
 * each triangle has its own frame. Fails with DRAPE_ENOMEM only. About 5 us per triangle. */
drape_status dr_bend_new(const struct dr_mesh *mesh, const double *rigidity, struct dr_bend **ret,
                         drape_error *reterr);
struct dr_bend *dr_bend_free(struct dr_bend *bend); /* NULL is fine; returns NULL */
size_t dr_bend_bytes(const struct dr_bend *bend);

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. Summed from curvatures, which are
 * formed from differences of positions: no cancellation however far from the origin. */
double dr_bend_energy(const struct dr_bend *bend, const double *x, double *g);

/* The scalar stiffness Q, symmetric, all nodes: its lower triangle in compressed columns, diagonal
 * first, rows ascending. The caller frees both arrays' owner with dr_bend_stiffness_free. */
struct dr_bend_stiffness {
    size_t nodes;
    size_t *start; /* nodes+1 */
    uint32_t *row; /* start[nodes] */
    double *value; /* start[nodes], N/m */
};
drape_status dr_bend_stiffness_new(const struct dr_bend *bend, size_t nodes, struct dr_bend_stiffness **ret,
                                   drape_error *reterr);

/* Hinges in the element's place, to precondition with: an edge between two triangles takes their four nodes
 * alone, and there are a third to two thirds of the entries of Q, all in places of Q but for some of held
 * nodes. With the rigidity k across the edge of length l and the jump J of slope there an edge has the energy
 * DR_HINGE_WEIGHT k l/H J^2, H the sum of both heights: 1 would do for the mean over all quadratics, and a
 * little more is safer. `mesh` is that of `bend`. */
#define DR_HINGE_WEIGHT 1.5
drape_status dr_bend_hinges_new(const struct dr_bend *bend, const struct dr_mesh *mesh,
                                struct dr_bend_stiffness **ret, drape_error *reterr);

/* q -= hinges, whose entries all have places in q but for those of held nodes. */
void dr_bend_stiffness_subtract(struct dr_bend_stiffness *q, const struct dr_bend_stiffness *hinges);

/* to += (Q (x) I3) from; 3*nodes each. */
void dr_bend_stiffness_multiply(const struct dr_bend_stiffness *q, const double *from, double *to);

struct dr_bend_stiffness *dr_bend_stiffness_free(struct dr_bend_stiffness *q);
size_t dr_bend_stiffness_bytes(const struct dr_bend_stiffness *q);

#endif
