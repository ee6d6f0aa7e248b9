/* coarse.c - the first phase of a fine cloth: sews or drapes the coarse one and carries it up; and first
 * looks.
 *
 * The coarse cloth is a scene of its own, with the same bodies and fabrics, and runs as any other. What has
 * to be sewn gets one iteration only, which takes out what sewing strained: its wrinkles would be those of
 * its own mesh, and to begin with them cost a dress of 29 883 triangles a fifth more iterations than to begin
 * without. What hangs from flat, touched by no body, comes to rest: squares of 2000 to 200 000 triangles then
 * take 2 to 5 iterations instead of 13. It may have a coarse cloth itself (nested iteration; Bornemann and
 * Deuflhard, "The cascadic multigrid method", Numer. Math. 75, 1996). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "self.h"
#include "sim.h"

#define ITERATIONS_SEWN 1 /* of draping */
#define ITERATIONS      30
#define TOLERANCE       1e-3 /* or the job's, if that is more: what is left is less than the meshes' difference */

struct run {
    struct drape_sim *sim;
    drape_sim *coarse;
    bool shown; /* as it was sewn */
};

/* ---- what is shown of it ------------------------------------------------------------------------- */

static void show(const struct drape_sim *sim, const double *positions)
{
    const struct dr_coarse *mesh = sim->scene->coarse;
    drape_preview preview = {.vertices = mesh->vertices,
                             .triangles = mesh->triangles,
                             .seams = mesh->seams,
                             .positions = positions,
                             .vertex = mesh->vertex,
                             .triangle = mesh->triangle,
                             .seam = mesh->seam};
    sim->options.preview(&preview, sim->options.preview_data);
}

/* The garment with its seams just closed: stiff, weightless, but round the body. Out of memory: not shown. */
static void show_sewn(const struct drape_sim *sim, const drape_sim *coarse)
{
    const drape_scene *scene = coarse->scene;
    double *x = malloc(3 * scene->mesh->nodes * sizeof *x);
    double *positions = malloc(3 * scene->vertices * sizeof *positions);
    if (x && positions) {
        memcpy(positions, coarse->positions, 3 * scene->vertices * sizeof *positions);
        dr_scene_weld(scene, positions, x);
        dr_scene_unweld(scene, x, positions);
        show(sim, positions);
    }
    free(positions);
    free(x);
}

/* Tells what the coarse cloth does as the job's own progress. */
static int relay(const drape_progress *progress, void *data)
{
    struct run *run = data;
    drape_progress told = *progress;
    bool sewn = progress->phase == DRAPE_PHASE_SEWING && progress->seam_gap <= DR_WELD_GAP;
    if (sewn && !run->shown && run->sim->options.preview) {
        run->shown = true;
        show_sewn(run->sim, run->coarse);
    }
    if (told.phase == DRAPE_PHASE_DRAPING)
        told.phase = DRAPE_PHASE_COARSE;
    told.row.seconds = dr_clock() - run->sim->began;
    dr_sim_tell(run->sim, &told);
    return dr_sim_interrupted(run->sim);
}

void dr_coarse_show(const struct drape_sim *sim, const double *x)
{
    const drape_scene *scene = sim->scene;
    const struct dr_coarse *mesh = scene->coarse;
    double *positions = malloc(3 * mesh->vertices * sizeof *positions);
    for (size_t v = 0; positions && v < mesh->vertices; v++) /* each is a corner, and so of a node */
        memcpy(positions + 3 * v, x + 3 * (size_t)scene->vertex_node[mesh->vertex[v]], 3 * sizeof *x);
    if (positions)
        show(sim, positions);
    free(positions);
}

/* ---- the run ------------------------------------------------------------------------------------- */

static drape_options options_of(struct run *run)
{
    const struct drape_sim *sim = run->sim;
    drape_options options = sim->options;
    options.certify = options.fit = false;
    options.preview = NULL;
    if (sim->plan.pieces.mesh) {
        options.max_iterations = ITERATIONS_SEWN;
    } else {
        options.max_iterations = options.max_iterations < ITERATIONS ? options.max_iterations : ITERATIONS;
        options.tolerance = fmax(options.tolerance, TOLERANCE);
    }
    options.time_limit -= dr_clock() - sim->began;
    options.progress = relay;
    options.progress_data = run;
    return options;
}

/* Edges of the cloth pass through its triangles at these positions of the vertices. */
static drape_status crosses_itself(const struct drape_sim *sim, const double *positions, bool *ret,
                                   drape_error *reterr)
{
    const drape_scene *scene = sim->scene;
    struct dr_self *self = NULL;
    double *x = malloc(3 * scene->mesh->nodes * sizeof *x), unused[3];
    drape_status status =
        x ? dr_self_new(scene->mesh, scene->thickness, &self, reterr) : dr_out_of_memory(reterr);
    if (status >= 0) {
        dr_scene_weld(scene, positions, x);
        *ret = dr_self_crossings(self, x, unused) > 0;
        status = dr_self_error(self, reterr);
    }
    dr_self_free(self);
    free(x);
    return status;
}

/* Whether the coarse cloth is where the fine one may start. */
static bool came_out_well(const struct drape_sim *coarse)
{
    const drape_report *report = &coarse->report;
    return report->verdict != DRAPE_VERDICT_INTERSECTING && report->verdict != DRAPE_VERDICT_SLID_OFF &&
           report->seam_gap <= DR_WELD_GAP;
}

static drape_status carry(struct drape_sim *sim, const struct drape_sim *coarse, bool *ret_carried,
                          drape_error *reterr)
{
    size_t count = 3 * sim->scene->vertices;
    bool crosses = false;
    double *positions = malloc(count * sizeof *positions);
    if (!positions)
        return dr_out_of_memory(reterr);
    memcpy(positions, sim->positions, count * sizeof *positions);
    dr_coarse_carry(sim->scene->coarse, coarse->positions, positions);
    drape_status status = DRAPE_OK;
    if (sim->plan.welded.self)
        status = crosses_itself(sim, positions, &crosses, reterr);
    *ret_carried = status >= 0 && !crosses;
    if (*ret_carried)
        memcpy(sim->positions, positions, count * sizeof *positions);
    free(positions);
    return status;
}

/* Counts for the job what the coarse cloth took. */
static void account(struct drape_sim *sim, const struct drape_sim *coarse)
{
    const drape_report *report = &coarse->report;
    size_t bytes[DR_TERMS] = {[DR_TERM_COARSE] = report->peak_bytes - dr_scene_bytes(coarse->scene)};
    dr_plan_hold(&sim->plan, DRAPE_PHASE_COARSE, bytes);
    sim->report.coarse_triangles = coarse->scene->mesh->triangles;
    sim->report.coarse_iterations = report->iterations + report->coarse_iterations;
    sim->report.coarse_factorizations = report->factorizations + report->coarse_factorizations;
    sim->report.borrowed_seconds += report->borrowed_seconds;
}

drape_status dr_coarse_drape(struct drape_sim *sim, bool *ret_carried, drape_error *reterr)
{
    double began = dr_clock() - sim->scene->coarse_seconds;
    struct run run = {.sim = sim};
    drape_options options = options_of(&run);
    drape_error error; /* of the coarse run, which may fail without harm */
    *ret_carried = false;
    if (!(options.time_limit > 0))
        return DRAPE_OK;
    drape_status status = drape_sim_new(sim->scene->coarse_scene, &options, &run.coarse, reterr);
    if (status < 0)
        return status;
    drape_sim *coarse = run.coarse;
    coarse->held_outside = sim->held_outside + dr_plan_held(&sim->plan) - dr_scene_bytes(coarse->scene);
    status = dr_sim_run(coarse, &error);
    if (status >= 0) {
        account(sim, coarse);
        if (came_out_well(coarse) || dr_sim_interrupted(sim))
            status = carry(sim, coarse, ret_carried, reterr);
    } else if (status == DRAPE_ENUMERIC) {
        status = DRAPE_OK; /* without, then */
    } else if (reterr) {
        *reterr = error;
    }
    if (*ret_carried) {
        sim->report.coarse_carried = true;
        if (!sim->plan.pieces.mesh && sim->options.preview)
            show(sim, coarse->positions);
        sim->report.sewing_iterations = coarse->report.sewing_iterations;
        sim->report.seam_gap = coarse->report.seam_gap;
    }
    drape_sim_free(coarse);
    sim->stage[DR_STAGE_COARSE] = dr_clock() - began;
    return status;
}
