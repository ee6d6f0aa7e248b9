/* surface.c - allocation, joining and normals of triangle meshes. */
#include "surface.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

int surface_new(size_t vertices, size_t triangles, bool with_pattern, struct surface *ret)
{
    if (vertices > SURFACE_MAX || triangles > SURFACE_MAX) {
        return -1;
    }
    struct surface made = {.vertices = vertices, .triangles = triangles};
    /* one entry more than asked, so that an empty surface is not mistaken for a failure */
    made.positions = calloc(3 * vertices + 1, sizeof *made.positions);
    made.triangle = calloc(3 * triangles + 1, sizeof *made.triangle);
    made.pattern = with_pattern ? calloc(2 * vertices + 1, sizeof *made.pattern) : NULL;
    if (!made.positions || !made.triangle || (with_pattern && !made.pattern)) {
        surface_done(&made);
        return -1;
    }
    *ret = made;
    return 0;
}

void surface_done(struct surface *surface)
{
    free(surface->positions);
    free(surface->pattern);
    free(surface->value);
    free(surface->triangle);
    *surface = (struct surface){0};
}

int surface_append(struct surface *whole, const struct surface *part)
{
    bool with_pattern = whole->pattern || (part->pattern && whole->vertices == 0);
    struct surface joined;
    if (surface_new(whole->vertices + part->vertices, whole->triangles + part->triangles, with_pattern,
                    &joined) < 0) {
        return -1;
    }
    size_t base = whole->vertices;
    if (base > 0) {
        memcpy(joined.positions, whole->positions, 3 * base * sizeof *joined.positions);
        memcpy(joined.triangle, whole->triangle, 3 * whole->triangles * sizeof *joined.triangle);
    }
    memcpy(joined.positions + 3 * base, part->positions, 3 * part->vertices * sizeof *joined.positions);
    if (with_pattern && whole->pattern) {
        memcpy(joined.pattern, whole->pattern, 2 * base * sizeof *joined.pattern);
    }
    if (with_pattern && part->pattern) {
        memcpy(joined.pattern + 2 * base, part->pattern, 2 * part->vertices * sizeof *joined.pattern);
    }
    for (size_t i = 0; i < 3 * part->triangles; i++) {
        joined.triangle[3 * whole->triangles + i] = part->triangle[i] + (uint32_t)base;
    }
    surface_done(whole);
    *whole = joined;
    return 0;
}

/* Cross product of two edges: twice the area, along the normal. */
static void triangle_normal(const double *a, const double *b, const double *c, double normal[3])
{
    double p[3], q[3];
    for (int k = 0; k < 3; k++) {
        p[k] = b[k] - a[k];
        q[k] = c[k] - a[k];
    }
    normal[0] = p[1] * q[2] - p[2] * q[1];
    normal[1] = p[2] * q[0] - p[0] * q[2];
    normal[2] = p[0] * q[1] - p[1] * q[0];
}

static int compare_places(const void *a, const void *b, void *positions)
{
    const double *x = (const double *)positions + 3 * (size_t) * (const uint32_t *)a;
    const double *y = (const double *)positions + 3 * (size_t) * (const uint32_t *)b;
    for (int k = 0; k < 3; k++) {
        if (x[k] != y[k]) {
            return x[k] < y[k] ? -1 : 1;
        }
    }
    return 0;
}

/* Gives vertices at the same place the sum of what each has (3*vertices); 0 or -1 (memory). */
static int share_at_same_place(const struct surface *surface, double *sum)
{
    size_t n = surface->vertices;
    uint32_t *order = malloc((n + 1) * sizeof *order);
    if (!order) {
        return -1;
    }
    for (size_t i = 0; i < n; i++) {
        order[i] = (uint32_t)i;
    }
    qsort_r(order, n, sizeof *order, compare_places, surface->positions);
    for (size_t first = 0, end; first < n; first = end) {
        double total[3] = {0};
        for (end = first; end < n && compare_places(&order[first], &order[end], surface->positions) == 0;
             end++) {
            for (int k = 0; k < 3; k++) {
                total[k] += sum[3 * (size_t)order[end] + (size_t)k];
            }
        }
        for (size_t i = first; i < end; i++) {
            memcpy(sum + 3 * (size_t)order[i], total, sizeof total);
        }
    }
    free(order);
    return 0;
}

static void add_triangle_normals(const struct surface *surface, double *sum)
{
    const double *x = surface->positions;
    for (size_t t = 0; t < surface->triangles; t++) {
        const uint32_t *v = surface->triangle + 3 * t;
        double normal[3];
        triangle_normal(x + 3 * (size_t)v[0], x + 3 * (size_t)v[1], x + 3 * (size_t)v[2], normal);
        for (int corner = 0; corner < 3; corner++) {
            for (int k = 0; k < 3; k++) {
                sum[3 * (size_t)v[corner] + (size_t)k] += normal[k];
            }
        }
    }
}

float *surface_normals(const struct surface *surface)
{
    double *sum = calloc(3 * surface->vertices + 1, sizeof *sum);
    float *normals = calloc(3 * surface->vertices + 1, sizeof *normals);
    if (!sum || !normals) {
        goto failed;
    }
    add_triangle_normals(surface, sum);
    if (share_at_same_place(surface, sum) < 0) {
        goto failed;
    }
    for (size_t i = 0; i < surface->vertices; i++) {
        const double *s = sum + 3 * i;
        double length = sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
        for (size_t k = 0; k < 3; k++) {
            normals[3 * i + k] = length > 0 ? (float)(s[k] / length) : 0;
        }
    }
    free(sum);
    return normals;
failed:
    free(sum);
    free(normals);
    return NULL;
}
