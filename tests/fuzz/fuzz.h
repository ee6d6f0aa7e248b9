/* fuzz.h - what the fuzzers of mesh files share: parse, and check what a caller may rely on. */
#ifndef DRAPED_FUZZ_H
#define DRAPED_FUZZ_H

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "meshfile.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Stops the fuzzer, which then keeps the input. */
static inline void fuzz_require(int condition)
{
    if (!condition)
        abort();
}

static inline void fuzz_check_mesh(const struct mesh *mesh)
{
    fuzz_require(mesh->vertices > 0 && mesh->triangles > 0);
    for (size_t i = 0; i < 3 * mesh->triangles; i++)
        fuzz_require(mesh->triangle[i] < mesh->vertices);
    for (size_t i = 0; i < 3 * mesh->vertices; i++)
        fuzz_require(isfinite(mesh->positions[i]));
    for (size_t i = 0; mesh->pattern && i < 2 * mesh->vertices; i++)
        fuzz_require(isfinite(mesh->pattern[i]));
}

static inline int fuzz_mesh(enum mesh_format format, const uint8_t *data, size_t size)
{
    struct mesh mesh = {0};
    struct problem problem = {0};
    if (meshfile_parse(format, data, size, &limits_default, &mesh, &problem) == 0)
        fuzz_check_mesh(&mesh);
    else
        fuzz_require(problem.code != PROBLEM_NONE && problem.detail[0] != '\0');
    mesh_done(&mesh);
    return 0;
}

#endif
