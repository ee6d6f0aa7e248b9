/* obj.c - Wavefront OBJ meshes in and out.
 *
 * Read: v, vt, f with v, v/vt, v/vt/vn or v//vn corners, negative (relative) indices, polygons. What
 * shapes no mesh (normals, groups, materials) is passed over; other statements are refused. The vt are
 * the cloth's pattern in metres: when faces use them, every vertex must have one and only one. */
#include "meshformat.h"

#include <stdlib.h>
#include <string.h>

#include "text.h"

#define NO_VT UINT32_MAX

struct obj {
    struct mesh *mesh;
    double *vt;             /* 2*vts */
    uint32_t *vt_of_vertex; /* vertices; NO_VT until a face gives one */
    size_t vertices, vts;   /* read so far: relative indices count back from here */
    size_t vts_in_all;
    size_t corners_with_vt;
    struct problem *reterr;
};

static int line_problem(struct obj *obj, size_t line, const char *detail)
{
    return problem_set(obj->reterr, PROBLEM_INVALID, "line %zu: %s", line, detail);
}

/* Statements that say nothing about where a surface is. */
static bool is_passed_over(struct word word)
{
    static const char *const NAME[] = {"vn",  "vp",     "g",          "o",         "s",        "l",
                                       "p",   "usemtl", "mtllib",     "usemap",    "maplib",   "mg",
                                       "lod", "bevel",  "shadow_obj", "trace_obj", "c_interp", "d_interp"};
    for (size_t i = 0; i < sizeof NAME / sizeof *NAME; i++)
        if (word_is(word, NAME[i]))
            return true;
    return false;
}

/* ---- first pass: counts ---------------------------------------------------------------------- */

struct counts {
    size_t vertices, vts, triangles;
};

static struct counts count_statements(struct text text)
{
    struct counts counts = {0};
    struct text line;
    while (text_line(&text, &line)) {
        struct word word = text_word(&line);
        counts.vertices += word_is(word, "v");
        counts.vts += word_is(word, "vt");
        if (word_is(word, "f")) {
            size_t corners = 0;
            while (text_word(&line).bytes > 0)
                corners++;
            counts.triangles += corners > 2 ? corners - 2 : 0;
        }
    }
    return counts;
}

/* ---- second pass ----------------------------------------------------------------------------- */

static int read_numbers(struct obj *obj, struct text *line, double *ret, size_t n, const char *detail)
{
    for (size_t i = 0; i < n; i++)
        if (!word_double(text_word(line), ret + i))
            return line_problem(obj, line->line, detail);
    return 0;
}

/* One index of a corner: from 1, or relative from -1 back. */
static int resolve(struct obj *obj, size_t line, struct word word, const char *what, size_t so_far,
                   size_t in_all, uint32_t *ret)
{
    char quote[32], detail[128];
    int64_t index;
    if (!word_integer(word, &index) || index == 0) {
        snprintf(detail, sizeof detail, "\"%s\" is no %s number", word_quote(word, quote), what);
        return line_problem(obj, line, detail);
    }
    int64_t zero_based = index > 0 ? index - 1 : (int64_t)so_far + index;
    if (zero_based < 0 || zero_based >= (int64_t)in_all) {
        snprintf(detail, sizeof detail, "%s %lld does not exist, the file has %zu", what, (long long)index,
                 in_all);
        return line_problem(obj, line, detail);
    }
    *ret = (uint32_t)zero_based;
    return 0;
}

/* v, v/vt, v//vn or v/vt/vn; the normal is passed over. */
static int read_corner(struct obj *obj, size_t line, struct word word, uint32_t *ret_v, uint32_t *ret_vt)
{
    const char *end = word.at + word.bytes;
    const char *slash = memchr(word.at, '/', word.bytes);
    struct word v = {word.at, slash ? (size_t)(slash - word.at) : word.bytes};
    *ret_vt = NO_VT;
    if (resolve(obj, line, v, "vertex", obj->vertices, obj->mesh->vertices, ret_v))
        return -1;
    if (!slash)
        return 0;
    const char *at = slash + 1;
    const char *second = memchr(at, '/', (size_t)(end - at));
    struct word vt = {at, (size_t)((second ? second : end) - at)};
    if (vt.bytes == 0 && second)
        return 0;
    return resolve(obj, line, vt, "vt", obj->vts, obj->vts_in_all, ret_vt);
}

/* A vertex may be given several vt as long as they are equal (and stand before the faces). */
static int note_vt(struct obj *obj, size_t line, uint32_t vertex, uint32_t vt)
{
    if (vt == NO_VT)
        return 0;
    obj->corners_with_vt++;
    uint32_t known = obj->vt_of_vertex[vertex];
    obj->vt_of_vertex[vertex] = vt;
    if (known == NO_VT || known == vt)
        return 0;
    if (known < obj->vts && vt < obj->vts && obj->vt[2 * known] == obj->vt[2 * vt] &&
        obj->vt[2 * known + 1] == obj->vt[2 * vt + 1])
        return 0;
    return problem_set(
        obj->reterr, PROBLEM_INVALID,
        "line %zu: vertex %u has two different vt (%u and %u); a pattern needs one per vertex: split "
        "the vertex and sew it, or leave the vt out if this is a body",
        line, vertex + 1, known + 1, vt + 1);
}

static int read_face(struct obj *obj, struct text *line)
{
    uint32_t corner[MESH_MAX_CORNERS];
    size_t corners = 0;
    for (struct word word = text_word(line); word.bytes > 0; word = text_word(line)) {
        uint32_t vt;
        if (corners == MESH_MAX_CORNERS)
            return line_problem(obj, line->line, "a face with too many corners");
        if (read_corner(obj, line->line, word, corner + corners, &vt) ||
            note_vt(obj, line->line, corner[corners], vt))
            return -1;
        corners++;
    }
    if (corners < 3)
        return line_problem(obj, line->line, "a face with fewer than three corners");
    return mesh_add_polygon(obj->mesh, corner, corners, "the face in line", line->line, obj->reterr);
}

static int read_statement(struct obj *obj, struct text *line)
{
    char quote[32], detail[64];
    struct word word = text_word(line);
    if (word.bytes == 0 || *word.at == '#')
        return 0;
    if (word_is(word, "v"))
        return read_numbers(obj, line, obj->mesh->positions + 3 * obj->vertices++, 3,
                            "v needs three numbers");
    if (word_is(word, "vt"))
        return read_numbers(obj, line, obj->vt + 2 * obj->vts++, 2, "vt needs two numbers");
    if (word_is(word, "f"))
        return read_face(obj, line);
    if (is_passed_over(word))
        return 0;
    snprintf(detail, sizeof detail, "unknown statement \"%s\"", word_quote(word, quote));
    return line_problem(obj, line->line, detail);
}

/* Turns vt_of_vertex into mesh->pattern, when the faces used vt at all. */
static int build_pattern(struct obj *obj)
{
    struct mesh *mesh = obj->mesh;
    if (obj->corners_with_vt == 0)
        return 0;
    for (size_t i = 0; i < mesh->vertices; i++)
        if (obj->vt_of_vertex[i] == NO_VT)
            return problem_set(obj->reterr, PROBLEM_INVALID, "vertex %zu has no vt where others have one",
                               i + 1);
    mesh->pattern = calloc(mesh->vertices, 2 * sizeof *mesh->pattern);
    if (!mesh->pattern)
        return problem_set(obj->reterr, PROBLEM_INTERNAL, "out of memory");
    for (size_t i = 0; i < mesh->vertices; i++)
        memcpy(mesh->pattern + 2 * i, obj->vt + 2 * obj->vt_of_vertex[i], 2 * sizeof(double));
    return 0;
}

int obj_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
              struct problem *reterr)
{
    struct text text = {data, (const char *)data + bytes, 0};
    struct counts counts = count_statements(text);
    struct obj obj = {.mesh = ret, .vts_in_all = counts.vts, .reterr = reterr};
    struct text line;
    int rc = -1;

    /* a mesh uses at most one vt for each corner of its triangles */
    if (counts.vts > 3 * limits->triangles)
        return problem_set(reterr, PROBLEM_TOO_LARGE, "%zu vt, the limit is %zu", counts.vts,
                           3 * limits->triangles);
    if (mesh_alloc(ret, counts.vertices, counts.triangles, false, limits, reterr))
        return -1;
    ret->triangles = 0; /* counted up again as the faces are read */
    if (counts.vts > 0) {
        obj.vt = calloc(counts.vts, 2 * sizeof *obj.vt);
        obj.vt_of_vertex = malloc(counts.vertices * sizeof *obj.vt_of_vertex);
        if (!obj.vt || !obj.vt_of_vertex) {
            problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
            goto cleanup;
        }
        memset(obj.vt_of_vertex, 0xFF, counts.vertices * sizeof *obj.vt_of_vertex);
    }
    while (text_line(&text, &line))
        if (read_statement(&obj, &line))
            goto cleanup;
    rc = build_pattern(&obj);

cleanup:
    free(obj.vt);
    free(obj.vt_of_vertex);
    return rc;
}

/* ---- writing --------------------------------------------------------------------------------- */

static void write_corner(FILE *file, uint32_t vertex, bool vt, bool vn)
{
    unsigned v = vertex + 1;
    if (vt && vn)
        fprintf(file, " %u/%u/%u", v, v, v);
    else if (vt)
        fprintf(file, " %u/%u", v, v);
    else if (vn)
        fprintf(file, " %u//%u", v, v);
    else
        fprintf(file, " %u", v);
}

int meshfile_write_obj(FILE *file, const struct mesh *mesh, const double *normals)
{
    fprintf(file, "# draped: metres, y up; vt = flat pattern in metres\n");
    for (size_t i = 0; i < mesh->vertices; i++)
        fprintf(file, "v %.9g %.9g %.9g\n", mesh->positions[3 * i], mesh->positions[3 * i + 1],
                mesh->positions[3 * i + 2]);
    for (size_t i = 0; mesh->pattern && i < mesh->vertices; i++)
        fprintf(file, "vt %.9g %.9g\n", mesh->pattern[2 * i], mesh->pattern[2 * i + 1]);
    for (size_t i = 0; normals && i < mesh->vertices; i++)
        fprintf(file, "vn %.6g %.6g %.6g\n", normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]);
    for (size_t i = 0; i < mesh->triangles; i++) {
        fputc('f', file);
        for (size_t k = 0; k < 3; k++)
            write_corner(file, mesh->triangle[3 * i + k], mesh->pattern != NULL, normals != NULL);
        fputc('\n', file);
    }
    return fflush(file) || ferror(file) ? -1 : 0;
}
