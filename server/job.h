/* job.h - a job as the API shows it: its facts, its revision, and its JSON body. */
#ifndef DRAPED_JOB_H
#define DRAPED_JOB_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "id.h"
#include "traceparent.h"
#include "keys.h"

enum job_status { JOB_QUEUED = 0, JOB_RUNNING, JOB_SUCCEEDED, JOB_FAILED, JOB_CANCELED, JOB_STATUSES };

const char *job_status_name(enum job_status status); /* "queued" */
int job_status_from_name(const char *name);          /* -1: unknown */
bool job_status_ended(enum job_status status);

/* Grows with every change that a client can see. Written "attempt.counter": a restart that loses the
 * counters of running jobs also raises their attempt, so that no revision is ever given twice. */
struct revision {
    uint32_t attempt; /* 1 for the first; the fencing token of every write to the store */
    uint32_t counter; /* 1 for the first of the attempt */
};

#define REVISION_SIZE 24

void revision_format(struct revision revision, char ret[REVISION_SIZE]);
int revision_parse(const char *text, struct revision *ret); /* 0, or -1: not one of ours */
int revision_compare(struct revision a, struct revision b); /* < 0, 0, > 0 */

enum job_priority { JOB_PRIORITY_LOW = -1, JOB_PRIORITY_NORMAL, JOB_PRIORITY_HIGH };
#define JOB_PRIORITIES 3

const char *job_priority_name(int priority); /* "normal"; any other number counts as the nearest */

#define JOB_VERDICT_SIZE 16

struct job { /* owns its texts; zero-initialise; job_done empties it */
    char id[ID_SIZE];
    char owner[KEY_NAME_SIZE];    /* the key that posted it; "": none was needed */
    char trace_id[TRACE_ID_SIZE]; /* of the request that posted it; "": none */
    int priority;                 /* enum job_priority */
    uint64_t memory;              /* bytes that its solve is expected to need; 0: not known */
    enum job_status status;
    char verdict[JOB_VERDICT_SIZE]; /* "": none yet */
    struct revision revision;
    unsigned crashes;    /* times the daemon died while the job ran */
    bool cancel;         /* somebody asked for it to be cancelled */
    int64_t created_ms;  /* wall time */
    int64_t started_ms;  /* of this attempt; 0: not yet */
    int64_t finished_ms; /* 0: not yet */
    bool preview;        /* there is one now; never of an ended job */
    char *name;          /* NULL: none */
    char *labels;        /* JSON object, or NULL */
    char *warnings;      /* JSON array of what the job does that is hardly meant, or NULL: none */
    char *progress;      /* JSON object, or NULL */
    char *report;        /* JSON object, or NULL */
    char *error;         /* JSON object (a problem), or NULL */
};

void job_done(struct job *job);
int job_copy(const struct job *job, struct job *ret); /* 0, or -1 when out of memory */

/* The job resource of the v1 contract, one line of JSON without a newline; malloc'd, NULL when out of
 * memory. `position` is its place in the queue, 1 for the next to run; 0: not queued. */
char *job_body(const struct job *job, size_t position);

#endif
