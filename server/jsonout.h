/* jsonout.h - JSON values as text. */
#ifndef DRAPED_JSONOUT_H
#define DRAPED_JSONOUT_H

#include <jansson.h>

/* The compact text of a value, which it takes (NULL is fine); malloc'd, NULL when out of memory.
 * jansson 2.14's json_dumps is not used: where memory for a member's name runs short it leaves the name out
 * and goes on (dump.c, do_dump, of an object). */
char *jsonout_text(json_t *json);

#endif
