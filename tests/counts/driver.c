/* driver.c - drapes one small square, for tests/counts/counts.sh to count what that costs.
 *
 * usage: driver SCENE METHOD CELLS ITERATIONS
 * (at-once, certify and fit: auto with a tolerance that the first iteration meets, the second with a
 * certificate, the third with the measures of its fit) Linked to the whole library, and to libraries whose
 * unneeded parts are stubs that abort: drape_it must cost the same. Prints what it asked of the allocator,
 * and the terms of the plan. */
#include <errno.h>
#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drape.h"

/* ---- the allocator, counted ----------------------------------------------------------------------
 *
 * It takes the place of the C library's, whose addresses depend on where the program ends: memset and memcpy
 * take more instructions on some alignments than on others. Nothing is used twice. */

#define LINE ((size_t)64)

static _Alignas(4096) unsigned char arena[(size_t)1 << 28];
static size_t used;
static size_t asked, asked_bytes;     /* allocations, and their sizes */
static size_t held_bytes, peak_bytes; /* not yet freed, and the most there were */

static size_t *size_of(void *p)
{
    return (size_t *)(void *)((unsigned char *)p - LINE);
}

void *memalign(size_t alignment, size_t size)
{
    size_t multiple = alignment > LINE ? alignment : LINE;
    size_t at = (used + LINE + multiple - 1) / multiple * multiple;
    if (size > sizeof arena - at)
        return NULL;
    used = at + (size + LINE - 1) / LINE * LINE;
    *size_of(arena + at) = size;
    asked++;
    asked_bytes += size;
    held_bytes += size;
    if (held_bytes > peak_bytes)
        peak_bytes = held_bytes;
    return arena + at;
}

void *malloc(size_t size)
{
    return memalign(LINE, size);
}

void *calloc(size_t count, size_t size)
{
    return memalign(LINE, count * size); /* never used before: zero */
}

void free(void *p)
{
    if (p)
        held_bytes -= *size_of(p);
}

void *realloc(void *old, size_t size)
{
    void *fresh = memalign(LINE, size);
    if (old && fresh)
        memcpy(fresh, old, *size_of(old) < size ? *size_of(old) : size);
    if (fresh)
        free(old);
    return fresh;
}

void *aligned_alloc(size_t alignment, size_t size)
{
    return memalign(alignment, size);
}

int posix_memalign(void **ret, size_t alignment, size_t size)
{
    *ret = memalign(alignment, size);
    return *ret ? 0 : ENOMEM;
}

/* ---- the scene ----------------------------------------------------------------------------------- */

struct square {
    double *x, *pattern;
    uint32_t *triangle, *pin;
    drape_material material;
    drape_body body;
    drape_scene_desc desc;
};

static void *need(size_t count, size_t size)
{
    void *p = calloc(count, size);
    if (!p)
        exit(2);
    return p;
}

/* Flat, horizontal, 0.5 m, 10 N/m, held by one edge: the square of [VMT07]. */
static void make(struct square *q, uint32_t cells)
{
    uint32_t side = cells + 1;
    q->x = need(3 * (size_t)side * side, sizeof *q->x);
    q->pattern = need(2 * (size_t)side * side, sizeof *q->pattern);
    q->triangle = need(6 * (size_t)cells * cells, sizeof *q->triangle);
    q->pin = need(side, sizeof *q->pin);
    for (uint32_t i = 0; i < side * side; i++) {
        q->x[3 * i] = q->pattern[2 * i] = 0.5 * (i % side) / cells;
        q->x[3 * i + 2] = q->pattern[2 * i + 1] = 0.5 * (i / side) / cells;
    }
    uint32_t *t = q->triangle;
    for (uint32_t j = 0; j < cells; j++)
        for (uint32_t i = 0; i < cells; i++, t += 6) {
            uint32_t a = j * side + i, b = a + side;
            memcpy(t, (uint32_t[]){a, b, a + 1, a + 1, b, b + 1}, 6 * sizeof *t);
        }
    for (uint32_t i = 0; i < side; i++)
        q->pin[i] = i;
    q->material = (drape_material){.density = 0.1,
                                   .stretch_weft = 10,
                                   .stretch_warp = 10,
                                   .stretch_shear = 5,
                                   .bend_weft = 1e-5,
                                   .bend_warp = 1e-5,
                                   .bend_twist = 5e-6};
    q->desc = drape_scene_desc_default();
    q->desc.vertices = (size_t)side * side;
    q->desc.triangles = 2 * (size_t)cells * cells;
    q->desc.pins = side;
    q->desc.materials = 1;
    q->desc.positions = q->x;
    q->desc.pattern = q->pattern;
    q->desc.triangle = q->triangle;
    q->desc.pin = q->pin;
    q->desc.material = &q->material;
}

/* Adds one thing to the plain scene, or takes one away. */
static void vary(struct square *q, const char *scene)
{
    static const double line[] = {0.1, 1};
    if (!strcmp(scene, "curve")) {
        q->material.curve_warp = (drape_curve){1, line}; /* the same 10 N/m */
    } else if (!strcmp(scene, "sphere")) {
        q->body = (drape_body){.kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {9, 9, 9}, .radius = 0.1};
        q->desc.body = &q->body;
        q->desc.bodies = 1;
    } else if (!strcmp(scene, "limp")) {
        q->material.bend_weft = q->material.bend_warp = q->material.bend_twist = 0;
    } else if (strcmp(scene, "plain") != 0) {
        exit(2);
    }
}

static drape_options options_of(const char *method, uint32_t iterations)
{
    drape_options options = drape_options_default();
    options.max_iterations = iterations;
    options.tolerance = 1e-300;
    if (!strcmp(method, "certify"))
        options.certify = true;
    if (!strcmp(method, "fit"))
        options.fit = true;
    if (options.certify || options.fit || !strcmp(method, "at-once"))
        options.tolerance = 1e300; /* at rest after one iteration */
    if (!strcmp(method, "auto") || options.tolerance > 1)
        return options;
    options.method = DRAPE_METHOD_STOP_AND_GO;
    if (!strcmp(method, "rk4")) {
        options.integrator = DRAPE_RK4;
        options.time_step = 1e-4;
    } else if (strcmp(method, "backward-euler") != 0) {
        exit(2);
    }
    return options;
}

/* As the daemon does between two lines of its stream. */
static int note_progress(const drape_progress *progress, void *data)
{
    memcpy(data, progress, sizeof *progress);
    return 0;
}

/* ---- what is counted ----------------------------------------------------------------------------- */

/* Everything a caller does, from description to freed result, but for reading the report into *ret. */
__attribute__((noinline)) drape_status drape_it(const drape_scene_desc *desc, const drape_options *options,
                                                drape_report *ret);
drape_status drape_it(const drape_scene_desc *desc, const drape_options *options, drape_report *ret)
{
    drape_scene *scene = NULL;
    drape_sim *sim = NULL;
    drape_status status = drape_scene_new(desc, &scene, NULL);
    if (status >= 0)
        status = drape_sim_new(scene, options, &sim, NULL);
    if (status >= 0)
        status = drape_sim_run(sim, NULL);
    if (status >= 0)
        *ret = *drape_sim_report(sim);
    drape_sim_free(sim);
    drape_scene_free(scene);
    return status;
}

int main(int argc, char **argv)
{
    struct square q = {0};
    drape_report report;
    if (argc != 5)
        return 2;
    drape_blas_prepare();
    make(&q, (uint32_t)atoi(argv[3]));
    vary(&q, argv[1]);
    drape_options options = options_of(argv[2], (uint32_t)atoi(argv[4]));
    drape_progress last;
    options.progress = note_progress;
    options.progress_data = &last;
    size_t before = held_bytes;
    used = (used + 4095) / 4096 * 4096;
    asked = asked_bytes = 0;
    peak_bytes = held_bytes;
    if (drape_it(&q.desc, &options, &report) < 0 || report.iterations != options.max_iterations)
        return 1;
    size_t calls = asked, bytes = asked_bytes, peak = peak_bytes - before;
    printf("allocations %zu\nallocated %zu\nheld %zu\npeak %zu\n", calls, bytes, peak, report.peak_bytes);
    for (size_t i = 0; i < report.terms; i++)
        printf("term %s %zu\n", report.term[i].name, report.term[i].bytes);
    free(q.x);
    free(q.pattern);
    free(q.triangle);
    free(q.pin);
    return 0;
}
