/* idempotency.h - the Idempotency-Key of a request (draft-ietf-httpapi-idempotency-key-header), and which
 * keys are being worked on. What was answered under a key is the store's to keep. */
#ifndef DRAPED_IDEMPOTENCY_H
#define DRAPED_IDEMPOTENCY_H

#include <stdbool.h>

#define IDEMPOTENCY_KEY_SIZE 256 /* 1 to 255 visible ASCII characters, and a NUL */

/* A structured-field string ("..." with \" and \\), or the same characters bare. 0, or -1: no key. */
int idempotency_key_parse(const char *header, char ret[IDEMPOTENCY_KEY_SIZE]);

struct claim { /* a place for one key of one owner; the caller's, zero-initialised */
    const char *owner, *key;
    struct claim *next;
    bool held;
};

/* Any thread. One lock inside; nothing is locked under it, and it is held for a look at each claim: there
 * are no more of them than connections. */
struct claims;

struct claims *claims_new(void);                   /* NULL when out of memory */
struct claims *claims_free(struct claims *claims); /* none must be held; NULL is fine; returns NULL */

/* Claims (owner, key), which must stay as they are until the release; false when another holds them. */
bool claims_take(struct claims *claims, struct claim *claim, const char *owner, const char *key);
void claims_release(struct claims *claims, struct claim *claim); /* one that is not held is fine */

#endif
