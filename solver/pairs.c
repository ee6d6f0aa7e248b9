/* pairs.c - finds the pairs of a mesh's parts that are near each other, and those that cross. */
#include "pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

/* Times that the radius is halved where it finds too many pairs, before it is 0. */
#define HALVINGS 3

#define WORTH_SHARING 5000 /* triangles: half of a search takes longer than waking somebody */

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
    pairs->share = malloc(2 * nodes * sizeof *pairs->share);
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

void dr_pairs_lend(struct dr_pairs *pairs, struct dr_hand *hand)
{
    pairs->bvh->hand = pairs->mesh->triangles < WORTH_SHARING ? NULL : hand;
}

/* Gives back what a search needed for a while. */
static void drop_found(struct dr_pairs *pairs)
{
    for (int i = 0; i < 4; i++) {
        struct dr_pair_list *list = &pairs->found[i / 2][i % 2];
        free(list->pair);
        *list = (struct dr_pair_list){.pair = NULL};
    }
}

struct dr_pairs *dr_pairs_free(struct dr_pairs *pairs)
{
    if (pairs) {
        drop_found(pairs);
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
    size_t per_node = sizeof *pairs->first_side + 2 * sizeof *pairs->share + sizeof *pairs->marked;
    size_t found = 0;
    for (int i = 0; i < 4; i++)
        found += pairs->found[i / 2][i % 2].room * sizeof(struct dr_pair);
    return sizeof *pairs + sizeof *pairs->first_side + dr_bvh_bytes(pairs->bvh) + pairs->sides * per_side +
           mesh->nodes * per_node + pairs->bvh->count * sizeof *pairs->moved +
           pairs->face_room * sizeof *pairs->faces + pairs->edge_room * sizeof *pairs->edges + found;
}

/* ---- search ----------------------------------------------------------------------------------- */

/* One half of it. */
struct search {
    const struct dr_pairs *pairs;
    struct dr_pair_list *found; /* faces and edges */
    const double *x;
    double square; /* of the radius */
    size_t left;   /* pairs of leaves still to look at */
    bool starved;  /* of memory */
    double still;  /* squared, of dr_pairs_add: what moves less against each other has no new pairs, m */
    size_t old_faces, old_edges; /* in the lists already, sorted; dr_pairs_add's, else 0 */
};

/* Room for `more` pairs; grows by half. */
static bool make_room(struct dr_pair **list, size_t *room, size_t count, size_t more)
{
    if (count + more <= *room)
        return true;
    size_t roomy = *room + *room / 2 + 256;
    if (roomy < count + more)
        roomy = count + more;
    struct dr_pair *grown = realloc(*list, roomy * sizeof *grown);
    if (!grown)
        return false;
    *list = grown;
    *room = roomy;
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

/* The most pairs that may be listed. */
static size_t most_pairs(const struct dr_pairs *pairs)
{
    return DR_PAIRS_PER_TRIANGLE * pairs->mesh->triangles;
}

/* False when there are too many, or no memory. */
static bool keep(struct search *search, int kind, const struct dr_pair *pair)
{
    struct dr_pair_list *list = search->found + kind;
    if (search->old_faces + search->old_edges + search->found[0].count + search->found[1].count >=
        most_pairs(search->pairs))
        return false;
    search->starved = !make_room(&list->pair, &list->room, list->count, 1);
    if (!search->starved)
        list->pair[list->count++] = *pair;
    return !search->starved;
}

/* Vertex `node` against the triangle of `leaf`. False to end the walk. */
static bool try_face(struct search *search, uint32_t node, const struct dr_leaf *leaf,
                     const struct dr_box *box)
{
    const struct dr_pairs *pairs = search->pairs;
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
    return keep(search, 0, &pair);
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
    const struct dr_pairs *pairs = search->pairs;
    const uint32_t *p = pairs->side + 2 * (size_t)a, *q = pairs->side + 2 * (size_t)b;
    if (p[0] == q[0] || p[0] == q[1] || p[1] == q[0] || p[1] == q[1] ||
        edge_distance(search->x, p, q) >= search->square)
        return true;
    struct dr_pair pair = {{p[0], p[1], q[0], q[1]}, a, b};
    if (!(dr_closest_edge_edge(search->x, pair.node).square < search->square) ||
        dr_pairs_are_welded(pairs, pair.node, true) || is_listed(&pair, pairs->edges, search->old_edges))
        return true;
    return keep(search, 1, &pair);
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

/* For dr_hand_both. */
struct searches {
    struct search half[2];
    bool whole[2]; /* each came to its end */
};

static inline __attribute__((always_inline)) void search_half(struct searches *searches, int half,
                                                              dr_bvh_near *near)
{
    struct search *search = searches->half + half;
    const struct dr_bvh *bvh = search->pairs->bvh;
    struct dr_bvh_starts starts = dr_bvh_half(bvh, half);
    searches->whole[half] = true;
    for (size_t i = 0; i < starts.count && searches->whole[half]; i++)
        searches->whole[half] =
            dr_bvh_walk_from(bvh, starts.pair[i][0], starts.pair[i][1], near, find_in_leaves, search);
}

static void find_half(void *searches, int half)
{
    search_half(searches, half, boxes_near);
}

/* Two halves like `search`, which may look at `left` pairs of leaves together. */
static struct searches halve(struct dr_pairs *pairs, struct search search, size_t left)
{
    struct searches searches = {{search, search}, {false, false}};
    for (int i = 0; i < 2; i++) {
        searches.half[i].pairs = pairs;
        searches.half[i].found = pairs->found[i];
        searches.half[i].left = left;
        pairs->found[i][0].count = pairs->found[i][1].count = 0;
    }
    return searches;
}

/* What both halves found joins the lists, which then wait to be sorted. True if that is all there is: neither
 * was ended, nor were both together too much. *ret_starved: of memory. */
static bool join(struct dr_pairs *pairs, const struct searches *searches, size_t left, bool *ret_starved)
{
    const struct search *a = searches->half, *b = searches->half + 1;
    bool whole = searches->whole[0] && searches->whole[1] && left - a->left + (left - b->left) < left;
    size_t faces = 0, edges = 0;
    for (int i = 0; i < 2; i++) {
        faces += pairs->found[i][0].count;
        edges += pairs->found[i][1].count;
    }
    bool fits = pairs->face_count + pairs->edge_count + faces + edges <= most_pairs(pairs);
    *ret_starved = a->starved || b->starved ||
                   (fits && (!make_room(&pairs->faces, &pairs->face_room, pairs->face_count, faces) ||
                             !make_room(&pairs->edges, &pairs->edge_room, pairs->edge_count, edges)));
    if (*ret_starved || !fits)
        return false;
    for (int i = 0; i < 2; i++) {
        const struct dr_pair_list *face = pairs->found[i], *edge = face + 1;
        if (face->count)
            memcpy(pairs->faces + pairs->face_count, face->pair, face->count * sizeof *face->pair);
        if (edge->count)
            memcpy(pairs->edges + pairs->edge_count, edge->pair, edge->count * sizeof *edge->pair);
        pairs->face_count += face->count;
        pairs->edge_count += edge->count;
    }
    return whole;
}

/* For dr_hand_both. */
static void sort_half(void *data, int half)
{
    struct dr_pairs *pairs = data;
    if (half)
        sort(pairs->edges, pairs->edge_count);
    else
        sort(pairs->faces, pairs->face_count);
}

drape_status dr_pairs_find(struct dr_pairs *pairs, const double *x, double radius, drape_error *reterr)
{
    size_t left = DR_PAIRS_MAX_MEETINGS * (pairs->mesh->triangles + 1);
    dr_bvh_fit(pairs->bvh, x, NULL, pairs->bvh->box);
    for (int halved = 0;; halved++, radius /= 2) {
        bool starved;
        pairs->radius = halved <= HALVINGS ? radius : 0;
        pairs->face_count = pairs->edge_count = 0;
        struct searches searches =
            halve(pairs, (struct search){.x = x, .square = pairs->radius * pairs->radius}, left);
        dr_hand_both(pairs->bvh->hand, find_half, &searches);
        bool whole = join(pairs, &searches, left, &starved);
        drop_found(pairs); /* of a heap as much as the lists */
        if (whole)
            break;
        pairs->face_count = pairs->edge_count = 0;
        if (starved)
            return dr_out_of_memory(reterr);
    }
    dr_hand_both(pairs->bvh->hand, sort_half, pairs);
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

static void add_half(void *searches, int half)
{
    search_half(searches, half, boxes_come_near);
}

bool dr_pairs_add(struct dr_pairs *pairs, const double *from, const double *x, double radius)
{
    double still = pairs->radius - radius; /* m */
    size_t left = pairs->mesh->triangles + 1, faces = pairs->face_count, edges = pairs->edge_count;
    struct search like = {
        .x = x, .square = radius * radius, .still = still * still, .old_faces = faces, .old_edges = edges};
    struct searches searches = halve(pairs, like, left);
    bool starved;
    dr_bvh_fit(pairs->bvh, x, NULL, pairs->bvh->box);
    dr_bvh_fit(pairs->bvh, x, from, pairs->bvh->move);
    dr_hand_both(pairs->bvh->hand, add_half, &searches);
    bool whole = join(pairs, &searches, left, &starved);
    if (pairs->face_count > faces)
        sort(pairs->faces, pairs->face_count);
    if (pairs->edge_count > edges)
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
