/* compare.c - see compare.h. */
#include "compare.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "job.h"

const double compare_level[COMPARE_LEVELS] = {1e-3, 1e-6, 1e-9};

static const struct compare_cost NEVER = {NAN, NAN, NAN};

/* ---- what a job said ----------------------------------------------------------------------------- */

static const char *text_of(const json_t *object, const char *key)
{
    const char *text = json_string_value(json_object_get(object, key));
    return text ? text : "";
}

static double number_of(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);
    return json_is_number(value) ? json_number_value(value) : NAN;
}

const char *compare_outcome(const struct compare_run *run)
{
    const char *verdict = text_of(run->job, "verdict");
    return !run->job ? "refused" : verdict[0] ? verdict : job_status(run->job);
}

const char *compare_reason(const struct compare_run *run)
{
    const json_t *error = json_object_get(run->job, "error");
    if (run->refusal) {
        return run->refusal;
    }
    return json_is_object(error) ? text_of(error, "detail")
                                 : text_of(json_object_get(run->job, "report"), "reason");
}

double compare_figure(const struct compare_run *run, const char *key)
{
    return number_of(json_object_get(run->job, "report"), key);
}

/* Of the state that the job returned, with all digits; a server without a report leaves the last row. */
static double final_energy(const struct compare_run *run)
{
    const json_t *report = json_object_get(run->job, "report");
    double energy = number_of(json_object_get(report, "energies"), "potential");
    return !isfinite(energy) && run->trace.rows > 0 ? run->trace.row[run->trace.rows - 1].potential : energy;
}

/* A piece that slid off falls without end, and one inside a body has lost energy that it may not lose:
 * neither says how low the cloth can hang. */
static void read_run(struct compare_run *run)
{
    const json_t *certificate = json_object_get(json_object_get(run->job, "report"), "certificate");
    const char *verdict = text_of(run->job, "verdict");
    run->at_rest = strcmp(verdict, "at-rest") == 0;
    run->certified = json_is_true(json_object_get(certificate, "certified"));
    run->energy = final_energy(run);
    run->usable = run->trace.rows > 0 && isfinite(run->energy) && strcmp(verdict, "slid-off") != 0 &&
                  strcmp(verdict, "intersecting") != 0;
    run->distance = NAN;
    run->other_minimum = false;
}

/* ---- E0 and E* ----------------------------------------------------------------------------------- */

static bool is_better(const struct compare_run *run, const struct compare_run *than)
{
    if (!than || run->certified != than->certified) {
        return !than || run->certified;
    }
    return run->energy < than->energy;
}

static void find_best(struct comparison *c)
{
    for (size_t i = 0; i < c->runs; i++) {
        if (c->run[i].usable && is_better(&c->run[i], c->from)) {
            c->from = &c->run[i];
        }
    }
    if (c->from) {
        c->best = c->from->energy;
        c->certified = c->from->certified;
    }
}

/* All methods start from one state, so that any run tells E0; the one behind E* is as good as another. */
static void find_start(struct comparison *c)
{
    if (!c->from) {
        return;
    }
    c->start = c->from->trace.row[0].potential;
    c->drop = c->start > c->best ? c->start - c->best : NAN;
    for (size_t i = 0; i < c->runs; i++) {
        const struct trace *trace = &c->run[i].trace;
        double slack = fmax(trace_resolution(trace, c->start), 1e-12 * fabs(c->drop));
        if (trace->rows > 0 && fabs(trace->row[0].potential - c->start) > slack) {
            c->starts_differ = true;
        }
    }
}

/* How far the rows of a trace went below E* (J). */
static double dip_of(const struct comparison *c, const struct trace *trace)
{
    double dip = 0;
    for (size_t i = 0; i < trace->rows; i++) {
        dip = fmax(dip, c->best - trace->row[i].potential);
    }
    return dip;
}

/* One server wrote all traces: the one that shows the most digits tells how many there are (J). */
static double resolution_of(const struct comparison *c)
{
    double finest = INFINITY;
    for (size_t i = 0; i < c->runs; i++) {
        if (c->run[i].usable) {
            finest = fmin(finest, trace_resolution(&c->run[i].trace, c->best));
        }
    }
    return isfinite(finest) ? finest : 0;
}

static void find_floor(struct comparison *c)
{
    double left = c->from ? compare_figure(c->from, "residual_energy") : 0;
    c->floor = resolution_of(c);
    if (!c->certified && isfinite(left)) {
        c->floor = fmax(c->floor, left);
    }
    for (size_t i = 0; i < c->runs && !c->certified; i++) {
        if (c->run[i].usable) {
            c->floor = fmax(c->floor, dip_of(c, &c->run[i].trace));
        }
    }
    c->floor /= c->drop;
}

/* ---- what it took -------------------------------------------------------------------------------- */

/* Where distances are 0 and 1 (J). */
struct scale {
    double end, start;
};

static double distance_on(struct scale scale, double energy)
{
    return isfinite(energy) && scale.start > scale.end ? (energy - scale.end) / (scale.start - scale.end)
                                                       : NAN;
}

double compare_distance(const struct comparison *c, double energy)
{
    return distance_on((struct scale){c->best, c->start}, energy);
}

static struct compare_cost cost_of_row(const struct trace *trace, size_t row)
{
    struct compare_cost cost = {trace->row[row].iteration, trace->row[row].seconds, 0};
    for (size_t i = 0; i <= row; i++) {
        cost.factorizations += trace->row[i].factorizations;
    }
    return cost;
}

/* The first row from which on every row is within `level`: to touch it on the way does not count. */
static struct compare_cost cost_of_level(struct scale scale, const struct trace *trace, double level)
{
    size_t row = trace->rows;
    while (row > 0 && distance_on(scale, trace->row[row - 1].potential) <= level) {
        row--;
    }
    return row < trace->rows ? cost_of_row(trace, row) : NEVER;
}

static void reckon_run(struct comparison *c, struct compare_run *run)
{
    const struct trace *trace = &run->trace;
    for (size_t l = 0; l < COMPARE_LEVELS; l++) {
        struct scale common = {c->best, c->start}, own = {run->energy, c->start};
        run->level[l] = run->usable ? cost_of_level(common, trace, compare_level[l]) : NEVER;
        run->own[l] = run->usable && run->at_rest ? cost_of_level(own, trace, compare_level[l]) : NEVER;
    }
    run->rest = run->at_rest && trace->rows > 0 ? cost_of_row(trace, trace->rows - 1) : NEVER;
    if (isfinite(run->rest.iterations) && !isfinite(run->rest.factorizations)) {
        run->rest.factorizations = compare_figure(run, "factorizations"); /* all there were */
    }
    run->distance = compare_distance(c, run->energy);
    run->other_minimum =
        run->usable && (run->at_rest || run->certified) && fabs(run->distance) > COMPARE_SAME_MINIMUM;
    c->minima_differ |= run->other_minimum;
    c->below_best |= run->usable && run->energy < c->best;
}

void compare_reckon(struct comparison *c)
{
    *c = (struct comparison){
        .run = c->run, .runs = c->runs, .start = NAN, .best = NAN, .drop = NAN, .floor = NAN};
    for (size_t i = 0; i < c->runs; i++) {
        read_run(&c->run[i]);
    }
    find_best(c);
    find_start(c);
    find_floor(c);
    for (size_t i = 0; i < c->runs; i++) {
        reckon_run(c, &c->run[i]);
    }
}

void compare_run_done(struct compare_run *run)
{
    json_decref(run->job);
    free(run->refusal);
    trace_done(&run->trace);
    *run = (struct compare_run){.spec = run->spec};
}
