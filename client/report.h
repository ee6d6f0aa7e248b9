/* report.h - an ended job and its trace, in words and numbers for a person. */
#ifndef DRAPE_CLIENT_REPORT_H
#define DRAPE_CLIENT_REPORT_H

#include <jansson.h>
#include <stdio.h>

/* A paragraph about a job of any status: verdict, reason, counts, times, energies, residuals, or the
 * error that ended it. Members the server left out are left out. */
void report_job(FILE *file, const json_t *job);

/* Some rows of a trace (CSV of the contract, NUL-terminated), first and last among them, evenly
 * spaced between, so that the fall of the residual shows. */
void report_trace(FILE *file, const char *csv);

/* The line of `drape list`. */
void report_line(FILE *file, const json_t *job);

#endif
