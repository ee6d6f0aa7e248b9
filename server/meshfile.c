/* meshfile.c - mesh formats by name, JSON meshes, and what all formats share. */
#include "meshformat.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* ---- formats by name ----------------------------------------------------------------------- */

static int json_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
                      struct problem *reterr);

/* Media types: the first of each format is the one we answer with. IANA has registered model/obj,
 * model/gltf-binary and application/json; for PLY there is only usage. */
static const struct format {
    const char *name;
    const char *media_type[4];
    int (*parse)(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
                 struct problem *reterr);
} FORMAT[MESH_FORMATS] = {
    [MESH_OBJ] = {"obj", {"model/obj", "text/prs.wavefront-obj"}, obj_parse},
    [MESH_PLY] = {"ply", {"application/x-ply", "model/ply", "model/x-ply"}, ply_parse},
    [MESH_GLB] = {"glb", {"model/gltf-binary"}, glb_parse},
    [MESH_JSON] = {"json", {"application/json"}, json_parse},
};

const char *mesh_format_name(enum mesh_format format)
{
    return FORMAT[format].name;
}

const char *mesh_format_media_type(enum mesh_format format)
{
    return FORMAT[format].media_type[0];
}

int mesh_format_from_name(const char *name)
{
    for (int i = 0; i < MESH_FORMATS; i++)
        if (strcasecmp(name, FORMAT[i].name) == 0)
            return i;
    return -1;
}

int mesh_format_from_media_type(const char *media_type)
{
    char bare[64];
    size_t n = media_type ? strcspn(media_type, "; \t") : 0;
    if (n >= sizeof bare)
        return -1;
    memcpy(bare, media_type, n);
    bare[n] = '\0';
    for (int i = 0; i < MESH_FORMATS; i++)
        for (size_t j = 0; j < 4 && FORMAT[i].media_type[j]; j++)
            if (strcasecmp(bare, FORMAT[i].media_type[j]) == 0)
                return i;
    return mesh_format_from_name(bare);
}

/* ---- the mesh ------------------------------------------------------------------------------- */

void mesh_done(struct mesh *mesh)
{
    free(mesh->positions);
    free(mesh->triangle);
    free(mesh->pattern);
    *mesh = (struct mesh){0};
}

int mesh_alloc(struct mesh *mesh, size_t vertices, size_t triangles, bool pattern,
               const struct limits *limits, struct problem *reterr)
{
    if (vertices == 0)
        return problem_set(reterr, PROBLEM_INVALID, "the mesh has no vertices");
    if (triangles == 0)
        return problem_set(reterr, PROBLEM_INVALID, "the mesh has no triangles");
    if (vertices > limits->vertices)
        return problem_set(reterr, PROBLEM_TOO_LARGE, "%zu vertices, the limit is %zu", vertices,
                           limits->vertices);
    if (triangles > limits->triangles)
        return problem_set(reterr, PROBLEM_TOO_LARGE, "%zu triangles, the limit is %zu", triangles,
                           limits->triangles);

    /* calloc checks the products */
    mesh->positions = calloc(vertices, 3 * sizeof *mesh->positions);
    mesh->triangle = calloc(triangles, 3 * sizeof *mesh->triangle);
    mesh->pattern = pattern ? calloc(vertices, 2 * sizeof *mesh->pattern) : NULL;
    if (!mesh->positions || !mesh->triangle || (pattern && !mesh->pattern))
        return problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
    mesh->vertices = vertices;
    mesh->triangles = triangles;
    return 0;
}

int mesh_add_polygon(struct mesh *mesh, const uint32_t *corner, size_t corners, const char *what,
                     uint64_t number, struct problem *reterr)
{
    for (size_t i = 1; i < corners; i++)
        for (size_t j = 0; j < i; j++)
            if (corner[i] == corner[j])
                return problem_set(reterr, PROBLEM_INVALID, "%s %llu uses one vertex twice", what,
                                   (unsigned long long)number);
    for (size_t i = 2; i < corners; i++) {
        uint32_t *t = mesh->triangle + 3 * mesh->triangles++;
        t[0] = corner[0];
        t[1] = corner[i - 1];
        t[2] = corner[i];
    }
    return 0;
}

void mesh_put_u32(FILE *file, uint32_t value)
{
    unsigned char bytes[4] = {value & 0xFF, value >> 8 & 0xFF, value >> 16 & 0xFF, value >> 24};
    fwrite(bytes, 1, sizeof bytes, file);
}

void mesh_put_floats(FILE *file, const double *value, size_t n)
{
    for (size_t i = 0; i < n; i++) {
        float f = (float)value[i];
        uint32_t bits;
        memcpy(&bits, &f, sizeof bits);
        mesh_put_u32(file, bits);
    }
}

int meshfile_parse(enum mesh_format format, const void *data, size_t bytes, const struct limits *limits,
                   struct mesh *ret, struct problem *reterr)
{
    struct mesh mesh = {0};
    if (FORMAT[format].parse(data, bytes, limits, &mesh, reterr)) {
        mesh_done(&mesh);
        return -1;
    }
    *ret = mesh;
    return 0;
}

/* ---- JSON ----------------------------------------------------------------------------------- */

static int json_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
                      struct problem *reterr)
{
    struct jsontext json;
    if (jsontext_parse(data, bytes, limits, &json, reterr))
        return -1;
    int rc = meshfile_from_json(&json, json.root, "", limits, ret, reterr);
    jsontext_done(&json);
    return rc;
}

/* The array `member` of the mesh: numbers only, at least one, and their count a multiple of `stride`. */
static int get_array(const struct jsontext *json, const json_t *object, const char *pointer,
                     const char *member, size_t stride, struct numbers *ret, struct problem *reterr)
{
    char at[JSONTEXT_POINTER_BYTES];
    const json_t *value = json_object_get(object, member);
    jsontext_pointer(at, sizeof at, pointer, member);
    if (!value)
        return problem_at(reterr, PROBLEM_INVALID, at, "is missing");
    if (jsontext_get_numbers(json, value, at, ret, reterr))
        return -1;
    if (ret->count == 0)
        return problem_at(reterr, PROBLEM_INVALID, at, "is empty");
    if (ret->count % stride != 0)
        return problem_at(reterr, PROBLEM_INVALID, at, "has %zu numbers, which is not a multiple of %zu",
                          ret->count, stride);
    return 0;
}

static int check_count(size_t count, size_t limit, const char *pointer, const char *member,
                       struct problem *reterr)
{
    char at[JSONTEXT_POINTER_BYTES];
    if (count <= limit)
        return 0;
    jsontext_pointer(at, sizeof at, pointer, member);
    return problem_at(reterr, PROBLEM_TOO_LARGE, at, "%zu, the limit is %zu", count, limit);
}

int meshfile_from_json(const struct jsontext *json, const json_t *object, const char *pointer,
                       const struct limits *limits, struct mesh *ret, struct problem *reterr)
{
    static const char *const MEMBERS[] = {"positions", "triangles", "pattern", NULL};
    struct mesh mesh = {0};
    struct numbers positions, triangles, pattern = {0};
    char at[JSONTEXT_POINTER_BYTES];

    if (!json_is_object(object))
        return problem_at(reterr, PROBLEM_INVALID, pointer, "must be an object");
    bool flat = json_object_get(object, "pattern") != NULL;
    if (jsontext_check_members(object, pointer, MEMBERS, reterr) ||
        get_array(json, object, pointer, "positions", 3, &positions, reterr) ||
        get_array(json, object, pointer, "triangles", 3, &triangles, reterr) ||
        (flat && get_array(json, object, pointer, "pattern", 2, &pattern, reterr)) ||
        check_count(positions.count / 3, limits->vertices, pointer, "positions", reterr) ||
        check_count(triangles.count / 3, limits->triangles, pointer, "triangles", reterr))
        return -1;
    size_t vertices = positions.count / 3;
    if (flat && pattern.count != 2 * vertices) {
        jsontext_pointer(at, sizeof at, pointer, "pattern");
        return problem_at(reterr, PROBLEM_INVALID, at, "has %zu numbers where %zu vertices need %zu",
                          pattern.count, vertices, 2 * vertices);
    }
    if (mesh_alloc(&mesh, vertices, triangles.count / 3, flat, limits, reterr))
        goto fail;
    jsontext_pointer(at, sizeof at, pointer, "triangles");
    if (jsontext_indices(triangles, vertices, at, mesh.triangle, reterr))
        goto fail;
    memcpy(mesh.positions, positions.value, positions.count * sizeof(double));
    if (flat)
        memcpy(mesh.pattern, pattern.value, pattern.count * sizeof(double));
    *ret = mesh;
    return 0;

fail:
    mesh_done(&mesh);
    return -1;
}

static void put_numbers(FILE *file, const char *member, const double *value, size_t n)
{
    fprintf(file, "\"%s\":[", member);
    for (size_t i = 0; i < n; i++)
        fprintf(file, i > 0 ? ",%.9g" : "%.9g", value[i]);
    fputs("]", file);
}

int meshfile_write_json(FILE *file, const struct mesh *mesh)
{
    fputs("{", file);
    put_numbers(file, "positions", mesh->positions, 3 * mesh->vertices);
    fputs(",\n\"triangles\":[", file);
    for (size_t i = 0; i < 3 * mesh->triangles; i++)
        fprintf(file, i > 0 ? ",%u" : "%u", mesh->triangle[i]);
    fputs("]", file);
    if (mesh->pattern) {
        fputs(",\n", file);
        put_numbers(file, "pattern", mesh->pattern, 2 * mesh->vertices);
    }
    fputs("}\n", file);
    return fflush(file) || ferror(file) ? -1 : 0;
}

/* ---- any format out -------------------------------------------------------------------------- */

int meshfile_write(enum mesh_format format, FILE *file, const struct mesh *mesh)
{
    switch (format) {
    case MESH_OBJ:
        return meshfile_write_obj(file, mesh, NULL);
    case MESH_PLY:
        return meshfile_write_ply(file, mesh, NULL, NULL);
    case MESH_GLB:
        return meshfile_write_glb(file, mesh, NULL, NULL, "mesh");
    case MESH_JSON:
        return meshfile_write_json(file, mesh);
    case MESH_FORMATS:
        break;
    }
    errno = EINVAL;
    return -1;
}
