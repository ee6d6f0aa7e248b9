/* compare_figures.c - see compare_figures.h. */
#include "compare_figures.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "job.h"

void compare_cost_text(double cost, bool whole, char ret[32])
{
    if (!isfinite(cost)) {
        snprintf(ret, 32, "-");
    } else {
        snprintf(ret, 32, whole ? "%.0f" : cost < 10 ? "%.3f" : "%.1f", cost);
    }
}

/* ---- notes --------------------------------------------------------------------------------------- */

struct note_taker {
    compare_note_fn *put;
    void *user;
};

__attribute__((format(printf, 2, 3))) static void say(const struct note_taker *taker, const char *format, ...)
{
    char text[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    taker->put(text, taker->user);
}

static void note_best(const struct comparison *c, const struct note_taker *taker)
{
    if (!c->from) {
        say(taker, "No method gave a state to measure from: there is no E*.");
        return;
    }
    if (c->certified) {
        say(taker, "E* = %.12g J is the lowest certified energy, of %.200s; E0 = %.12g J.", c->best,
            c->from->spec, c->start);
    } else {
        say(taker,
            "E* = %.12g J is the lowest energy that any method reached, %.200s; E0 = %.12g J. "
            "It is uncertified: nothing proves that the cloth cannot hang lower%s.",
            c->best, c->from->spec, c->start,
            c->from->at_rest ? "" : ", and that method had not come to rest, so that its minimum lies lower");
    }
    if (!isfinite(c->drop)) {
        say(taker, "No state lies below the start, so that there is no distance to measure.");
    } else if (c->floor > compare_level[COMPARE_LEVELS - 1]) {
        say(taker,
            "Distances below %.1e are not known (marked *): so far reach the digits of the traces and what "
            "is "
            "known of E*, which one more method with a tighter tolerance would sharpen.",
            c->floor);
    }
}

static void note_minima(const struct comparison *c, const struct note_taker *taker)
{
    for (size_t i = 0; i < c->runs; i++) {
        if (c->run[i].other_minimum) {
            say(taker,
                "The minima differ: %.200s rests at %.12g J, %.2e of E0 - E* away from E* "
                "(more than %.0e counts as another minimum). The line below it in the table counts to its "
                "own minimum.",
                c->run[i].spec, c->run[i].energy, c->run[i].distance, COMPARE_SAME_MINIMUM);
        }
    }
    size_t at_rest = 0;
    for (size_t i = 0; i < c->runs; i++) {
        at_rest += c->run[i].usable && c->run[i].at_rest;
    }
    if (at_rest == 0) {
        say(taker, "No method came to rest.");
    } else if (!c->minima_differ && isfinite(c->drop)) {
        say(taker, "All methods that came to rest did so within %.0e of E0 - E* of E*.",
            COMPARE_SAME_MINIMUM);
    }
}

void compare_each_note(const struct comparison *c, compare_note_fn *put, void *user)
{
    const struct note_taker taker = {put, user};
    note_best(c, &taker);
    note_minima(c, &taker);
    if (c->below_best) {
        say(&taker, "An uncertified method ended below the certified E*.");
    }
    if (c->starts_differ) {
        say(&taker,
            "The methods did not start from the same energy, so that their distances do not compare.");
    }
}

/* ---- table --------------------------------------------------------------------------------------- */

static void put_note(const char *sentence, void *user)
{
    fprintf(user, "%s\n", sentence);
}

static int spec_width(const struct comparison *c)
{
    size_t width = strlen("method");
    for (size_t i = 0; i < c->runs; i++) {
        size_t length = strlen(c->run[i].spec);
        width = length > width ? length : width;
    }
    return width < 60 ? (int)width : 60;
}

/* Iterations, factorisations and seconds; a star where the level lies below what is known. */
static void put_cost(FILE *file, const struct compare_cost *cost, bool known)
{
    char iterations[32], factorizations[32], seconds[32];
    compare_cost_text(cost->iterations, true, iterations);
    compare_cost_text(cost->factorizations, true, factorizations);
    compare_cost_text(cost->seconds, false, seconds);
    fprintf(file, " %7s%s %6s %8s", iterations, known || !isfinite(cost->iterations) ? " " : "*",
            factorizations, seconds);
}

static bool level_known(const struct comparison *c, size_t level)
{
    return !(compare_level[level] < c->floor);
}

static void put_figure(FILE *file, int width, int digits, double value)
{
    char text[40] = "-";
    if (isfinite(value)) {
        snprintf(text, sizeof text, "%.*g", digits, value);
    }
    fprintf(file, "  %*s", width, text);
}

static void put_run(FILE *file, const struct comparison *c, const struct compare_run *run, int width)
{
    fprintf(file, "%-*s  %-12s", width, run->spec, compare_outcome(run));
    if (!run->job) {
        fprintf(file, "  %s\n", compare_reason(run));
        return;
    }
    for (size_t l = 0; l < COMPARE_LEVELS; l++) {
        put_cost(file, &run->level[l], level_known(c, l));
    }
    put_cost(file, &run->rest, true);
    put_figure(file, 9, 3, compare_figure(run, "residual_force"));
    put_figure(file, 0, 10, run->energy);
    fputc('\n', file);
    if (run->at_rest && run->other_minimum) {
        fprintf(file, "%*s  %-12s", width, "", "to its own");
        for (size_t l = 0; l < COMPARE_LEVELS; l++) {
            put_cost(file, &run->own[l], true);
        }
        fputc('\n', file);
    }
}

void compare_put_table(FILE *file, const struct comparison *c)
{
    int width = spec_width(c);
    fprintf(file, "%-*s  %-12s", width, "method", "ended");
    for (size_t l = 0; l < COMPARE_LEVELS; l++) {
        fprintf(file, "   to %-5.0e %6s %8s", compare_level[l], "fact.", "s");
    }
    fprintf(file, " %7s  %6s %8s  %9s  %s\n", "to rest", "fact.", "s", "force", "energy J");
    for (size_t i = 0; i < c->runs; i++) {
        put_run(file, c, &c->run[i], width);
    }
    compare_each_note(c, put_note, file);
}

/* ---- JSON ---------------------------------------------------------------------------------------- */

static int set_number(json_t *object, const char *key, double value)
{
    return json_object_set_new(object, key, isfinite(value) ? json_real(value) : json_null());
}

static json_t *cost_to_json(const struct compare_cost *cost)
{
    json_t *object = json_object();
    int failed = set_number(object, "iterations", cost->iterations);
    failed |= set_number(object, "factorizations", cost->factorizations);
    failed |= set_number(object, "seconds", cost->seconds);
    if (failed) {
        json_decref(object);
        return NULL;
    }
    return object;
}

static json_t *run_to_json(const struct compare_run *run)
{
    json_t *object = json_object();
    int failed = json_object_set_new(object, "method", json_string(run->spec));
    failed |= json_object_set_new(object, "id", run->job ? json_string(job_id(run->job)) : json_null());
    failed |= json_object_set_new(object, "outcome", json_string(compare_outcome(run)));
    failed |= json_object_set_new(object, "reason", json_string(compare_reason(run)));
    failed |= json_object_set_new(object, "certified", json_boolean(run->certified));
    failed |= json_object_set_new(object, "other_minimum", json_boolean(run->other_minimum));
    failed |= set_number(object, "energy", run->energy);
    failed |= set_number(object, "distance", run->distance);
    failed |= set_number(object, "residual_force", compare_figure(run, "residual_force"));
    failed |= set_number(object, "residual_energy", compare_figure(run, "residual_energy"));
    failed |= set_number(object, "iterations", compare_figure(run, "iterations"));
    failed |= set_number(object, "factorizations", compare_figure(run, "factorizations"));
    failed |= set_number(object, "seconds", compare_figure(run, "seconds"));
    for (size_t l = 0; l < COMPARE_LEVELS; l++) {
        char key[16];
        snprintf(key, sizeof key, "to_%.0e", compare_level[l]);
        failed |= json_object_set_new(object, key, cost_to_json(&run->level[l]));
        snprintf(key, sizeof key, "own_%.0e", compare_level[l]);
        failed |= json_object_set_new(object, key, cost_to_json(&run->own[l]));
    }
    failed |= json_object_set_new(object, "to_rest", cost_to_json(&run->rest));
    if (failed) {
        json_decref(object);
        return NULL;
    }
    return object;
}

json_t *compare_to_json(const struct comparison *c)
{
    json_t *object = json_object(), *runs = json_array();
    int failed = set_number(object, "start_energy", c->start);
    failed |= set_number(object, "best_energy", c->best);
    failed |= json_object_set_new(object, "best_method", c->from ? json_string(c->from->spec) : json_null());
    failed |= json_object_set_new(object, "certified", json_boolean(c->certified));
    failed |= set_number(object, "distance_floor", c->floor);
    failed |= set_number(object, "same_minimum", COMPARE_SAME_MINIMUM);
    failed |= json_object_set_new(object, "minima_differ", json_boolean(c->minima_differ));
    failed |= json_object_set_new(object, "starts_differ", json_boolean(c->starts_differ));
    for (size_t i = 0; i < c->runs; i++) {
        failed |= json_array_append_new(runs, run_to_json(&c->run[i]));
    }
    failed |= json_object_set_new(object, "methods", runs);
    if (failed) {
        json_decref(object);
        return NULL;
    }
    return object;
}

/* ---- CSV ----------------------------------------------------------------------------------------- */

static const char CSV_HEADER[] =
    "method,iteration,seconds,distance,stretch,bend,elastic,gravity,contact,kinetic,potential,"
    "residual_energy,residual_force,stop,time_step,factorizations\r\n";

static void put_quoted(FILE *file, const char *text)
{
    if (!strpbrk(text, ",\"\r\n")) {
        fputs(text, file);
        return;
    }
    fputc('"', file);
    for (; *text; text++) {
        fputs(*text == '"' ? "\"\"" : (char[]){*text, '\0'}, file);
    }
    fputc('"', file);
}

/* With the fewest of 9, 15 or 17 digits that give the same number back; nothing for what is none. */
static void put_number(FILE *file, double value)
{
    char text[40] = "";
    const int digits[] = {9, 15, 17};
    for (size_t i = 0; i < 3 && isfinite(value); i++) {
        snprintf(text, sizeof text, "%.*g", digits[i], value);
        if (strtod(text, NULL) == value) {
            break;
        }
    }
    fprintf(file, ",%s", text);
}

static void put_row(FILE *file, const struct comparison *c, const struct compare_run *run,
                    const struct trace_row *row)
{
    const double value[] = {row->iteration,
                            row->seconds,
                            compare_distance(c, row->potential),
                            row->stretch,
                            row->bend,
                            row->stretch + row->bend,
                            row->gravity,
                            row->contact,
                            row->kinetic,
                            row->potential,
                            row->residual_energy,
                            row->residual_force,
                            row->stop,
                            row->time_step,
                            row->factorizations};
    put_quoted(file, run->spec);
    for (size_t i = 0; i < sizeof value / sizeof value[0]; i++) {
        put_number(file, value[i]);
    }
    fputs("\r\n", file);
}

void compare_put_csv(FILE *file, const struct comparison *c)
{
    fputs(CSV_HEADER, file);
    for (size_t i = 0; i < c->runs; i++) {
        for (size_t k = 0; k < c->run[i].trace.rows; k++) {
            put_row(file, c, &c->run[i], &c->run[i].trace.row[k]);
        }
    }
}
