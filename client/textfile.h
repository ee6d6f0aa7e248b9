/* textfile.h - whole files in and out; "-" is standard input or output. */
#ifndef DRAPE_CLIENT_TEXTFILE_H
#define DRAPE_CLIENT_TEXTFILE_H

#include <stddef.h>

#include "failure.h"

/* Files beyond this are refused. */
#define TEXTFILE_MAX_BYTES ((size_t)1 << 30)

/* NUL-terminated, to be freed by the caller. 0, or -1 with *failure (EXIT_USAGE names the file). */
int textfile_read(const char *path, char **ret, size_t *ret_bytes, struct failure *failure);

/* 0, or -1 with *failure (EXIT_LOCAL). */
int textfile_write(const char *path, const char *data, size_t bytes, struct failure *failure);

/* The part of a path after its last dot, lower case, in `ret`; "" when there is none. */
void textfile_extension(const char *path, char ret[16]);

#endif
