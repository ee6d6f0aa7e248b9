/* ramp.h - from the drape of one pattern to a start for another.
 *
 * Per triangle, the old rest shape is the new one stretched by U (symmetric, along the new yarns; how the
 * pieces lie in the pattern does not matter). The rest shape goes from U to I in equal steps, each of
 * 6 % or less. In each the cloth first grows with its pattern: positions x' whose deformation of the
 * new rest shape is that of the old one at x, as nearly as they can be,
 *
 *     sum_t A_t |F'_t - F_t|^2 + sum_i k_i |x'_i - x_i|^2 -> min,
 *
 * k_i weak and proportional to what the bodies carry at node i, so that cloth grows away from where it hangs
 * (one linear solve with the step matrix's own pattern). Between steps it relaxes for a few iterations of the
 * run's method. Left to the drape alone, 5 % too much cloth everywhere buckles at the scale of the mesh, and
 * 40 % jams. */
#ifndef DR_RAMP_H
#define DR_RAMP_H

#include "state.h"

/* The stretch U of every triangle as u_uu, u_uv, u_vv (3*triangles; the caller frees *ret) and the largest
 * relative change of a length in *ret_change, from meshes of the same triangles. */
drape_status dr_ramp_measure(const struct dr_mesh *old_mesh, const struct dr_mesh *mesh, double **ret,
                             double *ret_change, drape_error *reterr);

/* How many steps a change takes. */
uint32_t dr_ramp_steps(double change);

/* Leads s->x to a start of scene->mesh; energies and forces there are the caller's to evaluate. */
drape_status dr_ramp(struct dr_state *s, drape_error *reterr);

#endif
