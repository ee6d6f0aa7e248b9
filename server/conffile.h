/* conffile.h - a file of `name = value` lines, read through libinih: whole, line by line, or refused. */
#ifndef DRAPED_CONFFILE_H
#define DRAPED_CONFFILE_H

#include <stddef.h>
#include <stdio.h>

/* One more than the longest line, its end counted; libinih would cut a longer one in two. */
#define CONFFILE_LINE_SIZE 4096

/* One pair, blanks trimmed; both are borrowed. 0, or -1 with a line in `message`, which ends the reading. */
typedef int conffile_fn(const char *name, const char *value, unsigned line, void *data, char *message,
                        size_t message_size);

/* Calls `each` for every pair of `in`. 0, or -1 with the line at fault and why in `message`. Sections are
 * refused, and so is whatever is neither a pair nor a comment (# or ; and what follows it). One thread at a
 * time: libinih's settings are global. */
int conffile_read(FILE *in, conffile_fn *each, void *data, unsigned *ret_line, char *message,
                  size_t message_size);

#endif
