/* represent.h - answers that exist in several content codings: which to give, and what goes with it.
 * Compression is done beforehand and never here. */
#ifndef DRAPED_REPRESENT_H
#define DRAPED_REPRESENT_H

#include "api.h"

#define CODING_BIT(coding) (1u << (coding))

#define ANSWERED 100 /* beside the values of store.h: an answer is on its way */

/* The coding, among those whose bits are in `offered`, that Accept-Encoding likes best; where none will do,
 * answers 406 and is -1. */
int represent_choose(struct call *call, unsigned offered);

/* Answers 406, with the formats that there are and their media types. */
void represent_refuse(struct call *call, const char *const *name, const char *const *type, size_t formats);

/* What a representation says of itself. */
struct representing {
    const char *tag; /* of its ETag, without quotes and coding */
    enum coding coding;
    const char *vary, *cache;
};

/* Sends the answer (which it takes, NULL: out of memory) with its headers; or 304, where If-None-Match says
 * that this very representation is there already. */
void represent_send(struct call *call, struct http_answer *answer, const struct representing *as);

/* ---- things made at start ------------------------------------------------------------------------------ */

/* A document that stays as it is, in every coding; fills *ret. 0, or -1 when out of memory. */
int page_make(const char *type, const void *data, size_t bytes, struct page *ret);
void page_done(struct page *page);
void page_send(struct call *call, const struct page *page);

#endif
