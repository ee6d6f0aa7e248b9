/* check_surface.h - measures that several tests take of a triangle mesh. */
#ifndef DRAPE_TEST_CHECK_SURFACE_H
#define DRAPE_TEST_CHECK_SURFACE_H

#include "surface.h"
#include "test.h"

struct edge_use {
    uint32_t low, high;
    int forward, backward;
};

static inline int edge_order(const void *a, const void *b)
{
    const struct edge_use *p = a, *q = b;
    if (p->low != q->low) {
        return p->low < q->low ? -1 : 1;
    }
    return p->high < q->high ? -1 : p->high > q->high;
}

/* Every distinct edge once, with how often it is run in each direction; to be freed. */
static inline struct edge_use *surface_edges(const struct surface *s, size_t *ret_count)
{
    size_t n = 3 * s->triangles, kept = 0;
    struct edge_use *edge = calloc(n, sizeof *edge);
    assert_non_null(edge);
    for (size_t t = 0; t < s->triangles; t++) {
        for (size_t k = 0; k < 3; k++) {
            uint32_t a = s->triangle[3 * t + k], b = s->triangle[3 * t + (k + 1) % 3];
            assert_true(a < s->vertices && a != b);
            edge[3 * t + k] = (struct edge_use){a < b ? a : b, a < b ? b : a, a<b, a> b};
        }
    }
    qsort(edge, n, sizeof *edge, edge_order);
    for (size_t i = 0; i < n; i++) {
        if (kept > 0 && edge_order(&edge[kept - 1], &edge[i]) == 0) {
            edge[kept - 1].forward += edge[i].forward;
            edge[kept - 1].backward += edge[i].backward;
        } else {
            edge[kept++] = edge[i];
        }
    }
    *ret_count = kept;
    return edge;
}

/* 4 sqrt(3) area / (sum of squared sides): 1 for an equilateral triangle, 0 for a degenerate one. */
static inline double triangle_quality(const double *a, const double *b, const double *c, size_t dimensions)
{
    double p[3] = {0}, q[3] = {0}, squares = 0;
    for (size_t k = 0; k < dimensions; k++) {
        p[k] = b[k] - a[k];
        q[k] = c[k] - a[k];
        squares += p[k] * p[k] + q[k] * q[k] + (c[k] - b[k]) * (c[k] - b[k]);
    }
    double x = p[1] * q[2] - p[2] * q[1], y = p[2] * q[0] - p[0] * q[2], z = p[0] * q[1] - p[1] * q[0];
    double area = sqrt(x * x + y * y + z * z) / 2;
    return 4 * sqrt(3) * area / squares;
}

static inline double worst_quality(const struct surface *s, bool of_pattern)
{
    const double *x = of_pattern ? s->pattern : s->positions;
    size_t d = of_pattern ? 2 : 3;
    double worst = 1;
    for (size_t t = 0; t < s->triangles; t++) {
        const uint32_t *v = s->triangle + 3 * t;
        worst = fmin(worst, triangle_quality(x + d * v[0], x + d * v[1], x + d * v[2], d));
    }
    return worst;
}

static inline double pattern_area(const struct surface *s, double *ret_smallest)
{
    double sum = 0, smallest = INFINITY;
    for (size_t t = 0; t < s->triangles; t++) {
        const uint32_t *v = s->triangle + 3 * t;
        const double *a = s->pattern + 2 * v[0], *b = s->pattern + 2 * v[1], *c = s->pattern + 2 * v[2];
        double area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2;
        sum += area;
        smallest = fmin(smallest, area);
    }
    *ret_smallest = smallest;
    return sum;
}

#endif
