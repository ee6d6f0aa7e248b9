/* sse.c - see sse.h. */
#include "sse.h"

#include <stdio.h>
#include <string.h>

void sse_restart(struct sse *sse)
{
    sse->line_bytes = sse->data_bytes = 0;
    sse->name[0] = '\0';
    snprintf(sse->id, sizeof sse->id, "%s", sse->last_id);
    sse->after_return = false;
}

/* An empty line: the event is whole, so its id counts; hands it over if it has data. */
static int dispatch(struct sse *sse)
{
    int status = 0;
    memcpy(sse->last_id, sse->id, sizeof sse->last_id);
    if (sse->data_bytes > 0) {
        sse->data[--sse->data_bytes] = '\0'; /* the newline after the last data line */
        status = sse->on_event(sse->name[0] ? sse->name : "message", sse->data, sse->data_bytes, sse->user);
    }
    sse->data_bytes = 0;
    sse->name[0] = '\0';
    return status != 0;
}

static int take_field(struct sse *sse, const char *field, const char *value)
{
    size_t bytes = strlen(value);
    if (strcmp(field, "event") == 0) {
        snprintf(sse->name, sizeof sse->name, "%s", value);
    } else if (strcmp(field, "id") == 0) {
        if (bytes < sizeof sse->id) { /* cut short it would name another event; without it some come twice */
            memcpy(sse->id, value, bytes + 1);
        }
    } else if (strcmp(field, "data") == 0) {
        if (bytes + 1 > sizeof sse->data - sse->data_bytes) {
            return -1;
        }
        memcpy(sse->data + sse->data_bytes, value, bytes);
        sse->data_bytes += bytes;
        sse->data[sse->data_bytes++] = '\n';
    }
    return 0; /* comments (empty field name) and unknown fields are passed over */
}

static int take_line(struct sse *sse)
{
    sse->line[sse->line_bytes] = '\0';
    bool empty = sse->line_bytes == 0;
    sse->line_bytes = 0;
    if (empty) {
        return dispatch(sse);
    }
    char *value = strchr(sse->line, ':');
    if (!value) {
        return take_field(sse, sse->line, "");
    }
    *value++ = '\0';
    return take_field(sse, sse->line, value + (*value == ' '));
}

int sse_feed(struct sse *sse, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        char c = bytes[i];
        bool rest_of_return = sse->after_return && c == '\n';
        sse->after_return = c == '\r';
        if (rest_of_return) {
            continue;
        }
        if (c == '\n' || c == '\r') {
            int status = take_line(sse);
            if (status != 0) {
                return status;
            }
        } else if (sse->line_bytes + 1 < sizeof sse->line) {
            sse->line[sse->line_bytes++] = c;
        } else {
            return -1;
        }
    }
    return 0;
}
