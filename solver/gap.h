/* gap.h - what the quadratic model of a step misses of contact: the gaps linear in the step, the penalty
 * exact.
 *
 * From x a step w changes the depth of a sample into a body's offset from s to s - t, t = n.w, n the gradient
 * of the distance at x. The force and the step matrix at x know kappa A psi(s - t) to second order in t only,
 * nothing of samples that the step brings into contact or takes out of it. The surplus
 *
 *     X(w) = sum kappa A (psi(s - t) - psi(s) + psi'(s) t - psi''(s) t^2/2)
 *
 * added to that model makes it see them. Belongs to one thread. */
#ifndef DR_GAP_H
#define DR_GAP_H

#include "contact.h"
#include "self.h"

struct dr_gaps;

/* Of cloth with bodies and with itself; both must outlive it, and one may be NULL. */
drape_status dr_gaps_new(struct dr_contact *contact, struct dr_self *self, struct dr_gaps **ret,
                         drape_error *reterr);
struct dr_gaps *dr_gaps_free(struct dr_gaps *gaps); /* NULL is fine; returns NULL */
size_t dr_gaps_bytes(const struct dr_gaps *gaps);

/* Linearises at x (3*nodes) every gap to a body within DR_BODY_REACH, and those within the cloth that
 * dr_self_each knows. */
drape_status dr_gaps_take(struct dr_gaps *gaps, const double *x, drape_error *reterr);

/* X at the step w (3*nodes), J; adds its gradient to g. Later products are with the Hessian there. */
double dr_gaps_surplus(struct dr_gaps *gaps, const double *w, double *g);

/* y += X''(w) p, at the step of the last surplus. Both 3*nodes. */
void dr_gaps_add_product(const struct dr_gaps *gaps, const double *p, double *y);

#endif
