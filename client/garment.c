/* garment.c - drafts the dress's two panels, meshes them, and hangs them round the form to be sewn.
 *
 *              N___               ___N          N  neck point      S  shoulder tip
 *          S--'    \_           _/    '--S      U  underarm        H  hem corner
 *           \        `---------'        /
 *            |        neckline         |        Front and back differ in the neckline only, so
 *          U-'                         '-U      their side seams (U-H) and shoulder seams (N-S)
 *          /                             \      have the same length and the same points.
 *         /                               \
 *        H-.___                       ___.-H    v grows upwards (warp), u to the wearer's left
 *              `----------hem--------'          on the front panel, to the right on the back.
 *
 * Without friction a dress stays up only if its neckline is too narrow to slip over the shoulders
 * and its weight hangs low: both shoulders then push it towards the neck. */
#include "garment.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mannequin.h"
#include "mesher.h"

/* The half pattern, in metres; v is the height at which a point starts. Bust girth 0.90 m of the form
 * plus 0.06 m of ease; hem of 1.8 m against hips of 0.93 m, so that it falls in folds. The shoulder line
 * starts 0.04 m above the form's: the way over the bust is that much longer than straight down. */
#define NECK_U          0.078
#define NECK_V          1.447
#define SHOULDER_U      0.158
#define SHOULDER_V      1.408
#define UNDERARM_U      0.240
#define UNDERARM_V      1.245
#define HEM_U           0.440
#define HEM_V           0.630
#define HEM_DROP        0.082 /* the hem's middle hangs this much lower (x 3/4): square to the sides */
#define NECK_DROP_FRONT 0.120 /* likewise (x 3/4) */
#define NECK_DROP_BACK  0.040

/* Where the flat panels start: rolled round an elliptic cone with this ratio of depth to width, its
 * axis this far forward, leaving this much of each half open at the sides. */
#define CONE_DEPTH   0.70
#define CONE_FORWARD 0.012
#define CONE_GAP     0.030

enum edge {
    HEM = 0,
    SIDE_RIGHT,
    ARMHOLE_RIGHT,
    SHOULDER_RIGHT,
    NECKLINE,
    SHOULDER_LEFT,
    ARMHOLE_LEFT,
    SIDE_LEFT,
    EDGES
};

enum { CURVE_SAMPLES = 256 };

struct curve {
    double u[4], v[4];
}; /* cubic Bezier */

struct panel {
    struct curve edge[EDGES]; /* counter-clockwise, from the left hem corner; "right" is u > 0 */
    double *outline;          /* 2*points */
    size_t first[EDGES + 1];  /* outline point where each edge starts; the last: points */
    size_t base;              /* its first vertex in the cloth */
};

static void curve_point(const struct curve *c, double t, double *u, double *v)
{
    double s = 1 - t;
    const double w[4] = {s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t};
    *u = w[0] * c->u[0] + w[1] * c->u[1] + w[2] * c->u[2] + w[3] * c->u[3];
    *v = w[0] * c->v[0] + w[1] * c->v[1] + w[2] * c->v[2] + w[3] * c->v[3];
}

static double curve_lengths(const struct curve *c, double length[CURVE_SAMPLES + 1])
{
    double u0 = c->u[0], v0 = c->v[0];
    length[0] = 0;
    for (int i = 1; i <= CURVE_SAMPLES; i++) {
        double u, v;
        curve_point(c, (double)i / CURVE_SAMPLES, &u, &v);
        length[i] = length[i - 1] + hypot(u - u0, v - v0);
        u0 = u;
        v0 = v;
    }
    return length[CURVE_SAMPLES];
}

/* `parts` points at equal distances along the curve, its end left to the next edge. */
static void curve_sample(const struct curve *c, size_t parts, double *uv)
{
    double length[CURVE_SAMPLES + 1], whole = curve_lengths(c, length);
    for (size_t i = 0, k = 0; i < parts; i++) {
        double target = whole * (double)i / (double)parts;
        while (length[k + 1] < target) {
            k++;
        }
        double part = (target - length[k]) / (length[k + 1] - length[k]);
        curve_point(c, ((double)k + part) / CURVE_SAMPLES, &uv[2 * i], &uv[2 * i + 1]);
    }
}

static struct curve straight(double u0, double v0, double u1, double v1)
{
    return (struct curve){{u0, (2 * u0 + u1) / 3, (u0 + 2 * u1) / 3, u1},
                          {v0, (2 * v0 + v1) / 3, (v0 + 2 * v1) / 3, v1}};
}

/* The same curve on the other half, run the other way. */
static struct curve mirrored(const struct curve *c)
{
    return (struct curve){{-c->u[3], -c->u[2], -c->u[1], -c->u[0]}, {c->v[3], c->v[2], c->v[1], c->v[0]}};
}

static void draft_panel(double neck_drop, struct panel *panel)
{
    struct curve *edge = panel->edge;
    edge[HEM] = (struct curve){{-HEM_U, -0.4 * HEM_U, 0.4 * HEM_U, HEM_U},
                               {HEM_V, HEM_V - HEM_DROP, HEM_V - HEM_DROP, HEM_V}};
    edge[SIDE_RIGHT] = straight(HEM_U, HEM_V, UNDERARM_U, UNDERARM_V);
    edge[ARMHOLE_RIGHT] = (struct curve){{UNDERARM_U, UNDERARM_U - 0.075, SHOULDER_U - 0.012, SHOULDER_U},
                                         {UNDERARM_V, UNDERARM_V + 0.004, SHOULDER_V - 0.085, SHOULDER_V}};
    edge[SHOULDER_RIGHT] = straight(SHOULDER_U, SHOULDER_V, NECK_U, NECK_V);
    edge[NECKLINE] = (struct curve){{NECK_U, NECK_U - 0.012, -NECK_U + 0.012, -NECK_U},
                                    {NECK_V, NECK_V - neck_drop, NECK_V - neck_drop, NECK_V}};
    edge[SHOULDER_LEFT] = mirrored(&edge[SHOULDER_RIGHT]);
    edge[ARMHOLE_LEFT] = mirrored(&edge[ARMHOLE_RIGHT]);
    edge[SIDE_LEFT] = mirrored(&edge[SIDE_RIGHT]);
}

/* Samples the outline `spacing` apart; 0 or -1 (memory). */
static int sample_panel(struct panel *panel, double spacing)
{
    double unused[CURVE_SAMPLES + 1];
    panel->first[0] = 0;
    for (int e = 0; e < EDGES; e++) {
        double parts = fmax(2, round(curve_lengths(&panel->edge[e], unused) / spacing));
        panel->first[e + 1] = panel->first[e] + (size_t)parts;
    }
    panel->outline = malloc(2 * panel->first[EDGES] * sizeof *panel->outline);
    if (!panel->outline) {
        return -1;
    }
    for (int e = 0; e < EDGES; e++) {
        curve_sample(&panel->edge[e], panel->first[e + 1] - panel->first[e],
                     panel->outline + 2 * panel->first[e]);
    }
    return 0;
}

/* Angle at which the ellipse (cos, CONE_DEPTH sin), from its front towards its side, has run the arc
 * length s; past the side it goes on. `table` holds the lengths of CURVE_SAMPLES equal angles to 90
 * degrees. */
static double ellipse_angle(const double *table, double s)
{
    size_t k = 0;
    while (k + 1 < CURVE_SAMPLES && table[k + 1] < s) {
        k++;
    }
    double part = (s - table[k]) / (table[k + 1] - table[k]);
    return M_PI / 2 * ((double)k + part) / CURVE_SAMPLES;
}

static void ellipse_lengths(double table[CURVE_SAMPLES + 1])
{
    table[0] = 0;
    for (int i = 1; i <= CURVE_SAMPLES; i++) {
        double a = M_PI / 2 * (i - 1) / CURVE_SAMPLES, b = M_PI / 2 * i / CURVE_SAMPLES;
        table[i] = table[i - 1] + hypot(sin(b) - sin(a), CONE_DEPTH * (cos(b) - cos(a)));
    }
}

/* Half the panel's width at height v (m), measured to the side seam; constant above the underarm. */
static double half_width(double v)
{
    double down = fmax(0, UNDERARM_V - v);
    return UNDERARM_U + (HEM_U - UNDERARM_U) * down / (UNDERARM_V - HEM_V);
}

/* Rolls a flat panel round the form: side +1 in front, -1 behind (turned about the vertical). */
static void place_panel(struct surface *panel, int side)
{
    double table[CURVE_SAMPLES + 1];
    ellipse_lengths(table);
    for (size_t i = 0; i < panel->vertices; i++) {
        double u = panel->pattern[2 * i], v = panel->pattern[2 * i + 1];
        double size = (half_width(v) + CONE_GAP) / table[CURVE_SAMPLES];
        double angle = ellipse_angle(table, fabs(u) / size);
        double *x = panel->positions + 3 * i;
        x[0] = side * copysign(size * sin(angle), u);
        x[1] = v;
        x[2] = CONE_FORWARD + side * size * CONE_DEPTH * cos(angle);
    }
}

/* Sews edge `a` of one panel to edge `b` of the other, which runs the other way. Ends included. */
static uint32_t *sew(uint32_t *out, const struct panel *front, enum edge a, const struct panel *back,
                     enum edge b)
{
    size_t parts = front->first[a + 1] - front->first[a];
    for (size_t i = 0; i <= parts; i++) {
        *out++ = (uint32_t)(front->base + (front->first[a] + i) % front->first[EDGES]);
        *out++ = (uint32_t)(back->base + (back->first[b] + parts - i) % back->first[EDGES]);
    }
    return out;
}

/* The back panel is worn turned round: its u > 0 half lies where the front's u < 0 half does. */
static int sew_panels(const struct panel *front, const struct panel *back, struct scene *scene)
{
    const enum edge pair[4][2] = {{SIDE_RIGHT, SIDE_LEFT},
                                  {SHOULDER_RIGHT, SHOULDER_LEFT},
                                  {SHOULDER_LEFT, SHOULDER_RIGHT},
                                  {SIDE_LEFT, SIDE_RIGHT}};
    size_t seams = 0;
    for (int k = 0; k < 4; k++) {
        seams += front->first[pair[k][0] + 1] - front->first[pair[k][0]] + 1;
    }
    uint32_t *out = malloc(2 * seams * sizeof *out);
    if (!out) {
        return -1;
    }
    scene->seam = out;
    scene->seams = seams;
    for (int k = 0; k < 4; k++) {
        out = sew(out, front, pair[k][0], back, pair[k][1]);
    }
    return 0;
}

static int add_panel(struct panel *panel, double spacing, int side, struct scene *scene,
                     struct failure *failure)
{
    struct surface mesh = {0};
    if (mesher_fill(panel->outline, panel->first[EDGES], spacing, &mesh, failure) < 0) {
        return -1;
    }
    place_panel(&mesh, side);
    panel->base = scene->cloth.vertices;
    int status = surface_append(&scene->cloth, &mesh);
    surface_done(&mesh);
    return status < 0 ? failure_no_memory(failure) : 0;
}

static int add_mannequin(struct scene *scene, struct failure *failure)
{
    scene->body = calloc(1, sizeof *scene->body);
    if (!scene->body || mannequin_build(MANNEQUIN_SPACING, scene->body) < 0) {
        return failure_no_memory(failure);
    }
    scene->bodies = 1;
    return 0;
}

int garment_build(size_t triangles, struct scene *scene, struct failure *failure)
{
    int status = -1;
    struct panel front = {0}, back = {0};
    if (triangles < GARMENT_MIN_TRIANGLES) {
        return failure_set(failure, EXIT_USAGE, "the garment needs at least %d triangles",
                           GARMENT_MIN_TRIANGLES);
    }
    draft_panel(NECK_DROP_FRONT, &front);
    draft_panel(NECK_DROP_BACK, &back);
    /* The true area needs an outline: measure a fine one, then sample again. */
    if (sample_panel(&front, 0.01) < 0 || sample_panel(&back, 0.01) < 0) {
        failure_no_memory(failure);
        goto cleanup;
    }
    double spacing = mesher_spacing(mesher_area(front.outline, front.first[EDGES]) +
                                        mesher_area(back.outline, back.first[EDGES]),
                                    triangles);
    free(front.outline);
    free(back.outline);
    front.outline = back.outline = NULL;
    if (sample_panel(&front, spacing) < 0 || sample_panel(&back, spacing) < 0) {
        failure_no_memory(failure);
        goto cleanup;
    }
    if (add_panel(&front, spacing, 1, scene, failure) < 0 ||
        add_panel(&back, spacing, -1, scene, failure) < 0 || add_mannequin(scene, failure) < 0) {
        goto cleanup;
    }
    if (sew_panels(&front, &back, scene) < 0) {
        failure_no_memory(failure);
        goto cleanup;
    }
    status = 0;
cleanup:
    free(front.outline);
    free(back.outline);
    return status;
}
