/* clock.c - see clock.h. */
#include "clock.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <time.h>

static int64_t read_clock(clockid_t id)
{
    struct timespec t;
    clock_gettime(id, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

int64_t clock_monotonic_ms(void)
{
    return read_clock(CLOCK_MONOTONIC);
}

double clock_monotonic_s(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int64_t clock_wall_ms(void)
{
    return read_clock(CLOCK_REALTIME);
}

static int64_t steady_from; /* wall time less monotonic time */

static void start_steady(void)
{
    steady_from = clock_wall_ms() - clock_monotonic_ms();
}

int64_t clock_steady_ms(void)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, start_steady);
    return steady_from + clock_monotonic_ms();
}

void clock_format(int64_t wall_ms, char ret[CLOCK_TEXT_SIZE])
{
    time_t seconds = (time_t)(wall_ms / 1000);
    struct tm tm;
    char date[20] = "1970-01-01T00:00:00";
    if (gmtime_r(&seconds, &tm) != NULL)
        strftime(date, sizeof date, "%Y-%m-%dT%H:%M:%S", &tm);
    snprintf(ret, CLOCK_TEXT_SIZE, "%s.%03dZ", date, (int)(wall_ms % 1000));
}

/* Exactly `digits` digits, from `low` to `high`, then `end` ('\0': whatever follows); NULL when not. */
static const char *take(const char *p, int digits, int low, int high, char end, int *ret)
{
    int value = 0;
    for (; digits > 0; digits--, p++) {
        if (*p < '0' || *p > '9')
            return NULL;
        value = 10 * value + (*p - '0');
    }
    if (value < low || value > high || (end != '\0' && *p++ != end))
        return NULL;
    *ret = value;
    return p;
}

/* ".125", or nothing: milliseconds; further digits are cut. */
static const char *take_fraction(const char *p, int *ret_ms)
{
    *ret_ms = 0;
    if (*p != '.')
        return p;
    const char *first = ++p;
    for (int weight = 100; *p >= '0' && *p <= '9'; p++, weight /= 10)
        *ret_ms += weight * (*p - '0');
    return p > first ? p : NULL;
}

/* "Z" or "+01:30". */
static const char *take_offset(const char *p, int *ret_minutes)
{
    int hours, minutes;
    *ret_minutes = 0;
    if (*p == 'Z' || *p == 'z')
        return p + 1;
    int sign = *p == '-' ? -1 : 1;
    if (*p != '+' && *p != '-')
        return NULL;
    if ((p = take(p + 1, 2, 0, 23, ':', &hours)) != NULL && (p = take(p, 2, 0, 59, '\0', &minutes)) != NULL)
        *ret_minutes = sign * (60 * hours + minutes);
    return p;
}

int clock_parse(const char *text, int64_t *ret_wall_ms)
{
    struct tm tm = {0}, back;
    int ms = 0, minutes = 0;
    const char *p = take(text, 4, 1970, 9999, '-', &tm.tm_year);
    p = p == NULL ? NULL : take(p, 2, 1, 12, '-', &tm.tm_mon);
    p = p == NULL ? NULL : take(p, 2, 1, 31, '\0', &tm.tm_mday);
    if (p == NULL || (*p != 'T' && *p != 't'))
        return -1;
    p = take(p + 1, 2, 0, 23, ':', &tm.tm_hour);
    p = p == NULL ? NULL : take(p, 2, 0, 59, ':', &tm.tm_min);
    p = p == NULL ? NULL : take(p, 2, 0, 60, '\0', &tm.tm_sec); /* 60: a leap second */
    p = p == NULL ? NULL : take_fraction(p, &ms);
    p = p == NULL ? NULL : take_offset(p, &minutes);
    if (p == NULL || *p != '\0')
        return -1;
    tm.tm_year -= 1900;
    tm.tm_mon--;
    int day = tm.tm_mday;
    back = tm;
    time_t seconds = timegm(&back);
    if (gmtime_r(&seconds, &back) == NULL || (tm.tm_sec < 60 && back.tm_mday != day))
        return -1; /* February 30 */
    *ret_wall_ms = ((int64_t)seconds - 60 * minutes) * 1000 + ms;
    return 0;
}
