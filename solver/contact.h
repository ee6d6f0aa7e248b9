/* contact.h - cloth against static bodies: a conservative C2 penalty on the distance.
 *
 * Samples are the nodes (weight A_v/2, A_v a third of each incident rest area) and the triangle
 * centroids (A_t/2), each against each body at that body's own offset. A triangle with a side longer than
 * DR_CONTACT_SPACING at rest is cut into n^2 equal pieces that small, and it is their centroids and corners
 * that are sampled, with the pieces' areas: a body's small parts, 5 mm round, would else come through
 * between. Its own corners keep their full weight, as it is they that folds press on a body: with a piece's
 * they sank in by 3 mm. Each sample moves with the triangle's corners, so that the matrix keeps its pattern.
 * With s = offset - phi:
 *   E = kappa A psi(s),  psi = s^3/(6w) for 0 < s < w,  w^2/6 + w e/2 + e^2/2 with e = s - w beyond,
 * w = offset/2, kappa = DR_CONTACT_STIFFNESS. Its Hessian is kappa A (psi'' n n' - psi' H), n the gradient
 * and H the curvature of phi. Steps drop the second part: what is left is positive semi-definite.
 *
 * Sums run in a fixed order: nodes, then triangles and their points; bodies in scene order within each.
 * Nothing is allocated after dr_contact_new. The distances at the last x are kept for the next to ask for the
 * same. Belongs to one thread. */
#ifndef DR_CONTACT_H
#define DR_CONTACT_H

#include "body.h"
#include "hand.h"
#include "matrix.h"
#include "mesh.h"

#define DR_CONTACT_STIFFNESS 1e7 /* N/m^3: 0 crossings at 9-12 mm edges; 1e6 left 50 on a shirt */

/* m. Of meshes of 12 mm edges a tenth of the triangles is longer. At 16 mm a shirt of 30 mm edges still had 6
 * crossings, at 14 mm none, without any of this 60 to 78. */
#define DR_CONTACT_SPACING    0.014
#define DR_CONTACT_MAX_PIECES 8 /* of a side: 106 samples in a triangle */

struct dr_contact;

struct dr_penalty {                  /* kappa A psi and its first two derivatives in s */
    double energy, force, curvature; /* J, N, N/m */
};

/* Of a sample of `stiffness` kappa A (N/m) that is `depth` s into the offset. */
struct dr_penalty dr_penalty(double stiffness, double offset, double depth);

/* `mesh` and each body of `body` (an array of `bodies` pointers, itself copied; NULL if 0) must
 * outlive the contact. */
drape_status dr_contact_new(const struct dr_mesh *mesh, struct dr_body *const *body, size_t bodies,
                            struct dr_contact **ret, drape_error *reterr);

/* Whence a processor is borrowed for half of the distances from now on; NULL: nowhere. */
void dr_contact_lend(struct dr_contact *contact, struct dr_hand *hand);

struct dr_contact *dr_contact_free(struct dr_contact *contact); /* NULL is fine; returns NULL */
size_t dr_contact_bytes(const struct dr_contact *contact);

/* The samples of a triangle, besides its corners, of these rest coordinates (uv of each corner, m). */
size_t dr_contact_points(const double rest[6]);

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. */
double dr_contact_energy(struct dr_contact *contact, const double *x, double *g);

/* Adds the Hessian at x to A, with `curvature` times the part of the bodies' curvature. 0: positive
 * semi-definite; 1: the true Hessian. */
void dr_contact_hessian(struct dr_contact *contact, const double *x, double curvature, struct dr_matrix *A);

/* One sample within DR_BODY_REACH of one body. */
struct dr_sample {
    uint32_t node[3];         /* a triangle's corners, or a node thrice */
    double share[3];          /* it moves with the nodes' moves times these, which sum to 1 */
    double phi, n[3];         /* distance (m) and its gradient */
    double offset, stiffness; /* m, kappa A in N/m */
};

/* Calls `visit` for each of them at x, in the order of the sums; at most dr_contact_samples of them. */
void dr_contact_each(struct dr_contact *contact, const double *x,
                     void (*visit)(const struct dr_sample *sample, void *data), void *data);
size_t dr_contact_samples(const struct dr_contact *contact);

/* The forces of the bodies on the nodes at x, those on a triangle's samples shared by its corners, into load
 * (3*nodes, N), and what of their size friction may hold into grip (nodes, N): the sum over the bodies of
 * force times own + rest times the body's coefficient (nodes each). */
void dr_contact_loads(struct dr_contact *contact, const double *x, const double *own, const double *rest,
                      double *load, double *grip);

/* Scales down the move w (3*nodes, finite, in place) of each node that would take it too deep into a
 * body, `depth` > 0, m. The straight path from x to x + w is walked by the distances met on the way:
 * each step is as long as the distance is, or depth/2 where that is more. With phi the distance as
 * dr_body_distance gives it, afterwards for every node and body:
 *   - phi(x + w) >= min(phi(x), 0) - depth, and so at every point the walk stopped at; between them
 *     the path can be deeper by depth/4 at most (phi changes no faster than the way);
 *   - once the path is outside, the same holds with min(phi, 0) = 0, and it does not come out of a
 *     part of the body, however thin, on the other side: it ends before that part or in its near half.
 *     (A mesh's parts are seen as its field sees them: thinner than two spacings they may be missed.)
 *   - a node that starts inside is free to move outwards, on any side; and any node to move by depth/2,
 *     unless that crosses a thin part;
 *   - a move that touches nothing is left alone, up to DR_CONTACT_MAX_WALK steps (in free space at
 *     least DR_BODY_REACH each, 7 m in all), where it is cut.
 * Returns the number of nodes whose move was cut. */
#define DR_CONTACT_MAX_WALK 256
size_t dr_contact_clip(const struct dr_contact *contact, const double *x, double *w, double depth);

/* Nodes inside a body at x; *ret_deepest is the depth of the deepest (0 when none), m, and ret_where its
 * place (untouched when none). */
uint32_t dr_contact_penetrations(const struct dr_contact *contact, const double *x, double *ret_deepest,
                                 double ret_where[3]);

#endif
