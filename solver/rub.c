/* rub.c - see rub.h. */
#include "rub.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "friction.h"

struct anchor {
    struct dr_rub_pair pair; /* as at the last update */
    double at[3];            /* a, m */
    double limit;            /* N: mu times the force */
};

struct dr_rub {
    double *mu; /* nodes */
    size_t nodes;
    struct anchor *anchor, *last; /* in the pairs' order; those of the update before */
    size_t count, room, last_count, last_room;
    size_t merged; /* of the last ones, that come before the pair just taken */
};

drape_status dr_rub_new(const double *own, const double *rest, double mu, size_t nodes, struct dr_rub **ret,
                        drape_error *reterr)
{
    struct dr_rub *rub = calloc(1, sizeof *rub);
    if (!rub)
        return dr_out_of_memory(reterr);
    rub->nodes = nodes;
    rub->mu = malloc(nodes * sizeof *rub->mu);
    if (!rub->mu) {
        dr_rub_free(rub);
        return dr_out_of_memory(reterr);
    }
    for (size_t v = 0; v < nodes; v++)
        rub->mu[v] = own[v] + rest[v] * mu;
    *ret = rub;
    return DRAPE_OK;
}

struct dr_rub *dr_rub_free(struct dr_rub *rub)
{
    if (rub) {
        free(rub->mu);
        free(rub->anchor);
        free(rub->last);
        free(rub);
    }
    return NULL;
}

size_t dr_rub_bytes(const struct dr_rub *rub)
{
    return sizeof *rub + rub->nodes * sizeof *rub->mu + (rub->room + rub->last_room) * sizeof *rub->anchor;
}

/* ---- anchors --------------------------------------------------------------------------------- */

void dr_rub_begin(struct dr_rub *rub)
{
    struct anchor *anchor = rub->anchor;
    size_t room = rub->room;
    rub->anchor = rub->last;
    rub->room = rub->last_room;
    rub->last = anchor;
    rub->last_room = room;
    rub->last_count = rub->count;
    rub->count = rub->merged = 0;
}

static int compare(const struct dr_rub_pair *p, const struct dr_rub_pair *q)
{
    if (p->edges != q->edges)
        return p->edges ? 1 : -1;
    if (p->a != q->a)
        return p->a < q->a ? -1 : 1;
    return p->b < q->b ? -1 : p->b > q->b;
}

/* The offset between the closest points, by the weights of `pair`. */
static void offset_at(const struct dr_rub_pair *pair, const double *x, double ret[3])
{
    for (size_t d = 0; d < 3; d++) {
        ret[d] = 0;
        for (int k = 0; k < 4; k++)
            ret[d] += pair->weight[k] * x[3 * (size_t)pair->node[k] + d];
    }
}

/* What is across n of v; returns its length. */
static double across(const double n[3], double v[3])
{
    double along = v[0] * n[0] + v[1] * n[1] + v[2] * n[2], square = 0;
    for (int d = 0; d < 3; d++) {
        v[d] -= along * n[d];
        square += v[d] * v[d];
    }
    return sqrt(square);
}

/* u at x; returns its length. */
static double slip(const struct anchor *anchor, const double *x, double u[3])
{
    offset_at(&anchor->pair, x, u);
    for (int d = 0; d < 3; d++)
        u[d] -= anchor->at[d];
    return across(anchor->pair.n, u);
}

bool dr_rub_take(struct dr_rub *rub, const struct dr_rub_pair *pair, const double *x)
{
    if (rub->count == rub->room) {
        size_t room = rub->room ? 2 * rub->room : 256;
        struct anchor *grown = realloc(rub->anchor, room * sizeof *grown);
        if (!grown)
            return false;
        rub->anchor = grown;
        rub->room = room;
    }
    struct anchor *anchor = rub->anchor + rub->count++;
    double u[3] = {0, 0, 0}, mu = 0;
    while (rub->merged < rub->last_count && compare(&rub->last[rub->merged].pair, pair) < 0)
        rub->merged++;
    if (rub->merged < rub->last_count && compare(&rub->last[rub->merged].pair, pair) == 0) {
        double l = slip(rub->last + rub->merged, x, u);
        for (int d = 0; d < 3 && l > DR_FRICTION_SLIP; d++)
            u[d] *= DR_FRICTION_SLIP / l;
        across(pair->n, u);
    }
    anchor->pair = *pair;
    offset_at(pair, x, anchor->at);
    for (int d = 0; d < 3; d++)
        anchor->at[d] -= u[d];
    for (int k = 0; k < 4; k++)
        mu += fabs(pair->weight[k]) / 2 * rub->mu[pair->node[k]];
    anchor->limit = mu * pair->force;
    return true;
}

/* Against f on its nodes the pair's force t is least out of balance, sum |f_k - b_k t|^2, at
 * t = sum b_k f_k / sum b_k^2. */
static double brace(struct anchor *anchor, const double *x, double *f)
{
    const struct dr_rub_pair *pair = &anchor->pair;
    double u[3], more[3], squares = 0, at[3];
    slip(anchor, x, u);
    offset_at(pair, x, at);
    offset_at(pair, f, more);
    for (int k = 0; k < 4; k++)
        squares += pair->weight[k] * pair->weight[k];
    for (int d = 0; d < 3; d++)
        more[d] /= squares;
    across(pair->n, more);
    double change = dr_friction_hold_more(anchor->limit, u, more);
    for (size_t d = 0; d < 3; d++) {
        anchor->at[d] = at[d] - u[d];
        for (int k = 0; k < 4; k++)
            f[3 * (size_t)pair->node[k] + d] -= pair->weight[k] * more[d];
    }
    return change;
}

double dr_rub_brace(struct dr_rub *rub, const double *x, double *f)
{
    double most = 0;
    for (size_t i = 0; i < rub->count; i++)
        if (rub->anchor[i].limit > 0)
            most = fmax(most, brace(rub->anchor + i, x, f));
    return most;
}

/* ---- the potential --------------------------------------------------------------------------- */

double dr_rub_energy(const struct dr_rub *rub, const double *x, double *g)
{
    double sum = 0;
    for (size_t i = 0; i < rub->count; i++) {
        const struct anchor *anchor = rub->anchor + i;
        double u[3], energy, secant, unused;
        dr_friction_respond(anchor->limit, slip(anchor, x, u), &energy, &secant, &unused);
        sum += energy;
        for (int k = 0; g && k < 4; k++)
            for (size_t d = 0; d < 3; d++)
                g[3 * (size_t)anchor->pair.node[k] + d] += anchor->pair.weight[k] * secant * u[d];
    }
    return sum;
}

void dr_rub_hessian(const struct dr_rub *rub, const double *x, double exact, struct dr_matrix *A)
{
    for (size_t i = 0; i < rub->count; i++) {
        const struct anchor *anchor = rub->anchor + i;
        const double *n = anchor->pair.n, *b = anchor->pair.weight;
        const uint32_t *node = anchor->pair.node;
        double u[3], unused, secant, tangent, l = slip(anchor, x, u);
        dr_friction_respond(anchor->limit, l, &unused, &secant, &tangent);
        double along = l > 0 ? exact * (tangent - secant) / (l * l) : 0;
        double H[3][3];
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++)
                H[r][c] = secant * ((r == c) - n[r] * n[c]) + along * u[r] * u[c];
        for (int j = 0; j < 4; j++) {
            double s = b[j] * b[j];
            dr_matrix_add_node(A, node[j],
                               (const double[]){s * H[0][0], s * H[1][0], s * H[1][1], s * H[2][0],
                                                s * H[2][1], s * H[2][2]});
            for (int k = 0; k < j; k++) {
                double block[3][3];
                for (int r = 0; r < 3; r++)
                    for (int c = 0; c < 3; c++)
                        block[r][c] = b[j] * b[k] * H[r][c];
                dr_matrix_add_between(A, node[j], node[k], (const double(*)[3])block);
            }
        }
    }
}

bool dr_rub_nodes(const struct dr_rub *rub, size_t i, uint32_t ret[4])
{
    if (i >= rub->count)
        return false;
    memcpy(ret, rub->anchor[i].pair.node, 4 * sizeof *ret);
    return true;
}
