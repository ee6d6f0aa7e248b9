/* log.h - one line per event on standard error, as key=value. Never bodies, never secrets.
 *
 *   level=info event=job.accepted job=4f..  request=91.. bytes=1804
 *
 * With systemd's journal behind standard error a line starts with its priority ("<6>"); else with the
 * time. One write per line, so lines of several threads never mix. */
#ifndef DRAPED_LOG_H
#define DRAPED_LOG_H

#include <stdbool.h>
#include <stddef.h>

enum log_level { LOG_LEVEL_ERROR = 0, LOG_LEVEL_WARNING, LOG_LEVEL_INFO, LOG_LEVEL_DEBUG };

#define LOG_QUOTE_SIZE 256

void log_open(enum log_level level);   /* once, before the first thread; the default is info */
const char *log_level_name(int level); /* NULL beyond the last */

/* `event` is a constant "room.what"; `format` gives the key=value pairs. */
__attribute__((format(printf, 3, 4))) void log_event(enum log_level level, const char *event,
                                                     const char *format, ...);

/* Text from outside, made safe for a value: quoted, control characters and quotes replaced, cut to
 * fit. Returns `buffer`. */
const char *log_quote(const char *text, char buffer[LOG_QUOTE_SIZE]);

#endif
