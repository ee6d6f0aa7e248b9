/* nearest.c - a binary tree of boxes over the triangles, cut at the median; refitted as the mesh moves. */
#include "nearest.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "mesh.h"

#define LEAF 4 /* triangles per leaf, at most: below that a box costs as much as what it holds */

struct box {
    double low[3], high[3];
};

/* A triangle as the search wants it, in the leaves' order. */
struct facet {
    double a[3], ab[3], ac[3];
    double n[3]; /* unit; zero without area */
};

struct dr_nearest {
    const double *x;
    const uint32_t *triangle;
    size_t vertices, triangles;
    size_t leaves;         /* a power of two; leaf l has order[l T/leaves] up to order[(l+1) T/leaves] */
    uint32_t *order;       /* triangles */
    struct box *box;       /* 2*leaves - 1: those below box n are 2n+1 and 2n+2 */
    struct facet *facet;   /* triangles */
    uint32_t *neighbor;    /* 3*triangles: across the side opposite corner k; DR_NONE: none */
    double *normal;        /* 3*triangles: unit, or zero without area */
    double *corner_normal; /* 3*vertices: angle-weighted sum of those around */
};

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void subtract(const double a[3], const double b[3], double ret[3])
{
    for (int d = 0; d < 3; d++)
        ret[d] = a[d] - b[d];
}

static const double *corner(const struct dr_nearest *nearest, size_t t, int k)
{
    return nearest->x + 3 * (size_t)nearest->triangle[3 * t + (size_t)k];
}

/* ---- the tree -------------------------------------------------------------------------------- */

struct item {
    double middle[3];
    uint32_t triangle;
};

static int compare_along(const void *left, const void *right, int axis)
{
    const struct item *a = left, *b = right;
    if (a->middle[axis] != b->middle[axis])
        return a->middle[axis] < b->middle[axis] ? -1 : 1;
    return a->triangle < b->triangle ? -1 : 1;
}

static int compare_x(const void *left, const void *right)
{
    return compare_along(left, right, 0);
}

static int compare_y(const void *left, const void *right)
{
    return compare_along(left, right, 1);
}

static int compare_z(const void *left, const void *right)
{
    return compare_along(left, right, 2);
}

static int longest_axis(const struct item *item, size_t count)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t i = 0; i < count; i++)
        for (int d = 0; d < 3; d++) {
            low[d] = fmin(low[d], item[i].middle[d]);
            high[d] = fmax(high[d], item[i].middle[d]);
        }
    int longest = 0;
    for (int d = 1; d < 3; d++)
        if (high[d] - low[d] > high[longest] - low[longest])
            longest = d;
    return longest;
}

/* Sorts the items of leaves from..to-1, so that each half has its part of space. */
static void split(struct item *item, size_t items, size_t leaves, size_t from, size_t to)
{
    static int (*const compare[3])(const void *, const void *) = {compare_x, compare_y, compare_z};
    if (to - from < 2)
        return;
    size_t first = from * items / leaves, count = to * items / leaves - first;
    qsort(item + first, count, sizeof *item, compare[longest_axis(item + first, count)]);
    size_t middle = (from + to) / 2;
    split(item, items, leaves, from, middle);
    split(item, items, leaves, middle, to);
}

static bool order_triangles(struct dr_nearest *nearest)
{
    struct item *item = malloc(nearest->triangles * sizeof *item);
    if (!item)
        return false;
    for (size_t t = 0; t < nearest->triangles; t++) {
        item[t].triangle = (uint32_t)t;
        for (int d = 0; d < 3; d++)
            item[t].middle[d] =
                corner(nearest, t, 0)[d] + corner(nearest, t, 1)[d] + corner(nearest, t, 2)[d];
    }
    split(item, nearest->triangles, nearest->leaves, 0, nearest->leaves);
    for (size_t i = 0; i < nearest->triangles; i++)
        nearest->order[i] = item[i].triangle;
    free(item);
    return true;
}

static void fit_leaf(const struct dr_nearest *nearest, size_t leaf, struct box *box)
{
    size_t from = leaf * nearest->triangles / nearest->leaves;
    size_t to = (leaf + 1) * nearest->triangles / nearest->leaves;
    for (int d = 0; d < 3; d++) {
        box->low[d] = INFINITY;
        box->high[d] = -INFINITY;
    }
    for (size_t i = from; i < to; i++)
        for (int k = 0; k < 3; k++) {
            const double *x = corner(nearest, nearest->order[i], k);
            for (int d = 0; d < 3; d++) {
                box->low[d] = fmin(box->low[d], x[d]);
                box->high[d] = fmax(box->high[d], x[d]);
            }
        }
}

static void fit_boxes(struct dr_nearest *nearest)
{
    size_t inner = nearest->leaves - 1;
    for (size_t leaf = 0; leaf < nearest->leaves; leaf++)
        fit_leaf(nearest, leaf, nearest->box + inner + leaf);
    for (size_t n = inner; n-- > 0;)
        for (int d = 0; d < 3; d++) {
            const struct box *a = nearest->box + 2 * n + 1, *b = a + 1;
            nearest->box[n].low[d] = fmin(a->low[d], b->low[d]);
            nearest->box[n].high[d] = fmax(a->high[d], b->high[d]);
        }
}

/* ---- normals --------------------------------------------------------------------------------- */

struct side {
    uint32_t low, high; /* its vertices */
    uint32_t slot;      /* 3 * triangle + opposite corner */
};

static int compare_sides(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    if (a->high != b->high)
        return a->high < b->high ? -1 : 1;
    return a->slot < b->slot ? -1 : 1;
}

static bool find_neighbors(struct dr_nearest *nearest)
{
    size_t sides = 3 * nearest->triangles;
    struct side *side = malloc(sides * sizeof *side);
    if (!side)
        return false;
    for (size_t s = 0; s < sides; s++) {
        const uint32_t *of = nearest->triangle + s / 3 * 3;
        uint32_t a = of[(s + 1) % 3], b = of[(s + 2) % 3];
        side[s] = (struct side){a < b ? a : b, a < b ? b : a, (uint32_t)s};
        nearest->neighbor[s] = DR_NONE;
    }
    qsort(side, sides, sizeof *side, compare_sides);
    for (size_t s = 0; s + 1 < sides; s++)
        if (side[s].low == side[s + 1].low && side[s].high == side[s + 1].high) {
            nearest->neighbor[side[s].slot] = side[s + 1].slot / 3;
            nearest->neighbor[side[s + 1].slot] = side[s].slot / 3;
        }
    free(side);
    return true;
}

static double angle_between(const double a[3], const double b[3])
{
    double length = sqrt(dot(a, a) * dot(b, b));
    return length > 0 ? acos(fmin(fmax(dot(a, b) / length, -1), 1)) : 0;
}

static void add_normal(struct dr_nearest *nearest, size_t t)
{
    double ab[3], ac[3], bc[3], ba[3], *n = nearest->normal + 3 * t;
    subtract(corner(nearest, t, 1), corner(nearest, t, 0), ab);
    subtract(corner(nearest, t, 2), corner(nearest, t, 0), ac);
    subtract(corner(nearest, t, 2), corner(nearest, t, 1), bc);
    for (int d = 0; d < 3; d++) {
        n[d] = ab[(d + 1) % 3] * ac[(d + 2) % 3] - ab[(d + 2) % 3] * ac[(d + 1) % 3];
        ba[d] = -ab[d];
    }
    double length = sqrt(dot(n, n));
    double at_a = angle_between(ab, ac), at_b = angle_between(ba, bc);
    const double angle[3] = {at_a, at_b, 3.14159265358979323846 - at_a - at_b};
    for (int d = 0; d < 3; d++) {
        n[d] = length > 0 ? n[d] / length : 0;
        for (size_t k = 0; k < 3; k++)
            nearest->corner_normal[3 * (size_t)nearest->triangle[3 * t + k] + (size_t)d] += angle[k] * n[d];
    }
}

/* ---- made, moved and freed ------------------------------------------------------------------- */

void dr_nearest_move(struct dr_nearest *nearest)
{
    fit_boxes(nearest);
    memset(nearest->corner_normal, 0, 3 * nearest->vertices * sizeof *nearest->corner_normal);
    for (size_t t = 0; t < nearest->triangles; t++)
        add_normal(nearest, t);
    for (size_t i = 0; i < nearest->triangles; i++) {
        struct facet *facet = nearest->facet + i;
        size_t t = nearest->order[i];
        memcpy(facet->a, corner(nearest, t, 0), sizeof facet->a);
        subtract(corner(nearest, t, 1), facet->a, facet->ab);
        subtract(corner(nearest, t, 2), facet->a, facet->ac);
        memcpy(facet->n, nearest->normal + 3 * t, sizeof facet->n);
    }
}

drape_status dr_nearest_new(const double *positions, size_t vertices, const uint32_t *triangle,
                            size_t triangles, struct dr_nearest **ret, drape_error *reterr)
{
    struct dr_nearest *nearest = calloc(1, sizeof *nearest);
    if (!nearest)
        return dr_out_of_memory(reterr);
    nearest->x = positions;
    nearest->triangle = triangle;
    nearest->vertices = vertices;
    nearest->triangles = triangles;
    for (nearest->leaves = 1; LEAF * nearest->leaves < triangles;)
        nearest->leaves *= 2;
    nearest->order = malloc(triangles * sizeof *nearest->order);
    nearest->box = malloc(2 * nearest->leaves * sizeof *nearest->box);
    nearest->facet = malloc(triangles * sizeof *nearest->facet);
    nearest->neighbor = malloc(3 * triangles * sizeof *nearest->neighbor);
    nearest->normal = malloc(3 * triangles * sizeof *nearest->normal);
    nearest->corner_normal = malloc(3 * vertices * sizeof *nearest->corner_normal);
    if (!nearest->order || !nearest->box || !nearest->facet || !nearest->neighbor || !nearest->normal ||
        !nearest->corner_normal || !order_triangles(nearest) || !find_neighbors(nearest)) {
        dr_nearest_free(nearest);
        return dr_out_of_memory(reterr);
    }
    dr_nearest_move(nearest);
    *ret = nearest;
    return DRAPE_OK;
}

struct dr_nearest *dr_nearest_free(struct dr_nearest *nearest)
{
    if (nearest) {
        free(nearest->order);
        free(nearest->box);
        free(nearest->facet);
        free(nearest->neighbor);
        free(nearest->normal);
        free(nearest->corner_normal);
        free(nearest);
    }
    return NULL;
}

size_t dr_nearest_bytes(const struct dr_nearest *nearest)
{
    size_t triangle = sizeof *nearest->order + sizeof *nearest->facet + 3 * sizeof *nearest->neighbor +
                      3 * sizeof *nearest->normal;
    return sizeof *nearest + nearest->triangles * triangle + 2 * nearest->leaves * sizeof *nearest->box +
           3 * nearest->vertices * sizeof *nearest->corner_normal;
}

/* ---- asked ----------------------------------------------------------------------------------- */

static double ratio(double part, double whole)
{
    return whole > 0 ? part / whole : 0; /* a collapsed side or triangle */
}

/* Takes the point of a facet nearest to p where that is nearer than *best: barycentric weights by Voronoi
 * region (Ericson, Real-Time Collision Detection, 5.1.5). */
static void improve(const struct facet *facet, uint32_t triangle, const double p[3], struct dr_place *best)
{
    const double *ab = facet->ab, *ac = facet->ac;
    double ap[3], a = 0, v = 0, w = 0, square = 0;
    subtract(p, facet->a, ap);
    double off = dot(facet->n, ap);
    if (off * off >= best->square) /* the plane alone is too far */
        return;
    double bb = dot(ab, ab), bc = dot(ab, ac), cc = dot(ac, ac);
    double a1 = dot(ab, ap), a2 = dot(ac, ap), b1 = a1 - bb, b2 = a2 - bc, c1 = a1 - bc, c2 = a2 - cc;
    double in_c = a1 * b2 - b1 * a2, in_b = c1 * a2 - a1 * c2, in_a = b1 * c2 - c1 * b2;
    if (a1 <= 0 && a2 <= 0) {
        a = 1;
    } else if (b1 >= 0 && b2 <= b1) {
        v = 1;
    } else if (c2 >= 0 && c1 <= c2) {
        w = 1;
    } else if (in_c <= 0 && a1 >= 0 && b1 <= 0) {
        v = ratio(a1, a1 - b1);
        a = 1 - v;
    } else if (in_b <= 0 && a2 >= 0 && c2 <= 0) {
        w = ratio(a2, a2 - c2);
        a = 1 - w;
    } else if (in_a <= 0 && b2 >= b1 && c1 >= c2) {
        w = ratio(b2 - b1, (b2 - b1) + (c1 - c2));
        v = 1 - w;
    } else {
        v = ratio(in_b, in_a + in_b + in_c);
        w = ratio(in_c, in_a + in_b + in_c);
        a = 1 - v - w;
    }
    for (int d = 0; d < 3; d++) {
        double gap = ap[d] - v * ab[d] - w * ac[d];
        square += gap * gap;
    }
    if (square < best->square)
        *best = (struct dr_place){triangle, {a, v, w}, square};
}

static double box_square(const struct box *box, const double p[3])
{
    double square = 0;
    for (int d = 0; d < 3; d++) {
        double below = box->low[d] - p[d], above = p[d] - box->high[d];
        double gap = below > above ? below : above; /* fmax would be a call */
        square += gap > 0 ? gap * gap : 0;
    }
    return square;
}

/* Improves *best with what is below box n. */
static void search(const struct dr_nearest *nearest, size_t n, const double p[3], struct dr_place *best)
{
    size_t inner = nearest->leaves - 1;
    if (n >= inner) {
        size_t leaf = n - inner, to = (leaf + 1) * nearest->triangles / nearest->leaves;
        for (size_t i = leaf * nearest->triangles / nearest->leaves; i < to; i++)
            improve(nearest->facet + i, nearest->order[i], p, best);
        return;
    }
    size_t nearer = 2 * n + 1, farther = nearer + 1;
    double near = box_square(nearest->box + nearer, p), far = box_square(nearest->box + farther, p);
    if (far < near) {
        double swap = near;
        near = far;
        far = swap;
        nearer = farther;
        farther = 2 * n + 1;
    }
    if (near < best->square)
        search(nearest, nearer, p, best);
    if (far < best->square)
        search(nearest, farther, p, best);
}

bool dr_nearest_find(const struct dr_nearest *nearest, const double p[3], double most, struct dr_place *ret)
{
    struct dr_place best = {.triangle = DR_NONE, .square = most * most};
    search(nearest, 0, p, &best);
    if (best.triangle == DR_NONE)
        return false;
    *ret = best;
    return true;
}

/* The pseudonormal at a place: of its triangle, or of all that meet at its side or corner. */
static void normal_at(const struct dr_nearest *nearest, const struct dr_place *place, double ret[3])
{
    size_t t = place->triangle, zeros = 0, zero = 0, whole = 0;
    for (size_t k = 0; k < 3; k++) {
        if (place->weight[k] == 0) {
            zeros++;
            zero = k;
        } else {
            whole = k;
        }
    }
    if (zeros == 2) {
        memcpy(ret, nearest->corner_normal + 3 * (size_t)nearest->triangle[3 * t + whole], 3 * sizeof *ret);
        return;
    }
    uint32_t other = zeros == 1 ? nearest->neighbor[3 * t + zero] : DR_NONE;
    for (size_t d = 0; d < 3; d++)
        ret[d] = nearest->normal[3 * t + d] + (other != DR_NONE ? nearest->normal[3 * (size_t)other + d] : 0);
}

bool dr_nearest_distance(const struct dr_nearest *nearest, const double p[3], double most, double *ret_phi,
                         double ret_grad[3])
{
    struct dr_place place;
    if (!dr_nearest_find(nearest, p, most, &place))
        return false;
    double n[3], gap[3];
    normal_at(nearest, &place, n);
    for (int d = 0; d < 3; d++) {
        gap[d] = p[d];
        for (int k = 0; k < 3; k++)
            gap[d] -= place.weight[k] * corner(nearest, place.triangle, k)[d];
    }
    double length = sqrt(dot(gap, gap)), size = sqrt(dot(n, n));
    bool inside = dot(gap, n) < 0, on = length < 1e-9; /* m: the direction of less is round-off */
    for (int d = 0; d < 3; d++)
        ret_grad[d] = !on ? (inside ? -gap[d] : gap[d]) / length : size > 0 ? n[d] / size : d == 1;
    *ret_phi = inside ? -length : length;
    return true;
}
