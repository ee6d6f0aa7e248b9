/* mesher.c - hexagonal points inside an outline, Delaunay triangulation, a few rounds of smoothing.
 *
 * Incremental Delaunay triangulation (Bowyer 1981, Watson 1981): each point is found by walking from
 * the last triangle, the triangles whose circumcircle holds it are removed, and the hole is filled
 * with a fan. Interior points keep a distance from the outline, so its sides come out as edges; that
 * is checked, not assumed. */
#include "mesher.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Interior points nearer than this to the outline (in spacings) are left out. */
#define BORDER_DISTANCE 0.62
/* Amplitude of the pattern's disorder, in spacings: breaks ties between cocircular points, and the
 * mirror symmetry that would hold a drape on a saddle. */
#define JITTER 0.08
/* Rounds of moving points to the middle of their triangles; more changes little. */
#define SMOOTHING_ROUNDS 6
/* The surrounding triangle's size in outline sizes: far enough that straight outlines stay straight. */
#define SURROUNDING 1000.0

#define NONE UINT32_MAX

struct triangulation {
    const double *uv;      /* 2*(points + 3), borrowed; the last three surround all others */
    uint32_t (*corner)[3]; /* counter-clockwise */
    uint32_t (*across)[3]; /* neighbour opposite each corner; NONE at the rim */
    unsigned char *state;  /* per triangle: ALIVE or not, and the cavity mark */
    uint32_t *stack, *cavity, *free_list;
    uint32_t *fan_from; /* per vertex: the new triangle whose rim edge starts there */
    size_t used, free_count, capacity;
    uint32_t last; /* where the next walk starts */
};

enum { DEAD = 0, ALIVE = 1, IN_CAVITY = 2 };

double mesher_area(const double *outline, size_t points)
{
    double twice = 0;
    for (size_t i = 0, j = points - 1; i < points; j = i++) {
        twice += outline[2 * j] * outline[2 * i + 1] - outline[2 * i] * outline[2 * j + 1];
    }
    return twice / 2;
}

double mesher_spacing(double area, size_t triangles)
{
    return sqrt(area / (double)triangles * 4 / sqrt(3));
}

/* Twice the signed area of a, b, c. */
static double orient(const double *a, const double *b, const double *c)
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/* Positive when p lies inside the circle through a, b, c (counter-clockwise). */
static double in_circle(const double *a, const double *b, const double *c, const double *p)
{
    double ax = a[0] - p[0], ay = a[1] - p[1], bx = b[0] - p[0], by = b[1] - p[1];
    double cx = c[0] - p[0], cy = c[1] - p[1];
    return (ax * ax + ay * ay) * (bx * cy - by * cx) - (bx * bx + by * by) * (ax * cy - ay * cx) +
           (cx * cx + cy * cy) * (ax * by - ay * bx);
}

static const double *corner_uv(const struct triangulation *d, uint32_t t, int corner)
{
    return d->uv + 2 * (size_t)d->corner[t][corner];
}

static void triangulation_done(struct triangulation *d)
{
    free(d->corner);
    free(d->across);
    free(d->state);
    free(d->stack);
    free(d->cavity);
    free(d->free_list);
    free(d->fan_from);
}

/* n points give at most 2 n + 1 triangles; the hole of one insertion adds at most as many again
 * before its own are reused. */
static int triangulation_new(const double *uv, size_t points, struct triangulation *d)
{
    size_t n = 4 * points + 64;
    *d = (struct triangulation){.uv = uv, .capacity = n};
    d->corner = malloc(n * sizeof *d->corner);
    d->across = malloc(n * sizeof *d->across);
    d->state = calloc(n, sizeof *d->state);
    d->stack = malloc(n * sizeof *d->stack);
    d->cavity = malloc(n * sizeof *d->cavity);
    d->free_list = malloc(n * sizeof *d->free_list);
    d->fan_from = malloc((points + 3) * sizeof *d->fan_from);
    if (!d->corner || !d->across || !d->state || !d->stack || !d->cavity || !d->free_list || !d->fan_from) {
        triangulation_done(d);
        return -1;
    }
    for (uint32_t k = 0; k < 3; k++) {
        d->corner[0][k] = (uint32_t)points + k;
        d->across[0][k] = NONE;
    }
    d->state[0] = ALIVE;
    d->used = 1;
    return 0;
}

/* The triangle that holds p, by stepping over any edge that has p on its outer side. */
static uint32_t walk_to(const struct triangulation *d, const double *p)
{
    uint32_t t = d->last;
    for (size_t steps = 0; steps < d->used; steps++) {
        int k = 0;
        while (k < 3 && orient(corner_uv(d, t, (k + 1) % 3), corner_uv(d, t, (k + 2) % 3), p) >= 0) {
            k++;
        }
        if (k == 3 || d->across[t][k] == NONE) {
            break;
        }
        t = d->across[t][k];
    }
    return t;
}

/* Marks the triangles whose circle holds p, from the one that contains it outwards. */
static size_t find_cavity(struct triangulation *d, const double *p, uint32_t start)
{
    size_t found = 0, open = 0;
    d->stack[open++] = start;
    d->state[start] = IN_CAVITY;
    while (open > 0) {
        uint32_t t = d->stack[--open];
        d->cavity[found++] = t;
        for (int k = 0; k < 3; k++) {
            uint32_t n = d->across[t][k];
            if (n != NONE && d->state[n] == ALIVE &&
                in_circle(corner_uv(d, n, 0), corner_uv(d, n, 1), corner_uv(d, n, 2), p) > 0) {
                d->state[n] = IN_CAVITY;
                d->stack[open++] = n;
            }
        }
    }
    return found;
}

static uint32_t take_slot(struct triangulation *d)
{
    return d->free_count > 0 ? d->free_list[--d->free_count] : (uint32_t)d->used++;
}

static void replace_neighbour(struct triangulation *d, uint32_t t, uint32_t before, uint32_t now)
{
    for (int k = 0; t != NONE && k < 3; k++) {
        if (d->across[t][k] == before) {
            d->across[t][k] = now;
            return;
        }
    }
}

/* One new triangle over rim edge (a, b) of the cavity, with the point at corner 2. */
static uint32_t fan_triangle(struct triangulation *d, uint32_t a, uint32_t b, uint32_t point,
                             uint32_t outside, uint32_t before)
{
    uint32_t t = take_slot(d);
    d->corner[t][0] = a;
    d->corner[t][1] = b;
    d->corner[t][2] = point;
    d->across[t][2] = outside;
    replace_neighbour(d, outside, before, t);
    d->state[t] = ALIVE;
    d->fan_from[a] = t;
    return t;
}

static void insert_point(struct triangulation *d, uint32_t point)
{
    const double *p = d->uv + 2 * (size_t)point;
    size_t cavity = find_cavity(d, p, walk_to(d, p)), fan = 0;
    for (size_t i = 0; i < cavity; i++) {
        uint32_t t = d->cavity[i];
        for (int k = 0; k < 3; k++) {
            uint32_t outside = d->across[t][k];
            if (outside == NONE || d->state[outside] != IN_CAVITY) {
                d->stack[fan++] =
                    fan_triangle(d, d->corner[t][(k + 1) % 3], d->corner[t][(k + 2) % 3], point, outside, t);
            }
        }
    }
    for (size_t i = 0; i < fan; i++) {
        uint32_t t = d->stack[i], next = d->fan_from[d->corner[t][1]];
        d->across[t][0] = next;
        d->across[next][1] = t;
    }
    for (size_t i = 0; i < cavity; i++) {
        d->state[d->cavity[i]] = DEAD;
        d->free_list[d->free_count++] = d->cavity[i];
    }
    d->last = d->stack[0];
}

static bool inside_outline(const double *outline, size_t points, double u, double v)
{
    bool inside = false;
    for (size_t i = 0, j = points - 1; i < points; j = i++) {
        const double *a = outline + 2 * i, *b = outline + 2 * j;
        if ((a[1] > v) != (b[1] > v) && u < (b[0] - a[0]) * (v - a[1]) / (b[1] - a[1]) + a[0]) {
            inside = !inside;
        }
    }
    return inside;
}

static double outline_distance(const double *outline, size_t points, double u, double v)
{
    double nearest = INFINITY;
    for (size_t i = 0, j = points - 1; i < points; j = i++) {
        const double *a = outline + 2 * j, *b = outline + 2 * i;
        double du = b[0] - a[0], dv = b[1] - a[1], length2 = du * du + dv * dv;
        double s = length2 > 0 ? ((u - a[0]) * du + (v - a[1]) * dv) / length2 : 0;
        s = fmin(1, fmax(0, s));
        nearest = fmin(nearest, hypot(u - a[0] - s * du, v - a[1] - s * dv));
    }
    return nearest;
}

/* xorshift64*: the same numbers on every machine; uniform in [-1, 1). */
static double noise(uint64_t *state)
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return (double)((*state * 0x2545F4914F6CDD1DULL) >> 11) * 0x1p-52 - 1;
}

static void bounds(const double *outline, size_t points, double low[2], double high[2])
{
    low[0] = low[1] = INFINITY;
    high[0] = high[1] = -INFINITY;
    for (size_t i = 0; i < points; i++) {
        for (int k = 0; k < 2; k++) {
            low[k] = fmin(low[k], outline[2 * i + k]);
            high[k] = fmax(high[k], outline[2 * i + k]);
        }
    }
}

/* The outline's points, then hexagonal points inside it, then three far around; *ret_points counts
 * all but the last three. To be freed by the caller. */
static double *scatter_points(const double *outline, size_t points, double spacing, size_t *ret_points)
{
    double low[2], high[2], row_height = spacing * sqrt(3) / 2;
    bounds(outline, points, low, high);
    size_t columns = (size_t)((high[0] - low[0]) / spacing) + 2,
           lines = (size_t)((high[1] - low[1]) / row_height) + 2;
    if (columns > SURFACE_MAX / lines || points > SURFACE_MAX) {
        return NULL;
    }
    double *uv = malloc(2 * (points + columns * lines + 3) * sizeof *uv);
    if (!uv) {
        return NULL;
    }
    memcpy(uv, outline, 2 * points * sizeof *uv);
    size_t n = points;
    uint64_t seed = 0x9E3779B97F4A7C15ULL;
    for (size_t line = 0; line < lines; line++) {
        for (size_t column = 0; column < columns; column++) {
            double u = low[0] + spacing * ((double)column + (line % 2 ? 0.5 : 0) + JITTER * noise(&seed));
            double v = low[1] + row_height * (double)line + spacing * JITTER * noise(&seed);
            if (inside_outline(outline, points, u, v) &&
                outline_distance(outline, points, u, v) > BORDER_DISTANCE * spacing) {
                uv[2 * n] = u;
                uv[2 * n++ + 1] = v;
            }
        }
    }
    double size = SURROUNDING * (high[0] - low[0] + high[1] - low[1]);
    const double around[6] = {low[0] - size, low[1] - size, high[0] + size,
                              low[1] - size, low[0],        high[1] + size};
    memcpy(uv + 2 * n, around, sizeof around);
    *ret_points = n;
    return uv;
}

/* Whether triangle t is part of the mesh: alive, clear of the surrounding points, in the outline. */
static bool kept(const struct triangulation *d, uint32_t t, const double *outline, size_t outline_points,
                 size_t points)
{
    if (d->state[t] != ALIVE) {
        return false;
    }
    double u = 0, v = 0;
    for (int k = 0; k < 3; k++) {
        if (d->corner[t][k] >= points) {
            return false;
        }
        u += corner_uv(d, t, k)[0] / 3;
        v += corner_uv(d, t, k)[1] / 3;
    }
    return inside_outline(outline, outline_points, u, v);
}

/* Delaunay triangles of the points that lie in the outline, as packed indices in *triangle (room for
 * 2*points of them). Returns their number, or 0 when out of memory. */
static size_t triangulate(const double *uv, size_t points, size_t outline_points, uint32_t *triangle)
{
    struct triangulation d;
    if (triangulation_new(uv, points, &d) < 0) {
        return 0;
    }
    for (size_t i = 0; i < points; i++) {
        insert_point(&d, (uint32_t)i);
    }
    size_t n = 0;
    for (size_t t = 0; t < d.used; t++) {
        if (n < 2 * points && kept(&d, (uint32_t)t, uv, outline_points, points)) {
            memcpy(triangle + 3 * n++, d.corner[t], sizeof d.corner[t]);
        }
    }
    triangulation_done(&d);
    return n;
}

/* Moves each interior point to the area-weighted mean of its triangles' centroids. `sum`: 3*points. */
static void smooth(double *uv, size_t points, size_t outline_points, const uint32_t *triangle,
                   size_t triangles, double *sum)
{
    memset(sum, 0, 3 * points * sizeof *sum);
    for (size_t t = 0; t < triangles; t++) {
        const uint32_t *v = triangle + 3 * t;
        const double *a = uv + 2 * v[0], *b = uv + 2 * v[1], *c = uv + 2 * v[2];
        double area = orient(a, b, c);
        for (int k = 0; k < 3; k++) {
            double *s = sum + 3 * v[k];
            s[0] += area * (a[0] + b[0] + c[0]) / 3;
            s[1] += area * (a[1] + b[1] + c[1]) / 3;
            s[2] += area;
        }
    }
    for (size_t i = outline_points; i < points; i++) {
        if (sum[3 * i + 2] > 0) {
            uv[2 * i] = sum[3 * i] / sum[3 * i + 2];
            uv[2 * i + 1] = sum[3 * i + 1] / sum[3 * i + 2];
        }
    }
}

/* A disc with V vertices of which B on its rim has 2 V - B - 2 triangles, each rim side in one. */
static bool conforms(const double *uv, size_t points, size_t outline_points, const uint32_t *triangle,
                     size_t triangles)
{
    size_t sides = 0;
    for (size_t t = 0; t < triangles; t++) {
        const uint32_t *v = triangle + 3 * t;
        if (!(orient(uv + 2 * v[0], uv + 2 * v[1], uv + 2 * v[2]) > 0)) {
            return false;
        }
        for (int k = 0; k < 3; k++) {
            sides += v[k] < outline_points && v[(k + 1) % 3] == (v[k] + 1) % outline_points;
        }
    }
    return sides == outline_points && triangles == 2 * points - outline_points - 2;
}

int mesher_fill(const double *outline, size_t points, double spacing, struct surface *ret,
                struct failure *failure)
{
    int status = -1;
    size_t all = 0, triangles = 0;
    uint32_t *triangle = NULL;
    double *sum = NULL, *uv = scatter_points(outline, points, spacing, &all);
    if (!uv || !(triangle = malloc(6 * all * sizeof *triangle)) || !(sum = malloc(3 * all * sizeof *sum))) {
        failure_no_memory(failure);
        goto cleanup;
    }
    for (int round = 0; round <= SMOOTHING_ROUNDS; round++) {
        if (round > 0) {
            smooth(uv, all, points, triangle, triangles, sum);
        }
        triangles = triangulate(uv, all, points, triangle);
        if (triangles == 0) {
            failure_no_memory(failure);
            goto cleanup;
        }
    }
    if (!conforms(uv, all, points, triangle, triangles)) {
        failure_set(failure, EXIT_USAGE, "too few triangles for the shape; ask for more");
        goto cleanup;
    }
    if (surface_new(all, triangles, true, ret) < 0) {
        failure_no_memory(failure);
        goto cleanup;
    }
    memcpy(ret->pattern, uv, 2 * all * sizeof *uv);
    memcpy(ret->triangle, triangle, 3 * triangles * sizeof *triangle);
    status = 0;
cleanup:
    free(uv);
    free(triangle);
    free(sum);
    return status;
}
