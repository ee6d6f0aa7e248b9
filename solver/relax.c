/* relax.c - the drape itself: implicit dynamics, cut to rest at each stop [VMT07].
 *
 * One iteration is a backward Euler step with one linear solve ([VMT07] eq. 1 rearranged: with H the
 * positive semi-definite Hessian, f the force and v the velocity at x)
 *
 *     A w = f + M v/dt,   A = M/dt^2 + H,   x += w,   v = w/dt,
 *
 * which descends the incremental potential E(x + w) + |w - v dt|^2_M / (2 dt^2). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "sim.h"

#define CONTACT_DEPTH 0.002 /* m below a body's surface that one step may end: nothing tunnels */
#define LONGEST_MOVE  0.02  /* m per node and step where there are bodies; see contact.h */
#define MOST_HALVINGS 10    /* of a step that raises the incremental potential */
#define SUNK          1e-3  /* m inside a body from which the verdict is "intersecting" */

/* Everything one run moves. Arrays are 3*nodes. */
struct state {
    struct drape_sim *sim;
    struct dr_cloth *cloth;
    double *x, *v, *f;       /* where we are */
    double *inertia;         /* M v/dt, N */
    double *w, *w_inertia;   /* A^-1 f and A^-1 M v/dt; then w is the step */
    double *x_next, *f_next; /* where the step leads */
    double *best;            /* lowest potential energy seen */
    drape_row best_row;
    drape_row row;
    double weight;                               /* N: what residual_force is relative to */
    double previous_potential, previous_kinetic; /* J, one iteration back */
    double work; /* J: work of the potential forces over the last step, by the trapezoid rule */
    bool moving; /* velocities may be nonzero */
};

static bool allocate(struct state *s, size_t nodes)
{
    double **array[] = {&s->v, &s->f, &s->inertia, &s->w, &s->w_inertia, &s->x_next, &s->f_next, &s->best};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        if (!(*array[i] = calloc(3 * nodes, sizeof(double))))
            return false;
    return true;
}

static void release(struct state *s)
{
    double *array[] = {s->v, s->f, s->inertia, s->w, s->w_inertia, s->x_next, s->f_next, s->best};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        free(array[i]);
    dr_cloth_free(s->cloth);
}

static size_t state_bytes(const struct state *s)
{
    return dr_cloth_bytes(s->cloth) + 9 * 3 * s->cloth->mesh->nodes * sizeof(double);
}

/* ---- rest and stops ----------------------------------------------------------------------------- */

static double kinetic_energy(const struct dr_mesh *mesh, const double *v)
{
    long double sum = 0;
    for (size_t i = 0; i < mesh->nodes; i++) {
        const double *vi = v + 3 * i;
        sum += 0.5 * mesh->mass[i] * (vi[0] * vi[0] + vi[1] * vi[1] + vi[2] * vi[2]);
    }
    return (double)sum;
}

/* The potential energy rose over the last step. Near rest the difference of two energies is noise, the
 * work of the forces is not. */
static bool potential_rose(const struct state *s)
{
    const drape_energies *e = &s->row.energy;
    double size = e->stretch + e->bend + e->contact + fabs(e->gravity);
    double rise = e->potential - s->previous_potential;
    return fabs(rise) > 1e-9 * size ? rise > 0 : s->work < 0;
}

/* Whether the velocities are cut to zero at the state just reached. */
static bool stop_here(const struct state *s)
{
    const drape_report *report = &s->sim->report;
    if (report->method == DRAPE_METHOD_DYNAMIC || !s->moving)
        return false;
    if (report->stop_on == DRAPE_STOP_ON_KINETIC)
        return s->row.energy.kinetic < s->previous_kinetic;
    return potential_rose(s);
}

/* Rest is a matter of forces. Plain dynamics must also have lost its momentum: passing an equilibrium
 * at speed is not rest, so M v/dt, the force that would stop a node within one step, has to be as small. */
static bool at_rest(const struct state *s)
{
    double tolerance = s->sim->options.tolerance;
    if (!(s->row.residual_force <= tolerance))
        return false;
    return s->sim->report.method != DRAPE_METHOD_DYNAMIC ||
           dr_cloth_largest_force(s->cloth, s->inertia) <= tolerance * s->weight;
}

/* A piece that no pin holds has fallen below every body. */
static bool slid_off(const struct state *s)
{
    const drape_scene *scene = s->sim->scene;
    const double *g = s->cloth->gravity;
    double size = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
    if (!scene->bodies || size == 0)
        return false;
    const double up[3] = {-g[0] / size, -g[1] / size, -g[2] / size};
    double lowest = INFINITY;
    for (size_t b = 0; b < scene->bodies; b++)
        lowest = fmin(lowest, dr_body_support_min(scene->body[b], up) - dr_body_offset(scene->body[b]));
    if (!(lowest > -INFINITY))
        return false;
    for (size_t p = 0; p < scene->parts; p++) {
        double top = -INFINITY;
        for (size_t i = 0; i < scene->mesh->nodes && !scene->part_held[p]; i++)
            if (scene->part[i] == p)
                top = fmax(top, up[0] * s->x[3 * i] + up[1] * s->x[3 * i + 1] + up[2] * s->x[3 * i + 2]);
        if (!scene->part_held[p] && top < lowest)
            return true;
    }
    return false;
}

/* ---- one step ----------------------------------------------------------------------------------- */

/* Factorises at x and solves for the force and the inertia apart, which costs one factor all the same
 * and gives the Newton decrement of the force alone. */
static drape_status solve_step(struct state *s, drape_error *reterr)
{
    struct drape_sim *sim = s->sim;
    bool out_of_memory = false;
    double began = dr_clock();
    dr_cloth_assemble(s->cloth, s->x);
    double assembled = dr_clock();
    bool ok = dr_matrix_factorise(s->cloth->A, &out_of_memory);
    double factorised = dr_clock();
    sim->report.factorizations++;
    if (ok)
        dr_matrix_solve(s->cloth->A, 2, (const double *[]){s->f, s->inertia},
                        (double *[]){s->w, s->w_inertia});
    sim->report.solves += 2;
    sim->stage[DR_STAGE_ASSEMBLE] += assembled - began;
    sim->stage[DR_STAGE_FACTORISE] += factorised - assembled;
    sim->stage[DR_STAGE_SOLVE] += dr_clock() - factorised;
    if (out_of_memory)
        return dr_out_of_memory(reterr);
    if (!ok)
        return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                       "the step matrix could not be factorised, iteration %u", s->row.iteration);
    double decrement = 0;
    for (size_t i = 0; i < 3 * s->cloth->mesh->nodes; i++)
        if (!s->cloth->mesh->held[i / 3])
            decrement += s->f[i] * s->w[i];
    s->row.residual_energy = 0.5 * decrement;
    return DRAPE_OK;
}

/* The share of the incremental potential that is inertia: |w - v dt|^2_M / (2 dt^2). */
static double inertial_energy(const struct state *s, double scale)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    double dt = s->sim->options.time_step;
    long double sum = 0;
    for (size_t i = 0; i < 3 * mesh->nodes; i++) {
        double slip = scale * s->w[i] - s->v[i] * dt;
        if (!mesh->held[i / 3])
            sum += mesh->mass[i / 3] * slip * slip;
    }
    return (double)(sum / (2 * dt * dt));
}

static void limit_step(struct state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    for (size_t i = 0; i < mesh->nodes; i++) {
        double *move = s->w + 3 * i;
        double length = sqrt(move[0] * move[0] + move[1] * move[1] + move[2] * move[2]);
        if (length > LONGEST_MOVE)
            for (int d = 0; d < 3; d++)
                move[d] *= LONGEST_MOVE / length;
    }
    dr_contact_clip(s->cloth->contact, s->x, s->w, CONTACT_DEPTH);
}

/* Moves to x + scale*w, halving the scale while the incremental potential rises. */
static drape_status move(struct state *s, drape_error *reterr)
{
    struct drape_sim *sim = s->sim;
    size_t count = 3 * s->cloth->mesh->nodes;
    double began = dr_clock(), scale = 1;
    for (size_t i = 0; i < count; i++)
        s->w[i] += s->w_inertia[i];
    if (s->cloth->contact)
        limit_step(s);

    drape_energies energy = s->row.energy;
    double before = energy.potential + inertial_energy(s, 0);
    double noise = 1e-12 * (energy.stretch + energy.bend + energy.contact + fabs(energy.gravity));
    for (int halvings = 0;; halvings++, scale /= 2) {
        for (size_t i = 0; i < count; i++)
            s->x_next[i] = s->x[i] + scale * s->w[i];
        double after = dr_cloth_energy(s->cloth, s->x_next, &energy, s->f_next) + inertial_energy(s, scale);
        if (after <= before + noise || (halvings == MOST_HALVINGS && isfinite(after)))
            break;
        if (halvings == 2 * MOST_HALVINGS)
            return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1, "a non-finite energy, iteration %u",
                           s->row.iteration + 1);
    }
    for (size_t i = 0; i < count; i++)
        s->w[i] *= scale;

    long double work = 0;
    for (size_t i = 0; i < count; i++)
        work += 0.5 * (s->f[i] + s->f_next[i]) * s->w[i];
    s->work = (double)work;
    dr_stretch_stress(s->cloth->stretch, s->x, s->w, s->cloth->stress);
    for (size_t i = 0; i < count; i++)
        s->v[i] = s->w[i] / sim->options.time_step;
    memcpy(s->x, s->x_next, count * sizeof *s->x);
    memcpy(s->f, s->f_next, count * sizeof *s->f);
    s->previous_potential = s->row.energy.potential;
    s->previous_kinetic = s->row.stop ? 0 : s->row.energy.kinetic;
    s->row.energy = energy;
    s->row.energy.kinetic = kinetic_energy(s->cloth->mesh, s->v);
    s->moving = true;
    sim->stage[DR_STAGE_MOVE] += dr_clock() - began;
    return DRAPE_OK;
}

/* ---- the run ------------------------------------------------------------------------------------ */

/* Decides the stop at the state just reached and leaves M v/dt behind for the solve. */
static void stop_or_go(struct state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    s->row.stop = stop_here(s);
    if (s->row.stop) {
        memset(s->v, 0, 3 * mesh->nodes * sizeof *s->v);
        s->moving = false;
        s->sim->report.stops++;
    }
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        s->inertia[i] = mesh->mass[i / 3] * s->v[i] / s->sim->options.time_step;
}

/* Completes this state's row, keeps it, and tells the caller. */
static void record(struct state *s)
{
    struct drape_sim *sim = s->sim;
    drape_row *row = &s->row;
    row->seconds = dr_clock() - sim->began;
    sim->row[sim->rows++] = *row;
    if (row->iteration <= 1 || row->energy.potential < s->best_row.energy.potential) {
        memcpy(s->best, s->x, 3 * s->cloth->mesh->nodes * sizeof *s->best);
        s->best_row = *row;
    }
    dr_sim_tell(sim, &(drape_progress){DRAPE_PHASE_DRAPING, *row, sim->report.stops, 0});
}

/* Why the run ends at this state, with the verdict so far; NULL: it goes on. */
static const char *ending(const struct state *s, drape_verdict *ret_verdict)
{
    const struct drape_sim *sim = s->sim;
    *ret_verdict = DRAPE_VERDICT_NOT_AT_REST;
    if (!sim->options.max_iterations)
        return "only the start was evaluated";
    if (s->row.iteration && at_rest(s)) {
        *ret_verdict = DRAPE_VERDICT_AT_REST;
        return "the residual force is within the tolerance";
    }
    if (slid_off(s)) {
        *ret_verdict = DRAPE_VERDICT_SLID_OFF;
        return "a piece that no pin holds fell below every body";
    }
    if (atomic_load(&sim->cancelled))
        return "cancelled";
    if (s->row.iteration == sim->options.max_iterations)
        return "the iterations ran out";
    if (s->row.iteration && dr_sim_interrupted(sim)) /* the undraped start is never the result */
        return "the time limit ran out";
    return NULL;
}

/* Leaves the state to return in s->x and describes it. */
static void conclude(struct state *s, drape_verdict verdict, const char *reason)
{
    drape_report *report = &s->sim->report;
    const struct dr_mesh *mesh = s->cloth->mesh;
    report->iterations = s->row.iteration;
    report->state = s->row;
    if (verdict == DRAPE_VERDICT_NOT_AT_REST) {
        memcpy(s->x, s->best, 3 * mesh->nodes * sizeof *s->x);
        report->state = s->best_row;
    }
    if (s->cloth->contact)
        report->penetrations = dr_contact_penetrations(s->cloth->contact, s->x, &report->deepest);
    if (report->deepest > SUNK) {
        verdict = DRAPE_VERDICT_INTERSECTING;
        reason = "a node ended deeper than 1 mm inside a body";
    }
    report->verdict = verdict;
    report->reason = reason;
    report->nodes = mesh->nodes;
    report->free_nodes = dr_matrix_free_nodes(s->cloth->A);
    if (state_bytes(s) > s->sim->peak_bytes)
        s->sim->peak_bytes = state_bytes(s);
}

static drape_status iterate(struct state *s, drape_error *reterr)
{
    for (;;) {
        s->row.residual_force = dr_cloth_largest_force(s->cloth, s->f) / s->weight;
        if (!isfinite(s->row.residual_force))
            return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1, "a non-finite force, iteration %u",
                           s->row.iteration);
        stop_or_go(s);
        drape_status status = solve_step(s, reterr);
        if (status < 0)
            return status;
        record(s);
        drape_verdict verdict;
        const char *reason = ending(s, &verdict);
        if (reason) {
            conclude(s, verdict, reason);
            return DRAPE_OK;
        }
        status = move(s, reterr);
        if (status < 0)
            return status;
        s->row.iteration++;
        s->row.linear_iterations = 2;
    }
}

drape_status dr_relax(struct drape_sim *sim, double *x, drape_error *reterr)
{
    const drape_scene *scene = sim->scene;
    double began = dr_clock();
    struct state s = {.sim = sim, .x = x, .row.time_step = sim->options.time_step};
    drape_status status = allocate(&s, scene->mesh->nodes) ? DRAPE_OK : dr_out_of_memory(reterr);
    if (status >= 0)
        status = dr_cloth_new(scene, scene->mesh, scene->bend, scene->gravity, x, NULL, 0, &s.cloth, reterr);
    if (status >= 0) {
        dr_matrix_set_base(s.cloth->A, sim->options.time_step);
        s.weight = dr_cloth_mean_weight(s.cloth);
        dr_cloth_energy(s.cloth, x, &s.row.energy, s.f);
        dr_stretch_stress(s.cloth->stretch, x, NULL, s.cloth->stress);
        sim->stage[DR_STAGE_PREPARE] = dr_clock() - began;
        status = iterate(&s, reterr);
    }
    release(&s);
    return status;
}
