/* test_jsonout.c - JSON values as text: whole, or not at all. */
#include "test.h"

#include <stdlib.h>
#include <string.h>

#include "jsonout.h"

/* jansson's allocator: the n-th allocation from now on fails, counted from 0; -1: none does. */
static long countdown = -1;
static long asked;

static void *scarce(size_t bytes)
{
    asked++;
    return countdown >= 0 && countdown-- == 0 ? NULL : malloc(bytes);
}

/* A value with more text than jansson's first buffer holds, at every depth. */
static json_t *sample(void)
{
    json_t *array = json_array();
    for (int i = 0; i < 40; i++)
        json_array_append_new(array, json_pack("{s:s, s:f, s:n, s:{s:b}}", "a_long_name_of_a_member",
                                               "\"text\"\n", "number", 0.1 * i, "none", "nested", "true", 1));
    return json_pack("{s:o, s:i}", "array", array, "integer", 42);
}

static void test_jsonout__text_is_compact_and_reads_back(void **state)
{
    (void)state;
    json_t *json = sample();
    char *text = jsonout_text(json_incref(json));
    assert_non_null(text);
    assert_null(strchr(text, ' '));
    json_t *back = json_loads(text, 0, NULL);
    assert_true(json_equal(json, back));
    free(text);
    json_decref(back);
    json_decref(json);
    assert_null(jsonout_text(NULL));
}

/* jansson's own json_dumps gives text without some of the names here. */
static void test_jsonout__short_of_memory_there_is_no_text_rather_than_a_broken_one(void **state)
{
    (void)state;
    json_set_alloc_funcs(scarce, free);
    json_t *json = sample();
    asked = 0;
    free(jsonout_text(json_incref(json)));
    long total = asked;
    for (long n = 0; n < total; n++) {
        countdown = n;
        char *text = jsonout_text(json_incref(json));
        countdown = -1;
        json_t *back = text == NULL ? NULL : json_loads(text, 0, NULL);
        assert_true(text == NULL || json_equal(json, back));
        json_decref(back);
        free(text);
    }
    json_decref(json);
    json_set_alloc_funcs(malloc, free);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_jsonout__text_is_compact_and_reads_back),
        cmocka_unit_test(test_jsonout__short_of_memory_there_is_no_text_rather_than_a_broken_one),
    };
    return cmocka_run_group_tests_name("jsonout", tests, NULL, NULL);
}
