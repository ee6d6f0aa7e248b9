/* seam.c - finds seams sewn the wrong way round, and cloth whose triangles disagree about its outer side.
 *
 * The list of seams is cut into runs: pairs of which each follows the one before along an edge of the cloth,
 * without a corner. Two things tell how the sides of a run lie to each other.
 *   - Winding: on a surface all of whose triangles run the same way round, two that share an edge pass it in
 *     opposite directions. Triangles joined by a seam that pass it in the same one have their outer sides on
 *     different sides: the seam is crossed, or one of its pieces is wound inside out. Where both sides are of
 *     one piece only the first is left: a Moebius band.
 *   - The start: reversing one side keeps the sum of its points and changes what is odd about its middle.
 * With p, q the odd parts, p_k = (a_k - a_(n-1-k))/2, `along` = p.q/(|p||q|) is 1 for sides that start alike,
 * -1 for sides that start the other way round. A half disc laid flat, to be sewn into a cone, does so by
 *     rights: within one piece the winding decides. */
#include "seam.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "mesh.h"

#define CLEARLY 0.5  /* |along|: cosine of what two straight sides make */
#define LEAST   0.05 /* of a side's extent that must be odd for it to have a direction */
#define STRAIGHT                                                                                             \
    0.5 /* cosine of the turn from one edge of a run to the next: beyond 60 degrees is a corner */

/* One side of a triangle between two nodes. */
struct side {
    uint32_t low, high, triangle;
    uint32_t vertex[2]; /* at low and at high */
    bool forward;       /* the triangle passes it from low to high */
};

/* Sides sorted by their nodes, and what is found about them. */
struct search {
    const drape_scene_desc *desc;
    const uint32_t *node; /* of each vertex */
    struct side *side;    /* 3*triangles */
    bool *told;           /* sides: a warning speaks of it */
    uint32_t *piece;      /* vertices: a vertex of the same piece, the same for all of it */
    drape_error *ret;
    size_t count;
};

/* A run's first and last pair and what speaks for either reading. */
struct seam_run {
    size_t first, last;
    size_t same, opposite; /* edges that both triangles pass in the same direction, or in opposite ones */
    double along;
};

/* Where the next warning goes; NULL when there are too many already. */
static drape_error *next_warning(struct search *search)
{
    return search->count++ < DRAPE_MAX_WARNINGS ? search->ret + search->count - 1 : NULL;
}

/* ---- edges and pieces ------------------------------------------------------------------------- */

static int compare_nodes(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    return a->high < b->high ? -1 : a->high > b->high;
}

static int compare_sides(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    int nodes = compare_nodes(left, right);
    return nodes ? nodes : a->triangle < b->triangle ? -1 : a->triangle > b->triangle;
}

static void sort_sides(struct search *search)
{
    const drape_scene_desc *desc = search->desc;
    for (size_t i = 0; i < 3 * desc->triangles; i++) {
        uint32_t a = desc->triangle[i], b = desc->triangle[i % 3 == 2 ? i - 2 : i + 1];
        uint32_t from = search->node[a], to = search->node[b];
        search->side[i] = from < to ? (struct side){from, to, (uint32_t)(i / 3), {a, b}, true}
                                    : (struct side){to, from, (uint32_t)(i / 3), {b, a}, false};
    }
    qsort(search->side, 3 * desc->triangles, sizeof *search->side, compare_sides);
}

/* The first side between two nodes; NULL: no edge joins them. */
static struct side *find_side(const struct search *search, uint32_t from, uint32_t to)
{
    size_t low = 0, high = 3 * search->desc->triangles, end = high;
    struct side wanted = {.low = from < to ? from : to, .high = from < to ? to : from};
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (compare_nodes(search->side + middle, &wanted) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low < end && compare_nodes(search->side + low, &wanted) == 0 ? search->side + low : NULL;
}

/* The edge's other side, which a checked cloth has next to the first; NULL: a free edge. */
static struct side *other_side(const struct search *search, struct side *first)
{
    struct side *next = first + 1, *end = search->side + 3 * search->desc->triangles;
    return next < end && compare_nodes(first, next) == 0 ? next : NULL;
}

static bool is_sewn(const struct side *a, const struct side *b)
{
    return a->vertex[0] != b->vertex[0] || a->vertex[1] != b->vertex[1];
}

static uint32_t find_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

static void find_pieces(struct search *search)
{
    const drape_scene_desc *desc = search->desc;
    for (size_t v = 0; v < desc->vertices; v++)
        search->piece[v] = (uint32_t)v;
    for (size_t i = 0; i < 3 * desc->triangles; i++)
        search->piece[find_root(search->piece, desc->triangle[i])] =
            find_root(search->piece, desc->triangle[i / 3 * 3]);
    for (size_t v = 0; v < desc->vertices; v++)
        search->piece[v] = find_root(search->piece, (uint32_t)v);
}

/* ---- runs ------------------------------------------------------------------------------------- */

static uint32_t seam_node(const struct search *search, size_t seam)
{
    return search->node[search->desc->seam[2 * seam]];
}

/* Whether one side of the seam keeps its direction, in the pattern, from pair k-1 over k to k+1. */
static bool is_straight(const drape_scene_desc *desc, size_t k, size_t which)
{
    double step[2][2], product = 0, square[2] = {0, 0};
    for (size_t i = 0; i < 2; i++)
        for (size_t d = 0; d < 2; d++) {
            size_t to = desc->seam[2 * (k + i) + which], from = desc->seam[2 * (k + i) - 2 + which];
            step[i][d] = desc->pattern[2 * to + d] - desc->pattern[2 * from + d];
            square[i] += step[i][d] * step[i][d];
        }
    for (size_t d = 0; d < 2; d++)
        product += step[0][d] * step[1][d];
    return product >= STRAIGHT * sqrt(square[0] * square[1]); /* also where one of them is no step */
}

/* From pair `first` on, as far as the seam runs on along edges without a corner. */
static struct seam_run follow(const struct search *search, size_t first)
{
    const drape_scene_desc *desc = search->desc;
    struct seam_run run = {.first = first, .last = first};
    for (size_t k = first; k + 1 < desc->seams; k++) {
        struct side *side = find_side(search, seam_node(search, k), seam_node(search, k + 1));
        if (!side || (k > first && (!is_straight(desc, k, 0) || !is_straight(desc, k, 1))))
            break;
        struct side *other = other_side(search, side);
        if (other && is_sewn(side, other)) {
            run.same += side->forward == other->forward;
            run.opposite += side->forward != other->forward;
        }
        run.last = k + 1;
    }
    return run;
}

static const double *seam_point(const drape_scene_desc *desc, size_t seam, size_t which)
{
    return desc->positions + 3 * (size_t)desc->seam[2 * seam + which];
}

/* The square of one side's extent about its mean. */
static double extent(const drape_scene_desc *desc, const struct seam_run *run, size_t which)
{
    double mean[3] = {0, 0, 0}, sum = 0, pairs = (double)(run->last - run->first + 1);
    for (size_t k = run->first; k <= run->last; k++)
        for (int d = 0; d < 3; d++)
            mean[d] += seam_point(desc, k, which)[d] / pairs;
    for (size_t k = run->first; k <= run->last; k++)
        for (int d = 0; d < 3; d++)
            sum += pow(seam_point(desc, k, which)[d] - mean[d], 2);
    return sum;
}

/* How the two sides of the run start to each other, -1 to 1; 0 where a side has no direction. */
static double measure_along(const drape_scene_desc *desc, const struct seam_run *run)
{
    double product = 0, square[2] = {0, 0};
    for (size_t k = run->first; k <= run->last; k++) {
        size_t back = run->last - (k - run->first);
        for (int d = 0; d < 3; d++) {
            double p = (seam_point(desc, k, 0)[d] - seam_point(desc, back, 0)[d]) / 2;
            double q = (seam_point(desc, k, 1)[d] - seam_point(desc, back, 1)[d]) / 2;
            product += p * q;
            square[0] += p * p;
            square[1] += q * q;
        }
    }
    for (size_t which = 0; which < 2; which++)
        if (square[which] <= LEAST * extent(desc, run, which))
            return 0;
    return product / sqrt(square[0] * square[1]);
}

/* ---- what is told ------------------------------------------------------------------------------- */

static void mark_told(struct search *search, const struct seam_run *run)
{
    for (size_t k = run->first; k < run->last; k++)
        search->told[find_side(search, seam_node(search, k), seam_node(search, k + 1)) - search->side] = true;
}

static void judge(struct search *search, const struct seam_run *run)
{
    const uint32_t *pair = search->desc->seam + 2 * run->first;
    bool one_piece = search->piece[pair[0]] == search->piece[pair[1]];
    if (run->same > run->opposite && (run->along > CLEARLY && !one_piece))
        dr_error_set(
            next_warning(search), DRAPE_OK, DRAPE_AT_SEAM, (int64_t)run->first, -1, NULL,
            "to seam %zu the sides start alike but their triangles run opposite ways round: one of the two "
            "pieces is wound inside out",
            run->last);
    else if (run->same > run->opposite)
        dr_error_set(next_warning(search), DRAPE_OK, DRAPE_AT_SEAM, (int64_t)run->first, -1, NULL,
                     "to seam %zu the sides are sewn in crossed directions: %s", run->last,
                     one_piece ? "the piece is closed with a twist"
                               : "the front of one piece meets the back of the other");
    else if (run->along < -CLEARLY && !(one_piece && run->opposite))
        dr_error_set(
            next_warning(search), DRAPE_OK, DRAPE_AT_SEAM, (int64_t)run->first, -1, NULL,
            "to seam %zu the sides start the other way round than they are sewn: crossed directions?",
            run->last);
    else
        return;
    mark_told(search, run);
}

/* What no run has told of: edges whose two triangles run opposite ways round, sewn or not. */
static void judge_rest(struct search *search)
{
    const struct side *sewn = NULL, *whole = NULL;
    size_t wrong = 0;
    for (size_t i = 0; i + 1 < 3 * search->desc->triangles; i++) {
        const struct side *side = search->side + i;
        if (search->told[i] || compare_nodes(side, side + 1) != 0 || side->forward != side[1].forward)
            continue;
        if (is_sewn(side, side + 1))
            sewn = sewn ? sewn : side;
        else if (wrong++ == 0)
            whole = side;
    }
    for (size_t s = 0; sewn && s < search->desc->seams; s++)
        if (seam_node(search, s) == sewn->low) {
            dr_error_set(next_warning(search), DRAPE_OK, DRAPE_AT_SEAM, (int64_t)s, -1, NULL,
                         "the triangles that it joins run opposite ways round: crossed directions, or a "
                         "piece inside out");
            sewn = NULL;
        }
    if (whole)
        dr_error_set(next_warning(search), DRAPE_OK, DRAPE_AT_TRIANGLE, whole[1].triangle, -1, NULL,
                     "it runs round the other way than its neighbour, triangle %u: its outer side is the "
                     "other's inner "
                     "side (%zu such edges)",
                     whole->triangle, wrong);
}

drape_status dr_seam_warnings(const drape_scene_desc *desc, const uint32_t *vertex_node, drape_error *ret,
                              size_t *ret_count, drape_error *reterr)
{
    struct search search = {.desc = desc,
                            .node = vertex_node,
                            .side = malloc(3 * desc->triangles * sizeof *search.side),
                            .told = calloc(3 * desc->triangles, sizeof *search.told),
                            .piece = malloc(desc->vertices * sizeof *search.piece),
                            .ret = ret};
    drape_status status = search.side && search.told && search.piece ? DRAPE_OK : dr_out_of_memory(reterr);
    if (status >= 0) {
        sort_sides(&search);
        find_pieces(&search);
        for (size_t k = 0; k < desc->seams;) {
            struct seam_run run = follow(&search, k);
            run.along = run.last > run.first + 1 ? measure_along(desc, &run) : 0; /* one edge tells little */
            judge(&search, &run);
            k = run.last > k ? run.last : k + 1; /* at a corner the next run begins with the last pair */
        }
        judge_rest(&search);
        *ret_count = search.count;
    }
    free(search.side);
    free(search.told);
    free(search.piece);
    return status;
}
