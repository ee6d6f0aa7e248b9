/* conffile.c - see conffile.h. */
#include "conffile.h"

#include <ini.h>
#include <stdbool.h>
#include <string.h>

struct reading {
    FILE *in;
    unsigned line;
    bool failed; /* message and line are set */
    conffile_fn *each;
    void *data;
    char *message;
    size_t message_size;
};

static void refuse(struct reading *r, const char *why)
{
    if (!r->failed)
        snprintf(r->message, r->message_size, "%s", why);
    r->failed = true;
}

/* One line as libinih wants it, like fgets. To it an indented line is the value of the line before going on:
 * blanks in front are dropped. */
static char *read_line(char *text, int size, void *data)
{
    struct reading *r = data;
    int n = 0, c = 0;
    if (r->failed)
        return NULL;
    while (n < size - 1 && c != '\n' && (c = getc(r->in)) != EOF) {
        if (c == '\0')
            refuse(r, "a NUL byte");
        else if (n > 0 || (c != ' ' && c != '\t'))
            text[n++] = (char)c;
    }
    if (c == EOF && n == 0)
        return NULL;
    r->line++;
    if (c != '\n' && c != EOF)
        refuse(r, "this line is too long");
    text[n] = '\0';
    return r->failed ? NULL : text;
}

/* Nonzero goes on, as libinih has it. */
static int on_pair(void *data, const char *section, const char *name, const char *value)
{
    struct reading *r = data;
    if (section[0] != '\0')
        refuse(r, "there are no [sections] here");
    else if (r->each(name, value, r->line, r->data, r->message, r->message_size) != 0)
        r->failed = true;
    return !r->failed;
}

int conffile_read(FILE *in, conffile_fn *each, void *data, unsigned *ret_line, char *message,
                  size_t message_size)
{
    struct reading r = {
        .in = in, .each = each, .data = data, .message = message, .message_size = message_size};
    ini_max_line = CONFFILE_LINE_SIZE;
    int first_bad = ini_parse_stream(read_line, &r, on_pair, &r);
    /* libinih goes on after a line that is no pair: what stands first in the file is told first. */
    if (first_bad > 0 && (!r.failed || (unsigned)first_bad < r.line)) {
        snprintf(message, message_size, "this is not `name = value'");
        r.line = (unsigned)first_bad;
        r.failed = true;
    } else if (ferror(in)) {
        refuse(&r, "it cannot be read");
    }
    *ret_line = r.line;
    return r.failed ? -1 : 0;
}
