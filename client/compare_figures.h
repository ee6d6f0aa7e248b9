/* compare_figures.h - the figures of a comparison: a table for a person, JSON and CSV for programs. */
#ifndef DRAPE_CLIENT_COMPARE_FIGURES_H
#define DRAPE_CLIENT_COMPARE_FIGURES_H

#include "compare.h"

/* A few lines: what is compared with what, a row for each run, and what to beware of. */
void compare_put_table(FILE *file, const struct comparison *comparison);

/* The same figures at full precision; null: not known, or never reached. NULL when memory ran out. */
json_t *compare_to_json(const struct comparison *comparison);

/* Every row of every trace, with its method and its distance (RFC 4180; empty: not known). */
void compare_put_csv(FILE *file, const struct comparison *comparison);

/* Calls `put` with each sentence that a reader of the figures must know: where E* comes from and how
 * sure it is, minima that differ, starts that differ. */
typedef void compare_note_fn(const char *sentence, void *user);
void compare_each_note(const struct comparison *comparison, compare_note_fn *put, void *user);

/* A cost as people write it: "105", "0.068", "-" when it is not known. `whole`: no decimals. */
void compare_cost_text(double cost, bool whole, char ret[32]);

#endif
