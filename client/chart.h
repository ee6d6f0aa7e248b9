/* chart.h - curves on axes as SVG, by PLplot; knows nothing of what the curves mean. */
#ifndef DRAPE_CLIENT_CHART_H
#define DRAPE_CLIENT_CHART_H

#include <stdbool.h>
#include <stddef.h>

#include "failure.h"

/* Colours of curves: 0 to CHART_COLOURS - 1, told apart by colour-blind readers too. */
#define CHART_COLOURS 8

struct chart_curve {
    double *x, *y; /* on a logarithmic axis: the logarithm to base 10 */
    size_t points;
    int colour;
    bool dashed;
    double width; /* 1.5 is a plain line */
};

struct chart_panel {
    double left, right, bottom, top; /* where its frame lies in the picture, each 0 to 1 */
    double x0, x1, y0, y1;           /* what its frame spans, in the curves' numbers */
    bool log_x, log_y;
    const char *x_label, *y_label, *title; /* "" for none; # starts an escape of PLplot */
    const struct chart_curve *curve;
    size_t curves;
    const double *line_x; /* where upright lines cross the panel */
    size_t lines;
};

/* An SVG element for the inside of an HTML page, in *ret (malloc'd, the caller frees it): without the XML
 * prologue, scaled to the width of the page, its ids made unique by `id` (letters and digits). `title`
 * is what a screen reader says (plain text without markup). Not to be called by two threads at once.
 * 0, or -1 with *failure (EXIT_LOCAL). */
int chart_svg(const struct chart_panel *panel, size_t panels, int width, int height, const char *id,
              const char *title, char **ret, struct failure *failure);

/* The colour of a curve, as CSS has it: "#0072b2". */
void chart_colour(int colour, char ret[8]);

#endif
