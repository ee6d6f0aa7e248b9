/* interrupt.h - Ctrl-C as a flag that waiting loops look at. */
#ifndef DRAPE_CLIENT_INTERRUPT_H
#define DRAPE_CLIENT_INTERRUPT_H

#include <stdbool.h>

/* From now on the first SIGINT sets the flag; the second ends the process as usual. */
void interrupt_arm(void);
bool interrupt_seen(void);

#endif
