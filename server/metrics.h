/* metrics.h - what the daemon counts, in Prometheus text format 0.0.4.
 *
 * Any thread may call anything; one lock inside, held for a few instructions, nothing locked under it.
 * Counts never fail: what cannot be counted (a full table of routes) is left out. */
#ifndef DRAPED_METRICS_H
#define DRAPED_METRICS_H

enum metric { /* names, help and types: the table in metrics.c, in this order */
              METRIC_JOBS_QUEUED = 0,
              METRIC_JOBS_RUNNING,
              METRIC_OLDEST_QUEUED, /* s */
              METRIC_JOBS_ACCEPTED,
              METRIC_JOBS_SUCCEEDED,
              METRIC_JOBS_FAILED,
              METRIC_JOBS_CANCELED,
              METRIC_JOBS_REQUEUED,
              METRIC_JOBS_PRUNED,
              METRIC_ITERATIONS,
              METRIC_QUEUE_SECONDS,  /* observed when a job starts */
              METRIC_RUN_SECONDS,    /* observed when a job ends */
              METRIC_COMMIT_SECONDS, /* observed at each transaction of the store */
              METRIC_STORE_ERRORS,
              METRIC_FIELD_HITS,
              METRIC_FIELD_MISSES,
              METRIC_FIELD_BYTES,
              METRIC_FIELD_SECONDS, /* observed at each that is built */
              METRIC_ANALYSIS_HITS,
              METRIC_ANALYSIS_MISSES,
              METRIC_ANALYSIS_BYTES,
              METRIC_STREAMS,
              METRIC_CONNECTIONS,
              METRIC_BYTES_FREE,
              METRIC_START_TIME,
              METRIC_CPU_SECONDS,
              METRIC_RESIDENT_BYTES,
              METRIC_OPEN_FDS,
              METRIC_MAX_FDS,
              METRIC_REQUEST_SECONDS, /* observed at each request but event streams and waits */
              METRICS
};

struct metrics;

struct metrics *metrics_new(void); /* NULL when out of memory */
struct metrics *metrics_free(struct metrics *metrics);

/* `metrics` may be NULL in all three: then nothing happens. */
void metrics_add(struct metrics *metrics, enum metric metric, double by);
void metrics_set(struct metrics *metrics, enum metric metric, double value);
void metrics_observe(struct metrics *metrics, enum metric metric, double value); /* histograms */

/* One more request to `route` (a static template such as "/v1/jobs/{id}", never an id). */
void metrics_request(struct metrics *metrics, const char *route, const char *method, int status);

/* The exposition; malloc'd, NULL when out of memory. */
char *metrics_text(struct metrics *metrics);

#endif
