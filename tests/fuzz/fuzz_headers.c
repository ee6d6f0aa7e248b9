/* fuzz_headers.c - libFuzzer entry: any text as each of the request headers that are parsed here. */
#include <stdbool.h>
#include <string.h>

#include "cors.h"
#include "fuzz.h"
#include "negotiate.h"
#include "traceparent.h"

static void check_types(const char *text)
{
    static const char *const offer[] = {"application/json", "model/gltf-binary", "text/csv"};
    int best = negotiate_accept(text, offer, 3);
    fuzz_require(best >= -1 && best < 3);
    /* What is liked best of three is liked alone, too. */
    fuzz_require(best < 0 || negotiate_accept(text, &offer[best], 1) == 0);
    negotiate_is_type(text, offer[0]);
}

static void check_codings(const char *text)
{
    for (unsigned offered = 1; offered < 1u << CODINGS; offered += 2) { /* identity always is there */
        int coding = negotiate_coding(text, offered);
        fuzz_require(coding == -1 || (offered & 1u << coding));
    }
    coding_from_name(text, strlen(text));
}

static void check_trace(const char *text)
{
    char id[TRACE_ID_SIZE];
    bool valid = traceparent_parse(text, id);
    fuzz_require(strlen(id) == (valid ? TRACE_ID_SIZE - 1 : 0));
    fuzz_require(!valid || (strncmp(text + 3, id, 32) == 0 && strspn(id, "0") < 32));
}

static void check_origin(const char *text)
{
    bool origin = cors_origin_fault(text, strlen(text)) == NULL;
    fuzz_require(!origin || (strchr(text, ' ') == NULL && cors_allows(text, text)));
    fuzz_require(!cors_allows("https://shop.example", text) || strcmp(text, "https://shop.example") == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char *text = malloc(size + 1);
    fuzz_require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    check_types(text);
    check_codings(text);
    check_trace(text);
    check_origin(text);
    int wait = negotiate_wait(text, 25);
    fuzz_require(wait >= 0 && wait <= 25);
    fuzz_require(!negotiate_unchanged(text, "\"1.2\"") || strchr(text, '*') || strstr(text, "\"1.2\""));
    free(text);
    return 0;
}
