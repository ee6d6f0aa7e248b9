/* test_schema.c - job documents: what is read, what is refused and where, and reports as JSON. */
#include "test.h"

#include "materials.h"
#include "schema.h"

/* A square of two triangles, held at one side, over a ball. */
static const char BASE[] =
    "{\"cloth\": {\"mesh\": {\"positions\": [0,1,0, 1,1,0, 0,1,1, 1,1,1], \"triangles\": [0,2,1, 1,2,3],"
    "             \"pattern\": [0,0, 1,0, 0,1, 1,1]},"
    "            \"pins\": [0, 1], \"materials\": [{\"preset\": \"denim\"}]},"
    " \"bodies\": [{\"sphere\": {\"center\": [0,0,0], \"radius\": 0.5}}]}";

#define SHA "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef"

/* ---- helpers ----------------------------------------------------------------------------------- */

static int load_square(const char *sha256, struct mesh *ret, struct problem *reterr, void *data)
{
    static const char WITH[] = "v 0 1 0\nv 1 1 0\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 3/3 2/2\n";
    static const char WITHOUT[] = "v 0 1 0\nv 1 1 0\nv 0 1 1\nf 1 3 2\n";
    const char *text = data ? data : sha256[0] == '0' ? WITH : WITHOUT;
    if (sha256[0] == 'f')
        return problem_set(reterr, PROBLEM_NOT_FOUND, "no such mesh");
    return meshfile_parse(MESH_OBJ, text, strlen(text), &limits_default, ret, reterr);
}

static struct job_spec *parse(const char *text, const struct limits *limits, struct problem *reterr)
{
    struct job_spec *spec = NULL;
    memset(reterr, 0, sizeof *reterr);
    int rc = schema_job_parse(text, strlen(text), limits, load_square, NULL, &spec, reterr);
    assert_int_equal(rc, spec ? 0 : -1);
    return spec;
}

/* The value at a pointer of the document, made when it is missing in an object. */
static void set_value(json_t *root, const char *pointer, const char *value)
{
    char path[128], *name = path + 1, *next;
    json_t *at = root, *parsed = json_loads(value, JSON_DECODE_ANY, NULL);
    assert_non_null(parsed);
    snprintf(path, sizeof path, "%s", pointer);
    while ((next = strchr(name, '/'))) {
        *next = '\0';
        json_t *child =
            json_is_array(at) ? json_array_get(at, (size_t)atoi(name)) : json_object_get(at, name);
        if (!child) {
            json_object_set_new(at, name, json_object());
            child = json_object_get(at, name);
        }
        at = child;
        name = next + 1;
    }
    if (json_is_array(at))
        assert_int_equal(json_array_set_new(at, (size_t)atoi(name), parsed), 0);
    else
        assert_int_equal(json_object_set_new(at, name, parsed), 0);
}

/* BASE with `value` at `pointer`; to be freed. */
static char *with(const char *pointer, const char *value)
{
    json_t *root = json_loads(BASE, 0, NULL);
    assert_non_null(root);
    if (pointer)
        set_value(root, pointer, value);
    char *text = json_dumps(root, 0);
    json_decref(root);
    return text;
}

static struct job_spec *parse_with(const char *pointer, const char *value)
{
    struct problem problem;
    char *text = with(pointer, value);
    struct job_spec *spec = parse(text, &limits_default, &problem);
    if (!spec)
        print_error("%s = %s: %s\n", pointer, value, problem.detail);
    assert_non_null(spec);
    free(text);
    return spec;
}

static void expect_text(const char *text, const struct limits *limits, enum problem_code code, const char *at)
{
    struct problem problem;
    struct job_spec *spec = parse(text, limits, &problem);
    if (spec || problem.code != code || strcmp(problem.errors[0].pointer, at) != 0)
        print_error("%.200s\n  gave %s at '%s' (%s) instead of %s at '%s'\n", text,
                    problem_name(problem.code), problem.errors[0].pointer, problem.detail, problem_name(code),
                    at);
    assert_null(spec);
    assert_int_equal(problem.code, code);
    assert_string_equal(problem.errors[0].pointer, at);
}

struct refusal {
    const char *pointer, *value, *at; /* at NULL: at the pointer itself */
};

static void expect_refusals(const struct refusal *refusal, size_t n, enum problem_code code)
{
    for (size_t i = 0; i < n; i++) {
        char *text = with(refusal[i].pointer, refusal[i].value);
        expect_text(text, &limits_default, code, refusal[i].at ? refusal[i].at : refusal[i].pointer);
        free(text);
    }
}

#define COUNT(array) (sizeof(array) / sizeof *(array))

/* ---- what is read ------------------------------------------------------------------------------ */

static void test_schema__least_job_takes_the_solver_defaults(void **state)
{
    (void)state;
    struct job_spec *spec = parse_with(NULL, NULL);
    drape_options options = drape_options_default();
    drape_scene_desc scene = drape_scene_desc_default();
    assert_int_equal(spec->scene.vertices, 4);
    assert_int_equal(spec->scene.triangles, 2);
    assert_int_equal(spec->scene.triangle[4], 2);
    assert_int_equal(spec->scene.pins, 2);
    assert_int_equal(spec->scene.seams, 0);
    assert_null(spec->scene.triangle_material);
    assert_close(spec->scene.positions[11], 1, 0);
    assert_close(spec->scene.pattern[7], 1, 0);
    assert_memory_equal(spec->scene.gravity, scene.gravity, sizeof scene.gravity);
    assert_int_equal(spec->options.method, options.method);
    assert_int_equal(spec->options.stop_on, options.stop_on);
    assert_int_equal(spec->options.max_iterations, options.max_iterations);
    assert_close(spec->options.time_step, options.time_step, 0);
    assert_close(spec->options.tolerance, options.tolerance, 0);
    assert_close(spec->options.time_limit, options.time_limit, 0);
    assert_close(spec->body[0].offset, DRAPE_DEFAULT_OFFSET, 0);
    assert_string_equal(spec->name, "");
    assert_null(spec->labels);
    job_spec_free(spec);
}

static void test_schema__solver_options_are_read(void **state)
{
    (void)state;
    struct job_spec *spec =
        parse_with("/solver", "{\"method\": \"dynamic\", \"stop_on\": \"kinetic\", \"time_step\": 0.01,"
                              " \"tolerance\": 1e-4, \"max_iterations\": 0, \"time_limit_s\": 7.5,"
                              " \"integrator\": \"backward-euler\", \"certify\": true,"
                              " \"damping\": {\"air\": 0, \"material\": 0.0}}");
    assert_int_equal(spec->options.method, DRAPE_METHOD_DYNAMIC);
    assert_int_equal(spec->options.stop_on, DRAPE_STOP_ON_KINETIC);
    assert_close(spec->options.time_step, 0.01, 0);
    assert_close(spec->options.tolerance, 1e-4, 0);
    assert_int_equal(spec->options.max_iterations, 0);
    assert_close(spec->options.time_limit, 7.5, 0);
    assert_true(spec->options.certify);
    assert_int_equal(spec->scene.coarse, DRAPE_COARSE_AUTO);
    job_spec_free(spec);

    spec = parse_with("/solver", "{\"coarse\": \"on\"}");
    assert_int_equal(spec->scene.coarse, DRAPE_COARSE_ON);
    job_spec_free(spec);
    spec = parse_with("/solver", "{\"coarse\": \"off\"}");
    assert_int_equal(spec->scene.coarse, DRAPE_COARSE_OFF);
    job_spec_free(spec);

    spec = parse_with("/solver", "{\"method\": \"velocity-correction\", \"damping\": {\"air\": 1}}");
    assert_int_equal(spec->options.method, DRAPE_METHOD_VELOCITY_CORRECTION);
    assert_close(spec->options.air_damping, 1, 0);
    job_spec_free(spec);
    spec = parse_with("/solver", "{\"method\": \"velocity-correction\", \"integrator\": \"bdf2\"}");
    assert_int_equal(spec->options.integrator, DRAPE_BDF2);
    job_spec_free(spec);
}

static void test_schema__the_fit_is_measured_where_asked_for(void **state)
{
    (void)state;
    static const char *const ANSWER[] = {"true", "false"};
    for (int i = 0; i < 2; i++) {
        struct job_spec *spec = parse_with("/fit", ANSWER[i]);
        assert_int_equal(spec->options.fit, i == 0);
        job_spec_free(spec);
    }
    assert_false(drape_options_default().fit);
}

static void test_schema__bodies_of_every_kind_are_read(void **state)
{
    (void)state;
    struct job_spec *spec = parse_with(
        "/bodies", "[{\"sphere\": {\"center\": [1,2,3], \"radius\": 4}, \"offset\": 0.01, \"friction\": 10},"
                   " {\"plane\": {\"point\": [0,-9,0], \"normal\": [0,2,0]}},"
                   " {\"capsule\": {\"a\": [0,-5,0], \"b\": [1,-5,0], \"radius\": 0.25}},"
                   " {\"mesh\": {\"positions\": [0,-7,0, 1,-7,0, 0,-7,1, 0,-6,0],"
                   "             \"triangles\": [0,1,2, 0,3,1, 1,3,2, 0,2,3]}}]");
    const drape_body *body = spec->scene.body;
    assert_int_equal(spec->scene.bodies, 4);
    assert_int_equal(body[0].kind, DRAPE_BODY_SPHERE);
    assert_close(body[0].point[2], 3, 0);
    assert_close(body[0].radius, 4, 0);
    assert_close(body[0].friction, 10, 0);
    assert_close(body[1].friction, 0, 0);
    assert_close(body[0].offset, 0.01, 0);
    assert_int_equal(body[1].kind, DRAPE_BODY_PLANE);
    assert_close(body[1].point[1], -9, 0);
    assert_close(body[1].axis[1], 2, 0);
    assert_int_equal(body[2].kind, DRAPE_BODY_CAPSULE);
    assert_close(body[2].axis[0], 1, 0);
    assert_close(body[2].radius, 0.25, 0);
    assert_int_equal(body[3].kind, DRAPE_BODY_MESH);
    assert_int_equal(body[3].vertices, 4);
    assert_int_equal(body[3].triangles, 4);
    assert_int_equal(body[3].triangle[10], 2);
    assert_close(body[3].positions[10], -6, 0);
    job_spec_free(spec);
}

static void test_schema__explicit_material_fills_the_isotropic_shear_and_twist(void **state)
{
    (void)state;
    struct job_spec *spec =
        parse_with("/cloth/materials/0", "{\"density\": 0.2, \"poisson\": 0.25, \"bend\": 4e-6,"
                                         " \"stretch\": {\"weft\": 100, \"warp\": 300}}");
    const drape_material *m = spec->material;
    assert_close(m->density, 0.2, 0);
    assert_close(m->poisson, 0.25, 0);
    assert_close(m->stretch_weft, 100, 0);
    assert_close(m->stretch_warp, 300, 0);
    assert_close(m->stretch_shear, 80, 1e-15); /* mean 200 / (2 (1 + 0.25)) */
    assert_close(m->bend_weft, 4e-6, 0);
    assert_close(m->bend_warp, 4e-6, 0);
    assert_close(m->bend_twist, 2e-6, 1e-15);
    job_spec_free(spec);
}

static void test_schema__strain_stress_curves_are_read(void **state)
{
    (void)state;
    struct job_spec *spec = parse_with(
        "/cloth/materials/0",
        "{\"density\": 0.2, \"bend\": 4e-6, \"stretch\": {\"weft\": [[0, 0], [0.05, 10], [0.1, 40]],"
        " \"warp\": 300, \"shear\": [[0.2, 5]]}}");
    const drape_material *m = spec->scene.material;
    const double weft[] = {0, 0, 0.05, 10, 0.1, 40}, shear[] = {0.2, 5};
    assert_int_equal(m->curve_weft.points, 3);
    assert_memory_equal(m->curve_weft.point, weft, sizeof weft);
    assert_int_equal(m->curve_warp.points, 0);
    assert_close(m->stretch_warp, 300, 0);
    assert_int_equal(m->curve_shear.points, 1);
    assert_memory_equal(m->curve_shear.point, shear, sizeof shear);
    job_spec_free(spec);

    /* Shear not given: the isotropic one of the first slopes, 200 and 300. */
    spec = parse_with("/cloth/materials/0", "{\"density\": 0.2, \"bend\": 4e-6, \"stretch\":"
                                            " {\"weft\": [[0, 0], [0.05, 10], [0.1, 40]], \"warp\": 300}}");
    assert_close(spec->material->stretch_shear, 125, 1e-15);
    job_spec_free(spec);

    /* Beside a preset a curve replaces one number; the preset's Poisson ratio has to go. */
    spec = parse_with("/cloth/materials/0",
                      "{\"preset\": \"denim\", \"poisson\": 0, \"stretch\": {\"warp\": [[0.1, 400]]}}");
    assert_close(spec->material->stretch_weft, materials_find("denim")->material.stretch_weft, 0);
    assert_int_equal(spec->material->curve_warp.points, 1);
    job_spec_free(spec);
}

/* A curve of n points as JSON; to be freed. */
static char *curve_text(int n)
{
    json_t *array = json_array();
    for (int i = 1; i <= n; i++)
        json_array_append_new(array, json_pack("[ff]", 0.01 * i, 5.0 * i));
    char *text = json_dumps(array, 0);
    json_decref(array);
    return text;
}

static void test_schema__curves_have_a_limit_of_points(void **state)
{
    (void)state;
    for (int past = 0; past <= 1; past++) {
        char value[8192], *curve = curve_text(DRAPE_MAX_CURVE_POINTS + past);
        snprintf(value, sizeof value,
                 "{\"density\": 0.2, \"bend\": 0, \"stretch\": {\"weft\": 1, \"warp\": %s}}", curve);
        if (past) {
            char *text = with("/cloth/materials/0", value);
            expect_text(text, &limits_default, PROBLEM_TOO_LARGE, "/cloth/materials/0/stretch/warp");
            free(text);
        } else {
            struct job_spec *spec = parse_with("/cloth/materials/0", value);
            assert_int_equal(spec->material->curve_warp.points, DRAPE_MAX_CURVE_POINTS);
            job_spec_free(spec);
        }
        free(curve);
    }
}

static void test_schema__wrong_curves_are_refused_at_their_place(void **state)
{
    (void)state;
    static const struct refusal REFUSAL[] = {
        {"/cloth/materials/0/stretch/weft", "[]", NULL},
        {"/cloth/materials/0/stretch/weft", "[0.1, 5, 0.2, 20]", "/cloth/materials/0/stretch/weft/0"},
        {"/cloth/materials/0/stretch/weft", "[[0.1, 5], 7]", "/cloth/materials/0/stretch/weft/1"},
        {"/cloth/materials/0/stretch/weft", "[[0.1, 5], [0.2]]", "/cloth/materials/0/stretch/weft/1"},
        {"/cloth/materials/0/stretch/weft", "[[0.1, 5], [0.2, 6, 7]]", "/cloth/materials/0/stretch/weft/1"},
        {"/cloth/materials/0/stretch/weft", "[[0.1, 5], [0.2, \"6\"]]",
         "/cloth/materials/0/stretch/weft/1/1"},
        {"/cloth/materials/0/stretch/weft", "[[0.1, 5], []]", "/cloth/materials/0/stretch/weft/1"},
        {"/cloth/materials/0/stretch/weft", "[[0.1, 5], [0.2, 4]]", NULL},
        {"/cloth/materials/0/stretch/warp", "[[0.1, 5], [0.1, 6]]", NULL},
        {"/cloth/materials/0/stretch/shear", "[[0, 0]]", NULL},
        {"/cloth/materials/0/stretch/shear", "[[0, 1], [0.1, 5]]", NULL},
        {"/cloth/materials/0/stretch/shear", "[[-0.1, 1]]", NULL},
        {"/cloth/materials/0/stretch/weft", "[[0.1, 5], [0.2, 20]]", "/cloth/materials/0/poisson"},
    };
    expect_refusals(REFUSAL, COUNT(REFUSAL), PROBLEM_INVALID);
}

static void test_schema__members_beside_a_preset_replace_its_own(void **state)
{
    (void)state;
    const drape_material *denim = &materials_find("denim")->material;
    struct job_spec *spec =
        parse_with("/cloth/materials/0", "{\"preset\": \"denim\", \"stretch\": {\"warp\": 77},"
                                         " \"bend\": {\"weft\": 8e-6}}");
    assert_close(spec->material->density, denim->density, 0);
    assert_close(spec->material->stretch_weft, denim->stretch_weft, 0);
    assert_close(spec->material->stretch_warp, 77, 0);
    assert_close(spec->material->stretch_shear, denim->stretch_shear, 0);
    assert_close(spec->material->bend_weft, 8e-6, 0);
    assert_close(spec->material->bend_warp, denim->bend_warp, 0);
    assert_close(spec->material->bend_twist, denim->bend_twist, 0);
    job_spec_free(spec);

    spec = parse_with("/cloth/materials/0", "{\"preset\": \"denim\", \"bend\": 8e-6}");
    assert_close(spec->material->bend_warp, 8e-6, 0);
    assert_close(spec->material->bend_twist, 4e-6, 1e-15);
    job_spec_free(spec);
}

static void test_schema__seams_labels_and_materials_by_triangle_are_read(void **state)
{
    (void)state;
    struct problem problem;
    const char *text =
        "{\"name\": \"gr\\u00f6\\u00dfe\", \"labels\": {\"order\": \"4711\"}, \"gravity\": [0, 0, -3],"
        " \"self_contact\": \"off\", \"cloth\": {\"mesh\": {\"positions\": [0,1,0, 1,1,0, 0,1,1, 1,1,0, "
        "0,1,1, 1,1,1],"
        " \"triangles\": [0,2,1, 3,4,5], \"pattern\": [0,0, 1,0, 0,1, 1,0, 0,1, 1,1]}, \"seams\": [1,3, 2,4],"
        " \"pins\": [0], \"materials\": [{\"preset\": \"linen\"}, {\"preset\": \"denim\"}],"
        " \"triangle_material\": [1, 0], \"thickness\": 0.0005}}";
    struct job_spec *spec = parse(text, &limits_default, &problem);
    if (!spec)
        fail_msg("%s", problem.detail);
    assert_string_equal(spec->name, "gr\xc3\xb6\xc3\x9f"
                                    "e");
    assert_string_equal(json_string_value(json_object_get(spec->labels, "order")), "4711");
    assert_int_equal(spec->scene.seams, 2);
    assert_int_equal(spec->scene.seam[3], 4);
    assert_int_equal(spec->scene.materials, 2);
    assert_int_equal(spec->scene.triangle_material[0], 1);
    assert_close(spec->scene.gravity[2], -3, 0);
    assert_close(spec->scene.thickness, 0.0005, 0);
    assert_int_equal(spec->scene.self_contact, DRAPE_SELF_CONTACT_OFF);
    job_spec_free(spec);
}

static void test_schema__priority_is_normal_unless_it_is_given(void **state)
{
    (void)state;
    static const char *const given[] = {"\"low\"", "\"normal\"", "\"high\""};
    for (int i = 0; i < 3; i++) {
        struct job_spec *spec = parse_with("/priority", given[i]);
        assert_int_equal(spec->priority, i - 1);
        job_spec_free(spec);
    }
    struct job_spec *spec = parse_with("/name", "\"none\"");
    assert_int_equal(spec->priority, 0);
    job_spec_free(spec);
}

static void test_schema__self_contact_is_passed_on_but_not_to_plain_newton(void **state)
{
    (void)state;
    char *text = with("/self_contact", "\"on\""), *newton;
    json_t *root = json_loads(text, 0, NULL);
    struct job_spec *spec = parse_with("/self_contact", "\"on\"");
    assert_int_equal(spec->scene.self_contact, DRAPE_SELF_CONTACT_ON);
    assert_close(spec->scene.thickness, DRAPE_DEFAULT_THICKNESS, 0);
    job_spec_free(spec);
    spec = parse_with("/self_contact", "\"auto\"");
    assert_int_equal(spec->scene.self_contact, DRAPE_SELF_CONTACT_AUTO);
    job_spec_free(spec);
    set_value(root, "/solver/method", "\"newton\"");
    newton = json_dumps(root, 0);
    expect_text(newton, &limits_default, PROBLEM_INVALID, "/self_contact");
    json_decref(root);
    free(newton);
    free(text);
    spec = parse_with("/solver/method", "\"newton\""); /* with auto it is fine */
    job_spec_free(spec);
}

static void test_schema__what_intersects_is_counted_and_placed(void **state)
{
    (void)state;
    drape_report report = {
        .reason = "", .self_intersections = DRAPE_NOT_COUNTED, .intersection = {NAN, NAN, NAN}};
    json_t *json = schema_report_json(&report, NULL);
    assert_true(json_is_null(json_object_get(json, "self_intersections")));
    assert_true(json_is_null(json_object_get(json, "intersection")));
    json_decref(json);
    report.self_intersections = 3;
    memcpy(report.intersection, (double[3]){0.5, 1, -2}, sizeof report.intersection);
    json = schema_report_json(&report, NULL);
    assert_int_equal(json_integer_value(json_object_get(json, "self_intersections")), 3);
    assert_close(json_number_value(json_array_get(json_object_get(json, "intersection"), 2)), -2, 0);
    json_decref(json);
}

static void test_schema__lines_are_read_and_told_with_their_lengths(void **state)
{
    (void)state;
    struct job_spec *spec =
        parse_with("/lines", "[{\"name\": \"hem\", \"vertices\": [0, 3]},"
                             " {\"name\": \"round\", \"vertices\": [0, 1, 3, 2], \"closed\": true}]");
    assert_int_equal(spec->lines->count, 2);
    assert_string_equal(spec->lines->line[0].name, "hem");
    assert_false(spec->lines->line[0].closed);
    assert_int_equal(spec->lines->line[0].segments, 1);
    assert_int_equal(spec->lines->line[1].segments, 4);
    assert_int_equal(spec->lines->line[1].vertex[2], 3);
    const struct line_length length[2] = {{2, 2.5}, {0, 0}};
    json_t *json = schema_lines_json(spec->lines, length), *hem = json_array_get(json, 0);
    assert_string_equal(json_string_value(json_object_get(hem, "name")), "hem");
    assert_close(json_number_value(json_object_get(hem, "rest")), 2, 0);
    assert_close(json_number_value(json_object_get(hem, "elongation")), 0.25, 1e-15);
    assert_true(json_is_null(json_object_get(json_array_get(json, 1), "elongation")));
    assert_true(json_is_true(json_object_get(json_array_get(json, 1), "closed")));
    json_decref(json);
    job_spec_free(spec);
}

static void test_schema__lines_across_pieces_need_a_seam(void **state)
{
    (void)state;
    static const char JOB[] =
        "{\"cloth\": {\"mesh\": {\"positions\": [0,1,0, 1,1,0, 0,1,1, 1,1,0, 0,1,1, 1,1,1],"
        " \"triangles\": [0,2,1, 3,4,5], \"pattern\": [0,0, 1,0, 0,1, 1,0, 0,1, 1,1]}, \"pins\": [0, 5],"
        " \"materials\": [{\"preset\": \"linen\"}]%s}, \"lines\": [{\"name\": \"a\", \"vertices\": [2, 0, "
        "5]}]}";
    char text[sizeof JOB + 40];
    struct problem problem;
    snprintf(text, sizeof text, JOB, "");
    expect_text(text, &limits_default, PROBLEM_INVALID, "/lines/0/vertices/1");
    snprintf(text, sizeof text, JOB, ", \"seams\": [1,3, 2,4]");
    expect_text(text, &limits_default, PROBLEM_INVALID, "/lines/0/vertices/1"); /* 0 and 5 are no seam's */
    char *at = strstr(text, "[2, 0, 5]");
    memcpy(at, "[0, 2, 5]", 9); /* 4, to which 2 is sewn, is of the piece of 5 */
    struct job_spec *spec = parse(text, &limits_default, &problem);
    assert_non_null(spec);
    assert_int_equal(spec->lines->line[0].ends[2], 4);
    job_spec_free(spec);
}

static void test_schema__elastics_folds_and_tacks_are_read(void **state)
{
    (void)state;
    struct job_spec *spec = parse_with("/cloth/elastics", "[{\"edges\": [], \"factor\": 1, \"stiffness\": 1},"
                                                          " {\"edges\": [1,3, 3,2], \"factor\": 0.7, "
                                                          "\"stiffness\": 30}]");
    const drape_scene_desc *scene = &spec->scene;
    assert_int_equal(scene->elastics, 2);
    assert_int_equal(scene->elastic[0].edges, 0);
    assert_int_equal(scene->elastic[1].edges, 2);
    assert_int_equal(scene->elastic[1].edge[2], 3);
    assert_close(scene->elastic[1].factor, 0.7, 0);
    assert_close(scene->elastic[1].stiffness, 30, 0);
    job_spec_free(spec);

    spec = parse_with("/cloth/folds", "[{\"edges\": [1,2], \"angle\": -180, \"stiffness\": 1e-3}]");
    scene = &spec->scene;
    assert_int_equal(scene->folds, 1);
    assert_int_equal(scene->fold->edge[1], 2);
    assert_close(scene->fold->angle, -M_PI, 0);
    assert_close(scene->fold->stiffness, 1e-3, 0);
    job_spec_free(spec);

    spec = parse_with("/cloth/tacks", "[{\"vertex\": 3, \"body\": 0, \"point\": [1, 2, 3]}]");
    scene = &spec->scene;
    assert_int_equal(scene->tacks, 1);
    assert_int_equal(scene->tack->vertex, 3);
    assert_true(scene->tack->triangle == DRAPE_NO_TRIANGLE);
    assert_close(scene->tack->point[2], 3, 0);
    job_spec_free(spec);

    spec = parse_with("/cloth/materials/0/shrink", "{\"weft\": 0.05, \"warp\": -0.5}");
    assert_close(spec->material->shrink_weft, 0.05, 0);
    assert_close(spec->material->shrink_warp, -0.5, 0);
    job_spec_free(spec);
}

/* A tetrahedron in the place of the ball, tacked at one of its faces. */
static void test_schema__a_tack_names_a_triangle_of_a_body(void **state)
{
    (void)state;
    static const char BODY[] = "{\"mesh\": {\"positions\": [0,0,0, 1,0,0, 0,1,0, 0,0,1], \"triangles\": "
                               "[0,2,1, 0,1,3, 0,3,2, 1,2,3]}}";
    static const struct refusal REFUSAL[] = {
        {"/cloth/tacks/0/triangle", "4", NULL},
        {"/cloth/tacks/0/triangle", "-1", NULL},
        {"/cloth/tacks/0/triangle", "1.5", NULL},
        {"/cloth/tacks/0/barycentric", "[0.6, 0.5]", NULL},
        {"/cloth/tacks/0/barycentric", "[0.6]", NULL},
        {"/cloth/tacks/0/barycentric", "7", NULL},
        {"/cloth/tacks/0/point", "[0,0,0]", "/cloth/tacks/0"},
    };
    json_t *root = json_loads(BASE, 0, NULL);
    struct problem problem;
    set_value(root, "/bodies/0", BODY);
    set_value(root, "/cloth/tacks",
              "[{\"vertex\": 3, \"body\": 0, \"triangle\": 3, \"barycentric\": [0.5, 0.25]}]");
    char *text = json_dumps(root, 0);
    struct job_spec *spec = parse(text, &limits_default, &problem);
    if (!spec)
        fail_msg("%s", problem.detail);
    assert_int_equal(spec->scene.tack->triangle, 3);
    assert_close(spec->scene.tack->barycentric[1], 0.25, 0);
    job_spec_free(spec);
    free(text);
    for (size_t i = 0; i < COUNT(REFUSAL); i++) {
        json_t *copy = json_deep_copy(root);
        set_value(copy, REFUSAL[i].pointer, REFUSAL[i].value);
        text = json_dumps(copy, 0);
        expect_text(text, &limits_default, PROBLEM_INVALID,
                    REFUSAL[i].at ? REFUSAL[i].at : REFUSAL[i].pointer);
        free(text);
        json_decref(copy);
    }
    json_decref(root);
}

static void test_schema__wrong_lines_are_refused_at_their_place(void **state)
{
    (void)state;
#define ELASTIC "\"factor\": 0.7, \"stiffness\": 30"
    static const struct refusal REFUSAL[] = {
        {"/cloth/elastics", "{}", NULL},
        {"/cloth/elastics", "[7]", "/cloth/elastics/0"},
        {"/cloth/elastics", "[{" ELASTIC "}]", "/cloth/elastics/0/edges"},
        {"/cloth/elastics", "[{\"edges\": [1], " ELASTIC "}]", "/cloth/elastics/0/edges"},
        {"/cloth/elastics", "[{\"edges\": [1,2, 3,4], " ELASTIC "}]", "/cloth/elastics/0/edges/3"},
        {"/cloth/elastics", "[{\"edges\": [1,2, 0,3], " ELASTIC "}]", "/cloth/elastics/0/edges/2"},
        {"/cloth/elastics", "[{\"edges\": [1,2], \"stiffness\": 30}]", "/cloth/elastics/0/factor"},
        {"/cloth/elastics", "[{\"edges\": [1,2], \"factor\": 0.7}]", "/cloth/elastics/0/stiffness"},
        {"/cloth/elastics", "[{\"edges\": [1,2], \"factor\": 0.09, \"stiffness\": 30}]",
         "/cloth/elastics/0/factor"},
        {"/cloth/elastics", "[{\"edges\": [1,2], \"factor\": 2.01, \"stiffness\": 30}]",
         "/cloth/elastics/0/factor"},
        {"/cloth/elastics", "[{\"edges\": [1,2], \"factor\": 1, \"stiffness\": 0}]",
         "/cloth/elastics/0/stiffness"},
        {"/cloth/elastics", "[{\"edges\": [1,2], \"width\": 1, " ELASTIC "}]", "/cloth/elastics/0/width"},
        {"/cloth/folds", "7", NULL},
        {"/cloth/folds", "[{\"edges\": [1,2], \"stiffness\": 1}]", "/cloth/folds/0/angle"},
        {"/cloth/folds", "[{\"edges\": [1,2], \"angle\": 180.1, \"stiffness\": 1}]", "/cloth/folds/0/angle"},
        {"/cloth/folds", "[{\"edges\": [1,2], \"angle\": -181, \"stiffness\": 1}]", "/cloth/folds/0/angle"},
        {"/cloth/folds", "[{\"edges\": [1,2], \"angle\": 90, \"stiffness\": 1e13}]",
         "/cloth/folds/0/stiffness"},
        {"/cloth/folds", "[{\"edges\": [1,2, 0,1], \"angle\": 90, \"stiffness\": 1}]",
         "/cloth/folds/0/edges/2"}, /* a border */
        {"/cloth/tacks", "{}", NULL},
        {"/cloth/tacks", "[{\"body\": 0, \"point\": [0,0,0]}]", "/cloth/tacks/0/vertex"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"point\": [0,0,0]}]", "/cloth/tacks/0/body"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"body\": 0}]", "/cloth/tacks/0"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"body\": 0, \"triangle\": 0}]", "/cloth/tacks/0/barycentric"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"body\": 0, \"point\": [0,0,0], \"barycentric\": [0,0]}]",
         "/cloth/tacks/0/barycentric"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"body\": 0, \"triangle\": 0, \"barycentric\": [0,0]}]",
         "/cloth/tacks/0/triangle"}, /* of a ball */
        {"/cloth/tacks", "[{\"vertex\": 4, \"body\": 0, \"point\": [0,0,0]}]", "/cloth/tacks/0/vertex"},
        {"/cloth/tacks", "[{\"vertex\": 0, \"body\": 0, \"point\": [0,0,0]}]", "/cloth/tacks/0/vertex"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"body\": 1, \"point\": [0,0,0]}]", "/cloth/tacks/0/body"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"body\": 0, \"point\": [0,0,1e7]}]", "/cloth/tacks/0/point"},
        {"/cloth/tacks", "[{\"vertex\": 2, \"body\": 0, \"point\": [0,0]}]", "/cloth/tacks/0/point"},
        {"/cloth/materials/0/shrink", "0.05", NULL},
        {"/cloth/materials/0/shrink/weft", "0.51", NULL},
        {"/cloth/materials/0/shrink/warp", "-0.51", NULL},
        {"/cloth/materials/0/shrink/bias", "0", NULL},
    };
    expect_refusals(REFUSAL, COUNT(REFUSAL), PROBLEM_INVALID);
}

/* An empty elastic is the least there is: as many as there may be, and one more. */
static void test_schema__there_are_so_many_elastics_and_folds(void **state)
{
    (void)state;
    static const char *const LINE[] = {"{\"edges\":[],\"factor\":1,\"stiffness\":1}",
                                       "{\"edges\":[],\"angle\":9,\"stiffness\":1}"};
    static const char *const POINTER[] = {"/cloth/elastics", "/cloth/folds"};
    for (int k = 0; k < 2; k++) {
        size_t bytes = strlen(LINE[k]) + 1;
        char *value = malloc((DRAPE_MAX_LINES + 1) * bytes + 2), *end = value;
        assert_non_null(value);
        for (size_t i = 0; i < DRAPE_MAX_LINES + 1; i++, end += bytes)
            sprintf(end, "%c%s", i ? ',' : '[', LINE[k]);
        strcpy(end, "]");
        char *text = with(POINTER[k], value);
        expect_text(text, &limits_default, PROBLEM_TOO_LARGE, POINTER[k]);
        free(text);
        strcpy(end - bytes, "]");
        struct job_spec *spec = parse_with(POINTER[k], value);
        assert_int_equal(k ? spec->scene.folds : spec->scene.elastics, DRAPE_MAX_LINES);
        job_spec_free(spec);
        free(value);
    }
}

static void test_schema__crossed_seams_are_warned_of_at_their_first_pair(void **state)
{
    (void)state;
    static const struct {
        const char *triangles, *seams, *pointer, *says;
    } cases[] = {
        {"0,1,2, 3,4,5", "1,3, 2,5", NULL, NULL},
        {"0,1,2, 3,4,5", "1,5, 2,3", "/cloth/seams/0", "seam 0: to seam 1 the sides are sewn in crossed"},
        {"0,1,2, 3,4,5", "0,0, 1,5, 2,3", "/cloth/seams/2", "seam 1: to seam 2"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[1024];
        struct problem problem;
        snprintf(text, sizeof text,
                 "{\"cloth\": {\"mesh\": {\"positions\": [0,0,0, 1,0,0, 0,1,0, 1.1,0,0, 1.1,1,0, 0.1,1,0],"
                 " \"triangles\": [%s], \"pattern\": [0,0, 1,0, 0,1, 1,0, 1,1, 0,1]}, \"seams\": [%s],"
                 " \"pins\": [0], \"materials\": [{\"preset\": \"linen\"}]}}",
                 cases[i].triangles, cases[i].seams);
        struct job_spec *spec = parse(text, &limits_default, &problem);
        if (!spec)
            fail_msg("%s", problem.detail);
        const json_t *warning = json_array_get(spec->warnings, 0);
        if (cases[i].pointer) {
            assert_int_equal(json_array_size(spec->warnings), 1);
            assert_string_equal(json_string_value(json_object_get(warning, "pointer")), cases[i].pointer);
            assert_non_null(strstr(json_string_value(json_object_get(warning, "detail")), cases[i].says));
        } else {
            assert_null(spec->warnings);
        }
        job_spec_free(spec);
    }
}

static void test_schema__uploaded_meshes_are_loaded_by_hash(void **state)
{
    (void)state;
    struct job_spec *spec = parse_with("/cloth/mesh", "{\"ref\": \"" SHA "\"}");
    assert_int_equal(spec->scene.vertices, 3);
    assert_close(spec->scene.pattern[2], 1, 0);
    job_spec_free(spec);
}

/* ---- what is refused --------------------------------------------------------------------------- */

static void test_schema__wrong_values_are_refused_at_their_place(void **state)
{
    (void)state;
    static const struct refusal REFUSAL[] = {
        {"/cloth", "7", NULL},
        {"/cloth/mesh", "[]", NULL},
        {"/cloth/mesh/positions", "[0,1,0, 1,1,0, 0,1,1, 1,1]", NULL},
        {"/cloth/mesh/positions", "[]", NULL},
        {"/cloth/mesh/positions", "\"0 1 0\"", NULL},
        {"/cloth/mesh/positions", "[0,1,0, 1,null,0, 0,1,1, 1,1,1]", "/cloth/mesh/positions/4"},
        {"/cloth/mesh/positions", "[[0,1,0], [1,1,0]]", "/cloth/mesh/positions/0"},
        {"/cloth/mesh/positions", "[0,1,0, 1,1,0, 0,1,1, 1,1,\"1\"]", "/cloth/mesh/positions/11"},
        {"/cloth/mesh/pattern", "[0,0, 1,0, 0,1]", NULL},
        {"/cloth/mesh/pattern", "[0,0, 1,0, 0,1, 1]", NULL},
        {"/cloth/mesh/pattern", "{}", NULL},
        {"/cloth/mesh/triangles", "[0,2,1, 1,2,4]", "/cloth/mesh/triangles/5"},
        {"/cloth/mesh/triangles", "[0,2,-1, 1,2,3]", "/cloth/mesh/triangles/2"},
        {"/cloth/mesh/triangles", "[0,2,1.5, 1,2,3]", "/cloth/mesh/triangles/2"},
        {"/cloth/mesh/triangles", "[0,2,1, 1,2]", NULL},
        {"/cloth/mesh/triangles", "[0,2,1, 1,2,true]", "/cloth/mesh/triangles/5"},
        {"/cloth/mesh/colour", "[]", NULL},
        {"/cloth/mesh", "{\"ref\": \"abc\"}", "/cloth/mesh/ref"},
        {"/cloth/mesh", "{\"ref\": 7}", "/cloth/mesh/ref"},
        {"/cloth/mesh", "{\"ref\": \"f" SHA "\"}", "/cloth/mesh/ref"},
        {"/cloth/mesh", "{\"ref\": \"" SHA "\", \"positions\": []}", "/cloth/mesh/positions"},
        {"/cloth/seams", "[0,1,2]", NULL},
        {"/cloth/seams", "[0,4]", "/cloth/seams/1"},
        {"/cloth/seams", "[0,\"1\"]", "/cloth/seams/1"},
        {"/cloth/seams", "{}", NULL},
        {"/cloth/pins", "[4]", "/cloth/pins/0"},
        {"/cloth/pins", "7", NULL},
        {"/cloth/materials", "[]", NULL},
        {"/cloth/materials", "{}", NULL},
        {"/cloth/materials/0", "\"denim\"", NULL},
        {"/cloth/materials/0/preset", "\"tweed\"", NULL},
        {"/cloth/materials/0/preset", "7", NULL},
        {"/cloth/materials/0/density", "0", NULL},
        {"/cloth/materials/0/density", "\"0.1\"", NULL},
        {"/cloth/materials/0/poisson", "1", NULL},
        {"/cloth/materials/0/stretch", "10", NULL},
        {"/cloth/materials/0/stretch/weft", "-1", NULL},
        {"/cloth/materials/0/stretch/shear", "0", NULL},
        {"/cloth/materials/0/stretch/bias", "0", NULL},
        {"/cloth/materials/0/bend", "-1e-6", NULL},
        {"/cloth/materials/0/bend", "\"stiff\"", NULL},
        {"/cloth/materials/0/bend/twist", "-1e-6", NULL},
        {"/cloth/materials/0", "{\"density\": 1}", "/cloth/materials/0/stretch/weft"},
        {"/cloth/materials/0", "{\"stretch\": {\"weft\": 1, \"warp\": 1}, \"bend\": 0}",
         "/cloth/materials/0/density"},
        {"/cloth/materials/0",
         "{\"density\": 1, \"stretch\": {\"weft\": 1, \"warp\": 1}, \"bend\": {\"warp\": 1}}",
         "/cloth/materials/0/bend/weft"},
        {"/cloth/triangle_material", "[0]", NULL},
        {"/cloth/triangle_material", "[0,1]", "/cloth/triangle_material/1"},
        {"/cloth/thickness", "-0.001", NULL},
        {"/cloth/thickness", "0", NULL},
        {"/cloth/thickness", "0.0501", NULL},
        {"/cloth/thickness", "\"2 mm\"", NULL},
        {"/bodies", "{}", NULL},
        {"/bodies/0", "7", NULL},
        {"/bodies/0", "{}", NULL},
        {"/bodies/0/plane", "{\"point\": [0,0,0], \"normal\": [0,1,0]}", "/bodies/0"},
        {"/bodies/0/sphere", "7", NULL},
        {"/bodies/0/sphere/center", "[0,0]", NULL},
        {"/bodies/0/sphere/center", "[0,0,null]", "/bodies/0/sphere/center/2"},
        {"/bodies/0/sphere/radius", "0", NULL},
        {"/bodies/0/sphere", "{\"center\": [0,0,0]}", "/bodies/0/sphere/radius"},
        {"/bodies/0", "{\"plane\": {\"point\": [0,0,0], \"normal\": [0,0,0]}}", "/bodies/0/plane/normal"},
        {"/bodies/0", "{\"plane\": {\"normal\": [0,1,0]}}", "/bodies/0/plane/point"},
        {"/bodies/0", "{\"capsule\": {\"a\": [0,0,0], \"radius\": 1}}", "/bodies/0/capsule/b"},
        {"/bodies/0/offset", "0", NULL},
        {"/bodies/0/friction", "-0.5", NULL},
        {"/bodies/0/friction", "\"0\"", NULL},
        {"/bodies/0/friction", "10.1", NULL},
        {"/cloth/materials/0/friction", "10.1", NULL},
        {"/gravity", "[0,-9.81]", NULL},
        {"/gravity", "-9.81", NULL},
        {"/self_contact", "\"maybe\"", NULL},
        {"/self_contact", "false", NULL},
        {"/fit", "1", NULL},
        {"/lines", "{}", NULL},
        {"/lines", "[7]", "/lines/0"},
        {"/lines", "[{\"vertices\": [0, 1]}]", "/lines/0/name"},
        {"/lines", "[{\"name\": \"\", \"vertices\": [0, 1]}]", "/lines/0/name"},
        {"/lines", "[{\"name\": \"a\"}]", "/lines/0/vertices"},
        {"/lines", "[{\"name\": \"a\", \"vertices\": [0]}]", "/lines/0/vertices"},
        {"/lines", "[{\"name\": \"a\", \"vertices\": [0, 4]}]", "/lines/0/vertices/1"},
        {"/lines", "[{\"name\": \"a\", \"vertices\": [0, 1], \"closed\": 1}]", "/lines/0/closed"},
        {"/lines", "[{\"name\": \"a\", \"vertices\": [0, 1], \"colour\": 1}]", "/lines/0/colour"},
        {"/solver/fit", "true", NULL},
        {"/solver", "[]", NULL},
        {"/solver/method", "\"magic\"", NULL},
        {"/solver/stop_on", "\"never\"", NULL},
        {"/solver/integrator", "1", NULL},
        {"/solver/time_step", "0", NULL},
        {"/solver/time_step", "1001", NULL},
        {"/solver/tolerance", "0", NULL},
        {"/solver/max_iterations", "-1", NULL},
        {"/solver/max_iterations", "1.5", NULL},
        {"/solver/max_iterations", "\"10\"", NULL},
        {"/solver/time_limit_s", "0", NULL},
        {"/solver/damping", "0", NULL},
        {"/solver/damping/air", "-1", NULL},
        {"/solver/damping/water", "1", NULL},
        {"/solver/certify", "0", NULL},
        {"/solver/coarse", "true", NULL},
        {"/solver/coarse", "\"fine\"", NULL},
        {"/solver/threads", "8", NULL},
        {"/name", "7", NULL},
        {"/priority", "\"urgent\"", NULL},
        {"/priority", "1", NULL},
        {"/start_from", "7", NULL},
        {"/start_from", "\"0123\"", NULL},
        {"/start_from", "\"0123456789ABCDEF0123456789ABCDEF\"", NULL},
        {"/labels", "[]", NULL},
        {"/labels/order", "4711", NULL},
        {"/clothing", "{}", NULL},
    };
    expect_refusals(REFUSAL, COUNT(REFUSAL), PROBLEM_INVALID);
}

#define TETRAHEDRON  "[0,0,0, 1,0,0, 0,1,0, 0,0,1]"
#define SIDES        "[0,2,1, 0,1,3, 0,3,2, 1,2,3]"
#define MOVING(rest) "{\"mesh\": {\"positions\": " TETRAHEDRON ", \"triangles\": " SIDES "}, " rest "}"
#define MOVED        "{\"positions\": [2,0,0, 3,0,0, 2,1,0, 2,0,1]}"

static void test_schema__motion_is_read(void **state)
{
    (void)state;
    struct job_spec *spec =
        parse_with("/bodies/0", MOVING("\"motion_seconds\": 2.5, \"motion\": [" MOVED
                                       ", {\"positions\": " TETRAHEDRON ", \"triangles\": " SIDES "}]"));
    assert_int_equal(spec->body[0].keyframes, 2);
    assert_close(spec->body[0].motion_seconds, 2.5, 0);
    assert_close(spec->body[0].keyframe[0][3], 3, 0);
    assert_close(spec->body[0].keyframe[1][3], 1, 0);
    job_spec_free(spec);
    spec = parse_with("/bodies/0", MOVING("\"motion\": [" MOVED "]"));
    assert_close(spec->body[0].motion_seconds, DRAPE_DEFAULT_MOTION, 0);
    job_spec_free(spec);
    spec = parse_with("/bodies/0", MOVING("\"motion\": []"));
    assert_int_equal(spec->body[0].keyframes, 0);
    job_spec_free(spec);
    spec = parse_with("/bodies/0", MOVING("\"motion\": [" MOVED "], \"motion_seconds\": 60"));
    job_spec_free(spec);
    spec = parse_with("/bodies/0", MOVING("\"motion\": [" MOVED "], \"motion_seconds\": 0.01"));
    job_spec_free(spec);
}

/* `count` keyframes. */
static char *moving_often(size_t count)
{
    char *list = calloc(count + 1, sizeof MOVED + 1), *text;
    assert_non_null(list);
    for (size_t k = 0; k < count; k++)
        strcat(strcat(list, k ? "," : ""), MOVED);
    size_t bytes = strlen(list) + 400;
    text = malloc(bytes);
    assert_non_null(text);
    snprintf(text, bytes, MOVING("\"motion\": [%s]"), list);
    free(list);
    return text;
}

/* A tetrahedron as modelling programs export it, each face with corners of its own, and moved. */
#define SPLIT           "[0,0,0, 0,1,0, 1,0,0, 0,0,0, 1,0,0, 0,0,1, 0,0,0, 0,0,1, 0,1,0, 1,0,0, 0,1,0, 0,0,1]"
#define SPLIT_UP        "[0,1,0, 0,2,0, 1,1,0, 0,1,0, 1,1,0, 0,1,1, 0,1,0, 0,1,1, 0,2,0, 1,1,0, 0,2,0, 0,1,1]"
#define SPLIT_TRIANGLES "[0,1,2,3,4,5,6,7,8,9,10,11]"

static void test_schema__a_body_with_split_vertices_is_whole(void **state)
{
    (void)state;
    struct job_spec *spec = parse_with(
        "/bodies/0",
        "{\"mesh\": {\"positions\": " SPLIT ", \"triangles\": " SPLIT_TRIANGLES "}, \"motion\": ["
        "{\"positions\": " SPLIT_UP ", \"triangles\": " SPLIT_TRIANGLES "}, {\"positions\": " SPLIT "}]}");
    static const uint32_t WELDED[12] = {0, 1, 2, 0, 2, 5, 0, 5, 1, 2, 1, 5};
    assert_memory_equal(spec->body[0].triangle, WELDED, sizeof WELDED);
    assert_int_equal(spec->body[0].keyframes, 2);
    job_spec_free(spec);
}

static void test_schema__what_is_no_motion_is_refused_at_its_place(void **state)
{
    (void)state;
    static const struct refusal REFUSAL[] = {
        {"/bodies/0", MOVING("\"motion\": {}"), "/bodies/0/motion"},
        {"/bodies/0", MOVING("\"motion\": [7]"), "/bodies/0/motion/0"},
        {"/bodies/0", MOVING("\"motion\": [{}]"), "/bodies/0/motion/0/positions"},
        {"/bodies/0", MOVING("\"motion\": [" MOVED ", {\"positions\": [1,2]}]"),
         "/bodies/0/motion/1/positions"},
        {"/bodies/0", MOVING("\"motion\": [" MOVED ", {\"positions\": []}]"), "/bodies/0/motion/1"},
        {"/bodies/0", MOVING("\"motion\": [{\"positions\": [0,0,0, 1,0,0, 0,1,0]}]"), "/bodies/0/motion/0"},
        {"/bodies/0", MOVING("\"motion\": [{\"positions\": [0,0,0, 1,0,0, 0,1,0, null,0,1]}]"),
         "/bodies/0/motion/0/positions/9"},
        {"/bodies/0", MOVING("\"motion\": [{\"positions\": " TETRAHEDRON ", \"triangles\": [0,1,2]}]"),
         "/bodies/0/motion/0"},
        {"/bodies/0",
         MOVING("\"motion\": [{\"positions\": " TETRAHEDRON
                ", \"triangles\": [0,2,1, 0,1,3, 0,3,2, 2,3,1]}]"),
         "/bodies/0/motion/0"},
        {"/bodies/0", MOVING("\"motion\": [" MOVED ", {\"positions\": [0,0,0, 1,0,0, 0,1,0, 0,0,-1]}]"),
         "/bodies/0/motion/1"}, /* inside out */
        {"/bodies/0", MOVING("\"motion\": [{\"positions\": " TETRAHEDRON ", \"color\": 1}]"),
         "/bodies/0/motion/0/color"},
        {"/bodies/0", MOVING("\"motion\": [{\"ref\": \"12\"}]"), "/bodies/0/motion/0/ref"},
        {"/bodies/0", MOVING("\"motion\": [" MOVED "], \"motion_seconds\": 0.0099"),
         "/bodies/0/motion_seconds"},
        {"/bodies/0", MOVING("\"motion\": [" MOVED "], \"motion_seconds\": 60.01"),
         "/bodies/0/motion_seconds"},
        {"/bodies/0", MOVING("\"motion_seconds\": 1"), "/bodies/0/motion_seconds"},
        {"/bodies/0/motion", "[" MOVED "]", NULL}, /* of a sphere */
    };
    expect_refusals(REFUSAL, COUNT(REFUSAL), PROBLEM_INVALID);
    char *most = moving_often(DRAPE_MAX_KEYFRAMES), *more = moving_often(DRAPE_MAX_KEYFRAMES + 1);
    job_spec_free(parse_with("/bodies/0", most));
    const struct refusal too_many = {"/bodies/0", more, "/bodies/0/motion"};
    expect_refusals(&too_many, 1, PROBLEM_TOO_LARGE);
    free(most);
    free(more);
}

static void test_schema__what_the_solver_refuses_is_refused_at_its_place(void **state)
{
    (void)state;
    static const struct refusal REFUSAL[] = {
        {"/cloth/mesh/triangles", "[0,2,1, 1,2,2]", "/cloth/mesh/triangles/3"},
        {"/cloth/mesh/pattern", "[0,0, 1,0, 0,1, 0.5,0.5]", "/cloth/mesh/triangles/3"},
        {"/cloth/seams", "[3,3, 1,2]", "/cloth/seams/2"},
        {"/solver", "{\"damping\": {\"air\": 1}, \"integrator\": \"bdf2\", \"method\": \"dynamic\"}",
         "/solver/damping/air"},
        {"/solver",
         "{\"damping\": {\"air\": 1}, \"integrator\": \"rk4\", \"method\": \"velocity-correction\"}",
         "/solver/damping/air"},
        {"/solver", "{\"damping\": {\"material\": 1}}", "/solver/damping/material"},
    };
    expect_refusals(REFUSAL, COUNT(REFUSAL), PROBLEM_INVALID);
}

static void test_schema__mesh_of_a_hash_is_at_fault_at_its_hash(void **state)
{
    (void)state;
    static const char FOLDED[] = "v 0 1 0\nv 1 1 0\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 2 0\nf 1/1 3/3 2/2\n";
    struct problem problem = {0};
    struct job_spec *spec = NULL;
    char *text = with("/cloth/mesh", "{\"ref\": \"" SHA "\"}"), folded[sizeof FOLDED];
    memcpy(folded, FOLDED, sizeof folded);
    assert_int_equal(
        schema_job_parse(text, strlen(text), &limits_default, load_square, folded, &spec, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_INVALID);
    assert_string_equal(problem.errors[0].pointer, "/cloth/mesh/ref");
    assert_non_null(strstr(problem.errors[0].detail, "triangle 0"));
    free(text);

    text = with("/cloth/mesh",
                "{\"ref\": \"a123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef\"}");
    expect_text(text, &limits_default, PROBLEM_INVALID, "/cloth/mesh"); /* has no pattern */
    free(text);
    text = with("/cloth/mesh",
                "{\"ref\": \"f123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef\"}");
    expect_text(text, &limits_default, PROBLEM_INVALID, "/cloth/mesh/ref"); /* not uploaded */
    free(text);
}

static void test_schema__unknown_members_are_listed_up_to_the_room_there_is(void **state)
{
    (void)state;
    struct problem problem;
    assert_null(parse("{\"a\": 1, \"b\": 2, \"c/d~\": 3}", &limits_default, &problem));
    assert_int_equal(problem.code, PROBLEM_INVALID);
    assert_int_equal(problem.error_count, 3);
    bool escaped = false;
    for (size_t i = 0; i < problem.error_count; i++)
        escaped |= strcmp(problem.errors[i].pointer, "/c~1d~0") == 0;
    assert_true(escaped);

    assert_null(parse("{\"1\":0,\"2\":0,\"3\":0,\"4\":0,\"5\":0,\"6\":0,\"7\":0,\"8\":0,\"9\":0}",
                      &limits_default, &problem));
    assert_int_equal(problem.error_count, PROBLEM_MAX_ERRORS);
}

static void test_schema__long_member_names_are_cut_between_characters(void **state)
{
    (void)state;
    char text[700] = "{\"";
    struct problem problem;
    for (int i = 0; i < 300; i++)
        strcat(text, "\xc3\xa4"); /* a umlaut, two bytes */
    strcat(text, "\": 1}");
    assert_null(parse(text, &limits_default, &problem));
    assert_int_equal(problem.code, PROBLEM_INVALID);
    json_t *pointer = json_string(problem.errors[0].pointer); /* NULL unless it is whole UTF-8 */
    assert_non_null(pointer);
    json_decref(pointer);
}

static void test_schema__text_that_is_no_json_is_refused_with_its_line(void **state)
{
    (void)state;
    static const char *const TEXT[] = {"",
                                       "{",
                                       "[1,2",
                                       "{\"a\":[1,2,]}",
                                       "{\"a\":[1 2]}",
                                       "{\"a\":[1,,2]}",
                                       "{\"a\":[01]}",
                                       "{\"a\":[1.]}",
                                       "{\"a\":[-]}",
                                       "{\"a\":[1e999]}",
                                       "{\"a\":[1]",
                                       "{\"a\":[1}",
                                       "{\"a\":[1,{]}",
                                       "{\"a\":1}}",
                                       "{\"a\":1,\"a\":2}",
                                       "{\"a\":tru}",
                                       "{'a':1}",
                                       "{\"a\":\"\xff\"}",
                                       "nul",
                                       "{\"a\":[1,\"x]}",
                                       "{\"a\" 1}",
                                       "\xef\xbb\xbf{}",
                                       "{\"a\":[+1]}",
                                       "{\"a\":[1e]}",
                                       "{\"a\":[1][2]}"};
    for (size_t i = 0; i < COUNT(TEXT); i++)
        expect_text(TEXT[i], &limits_default, PROBLEM_BAD_JSON, "");

    struct problem problem;
    assert_null(parse("{\"gravity\": [0,-9.81,0],\n\n \"name\": nope}", &limits_default, &problem));
    assert_non_null(strstr(problem.detail, "line 3, column"));
    assert_null(parse("{\"gravity\": [0,\n -9.81,\n 0x0]}", &limits_default, &problem));
    assert_non_null(strstr(problem.detail, "line 3, column 3"));
    /* the column counts the numbers that were taken out of the text before it was parsed */
    assert_null(parse("{\"gravity\": [0,-9.81,0], oops }", &limits_default, &problem));
    assert_non_null(strstr(problem.detail, "line 1, column 30")); /* after "oops" */
}

static void test_schema__top_level_must_be_an_object(void **state)
{
    (void)state;
    expect_text("[1, 2]", &limits_default, PROBLEM_INVALID, "");
    expect_text("{}", &limits_default, PROBLEM_INVALID, "/cloth");
}

/* ---- limits, each at the limit and one past it --------------------------------------------------- */

static void expect_limit(struct limits at, struct limits below, const char *pointer, const char *value,
                         enum problem_code code, const char *place)
{
    struct problem problem;
    char *text = with(pointer, value);
    struct job_spec *spec = parse(text, &at, &problem);
    if (!spec)
        fail_msg("refused at the limit: %s", problem.detail);
    job_spec_free(spec);
    expect_text(text, &below, code, place);
    free(text);
}

static void test_schema__every_limit_holds_at_the_limit_and_not_past_it(void **state)
{
    (void)state;
    struct limits at = limits_default, below;

#define CHECK(member, limit, pointer, value, code, place)                                                    \
    at = below = limits_default;                                                                             \
    at.member = (limit);                                                                                     \
    below.member = (limit)-1;                                                                                \
    expect_limit(at, below, pointer, value, code, place)

    CHECK(vertices, 4, NULL, NULL, PROBLEM_TOO_LARGE, "/cloth/mesh/positions");
    CHECK(triangles, 2, NULL, NULL, PROBLEM_TOO_LARGE, "/cloth/mesh/triangles");
    CHECK(bodies, 1, NULL, NULL, PROBLEM_TOO_LARGE, "/bodies");
    CHECK(materials, 1, NULL, NULL, PROBLEM_TOO_LARGE, "/cloth/materials");
    CHECK(lines, 1, "/lines", "[{\"name\": \"hem\", \"vertices\": [0, 1]}]", PROBLEM_TOO_LARGE, "/lines");
    CHECK(line_vertices, 5, "/lines",
          "[{\"name\": \"hem\", \"vertices\": [0, 1]}, {\"name\": \"side\", \"vertices\": [0, 2, 3]}]",
          PROBLEM_TOO_LARGE, "/lines/1/vertices");
    CHECK(name_bytes, 5, "/name", "\"dress\"", PROBLEM_INVALID, "/name");
    CHECK(labels, 2, "/labels", "{\"a\": \"1\", \"b\": \"2\"}", PROBLEM_INVALID, "/labels");
    CHECK(max_iterations, 50, "/solver/max_iterations", "50", PROBLEM_INVALID, "/solver/max_iterations");
    CHECK(time_limit_s, 50, "/solver/time_limit_s", "50", PROBLEM_INVALID, "/solver/time_limit_s");
    CHECK(json_depth, 5, NULL, NULL, PROBLEM_BAD_JSON, ""); /* {bodies:[{sphere:{center:[]}}]} */
#undef CHECK
}

static void test_schema__values_and_nodes_are_counted_before_the_tree_is_built(void **state)
{
    (void)state;
    struct limits limits = limits_default;
    limits.json_values = 6; /* the object, the array and four numbers */
    expect_text("{\"x\": [1, 2, 3, 4]}", &limits, PROBLEM_INVALID, "/x");
    expect_text("{\"x\": [1, 2, 3, 4, 5]}", &limits, PROBLEM_TOO_LARGE, "");
    limits.json_values = 3;
    expect_text("{\"x\": [[], {}]}", &limits, PROBLEM_TOO_LARGE, "");
    limits.json_values = 4;
    expect_text("{\"x\": [[], {}]}", &limits, PROBLEM_INVALID, "/x");

    size_t n = JSONTEXT_MAX_NODES;
    char *text = malloc(3 * n + 16), *at = text;
    at += sprintf(at, "{\"x\":[");
    for (size_t i = 0; i < n; i++)
        at += sprintf(at, "[],");
    sprintf(at - 1, "]}");
    expect_text(text, &limits_default, PROBLEM_TOO_LARGE, "");
    /* n - 2 arrays, the array around them and the member x */
    sprintf(at - 1 - 2 * 3, "]}");
    expect_text(text, &limits_default, PROBLEM_INVALID, "/x");
    free(text);

    /* strings cost a node's memory too */
    text = malloc(8 * n + 16);
    at = text + sprintf(text, "{\"x\":[\"\"");
    for (size_t i = 0; i < 2 * n; i++)
        at += sprintf(at, ",\"\"");
    sprintf(at, "]}");
    expect_text(text, &limits_default, PROBLEM_TOO_LARGE, "");
    free(text);
}

static void test_schema__text_outside_arrays_of_numbers_has_its_limit(void **state)
{
    (void)state;
    size_t n = JSONTEXT_MAX_REST;
    char *text = malloc(n + 16);
    memset(text, ' ', n + 16);
    memcpy(text, "{\"x\":[1,2]", 10); /* of which 1,2 does not count */
    memcpy(text + n + 2, "}", 2);
    expect_text(text, &limits_default, PROBLEM_INVALID, "/x");
    memcpy(text + n + 2, " }", 3);
    expect_text(text, &limits_default, PROBLEM_TOO_LARGE, "");
    free(text);
}

static void test_schema__name_and_labels_have_their_own_lengths(void **state)
{
    (void)state;
    char value[400];
    struct job_spec *spec;
    snprintf(value, sizeof value, "\"%0*d\"", 200, 7);
    spec = parse_with("/name", value);
    assert_int_equal(strlen(spec->name), 200);
    job_spec_free(spec);
    snprintf(value, sizeof value, "\"%0*d\"", 201, 7);
    char *text = with("/name", value);
    expect_text(text, &limits_default, PROBLEM_INVALID, "/name");
    free(text);
    text = with("/labels/a", value);
    expect_text(text, &limits_default, PROBLEM_INVALID, "/labels/a");
    free(text);
    snprintf(value, sizeof value, "{\"%0*d\": \"\"}", 64, 7);
    job_spec_free(parse_with("/labels", value));
    snprintf(value, sizeof value, "{\"%0*d\": \"\"}", 65, 7);
    struct problem problem;
    text = with("/labels", value);
    assert_null(parse(text, &limits_default, &problem));
    assert_int_equal(problem.code, PROBLEM_INVALID);
    free(text);
}

/* ---- the solver's errors ------------------------------------------------------------------------- */

static void expect_pointer(drape_error error, enum problem_code code, const char *pointer)
{
    struct problem problem;
    assert_int_equal(schema_solver_problem(&error, &problem), -1);
    assert_int_equal(problem.code, code);
    assert_string_equal(problem.errors[0].pointer, pointer);
    assert_true(code != PROBLEM_INVALID || strstr(problem.detail, "why"));
}

static void test_schema__places_of_the_solver_become_pointers(void **state)
{
    (void)state;
    static const struct {
        drape_place place;
        int64_t element, body;
        const char *member, *pointer;
    } CASE[] = {
        {DRAPE_AT_NOWHERE, -1, -1, NULL, ""},
        {DRAPE_AT_VERTEX, 5, -1, NULL, "/cloth/mesh/positions/15"},
        {DRAPE_AT_PATTERN, 5, -1, NULL, "/cloth/mesh/pattern/10"},
        {DRAPE_AT_TRIANGLE, 5, -1, NULL, "/cloth/mesh/triangles/15"},
        {DRAPE_AT_SEAM, 5, -1, NULL, "/cloth/seams/10"},
        {DRAPE_AT_PIN, 5, -1, NULL, "/cloth/pins/5"},
        {DRAPE_AT_MATERIAL, 2, -1, "stretch_weft", "/cloth/materials/2/stretch/weft"},
        {DRAPE_AT_MATERIAL, 2, -1, "stretch_shear", "/cloth/materials/2/stretch/shear"},
        {DRAPE_AT_MATERIAL, 2, -1, "bend_twist", "/cloth/materials/2/bend/twist"},
        {DRAPE_AT_MATERIAL, 2, -1, "density", "/cloth/materials/2/density"},
        {DRAPE_AT_MATERIAL, 2, -1, "poisson", "/cloth/materials/2/poisson"},
        {DRAPE_AT_TRIANGLE_MATERIAL, 5, -1, NULL, "/cloth/triangle_material/5"},
        {DRAPE_AT_BODY, 3, 3, "offset", "/bodies/3/offset"},
        {DRAPE_AT_BODY, 3, 3, "radius", "/bodies/3"},
        {DRAPE_AT_BODY_VERTEX, 5, 3, NULL, "/bodies/3/mesh/positions/15"},
        {DRAPE_AT_BODY_TRIANGLE, 5, 3, NULL, "/bodies/3/mesh/triangles/15"},
        {DRAPE_AT_MATERIAL, 2, -1, "shrink_warp", "/cloth/materials/2/shrink/warp"},
        {DRAPE_AT_ELASTIC, 2, -1, "factor", "/cloth/elastics/2/factor"},
        {DRAPE_AT_ELASTIC, 2, -1, "edge", "/cloth/elastics/2/edges"},
        {DRAPE_AT_ELASTIC_EDGE, 5, 2, NULL, "/cloth/elastics/2/edges/10"},
        {DRAPE_AT_FOLD, 2, -1, "angle", "/cloth/folds/2/angle"},
        {DRAPE_AT_FOLD_EDGE, 5, 2, NULL, "/cloth/folds/2/edges/10"},
        {DRAPE_AT_TACK, 5, -1, "barycentric", "/cloth/tacks/5/barycentric"},
        {DRAPE_AT_SCENE, -1, -1, "tacks", "/cloth/tacks"},
        {DRAPE_AT_BODY_KEYFRAME, 5, 3, "positions", "/bodies/3/motion/5"},
        {DRAPE_AT_BODY, 3, 3, "keyframes", "/bodies/3/motion"},
        {DRAPE_AT_BODY, 3, 3, "motion_seconds", "/bodies/3/motion_seconds"},
        {DRAPE_AT_SCENE, -1, -1, "gravity", "/gravity"},
        {DRAPE_AT_SCENE, -1, -1, "vertices", "/cloth/mesh/positions"},
        {DRAPE_AT_OPTION, -1, -1, "time_limit", "/solver/time_limit_s"},
        {DRAPE_AT_OPTION, -1, -1, "tolerance", "/solver/tolerance"},
    };
    for (size_t i = 0; i < COUNT(CASE); i++)
        expect_pointer(
            (drape_error){DRAPE_EINVAL, CASE[i].place, CASE[i].element, CASE[i].body, CASE[i].member, "why"},
            PROBLEM_INVALID, CASE[i].pointer);
    expect_pointer((drape_error){.status = DRAPE_ENOMEM}, PROBLEM_INTERNAL, "");
    expect_pointer((drape_error){.status = DRAPE_ENUMERIC, .message = "why"}, PROBLEM_SOLVER, "");
}

/* ---- back to JSON -------------------------------------------------------------------------------- */

static void expect_members(const json_t *object, const char *const *name)
{
    size_t n = 0;
    for (; name[n]; n++)
        if (!json_object_get(object, name[n]))
            fail_msg("%s is missing", name[n]);
    assert_int_equal(json_object_size(object), n);
}

static void test_schema__progress_has_the_members_of_the_contract(void **state)
{
    (void)state;
    static const char *const MEMBERS[] = {"phase",
                                          "iteration",
                                          "max_iterations",
                                          "elapsed_ms",
                                          "energy",
                                          "residual_energy",
                                          "residual_energy_is",
                                          "residual_force",
                                          "stops",
                                          "percent",
                                          NULL};
    static const char *const ENERGIES[] = {"stretch", "bend",      "gravity", "contact",
                                           "kinetic", "potential", NULL};
    drape_progress progress = {.phase = DRAPE_PHASE_SEWING,
                               .row = {.iteration = 7, .seconds = 1.25, .residual_energy = NAN},
                               .stops = 3};
    drape_options options = drape_options_default();
    json_t *json = schema_progress_json(&progress, &options);
    expect_members(json, MEMBERS);
    expect_members(json_object_get(json, "energy"), ENERGIES);
    assert_string_equal(json_string_value(json_object_get(json, "phase")), "sewing");
    assert_int_equal(json_integer_value(json_object_get(json, "elapsed_ms")), 1250);
    assert_true(json_is_null(json_object_get(json, "residual_energy"))); /* NAN is no JSON */
    assert_true(json_is_null(json_object_get(json, "percent")));
    json_decref(json);
}

static void test_schema__report_has_the_members_of_the_contract(void **state)
{
    (void)state;
    static const char *const MEMBERS[] = {"plan",
                                          "method",
                                          "stop_on",
                                          "integrator",
                                          "iterations",
                                          "stops",
                                          "factorizations",
                                          "solves",
                                          "work",
                                          "sewing",
                                          "motion",
                                          "ramp",
                                          "coarse",
                                          "seconds",
                                          "borrowed_seconds",
                                          "stages",
                                          "peak_bytes",
                                          "peak_bytes_by_phase",
                                          "bytes_per_triangle",
                                          "energies",
                                          "residual_energy",
                                          "residual_energy_is",
                                          "residual_force",
                                          "penetrations",
                                          "deepest",
                                          "drop",
                                          "self_intersections",
                                          "intersection",
                                          "lines",
                                          "certificate",
                                          "reason",
                                          NULL};
    drape_report report = {
        .method = DRAPE_METHOD_STOP_AND_GO,
        .stop_on = DRAPE_STOP_ON_KINETIC,
        .reason = "the residual force fell below the tolerance",
        .iterations = 12,
        .drop = 0.312,
        .coarse_triangles = 700,
        .coarse_iterations = 12,
        .coarse_factorizations = 80,
        .coarse_carried = true,
        .borrowed_seconds = 2.5,
        .triangles = 1 << 20,
        .phase_bytes = {[DRAPE_PHASE_SEWING] = 7, [DRAPE_PHASE_DRAPING] = (size_t)5 << 30},
        .peak_bytes = (size_t)5 << 30,
        .terms = 2,
        .term = {{"stretch", true, 100, ""}, {"contact", false, 0, "no body in the scene"}},
        .stages = 1,
        .stage = {{"assemble", 0.5}}};
    json_t *json = schema_report_json(&report, NULL), *plan = json_object_get(json, "plan");
    expect_members(json, MEMBERS);
    assert_int_equal(json_array_size(json_object_get(plan, "kept")), 1);
    json_t *left = json_array_get(json_object_get(plan, "left_out"), 0);
    assert_string_equal(json_string_value(json_object_get(left, "reason")), "no body in the scene");
    assert_string_equal(json_string_value(json_object_get(json, "stop_on")), "kinetic");
    assert_true(json_integer_value(json_object_get(json, "peak_bytes")) == (json_int_t)5 << 30);
    assert_close(json_number_value(json_object_get(json, "bytes_per_triangle")), 5 << 10, 0);
    assert_close(json_number_value(json_object_get(json, "borrowed_seconds")), 2.5, 0);
    static const char *const PHASES[] = {"sewing", "draping", NULL};
    json_t *phases = json_object_get(json, "peak_bytes_by_phase");
    expect_members(phases, PHASES);
    assert_int_equal(json_integer_value(json_object_get(phases, "sewing")), 7);
    assert_close(json_number_value(json_object_get(json_object_get(json, "stages"), "assemble")), 0.5, 0);
    static const char *const COARSE[] = {"triangles", "iterations", "factorizations", "carried", NULL};
    json_t *coarse = json_object_get(json, "coarse");
    expect_members(coarse, COARSE);
    assert_int_equal(json_integer_value(json_object_get(coarse, "triangles")), 700);
    assert_int_equal(json_integer_value(json_object_get(coarse, "iterations")), 12);
    assert_int_equal(json_integer_value(json_object_get(coarse, "factorizations")), 80);
    assert_true(json_is_true(json_object_get(coarse, "carried")));
    assert_true(json_is_null(json_object_get(json, "certificate")));
    assert_close(json_number_value(json_object_get(json, "drop")), 0.312, 0);
    assert_string_equal(json_string_value(json_object_get(json, "residual_energy_is")), "estimate");
    json_decref(json);
}

static void test_schema__a_certificate_is_told_with_its_figures(void **state)
{
    (void)state;
    static const char *const MEMBERS[] = {"certified", "reason", "largest_move",   "energy_left", "curvature",
                                          "escapes",   "steps",  "factorizations", NULL};
    drape_report report = {.reason = "so it is", .certificate = {true, "proven", 1e-16, 2e-28, 14, 1, 3, 5}};
    json_t *json = schema_report_json(&report, NULL), *certificate = json_object_get(json, "certificate");
    expect_members(certificate, MEMBERS);
    assert_true(json_is_true(json_object_get(certificate, "certified")));
    assert_close(json_number_value(json_object_get(certificate, "largest_move")), 1e-16, 0);
    assert_close(json_number_value(json_object_get(certificate, "curvature")), 14, 0);
    assert_string_equal(json_string_value(json_object_get(json, "residual_energy_is")), "reference");
    json_decref(json);

    report.certificate = (drape_certificate){.reason = "the drape is not at rest", .largest_move = NAN};
    json = schema_report_json(&report, NULL);
    certificate = json_object_get(json, "certificate");
    assert_true(json_is_false(json_object_get(certificate, "certified")));
    assert_true(json_is_null(json_object_get(certificate, "largest_move"))); /* NAN is no JSON */
    assert_string_equal(json_string_value(json_object_get(json, "residual_energy_is")), "estimate");
    json_decref(json);
}

/* ---- the published description ------------------------------------------------------------------- */

/* The value at a pointer of plain member names. */
static const json_t *look_up(const json_t *root, const char *pointer)
{
    char path[256], *rest = path, *name;
    snprintf(path, sizeof path, "%s", pointer + 1);
    while ((name = strsep(&rest, "/")))
        root = json_object_get(root, name);
    if (!root)
        fail_msg("%s is missing", pointer);
    return root;
}

static double default_of(const json_t *schemas, const char *pointer)
{
    return json_number_value(json_object_get(look_up(schemas, pointer), "default"));
}

static void test_schema__openapi_gives_the_defaults_and_limits_there_are(void **state)
{
    (void)state;
    json_error_t error;
    json_t *root = json_load_file("server/openapi.json", JSON_REJECT_DUPLICATES, &error);
    if (!root)
        fail_msg("server/openapi.json: line %d: %s", error.line, error.text);
    const json_t *schemas = look_up(root, "/components/schemas");
    const json_t *solver = look_up(schemas, "/Solver/properties"),
                 *job = look_up(schemas, "/JobDocument/properties");
    drape_options options = drape_options_default();
    drape_scene_desc scene = drape_scene_desc_default();
    assert_close(default_of(solver, "/time_step"), options.time_step, 0);
    assert_close(default_of(solver, "/tolerance"), options.tolerance, 0);
    assert_close(default_of(solver, "/max_iterations"), options.max_iterations, 0);
    assert_close(default_of(solver, "/time_limit_s"), options.time_limit, 0);
    assert_int_equal(options.stop_on, DRAPE_STOP_ON_POTENTIAL);
    assert_string_equal(json_string_value(look_up(solver, "/stop_on/default")), "potential");
    for (size_t k = 0; k < 3; k++)
        assert_close(json_number_value(json_array_get(look_up(job, "/gravity/default"), k)), scene.gravity[k],
                     0);
    assert_int_equal(json_integer_value(look_up(job, "/name/maxLength")), limits_default.name_bytes);
    assert_int_equal(json_integer_value(look_up(job, "/labels/maxProperties")), limits_default.labels);
    assert_int_equal(json_integer_value(look_up(job, "/bodies/maxItems")), limits_default.bodies);
    assert_int_equal(json_integer_value(look_up(job, "/lines/maxItems")), limits_default.lines);
    const json_t *body = json_array_get(look_up(schemas, "/Body/oneOf"), 0);
    assert_close(default_of(body, "/properties/offset"), DRAPE_DEFAULT_OFFSET, 0);
    const json_t *thickness = look_up(schemas, "/Cloth/properties/thickness");
    assert_close(json_number_value(json_object_get(thickness, "default")), scene.thickness, 0);
    assert_close(json_number_value(json_object_get(thickness, "minimum")), DRAPE_MIN_THICKNESS, 0);
    assert_close(json_number_value(json_object_get(thickness, "maximum")), DRAPE_MAX_THICKNESS, 0);
    json_decref(root);
}

static void test_schema__openapi_lists_every_problem_code(void **state)
{
    (void)state;
    json_t *root = json_load_file("server/openapi.json", 0, NULL);
    const json_t *codes = look_up(root, "/components/schemas/ProblemCode/enum");
    assert_int_equal(json_array_size(codes), PROBLEM_CODES - 1);
    for (int code = PROBLEM_NONE + 1; code < PROBLEM_CODES; code++)
        assert_string_equal(json_string_value(json_array_get(codes, (size_t)code - 1)),
                            problem_name((enum problem_code)code));
    json_decref(root);
}

/* The members that a client will find are those that the description names. */
static void test_schema__openapi_has_the_members_of_progress_and_report(void **state)
{
    (void)state;
    drape_progress progress = {0};
    drape_report report = {.reason = ""};
    drape_options options = drape_options_default();
    json_t *root = json_load_file("server/openapi.json", 0, NULL);
    json_t *json[] = {schema_progress_json(&progress, &options), schema_report_json(&report, NULL)};
    static const char *const NAME[] = {"/components/schemas/Progress/properties",
                                       "/components/schemas/Report/properties"};
    for (size_t i = 0; i < 2; i++) {
        const char *member;
        json_t *value;
        const json_t *described = look_up(root, NAME[i]);
        assert_int_equal(json_object_size(described), json_object_size(json[i]));
        json_object_foreach(json[i], member, value) if (!json_object_get(described, member))
            fail_msg("%s has no %s", NAME[i], member);
        json_decref(json[i]);
    }
    json_decref(root);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_schema__least_job_takes_the_solver_defaults),
        cmocka_unit_test(test_schema__solver_options_are_read),
        cmocka_unit_test(test_schema__the_fit_is_measured_where_asked_for),
        cmocka_unit_test(test_schema__bodies_of_every_kind_are_read),
        cmocka_unit_test(test_schema__explicit_material_fills_the_isotropic_shear_and_twist),
        cmocka_unit_test(test_schema__strain_stress_curves_are_read),
        cmocka_unit_test(test_schema__curves_have_a_limit_of_points),
        cmocka_unit_test(test_schema__wrong_curves_are_refused_at_their_place),
        cmocka_unit_test(test_schema__members_beside_a_preset_replace_its_own),
        cmocka_unit_test(test_schema__seams_labels_and_materials_by_triangle_are_read),
        cmocka_unit_test(test_schema__priority_is_normal_unless_it_is_given),
        cmocka_unit_test(test_schema__self_contact_is_passed_on_but_not_to_plain_newton),
        cmocka_unit_test(test_schema__what_intersects_is_counted_and_placed),
        cmocka_unit_test(test_schema__lines_are_read_and_told_with_their_lengths),
        cmocka_unit_test(test_schema__lines_across_pieces_need_a_seam),
        cmocka_unit_test(test_schema__elastics_folds_and_tacks_are_read),
        cmocka_unit_test(test_schema__a_tack_names_a_triangle_of_a_body),
        cmocka_unit_test(test_schema__wrong_lines_are_refused_at_their_place),
        cmocka_unit_test(test_schema__there_are_so_many_elastics_and_folds),
        cmocka_unit_test(test_schema__crossed_seams_are_warned_of_at_their_first_pair),
        cmocka_unit_test(test_schema__uploaded_meshes_are_loaded_by_hash),
        cmocka_unit_test(test_schema__wrong_values_are_refused_at_their_place),
        cmocka_unit_test(test_schema__motion_is_read),
        cmocka_unit_test(test_schema__a_body_with_split_vertices_is_whole),
        cmocka_unit_test(test_schema__what_is_no_motion_is_refused_at_its_place),
        cmocka_unit_test(test_schema__what_the_solver_refuses_is_refused_at_its_place),
        cmocka_unit_test(test_schema__mesh_of_a_hash_is_at_fault_at_its_hash),
        cmocka_unit_test(test_schema__unknown_members_are_listed_up_to_the_room_there_is),
        cmocka_unit_test(test_schema__long_member_names_are_cut_between_characters),
        cmocka_unit_test(test_schema__text_that_is_no_json_is_refused_with_its_line),
        cmocka_unit_test(test_schema__top_level_must_be_an_object),
        cmocka_unit_test(test_schema__every_limit_holds_at_the_limit_and_not_past_it),
        cmocka_unit_test(test_schema__values_and_nodes_are_counted_before_the_tree_is_built),
        cmocka_unit_test(test_schema__text_outside_arrays_of_numbers_has_its_limit),
        cmocka_unit_test(test_schema__name_and_labels_have_their_own_lengths),
        cmocka_unit_test(test_schema__places_of_the_solver_become_pointers),
        cmocka_unit_test(test_schema__progress_has_the_members_of_the_contract),
        cmocka_unit_test(test_schema__report_has_the_members_of_the_contract),
        cmocka_unit_test(test_schema__a_certificate_is_told_with_its_figures),
        cmocka_unit_test(test_schema__openapi_gives_the_defaults_and_limits_there_are),
        cmocka_unit_test(test_schema__openapi_lists_every_problem_code),
        cmocka_unit_test(test_schema__openapi_has_the_members_of_progress_and_report),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
