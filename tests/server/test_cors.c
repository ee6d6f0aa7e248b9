/* test_cors.c - which origins are origins, and which are allowed. */
#include "test.h"

#include "cors.h"

static void test_cors__origins_are_as_browsers_send_them(void **state)
{
    (void)state;
    static const char *const good[] = {"https://shop.example",      "http://localhost:5173",
                                       "https://shop.example:8443", "http://127.0.0.1:3000",
                                       "http://[::1]:3000",         "https://a-b.c:65535"};
    static const char *const bad[] = {"",
                                      "*",
                                      "null",
                                      "shop.example",
                                      "ftp://shop.example",
                                      "HTTPS://shop.example",
                                      "https://Shop.example",
                                      "https://shop.example/",
                                      "https://shop.example/a",
                                      "https://shop.example:443",
                                      "http://shop.example:80",
                                      "https://shop.example:",
                                      "https://shop.example:0443",
                                      "https://shop.example:65536",
                                      "https://shop.example:123456",
                                      "https://u@shop.example",
                                      "https://",
                                      "https://[::1",
                                      "https://*.shop.example"};
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        if (cors_origin_fault(good[i], strlen(good[i])) != NULL)
            fail_msg("%s: %s", good[i], cors_origin_fault(good[i], strlen(good[i])));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        if (cors_origin_fault(bad[i], strlen(bad[i])) == NULL)
            fail_msg("%s was taken", bad[i]);
}

static void test_cors__an_origin_has_255_bytes_at_most(void **state)
{
    (void)state;
    char origin[257] = "https://";
    memset(origin + 8, 'a', 248);
    assert_null(cors_origin_fault(origin, 255));
    assert_non_null(cors_origin_fault(origin, 256));
}

static void test_cors__only_the_very_origin_is_allowed(void **state)
{
    (void)state;
    const char *origins = "https://shop.example http://localhost:5173";
    assert_true(cors_allows(origins, "https://shop.example"));
    assert_true(cors_allows(origins, "http://localhost:5173"));
    static const char *const others[] = {"https://shop.example:8443",
                                         "http://shop.example",
                                         "https://shop.exampl",
                                         "https://shop.example.evil",
                                         "null",
                                         "",
                                         "*",
                                         "http://localhost",
                                         "https://shop.example http://localhost:5173"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        assert_false(cors_allows(origins, others[i]));
    assert_false(cors_allows(origins, NULL));
    assert_false(cors_allows("", ""));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cors__origins_are_as_browsers_send_them),
        cmocka_unit_test(test_cors__an_origin_has_255_bytes_at_most),
        cmocka_unit_test(test_cors__only_the_very_origin_is_allowed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
