/* ply.c - Stanford PLY meshes in (ascii, binary of either byte order) and out (binary little endian).
 *
 * Read: element vertex with x y z and, as the cloth's pattern in metres, one of the pairs s t, u v or
 * texture_u texture_v; element face with the list vertex_indices (or vertex_index). Other properties
 * and elements are passed over. */
#include "meshformat.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fitmap.h"
#include "text.h"

enum ply_type {
    PLY_INT8,
    PLY_UINT8,
    PLY_INT16,
    PLY_UINT16,
    PLY_INT32,
    PLY_UINT32,
    PLY_FLOAT,
    PLY_DOUBLE,
    PLY_TYPES
};

/* The names of the first version and those with the size in them. */
static const struct {
    const char *name[2];
    size_t bytes;
} TYPE[PLY_TYPES] = {
    [PLY_INT8] = {{"char", "int8"}, 1},      [PLY_UINT8] = {{"uchar", "uint8"}, 1},
    [PLY_INT16] = {{"short", "int16"}, 2},   [PLY_UINT16] = {{"ushort", "uint16"}, 2},
    [PLY_INT32] = {{"int", "int32"}, 4},     [PLY_UINT32] = {{"uint", "uint32"}, 4},
    [PLY_FLOAT] = {{"float", "float32"}, 4}, [PLY_DOUBLE] = {{"double", "float64"}, 8},
};

/* What a property is to us. X..V index the numbers kept of a vertex. */
enum ply_role { PLY_X, PLY_Y, PLY_Z, PLY_U, PLY_V, PLY_CORNERS, PLY_PASS };

struct ply_property {
    enum ply_type type, count_type; /* count_type: of a list's length */
    bool is_list;
    enum ply_role role;
};

#define PLY_MAX_PROPERTIES 32
#define PLY_MAX_ELEMENTS   8

struct ply_element {
    enum { PLY_VERTEX, PLY_FACE, PLY_OTHER } kind;
    uint64_t count;
    struct ply_property property[PLY_MAX_PROPERTIES];
    size_t properties;
};

struct ply {
    enum { PLY_NO_FORMAT, PLY_ASCII, PLY_LITTLE, PLY_BIG } format;
    struct ply_element element[PLY_MAX_ELEMENTS];
    size_t elements;
    const char *start; /* of the file */
    struct text text;  /* what is left of it; lines of the header, then rows when ascii */
    struct text row;   /* ascii: what is left of the row */
    struct problem *reterr;
};

static int header_problem(struct ply *ply, size_t line, const char *detail)
{
    return problem_set(ply->reterr, PROBLEM_INVALID, "line %zu: %s", line, detail);
}

/* Names the place in the body: the line, or the byte. */
static int data_problem(struct ply *ply, const char *detail)
{
    if (ply->format == PLY_ASCII)
        return header_problem(ply, ply->row.line, detail);
    return problem_set(ply->reterr, PROBLEM_INVALID, "byte %zu: %s", (size_t)(ply->text.at - ply->start),
                       detail);
}

/* ---- header ---------------------------------------------------------------------------------- */

static int read_format(struct ply *ply, struct text *line)
{
    struct word word = text_word(line);
    ply->format = word_is(word, "ascii")                  ? PLY_ASCII
                  : word_is(word, "binary_little_endian") ? PLY_LITTLE
                  : word_is(word, "binary_big_endian")    ? PLY_BIG
                                                          : PLY_NO_FORMAT;
    if (ply->format == PLY_NO_FORMAT || !word_is(text_word(line), "1.0"))
        return header_problem(ply, line->line, "unknown PLY format");
    return 0;
}

static int read_element(struct ply *ply, struct text *line)
{
    int64_t count;
    if (ply->elements == PLY_MAX_ELEMENTS)
        return header_problem(ply, line->line, "too many elements");
    struct ply_element *element = &ply->element[ply->elements++];
    struct word name = text_word(line);
    element->kind = word_is(name, "vertex") ? PLY_VERTEX : word_is(name, "face") ? PLY_FACE : PLY_OTHER;
    if (!word_integer(text_word(line), &count) || count < 0)
        return header_problem(ply, line->line, "an element needs a name and a count");
    element->count = (uint64_t)count;
    return 0;
}

static bool read_type(struct word word, enum ply_type *ret)
{
    for (int i = 0; i < PLY_TYPES; i++)
        if (word_is(word, TYPE[i].name[0]) || word_is(word, TYPE[i].name[1])) {
            *ret = (enum ply_type)i;
            return true;
        }
    return false;
}

static enum ply_role role_of(const struct ply_element *element, const struct ply_property *property,
                             struct word name)
{
    static const struct {
        const char *name;
        enum ply_role role;
    } ROLE[] = {{"x", PLY_X}, {"y", PLY_Y}, {"z", PLY_Z},         {"s", PLY_U},        {"t", PLY_V},
                {"u", PLY_U}, {"v", PLY_V}, {"texture_u", PLY_U}, {"texture_v", PLY_V}};

    if (element->kind == PLY_FACE && property->is_list &&
        (word_is(name, "vertex_indices") || word_is(name, "vertex_index")))
        return PLY_CORNERS;
    for (size_t i = 0; element->kind == PLY_VERTEX && i < sizeof ROLE / sizeof *ROLE; i++)
        if (word_is(name, ROLE[i].name))
            return ROLE[i].role;
    return PLY_PASS;
}

static int read_property(struct ply *ply, struct text *line)
{
    if (ply->elements == 0)
        return header_problem(ply, line->line, "a property before any element");
    struct ply_element *element = &ply->element[ply->elements - 1];
    if (element->properties == PLY_MAX_PROPERTIES)
        return header_problem(ply, line->line, "too many properties");
    struct ply_property *property = &element->property[element->properties];
    struct word word = text_word(line);
    property->is_list = word_is(word, "list");
    if (property->is_list) {
        if (!read_type(text_word(line), &property->count_type) || property->count_type >= PLY_FLOAT)
            return header_problem(ply, line->line, "a list needs an integer type for its length");
        word = text_word(line);
    }
    if (!read_type(word, &property->type))
        return header_problem(ply, line->line, "unknown property type");
    property->role = role_of(element, property, text_word(line));
    if (property->role == PLY_CORNERS && property->type >= PLY_FLOAT)
        return header_problem(ply, line->line, "vertex indices must be integers");
    /* coordinates are of a floating type in practice, and that bounds the growth in memory */
    if (property->role <= PLY_V && (property->is_list || property->type < PLY_FLOAT))
        return header_problem(ply, line->line, "coordinates must be float or double");
    for (size_t i = 0; property->role != PLY_PASS && i < element->properties; i++)
        if (element->property[i].role == property->role)
            return header_problem(ply, line->line, "a property given twice");
    element->properties++;
    return 0;
}

/* Up to and with the line end_header. */
static int read_header(struct ply *ply)
{
    struct text line;
    if (!text_line(&ply->text, &line) || !word_is(text_word(&line), "ply"))
        return problem_set(ply->reterr, PROBLEM_INVALID, "not a PLY file: it does not begin with \"ply\"");
    while (text_line(&ply->text, &line)) {
        struct word word = text_word(&line);
        int rc = 0;
        if (word_is(word, "end_header"))
            return ply->format == PLY_NO_FORMAT ? header_problem(ply, line.line, "no format given") : 0;
        if (word_is(word, "format"))
            rc = read_format(ply, &line);
        else if (word_is(word, "element"))
            rc = read_element(ply, &line);
        else if (word_is(word, "property"))
            rc = read_property(ply, &line);
        else if (word.bytes > 0 && !word_is(word, "comment") && !word_is(word, "obj_info"))
            rc = header_problem(ply, line.line, "unknown header line");
        if (rc)
            return rc;
    }
    return problem_set(ply->reterr, PROBLEM_INVALID, "the header does not end");
}

/* ---- body ------------------------------------------------------------------------------------ */

static uint64_t load_bytes(const char *at, size_t bytes, bool big)
{
    uint64_t value = 0;
    for (size_t i = 0; i < bytes; i++)
        value |= (uint64_t)(unsigned char)at[big ? bytes - 1 - i : i] << (8 * i);
    return value;
}

static double decode(uint64_t bits, enum ply_type type)
{
    float f;
    double d;
    uint32_t low = (uint32_t)bits;
    switch (type) {
    case PLY_INT8:
        return (int8_t)bits;
    case PLY_INT16:
        return (int16_t)bits;
    case PLY_INT32:
        return (int32_t)bits;
    case PLY_FLOAT:
        memcpy(&f, &low, sizeof f);
        return (double)f;
    case PLY_DOUBLE:
        memcpy(&d, &bits, sizeof d);
        return d;
    default:
        return low;
    }
}

/* The next number of the body. Integers of up to 32 bits are exact in a double. */
static int read_value(struct ply *ply, enum ply_type type, double *ret)
{
    if (ply->format == PLY_ASCII) {
        struct word word = text_word(&ply->row);
        if (word.bytes == 0)
            return data_problem(ply, "a number is missing");
        return word_double(word, ret) ? 0 : data_problem(ply, "not a finite number");
    }
    size_t bytes = TYPE[type].bytes;
    if ((size_t)(ply->text.end - ply->text.at) < bytes)
        return data_problem(ply, "the file ends too early");
    *ret = decode(load_bytes(ply->text.at, bytes, ply->format == PLY_BIG), type);
    ply->text.at += bytes;
    return 0;
}

static int begin_row(struct ply *ply)
{
    if (ply->format != PLY_ASCII)
        return 0;
    do {
        if (!text_line(&ply->text, &ply->row))
            return problem_set(ply->reterr, PROBLEM_INVALID, "line %zu: the file ends too early",
                               ply->text.line);
    } while (ply->row.at == ply->row.end); /* blank lines are no rows */
    return 0;
}

/* One row. `vertex` (5 numbers) and `corner` (with its *corners) take what is ours; either may be
 * NULL, which passes it over but counts the corners still. */
static int read_row(struct ply *ply, const struct ply_element *element, double *vertex, double *corner,
                    size_t *corners)
{
    if (begin_row(ply))
        return -1;
    for (size_t i = 0; i < element->properties; i++) {
        const struct ply_property *property = &element->property[i];
        double value, length = 1;
        if (property->is_list && read_value(ply, property->count_type, &length))
            return -1;
        if (length < 0 || length != floor(length))
            return data_problem(ply, "the length of a list is no natural number");
        if (property->role == PLY_CORNERS) {
            if (length < 3 || length > MESH_MAX_CORNERS)
                return data_problem(ply, length < 3 ? "a face with fewer than three corners"
                                                    : "a face with too many corners");
            *corners = (size_t)length;
        }
        for (double k = 0; k < length; k++) {
            if (read_value(ply, property->type, &value))
                return -1;
            if (property->role <= PLY_V && vertex)
                vertex[property->role] = value;
            if (property->role == PLY_CORNERS && corner)
                corner[(size_t)k] = value;
        }
    }
    return 0;
}

/* The least bytes a row can have, so that a count in the header cannot promise more than is there. */
static uint64_t least_row_bytes(const struct ply *ply, const struct ply_element *element)
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < element->properties; i++) {
        const struct ply_property *property = &element->property[i];
        if (ply->format == PLY_ASCII)
            bytes += 2; /* a digit and a blank */
        else
            bytes += TYPE[property->is_list ? property->count_type : property->type].bytes;
    }
    return bytes;
}

static int check_element(struct ply *ply, const struct ply_element *element)
{
    uint64_t least = least_row_bytes(ply, element), left = (uint64_t)(ply->text.end - ply->text.at);
    if (element->count == 0)
        return 0;
    if (least == 0)
        return problem_set(ply->reterr, PROBLEM_INVALID, "an element without properties");
    /* + 1: the last row of an ascii file may lack its line feed */
    if (element->count > (left + 1) / least)
        return problem_set(ply->reterr, PROBLEM_INVALID,
                           "the header promises %llu rows, the %llu bytes left cannot hold them",
                           (unsigned long long)element->count, (unsigned long long)left);
    return 0;
}

static const struct ply_element *find_element(const struct ply *ply, int kind)
{
    for (size_t i = 0; i < ply->elements; i++)
        if ((int)ply->element[i].kind == kind)
            return &ply->element[i];
    return NULL;
}

static bool has_role(const struct ply_element *element, enum ply_role role)
{
    for (size_t i = 0; i < element->properties; i++)
        if (element->property[i].role == role)
            return true;
    return false;
}

/* One vertex element with x y z before one face element with its list. */
static int check_elements(struct ply *ply)
{
    size_t vertices = 0, faces = 0;
    for (size_t i = 0; i < ply->elements; i++) {
        vertices += ply->element[i].kind == PLY_VERTEX;
        faces += ply->element[i].kind == PLY_FACE;
    }
    if (vertices != 1 || faces != 1)
        return problem_set(ply->reterr, PROBLEM_INVALID,
                           "a mesh needs one element vertex and one element face");
    const struct ply_element *vertex = find_element(ply, PLY_VERTEX), *face = find_element(ply, PLY_FACE);
    if (!has_role(vertex, PLY_X) || !has_role(vertex, PLY_Y) || !has_role(vertex, PLY_Z))
        return problem_set(ply->reterr, PROBLEM_INVALID, "the vertices have no x, y and z");
    if (!has_role(face, PLY_CORNERS))
        return problem_set(ply->reterr, PROBLEM_INVALID, "the faces have no list vertex_indices");
    return 0;
}

/* First pass over the body: checks its form and counts the triangles. */
static int count_triangles(struct ply *ply, size_t *ret)
{
    size_t triangles = 0;
    for (size_t i = 0; i < ply->elements; i++) {
        const struct ply_element *element = &ply->element[i];
        if (check_element(ply, element))
            return -1;
        for (uint64_t row = 0; row < element->count; row++) {
            size_t corners = 2;
            if (read_row(ply, element, NULL, NULL, &corners))
                return -1;
            triangles += corners - 2;
        }
    }
    *ret = triangles;
    return 0;
}

static int store_vertex(struct ply *ply, struct mesh *mesh, uint64_t row, const double *value)
{
    for (size_t k = 0; k < (mesh->pattern ? 5 : 3); k++)
        if (!isfinite(value[k]))
            return problem_set(ply->reterr, PROBLEM_INVALID, "vertex %llu is not finite (counted from 0)",
                               (unsigned long long)row);
    memcpy(mesh->positions + 3 * row, value + PLY_X, 3 * sizeof *value);
    if (mesh->pattern)
        memcpy(mesh->pattern + 2 * row, value + PLY_U, 2 * sizeof *value);
    return 0;
}

static int store_face(struct ply *ply, struct mesh *mesh, uint64_t row, const double *value, size_t corners)
{
    uint32_t corner[MESH_MAX_CORNERS];
    for (size_t k = 0; k < corners; k++) {
        if (!(value[k] >= 0 && value[k] < (double)mesh->vertices) || value[k] != floor(value[k]))
            return problem_set(ply->reterr, PROBLEM_INVALID,
                               "face %llu: %.17g is no vertex, there are %zu (both counted from 0)",
                               (unsigned long long)row, value[k], mesh->vertices);
        corner[k] = (uint32_t)value[k];
    }
    return mesh_add_polygon(mesh, corner, corners, "face", row, ply->reterr);
}

/* Second pass. */
static int read_body(struct ply *ply, struct mesh *mesh)
{
    double vertex[5] = {0}, corner[MESH_MAX_CORNERS];
    for (size_t i = 0; i < ply->elements; i++) {
        const struct ply_element *element = &ply->element[i];
        for (uint64_t row = 0; row < element->count; row++) {
            size_t corners = 0;
            if (read_row(ply, element, vertex, corner, &corners) ||
                (element->kind == PLY_VERTEX && store_vertex(ply, mesh, row, vertex)) ||
                (element->kind == PLY_FACE && store_face(ply, mesh, row, corner, corners)))
                return -1;
        }
    }
    return 0;
}

int ply_parse(const void *data, size_t bytes, const struct limits *limits, struct mesh *ret,
              struct problem *reterr)
{
    struct ply ply = {.start = data, .text = {data, (const char *)data + bytes, 0}, .reterr = reterr};
    size_t triangles;

    if (read_header(&ply) || check_elements(&ply))
        return -1;
    const struct ply_element *vertex = find_element(&ply, PLY_VERTEX);
    struct text body = ply.text;
    if (count_triangles(&ply, &triangles))
        return -1;
    ply.text = body;
    bool pattern = has_role(vertex, PLY_U) && has_role(vertex, PLY_V);
    if (mesh_alloc(ret, vertex->count, triangles, pattern, limits, reterr))
        return -1;
    ret->triangles = 0; /* counted up again as the faces are read */
    return read_body(&ply, ret);
}

/* ---- writing --------------------------------------------------------------------------------- */

int meshfile_write_ply(FILE *file, const struct mesh *mesh, const double *normals, const struct fitmap *fit)
{
    fprintf(file, "ply\nformat binary_little_endian 1.0\ncomment draped: metres, y up; s t = flat pattern\n");
    fprintf(file, "element vertex %zu\nproperty float x\nproperty float y\nproperty float z\n",
            mesh->vertices);
    if (normals)
        fprintf(file, "property float nx\nproperty float ny\nproperty float nz\n");
    if (mesh->pattern)
        fprintf(file, "property float s\nproperty float t\n");
    if (fit)
        fprintf(file, "property float pressure\nproperty float gap\n");
    fprintf(file, "element face %zu\nproperty list uchar uint vertex_indices\nend_header\n", mesh->triangles);
    for (size_t i = 0; i < mesh->vertices; i++) {
        mesh_put_floats(file, mesh->positions + 3 * i, 3);
        if (normals)
            mesh_put_floats(file, normals + 3 * i, 3);
        if (mesh->pattern)
            mesh_put_floats(file, mesh->pattern + 2 * i, 2);
        if (fit) {
            mesh_put_floats(file, fit->pressure + i, 1);
            mesh_put_floats(file, fit->gap + i, 1);
        }
    }
    for (size_t i = 0; i < mesh->triangles; i++) {
        fputc(3, file);
        for (size_t k = 0; k < 3; k++)
            mesh_put_u32(file, mesh->triangle[3 * i + k]);
    }
    return fflush(file) || ferror(file) ? -1 : 0;
}
