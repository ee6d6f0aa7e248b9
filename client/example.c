/* example.c - the square, the sheet held along an arc, the half-circle skirt, and the garment. */
#include "example.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "garment.h"
#include "mesher.h"

/* The cloth of [VMT07]: 0.1 kg/m^2, 10 N/m, dt 20 ms. Its bending is not given beyond "small"; an
 * isotropic plate of Poisson ratio 0 has half the bending rigidity in twist, half the stretch in shear. */
static const struct scene_material paper_cloth = {
    .density = 0.1,
    .weft = 10,
    .warp = 10,
    .shear = 5,
    .bend_weft = 1e-5,
    .bend_warp = 1e-5,
    .bend_twist = 0.5e-5,
};

#define SQUARE_SIDE 0.5  /* m */
#define ARC_RADIUS  0.25 /* m */
#define ARC_LENGTH  0.5  /* m, from the arc's ends to the free edge: our reading, as wide as long */
#define SKIRT_INNER 0.15 /* m */
#define SKIRT_OUTER 0.45 /* m */
/* All three start flat at this height. */
#define SHEET_HEIGHT 1.0 /* m */

/* Corner indices of the two triangles of one cell of a grid, diagonals alternating like the flag of
 * a chessboard, so that no direction is stiffer than its mirror image. */
static uint32_t *put_cell(uint32_t *out, size_t row, size_t column, size_t columns)
{
    uint32_t a = (uint32_t)(row * (columns + 1) + column), b = a + 1;
    uint32_t c = a + (uint32_t)columns + 1, d = c + 1;
    const uint32_t rising[6] = {a, b, d, a, d, c}, falling[6] = {a, b, c, b, d, c};
    memcpy(out, (row + column) % 2 ? falling : rising, sizeof rising);
    return out + 6;
}

/* rows x columns cells; positions and pattern are left to the caller. 0 or -1. */
static int new_grid(size_t rows, size_t columns, struct surface *ret)
{
    if (surface_new((rows + 1) * (columns + 1), 2 * rows * columns, true, ret) < 0) {
        return -1;
    }
    uint32_t *out = ret->triangle;
    for (size_t r = 0; r < rows; r++) {
        for (size_t c = 0; c < columns; c++) {
            out = put_cell(out, r, c, columns);
        }
    }
    return 0;
}

/* Holds vertices 0 .. count - 1; 0 or -1 (memory). */
static int pin_first(struct scene *scene, size_t count)
{
    scene->pin = malloc(count * sizeof *scene->pin);
    if (!scene->pin) {
        return -1;
    }
    for (size_t i = 0; i < count; i++) {
        scene->pin[i] = (uint32_t)i;
    }
    scene->pins = count;
    return 0;
}

/* Lays the pattern flat: u to the right (x), v away from the viewer (-z), so that normals point up. */
static void lay_flat(struct surface *cloth)
{
    for (size_t i = 0; i < cloth->vertices; i++) {
        cloth->positions[3 * i] = cloth->pattern[2 * i];
        cloth->positions[3 * i + 1] = SHEET_HEIGHT;
        cloth->positions[3 * i + 2] = -cloth->pattern[2 * i + 1];
    }
}

static void use_paper_settings(struct scene *scene)
{
    scene->material[0] = paper_cloth;
    scene->solver.method = "stop-and-go";
    scene->solver.stop_on = "potential";
    scene->solver.time_step = 0.02;
    scene->solver.tolerance = 1e-3;
    scene->solver.max_iterations = 2000;
}

static int build_square(size_t triangles, struct scene *scene, struct failure *failure)
{
    size_t n = (size_t)fmax(1, round(sqrt((double)triangles / 2)));
    if (new_grid(n, n, &scene->cloth) < 0 || pin_first(scene, n + 1) < 0) {
        return failure_no_memory(failure);
    }
    for (size_t i = 0; i < scene->cloth.vertices; i++) {
        scene->cloth.pattern[2 * i] = SQUARE_SIDE * (double)(i % (n + 1)) / (double)n;
        scene->cloth.pattern[2 * i + 1] = SQUARE_SIDE * (double)(i / (n + 1)) / (double)n;
    }
    lay_flat(&scene->cloth);
    use_paper_settings(scene);
    return 0;
}

/* The inner arc comes first and is held. Cells are as long as wide at the middle radius. */
static int build_skirt(size_t triangles, struct scene *scene, struct failure *failure)
{
    const double middle = M_PI * (SKIRT_INNER + SKIRT_OUTER) / 2, depth = SKIRT_OUTER - SKIRT_INNER;
    size_t rows = (size_t)fmax(1, round(sqrt((double)triangles / 2 * depth / middle)));
    size_t columns = (size_t)fmax(2, round((double)triangles / 2 / (double)rows));
    if (new_grid(rows, columns, &scene->cloth) < 0 || pin_first(scene, columns + 1) < 0) {
        return failure_no_memory(failure);
    }
    for (size_t i = 0; i < scene->cloth.vertices; i++) {
        double radius = SKIRT_INNER + depth * (double)(i / (columns + 1)) / (double)rows;
        double angle = M_PI * (double)(i % (columns + 1)) / (double)columns;
        scene->cloth.pattern[2 * i] = -radius * cos(angle);
        scene->cloth.pattern[2 * i + 1] = -radius * sin(angle);
    }
    /* from left to right along the front, rows going outwards: turned over, so that normals point up */
    for (size_t t = 0; t < scene->cloth.triangles; t++) {
        uint32_t *v = scene->cloth.triangle + 3 * t, swap = v[1];
        v[1] = v[2];
        v[2] = swap;
    }
    lay_flat(&scene->cloth);
    use_paper_settings(scene);
    return 0;
}

/* Outline of the panel under its half-circle, counter-clockwise: the arc from right to left, then
 * down the left side, along the free edge, and up the right side. Returns the points; those of the
 * arc, both ends included, come first. `outline`: room for all, or NULL to count. */
static size_t outline_arc(double spacing, double *outline, size_t *ret_arc)
{
    size_t around = (size_t)ceil(M_PI * ARC_RADIUS / spacing), along = (size_t)ceil(ARC_LENGTH / spacing);
    size_t across = (size_t)ceil(2 * ARC_RADIUS / spacing), n = 0;
    const double corner[4][2] = {
        {-ARC_RADIUS, 0}, {-ARC_RADIUS, -ARC_LENGTH}, {ARC_RADIUS, -ARC_LENGTH}, {ARC_RADIUS, 0}};
    const size_t parts[3] = {along, across, along};
    for (size_t i = 0; i <= around; i++, n++) {
        if (outline) {
            outline[2 * n] = ARC_RADIUS * cos(M_PI * (double)i / (double)around);
            outline[2 * n + 1] = ARC_RADIUS * sin(M_PI * (double)i / (double)around);
        }
    }
    for (int side = 0; side < 3; side++) {
        /* the last side ends one short of the arc's first point */
        for (size_t i = 1; i <= parts[side] - (side == 2); i++, n++) {
            double part = (double)i / (double)parts[side];
            for (int k = 0; outline && k < 2; k++) {
                outline[2 * n + (size_t)k] = (1 - part) * corner[side][k] + part * corner[side + 1][k];
            }
        }
    }
    *ret_arc = around + 1;
    return n;
}

static int build_arc(size_t triangles, struct scene *scene, struct failure *failure)
{
    const double area = M_PI * ARC_RADIUS * ARC_RADIUS / 2 + 2 * ARC_RADIUS * ARC_LENGTH;
    double spacing = mesher_spacing(area, triangles);
    size_t arc = 0, points = outline_arc(spacing, NULL, &arc);
    double *outline = malloc(2 * points * sizeof *outline);
    if (!outline) {
        return failure_no_memory(failure);
    }
    outline_arc(spacing, outline, &arc);
    int status = mesher_fill(outline, points, spacing, &scene->cloth, failure);
    free(outline);
    if (status < 0) {
        return -1;
    }
    if (pin_first(scene, arc) < 0) {
        return failure_no_memory(failure);
    }
    lay_flat(&scene->cloth);
    use_paper_settings(scene);
    return 0;
}

static int build_garment(size_t triangles, struct scene *scene, struct failure *failure)
{
    if (garment_build(triangles, scene, failure) < 0) {
        return -1;
    }
    /* A light woven dress fabric; numbers in the middle of measured ranges. */
    scene->material[0] = (struct scene_material){
        .density = 0.17,
        .weft = 300,
        .warp = 300,
        .shear = 75,
        .bend_weft = 1e-5,
        .bend_warp = 1e-5,
        .bend_twist = 0.5e-5,
    };
    scene->solver.method = "auto";
    scene->solver.time_step = 0.02;
    scene->solver.tolerance = 1e-2;
    scene->solver.max_iterations = 4000;
    scene->solver.time_limit = 600; /* half a minute of one processor; of one that is shared, minutes */
    return 0;
}

const struct example example_list[] = {
    {"square", "0.5 m square, level, held by one edge", 5000, 8, build_square},
    {"arc", "level panel held along its half-circular upper edge, radius 0.25 m", 5000, 200, build_arc},
    {"skirt", "half annulus of radii 0.15 and 0.45 m, level, held along the inner arc", 5000, 100,
     build_skirt},
    {"garment", "sleeveless dress of two sewn panels on a mannequin", 4000, GARMENT_MIN_TRIANGLES,
     build_garment},
    {0},
};

const struct example *example_find(const char *name)
{
    for (const struct example *e = example_list; e->name; e++) {
        if (strcmp(e->name, name) == 0) {
            return e;
        }
    }
    return NULL;
}

int example_build(const struct example *example, size_t triangles, struct scene *ret, struct failure *failure)
{
    size_t count = triangles > 0 ? triangles : example->default_triangles;
    if (count < example->min_triangles || count > EXAMPLE_MAX_TRIANGLES) {
        return failure_set(failure, EXIT_USAGE, "%s takes %zu to %d triangles, not %zu", example->name,
                           example->min_triangles, EXAMPLE_MAX_TRIANGLES, count);
    }
    struct scene scene = scene_default();
    scene.name = example->name;
    if (example->build(count, &scene, failure) < 0) {
        scene_done(&scene);
        return -1;
    }
    *ret = scene;
    return 0;
}
