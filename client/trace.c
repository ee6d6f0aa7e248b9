/* trace.c - see trace.h. */
#include "trace.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const struct column {
    const char *name;
    size_t offset;
} columns[] = {
    {"iteration", offsetof(struct trace_row, iteration)},
    {"seconds", offsetof(struct trace_row, seconds)},
    {"stretch", offsetof(struct trace_row, stretch)},
    {"bend", offsetof(struct trace_row, bend)},
    {"gravity", offsetof(struct trace_row, gravity)},
    {"contact", offsetof(struct trace_row, contact)},
    {"kinetic", offsetof(struct trace_row, kinetic)},
    {"potential", offsetof(struct trace_row, potential)},
    {"residual_energy", offsetof(struct trace_row, residual_energy)},
    {"residual_force", offsetof(struct trace_row, residual_force)},
    {"stop", offsetof(struct trace_row, stop)},
    {"time_step", offsetof(struct trace_row, time_step)},
    {"factorizations", offsetof(struct trace_row, factorizations)},
};
enum { COLUMNS = sizeof columns / sizeof columns[0] };

/* Where the table has each of our columns; -1: nowhere. */
static void find_columns(const json_t *names, long place[COLUMNS])
{
    size_t i;
    json_t *name;
    for (size_t c = 0; c < COLUMNS; c++) {
        place[c] = -1;
    }
    json_array_foreach(names, i, name)
    {
        const char *text = json_string_value(name);
        for (size_t c = 0; text && c < COLUMNS; c++) {
            if (strcmp(text, columns[c].name) == 0) {
                place[c] = (long)i;
            }
        }
    }
}

static void read_row(const json_t *values, const long place[COLUMNS], struct trace_row *ret)
{
    for (size_t c = 0; c < COLUMNS; c++) {
        const json_t *value = place[c] < 0 ? NULL : json_array_get(values, (size_t)place[c]);
        double number = json_is_number(value) ? json_number_value(value) : NAN;
        memcpy((char *)ret + columns[c].offset, &number, sizeof number);
    }
}

static int read_rows(const json_t *root, struct trace *ret, struct failure *failure)
{
    const json_t *names = json_object_get(root, "columns"), *rows = json_object_get(root, "rows");
    long place[COLUMNS];
    size_t i;
    json_t *values;
    if (!json_is_array(names) || !json_is_array(rows)) {
        return failure_set(failure, EXIT_REFUSED, "the answer is not a trace of the v1 interface");
    }
    if (json_array_size(rows) == 0) {
        return 0;
    }
    find_columns(names, place);
    ret->row = calloc(json_array_size(rows), sizeof *ret->row);
    if (!ret->row) {
        return failure_no_memory(failure);
    }
    json_array_foreach(rows, i, values)
    {
        read_row(values, place, &ret->row[ret->rows++]);
    }
    return 0;
}

int trace_parse(const char *text, size_t bytes, struct trace *ret, struct failure *failure)
{
    *ret = (struct trace){0};
    json_t *root = json_loadb(text, bytes, 0, NULL);
    int status = read_rows(root, ret, failure);
    json_decref(root);
    return status;
}

void trace_done(struct trace *trace)
{
    free(trace->row);
    *trace = (struct trace){0};
}

static bool has_digits(double value, int digits)
{
    char text[40];
    snprintf(text, sizeof text, "%.*g", digits, value);
    return strtod(text, NULL) == value;
}

/* The fewest significant digits that write every potential energy as it came; 17 write every double. */
static int count_digits(const struct trace *trace)
{
    int digits = 1;
    for (size_t i = 0; i < trace->rows; i++) {
        double value = trace->row[i].potential;
        while (isfinite(value) && digits < 17 && !has_digits(value, digits)) {
            digits++;
        }
    }
    return digits;
}

double trace_resolution(const struct trace *trace, double energy)
{
    if (trace->rows == 0 || !isfinite(energy) || energy == 0) {
        return 0;
    }
    return 0.5 * pow(10, floor(log10(fabs(energy))) + 1 - count_digits(trace));
}
