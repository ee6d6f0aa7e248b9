/* surface.h - a triangle mesh in memory: what generators make, files hold and pictures show. */
#ifndef DRAPE_CLIENT_SURFACE_H
#define DRAPE_CLIENT_SURFACE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct surface {        /* owns its arrays; zero-initialise */
    double *positions;  /* 3*vertices, m */
    double *pattern;    /* 2*vertices, m: flat rest shape (u weft, v warp); NULL for a body */
    uint32_t *triangle; /* 3*triangles, counter-clockwise from outside */
    double *value;      /* vertices: what is to be shown in colours; NULL: nothing */
    size_t vertices, triangles;
};

/* Vertices and triangles of one surface beyond which allocation is refused; keeps every product of
 * sizes far from overflow and every index within 32 bits. */
#define SURFACE_MAX 10000000

/* Zeroed arrays of these sizes, no value; 0, or -1 (too large or out of memory) with *ret untouched. */
int surface_new(size_t vertices, size_t triangles, bool with_pattern, struct surface *ret);
void surface_done(struct surface *surface); /* empties without freeing the struct */

/* Appends `part` to `whole` (positions, pattern, triangles with shifted indices; values are dropped); 0 or -1
 * (memory). */
int surface_append(struct surface *whole, const struct surface *part);

/* Area-weighted vertex normals, unit length (0 0 0 where undefined): 3*vertices floats, to be freed
 * by the caller; NULL when out of memory. Vertices at the same place, as seams leave them, share one
 * normal, so that a seam does not look like a crease. */
float *surface_normals(const struct surface *surface);

#endif
