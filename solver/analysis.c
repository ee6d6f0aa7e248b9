/* analysis.c - see analysis.h. */
#include "analysis.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

struct entry {
    struct dr_analysis analysis; /* key, order and L are its own */
    size_t bytes;
    struct entry *next; /* used longer ago */
};

struct drape_analyses {
    pthread_mutex_t lock; /* guards all below */
    struct entry *first;
    cholmod_common common; /* the kept factors' */
    drape_analyses_counts counts;
    size_t max_bytes;
};

drape_analyses *drape_analyses_new(size_t max_bytes)
{
    drape_analyses *analyses = calloc(1, sizeof *analyses);
    if (!analyses)
        return NULL;
    cholmod_start(&analyses->common);
    analyses->common.print = 0;
    pthread_mutex_init(&analyses->lock, NULL);
    analyses->max_bytes = max_bytes;
    return analyses;
}

static struct entry *free_entry(drape_analyses *analyses, struct entry *entry)
{
    cholmod_free_factor(&entry->analysis.L, &analyses->common);
    free(entry->analysis.key);
    free(entry->analysis.order);
    free(entry);
    return NULL;
}

drape_analyses *drape_analyses_free(drape_analyses *analyses)
{
    if (!analyses)
        return NULL;
    for (struct entry *entry = analyses->first, *next; entry; entry = next) {
        next = entry->next;
        free_entry(analyses, entry);
    }
    cholmod_finish(&analyses->common);
    pthread_mutex_destroy(&analyses->lock);
    free(analyses);
    return NULL;
}

drape_analyses_counts drape_analyses_count(drape_analyses *analyses)
{
    pthread_mutex_lock(&analyses->lock);
    drape_analyses_counts counts = analyses->counts;
    pthread_mutex_unlock(&analyses->lock);
    return counts;
}

/* Takes the entry of that graph and kind of factor out of the list; NULL: there is none. Under the lock. */
static struct entry *take(drape_analyses *analyses, const struct dr_analysis *wanted)
{
    for (struct entry **at = &analyses->first; *at; at = &(*at)->next) {
        struct entry *entry = *at;
        const struct dr_analysis *kept = &entry->analysis;
        if (kept->free == wanted->free && kept->pairs == wanted->pairs &&
            kept->simplicial == wanted->simplicial &&
            !memcmp(kept->key, wanted->key, kept->pairs * sizeof *kept->key)) {
            *at = entry->next;
            return entry;
        }
    }
    return NULL;
}

static void put_first(drape_analyses *analyses, struct entry *entry)
{
    entry->next = analyses->first;
    analyses->first = entry;
}

bool dr_analyses_find(drape_analyses *analyses, struct dr_analysis *wanted, cholmod_common *common)
{
    bool found = false;
    pthread_mutex_lock(&analyses->lock);
    struct entry *entry = take(analyses, wanted);
    if (entry) {
        put_first(analyses, entry);
        wanted->L = cholmod_copy_factor(entry->analysis.L, common);
        memcpy(wanted->order, entry->analysis.order, wanted->free * sizeof *wanted->order);
        wanted->flops = entry->analysis.flops;
        wanted->entries = entry->analysis.entries;
        found = wanted->L;
    }
    analyses->counts.hits += found;
    analyses->counts.misses += !found;
    pthread_mutex_unlock(&analyses->lock);
    return found;
}

/* Under the lock. NULL: out of memory. */
static struct entry *copy(drape_analyses *analyses, const struct dr_analysis *analysis)
{
    struct entry *entry = calloc(1, sizeof *entry);
    if (!entry)
        return NULL;
    size_t key_bytes = analysis->pairs * sizeof *analysis->key;
    size_t order_bytes = analysis->free * sizeof *analysis->order;
    size_t before = analyses->common.memory_inuse;
    entry->analysis = *analysis;
    entry->analysis.key = malloc(key_bytes);
    entry->analysis.order = malloc(order_bytes);
    entry->analysis.L = cholmod_copy_factor(analysis->L, &analyses->common);
    if (!entry->analysis.key || !entry->analysis.order || !entry->analysis.L)
        return free_entry(analyses, entry);
    memcpy(entry->analysis.key, analysis->key, key_bytes);
    memcpy(entry->analysis.order, analysis->order, order_bytes);
    entry->bytes = sizeof *entry + key_bytes + order_bytes + analyses->common.memory_inuse - before;
    return entry;
}

/* Lets those go that come after what fits. Under the lock. */
static void keep_within_limit(drape_analyses *analyses)
{
    struct entry **at = &analyses->first;
    size_t bytes = 0;
    while (*at && bytes + (*at)->bytes <= analyses->max_bytes) {
        bytes += (*at)->bytes;
        at = &(*at)->next;
    }
    for (struct entry *entry = *at, *next; entry; entry = next) {
        next = entry->next;
        free_entry(analyses, entry);
    }
    *at = NULL;
    analyses->counts.bytes = bytes;
}

void dr_analyses_keep(drape_analyses *analyses, const struct dr_analysis *analysis)
{
    pthread_mutex_lock(&analyses->lock);
    struct entry *entry = take(analyses, analysis); /* another run may have been faster */
    if (!entry)
        entry = copy(analyses, analysis);
    if (entry)
        put_first(analyses, entry);
    keep_within_limit(analyses);
    pthread_mutex_unlock(&analyses->lock);
}
