/* curve.c - checks and evaluates monotone C1 strain-stress curves. */
#include "curve.h"

#include <math.h>
#include <stdlib.h>

#include "error.h"

/* From `strain` to the next knot, with t = (strain' - strain) / length in [0, 1]:
 * stress = a0 + t (a1 + t (a2 + t a3)). The last piece has no end: a2 = a3 = 0 and any length. */
struct piece {
    double strain, length;
    double a0, a1, a2, a3; /* N/m */
    double work;           /* integral of the stress up to `strain`, N/m */
};

struct dr_curve {
    size_t pieces;
    struct piece piece[];
};

/* Whether the caller wrote the start (0, 0) down. */
static bool starts_at_rest(const drape_curve *curve)
{
    return curve->points && curve->point[0] == 0;
}

/* ---- checks ------------------------------------------------------------------------------------- */

#define bad_curve(...) dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_MATERIAL, material, -1, member, __VA_ARGS__)

drape_status dr_curve_check(const drape_curve *curve, int64_t material, const char *member,
                            drape_error *reterr)
{
    if (curve->points > DRAPE_MAX_CURVE_POINTS)
        return bad_curve("%zu points are more than the limit of %d", curve->points, DRAPE_MAX_CURVE_POINTS);
    if (!curve->point)
        return bad_curve("the points are missing");
    size_t first = starts_at_rest(curve), last = curve->points - 1;
    if (first && curve->point[1] != 0)
        return bad_curve("point 0 has stress %g at strain 0: a curve starts at rest", curve->point[1]);
    if (first > last)
        return bad_curve("there is no point beyond rest");
    double strain = 0, stress = 0;
    for (size_t i = first; i <= last; i++) {
        const double *p = curve->point + 2 * i;
        if (!isfinite(p[0]) || !isfinite(p[1]))
            return bad_curve("point %zu is not finite", i);
        if (!(p[0] > strain))
            return bad_curve("point %zu has strain %g, not above the %g before it", i, p[0], strain);
        if (p[1] < stress)
            return bad_curve("point %zu has stress %g, below the %g before it", i, p[1], stress);
        double slope = (p[1] - stress) / (p[0] - strain);
        if (!(slope <= DRAPE_MAX_MATERIAL))
            return bad_curve("point %zu rises by %g N/m, the limit is %g", i, slope, DRAPE_MAX_MATERIAL);
        if (!(slope >= DRAPE_MIN_MATERIAL) && (i == first || i == last))
            return bad_curve("point %zu has stress %g after %g: the %s step must rise", i, p[1], stress,
                             i == first ? "first" : "last");
        strain = p[0];
        stress = p[1];
    }
    return DRAPE_OK;
}

/* ---- making ------------------------------------------------------------------------------------- */

/* Slope at the knot between two steps, [Fritsch & Butland 1984] as Brodlie weights it: the harmonic mean
 * of their slopes s and s', at most 3 min(s, s'), which keeps both cubics monotone. */
static double knot_slope(double length0, double slope0, double length1, double slope1)
{
    if (!(slope0 > 0 && slope1 > 0))
        return 0;
    double weight0 = length0 + 2 * length1, weight1 = 2 * length0 + length1;
    return (weight0 + weight1) / (weight0 / slope0 + weight1 / slope1);
}

static double step_slope(const struct piece *piece)
{
    return (piece[1].a0 - piece[0].a0) / piece->length;
}

/* The cubic of Hermite through both ends with these slopes. */
static void fit_piece(struct piece *piece, double slope0, double slope1)
{
    double rise = piece[1].a0 - piece[0].a0, a1 = piece->length * slope0, end = piece->length * slope1;
    piece->a1 = a1;
    piece->a2 = 3 * rise - 2 * a1 - end;
    piece->a3 = a1 + end - 2 * rise;
}

static double work_in(const struct piece *p, double t)
{
    return p->length * t * (p->a0 + t * (p->a1 / 2 + t * (p->a2 / 3 + t * (p->a3 / 4))));
}

struct dr_curve *dr_curve_new(const drape_curve *curve)
{
    size_t first = starts_at_rest(curve), steps = curve->points - first;
    struct dr_curve *made = calloc(1, sizeof *made + (steps + 1) * sizeof *made->piece);
    if (!made)
        return NULL;
    struct piece *piece = made->piece; /* piece[0] starts at rest, (0, 0) */
    made->pieces = steps + 1;
    for (size_t i = 0; i < steps; i++) {
        piece[i + 1].strain = curve->point[2 * (first + i)];
        piece[i + 1].a0 = curve->point[2 * (first + i) + 1];
        piece[i].length = piece[i + 1].strain - piece[i].strain;
    }
    double slope = step_slope(piece);
    for (size_t i = 0; i < steps; i++) {
        double next = i + 1 == steps ? step_slope(piece + i)
                                     : knot_slope(piece[i].length, step_slope(piece + i), piece[i + 1].length,
                                                  step_slope(piece + i + 1));
        fit_piece(piece + i, slope, next);
        piece[i + 1].work = piece[i].work + work_in(piece + i, 1);
        slope = next;
    }
    piece[steps].length = 1;
    piece[steps].a1 = slope;
    return made;
}

struct dr_curve *dr_curve_free(struct dr_curve *curve)
{
    free(curve);
    return NULL;
}

size_t dr_curve_bytes(const struct dr_curve *curve)
{
    return sizeof *curve + curve->pieces * sizeof *curve->piece;
}

/* ---- evaluating --------------------------------------------------------------------------------- */

struct dr_curve_value dr_curve_at(const struct dr_curve *curve, double strain)
{
    size_t low = 0, high = curve->pieces; /* piece[low].strain <= strain < piece[high].strain */
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (strain < curve->piece[middle].strain)
            high = middle;
        else
            low = middle;
    }
    const struct piece *p = curve->piece + low;
    double t = (strain - p->strain) / p->length;
    return (struct dr_curve_value){
        .stress = p->a0 + t * (p->a1 + t * (p->a2 + t * p->a3)),
        .slope = fmax((p->a1 + t * (2 * p->a2 + t * (3 * p->a3))) / p->length, 0), /* not a rounding below */
        .work = p->work + work_in(p, t),
    };
}

double dr_curve_rest_slope(const struct dr_curve *curve)
{
    return curve->piece[0].a1 / curve->piece[0].length;
}
