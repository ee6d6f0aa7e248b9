/* fuzz_digest.c - libFuzzer entry: any text as Content-Digest, of a body that is the same text. */
#include <string.h>

#include "digest.h"
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct problem problem = {0};
    char *text = malloc(size + 1);
    fuzz_require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    if (digest_check(text, data, size, &problem) == 0)
        fuzz_require(strncmp(text, "sha-256=", 8) != 0 &&
                     strncmp(text, "sha-512=", 8) != 0); /* no text holds its own hash */
    else
        fuzz_require(problem.code == PROBLEM_BAD_REQUEST || problem.code == PROBLEM_DIGEST_MISMATCH);
    free(text);
    return 0;
}
