/* compare_page.h - a comparison as one HTML page that needs nothing else: no script, no network. */
#ifndef DRAPE_CLIENT_COMPARE_PAGE_H
#define DRAPE_CLIENT_COMPARE_PAGE_H

#include "compare.h"

/* `job` is the document that was compared: its name, size and solver members head the page. *ret: the
 * page, NUL-terminated, which the caller frees. 0, or -1 with *failure. */
int compare_page(const struct comparison *comparison, const json_t *job, char **ret, size_t *ret_bytes,
                 struct failure *failure);

#endif
