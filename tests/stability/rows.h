/* rows.h - runs stability cases under methods, each row in a process of its own, and judges the outcome. */
#ifndef DRAPED_STABILITY_ROWS_H
#define DRAPED_STABILITY_ROWS_H

#include <stdio.h>

#include "cases.h"

/* How a method is asked for. */
struct stability_method {
    const char *name;
    drape_method method;
    drape_stop_rule stop_on;
    drape_integrator integrator;
    double air_damping, material_damping; /* 1/s, s */
    bool line_search;
    bool may_fail; /* plain Newton and explicit steps may end in DRAPE_ENUMERIC: the paper's do */
};

extern const struct stability_method stability_method[];
extern const size_t stability_methods;

enum verdict {
    ROW_AT_REST,
    ROW_NOT_AT_REST,
    ROW_SLID_OFF,
    ROW_INTERSECTING,
    ROW_REFUSED,   /* rightly */
    ROW_NO_RESULT, /* DRAPE_ENUMERIC from a method that may fail */
    ROW_VIOLATION,
    ROW_VERDICTS
};
extern const char *const row_verdict_name[ROW_VERDICTS];

/* One run, as its process tells it. Plain data: it comes through a pipe. */
struct row {
    enum verdict verdict;
    char why[160]; /* of a refusal, no rest, no result or violation */
    uint32_t iterations;
    double residual;   /* force, of the state returned */
    double start, end; /* J: potential energy */
    double seconds;    /* of the run, by the test's own clock */
    bool twice;        /* run twice, the same bytes */
};

struct row_job {
    const struct stability_case *which;
    const struct stability_method *method;
    uint32_t max_iterations;
    double time_limit; /* s, for the run */
    double patience;   /* s, for the whole process: then it hangs and is killed */
    bool twice;
    struct row row; /* out */
};

/* Runs all jobs, `workers` at a time; prints each row to each of `out` (NULL-terminated) in order.
 * Returns the number of violations. */
size_t rows_run(struct row_job *job, size_t jobs, size_t workers, FILE *const *out);

void rows_head(FILE *const *out);
void rows_summary(const struct row_job *job, size_t jobs, FILE *const *out);

#endif
