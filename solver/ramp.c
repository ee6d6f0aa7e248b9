/* ramp.c - see ramp.h. */
#include "ramp.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

#define RAMP_STEP      0.06 /* of the logarithm of a length, per step */
#define RELAXATIONS    3    /* iterations between steps */
#define HOLD_BY_BODIES 1e-3 /* sum of the k_i over the stiffness of the growing cloth */
#define HOLD_BY_MASS   1e-6 /* likewise, for cloth that nothing carries */

/* ---- how far a pattern is from another --------------------------------------------------------- */

/* Stretch of triangle t: with G = (old edges)(new edges)^-1, U = (G'G)^1/2 in closed form. */
static void measure_stretch(const double *old_rest, const double *rest, double u[3])
{
    double det = rest[2] * rest[5] - rest[4] * rest[3], g[4];
    for (int r = 0; r < 2; r++) {
        double a = old_rest[2 + r], b = old_rest[4 + r];
        g[2 * r] = (a * rest[5] - b * rest[3]) / det;
        g[2 * r + 1] = (b * rest[2] - a * rest[4]) / det;
    }
    double uu = g[0] * g[0] + g[2] * g[2], uv = g[0] * g[1] + g[2] * g[3], vv = g[1] * g[1] + g[3] * g[3];
    double root = fabs(g[0] * g[3] - g[1] * g[2]), size = sqrt(uu + vv + 2 * root);
    u[0] = (uu + root) / size;
    u[1] = uv / size;
    u[2] = (vv + root) / size;
}

/* By how much U changes a length at most, relative to the shorter. */
static double change_of(const double u[3])
{
    double mean = (u[0] + u[2]) / 2, radius = hypot((u[0] - u[2]) / 2, u[1]);
    return fmax(mean + radius, 1 / (mean - radius)) - 1;
}

drape_status dr_ramp_measure(const struct dr_mesh *old_mesh, const struct dr_mesh *mesh, double **ret,
                             double *ret_change, drape_error *reterr)
{
    double *u = malloc(3 * mesh->triangles * sizeof *u), change = 0;
    if (!u)
        return dr_out_of_memory(reterr);
    for (size_t t = 0; t < mesh->triangles; t++) {
        measure_stretch(old_mesh->rest + 6 * t, mesh->rest + 6 * t, u + 3 * t);
        change = fmax(change, change_of(u + 3 * t));
    }
    *ret = u;
    *ret_change = change;
    return DRAPE_OK;
}

uint32_t dr_ramp_steps(double change)
{
    return (uint32_t)ceil(log1p(change) / RAMP_STEP);
}

/* ---- growing ----------------------------------------------------------------------------------- */

/* V = I + rest (U - I), the stretch with that part of the way to go. */
static void stretch_left(const double u[3], double rest, double v[3])
{
    v[0] = 1 + rest * (u[0] - 1);
    v[1] = rest * u[1];
    v[2] = 1 + rest * (u[2] - 1);
}

/* W = V0^-1 V1 - I: what the deformation of the new rest shape is to grow by. */
static void growth_of(const double u[3], double before, double after, double w[4])
{
    double a[3], b[3];
    stretch_left(u, before, a);
    stretch_left(u, after, b);
    double det = a[0] * a[2] - a[1] * a[1];
    w[0] = (a[2] * b[0] - a[1] * b[1]) / det - 1;
    w[1] = (a[2] * b[1] - a[1] * b[2]) / det;
    w[2] = (a[0] * b[1] - a[1] * b[0]) / det;
    w[3] = (a[0] * b[2] - a[1] * b[1]) / det - 1;
}

/* Adds triangle t's share of the Laplacian to the matrix and what it is to grow by to the right-hand side b.
 */
static void add_triangle(struct dr_cloth *cloth, size_t t, const double w[4], const double *x, double *b)
{
    const struct dr_mesh *mesh = cloth->mesh;
    const uint32_t *node = mesh->triangle + 3 * t;
    const double *grad = mesh->grad + 6 * t;
    double H[9][9] = {{0}}, f[3][2] = {{0}};
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++)
            for (int c = 0; c < 2; c++)
                f[d][c] += x[3 * (size_t)node[k] + (size_t)d] * grad[2 * k + c];
    for (int k = 0; k < 3; k++)
        for (int d = 0; d < 3; d++) {
            double grown_u = f[d][0] * w[0] + f[d][1] * w[2], grown_v = f[d][0] * w[1] + f[d][1] * w[3];
            b[3 * (size_t)node[k] + (size_t)d] +=
                mesh->area[t] * (grad[2 * k] * grown_u + grad[2 * k + 1] * grown_v);
            for (int l = 0; l < 3; l++)
                H[3 * k + d][3 * l + d] =
                    mesh->area[t] * (grad[2 * k] * grad[2 * l] + grad[2 * k + 1] * grad[2 * l + 1]);
        }
    dr_matrix_add_triangle(cloth->A, t, (const double(*)[9])H);
}

/* Holds each node by its part of what the bodies carry. */
static void hold_by_bodies(struct dr_state *s)
{
    size_t nodes = s->cloth->mesh->nodes;
    double *load = s->x_next, *one = s->f_next, *none = one + nodes, *force = none + nodes, sum = 0;
    for (size_t i = 0; i < nodes; i++) {
        one[i] = 1;
        none[i] = 0;
    }
    dr_contact_loads(s->cloth->contact, s->x, one, none, load, force);
    for (size_t i = 0; i < nodes; i++)
        sum += force[i];
    for (size_t i = 0; i < nodes && sum > 0; i++) {
        double k = HOLD_BY_BODIES * force[i] / sum;
        dr_matrix_add_node(s->cloth->A, (uint32_t)i, (const double[]){k, 0, k, 0, 0, k});
    }
}

/* The cloth grows with its pattern while what is left of the way goes from `before` to `after`. */
static drape_status grow(struct dr_state *s, double before, double after, drape_error *reterr)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    size_t count = 3 * mesh->nodes;
    double *b = s->best, mass = 0, w[4]; /* free until the drape */
    enum dr_factored factored;
    for (size_t i = 0; i < mesh->nodes; i++)
        mass += mesh->mass[i];
    dr_matrix_set_base(s->cloth->A, HOLD_BY_MASS / mass);
    dr_matrix_reset(s->cloth->A);
    memset(b, 0, count * sizeof *b);
    for (size_t t = 0; t < mesh->triangles; t++) {
        growth_of(s->sim->scene->old_stretch + 3 * t, before, after, w);
        add_triangle(s->cloth, t, w, s->x, b);
    }
    if (s->cloth->contact)
        hold_by_bodies(s);
    drape_status status = dr_sim_factorise(s->sim, s->cloth, &factored, reterr);
    if (status < 0 || factored != DR_FACTORED)
        return status; /* without time for this there is none for the drape, which will say so */
    status = dr_state_solve(s, 1, (const double *[]){b}, (double *[]){s->w}, reterr);
    if (status < 0)
        return status;
    if (s->cloth->contact)
        dr_contact_clip(s->cloth->contact, s->x, s->w, DR_CONTACT_DEPTH);
    if (s->cloth->self)
        dr_self_clip(s->cloth->self, s->x, s->w);
    for (size_t i = 0; i < count; i++)
        s->x[i] += s->w[i];
    return DRAPE_OK;
}

/* ---- relaxing ---------------------------------------------------------------------------------- */

/* The membrane of a rest shape on the way; all else stays that of the new pattern. */
struct between {
    struct dr_mesh mesh; /* borrows all but areas and gradients */
    struct dr_stretch *stretch;
};

static void between_done(struct between *between)
{
    free(between->mesh.area);
    free(between->mesh.grad);
    dr_stretch_free(between->stretch);
}

static drape_status between_new(const drape_scene *scene, struct between *ret, drape_error *reterr)
{
    const struct dr_mesh *mesh = scene->mesh;
    *ret = (struct between){.mesh = *mesh};
    ret->mesh.area = malloc(mesh->triangles * sizeof *mesh->area);
    ret->mesh.grad = malloc(6 * mesh->triangles * sizeof *mesh->grad);
    drape_status status = ret->mesh.area && ret->mesh.grad ? DRAPE_OK : dr_out_of_memory(reterr);
    if (status >= 0)
        status = dr_stretch_new(&ret->mesh, scene->material, scene->materials, &ret->stretch, reterr);
    if (status < 0) {
        between_done(ret);
        *ret = (struct between){.stretch = NULL};
    }
    return status;
}

static size_t between_bytes(const struct between *between)
{
    return 7 * between->mesh.triangles * sizeof(double) + dr_stretch_bytes(between->stretch);
}

/* Rest coordinates V times the new ones: gradients V^-1 times theirs. */
static void between_set(struct between *between, const drape_scene *scene, double rest)
{
    const struct dr_mesh *mesh = scene->mesh;
    for (size_t t = 0; t < mesh->triangles; t++) {
        double v[3];
        stretch_left(scene->old_stretch + 3 * t, rest, v);
        double det = v[0] * v[2] - v[1] * v[1];
        between->mesh.area[t] = mesh->area[t] * det;
        for (int k = 0; k < 3; k++) {
            const double *g = mesh->grad + 6 * t + 2 * k;
            double *to = between->mesh.grad + 6 * t + 2 * k;
            to[0] = (v[2] * g[0] - v[1] * g[1]) / det;
            to[1] = (v[0] * g[1] - v[1] * g[0]) / det;
        }
    }
}

static drape_status relax(struct dr_state *s, drape_error *reterr)
{
    for (uint32_t i = 0; i < RELAXATIONS && !s->gave_up && !dr_sim_interrupted(s->sim); i++) {
        if (s->cloth->friction)
            dr_friction_update(s->cloth->friction, s->x);
        s->row.iteration = i;
        dr_cloth_energy(s->cloth, s->x, &s->row.energy, s->f);
        s->row.residual_force = dr_cloth_largest_force(s->cloth, s->f) / s->weight;
        if (!isfinite(s->row.residual_force + s->row.energy.potential))
            return DRAPE_OK; /* the drape will say so */
        dr_stretch_stress(s->cloth->stretch, s->x, NULL, s->cloth->stress);
        drape_status status = s->method->assess(s, reterr);
        s->row.seconds = dr_clock() - s->sim->began;
        dr_sim_tell(s->sim, &(drape_progress){DRAPE_PHASE_RAMPING, s->row, 0, 0});
        if (status >= 0 && !s->gave_up)
            status = s->method->advance(s, reterr);
        if (status < 0)
            return status;
        if (s->v)
            memset(s->v, 0, 3 * s->cloth->mesh->nodes * sizeof *s->v);
        s->sim->report.ramp_iterations++;
    }
    return DRAPE_OK;
}

drape_status dr_ramp(struct dr_state *s, drape_error *reterr)
{
    const drape_scene *scene = s->sim->scene;
    struct dr_stretch *stretch = s->cloth->stretch;
    struct between between = {.stretch = NULL};
    uint32_t steps = dr_ramp_steps(scene->change);
    drape_status status = steps > 1 ? between_new(scene, &between, reterr) : DRAPE_OK;
    for (uint32_t k = 1; k <= steps && status >= 0 && !dr_sim_interrupted(s->sim); k++) {
        double before = 1 - (k - 1.0) / steps, after = 1 - (double)k / steps;
        status = grow(s, before, after, reterr);
        if (status < 0 || k == steps)
            break;
        between_set(&between, scene, after);
        s->cloth->stretch = between.stretch;
        status = relax(s, reterr);
        s->cloth->stretch = stretch;
    }
    if (between.stretch)
        s->sim->plan.term[DR_TERM_RAMP].bytes += between_bytes(&between);
    between_done(&between);
    s->row.iteration = s->row.factorizations = s->row.linear_iterations = 0;
    s->fresh = true;
    s->moving = false;
    s->sim->report.ramp_steps = steps;
    return status;
}
