/* weld.c - see weld.h. */
#include "weld.h"

#include <stdlib.h>

/* By place, those at the same place by number. */
static int compare_places(const void *left, const void *right, void *data)
{
    const uint32_t a = *(const uint32_t *)left, b = *(const uint32_t *)right;
    const double *x = (const double *)data + 3 * (size_t)a, *y = (const double *)data + 3 * (size_t)b;
    for (int k = 0; k < 3; k++)
        if (x[k] != y[k])
            return x[k] < y[k] ? -1 : 1;
    return a < b ? -1 : a > b;
}

static bool same_place(const struct mesh *mesh, uint32_t a, uint32_t b)
{
    const double *x = mesh->positions + 3 * (size_t)a, *y = mesh->positions + 3 * (size_t)b;
    return x[0] == y[0] && x[1] == y[1] && x[2] == y[2];
}

/* For each vertex the first at its place, malloc'd; *ret_split tells whether any differs. */
static uint32_t *find_firsts(const struct mesh *mesh, bool *ret_split)
{
    uint32_t *order = malloc(mesh->vertices * sizeof *order);
    uint32_t *first = malloc(mesh->vertices * sizeof *first);
    *ret_split = false;
    if (order == NULL || first == NULL) {
        free(order);
        free(first);
        return NULL;
    }
    for (size_t i = 0; i < mesh->vertices; i++)
        order[i] = (uint32_t)i;
    qsort_r(order, mesh->vertices, sizeof *order, compare_places, mesh->positions);
    for (size_t i = 0; i < mesh->vertices; i++) {
        bool again = i > 0 && same_place(mesh, order[i], order[i - 1]);
        first[order[i]] = again ? first[order[i - 1]] : order[i];
        *ret_split |= again;
    }
    free(order);
    return first;
}

static int compare_edges(const void *left, const void *right)
{
    uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return a < b ? -1 : a > b;
}

/* Whether two triangles have each edge: 1, 0, or -1 when out of memory. */
static int is_closed(const struct mesh *mesh)
{
    size_t n = 3 * mesh->triangles;
    uint64_t *edge = malloc(n * sizeof *edge);
    if (edge == NULL)
        return -1;
    for (size_t i = 0; i < n; i++) {
        uint32_t a = mesh->triangle[i], b = mesh->triangle[i % 3 == 2 ? i - 2 : i + 1];
        edge[i] = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    }
    qsort(edge, n, sizeof *edge, compare_edges);
    bool closed = n % 2 == 0;
    for (size_t i = 0; closed && i < n; i += 2)
        closed = edge[i] == edge[i + 1] && (i + 2 == n || edge[i + 2] != edge[i]);
    free(edge);
    return closed;
}

int weld_body(struct mesh *mesh)
{
    bool split;
    uint32_t *first = find_firsts(mesh, &split);
    if (first == NULL)
        return -1;
    int closed = split ? is_closed(mesh) : 1;
    for (size_t i = 0; closed == 0 && i < 3 * mesh->triangles; i++)
        mesh->triangle[i] = first[mesh->triangle[i]];
    free(first);
    return closed < 0 ? -1 : 0;
}
