/* self.h - cloth against cloth: a penalty on the distance of vertices to faces and of edges to edges.
 *
 * Each pair that shares no node and is closer than its thickness d has, with s = d - distance, the energy
 *
 *     E = m kappa A psi(s),   psi and kappa those of contact.h, offset d,
 *
 * A half the area of the vertex (a third of each incident rest area), or half the smaller of the two edges'
 * areas (likewise). Distances are those of the closest points, clamped to the primitives; that of two edges
 * has a kink where they are parallel, which the mollifier m = c/e (2 - c/e) takes out: c is the squared sine
 * of their angle, c < e = 0.01, and beyond m = 1 (after Li et al., "Incremental potential contact", ACM
 * Trans. Graph. 39, 2020, section 5). d is the scene's thickness, but at most half the least altitude of the
 * triangles about the four nodes: a fine mesh must not feel its own neighbours. (What is closer all the same
 * is kept apart by the limit on steps alone.)
 *
 * Pairs are searched for when something has moved; the sums run in a fixed order, so that a search more or
 * less changes no bit of them. Belongs to one thread. */
#ifndef DR_SELF_H
#define DR_SELF_H

#include "matrix.h"
#include "mesh.h"

struct dr_self;

/* `thickness` in m, > 0. The mesh must outlive it. */
drape_status dr_self_new(const struct dr_mesh *mesh, double thickness, struct dr_self **ret,
                         drape_error *reterr);

/* Whence a processor is borrowed for half of a search, and of a step's sweep, from now on; NULL: nowhere. */
void dr_self_lend(struct dr_self *self, struct dr_hand *hand);

/* From here on only cloth of different parts is kept apart; see dr_pairs_between. */
void dr_self_between(struct dr_self *self, const uint32_t *part);

/* From here on all cloth is but for what nodes of the same number join; see dr_pairs_weld. */
void dr_self_weld(struct dr_self *self, const uint32_t *weld);

/* From here on nothing is kept off these nodes; see dr_pairs_without. */
void dr_self_without(struct dr_self *self, const bool *absent);

/* Gives it friction, once; for the coefficients see dr_rub_new. */
drape_status dr_self_roughen(struct dr_self *self, const double *own, const double *rest, double mu,
                             drape_error *reterr);
struct dr_self *dr_self_free(struct dr_self *self); /* NULL is fine; returns NULL */
size_t dr_self_bytes(const struct dr_self *self);

/* Energy at x (3*nodes), J. Adds its gradient to g unless NULL. INFINITY when a search failed; then
 * dr_self_error tells why. */
double dr_self_energy(struct dr_self *self, const double *x, double *g);

/* Takes friction's anchors afresh at x: the potential is another one from here on. */
void dr_self_renew(struct dr_self *self, const double *x);

/* Has friction's anchors, just taken at x, hold the forces f: see dr_friction_brace; 0 without friction. */
double dr_self_brace(struct dr_self *self, const double *x, double *f);

/* Whether it has friction, and the part of the energy at x that this holds, J. */
bool dr_self_holds(const struct dr_self *self);
double dr_self_held(const struct dr_self *self, const double *x);

/* DRAPE_OK, or what a search or renewal failed of; what came after it is worth nothing. */
drape_status dr_self_error(const struct dr_self *self, drape_error *reterr);

/* Whether A has a place for the Hessian at x. */
bool dr_self_fits(struct dr_self *self, const double *x, const struct dr_matrix *A);

/* Whether so much cloth lay in one place at the last search that pairs within the thickness may be missing
 * (see dr_pairs_find): energies are then of those that are listed. */
bool dr_self_crowded(const struct dr_self *self);

/* The pairs of nodes (2*links, the self's own until the next call) that A needs for the Hessian at x and
 * about it. */
drape_status dr_self_links(struct dr_self *self, const double *x, const uint32_t **ret, size_t *ret_links,
                           drape_error *reterr);

/* Adds the Hessian at x to A, which it fits: m kappa A psi'' n n', positive semi-definite; with `exact` = 1
 * all of it, the curvature of the distances and the mollifiers' share included. */
void dr_self_hessian(struct dr_self *self, const double *x, double exact, struct dr_matrix *A);

/* One pair that may come to touch: its distance changes by n.sum of weight[k] w[node[k]]. */
struct dr_self_gap {
    bool edges;    /* an edge with an edge, else a vertex with a face */
    uint32_t a, b; /* their numbers in dr_pairs */
    uint32_t node[4];
    double weight[4];
    double distance, n[3];
    double offset, stiffness; /* m, m kappa A in N/m */
};

/* Calls `visit` for each pair whose distance at x is less than its thickness and a margin together: 4 mm, or
 * on a fine mesh half the mean altitude of its triangles. */
void dr_self_each(struct dr_self *self, const double *x,
                  void (*visit)(const struct dr_self_gap *gap, void *data), void *data);

/* How much of the step w from x can be taken, in [0, 1], until some pair has come near the point of
 * touching: every pair keeps a fifth of its distance. */
double dr_self_allows(struct dr_self *self, const double *x, const double *w);

/* Shortens the moves w of the nodes that would run into one another, so that the whole of w can be taken.
 * Returns how many those are. */
size_t dr_self_clip(struct dr_self *self, const double *x, double *w);

/* What searching for pairs took so far, and what looking at them did, s. */
void dr_self_seconds(const struct dr_self *self, double *ret_broad, double *ret_narrow);

/* Edges of the cloth that pass through its triangles at x; *ret_at is where the first does. */
size_t dr_self_crossings(struct dr_self *self, const double *x, double ret_at[3]);

#endif
