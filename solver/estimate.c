/* estimate.c - how many bytes a run will hold, told from sizes alone, before anything is built.
 *
 * Scene and state are held from beginning to end; sewing, moving, draping and certifying each add what only
 * they need, nearly all of it matrix and factor. George's nested dissection fills n log2 n entries on a mesh
 * of n nodes (SIAM J. Numer. Anal. 10, 1973); what matrix and factor take, by the orders that are used, has
 * been measured from 290 to 60 000 nodes. The rest is a sum of arrays, and of the bodies' fields, whose bytes
 * follow from area and volume. */
#include <math.h>

#include "body.h"
#include "carry.h"
#include "contact.h"
#include "field.h"
#include "scene.h"

/* Bytes of matrix and factor: c n log2(n)^power. Sewn cloth closes into tubes, which take wider cuts. */
struct fill {
    double c;
    int power;
};
static const struct fill open_hinges = {340, 1}; /* in single precision: of auto, and to sew */
static const struct fill sewn_hinges = {465, 1};
static const struct fill open_whole = {82, 2}; /* with all of bending, in double */
static const struct fill even_whole = {59, 2}; /* less where all triangles are alike */
static const struct fill even_sewn = {786, 1};
static const struct fill sewn_whole = {1317, 1};
#define LDL        1.22 /* times that: a simplicial factor stores its indices entry by entry */
#define NOT_WELDED 0.91 /* times sewn_hinges, a vertex: springs for seams join fewer than welding */

/* Bytes a triangle. */
#define MESH      135.0
#define BEND      335.0 /* 312 to 384: patches of 9 nodes and more */
#define EVEN_BEND 275.0 /* of 6 */
#define STRESS    24.0
#define FIT       72.0
#define COARSE    30.0  /* the way up from a coarse mesh */
#define NEAREST   100.0 /* of a body: the tree that its nearest points are found by */

#define COARSE_PART (1.0 / (DR_COARSER * DR_COARSER)) /* of the triangles */

/* Bytes a node. */
#define ARRAY    24.0 /* one vector */
#define WELDED   38.0 /* mass, start, what holds it */
#define FRICTION 104.0
#define SELF     750.0 /* 620 to 840: pairs that may touch, their tree, anchors */
#define TOUCHING 32.0  /* where bodies were looked at */
#define PIECE    60.0  /* of a vertex: positions, pattern, its node */

#define SIGHT 32.0  /* bytes a sample of the cloth and body */
#define GAP   136.0 /* and where auto's steps are corrected for gaps */
#define GAPS  0.5   /* of the samples have one */

/* A band of 7 cm around a person, over its thickness times the area: limbs are no thicker (by Steiner's
 * formula it is 1 + band / 2 radius for a cylinder). Measured on two bodies. */
#define LIMBS 1.35

static bool keeps_off_itself(const drape_scene_desc *desc, const drape_options *options)
{
    if (desc->self_contact == DRAPE_SELF_CONTACT_AUTO)
        return options->method != DRAPE_METHOD_NEWTON && (desc->seams || desc->bodies);
    return desc->self_contact == DRAPE_SELF_CONTACT_ON;
}

static bool is_explicit(const drape_options *options)
{
    return options->integrator == DRAPE_RK4 &&
           (options->method == DRAPE_METHOD_STOP_AND_GO || options->method == DRAPE_METHOD_DYNAMIC ||
            options->method == DRAPE_METHOD_VELOCITY_CORRECTION);
}

static double fill_bytes(struct fill fill, double nodes)
{
    return fill.c * nodes * pow(log2(nodes + 1), fill.power);
}

/* What is counted of the cloth. */
struct sizes {
    double vertices, nodes, triangles;
    double samples; /* for contact with bodies, nodes included */
    bool sewn, coarse, even, touching, self;
};

/* Cloth that has to be sewn is by any method, see drape_coarse. */
static bool begins_coarse(const drape_scene_desc *desc, const drape_options *options)
{
    bool suits = desc->seams || desc->coarse == DRAPE_COARSE_ON || options->method == DRAPE_METHOD_AUTO;
    return suits && !dr_scene_without_coarse(desc, desc->seams > 0);
}

static struct sizes count(const drape_scene_desc *desc, const drape_options *options)
{
    struct sizes n = {.vertices = (double)desc->vertices,
                      .triangles = (double)desc->triangles,
                      .sewn = desc->seams > 0,
                      .coarse = begins_coarse(desc, options),
                      .touching = desc->bodies > 0,
                      .self = keeps_off_itself(desc, options)};
    double least = INFINITY, most = 0;
    n.nodes = fmax(n.vertices - (double)desc->seams, n.vertices / 2);
    n.samples = n.nodes;
    for (size_t t = 0; t < desc->triangles; t++) {
        double rest[6];
        for (int k = 0; k < 6; k++)
            rest[k] = desc->pattern[2 * (size_t)desc->triangle[3 * t + (size_t)k / 2] + (size_t)k % 2];
        double area =
            fabs((rest[2] - rest[0]) * (rest[5] - rest[1]) - (rest[3] - rest[1]) * (rest[4] - rest[0]));
        least = fmin(least, area);
        most = fmax(most, area);
        n.samples += (double)dr_contact_points(rest);
    }
    n.even = most < 1.001 * least;
    return n;
}

/* All of bending, in double. */
static double whole_matrix(const struct sizes *n)
{
    if (n->sewn)
        return fill_bytes(n->even ? even_sewn : sewn_whole, n->nodes);
    return fill_bytes(n->even ? even_whole : open_whole, n->nodes);
}

static double draping_matrix(const struct sizes *n, const drape_options *options)
{
    if (is_explicit(options))
        return 0;
    if (options->method == DRAPE_METHOD_AUTO)
        return fill_bytes(n->sewn ? sewn_hinges : open_hinges, n->nodes);
    return whole_matrix(n) * (options->method == DRAPE_METHOD_NEWTON ? LDL : 1);
}

static double arrays_of(const drape_options *options)
{
    switch (options->method) {
    case DRAPE_METHOD_AUTO:
        return 4;
    case DRAPE_METHOD_QUASI_STATIC:
    case DRAPE_METHOD_NEWTON:
        return 0;
    default:
        return is_explicit(options) ? 5 : 3;
    }
}

static double contact_bytes(const struct sizes *n, double bodies)
{
    return bodies > 0 ? TOUCHING * n->nodes + SIGHT * bodies * n->samples : 0;
}

/* Twice the area and six times the volume of a closed mesh, and its box. */
static void measure(const drape_body *body, double *ret_area2, double *ret_volume6, double ret_size[3])
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    double area2 = 0, volume6 = 0;
    for (size_t t = 0; t < body->triangles; t++) {
        const double *a = body->positions + 3 * (size_t)body->triangle[3 * t];
        const double *b = body->positions + 3 * (size_t)body->triangle[3 * t + 1];
        const double *c = body->positions + 3 * (size_t)body->triangle[3 * t + 2];
        double u[3], v[3], n[3];
        for (int d = 0; d < 3; d++) {
            u[d] = b[d] - a[d];
            v[d] = c[d] - a[d];
            low[d] = fmin(low[d], fmin(a[d], fmin(b[d], c[d])));
            high[d] = fmax(high[d], fmax(a[d], fmax(b[d], c[d])));
        }
        n[0] = u[1] * v[2] - u[2] * v[1];
        n[1] = u[2] * v[0] - u[0] * v[2];
        n[2] = u[0] * v[1] - u[1] * v[0];
        area2 += sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        volume6 += a[0] * n[0] + a[1] * n[1] + a[2] * n[2];
    }
    *ret_area2 = area2;
    *ret_volume6 = fabs(volume6);
    for (int d = 0; d < 3; d++)
        ret_size[d] = high[d] - low[d];
}

/* Of the field at the finest spacing that keeps within its limits: see field.h. */
static double field_bytes(const drape_body *body)
{
    double area2, volume6, size[3], bytes = 0;
    measure(body, &area2, &volume6, size);
    for (double h = DR_FIELD_FINEST; h < 1.001 * DR_FIELD_COARSEST; h *= sqrt(2)) {
        double block = DR_BLOCK * h, margin = 2 * (DRAPE_REACH + 3.5 * h + block), table = 1;
        /* A block is there where any part of it is in the band, of which 3/4 of its edge stick out on
         * average. */
        double band = DRAPE_REACH + 3.5 * h + 0.75 * block;
        double blocks = (volume6 / 6 + LIMBS * 0.5 * area2 * band) / (block * block * block);
        for (int d = 0; d < 3; d++)
            table *= (size[d] + margin) / block + 1;
        blocks = fmin(blocks, table);
        bytes = blocks * (double)(DR_BLOCK_NODES * sizeof(float)) + table * sizeof(uint32_t);
        if (blocks <= DR_FIELD_MAX_BLOCKS && table <= DR_FIELD_MAX_TABLE)
            break;
    }
    return bytes;
}

/* One that moves has a field where it ends, and one where it starts if there is cloth to sew round it; on the
 * way its nearest points are looked up. */
static double body_bytes(const drape_body *body, bool sewn)
{
    double vertex = 3 * sizeof(double) * (double)body->vertices;
    if (body->kind != DRAPE_BODY_MESH)
        return 0;
    double one = body->field ? (double)drape_field_bytes(body->field) : field_bytes(body);
    if (!body->keyframes)
        return one + vertex;
    return (sewn ? 2 : 1) * one + ((double)body->keyframes + 4) * vertex + NEAREST * (double)body->triangles;
}

/* Scene and state: what is held from beginning to end. */
static double held_bytes(const struct sizes *n, const drape_scene_desc *desc, const drape_options *options)
{
    double mesh = MESH + (n->even ? EVEN_BEND : BEND);
    double bytes = PIECE * n->vertices + WELDED * n->nodes + mesh * n->triangles +
                   ((double)options->max_iterations + 1) * sizeof(drape_row);
    if (n->sewn)
        bytes += mesh * n->triangles;
    if (n->coarse)
        bytes += (COARSE + (n->sewn ? 2 : 1) * mesh * COARSE_PART) * n->triangles;
    if (options->fit)
        bytes += FIT * n->triangles;
    for (size_t b = 0; b < desc->bodies; b++)
        bytes += body_bytes(&desc->body[b], n->sewn);
    return bytes;
}

/* Of the coarse mesh, if there is one. */
static double sewing_bytes(const struct sizes *n, double bodies)
{
    double bytes = fill_bytes(sewn_hinges, n->vertices) * NOT_WELDED + 3 * ARRAY * n->vertices +
                   STRESS * n->triangles + contact_bytes(n, bodies);
    return n->sewn ? bytes * (n->coarse ? COARSE_PART : 1) : 0;
}

/* But for the matrix. */
static double draping_bytes(const struct sizes *n, const drape_scene_desc *desc, const drape_options *options)
{
    double bytes = (6 + arrays_of(options)) * ARRAY * n->nodes + contact_bytes(n, (double)desc->bodies);
    if (!is_explicit(options))
        bytes += STRESS * n->triangles;
    if (n->self)
        bytes += SELF * n->nodes;
    if (n->touching)
        bytes += FRICTION * n->nodes;
    if (n->touching && options->method == DRAPE_METHOD_AUTO)
        bytes += GAP * GAPS * n->samples;
    return bytes;
}

/* On top of the phase before it. */
static double certificate_bytes(const struct sizes *n, const drape_scene_desc *desc,
                                const drape_options *options)
{
    bool own = options->method != DRAPE_METHOD_NEWTON && !is_explicit(options);
    double bytes = ARRAY * n->nodes;
    if (options->method == DRAPE_METHOD_AUTO)
        return bytes + whole_matrix(n) - draping_matrix(n, options);
    return own ? bytes
               : bytes + ARRAY * n->nodes + STRESS * n->triangles + contact_bytes(n, (double)desc->bodies) +
                     whole_matrix(n);
}

static double moving_bytes(const struct sizes *n, const drape_scene_desc *desc)
{
    double bytes = 0;
    for (size_t b = 0; b < desc->bodies; b++)
        if (desc->body[b].keyframes)
            bytes = whole_matrix(n) + (16 + DR_CARRY_SCRATCH) * sizeof(double) * n->nodes +
                    (n->self ? SELF * n->nodes : 0) + contact_bytes(n, (double)desc->bodies);
    return bytes;
}

size_t drape_memory_estimate(const drape_scene_desc *desc, const drape_options *options)
{
    struct sizes n = count(desc, options);
    double draping = draping_matrix(&n, options) + draping_bytes(&n, desc, options), most = draping;
    most = fmax(most, sewing_bytes(&n, (double)desc->bodies));
    most = fmax(most, moving_bytes(&n, desc));
    if (options->certify)
        most = fmax(most, draping + certificate_bytes(&n, desc, options));
    return (size_t)(held_bytes(&n, desc, options) + most);
}
