/* matrix.h - the symmetric step matrix: 3x3 blocks on the free nodes, assembled into fixed slots.
 *
 * Only the lower triangle is stored, in the very layout CHOLMOD factors (compressed columns of the
 * 3n x 3n matrix, stype -1) and already in elimination order (minimum degree or nested dissection on the
 * graph of free nodes, then postordered), so that nothing is copied or permuted between assembly and
 * factorisation. Rows and columns of held nodes do not exist; adding to them does nothing. Belongs to one
 * thread. */
#ifndef DR_MATRIX_H
#define DR_MATRIX_H

#include "bend.h"
#include "hand.h"
#include "mesh.h"

struct dr_matrix;

enum dr_factor {
    DR_CHOLESKY, /* supernodal LL'; tells when the matrix is not positive definite */
    DR_LDL,      /* simplicial LDL', no pivoting: for indefinite matrices, ten times slower and more */
    DR_SINGLE,   /* LL' in single precision (front.h), a preconditioner; DR_CHOLESKY where that is in doubt */
    DR_FACTORS
};

/* Pattern: the mesh's triangles, the bending stiffness (NULL: none) and `links` extra pairs of nodes
 * (2*links, NULL if 0), which are copied; mesh and bending stiffness must outlive the matrix.
 * `analyses` (NULL: none) is looked at for the pattern's symbolic factor, and given it.
 * DRAPE_EINVAL when it needs more entries than a 32-bit index counts. */
drape_status dr_matrix_new(const struct dr_mesh *mesh, const struct dr_bend_stiffness *bend,
                           const uint32_t *link, size_t links, enum dr_factor factor,
                           drape_analyses *analyses, struct dr_matrix **ret, drape_error *reterr);

/* Whence DR_SINGLE borrows a processor from now on; NULL: nowhere. */
void dr_matrix_lend(struct dr_matrix *A, struct dr_hand *hand);

/* The same with places for the blocks of these pairs of nodes, too, beside the links given at creation, and
 * zero but for the base; there is no factor until the next factorisation. After a failure nothing may be done
 * with it but to count its bytes and to free it. */
drape_status dr_matrix_relink(struct dr_matrix *A, const uint32_t *link, size_t links, drape_error *reterr);

/* The same with another bending stiffness, without places for links but those given at creation. */
drape_status dr_matrix_rebend(struct dr_matrix *A, const struct dr_bend_stiffness *bend, drape_error *reterr);

struct dr_matrix *dr_matrix_free(struct dr_matrix *A); /* NULL is fine; returns NULL */
size_t dr_matrix_bytes(const struct dr_matrix *A);
size_t dr_matrix_bytes_to_come(const struct dr_matrix *A); /* with the next factorisation */
size_t dr_matrix_free_nodes(const struct dr_matrix *A);
enum dr_factor dr_matrix_factor(const struct dr_matrix *A);

/* Whether the last factor is in single precision: what dr_matrix_solve does with it is right to some digits
 * only, and conjugate gradients with dr_matrix_multiply do the rest. */
bool dr_matrix_is_single(const struct dr_matrix *A);

/* From now on factorises by DR_CHOLESKY, or by DR_SINGLE again. A matrix of which single precision could
 * twice running not tell whether it is positive definite stays with DR_CHOLESKY, whatever is asked. False:
 * out of memory, and nothing is changed. Only of a matrix made for one of the two; there is no factor until
 * the next factorisation. */
bool dr_matrix_prefer(struct dr_matrix *A, enum dr_factor factor);

/* Floating-point operations of one factorisation, which the analysis has counted. */
double dr_matrix_flops(const struct dr_matrix *A);

/* Of the last factor, which a back-solve reads twice. */
size_t dr_matrix_factor_bytes(const struct dr_matrix *A);

/* What is the same at every step: mass_factor (1/s^2) times diag(mass), plus the bending stiffness given at
 * creation. */
void dr_matrix_set_base(struct dr_matrix *A, double mass_factor);

/* A = base. */
void dr_matrix_reset(struct dr_matrix *A);

/* H is the lower triangle of a symmetric 3x3 block: xx, yx, yy, zx, zy, zz. */
void dr_matrix_add_node(struct dr_matrix *A, uint32_t node, const double H[6]);

/* H is a symmetric 9x9 block of triangle t of the matrix's mesh, corners in mesh order, row-major;
 * only its lower triangle is read. */
void dr_matrix_add_triangle(struct dr_matrix *A, size_t t, const double H[9][9]);

/* The same for triangles t .. t + count - 1 one after the other, count to DR_MATRIX_BATCH: entry i, j <= i,
 * of theirs is H[i * (i + 1) / 2 + j][0 .. count - 1]. */
#define DR_MATRIX_BATCH 4
void dr_matrix_add_triangles(struct dr_matrix *A, size_t t, size_t count,
                             const double H[45][DR_MATRIX_BATCH]);

/* Whether the pattern has a place for the block of nodes a != b, or needs none since one of them is held. */
bool dr_matrix_has(const struct dr_matrix *A, uint32_t a, uint32_t b);

/* H is the block of rows a, columns b of a symmetric matrix, a != b; the pattern has its place. */
void dr_matrix_add_between(struct dr_matrix *A, uint32_t a, uint32_t b, const double H[3][3]);

/* Adds stiffness (1 -1; -1 1) (x) I3 between the two nodes of link i. */
void dr_matrix_add_link(struct dr_matrix *A, size_t i, double stiffness);

/* H is the 3x3 block, row-major, in the rows of the first node of link i and the columns of the second. */
void dr_matrix_add_pair(struct dr_matrix *A, size_t i, const double H[9]);

/* Subtracts c I from A, c so large that dr_matrix_factorise coming to its end afterwards proves that A was
 * positive definite, whatever was rounded on the way: g/(1 - g) tr(A), g = n u/(1 - n u), with n two more
 * than the entries of the factor's fullest row and u = 2^-53 (Rump, "Verification of positive
 * definiteness", BIT 46, 2006). DR_CHOLESKY only. */
void dr_matrix_lower_by_round_off(struct dr_matrix *A);

/* Factorises A into memory kept from call to call (analysed in dr_matrix_new). False: A is not positive
 * definite (DR_CHOLESKY, DR_SINGLE) or has a zero pivot (DR_LDL), or memory ran out (*ret_memory then), or
 * single precision cannot tell: A is in doubt until the next call, which factorises it in double, or the next
 * dr_matrix_reset. */
bool dr_matrix_factorise(struct dr_matrix *A, bool *ret_memory);
bool dr_matrix_in_doubt(const struct dr_matrix *A);

/* q = A p, as it is assembled. Both 3*nodes; held nodes are ignored in p and zero in q. */
void dr_matrix_multiply(const struct dr_matrix *A, const double *p, double *q);

/* Solves A w_k = b_k, nearly so if dr_matrix_is_single, for `count` (1 or 2) right-hand sides with the last
 * factor, which must have succeeded (DR_LDL: one side, and false when memory ran out); b and w are 3*nodes
 * per side, held nodes are ignored in b and zero in w. */
bool dr_matrix_solve(struct dr_matrix *A, size_t count, const double *const b[], double *const w[]);

#endif
