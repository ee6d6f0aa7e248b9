/* negotiate.h - request headers that choose: Accept, Accept-Encoding, If-Match, If-None-Match, Prefer. Pure
 * text, no sockets. */
#ifndef DRAPED_NEGOTIATE_H
#define DRAPED_NEGOTIATE_H

#include <stdbool.h>
#include <stddef.h>

#include "encoding.h"

/* The index of the media type of `offer` that `accept` (NULL: anything) likes best, the first of
 * equals; -1: none is acceptable (RFC 9110 section 12.5.1). */
int negotiate_accept(const char *accept, const char *const *offer, size_t offers);

/* The coding of those whose bits (1 << coding) are in `offered` that Accept-Encoding likes best, -1: none
 * is acceptable (RFC 9110 section 12.5.3). Of equals the one that makes things smallest soonest: zstd, gzip,
 * identity. Without the header (NULL) or with an empty one identity, and what cannot be read is not there. */
int negotiate_coding(const char *accept_encoding, unsigned offered);

/* Whether an If-None-Match (NULL: none) names `etag` (with its quotes), or is "*". Weak comparison. */
bool negotiate_unchanged(const char *if_none_match, const char *etag);

/* Whether an If-Match (NULL: none) allows what is asked of the thing of `etag`: names it, or is "*". Strong
 * comparison. */
bool negotiate_matches(const char *if_match, const char *etag);

/* The seconds of "Prefer: wait=n" (RFC 7240), at most `max`; 0: there is no such preference. */
int negotiate_wait(const char *prefer, int max);

/* Whether a Content-Type (NULL: none) is `media_type`, whatever its parameters. */
bool negotiate_is_type(const char *content_type, const char *media_type);

#endif
