/* field.c - reading a distance field: the tricubic B-spline and its exact gradient. */
#include "field.h"

#include <math.h>
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

/* The four cubic B-spline weights and their first two derivatives at fraction t of a cell. */
static void spline_weights(double t, double w[4], double dw[4], double ddw[4])
{
    double s = 1 - t;
    w[0] = s * s * s / 6;
    w[1] = (4 + t * t * (3 * t - 6)) / 6;
    w[2] = (4 + s * s * (3 * s - 6)) / 6;
    w[3] = t * t * t / 6;
    dw[0] = -s * s / 2;
    dw[1] = t * (3 * t - 4) / 2;
    dw[2] = -s * (3 * s - 4) / 2;
    dw[3] = t * t / 2;
    ddw[0] = s;
    ddw[1] = 3 * t - 2;
    ddw[2] = 3 * s - 2;
    ddw[3] = t;
}

/* The four nodes of a stencil along one axis: index of their block along it, index within the block. */
struct stencil_axis {
    size_t block[4], node[4];
    double w[4], dw[4], ddw[4];
};

static struct stencil_axis locate(double u)
{
    struct stencil_axis axis;
    double cell = floor(u);
    spline_weights(u - cell, axis.w, axis.dw, axis.ddw);
    for (size_t c = 0; c < 4; c++) {
        size_t i = (size_t)cell - 1 + c;
        axis.block[c] = i / DR_BLOCK;
        axis.node[c] = i % DR_BLOCK;
    }
    return axis;
}

/* One row of the stencil along x lies in one block or in two neighbours: its value and its slope. */
static void read_row(const struct dr_field *field, const struct stencil_axis *x, const uint32_t *table,
                     size_t local, double *ret_value, double *ret_slope)
{
    const float *near = field->value + table[x->block[0]] * DR_BLOCK_NODES + local;
    const float *far = field->value + table[x->block[3]] * DR_BLOCK_NODES + local;
    *ret_value = *ret_slope = 0;
    for (int a = 0; a < 4; a++) {
        double value = (double)(x->block[a] == x->block[0] ? near : far)[x->node[a]];
        *ret_value += x->w[a] * value;
        *ret_slope += x->dw[a] * value;
    }
}

/* The stencil round x; false when no node of its cell was resolved. */
static bool locate_cell(const struct dr_field *field, const double x[3], struct stencil_axis axis[3])
{
    for (int d = 0; d < 3; d++) {
        double u = (x[d] - field->origin[d]) / field->spacing;
        /* Blocks of the outermost layer do not exist. A NaN fails this test, too. */
        if (!(u >= DR_BLOCK && u < (double)DR_BLOCK * (field->side[d] - 1)))
            return false;
        axis[d] = locate(u);
    }
    size_t row = field->side[0], layer = row * field->side[1];
    /* Without a block the cell's own node is farther than reach + 3.5 spacings, so x is out of reach. */
    return field->table[axis[2].block[1] * layer + axis[1].block[1] * row + axis[0].block[1]];
}

/* phi = sum w_a w_b w_c value_abc; false out of reach. */
static bool interpolate(const struct dr_field *field, const double x[3], double *ret_phi, double ret_grad[3])
{
    struct stencil_axis axis[3];
    if (!locate_cell(field, x, axis))
        return false;
    const struct stencil_axis *y = &axis[1], *z = &axis[2];
    size_t row = field->side[0], layer = row * field->side[1];
    double phi = 0, grad[3] = {0, 0, 0};
    for (int c = 0; c < 4; c++) {
        for (int b = 0; b < 4; b++) {
            double value, slope;
            read_row(field, &axis[0], field->table + z->block[c] * layer + y->block[b] * row,
                     (z->node[c] * DR_BLOCK + y->node[b]) * DR_BLOCK, &value, &slope);
            phi += y->w[b] * z->w[c] * value;
            grad[0] += y->w[b] * z->w[c] * slope;
            grad[1] += y->dw[b] * z->w[c] * value;
            grad[2] += y->w[b] * z->dw[c] * value;
        }
    }
    if (phi > field->reach)
        return false;
    *ret_phi = phi;
    for (int d = 0; d < 3; d++)
        ret_grad[d] = grad[d] / field->spacing;
    return true;
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
    struct stencil_axis axis[3];
    double phi, unused[3], sum[6] = {0, 0, 0, 0, 0, 0};
    if (!interpolate(field, x, &phi, unused) || !locate_cell(field, x, axis))
        return;
    size_t row = field->side[0], layer = row * field->side[1];
    for (int c = 0; c < 4; c++)
        for (int b = 0; b < 4; b++)
            for (int a = 0; a < 4; a++) {
                const struct stencil_axis *X = &axis[0], *Y = &axis[1], *Z = &axis[2];
                size_t block = field->table[Z->block[c] * layer + Y->block[b] * row + X->block[a]];
                size_t node = (Z->node[c] * DR_BLOCK + Y->node[b]) * DR_BLOCK + X->node[a];
                double value = field->value[block * DR_BLOCK_NODES + node];
                sum[0] += X->ddw[a] * Y->w[b] * Z->w[c] * value;
                sum[1] += X->dw[a] * Y->dw[b] * Z->w[c] * value;
                sum[2] += X->w[a] * Y->ddw[b] * Z->w[c] * value;
                sum[3] += X->dw[a] * Y->w[b] * Z->dw[c] * value;
                sum[4] += X->w[a] * Y->dw[b] * Z->dw[c] * value;
                sum[5] += X->w[a] * Y->w[b] * Z->ddw[c] * value;
            }
    for (int i = 0; i < 6; i++)
        ret[i] = sum[i] / (field->spacing * field->spacing);
}
