/* test_cli.c - the program as a person or a script calls it: exit codes, standard output and error. */
#include "test.h"

#include <fcntl.h>
#include <jansson.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cli.h"

enum { MAX_OUTPUT = 1 << 20 };

static char output[MAX_OUTPUT], errors[MAX_OUTPUT];

static void read_back(int file, char *ret)
{
    ssize_t n = pread(file, ret, MAX_OUTPUT - 1, 0);
    assert_true(n >= 0);
    ret[n] = '\0';
    close(file);
}

static int temporary_file(void)
{
    char path[] = "/tmp/drape-test-XXXXXX";
    int file = mkstemp(path);
    assert_true(file >= 0);
    unlink(path);
    return file;
}

/* Runs `drape` with the words of `line` in a process of its own (argp ends it); its exit code. */
static int drape(const char *line)
{
    char text[512], *argv[32] = {(char[]){"drape"}};
    int argc = 1, out = temporary_file(), err = temporary_file(), status = 0;
    snprintf(text, sizeof text, "%s", line);
    for (char *word = strtok(text, " "); word; word = strtok(NULL, " ")) {
        argv[argc++] = word;
    }
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        dup2(out, STDOUT_FILENO);
        dup2(err, STDERR_FILENO);
        setenv("DRAPED_URL", "http://127.0.0.1:1", 1); /* nobody there */
        exit(cli_run(argc, argv));
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    read_back(out, output);
    read_back(err, errors);
    return WEXITSTATUS(status);
}

static void test_cli__every_command_has_help(void **state)
{
    const char *const names[] = {"",       "example", "scene",  "run",  "submit",    "watch",   "status",
                                 "result", "trace",   "cancel", "list", "materials", "picture", "compare"};
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        char line[64];
        snprintf(line, sizeof line, "%s --help", names[i]);
        assert_int_equal(drape(line), 0);
        assert_non_null(strstr(output, "Usage: drape"));
        assert_non_null(strstr(output, "--url"));
        assert_non_null(strstr(output, names[i]));
    }
    assert_int_equal(drape("--version"), 0);
}

static void test_cli__wrong_arguments_exit_with_1_and_say_why(void **state)
{
    const struct {
        const char *line, *words;
    } wrong[] = {
        {"", "no command"},
        {"drapery", "no command \"drapery\""},
        {"example", "which example"},
        {"example square arc", "one example"},
        {"example triangle", "no example \"triangle\""},
        {"example square -n 0", "--triangles takes"},
        {"example square -n 1e3", "--triangles takes"},
        {"example garment -n 10", "600 to"},
        {"scene -m denim", "--garment is missing"},
        {"scene -g x.obj", "--material is missing"},
        {"scene -g /nowhere.obj -m denim", "/nowhere.obj"},
        {"scene -g x.obj -s x.seams -m denim -g y.obj -s y.seams -s z.seams", "--seams is given twice"},
        {"scene -s x.seams -g x.obj -s y.seams -m denim", "--seams is given twice"},
        {"scene -g x.obj -m denim --scale 0", "--scale takes"},
        {"scene -g x.obj -m denim --outwards 11", "--outwards takes"},
        {"scene -g x.obj -m denim -t -1", "--tolerance takes"},
        {"scene -g x.obj -m denim --elastic hem", "--elastic takes a file and two numbers"},
        {"scene -g x.obj -m denim --elastic :0.7:30", "--elastic takes a file and two numbers"},
        {"scene -g x.obj -m denim --elastic hem:0.05:30", "--elastic takes a number from 0.1 to 2"},
        {"scene -g x.obj -m denim --fold crease:181:1", "--fold takes a number from -180 to 180"},
        {"scene -g x.obj -m denim --fold crease:90:0", "--fold takes a number"},
        {"run", "which JOB"},
        {"run /nowhere.json", "/nowhere.json"},
        {"run /dev/null -o x.stl", ".glb, .obj"},
        {"run /dev/null --trace x.png", ".svg"},
        {"status", "which ID"},
        {"status ../x", "not a job id"},
        {"status a b", "too many"},
        {"list extra", "too many"},
        {"list -l 201", "--limit takes"},
        {"result j1 -f stl", "glb, obj, ply or json"},
        {"trace j1 -f glb", "csv, json or svg"},
        {"picture job.json", "needed"},
        {"compare --methods auto", "which JOB"},
        {"compare job.json", "which methods"},
        {"compare job.json --methods auto,", "is not a method"},
        {"compare job.json --methods auto:time_step=1", "give --method NAME:MEMBER=VALUE"},
        {"compare job.json --method auto:time_step", "\"auto:time_step\" is not a method"},
        {"compare job.json --methods auto -m auto", "given twice"},
        {"compare job.json --methods a,b,c,d,e,f,g,h,i,j,k,l,m,n,o,p,q", "at most 16"},
        {"compare job.json --methods auto -o report.pdf", "ends in .html"},
        {"compare job.json --methods auto --csv report.html", "ends in .csv"},
        {"compare /nowhere.json --methods auto", "/nowhere.json"},
        {"compare /dev/null --methods auto", "not a job"},
        {"list --url nowhere", "http://"},
        {"--bogus list", "bogus"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        int code = drape(wrong[i].line);
        if (code != EXIT_USAGE || !strstr(errors, wrong[i].words)) {
            print_error("drape %s: exit %d, \"%s\"\n", wrong[i].line, code, errors);
            fail();
        }
        assert_string_equal(output, "");
    }
}

static void test_cli__without_a_server_every_question_exits_with_3(void **state)
{
    const char *const lines[] = {"run /dev/null", "submit /dev/null", "status j1", "status --wait j1",
                                 "result j1",     "trace j1 --plot",  "cancel j1", "list --status queued",
                                 "materials"};
    (void)state;
    for (size_t i = 0; i < sizeof lines / sizeof lines[0]; i++) {
        assert_int_equal(drape(lines[i]), EXIT_UNREACHABLE);
        assert_non_null(strstr(errors, "http://127.0.0.1:1"));
    }
    assert_int_equal(drape("--url http://127.0.0.1:2 list"), EXIT_UNREACHABLE); /* before the command ... */
    assert_non_null(strstr(errors, "127.0.0.1:2"));
    assert_int_equal(drape("list --url http://127.0.0.1:3"), EXIT_UNREACHABLE); /* ... and behind it */
    assert_non_null(strstr(errors, "127.0.0.1:3"));
}

static void test_cli__example_prints_a_job(void **state)
{
    (void)state;
    assert_int_equal(drape("example square --triangles 200"), 0);
    json_t *job = json_loads(output, JSON_REJECT_DUPLICATES, NULL);
    assert_non_null(job);
    json_t *mesh = json_object_get(json_object_get(job, "cloth"), "mesh");
    assert_int_equal(json_array_size(json_object_get(mesh, "triangles")), 600);
    json_decref(job);
    assert_string_equal(errors, "");
}

static void test_cli__scene_turns_files_into_a_job(void **state)
{
    const char *garment = "../shared/data/garments/shirt_coarse";
    char line[256];
    (void)state;
    snprintf(line, sizeof line, "%s.obj", garment);
    if (access(line, R_OK) != 0) {
        print_message("SKIP: %s is not there\n", line);
        return;
    }
    snprintf(line, sizeof line,
             "scene -g %s.obj -s %s.seams -m denim -t 1e-2 -i 77 --method auto --name shirt", garment,
             garment);
    assert_int_equal(drape(line), 0);
    json_t *job = json_loads(output, 0, NULL), *solver = json_object_get(job, "solver");
    assert_non_null(job);
    assert_int_equal(json_array_size(json_object_get(json_object_get(job, "cloth"), "seams")), 270);
    assert_int_equal(json_integer_value(json_object_get(solver, "max_iterations")), 77);
    assert_close(json_number_value(json_object_get(solver, "tolerance")), 0.01, 1e-15);
    json_decref(job);
}

static void write_file(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    assert_int_equal(fclose(file), 0);
}

static void write_file_in(const char *folder, const char *name, const char *text, char *ret_path, size_t size)
{
    snprintf(ret_path, size, "%s/%s", folder, name);
    write_file(ret_path, text);
}

static void test_cli__scene_takes_elastics_and_folds(void **state)
{
    char folder[] = "/tmp/drape-test.XXXXXX", cloth[64], hem[64], crease[64], line[512];
    (void)state;
    assert_non_null(mkdtemp(folder));
    write_file_in(folder, "cloth.obj",
                  "v 0 0 0\nv 1 0 0\nv 0 0 -1\nv 1 0 -1\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n"
                  "f 1/1 2/2 4/4\nf 1/1 4/4 3/3\n",
                  cloth, sizeof cloth);
    write_file_in(folder, "hem", "# by hand\n1 2\n2 4\n", hem, sizeof hem);
    write_file_in(folder, "a:b", "1 4\n", crease, sizeof crease); /* a colon of its own */
    snprintf(line, sizeof line,
             "scene -g %s -m denim --elastic %s:0.7:30 --fold %s:-90:1e-3 --elastic %s:1.5:2", cloth, hem,
             crease, hem);
    assert_int_equal(drape(line), 0);
    json_t *job = json_loads(output, 0, NULL), *object = json_object_get(job, "cloth");
    json_t *elastics = json_object_get(object, "elastics"), *folds = json_object_get(object, "folds");
    json_t *wanted_folds = json_loads("[{\"edges\": [0,3], \"angle\": -90, \"stiffness\": 0.001}]", 0, NULL);
    assert_int_equal(json_array_size(elastics), 2);
    assert_int_equal(
        json_integer_value(json_array_get(json_object_get(json_array_get(elastics, 1), "edges"), 3)), 3);
    assert_close(json_number_value(json_object_get(json_array_get(elastics, 0), "stiffness")), 30, 0);
    assert_close(json_number_value(json_object_get(json_array_get(elastics, 1), "factor")), 1.5, 0);
    assert_true(json_equal(folds, wanted_folds));
    json_decref(job);
    json_decref(wanted_folds);
    remove(cloth);
    remove(hem);
    remove(crease);
    remove(folder);
}

static double number_at(json_t *array, size_t i)
{
    return json_number_value(json_array_get(array, i));
}

static void test_cli__scene_puts_garments_into_one_mesh(void **state)
{
    (void)state;
    char folder[] = "/tmp/drape-test-XXXXXX";
    assert_non_null(mkdtemp(folder));
    assert_int_equal(chdir(folder), 0);
    write_file("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n");
    write_file("b.obj", "v 0 0 2\nv 1 0 2\nv 0 1 2\nv 1 1 2\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n"
                        "f 1/1 2/2 3/3\nf 3/3 2/2 4/4\n");
    write_file("a.seams", "1 2\n");
    write_file("b.seams", "1 2\n3 4\n");
    write_file("b.lines", "hem 1 2 4\n");
    write_file("b.edges", "2 4\n");
    assert_int_equal(drape("scene -s a.seams -g a.obj -m silk -g b.obj -s b.seams -m denim --lines b.lines "
                           "--fold b.edges:90:1 --elastic b.edges:0.5:3 --scale 2 --outwards 0.5 -g a.obj "
                           "--elastic a.seams:0.8:4"),
                     0);
    json_t *job = json_loads(output, 0, NULL), *cloth = json_object_get(job, "cloth");
    assert_non_null(job);
    json_t *mesh = json_object_get(cloth, "mesh"), *positions = json_object_get(mesh, "positions");
    const char *const arrays[] = {"[0, 1, 2, 3, 4, 5, 5, 4, 6, 7, 8, 9]",
                                  "[0, 1, 3, 4, 5, 6]",
                                  "[0, 1, 1, 1]",
                                  "[{\"preset\": \"silk\"}, {\"preset\": \"denim\"}]",
                                  "[3, 4, 6]",
                                  "[{\"edges\": [4, 6], \"factor\": 0.5, \"stiffness\": 3},"
                                  " {\"edges\": [7, 8], \"factor\": 0.8, \"stiffness\": 4}]",
                                  "[{\"edges\": [4, 6], \"angle\": 90, \"stiffness\": 1}]"};
    json_t *const got[] = {json_object_get(mesh, "triangles"),
                           json_object_get(cloth, "seams"),
                           json_object_get(cloth, "triangle_material"),
                           json_object_get(cloth, "materials"),
                           json_object_get(json_array_get(json_object_get(job, "lines"), 0), "vertices"),
                           json_object_get(cloth, "elastics"),
                           json_object_get(cloth, "folds")};
    for (size_t i = 0; i < sizeof got / sizeof *got; i++) {
        json_t *wanted = json_loads(arrays[i], 0, NULL);
        assert_true(json_equal(got[i], wanted));
        json_decref(wanted);
    }
    assert_int_equal(json_array_size(positions), 30);
    assert_close(number_at(positions, 9), -0.5, 1e-15); /* scaled about its middle */
    assert_close(number_at(positions, 11), 2.5, 1e-15); /* outwards is +z */
    assert_close(number_at(json_object_get(mesh, "pattern"), 8), 2, 1e-15);
    assert_close(number_at(positions, 24), 1, 1e-15); /* and the third is as the first */
    assert_string_equal(json_string_value(json_object_get(job, "name")), "a.obj");
    json_decref(job);
    assert_int_equal(drape("scene -g a.obj -g b.obj -m denim"), 0); /* one fabric for all */
    job = json_loads(output, 0, NULL);
    assert_null(json_object_get(json_object_get(job, "cloth"), "triangle_material"));
    assert_int_equal(json_array_size(json_object_get(json_object_get(job, "cloth"), "materials")), 1);
    json_decref(job);
    assert_int_equal(drape("scene -g a.obj -s b.seams -m denim"), EXIT_USAGE);
    const char *const made[] = {"a.obj", "b.obj", "a.seams", "b.seams", "b.lines", "b.edges"};
    for (size_t i = 0; i < sizeof made / sizeof *made; i++) {
        unlink(made[i]);
    }
    assert_int_equal(rmdir(folder), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cli__every_command_has_help),
        cmocka_unit_test(test_cli__wrong_arguments_exit_with_1_and_say_why),
        cmocka_unit_test(test_cli__without_a_server_every_question_exits_with_3),
        cmocka_unit_test(test_cli__example_prints_a_job),
        cmocka_unit_test(test_cli__scene_turns_files_into_a_job),
        cmocka_unit_test(test_cli__scene_takes_elastics_and_folds),
        cmocka_unit_test(test_cli__scene_puts_garments_into_one_mesh), /* last: it changes the folder */
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
