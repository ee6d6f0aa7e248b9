/* jsonout.c - see jsonout.h. */
#include "jsonout.h"

#include <stdlib.h>

char *jsonout_text(json_t *json)
{
    size_t bytes = json == NULL ? 0 : json_dumpb(json, NULL, 0, JSON_COMPACT);
    char *text = bytes == 0 ? NULL : malloc(bytes + 1);
    if (text != NULL && json_dumpb(json, text, bytes, JSON_COMPACT) == bytes) {
        text[bytes] = '\0';
    } else {
        free(text);
        text = NULL;
    }
    json_decref(json);
    return text;
}
