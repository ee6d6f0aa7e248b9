/* jsonin.c - see jsonin.h. */
#include "jsonin.h"

#include <setjmp.h>
#include <stdbool.h>
#include <stdlib.h>

struct blocks {
    void **block;
    size_t count, room;
};

/* What jansson takes in a load, and what of that it gives back, which is kept until the end: so nothing is
 * ever searched for. When there is no more memory it is left at once, by longjmp, and all it has taken is
 * freed. It holds no lock while it loads. */
struct load {
    struct blocks taken, returned;
    jmp_buf way_out;
};

static _Thread_local struct load *load; /* the one that this thread is in; NULL: none */

static bool note(struct blocks *blocks, void *block)
{
    if (blocks->count == blocks->room) {
        size_t room = blocks->room > 0 ? 2 * blocks->room : 64;
        void **grown = realloc(blocks->block, room * sizeof *grown);
        if (grown == NULL)
            return false;
        blocks->block = grown;
        blocks->room = room;
    }
    blocks->block[blocks->count++] = block;
    return true;
}

static void *allocate(size_t bytes)
{
    void *block = malloc(bytes);
    if (load != NULL && (block == NULL || !note(&load->taken, block))) {
        free(block);
        longjmp(load->way_out, 1);
    }
    return block;
}

static void release(void *block)
{
    if (load == NULL)
        free(block);
    else if (block != NULL && !note(&load->returned, block))
        longjmp(load->way_out, 1);
}

static void free_all(const struct blocks *blocks)
{
    for (size_t i = 0; i < blocks->count; i++)
        free(blocks->block[i]);
}

/* Before main: jansson has one allocator for all threads, and no lock around it. */
__attribute__((constructor)) static void watch_allocations(void)
{
    json_set_alloc_funcs(allocate, release);
}

int jsonin_load(const char *text, size_t bytes, json_t **ret, json_error_t *reterr)
{
    struct load own = {0};
    int result = -1;
    load = &own;
    if (setjmp(own.way_out) == 0) {
        json_t *root = json_loadb(text, bytes, JSON_REJECT_DUPLICATES, reterr);
        free_all(&own.returned);
        if (root != NULL)
            *ret = root;
        result = root != NULL ? 0 : JSONIN_BAD;
    } else {
        free_all(&own.taken);
    }
    load = NULL;
    free(own.taken.block);
    free(own.returned.block);
    return result;
}
