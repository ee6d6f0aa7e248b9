/* body_check.c - what a body must be before anything is built from it. */
#include "body.h"

#include <math.h>
#include <stdlib.h>

#include "error.h"

static drape_status refuse(int64_t number, const char *member, const char *why, drape_error *reterr)
{
    return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, number, number, member, "%s", why);
}

static bool in_range(const double x[3])
{
    for (int d = 0; d < 3; d++)
        if (!(fabs(x[d]) <= DR_BODY_MAX_COORDINATE)) /* a NaN fails, too */
            return false;
    return true;
}

static drape_status check_vertices(const drape_body *desc, int64_t number, drape_error *reterr)
{
    for (size_t v = 0; v < desc->vertices; v++)
        if (!in_range(desc->positions + 3 * v))
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_VERTEX, (int64_t)v, number, "positions",
                              "a coordinate is not finite or beyond %g m", DR_BODY_MAX_COORDINATE);
    return DRAPE_OK;
}

static drape_status check_corners(const drape_body *desc, int64_t number, drape_error *reterr)
{
    for (size_t t = 0; t < desc->triangles; t++) {
        const uint32_t *corner = desc->triangle + 3 * t;
        for (int k = 0; k < 3; k++)
            if (corner[k] >= desc->vertices)
                return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_TRIANGLE, (int64_t)t, number,
                                  "triangle", "vertex %u does not exist: there are %zu", corner[k],
                                  desc->vertices);
        if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0])
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_TRIANGLE, (int64_t)t, number, "triangle",
                              "two corners are the same vertex (%u %u %u)", corner[0], corner[1], corner[2]);
    }
    return DRAPE_OK;
}

/* ---- closed and consistently oriented -------------------------------------------------------- */

/* One side of a triangle, sorted so that the sides of one edge stand together. */
struct side {
    uint32_t low, high; /* vertices, low < high */
    uint32_t triangle;
    bool rising; /* the triangle runs from low to high */
};

static int compare_sides(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    if (a->high != b->high)
        return a->high < b->high ? -1 : 1;
    if (a->triangle != b->triangle)
        return a->triangle < b->triangle ? -1 : 1;
    return 0; /* a triangle has each of its edges once, since its corners differ */
}

/* The `count` sides of one edge: exactly two, in opposite directions. */
static drape_status check_edge(const struct side *side, size_t count, int64_t number, drape_error *reterr)
{
    if (count == 1)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_TRIANGLE, side->triangle, number, "triangle",
                          "the surface is not closed: no other triangle has the edge %u-%u", side->low,
                          side->high);
    if (count > 2)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_TRIANGLE, side[2].triangle, number, "triangle",
                          "the edge %u-%u is shared by %zu triangles, not two", side->low, side->high, count);
    if (side[0].rising == side[1].rising)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_TRIANGLE, side[1].triangle, number, "triangle",
                          "turned against its neighbour, triangle %u, across the edge %u-%u",
                          side[0].triangle, side->low, side->high);
    return DRAPE_OK;
}

static drape_status check_edges(const drape_body *desc, int64_t number, drape_error *reterr)
{
    size_t count = 3 * desc->triangles;
    struct side *side = malloc(count * sizeof *side);
    if (!side)
        return dr_out_of_memory(reterr);
    for (size_t i = 0; i < count; i++) {
        uint32_t a = desc->triangle[i], b = desc->triangle[i % 3 == 2 ? i - 2 : i + 1];
        side[i] = (struct side){a < b ? a : b, a < b ? b : a, (uint32_t)(i / 3), a < b};
    }
    qsort(side, count, sizeof *side, compare_sides);

    drape_status status = DRAPE_OK;
    for (size_t i = 0, end; i < count && status == DRAPE_OK; i = end) {
        for (end = i + 1; end < count && side[end].low == side[i].low && side[end].high == side[i].high;)
            end++;
        status = check_edge(side + i, end - i, number, reterr);
    }
    free(side);
    return status;
}

/* Six times the enclosed volume, by the divergence theorem, about the first vertex. */
static double six_volumes(const drape_body *desc)
{
    const double *o = desc->positions;
    double sum = 0;
    for (size_t t = 0; t < desc->triangles; t++) {
        double x[3][3];
        for (int k = 0; k < 3; k++)
            for (int d = 0; d < 3; d++)
                x[k][d] = desc->positions[3 * (size_t)desc->triangle[3 * t + (size_t)k] + (size_t)d] - o[d];
        sum += x[0][0] * (x[1][1] * x[2][2] - x[1][2] * x[2][1]) +
               x[0][1] * (x[1][2] * x[2][0] - x[1][0] * x[2][2]) +
               x[0][2] * (x[1][0] * x[2][1] - x[1][1] * x[2][0]);
    }
    return sum;
}

drape_status dr_body_check_mesh(const drape_body *desc, int64_t number, drape_error *reterr)
{
    if (!desc->positions || !desc->triangle || desc->triangles < DR_BODY_MIN_TRIANGLES)
        return refuse(number, "triangles", "a closed mesh has at least four triangles", reterr);
    if (desc->vertices > DRAPE_MAX_VERTICES)
        return refuse(number, "vertices", "too many vertices", reterr);
    if (desc->triangles > DRAPE_MAX_TRIANGLES)
        return refuse(number, "triangles", "too many triangles", reterr);
    drape_status status = check_vertices(desc, number, reterr);
    if (status == DRAPE_OK)
        status = check_corners(desc, number, reterr);
    if (status == DRAPE_OK)
        status = check_edges(desc, number, reterr);
    if (status == DRAPE_OK && !(six_volumes(desc) > 0))
        status = refuse(number, "triangle", "inside out: the enclosed volume is not positive", reterr);
    return status;
}

drape_status dr_body_check_keyframe(const drape_body *desc, const double *positions, size_t vertices,
                                    int64_t keyframe, int64_t number, drape_error *reterr)
{
    drape_body posture = *desc;
    posture.positions = positions;
    if (vertices != desc->vertices)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_KEYFRAME, keyframe, number, "positions",
                          "%zu vertices, where the body has %zu", vertices, desc->vertices);
    for (size_t v = 0; v < vertices; v++)
        if (!in_range(positions + 3 * v))
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_KEYFRAME, keyframe, number, "positions",
                              "a coordinate of vertex %zu is not finite or beyond %g m", v,
                              DR_BODY_MAX_COORDINATE);
    if (!(six_volumes(&posture) > 0))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY_KEYFRAME, keyframe, number, "positions",
                          "inside out: the enclosed volume is not positive");
    return DRAPE_OK;
}

/* ---- by kind --------------------------------------------------------------------------------- */

static drape_status check_plane(const drape_body *desc, int64_t number, drape_error *reterr)
{
    if (!in_range(desc->point))
        return refuse(number, "point", "not finite or too large", reterr);
    if (!in_range(desc->axis))
        return refuse(number, "axis", "not finite or too large", reterr);
    if (!(fmax(fabs(desc->axis[0]), fmax(fabs(desc->axis[1]), fabs(desc->axis[2]))) > 0))
        return refuse(number, "axis", "the normal is zero", reterr);
    return DRAPE_OK;
}

static drape_status check_round(const drape_body *desc, int64_t number, drape_error *reterr)
{
    if (!in_range(desc->point))
        return refuse(number, "point", "not finite or too large", reterr);
    if (desc->kind == DRAPE_BODY_CAPSULE && !in_range(desc->axis))
        return refuse(number, "axis", "not finite or too large", reterr);
    if (!(desc->radius > 0 && desc->radius <= DR_BODY_MAX_COORDINATE))
        return refuse(number, "radius", "must be positive and not too large", reterr);
    return DRAPE_OK;
}

static drape_status check_motion(const drape_body *desc, int64_t number, drape_error *reterr)
{
    if (desc->kind != DRAPE_BODY_MESH)
        return refuse(number, "keyframes", "only a mesh moves", reterr);
    if (desc->keyframes > DRAPE_MAX_KEYFRAMES)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, number, number, "keyframes",
                          "%zu are more than the limit of %d", desc->keyframes, DRAPE_MAX_KEYFRAMES);
    if (!(desc->motion_seconds >= DRAPE_MIN_MOTION && desc->motion_seconds <= DRAPE_MAX_MOTION))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, number, number, "motion_seconds",
                          "%g s is not between %g and %d", desc->motion_seconds, DRAPE_MIN_MOTION,
                          DRAPE_MAX_MOTION);
    drape_status status = DRAPE_OK;
    for (size_t k = 0; k < desc->keyframes && status == DRAPE_OK; k++)
        status = dr_body_check_keyframe(desc, desc->keyframe[k], desc->vertices, (int64_t)k, number, reterr);
    return status;
}

static drape_status check_kind(const drape_body *desc, int64_t number, drape_error *reterr)
{
    switch (desc->kind) {
    case DRAPE_BODY_MESH:
        return desc->field ? DRAPE_OK : dr_body_check_mesh(desc, number, reterr);
    case DRAPE_BODY_PLANE:
        return check_plane(desc, number, reterr);
    case DRAPE_BODY_SPHERE:
    case DRAPE_BODY_CAPSULE:
        return check_round(desc, number, reterr);
    }
    return refuse(number, "kind", "no such kind of body", reterr);
}

drape_status dr_body_check(const drape_body *desc, int64_t number, drape_error *reterr)
{
    if (!(desc->offset > 0 && desc->offset <= DR_BODY_MAX_OFFSET))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, number, number, "offset",
                          "%g m is not in (0, %g]", desc->offset, DR_BODY_MAX_OFFSET);
    if (!(desc->friction >= 0 && desc->friction <= DRAPE_MAX_FRICTION))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, number, number, "friction",
                          "%g is not between 0 and %g", desc->friction, (double)DRAPE_MAX_FRICTION);
    drape_status status = check_kind(desc, number, reterr);
    return status == DRAPE_OK && desc->keyframes ? check_motion(desc, number, reterr) : status;
}
