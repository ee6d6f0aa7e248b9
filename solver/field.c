/* field.c - reading a distance field: the tricubic B-spline and its exact gradient. */
#include "field.h"

#include <stdlib.h>

/* Inside, on the medial axis, the gradient passes through zero; below this length it is replaced. */
#define LEAST_GRADIENT 0.01

struct dr_field *dr_field_ref(struct dr_field *field)
{
    /* Whoever has a reference to copy keeps the field alive meanwhile: there is nothing to order. */
    atomic_fetch_add_explicit(&field->references, 1, memory_order_relaxed);
    return field;
}

struct dr_field *dr_field_unref(struct dr_field *field)
{
    /* Every reader has done with it before the last one frees it. */
    if (field && atomic_fetch_sub_explicit(&field->references, 1, memory_order_acq_rel) == 1) {
        free(field->table);
        free(field->value);
        free(field);
    }
    return NULL;
}

size_t dr_field_bytes(const struct dr_field *field)
{
    size_t table = (size_t)field->side[0] * field->side[1] * field->side[2];
    return sizeof *field + table * sizeof *field->table +
           field->blocks * DR_BLOCK_NODES * sizeof *field->value;
}

/* Four numbers that the processor may work on at once. */
typedef double quad __attribute__((vector_size(4 * sizeof(double))));

/* A stencil of 4x4x4 nodes. */
struct stencil {
    size_t first[3];        /* node of the lowest corner, along each axis */
    quad w[4], dw[4], t, s; /* by node along an axis: B-spline weights and their slopes; in lanes 0..2, by
                             * axis; fraction of a cell, and 1 minus it */
};

static inline __attribute__((always_inline)) void weigh(struct stencil *stencil)
{
    quad t = stencil->t, s = 1 - t;
    stencil->s = s;
    stencil->w[0] = s * s * s / 6;
    stencil->w[1] = (4 + t * t * (3 * t - 6)) / 6;
    stencil->w[2] = (4 + s * s * (3 * s - 6)) / 6;
    stencil->w[3] = t * t * t / 6;
    stencil->dw[0] = -s * s / 2;
    stencil->dw[1] = t * (3 * t - 4) / 2;
    stencil->dw[2] = -s * (3 * s - 4) / 2;
    stencil->dw[3] = t * t / 2;
}

/* The stencil round x; false when no node of its cell was resolved. */
static inline __attribute__((always_inline)) bool locate(const struct dr_field *field, const double x[3],
                                                         struct stencil *stencil)
{
    size_t at = 0, stride = 1; /* of the cell's own block */
    stencil->t = (quad){0};
    for (int d = 0; d < 3; d++) {
        double u = (x[d] - field->origin[d]) / field->spacing;
        /* Blocks of the outermost layer do not exist. A NaN fails this test, too. */
        if (!(u >= DR_BLOCK && u < (double)DR_BLOCK * (field->side[d] - 1)))
            return false;
        size_t cell = (size_t)u;
        at += cell / DR_BLOCK * stride;
        stride *= field->side[d];
        stencil->first[d] = cell - 1;
        stencil->t[d] = u - (double)cell;
    }
    /* Without a block the cell's own node is farther than reach + 3.5 spacings, so x is out of reach. */
    return field->table[at];
}

/* The row of the stencil along x that is b, c from its lowest corner: it lies in one block or in two. */
static inline __attribute__((always_inline)) const float *
row_of(const struct dr_field *field, const struct stencil *stencil, size_t b, size_t c, float copy[4])
{
    size_t i = stencil->first[0], j = stencil->first[1] + b, k = stencil->first[2] + c;
    const uint32_t *table =
        field->table + i / DR_BLOCK + field->side[0] * (j / DR_BLOCK + field->side[1] * (k / DR_BLOCK));
    size_t local = (k % DR_BLOCK * DR_BLOCK + j % DR_BLOCK) * DR_BLOCK;
    const float *row = field->value + table[0] * DR_BLOCK_NODES + local;
    size_t here = DR_BLOCK - i % DR_BLOCK; /* nodes left in this block */
    row += i % DR_BLOCK;
    if (here >= 4)
        return row;
    const float *next = field->value + table[1] * DR_BLOCK_NODES + local;
    for (size_t a = 0; a < 4; a++)
        copy[a] = a < here ? row[a] : next[a - here];
    return copy;
}

/* phi = sum w_a w_b w_c value_abc; false out of reach. */
static inline __attribute__((always_inline)) bool
interpolate_in(const struct dr_field *field, const double x[3], double *ret_phi, double ret_grad[3])
{
    struct stencil stencil;
    quad along[4], sum = {0}; /* phi and its gradient in one */
    if (!locate(field, x, &stencil))
        return false;
    weigh(&stencil);
    for (size_t a = 0; a < 4; a++) {
        double w = stencil.w[a][0];
        along[a] = (quad){w, stencil.dw[a][0], w, w};
    }
    for (size_t c = 0; c < 4; c++) {
        double wz = stencil.w[c][2];
        quad z = {wz, wz, wz, stencil.dw[c][2]};
        for (size_t b = 0; b < 4; b++) {
            double wy = stencil.w[b][1];
            quad y = {wy, wy, stencil.dw[b][1], wy};
            float copy[4];
            const float *row = row_of(field, &stencil, b, c, copy);
            quad value = along[0] * (double)row[0] + along[1] * (double)row[1] + along[2] * (double)row[2] +
                         along[3] * (double)row[3];
            sum += y * z * value;
        }
    }
    if (sum[0] > field->reach)
        return false;
    *ret_phi = sum[0];
    for (int d = 0; d < 3; d++)
        ret_grad[d] = sum[d + 1] / field->spacing;
    return true;
}

#ifdef __x86_64__
__attribute__((target("avx2"))) static bool interpolate_fast(const struct dr_field *field, const double x[3],
                                                             double *ret_phi, double ret_grad[3])
{
    return interpolate_in(field, x, ret_phi, ret_grad);
}
#endif

/* The same bytes either way. */
static bool interpolate(const struct dr_field *field, const double x[3], double *ret_phi, double ret_grad[3])
{
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2"))
        return interpolate_fast(field, x, ret_phi, ret_grad);
#endif
    return interpolate_in(field, x, ret_phi, ret_grad);
}

/* The axis direction along which the distance grows most over one spacing; where it grows along
 * none, over two, four, ... Ends, since every direction leaves the body at last. */
static void steepest_axis(const struct dr_field *field, const double x[3], double phi, double ret_grad[3])
{
    double best = phi;
    for (double step = field->spacing; best <= phi; step *= 2) {
        for (int k = 0; k < 6; k++) {
            double y[3] = {x[0], x[1], x[2]}, there = field->reach, unused[3];
            double sign = k % 2 ? -1 : 1;
            y[k / 2] += sign * step;
            interpolate(field, y, &there, unused);
            if (there > best) {
                best = there;
                for (int d = 0; d < 3; d++)
                    ret_grad[d] = d == k / 2 ? sign : 0;
            }
        }
    }
}

bool dr_field_distance(const struct dr_field *field, const double x[3], double *ret_phi, double ret_grad[3])
{
    if (!interpolate(field, x, ret_phi, ret_grad))
        return false;
    double square = ret_grad[0] * ret_grad[0] + ret_grad[1] * ret_grad[1] + ret_grad[2] * ret_grad[2];
    if (*ret_phi < 0 && square < LEAST_GRADIENT * LEAST_GRADIENT)
        steepest_axis(field, x, *ret_phi, ret_grad);
    return true;
}

void dr_field_curvature(const struct dr_field *field, const double x[3], double ret[6])
{
    struct stencil stencil;
    double phi, unused[3], sum[6] = {0, 0, 0, 0, 0, 0};
    if (!interpolate(field, x, &phi, unused) || !locate(field, x, &stencil))
        return;
    weigh(&stencil);
    const quad *w = stencil.w, *dw = stencil.dw;
    const quad ddw[4] = {stencil.s, 3 * stencil.t - 2, 3 * stencil.s - 2, stencil.t};
    for (size_t c = 0; c < 4; c++)
        for (size_t b = 0; b < 4; b++) {
            float copy[4];
            const float *row = row_of(field, &stencil, b, c, copy);
            for (size_t a = 0; a < 4; a++) {
                double value = (double)row[a];
                sum[0] += ddw[a][0] * w[b][1] * w[c][2] * value;
                sum[1] += dw[a][0] * dw[b][1] * w[c][2] * value;
                sum[2] += w[a][0] * ddw[b][1] * w[c][2] * value;
                sum[3] += dw[a][0] * w[b][1] * dw[c][2] * value;
                sum[4] += w[a][0] * dw[b][1] * dw[c][2] * value;
                sum[5] += w[a][0] * w[b][1] * ddw[c][2] * value;
            }
        }
    for (int i = 0; i < 6; i++)
        ret[i] = sum[i] / (field->spacing * field->spacing);
}
