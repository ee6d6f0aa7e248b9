/* meshref.h - uploaded meshes, from the store to the job documents that name them. */
#ifndef DRAPED_MESHREF_H
#define DRAPED_MESHREF_H

#include "limits.h"
#include "meshfile.h"
#include "store.h"

struct meshref_list { /* digests, each once; owns them; zero-initialise */
    char (*sha256)[SHA256_SIZE];
    size_t count, room;
};

void meshref_list_done(struct meshref_list *list);

struct meshref { /* the `data` of meshref_load */
    struct store *store;
    const char *owner; /* whose meshes */
    const struct limits *limits;
    struct meshref_list *loaded; /* gets what is loaded; NULL: not wanted */
};

/* A schema_mesh_fn: 0, or -1 with *reterr filled (PROBLEM_INVALID when there is no such mesh). */
int meshref_load(const char *sha256, struct mesh *ret, struct problem *reterr, void *data);

#endif
