/* compare_plot.c - see compare_plot.h. */
#include "compare_plot.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "chart.h"

/* A curve of more points than pixels shows no more; each piece keeps its first, lowest and highest. */
#define MAX_PIECES 400
#define MAX_POINTS (3 * MAX_PIECES + 1)
/* Decades of distance that are shown: round-off lies below, and a run that explodes above. */
#define LOWEST_DECADE  (-12)
#define HIGHEST_DECADE 3
/* Curves that coincide: the first is drawn so much wider than the last that it shows behind it. */
#define LINE_WIDTH  1.4
#define EXTRA_WIDTH 2.2
/* Iterations and seconds go on logarithmic axes when the longest run takes so many times the shortest. */
#define SPREAD 8
/* Energies beyond so many times E0 - E* are cut off: a run that explodes must not flatten the others. */
#define HIGHEST_ENERGY 3
/* The same when E0 - E* is not known (J): no garment holds so much. */
#define LARGEST_ENERGY 1e6
/* When there are more stops, every second, third, ... is marked. */
#define MAX_STOPS 200

/* ---- curves -------------------------------------------------------------------------------------- */

/* An axis of energy counts in the unit that makes the largest number 1 to 1000. */
static const struct unit {
    double joules;
    const char *label;
} units[] = {{1e6, "energy (MJ)"},
             {1e3, "energy (kJ)"},
             {1, "energy (J)"},
             {1e-3, "energy (mJ)"},
             {1e-6, "energy (\xc2\xb5J)"}};
enum { UNITS = sizeof units / sizeof units[0] };

typedef double value_fn(const struct comparison *c, const struct trace_row *row);

static double get_iteration(const struct comparison *c, const struct trace_row *row)
{
    (void)c;
    return row->iteration;
}

static double get_seconds(const struct comparison *c, const struct trace_row *row)
{
    (void)c;
    return row->seconds;
}

/* That in which the knowledge ends. */
static double lowest_decade(const struct comparison *c)
{
    return c->floor > 0 ? fmax(LOWEST_DECADE, floor(log10(c->floor))) : LOWEST_DECADE;
}

/* log10; what is nothing, or below E*, lies on the lower edge. */
static double get_distance(const struct comparison *c, const struct trace_row *row)
{
    double distance = compare_distance(c, row->potential);
    return isnan(distance) ? NAN : log10(fmax(distance, pow(10, lowest_decade(c))));
}

static double get_elastic(const struct comparison *c, const struct trace_row *row)
{
    (void)c;
    return row->stretch + row->bend;
}

static double get_gravity(const struct comparison *c, const struct trace_row *row)
{
    (void)c;
    return row->gravity;
}

static double get_kinetic(const struct comparison *c, const struct trace_row *row)
{
    (void)c;
    return row->kinetic;
}

static double get_contact(const struct comparison *c, const struct trace_row *row)
{
    (void)c;
    return row->contact;
}

static value_fn *const get_energy[COMPARE_ENERGIES] = {get_elastic, get_gravity, get_kinetic, get_contact};

struct source { /* where a curve comes from */
    const struct comparison *comparison;
    const struct trace *trace;
    value_fn *x, *y;
    bool log_x;
    double unit;      /* that y is divided by */
    double low, high; /* before that; what lies beyond is drawn on the edge */
};

static double abscissa(const struct source *s, size_t row)
{
    double x = s->x(s->comparison, &s->trace->row[row]);
    return s->log_x ? (x > 0 ? log10(x) : NAN) : x;
}

static double ordinate(const struct source *s, size_t row)
{
    double y = s->y(s->comparison, &s->trace->row[row]);
    return isfinite(abscissa(s, row)) && !isnan(y) ? fmin(fmax(y, s->low), s->high) / s->unit : NAN;
}

static void add_point(struct chart_curve *curve, const struct source *s, size_t row)
{
    double x = abscissa(s, row);
    if (curve->points > 0 && curve->x[curve->points - 1] >= x) {
        return; /* a row that is there already */
    }
    curve->x[curve->points] = x;
    curve->y[curve->points++] = ordinate(s, row);
}

/* The first, the lowest and the highest of the rows from..to, in the order in which they come. */
static void add_piece(struct chart_curve *curve, const struct source *s, size_t from, size_t to)
{
    size_t first = to, low = to, high = to;
    for (size_t i = from; i < to; i++) {
        double y = ordinate(s, i);
        if (!isfinite(y)) {
            continue;
        }
        first = first == to ? i : first;
        low = low == to || y < ordinate(s, low) ? i : low;
        high = high == to || y > ordinate(s, high) ? i : high;
    }
    if (first < to) {
        add_point(curve, s, first);
        add_point(curve, s, low < high ? low : high);
        add_point(curve, s, low < high ? high : low);
    }
}

static int make_curve(const struct source *s, struct chart_curve *ret)
{
    size_t rows = s->trace->rows, pieces = rows < MAX_PIECES ? rows : MAX_PIECES;
    ret->x = malloc(MAX_POINTS * sizeof(double));
    ret->y = malloc(MAX_POINTS * sizeof(double));
    if (!ret->x || !ret->y) {
        return -1;
    }
    for (size_t i = 0; i < pieces; i++) {
        add_piece(ret, s, rows * i / pieces, rows * (i + 1) / pieces);
    }
    if (rows > 0 && isfinite(ordinate(s, rows - 1))) {
        add_point(ret, s, rows - 1);
    }
    return 0;
}

static void free_curves(struct chart_curve *curve, size_t curves)
{
    for (size_t i = 0; i < curves; i++) {
        free(curve[i].x);
        free(curve[i].y);
    }
}

/* ---- convergence --------------------------------------------------------------------------------- */

/* Longest over shortest way; the axes of both panels follow the iterations. */
static bool is_spread(const struct comparison *c)
{
    double shortest = INFINITY, longest = 0;
    for (size_t i = 0; i < c->runs; i++) {
        if (c->run[i].trace.rows > 1) {
            double last = c->run[i].trace.row[c->run[i].trace.rows - 1].iteration;
            shortest = fmin(shortest, last);
            longest = fmax(longest, last);
        }
    }
    return longest > SPREAD * shortest;
}

static void span_x(struct chart_panel *panel)
{
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < panel->curves; i++) {
        const struct chart_curve *curve = &panel->curve[i];
        if (curve->points > 0) {
            low = fmin(low, curve->x[0]);
            high = fmax(high, curve->x[curve->points - 1]);
        }
    }
    if (!(high >= low)) {
        low = 0;
        high = 1;
    }
    double margin = high > low ? 0.02 * (high - low) : 0.5;
    panel->x0 = panel->log_x ? low - margin : 0;
    panel->x1 = high + margin;
    if (!(panel->x1 > panel->x0)) {
        panel->x1 = panel->x0 + 1;
    }
}

/* Whole decades around all curves. */
static void span_y(struct chart_panel *panel)
{
    double low = 0, high = 0;
    for (size_t i = 0; i < panel->curves; i++) {
        for (size_t k = 0; k < panel->curve[i].points; k++) {
            low = fmin(low, panel->curve[i].y[k]);
            high = fmax(high, panel->curve[i].y[k]);
        }
    }
    panel->y0 = floor(low) - 0.2;
    panel->y1 = fmin(ceil(high), HIGHEST_DECADE) + 0.3;
}

static int make_panel(const struct comparison *c, bool seconds, bool log_x, struct chart_curve *curve,
                      struct chart_panel *ret)
{
    for (size_t i = 0; i < c->runs; i++) {
        struct source s = {.comparison = c,
                           .trace = &c->run[i].trace,
                           .x = seconds ? get_seconds : get_iteration,
                           .y = get_distance,
                           .log_x = log_x,
                           .unit = 1,
                           .low = LOWEST_DECADE,
                           .high = HIGHEST_DECADE};
        double behind = c->runs > 1 ? (double)(c->runs - 1 - i) / (double)(c->runs - 1) : 0;
        curve[i] = (struct chart_curve){
            .colour = (int)i, .dashed = i >= CHART_COLOURS, .width = LINE_WIDTH + EXTRA_WIDTH * behind};
        if (make_curve(&s, &curve[i]) < 0) {
            return -1;
        }
    }
    *ret = (struct chart_panel){.left = seconds ? 0.565 : 0.085,
                                .right = seconds ? 0.985 : 0.505,
                                .bottom = 0.13,
                                .top = 0.97,
                                .log_x = log_x,
                                .log_y = true,
                                .x_label = seconds ? "seconds" : "iterations",
                                .y_label = seconds ? "" : "(E \xe2\x88\x92 E*) / (E#d0#u \xe2\x88\x92 E*)",
                                .title = "",
                                .curve = curve,
                                .curves = c->runs};

    span_x(ret);
    span_y(ret);
    return 0;
}

int compare_plot_convergence(const struct comparison *c, struct compare_axes *ret_axes, char **ret,
                             struct failure *failure)
{
    struct chart_curve curve[2 * COMPARE_MAX_RUNS] = {{0}};
    struct chart_panel panel[2];
    bool log_x = is_spread(c);
    int status = make_panel(c, false, log_x, curve, &panel[0]) < 0 ||
                         make_panel(c, true, log_x, curve + COMPARE_MAX_RUNS, &panel[1]) < 0
                     ? failure_no_memory(failure)
                     : 0;
    if (status == 0) {
        ret_axes->log_x = log_x;
        status =
            chart_svg(panel, 2, 1000, 460, "convergence",
                      "Distance to the lowest energy against iterations and against seconds", ret, failure);
    }
    free_curves(curve, 2 * COMPARE_MAX_RUNS);
    return status;
}

/* ---- exchange of energies ------------------------------------------------------------------------ */

bool compare_has_contact(const struct comparison *c)
{
    for (size_t i = 0; i < c->runs; i++) {
        for (size_t k = 0; k < c->run[i].trace.rows; k++) {
            if (c->run[i].trace.row[k].contact > 0) {
                return true;
            }
        }
    }
    return false;
}

static void span_run(const struct comparison *c, const struct trace *trace, double *low, double *high)
{
    for (size_t i = 0; i < trace->rows; i++) {
        for (size_t e = 0; e < COMPARE_ENERGIES; e++) {
            double energy = get_energy[e](c, &trace->row[i]);
            *low = isfinite(energy) ? fmin(*low, energy) : *low;
            *high = isfinite(energy) ? fmax(*high, energy) : *high;
        }
    }
}

/* What the energies of all tame runs span; a wild run is one that exceeds `most` somewhere. */
static void span_energies(const struct comparison *c, double *ret_low, double *ret_high)
{
    double most = isfinite(c->drop) ? HIGHEST_ENERGY * c->drop : LARGEST_ENERGY;
    double low = 0, high = 0;
    for (size_t i = 0; i < c->runs; i++) {
        double run_low = 0, run_high = 0;
        span_run(c, &c->run[i].trace, &run_low, &run_high);
        if (run_low >= -most && run_high <= most) {
            low = fmin(low, run_low);
            high = fmax(high, run_high);
        }
    }
    if (!(high > low)) { /* all are wild, or nothing ever moved */
        low = isfinite(c->drop) ? -most : -1;
        high = -low;
    }
    double margin = 0.05 * (high - low);
    *ret_low = low - margin;
    *ret_high = high + margin;
}

static const struct unit *choose_unit(double low, double high)
{
    const struct unit *unit = units;
    while (unit + 1 < units + UNITS && fmax(-low, high) < unit->joules) {
        unit++;
    }
    return unit;
}

static size_t find_stops(const struct trace *trace, double ret[MAX_STOPS])
{
    size_t stops = 0, seen = 0, kept = 0;
    for (size_t i = 0; i < trace->rows; i++) {
        stops += trace->row[i].stop > 0;
    }
    size_t each = 1 + (stops > 0 ? (stops - 1) / MAX_STOPS : 0);
    for (size_t i = 0; i < trace->rows; i++) {
        if (trace->row[i].stop > 0 && seen++ % each == 0 && kept < MAX_STOPS) {
            ret[kept++] = trace->row[i].iteration;
        }
    }
    return kept;
}

int compare_plot_exchange(const struct comparison *c, size_t run, char **ret, struct failure *failure)
{
    struct chart_curve curve[COMPARE_ENERGIES] = {{0}};
    double stop[MAX_STOPS];
    char id[32];
    int status = 0;
    double low, high;
    span_energies(c, &low, &high);
    const struct unit *unit = choose_unit(low, high);
    struct chart_panel panel = {.left = 0.16,
                                .right = 0.975,
                                .bottom = 0.17,
                                .top = 0.97,
                                .x_label = "iterations",
                                .y0 = low / unit->joules,
                                .y1 = high / unit->joules,
                                .y_label = unit->label,
                                .title = "",
                                .curve = curve,
                                .curves = compare_has_contact(c) ? COMPARE_ENERGIES : COMPARE_ENERGIES - 1,
                                .line_x = stop,
                                .lines = find_stops(&c->run[run].trace, stop)};
    for (size_t e = 0; e < panel.curves && status == 0; e++) {
        struct source s = {.comparison = c,
                           .trace = &c->run[run].trace,
                           .x = get_iteration,
                           .y = get_energy[e],
                           .unit = unit->joules,
                           .low = low,
                           .high = high};
        curve[e].colour = (int)e;
        curve[e].width = LINE_WIDTH;
        status = make_curve(&s, &curve[e]) < 0 ? failure_no_memory(failure) : 0;
    }
    if (status == 0) {
        span_x(&panel);
        snprintf(id, sizeof id, "exchange%zu", run);
        status = chart_svg(&panel, 1, 560, 330, id, "Elastic, gravity and kinetic energy against iterations",
                           ret, failure);
    }
    free_curves(curve, COMPARE_ENERGIES);
    return status;
}
