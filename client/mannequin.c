/* mannequin.c - a dress form as a stack of horizontal cross-sections swept along a smooth spline.
 *
 * Each control row gives a height and a cross-section: half width, depth to the front and to the
 * back, and the exponent n of the superellipse |x/a|^n + |z/b|^n = 1. A uniform cubic B-spline
 * through the rows (C2, and it never leaves the rows' hull) makes the surface smooth. Rings of equal
 * arc length, each with as many vertices as its girth asks for, are zipped together; the two ends
 * close in a fan about a pole. So every edge has two triangles by construction. */
#include "mannequin.h"

#include <math.h>
#include <stdlib.h>

/* Metres. Girths after smoothing: bust 0.90, waist 0.70, hips 0.93: about a European size 38, drawn
 * by eye; no body data went into it. */
static const struct row {
    double y, width, front, back, exponent;
} rows[] = {
    {1.500, 0.000, 0.000, 0.000, 2.0}, /* pole of the neck stump */
    {1.500, 0.038, 0.038, 0.038, 2.0}, {1.482, 0.055, 0.052, 0.056, 2.0},
    {1.450, 0.055, 0.050, 0.060, 2.0}, {1.420, 0.060, 0.050, 0.068, 2.0}, /* neck base */
    {1.402, 0.092, 0.052, 0.074, 2.0}, {1.384, 0.134, 0.056, 0.078, 2.1},
    {1.362, 0.170, 0.062, 0.082, 2.2}, {1.330, 0.190, 0.072, 0.090, 2.2}, /* shoulder ends */
    {1.285, 0.190, 0.092, 0.098, 2.2}, {1.235, 0.174, 0.122, 0.102, 2.2},
    {1.190, 0.162, 0.134, 0.100, 2.2},                                    /* bust */
    {1.130, 0.148, 0.116, 0.092, 2.2}, {1.040, 0.120, 0.096, 0.080, 2.1}, /* waist */
    {0.960, 0.138, 0.098, 0.094, 2.1}, {0.890, 0.168, 0.102, 0.118, 2.2},
    {0.820, 0.180, 0.102, 0.122, 2.2}, /* hips */
    {0.740, 0.178, 0.098, 0.106, 2.3}, {0.660, 0.172, 0.094, 0.096, 2.3},
    {0.590, 0.165, 0.090, 0.090, 2.3}, {0.520, 0.158, 0.086, 0.086, 2.3},
    {0.490, 0.132, 0.072, 0.072, 2.2}, {0.490, 0.000, 0.000, 0.000, 2.0}, /* pole of the base */
};

enum { ROWS = sizeof rows / sizeof rows[0], PROFILE_SAMPLES = 4096, RING_SAMPLES = 512 };

/* Row `i`, with one reflected row beyond each end so that the spline passes through the poles. */
static struct row control_row(int i)
{
    if (i >= 0 && i < ROWS) {
        return rows[i];
    }
    struct row pole = rows[i < 0 ? 0 : ROWS - 1], next = rows[i < 0 ? 1 : ROWS - 2];
    return (struct row){2 * pole.y - next.y, 2 * pole.width - next.width, 2 * pole.front - next.front,
                        2 * pole.back - next.back, 2 * pole.exponent - next.exponent};
}

/* The section at spline parameter t in [0, ROWS - 1]. */
static struct row section_at(double t)
{
    int i = (int)floor(t);
    i = i > ROWS - 2 ? ROWS - 2 : i;
    double s = t - i;
    const double weight[4] = {(1 - s) * (1 - s) * (1 - s) / 6, (3 * s * s * s - 6 * s * s + 4) / 6,
                              (-3 * s * s * s + 3 * s * s + 3 * s + 1) / 6, s * s * s / 6};
    struct row sum = {0};
    for (int k = 0; k < 4; k++) {
        struct row r = control_row(i - 1 + k);
        sum.y += weight[k] * r.y;
        sum.width += weight[k] * r.width;
        sum.front += weight[k] * r.front;
        sum.back += weight[k] * r.back;
        sum.exponent += weight[k] * r.exponent;
    }
    return sum;
}

/* Point of a section at angle `theta`: 0 at the middle of the back, then the wearer's left (+x), front
 * and right; clockwise seen from above. */
static void section_point(const struct row *section, double theta, double *x, double *z)
{
    double c = -cos(theta), s = sin(theta);
    double scale =
        pow(pow(fabs(c), section->exponent) + pow(fabs(s), section->exponent), -1 / section->exponent);
    *x = section->width * scale * s;
    *z = (c > 0 ? section->front : section->back) * scale * c;
}

/* Cumulative arc length along the section, at RING_SAMPLES + 1 equal angles; returns the girth. */
static double section_lengths(const struct row *section, double length[RING_SAMPLES + 1])
{
    double x0, z0;
    section_point(section, 0, &x0, &z0);
    length[0] = 0;
    for (int i = 1; i <= RING_SAMPLES; i++) {
        double x, z;
        section_point(section, 2 * M_PI * i / RING_SAMPLES, &x, &z);
        length[i] = length[i - 1] + hypot(x - x0, z - z0);
        x0 = x;
        z0 = z;
    }
    return length[RING_SAMPLES];
}

/* Spline parameters of rings about `step` apart along the profile, poles left out. The profile's
 * length counts the largest of the three radii, so the flat shoulders get enough rings. */
static double *ring_parameters(double step, size_t *ret_rings)
{
    double *length = malloc((PROFILE_SAMPLES + 1) * sizeof *length), *ring = NULL;
    if (!length) {
        return NULL;
    }
    struct row before = section_at(0);
    length[0] = 0;
    for (int i = 1; i <= PROFILE_SAMPLES; i++) {
        struct row now = section_at((double)(ROWS - 1) * i / PROFILE_SAMPLES);
        double side = fmax(fabs(now.width - before.width),
                           fmax(fabs(now.front - before.front), fabs(now.back - before.back)));
        length[i] = length[i - 1] + hypot(now.y - before.y, side);
        before = now;
    }
    size_t rings = (size_t)ceil(length[PROFILE_SAMPLES] / step);
    rings = rings < 4 ? 3 : rings - 1;
    ring = malloc(rings * sizeof *ring);
    for (size_t r = 0, i = 0; ring && r < rings; r++) {
        double target = length[PROFILE_SAMPLES] * (double)(r + 1) / (double)(rings + 1);
        while (length[i + 1] < target) {
            i++;
        }
        double part = (target - length[i]) / (length[i + 1] - length[i]);
        ring[r] = (double)(ROWS - 1) * ((double)i + part) / PROFILE_SAMPLES;
    }
    free(length);
    *ret_rings = rings;
    return ring;
}

/* Where on its girth vertex i of a ring lies, in [0, 1): every other ring is turned by half an edge. */
static double ring_fraction(size_t ring, size_t i, size_t count)
{
    return ((double)i + (ring % 2 ? 0.5 : 0)) / (double)count;
}

static size_t ring_count(const struct row *section, double spacing)
{
    double length[RING_SAMPLES + 1];
    double count = round(section_lengths(section, length) / spacing);
    return count < 6 ? 6 : (size_t)count;
}

static void place_ring(const struct row *section, size_t ring, size_t count, double *positions)
{
    double length[RING_SAMPLES + 1];
    double girth = section_lengths(section, length);
    for (size_t i = 0, k = 0; i < count; i++) {
        double target = girth * ring_fraction(ring, i, count);
        while (length[k + 1] < target) {
            k++;
        }
        double part = (target - length[k]) / (length[k + 1] - length[k]);
        section_point(section, 2 * M_PI * ((double)k + part) / RING_SAMPLES, &positions[3 * i],
                      &positions[3 * i + 2]);
        positions[3 * i + 1] = section->y;
    }
}

static uint32_t *put_triangle(uint32_t *out, size_t a, size_t b, size_t c)
{
    out[0] = (uint32_t)a;
    out[1] = (uint32_t)b;
    out[2] = (uint32_t)c;
    return out + 3;
}

/* Triangles between an upper and a lower ring: always advance on the ring whose next vertex comes
 * first. Writes upper_count + lower_count triangles. */
static uint32_t *zip_rings(uint32_t *out, size_t ring, size_t upper, size_t upper_count, size_t lower,
                           size_t lower_count)
{
    size_t i = 0, j = 0;
    while (i < upper_count || j < lower_count) {
        size_t a = upper + i % upper_count, b = lower + j % lower_count;
        bool down = i == upper_count || (j < lower_count && ring_fraction(ring + 1, j + 1, lower_count) <
                                                                ring_fraction(ring, i + 1, upper_count));
        if (down) {
            j++;
            out = put_triangle(out, a, lower + j % lower_count, b);
        } else {
            i++;
            out = put_triangle(out, a, upper + i % upper_count, b);
        }
    }
    return out;
}

static void connect_rings(const size_t *first, size_t rings, uint32_t *out)
{
    size_t last = rings - 1, pole = first[rings];
    for (size_t i = 0, n = first[1] - first[0]; i < n; i++) {
        out = put_triangle(out, pole, first[0] + (i + 1) % n, first[0] + i);
    }
    for (size_t r = 0; r + 1 < rings; r++) {
        out = zip_rings(out, r, first[r], first[r + 1] - first[r], first[r + 1], first[r + 2] - first[r + 1]);
    }
    for (size_t i = 0, n = first[rings] - first[last]; i < n; i++) {
        out = put_triangle(out, pole + 1, first[last] + i, first[last] + (i + 1) % n);
    }
}

int mannequin_build(double spacing, struct surface *ret)
{
    int status = -1;
    size_t rings = 0;
    size_t *first = NULL; /* rings + 1: first vertex of each ring, then the number of ring vertices */
    double *ring = ring_parameters(spacing * sqrt(3) / 2, &rings);
    if (!ring || !(first = calloc(rings + 1, sizeof *first))) {
        goto cleanup;
    }
    for (size_t r = 0; r < rings; r++) {
        struct row section = section_at(ring[r]);
        first[r + 1] = first[r] + ring_count(&section, spacing);
    }
    /* A closed surface of genus 0 has 2 V - 4 triangles. */
    size_t vertices = first[rings] + 2;
    if (surface_new(vertices, 2 * vertices - 4, false, ret) < 0) {
        goto cleanup;
    }
    for (size_t r = 0; r < rings; r++) {
        struct row section = section_at(ring[r]);
        place_ring(&section, r, first[r + 1] - first[r], ret->positions + 3 * first[r]);
    }
    ret->positions[3 * first[rings] + 1] = rows[0].y;
    ret->positions[3 * first[rings] + 4] = rows[ROWS - 1].y;
    connect_rings(first, rings, ret->triangle);
    status = 0;
cleanup:
    free(ring);
    free(first);
    return status;
}
