/* glbfile.c - glTF 2.0 section 4.4 (GLB container) and 3.6 (accessors), as far as our results need. */
#include "glbfile.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define GLB_MAGIC      0x46546C67u /* "glTF" */
#define CHUNK_JSON     0x4E4F534Au
#define CHUNK_BIN      0x004E4942u
#define TYPE_U8        5121
#define TYPE_U16       5123
#define TYPE_U32       5125
#define TYPE_FLOAT     5126
#define MODE_TRIANGLES 4

struct glb {
    const unsigned char *bin;
    size_t bin_bytes;
    json_t *json; /* owned */
};

struct view { /* elements of one accessor, checked to lie in the file */
    const unsigned char *data;
    size_t count, stride;
    long long type;
};

static uint32_t read_u32(const unsigned char *p)
{
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

/* Finds the two chunks; false when the container is damaged. */
static bool open_container(const unsigned char *data, size_t bytes, struct glb *glb)
{
    if (bytes < 20 || read_u32(data) != GLB_MAGIC || read_u32(data + 4) != 2) {
        return false;
    }
    size_t at = 12;
    while (bytes - at >= 8) {
        size_t length = read_u32(data + at);
        uint32_t type = read_u32(data + at + 4);
        if (length > bytes - at - 8) {
            return false;
        }
        if (type == CHUNK_JSON && !glb->json) {
            glb->json = json_loadb((const char *)data + at + 8, length, 0, NULL);
        } else if (type == CHUNK_BIN && !glb->bin) {
            glb->bin = data + at + 8;
            glb->bin_bytes = length;
        }
        at += 8 + length;
    }
    return glb->json && glb->bin;
}

/* A non-negative integer member; `fallback` when absent, -1 when it is something else. */
static long long natural(const json_t *object, const char *key, long long fallback)
{
    const json_t *value = json_object_get(object, key);
    if (!value) {
        return fallback;
    }
    return json_is_integer(value) && json_integer_value(value) >= 0 ? json_integer_value(value) : -1;
}

enum kind { INDEX, NUMBER, VECTOR };

static size_t element_bytes(long long type, enum kind kind)
{
    switch (type) {
    case TYPE_U8:
        return kind == INDEX ? 1 : 0;
    case TYPE_U16:
        return kind == INDEX ? 2 : 0;
    case TYPE_U32:
        return kind == INDEX ? 4 : 0;
    case TYPE_FLOAT:
        return kind == VECTOR ? 12 : kind == NUMBER ? 4 : 0;
    default:
        return 0;
    }
}

static bool open_accessor(const struct glb *glb, const json_t *index, enum kind kind, struct view *ret)
{
    if (!json_is_integer(index) || json_integer_value(index) < 0) {
        return false;
    }
    const json_t *accessor =
        json_array_get(json_object_get(glb->json, "accessors"), (size_t)json_integer_value(index));
    long long view_index = natural(accessor, "bufferView", -1), count = natural(accessor, "count", -1);
    long long start = natural(accessor, "byteOffset", 0), type = natural(accessor, "componentType", -1);
    if (!accessor || view_index < 0 || count < 1 || count > SURFACE_MAX * 3LL || start < 0 ||
        json_object_get(accessor, "sparse")) {
        return false;
    }
    const json_t *view = json_array_get(json_object_get(glb->json, "bufferViews"), (size_t)view_index);
    long long offset = natural(view, "byteOffset", 0), stride = natural(view, "byteStride", 0);
    size_t size = element_bytes(type, kind);
    if (!view || natural(view, "buffer", -1) != 0 || offset < 0 || stride < 0 || stride > 252 || size == 0) {
        return false;
    }
    size_t step = stride > 0 ? (size_t)stride : size;
    size_t first = (size_t)offset + (size_t)start, span = step * ((size_t)count - 1) + size;
    if ((size_t)offset > glb->bin_bytes || (size_t)start > glb->bin_bytes || first > glb->bin_bytes ||
        span > glb->bin_bytes - first) {
        return false;
    }
    *ret = (struct view){glb->bin + first, (size_t)count, step, type};
    return true;
}

static uint32_t index_at(const struct view *view, size_t i)
{
    const unsigned char *p = view->data + i * view->stride;
    return view->type == TYPE_U8    ? p[0]
           : view->type == TYPE_U16 ? (uint32_t)p[0] | (uint32_t)p[1] << 8
                                    : read_u32(p);
}

static double float_at(const unsigned char *p)
{
    uint32_t bits = read_u32(p);
    float value;
    memcpy(&value, &bits, sizeof value);
    return (double)value;
}

static bool copy_mesh(const struct view *positions, const struct view *indices, struct surface *mesh)
{
    for (size_t i = 0; i < mesh->vertices; i++) {
        for (size_t k = 0; k < 3; k++) {
            mesh->positions[3 * i + k] = float_at(positions->data + i * positions->stride + 4 * k);
        }
    }
    for (size_t i = 0; i < 3 * mesh->triangles; i++) {
        mesh->triangle[i] = index_at(indices, i);
        if (mesh->triangle[i] >= mesh->vertices) {
            return false;
        }
    }
    return true;
}

static const json_t *first_primitive(const struct glb *glb)
{
    const json_t *first = json_array_get(json_object_get(glb->json, "meshes"), 0);
    return json_array_get(json_object_get(first, "primitives"), 0);
}

int glbfile_parse(const char *path, const char *data, size_t bytes, struct surface *ret,
                  struct failure *failure)
{
    struct glb glb = {0};
    struct view positions, indices;
    struct surface mesh = {0};
    int status = -1;
    failure_set(failure, EXIT_USAGE, "%s: not a binary glTF 2.0 file that can be shown", path);
    if (!open_container((const unsigned char *)data, bytes, &glb)) {
        goto cleanup;
    }
    const json_t *primitive = first_primitive(&glb);
    if (natural(primitive, "mode", MODE_TRIANGLES) != MODE_TRIANGLES ||
        !open_accessor(&glb, json_object_get(json_object_get(primitive, "attributes"), "POSITION"), VECTOR,
                       &positions) ||
        !open_accessor(&glb, json_object_get(primitive, "indices"), INDEX, &indices) ||
        indices.count % 3 != 0) {
        goto cleanup;
    }
    if (surface_new(positions.count, indices.count / 3, false, &mesh) < 0) {
        failure_no_memory(failure);
        goto cleanup;
    }
    if (!copy_mesh(&positions, &indices, &mesh)) {
        surface_done(&mesh);
        goto cleanup;
    }
    *ret = mesh;
    status = 0;
cleanup:
    json_decref(glb.json);
    return status;
}

static void copy_values(const struct view *view, bool vector, double *ret)
{
    for (size_t i = 0; i < view->count; i++) {
        const unsigned char *p = view->data + i * view->stride;
        double x = float_at(p);
        ret[i] = vector
                     ? sqrt(x * x + float_at(p + 4) * float_at(p + 4) + float_at(p + 8) * float_at(p + 8) / 2)
                     : x;
    }
}

int glbfile_read_values(const char *path, const char *data, size_t bytes, const char *attribute,
                        struct surface *mesh, struct failure *failure)
{
    struct glb glb = {0};
    struct view view;
    int status = -1;
    failure_set(failure, EXIT_USAGE, "%s: %s cannot be shown", path, attribute);
    if (!open_container((const unsigned char *)data, bytes, &glb)) {
        goto cleanup;
    }
    const json_t *index = json_object_get(json_object_get(first_primitive(&glb), "attributes"), attribute);
    const json_t *accessor =
        json_array_get(json_object_get(glb.json, "accessors"), (size_t)json_integer_value(index));
    const char *type = json_string_value(json_object_get(accessor, "type"));
    if (!index) {
        status = 0;
        goto cleanup;
    }
    bool vector = type && strcmp(type, "VEC3") == 0;
    if (!type || (!vector && strcmp(type, "SCALAR") != 0) ||
        !open_accessor(&glb, index, vector ? VECTOR : NUMBER, &view) || view.count != mesh->vertices) {
        goto cleanup;
    }
    mesh->value = calloc(view.count, sizeof *mesh->value);
    if (!mesh->value) {
        failure_no_memory(failure);
        goto cleanup;
    }
    copy_values(&view, vector, mesh->value);
    status = 0;
cleanup:
    json_decref(glb.json);
    return status;
}
