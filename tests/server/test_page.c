/* test_page.c - the page at /: figures, the interface as a table, and nothing that a browser would run. */
#include "test.h"

#include "../solver/scarce.h"

#include "page.h"

static const char OPENAPI[] =
    "{\"paths\": {\"/v1/jobs\": {\"get\": {\"summary\": \"List <b> & \\\"c\\\"\"}, "
    "\"post\": {\"summary\": \"Post\"}}, \"/v1/meshes/{sha256}\": {\"parameters\": [], "
    "\"head\": {\"summary\": \"Ask\"}}}}";

static void test_page__figures_and_operations_are_on_it(void **state)
{
    (void)state;
    const struct page_facts facts = {"1.2.3", true, 7, 2, 4, 11};
    char *interface = page_interface(OPENAPI, sizeof OPENAPI - 1);
    assert_non_null(interface);
    char *page = page_html(&facts, interface);
    assert_non_null(page);
    assert_non_null(strstr(page, "<dt>queued</dt><dd>7</dd>"));
    assert_non_null(strstr(page, "<dt>running</dt><dd>2</dd>"));
    assert_non_null(strstr(page, "<dt>workers</dt><dd>4</dd>"));
    assert_non_null(strstr(page, "<dt>event streams</dt><dd>11</dd>"));
    assert_non_null(strstr(page, "1.2.3"));
    assert_non_null(strstr(page, "<code>POST</code></td><td><code>/v1/jobs</code></td><td>Post<"));
    assert_non_null(strstr(page, "<code>HEAD</code></td><td><code>/v1/meshes/{sha256}</code></td><td>Ask<"));
    assert_non_null(strstr(page, "List &lt;b> &amp; &quot;c&quot;"));
    assert_null(strstr(page, "PARAMETERS")); /* what is no operation is no row */
    assert_null(strstr(page, "<script"));
    free(page);
    const struct page_facts silent = {"1.2.3", false, 7, 2, 4, 11};
    page = page_html(&silent, interface);
    assert_non_null(page);
    assert_null(strstr(page, "queued"));
    free(page);
    free(interface);
}

static void test_page__a_document_that_is_none_has_no_interface(void **state)
{
    (void)state;
    assert_null(page_interface("{", 1));
}

#ifdef CAN_FAIL_ALLOCATIONS
/* Calls `make` with each allocation failing in turn until none does: the same text, or none. */
static void expect_whole(char *(*make)(const char *data), const char *data)
{
    char *whole = make(data);
    long refusals = 0, before = held;
    assert_non_null(whole);
    assert_true(strlen(whole) > strlen(data) / 2); /* several buffers of a stream */
    for (long n = 0; countdown < 0; n++) {
        countdown = n;
        char *text = make(data);
        refusals += text == NULL;
        assert_true(text == NULL || strcmp(text, whole) == 0);
        free(text);
        assert_int_equal(held, before);
    }
    assert_true(refusals > 1);
    countdown = -1;
    free(whole);
}

static char *make_interface(const char *openapi)
{
    return page_interface(openapi, strlen(openapi));
}

static char *make_page(const char *interface)
{
    return page_html(&(struct page_facts){"1.2.3", true, 7, 2, 4, 11}, interface);
}
#endif

static void test_page__without_memory_there_is_nothing_rather_than_less(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    static char interface[50000], openapi[sizeof interface + 100];
    memset(interface, 'i', sizeof interface - 1);
    snprintf(openapi, sizeof openapi, "{\"paths\":{\"/\":{\"get\":{\"summary\":\"%s\"}}}}", interface);
    expect_whole(make_interface, openapi);
    expect_whole(make_page, interface);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_page__figures_and_operations_are_on_it),
        cmocka_unit_test(test_page__a_document_that_is_none_has_no_interface),
        cmocka_unit_test(test_page__without_memory_there_is_nothing_rather_than_less),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
