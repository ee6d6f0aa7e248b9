/* comparing.h - made-up runs for the tests of the reckoning, the figures and the page. */
#ifndef DRAPE_TEST_COMPARING_H
#define DRAPE_TEST_COMPARING_H

#include "test.h"

#include "compare.h"

/* A job that ended with `verdict` at `energy`; `more` adds members to its report (",\"x\":1"). */
static inline json_t *made_job(const char *verdict, double energy, const char *more)
{
    char text[512], number[40] = "null";
    if (isfinite(energy)) {
        snprintf(number, sizeof number, "%.17g", energy);
    }
    snprintf(text, sizeof text,
             "{\"id\":\"j1\",\"status\":\"succeeded\",\"verdict\":\"%s\",\"created_at\":\"2024-02-29\","
             "\"report\":{\"reason\":\"so it is\",\"factorizations\":9,\"certificate\":null,"
             "\"energies\":{\"potential\":%s}%s}}",
             verdict, number, more);
    json_t *job = json_loads(text, 0, NULL);
    assert_non_null(job);
    return job;
}

/* A trace of those potential energies: 0.5 s and two factorisations each iteration, no stops. */
static inline struct trace made_trace(const double *potential, size_t rows)
{
    struct trace trace = {calloc(rows + 1, sizeof(struct trace_row)), rows};
    assert_non_null(trace.row);
    for (size_t i = 0; i < rows; i++) {
        trace.row[i] = (struct trace_row){.iteration = (double)i,
                                          .seconds = 0.5 * (double)i,
                                          .gravity = potential[i],
                                          .potential = potential[i],
                                          .residual_energy = NAN,
                                          .factorizations = 2};
    }
    return trace;
}

/* At rest at the last of its energies. */
static inline struct compare_run made_run(const char *spec, const double *potential, size_t rows)
{
    return (struct compare_run){.spec = spec,
                                .job = made_job("at-rest", rows > 0 ? potential[rows - 1] : 0, ""),
                                .trace = made_trace(potential, rows)};
}
#define MADE_RUN(spec, ...)                                                                                  \
    made_run(spec, (const double[]){__VA_ARGS__}, sizeof((const double[]){__VA_ARGS__}) / sizeof(double))

static inline struct compare_run refused_run(const char *spec, const char *why)
{
    return (struct compare_run){.spec = spec, .refusal = strdup(why)};
}

static inline void replace_job(struct compare_run *run, json_t *job)
{
    json_decref(run->job);
    run->job = job;
}

static inline void free_runs(struct comparison *c)
{
    for (size_t i = 0; i < c->runs; i++) {
        compare_run_done(&c->run[i]);
    }
}

#endif
