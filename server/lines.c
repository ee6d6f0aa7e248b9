/* lines.c - see lines.h. */
#include "lines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "groups.h"

/* Of the vertices sewn together with one, so many are looked at; where cloth meets there are a few. */
#define MOST_SEWN 64

/* By this part of its height a triangle is taken as larger, so that a way along an edge is within; where
 * round-off is larger still, straight on comes to the same. */
#define SLACK 1e-12

struct lines *lines_new(size_t count)
{
    struct lines *lines = calloc(1, sizeof *lines);
    if (lines == NULL)
        return NULL;
    lines->line = calloc(count > 0 ? count : 1, sizeof *lines->line);
    if (lines->line == NULL) {
        free(lines);
        return NULL;
    }
    lines->count = count;
    return lines;
}

struct lines *lines_free(struct lines *lines)
{
    if (lines == NULL)
        return NULL;
    for (size_t i = 0; i < lines->count; i++) {
        free(lines->line[i].name);
        free(lines->line[i].vertex);
        free(lines->line[i].ends);
    }
    free(lines->line);
    free(lines->piece);
    free(lines);
    return NULL;
}

/* ---- joining vertices to segments --------------------------------------------------------------------- */

struct joiner {
    const drape_scene_desc *scene;
    uint32_t *piece; /* groups of vertices that triangles connect */
    uint32_t *sewn;  /* groups of vertices that seams connect */
    uint32_t *next;  /* the next of the same sewn group, round and round */
};

static int joiner_make(struct joiner *j)
{
    const drape_scene_desc *scene = j->scene;
    j->piece = groups_new(scene->vertices);
    j->sewn = groups_new(scene->vertices);
    j->next = groups_new(scene->vertices);
    if (j->piece == NULL || j->sewn == NULL || j->next == NULL)
        return -1;
    for (size_t t = 0; t < scene->triangles; t++) {
        groups_unite(j->piece, scene->triangle[3 * t], scene->triangle[3 * t + 1]);
        groups_unite(j->piece, scene->triangle[3 * t], scene->triangle[3 * t + 2]);
    }
    for (size_t s = 0; s < scene->seams; s++) {
        uint32_t a = scene->seam[2 * s], b = scene->seam[2 * s + 1];
        if (groups_root(j->sewn, a) == groups_root(j->sewn, b))
            continue;
        groups_unite(j->sewn, a, b);
        uint32_t after = j->next[a]; /* two rings become one */
        j->next[a] = j->next[b];
        j->next[b] = after;
    }
    for (size_t i = 0; i < scene->vertices; i++)
        j->piece[i] = groups_root(j->piece, (uint32_t)i);
    return 0;
}

static double pattern_distance(const drape_scene_desc *scene, uint32_t a, uint32_t b)
{
    const double *p = scene->pattern + 2 * (size_t)a, *q = scene->pattern + 2 * (size_t)b;
    return hypot(p[0] - q[0], p[1] - q[1]);
}

/* Of the vertices sewn to `a`, the one in the piece of `b` that is nearest to it there; `a`: none. */
static uint32_t stand_in(const struct joiner *j, uint32_t a, uint32_t b)
{
    uint32_t best = a, other = j->next[a];
    for (int n = 0; n < MOST_SEWN && other != a; n++, other = j->next[other])
        if (j->piece[other] == j->piece[b] &&
            (best == a || pattern_distance(j->scene, other, b) < pattern_distance(j->scene, best, b)))
            best = other;
    return best;
}

static int join(struct joiner *j, uint32_t a, uint32_t b, uint32_t ret[2])
{
    ret[0] = a;
    ret[1] = b;
    if (groups_root(j->sewn, a) == groups_root(j->sewn, b))
        ret[1] = a;
    else if (j->piece[a] != j->piece[b])
        ret[0] = stand_in(j, a, b);
    if (j->piece[ret[0]] != j->piece[ret[1]]) {
        ret[0] = a;
        ret[1] = stand_in(j, b, a);
    }
    return j->piece[ret[0]] == j->piece[ret[1]] ? 0 : LINES_APART;
}

static int join_line(struct joiner *j, struct line *line, size_t *ret_at)
{
    line->segments = line->vertices - !line->closed;
    line->ends = calloc(line->segments + 1, 2 * sizeof *line->ends);
    if (line->ends == NULL)
        return -1;
    for (size_t s = 0; s < line->segments; s++) {
        *ret_at = s;
        if (join(j, line->vertex[s], line->vertex[(s + 1) % line->vertices], line->ends + 2 * s) != 0)
            return LINES_APART;
    }
    return 0;
}

int lines_join(struct lines *lines, const drape_scene_desc *scene, size_t *ret_line, size_t *ret_at)
{
    struct joiner j = {.scene = scene};
    int rc = joiner_make(&j);
    for (size_t i = 0; i < lines->count && rc == 0; i++) {
        *ret_line = i;
        rc = join_line(&j, &lines->line[i], ret_at);
    }
    lines->piece = j.piece;
    free(j.sewn);
    free(j.next);
    return rc;
}

/* ---- measuring ---------------------------------------------------------------------------------------- */

/* Of a way from 0 to 1, what lies over one triangle: the barycentric weights at 0 and by how much they
 * change to 1. */
struct span {
    double from, to;
    double weight[3], change[3];
    uint32_t triangle;
};

struct box { /* of a triangle in the pattern */
    double low[2], high[2];
    uint32_t piece;
};

struct tape {
    const drape_scene_desc *scene;
    const double *positions;
    struct box *box;   /* triangles */
    struct span *span; /* triangles */
};

static void box_triangles(struct tape *tape, const uint32_t *piece)
{
    const drape_scene_desc *scene = tape->scene;
    for (size_t t = 0; t < scene->triangles; t++) {
        const uint32_t *corner = scene->triangle + 3 * t;
        struct box *box = &tape->box[t];
        *box = (struct box){{INFINITY, INFINITY}, {-INFINITY, -INFINITY}, piece[corner[0]]};
        for (size_t k = 0; k < 3; k++)
            for (size_t d = 0; d < 2; d++) {
                double u = scene->pattern[2 * (size_t)corner[k] + d];
                box->low[d] = fmin(box->low[d], u);
                box->high[d] = fmax(box->high[d], u);
            }
    }
}

static double cross(const double o[2], const double a[2], const double b[2])
{
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
}

/* The part of the straight way a-b that is over the triangle; false: none. */
static bool clip(const drape_scene_desc *scene, uint32_t triangle, const double a[2], const double b[2],
                 struct span *ret)
{
    const double *p[3];
    for (size_t k = 0; k < 3; k++)
        p[k] = scene->pattern + 2 * (size_t)scene->triangle[3 * (size_t)triangle + k];
    double area = cross(p[0], p[1], p[2]);
    *ret = (struct span){.from = 0, .to = 1, .triangle = triangle};
    for (size_t k = 0; k < 3; k++) {
        const double *q = p[(k + 1) % 3], *r = p[(k + 2) % 3];
        double weight = cross(q, r, a) / area, change = cross(q, r, b) / area - weight;
        ret->weight[k] = weight;
        ret->change[k] = change;
        if (change == 0 && weight < -SLACK)
            return false;
        if (change > 0)
            ret->from = fmax(ret->from, (-SLACK - weight) / change);
        else if (change < 0)
            ret->to = fmin(ret->to, (-SLACK - weight) / change);
    }
    return ret->from < ret->to;
}

static int compare_spans(const void *left, const void *right)
{
    const struct span *a = left, *b = right;
    if (a->from != b->from)
        return a->from < b->from ? -1 : 1;
    return a->triangle < b->triangle ? -1 : a->triangle > b->triangle;
}

static size_t find_spans(struct tape *tape, uint32_t piece, const double a[2], const double b[2])
{
    const double low[2] = {fmin(a[0], b[0]), fmin(a[1], b[1])},
                 high[2] = {fmax(a[0], b[0]), fmax(a[1], b[1])};
    size_t spans = 0;
    for (size_t t = 0; t < tape->scene->triangles; t++) {
        const struct box *box = &tape->box[t];
        if (box->piece == piece && box->low[0] <= high[0] && box->high[0] >= low[0] &&
            box->low[1] <= high[1] && box->high[1] >= low[1] &&
            clip(tape->scene, (uint32_t)t, a, b, &tape->span[spans]))
            spans++;
    }
    qsort(tape->span, spans, sizeof *tape->span, compare_spans);
    return spans;
}

/* Where the way is in the drape, `at` within the span. */
static void locate(const struct tape *tape, const struct span *span, double at, double ret[3])
{
    for (size_t d = 0; d < 3; d++) {
        ret[d] = 0;
        for (size_t k = 0; k < 3; k++)
            ret[d] += (span->weight[k] + at * span->change[k]) *
                      tape->positions[3 * (size_t)tape->scene->triangle[3 * (size_t)span->triangle + k] + d];
    }
}

/* From the tape's end to `to`, which becomes its end. */
static double pull_to(double end[3], const double to[3])
{
    double d[3] = {to[0] - end[0], to[1] - end[1], to[2] - end[2]};
    memcpy(end, to, sizeof d);
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

static double measure_segment(struct tape *tape, const uint32_t *piece, uint32_t from, uint32_t to)
{
    const double *pattern = tape->scene->pattern;
    size_t spans =
        from == to ? 0 : find_spans(tape, piece[from], pattern + 2 * (size_t)from, pattern + 2 * (size_t)to);
    double end[3], length = 0, done = 0;
    memcpy(end, tape->positions + 3 * (size_t)from, sizeof end);
    for (size_t s = 0; s < spans; s++) {
        const struct span *span = &tape->span[s];
        double place[3];
        if (span->to <= done)
            continue; /* two triangles have this part of the way: it runs along their edge */
        locate(tape, span, fmax(span->from, done), place);
        length += pull_to(end, place); /* nothing, but where the way had left the piece */
        locate(tape, span, span->to, place);
        length += pull_to(end, place);
        done = span->to;
    }
    return length + pull_to(end, tape->positions + 3 * (size_t)to);
}

int lines_measure(const struct lines *lines, const drape_scene_desc *scene, const double *positions,
                  struct line_length *ret)
{
    struct tape tape = {scene, positions, malloc(scene->triangles * sizeof *tape.box),
                        malloc(scene->triangles * sizeof *tape.span)};
    int rc = tape.box != NULL && tape.span != NULL ? 0 : -1;
    if (rc == 0)
        box_triangles(&tape, lines->piece);
    for (size_t i = 0; i < lines->count && rc == 0; i++) {
        const struct line *line = &lines->line[i];
        ret[i] = (struct line_length){0, 0};
        for (size_t s = 0; s < line->segments; s++) {
            uint32_t from = line->ends[2 * s], to = line->ends[2 * s + 1];
            ret[i].rest += pattern_distance(scene, from, to);
            ret[i].draped += measure_segment(&tape, lines->piece, from, to);
        }
    }
    free(tape.box);
    free(tape.span);
    return rc;
}
