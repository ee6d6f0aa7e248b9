/* friction.h - dry friction between cloth and bodies, by anchors.
 *
 * A node that presses on a body holds on to an anchor a, the point of the body's surface it sticks to. With u
 * the part of x - a along the surface and g = mu N the most that friction can hold, the potential
 *
 *     E(l) = g (l^2/s - l^3/(3 s^2)) for l = |u| < s,  g (l - s/3) beyond,   s = DR_FRICTION_SLIP,
 *
 * is convex and C1, and its force grows from 0 at the anchor to g at s, where Coulomb's law lets the node
 * slip. Between updates anchors, normals and g are fixed: friction is a conservative force, each "go"
 * minimises one energy, and a load below mu N is held without creep. An update drags along the anchors of
 * nodes that slipped, to s behind them, and takes normals and N afresh from the contact.
 *
 * Belongs to one thread. */
#ifndef DR_FRICTION_H
#define DR_FRICTION_H

#include "carry.h"
#include "contact.h"

#define DR_FRICTION_SLIP 5e-4 /* m: how far cloth may shear on skin before it slips */

struct dr_friction;

/* E, E'/l and E'' of the potential above. */
void dr_friction_respond(double g, double l, double *ret_energy, double *ret_secant, double *ret_tangent);

/* The coefficient of node v against something of mu is own[v] + rest[v] mu (nodes each): the mean, by rest
 * area, over the fabrics that meet there. `area`, nodes, is scratch. */
void dr_friction_coefficients(const struct dr_mesh *mesh, const drape_material *material, double *own,
                              double *rest, double *area);

/* No node is anchored before the first update. The contact must outlive it; `material`, as many as the mesh
 * names, need not. */
drape_status dr_friction_new(struct dr_contact *contact, const struct dr_mesh *mesh,
                             const drape_material *material, struct dr_friction **ret, drape_error *reterr);
struct dr_friction *dr_friction_free(struct dr_friction *friction); /* NULL is fine; returns NULL */
size_t dr_friction_bytes(const struct dr_friction *friction);

/* Anchors for the contact at x (3*nodes): the potential is another one from here on. */
void dr_friction_update(struct dr_friction *friction, const double *x);

/* The share of what all anchors can hold that those have which held at x (3*nodes) and are past
 * twice the slip at x + w; 0 without
 * anchors. */
double dr_friction_let_go(const struct dr_friction *friction, const double *x, const double *w);

/* Moves the anchors with the body points they sit on: node i's by motor[i] about `centre`. */
void dr_friction_carry(struct dr_friction *friction, const struct dr_motor *motor, const double centre[3]);

/* For a cloth that came to rest at x before, where the anchors have just been taken: f (3*nodes, N) are the
 * forces there. What of them runs along the surface is taken to have been held, up to mu N; each anchor moves
 * to where it holds that, too, and f is what is left. Returns the most that any anchor's force changed by, N.
 */
double dr_friction_brace(struct dr_friction *friction, const double *x, double *f);

/* One anchor's part of that: changes the slip u by a force of `more` along the surface (N), of `limit` at
 * most in all. `more` is then what the force changed by; returns its size, N. */
double dr_friction_hold_more(double limit, double u[3], double more[3]);

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. */
double dr_friction_energy(const struct dr_friction *friction, const double *x, double *g);

/* Adds the Hessian at x to A: across the force E'/l, and along it E'/l with `exact` = 0, which majorises the
 * true E'' that 1 gives. Positive semi-definite either way. */
void dr_friction_hessian(const struct dr_friction *friction, const double *x, double exact,
                         struct dr_matrix *A);

#endif
