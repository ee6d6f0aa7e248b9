/* represent.c - see represent.h. */
#include "represent.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "negotiate.h"

int represent_choose(struct call *call, unsigned offered)
{
    int coding = negotiate_coding(http_header(call->request, "Accept-Encoding"), offered);
    if (coding < 0)
        call_refuse(call, PROBLEM_NOT_ACCEPTABLE, "This comes as it is, or in one of: " CODING_LIST ".");
    return coding;
}

void represent_refuse(struct call *call, const char *const *name, const char *const *type, size_t formats)
{
    char list[200] = "";
    for (size_t i = 0, n = 0; i < formats && n < sizeof list; i++)
        n += (size_t)snprintf(list + n, sizeof list - n, "%s%s (%s)", i > 0 ? ", " : "", name[i], type[i]);
    call_refuse(call, PROBLEM_NOT_ACCEPTABLE, "There are %s.", list);
}

void represent_send(struct call *call, struct http_answer *answer, const struct representing *as)
{
    char etag[128];
    const char *suffix = coding_suffix(as->coding);
    snprintf(etag, sizeof etag, "\"%s%s%s\"", as->tag, *suffix ? "-" : "", suffix);
    if (negotiate_unchanged(http_header(call->request, "If-None-Match"), etag)) {
        answer = http_answer_unmodified(answer);
    } else if (as->coding != CODING_IDENTITY) {
        http_answer_header(answer, "Content-Encoding", "%s", coding_name(as->coding));
    }
    http_answer_header(answer, "ETag", "%s", etag);
    http_answer_header(answer, "Vary", "%s", as->vary);
    http_answer_header(answer, "Cache-Control", "%s", as->cache);
    http_send(call->request, answer);
}

/* ---- pages --------------------------------------------------------------------------------------------- */

int page_make(const char *type, const void *data, size_t bytes, struct page *ret)
{
    memset(ret, 0, sizeof *ret);
    ret->type = type;
    ret->data[CODING_IDENTITY] = malloc(bytes + 1);
    if (ret->data[CODING_IDENTITY] == NULL)
        return -1;
    memcpy(ret->data[CODING_IDENTITY], data, bytes);
    ret->bytes[CODING_IDENTITY] = bytes;
    sha256_hex(data, bytes, ret->tag);
    for (int c = CODING_IDENTITY + 1; c < CODINGS; c++)
        if (encoding_encode_whole((enum coding)c, data, bytes, &ret->data[c], &ret->bytes[c]) != 0) {
            page_done(ret);
            return -1;
        }
    return 0;
}

void page_done(struct page *page)
{
    for (int c = 0; c < CODINGS; c++)
        free(page->data[c]);
    memset(page, 0, sizeof *page);
}

void page_send(struct call *call, const struct page *page)
{
    unsigned offered = 0;
    for (int c = 0; c < CODINGS; c++)
        if (c == CODING_IDENTITY || page->bytes[c] > 0)
            offered |= CODING_BIT(c);
    int coding = represent_choose(call, offered);
    if (coding < 0)
        return;
    struct representing as = {page->tag, (enum coding)coding, "Accept, Accept-Encoding", "no-cache"};
    represent_send(call, http_answer_static(200, page->type, page->data[coding], page->bytes[coding]), &as);
}
