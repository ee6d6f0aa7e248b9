/* log.c - see log.h. The level and the line's head are set once at start and only read after. */
#include "log.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "clock.h"

static const struct {
    const char *name;
    int priority; /* of syslog(3) */
} level_table[] = {{"error", 3}, {"warning", 4}, {"info", 6}, {"debug", 7}};

static enum log_level log_threshold = LOG_LEVEL_INFO;
static bool log_journal;

void log_open(enum log_level level)
{
    log_threshold = level;
    log_journal = getenv("JOURNAL_STREAM") != NULL;
}

const char *log_level_name(int level)
{
    return level >= 0 && level < (int)(sizeof level_table / sizeof *level_table) ? level_table[level].name
                                                                                 : NULL;
}

const char *log_quote(const char *text, char buffer[LOG_QUOTE_SIZE])
{
    size_t n = 0;
    buffer[n++] = '"';
    for (; *text != '\0' && n < LOG_QUOTE_SIZE - 2; text++) {
        unsigned char c = (unsigned char)*text;
        buffer[n++] = c < 0x20 || c == 0x7f || c == '"' || c == '\\' ? '?' : (char)c;
    }
    buffer[n++] = '"';
    buffer[n] = '\0';
    return buffer;
}

void log_event(enum log_level level, const char *event, const char *format, ...)
{
    if (level > log_threshold)
        return;
    char line[1024], time[CLOCK_TEXT_SIZE];
    int n;
    if (log_journal) {
        n = snprintf(line, sizeof line, "<%d>level=%s event=%s ", level_table[level].priority,
                     level_table[level].name, event);
    } else {
        clock_format(clock_wall_ms(), time);
        n = snprintf(line, sizeof line, "%s level=%s event=%s ", time, level_table[level].name, event);
    }
    va_list args;
    va_start(args, format);
    int more = vsnprintf(line + n, sizeof line - (size_t)n - 1, format, args);
    va_end(args);
    size_t length = (size_t)n + (more > 0 ? (size_t)more : 0);
    if (length > sizeof line - 2)
        length = sizeof line - 2;
    line[length] = '\n';
    /* Nothing can be done for a log that cannot be written. */
    if (write(STDERR_FILENO, line, length + 1) < 0)
        return;
}
