/* newton.c - Newton on the statics, -dF/dP dP = F ([VMT07] eq. 3), as published or with a line search.
 *
 * The Jacobian is the true Hessian, indefinite while cloth is compressed, so the factor is LDL' without
 * pivoting. Cloth is nearly free to bend: steps overshoot wildly, which is the point of this baseline. */
#include <math.h>

#include "error.h"
#include "state.h"

#define MOST_HALVINGS                                                                                        \
    100 /* a cloth hung by one edge starts with a singular Jacobian and a step of 1e15 m                     \
         */

static drape_status assess(struct dr_state *s, drape_error *reterr)
{
    bool regular;
    dr_matrix_set_base(s->cloth->A, 0);
    dr_cloth_stress(s->cloth, s->x, NULL);
    drape_status status = dr_state_factorise(s, 1, &regular, reterr);
    if (status < 0 || s->gave_up)
        return status;
    s->row.residual_energy = NAN;
    if (!regular) {
        s->gave_up = "the Jacobian is singular";
        return DRAPE_OK;
    }
    status = dr_state_solve(s, 1, (const double *[]){s->f}, (double *[]){s->w}, reterr);
    if (status < 0)
        return status;
    double decrement = dr_state_dot(s, s->f, s->w);
    if (decrement >= 0)
        s->row.residual_energy = 0.5 * decrement;
    else if (!isfinite(decrement))
        s->gave_up = "the Newton step is not finite";
    return DRAPE_OK;
}

static drape_status advance(struct dr_state *s, drape_error *reterr)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    bool searching = s->sim->options.line_search;
    double began = dr_clock(), scale = searching && dr_state_dot(s, s->f, s->w) < 0 ? -1 : 1;
    drape_energies energy = {0};
    (void)reterr;
    if (scale < 0) /* uphill along negative curvature: the other way is down */
        for (size_t i = 0; i < count; i++)
            s->w[i] = -s->w[i];
    dr_state_limit(s);
    const drape_energies *here = &s->row.energy;
    double noise = 1e-12 * (here->stretch + here->bend + here->contact + fabs(here->gravity));
    scale = 1;
    for (int halvings = 0;; halvings++, scale /= 2) {
        for (size_t i = 0; i < count; i++)
            s->x_next[i] = s->x[i] + scale * s->w[i];
        double potential = dr_cloth_energy(s->cloth, s->x_next, &energy, s->f_next);
        if (!searching || potential <= here->potential + noise)
            break;
        if (halvings == MOST_HALVINGS) {
            s->gave_up = "no step along the Newton direction lowers the energy";
            return DRAPE_OK;
        }
    }
    for (size_t i = 0; i < count; i++)
        s->w[i] *= scale;
    dr_state_arrive(s, &energy);
    s->row.linear_iterations = 1;
    s->sim->stage[DR_STAGE_MOVE] += dr_clock() - began;
    return DRAPE_OK;
}

const struct dr_method dr_newton = {.matrix = DR_MATRIX_LDL, .assess = assess, .advance = advance};
