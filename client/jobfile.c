/* jobfile.c - see jobfile.h. */
#include "jobfile.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "glbfile.h"

#define MAX_BODIES 1024

/* Copies an array of `count` numbers; false when one is not. */
static bool copy_numbers(const json_t *array, double *out, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const json_t *value = json_array_get(array, i);
        if (!json_is_number(value)) {
            return false;
        }
        out[i] = json_number_value(value);
    }
    return true;
}

static bool copy_indices(const json_t *array, uint32_t *out, size_t count, size_t limit)
{
    for (size_t i = 0; i < count; i++) {
        const json_t *value = json_array_get(array, i);
        if (!json_is_integer(value) || json_integer_value(value) < 0 ||
            (unsigned long long)json_integer_value(value) >= limit) {
            return false;
        }
        out[i] = (uint32_t)json_integer_value(value);
    }
    return true;
}

/* {"positions", "triangles"}: flat arrays. */
static int read_mesh(const char *path, const char *what, const json_t *mesh, struct surface *ret,
                     struct failure *failure)
{
    const json_t *positions = json_object_get(mesh, "positions"),
                 *triangles = json_object_get(mesh, "triangles");
    size_t numbers = json_array_size(positions), corners = json_array_size(triangles);
    struct surface made;
    if (numbers == 0 || numbers % 3 != 0 || corners == 0 || corners % 3 != 0) {
        return failure_set(failure, EXIT_USAGE, "%s: %s has no positions and triangles, three numbers each",
                           path, what);
    }
    if (surface_new(numbers / 3, corners / 3, false, &made) < 0) {
        return failure_no_memory(failure);
    }
    if (!copy_numbers(positions, made.positions, numbers) ||
        !copy_indices(triangles, made.triangle, corners, made.vertices)) {
        surface_done(&made);
        return failure_set(failure, EXIT_USAGE, "%s: %s has a value that is no number or no vertex", path,
                           what);
    }
    *ret = made;
    return 0;
}

static bool read_sphere(const json_t *json, struct picture_body *body)
{
    body->shape = PICTURE_SPHERE;
    body->radius = json_number_value(json_object_get(json, "radius"));
    return copy_numbers(json_object_get(json, "center"), body->point, 3) && body->radius > 0;
}

static bool read_plane(const json_t *json, struct picture_body *body)
{
    body->shape = PICTURE_PLANE;
    return copy_numbers(json_object_get(json, "point"), body->point, 3) &&
           copy_numbers(json_object_get(json, "normal"), body->axis, 3);
}

static bool read_capsule(const json_t *json, struct picture_body *body)
{
    body->shape = PICTURE_CAPSULE;
    body->radius = json_number_value(json_object_get(json, "radius"));
    return copy_numbers(json_object_get(json, "a"), body->point, 3) &&
           copy_numbers(json_object_get(json, "b"), body->axis, 3) && body->radius > 0;
}

/* The last posture of a body that moves. */
static int read_motion(const char *path, const json_t *keyframe, struct picture_body *body,
                       struct failure *failure)
{
    const json_t *positions = json_object_get(keyframe, "positions");
    size_t numbers = 3 * body->mesh.vertices;
    body->arrived = malloc(numbers * sizeof *body->arrived);
    if (!body->arrived) {
        return failure_no_memory(failure);
    }
    if (json_array_size(positions) != numbers || !copy_numbers(positions, body->arrived, numbers)) {
        return failure_set(failure, EXIT_USAGE, "%s: a body moves to other vertices than its own", path);
    }
    return 0;
}

/* 1: read, 0: not shown (a reference), -1: wrong. */
static int read_body(const char *path, const json_t *json, struct picture_body *body, struct failure *failure)
{
    const json_t *mesh = json_object_get(json, "mesh"), *motion = json_object_get(json, "motion");
    const json_t *last = json_array_size(motion) ? json_array_get(motion, json_array_size(motion) - 1) : NULL;
    if (json_object_get(json, "ref") || json_object_get(mesh, "ref") || json_object_get(last, "ref")) {
        return 0;
    }
    if (mesh) {
        if (read_mesh(path, "a body's mesh", mesh, &body->mesh, failure) < 0) {
            return -1;
        }
        return last && read_motion(path, last, body, failure) < 0 ? -1 : 1;
    }
    if (read_sphere(json_object_get(json, "sphere"), body) ||
        read_plane(json_object_get(json, "plane"), body) ||
        read_capsule(json_object_get(json, "capsule"), body)) {
        return 1;
    }
    return failure_set(failure, EXIT_USAGE, "%s: a body is neither mesh nor sphere, plane or capsule", path);
}

static int read_bodies(const char *path, const json_t *bodies, struct picture *picture, size_t *ret_skipped,
                       struct failure *failure)
{
    size_t count = json_array_size(bodies);
    if (count > MAX_BODIES) {
        return failure_set(failure, EXIT_USAGE, "%s: more than %d bodies", path, MAX_BODIES);
    }
    picture->body = calloc(count + 1, sizeof *picture->body);
    if (!picture->body) {
        return failure_no_memory(failure);
    }
    for (size_t i = 0; i < count; i++) {
        int status = read_body(path, json_array_get(bodies, i), &picture->body[picture->bodies], failure);
        if (status < 0) {
            picture->bodies++; /* it may hold something */
            return -1;
        }
        picture->bodies += status == 1;
        *ret_skipped += status == 0;
    }
    return 0;
}

static json_t *parse_json(const char *path, const char *text, size_t bytes, struct failure *failure)
{
    json_error_t error;
    json_t *json = json_loadb(text, bytes, 0, &error);
    if (!json) {
        failure_set(failure, EXIT_USAGE, "%s:%d:%d: not JSON: %s", path, error.line, error.column,
                    error.text);
    }
    return json;
}

int jobfile_parse(const char *path, const char *text, size_t bytes, struct picture *ret, size_t *ret_skipped,
                  struct failure *failure)
{
    struct picture picture = {0};
    json_t *job = parse_json(path, text, bytes, failure);
    if (!job) {
        return -1;
    }
    *ret_skipped = 0;
    const json_t *mesh = json_object_get(json_object_get(job, "cloth"), "mesh");
    int status = read_bodies(path, json_object_get(job, "bodies"), &picture, ret_skipped, failure);
    if (status == 0 && json_object_get(mesh, "positions")) {
        status = read_mesh(path, "the cloth's mesh", mesh, &picture.cloth, failure);
    }
    json_decref(job);
    if (status < 0) {
        picture_done(&picture);
        return -1;
    }
    *ret = picture;
    return 0;
}

/* The values that the map shows; see jobfile_set_result. */
static int read_values(const char *path, const char *data, size_t bytes, const char *map,
                       struct surface *cloth, struct failure *failure)
{
    const struct picture_map *shown = map ? picture_map_find(map) : picture_maps;
    if (!shown) {
        return failure_set(failure, EXIT_USAGE, "there is no map \"%s\"", map);
    }
    if (!shown->attribute) {
        return 0;
    }
    if (glbfile_read_values(path, data, bytes, shown->attribute, cloth, failure) < 0) {
        return -1;
    }
    if (map && !cloth->value) {
        return failure_set(failure, EXIT_USAGE, "%s has no %s: it takes \"fit\": true in the job, and a GLB",
                           path, map);
    }
    return 0;
}

int jobfile_set_result(const char *path, const char *data, size_t bytes, const char *map,
                       struct picture *picture, struct failure *failure)
{
    struct surface cloth = {0};
    bool binary = bytes >= 4 && memcmp(data, "glTF", 4) == 0;
    int status;
    if (binary) {
        status = glbfile_parse(path, data, bytes, &cloth, failure);
    } else {
        json_t *result = parse_json(path, data, bytes, failure);
        status = result ? read_mesh(path, "the result", result, &cloth, failure) : -1;
        json_decref(result);
    }
    if (status == 0 && binary) {
        status = read_values(path, data, bytes, map, &cloth, failure);
    } else if (status == 0 && map && strcmp(map, "none") != 0) {
        status = failure_set(failure, EXIT_USAGE, "%s is no GLB: it has no %s by vertex", path, map);
    }
    if (status < 0) {
        surface_done(&cloth);
        return -1;
    }
    surface_done(&picture->cloth);
    picture->cloth = cloth;
    for (size_t b = 0; b < picture->bodies; b++) {
        struct picture_body *body = &picture->body[b];
        if (body->arrived) { /* draped means moved, too */
            memcpy(body->mesh.positions, body->arrived, 3 * body->mesh.vertices * sizeof *body->arrived);
        }
    }
    picture->map = cloth.value ? (map ? picture_map_find(map) : picture_maps) : NULL;
    return 0;
}
