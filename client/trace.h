/* trace.h - a job's trace (JSON of the contract) as rows of numbers. */
#ifndef DRAPE_CLIENT_TRACE_H
#define DRAPE_CLIENT_TRACE_H

#include <stdbool.h>
#include <stddef.h>

#include "failure.h"

struct trace_row { /* NAN where the server gave null, or nothing */
    double iteration, seconds;
    double stretch, bend, gravity, contact, kinetic, potential; /* J; gravity relative to the start */
    double residual_energy;                                     /* J */
    double residual_force;                                      /* of the mean vertex weight */
    double stop;                                                /* 1: all velocities were cut here */
    double time_step;                                           /* s */
    double factorizations; /* attempts in this iteration; traces stored before this column have none */
};

struct trace {
    struct trace_row *row; /* owned; NULL when there are none */
    size_t rows;
};

/* `text` is {"columns": [...], "rows": [[...], ...]}; unknown columns are passed over. *ret is to be
 * emptied. 0, or -1 with *failure (EXIT_REFUSED: not a trace, EXIT_LOCAL: no memory). */
int trace_parse(const char *text, size_t bytes, struct trace *ret, struct failure *failure);
void trace_done(struct trace *trace); /* empties without freeing the struct */

/* Half a unit in the last place that the potential energies were written with, at the size of `energy`
 * (J): no difference of energies below it can be told from the trace. */
double trace_resolution(const struct trace *trace, double energy);

#endif
