/* limits.h - every limit a user can run into, with its default; config.c may change some by flag. */
#ifndef DRAPED_LIMITS_H
#define DRAPED_LIMITS_H

#include <stddef.h>
#include <stdint.h>

/* What one API key may hold at a time; a key file may say other numbers for each of its keys. */
struct quota {
    uint64_t queued;     /* jobs that wait; 429 quota-queued */
    uint64_t running;    /* the others wait */
    uint64_t mesh_bytes; /* of uploaded meshes; 429 quota-meshes */
};

#define QUOTA_MAX_JOBS  1000000
#define QUOTA_MAX_BYTES ((uint64_t)1 << 50)

struct limits {
    size_t body_bytes;       /* one request body; 413 */
    size_t json_depth;       /* nesting of a job document; 400 */
    size_t json_values;      /* values (numbers, strings, ...) in a job document; 422 too-large */
    size_t vertices;         /* cloth, and each body mesh; 422 too-large */
    size_t triangles;        /* cloth, and each body mesh; 422 too-large */
    size_t bodies;           /* 422 too-large */
    size_t materials;        /* 422 too-large */
    size_t lines;            /* to be measured; 422 too-large */
    size_t line_vertices;    /* of all lines together; 422 too-large */
    size_t name_bytes;       /* job name; 422 */
    size_t labels;           /* 422 */
    uint32_t max_iterations; /* 422 */
    double time_limit_s;     /* 422 */
    size_t queued_jobs;      /* queued and running; 503 queue-full */
    uint64_t memory;         /* bytes of all running jobs, as estimated; the others wait */
    uint64_t job_memory;     /* bytes of one: 422 too-large-memory as estimated, memory-limit when it runs */
    size_t connections;      /* API listener */
    size_t streams;          /* event streams; 429 */
    size_t streams_per_key;  /* of them, those of one API key; 429 */
    size_t stream_jobs;      /* jobs in one event stream; 400 */
    size_t reading;          /* whole bodies waiting to be parsed, or being parsed; 503 busy */
    struct quota key;        /* of keys whose file says nothing else */
};

extern const struct limits limits_default;

#endif
