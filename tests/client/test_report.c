/* test_report.c - summaries show what the server said, and survive what it left out. */
#include "test.h"

#include "report.h"

static char *job_text(const char *json)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&text, &bytes);
    json_t *job = json_loads(json, 0, NULL);
    assert_true(file && job);
    report_job(file, job);
    fclose(file);
    json_decref(job);
    return text;
}

static void test_report__shows_verdict_reason_counts_and_energies(void **state)
{
    (void)state;
    char *text = job_text(
        "{\"id\":\"j1\",\"name\":\"dress\",\"status\":\"succeeded\",\"verdict\":\"at-rest\",\"attempt\":2,"
        "\"report\":{\"reason\":\"within the tolerance\",\"method\":\"stop-and-go\",\"iterations\":74,"
        "\"peak_bytes\":2e7,\"bytes_per_triangle\":4000.4,"
        "\"peak_bytes_by_phase\":{\"sewing\":15300000,\"draping\":20000000},\"plan\":{\"kept\":[{\"name\":"
        "\"state\",\"bytes\":1000},"
        "{\"name\":\"contact\",\"bytes\":15000000},{\"name\":\"jacobian\",\"bytes\":4e6}]},\"stops\":5,"
        "\"factorizations\":75,\"seconds\":3.25,\"borrowed_seconds\":1.5,\"stages\":{\"sew\":0.0,\"broad-phase\":0.25,\"factorise\":2."
        "77},"
        "\"energies\":{\"stretch\":0.125,\"potential\":-0.5},\"residual_force\":9e-4,"
        "\"residual_energy\":3.5e-11,\"residual_energy_is\":\"estimate\",\"penetrations\":0,"
        "\"deepest\":0,\"sewing\":{\"iterations\":42,\"seam_gap\":0.0009}}}");
    const char *const words[] = {"job j1 dress: succeeded, at-rest",
                                 "within the tolerance",
                                 "74 of draping, 5 stops",
                                 "75 factorisations",
                                 "3.25 s, 1.50 s of a second processor (broad-phase 0.25, factorise 2.77)",
                                 "memory         20.0 MB, 4000 bytes a triangle (contact 15.0, jacobian 4.0)",
                                 "by phase       sewing 15.3, draping 20.0 MB",
                                 "stretch 0.125, potential -0.5",
                                 "0.0009 of the mean vertex weight",
                                 "3.5e-11 J (estimate)",
                                 "0 vertices",
                                 "42 iterations, seams closed to 0.9 mm",
                                 "attempt        2"};
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (!strstr(text, words[i])) {
            print_error("no \"%s\" in\n%s", words[i], text);
            fail();
        }
    }
    free(text);
}

static void test_report__shows_how_far_a_piece_slid_off(void **state)
{
    (void)state;
    char *text = job_text("{\"id\":\"j1\",\"status\":\"succeeded\",\"verdict\":\"slid-off\","
                          "\"report\":{\"reason\":\"it fell\",\"drop\":0.3121}}");
    assert_non_null(strstr(text, "slid off       by 312 mm\n"));
    free(text);
    text = job_text("{\"id\":\"j1\",\"verdict\":\"at-rest\",\"report\":{\"drop\":0}}");
    assert_null(strstr(text, "slid off"));
    free(text);
}

static void test_report__shows_what_intersects_and_where(void **state)
{
    (void)state;
    char *text = job_text("{\"id\":\"j1\",\"verdict\":\"intersecting\",\"report\":{\"self_intersections\":4,"
                          "\"intersection\":[0.25,1.5,-0.125]}}");
    assert_non_null(strstr(text, "self-crossings 4 edges through triangles\n"));
    assert_non_null(strstr(text, "intersects at  0.25, 1.5, -0.125 m\n"));
    free(text);
    text = job_text("{\"id\":\"j1\",\"report\":{\"self_intersections\":null,\"intersection\":null}}");
    assert_null(strstr(text, "self-crossings"));
    assert_null(strstr(text, "intersects"));
    free(text);
}

static void test_report__shows_how_long_lines_became(void **state)
{
    (void)state;
    char *text =
        job_text("{\"id\":\"j1\",\"report\":{\"lines\":["
                 "{\"name\":\"waist\",\"closed\":true,\"rest\":0.7,\"draped\":0.7119,\"elongation\":0.017},"
                 "{\"name\":\"dot\",\"closed\":false,\"rest\":0,\"draped\":0,\"elongation\":null}]}}");
    assert_non_null(
        strstr(text, "lines          waist: 711.9 mm draped, 700.0 mm in the pattern, +1.70 %\n"));
    assert_non_null(strstr(text, "               dot: 0.0 mm draped, 0.0 mm in the pattern\n"));
    free(text);
    text = job_text("{\"id\":\"j1\",\"report\":{\"lines\":null}}");
    assert_null(strstr(text, "lines"));
    free(text);
}

static void test_report__shows_the_error_of_a_failed_job(void **state)
{
    (void)state;
    char *text =
        job_text("{\"id\":\"j1\",\"name\":null,\"status\":\"failed\",\"verdict\":null,\"report\":null,"
                 "\"error\":{\"title\":\"The solver gave no result\",\"detail\":\"not finite\","
                 "\"errors\":[{\"pointer\":\"/bodies/0\",\"detail\":\"open\"}]}}");
    assert_non_null(strstr(text, "job j1: failed\n"));
    assert_non_null(strstr(text, "The solver gave no result"));
    assert_non_null(strstr(text, "not finite"));
    assert_non_null(strstr(text, "at /bodies/0: open"));
    free(text);
    text = job_text("{}"); /* hardly a job, and no crash */
    free(text);
}

static char *trace_text(const char *csv)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&text, &bytes);
    assert_non_null(file);
    report_trace(file, csv);
    fclose(file);
    return text;
}

static void test_report__trace_keeps_first_and_last_rows(void **state)
{
    char csv[8192] = "iteration,seconds,stretch,potential,kinetic,residual_energy,residual_force,stop\n";
    (void)state;
    for (int i = 0; i <= 100; i++) {
        size_t used = strlen(csv);
        snprintf(csv + used, sizeof csv - used, "%d,%g,0,-1,0,%g,%g,%d\n", i, 0.1 * i, 1.0 / (i + 1), 2.0,
                 i == 100);
    }
    char *text = trace_text(csv);
    size_t lines = 0;
    for (const char *c = text; *c; c++) {
        lines += *c == '\n';
    }
    assert_int_equal(lines, 11); /* a head and ten rows */
    assert_non_null(strstr(text, "          0     0.00  -1.000e+00"));
    assert_non_null(strstr(text, "        100    10.00  -1.000e+00"));
    assert_non_null(strstr(text, "stop\n"));
    free(text);
    const char *const odd[] = {"", "iteration", "iteration\n", "a,b\n1,2\n", "iteration,seconds\n1\n\n"};
    for (size_t i = 0; i < sizeof odd / sizeof odd[0]; i++) {
        free(trace_text(odd[i]));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_report__shows_verdict_reason_counts_and_energies),
        cmocka_unit_test(test_report__shows_how_far_a_piece_slid_off),
        cmocka_unit_test(test_report__shows_what_intersects_and_where),
        cmocka_unit_test(test_report__shows_how_long_lines_became),
        cmocka_unit_test(test_report__shows_the_error_of_a_failed_job),
        cmocka_unit_test(test_report__trace_keeps_first_and_last_rows),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
