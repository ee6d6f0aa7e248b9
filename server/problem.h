/* problem.h - every error the API can give: one table of codes, and RFC 9457 bodies.
 *
 * A room that must refuse fills a struct problem; the room that answers (or logs) turns it into
 * application/problem+json. Codes are part of the contract: see problem.c for the table. */
#ifndef DRAPED_PROBLEM_H
#define DRAPED_PROBLEM_H

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>

enum problem_code {
    PROBLEM_NONE = 0,
    PROBLEM_BAD_REQUEST,        /* 400 */
    PROBLEM_BAD_JSON,           /* 400: not JSON; detail has line and column */
    PROBLEM_BAD_CURSOR,         /* 400 */
    PROBLEM_BAD_ENCODING,       /* 400: the body is not in its Content-Encoding */
    PROBLEM_DIGEST_MISMATCH,    /* 400: the body's SHA-256 is not the one in the path */
    PROBLEM_UNAUTHORIZED,       /* 401 */
    PROBLEM_NOT_FOUND,          /* 404 */
    PROBLEM_METHOD_NOT_ALLOWED, /* 405 */
    PROBLEM_NOT_ACCEPTABLE,     /* 406 */
    PROBLEM_NOT_READY,          /* 409: no result yet */
    PROBLEM_NO_RESULT,          /* 409: ended without one */
    PROBLEM_IN_USE,             /* 409: a job that has not ended needs it */
    PROBLEM_KEY_IN_FLIGHT,      /* 409: the first request with that Idempotency-Key is not answered yet */
    PROBLEM_GONE,               /* 410 */
    PROBLEM_PRECONDITION,       /* 412 */
    PROBLEM_LENGTH,             /* 413: body too large */
    PROBLEM_MEDIA_TYPE,         /* 415 */
    PROBLEM_ENCODING,           /* 415: another Content-Encoding */
    PROBLEM_EXPECTATION,        /* 417 */
    PROBLEM_INVALID,            /* 422: a member of the job or mesh is wrong; errors[] has pointers */
    PROBLEM_UNSUPPORTED,        /* 422: in the contract, not in this version; errors[] has pointers */
    PROBLEM_TOO_LARGE,          /* 422: a count over its limit; errors[] has pointers */
    PROBLEM_KEY_MISMATCH,       /* 422: that Idempotency-Key came with another body */
    PROBLEM_TOO_LARGE_MEMORY,   /* 422: the job would need more memory than one may have */
    PROBLEM_TOO_MANY_STREAMS,   /* 429 */
    PROBLEM_QUOTA_QUEUED,       /* 429: the key's share of the queue */
    PROBLEM_QUOTA_MESHES,       /* 429: the key's bytes of meshes */
    PROBLEM_INTERNAL,           /* 500 */
    PROBLEM_QUEUE_FULL,         /* 503 */
    PROBLEM_DRAINING,           /* 503 */
    PROBLEM_STORAGE,            /* 503: the data folder refused a write */
    PROBLEM_BUSY,               /* 503: too many requests are being read at once */
    PROBLEM_SOLVER,             /* a job's `error`: the solver gave no result */
    PROBLEM_WORKER_CRASH,       /* a job's `error`: the third crash */
    PROBLEM_MEMORY_LIMIT,       /* a job's `error`: it came to need more memory than one may have */
    PROBLEM_CODES
};

#define PROBLEM_MAX_ERRORS 8

struct problem {
    enum problem_code code;
    char detail[256]; /* one sentence for a person */
    struct problem_member {
        char pointer[128]; /* JSON pointer into the body (RFC 6901), "" for the whole */
        char detail[200];
    } errors[PROBLEM_MAX_ERRORS];
    size_t error_count;
    unsigned retry_s; /* when the same request may succeed; 0: soon, or never */
};

int problem_status(enum problem_code code);       /* HTTP status */
const char *problem_name(enum problem_code code); /* "queue-full" */
const char *problem_title(enum problem_code code);
bool problem_retryable(enum problem_code code);

/* Fills *p (all of it) and returns -1, so that a parser can end with it. p may be NULL. */
__attribute__((format(printf, 3, 4))) int problem_set(struct problem *p, enum problem_code code,
                                                      const char *format, ...);

/* The same with one errors[] entry at `pointer`; `detail` becomes the entry's text. */
__attribute__((format(printf, 4, 5))) int problem_at(struct problem *p, enum problem_code code,
                                                     const char *pointer, const char *format, ...);

/* New reference, or NULL when out of memory. `instance` and `request_id` may be NULL. */
json_t *problem_json(const struct problem *p, const char *instance, const char *request_id);

/* The same as text for what there is no memory to say: PROBLEM_INTERNAL, "out of memory". */
extern const char problem_no_memory[];

#endif
