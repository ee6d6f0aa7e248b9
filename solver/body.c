/* body.c - distances to spheres, planes and capsules by formula, to meshes by their field. */
#include "body.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "field.h"

/* Closer to a centre or an axis than this part of the radius, a direction is picked. */
#define AT_CENTRE 1e-12

struct dr_body {
    drape_body_kind kind;
    double offset, friction;
    double point[3], axis[3]; /* as in drape_body; a plane's normal has length 1 */
    double radius;
    struct dr_field *field;     /* mesh that stands; else NULL */
    struct dr_nearest *nearest; /* mesh that moves; else NULL */
    double *positions;          /* mesh: 3*vertices; else NULL */
    size_t vertices;
    size_t moves; /* dr_body_move's */
};

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* ---- made and freed -------------------------------------------------------------------------- */

static void unit_normal(double n[3])
{
    double largest = fmax(fabs(n[0]), fmax(fabs(n[1]), fabs(n[2])));
    for (int d = 0; d < 3; d++)
        n[d] /= largest; /* first to a size whose square neither overflows nor vanishes */
    double length = sqrt(dot(n, n));
    for (int d = 0; d < 3; d++)
        n[d] /= length;
}

static drape_status take_positions(struct dr_body *body, const drape_body *desc, drape_error *reterr)
{
    size_t bytes = 3 * desc->vertices * sizeof *body->positions; /* checked: below DRAPE_MAX_VERTICES */
    body->positions = malloc(bytes);
    if (!body->positions)
        return dr_out_of_memory(reterr);
    memcpy(body->positions, desc->positions, bytes);
    body->vertices = desc->vertices;
    return DRAPE_OK;
}

static drape_status take_mesh(struct dr_body *body, const drape_body *desc, int64_t number,
                              drape_error *reterr)
{
    drape_status status = take_positions(body, desc, reterr);
    if (status < 0)
        return status;
    if (desc->field) {
        body->field = dr_field_ref(desc->field);
        return DRAPE_OK;
    }
    return dr_field_new(desc->positions, desc->vertices, desc->triangle, desc->triangles, DR_BODY_REACH,
                        number, NULL, &body->field, reterr);
}

drape_status dr_body_new(const drape_body *desc, int64_t number, struct dr_body **ret, drape_error *reterr)
{
    drape_status status = dr_body_check(desc, number, reterr);
    if (status < 0)
        return status;
    struct dr_body *body = calloc(1, sizeof *body);
    if (!body)
        return dr_out_of_memory(reterr);
    body->kind = desc->kind;
    body->offset = desc->offset;
    body->friction = desc->friction;
    if (desc->kind == DRAPE_BODY_MESH) {
        status = take_mesh(body, desc, number, reterr);
    } else {
        body->radius = desc->radius;
        memcpy(body->point, desc->point, sizeof body->point);
        memcpy(body->axis, desc->axis, sizeof body->axis);
        if (desc->kind == DRAPE_BODY_PLANE)
            unit_normal(body->axis);
    }
    if (status < 0)
        dr_body_free(body);
    else
        *ret = body;
    return status;
}

drape_status dr_body_new_moving(const drape_body *desc, struct dr_body **ret, drape_error *reterr)
{
    struct dr_body *body = calloc(1, sizeof *body);
    if (!body)
        return dr_out_of_memory(reterr);
    body->kind = DRAPE_BODY_MESH;
    body->offset = desc->offset;
    body->friction = desc->friction;
    drape_status status = take_positions(body, desc, reterr);
    if (status >= 0)
        status = dr_nearest_new(body->positions, desc->vertices, desc->triangle, desc->triangles,
                                &body->nearest, reterr);
    if (status < 0)
        dr_body_free(body);
    else
        *ret = body;
    return status;
}

void dr_body_move(struct dr_body *body, const double *positions)
{
    memcpy(body->positions, positions, 3 * body->vertices * sizeof *positions);
    dr_nearest_move(body->nearest);
    body->moves++;
}

size_t dr_body_moves(const struct dr_body *body)
{
    return body->moves;
}

void dr_body_nearest(const struct dr_body *body, const double x[3], struct dr_place *ret)
{
    dr_nearest_find(body->nearest, x, INFINITY, ret);
}

const double *dr_body_positions(const struct dr_body *body)
{
    return body->positions;
}

struct dr_body *dr_body_free(struct dr_body *body)
{
    if (body) {
        dr_field_unref(body->field);
        dr_nearest_free(body->nearest);
        free(body->positions);
        free(body);
    }
    return NULL;
}

drape_status drape_field_new(const drape_body *body, size_t number, drape_processors *processors,
                             drape_field **ret, drape_error *reterr)
{
    struct dr_hand hand = {.processors = processors};
    drape_status status = dr_body_check_mesh(body, (int64_t)number, reterr);
    if (status < 0)
        return status;
    if (processors)
        dr_processors_enter(processors);
    status = dr_field_new(body->positions, body->vertices, body->triangle, body->triangles, DR_BODY_REACH,
                          (int64_t)number, &hand, ret, reterr);
    if (processors)
        dr_processors_leave(processors);
    return status;
}

drape_field *drape_field_ref(drape_field *field)
{
    return dr_field_ref(field);
}

drape_field *drape_field_unref(drape_field *field)
{
    return dr_field_unref(field);
}

size_t drape_field_bytes(const drape_field *field)
{
    return dr_field_bytes(field);
}

drape_field *dr_body_field(const struct dr_body *body)
{
    return body->field;
}

double dr_body_offset(const struct dr_body *body)
{
    return body->offset;
}

double dr_body_friction(const struct dr_body *body)
{
    return body->friction;
}

size_t dr_body_bytes(const struct dr_body *body)
{
    size_t bytes = sizeof *body + 3 * body->vertices * sizeof *body->positions;
    if (body->nearest)
        bytes += dr_nearest_bytes(body->nearest);
    return body->field ? bytes + dr_field_bytes(body->field) : bytes;
}

/* ---- distances ------------------------------------------------------------------------------- */

/* A unit vector perpendicular to a; y for a = 0. */
static void perpendicular(const double a[3], double ret[3])
{
    int least = 0;
    for (int d = 1; d < 3; d++)
        if (fabs(a[d]) < fabs(a[least]))
            least = d;
    int next = (least + 1) % 3, after = (least + 2) % 3;
    double length = hypot(a[next], a[after]); /* e_least x a has these two components */
    ret[least] = 0;
    ret[next] = length > 0 ? -a[after] / length : 1;
    ret[after] = length > 0 ? a[next] / length : 0;
}

/* From the nearest point c of a segment along `axis` (zero: a point), inflated by the radius. */
static bool round_distance(const double x[3], const double c[3], const double axis[3], double radius,
                           double *ret_phi, double ret_grad[3])
{
    double r[3] = {x[0] - c[0], x[1] - c[1], x[2] - c[2]};
    double length = sqrt(dot(r, r));
    if (!(length - radius <= DR_BODY_REACH)) /* a NaN fails, too */
        return false;
    *ret_phi = length - radius;
    if (length <= AT_CENTRE * radius) {
        perpendicular(axis, ret_grad);
        return true;
    }
    for (int d = 0; d < 3; d++)
        ret_grad[d] = r[d] / length;
    return true;
}

static bool sphere_distance(const struct dr_body *body, const double x[3], double *ret_phi,
                            double ret_grad[3])
{
    static const double no_axis[3] = {0, 0, 0};
    return round_distance(x, body->point, no_axis, body->radius, ret_phi, ret_grad);
}

static bool capsule_distance(const struct dr_body *body, const double x[3], double *ret_phi,
                             double ret_grad[3])
{
    double axis[3], r[3], c[3];
    for (int d = 0; d < 3; d++) {
        axis[d] = body->axis[d] - body->point[d];
        r[d] = x[d] - body->point[d];
    }
    double square = dot(axis, axis);
    double t = square > 0 ? fmin(fmax(dot(axis, r) / square, 0), 1) : 0;
    for (int d = 0; d < 3; d++)
        c[d] = body->point[d] + t * axis[d];
    return round_distance(x, c, axis, body->radius, ret_phi, ret_grad);
}

static bool plane_distance(const struct dr_body *body, const double x[3], double *ret_phi, double ret_grad[3])
{
    double r[3] = {x[0] - body->point[0], x[1] - body->point[1], x[2] - body->point[2]};
    double phi = dot(body->axis, r);
    if (!(phi <= DR_BODY_REACH && phi > -INFINITY)) /* a NaN fails, too */
        return false;
    *ret_phi = phi;
    memcpy(ret_grad, body->axis, sizeof body->axis);
    return true;
}

bool dr_body_distance(const struct dr_body *body, const double x[3], double *ret_phi, double ret_grad[3])
{
    switch (body->kind) {
    case DRAPE_BODY_MESH:
        return body->field ? dr_field_distance(body->field, x, ret_phi, ret_grad)
                           : dr_nearest_distance(body->nearest, x, DR_BODY_REACH, ret_phi, ret_grad);
    case DRAPE_BODY_SPHERE:
        return sphere_distance(body, x, ret_phi, ret_grad);
    case DRAPE_BODY_PLANE:
        return plane_distance(body, x, ret_phi, ret_grad);
    case DRAPE_BODY_CAPSULE:
        return capsule_distance(body, x, ret_phi, ret_grad);
    }
    return false;
}

/* ---- curvature ------------------------------------------------------------------------------- */

/* (I - n n' - a a')/r, the curvature of a tube's or (a = 0) a ball's distance at r from its axis or centre.
 */
static void round_curvature(const double n[3], const double a[3], double r, double ret[6])
{
    for (int i = 0, entry = 0; i < 3; i++)
        for (int j = 0; j <= i; j++)
            ret[entry++] = ((i == j) - n[i] * n[j] - a[i] * a[j]) / r;
}

static void capsule_curvature(const struct dr_body *body, const double x[3], const double n[3], double r,
                              double ret[6])
{
    double axis[3], from[3];
    for (int d = 0; d < 3; d++) {
        axis[d] = body->axis[d] - body->point[d];
        from[d] = x[d] - body->point[d];
    }
    double square = dot(axis, axis), along = dot(axis, from);
    bool beside = along > 0 && along < square; /* else a cap */
    for (int d = 0; d < 3; d++)
        axis[d] *= beside ? 1 / sqrt(square) : 0;
    round_curvature(n, axis, r, ret);
}

void dr_body_curvature(const struct dr_body *body, const double x[3], double ret[6])
{
    static const double no_axis[3] = {0, 0, 0};
    double phi, n[3];
    memset(ret, 0, 6 * sizeof *ret);
    if (body->kind == DRAPE_BODY_PLANE)
        return;
    if (body->kind == DRAPE_BODY_MESH) {
        if (body->field)
            dr_field_curvature(body->field, x, ret);
        return;
    }
    if (!dr_body_distance(body, x, &phi, n) || phi + body->radius <= AT_CENTRE * body->radius)
        return;
    if (body->kind == DRAPE_BODY_SPHERE)
        round_curvature(n, no_axis, phi + body->radius, ret);
    else
        capsule_curvature(body, x, n, phi + body->radius, ret);
}

/* ---- support --------------------------------------------------------------------------------- */

static double plane_support_min(const struct dr_body *body, const double d[3])
{
    double length = sqrt(dot(d, d)), square = 0;
    for (int k = 0; k < 3; k++) {
        double off = d[k] + length * body->axis[k];
        square += off * off;
    }
    return sqrt(square) <= 1e-12 * length ? dot(d, body->point) : -INFINITY;
}

double dr_body_support_min(const struct dr_body *body, const double d[3])
{
    double least = INFINITY;
    switch (body->kind) {
    case DRAPE_BODY_MESH:
        for (size_t v = 0; v < body->vertices; v++)
            least = fmin(least, dot(d, body->positions + 3 * v));
        return least;
    case DRAPE_BODY_SPHERE:
        return dot(d, body->point) - body->radius * sqrt(dot(d, d));
    case DRAPE_BODY_PLANE:
        return plane_support_min(body, d);
    case DRAPE_BODY_CAPSULE:
        return fmin(dot(d, body->point), dot(d, body->axis)) - body->radius * sqrt(dot(d, d));
    }
    return -INFINITY;
}
