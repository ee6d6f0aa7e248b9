/* solve.h - one job from its document to its result files; the only caller of drape_sim_*. */
#ifndef DRAPED_SOLVE_H
#define DRAPED_SOLVE_H

#include <stdatomic.h>
#include <stdint.h>

#include "job.h"
#include "limits.h"
#include "problem.h"
#include "store.h"

/* At most four progress reports a second, as the contract promises. */
#define SOLVE_PROGRESS_MS 250

struct drape_analyses;
struct drape_processors;
struct fields;

struct solve_task {
    struct store *store;
    const struct limits *limits;
    const char *owner, *id;
    uint32_t attempt;
    atomic_bool *stop;                        /* looked at once an iteration */
    void (*progress)(char *json, void *data); /* on the solving thread; takes the text */
    void *data;
    struct fields *fields;           /* NULL: the job builds the distance fields of its bodies for itself */
    struct drape_analyses *analyses; /* NULL: the job analyses its matrices for itself */
    struct drape_processors *processors; /* NULL: the job has one */
    /* Likewise looks at the drape as it comes, as GLBs, which it takes. May be NULL. */
    void (*preview)(char *glb, size_t bytes, void *data);
};

enum solve_end { SOLVE_DONE = 0, SOLVE_STOPPED, SOLVE_FAILED };

struct solve_outcome { /* owns its texts; the caller frees them */
    enum solve_end end;
    char verdict[JOB_VERDICT_SIZE]; /* DONE only */
    char *report;                   /* DONE only: JSON */
    char *progress;                 /* the last one, JSON; NULL: there was none */
    uint32_t iterations;
    struct problem error; /* FAILED only */
};

/* Blocks until the job is solved, stopped or refused; holds no lock. After SOLVE_DONE the files of the
 * result are in the folder of store_results_begin, synced. */
void solve_job(const struct solve_task *task, struct solve_outcome *ret);

#endif
