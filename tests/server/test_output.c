/* test_output.c - the files of a finished job: complete, readable, honest about a full disk. */
#include "test.h"

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "encoding.h"
#include "output.h"

/* Two triangles sewn along an edge and folded there by a right angle: one half lies flat, facing up,
 * the other stands, facing -x. */
static const char JOB[] = "{\"name\": \"fold & <crease>\", \"cloth\": {\"mesh\": {"
                          " \"positions\": [0,0,0, 0,0,1, 1,0,0, 0,0,0, 0,1,0, 0,0,1],"
                          " \"triangles\": [0,1,2, 3,5,4], \"pattern\": [0,0, 0,1, 1,0, 0,0, -1,0, 0,1]},"
                          " \"seams\": [0,3, 1,5], \"pins\": [0], \"materials\": [{\"preset\": \"linen\"}]}}";

struct fixture {
    struct job_spec *spec;
    drape_report report;
    drape_row row[3];
    double strain[6], stress[6], pressure[6], gap[6];
    drape_fit fit;
    char dir[64];
    int dirfd;
};

static void empty_folder(const struct fixture *f)
{
    static const char *const NAME[] = {OUTPUT_RESULT_JSON, OUTPUT_RESULT_OBJ, OUTPUT_RESULT_PLY,
                                       OUTPUT_RESULT_GLB,  OUTPUT_TRACE_CSV,  OUTPUT_TRACE_JSON,
                                       OUTPUT_TRACE_SVG,   OUTPUT_POSITIONS};
    for (size_t i = 0; i < sizeof NAME / sizeof *NAME; i++)
        unlinkat(f->dirfd, NAME[i], 0);
}

static int set_up(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    struct problem problem;
    *state = f;
    if (!f || schema_job_parse(JOB, sizeof JOB - 1, &limits_default, NULL, NULL, &f->spec, &problem))
        return -1;
    f->report = (drape_report){
        .verdict = DRAPE_VERDICT_AT_REST, .iterations = 2, .state.iteration = 2, .reason = "at rest"};
    for (uint32_t i = 0; i < 3; i++)
        f->row[i] = (drape_row){.iteration = i,
                                .seconds = 0.125 * i,
                                .residual_force = 1 / (1. + 10 * i),
                                .stop = i == 1,
                                .residual_energy = i == 0 ? NAN : 1e-3 / i,
                                .time_step = 0.02,
                                .factorizations = i == 0 ? 3 : 1,
                                .energy = {.stretch = 1.0 / 3, .potential = -0.25}};
    f->fit = (drape_fit){6, 2, f->strain, f->stress, NULL, f->pressure, f->gap};
    for (size_t i = 0; i < 6; i++) {
        f->strain[i] = 0.01 * (double)(i + 1);
        f->stress[i] = 100 * f->strain[i];
        f->pressure[i] = 8 * (double)i;
        f->gap[i] = i < 5 ? 0.0025 * (double)i : NAN;
    }
    snprintf(f->dir, sizeof f->dir, "/tmp/test_output.XXXXXX");
    if (!mkdtemp(f->dir))
        return -1;
    f->dirfd = open(f->dir, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    return f->dirfd >= 0 ? 0 : -1;
}

static int tear_down(void **state)
{
    struct fixture *f = *state;
    empty_folder(f);
    close(f->dirfd);
    rmdir(f->dir);
    job_spec_free(f->spec);
    free(f);
    return 0;
}

static int write_all(struct fixture *f, struct problem *reterr)
{
    return output_write(f->dirfd, f->spec, &f->report, f->spec->scene.positions, NULL, f->row, 3, reterr);
}

static bool is_coded(const char *name)
{
    const char *dot = strrchr(name, '.');
    return dot && (strcmp(dot, ".gz") == 0 || strcmp(dot, ".zst") == 0);
}

/* Without those in content codings. */
static size_t count_files(const struct fixture *f)
{
    size_t n = 0;
    DIR *dir = opendir(f->dir);
    for (struct dirent *entry; (entry = readdir(dir));)
        n += entry->d_name[0] != '.' && !is_coded(entry->d_name);
    closedir(dir);
    return n;
}

/* The whole file, with a terminator; NULL when it is not there. */
static char *read_file(const struct fixture *f, const char *name, size_t *ret_bytes)
{
    int fd = openat(f->dirfd, name, O_RDONLY | O_CLOEXEC);
    FILE *file = fd >= 0 ? fdopen(fd, "r") : NULL;
    if (!file)
        return NULL;
    char *data = calloc(1, (size_t)1 << 20);
    *ret_bytes = fread(data, 1, ((size_t)1 << 20) - 1, file);
    fclose(file);
    return data;
}

static json_t *read_json(const struct fixture *f, const char *name)
{
    size_t bytes;
    json_error_t error;
    char *data = read_file(f, name, &bytes);
    assert_non_null(data);
    json_t *json = json_loadb(data, bytes, JSON_REJECT_DUPLICATES, &error);
    if (!json)
        fail_msg("%s: line %d: %s", name, error.line, error.text);
    free(data);
    return json;
}

static double at(const json_t *array, size_t i)
{
    const json_t *value = json_array_get(array, i);
    assert_true(json_is_number(value));
    return json_number_value(value);
}

/* ------------------------------------------------------------------------------------------------ */

static void test_output__all_eight_files_are_written(void **state)
{
    struct problem problem;
    assert_int_equal(write_all(*state, &problem), 0);
    assert_int_equal(count_files(*state), 8);
    assert_int_equal(write_all(*state, &problem), 0); /* again, over the first */
    assert_int_equal(count_files(*state), 8);
}

static int append(const void *data, size_t bytes, void *sink_data)
{
    return fwrite(data, 1, bytes, sink_data) == bytes ? 0 : -1;
}

/* Decodes `name` in a coding and compares; whether it was there. */
static bool check_coded(const struct fixture *f, const char *name, enum coding coding)
{
    char path[64], *plain, *coded, *decoded = NULL;
    size_t plain_bytes, coded_bytes, decoded_bytes;
    const char *why;
    snprintf(path, sizeof path, "%s.%s", name, coding_suffix(coding));
    if ((coded = read_file(f, path, &coded_bytes)) == NULL)
        return false;
    plain = read_file(f, name, &plain_bytes);
    FILE *out = open_memstream(&decoded, &decoded_bytes);
    assert_int_equal(encoding_decode(coding, coded, coded_bytes, plain_bytes, append, out, &why),
                     DECODING_OK);
    fclose(out);
    assert_int_equal(decoded_bytes, plain_bytes);
    assert_memory_equal(decoded, plain, plain_bytes);
    assert_true(plain_bytes >= CODED_LEAST && coded_bytes <= plain_bytes * 9 / 10);
    free(coded);
    free(plain);
    free(decoded);
    return true;
}

static void test_output__what_is_worth_it_is_there_in_each_coding(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    assert_int_equal(write_all(f, &problem), 0);
    for (int c = CODING_IDENTITY + 1; c < CODINGS; c++) {
        assert_true(check_coded(f, OUTPUT_TRACE_SVG, (enum coding)c));
        assert_false(check_coded(f, OUTPUT_RESULT_JSON, (enum coding)c)); /* six vertices are few */
        assert_false(check_coded(f, OUTPUT_POSITIONS, (enum coding)c));   /* nobody fetches them */
    }
}

/* What another job starts from must be the drape to the last bit. */
static void test_output__positions_lose_no_digit(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    size_t bytes;
    double *kept = f->spec->cloth.positions; /* what write_all writes */
    kept[1] = 1.0 / 3;
    assert_int_equal(write_all(f, &problem), 0);
    char *file = read_file(f, OUTPUT_POSITIONS, &bytes);
    assert_int_equal(bytes, 18 * sizeof(double));
    assert_memory_equal(file, kept, bytes);
    free(file);
}

static void test_output__result_json_has_the_members_of_the_contract(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    assert_int_equal(write_all(f, &problem), 0);
    json_t *json = read_json(f, OUTPUT_RESULT_JSON);
    assert_int_equal(json_object_size(json), 5);
    assert_int_equal(json_array_size(json_object_get(json, "positions")), 18);
    assert_int_equal(json_array_size(json_object_get(json, "triangles")), 6);
    assert_close(at(json_object_get(json, "positions"), 13), 1, 0);
    assert_close(at(json_object_get(json, "triangles"), 4), 5, 0);
    assert_close(at(json_object_get(json, "pattern"), 8), -1, 0);
    assert_string_equal(json_string_value(json_object_get(json, "verdict")), "at-rest");
    json_decref(json);
}

/* The triangles are of one size, so on the crease the normal is half-way between theirs, on both sides
 * of the seam; elsewhere it is the triangle's own. */
static void test_output__normals_are_weighted_by_area_and_smooth_across_seams(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    assert_int_equal(write_all(f, &problem), 0);
    json_t *json = read_json(f, OUTPUT_RESULT_JSON), *n = json_object_get(json, "normals");
    static const double UP[] = {0, 1, 0}, BACK[] = {-1, 0, 0};
    for (size_t k = 0; k < 3; k++) {
        assert_near(at(n, 3 * 2 + k), UP[k], 1e-6, 1);
        assert_near(at(n, 3 * 4 + k), BACK[k], 1e-6, 1);
        assert_near(at(n, 3 * 0 + k), (UP[k] + BACK[k]) / sqrt(2), 1e-5, 1);
        assert_near(at(n, 3 * 3 + k), at(n, 3 * 0 + k), 0, 1);
        assert_near(at(n, 3 * 5 + k), at(n, 3 * 1 + k), 0, 1);
    }
    json_decref(json);
}

static void test_output__mesh_files_read_back(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    static const struct {
        enum mesh_format format;
        const char *name;
    } CASE[] = {{MESH_OBJ, OUTPUT_RESULT_OBJ}, {MESH_PLY, OUTPUT_RESULT_PLY}, {MESH_GLB, OUTPUT_RESULT_GLB}};
    assert_int_equal(write_all(f, &problem), 0);
    for (size_t i = 0; i < 3; i++) {
        struct mesh mesh = {0};
        size_t bytes;
        char *data = read_file(f, CASE[i].name, &bytes);
        if (meshfile_parse(CASE[i].format, data, bytes, &limits_default, &mesh, &problem))
            fail_msg("%s: %s", CASE[i].name, problem.detail);
        assert_int_equal(mesh.vertices, 6);
        assert_memory_equal(mesh.triangle, f->spec->scene.triangle, 6 * sizeof(uint32_t));
        assert_memory_equal(mesh.pattern, f->spec->scene.pattern, 12 * sizeof(double)); /* small integers */
        mesh_done(&mesh);
        free(data);
    }
}

/* Of the second triangle alone, its vertices in another order, sewn to a copy of one of its own. */
static void test_output__a_preview_is_a_mesh_of_its_own(void **state)
{
    struct fixture *f = *state;
    static const double positions[] = {0, 0, 2, 0, 1, 0, 0, 0, 1, 9, 9, 9};
    static const uint32_t vertex[] = {5, 4, 3, 0}, triangle[] = {2, 0, 1}, seam[] = {2, 3};
    static const double pattern[] = {0, 1, -1, 0, 0, 0, 0, 0};
    const drape_preview preview = {4, 1, 1, positions, vertex, triangle, seam};
    struct mesh mesh = {0};
    struct problem problem;
    size_t bytes = 0;
    char *glb = output_preview(f->spec, &preview, &bytes);
    assert_non_null(glb);
    if (meshfile_parse(MESH_GLB, glb, bytes, &limits_default, &mesh, &problem))
        fail_msg("%s", problem.detail);
    assert_int_equal(mesh.vertices, 4);
    assert_int_equal(mesh.triangles, 1);
    assert_memory_equal(mesh.positions, positions, sizeof positions); /* small integers */
    assert_memory_equal(mesh.triangle, triangle, sizeof triangle);
    assert_memory_equal(mesh.pattern, pattern, sizeof pattern);
    mesh_done(&mesh);
    free(glb);
}

static int write_fit(struct fixture *f)
{
    struct problem problem;
    return output_write(f->dirfd, f->spec, &f->report, f->spec->scene.positions, &f->fit, f->row, 3,
                        &problem);
}

static void test_output__the_fit_is_in_the_json_where_asked_for(void **state)
{
    struct fixture *f = *state;
    assert_int_equal(write_fit(f), 0);
    json_t *json = read_json(f, OUTPUT_RESULT_JSON), *fit = json_object_get(json, "fit");
    assert_int_equal(json_object_size(json), 6);
    assert_int_equal(json_object_size(fit), 6);
    assert_int_equal(json_array_size(json_object_get(fit, "strain")), 6);
    assert_int_equal(json_array_size(json_object_get(fit, "gap")), 6);
    assert_close(at(json_object_get(fit, "strain"), 4), 0.05, 1e-9);
    assert_close(at(json_object_get(fit, "stress"), 5), 6, 1e-9);
    assert_close(at(json_object_get(fit, "pressure"), 3), 24, 0);
    assert_close(at(json_object_get(fit, "gap"), 4), 0.01, 0);
    assert_true(json_is_null(json_array_get(json_object_get(fit, "gap"), 5)));
    assert_true(json_is_null(json_object_get(fit, "utilization")));
    assert_close(at(json_object_get(json, "positions"), 13), 1, 0);
    json_decref(json);

    const double part[6] = {0.5, 0, NAN, 0.25, 1.5, NAN};
    f->fit.utilization = part;
    assert_int_equal(write_fit(f), 0);
    json = read_json(f, OUTPUT_RESULT_JSON);
    const json_t *utilization = json_object_get(json_object_get(json, "fit"), "utilization");
    assert_close(at(utilization, 4), 1.5, 0);
    assert_true(json_is_null(json_array_get(utilization, 5)));
    json_decref(json);
}

/* The numbers of the accessor that the GLB gives an attribute, from its binary chunk. */
static const float *attribute(const char *glb, const json_t *root, const char *name, const char *type)
{
    const json_t *primitive =
        json_array_get(json_object_get(json_array_get(json_object_get(root, "meshes"), 0), "primitives"), 0);
    const json_t *index = json_object_get(json_object_get(primitive, "attributes"), name);
    assert_true(json_is_integer(index));
    const json_t *accessor =
        json_array_get(json_object_get(root, "accessors"), (size_t)json_integer_value(index));
    assert_string_equal(json_string_value(json_object_get(accessor, "type")), type);
    assert_int_equal(json_integer_value(json_object_get(accessor, "componentType")), 5126);
    assert_int_equal(json_integer_value(json_object_get(accessor, "count")), 6);
    const json_t *view = json_array_get(json_object_get(root, "bufferViews"),
                                        (size_t)json_integer_value(json_object_get(accessor, "bufferView")));
    uint32_t json_bytes;
    memcpy(&json_bytes, glb + 12, sizeof json_bytes);
    return (const float *)(const void *)(glb + 28 + json_bytes +
                                         json_integer_value(json_object_get(view, "byteOffset")));
}

/* In numbers that the format allows, and still a mesh that reads back. */
static void test_output__glb_and_ply_carry_the_fit_by_vertex(void **state)
{
    struct fixture *f = *state;
    struct mesh mesh = {0};
    struct problem problem;
    size_t bytes;
    assert_int_equal(write_fit(f), 0);
    char *glb = read_file(f, OUTPUT_RESULT_GLB, &bytes);
    uint32_t json_bytes;
    memcpy(&json_bytes, glb + 12, sizeof json_bytes);
    json_t *root = json_loadb(glb + 20, json_bytes, 0, NULL);
    assert_non_null(root);
    const float *pressure = attribute(glb, root, "_PRESSURE", "SCALAR");
    const float *gap = attribute(glb, root, "_GAP", "SCALAR");
    const float *strain = attribute(glb, root, "_STRAIN", "VEC3");
    const float *color = attribute(glb, root, "COLOR_0", "VEC3");
    for (size_t i = 0; i < 6; i++) {
        assert_near((double)pressure[i], f->pressure[i], 1e-6, 1);
        assert_near((double)gap[i], i < 5 ? f->gap[i] : DRAPE_REACH, 1e-7, 1);
        for (size_t k = 0; k < 3; k++) { /* each vertex has one triangle */
            assert_near((double)strain[3 * i + k], f->strain[i / 3 * 3 + k], 1e-7, 1);
            assert_true(color[3 * i + k] >= 0 && color[3 * i + k] <= 1);
        }
    }
    const json_t *material = json_array_get(json_object_get(root, "materials"), 0);
    const json_t *white =
        json_object_get(json_object_get(material, "pbrMetallicRoughness"), "baseColorFactor");
    for (size_t k = 0; k < 4; k++)
        assert_close(at(white, k), 1, 0); /* or it would tint the map */
    const json_t *extras = json_object_get(json_array_get(json_object_get(root, "meshes"), 0), "extras");
    assert_close(at(json_object_get(json_object_get(extras, "COLOR_0"), "range"), 1),
                 sqrt(0.04 * 0.04 + 0.05 * 0.05 + 0.06 * 0.06 / 2), 1e-12);
    json_decref(root);
    assert_int_equal(meshfile_parse(MESH_GLB, glb, bytes, &limits_default, &mesh, &problem), 0);
    mesh_done(&mesh);
    free(glb);

    char *ply = read_file(f, OUTPUT_RESULT_PLY, &bytes);
    assert_non_null(strstr(ply, "property float pressure\nproperty float gap\n"));
    assert_int_equal(meshfile_parse(MESH_PLY, ply, bytes, &limits_default, &mesh, &problem), 0);
    assert_memory_equal(mesh.triangle, f->spec->scene.triangle, 6 * sizeof(uint32_t));
    float row[10]; /* of the second vertex */
    memcpy(row, strstr(ply, "end_header\n") + strlen("end_header\n") + sizeof row, sizeof row);
    assert_near((double)row[8], f->pressure[1], 1e-6, 1);
    assert_near((double)row[9], f->gap[1], 1e-7, 1);
    mesh_done(&mesh);
    free(ply);
}

static void test_output__trace_csv_is_as_the_contract_has_it(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    size_t bytes;
    assert_int_equal(write_all(f, &problem), 0);
    char *data = read_file(f, OUTPUT_TRACE_CSV, &bytes);
    assert_string_equal(
        data,
        "iteration,seconds,stretch,bend,gravity,contact,kinetic,potential,residual_energy,"
        "residual_force,stop,time_step,linear_iterations,factorizations\n"
        "0,0,0.33333333333333331,0,0,0,0,-0.25,,1,0,0.02,0,3\n" /* what is no number is left empty */
        "1,0.125,0.33333333333333331,0,0,0,0,-0.25,0.001,0.090909090909090912,1,0.02,0,1\n"
        "2,0.25,0.33333333333333331,0,0,0,0,-0.25,0.00050000000000000001,0.047619047619047616,0,0.02,0,1\n");
    free(data);
}

static void test_output__trace_json_says_the_same(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    assert_int_equal(write_all(f, &problem), 0);
    json_t *json = read_json(f, OUTPUT_TRACE_JSON), *rows = json_object_get(json, "rows");
    assert_int_equal(json_array_size(json_object_get(json, "columns")), 14);
    assert_string_equal(json_string_value(json_array_get(json_object_get(json, "columns"), 8)),
                        "residual_energy");
    assert_int_equal(json_array_size(rows), 3);
    assert_true(json_is_null(json_array_get(json_array_get(rows, 0), 8)));
    assert_close(at(json_array_get(rows, 2), 8), 5e-4, 0);
    assert_string_equal(json_string_value(json_object_get(json, "residual_energy_is")), "estimate");
    json_decref(json);
    f->report.reference_rows = true;
    assert_int_equal(write_all(f, &problem), 0);
    json = read_json(f, OUTPUT_TRACE_JSON);
    assert_string_equal(json_string_value(json_object_get(json, "residual_energy_is")), "reference");
    json_decref(json);
}

static void test_output__trace_svg_is_a_picture(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    size_t bytes;
    assert_int_equal(write_all(f, &problem), 0);
    char *data = read_file(f, OUTPUT_TRACE_SVG, &bytes);
    assert_memory_equal(data, "<?xml", 5);
    assert_non_null(strstr(data, "<polyline"));
    assert_non_null(strstr(data, "</svg>"));
    assert_null(strstr(data, "<crease>")); /* the name of the job is escaped */
    free(data);
}

static void test_output__evaluated_start_has_a_trace_and_no_result(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    f->report.state.iteration = 0;
    assert_int_equal(
        output_write(f->dirfd, f->spec, &f->report, f->spec->scene.positions, NULL, f->row, 1, &problem), 0);
    assert_int_equal(count_files(f), 3);
    assert_int_equal(faccessat(f->dirfd, OUTPUT_RESULT_JSON, F_OK, 0), -1);
    assert_int_equal(faccessat(f->dirfd, OUTPUT_TRACE_SVG, F_OK, 0), 0);
}

static void test_output__drape_that_is_not_finite_is_no_result(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    double positions[18] = {0};
    positions[7] = NAN;
    assert_int_equal(output_write(f->dirfd, f->spec, &f->report, positions, NULL, f->row, 3, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_SOLVER);
    assert_non_null(strstr(problem.detail, "vertex 2"));
    assert_int_equal(count_files(f), 0);
}

/* Every size a file may stop at: RLIMIT_FSIZE makes the write fail there, as a full disk would. */
static void test_output__disk_that_fills_up_is_told(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    struct rlimit old, small;
    assert_int_equal(write_all(f, &problem), 0);
    void (*handler)(int) = signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    for (rlim_t size = 0; size < 700; size += 50) {
        empty_folder(f);
        small = (struct rlimit){size, old.rlim_max};
        assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
        int rc = write_all(f, &problem);
        setrlimit(RLIMIT_FSIZE, &old);
        assert_int_equal(rc, -1);
        assert_int_equal(problem.code, PROBLEM_STORAGE);
        assert_non_null(strstr(problem.detail, "File too large"));
    }
    signal(SIGXFSZ, handler);
}

static void test_output__folder_that_refuses_is_told(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    assert_int_equal(
        output_write(-1, f->spec, &f->report, f->spec->scene.positions, NULL, f->row, 3, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_STORAGE);
    assert_non_null(strstr(problem.detail, OUTPUT_RESULT_JSON));
}

/* In a process of its own, which has not loaded the drivers yet. */
static void test_output__drape_is_kept_when_plplot_fails(void **state)
{
    struct fixture *f = *state;
    struct problem problem;
    size_t bytes;
    int status;
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        setenv("PLPLOT_DRV_DIR", "/nonexistent", 1);
        _exit(write_all(f, &problem) || write_all(f, &problem) ? 1 : 0);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
    char *data = read_file(f, OUTPUT_TRACE_SVG, &bytes);
    assert_non_null(strstr(data, "could not be drawn"));
    free(data);
    assert_int_equal(count_files(f), 8);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_output__drape_is_kept_when_plplot_fails), /* first: see there */
        TEST(test_output__all_eight_files_are_written),
        TEST(test_output__what_is_worth_it_is_there_in_each_coding),
        TEST(test_output__positions_lose_no_digit),
        TEST(test_output__result_json_has_the_members_of_the_contract),
        TEST(test_output__normals_are_weighted_by_area_and_smooth_across_seams),
        TEST(test_output__mesh_files_read_back),
        TEST(test_output__a_preview_is_a_mesh_of_its_own),
        TEST(test_output__the_fit_is_in_the_json_where_asked_for),
        TEST(test_output__glb_and_ply_carry_the_fit_by_vertex),
        TEST(test_output__trace_csv_is_as_the_contract_has_it),
        TEST(test_output__trace_json_says_the_same),
        TEST(test_output__trace_svg_is_a_picture),
        TEST(test_output__evaluated_start_has_a_trace_and_no_result),
        TEST(test_output__drape_that_is_not_finite_is_no_result),
        TEST(test_output__disk_that_fills_up_is_told),
        TEST(test_output__folder_that_refuses_is_told),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
