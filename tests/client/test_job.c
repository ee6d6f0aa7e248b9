/* test_job.c - requests, refusals and their words, against a server that plays a script. */
#include "small_server.h"

#include "job.h"
#include "problem.h"

static struct http *connect_to(const struct small_server *server, const char *key)
{
    struct http *http = NULL;
    struct failure failure;
    assert_int_equal(http_new(server->url, key, &http, &failure), 0);
    return http;
}

static void test_job__submit_posts_json_with_the_key(void **state)
{
    const struct server_step script[] = {
        {"POST /v1/jobs HTTP/1.1",
         HEAD("202 Accepted", "application/json") "\r\n{\"id\":\"j1\",\"status\":\"queued\"}"},
        {"Authorization: Bearer secret",
         HEAD("202 Accepted", "application/json") "\r\n{\"id\":\"j2\",\"status\":\"queued\"}"},
        {"\r\n\r\n{\"cloth\": 1}",
         HEAD("202 Accepted", "application/json") "\r\n{\"id\":\"j3\",\"status\":\"queued\"}"},
        {"Content-Type: application/json",
         HEAD("202 Accepted", "application/json") "\r\n{\"id\":\"j4\",\"status\":\"queued\"}"},
    };
    struct small_server server;
    struct failure failure;
    (void)state;
    server_start(&server, script, 4);
    struct http *http = connect_to(&server, "secret");
    for (int i = 1; i <= 4; i++) {
        json_t *job = NULL;
        char id[16];
        snprintf(id, sizeof id, "j%d", i);
        assert_int_equal(job_submit(http, "{\"cloth\": 1}", 12, &job, &failure), 0);
        assert_string_equal(job_id(job), id);
        assert_false(job_ended(job));
        json_decref(job);
    }
    http_free(http);
    server_stop(&server);
}

static void check_refusal(const char *answer, enum exit_code code, const char *const *words)
{
    const struct server_step script[] = {{"POST /v1/jobs", answer}};
    struct small_server server;
    struct failure failure;
    json_t *job = NULL;
    server_start(&server, script, 1);
    struct http *http = connect_to(&server, NULL);
    assert_int_equal(job_submit(http, "{}", 2, &job, &failure), -1);
    assert_int_equal(failure.code, code);
    for (; *words; words++) {
        if (!strstr(failure.message, *words)) {
            print_error("\"%s\" lacks \"%s\"\n", failure.message, *words);
            fail();
        }
    }
    http_free(http);
    server_stop(&server);
}

static void test_job__refusals_show_detail_pointers_request_id_and_advice(void **state)
{
    (void)state;
    check_refusal(
        HEAD("422 Unprocessable Content",
             "application/problem+json") "\r\n{\"title\":\"The document is not "
                                         "valid\",\"status\":422,\"code\":\"invalid\",\"detail\":\"2 wrong\","
                                         "\"request_id\":\"r-77\",\"errors\":[{\"pointer\":\"/cloth/pins/"
                                         "3\",\"detail\":\"no such vertex\"},"
                                         "{\"pointer\":\"\",\"detail\":\"all of it\"}]}",
        EXIT_REFUSED,
        (const char *const[]){"not valid (422 invalid)", "2 wrong", "at /cloth/pins/3: no such vertex",
                              "at the whole document: all of it", "request id: r-77", "try: correct", NULL});
    check_refusal(
        HEAD("503 Service Unavailable",
             "application/problem+json") "Retry-After: 7\r\nX-Request-Id: h-1\r\n\r\n{\"title\":\"The queue "
                                         "is full\",\"code\":\"queue-full\"}",
        EXIT_REFUSED,
        (const char *const[]){"queue is full", "try: wait", "wait 7 s", "request id: h-1", NULL});
    /* one entry that the detail repeats is shown once */
    check_refusal(
        HEAD("422 Unprocessable Content",
             "application/problem+json") "\r\n{\"code\":\"invalid\",\"detail\":\"/name: too long\","
                                         "\"errors\":[{\"pointer\":\"/name\",\"detail\":\"too long\"}]}",
        EXIT_REFUSED, (const char *const[]){"(422 invalid)\n  /name: too long\ntry: ", NULL});
    /* a proxy's page instead of a problem document */
    check_refusal(HEAD("502 Bad Gateway", "text/html") "\r\n<html>", EXIT_REFUSED,
                  (const char *const[]){"(502)", "no reason given", "try: ", NULL});
    check_refusal(JSON_OK "{\"hello\": 1}", EXIT_REFUSED, (const char *const[]){"not a job", "--url", NULL});
}

static void test_job__no_server_is_unreachable(void **state)
{
    struct http *http = NULL;
    struct failure failure;
    json_t *job = NULL;
    (void)state;
    /* port 1 is reserved and nobody listens there */
    assert_int_equal(http_new("http://127.0.0.1:1/", NULL, &http, &failure), 0);
    assert_string_equal(http_url(http), "http://127.0.0.1:1");
    assert_int_equal(job_submit(http, "{}", 2, &job, &failure), -1);
    assert_int_equal(failure.code, EXIT_UNREACHABLE);
    assert_non_null(strstr(failure.message, "DRAPED_URL"));
    http_free(http);
    assert_int_equal(http_new("ftp://x", NULL, &http, &failure), -1);
    assert_int_equal(failure.code, EXIT_USAGE);
}

static void test_job__an_id_that_is_no_id_never_reaches_the_server(void **state)
{
    char path[JOB_PATH_SIZE], longest[JOB_ID_SIZE + 1];
    struct failure failure;
    (void)state;
    memset(longest, 'a', sizeof longest - 1);
    longest[sizeof longest - 1] = '\0';
    assert_int_equal(job_path("../mesh", "", path, &failure), -1);
    assert_int_equal(job_path("a?b", "", path, &failure), -1);
    assert_int_equal(job_path("", "", path, &failure), -1);
    assert_int_equal(job_path(longest, "", path, &failure), -1);
    assert_int_equal(failure.code, EXIT_USAGE);
    assert_int_equal(job_path(longest + 1, "/events", path, &failure), 0);
}

static enum exit_code code_of(const char *text)
{
    json_t *job = json_loads(text, 0, NULL);
    enum exit_code code = job_exit_code(job);
    json_decref(job);
    return code;
}

static void test_job__exit_codes_follow_status_and_verdict(void **state)
{
    (void)state;
    assert_int_equal(code_of("{\"status\":\"succeeded\",\"verdict\":\"at-rest\"}"), 0);
    assert_int_equal(code_of("{\"status\":\"succeeded\",\"verdict\":\"not-at-rest\"}"), 5);
    assert_int_equal(code_of("{\"status\":\"succeeded\",\"verdict\":\"slid-off\"}"), 5);
    assert_int_equal(code_of("{\"status\":\"succeeded\",\"verdict\":null}"), 5);
    assert_int_equal(code_of("{\"status\":\"failed\"}"), 4);
    assert_int_equal(code_of("{\"status\":\"canceled\",\"verdict\":null}"), 4);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_job__submit_posts_json_with_the_key),
        cmocka_unit_test(test_job__refusals_show_detail_pointers_request_id_and_advice),
        cmocka_unit_test(test_job__no_server_is_unreachable),
        cmocka_unit_test(test_job__an_id_that_is_no_id_never_reaches_the_server),
        cmocka_unit_test(test_job__exit_codes_follow_status_and_verdict),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
