/* state.h - the state of one drape, and the interface of the methods that move it.
 *
 * The page that drapes (relax.c) knows rest, stops, records and budgets; a method knows how to go from one
 * state to the next. At each state `assess` comes first (factorises, say; leaves row.residual_energy), the
 * row is recorded, and unless the run ends there `advance` moves on. Belongs to one thread. */
#ifndef DR_STATE_H
#define DR_STATE_H

#include "gap.h"
#include "sim.h"

#define DR_CONTACT_DEPTH 0.002 /* m below a body's surface that one step may end: nothing tunnels */

struct dr_state;

/* What tells the implicit time steps apart (implicit.c has their equations); the others leave it zero. */
struct dr_scheme {
    double mass_factor; /* c dt^2, once there is a history where one is wanted */
    unsigned history;   /* the last so many of the extra arrays are the motion's past; the first step goes
                         * as backward Euler */
    bool midpoint;      /* solves for half a step and doubles it */
};

struct dr_method {
    enum dr_cloth_matrix matrix;
    bool moves;     /* it has velocities: kinetic energy, stops */
    unsigned extra; /* arrays of 3*nodes it wants in state.extra, at most DR_MAX_EXTRA */
    bool gaps;      /* it wants state.gaps */
    bool conjugate; /* its steps are by conjugate gradients, which is what the extra arrays are for */
    struct dr_scheme scheme;
    drape_status (*assess)(struct dr_state *s, drape_error *reterr);
    drape_status (*advance)(struct dr_state *s, drape_error *reterr);
};

#define DR_MAX_EXTRA 8

struct dr_state { /* arrays are 3*nodes */
    struct drape_sim *sim;
    struct dr_cloth *cloth;
    const struct dr_method *method;
    double *x, *f;               /* where we are */
    double *v;                   /* NULL when the method has no velocities */
    double *w;                   /* the step */
    double *x_next, *f_next;     /* where the step leads */
    double *best;                /* lowest potential energy seen */
    double *extra[DR_MAX_EXTRA]; /* the method's own, zero at first */
    struct dr_gaps *gaps;        /* NULL when the method or the scene needs none */
    drape_row row, best_row;
    double weight;                               /* N: what residual_force is relative to */
    double previous_potential, previous_kinetic; /* J, one iteration back */
    double work;         /* J: of the potential forces over the last step, by the trapezoid rule */
    bool moving;         /* velocities may be nonzero */
    bool fresh;          /* no step since the start or the last stop: there is no history */
    bool carried;        /* the first iteration is the coarse drape carried up */
    uint32_t anchored;   /* iteration at which friction's anchors were taken */
    const char *gave_up; /* why the method can go no further; NULL: it can */

    /* mixed.c */
    double h;                    /* s: the regularisation M/h^2 */
    double limit;                /* second-order strain at which a corrected step is cut */
    double predicted;            /* J: decrease of energy by the model */
    double strain, ratio;        /* of the last step: second-order strain; actual over predicted decrease */
    unsigned wait;               /* iterations until Cholesky on the true Hessian is tried again */
    unsigned cautious;           /* iterations left with the projected Hessian only */
    unsigned rejected;           /* steps in a row */
    bool whole, pivot_failed;    /* this iteration's factor: of the true Hessian; that was tried in vain */
    bool corrected, cut;         /* this iteration's step: by conjugate gradients; up to the limit */
    bool shortened;              /* this iteration's step, as too long */
    double surplus;              /* J: of the gaps' model at this iteration's step */
    bool negative;               /* they last met negative curvature */
    uint32_t solves;             /* back-solves of this iteration's step */
    double lowest, lowest_force; /* potential (J) and residual force so far, and the iteration that last */
    uint32_t lowest_at;          /* brought either down */
    unsigned bites;              /* of the watchdog */
    unsigned noisy;              /* steps in a row whose decrease rounding hides, */
    double noisy_force;          /* and the residual force before the first */
};

extern const struct dr_method dr_backward_euler, dr_bdf2, dr_implicit_midpoint, dr_quasi_static, dr_rk4,
    dr_newton, dr_mixed, dr_mixed_touching;

/* Goes on with another method, whose matrix has the same factor; makes the arrays that it lacks. */
drape_status dr_state_hand_over(struct dr_state *s, const struct dr_method *method, drape_error *reterr);

/* Assembles with `indefinite` (see dr_cloth_assemble), factorises, and accounts for the time. *ret_definite
 * tells whether that went well; where there was no time left for it, gave_up says so. The status is negative
 * only when memory ran out. */
drape_status dr_state_factorise(struct dr_state *s, double indefinite, bool *ret_definite,
                                drape_error *reterr);

/* Solves for one or two right-hand sides with the last factor, and accounts for the time. */
drape_status dr_state_solve(struct dr_state *s, size_t count, const double *const b[], double *const w[],
                            drape_error *reterr);

/* a.b over the free nodes. */
double dr_state_dot(const struct dr_state *s, const double *a, const double *b);

/* Shortens the step w where it is too long for a scene with bodies; does nothing without. */
void dr_state_limit(struct dr_state *s);

/* Makes x_next, with energies and f_next there, the present state; w is the step that led to it. A method
 * with velocities has set them before. */
void dr_state_arrive(struct dr_state *s, const drape_energies *energy);

double dr_state_kinetic(const struct dr_state *s);

/* Notes with the plan what is held now; certificate: bytes of what only it needs, which cannot be seen here.
 */
void dr_state_hold(struct dr_state *s, drape_phase phase, size_t certificate);

/* Drops from every free node's velocity what runs against its force (correct.c); row.energy.kinetic is then
 * that of what is left. */
void dr_state_correct(struct dr_state *s);

#endif
