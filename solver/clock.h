/* clock.h - what the report's seconds are measured with. */
#ifndef DR_CLOCK_H
#define DR_CLOCK_H

double dr_clock(void); /* s, monotonic */

#endif
