/* meshfile.h - OBJ, PLY, GLB and JSON meshes in and out. Knows no jobs, no sockets. */
#ifndef DRAPED_MESHFILE_H
#define DRAPED_MESHFILE_H

#include <stdint.h>
#include <stdio.h>

#include "jsontext.h"
#include "limits.h"
#include "problem.h"

enum mesh_format { MESH_OBJ = 0, MESH_PLY, MESH_GLB, MESH_JSON, MESH_FORMATS };

const char *mesh_format_name(enum mesh_format format);       /* "obj" */
const char *mesh_format_media_type(enum mesh_format format); /* "model/obj", "model/gltf-binary", ... */
/* From a Content-Type (parameters ignored) or a bare name; -1: unknown. */
int mesh_format_from_media_type(const char *media_type);
int mesh_format_from_name(const char *name);

struct mesh {           /* owns its arrays; zero-initialise */
    double *positions;  /* 3*vertices */
    uint32_t *triangle; /* 3*triangles */
    double *pattern;    /* 2*vertices, or NULL when the file has none */
    size_t vertices, triangles;
};

void mesh_done(struct mesh *mesh); /* empties without freeing the struct */

/* 0, or -1 with *reterr filled; a syntax error names the line or byte, a bad index the face. */
int meshfile_parse(enum mesh_format format, const void *data, size_t bytes, const struct limits *limits,
                   struct mesh *ret, struct problem *reterr);

/* JSON mesh {"positions","triangles","pattern"?}, `object` a part of `json`, where `pointer` leads. */
int meshfile_from_json(const struct jsontext *json, const json_t *object, const char *pointer,
                       const struct limits *limits, struct mesh *ret, struct problem *reterr);

struct fitmap; /* fitmap.h */

/* Writers; `normals` (3*vertices, float32 precision is enough) and `fit` may be NULL. 0 or -1 (errno). */
int meshfile_write_obj(FILE *file, const struct mesh *mesh, const double *normals);
int meshfile_write_ply(FILE *file, const struct mesh *mesh, const double *normals, const struct fitmap *fit);
int meshfile_write_glb(FILE *file, const struct mesh *mesh, const double *normals, const struct fitmap *fit,
                       const char *name);
int meshfile_write_json(FILE *file, const struct mesh *mesh); /* what meshfile_from_json reads */
/* A mesh and no more, in any format: numbers of 9 digits, or 32 bits in PLY and GLB. */
int meshfile_write(enum mesh_format format, FILE *file, const struct mesh *mesh);

#endif
