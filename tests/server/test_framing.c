/* test_framing.c - heads that can be read in two ways, and heads that cannot. */
#include "test.h"

#include "framing.h"
#include "headsplit.h"

#define LINE "GET /a?b=c HTTP/1.1\r\n"

/* The fault of a head of `bytes`; "" when there is none, NULL when it never gets so far. */
static const char *fault_of(const char *head, size_t bytes)
{
    static char text[4096];
    struct framing f;
    const char *fault;
    size_t seen;
    memcpy(text, head, bytes);
    if (headsplit(text, bytes, &f, &fault, &seen) != 0)
        return NULL;
    assert_int_equal(seen, bytes);
    return fault == NULL ? "" : fault;
}

#define FAULT(text) fault_of(text, sizeof text - 1)

static void test_framing__honest_heads_pass(void **state)
{
    (void)state;
    assert_string_equal(FAULT(LINE "Host: h\r\n\r\n"), "");
    assert_string_equal(FAULT(LINE "Host:h:8080\r\nX:\r\nY: \t\r\nZ:  a b \xc3\xa9\t \r\n\r\n"), "");
    assert_string_equal(FAULT("GET / HTTP/1.0\r\n\r\n"), "");
    assert_string_equal(FAULT(LINE "Host: [::1]:80\r\nContent-Length: 0\r\n\r\n"), "");
    assert_string_equal(FAULT(LINE "Host: h\r\nTransfer-Encoding: Chunked\r\nExpect: 100-Continue\r\n\r\n"),
                        "");
}

static void test_framing__a_line_ends_in_cr_lf(void **state)
{
    (void)state;
    const char *doubtful = "A line of the head is folded, has a NUL, or does not end in CR LF.";
    assert_string_equal(FAULT("GET / HTTP/1.1\nHost: h\r\n\r\n"), doubtful);
    assert_string_equal(FAULT(LINE "Host: h\n\r\n"), doubtful);
    assert_string_equal(FAULT(LINE "Host: h\r\n\n"), doubtful);
    assert_string_equal(FAULT(LINE "Host: h\nX: y\r\n\r\n"), doubtful);
    assert_string_equal(FAULT("GET / HTTP/1.0\r\n\n"), doubtful);
    assert_string_equal(FAULT("GET / HTTP/1.0\n\r\n"), doubtful);
}

static void test_framing__a_nul_does_not_hide(void **state)
{
    (void)state;
    const char *doubtful = "A line of the head is folded, has a NUL, or does not end in CR LF.";
    assert_string_equal(FAULT(LINE "Host: h\0x\r\n\r\n"), doubtful);
    assert_string_equal(FAULT(LINE "Host: h\0\r\n\r\n"), doubtful);
    assert_string_equal(FAULT(LINE "Host: h\r\nX: \0y\r\n\r\n"), doubtful);
    assert_string_equal(FAULT(LINE "Host: h\r\nX: y\r\n\r\n"), "");
}

static void test_framing__the_request_line_is_three_words(void **state)
{
    (void)state;
    assert_string_equal(FAULT("GET  / HTTP/1.1\r\nHost: h\r\n\r\n"),
                        "The request line is not three words, each one blank apart.");
    assert_string_equal(FAULT("GET /a b HTTP/1.1\r\nHost: h\r\n\r\n"),
                        "The request target has blanks or characters that must be escaped.");
    assert_string_equal(FAULT("GET /\x7f HTTP/1.1\r\nHost: h\r\n\r\n"),
                        "The request target has blanks or characters that must be escaped.");
    assert_string_equal(FAULT("G@T / HTTP/1.1\r\nHost: h\r\n\r\n"), "A method has letters only.");
}

static void test_framing__lengths_and_codings_are_given_once(void **state)
{
    (void)state;
    assert_string_equal(FAULT(LINE "Host: h\r\nContent-Length: 1\r\ncontent-length: 1\r\n\r\n"),
                        "Content-Length must be one number.");
    assert_string_equal(FAULT(LINE "Host: h\r\nContent-Length: +1\r\n\r\n"),
                        "Content-Length must be one number.");
    assert_string_equal(
        FAULT(LINE "Host: h\r\nTransfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n"),
        "Transfer-Encoding must be given once.");
    assert_string_equal(FAULT(LINE "Host: h\r\nTransfer-Encoding: chunked\r\nContent-Length: 1\r\n\r\n"),
                        "Content-Length and Transfer-Encoding exclude each other.");
    assert_string_equal(FAULT("POST / HTTP/1.0\r\nTransfer-Encoding: chunked\r\n\r\n"),
                        "The only transfer encoding understood is chunked, in HTTP/1.1.");
}

static void test_framing__what_has_one_meaning_is_given_once(void **state)
{
    (void)state;
    static const char *const single[] = {"Authorization", "Content-Type", "Idempotency-Key"};
    char head[256];
    for (size_t i = 0; i < sizeof single / sizeof *single; i++) {
        int n = snprintf(head, sizeof head, LINE "Host: h\r\n%s: a\r\n\r\n", single[i]);
        assert_string_equal(fault_of(head, (size_t)n), "");
        n = snprintf(head, sizeof head, LINE "Host: h\r\n%s: a\r\nX: y\r\n%s: a\r\n\r\n", single[i],
                     i == 0 ? "aUTHORIZATION" : single[i]);
        assert_string_equal(fault_of(head, (size_t)n),
                            "Authorization, Content-Type and Idempotency-Key may be given once each.");
    }
    assert_string_equal(FAULT(LINE "Host: h\r\nAuthorization: a\r\nContent-Type: a\r\nIdempotency-Key: a\r\n"
                                   "Accept: a\r\nAccept: a\r\n\r\n"),
                        "");
}

static void test_framing__hosts_are_one_name_or_address(void **state)
{
    (void)state;
    static const char *const bad[] = {"",      "a b",  "a/b", "u@h",    "h:x",
                                      "h:1:2", "[::1", "::1", "[::1]x", "h,h"};
    char head[128];
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        int n = snprintf(head, sizeof head, LINE "Host: %s\r\n\r\n", bad[i]);
        assert_string_equal(fault_of(head, (size_t)n),
                            "Host must be a name or an address, and perhaps a port.");
    }
    assert_string_equal(FAULT(LINE "X: y\r\n\r\n"), "There must be one Host header.");
    assert_string_equal(FAULT(LINE "Host: h\r\nHost: h\r\n\r\n"), "There must be one Host header.");
}

static void test_framing__an_expectation_that_nobody_meets_is_417(void **state)
{
    (void)state;
    struct framing f;
    enum problem_code code;
    bool body;
    framing_target(&f, false, "/");
    framing_line(&f, "GET", "HTTP/1.1");
    framing_header(&f, "Host", 4, "h", 1);
    framing_header(&f, "Expect", 6, "200-ok", 6);
    assert_non_null(framing_end(&f, 0, &code, &body));
    assert_int_equal(code, PROBLEM_EXPECTATION);
    assert_false(body);
}

static void test_framing__targets_are_paths_of_this_host(void **state)
{
    (void)state;
    assert_string_equal(framing_path("GET", "/a", "h"), "/a");
    assert_string_equal(framing_path("GET", "http://H:80/a", "h:80"), "/a");
    assert_string_equal(framing_path("GET", "HTTP://h", "h"), "/");
    assert_string_equal(framing_path("OPTIONS", "*", "h"), "*");
    assert_null(framing_path("GET", "*", "h"));
    assert_null(framing_path("GET", "http://h/a", NULL));
    assert_null(framing_path("GET", "http://x/a", "h"));
    assert_null(framing_path("GET", "http://hh/a", "h"));
    assert_null(framing_path("GET", "http://h:80/a", "h"));
    assert_null(framing_path("GET", "https://h/a", "h"));
    assert_null(framing_path("CONNECT", "h:80", "h:80"));
    assert_null(framing_path("GET", "", "h"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_framing__honest_heads_pass),
        cmocka_unit_test(test_framing__a_line_ends_in_cr_lf),
        cmocka_unit_test(test_framing__a_nul_does_not_hide),
        cmocka_unit_test(test_framing__the_request_line_is_three_words),
        cmocka_unit_test(test_framing__lengths_and_codings_are_given_once),
        cmocka_unit_test(test_framing__what_has_one_meaning_is_given_once),
        cmocka_unit_test(test_framing__hosts_are_one_name_or_address),
        cmocka_unit_test(test_framing__an_expectation_that_nobody_meets_is_417),
        cmocka_unit_test(test_framing__targets_are_paths_of_this_host),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
