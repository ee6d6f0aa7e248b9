/* nearest.h - the nearest point of a triangle mesh, by a tree of boxes that follows the mesh as it moves.
 *
 * A distance field (field.h) is smooth, but takes a second to build; this one follows in milliseconds and
 * takes about a microsecond a question, but its gradient jumps where the nearest point does. It serves what
 * moves. Immutable between two calls of dr_nearest_move; then shareable by threads. */
#ifndef DR_NEAREST_H
#define DR_NEAREST_H

#include "drape.h"

struct dr_nearest;

/* A point of the surface: where in which triangle, and how far it is from the point that asked. */
struct dr_place {
    uint32_t triangle;
    double weight[3]; /* barycentric; those of corners not needed are exactly 0 */
    double square;    /* m^2 */
};

/* `positions` (3*vertices) and `triangle` (3*triangles, at least one) are borrowed and must outlive it. */
drape_status dr_nearest_new(const double *positions, size_t vertices, const uint32_t *triangle,
                            size_t triangles, struct dr_nearest **ret, drape_error *reterr);
struct dr_nearest *dr_nearest_free(struct dr_nearest *nearest); /* NULL is fine; returns NULL */
size_t dr_nearest_bytes(const struct dr_nearest *nearest);

/* The borrowed positions have changed. */
void dr_nearest_move(struct dr_nearest *nearest);

/* The point of the mesh nearest to p, of equals that of one fixed triangle. False when none is nearer than
 * `most` (m; INFINITY: as far as it may be). */
bool dr_nearest_find(const struct dr_nearest *nearest, const double p[3], double most, struct dr_place *ret);

/* Signed distance to the closed mesh and its gradient, a unit vector; false beyond `most`. The sign is that
 * of the angle-weighted pseudonormal at the nearest point (Baerentzen and Aanaes, IEEE TVCG 11, 2005), exact
 * unless the mesh crosses itself there. */
bool dr_nearest_distance(const struct dr_nearest *nearest, const double p[3], double most, double *ret_phi,
                         double ret_grad[3]);

#endif
