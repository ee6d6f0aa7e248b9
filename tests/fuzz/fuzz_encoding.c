/* fuzz_encoding.c - libFuzzer entry: the first byte says which coding and cap, the rest is the body. */
#include "encoding.h"
#include "fuzz.h"

struct seen {
    size_t bytes, cap;
};

static int see(const void *data, size_t bytes, void *sink_data)
{
    struct seen *seen = sink_data;
    const unsigned char *last = (const unsigned char *)data + bytes - 1;
    seen->bytes += bytes;
    fuzz_require(bytes > 0 && seen->bytes <= seen->cap &&
                 *last <= 255); /* the last byte is there to be read */
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0)
        return 0;
    struct seen seen = {0, (size_t)1 << (data[0] >> 1) % 20};
    const char *why = "";
    enum coding coding = data[0] & 1 ? CODING_GZIP : CODING_ZSTD;
    enum decoding result = encoding_decode(coding, data + 1, size - 1, seen.cap, see, &seen, &why);
    fuzz_require(result != DECODING_STOPPED && (result == DECODING_CORRUPT) == (why[0] != '\0'));
    return 0;
}
