/* winding.c - inside by counting surface crossings along grid lines.
 *
 * Along each grid line parallel to x the crossings with triangles are collected: +1 where the line
 * enters through a triangle, -1 where it leaves. Whether a line meets a triangle is decided edge by
 * edge in the (y,z) plane, and both triangles of an edge get the same answer, computed from the same
 * numbers in the same order. The projected winding numbers of a closed mesh then add up to zero on
 * every line, whatever the rounding: nothing leaks through a vertex, an edge or a sliver. */
#include "winding.h"

#include <math.h>
#include <stdlib.h>

#include "error.h"

struct crossing {
    uint32_t j, k; /* line */
    uint32_t node; /* first node beyond the crossing */
    int32_t delta; /* change of the winding number */
};

struct crossings {
    struct crossing *item;
    size_t count, capacity;
};

static int compare_crossings(const void *left, const void *right)
{
    const struct crossing *a = left, *b = right;
    if (a->k != b->k)
        return a->k < b->k ? -1 : 1;
    if (a->j != b->j)
        return a->j < b->j ? -1 : 1;
    if (a->node != b->node)
        return a->node < b->node ? -1 : 1;
    return a->delta - b->delta;
}

static bool append(struct crossings *list, struct crossing crossing)
{
    if (list->count == list->capacity) {
        size_t capacity = list->capacity ? 2 * list->capacity : 4096;
        if (capacity > SIZE_MAX / sizeof *list->item)
            return false;
        struct crossing *item = realloc(list->item, capacity * sizeof *item);
        if (!item)
            return false;
        list->item = item;
        list->capacity = capacity;
    }
    list->item[list->count++] = crossing;
    return true;
}

/* Does the edge from a to b cross, in (y,z), the half-line from (y,z) towards +y? +1 upwards (z
 * rising), -1 downwards, 0 not. *ret_area: twice the signed area of (a, b, point). The area is
 * computed from the lower vertex number to the higher, so that it is the same for both triangles. */
static int edge_crossing(const double *point, uint32_t a, uint32_t b, double y, double z, double *ret_area)
{
    bool flip = a > b;
    const double *p = point + 3 * (size_t)(flip ? b : a), *q = point + 3 * (size_t)(flip ? a : b);
    double area = (q[1] - p[1]) * (z - p[2]) - (q[2] - p[2]) * (y - p[1]);
    *ret_area = flip ? -area : area;
    bool p_above = p[2] > z, q_above = q[2] > z;
    if (p_above == q_above)
        return 0;
    bool left = q_above ? area > 0 : area <= 0; /* the point lies left of the rising edge: it is crossed */
    if (!left)
        return 0;
    return q_above != flip ? 1 : -1;
}

/* Winding number in (y,z) of the projected triangle about the line; *ret_x where the line meets it. */
static int line_crossing(const double *point, const uint32_t corner[3], double y, double z, double *ret_x)
{
    double area[3]; /* opposite each corner: the barycentric weights, unnormalised */
    int winding = 0;
    for (int e = 0; e < 3; e++)
        winding += edge_crossing(point, corner[(e + 1) % 3], corner[(e + 2) % 3], y, z, &area[e]);
    if (!winding)
        return 0;
    double total = area[0] + area[1] + area[2], x = 0, low = INFINITY, high = -INFINITY;
    for (int c = 0; c < 3; c++) {
        double corner_x = point[3 * (size_t)corner[c]];
        x += area[c] / total * corner_x;
        low = fmin(low, corner_x);
        high = fmax(high, corner_x);
    }
    *ret_x = fmin(fmax(x, low), high); /* a sliver's weights may be anything, also NaN: fmax drops it */
    return winding;
}

/* Appends the crossings of one triangle; false when memory ran out. */
static bool cross_triangle(const double *point, const uint32_t corner[3], struct crossings *list,
                           size_t *work)
{
    const double *a = point + 3 * (size_t)corner[0], *b = point + 3 * (size_t)corner[1],
                 *c = point + 3 * (size_t)corner[2];
    uint32_t from_y = (uint32_t)ceil(fmin(a[1], fmin(b[1], c[1]))),
             to_y = (uint32_t)fmax(a[1], fmax(b[1], c[1]));
    uint32_t from_z = (uint32_t)ceil(fmin(a[2], fmin(b[2], c[2]))),
             to_z = (uint32_t)fmax(a[2], fmax(b[2], c[2]));
    for (uint32_t k = from_z; k <= to_z; k++) {
        for (uint32_t j = from_y; j <= to_y; j++) {
            double x;
            int winding = line_crossing(point, corner, j, k, &x);
            /* Seen along +x, a triangle that winds positively has its normal ahead: the line leaves. */
            if (winding && !append(list, (struct crossing){j, k, (uint32_t)x + 1, -winding}))
                return false;
        }
        *work += to_y >= from_y ? to_y - from_y + 1 : 1;
    }
    return true;
}

/* Runs of positive winding number from sorted crossings, at most one per crossing. */
static size_t collect_runs(const struct crossings *list, struct dr_run *run)
{
    size_t runs = 0;
    int winding = 0;
    for (size_t i = 0; i + 1 < list->count; i++) {
        const struct crossing *at = list->item + i, *next = at + 1;
        winding += at->delta;
        if (winding <= 0 || at->node == next->node)
            continue; /* the last crossing of a line brings the winding number back to zero */
        if (runs && run[runs - 1].to == at->node && run[runs - 1].j == at->j && run[runs - 1].k == at->k)
            run[runs - 1].to = next->node;
        else
            run[runs++] = (struct dr_run){at->node, next->node, at->j, at->k};
    }
    return runs;
}

drape_status dr_winding_runs(const double *point, const uint32_t *triangle, size_t triangles, size_t limit,
                             size_t *ret_work, struct dr_run **ret, size_t *ret_runs, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    struct crossings list = {NULL, 0, 0};
    struct dr_run *run = NULL;
    size_t work = 0;

    for (size_t t = 0; t < triangles && work <= limit; t++) {
        if (!cross_triangle(point, triangle + 3 * t, &list, &work)) {
            status = dr_out_of_memory(reterr);
            goto cleanup;
        }
    }
    if (work <= limit) {
        if (list.count)
            qsort(list.item, list.count, sizeof *list.item, compare_crossings);
        run = malloc((list.count + 1) * sizeof *run);
        if (!run) {
            status = dr_out_of_memory(reterr);
            goto cleanup;
        }
        *ret_runs = collect_runs(&list, run);
    }
    *ret = run;
    *ret_work = work;

cleanup:
    free(list.item);
    return status;
}
