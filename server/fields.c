/* fields.c - see fields.h. */
#include "fields.h"

#include <pthread.h>
#include <sodium.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "metrics.h"

struct entry {
    unsigned char key[crypto_hash_sha256_BYTES];
    drape_field *field; /* NULL: being built */
    size_t bytes;
    struct entry *prev, *next;
};

struct fields {
    pthread_mutex_t lock;       /* guards all below */
    pthread_cond_t built;       /* an entry was, or is no more */
    struct entry *first, *last; /* the one used last comes first */
    size_t bytes, max_bytes;
    struct metrics *metrics;
};

struct fields *fields_new(size_t max_bytes, struct metrics *metrics)
{
    struct fields *fields = calloc(1, sizeof *fields);
    if (fields == NULL)
        return NULL;
    pthread_mutex_init(&fields->lock, NULL);
    pthread_cond_init(&fields->built, NULL);
    fields->max_bytes = max_bytes;
    fields->metrics = metrics;
    return fields;
}

/* ---- the list; all under the lock --------------------------------------------------------------------- */

static void link_first(struct fields *fields, struct entry *entry)
{
    entry->prev = NULL;
    entry->next = fields->first;
    *(fields->first != NULL ? &fields->first->prev : &fields->last) = entry;
    fields->first = entry;
}

static void unlink_entry(struct fields *fields, struct entry *entry)
{
    *(entry->prev != NULL ? &entry->prev->next : &fields->first) = entry->next;
    *(entry->next != NULL ? &entry->next->prev : &fields->last) = entry->prev;
}

static struct entry *find(const struct fields *fields, const unsigned char *key)
{
    struct entry *entry = fields->first;
    while (entry != NULL && memcmp(entry->key, key, sizeof entry->key) != 0)
        entry = entry->next;
    return entry;
}

static void forget(struct fields *fields, struct entry *entry)
{
    unlink_entry(fields, entry);
    fields->bytes -= entry->bytes;
    drape_field_unref(entry->field);
    free(entry);
}

static void keep_within_limit(struct fields *fields)
{
    for (struct entry *entry = fields->last, *prev; entry != NULL; entry = prev) {
        prev = entry->prev;
        if (fields->bytes > fields->max_bytes && entry->field != NULL)
            forget(fields, entry);
    }
    metrics_set(fields->metrics, METRIC_FIELD_BYTES, (double)fields->bytes);
}

/* ---- getting one -------------------------------------------------------------------------------------- */

/* The counts keep apart what the arrays' bytes alone would not. */
static void key_of(const drape_body *body, unsigned char ret[crypto_hash_sha256_BYTES])
{
    const uint64_t counts[2] = {body->vertices, body->triangles};
    crypto_hash_sha256_state state;
    crypto_hash_sha256_init(&state);
    crypto_hash_sha256_update(&state, (const unsigned char *)counts, sizeof counts);
    crypto_hash_sha256_update(&state, (const unsigned char *)body->positions,
                              3 * body->vertices * sizeof *body->positions);
    crypto_hash_sha256_update(&state, (const unsigned char *)body->triangle,
                              3 * body->triangles * sizeof *body->triangle);
    crypto_hash_sha256_final(&state, ret);
}

/* Builds what the entry, which others may wait for, stands for. */
static drape_status build(struct fields *fields, struct entry *entry, const drape_body *body, size_t number,
                          drape_processors *processors, drape_field **ret, drape_error *reterr)
{
    drape_field *field = NULL;
    int64_t began = clock_monotonic_ms();
    drape_status status = drape_field_new(body, number, processors, &field, reterr);
    metrics_observe(fields->metrics, METRIC_FIELD_SECONDS, (double)(clock_monotonic_ms() - began) / 1000);
    pthread_mutex_lock(&fields->lock);
    if (status < 0) {
        forget(fields, entry); /* those who wait try for themselves */
    } else {
        *ret = drape_field_ref(field);
        entry->field = field;
        entry->bytes = drape_field_bytes(field);
        fields->bytes += entry->bytes;
        keep_within_limit(fields); /* a limit below this one field lets go of it at once */
    }
    pthread_cond_broadcast(&fields->built);
    pthread_mutex_unlock(&fields->lock);
    return status;
}

drape_status fields_get(struct fields *fields, const drape_body *body, size_t number,
                        drape_processors *processors, drape_field **ret, drape_error *reterr)
{
    struct entry *fresh = calloc(1, sizeof *fresh), *entry;
    if (fresh == NULL) {
        *reterr = (drape_error){.status = DRAPE_ENOMEM, .element = -1, .body = -1};
        return DRAPE_ENOMEM;
    }
    key_of(body, fresh->key);
    pthread_mutex_lock(&fields->lock);
    while ((entry = find(fields, fresh->key)) != NULL && entry->field == NULL)
        pthread_cond_wait(&fields->built, &fields->lock);
    if (entry != NULL) {
        unlink_entry(fields, entry);
        link_first(fields, entry);
        *ret = drape_field_ref(entry->field);
    } else {
        link_first(fields, fresh);
    }
    metrics_add(fields->metrics, entry != NULL ? METRIC_FIELD_HITS : METRIC_FIELD_MISSES, 1);
    pthread_mutex_unlock(&fields->lock);
    if (entry == NULL)
        return build(fields, fresh, body, number, processors, ret, reterr);
    free(fresh);
    return DRAPE_OK;
}

struct fields *fields_free(struct fields *fields)
{
    if (fields == NULL)
        return NULL;
    for (struct entry *entry = fields->first, *next; entry != NULL; entry = next) {
        next = entry->next;
        drape_field_unref(entry->field);
        free(entry);
    }
    pthread_cond_destroy(&fields->built);
    pthread_mutex_destroy(&fields->lock);
    free(fields);
    return NULL;
}
