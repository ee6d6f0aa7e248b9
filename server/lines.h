/* lines.h - girths and lengths: named lines on the cloth, their lengths in the pattern and draped.
 *
 * A line runs from vertex to vertex, straight in the flat pattern and so, in the drape, over the triangles
 * that lie between: a tape sewn to the cloth, not one pulled tight. Where the straight way leaves its piece
 * (a dart, a hollow edge) it goes straight on in space. From one piece to another a line goes at a seam: of
 * two vertices in a row either both are of one piece, or they are sewn together, or one is sewn to a vertex
 * of the other's piece and stands for that one. */
#ifndef DRAPED_LINES_H
#define DRAPED_LINES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "drape.h"

struct line {
    char *name;
    uint32_t *vertex; /* vertices, of the cloth */
    size_t vertices;
    bool closed;    /* the last is followed by the first */
    uint32_t *ends; /* 2*segments: each from and to, of one piece; the same twice: no way at all */
    size_t segments;
};

struct lines { /* owns everything it points to */
    size_t count;
    struct line *line;
    uint32_t *piece; /* of each vertex of the cloth; see groups.h */
};

struct lines *lines_new(size_t count);         /* lines without vertices; NULL when out of memory */
struct lines *lines_free(struct lines *lines); /* NULL is fine; returns NULL */

#define LINES_APART 1 /* two vertices in a row have no piece in common */

/* Finds the ends of the segments in a scene that passed drape_scene_check. 0; LINES_APART and where, *ret_at
 * being the first of the two in its line; -1 when out of memory. */
int lines_join(struct lines *lines, const drape_scene_desc *scene, size_t *ret_line, size_t *ret_at);

struct line_length {
    double rest;   /* m, in the pattern */
    double draped; /* m */
};

/* Of each line, at `positions` (3*vertices). 0, or -1 when out of memory. */
int lines_measure(const struct lines *lines, const drape_scene_desc *scene, const double *positions,
                  struct line_length *ret);

#endif
