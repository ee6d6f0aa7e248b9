/* explicit.c - the classical Runge-Kutta step of fourth order: four forces, no Jacobian, no solve.
 *
 * Stable only for time steps below about 2.8 over the highest frequency of the mesh; beyond, the energy
 * grows past every bound and the run ends with the best state it saw. */
#include <math.h>
#include <string.h>

#include "state.h"

enum { ACCELERATION, SUM_VELOCITY, SUM_ACCELERATION, STAGE_VELOCITY };

static drape_status assess(struct dr_state *s, drape_error *reterr)
{
    (void)reterr;
    s->row.residual_energy = NAN; /* there is no Newton decrement without a Jacobian */
    return DRAPE_OK;
}

/* M^-1 f, zero on held nodes. */
static void accelerate(const struct dr_mesh *mesh, const double *f, double *a)
{
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        a[i] = mesh->held[i / 3] ? 0 : f[i] / mesh->mass[i / 3];
}

/* What a body or the cloth itself stops has lost its speed, or it would press on with all of it at each step
 * and come five times as near. */
static void limit(struct dr_state *s, double dt)
{
    size_t nodes = s->cloth->mesh->nodes;
    double *wanted = s->extra[ACCELERATION]; /* free by now */
    memcpy(wanted, s->w, 3 * nodes * sizeof *wanted);
    dr_state_limit(s);
    for (size_t i = 0; i < 3 * nodes; i += 3)
        if (memcmp(wanted + i, s->w + i, 3 * sizeof *wanted) != 0)
            for (size_t d = i; d < i + 3; d++)
                s->v[d] = s->w[d] / dt;
}

static drape_status advance(struct dr_state *s, drape_error *reterr)
{
    static const double weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6}, at[4] = {0, 0.5, 0.5, 1};
    const struct dr_mesh *mesh = s->cloth->mesh;
    size_t count = 3 * mesh->nodes;
    double began = dr_clock(), dt = s->sim->options.time_step;
    double *a = s->extra[ACCELERATION], *sum_v = s->extra[SUM_VELOCITY], *sum_a = s->extra[SUM_ACCELERATION],
           *v = s->extra[STAGE_VELOCITY];
    drape_energies energy;
    (void)reterr;

    memset(sum_v, 0, count * sizeof *sum_v);
    memset(sum_a, 0, count * sizeof *sum_a);
    memcpy(s->f_next, s->f, count * sizeof *s->f);
    memset(v, 0, count * sizeof *v);
    memset(a, 0, count * sizeof *a);
    for (int stage = 0; stage < 4; stage++) {
        for (size_t i = 0; i < count; i++) { /* x_k = x + c_k dt v_(k-1), v_k = v + c_k dt a_(k-1) */
            s->x_next[i] = s->x[i] + at[stage] * dt * v[i];
            v[i] = s->v[i] + at[stage] * dt * a[i];
        }
        if (stage)
            dr_cloth_energy(s->cloth, s->x_next, &energy, s->f_next);
        accelerate(mesh, s->f_next, a);
        for (size_t i = 0; i < count; i++) {
            sum_v[i] += weight[stage] * v[i];
            sum_a[i] += weight[stage] * a[i];
        }
    }
    for (size_t i = 0; i < count; i++) {
        s->w[i] = mesh->held[i / 3] ? 0 : dt * sum_v[i];
        s->v[i] = mesh->held[i / 3] ? 0 : s->v[i] + dt * sum_a[i];
    }
    bool finite = isfinite(dr_state_dot(s, s->w, s->w));
    if (finite) /* the clip wants numbers */
        limit(s, dt);
    for (size_t i = 0; i < count; i++)
        s->x_next[i] = s->x[i] + s->w[i];
    dr_cloth_energy(s->cloth, s->x_next, &energy, s->f_next);
    if (!finite)
        energy.potential = NAN;
    dr_state_arrive(s, &energy);
    s->sim->stage[DR_STAGE_MOVE] += dr_clock() - began;
    return DRAPE_OK;
}

const struct dr_method dr_rk4 = {
    .matrix = DR_MATRIX_NONE, .moves = true, .extra = 4, .assess = assess, .advance = advance};
