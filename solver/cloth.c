/* cloth.c - sums the terms of one mesh's mechanics. */
#include "cloth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "lines.h"

#define MOST_SWEEPS 1000 /* of bracing */

/* Friction of the cloth with itself: fabrics that state none have that of the roughest body. */
static drape_status roughen(const drape_scene *scene, struct dr_cloth *cloth, drape_error *reterr)
{
    size_t nodes = cloth->mesh->nodes;
    double *array = malloc(3 * nodes * sizeof *array), mu = 0;
    if (!array)
        return dr_out_of_memory(reterr);
    for (size_t b = 0; b < scene->bodies; b++)
        mu = fmax(mu, dr_body_friction(scene->body[b]));
    dr_friction_coefficients(cloth->mesh, scene->material, array, array + nodes, array + 2 * nodes);
    drape_status status = dr_self_roughen(cloth->self, array, array + nodes, mu, reterr);
    free(array);
    return status;
}

/* The terms beside the matrix. */
static drape_status new_terms(const struct dr_cloth_plan *plan, const double *start, struct dr_cloth *cloth,
                              drape_error *reterr)
{
    const drape_scene *scene = plan->scene;
    size_t nodes = plan->mesh->nodes, triangles = plan->mesh->triangles;
    if (plan->gravity) {
        memcpy(cloth->gravity, scene->gravity, sizeof cloth->gravity);
        cloth->start = malloc(3 * nodes * sizeof *start);
        if (!cloth->start)
            return dr_out_of_memory(reterr);
        memcpy(cloth->start, start, 3 * nodes * sizeof *start);
    }
    if (plan->matrix != DR_MATRIX_NONE) {
        cloth->stress = calloc(3 * triangles, sizeof *cloth->stress);
        if (!cloth->stress)
            return dr_out_of_memory(reterr);
    }
    drape_status status =
        dr_stretch_new(plan->mesh, scene->material, scene->materials, &cloth->stretch, reterr);
    if (status >= 0 && plan->contact)
        status = dr_contact_new(plan->mesh, plan->body ? plan->body : scene->body, scene->bodies,
                                &cloth->contact, reterr);
    if (status >= 0 && cloth->contact)
        dr_contact_lend(cloth->contact, plan->hand);
    if (status >= 0 && plan->friction && plan->contact)
        status = dr_friction_new(cloth->contact, plan->mesh, scene->material, &cloth->friction, reterr);
    if (status >= 0 && plan->self)
        status = dr_self_new(plan->mesh, scene->thickness, &cloth->self, reterr);
    if (status >= 0 && cloth->self)
        dr_self_lend(cloth->self, plan->hand);
    if (status >= 0 && plan->self && plan->part)
        dr_self_between(cloth->self, plan->part);
    if (status >= 0 && plan->self && plan->friction)
        status = roughen(scene, cloth, reterr);
    return status;
}

/* Elastics, folds and tacks; the first two have links behind the plan's own. */
static drape_status new_lines(const struct dr_cloth_plan *plan, struct dr_cloth *cloth, drape_error *reterr)
{
    const drape_scene *scene = plan->scene;
    size_t link = plan->links;
    drape_status status = DRAPE_OK;
    if (plan->elastics) {
        status = dr_elastic_new(scene->bar, scene->bars, link, plan->matrix != DR_MATRIX_NONE,
                                &cloth->elastic, reterr);
        link += scene->bars;
    }
    if (status >= 0 && plan->folds)
        status = dr_fold_new(scene->hinge, scene->hinges, link, &cloth->fold, reterr);
    if (status >= 0 && plan->tacks)
        status = dr_tacks_new(scene->tack, scene->tacks, plan->mesh == scene->pieces, &cloth->tacks, reterr);
    return status;
}

/* The plan's links, then those of the elastics and folds, into *ret, which the caller frees; NULL where the
 * plan's alone are all. */
static drape_status join_links(const struct dr_cloth_plan *plan, uint32_t **ret, size_t *ret_links,
                               drape_error *reterr)
{
    const drape_scene *scene = plan->scene;
    size_t bars = plan->elastics ? scene->bars : 0, hinges = plan->folds ? scene->hinges : 0;
    *ret = NULL;
    *ret_links = plan->links + bars + DR_HINGE_LINKS * hinges;
    if (*ret_links == plan->links)
        return DRAPE_OK;
    uint32_t *next = *ret = malloc(2 * *ret_links * sizeof *next);
    if (!next)
        return dr_out_of_memory(reterr);
    if (plan->links)
        memcpy(next, plan->link, 2 * plan->links * sizeof *next);
    next += 2 * plan->links;
    for (size_t i = 0; i < bars; i++, next += 2)
        memcpy(next, scene->bar[i].node, sizeof scene->bar[i].node);
    for (size_t i = 0; i < hinges; i++, next += 2 * DR_HINGE_LINKS)
        dr_hinge_links(scene->hinge + i, next);
    return DRAPE_OK;
}

/* Of the mesh that the folds cut, as its bending is. */
static drape_status new_hinges(const struct dr_cloth *cloth, struct dr_bend_stiffness **ret,
                               drape_error *reterr)
{
    if (!cloth->fold)
        return dr_bend_hinges_new(cloth->bend, cloth->mesh, ret, reterr);
    struct dr_mesh cut = dr_lines_cut(cloth->mesh, cloth->scene->hinge, cloth->scene->hinges);
    drape_status status =
        cut.neighbor ? dr_bend_hinges_new(cloth->bend, &cut, ret, reterr) : dr_out_of_memory(reterr);
    free(cut.neighbor);
    return status;
}

static void free_stiffness(struct dr_cloth *cloth)
{
    if (cloth->stiffness)
        cloth->stiffness = dr_bend_stiffness_free(cloth->stiffness);
    if (cloth->remainder)
        cloth->remainder = dr_bend_stiffness_free(cloth->remainder);
}

static drape_status new_stiffness(struct dr_cloth *cloth, bool whole, drape_error *reterr)
{
    struct dr_bend_stiffness *all = NULL;
    drape_status status = dr_bend_stiffness_new(cloth->bend, cloth->mesh->nodes, &all, reterr);
    if (status < 0 || whole) {
        cloth->stiffness = all;
        return status;
    }
    cloth->remainder = all;
    status = new_hinges(cloth, &cloth->stiffness, reterr);
    if (status >= 0)
        dr_bend_stiffness_subtract(cloth->remainder, cloth->stiffness);
    return status;
}

drape_status dr_cloth_make_exact(struct dr_cloth *cloth, bool exact, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    if (exact)
        dr_matrix_prefer(cloth->A, DR_CHOLESKY);
    if (cloth->stiffness && exact != !cloth->remainder) {
        free_stiffness(cloth);
        status = new_stiffness(cloth, exact, reterr);
        if (status >= 0)
            status = dr_matrix_rebend(cloth->A, cloth->stiffness, reterr);
    }
    if (status >= 0 && !exact && !dr_matrix_prefer(cloth->A, DR_SINGLE))
        return dr_out_of_memory(reterr);
    return status;
}

void dr_cloth_add_remainder(const struct dr_cloth *cloth, const double *p, double *q)
{
    if (cloth->remainder)
        dr_bend_stiffness_multiply(cloth->remainder, p, q);
}

static const enum dr_factor factor[] = {
    [DR_MATRIX_CHOLESKY] = DR_CHOLESKY, [DR_MATRIX_PRECONDITIONER] = DR_SINGLE, [DR_MATRIX_LDL] = DR_LDL};

static drape_status new_matrix(const struct dr_cloth_plan *plan, struct dr_cloth *cloth, drape_error *reterr)
{
    uint32_t *link;
    size_t links;
    drape_status status = join_links(plan, &link, &links, reterr);
    if (status >= 0 && plan->bend)
        status = new_stiffness(cloth, plan->matrix != DR_MATRIX_PRECONDITIONER, reterr);
    if (status >= 0)
        status = dr_matrix_new(plan->mesh, cloth->stiffness, link ? link : plan->link, links,
                               factor[plan->matrix], plan->analyses, &cloth->A, reterr);
    if (status >= 0)
        dr_matrix_lend(cloth->A, plan->hand);
    free(link);
    return status;
}

drape_status dr_cloth_new(const struct dr_cloth_plan *plan, const double *start, struct dr_cloth **ret,
                          drape_error *reterr)
{
    struct dr_cloth *cloth = calloc(1, sizeof *cloth);
    if (!cloth)
        return dr_out_of_memory(reterr);
    cloth->scene = plan->scene;
    cloth->mesh = plan->mesh;
    cloth->bend = plan->bend;
    drape_status status = new_terms(plan, start, cloth, reterr);
    if (status >= 0)
        status = new_lines(plan, cloth, reterr);
    if (status >= 0 && plan->matrix != DR_MATRIX_NONE)
        status = new_matrix(plan, cloth, reterr);
    if (status < 0)
        dr_cloth_free(cloth);
    else
        *ret = cloth;
    return status;
}

struct dr_cloth *dr_cloth_free(struct dr_cloth *cloth)
{
    if (cloth) {
        dr_matrix_free(cloth->A);
        free_stiffness(cloth);
        if (cloth->self)
            dr_self_free(cloth->self);
        dr_friction_free(cloth->friction);
        dr_contact_free(cloth->contact);
        dr_tacks_free(cloth->tacks);
        dr_fold_free(cloth->fold);
        dr_elastic_free(cloth->elastic);
        dr_stretch_free(cloth->stretch);
        free(cloth->start);
        free(cloth->stress);
        free(cloth);
    }
    return NULL;
}

void dr_cloth_bytes(const struct dr_cloth *cloth, size_t bytes[DR_TERMS])
{
    size_t curves = dr_stretch_curve_bytes(cloth->stretch);
    bytes[DR_TERM_STRETCH] += sizeof *cloth + dr_stretch_bytes(cloth->stretch) - curves;
    bytes[DR_TERM_CURVES] += curves;
    if (cloth->start)
        bytes[DR_TERM_GRAVITY] += 3 * cloth->mesh->nodes * sizeof *cloth->start;
    if (cloth->contact)
        bytes[DR_TERM_CONTACT] += dr_contact_bytes(cloth->contact);
    if (cloth->friction)
        bytes[DR_TERM_FRICTION] += dr_friction_bytes(cloth->friction);
    if (cloth->self)
        bytes[DR_TERM_SELF_CONTACT] += dr_self_bytes(cloth->self);
    if (cloth->elastic)
        bytes[DR_TERM_ELASTICS] += dr_elastic_bytes(cloth->elastic);
    if (cloth->fold)
        bytes[DR_TERM_FOLDS] += dr_fold_bytes(cloth->fold);
    if (cloth->tacks)
        bytes[DR_TERM_TACKS] += dr_tacks_bytes(cloth->tacks);
    if (cloth->A)
        bytes[DR_TERM_JACOBIAN] += dr_matrix_bytes(cloth->A);
    if (cloth->stiffness)
        bytes[DR_TERM_JACOBIAN] += dr_bend_stiffness_bytes(cloth->stiffness);
    if (cloth->remainder)
        bytes[DR_TERM_JACOBIAN] += dr_bend_stiffness_bytes(cloth->remainder);
    if (cloth->stress)
        bytes[DR_TERM_GEOMETRIC_STIFFNESS] += 3 * cloth->mesh->triangles * sizeof *cloth->stress;
}

/* Turns the gradient f into the force, its negative plus the weight; gives gravity's energy. */
static double add_gravity(const struct dr_cloth *cloth, const double *x, double *f)
{
    const struct dr_mesh *mesh = cloth->mesh;
    const double *g = cloth->gravity;
    long double energy = 0;
    for (size_t i = 0; i < mesh->nodes; i++) {
        double fall = 0;
        for (size_t d = 0; d < 3; d++) {
            fall += g[d] * (x[3 * i + d] - cloth->start[3 * i + d]);
            f[3 * i + d] = mesh->mass[i] * g[d] - f[3 * i + d];
        }
        energy -= mesh->mass[i] * fall;
    }
    return (double)energy;
}

double dr_cloth_energy(const struct dr_cloth *cloth, const double *x, drape_energies *ret, double *f)
{
    size_t count = 3 * cloth->mesh->nodes;
    memset(f, 0, count * sizeof *f);
    ret->stretch = dr_stretch_energy(cloth->stretch, x, f);
    ret->bend = cloth->bend ? dr_bend_energy(cloth->bend, x, f) : 0;
    ret->contact = cloth->contact ? dr_contact_energy(cloth->contact, x, f) : 0;
    if (cloth->friction)
        ret->contact += dr_friction_energy(cloth->friction, x, f);
    if (cloth->self)
        ret->contact += dr_self_energy(cloth->self, x, f);
    if (cloth->elastic)
        ret->stretch += dr_elastic_energy(cloth->elastic, x, f);
    if (cloth->fold)
        ret->bend += dr_fold_energy(cloth->fold, x, f);
    if (cloth->tacks)
        ret->contact += dr_tacks_energy(cloth->tacks, x, f);
    ret->gravity = 0;
    if (cloth->start)
        ret->gravity = add_gravity(cloth, x, f);
    else
        for (size_t i = 0; i < count; i++)
            f[i] = -f[i];
    ret->potential = ret->stretch + ret->bend + ret->contact + ret->gravity;
    return ret->potential;
}

void dr_cloth_stress(struct dr_cloth *cloth, const double *x, const double *w)
{
    dr_stretch_stress(cloth->stretch, x, w, cloth->stress);
    if (cloth->elastic)
        dr_elastic_tension(cloth->elastic, x, w);
}

/* Gives the matrix a place for every pair of nodes that touch one another at x. */
static drape_status link_touching(struct dr_cloth *cloth, const double *x, drape_error *reterr)
{
    const uint32_t *link;
    size_t links;
    if (dr_self_fits(cloth->self, x, cloth->A))
        return DRAPE_OK;
    drape_status status = dr_self_links(cloth->self, x, &link, &links, reterr);
    return status < 0 ? status : dr_matrix_relink(cloth->A, link, links, reterr);
}

drape_status dr_cloth_assemble(struct dr_cloth *cloth, const double *x, double indefinite,
                               drape_error *reterr)
{
    drape_status status = cloth->self ? link_touching(cloth, x, reterr) : DRAPE_OK;
    if (status < 0)
        return status;
    dr_matrix_reset(cloth->A);
    dr_stretch_hessian(cloth->stretch, x, cloth->stress, indefinite, cloth->A);
    if (cloth->contact)
        dr_contact_hessian(cloth->contact, x, indefinite, cloth->A);
    if (cloth->friction)
        dr_friction_hessian(cloth->friction, x, cloth->slides ? 1 : indefinite, cloth->A);
    if (cloth->elastic)
        dr_elastic_hessian(cloth->elastic, x, indefinite, cloth->A);
    if (cloth->fold)
        dr_fold_hessian(cloth->fold, x, indefinite, cloth->A);
    if (cloth->tacks)
        dr_tacks_hessian(cloth->tacks, cloth->A);
    if (cloth->self)
        dr_self_hessian(cloth->self, x, indefinite, cloth->A);
    return DRAPE_OK;
}

bool dr_cloth_has_anchors(const struct dr_cloth *cloth)
{
    return cloth->friction || (cloth->self && dr_self_holds(cloth->self));
}

void dr_cloth_renew_anchors(struct dr_cloth *cloth, const double *x)
{
    if (cloth->friction)
        dr_friction_update(cloth->friction, x);
    if (cloth->self)
        dr_self_renew(cloth->self, x);
}

void dr_cloth_brace_anchors(struct dr_cloth *cloth, const double *x, double *f, double precision)
{
    const struct dr_mesh *mesh = cloth->mesh;
    double change = INFINITY;
    for (int sweep = 0; sweep < MOST_SWEEPS && change > precision; sweep++) {
        for (size_t i = 0; i < 3 * mesh->nodes; i++)
            f[i] = mesh->held[i / 3] ? 0 : f[i]; /* reactions need no friction */
        change = cloth->friction ? dr_friction_brace(cloth->friction, x, f) : 0;
        if (cloth->self)
            change = fmax(change, dr_self_brace(cloth->self, x, f));
    }
}

double dr_cloth_held(const struct dr_cloth *cloth, const double *x)
{
    return (cloth->friction ? dr_friction_energy(cloth->friction, x, NULL) : 0) +
           (cloth->self ? dr_self_held(cloth->self, x) : 0);
}

void dr_cloth_left_out(const struct dr_cloth *cloth, const double *x, const double *p, double *q)
{
    dr_stretch_left_out(cloth->stretch, x, cloth->stress, p, q);
    if (cloth->elastic)
        dr_elastic_left_out(cloth->elastic, x, p, q);
    if (cloth->fold)
        dr_fold_left_out(cloth->fold, x, p, q);
}

double dr_cloth_second_order(const struct dr_cloth *cloth, const double *x, const double *w,
                             double *ret_strain)
{
    double energy = dr_stretch_second_order(cloth->stretch, x, w, ret_strain);
    if (cloth->elastic)
        energy += dr_elastic_second_order(cloth->elastic, x, w);
    return energy;
}

double dr_cloth_largest_force(const struct dr_cloth *cloth, const double *f)
{
    double largest = 0; /* squared */
    for (size_t i = 0; i < cloth->mesh->nodes; i++) {
        double square = f[3 * i] * f[3 * i] + f[3 * i + 1] * f[3 * i + 1] + f[3 * i + 2] * f[3 * i + 2];
        if (cloth->mesh->held[i])
            continue;
        if (isnan(square))
            return square;
        largest = fmax(largest, square);
    }
    return sqrt(largest);
}

double dr_cloth_mean_weight(const struct dr_cloth *cloth)
{
    const struct dr_mesh *mesh = cloth->mesh;
    const double *g = cloth->gravity;
    double mass = 0, size = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
    for (size_t i = 0; i < mesh->nodes; i++)
        mass += mesh->mass[i];
    return mass / (double)mesh->nodes * (size > 0 ? size : 9.81);
}
