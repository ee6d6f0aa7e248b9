/* carry.h - cloth goes where the body under it goes.
 *
 * The triangle of the body that is nearest to a cloth vertex moves, near enough, as a rigid body: its
 * corners' frame turns and shifts, and takes the vertex along at the same place in that frame. These motions,
 * one for each cloth vertex, are then smoothed over the cloth as dual quaternions (Kavan et al., "Geometric
 * skinning with approximate dual quaternion blending", ACM TOG 27, 2008), so that neighbours which follow
 * different limbs are not torn apart: over about a centimetre beside the body, and over half the distance to
 * it farther out. A mean of equal motions is that motion, so a body that moves rigidly carries the cloth
 * rigidly. */
#ifndef DR_CARRY_H
#define DR_CARRY_H

#include "nearest.h"

/* A rigid motion x -> R (x - c) + c + t as a dual quaternion about some c: real part r (w, x, y, z), dual
 * part t r / 2. */
struct dr_motor {
    double real[4], dual[4];
};

/* The motion, about `centre`, of what is fixed to one triangle of a body while its corners go from where they
 * are in `from` to where they are in `to` (both 3*vertices): it takes the point at `place` along and turns
 * with the triangle (as its polar decomposition does; not at all where it has no area). Exactly the identity
 * where the corners stay. */
struct dr_motor dr_motor_at(const struct dr_place *place, const uint32_t *triangle, const double *from,
                            const double *to, const double centre[3]);

/* Moves a point, or turns a direction. The motor need not have unit length. */
void dr_motor_move(const struct dr_motor *motor, const double centre[3], double x[3]);
void dr_motor_turn(const struct dr_motor *motor, double v[3]);

/* Smooths the motors of `points` (3*points positions x, `distance` m from the body each) over the edges of
 * `triangle` (3*triangles points); a point of no triangle keeps its own. `scratch`: DR_CARRY_SCRATCH*points.
 */
#define DR_CARRY_SCRATCH (2 * sizeof(struct dr_motor) / sizeof(double) + 2)
void dr_carry_smooth(const double *x, size_t points, const uint32_t *triangle, size_t triangles,
                     const double *distance, double *scratch, struct dr_motor *motor);

#endif
