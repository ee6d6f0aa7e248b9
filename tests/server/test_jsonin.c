/* test_jsonin.c - JSON text is read whole, or not at all. */
#include "test.h"

#include "../solver/scarce.h"

#include "jsonin.h"

static const char TEXT[] =
    "{\"a name of more bytes than jansson's first buffer\": \"a text of more bytes than that, too\", "
    "\"number\": 0.1234567890123456, \"list\": [1234567890123456789, true, null, {}]}";

static void test_jsonin__a_document_is_read(void **state)
{
    (void)state;
    json_t *root = NULL;
    json_error_t error;
    assert_int_equal(jsonin_load(TEXT, sizeof TEXT - 1, &root, &error), 0);
    assert_int_equal(json_object_size(root), 3);
    assert_true(json_real_value(json_object_get(root, "number")) == 0.1234567890123456);
    json_decref(root);
}

static void test_jsonin__what_is_none_or_has_a_member_twice_is_bad(void **state)
{
    (void)state;
    const char *const bad[] = {"", "{", "{\"a\":1,\"a\":2}", "[1] 2", "tru"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        json_t *root = NULL;
        json_error_t error;
        assert_int_equal(jsonin_load(bad[i], strlen(bad[i]), &root, &error), JSONIN_BAD);
        assert_null(root);
        assert_true(error.text[0] != '\0');
    }
}

/* Its error comes last, when all before is given back. Looking for each of so many, from the one end while
 * they come from the other, would outlast the deadline of tests. */
static void test_jsonin__a_large_document_is_found_bad_as_soon_as_it_is_read(void **state)
{
    (void)state;
    const size_t numbers = 3000000;
    char *text = malloc(4 * numbers + 2);
    assert_non_null(text);
    text[0] = '[';
    for (size_t i = 0; i < numbers; i++)
        memcpy(text + 1 + 4 * i, "1.5,", 4);
    text[4 * numbers + 1] = 'x';
    json_t *root = NULL;
    json_error_t error;
    assert_int_equal(jsonin_load(text, 4 * numbers + 2, &root, &error), JSONIN_BAD);
    assert_int_equal(error.position, 4 * numbers + 2);
    free(text);
}

#ifdef CAN_FAIL_ALLOCATIONS
/* Reads the text once for each allocation that it takes, which fails; with `lasting` all after it, too. */
static void starve(const char *text)
{
    long before = held, n = 0;
    json_error_t error;
    for (bool failed = true; failed; n++) {
        json_t *root = NULL;
        fail_at(n);
        int result = jsonin_load(text, strlen(text), &root, &error);
        failed = has_failed();
        assert_int_equal(result, failed ? -1 : 0);
        if (failed) {
            assert_null(root);
            assert_int_equal(held, before);
        }
        json_decref(root);
    }
    assert_true(n > 4);
    assert_int_equal(held, before);
}
#endif

/* Its lexer's buffer of 16 bytes grows at the end of a name, of a text and of a number, or within them. */
static void test_jsonin__without_memory_there_is_nothing_rather_than_less(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    const char *const text[] = {TEXT,
                                "{\"max_iterations\": 3}",
                                "[\"fourteen bytes\"]",
                                "[\"of thirteen b\\\"\"]",
                                "[0.1234567890123]",
                                "[123456789012345]",
                                "[1234567890123456]",
                                "[1.234567890123456789012345678901]",
                                "[1.00000000000e+1]"};
    for (size_t i = 0; i < 2 * sizeof text / sizeof *text; i++) {
        lasting = i % 2;
        starve(text[i / 2]);
    }
    lasting = false;
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_jsonin__a_document_is_read),
        cmocka_unit_test(test_jsonin__what_is_none_or_has_a_member_twice_is_bad),
        cmocka_unit_test(test_jsonin__a_large_document_is_found_bad_as_soon_as_it_is_read),
        cmocka_unit_test(test_jsonin__without_memory_there_is_nothing_rather_than_less),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
