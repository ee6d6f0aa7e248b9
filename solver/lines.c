/* lines.c - see lines.h. */
#include "lines.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

/* ---- checks ------------------------------------------------------------------------------------- */

/* Elastics and folds are checked alike. */
struct kind {
    drape_place line, edge;
};

static const struct kind ELASTIC = {DRAPE_AT_ELASTIC, DRAPE_AT_ELASTIC_EDGE};
static const struct kind FOLD = {DRAPE_AT_FOLD, DRAPE_AT_FOLD_EDGE};

static drape_status check_number(const struct kind *kind, size_t line, const char *member, double value,
                                 double least, double most, drape_error *reterr)
{
    if (value >= least && value <= most)
        return DRAPE_OK;
    return dr_fail_at(reterr, DRAPE_EINVAL, kind->line, (int64_t)line, -1, member,
                      "%g is not between %g and %g", value, least, most);
}

static drape_status check_edges(const struct kind *kind, size_t line, const uint32_t *edge, size_t edges,
                                size_t vertices, size_t *sum, drape_error *reterr)
{
    if (edges && !edge)
        return dr_fail_at(reterr, DRAPE_EINVAL, kind->line, (int64_t)line, -1, "edge",
                          "the array is missing");
    if (edges > DRAPE_MAX_LINE_EDGES - *sum)
        return dr_fail_at(reterr, DRAPE_EINVAL, kind->line, (int64_t)line, -1, "edge",
                          "with it there are more edges than the limit of %d", DRAPE_MAX_LINE_EDGES);
    *sum += edges;
    for (size_t i = 0; i < 2 * edges; i++)
        if (edge[i] >= vertices)
            return dr_fail_at(reterr, DRAPE_EINVAL, kind->edge, (int64_t)(i / 2), (int64_t)line, NULL,
                              "vertex %u does not exist: there are %zu", edge[i], vertices);
    return DRAPE_OK;
}

static drape_status check_elastics(const drape_scene_desc *desc, drape_error *reterr)
{
    size_t edges = 0;
    drape_status status = DRAPE_OK;
    for (size_t i = 0; i < desc->elastics && status >= 0; i++) {
        const drape_elastic *elastic = desc->elastic + i;
        status =
            check_number(&ELASTIC, i, "factor", elastic->factor, DRAPE_MIN_FACTOR, DRAPE_MAX_FACTOR, reterr);
        if (status >= 0)
            status = check_number(&ELASTIC, i, "stiffness", elastic->stiffness, DRAPE_MIN_MATERIAL,
                                  DRAPE_MAX_MATERIAL, reterr);
        if (status >= 0)
            status = check_edges(&ELASTIC, i, elastic->edge, elastic->edges, desc->vertices, &edges, reterr);
    }
    return status;
}

static drape_status check_folds(const drape_scene_desc *desc, drape_error *reterr)
{
    size_t edges = 0;
    drape_status status = DRAPE_OK;
    for (size_t i = 0; i < desc->folds && status >= 0; i++) {
        const drape_fold *fold = desc->fold + i;
        status = check_number(&FOLD, i, "angle", fold->angle, -M_PI, M_PI, reterr);
        if (status >= 0)
            status = check_number(&FOLD, i, "stiffness", fold->stiffness, DRAPE_MIN_MATERIAL,
                                  DRAPE_MAX_MATERIAL, reterr);
        if (status >= 0)
            status = check_edges(&FOLD, i, fold->edge, fold->edges, desc->vertices, &edges, reterr);
    }
    return status;
}

/* Where a tack holds: a point, or one of a triangle of a mesh. */
static drape_status check_hold(const drape_scene_desc *desc, const drape_tack *tack, int64_t i,
                               drape_error *reterr)
{
    const drape_body *body = desc->body + tack->body;
    const double *b = tack->barycentric;
    if (tack->triangle == DRAPE_NO_TRIANGLE) {
        for (int d = 0; d < 3; d++)
            if (!(fabs(tack->point[d]) <= DRAPE_MAX_COORDINATE))
                return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, i, -1, "point",
                                  "the point is not finite and within %g m", DRAPE_MAX_COORDINATE);
        if (body->keyframes)
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, i, -1, "point",
                              "body %u moves: only a point of one of its triangles moves along", tack->body);
        return DRAPE_OK;
    }
    if (body->kind != DRAPE_BODY_MESH)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, i, -1, "triangle",
                          "body %u has no triangles: it is no mesh", tack->body);
    if (tack->triangle >= body->triangles)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, i, -1, "triangle",
                          "triangle %u does not exist: body %u has %zu", tack->triangle, tack->body,
                          body->triangles);
    if (!(b[0] >= 0 && b[1] >= 0 && b[0] + b[1] <= 1))
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, i, -1, "barycentric",
                          "the weights %g and %g are not both >= 0 and at most 1 together", b[0], b[1]);
    return DRAPE_OK;
}

static drape_status check_tacks(const drape_scene_desc *desc, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    for (size_t i = 0; i < desc->tacks && status >= 0; i++) {
        const drape_tack *tack = desc->tack + i;
        if (tack->vertex >= desc->vertices)
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, (int64_t)i, -1, "vertex",
                              "vertex %u does not exist: there are %zu", tack->vertex, desc->vertices);
        if (tack->body >= desc->bodies)
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, (int64_t)i, -1, "body",
                              "body %u does not exist: there are %zu", tack->body, desc->bodies);
        status = check_hold(desc, tack, (int64_t)i, reterr);
    }
    return status;
}

drape_status dr_lines_check(const drape_scene_desc *desc, drape_error *reterr)
{
    drape_status status = check_elastics(desc, reterr);
    if (status >= 0)
        status = check_folds(desc, reterr);
    if (status >= 0)
        status = check_tacks(desc, reterr);
    return status;
}

/* ---- edges ---------------------------------------------------------------------------------------- */

/* A side of a triangle, by the vertices of the job. */
struct side {
    uint32_t low, high; /* low < high */
    uint32_t triangle;
    uint32_t corner; /* opposite this side */
};

static int compare_vertices(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    return (a->high > b->high) - (a->high < b->high);
}

static int compare_sides(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    int order = compare_vertices(a, b);
    return order ? order : (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

static struct side side_of(uint32_t a, uint32_t b, size_t triangle, uint32_t corner)
{
    return (struct side){a < b ? a : b, a < b ? b : a, (uint32_t)triangle, corner};
}

/* All sides, sorted; NULL: out of memory. */
static struct side *sort_sides(const drape_scene_desc *desc)
{
    size_t count = 3 * desc->triangles;
    struct side *side = malloc(count * sizeof *side);
    for (uint32_t i = 0; side && i < count; i++) {
        const uint32_t *corner = desc->triangle + i / 3 * 3;
        side[i] = side_of(corner[(i + 1) % 3], corner[(i + 2) % 3], i / 3, i % 3);
    }
    if (side)
        qsort(side, count, sizeof *side, compare_sides);
    return side;
}

/* One of the sides at edge i of a line; NULL: there is none. */
static const struct side *find_side(const struct side *side, size_t triangles, const uint32_t *edge)
{
    struct side wanted = side_of(edge[0], edge[1], 0, 0);
    return bsearch(&wanted, side, 3 * triangles, sizeof *side, compare_vertices);
}

static drape_status no_edge(const struct kind *kind, size_t line, size_t i, const uint32_t *edge,
                            drape_error *reterr)
{
    return dr_fail_at(reterr, DRAPE_EINVAL, kind->edge, (int64_t)i, (int64_t)line, NULL,
                      "vertices %u and %u are not two corners of one triangle", edge[2 * i], edge[2 * i + 1]);
}

/* ---- compiling ------------------------------------------------------------------------------------ */

static drape_status compile_elastics(const drape_scene_desc *desc, const struct side *side,
                                     drape_scene *scene, drape_error *reterr)
{
    size_t count = 0;
    for (size_t i = 0; i < desc->elastics; i++)
        count += desc->elastic[i].edges;
    if (count && !(scene->bar = malloc(count * sizeof *scene->bar)))
        return dr_out_of_memory(reterr);
    for (size_t i = 0; i < desc->elastics; i++) {
        const drape_elastic *elastic = desc->elastic + i;
        for (size_t k = 0; k < elastic->edges; k++) {
            const uint32_t *edge = elastic->edge + 2 * k;
            const double *a = desc->pattern + 2 * (size_t)edge[0], *b = desc->pattern + 2 * (size_t)edge[1];
            if (!find_side(side, desc->triangles, edge))
                return no_edge(&ELASTIC, i, k, elastic->edge, reterr);
            scene->bar[scene->bars++] = (struct dr_bar){
                .node = {scene->vertex_node[edge[0]], scene->vertex_node[edge[1]]},
                .rest = elastic->factor * hypot(b[0] - a[0], b[1] - a[1]),
                .stiffness = elastic->stiffness,
            };
        }
    }
    return DRAPE_OK;
}

/* How much the cloth between the fold and the middle of its flat triangle t turns under a moment of 1 N m per
 * metre, rad: the edge opposite corner k has a slope of its own in bend.c, held by the energy
 * area/2 (2/h)^2 m(n)'D m(n) of its difference from the flat triangle's. 0: it stays flat. */
static double compliance(const drape_scene_desc *desc, const struct dr_mesh *mesh, size_t t, size_t k)
{
    const drape_material *material = desc->material + mesh->material[t];
    const uint32_t *node = mesh->triangle + 3 * t;
    const double *grad = mesh->grad + 6 * t + 2 * k; /* across the edge, 1/h long */
    double square = grad[0] * grad[0] + grad[1] * grad[1];
    double m[3] = {grad[0] * grad[0] / square, grad[1] * grad[1] / square, 2 * grad[0] * grad[1] / square};
    double rigidity = material->bend_weft * m[0] * m[0] + material->bend_warp * m[1] * m[1] +
                      material->bend_twist * m[2] * m[2];
    bool held = mesh->held[node[0]] && mesh->held[node[1]] && mesh->held[node[2]];
    return rigidity > 0 && !held ? 0.5 / (sqrt(square) * rigidity) : 0;
}

/* The hinge of one side in the welded mesh, seen from its triangle; NULL, or why there is none. Between its
 * flat triangles the fold is in series with the cloth beside it: without that a fold that is stiff for its
 * mesh would stiffen a row of triangles on either side. */
static const char *find_hinge(const drape_scene_desc *desc, const struct dr_mesh *mesh,
                              const struct side *side, const drape_fold *fold, struct dr_hinge *ret)
{
    size_t t = side->triangle, k = side->corner, i = (k + 1) % 3, j = (k + 2) % 3;
    const uint32_t *node = mesh->triangle + 3 * t;
    const double *A = mesh->rest + 6 * t + 2 * i, *B = mesh->rest + 6 * t + 2 * j;
    size_t neighbor = mesh->neighbor[3 * t + k], across = mesh->across[3 * t + k];
    if (neighbor == DR_NONE)
        return "there is cloth on one side only, nothing to fold";
    double beside = compliance(desc, mesh, t, k) + compliance(desc, mesh, neighbor, across);
    *ret = (struct dr_hinge){
        .node = {node[i], node[j], node[k], mesh->triangle[3 * neighbor + across]},
        .weight = hypot(B[0] - A[0], B[1] - A[1]) / (1 / fold->stiffness + beside),
        .rest = fold->angle,
    };
    return ret->node[2] == ret->node[3] ? "its two triangles have the same corners" : NULL;
}

static drape_status compile_folds(const drape_scene_desc *desc, const struct side *side, drape_scene *scene,
                                  drape_error *reterr)
{
    size_t count = 0;
    for (size_t i = 0; i < desc->folds; i++)
        count += desc->fold[i].edges;
    if (count && !(scene->hinge = malloc(count * sizeof *scene->hinge)))
        return dr_out_of_memory(reterr);
    for (size_t i = 0; i < desc->folds; i++) {
        const drape_fold *fold = desc->fold + i;
        for (size_t k = 0; k < fold->edges; k++) {
            const struct side *at = find_side(side, desc->triangles, fold->edge + 2 * k);
            if (!at)
                return no_edge(&FOLD, i, k, fold->edge, reterr);
            const char *why = find_hinge(desc, scene->mesh, at, fold, scene->hinge + scene->hinges);
            if (why)
                return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_FOLD_EDGE, (int64_t)k, (int64_t)i, NULL,
                                  "%s", why);
            scene->hinges++;
        }
    }
    return DRAPE_OK;
}

static drape_status compile_tacks(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    scene->tack = malloc(desc->tacks * sizeof *scene->tack);
    if (!scene->tack)
        return dr_out_of_memory(reterr);
    for (size_t i = 0; i < desc->tacks; i++) {
        const drape_tack *from = desc->tack + i;
        const drape_body *body = desc->body + from->body;
        uint32_t node = scene->vertex_node[from->vertex];
        if (node == DR_NONE || scene->mesh->held[node])
            return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_TACK, (int64_t)i, -1, "vertex",
                              node == DR_NONE ? "vertex %u belongs to no triangle" : "vertex %u is pinned",
                              from->vertex);
        struct dr_tack *to = scene->tack + scene->tacks++;
        *to = (struct dr_tack){.vertex = from->vertex,
                               .node = node,
                               .body = from->body,
                               .triangle = from->triangle,
                               .barycentric = {from->barycentric[0], from->barycentric[1]},
                               .at = {from->point[0], from->point[1], from->point[2]}};
        memcpy(to->first, to->at, sizeof to->first);
        if (from->triangle == DRAPE_NO_TRIANGLE)
            continue;
        const uint32_t *triangle = body->triangle + 3 * (size_t)from->triangle;
        const double *last = body->keyframes ? body->keyframe[body->keyframes - 1] : body->positions;
        dr_tack_point(triangle, body->positions, to->barycentric, to->first);
        dr_tack_point(triangle, last, to->barycentric, to->at);
    }
    return DRAPE_OK;
}

drape_status dr_lines_compile(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    if (desc->elastics || desc->folds) {
        struct side *side = sort_sides(desc);
        status = side ? compile_elastics(desc, side, scene, reterr) : dr_out_of_memory(reterr);
        if (status >= 0)
            status = compile_folds(desc, side, scene, reterr);
        free(side);
    }
    return status >= 0 && desc->tacks ? compile_tacks(desc, scene, reterr) : status;
}

void dr_lines_lift(drape_scene *scene)
{
    struct dr_body *const *first = scene->first_body ? scene->first_body : scene->body;
    for (size_t i = 0; i < scene->tacks; i++) {
        struct dr_tack *tack = scene->tack + i;
        dr_tack_lift(scene->body[tack->body], tack->at);
        dr_tack_lift(first[tack->body], tack->first);
    }
}

/* ---- bending ------------------------------------------------------------------------------------- */

static int compare_keys(const void *left, const void *right)
{
    uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

static uint64_t key_of(uint32_t a, uint32_t b)
{
    return (uint64_t)(a < b ? a : b) << 32 | (a < b ? b : a);
}

struct dr_mesh dr_lines_cut(const struct dr_mesh *mesh, const struct dr_hinge *hinge, size_t hinges)
{
    struct dr_mesh cut = *mesh;
    uint64_t *key = malloc(hinges * sizeof *key);
    cut.neighbor = malloc(3 * mesh->triangles * sizeof *cut.neighbor);
    if (!key || !cut.neighbor) {
        free(key);
        free(cut.neighbor);
        cut.neighbor = NULL;
        return cut;
    }
    for (size_t i = 0; i < hinges; i++)
        key[i] = key_of(hinge[i].node[0], hinge[i].node[1]);
    qsort(key, hinges, sizeof *key, compare_keys);
    for (size_t s = 0; s < 3 * mesh->triangles; s++) {
        const uint32_t *node = mesh->triangle + s / 3 * 3;
        uint64_t edge = key_of(node[(s + 1) % 3], node[(s + 2) % 3]);
        bool folded = bsearch(&edge, key, hinges, sizeof *key, compare_keys) != NULL;
        cut.neighbor[s] = folded ? DR_NONE : mesh->neighbor[s];
    }
    free(key);
    return cut;
}
