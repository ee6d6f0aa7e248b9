/* test_watch.c - a job is followed to its end through broken streams, refused streams and restarts. */
#include "small_server.h"

#include "job.h"
#include "watch.h"

#define RUNNING "{\"id\":\"j1\",\"status\":\"running\",\"verdict\":null}"
#define ENDED   "{\"id\":\"j1\",\"status\":\"succeeded\",\"verdict\":\"at-rest\"}"

/* Watches job j1 on the script; what the meter and the event lines wrote in `shown` and `lines`. */
static int watch(const struct server_step *script, size_t steps, char **shown, char **lines,
                 struct failure *failure)
{
    struct small_server server;
    struct http *http = NULL;
    json_t *job = NULL;
    size_t shown_bytes = 0, lines_bytes = 0;
    FILE *show = open_memstream(shown, &shown_bytes), *line = open_memstream(lines, &lines_bytes);
    assert_true(show && line);
    server_start(&server, script, steps);
    assert_int_equal(http_new(server.url, NULL, &http, failure), 0);
    struct meter meter = {.file = show, .shown_at = -1e9};
    int status = watch_job(http, "j1", &meter, line, &job, failure);
    if (status == 0) {
        assert_string_equal(job_status(job), "succeeded");
    }
    json_decref(job);
    http_free(http);
    server_stop(&server);
    fclose(show);
    fclose(line);
    return status;
}

static void test_watch__reconnects_where_a_stream_broke(void **state)
{
    const struct server_step script[] = {
        {"GET /v1/jobs/j1/events HTTP/1.1",
         STREAM_OK "id: 1.1\nevent: state\ndata: {\"status\":\"running\"}\n\n"
                   "id: 1.2\nevent: progress\ndata: {\"progress\":{\"iteration\":17,\"stops\":3,"
                   "\"residual_force\":0.5,\"elapsed_ms\":1200,\"percent\":null}}\n\nid: 1.3\nda"},
        {"Last-Event-ID: 1.2", STREAM_OK ": heartbeat\n\nid: 1.9\nevent: end\ndata: " ENDED "\n\n"},
        {"GET /v1/jobs/j1 HTTP/1.1", JSON_OK ENDED},
    };
    struct failure failure;
    char *shown = NULL, *lines = NULL;
    (void)state;
    assert_int_equal(watch(script, 3, &shown, &lines, &failure), 0);
    assert_non_null(strstr(shown, "running\n"));
    assert_non_null(strstr(shown, "iteration    17"));
    assert_non_null(strstr(shown, "force 5.0e-01"));
    assert_non_null(strstr(shown, "3 stops"));
    assert_non_null(strstr(shown, "succeeded\n"));
    assert_non_null(strstr(lines, "\"id\":\"1.2\""));
    assert_null(strstr(lines, "1.3"));
    free(shown);
    free(lines);
}

static void test_watch__polls_where_streams_are_refused(void **state)
{
    const struct server_step script[] = {
        {"/events",
         HEAD("429 Too Many Requests", "application/problem+json") "\r\n{\"code\":\"too-many-streams\"}"},
        {"Prefer: wait=", JSON_OK RUNNING},
        {"", ""}, /* the server falls over once */
        {"GET /v1/jobs/j1 ", JSON_OK ENDED},
    };
    struct failure failure;
    char *shown = NULL, *lines = NULL;
    (void)state;
    assert_int_equal(watch(script, 4, &shown, &lines, &failure), 0);
    free(shown);
    free(lines);
}

static void test_watch__an_end_seen_before_needs_one_question_only(void **state)
{
    const struct server_step script[] = {
        {"/events", "HTTP/1.1 204 No Content\r\nConnection: close\r\n\r\n"},
        {"GET /v1/jobs/j1 ", JSON_OK ENDED},
    };
    struct failure failure;
    char *shown = NULL, *lines = NULL;
    (void)state;
    assert_int_equal(watch(script, 2, &shown, &lines, &failure), 0);
    free(shown);
    free(lines);
}

static void test_watch__reports_a_job_that_is_not_there(void **state)
{
    const struct server_step script[] = {
        {"/events", HEAD("404 Not Found", "application/problem+json") "\r\n{\"code\":\"not-found\"}"},
        {"GET /v1/jobs/j1 ",
         HEAD("404 Not Found", "application/problem+json") "\r\n{\"code\":\"not-found\"}"},
    };
    struct failure failure;
    char *shown = NULL, *lines = NULL;
    (void)state;
    assert_int_equal(watch(script, 2, &shown, &lines, &failure), -1);
    assert_int_equal(failure.code, EXIT_REFUSED);
    assert_non_null(strstr(failure.message, "drape list"));
    free(shown);
    free(lines);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_watch__reconnects_where_a_stream_broke),
        cmocka_unit_test(test_watch__polls_where_streams_are_refused),
        cmocka_unit_test(test_watch__an_end_seen_before_needs_one_question_only),
        cmocka_unit_test(test_watch__reports_a_job_that_is_not_there),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
