/* coarsen.c - see coarsen.h. */
#include "coarsen.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "mesh.h"

#define SHAPE   0.35   /* of new triangles, see shape_of: 0.35 has a height of a fifth of its base */
#define LONGEST 1.6    /* new edges over the length asked for */
#define OUTLINE 0.0625 /* of that length: that the outline may move by */
#define LENGTHS                                                                                              \
    1024 /* classes of new lengths: sorted by counting, and rounding does not tell alike ones apart */
#define SHARP  0.87 /* cosine of 30 degrees: an outline that turns by more has a corner there */
#define SWEEPS 3    /* over all edges, to flip them, after each pass of collapses */
#define GAIN   1e-3 /* of the worse shape: what makes a flip worth it */

enum kind { INNER = 0, LINE, KEPT }; /* KEPT: stays; LINE: goes along its line only */

struct collapse {
    uint32_t class;      /* of its length */
    uint32_t from, into; /* vertices */
};

/* Corners are numbered 3*triangle + 0..2. */
struct coarsening {
    const drape_scene_desc *desc;
    double edge;        /* m, asked for */
    size_t left;        /* triangles */
    uint32_t *triangle; /* 3*triangles; DR_NONE: gone */
    uint32_t *first;    /* vertices: a corner at it; DR_NONE: none */
    uint32_t *next;     /* corners: the next one at the same vertex */
    uint32_t *node;     /* vertices: the least vertex that it is sewn to */
    uint32_t *sewn;     /* vertices: the next one of the same node, in a ring */
    uint8_t *kind;      /* vertices */
    uint32_t *along;    /* 2*vertices: a LINE's neighbours on its line that are left */
    uint32_t *traced;   /* 2*vertices: on the fine mesh */
    bool *gone;         /* vertices */
    uint32_t *guest;    /* triangles: a vertex that is gone and lies in it; DR_NONE: none */
    uint32_t *company;  /* vertices: the next guest of the same triangle */
    uint32_t *host;     /* vertices: the triangle whose guest it is */
    uint32_t *mark;     /* vertices: the last round that met it */
    uint32_t round;
    bool *touched;             /* vertices: this pass has changed what is around */
    struct collapse *found;    /* 6*triangles */
    struct collapse *collapse; /* likewise, in order */
};

/* ---- in the pattern ----------------------------------------------------------------------------- */

static const double *pattern_of(const struct coarsening *c, uint32_t v)
{
    return c->desc->pattern + 2 * (size_t)v;
}

/* Of the edge's length; coordinates are bounded, and no square overflows. */
static double square_of(const struct coarsening *c, uint32_t a, uint32_t b)
{
    const double *p = pattern_of(c, a), *q = pattern_of(c, b), u = p[0] - q[0], v = p[1] - q[1];
    return u * u + v * v;
}

static double length_of(const struct coarsening *c, uint32_t a, uint32_t b)
{
    return sqrt(square_of(c, a, b));
}

/* Twice the area, signed. */
static double area_of(const double *a, const double *b, const double *c)
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
}

/* 2 sqrt(3) times twice the area over the sum of squared sides: 1 where they are equal, < 0 turned over. */
static double shape_of(const struct coarsening *c, uint32_t i, uint32_t j, uint32_t k)
{
    return 2 * sqrt(3) * area_of(pattern_of(c, i), pattern_of(c, j), pattern_of(c, k)) /
           (square_of(c, i, j) + square_of(c, j, k) + square_of(c, k, i));
}

/* Of p in a triangle. */
static void weights_of(const double *a, const double *b, const double *c, const double *p, double ret[3])
{
    double whole = area_of(a, b, c);
    ret[1] = area_of(a, p, c) / whole;
    ret[2] = area_of(a, b, p) / whole;
    ret[0] = 1 - ret[1] - ret[2];
}

/* From p to the segment from a to b. */
static double distance_to(const double *a, const double *b, const double *p)
{
    double side[2] = {b[0] - a[0], b[1] - a[1]}, way[2] = {p[0] - a[0], p[1] - a[1]};
    double square = side[0] * side[0] + side[1] * side[1];
    double t = square > 0 ? (way[0] * side[0] + way[1] * side[1]) / square : 0;
    t = fmin(fmax(t, 0), 1);
    return hypot(way[0] - t * side[0], way[1] - t * side[1]);
}

/* ---- around a vertex ---------------------------------------------------------------------------- */

static uint32_t after(uint32_t corner)
{
    return corner % 3 == 2 ? corner - 2 : corner + 1;
}

static uint32_t before(uint32_t corner)
{
    return corner % 3 ? corner - 1 : corner + 2;
}

static void enter(struct coarsening *c, uint32_t corner, uint32_t v)
{
    c->triangle[corner] = v;
    c->next[corner] = c->first[v];
    c->first[v] = corner;
}

static void leave(struct coarsening *c, uint32_t corner)
{
    uint32_t *link = &c->first[c->triangle[corner]];
    while (*link != corner)
        link = &c->next[*link];
    *link = c->next[corner];
    c->triangle[corner] = DR_NONE;
}

/* The corner of v's triangle `corner` that is at w, too; DR_NONE: w is not of it. */
static uint32_t corner_at(const struct coarsening *c, uint32_t corner, uint32_t w)
{
    return c->triangle[after(corner)] == w    ? after(corner)
           : c->triangle[before(corner)] == w ? before(corner)
                                              : DR_NONE;
}

/* Triangles that v and w share. */
static size_t shared(const struct coarsening *c, uint32_t v, uint32_t w)
{
    size_t count = 0;
    for (uint32_t i = c->first[v]; i != DR_NONE; i = c->next[i])
        count += corner_at(c, i, w) != DR_NONE;
    return count;
}

/* Gives the nodes around that of v the number of a new round. */
static void mark_around(struct coarsening *c, uint32_t v)
{
    uint32_t u = v;
    c->round++;
    do {
        for (uint32_t i = c->first[u]; i != DR_NONE; i = c->next[i]) {
            c->mark[c->node[c->triangle[after(i)]]] = c->round;
            c->mark[c->node[c->triangle[before(i)]]] = c->round;
        }
        u = c->sewn[u];
    } while (u != v);
}

/* Nodes around that of v that the round before had met, each once: they bear the number of a round more. */
static size_t count_marked(struct coarsening *c, uint32_t v)
{
    uint32_t u = v, met = c->round++;
    size_t count = 0;
    do {
        for (uint32_t i = c->first[u]; i != DR_NONE; i = c->next[i])
            for (int k = 0; k < 2; k++) {
                uint32_t *mark = &c->mark[c->node[c->triangle[k ? after(i) : before(i)]]];
                count += *mark == met;
                if (*mark == met)
                    *mark = c->round;
            }
        u = c->sewn[u];
    } while (u != v);
    return count;
}

/* Whether some edge joins the nodes of v and w. */
static bool joined(struct coarsening *c, uint32_t v, uint32_t w)
{
    mark_around(c, v);
    return c->mark[c->node[w]] == c->round;
}

/* ---- what may go where -------------------------------------------------------------------------- */

/* Notes an edge of a line at both of its ends; the third makes a vertex KEPT. */
static void add_to_line(struct coarsening *c, uint32_t a, uint32_t b)
{
    for (int k = 0; k < 2; k++) {
        uint32_t v = k ? b : a, w = k ? a : b, *line = c->traced + 2 * (size_t)v;
        if (line[0] == DR_NONE)
            line[0] = w;
        else if (line[1] == DR_NONE)
            line[1] = w;
        else
            c->kind[v] = KEPT;
        if (c->kind[v] == INNER)
            c->kind[v] = LINE;
    }
}

/* Lines: edges with cloth of this material on one side only. */
static void find_lines(struct coarsening *c)
{
    const uint32_t *material = c->desc->triangle_material;
    for (uint32_t i = 0; i < 3 * c->desc->triangles; i++) {
        uint32_t a = c->triangle[i], b = c->triangle[after(i)], other = DR_NONE;
        for (uint32_t j = c->first[a]; j != DR_NONE; j = c->next[j])
            if (j / 3 != i / 3 && corner_at(c, j, b) != DR_NONE)
                other = j / 3;
        bool border = other != DR_NONE && other > i / 3 && material && material[i / 3] != material[other];
        if (other == DR_NONE || border)
            add_to_line(c, a, b);
    }
    memcpy(c->along, c->traced, 2 * c->desc->vertices * sizeof *c->along);
}

static bool is_sharp(const struct coarsening *c, uint32_t v)
{
    const uint32_t *line = c->traced + 2 * (size_t)v;
    const double *a = pattern_of(c, line[0]), *p = pattern_of(c, v), *b = pattern_of(c, line[1]);
    double in[2] = {p[0] - a[0], p[1] - a[1]}, out[2] = {b[0] - p[0], b[1] - p[1]};
    return in[0] * out[0] + in[1] * out[1] < SHARP * hypot(in[0], in[1]) * hypot(out[0], out[1]);
}

static void find_kinds(struct coarsening *c)
{
    const drape_scene_desc *desc = c->desc;
    find_lines(c);
    for (uint32_t v = 0; v < desc->vertices; v++) {
        bool end = c->kind[v] == LINE && (c->traced[2 * (size_t)v + 1] == DR_NONE || is_sharp(c, v));
        if (end || (c->kind[v] == INNER && c->sewn[v] != v))
            c->kind[v] = KEPT;
    }
    for (size_t i = 0; i < desc->pins; i++)
        c->kind[desc->pin[i]] = KEPT;
    for (size_t e = 0; e < desc->elastics; e++)
        for (size_t i = 0; i < 2 * desc->elastic[e].edges; i++)
            c->kind[desc->elastic[e].edge[i]] = KEPT;
    for (size_t e = 0; e < desc->folds; e++)
        for (size_t i = 0; i < 2 * desc->fold[e].edges; i++)
            c->kind[desc->fold[e].edge[i]] = KEPT;
    for (size_t i = 0; i < desc->tacks; i++)
        c->kind[desc->tack[i].vertex] = KEPT;
}

/* Whether the line between `into` and the vertex of the line on v's other side would still be near what it
 * was, were v gone: walks the fine mesh's line from v both ways. */
static bool keeps_line(const struct coarsening *c, uint32_t v, uint32_t into)
{
    const uint32_t *line = c->along + 2 * (size_t)v;
    uint32_t other = line[0] == into ? line[1] : line[0];
    const double *a = pattern_of(c, into), *b = pattern_of(c, other);
    if (other == into)
        return false;
    for (int k = 0; k < 2; k++)
        for (uint32_t from = v, u = c->traced[2 * (size_t)v + (size_t)k], next; c->gone[u];
             from = u, u = next) {
            const uint32_t *way = c->traced + 2 * (size_t)u;
            next = way[0] == from ? way[1] : way[0];
            if (distance_to(a, b, pattern_of(c, u)) > OUTLINE * c->edge)
                return false;
        }
    return distance_to(a, b, pattern_of(c, v)) <= OUTLINE * c->edge;
}

/* Whether the triangles that v takes along into w would do. */
static bool keeps_shapes(const struct coarsening *c, uint32_t v, uint32_t w)
{
    double worst = 1;
    size_t kept = 0;
    for (uint32_t i = c->first[v]; i != DR_NONE; i = c->next[i])
        worst = fmin(worst, fabs(shape_of(c, v, c->triangle[after(i)], c->triangle[before(i)])));
    for (uint32_t i = c->first[v]; i != DR_NONE; i = c->next[i]) {
        uint32_t a = c->triangle[after(i)], b = c->triangle[before(i)];
        if (a == w || b == w)
            continue;
        double old = shape_of(c, v, a, b), new = shape_of(c, w, a, b);
        if (old < 0)
            new = -new;
        if (!(new >= fmin(SHAPE, worst)) || fmax(length_of(c, w, a), length_of(c, w, b)) > LONGEST * c->edge)
            return false;
        kept++;
    }
    return kept > 0;
}

/* The vertex of the node of `into` that v, of the node that goes there, would go into; DR_NONE: there is
 * none, or more than one. */
static uint32_t partner(const struct coarsening *c, uint32_t v, uint32_t into)
{
    const uint32_t *line = c->along + 2 * (size_t)v;
    if (c->kind[v] == INNER)
        return into;
    bool is[2] = {c->node[line[0]] == c->node[into], c->node[line[1]] == c->node[into]};
    return is[0] == is[1] ? DR_NONE : line[is[1]];
}

/* No triangle has two corners of one node that goes. */
static bool lies_apart(const struct coarsening *c, uint32_t v)
{
    uint32_t u = v;
    do {
        for (uint32_t i = c->first[u]; i != DR_NONE; i = c->next[i])
            if (c->node[c->triangle[after(i)]] == c->node[v] || c->node[c->triangle[before(i)]] == c->node[v])
                return false;
        u = c->sewn[u];
    } while (u != v);
    return true;
}

/* Whether v and all that are sewn to it can go into `into` and those sewn to that. */
static bool can_collapse(struct coarsening *c, uint32_t v, uint32_t into)
{
    size_t between = 0;
    uint32_t u = v;
    if (c->node[v] == c->node[into] || !lies_apart(c, v))
        return false;
    do {
        uint32_t w = c->kind[u] == KEPT ? DR_NONE : partner(c, u, into);
        if (w == DR_NONE || (c->kind[u] == LINE && !keeps_line(c, u, w)) || !keeps_shapes(c, u, w))
            return false;
        size_t triangles = shared(c, u, w);
        if (!triangles || (c->kind[u] == INNER && triangles != 2))
            return false;
        between += triangles;
        u = c->sewn[u];
    } while (u != v);
    mark_around(c, v);
    return count_marked(c, into) == between; /* the link condition */
}

/* ---- what is gone, and where it lies now ---------------------------------------------------------- */

/* Takes all guests of a triangle, to be put in front of `list`; returns the first. */
static uint32_t take_guests(struct coarsening *c, uint32_t t, uint32_t list)
{
    while (c->guest[t] != DR_NONE) {
        uint32_t v = c->guest[t];
        c->guest[t] = c->company[v];
        c->company[v] = list;
        list = v;
    }
    return list;
}

/* Makes each of the list a guest of that triangle around w in which it lies, or which it lies least outside
 * of. */
static void place_guests(struct coarsening *c, uint32_t list, uint32_t w)
{
    for (uint32_t v = list, more; v != DR_NONE; v = more) {
        double most = -INFINITY, weight[3];
        more = c->company[v];
        for (uint32_t i = c->first[w]; i != DR_NONE; i = c->next[i]) {
            const uint32_t *corner = c->triangle + i / 3 * 3;
            weights_of(pattern_of(c, corner[0]), pattern_of(c, corner[1]), pattern_of(c, corner[2]),
                       pattern_of(c, v), weight);
            double least = fmin(weight[0], fmin(weight[1], weight[2]));
            if (least > most) {
                most = least;
                c->host[v] = i / 3;
            }
        }
        c->company[v] = c->guest[c->host[v]];
        c->guest[c->host[v]] = v;
    }
}

/* ---- passes --------------------------------------------------------------------------------------- */

static void replace_in_line(struct coarsening *c, uint32_t v, uint32_t old, uint32_t new)
{
    for (size_t k = 0; k < 2; k++)
        if (c->along[2 * (size_t)v + k] == old)
            c->along[2 * (size_t)v + k] = new;
}

static void collapse_vertex(struct coarsening *c, uint32_t v, uint32_t w)
{
    uint32_t list = v;
    c->company[v] = DR_NONE;
    for (uint32_t i; (i = c->first[v]) != DR_NONE;) {
        list = take_guests(c, i / 3, list);
        bool vanishes = corner_at(c, i, w) != DR_NONE;
        leave(c, i);
        if (vanishes) {
            leave(c, after(i));
            leave(c, before(i));
            c->left--;
        } else {
            enter(c, i, w);
        }
    }
    c->gone[v] = true;
    if (c->kind[v] == LINE) {
        const uint32_t *line = c->along + 2 * (size_t)v;
        uint32_t other = line[0] == w ? line[1] : line[0];
        replace_in_line(c, w, v, other);
        replace_in_line(c, other, v, w);
    }
    place_guests(c, list, w);
    for (uint32_t i = c->first[w]; i != DR_NONE; i = c->next[i])
        c->touched[c->triangle[after(i)]] = c->touched[c->triangle[before(i)]] = c->touched[w] = true;
}

static bool is_touched(const struct coarsening *c, uint32_t v)
{
    uint32_t u = v;
    bool any = false;
    do {
        any = any || c->touched[u];
        u = c->sewn[u];
    } while (u != v);
    return any;
}

/* v and all that are sewn to it. */
static void collapse(struct coarsening *c, uint32_t v, uint32_t into)
{
    uint32_t u = v;
    do {
        collapse_vertex(c, u, partner(c, u, into));
        u = c->sewn[u];
    } while (u != v);
}

/* The class of its length, of LENGTHS alike: closer than that they are alike. */
static size_t class_of(const struct coarsening *c, double length)
{
    return (size_t)(LENGTHS * length / c->edge);
}

/* What might go, into where, the shortest way first; those alike by vertex. */
static size_t list_collapses(struct coarsening *c)
{
    size_t end[LENGTHS + 1] = {0}, count = 0;
    for (uint32_t v = 0; v < c->desc->vertices; v++) {
        if (c->kind[v] == KEPT || c->node[v] != v)
            continue;
        for (uint32_t i = c->first[v]; i != DR_NONE; i = c->next[i])
            for (int k = c->kind[v] == INNER; k < 2; k++) { /* whose every neighbour comes after it once */
                uint32_t w = c->triangle[k ? after(i) : before(i)];
                double length = length_of(c, v, w);
                bool open =
                    c->kind[v] == INNER || c->along[2 * (size_t)v] == w || c->along[2 * (size_t)v + 1] == w;
                if (open && length < c->edge) {
                    c->found[count++] = (struct collapse){(uint32_t)class_of(c, length), v, w};
                    end[class_of(c, length)]++;
                }
            }
    }
    for (size_t i = 1; i <= LENGTHS; i++)
        end[i] += end[i - 1];
    for (size_t i = count; i-- > 0;)
        c->collapse[--end[c->found[i].class]] = c->found[i];
    return count;
}

/* One pass of collapses, no two side by side. Returns how many vertices went, those sewn together as one. */
static size_t collapse_some(struct coarsening *c, size_t enough)
{
    size_t count = list_collapses(c), done = 0;
    memset(c->touched, 0, c->desc->vertices * sizeof *c->touched);
    for (size_t i = 0; i < count && c->left > enough; i++) {
        uint32_t v = c->collapse[i].from, into = c->collapse[i].into;
        if (is_touched(c, v) || !can_collapse(c, v, into))
            continue;
        collapse(c, v, into);
        done++;
    }
    return done;
}

/* Flips the edge from corner i to the next if that makes the worse of its two triangles better. Only where
 * the pass has changed something: the rest is as it was. */
static bool flip(struct coarsening *c, uint32_t i)
{
    const uint32_t *material = c->desc->triangle_material;
    uint32_t a = c->triangle[i], b = c->triangle[after(i)], p = c->triangle[before(i)], at = DR_NONE;
    if (!c->touched[a] && !c->touched[b] && !c->touched[p])
        return false;
    for (uint32_t j = c->first[a]; j != DR_NONE; j = c->next[j])
        if (j / 3 != i / 3 && c->triangle[before(j)] == b)
            at = j;
    if (at == DR_NONE || (c->kind[a] == KEPT && c->kind[b] == KEPT) ||
        (material && material[i / 3] != material[at / 3]))
        return false;
    uint32_t q = c->triangle[after(at)];
    double old = shape_of(c, a, b, p), across = shape_of(c, b, a, q), sign = old < 0 ? -1 : 1;
    double new = sign *fmin(sign * shape_of(c, a, q, p), sign * shape_of(c, b, p, q));
    if (!(sign * new > fmin(sign * old, sign * across) + GAIN) || !(sign * across > 0) ||
        length_of(c, p, q) > LONGEST * c->edge || c->node[p] == c->node[q] || joined(c, p, q))
        return false;
    uint32_t list = take_guests(c, at / 3, take_guests(c, i / 3, DR_NONE));
    leave(c, after(i));
    enter(c, after(i), q);
    leave(c, at);
    enter(c, at, p);
    place_guests(c, list, p);
    c->touched[a] = c->touched[b] = c->touched[p] = c->touched[q] = true;
    return true;
}

static void flip_all(struct coarsening *c)
{
    size_t flips = 1;
    for (int sweep = 0; sweep < SWEEPS && flips; sweep++) {
        flips = 0;
        for (uint32_t i = 0; i < 3 * c->desc->triangles; i++)
            flips += c->triangle[i] != DR_NONE && flip(c, i);
    }
}

static void coarsen(struct coarsening *c)
{
    double area = 0;
    for (size_t t = 0; t < c->desc->triangles; t++) {
        const uint32_t *corner = c->triangle + 3 * t;
        area +=
            fabs(area_of(pattern_of(c, corner[0]), pattern_of(c, corner[1]), pattern_of(c, corner[2]))) / 2;
    }
    double enough = area / (sqrt(3) / 4 * c->edge * c->edge); /* equal triangles */
    size_t done = 1;
    while (done && (double)c->left > enough) {
        done = collapse_some(c, (size_t)enough);
        if (done)
            flip_all(c);
    }
}

/* ---- begun ---------------------------------------------------------------------------------------- */

static void free_coarsening(struct coarsening *c)
{
    void *array[] = {c->triangle, c->first, c->next,    c->node, c->sewn, c->kind,    c->along, c->traced,
                     c->gone,     c->guest, c->company, c->host, c->mark, c->touched, c->found, c->collapse};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        free(array[i]);
}

static bool allocate(struct coarsening *c)
{
    size_t v = c->desc->vertices, t = c->desc->triangles;
    c->triangle = calloc(3 * t, sizeof *c->triangle);
    c->first = malloc(v * sizeof *c->first);
    c->next = malloc(3 * t * sizeof *c->next);
    c->node = malloc(v * sizeof *c->node);
    c->sewn = malloc(v * sizeof *c->sewn);
    c->kind = calloc(v, sizeof *c->kind);
    c->along = malloc(2 * v * sizeof *c->along);
    c->traced = malloc(2 * v * sizeof *c->traced);
    c->gone = calloc(v, sizeof *c->gone);
    c->guest = malloc(t * sizeof *c->guest);
    c->company = malloc(v * sizeof *c->company);
    c->host = malloc(v * sizeof *c->host);
    c->mark = calloc(v, sizeof *c->mark);
    c->touched = malloc(v * sizeof *c->touched);
    c->found = malloc(6 * t * sizeof *c->found);
    c->collapse = malloc(6 * t * sizeof *c->collapse);
    return c->triangle && c->first && c->next && c->node && c->sewn && c->kind && c->along && c->traced &&
           c->gone && c->guest && c->company && c->host && c->mark && c->touched && c->found && c->collapse;
}

/* Joins the rings of two vertices that are sewn together, unless they are one. */
static void sew(struct coarsening *c, uint32_t a, uint32_t b)
{
    uint32_t u = a, least = c->node[a] < c->node[b] ? c->node[a] : c->node[b];
    if (c->node[a] == c->node[b])
        return;
    uint32_t next = c->sewn[a];
    c->sewn[a] = c->sewn[b];
    c->sewn[b] = next;
    do {
        c->node[u] = least;
        u = c->sewn[u];
    } while (u != a);
}

/* A seam ends at a vertex where what is next to it on its line is not sewn to what is next to the other side.
 */
static void keep_ends_of_seams(struct coarsening *c)
{
    for (uint32_t v = 0; v < c->desc->vertices; v++) {
        uint32_t u = c->sewn[v];
        if (u == v || c->kind[v] != LINE || c->kind[u] != LINE)
            continue;
        const uint32_t *here = c->along + 2 * (size_t)v, *there = c->along + 2 * (size_t)u;
        uint32_t a = c->node[here[0]], b = c->node[here[1]], p = c->node[there[0]], q = c->node[there[1]];
        if (!((a == p && b == q) || (a == q && b == p)))
            c->kind[v] = KEPT;
    }
}

static void begin(struct coarsening *c)
{
    const drape_scene_desc *desc = c->desc;
    c->left = desc->triangles;
    memset(c->first, 0xff, desc->vertices * sizeof *c->first); /* DR_NONE, as the next ones */
    memset(c->traced, 0xff, 2 * desc->vertices * sizeof *c->traced);
    memset(c->guest, 0xff, desc->triangles * sizeof *c->guest);
    memset(c->host, 0xff, desc->vertices * sizeof *c->host);
    for (uint32_t v = 0; v < desc->vertices; v++)
        c->node[v] = c->sewn[v] = v;
    for (uint32_t i = 0; i < 3 * desc->triangles; i++)
        enter(c, i, desc->triangle[i]);
    for (size_t s = 0; s < desc->seams; s++)
        sew(c, desc->seam[2 * s], desc->seam[2 * s + 1]);
    find_kinds(c);
    keep_ends_of_seams(c);
}

/* ---- the result ----------------------------------------------------------------------------------- */

/* Rows of `width` vertices all of which have a number, by it, to `ret`, which has room for all. Returns how
 * many those are. */
static size_t take_rows(const uint32_t *vertex, size_t rows, size_t width, const uint32_t *number,
                        uint32_t *ret)
{
    size_t count = 0;
    for (size_t i = 0; i < rows; i++) {
        bool all = true;
        for (size_t k = 0; k < width; k++) {
            uint32_t v = vertex[i * width + k];
            ret[count * width + k] = v == DR_NONE ? DR_NONE : number[v];
            all = all && ret[count * width + k] != DR_NONE;
        }
        count += all;
    }
    return count;
}

static size_t count_edges(const drape_scene_desc *desc)
{
    size_t edges = 0;
    for (size_t e = 0; e < desc->elastics; e++)
        edges += desc->elastic[e].edges;
    for (size_t e = 0; e < desc->folds; e++)
        edges += desc->fold[e].edges;
    return edges;
}

static bool make_arrays(const drape_scene_desc *from, const drape_scene_desc *to,
                        struct dr_coarse_arrays *own)
{
    own->positions = malloc((3 * to->vertices + 1) * sizeof *own->positions);
    own->pattern = malloc((2 * to->vertices + 1) * sizeof *own->pattern);
    own->triangle_material = malloc(from->triangles * sizeof *own->triangle_material);
    own->pin = malloc((from->pins + 1) * sizeof *own->pin);
    own->edge = malloc((2 * count_edges(from) + 1) * sizeof *own->edge);
    own->elastic = malloc((from->elastics + 1) * sizeof *own->elastic);
    own->fold = malloc((from->folds + 1) * sizeof *own->fold);
    own->tack = malloc((from->tacks + 1) * sizeof *own->tack);
    return own->positions && own->pattern && own->triangle_material && own->pin && own->edge &&
           own->elastic && own->fold && own->tack;
}

static void take_lines(const drape_scene_desc *from, const uint32_t *number, struct dr_coarse_arrays *own)
{
    uint32_t *edge = own->edge;
    for (size_t e = 0; e < from->elastics; e++) {
        own->elastic[e] = from->elastic[e];
        own->elastic[e].edge = edge;
        edge += 2 * take_rows(from->elastic[e].edge, from->elastic[e].edges, 2, number, edge);
    }
    for (size_t e = 0; e < from->folds; e++) {
        own->fold[e] = from->fold[e];
        own->fold[e].edge = edge;
        edge += 2 * take_rows(from->fold[e].edge, from->fold[e].edges, 2, number, edge);
    }
    for (size_t i = 0; i < from->tacks; i++) {
        own->tack[i] = from->tack[i];
        own->tack[i].vertex = number[from->tack[i].vertex];
    }
}

static void take_mesh(const struct coarsening *c, const uint32_t *number, struct dr_coarse_arrays *own)
{
    const drape_scene_desc *from = c->desc;
    size_t count = 0;
    for (size_t v = 0; v < from->vertices; v++)
        if (number[v] != DR_NONE) {
            memcpy(own->positions + 3 * (size_t)number[v], from->positions + 3 * v, 3 * sizeof(double));
            memcpy(own->pattern + 2 * (size_t)number[v], from->pattern + 2 * v, 2 * sizeof(double));
        }
    for (size_t t = 0; t < from->triangles; t++)
        if (c->triangle[3 * t] != DR_NONE)
            own->triangle_material[count++] = from->triangle_material ? from->triangle_material[t] : 0;
}

/* Where the fine vertices lie. */
static void map_up(const struct coarsening *c, const uint32_t *number, struct dr_coarse *coarse)
{
    for (uint32_t v = 0; v < coarse->fine; v++) {
        uint32_t *corner = coarse->corner + 3 * (size_t)v;
        double *weight = coarse->weight + 3 * (size_t)v;
        corner[0] = corner[1] = corner[2] = number[v];
        weight[0] = 1;
        if (!c->gone[v])
            continue;
        const uint32_t *of = c->triangle + 3 * (size_t)c->host[v];
        weights_of(pattern_of(c, of[0]), pattern_of(c, of[1]), pattern_of(c, of[2]), pattern_of(c, v),
                   weight);
        for (int k = 0; k < 3; k++)
            corner[k] = number[of[k]];
    }
}

/* `number`: vertices, scratch. */
static bool finish(const struct coarsening *c, uint32_t *number, struct dr_coarse *coarse)
{
    const drape_scene_desc *from = c->desc;
    drape_scene_desc *to = &coarse->desc;
    struct dr_coarse_arrays *own = &coarse->own;
    *to = *from;
    to->start_pattern = NULL;
    to->vertices = 0;
    for (uint32_t v = 0; v < from->vertices; v++)
        number[v] = c->first[v] == DR_NONE ? DR_NONE : (uint32_t)to->vertices++;
    coarse->fine = from->vertices;
    coarse->vertices = to->vertices;
    coarse->vertex = malloc((to->vertices + 1) * sizeof *coarse->vertex);
    coarse->triangle = malloc(3 * from->triangles * sizeof *coarse->triangle);
    coarse->seam = malloc((2 * from->seams + 1) * sizeof *coarse->seam);
    coarse->corner = malloc(3 * coarse->fine * sizeof *coarse->corner);
    coarse->weight = calloc(3 * coarse->fine, sizeof *coarse->weight);
    if (!make_arrays(from, to, own) || !coarse->vertex || !coarse->triangle || !coarse->seam ||
        !coarse->corner || !coarse->weight)
        return false;
    for (uint32_t v = 0; v < from->vertices; v++)
        if (number[v] != DR_NONE)
            coarse->vertex[number[v]] = v;
    to->triangles = coarse->triangles = take_rows(c->triangle, from->triangles, 3, number, coarse->triangle);
    to->seams = coarse->seams = take_rows(from->seam, from->seams, 2, number, coarse->seam);
    to->pins = take_rows(from->pin, from->pins, 1, number, own->pin);
    take_mesh(c, number, own);
    take_lines(from, number, own);
    map_up(c, number, coarse);
    to->positions = own->positions;
    to->pattern = own->pattern;
    to->triangle = coarse->triangle;
    to->triangle_material = own->triangle_material;
    to->seam = coarse->seam;
    to->pin = own->pin;
    to->elastic = own->elastic;
    to->fold = own->fold;
    to->tack = own->tack;
    return true;
}

drape_status dr_coarsen(const drape_scene_desc *desc, double edge, struct dr_coarse **ret,
                        drape_error *reterr)
{
    struct coarsening c = {.desc = desc, .edge = edge};
    uint32_t *number = calloc(desc->vertices, sizeof *number);
    struct dr_coarse *coarse = calloc(1, sizeof *coarse);
    bool made = allocate(&c) && number && coarse;
    if (made) {
        begin(&c);
        coarsen(&c);
        made = finish(&c, number, coarse);
    }
    free_coarsening(&c);
    free(number);
    if (!made) {
        dr_coarse_free(coarse);
        return dr_out_of_memory(reterr);
    }
    *ret = coarse;
    return DRAPE_OK;
}

void dr_coarse_strip(struct dr_coarse *coarse)
{
    struct dr_coarse_arrays *own = &coarse->own;
    void *array[] = {own->positions, own->pattern, own->triangle_material, own->pin, own->edge, own->elastic,
                     own->fold,      own->tack};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        free(array[i]);
    memset(own, 0, sizeof *own);
    memset(&coarse->desc, 0, sizeof coarse->desc);
}

struct dr_coarse *dr_coarse_free(struct dr_coarse *coarse)
{
    if (coarse) {
        dr_coarse_strip(coarse);
        free(coarse->vertex);
        free(coarse->triangle);
        free(coarse->seam);
        free(coarse->corner);
        free(coarse->weight);
        free(coarse);
    }
    return NULL;
}

size_t dr_coarse_bytes(const struct dr_coarse *coarse)
{
    return sizeof *coarse + 3 * coarse->fine * (sizeof *coarse->corner + sizeof *coarse->weight) +
           (coarse->vertices + 3 * coarse->triangles + 2 * coarse->seams) * sizeof *coarse->vertex;
}

void dr_coarse_carry(const struct dr_coarse *coarse, const double *x, double *fine)
{
    for (size_t v = 0; v < coarse->fine; v++) {
        const uint32_t *corner = coarse->corner + 3 * v;
        const double *weight = coarse->weight + 3 * v;
        for (size_t d = 0; corner[0] != DR_NONE && d < 3; d++) {
            double sum = 0;
            for (int k = 0; k < 3; k++)
                sum += weight[k] * x[3 * (size_t)corner[k] + d];
            fine[3 * v + d] = sum;
        }
    }
}
