/* weld.h - bodies whose vertices were split for normals or textures, made whole. */
#ifndef DRAPED_WELD_H
#define DRAPED_WELD_H

#include "meshfile.h"

/* Modelling programs export a vertex once for each normal and texture coordinate it has, so that a closed
 * body falls apart along its seams. Where the surface is not closed, triangles with corners at exactly the
 * same place get the same vertex, the first; the others stay, unused. A closed surface is left as it is,
 * since pieces of it may touch. 0, or -1 when out of memory. */
int weld_body(struct mesh *mesh);

#endif
