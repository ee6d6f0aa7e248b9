/* compare.h - the reckoning of one scene solved by several methods: who came how near, how soon. */
#ifndef DRAPE_CLIENT_COMPARE_H
#define DRAPE_CLIENT_COMPARE_H

#include <jansson.h>

#include "trace.h"

/* As many as a chart can show apart: eight colours, drawn whole and dashed. */
#define COMPARE_MAX_RUNS 16

/* The distances (E - E*) / (E0 - E*) whose price is told. */
#define COMPARE_LEVELS 3
extern const double compare_level[COMPARE_LEVELS];

/* Two states at rest whose energies differ by more than this part of E0 - E* count as different
 * minima. A run that rests within the usual tolerance of 1e-3 is left with 1e-6 or less. */
#define COMPARE_SAME_MINIMUM 1e-4

struct compare_cost {      /* what it took; all NAN: never got there */
    double iterations;     /* as the trace numbers them */
    double seconds;        /* of the solver, sewing included */
    double factorizations; /* of draping, those of the state it got to included as in its seconds; NAN
                            * where the trace does not tell */
};

struct compare_run {
    const char *spec;   /* borrowed */
    json_t *job;        /* owned; the ended job, NULL when the server refused it */
    char *refusal;      /* owned; why there is no job or no trace, NULL: there are both */
    struct trace trace; /* owned */

    /* filled by compare_reckon */
    bool at_rest, certified;
    bool usable;     /* ended with a finite energy, and not off or inside a body */
    double energy;   /* J: potential of the state it returned; NAN: none */
    double distance; /* (energy - E*) / (E0 - E*); NAN where that says nothing */
    bool other_minimum;
    struct compare_cost level[COMPARE_LEVELS], rest;
    /* To the same distances of the energy at which it rests itself, E0 - that energy being 1; never for a
     * run that does not rest. The price of a minimum that may not be E*. */
    struct compare_cost own[COMPARE_LEVELS];
};

struct comparison {
    struct compare_run *run; /* borrowed */
    size_t runs;

    /* filled by compare_reckon; NAN and NULL when no run is usable */
    double start;                   /* E0, J: potential of the first row */
    double best;                    /* E*, J: the lowest certified energy, else the lowest */
    double drop;                    /* E0 - E*, J; NAN unless > 0 */
    const struct compare_run *from; /* the run that E* comes from */
    bool certified;                 /* E* is */
    bool starts_differ;             /* not all runs began at E0 */
    bool below_best;                /* an uncertified run ended below the certified E* */
    bool minima_differ;
    /* Distances below this are not known: the digits of the trace and, when E* is not certified, what the
     * run behind it says that it has still left to fall, and states below E* that a run swung through. */
    double floor;
};

/* From the traces and reports; may be called again. */
void compare_reckon(struct comparison *comparison);

/* (E - E*) / (E0 - E*) of one row; NAN where that says nothing. */
double compare_distance(const struct comparison *comparison, double energy);

/* How the run ended, in a word: a verdict, "refused", "failed", "canceled". */
const char *compare_outcome(const struct compare_run *run);

/* Why it ended so, in the server's words; "" when it said nothing. */
const char *compare_reason(const struct compare_run *run);

/* A number of the job's report; NAN when it has none. */
double compare_figure(const struct compare_run *run, const char *key);

void compare_run_done(struct compare_run *run); /* empties without freeing the struct */

#endif
