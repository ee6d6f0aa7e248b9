/* report.c - see report.h. */
#include "report.h"

#include <stdlib.h>
#include <string.h>

/* Rows of the trace that are shown. */
#define TRACE_ROWS 10
/* Stages that took less than this are not worth a word (s), nor terms that hold less than that part of all.
 */
#define SHORTEST_STAGE_S 0.005
#define LEAST_TERM       0.05

static const char *text_of(const json_t *object, const char *key)
{
    const char *text = json_string_value(json_object_get(object, key));
    return text ? text : "";
}

/* "separator name value" when the member is a number; returns the separator for the next. */
static const char *put_count(FILE *file, const char *separator, const json_t *object, const char *key,
                             const char *name)
{
    const json_t *value = json_object_get(object, key);
    if (!json_is_integer(value)) {
        return separator;
    }
    fprintf(file, "%s%lld %s", separator, (long long)json_integer_value(value), name);
    return ", ";
}

static void put_label(FILE *file, const char *label)
{
    fprintf(file, "  %-14s ", label);
}

static void put_text(FILE *file, const char *label, const char *text)
{
    if (text[0]) {
        put_label(file, label);
        fprintf(file, "%s\n", text);
    }
}

static void put_counts(FILE *file, const json_t *report)
{
    if (!json_is_integer(json_object_get(report, "iterations"))) {
        return;
    }
    put_label(file, "iterations");
    const char *separator = put_count(file, "", report, "iterations", "of draping");
    separator = put_count(file, separator, report, "stops", "stops");
    separator = put_count(file, separator, report, "factorizations", "factorisations");
    put_count(file, separator, report, "solves", "solves");
    fputc('\n', file);
}

static void put_sewing(FILE *file, const json_t *sewing)
{
    const json_t *gap = json_object_get(sewing, "seam_gap");
    if (json_integer_value(json_object_get(sewing, "iterations")) > 0) {
        put_label(file, "sewing");
        put_count(file, "", sewing, "iterations", "iterations");
        if (json_is_number(gap)) {
            fprintf(file, ", seams closed to %.2g mm, then welded", 1000 * json_number_value(gap));
        }
        fputc('\n', file);
    }
}

static void put_motion(FILE *file, const json_t *motion)
{
    if (json_integer_value(json_object_get(motion, "frames")) > 0) {
        put_label(file, "motion");
        put_count(file, "", motion, "frames", "frames");
    }
}

static void put_ramp(FILE *file, const json_t *ramp)
{
    const json_t *change = json_object_get(ramp, "change");
    if (json_integer_value(json_object_get(ramp, "steps")) > 0 && json_is_number(change)) {
        put_label(file, "resized");
        fprintf(file, "by up to %.3g %%, ", 100 * json_number_value(change));
        put_count(file, "", ramp, "steps", "steps");
        put_count(file, ", ", ramp, "iterations", "iterations between");
        fputc('\n', file);
    }
}

static void put_coarse(FILE *file, const json_t *coarse)
{
    if (json_integer_value(json_object_get(coarse, "triangles")) > 0) {
        put_label(file, "coarse first");
        put_count(file, "", coarse, "triangles", "triangles");
        fputs(json_is_true(json_object_get(coarse, "carried")) ? "\n" : ", begun anew\n", file);
    }
}

static void put_seconds(FILE *file, const json_t *report)
{
    const json_t *seconds = json_object_get(report, "seconds");
    double borrowed = json_number_value(json_object_get(report, "borrowed_seconds"));
    json_t *stages = json_object_get(report, "stages");
    const char *name, *separator = " (";
    json_t *value;
    if (!json_is_number(seconds)) {
        return;
    }
    put_label(file, "time");
    fprintf(file, "%.2f s", json_number_value(seconds));
    if (borrowed >= SHORTEST_STAGE_S)
        fprintf(file, ", %.2f s of a second processor", borrowed);
    json_object_foreach(stages, name, value)
    {
        if (json_number_value(value) >= SHORTEST_STAGE_S) {
            fprintf(file, "%s%s %.2f", separator, name, json_number_value(value));
            separator = ", ";
        }
    }
    fprintf(file, "%s\n", separator[0] == ',' ? ")" : "");
}

/* "sewing 15.3, draping 18.2 MB", where there is more than one phase to tell apart. */
static void put_memory_by_phase(FILE *file, json_t *phases)
{
    const char *name, *separator = "";
    json_t *bytes;
    if (json_object_size(phases) < 2) {
        return;
    }
    put_label(file, "by phase");
    json_object_foreach(phases, name, bytes)
    {
        fprintf(file, "%s%s %.1f", separator, name, json_number_value(bytes) / 1e6);
        separator = ", ";
    }
    fputs(" MB\n", file);
}

/* "18.2 MB, 4550 bytes a triangle (contact 14.9, jacobian 2.1)" */
static void put_memory(FILE *file, const json_t *report)
{
    const json_t *each = json_object_get(report, "bytes_per_triangle");
    double peak = json_number_value(json_object_get(report, "peak_bytes"));
    const char *separator = " (";
    size_t i;
    json_t *term;
    if (!(peak > 0)) {
        return;
    }
    put_label(file, "memory");
    fprintf(file, "%.1f MB", peak / 1e6);
    if (json_is_number(each)) {
        fprintf(file, ", %.0f bytes a triangle", json_number_value(each));
    }
    json_array_foreach(json_object_get(json_object_get(report, "plan"), "kept"), i, term)
    {
        double bytes = json_number_value(json_object_get(term, "bytes"));
        if (bytes >= LEAST_TERM * peak) {
            fprintf(file, "%s%s %.1f", separator, text_of(term, "name"), bytes / 1e6);
            separator = ", ";
        }
    }
    fprintf(file, "%s\n", separator[0] == ',' ? ")" : "");
    put_memory_by_phase(file, json_object_get(report, "peak_bytes_by_phase"));
}

static void put_energies(FILE *file, const json_t *energies)
{
    const char *const names[] = {"stretch", "bend", "gravity", "contact", "kinetic", "potential"};
    if (!json_is_object(energies)) {
        return;
    }
    put_label(file, "energies (J)");
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        const json_t *value = json_object_get(energies, names[i]);
        if (json_is_number(value)) {
            fprintf(file, "%s%s %.4g", i > 0 ? ", " : "", names[i], json_number_value(value));
        }
    }
    fputc('\n', file);
}

static void put_residuals(FILE *file, const json_t *report)
{
    const json_t *force = json_object_get(report, "residual_force"),
                 *energy = json_object_get(report, "residual_energy");
    if (json_is_number(force)) {
        put_label(file, "residual force");
        fprintf(file, "%.3g of the mean vertex weight\n", json_number_value(force));
    }
    if (json_is_number(energy)) {
        const char *kind = text_of(report, "residual_energy_is");
        put_label(file, "left to fall");
        fprintf(file, "%.3g J%s%s%s\n", json_number_value(energy), kind[0] ? " (" : "", kind,
                kind[0] ? ")" : "");
    }
}

static void put_certificate(FILE *file, const json_t *certificate)
{
    const json_t *move = json_object_get(certificate, "largest_move");
    if (!json_is_object(certificate)) {
        return;
    }
    put_label(file, "certified");
    fprintf(file, "%s: %s", json_is_true(json_object_get(certificate, "certified")) ? "yes" : "no",
            text_of(certificate, "reason"));
    if (json_is_number(move)) {
        fprintf(file, "; %.2g m to go", json_number_value(move));
    }
    fputc('\n', file);
}

static void put_drop(FILE *file, const json_t *report)
{
    const json_t *drop = json_object_get(report, "drop");
    if (json_number_value(drop) > 0) {
        put_label(file, "slid off");
        fprintf(file, "by %.0f mm\n", 1000 * json_number_value(drop));
    }
}

static void put_contacts(FILE *file, const json_t *report)
{
    const json_t *inside = json_object_get(report, "penetrations");
    if (json_is_integer(inside)) {
        const json_t *deepest = json_object_get(report, "deepest");
        put_label(file, "inside bodies");
        fprintf(file, "%lld vertices", (long long)json_integer_value(inside));
        if (json_number_value(deepest) > 0) {
            fprintf(file, ", the deepest by %.2g mm", 1000 * json_number_value(deepest));
        }
        fputc('\n', file);
    }
    const json_t *crossings = json_object_get(report, "self_intersections");
    if (json_is_integer(crossings)) {
        put_label(file, "self-crossings");
        fprintf(file, "%lld edges through triangles\n", (long long)json_integer_value(crossings));
    }
    const json_t *where = json_object_get(report, "intersection");
    if (json_array_size(where) == 3) {
        put_label(file, "intersects at");
        for (size_t d = 0; d < 3; d++) {
            fprintf(file, "%.4g%s", json_number_value(json_array_get(where, d)), d < 2 ? ", " : " m\n");
        }
    }
}

/* "waist 712.0 mm draped, 700.0 mm in the pattern, +1.7 %" */
static void put_lines(FILE *file, const json_t *lines)
{
    size_t i;
    json_t *line;
    json_array_foreach(lines, i, line)
    {
        const json_t *elongation = json_object_get(line, "elongation");
        put_label(file, i > 0 ? "" : "lines");
        fprintf(file, "%s: %.1f mm draped, %.1f mm in the pattern", text_of(line, "name"),
                1000 * json_number_value(json_object_get(line, "draped")),
                1000 * json_number_value(json_object_get(line, "rest")));
        if (json_is_number(elongation)) {
            fprintf(file, ", %+.2f %%", 100 * json_number_value(elongation));
        }
        fputc('\n', file);
    }
}

static void put_report(FILE *file, const json_t *report)
{
    put_text(file, "ended because", text_of(report, "reason"));
    put_text(file, "method", text_of(report, "method"));
    put_sewing(file, json_object_get(report, "sewing"));
    put_motion(file, json_object_get(report, "motion"));
    put_ramp(file, json_object_get(report, "ramp"));
    put_coarse(file, json_object_get(report, "coarse"));
    put_counts(file, report);
    put_seconds(file, report);
    put_memory(file, report);
    put_energies(file, json_object_get(report, "energies"));
    put_residuals(file, report);
    put_certificate(file, json_object_get(report, "certificate"));
    put_drop(file, report);
    put_contacts(file, report);
    put_lines(file, json_object_get(report, "lines"));
}

static void put_error(FILE *file, const json_t *error)
{
    size_t i;
    json_t *entry;
    put_text(file, "error", text_of(error, "title"));
    put_text(file, "", text_of(error, "detail"));
    json_array_foreach(json_object_get(error, "errors"), i, entry)
    {
        put_label(file, "");
        fprintf(file, "at %s: %s\n", text_of(entry, "pointer"), text_of(entry, "detail"));
    }
}

void report_line(FILE *file, const json_t *job)
{
    const char *verdict = text_of(job, "verdict");
    fprintf(file, "%s  %-9s  %-12s  %s  %s\n", text_of(job, "id"), text_of(job, "status"),
            verdict[0] ? verdict : "-", text_of(job, "created_at"), text_of(job, "name"));
}

void report_job(FILE *file, const json_t *job)
{
    const char *name = text_of(job, "name"), *verdict = text_of(job, "verdict");
    fprintf(file, "job %s%s%s: %s%s%s\n", text_of(job, "id"), name[0] ? " " : "", name,
            text_of(job, "status"), verdict[0] ? ", " : "", verdict);
    const json_t *position = json_object_get(job, "queue_position"),
                 *attempt = json_object_get(job, "attempt");
    if (json_is_integer(position) && json_integer_value(position) > 0) {
        put_label(file, "in the queue");
        fprintf(file, "%lld\n", (long long)json_integer_value(position));
    }
    if (json_integer_value(attempt) > 1) {
        put_label(file, "attempt");
        fprintf(file, "%lld\n", (long long)json_integer_value(attempt));
    }
    const json_t *report = json_object_get(job, "report"), *error = json_object_get(job, "error");
    if (json_is_object(report)) {
        put_report(file, report);
    } else if (json_is_object(json_object_get(job, "progress"))) {
        put_energies(file, json_object_get(json_object_get(job, "progress"), "energy"));
        put_residuals(file, json_object_get(job, "progress"));
    }
    if (json_is_object(error)) {
        put_error(file, error);
    }
}

/* ---- trace --------------------------------------------------------------------------------------- */

static const char *const columns[] = {"iteration",       "seconds",        "potential", "kinetic",
                                      "residual_energy", "residual_force", "stop"};
enum { COLUMNS = sizeof columns / sizeof columns[0] };

/* Where a CSV header has each of our columns; -1: nowhere. */
static void find_columns(const char *header, int place[COLUMNS])
{
    for (int c = 0; c < COLUMNS; c++) {
        place[c] = -1;
    }
    for (int at = 0; *header && *header != '\n'; at++) {
        size_t n = strcspn(header, ",\r\n");
        for (int c = 0; c < COLUMNS; c++) {
            if (strlen(columns[c]) == n && strncmp(header, columns[c], n) == 0) {
                place[c] = at;
            }
        }
        header += n + (header[n] == ',');
        if (*header == '\r') {
            break;
        }
    }
}

/* Field number `at` of a CSV line without quotes; "" when it has none. */
static void copy_field(const char *line, int at, char *ret, size_t size)
{
    ret[0] = '\0';
    for (int i = 0; at >= 0 && *line && *line != '\n'; i++) {
        size_t n = strcspn(line, ",\r\n");
        if (i == at) {
            snprintf(ret, size, "%.*s", (int)n, line);
            return;
        }
        line += n + (line[n] == ',');
    }
}

static void put_row(FILE *file, const char *line, const int place[COLUMNS])
{
    for (int c = 0; c < COLUMNS; c++) {
        char field[40], *end = NULL;
        copy_field(line, place[c], field, sizeof field);
        double value = strtod(field, &end);
        if (end == field) {
            fprintf(file, " %11s", "-");
        } else if (c == 0) {
            fprintf(file, "  %9.0f", value);
        } else if (c == COLUMNS - 1) {
            fprintf(file, "  %s", value != 0 ? "stop" : "");
        } else {
            fprintf(file, c == 1 ? " %8.2f" : " %11.3e", value);
        }
    }
    fputc('\n', file);
}

static const char *next_line(const char *text)
{
    const char *end = strchr(text, '\n');
    return end ? end + 1 : text + strlen(text);
}

void report_trace(FILE *file, const char *csv)
{
    int place[COLUMNS];
    size_t rows = 0, shown = 0;
    find_columns(csv, place);
    for (const char *line = next_line(csv); *line; line = next_line(line)) {
        rows++;
    }
    if (rows == 0) {
        return;
    }
    fprintf(file, "  %9s %8s %11s %11s %11s %11s\n", "iteration", "seconds", "potential J", "kinetic J",
            "left J", "resid force");
    size_t row = 0;
    for (const char *line = next_line(csv); *line; line = next_line(line), row++) {
        /* row number `shown` of the selection, which ends with the last row */
        size_t wanted = rows <= TRACE_ROWS ? row : shown * (rows - 1) / (TRACE_ROWS - 1);
        if (row == wanted) {
            put_row(file, line, place);
            shown++;
        }
    }
}
