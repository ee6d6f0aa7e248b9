/* relax.c - the drape itself: drives a method from state to state, decides stops, rest and the end
 * [VMT07]. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "certify.h"
#include "error.h"
#include "ramp.h"

#define LONGEST_MOVE 0.02 /* m per node and step where there are bodies */
#define EPOCH        15   /* iterations that friction's anchors stay, unless a stop or rest renews them */
#define SHORT_EPOCH  2    /* of methods without stops */
#define HELD         0.1  /* of the tolerance: how closely a drape's load is held where it starts again */
#define SUNK         1e-3 /* m inside a body from which the verdict is "intersecting" */

/* ---- what methods share -------------------------------------------------------------------------- */

/* Makes the arrays that the method wants and that are not there yet. */
static bool allocate(struct dr_state *s)
{
    double **array[5 + 1 + DR_MAX_EXTRA] = {&s->f, &s->w, &s->x_next, &s->f_next, &s->best};
    size_t count = 5, nodes = s->sim->plan.welded.mesh->nodes;
    if (s->method->moves)
        array[count++] = &s->v;
    for (unsigned i = 0; i < s->method->extra; i++)
        array[count++] = &s->extra[i];
    for (size_t i = 0; i < count; i++)
        if (!*array[i] && !(*array[i] = calloc(3 * nodes, sizeof(double))))
            return false;
    return true;
}

drape_status dr_state_hand_over(struct dr_state *s, const struct dr_method *method, drape_error *reterr)
{
    s->method = method;
    if (method->moves)
        dr_plan_keep(&s->sim->plan, DR_TERM_VELOCITIES);
    for (size_t i = 0; i < DR_MAX_EXTRA; i++)
        if (s->extra[i])
            memset(s->extra[i], 0, 3 * s->sim->plan.welded.mesh->nodes * sizeof *s->extra[i]);
    if (!allocate(s))
        return dr_out_of_memory(reterr);
    return method->matrix == DR_MATRIX_CHOLESKY ? dr_cloth_make_exact(s->cloth, true, reterr) : DRAPE_OK;
}

drape_status dr_state_factorise(struct dr_state *s, double indefinite, bool *ret_definite,
                                drape_error *reterr)
{
    struct drape_sim *sim = s->sim;
    enum dr_factored factored;
    double began = dr_clock();
    drape_status status = dr_cloth_assemble(s->cloth, s->x, indefinite, reterr);
    if (status < 0)
        return status;
    double assembled = dr_clock();
    status = dr_sim_factorise(sim, s->cloth, &factored, reterr);
    s->row.factorizations += factored != DR_NO_TIME;
    sim->report.work.factor_flops += factored != DR_NO_TIME ? dr_matrix_flops(s->cloth->A) : 0;
    sim->stage[DR_STAGE_ASSEMBLE] += assembled - began;
    sim->stage[DR_STAGE_FACTORISE] += dr_clock() - assembled;
    *ret_definite = factored == DR_FACTORED;
    if (factored == DR_NO_TIME && status >= 0) {
        s->row.residual_energy = NAN;
        s->gave_up = s->row.iteration ? "the time limit leaves too little for another iteration"
                                      : "the time limit is too short for one iteration";
    }
    return status;
}

drape_status dr_state_solve(struct dr_state *s, size_t count, const double *const b[], double *const w[],
                            drape_error *reterr)
{
    double began = dr_clock();
    bool solved = dr_matrix_solve(s->cloth->A, count, b, w);
    s->sim->report.solves += (uint32_t)count;
    s->sim->report.work.solve_bytes += 2 * (double)dr_matrix_factor_bytes(s->cloth->A);
    s->sim->stage[DR_STAGE_SOLVE] += dr_clock() - began;
    return solved ? DRAPE_OK : dr_out_of_memory(reterr);
}

double dr_state_dot(const struct dr_state *s, const double *a, const double *b)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    long double sum = 0;
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        if (!mesh->held[i / 3])
            sum += a[i] * b[i];
    return (double)sum;
}

void dr_state_limit(struct dr_state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    if (!s->cloth->contact && !s->cloth->self)
        return;
    for (size_t i = 0; i < mesh->nodes; i++) {
        double *move = s->w + 3 * i;
        double length = sqrt(move[0] * move[0] + move[1] * move[1] + move[2] * move[2]);
        if (length > LONGEST_MOVE)
            for (int d = 0; d < 3; d++)
                move[d] *= LONGEST_MOVE / length;
    }
    if (s->cloth->contact)
        dr_contact_clip(s->cloth->contact, s->x, s->w, DR_CONTACT_DEPTH);
    if (s->cloth->self)
        dr_self_clip(s->cloth->self, s->x, s->w);
}

double dr_state_kinetic(const struct dr_state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    long double sum = 0;
    for (size_t i = 0; i < mesh->nodes; i++) {
        const double *v = s->v + 3 * i;
        sum += 0.5 * mesh->mass[i] * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    }
    return (double)sum;
}

void dr_state_arrive(struct dr_state *s, const drape_energies *energy)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    long double work = 0;
    for (size_t i = 0; i < count; i++)
        work += 0.5 * (s->f[i] + s->f_next[i]) * s->w[i];
    s->work = (double)work;
    if (s->cloth->stress)
        dr_cloth_stress(s->cloth, s->x, s->w);
    memcpy(s->x, s->x_next, count * sizeof *s->x);
    memcpy(s->f, s->f_next, count * sizeof *s->f);
    s->previous_potential = s->row.energy.potential;
    s->previous_kinetic = s->row.stop ? 0 : s->row.energy.kinetic;
    s->row.energy = *energy;
    s->row.energy.kinetic = s->v ? dr_state_kinetic(s) : 0;
    s->moving = s->v != NULL;
    s->fresh = false;
}

/* ---- rest and stops ------------------------------------------------------------------------------ */

/* The potential energy rose over the last step. Near rest the difference of two energies is noise, the
 * work of the forces is not. */
static bool potential_rose(const struct dr_state *s)
{
    const drape_energies *e = &s->row.energy;
    double size = e->stretch + e->bend + e->contact + fabs(e->gravity);
    double rise = e->potential - s->previous_potential;
    return fabs(rise) > 1e-9 * size ? rise > 0 : s->work < 0;
}

/* Whether the velocities are cut to zero at the state just reached. */
static bool stop_here(const struct dr_state *s)
{
    const drape_report *report = &s->sim->report;
    if (report->method != DRAPE_METHOD_STOP_AND_GO || !s->moving)
        return false;
    if (report->stop_on == DRAPE_STOP_ON_KINETIC)
        return s->row.energy.kinetic < s->previous_kinetic;
    return potential_rose(s);
}

static void stop_or_go(struct dr_state *s)
{
    s->row.stop = stop_here(s);
    if (!s->row.stop)
        return;
    memset(s->v, 0, 3 * s->cloth->mesh->nodes * sizeof *s->v);
    s->moving = false;
    s->fresh = true;
    s->sim->report.stops++;
}

/* The force that would stop the fastest node within one time step, N. */
static double largest_inertia(const struct dr_state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    double largest = 0;
    for (size_t i = 0; i < mesh->nodes; i++) {
        const double *v = s->v + 3 * i;
        largest = fmax(largest, mesh->mass[i] * sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]));
    }
    return largest / s->sim->options.time_step;
}

/* Rest is a matter of forces. Where nothing ever stops the whole cloth it must also have lost its momentum:
 * passing an equilibrium at speed is not rest, so M v/dt has to be as small. */
static bool at_rest(const struct dr_state *s)
{
    double tolerance = s->sim->options.tolerance;
    if (!(s->row.residual_force <= tolerance))
        return false;
    bool stops = !s->v || s->sim->report.method == DRAPE_METHOD_STOP_AND_GO;
    return stops || largest_inertia(s) <= tolerance * s->weight;
}

/* The potential energy is higher than where the run began. Friction's share came with its anchors. */
static bool above_start(const struct dr_state *s)
{
    const drape_energies *e = &s->row.energy;
    double size = e->stretch + e->bend + e->contact + fabs(e->gravity);
    return e->potential - dr_cloth_held(s->cloth, s->x) > s->sim->row[0].energy.potential + 1e-9 * size;
}

/* False without gravity. */
static bool find_up(const struct dr_state *s, double up[3])
{
    const double *g = s->cloth->gravity;
    double size = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
    if (size == 0)
        return false;
    for (int d = 0; d < 3; d++)
        up[d] = -g[d] / size;
    return true;
}

/* How high the highest node of one part is. */
static double top_of(const drape_scene *scene, size_t part, const double up[3], const double *x)
{
    double top = -INFINITY;
    for (size_t i = 0; i < scene->mesh->nodes; i++)
        if (scene->part[i] == part)
            top = fmax(top, up[0] * x[3 * i] + up[1] * x[3 * i + 1] + up[2] * x[3 * i + 2]);
    return top;
}

/* A piece that no pin holds has fallen below every body. */
static bool slid_off(const struct dr_state *s)
{
    const drape_scene *scene = s->sim->scene;
    double up[3], lowest = INFINITY;
    if (!scene->bodies || !find_up(s, up))
        return false;
    for (size_t b = 0; b < scene->bodies; b++)
        lowest = fmin(lowest, dr_body_support_min(scene->body[b], up) - dr_body_offset(scene->body[b]));
    if (!(lowest > -INFINITY))
        return false;
    for (size_t p = 0; p < scene->parts; p++)
        if (!scene->part_held[p] && top_of(scene, p, up, s->x) < lowest)
            return true;
    return false;
}

/* How much lower than at the start the top of a piece that no pin holds is, at most. */
static double farthest_drop(const struct dr_state *s)
{
    const drape_scene *scene = s->sim->scene;
    double up[3], farthest = 0;
    for (size_t p = 0; find_up(s, up) && p < scene->parts; p++)
        if (!scene->part_held[p])
            farthest = fmax(farthest, top_of(scene, p, up, s->cloth->start) - top_of(scene, p, up, s->x));
    return farthest;
}

/* ---- the run ------------------------------------------------------------------------------------- */

/* Completes this state's row, adds it to the trace, and tells the caller. A function of its own, so that
 * what the trace costs can be counted (tests/counts). */
static __attribute__((noinline)) void record(struct dr_state *s)
{
    struct drape_sim *sim = s->sim;
    s->row.seconds = dr_clock() - sim->began;
    sim->row[sim->rows++] = s->row;
    uint32_t k = s->row.iteration;
    bool seen = k <= s->carried; /* as the coarse cloth, or as posted */
    if (sim->options.preview && sim->scene->coarse && !seen && !(k & (k - 1))) /* a power of two */
        dr_coarse_show(sim, s->x);
    dr_sim_tell(sim, &(drape_progress){DRAPE_PHASE_DRAPING, s->row, sim->report.stops, 0});
}

/* Notes the state to return should no later one come to rest. Energies are comparable as long as friction's
 * anchors stay; the first state with new ones is kept unless it is worse than the start. */
static void keep_best(struct dr_state *s)
{
    bool renewed = dr_cloth_has_anchors(s->cloth) && s->anchored == s->row.iteration;
    double bound = renewed ? s->sim->row[0].energy.potential : s->best_row.energy.potential;
    if (s->row.iteration && !(s->row.energy.potential < bound))
        return;
    memcpy(s->best, s->x, 3 * s->cloth->mesh->nodes * sizeof *s->best);
    s->best_row = s->row;
}

/* Why the run ends at this state, with the verdict so far; NULL: it goes on. */
static const char *ending(const struct dr_state *s, drape_verdict *ret_verdict)
{
    const struct drape_sim *sim = s->sim;
    *ret_verdict = DRAPE_VERDICT_NOT_AT_REST;
    if (!sim->options.max_iterations)
        return "only the start was evaluated";
    if (s->row.iteration && at_rest(s)) {
        if (above_start(s)) /* where Newton, say, found the cloth standing up */
            return "an equilibrium above the start is not a minimum";
        if (s->cloth->self && dr_self_crowded(s->cloth->self))
            return "more cloth lies in one place than self-contact keeps apart";
        *ret_verdict = DRAPE_VERDICT_AT_REST;
        return "the residual force is within the tolerance";
    }
    if (slid_off(s)) {
        *ret_verdict = DRAPE_VERDICT_SLID_OFF;
        return "a piece that no pin holds fell below every body";
    }
    if (atomic_load(&sim->cancelled))
        return "cancelled";
    if (s->gave_up)
        return s->gave_up;
    if (s->row.iteration == sim->options.max_iterations)
        return "the iterations ran out";
    if (s->row.iteration && dr_sim_interrupted(sim)) /* a first iteration that had time to begin is made */
        return "the time limit ran out";
    return NULL;
}

void dr_state_hold(struct dr_state *s, drape_phase phase, size_t certificate)
{
    size_t array = 3 * s->cloth->mesh->nodes * sizeof(double), bytes[DR_TERMS] = {0};
    bool conjugate = s->sim->plan.term[DR_TERM_CONJUGATE_GRADIENTS].kept;
    bytes[DR_TERM_STATE] = 5 * array;
    bytes[DR_TERM_CERTIFICATE] = certificate;
    bytes[DR_TERM_VELOCITIES] = (s->v != NULL) * array;
    for (size_t i = 0; i < DR_MAX_EXTRA; i++)
        bytes[conjugate ? DR_TERM_CONJUGATE_GRADIENTS : DR_TERM_VELOCITIES] += (s->extra[i] != NULL) * array;
    if (s->gaps)
        bytes[DR_TERM_CONTACT] += dr_gaps_bytes(s->gaps);
    dr_cloth_bytes(s->cloth, bytes);
    if (phase == DRAPE_PHASE_CERTIFYING && s->method->matrix == DR_MATRIX_PRECONDITIONER) {
        bytes[DR_TERM_CERTIFICATE] += bytes[DR_TERM_JACOBIAN]; /* exact: draping's is given back */
        bytes[DR_TERM_JACOBIAN] = 0;
    }
    dr_plan_hold(&s->sim->plan, phase, bytes);
}

/* Leaves the state to return in s->x and describes it. */
static void conclude(struct dr_state *s, drape_verdict verdict, const char *reason)
{
    drape_report *report = &s->sim->report;
    const struct dr_mesh *mesh = s->cloth->mesh;
    report->iterations = s->row.iteration;
    report->state = s->row;
    if (verdict != DRAPE_VERDICT_AT_REST) {
        memcpy(s->x, s->best, 3 * mesh->nodes * sizeof *s->x);
        report->state = s->best_row;
    }
    if (verdict == DRAPE_VERDICT_SLID_OFF)
        report->drop = farthest_drop(s);
    report->self_intersections = DRAPE_NOT_COUNTED;
    for (int d = 0; d < 3; d++)
        report->intersection[d] = NAN;
    if (s->cloth->contact)
        report->penetrations =
            dr_contact_penetrations(s->cloth->contact, s->x, &report->deepest, report->intersection);
    if (report->deepest > SUNK) {
        verdict = DRAPE_VERDICT_INTERSECTING;
        reason = "a node ended deeper than 1 mm inside a body";
    }
    if (s->cloth->self) {
        double at[3], *stage = s->sim->stage;
        dr_self_seconds(s->cloth->self, stage + DR_STAGE_BROAD_PHASE, stage + DR_STAGE_NARROW_PHASE);
        report->self_intersections = (uint32_t)dr_self_crossings(s->cloth->self, s->x, at);
        if (report->self_intersections && verdict != DRAPE_VERDICT_INTERSECTING) {
            verdict = DRAPE_VERDICT_INTERSECTING;
            reason = "the cloth passes through itself";
            memcpy(report->intersection, at, sizeof at);
        }
    }
    report->verdict = verdict;
    report->reason = reason;
    report->reference_rows = report->certificate.certified && !dr_cloth_has_anchors(s->cloth);
    for (size_t i = 0; report->reference_rows && i < s->sim->rows; i++) {
        drape_row *row = s->sim->row + i; /* E* is known now */
        row->residual_energy = row->energy.potential - s->row.energy.potential;
    }
    report->nodes = mesh->nodes;
    report->free_nodes = 0;
    for (size_t i = 0; i < mesh->nodes; i++)
        report->free_nodes += !mesh->held[i];
    report->triangles = mesh->triangles;
}

/* *ret_escaped: the run goes on from below a saddle. */
static drape_status certify(struct dr_state *s, drape_verdict verdict, bool *ret_escaped, drape_error *reterr)
{
    drape_certificate *certificate = &s->sim->report.certificate;
    certificate->reason = NULL;
    certificate->largest_move = certificate->energy_left = NAN;
    if (verdict != DRAPE_VERDICT_AT_REST) {
        certificate->reason = "the drape is not at rest";
        return DRAPE_OK;
    }
    drape_status status = dr_certify(s, ret_escaped, reterr);
    if (status < 0 || !*ret_escaped)
        return status;
    memcpy(s->best, s->x, 3 * s->cloth->mesh->nodes * sizeof *s->best);
    s->best_row = s->row;
    if (s->v)
        memset(s->v, 0, 3 * s->cloth->mesh->nodes * sizeof *s->v);
    s->moving = false;
    s->fresh = true;
    s->row.iteration++;
    return DRAPE_OK;
}

/* Renews friction's anchors at each stop, now and then between, and before anything is called rest: a load is
 * held when the forces balance with anchors that have just been taken. */
static void renew_anchors(struct dr_state *s)
{
    bool due = s->row.stop || s->row.iteration < EPOCH ||
               s->row.iteration - s->anchored >= (s->v ? EPOCH : SHORT_EPOCH) ||
               s->row.residual_force <= s->sim->options.tolerance;
    if (!due || !dr_cloth_has_anchors(s->cloth))
        return;
    double kinetic = s->row.energy.kinetic;
    dr_cloth_renew_anchors(s->cloth, s->x);
    if (!s->row.iteration && s->sim->scene->draped)
        dr_cloth_brace_anchors(s->cloth, s->x, s->f, HELD * s->sim->options.tolerance * s->weight);
    dr_cloth_energy(s->cloth, s->x, &s->row.energy, s->f);
    s->row.energy.kinetic = kinetic;
    s->row.residual_force = dr_cloth_largest_force(s->cloth, s->f) / s->weight;
    s->anchored = s->row.iteration;
}

static drape_status iterate(struct dr_state *s, drape_error *reterr)
{
    for (;;) {
        if ((s->cloth->self && dr_self_error(s->cloth->self, reterr) < 0) ||
            dr_sim_check_memory(s->sim, s->cloth, reterr) < 0)
            return DRAPE_ENOMEM;
        s->row.residual_force = dr_cloth_largest_force(s->cloth, s->f) / s->weight;
        if (!isfinite(s->row.residual_force) || !isfinite(s->row.energy.potential + s->row.energy.kinetic)) {
            if (!s->row.iteration)
                return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                               "the start has no finite energy");
            s->row.iteration--; /* that state is not one */
            dr_state_hold(s, DRAPE_PHASE_DRAPING, 0);
            conclude(s, DRAPE_VERDICT_NOT_AT_REST, "the energy grew past every bound");
            return DRAPE_OK;
        }
        stop_or_go(s);
        renew_anchors(s);
        if (s->sim->report.method == DRAPE_METHOD_VELOCITY_CORRECTION)
            dr_state_correct(s);
        drape_status status = s->method->assess(s, reterr);
        if (status < 0)
            return status;
        record(s);
        keep_best(s);
        s->row.factorizations = 0;
        drape_verdict verdict;
        const char *reason = ending(s, &verdict);
        if (reason) {
            bool escaped = false;
            dr_state_hold(s, DRAPE_PHASE_DRAPING, 0); /* the certificate may exchange the matrix */
            if (s->sim->options.certify)
                status = certify(s, verdict, &escaped, reterr);
            if (status >= 0 && !escaped)
                conclude(s, verdict, reason);
            if (status < 0 || !escaped)
                return status;
            continue;
        }
        s->row.linear_iterations = 0;
        status = s->method->advance(s, reterr);
        if (status < 0)
            return status;
        s->row.iteration++;
    }
}

/* The first row of a run that goes on from the coarse drape at s->x: that of the job's own start, from where
 * gravity's energy and every drop are told. */
static void record_start(struct dr_state *s, double *start)
{
    double *x = s->x;
    s->x = start;
    dr_cloth_energy(s->cloth, s->x, &s->row.energy, s->f);
    s->row.residual_force = dr_cloth_largest_force(s->cloth, s->f) / s->weight;
    s->row.residual_energy = NAN;
    record(s);
    keep_best(s);
    s->x = x;
    s->carried = true;
    s->row.iteration++;
}

static void release(struct dr_state *s)
{
    double *array[] = {s->f, s->v, s->w, s->x_next, s->f_next, s->best};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        free(array[i]);
    for (size_t i = 0; i < DR_MAX_EXTRA; i++)
        free(s->extra[i]);
    dr_gaps_free(s->gaps);
    dr_cloth_free(s->cloth);
}

drape_status dr_relax(struct drape_sim *sim, double *x, drape_error *reterr)
{
    double began = dr_clock();
    struct dr_state s = {.sim = sim, .x = x, .method = sim->plan.method, .fresh = true};
    double *start = x;
    s.row.time_step = sim->options.time_step;
    drape_status status = allocate(&s) ? DRAPE_OK : dr_out_of_memory(reterr);
    if (status >= 0 && sim->report.coarse_carried && !sim->plan.pieces.mesh) {
        start = malloc(3 * sim->scene->mesh->nodes * sizeof *start);
        status = start ? DRAPE_OK : dr_out_of_memory(reterr);
    }
    if (status >= 0 && start != x)
        dr_scene_weld(sim->scene, sim->scene->positions, start);
    if (status >= 0)
        status = dr_cloth_new(&sim->plan.welded, start, &s.cloth, reterr);
    if (status >= 0 && s.method->gaps)
        status = dr_gaps_new(s.cloth->contact, s.cloth->self, &s.gaps, reterr);
    if (status >= 0) {
        s.weight = dr_cloth_mean_weight(s.cloth);
        if (sim->plan.term[DR_TERM_RAMP].kept)
            status = dr_ramp(&s, reterr);
    }
    if (status >= 0 && start != x)
        record_start(&s, start);
    if (start != x)
        free(start);
    if (status >= 0) {
        dr_cloth_energy(s.cloth, x, &s.row.energy, s.f);
        if (s.cloth->stress)
            dr_cloth_stress(s.cloth, x, NULL);
        sim->stage[DR_STAGE_PREPARE] = dr_clock() - began;
        status = iterate(&s, reterr);
    }
    if (status >= 0 && s.cloth->self) /* the last state may be wrong already */
        status = dr_self_error(s.cloth->self, reterr);
    if (status >= 0 && sim->fit)
        dr_fit_measure(sim->fit, s.cloth, x);
    release(&s);
    return status;
}
