/* coarsen.h - the same garment with fewer, larger triangles, and the way back up.
 *
 * Vertices are taken away one by one, the shortest edges first: each goes into a neighbour, with which the
 * triangles between vanish (half-edge collapse; Hoppe et al., "Mesh optimization", SIGGRAPH 1993), and edges
 * are flipped where that makes better triangles. What is left are vertices of the fine mesh, at their places.
 *   - All is decided in the pattern, piece by piece: no triangle turns over, none becomes a sliver, and the
 *     outline stays within a part of the edge length of where it was.
 *   - Vertices of outlines and of borders between materials go along those only; where these turn sharply,
 *     meet or end the vertex stays, and so do those of pins, elastics, folds and tacks.
 *   - Vertices that are sewn together go together, each along its own outline, into vertices that are sewn
 *     together: seams match one to one, and the sewn mesh stays a surface (the link condition of Dey et al.,
 *     "Topology preserving edge contraction", 1999).
 * Each vertex that is gone keeps its place in a triangle near it, as it changes hands (after Lee et al.,
 * "MAPS", SIGGRAPH 1998): no search, so that pieces may overlap in the pattern. */
#ifndef DR_COARSEN_H
#define DR_COARSEN_H

#include "drape.h"

struct dr_coarse {
    drape_scene_desc desc; /* its bodies, materials and curves are those of the fine one */
    struct dr_coarse_arrays {
        double *positions, *pattern;
        uint32_t *triangle_material, *pin;
        uint32_t *edge; /* of the elastics, then of the folds */
        drape_elastic *elastic;
        drape_fold *fold;
        drape_tack *tack;
    } own; /* what else `desc` points to */
    size_t vertices, triangles, seams;
    uint32_t *vertex;   /* vertices: of the fine mesh, each */
    uint32_t *triangle; /* 3*triangles */
    uint32_t *seam;     /* 2*seams */
    size_t fine;        /* vertices of the fine mesh */
    uint32_t *corner;   /* 3*fine: coarse vertices that each fine one lies between; DR_NONE: of no triangle */
    double *weight;     /* 3*fine: their weights, which sum to 1; beside an outline some are below 0 */
};

/* `desc` has passed drape_scene_check; what has no triangle, and a start_pattern, is left out. `edge`: the
 * edges' length in the pattern to come to, m. */
drape_status dr_coarsen(const drape_scene_desc *desc, double edge, struct dr_coarse **ret,
                        drape_error *reterr);
struct dr_coarse *dr_coarse_free(struct dr_coarse *coarse); /* NULL is fine; returns NULL */
size_t dr_coarse_bytes(const struct dr_coarse *coarse);     /* without what `desc` points to */

/* Lets go of `desc` and what only it points to, once a scene has been made of it. */
void dr_coarse_strip(struct dr_coarse *coarse);

/* Places of the fine vertices (3*fine) on the coarse mesh at x (3*desc.vertices); one of no triangle is left
 * alone. Vertices sewn together may come out a little apart. */
void dr_coarse_carry(const struct dr_coarse *coarse, const double *x, double *fine);

#endif
