/* crossings.c - where cloth runs through itself and through a body, decided exactly.
 *
 * usage: crossings CLOTH.obj [BODY.obj]
 * Shares no code with the solver. Every edge meets every triangle: cloth with cloth, cloth edges with body
 * triangles and body edges with cloth triangles. Coordinates are rounded to 2^-30 m; from there on all is
 * in whole numbers, orientations in 128 bits. An edge and a triangle are one of
 *   apart     no common point;
 *   crossing  the inside of the edge goes through the inside of the triangle, every orientation nonzero;
 *   touching  they meet in any other way: an end on the triangle, the edge through an edge or corner of it,
 *             both in one plane and overlapping.
 * Nothing crosses and nothing touches: the surfaces have no point in common. Two triangles that cross in
 * general position make two crossings: two edges of one, or one of each. Points of equal coordinates are one
 * point, as the two sides of a shut seam are; within the cloth an edge and a triangle that share a point are
 * not compared, so a sheet folded onto itself about an edge of its own is not found there. Triangles without
 * area are counted and compared by their edges alone, as their neighbours' edges are.
 * Prints one JSON object; the pairs name vertices as the files count them, from 1, the edge's two first. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define UNITS_PER_METRE 1073741824.0 /* 2^30 */
#define REACH           8.0          /* m: differences are below 2^34 + 1, orientations below 2^106 */
#define SHOWN           5            /* pairs printed of each kind */

enum { UP = 1 }; /* the axis along which pairs are looked for: garments and bodies stand upright */

__extension__ typedef __int128 wide;

struct edge {
    uint32_t v[2]; /* of the file */
    uint32_t p[2]; /* the points they are, in order */
};

struct triangle {
    uint32_t v[3], p[3];
};

struct surface {
    int64_t (*x)[3];    /* of each vertex, in units of 2^-30 m */
    struct triangle *t; /* those with area, sorted by their low end along the sweep */
    struct edge *e;     /* each once */
    uint32_t *point;    /* of each vertex: the least vertex at the same place */
    size_t vertices, triangles, edges, flat;
};

struct pair {
    const struct edge *edge;
    const struct triangle *triangle;
    const char *of; /* whose edge it is */
};

struct count {
    size_t crossings, touches;
    struct pair shown[2][SHOWN];
};

static void die(const char *what, const char *where)
{
    fprintf(stderr, "crossings: %s: %s\n", what, where);
    exit(2);
}

static void *grow(void *array, size_t count, size_t size)
{
    if (count & (count - 1)) /* doubles at powers of two */
        return array;
    void *grown = realloc(array, (count ? 2 * count : 1) * size);
    if (grown == NULL)
        die("out of memory", "");
    return grown;
}

/* ---- reading --------------------------------------------------------------------------------- */

static void add_vertex(struct surface *s, const double *x, const char *path)
{
    s->x = grow(s->x, s->vertices, sizeof *s->x);
    for (int k = 0; k < 3; k++) {
        if (!(fabs(x[k]) <= REACH))
            die("farther than 8 m from the origin, or not a number", path);
        s->x[s->vertices][k] = llround(x[k] * UNITS_PER_METRE);
    }
    s->vertices++;
}

/* The corners of "f a b c", each perhaps a/b/c, counted from 0. */
static struct triangle face_read(char *line, const char *path)
{
    struct triangle t = {0};
    char *rest = line;
    int count = 0;
    strtok_r(line, " \t\r\n", &rest);
    for (char *word; (word = strtok_r(NULL, " \t\r\n", &rest)) != NULL; count++)
        if (count < 3)
            t.v[count] = (uint32_t)strtoul(word, NULL, 10) - 1; /* 0 and words become too large */
    if (count != 3)
        die("face that is no triangle", path);
    return t;
}

static struct surface surface_read(const char *path)
{
    struct surface s = {0};
    char line[512];
    FILE *file = fopen(path, "r");
    if (file == NULL)
        die("cannot read", path);
    while (fgets(line, sizeof line, file)) {
        double x[3];
        if (strncmp(line, "f ", 2) == 0) {
            s.t = grow(s.t, s.triangles, sizeof *s.t);
            s.t[s.triangles++] = face_read(line, path);
        } else if (strncmp(line, "v ", 2) == 0) {
            if (sscanf(line, "v %lf %lf %lf", &x[0], &x[1], &x[2]) != 3)
                die("vertex of no three numbers", path);
            add_vertex(&s, x, path);
        }
    }
    fclose(file);
    if (s.triangles == 0)
        die("no triangle", path);
    for (size_t i = 0; i < s.triangles; i++)
        for (int k = 0; k < 3; k++)
            if (s.t[i].v[k] >= s.vertices)
                die("face of no vertex", path);
    return s;
}

static void surface_done(struct surface *s)
{
    free(s->x);
    free(s->t);
    free(s->e);
    free(s->point);
}

/* ---- points and edges ------------------------------------------------------------------------ */

static int by_place(const void *a, const void *b, void *data)
{
    int64_t(*x)[3] = data;
    uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    for (int k = 0; k < 3; k++)
        if (x[i][k] != x[j][k])
            return x[i][k] < x[j][k] ? -1 : 1;
    return (i > j) - (i < j);
}

static void find_points(struct surface *s)
{
    uint32_t *order = malloc(s->vertices * sizeof *order);
    s->point = malloc(s->vertices * sizeof *s->point);
    if (order == NULL || s->point == NULL)
        die("out of memory", "");
    for (size_t i = 0; i < s->vertices; i++)
        order[i] = (uint32_t)i;
    qsort_r(order, s->vertices, sizeof *order, by_place, s->x);
    for (size_t i = 0; i < s->vertices; i++) {
        bool same = i > 0 && memcmp(s->x[order[i]], s->x[order[i - 1]], sizeof *s->x) == 0;
        s->point[order[i]] = same ? s->point[order[i - 1]] : order[i];
    }
    free(order);
    for (size_t i = 0; i < s->triangles; i++)
        for (int k = 0; k < 3; k++)
            s->t[i].p[k] = s->point[s->t[i].v[k]];
}

static int by_points(const void *a, const void *b)
{
    const struct edge *e = a, *f = b;
    for (int k = 0; k < 2; k++)
        if (e->p[k] != f->p[k])
            return e->p[k] < f->p[k] ? -1 : 1;
    return 0;
}

/* The edges of all triangles, each once; none where both ends are one point. */
static void find_edges(struct surface *s)
{
    size_t count = 0;
    s->e = malloc(3 * s->triangles * sizeof *s->e);
    if (s->e == NULL)
        die("out of memory", "");
    for (size_t i = 0; i < s->triangles; i++)
        for (int k = 0; k < 3; k++) {
            const struct triangle *t = s->t + i;
            int next = (k + 1) % 3, a = t->p[k] < t->p[next] ? k : next, b = a == k ? next : k;
            if (t->p[a] != t->p[b])
                s->e[count++] = (struct edge){{t->v[a], t->v[b]}, {t->p[a], t->p[b]}};
        }
    qsort(s->e, count, sizeof *s->e, by_points);
    for (size_t i = 0; i < count; i++)
        if (i == 0 || by_points(s->e + i, s->e + s->edges - 1) != 0)
            s->e[s->edges++] = s->e[i];
}

/* ---- exact decisions ------------------------------------------------------------------------- */

static int sign(wide a)
{
    return (a > 0) - (a < 0);
}

/* The sign of the volume of a, b, c, d. */
static int side(const int64_t *a, const int64_t *b, const int64_t *c, const int64_t *d)
{
    wide u[3], v[3], w[3];
    for (int k = 0; k < 3; k++) {
        u[k] = b[k] - a[k];
        v[k] = c[k] - a[k];
        w[k] = d[k] - a[k];
    }
    return sign(u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
                u[2] * (v[0] * w[1] - v[1] * w[0]));
}

/* The sign of the area of a, b, c, seen along axis k. */
static int turn(const int64_t *a, const int64_t *b, const int64_t *c, int k)
{
    int i = (k + 1) % 3, j = (k + 2) % 3;
    return sign((wide)(b[i] - a[i]) * (c[j] - a[j]) - (wide)(b[j] - a[j]) * (c[i] - a[i]));
}

/* An axis along which the triangle is seen with area; -1: it has none. */
static int open_axis(const int64_t *a, const int64_t *b, const int64_t *c)
{
    for (int k = 0; k < 3; k++)
        if (turn(a, b, c, k) != 0)
            return k;
    return -1;
}

/* Is p, on the line of a and b as seen along k, between them? */
static bool between(const int64_t *a, const int64_t *b, const int64_t *p, int k)
{
    for (int d = 0; d < 3; d++)
        if (d != k && (p[d] < (a[d] < b[d] ? a[d] : b[d]) || p[d] > (a[d] < b[d] ? b[d] : a[d])))
            return false;
    return true;
}

/* Have the segments ab and pq of one plane a common point? */
static bool segments_meet(const int64_t *a, const int64_t *b, const int64_t *p, const int64_t *q, int k)
{
    int abp = turn(a, b, p, k), abq = turn(a, b, q, k), pqa = turn(p, q, a, k), pqb = turn(p, q, b, k);
    if (abp * abq < 0 && pqa * pqb < 0)
        return true;
    return (abp == 0 && between(a, b, p, k)) || (abq == 0 && between(a, b, q, k)) ||
           (pqa == 0 && between(p, q, a, k)) || (pqb == 0 && between(p, q, b, k));
}

/* The same of pq and triangle abc. */
static bool meet_in_plane(const int64_t *a, const int64_t *b, const int64_t *c, const int64_t *p,
                          const int64_t *q)
{
    int k = open_axis(a, b, c);
    if (segments_meet(a, b, p, q, k) || segments_meet(b, c, p, q, k) || segments_meet(c, a, p, q, k))
        return true;
    int u = turn(a, b, p, k), v = turn(b, c, p, k), w = turn(c, a, p, k);
    return u == v && v == w; /* pq meets no side: all of it is inside or none */
}

enum meeting { APART, TOUCHING, CROSSING };

/* Of the edge pq and the triangle abc, which has area. */
static enum meeting meet(const int64_t *a, const int64_t *b, const int64_t *c, const int64_t *p,
                         const int64_t *q)
{
    int from = side(a, b, c, p), to = side(a, b, c, q);
    if (from * to > 0)
        return APART;
    if (from == 0 && to == 0)
        return meet_in_plane(a, b, c, p, q) ? TOUCHING : APART;
    int u = side(p, q, a, b), v = side(p, q, b, c), w = side(p, q, c, a);
    if (u * v < 0 || v * w < 0 || w * u < 0)
        return APART;
    return from * to * u * v * w != 0 ? CROSSING : TOUCHING;
}

/* ---- all pairs that may meet ----------------------------------------------------------------- */

static int64_t least(const struct surface *s, const uint32_t *v, int n, int k)
{
    int64_t low = s->x[v[0]][k];
    for (int i = 1; i < n; i++)
        low = s->x[v[i]][k] < low ? s->x[v[i]][k] : low;
    return low;
}

static int64_t most(const struct surface *s, const uint32_t *v, int n, int k)
{
    int64_t high = s->x[v[0]][k];
    for (int i = 1; i < n; i++)
        high = s->x[v[i]][k] > high ? s->x[v[i]][k] : high;
    return high;
}

static int by_low_end(const void *a, const void *b, void *data)
{
    const struct surface *s = data;
    int64_t p = least(s, ((const struct triangle *)a)->v, 3, UP);
    int64_t q = least(s, ((const struct triangle *)b)->v, 3, UP);
    return (p > q) - (p < q);
}

/* Takes out the triangles without area and sorts the others. */
static void sort_triangles(struct surface *s)
{
    size_t kept = 0;
    for (size_t i = 0; i < s->triangles; i++) {
        const uint32_t *v = s->t[i].v;
        if (open_axis(s->x[v[0]], s->x[v[1]], s->x[v[2]]) >= 0)
            s->t[kept++] = s->t[i];
    }
    s->flat = s->triangles - kept;
    s->triangles = kept;
    qsort_r(s->t, s->triangles, sizeof *s->t, by_low_end, s);
}

static struct surface surface_make(const char *path)
{
    struct surface s = surface_read(path);
    find_points(&s);
    find_edges(&s);
    sort_triangles(&s);
    return s;
}

static bool share_point(const struct edge *e, const struct triangle *t)
{
    for (int k = 0; k < 3; k++)
        if (t->p[k] == e->p[0] || t->p[k] == e->p[1])
            return true;
    return false;
}

static bool boxes_meet(const struct surface *edges, const struct edge *e, const struct surface *triangles,
                       const struct triangle *t)
{
    for (int k = 0; k < 3; k++)
        if (least(edges, e->v, 2, k) > most(triangles, t->v, 3, k) ||
            least(triangles, t->v, 3, k) > most(edges, e->v, 2, k))
            return false;
    return true;
}

static void count_pair(struct count *count, enum meeting meeting, struct pair pair)
{
    bool crosses = meeting == CROSSING;
    size_t *n = crosses ? &count->crossings : &count->touches;
    if (*n < SHOWN)
        count->shown[crosses][*n] = pair;
    ++*n;
}

/* The first triangle whose low end is at or above `low`. */
static size_t first_above(const struct surface *s, int64_t low)
{
    size_t from = 0, to = s->triangles;
    while (from < to) {
        size_t middle = from + (to - from) / 2;
        if (least(s, s->t[middle].v, 3, UP) < low)
            from = middle + 1;
        else
            to = middle;
    }
    return from;
}

/* Every edge of one surface with every triangle of another, or of itself. */
static void count_edges(const struct surface *edges, const struct surface *triangles, const char *of,
                        struct count *count)
{
    int64_t tallest = 0;
    for (size_t i = 0; i < triangles->triangles; i++) {
        const uint32_t *v = triangles->t[i].v;
        int64_t height = most(triangles, v, 3, UP) - least(triangles, v, 3, UP);
        tallest = height > tallest ? height : tallest;
    }
    for (size_t i = 0; i < edges->edges; i++) {
        const struct edge *e = edges->e + i;
        int64_t low = least(edges, e->v, 2, UP) - tallest, high = most(edges, e->v, 2, UP);
        for (size_t j = first_above(triangles, low); j < triangles->triangles; j++) {
            const struct triangle *t = triangles->t + j;
            if (least(triangles, t->v, 3, UP) > high)
                break;
            if ((edges == triangles && share_point(e, t)) || !boxes_meet(edges, e, triangles, t))
                continue;
            enum meeting meeting = meet(triangles->x[t->v[0]], triangles->x[t->v[1]], triangles->x[t->v[2]],
                                        edges->x[e->v[0]], edges->x[e->v[1]]);
            if (meeting != APART)
                count_pair(count, meeting, (struct pair){e, t, of});
        }
    }
}

/* ---- printing -------------------------------------------------------------------------------- */

static void print_pairs(const char *name, const struct pair *pair, size_t count)
{
    printf(",\"%s\":[", name);
    for (size_t i = 0; i < count && i < SHOWN; i++) {
        const uint32_t *e = pair[i].edge->v, *t = pair[i].triangle->v;
        printf("%s{\"edge_of\":\"%s\",\"edge\":[%u,%u],\"triangle\":[%u,%u,%u]}", i ? "," : "", pair[i].of,
               e[0] + 1, e[1] + 1, t[0] + 1, t[1] + 1, t[2] + 1);
    }
    printf("]");
}

static void print_count(const char *name, const struct count *count)
{
    printf(",\"%s\":{\"crossings\":%zu,\"touches\":%zu", name, count->crossings, count->touches);
    print_pairs("first_crossings", count->shown[1], count->crossings);
    print_pairs("first_touches", count->shown[0], count->touches);
    printf("}");
}

static void print_surface(const char *name, const struct surface *s)
{
    printf("\"%s\":{\"triangles\":%zu,\"edges\":%zu,\"without_area\":%zu}", name, s->triangles + s->flat,
           s->edges, s->flat);
}

int main(int argc, char **argv)
{
    if (argc != 2 && argc != 3)
        die("usage", "crossings CLOTH.obj [BODY.obj]");
    struct surface cloth = surface_make(argv[1]), body = {0};
    struct count own = {0}, other = {0};
    count_edges(&cloth, &cloth, "cloth", &own);
    printf("{");
    print_surface("cloth", &cloth);
    if (argc == 3) {
        body = surface_make(argv[2]);
        count_edges(&cloth, &body, "cloth", &other);
        count_edges(&body, &cloth, "body", &other);
        printf(",");
        print_surface("body", &body);
    }
    print_count("cloth_cloth", &own);
    if (argc == 3)
        print_count("cloth_body", &other);
    printf("}\n");
    surface_done(&cloth);
    surface_done(&body);
    return 0;
}
