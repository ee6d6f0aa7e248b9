/* cases.h - the scenes of the stability suite: each bends one thing out of all proportion. */
#ifndef DRAPED_STABILITY_CASES_H
#define DRAPED_STABILITY_CASES_H

#include "drape.h"

#define SCENE_MATERIALS    2
#define SCENE_BODIES       2
#define SCENE_CURVE_POINTS 3

/* A description with the arrays behind it. */
struct scene {
    drape_scene_desc desc;                  /* points into the rest */
    size_t nx, ny;                          /* cells of the (first) grid */
    double *x, *uv;                         /* 3*vertices, 2*vertices */
    uint32_t *triangle, *triangle_material; /* 3*triangles; triangles */
    uint32_t *pin, *seam;                   /* room for all vertices; room for 2*vertices pairs */
    drape_material material[SCENE_MATERIALS];
    double curve[2 * SCENE_CURVE_POINTS]; /* the points of the one curve that a fabric may have */
    drape_body body[SCENE_BODIES];
    double *body_position; /* of the one mesh body; NULL if none */
    uint32_t *body_triangle;
    drape_options options; /* the case may set time_step and fit; the rest is the method's */
};

enum expectation {
    MUST_RUN,
    MUST_REFUSE, /* with DRAPE_EINVAL, naming the place and the member */
    MAY_CROSS,   /* run; parts that start in one and the same place may leave it on any side */
    MAY_REFUSE,  /* with DRAPE_EINVAL anywhere; else run as any other */
};

enum group {
    IN_MATERIAL,
    IN_STEP,
    IN_MESH,
    IN_START,
    IN_GRAVITY,
    IN_SEAMS,
    IN_BODIES,
    IN_LAYERS,
    IN_REFUSALS,
    GROUPS
};

struct stability_case {
    enum group group;
    const char *name;
    void (*make)(struct scene *scene, double value);
    double value;
    enum expectation expectation;
    drape_place place;  /* MUST_REFUSE */
    const char *member; /* MUST_REFUSE; NULL: none */
    bool large;         /* left out of the short form; its runs are cut to a few iterations */
};

extern const struct stability_case stability_case[];
extern const size_t stability_cases;
extern const char *const group_name[GROUPS];

/* Leaves the case's scene in *scene; release it with scene_done. Fails an assertion when memory runs out. */
void scene_make(const struct stability_case *which, struct scene *scene);
void scene_done(struct scene *scene);

#endif
