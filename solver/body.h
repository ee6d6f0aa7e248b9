/* body.h - a static obstacle as a signed distance: negative inside, smooth near the surface.
 *
 * Spheres, planes and capsules are exact (a capsule's curvature jumps where its caps begin; all else
 * is C2 near the surface). A mesh becomes a grid of distances read through a tricubic B-spline, see
 * field.h for what that resolves. Immutable once made; shareable by threads. */
#ifndef DR_BODY_H
#define DR_BODY_H

#include "nearest.h"

struct dr_body;

/* Distances above this are not resolved (m): dr_body_distance then returns false. Inside, the
 * distance is resolved everywhere. */
#define DR_BODY_REACH DRAPE_REACH

#define DR_BODY_MAX_OFFSET     0.02 /* m: well within reach */
#define DR_BODY_MAX_COORDINATE 1e6  /* m, radii too: keeps every square and volume finite and exact enough */
#define DR_BODY_MIN_TRIANGLES  4

/* What can be refused cheaply, in O(n log n): kinds, shapes, offsets, indices, numbers that are not
 * finite; and meshes that are not closed, not consistently oriented or inside out. A mesh may cross
 * itself, have several pieces and triangles without area. `number` is the body's index in the scene. */
drape_status dr_body_check(const drape_body *desc, int64_t number, drape_error *reterr);

/* The part of it that a mesh's arrays must pass; a body that brings its field along has passed it. */
drape_status dr_body_check_mesh(const drape_body *desc, int64_t number, drape_error *reterr);
/* Whether another posture (`vertices` of them, 3*vertices positions) of a mesh that passed dr_body_check is
 * one, too: as many vertices, finite, not inside out. `keyframe` is its number in the motion. */
drape_status dr_body_check_keyframe(const drape_body *desc, const double *positions, size_t vertices,
                                    int64_t keyframe, int64_t number, drape_error *reterr);

/* Checks, then builds. Meshes alone can fail after the check: DRAPE_EINVAL when too large for a
 * distance field (field.h has the limits), DRAPE_ENOMEM. */
drape_status dr_body_new(const drape_body *desc, int64_t number, struct dr_body **ret, drape_error *reterr);
struct dr_body *dr_body_free(struct dr_body *body); /* NULL is fine; returns NULL */

/* Signed distance and its gradient at x. Returns false, leaving both untouched, when x is farther
 * outside than DR_BODY_REACH or not finite. The gradient is the exact one of the distance returned,
 * about a unit vector, with two exceptions. Outside, half-way between two near surfaces of a mesh, it
 * falls smoothly to zero, as the balance of both should. Inside it is never zero: on the medial axis,
 * where it would be shorter than 0.01, a unit vector along which the distance grows replaces it. */
bool dr_body_distance(const struct dr_body *body, const double x[3], double *ret_phi, double ret_grad[3]);

/* Second derivatives at x of the distance that dr_body_distance returns, 1/m, as the lower triangle xx, yx,
 * yy, zx, zy, zz; zero where that is out of reach, at a centre, or on an axis. */
void dr_body_curvature(const struct dr_body *body, const double x[3], double ret[6]);

/* The least value of d.x over the body's points; -INFINITY for a plane unless d is its normal's
 * opposite. Serves the slid-off verdict (d = up). */
double dr_body_support_min(const struct dr_body *body, const double d[3]);

/* A mesh that moves, at its start. Its distance is that to the nearest triangle (nearest.h): exact, with a
 * gradient that jumps where the nearest point does, and within DR_BODY_REACH inside as well as outside; it
 * has no curvature. `desc` has passed dr_body_check; its triangles are borrowed, its positions copied. */
drape_status dr_body_new_moving(const drape_body *desc, struct dr_body **ret, drape_error *reterr);

/* Moves it to `positions` (3*vertices). */
void dr_body_move(struct dr_body *body, const double *positions);

/* How often it has been moved. */
size_t dr_body_moves(const struct dr_body *body);

/* The nearest point of a mesh that moves. */
void dr_body_nearest(const struct dr_body *body, const double x[3], struct dr_place *ret);

/* Where a mesh's vertices are now, 3*vertices. */
const double *dr_body_positions(const struct dr_body *body);

/* The field of a mesh that stands, the body's own reference; NULL of anything else. */
drape_field *dr_body_field(const struct dr_body *body);

double dr_body_offset(const struct dr_body *body);
double dr_body_friction(const struct dr_body *body);
size_t dr_body_bytes(const struct dr_body *body);

#endif
