/* meshref.h - uploaded meshes, from the store to the job documents that name them. */
#ifndef DRAPED_MESHREF_H
#define DRAPED_MESHREF_H

#include "limits.h"
#include "meshfile.h"
#include "store.h"

struct meshref { /* the `data` of meshref_load */
    struct store *store;
    const char *owner; /* whose meshes */
    const struct limits *limits;
};

/* A schema_mesh_fn: 0, or -1 with *reterr filled (PROBLEM_INVALID when there is no such mesh). */
int meshref_load(const char *sha256, struct mesh *ret, struct problem *reterr, void *data);

#endif
