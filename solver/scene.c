/* scene.c - checks a scene's description and compiles it: welding, rest shapes, bodies. */
#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "curve.h"
#include "error.h"
#include "lines.h"
#include "ramp.h"
#include "seam.h"

#define FLAT         1e-6  /* off its plane, over its extent: rounding of coordinates */
#define NESTED_FROM  10000 /* triangles of a coarse mesh that has one, too; below, that is too rough */
#define LEAST_CHANGE 1e-9  /* of a length, relative, that makes another pattern */

drape_scene_desc drape_scene_desc_default(void)
{
    return (drape_scene_desc){.gravity = {0, -9.81, 0}, .thickness = DRAPE_DEFAULT_THICKNESS};
}

/* ---- checks ------------------------------------------------------------------------------------- */

/* Whether all are numbers of at most that size; else *ret_bad is the first that is not. */
static bool all_within(const double *value, size_t count, double most, size_t *ret_bad)
{
    for (size_t i = 0; i < count; i++)
        if (!(fabs(value[i]) <= most)) {
            *ret_bad = i;
            return false;
        }
    return true;
}

static drape_status check_counts(const drape_scene_desc *desc, drape_error *reterr)
{
    const struct {
        const char *member;
        size_t count, most;
        bool array;
    } row[] = {
        {"vertices", desc->vertices, DRAPE_MAX_VERTICES, desc->positions && desc->pattern},
        {"triangles", desc->triangles, DRAPE_MAX_TRIANGLES, desc->triangle != NULL},
        {"seams", desc->seams, DRAPE_MAX_VERTICES, desc->seam != NULL},
        {"pins", desc->pins, DRAPE_MAX_VERTICES, desc->pin != NULL},
        {"materials", desc->materials, DRAPE_MAX_TRIANGLES, desc->material != NULL},
        {"bodies", desc->bodies, DRAPE_MAX_BODIES, desc->body != NULL},
        {"elastics", desc->elastics, DRAPE_MAX_LINES, desc->elastic != NULL},
        {"folds", desc->folds, DRAPE_MAX_LINES, desc->fold != NULL},
        {"tacks", desc->tacks, DRAPE_MAX_VERTICES, desc->tack != NULL},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        if (row[i].count > row[i].most)
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, row[i].member,
                              "%zu are more than the limit of %zu", row[i].count, row[i].most);
        if (row[i].count && !row[i].array)
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, row[i].member,
                              "the array is missing");
    }
    if (desc->vertices < 3)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "vertices", "a cloth has at least 3");
    if (!desc->triangles)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "triangles",
                          "a cloth has at least 1");
    if (!desc->materials)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "materials",
                          "a cloth has at least 1");
    return DRAPE_OK;
}

/* One material: its numbers, or the curves that stand in the place of some. */
static drape_status check_material(const drape_material *material, int64_t m, drape_error *reterr)
{
    const struct {
        const char *member;
        double value;
        bool zero_allowed;
        const drape_curve *curve; /* NULL: a number only */
    } row[] = {
        {"density", material->density, false, NULL},
        {"stretch_weft", material->stretch_weft, false, &material->curve_weft},
        {"stretch_warp", material->stretch_warp, false, &material->curve_warp},
        {"stretch_shear", material->stretch_shear, false, &material->curve_shear},
        {"bend_weft", material->bend_weft, true, NULL},
        {"bend_warp", material->bend_warp, true, NULL},
        {"bend_twist", material->bend_twist, true, NULL},
    };
    bool curved = false;
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        if (row[i].curve && row[i].curve->points) {
            drape_status status = dr_curve_check(row[i].curve, m, row[i].member, reterr);
            if (status < 0)
                return status;
            curved = true;
        } else if (!(row[i].value == 0 && row[i].zero_allowed) &&
                   !(row[i].value >= DRAPE_MIN_MATERIAL && row[i].value <= DRAPE_MAX_MATERIAL)) {
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_MATERIAL, m, -1, row[i].member,
                              "%g is not %sbetween %g and %g", row[i].value,
                              row[i].zero_allowed ? "0 or " : "", DRAPE_MIN_MATERIAL, DRAPE_MAX_MATERIAL);
        }
    }
    if (!(fabs(material->poisson) < 1)) /* D is positive definite just then */
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_MATERIAL, m, -1, "poisson",
                          "%g is not between -1 and 1, both excluded", material->poisson);
    if (!(material->friction >= 0 && material->friction <= DRAPE_MAX_FRICTION))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_MATERIAL, m, -1, "friction",
                          "%g is not between 0 and %g", material->friction, (double)DRAPE_MAX_FRICTION);
    const double shrink[] = {material->shrink_weft, material->shrink_warp};
    for (int i = 0; i < 2; i++)
        if (!(fabs(shrink[i]) <= DRAPE_MAX_SHRINK))
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_MATERIAL, m, -1,
                              i ? "shrink_warp" : "shrink_weft", "%g is not between %g and %g", shrink[i],
                              -DRAPE_MAX_SHRINK, DRAPE_MAX_SHRINK);
    if (curved && material->poisson != 0)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_MATERIAL, m, -1, "poisson",
                          "%g must be 0 beside a strain-stress curve", material->poisson);
    return DRAPE_OK;
}

static drape_status check_materials(const drape_scene_desc *desc, drape_error *reterr)
{
    for (size_t m = 0; m < desc->materials; m++) {
        drape_status status = check_material(desc->material + m, (int64_t)m, reterr);
        if (status < 0)
            return status;
    }
    for (size_t t = 0; desc->triangle_material && t < desc->triangles; t++)
        if (desc->triangle_material[t] >= desc->materials)
            return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_TRIANGLE_MATERIAL, (int64_t)t,
                           "material %u does not exist: there are %zu", desc->triangle_material[t],
                           desc->materials);
    return DRAPE_OK;
}

static drape_status check_indices(const drape_scene_desc *desc, drape_error *reterr)
{
    for (size_t i = 0; i < 3 * desc->triangles; i++)
        if (desc->triangle[i] >= desc->vertices)
            return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_TRIANGLE, (int64_t)(i / 3),
                           "vertex %u does not exist: there are %zu", desc->triangle[i], desc->vertices);
    for (size_t i = 0; i < 2 * desc->seams; i++)
        if (desc->seam[i] >= desc->vertices)
            return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_SEAM, (int64_t)(i / 2),
                           "vertex %u does not exist: there are %zu", desc->seam[i], desc->vertices);
    for (size_t i = 0; i < desc->pins; i++)
        if (desc->pin[i] >= desc->vertices)
            return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_PIN, (int64_t)i,
                           "vertex %u does not exist: there are %zu", desc->pin[i], desc->vertices);
    return DRAPE_OK;
}

static drape_status check_numbers(const drape_scene_desc *desc, drape_error *reterr)
{
    size_t bad;
    if (!all_within(desc->positions, 3 * desc->vertices, DRAPE_MAX_COORDINATE, &bad))
        return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_VERTEX, (int64_t)(bad / 3),
                       "the position is not finite and within %g m", DRAPE_MAX_COORDINATE);
    if (!all_within(desc->pattern, 2 * desc->vertices, DRAPE_MAX_COORDINATE, &bad))
        return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_PATTERN, (int64_t)(bad / 2),
                       "the pattern coordinate is not finite and within %g m", DRAPE_MAX_COORDINATE);
    if (desc->start_pattern &&
        !all_within(desc->start_pattern, 2 * desc->vertices, DRAPE_MAX_COORDINATE, &bad))
        return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_PATTERN, (int64_t)(bad / 2),
                       "the start's pattern coordinate is not finite and within %g m", DRAPE_MAX_COORDINATE);
    if (!all_within(desc->gravity, 3, DRAPE_MAX_GRAVITY, &bad))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "gravity",
                          "it is not finite and within %g m/s^2", DRAPE_MAX_GRAVITY);
    if (desc->self_contact > DRAPE_SELF_CONTACT_OFF)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "self_contact", "out of range");
    if (desc->coarse > DRAPE_COARSE_SEWN)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "coarse", "out of range");
    if (!(desc->thickness >= DRAPE_MIN_THICKNESS && desc->thickness <= DRAPE_MAX_THICKNESS))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_SCENE, -1, -1, "thickness",
                          "%g m is not between %g and %g", desc->thickness, DRAPE_MIN_THICKNESS,
                          DRAPE_MAX_THICKNESS);
    return DRAPE_OK;
}

/* ---- welding ------------------------------------------------------------------------------------ */

static uint32_t find_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

static void unite(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = find_root(parent, a);
    b = find_root(parent, b);
    if (a != b) /* the lower index leads, so that nodes keep the vertices' order */
        parent[a > b ? a : b] = a > b ? b : a;
}

/* Numbers the groups that seams weld, in the order of their first vertex, and counts them. */
static drape_status number_nodes(const drape_scene_desc *desc, uint32_t *vertex_node, size_t *ret_nodes,
                                 drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    uint32_t *parent = malloc(desc->vertices * sizeof *parent);
    bool *used = calloc(desc->vertices, sizeof *used);
    if (!parent || !used) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    for (size_t i = 0; i < desc->vertices; i++)
        parent[i] = (uint32_t)i;
    for (size_t i = 0; i < 3 * desc->triangles; i++)
        used[desc->triangle[i]] = true;
    for (size_t i = 0; i < 2 * desc->seams; i++)
        if (!used[desc->seam[i]]) {
            status = dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_SEAM, (int64_t)(i / 2),
                             "vertex %u belongs to no triangle", desc->seam[i]);
            goto cleanup;
        }
    for (size_t s = 0; s < desc->seams; s++)
        unite(parent, desc->seam[2 * s], desc->seam[2 * s + 1]);

    size_t nodes = 0;
    for (size_t i = 0; i < desc->vertices; i++) { /* a root precedes the rest of its group */
        uint32_t root = find_root(parent, (uint32_t)i);
        vertex_node[i] = !used[i] ? DR_NONE : root == i ? (uint32_t)nodes++ : vertex_node[root];
    }
    *ret_nodes = nodes;

cleanup:
    free(parent);
    free(used);
    return status;
}

/* Two pins in one sewn group must agree on where it is held. */
static drape_status check_pins(const drape_scene_desc *desc, const uint32_t *vertex_node, size_t nodes,
                               drape_error *reterr)
{
    uint32_t *first = malloc(nodes * sizeof *first); /* the vertex that pins each node */
    if (!first)
        return dr_out_of_memory(reterr);
    memset(first, 0xff, nodes * sizeof *first);
    drape_status status = DRAPE_OK;
    for (size_t i = 0; i < desc->pins && status == DRAPE_OK; i++) {
        uint32_t node = vertex_node[desc->pin[i]];
        if (node == DR_NONE)
            continue;
        if (first[node] == DR_NONE)
            first[node] = desc->pin[i];
        const double *a = desc->positions + 3 * (size_t)first[node],
                     *b = desc->positions + 3 * (size_t)desc->pin[i];
        double gap = sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                          (a[2] - b[2]) * (a[2] - b[2]));
        if (gap > DR_WELD_GAP)
            status = dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_PIN, (int64_t)i,
                             "vertices %u and %u are sewn together but pinned %.3g m apart", first[node],
                             desc->pin[i], gap);
    }
    free(first);
    return status;
}

static double widest_seam(const drape_scene_desc *desc)
{
    double widest = 0;
    for (size_t s = 0; s < desc->seams; s++) {
        const double *a = desc->positions + 3 * (size_t)desc->seam[2 * s];
        const double *b = desc->positions + 3 * (size_t)desc->seam[2 * s + 1];
        for (int d = 0; d < 3; d++)
            widest = fmax(widest, fabs(a[d] - b[d]));
    }
    return widest * sqrt(3); /* never less than the true distance */
}

/* An error of the welded mesh that the pieces did not have comes from a seam: name one that touches
 * the triangle at fault. */
static drape_status blame_seam(const drape_scene_desc *desc, drape_status status, drape_error *reterr)
{
    if (status != DRAPE_EINVAL || !reterr || reterr->place != DRAPE_AT_TRIANGLE)
        return status;
    const uint32_t *corner = desc->triangle + 3 * (size_t)reterr->element;
    for (size_t i = 0; i < 2 * desc->seams; i++)
        if (desc->seam[i] == corner[0] || desc->seam[i] == corner[1] || desc->seam[i] == corner[2]) {
            char message[sizeof reterr->message];
            memcpy(message, reterr->message, sizeof message);
            int64_t triangle = reterr->element;
            return dr_fail(reterr, status, DRAPE_AT_SEAM, (int64_t)(i / 2),
                           "once sewn, at triangle %lld %.120s", (long long)triangle, message);
        }
    return status;
}

/* ---- compiling ---------------------------------------------------------------------------------- */

static void *copy_of(const void *source, size_t count, size_t size)
{
    void *copy = malloc(count ? count * size : 1);
    if (copy && count)
        memcpy(copy, source, count * size);
    return copy;
}

/* Copies the seams but for pairs of a vertex with itself: where many points join, real patterns have
 * some, and they ask for nothing. */
static bool copy_seams(const drape_scene_desc *desc, drape_scene *scene)
{
    scene->seam = malloc((desc->seams ? desc->seams : 1) * 2 * sizeof *scene->seam);
    for (size_t s = 0; scene->seam && s < desc->seams; s++)
        if (desc->seam[2 * s] != desc->seam[2 * s + 1])
            memcpy(scene->seam + 2 * scene->seams++, desc->seam + 2 * s, 2 * sizeof *scene->seam);
    return scene->seam != NULL;
}

/* Copies the materials, and the points of all their curves into one array. */
static bool copy_materials(const drape_scene_desc *desc, drape_scene *scene)
{
    scene->material = copy_of(desc->material, desc->materials, sizeof *scene->material);
    for (size_t m = 0; m < desc->materials; m++) {
        const drape_material *of = desc->material + m;
        scene->curve_points += of->curve_weft.points + of->curve_warp.points + of->curve_shear.points;
    }
    if (!scene->material || !scene->curve_points)
        return scene->material != NULL;
    double *next = scene->curve_point = malloc(2 * scene->curve_points * sizeof *next);
    for (size_t m = 0; next && m < desc->materials; m++) {
        drape_material *to = scene->material + m;
        drape_curve *curve[] = {&to->curve_weft, &to->curve_warp, &to->curve_shear};
        for (int i = 0; i < 3; i++) {
            size_t numbers = 2 * curve[i]->points;
            if (numbers)
                memcpy(next, curve[i]->point, numbers * sizeof *next);
            curve[i]->point = numbers ? next : NULL;
            next += numbers;
        }
    }
    return scene->curve_point != NULL;
}

static bool any_shrinks(const drape_scene_desc *desc)
{
    for (size_t m = 0; m < desc->materials; m++)
        if (desc->material[m].shrink_weft != 0 || desc->material[m].shrink_warp != 0)
            return true;
    return false;
}

static drape_status shrink_meshes(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    if (!any_shrinks(desc))
        return DRAPE_OK;
    double *factor = malloc(2 * desc->materials * sizeof *factor);
    if (!factor)
        return dr_out_of_memory(reterr);
    for (size_t m = 0; m < desc->materials; m++) {
        factor[2 * m] = 1 - desc->material[m].shrink_weft;
        factor[2 * m + 1] = 1 - desc->material[m].shrink_warp;
    }
    dr_mesh_shrink(scene->mesh, factor);
    if (scene->pieces)
        dr_mesh_shrink(scene->pieces, factor);
    free(factor);
    return DRAPE_OK;
}

static drape_status new_meshes(const drape_scene_desc *desc, drape_scene *scene, size_t nodes,
                               drape_error *reterr)
{
    drape_status status;
    double *density = malloc(desc->materials * sizeof *density);
    uint32_t *corner_node = malloc(3 * desc->triangles * sizeof *corner_node);
    bool *held = calloc(desc->vertices, sizeof *held); /* by vertex, then by node */
    if (!density || !corner_node || !held) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    for (size_t m = 0; m < desc->materials; m++)
        density[m] = desc->material[m].density;
    for (size_t i = 0; i < 3 * desc->triangles; i++)
        corner_node[i] = scene->vertex_node[desc->triangle[i]];

    for (size_t i = 0; i < desc->pins; i++)
        held[desc->pin[i]] = true;
    for (size_t i = 0; i < desc->vertices; i++)
        held[i] = held[i] || scene->vertex_node[i] == DR_NONE;
    status = dr_mesh_new(desc->vertices, desc->triangles, desc->triangle, desc->triangle, desc->pattern,
                         desc->triangle_material, density, held, &scene->pieces, reterr);
    if (status < 0)
        goto cleanup;

    memset(held, 0, desc->vertices * sizeof *held);
    for (size_t i = 0; i < desc->pins; i++)
        if (scene->vertex_node[desc->pin[i]] != DR_NONE)
            held[scene->vertex_node[desc->pin[i]]] = true;
    status = dr_mesh_new(nodes, desc->triangles, corner_node, desc->triangle, desc->pattern,
                         desc->triangle_material, density, held, &scene->mesh, reterr);
    status = blame_seam(desc, status, reterr);
    if (scene->seam_gap <= DR_WELD_GAP)
        scene->pieces = dr_mesh_free(scene->pieces);
    if (status >= 0)
        status = shrink_meshes(desc, scene, reterr);

cleanup:
    free(density);
    free(corner_node);
    free(held);
    return status;
}

/* How far the pattern is from that of the start. What is below round-off is no change. */
static drape_status measure_change(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    struct dr_mesh *old_mesh = NULL;
    double *density = calloc(desc->materials, sizeof *density); /* its mass is not wanted */
    drape_status status = density ? DRAPE_OK : dr_out_of_memory(reterr);
    scene->draped = true;
    if (status >= 0)
        status = dr_mesh_new(scene->mesh->nodes, desc->triangles, scene->mesh->triangle, desc->triangle,
                             desc->start_pattern, desc->triangle_material, density, NULL, &old_mesh, reterr);
    if (status >= 0)
        status = dr_ramp_measure(old_mesh, scene->mesh, &scene->old_stretch, &scene->change, reterr);
    if (status >= 0 && scene->change < LEAST_CHANGE) {
        free(scene->old_stretch);
        scene->old_stretch = NULL;
        scene->change = 0;
    }
    dr_mesh_free(old_mesh);
    free(density);
    return status;
}

/* A node sits at the mean of its vertices, a held node where its first pin is. */
static drape_status share_nodes(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    size_t nodes = scene->mesh->nodes;
    uint32_t *count = calloc(nodes, sizeof *count);
    scene->vertex_share = calloc(desc->vertices, sizeof *scene->vertex_share);
    if (!count || !scene->vertex_share) {
        free(count);
        return dr_out_of_memory(reterr);
    }
    for (size_t i = 0; i < desc->vertices; i++)
        if (scene->vertex_node[i] != DR_NONE)
            count[scene->vertex_node[i]]++;
    for (size_t i = 0; i < desc->vertices; i++) {
        uint32_t node = scene->vertex_node[i];
        if (node != DR_NONE && !scene->mesh->held[node])
            scene->vertex_share[i] = 1.0 / count[node];
    }
    for (size_t i = 0; i < desc->pins; i++) {
        uint32_t node = scene->vertex_node[desc->pin[i]];
        if (node != DR_NONE && count[node]) {
            scene->vertex_share[desc->pin[i]] = 1;
            count[node] = 0; /* the first pin has it */
        }
    }
    free(count);
    return DRAPE_OK;
}

/* Puts the seams of the first part first, and so on; within a part they keep their order. */
static drape_status sort_seams(drape_scene *scene, drape_error *reterr)
{
    size_t *next = calloc(scene->parts + 1, sizeof *next); /* where the next seam of each part goes */
    uint32_t *sorted = malloc((scene->seams ? scene->seams : 1) * 2 * sizeof *sorted);
    if (!next || !sorted) {
        free(next);
        free(sorted);
        return dr_out_of_memory(reterr);
    }
    for (size_t s = 0; s < scene->seams; s++)
        next[scene->piece_part[scene->seam[2 * s]] + 1]++;
    for (size_t p = 0; p < scene->parts; p++)
        next[p + 1] += next[p];
    for (size_t s = 0; s < scene->seams; s++)
        memcpy(sorted + 2 * next[scene->piece_part[scene->seam[2 * s]]]++, scene->seam + 2 * s,
               2 * sizeof *sorted);
    free(next);
    free(scene->seam);
    scene->seam = sorted;
    return DRAPE_OK;
}

/* Notes in which part each vertex of the pieces will be, where there are several to be sewn in turn. */
static drape_status find_piece_parts(drape_scene *scene, drape_error *reterr)
{
    if (!scene->pieces || scene->parts < 2)
        return DRAPE_OK;
    scene->piece_part = calloc(scene->vertices, sizeof *scene->piece_part);
    if (!scene->piece_part)
        return dr_out_of_memory(reterr);
    for (size_t i = 0; i < scene->vertices; i++)
        if (scene->vertex_node[i] != DR_NONE)
            scene->piece_part[i] = scene->part[scene->vertex_node[i]];
    return sort_seams(scene, reterr);
}

/* Connected components; each must be held by a pin or have a body to fall on. */
static drape_status find_parts(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    const struct dr_mesh *mesh = scene->mesh;
    drape_status status = DRAPE_OK;
    uint32_t *parent = malloc(mesh->nodes * sizeof *parent);
    scene->part = malloc(mesh->nodes * sizeof *scene->part);
    scene->part_held = calloc(mesh->nodes, sizeof *scene->part_held);
    if (!parent || !scene->part || !scene->part_held) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    for (size_t i = 0; i < mesh->nodes; i++)
        parent[i] = (uint32_t)i;
    for (size_t t = 0; t < mesh->triangles; t++) {
        unite(parent, mesh->triangle[3 * t], mesh->triangle[3 * t + 1]);
        unite(parent, mesh->triangle[3 * t], mesh->triangle[3 * t + 2]);
    }
    for (size_t i = 0; i < mesh->nodes; i++) {
        uint32_t root = find_root(parent, (uint32_t)i);
        scene->part[i] = root == i ? (uint32_t)scene->parts++ : scene->part[root];
        scene->part_held[scene->part[i]] |= mesh->held[i];
    }
    for (size_t i = 0; i < scene->tacks; i++)
        scene->part_held[scene->part[scene->tack[i].node]] = true;
    for (size_t i = 0; !desc->bodies && i < desc->vertices; i++) {
        uint32_t node = scene->vertex_node[i];
        if (node != DR_NONE && !scene->part_held[scene->part[node]]) {
            status = dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_VERTEX, (int64_t)i,
                             "nothing holds its piece: it has no pinned vertex and the scene has no body");
            break;
        }
    }

cleanup:
    free(parent);
    return status;
}

/* Bending of the welded cloth, which the folds cut. */
static drape_status new_bend(drape_scene *scene, const double *rigidity, drape_error *reterr)
{
    if (!scene->hinges)
        return dr_bend_new(scene->mesh, rigidity, &scene->bend, reterr);
    struct dr_mesh cut = dr_lines_cut(scene->mesh, scene->hinge, scene->hinges);
    if (!cut.neighbor)
        return dr_out_of_memory(reterr);
    drape_status status = dr_bend_new(&cut, rigidity, &scene->bend, reterr);
    free(cut.neighbor);
    return status;
}

static drape_status new_bends(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    bool any = false;
    double *rigidity = malloc(3 * desc->materials * sizeof *rigidity);
    if (!rigidity)
        return dr_out_of_memory(reterr);
    for (size_t m = 0; m < desc->materials; m++) {
        const drape_material *material = desc->material + m;
        rigidity[3 * m] = material->bend_weft;
        rigidity[3 * m + 1] = material->bend_warp;
        rigidity[3 * m + 2] = material->bend_twist;
        any = any || material->bend_weft > 0 || material->bend_warp > 0 || material->bend_twist > 0;
    }
    drape_status status = any ? new_bend(scene, rigidity, reterr) : DRAPE_OK;
    if (status >= 0 && scene->pieces) {
        for (size_t m = 0; m < desc->materials; m++) {
            rigidity[3 * m] = rigidity[3 * m + 1] = DR_SEWING_RIGIDITY;
            rigidity[3 * m + 2] = DR_SEWING_RIGIDITY / 2;
        }
        status = dr_bend_new(scene->pieces, rigidity, &scene->pieces_bend, reterr);
    }
    free(rigidity);
    return status;
}

static double longest_move(const double *from, const double *to, size_t vertices)
{
    double longest = 0; /* squared */
    for (size_t v = 0; v < vertices; v++) {
        double square = 0;
        for (size_t d = 0; d < 3; d++)
            square += (to[3 * v + d] - from[3 * v + d]) * (to[3 * v + d] - from[3 * v + d]);
        longest = fmax(longest, square);
    }
    return sqrt(longest);
}

static struct dr_path *free_path(struct dr_path *path)
{
    if (path) {
        free(path->positions);
        free(path->triangle);
        free(path);
    }
    return NULL;
}

/* NULL: out of memory. */
static struct dr_path *new_path(const drape_body *desc)
{
    struct dr_path *path = calloc(1, sizeof *path);
    size_t numbers = 3 * desc->vertices;
    if (!path)
        return NULL;
    path->desc = *desc;
    path->positions = malloc((desc->keyframes + 1) * numbers * sizeof *path->positions);
    path->triangle = copy_of(desc->triangle, 3 * desc->triangles, sizeof *path->triangle);
    if (!path->positions || !path->triangle)
        return free_path(path);
    memcpy(path->positions, desc->positions, numbers * sizeof *path->positions);
    for (size_t k = 0; k < desc->keyframes; k++) {
        double *before = path->positions + k * numbers;
        memcpy(before + numbers, desc->keyframe[k], numbers * sizeof *before);
        path->longest_move = fmax(path->longest_move, longest_move(before, before + numbers, desc->vertices));
    }
    path->desc.positions = path->positions;
    path->desc.triangle = path->triangle;
    path->desc.keyframe = NULL; /* borrowed */
    return path;
}

/* A body that moves: its path, what it is when the cloth is draped, and, if that is to come first, when it is
 * sewn. */
static drape_status new_moving_body(const drape_body *desc, drape_scene *scene, size_t b, drape_error *reterr)
{
    drape_body last = *desc, first = *desc;
    if (!scene->path && !(scene->path = calloc(scene->bodies, sizeof(struct dr_path *))))
        return dr_out_of_memory(reterr);
    if (!(scene->path[b] = new_path(desc)))
        return dr_out_of_memory(reterr);
    last.positions = desc->keyframe[desc->keyframes - 1];
    last.keyframes = first.keyframes = 0;
    first.field = NULL; /* it is that of the last keyframe */
    drape_status status = dr_body_new(&last, (int64_t)b, &scene->body[b], reterr);
    if (status < 0 || !scene->pieces)
        return status;
    if (!scene->first_body && !(scene->first_body = calloc(scene->bodies, sizeof(struct dr_body *))))
        return dr_out_of_memory(reterr);
    return dr_body_new(&first, (int64_t)b, &scene->first_body[b], reterr);
}

static drape_status new_bodies(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    scene->body = calloc(desc->bodies ? desc->bodies : 1, sizeof(struct dr_body *));
    if (!scene->body)
        return dr_out_of_memory(reterr);
    scene->bodies = desc->bodies;
    for (size_t b = 0; b < desc->bodies; b++) {
        const drape_body *body = desc->body + b;
        drape_status status = body->keyframes ? new_moving_body(body, scene, b, reterr)
                                              : dr_body_new(body, (int64_t)b, &scene->body[b], reterr);
        if (status < 0)
            return status;
    }
    for (size_t b = 0; scene->first_body && b < desc->bodies; b++)
        if (!scene->first_body[b])
            scene->first_body[b] = scene->body[b];
    if (scene->tacks)
        dr_lines_lift(scene);
    return DRAPE_OK;
}

static bool has_lines(const drape_scene_desc *desc)
{
    return desc->elastics || desc->folds || desc->tacks;
}

/* ---- the coarse mesh ---------------------------------------------------------------------------- */

/* n = (b - a) x (c - a). */
static void normal_of(const double *a, const double *b, const double *c, double n[3])
{
    double u[3], v[3];
    for (int d = 0; d < 3; d++) {
        u[d] = b[d] - a[d];
        v[d] = c[d] - a[d];
    }
    n[0] = u[1] * v[2] - u[2] * v[1];
    n[1] = u[2] * v[0] - u[0] * v[2];
    n[2] = u[0] * v[1] - u[1] * v[0];
}

/* All triangles start in one plane. */
static bool starts_flat(const drape_scene_desc *desc)
{
    const double *x = desc->positions;
    double n[3] = {0}, one[3], extent = 0, off = 0;
    const double *origin = x + 3 * (size_t)desc->triangle[0];
    for (size_t t = 0; t < desc->triangles; t++) { /* oriented as the first: their areas add up */
        const uint32_t *v = desc->triangle + 3 * t;
        normal_of(x + 3 * (size_t)v[0], x + 3 * (size_t)v[1], x + 3 * (size_t)v[2], one);
        double sign = n[0] * one[0] + n[1] * one[1] + n[2] * one[2] < 0 ? -1 : 1;
        for (int d = 0; d < 3; d++)
            n[d] += sign * one[d];
    }
    double size = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (!(size > 0))
        return false; /* collapsed: there is no plane to tell */
    for (size_t i = 0; i < 3 * desc->triangles; i++) {
        const double *p = x + 3 * (size_t)desc->triangle[i];
        double way[3] = {p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]};
        extent = fmax(extent, sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]));
        off = fmax(off, fabs(n[0] * way[0] + n[1] * way[1] + n[2] * way[2]) / size);
    }
    return off <= FLAT * extent;
}

const char *dr_scene_without_coarse(const drape_scene_desc *desc, bool sewn)
{
    if (desc->coarse == DRAPE_COARSE_OFF)
        return "switched off";
    if (desc->start_pattern)
        return "the start is a drape";
    for (size_t b = 0; b < desc->bodies; b++)
        if (desc->body[b].keyframes)
            return "a body moves";
    if (desc->coarse == DRAPE_COARSE_ON)
        return NULL;
    if (!sewn && desc->coarse == DRAPE_COARSE_SEWN)
        return "auto: nothing has to be sewn";
    if (!sewn && desc->bodies)
        return "auto: nothing has to be sewn, and there are bodies";
    if (desc->triangles < DRAPE_COARSE_FROM)
        return "auto: the mesh is coarse itself";
    return sewn || starts_flat(desc) ? NULL : "auto: nothing has to be sewn, and the start is not flat";
}

/* The scene of the coarse mesh, whose bodies share their fields with those of the fine one. What a fine mesh
 * may have, a coarse one has, too: should it be refused all the same, nobody is told but by the plan. */
static drape_status compile_coarse(drape_scene *scene, drape_error *reterr)
{
    drape_scene_desc desc = scene->coarse->desc;
    drape_body *body = calloc(desc.bodies ? desc.bodies : 1, sizeof *body);
    if (!body)
        return dr_out_of_memory(reterr);
    for (size_t b = 0; b < desc.bodies; b++) {
        body[b] = desc.body[b];
        body[b].field = dr_body_field(scene->body[b]);
    }
    desc.body = body;
    if (scene->pieces || desc.triangles < NESTED_FROM)
        desc.coarse = DRAPE_COARSE_OFF;
    else
        desc.coarse = DRAPE_COARSE_AUTO;
    drape_error error;
    drape_status status = drape_scene_new(&desc, &scene->coarse_scene, &error);
    free(body);
    dr_coarse_strip(scene->coarse);
    return status == DRAPE_ENOMEM ? dr_out_of_memory(reterr) : status;
}

static drape_status new_coarse(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    double began = dr_clock();
    scene->coarse_asked_for = desc->coarse == DRAPE_COARSE_ON;
    scene->coarse_left_out = dr_scene_without_coarse(desc, scene->pieces);
    /* A coarse garment locks in the open seams of another, and all would begin anew. */
    if (!scene->coarse_left_out && desc->coarse != DRAPE_COARSE_ON && scene->piece_part)
        scene->coarse_left_out = "auto: garments are sewn one after the other";
    if (scene->coarse_left_out)
        return DRAPE_OK;
    if ((status = dr_coarsen(desc, DR_COARSER * dr_mesh_edge(scene->mesh), &scene->coarse, reterr)) < 0)
        return status;
    if (2 * scene->coarse->desc.triangles > desc->triangles)
        scene->coarse_left_out = "what has to be kept leaves too many triangles";
    else if ((status = compile_coarse(scene, reterr)) == DRAPE_EINVAL)
        scene->coarse_left_out = "the coarse mesh cannot be sewn";
    if (scene->coarse_left_out)
        scene->coarse = dr_coarse_free(scene->coarse);
    scene->coarse_seconds = dr_clock() - began;
    return status == DRAPE_EINVAL ? DRAPE_OK : status;
}

/* Everything up to what only the solver needs: checks, welding, meshes, parts. */
static drape_status compile(const drape_scene_desc *desc, drape_scene **ret, drape_error *reterr)
{
    drape_status status;
    size_t nodes = 0;
    drape_scene *scene = NULL;
    drape_error error; /* blame_seam reads it */
    if (!reterr)
        reterr = &error;
    if ((status = check_counts(desc, reterr)) < 0 || (status = check_numbers(desc, reterr)) < 0 ||
        (status = check_indices(desc, reterr)) < 0 || (status = check_materials(desc, reterr)) < 0)
        return status;
    for (size_t b = 0; b < desc->bodies; b++)
        if ((status = dr_body_check(desc->body + b, (int64_t)b, reterr)) < 0)
            return status;
    if (has_lines(desc) && (status = dr_lines_check(desc, reterr)) < 0)
        return status;

    scene = calloc(1, sizeof *scene);
    if (!scene)
        return dr_out_of_memory(reterr);
    scene->vertices = desc->vertices;
    scene->materials = desc->materials;
    memcpy(scene->gravity, desc->gravity, sizeof scene->gravity);
    scene->self_contact = desc->self_contact;
    scene->thickness = desc->thickness;
    scene->positions = copy_of(desc->positions, 3 * desc->vertices, sizeof *scene->positions);
    scene->vertex_node = malloc(desc->vertices * sizeof *scene->vertex_node);
    if (!scene->positions || !copy_seams(desc, scene) || !copy_materials(desc, scene) ||
        !scene->vertex_node) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    scene->seam_gap = widest_seam(desc);
    if ((status = number_nodes(desc, scene->vertex_node, &nodes, reterr)) < 0 ||
        (status = check_pins(desc, scene->vertex_node, nodes, reterr)) < 0 ||
        (status = new_meshes(desc, scene, nodes, reterr)) < 0 ||
        (desc->start_pattern && (status = measure_change(desc, scene, reterr)) < 0) ||
        (status = share_nodes(desc, scene, reterr)) < 0 ||
        (has_lines(desc) && (status = dr_lines_compile(desc, scene, reterr)) < 0) ||
        (status = find_parts(desc, scene, reterr)) < 0 || (status = find_piece_parts(scene, reterr)) < 0)
        goto cleanup;
    *ret = scene;
    scene = NULL;

cleanup:
    drape_scene_free(scene);
    return status;
}

drape_status drape_scene_check(const drape_scene_desc *desc, drape_error *reterr)
{
    drape_scene *scene = NULL;
    drape_status status = compile(desc, &scene, reterr);
    drape_scene_free(scene);
    return status;
}

drape_status drape_scene_warnings(const drape_scene_desc *desc, drape_error ret[DRAPE_MAX_WARNINGS],
                                  size_t *ret_count, drape_error *reterr)
{
    size_t nodes;
    uint32_t *vertex_node = malloc(desc->vertices * sizeof *vertex_node);
    drape_status status = vertex_node ? DRAPE_OK : dr_out_of_memory(reterr);
    if (status >= 0)
        status = number_nodes(desc, vertex_node, &nodes, reterr);
    if (status >= 0)
        status = dr_seam_warnings(desc, vertex_node, ret, ret_count, reterr);
    free(vertex_node);
    return status;
}

drape_status drape_scene_new(const drape_scene_desc *desc, drape_scene **ret, drape_error *reterr)
{
    drape_scene *scene = NULL;
    drape_status status = compile(desc, &scene, reterr);
    if (status >= 0)
        status = new_bends(desc, scene, reterr);
    if (status >= 0)
        status = new_bodies(desc, scene, reterr);
    if (status >= 0)
        status = new_coarse(desc, scene, reterr);
    if (status < 0) {
        drape_scene_free(scene);
        return status;
    }
    *ret = scene;
    return DRAPE_OK;
}

drape_scene *drape_scene_free(drape_scene *scene)
{
    if (scene) {
        for (size_t b = 0; b < scene->bodies; b++) {
            if (scene->first_body && scene->first_body[b] != scene->body[b])
                dr_body_free(scene->first_body[b]);
            if (scene->path)
                free_path(scene->path[b]);
            dr_body_free(scene->body[b]);
        }
        if (scene->coarse) { /* else not even a call */
            drape_scene_free(scene->coarse_scene);
            dr_coarse_free(scene->coarse);
        }
        free(scene->path);
        free(scene->first_body);
        free(scene->body);
        free(scene->bar);
        free(scene->hinge);
        free(scene->tack);
        dr_bend_free(scene->pieces_bend);
        dr_bend_free(scene->bend);
        dr_mesh_free(scene->pieces);
        dr_mesh_free(scene->mesh);
        free(scene->old_stretch);
        free(scene->part);
        free(scene->part_held);
        free(scene->piece_part);
        free(scene->material);
        free(scene->curve_point);
        free(scene->seam);
        free(scene->vertex_node);
        free(scene->vertex_share);
        free(scene->positions);
        free(scene);
    }
    return NULL;
}

static size_t path_bytes(const struct dr_path *path)
{
    const drape_body *desc = &path->desc;
    return sizeof *path + (desc->keyframes + 1) * 3 * desc->vertices * sizeof *path->positions +
           3 * desc->triangles * sizeof *path->triangle;
}

size_t dr_scene_motion_bytes(const drape_scene *scene)
{
    size_t bytes = 0;
    for (size_t b = 0; b < scene->bodies; b++) {
        if (scene->path && scene->path[b])
            bytes += path_bytes(scene->path[b]);
        if (scene->first_body && scene->first_body[b] != scene->body[b])
            bytes += dr_body_bytes(scene->first_body[b]);
    }
    return bytes;
}

size_t dr_scene_coarse_bytes(const drape_scene *scene)
{
    if (!scene->coarse)
        return 0;
    size_t bytes = dr_coarse_bytes(scene->coarse) + dr_scene_bytes(scene->coarse_scene);
    for (size_t b = 0; b < scene->bodies; b++)
        if (dr_body_field(scene->body[b]))
            bytes -= drape_field_bytes(dr_body_field(scene->body[b])); /* shared */
    return bytes;
}

size_t dr_scene_bytes(const drape_scene *scene)
{
    size_t bytes = sizeof *scene + scene->vertices * (4 * sizeof(double) + sizeof(uint32_t)) +
                   2 * scene->seams * sizeof(uint32_t) + scene->materials * sizeof(drape_material) +
                   2 * scene->curve_points * sizeof(double) + dr_mesh_bytes(scene->mesh) +
                   scene->mesh->nodes * (sizeof(uint32_t) + sizeof(bool));
    bytes += scene->bars * sizeof *scene->bar + scene->hinges * sizeof *scene->hinge +
             scene->tacks * sizeof *scene->tack;
    if (scene->old_stretch)
        bytes += 3 * scene->mesh->triangles * sizeof *scene->old_stretch;
    if (scene->bend)
        bytes += dr_bend_bytes(scene->bend);
    if (scene->pieces)
        bytes += dr_mesh_bytes(scene->pieces) + dr_bend_bytes(scene->pieces_bend);
    if (scene->piece_part)
        bytes += scene->vertices * sizeof *scene->piece_part;
    for (size_t b = 0; b < scene->bodies; b++)
        bytes += dr_body_bytes(scene->body[b]);
    bytes += dr_scene_motion_bytes(scene) + dr_scene_coarse_bytes(scene);
    return bytes;
}

void dr_scene_weld(const drape_scene *scene, const double *v, double *x)
{
    memset(x, 0, 3 * scene->mesh->nodes * sizeof *x);
    for (size_t i = 0; i < scene->vertices; i++) {
        uint32_t node = scene->vertex_node[i];
        if (node == DR_NONE)
            continue;
        for (int d = 0; d < 3; d++)
            x[3 * (size_t)node + (size_t)d] += scene->vertex_share[i] * v[3 * i + (size_t)d];
    }
}

void dr_scene_unweld(const drape_scene *scene, const double *x, double *v)
{
    for (size_t i = 0; i < scene->vertices; i++)
        if (scene->vertex_node[i] != DR_NONE)
            memcpy(v + 3 * i, x + 3 * (size_t)scene->vertex_node[i], 3 * sizeof *v);
}
