/* memout.h - what stdio writes into memory: whole, or not at all.
 *
 * glibc's open_memstream(3) leaves out what it finds no memory for, and neither ferror nor fclose tell. */
#ifndef DRAPED_MEMOUT_H
#define DRAPED_MEMOUT_H

#include <stdbool.h>
#include <stdio.h>

struct memout { /* the caller's; stays where it is until the stream is closed */
    char *text;
    size_t bytes, room;
    bool failed;
};

/* A stream to write to; NULL when out of memory. */
FILE *memout_open(struct memout *out);

/* What was written, once the stream is closed (fclose, whatever it returned): malloc'd, with a NUL behind it
 * that *ret_bytes (may be NULL) does not count. NULL when memory was short. */
char *memout_take(struct memout *out, size_t *ret_bytes);

#endif
