/* schema.h - job documents (JSON) to scene descriptions and options, and reports back to JSON.
 * Knows no sockets and no store; errors name the member by JSON pointer. */
#ifndef DRAPED_SCHEMA_H
#define DRAPED_SCHEMA_H

#include "drape.h"
#include "id.h"
#include "limits.h"
#include "lines.h"
#include "meshfile.h"
#include "problem.h"

struct job_spec {             /* owns everything it points to */
    char name[201];           /* "" when absent */
    json_t *labels;           /* object of strings, or NULL */
    int priority;             /* enum job_priority of job.h; 0 when absent */
    char start_from[ID_SIZE]; /* the job at whose result this one begins; "": none */
    struct mesh cloth;        /* positions, triangles, pattern */
    uint32_t *seam, *pin, *triangle_material;
    drape_material *material;
    double **curve; /* 3*materials: points of a weft, warp, shear curve; NULL where it is a number */
    drape_elastic *elastic;
    drape_fold *fold;
    uint32_t **elastic_edge, **fold_edge; /* elastics, folds: the edges of each */
    drape_tack *tack;
    struct mesh *body_mesh; /* one per body, empty unless it is a mesh */
    struct motion {
        struct mesh *mesh;        /* keyframes; their triangles NULL where not given */
        const double **positions; /* keyframes: those of the meshes */
        size_t keyframes;
    } * motion; /* one per body, empty where it stands */
    drape_body *body;
    struct lines *lines;           /* to be measured, joined; NULL: none */
    double *start, *start_pattern; /* 3*, 2*vertices: that result and its pattern, see start.h; NULL: none */
    drape_scene_desc scene;        /* points into the arrays above */
    drape_options options;         /* progress left NULL */
    json_t *warnings;              /* array of {pointer, detail}: see drape_scene_warnings; NULL: none */
};

/* Loads the mesh uploaded under `sha256` (64 hex digits) into *ret; 0, or -1 with *reterr filled. */
typedef int schema_mesh_fn(const char *sha256, struct mesh *ret, struct problem *reterr, void *data);

/* Checks the scene again, after its start was put in. 0, or -1 and *reterr. */
int schema_scene_check(struct job_spec *spec, struct problem *reterr);

/* Parses and checks a whole job (the document is described in openapi.json): syntax, depth and counts, types,
 * unknown members, ranges, then drape_scene_check. 0 and *ret, or -1 and *reterr. Thread-safe. */
int schema_job_parse(const char *text, size_t bytes, const struct limits *limits, schema_mesh_fn *load_mesh,
                     void *data, struct job_spec **ret, struct problem *reterr);
struct job_spec *job_spec_free(struct job_spec *spec); /* NULL is fine; returns NULL */

/* Turns the solver's error into a problem with the JSON pointer of the place at fault. Returns -1. */
int schema_solver_problem(const drape_error *error, struct problem *reterr);

/* What residual energies are worth: "reference", E - E* of the certified minimum, or "estimate", half the
 * Newton decrement. Static string. */
const char *schema_residual_energy_is(bool reference);

/* New references, NULL when out of memory; non-finite numbers become null. */
json_t *schema_energies_json(const drape_energies *energies);
json_t *schema_progress_json(const drape_progress *progress, const drape_options *options);
json_t *schema_report_json(const drape_report *report, json_t *lines); /* takes `lines`; NULL: none */
json_t *schema_lines_json(const struct lines *lines, const struct line_length *length);
json_t *schema_materials_json(void); /* the presets, each with its source */

#endif
