/* glb.c - binary glTF 2.0 meshes in and out.
 *
 * Read: one mesh of one triangle primitive, POSITION and, as the cloth's pattern in metres, TEXCOORD_0
 * (both float), indices of 8, 16 or 32 bits or none; one buffer, the file's binary chunk. Node
 * transforms other than the identity, sparse accessors and required extensions are refused rather than
 * passed over. Section numbers are those of the glTF 2.0 specification. */
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

struct glb {
    struct jsontext json;
    const unsigned char *bin; /* the binary chunk; NULL when there is none */
    size_t bin_bytes;
    struct problem *reterr;
};

/* A view of `count` items in the binary chunk, checked against its bounds. */
struct accessor {
    const unsigned char *data;
    size_t count, stride;
    int component;
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

static int read_floats(struct glb *glb, const struct accessor *accessor, size_t width, const char *what,
                       double *ret)
{
    for (size_t i = 0; i < accessor->count; i++)
        for (size_t k = 0; k < width; k++) {
            uint32_t bits = get_u32(accessor->data + i * accessor->stride + 4 * k);
            float value;
            memcpy(&value, &bits, sizeof value);
            if (!isfinite(value))
                return refuse(glb, "%s of vertex %zu is not finite", what, i);
            ret[width * i + k] = (double)value;
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

static bool is_array_of(const struct glb *glb, const json_t *array, const double *value, size_t n)
{
    struct numbers numbers = jsontext_numbers(&glb->json, array);
    if (numbers.count != n || numbers.odd != SIZE_MAX)
        return false;
    for (size_t i = 0; i < n; i++)
        if (numbers.value[i] != value[i])
            return false;
    return true;
}

/* 3.5.3: node transforms. */
static int check_nodes(struct glb *glb)
{
    static const double MATRIX[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    static const struct {
        const char *name;
        double value[4];
        size_t n;
    } PART[] = {{"translation", {0, 0, 0}, 3}, {"rotation", {0, 0, 0, 1}, 4}, {"scale", {1, 1, 1}, 3}};
    size_t i;
    json_t *node;
    json_array_foreach(json_object_get(glb->json.root, "nodes"), i, node)
    {
        const json_t *matrix = json_object_get(node, "matrix");
        if (matrix && !is_array_of(glb, matrix, MATRIX, 16))
            return refuse(glb, "node %zu has a matrix; apply the transforms before exporting", i);
        for (size_t k = 0; k < sizeof PART / sizeof *PART; k++) {
            const json_t *part = json_object_get(node, PART[k].name);
            if (part && !is_array_of(glb, part, PART[k].value, PART[k].n))
                return refuse(glb, "node %zu has a %s; apply the transforms before exporting", i,
                              PART[k].name);
        }
    }
    return 0;
}

static const json_t *find_primitive(struct glb *glb)
{
    const json_t *meshes = json_object_get(glb->json.root, "meshes");
    const json_t *primitives = json_object_get(json_array_get(meshes, 0), "primitives");
    const json_t *primitive = json_array_get(primitives, 0);
    if (json_array_size(json_object_get(glb->json.root, "extensionsRequired")) > 0)
        refuse(glb, "the file needs an extension (compressed geometry?), none is read");
    else if (json_array_size(meshes) != 1 || json_array_size(primitives) != 1)
        refuse(glb, "exactly one mesh of one primitive is read");
    else if (get_natural(primitive, "mode", GL_TRIANGLES) != GL_TRIANGLES)
        refuse(glb, "the primitive is not of triangles");
    else if (json_object_get(json_array_get(json_object_get(glb->json.root, "buffers"), 0), "uri"))
        refuse(glb, "the buffer must be the file's own binary chunk");
    else
        return primitive;
    return NULL;
}

static int fill_triangles(struct glb *glb, const struct accessor *index, struct mesh *mesh)
{
    for (size_t i = 0; i < 3 * mesh->triangles; i++) {
        uint32_t vertex = index->data ? get_index(index, i) : (uint32_t)i;
        if (vertex >= mesh->vertices)
            return refuse(glb, "triangle %zu: %u is no vertex, there are %zu (counted from 0)", i / 3, vertex,
                          mesh->vertices);
        mesh->triangle[i] = vertex;
    }
    return 0;
}

static int read_mesh(struct glb *glb, const struct limits *limits, struct mesh *ret)
{
    struct accessor position, uv = {0}, index = {0};
    const json_t *primitive = find_primitive(glb);
    if (!primitive || check_nodes(glb))
        return -1;
    const json_t *attributes = json_object_get(primitive, "attributes");
    bool pattern = json_object_get(attributes, "TEXCOORD_0") != NULL;
    bool indexed = json_object_get(primitive, "indices") != NULL;

    if (read_accessor(glb, get_natural(attributes, "POSITION", -1), "VEC3", 3, "POSITION", &position) ||
        (pattern &&
         read_accessor(glb, get_natural(attributes, "TEXCOORD_0", -1), "VEC2", 2, "TEXCOORD_0", &uv)) ||
        (indexed &&
         read_accessor(glb, get_natural(primitive, "indices", -1), "SCALAR", 1, "indices", &index)))
        return -1;
    if (position.component != GL_FLOAT || (pattern && uv.component != GL_FLOAT))
        return refuse(glb, "POSITION and TEXCOORD_0 must be floats");
    if (pattern && uv.count != position.count)
        return refuse(glb, "TEXCOORD_0 has %zu items, POSITION %zu", uv.count, position.count);
    if (indexed && index.component == GL_FLOAT)
        return refuse(glb, "indices must be integers");
    size_t corners = indexed ? index.count : position.count;
    if (corners % 3 != 0)
        return refuse(glb, "%zu indices are no triangles", corners);

    if (mesh_alloc(ret, position.count, corners / 3, pattern, limits, glb->reterr) ||
        read_floats(glb, &position, 3, "POSITION", ret->positions) ||
        (pattern && read_floats(glb, &uv, 2, "TEXCOORD_0", ret->pattern)))
        return -1;
    return fill_triangles(glb, &index, ret);
}

int glb_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
              struct problem *reterr)
{
    struct glb glb = {.reterr = reterr};
    int rc = -1;
    if (read_chunks(&glb, data, bytes, limits) == 0)
        rc = read_mesh(&glb, limits, ret);
    jsontext_done(&glb.json);
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
