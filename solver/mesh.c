/* mesh.c - building the mesh of nodes: rest frames, gradients, masses and neighbours. */
#include "mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

/* A triangle flatter than this (least altitude over longest side) has no usable rest frame: its
 * gradients would lose six digits. Slivers of 1:1000 are far on the good side. */
#define MIN_ALTITUDE_RATIO 1e-6

/* One side of a triangle, for sorting sides that belong together next to each other. */
struct side {
    uint32_t low, high; /* nodes, low < high */
    uint32_t triangle;
    uint8_t corner; /* opposite this side */
};

static int compare_sides(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    if (a->high != b->high)
        return a->high < b->high ? -1 : 1;
    if (a->triangle != b->triangle)
        return a->triangle < b->triangle ? -1 : 1;
    return (int)a->corner - (int)b->corner;
}

/* Two triangles that share two edges share all corners: the same one twice, or a piece of one triangle sewn
 * onto another. */
static drape_status refuse_twins(const struct dr_mesh *mesh, drape_error *reterr)
{
    for (size_t t = 0; t < mesh->triangles; t++) {
        const uint32_t *next = mesh->neighbor + 3 * t;
        for (int k = 0; k < 3; k++)
            if (next[k] < t && next[k] == next[(k + 1) % 3])
                return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_TRIANGLE, (int64_t)t,
                               "it has the same corners as triangle %u", next[k]);
    }
    return DRAPE_OK;
}

/* Pairs the triangles' sides. An edge of three or more triangles is not a surface. */
static drape_status find_neighbors(struct dr_mesh *mesh, drape_error *reterr)
{
    size_t count = 3 * mesh->triangles;
    struct side *side = malloc(count * sizeof *side);
    if (!side)
        return dr_out_of_memory(reterr);
    for (size_t t = 0; t < mesh->triangles; t++) {
        const uint32_t *node = mesh->triangle + 3 * t;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t a = node[(k + 1) % 3], b = node[(k + 2) % 3];
            side[3 * t + k] = (struct side){a < b ? a : b, a < b ? b : a, (uint32_t)t, (uint8_t)k};
        }
    }
    qsort(side, count, sizeof *side, compare_sides);

    drape_status status = DRAPE_OK;
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1; end < count && side[end].low == side[i].low && side[end].high == side[i].high;
             end++)
            continue;
        if (end - i > 2) {
            status = dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_TRIANGLE, side[i + 2].triangle,
                             "one edge is shared by %zu triangles (the first is triangle %u): not a surface",
                             end - i, side[i].triangle);
            break;
        }
        if (end - i == 2) {
            const struct side *a = side + i, *b = side + i + 1;
            mesh->neighbor[3 * a->triangle + a->corner] = b->triangle;
            mesh->across[3 * a->triangle + a->corner] = b->corner;
            mesh->neighbor[3 * b->triangle + b->corner] = a->triangle;
            mesh->across[3 * b->triangle + b->corner] = a->corner;
        }
    }
    free(side);
    return status;
}

/* Rest coordinates (relative to the first corner), area and barycentric gradients of triangle t. */
static drape_status measure_triangle(struct dr_mesh *mesh, size_t t, const uint32_t *corner_vertex,
                                     const double *pattern, drape_error *reterr)
{
    const uint32_t *node = mesh->triangle + 3 * t;
    double *rest = mesh->rest + 6 * t, *grad = mesh->grad + 6 * t;
    if (node[0] == node[1] || node[1] == node[2] || node[2] == node[0])
        return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_TRIANGLE, (int64_t)t,
                       "two corners are the same point (node %u %u %u)", node[0], node[1], node[2]);
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 2; d++)
            rest[2 * k + d] =
                pattern[2 * corner_vertex[3 * t + k] + d] - pattern[2 * corner_vertex[3 * t] + d];

    double twice = rest[2] * rest[5] - rest[4] * rest[3]; /* signed */
    double longest = 0;                                   /* squared */
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3;
        double du = rest[2 * next] - rest[2 * k], dv = rest[2 * next + 1] - rest[2 * k + 1];
        longest = fmax(longest, du * du + dv * dv);
    }
    if (!isfinite(twice) || !isfinite(longest) || fabs(twice) <= MIN_ALTITUDE_RATIO * longest)
        return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_TRIANGLE, (int64_t)t,
                       "the rest shape is degenerate: area %.3g m^2 on a longest side of %.3g m",
                       fabs(twice) / 2, sqrt(longest));

    mesh->area[t] = fabs(twice) / 2;
    for (int k = 0; k < 3; k++) { /* grad of barycentric k: the opposite side turned by 90 degrees, over 2A */
        int b = (k + 1) % 3, c = (k + 2) % 3;
        grad[2 * k] = (rest[2 * b + 1] - rest[2 * c + 1]) / twice;
        grad[2 * k + 1] = (rest[2 * c] - rest[2 * b]) / twice;
    }
    return DRAPE_OK;
}

static bool allocate(struct dr_mesh *mesh)
{
    size_t n = mesh->nodes, t = mesh->triangles;
    mesh->triangle = malloc(3 * t * sizeof *mesh->triangle);
    mesh->rest = malloc(6 * t * sizeof *mesh->rest);
    mesh->area = malloc(t * sizeof *mesh->area);
    mesh->grad = malloc(6 * t * sizeof *mesh->grad);
    mesh->neighbor = malloc(3 * t * sizeof *mesh->neighbor);
    mesh->across = calloc(3 * t, sizeof *mesh->across);
    mesh->material = calloc(t, sizeof *mesh->material);
    mesh->held = calloc(n, sizeof *mesh->held);
    mesh->mass = calloc(n, sizeof *mesh->mass);
    return mesh->triangle && mesh->rest && mesh->area && mesh->grad && mesh->neighbor && mesh->across &&
           mesh->material && mesh->held && mesh->mass;
}

drape_status dr_mesh_new(size_t nodes, size_t triangles, const uint32_t *triangle,
                         const uint32_t *corner_vertex, const double *pattern, const uint32_t *material,
                         const double *density, const bool *held, struct dr_mesh **ret, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    struct dr_mesh *mesh = calloc(1, sizeof *mesh);
    if (!mesh)
        return dr_out_of_memory(reterr);
    mesh->nodes = nodes;
    mesh->triangles = triangles;
    if (!allocate(mesh)) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    memcpy(mesh->triangle, triangle, 3 * triangles * sizeof *triangle);
    memset(mesh->neighbor, 0xff, 3 * triangles * sizeof *mesh->neighbor); /* DR_NONE */
    if (material)
        memcpy(mesh->material, material, triangles * sizeof *material);
    if (held)
        memcpy(mesh->held, held, nodes * sizeof *held);

    for (size_t t = 0; t < triangles; t++) {
        status = measure_triangle(mesh, t, corner_vertex, pattern, reterr);
        if (status < 0)
            goto cleanup;
        for (int k = 0; k < 3; k++)
            mesh->mass[triangle[3 * t + k]] += mesh->area[t] * density[mesh->material[t]] / 3;
    }
    if ((status = find_neighbors(mesh, reterr)) < 0 || (status = refuse_twins(mesh, reterr)) < 0)
        goto cleanup;
    *ret = mesh;
    mesh = NULL;

cleanup:
    dr_mesh_free(mesh);
    return status;
}

void dr_mesh_shrink(struct dr_mesh *mesh, const double *factor)
{
    for (size_t t = 0; t < mesh->triangles; t++) {
        const double *f = factor + 2 * (size_t)mesh->material[t];
        mesh->area[t] *= f[0] * f[1];
        for (size_t i = 0; i < 6; i++) {
            mesh->rest[6 * t + i] *= f[i % 2];
            mesh->grad[6 * t + i] /= f[i % 2];
        }
    }
}

double dr_mesh_area(const struct dr_mesh *mesh)
{
    double area = 0;
    for (size_t t = 0; t < mesh->triangles; t++)
        area += mesh->area[t];
    return area;
}

double dr_mesh_edge(const struct dr_mesh *mesh)
{
    return sqrt(4 / sqrt(3) * dr_mesh_area(mesh) / (double)mesh->triangles);
}

struct dr_mesh *dr_mesh_free(struct dr_mesh *mesh)
{
    if (mesh) {
        free(mesh->triangle);
        free(mesh->rest);
        free(mesh->area);
        free(mesh->grad);
        free(mesh->neighbor);
        free(mesh->across);
        free(mesh->material);
        free(mesh->held);
        free(mesh->mass);
        free(mesh);
    }
    return NULL;
}

size_t dr_mesh_bytes(const struct dr_mesh *mesh)
{
    size_t per_triangle = 3 * sizeof *mesh->triangle + 6 * sizeof *mesh->rest + sizeof *mesh->area +
                          6 * sizeof *mesh->grad + 3 * sizeof *mesh->neighbor + 3 * sizeof *mesh->across +
                          sizeof *mesh->material;
    return sizeof *mesh + mesh->triangles * per_triangle +
           mesh->nodes * (sizeof *mesh->held + sizeof *mesh->mass);
}
