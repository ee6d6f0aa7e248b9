/* mesh.h - the triangle mesh the mechanics work on: nodes, triangles, flat rest shape, neighbours.
 *
 * A node is a group of cloth vertices welded by seams (or one vertex, while the pieces are not yet
 * sewn). The rest shape is stored per triangle corner, because the two sides of a seam have
 * different pattern coordinates. Immutable once made; shareable by threads. */
#ifndef DR_MESH_H
#define DR_MESH_H

#include "drape.h"

#define DR_NONE UINT32_MAX

struct dr_mesh {
    size_t nodes, triangles;
    uint32_t *triangle; /* 3*triangles: node of each corner */
    double *rest;       /* 6*triangles: (u,v) of the three corners in the triangle's own frame, m;
                         * may be oriented either way */
    double *area;       /* triangles: rest area, m^2, > 0 */
    double *grad;       /* 6*triangles: d(barycentric a)/d(u,v) at [6t + 2a + 0..1], 1/m */
    uint32_t *neighbor; /* 3*triangles: across the edge opposite corner k runs triangle
                         * neighbor[3t+k]; DR_NONE on a free edge */
    uint8_t *across;    /* 3*triangles: the corner of that neighbour opposite the same edge */
    uint32_t *material; /* triangles */
    bool *held;         /* nodes: pinned */
    double *mass;       /* nodes: kg, a third of each incident rest area times its density */
};

/* `triangle` holds nodes, `pattern` is looked up through `corner_vertex` (3*triangles, vertex of
 * each corner). Every array is copied. Fails with DRAPE_EINVAL on a collapsed triangle, an edge of
 * more than two triangles or two triangles of the same corners (place DRAPE_AT_TRIANGLE), DRAPE_ENOMEM. */
drape_status dr_mesh_new(size_t nodes, size_t triangles, const uint32_t *triangle,
                         const uint32_t *corner_vertex, const double *pattern,
                         const uint32_t *material, /* NULL: all 0 */
                         const double *density,    /* by material, kg/m^2 */
                         const bool *held,         /* nodes; NULL: none */
                         struct dr_mesh **ret, drape_error *reterr);

/* Scales the rest shape of each triangle by its material's factors, 2 per material: weft, warp, > 0. Masses
 * stay what they were. */
void dr_mesh_shrink(struct dr_mesh *mesh, const double *factor);

struct dr_mesh *dr_mesh_free(struct dr_mesh *mesh); /* NULL is fine; returns NULL */
size_t dr_mesh_bytes(const struct dr_mesh *mesh);

double dr_mesh_area(const struct dr_mesh *mesh); /* at rest, of all triangles, m^2 */
double dr_mesh_edge(const struct dr_mesh *mesh); /* of as many equal equilateral triangles as large, m */

#endif
