/* output.h - the files of a finished job: the drape in every format, and its trace. */
#ifndef DRAPED_OUTPUT_H
#define DRAPED_OUTPUT_H

#include "schema.h"

/* File names inside a job's result folder, as the store serves them. */
#define OUTPUT_RESULT_JSON "result.json"
#define OUTPUT_RESULT_OBJ  "result.obj"
#define OUTPUT_RESULT_PLY  "result.ply"
#define OUTPUT_RESULT_GLB  "result.glb"
#define OUTPUT_POSITIONS   "positions" /* 3*vertices doubles as they are in memory: for start_from */
#define OUTPUT_TRACE_CSV   "trace.csv"
#define OUTPUT_TRACE_JSON  "trace.json"
#define OUTPUT_TRACE_SVG   "trace.svg"

/* All but the positions once more in every content coding that is worth it: "result.json.gz". */

/* Writes and fsyncs all of them into the open folder `dirfd`. `positions`: 3*spec->cloth.vertices. `fit`:
 * NULL where the job did not ask for it. Without a state better than the start, as with max_iterations 0, the
 * result files are left out: the undraped start is never a result. Thread-safe (the SVG plot takes a lock).
 * 0, or -1 with *reterr (PROBLEM_STORAGE). */
int output_write(int dirfd, const struct job_spec *spec, const drape_report *report, const double *positions,
                 const drape_fit *fit, const drape_row *row, size_t rows, struct problem *reterr);

/* A first look at a drape of the job, as a GLB; malloc'd, NULL when out of memory. */
char *output_preview(const struct job_spec *spec, const drape_preview *preview, size_t *ret_bytes);

#endif
