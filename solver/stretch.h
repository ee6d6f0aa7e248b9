/* stretch.h - the membrane: orthotropic, on Green strain, linear or by measured curves.
 *
 * F = dx/d(u,v) (3x2), E = (F'F - I)/2, e = (E_uu, E_vv, 2E_uv), energy per rest area e'De/2, second
 * Piola stress S = De = (S_uu, S_vv, S_uv). Where a material has a strain-stress curve, that component of
 * S and its energy come from the curve: with P(strain) along a yarn direction of stretch
 * l = sqrt(1 + 2E), S = P(l - 1)/l and the energy is the integral of P. A mesh without such a material
 * runs loops in which curves do not occur. Immutable once made; shareable by threads. */
#ifndef DR_STRETCH_H
#define DR_STRETCH_H

#include "matrix.h"
#include "mesh.h"

struct dr_stretch;

/* `mesh` must outlive it; `material` (as many as the mesh names) and its curves are copied. */
drape_status dr_stretch_new(const struct dr_mesh *mesh, const drape_material *material, size_t materials,
                            struct dr_stretch **ret, drape_error *reterr);
struct dr_stretch *dr_stretch_free(struct dr_stretch *stretch);  /* NULL is fine; returns NULL */
size_t dr_stretch_bytes(const struct dr_stretch *stretch);       /* curves included */
size_t dr_stretch_curve_bytes(const struct dr_stretch *stretch); /* of the curves' tables; 0 without */

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. */
double dr_stretch_energy(const struct dr_stretch *stretch, const double *x, double *g);

/* Strain e at x, 3 per triangle. */
void dr_stretch_strain(const struct dr_stretch *stretch, const double *x, double *strain);

/* Stress at x, 3 per triangle, N/m; with w (3*nodes, else NULL) the stress that the *linear* step w
 * predicts, S = D(e(x) + B(x)w), on a curve S(e(x)) + D B(x)w with D = dS/de where positive, else 0.
 * Building the geometric stiffness from it keeps stiff cloth free to rotate: the stress at x + w holds the
 * false tension of the step's second-order strain. */
void dr_stretch_stress(const struct dr_stretch *stretch, const double *x, const double *w, double *stress);

/* Adds the Hessian at x to A: B'DB plus the geometric part (grad a . S grad b) I of S = the tensile part
 * of `stress` (3 per triangle) and `compression` times its compressive part; on a curve D is dS/de,
 * `compression` times where it is negative. 0: positive semi-definite in closed form; 1, with the stress
 * at x: the true Hessian. */
void dr_stretch_hessian(const struct dr_stretch *stretch, const double *x, const double *stress,
                        double compression, struct dr_matrix *A);

/* q += (H(1) - H(0)) p, where H(compression) is what dr_stretch_hessian adds: what positive
 * semi-definiteness left out. p and q are 3*nodes. */
void dr_stretch_left_out(const struct dr_stretch *stretch, const double *x, const double *stress,
                         const double *p, double *q);

/* What a linear step w from x gets wrong about stretch: the energy Q (J) of its second-order strain
 * e2 = (w_u.w_u/2, w_v.w_v/2, w_u.w_v) against the predicted stress, e2'De2/2 summed (x gives D where
 * there are curves). *ret_strain is the
 * largest w_u.w_u/2 or w_v.w_v/2: how far the step turns or stretches any thread. */
double dr_stretch_second_order(const struct dr_stretch *stretch, const double *x, const double *w,
                               double *ret_strain);

#endif
