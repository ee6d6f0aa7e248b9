/* curve.h - one strain-stress curve as a monotone C1 piecewise cubic with its exact integral.
 *
 * What curves mean and how they are interpolated is told at drape_curve. Immutable once made; shareable
 * by threads. */
#ifndef DR_CURVE_H
#define DR_CURVE_H

#include "drape.h"

struct dr_curve;

struct dr_curve_value {
    double stress; /* N/m */
    double slope;  /* d(stress)/d(strain), N/m, >= 0 */
    double work;   /* integral of the stress from rest, N/m */
};

/* DRAPE_EINVAL at material number `material`, `member` of it, when the curve is not one that drape_curve
 * describes; the message names the point. */
drape_status dr_curve_check(const drape_curve *curve, int64_t material, const char *member,
                            drape_error *reterr);

/* NULL when out of memory. `curve` has passed dr_curve_check and is copied. */
struct dr_curve *dr_curve_new(const drape_curve *curve);
struct dr_curve *dr_curve_free(struct dr_curve *curve); /* NULL is fine; returns NULL */
size_t dr_curve_bytes(const struct dr_curve *curve);

/* At a strain >= 0. */
struct dr_curve_value dr_curve_at(const struct dr_curve *curve, double strain);

/* The slope at strain 0, N/m, > 0. */
double dr_curve_rest_slope(const struct dr_curve *curve);

#endif
