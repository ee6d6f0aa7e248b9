/* elastic.c - see elastic.h. */
#include "elastic.h"

#include <math.h>
#include <stdlib.h>

#include "error.h"

/* A bar shorter than this part of its rest length has lost its direction: it then holds on to no turn. */
#define SHORTEST 1e-6

struct dr_elastic {
    const struct dr_bar *bar;
    size_t bars, first_link;
    double *tension; /* bars: N; NULL without a matrix */
};

drape_status dr_elastic_new(const struct dr_bar *bar, size_t bars, size_t first_link, bool matrix,
                            struct dr_elastic **ret, drape_error *reterr)
{
    struct dr_elastic *elastic = calloc(1, sizeof *elastic);
    if (!elastic)
        return dr_out_of_memory(reterr);
    *elastic = (struct dr_elastic){.bar = bar, .bars = bars, .first_link = first_link};
    if (matrix && !(elastic->tension = calloc(bars, sizeof *elastic->tension))) {
        dr_elastic_free(elastic);
        return dr_out_of_memory(reterr);
    }
    *ret = elastic;
    return DRAPE_OK;
}

struct dr_elastic *dr_elastic_free(struct dr_elastic *elastic)
{
    if (elastic) {
        free(elastic->tension);
        free(elastic);
    }
    return NULL;
}

size_t dr_elastic_bytes(const struct dr_elastic *elastic)
{
    return sizeof *elastic + (elastic->tension ? elastic->bars * sizeof *elastic->tension : 0);
}

/* The difference of the bar's ends in the field x; returns its length. */
static double span(const struct dr_bar *bar, const double *x, double d[3])
{
    const double *a = x + 3 * (size_t)bar->node[0], *b = x + 3 * (size_t)bar->node[1];
    double square = 0;
    for (int k = 0; k < 3; k++) {
        d[k] = b[k] - a[k];
        square += d[k] * d[k];
    }
    return sqrt(square);
}

/* The length of the bar at x, and the unit vector along it, zero where it has none. */
static double direction(const struct dr_bar *bar, const double *x, double d[3])
{
    double l = span(bar, x, d), scale = l > SHORTEST * bar->rest ? 1 / l : 0;
    for (int k = 0; k < 3; k++)
        d[k] *= scale;
    return l;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

double dr_elastic_energy(const struct dr_elastic *elastic, const double *x, double *g)
{
    long double sum = 0;
    for (size_t i = 0; i < elastic->bars; i++) {
        const struct dr_bar *bar = elastic->bar + i;
        double d[3], strain = (direction(bar, x, d) - bar->rest) / bar->rest;
        sum += 0.5 * bar->stiffness * bar->rest * strain * strain;
        for (size_t k = 0; g && k < 3; k++) {
            double pull = bar->stiffness * strain * d[k];
            g[3 * (size_t)bar->node[0] + k] -= pull;
            g[3 * (size_t)bar->node[1] + k] += pull;
        }
    }
    return (double)sum;
}

void dr_elastic_tension(struct dr_elastic *elastic, const double *x, const double *w)
{
    for (size_t i = 0; i < elastic->bars; i++) {
        const struct dr_bar *bar = elastic->bar + i;
        double d[3], step[3], longer = direction(bar, x, d) - bar->rest;
        if (w) {
            span(bar, w, step);
            longer += dot(d, step);
        }
        elastic->tension[i] = bar->stiffness * longer / bar->rest;
    }
}

/* T/l of bar i at length l, N/m, of which the compressive part counts `compression` times. */
static double across(const struct dr_elastic *elastic, size_t i, double l, double compression)
{
    double T = elastic->tension[i];
    return (T < 0 ? compression * T : T) / fmax(l, SHORTEST * elastic->bar[i].rest);
}

void dr_elastic_hessian(const struct dr_elastic *elastic, const double *x, double compression,
                        struct dr_matrix *A)
{
    for (size_t i = 0; i < elastic->bars; i++) {
        const struct dr_bar *bar = elastic->bar + i;
        double d[3], H[6], minus[9], l = direction(bar, x, d);
        double along = bar->stiffness / bar->rest, turn = across(elastic, i, l, compression);
        for (int r = 0, entry = 0; r < 3; r++)
            for (int c = 0; c <= r; c++, entry++) {
                H[entry] = (along - turn) * d[r] * d[c] + (r == c ? turn : 0);
                minus[3 * r + c] = minus[3 * c + r] = -H[entry];
            }
        dr_matrix_add_node(A, bar->node[0], H);
        dr_matrix_add_node(A, bar->node[1], H);
        dr_matrix_add_pair(A, elastic->first_link + i, minus);
    }
}

void dr_elastic_left_out(const struct dr_elastic *elastic, const double *x, const double *p, double *q)
{
    for (size_t i = 0; i < elastic->bars; i++) {
        const struct dr_bar *bar = elastic->bar + i;
        double d[3], step[3], l = direction(bar, x, d);
        if (!(elastic->tension[i] < 0))
            continue;
        double turn = across(elastic, i, l, 1);
        span(bar, p, step);
        double part = dot(d, step);
        for (size_t k = 0; k < 3; k++) {
            double pull = turn * (step[k] - part * d[k]);
            q[3 * (size_t)bar->node[0] + k] -= pull;
            q[3 * (size_t)bar->node[1] + k] += pull;
        }
    }
}

/* A step s turns the bar by |s - (d.s)d|/l, which makes it longer by the square of that times l/2. */
double dr_elastic_second_order(const struct dr_elastic *elastic, const double *x, const double *w)
{
    long double sum = 0;
    for (size_t i = 0; i < elastic->bars; i++) {
        const struct dr_bar *bar = elastic->bar + i;
        double d[3], step[3], l = direction(bar, x, d), length = span(bar, w, step), part = dot(d, step);
        double strain = 0.5 * (length - part) * (length + part) / (fmax(l, SHORTEST * bar->rest) * bar->rest);
        sum += 0.5 * bar->stiffness * bar->rest * strain * strain;
    }
    return (double)sum;
}
