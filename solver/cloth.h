/* cloth.h - the mechanics of one mesh: which terms it has, their energies, forces and step matrix.
 *
 * The plan of a run: a term the scene does not need is NULL here and costs nothing. Used twice, for
 * the loose pieces while they are sewn and for the welded cloth. Belongs to one thread. */
#ifndef DR_CLOTH_H
#define DR_CLOTH_H

#include "contact.h"
#include "matrix.h"
#include "scene.h"
#include "stretch.h"

struct dr_cloth {
    const struct dr_mesh *mesh;
    const struct dr_bend *bend; /* NULL: left out */
    struct dr_stretch *stretch;
    struct dr_contact *contact; /* NULL: left out */
    struct dr_matrix *A;        /* NULL: an explicit integrator needs none */
    double gravity[3];          /* zero while sewing */
    double *start;              /* 3*nodes: where gravity's energy is zero */
    double *stress;             /* 3*triangles: what the geometric stiffness is built from */
};

enum dr_cloth_matrix { DR_MATRIX_NONE, DR_MATRIX_CHOLESKY, DR_MATRIX_LDL };

/* `start`: 3*nodes, copied. `link`: 2*links node pairs for springs (sewing), NULL if 0. The mesh, the
 * bend and the scene must outlive the cloth. */
drape_status dr_cloth_new(const drape_scene *scene, const struct dr_mesh *mesh, const struct dr_bend *bend,
                          const double gravity[3], const double *start, const uint32_t *link, size_t links,
                          enum dr_cloth_matrix matrix, struct dr_cloth **ret, drape_error *reterr);
struct dr_cloth *dr_cloth_free(struct dr_cloth *cloth); /* NULL is fine; returns NULL */
size_t dr_cloth_bytes(const struct dr_cloth *cloth);

/* Energies at x (3*nodes; kinetic is left alone) into *ret, minus their gradient into f (3*nodes; the
 * entries of held nodes are reactions). Returns the potential energy. */
double dr_cloth_energy(const struct dr_cloth *cloth, const double *x, drape_energies *ret, double *f);

/* A = base (see dr_matrix_set_base) + the Hessian at x, with the geometric stiffness of cloth->stress:
 * its tensile part and `indefinite` times its compressive part and the bodies' curvature. 0: positive
 * semi-definite; 1, with the stress at x: the true Hessian (see dr_stretch_hessian, dr_contact_hessian). */
void dr_cloth_assemble(struct dr_cloth *cloth, const double *x, double indefinite);

/* max over free nodes of |f_i|, N; NaN if any is. */
double dr_cloth_largest_force(const struct dr_cloth *cloth, const double *f);

/* The weight that forces are measured against: mean mass of a node times |g| (9.81 when there is no
 * gravity), N. */
double dr_cloth_mean_weight(const struct dr_cloth *cloth);

#endif
