/* plan.h - what a run needs, decided from the scene and the options before the first step.
 *
 * A term that is left out costs nothing: no buffer, no instruction. cloth.c, sew.c and relax.c act on the
 * plan and decide nothing again; they note with it the bytes that its terms hold. Every byte of a run belongs
 * to one term, so that the sum over the terms is what the run holds. */
#ifndef DR_PLAN_H
#define DR_PLAN_H

#include "scene.h"

struct dr_method;
struct drape_sim;

/* In the report's order. */
enum dr_term {
    DR_TERM_STATE = 0,
    DR_TERM_TRACE,
    DR_TERM_STRETCH,
    DR_TERM_CURVES,
    DR_TERM_ELASTICS,
    DR_TERM_BEND,
    DR_TERM_FOLDS,
    DR_TERM_GRAVITY,
    DR_TERM_CONTACT,
    DR_TERM_FRICTION,
    DR_TERM_TACKS,
    DR_TERM_SELF_CONTACT,
    DR_TERM_SEWING, /* all that only sewing needs */
    DR_TERM_COARSE, /* all that only the coarse cloth needs */
    DR_TERM_MOTION, /* and all that only bodies in motion need */
    DR_TERM_RAMP,
    DR_TERM_JACOBIAN,
    DR_TERM_GEOMETRIC_STIFFNESS,
    DR_TERM_VELOCITIES,
    DR_TERM_CONJUGATE_GRADIENTS,
    DR_TERM_CERTIFICATE,
    DR_TERM_FIT,
    DR_TERMS
};

enum dr_cloth_matrix {
    DR_MATRIX_NONE,
    DR_MATRIX_CHOLESKY,
    DR_MATRIX_PRECONDITIONER, /* likewise, by less: see dr_cloth_make_exact */
    DR_MATRIX_LDL
};

/* The mechanics of one mesh. */
struct dr_cloth_plan {
    const drape_scene *scene;              /* whose fabrics and gravity they are */
    struct dr_body *const *body;           /* scene->bodies of them; NULL: the scene's */
    const struct dr_mesh *mesh;            /* NULL: there is no such mesh */
    const struct dr_bend *bend;            /* NULL: left out */
    bool gravity, contact, friction, self; /* false: left out */
    const uint32_t *part;                  /* nodes: self keeps only different parts apart; NULL: all */
    bool elastics, folds, tacks;           /* likewise */
    const uint32_t *link;                  /* 2*links: node pairs that springs will join; NULL: none */
    size_t links;
    enum dr_cloth_matrix matrix; /* and its factor */
    drape_analyses *analyses;    /* NULL: none */
    struct dr_hand *hand;        /* NULL: none */
};

struct dr_plan {
    const struct dr_method *method; /* the first; see dr_plan_keep */
    struct dr_cloth_plan pieces;    /* to be sewn */
    struct dr_cloth_plan welded;    /* to be draped */
    drape_term term[DR_TERMS];      /* with the bytes that are held from beginning to end */
    struct dr_cloth_plan moved;     /* to follow bodies in motion, which bring their own `body` */
    struct dr_held {
        bool ran;
        size_t bytes[DR_TERMS];
    } held[DRAPE_PHASES]; /* what only it holds */
};

/* Fills sim->plan, and in sim->report the method, stop rule and integrator that will run. */
void dr_plan_compile(struct drape_sim *sim);

/* A term turned out to be needed after all: only where one method hands over to another. */
void dr_plan_keep(struct dr_plan *plan, enum dr_term term);

/* Notes what a phase held besides the scene, when it ends; of several times the one with the most stays. */
void dr_plan_hold(struct dr_plan *plan, drape_phase phase, const size_t bytes[DR_TERMS]);

/* What scene and sim hold now, besides what the phase that runs does. */
size_t dr_plan_held(const struct dr_plan *plan);

/* Fills report->term, report->phase_bytes and report->peak_bytes. A term has the most that it ever held; what
 * the certificate adds to those of draping is its own. */
void dr_plan_report(const struct dr_plan *plan, drape_report *report);

#endif
