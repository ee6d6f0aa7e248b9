/* mesher.h - fills a flat outline with well-shaped triangles. */
#ifndef DRAPE_CLIENT_MESHER_H
#define DRAPE_CLIENT_MESHER_H

#include "failure.h"
#include "surface.h"

/* A Delaunay mesh of the inside of a simple closed polygon (2*points uv pairs in metres,
 * counter-clockwise, its sides about `spacing` long). The outline's points come first in *ret, in
 * their order, and its sides are edges of the mesh; *ret has a pattern and zero positions.
 * Deterministic. 0, or -1 with *failure: out of memory, or an outline too coarse for its shape. */
int mesher_fill(const double *outline, size_t points, double spacing, struct surface *ret,
                struct failure *failure);

/* Edge length at which `area` holds about `triangles` equilateral triangles. */
double mesher_spacing(double area, size_t triangles);

/* Signed area of a closed polygon; positive when counter-clockwise. */
double mesher_area(const double *outline, size_t points);

#endif
