/* jsonin.c - see jsonin.h. */
#include "jsonin.h"

#include <setjmp.h>
#include <stdbool.h>
#include <stdlib.h>

/* What jansson has taken and not given back in a load: when it gets no more it is left at once, by longjmp,
 * and this is freed. It holds no lock while it loads. */
struct load {
    void **block;
    size_t blocks, room;
    jmp_buf way_out;
};

static _Thread_local struct load *load; /* the one that this thread is in; NULL: none */

static bool note(void *block)
{
    if (load->blocks == load->room) {
        size_t room = load->room > 0 ? 2 * load->room : 64;
        void **grown = realloc(load->block, room * sizeof *grown);
        if (grown == NULL)
            return false;
        load->block = grown;
        load->room = room;
    }
    load->block[load->blocks++] = block;
    return true;
}

static void *allocate(size_t bytes)
{
    void *block = malloc(bytes);
    if (load != NULL && (block == NULL || !note(block))) {
        free(block);
        longjmp(load->way_out, 1);
    }
    return block;
}

/* Nearly always one of the last that were taken. */
static void release(void *block)
{
    for (size_t i = load != NULL ? load->blocks : 0; i-- > 0;)
        if (load->block[i] == block) {
            load->block[i] = load->block[--load->blocks];
            break;
        }
    free(block);
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
        if (root != NULL)
            *ret = root;
        result = root != NULL ? 0 : JSONIN_BAD;
    } else {
        for (size_t i = 0; i < own.blocks; i++)
            free(own.block[i]);
    }
    load = NULL;
    free(own.block);
    return result;
}
