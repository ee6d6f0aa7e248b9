/* carry.c - rigid motions of body triangles, blended over the cloth. */
#include "carry.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "body.h"
#include "error.h"
#include "mesh.h"

#define SMOOTH_BESIDE 0.01 /* m: over what length motions are evened out where the cloth lies on the body */
#define SMOOTH_OUT    0.5  /* and what each metre from the body adds */
#define PASSES        64   /* of Jacobi: what they reach is 8 edges */

/* ---- quaternions ----------------------------------------------------------------------------- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double ret[3])
{
    for (int d = 0; d < 3; d++)
        ret[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

static double square(const double q[4])
{
    return q[0] * q[0] + dot(q + 1, q + 1);
}

/* v + 2 q x (q x v + w v) / |q|^2 */
static void turn(const double q[4], double v[3])
{
    double once[3], twice[3];
    cross(q + 1, v, once);
    for (int d = 0; d < 3; d++)
        once[d] += q[0] * v[d];
    cross(q + 1, once, twice);
    for (int d = 0; d < 3; d++)
        v[d] += 2 * twice[d] / square(q);
}

/* The quaternion of a rotation matrix (Shepperd, J. Guidance and Control 1, 1978): the largest component
 * first, as the others are divided by it. */
static void quaternion_of(const double R[3][3], double ret[4])
{
    double trace = R[0][0] + R[1][1] + R[2][2], most = trace;
    int largest = -1;
    for (int d = 0; d < 3; d++)
        if (R[d][d] > most) {
            most = R[d][d];
            largest = d;
        }
    if (largest < 0) {
        ret[0] = 1 + trace;
        for (int d = 0; d < 3; d++)
            ret[1 + d] = R[(d + 2) % 3][(d + 1) % 3] - R[(d + 1) % 3][(d + 2) % 3];
    } else {
        int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
        ret[0] = R[k][j] - R[j][k];
        ret[1 + i] = 1 + R[i][i] - R[j][j] - R[k][k];
        ret[1 + j] = R[j][i] + R[i][j];
        ret[1 + k] = R[k][i] + R[i][k];
    }
    double length = sqrt(square(ret));
    for (int d = 0; d < 4; d++)
        ret[d] /= length;
}

/* ---- the motion of a triangle ---------------------------------------------------------------- */

/* A triangle's unit axes (along its first side, across it in the plane, normal) and its two sides from the
 * first corner in the first two of them. False without area. */
struct frame {
    double axis[3][3];
    double side[2][2];
};

static bool find_frame(const uint32_t corner[3], const double *x, struct frame *ret)
{
    double side[2][3], *u = ret->axis[0], *v = ret->axis[1], *n = ret->axis[2];
    for (int k = 0; k < 2; k++)
        for (int d = 0; d < 3; d++)
            side[k][d] = x[3 * (size_t)corner[k + 1] + (size_t)d] - x[3 * (size_t)corner[0] + (size_t)d];
    cross(side[0], side[1], n);
    double length = sqrt(dot(side[0], side[0])), area = sqrt(dot(n, n));
    if (!(area > 1e-9 * (dot(side[0], side[0]) + dot(side[1], side[1])))) /* its direction is round-off */
        return false;
    for (int d = 0; d < 3; d++) {
        u[d] = side[0][d] / length;
        n[d] /= area;
    }
    cross(n, u, v);
    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 2; a++)
            ret->side[k][a] = dot(side[k], ret->axis[a]);
    return true;
}

/* How far the deformation F of the plane turns it: the rotation of F's polar decomposition. F takes the old
 * sides to the new ones; its entries all times the old sides' determinant, which is positive. */
static double turn_in_plane(const struct frame *old, const struct frame *new)
{
    const double(*a)[2] = old->side, (*b)[2] = new->side;
    double xx = b[0][0] * a[1][1] - b[1][0] * a[0][1], xy = b[1][0] * a[0][0] - b[0][0] * a[1][0];
    double yx = b[0][1] * a[1][1] - b[1][1] * a[0][1], yy = b[1][1] * a[0][0] - b[0][1] * a[1][0];
    return atan2(yx - xy, xx + yy);
}

static void find_turn(const uint32_t corner[3], const double *from, const double *to, double ret[4])
{
    struct frame old = {0}, new = {0};
    double turned[2][3], R[3][3];
    ret[0] = 1;
    ret[1] = ret[2] = ret[3] = 0;
    if (!find_frame(corner, from, &old) || !find_frame(corner, to, &new))
        return;
    double angle = turn_in_plane(&old, &new), c = cos(angle), s = sin(angle);
    for (int d = 0; d < 3; d++) {
        turned[0][d] = c * new.axis[0][d] + s *new.axis[1][d];
        turned[1][d] = c * new.axis[1][d] - s *new.axis[0][d];
    }
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            R[i][j] = turned[0][i] * old.axis[0][j] + turned[1][i] * old.axis[1][j] +
                      new.axis[2][i] * old.axis[2][j];
    quaternion_of(R, ret);
}

struct dr_motor dr_motor_at(const struct dr_place *place, const uint32_t *triangle, const double *from,
                            const double *to, const double centre[3])
{
    const uint32_t *corner = triangle + 3 * (size_t)place->triangle;
    struct dr_motor motor = {{1, 0, 0, 0}, {0, 0, 0, 0}};
    double old[3] = {0, 0, 0}, new[3] = {0, 0, 0}, t[3], across[3];
    bool moved = false;
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++) {
            size_t i = 3 * (size_t)corner[k] + (size_t)d;
            moved = moved || from[i] != to[i];
            old[d] += place->weight[k] * (from[i] - centre[d]);
            new[d] += place->weight[k] * (to[i] - centre[d]);
        }
    if (!moved)
        return motor;
    find_turn(corner, from, to, motor.real);
    turn(motor.real, old);
    for (int d = 0; d < 3; d++)
        t[d] = new[d] - old[d];
    /* (0, t) r / 2 */
    motor.dual[0] = -0.5 * dot(t, motor.real + 1);
    cross(t, motor.real + 1, across);
    for (int d = 0; d < 3; d++)
        motor.dual[1 + d] = 0.5 * (motor.real[0] * t[d] + across[d]);
    return motor;
}

void dr_motor_move(const struct dr_motor *motor, const double centre[3], double x[3])
{
    /* t = 2 dual conj(real) / |real|^2, its vector part */
    const double *r = motor->real, *e = motor->dual;
    double across[3], arm[3];
    cross(r + 1, e + 1, across);
    for (int d = 0; d < 3; d++)
        arm[d] = x[d] - centre[d];
    double turned[3] = {arm[0], arm[1], arm[2]};
    turn(r, turned);
    for (int d = 0; d < 3; d++)
        x[d] += turned[d] - arm[d] + 2 * (r[0] * e[1 + d] - e[0] * r[1 + d] + across[d]) / square(r);
}

void dr_motor_turn(const struct dr_motor *motor, double v[3])
{
    turn(motor->real, v);
}

/* ---- smoothed over the cloth ----------------------------------------------------------------- */

static void add(struct dr_motor *to, double weight, const struct dr_motor *motor)
{
    for (int d = 0; d < 4; d++) {
        to->real[d] += weight * motor->real[d];
        to->dual[d] += weight * motor->dual[d];
    }
}

/* A motor and its negative are the same motion: gives all of them the sign that agrees with most. */
static void align(struct dr_motor *motor, size_t points)
{
    struct dr_motor sum = {{0, 0, 0, 0}, {0, 0, 0, 0}};
    for (size_t i = 0; i < points; i++) {
        double agree = sum.real[0] * motor[i].real[0] + dot(sum.real + 1, motor[i].real + 1);
        struct dr_motor own = motor[i];
        if (agree < 0) {
            memset(motor + i, 0, sizeof *motor);
            add(motor + i, -1, &own);
        }
        add(&sum, 1, motor + i);
    }
}

/* What holds each point to its own motion (n_i (edge/length)^2, with the mean square of its edges) and the
 * number n_i of its neighbours, those across an inner edge counted twice. */
static void find_weights(const double *x, size_t points, const uint32_t *triangle, size_t triangles,
                         const double *distance, double *own, double *neighbors)
{
    memset(own, 0, points * sizeof *own);
    memset(neighbors, 0, points * sizeof *neighbors);
    for (size_t t = 0; t < triangles; t++)
        for (size_t k = 0; k < 3; k++) {
            uint32_t a = triangle[3 * t + k], b = triangle[3 * t + (k + 1) % 3];
            double edge = 0;
            for (size_t d = 0; d < 3; d++) {
                double gap = x[3 * (size_t)a + d] - x[3 * (size_t)b + d];
                edge += gap * gap;
            }
            own[a] += edge;
            own[b] += edge;
            neighbors[a]++;
            neighbors[b]++;
        }
    for (size_t i = 0; i < points; i++) {
        double length = SMOOTH_BESIDE + SMOOTH_OUT * distance[i];
        own[i] /= length * length;
    }
}

/* One Jacobi pass of m_i = (own_i m0_i + sum m_j) / (own_i + n_i); `sum` is scratch. */
static void smooth_once(const struct dr_motor *first, size_t points, const uint32_t *triangle,
                        size_t triangles, const double *own, const double *neighbors, struct dr_motor *sum,
                        struct dr_motor *motor)
{
    memset(sum, 0, points * sizeof *sum);
    for (size_t t = 0; t < triangles; t++)
        for (size_t k = 0; k < 3; k++) {
            uint32_t a = triangle[3 * t + k], b = triangle[3 * t + (k + 1) % 3];
            add(sum + a, 1, motor + b);
            add(sum + b, 1, motor + a);
        }
    for (size_t i = 0; i < points; i++) {
        if (neighbors[i] == 0)
            continue;
        double whole = own[i] + neighbors[i];
        add(sum + i, own[i], first + i);
        for (int d = 0; d < 4; d++) {
            motor[i].real[d] = sum[i].real[d] / whole;
            motor[i].dual[d] = sum[i].dual[d] / whole;
        }
    }
}

void dr_carry_smooth(const double *x, size_t points, const uint32_t *triangle, size_t triangles,
                     const double *distance, double *scratch, struct dr_motor *motor)
{
    struct dr_motor *first = (struct dr_motor *)scratch, *sum = first + points;
    double *own = (double *)(sum + points), *neighbors = own + points;
    align(motor, points);
    memcpy(first, motor, points * sizeof *first);
    find_weights(x, points, triangle, triangles, distance, own, neighbors);
    for (int pass = 0; pass < PASSES; pass++)
        smooth_once(first, points, triangle, triangles, own, neighbors, sum, motor);
}

/* ---- the whole of a cloth -------------------------------------------------------------------- */

/* Sewn vertices move as one: point[v] is the least vertex that v is sewn to. */
static void join_seams(const drape_scene_desc *desc, uint32_t *point)
{
    for (size_t v = 0; v < desc->vertices; v++)
        point[v] = (uint32_t)v;
    for (size_t s = 0; s < desc->seams; s++) {
        uint32_t a = desc->seam[2 * s], b = desc->seam[2 * s + 1];
        while (point[a] != a)
            a = point[a] = point[point[a]];
        while (point[b] != b)
            b = point[b] = point[point[b]];
        point[a > b ? a : b] = a > b ? b : a;
    }
    for (size_t v = 0; v < desc->vertices; v++) /* a leader precedes the rest of its group */
        point[v] = point[point[v]];
}

struct carried {
    uint32_t *point;    /* vertices */
    uint32_t *triangle; /* 3*triangles points */
    double *distance;   /* vertices, m */
    double *scratch;    /* DR_CARRY_SCRATCH*vertices */
    struct dr_motor *motor;
    struct dr_nearest *nearest;
};

static void find_motors(const struct carried *c, const drape_scene_desc *desc, const drape_body *from,
                        const drape_body *to, const double *positions)
{
    for (size_t v = 0; v < desc->vertices; v++) {
        struct dr_place place;
        dr_nearest_find(c->nearest, positions + 3 * v, INFINITY, &place);
        c->motor[v] = dr_motor_at(&place, from->triangle, from->positions, to->positions, positions);
        c->distance[v] = sqrt(place.square);
    }
    for (size_t i = 0; i < 3 * desc->triangles; i++)
        c->triangle[i] = c->point[desc->triangle[i]];
}

static drape_status check(const drape_scene_desc *desc, const drape_body *from, const drape_body *to,
                          const double *positions, drape_error *reterr)
{
    if (from->kind != DRAPE_BODY_MESH || to->kind != DRAPE_BODY_MESH)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, 0, 0, "kind", "only meshes carry cloth");
    drape_status status = dr_body_check(from, 0, reterr);
    if (status < 0)
        return status;
    status = dr_body_check_keyframe(from, to->positions, to->vertices, 0, 0, reterr);
    if (status < 0)
        return status;
    if (to->triangles != from->triangles ||
        memcmp(to->triangle, from->triangle, 3 * from->triangles * sizeof *from->triangle) != 0)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, 0, 0, "triangle",
                          "the two bodies do not have the same triangles");
    for (size_t i = 0; i < 3 * desc->vertices; i++)
        if (!(fabs(positions[i]) <= DRAPE_MAX_COORDINATE))
            return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_VERTEX, (int64_t)(i / 3),
                           "the position is not finite and within %g m", DRAPE_MAX_COORDINATE);
    for (size_t i = 0; i < 3 * desc->triangles; i++)
        if (desc->triangle[i] >= desc->vertices)
            return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_TRIANGLE, (int64_t)(i / 3),
                           "vertex %u does not exist: there are %zu", desc->triangle[i], desc->vertices);
    for (size_t i = 0; i < 2 * desc->seams; i++)
        if (desc->seam[i] >= desc->vertices)
            return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_SEAM, (int64_t)(i / 2),
                           "vertex %u does not exist: there are %zu", desc->seam[i], desc->vertices);
    return DRAPE_OK;
}

drape_status drape_carry(const drape_scene_desc *desc, const drape_body *from, const drape_body *to,
                         double *positions, drape_error *reterr)
{
    drape_status status = check(desc, from, to, positions, reterr);
    if (status < 0 || !desc->vertices)
        return status;
    size_t vertices = desc->vertices;
    double centre[3] = {positions[0], positions[1], positions[2]};
    struct carried c = {
        malloc(vertices * sizeof *c.point),    malloc((3 * desc->triangles + 1) * sizeof *c.triangle),
        malloc(vertices * sizeof *c.distance), malloc(DR_CARRY_SCRATCH * vertices * sizeof *c.scratch),
        malloc(vertices * sizeof *c.motor),    NULL};
    if (!c.point || !c.triangle || !c.distance || !c.scratch || !c.motor)
        status = dr_out_of_memory(reterr);
    if (status >= 0)
        status = dr_nearest_new(from->positions, from->vertices, from->triangle, from->triangles, &c.nearest,
                                reterr);
    if (status >= 0) {
        join_seams(desc, c.point);
        find_motors(&c, desc, from, to, positions);
        dr_carry_smooth(positions, vertices, c.triangle, desc->triangles, c.distance, c.scratch, c.motor);
    }
    for (size_t v = 0; status >= 0 && v < vertices; v++)
        dr_motor_move(c.motor + c.point[v], centre, positions + 3 * v);
    dr_nearest_free(c.nearest);
    free(c.point);
    free(c.triangle);
    free(c.distance);
    free(c.scratch);
    free(c.motor);
    return status;
}
