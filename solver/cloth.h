/* cloth.h - the mechanics of one mesh: its terms' energies, forces and step matrix.
 *
 * Which terms there are is the plan's decision; one that it leaves out is NULL here and costs nothing. Used
 * twice, for the loose pieces while they are sewn and for the welded cloth. Belongs to one thread. */
#ifndef DR_CLOTH_H
#define DR_CLOTH_H

#include "elastic.h"
#include "fold.h"
#include "friction.h"
#include "matrix.h"
#include "plan.h"
#include "self.h"
#include "stretch.h"
#include "tack.h"

struct dr_cloth {
    const drape_scene *scene;
    const struct dr_mesh *mesh;
    const struct dr_bend *bend; /* NULL: left out */
    struct dr_stretch *stretch;
    struct dr_elastic *elastic;          /* NULL: left out */
    struct dr_fold *fold;                /* NULL: left out */
    struct dr_tacks *tacks;              /* NULL: left out */
    struct dr_contact *contact;          /* NULL: left out */
    struct dr_friction *friction;        /* NULL: left out */
    struct dr_self *self;                /* NULL: left out */
    struct dr_bend_stiffness *stiffness; /* that the matrix is made with; NULL: none */
    struct dr_bend_stiffness *remainder; /* what that lacks of the bending stiffness; NULL: nothing */
    struct dr_matrix *A;                 /* NULL: an explicit integrator needs none */
    double gravity[3];                   /* zero: left out */
    double *start;                       /* 3*nodes: where gravity's energy is zero; NULL: left out */
    bool slides;                         /* assembles friction's true Hessian always: false unless set */
    double *stress; /* 3*triangles: what the geometric stiffness is built from; NULL with A */
};

/* `start`: 3*nodes, copied. What the plan points to must outlive the cloth. */
drape_status dr_cloth_new(const struct dr_cloth_plan *plan, const double *start, struct dr_cloth **ret,
                          drape_error *reterr);
struct dr_cloth *dr_cloth_free(struct dr_cloth *cloth); /* NULL is fine; returns NULL */

/* Adds what the cloth holds, besides what the scene does, to each of its terms. */
void dr_cloth_bytes(const struct dr_cloth *cloth, size_t bytes[DR_TERMS]);

/* Energies at x (3*nodes; kinetic is left alone) into *ret, minus their gradient into f (3*nodes; the
 * entries of held nodes are reactions). Returns the potential energy. */
double dr_cloth_energy(const struct dr_cloth *cloth, const double *x, drape_energies *ret, double *f);

/* The stress that the geometric stiffness is built from: at x, or with w (else NULL) what the linear step w
 * predicts; of the triangles into cloth->stress, of elastics into their own place. */
void dr_cloth_stress(struct dr_cloth *cloth, const double *x, const double *w);

/* A = base (see dr_matrix_set_base) + the Hessian at x, with the geometric stiffness of dr_cloth_stress:
 * its tensile part and `indefinite` times its compressive part, the folds' and the bodies' curvature. 0:
 * positive semi-definite; 1, with the stress at x: the true Hessian (see dr_stretch_hessian and so on). New
 * contacts of cloth with itself change the pattern, which is then analysed anew. */
drape_status dr_cloth_assemble(struct dr_cloth *cloth, const double *x, double indefinite,
                               drape_error *reterr);

/* Makes a Cholesky matrix anew: with the whole bending stiffness and a factor in double, or such that
 * conjugate gradients make up for the rest: with hinges for bending (see dr_bend_hinges_new), which take a
 * third of the operations, and a factor in single precision. Until then it is as planned. */
drape_status dr_cloth_make_exact(struct dr_cloth *cloth, bool exact, drape_error *reterr);

/* q += what the matrix lacks of bending, times p; 3*nodes each. */
void dr_cloth_add_remainder(const struct dr_cloth *cloth, const double *p, double *q);

/* Friction, of the cloth with bodies and with itself: whether there is any; its anchors taken afresh at x,
 * from where on the potential is another one; and the part of the energy at x that it holds, J. */
bool dr_cloth_has_anchors(const struct dr_cloth *cloth);
void dr_cloth_renew_anchors(struct dr_cloth *cloth, const double *x);
double dr_cloth_held(const struct dr_cloth *cloth, const double *x);

/* Moves anchors just taken at x, where the cloth came to rest before, to where they hold the forces f there
 * (3*nodes, N, overwritten) up to `precision`, N, as far as friction can: else they would hold nothing yet.
 * By turns, each from what the others leave (projected Gauss-Seidel). */
void dr_cloth_brace_anchors(struct dr_cloth *cloth, const double *x, double *f, double precision);

/* q += (H(1) - H(0)) p of stretch, elastics and folds (not of bodies), H(indefinite) being what
 * dr_cloth_assemble adds. p and q are 3*nodes. */
void dr_cloth_left_out(const struct dr_cloth *cloth, const double *x, const double *p, double *q);

/* What a linear step w from x gets wrong about stretch, elastics included: see dr_stretch_second_order. */
double dr_cloth_second_order(const struct dr_cloth *cloth, const double *x, const double *w,
                             double *ret_strain);

/* max over free nodes of |f_i|, N; NaN if any is. */
double dr_cloth_largest_force(const struct dr_cloth *cloth, const double *f);

/* The weight that forces are measured against: mean mass of a node times |g| (9.81 when there is no
 * gravity), N. */
double dr_cloth_mean_weight(const struct dr_cloth *cloth);

#endif
