/* report.c - what the solver says, as JSON: errors with their place, progress, reports, materials. */
#include "schema.h"

#include <math.h>
#include <string.h>

#include "materials.h"

/* ---- the solver's errors ---------------------------------------------------------------------- */

/* The contract's name of a C member, as a path below its object. */
struct member {
    const char *name, *path;
};

static const struct member MATERIAL_MEMBER[] = {{"stretch_weft", "stretch/weft"},
                                                {"stretch_warp", "stretch/warp"},
                                                {"stretch_shear", "stretch/shear"},
                                                {"bend_weft", "bend/weft"},
                                                {"bend_warp", "bend/warp"},
                                                {"bend_twist", "bend/twist"},
                                                {"density", "density"},
                                                {"poisson", "poisson"},
                                                {"shrink_weft", "shrink/weft"},
                                                {"shrink_warp", "shrink/warp"},
                                                {NULL, NULL}};
/* the other members of a body have other names in each kind, and are all checked before the solver */
static const struct member BODY_MEMBER[] = {{"offset", "offset"},
                                            {"positions", "mesh/positions"},
                                            {"vertices", "mesh/positions"},
                                            {"triangle", "mesh/triangles"},
                                            {"triangles", "mesh/triangles"},
                                            {"keyframes", "motion"},
                                            {"motion_seconds", "motion_seconds"},
                                            {NULL, NULL}};
static const struct member LINE_MEMBER[] = {
    {"factor", "factor"}, {"stiffness", "stiffness"}, {"angle", "angle"}, {"edge", "edges"}, {NULL, NULL}};
static const struct member TACK_MEMBER[] = {{"vertex", "vertex"},           {"body", "body"},
                                            {"triangle", "triangle"},       {"point", "point"},
                                            {"barycentric", "barycentric"}, {NULL, NULL}};
static const struct member SCENE_MEMBER[] = {{"gravity", "gravity"},
                                             {"positions", "cloth/mesh/positions"},
                                             {"vertices", "cloth/mesh/positions"},
                                             {"pattern", "cloth/mesh/pattern"},
                                             {"triangle", "cloth/mesh/triangles"},
                                             {"triangles", "cloth/mesh/triangles"},
                                             {"seam", "cloth/seams"},
                                             {"seams", "cloth/seams"},
                                             {"pin", "cloth/pins"},
                                             {"pins", "cloth/pins"},
                                             {"material", "cloth/materials"},
                                             {"materials", "cloth/materials"},
                                             {"triangle_material", "cloth/triangle_material"},
                                             {"elastics", "cloth/elastics"},
                                             {"folds", "cloth/folds"},
                                             {"tacks", "cloth/tacks"},
                                             {"body", "bodies"},
                                             {"bodies", "bodies"},
                                             {"self_contact", "self_contact"},
                                             {"thickness", "cloth/thickness"},
                                             {NULL, NULL}};
static const struct member OPTION_MEMBER[] = {
    {"method", "method"},           {"stop_on", "stop_on"},
    {"integrator", "integrator"},   {"time_step", "time_step"},
    {"air_damping", "damping/air"}, {"material_damping", "damping/material"},
    {"tolerance", "tolerance"},     {"max_iterations", "max_iterations"},
    {"time_limit", "time_limit_s"}, {NULL, NULL}};

/* How an element of each place is found in the document: `stride` numbers an element in a flat array. */
static const struct place {
    const char *what;  /* for the message; the element's own number follows */
    const char *array; /* pointer, from that object on where there is an `outer` */
    unsigned stride;
    const char *outer; /* pointer of the array whose object number `body` it is in; NULL: none */
    const struct member *member;
} PLACE[] = {
    [DRAPE_AT_NOWHERE] = {NULL, "", 0, NULL, NULL},
    [DRAPE_AT_VERTEX] = {"vertex", "/cloth/mesh/positions", 3, NULL, NULL},
    [DRAPE_AT_PATTERN] = {"pattern of vertex", "/cloth/mesh/pattern", 2, NULL, NULL},
    [DRAPE_AT_TRIANGLE] = {"triangle", "/cloth/mesh/triangles", 3, NULL, NULL},
    [DRAPE_AT_SEAM] = {"seam", "/cloth/seams", 2, NULL, NULL},
    [DRAPE_AT_PIN] = {"pin", "/cloth/pins", 1, NULL, NULL},
    [DRAPE_AT_MATERIAL] = {"material", "/cloth/materials", 1, NULL, MATERIAL_MEMBER},
    [DRAPE_AT_TRIANGLE_MATERIAL] = {"material of triangle", "/cloth/triangle_material", 1, NULL, NULL},
    [DRAPE_AT_BODY] = {"body", "/bodies", 1, NULL, BODY_MEMBER},
    [DRAPE_AT_BODY_VERTEX] = {"vertex", "/mesh/positions", 3, "/bodies", NULL},
    [DRAPE_AT_BODY_TRIANGLE] = {"triangle", "/mesh/triangles", 3, "/bodies", NULL},
    [DRAPE_AT_BODY_KEYFRAME] = {"keyframe", "/motion", 1, "/bodies", NULL},
    [DRAPE_AT_ELASTIC] = {"elastic", "/cloth/elastics", 1, NULL, LINE_MEMBER},
    [DRAPE_AT_ELASTIC_EDGE] = {"edge", "/edges", 2, "/cloth/elastics", NULL},
    [DRAPE_AT_FOLD] = {"fold", "/cloth/folds", 1, NULL, LINE_MEMBER},
    [DRAPE_AT_FOLD_EDGE] = {"edge", "/edges", 2, "/cloth/folds", NULL},
    [DRAPE_AT_TACK] = {"tack", "/cloth/tacks", 1, NULL, TACK_MEMBER},
    [DRAPE_AT_SCENE] = {NULL, "", 0, NULL, SCENE_MEMBER},
    [DRAPE_AT_OPTION] = {NULL, "/solver", 0, NULL, OPTION_MEMBER},
};

static const char *find_path(const struct member *member, const char *name)
{
    for (; member && name && member->name; member++)
        if (strcmp(member->name, name) == 0)
            return member->path;
    return NULL;
}

static void place_pointer(const struct place *place, const drape_error *error, char *ret, size_t size)
{
    const char *path = find_path(place->member, error->member);
    char outer[48] = "", element[32] = "";
    if (place->outer)
        snprintf(outer, sizeof outer, "%s/%lld", place->outer, (long long)error->body);
    if (place->stride > 0 && error->element >= 0)
        snprintf(element, sizeof element, "/%lld", (long long)error->element * place->stride);
    snprintf(ret, size, "%s%s%s%s%s", outer, place->array, element, path ? "/" : "", path ? path : "");
}

int schema_solver_problem(const drape_error *error, struct problem *reterr)
{
    char pointer[JSONTEXT_POINTER_BYTES];
    if (error->status == DRAPE_ENOMEM && error->place == DRAPE_AT_OPTION)
        return problem_set(reterr, PROBLEM_MEMORY_LIMIT, "%s", error->message);
    if (error->status == DRAPE_ENOMEM)
        return problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
    if (error->status != DRAPE_EINVAL)
        return problem_set(reterr, PROBLEM_SOLVER, "%s", error->message);
    size_t places = sizeof PLACE / sizeof *PLACE;
    const struct place *place = &PLACE[(size_t)error->place < places ? error->place : DRAPE_AT_NOWHERE];
    place_pointer(place, error, pointer, sizeof pointer);
    if (place->what && error->element >= 0)
        return problem_at(reterr, PROBLEM_INVALID, pointer, "%s %lld: %s", place->what,
                          (long long)error->element, error->message);
    return problem_at(reterr, PROBLEM_INVALID, pointer, "%s", error->message);
}

/* ---- progress and report ---------------------------------------------------------------------- */

/* jansson has no number for NAN and the infinities. */
static json_t *number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

static json_t *count(uint64_t value)
{
    return json_integer((json_int_t)value);
}

/* Gives up the object when any member failed. */
static json_t *finish(json_t *object, int failed)
{
    if (!failed)
        return object;
    json_decref(object);
    return NULL;
}

json_t *schema_energies_json(const drape_energies *energies)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, "stretch", number(energies->stretch));
    failed |= json_object_set_new(object, "bend", number(energies->bend));
    failed |= json_object_set_new(object, "gravity", number(energies->gravity));
    failed |= json_object_set_new(object, "contact", number(energies->contact));
    failed |= json_object_set_new(object, "kinetic", number(energies->kinetic));
    failed |= json_object_set_new(object, "potential", number(energies->potential));
    return finish(object, failed);
}

static const char *const PHASE[] = {
    [DRAPE_PHASE_SEWING] = "sewing",   [DRAPE_PHASE_MOVING] = "moving",
    [DRAPE_PHASE_DRAPING] = "draping", [DRAPE_PHASE_CERTIFYING] = "certifying",
    [DRAPE_PHASE_RAMPING] = "ramping", [DRAPE_PHASE_COARSE] = "coarse"};

/* percent stays null: the iterations that a drape needs are not known before it rests, and the share of
 * the budget that is spent says nothing about the work that is left. */
json_t *schema_progress_json(const drape_progress *progress, const drape_options *options)
{
    const drape_row *row = &progress->row;
    json_t *object = json_object();
    int failed = json_object_set_new(object, "phase", json_string(PHASE[progress->phase]));
    failed |= json_object_set_new(object, "iteration", count(row->iteration));
    failed |= json_object_set_new(object, "max_iterations", count(options->max_iterations));
    failed |= json_object_set_new(object, "elapsed_ms", count((uint64_t)(fmax(row->seconds, 0) * 1e3)));
    failed |= json_object_set_new(object, "energy", schema_energies_json(&row->energy));
    failed |= json_object_set_new(object, "residual_energy", number(row->residual_energy));
    failed |=
        json_object_set_new(object, "residual_energy_is", json_string(schema_residual_energy_is(false)));
    failed |= json_object_set_new(object, "residual_force", number(row->residual_force));
    failed |= json_object_set_new(object, "stops", count(progress->stops));
    failed |= json_object_set_new(object, "percent", json_null());
    return finish(object, failed);
}

static json_t *plan_json(const drape_report *report)
{
    json_t *kept = json_array(), *left_out = json_array(), *plan = json_object();
    int failed = 0;
    for (size_t i = 0; i < report->terms && i < DRAPE_MAX_TERMS; i++) {
        const drape_term *term = &report->term[i];
        json_t *entry = json_object();
        failed |= json_object_set_new(entry, "name", json_string(term->name));
        if (term->kept)
            failed |= json_object_set_new(entry, "bytes", count(term->bytes));
        else
            failed |= json_object_set_new(entry, "reason", json_string(term->reason));
        failed |= json_array_append_new(term->kept ? kept : left_out, entry);
    }
    failed |= json_object_set_new(plan, "kept", kept);
    failed |= json_object_set_new(plan, "left_out", left_out);
    return finish(plan, failed);
}

static json_t *sewing_json(const drape_report *report)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, "iterations", count(report->sewing_iterations));
    failed |= json_object_set_new(object, "seam_gap", number(report->seam_gap));
    return finish(object, failed);
}

static json_t *work_json(const drape_work *work)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, "factor_flops", number(work->factor_flops));
    failed |= json_object_set_new(object, "solve_bytes", number(work->solve_bytes));
    return finish(object, failed);
}

static json_t *motion_json(const drape_report *report)
{
    json_t *object = json_object();
    return finish(object, json_object_set_new(object, "frames", count(report->motion_frames)));
}

static json_t *ramp_json(const drape_report *report)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, "steps", count(report->ramp_steps));
    failed |= json_object_set_new(object, "iterations", count(report->ramp_iterations));
    failed |= json_object_set_new(object, "change", number(report->change));
    return finish(object, failed);
}

static json_t *coarse_json(const drape_report *report)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, "triangles", count(report->coarse_triangles));
    failed |= json_object_set_new(object, "iterations", count(report->coarse_iterations));
    failed |= json_object_set_new(object, "factorizations", count(report->coarse_factorizations));
    failed |= json_object_set_new(object, "carried", json_boolean(report->coarse_carried));
    return finish(object, failed);
}

static json_t *stages_json(const drape_report *report)
{
    json_t *object = json_object();
    int failed = object == NULL;
    for (size_t i = 0; i < report->stages && i < DRAPE_MAX_STAGES; i++)
        failed |= json_object_set_new(object, report->stage[i].name, number(report->stage[i].seconds));
    return finish(object, failed);
}

static json_t *phase_bytes_json(const drape_report *report)
{
    json_t *object = json_object();
    int failed = object == NULL;
    for (int p = 0; p < DRAPE_PHASES; p++)
        if (report->phase_bytes[p])
            failed |= json_object_set_new(object, PHASE[p], count(report->phase_bytes[p]));
    return finish(object, failed);
}

static json_t *stop_on_json(const drape_report *report)
{
    if (report->method != DRAPE_METHOD_STOP_AND_GO)
        return json_null();
    return json_string(report->stop_on == DRAPE_STOP_ON_KINETIC ? "kinetic" : "potential");
}

static json_t *integrator_json(const drape_report *report)
{
    if (report->method != DRAPE_METHOD_STOP_AND_GO && report->method != DRAPE_METHOD_DYNAMIC &&
        report->method != DRAPE_METHOD_VELOCITY_CORRECTION)
        return json_null();
    return json_string(drape_integrator_name(report->integrator));
}

/* null where there is none. */
static json_t *place_json(const double place[3])
{
    if (!isfinite(place[0]))
        return json_null();
    return json_pack("[fff]", place[0], place[1], place[2]);
}

static json_t *certificate_json(const drape_certificate *certificate)
{
    json_t *object = json_object();
    if (!certificate->reason) {
        json_decref(object);
        return json_null();
    }
    int failed = json_object_set_new(object, "certified", json_boolean(certificate->certified));
    failed |= json_object_set_new(object, "reason", json_string(certificate->reason));
    failed |= json_object_set_new(object, "largest_move", number(certificate->largest_move));
    failed |= json_object_set_new(object, "energy_left", number(certificate->energy_left));
    failed |= json_object_set_new(object, "curvature", number(certificate->curvature));
    failed |= json_object_set_new(object, "escapes", count(certificate->escapes));
    failed |= json_object_set_new(object, "steps", count(certificate->steps));
    failed |= json_object_set_new(object, "factorizations", count(certificate->factorizations));
    return finish(object, failed);
}

const char *schema_residual_energy_is(bool reference)
{
    return reference ? "reference" : "estimate";
}

/* A line that has no length in the pattern cannot be elongated. */
static json_t *line_json(const struct line *line, const struct line_length *length)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, "name", json_string(line->name));
    failed |= json_object_set_new(object, "closed", json_boolean(line->closed));
    failed |= json_object_set_new(object, "rest", number(length->rest));
    failed |= json_object_set_new(object, "draped", number(length->draped));
    failed |= json_object_set_new(object, "elongation",
                                  length->rest > 0 ? number((length->draped - length->rest) / length->rest)
                                                   : json_null());
    return finish(object, failed);
}

json_t *schema_lines_json(const struct lines *lines, const struct line_length *length)
{
    json_t *array = json_array();
    int failed = array == NULL;
    for (size_t i = 0; i < lines->count; i++)
        failed |= json_array_append_new(array, line_json(&lines->line[i], &length[i]));
    return finish(array, failed);
}

json_t *schema_report_json(const drape_report *report, json_t *lines)
{
    const drape_row *state = &report->state;
    json_t *object = json_object();
    int failed = json_object_set_new(object, "plan", plan_json(report));
    failed |= json_object_set_new(object, "method", json_string(drape_method_name(report->method)));
    failed |= json_object_set_new(object, "stop_on", stop_on_json(report));
    failed |= json_object_set_new(object, "integrator", integrator_json(report));
    failed |= json_object_set_new(object, "iterations", count(report->iterations));
    failed |= json_object_set_new(object, "stops", count(report->stops));
    failed |= json_object_set_new(object, "factorizations", count(report->factorizations));
    failed |= json_object_set_new(object, "solves", count(report->solves));
    failed |= json_object_set_new(object, "work", work_json(&report->work));
    failed |= json_object_set_new(object, "sewing", sewing_json(report));
    failed |= json_object_set_new(object, "motion", motion_json(report));
    failed |= json_object_set_new(object, "ramp", ramp_json(report));
    failed |= json_object_set_new(object, "coarse", coarse_json(report));
    failed |= json_object_set_new(object, "seconds", number(report->seconds));
    failed |= json_object_set_new(object, "borrowed_seconds", number(report->borrowed_seconds));
    failed |= json_object_set_new(object, "stages", stages_json(report));
    failed |= json_object_set_new(object, "peak_bytes", count(report->peak_bytes));
    failed |= json_object_set_new(object, "peak_bytes_by_phase", phase_bytes_json(report));
    failed |= json_object_set_new(object, "bytes_per_triangle",
                                  number((double)report->peak_bytes / (double)report->triangles));
    failed |= json_object_set_new(object, "energies", schema_energies_json(&state->energy));
    failed |= json_object_set_new(object, "residual_energy", number(state->residual_energy));
    failed |= json_object_set_new(object, "residual_energy_is",
                                  json_string(schema_residual_energy_is(report->certificate.certified)));
    failed |= json_object_set_new(object, "residual_force", number(state->residual_force));
    failed |= json_object_set_new(object, "penetrations", count(report->penetrations));
    failed |= json_object_set_new(object, "deepest", number(report->deepest));
    failed |= json_object_set_new(object, "drop", number(report->drop));
    failed |= json_object_set_new(
        object, "self_intersections",
        report->self_intersections == DRAPE_NOT_COUNTED ? json_null() : count(report->self_intersections));
    failed |= json_object_set_new(object, "intersection", place_json(report->intersection));
    failed |= json_object_set_new(object, "lines", lines ? lines : json_null());
    failed |= json_object_set_new(object, "certificate", certificate_json(&report->certificate));
    failed |= json_object_set_new(object, "reason", json_string(report->reason));
    return finish(object, failed);
}

/* ---- materials -------------------------------------------------------------------------------- */

static json_t *triple_json(const char *a, double x, const char *b, double y, const char *c, double z)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, a, number(x));
    failed |= json_object_set_new(object, b, number(y));
    failed |= json_object_set_new(object, c, number(z));
    return finish(object, failed);
}

static json_t *preset_json(const struct material_preset *preset)
{
    const drape_material *m = &preset->material;
    json_t *object = json_object();
    int failed = json_object_set_new(object, "name", json_string(preset->name));
    failed |= json_object_set_new(object, "summary", json_string(preset->summary));
    failed |= json_object_set_new(object, "density", number(m->density));
    failed |= json_object_set_new(
        object, "stretch",
        triple_json("weft", m->stretch_weft, "warp", m->stretch_warp, "shear", m->stretch_shear));
    failed |= json_object_set_new(object, "poisson", number(m->poisson));
    failed |= json_object_set_new(
        object, "bend", triple_json("weft", m->bend_weft, "warp", m->bend_warp, "twist", m->bend_twist));
    failed |= json_object_set_new(object, "source", json_string(preset->source));
    return finish(object, failed);
}

json_t *schema_materials_json(void)
{
    size_t presets;
    const struct material_preset *preset = materials_all(&presets);
    json_t *array = json_array(), *object = json_object();
    int failed = 0;
    for (size_t i = 0; i < presets; i++)
        failed |= json_array_append_new(array, preset_json(&preset[i]));
    failed |= json_object_set_new(object, "materials", array);
    return finish(object, failed);
}
