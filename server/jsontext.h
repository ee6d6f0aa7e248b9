/* jsontext.h - JSON text into a small jansson tree and plain arrays of numbers.
 *
 * jansson spends up to 25 bytes of heap on each byte of numbers and 80 on each of "{}", and the
 * documents here are nearly all numbers. So arrays of numbers are taken out of the text first, into one
 * buffer of doubles; what remains is a small document, which jansson parses with all its strictness.
 * In the tree an array of numbers stands as [k], k its place in the list of arrays: that cannot be
 * mistaken, as every array that begins with a number has been taken out. */
#ifndef DRAPED_JSONTEXT_H
#define DRAPED_JSONTEXT_H

#include <stdint.h>

#include "limits.h"
#include "problem.h"

/* Arrays and members; and twice as many values and members outside arrays of numbers. No honest document
 * has more than a few hundred. */
#define JSONTEXT_MAX_NODES 65536

/* Bytes of text outside arrays of numbers. jansson copies strings up to three times as it reads them. */
#define JSONTEXT_MAX_REST ((size_t)1 << 20)

struct numbers {
    const double *value; /* owned by the jsontext */
    size_t count;
    size_t odd; /* index of the first element that is no number, after which reading stopped; or SIZE_MAX */
};

struct jsontext {
    json_t *root; /* at most limits->json_depth deep: recursion over it is safe on any stack */
    double *value;
    struct numbers *array;
    size_t arrays;
};

/* 0 and *ret (empty it with jsontext_done), or -1 with *reterr filled: PROBLEM_BAD_JSON for syntax
 * (with line and column), duplicate members and nesting deeper than limits->json_depth;
 * PROBLEM_TOO_LARGE for more than limits->json_values values, JSONTEXT_MAX_NODES nodes or
 * JSONTEXT_MAX_REST bytes. Holds at most 8 bytes for each value and a few MiB. */
int jsontext_parse(const char *text, size_t bytes, const struct limits *limits, struct jsontext *ret,
                   struct problem *reterr);
void jsontext_done(struct jsontext *json);

/* The numbers of an array of the tree; of any other value, count 0 and odd 0. */
struct numbers jsontext_numbers(const struct jsontext *json, const json_t *value);

/* The same with refusals: 422 at `pointer` when `value` is no array, at the element when one is no
 * number. */
int jsontext_get_numbers(const struct jsontext *json, const json_t *value, const char *pointer,
                         struct numbers *ret, struct problem *reterr);

/* Numbers as indices below `bound`; 422 at the first element of the array at `pointer` that is none. */
int jsontext_indices(struct numbers numbers, size_t bound, const char *pointer, uint32_t *ret,
                     struct problem *reterr);

/* Room for any pointer that a problem can hold. */
#define JSONTEXT_POINTER_BYTES sizeof(((struct problem_member *)0)->pointer)

/* Writes `pointer`, '/' and `member` (escaped as RFC 6901 asks) to `ret`, cut short between two
 * characters when it does not fit. `ret` may not overlap the inputs. */
void jsontext_pointer(char *ret, size_t size, const char *pointer, const char *member);

/* 0 when every member of `object` is in the NULL-terminated list; else -1, with as many of the others
 * in *reterr as it holds. */
int jsontext_check_members(const json_t *object, const char *pointer, const char *const *known,
                           struct problem *reterr);

#endif
