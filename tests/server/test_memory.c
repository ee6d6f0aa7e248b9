/* test_memory.c - every allocation of the parsers made to fail in turn: an error each time, no crash, and
 * nothing left behind; and what hostile documents make them hold at most.
 *
 * malloc and its kin are replaced in this program alone. Sanitizers and Valgrind replace them too: there
 * the tests are skipped. */
#include "test.h"

#include <limits.h>
#include <malloc.h>
#include <stdbool.h>
#include <time.h>

#include "keys.h"
#include "output.h"
#include "schema.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define REPLACED 0
#else
#define REPLACED 1
#endif

/* volatile: a compiler knows malloc, and knows that it does not look at these */
static volatile bool armed;
static volatile long countdown;  /* allocations until the one that fails, and all after it */
static volatile long live;       /* blocks allocated and not freed while armed */
static volatile long held, peak; /* bytes of them, and the most there were */

#if REPLACED
void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *old, size_t size);
void __libc_free(void *block);

static bool fails(void)
{
    return armed && --countdown < 0;
}

static void hold(void *block, long sign)
{
    if (!armed || !block)
        return;
    held += sign * (long)malloc_usable_size(block);
    if (held > peak)
        peak = held;
}

static void *count_block(void *block)
{
    live += armed && block;
    hold(block, 1);
    return block;
}

void *malloc(size_t size)
{
    return fails() ? NULL : count_block(__libc_malloc(size));
}

void *calloc(size_t count, size_t size)
{
    return fails() ? NULL : count_block(__libc_calloc(count, size));
}

void *realloc(void *old, size_t size)
{
    if (fails())
        return NULL;
    if (!old)
        return count_block(__libc_malloc(size));
    hold(old, -1);
    void *block = __libc_realloc(old, size);
    hold(block ? block : old, 1);
    return block;
}

void free(void *block)
{
    live -= armed && block;
    hold(block, -1);
    __libc_free(block);
}
#endif

/* ---- what is swept: 0 when it worked, -1 with the problem when it did not -------------------------- */

static const char JOB[] =
    "{\"name\": \"square\", \"labels\": {\"order\": \"4711\"}, \"cloth\": {\"mesh\": {"
    " \"positions\": [0,1,0, 1,1,0, 0,1,1, 1,1,0, 0,1,1, 1,1,1], \"triangles\": [0,2,1, 3,4,5],"
    " \"pattern\": [0,0, 1,0, 0,1, 1,0, 0,1, 1,1]}, \"seams\": [1,3, 2,4], \"pins\": [0],"
    " \"materials\": [{\"preset\": \"linen\"}, {\"preset\": \"denim\", \"poisson\": 0,"
    " \"stretch\": {\"weft\": [[0.1, 5]], \"shear\": [[0.1, 2], [0.2, 9]]}}], \"triangle_material\": [1, 0],"
    " \"elastics\": [{\"edges\": [0,1], \"factor\": 0.7, \"stiffness\": 30}],"
    " \"folds\": [{\"edges\": [1,2], \"angle\": 90, \"stiffness\": 1e-3}],"
    " \"tacks\": [{\"vertex\": 5, \"body\": 0, \"triangle\": 2, \"barycentric\": [0.5, 0.25]}]},"
    " \"bodies\": [{\"mesh\": {\"positions\": [0,-7,0, 1,-7,0, 0,-7,1, 0,-6,0],"
    " \"triangles\": [0,1,2, 0,3,1, 1,3,2, 0,2,3]}}],"
    " \"lines\": [{\"name\": \"hem\", \"vertices\": [0, 1]}]}";
static const char OBJ[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
static const char PLY[] = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                          "property float z\nproperty float s\nproperty float t\nelement face 1\n"
                          "property list uchar int vertex_indices\nend_header\n"
                          "0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n";
static const char JSON[] =
    "{\"positions\":[0,0,0,1,0,0,0,1,0],\"triangles\":[0,1,2],\"pattern\":[0,0,1,0,0,1]}";

static int try_job(struct problem *reterr)
{
    struct job_spec *spec = NULL;
    int rc = schema_job_parse(JOB, sizeof JOB - 1, &limits_default, NULL, NULL, &spec, reterr);
    job_spec_free(spec);
    return rc;
}

static int try_keys(struct problem *reterr)
{
    static const char KEYS[] =
        "{\"keys\":[{\"name\":\"shop\",\"queued\":3,"
        "\"sha256\":\"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad\"}]}";
    struct key *key = NULL;
    size_t count;
    int rc = keys_parse(KEYS, sizeof KEYS - 1, &limits_default.key, &key, &count, reterr);
    free(key);
    return rc;
}

static int try_mesh(enum mesh_format format, const char *text, struct problem *reterr)
{
    struct mesh mesh = {0};
    int rc = meshfile_parse(format, text, strlen(text), &limits_default, &mesh, reterr);
    mesh_done(&mesh);
    return rc;
}

static int try_obj(struct problem *reterr)
{
    return try_mesh(MESH_OBJ, OBJ, reterr);
}

static int try_ply(struct problem *reterr)
{
    return try_mesh(MESH_PLY, PLY, reterr);
}

static int try_json(struct problem *reterr)
{
    return try_mesh(MESH_JSON, JSON, reterr);
}

static int without_json(json_t *json, struct problem *reterr)
{
    bool made = json != NULL;
    json_decref(json);
    return made ? 0 : problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
}

static int try_report(struct problem *reterr)
{
    drape_report report = {.reason = "", .terms = 2, .stages = 1, .stage = {{"assemble", 1}}};
    report.term[0] = (drape_term){"stretch", true, 1, ""};
    report.term[1] = (drape_term){"contact", false, 0, "no body"};
    return without_json(schema_report_json(&report, NULL), reterr);
}

static int try_progress(struct problem *reterr)
{
    drape_progress progress = {0};
    drape_options options = drape_options_default();
    return without_json(schema_progress_json(&progress, &options), reterr);
}

/* Two triangles sewn along a side. */
static int try_preview(struct problem *reterr)
{
    static double pattern[] = {0, 0, 1, 0, 0, 1, 0, 0, 0, 1, -1, 0};
    static const double positions[] = {0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 1, 0};
    static const uint32_t vertex[] = {0, 1, 2, 3, 4, 5}, seam[] = {0, 3, 2, 4};
    struct job_spec spec = {.cloth = {.pattern = pattern, .vertices = 6}};
    drape_preview preview = {6, 2, 2, positions, vertex, vertex, seam};
    size_t bytes;
    char *glb = output_preview(&spec, &preview, &bytes);
    bool made = glb != NULL;
    free(glb);
    return made ? 0 : problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
}

static int try_materials(struct problem *reterr)
{
    return without_json(schema_materials_json(), reterr);
}

static bool is_replaced(void)
{
    void *volatile block;
    countdown = 0;
    armed = REPLACED;
    block = malloc(1);
    armed = false;
    free(block);
    return !block;
}

static void sweep(int (*try)(struct problem *reterr), const char *name)
{
    struct problem problem;
    int rc = -1;
    long n = 0;
    if (!is_replaced()) {
        print_message("SKIP: %s: another tool owns malloc here\n", name);
        skip();
    }
    for (; rc != 0 && n < 100000; n++) {
        memset(&problem, 0, sizeof problem);
        countdown = n;
        live = 0;
        armed = true;
        rc = try(&problem);
        armed = false;
        if (live != 0)
            fail_msg("%s, allocation %ld: %ld blocks left behind", name, n, live);
        if (rc != 0 && problem.code != PROBLEM_INTERNAL)
            fail_msg("%s, allocation %ld: %s: %s", name, n, problem_name(problem.code), problem.detail);
    }
    assert_int_equal(rc, 0);
    assert_true(n > 3); /* it did allocate, and each of these failed once */
}

#define SWEEP(what)                                                                                          \
    static void test_memory__##what##_gives_an_error_for_each_allocation(void **state)                       \
    {                                                                                                        \
        (void)state;                                                                                         \
        sweep(try_##what, #what);                                                                            \
    }

SWEEP(job)
SWEEP(keys)
SWEEP(obj)
SWEEP(ply)
SWEEP(json)
SWEEP(report)
SWEEP(progress)
SWEEP(preview)
SWEEP(materials)

/* ---- what hostile documents hold ------------------------------------------------------------------- */

#define MIB ((size_t)1 << 20)

/* A job document may make its parser hold so much: a tenth of a small server. */
#define JOB_PEAK (128 * MIB)

/* A mesh file four times its size, and what a mesh at its limits (13 MiB) or a full JSON tree takes: a number
 * may be two bytes in the text and eight in memory, twice. */
#define MESH_TIMES 4
#define MESH_PLUS  (16 * MIB)

struct document { /* grows at its end; a text made of pieces */
    char *text;
    size_t bytes;
    FILE *file;
};

/* *d stays where it is until it is parsed: the stream writes to it. */
static void begin(struct document *d)
{
    d->file = open_memstream(&d->text, &d->bytes);
    assert_non_null(d->file);
}

/* `piece` until the document has `bytes`. */
static void fill(struct document *d, const char *piece, size_t bytes)
{
    size_t n = strlen(piece);
    for (size_t at = (size_t)ftello(d->file); at + n <= bytes; at += n)
        fwrite(piece, 1, n, d->file);
}

static void repeat(struct document *d, const char *piece, size_t times)
{
    for (size_t i = 0; i < times; i++)
        fputs(piece, d->file);
}

/* Parses it as `format`, or as a job for MESH_FORMATS; the most it held. Prints what it took. */
static size_t peak_of(struct document *d, enum mesh_format format, const char *name)
{
    struct problem problem = {0};
    struct job_spec *spec = NULL;
    struct mesh mesh = {0};
    struct timespec from, to;
    fclose(d->file);
    assert_true(d->bytes > 10000);
    countdown = LONG_MAX;
    live = held = peak = 0;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &from);
    armed = true;
    int rc = format == MESH_FORMATS
                 ? schema_job_parse(d->text, d->bytes, &limits_default, NULL, NULL, &spec, &problem)
                 : meshfile_parse(format, d->text, d->bytes, &limits_default, &mesh, &problem);
    job_spec_free(spec);
    mesh_done(&mesh);
    armed = false;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &to);
    print_message("  %-34s %8.2f MiB: held %7.2f MiB, %5.0f ms, %s\n", name, (double)d->bytes / MIB,
                  (double)peak / MIB,
                  (double)(to.tv_sec - from.tv_sec) * 1e3 + (double)(to.tv_nsec - from.tv_nsec) / 1e6,
                  rc == 0 ? "read" : problem.detail);
    assert_int_equal(live, 0);
    return (size_t)peak;
}

static void check_job(struct document *d, const char *name)
{
    size_t most = peak_of(d, MESH_FORMATS, name);
    if (most > JOB_PEAK)
        fail_msg("%s: %zu bytes held", name, most);
    free(d->text);
}

static void check_mesh(struct document *d, enum mesh_format format, const char *name)
{
    size_t most = peak_of(d, format, name), allowed = MESH_TIMES * d->bytes + MESH_PLUS;
    if (most > allowed)
        fail_msg("%s of %zu bytes: %zu held", name, d->bytes, most);
    free(d->text);
}

static void skip_without_malloc(void)
{
    if (!is_replaced()) {
        print_message("SKIP: another tool owns malloc here\n");
        skip();
    }
}

static void test_memory__hostile_jobs_hold_no_more_than_they_may(void **state)
{
    (void)state;
    static const struct {
        const char *name, *before, *piece, *after;
    } row[] = {
        {"numbers", "{\"cloth\":{\"mesh\":{\"positions\":[0", ",0", "]}}}"},
        {"long numbers", "{\"cloth\":{\"mesh\":{\"positions\":[0", ",0.12345678901234567", "]}}}"},
        {"empty objects", "{\"bodies\":[{}", ",{}", "]}"},
        {"empty arrays", "{\"bodies\":[[]", ",[]", "]}"},
        {"arrays of one number", "{\"bodies\":[[0]", ",[0]", "]}"},
        {"arrays of strings", "{\"bodies\":[\"\"", ",\"\"", "]}"},
        {"a long string", "{\"name\":\"", "x", "\"}"},
        {"a long string of escapes", "{\"name\":\"", "\\u00e4", "\"}"},
        {"the same member", "{\"a\":0", ",\"a\":0", "}"},
        {"one deep nest", "", "[", ""},
        {"nested objects", "", "{\"a\":", ""},
        {"blanks", "", " ", "{}"},
        {"null", "[null", ",null", "]"},
    };
    skip_without_malloc();
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        struct document d;
        begin(&d);
        fputs(row[i].before, d.file);
        fill(&d, row[i].piece, limits_default.body_bytes - strlen(row[i].after));
        fputs(row[i].after, d.file);
        check_job(&d, row[i].name);
    }
}

/* A square grid with as many vertices and triangles as there may be, all digits printed; no brace at its end.
 */
static void write_grid(struct document *d)
{
    size_t n = 447;
    assert_true(n * n <= limits_default.vertices && 2 * (n - 1) * (n - 1) <= limits_default.triangles);
    fputs("{\"positions\":[", d->file);
    for (size_t i = 0; i < n * n; i++)
        fprintf(d->file, "%s%.17g,%.17g,0", i ? "," : "", (double)(i / n) / 3000, (double)(i % n) / 3000);
    fputs("],\"triangles\":[", d->file);
    for (size_t i = 0; i < (n - 1) * (n - 1); i++) {
        size_t a = i / (n - 1) * n + i % (n - 1), b = a + n;
        fprintf(d->file, "%s%zu,%zu,%zu,%zu,%zu,%zu", i ? "," : "", a, b, a + 1, a + 1, b, b + 1);
    }
    fputs("],\"pattern\":[", d->file);
    for (size_t i = 0; i < n * n; i++)
        fprintf(d->file, "%s%.17g,%.17g", i ? "," : "", (double)(i / n) / 3000, (double)(i % n) / 3000);
    fputs("]", d->file);
}

/* At the limits of values and nodes, so that nothing is refused before it is built. */
static void test_memory__jobs_at_their_limits_hold_no_more_than_they_may(void **state)
{
    (void)state;
    skip_without_malloc();
    struct document d;
    begin(&d);
    fputs("{\"cloth\":{\"mesh\":{\"positions\":[0", d.file);
    repeat(&d, ",0", limits_default.json_values - 8);
    fputs("]}}}", d.file);
    check_job(&d, "as many numbers as there may be");

    begin(&d);
    fputs("{\"bodies\":[{}", d.file);
    repeat(&d, ",{}", 60000);
    fputs("]}", d.file);
    check_job(&d, "60 000 objects");

    begin(&d);
    fputs("{", d.file);
    for (int i = 0; i < 60000; i++)
        fprintf(d.file, "%s\"%x\":\"\"", i ? "," : "", i);
    fputs("}", d.file);
    check_job(&d, "60 000 members");

    begin(&d);
    fputs("{\"bodies\":[[0]", d.file);
    repeat(&d, ",[0]", 60000);
    fputs("]}", d.file);
    check_job(&d, "60 000 arrays of numbers");

    begin(&d); /* the largest cloth and the largest body */
    fputs("{\"cloth\":{\"mesh\":", d.file);
    write_grid(&d);
    fputs("},\"materials\":[{\"preset\":\"linen\"}]},\"bodies\":[{\"mesh\":", d.file);
    write_grid(&d);
    fputs("}}]}", d.file);
    check_job(&d, "the largest cloth on the largest body");
}

static void test_memory__hostile_meshes_hold_no_more_than_they_may(void **state)
{
    (void)state;
    static const struct {
        enum mesh_format format;
        const char *name, *before, *piece, *after;
    } row[] = {
        {MESH_OBJ, "obj: vertices", "", "v 0 0 0\n", "f 1 2 3\n"},
        {MESH_OBJ, "obj: pattern", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "vt 0 0\n", "f 1/1 2/2 3/3\n"},
        {MESH_OBJ, "obj: triangles", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "f 1 2 3\n", ""},
        {MESH_OBJ, "obj: one long face", "v 0 0 0\nf", " 1", "\n"},
        {MESH_OBJ, "obj: one long line", "", "#", "\n"},
        {MESH_OBJ, "obj: empty lines", "", "\n", ""},
        {MESH_PLY, "ply: a long header", "ply\nformat ascii 1.0\n", "comment\n", "end_header\n"},
        {MESH_PLY, "ply: elements", "ply\nformat ascii 1.0\n", "element a 1\nproperty char x\n",
         "end_header\n"},
        {MESH_JSON, "json: numbers", "{\"positions\":[0", ",0", "],\"triangles\":[0,1,2]}"},
        {MESH_JSON, "json: objects", "{\"positions\":[{}", ",{}", "],\"triangles\":[0,1,2]}"},
        {MESH_JSON, "json: a string", "{\"positions\":\"", "x", "\"}"},
    };
    skip_without_malloc();
    for (size_t i = 0; i < sizeof row / sizeof *row; i++)
        for (size_t bytes = MIB; bytes <= 16 * MIB; bytes *= 16) {
            struct document d;
            begin(&d);
            fputs(row[i].before, d.file);
            fill(&d, row[i].piece, bytes);
            fputs(row[i].after, d.file);
            check_mesh(&d, row[i].format, row[i].name);
        }
}

/* The densest there are: everything at the limits, in as few bytes as the format takes. */
static void test_memory__dense_meshes_hold_no_more_than_they_may(void **state)
{
    (void)state;
    size_t vertices = limits_default.vertices, triangles = limits_default.triangles;
    skip_without_malloc();
    struct document d;
    begin(&d);
    fprintf(d.file,
            "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty float x\nproperty float y\n"
            "property float z\nproperty float s\nproperty float t\nelement face %zu\n"
            "property list uchar uchar vertex_indices\nend_header\n",
            vertices, triangles / 253);
    for (size_t i = 0; i < 20 * vertices; i++)
        fputc(0, d.file);
    for (size_t i = 0; i < triangles / 253; i++) {
        fputc(255, d.file);
        for (int k = 0; k < 255; k++)
            fputc(k, d.file);
    }
    check_mesh(&d, MESH_PLY, "ply: everything");

    begin(&d);
    repeat(&d, "v 0 0 0\n", vertices);
    repeat(&d, "vt 0 0\n", 3 * triangles);
    repeat(&d, "f 1/1 2/2 3/3 4/4 5/5 6/6 7/7 8/8 9/9\n", triangles / 7);
    check_mesh(&d, MESH_OBJ, "obj: everything");

    begin(&d);
    fputs("{\"positions\":[0", d.file);
    repeat(&d, ",0", 3 * vertices - 1);
    fputs("],\"triangles\":[0,1,2", d.file);
    repeat(&d, ",0,1,2", triangles - 1);
    fputs("],\"pattern\":[0", d.file);
    repeat(&d, ",0", 2 * vertices - 1);
    fputs("]}", d.file);
    check_mesh(&d, MESH_JSON, "json: everything");
}

static void put_u32(FILE *file, size_t value)
{
    for (int i = 0; i < 4; i++)
        fputc((int)(value >> 8 * i & 0xFF), file);
}

/* A GLB of the document and `bin_bytes` of zeros. */
static void make_glb(struct document *json, size_t bin_bytes, struct document *d)
{
    while (ftello(json->file) % 4 != 0)
        fputc(' ', json->file);
    fclose(json->file);
    begin(d);
    fputs("glTF", d->file);
    put_u32(d->file, 2);
    put_u32(d->file, 12 + 8 + json->bytes + 8 + bin_bytes);
    put_u32(d->file, json->bytes);
    fputs("JSON", d->file);
    fwrite(json->text, 1, json->bytes, d->file);
    put_u32(d->file, bin_bytes);
    fwrite("BIN", 1, 4, d->file);
    for (size_t i = 0; i < bin_bytes; i++)
        fputc(0, d->file);
    free(json->text);
}

static void test_memory__hostile_scenes_hold_no_more_than_they_may(void **state)
{
    (void)state;
    static const struct {
        const char *name, *before, *piece, *after;
        size_t times;
    } row[] = {
        {"glb: one mesh many times",
         "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":12000}],"
         "\"bufferViews\":[{\"buffer\":0,\"byteLength\":12000}],"
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":780,\"type\":\"VEC3\"}],"
         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],\"nodes\":[{\"mesh\":0}",
         ",{\"mesh\":0}", "]}", 255},
        {"glb: nodes", "{\"nodes\":[{}", ",{}", "]}", 60000},
        {"glb: children", "{\"nodes\":[{\"children\":[0", ",0", "]}]}", 1000000},
        {"glb: primitives", "{\"meshes\":[{\"primitives\":[{}", ",{}", "]}]}", 60000},
        {"glb: numbers nobody asks for", "{\"extras\":[0", ",0", "]}", 4000000},
    };
    skip_without_malloc();
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        struct document json, d;
        begin(&json);
        fputs(row[i].before, json.file);
        repeat(&json, row[i].piece, row[i].times);
        fputs(row[i].after, json.file);
        make_glb(&json, 12000, &d);
        check_mesh(&d, MESH_GLB, row[i].name);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_memory__job_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__keys_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__obj_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__ply_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__json_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__report_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__progress_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__preview_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__materials_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__hostile_jobs_hold_no_more_than_they_may),
        cmocka_unit_test(test_memory__jobs_at_their_limits_hold_no_more_than_they_may),
        cmocka_unit_test(test_memory__hostile_meshes_hold_no_more_than_they_may),
        cmocka_unit_test(test_memory__dense_meshes_hold_no_more_than_they_may),
        cmocka_unit_test(test_memory__hostile_scenes_hold_no_more_than_they_may),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
