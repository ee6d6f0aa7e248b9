/* compare_plot.h - the pictures of a comparison: convergence, and the exchange of energies. */
#ifndef DRAPE_CLIENT_COMPARE_PLOT_H
#define DRAPE_CLIENT_COMPARE_PLOT_H

#include "compare.h"

struct compare_axes { /* what a page says below the picture of convergence */
    bool log_x;       /* iterations and seconds are on logarithmic axes, since the runs differ much */
};

/* (E - E*) / (E0 - E*) of all runs, against iterations and against seconds, on the same scales. Curve i
 * has colour i and is dashed from CHART_COLOURS on. *ret: SVG for a page, the caller frees it. */
int compare_plot_convergence(const struct comparison *comparison, struct compare_axes *ret_axes, char **ret,
                             struct failure *failure);

/* Colours of the energies below. */
enum { COMPARE_ELASTIC = 0, COMPARE_GRAVITY, COMPARE_KINETIC, COMPARE_CONTACT, COMPARE_ENERGIES };

/* Energies of one run against iterations, stops marked; the scale of energy is the same for all runs. */
int compare_plot_exchange(const struct comparison *comparison, size_t run, char **ret,
                          struct failure *failure);

/* Whether any run felt a body. */
bool compare_has_contact(const struct comparison *comparison);

#endif
