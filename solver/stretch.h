/* stretch.h - the membrane: orthotropic St. Venant-Kirchhoff on Green strain.
 *
 * F = dx/d(u,v) (3x2), E = (F'F - I)/2, e = (E_uu, E_vv, 2E_uv), energy per rest area e'De/2, second
 * Piola stress S = De = (S_uu, S_vv, S_uv). Immutable once made; shareable by threads. */
#ifndef DR_STRETCH_H
#define DR_STRETCH_H

#include "matrix.h"
#include "mesh.h"

struct dr_stretch;

/* `mesh` must outlive it; `material` (as many as the mesh names) is copied. */
drape_status dr_stretch_new(const struct dr_mesh *mesh, const drape_material *material, size_t materials,
                            struct dr_stretch **ret, drape_error *reterr);
struct dr_stretch *dr_stretch_free(struct dr_stretch *stretch); /* NULL is fine; returns NULL */
size_t dr_stretch_bytes(const struct dr_stretch *stretch);

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. */
double dr_stretch_energy(const struct dr_stretch *stretch, const double *x, double *g);

/* Stress at x, 3 per triangle, N/m; with w (3*nodes, else NULL) the stress that the *linear* step w
 * predicts, S = D(e(x) + B(x)w). Building the geometric stiffness from it keeps stiff cloth free to
 * rotate: the stress at x + w holds the false tension of the step's second-order strain. */
void dr_stretch_stress(const struct dr_stretch *stretch, const double *x, const double *w, double *stress);

/* Adds the Hessian at x to A: B'DB plus the geometric part (grad a . S grad b) I of the *tensile*
 * part of `stress` (3 per triangle), so that it is positive semi-definite in closed form. */
void dr_stretch_hessian(const struct dr_stretch *stretch, const double *x, const double *stress,
                        struct dr_matrix *A);

#endif
