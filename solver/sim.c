/* sim.c - the public face of a run: options, budgets, cancelling, results. */
#include "sim.h"

#include <dlfcn.h>
#include <math.h>
#include <omp.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "front.h"

#define SHORT_FACTORISATION 1.0 /* s: one expected to take no longer always begins */

drape_options drape_options_default(void)
{
    return (drape_options){
        .method = DRAPE_METHOD_AUTO,
        .stop_on = DRAPE_STOP_ON_POTENTIAL,
        .time_step = 0.02,
        .tolerance = 1e-3,
        .max_iterations = 2000,
        .time_limit = 120,
    };
}

bool dr_steps_in_time(const drape_options *options)
{
    return options->method == DRAPE_METHOD_STOP_AND_GO || options->method == DRAPE_METHOD_DYNAMIC ||
           options->method == DRAPE_METHOD_VELOCITY_CORRECTION;
}

drape_status drape_options_check(const drape_options *options, drape_error *reterr)
{
    const char *member = NULL;
    bool damped = options->air_damping != 0 || options->material_damping != 0;
    if (options->method > DRAPE_METHOD_NEWTON)
        member = "method";
    else if (options->stop_on > DRAPE_STOP_ON_KINETIC)
        member = "stop_on";
    else if (options->integrator > DRAPE_RK4)
        member = "integrator";
    else if (!(options->air_damping >= 0 && isfinite(options->air_damping)))
        member = "air_damping";
    else if (!(options->material_damping >= 0 && isfinite(options->material_damping)))
        member = "material_damping";
    else if (damped && (options->integrator != DRAPE_BACKWARD_EULER || !dr_steps_in_time(options)))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_OPTION, -1, -1,
                          options->air_damping != 0 ? "air_damping" : "material_damping",
                          "damping needs backward Euler, by a method that steps in time");
    else if (!(options->time_step >= DRAPE_MIN_TIME_STEP && options->time_step <= DRAPE_MAX_TIME_STEP))
        member = "time_step";
    else if (!(options->tolerance > 0 && isfinite(options->tolerance)))
        member = "tolerance";
    else if (options->max_iterations > DRAPE_MAX_ITERATIONS)
        member = "max_iterations";
    else if (!(options->time_limit > 0 && isfinite(options->time_limit)))
        member = "time_limit";
    return member ? dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_OPTION, -1, -1, member, "out of range")
                  : DRAPE_OK;
}

/* What is wrong with neither alone. */
static drape_status check_together(drape_self_contact self_contact, const drape_options *options,
                                   drape_error *reterr)
{
    if (self_contact == DRAPE_SELF_CONTACT_ON && options->method == DRAPE_METHOD_NEWTON)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "self_contact",
                          "method newton takes its steps whole, through cloth too");
    return DRAPE_OK;
}

drape_status drape_check(const drape_scene_desc *desc, const drape_options *options, drape_error *reterr)
{
    drape_status status = drape_options_check(options, reterr);
    if (status >= 0)
        status = check_together(desc->self_contact, options, reterr);
    return status < 0 ? status : drape_scene_check(desc, reterr);
}

drape_status drape_sim_new(const drape_scene *scene, const drape_options *options, drape_sim **ret,
                           drape_error *reterr)
{
    drape_status status = drape_options_check(options, reterr);
    if (status >= 0)
        status = check_together(scene->self_contact, options, reterr);
    if (status < 0)
        return status;
    drape_sim *sim = calloc(1, sizeof *sim);
    if (sim) {
        sim->positions = malloc(3 * scene->vertices * sizeof *sim->positions);
        sim->row = malloc(((size_t)options->max_iterations + 1) * sizeof *sim->row);
    }
    if (!sim || !sim->positions || !sim->row) {
        drape_sim_free(sim);
        return dr_out_of_memory(reterr);
    }
    if (options->fit && (status = dr_fit_new(scene, &sim->fit, reterr)) < 0) {
        drape_sim_free(sim);
        return status;
    }
    sim->scene = scene;
    sim->options = *options;
    sim->hand.processors = options->processors;
    atomic_init(&sim->cancelled, false);
    memcpy(sim->positions, scene->positions, 3 * scene->vertices * sizeof *sim->positions);
    dr_plan_compile(sim);
    *ret = sim;
    return DRAPE_OK;
}

drape_sim *drape_sim_free(drape_sim *sim)
{
    if (sim) {
        if (sim->fit) /* else not even a call */
            dr_fit_free(sim->fit);
        free(sim->positions);
        free(sim->row);
        free(sim);
    }
    return NULL;
}

/* ---- budgets ------------------------------------------------------------------------------------ */

void drape_sim_cancel(drape_sim *sim)
{
    atomic_store(&sim->cancelled, true);
}

bool dr_sim_interrupted(const struct drape_sim *sim)
{
    return atomic_load(&sim->cancelled) || dr_clock() - sim->began > sim->options.time_limit;
}

/* A factorisation cannot be broken off, but how many operations it takes is known beforehand. How fast
 * they go the last one tells; the first is taken to be as fast as a busy or modest core: CHOLMOD's LL' does
 * 10 to 30 Gflop/s on an idle one, its LDL' 1.2 to 2.6. The factor in single precision may fall back on LL'.
 */
static bool has_time(const struct drape_sim *sim, const struct dr_matrix *A)
{
    static const double cautious[DR_FACTORS] = {[DR_CHOLESKY] = 5e9, [DR_LDL] = 1e9, [DR_SINGLE] = 5e9};
    enum dr_factor factor = dr_matrix_factor(A);
    double rate = sim->factor_rate[factor] > 0 ? sim->factor_rate[factor] : cautious[factor];
    double left = sim->began + sim->options.time_limit - dr_clock();
    return dr_matrix_flops(A) / rate <= fmax(left, SHORT_FACTORISATION);
}

drape_status dr_sim_check_memory(const struct drape_sim *sim, const struct dr_cloth *cloth,
                                 drape_error *reterr)
{
    size_t bytes[DR_TERMS] = {0}, limit = sim->options.memory_limit;
    size_t held = dr_plan_held(&sim->plan) + sim->held_outside;
    if (!limit)
        return DRAPE_OK;
    if (cloth) {
        dr_cloth_bytes(cloth, bytes);
        held += cloth->A ? dr_matrix_bytes_to_come(cloth->A) : 0;
    }
    for (int t = 0; t < DR_TERMS; t++)
        held += bytes[t];
    return held <= limit ? DRAPE_OK
                         : dr_fail_at(reterr, DRAPE_ENOMEM, DRAPE_AT_OPTION, -1, -1, "memory_limit",
                                      "%.1f MB are needed, more than the limit of %.1f MB",
                                      1e-6 * (double)held, 1e-6 * (double)limit);
}

drape_status dr_sim_factorise(struct drape_sim *sim, const struct dr_cloth *cloth, enum dr_factored *ret,
                              drape_error *reterr)
{
    struct dr_matrix *A = cloth->A;
    bool out_of_memory = false;
    *ret = DR_NO_TIME;
    drape_status status = dr_sim_check_memory(sim, cloth, reterr);
    if (status < 0 || !has_time(sim, A))
        return status;
    double began = dr_clock();
    bool definite = dr_matrix_factorise(A, &out_of_memory);
    if (dr_matrix_in_doubt(A)) { /* which takes the memory of a factor in double */
        status = dr_sim_check_memory(sim, cloth, reterr);
        if (status < 0)
            return status;
        definite = dr_matrix_factorise(A, &out_of_memory);
    }
    sim->report.factorizations++;
    if (out_of_memory)
        return dr_out_of_memory(reterr);
    if (definite) /* else it stopped on the way */
        sim->factor_rate[dr_matrix_factor(A)] = dr_matrix_flops(A) / (dr_clock() - began);
    *ret = definite ? DR_FACTORED : DR_NOT_DEFINITE;
    return DRAPE_OK;
}

void dr_sim_tell(struct drape_sim *sim, const drape_progress *progress)
{
    if (sim->options.progress && sim->options.progress(progress, sim->options.progress_data))
        drape_sim_cancel(sim);
}

/* ---- running ------------------------------------------------------------------------------------ */

static void report_stages(struct drape_sim *sim)
{
    static const char *const name[DR_STAGES] = {
        [DR_STAGE_PREPARE] = "prepare",
        [DR_STAGE_SEW] = "sew",
        [DR_STAGE_COARSE] = "coarse",
        [DR_STAGE_FOLLOW] = "motion",
        [DR_STAGE_ASSEMBLE] = "assemble",
        [DR_STAGE_FACTORISE] = "factorise",
        [DR_STAGE_SOLVE] = "solve",
        [DR_STAGE_MOVE] = "move",
        [DR_STAGE_CERTIFY] = "certify",
        [DR_STAGE_BROAD_PHASE] = "broad-phase",
        [DR_STAGE_NARROW_PHASE] = "narrow-phase",
    };
    _Static_assert(DR_STAGES <= DRAPE_MAX_STAGES, "the report has room for every stage");
    for (int i = 0; i < DR_STAGES; i++)
        sim->report.stage[sim->report.stages++] = (drape_stage){name[i], sim->stage[i]};
}

drape_status dr_sim_run(drape_sim *sim, drape_error *reterr)
{
    const drape_scene *scene = sim->scene;
    drape_status status = DRAPE_OK;
    bool carried = false;
    double *x = malloc(3 * scene->mesh->nodes * sizeof *x);
    if (!x)
        return dr_out_of_memory(reterr);
    omp_set_max_active_levels(0); /* see drape_sim_run in drape.h */
    sim->began = dr_clock();
    if (sim->plan.term[DR_TERM_COARSE].kept) {
        sim->began -= scene->coarse_seconds; /* which only this run needed */
        status = dr_coarse_drape(sim, &carried, reterr);
    }
    if (status >= 0 && sim->plan.pieces.mesh && !carried)
        status = dr_sew(sim, reterr);
    if (status >= 0) {
        dr_scene_weld(scene, sim->positions, x);
        if (sim->plan.moved.mesh)
            status = dr_move(sim, x, reterr);
    }
    if (status >= 0)
        status = dr_relax(sim, x, reterr);
    if (status >= 0) {
        dr_scene_unweld(scene, x, sim->positions);
        sim->report.change = scene->change;
        sim->report.seconds = dr_clock() - sim->began;
        sim->report.borrowed_seconds += sim->hand.seconds;
        report_stages(sim);
        dr_plan_report(&sim->plan, &sim->report);
        if (atomic_load(&sim->cancelled))
            status = DRAPE_CANCELLED;
        else if (sim->report.verdict != DRAPE_VERDICT_AT_REST)
            status = DRAPE_NOT_AT_REST;
    }
    free(x);
    return status;
}

drape_status drape_sim_run(drape_sim *sim, drape_error *reterr)
{
    if (sim->options.processors)
        dr_processors_enter(sim->options.processors);
    drape_status status = dr_sim_run(sim, reterr);
    if (sim->options.processors)
        dr_processors_leave(sim->options.processors);
    return status;
}

const drape_report *drape_sim_report(const drape_sim *sim)
{
    return &sim->report;
}

const drape_row *drape_sim_trace(const drape_sim *sim, size_t *ret_rows)
{
    *ret_rows = sim->rows;
    return sim->row;
}

const double *drape_sim_positions(const drape_sim *sim, size_t *ret_vertices)
{
    *ret_vertices = sim->scene->vertices;
    return sim->positions;
}

const drape_fit *drape_sim_fit(const drape_sim *sim)
{
    return sim->fit ? dr_fit_result(sim->fit) : NULL;
}

/* ---- about the library -------------------------------------------------------------------------- */

const char *drape_version(void)
{
    return "0.1.0";
}

const char *drape_kernels(void)
{
    return dr_front_kernels();
}

const char *drape_blas_prepare(void)
{
    /* Looked up at run time, so that any BLAS will do; only OpenBLAS needs to be told. */
    void (*set_threads)(int) = (void (*)(int))dlsym(RTLD_DEFAULT, "openblas_set_num_threads");
    char *(*core_name)(void) = (char *(*)(void))dlsym(RTLD_DEFAULT, "openblas_get_corename");
    if (set_threads)
        set_threads(1);
    return core_name ? core_name() : "unknown";
}
