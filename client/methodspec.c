/* methodspec.c - see methodspec.h. */
#include "methodspec.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

/* A value as JSON where it is a scalar of JSON, else as text; NULL when it is not UTF-8. */
static json_t *read_value(const char *text, size_t bytes)
{
    json_t *value = json_loadb(text, bytes, JSON_DECODE_ANY | JSON_REJECT_DUPLICATES, NULL);
    if (value && !json_is_object(value) && !json_is_array(value)) {
        return value;
    }
    json_decref(value);
    return json_stringn(text, bytes);
}

/* Sets `path` ("time_step", "damping.air") in `object`, making the objects on the way. Takes `value`. */
static int set_path(json_t *object, char *path, json_t *value)
{
    char *dot;
    while ((dot = strchr(path, '.'))) {
        *dot = '\0';
        json_t *inner = json_object_get(object, path);
        if (!json_is_object(inner)) {
            inner = json_object();
            if (json_object_set_new(object, path, inner) < 0) {
                json_decref(value);
                return -1;
            }
        }
        object = inner;
        path = dot + 1;
    }
    return json_object_set_new(object, path, value); /* also drops `value` when it fails */
}

/* One "MEMBER=VALUE" of `bytes` bytes. */
static int read_option(const char *text, size_t bytes, json_t *members)
{
    const char *equals = memchr(text, '=', bytes);
    size_t name_bytes = equals ? (size_t)(equals - text) : 0;
    if (name_bytes == 0 || equals + 1 == text + bytes ||
        (name_bytes == 6 && strncmp(text, "method", 6) == 0)) {
        return -1;
    }
    char *name = strndup(text, name_bytes);
    if (!name) {
        return -1;
    }
    bool empty = name[0] == '.' || name[name_bytes - 1] == '.' || strstr(name, "..");
    int status = empty ? -1 : set_path(members, name, read_value(equals + 1, bytes - name_bytes - 1));
    free(name);
    return status;
}

static int read_options(const char *text, json_t *members)
{
    for (;;) {
        size_t bytes = strcspn(text, ",");
        if (read_option(text, bytes, members) < 0) {
            return -1;
        }
        if (text[bytes] == '\0') {
            return 0;
        }
        text += bytes + 1;
    }
}

int methodspec_parse(const char *spec, json_t **ret, struct failure *failure)
{
    size_t name_bytes = strcspn(spec, ":");
    json_t *members = json_object();
    if (name_bytes == 0 || memchr(spec, ',', name_bytes) || memchr(spec, '=', name_bytes) ||
        json_object_set_new(members, "method", json_stringn(spec, name_bytes)) < 0 ||
        (spec[name_bytes] == ':' && read_options(spec + name_bytes + 1, members) < 0)) {
        json_decref(members);
        return failure_set(failure, EXIT_USAGE,
                           "\"%.200s\" is not a method: NAME, or NAME:MEMBER=VALUE,MEMBER=VALUE\n"
                           "try: --method stop-and-go:stop_on=kinetic,time_step=0.01",
                           spec);
    }
    *ret = members;
    return 0;
}

json_t *methodspec_apply(json_t *members, json_t *job)
{
    json_t *made = json_copy(job), *old = json_object_get(job, "solver");
    json_t *solver = json_is_object(old) ? json_deep_copy(old) : json_object();
    if (!made || !solver || json_object_update_recursive(solver, members) < 0 ||
        json_object_set(made, "solver", solver) < 0) {
        json_decref(made);
        made = NULL;
    }
    json_decref(solver);
    return made;
}
