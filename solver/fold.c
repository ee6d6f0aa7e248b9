/* fold.c - see fold.h. */
#include "fold.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

struct dr_fold {
    const struct dr_hinge *hinge;
    size_t hinges, first_link;
};

drape_status dr_fold_new(const struct dr_hinge *hinge, size_t hinges, size_t first_link, struct dr_fold **ret,
                         drape_error *reterr)
{
    struct dr_fold *fold = malloc(sizeof *fold);
    if (!fold)
        return dr_out_of_memory(reterr);
    *fold = (struct dr_fold){hinge, hinges, first_link};
    *ret = fold;
    return DRAPE_OK;
}

struct dr_fold *dr_fold_free(struct dr_fold *fold)
{
    if (fold) /* as in its kin: tests/counts counts what freeing nothing costs */
        free(fold);
    return NULL;
}

size_t dr_fold_bytes(const struct dr_fold *fold)
{
    return sizeof *fold;
}

void dr_hinge_links(const struct dr_hinge *hinge, uint32_t link[2 * DR_HINGE_LINKS])
{
    for (int r = 1, i = 0; r < 4; r++)
        for (int c = 0; c < r; c++) {
            link[i++] = hinge->node[r];
            link[i++] = hinge->node[c];
        }
}

/* ---- the angle and its derivatives ------------------------------------------------------------- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double c[3])
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

/* One of the two triangles, its corner `a` seen from x0. */
struct wing {
    double a[3], n[3]; /* m, m^2: the normal n_A or n_B */
    double square;     /* |n|^2 */
    double foot;       /* of the corner along the edge, 0 at x0 and 1 at x1 */
};

struct shape {
    double e[3], length;
    struct wing wing[2];
    double angle;
    bool whole; /* neither the edge nor a triangle has collapsed, which leaves no angle */
};

static struct shape measure(const struct dr_hinge *hinge, const double *x)
{
    struct shape s;
    double across[3];
    const double *x0 = x + 3 * (size_t)hinge->node[0], *x1 = x + 3 * (size_t)hinge->node[1];
    for (int d = 0; d < 3; d++)
        s.e[d] = x1[d] - x0[d];
    double square = dot(s.e, s.e);
    s.length = sqrt(square);
    for (int i = 0; i < 2; i++) {
        struct wing *wing = s.wing + i;
        const double *corner = x + 3 * (size_t)hinge->node[2 + i];
        for (int d = 0; d < 3; d++)
            wing->a[d] = corner[d] - x0[d];
        cross(i ? wing->a : s.e, i ? s.e : wing->a, wing->n);
        wing->square = dot(wing->n, wing->n);
        wing->foot = dot(wing->a, s.e) / square;
    }
    cross(s.wing[0].n, s.wing[1].n, across);
    s.whole = square > 0 && s.wing[0].square > 0 && s.wing[1].square > 0;
    s.angle = s.whole ? atan2(dot(across, s.e) / s.length, dot(s.wing[0].n, s.wing[1].n)) : hinge->rest;
    double from = s.angle - hinge->rest / 2; /* a whole turn around half the rest angle */
    if (fabs(from) > M_PI)
        s.angle -= copysign(2 * M_PI, from);
    return s;
}

double dr_hinge_angle(const struct dr_hinge *hinge, const double *x)
{
    return measure(hinge, x).angle;
}

/* g: the corners turn it by -|e| n/|n|^2, and what the edge's ends do leaves rigid motions without effect. */
static void first_derivative(const struct shape *s, double g[4][3])
{
    for (int d = 0; d < 3; d++) {
        for (int i = 0; i < 2; i++)
            g[2 + i][d] = -s->length / s->wing[i].square * s->wing[i].n[d];
        g[0][d] = -(1 - s->wing[0].foot) * g[2][d] - (1 - s->wing[1].foot) * g[3][d];
        g[1][d] = -s->wing[0].foot * g[2][d] - s->wing[1].foot * g[3][d];
    }
}

/* M += scale c v'. */
static void add_outer(double M[3][3], double scale, const double c[3], const double v[3])
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            M[i][j] += scale * c[i] * v[j];
}

/* The derivative of wing i's g = -|e| n/|n|^2 by its corner (wing[2]) and by x0 and x1 (wing[0], wing[1]).
 * dg = -(d|e| n + |e| (I - 2 n n'/|n|^2) dn)/|n|^2, and n = e x a, or a x e on the other side. */
static void corner_derivative(const struct shape *s, int i, double D[3][3][3])
{
    const struct wing *wing = s->wing + i;
    double sign = i ? -1 : 1, scale = -s->length / wing->square, unit[3];
    double dn[3][3][3]; /* by x0, x1, the corner: column j is dn for a move along axis j */
    for (int j = 0; j < 3; j++) {
        double axis[3] = {j == 0, j == 1, j == 2}, by_edge[3], by_corner[3];
        cross(axis, wing->a, by_edge);
        cross(s->e, axis, by_corner);
        for (int d = 0; d < 3; d++) {
            dn[1][d][j] = sign * by_edge[d];
            dn[2][d][j] = sign * by_corner[d];
            dn[0][d][j] = -dn[1][d][j] - dn[2][d][j];
        }
    }
    for (int d = 0; d < 3; d++)
        unit[d] = s->e[d] / s->length;
    for (int k = 0; k < 3; k++) {
        double along[3]; /* n'dn */
        for (int j = 0; j < 3; j++)
            along[j] = wing->n[0] * dn[k][0][j] + wing->n[1] * dn[k][1][j] + wing->n[2] * dn[k][2][j];
        for (int d = 0; d < 3; d++)
            for (int j = 0; j < 3; j++)
                D[k][d][j] = scale * dn[k][d][j];
        add_outer(D[k], -2 * scale / wing->square, wing->n, along);
        if (k < 2)
            add_outer(D[k], (k ? -1 : 1) / wing->square, wing->n, unit);
    }
}

/* The derivative of foot = a.e/e.e by x0, x1 and the corner. */
static void foot_derivative(const struct shape *s, int i, double d[3][3])
{
    const struct wing *wing = s->wing + i;
    double square = s->length * s->length;
    for (int j = 0; j < 3; j++) {
        d[1][j] = (wing->a[j] - 2 * wing->foot * s->e[j]) / square;
        d[2][j] = s->e[j] / square;
        d[0][j] = -d[1][j] - d[2][j];
    }
}

/* G, as 3x3 blocks: from the product rule on first_derivative. */
static void second_derivative(const struct shape *s, double g[4][3], double G[4][4][3][3])
{
    memset(G, 0, 16 * sizeof G[0][0]);
    for (int i = 0; i < 2; i++) {
        const int node[3] = {0, 1, 2 + i};
        double D[3][3][3], foot[3][3], t = s->wing[i].foot;
        corner_derivative(s, i, D);
        foot_derivative(s, i, foot);
        for (int k = 0; k < 3; k++) {
            int at = node[k];
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 3; c++) {
                    G[2 + i][at][r][c] += D[k][r][c];
                    G[0][at][r][c] -= (1 - t) * D[k][r][c];
                    G[1][at][r][c] -= t * D[k][r][c];
                }
            add_outer(G[0][at], 1, g[2 + i], foot[k]);
            add_outer(G[1][at], -1, g[2 + i], foot[k]);
        }
    }
}

/* ---- the energy --------------------------------------------------------------------------------- */

double dr_fold_energy(const struct dr_fold *fold, const double *x, double *g)
{
    long double sum = 0;
    for (size_t i = 0; i < fold->hinges; i++) {
        const struct dr_hinge *hinge = fold->hinge + i;
        struct shape s = measure(hinge, x);
        double turn = s.angle - hinge->rest, by[4][3];
        sum += 0.5 * hinge->weight * turn * turn;
        if (!g || !s.whole)
            continue;
        first_derivative(&s, by);
        for (int n = 0; n < 4; n++)
            for (size_t d = 0; d < 3; d++)
                g[3 * (size_t)hinge->node[n] + d] += hinge->weight * turn * by[n][d];
    }
    return (double)sum;
}

/* Adds one hinge's H, in 3x3 blocks, to A. */
static void add_hinge(const struct dr_hinge *hinge, size_t link, double H[4][4][3][3], struct dr_matrix *A)
{
    for (int r = 0; r < 4; r++) {
        double(*own)[3] = H[r][r];
        const double lower[6] = {own[0][0], own[1][0], own[1][1], own[2][0], own[2][1], own[2][2]};
        dr_matrix_add_node(A, hinge->node[r], lower);
        for (int c = 0; c < r; c++)
            dr_matrix_add_pair(A, link++, &H[r][c][0][0]);
    }
}

void dr_fold_hessian(const struct dr_fold *fold, const double *x, double exact, struct dr_matrix *A)
{
    for (size_t i = 0; i < fold->hinges; i++) {
        const struct dr_hinge *hinge = fold->hinge + i;
        struct shape s = measure(hinge, x);
        double g[4][3], H[4][4][3][3] = {{{{0}}}}, second = exact * hinge->weight * (s.angle - hinge->rest);
        if (!s.whole)
            continue;
        first_derivative(&s, g);
        if (second != 0)
            second_derivative(&s, g, H);
        for (int r = 0; r < 4; r++)
            for (int c = 0; c <= r; c++)
                for (int d = 0; d < 3; d++)
                    for (int k = 0; k < 3; k++)
                        H[r][c][d][k] = second * H[r][c][d][k] + hinge->weight * g[r][d] * g[c][k];
        add_hinge(hinge, fold->first_link + DR_HINGE_LINKS * i, H, A);
    }
}

void dr_fold_left_out(const struct dr_fold *fold, const double *x, const double *p, double *q)
{
    for (size_t i = 0; i < fold->hinges; i++) {
        const struct dr_hinge *hinge = fold->hinge + i;
        struct shape s = measure(hinge, x);
        double g[4][3], G[4][4][3][3], moment = hinge->weight * (s.angle - hinge->rest);
        if (!s.whole || moment == 0)
            continue;
        first_derivative(&s, g);
        second_derivative(&s, g, G);
        for (int r = 0; r < 4; r++)
            for (int c = 0; c < 4; c++)
                for (size_t d = 0; d < 3; d++)
                    q[3 * (size_t)hinge->node[r] + d] +=
                        moment * dot(G[r][c][d], p + 3 * (size_t)hinge->node[c]);
    }
}
