/* output.c - the files of a finished job: the drape in every format, and its trace. */
#include "output.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "encoding.h"
#include "files.h"
#include "fitmap.h"
#include "groups.h"
#include "memout.h"
#include "plot.h"

/* What every writer below may need; nothing in it is changed by them. */
struct output {
    const struct job_spec *spec;
    const drape_report *report;
    struct mesh mesh;            /* the drape; borrows its arrays */
    double *normals;             /* 3*vertices */
    const drape_fit *fit;        /* NULL: not asked for */
    const struct fitmap *fitmap; /* likewise */
    const drape_row *row;
    size_t rows;
};

typedef int writer_fn(FILE *file, const struct output *output);

/* ---- vertex normals --------------------------------------------------------------------------- */

/* Groups of the vertices that are sewn together. */
static uint32_t *weld(const drape_scene_desc *scene)
{
    uint32_t *group = groups_new(scene->vertices);
    for (size_t s = 0; group && s < scene->seams; s++)
        groups_unite(group, scene->seam[2 * s], scene->seam[2 * s + 1]);
    return group;
}

/* The cross product of two sides is the normal times twice the area: its sum over the triangles around
 * a vertex is the area-weighted normal. */
static void add_triangle_normal(const double *x, const uint32_t *t, uint32_t *group, double *normals)
{
    const double *a = x + 3 * (size_t)t[0], *b = x + 3 * (size_t)t[1], *c = x + 3 * (size_t)t[2];
    double u[3], v[3];
    for (size_t k = 0; k < 3; k++) {
        u[k] = b[k] - a[k];
        v[k] = c[k] - a[k];
    }
    double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
    for (size_t corner = 0; corner < 3; corner++)
        for (size_t k = 0; k < 3; k++)
            normals[3 * (size_t)groups_root(group, t[corner]) + k] += n[k];
}

/* Unit normals, smooth across seams; straight up where there is no surface. malloc'd. */
static double *make_normals(const drape_scene_desc *scene, const double *positions)
{
    double *normals = calloc(scene->vertices, 3 * sizeof *normals);
    uint32_t *group = weld(scene);
    if (normals && group) {
        for (size_t t = 0; t < scene->triangles; t++)
            add_triangle_normal(positions, scene->triangle + 3 * t, group, normals);
        for (size_t i = 0; i < scene->vertices; i++) {
            size_t root = groups_root(group, (uint32_t)i);
            if (root != i)
                memcpy(normals + 3 * i, normals + 3 * root, 3 * sizeof *normals);
        }
    }
    for (size_t i = 0; normals && i < scene->vertices; i++) {
        double *n = normals + 3 * i, length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        if (length > 0)
            for (size_t k = 0; k < 3; k++)
                n[k] /= length;
        else
            n[1] = 1;
    }
    if (!group) {
        free(normals);
        normals = NULL;
    }
    free(group);
    return normals;
}

/* ---- the drape -------------------------------------------------------------------------------- */

/* 9 significant digits tell any two 32-bit floats apart. */
#define POSITION_DIGITS 9
/* The distance to rest is a difference of energies: all digits count. */
#define TRACE_DIGITS  17
#define NORMAL_DIGITS 6
#define FIT_DIGITS    9

static void put_numbers(FILE *file, const char *member, const double *value, size_t n, int digits)
{
    fprintf(file, "\"%s\":[", member);
    for (size_t i = 0; i < n; i++)
        if (isfinite(value[i]))
            fprintf(file, i > 0 ? ",%.*g" : "%.*g", digits, value[i]);
        else
            fputs(i > 0 ? ",null" : "null", file);
    fputs("],\n", file);
}

static void put_fit(FILE *file, const drape_fit *fit)
{
    fputs("\"fit\":{", file);
    put_numbers(file, "strain", fit->strain, 3 * fit->triangles, FIT_DIGITS);
    put_numbers(file, "stress", fit->stress, 3 * fit->triangles, FIT_DIGITS);
    if (fit->utilization)
        put_numbers(file, "utilization", fit->utilization, 3 * fit->triangles, FIT_DIGITS);
    else
        fputs("\"utilization\":null,\n", file);
    put_numbers(file, "pressure", fit->pressure, fit->vertices, FIT_DIGITS);
    put_numbers(file, "gap", fit->gap, fit->vertices, FIT_DIGITS);
    fprintf(file, "\"reach\":%g},\n", DRAPE_REACH);
}

static int write_json(FILE *file, const struct output *output)
{
    const struct mesh *mesh = &output->mesh;
    fputs("{", file);
    put_numbers(file, "positions", mesh->positions, 3 * mesh->vertices, POSITION_DIGITS);
    put_numbers(file, "normals", output->normals, 3 * mesh->vertices, NORMAL_DIGITS);
    fputs("\"triangles\":[", file);
    for (size_t i = 0; i < 3 * mesh->triangles; i++)
        fprintf(file, i > 0 ? ",%u" : "%u", mesh->triangle[i]);
    fputs("],\n", file);
    put_numbers(file, "pattern", mesh->pattern, 2 * mesh->vertices, POSITION_DIGITS);
    if (output->fit)
        put_fit(file, output->fit);
    fprintf(file, "\"verdict\":\"%s\"}\n", drape_verdict_name(output->report->verdict));
    return 0;
}

static int write_obj(FILE *file, const struct output *output)
{
    return meshfile_write_obj(file, &output->mesh, output->normals);
}

static int write_ply(FILE *file, const struct output *output)
{
    return meshfile_write_ply(file, &output->mesh, output->normals, output->fitmap);
}

static int write_glb(FILE *file, const struct output *output)
{
    return meshfile_write_glb(file, &output->mesh, output->normals, output->fitmap, output->spec->name);
}

/* ---- the trace -------------------------------------------------------------------------------- */

enum { COLUMNS = 14 };

/* New columns come last: traces that an earlier version stored are served as they are. */
static const char *const COLUMN[COLUMNS] = {"iteration",         "seconds",        "stretch", "bend",
                                            "gravity",           "contact",        "kinetic", "potential",
                                            "residual_energy",   "residual_force", "stop",    "time_step",
                                            "linear_iterations", "factorizations"};

static void put_columns(FILE *file, const char *quote)
{
    for (size_t i = 0; i < COLUMNS; i++)
        fprintf(file, "%s%s%s%s", i > 0 ? "," : "", quote, COLUMN[i], quote);
}

/* The values in the order of COLUMN; `unknown` stands for what is no number. */
static void put_row(FILE *file, const drape_row *row, const char *unknown)
{
    const drape_energies *e = &row->energy;
    const double value[COLUMNS] = {row->iteration,
                                   row->seconds,
                                   e->stretch,
                                   e->bend,
                                   e->gravity,
                                   e->contact,
                                   e->kinetic,
                                   e->potential,
                                   row->residual_energy,
                                   row->residual_force,
                                   row->stop,
                                   row->time_step,
                                   row->linear_iterations,
                                   row->factorizations};
    for (size_t i = 0; i < COLUMNS; i++) {
        if (i > 0)
            fputc(',', file);
        if (isfinite(value[i]))
            fprintf(file, "%.*g", TRACE_DIGITS, value[i]);
        else
            fputs(unknown, file);
    }
}

static int write_trace_csv(FILE *file, const struct output *output)
{
    put_columns(file, "");
    fputc('\n', file);
    for (size_t i = 0; i < output->rows; i++) {
        put_row(file, &output->row[i], "");
        fputc('\n', file);
    }
    return 0;
}

static int write_trace_json(FILE *file, const struct output *output)
{
    fputs("{\"columns\":[", file);
    put_columns(file, "\"");
    fputs("],\n\"rows\":[", file);
    for (size_t i = 0; i < output->rows; i++) {
        fputs(i > 0 ? ",\n[" : "\n[", file);
        put_row(file, &output->row[i], "null");
        fputc(']', file);
    }
    fprintf(file, "\n],\n\"residual_energy_is\":\"%s\"}\n",
            schema_residual_energy_is(output->report->reference_rows));
    return 0;
}

/* Text would cost digits, and a drape that is rounded is not at rest. */
static int write_positions(FILE *file, const struct output *output)
{
    fwrite(output->mesh.positions, sizeof(double), 3 * output->mesh.vertices, file);
    return 0;
}

/* A drape is not lost for a picture: without PLplot the file says so. */
static const char NO_PLOT[] =
    "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"640\" height=\"80\">\n"
    "<text x=\"20\" y=\"45\" font-family=\"sans-serif\" font-size=\"14\">The plot could not be drawn on this "
    "server; its figures are in trace.csv.</text>\n</svg>\n";

static int write_trace_svg(FILE *file, const struct output *output)
{
    char title[320], *svg = NULL; /* the verdict first: long names are cut short */
    size_t bytes = 0;
    const char *name = output->spec->name;
    snprintf(title, sizeof title, "%s after %u iterations%s%s", drape_verdict_name(output->report->verdict),
             output->report->iterations, *name ? ": " : "", name);
    if (plot_trace_svg(output->row, output->rows, output->spec->options.tolerance, title, &svg, &bytes) == 0)
        fwrite(svg, 1, bytes, file);
    else
        fputs(NO_PLOT, file);
    free(svg);
    return 0;
}

/* ---- files ------------------------------------------------------------------------------------ */

/* Creates, writes, syncs and closes one file; the first error of these is the one told. */
static int write_file(int dirfd, const char *name, writer_fn *writer, const struct output *output,
                      struct problem *reterr)
{
    int fd = openat(dirfd, name, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
    FILE *file = fd >= 0 ? fdopen(fd, "w") : NULL;
    int error = file ? 0 : errno;
    if (file) {
        errno = 0;
        if (writer(file, output) || fflush(file) || ferror(file) || fsync(fd))
            error = errno ? errno : EIO;
        if (fclose(file) && !error)
            error = errno;
    } else if (fd >= 0) {
        close(fd);
    }
    if (!error)
        return 0;
    return problem_set(reterr, PROBLEM_STORAGE, "%s could not be written: %s", name, strerrordesc_np(error));
}

struct coded { /* a file that is being coded */
    int fd;
    size_t bytes;
};

static int write_coded(const void *data, size_t bytes, void *sink_data)
{
    struct coded *coded = sink_data;
    coded->bytes += bytes;
    return files_write_all(coded->fd, data, bytes);
}

static void encode_as(int dirfd, const char *name, enum coding coding, const void *data, size_t bytes)
{
    char path[64];
    snprintf(path, sizeof path, "%s.%s", name, coding_suffix(coding));
    struct coded coded = {openat(dirfd, path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600),
                          0};
    if (coded.fd < 0)
        return;
    int failed = encoding_encode(coding, data, bytes, write_coded, &coded) != 0 ||
                 !coded_is_worth(bytes, coded.bytes) || fsync(coded.fd) != 0;
    if (close(coded.fd) != 0 || failed)
        unlinkat(dirfd, path, 0);
}

/* The file once more in every coding that is worth it. These are a convenience: where one cannot be written
 * the drape is not lost, and is sent as it is. */
static void encode_file(int dirfd, const char *name)
{
    int fd = openat(dirfd, name, O_RDONLY | O_CLOEXEC);
    struct stat st;
    if (fd >= 0 && fstat(fd, &st) == 0 && st.st_size >= CODED_LEAST) {
        size_t bytes = (size_t)st.st_size;
        void *data = mmap(NULL, bytes, PROT_READ, MAP_PRIVATE, fd, 0);
        for (int c = CODING_IDENTITY + 1; data != MAP_FAILED && c < CODINGS; c++)
            encode_as(dirfd, name, (enum coding)c, data, bytes);
        if (data != MAP_FAILED)
            munmap(data, bytes);
    }
    if (fd >= 0)
        close(fd);
}

static int check_finite(const struct output *output, struct problem *reterr)
{
    for (size_t i = 0; i < 3 * output->mesh.vertices; i++)
        if (!isfinite(output->mesh.positions[i]))
            return problem_set(reterr, PROBLEM_SOLVER, "vertex %zu of the drape is not finite", i / 3);
    return 0;
}

int output_write(int dirfd, const struct job_spec *spec, const drape_report *report, const double *positions,
                 const drape_fit *fit, const drape_row *row, size_t rows, struct problem *reterr)
{
    static const struct {
        const char *name;
        writer_fn *writer;
        bool result; /* left out of a job that only evaluated the start */
        bool served; /* to clients, which may want it coded */
    } FILES[] = {
        {OUTPUT_RESULT_JSON, write_json, true, true},       {OUTPUT_RESULT_OBJ, write_obj, true, true},
        {OUTPUT_RESULT_PLY, write_ply, true, true},         {OUTPUT_RESULT_GLB, write_glb, true, true},
        {OUTPUT_POSITIONS, write_positions, true, false},   {OUTPUT_TRACE_CSV, write_trace_csv, false, true},
        {OUTPUT_TRACE_JSON, write_trace_json, false, true}, {OUTPUT_TRACE_SVG, write_trace_svg, false, true}};
    struct output output = {
        .spec = spec, .report = report, .mesh = spec->cloth, .fit = fit, .row = row, .rows = rows};
    struct fitmap map = {0};
    bool result = report->state.iteration > 0; /* the undraped start is no result */
    int rc = 0;

    output.mesh.positions = (double *)(uintptr_t)positions; /* only read */
    if (check_finite(&output, reterr))
        return -1;
    output.normals = make_normals(&spec->scene, positions);
    if (!output.normals || (fit && fitmap_new(fit, &spec->cloth, &map))) {
        free(output.normals);
        return problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
    }
    output.fitmap = fit ? &map : NULL;
    for (size_t i = 0; i < sizeof FILES / sizeof *FILES && rc == 0; i++) {
        if (!result && FILES[i].result)
            continue;
        rc = write_file(dirfd, FILES[i].name, FILES[i].writer, &output, reterr);
        if (rc == 0 && FILES[i].served)
            encode_file(dirfd, FILES[i].name);
    }
    fitmap_done(&map);
    free(output.normals);
    return rc;
}

/* ---- the preview ------------------------------------------------------------------------------ */

char *output_preview(const struct job_spec *spec, const drape_preview *preview, size_t *ret_bytes)
{
    drape_scene_desc scene = {.vertices = preview->vertices,
                              .triangles = preview->triangles,
                              .triangle = preview->triangle,
                              .seams = preview->seams,
                              .seam = preview->seam};
    struct mesh mesh = {.positions = (double *)(uintptr_t)preview->positions, /* only read, as the next */
                        .triangle = (uint32_t *)(uintptr_t)preview->triangle,
                        .pattern = malloc(2 * preview->vertices * sizeof *mesh.pattern),
                        .vertices = preview->vertices,
                        .triangles = preview->triangles};
    double *normals = make_normals(&scene, preview->positions);
    struct memout memout;
    FILE *file = mesh.pattern && normals ? memout_open(&memout) : NULL;
    char *glb = NULL;
    for (size_t v = 0; file && v < mesh.vertices; v++)
        memcpy(mesh.pattern + 2 * v, spec->cloth.pattern + 2 * (size_t)preview->vertex[v],
               2 * sizeof *mesh.pattern);
    if (file) {
        int failed = meshfile_write_glb(file, &mesh, normals, NULL, spec->name);
        fclose(file);
        glb = memout_take(&memout, ret_bytes);
        if (failed) {
            free(glb);
            glb = NULL;
        }
    }
    free(mesh.pattern);
    free(normals);
    return glb;
}
