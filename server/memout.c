/* memout.c - see memout.h. */
#include "memout.h"

#include <stdlib.h>
#include <string.h>

/* Enough for the body of most jobs. */
#define FIRST_BYTES 4096

static bool grow(struct memout *out, size_t bytes)
{
    size_t room = out->room > 0 ? out->room : FIRST_BYTES;
    while (room <= out->bytes + bytes) /* <=: and a NUL */
        room *= 2;
    char *text = room > out->room ? realloc(out->text, room) : out->text;
    if (text == NULL)
        return false;
    out->text = text;
    out->room = room;
    return true;
}

/* As fopencookie(3) has it: 0 is an error. */
static ssize_t append(void *cookie, const char *data, size_t bytes)
{
    struct memout *out = cookie;
    out->failed = out->failed || !grow(out, bytes);
    if (out->failed)
        return 0;
    memcpy(out->text + out->bytes, data, bytes);
    out->bytes += bytes;
    out->text[out->bytes] = '\0';
    return (ssize_t)bytes;
}

FILE *memout_open(struct memout *out)
{
    *out = (struct memout){.text = NULL};
    return fopencookie(out, "w", (cookie_io_functions_t){.write = append});
}

char *memout_take(struct memout *out, size_t *ret_bytes)
{
    char *text = out->text;
    out->text = NULL;
    if (out->failed) {
        free(text);
        return NULL;
    }
    if (ret_bytes != NULL)
        *ret_bytes = out->bytes;
    return text != NULL ? text : calloc(1, 1); /* nothing was written */
}
