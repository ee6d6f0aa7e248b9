/* tack.c - see tack.h. */
#include "tack.h"

#include <stdlib.h>
#include <string.h>

#include "error.h"

/* A distance field's gradient is nearly of unit length: each step leaves a few per cent of the way. */
#define LIFTS 4

struct dr_tacks {
    size_t tacks;
    uint32_t *node; /* tacks */
    double *at;     /* 3*tacks, m */
};

void dr_tack_point(const uint32_t *triangle, const double *positions, const double barycentric[2],
                   double ret[3])
{
    double weight[3] = {barycentric[0], barycentric[1], 1 - barycentric[0] - barycentric[1]};
    memset(ret, 0, 3 * sizeof *ret);
    for (int k = 0; k < 3; k++)
        for (size_t d = 0; d < 3; d++)
            ret[d] += weight[k] * positions[3 * (size_t)triangle[k] + d];
}

void dr_tack_lift(const struct dr_body *body, double point[3])
{
    double phi, n[3], offset = dr_body_offset(body);
    for (int lift = 0; lift < LIFTS; lift++) {
        if (!dr_body_distance(body, point, &phi, n) || phi >= offset || phi < -DRAPE_REACH)
            return;
        double square = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        for (int d = 0; square > 0.25 && d < 3; d++) /* flat between two surfaces: nowhere to lift it to */
            point[d] += (offset - phi) * n[d] / square;
    }
}

drape_status dr_tacks_new(const struct dr_tack *tack, size_t tacks, bool by_vertex, struct dr_tacks **ret,
                          drape_error *reterr)
{
    struct dr_tacks *made = calloc(1, sizeof *made);
    if (made) {
        made->tacks = tacks;
        made->node = malloc(tacks * sizeof *made->node);
        made->at = malloc(3 * tacks * sizeof *made->at);
    }
    if (!made || !made->node || !made->at) {
        dr_tacks_free(made);
        return dr_out_of_memory(reterr);
    }
    for (size_t i = 0; i < tacks; i++) {
        made->node[i] = by_vertex ? tack[i].vertex : tack[i].node;
        dr_tacks_move(made, i, by_vertex ? tack[i].first : tack[i].at);
    }
    *ret = made;
    return DRAPE_OK;
}

struct dr_tacks *dr_tacks_free(struct dr_tacks *tacks)
{
    if (tacks) {
        free(tacks->node);
        free(tacks->at);
        free(tacks);
    }
    return NULL;
}

size_t dr_tacks_bytes(const struct dr_tacks *tacks)
{
    return sizeof *tacks + tacks->tacks * (sizeof *tacks->node + 3 * sizeof *tacks->at);
}

void dr_tacks_move(struct dr_tacks *tacks, size_t i, const double point[3])
{
    memcpy(tacks->at + 3 * i, point, 3 * sizeof *point);
}

double dr_tacks_energy(const struct dr_tacks *tacks, const double *x, double *g)
{
    double sum = 0;
    for (size_t i = 0; i < tacks->tacks; i++)
        for (size_t d = 0; d < 3; d++) {
            size_t at = 3 * (size_t)tacks->node[i] + d;
            double off = x[at] - tacks->at[3 * i + d];
            sum += off * off;
            if (g)
                g[at] += DRAPE_TACK_STIFFNESS * off;
        }
    return 0.5 * DRAPE_TACK_STIFFNESS * sum;
}

void dr_tacks_hessian(const struct dr_tacks *tacks, struct dr_matrix *A)
{
    const double k = DRAPE_TACK_STIFFNESS, H[6] = {k, 0, k, 0, 0, k};
    for (size_t i = 0; i < tacks->tacks; i++)
        dr_matrix_add_node(A, tacks->node[i], H);
}
