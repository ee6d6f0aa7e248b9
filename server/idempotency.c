/* idempotency.c - see idempotency.h. */
#include "idempotency.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

/* ---- the header --------------------------------------------------------------------------------- */

static bool visible(char c)
{
    return c > ' ' && c < 0x7f;
}

/* One character of a key, which may be escaped in a string; NULL at what is none. */
static const char *take_character(const char *p, bool quoted, char *ret)
{
    if (!visible(*p) || *p == '"')
        return NULL;
    if (quoted && *p == '\\' && *++p != '"' && *p != '\\')
        return NULL;
    *ret = *p;
    return p + 1;
}

int idempotency_key_parse(const char *header, char ret[IDEMPOTENCY_KEY_SIZE])
{
    bool quoted = *header == '"';
    const char *p = header + quoted;
    size_t n = 0;
    while (p != NULL && *p != '\0' && !(quoted && *p == '"')) {
        if (n == IDEMPOTENCY_KEY_SIZE - 1)
            return -1;
        p = take_character(p, quoted, &ret[n++]);
    }
    if (p == NULL || n == 0 || (quoted && strcmp(p, "\"") != 0))
        return -1;
    ret[n] = '\0';
    return 0;
}

/* ---- claims ------------------------------------------------------------------------------------- */

struct claims {
    pthread_mutex_t lock; /* the list, and `held` of those in it */
    struct claim *first;
};

struct claims *claims_new(void)
{
    struct claims *claims = calloc(1, sizeof *claims);
    if (claims != NULL)
        pthread_mutex_init(&claims->lock, NULL);
    return claims;
}

struct claims *claims_free(struct claims *claims)
{
    if (claims != NULL)
        pthread_mutex_destroy(&claims->lock);
    free(claims);
    return NULL;
}

bool claims_take(struct claims *claims, struct claim *claim, const char *owner, const char *key)
{
    pthread_mutex_lock(&claims->lock);
    const struct claim *other = claims->first;
    while (other != NULL && (strcmp(other->key, key) != 0 || strcmp(other->owner, owner) != 0))
        other = other->next;
    if (other == NULL) {
        *claim = (struct claim){owner, key, claims->first, true};
        claims->first = claim;
    }
    pthread_mutex_unlock(&claims->lock);
    return other == NULL;
}

void claims_release(struct claims *claims, struct claim *claim)
{
    pthread_mutex_lock(&claims->lock);
    if (claim->held) { /* so it is in the list */
        struct claim **p = &claims->first;
        while (*p != claim)
            p = &(*p)->next;
        *p = claim->next;
        claim->held = false;
    }
    pthread_mutex_unlock(&claims->lock);
}
