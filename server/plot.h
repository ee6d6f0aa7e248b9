/* plot.h - the convergence of a drape as a picture: residuals against iterations and seconds, in SVG. */
#ifndef DRAPED_PLOT_H
#define DRAPED_PLOT_H

#include <stddef.h>

#include "drape.h"

/* An SVG document in *ret (malloc'd, the caller frees it) of *ret_bytes bytes. `tolerance` is drawn as
 * a line; `title` is plain UTF-8. 0, or -1 when the plotting library failed or memory ran out. Any
 * thread may call it; a lock keeps them apart, since PLplot's state is global. */
int plot_trace_svg(const drape_row *row, size_t rows, double tolerance, const char *title, char **ret,
                   size_t *ret_bytes);

#endif
