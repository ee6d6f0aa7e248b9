/* test_metrics.c - the exposition is well formed and counts what was counted. */
#include "test.h"

#include "metrics.h"

/* The value of a sample given with its labels, or NAN. */
static double sample(const char *text, const char *name)
{
    size_t n = strlen(name);
    for (const char *line = text; line != NULL && *line;
         line = strchr(line, '\n') ? strchr(line, '\n') + 1 : NULL)
        if (strncmp(line, name, n) == 0 && line[n] == ' ')
            return strtod(line + n, NULL);
    return NAN;
}

static void test_metrics__each_sample_follows_its_help_and_type_once(void **state)
{
    (void)state;
    struct metrics *m = metrics_new();
    char *text = metrics_text(m), helped[64] = "", *save = NULL;
    int samples = 0, families = 0;
    assert_non_null(text);
    for (char *line = strtok_r(text, "\n", &save); line; line = strtok_r(NULL, "\n", &save)) {
        char name[64], rest[16];
        if (sscanf(line, "# HELP %63s", name) == 1) {
            assert_string_not_equal(name, helped); /* families stand together */
            strcpy(helped, name);
            families++;
        } else if (sscanf(line, "# TYPE %63s %15s", name, rest) == 2) {
            assert_string_equal(name, helped);
        } else {
            assert_int_equal(strncmp(line, helped, strlen(helped)), 0);
            samples++;
        }
    }
    assert_true(families > 10);
    assert_true(samples > families);
    free(text);
    metrics_free(m);
}

static void test_metrics__gauges_and_counters_show_their_values(void **state)
{
    (void)state;
    struct metrics *m = metrics_new();
    metrics_add(m, METRIC_JOBS_ACCEPTED, 1);
    metrics_add(m, METRIC_JOBS_ACCEPTED, 2);
    metrics_set(m, METRIC_JOBS_RUNNING, 7);
    metrics_set(m, METRIC_JOBS_RUNNING, 5);
    metrics_add(m, METRIC_JOBS_FAILED, 4);
    char *text = metrics_text(m);
    assert_close(sample(text, "draped_jobs_accepted_total"), 3, 0);
    assert_close(sample(text, "draped_jobs{state=\"running\"}"), 5, 0);
    assert_close(sample(text, "draped_jobs_ended_total{status=\"failed\"}"), 4, 0);
    assert_close(sample(text, "draped_jobs_ended_total{status=\"succeeded\"}"), 0, 0);
    free(text);
    metrics_free(m);
}

static void test_metrics__histograms_are_cumulative_and_end_at_infinity(void **state)
{
    (void)state;
    struct metrics *m = metrics_new();
    const double seconds[] = {0.0005, 0.001, 0.5, 1e6};
    for (size_t i = 0; i < 4; i++)
        metrics_observe(m, METRIC_RUN_SECONDS, seconds[i]);
    char *text = metrics_text(m);
    assert_close(sample(text, "draped_run_seconds_bucket{le=\"0.001\"}"), 2, 0);
    assert_close(sample(text, "draped_run_seconds_bucket{le=\"0.3\"}"), 2, 0);
    assert_close(sample(text, "draped_run_seconds_bucket{le=\"1\"}"), 3, 0);
    assert_close(sample(text, "draped_run_seconds_bucket{le=\"3000\"}"), 3, 0);
    assert_close(sample(text, "draped_run_seconds_bucket{le=\"+Inf\"}"), 4, 0);
    assert_close(sample(text, "draped_run_seconds_count"), 4, 0);
    assert_close(sample(text, "draped_run_seconds_sum"), 1000000.5015, 1e-12);
    free(text);
    metrics_free(m);
}

static void test_metrics__requests_are_counted_by_route_method_and_code(void **state)
{
    (void)state;
    struct metrics *m = metrics_new();
    metrics_request(m, "/v1/jobs", "GET", 200);
    metrics_request(m, "/v1/jobs", "POST", 202);
    metrics_request(m, "/v1/jobs", "GET", 200);
    char *text = metrics_text(m);
    assert_close(sample(text, "draped_http_requests_total{route=\"/v1/jobs\",method=\"GET\",code=\"200\"}"),
                 2, 0);
    assert_close(sample(text, "draped_http_requests_total{route=\"/v1/jobs\",method=\"POST\",code=\"202\"}"),
                 1, 0);
    free(text);
    metrics_free(m);
}

static void test_metrics__a_full_table_of_requests_keeps_counting_what_it_has(void **state)
{
    (void)state;
    struct metrics *m = metrics_new();
    for (int code = 0; code < 2000; code++)
        metrics_request(m, "/", "GET", code);
    metrics_request(m, "/", "GET", 0);
    char *text = metrics_text(m);
    assert_close(sample(text, "draped_http_requests_total{route=\"/\",method=\"GET\",code=\"0\"}"), 2, 0);
    assert_true(isnan(sample(text, "draped_http_requests_total{route=\"/\",method=\"GET\",code=\"1999\"}")));
    free(text);
    metrics_free(m);
}

static void test_metrics__none_is_fine(void **state)
{
    (void)state;
    metrics_add(NULL, METRIC_JOBS_ACCEPTED, 1);
    metrics_set(NULL, METRIC_STREAMS, 1);
    metrics_observe(NULL, METRIC_RUN_SECONDS, 1);
    metrics_request(NULL, "/", "GET", 200);
    assert_null(metrics_free(NULL));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_metrics__each_sample_follows_its_help_and_type_once),
        cmocka_unit_test(test_metrics__gauges_and_counters_show_their_values),
        cmocka_unit_test(test_metrics__histograms_are_cumulative_and_end_at_infinity),
        cmocka_unit_test(test_metrics__requests_are_counted_by_route_method_and_code),
        cmocka_unit_test(test_metrics__a_full_table_of_requests_keeps_counting_what_it_has),
        cmocka_unit_test(test_metrics__none_is_fine),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
