/* closest.h - the closest points of a vertex and a triangle, and of two edges.
 *
 * r joins them: r = sum_i weight[i] x[node[i]], with weights that sum to 0. Inside a feature, r is a function
 * of the positions and of parameters beta that the closest point minimises f = |r|^2/2 over; the Hessian of
 * the distance then is f_xx - f_xb f_bb^-1 f_bx (implicit function theorem), for which the free parameters
 * are told with the result. Any input gives some result: NaN in, NaN or some weights out.
 *
 * All arithmetic is on differences of positions, so that it loses nothing far from the origin. */
#ifndef DR_CLOSEST_H
#define DR_CLOSEST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* sin^2 of the angle between two edge vectors below which a plane or a crossing point that they span is
 * round-off: the closest points are then looked for on the edges alone, which is off by 1e-8 of an edge. */
#define DR_CLOSEST_FLAT 1e-16
/* sin^2 below which f_bb of two parameters is too close to singular for its inverse to be of use: only the
 * first of them is then told as free. */
#define DR_CLOSEST_PARALLEL 1e-10

struct dr_closest {
    double square;      /* |r|^2, m^2 */
    double r[3];        /* m: from the triangle to the vertex, from edge b to edge a */
    double weight[4];   /* of the nodes: 1, -(barycentric); or 1 - s, s, -(1 - t), -t */
    uint8_t free;       /* parameters inside their range: 2, 1 on an edge, 0 at a corner */
    uint8_t edge[2][2]; /* of free parameter k: dr/dbeta = x[node[edge[k][0]]] - x[node[edge[k][1]]] */
};

static inline double dr_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void dr_cross(const double a[3], const double b[3], double ret[3])
{
    ret[0] = a[1] * b[2] - a[2] * b[1];
    ret[1] = a[2] * b[0] - a[0] * b[2];
    ret[2] = a[0] * b[1] - a[1] * b[0];
}

static inline void dr_between(const double from[3], const double to[3], double ret[3])
{
    for (int d = 0; d < 3; d++)
        ret[d] = to[d] - from[d];
}

/* numerator/denominator brought into 0..1; 0 for an edge of no length. */
static inline double dr_clamped_ratio(double numerator, double denominator)
{
    if (!(denominator > 0) || !(numerator > 0))
        return 0;
    return numerator < denominator ? numerator / denominator : 1;
}

/* Tells parameter `free` of a result: dr/dbeta = x[node[to]] - x[node[from]]. */
static inline void dr_closest_add_free(struct dr_closest *c, double beta, uint8_t to, uint8_t from)
{
    if (beta > 0 && beta < 1) {
        c->edge[c->free][0] = to;
        c->edge[c->free][1] = from;
        c->free++;
    }
}

/* The closest point to q on the edge from corner i to corner j (1 to 3), at o with direction e, replaces
 * *best if it is closer. */
static inline void dr_closest_on_side(const double q[3], const double o[3], const double e[3], uint8_t i,
                                      uint8_t j, struct dr_closest *best)
{
    double w[3], r[3];
    dr_between(o, q, w);
    double s = dr_clamped_ratio(dr_dot(w, e), dr_dot(e, e));
    for (int d = 0; d < 3; d++)
        r[d] = w[d] - s * e[d];
    double square = dr_dot(r, r);
    if (square >= best->square)
        return;
    *best = (struct dr_closest){.square = square, .r = {r[0], r[1], r[2]}, .weight = {1, 0, 0, 0}};
    best->weight[i] = -(1 - s);
    best->weight[j] = -s;
    dr_closest_add_free(best, s, i, j);
}

/* node[0] is the vertex, node[1..3] are the corners of the triangle. */
static inline struct dr_closest dr_closest_vertex_face(const double *x, const uint32_t node[4])
{
    const double *a = x + 3 * (size_t)node[1], zero[3] = {0, 0, 0};
    double e1[3], e2[3], e3[3], q[3], n[3], c[3];
    dr_between(a, x + 3 * (size_t)node[2], e1);
    dr_between(a, x + 3 * (size_t)node[3], e2);
    dr_between(a, x + 3 * (size_t)node[0], q);
    dr_cross(e1, e2, n);
    double nn = dr_dot(n, n), flat = dr_dot(e1, e1) * dr_dot(e2, e2);
    if (nn > DR_CLOSEST_FLAT * flat) { /* q = u e1 + v e2 + k n: cross with an edge, then dot with n */
        dr_cross(q, e2, c);
        double u = dr_dot(c, n) / nn;
        dr_cross(e1, q, c);
        double v = dr_dot(c, n) / nn;
        if (u > 0 && v > 0 && u + v < 1) {
            struct dr_closest in = {.weight = {1, -(1 - u - v), -u, -v},
                                    .free = nn > DR_CLOSEST_PARALLEL * flat ? 2 : 1,
                                    .edge = {{1, 2}, {1, 3}}};
            for (int d = 0; d < 3; d++)
                in.r[d] = q[d] - u * e1[d] - v * e2[d];
            in.square = dr_dot(in.r, in.r);
            return in;
        }
    }
    /* f is convex over the triangle: not inside, its minimum is on a side. */
    struct dr_closest best = {.square = dr_dot(q, q), .r = {q[0], q[1], q[2]}, .weight = {1, -1, 0, 0}};
    dr_closest_on_side(q, zero, e1, 1, 2, &best);
    dr_closest_on_side(q, zero, e2, 1, 3, &best);
    dr_between(e1, e2, e3);
    dr_closest_on_side(q, e1, e3, 2, 3, &best);
    return best;
}

/* Where on edge a (direction `a`) parallel edge b is closest: the middle of where they overlap, or the end
 * nearest to it. sb: parameter of the start of b on a, ab: how far b runs along a, in lengths of a. */
static inline double dr_closest_parallel(double sb, double ab)
{
    double low = ab < 0 ? sb + ab : sb, high = ab < 0 ? sb : sb + ab;
    low = low > 0 ? low : 0;
    high = high < 1 ? high : 1;
    return dr_clamped_ratio((low + high) / 2, 1);
}

/* node[0..1] is edge a, node[2..3] is edge b. r = w + s a - t b, w = x0 - x2. After Ericson, Real-Time
 * Collision Detection, 5.1.9. */
static inline struct dr_closest dr_closest_edge_edge(const double *x, const uint32_t node[4])
{
    const double *x0 = x + 3 * (size_t)node[0], *x2 = x + 3 * (size_t)node[2];
    double a[3], b[3], w[3], n[3], c[3];
    dr_between(x0, x + 3 * (size_t)node[1], a);
    dr_between(x2, x + 3 * (size_t)node[3], b);
    dr_between(x2, x0, w);
    dr_cross(a, b, n);
    double nn = dr_dot(n, n), aa = dr_dot(a, a), bb = dr_dot(b, b), ab = dr_dot(a, b), aw = dr_dot(a, w),
           bw = dr_dot(b, w), s = 0;
    if (nn > DR_CLOSEST_FLAT * aa * bb) { /* r = k n: cross with b, then dot with n */
        dr_cross(w, b, c);
        s = dr_clamped_ratio(-dr_dot(c, n), nn);
    } else if (aa > 0) {
        s = dr_closest_parallel(-aw / aa, ab / aa);
    }
    double along = ab * s + bw; /* t = along/bb */
    double t = dr_clamped_ratio(along, bb);
    if (!(along > 0 && along < bb))
        s = dr_clamped_ratio(ab * t - aw, aa);
    struct dr_closest ret = {.weight = {1 - s, s, -(1 - t), -t}};
    for (int d = 0; d < 3; d++)
        ret.r[d] = w[d] + s * a[d] - t * b[d];
    ret.square = dr_dot(ret.r, ret.r);
    dr_closest_add_free(&ret, s, 1, 0);
    dr_closest_add_free(&ret, t, 2, 3);
    if (ret.free == 2 && !(nn > DR_CLOSEST_PARALLEL * aa * bb))
        ret.free = 1;
    return ret;
}

#endif
