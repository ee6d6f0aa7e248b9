/* friction.c - see friction.h. */
#include "friction.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

struct anchor {
    double at[3];     /* m */
    double normal[3]; /* of the surface there, unit */
    double limit;     /* N: mu times the normal force; 0: the node holds on to nothing */
};

struct dr_friction {
    struct dr_contact *contact;
    size_t nodes;
    struct anchor *anchor; /* nodes */
    double *own, *rest;    /* nodes: the coefficient against a body of mu is own + rest mu */
    double *load, *grip;   /* 3*nodes, nodes: scratch of an update */
};

/* ---- made and freed -------------------------------------------------------------------------- */

void dr_friction_coefficients(const struct dr_mesh *mesh, const drape_material *material, double *own,
                              double *rest, double *area)
{
    for (size_t v = 0; v < mesh->nodes; v++)
        own[v] = rest[v] = area[v] = 0;
    for (size_t t = 0; t < mesh->triangles; t++)
        for (int k = 0; k < 3; k++) {
            size_t v = mesh->triangle[3 * t + (size_t)k];
            double mu = material[mesh->material[t]].friction;
            area[v] += mesh->area[t];
            own[v] += mesh->area[t] * mu;
            rest[v] += mu > 0 ? 0 : mesh->area[t];
        }
    for (size_t v = 0; v < mesh->nodes; v++) {
        own[v] /= area[v];
        rest[v] /= area[v];
    }
}

drape_status dr_friction_new(struct dr_contact *contact, const struct dr_mesh *mesh,
                             const drape_material *material, struct dr_friction **ret, drape_error *reterr)
{
    struct dr_friction *friction = calloc(1, sizeof *friction);
    if (!friction)
        return dr_out_of_memory(reterr);
    size_t nodes = mesh->nodes;
    friction->contact = contact;
    friction->nodes = nodes;
    friction->anchor = calloc(nodes, sizeof *friction->anchor);
    friction->own = calloc(nodes, sizeof *friction->own);
    friction->rest = calloc(nodes, sizeof *friction->rest);
    friction->load = calloc(3 * nodes, sizeof *friction->load);
    friction->grip = calloc(nodes, sizeof *friction->grip);
    if (!friction->anchor || !friction->own || !friction->rest || !friction->load || !friction->grip) {
        dr_friction_free(friction);
        return dr_out_of_memory(reterr);
    }
    /* The grip is free until the first update. */
    dr_friction_coefficients(mesh, material, friction->own, friction->rest, friction->grip);
    *ret = friction;
    return DRAPE_OK;
}

struct dr_friction *dr_friction_free(struct dr_friction *friction)
{
    if (friction) {
        free(friction->anchor);
        free(friction->own);
        free(friction->rest);
        free(friction->load);
        free(friction->grip);
        free(friction);
    }
    return NULL;
}

size_t dr_friction_bytes(const struct dr_friction *friction)
{
    return sizeof *friction + friction->nodes * (sizeof *friction->anchor + 6 * sizeof(double));
}

/* ---- anchors --------------------------------------------------------------------------------- */

/* u = the part of x - a along the surface; returns its length. */
static double slip(const struct anchor *anchor, const double x[3], double u[3])
{
    double off = 0, square = 0;
    for (int d = 0; d < 3; d++)
        off += (x[d] - anchor->at[d]) * anchor->normal[d];
    for (int d = 0; d < 3; d++) {
        u[d] = x[d] - anchor->at[d] - off * anchor->normal[d];
        square += u[d] * u[d];
    }
    return sqrt(square);
}

/* After it the anchor lies in the surface through x, no farther than the slip. */
static void drag(struct anchor *anchor, const double x[3])
{
    double u[3], l = slip(anchor, x, u), keep = l > DR_FRICTION_SLIP ? DR_FRICTION_SLIP / l : 1;
    for (int d = 0; d < 3; d++)
        anchor->at[d] = x[d] - keep * u[d];
}

void dr_friction_update(struct dr_friction *friction, const double *x)
{
    dr_contact_loads(friction->contact, x, friction->own, friction->rest, friction->load, friction->grip);
    for (size_t i = 0; i < friction->nodes; i++) {
        struct anchor *anchor = friction->anchor + i;
        const double *load = friction->load + 3 * i;
        double force = sqrt(load[0] * load[0] + load[1] * load[1] + load[2] * load[2]);
        if (!(friction->grip[i] > 0) || !(force > 0)) {
            anchor->limit = 0;
            continue;
        }
        for (int d = 0; d < 3; d++)
            anchor->normal[d] = load[d] / force;
        if (anchor->limit > 0)
            drag(anchor, x + 3 * i);
        else
            memcpy(anchor->at, x + 3 * i, sizeof anchor->at);
        anchor->limit = friction->grip[i];
    }
}

double dr_friction_let_go(const struct dr_friction *friction, const double *x, const double *w)
{
    double slipping = 0, all = 0;
    for (size_t i = 0; i < friction->nodes; i++) {
        const struct anchor *anchor = friction->anchor + i;
        const double *from = x + 3 * i, *move = w + 3 * i;
        double to[3] = {from[0] + move[0], from[1] + move[1], from[2] + move[2]}, unused[3];
        if (!(anchor->limit > 0))
            continue;
        bool held = slip(anchor, from, unused) < DR_FRICTION_SLIP;
        all += anchor->limit;
        slipping += held && slip(anchor, to, unused) > 2 * DR_FRICTION_SLIP ? anchor->limit : 0;
    }
    return all > 0 ? slipping / all : 0;
}

void dr_friction_carry(struct dr_friction *friction, const struct dr_motor *motor, const double centre[3])
{
    for (size_t i = 0; i < friction->nodes; i++) {
        struct anchor *anchor = friction->anchor + i;
        if (!(anchor->limit > 0))
            continue;
        dr_motor_move(motor + i, centre, anchor->at);
        dr_motor_turn(motor + i, anchor->normal);
    }
}

/* The slip at which E' is a force has its direction and the length s (1 - sqrt(1 - force/g)). */
double dr_friction_hold_more(double limit, double u[3], double more[3])
{
    double unused, secant, along, held[3], force = 0, change = 0;
    dr_friction_respond(limit, sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]), &unused, &secant, &along);
    for (int d = 0; d < 3; d++) {
        held[d] = secant * u[d];
        more[d] += held[d];
        force += more[d] * more[d];
    }
    force = sqrt(force);
    double part = fmin(force / limit, 1), cut = force > limit ? limit / force : 1;
    double length = force > 0 ? DR_FRICTION_SLIP * (1 - sqrt(1 - part)) / force : 0;
    for (int d = 0; d < 3; d++) {
        u[d] = length * more[d];
        more[d] = cut * more[d] - held[d];
        change += more[d] * more[d];
    }
    return sqrt(change);
}

static double brace(struct anchor *anchor, const double x[3], double f[3])
{
    double off = 0, more[3], u[3];
    slip(anchor, x, u);
    for (int d = 0; d < 3; d++)
        off += f[d] * anchor->normal[d];
    for (int d = 0; d < 3; d++)
        more[d] = f[d] - off * anchor->normal[d];
    double change = dr_friction_hold_more(anchor->limit, u, more);
    for (int d = 0; d < 3; d++) {
        anchor->at[d] = x[d] - u[d];
        f[d] -= more[d];
    }
    return change;
}

double dr_friction_brace(struct dr_friction *friction, const double *x, double *f)
{
    double most = 0;
    for (size_t i = 0; i < friction->nodes; i++)
        if (friction->anchor[i].limit > 0)
            most = fmax(most, brace(friction->anchor + i, x + 3 * i, f + 3 * i));
    return most;
}

/* ---- the potential --------------------------------------------------------------------------- */

void dr_friction_respond(double g, double l, double *ret_energy, double *ret_secant, double *ret_tangent)
{
    const double s = DR_FRICTION_SLIP;
    bool sticks = l < s;
    *ret_energy = sticks ? g * (l * l / s - l * l * l / (3 * s * s)) : g * (l - s / 3);
    *ret_secant = sticks ? g * (2 / s - l / (s * s)) : g / l;
    *ret_tangent = sticks ? g * (2 / s - 2 * l / (s * s)) : 0;
}

double dr_friction_energy(const struct dr_friction *friction, const double *x, double *g)
{
    double sum = 0;
    for (size_t i = 0; i < friction->nodes; i++) {
        const struct anchor *anchor = friction->anchor + i;
        double u[3], energy, secant, unused;
        if (!(anchor->limit > 0))
            continue;
        dr_friction_respond(anchor->limit, slip(anchor, x + 3 * i, u), &energy, &secant, &unused);
        sum += energy;
        for (int d = 0; g && d < 3; d++)
            g[3 * i + (size_t)d] += secant * u[d];
    }
    return sum;
}

void dr_friction_hessian(const struct dr_friction *friction, const double *x, double exact,
                         struct dr_matrix *A)
{
    for (size_t i = 0; i < friction->nodes; i++) {
        const struct anchor *anchor = friction->anchor + i;
        const double *n = anchor->normal;
        double u[3], H[6], unused, secant, tangent;
        if (!(anchor->limit > 0))
            continue;
        double l = slip(anchor, x + 3 * i, u);
        dr_friction_respond(anchor->limit, l, &unused, &secant, &tangent);
        double along = l > 0 ? exact * (tangent - secant) / (l * l) : 0;
        for (int r = 0, entry = 0; r < 3; r++)
            for (int c = 0; c <= r; c++)
                H[entry++] = secant * ((r == c) - n[r] * n[c]) + along * u[r] * u[c];
        dr_matrix_add_node(A, (uint32_t)i, H);
    }
}
