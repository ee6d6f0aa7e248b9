/* bvh.c - shapes the tree of boxes and fits it to positions. */
#include "bvh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

/* Gives each corner and each edge to the first triangle that has it. */
static drape_status fill_leaves(const struct dr_mesh *mesh, const uint32_t *edge, struct dr_bvh *bvh,
                                drape_error *reterr)
{
    bool *taken = calloc(mesh->nodes ? mesh->nodes : 1, sizeof *taken);
    if (!taken)
        return dr_out_of_memory(reterr);
    for (size_t t = 0; t < mesh->triangles; t++) {
        struct dr_leaf *leaf = bvh->leaf + t;
        leaf->triangle = (uint32_t)t;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t node = mesh->triangle[3 * t + k], other = mesh->neighbor[3 * t + k];
            leaf->node[k] = node;
            leaf->edge[k] = edge[3 * t + k];
            leaf->owned |= (taken[node] ? 0u : 1u) << k;
            leaf->owned |= (other == DR_NONE || other > t ? 1u : 0u) << (3 + k);
            taken[node] = true;
        }
    }
    free(taken);
    return DRAPE_OK;
}

drape_status dr_bvh_new(const struct dr_mesh *mesh, const uint32_t *edge, struct dr_bvh **ret,
                        drape_error *reterr)
{
    struct dr_bvh *bvh = calloc(1, sizeof *bvh);
    if (!bvh)
        return dr_out_of_memory(reterr);
    size_t leaves = mesh->triangles, count = leaves ? 2 * leaves - 1 : 0, room = count ? count : 1;
    bvh->leaves = leaves;
    bvh->count = count;
    bvh->leaf = calloc(leaves ? leaves : 1, sizeof *bvh->leaf);
    bvh->right = calloc(room, sizeof *bvh->right);
    bvh->box = calloc(room, sizeof *bvh->box);
    bvh->move = calloc(room, sizeof *bvh->move);
    drape_status status = bvh->leaf && bvh->right && bvh->box && bvh->move
                              ? fill_leaves(mesh, edge, bvh, reterr)
                              : dr_out_of_memory(reterr);
    if (status < 0)
        dr_bvh_free(bvh);
    else
        *ret = bvh;
    return status;
}

struct dr_bvh *dr_bvh_free(struct dr_bvh *bvh)
{
    if (bvh) {
        free(bvh->leaf);
        free(bvh->right);
        free(bvh->box);
        free(bvh->move);
        free(bvh);
    }
    return NULL;
}

size_t dr_bvh_bytes(const struct dr_bvh *bvh)
{
    return sizeof *bvh + bvh->count * (sizeof *bvh->right + sizeof *bvh->box + sizeof *bvh->move) +
           bvh->leaves * sizeof *bvh->leaf;
}

/* ---- boxes ------------------------------------------------------------------------------------ */

static const struct dr_box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void add_point(struct dr_box *box, const double *x)
{
    for (int d = 0; d < 3; d++) {
        if (!isfinite(x[d]))
            continue;
        box->low[d] = x[d] < box->low[d] ? x[d] : box->low[d];
        box->high[d] = x[d] > box->high[d] ? x[d] : box->high[d];
    }
}

static struct dr_box join(const struct dr_box *a, const struct dr_box *b)
{
    struct dr_box both;
    for (int d = 0; d < 3; d++) {
        both.low[d] = a->low[d] < b->low[d] ? a->low[d] : b->low[d];
        both.high[d] = a->high[d] > b->high[d] ? a->high[d] : b->high[d];
    }
    return both;
}

/* ---- shape ------------------------------------------------------------------------------------ */

/* What the triangles are ordered by along an axis: thrice the centroid, with the triangle's number to tell
 * equals apart. What is not finite counts as 0, so that any positions have an order. */
static double key(const struct dr_leaf *leaf, const double *x, int axis)
{
    double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += x[3 * (size_t)leaf->node[k] + (size_t)axis];
    return isfinite(sum) ? sum : 0;
}

static bool before(const struct dr_leaf *a, const struct dr_leaf *b, const double *x, int axis)
{
    double ka = key(a, x, axis), kb = key(b, x, axis);
    return ka < kb || (ka == kb && a->triangle < b->triangle);
}

static void swap(struct dr_leaf *a, struct dr_leaf *b)
{
    struct dr_leaf kept = *a;
    *a = *b;
    *b = kept;
}

/* Moves the `middle` first of `count` leaves to the front (Hoare's FIND, pivot from the middle). */
static void halve(struct dr_leaf *leaf, size_t count, size_t middle, const double *x, int axis)
{
    size_t low = 0, high = count; /* leaf[middle] belongs between them */
    while (high - low > 1) {
        swap(leaf + low, leaf + low + (high - low) / 2);
        size_t place = low; /* of the pivot leaf[low], after all that come before it */
        for (size_t i = low + 1; i < high; i++)
            if (before(leaf + i, leaf + low, x, axis))
                swap(leaf + i, leaf + ++place);
        swap(leaf + low, leaf + place);
        if (place == middle)
            return;
        if (place < middle)
            low = place + 1;
        else
            high = place;
    }
}

static int longest_axis(const struct dr_leaf *leaf, size_t count, const double *x)
{
    struct dr_box box = nothing;
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++)
            add_point(&box, x + 3 * (size_t)leaf[i].node[k]);
    int axis = 0;
    for (int d = 1; d < 3; d++)
        if (box.high[d] - box.low[d] > box.high[axis] - box.low[axis])
            axis = d;
    return axis;
}

/* The subtree at `node` over leaves first..first+count-1; as deep as log2 of count. */
static void shape(struct dr_bvh *bvh, uint32_t node, size_t first, size_t count, const double *x)
{
    if (count == 1) {
        bvh->right[node] = DR_BVH_LEAF + (uint32_t)first;
        return;
    }
    size_t middle = count / 2;
    struct dr_leaf *leaf = bvh->leaf + first;
    halve(leaf, count, middle, x, longest_axis(leaf, count, x));
    bvh->right[node] = node + 2 * (uint32_t)middle;
    shape(bvh, node + 1, first, middle, x);
    shape(bvh, bvh->right[node], first + middle, count - middle, x);
}

/* For dr_hand_both. */
struct fitting {
    const struct dr_bvh *bvh;
    const double *values, *from;
    struct dr_box *box;
};

/* The boxes of nodes first .. end - 1, which have their children among them or fitted already. */
static void fit(const struct fitting *fitting, uint32_t first, uint32_t end)
{
    static const double origin[3] = {0, 0, 0};
    const struct dr_bvh *bvh = fitting->bvh;
    struct dr_box *box = fitting->box;
    for (uint32_t i = end; i-- > first;) {
        if (dr_bvh_is_leaf(bvh, i)) {
            const struct dr_leaf *leaf = dr_bvh_leaf(bvh, i);
            box[i] = nothing;
            for (int k = 0; k < 3; k++) {
                const double *x = fitting->values + 3 * (size_t)leaf->node[k];
                const double *o = fitting->from ? fitting->from + 3 * (size_t)leaf->node[k] : origin;
                add_point(box + i, (const double[]){x[0] - o[0], x[1] - o[1], x[2] - o[2]});
            }
        } else {
            box[i] = join(box + i + 1, box + bvh->right[i]);
        }
    }
}

/* The subtrees below the root. */
static void fit_half(void *data, int half)
{
    const struct fitting *fitting = data;
    uint32_t right = fitting->bvh->right[0];
    fit(fitting, half ? right : 1, half ? (uint32_t)fitting->bvh->count : right);
}

void dr_bvh_fit(struct dr_bvh *bvh, const double *values, const double *from, struct dr_box *box)
{
    struct fitting fitting = {bvh, values, from, box};
    if (!bvh->shaped && bvh->leaves)
        shape(bvh, 0, 0, bvh->leaves, values);
    bvh->shaped = true;
    if (bvh->count > 1)
        dr_hand_both(bvh->hand, fit_half, &fitting);
    fit(&fitting, 0, bvh->count > 0);
}

struct dr_bvh_starts dr_bvh_half(const struct dr_bvh *bvh, int half)
{
    struct dr_bvh_starts all = {.count = bvh->count > 0, .pair = {{0, 0}}}, ret = {.count = 0};
    for (int level = 0; level < 4; level++) {
        struct dr_bvh_starts below = {.count = 0};
        for (size_t i = 0; i < all.count; i++) {
            uint32_t a = all.pair[i][0], b = all.pair[i][1];
            if (dr_bvh_is_leaf(bvh, a) && dr_bvh_is_leaf(bvh, b)) {
                below.pair[below.count][0] = a;
                below.pair[below.count++][1] = b;
            } else {
                below.count = dr_bvh_open(bvh, a, b, below.pair, below.count);
            }
        }
        all = below;
    }
    int turn[2] = {0, 0}; /* of a node with itself, of two */
    for (size_t i = 0; i < all.count; i++)
        if (turn[all.pair[i][0] != all.pair[i][1]]++ % 2 == half)
            memcpy(ret.pair[ret.count++], all.pair[i], sizeof all.pair[i]);
    return ret;
}
