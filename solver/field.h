/* field.h - the signed distance of a closed triangle mesh: a sparse grid read through a B-spline.
 *
 * Nodes stand `spacing` apart, in blocks of 8x8x8. Blocks exist where a node is inside or within
 * reach + 3.5 spacings of the surface (3.46 is the farthest that a node of a 4x4x4 stencil can be);
 * every other block is the one "far" block. The field is a uniform tricubic B-spline,
 * C2 everywhere. Its coefficients are the samples less a sixth of their second differences: the samples
 * themselves would smooth the field by spacing^2/6 times its Laplacian, which takes 1.4 mm off a tip of 5 mm
 * radius; so it is half of that, and 0.3 mm in the mean square over a whole body where it was 0.5. Parts
 * thinner than two spacings fade away: such a sheet feels soft, not inverted.
 *
 * A node is inside where the winding number of the surface is positive, which is right also where the
 * surface crosses itself. Distances at nodes are exact within 4 spacings of the surface; farther off,
 * the nearest triangle is handed on from node to node, which may miss it: by up to a fifteenth of a
 * spacing in the distance and four per cent in the gradient. (To sharpen less there, where nothing touches,
 * cost a shirt half as many iterations again.) */
#ifndef DR_FIELD_H
#define DR_FIELD_H

#include <stdatomic.h>

#include "hand.h"

#define DR_BLOCK       8 /* nodes along a block's edge */
#define DR_BLOCK_NODES ((size_t)DR_BLOCK * DR_BLOCK * DR_BLOCK)

/* The spacing is the finest of these times sqrt(2)^k that keeps within the limits below, m. */
#define DR_FIELD_FINEST     0.004
#define DR_FIELD_COARSEST   0.016
#define DR_FIELD_MAX_BLOCKS 32768     /* 64 MiB of floats */
#define DR_FIELD_MAX_TABLE  4194304   /* blocks in the bounding box: 16 MiB of indices */
#define DR_FIELD_MAX_WORK   500000000 /* point-triangle distances of one pass, about 10 s */

/* Immutable once made but for its count of references; shareable by threads. */
struct dr_field {
    atomic_size_t references;
    double origin[3]; /* position of node 0,0,0, m */
    double spacing;   /* m */
    double reach;     /* m */
    uint32_t side[3]; /* blocks along each axis; no block of the outermost layer exists */
    uint32_t *table;  /* side[0]*side[1]*side[2], x fastest: number of the block; 0: the far block */
    size_t blocks;    /* the far block, number 0, included */
    float *value;     /* DR_BLOCK_NODES per block, x fastest: the spline's coefficients, m, negative inside */
};

/* The mesh must have passed dr_body_check. DRAPE_EINVAL (place DRAPE_AT_BODY `number`) when even the
 * coarsest spacing breaks a limit. Needs 9 bytes per node of scratch memory meanwhile. The field is the same
 * with and without a processor lent by `hand` (NULL is fine). */
drape_status dr_field_new(const double *positions, size_t vertices, const uint32_t *triangle,
                          size_t triangles, double reach, int64_t number, struct dr_hand *hand,
                          struct dr_field **ret, drape_error *reterr);
struct dr_field *dr_field_ref(struct dr_field *field);   /* one reference more; returns the field */
struct dr_field *dr_field_unref(struct dr_field *field); /* the last frees it; NULL is fine; returns NULL */
size_t dr_field_bytes(const struct dr_field *field);

/* As dr_body_distance, which see. */
bool dr_field_distance(const struct dr_field *field, const double x[3], double *ret_phi, double ret_grad[3]);

/* As dr_body_curvature, which see. */
void dr_field_curvature(const struct dr_field *field, const double x[3], double ret[6]);

#endif
