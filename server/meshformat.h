/* meshformat.h - between meshfile.c and the formats behind it (obj.c, ply.c, glb.c); nobody else's.
 *
 * A parser fills a zeroed mesh and returns 0, or fills *reterr and returns -1; what the mesh holds by
 * then is freed by meshfile.c. Every parser learns its counts first and allocates once, so that a
 * parse holds little more than the finished mesh. */
#ifndef DRAPED_MESHFORMAT_H
#define DRAPED_MESHFORMAT_H

#include "meshfile.h"

/* A polygon with more corners is refused; caps of modelled cylinders have up to a few hundred. */
#define MESH_MAX_CORNERS 512

int obj_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
              struct problem *reterr);
int ply_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
              struct problem *reterr);
int glb_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
              struct problem *reterr);

/* Allocates the arrays of *mesh; 422 when a count is zero or over its limit. */
int mesh_alloc(struct mesh *mesh, size_t vertices, size_t triangles, bool pattern,
               const struct limits *limits, struct problem *reterr);

/* Appends a polygon as a fan to mesh->triangle, which has room, and moves mesh->triangles along.
 * `corner` holds indices already known to be in range; one that comes twice is refused, naming
 * `what` and `number` ("face" 17). */
int mesh_add_polygon(struct mesh *mesh, const uint32_t *corner, size_t corners, const char *what,
                     uint64_t number, struct problem *reterr);

/* Little-endian numbers for the binary formats; errors show in ferror(). */
void mesh_put_u32(FILE *file, uint32_t value);
void mesh_put_floats(FILE *file, const double *value, size_t n); /* rounded to 32 bits */

#endif
