/* test_memout.c - what is written into memory comes back whole, or not at all. */
#include "test.h"

#include "../solver/scarce.h"

#include "memout.h"

/* Writes `n` characters, one at a time and in lines; NULL or what came of it. */
static char *write_some(size_t n, size_t *ret_bytes)
{
    struct memout memout;
    FILE *out = memout_open(&memout);
    if (out == NULL)
        return NULL;
    for (size_t i = 0; i + 10 <= n; i += 10) {
        fputc('a', out);
        fprintf(out, "%08zu\n", i);
    }
    for (size_t i = n - n % 10; i < n; i++)
        fputc('z', out);
    fclose(out);
    return memout_take(&memout, ret_bytes);
}

static void expect_whole(const char *text, size_t n)
{
    char line[16];
    assert_int_equal(strlen(text), n);
    for (size_t i = 0; i + 10 <= n; i += 10) {
        snprintf(line, sizeof line, "a%08zu\n", i);
        assert_memory_equal(text + i, line, 10);
    }
    for (size_t i = n - n % 10; i < n; i++)
        assert_int_equal(text[i], 'z');
}

static void test_memout__what_is_written_comes_back(void **state)
{
    (void)state;
    const size_t size[] = {0, 1, 9, 4095, 4096, 4097, 8191, 8192, 100000};
    for (size_t i = 0; i < sizeof size / sizeof *size; i++) {
        size_t bytes = 7;
        char *text = write_some(size[i], &bytes);
        assert_int_equal(bytes, size[i]);
        expect_whole(text, size[i]);
        free(text);
    }
}

static void test_memout__large_pieces_too(void **state)
{
    (void)state;
    static char piece[70000];
    struct memout memout;
    memset(piece, 'p', sizeof piece);
    FILE *out = memout_open(&memout);
    for (int i = 0; i < 3; i++)
        assert_int_equal(fwrite(piece, 1, sizeof piece, out), sizeof piece);
    assert_int_equal(fclose(out), 0);
    char *text = memout_take(&memout, NULL);
    assert_int_equal(strspn(text, "p"), 3 * sizeof piece);
    assert_int_equal(text[3 * sizeof piece], '\0');
    free(text);
}

#ifdef CAN_FAIL_ALLOCATIONS
static void test_memout__without_memory_there_is_nothing_rather_than_less(void **state)
{
    (void)state;
    const size_t size[] = {0, 100, 50000};
    for (size_t i = 0; i < sizeof size / sizeof *size; i++) {
        long refusals = 0, n = 0, before = held;
        char *text;
        do {
            countdown = n++;
            text = write_some(size[i], NULL);
            refusals += text == NULL;
            if (text != NULL)
                expect_whole(text, size[i]);
            free(text);
            assert_int_equal(held, before);
        } while (countdown < 0);
        countdown = -1;
        assert_true(refusals > 1);
    }
}
#endif

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_memout__what_is_written_comes_back),
        cmocka_unit_test(test_memout__large_pieces_too),
#ifdef CAN_FAIL_ALLOCATIONS
        cmocka_unit_test(test_memout__without_memory_there_is_nothing_rather_than_less),
#endif
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
