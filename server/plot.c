/* plot.c - the convergence of a drape as a picture: residuals against iterations and seconds, in SVG.
 *
 * PLplot keeps its state in globals and answers a failure (a driver it cannot load, no memory) by
 * ending the process. Hence the lock, and the way out through its exit handler by longjmp; after one
 * such failure its state is not to be trusted, so that nothing is plotted any more in this process. */
#include "plot.h"

#include <dlfcn.h>
#include <math.h>
#include <plplot.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "memout.h"

/* Size of the picture, in pixels. */
#define WIDTH  1000
#define HEIGHT 640
/* A curve of more points than pixels shows no more; each piece keeps its lowest and its highest. */
#define MAX_PIECES 500
/* Height of a panel at most; more would crowd its numbers. */
#define MAX_DECADES 14
/* When there are more stops, every second, third, ... is marked. */
#define MAX_STOPS 200
/* A bullet. */
#define STOP_MARK "\xe2\x80\xa2"
/* Longer titles are cut short: about 70 letters fit. */
#define TITLE_BYTES 80

/* Colours of the palette below. */
enum { WHITE = 0, INK, GRID, FORCE, ENERGY, STOP, GOAL, COLOURS };
static const PLINT RED[COLOURS] = {255, 40, 221, 31, 180, 90, 44};
static const PLINT GREEN[COLOURS] = {255, 40, 221, 94, 74, 90, 140};
static const PLINT BLUE[COLOURS] = {255, 40, 221, 168, 22, 90, 60};

static pthread_mutex_t plot_lock = PTHREAD_MUTEX_INITIALIZER;
static bool plot_failed;     /* under the lock, like the next and draw_to_memory's stream */
static jmp_buf plot_way_out; /* set while PLplot runs */

static int leave_plplot(PLCHAR_VECTOR message)
{
    (void)message;
    longjmp(plot_way_out, 1);
}

/* ---- curves ---------------------------------------------------------------------------------- */

struct curve {
    double *x, *y; /* y: log10 of the values; points where it is not defined are left out */
    size_t points;
    double *stop_x, *stop_y;
    size_t stops;
};

static double value_of(const drape_row *row, bool energy)
{
    return energy ? row->residual_energy : row->residual_force;
}

static double abscissa_of(const drape_row *row, bool seconds)
{
    return seconds ? row->seconds : row->iteration;
}

static void add_point(struct curve *curve, const drape_row *row, bool energy, bool seconds)
{
    curve->x[curve->points] = abscissa_of(row, seconds);
    curve->y[curve->points++] = log10(value_of(row, energy));
}

static bool is_drawable(const drape_row *row, bool energy)
{
    double value = value_of(row, energy);
    return isfinite(value) && value > 0;
}

/* The lowest and the highest of one piece, in the order in which they come. */
static void add_piece(struct curve *curve, const drape_row *row, size_t rows, bool energy, bool seconds)
{
    size_t low = rows, high = rows;
    for (size_t i = 0; i < rows; i++) {
        if (!is_drawable(&row[i], energy))
            continue;
        if (low == rows || value_of(&row[i], energy) < value_of(&row[low], energy))
            low = i;
        if (high == rows || value_of(&row[i], energy) > value_of(&row[high], energy))
            high = i;
    }
    if (low == rows)
        return;
    add_point(curve, &row[low < high ? low : high], energy, seconds);
    if (low != high)
        add_point(curve, &row[low < high ? high : low], energy, seconds);
}

static void add_stops(struct curve *curve, const drape_row *row, size_t rows, bool energy, bool seconds)
{
    size_t stops = 0, each = 1, seen = 0;
    for (size_t i = 0; i < rows; i++)
        stops += row[i].stop;
    each += stops / MAX_STOPS;
    for (size_t i = 0; i < rows; i++)
        if (row[i].stop && seen++ % each == 0 && is_drawable(&row[i], energy)) {
            curve->stop_x[curve->stops] = abscissa_of(&row[i], seconds);
            curve->stop_y[curve->stops++] = log10(value_of(&row[i], energy));
        }
}

static void curve_done(struct curve *curve)
{
    free(curve->x);
    free(curve->y);
    free(curve->stop_x);
    free(curve->stop_y);
}

/* Nothing below MAX_DECADES under the highest point says more than "converged". */
static void clamp_curve(struct curve *curve)
{
    double highest = -INFINITY;
    for (size_t i = 0; i < curve->points; i++)
        highest = fmax(highest, curve->y[i]);
    for (size_t i = 0; i < curve->points; i++)
        curve->y[i] = fmax(curve->y[i], highest - MAX_DECADES);
    for (size_t i = 0; i < curve->stops; i++)
        curve->stop_y[i] = fmax(curve->stop_y[i], highest - MAX_DECADES);
}

static int make_curve(const drape_row *row, size_t rows, bool energy, bool seconds, struct curve *ret)
{
    size_t pieces = rows < MAX_PIECES ? rows : MAX_PIECES;
    size_t room = 2 * MAX_PIECES + 1;
    *ret = (struct curve){malloc(room * sizeof(double)),      malloc(room * sizeof(double)),      0,
                          malloc(MAX_STOPS * sizeof(double)), malloc(MAX_STOPS * sizeof(double)), 0};
    if (!ret->x || !ret->y || !ret->stop_x || !ret->stop_y)
        return -1;
    for (size_t i = 0; i < pieces; i++) {
        size_t from = rows * i / pieces, to = rows * (i + 1) / pieces;
        add_piece(ret, row + from, to - from, energy, seconds);
    }
    add_stops(ret, row, rows, energy, seconds);
    clamp_curve(ret);
    return 0;
}

/* ---- panels ---------------------------------------------------------------------------------- */

struct frame {
    double x0, x1, y0, y1;
};

/* Whole decades around the curve and `goal`; the x axis from 0 to a little past the last point. */
static struct frame make_frame(const struct curve *curve, double goal)
{
    struct frame frame = {0, 0, goal, goal};
    bool empty = !isfinite(goal);
    for (size_t i = 0; i < curve->points; i++) {
        frame.y0 = empty ? curve->y[i] : fmin(frame.y0, curve->y[i]);
        frame.y1 = empty ? curve->y[i] : fmax(frame.y1, curve->y[i]);
        frame.x1 = fmax(frame.x1, curve->x[i]);
        empty = false;
    }
    if (empty)
        frame.y0 = frame.y1 = 0;
    frame.x1 = frame.x1 > 0 ? 1.02 * frame.x1 : 1;
    frame.y0 = floor(frame.y0 - 0.1);
    frame.y1 = ceil(frame.y1 + 0.1);
    return frame;
}

/* Heights of text, in PLplot's unit: 1 is about 22 of our pixels. */
#define TITLE_HEIGHT 0.78
#define LABEL_HEIGHT 0.66
#define TICK_HEIGHT  0.56

/* Grid, frame, ticks below and on the left. */
static void draw_axes(const struct frame *f, bool energy)
{
    plwind(f->x0, f->x1, f->y0, f->y1);
    plcol0(GRID);
    plwidth(0.6);
    plbox("g", 0, 0, "g", 0, 0);
    plcol0(INK);
    plwidth(0.8);
    plbox("bc", 0, 0, "bc", 0, 0);
    plschr(0, TICK_HEIGHT);
    plsmaj(0, 0.5);
    plsmin(0, 0.5);
    plsxax(7, 0); /* whole iterations up to the largest there can be, not powers of ten */
    /* b: this edge, l: logarithmic, n: numbers, s: minor ticks, t: ticks, v: upright numbers */
    plbox(energy ? "bnst" : "bst", 0, 0, "blnstv", 0, 0);
}

static void draw_goal(const struct frame *f, double goal)
{
    plcol0(GOAL);
    pllsty(2);
    pljoin(f->x0, goal, f->x1, goal);
    pllsty(1);
    plptex(f->x0 + 0.015 * (f->x1 - f->x0), goal - 0.035 * (f->y1 - f->y0), 1, 0, 0, "tolerance");
}

/* One of the four panels: column 0 iterations, 1 seconds; row 0 force, 1 energy. */
static void draw_panel(const struct curve *curve, bool energy, bool seconds, double goal)
{
    struct frame f = make_frame(curve, goal);
    double left = seconds ? 0.575 : 0.085, bottom = energy ? 0.1 : 0.53;
    plvpor(left, left + 0.405, bottom, bottom + 0.37);
    draw_axes(&f, energy);
    if (isfinite(goal))
        draw_goal(&f, goal);
    plcol0(energy ? ENERGY : FORCE);
    plwidth(1.6);
    if (curve->points > 1)
        plline((PLINT)curve->points, curve->x, curve->y);
    else if (curve->points == 1)
        plstring(1, curve->x, curve->y, STOP_MARK);
    plwidth(1);
    plcol0(STOP);
    if (curve->stops > 0)
        plstring((PLINT)curve->stops, curve->stop_x, curve->stop_y, STOP_MARK);
    plcol0(INK);
    plschr(0, LABEL_HEIGHT);
    plmtex("l", 4.9, 0.5, 0.5, energy ? "residual energy (J, estimate)" : "residual force / vertex weight");
    if (energy)
        plmtex("b", 3.3, 0.5, 0.5, seconds ? "time (s)" : "iteration");
}

/* PLplot takes # as the start of an escape; ## is the character itself. Control characters have no place
 * in XML. A title too long is cut between two characters. */
static void escape_title(const char *title, char *ret, size_t size)
{
    size_t n = 0;
    for (; *title && n + 3 < size; title++) {
        if (*title == '#')
            ret[n++] = '#';
        ret[n++] = (unsigned char)*title < ' ' || *title == 0x7F ? ' ' : *title;
    }
    if (((unsigned char)*title & 0xC0) == 0x80) { /* cut inside a character: drop its first bytes */
        while (n > 0 && ((unsigned char)ret[n - 1] & 0xC0) == 0x80)
            n--;
        n -= n > 0;
    }
    ret[n] = '\0';
}

static void draw(struct curve curve[4], double tolerance, const char *title, FILE *file)
{
    char text[TITLE_BYTES];
    escape_title(title, text, sizeof text);
    plsdev("svg");
    plsfile(file);
    plspage(0, 0, WIDTH, HEIGHT, 0, 0);
    plscmap0(RED, GREEN, BLUE, COLOURS);
    plfontld(0);
    plinit();
    pladv(0);
    plvpor(0, 1, 0, 1);
    plwind(0, 1, 0, 1);
    plcol0(INK);
    plschr(0, TITLE_HEIGHT);
    plptex(0.085, 0.955, 1, 0, 0, text);
    plschr(0, TICK_HEIGHT);
    plptex(0.98, 0.955, 1, 0, 1, STOP_MARK " all velocities cut");
    for (size_t i = 0; i < 4; i++)
        draw_panel(&curve[i], i >= 2, i % 2 == 1, i < 2 ? log10(tolerance) : NAN);
    plend1(); /* closes the file; the library stays initialised (see below) */
}

/* Begins libltdl, by which PLplot loads its drivers without having looked whether that began; it counts how
 * often it is begun. Once it has not, each driver that is asked for ends the process. A PLplot that has its
 * drivers inside does without. */
static bool begin_loader(void)
{
    int (*begin)(void) = (int (*)(void))dlsym(RTLD_DEFAULT, "lt_dlinit");
    plot_failed = begin != NULL && begin() != 0;
    return !plot_failed;
}

/* Without its driver PLplot would ask the terminal for another one. This also reads the list of drivers,
 * which happens once: plend() would drop it, and PLplot crashes when it cannot be read a second time. */
static bool has_svg_driver(void)
{
    PLCHAR_VECTOR menu[64], device[64], *menus = menu, *devices = device;
    int count = 64;
    plgDevs(&menus, &devices, &count);
    for (int i = 0; i < count; i++)
        if (strcmp(device[i], "svg") == 0)
            return true;
    return false;
}

/* Under the lock. */
static int draw_to_memory(struct curve curve[4], double tolerance, const char *title, char **ret,
                          size_t *ret_bytes)
{
    static struct memout memout; /* static: the stream may stay open, see below; then nobody comes again */
    FILE *file = begin_loader() ? memout_open(&memout) : NULL;
    if (!file)
        return -1;
    if (setjmp(plot_way_out)) {
        plot_failed = true;
        return -1; /* the stream is PLplot's by now: it stays open, once in a process */
    }
    plsexit(leave_plplot);
    if (!has_svg_driver()) {
        fclose(file);
        return -1;
    }
    draw(curve, tolerance, title, file); /* closes it */
    *ret = memout_take(&memout, ret_bytes);
    return *ret == NULL ? -1 : 0;
}

int plot_trace_svg(const drape_row *row, size_t rows, double tolerance, const char *title, char **ret,
                   size_t *ret_bytes)
{
    struct curve curve[4] = {{0}};
    int rc = 0;
    for (size_t i = 0; i < 4 && rc == 0; i++)
        rc = make_curve(row, rows, i >= 2, i % 2 == 1, &curve[i]);
    if (rc == 0) {
        pthread_mutex_lock(&plot_lock);
        rc = plot_failed ? -1 : draw_to_memory(curve, tolerance, title, ret, ret_bytes);
        pthread_mutex_unlock(&plot_lock);
    }
    for (size_t i = 0; i < 4; i++)
        curve_done(&curve[i]);
    return rc;
}
