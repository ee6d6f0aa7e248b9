/* test_negotiate.c - Accept, If-None-Match, Prefer, Content-Type. */
#include "test.h"

#include "negotiate.h"

static const char *const offer[] = {"application/json", "model/gltf-binary", "model/obj"};

static int accept(const char *header)
{
    return negotiate_accept(header, offer, 3);
}

static void test_negotiate__accept_prefers_the_exact_and_the_weightier(void **state)
{
    (void)state;
    assert_int_equal(accept(NULL), 0);
    assert_int_equal(accept("*/*"), 0);
    assert_int_equal(accept("model/obj"), 2);
    assert_int_equal(accept("MODEL/OBJ"), 2);
    assert_int_equal(accept("model/*"), 1);
    assert_int_equal(accept("application/json;q=0.5, model/obj"), 2);
    assert_int_equal(accept("*/*;q=0.1, model/gltf-binary;q=0.2"), 1);
    assert_int_equal(accept("text/html, */*;q=0.1"), 0);
    assert_int_equal(accept("application/json;q=0, */*"), 1);
    assert_int_equal(accept("model/obj ; q=0.3 , model/gltf-binary; q=0.7"), 1);
}

static void test_negotiate__accept_may_fit_nothing(void **state)
{
    (void)state;
    assert_int_equal(accept("text/html"), -1);
    assert_int_equal(accept("text/*"), -1);
    assert_int_equal(accept("*/*;q=0"), -1);
    assert_int_equal(accept("model"), -1);
    assert_int_equal(accept(""), -1);
    assert_int_equal(accept(",,;q=,"), -1);
    assert_int_equal(accept("model/obj;q=x"), -1);
}

#define BIT(coding) (1u << (coding))
#define ALL         (BIT(CODING_IDENTITY) | BIT(CODING_GZIP) | BIT(CODING_ZSTD))

static void test_negotiate__codings_are_weighed(void **state)
{
    (void)state;
    static const struct {
        const char *header;
        int coding;
    } row[] = {
        {NULL, CODING_IDENTITY},
        {"", CODING_IDENTITY},
        {"gzip", CODING_GZIP},
        {"x-gzip", CODING_GZIP},
        {"GZIP;Q=1.000", CODING_GZIP},
        {"gzip, deflate, br, zstd", CODING_ZSTD},
        {"gzip;q=1.0, zstd;q=0.9", CODING_GZIP},
        {"gzip;q=0.001, zstd;q=0.002", CODING_ZSTD},
        {"br", CODING_IDENTITY},
        {"gzip;q=0", CODING_IDENTITY},
        {"*", CODING_ZSTD},
        {"*;q=0.1", CODING_ZSTD},
        {"zstd;q=0, *", CODING_GZIP},
        {"identity", CODING_IDENTITY},
        {"identity;q=0.5, gzip;q=0.4", CODING_IDENTITY},
        {"identity;q=0.5, *;q=0.6", CODING_ZSTD},
        {"identity;q=0, gzip", CODING_GZIP},
        {"identity;q=0, *", CODING_ZSTD},
        {"*;q=0, gzip;q=0.3", CODING_GZIP},
        {"*;q=0, identity;q=0.3", CODING_IDENTITY},
        {"gzip;q=2", CODING_IDENTITY},
        {"gzip;q=0.1234", CODING_IDENTITY},
        {"gzip;q=.5", CODING_IDENTITY},
        {"gzip;q=nan", CODING_IDENTITY},
        {"gzip;q=", CODING_IDENTITY},
        {"gzip;q=1.001", CODING_IDENTITY},
        {",, ;q=1,gzip", CODING_GZIP},
        {"identity;q=0", -1},
        {"*;q=0", -1},
        {"identity;q=0, gzip;q=0, zstd;q=0", -1},
        {"identity;q=0, br", -1},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++)
        if (negotiate_coding(row[i].header, ALL) != row[i].coding)
            fail_msg("%s gives %d", row[i].header, negotiate_coding(row[i].header, ALL));
}

static void test_negotiate__only_codings_on_offer_are_given(void **state)
{
    (void)state;
    assert_int_equal(negotiate_coding("zstd, gzip;q=0.5", BIT(CODING_IDENTITY) | BIT(CODING_GZIP)),
                     CODING_GZIP);
    assert_int_equal(negotiate_coding("zstd, gzip", BIT(CODING_IDENTITY)), CODING_IDENTITY);
    assert_int_equal(negotiate_coding("zstd, identity;q=0", BIT(CODING_IDENTITY)), -1);
}

static void test_negotiate__if_none_match_compares_weakly(void **state)
{
    (void)state;
    assert_true(negotiate_unchanged("\"1.2\"", "\"1.2\""));
    assert_true(negotiate_unchanged("W/\"1.2\"", "\"1.2\""));
    assert_true(negotiate_unchanged("\"a\", \"1.2\"", "\"1.2\""));
    assert_true(negotiate_unchanged("\"a,b\" , \"1.2\" ", "\"1.2\""));
    assert_true(negotiate_unchanged("*", "\"1.2\""));
    assert_false(negotiate_unchanged(NULL, "\"1.2\""));
    assert_false(negotiate_unchanged("", "\"1.2\""));
    assert_false(negotiate_unchanged("\"1.20\"", "\"1.2\""));
    assert_false(negotiate_unchanged("1.2", "\"1.2\""));
    assert_false(negotiate_unchanged("\"1.2", "\"1.2\""));
}

static void test_negotiate__if_match_compares_strongly_and_allows_all_where_there_is_none(void **state)
{
    (void)state;
    assert_true(negotiate_matches(NULL, "\"1.2\""));
    assert_true(negotiate_matches("*", "\"1.2\""));
    assert_true(negotiate_matches("\"1.2\"", "\"1.2\""));
    assert_true(negotiate_matches("\"a,b\", \"1.2\"", "\"1.2\""));
    assert_false(negotiate_matches("W/\"1.2\"", "\"1.2\""));
    assert_false(negotiate_matches("", "\"1.2\""));
    assert_false(negotiate_matches("\"1.3\"", "\"1.2\""));
}

static void test_negotiate__prefer_wait_is_read_and_capped(void **state)
{
    (void)state;
    assert_int_equal(negotiate_wait("wait=10", 25), 10);
    assert_int_equal(negotiate_wait("respond-async, wait = 7", 25), 7);
    assert_int_equal(negotiate_wait("wait=10; x=y", 25), 10);
    assert_int_equal(negotiate_wait("WAIT=25", 25), 25);
    assert_int_equal(negotiate_wait("wait=26", 25), 25);
    assert_int_equal(negotiate_wait("wait=99999999999999999999", 25), 25);
}

static void test_negotiate__other_preferences_are_ignored(void **state)
{
    (void)state;
    const char *ignored[] = {"",        "wait",    "wait=",     "wait=rubbish",
                             "wait=-1", "wait=1x", "waiting=3", "handling=lenient"};
    for (size_t i = 0; i < sizeof ignored / sizeof *ignored; i++)
        assert_int_equal(negotiate_wait(ignored[i], 25), 0);
    assert_int_equal(negotiate_wait(NULL, 25), 0);
}

static void test_negotiate__content_types_are_compared_without_parameters(void **state)
{
    (void)state;
    assert_true(negotiate_is_type("application/json", "application/json"));
    assert_true(negotiate_is_type("Application/JSON; charset=utf-8", "application/json"));
    assert_false(negotiate_is_type("application/jsonp", "application/json"));
    assert_false(negotiate_is_type("application", "application/json"));
    assert_false(negotiate_is_type("", "application/json"));
    assert_false(negotiate_is_type(NULL, "application/json"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_negotiate__accept_prefers_the_exact_and_the_weightier),
        cmocka_unit_test(test_negotiate__accept_may_fit_nothing),
        cmocka_unit_test(test_negotiate__codings_are_weighed),
        cmocka_unit_test(test_negotiate__only_codings_on_offer_are_given),
        cmocka_unit_test(test_negotiate__if_none_match_compares_weakly),
        cmocka_unit_test(test_negotiate__if_match_compares_strongly_and_allows_all_where_there_is_none),
        cmocka_unit_test(test_negotiate__prefer_wait_is_read_and_capped),
        cmocka_unit_test(test_negotiate__other_preferences_are_ignored),
        cmocka_unit_test(test_negotiate__content_types_are_compared_without_parameters),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
