/* sweep.h - how far a step may go until parts of the cloth would meet.
 *
 * A pair of parts (vertex and triangle, or two edges, that share no node) meets where its distance falls to
 * `keep` times what it is at the start, 0 < keep < 1, or to keep*DR_SWEEP_NEAR if that is less: parts far
 * apart may come close, or layers could not slide over each other. But below DR_SWEEP_SHUT it does not fall
 * except, from there, by a thousandth a step: pairs that step by step closed a part of what was left came to
 * DR_SWEEP_TOUCHING, and through. Found by conservative advancement, as in
 * the additive CCD of [Li, Kaufman, Jiang: Codimensional incremental potential contact, SIGGRAPH 2021,
 * algorithm 1], but for the bound on how fast a pair closes: theirs is the length of the relative motion,
 * ours its part along the line between the closest points, so that sliding is not taken for closing. What is
 * found is never too long; it ends where the pair has closed DR_SWEEP_CLOSED of the way to that distance from
 * the lesser of its own and DR_SWEEP_NEAR.
 *
 * Pairs that cannot keep a distance do not hold the cloth: a pair that touches already (DR_SWEEP_TOUCHING)
 * may do what it likes, and so may a pair of an edge that crosses a triangle at the start: the edge's ends
 * with that triangle, and the edge with the triangle's edges. Moves that are not finite meet nothing.
 *
 * What the lists of the pairs (pairs.h) hold need not be searched for: with all pairs that are closer than
 * `near` (m) at x listed, only cloth whose parts move by nearly that much against each other is. The lists
 * are not changed, and but for round-off the result is the same with near = 0, where they are not read. */
#ifndef DR_SWEEP_H
#define DR_SWEEP_H

#include "pairs.h"

#define DR_SWEEP_NEAR     5e-4 /* m: a cloth's thickness */
#define DR_SWEEP_CLOSED   0.9
#define DR_SWEEP_SHUT     1e-7  /* m */
#define DR_SWEEP_TOUCHING 1e-12 /* m */

/* The largest t in 0..1 such that on the way x + s w, 0 <= s <= t, no pair meets. x, w: 3*nodes. 0 also where
 * a crowd's moves are so wild that too many pairs would have to be looked at for any t worth having. */
double dr_sweep(struct dr_pairs *pairs, const double *x, const double *w, double keep, double near);

/* Shortens the moves w of only those nodes whose pairs would meet, each by its earliest meeting, until no
 * pair meets on the way x + s w, 0 <= s <= 1; where a few rounds do not get there, all moves by dr_sweep.
 * Gives the number of nodes whose moves it shortened. */
size_t dr_sweep_clip(struct dr_pairs *pairs, const double *x, double *w, double keep, double near);

#endif
