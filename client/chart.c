/* chart.c - curves on axes as SVG, by PLplot.
 *
 * PLplot keeps its state in globals and answers a failure (a driver it cannot load, no memory) by
 * ending the process. Hence the way out through its exit handler by longjmp; after one such failure its
 * state is not to be trusted, so that nothing is drawn any more in this process. */
#include "chart.h"

#include <plplot.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* PLplot's own colours; those of the curves follow. */
enum { WHITE = 0, INK, GRID, MARK, FIRST, COLOURS = FIRST + CHART_COLOURS };
/* M. Okabe and K. Ito, "Color Universal Design" (2008), with brown for their yellow, which is faint on
 * white. */
static const PLINT RED[COLOURS] = {255, 40, 225, 176, 0, 213, 0, 204, 86, 230, 0, 133};
static const PLINT GREEN[COLOURS] = {255, 40, 225, 176, 114, 94, 158, 121, 180, 159, 0, 87};
static const PLINT BLUE[COLOURS] = {255, 40, 225, 176, 178, 0, 115, 167, 233, 0, 0, 35};

/* Heights of text (mm, as PLplot counts them): of titles and labels, and of the numbers on axes. */
#define LABEL_MM 3.6
#define TICK_MM  3.1

/* A dash and a gap (um). */
static PLINT DASH[] = {2200}, GAP[] = {1200};

static bool failed;
static jmp_buf way_out; /* set while PLplot runs */

static int leave_plplot(PLCHAR_VECTOR message)
{
    (void)message;
    longjmp(way_out, 1);
}

/* ---- drawing ------------------------------------------------------------------------------------- */

/* Letters of PLplot's axis options: g grid, b this edge, c the other, l logarithmic, n numbers, s minor
 * ticks, t ticks, v upright numbers. */
static void draw_axes(const struct chart_panel *p)
{
    plvpor(p->left, p->right, p->bottom, p->top);
    plwind(p->x0, p->x1, p->y0, p->y1);
    plcol0(GRID);
    plwidth(0.6);
    plbox(p->log_x ? "gl" : "g", 0, 0, p->log_y ? "gl" : "g", 0, 0);
    plcol0(INK);
    plwidth(0.8);
    plbox("bc", 0, 0, "bc", 0, 0);
    plschr(TICK_MM, 1);
    plsmaj(0, 0.5);
    plsmin(0, 0.5);
    plsxax(7, 0); /* numbers as they are, not with a power of ten apart */
    plsyax(7, 0);
    plbox(p->log_x ? "blnst" : "bnst", 0, 0, p->log_y ? "blnstv" : "bnstv", 0, 0);
    plschr(LABEL_MM, 1);
    plmtex("b", 3.0, 0.5, 0.5, p->x_label);
    plmtex("l", 4.6, 0.5, 0.5, p->y_label);
    plmtex("t", 1.0, 0.0, 0.0, p->title);
}

static void draw_lines(const struct chart_panel *p)
{
    plcol0(MARK);
    plwidth(0.8);
    for (size_t i = 0; i < p->lines; i++) {
        pljoin(p->line_x[i], p->y0, p->line_x[i], p->y1);
    }
}

static void draw_curve(const struct chart_curve *curve)
{
    plcol0(FIRST + curve->colour % CHART_COLOURS);
    plwidth(curve->width);
    plstyl(curve->dashed ? 1 : 0, DASH, GAP);
    if (curve->points > 1) {
        plline((PLINT)curve->points, curve->x, curve->y);
    }
    plstyl(0, DASH, GAP);
    if (curve->points > 0) { /* where it ends: a curve may be short, or a single point */
        plstring(1, curve->x + curve->points - 1, curve->y + curve->points - 1, "\xe2\x80\xa2");
    }
}

static void draw(const struct chart_panel *panel, size_t panels, int width, int height, FILE *file)
{
    plsdev("svg");
    plsfile(file);
    plspage(0, 0, width, height, 0, 0);
    plscmap0(RED, GREEN, BLUE, COLOURS);
    plfontld(0);
    plinit();
    pladv(0);
    for (size_t i = 0; i < panels; i++) {
        draw_axes(&panel[i]);
        draw_lines(&panel[i]);
        for (size_t k = 0; k < panel[i].curves; k++) {
            draw_curve(&panel[i].curve[k]);
        }
    }
    plend1(); /* closes the file; the library stays initialised (see below) */
}

/* Without its driver PLplot would ask the terminal for another one. This also reads the list of drivers,
 * which happens once: plend() would drop it, and PLplot crashes when it cannot be read a second time. */
static bool has_svg_driver(void)
{
    PLCHAR_VECTOR menu[64], device[64], *menus = menu, *devices = device;
    int count = 64;
    plgDevs(&menus, &devices, &count);
    for (int i = 0; i < count; i++) {
        if (strcmp(device[i], "svg") == 0) {
            return true;
        }
    }
    return false;
}

/* *ret: a whole SVG document. */
static int draw_document(const struct chart_panel *panel, size_t panels, int width, int height, char **ret)
{
    static size_t bytes; /* the stream writes it; static: must outlive a way out by longjmp */
    if (failed) {
        return -1;
    }
    FILE *file = open_memstream(ret, &bytes);
    if (!file) {
        return -1;
    }
    if (setjmp(way_out)) {
        failed = true;
        return -1; /* the stream is PLplot's by now: it stays open, once in a process */
    }
    plsexit(leave_plplot);
    if (!has_svg_driver()) {
        fclose(file);
        free(*ret);
        return -1;
    }
    draw(panel, panels, width, height, file);
    return 0;
}

/* ---- from a document to an element --------------------------------------------------------------- */

/* Copies `text` with `id` before each of PLplot's ids, which are the same in every picture. */
static void put_with_ids(FILE *file, const char *text, const char *id)
{
    static const char ours[] = "text-clipping";
    const char *found;
    while ((found = strstr(text, ours))) {
        fwrite(text, 1, (size_t)(found - text), file);
        fprintf(file, "%s-%s", id, ours);
        text = found + strlen(ours);
    }
    fputs(text, file);
}

/* The prologue and the root's fixed size (width="...pt") go; the viewBox keeps the proportions. */
static int put_element(FILE *file, const char *document, int width, int height, const char *id,
                       const char *title)
{
    const char *root = strstr(document, "<svg"), *inside = root ? strchr(root, '>') : NULL;
    if (!inside) {
        return -1;
    }
    fprintf(file,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %d %d\" role=\"img\" "
            "aria-label=\"%s\">",
            width, height, title);
    put_with_ids(file, inside + 1, id);
    return 0;
}

int chart_svg(const struct chart_panel *panel, size_t panels, int width, int height, const char *id,
              const char *title, char **ret, struct failure *failure)
{
    static char *document; /* static: must outlive a way out by longjmp */
    char *element = NULL;
    size_t bytes = 0;
    document = NULL;
    if (draw_document(panel, panels, width, height, &document) < 0) {
        return failure_set(failure, EXIT_LOCAL,
                           "PLplot cannot draw SVG here\ntry: install its driver (libplplot-dev), or --csv "
                           "without --output");
    }
    FILE *file = open_memstream(&element, &bytes);
    int status = file ? put_element(file, document, width, height, id, title) : -1;
    if (file && fclose(file) != 0) {
        status = -1;
    }
    free(document);
    if (status < 0) {
        free(element);
        return failure_no_memory(failure);
    }
    *ret = element;
    return 0;
}

void chart_colour(int colour, char ret[8])
{
    int i = FIRST + colour % CHART_COLOURS;
    snprintf(ret, 8, "#%02x%02x%02x", (unsigned)RED[i] & 255, (unsigned)GREEN[i] & 255,
             (unsigned)BLUE[i] & 255);
}
