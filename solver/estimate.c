/* estimate.c - how many bytes a run will hold, told from sizes alone, before anything is built.
 *
 * Nearly all of it is the factor of the step matrix. George's nested dissection fills n log2 n entries on a
 * mesh of n nodes (SIAM J. Numer. Anal. 10, 1973); the orders that are used fill more, and
 * measured from 500 to 60 000 nodes matrix and factor take c n log2(n)^2 bytes, with c as below. The rest is
 * a sum of arrays, measured per vertex and triangle, and of the bodies' fields, whose bytes follow from area
 * and volume. */
#include <math.h>

#include "body.h"
#include "field.h"

/* Bytes, of matrix and factor over n log2(n)^2: open cloth has 71 (squares) to 87 (skirts); cloth that is
 * sewn closes into tubes, which take wider cuts: 105 to 162. */
#define OPEN_FACTOR 79.0
#define SEWN_FACTOR 115.0
#define HINGES      0.65 /* times that: `auto` has hinges for bending, until it is to be certified */
#define LDL_FACTOR  1.23 /* times that: a simplicial factor stores its indices entry by entry */

#define BYTES_PER_VERTEX     380.0 /* state, trial states, weights, velocities or conjugate gradients */
#define BYTES_PER_TRIANGLE   500.0 /* stretch, bending, geometric stiffness */
#define SELF_PER_VERTEX      925.0 /* pairs that may touch, their tree, anchors */
#define PIECES_PER_TRIANGLE  420.0 /* of the pieces as they were cut: stretch and bending again */
#define FIT_PER_TRIANGLE     72.0
#define TOUCHING_PER_VERTEX  560.0 /* anchors and distances of cloth by bodies */
#define COARSE_PER_TRIANGLE  145.0 /* the coarse mesh and the way up */
#define NEAREST_PER_TRIANGLE 100.0 /* of a body: the tree that its nearest points are found by */

/* A band of 7 cm around a person, over its thickness times the area: limbs are no thicker (by Steiner's
 * formula it is 1 + band / 2 radius for a cylinder). Measured on two bodies. */
#define LIMBS 1.35

static double square(double x)
{
    return x * x;
}

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

static bool has_coarse_mesh(const drape_scene_desc *desc)
{
    for (size_t b = 0; b < desc->bodies; b++)
        if (desc->body[b].keyframes)
            return false;
    return desc->coarse == DRAPE_COARSE_ON && !desc->start_pattern;
}

static double matrix_bytes(const drape_scene_desc *desc, const drape_options *options)
{
    double n = (double)desc->vertices, factor = desc->seams ? SEWN_FACTOR : OPEN_FACTOR;
    if (is_explicit(options) && !desc->seams) /* sewing has a matrix anyway */
        return 0;
    if (options->method == DRAPE_METHOD_NEWTON)
        factor *= LDL_FACTOR;
    if (options->method == DRAPE_METHOD_AUTO && !options->certify)
        factor *= HINGES;
    return factor * n * square(log2(n + 1));
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

/* One that moves has a field where it starts, one for each posture on the way, and one where it ends; three
 * are held at a time. */
static double body_bytes(const drape_body *body)
{
    double vertex = 3 * sizeof(double) * (double)body->vertices;
    if (body->kind != DRAPE_BODY_MESH)
        return 0;
    double one = body->field ? (double)drape_field_bytes(body->field) : field_bytes(body);
    if (!body->keyframes)
        return one + vertex;
    return 2 * one + ((double)body->keyframes + 4) * vertex + NEAREST_PER_TRIANGLE * (double)body->triangles;
}

size_t drape_memory_estimate(const drape_scene_desc *desc, const drape_options *options)
{
    double vertices = (double)desc->vertices, triangles = (double)desc->triangles;
    double bytes = BYTES_PER_VERTEX * vertices + BYTES_PER_TRIANGLE * triangles +
                   matrix_bytes(desc, options) + ((double)options->max_iterations + 1) * sizeof(drape_row);
    if (keeps_off_itself(desc, options))
        bytes += SELF_PER_VERTEX * vertices;
    if (desc->seams)
        bytes += PIECES_PER_TRIANGLE * triangles;
    if (has_coarse_mesh(desc)) /* a quarter of the triangles */
        bytes += (COARSE_PER_TRIANGLE + (desc->seams ? PIECES_PER_TRIANGLE / 4 : 0)) * triangles;
    if (desc->bodies)
        bytes += TOUCHING_PER_VERTEX * vertices;
    if (options->fit)
        bytes += FIT_PER_TRIANGLE * triangles;
    for (size_t b = 0; b < desc->bodies; b++)
        bytes += body_bytes(&desc->body[b]);
    return (size_t)bytes;
}
