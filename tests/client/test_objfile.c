/* test_objfile.c - OBJ and seam files: what is read, and that each refusal names its line. */
#include "test.h"

#include <unistd.h>

#include "objfile.h"

/* Writes `text` to a new temporary file; its path in `ret`. */
static void write_file(const char *text, char ret[64])
{
    snprintf(ret, 64, "/tmp/drape-test-XXXXXX");
    int file = mkstemp(ret);
    assert_true(file >= 0);
    assert_int_equal(write(file, text, strlen(text)), (long)strlen(text));
    close(file);
}

static int read_text(const char *text, bool with_pattern, struct surface *ret, struct failure *failure)
{
    char path[64];
    write_file(text, path);
    int status = objfile_read(path, with_pattern, ret, failure);
    unlink(path);
    return status;
}

static void test_objfile__reads_polygons_patterns_and_negative_indices(void **state)
{
    struct surface s;
    struct failure failure;
    (void)state;
    assert_int_equal(
        read_text("# a quad and a triangle\r\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0\n  v 0 1e0 0\nv 2 0 -1\n"
                  "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 2 .5\ng panel\n"
                  "f 1/1 2/2 3/3 4/4\nf -4/-4/1 -1/-1/1 -3/-3/1\n",
                  true, &s, &failure),
        0);
    const uint32_t expected[9] = {0, 1, 2, 0, 2, 3, 1, 4, 2};
    assert_int_equal(s.vertices, 5);
    assert_int_equal(s.triangles, 3);
    assert_memory_equal(s.triangle, expected, sizeof expected);
    assert_close(s.positions[14], -1, 0);
    assert_close(s.pattern[9], 0.5, 0);
    surface_done(&s);
    assert_int_equal(read_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nf 1//1 2//1 3//1\n", false, &s, &failure), 0);
    assert_null(s.pattern);
    surface_done(&s);
}

static void check_refusal(const char *text, bool with_pattern, const char *line, const char *word)
{
    struct surface s;
    struct failure failure;
    assert_int_equal(read_text(text, with_pattern, &s, &failure), -1);
    assert_int_equal(failure.code, EXIT_USAGE);
    if (!strstr(failure.message, line) || !strstr(failure.message, word)) {
        print_error("\"%s\" has no \"%s\" and \"%s\"\n", failure.message, line, word);
        fail();
    }
}

static void test_objfile__refusals_name_the_line(void **state)
{
    (void)state;
    check_refusal("v 0 0 0\nv 1 x 0\n", false, ":2:", "3 finite numbers");
    check_refusal("v 0 0 nan\n", false, ":1:", "finite");
    check_refusal("v 0 0 0\n\nf 1 1 2\n", false, ":3:", "vertex 2 does not exist");
    check_refusal("v 0 0 0\nf 0 1 1\n", false, ":2:", "vertex 0 does not exist");
    check_refusal("v 0 0 0\nf 1 -2 1\n", false, ":2:", "vertex -2 does not exist");
    check_refusal("v 0 0 0\nv 1 0 0\nf 1 2\n", false, ":3:", "2 corners");
    check_refusal("v 0 0 0\nf 1 a 1\n", false, ":2:", "vertex number");
    check_refusal("v 0 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 3\n", true, ":4:", "no vt");
    check_refusal("v 0 0 0\nv 0 1 0\nv 1 0 0\nvt 0 0\nf 1/1 2/2 3/1\n", true, ":5:", "vt 2 does not exist");
    check_refusal("v 0 0 0\nv 0 1 0\nv 1 0 0\nvt 0 0\nvt 1 0\nf 1/1 2/1 3/1\nf 1/2 3/1 2/1\n", true,
                  ":7:", "vt 1 and vt 2");
    check_refusal("v 0 0 0\nv 0 1 0\nv 1 0 0\nv 1 1 1\nvt 0 0\nf 1/1 2/1 3/1\n", true, "vertex 4", "no face");
    check_refusal("hello\n", false, "no faces", "OBJ");
}

static int read_line_text(const char *text, struct objfile_line **line, size_t *lines,
                          struct failure *failure)
{
    char path[64];
    write_file(text, path);
    int status = objfile_read_lines(path, 10, line, lines, failure);
    unlink(path);
    return status;
}

static void test_objfile__reads_lines_to_be_measured(void **state)
{
    (void)state;
    struct failure failure = {0};
    struct objfile_line *line = NULL;
    size_t lines = 0;
    assert_int_equal(read_line_text("# measures\nwaist 1 10 5 1\n\n  hem\t2 3\n", &line, &lines, &failure),
                     0);
    assert_int_equal(lines, 2);
    assert_string_equal(line[0].name, "waist");
    assert_int_equal(line[0].vertices, 4);
    assert_int_equal(line[0].vertex[1], 9);
    assert_string_equal(line[1].name, "hem");
    assert_int_equal(line[1].vertex[0], 1);
    for (size_t i = 0; i < lines; i++) {
        objfile_line_done(&line[i]);
    }
    free(line);
    const char *const wrong[] = {"hem 1 2\nwaist 1 11\n", "waist 0\n", "waist 1 two\n"};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        assert_int_equal(read_line_text(wrong[i], &line, &lines, &failure), -1);
        assert_non_null(strstr(failure.message, i == 0 ? ":2: vertex 11" : ":1: "));
    }
}

static int read_seam_text(const char *text, uint32_t **seam, size_t *seams, struct failure *failure)
{
    char path[64];
    write_file(text, path);
    int status = objfile_read_seams(path, 10, seam, seams, failure);
    unlink(path);
    return status;
}

static void test_objfile__reads_seams_from_one(void **state)
{
    uint32_t *seam = NULL;
    size_t seams = 0;
    struct failure failure;
    (void)state;
    assert_int_equal(read_seam_text("# i j stitch\n1 10 0\n\n  2 9 0\n", &seam, &seams, &failure), 0);
    const uint32_t expected[4] = {0, 9, 1, 8};
    assert_int_equal(seams, 2);
    assert_memory_equal(seam, expected, sizeof expected);
    free(seam);
    const char *const wrong[] = {"1 2\n0 3\n", "1 2\n3 11\n", "1 2\n3\n", "1 2\nx y\n"};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        assert_int_equal(read_seam_text(wrong[i], &seam, &seams, &failure), -1);
        assert_non_null(strstr(failure.message, ":2:"));
    }
}

static void test_objfile__names_a_file_that_is_not_there(void **state)
{
    struct surface s;
    struct failure failure;
    (void)state;
    assert_int_equal(objfile_read("/nowhere/a.obj", false, &s, &failure), -1);
    assert_non_null(strstr(failure.message, "/nowhere/a.obj"));
}

static void test_objfile__reads_the_shared_shirt(void **state)
{
    const char *path = "../shared/data/garments/shirt_coarse.obj";
    struct surface s;
    struct failure failure;
    uint32_t *seam = NULL;
    size_t seams = 0;
    (void)state;
    if (access(path, R_OK) != 0) {
        print_message("SKIP: %s is not there\n", path);
        return;
    }
    assert_int_equal(objfile_read(path, true, &s, &failure), 0);
    assert_int_equal(s.vertices, 943);
    assert_int_equal(s.triangles, 1546);
    assert_int_equal(
        objfile_read_seams("../shared/data/garments/shirt_coarse.seams", s.vertices, &seam, &seams, &failure),
        0);
    assert_int_equal(seams, 135);
    free(seam);
    surface_done(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_objfile__reads_polygons_patterns_and_negative_indices),
        cmocka_unit_test(test_objfile__refusals_name_the_line),
        cmocka_unit_test(test_objfile__reads_lines_to_be_measured),
        cmocka_unit_test(test_objfile__reads_seams_from_one),
        cmocka_unit_test(test_objfile__names_a_file_that_is_not_there),
        cmocka_unit_test(test_objfile__reads_the_shared_shirt),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
