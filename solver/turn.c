/* turn.c - see turn.h. */
#include "turn.h"

#include <math.h>
#include <string.h>

static void cross(const double a[3], const double b[3], double ret[3])
{
    ret[0] = a[1] * b[2] - a[2] * b[1];
    ret[1] = a[2] * b[0] - a[0] * b[2];
    ret[2] = a[0] * b[1] - a[1] * b[0];
}

static bool normalise(double a[3])
{
    double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int d = 0; d < 3; d++)
        a[d] /= length;
    return length > 0;
}

/* Rows: the first side, the normal, and what completes them. False: there is no normal. */
static bool frame_of(const uint32_t node[3], const double *x, double ret[3][3])
{
    const double *a = x + 3 * (size_t)node[0], *b = x + 3 * (size_t)node[1], *c = x + 3 * (size_t)node[2];
    double other[3];
    for (int d = 0; d < 3; d++) {
        ret[0][d] = b[d] - a[d];
        other[d] = c[d] - a[d];
    }
    cross(ret[0], other, ret[1]);
    if (!normalise(ret[0]) || !normalise(ret[1]))
        return false;
    cross(ret[0], ret[1], ret[2]);
    return true;
}

/* Of R = sum to_k from_k': its skew part over 1 + trace; none where the trace 1 + 2 cos(angle) is not > 0. */
static void turn_of(const double from[3][3], const double to[3][3], double ret[3])
{
    double R[3][3] = {{0}};
    for (int k = 0; k < 3; k++)
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                R[r][c] += to[k][r] * from[k][c];
    double trace = R[0][0] + R[1][1] + R[2][2];
    if (!(trace > 0))
        return;
    ret[0] = (R[2][1] - R[1][2]) / (1 + trace);
    ret[1] = (R[0][2] - R[2][0]) / (1 + trace);
    ret[2] = (R[1][0] - R[0][1]) / (1 + trace);
}

void dr_turn_take(const struct dr_mesh *mesh, const double *x0, const double *x1, double *weight,
                  double *turn)
{
    memset(turn, 0, 3 * mesh->nodes * sizeof *turn);
    memset(weight, 0, mesh->nodes * sizeof *weight);
    for (size_t t = 0; t < mesh->triangles; t++) {
        const uint32_t *node = mesh->triangle + 3 * t;
        double from[3][3], to[3][3], g[3] = {0, 0, 0}, area = mesh->area[t];
        if (frame_of(node, x0, from) && frame_of(node, x1, to))
            turn_of(from, to, g);
        for (int k = 0; k < 3; k++) {
            weight[node[k]] += area;
            for (size_t d = 0; d < 3; d++)
                turn[3 * (size_t)node[k] + d] += area * g[d];
        }
    }
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        turn[i] /= weight[i / 3];
}

/* R v = v + 2 (g x v + g x (g x v)) / (1 + g.g) */
void dr_turn_apply(size_t nodes, const double *turn, bool back, const double *from, double *to)
{
    for (size_t i = 0; i < nodes; i++) {
        const double *v = from + 3 * i, *forth = turn + 3 * i, sign = back ? -1 : 1;
        double g[3] = {sign * forth[0], sign * forth[1], sign * forth[2]}, once[3], twice[3];
        double scale = 2 / (1 + g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
        cross(g, v, once);
        cross(g, once, twice);
        for (size_t d = 0; d < 3; d++)
            to[3 * i + d] = v[d] + scale * (once[d] + twice[d]);
    }
}
