/* compare_page.c - see compare_page.h. */
#include "compare_page.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "chart.h"
#include "compare_figures.h"
#include "compare_plot.h"
#include "html.h"
#include "job.h"

#define MOST_STOPS 16 /* told by their iterations; the lines in the picture show all */

static const char STYLE[] =
    "body{font:16px/1.5 system-ui,sans-serif;color:#282828;background:#fff;max-width:74rem;margin:2rem auto;"
    "padding:0 1.2rem}\n"
    "h1{font-size:1.6rem;line-height:1.25;margin:0 0 .4rem;overflow-wrap:anywhere}\n"
    "h2{font-size:1.15rem;margin:2.2rem 0 .5rem}\n"
    "h3{font-size:.95rem;font-weight:600;margin:0;overflow-wrap:anywhere}\n"
    "p,ul{max-width:46rem;margin:.5rem 0}\n"
    "svg{display:block;width:100%;height:auto}\n"
    ".scroll{overflow-x:auto}\n"
    "table{border-collapse:collapse;font-size:.8rem;font-variant-numeric:tabular-nums;white-space:nowrap}\n"
    "th,td{padding:.28rem .34rem;text-align:right;border-bottom:1px solid #ddd}\n"
    "thead th{font-weight:600;vertical-align:bottom;border-bottom:1px solid #282828}\n"
    "th.text,td.text,tbody th{text-align:left}\n"
    "tbody th{font-weight:400}\n"
    "td.group,th.group{border-left:1px solid #ddd}\n"
    "th.over{text-align:center;border-bottom:1px solid #ddd}\n"
    "td.reason{white-space:normal;text-align:left;min-width:20rem}\n"
    ".key{display:inline-block;width:1.6em;height:0;border-top:3px solid;vertical-align:.25em;"
    "margin-right:.5em}\n"
    ".dashed{border-top-style:dashed}\n"
    ".keys{display:flex;flex-wrap:wrap;gap:.2rem 1.6rem;font-size:.88rem;margin:.6rem 0;max-width:none}\n"
    ".grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(26rem,1fr));gap:1.4rem}\n"
    "p.quiet{font-size:.88rem}\n"
    ".quiet{color:#5c5c5c}\n"
    "@media print{body{max-width:none;margin:0}h2{break-after:avoid}.grid>div{break-inside:avoid}}\n";

static const char *text_of(const json_t *object, const char *key)
{
    const char *text = json_string_value(json_object_get(object, key));
    return text ? text : "";
}

/* ---- head ---------------------------------------------------------------------------------------- */

/* "17 424 triangles, 8 900 vertices"; a mesh given by reference has no numbers here. */
static void put_size(FILE *file, const json_t *job)
{
    const json_t *mesh = json_object_get(json_object_get(job, "cloth"), "mesh");
    size_t triangles = json_array_size(json_object_get(mesh, "triangles")) / 3;
    size_t vertices = json_array_size(json_object_get(mesh, "positions")) / 3;
    if (triangles > 0) {
        fprintf(file, "%zu triangles, %zu vertices. ", triangles, vertices);
    }
}

static void put_solver(FILE *file, const json_t *job)
{
    const json_t *solver = json_object_get(job, "solver");
    char *text =
        json_is_object(solver) ? json_dumps(solver, JSON_PRESERVE_ORDER | JSON_REAL_PRECISION(6)) : NULL;
    if (text) {
        fputs("The job\xE2\x80\x99s own solver members, which every method keeps unless it names others: "
              "<code>",
              file);
        html_text(file, text);
        fputs("</code>.", file);
    }
    free(text);
}

static const char *first_date(const struct comparison *c)
{
    for (size_t i = 0; i < c->runs; i++) {
        if (c->run[i].job) {
            return text_of(c->run[i].job, "created_at");
        }
    }
    return "";
}

static void put_note(const char *sentence, void *user)
{
    fputs("<li>", user);
    html_text(user, sentence);
    fputs("</li>\n", user);
}

static void put_head(FILE *file, const struct comparison *c, const json_t *job)
{
    const char *name = text_of(job, "name");
    name = name[0] ? name : "a job without a name";
    fputs(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
        "<meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n<title>Methods compared: ",
        file);
    html_text(file, name);
    fprintf(file, "</title>\n<style>\n%s</style>\n</head>\n<body>\n<h1>Methods compared: ", STYLE);
    html_text(file, name);
    fputs("</h1>\n<p class=\"quiet\">", file);
    html_text(file, first_date(c));
    fputs(first_date(c)[0] ? ". " : "", file);
    put_size(file, job);
    put_solver(file, job);
    fputs("</p>\n<ul>\n", file);
    compare_each_note(c, put_note, file);
    fputs("</ul>\n", file);
}

/* ---- table --------------------------------------------------------------------------------------- */

static void put_key(FILE *file, int colour, bool dashed, const char *text)
{
    char css[8];
    chart_colour(colour, css);
    fprintf(file, "<span class=\"key%s\" style=\"border-color:%s\"></span>", dashed ? " dashed" : "", css);
    html_text(file, text);
}

static void put_run_key(FILE *file, const struct comparison *c, size_t run)
{
    put_key(file, (int)run, run >= CHART_COLOURS, c->run[run].spec);
}

static bool has_factorizations(const struct comparison *c)
{
    for (size_t i = 0; i < c->runs; i++) {
        if (c->run[i].trace.rows > 1 && isfinite(c->run[i].trace.row[1].factorizations)) {
            return true;
        }
    }
    return false;
}

/* Per level: iterations, seconds and, where the traces tell, factorisations. */
static void put_table_head(FILE *file, int columns)
{
    fprintf(
        file,
        "<thead><tr><th class=\"text\" rowspan=\"2\">method</th><th class=\"text\" rowspan=\"2\">ended</th>");
    for (size_t l = 0; l < COMPARE_LEVELS; l++) {
        fprintf(file, "<th class=\"over group\" colspan=\"%d\">to 10<sup>\xE2\x88\x92%.0f</sup></th>",
                columns, -log10(compare_level[l]));
    }
    fprintf(file,
            "<th class=\"over group\" colspan=\"%d\">to rest</th>"
            "<th class=\"group\" rowspan=\"2\">residual<br>force</th>"
            "<th rowspan=\"2\">energy<br>(J)</th><th rowspan=\"2\">above E*</th></tr>\n<tr>",
            columns);
    for (size_t l = 0; l <= COMPARE_LEVELS; l++) {
        fprintf(file, "<th class=\"group\">iter.</th><th>s</th>%s", columns == 3 ? "<th>fact.</th>" : "");
    }
    fputs("</tr></thead>\n<tbody>\n", file);
}

static void put_cost(FILE *file, const struct compare_cost *cost, int columns, bool known)
{
    char iterations[32], seconds[32], factorizations[32];
    compare_cost_text(cost->iterations, true, iterations);
    compare_cost_text(cost->seconds, false, seconds);
    compare_cost_text(cost->factorizations, true, factorizations);
    fprintf(file, "<td class=\"group\">%s%s</td><td>%s</td>", iterations,
            known || !isfinite(cost->iterations) ? "" : "*", seconds);
    if (columns == 3) {
        fprintf(file, "<td>%s</td>", factorizations);
    }
}

/* "-" for what is not known. */
static void put_number(FILE *file, const char *class, int digits, double value)
{
    fprintf(file, "<td class=\"%s\">", class);
    if (isfinite(value)) {
        fprintf(file, "%.*g</td>", digits, value);
    } else {
        fputs("-</td>", file);
    }
}

/* What it took to a minimum that is not E*. */
static void put_own(FILE *file, const struct compare_run *run, int columns)
{
    fputs("<tr class=\"quiet\"><th class=\"text\"></th><td class=\"text\">to its own</td>", file);
    for (size_t l = 0; l < COMPARE_LEVELS; l++) {
        put_cost(file, &run->own[l], columns, true);
    }
    fprintf(file, "<td class=\"group\" colspan=\"%d\"></td><td class=\"group\" colspan=\"3\"></td></tr>\n",
            columns);
}

static void put_run(FILE *file, const struct comparison *c, size_t i, int columns)
{
    const struct compare_run *run = &c->run[i];
    fputs("<tr><th class=\"text\" scope=\"row\">", file);
    put_run_key(file, c, i);
    fputs("</th><td class=\"text\">", file);
    html_text(file, compare_outcome(run));
    fputs(run->certified ? ", certified</td>" : "</td>", file);
    if (!run->job) {
        fprintf(file, "<td class=\"reason group\" colspan=\"%d\">", (COMPARE_LEVELS + 1) * columns + 3);
        html_text(file, compare_reason(run));
        fputs("</td></tr>\n", file);
        return;
    }
    for (size_t l = 0; l < COMPARE_LEVELS; l++) {
        put_cost(file, &run->level[l], columns, !(compare_level[l] < c->floor));
    }
    put_cost(file, &run->rest, columns, true);
    put_number(file, "group", 3, compare_figure(run, "residual_force"));
    put_number(file, "", 9, run->energy);
    put_number(file, "", 3, run->distance);
    fputs("</tr>\n", file);
    if (run->at_rest && run->other_minimum) {
        put_own(file, run, columns);
    }
}

static void put_table(FILE *file, const struct comparison *c)
{
    int columns = has_factorizations(c) ? 3 : 2;
    fputs("<h2>What it took</h2>\n<div class=\"scroll\"><table>\n", file);
    put_table_head(file, columns);
    for (size_t i = 0; i < c->runs; i++) {
        put_run(file, c, i, columns);
    }
    fputs("</tbody></table></div>\n<p class=\"quiet\">To 10<sup>\xE2\x88\x92k</sup>: the first iteration "
          "from which on (E \xE2\x88\x92 E*) / (E<sub>0</sub> \xE2\x88\x92 E*) stays below. Factorisations "
          "are all attempts up to there, failed ones included, those of sewing left out; seconds are the "
          "solver\xE2\x80\x99s, sewing "
          "included; the methods ran one after the other. To rest: until the residual force was within the "
          "tolerance. To its own: the same with the energy at which the method rested, where that is another "
          "minimum, in place of E*. Residual force: the largest on a free vertex, in mean vertex weights. "
          "Above E*: (E \xE2\x88\x92 E*) / (E<sub>0</sub> \xE2\x88\x92 E*) of the state returned.</p>\n",
          file);
}

/* "It took 150 iterations, 151 factorisations and 47.6 s." */
static void put_totals(FILE *file, const struct compare_run *run)
{
    char iterations[32], factorizations[32], seconds[32];
    compare_cost_text(compare_figure(run, "iterations"), true, iterations);
    compare_cost_text(compare_figure(run, "factorizations"), true, factorizations);
    compare_cost_text(compare_figure(run, "seconds"), false, seconds);
    fprintf(file, ". It took %s iterations, %s factorisations and %s s.", iterations, factorizations,
            seconds);
}

/* Why each ended, since a verdict alone does not tell. */
static void put_reasons(FILE *file, const struct comparison *c)
{
    fputs("<h2>Why each ended</h2>\n<ul>\n", file);
    for (size_t i = 0; i < c->runs; i++) {
        fputs("<li>", file);
        html_text(file, c->run[i].spec);
        fprintf(file, ": %s. ", compare_outcome(&c->run[i]));
        html_text(file, compare_reason(&c->run[i]));
        if (isfinite(compare_figure(&c->run[i], "iterations"))) {
            put_totals(file, &c->run[i]);
        }
        if (c->run[i].job) {
            fputs(" <span class=\"quiet\">(job ", file);
            html_text(file, job_id(c->run[i].job));
            fputs(")</span>", file);
        }
        fputs("</li>\n", file);
    }
    fputs("</ul>\n", file);
}

/* ---- pictures ------------------------------------------------------------------------------------ */

static int put_convergence(FILE *file, const struct comparison *c, struct failure *failure)
{
    char *svg = NULL;
    struct compare_axes axes;
    fputs("<h2>Distance to the lowest energy</h2>\n", file);
    if (!isfinite(c->drop)) {
        fputs("<p>There is no distance to draw.</p>\n", file);
        return 0;
    }
    if (compare_plot_convergence(c, &axes, &svg, failure) < 0) {
        return -1;
    }
    fprintf(file, "%s\n<p class=\"keys\">", svg);
    for (size_t i = 0; i < c->runs; i++) {
        if (c->run[i].trace.rows > 0) {
            fputs("<span>", file);
            put_run_key(file, c, i);
            fputs("</span>", file);
        }
    }
    fprintf(file,
            "</p>\n<p class=\"quiet\">%sA dot ends each curve. What lies beyond the scale is drawn on its "
            "edge.</p>\n",
            axes.log_x ? "Iterations and seconds are on logarithmic axes too, since the methods differ much; "
                         "the start (iteration 0) lies left of them. "
                       : "");
    free(svg);
    return 0;
}

static void put_energy_keys(FILE *file, const struct comparison *c)
{
    static const char *const names[COMPARE_ENERGIES] = {"elastic (stretch + bend)", "gravity", "kinetic",
                                                        "contact"};
    fputs("<p class=\"keys\">", file);
    for (int e = 0; e < COMPARE_ENERGIES; e++) {
        if (e != COMPARE_CONTACT || compare_has_contact(c)) {
            fputs("<span>", file);
            put_key(file, e, false, names[e]);
            fputs("</span>", file);
        }
    }
    fputs("</p>\n", file);
}

/* "Stops at 16, 19, 34 and 5 more.": to be held against others' frames. */
static void put_stops(FILE *file, const struct trace *trace)
{
    size_t stops = 0;
    for (size_t i = 0; i < trace->rows; i++) {
        if (trace->row[i].stop > 0 && ++stops <= MOST_STOPS) {
            fprintf(file, "%s%.0f", stops == 1 ? "<p class=\"quiet\">Stops at iterations " : ", ",
                    trace->row[i].iteration);
        }
    }
    if (stops > MOST_STOPS) {
        fprintf(file, " and %zu more", stops - MOST_STOPS);
    }
    fputs(stops > 0 ? ".</p>\n" : "", file);
}

static int put_exchanges(FILE *file, const struct comparison *c, struct failure *failure)
{
    fputs("<h2>Exchange of energies</h2>\n<p class=\"quiet\">All on one scale of energy; what lies beyond it "
          "is drawn on its edge. An upright grey "
          "line marks a "
          "stop: all velocities cut. Gravity counts from the start.</p>\n",
          file);
    put_energy_keys(file, c);
    fputs("<div class=\"grid\">\n", file);
    for (size_t i = 0; i < c->runs; i++) {
        char *svg = NULL;
        if (c->run[i].trace.rows == 0) {
            continue;
        }
        if (compare_plot_exchange(c, i, &svg, failure) < 0) {
            return -1;
        }
        fputs("<div><h3>", file);
        html_text(file, c->run[i].spec);
        fprintf(file, "</h3>\n%s", svg);
        put_stops(file, &c->run[i].trace);
        fputs("</div>\n", file);
        free(svg);
    }
    fputs("</div>\n", file);
    return 0;
}

int compare_page(const struct comparison *c, const json_t *job, char **ret, size_t *ret_bytes,
                 struct failure *failure)
{
    char *page = NULL;
    FILE *file = open_memstream(&page, ret_bytes);
    if (!file) {
        return failure_no_memory(failure);
    }
    put_head(file, c, job);
    put_table(file, c);
    int status = put_convergence(file, c, failure);
    if (status == 0) {
        status = put_exchanges(file, c, failure);
    }
    put_reasons(file, c);
    fputs("</body>\n</html>\n", file);
    bool whole = !ferror(file);
    if ((fclose(file) != 0 || !whole) && status == 0) {
        status = failure_no_memory(failure);
    }
    if (status < 0) {
        free(page);
        return -1;
    }
    *ret = page;
    return 0;
}
