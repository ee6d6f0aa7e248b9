/* fuzz_time.c - libFuzzer entry: any text as a date-time; what is read is written and read again. */
#include "fuzz.h"

#include <string.h>

#include "clock.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char *text = malloc(size + 1), again[CLOCK_TEXT_SIZE];
    int64_t ms, back;
    fuzz_require(text != NULL);
    memcpy(text, data, size);
    text[size] = '\0';
    if (clock_parse(text, &ms) == 0 && ms >= 0 && ms <= 253402300799999) { /* an offset may lead beyond */
        clock_format(ms, again);
        fuzz_require(clock_parse(again, &back) == 0 && back == ms);
    }
    free(text);
    return 0;
}
