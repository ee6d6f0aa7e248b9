/* log.h - one line per event on standard error, or one entry in systemd's journal. Never bodies, never
 * secrets.
 *
 *   text      2026-01-01T12:00:00.000Z level=info event=job.accepted job=4f.. request=91.. bytes=1804
 *   json {"time":"2026-...","level":"info","event":"job.accepted","job":"4f..","request":"91..","bytes":1804}
 *   journal   PRIORITY=6 MESSAGE=job.accepted job=4f.. .. EVENT=job.accepted JOB_ID=4f.. REQUEST_ID=91..
 * BYTES=1804
 *
 * Values may hold anything: what could end a value, a line or an entry is escaped. One write per line, so
 * lines of several threads never mix. */
#ifndef DRAPED_LOG_H
#define DRAPED_LOG_H

enum log_level { LOG_LEVEL_ERROR = 0, LOG_LEVEL_WARNING, LOG_LEVEL_INFO, LOG_LEVEL_DEBUG };

/* LOG_AUTO: the journal where standard error is connected to it, else text. */
enum log_format { LOG_AUTO = 0, LOG_TEXT, LOG_JSON, LOG_JOURNAL };

/* Both once, before the first thread; unless called, info and automatic. */
void log_open(enum log_level level);
void log_choose(enum log_format format);

const char *log_level_name(int level);   /* NULL beyond the last */
const char *log_format_name(int format); /* NULL beyond the last */

/* `event` is a constant "room.what"; `format` a constant of pairs, "job=%s bytes=%zu why=\"%s\"". A value
 * that is empty is left out. */
__attribute__((format(printf, 3, 4))) void log_event(enum log_level level, const char *event,
                                                     const char *format, ...);

#endif
