/* traceparent.c - see traceparent.h; https://www.w3.org/TR/trace-context-1/, section 3.2. */
#include "traceparent.h"

#include <stddef.h>
#include <string.h>

/* version "-" trace-id "-" parent-id "-" trace-flags */
#define TRACE_ID  3
#define PARENT_ID 36
#define FLAGS     53
#define LENGTH    55

/* Whether so many lower-case hex digits stand at `text`, not all of them zero unless `zero` is allowed. */
static bool is_hex(const char *text, size_t digits, bool zero)
{
    return strspn(text, "0123456789abcdef") == digits && (zero || strspn(text, "0") < digits);
}

bool traceparent_parse(const char *text, char ret_trace_id[TRACE_ID_SIZE])
{
    ret_trace_id[0] = '\0';
    if (text == NULL || strlen(text) < LENGTH || !is_hex(text, 2, true) || strncmp(text, "ff", 2) == 0)
        return false;
    if (text[TRACE_ID - 1] != '-' || !is_hex(text + TRACE_ID, 32, false) || text[PARENT_ID - 1] != '-' ||
        !is_hex(text + PARENT_ID, 16, false) || text[FLAGS - 1] != '-' || !is_hex(text + FLAGS, 2, true))
        return false;
    if (text[LENGTH] != '\0' && (strncmp(text, "00", 2) == 0 || text[LENGTH] != '-'))
        return false;
    memcpy(ret_trace_id, text + TRACE_ID, TRACE_ID_SIZE - 1);
    ret_trace_id[TRACE_ID_SIZE - 1] = '\0';
    return true;
}
