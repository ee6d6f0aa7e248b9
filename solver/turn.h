/* turn.h - how the cloth about each node has turned from one state to another.
 *
 * A factor of the step matrix at x0 serves at x1 once it is turned with the cloth: with R the block-diagonal
 * of the nodes' rotations, R A(x0)^-1 R' is nearly A(x1)^-1. What a triangle that turned resists most,
 * stretch, points partly along what was its normal before, where A(x0) is as soft as bending: not turned, the
 * factor answers with moves thousands of times too long. (Stiffness warping: Mueller and Gross, "Interactive
 * virtual materials", Graphics Interface 2004; of factors: Hecht, Lee, Shewchuk and O'Brien, "Updated sparse
 * Cholesky factors for corotational elastodynamics", ACM Trans. Graph. 31, 2012.) */
#ifndef DR_TURN_H
#define DR_TURN_H

#include "mesh.h"

/* Rodrigues vectors (3*nodes): tan(angle/2) times the axis, the mean over a node's triangles, by rest area,
 * of the rotation that takes their first side and normal from x0 to x1 (3*nodes each). A triangle that turned
 * by 120 degrees or more, or has no area, counts as not turned. `weight` is scratch (nodes). */
void dr_turn_take(const struct dr_mesh *mesh, const double *x0, const double *x1, double *weight,
                  double *turn);

/* to = R from, or with `back` R' from; 3*nodes each, which may be the same. */
void dr_turn_apply(size_t nodes, const double *turn, bool back, const double *from, double *to);

#endif
