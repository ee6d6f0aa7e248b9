/* traceparent.h - W3C trace context, level 1: which trace a request belongs to. Pure text. */
#ifndef DRAPED_TRACEPARENT_H
#define DRAPED_TRACEPARENT_H

#include <stdbool.h>

#define TRACE_ID_SIZE 33 /* 32 lower-case hex digits and a NUL */

/* The trace id of a traceparent (NULL: none); false, with "" for it, for one that is not valid. A later
 * version may have more behind a dash, as the specification has it. */
bool traceparent_parse(const char *text, char ret_trace_id[TRACE_ID_SIZE]);

#endif
