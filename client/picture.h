/* picture.h - a PNG of a drape: front, side and back view beside each other. */
#ifndef DRAPE_CLIENT_PICTURE_H
#define DRAPE_CLIENT_PICTURE_H

#include "failure.h"
#include "surface.h"

enum picture_shape { PICTURE_MESH = 0, PICTURE_SPHERE, PICTURE_PLANE, PICTURE_CAPSULE };

struct picture_body {
    enum picture_shape shape;
    struct surface mesh; /* MESH */
    double point[3];     /* SPHERE centre; PLANE any point of it; CAPSULE one end of the axis */
    double axis[3];      /* PLANE normal; CAPSULE the other end */
    double radius;       /* SPHERE, CAPSULE (m) */
};

struct picture { /* owns what it holds; zero-initialise */
    struct surface cloth;
    struct picture_body *body;
    size_t bodies;
};

void picture_done(struct picture *picture); /* empties without freeing the struct */

/* The image is this high (pixels), or less where the three views would be wider than that. */
#define PICTURE_HEIGHT 1000
#define PICTURE_WIDTH  2700

/* Renders in memory, without a display, and writes the file. 0, or -1 with *failure. */
int picture_save(const struct picture *picture, const char *path, struct failure *failure);

#endif
