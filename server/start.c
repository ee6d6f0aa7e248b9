/* start.c - see start.h. */
#include "start.h"

#include <stdlib.h>
#include <string.h>

#include "output.h"

#define POINTER "/start_from"

/* ---- from the other job to this one's start --------------------------------------------------- */

/* Takes the drape, as write_positions of output.c left it; `spec` has as many vertices or refuses. */
static int take_drape(struct job_spec *spec, const char *drape, size_t bytes, struct problem *reterr)
{
    size_t vertex = 3 * sizeof(double), wanted = spec->cloth.vertices * vertex;
    if (bytes != wanted)
        return problem_at(reterr, PROBLEM_INVALID, POINTER, "that job has %zu vertices, this one %zu",
                          bytes / vertex, spec->cloth.vertices);
    spec->start = malloc(wanted);
    if (spec->start == NULL)
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    memcpy(spec->start, drape, bytes);
    return 0;
}

static bool same_triangles(const uint32_t *a, size_t a_count, const uint32_t *b, size_t b_count)
{
    return a_count == b_count && memcmp(a, b, 3 * a_count * sizeof *a) == 0;
}

static int take_pattern(struct job_spec *spec, const struct job_spec *from, struct problem *reterr)
{
    size_t bytes = 2 * spec->cloth.vertices * sizeof(double);
    bool same = same_triangles(spec->cloth.triangle, spec->cloth.triangles, from->cloth.triangle,
                               from->cloth.triangles);
    spec->start_pattern = malloc(bytes);
    if (spec->start_pattern == NULL)
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    memcpy(spec->start_pattern, same ? from->cloth.pattern : spec->cloth.pattern, bytes);
    return 0;
}

static bool changed_shape(const drape_body *body, const drape_body *from)
{
    return body->kind == DRAPE_BODY_MESH && from->kind == DRAPE_BODY_MESH &&
           body->vertices == from->vertices &&
           same_triangles(body->triangle, body->triangles, from->triangle, from->triangles) &&
           memcmp(body->positions, from->positions, 3 * body->vertices * sizeof(double)) != 0;
}

/* The cloth goes with the first body that has changed: what of it lies nearer to another cannot be told. */
static int carry(struct job_spec *spec, const struct job_spec *from, struct problem *reterr)
{
    drape_error error;
    for (size_t b = 0; b < spec->scene.bodies && b < from->scene.bodies; b++)
        if (changed_shape(&spec->body[b], &from->body[b]))
            return drape_carry(&spec->scene, &from->body[b], &spec->body[b], spec->start, &error) < 0
                       ? schema_solver_problem(&error, reterr)
                       : 0;
    return 0;
}

/* Pins hold where the drape was, but for those that the new document has moved; what is sewn to a pin goes
 * with it, else its seam would have to be closed again. */
static int set_pins(struct job_spec *spec, const struct job_spec *from, const double *drape,
                    struct problem *reterr)
{
    const size_t vertex = 3 * sizeof(double);
    bool *pinned = calloc(spec->cloth.vertices, sizeof *pinned);
    if (pinned == NULL)
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    for (size_t i = 0; i < spec->scene.pins; i++) {
        size_t v = 3 * (size_t)spec->pin[i];
        const double *to = spec->cloth.positions + v;
        pinned[spec->pin[i]] = true;
        memcpy(spec->start + v, memcmp(to, from->cloth.positions + v, vertex) != 0 ? to : drape + v, vertex);
    }
    for (size_t s = 0; s < spec->scene.seams; s++)
        for (int side = 0; side < 2; side++) {
            size_t pin = spec->seam[2 * s + (size_t)side], other = spec->seam[2 * s + 1 - (size_t)side];
            if (pinned[pin] && !pinned[other])
                memcpy(spec->start + 3 * other, spec->start + 3 * pin, vertex);
        }
    free(pinned);
    return 0;
}

/* What the other job was: its document, read as this version would read it if it were posted now. */
static int parse_from(const struct meshref *rooms, const char *id, struct job_spec **ret,
                      struct problem *reterr)
{
    struct meshref meshref = *rooms;
    struct problem why;
    char *text;
    size_t bytes;
    if (store_start_document(rooms->store, id, &text, &bytes, reterr) != 0)
        return -1;
    int failed = schema_job_parse(text, bytes, rooms->limits, meshref_load, &meshref, ret, &why);
    free(text);
    return failed ? problem_at(reterr, PROBLEM_INVALID, POINTER, "that job's document: %s", why.detail) : 0;
}

/* Without `carried` everything but carrying the cloth, which takes the worker's time and can only fail for
 * want of memory. */
static int load(const struct meshref *rooms, const char *id, bool carried, struct job_spec *spec,
                struct problem *reterr)
{
    struct job_spec *from = NULL;
    char *drape = NULL;
    size_t bytes;
    int failed = store_start_drape(rooms->store, id, &drape, &bytes, reterr);
    if (!failed)
        failed = take_drape(spec, drape, bytes, reterr);
    if (!failed)
        failed = parse_from(rooms, id, &from, reterr);
    if (!failed)
        failed = take_pattern(spec, from, reterr) || (carried && carry(spec, from, reterr)) ||
                 set_pins(spec, from, (const double *)(const void *)drape, reterr) ||
                 schema_scene_check(spec, reterr);
    job_spec_free(from);
    free(drape);
    return failed ? -1 : 0;
}

int start_load(const struct meshref *rooms, const char *id, struct job_spec *spec, struct problem *reterr)
{
    return load(rooms, id, true, spec, reterr);
}

/* ---- a job that is posted ----------------------------------------------------------------------- */

static int refuse(int found, const char *from, struct problem *reterr)
{
    switch (found) {
    case STORE_NONE:
        return problem_at(reterr, PROBLEM_NOT_FOUND, POINTER, "there is no job %s", from);
    case STORE_GONE:
        return problem_at(reterr, PROBLEM_GONE, POINTER, "job %s was removed", from);
    case STORE_UNFINISHED:
        return problem_at(reterr, PROBLEM_NOT_READY, POINTER, "job %s has not ended yet", from);
    case STORE_WITHOUT:
        return problem_at(reterr, PROBLEM_NO_RESULT, POINTER, "job %s ended without a drape", from);
    default:
        return -1; /* the store has said why */
    }
}

int start_keep(const struct meshref *rooms, const char *id, struct job_spec *spec, struct problem *reterr)
{
    int found = store_start_keep(rooms->store, rooms->owner, id, spec->start_from, OUTPUT_POSITIONS, reterr);
    if (found != 0)
        return refuse(found, spec->start_from, reterr);
    int failed = load(rooms, id, false, spec, reterr);
    if (failed)
        store_start_drop(rooms->store, id);
    return failed;
}
