/* jsonin.c - see jsonin.h. */
#include "jsonin.h"

#include <stdbool.h>
#include <stdlib.h>

static _Thread_local bool lacking; /* jansson asked for memory and there was none */

static void *allocate(size_t bytes)
{
    void *block = malloc(bytes);
    lacking = lacking || block == NULL;
    return block;
}

/* Before main: jansson has one allocator for all threads, and no lock around it. */
__attribute__((constructor)) static void watch_allocations(void)
{
    json_set_alloc_funcs(allocate, free);
}

int jsonin_load(const char *text, size_t bytes, json_t **ret, json_error_t *reterr)
{
    lacking = false;
    json_t *root = json_loadb(text, bytes, JSON_REJECT_DUPLICATES, reterr);
    if (lacking) {
        json_decref(root);
        return -1;
    }
    if (root == NULL)
        return JSONIN_BAD;
    *ret = root;
    return 0;
}
