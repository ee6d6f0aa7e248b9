/* fuzz_eventid.c - libFuzzer entry: any text as Last-Event-ID, of a stream of one job or of several. */
#include <string.h>

#include "fuzz.h"
#include "stream.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char job[] = "0123456789abcdef0123456789abcdef";
    char written[REVISION_SIZE];
    struct revision revision;
    char *text = malloc(size + 1);
    fuzz_require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    if (revision_parse(text, &revision) == 0) {
        revision_format(revision, written);
        fuzz_require(strchr(text, '=') == NULL);
    }
    revision = stream_seen(text, job);
    if (revision.attempt != 0 || revision.counter != 0) {
        revision_format(revision, written);
        fuzz_require(strstr(text, job) != NULL && strchr(text, '=') != NULL);
    }
    free(text);
    return 0;
}
