/* watch.h - follows a job to its end. */
#ifndef DRAPE_CLIENT_WATCH_H
#define DRAPE_CLIENT_WATCH_H

#include <jansson.h>

#include "http.h"
#include "meter.h"

/* Follows the event stream, reconnecting where it left off; where streams fail, polls. Progress goes
 * to *meter, and each event as one JSON line {"event", "id", "data"} to `lines` (NULL: not wanted).
 * *ret: the ended job, a new reference. On Ctrl-C: -1 with EXIT_INTERRUPTED; the job goes on. */
int watch_job(struct http *http, const char *id, struct meter *meter, FILE *lines, json_t **ret,
              struct failure *failure);

#endif
