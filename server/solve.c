/* solve.c - see solve.h. */
#include "solve.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"
#include "drape.h"
#include "fields.h"
#include "jsonout.h"
#include "meshref.h"
#include "output.h"
#include "schema.h"
#include "start.h"

struct run {
    const struct solve_task *task;
    struct solve_outcome *outcome;
    struct job_spec *spec;
    drape_scene *scene;
    drape_sim *sim;
    drape_progress last;
    bool has_progress;
    int64_t reported_ms; /* monotonic; 0: not yet */
};

static int on_progress(const drape_progress *progress, void *data)
{
    struct run *run = data;
    int64_t now = clock_monotonic_ms();
    run->last = *progress;
    run->has_progress = true;
    if (run->reported_ms == 0 || now - run->reported_ms >= SOLVE_PROGRESS_MS) {
        char *json = jsonout_text(schema_progress_json(progress, &run->spec->options));
        run->reported_ms = now;
        if (json != NULL)
            run->task->progress(json, run->task->data);
    }
    return atomic_load(run->task->stop);
}

/* Without memory there is no preview, and the drape goes on. */
static void on_preview(const drape_preview *preview, void *data)
{
    struct run *run = data;
    size_t bytes;
    char *glb = run->task->preview != NULL ? output_preview(run->spec, preview, &bytes) : NULL;
    if (glb != NULL)
        run->task->preview(glb, bytes, run->task->data);
}

static int load(struct run *run, struct problem *reterr)
{
    const struct solve_task *task = run->task;
    struct meshref meshref = {task->store, task->owner, task->limits, NULL};
    char *text;
    size_t bytes;
    if (store_job_document(task->store, task->id, &text, &bytes, reterr) != 0)
        return -1;
    int failed = schema_job_parse(text, bytes, task->limits, meshref_load, &meshref, &run->spec, reterr);
    free(text);
    if (!failed && run->spec->start_from[0] != '\0')
        failed = start_load(&meshref, task->id, run->spec, reterr);
    return failed;
}

/* Gives each mesh among the bodies its field; share_done gives back what there is of them. */
static drape_status share_fields(struct run *run, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    for (size_t b = 0; run->task->fields && b < run->spec->scene.bodies && status >= 0; b++) {
        drape_body last = run->spec->body[b];
        if (last.kind != DRAPE_BODY_MESH)
            continue;
        if (last.keyframes)
            last.positions = last.keyframe[last.keyframes - 1];
        status =
            fields_get(run->task->fields, &last, b, run->task->processors, &run->spec->body[b].field, reterr);
    }
    return status;
}

static void share_done(struct run *run)
{
    for (size_t b = 0; b < run->spec->scene.bodies; b++)
        run->spec->body[b].field = drape_field_unref(run->spec->body[b].field);
}

/* The drape_status of the run, or a negative one with *reterr filled. */
static drape_status drape(struct run *run, struct problem *reterr)
{
    drape_error error;
    drape_options options = run->spec->options;
    options.progress = on_progress;
    options.progress_data = run;
    options.preview = on_preview;
    options.preview_data = run;
    options.analyses = run->task->analyses;
    options.processors = run->task->processors;
    options.memory_limit = run->task->limits->job_memory;
    if (run->spec->scene.coarse == DRAPE_COARSE_AUTO && options.method != DRAPE_METHOD_AUTO)
        run->spec->scene.coarse = DRAPE_COARSE_SEWN;
    drape_status status = share_fields(run, &error);
    if (status >= 0)
        status = drape_scene_new(&run->spec->scene, &run->scene, &error);
    share_done(run); /* the scene has its own references */
    if (status >= 0)
        status = drape_sim_new(run->scene, &options, &run->sim, &error);
    if (status >= 0 && atomic_load(run->task->stop))
        return DRAPE_CANCELLED;
    if (status >= 0)
        status = drape_sim_run(run->sim, &error);
    if (status < 0)
        schema_solver_problem(&error, reterr);
    return status;
}

/* The lengths of the lines the job names; JSON null where it names none. */
static int measure_lines(const struct run *run, const double *positions, json_t **ret)
{
    const struct lines *lines = run->spec->lines;
    *ret = NULL;
    if (lines == NULL)
        return 0;
    struct line_length *length = calloc(lines->count, sizeof *length);
    if (length != NULL && lines_measure(lines, &run->spec->scene, positions, length) == 0)
        *ret = schema_lines_json(lines, length);
    free(length);
    return *ret != NULL ? 0 : -1;
}

static int write_results(struct run *run, struct problem *reterr)
{
    const struct solve_task *task = run->task;
    const drape_report *report = drape_sim_report(run->sim);
    size_t rows, vertices;
    const drape_row *row = drape_sim_trace(run->sim, &rows);
    const double *positions = drape_sim_positions(run->sim, &vertices);
    int dirfd;
    snprintf(run->outcome->verdict, sizeof run->outcome->verdict, "%s", drape_verdict_name(report->verdict));
    run->outcome->iterations = report->iterations;
    json_t *lines;
    if (measure_lines(run, positions, &lines) == 0)
        run->outcome->report = jsonout_text(schema_report_json(report, lines));
    if (run->outcome->report == NULL)
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    if (store_results_begin(task->store, task->id, task->attempt, &dirfd, reterr) != 0)
        return -1;
    int failed =
        output_write(dirfd, run->spec, report, positions, drape_sim_fit(run->sim), row, rows, reterr);
    close(dirfd);
    return failed;
}

void solve_job(const struct solve_task *task, struct solve_outcome *ret)
{
    struct run run = {.task = task, .outcome = ret};
    memset(ret, 0, sizeof *ret);
    ret->end = SOLVE_FAILED;
    if (load(&run, &ret->error) != 0)
        goto cleanup;
    drape_status status = drape(&run, &ret->error);
    if (run.has_progress)
        ret->progress = jsonout_text(schema_progress_json(&run.last, &run.spec->options));
    if (status == DRAPE_CANCELLED)
        ret->end = SOLVE_STOPPED;
    else if (status >= 0 && write_results(&run, &ret->error) == 0)
        ret->end = SOLVE_DONE;

cleanup:
    drape_sim_free(run.sim);
    drape_scene_free(run.scene);
    job_spec_free(run.spec);
}
