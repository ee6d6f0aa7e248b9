/* pairs.c - finds the pairs of a mesh's parts that are near each other, and those that cross. */
#include "pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

/* Times that the radius is halved where it finds too many pairs, before it is 0. */
#define HALVINGS 3

/* ---- made and freed --------------------------------------------------------------------------- */

/* Numbers the edges by the first triangle that has them; `number`: 3*triangles. Gives how many. */
static size_t number_sides(const struct dr_mesh *mesh, uint32_t *number)
{
    size_t sides = 0;
    for (size_t t = 0; t < mesh->triangles; t++) {
        for (size_t k = 0; k < 3; k++) {
            uint32_t other = mesh->neighbor[3 * t + k];
            if (other == DR_NONE || other > t)
                number[3 * t + k] = (uint32_t)sides++;
            else
                number[3 * t + k] = number[3 * (size_t)other + mesh->across[3 * t + k]];
        }
    }
    return sides;
}

static bool allocate(struct dr_pairs *pairs)
{
    size_t nodes = pairs->mesh->nodes ? pairs->mesh->nodes : 1, sides = pairs->sides ? pairs->sides : 1;
    pairs->side = malloc(2 * sides * sizeof *pairs->side);
    pairs->side_triangle = malloc(2 * sides * sizeof *pairs->side_triangle);
    pairs->first_side = calloc(nodes + 1, sizeof *pairs->first_side);
    pairs->node_side = malloc(2 * sides * sizeof *pairs->node_side);
    pairs->share = malloc(nodes * sizeof *pairs->share);
    pairs->marked = malloc(nodes * sizeof *pairs->marked);
    pairs->moved = malloc((2 * pairs->mesh->triangles + 1) * sizeof *pairs->moved);
    return pairs->side && pairs->side_triangle && pairs->first_side && pairs->node_side && pairs->share &&
           pairs->marked && pairs->moved;
}

static void fill_sides(struct dr_pairs *pairs, const uint32_t *number)
{
    const struct dr_mesh *mesh = pairs->mesh;
    for (size_t t = 0; t < mesh->triangles; t++) {
        for (size_t k = 0; k < 3; k++) {
            uint32_t other = mesh->neighbor[3 * t + k], *side = pairs->side + 2 * (size_t)number[3 * t + k];
            uint32_t a = mesh->triangle[3 * t + (k + 1) % 3], b = mesh->triangle[3 * t + (k + 2) % 3];
            if (other != DR_NONE && other < t)
                continue;
            side[0] = a < b ? a : b;
            side[1] = a < b ? b : a;
            pairs->side_triangle[2 * (size_t)number[3 * t + k]] = (uint32_t)t;
            pairs->side_triangle[2 * (size_t)number[3 * t + k] + 1] = other;
        }
    }
}

/* Each node's edges, by counting. */
static void list_node_sides(struct dr_pairs *pairs)
{
    size_t nodes = pairs->mesh->nodes;
    uint32_t *first = pairs->first_side;
    for (size_t i = 0; i < 2 * pairs->sides; i++)
        first[pairs->side[i] + 1]++;
    for (size_t v = 0; v < nodes; v++)
        first[v + 1] += first[v];
    for (size_t i = 2 * pairs->sides; i-- > 0;) { /* from each end, which thus becomes the beginning */
        uint32_t v = pairs->side[i];
        pairs->node_side[--first[v + 1]] = (uint32_t)(i / 2);
    }
    memmove(first, first + 1, nodes * sizeof *first);
    first[nodes] = (uint32_t)(2 * pairs->sides);
}

drape_status dr_pairs_new(const struct dr_mesh *mesh, struct dr_pairs **ret, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    struct dr_pairs *pairs = calloc(1, sizeof *pairs);
    uint32_t *number = malloc((3 * mesh->triangles + 1) * sizeof *number);
    if (!pairs || !number) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    pairs->mesh = mesh;
    pairs->sides = number_sides(mesh, number);
    if (!allocate(pairs)) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    fill_sides(pairs, number);
    list_node_sides(pairs);
    status = dr_bvh_new(mesh, number, &pairs->bvh, reterr);
    if (status < 0)
        goto cleanup;
    *ret = pairs;
    pairs = NULL;

cleanup:
    free(number);
    dr_pairs_free(pairs);
    return status;
}

struct dr_pairs *dr_pairs_free(struct dr_pairs *pairs)
{
    if (pairs) {
        dr_bvh_free(pairs->bvh);
        free(pairs->side);
        free(pairs->side_triangle);
        free(pairs->faces);
        free(pairs->edges);
        free(pairs->first_side);
        free(pairs->node_side);
        free(pairs->share);
        free(pairs->marked);
        free(pairs->moved);
        free(pairs);
    }
    return NULL;
}

void dr_pairs_between(struct dr_pairs *pairs, const uint32_t *part)
{
    pairs->part = part;
}

void dr_pairs_weld(struct dr_pairs *pairs, const uint32_t *weld)
{
    pairs->part = NULL;
    pairs->weld = weld;
}

void dr_pairs_without(struct dr_pairs *pairs, const bool *absent)
{
    pairs->absent = absent;
}

size_t dr_pairs_bytes(const struct dr_pairs *pairs)
{
    const struct dr_mesh *mesh = pairs->mesh;
    size_t per_side = 2 * (sizeof *pairs->side + sizeof *pairs->side_triangle + sizeof *pairs->node_side);
    size_t per_node = sizeof *pairs->first_side + sizeof *pairs->share + sizeof *pairs->marked;
    return sizeof *pairs + sizeof *pairs->first_side + dr_bvh_bytes(pairs->bvh) + pairs->sides * per_side +
           mesh->nodes * per_node + pairs->bvh->count * sizeof *pairs->moved +
           pairs->face_room * sizeof *pairs->faces + pairs->edge_room * sizeof *pairs->edges;
}

/* ---- search ----------------------------------------------------------------------------------- */

struct search {
    struct dr_pairs *pairs;
    const double *x;
    double square; /* of the radius */
    size_t left;   /* pairs of leaves still to look at */
    bool starved;  /* of memory */
    double still;  /* squared, of dr_pairs_add: what moves less against each other has no new pairs, m */
    size_t old_faces, old_edges; /* at the head of the lists, sorted; dr_pairs_add's, else 0 */
};

/* Room for one more pair; *list and *room grow by half. */
static bool make_room(struct dr_pair **list, size_t *room, size_t count)
{
    if (count < *room)
        return true;
    size_t more = *room + *room / 2 + 256;
    struct dr_pair *grown = realloc(*list, more * sizeof *grown);
    if (!grown)
        return false;
    *list = grown;
    *room = more;
    return true;
}

static int compare_pairs(const void *left, const void *right)
{
    const struct dr_pair *p = left, *q = right;
    if (p->a != q->a)
        return p->a < q->a ? -1 : 1;
    return p->b < q->b ? -1 : p->b > q->b;
}

static bool is_listed(const struct dr_pair *pair, const struct dr_pair *list, size_t count)
{
    return count && bsearch(pair, list, count, sizeof *list, compare_pairs);
}

static void sort(struct dr_pair *list, size_t count)
{
    if (count)
        qsort(list, count, sizeof *list, compare_pairs);
}

static bool may_add(const struct dr_pairs *pairs)
{
    return pairs->face_count + pairs->edge_count < DR_PAIRS_PER_TRIANGLE * pairs->mesh->triangles;
}

/* Vertex `node` against the triangle of `leaf`. False to end the walk. */
static bool try_face(struct search *search, uint32_t node, const struct dr_leaf *leaf,
                     const struct dr_box *box)
{
    struct dr_pairs *pairs = search->pairs;
    const double *v = search->x + 3 * (size_t)node;
    double gap[3] = {dr_gap(v[0], v[0], box->low[0], box->high[0]),
                     dr_gap(v[1], v[1], box->low[1], box->high[1]),
                     dr_gap(v[2], v[2], box->low[2], box->high[2])};
    if (dr_dot(gap, gap) >= search->square || dr_pairs_shares_node(leaf->node, node))
        return true;
    struct dr_pair pair = {{node, leaf->node[0], leaf->node[1], leaf->node[2]}, node, leaf->triangle};
    if (!(dr_closest_vertex_face(search->x, pair.node).square < search->square) ||
        dr_pairs_are_welded(pairs, pair.node, false) || is_listed(&pair, pairs->faces, search->old_faces))
        return true;
    if (!may_add(pairs))
        return false;
    search->starved = !make_room(&pairs->faces, &pairs->face_room, pairs->face_count);
    if (!search->starved)
        pairs->faces[pairs->face_count++] = pair;
    return !search->starved;
}

/* How far apart a..b and c..d are along one axis. (Both ends by one comparison would be a branch.) */
static inline double edge_gap(double a, double b, double c, double d)
{
    return dr_gap(a < b ? a : b, a > b ? a : b, c < d ? c : d, c > d ? c : d);
}

/* Squared distance of the boxes round two edges. */
static inline double edge_distance(const double *x, const uint32_t p[2], const uint32_t q[2])
{
    const double *a = x + 3 * (size_t)p[0], *b = x + 3 * (size_t)p[1], *c = x + 3 * (size_t)q[0],
                 *d = x + 3 * (size_t)q[1];
    double gap[3] = {edge_gap(a[0], b[0], c[0], d[0]), edge_gap(a[1], b[1], c[1], d[1]),
                     edge_gap(a[2], b[2], c[2], d[2])};
    return dr_dot(gap, gap);
}

static bool try_edges(struct search *search, uint32_t a, uint32_t b)
{
    struct dr_pairs *pairs = search->pairs;
    const uint32_t *p = pairs->side + 2 * (size_t)a, *q = pairs->side + 2 * (size_t)b;
    if (p[0] == q[0] || p[0] == q[1] || p[1] == q[0] || p[1] == q[1] ||
        edge_distance(search->x, p, q) >= search->square)
        return true;
    struct dr_pair pair = {{p[0], p[1], q[0], q[1]}, a, b};
    if (!(dr_closest_edge_edge(search->x, pair.node).square < search->square) ||
        dr_pairs_are_welded(pairs, pair.node, true) || is_listed(&pair, pairs->edges, search->old_edges))
        return true;
    if (!may_add(pairs))
        return false;
    search->starved = !make_room(&pairs->edges, &pairs->edge_room, pairs->edge_count);
    if (!search->starved)
        pairs->edges[pairs->edge_count++] = pair;
    return !search->starved;
}

static inline bool boxes_near(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data)
{
    const struct search *search = data;
    return !(dr_box_distance(bvh->box + a, bvh->box + b) >= search->square);
}

static inline bool find_in_leaves(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data)
{
    struct search *search = data;
    const struct dr_leaf *p = dr_bvh_leaf(bvh, a), *q = dr_bvh_leaf(bvh, b);
    if (dr_pairs_are_free(search->pairs, p, q))
        return true;
    for (unsigned k = 0; k < 3; k++) {
        if (p->owned >> k & 1 && !try_face(search, p->node[k], q, bvh->box + b))
            return false;
        if (q->owned >> k & 1 && !try_face(search, q->node[k], p, bvh->box + a))
            return false;
        for (unsigned i = 0; i < 3 && p->owned >> (3 + k) & 1; i++) {
            uint32_t e = p->edge[k], f = q->edge[i];
            if (q->owned >> (3 + i) & 1 && !try_edges(search, e < f ? e : f, e < f ? f : e))
                return false;
        }
    }
    return --search->left > 0;
}

drape_status dr_pairs_find(struct dr_pairs *pairs, const double *x, double radius, drape_error *reterr)
{
    struct search search = {.pairs = pairs, .x = x};
    dr_bvh_fit(pairs->bvh, x, NULL, pairs->bvh->box);
    for (int halved = 0;; halved++, radius /= 2) {
        pairs->radius = halved <= HALVINGS ? radius : 0;
        pairs->face_count = pairs->edge_count = 0;
        search.square = pairs->radius * pairs->radius;
        search.left = DR_PAIRS_MAX_MEETINGS * (pairs->mesh->triangles + 1);
        if (dr_bvh_walk(pairs->bvh, boxes_near, find_in_leaves, &search))
            break;
        if (search.starved) {
            pairs->face_count = pairs->edge_count = 0;
            return dr_out_of_memory(reterr);
        }
    }
    sort(pairs->faces, pairs->face_count);
    sort(pairs->edges, pairs->edge_count);
    return DRAPE_OK;
}

/* Whether a part of one box may have come near a part of the other that was far. */
static inline bool boxes_come_near(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data)
{
    const struct search *search = data;
    const struct dr_box *v = bvh->move + a, *w = bvh->move + b;
    double square = 0;
    for (int d = 0; d < 3; d++) {
        double rise = w->high[d] - v->low[d], fall = v->high[d] - w->low[d];
        double most = rise > fall ? rise : fall;
        square += most * most;
    }
    return !(square <= search->still) && boxes_near(bvh, a, b, data);
}

bool dr_pairs_add(struct dr_pairs *pairs, const double *from, const double *x, double radius)
{
    double still = pairs->radius - radius; /* m */
    struct search search = {.pairs = pairs,
                            .x = x,
                            .square = radius * radius,
                            .left = pairs->mesh->triangles + 1,
                            .still = still * still,
                            .old_faces = pairs->face_count,
                            .old_edges = pairs->edge_count};
    dr_bvh_fit(pairs->bvh, x, NULL, pairs->bvh->box);
    dr_bvh_fit(pairs->bvh, x, from, pairs->bvh->move);
    bool whole = dr_bvh_walk(pairs->bvh, boxes_come_near, find_in_leaves, &search);
    if (pairs->face_count > search.old_faces)
        sort(pairs->faces, pairs->face_count);
    if (pairs->edge_count > search.old_edges)
        sort(pairs->edges, pairs->edge_count);
    return whole;
}

/* ---- crossings -------------------------------------------------------------------------------- */

/* How far outside the triangle, in parts of it, an edge counts as passing through its border: a crossing of
 * the edge between two triangles then belongs to both, and round-off cannot take it from both. */
#define CROSSING_SLACK 1e-12

/* Where a - o and b - o lie on the two sides of the plane with normal n through o, the part of the way from a
 * to b to the plane; else -1. Within round-off of the plane is on neither side. */
static double plane_crossing(const double a[3], const double b[3], const double n[3], double size)
{
    double ha = dr_dot(a, n), hb = dr_dot(b, n);
    double noise =
        1e-15 * (fabs(a[0]) + fabs(a[1]) + fabs(a[2]) + fabs(b[0]) + fabs(b[1]) + fabs(b[2])) * size;
    bool apart = (ha > noise && hb < -noise) || (ha < -noise && hb > noise);
    return apart ? ha / (ha - hb) : -1;
}

bool dr_pairs_cross(const struct dr_pairs *pairs, const double *x, uint32_t side, uint32_t triangle,
                    double ret_at[3])
{
    const uint32_t *end = pairs->side + 2 * (size_t)side,
                   *corner = pairs->mesh->triangle + 3 * (size_t)triangle;
    const double *o = x + 3 * (size_t)corner[0];
    double a[3], b[3], e1[3], e2[3], n[3], q[3], c[3];
    dr_between(o, x + 3 * (size_t)end[0], a);
    dr_between(o, x + 3 * (size_t)end[1], b);
    dr_between(o, x + 3 * (size_t)corner[1], e1);
    dr_between(o, x + 3 * (size_t)corner[2], e2);
    dr_cross(e1, e2, n);
    double nn = dr_dot(n, n);
    double part = plane_crossing(a, b, n, sqrt(dr_dot(e1, e1) * dr_dot(e2, e2)));
    if (part < 0)
        return false;
    for (int d = 0; d < 3; d++)
        q[d] = a[d] + part * (b[d] - a[d]);
    dr_cross(q, e2, c);
    double u = dr_dot(c, n) / nn;
    dr_cross(e1, q, c);
    double v = dr_dot(c, n) / nn;
    if (!(u >= -CROSSING_SLACK && v >= -CROSSING_SLACK && u + v <= 1 + CROSSING_SLACK))
        return false;
    for (int d = 0; ret_at && d < 3; d++)
        ret_at[d] = o[d] + q[d];
    return true;
}

struct crossings {
    const struct dr_pairs *pairs;
    const double *x;
    size_t count, left; /* left: pairs of leaves still to look at */
    struct dr_crossing first;
};

/* The edges of `p` against the triangle of `q`. */
static void count_crossings(struct crossings *crossings, const struct dr_leaf *p, const struct dr_leaf *q)
{
    const struct dr_pairs *pairs = crossings->pairs;
    struct dr_crossing *first = &crossings->first;
    for (unsigned k = 0; k < 3; k++) {
        const uint32_t *end = pairs->side + 2 * (size_t)p->edge[k];
        struct dr_crossing found = {.side = p->edge[k], .triangle = q->triangle};
        if (!(p->owned >> (3 + k) & 1) || dr_pairs_shares_node(q->node, end[0]) ||
            dr_pairs_shares_node(q->node, end[1]) ||
            !dr_pairs_cross(pairs, crossings->x, found.side, found.triangle, found.at))
            continue;
        if (!crossings->count++ || found.side < first->side ||
            (found.side == first->side && found.triangle < first->triangle))
            *first = found;
    }
}

/* Boxes that touch. Two that are one and the same point hold nothing that could cross. */
static inline bool boxes_touch(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data)
{
    (void)data;
    const struct dr_box *p = bvh->box + a, *q = bvh->box + b;
    bool point = true;
    for (int d = 0; d < 3; d++) {
        if (p->low[d] > q->high[d] || q->low[d] > p->high[d])
            return false;
        point = point && p->low[d] == p->high[d] && q->low[d] == q->high[d];
    }
    return !point;
}

static inline bool cross_in_leaves(const struct dr_bvh *bvh, uint32_t a, uint32_t b, void *data)
{
    struct crossings *crossings = data;
    count_crossings(crossings, dr_bvh_leaf(bvh, a), dr_bvh_leaf(bvh, b));
    count_crossings(crossings, dr_bvh_leaf(bvh, b), dr_bvh_leaf(bvh, a));
    return crossings->count < DR_PAIRS_MAX_CROSSINGS && --crossings->left > 0;
}

size_t dr_pairs_crossings(struct dr_pairs *pairs, const double *x, struct dr_crossing *ret_first)
{
    struct crossings crossings = {
        .pairs = pairs, .x = x, .left = DR_PAIRS_MAX_MEETINGS * (pairs->mesh->triangles + 1)};
    dr_bvh_fit(pairs->bvh, x, NULL, pairs->bvh->box);
    (void)dr_bvh_walk(pairs->bvh, boxes_touch, cross_in_leaves, &crossings);
    if (crossings.count && ret_first)
        *ret_first = crossings.first;
    return crossings.count < DR_PAIRS_MAX_CROSSINGS ? crossings.count : DR_PAIRS_MAX_CROSSINGS;
}
