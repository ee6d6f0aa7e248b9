/* digest.h - Content-Digest (RFC 9530): what a sender says the body's hash is. */
#ifndef DRAPED_DIGEST_H
#define DRAPED_DIGEST_H

#include <stddef.h>

#include "problem.h"

/* Checks a body, as it was sent, against the header's value, NULL for none: `sha-256=:BASE64:`, a list with
 * commas in between. sha-256 and sha-512 are checked, other algorithms passed over, as the RFC has it.
 * 0, or -1 with *reterr: PROBLEM_DIGEST_MISMATCH, or PROBLEM_BAD_REQUEST for what is no such list. */
int digest_check(const char *content_digest, const void *data, size_t bytes, struct problem *reterr);

#endif
