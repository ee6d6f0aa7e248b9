/* cases.c - builds the scenes of the stability suite, and the table of them all. */
#include "cases.h"

#include "../physics/grids.h"

#define SIDE  0.4 /* m: the plain cloth is SIDE x SIDE */
#define CELLS 8   /* along a side */
#define PI    3.14159265358979323846

/* ---- the plain scene, which every case starts from ---------------------------------------------- */

static void *zeros(size_t count, size_t size)
{
    void *array = calloc(count ? count : 1, size);
    assert_non_null(array);
    return array;
}

static drape_material cloth(double density, double k, double B)
{
    return (drape_material){.density = density,
                            .stretch_weft = k,
                            .stretch_warp = k,
                            .stretch_shear = k / 2,
                            .bend_weft = B,
                            .bend_warp = B,
                            .bend_twist = B / 2};
}

/* Room for a mesh, one fabric, default options; nothing pinned. */
static void begin(struct scene *scene, size_t vertices, size_t triangles)
{
    memset(scene, 0, sizeof *scene);
    scene->x = zeros(3 * vertices, sizeof *scene->x);
    scene->uv = zeros(2 * vertices, sizeof *scene->uv);
    scene->triangle = zeros(3 * triangles, sizeof *scene->triangle);
    scene->triangle_material = zeros(triangles, sizeof *scene->triangle_material);
    scene->pin = zeros(vertices, sizeof *scene->pin);
    scene->seam = zeros(4 * vertices, sizeof *scene->seam);
    scene->material[0] = scene->material[1] = cloth(0.1, 50, 1e-5);
    scene->options = drape_options_default();
    scene->desc = drape_scene_desc_default();
    scene->desc.vertices = vertices;
    scene->desc.triangles = triangles;
    scene->desc.positions = scene->x;
    scene->desc.pattern = scene->uv;
    scene->desc.triangle = scene->triangle;
    scene->desc.pin = scene->pin;
    scene->desc.seam = scene->seam;
    scene->desc.material = scene->material;
    scene->desc.materials = 1;
    scene->desc.body = scene->body;
}

static void pin(struct scene *scene, size_t vertex)
{
    scene->pin[scene->desc.pins++] = (uint32_t)vertex;
}

static void sew(struct scene *scene, size_t a, size_t b)
{
    scene->seam[2 * scene->desc.seams] = (uint32_t)a;
    scene->seam[2 * scene->desc.seams++ + 1] = (uint32_t)b;
}

/* Copies the grid `copies` times, each an own panel, laid flat in y = 0: u along x, v along -z. */
static void panels(struct scene *scene, enum grid_kind kind, size_t nx, size_t ny, double width,
                   double height, size_t copies)
{
    struct grid grid = grid_new(kind, nx, ny, width, height, 0);
    begin(scene, copies * grid.vertices, copies * grid.triangles);
    scene->nx = nx;
    scene->ny = ny;
    for (size_t c = 0; c < copies; c++) {
        size_t first = c * grid.vertices;
        memcpy(scene->uv + 2 * first, grid.uv, 2 * grid.vertices * sizeof *grid.uv);
        for (size_t i = 0; i < 3 * grid.triangles; i++)
            scene->triangle[3 * c * grid.triangles + i] = (uint32_t)first + grid.triangle[i];
    }
    for (size_t i = 0; i < copies * grid.vertices; i++) {
        scene->x[3 * i] = scene->uv[2 * i];
        scene->x[3 * i + 2] = -scene->uv[2 * i + 1];
    }
    grid_done(&grid);
}

static size_t at(const struct scene *scene, size_t i, size_t j)
{
    return j * (scene->nx + 1) + i;
}

static void pin_left(struct scene *scene)
{
    for (size_t j = 0; j <= scene->ny; j++)
        pin(scene, at(scene, 0, j));
}

static void free_plain(struct scene *scene)
{
    panels(scene, GRID_DELAUNAY, CELLS, CELLS, SIDE, SIDE, 1);
}

/* Horizontal, held by its left side. */
static void plain(struct scene *scene)
{
    free_plain(scene);
    pin_left(scene);
}

static double *vertex(struct scene *scene, size_t i)
{
    return scene->x + 3 * i;
}

static void scale(struct scene *scene, double x, double y, double z)
{
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        vertex(scene, i)[0] *= x;
        vertex(scene, i)[1] *= y;
        vertex(scene, i)[2] *= z;
    }
}

static void shift(struct scene *scene, double x, double y, double z)
{
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        vertex(scene, i)[0] += x;
        vertex(scene, i)[1] += y;
        vertex(scene, i)[2] += z;
    }
}

static void fill_random(double *value, size_t count, double size)
{
    uint64_t seed = 4;
    for (size_t i = 0; i < count; i++)
        value[i] = size * test_random(&seed);
}

/* ---- material ----------------------------------------------------------------------------------- */

static void make_plain(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
}

/* Membrane to bending, k L^2/B. */
static void make_ratio(struct scene *scene, double ratio)
{
    plain(scene);
    scene->material[0] = cloth(0.1, 1000, ratio > 0 ? 1000 * SIDE * SIDE / ratio : 0);
}

static void make_density(struct scene *scene, double density)
{
    plain(scene);
    scene->material[0].density = density;
}

static void make_stretch(struct scene *scene, double k)
{
    plain(scene);
    scene->material[0] = cloth(0.1, k, 1e-5);
}

static void make_bend(struct scene *scene, double B)
{
    plain(scene);
    scene->material[0] = cloth(0.1, 50, B);
}

static void make_bend_weft_only(struct scene *scene, double B)
{
    make_bend(scene, 0);
    scene->material[0].bend_weft = B;
}

static void make_orthotropic(struct scene *scene, double ratio)
{
    plain(scene);
    scene->material[0].stretch_warp *= ratio;
    scene->material[0].bend_warp *= ratio;
}

static void make_shear(struct scene *scene, double ratio)
{
    plain(scene);
    scene->material[0].stretch_shear *= ratio;
}

static void make_poisson(struct scene *scene, double poisson)
{
    plain(scene);
    scene->material[0].poisson = poisson;
}

static void make_two_materials(struct scene *scene, double ratio)
{
    plain(scene);
    scene->desc.triangle_material = scene->triangle_material;
    scene->desc.materials = 2;
    scene->material[1] = cloth(0.1, 50 * ratio, 1e-5 * ratio);
    for (size_t t = 0; t < scene->desc.triangles; t++)
        scene->triangle_material[t] = scene->uv[2 * scene->triangle[3 * t]] > SIDE / 2;
}

static void make_two_densities(struct scene *scene, double ratio)
{
    make_two_materials(scene, 1);
    scene->material[1].density *= ratio;
}

/* Curves that stiffen `ratio` times at 5 % of strain. */
static void make_stiffening(struct scene *scene, double ratio)
{
    static const double start = 0.05;
    plain(scene);
    double *point = scene->curve;
    memcpy(point, (double[4]){start, 50 * start, 2 * start, 50 * start * (1 + ratio)}, 4 * sizeof *point);
    scene->material[0].curve_weft = scene->material[0].curve_warp = scene->material[0].curve_shear =
        (drape_curve){.points = 2, .point = point};
}

/* The same with a middle step on which the cloth yields without resisting. */
static void make_yielding(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    memcpy(scene->curve, (double[6]){0.01, 0.5, 0.5, 0.5, 0.6, 1}, 6 * sizeof *scene->curve);
    scene->material[0].curve_weft = scene->material[0].curve_warp =
        (drape_curve){.points = 3, .point = scene->curve};
}

/* A curve from rest through (0.1, 5) to (0.2, value). */
static void make_curve_to(struct scene *scene, double value)
{
    plain(scene);
    memcpy(scene->curve, (double[4]){0.1, 5, 0.2, value}, 4 * sizeof *scene->curve);
    scene->material[0].curve_weft = (drape_curve){.points = 2, .point = scene->curve};
}

static void make_curve_and_poisson(struct scene *scene, double poisson)
{
    make_curve_to(scene, 20);
    scene->material[0].poisson = poisson;
}

static void make_curve_stretched(struct scene *scene, double factor)
{
    make_stiffening(scene, 1e3);
    scale(scene, factor, factor, factor);
}

/* ---- time step ---------------------------------------------------------------------------------- */

static void make_step(struct scene *scene, double step)
{
    plain(scene);
    scene->options.time_step = step;
}

/* ---- mesh --------------------------------------------------------------------------------------- */

/* Every triangle 1:1000, in u or in v (value 0 or 1). */
static void make_slivers(struct scene *scene, double direction)
{
    bool v = direction > 0;
    panels(scene, GRID_DELAUNAY, CELLS, CELLS, v ? SIDE : SIDE / 1000, v ? SIDE / 1000 : SIDE, 1);
    pin_left(scene);
}

/* One column of cells 1:1000 amid good ones. */
static void make_sliver_column(struct scene *scene, double value)
{
    (void)value;
    panels(scene, GRID_ONE, CELLS, CELLS, SIDE, SIDE, 1);
    for (size_t j = 0; j <= scene->ny; j++) {
        size_t i = at(scene, 4, j);
        scene->uv[2 * i] = scene->uv[2 * (i - 1)] + SIDE / CELLS / 1000;
        vertex(scene, i)[0] = scene->uv[2 * i];
    }
    pin_left(scene);
}

/* A flap whose free corner lies a thousandth of its side above it: an angle of almost half a turn. */
static void make_cap(struct scene *scene, double value)
{
    static const double uv[8] = {0, 0, 1, 0, 0.5, 1e-3, 0.5, -1e-3};
    (void)value;
    begin(scene, 4, 2);
    memcpy(scene->uv, uv, sizeof uv);
    memcpy(scene->triangle, (uint32_t[6]){0, 1, 2, 1, 0, 3}, 6 * sizeof(uint32_t));
    for (size_t i = 0; i < 4; i++)
        memcpy(vertex(scene, i), uv + 2 * i, 2 * sizeof *uv);
    pin(scene, 0);
}

/* The first `count` corners pinned. */
static void make_one_triangle(struct scene *scene, double pins)
{
    begin(scene, 3, 1);
    memcpy(scene->uv, (double[6]){0, 0, 1, 0, 0, 1}, 6 * sizeof(double));
    memcpy(scene->triangle, (uint32_t[3]){0, 1, 2}, 3 * sizeof(uint32_t));
    for (size_t i = 0; i < 3; i++) {
        vertex(scene, i)[0] = scene->uv[2 * i];
        vertex(scene, i)[2] = -scene->uv[2 * i + 1];
        if ((double)i < pins)
            pin(scene, i);
    }
}

static void make_two_pieces(struct scene *scene, double pieces_held)
{
    panels(scene, GRID_DELAUNAY, CELLS, CELLS, SIDE, SIDE, 2);
    pin_left(scene);
    for (size_t i = 0; i < scene->desc.vertices / 2; i++)
        vertex(scene, scene->desc.vertices / 2 + i)[1] = 1;
    if (pieces_held > 1)
        pin(scene, scene->desc.vertices / 2);
}

/* Each triangle for itself, held by its first corner. */
static void soup(struct scene *scene)
{
    struct scene whole;
    free_plain(&whole);
    begin(scene, 3 * whole.desc.triangles, whole.desc.triangles);
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        memcpy(scene->x + 3 * i, whole.x + 3 * whole.triangle[i], 3 * sizeof *scene->x);
        memcpy(scene->uv + 2 * i, whole.uv + 2 * whole.triangle[i], 2 * sizeof *scene->uv);
        scene->triangle[i] = (uint32_t)i;
    }
    scene_done(&whole);
}

static void make_loose_triangles(struct scene *scene, double value)
{
    (void)value;
    soup(scene);
    for (size_t t = 0; t < scene->desc.triangles; t++)
        pin(scene, 3 * t);
}

/* Vertices of the same place in the pattern are sewn to the first of them. */
static void make_sewn_soup(struct scene *scene, double value)
{
    (void)value;
    soup(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        if (scene->uv[2 * i] == 0)
            pin(scene, i);
        for (size_t j = 0; j < i; j++)
            if (!memcmp(scene->uv + 2 * i, scene->uv + 2 * j, 2 * sizeof *scene->uv)) {
                sew(scene, j, i);
                break;
            }
    }
}

/* As many vertices again that no triangle uses. */
static void make_unused_vertices(struct scene *scene, double value)
{
    (void)value;
    panels(scene, GRID_DELAUNAY, CELLS, CELLS, SIDE, SIDE, 2);
    scene->desc.triangles /= 2;
    pin_left(scene);
    pin(scene, scene->desc.vertices - 1);
}

/* The pattern lies on its back: every triangle runs clockwise in it. */
static void make_mirrored_pattern(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++)
        scene->uv[2 * i] *= -1;
}

/* Every other triangle runs the other way round. */
static void make_mixed_winding(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    for (size_t t = 0; t < scene->desc.triangles; t += 2) {
        uint32_t *corner = scene->triangle + 3 * t, swap = corner[1];
        corner[1] = corner[2];
        corner[2] = swap;
    }
}

/* Two triangles that share one vertex and no edge, one of them held. */
static void make_bow_tie(struct scene *scene, double value)
{
    static const double uv[10] = {0, 0, 0, 1, 0.5, 0.5, 1, 0, 1, 1};
    (void)value;
    begin(scene, 5, 2);
    memcpy(scene->uv, uv, sizeof uv);
    memcpy(scene->triangle, (uint32_t[6]){0, 2, 1, 2, 3, 4}, 6 * sizeof(uint32_t));
    for (size_t i = 0; i < 5; i++) {
        vertex(scene, i)[0] = uv[2 * i];
        vertex(scene, i)[2] = -uv[2 * i + 1];
    }
    pin(scene, 0);
}

/* A disc of `count` triangles around one vertex, held at one point of its rim. */
static void make_fan(struct scene *scene, double count)
{
    size_t rim = (size_t)count;
    begin(scene, rim + 1, rim);
    for (size_t i = 0; i < rim; i++) {
        double angle = 2 * PI * (double)i / count;
        scene->uv[2 * i + 2] = 0.2 * cos(angle);
        scene->uv[2 * i + 3] = 0.2 * sin(angle);
        memcpy(scene->triangle + 3 * i, (uint32_t[3]){0, (uint32_t)i + 1, (uint32_t)((i + 1) % rim) + 1},
               3 * sizeof(uint32_t));
        vertex(scene, i + 1)[0] = scene->uv[2 * i + 2];
        vertex(scene, i + 1)[2] = -scene->uv[2 * i + 3];
    }
    pin(scene, 1);
}

/* The plain cloth at another size (m); its fabric stays as it is. */
static void make_size(struct scene *scene, double size)
{
    panels(scene, GRID_DELAUNAY, CELLS, CELLS, size, size, 1);
    pin_left(scene);
}

static void make_graded(struct scene *scene, double value)
{
    (void)value;
    panels(scene, GRID_GRADED, CELLS, CELLS, SIDE, SIDE, 1);
    pin_left(scene);
}

/* A ribbon of one cell by a hundred, held at one end. */
static void make_ribbon(struct scene *scene, double value)
{
    (void)value;
    panels(scene, GRID_ALTERNATING, 100, 1, 10 * SIDE, SIDE / 10, 1);
    pin_left(scene);
}

static void make_many(struct scene *scene, double cells)
{
    panels(scene, GRID_ALTERNATING, (size_t)cells, (size_t)cells, 0.5, 0.5, 1);
    pin_left(scene);
}

static void make_degenerate_rest(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++)
        scene->uv[2 * i] = 0;
}

static void make_repeated_corner(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    scene->triangle[1] = scene->triangle[0];
}

/* One triangle twice. */
static void make_three_at_an_edge(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    memcpy(scene->triangle, scene->triangle + 3 * 60, 3 * sizeof *scene->triangle);
}

static void make_bad_corner(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    scene->triangle[5] = (uint32_t)scene->desc.vertices;
}

/* ---- start -------------------------------------------------------------------------------------- */

static void make_scaled(struct scene *scene, double factor)
{
    plain(scene);
    scale(scene, factor, factor, factor);
}

static void make_on_a_line(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    scale(scene, 1, 0, 0);
}

static void make_in_one_point(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    scale(scene, 0, 0, 0);
}

static void make_mirrored(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    scale(scene, -1, 1, 1);
}

static void make_random(struct scene *scene, double size)
{
    plain(scene);
    fill_random(scene->x, 3 * scene->desc.vertices, size);
}

/* Flat, each vertex moved at random. */
static void make_noise(struct scene *scene, double size)
{
    plain(scene);
    uint64_t seed = 9;
    for (size_t i = 0; i < 3 * scene->desc.vertices; i++)
        scene->x[i] += size * test_random(&seed);
}

static void make_folded(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++)
        vertex(scene, i)[0] = fmin(vertex(scene, i)[0], SIDE - vertex(scene, i)[0]);
}

/* Every cell folded onto its neighbour. */
static void make_accordion(struct scene *scene, double value)
{
    (void)value;
    panels(scene, GRID_ONE, CELLS, CELLS, SIDE, SIDE, 1);
    for (size_t j = 0; j <= scene->ny; j++)
        for (size_t i = 0; i <= scene->nx; i++)
            vertex(scene, at(scene, i, j))[0] = i % 2 ? SIDE / CELLS : 0;
    pin_left(scene);
}

/* Exactly flat in a vertical plane, up (1) or down (-1) from the held edge: up is a saddle. */
static void make_upright(struct scene *scene, double up)
{
    plain(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        vertex(scene, i)[1] = up * vertex(scene, i)[0];
        vertex(scene, i)[0] = 0;
    }
}

/* Standing on its edge, sideways: the saddle of lateral buckling. */
static void make_on_edge(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        vertex(scene, i)[1] = vertex(scene, i)[2];
        vertex(scene, i)[2] = 0;
    }
}

static void make_collapsed_edge(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    memcpy(vertex(scene, at(scene, 5, 4)), vertex(scene, at(scene, 4, 4)), 3 * sizeof *scene->x);
}

static void make_collapsed_column(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    for (size_t j = 0; j <= scene->ny; j++)
        memcpy(vertex(scene, at(scene, 5, j)), vertex(scene, at(scene, 5, 0)), 3 * sizeof *scene->x);
}

static void make_one_far(struct scene *scene, double distance)
{
    plain(scene);
    vertex(scene, scene->desc.vertices - 1)[1] += distance;
}

/* The whole scene so far along each axis from the origin (m). */
static void make_far(struct scene *scene, double distance)
{
    plain(scene);
    shift(scene, distance, distance, distance);
}

static void make_twisted(struct scene *scene, double turns)
{
    plain(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        double *p = vertex(scene, i), r = p[2] + SIDE / 2;
        double angle = 2 * PI * turns * p[0] / SIDE;
        p[1] = r * sin(angle);
        p[2] = r * cos(angle);
    }
}

static void make_denormal_positions(struct scene *scene, double value)
{
    plain(scene);
    for (size_t i = 0; i < 3 * scene->desc.vertices; i++)
        if (scene->x[i] == 0)
            scene->x[i] = value;
}

static void make_denormal_pattern(struct scene *scene, double value)
{
    plain(scene);
    for (size_t i = 0; i < 2 * scene->desc.vertices; i++)
        if (scene->uv[i] == 0)
            scene->uv[i] = value;
}

static void make_all_pinned(struct scene *scene, double value)
{
    (void)value;
    free_plain(scene);
    for (size_t i = 0; i < scene->desc.vertices; i++)
        pin(scene, i);
}

/* Held by one corner. */
static void make_one_pin(struct scene *scene, double value)
{
    (void)value;
    free_plain(scene);
    pin(scene, 0);
}

/* The two held edges stand `factor` times as far apart as the cloth is wide. */
static void make_pulled_apart(struct scene *scene, double factor)
{
    plain(scene);
    for (size_t j = 0; j <= scene->ny; j++) {
        pin(scene, at(scene, scene->nx, j));
        vertex(scene, at(scene, scene->nx, j))[0] = factor * SIDE;
    }
}

/* ---- gravity ------------------------------------------------------------------------------------ */

static void make_gravity_down(struct scene *scene, double size)
{
    plain(scene);
    scene->desc.gravity[1] = -size;
}

static void make_gravity_along(struct scene *scene, double size)
{
    plain(scene);
    scene->desc.gravity[1] = 0;
    scene->desc.gravity[0] = size;
}

static void make_weightless_noise(struct scene *scene, double size)
{
    make_noise(scene, size);
    scene->desc.gravity[1] = 0;
}

/* ---- seams -------------------------------------------------------------------------------------- */

/* Two panels, one behind the other, sewn along the right side; the first hangs by its left side. */
static void make_open_seam(struct scene *scene, double gap)
{
    panels(scene, GRID_ALTERNATING, CELLS, CELLS, SIDE, SIDE, 2);
    size_t half = scene->desc.vertices / 2;
    for (size_t i = half; i < 2 * half; i++)
        vertex(scene, i)[1] += gap;
    for (size_t j = 0; j <= scene->ny; j++)
        sew(scene, at(scene, scene->nx, j), half + at(scene, scene->nx, j));
    pin_left(scene);
}

/* Left side to right side, by the end that lies opposite (1) or the other one, a Moebius strip (-1). */
static void make_loop(struct scene *scene, double sign)
{
    panels(scene, GRID_ALTERNATING, 4 * CELLS, CELLS, 4 * SIDE, SIDE, 1);
    for (size_t j = 0; j <= scene->ny; j++)
        sew(scene, at(scene, 0, j), at(scene, scene->nx, sign > 0 ? j : scene->ny - j));
    pin(scene, at(scene, 2 * CELLS, 0));
    pin(scene, at(scene, 2 * CELLS, scene->ny));
}

/* A seam between edges of which one is ten times as long. */
static void make_uneven_seam(struct scene *scene, double value)
{
    (void)value;
    make_open_seam(scene, 0.05);
    for (size_t i = scene->desc.vertices / 2; i < scene->desc.vertices; i++)
        scene->uv[2 * i + 1] *= 10;
}

static void make_seam_to_itself(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    sew(scene, 40, 40);
}

/* All of the right side into one point. */
static void make_gathered(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    for (size_t j = 2; j <= scene->ny; j += 2)
        sew(scene, at(scene, scene->nx, 0), at(scene, scene->nx, j));
}

static void make_pins_sewn_apart(struct scene *scene, double value)
{
    (void)value;
    make_open_seam(scene, 1);
    pin(scene, scene->seam[0]);
    pin(scene, scene->seam[1]);
}

/* Sewing the two ends of an edge together would leave a triangle with two corners. */
static void make_seam_across_an_edge(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    sew(scene, scene->triangle[0], scene->triangle[1]);
}

static void make_bad_seam(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    sew(scene, 1, scene->desc.vertices);
}

static void make_bad_pin(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    pin(scene, scene->desc.vertices);
}

/* ---- bodies ------------------------------------------------------------------------------------- */

static drape_body *add_body(struct scene *scene, drape_body_kind kind)
{
    drape_body *body = scene->body + scene->desc.bodies++;
    *body = (drape_body){.kind = kind, .offset = DRAPE_DEFAULT_OFFSET};
    return body;
}

static drape_body *add_sphere(struct scene *scene, double x, double y, double z, double radius)
{
    drape_body *body = add_body(scene, DRAPE_BODY_SPHERE);
    memcpy(body->point, (double[3]){x, y, z}, sizeof body->point);
    body->radius = radius;
    return body;
}

static drape_body *add_ground(struct scene *scene, double y)
{
    drape_body *body = add_body(scene, DRAPE_BODY_PLANE);
    body->point[1] = y;
    body->axis[1] = 1;
    return body;
}

/* The scene's one mesh body, with room for `vertices` and `triangles` and none of them yet. */
static drape_body *add_mesh(struct scene *scene, size_t vertices, size_t triangles)
{
    drape_body *body = add_body(scene, DRAPE_BODY_MESH);
    scene->body_position = zeros(3 * vertices, sizeof *scene->body_position);
    scene->body_triangle = zeros(3 * triangles, sizeof *scene->body_triangle);
    body->positions = scene->body_position;
    body->triangle = scene->body_triangle;
    return body;
}

/* Appends a closed box between low and high to that mesh. */
static void append_box(struct scene *scene, drape_body *body, const double low[3], const double high[3])
{
    static const uint32_t triangle[36] = {0, 2, 1, 1, 2, 3, 4, 5, 6, 5, 7, 6, 0, 1, 4, 1, 5, 4,
                                          2, 6, 3, 3, 6, 7, 0, 4, 2, 2, 4, 6, 1, 3, 5, 3, 7, 5};
    for (size_t i = 0; i < 36; i++)
        scene->body_triangle[3 * body->triangles + i] = (uint32_t)body->vertices + triangle[i];
    for (size_t i = 0; i < 8; i++)
        for (size_t d = 0; d < 3; d++)
            scene->body_position[3 * (body->vertices + i) + d] = (i >> d & 1 ? high : low)[d];
    body->vertices += 8;
    body->triangles += 12;
}

static drape_body *add_box(struct scene *scene, const double low[3], const double high[3])
{
    drape_body *body = add_mesh(scene, 8, 12);
    append_box(scene, body, low, high);
    return body;
}

/* From a square of `width` round `foot` up to a point `height` above. */
static drape_body *add_spike(struct scene *scene, const double foot[3], double width, double height)
{
    static const uint32_t triangle[18] = {0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4, 0, 2, 1, 0, 3, 2};
    static const double corner[5][3] = {{-1, 0, 1}, {1, 0, 1}, {1, 0, -1}, {-1, 0, -1}, {0, 1, 0}};
    drape_body *body = add_mesh(scene, 5, 6);
    memcpy(scene->body_triangle, triangle, sizeof triangle);
    for (size_t i = 0; i < 5; i++)
        for (size_t d = 0; d < 3; d++)
            scene->body_position[3 * i + d] = foot[d] + corner[i][d] * (d == 1 ? height : width / 2);
    body->vertices = 5;
    body->triangles = 6;
    return body;
}

static drape_body *add_capsule(struct scene *scene, const double from[3], const double to[3], double radius)
{
    drape_body *body = add_body(scene, DRAPE_BODY_CAPSULE);
    memcpy(body->point, from, sizeof body->point);
    memcpy(body->axis, to, sizeof body->axis);
    body->radius = radius;
    return body;
}

/* A sphere of that radius in the middle of the held cloth. */
static void make_inside_sphere(struct scene *scene, double radius)
{
    plain(scene);
    add_sphere(scene, 0.6 * SIDE, 0, -SIDE / 2, radius);
}

static void make_centre_on_vertex(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    const double *p = vertex(scene, 50);
    add_sphere(scene, p[0], p[1], p[2], 0.05);
}

static void make_inside_box(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    add_box(scene, (double[3]){0.15, -0.1, -0.3}, (double[3]){0.3, 0.1, -0.1});
}

static void make_free_inside_box(struct scene *scene, double value)
{
    (void)value;
    free_plain(scene);
    add_box(scene, (double[3]){-0.1, -0.2, -0.5}, (double[3]){0.5, 0.2, 0.1});
}

static void make_through_ground(struct scene *scene, double depth)
{
    free_plain(scene);
    add_ground(scene, depth);
}

/* Half below the ground, half above. */
static void make_across_ground(struct scene *scene, double value)
{
    (void)value;
    make_upright(scene, 1);
    scene->desc.pins = 0;
    add_ground(scene, SIDE / 2);
}

static void make_free_over_sphere(struct scene *scene, double radius)
{
    free_plain(scene);
    add_sphere(scene, SIDE / 2, -radius - 0.02, -SIDE / 2, radius);
}

static void make_beside_sphere(struct scene *scene, double value)
{
    (void)value;
    free_plain(scene);
    add_sphere(scene, 5, -1, 0, 0.1);
}

static void make_capsule(struct scene *scene, double length)
{
    free_plain(scene);
    add_capsule(scene, (double[3]){SIDE / 2 - length / 2, -0.12, -SIDE / 2},
                (double[3]){SIDE / 2 + length / 2, -0.12, -SIDE / 2}, 0.1);
}

static void make_overlapping_spheres(struct scene *scene, double value)
{
    (void)value;
    free_plain(scene);
    add_sphere(scene, SIDE / 2, -0.12, -SIDE / 2, 0.1);
    add_sphere(scene, SIDE / 2 + 0.05, -0.12, -SIDE / 2, 0.1);
}

static void make_weightless_on_sphere(struct scene *scene, double value)
{
    (void)value;
    make_free_over_sphere(scene, 0.1);
    scene->desc.gravity[1] = 0;
}

static void make_random_over_sphere(struct scene *scene, double size)
{
    make_free_over_sphere(scene, 0.1);
    fill_random(scene->x, 3 * scene->desc.vertices, size);
}

static void make_far_over_ground(struct scene *scene, double distance)
{
    free_plain(scene);
    add_ground(scene, distance - 0.05);
    scene->body[0].point[0] = scene->body[0].point[2] = distance;
    shift(scene, distance, distance, distance);
}

static void make_seam_through_sphere(struct scene *scene, double gap)
{
    make_open_seam(scene, gap);
    add_sphere(scene, SIDE, gap / 2, -SIDE / 2, gap / 4);
}

/* Two boxes in one mesh, one through the other, as the limbs of a scan are. */
static void make_over_crossing_boxes(struct scene *scene, double value)
{
    (void)value;
    free_plain(scene);
    drape_body *body = add_mesh(scene, 16, 24);
    append_box(scene, body, (double[3]){0.05, -0.2, -0.25}, (double[3]){0.35, -0.05, -0.15});
    append_box(scene, body, (double[3]){0.15, -0.2, -0.35}, (double[3]){0.25, -0.03, -0.05});
}

/* The two boxes about the middle of the cloth. */
static void make_inside_crossing_boxes(struct scene *scene, double value)
{
    make_over_crossing_boxes(scene, value);
    shift(scene, 0, -0.1, 0);
}

static void make_over_needle(struct scene *scene, double width)
{
    free_plain(scene);
    add_spike(scene, (double[3]){SIDE / 2 + 0.01, -0.32, -SIDE / 2 + 0.01}, width, 0.3);
}

static void make_over_wire(struct scene *scene, double radius)
{
    free_plain(scene);
    add_capsule(scene, (double[3]){SIDE / 2 + 0.01, -0.32, -SIDE / 2 + 0.01},
                (double[3]){SIDE / 2 + 0.01, -0.02, -SIDE / 2 + 0.01}, radius);
}

/* Falls with such gravity that it is `speed` fast when it arrives, 5 cm below. */
static void fall_at(struct scene *scene, double speed)
{
    scene->desc.gravity[1] = -speed * speed / (2 * 0.05);
    scene->options.time_step = 1e-3;
}

static void make_falling_on_sphere(struct scene *scene, double speed)
{
    free_plain(scene);
    add_sphere(scene, SIDE / 2, -0.15, -SIDE / 2, 0.1);
    fall_at(scene, speed);
}

/* On a plate thinner than what the cloth covers in one step. */
static void make_falling_on_plate(struct scene *scene, double speed)
{
    free_plain(scene);
    add_box(scene, (double[3]){0.1, -0.055, -0.3}, (double[3]){0.3, -0.05, -0.1});
    fall_at(scene, speed);
}

static void make_falling_from(struct scene *scene, double height)
{
    make_free_over_sphere(scene, 0.1);
    shift(scene, 0, height, 0);
}

static void make_rough_sphere(struct scene *scene, double friction)
{
    make_free_over_sphere(scene, 0.1);
    scene->body[0].friction = friction;
}

/* The held side runs through the body, up to `radius` deep. */
static void make_pins_in_sphere(struct scene *scene, double radius)
{
    plain(scene);
    add_sphere(scene, 0, 0, -SIDE / 2, radius);
}

static void make_pins_in_box(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    add_box(scene, (double[3]){-0.1, -0.1, -0.5}, (double[3]){0.1, 0.1, 0.1});
}

/* ---- garments: tubes round a body --------------------------------------------------------------- */

#define WAIST 0.1  /* m: radius of the body */
#define CLEAR 4e-3 /* m from it to the tube */

/* `copies` tubes sewn along one side, each CLEAR outside the last; their patterns are `ease` times as wide as
 * where they start. */
static void tubes(struct scene *scene, double ease, size_t copies)
{
    double width = 2 * PI * (WAIST + CLEAR);
    panels(scene, GRID_ALTERNATING, 3 * CELLS, CELLS, width, SIDE / 2, copies);
    size_t each = scene->desc.vertices / copies;
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        double r = WAIST + CLEAR * (double)(1 + i / each), *uv = scene->uv + 2 * i;
        size_t column = i % each % (scene->nx + 1) % scene->nx; /* the last lies on the first */
        double angle = 2 * PI * (double)column / (double)scene->nx;
        memcpy(vertex(scene, i), (double[3]){r * cos(angle), uv[1], -r * sin(angle)}, 3 * sizeof(double));
        uv[0] *= ease * r / (WAIST + CLEAR);
    }
    for (size_t c = 0; c < copies; c++)
        for (size_t j = 0; j <= scene->ny; j++)
            sew(scene, c * each + at(scene, 0, j), c * each + at(scene, scene->nx, j));
    add_capsule(scene, (double[3]){0, -SIDE / 2, 0}, (double[3]){0, SIDE / 2, 0}, WAIST)->friction = 0.3;
    scene->options.fit = true;
}

/* Too wide or too narrow a garment. */
static void make_garment(struct scene *scene, double ease)
{
    tubes(scene, ease, 1);
}

/* Held by two shoulders. */
static void make_hung_garment(struct scene *scene, double ease)
{
    tubes(scene, ease, 1);
    pin(scene, at(scene, 0, scene->ny));
    pin(scene, at(scene, scene->nx / 2, scene->ny));
}

/* One side of the garment starts `depth` inside the body. */
static void make_shoved_garment(struct scene *scene, double depth)
{
    tubes(scene, 1.1, 1);
    shift(scene, depth, 0, 0);
}

static void make_two_garments(struct scene *scene, double ease)
{
    tubes(scene, ease, 2);
}

/* ---- layers ------------------------------------------------------------------------------------- */

/* `copies` small sheets above one another at `gap` (m), the lowest as high above the ground. */
static void stack(struct scene *scene, size_t copies, double gap)
{
    panels(scene, GRID_ALTERNATING, CELLS / 2, CELLS / 2, SIDE / 4, SIDE / 4, copies);
    for (size_t i = 0; i < scene->desc.vertices; i++)
        vertex(scene, i)[1] = gap * (double)(i * copies / scene->desc.vertices);
    add_ground(scene, -DRAPE_DEFAULT_OFFSET);
}

static void make_stack(struct scene *scene, double copies)
{
    stack(scene, (size_t)copies, 1.25 * DRAPE_DEFAULT_THICKNESS);
}

/* Ten layers, squeezed or apart. */
static void make_stack_at(struct scene *scene, double gap)
{
    stack(scene, 10, gap);
}

static void make_thick_stack(struct scene *scene, double thickness)
{
    stack(scene, 10, 1.25 * DRAPE_DEFAULT_THICKNESS);
    scene->desc.thickness = thickness;
}

static void make_rough_stack(struct scene *scene, double friction)
{
    make_stack(scene, 10);
    scene->material[0].friction = friction;
}

static void make_rough_pile(struct scene *scene, double friction)
{
    make_stack(scene, 50);
    scene->material[0].friction = friction;
}

/* Five layers on a ground that leans by the tangent `slope`, friction 0.3 throughout. */
static void make_leaning_stack(struct scene *scene, double slope)
{
    make_stack(scene, 5);
    scene->material[0].friction = 0.3;
    scene->desc.gravity[0] = 9.81 * sin(atan(slope));
    scene->desc.gravity[1] = -9.81 * cos(atan(slope));
}

/* Another sheet arrives on the first, which is held all round. */
static void make_falling_on_sheet(struct scene *scene, double speed)
{
    panels(scene, GRID_DELAUNAY, CELLS, CELLS, SIDE, SIDE, 2);
    size_t half = scene->desc.vertices / 2;
    for (size_t j = 0; j <= scene->ny; j++)
        for (size_t i = 0; i <= scene->nx; i++)
            if (i == 0 || j == 0 || i == scene->nx || j == scene->ny)
                pin(scene, at(scene, i, j));
    for (size_t i = half; i < 2 * half; i++) { /* smaller, and not node above node */
        double *p = vertex(scene, i);
        p[0] = 0.013 + 0.9 * p[0];
        p[1] = 0.05;
        p[2] = -0.017 + 0.9 * p[2];
        scene->uv[2 * i] *= 0.9;
        scene->uv[2 * i + 1] *= 0.9;
    }
    add_ground(scene, -0.4);
    fall_at(scene, speed);
}

/* Two sheets, one through the middle of the other at that angle, over the ground. */
static void make_crossing_sheets(struct scene *scene, double angle)
{
    panels(scene, GRID_DELAUNAY, CELLS, CELLS, SIDE, SIDE, 2);
    for (size_t i = scene->desc.vertices / 2; i < scene->desc.vertices; i++) {
        double *p = vertex(scene, i), r = p[0] - SIDE / 2 + 0.011;
        p[0] = SIDE / 2 + r * cos(angle);
        p[1] = r * sin(angle);
    }
    add_ground(scene, -0.25);
}

/* A strip laid in a loop, its end through its beginning. */
static void make_looped_strip(struct scene *scene, double turns)
{
    panels(scene, GRID_ALTERNATING, 4 * CELLS, CELLS / 2, 4 * SIDE, SIDE / 2, 1);
    double radius = 4 * SIDE / (2 * PI * turns);
    for (size_t i = 0; i < scene->desc.vertices; i++) {
        double *p = vertex(scene, i), angle = scene->uv[2 * i] / radius;
        p[0] = radius * sin(angle) + 0.1 * p[0]; /* moves on by less than its turn comes back */
        p[1] = -radius * cos(angle);
    }
    pin_left(scene);
    add_ground(scene, -1.5);
}

static void make_tangle(struct scene *scene, double size)
{
    free_plain(scene);
    fill_random(scene->x, 3 * scene->desc.vertices, size);
    add_ground(scene, -1.1 * size);
}

/* With a ground far below, cloth is kept off itself. */
static void make_touching_folded(struct scene *scene, double value)
{
    make_folded(scene, value);
    add_ground(scene, -1);
}

static void make_touching_accordion(struct scene *scene, double value)
{
    make_accordion(scene, value);
    add_ground(scene, -1);
}

static void make_touching_twisted(struct scene *scene, double turns)
{
    make_twisted(scene, turns);
    add_ground(scene, -1);
}

static void make_touching_point(struct scene *scene, double size)
{
    make_scaled(scene, size);
    add_ground(scene, -1);
}

/* Thicker than its edges are long. */
static void make_thick(struct scene *scene, double thickness)
{
    make_free_over_sphere(scene, 0.1);
    scene->desc.thickness = thickness;
}

static void make_thick_folded(struct scene *scene, double thickness)
{
    make_touching_folded(scene, 0);
    scene->desc.thickness = thickness;
}

static void make_garments_crossed(struct scene *scene, double value)
{
    (void)value;
    tubes(scene, 1.2, 2);
    for (size_t i = scene->desc.vertices / 2; i < scene->desc.vertices; i++)
        vertex(scene, i)[0] += 0.02; /* the outer one through the inner one and the body */
}

/* ---- refusals ----------------------------------------------------------------------------------- */

static void make_bad_position(struct scene *scene, double value)
{
    plain(scene);
    scene->x[3 * 7 + 1] = value;
}

static void make_bad_pattern(struct scene *scene, double value)
{
    plain(scene);
    scene->uv[2 * 5] = value;
}

static void make_bad_twist(struct scene *scene, double value)
{
    plain(scene);
    scene->material[0].bend_twist = value;
}

static void make_bad_gravity(struct scene *scene, double value)
{
    plain(scene);
    scene->desc.gravity[2] = value;
}

static void make_bad_radius(struct scene *scene, double value)
{
    make_inside_sphere(scene, 0.1);
    scene->body[0].radius = value;
}

static void make_tolerance(struct scene *scene, double value)
{
    plain(scene);
    scene->options.tolerance = value;
}

static void make_no_material(struct scene *scene, double value)
{
    (void)value;
    plain(scene);
    scene->desc.materials = 0;
}

/* ---- the table ---------------------------------------------------------------------------------- */

const char *const group_name[GROUPS] = {"material", "step",   "mesh",   "start",   "gravity",
                                        "seams",    "bodies", "layers", "refusals"};

#define MATERIAL(name, make, value)                                                                          \
    {                                                                                                        \
        IN_MATERIAL, name, make, value, MUST_RUN, 0, NULL, false                                             \
    }
#define STEP(name, value)                                                                                    \
    {                                                                                                        \
        IN_STEP, name, make_step, value, MUST_RUN, 0, NULL, false                                            \
    }
#define MESH(name, make, value)                                                                              \
    {                                                                                                        \
        IN_MESH, name, make, value, MUST_RUN, 0, NULL, false                                                 \
    }
#define LARGE(name, cells)                                                                                   \
    {                                                                                                        \
        IN_MESH, name, make_many, cells, MUST_RUN, 0, NULL, true                                             \
    }
#define START(name, make, value)                                                                             \
    {                                                                                                        \
        IN_START, name, make, value, MUST_RUN, 0, NULL, false                                                \
    }
#define GRAVITY(name, make, value)                                                                           \
    {                                                                                                        \
        IN_GRAVITY, name, make, value, MUST_RUN, 0, NULL, false                                              \
    }
#define SEAMS(name, make, value)                                                                             \
    {                                                                                                        \
        IN_SEAMS, name, make, value, MUST_RUN, 0, NULL, false                                                \
    }
#define BODIES(name, make, value)                                                                            \
    {                                                                                                        \
        IN_BODIES, name, make, value, MUST_RUN, 0, NULL, false                                               \
    }
#define LAYERS(name, make, value)                                                                            \
    {                                                                                                        \
        IN_LAYERS, name, make, value, MUST_RUN, 0, NULL, false                                               \
    }
#define TOUCHING(group, name, make, value)                                                                   \
    {                                                                                                        \
        group, name, make, value, MAY_CROSS, 0, NULL, false                                                  \
    }
#define EXTREME(group, name, make, value)                                                                    \
    {                                                                                                        \
        group, name, make, value, MAY_REFUSE, 0, NULL, false                                                 \
    }
#define REFUSED(name, make, value, place, member)                                                            \
    {                                                                                                        \
        IN_REFUSALS, name, make, value, MUST_REFUSE, place, member, false                                    \
    }

const struct stability_case stability_case[] = {
    MATERIAL("plain", make_plain, 0),
    MATERIAL("k L^2/B = 1e3", make_ratio, 1e3),
    MATERIAL("k L^2/B = 1e4", make_ratio, 1e4),
    MATERIAL("k L^2/B = 1e5", make_ratio, 1e5),
    MATERIAL("k L^2/B = 1e6", make_ratio, 1e6),
    MATERIAL("k L^2/B = 1e7", make_ratio, 1e7),
    MATERIAL("k L^2/B = 1e8", make_ratio, 1e8),
    MATERIAL("k L^2/B = 1e9", make_ratio, 1e9),
    MATERIAL("k L^2/B = 1e10", make_ratio, 1e10),
    MATERIAL("no bending", make_ratio, 0),
    MATERIAL("bending in one direction only", make_bend_weft_only, 1e-3),
    MATERIAL("a stiff plate, 1 N m", make_bend, 1),
    MATERIAL("density 1e-4 kg/m^2", make_density, 1e-4),
    MATERIAL("density 1e2 kg/m^2", make_density, 1e2),
    MATERIAL("two densities, 1:1e6", make_two_densities, 1e6),
    MATERIAL("stretch 1e-3 N/m", make_stretch, 1e-3),
    MATERIAL("stretch 1e9 N/m", make_stretch, 1e9),
    MATERIAL("orthotropic 1:1e4", make_orthotropic, 1e4),
    MATERIAL("orthotropic 1e4:1", make_orthotropic, 1e-4),
    MATERIAL("shear 1e-4 of stretch", make_shear, 1e-4),
    MATERIAL("Poisson 1 - 1e-9", make_poisson, 1 - 1e-9),
    MATERIAL("Poisson 1e-9 - 1", make_poisson, 1e-9 - 1),
    MATERIAL("two fabrics, 1:1e6", make_two_materials, 1e6),
    MATERIAL("curves that stiffen 10 times", make_stiffening, 10),
    MATERIAL("curves that stiffen 1e6 times", make_stiffening, 1e6),
    MATERIAL("curves that yield", make_yielding, 0),
    MATERIAL("stiffening curves stretched 10x", make_curve_stretched, 10),
    MATERIAL("stiffening curves compressed 10x", make_curve_stretched, 0.1),
    MATERIAL("the least density", make_density, DRAPE_MIN_MATERIAL),
    MATERIAL("the most density", make_density, DRAPE_MAX_MATERIAL),
    MATERIAL("the least stretch", make_stretch, 2 * DRAPE_MIN_MATERIAL),
    MATERIAL("the most stretch", make_stretch, DRAPE_MAX_MATERIAL),
    MATERIAL("the least bending", make_bend, 2 * DRAPE_MIN_MATERIAL),
    MATERIAL("the most bending", make_bend, DRAPE_MAX_MATERIAL),

    STEP("step 1e-6 s", 1e-6),
    STEP("step 1e-4 s", 1e-4),
    STEP("step 1e-3 s", 1e-3),
    STEP("step 1e-2 s", 1e-2),
    STEP("step 0.1 s", 0.1),
    STEP("step 1 s", 1),
    STEP("step 10 s", 10),
    STEP("step 1e3 s", 1e3),

    MESH("slivers 1:1000, short", make_slivers, 0),
    MESH("slivers 1:1000, narrow", make_slivers, 1),
    MESH("one column of slivers 1:1000", make_sliver_column, 0),
    MESH("caps 1:1000", make_cap, 0),
    MESH("one triangle, one pin", make_one_triangle, 1),
    MESH("one triangle, two pins", make_one_triangle, 2),
    MESH("one triangle, all pinned", make_one_triangle, 3),
    MESH("two separate pieces", make_two_pieces, 2),
    TOUCHING(IN_MESH, "128 separate triangles", make_loose_triangles, 0),
    MESH("duplicated vertices, sewn", make_sewn_soup, 0),
    MESH("vertices that no triangle uses", make_unused_vertices, 0),
    MESH("pattern mirrored", make_mirrored_pattern, 0),
    MESH("triangles wound both ways", make_mixed_winding, 0),
    MESH("two triangles at one vertex", make_bow_tie, 0),
    MESH("200 triangles around a vertex", make_fan, 200),
    MESH("graded 1:4", make_graded, 0),
    MESH("a ribbon of 1 x 100 cells", make_ribbon, 0),
    MESH("a cloth of 1 micrometre", make_size, 1e-6),
    MESH("a cloth of 1 mm", make_size, 1e-3),
    MESH("a cloth of 1 km", make_size, 1e3),

    START("all on a line", make_on_a_line, 0),
    START("all in one point", make_in_one_point, 0),
    START("all pinned", make_all_pinned, 0),
    START("held by one corner", make_one_pin, 0),
    START("mirrored", make_mirrored, 0),
    START("compressed 10 times", make_scaled, 0.1),
    START("stretched 10 times", make_scaled, 10),
    START("stretched 1000 times", make_scaled, 1000),
    START("turned inside out and stretched", make_scaled, -3),
    START("pulled apart 10 times", make_pulled_apart, 10),
    START("pushed together 10 times", make_pulled_apart, 0.1),
    START("random in 1 m", make_random, 1),
    START("random in 100 m", make_random, 100),
    START("random in 1 mm", make_random, 1e-3),
    START("noise of 1e-12 m", make_noise, 1e-12),
    START("noise of 5 mm", make_noise, 5e-3),
    START("folded by half a turn", make_folded, 0),
    START("folded like an accordion", make_accordion, 0),
    START("twisted by 3 turns", make_twisted, 3),
    START("flat upwards, a saddle", make_upright, 1),
    START("flat downwards", make_upright, -1),
    START("flat on its edge, a saddle", make_on_edge, 0),
    START("an edge collapsed", make_collapsed_edge, 0),
    START("a column collapsed", make_collapsed_column, 0),
    START("one vertex 100 m away", make_one_far, 100),
    START("one vertex 1e6 m away", make_one_far, 1e6),
    START("random as far as allowed", make_random, DRAPE_MAX_COORDINATE),
    START("1 km from the origin", make_far, 1e3),
    START("900 km from the origin", make_far, 9e5),
    START("denormal positions", make_denormal_positions, 1e-310),
    START("denormals in the pattern", make_denormal_pattern, 1e-310),

    GRAVITY("no gravity, flat", make_gravity_down, 0),
    GRAVITY("no gravity, noise of 5 mm", make_weightless_noise, 5e-3),
    GRAVITY("gravity upwards", make_gravity_down, -9.81),
    GRAVITY("gravity sideways, away", make_gravity_along, 9.81),
    GRAVITY("gravity sideways, a saddle", make_gravity_along, -9.81),
    GRAVITY("gravity 1e-9 m/s^2", make_gravity_down, 1e-9),
    GRAVITY("the most gravity", make_gravity_down, DRAPE_MAX_GRAVITY),
    EXTREME(IN_GRAVITY, "denormal gravity", make_gravity_down, 1e-310),

    SEAMS("seams open 5 cm", make_open_seam, 0.05),
    SEAMS("seams open 10 times the panel", make_open_seam, 10 * SIDE),
    SEAMS("seams closed", make_open_seam, 0),
    SEAMS("a tube", make_loop, 1),
    SEAMS("a Moebius strip", make_loop, -1),
    SEAMS("edges 1:10 sewn", make_uneven_seam, 0),
    SEAMS("a vertex sewn to itself", make_seam_to_itself, 0),
    SEAMS("an edge gathered in one point", make_gathered, 0),

    BODIES("a sphere inside the cloth", make_inside_sphere, 0.1),
    BODIES("the cloth inside a sphere", make_inside_sphere, 1),
    BODIES("the cloth deep inside a sphere", make_inside_sphere, 100),
    BODIES("a sphere of 1 micrometre", make_inside_sphere, 1e-6),
    BODIES("a sphere's centre on a vertex", make_centre_on_vertex, 0),
    BODIES("a box inside the cloth", make_inside_box, 0),
    BODIES("the cloth inside a box", make_free_inside_box, 0),
    BODIES("falling onto the ground", make_through_ground, -0.1),
    BODIES("exactly on the ground", make_through_ground, 0),
    BODIES("1 m below the ground", make_through_ground, 1),
    BODIES("half below the ground", make_across_ground, 0),
    BODIES("onto a sphere of 10 cm", make_free_over_sphere, 0.1),
    BODIES("onto a sphere of 1 km", make_free_over_sphere, 1e3),
    BODIES("falling past a sphere", make_beside_sphere, 0),
    BODIES("onto a capsule", make_capsule, 0.2),
    BODIES("onto a capsule of no length", make_capsule, 0),
    BODIES("onto overlapping spheres", make_overlapping_spheres, 0),
    BODIES("weightless near a sphere", make_weightless_on_sphere, 0),
    BODIES("random around a sphere", make_random_over_sphere, 0.3),
    BODIES("onto the ground 1 km away", make_far_over_ground, 1e3),
    BODIES("a seam around a sphere", make_seam_through_sphere, 0.2),
    BODIES("onto crossing boxes", make_over_crossing_boxes, 0),
    BODIES("crossing boxes inside the cloth", make_inside_crossing_boxes, 0),
    BODIES("onto a needle of 2 mm", make_over_needle, 2e-3),
    BODIES("onto a needle of 20 mm", make_over_needle, 0.02),
    BODIES("onto a wire of 0.2 mm", make_over_wire, 1e-4),
    BODIES("onto a ball of 0.2 mm", make_free_over_sphere, 1e-4),
    BODIES("onto a sphere at 10 m/s", make_falling_on_sphere, 10),
    BODIES("onto a plate at 10 m/s", make_falling_on_plate, 10),
    BODIES("onto a sphere from 5 m", make_falling_from, 5),
    BODIES("onto a sphere, friction 0.3", make_rough_sphere, 0.3),
    BODIES("onto a sphere, friction 10", make_rough_sphere, DRAPE_MAX_FRICTION),
    BODIES("pins inside a sphere", make_pins_in_sphere, 0.1),
    BODIES("pins deep inside a sphere", make_pins_in_sphere, 1),
    BODIES("pins inside a box", make_pins_in_box, 0),
    BODIES("a garment that fits", make_garment, 1),
    BODIES("a garment 1.4 times too wide", make_garment, 1.4),
    BODIES("1.4 times too wide, hung", make_hung_garment, 1.4),
    BODIES("a garment half too narrow", make_garment, 0.5),
    BODIES("a garment 10 times too narrow", make_garment, 0.1),
    BODIES("half too narrow, hung", make_hung_garment, 0.5),
    BODIES("a garment shoved in by 3 cm", make_shoved_garment, 0.03),
    BODIES("a garment shoved in by 15 cm", make_shoved_garment, 0.15),

    LAYERS("2 layers", make_stack, 2),
    LAYERS("50 layers", make_stack, 50),
    LAYERS("50 layers, friction 0.3", make_rough_pile, 0.3),
    LAYERS("10 layers, friction 0.3", make_rough_stack, 0.3),
    LAYERS("10 layers, friction 10", make_rough_stack, DRAPE_MAX_FRICTION),
    LAYERS("10 layers 0.1 mm apart", make_stack_at, 1e-4),
    TOUCHING(IN_LAYERS, "10 layers in one place", make_stack_at, 0),
    LAYERS("10 layers 10 mm apart", make_stack_at, 0.01),
    LAYERS("10 layers, 50 mm thick", make_thick_stack, DRAPE_MAX_THICKNESS),
    LAYERS("10 layers, 0.01 mm thick", make_thick_stack, DRAPE_MIN_THICKNESS),
    LAYERS("5 layers on a slope that holds", make_leaning_stack, 0.2),
    LAYERS("5 layers on a slope too steep", make_leaning_stack, 0.5),
    LAYERS("onto a held sheet at 10 m/s", make_falling_on_sheet, 10),
    LAYERS("two garments", make_two_garments, 1.1),
    LAYERS("two garments, half too narrow", make_two_garments, 0.5),
    LAYERS("sheets through each other, 90", make_crossing_sheets, PI / 2),
    LAYERS("sheets through each other, 10", make_crossing_sheets, PI / 18),
    LAYERS("a strip through itself", make_looped_strip, 1.5),
    LAYERS("a strip wound up, through itself", make_looped_strip, 4),
    LAYERS("tangled in 0.3 m", make_tangle, 0.3),
    LAYERS("tangled in 1 cm", make_tangle, 0.01),
    LAYERS("garments through each other", make_garments_crossed, 0),
    TOUCHING(IN_LAYERS, "folded by half a turn, touching", make_touching_folded, 0),
    TOUCHING(IN_LAYERS, "an accordion, touching", make_touching_accordion, 0),
    LAYERS("twisted by 3 turns, touching", make_touching_twisted, 3),
    TOUCHING(IN_LAYERS, "all in one point, touching", make_touching_point, 0),
    LAYERS("compressed 100 times, touching", make_touching_point, 0.01),
    LAYERS("edges as long as it is thick", make_thick, DRAPE_MAX_THICKNESS),
    TOUCHING(IN_LAYERS, "folded, edges of its thickness", make_thick_folded, DRAPE_MAX_THICKNESS),

    /* last, as they take longest */
    LARGE("20 000 triangles", 100),
    LARGE("200 000 triangles", 316),

    REFUSED("NaN in a position", make_bad_position, NAN, DRAPE_AT_VERTEX, NULL),
    REFUSED("+Inf in a position", make_bad_position, INFINITY, DRAPE_AT_VERTEX, NULL),
    REFUSED("-Inf in a position", make_bad_position, -INFINITY, DRAPE_AT_VERTEX, NULL),
    REFUSED("NaN in the pattern", make_bad_pattern, NAN, DRAPE_AT_PATTERN, NULL),
    REFUSED("+Inf in the pattern", make_bad_pattern, INFINITY, DRAPE_AT_PATTERN, NULL),
    REFUSED("a position 1e300 m away", make_bad_position, 1e300, DRAPE_AT_VERTEX, NULL),
    REFUSED("a pattern of 1e300 m", make_bad_pattern, 1e300, DRAPE_AT_PATTERN, NULL),
    REFUSED("density 1e300", make_density, 1e300, DRAPE_AT_MATERIAL, "density"),
    REFUSED("stretch 1e300", make_stretch, 1e300, DRAPE_AT_MATERIAL, "stretch_weft"),
    REFUSED("bending 1e300", make_bend, 1e300, DRAPE_AT_MATERIAL, "bend_weft"),
    REFUSED("gravity 1e300", make_bad_gravity, 1e300, DRAPE_AT_SCENE, "gravity"),
    REFUSED("denormal density", make_density, 1e-310, DRAPE_AT_MATERIAL, "density"),
    REFUSED("denormal stretch", make_stretch, 1e-310, DRAPE_AT_MATERIAL, "stretch_weft"),
    REFUSED("denormal bending", make_bend, 1e-310, DRAPE_AT_MATERIAL, "bend_weft"),
    REFUSED("density NaN", make_density, NAN, DRAPE_AT_MATERIAL, "density"),
    REFUSED("density 0", make_density, 0, DRAPE_AT_MATERIAL, "density"),
    REFUSED("density -0.1", make_density, -0.1, DRAPE_AT_MATERIAL, "density"),
    REFUSED("stretch 0", make_stretch, 0, DRAPE_AT_MATERIAL, "stretch_weft"),
    REFUSED("stretch Inf", make_stretch, INFINITY, DRAPE_AT_MATERIAL, "stretch_weft"),
    REFUSED("bending NaN", make_bad_twist, NAN, DRAPE_AT_MATERIAL, "bend_twist"),
    REFUSED("bending -1", make_bad_twist, -1, DRAPE_AT_MATERIAL, "bend_twist"),
    REFUSED("Poisson 1", make_poisson, 1, DRAPE_AT_MATERIAL, "poisson"),
    REFUSED("Poisson NaN", make_poisson, NAN, DRAPE_AT_MATERIAL, "poisson"),
    REFUSED("a curve that falls", make_curve_to, 4, DRAPE_AT_MATERIAL, "stretch_weft"),
    REFUSED("a curve to NaN", make_curve_to, NAN, DRAPE_AT_MATERIAL, "stretch_weft"),
    REFUSED("a curve with Poisson 0.3", make_curve_and_poisson, 0.3, DRAPE_AT_MATERIAL, "poisson"),
    REFUSED("gravity NaN", make_bad_gravity, NAN, DRAPE_AT_SCENE, "gravity"),
    REFUSED("a sphere of radius NaN", make_bad_radius, NAN, DRAPE_AT_BODY, "radius"),
    REFUSED("a sphere of radius 0", make_bad_radius, 0, DRAPE_AT_BODY, "radius"),
    REFUSED("no fabric", make_no_material, 0, DRAPE_AT_SCENE, "materials"),
    REFUSED("a rest shape without area", make_degenerate_rest, 0, DRAPE_AT_TRIANGLE, NULL),
    REFUSED("a corner twice in one triangle", make_repeated_corner, 0, DRAPE_AT_TRIANGLE, NULL),
    REFUSED("a triangle twice", make_three_at_an_edge, 0, DRAPE_AT_TRIANGLE, NULL),
    REFUSED("a corner that does not exist", make_bad_corner, 0, DRAPE_AT_TRIANGLE, NULL),
    REFUSED("a piece that nothing holds", make_two_pieces, 1, DRAPE_AT_VERTEX, NULL),
    REFUSED("pins sewn together 1 m apart", make_pins_sewn_apart, 0, DRAPE_AT_PIN, NULL),
    REFUSED("a seam across an edge", make_seam_across_an_edge, 0, DRAPE_AT_SEAM, NULL),
    REFUSED("a seam to nowhere", make_bad_seam, 0, DRAPE_AT_SEAM, NULL),
    REFUSED("a pin that does not exist", make_bad_pin, 0, DRAPE_AT_PIN, NULL),
    REFUSED("step 0", make_step, 0, DRAPE_AT_OPTION, "time_step"),
    REFUSED("step NaN", make_step, NAN, DRAPE_AT_OPTION, "time_step"),
    REFUSED("step 1e4 s", make_step, 1e4, DRAPE_AT_OPTION, "time_step"),
    REFUSED("tolerance NaN", make_tolerance, NAN, DRAPE_AT_OPTION, "tolerance"),
};
const size_t stability_cases = sizeof stability_case / sizeof *stability_case;

void scene_make(const struct stability_case *which, struct scene *scene)
{
    which->make(scene, which->value);
}

void scene_done(struct scene *scene)
{
    free(scene->x);
    free(scene->uv);
    free(scene->triangle);
    free(scene->triangle_material);
    free(scene->pin);
    free(scene->seam);
    free(scene->body_position);
    free(scene->body_triangle);
    memset(scene, 0, sizeof *scene);
}
