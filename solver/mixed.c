/* mixed.c - the fast way to rest without bodies: a regularised Newton method with predicted stress.
 *
 * Each iteration solves (M/h^2 + H) w = f and moves by w; h is a regularisation, not a time, and there are
 * no velocities. Three things make it fast, each the cure of one delay:
 *
 *  1. The geometric stiffness uses the stress S = D(e(x) + B(x)w) that the last linear step predicted, not
 *     D e(x + w), whose second-order strain would lock every rotation of stiff cloth. This is Newton on
 *     displacements and stresses (Hellinger-Reissner) with the stresses condensed out, the
 *     mixed-integration-point Newton of the shell literature (Magisano, Leonetti, Garcea).
 *  2. The compressive part of that stress, dropped to keep H positive semi-definite, is blended back as far
 *     as Cholesky succeeds: wrinkles then move in whole steps, and the end is quadratic.
 *  3. A step is judged by the decrease of energy without the known second-order stretch Q of the step, so
 *     that the energy may peak on the way and the following steps remove it.
 *
 * A watchdog goes back to the best state when nothing has improved for long; the third time stop-and-go
 * takes over. Constants: found on 14 of 22 scenes (squares, skirts, arcs, folds, noise; 10 to 10 000 N/m),
 * `make bench-methods` runs them all. */
#include <math.h>
#include <string.h>

#include "state.h"

#define FIRST_H_MIN   0.005 /* s: the job's time step, held to this range, is the first h */
#define FIRST_H_MAX   0.05
#define H_MAX         0.2 /* s, about sqrt(height/g); free once the whole true Hessian is positive definite */
#define GROWTH        2   /* of h after a step that the model foresaw */
#define SMOOTH        0.02 /* strain of the last step below which blending is tried */
#define GOOD_FIT      0.25 /* actual over predicted decrease */
#define BAD_FIT       (-2.0)
#define MOST_REJECTED 4  /* steps in a row; then one is taken as it is */
#define PATIENCE      60 /* iterations without a better state until the watchdog bites */
#define CAUTIOUS      20 /* iterations without blending after it */
#define MOST_BITES    3
#define MOST_ATTEMPTS 8 /* at a factor */

static double first_h(const struct dr_state *s)
{
    return fmin(fmax(s->sim->options.time_step, FIRST_H_MIN), FIRST_H_MAX);
}

static drape_status try_factor(struct dr_state *s, drape_error *reterr)
{
    bool definite;
    drape_status status;
    dr_matrix_set_base(s->cloth->A, 1 / (s->h * s->h));
    s->blended = s->pivot_failed = false;
    if (!s->wait && s->strain < SMOOTH && s->ratio > GOOD_FIT) {
        status = dr_state_factorise(s, s->compression, &s->blended, reterr);
        if (status < 0 || s->gave_up)
            return status;
        s->pivot_failed = !s->blended;
        s->compression = s->blended ? fmin(1, s->compression + 0.25) : s->compression / 2;
        s->wait = s->blended ? 0 : 2; /* this iteration and the next */
    }
    if (s->wait)
        s->wait--;
    if (s->blended)
        return DRAPE_OK;
    for (int attempt = 0; attempt < MOST_ATTEMPTS; attempt++) {
        status = dr_state_factorise(s, 0, &definite, reterr);
        if (status < 0 || definite || s->gave_up)
            return status;
        s->h /= 30; /* round-off made it indefinite: more mass, a shorter step */
        dr_matrix_set_base(s->cloth->A, 1 / (s->h * s->h));
    }
    s->gave_up = "the step matrix could not be factorised";
    return DRAPE_OK;
}

static drape_status assess(struct dr_state *s, drape_error *reterr)
{
    if (!s->row.iteration) {
        s->h = first_h(s);
        s->compression = 0.5;
        s->ratio = 1;
        s->lowest = s->lowest_force = INFINITY;
    }
    drape_status status = try_factor(s, reterr);
    if (status < 0 || s->gave_up)
        return status;
    status = dr_state_solve(s, 1, (const double *[]){s->f}, (double *[]){s->w}, reterr);
    s->row.residual_energy = 0.5 * dr_state_dot(s, s->f, s->w);
    s->row.time_step = s->h;
    return status;
}

/* Whether the state has got better lately; notes it if so. */
static bool improved(struct dr_state *s, double size)
{
    bool better =
        s->row.energy.potential < s->lowest - 1e-12 * size || s->row.residual_force < 0.99 * s->lowest_force;
    if (better || !s->row.iteration)
        s->lowest_at = s->row.iteration;
    s->lowest = fmin(s->lowest, s->row.energy.potential);
    s->lowest_force = fmin(s->lowest_force, s->row.residual_force);
    return s->row.iteration - s->lowest_at < PATIENCE;
}

/* Back to the best state, carefully; the last time, over to stop-and-go. */
static drape_status bite(struct dr_state *s, drape_error *reterr)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    memcpy(s->x, s->best, count * sizeof *s->x);
    dr_cloth_energy(s->cloth, s->x, &s->row.energy, s->f);
    dr_stretch_stress(s->cloth->stretch, s->x, NULL, s->cloth->stress);
    s->h = first_h(s);
    s->strain = s->compression = 0;
    s->ratio = 1;
    s->wait = CAUTIOUS;
    s->rejected = 0;
    s->lowest_at = s->row.iteration + 1;
    s->lowest_force = INFINITY;
    if (++s->bites < MOST_BITES)
        return DRAPE_OK;
    s->sim->report.method = DRAPE_METHOD_STOP_AND_GO;
    s->row.time_step = s->sim->options.time_step;
    return dr_state_hand_over(s, &dr_backward_euler, reterr);
}

static drape_status advance(struct dr_state *s, drape_error *reterr)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    const drape_energies *here = &s->row.energy;
    size_t count = 3 * mesh->nodes;
    double began = dr_clock(), size = here->stretch + here->bend + fabs(here->gravity);
    drape_status status = DRAPE_OK;
    drape_energies there = {0};

    if (!improved(s, size))
        return bite(s, reterr);
    long double inertia = 0;
    for (size_t i = 0; i < count; i++) {
        s->x_next[i] = s->x[i] + s->w[i];
        inertia += mesh->mass[i / 3] * s->w[i] * s->w[i]; /* w is zero on held nodes */
    }
    /* The model's decrease f.w - w'Hw/2, with w'Hw = f.w - |w|^2_M/h^2. */
    double predicted = s->row.residual_energy + 0.5 * (double)inertia / (s->h * s->h);
    double false_stretch = dr_stretch_second_order(s->cloth->stretch, s->x, s->w, &s->strain);
    double potential = dr_cloth_energy(s->cloth, s->x_next, &there, s->f_next);
    s->ratio = isfinite(potential) ? (here->potential - potential + false_stretch) / predicted : -INFINITY;

    if (predicted < 1e-13 * size) { /* below round-off: the force alone decides */
        s->rejected = 0;
        s->ratio = 1;
        s->h *= GROWTH;
    } else if (s->ratio < BAD_FIT && s->rejected < MOST_REJECTED) {
        s->rejected++;
        s->h = fmax(first_h(s) / 4, s->h / 4);
        goto done;
    } else {
        s->rejected = 0;
        if (s->ratio < GOOD_FIT)
            s->h = fmax(first_h(s) / 4, s->h / 2);
        else if (!s->pivot_failed)
            s->h *= GROWTH;
    }
    if (s->h > H_MAX && !(s->blended && s->compression == 1))
        s->h = H_MAX;
    if (isfinite(potential))
        dr_state_arrive(s, &there);
    else
        status = bite(s, reterr);

done:
    s->row.linear_iterations = 1;
    s->sim->stage[DR_STAGE_MOVE] += dr_clock() - began;
    return status;
}

const struct dr_method dr_mixed = {.matrix = DR_MATRIX_CHOLESKY, .assess = assess, .advance = advance};
