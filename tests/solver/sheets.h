/* sheets.h - cloth meshes for tests of what is near what: layers of sheets, and garments from OBJ files. */
#ifndef DRAPED_TEST_SHEETS_H
#define DRAPED_TEST_SHEETS_H

#include "mesh.h"
#include "shapes.h"

/* The mesh of a list of triangles; where its nodes lie at rest does not matter here. */
static inline struct dr_mesh *sheets_mesh(size_t nodes, size_t triangles, const uint32_t *triangle)
{
    static const double pattern[] = {0, 0, 1, 0, 0, 1}, density[] = {0.2};
    uint32_t *corner = calloc(3 * triangles + 1, sizeof *corner);
    struct dr_mesh *mesh = NULL;
    drape_error error = {0};
    assert_non_null(corner);
    for (size_t i = 0; i < 3 * triangles; i++)
        corner[i] = (uint32_t)(i % 3);
    if (dr_mesh_new(nodes, triangles, triangle, corner, pattern, NULL, density, NULL, &mesh, &error) < 0)
        fail_msg("%s", error.message);
    free(corner);
    return mesh;
}

/* `layers` flat sheets of n x n squares (two triangles each) of `side`, `apart` above each other in y, as one
 * shape. */
static inline struct shape sheets_stack(size_t n, size_t layers, double side, double apart)
{
    size_t row = n + 1, per = row * row, t = 0;
    struct shape shape = shape_new(layers * per, 2 * n * n * layers);
    for (size_t v = 0; v < shape.vertices; v++) {
        shape.x[3 * v] = side * (double)(v % per % row);
        shape.x[3 * v + 1] = apart * (double)(v / per);
        shape.x[3 * v + 2] = side * (double)(v % per / row);
    }
    for (size_t l = 0; l < layers; l++) {
        for (size_t i = 0; i < n * n; i++) {
            uint32_t a = (uint32_t)(l * per + i / n * row + i % n), b = a + 1, c = a + (uint32_t)row,
                     d = c + 1;
            const uint32_t corner[2][6] = {{a, c, b, b, c, d}, {a, c, d, a, d, b}};
            memcpy(shape.triangle + 3 * t, corner[i % 2], sizeof corner[0]);
            t += 2;
        }
    }
    return shape;
}

/* Moves every coordinate by up to `size`. */
static inline void sheets_shake(struct shape *shape, double size, uint64_t *random)
{
    for (size_t i = 0; i < 3 * shape->vertices; i++)
        shape->x[i] += size * test_random(random);
}

static inline uint32_t sheets_root(const uint32_t *parent, uint32_t v)
{
    while (parent[v] != v)
        v = parent[v];
    return v;
}

/* Reads `<path>.obj` and welds what `<path>.seams` pairs (lines "i j stitch", counted from 1), each at its
 * mean position; vertices in no triangle stay as loose nodes. False, loudly, when a file is absent. */
static inline bool sheets_garment(const char *path, struct shape *ret)
{
    char name[256], line[256];
    snprintf(name, sizeof name, "%s.obj", path);
    if (!shape_read(name, ret))
        return false;
    snprintf(name, sizeof name, "%s.seams", path);
    FILE *file = fopen(name, "r");
    uint32_t *parent = calloc(ret->vertices, sizeof *parent);
    double *sum = calloc(4 * ret->vertices, sizeof *sum);
    assert_non_null(file);
    assert_non_null(parent);
    assert_non_null(sum);
    for (uint32_t v = 0; v < ret->vertices; v++)
        parent[v] = v;
    for (unsigned i, j; fgets(line, sizeof line, file);)
        if (sscanf(line, "%u %u", &i, &j) == 2)
            parent[sheets_root(parent, i - 1)] = sheets_root(parent, j - 1);
    fclose(file);
    for (uint32_t v = 0; v < ret->vertices; v++) {
        double *to = sum + 4 * (size_t)sheets_root(parent, v);
        for (size_t d = 0; d < 3; d++)
            to[d] += ret->x[3 * (size_t)v + d];
        to[3] += 1;
    }
    for (uint32_t v = 0; v < ret->vertices; v++)
        for (size_t d = 0; d < 3; d++)
            ret->x[3 * (size_t)v + d] =
                sum[4 * (size_t)sheets_root(parent, v) + d] / sum[4 * (size_t)sheets_root(parent, v) + 3];
    for (size_t i = 0; i < 3 * ret->triangles; i++)
        ret->triangle[i] = sheets_root(parent, ret->triangle[i]);
    free(parent);
    free(sum);
    return true;
}

#endif
