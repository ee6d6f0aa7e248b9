/* fit.c - measures strain, stress, pressure and gap of a drape. */
#include "fit.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

struct dr_fit {
    const drape_scene *scene;
    drape_fit result;                 /* points to the arrays below */
    double *strain, *stress;          /* 3*triangles */
    double *utilization;              /* 3*triangles; NULL without curves */
    double *pressure, *gap;           /* vertices */
    double *one, *zero, *load, *push; /* of the nodes, see measure_pressure; NULL without bodies */
    double *area;                     /* nodes: a third of each incident rest area, m^2; likewise */
    size_t numbers;
    double number[]; /* all of them */
};

/* The next `count` of the numbers. */
static double *take(struct dr_fit *fit, size_t *used, size_t count)
{
    double *start = fit->number + *used;
    *used += count;
    return start;
}

static void lay_out(struct dr_fit *fit)
{
    const drape_scene *scene = fit->scene;
    size_t used = 0, triangles = scene->mesh->triangles, nodes = scene->mesh->nodes;
    fit->strain = take(fit, &used, 3 * triangles);
    fit->stress = take(fit, &used, 3 * triangles);
    if (scene->curve_points)
        fit->utilization = take(fit, &used, 3 * triangles);
    fit->pressure = take(fit, &used, scene->vertices);
    fit->gap = take(fit, &used, scene->vertices);
    if (scene->bodies) {
        fit->one = take(fit, &used, nodes);
        fit->zero = take(fit, &used, nodes);
        fit->load = take(fit, &used, 3 * nodes);
        fit->push = take(fit, &used, nodes);
        fit->area = take(fit, &used, nodes);
    }
    assert(used == fit->numbers);
    fit->result = (drape_fit){scene->vertices,  triangles,     fit->strain, fit->stress,
                              fit->utilization, fit->pressure, fit->gap};
}

drape_status dr_fit_new(const drape_scene *scene, struct dr_fit **ret, drape_error *reterr)
{
    size_t numbers = (scene->curve_points ? 9 : 6) * scene->mesh->triangles + 2 * scene->vertices +
                     (scene->bodies ? 7 : 0) * scene->mesh->nodes;
    struct dr_fit *fit = calloc(1, sizeof *fit + numbers * sizeof *fit->number);
    if (!fit)
        return dr_out_of_memory(reterr);
    fit->scene = scene;
    fit->numbers = numbers;
    lay_out(fit);
    *ret = fit;
    return DRAPE_OK;
}

struct dr_fit *dr_fit_free(struct dr_fit *fit)
{
    free(fit);
    return NULL;
}

size_t dr_fit_bytes(const struct dr_fit *fit)
{
    return sizeof *fit + fit->numbers * sizeof *fit->number;
}

const drape_fit *dr_fit_result(const struct dr_fit *fit)
{
    return &fit->result;
}

/* ---- the cloth ---------------------------------------------------------------------------------- */

/* Where a curve ends; NAN without one. */
static double limit_of(const drape_curve *curve)
{
    return curve->points ? curve->point[2 * curve->points - 2] : NAN;
}

/* How far strains e go towards the limits: the curves of yarns are on elongation, l - 1 with
 * l = sqrt(1 + 2E), that of shear on 2 E_uv. */
static void utilize(const drape_material *material, const double e[3], double ret[3])
{
    const drape_curve *const yarn[] = {&material->curve_weft, &material->curve_warp};
    for (int i = 0; i < 2; i++) {
        double elongation = e[i] > 0 ? 2 * e[i] / (1 + sqrt(1 + 2 * e[i])) : 0;
        ret[i] = elongation / limit_of(yarn[i]);
    }
    ret[2] = fabs(e[2]) / limit_of(&material->curve_shear);
}

static void measure_cloth(struct dr_fit *fit, const struct dr_cloth *cloth, const double *x)
{
    const struct dr_mesh *mesh = cloth->mesh;
    dr_stretch_strain(cloth->stretch, x, fit->strain);
    dr_stretch_stress(cloth->stretch, x, NULL, fit->stress);
    for (size_t t = 0; fit->utilization && t < mesh->triangles; t++)
        utilize(fit->scene->material + mesh->material[t], fit->strain + 3 * t, fit->utilization + 3 * t);
}

/* ---- the bodies --------------------------------------------------------------------------------- */

/* What friction of coefficient one could hold is the sum of the sizes of the forces. */
static void measure_pressure(struct dr_fit *fit, const struct dr_cloth *cloth, const double *x)
{
    const struct dr_mesh *mesh = cloth->mesh;
    for (size_t n = 0; n < mesh->nodes; n++)
        fit->one[n] = 1;
    dr_contact_loads(cloth->contact, x, fit->one, fit->zero, fit->load, fit->push);
    memset(fit->area, 0, mesh->nodes * sizeof *fit->area);
    for (size_t i = 0; i < 3 * mesh->triangles; i++)
        fit->area[mesh->triangle[i]] += mesh->area[i / 3] / 3;
    for (size_t i = 0; i < fit->scene->vertices; i++) {
        uint32_t node = fit->scene->vertex_node[i];
        fit->pressure[i] = node == DR_NONE ? 0 : fit->push[node] / fit->area[node];
    }
}

/* NAN beyond the reach of every body. */
static double gap_at(const drape_scene *scene, const double x[3])
{
    double least = NAN;
    for (size_t b = 0; b < scene->bodies; b++) {
        double phi, unused[3];
        if (dr_body_distance(scene->body[b], x, &phi, unused))
            least = fmin(least, phi); /* of NAN and a number, the number */
    }
    return least;
}

void dr_fit_measure(struct dr_fit *fit, const struct dr_cloth *cloth, const double *x)
{
    const drape_scene *scene = fit->scene;
    measure_cloth(fit, cloth, x);
    if (cloth->contact)
        measure_pressure(fit, cloth, x);
    for (size_t i = 0; i < scene->vertices; i++) {
        uint32_t node = scene->vertex_node[i];
        fit->gap[i] = node == DR_NONE ? NAN : gap_at(scene, x + 3 * (size_t)node);
    }
}
