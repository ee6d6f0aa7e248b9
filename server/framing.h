/* framing.h - whether the head of a request can be read in one way only.
 *
 * libmicrohttpd 0.9.75 lets requests pass whose end another server would see elsewhere, so that what
 * follows them is a request to one and a body to the other (request smuggling). What it tells of a head
 * is checked here: lengths, codings, hosts, characters, and headers with one meaning that are given twice, of
 * which another server would heed the other. It parses a head where it was received and puts
 * NULs in place of separators, so where the pieces lie tells the rest: lines that end in a bare LF, NULs
 * within them, folded headers, blanks in the request line. (NULs just before an LF look like a CR.) Pure
 * text, no sockets. */
#ifndef DRAPED_FRAMING_H
#define DRAPED_FRAMING_H

#include <stdbool.h>
#include <stddef.h>

#include "problem.h"

struct framing { /* of one head; framing_target fills it */
    bool in_place;
    const char *start, *at; /* of the head; where its next line must begin */
    const char *target;     /* where it lay; what is left of it is not to be read */
    size_t target_bytes;
    bool http_1_0;
    const char *host; /* NULL: none yet */
    unsigned content_lengths, transfer_encodings, hosts;
    unsigned seen;          /* a bit for each header that may be given once only and was */
    enum problem_code code; /* of the first fault; PROBLEM_NONE: none yet */
    const char *fault;
};

/* First the request target as it was sent, with its query. With `in_place` all texts lie where they were
 * received, apart by what the library puts NULs over. */
void framing_target(struct framing *f, bool in_place, const char *target);

/* Then the rest of the request line. */
void framing_line(struct framing *f, const char *method, const char *version);

/* Every header in the order received. */
void framing_header(struct framing *f, const char *name, size_t name_bytes, const char *value,
                    size_t value_bytes);

/* The whole head has `bytes`, the empty line included. NULL when it is sound, else what is wrong with it
 * and *ret_code; *ret_body tells whether a body follows. */
const char *framing_end(struct framing *f, size_t bytes, enum problem_code *ret_code, bool *ret_body);

/* The path within `target` (its query cut off): of "/a" and of "http://host/a", where `host` is that of
 * the Host header, "/a"; "*" of OPTIONS stays; NULL: none that we serve (RFC 9112 section 3.2). */
const char *framing_path(const char *method, const char *target, const char *host);

#endif
