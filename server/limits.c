/* limits.c - the default of every limit, each with its reason. */
#include "limits.h"

#include "drape.h"

const struct limits limits_default = {
    /* A cloth of 200 000 vertices and a body as large, printed with 17 digits, come to about 55 MB. */
    .body_bytes = 64u << 20,
    /* The deepest honest document (a point of a material's curve) has 7 levels; jansson recurses. */
    .json_depth = 32,
    /* jansson holds 11 to 22 bytes per input byte of numbers: 8 M values stay below 1 GB. */
    .json_values = 8u << 20,
    /* A factorisation of 200 000 nodes needs about 4 GB; beyond that a job is a batch, not a request. */
    .vertices = 200000,
    /* Twice the vertices, as in any large triangle mesh. */
    .triangles = 400000,
    .bodies = DRAPE_MAX_BODIES,
    /* One per pattern piece of a large garment, and room to spare. */
    .materials = 256,
    /* A tailor takes some twenty measures of a person. */
    .lines = 64,
    /* Twenty lines of a hundred; with 400 000 triangles to look at for each, a few seconds. */
    .line_vertices = 2048,
    .name_bytes = 200,
    .labels = 32,
    .max_iterations = DRAPE_MAX_ITERATIONS,
    /* An hour: no job holds a worker for ever. */
    .time_limit_s = 3600,
    /* At seconds a job, the thousandth waits for a good part of an hour: later ones had better retry. */
    .queued_jobs = 1000,
    /* The largest cloth of these limits needs about 4 GB; two of them at a time. */
    .memory = 8000000000,
    .job_memory = 4500000000,
    /* Half of the usual 1024 descriptors; the rest serve spools, results and the store. */
    .connections = 512,
    /* Below the connections, so that streams alone can never shut everybody else out. */
    .streams = 128,
    /* Two keys cannot shut out a third. */
    .streams_per_key = 48,
    /* What a page of a queue shows; the ids of 64 jobs, in a query or an event's id, stay below 4 kB. */
    .stream_jobs = 64,
    /* Times body_bytes: 1 GiB of spool files, and a wait of a second or two for the parser. */
    .reading = 16,
    /* A tenth of all places; fair share keeps the workers from being one key's; a thousand bodies. */
    .key = {.queued = 100, .running = 256, .mesh_bytes = 1000000000},
};
