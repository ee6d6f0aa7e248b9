/* failure.c - filling the one record in which every room of the client reports what went wrong. */
#include "failure.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

int failure_set(struct failure *failure, enum exit_code code, const char *format, ...)
{
    va_list arguments;
    failure->code = code;
    va_start(arguments, format);
    vsnprintf(failure->message, sizeof failure->message, format, arguments);
    va_end(arguments);
    return -1;
}

int failure_no_memory(struct failure *failure)
{
    return failure_set(failure, EXIT_LOCAL, "out of memory");
}

void failure_add(struct failure *failure, const char *format, ...)
{
    size_t used = strlen(failure->message);
    size_t room = sizeof failure->message - used;
    if (room < 3) {
        return;
    }
    va_list arguments;
    failure->message[used] = '\n';
    va_start(arguments, format);
    vsnprintf(failure->message + used + 1, room - 1, format, arguments);
    va_end(arguments);
}
