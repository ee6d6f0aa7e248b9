/* implicit.c - implicit time steps with one linear solve each: backward Euler, BDF-2, implicit midpoint,
 * and the quasi-static step that forgets its velocities.
 *
 * All are one form. With H the positive semi-definite Hessian, f the force at x, and y the free
 * ("inertial") move that the scheme predicts without forces,
 *
 *     A w = f + c M y,   A = c M + H,
 *
 * which descends the incremental potential E(x + w) + c/2 |w - y|^2_M:
 *
 *     backward Euler  c = 1/dt^2      y = v dt                      v+ = w/dt           [VMT07] eq. 1
 *     quasi-static    c = 1/dt^2      y = 0                         no velocities       [VMT07] eq. 2
 *     BDF-2           c = 9/(4 dt^2)  y = d/3 + dt (8 v - 2 v_1)/9  v+ = (3 w - d)/(2 dt)
 *     midpoint        c = 4/dt^2      y = v dt/2                    v+ = 2 w/dt - v, and the step is 2w
 *
 * d is the last move and v_1 the velocity before it; BDF-2 starts, and starts again after each stop, with
 * one step of backward Euler. Damping (backward Euler) adds -a M v+ - b H v+ with v+ = w/dt:
 * (1 + b/dt) A w = f + M v/dt with c = (1/dt^2 + a/dt) / (1 + b/dt). */
#include <math.h>
#include <string.h>

#include "state.h"

#define MOST_HALVINGS 10 /* of a step that raises the incremental potential */
#define MOST_ATTEMPTS 8  /* at a factor, each with a thousand times the mass */

/* The methods' own arrays. */
enum { FREE_MOVE, INERTIA_STEP, LAST_MOVE, LAST_VELOCITY };

static double time_step(const struct dr_state *s)
{
    return s->sim->options.time_step;
}

/* c without damping, 1/s^2. */
static double mass_factor(const struct dr_state *s)
{
    double dt = time_step(s), c = 1 / (dt * dt);
    return s->method->scheme.history && s->fresh ? c : s->method->scheme.mass_factor * c;
}

/* What damping by b/dt makes the whole equation stiffer by. */
static double material_factor(const struct dr_state *s)
{
    return 1 + s->sim->options.material_damping / time_step(s);
}

/* y, into extra[FREE_MOVE]. */
static void predict_free_move(struct dr_state *s)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    double dt = time_step(s), *y = s->extra[FREE_MOVE];
    const double *d = s->extra[LAST_MOVE], *v1 = s->extra[LAST_VELOCITY];
    if (s->method->scheme.history && !s->fresh)
        for (size_t i = 0; i < count; i++)
            y[i] = d[i] / 3 + dt * (8 * s->v[i] - 2 * v1[i]) / 9;
    else
        for (size_t i = 0; i < count; i++)
            y[i] = s->v[i] * (s->method->scheme.midpoint ? dt / 2 : dt);
}

/* Where stiffness outweighs mass past the digits of a double, round-off makes the matrix indefinite; more
 * mass makes the step shorter, and it still descends. */
static drape_status factorise(struct dr_state *s, drape_error *reterr)
{
    double dt = time_step(s), damped = mass_factor(s) + s->sim->options.air_damping / dt;
    double c = damped / material_factor(s);
    for (int attempt = 0; attempt < MOST_ATTEMPTS; attempt++, c *= 1000) {
        bool definite;
        dr_matrix_set_base(s->cloth->A, c);
        drape_status status = dr_state_factorise(s, 0, &definite, reterr);
        if (status < 0 || definite || s->gave_up)
            return status;
    }
    s->gave_up = "the step matrix could not be factorised";
    return DRAPE_OK;
}

/* Solves for the force and the inertia apart: one factor serves both, and the first alone gives the Newton
 * decrement of the force. */
static drape_status assess(struct dr_state *s, drape_error *reterr)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    double c = mass_factor(s), factor = material_factor(s), *inertia = s->x_next; /* free until the move */
    drape_status status = factorise(s, reterr);
    if (status < 0 || s->gave_up)
        return status;
    predict_free_move(s);
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        inertia[i] = c * mesh->mass[i / 3] * s->extra[FREE_MOVE][i];
    status = dr_state_solve(s, 2, (const double *[]){s->f, inertia},
                            (double *[]){s->w, s->extra[INERTIA_STEP]}, reterr);
    s->row.residual_energy = 0.5 * dr_state_dot(s, s->f, s->w);
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        s->w[i] = (s->w[i] + s->extra[INERTIA_STEP][i]) / factor;
    return status;
}

static drape_status assess_quasi_static(struct dr_state *s, drape_error *reterr)
{
    drape_status status = factorise(s, reterr);
    if (status < 0 || s->gave_up)
        return status;
    status = dr_state_solve(s, 1, (const double *[]){s->f}, (double *[]){s->w}, reterr);
    s->row.residual_energy = 0.5 * dr_state_dot(s, s->f, s->w);
    return status;
}

/* c/2 |scale*w - y|^2_M. */
static double inertial_energy(const struct dr_state *s, double scale)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    const double *y = s->extra[FREE_MOVE]; /* NULL: no velocities */
    long double sum = 0;
    for (size_t i = 0; i < 3 * mesh->nodes; i++) {
        double slip = scale * s->w[i] - (y ? y[i] : 0);
        if (!mesh->held[i / 3])
            sum += mesh->mass[i / 3] * slip * slip;
    }
    return (double)sum * mass_factor(s) / 2;
}

/* Halves w until it no longer raises the incremental potential; leaves x_next, f_next and *ret_energy at
 * its end. */
static void search(struct dr_state *s, drape_energies *ret_energy)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    drape_energies *energy = ret_energy;
    *energy = s->row.energy;
    double before = energy->potential + inertial_energy(s, 0), scale = 1;
    double noise = 1e-12 * (energy->stretch + energy->bend + energy->contact + fabs(energy->gravity));
    for (int halvings = 0;; halvings++, scale /= 2) {
        for (size_t i = 0; i < count; i++)
            s->x_next[i] = s->x[i] + scale * s->w[i];
        double after = dr_cloth_energy(s->cloth, s->x_next, energy, s->f_next) + inertial_energy(s, scale);
        if (after <= before + noise || halvings == MOST_HALVINGS)
            break;
    }
    for (size_t i = 0; i < count; i++)
        s->w[i] *= scale;
}

/* The half step w made whole, and the energies at its end. */
static void double_step(struct dr_state *s, drape_energies *ret_energy)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    for (size_t i = 0; i < count; i++)
        s->w[i] *= 2;
    dr_state_limit(s);
    for (size_t i = 0; i < count; i++)
        s->x_next[i] = s->x[i] + s->w[i];
    dr_cloth_energy(s->cloth, s->x_next, ret_energy, s->f_next);
}

/* v+ of the step w; keeps what the next step wants to know of this one. */
static void set_velocities(struct dr_state *s)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    double dt = time_step(s), *d = s->extra[LAST_MOVE], *v1 = s->extra[LAST_VELOCITY];
    if (s->method->scheme.history)
        for (size_t i = 0; i < count; i++) {
            double v = s->fresh ? s->w[i] / dt : (3 * s->w[i] - d[i]) / (2 * dt);
            v1[i] = s->v[i];
            d[i] = s->w[i];
            s->v[i] = v;
        }
    else
        for (size_t i = 0; i < count; i++)
            s->v[i] = s->method->scheme.midpoint ? 2 * s->w[i] / dt - s->v[i] : s->w[i] / dt;
}

static drape_status advance(struct dr_state *s, drape_error *reterr)
{
    double began = dr_clock();
    drape_energies energy;
    (void)reterr;
    dr_state_limit(s);
    search(s, &energy);
    if (s->method->scheme.midpoint)
        double_step(s, &energy);
    if (s->method->moves)
        set_velocities(s);
    dr_state_arrive(s, &energy);
    s->row.linear_iterations = s->method->moves ? 2 : 1;
    s->sim->stage[DR_STAGE_MOVE] += dr_clock() - began;
    return DRAPE_OK;
}

const struct dr_method dr_backward_euler = {.matrix = DR_MATRIX_CHOLESKY,
                                            .moves = true,
                                            .extra = 2,
                                            .scheme = {.mass_factor = 1},
                                            .assess = assess,
                                            .advance = advance};
const struct dr_method dr_bdf2 = {.matrix = DR_MATRIX_CHOLESKY,
                                  .moves = true,
                                  .extra = 4,
                                  .scheme = {.mass_factor = 9.0 / 4, .history = 2},
                                  .assess = assess,
                                  .advance = advance};
const struct dr_method dr_implicit_midpoint = {.matrix = DR_MATRIX_CHOLESKY,
                                               .moves = true,
                                               .extra = 2,
                                               .scheme = {.mass_factor = 4, .midpoint = true},
                                               .assess = assess,
                                               .advance = advance};
const struct dr_method dr_quasi_static = {.matrix = DR_MATRIX_CHOLESKY,
                                          .scheme = {.mass_factor = 1},
                                          .assess = assess_quasi_static,
                                          .advance = advance};
