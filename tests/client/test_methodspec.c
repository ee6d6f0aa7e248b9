/* test_methodspec.c - words on a command line become members of "solver", or are refused. */
#include "test.h"

#include <jansson.h>

#include "methodspec.h"

/* The members of `spec` as compact JSON with sorted keys; "refused" with EXIT_USAGE. */
static char *parse(const char *spec)
{
    json_t *members = NULL;
    struct failure failure = {0};
    if (methodspec_parse(spec, &members, &failure) < 0) {
        assert_int_equal(failure.code, EXIT_USAGE);
        assert_non_null(strstr(failure.message, "is not a method"));
        return strdup("refused");
    }
    char *text = json_dumps(members, JSON_COMPACT | JSON_SORT_KEYS);
    json_decref(members);
    return text;
}

static void test_methodspec__values_are_numbers_words_or_truths(void **state)
{
    const struct {
        const char *spec, *json;
    } cases[] = {
        {"auto", "{\"method\":\"auto\"}"},
        {"stop-and-go:stop_on=kinetic", "{\"method\":\"stop-and-go\",\"stop_on\":\"kinetic\"}"},
        {"stop-and-go:integrator=bdf2,time_step=0.25",
         "{\"integrator\":\"bdf2\",\"method\":\"stop-and-go\",\"time_step\":0.25}"},
        {"newton:line_search=true,max_iterations=7",
         "{\"line_search\":true,\"max_iterations\":7,\"method\":\"newton\"}"},
        {"a:x=null,y=false,z=-1e3", "{\"method\":\"a\",\"x\":null,\"y\":false,\"z\":-1000.0}"},
        {"a:damping.air=1,damping.material=2", "{\"damping\":{\"air\":1,\"material\":2},\"method\":\"a\"}"},
        {"a:x=[1]", "{\"method\":\"a\",\"x\":\"[1]\"}"}, /* no arrays: their commas would be ours */
        {"a:x=b:c=d", "{\"method\":\"a\",\"x\":\"b:c=d\"}"},
        {"a:x=1,x=2", "{\"method\":\"a\",\"x\":2}"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char *text = parse(cases[i].spec);
        assert_string_equal(text, cases[i].json);
        free(text);
    }
}

static void test_methodspec__what_is_no_method_is_refused(void **state)
{
    const char *const wrong[] = {"",       ":",        "a:",   "a:x",      "a:x=",       "a:=1",
                                 "a:x=1,", "a:,x=1",   "a,b",  "a=b",      "a:method=b", "a:.x=1",
                                 "a:x.=1", "a:x..y=1", "\xff", "a:\xff=1", "a:x=\xff"};
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        char *text = parse(wrong[i]);
        if (strcmp(text, "refused") != 0) {
            print_error("\"%s\" gave %s\n", wrong[i], text);
            fail();
        }
        free(text);
    }
}

static void test_methodspec__replaces_only_what_it_names(void **state)
{
    json_t *job = json_loads("{\"name\":\"n\",\"solver\":{\"method\":\"auto\",\"tolerance\":0.5,"
                             "\"damping\":{\"air\":1,\"material\":2}}}",
                             0, NULL);
    json_t *before = json_deep_copy(job), *members = NULL;
    struct failure failure;
    (void)state;
    assert_int_equal(methodspec_parse("newton:damping.air=3", &members, &failure), 0);
    json_t *made = methodspec_apply(members, job);
    char *text = json_dumps(made, JSON_COMPACT | JSON_SORT_KEYS);
    assert_string_equal(text, "{\"name\":\"n\",\"solver\":{\"damping\":{\"air\":3,\"material\":2},"
                              "\"method\":\"newton\",\"tolerance\":0.5}}");
    assert_true(json_equal(job, before)); /* the next method starts from the same job */
    free(text);
    json_decref(made);
    json_object_del(job, "solver");
    made = methodspec_apply(members, job);
    assert_true(json_equal(json_object_get(made, "solver"), members));
    json_decref(made);
    json_decref(members);
    json_decref(before);
    json_decref(job);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_methodspec__values_are_numbers_words_or_truths),
        cmocka_unit_test(test_methodspec__what_is_no_method_is_refused),
        cmocka_unit_test(test_methodspec__replaces_only_what_it_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
