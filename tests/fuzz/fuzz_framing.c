/* fuzz_framing.c - libFuzzer entry: any bytes as the head of a request. One that passes must be what the
 * grammar of RFC 9112 gives, word for word: so only one reading of it is there. */
#include <stdbool.h>
#include <string.h>

#include "../server/headsplit.h"
#include "fuzz.h"

static size_t visible(const uint8_t *p, size_t left)
{
    size_t n = 0;
    while (n < left && p[n] > ' ' && p[n] < 0x7f)
        n++;
    return n;
}

/* NULs just before an LF framing.c takes for what the library puts over line ends (a known gap). */
static bool is_near_lf(const uint8_t *p, const uint8_t *end)
{
    return memchr(p, '\n', end - p < 3 ? (size_t)(end - p) : 3) != NULL;
}

/* The length of the line at `p` if it is `name: value` CR LF, or with `first` three words CR LF; else 0. */
static size_t strict_line(const uint8_t *p, size_t left, bool first)
{
    size_t n = visible(p, left);
    for (int words = 1; first && words < 3; words++) {
        if (n + 1 >= left || p[n] != ' ')
            return 0;
        n += 1 + visible(p + n + 1, left - n - 1);
    }
    while (!first && n < left && (p[n] >= ' ' || p[n] == '\t') && p[n] != 0x7f)
        n++;
    return n + 2 <= left && p[n] == '\r' && p[n + 1] == '\n' ? n + 2 : 0;
}

static bool is_strict(const uint8_t *p, size_t bytes)
{
    size_t n = strict_line(p, bytes, true), line;
    const uint8_t *nul = memchr(p, '\0', bytes);
    if (nul != NULL)
        return is_near_lf(nul, p + bytes);
    if (n == 0)
        return false;
    while ((line = strict_line(p + n, bytes - n, false)) > 2)
        n += line;
    return line == 2 && n + 2 == bytes;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct framing f;
    const char *fault;
    size_t bytes;
    char *text = malloc(size + 1);
    fuzz_require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    if (headsplit(text, size, &f, &fault, &bytes) == 0 && fault == NULL) {
        fuzz_require(is_strict(data, bytes));
        fuzz_require(f.content_lengths + f.transfer_encodings <= 1);
        framing_path(text, "/a", f.host);
    }
    free(text);
    return 0;
}
