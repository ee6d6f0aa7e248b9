/* page.h - the page at /: what this is, how the queue stands, and the interface as a table. */
#ifndef DRAPED_PAGE_H
#define DRAPED_PAGE_H

#include <stdbool.h>
#include <stddef.h>

struct page_facts {
    const char *version;
    bool counts; /* whether to tell the four below */
    size_t queued, running;
    unsigned workers, streams;
};

/* What of the page stays as it is: the operations of the OpenAPI document, as rows of a table; malloc'd. NULL
 * when it is no JSON or out of memory. */
char *page_interface(const char *openapi, size_t openapi_bytes);

/* HTML without scripts, malloc'd; `interface` is what page_interface gave. NULL when out of memory. */
char *page_html(const struct page_facts *facts, const char *interface);

#endif
