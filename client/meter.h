/* meter.h - shows a running job: one live line on a terminal, a plain line now and then elsewhere. */
#ifndef DRAPE_CLIENT_METER_H
#define DRAPE_CLIENT_METER_H

#include <jansson.h>
#include <stdbool.h>
#include <stdio.h>

struct meter {
    FILE *file;      /* borrowed; NULL: shows nothing */
    bool live;       /* a terminal: rewrites one line */
    bool dirty;      /* a live line stands without its newline */
    double shown_at; /* s, monotonic */
    char state[32];  /* the status shown last */
};

struct meter meter_new(FILE *file, bool quiet);

/* A job's status, such as "queued"; shown when it changed. */
void meter_status(struct meter *meter, const char *status);

/* A progress object of the contract; any member may be missing. */
void meter_progress(struct meter *meter, const json_t *progress);

/* Ends the live line, so that other text can follow. */
void meter_close(struct meter *meter);

#endif
