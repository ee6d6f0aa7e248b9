/* picture.h - a PNG of a drape: front, side and back view beside each other. */
#ifndef DRAPE_CLIENT_PICTURE_H
#define DRAPE_CLIENT_PICTURE_H

#include "failure.h"
#include "surface.h"

enum picture_shape { PICTURE_MESH = 0, PICTURE_SPHERE, PICTURE_PLANE, PICTURE_CAPSULE };

struct picture_body {
    enum picture_shape shape;
    struct surface mesh; /* MESH */
    double *arrived;     /* MESH: 3*vertices, where its motion ends; NULL: it stands */
    double point[3];     /* SPHERE centre; PLANE any point of it; CAPSULE one end of the axis */
    double axis[3];      /* PLANE normal; CAPSULE the other end */
    double radius;       /* SPHERE, CAPSULE (m) */
};

/* What the colours of the cloth may show. */
struct picture_map {
    const char *name;
    const char *attribute; /* of the vertices in a GLB; NULL: no colours */
    const char *unit;
    double per_unit; /* how many of that unit are one of the attribute's */
};

extern const struct picture_map picture_maps[];               /* the last one's name is NULL */
const struct picture_map *picture_map_find(const char *name); /* NULL: there is none of that name */

struct picture { /* owns what it holds; zero-initialise */
    struct surface cloth;
    const struct picture_map *map; /* what the cloth's values are; NULL: it has none */
    struct picture_body *body;
    size_t bodies;
};

void picture_done(struct picture *picture); /* empties without freeing the struct */

/* The values at the two ends of the colours: 0, or the least where that is below, and the largest. */
void picture_range(const struct picture *picture, double ret[2]);

/* The image is this high (pixels), or less where the three views would be wider than that. */
#define PICTURE_HEIGHT 1000
#define PICTURE_WIDTH  2700

/* Renders in memory, without a display, and writes the file. Values of the cloth are shown in viridis, dark
 * to light, with a bar of the colours, the least below, at the left edge. 0, or -1 with *failure. */
int picture_save(const struct picture *picture, const char *path, struct failure *failure);

#endif
