/* plan.c - decides which terms, buffers, matrix and method a run needs, and accounts for their bytes. */
#include "plan.h"

#include <math.h>
#include <string.h>

#include "state.h"

static void decide(struct dr_plan *plan, enum dr_term term, const char *name, bool kept, size_t bytes,
                   const char *reason)
{
    plan->term[term] = (drape_term){name, kept, kept ? bytes : 0, kept ? "" : reason};
}

/* ---- the method --------------------------------------------------------------------------------- */

/* Why cloth is not kept off itself; NULL: it is. By itself that is asked for where layers can be expected to
 * meet: sewn garments, several pieces, cloth that bodies push. */
static const char *reason_without_self(const drape_scene *scene, const drape_options *options)
{
    if (scene->self_contact == DRAPE_SELF_CONTACT_OFF)
        return "switched off";
    if (options->method == DRAPE_METHOD_NEWTON)
        return "auto: plain Newton takes its steps whole";
    if (scene->self_contact == DRAPE_SELF_CONTACT_ON)
        return NULL;
    return scene->seams || scene->bodies || scene->parts > 1 ? NULL : "auto: one piece, no seams, no body";
}

static const struct dr_method *method_of(const drape_scene *scene, const drape_options *options)
{
    static const struct dr_method *const stepper[] = {
        [DRAPE_BACKWARD_EULER] = &dr_backward_euler,
        [DRAPE_BDF2] = &dr_bdf2,
        [DRAPE_IMPLICIT_MIDPOINT] = &dr_implicit_midpoint,
        [DRAPE_RK4] = &dr_rk4,
    };
    switch (options->method) {
    case DRAPE_METHOD_AUTO:
        return scene->bodies || !reason_without_self(scene, options) ? &dr_mixed_touching : &dr_mixed;
    case DRAPE_METHOD_QUASI_STATIC:
        return &dr_quasi_static;
    case DRAPE_METHOD_NEWTON:
        return &dr_newton;
    case DRAPE_METHOD_STOP_AND_GO:
    case DRAPE_METHOD_DYNAMIC:
    case DRAPE_METHOD_VELOCITY_CORRECTION:
        break;
    }
    return stepper[options->integrator];
}

/* What the report calls it. */
static void name_method(const drape_options *options, drape_report *report)
{
    bool automatic = options->method == DRAPE_METHOD_AUTO;
    report->method = options->method;
    report->stop_on = automatic ? DRAPE_STOP_ON_KINETIC : options->stop_on;
    report->integrator = dr_steps_in_time(options) ? options->integrator : DRAPE_BACKWARD_EULER;
}

/* ---- the terms ---------------------------------------------------------------------------------- */

static const char *reason_not_to_sew(const drape_scene *scene)
{
    if (!scene->seams)
        return "no seams";
    return scene->pieces ? "only the start is evaluated" : "the seams start closed";
}

static const char *reason_not_to_move(const drape_scene *scene)
{
    return scene->path ? "only the start is evaluated" : "no body moves";
}

/* Why the coarse mesh is left aside; NULL: it comes first. */
static const char *reason_without_coarse(const drape_scene *scene, const drape_options *options)
{
    if (!scene->coarse)
        return scene->coarse_left_out;
    if (!scene->pieces && !scene->coarse_asked_for && options->method != DRAPE_METHOD_AUTO)
        return "auto: nothing has to be sewn";
    return options->max_iterations ? NULL : "only the start is evaluated";
}

static bool has_friction(const drape_scene *scene, bool self)
{
    double most = 0;
    for (size_t b = 0; b < scene->bodies; b++)
        most = fmax(most, dr_body_friction(scene->body[b]));
    for (size_t m = 0; (scene->bodies || self) && m < scene->materials; m++)
        most = fmax(most, scene->material[m].friction);
    return most > 0;
}

/* With the bytes that the scene holds for each; the state gets those that no other term accounts for. */
static void decide_terms(struct dr_plan *plan, const drape_scene *scene, const drape_options *options)
{
    static const char explicit[] = "the integrator is explicit";
    const struct dr_cloth_plan *cloth = &plan->welded;
    bool implicit = cloth->matrix != DR_MATRIX_NONE;
    size_t body_bytes = 0, sewing_bytes = 0, others = 0;
    for (size_t b = 0; b < scene->bodies; b++)
        body_bytes += dr_body_bytes(scene->body[b]);
    if (scene->pieces)
        sewing_bytes = dr_mesh_bytes(scene->pieces) + dr_bend_bytes(scene->pieces_bend);
    if (scene->piece_part)
        sewing_bytes += scene->vertices * sizeof *scene->piece_part;

    decide(plan, DR_TERM_STRETCH, "stretch", true, dr_mesh_bytes(cloth->mesh), "");
    decide(plan, DR_TERM_CURVES, "strain-stress-curves", scene->curve_points > 0,
           2 * scene->curve_points * sizeof(double), "every fabric is linear");
    decide(plan, DR_TERM_ELASTICS, "elastics", cloth->elastics, scene->bars * sizeof *scene->bar,
           "no elastic in the scene");
    decide(plan, DR_TERM_BEND, "bend", cloth->bend, cloth->bend ? dr_bend_bytes(cloth->bend) : 0,
           "no material has bending rigidity");
    decide(plan, DR_TERM_FOLDS, "folds", cloth->folds, scene->hinges * sizeof *scene->hinge,
           "no fold in the scene");
    decide(plan, DR_TERM_GRAVITY, "gravity", cloth->gravity, 0, "gravity is zero");
    decide(plan, DR_TERM_CONTACT, "contact", cloth->contact, body_bytes, "no body in the scene");
    decide(plan, DR_TERM_FRICTION, "friction", cloth->friction, 0,
           scene->bodies || cloth->self ? "neither bodies nor fabrics have any"
                                        : "no body in the scene, no self-contact");
    decide(plan, DR_TERM_TACKS, "tacks", cloth->tacks, scene->tacks * sizeof *scene->tack,
           "no tack in the scene");
    decide(plan, DR_TERM_SELF_CONTACT, "self-contact", cloth->self, 0, reason_without_self(scene, options));
    decide(plan, DR_TERM_SEWING, "sewing", plan->pieces.mesh, sewing_bytes, reason_not_to_sew(scene));
    const char *without_coarse = reason_without_coarse(scene, options);
    decide(plan, DR_TERM_COARSE, "coarse", !without_coarse, dr_scene_coarse_bytes(scene), without_coarse);
    decide(plan, DR_TERM_MOTION, "motion", plan->moved.mesh, dr_scene_motion_bytes(scene),
           reason_not_to_move(scene));
    decide(plan, DR_TERM_RAMP, "ramp", scene->old_stretch && implicit && options->max_iterations,
           3 * scene->mesh->triangles * sizeof(double),
           scene->old_stretch ? (implicit ? "only the start is evaluated" : explicit)
           : scene->draped    ? "the start is a drape of this pattern"
                              : "the start is not a drape");
    decide(plan, DR_TERM_JACOBIAN, "jacobian", implicit, 0, explicit);
    decide(plan, DR_TERM_GEOMETRIC_STIFFNESS, "geometric-stiffness", implicit, 0, explicit);
    decide(plan, DR_TERM_VELOCITIES, "velocities", plan->method->moves, 0, "the method has none");
    decide(plan, DR_TERM_CONJUGATE_GRADIENTS, "conjugate-gradients", plan->method->conjugate, 0,
           "steps are taken from the factor alone");
    decide(plan, DR_TERM_CERTIFICATE, "certificate", options->certify, 0, "not asked for");
    decide(plan, DR_TERM_FIT, "fit", options->fit, 0, "not asked for");
    for (int t = 0; t < DR_TERMS; t++)
        others += plan->term[t].bytes;
    decide(plan, DR_TERM_STATE, "state", true, dr_scene_bytes(scene) - others, "");
    decide(plan, DR_TERM_TRACE, "trace", true, 0, "");
}

void dr_plan_compile(struct drape_sim *sim)
{
    const drape_scene *scene = sim->scene;
    const double *g = scene->gravity;
    struct dr_plan *plan = &sim->plan;
    bool self = !reason_without_self(scene, &sim->options);
    name_method(&sim->options, &sim->report);
    plan->method = method_of(scene, &sim->options);
    plan->welded = (struct dr_cloth_plan){
        .scene = scene,
        .mesh = scene->mesh,
        .bend = scene->bend,
        .gravity = g[0] != 0 || g[1] != 0 || g[2] != 0,
        .contact = scene->bodies > 0,
        .friction = has_friction(scene, self),
        .self = self,
        .elastics = scene->bars > 0,
        .folds = scene->hinges > 0,
        .tacks = scene->tacks > 0,
        .matrix = plan->method->matrix,
        .analyses = sim->options.analyses,
        .hand = &sim->hand,
    };
    if (scene->pieces && sim->options.max_iterations)
        plan->pieces = (struct dr_cloth_plan){
            .scene = scene,
            .body = scene->first_body,
            .mesh = scene->pieces,
            .bend = scene->pieces_bend,
            .contact = scene->bodies > 0,
            .self = self && scene->piece_part, /* the edges of one garment have yet to meet */
            .part = scene->piece_part,
            .tacks = scene->tacks > 0,
            .link = scene->seam,
            .links = scene->seams,
            .analyses = sim->options.analyses,
            .hand = &sim->hand,
            .matrix = DR_MATRIX_PRECONDITIONER, /* steps that are cut to millimetres need no more */
        };
    if (scene->path && sim->options.max_iterations) {
        plan->moved = plan->welded;
        plan->moved.matrix = DR_MATRIX_CHOLESKY;
    }
    decide_terms(plan, scene, &sim->options);
    plan->term[DR_TERM_STATE].bytes +=
        sizeof *sim + 3 * (scene->vertices + scene->mesh->nodes) * sizeof(double);
    if (sim->fit)
        plan->term[DR_TERM_FIT].bytes = dr_fit_bytes(sim->fit);
    plan->term[DR_TERM_TRACE].bytes = ((size_t)sim->options.max_iterations + 1) * sizeof *sim->row;
}

void dr_plan_keep(struct dr_plan *plan, enum dr_term term)
{
    plan->term[term].kept = true;
    plan->term[term].reason = "";
}

/* ---- the bytes ---------------------------------------------------------------------------------- */

static size_t sum(const size_t bytes[DR_TERMS])
{
    size_t all = 0;
    for (int t = 0; t < DR_TERMS; t++)
        all += bytes[t];
    return all;
}

void dr_plan_hold(struct dr_plan *plan, drape_phase phase, const size_t bytes[DR_TERMS])
{
    struct dr_held *held = &plan->held[phase];
    if (held->ran && sum(bytes) <= sum(held->bytes))
        return;
    held->ran = true;
    memcpy(held->bytes, bytes, sizeof held->bytes);
}

size_t dr_plan_held(const struct dr_plan *plan)
{
    size_t held = 0;
    for (int t = 0; t < DR_TERMS; t++)
        held += plan->term[t].bytes;
    return held;
}

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

void dr_plan_report(const struct dr_plan *plan, drape_report *report)
{
    const struct dr_held *held = plan->held;
    _Static_assert(DR_TERMS <= DRAPE_MAX_TERMS, "the report has room for every term");
    memcpy(report->term, plan->term, sizeof plan->term);
    report->terms = DR_TERMS;
    for (int t = 0; t < DR_TERMS; t++)
        report->term[t].bytes +=
            larger(held[DRAPE_PHASE_DRAPING].bytes[t], held[DRAPE_PHASE_CERTIFYING].bytes[t]);
    report->term[DR_TERM_SEWING].bytes += sum(held[DRAPE_PHASE_SEWING].bytes);
    report->term[DR_TERM_MOTION].bytes += sum(held[DRAPE_PHASE_MOVING].bytes);
    report->term[DR_TERM_COARSE].bytes += sum(held[DRAPE_PHASE_COARSE].bytes);
    for (int p = 0; p < DRAPE_PHASES; p++) {
        report->phase_bytes[p] = held[p].ran ? dr_plan_held(plan) + sum(held[p].bytes) : 0;
        report->peak_bytes = larger(report->peak_bytes, report->phase_bytes[p]);
    }
}
