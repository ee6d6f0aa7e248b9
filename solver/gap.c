/* gap.c - see gap.h. */
#include "gap.h"

#include <stdlib.h>

#include "error.h"

struct gap {
    uint32_t node[3]; /* a centroid's corners; a node's own number thrice */
    double n[3];      /* gradient of the distance */
    double depth, offset, stiffness;
    struct dr_penalty first; /* without a step */
    double change;           /* of the curvature by the present step, N/m */
};

struct dr_gaps {
    const struct dr_contact *contact;
    struct gap *gap;
    size_t count, room;
};

drape_status dr_gaps_new(const struct dr_contact *contact, struct dr_gaps **ret, drape_error *reterr)
{
    struct dr_gaps *gaps = calloc(1, sizeof *gaps);
    if (gaps) {
        gaps->contact = contact;
        gaps->room = dr_contact_samples(contact);
        gaps->gap = malloc(gaps->room * sizeof *gaps->gap);
    }
    if (!gaps || !gaps->gap) {
        dr_gaps_free(gaps);
        return dr_out_of_memory(reterr);
    }
    *ret = gaps;
    return DRAPE_OK;
}

struct dr_gaps *dr_gaps_free(struct dr_gaps *gaps)
{
    if (gaps) {
        free(gaps->gap);
        free(gaps);
    }
    return NULL;
}

size_t dr_gaps_bytes(const struct dr_gaps *gaps)
{
    return sizeof *gaps + gaps->room * sizeof *gaps->gap;
}

static void take(const struct dr_sample *sample, void *data)
{
    struct dr_gaps *gaps = data;
    struct gap *gap = gaps->gap + gaps->count++;
    *gap = (struct gap){
        .depth = sample->offset - sample->phi, .offset = sample->offset, .stiffness = sample->stiffness};
    for (int k = 0; k < 3; k++) {
        gap->node[k] = sample->node[k];
        gap->n[k] = sample->n[k];
    }
    gap->first = dr_penalty(gap->stiffness, gap->offset, gap->depth);
}

void dr_gaps_take(struct dr_gaps *gaps, const double *x)
{
    gaps->count = 0;
    dr_contact_each(gaps->contact, x, take, gaps);
}

/* n.w at the sample, which moves with the mean of its three nodes. */
static double along(const struct gap *gap, const double *w)
{
    double sum = 0;
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++)
            sum += gap->n[d] * w[3 * (size_t)gap->node[k] + (size_t)d];
    return sum / 3;
}

static void push(const struct gap *gap, double force, double *y)
{
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++)
            y[3 * (size_t)gap->node[k] + (size_t)d] += force * gap->n[d] / 3;
}

double dr_gaps_surplus(struct dr_gaps *gaps, const double *w, double *g)
{
    double sum = 0;
    for (size_t i = 0; i < gaps->count; i++) {
        struct gap *gap = gaps->gap + i;
        const struct dr_penalty *at = &gap->first;
        double t = along(gap, w);
        struct dr_penalty psi = dr_penalty(gap->stiffness, gap->offset, gap->depth - t);
        sum += psi.energy - at->energy + at->force * t - 0.5 * at->curvature * t * t;
        push(gap, -psi.force + at->force - at->curvature * t, g);
        gap->change = psi.curvature - at->curvature;
    }
    return sum;
}

void dr_gaps_add_product(const struct dr_gaps *gaps, const double *p, double *y)
{
    for (size_t i = 0; i < gaps->count; i++)
        if (gaps->gap[i].change != 0)
            push(gaps->gap + i, gaps->gap[i].change * along(gaps->gap + i, p), y);
}
