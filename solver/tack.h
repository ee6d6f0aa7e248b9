/* tack.h - stitches that hold cloth at points of bodies: springs of zero length, DRAPE_TACK_STIFFNESS each.
 *
 * Energy k/2 |x - a|^2 with a the point of the body; its Hessian k I is positive definite and exact. Belongs
 * to one thread: where a body moves, dr_tacks_move carries the points. */
#ifndef DR_TACK_H
#define DR_TACK_H

#include "body.h"
#include "matrix.h"

struct dr_tack { /* of a compiled scene */
    uint32_t vertex, node;
    uint32_t body;
    uint32_t triangle;     /* DRAPE_NO_TRIANGLE: a point that no motion carries */
    double barycentric[2]; /* weights of the triangle's first two corners */
    double first[3];       /* m, lifted: where it holds while the cloth is sewn, */
    double at[3];          /* and where when it is draped: elsewhere if the body has moved */
};

/* The point of a triangle of a mesh body, wherever its vertices (`positions`, packed xyz) are now. */
void dr_tack_point(const uint32_t *triangle, const double *positions, const double barycentric[2],
                   double ret[3]);

/* Moves a point that is nearer to the body's surface than its offset, or within DRAPE_REACH below, out to the
 * offset along the gradient of the distance; cloth that lies there feels no penalty. */
void dr_tack_lift(const struct dr_body *body, double point[3]);

struct dr_tacks;

/* By node, where they hold at the end; or with `by_vertex` for the pieces, whose nodes are the vertices,
 * where they hold at first. `tack` is copied from. */
drape_status dr_tacks_new(const struct dr_tack *tack, size_t tacks, bool by_vertex, struct dr_tacks **ret,
                          drape_error *reterr);
struct dr_tacks *dr_tacks_free(struct dr_tacks *tacks); /* NULL is fine; returns NULL */
size_t dr_tacks_bytes(const struct dr_tacks *tacks);

/* Tack i holds at `point` from here on: the potential is another one. */
void dr_tacks_move(struct dr_tacks *tacks, size_t i, const double point[3]);

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. */
double dr_tacks_energy(const struct dr_tacks *tacks, const double *x, double *g);

/* Adds the Hessian to A. */
void dr_tacks_hessian(const struct dr_tacks *tacks, struct dr_matrix *A);

#endif
