/* scene.h - a job as the client builds it, and its JSON as `POST /v1/jobs` takes it. */
#ifndef DRAPE_CLIENT_SCENE_H
#define DRAPE_CLIENT_SCENE_H

#include <stdio.h>

#include "objfile.h"
#include "surface.h"

struct scene_material {
    const char *preset;       /* borrowed: a name of GET /v1/materials; NULL: the numbers below */
    double density;           /* kg/m^2 */
    double weft, warp, shear; /* N/m */
    double poisson;
    double bend_weft, bend_warp, bend_twist; /* N m */
};

struct scene_edges { /* an elastic or a fold */
    uint32_t *edge;  /* 2*edges, zero-based; freed with the scene */
    size_t edges;
    double shape;     /* factor; degrees */
    double stiffness; /* N; N m per rad and metre */
};

#define SCENE_MAX_MATERIALS 16

/* Members left NULL or negative are not written: the server's own default holds. */
struct scene_solver {
    const char *method, *stop_on; /* borrowed */
    double time_step;             /* s */
    double tolerance;             /* residual force over mean vertex weight */
    double time_limit;            /* s */
    long max_iterations;
};

struct scene {
    const char *name;     /* borrowed; may be NULL */
    struct surface cloth; /* with pattern */
    uint32_t *seam;       /* 2*seams, zero-based */
    uint32_t *pin;        /* pins */
    size_t seams, pins;
    struct objfile_line *line; /* lines, to be measured */
    size_t lines;
    struct scene_material material[SCENE_MAX_MATERIALS];
    size_t materials;
    uint32_t *triangle_material; /* cloth.triangles, each less than materials; NULL: all of the first */
    struct scene_edges *elastic, *fold; /* elastics, folds */
    size_t elastics, folds;
    struct surface *body; /* bodies */
    size_t bodies;
    double thickness;         /* m: at which cloth feels cloth. Negative: the server's default */
    struct surface *keyframe; /* keyframes: postures of the last body */
    size_t keyframes;
    double motion_seconds;             /* negative: the server's default */
    double body_offset, body_friction; /* m; Coulomb. Negative: the server's default */
    const char *self_contact;          /* borrowed; may be NULL */
    bool fit;                          /* measure how it fits */
    const char *start_from;            /* borrowed: the id of a job; may be NULL */
    struct scene_solver solver;
};

/* No arrays, one material without a preset, every optional member left to the server. */
struct scene scene_default(void);
void scene_done(struct scene *scene);

/* Writes the job document; 0, or -1 with errno. */
int scene_write(FILE *file, const struct scene *scene);

#endif
