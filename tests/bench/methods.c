/* methods.c - `make bench-methods`: every method on 22 scenes without bodies, counted in factorisations.
 *
 * Squares of 0.5 m hung by one edge (flat, shaken by 5 mm, folded over themselves), panels held along a
 * half-circle, half-annulus skirts held along the inner arc (draped at 1e-3 N m first): 10 to 10 000 N/m,
 * bending 1e-5 and 1e-7 N m. Cost a/b/c: factorisations, failed ones included, until (E - E*)/(E0 - E*)
 * stays below 1e-3, 1e-6 and 1e-9; E* is the run's own minimum when it came to rest, else the lowest that
 * any method found; "-" was not reached. "+x": it rests higher than the lowest by the relative energy x.
 * The sum takes `MOST` for "-". Prints a Markdown table. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drape.h"

#define CELLS     30  /* along a side; twice that along an arc */
#define MOST      300 /* iterations of a run */
#define TOLERANCE 1e-6

enum shape { SQUARE, SHAKEN, FOLDED, ARC, SKIRT };

static const struct scene {
    const char *name;
    enum shape shape;
    double stretch; /* N/m */
} scenes[] = {
    {"square", SQUARE, 10},  {"square", SQUARE, 1000}, {"square", SQUARE, 10000}, {"skirt", SKIRT, 10},
    {"skirt", SKIRT, 500},   {"arc", ARC, 10},         {"arc", ARC, 1000},        {"noise", SHAKEN, 10},
    {"noise", SHAKEN, 1000}, {"fold", FOLDED, 10},     {"fold", FOLDED, 1000},
};
#define SCENES (sizeof scenes / sizeof *scenes)

static const struct way {
    const char *name;
    drape_method method;
    drape_stop_rule stop_on;
    drape_integrator integrator;
    bool line_search;
} ways[] = {
    {"auto", DRAPE_METHOD_AUTO, 0, 0, false},
    {"stop-and-go, kinetic", DRAPE_METHOD_STOP_AND_GO, DRAPE_STOP_ON_KINETIC, 0, false},
    {"stop-and-go, potential", DRAPE_METHOD_STOP_AND_GO, DRAPE_STOP_ON_POTENTIAL, 0, false},
    {"dynamic", DRAPE_METHOD_DYNAMIC, 0, 0, false},
    {"newton, line search", DRAPE_METHOD_NEWTON, 0, 0, true},
};
#define WAYS (sizeof ways / sizeof *ways)

struct cloth {
    size_t vertices, triangles, pins;
    double *x, *pattern;
    uint32_t *triangle, *pin;
};

struct outcome {
    size_t rows;
    double *energy; /* by iteration */
    double per_row; /* factorisations an iteration, on average */
    double last;
    bool rest;
};

static void *need(void *p)
{
    if (!p) {
        fputs("out of memory\n", stderr);
        exit(1);
    }
    return p;
}

/* Where grid point (s, r) in [0,1]^2 lies in the pattern; r = 0 is held. */
static void place(enum shape shape, double s, double r, double *uv)
{
    double angle = M_PI * (1 - s);
    if (shape == SKIRT) {
        uv[0] = (0.15 + 0.3 * r) * cos(angle);
        uv[1] = (0.15 + 0.3 * r) * sin(angle);
    } else if (shape == ARC) { /* from the half-circle down to a straight hem */
        uv[0] = (1 - r) * 0.25 * cos(angle) + r * (0.5 * s - 0.25);
        uv[1] = (1 - r) * 0.25 * sin(angle) - r * 0.25;
    } else {
        uv[0] = 0.5 * s;
        uv[1] = -0.5 * r;
    }
}

static double noise(uint64_t *state) /* [-1, 1) */
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-52 - 1;
}

static struct cloth cloth_new(enum shape shape)
{
    size_t nu = shape == SKIRT ? 2 * CELLS : CELLS, nv = CELLS;
    struct cloth c = {.vertices = (nu + 1) * (nv + 1), .triangles = 2 * nu * nv, .pins = nu + 1};
    uint64_t seed = 12345;
    c.x = need(calloc(3 * c.vertices, sizeof *c.x));
    c.pattern = need(calloc(2 * c.vertices, sizeof *c.pattern));
    c.triangle = need(calloc(3 * c.triangles, sizeof *c.triangle));
    c.pin = need(calloc(c.pins, sizeof *c.pin));
    for (size_t j = 0; j <= nv; j++)
        for (size_t i = 0; i <= nu; i++) {
            size_t v = j * (nu + 1) + i;
            double r = (double)j / (double)nv, *x = c.x + 3 * v, *uv = c.pattern + 2 * v;
            place(shape, (double)i / (double)nu, r, uv);
            x[0] = uv[0];
            x[2] = -uv[1];
            if (shape == FOLDED && r > 0.5) {
                x[1] = 0.002;
                x[2] = 0.5 * (1 - r);
            }
            for (int d = 0; shape == SHAKEN && j && d < 3; d++)
                x[d] += 0.005 * noise(&seed);
            if (!j)
                c.pin[i] = (uint32_t)v;
        }
    uint32_t *t = c.triangle;
    for (uint32_t j = 0; j < nv; j++)
        for (uint32_t i = 0; i < nu; i++, t += 6) {
            uint32_t a = j * (uint32_t)(nu + 1) + i, b = a + 1, d = a + (uint32_t)nu + 1, e = d + 1;
            const uint32_t one[] = {a, b, e, a, e, d}, other[] = {a, b, d, b, e, d};
            memcpy(t, (i + j) % 2 ? one : other, sizeof one);
        }
    return c;
}

static void cloth_done(struct cloth *c)
{
    free(c->x);
    free(c->pattern);
    free(c->triangle);
    free(c->pin);
}

static drape_sim *run(const struct cloth *c, double stretch, double bend, const drape_options *options,
                      drape_scene **ret_scene)
{
    const drape_material material = {.density = 0.1,
                                     .stretch_weft = stretch,
                                     .stretch_warp = stretch,
                                     .stretch_shear = stretch / 2,
                                     .bend_weft = bend,
                                     .bend_warp = bend,
                                     .bend_twist = bend / 2};
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = c->vertices;
    desc.triangles = c->triangles;
    desc.pins = c->pins;
    desc.materials = 1;
    desc.positions = c->x;
    desc.pattern = c->pattern;
    desc.triangle = c->triangle;
    desc.pin = c->pin;
    desc.material = &material;
    drape_error error;
    drape_sim *sim = NULL;
    drape_status status = drape_scene_new(&desc, ret_scene, &error);
    if (status >= 0)
        status = drape_sim_new(*ret_scene, options, &sim, &error);
    if (status >= 0)
        status = drape_sim_run(sim, &error);
    if (status < 0) {
        fprintf(stderr, "%s: %s\n", drape_status_name(status), error.message);
        exit(1);
    }
    return sim;
}

static struct outcome measure(const struct cloth *c, double stretch, double bend, const struct way *way)
{
    drape_options options = drape_options_default();
    options.method = way->method;
    options.stop_on = way->stop_on;
    options.integrator = way->integrator;
    options.line_search = way->line_search;
    options.tolerance = TOLERANCE;
    options.max_iterations = MOST;
    drape_scene *scene = NULL;
    drape_sim *sim = run(c, stretch, bend, &options, &scene);
    const drape_report *report = drape_sim_report(sim);
    struct outcome o = {.rest = report->verdict == DRAPE_VERDICT_AT_REST,
                        .last = report->state.energy.potential};
    const drape_row *row = drape_sim_trace(sim, &o.rows);
    o.energy = need(malloc(o.rows * sizeof *o.energy));
    for (size_t i = 0; i < o.rows; i++)
        o.energy[i] = row[i].energy.potential;
    o.per_row = (double)report->factorizations / (double)o.rows;
    drape_sim_free(sim);
    drape_scene_free(scene);
    return o;
}

/* Factorisations until the distance to E* stays below `share` of the first; -1: never. */
static long cost(const struct outcome *o, double least, double share)
{
    size_t i = o->rows;
    while (i > 0 && o->energy[i - 1] - least <= share * (o->energy[0] - least))
        i--;
    return i == o->rows ? -1 : lround((double)i * o->per_row);
}

static void print_cost(long value)
{
    if (value < 0)
        printf("-");
    else
        printf("%ld", value);
}

int main(void)
{
    static const double share[3] = {1e-3, 1e-6, 1e-9};
    long sum[WAYS][3] = {{0}};
    drape_blas_prepare();
    printf("| scene, N/m, N m |");
    for (size_t w = 0; w < WAYS; w++)
        printf(" %s |", ways[w].name);
    printf("\n|---|");
    for (size_t w = 0; w < WAYS; w++)
        printf("---|");
    printf("\n");
    for (int limp = 0; limp < 2; limp++)
        for (size_t s = 0; s < SCENES; s++) {
            double bend = limp ? 1e-7 : 1e-5, lowest = INFINITY;
            struct outcome o[WAYS];
            struct cloth c = cloth_new(scenes[s].shape);
            if (scenes[s].shape == SKIRT) {
                drape_options options = drape_options_default();
                options.tolerance = TOLERANCE;
                drape_scene *scene = NULL;
                drape_sim *sim = run(&c, scenes[s].stretch, 1e-3, &options, &scene);
                size_t vertices;
                memcpy(c.x, drape_sim_positions(sim, &vertices), 3 * c.vertices * sizeof *c.x);
                drape_sim_free(sim);
                drape_scene_free(scene);
            }
            for (size_t w = 0; w < WAYS; w++) {
                o[w] = measure(&c, scenes[s].stretch, bend, &ways[w]);
                lowest = fmin(lowest, o[w].last);
            }
            printf("| %s %g %g |", scenes[s].name, scenes[s].stretch, bend);
            for (size_t w = 0; w < WAYS; w++) {
                double least = o[w].rest ? o[w].last : lowest;
                for (int k = 0; k < 3; k++) {
                    long value = cost(&o[w], least, share[k]);
                    printf(k ? "/" : " ");
                    print_cost(value);
                    sum[w][k] += value < 0 ? MOST : value;
                }
                double above = (least - lowest) / fabs(lowest);
                if (above > 1e-5)
                    printf(" +%.0e", above);
                printf(" |");
                free(o[w].energy);
            }
            printf("\n");
            fflush(stdout);
            cloth_done(&c);
        }
    printf("| sum |");
    for (size_t w = 0; w < WAYS; w++)
        printf(" %ld/%ld/%ld |", sum[w][0], sum[w][1], sum[w][2]);
    printf("\n");
    return 0;
}
