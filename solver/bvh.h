/* bvh.h - a tree of boxes over the triangles of a mesh, and the walk that finds pairs of them.
 *
 * Each vertex and each edge belongs to the first triangle that has it, its "representative" [Curtis,
 * Tamstorf, Manocha: Fast collision detection for deformable models using representative-triangles, I3D
 * 2008]. The walk meets each pair of triangles once, so each vertex-face and edge-edge pair is met once, too.
 *
 * The tree's shape is made once, from the first positions seen, by halving along the longest side; later
 * positions only refit the boxes. Nodes are in depth-first order: the left child of node i is i + 1. */
#ifndef DR_BVH_H
#define DR_BVH_H

#include <math.h>

#include "hand.h"
#include "mesh.h"

struct dr_box { /* low > high: empty. Not-finite coordinates are left out */
    double low[3], high[3];
};

struct dr_leaf {
    uint32_t node[3], edge[3]; /* of a triangle; edge k lies opposite corner k */
    uint32_t triangle;
    uint32_t owned; /* bit k: corner k is this triangle's own; bit 3 + k: edge k is */
};

struct dr_bvh {
    size_t leaves, count; /* triangles; tree nodes: 2*leaves - 1 */
    struct dr_leaf *leaf; /* in the order of the tree */
    uint32_t *right;      /* count: the right child; of a leaf, DR_BVH_LEAF + its number */
    struct dr_box *box;   /* count: of the positions */
    struct dr_box *move;  /* count: of the motions; dr_sweep's and dr_pairs_add's */
    bool shaped;          /* the tree has its shape */
    struct dr_hand *hand; /* whence half of the work on it is lent; NULL: nowhere */
};

#define DR_BVH_LEAF 0x80000000u /* more than twice DRAPE_MAX_TRIANGLES */

/* `edge`: 3*triangles, number of the edge opposite each corner. */
drape_status dr_bvh_new(const struct dr_mesh *mesh, const uint32_t *edge, struct dr_bvh **ret,
                        drape_error *reterr);
struct dr_bvh *dr_bvh_free(struct dr_bvh *bvh); /* NULL is fine; returns NULL */
size_t dr_bvh_bytes(const struct dr_bvh *bvh);

/* Shapes the tree if it has no shape yet, and fits `box` (bvh->box or bvh->move) to values (3*nodes), less
 * those of `from` (likewise) unless that is NULL. */
void dr_bvh_fit(struct dr_bvh *bvh, const double *values, const double *from, struct dr_box *box);

static inline bool dr_bvh_is_leaf(const struct dr_bvh *bvh, uint32_t node)
{
    return bvh->right[node] >= DR_BVH_LEAF;
}

static inline const struct dr_leaf *dr_bvh_leaf(const struct dr_bvh *bvh, uint32_t node)
{
    return bvh->leaf + (bvh->right[node] - DR_BVH_LEAF);
}

/* How far apart two intervals are; 0 where they overlap, NaN where they do by more than numbers go. No
 * branch, as a comparison with 0 would become: the processor would guess it wrong. */
static inline double dr_gap(double low, double high, double other_low, double other_high)
{
    double above = low - other_high, below = other_low - high, gap = above > below ? above : below;
    return (gap + fabs(gap)) / 2;
}

/* How far apart two boxes are, squared; infinite if one is empty; NaN as above. */
static inline double dr_box_distance(const struct dr_box *a, const struct dr_box *b)
{
    double x = dr_gap(a->low[0], a->high[0], b->low[0], b->high[0]),
           y = dr_gap(a->low[1], a->high[1], b->low[1], b->high[1]),
           z = dr_gap(a->low[2], a->high[2], b->low[2], b->high[2]);
    return x * x + y * y + z * z;
}

/* Whether a pair of tree nodes (also a node with itself) is worth a look; what to do with two leaves, false
 * to end the walk. */
typedef bool dr_bvh_near(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data);
typedef bool dr_bvh_meet(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data);

/* Deep enough for 2^31 leaves: each level leaves at most 3 pairs behind, among nodes and then within them. */
#define DR_BVH_STACK 256

/* Appends the pairs of children that a pair of tree nodes, not both leaves, consists of. */
static inline size_t dr_bvh_open(const struct dr_bvh *bvh, uint32_t a, uint32_t b, uint32_t (*list)[2],
                                 size_t count)
{
    bool a_ends = dr_bvh_is_leaf(bvh, a), b_ends = dr_bvh_is_leaf(bvh, b);
    uint32_t left[2] = {a_ends ? a : a + 1, b_ends ? b : b + 1};
    uint32_t right[2] = {a_ends ? a : bvh->right[a], b_ends ? b : bvh->right[b]};
    for (int i = 0; i < 2; i++) {
        for (int j = a == b ? i : 0; j < 2; j++) {
            if ((a_ends && i) || (b_ends && j))
                continue;
            list[count][0] = i ? right[0] : left[0];
            list[count++][1] = j ? right[1] : left[1];
        }
    }
    return count;
}

/* All pairs of leaves below the tree nodes a and b that are near, each once and no leaf with itself. False if
 * `meet` ended it. Inline, so that the two functions are, too. */
static inline __attribute__((always_inline)) bool dr_bvh_walk_from(const struct dr_bvh *bvh, uint32_t a,
                                                                   uint32_t b, dr_bvh_near *near,
                                                                   dr_bvh_meet *meet, void *data)
{
    uint32_t stack[DR_BVH_STACK][2] = {{a, b}};
    for (size_t top = 1; top-- > 0;) {
        a = stack[top][0];
        b = stack[top][1];
        bool end = dr_bvh_is_leaf(bvh, a) && dr_bvh_is_leaf(bvh, b);
        if ((a == b && end) || !near(bvh, a, b, data))
            continue;
        if (!end)
            top = dr_bvh_open(bvh, a, b, stack, top);
        else if (!meet(bvh, a, b, data))
            return false;
    }
    return true;
}

/* The same of the whole tree. */
static inline __attribute__((always_inline)) bool dr_bvh_walk(const struct dr_bvh *bvh, dr_bvh_near *near,
                                                              dr_bvh_meet *meet, void *data)
{
    return !bvh->count || dr_bvh_walk_from(bvh, 0, 0, near, meet, data);
}

/* Where the walk of a whole tree may begin instead of at its root: all pairs of nodes on the fourth level
 * below it (or of leaves above that). Every other one, those of a node with itself and those of two nodes
 * counted apart, is one half of the walk, and what the other half is does not depend on the positions. */
#define DR_BVH_STARTS 136
struct dr_bvh_starts {
    size_t count;
    uint32_t pair[DR_BVH_STARTS][2];
};
struct dr_bvh_starts dr_bvh_half(const struct dr_bvh *bvh, int half);

#endif
