/* test_encoding.c - gzip and zstd there and back, what is cut short, damaged or a bomb, and no memory. */
#include "test.h"

#include "../solver/scarce.h"

#define ZLIB_CONST
#include <zlib.h>
#include <zstd.h>

#include "encoding.h"

#define MANY ((size_t)300000)

static const enum coding coding_table[] = {CODING_GZIP, CODING_ZSTD};

struct text { /* what a sink was given */
    char *data;
    size_t bytes, room;
};

static int keep(const void *data, size_t bytes, void *sink_data)
{
    struct text *text = sink_data;
    if (bytes > text->room - text->bytes)
        return -1;
    memcpy(text->data + text->bytes, data, bytes);
    text->bytes += bytes;
    return 0;
}

static int count(const void *data, size_t bytes, void *sink_data)
{
    (void)data;
    *(size_t *)sink_data += bytes;
    return 0;
}

static struct text text_new(size_t room)
{
    struct text text = {malloc(room), 0, room};
    assert_non_null(text.data);
    return text;
}

/* Numbers in digits, as results have them. */
static struct text sample(size_t bytes)
{
    struct text text = text_new(bytes);
    uint32_t x = 1;
    for (; text.bytes < bytes; text.bytes++) {
        x = 1664525 * x + 1013904223;
        text.data[text.bytes] = "0123456789.,"[(x >> 24) % 12];
    }
    return text;
}

static struct text encoded(enum coding coding, const void *data, size_t bytes)
{
    struct text text = text_new(bytes + bytes / 8 + 1000);
    assert_int_equal(encoding_encode(coding, data, bytes, keep, &text), 0);
    return text;
}

static enum decoding decode(enum coding coding, const struct text *in, size_t bytes, size_t cap,
                            struct text *out, const char **ret_why)
{
    out->bytes = 0;
    return encoding_decode(coding, in->data, bytes, cap, keep, out, ret_why);
}

static void test_encoding__what_is_encoded_decodes_to_the_same(void **state)
{
    (void)state;
    static const size_t size[] = {0, 1, 65535, 65536, 65537, MANY};
    struct text plain = sample(MANY), back = text_new(MANY);
    const char *why;
    for (size_t c = 0; c < 2; c++)
        for (size_t i = 0; i < sizeof size / sizeof *size; i++) {
            struct text coded = encoded(coding_table[c], plain.data, size[i]);
            assert_int_equal(decode(coding_table[c], &coded, coded.bytes, MANY, &back, &why), DECODING_OK);
            assert_int_equal(back.bytes, size[i]);
            assert_memory_equal(back.data, plain.data, size[i]);
            assert_true(size[i] < 1000 || coded.bytes < size[i] * 6 / 10); /* 12 characters are 3.6 bits */
            free(coded.data);
        }
    free(plain.data);
    free(back.data);
}

static void test_encoding__the_cap_is_on_decoded_bytes(void **state)
{
    (void)state;
    struct text plain = sample(MANY), back = text_new(MANY);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = encoded(coding_table[c], plain.data, MANY);
        assert_int_equal(decode(coding_table[c], &coded, coded.bytes, MANY, &back, &why), DECODING_OK);
        assert_int_equal(decode(coding_table[c], &coded, coded.bytes, MANY - 1, &back, &why),
                         DECODING_TOO_LARGE);
        assert_true(back.bytes < MANY);
        free(coded.data);
    }
    free(plain.data);
    free(back.data);
}

/* As small as the coding can make it. */
static struct text bomb(enum coding coding, const void *data, size_t bytes)
{
    struct text text = text_new(bytes / 900);
    z_stream z = {.next_in = data, .avail_in = (uInt)bytes, .next_out = (Bytef *)text.data};
    if (coding == CODING_ZSTD) {
        text.bytes = ZSTD_compress(text.data, text.room, data, bytes, 19);
        return text;
    }
    z.avail_out = (uInt)text.room;
    assert_int_equal(deflateInit2(&z, 9, Z_DEFLATED, 31, 9, Z_DEFAULT_STRATEGY), Z_OK);
    assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
    text.bytes = z.total_out;
    deflateEnd(&z);
    return text;
}

static void test_encoding__a_bomb_stops_at_the_cap(void **state)
{
    (void)state;
    size_t zeros = (size_t)64 << 20, cap = 1 << 20;
    char *plain = calloc(1, zeros);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = bomb(coding_table[c], plain, zeros);
        assert_true(coded.bytes < zeros / 1000);
        size_t seen = 0;
        assert_int_equal(encoding_decode(coding_table[c], coded.data, coded.bytes, cap, count, &seen, &why),
                         DECODING_TOO_LARGE);
        assert_true(seen <= cap);
        free(coded.data);
    }
    free(plain);
}

/* Members and frames may follow one another; the cap is on all of them together. */
static void test_encoding__members_add_up(void **state)
{
    (void)state;
    struct text plain = sample(1000), back = text_new(MANY), many = text_new(MANY);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = encoded(coding_table[c], plain.data, plain.bytes);
        many.bytes = 0;
        for (int i = 0; i < 100; i++)
            assert_int_equal(keep(coded.data, coded.bytes, &many), 0);
        assert_int_equal(decode(coding_table[c], &many, many.bytes, 100000, &back, &why), DECODING_OK);
        assert_int_equal(back.bytes, 100000);
        assert_int_equal(decode(coding_table[c], &many, many.bytes, 99999, &back, &why), DECODING_TOO_LARGE);
        free(coded.data);
    }
    free(plain.data);
    free(back.data);
    free(many.data);
}

static void test_encoding__what_is_cut_short_or_goes_on_is_corrupt(void **state)
{
    (void)state;
    struct text plain = sample(2000), back = text_new(MANY);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = encoded(coding_table[c], plain.data, plain.bytes);
        for (size_t n = 0; n < coded.bytes; n++) {
            assert_int_equal(decode(coding_table[c], &coded, n, MANY, &back, &why), DECODING_CORRUPT);
            assert_string_equal(why, "it ends early");
        }
        coded.data[coded.bytes] = 'x';
        assert_int_equal(decode(coding_table[c], &coded, coded.bytes + 1, MANY, &back, &why),
                         DECODING_CORRUPT);
        free(coded.data);
    }
    free(plain.data);
    free(back.data);
}

/* Both end with a checksum: a changed byte is noticed, unless it is one that changes nothing. */
static void test_encoding__a_changed_byte_is_noticed(void **state)
{
    (void)state;
    struct text plain = sample(2000), back = text_new(MANY);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = encoded(coding_table[c], plain.data, plain.bytes);
        size_t noticed = 0;
        for (size_t n = 10; n < coded.bytes; n++) { /* before, gzip has a time and a system */
            coded.data[n] ^= 0x10;
            enum decoding result = decode(coding_table[c], &coded, coded.bytes, MANY, &back, &why);
            assert_true(result != DECODING_OK || memcmp(back.data, plain.data, plain.bytes) == 0);
            noticed += result == DECODING_CORRUPT;
            coded.data[n] ^= 0x10;
        }
        assert_true(noticed >= coded.bytes - 12);
        free(coded.data);
    }
    free(plain.data);
    free(back.data);
}

static void test_encoding__each_is_only_itself(void **state)
{
    (void)state;
    struct text plain = sample(2000), back = text_new(MANY);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = encoded(coding_table[c], plain.data, plain.bytes);
        assert_int_equal(decode(coding_table[1 - c], &coded, coded.bytes, MANY, &back, &why),
                         DECODING_CORRUPT);
        assert_int_equal(decode(coding_table[c], &plain, plain.bytes, MANY, &back, &why), DECODING_CORRUPT);
        assert_true(why[0] != '\0');
        free(coded.data);
    }
    free(plain.data);
    free(back.data);
}

/* A frame that asks for a window of 16 MiB, twice what the coding allows (RFC 9659). */
static void test_encoding__a_wide_window_is_refused(void **state)
{
    (void)state;
    size_t bytes = (size_t)17 << 20;
    char *plain = calloc(1, bytes);
    const char *why;
    for (int log = 23; log <= 24; log++) {
        struct text coded = text_new(MANY);
        ZSTD_CCtx *z = ZSTD_createCCtx();
        ZSTD_CCtx_setParameter(z, ZSTD_c_windowLog, log);
        ZSTD_inBuffer in = {plain, bytes, 0};
        ZSTD_outBuffer out = {coded.data, coded.room, 0};
        while (in.pos < in.size) /* piece by piece, so that the frame does not state its size */
            assert_false(ZSTD_isError(ZSTD_compressStream2(z, &out, &in, ZSTD_e_continue)));
        assert_int_equal(ZSTD_compressStream2(z, &out, &in, ZSTD_e_end), 0);
        size_t seen = 0;
        enum decoding result = encoding_decode(CODING_ZSTD, coded.data, out.pos, bytes, count, &seen, &why);
        assert_int_equal(result, log == 23 ? DECODING_OK : DECODING_CORRUPT);
        ZSTD_freeCCtx(z);
        free(coded.data);
    }
    free(plain);
}

static int refuse(const void *data, size_t bytes, void *sink_data)
{
    (void)data, (void)bytes, (void)sink_data;
    return -1;
}

static void test_encoding__a_sink_may_stop_it(void **state)
{
    (void)state;
    struct text plain = sample(1000);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = encoded(coding_table[c], plain.data, plain.bytes);
        assert_int_equal(encoding_decode(coding_table[c], coded.data, coded.bytes, 1000, refuse, NULL, &why),
                         DECODING_STOPPED);
        assert_int_equal(encoding_encode(coding_table[c], plain.data, plain.bytes, refuse, NULL), -1);
        free(coded.data);
    }
    free(plain.data);
}

static void test_encoding__names_are_known_in_any_case(void **state)
{
    (void)state;
    assert_int_equal(coding_from_name("gzip", 4), CODING_GZIP);
    assert_int_equal(coding_from_name("X-GZIP", 6), CODING_GZIP);
    assert_int_equal(coding_from_name("Zstd", 4), CODING_ZSTD);
    assert_int_equal(coding_from_name("identity", 8), CODING_IDENTITY);
    assert_int_equal(coding_from_name("gzip, zstd", 10), -1);
    assert_int_equal(coding_from_name("br", 2), -1);
    assert_int_equal(coding_from_name("", 0), -1);
}

static void test_encoding__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct text plain = sample(200000), back = text_new(MANY);
    const char *why;
    for (size_t c = 0; c < 2; c++) {
        struct text coded = encoded(coding_table[c], plain.data, plain.bytes);
        enum decoding result = DECODING_NO_MEMORY;
        long failures = -1, before = held;
        for (long n = 0; result != DECODING_OK; n++, failures++) {
            countdown = n;
            result = decode(coding_table[c], &coded, coded.bytes, MANY, &back, &why);
            countdown = -1;
            assert_true(result == DECODING_OK || result == DECODING_NO_MEMORY);
            assert_int_equal(held, before);
        }
        assert_true(failures >= 2);
        int failed = -1;
        for (long n = 0; failed; n++) {
            countdown = n;
            back.bytes = 0;
            failed = encoding_encode(coding_table[c], plain.data, plain.bytes, keep, &back);
            countdown = -1;
            assert_int_equal(held, before);
        }
        free(coded.data);
    }
    free(plain.data);
    free(back.data);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_encoding__what_is_encoded_decodes_to_the_same),
        cmocka_unit_test(test_encoding__the_cap_is_on_decoded_bytes),
        cmocka_unit_test(test_encoding__a_bomb_stops_at_the_cap),
        cmocka_unit_test(test_encoding__members_add_up),
        cmocka_unit_test(test_encoding__what_is_cut_short_or_goes_on_is_corrupt),
        cmocka_unit_test(test_encoding__a_changed_byte_is_noticed),
        cmocka_unit_test(test_encoding__each_is_only_itself),
        cmocka_unit_test(test_encoding__a_wide_window_is_refused),
        cmocka_unit_test(test_encoding__a_sink_may_stop_it),
        cmocka_unit_test(test_encoding__names_are_known_in_any_case),
        cmocka_unit_test(test_encoding__every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
