/* rub.h - dry friction of cloth on cloth, by the anchors of friction.h.
 *
 * A pair in touch (self.h) holds on to an anchor, the offset a between its two closest points where it began
 * to stick. With b_k the pair's weights, n its normal and mu N the most that friction can hold, all taken at
 * the last update, u is the part of sum b_k x_k - a across n, and the potential is that of friction.h. An
 * update keeps what a pair has slipped, at most DR_FRICTION_SLIP of it; a pair that is new begins with none.
 *
 * Belongs to one thread. */
#ifndef DR_RUB_H
#define DR_RUB_H

#include "matrix.h"
#include "mesh.h"

struct dr_rub;

/* A pair in touch: in the order of self.h, `edges` after faces, then by a, then by b. */
struct dr_rub_pair {
    bool edges;
    uint32_t a, b, node[4];
    double weight[4], n[3];
    double force; /* N, that presses it */
};

/* Nothing is anchored before the first update. The coefficient of a pair is the mean over the two parts of
 * own[v] + rest[v] mu (nodes each, copied); mu is what fabrics count as that state none. */
drape_status dr_rub_new(const double *own, const double *rest, double mu, size_t nodes, struct dr_rub **ret,
                        drape_error *reterr);
struct dr_rub *dr_rub_free(struct dr_rub *rub); /* NULL is fine; returns NULL */
size_t dr_rub_bytes(const struct dr_rub *rub);

/* An update at x (3*nodes): begin, then every pair in touch in its order. False: out of memory. */
void dr_rub_begin(struct dr_rub *rub);
bool dr_rub_take(struct dr_rub *rub, const struct dr_rub_pair *pair, const double *x);

/* As dr_friction_brace, at the x of the last update; a pair takes of f what would bring its two points
 * nearest to balance. */
double dr_rub_brace(struct dr_rub *rub, const double *x, double *f);

/* As of friction.h: energy at x with its gradient added to g unless NULL; Hessian, for which A has places. */
double dr_rub_energy(const struct dr_rub *rub, const double *x, double *g);
void dr_rub_hessian(const struct dr_rub *rub, const double *x, double exact, struct dr_matrix *A);

/* The nodes of anchored pair i; false past the last. */
bool dr_rub_nodes(const struct dr_rub *rub, size_t i, uint32_t ret[4]);

#endif
