/* cors.h - which web pages may read our answers (cross-origin resource sharing, WHATWG Fetch). Pure text. */
#ifndef DRAPED_CORS_H
#define DRAPED_CORS_H

#include <stdbool.h>
#include <stddef.h>

/* What pages may send and see; keys come in Authorization, never as cookies, so credentials are not allowed.
 */
#define CORS_METHODS "GET, HEAD, POST, PUT, DELETE"
#define CORS_HEADERS                                                                                         \
    "Authorization, Content-Type, Content-Encoding, Content-Digest, Idempotency-Key, Last-Event-ID, "        \
    "If-Match, If-None-Match, Prefer, traceparent, X-Request-Id"
#define CORS_EXPOSED                                                                                         \
    "Location, Retry-After, ETag, Link, Preference-Applied, Idempotency-Replayed, X-Request-Id"
#define CORS_MAX_AGE "7200" /* s: two hours, as long as any browser keeps a preflight */

/* NULL when `text` is an origin as browsers send it ("https://shop.example:8443": lower case, nothing behind
 * the port, no port that goes without saying); else what is wrong with it. */
const char *cors_origin_fault(const char *text, size_t bytes);

/* Whether `origin` (NULL: none) is one of the blank-separated `origins`, to the letter. */
bool cors_allows(const char *origins, const char *origin);

#endif
