/* log.c - see log.h. Level and format are set once at start and only read after. */
#include "log.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define SD_JOURNAL_SUPPRESS_LOCATION
#include <systemd/sd-journal.h>

#include "clock.h"
#include "logline.h"

#define HEAD_FIELDS 2 /* time and level, which the journal has of its own */

static const struct {
    const char *name;
    int priority; /* of syslog(3) */
} level_table[] = {{"error", 3}, {"warning", 4}, {"info", 6}, {"debug", 7}};

static const char *const format_table[] = {"auto", "text", "json", "journal"};

static enum log_level log_threshold = LOG_LEVEL_INFO;
static enum log_format log_form = LOG_TEXT;

/* systemd names the stream that it has connected to the journal; standard error may have been redirected
 * since. */
static bool stderr_is_journal(void)
{
    const char *stream = getenv("JOURNAL_STREAM");
    unsigned long long device, inode;
    struct stat st;
    return stream != NULL && sscanf(stream, "%llu:%llu", &device, &inode) == 2 &&
           fstat(STDERR_FILENO, &st) == 0 && st.st_dev == device && st.st_ino == inode;
}

void log_open(enum log_level level)
{
    log_threshold = level;
    log_choose(LOG_AUTO);
}

void log_choose(enum log_format format)
{
    log_form = format != LOG_AUTO ? format : stderr_is_journal() ? LOG_JOURNAL : LOG_TEXT;
}

const char *log_level_name(int level)
{
    return level >= 0 && level < (int)(sizeof level_table / sizeof *level_table) ? level_table[level].name
                                                                                 : NULL;
}

const char *log_format_name(int format)
{
    return format >= 0 && format < (int)(sizeof format_table / sizeof *format_table) ? format_table[format]
                                                                                     : NULL;
}

static void write_line(const struct log_record *record)
{
    char line[LOGLINE_SIZE + 1];
    size_t bytes = log_form == LOG_JSON ? logline_json(record, line) : logline_text(record, line);
    line[bytes] = '\n';
    /* Nothing can be done for a log that cannot be written. */
    if (write(STDERR_FILENO, line, bytes + 1) < 0)
        return;
}

static int send_entry(const struct log_record *record, int priority)
{
    struct log_entry entry = {.parts = 0};
    logline_entry(record, HEAD_FIELDS, priority, &entry);
    return sd_journal_sendv(entry.part, entry.parts);
}

void log_event(enum log_level level, const char *event, const char *format, ...)
{
    if (level > log_threshold)
        return;
    struct log_record record = {0};
    char time[CLOCK_TEXT_SIZE];
    clock_format(clock_wall_ms(), time);
    logline_add(&record, "time", time);
    logline_add(&record, "level", level_table[level].name);
    logline_add(&record, "event", event);
    va_list args;
    va_start(args, format);
    logline_take(&record, format, args);
    va_end(args);
    if (log_form != LOG_JOURNAL || send_entry(&record, level_table[level].priority) < 0)
        write_line(&record);
}
