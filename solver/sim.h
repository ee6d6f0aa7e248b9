/* sim.h - the state of one run, shared by the page that sews and the page that drapes. */
#ifndef DR_SIM_H
#define DR_SIM_H

#include <stdatomic.h>

#include "clock.h"
#include "fit.h"
#include "hand.h"

/* Where the seconds go; dr_stage_name has their names. */
enum dr_stage {
    DR_STAGE_PREPARE = 0, /* matrices analysed, buffers made */
    DR_STAGE_SEW,
    DR_STAGE_COARSE, /* all that the coarse cloth takes */
    DR_STAGE_FOLLOW, /* bodies in motion */
    DR_STAGE_ASSEMBLE,
    DR_STAGE_FACTORISE,
    DR_STAGE_SOLVE,
    DR_STAGE_MOVE, /* line search: energies, forces, contact limits */
    DR_STAGE_CERTIFY,
    DR_STAGE_BROAD_PHASE,  /* search for pairs of the cloth that may touch: in the stages above */
    DR_STAGE_NARROW_PHASE, /* their closest points, energies and Hessians: likewise */
    DR_STAGES
};

struct drape_sim {
    const drape_scene *scene;
    drape_options options;
    atomic_bool cancelled;
    double began;            /* s, monotonic */
    double stage[DR_STAGES]; /* s */
    struct dr_plan plan;
    double *positions;  /* 3*vertices: the result */
    drape_row *row;     /* max_iterations + 1 */
    struct dr_fit *fit; /* NULL: not asked for */
    struct dr_hand hand;
    size_t rows;
    double
        factor_rate[DR_FACTORS]; /* 1/s: operations of the last factorisation that went well; 0: none yet */
    size_t held_outside;         /* bytes of another sim's that count against the limit, too */
    drape_report report;
};

/* By an integrator: the method is stop-and-go or dynamic. */
bool dr_steps_in_time(const drape_options *options);

/* drape_sim_run but for the processor that the caller has: of a sim that runs within another one. */
drape_status dr_sim_run(drape_sim *sim, drape_error *reterr);

/* Cancelled, or past the time limit. */
bool dr_sim_interrupted(const struct drape_sim *sim);

enum dr_factored { DR_FACTORED, DR_NOT_DEFINITE, DR_NO_TIME };

/* DRAPE_ENOMEM when scene, sim and this cloth (NULL: there is none yet) hold more than the limit. */
drape_status dr_sim_check_memory(const struct drape_sim *sim, const struct dr_cloth *cloth,
                                 drape_error *reterr);

/* Factorises the cloth's A, unless that cannot be expected to end within the time limit (see drape_options);
 * accounts for it. The status is negative only when memory ran out, or would pass its limit. */
drape_status dr_sim_factorise(struct drape_sim *sim, const struct dr_cloth *cloth, enum dr_factored *ret,
                              drape_error *reterr);

/* Tells the caller; its nonzero answer cancels. */
void dr_sim_tell(struct drape_sim *sim, const drape_progress *progress);

/* Closes the seams: from the start positions in sim->positions to positions whose seams are
 * DR_WELD_GAP or less apart, as far as the step budget allows; the report gets the gap that is left. */
drape_status dr_sew(struct drape_sim *sim, drape_error *reterr);

/* Sews and drapes the coarse cloth, and carries it up into sim->positions, whose seams are then to be welded.
 * *ret_carried: whether that went well; else nothing has changed. */
drape_status dr_coarse_drape(struct drape_sim *sim, bool *ret_carried, drape_error *reterr);

/* Gives the preview its caller asked for of the cloth at x (3*nodes); the scene has a coarse mesh. */
void dr_coarse_show(const struct drape_sim *sim, const double *x);

/* Follows the bodies along their paths: x (3*nodes) goes from where the cloth is when they start to where it
 * is when they have come to stand. Out of time or cancelled on the way, it carries the cloth there at once.
 */
drape_status dr_move(struct drape_sim *sim, double *x, drape_error *reterr);

/* Energy k/2 sum |x_i - x_j|^2 of zero-length springs between sewn vertices (J); adds their force to f
 * and finds the widest gap (m). x and f are 3*vertices, seam 2*seams. */
double dr_seam_energy(const uint32_t *seam, size_t seams, double stiffness, double most, const double *x,
                      double *f, double *ret_gap);

/* Of the spring that has the force of such a seam `gap` metres wide, N/m: never less than its curvature. */
double dr_seam_stiffness(double gap, double stiffness, double most);

/* Drapes the welded cloth from x (3*nodes, overwritten) until rest or until a budget is spent. On
 * return x is the best state, and the report is filled. */
drape_status dr_relax(struct drape_sim *sim, double *x, drape_error *reterr);

#endif
