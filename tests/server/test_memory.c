/* test_memory.c - every allocation of the parsers made to fail in turn: an error each time, no crash, and
 * nothing left behind.
 *
 * malloc and its kin are replaced in this program alone. Sanitizers and Valgrind replace them too: there
 * the tests are skipped. */
#include "test.h"

#include <stdbool.h>

#include "schema.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define REPLACED 0
#else
#define REPLACED 1
#endif

/* volatile: a compiler knows malloc, and knows that it does not look at these */
static volatile bool armed;
static volatile long countdown; /* allocations until the one that fails, and all after it */
static volatile long live;      /* blocks allocated and not freed while armed */

#if REPLACED
void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *old, size_t size);
void __libc_free(void *block);

static bool fails(void)
{
    return armed && --countdown < 0;
}

static void *count_block(void *block)
{
    live += armed && block;
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
    return old ? __libc_realloc(old, size) : count_block(__libc_malloc(size));
}

void free(void *block)
{
    live -= armed && block;
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
        /* jansson calls a token that it has no room for a syntax error, and nobody can tell */
        if (rc != 0 && problem.code != PROBLEM_INTERNAL && problem.code != PROBLEM_BAD_JSON)
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
SWEEP(obj)
SWEEP(ply)
SWEEP(json)
SWEEP(report)
SWEEP(progress)
SWEEP(materials)

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_memory__job_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__obj_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__ply_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__json_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__report_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__progress_gives_an_error_for_each_allocation),
        cmocka_unit_test(test_memory__materials_gives_an_error_for_each_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
