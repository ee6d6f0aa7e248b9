/* multipart.h - the one file in a multipart/form-data body (RFC 7578 over RFC 2046), found in place.
 *
 * Stricter than the RFCs where no client needs the freedom: the body begins with its first boundary, ends
 * with the last, and holds one part; lines end with CRLF and are not folded. */
#ifndef DRAPED_MULTIPART_H
#define DRAPED_MULTIPART_H

#include <stddef.h>

#include "problem.h"

#define MULTIPART_BOUNDARY_SIZE 71   /* RFC 2046 section 5.1.1: up to 70 characters; and a NUL */
#define MULTIPART_MAX_HEADERS   4096 /* bytes of the part's header, with the empty line at its end */

struct multipart_file {
    const char *data; /* borrowed from the body */
    size_t bytes;
    char type[128];     /* Content-Type, "" for none */
    char filename[256]; /* "" for none; its end if it is longer. Nothing to open a file by */
};

/* The boundary of a Content-Type: 0, 1 when it is another type (or NULL), or -1 with *reterr. */
int multipart_boundary(const char *content_type, char ret[MULTIPART_BOUNDARY_SIZE], struct problem *reterr);

/* 0, or -1 with *reterr (PROBLEM_BAD_REQUEST), which names the byte at fault. */
int multipart_parse(const char *body, size_t bytes, const char *boundary, struct multipart_file *ret,
                    struct problem *reterr);

#endif
