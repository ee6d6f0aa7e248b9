/* test_multipart.c - the file in a form: found as it is, or the byte named at which the form is none. */
#include "test.h"

#include "multipart.h"

#define NL          "\r\n"
#define DISPOSITION "Content-Disposition: form-data; name=\"mesh\"; filename=\"a.obj\"" NL
#define HEAD        "--b" NL DISPOSITION "Content-Type: model/obj" NL NL

static void parse(const char *body, size_t bytes, const char *boundary, struct multipart_file *ret)
{
    struct problem problem = {0};
    /* the body flush against the end of a block: a byte too far shows under ASan */
    char *copy = malloc(bytes ? bytes : 1);
    assert_non_null(copy);
    memcpy(copy, body, bytes);
    int rc = multipart_parse(copy, bytes, boundary, ret, &problem);
    if (rc != 0)
        fail_msg("refused: %s", problem.detail);
    ret->data = body + (ret->data - copy);
    free(copy);
}

static void check_file(const char *body, const char *data)
{
    struct multipart_file file;
    parse(body, strlen(body), "b", &file);
    assert_int_equal(file.bytes, strlen(data));
    assert_memory_equal(file.data, data, file.bytes);
}

static void test_multipart__a_form_as_curl_sends_it(void **state)
{
    (void)state;
    static const char body[] = "--------------------------0123456789abcdef" NL
                               "Content-Disposition: form-data; name=\"mesh\"; filename=\"shirt.obj\"" NL
                               "Content-Type: application/octet-stream" NL NL "v 0 0 0\nv 1 0 0\n" NL
                               "--------------------------0123456789abcdef--" NL;
    struct multipart_file file;
    parse(body, sizeof body - 1, "------------------------0123456789abcdef", &file);
    assert_int_equal(file.bytes, 16);
    assert_memory_equal(file.data, "v 0 0 0\nv 1 0 0\n", 16);
    assert_string_equal(file.type, "application/octet-stream");
    assert_string_equal(file.filename, "shirt.obj");
}

static void test_multipart__data_may_hold_anything_but_the_boundary(void **state)
{
    (void)state;
    check_file(HEAD NL "--b--", "");
    check_file(HEAD NL "--b--" NL, "");
    check_file(HEAD "x" NL "--b--", "x");
    check_file(HEAD "\r\n" NL "--b--", "\r\n");
    check_file(HEAD "a\r\n-\r\n--\r\n--B\r\n--bb\r\n--b-\r\n--b--x\r\n--b y" NL "--b--",
               "a\r\n-\r\n--\r\n--B\r\n--bb\r\n--b-\r\n--b--x\r\n--b y");
    check_file(HEAD "--b--" NL "--b--", "--b--"); /* not at the start of a line */
    check_file(HEAD "\n--b--\r--b--" NL "--b--", "\n--b--\r--b--");
    check_file("--b \t" NL DISPOSITION NL "x" NL "--b-- \t" NL, "x"); /* RFC 2046: transport padding */
    struct multipart_file file;
    static const char zeros[] = HEAD "\0\0" NL "--b--";
    parse(zeros, sizeof zeros - 1, "b", &file);
    assert_int_equal(file.bytes, 2);
}

static void test_multipart__names_are_read_however_they_are_written(void **state)
{
    (void)state;
    static const struct {
        const char *disposition, *filename;
    } row[] = {
        {"form-data; name=mesh; filename=a.ply", "a.ply"},
        {"form-data;name=\"mesh\";filename=\"a b.glb\"", "a b.glb"},
        {"form-data; filename=\"q\\\"uote.obj\"; name=\"\"", "q\"uote.obj"},
        {"Form-Data ; NAME=x ; FileName=\"c:\\\\d\\\\e.obj\"", "c:\\d\\e.obj"},
        {"form-data; name=x; filename*=utf-8''e.obj", ""},
        {"form-data; name=x; filename=\"\"", ""},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        char body[512];
        struct multipart_file file;
        snprintf(body, sizeof body, "--b" NL "content-disposition:%s  " NL NL "x" NL "--b--",
                 row[i].disposition);
        parse(body, strlen(body), "b", &file);
        assert_string_equal(file.filename, row[i].filename);
        assert_string_equal(file.type, "");
    }
}

static void test_multipart__a_long_name_keeps_its_end(void **state)
{
    (void)state;
    char body[1024], name[600];
    struct multipart_file file;
    memset(name, 'a', sizeof name);
    memcpy(name + sizeof name - 5, ".obj", 5);
    snprintf(body, sizeof body,
             "--b" NL "Content-Disposition: form-data; name=x; filename=\"%s\"" NL NL "x" NL "--b--", name);
    parse(body, strlen(body), "b", &file);
    assert_int_equal(strlen(file.filename), sizeof file.filename - 1);
    assert_string_equal(file.filename + sizeof file.filename - 5, ".obj");
}

/* `at`: the byte that the refusal must name. */
static void refused(const char *body, size_t bytes, size_t at, const char *why)
{
    struct multipart_file file;
    struct problem problem = {0};
    char wanted[32];
    char *copy = malloc(bytes ? bytes : 1);
    assert_non_null(copy);
    memcpy(copy, body, bytes);
    snprintf(wanted, sizeof wanted, "Byte %zu of the form: ", at);
    int rc = multipart_parse(copy, bytes, "b", &file, &problem);
    free(copy);
    if (rc != -1 || problem.code != PROBLEM_BAD_REQUEST ||
        strncmp(problem.detail, wanted, strlen(wanted)) != 0 || strstr(problem.detail, why) == NULL)
        fail_msg("\"%.60s\": got %d, \"%s\"; wanted \"%s...%s\"", body, rc, problem.detail, wanted, why);
}

static void test_multipart__what_is_no_form_is_refused_at_its_byte(void **state)
{
    (void)state;
    static const struct {
        const char *body;
        size_t at;
        const char *why;
    } row[] = {
        {"", 0, "begin with the boundary"},
        {"x", 0, "begin with the boundary"},
        {"--b", 0, "begin with the boundary"},
        {"--b\n" DISPOSITION NL "x" NL "--b--", 0, "begin with the boundary"},
        {NL HEAD "x" NL "--b--", 0, "begin with the boundary"},
        {"--b--" NL, 0, "begin with the boundary"},
        {"--bb" NL DISPOSITION NL "x" NL "--bb--", 0, "begin with the boundary"},
        {"--b" NL, 5, "does not end"},
        {"--b" NL DISPOSITION, 5 + sizeof DISPOSITION - 1, "does not end"},
        {"--b" NL NL "x" NL "--b--", 5, "without Content-Disposition"},
        {"--b" NL "Content-Type: model/obj" NL NL "x" NL "--b--", 5, "without Content-Disposition"},
        {"--b" NL DISPOSITION DISPOSITION NL "x" NL "--b--", 5 + sizeof DISPOSITION - 1, "given twice"},
        {"--b" NL DISPOSITION "Content-Type: a/b" NL "Content-Type: a/b" NL NL "x" NL "--b--",
         5 + sizeof DISPOSITION - 1 + 19, "given twice"},
        {"--b" NL "Content-Disposition: attachment; name=x" NL NL "x" NL "--b--", 5, "must be form-data"},
        {"--b" NL "Content-Disposition: form-data" NL NL "x" NL "--b--", 5, "with a name"},
        {"--b" NL "Content-Disposition: form-data; name" NL NL "x" NL "--b--", 5, "with a name"},
        {"--b" NL "Content-Disposition: form-data; name=\"x" NL NL "x" NL "--b--", 5, "with a name"},
        {"--b" NL "Content-Disposition: form-datax; name=x" NL NL "x" NL "--b--", 5, "must be form-data"},
        {"--b" NL "Content-Disposition: form-data; name=" NL NL "x" NL "--b--", 5, "with a name"},
        {"--b" NL DISPOSITION "Content-Transfer-Encoding: base64" NL NL "x" NL "--b--",
         5 + sizeof DISPOSITION - 1, "as it is"},
        {"--b" NL DISPOSITION " folded" NL NL "x" NL "--b--", 5 + sizeof DISPOSITION - 1, "no header"},
        {"--b" NL "no header" NL NL "x" NL "--b--", 5, "no header"},
        {"--b" NL "X : y" NL NL "x" NL "--b--", 5, "no header"},
        {"--b" NL "X: a\nb" NL NL "x" NL "--b--", 9, "control character"},
        {HEAD "x", sizeof HEAD - 1 + 1, "last boundary is missing"},
        {HEAD "x" NL "--b", sizeof HEAD - 1 + 6, "last boundary is missing"},
        {HEAD "x" NL "--b-", sizeof HEAD - 1 + 7, "last boundary is missing"},
        {HEAD "x" NL "--b" NL DISPOSITION NL "y" NL "--b--", sizeof HEAD - 1 + 8, "a second part"},
        {HEAD "x" NL "--b--" NL "epilogue", sizeof HEAD - 1 + 10, "behind the last boundary"},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++)
        refused(row[i].body, strlen(row[i].body), row[i].at, row[i].why);
    static const char zero[] = "--b" NL "X: a\0b" NL NL "x" NL "--b--";
    refused(zero, sizeof zero - 1, 9, "control character");
}

static void test_multipart__every_beginning_of_a_form_is_refused(void **state)
{
    (void)state;
    static const char body[] = HEAD "data" NL "--b--";
    struct multipart_file file;
    struct problem problem;
    for (size_t n = 0; n < sizeof body - 1; n++) {
        char *copy = malloc(n ? n : 1);
        assert_non_null(copy);
        memcpy(copy, body, n);
        assert_int_equal(multipart_parse(copy, n, "b", &file, &problem), -1);
        free(copy);
    }
}

static void test_multipart__the_header_is_bounded(void **state)
{
    (void)state;
    char body[2 * MULTIPART_MAX_HEADERS], fill[MULTIPART_MAX_HEADERS + 1];
    struct multipart_file file;
    struct problem problem;
    size_t rest = sizeof DISPOSITION - 1 + strlen("X: " NL NL);
    memset(fill, 'x', sizeof fill);
    for (int over = 0; over < 2; over++) {
        int n = snprintf(body, sizeof body, "--b" NL DISPOSITION "X: %.*s" NL NL "x" NL "--b--",
                         (int)(MULTIPART_MAX_HEADERS - rest) + over, fill);
        assert_int_equal(multipart_parse(body, (size_t)n, "b", &file, &problem), -over);
    }
    assert_non_null(strstr(problem.detail, "too long"));
}

static void test_multipart__the_boundary_is_read_and_checked(void **state)
{
    (void)state;
    char boundary[MULTIPART_BOUNDARY_SIZE], type[256], longest[72];
    struct problem problem;
    static const struct {
        const char *type, *boundary; /* NULL: refused */
    } row[] = {
        {"multipart/form-data; boundary=abc", "abc"},
        {"Multipart/Form-Data;BOUNDARY=\"a b:c\" ; charset=utf-8", "a b:c"},
        {"multipart/form-data; charset=utf-8; boundary=----WebKitFormBoundaryABC",
         "----WebKitFormBoundaryABC"},
        {"multipart/form-data; boundary=\"a\\'b\"", "a'b"},
        {"multipart/form-data", NULL},
        {"multipart/form-data;", NULL},
        {"multipart/form-data; boundary=", NULL},
        {"multipart/form-data; boundary=\"\"", NULL},
        {"multipart/form-data; boundary=\"a", NULL},
        {"multipart/form-data; boundary=\"a \"", NULL},
        {"multipart/form-data; boundary=\"a\\\"b\"", NULL},
        {"multipart/form-data; boundary=a b", NULL},
        {"multipart/form-data; boundary=a; boundary=b", NULL},
        {"multipart/form-data boundary=a", NULL},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        int rc = multipart_boundary(row[i].type, boundary, &problem);
        if (rc != (row[i].boundary == NULL ? -1 : 0) || (rc == 0 && strcmp(boundary, row[i].boundary) != 0))
            fail_msg("%s: %d", row[i].type, rc);
    }
    assert_int_equal(multipart_boundary(NULL, boundary, &problem), 1);
    assert_int_equal(multipart_boundary("model/obj", boundary, &problem), 1);
    assert_int_equal(multipart_boundary("multipart/form-data2; boundary=a", boundary, &problem), 1);
    assert_int_equal(multipart_boundary("multipart/mixed; boundary=a", boundary, &problem), 1);
    memset(longest, 'x', sizeof longest);
    for (int n = 70; n <= 71; n++) {
        snprintf(type, sizeof type, "multipart/form-data; boundary=%.*s", n, longest);
        assert_int_equal(multipart_boundary(type, boundary, &problem), n == 70 ? 0 : -1);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_multipart__a_form_as_curl_sends_it),
        cmocka_unit_test(test_multipart__data_may_hold_anything_but_the_boundary),
        cmocka_unit_test(test_multipart__names_are_read_however_they_are_written),
        cmocka_unit_test(test_multipart__a_long_name_keeps_its_end),
        cmocka_unit_test(test_multipart__what_is_no_form_is_refused_at_its_byte),
        cmocka_unit_test(test_multipart__every_beginning_of_a_form_is_refused),
        cmocka_unit_test(test_multipart__the_header_is_bounded),
        cmocka_unit_test(test_multipart__the_boundary_is_read_and_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
