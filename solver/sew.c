/* sew.c - the first phase: pulls loose pieces together along their seams, round the bodies.
 *
 * Zero-length springs between sewn vertices grow while the pieces, stiff in bending, move without
 * velocity, gravity or friction: (M/dt^2 + H) w = f. The measured record: welding at once leaves
 * sleeves passed through the bodice; soft pieces invert along the seam. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "sim.h"

#define TIME_STEP            0.02  /* s: the mass is only a regulariser here */
#define SPRING_FIRST         0.2   /* N/m */
#define SPRING_LAST          1e5   /* N/m */
#define SPRING_GROWTH        1.15  /* per step */
#define LONGEST_MOVE         0.005 /* m per node and step: pieces slide round a body, never through it */
#define CONTACT_DEPTH        0.002 /* m below a surface that one step may end */
#define STEPS_BESIDES_TRAVEL 250   /* over what the widest seam needs at the longest move */

double dr_seam_energy(const uint32_t *seam, size_t seams, double stiffness, const double *x, double *f,
                      double *ret_gap)
{
    double widest = 0, sum = 0;
    for (size_t s = 0; s < seams; s++) {
        size_t a = 3 * (size_t)seam[2 * s], b = 3 * (size_t)seam[2 * s + 1];
        double square = 0;
        for (size_t d = 0; d < 3; d++) {
            double gap = x[b + d] - x[a + d];
            square += gap * gap;
            f[a + d] += stiffness * gap;
            f[b + d] -= stiffness * gap;
        }
        sum += square;
        widest = fmax(widest, square);
    }
    *ret_gap = sqrt(widest);
    return 0.5 * stiffness * sum;
}

static void limit_moves(const struct dr_mesh *mesh, double *w)
{
    for (size_t i = 0; i < mesh->nodes; i++) {
        double *move = w + 3 * i;
        double length = sqrt(move[0] * move[0] + move[1] * move[1] + move[2] * move[2]);
        if (length > LONGEST_MOVE)
            for (int d = 0; d < 3; d++)
                move[d] *= LONGEST_MOVE / length;
    }
}

static drape_status sew_pieces(struct drape_sim *sim, struct dr_cloth *cloth, double *f, double *w,
                               drape_error *reterr)
{
    const drape_scene *scene = sim->scene;
    double *x = sim->positions, spring = SPRING_FIRST;
    uint32_t most =
        STEPS_BESIDES_TRAVEL + (uint32_t)fmin(scene->seam_gap / LONGEST_MOVE, DRAPE_MAX_ITERATIONS);
    drape_progress progress = {.phase = DRAPE_PHASE_SEWING};
    for (uint32_t step = 0;; step++) {
        drape_energies energy = {0};
        double potential = dr_cloth_energy(cloth, x, &energy, f);
        double seams = dr_seam_energy(scene->seam, scene->seams, spring, x, f, &progress.seam_gap);
        if (!isfinite(potential + seams))
            return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                           "a non-finite energy while sewing, step %u", step);
        energy.potential += seams;
        progress.row = (drape_row){.iteration = step,
                                   .seconds = dr_clock() - sim->began,
                                   .energy = energy,
                                   .time_step = TIME_STEP,
                                   .linear_iterations = 1};
        progress.row.residual_force = dr_cloth_largest_force(cloth, f) / dr_cloth_mean_weight(cloth);
        sim->report.sewing_iterations = step;
        sim->report.seam_gap = progress.seam_gap;
        dr_sim_tell(sim, &progress);
        if (progress.seam_gap <= DR_WELD_GAP || step == most || dr_sim_interrupted(sim))
            return DRAPE_OK;

        enum dr_factored factored;
        drape_status status = dr_cloth_assemble(cloth, x, 0, reterr);
        if (status < 0)
            return status;
        for (size_t s = 0; s < scene->seams; s++)
            dr_matrix_add_link(cloth->A, s, spring);
        status = dr_sim_factorise(sim, cloth->A, &factored, reterr);
        if (status < 0 || factored == DR_NO_TIME)
            return status;
        if (factored == DR_NOT_DEFINITE)
            return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                           "the step matrix could not be factorised while sewing, step %u", step);
        dr_matrix_solve(cloth->A, 1, (const double *[]){f}, (double *[]){w});
        sim->report.solves++;
        limit_moves(cloth->mesh, w);
        if (cloth->contact)
            dr_contact_clip(cloth->contact, x, w, CONTACT_DEPTH);
        dr_cloth_stress(cloth, x, w);
        for (size_t i = 0; i < 3 * cloth->mesh->nodes; i++)
            x[i] += w[i];
        spring = fmin(spring * SPRING_GROWTH, SPRING_LAST);
    }
}

drape_status dr_sew(struct drape_sim *sim, drape_error *reterr)
{
    const drape_scene *scene = sim->scene;
    double began = dr_clock();
    struct dr_cloth *cloth = NULL;
    double *f = malloc(3 * scene->vertices * sizeof *f), *w = malloc(3 * scene->vertices * sizeof *w);
    drape_status status = f && w ? DRAPE_OK : dr_out_of_memory(reterr);
    if (status >= 0)
        status = dr_cloth_new(&sim->plan.pieces, sim->positions, &cloth, reterr);
    if (status >= 0) {
        dr_matrix_set_base(cloth->A, 1 / (TIME_STEP * TIME_STEP));
        dr_cloth_stress(cloth, sim->positions, NULL);
        status = sew_pieces(sim, cloth, f, w, reterr);
        size_t bytes[DR_TERMS] = {[DR_TERM_SEWING] = 6 * scene->vertices * sizeof(double)};
        dr_cloth_bytes(cloth, bytes);
        dr_plan_hold(&sim->plan, DRAPE_PHASE_SEWING, bytes);
    }
    dr_cloth_free(cloth);
    free(f);
    free(w);
    sim->stage[DR_STAGE_SEW] = dr_clock() - began;
    return status;
}
