/* gap.c - see gap.h. */
#include "gap.h"

#include <stdlib.h>
#include <string.h>

#include "error.h"

struct gap {
    unsigned corners; /* how many nodes move it: a body's sample by 3, a pair of the cloth's own parts by 4 */
    uint32_t node[4];
    double weight[4]; /* of their moves along n */
    double n[3];      /* gradient of the distance, that is, in the weighted move */
    double depth, offset, stiffness;
    struct dr_penalty first; /* without a step */
    double change;           /* of the curvature by the present step, N/m */
};

struct dr_gaps {
    struct dr_contact *contact; /* NULL: no bodies */
    struct dr_self *self;       /* NULL: the cloth's own parts are left out */
    struct gap *gap;
    size_t count, room;
    bool out_of_memory;
};

drape_status dr_gaps_new(struct dr_contact *contact, struct dr_self *self, struct dr_gaps **ret,
                         drape_error *reterr)
{
    struct dr_gaps *gaps = calloc(1, sizeof *gaps);
    if (!gaps)
        return dr_out_of_memory(reterr);
    gaps->contact = contact;
    gaps->self = self;
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

/* Room for one more; NULL: none. */
static struct gap *append(struct dr_gaps *gaps)
{
    if (gaps->count == gaps->room) {
        size_t room = gaps->room + gaps->room / 2 + 1024;
        struct gap *gap = realloc(gaps->gap, room * sizeof *gap);
        if (!gap) {
            gaps->out_of_memory = true;
            return NULL;
        }
        gaps->gap = gap;
        gaps->room = room;
    }
    return gaps->gap + gaps->count++;
}

static void take(const struct dr_sample *sample, void *data)
{
    struct gap *gap = append(data);
    if (!gap)
        return;
    *gap = (struct gap){.corners = 3,
                        .depth = sample->offset - sample->phi,
                        .offset = sample->offset,
                        .stiffness = sample->stiffness};
    for (int k = 0; k < 3; k++) {
        gap->node[k] = sample->node[k];
        gap->weight[k] = sample->share[k];
        gap->n[k] = sample->n[k];
    }
    gap->first = dr_penalty(gap->stiffness, gap->offset, gap->depth);
}

static void take_self(const struct dr_self_gap *from, void *data)
{
    struct gap *gap = append(data);
    if (!gap)
        return;
    *gap = (struct gap){.corners = 4,
                        .depth = from->offset - from->distance,
                        .offset = from->offset,
                        .stiffness = from->stiffness};
    memcpy(gap->node, from->node, sizeof gap->node);
    memcpy(gap->weight, from->weight, sizeof gap->weight);
    memcpy(gap->n, from->n, sizeof gap->n);
    gap->first = dr_penalty(gap->stiffness, gap->offset, gap->depth);
}

drape_status dr_gaps_take(struct dr_gaps *gaps, const double *x, drape_error *reterr)
{
    gaps->count = 0;
    gaps->out_of_memory = false;
    if (gaps->contact)
        dr_contact_each(gaps->contact, x, take, gaps);
    if (gaps->self)
        dr_self_each(gaps->self, x, take_self, gaps);
    return gaps->out_of_memory ? dr_out_of_memory(reterr) : DRAPE_OK;
}

/* n times the weighted move. */
static double along(const struct gap *gap, const double *w)
{
    double sum = 0;
    for (unsigned k = 0; k < gap->corners; k++) {
        const double *move = w + 3 * (size_t)gap->node[k];
        sum += gap->weight[k] * (gap->n[0] * move[0] + gap->n[1] * move[1] + gap->n[2] * move[2]);
    }
    return sum;
}

static void push(const struct gap *gap, double force, double *y)
{
    for (unsigned k = 0; k < gap->corners; k++)
        for (size_t d = 0; d < 3; d++)
            y[3 * (size_t)gap->node[k] + d] += force * gap->weight[k] * gap->n[d];
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
