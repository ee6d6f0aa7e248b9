/* test_compare_page.c - the page stands alone, escapes what others wrote, and draws what there is. */
#include "comparing.h"

#include "chart.h"
#include "compare_page.h"
#include "html.h"

static size_t count(const char *text, const char *word)
{
    size_t found = 0;
    while ((text = strstr(text, word))) {
        found++;
        text += strlen(word);
    }
    return found;
}

static char *page_of(struct comparison *c, const char *job_text)
{
    char *page = NULL;
    size_t bytes = 0;
    struct failure failure;
    json_t *job = json_loads(job_text, 0, NULL);
    assert_non_null(job);
    compare_reckon(c);
    assert_int_equal(compare_page(c, job, &page, &bytes, &failure), 0);
    assert_int_equal(strlen(page), bytes);
    json_decref(job);
    return page;
}

static void test_compare_page__needs_no_script_and_no_network(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1, 0.5, 0.1, 0.01, 0), MADE_RUN("b", 1, 0.25, 0.001, 0)};
    struct comparison c = {.run = run, .runs = 2};
    (void)state;
    char *page = page_of(&c, "{\"name\":\"n\"}");
    const char *const never[] = {"<script", "src=",     "href=", "@import",
                                 "http://", "https://", "<?xml", "<!DOCTYPE svg"};
    size_t own = count(page, "=\"http://www.w3.org/2000/svg\""); /* a name, not an address to fetch */
    for (size_t i = 0; i < sizeof never / sizeof never[0]; i++) {
        size_t found = count(page, never[i]);
        if (found != (strcmp(never[i], "http://") == 0 ? own : 0)) {
            print_error("\"%s\" occurs %zu times\n", never[i], found);
            fail();
        }
    }
    assert_int_equal(count(page, "<svg"), 3); /* convergence, and each method's energies */
    assert_int_equal(count(page, "<svg"), count(page, "</svg>"));
    free(page);
    free_runs(&c);
}

static void test_compare_page__ids_are_unique(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1, 0.5, 0), MADE_RUN("b", 1, 0.25, 0)};
    struct comparison c = {.run = run, .runs = 2};
    (void)state;
    char *page = page_of(&c, "{}");
    assert_true(count(page, "<clipPath") > 3);
    for (const char *at = page; (at = strstr(at, " id=\"")); at++) {
        char id[64];
        snprintf(id, sizeof id, "%.*s", (int)strcspn(at + 5, "\"") + 6, at);
        assert_int_equal(count(page, id), 1);
    }
    free(page);
    free_runs(&c);
}

static void test_compare_page__escapes_what_others_wrote(void **state)
{
    struct compare_run run[] = {MADE_RUN("a:x=<b>", 1, 0.5, 0),
                                refused_run("m", "<img onerror='x'> & \"so\"")};
    struct comparison c = {.run = run, .runs = 2};
    (void)state;
    replace_job(&run[0], made_job("at-rest", 0, ",\"reason\":\"<i>why</i>\""));
    char *page = page_of(&c, "{\"name\":\"</title><script>alert(1)</script>\",\"solver\":{\"x\":\"<u>\"}}");
    const char *const never[] = {"<b>", "<img", "<i>", "<script", "<u>"};
    for (size_t i = 0; i < sizeof never / sizeof never[0]; i++) {
        assert_int_equal(count(page, never[i]), 0);
    }
    assert_int_equal(count(page, "&lt;/title&gt;&lt;script&gt;alert(1)&lt;/script&gt;"), 2);
    assert_true(count(page, "a:x=&lt;b&gt;") >= 2);
    assert_true(count(page, "&lt;img onerror=&#39;x&#39;&gt; &amp; &quot;so&quot;") >= 1);
    free(page);
    free_runs(&c);
}

/* Refused, empty, exploded, at the start: each must still give a page. */
static void test_compare_page__odd_runs_give_a_page_too(void **state)
{
    struct compare_run run[] = {refused_run("a", "no"), made_run("b", NULL, 0), MADE_RUN("c", 1),
                                MADE_RUN("d", 1, 1e300, NAN, -1e300), MADE_RUN("e", 1, NAN, 0.5)};
    (void)state;
    for (size_t first = 0; first < 5; first++) {
        for (size_t last = first; last < 5; last++) {
            struct comparison c = {.run = run + first, .runs = last - first + 1};
            char *page = page_of(&c, "{}");
            assert_non_null(strstr(page, "</html>"));
            assert_int_equal(count(page, ">nan") + count(page, "nan<") + count(page, "nan,"), 0);
            free(page);
        }
    }
    struct comparison all = {.run = run, .runs = 5};
    free_runs(&all);
}

static void test_compare_page__stops_and_other_minima_are_told(void **state)
{
    struct compare_run run[] = {MADE_RUN("a", 1, 0.5, 0.25), MADE_RUN("b", 1, 0)};
    struct comparison c = {.run = run, .runs = 2};
    (void)state;
    run[0].trace.row[1].stop = run[0].trace.row[2].stop = 1;
    char *page = page_of(&c, "{}");
    assert_int_equal(count(page, "Stops at iterations 1, 2.<"), 1);
    assert_int_equal(count(page, "Stops at"), 1);
    assert_int_equal(count(page, ">to its own<"), 1);
    assert_int_equal(count(page, "<tr"), 2 + 2 + 1); /* head, methods, a's own minimum */
    free(page);
    free_runs(&c);
}

static void test_compare_page__html_text_keeps_utf8_and_drops_controls(void **state)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&text, &bytes);
    (void)state;
    html_text(file, "\xc3\xa9 <&>\"' \x01\x7f\t\n");
    fclose(file);
    assert_string_equal(text, "\xc3\xa9 &lt;&amp;&gt;&quot;&#39; \xef\xbf\xbd\xef\xbf\xbd\t\n");
    free(text);
}

static void test_compare_page__colours_are_css(void **state)
{
    char css[8];
    (void)state;
    chart_colour(0, css);
    assert_string_equal(css, "#0072b2");
    chart_colour(CHART_COLOURS, css);
    assert_string_equal(css, "#0072b2");
    chart_colour(6, css);
    assert_string_equal(css, "#000000");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_compare_page__needs_no_script_and_no_network),
        cmocka_unit_test(test_compare_page__ids_are_unique),
        cmocka_unit_test(test_compare_page__escapes_what_others_wrote),
        cmocka_unit_test(test_compare_page__odd_runs_give_a_page_too),
        cmocka_unit_test(test_compare_page__stops_and_other_minima_are_told),
        cmocka_unit_test(test_compare_page__html_text_keeps_utf8_and_drops_controls),
        cmocka_unit_test(test_compare_page__colours_are_css),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
