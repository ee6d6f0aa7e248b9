/* glb.c - binary glTF 2.0 meshes in and out.
 *
 * Read: the triangles of every node of the scene, in the places that the nodes' transforms give them, one
 * after the other in one mesh: POSITION and, as the cloth's pattern in metres, TEXCOORD_0 where all have it;
 * indices of 8, 16 or 32 bits or none; one buffer, the file's binary chunk. A skin is read where its joints
 * are as they were bound. Sparse accessors, other postures, other primitives than triangles and required
 * extensions are refused rather than passed over. Section numbers are those of the glTF 2.0 specification. */
#include "meshformat.h"

#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fitmap.h"
#include "jsonout.h"

/* 4.4: the magic, the version and the two chunk types, as little-endian numbers */
#define GLB_MAGIC   0x46546C67u
#define GLB_VERSION 2u
#define CHUNK_JSON  0x4E4F534Au
#define CHUNK_BIN   0x004E4942u

/* 3.6.2.2 component types and 3.7.2.1 primitive mode */
enum { GL_UNSIGNED_BYTE = 5121, GL_UNSIGNED_SHORT = 5123, GL_UNSIGNED_INT = 5125, GL_FLOAT = 5126 };
enum { GL_TRIANGLES = 4 };
enum { GL_ARRAY_BUFFER = 34962, GL_ELEMENT_ARRAY_BUFFER = 34963 };

/* Of a file that is one garment or one body; a rigged one has a few hundred nodes. */
#define MAX_NODES 4096
#define MAX_PARTS 256
#define MAX_DEPTH 128 /* of the tree of nodes */

struct transform { /* 3.5.3: p -> m p + t */
    double m[3][3], t[3];
};

/* A view of `count` items in the binary chunk, checked against its bounds. */
struct accessor {
    const unsigned char *data;
    size_t count, stride;
    int component;
};

struct part {                            /* a primitive in its place */
    struct accessor position, uv, index; /* uv, index: without data where there are none */
    int64_t position_at, uv_at;          /* the accessors' numbers: primitives may share them */
    size_t instance;                     /* of a mesh: its primitives may share vertices */
    struct transform place;
    size_t first; /* its first vertex in the mesh */
    bool shared;  /* the vertices are those of an earlier part */
};

struct glb {
    struct jsontext json;
    const unsigned char *bin; /* the binary chunk; NULL when there is none */
    size_t bin_bytes;
    const struct limits *limits;
    struct problem *reterr;
    /* the scene */
    struct transform *place; /* of each node, in the scene */
    bool *placed;            /* whether the walk has come by the node */
    size_t nodes;
    struct part *part; /* MAX_PARTS */
    size_t parts, instances, vertices, corners;
    bool pattern; /* all parts have one */
};

static uint32_t get_u32(const unsigned char *at)
{
    return (uint32_t)at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

__attribute__((format(printf, 2, 3))) static int refuse(struct glb *glb, const char *format, ...)
{
    char detail[160];
    va_list list;
    va_start(list, format);
    vsnprintf(detail, sizeof detail, format, list);
    va_end(list);
    return problem_set(glb->reterr, PROBLEM_INVALID, "%s", detail);
}

/* ---- chunks ---------------------------------------------------------------------------------- */

static int read_chunks(struct glb *glb, const unsigned char *data, size_t bytes, const struct limits *limits)
{
    if (bytes < 20 || get_u32(data) != GLB_MAGIC)
        return refuse(glb, "not a GLB file: it does not begin with \"glTF\"");
    if (get_u32(data + 4) != GLB_VERSION)
        return refuse(glb, "glTF version %u, only 2 is read", get_u32(data + 4));
    if (get_u32(data + 8) != bytes)
        return refuse(glb, "byte 8: the header says %u bytes, the file has %zu", get_u32(data + 8), bytes);
    size_t json_bytes = get_u32(data + 12);
    if (get_u32(data + 16) != CHUNK_JSON || json_bytes > bytes - 20)
        return refuse(glb, "byte 12: the first chunk is no JSON chunk inside the file");
    size_t at = 20 + json_bytes;
    if (bytes - at >= 8 && get_u32(data + at + 4) == CHUNK_BIN) {
        glb->bin_bytes = get_u32(data + at);
        glb->bin = data + at + 8;
        if (glb->bin_bytes > bytes - at - 8)
            return refuse(glb, "byte %zu: the binary chunk is longer than the file", at);
    }
    return jsontext_parse((const char *)data + 20, json_bytes, limits, &glb->json, glb->reterr);
}

/* ---- small readers of the JSON --------------------------------------------------------------- */

/* A natural number, or `fallback` when absent; -1 when it is something else. */
static int64_t get_natural(const json_t *object, const char *member, int64_t fallback)
{
    const json_t *value = json_object_get(object, member);
    if (!value)
        return fallback;
    if (!json_is_integer(value) || json_integer_value(value) < 0)
        return -1;
    return json_integer_value(value);
}

/* Element `index` of the root's array `name`, or NULL. */
static const json_t *get_item(const struct glb *glb, const char *name, int64_t index)
{
    const json_t *array = json_object_get(glb->json.root, name);
    return index < 0 ? NULL : json_array_get(array, (size_t)index);
}

/* ---- accessors ------------------------------------------------------------------------------- */

static size_t component_bytes(int64_t component)
{
    switch (component) {
    case GL_UNSIGNED_BYTE:
        return 1;
    case GL_UNSIGNED_SHORT:
        return 2;
    case GL_UNSIGNED_INT:
    case GL_FLOAT:
        return 4;
    default:
        return 0;
    }
}

/* 3.6.2: accessor `index`, which must be of `type` with `width` components an item. */
static int read_accessor(struct glb *glb, int64_t index, const char *type, size_t width, const char *what,
                         struct accessor *ret)
{
    const json_t *accessor = get_item(glb, "accessors", index);
    const char *its_type = json_string_value(json_object_get(accessor, "type"));
    if (!accessor || !its_type || strcmp(its_type, type) != 0)
        return refuse(glb, "%s: accessor %lld is missing or not of type %s", what, (long long)index, type);
    if (json_object_get(accessor, "sparse"))
        return refuse(glb, "%s: sparse accessors are not read", what);

    int64_t component = get_natural(accessor, "componentType", -1);
    int64_t count = get_natural(accessor, "count", -1), offset = get_natural(accessor, "byteOffset", 0);
    const json_t *view = get_item(glb, "bufferViews", get_natural(accessor, "bufferView", -1));
    int64_t view_offset = get_natural(view, "byteOffset", 0),
            view_bytes = get_natural(view, "byteLength", -1);
    size_t item = component_bytes(component) * width;
    int64_t stride = get_natural(view, "byteStride", (int64_t)item);

    if (item == 0 || count <= 0 || offset < 0)
        return refuse(glb, "%s: accessor %lld has no fitting componentType, count or byteOffset", what,
                      (long long)index);
    if (!view || get_natural(view, "buffer", -1) != 0 || view_bytes < 0 || view_offset < 0)
        return refuse(glb, "%s: accessor %lld has no buffer view into buffer 0", what, (long long)index);
    if (!glb->bin || (uint64_t)view_offset > glb->bin_bytes ||
        (uint64_t)view_bytes > glb->bin_bytes - (uint64_t)view_offset)
        return refuse(glb, "%s: its buffer view reaches past the binary chunk of %zu bytes", what,
                      glb->bin_bytes);
    if (stride < (int64_t)item || stride > 252) /* 3.6.2.4: the largest stride */
        return refuse(glb, "%s: byteStride %lld does not fit items of %zu bytes", what, (long long)stride,
                      item);

    /* the last item needs `item` bytes, those before it `stride` */
    uint64_t room = (uint64_t)view_bytes;
    if ((uint64_t)offset > room || item > room - (uint64_t)offset ||
        (uint64_t)(count - 1) > (room - (uint64_t)offset - item) / (uint64_t)stride)
        return refuse(glb, "%s: %lld items reach past their buffer view of %lld bytes", what,
                      (long long)count, (long long)view_bytes);
    *ret = (struct accessor){glb->bin + view_offset + offset, (size_t)count, (size_t)stride, (int)component};
    return 0;
}

/* 3.6.2.2: integers that stand for 0 to 1; whether an accessor of them may is for the caller to say. */
static double get_number(const unsigned char *at, int component)
{
    if (component == GL_UNSIGNED_BYTE)
        return at[0] / 255.0;
    if (component == GL_UNSIGNED_SHORT)
        return ((uint32_t)at[0] | (uint32_t)at[1] << 8) / 65535.0;
    uint32_t bits = get_u32(at);
    float value;
    memcpy(&value, &bits, sizeof value);
    return (double)value;
}

static int read_numbers(struct glb *glb, const struct accessor *accessor, size_t width, const char *what,
                        double *ret)
{
    size_t bytes = component_bytes(accessor->component);
    for (size_t i = 0; i < accessor->count; i++)
        for (size_t k = 0; k < width; k++) {
            double value = get_number(accessor->data + i * accessor->stride + bytes * k, accessor->component);
            if (!isfinite(value))
                return refuse(glb, "%s of vertex %zu is not finite", what, i);
            ret[width * i + k] = value;
        }
    return 0;
}

static uint32_t get_index(const struct accessor *accessor, size_t i)
{
    const unsigned char *at = accessor->data + i * accessor->stride;
    switch (accessor->component) {
    case GL_UNSIGNED_BYTE:
        return at[0];
    case GL_UNSIGNED_SHORT:
        return (uint32_t)at[0] | (uint32_t)at[1] << 8;
    default:
        return get_u32(at);
    }
}

/* ---- the mesh -------------------------------------------------------------------------------- */

/* Numbers of node `n`, exactly `count` of them; 1 when there are none, -1 when they are something else. */
static int get_numbers(struct glb *glb, const json_t *object, const char *member, size_t n, size_t count,
                       double *ret)
{
    const json_t *value = json_object_get(object, member);
    if (value == NULL)
        return 1;
    struct numbers numbers = jsontext_numbers(&glb->json, value);
    bool fine = numbers.count == count && numbers.odd == SIZE_MAX;
    for (size_t i = 0; fine && i < count; i++)
        fine = isfinite(ret[i] = numbers.value[i]);
    return fine ? 0 : refuse(glb, "node %zu: its %s is not of %zu numbers", n, member, count);
}

static const struct transform IDENTITY = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {0, 0, 0}};

/* 3.5.3: 16 numbers by columns. */
static struct transform from_matrix(const double *m)
{
    struct transform t;
    for (size_t i = 0; i < 3; i++) {
        for (size_t j = 0; j < 3; j++)
            t.m[i][j] = m[4 * j + i];
        t.t[i] = m[12 + i];
    }
    return t;
}

/* First scaled, then turned by the unit quaternion x y z w, then moved. */
static struct transform from_parts(const double *move, const double *q, const double *scale)
{
    double x = q[0], y = q[1], z = q[2], w = q[3];
    double turn[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)},
                         {2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)},
                         {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)}};
    struct transform t;
    for (size_t i = 0; i < 3; i++) {
        for (size_t j = 0; j < 3; j++)
            t.m[i][j] = turn[i][j] * scale[j];
        t.t[i] = move[i];
    }
    return t;
}

static void apply(const struct transform *t, const double *p, double *ret)
{
    double x = p[0], y = p[1], z = p[2]; /* ret may be p */
    for (size_t i = 0; i < 3; i++)
        ret[i] = t->m[i][0] * x + t->m[i][1] * y + t->m[i][2] * z + t->t[i];
}

/* `inner` first. */
static struct transform compose(const struct transform *outer, const struct transform *inner)
{
    struct transform t;
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3; j++)
            t.m[i][j] = outer->m[i][0] * inner->m[0][j] + outer->m[i][1] * inner->m[1][j] +
                        outer->m[i][2] * inner->m[2][j];
    apply(outer, inner->t, t.t);
    return t;
}

static bool mirrors(const struct transform *t)
{
    const double(*m)[3] = t->m;
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) -
               m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) +
               m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]) <
           0;
}

/* A node's own transform. */
static int read_transform(struct glb *glb, const json_t *node, size_t n, struct transform *ret)
{
    double matrix[16] = {0}, move[3] = {0, 0, 0}, turn[4] = {0, 0, 0, 1}, scale[3] = {1, 1, 1};
    int given = get_numbers(glb, node, "matrix", n, 16, matrix);
    if (given < 0 || get_numbers(glb, node, "translation", n, 3, move) < 0 ||
        get_numbers(glb, node, "rotation", n, 4, turn) < 0 ||
        get_numbers(glb, node, "scale", n, 3, scale) < 0)
        return -1;
    double length = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2] + turn[3] * turn[3];
    if (!(fabs(length - 1) <= 1e-3))
        return refuse(glb, "node %zu: its rotation is no unit quaternion", n);
    *ret = given == 0 ? from_matrix(matrix) : from_parts(move, turn, scale);
    return 0;
}

/* ---- the tree of nodes ----------------------------------------------------------------------- */

/* 3.5.2: places node `n` and those below it. A node with two parents, or its own ancestor, is met again. */
static int place_node(struct glb *glb, size_t n, const struct transform *parent, size_t depth)
{
    struct transform own;
    const json_t *node = get_item(glb, "nodes", (int64_t)n);
    if (glb->placed[n])
        return refuse(glb, "node %zu is in the scene twice", n);
    if (depth > MAX_DEPTH)
        return refuse(glb, "node %zu is nested deeper than %d", n, MAX_DEPTH);
    glb->placed[n] = true;
    if (read_transform(glb, node, n, &own) != 0)
        return -1;
    glb->place[n] = compose(parent, &own);
    struct numbers children = jsontext_numbers(&glb->json, json_object_get(node, "children"));
    for (size_t i = 0; i < children.count; i++) {
        double child = children.value[i];
        if (!(child >= 0 && child < (double)glb->nodes) || child != floor(child))
            return refuse(glb, "node %zu: %g is no node, there are %zu", n, child, glb->nodes);
        if (place_node(glb, (size_t)child, &glb->place[n], depth + 1) != 0)
            return -1;
    }
    return 0;
}

/* The nodes of the scene to show, or without scenes those that are nobody's child. */
static int place_nodes(struct glb *glb)
{
    const json_t *scene = get_item(glb, "scenes", get_natural(glb->json.root, "scene", 0));
    bool *child = calloc(glb->nodes + 1, sizeof *child);
    int rc = child == NULL ? problem_set(glb->reterr, PROBLEM_INTERNAL, "out of memory") : 0;
    for (size_t n = 0; rc == 0 && scene == NULL && n < glb->nodes; n++) {
        const json_t *node = get_item(glb, "nodes", (int64_t)n);
        struct numbers children = jsontext_numbers(&glb->json, json_object_get(node, "children"));
        for (size_t i = 0; i < children.count; i++)
            if (children.value[i] >= 0 && children.value[i] < (double)glb->nodes)
                child[(size_t)children.value[i]] = true;
    }
    struct numbers roots = jsontext_numbers(&glb->json, json_object_get(scene, "nodes"));
    for (size_t i = 0; rc == 0 && i < (scene == NULL ? glb->nodes : roots.count); i++) {
        double n = scene == NULL ? (double)i : roots.value[i];
        if (!(n >= 0 && n < (double)glb->nodes) || n != floor(n))
            rc = refuse(glb, "the scene's node %g does not exist, there are %zu", n, glb->nodes);
        else if (scene != NULL || !child[i])
            rc = place_node(glb, (size_t)n, &IDENTITY, 1);
    }
    free(child);
    return rc;
}

/* ---- skins ----------------------------------------------------------------------------------- */

static bool is_near(const struct transform *a, const struct transform *b)
{
    for (size_t i = 0; i < 3; i++) {
        if (!(fabs(a->t[i] - b->t[i]) <= 1e-4))
            return false;
        for (size_t j = 0; j < 3; j++)
            if (!(fabs(a->m[i][j] - b->m[i][j]) <= 1e-4))
                return false;
    }
    return true;
}

/* 3.7.3.3: a skin puts each vertex where its joints have gone since they were bound. When all of them have
 * gone the same way, so has the mesh; the place of its own node does not count. *ret is that way. */
static int read_skin(struct glb *glb, size_t n, int64_t index, struct transform *ret)
{
    const json_t *skin = get_item(glb, "skins", index);
    struct numbers joints = jsontext_numbers(&glb->json, json_object_get(skin, "joints"));
    int64_t bound_at = get_natural(skin, "inverseBindMatrices", -1);
    struct accessor bound = {0};
    if (joints.count == 0)
        return refuse(glb, "node %zu: its skin has no joints", n);
    if (bound_at >= 0 && read_accessor(glb, bound_at, "MAT4", 16, "inverseBindMatrices", &bound) != 0)
        return -1;
    if (bound.data != NULL && (bound.component != GL_FLOAT || bound.count < joints.count))
        return refuse(glb, "node %zu: its skin has too few inverseBindMatrices, or none of floats", n);
    for (size_t i = 0; i < joints.count; i++) {
        double joint = joints.value[i], matrix[16] = {0};
        struct transform way, back = IDENTITY;
        if (!(joint >= 0 && joint < (double)glb->nodes) || joint != floor(joint) ||
            !glb->placed[(size_t)joint])
            return refuse(glb, "node %zu: joint %g of its skin is not in the scene", n, joint);
        for (size_t k = 0; bound.data != NULL && k < 16; k++)
            matrix[k] = get_number(bound.data + i * bound.stride + 4 * k, GL_FLOAT);
        if (bound.data != NULL)
            back = from_matrix(matrix);
        way = compose(&glb->place[(size_t)joint], &back);
        if (i == 0)
            *ret = way;
        else if (!is_near(ret, &way))
            return refuse(
                glb, "node %zu is in another posture than its skin was bound in; apply it before exporting",
                n);
    }
    return is_near(ret, ret) ? 0 : refuse(glb, "node %zu: its skin is not finite", n);
}

/* ---- the mesh -------------------------------------------------------------------------------- */

static int read_accessors(struct glb *glb, const json_t *primitive, struct part *part)
{
    const json_t *attributes = json_object_get(primitive, "attributes");
    bool pattern = json_object_get(attributes, "TEXCOORD_0") != NULL;
    bool indexed = json_object_get(primitive, "indices") != NULL;
    part->position_at = get_natural(attributes, "POSITION", -1);
    part->uv_at = get_natural(attributes, "TEXCOORD_0", -1);
    if (read_accessor(glb, part->position_at, "VEC3", 3, "POSITION", &part->position) ||
        (pattern && read_accessor(glb, part->uv_at, "VEC2", 2, "TEXCOORD_0", &part->uv)) ||
        (indexed &&
         read_accessor(glb, get_natural(primitive, "indices", -1), "SCALAR", 1, "indices", &part->index)))
        return -1;
    if (part->position.component != GL_FLOAT)
        return refuse(glb, "POSITION must be floats");
    if (pattern && part->uv.component == GL_UNSIGNED_INT)
        return refuse(glb, "TEXCOORD_0 must be floats, or bytes or shorts that stand for 0 to 1");
    if (pattern && part->uv.count != part->position.count)
        return refuse(glb, "TEXCOORD_0 has %zu items, POSITION %zu", part->uv.count, part->position.count);
    if (indexed && part->index.component == GL_FLOAT)
        return refuse(glb, "indices must be integers");
    if (!indexed)
        part->index.count = part->position.count;
    if (part->index.count % 3 != 0)
        return refuse(glb, "%zu indices are no triangles", part->index.count);
    return 0;
}

/* Exporters write one set of vertices for the primitives of a mesh, or one for each. */
static const struct part *find_shared(const struct glb *glb, const struct part *part)
{
    for (size_t i = 0; i < glb->parts; i++) {
        const struct part *other = &glb->part[i];
        if (other->instance == part->instance && other->position_at == part->position_at &&
            other->uv_at == part->uv_at && !other->shared)
            return other;
    }
    return NULL;
}

static int add_part(struct glb *glb, const json_t *primitive, const struct transform *place)
{
    struct part part = {.instance = glb->instances, .place = *place, .first = glb->vertices};
    if (get_natural(primitive, "mode", GL_TRIANGLES) != GL_TRIANGLES)
        return refuse(glb, "a primitive is not of triangles");
    if (glb->parts == MAX_PARTS)
        return refuse(glb, "more than %d primitives", MAX_PARTS);
    if (read_accessors(glb, primitive, &part) != 0)
        return -1;
    const struct part *shared = find_shared(glb, &part);
    if (shared != NULL) {
        part.shared = true;
        part.first = shared->first;
    } else if (part.position.count > glb->limits->vertices - glb->vertices) {
        return problem_set(glb->reterr, PROBLEM_TOO_LARGE, "more than %zu vertices, the limit",
                           glb->limits->vertices);
    } else {
        glb->vertices += part.position.count;
    }
    if (part.index.count / 3 > glb->limits->triangles - glb->corners / 3)
        return problem_set(glb->reterr, PROBLEM_TOO_LARGE, "more than %zu triangles, the limit",
                           glb->limits->triangles);
    glb->corners += part.index.count;
    glb->pattern = (glb->parts == 0 || glb->pattern) && part.uv.data != NULL;
    glb->part[glb->parts++] = part;
    return 0;
}

static int add_mesh(struct glb *glb, int64_t index, const struct transform *place)
{
    const json_t *primitives = json_object_get(get_item(glb, "meshes", index), "primitives");
    if (json_array_size(primitives) == 0)
        return refuse(glb, "mesh %lld is missing or has no primitives", (long long)index);
    for (size_t i = 0; i < json_array_size(primitives); i++)
        if (add_part(glb, json_array_get(primitives, i), place) != 0)
            return -1;
    glb->instances++;
    return 0;
}

static int add_node(struct glb *glb, size_t n)
{
    const json_t *node = get_item(glb, "nodes", (int64_t)n);
    if (!glb->placed[n] || json_object_get(node, "mesh") == NULL)
        return 0;
    struct transform place = glb->place[n];
    if (json_object_get(node, "skin") != NULL &&
        read_skin(glb, n, get_natural(node, "skin", -1), &place) != 0)
        return -1;
    return add_mesh(glb, get_natural(node, "mesh", -1), &place);
}

/* A file without nodes is a library of meshes: all are taken, as they are. */
static int add_parts(struct glb *glb)
{
    for (size_t n = 0; n < glb->nodes; n++)
        if (add_node(glb, n) != 0)
            return -1;
    for (size_t i = 0; glb->nodes == 0 && i < json_array_size(json_object_get(glb->json.root, "meshes")); i++)
        if (add_mesh(glb, (int64_t)i, &IDENTITY) != 0)
            return -1;
    return glb->parts > 0 ? 0 : refuse(glb, "there is no mesh in the scene");
}

static int fill_triangles(struct glb *glb, const struct part *part, struct mesh *mesh)
{
    bool turned = mirrors(&part->place); /* 3.7.4: then the other side is the front */
    uint32_t *t = mesh->triangle + 3 * mesh->triangles;
    for (size_t i = 0; i < part->index.count; i++) {
        uint32_t vertex = part->index.data ? get_index(&part->index, i) : (uint32_t)i;
        if (vertex >= part->position.count)
            return refuse(glb, "triangle %zu: %u is no vertex, there are %zu (counted from 0)", i / 3, vertex,
                          part->position.count);
        t[i - i % 3 + (turned ? 2 - i % 3 : i % 3)] = (uint32_t)part->first + vertex;
    }
    mesh->triangles += part->index.count / 3;
    return 0;
}

static int fill_vertices(struct glb *glb, const struct part *part, struct mesh *mesh)
{
    double *x = mesh->positions + 3 * part->first;
    if (read_numbers(glb, &part->position, 3, "POSITION", x) ||
        (glb->pattern && read_numbers(glb, &part->uv, 2, "TEXCOORD_0", mesh->pattern + 2 * part->first)))
        return -1;
    for (size_t i = 0; i < part->position.count; i++) {
        apply(&part->place, x + 3 * i, x + 3 * i);
        if (!isfinite(x[3 * i]) || !isfinite(x[3 * i + 1]) || !isfinite(x[3 * i + 2]))
            return refuse(glb, "vertex %zu is moved beyond all numbers", i);
    }
    return 0;
}

static int check_file(struct glb *glb)
{
    const json_t *root = glb->json.root;
    glb->nodes = json_array_size(json_object_get(root, "nodes"));
    if (json_array_size(json_object_get(root, "extensionsRequired")) > 0)
        return refuse(glb, "the file needs an extension (compressed geometry?), none is read");
    if (json_object_get(json_array_get(json_object_get(root, "buffers"), 0), "uri"))
        return refuse(glb, "the buffer must be the file's own binary chunk");
    if (glb->nodes > MAX_NODES)
        return refuse(glb, "more than %d nodes", MAX_NODES);
    glb->place = calloc(glb->nodes + 1, sizeof *glb->place);
    glb->placed = calloc(glb->nodes + 1, sizeof *glb->placed);
    glb->part = calloc(MAX_PARTS, sizeof *glb->part);
    if (!glb->place || !glb->placed || !glb->part)
        return problem_set(glb->reterr, PROBLEM_INTERNAL, "out of memory");
    return 0;
}

static int read_mesh(struct glb *glb, struct mesh *ret)
{
    if (check_file(glb) || place_nodes(glb) || add_parts(glb) ||
        mesh_alloc(ret, glb->vertices, glb->corners / 3, glb->pattern, glb->limits, glb->reterr))
        return -1;
    ret->triangles = 0; /* counted up again as they are read */
    for (size_t i = 0; i < glb->parts; i++) {
        const struct part *part = &glb->part[i];
        if ((!part->shared && fill_vertices(glb, part, ret) != 0) || fill_triangles(glb, part, ret) != 0)
            return -1;
    }
    return 0;
}

int glb_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
              struct problem *reterr)
{
    struct glb glb = {.limits = limits, .reterr = reterr};
    int rc = -1;
    if (read_chunks(&glb, data, bytes, limits) == 0)
        rc = read_mesh(&glb, ret);
    jsontext_done(&glb.json);
    free(glb.place);
    free(glb.placed);
    free(glb.part);
    return rc;
}

/* ---- writing --------------------------------------------------------------------------------- */

/* One array of the binary chunk: a buffer view and an accessor of the same number. */
struct block {
    const char *type;
    const char *attribute; /* NULL: the indices */
    const double *value;   /* items * width, or NULL */
    const uint32_t *index; /* items, or NULL */
    size_t items, width;
};

#define MAX_BLOCKS 8

static size_t block_bytes(const struct block *block)
{
    return 4 * block->items * block->width;
}

static void put_block(FILE *file, const struct block *block)
{
    if (block->value)
        mesh_put_floats(file, block->value, block->items * block->width);
    for (size_t i = 0; block->index && i < block->items; i++)
        mesh_put_u32(file, block->index[i]);
}

/* 3.7.2.1 wants the bounds of POSITION; of the floats that are stored, not of the doubles. */
static int add_bounds(json_t *accessor, const struct block *block)
{
    float low[3], high[3];
    for (size_t k = 0; k < 3; k++) {
        low[k] = high[k] = (float)block->value[k];
        for (size_t i = 1; i < block->items; i++) {
            float value = (float)block->value[3 * i + k];
            low[k] = value < low[k] ? value : low[k];
            high[k] = value > high[k] ? value : high[k];
        }
    }
    json_t *bounds = json_pack("{s:[f,f,f], s:[f,f,f]}", "min", (double)low[0], (double)low[1],
                               (double)low[2], "max", (double)high[0], (double)high[1], (double)high[2]);
    int rc = bounds ? json_object_update(accessor, bounds) : -1;
    json_decref(bounds);
    return rc;
}

/* Takes the new reference `value`; -1 when it or the room for it could not be had. */
static int append(json_t *array, json_t *value)
{
    return json_array_append_new(array, value);
}

/* The material's colour; a vertex colour is multiplied with it. */
static json_t *base_color(const struct fitmap *fit)
{
    return fit ? json_pack("[f,f,f,f]", 1.0, 1.0, 1.0, 1.0) : json_pack("[f,f,f,f]", 0.55, 0.62, 0.78, 1.0);
}

/* What the colours mean. */
static json_t *color_legend(const struct fitmap *fit)
{
    return json_pack("{s:{s:s, s:s, s:[f,f]}}", "COLOR_0", "map", "viridis", "of", "size of strain", "range",
                     0.0, fit->full);
}

/* The glTF document as text, to be freed by the caller; NULL when out of memory. */
static char *make_document(const struct block *block, size_t blocks, const struct fitmap *fit,
                           const char *name)
{
    json_t *views = json_array(), *accessors = json_array(), *attributes = json_object(), *root = NULL;
    char *text = NULL;
    size_t offset = 0;
    int rc = views && accessors && attributes ? 0 : -1;

    for (size_t i = 0; i < blocks && rc == 0; i++) {
        const struct block *b = &block[i];
        json_t *accessor =
            json_pack("{s:i, s:i, s:I, s:s}", "bufferView", (int)i, "componentType",
                      b->index ? GL_UNSIGNED_INT : GL_FLOAT, "count", (json_int_t)b->items, "type", b->type);
        if (i == 0 && accessor)
            rc = add_bounds(accessor, b);
        rc |= append(accessors, accessor);
        rc |= append(views, json_pack("{s:i, s:I, s:I, s:i}", "buffer", 0, "byteOffset", (json_int_t)offset,
                                      "byteLength", (json_int_t)block_bytes(b), "target",
                                      b->index ? GL_ELEMENT_ARRAY_BUFFER : GL_ARRAY_BUFFER));
        if (b->attribute)
            rc |= json_object_set_new(attributes, b->attribute, json_integer((json_int_t)i));
        offset += block_bytes(b);
    }
    if (rc == 0)
        root = json_pack("{s:{s:s, s:s}, s:i, s:[{s:[i]}], s:[{s:i, s:s}],"
                         " s:[{s:s, s:[{s:O, s:i, s:i, s:i}]}],"
                         " s:[{s:b, s:{s:f, s:f, s:o}}],"
                         " s:[{s:I}], s:O, s:O}",
                         "asset", "version", "2.0", "generator", "draped", "scene", 0, "scenes", "nodes", 0,
                         "nodes", "mesh", 0, "name", name, "meshes", "name", name, "primitives", "attributes",
                         attributes, "indices", (int)blocks - 1, "material", 0, "mode", GL_TRIANGLES,
                         "materials", "doubleSided", 1, "pbrMetallicRoughness", "metallicFactor", 0.0,
                         "roughnessFactor", 0.9, "baseColorFactor", base_color(fit), "buffers", "byteLength",
                         (json_int_t)offset, "bufferViews", views, "accessors", accessors);
    if (root && fit)
        rc = json_object_set_new(json_array_get(json_object_get(root, "meshes"), 0), "extras",
                                 color_legend(fit));
    if (root && rc == 0)
        text = jsonout_text(json_incref(root));
    json_decref(root);
    json_decref(views);
    json_decref(accessors);
    json_decref(attributes);
    return text;
}

int meshfile_write_glb(FILE *file, const struct mesh *mesh, const double *normals, const struct fitmap *fit,
                       const char *name)
{
    struct block block[MAX_BLOCKS];
    size_t blocks = 0, bin = 0;
    block[blocks++] = (struct block){"VEC3", "POSITION", mesh->positions, NULL, mesh->vertices, 3};
    if (normals)
        block[blocks++] = (struct block){"VEC3", "NORMAL", normals, NULL, mesh->vertices, 3};
    if (mesh->pattern)
        block[blocks++] = (struct block){"VEC2", "TEXCOORD_0", mesh->pattern, NULL, mesh->vertices, 2};
    if (fit) { /* 3.7.2.1: names of our own begin with an underscore */
        block[blocks++] = (struct block){"VEC3", "COLOR_0", fit->color, NULL, mesh->vertices, 3};
        block[blocks++] = (struct block){"VEC3", "_STRAIN", fit->strain, NULL, mesh->vertices, 3};
        block[blocks++] = (struct block){"SCALAR", "_PRESSURE", fit->pressure, NULL, mesh->vertices, 1};
        block[blocks++] = (struct block){"SCALAR", "_GAP", fit->gap, NULL, mesh->vertices, 1};
    }
    block[blocks++] = (struct block){"SCALAR", NULL, NULL, mesh->triangle, 3 * mesh->triangles, 1};
    for (size_t i = 0; i < blocks; i++)
        bin += block_bytes(&block[i]);

    char *text = make_document(block, blocks, fit, name && *name ? name : "drape");
    if (!text)
        return -1;
    /* 4.4.3: chunks end on four bytes, the JSON one with blanks; all blocks hold 4-byte numbers */
    size_t json = (strlen(text) + 3) & ~(size_t)3;
    mesh_put_u32(file, GLB_MAGIC);
    mesh_put_u32(file, GLB_VERSION);
    mesh_put_u32(file, (uint32_t)(12 + 8 + json + 8 + bin));
    mesh_put_u32(file, (uint32_t)json);
    mesh_put_u32(file, CHUNK_JSON);
    fprintf(file, "%-*s", (int)json, text);
    free(text);
    mesh_put_u32(file, (uint32_t)bin);
    mesh_put_u32(file, CHUNK_BIN);
    for (size_t i = 0; i < blocks; i++)
        put_block(file, &block[i]);
    return fflush(file) || ferror(file) ? -1 : 0;
}
