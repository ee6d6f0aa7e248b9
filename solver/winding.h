/* winding.h - which nodes of a regular grid lie inside a closed triangle mesh. */
#ifndef DR_WINDING_H
#define DR_WINDING_H

#include "drape.h"

/* Nodes (from..to-1, j, k) of a grid line along x. */
struct dr_run {
    uint32_t from, to, j, k;
};

/* The runs of nodes with a positive winding number, ordered by k, j, from. Coordinates are in node
 * units: the grid's nodes are the integer points, all of the mesh lies at coordinates between 0 and
 * 2^31. The mesh must be closed and consistently oriented; it may cross itself, and triangles may be
 * degenerate. The caller frees *ret. Stops with *ret_work > limit when more line-triangle tests are
 * needed; *ret is then NULL. */
drape_status dr_winding_runs(const double *point, const uint32_t *triangle, size_t triangles, size_t limit,
                             size_t *ret_work, struct dr_run **ret, size_t *ret_runs, drape_error *reterr);

#endif
