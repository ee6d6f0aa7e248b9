/* test_page.c - the page at /: figures, the interface as a table, and nothing that a browser would run. */
#include "test.h"

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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_page__figures_and_operations_are_on_it),
        cmocka_unit_test(test_page__a_document_that_is_none_has_no_interface),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
