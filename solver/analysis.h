/* analysis.h - symbolic factorisations that matrices of one pattern share (drape_analyses, in drape.h).
 *
 * An analysis belongs to a graph: which of so many free nodes share an element. It is the elimination order
 * of the nodes and CHOLMOD's symbolic factor of the matrix in that order. As both follow from the graph
 * alone, a run that finds them here does what it would have done without, to the last bit. */
#ifndef DR_ANALYSIS_H
#define DR_ANALYSIS_H

#include <cholmod.h>

#include "drape.h"

struct dr_analysis {
    size_t free;     /* nodes */
    size_t pairs;    /* of nodes, the diagonal's included */
    uint64_t *key;   /* pairs: lower number << 32 | higher, ascending; numbered before ordering */
    uint32_t *order; /* free: the number of the node eliminated k-th */
    bool simplicial;
    cholmod_factor *L;     /* symbolic */
    double flops, entries; /* of the factor */
};

/* Whether there is an analysis of `wanted`'s graph and kind of factor: fills the rest of it, its order where
 * it points and L allocated with *common. False also when memory runs out. */
bool dr_analyses_find(drape_analyses *analyses, struct dr_analysis *wanted, cholmod_common *common);

/* Keeps a copy, if memory allows; those used longest ago go, until all are within the limit. */
void dr_analyses_keep(drape_analyses *analyses, const struct dr_analysis *analysis);

#endif
