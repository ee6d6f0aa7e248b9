/* fuzz_idempotency.c - libFuzzer entry: any text as an Idempotency-Key. */
#include "fuzz.h"

#include <string.h>

#include "idempotency.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char *text = malloc(size + 1), key[IDEMPOTENCY_KEY_SIZE], again[IDEMPOTENCY_KEY_SIZE];
    fuzz_require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    if (idempotency_key_parse(text, key) == 0) {
        size_t n = strlen(key);
        fuzz_require(n >= 1 && n < IDEMPOTENCY_KEY_SIZE);
        for (size_t i = 0; i < n; i++)
            fuzz_require(key[i] > ' ' && key[i] < 0x7f);
        /* Bare, it is the same key again, unless only a string can hold it. */
        if (strchr(key, '"') == NULL)
            fuzz_require(idempotency_key_parse(key, again) == 0 && strcmp(key, again) == 0);
    }
    free(text);
    return 0;
}
