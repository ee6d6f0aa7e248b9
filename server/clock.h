/* clock.h - the two clocks: monotonic for durations, wall time for people. */
#ifndef DRAPED_CLOCK_H
#define DRAPED_CLOCK_H

#include <stdint.h>

#define CLOCK_TEXT_SIZE 32

int64_t clock_monotonic_ms(void); /* never goes back; meaningless across restarts */
double clock_monotonic_s(void);   /* likewise, to the nanosecond */
int64_t clock_wall_ms(void);      /* since 1970, UTC; may jump */

/* Wall time when the process started and what has passed since: for ages, which must not jump. */
int64_t clock_steady_ms(void);

/* "2007-06-25T09:30:00.125Z" (RFC 3339) */
void clock_format(int64_t wall_ms, char ret[CLOCK_TEXT_SIZE]);

/* Any date-time of RFC 3339 from 1970 on, to the millisecond (cut); 0, or -1. */
int clock_parse(const char *text, int64_t *ret_wall_ms);

#endif
