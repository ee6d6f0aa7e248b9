/* metrics.c - one table of names, help and kinds; see metrics.h. */
#include "metrics.h"

#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drape.h"
#include "memout.h"

enum metric_kind { GAUGE, COUNTER, HISTOGRAM };

struct metric_row {
    const char *name;
    enum metric_kind kind;
    const char *label; /* "" or one constant pair; rows of one name stand together */
    const char *help;
};

static const struct metric_row metric_table[METRICS] = {
    [METRIC_JOBS_QUEUED] = {"draped_jobs", GAUGE, "state=\"queued\"", "Jobs that have not ended."},
    [METRIC_JOBS_RUNNING] = {"draped_jobs", GAUGE, "state=\"running\"", "Jobs that have not ended."},
    [METRIC_OLDEST_QUEUED] = {"draped_oldest_queued_seconds", GAUGE, "",
                              "Age of the job that has waited longest."},
    [METRIC_JOBS_ACCEPTED] = {"draped_jobs_accepted_total", COUNTER, "", "Jobs accepted."},
    [METRIC_JOBS_SUCCEEDED] = {"draped_jobs_ended_total", COUNTER, "status=\"succeeded\"", "Jobs ended."},
    [METRIC_JOBS_FAILED] = {"draped_jobs_ended_total", COUNTER, "status=\"failed\"", "Jobs ended."},
    [METRIC_JOBS_CANCELED] = {"draped_jobs_ended_total", COUNTER, "status=\"canceled\"", "Jobs ended."},
    [METRIC_JOBS_REQUEUED] = {"draped_jobs_requeued_total", COUNTER, "",
                              "Running jobs put back to the queue by a restart."},
    [METRIC_JOBS_PRUNED] = {"draped_jobs_pruned_total", COUNTER, "",
                            "Ended jobs removed by age, number or size."},
    [METRIC_ITERATIONS] = {"draped_iterations_total", COUNTER, "", "Solver iterations of ended runs."},
    [METRIC_QUEUE_SECONDS] = {"draped_queue_seconds", HISTOGRAM, "", "Time from acceptance to start."},
    [METRIC_RUN_SECONDS] = {"draped_run_seconds", HISTOGRAM, "", "Time from start to end."},
    [METRIC_COMMIT_SECONDS] = {"draped_commit_seconds", HISTOGRAM, "", "Time of one store transaction."},
    [METRIC_STORE_ERRORS] = {"draped_store_errors_total", COUNTER, "", "Writes and reads refused."},
    [METRIC_FIELD_HITS] = {"draped_field_cache_hits_total", COUNTER, "",
                           "Body meshes whose distance field was there, or being built."},
    [METRIC_FIELD_MISSES] = {"draped_field_cache_misses_total", COUNTER, "",
                             "Body meshes whose distance field had to be built."},
    [METRIC_FIELD_BYTES] = {"draped_field_cache_bytes", GAUGE, "", "Held by distance fields that are kept."},
    [METRIC_FIELD_SECONDS] = {"draped_field_build_seconds", HISTOGRAM, "",
                              "Time to build one body's distance field, which no job's own seconds contain."},
    [METRIC_ANALYSIS_HITS] = {"draped_analysis_cache_hits_total", COUNTER, "",
                              "Step matrices whose symbolic factor an earlier job had left."},
    [METRIC_ANALYSIS_MISSES] = {"draped_analysis_cache_misses_total", COUNTER, "",
                                "Step matrices that had to be ordered and analysed."},
    [METRIC_ANALYSIS_BYTES] = {"draped_analysis_cache_bytes", GAUGE, "",
                               "Held by symbolic factors that are kept."},
    [METRIC_STREAMS] = {"draped_streams", GAUGE, "", "Event streams open."},
    [METRIC_CONNECTIONS] = {"draped_connections", GAUGE, "", "API connections open."},
    [METRIC_BYTES_FREE] = {"draped_data_free_bytes", GAUGE, "", "Space left for the data folder."},
    [METRIC_START_TIME] = {"process_start_time_seconds", GAUGE, "", "Start of the process since 1970."},
    [METRIC_CPU_SECONDS] = {"process_cpu_seconds_total", COUNTER, "",
                            "Processor time, in user and in system."},
    [METRIC_RESIDENT_BYTES] = {"process_resident_memory_bytes", GAUGE, "", "Memory in use."},
    [METRIC_OPEN_FDS] = {"process_open_fds", GAUGE, "", "Open file descriptors."},
    [METRIC_MAX_FDS] = {"process_max_fds", GAUGE, "", "How many there may be."},
    [METRIC_REQUEST_SECONDS] = {"draped_http_request_seconds", HISTOGRAM, "",
                                "Time from headers to the whole answer, streams and waits left out."},
};

/* From a commit of a millisecond to a job of an hour, about a factor of 3 apart. */
static const double bucket_limit[] = {0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100, 300, 1000, 3000};

#define BUCKETS (sizeof bucket_limit / sizeof *bucket_limit)

/* Some twenty routes with a handful of statuses each. */
#define MAX_REQUEST_COUNTS 512

struct request_count {
    const char *route;
    char method[12];
    int status;
    double count;
};

struct metrics {
    pthread_mutex_t lock;
    double value[METRICS];               /* of a histogram: the sum */
    double bucket[METRICS][BUCKETS + 1]; /* not cumulative; the last is +Inf */
    struct request_count request[MAX_REQUEST_COUNTS];
    size_t requests;
};

struct metrics *metrics_new(void)
{
    struct metrics *metrics = calloc(1, sizeof *metrics);
    if (metrics != NULL)
        pthread_mutex_init(&metrics->lock, NULL);
    return metrics;
}

struct metrics *metrics_free(struct metrics *metrics)
{
    if (metrics != NULL)
        pthread_mutex_destroy(&metrics->lock);
    free(metrics);
    return NULL;
}

void metrics_add(struct metrics *metrics, enum metric metric, double by)
{
    if (metrics == NULL)
        return;
    pthread_mutex_lock(&metrics->lock);
    metrics->value[metric] += by;
    pthread_mutex_unlock(&metrics->lock);
}

void metrics_set(struct metrics *metrics, enum metric metric, double value)
{
    if (metrics == NULL)
        return;
    pthread_mutex_lock(&metrics->lock);
    metrics->value[metric] = value;
    pthread_mutex_unlock(&metrics->lock);
}

void metrics_observe(struct metrics *metrics, enum metric metric, double value)
{
    if (metrics == NULL)
        return;
    size_t i = 0;
    while (i < BUCKETS && value > bucket_limit[i])
        i++;
    pthread_mutex_lock(&metrics->lock);
    metrics->value[metric] += value;
    metrics->bucket[metric][i] += 1;
    pthread_mutex_unlock(&metrics->lock);
}

void metrics_request(struct metrics *metrics, const char *route, const char *method, int status)
{
    if (metrics == NULL)
        return;
    pthread_mutex_lock(&metrics->lock);
    size_t i = 0;
    while (i < metrics->requests &&
           (metrics->request[i].status != status || strcmp(metrics->request[i].route, route) != 0 ||
            strcmp(metrics->request[i].method, method) != 0))
        i++;
    if (i == metrics->requests && i < MAX_REQUEST_COUNTS) {
        struct request_count *fresh = &metrics->request[metrics->requests++];
        fresh->route = route;
        fresh->status = status;
        snprintf(fresh->method, sizeof fresh->method, "%s", method);
    }
    if (i < metrics->requests)
        metrics->request[i].count += 1;
    pthread_mutex_unlock(&metrics->lock);
}

static void write_histogram(FILE *out, const struct metrics *metrics, enum metric metric)
{
    const char *name = metric_table[metric].name;
    double count = 0;
    for (size_t i = 0; i < BUCKETS; i++) {
        count += metrics->bucket[metric][i];
        fprintf(out, "%s_bucket{le=\"%g\"} %.0f\n", name, bucket_limit[i], count);
    }
    count += metrics->bucket[metric][BUCKETS];
    fprintf(out, "%s_bucket{le=\"+Inf\"} %.0f\n%s_sum %.17g\n%s_count %.0f\n", name, count, name,
            metrics->value[metric], name, count);
}

static void write_metric(FILE *out, const struct metrics *metrics, enum metric metric)
{
    static const char *const kind_name[] = {"gauge", "counter", "histogram"};
    const struct metric_row *row = &metric_table[metric];
    if (metric == 0 || strcmp(row->name, metric_table[metric - 1].name) != 0)
        fprintf(out, "# HELP %s %s\n# TYPE %s %s\n", row->name, row->help, row->name, kind_name[row->kind]);
    if (row->kind == HISTOGRAM)
        write_histogram(out, metrics, metric);
    else if (row->label[0] != '\0')
        fprintf(out, "%s{%s} %.17g\n", row->name, row->label, metrics->value[metric]);
    else
        fprintf(out, "%s %.17g\n", row->name, metrics->value[metric]);
}

static void write_requests(FILE *out, const struct metrics *metrics)
{
    fputs("# HELP draped_http_requests_total Requests answered; code 0: the client left first.\n"
          "# TYPE draped_http_requests_total counter\n",
          out);
    for (size_t i = 0; i < metrics->requests; i++) {
        const struct request_count *r = &metrics->request[i];
        fprintf(out, "draped_http_requests_total{route=\"%s\",method=\"%s\",code=\"%d\"} %.0f\n", r->route,
                r->method, r->status, r->count);
    }
}

char *metrics_text(struct metrics *metrics)
{
    struct memout memout;
    FILE *out = memout_open(&memout);
    if (out == NULL)
        return NULL;
    pthread_mutex_lock(&metrics->lock);
    for (int i = 0; i < METRICS; i++)
        write_metric(out, metrics, (enum metric)i);
    write_requests(out, metrics);
    pthread_mutex_unlock(&metrics->lock);
    fprintf(out,
            "# HELP draped_build_info The version that runs.\n# TYPE draped_build_info gauge\n"
            "draped_build_info{version=\"%s\"} 1\n",
            drape_version());
    fclose(out);
    return memout_take(&memout, NULL);
}
