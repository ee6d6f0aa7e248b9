/* scene.c - writes a scene as a job document, array by array, without building a JSON tree. */
#include "scene.h"

#include <errno.h>
#include <jansson.h>
#include <stdlib.h>

/* Nine significant digits: a nanometre at one metre, and a float32 survives unchanged. */
#define NUMBER "%.9g"
/* Numbers on one line of the output, so that a job can be read in an editor. */
#define NUMBERS_PER_LINE 12

struct scene scene_default(void)
{
    return (struct scene){
        .materials = 1,
        .thickness = -1,
        .body_offset = -1,
        .body_friction = -1,
        .motion_seconds = -1,
        .solver = {.time_step = -1, .tolerance = -1, .time_limit = -1, .max_iterations = -1},
    };
}

void scene_done(struct scene *scene)
{
    surface_done(&scene->cloth);
    for (size_t b = 0; b < scene->bodies; b++) {
        surface_done(&scene->body[b]);
    }
    for (size_t i = 0; i < scene->elastics; i++) {
        free(scene->elastic[i].edge);
    }
    for (size_t i = 0; i < scene->folds; i++) {
        free(scene->fold[i].edge);
    }
    free(scene->elastic);
    free(scene->fold);
    free(scene->body);
    for (size_t i = 0; i < scene->lines; i++) {
        objfile_line_done(&scene->line[i]);
    }
    free(scene->line);
    for (size_t k = 0; k < scene->keyframes; k++) {
        surface_done(&scene->keyframe[k]);
    }
    free(scene->keyframe);
    free(scene->triangle_material);
    free(scene->seam);
    free(scene->pin);
    *scene = scene_default();
}

static void write_separator(FILE *file, size_t i)
{
    if (i > 0) {
        fputc(',', file);
    }
    if (i > 0 && i % NUMBERS_PER_LINE == 0) {
        fputc('\n', file);
    }
}

static void write_reals(FILE *file, const char *key, const double *value, size_t count)
{
    fprintf(file, "\"%s\": [", key);
    for (size_t i = 0; i < count; i++) {
        write_separator(file, i);
        fprintf(file, NUMBER, value[i]);
    }
    fputc(']', file);
}

static void write_indices(FILE *file, const char *key, const uint32_t *value, size_t count)
{
    fprintf(file, "\"%s\": [", key);
    for (size_t i = 0; i < count; i++) {
        write_separator(file, i);
        fprintf(file, "%u", (unsigned)value[i]);
    }
    fputc(']', file);
}

/* A quoted and escaped JSON string; 0 or -1 (not UTF-8, or no memory). */
static int write_string(FILE *file, const char *key, const char *value)
{
    json_t *string = json_string(value);
    int status = -1;
    if (string) {
        fprintf(file, "\"%s\": ", key);
        status = json_dumpf(string, file, JSON_ENCODE_ANY);
    } else {
        errno = EILSEQ;
    }
    json_decref(string);
    return status;
}

static void write_mesh(FILE *file, const struct surface *mesh)
{
    fprintf(file, "\"mesh\": {");
    write_reals(file, "positions", mesh->positions, 3 * mesh->vertices);
    fprintf(file, ",\n");
    write_indices(file, "triangles", mesh->triangle, 3 * mesh->triangles);
    if (mesh->pattern) {
        fprintf(file, ",\n");
        write_reals(file, "pattern", mesh->pattern, 2 * mesh->vertices);
    }
    fprintf(file, "}");
}

static int write_material(FILE *file, const struct scene_material *m)
{
    int status = 0;
    fprintf(file, "{");
    if (m->preset) {
        status = write_string(file, "preset", m->preset);
    } else {
        fprintf(file,
                "\"density\": " NUMBER ", \"stretch\": {\"weft\": " NUMBER ", \"warp\": " NUMBER
                ", \"shear\": " NUMBER "}, \"poisson\": " NUMBER,
                m->density, m->weft, m->warp, m->shear, m->poisson);
        fprintf(file, ", \"bend\": {\"weft\": " NUMBER ", \"warp\": " NUMBER ", \"twist\": " NUMBER "}",
                m->bend_weft, m->bend_warp, m->bend_twist);
    }
    fprintf(file, "}");
    return status;
}

static int write_materials(FILE *file, const struct scene *scene)
{
    int status = 0;
    fprintf(file, "\"materials\": [");
    for (size_t m = 0; m < scene->materials; m++) {
        fputs(m > 0 ? ", " : "", file);
        status |= write_material(file, &scene->material[m]);
    }
    fputc(']', file);
    if (scene->triangle_material) {
        fprintf(file, ",\n");
        write_indices(file, "triangle_material", scene->triangle_material, scene->cloth.triangles);
    }
    return status;
}

static void write_edges(FILE *file, const char *key, const char *shape, const struct scene_edges *line,
                        size_t lines)
{
    fprintf(file, ",\n\"%s\": [", key);
    for (size_t i = 0; i < lines; i++) {
        fprintf(file, "%s{", i > 0 ? ",\n" : "");
        write_indices(file, "edges", line[i].edge, 2 * line[i].edges);
        fprintf(file, ", \"%s\": " NUMBER ", \"stiffness\": " NUMBER "}", shape, line[i].shape,
                line[i].stiffness);
    }
    fputc(']', file);
}

static int write_cloth(FILE *file, const struct scene *scene)
{
    fprintf(file, "\"cloth\": {");
    write_mesh(file, &scene->cloth);
    if (scene->seams > 0) {
        fprintf(file, ",\n");
        write_indices(file, "seams", scene->seam, 2 * scene->seams);
    }
    if (scene->pins > 0) {
        fprintf(file, ",\n");
        write_indices(file, "pins", scene->pin, scene->pins);
    }
    if (scene->elastics > 0) {
        write_edges(file, "elastics", "factor", scene->elastic, scene->elastics);
    }
    if (scene->folds > 0) {
        write_edges(file, "folds", "angle", scene->fold, scene->folds);
    }
    fprintf(file, ",\n");
    int status = write_materials(file, scene);
    if (scene->thickness >= 0) {
        fprintf(file, ", \"thickness\": " NUMBER, scene->thickness);
    }
    fprintf(file, "}");
    return status;
}

/* The postures that the last body takes; its triangles are theirs. */
static void write_motion(FILE *file, const struct scene *scene)
{
    fprintf(file, ",\n\"motion\": [");
    for (size_t k = 0; k < scene->keyframes; k++) {
        fprintf(file, "%s{", k > 0 ? ",\n" : "");
        write_reals(file, "positions", scene->keyframe[k].positions, 3 * scene->keyframe[k].vertices);
        fprintf(file, "}");
    }
    fprintf(file, "]");
    if (scene->motion_seconds >= 0) {
        fprintf(file, ", \"motion_seconds\": " NUMBER, scene->motion_seconds);
    }
}

static void write_bodies(FILE *file, const struct scene *scene)
{
    fprintf(file, ",\n\"bodies\": [");
    for (size_t b = 0; b < scene->bodies; b++) {
        fprintf(file, "%s{", b > 0 ? ",\n" : "");
        write_mesh(file, &scene->body[b]);
        if (scene->body_offset >= 0) {
            fprintf(file, ", \"offset\": " NUMBER, scene->body_offset);
        }
        if (scene->body_friction >= 0) {
            fprintf(file, ", \"friction\": " NUMBER, scene->body_friction);
        }
        if (scene->keyframes > 0 && b + 1 == scene->bodies) {
            write_motion(file, scene);
        }
        fprintf(file, "}");
    }
    fprintf(file, "]");
}

static int write_lines(FILE *file, const struct scene *scene)
{
    int status = 0;
    fprintf(file, ",\n\"lines\": [");
    for (size_t i = 0; i < scene->lines; i++) {
        fprintf(file, "%s{", i > 0 ? ",\n" : "");
        status |= write_string(file, "name", scene->line[i].name);
        fprintf(file, ", ");
        write_indices(file, "vertices", scene->line[i].vertex, scene->line[i].vertices);
        fputc('}', file);
    }
    fputc(']', file);
    return status;
}

static const char *comma(int *written)
{
    return (*written)++ > 0 ? ", " : "";
}

static int write_solver(FILE *file, const struct scene_solver *solver)
{
    int written = 0, status = 0;
    fprintf(file, ",\n\"solver\": {");
    if (solver->method) {
        fputs(comma(&written), file);
        status |= write_string(file, "method", solver->method);
    }
    if (solver->stop_on) {
        fputs(comma(&written), file);
        status |= write_string(file, "stop_on", solver->stop_on);
    }
    if (solver->time_step >= 0) {
        fprintf(file, "%s\"time_step\": " NUMBER, comma(&written), solver->time_step);
    }
    if (solver->tolerance >= 0) {
        fprintf(file, "%s\"tolerance\": " NUMBER, comma(&written), solver->tolerance);
    }
    if (solver->max_iterations >= 0) {
        fprintf(file, "%s\"max_iterations\": %ld", comma(&written), solver->max_iterations);
    }
    if (solver->time_limit >= 0) {
        fprintf(file, "%s\"time_limit_s\": " NUMBER, comma(&written), solver->time_limit);
    }
    fprintf(file, "}");
    return status;
}

int scene_write(FILE *file, const struct scene *scene)
{
    int status = 0;
    fprintf(file, "{");
    if (scene->name) {
        status |= write_string(file, "name", scene->name);
        fprintf(file, ",\n");
    }
    status |= write_cloth(file, scene);
    if (scene->bodies > 0) {
        write_bodies(file, scene);
    }
    if (scene->lines > 0) {
        status |= write_lines(file, scene);
    }
    if (scene->fit) {
        fprintf(file, ",\n\"fit\": true");
    }
    if (scene->self_contact) {
        fprintf(file, ",\n");
        status |= write_string(file, "self_contact", scene->self_contact);
    }
    if (scene->start_from) {
        fprintf(file, ",\n");
        status |= write_string(file, "start_from", scene->start_from);
    }
    status |= write_solver(file, &scene->solver);
    fprintf(file, "}\n");
    return status != 0 || fflush(file) != 0 || ferror(file) ? -1 : 0;
}
