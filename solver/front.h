/* front.h - Cholesky factor in single precision of a symmetric sparse matrix: a preconditioner for conjugate
 * gradients in double, at half of a double factor's bytes and less than half of its time.
 *
 * Multifrontal (Duff and Reid, ACM TOMS 9, 1983): each supernode's columns are summed in a dense matrix, its
 * front, with what its children in the elimination tree leave; the dense columns are factorised there, and
 * what they leave goes to the parent. Sums have a fixed order: the same matrix has the same factor to the
 * last bit, on one kind of processor. The matrix is scaled by powers of two to a diagonal of 1 to 4 first.
 *
 * Algebraic multigrid in its place (BoomerAMG of hypre 2.26, GAMG of PETSc 3.18) takes 1.9 to 12 times as
 * long at 200 000 triangles, to 1e-4: its iterations stay as many at any size, but one costs a back-solve,
 * and stiff cloth needs a hundred.
 *
 * The tree is cut into two shares of subtrees, which have as much work as each other and nothing in common,
 * and the top that joins them: a second processor that is idle may take one share. Belongs to one thread. */
#ifndef DR_FRONT_H
#define DR_FRONT_H

#include <cholmod.h>

#include "hand.h"

struct dr_front;

enum dr_front_result {
    DR_FRONT_DONE,
    DR_FRONT_INDEFINITE, /* a direction of negative curvature was found, and measured in double */
    DR_FRONT_UNCERTAIN,  /* a pivot is lost in single round-off: double has to tell */
};

/* A: the lower triangle (stype -1, sorted, packed, of ints and doubles) of a matrix of 3x3 blocks whose rows
 * and columns come in threes; its values are looked at by dr_front_factorise. L: its supernodal symbolic
 * factor in natural order. Both are borrowed until dr_front_free; L may become numeric meanwhile. Takes all
 * memory that it will ever need. NULL: out of memory. */
struct dr_front *dr_front_new(const cholmod_sparse *A, const cholmod_factor *L);

struct dr_front *dr_front_free(struct dr_front *front); /* NULL is fine; returns NULL */
size_t dr_front_bytes(const struct dr_front *front);

/* Factorises A as it is now. hand: here and below, NULL is fine. Unless it is done, there is no factor. */
enum dr_front_result dr_front_factorise(struct dr_front *front, struct dr_hand *hand);

/* Solves A w = b, in place, with the last factor: within about 1e-6 times A's condition, and whatever the
 * size of b. n numbers, in the order of A's rows. */
void dr_front_solve(struct dr_front *front, struct dr_hand *hand, double *x);

/* The instruction set that the processor offers: see drape_kernels. */
const char *dr_front_kernels(void);

#endif
