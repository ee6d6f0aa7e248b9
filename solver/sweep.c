/* sweep.c - conservative advancement of all pairs that a step might bring together. */
#include "sweep.h"

#include <math.h>
#include <string.h>

/* Evaluations of one pair's distance; what needs more is grazing, and the way up to there is safe. */
#define MAX_ADVANCES 100

/* Rounds of shortening single moves, before all are. */
#define MAX_ROUNDS 12

/* What a pair that is shut keeps of its distance: hardly less, but so that it may open. */
#define ALMOST 0.999

/* Pairs of triangles that one walk looks at, per triangle: what moves by up to an edge has about 10. */
#define MAX_MEETINGS 128

/* What is left of a move shortened to a meeting: less, so that round-off cannot make it meet again. */
#define MARGIN 0.999

/* When a walk over the whole step looks at too many pairs, it starts afresh over this part of it. */
#define SHORTER     0.125
#define MAX_SHORTER 4

/* ---- one pair --------------------------------------------------------------------------------- */

struct pair {
    double x[12], w[12]; /* positions relative to the first node, motions relative to their mean */
    bool edges;
};

static struct pair load(const double *x, const double *w, const uint32_t node[4], bool edges)
{
    struct pair pair = {.edges = edges};
    for (size_t d = 0; d < 3; d++) {
        double mean = 0;
        for (size_t i = 0; i < 4; i++)
            mean += w[3 * (size_t)node[i] + d] / 4;
        for (size_t i = 0; i < 4; i++) {
            pair.x[3 * i + d] = x[3 * (size_t)node[i] + d] - x[3 * (size_t)node[0] + d];
            pair.w[3 * i + d] = w[3 * (size_t)node[i] + d] - mean;
        }
    }
    return pair;
}

static struct dr_closest closest(const double x[12], bool edges)
{
    static const uint32_t node[4] = {0, 1, 2, 3};
    return edges ? dr_closest_edge_edge(x, node) : dr_closest_vertex_face(x, node);
}

/* How long the two parts, now at x, certainly stay farther apart than `goal`: along any unit vector n their
 * distance is at least n.(x_i - x_j) + t n.(w_i - w_j) for the worst nodes i of one and j of the other. */
static double safe_time(const struct pair *pair, const double x[12], const double n[3], double goal)
{
    double at[4], speed[4], least = INFINITY;
    for (size_t i = 0; i < 4; i++) {
        at[i] = dr_dot(n, x + 3 * i);
        speed[i] = dr_dot(n, pair->w + 3 * i);
    }
    size_t split = pair->edges ? 2 : 1;
    for (size_t i = 0; i < split; i++) {
        for (size_t j = split; j < 4; j++) {
            double closing = speed[j] - speed[i], time = (at[i] - at[j] - goal) / closing;
            if (closing > 0 && time < least)
                least = time;
        }
    }
    return least > 0 ? least : 0;
}

/* The distance that a pair must keep of `distance`, and the one at which it counts as met. */
struct bounds {
    double goal, enough;
};

static struct bounds bounds_of(double distance, double keep)
{
    double start = distance < DR_SWEEP_NEAR ? distance : DR_SWEEP_NEAR;
    double least = start * ALMOST < DR_SWEEP_SHUT ? start * ALMOST : DR_SWEEP_SHUT;
    double goal = keep * start > least ? keep * start : least;
    return (struct bounds){goal, start - DR_SWEEP_CLOSED * (start - goal)};
}

/* Most pairs show by one look at their closest points that they do not meet within t: see safe_time. */
static bool stays_apart(const double *x, const double *w, const uint32_t node[4], bool edges, double keep,
                        double t)
{
    struct dr_closest c = edges ? dr_closest_edge_edge(x, node) : dr_closest_vertex_face(x, node);
    double distance = sqrt(c.square), speed[4]; /* along r, times the distance */
    for (int i = 0; i < 4; i++)
        speed[i] = dr_dot(c.r, w + 3 * (size_t)node[i]);
    double most = speed[2] > speed[3] ? speed[2] : speed[3], least = speed[0];
    if (edges)
        least = speed[1] < least ? speed[1] : least;
    else
        most = speed[1] > most ? speed[1] : most;
    return c.square - t * (most - least) > bounds_of(distance, keep).enough * distance;
}

/* The part of the step until the pair meets; `limit` if it does not before. */
static double meeting(const struct pair *pair, double keep, double limit)
{
    struct dr_closest c = closest(pair->x, pair->edges);
    double distance = sqrt(c.square), t = 0, x[12];
    struct bounds bounds = bounds_of(distance, keep);
    if (!(distance > DR_SWEEP_TOUCHING))
        return limit;
    memcpy(x, pair->x, sizeof x);
    for (int i = 0; i < MAX_ADVANCES && distance > bounds.enough; i++) {
        double n[3] = {c.r[0] / distance, c.r[1] / distance, c.r[2] / distance};
        t += safe_time(pair, x, n, bounds.goal);
        if (!(t < limit))
            return limit;
        for (int k = 0; k < 12; k++)
            x[k] = pair->x[k] + t * pair->w[k];
        c = closest(x, pair->edges);
        distance = sqrt(c.square);
    }
    return t;
}

/* ---- all pairs -------------------------------------------------------------------------------- */

/* One half of them. */
struct sweep {
    const struct dr_pairs *pairs;
    const double *x, *w;
    double keep, t;       /* t: the part of the step still looked at */
    double near;          /* m: all pairs closer than this at x are in the lists; 0: nothing is known */
    double *share;        /* nodes: what is left of each node's move; NULL: one t for all */
    const uint8_t *moved; /* tree nodes: below which a move has changed; NULL: all */
    size_t left;          /* pairs of leaves still to look at */
    size_t met;
};

/* Whether the edge crosses the triangle; not if they share a node. */
static bool pierces(const struct dr_pairs *pairs, const double *x, uint32_t side, uint32_t triangle)
{
    const uint32_t *corner = pairs->mesh->triangle + 3 * (size_t)triangle;
    const uint32_t *end = pairs->side + 2 * (size_t)side;
    return !dr_pairs_shares_node(corner, end[0]) && !dr_pairs_shares_node(corner, end[1]) &&
           dr_pairs_cross(pairs, x, side, triangle, NULL);
}

/* Whether an edge at the vertex crosses the triangle. */
static bool face_is_crossed(const struct dr_pairs *pairs, const double *x, uint32_t vertex, uint32_t triangle)
{
    for (uint32_t i = pairs->first_side[vertex]; i < pairs->first_side[vertex + 1]; i++)
        if (pierces(pairs, x, pairs->node_side[i], triangle))
            return true;
    return false;
}

/* Whether one of the edges crosses a triangle of the other. */
static bool edges_are_crossed(const struct dr_pairs *pairs, const double *x, uint32_t a, uint32_t b)
{
    for (size_t k = 0; k < 2; k++) {
        uint32_t at_a = pairs->side_triangle[2 * (size_t)a + k],
                 at_b = pairs->side_triangle[2 * (size_t)b + k];
        if ((at_b != DR_NONE && pierces(pairs, x, a, at_b)) ||
            (at_a != DR_NONE && pierces(pairs, x, b, at_a)))
            return true;
    }
    return false;
}

/* a, b: as in struct dr_pair. */
static void try_pair(struct sweep *sweep, const uint32_t node[4], bool edges, uint32_t a, uint32_t b)
{
    if (stays_apart(sweep->x, sweep->w, node, edges, sweep->keep, sweep->t) ||
        dr_pairs_are_welded(sweep->pairs, node, edges))
        return;
    struct pair pair = load(sweep->x, sweep->w, node, edges);
    double t = meeting(&pair, sweep->keep, sweep->t);
    if (!(t < sweep->t))
        return;
    if (edges ? edges_are_crossed(sweep->pairs, sweep->x, a, b)
              : face_is_crossed(sweep->pairs, sweep->x, a, b))
        return;
    sweep->met++;
    if (!sweep->share)
        sweep->t = t;
    for (int i = 0; sweep->share && i < 4; i++)
        sweep->share[node[i]] = fmin(sweep->share[node[i]], t);
}

/* What two boxes can do along one axis. */
struct axis {
    double gap;    /* between them, m */
    double left;   /* of it at t at least, < 0: they may pass, m */
    double length; /* the largest difference of their motions, m */
    double reach;  /* the farthest that a point of one is from a point of the other, m */
};

static inline struct axis along(const struct dr_box *p, const struct dr_box *q, const struct dr_box *v,
                                const struct dr_box *w, int d, double t)
{
    double above = p->low[d] - q->high[d], below = q->low[d] - p->high[d];
    double rise = w->high[d] - v->low[d], fall = v->high[d] - w->low[d]; /* of q up to p, of p up to q */
    double up = above - t * (0 < rise ? rise : 0), down = below - t * (0 < fall ? fall : 0);
    double gap = above > below ? above : below;
    return (struct axis){0 < gap ? gap : 0, up > down ? up : down, rise > fall ? rise : fall,
                         -(above < below ? above : below)};
}

/* Parts of two boxes keep their distance if, along an axis, the boxes stay apart by keep*DR_SWEEP_NEAR; or if
 * the largest difference of their motions is less than what they may close of their gap. And pairs that are
 * not in the lists do where it is too little to bring them so near from so far. */
static inline bool may_meet(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data)
{
    const struct sweep *sweep = data;
    if (sweep->moved && !sweep->moved[a] && !sweep->moved[b])
        return false;
    const struct dr_box *p = bvh->box + a, *q = bvh->box + b, *v = bvh->move + a, *w = bvh->move + b;
    struct axis x = along(p, q, v, w, 0, sweep->t), y = along(p, q, v, w, 1, sweep->t),
                z = along(p, q, v, w, 2, sweep->t);
    double goal = bounds_of(DR_SWEEP_NEAR, sweep->keep).goal;
    if (x.left > goal || y.left > goal || z.left > goal)
        return false;
    double length = sqrt(x.length * x.length + y.length * y.length + z.length * z.length);
    if (sweep->t * length <= sweep->near - DR_SWEEP_NEAR)
        return false;
    double gap = sqrt(x.gap * x.gap + y.gap * y.gap + z.gap * z.gap);
    return sweep->t * length > gap - bounds_of(gap, sweep->keep).goal &&
           x.reach + y.reach + z.reach > DR_SWEEP_TOUCHING; /* else all is in one point */
}

static void try_face(struct sweep *sweep, uint32_t vertex, const struct dr_leaf *leaf)
{
    const uint32_t node[4] = {vertex, leaf->node[0], leaf->node[1], leaf->node[2]};
    if (!dr_pairs_shares_node(leaf->node, vertex))
        try_pair(sweep, node, false, vertex, leaf->triangle);
}

static void try_edges(struct sweep *sweep, uint32_t a, uint32_t b)
{
    const uint32_t *p = sweep->pairs->side + 2 * (size_t)a, *q = sweep->pairs->side + 2 * (size_t)b;
    if (a > b) { /* the order of the lists, or round-off would tell which found the pair */
        try_edges(sweep, b, a);
        return;
    }
    const uint32_t node[4] = {p[0], p[1], q[0], q[1]};
    if (p[0] != q[0] && p[0] != q[1] && p[1] != q[0] && p[1] != q[1])
        try_pair(sweep, node, true, a, b);
}

static inline bool sweep_leaves(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data)
{
    struct sweep *sweep = data;
    const struct dr_leaf *p = dr_bvh_leaf(bvh, a), *q = dr_bvh_leaf(bvh, b);
    if (dr_pairs_are_free(sweep->pairs, p, q))
        return true;
    for (unsigned k = 0; k < 3; k++) {
        if (p->owned >> k & 1)
            try_face(sweep, p->node[k], q);
        if (q->owned >> k & 1)
            try_face(sweep, q->node[k], p);
        for (unsigned i = 0; i < 3 && p->owned >> (3 + k) & 1; i++)
            if (q->owned >> (3 + i) & 1)
                try_edges(sweep, p->edge[k], q->edge[i]);
    }
    return --sweep->left > 0;
}

/* For dr_hand_both. */
struct sweeps {
    struct sweep half[2];
    bool whole[2]; /* each came to its end */
};

/* The pairs of one half of each list, then those that may come from farther. */
static void walk_half(void *data, int half)
{
    struct sweeps *sweeps = data;
    struct sweep *sweep = sweeps->half + half;
    const struct dr_pairs *pairs = sweep->pairs;
    struct dr_bvh_starts starts = dr_bvh_half(pairs->bvh, half);
    size_t face = half ? pairs->face_count / 2 : 0, edge = half ? pairs->edge_count / 2 : 0;
    size_t faces = half ? pairs->face_count : pairs->face_count / 2,
           edges = half ? pairs->edge_count : pairs->edge_count / 2;
    for (; sweep->near > 0 && face < faces; face++)
        try_pair(sweep, pairs->faces[face].node, false, pairs->faces[face].a, pairs->faces[face].b);
    for (; sweep->near > 0 && edge < edges; edge++)
        try_pair(sweep, pairs->edges[edge].node, true, pairs->edges[edge].a, pairs->edges[edge].b);
    sweeps->whole[half] = true;
    for (size_t i = 0; i < starts.count && sweeps->whole[half]; i++)
        sweeps->whole[half] =
            dr_bvh_walk_from(pairs->bvh, starts.pair[i][0], starts.pair[i][1], may_meet, sweep_leaves, sweep);
}

/* What both halves find, into *sweep; its nodes' shares are those of the first half, and the second's lie
 * behind. False when there is too much to look at. */
static bool walk(struct sweep *sweep)
{
    const struct dr_pairs *pairs = sweep->pairs;
    size_t left = MAX_MEETINGS * (pairs->mesh->triangles + 1), nodes = pairs->mesh->nodes;
    sweep->left = left;
    sweep->met = 0;
    struct sweeps sweeps = {{*sweep, *sweep}, {false, false}};
    struct sweep *a = sweeps.half, *b = sweeps.half + 1;
    if (sweep->share) {
        b->share = sweep->share + nodes;
        for (size_t v = 0; v < 2 * nodes; v++)
            sweep->share[v] = 1;
    }
    dr_hand_both(pairs->bvh->hand, walk_half, &sweeps);
    sweep->met = a->met + b->met;
    sweep->t = fmin(a->t, b->t);
    for (size_t v = 0; sweep->share && v < nodes; v++)
        sweep->share[v] = fmin(a->share[v], b->share[v]);
    return sweeps.whole[0] && sweeps.whole[1] && left - a->left + (left - b->left) < left;
}

double dr_sweep(struct dr_pairs *pairs, const double *x, const double *w, double keep, double near)
{
    struct sweep sweep = {.pairs = pairs, .x = x, .w = w, .keep = keep, .t = 1, .near = near};
    dr_bvh_fit(pairs->bvh, x, NULL, pairs->bvh->box);
    dr_bvh_fit(pairs->bvh, w, NULL, pairs->bvh->move);
    for (int i = 0; i < MAX_SHORTER; i++, sweep.t *= SHORTER)
        if (walk(&sweep))
            return sweep.t;
    return 0;
}

/* ---- single moves ----------------------------------------------------------------------------- */

/* Marks the tree nodes over triangles with a node whose move the last round has shortened. */
static void mark_moved(struct dr_pairs *pairs)
{
    const struct dr_bvh *bvh = pairs->bvh;
    for (uint32_t i = (uint32_t)bvh->count; i-- > 0;) {
        if (dr_bvh_is_leaf(bvh, i)) {
            const uint32_t *node = dr_bvh_leaf(bvh, i)->node;
            pairs->moved[i] =
                pairs->share[node[0]] < 1 || pairs->share[node[1]] < 1 || pairs->share[node[2]] < 1;
        } else {
            pairs->moved[i] = pairs->moved[i + 1] || pairs->moved[bvh->right[i]];
        }
    }
}

static void shorten(struct dr_pairs *pairs, double *w)
{
    for (size_t v = 0; v < pairs->mesh->nodes; v++) {
        if (!(pairs->share[v] < 1))
            continue;
        pairs->marked[v] = 1;
        for (size_t d = 0; d < 3; d++)
            w[3 * v + d] *= MARGIN * pairs->share[v];
    }
}

/* False where that does not end, or there is too much to look at. */
static bool clip_rounds(struct dr_pairs *pairs, const double *x, double *w, double keep, double near)
{
    struct sweep sweep = {
        .pairs = pairs, .x = x, .w = w, .keep = keep, .t = 1, .near = near, .share = pairs->share};
    for (int round = 0; round < MAX_ROUNDS; round++) {
        dr_bvh_fit(pairs->bvh, w, NULL, pairs->bvh->move);
        if (!walk(&sweep))
            return false;
        if (!sweep.met)
            return true;
        shorten(pairs, w);
        mark_moved(pairs);
        sweep.moved = pairs->moved;
    }
    return false;
}

size_t dr_sweep_clip(struct dr_pairs *pairs, const double *x, double *w, double keep, double near)
{
    size_t nodes = pairs->mesh->nodes, shortened = 0;
    memset(pairs->marked, 0, nodes * sizeof *pairs->marked);
    dr_bvh_fit(pairs->bvh, x, NULL, pairs->bvh->box);
    if (!clip_rounds(pairs, x, w, keep, near)) {
        double t = dr_sweep(pairs, x, w, keep, near);
        for (size_t v = 0; v < nodes; v++)
            pairs->share[v] = t;
        shorten(pairs, w);
    }
    for (size_t v = 0; v < nodes; v++)
        shortened += pairs->marked[v];
    return shortened;
}
