/* headsplit.h - the head of a request taken apart as libmicrohttpd 0.9.75 does it: where it lies, with NULs
 * put over separators, lax about bare LFs and blanks. For test_framing and fuzz_framing. */
#ifndef DRAPED_HEADSPLIT_H
#define DRAPED_HEADSPLIT_H

#include <string.h>

#include "framing.h"

/* The next line, ended with a NUL, and *at moved behind it; NULL when there is none. */
static inline char *headsplit_line(char **at, char *end)
{
    char *line = *at, *lf = memchr(line, '\n', (size_t)(end - line));
    if (lf == NULL)
        return NULL;
    *lf = '\0';
    if (lf > line && lf[-1] == '\r')
        lf[-1] = '\0';
    *at = lf + 1;
    return line;
}

/* Checks the head that `text` (which it changes) begins with; -1 when the library itself would refuse it or
 * go on waiting, else 0 and *ret_fault as framing_end gives it. *ret_bytes is the length of the head. */
static inline int headsplit(char *text, size_t bytes, struct framing *f, const char **ret_fault,
                            size_t *ret_bytes)
{
    char *at = text, *end = text + bytes, *line = headsplit_line(&at, end), *blank;
    enum problem_code code;
    bool body;
    if (line == NULL || (blank = strchr(line, ' ')) == NULL)
        return -1;
    char *method = line, *target = blank + strspn(blank, " ");
    char *version = strrchr(target, ' ');
    if (version == NULL || version[1] == '\0')
        return -1;
    *blank = '\0';
    *version++ = '\0';
    if (strncmp(version, "HTTP/1.", 7) != 0 || strspn(version + 7, "0123456789") != 1 || version[8] != '\0')
        return -1;
    framing_target(f, true, target);
    framing_line(f, method, version);
    while ((line = headsplit_line(&at, end)) != NULL && *line != '\0') {
        char *colon = strchr(line, ':');
        if (colon == NULL)
            return -1;
        *colon = '\0';
        char *value = colon + 1 + strspn(colon + 1, " \t");
        framing_header(f, line, strlen(line), value, strlen(value));
    }
    *ret_bytes = (size_t)(at - text);
    *ret_fault = framing_end(f, *ret_bytes, &code, &body);
    return line == NULL ? -1 : 0;
}

#endif
