/* test_meshfile.c - mesh files: what is read, what is refused and where, and what is written reads back. */
#include "test.h"

#include <locale.h>

#include "meshfile.h"

#define COUNT(array) (sizeof(array) / sizeof *(array))

/* ---- helpers ----------------------------------------------------------------------------------- */

/* Parses from a copy that ends where the heap block ends: ASan sees every byte read too far. */
static int parse_bytes(enum mesh_format format, const void *data, size_t bytes, struct mesh *ret,
                       struct problem *reterr)
{
    char *copy = malloc(bytes > 0 ? bytes : 1);
    assert_non_null(copy);
    if (bytes > 0)
        memcpy(copy, data, bytes);
    memset(reterr, 0, sizeof *reterr);
    int rc = meshfile_parse(format, copy, bytes, &limits_default, ret, reterr);
    free(copy);
    return rc;
}

static struct mesh read_text(enum mesh_format format, const char *text)
{
    struct mesh mesh = {0};
    struct problem problem;
    if (parse_bytes(format, text, strlen(text), &mesh, &problem))
        fail_msg("%s", problem.detail);
    return mesh;
}

/* Refused, and the message says `what`. */
static void expect_refusal(enum mesh_format format, const void *data, size_t bytes, const char *what)
{
    struct mesh mesh = {0};
    struct problem problem;
    assert_int_equal(parse_bytes(format, data, bytes, &mesh, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_INVALID);
    if (!strstr(problem.detail, what))
        fail_msg("\"%s\" does not say \"%s\"", problem.detail, what);
    assert_null(mesh.positions);
}

/* A strip of n squares in space, bent and with a pattern. */
static struct mesh make_strip(size_t n)
{
    struct mesh mesh = {.vertices = 2 * (n + 1), .triangles = 2 * n};
    mesh.positions = calloc(3 * mesh.vertices, sizeof(double));
    mesh.pattern = calloc(2 * mesh.vertices, sizeof(double));
    mesh.triangle = calloc(3 * mesh.triangles, sizeof(uint32_t));
    assert_true(mesh.positions && mesh.pattern && mesh.triangle);
    for (size_t i = 0; i < mesh.vertices; i++) {
        double u = (double)(i / 2) / 7, v = (double)(i % 2) / 3;
        double x[3] = {u, -u * u, v + 1e-7 * (double)i}, p[2] = {u, v};
        memcpy(mesh.positions + 3 * i, x, sizeof x);
        memcpy(mesh.pattern + 2 * i, p, sizeof p);
    }
    for (size_t i = 0; i < n; i++) {
        uint32_t a = (uint32_t)(2 * i), t[6] = {a, a + 2, a + 1, a + 1, a + 2, a + 3};
        memcpy(mesh.triangle + 6 * i, t, sizeof t);
    }
    return mesh;
}

static void assert_same_mesh(const struct mesh *a, const struct mesh *b, double tolerance)
{
    assert_int_equal(a->vertices, b->vertices);
    assert_int_equal(a->triangles, b->triangles);
    assert_memory_equal(a->triangle, b->triangle, 3 * a->triangles * sizeof *a->triangle);
    assert_int_equal(a->pattern != NULL, b->pattern != NULL);
    for (size_t i = 0; i < 3 * a->vertices; i++)
        assert_near(a->positions[i], b->positions[i], tolerance, 1);
    for (size_t i = 0; a->pattern && i < 2 * a->vertices; i++)
        assert_near(a->pattern[i], b->pattern[i], tolerance, 1);
}

/* ---- names ------------------------------------------------------------------------------------- */

static void test_meshfile__formats_are_known_by_name_and_media_type(void **state)
{
    (void)state;
    for (int i = 0; i < MESH_FORMATS; i++) {
        assert_int_equal(mesh_format_from_name(mesh_format_name((enum mesh_format)i)), i);
        assert_int_equal(mesh_format_from_media_type(mesh_format_media_type((enum mesh_format)i)), i);
    }
    assert_int_equal(mesh_format_from_media_type("Model/OBJ; charset=utf-8"), MESH_OBJ);
    assert_int_equal(mesh_format_from_media_type("application/json;charset=utf-8"), MESH_JSON);
    assert_int_equal(mesh_format_from_media_type("text/html"), -1);
    assert_int_equal(mesh_format_from_media_type(""), -1);
    assert_int_equal(
        mesh_format_from_media_type("application/x-plyapplication/x-plyapplication/x-plyapplication/x"), -1);
    assert_int_equal(mesh_format_from_name("stl"), -1);
}

/* ---- OBJ --------------------------------------------------------------------------------------- */

static void test_obj__corners_of_every_form_are_read(void **state)
{
    (void)state;
    static const char *const FACE[] = {"f 1 2 3",          "f 1/1 2/2 3/3", "f 1/1/1 2/2/1 3/3/1",
                                       "f 1//1 2//1 3//1", "f -3 -2 -1",    "f -3/-3 -2/-2 -1/-1",
                                       "f 1/ 2/ 3/"};
    for (size_t i = 0; i < COUNT(FACE); i++) {
        char text[256];
        snprintf(text, sizeof text, "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\n%s",
                 FACE[i]);
        if (i == 6) {
            expect_refusal(MESH_OBJ, text, strlen(text), "line 8");
            continue;
        }
        struct mesh mesh = read_text(MESH_OBJ, text);
        assert_int_equal(mesh.triangles, 1);
        assert_int_equal(mesh.triangle[2], 2);
        assert_int_equal(mesh.pattern != NULL, strchr(FACE[i], '/') && !strstr(FACE[i], "//"));
        mesh_done(&mesh);
    }
}

static void test_obj__polygons_become_fans(void **state)
{
    (void)state;
    static const uint32_t FAN[] = {0, 1, 2, 0, 2, 3, 0, 3, 4};
    struct mesh mesh = read_text(MESH_OBJ, "v 0 0 0\nv 1 0 0\nv 2 1 0\nv 1 2 0\nv 0 2 0\nf 1 2 3 4 5\n");
    assert_int_equal(mesh.triangles, 3);
    assert_memory_equal(mesh.triangle, FAN, sizeof FAN);
    assert_null(mesh.pattern);
    mesh_done(&mesh);
}

static void test_obj__comments_blank_lines_crlf_and_extra_numbers_are_no_matter(void **state)
{
    (void)state;
    struct mesh mesh = read_text(
        MESH_OBJ, "# a\r\n\r\nmtllib x.mtl\r\no piece\r\n v\t-.5 +1. 2e-1 1.0 0.5 0.5\r\nv 1 0 0\r\n"
                  "v 0 1 0\r\nusemtl a\r\ns off\r\nf 1 2 3\r\n#end");
    assert_close(mesh.positions[0], -0.5, 0);
    assert_close(mesh.positions[1], 1, 0);
    assert_close(mesh.positions[2], 0.2, 0);
    mesh_done(&mesh);
}

static void test_obj__pattern_may_be_shared_or_repeated_but_not_differ(void **state)
{
    (void)state;
    /* vertices 1 and 2 are given two vt each, equal ones */
    struct mesh mesh =
        read_text(MESH_OBJ, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n"
                            "vt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 2/5 4/4 3/6\n");
    assert_close(mesh.pattern[2], 1, 0);
    assert_close(mesh.pattern[7], 1, 0);
    mesh_done(&mesh);
    static const char DIFFER[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nvt 5 5\n"
                                 "f 1/1 2/2 3/3\nf 2/4 4/4 3/3\n";
    expect_refusal(MESH_OBJ, DIFFER, sizeof DIFFER - 1, "line 10: vertex 2 has two different vt");
    static const char MISSING[] =
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nf 2 4 3\n";
    expect_refusal(MESH_OBJ, MISSING, sizeof MISSING - 1, "vertex 4 has no vt");
}

static void test_obj__errors_name_the_line(void **state)
{
    (void)state;
    static const struct {
        const char *text, *what;
    } CASE[] = {
        {"", "no vertices"},
        {"v 0 0 0\n", "no triangles"},
        {"f 1 2 3\n", "no vertices"},
        {"v 0 0\nf 1 1 1\n", "line 1: v needs three numbers"},
        {"v 0 0 nan\nf 1 1 1\n", "line 1"},
        {"v 0 0 inf\nf 1 1 1\n", "line 1"},
        {"v 0 0 1e999\nf 1 1 1\n", "line 1"},
        {"v 0 0 0x10\nf 1 1 1\n", "line 1"},
        {"v 0 0 1,5\nf 1 1 1\n", "line 1"},
        {"v 0 0 0\nvt 1\nf 1 1 1\n", "line 2: vt needs two numbers"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4: vertex 4 does not exist, the file has 3"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "line 4: \"0\" is no vertex number"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 1 2\n", "line 4: vertex -4"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "line 4: \"x\""},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/9 2/9 3/9\n", "line 4: vt 9 does not exist"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 2\n", "line 4 uses one vertex twice"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2\n", "line 5: a face with fewer than three corners"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\ncurv 0 1\n", "line 5: unknown statement \"curv\""},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 99999999999999999999 1 2\n", "line 4"},
    };
    for (size_t i = 0; i < COUNT(CASE); i++)
        expect_refusal(MESH_OBJ, CASE[i].text, strlen(CASE[i].text), CASE[i].what);
}

static void test_obj__numbers_round_as_strtod_does(void **state)
{
    (void)state;
    static const char *const NUMBER[] = {"0.1",
                                         "-0.034790",
                                         "1.61159",
                                         "123456789012345",
                                         "1234567890123456789",
                                         "1e22",
                                         "1e-22",
                                         "2.2250738585072014e-308",
                                         "5e-324",
                                         "0.3333333333333333",
                                         "-0",
                                         "9007199254740993",
                                         "179769313486231570000000000000000000000"};
    for (size_t i = 0; i < COUNT(NUMBER); i++) {
        char text[256];
        snprintf(text, sizeof text, "v %s 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", NUMBER[i]);
        struct mesh mesh = read_text(MESH_OBJ, text);
        double expected = strtod(NUMBER[i], NULL);
        assert_memory_equal(&mesh.positions[0], &expected, sizeof expected); /* to the last bit and sign */
        mesh_done(&mesh);
    }
}

static void test_obj__a_comma_locale_changes_nothing(void **state)
{
    (void)state;
    const char *name = setlocale(LC_NUMERIC, "de_DE.UTF-8");
    if (!name)
        print_message("SKIP: no de_DE.UTF-8 locale here\n");
    struct mesh mesh = read_text(MESH_OBJ, "v 0.5 1.25e0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    setlocale(LC_NUMERIC, "C");
    assert_close(mesh.positions[0], 0.5, 0);
    assert_close(mesh.positions[1], 1.25, 0);
    mesh_done(&mesh);
    if (!name)
        skip();
}

/* ---- PLY --------------------------------------------------------------------------------------- */

#define PLY_HEAD(format, vertex) "ply\nformat " format " 1.0\nelement vertex 3\n" vertex
#define PLY_XYZ                  "property float x\nproperty float y\nproperty float z\n"
#define PLY_FACE                 "element face 1\nproperty list uchar int vertex_indices\nend_header\n"

static void test_ply__ascii_is_read_with_every_name_of_a_pattern(void **state)
{
    (void)state;
    static const char *const NAME[][2] = {{"s", "t"}, {"u", "v"}, {"texture_u", "texture_v"}};
    for (size_t i = 0; i < COUNT(NAME); i++) {
        char text[512];
        snprintf(text, sizeof text,
                 PLY_HEAD("ascii", "comment hello\n" PLY_XYZ
                                   "property uchar red\nproperty float %s\nproperty float %s\n") PLY_FACE
                 "0 0 0 255 0 0\n1 0 0 0 2 0\r\n\n0 1 0.5 0 0 3\n3 0 1 2",
                 NAME[i][0], NAME[i][1]);
        struct mesh mesh = read_text(MESH_PLY, text);
        assert_int_equal(mesh.vertices, 3);
        assert_close(mesh.positions[8], 0.5, 0);
        assert_close(mesh.pattern[2], 2, 0);
        assert_close(mesh.pattern[5], 3, 0);
        assert_int_equal(mesh.triangle[1], 1);
        mesh_done(&mesh);
    }
}

/* A square of 4 corners with mixed types, in the given byte order. */
static size_t make_binary_ply(bool big, char ret[512])
{
    size_t n = (size_t)sprintf(
        ret,
        "ply\nformat binary_%s_endian 1.0\nelement vertex 4\nproperty double x\nproperty float y\n"
        "property short skip\nproperty float z\nelement face 1\nproperty uchar flag\n"
        "property list uchar ushort vertex_index\nend_header\n",
        big ? "big" : "little");
    for (int i = 0; i < 4; i++) {
        double x = i & 1 ? 1.5 : 0;
        float y = i & 2 ? -2.25f : 0, z = 0.1f;
        const struct {
            const void *at;
            size_t bytes;
        } part[] = {{&x, 8}, {&y, 4}, {"ab", 2}, {&z, 4}};
        for (size_t k = 0; k < COUNT(part); k++)
            for (size_t b = 0; b < part[k].bytes; b++)
                ret[n++] = ((const char *)part[k].at)[big ? part[k].bytes - 1 - b : b];
    }
    ret[n++] = 7;
    ret[n++] = 4;
    static const char CORNER[] = {0, 1, 3, 2};
    for (int i = 0; i < 4; i++) {
        ret[n++] = big ? 0 : CORNER[i];
        ret[n++] = big ? CORNER[i] : 0;
    }
    return n;
}

static void test_ply__binary_of_either_byte_order_is_read(void **state)
{
    (void)state;
    static const uint32_t FAN[] = {0, 1, 3, 0, 3, 2};
    for (int big = 0; big < 2; big++) {
        char data[512];
        struct mesh mesh = {0};
        struct problem problem;
        size_t n = make_binary_ply(big, data);
        if (parse_bytes(MESH_PLY, data, n, &mesh, &problem))
            fail_msg("%s", problem.detail);
        assert_int_equal(mesh.vertices, 4);
        assert_close(mesh.positions[3], 1.5, 0);
        assert_close(mesh.positions[7], -2.25, 0);
        assert_close(mesh.positions[11], (double)0.1f, 0);
        assert_memory_equal(mesh.triangle, FAN, sizeof FAN);
        mesh_done(&mesh);
    }
}

static void test_ply__every_cut_of_a_file_is_refused(void **state)
{
    (void)state;
    char data[512];
    for (int big = 0; big < 2; big++) {
        size_t n = make_binary_ply(big, data);
        for (size_t cut = 0; cut < n; cut++)
            expect_refusal(MESH_PLY, data, cut, "");
    }
}

static void test_ply__errors_name_the_line_byte_vertex_or_face(void **state)
{
    (void)state;
    static const struct {
        const char *text, *what;
    } CASE[] = {
        {"plx\n", "does not begin with"},
        {"ply\nformat ascii 2.0\nend_header\n", "line 2: unknown PLY format"},
        {"ply\nelement vertex 1\nend_header\n", "no format"},
        {"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "line 3"},
        {"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "line 3: a property before any element"},
        {PLY_HEAD("ascii", "property quad x\n") PLY_FACE, "line 4: unknown property type"},
        {PLY_HEAD("ascii", "property int x\n") PLY_FACE, "line 4: coordinates must be"},
        {PLY_HEAD("ascii", "property float x\nproperty float x\n") PLY_FACE,
         "line 5: a property given twice"},
        {PLY_HEAD("ascii", "property float x\n") PLY_FACE "0\n1\n2\n3 0 1 2\n", "no x, y and z"},
        {PLY_HEAD("ascii", PLY_XYZ) "end_header\n0 0 0\n1 0 0\n0 1 0\n", "one element face"},
        {PLY_HEAD("ascii", PLY_XYZ) PLY_FACE "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "face 0: 3 is no vertex"},
        {PLY_HEAD("ascii", PLY_XYZ) PLY_FACE "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", "face 0: -1 is no vertex"},
        {PLY_HEAD("ascii", PLY_XYZ) PLY_FACE "0 0 0\n1 0 0\n0 1 0\n3 0 1 1\n",
         "face 0 uses one vertex twice"},
        {PLY_HEAD("ascii", PLY_XYZ) PLY_FACE "0 0 0\n1 0 0\n0 1 0\n2 0 1\n", "line 13: a face with fewer"},
        {PLY_HEAD("ascii", PLY_XYZ) PLY_FACE "0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", "line 11: not a finite"},
        {PLY_HEAD("ascii", PLY_XYZ) PLY_FACE "0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "line 11: a number is missing"},
        {"ply\nformat ascii 1.0\nelement vertex 99999999999999\n" PLY_XYZ PLY_FACE "0 0 0\n",
         "the header promises 99999999999999"},
        {"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n" PLY_XYZ PLY_FACE "0123",
         "the header promises 4000000000"},
    };
    for (size_t i = 0; i < COUNT(CASE); i++)
        expect_refusal(MESH_PLY, CASE[i].text, strlen(CASE[i].text), CASE[i].what);
}

static void test_ply__binary_that_is_not_finite_is_refused(void **state)
{
    (void)state;
    char data[512];
    size_t n = make_binary_ply(false, data);
    memset(strstr(data, "end_header\n") + 11 + 18 + 8, 0xFF, 4); /* y of vertex 1 */
    expect_refusal(MESH_PLY, data, n, "vertex 1 is not finite");
}

/* ---- GLB --------------------------------------------------------------------------------------- */

#define BUFFERS "\"buffers\":[{\"byteLength\":66}],"
#define VIEWS                                                                                                \
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36},{\"buffer\":0,\"byteOffset\":36,\"byteLength\":24},"  \
    "{\"buffer\":0,\"byteOffset\":60,\"byteLength\":6}],"
#define ACCESSORS                                                                                            \
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"                \
    "{\"bufferView\":1,\"componentType\":5126,\"count\":3,\"type\":\"VEC2\"},"                               \
    "{\"bufferView\":2,\"componentType\":5123,\"count\":3,\"type\":\"SCALAR\"}],"
#define MESHES                                                                                               \
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1},\"indices\":2}]}]"
#define ASSET "{\"asset\":{\"version\":\"2.0\"},"

static void put_u32(char *at, size_t value)
{
    for (int i = 0; i < 4; i++)
        at[i] = (char)(value >> 8 * i & 0xFF);
}

/* A GLB around a document and the 66 bytes of a triangle, or `bin` instead. */
static size_t make_glb(const char *document, const void *bin, char ret[2048])
{
    float numbers[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 2};
    size_t json = (strlen(document) + 3) & ~(size_t)3;
    memcpy(ret, "glTF", 4);
    put_u32(ret + 4, 2);
    put_u32(ret + 8, 12 + 8 + json + 8 + 68);
    put_u32(ret + 12, json);
    memcpy(ret + 16, "JSON", 4);
    memset(ret + 20, ' ', json);
    memcpy(ret + 20, document, strlen(document));
    char *at = ret + 20 + json;
    put_u32(at, 68);
    memcpy(at + 4, "BIN", 4);
    memset(at + 8, 0, 68);
    memcpy(at + 8, bin ? bin : numbers, 60);
    at[8 + 62] = 1;
    at[8 + 64] = 2;
    return 20 + json + 8 + 68;
}

static void test_glb__indexed_triangles_with_a_pattern_are_read(void **state)
{
    (void)state;
    char data[2048];
    struct mesh mesh = {0};
    struct problem problem;
    size_t n = make_glb(ASSET BUFFERS VIEWS ACCESSORS MESHES "}", NULL, data);
    if (parse_bytes(MESH_GLB, data, n, &mesh, &problem))
        fail_msg("%s", problem.detail);
    assert_int_equal(mesh.vertices, 3);
    assert_close(mesh.positions[3], 1, 0);
    assert_close(mesh.pattern[5], 2, 0);
    assert_int_equal(mesh.triangle[2], 2);
    mesh_done(&mesh);
}

static void test_glb__every_cut_of_a_file_is_refused(void **state)
{
    (void)state;
    char data[2048];
    size_t n = make_glb(ASSET BUFFERS VIEWS ACCESSORS MESHES "}", NULL, data);
    for (size_t cut = 0; cut < n; cut++) {
        expect_refusal(MESH_GLB, data, cut, "");
        if (cut > 20 && cut < n - 2) { /* with a header that agrees, so that later checks are reached */
            char copy[2048];
            memcpy(copy, data, cut);
            put_u32(copy + 8, cut);
            struct mesh mesh = {0};
            struct problem problem;
            assert_int_equal(parse_bytes(MESH_GLB, copy, cut, &mesh, &problem), -1);
        }
    }
}

static void test_glb__what_cannot_be_read_is_refused_by_name(void **state)
{
    (void)state;
    static const struct {
        const char *document, *what;
    } CASE[] = {
        {ASSET BUFFERS VIEWS ACCESSORS "\"meshes\":[]}", "there is no mesh"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"extensionsRequired\":[\"KHR_draco_mesh_compression\"]}",
         "needs an extension"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{},{\"mesh\":0,\"scale\":[1,1]}]}",
         "node 1: its scale is not of 3 numbers"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":0,\"matrix\":[1,0,0]}]}",
         "node 0: its matrix is not of 16 numbers"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":0,\"rotation\":[0,0,0,2]}]}",
         "node 0: its rotation is no unit quaternion"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":0,\"translation\":[0,\"x\",0]}]}",
         "node 0: its translation is not of 3 numbers"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":1}]}", "mesh 1 is missing"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":0,\"children\":[1]}]}",
         "node 0: 1 is no node, there are 1"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"scenes\":[{\"nodes\":[0,0]}],\"nodes\":[{\"mesh\":0}]}",
         "node 0 is in the scene twice"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES
         ",\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0,\"children\":[1]},{\"children\":[0]}]}",
         "node 0 is in the scene twice"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"scenes\":[{\"nodes\":[1]}],\"nodes\":[{\"mesh\":0}]}",
         "the scene's node 1 does not exist"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"scenes\":[{\"nodes\":[1]}],\"nodes\":[{\"mesh\":0},{}]}",
         "there is no mesh in the scene"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES
         ",\"nodes\":[{\"mesh\":0,\"scale\":[1e308,1e308,1e308],\"translation\":[1e308,1e308,1e308]}]}",
         "vertex 1 is moved beyond all numbers"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES
         ",\"skins\":[{\"joints\":[1,2]}],\"nodes\":[{\"mesh\":0,\"skin\":0},{},{\"translation\":[0,1,0]}]}",
         "node 0 is in another posture"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES
         ",\"skins\":[{\"joints\":[3]}],\"nodes\":[{\"mesh\":0,\"skin\":0}]}",
         "joint 3 of its skin is not in the scene"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":0,\"skin\":0}]}",
         "node 0: its skin has no joints"},
        {ASSET BUFFERS VIEWS ACCESSORS MESHES
         ",\"skins\":[{\"joints\":[0],\"inverseBindMatrices\":0}],\"nodes\":[{\"mesh\":0,\"skin\":0}]}",
         "inverseBindMatrices: accessor 0 is missing or not of type MAT4"},
        {ASSET "\"buffers\":[{\"byteLength\":66,\"uri\":\"a.bin\"}]," VIEWS ACCESSORS MESHES "}",
         "own binary chunk"},
        {ASSET BUFFERS VIEWS ACCESSORS
         "\"meshes\":[{\"primitives\":[{\"mode\":1,\"attributes\":{\"POSITION\":0}}]}]}",
         "not of triangles"},
        {ASSET BUFFERS VIEWS ACCESSORS "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":9}}]}]}",
         "POSITION: accessor 9"},
        {ASSET BUFFERS VIEWS ACCESSORS "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":1}}]}]}",
         "POSITION: accessor 1"},
        {ASSET BUFFERS VIEWS
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}],"
         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
         "POSITION: 4 items reach past"},
        {ASSET BUFFERS VIEWS "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":"
                             "4611686018427387905,\"type\":\"VEC3\"}],"
                             "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
         "reach past"},
        {ASSET BUFFERS VIEWS
         "\"accessors\":[{\"bufferView\":0,\"byteOffset\":9223372036854775807,\"componentType\":5126,"
         "\"count\":1,"
         "\"type\":\"VEC3\"}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
         "reach past"},
        {ASSET BUFFERS
         "\"bufferViews\":[{\"buffer\":0,\"byteOffset\":9223372036854775807,\"byteLength\":36}],"
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
         "past the binary chunk"},
        {ASSET BUFFERS
         "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36,\"byteStride\":4}],"
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
         "byteStride 4"},
        {ASSET BUFFERS VIEWS "\"accessors\":[{\"sparse\":{},\"bufferView\":0,\"componentType\":5126,"
                             "\"count\":3,\"type\":\"VEC3\"}],"
                             "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
         "sparse"},
        {ASSET BUFFERS VIEWS
         "\"accessors\":[{\"bufferView\":0,\"componentType\":5125,\"count\":3,\"type\":\"VEC3\"}],"
         "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}",
         "must be floats"},
    };
    char data[2048];
    for (size_t i = 0; i < COUNT(CASE); i++)
        expect_refusal(MESH_GLB, data, make_glb(CASE[i].document, NULL, data), CASE[i].what);

    float bad[15] = {0, 0, 0, 1, 0, 0, 0, NAN, 0};
    expect_refusal(MESH_GLB, data, make_glb(ASSET BUFFERS VIEWS ACCESSORS MESHES "}", bad, data),
                   "POSITION of vertex 2 is not finite");
    size_t n = make_glb(ASSET BUFFERS VIEWS ACCESSORS MESHES "}", NULL, data);
    data[n - 4] = 3; /* the last index */
    expect_refusal(MESH_GLB, data, n, "triangle 0: 3 is no vertex");
}

/* ---- GLB scenes, as modelling programs write them ------------------------------------------------ */

static struct mesh read_glb(const char *document)
{
    char *data = malloc(strlen(document) + 256);
    struct mesh mesh = {0};
    struct problem problem;
    assert_non_null(data);
    if (parse_bytes(MESH_GLB, data, make_glb(document, NULL, data), &mesh, &problem))
        fail_msg("%s", problem.detail);
    free(data);
    return mesh;
}

static void assert_vertex(const struct mesh *mesh, size_t i, double x, double y, double z)
{
    assert_near(mesh->positions[3 * i], x, 1e-12, 1);
    assert_near(mesh->positions[3 * i + 1], y, 1e-12, 1);
    assert_near(mesh->positions[3 * i + 2], z, 1e-12, 1);
}

static void test_glb__nodes_scale_then_turn_then_move_and_their_parents_after_them(void **state)
{
    (void)state;
    /* A quarter turn about y takes x to -z. */
    struct mesh mesh = read_glb(
        ASSET BUFFERS VIEWS ACCESSORS MESHES
        ",\"scene\":1,\"scenes\":[{\"nodes\":[1]},{\"nodes\":[0]}],\"nodes\":[{\"translation\":[10,0,0],"
        "\"rotation\":[0,0.7071067811865476,0,0.7071067811865476],\"scale\":[2,3,4],\"children\":[2]},{"
        "\"mesh\":0},"
        "{\"mesh\":0,\"matrix\":[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,5,1]}]}");
    assert_int_equal(mesh.vertices, 3); /* the node of the other scene is not there */
    assert_vertex(&mesh, 0, 30, 0, 0);
    assert_vertex(&mesh, 1, 30, 0, -2);
    assert_vertex(&mesh, 2, 30, 3, 0);
    assert_close(mesh.pattern[5], 2, 0); /* the pattern is flat: nothing moves it */
    mesh_done(&mesh);
}

static void test_glb__a_mirrored_node_keeps_its_front(void **state)
{
    (void)state;
    struct mesh mesh =
        read_glb(ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":0,\"scale\":[-1,1,1]}]}");
    static const uint32_t TURNED[3] = {2, 1, 0};
    assert_memory_equal(mesh.triangle, TURNED, sizeof TURNED);
    assert_vertex(&mesh, 1, -1, 0, 0);
    mesh_done(&mesh);
}

static void test_glb__primitives_and_meshes_are_taken_one_after_the_other(void **state)
{
    (void)state;
    /* Two primitives of the same vertices, a mesh without indices and pattern, which two nodes show. */
    struct mesh mesh = read_glb(
        ASSET BUFFERS VIEWS ACCESSORS
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1},\"indices\":2},"
        "{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1},\"indices\":2}]},"
        "{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
        "\"nodes\":[{\"mesh\":0},{\"mesh\":1,\"translation\":[0,0,7]},{\"mesh\":1},{\"camera\":0}]}");
    static const uint32_t TRIANGLES[12] = {0, 1, 2, 0, 1, 2, 3, 4, 5, 6, 7, 8};
    assert_int_equal(mesh.vertices, 9);
    assert_int_equal(mesh.triangles, 4);
    assert_memory_equal(mesh.triangle, TRIANGLES, sizeof TRIANGLES);
    assert_vertex(&mesh, 4, 1, 0, 7);
    assert_vertex(&mesh, 7, 1, 0, 0);
    assert_null(mesh.pattern); /* not all have one */
    mesh_done(&mesh);
}

static void test_glb__meshes_without_nodes_are_taken_as_they_are(void **state)
{
    (void)state;
    struct mesh mesh =
        read_glb(ASSET BUFFERS VIEWS ACCESSORS
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":2}]},"
                 "{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}]}");
    assert_int_equal(mesh.vertices, 6);
    assert_int_equal(mesh.triangle[5], 5);
    mesh_done(&mesh);
}

static void test_glb__a_skin_as_it_was_bound_moves_the_mesh_whole(void **state)
{
    (void)state;
    /* Both joints went 3 m up: so did the mesh, wherever its own node is. */
    struct mesh mesh =
        read_glb(ASSET BUFFERS VIEWS ACCESSORS MESHES
                 ",\"skins\":[{\"joints\":[1,2]}],\"nodes\":[{\"mesh\":0,\"skin\":0,\"translation\":[9,9,9]},"
                 "{\"translation\":[0,3,0],\"children\":[2]},{\"scale\":[1,1,1]}]}");
    assert_vertex(&mesh, 1, 1, 3, 0);
    mesh_done(&mesh);
}

static void test_glb__views_may_be_interleaved_and_patterns_short(void **state)
{
    (void)state;
    /* x y z as floats and u v as shorts that stand for 0 to 1: 16 bytes a vertex. */
    char bin[68] = {0};
    static const float X[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const uint16_t UV[3][2] = {{0, 0}, {65535, 0}, {0, 13107}};
    for (size_t i = 0; i < 3; i++) {
        memcpy(bin + 16 * i, X[i], 12);
        memcpy(bin + 16 * i + 12, UV[i], 4);
    }
    char data[2048];
    struct mesh mesh = {0};
    struct problem problem;
    size_t n =
        make_glb(ASSET BUFFERS
                 "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48,\"byteStride\":16}],"
                 "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"},"
                 "{\"bufferView\":0,\"byteOffset\":12,\"componentType\":5123,\"normalized\":true,\"count\":3,"
                 "\"type\":\"VEC2\"}],"
                 "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":1}}]}]}",
                 bin, data);
    if (parse_bytes(MESH_GLB, data, n, &mesh, &problem))
        fail_msg("%s", problem.detail);
    assert_vertex(&mesh, 2, 0, 1, 0);
    assert_close(mesh.pattern[2], 1, 0);
    assert_close(mesh.pattern[5], 0.2, 0);
    mesh_done(&mesh);
}

/* A document whose list at %s has `n` of `item`, with commas between. */
static char *repeat(const char *before, const char *item, size_t n, const char *after)
{
    char *text = NULL;
    size_t bytes;
    FILE *file = open_memstream(&text, &bytes);
    assert_non_null(file);
    fputs(before, file);
    for (size_t i = 0; i < n; i++)
        fprintf(file, "%s%s", i > 0 ? "," : "", item);
    fputs(after, file);
    fclose(file);
    return text;
}

/* The document is read when it has `n` items and refused as `what` with one more. */
static void expect_limit(const char *before, const char *item, size_t n, const char *after, const char *what)
{
    char *text = repeat(before, item, n, after);
    struct mesh mesh = read_glb(text);
    mesh_done(&mesh);
    free(text);
    text = repeat(before, item, n + 1, after);
    char *data = malloc(strlen(text) + 256);
    assert_non_null(data);
    expect_refusal(MESH_GLB, data, make_glb(text, NULL, data), what);
    free(data);
    free(text);
}

static void test_glb__nodes_primitives_and_depth_have_their_limits(void **state)
{
    (void)state;
    expect_limit(ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[{\"mesh\":0},", "{}", 4095, "]}",
                 "more than 4096 nodes");
    expect_limit(ASSET BUFFERS VIEWS ACCESSORS "\"meshes\":[{\"primitives\":[",
                 "{\"attributes\":{\"POSITION\":0}}", 256, "]}]}", "more than 256 primitives");
    for (size_t depth = 128; depth <= 129; depth++) { /* node i has child i + 1, and the last the mesh */
        char *nodes = NULL, data[8192];
        size_t bytes;
        FILE *file = open_memstream(&nodes, &bytes);
        assert_non_null(file);
        fputs(ASSET BUFFERS VIEWS ACCESSORS MESHES ",\"nodes\":[", file);
        for (size_t i = 1; i < depth; i++)
            fprintf(file, "{\"children\":[%zu]},", i);
        fputs("{\"mesh\":0}]}", file);
        fclose(file);
        struct mesh mesh = {0};
        struct problem problem;
        assert_int_equal(parse_bytes(MESH_GLB, data, make_glb(nodes, NULL, data), &mesh, &problem),
                         depth == 128 ? 0 : -1);
        if (depth == 129)
            assert_non_null(strstr(problem.detail, "nested deeper than 128"));
        mesh_done(&mesh);
        free(nodes);
    }
}

/* ---- JSON -------------------------------------------------------------------------------------- */

static void test_meshjson__arrays_are_read_with_and_without_a_pattern(void **state)
{
    (void)state;
    struct mesh mesh = read_text(MESH_JSON, "{\"positions\":[0,0,0,1,0,0,0,1e0,-0.5],\"triangles\":[0,1,2],"
                                            "\"pattern\":[0,0,1,0,0,1]}");
    assert_close(mesh.positions[8], -0.5, 0);
    assert_close(mesh.pattern[5], 1, 0);
    mesh_done(&mesh);
    mesh = read_text(MESH_JSON, "{\"positions\":[0,0,0,1,0,0,0,1,0],\"triangles\":[0,1,2]}");
    assert_null(mesh.pattern);
    mesh_done(&mesh);
    static const char BAD[] = "{\"positions\":[0,0,0,1,0,0,0,1,0],\"triangles\":[0,1,3]}";
    expect_refusal(MESH_JSON, BAD, sizeof BAD - 1, "/triangles/2");
}

/* ---- limits, memory ---------------------------------------------------------------------------- */

static void test_meshfile__vertices_and_triangles_have_their_limits(void **state)
{
    (void)state;
    static const char SQUARE[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
    struct limits limits = limits_default;
    struct mesh mesh = {0};
    struct problem problem;
    limits.vertices = 4;
    limits.triangles = 2;
    assert_int_equal(meshfile_parse(MESH_OBJ, SQUARE, sizeof SQUARE - 1, &limits, &mesh, &problem), 0);
    mesh_done(&mesh);
    limits.vertices = 3;
    assert_int_equal(meshfile_parse(MESH_OBJ, SQUARE, sizeof SQUARE - 1, &limits, &mesh, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_TOO_LARGE);
    limits.vertices = 4;
    limits.triangles = 1;
    assert_int_equal(meshfile_parse(MESH_OBJ, SQUARE, sizeof SQUARE - 1, &limits, &mesh, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_TOO_LARGE);
}

/* ---- writing ----------------------------------------------------------------------------------- */

typedef int write_fn(FILE *file, const struct mesh *mesh, const double *normals);

static int write_glb(FILE *file, const struct mesh *mesh, const double *normals)
{
    return meshfile_write_glb(file, mesh, normals, NULL, "a \"name\" \xc3\xa4");
}

static int write_ply(FILE *file, const struct mesh *mesh, const double *normals)
{
    return meshfile_write_ply(file, mesh, normals, NULL);
}

static int write_json(FILE *file, const struct mesh *mesh, const double *normals)
{
    (void)normals;
    return meshfile_write_json(file, mesh);
}

/* From each format to each: a number that was printed once is printed the same for ever. */
static void test_meshfile__a_mesh_goes_through_every_format_unchanged(void **state)
{
    (void)state;
    for (int via = 0; via < MESH_FORMATS; via++)
        for (int pattern = 0; pattern < 2; pattern++) {
            struct mesh mesh = make_strip(10), back = {0};
            struct problem problem;
            char *first = NULL, *second = NULL;
            size_t first_bytes, second_bytes;
            if (!pattern) {
                free(mesh.pattern);
                mesh.pattern = NULL;
            }
            for (size_t i = 0; i < 3 * mesh.vertices; i++)
                mesh.positions[i] =
                    (double)(float)mesh.positions[i] + 0; /* as PLY and GLB hold them; no -0 */
            for (size_t i = 0; pattern && i < 2 * mesh.vertices; i++)
                mesh.pattern[i] = (double)(float)mesh.pattern[i];
            FILE *file = open_memstream(&first, &first_bytes);
            assert_int_equal(meshfile_write((enum mesh_format)via, file, &mesh), 0);
            fclose(file);
            if (parse_bytes((enum mesh_format)via, first, first_bytes, &back, &problem))
                fail_msg("%s", problem.detail);
            file = open_memstream(&second, &second_bytes);
            assert_int_equal(meshfile_write((enum mesh_format)via, file, &back), 0);
            fclose(file);
            assert_int_equal(first_bytes, second_bytes);
            assert_memory_equal(first, second, first_bytes);
            /* 9 digits or 32 bits: as floats nothing has changed. */
            for (size_t i = 0; i < 3 * mesh.vertices; i++)
                assert_true((float)mesh.positions[i] == (float)back.positions[i]);
            for (size_t i = 0; pattern && i < 2 * mesh.vertices; i++)
                assert_true((float)mesh.pattern[i] == (float)back.pattern[i]);
            assert_memory_equal(mesh.triangle, back.triangle, 3 * mesh.triangles * sizeof *mesh.triangle);
            mesh_done(&mesh);
            mesh_done(&back);
            free(first);
            free(second);
        }
}

static void test_meshfile__what_is_written_reads_back(void **state)
{
    (void)state;
    static const struct {
        enum mesh_format format;
        write_fn *write;
        double tolerance;
    } CASE[] = {{MESH_OBJ, meshfile_write_obj, 1e-8},
                {MESH_PLY, write_ply, 1e-7},
                {MESH_GLB, write_glb, 1e-7},
                {MESH_JSON, write_json, 1e-8}};
    for (size_t i = 0; i < COUNT(CASE); i++)
        for (int variant = 0; variant < 4; variant++) { /* with and without pattern and normals */
            struct mesh mesh = make_strip(10), back = {0};
            struct problem problem;
            char *data = NULL;
            size_t bytes = 0;
            double *normals = variant & 1 ? calloc(3 * mesh.vertices, sizeof(double)) : NULL;
            if (!(variant & 2)) {
                free(mesh.pattern);
                mesh.pattern = NULL;
            }
            FILE *file = open_memstream(&data, &bytes);
            assert_int_equal(CASE[i].write(file, &mesh, normals), 0);
            fclose(file);
            if (parse_bytes(CASE[i].format, data, bytes, &back, &problem))
                fail_msg("%s", problem.detail);
            assert_same_mesh(&mesh, &back, CASE[i].tolerance);
            mesh_done(&mesh);
            mesh_done(&back);
            free(normals);
            free(data);
        }
}

static void test_meshfile__a_full_disk_shows(void **state)
{
    (void)state;
    struct mesh mesh = make_strip(10000);
    write_fn *const WRITE[] = {meshfile_write_obj, write_ply, write_glb, write_json};
    for (size_t i = 0; i < COUNT(WRITE); i++) {
        FILE *file = fopen("/dev/full", "w");
        assert_non_null(file);
        assert_int_equal(WRITE[i](file, &mesh, NULL), -1);
        fclose(file);
    }
    mesh_done(&mesh);
}

/* 4.4 and 3.6 of the glTF 2.0 specification, by hand: lengths, alignment, bounds of POSITION. */
static void test_glb__written_file_keeps_the_rules_of_gltf(void **state)
{
    (void)state;
    struct mesh mesh = make_strip(3);
    double *normals = calloc(3 * mesh.vertices, sizeof(double));
    char *data = NULL;
    size_t bytes = 0;
    uint32_t word[5];
    FILE *file = open_memstream(&data, &bytes);
    assert_int_equal(meshfile_write_glb(file, &mesh, normals, NULL, ""), 0);
    fclose(file);
    memcpy(word, data, sizeof word);
    assert_int_equal(word[0], 0x46546C67);
    assert_int_equal(word[1], 2);
    assert_int_equal(word[2], bytes);
    assert_int_equal(word[3] % 4, 0);
    json_t *root = json_loadb(data + 20, word[3], 0, NULL);
    assert_non_null(root);
    assert_string_equal(json_string_value(json_object_get(json_object_get(root, "asset"), "generator")),
                        "draped");
    const json_t *accessors = json_object_get(root, "accessors"), *first = json_array_get(accessors, 0);
    assert_int_equal(json_array_size(accessors), 4);
    double low = json_number_value(json_array_get(json_object_get(first, "min"), 1));
    double high = json_number_value(json_array_get(json_object_get(first, "max"), 0));
    assert_close(low, (double)(float)(-9. / 49), 0); /* exactly the floats that are stored */
    assert_close(high, (double)(float)(3. / 7), 0);
    const json_t *material = json_array_get(json_object_get(root, "materials"), 0);
    assert_true(json_is_true(json_object_get(material, "doubleSided")));
    size_t i, end = 0;
    json_t *view;
    json_array_foreach(json_object_get(root, "bufferViews"), i, view)
    {
        size_t offset = (size_t)json_integer_value(json_object_get(view, "byteOffset"));
        assert_int_equal(offset, end);
        assert_int_equal(offset % 4, 0);
        end = offset + (size_t)json_integer_value(json_object_get(view, "byteLength"));
    }
    assert_int_equal(20 + word[3] + 8 + end, bytes);
    json_decref(root);
    free(normals);
    free(data);
    mesh_done(&mesh);
}

/* ---- real files -------------------------------------------------------------------------------- */

static char *read_file(const char *path, size_t *ret_bytes)
{
    FILE *file = fopen(path, "rb");
    if (!file) {
        print_message("SKIP: %s is not there\n", path);
        return NULL;
    }
    char *data = malloc((size_t)2 << 20);
    *ret_bytes = fread(data, 1, (size_t)2 << 20, file);
    fclose(file);
    return data;
}

static void test_meshfile__garment_and_body_of_the_shared_data_are_read(void **state)
{
    (void)state;
    static const struct {
        const char *path;
        size_t vertices, triangles;
        bool pattern;
    } CASE[] = {{"../shared/data/garments/shirt_coarse.obj", 943, 1546, true},
                {"../shared/data/garments/shirt.obj", 5352, 9906, true},
                {"../shared/data/bodies/body_f_A.obj", 13380, 26756, false}};
    for (size_t i = 0; i < COUNT(CASE); i++) {
        size_t bytes = 0;
        char *data = read_file(CASE[i].path, &bytes);
        if (!data)
            skip();
        struct mesh mesh = {0};
        struct problem problem;
        if (parse_bytes(MESH_OBJ, data, bytes, &mesh, &problem))
            fail_msg("%s: %s", CASE[i].path, problem.detail);
        assert_int_equal(mesh.vertices, CASE[i].vertices);
        assert_int_equal(mesh.triangles, CASE[i].triangles);
        assert_int_equal(mesh.pattern != NULL, CASE[i].pattern);
        mesh_done(&mesh);
        free(data);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_meshfile__formats_are_known_by_name_and_media_type),
        cmocka_unit_test(test_obj__corners_of_every_form_are_read),
        cmocka_unit_test(test_obj__polygons_become_fans),
        cmocka_unit_test(test_obj__comments_blank_lines_crlf_and_extra_numbers_are_no_matter),
        cmocka_unit_test(test_obj__pattern_may_be_shared_or_repeated_but_not_differ),
        cmocka_unit_test(test_obj__errors_name_the_line),
        cmocka_unit_test(test_obj__numbers_round_as_strtod_does),
        cmocka_unit_test(test_obj__a_comma_locale_changes_nothing),
        cmocka_unit_test(test_ply__ascii_is_read_with_every_name_of_a_pattern),
        cmocka_unit_test(test_ply__binary_of_either_byte_order_is_read),
        cmocka_unit_test(test_ply__every_cut_of_a_file_is_refused),
        cmocka_unit_test(test_ply__errors_name_the_line_byte_vertex_or_face),
        cmocka_unit_test(test_ply__binary_that_is_not_finite_is_refused),
        cmocka_unit_test(test_glb__indexed_triangles_with_a_pattern_are_read),
        cmocka_unit_test(test_glb__every_cut_of_a_file_is_refused),
        cmocka_unit_test(test_glb__what_cannot_be_read_is_refused_by_name),
        cmocka_unit_test(test_glb__nodes_scale_then_turn_then_move_and_their_parents_after_them),
        cmocka_unit_test(test_glb__a_mirrored_node_keeps_its_front),
        cmocka_unit_test(test_glb__primitives_and_meshes_are_taken_one_after_the_other),
        cmocka_unit_test(test_glb__meshes_without_nodes_are_taken_as_they_are),
        cmocka_unit_test(test_glb__a_skin_as_it_was_bound_moves_the_mesh_whole),
        cmocka_unit_test(test_glb__views_may_be_interleaved_and_patterns_short),
        cmocka_unit_test(test_glb__nodes_primitives_and_depth_have_their_limits),
        cmocka_unit_test(test_meshjson__arrays_are_read_with_and_without_a_pattern),
        cmocka_unit_test(test_meshfile__vertices_and_triangles_have_their_limits),
        cmocka_unit_test(test_meshfile__a_mesh_goes_through_every_format_unchanged),
        cmocka_unit_test(test_meshfile__what_is_written_reads_back),
        cmocka_unit_test(test_meshfile__a_full_disk_shows),
        cmocka_unit_test(test_glb__written_file_keeps_the_rules_of_gltf),
        cmocka_unit_test(test_meshfile__garment_and_body_of_the_shared_data_are_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
