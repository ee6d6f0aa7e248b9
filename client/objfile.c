/* objfile.c - a line at a time, so that every refusal can name its line. */
#include "objfile.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_CORNERS 64 /* of one polygon */
#define NO_TEXTURE  UINT32_MAX

struct reader {
    const char *path;
    size_t line;
    bool with_pattern;
    double *position, *texture;      /* 3 per vertex; 2 per vt */
    uint32_t *triangle, *texture_of; /* 3 per triangle; per vertex its vt, or NO_TEXTURE */
    size_t vertices, textures, triangles, texture_of_count;
    size_t position_room, texture_room, triangle_room; /* in elements */
    struct failure *failure;
};

__attribute__((format(printf, 2, 3))) static int refuse(struct reader *reader, const char *format, ...)
{
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    return failure_set(reader->failure, EXIT_USAGE, "%s:%zu: %s", reader->path, reader->line, text);
}

/* Makes room for `count` more elements; 0 or -1 (memory, or a mesh beyond SURFACE_MAX). */
static int make_room(struct reader *reader, void **array, size_t *room, size_t used, size_t count,
                     size_t size)
{
    if (used + count <= *room) {
        return 0;
    }
    size_t wanted = 2 * (used + count);
    if (wanted > 8 * (size_t)SURFACE_MAX) {
        return refuse(reader, "the mesh has more than %d vertices or triangles", SURFACE_MAX);
    }
    void *longer = realloc(*array, wanted * size);
    if (!longer) {
        return failure_no_memory(reader->failure);
    }
    *array = longer;
    *room = wanted;
    return 0;
}

/* Reads `count` finite numbers; what follows them is ignored (OBJ allows w and colours). */
static int read_numbers(struct reader *reader, const char *text, int count, double *number)
{
    for (int i = 0; i < count; i++) {
        char *end = NULL;
        number[i] = strtod(text, &end);
        if (end == text || !isfinite(number[i])) {
            return refuse(reader, "expected %d finite numbers", count);
        }
        text = end;
    }
    return 0;
}

static int read_vertex(struct reader *reader, const char *text)
{
    void *array = reader->position;
    if (make_room(reader, &array, &reader->position_room, 3 * reader->vertices, 3, sizeof(double)) < 0) {
        return -1;
    }
    reader->position = array;
    return read_numbers(reader, text, 3, reader->position + 3 * reader->vertices++);
}

static int read_texture(struct reader *reader, const char *text)
{
    void *array = reader->texture;
    if (make_room(reader, &array, &reader->texture_room, 2 * reader->textures, 2, sizeof(double)) < 0) {
        return -1;
    }
    reader->texture = array;
    return read_numbers(reader, text, 2, reader->texture + 2 * reader->textures++);
}

/* One-based, or negative from the end; zero-based on success. */
static int resolve_index(struct reader *reader, const char *what, long index, size_t count, uint32_t *ret)
{
    long long found = index < 0 ? (long long)count + index : (long long)index - 1;
    if (index == 0 || found < 0 || found >= (long long)count) {
        return refuse(reader, "%s %ld does not exist; %zu read so far", what, index, count);
    }
    *ret = (uint32_t)found;
    return 0;
}

/* "v", "v/vt", "v//vn" or "v/vt/vn"; moves *text behind it. */
static int read_corner(struct reader *reader, const char **text, uint32_t *vertex, uint32_t *texture)
{
    char *end = NULL;
    long index = strtol(*text, &end, 10);
    if (end == *text) {
        return refuse(reader, "expected a vertex number at \"%.20s\"", *text);
    }
    *texture = NO_TEXTURE;
    if (resolve_index(reader, "vertex", index, reader->vertices, vertex) < 0) {
        return -1;
    }
    if (*end == '/' && end[1] != '/') {
        const char *from = end + 1;
        index = strtol(from, &end, 10);
        if (end == from) {
            return refuse(reader, "expected a texture number at \"%.20s\"", from);
        }
        if (resolve_index(reader, "vt", index, reader->textures, texture) < 0) {
            return -1;
        }
    }
    *text = end + strcspn(end, " \t\r\n");
    return 0;
}

static int note_texture(struct reader *reader, uint32_t vertex, uint32_t texture)
{
    if (!reader->with_pattern) {
        return 0;
    }
    if (texture == NO_TEXTURE) {
        return refuse(reader, "vertex %u has no vt here: the flat rest shape is needed (f v/vt ...)",
                      vertex + 1);
    }
    if (reader->texture_of_count < reader->vertices) {
        uint32_t *longer = realloc(reader->texture_of, reader->position_room / 3 * sizeof *longer);
        if (!longer) {
            return failure_no_memory(reader->failure);
        }
        for (size_t i = reader->texture_of_count; i < reader->position_room / 3; i++) {
            longer[i] = NO_TEXTURE;
        }
        reader->texture_of = longer;
        reader->texture_of_count = reader->position_room / 3;
    }
    if (reader->texture_of[vertex] != NO_TEXTURE && reader->texture_of[vertex] != texture) {
        return refuse(reader,
                      "vertex %u goes with vt %u and vt %u: split it where pattern pieces meet, and sew it",
                      vertex + 1, reader->texture_of[vertex] + 1, texture + 1);
    }
    reader->texture_of[vertex] = texture;
    return 0;
}

static int read_face(struct reader *reader, const char *text)
{
    uint32_t corner[MAX_CORNERS];
    size_t corners = 0;
    for (text += strspn(text, " \t\r\n"); *text; text += strspn(text, " \t\r\n")) {
        uint32_t texture;
        if (corners == MAX_CORNERS) {
            return refuse(reader, "a face has more than %d corners", MAX_CORNERS);
        }
        if (read_corner(reader, &text, &corner[corners], &texture) < 0 ||
            note_texture(reader, corner[corners], texture) < 0) {
            return -1;
        }
        corners++;
    }
    if (corners < 3) {
        return refuse(reader, "a face has %zu corners; 3 are the least", corners);
    }
    void *array = reader->triangle;
    if (make_room(reader, &array, &reader->triangle_room, 3 * reader->triangles, 3 * corners,
                  sizeof(uint32_t)) < 0) {
        return -1;
    }
    reader->triangle = array;
    for (size_t k = 2; k < corners; k++) {
        uint32_t *out = reader->triangle + 3 * reader->triangles++;
        out[0] = corner[0];
        out[1] = corner[k - 1];
        out[2] = corner[k];
    }
    return 0;
}

static int read_statement(struct reader *reader, const char *line)
{
    line += strspn(line, " \t");
    if (strncmp(line, "v ", 2) == 0 || strncmp(line, "v\t", 2) == 0) {
        return read_vertex(reader, line + 2);
    }
    if (strncmp(line, "vt ", 3) == 0 || strncmp(line, "vt\t", 3) == 0) {
        return read_texture(reader, line + 3);
    }
    if (strncmp(line, "f ", 2) == 0 || strncmp(line, "f\t", 2) == 0) {
        return read_face(reader, line + 2);
    }
    return 0;
}

static int finish(struct reader *reader, struct surface *ret)
{
    if (reader->triangles == 0) {
        return failure_set(reader->failure, EXIT_USAGE, "%s: no faces in it; is it an OBJ file?",
                           reader->path);
    }
    if (reader->vertices > SURFACE_MAX || reader->triangles > SURFACE_MAX) {
        return refuse(reader, "the mesh has more than %d vertices or triangles", SURFACE_MAX);
    }
    for (size_t i = 0; reader->with_pattern && i < reader->vertices; i++) {
        if (i >= reader->texture_of_count || reader->texture_of[i] == NO_TEXTURE) {
            return failure_set(reader->failure, EXIT_USAGE, "%s: vertex %zu belongs to no face", reader->path,
                               i + 1);
        }
    }
    if (surface_new(reader->vertices, reader->triangles, reader->with_pattern, ret) < 0) {
        return failure_no_memory(reader->failure);
    }
    memcpy(ret->positions, reader->position, 3 * reader->vertices * sizeof *ret->positions);
    memcpy(ret->triangle, reader->triangle, 3 * reader->triangles * sizeof *ret->triangle);
    for (size_t i = 0; ret->pattern && i < reader->vertices; i++) {
        memcpy(ret->pattern + 2 * i, reader->texture + 2 * (size_t)reader->texture_of[i],
               2 * sizeof *ret->pattern);
    }
    return 0;
}

static FILE *open_file(const char *path, struct failure *failure)
{
    FILE *file = fopen(path, "re");
    if (!file) {
        failure_set(failure, EXIT_USAGE, "cannot open %s: %s", path, strerror(errno));
    }
    return file;
}

int objfile_read(const char *path, bool with_pattern, struct surface *ret, struct failure *failure)
{
    struct reader reader = {.path = path, .with_pattern = with_pattern, .failure = failure};
    FILE *file = open_file(path, failure);
    if (!file) {
        return -1;
    }
    char *line = NULL;
    size_t size = 0;
    int status = 0;
    while (status == 0 && getline(&line, &size, file) >= 0) {
        reader.line++;
        status = read_statement(&reader, line);
    }
    if (status == 0 && ferror(file)) {
        status = failure_set(failure, EXIT_USAGE, "cannot read %s: %s", path, strerror(errno));
    }
    if (status == 0) {
        status = finish(&reader, ret);
    }
    fclose(file);
    free(line);
    free(reader.position);
    free(reader.texture);
    free(reader.triangle);
    free(reader.texture_of);
    return status;
}

/* ---- seams --------------------------------------------------------------------------------------- */

/* A one-based vertex number at *line, which moves past it. 0, or -1 with the failure set. */
static int read_vertex_number(struct reader *reader, const char **line, const char *expected, uint32_t *ret)
{
    char *end = NULL;
    long index = strtol(*line, &end, 10);
    if (end == *line) {
        return refuse(reader, "expected %s", expected);
    }
    if (index < 1 || (unsigned long)index > reader->vertices) {
        return refuse(reader, "vertex %ld does not exist; the garment has 1 to %zu", index, reader->vertices);
    }
    *ret = (uint32_t)(index - 1);
    *line = end;
    return 0;
}

/* One line into pair[2]; 1 when it holds a pair, 0 when it is blank, -1 with the failure set. */
static int read_pair(struct reader *reader, const char *line, uint32_t pair[2])
{
    line += strspn(line, " \t\r\n");
    if (*line == '\0' || *line == '#') {
        return 0;
    }
    for (int k = 0; k < 2; k++) {
        if (read_vertex_number(reader, &line, "two vertex numbers", &pair[k]) < 0) {
            return -1;
        }
    }
    return 1;
}

static int read_seam_lines(FILE *file, struct reader *reader, uint32_t **seam, size_t *seams)
{
    char *line = NULL;
    size_t size = 0, room = 0;
    int status = 0;
    while (status == 0 && getline(&line, &size, file) >= 0) {
        uint32_t pair[2];
        reader->line++;
        status = read_pair(reader, line, pair);
        if (status == 1) {
            void *array = *seam;
            status = make_room(reader, &array, &room, 2 * *seams, 2, sizeof **seam);
            *seam = array;
            if (status == 0) {
                memcpy(*seam + 2 * (*seams)++, pair, sizeof pair);
            }
        }
    }
    free(line);
    return status;
}

int objfile_read_seams(const char *path, size_t vertices, uint32_t **ret, size_t *ret_seams,
                       struct failure *failure)
{
    struct reader reader = {.path = path, .vertices = vertices, .failure = failure};
    FILE *file = open_file(path, failure);
    if (!file) {
        return -1;
    }
    uint32_t *seam = NULL;
    size_t seams = 0;
    int status = read_seam_lines(file, &reader, &seam, &seams);
    if (status == 0 && ferror(file)) {
        status = failure_set(failure, EXIT_USAGE, "cannot read %s: %s", path, strerror(errno));
    }
    fclose(file);
    if (status < 0) {
        free(seam);
        return -1;
    }
    *ret = seam;
    *ret_seams = seams;
    return 0;
}

/* ---- lines to be measured -------------------------------------------------------------------------- */

void objfile_line_done(struct objfile_line *line)
{
    free(line->name);
    free(line->vertex);
    *line = (struct objfile_line){0};
}

/* One line of text; 1 when it holds a line, 0 when it is blank, -1 with the failure set. */
static int read_named_line(struct reader *reader, const char *text, struct objfile_line *ret)
{
    size_t room = 0, length;
    text += strspn(text, " \t\r\n");
    if (*text == '\0' || *text == '#') {
        return 0;
    }
    length = strcspn(text, " \t\r\n");
    ret->name = strndup(text, length);
    if (!ret->name) {
        return failure_no_memory(reader->failure);
    }
    text += length;
    while (*(text += strspn(text, " \t\r\n")) != '\0') {
        void *array = ret->vertex;
        int status = make_room(reader, &array, &room, ret->vertices, 1, sizeof *ret->vertex);
        ret->vertex = array;
        if (status < 0 ||
            read_vertex_number(reader, &text, "vertex numbers", &ret->vertex[ret->vertices]) < 0) {
            return -1;
        }
        ret->vertices++;
    }
    return 1;
}

static int read_named_lines(FILE *file, struct reader *reader, struct objfile_line **line, size_t *lines)
{
    char *text = NULL;
    size_t size = 0, room = 0;
    int status = 0;
    while (status >= 0 && getline(&text, &size, file) >= 0) {
        void *array = *line;
        reader->line++;
        status = make_room(reader, &array, &room, *lines, 1, sizeof **line);
        *line = array;
        if (status == 0) {
            (*line)[*lines] = (struct objfile_line){0};
            status = read_named_line(reader, text, &(*line)[*lines]);
            *lines += status != 0; /* half a line has something to be freed, too */
        }
    }
    free(text);
    return status < 0 ? -1 : 0;
}

int objfile_read_lines(const char *path, size_t vertices, struct objfile_line **ret, size_t *ret_lines,
                       struct failure *failure)
{
    struct reader reader = {.path = path, .vertices = vertices, .failure = failure};
    FILE *file = open_file(path, failure);
    if (!file) {
        return -1;
    }
    struct objfile_line *line = NULL;
    size_t lines = 0;
    int status = read_named_lines(file, &reader, &line, &lines);
    if (status == 0 && ferror(file)) {
        status = failure_set(failure, EXIT_USAGE, "cannot read %s: %s", path, strerror(errno));
    }
    fclose(file);
    if (status < 0) {
        while (lines > 0) {
            objfile_line_done(&line[--lines]);
        }
        free(line);
        return -1;
    }
    *ret = line;
    *ret_lines = lines;
    return 0;
}
