/* meter.c - see meter.h. */
#include "meter.h"

#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

/* Seconds between plain lines. */
#define PLAIN_PERIOD_S 2.0

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

struct meter meter_new(FILE *file, bool quiet)
{
    struct meter meter = {.file = quiet ? NULL : file, .shown_at = -PLAIN_PERIOD_S};
    meter.live = meter.file && isatty(fileno(file));
    return meter;
}

void meter_close(struct meter *meter)
{
    if (meter->dirty) {
        fputc('\n', meter->file);
        fflush(meter->file);
        meter->dirty = false;
    }
}

void meter_status(struct meter *meter, const char *status)
{
    if (!meter->file || strcmp(status, meter->state) == 0) {
        return;
    }
    snprintf(meter->state, sizeof meter->state, "%s", status);
    meter_close(meter);
    fprintf(meter->file, "%s\n", status);
    fflush(meter->file);
}

/* "  name value unit" with two digits, or nothing when the value is missing or null. */
static void put_number(FILE *file, const char *name, const json_t *value, const char *unit)
{
    if (json_is_number(value)) {
        fprintf(file, "  %s %.1e%s", name, json_number_value(value), unit);
    }
}

static void put_progress(FILE *file, const json_t *progress)
{
    const char *phase = json_string_value(json_object_get(progress, "phase"));
    const json_t *elapsed = json_object_get(progress, "elapsed_ms"),
                 *stops = json_object_get(progress, "stops");
    const json_t *percent = json_object_get(progress, "percent");
    fprintf(file, "%s iteration %5lld", phase ? phase : "draping",
            (long long)json_integer_value(json_object_get(progress, "iteration")));
    if (json_is_number(elapsed)) {
        fprintf(file, "  %5.1f s", json_number_value(elapsed) / 1000);
    }
    if (!phase ||
        strcmp(phase, "sewing") != 0) { /* while seams are pulled shut, residuals mean nothing yet */
        put_number(file, "residual", json_object_get(progress, "residual_energy"), " J");
        put_number(file, "force", json_object_get(progress, "residual_force"), "");
        if (json_is_integer(stops)) {
            fprintf(file, "  %lld stops", (long long)json_integer_value(stops));
        }
    }
    if (json_is_number(percent)) {
        fprintf(file, "  %.0f %%", json_number_value(percent));
    }
}

/* Columns of the terminal; a longer line would wrap and could not be rewritten. */
static int columns(FILE *file)
{
    struct winsize size;
    return ioctl(fileno(file), TIOCGWINSZ, &size) == 0 && size.ws_col > 1 ? size.ws_col - 1 : 79;
}

void meter_progress(struct meter *meter, const json_t *progress)
{
    if (!meter->file || !json_is_object(progress) ||
        (!meter->live && now() - meter->shown_at < PLAIN_PERIOD_S)) {
        return;
    }
    char text[256] = "";
    FILE *line = fmemopen(text, sizeof text, "w");
    if (!line) {
        return;
    }
    put_progress(line, progress);
    fclose(line);
    meter->shown_at = now();
    meter->dirty = meter->live;
    if (meter->live) {
        fprintf(meter->file, "\r\033[K%.*s", columns(meter->file), text);
    } else {
        fprintf(meter->file, "%s\n", text);
    }
    fflush(meter->file);
}
