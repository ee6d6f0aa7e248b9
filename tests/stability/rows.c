/* rows.c - one row of the stability table: a case under a method, in a process of its own.
 *
 * A row passes when the run neither crashes nor hangs nor overruns its time limit by more than one
 * iteration that could have been expected to fit in, everything it returns is finite, and the state returned
 * has no more potential energy than the start. Not coming to rest is fine. What the report says of the state
 * is measured again from the positions. */
#include "rows.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define ROUND_OFF      1e-12 /* of the sum of the energies' sizes: what may be noise in a comparison of two */
#define POSITION_ERROR 1e-14 /* relative: see stretch_noise */
#define REPORT_ERROR   1e-6  /* relative: energies reported against those measured from the positions */
#define GRACE          5.0   /* s, for what is not an iteration, on a busy machine */
#define EXPLICIT_STEP  2e-4  /* s, unless the case is about the step: the plain cloth needs 1e-3 */
#define SUNK           1e-3  /* m inside a body: then the verdict is `intersecting` */
#define MAX_WORKERS    64

const struct stability_method stability_method[] = {
    {.name = "auto", .method = DRAPE_METHOD_AUTO},
    {.name = "stop-and-go", .method = DRAPE_METHOD_STOP_AND_GO},
    {.name = "stop-and-go, kinetic", .method = DRAPE_METHOD_STOP_AND_GO, .stop_on = DRAPE_STOP_ON_KINETIC},
    {.name = "stop-and-go, bdf2", .method = DRAPE_METHOD_STOP_AND_GO, .integrator = DRAPE_BDF2},
    {.name = "stop-and-go, bdf2, kinetic",
     .method = DRAPE_METHOD_STOP_AND_GO,
     .stop_on = DRAPE_STOP_ON_KINETIC,
     .integrator = DRAPE_BDF2},
    {.name = "stop-and-go, midpoint",
     .method = DRAPE_METHOD_STOP_AND_GO,
     .integrator = DRAPE_IMPLICIT_MIDPOINT},
    {.name = "stop-and-go, midpoint, kinetic",
     .method = DRAPE_METHOD_STOP_AND_GO,
     .stop_on = DRAPE_STOP_ON_KINETIC,
     .integrator = DRAPE_IMPLICIT_MIDPOINT},
    {.name = "stop-and-go, rk4",
     .method = DRAPE_METHOD_STOP_AND_GO,
     .integrator = DRAPE_RK4,
     .may_fail = true},
    {.name = "stop-and-go, rk4, kinetic",
     .method = DRAPE_METHOD_STOP_AND_GO,
     .stop_on = DRAPE_STOP_ON_KINETIC,
     .integrator = DRAPE_RK4,
     .may_fail = true},
    {.name = "dynamic", .method = DRAPE_METHOD_DYNAMIC},
    {.name = "dynamic, air damping", .method = DRAPE_METHOD_DYNAMIC, .air_damping = 2},
    {.name = "dynamic, material damping", .method = DRAPE_METHOD_DYNAMIC, .material_damping = 0.01},
    {.name = "dynamic, bdf2", .method = DRAPE_METHOD_DYNAMIC, .integrator = DRAPE_BDF2},
    {.name = "dynamic, midpoint", .method = DRAPE_METHOD_DYNAMIC, .integrator = DRAPE_IMPLICIT_MIDPOINT},
    {.name = "dynamic, rk4", .method = DRAPE_METHOD_DYNAMIC, .integrator = DRAPE_RK4, .may_fail = true},
    {.name = "velocity-correction", .method = DRAPE_METHOD_VELOCITY_CORRECTION},
    {.name = "velocity-correction, bdf2",
     .method = DRAPE_METHOD_VELOCITY_CORRECTION,
     .integrator = DRAPE_BDF2},
    {.name = "velocity-correction, midpoint",
     .method = DRAPE_METHOD_VELOCITY_CORRECTION,
     .integrator = DRAPE_IMPLICIT_MIDPOINT},
    {.name = "velocity-correction, rk4",
     .method = DRAPE_METHOD_VELOCITY_CORRECTION,
     .integrator = DRAPE_RK4,
     .may_fail = true},
    {.name = "quasi-static", .method = DRAPE_METHOD_QUASI_STATIC},
    {.name = "newton", .method = DRAPE_METHOD_NEWTON, .may_fail = true},
    {.name = "newton, line search", .method = DRAPE_METHOD_NEWTON, .line_search = true},
};
const size_t stability_methods = sizeof stability_method / sizeof *stability_method;

const char *const row_verdict_name[ROW_VERDICTS] = {"at-rest", "not-at-rest", "slid-off", "intersecting",
                                                    "refused", "no result",   "VIOLATION"};

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

__attribute__((format(printf, 3, 4))) static void conclude(struct row *row, enum verdict verdict,
                                                           const char *format, ...)
{
    va_list args;
    va_start(args, format);
    row->verdict = verdict;
    vsnprintf(row->why, sizeof row->why, format, args);
    va_end(args);
}

/* ---- the child: one run, judged ----------------------------------------------------------------- */

static double rest_area(const drape_scene_desc *desc, size_t t)
{
    const uint32_t *corner = desc->triangle + 3 * t;
    const double *a = desc->pattern + 2 * corner[0], *b = desc->pattern + 2 * corner[1],
                 *c = desc->pattern + 2 * corner[2];
    return fabs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2;
}

/* Membrane energy of triangle t at positions x: half e'De times the rest area, e the Green strain. */
static double measure_stretch(const drape_scene_desc *desc, size_t t, const double *x)
{
    const uint32_t *corner = desc->triangle + 3 * t;
    const drape_material *m = desc->material + (desc->triangle_material ? desc->triangle_material[t] : 0);
    double d[2][2], p[2][3], column[2][3], e[3]; /* rest sides, sides, columns of F, strain */
    for (size_t k = 0; k < 2; k++) {
        for (size_t i = 0; i < 2; i++)
            d[k][i] = desc->pattern[2 * corner[k + 1] + i] - desc->pattern[2 * corner[0] + i];
        for (size_t i = 0; i < 3; i++)
            p[k][i] = x[3 * corner[k + 1] + i] - x[3 * corner[0] + i];
    }
    double twice = d[0][0] * d[1][1] - d[0][1] * d[1][0];
    for (size_t i = 0; i < 3; i++) {
        column[0][i] = (d[1][1] * p[0][i] - d[0][1] * p[1][i]) / twice;
        column[1][i] = (d[0][0] * p[1][i] - d[1][0] * p[0][i]) / twice;
    }
    for (size_t k = 0; k < 3; k++) {
        const double *a = column[k == 1], *b = column[k != 0];
        e[k] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    }
    double weft = (e[0] - 1) / 2, warp = (e[1] - 1) / 2, shear = e[2]; /* shear: 2 E_uv */
    double nu = m->poisson, mixed = nu * sqrt(m->stretch_weft) * sqrt(m->stretch_warp);
    return fabs(twice) / 4 *
           ((m->stretch_weft * weft * weft + 2 * mixed * weft * warp + m->stretch_warp * warp * warp) /
                (1 - nu * nu) +
            m->stretch_shear * shear * shear);
}

/* Weight times descent from the start; meant for scenes without seams. */
static double measure_gravity(const drape_scene_desc *desc, size_t t, const double *x)
{
    const uint32_t *corner = desc->triangle + 3 * t;
    const drape_material *m = desc->material + (desc->triangle_material ? desc->triangle_material[t] : 0);
    double mass = m->density * rest_area(desc, t);
    double sum = 0;
    for (size_t k = 0; k < 3; k++)
        for (size_t i = 0; i < 3; i++)
            sum -= mass / 3 * desc->gravity[i] * (x[3 * corner[k] + i] - desc->positions[3 * corner[k] + i]);
    return sum;
}

/* J: what rounding alone may make of the membrane's energy, when positions are known to 1e-14 of their
 * size: strains of that over the triangle's altitude. */
static double stretch_noise(const drape_scene_desc *desc, const double *x)
{
    double reach = 0, sum = 0;
    for (size_t i = 0; i < 3 * desc->vertices; i++)
        reach = fmax(reach, fmax(fabs(x[i]), fabs(desc->positions[i])));
    for (size_t t = 0; t < desc->triangles; t++) {
        const uint32_t *corner = desc->triangle + 3 * t;
        const drape_material *m = desc->material + (desc->triangle_material ? desc->triangle_material[t] : 0);
        double longest = 0, area = rest_area(desc, t);
        for (size_t k = 0; k < 3; k++) {
            const double *a = desc->pattern + 2 * corner[k], *b = desc->pattern + 2 * corner[(k + 1) % 3];
            longest = fmax(longest, hypot(b[0] - a[0], b[1] - a[1]));
        }
        double strain = POSITION_ERROR * reach * longest / (2 * area);
        double k = fmax(m->stretch_weft, m->stretch_warp) / (1 - m->poisson * m->poisson) + m->stretch_shear;
        sum += k * area * strain * strain;
    }
    return sum;
}

static bool has_curves(const struct scene *scene)
{
    const drape_material *m = scene->material;
    return m->curve_weft.points || m->curve_warp.points || m->curve_shear.points;
}

/* Stretch (of a fabric without curves) and gravity (where nothing was sewn), the
 * shares that are easily measured again. */
static bool report_is_true(const struct scene *scene, const double *x, const drape_energies *energy,
                           double noise, struct row *row)
{
    const drape_scene_desc *desc = &scene->desc;
    long double stretch = 0, gravity = 0;
    for (size_t t = 0; t < desc->triangles; t++) {
        stretch += measure_stretch(desc, t, x);
        gravity += measure_gravity(desc, t, x);
    }
    double error = REPORT_ERROR * (fabs(energy->stretch) + fabs(energy->gravity)) + noise;
    if (!has_curves(scene) && fabs((double)stretch - energy->stretch) > error)
        conclude(row, ROW_VIOLATION, "reports a stretch energy of %.9g J, the positions have %.9g J",
                 energy->stretch, (double)stretch);
    else if (!desc->seams && fabs((double)gravity - energy->gravity) > error)
        conclude(row, ROW_VIOLATION, "reports a gravity energy of %.9g J, the positions have %.9g J",
                 energy->gravity, (double)gravity);
    return row->verdict != ROW_VIOLATION;
}

/* The member of a row that is not finite; NULL: all are. The residual energy is an estimate that only a
 * factorised step matrix gives: where there is none it may be NaN. */
static const char *not_finite(const drape_row *row, bool estimated)
{
    const drape_energies *e = &row->energy;
    const struct {
        const char *member;
        double value;
    } member[] = {
        {"seconds", row->seconds},
        {"stretch", e->stretch},
        {"bend", e->bend},
        {"gravity", e->gravity},
        {"contact", e->contact},
        {"kinetic", e->kinetic},
        {"potential", e->potential},
        {"residual_force", row->residual_force},
        {"time_step", row->time_step},
    };
    for (size_t i = 0; i < sizeof member / sizeof *member; i++)
        if (!isfinite(member[i].value))
            return member[i].member;
    return isfinite(row->residual_energy) || (!estimated && isnan(row->residual_energy)) ? NULL
                                                                                         : "residual_energy";
}

static bool is_finite(const drape_sim *sim, const struct stability_method *method, struct row *row)
{
    const drape_report *report = drape_sim_report(sim);
    size_t rows, vertices;
    const drape_row *trace = drape_sim_trace(sim, &rows);
    bool estimated = method->integrator != DRAPE_RK4 && method->method != DRAPE_METHOD_NEWTON;
    bool late = strstr(report->reason, "time limit") != NULL; /* the last row's matrix was not factorised */
    const double *x = drape_sim_positions(sim, &vertices);
    for (size_t i = 0; i < 3 * vertices; i++)
        if (!isfinite(x[i])) {
            conclude(row, ROW_VIOLATION, "not finite: the position of vertex %zu", i / 3);
            return false;
        }
    const char *member = not_finite(&report->state, estimated && !late);
    if (!isfinite(report->seam_gap))
        member = "seam_gap";
    if (!isfinite(report->deepest))
        member = "deepest";
    if (member) {
        conclude(row, ROW_VIOLATION, "not finite: %s in the report", member);
        return false;
    }
    for (size_t i = 0; i < rows; i++)
        if ((member = not_finite(trace + i, estimated && !(late && i == rows - 1)))) {
            conclude(row, ROW_VIOLATION, "not finite: %s in row %zu of %zu of the trace", member, i, rows);
            return false;
        }
    return true;
}

/* The fit where it was asked for: strain and stress always, the gap where a body is near. */
static bool fit_is_finite(const drape_sim *sim, bool asked, struct row *row)
{
    const drape_fit *fit = drape_sim_fit(sim);
    if (!fit != !asked)
        conclude(row, ROW_VIOLATION, asked ? "no fit" : "a fit that was not asked for");
    for (size_t i = 0; fit && i < 3 * fit->triangles; i++)
        if (!isfinite(fit->strain[i]) || !isfinite(fit->stress[i]))
            conclude(row, ROW_VIOLATION, "not finite: strain or stress of triangle %zu", i / 3);
    for (size_t i = 0; fit && i < fit->vertices; i++)
        if (!isfinite(fit->pressure[i]) || isinf(fit->gap[i]))
            conclude(row, ROW_VIOLATION, "not finite: pressure or gap of vertex %zu", i);
    return row->verdict != ROW_VIOLATION;
}

/* Crossings of the cloth with itself: `intersecting` names the place, and steps make none, so that a start
 * without any ends without any. Not where seams were sewn before the first row, nor where pins hold the cloth
 * deep in a body, which presses layers together with a thousand times what their penalty can carry. */
static void judge_crossings(const struct stability_case *which, const struct scene *scene,
                            const drape_scene *made, const drape_report *report, struct row *row)
{
    const double *at = report->intersection;
    bool counted = report->self_intersections != DRAPE_NOT_COUNTED,
         found = counted && report->self_intersections,
         placed = isfinite(at[0]) && isfinite(at[1]) && isfinite(at[2]);
    drape_sim *start = NULL;
    drape_options options = drape_options_default();
    options.max_iterations = 0;
    if ((found || report->deepest > SUNK) != (report->verdict == DRAPE_VERDICT_INTERSECTING))
        conclude(row, ROW_VIOLATION, "%s with %u crossings, %.3g m deep", drape_verdict_name(report->verdict),
                 report->self_intersections, report->deepest);
    else if ((found || report->penetrations) && !placed)
        conclude(row, ROW_VIOLATION, "an intersection without a place");
    if (!found || scene->desc.seams || which->expectation == MAY_CROSS || report->deepest > SUNK)
        return;
    if (drape_sim_new(made, &options, &start, NULL) < 0 || drape_sim_run(start, NULL) < 0)
        conclude(row, ROW_VIOLATION, "the start alone could not be evaluated");
    else if (!drape_sim_report(start)->self_intersections)
        conclude(row, ROW_VIOLATION, "%u crossings from a start without any", report->self_intersections);
    drape_sim_free(start);
}

static double size_of(const drape_energies *e)
{
    return fabs(e->stretch) + fabs(e->bend) + fabs(e->gravity) + fabs(e->contact);
}

/* s: what a limit may be overrun by: one iteration. It began because it was expected to fit in, so that it
 * takes the limit once more at the very most, where the machine is half as fast as was to be expected. */
static double overrun(const struct row_job *job, const drape_row *trace, size_t rows)
{
    double longest = trace[0].seconds;
    for (size_t i = 1; i < rows; i++)
        longest = fmax(longest, trace[i].seconds - trace[i - 1].seconds);
    return fmin(longest, job->time_limit) + GRACE;
}

static void judge(const struct row_job *job, const struct scene *scene, const drape_scene *made,
                  const drape_sim *sim, drape_status status, struct row *row)
{
    static const enum verdict verdict[] = {[DRAPE_VERDICT_NOT_AT_REST] = ROW_NOT_AT_REST,
                                           [DRAPE_VERDICT_AT_REST] = ROW_AT_REST,
                                           [DRAPE_VERDICT_SLID_OFF] = ROW_SLID_OFF,
                                           [DRAPE_VERDICT_INTERSECTING] = ROW_INTERSECTING};
    const drape_report *report = drape_sim_report(sim);
    size_t rows, vertices;
    const drape_row *trace = drape_sim_trace(sim, &rows);
    const double *x = drape_sim_positions(sim, &vertices);
    row->iterations = report->iterations;
    row->residual = report->state.residual_force;
    row->start = rows ? trace[0].energy.potential : 0;
    row->end = report->state.energy.potential;
    row->verdict = verdict[report->verdict];
    double noise = stretch_noise(&scene->desc, x);
    if (!is_finite(sim, job->method, row) || !report_is_true(scene, x, &report->state.energy, noise, row) ||
        !fit_is_finite(sim, scene->options.fit, row))
        return;
    noise += ROUND_OFF * (size_of(&trace[0].energy) + size_of(&report->state.energy));
    if (row->end - row->start > noise)
        conclude(row, ROW_VIOLATION, "worse than the start by %.3g J", row->end - row->start);
    else if ((status == DRAPE_OK) != (report->verdict == DRAPE_VERDICT_AT_REST))
        conclude(row, ROW_VIOLATION, "status %s with verdict %s", drape_status_name(status),
                 drape_verdict_name(report->verdict));
    else if (report->verdict == DRAPE_VERDICT_AT_REST && !(row->residual <= scene->options.tolerance))
        conclude(row, ROW_VIOLATION, "at rest with a residual force of %.3g", row->residual);
    else if (report->iterations > job->max_iterations)
        conclude(row, ROW_VIOLATION, "%u iterations, %u allowed", report->iterations, job->max_iterations);
    else if (row->seconds > job->time_limit + overrun(job, trace, rows))
        conclude(row, ROW_VIOLATION, "took %.1f s, the limit was %.1f s", row->seconds, job->time_limit);
    else if (!report->reason || !*report->reason)
        conclude(row, ROW_VIOLATION, "gives no reason");
    else if (row->verdict != ROW_AT_REST)
        conclude(row, row->verdict, "%s", report->reason);
    if (row->verdict != ROW_VIOLATION)
        judge_crossings(job->which, scene, made, report, row);
}

/* A status below zero: was it right to give no result? */
static void judge_failure(const struct row_job *job, drape_status status, const drape_error *error,
                          struct row *row)
{
    const struct stability_case *which = job->which;
    bool named = error->place == which->place &&
                 (which->member ? error->member && !strcmp(error->member, which->member) : true);
    if (error->status != status || !*error->message)
        conclude(row, ROW_VIOLATION, "%s without a proper error", drape_status_name(status));
    else if (status == DRAPE_EINVAL && which->expectation == MUST_REFUSE && named)
        conclude(row, ROW_REFUSED, "%s", error->message);
    else if (status == DRAPE_EINVAL && which->expectation == MAY_REFUSE)
        conclude(row, ROW_REFUSED, "%s", error->message);
    else if (status == DRAPE_ENUMERIC && which->expectation != MUST_REFUSE && job->method->may_fail)
        conclude(row, ROW_NO_RESULT, "%s", error->message);
    else
        conclude(row, ROW_VIOLATION, "%s: %s %s%s%s", drape_status_name(status), error->message,
                 error->member ? "(" : "", error->member ? error->member : "", error->member ? ")" : "");
}

static drape_sim *run_once(const struct row_job *job, struct scene *scene, drape_scene **ret_scene,
                           struct row *row)
{
    drape_error error = {0};
    drape_sim *sim = NULL;
    *ret_scene = NULL;
    memset(row, 0, sizeof *row);
    drape_status status = drape_scene_new(&scene->desc, ret_scene, &error);
    if (status >= 0)
        status = drape_sim_new(*ret_scene, &scene->options, &sim, &error);
    if (status >= 0) {
        double began = now();
        status = drape_sim_run(sim, &error);
        row->seconds = now() - began;
    }
    if (status < 0)
        judge_failure(job, status, &error, row);
    else if (job->which->expectation == MUST_REFUSE)
        conclude(row, ROW_VIOLATION, "should have been refused");
    else
        judge(job, scene, *ret_scene, sim, status, row);
    if (status < 0)
        sim = drape_sim_free(sim);
    return sim;
}

/* A run cut short by the clock need not repeat itself. */
static bool same_bytes(const drape_sim *a, const drape_sim *b)
{
    size_t vertices, rows[2];
    if (!a || !b)
        return a == b;
    drape_sim_trace(a, &rows[0]);
    drape_sim_trace(b, &rows[1]);
    const double *x = drape_sim_positions(a, &vertices), *y = drape_sim_positions(b, &vertices);
    return rows[0] == rows[1] && !memcmp(x, y, 3 * vertices * sizeof *x);
}

static void set_method(const struct row_job *job, drape_options *options)
{
    bool own_step = job->which->group == IN_STEP || job->which->expectation == MUST_REFUSE;
    if (job->method->integrator == DRAPE_RK4 && !own_step)
        options->time_step = EXPLICIT_STEP;
    options->method = job->method->method;
    options->stop_on = job->method->stop_on;
    options->integrator = job->method->integrator;
    options->line_search = job->method->line_search;
    options->air_damping = job->method->air_damping;
    options->material_damping = job->method->material_damping;
    options->max_iterations = job->max_iterations;
    options->time_limit = job->time_limit;
}

static void run_row(const struct row_job *job, struct row *row)
{
    struct scene scene;
    drape_scene *made, *made_again = NULL;
    struct row again;
    scene_make(job->which, &scene);
    set_method(job, &scene.options);
    drape_blas_prepare();
    drape_sim *sim = run_once(job, &scene, &made, row), *sim_again = NULL;
    row->twice = job->twice && row->verdict != ROW_VIOLATION && row->seconds < job->time_limit / 2;
    if (row->twice) {
        sim_again = run_once(job, &scene, &made_again, &again);
        if (again.seconds < job->time_limit && !same_bytes(sim, sim_again))
            conclude(row, ROW_VIOLATION, "other bytes the second time");
    }
    drape_sim_free(sim);
    drape_sim_free(sim_again);
    drape_scene_free(made);
    drape_scene_free(made_again);
    scene_done(&scene);
}

/* ---- the parent: processes at a time, rows in order ---------------------------------------------- */

struct worker {
    pid_t pid;
    int fd;              /* the row comes out here */
    double deadline;     /* killed then */
    struct row_job *job; /* NULL: idle */
};

static void start(struct worker *worker, struct row_job *job)
{
    int pipes[2];
    fflush(NULL);
    if (pipe(pipes) || (worker->pid = fork()) < 0) {
        perror("stability");
        exit(2);
    }
    if (worker->pid == 0) {
        struct row row;
        close(pipes[0]);
        run_row(job, &row);
        ssize_t written = write(pipes[1], &row, sizeof row);
        exit(written == (ssize_t)sizeof row ? 0 : 1); /* by the front door: a leak checker looks there */
    }
    close(pipes[1]);
    worker->fd = pipes[0];
    worker->deadline = now() + job->patience;
    worker->job = job;
}

static void finish(struct worker *worker, bool overdue)
{
    struct row *row = &worker->job->row;
    int status = 0;
    if (overdue)
        kill(worker->pid, SIGKILL);
    ssize_t got = overdue ? 0 : read(worker->fd, row, sizeof *row);
    while (waitpid(worker->pid, &status, 0) < 0 && errno == EINTR)
        ;
    close(worker->fd);
    if (overdue || got != (ssize_t)sizeof *row || status != 0) {
        memset(row, 0, sizeof *row);
        if (overdue)
            conclude(row, ROW_VIOLATION, "hangs: killed after %.0f s", worker->job->patience);
        else if (WIFSIGNALED(status))
            conclude(row, ROW_VIOLATION, "crashes: signal %d, %s", WTERMSIG(status),
                     strsignal(WTERMSIG(status)));
        else
            conclude(row, ROW_VIOLATION, "crashes: exit status %d", WEXITSTATUS(status));
    }
    worker->job = NULL;
}

/* Waits for one of the busy workers to be done or overdue. */
static struct worker *next_done(struct worker *worker, size_t workers, bool *ret_overdue)
{
    for (;;) {
        struct pollfd fd[MAX_WORKERS];
        for (size_t i = 0; i < workers; i++)
            fd[i] = (struct pollfd){.fd = worker[i].job ? worker[i].fd : -1, .events = POLLIN};
        poll(fd, workers, 200);
        for (size_t i = 0; i < workers; i++) {
            if (!worker[i].job)
                continue;
            *ret_overdue = !fd[i].revents && now() > worker[i].deadline;
            if (fd[i].revents || *ret_overdue)
                return worker + i;
        }
    }
}

static void print(FILE *const *out, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void print(FILE *const *out, const char *format, ...)
{
    for (; *out; out++) {
        va_list args;
        va_start(args, format);
        vfprintf(*out, format, args);
        va_end(args);
        fflush(*out);
    }
}

void rows_head(FILE *const *out)
{
    print(out, "%-9s %-33s %-31s %-12s %6s %9s %12s %12s %7s\n", "group", "case", "method", "verdict", "iter",
          "residual", "E start (J)", "E end (J)", "s");
}

static void print_row(const struct row_job *job, FILE *const *out)
{
    const struct row *row = &job->row;
    bool silent = job->which->expectation == MUST_REFUSE;
    print(out, "%-9s %-33s %-31s %-12s", group_name[job->which->group], job->which->name,
          silent ? "any" : job->method->name, row_verdict_name[row->verdict]);
    if (row->start != 0 || row->end != 0 || row->iterations)
        print(out, " %6u %9.2g %12.5g %12.5g %7.2f%s", row->iterations, row->residual, row->start, row->end,
              row->seconds, row->twice ? " =" : "");
    print(out, "%s%s\n", *row->why ? "  " : "", row->why);
}

size_t rows_run(struct row_job *job, size_t jobs, size_t workers, FILE *const *out)
{
    struct worker worker[MAX_WORKERS] = {0};
    size_t started = 0, printed = 0, busy = 0, violations = 0;
    bool *done = calloc(jobs ? jobs : 1, sizeof *done);
    if (!done)
        return jobs;
    workers = workers < 1 ? 1 : workers > MAX_WORKERS ? MAX_WORKERS : workers;
    while (started < jobs || busy) {
        for (size_t i = 0; i < workers && started < jobs; i++)
            if (!worker[i].job) {
                start(worker + i, job + started++);
                busy++;
            }
        bool overdue;
        struct worker *ready = next_done(worker, workers, &overdue);
        done[ready->job - job] = true;
        finish(ready, overdue);
        busy--;
        for (; printed < jobs && done[printed]; printed++) {
            print_row(job + printed, out);
            violations += job[printed].row.verdict == ROW_VIOLATION;
        }
    }
    free(done);
    return violations;
}

void rows_summary(const struct row_job *job, size_t jobs, FILE *const *out)
{
    size_t count[ROW_VERDICTS] = {0}, twice = 0, cases = 0;
    for (size_t i = 0; i < jobs; i++) {
        count[job[i].row.verdict]++;
        twice += job[i].row.twice;
        cases += i == 0 || job[i].which != job[i - 1].which;
    }
    print(out, "\n%-32s", "verdicts by method");
    for (size_t v = 0; v < ROW_VERDICTS; v++)
        print(out, " %12s", row_verdict_name[v]);
    print(out, "\n");
    for (size_t m = 0; m < stability_methods; m++) {
        size_t of[ROW_VERDICTS] = {0};
        for (size_t i = 0; i < jobs; i++)
            if (job[i].method == stability_method + m && job[i].which->expectation != MUST_REFUSE)
                of[job[i].row.verdict]++;
        print(out, "%-32s", stability_method[m].name);
        for (size_t v = 0; v < ROW_VERDICTS; v++)
            print(out, " %12zu", of[v]);
        print(out, "\n");
    }
    print(out, "%-32s", "in all, with the refusals");
    for (size_t v = 0; v < ROW_VERDICTS; v++)
        print(out, " %12zu", count[v]);
    print(out, "\n%zu cases, %zu rows, %zu of them run twice (=), %zu violations\n", cases, jobs, twice,
          count[ROW_VIOLATION]);
}
