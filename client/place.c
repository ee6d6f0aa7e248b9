/* place.c - see place.h. */
#include "place.h"

#include <math.h>
#include <stdlib.h>

/* Level part of a mean normal, in parts of all of it, below which it counts as upright. */
#define UPRIGHT 1e-6

void place_scale(struct surface *garment, double factor)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < 3 * garment->vertices; i++) {
        low[i % 3] = fmin(low[i % 3], garment->positions[i]);
        high[i % 3] = fmax(high[i % 3], garment->positions[i]);
    }
    for (size_t i = 0; i < 3 * garment->vertices; i++) {
        double middle = (low[i % 3] + high[i % 3]) / 2;
        garment->positions[i] = middle + factor * (garment->positions[i] - middle);
    }
    for (size_t i = 0; i < 2 * garment->vertices; i++) {
        garment->pattern[i] *= factor;
    }
}

static uint32_t find_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

/* The piece of each vertex, named by one of its vertices. */
static void find_pieces(const struct surface *garment, uint32_t *piece)
{
    for (size_t i = 0; i < garment->vertices; i++) {
        piece[i] = (uint32_t)i;
    }
    for (size_t t = 0; t < garment->triangles; t++) {
        for (size_t k = 1; k < 3; k++) {
            uint32_t a = find_root(piece, garment->triangle[3 * t]),
                     b = find_root(piece, garment->triangle[3 * t + k]);
            piece[b] = a;
        }
    }
    for (size_t i = 0; i < garment->vertices; i++) {
        piece[i] = find_root(piece, (uint32_t)i);
    }
}

/* Adds each triangle's normal, weighted by its area, to its piece's (3*vertices, zero before). */
static void sum_normals(const struct surface *garment, const uint32_t *piece, double *normal)
{
    for (size_t t = 0; t < garment->triangles; t++) {
        const uint32_t *corner = garment->triangle + 3 * t;
        const double *a = garment->positions + 3 * (size_t)corner[0],
                     *b = garment->positions + 3 * (size_t)corner[1],
                     *c = garment->positions + 3 * (size_t)corner[2];
        double *sum = normal + 3 * (size_t)piece[corner[0]];
        for (size_t k = 0; k < 3; k++) {
            size_t i = (k + 1) % 3, j = (k + 2) % 3;
            sum[k] += (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
        }
    }
}

int place_outwards(struct surface *garment, double way)
{
    uint32_t *piece = malloc((garment->vertices + 1) * sizeof *piece);
    double *normal = calloc(3 * garment->vertices + 1, sizeof *normal);
    int status = piece && normal ? 0 : -1;
    if (status == 0) {
        find_pieces(garment, piece);
        sum_normals(garment, piece, normal);
    }
    for (size_t i = 0; status == 0 && i < garment->vertices; i++) {
        const double *n = normal + 3 * (size_t)piece[i];
        double level = hypot(n[0], n[2]);
        if (level > UPRIGHT * fabs(n[1])) {
            garment->positions[3 * i] += way * n[0] / level;
            garment->positions[3 * i + 2] += way * n[2] / level;
        }
    }
    free(piece);
    free(normal);
    return status;
}
