/* pairs.h - which vertices and triangles, and which edges, of one cloth mesh are near each other or cross.
 *
 * Parts that share a node are never a pair. A node of no triangle is in no pair. Coordinates that are not
 * finite are near nothing. Belongs to one thread. */
#ifndef DR_PAIRS_H
#define DR_PAIRS_H

#include "bvh.h"
#include "closest.h"

/* Pairs kept per triangle of the mesh, vertex-face and edge-edge together. Fifty layers of cloth a millimetre
 * apart need about 120 within 6 mm; a heap that needs more has more than the whole rest of the scene weighs.
 */
#define DR_PAIRS_PER_TRIANGLE 128

/* Pairs of triangles that one walk looks at, per triangle of the mesh; about 10 are usual. Only a heap, or
 * long needles whose boxes all overlap, need more, and would cost a time that grows with the square. */
#define DR_PAIRS_MAX_MEETINGS 512

struct dr_pair {
    uint32_t node[4]; /* vertex a, then the corners of triangle b; or the ends of edge a, then of edge b */
    uint32_t a, b;    /* numbers of vertex and triangle; or of two edges, a < b */
};

struct dr_pair_list { /* grows */
    struct dr_pair *pair;
    size_t count, room;
};

struct dr_pairs { /* read-only but for pairs.c and sweep.c */
    const struct dr_mesh *mesh;
    const uint32_t *part; /* nodes, borrowed: what is of one part is never a pair; NULL: there are no parts */
    const uint32_t *weld; /* nodes, borrowed: nor is what shares one of these; NULL: nodes stay apart */
    const bool *absent;   /* nodes, borrowed: nor is anything with one of these; NULL: none */

    size_t sides;            /* edges of the mesh */
    uint32_t *side;          /* 2*sides: the nodes of each, smaller first */
    uint32_t *side_triangle; /* 2*sides: its triangles; DR_NONE: no second */

    /* What dr_pairs_find found and dr_pairs_add added, sorted by a, then b, so that sums over it have one
     * order. */
    double radius; /* m: all pairs closer than this are listed, see dr_pairs_find */
    size_t face_count, edge_count;
    struct dr_pair *faces; /* vertex-face */
    struct dr_pair *edges; /* edge-edge */

    size_t face_room, edge_room;
    struct dr_pair_list found[2][2]; /* by half of a search: faces and edges, until they join the others */
    uint32_t *first_side;            /* nodes + 1: where in node_side a node's edges begin */
    uint32_t *node_side;             /* 2*sides */
    struct dr_bvh *bvh;
    double *share;   /* 2*nodes: dr_sweep_clip's, by half of a walk */
    uint8_t *marked; /* nodes: likewise */
    uint8_t *moved;  /* bvh->count: likewise */
};

/* `mesh` must outlive the result, which holds all memory but that of the lists. */
drape_status dr_pairs_new(const struct dr_mesh *mesh, struct dr_pairs **ret, drape_error *reterr);

/* Whence a processor is borrowed for half of a search, and of a sweep, from now on; NULL: nowhere. */
void dr_pairs_lend(struct dr_pairs *pairs, struct dr_hand *hand);

struct dr_pairs *dr_pairs_free(struct dr_pairs *pairs); /* NULL is fine; returns NULL */
size_t dr_pairs_bytes(const struct dr_pairs *pairs);    /* what is held now */

/* From here on only what is of different parts can be a pair (crossings are counted all the same). `part`
 * (nodes) must outlive the pairs; the corners of a triangle have the same. */
void dr_pairs_between(struct dr_pairs *pairs, const uint32_t *part);

/* From here on nodes with the same number in `weld` (nodes, must outlive the pairs) count as one, of which
 * parts that have it are no pair, and parts play no role: all else is kept apart. */
void dr_pairs_weld(struct dr_pairs *pairs, const uint32_t *weld);

/* From here on nothing of nodes that are `absent` (nodes, must outlive the pairs; the corners of a triangle
 * have the same) is a pair; crossings are counted all the same. */
void dr_pairs_without(struct dr_pairs *pairs, const bool *absent);

/* Lists all pairs closer than `radius` (m) at x (3*nodes). Where that passes
 * DR_PAIRS_PER_TRIANGLE or DR_PAIRS_MAX_MEETINGS, the radius is halved, at last to 0 (no pairs): memory and
 * time stay in proportion to the mesh, and the list is complete up to pairs->radius, which tells. An error
 * would end a run over a heap that the next step may loosen; a list merely cut off would hold one part of the
 * cloth and let another pass. DRAPE_ENOMEM: the lists are then empty. */
drape_status dr_pairs_find(struct dr_pairs *pairs, const double *x, double radius, drape_error *reterr);

/* The lists, found at `from`, get what else is closer than `radius` (m, less than pairs->radius) at x: looked
 * for only where cloth has moved against itself by the difference of both, which is little of it while it
 * moves as one. False where that is a good part of the cloth, or memory or room in the lists ran out: then
 * some may be missing, and dr_pairs_find is due. Pairs that have parted stay. */
bool dr_pairs_add(struct dr_pairs *pairs, const double *from, const double *x, double radius);

/* Edge through triangle. */
struct dr_crossing {
    uint32_t side, triangle;
    double at[3]; /* m */
};

#define DR_PAIRS_MAX_CROSSINGS 1000000

/* How many edges cross a triangle they share no node with, counted up to DR_PAIRS_MAX_CROSSINGS and as
 * far as DR_PAIRS_MAX_MEETINGS allows. The one of
 * lowest edge, then triangle, is *ret_first (unless NULL), which is only written when there is one. Touching
 * (an edge that ends on a triangle, or lies in its plane) is no crossing; what passes through an edge of two
 * triangles crosses both. Floating point: decides nothing finer than round-off. */
size_t dr_pairs_crossings(struct dr_pairs *pairs, const double *x, struct dr_crossing *ret_first);

/* Whether edge `side` crosses `triangle`, with which it shares no node, and where (unless NULL). */
bool dr_pairs_cross(const struct dr_pairs *pairs, const double *x, uint32_t side, uint32_t triangle,
                    double ret_at[3]);

/* Whether nothing of two triangles is a pair: they are of one part, or one is absent. */
static inline bool dr_pairs_are_free(const struct dr_pairs *pairs, const struct dr_leaf *p,
                                     const struct dr_leaf *q)
{
    uint32_t a = p->node[0], b = q->node[0];
    return (pairs->part && pairs->part[a] == pairs->part[b]) ||
           (pairs->absent && (pairs->absent[a] || pairs->absent[b]));
}

/* Whether a node of one side of a pair will be one with a node of the other. Node: as in struct dr_pair. */
static inline bool dr_pairs_are_welded(const struct dr_pairs *pairs, const uint32_t node[4], bool edges)
{
    for (int i = 0; pairs->weld && i < (edges ? 2 : 1); i++)
        for (int j = edges ? 2 : 1; j < 4; j++)
            if (pairs->weld[node[i]] == pairs->weld[node[j]])
                return true;
    return false;
}

static inline bool dr_pairs_shares_node(const uint32_t corner[3], uint32_t node)
{
    return node == corner[0] || node == corner[1] || node == corner[2];
}

#endif
