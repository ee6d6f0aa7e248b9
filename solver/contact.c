/* contact.c - the penalty that keeps cloth off bodies, and the limit on how far a step may enter one. */
#include "contact.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

/* A bound on how much the distance changes along a way, in lengths of it. It is 1 of exact distances; fields
 * add a few hundredths. */
#define STEEPEST 1.25

#define WORTH_SHARING 10000 /* distances: half of them take longer than waking somebody */

/* A sample of a triangle besides its corners. */
struct point {
    double share[3]; /* it moves with the corners' moves times these */
    double part;     /* of the triangle's rest area, that it stands for */
};

/* Those of a triangle whose sides are cut into so many pieces. */
struct pattern {
    const struct point *point;
    size_t points;
};

/* The distance of one sample to one body. */
struct sight {
    double phi, n[3]; /* m, its gradient; INFINITY: out of reach */
};

struct dr_contact {
    const struct dr_mesh *mesh;
    struct dr_body **body; /* bodies; the array is ours, the bodies are not */
    size_t bodies;
    double *node_area;                                 /* nodes: a third of each incident rest area, m^2 */
    uint8_t *pieces;                                   /* triangles: of a side, 1 to DR_CONTACT_MAX_PIECES */
    struct point *point;                               /* of all patterns in use */
    struct pattern pattern[DR_CONTACT_MAX_PIECES + 1]; /* by pieces; empty where not in use */
    size_t points, samples;                            /* of the patterns; of the cloth, nodes included */

    /* For distances and clipping: the second half begins with these nodes and triangles. */
    struct dr_hand *hand; /* NULL: they are not worth sharing, or nobody lends */
    size_t node_halfway, triangle_halfway, point_halfway;

    /* Where the cloth was last looked at: energy, Hessian, loads and gaps ask for one x after another. */
    bool looked;
    size_t moves;        /* of the bodies, then */
    double *at;          /* 3*nodes */
    struct sight *sight; /* samples*bodies, bodies of one sample together */
};

/* ---- where the cloth is sampled -------------------------------------------------------------- */

static size_t count_points(size_t pieces)
{
    return (pieces + 1) * (pieces + 2) / 2 - 3 + pieces * pieces;
}

static struct point make_point(double b, double c, double part)
{
    return (struct point){{1 - b - c, b, c}, part};
}

/* The triangle cut into pieces^2: each gives a sixth of its area to each of its corners and the other half to
 * its centroid. The triangle's own corners are nodes, which have weights of their own. Returns the number of
 * points; their parts sum to 1 - 1/(2 pieces^2). */
static size_t fill_pattern(size_t pieces, struct point *point)
{
    double side = 1.0 / (double)pieces, area = side * side;
    size_t points = 0;
    for (size_t i = 0; i <= pieces; i++)
        for (size_t j = 0; i + j <= pieces; j++) {
            size_t rims = (i == 0) + (j == 0) + (i + j == pieces);
            double b = (double)i, c = (double)j;
            if (rims < 2) /* three pieces meet on a side, six inside */
                point[points++] = make_point(b * side, c * side, rims ? area / 2 : area);
            if (i + j + 1 <= pieces)
                point[points++] = make_point((b + 1.0 / 3) * side, (c + 1.0 / 3) * side, area / 2);
            if (i + j + 2 <= pieces)
                point[points++] = make_point((b + 2.0 / 3) * side, (c + 2.0 / 3) * side, area / 2);
        }
    return points;
}

/* Into how many pieces a side is cut, so that none is longer than DR_CONTACT_SPACING at rest. */
static uint8_t count_pieces(const double rest[6])
{
    double longest = 0;
    for (int k = 0; k < 3; k++) {
        int next = (k + 1) % 3;
        longest = fmax(longest, hypot(rest[2 * next] - rest[2 * k], rest[2 * next + 1] - rest[2 * k + 1]));
    }
    return (uint8_t)fmin(fmax(ceil(longest / DR_CONTACT_SPACING), 1), DR_CONTACT_MAX_PIECES);
}

size_t dr_contact_points(const double rest[6])
{
    return count_points(count_pieces(rest));
}

/* Makes the patterns that the triangles need; false when out of memory. */
static bool make_patterns(struct dr_contact *contact)
{
    bool used[DR_CONTACT_MAX_PIECES + 1] = {false};
    for (size_t t = 0; t < contact->mesh->triangles; t++)
        used[contact->pieces[t]] = true;
    for (size_t n = 1; n <= DR_CONTACT_MAX_PIECES; n++)
        contact->points += used[n] ? count_points(n) : 0;
    contact->point = malloc((contact->points + 1) * sizeof *contact->point);
    if (!contact->point)
        return false;
    struct point *next = contact->point;
    for (size_t n = 1; n <= DR_CONTACT_MAX_PIECES; n++)
        if (used[n]) {
            contact->pattern[n] = (struct pattern){next, fill_pattern(n, next)};
            next += contact->pattern[n].points;
        }
    return true;
}

static bool make_sights(struct dr_contact *contact)
{
    size_t sights = contact->samples * contact->bodies;
    contact->at = malloc((3 * contact->mesh->nodes + 1) * sizeof *contact->at);
    contact->sight = malloc((sights + 1) * sizeof *contact->sight);
    return contact->at && contact->sight;
}

static void find_halves(struct dr_contact *contact)
{
    contact->node_halfway = contact->mesh->nodes / 2;
    contact->triangle_halfway = contact->mesh->triangles / 2;
    for (size_t t = 0; t < contact->triangle_halfway; t++)
        contact->point_halfway += contact->pattern[contact->pieces[t]].points;
}

/* ---- made and freed -------------------------------------------------------------------------- */

drape_status dr_contact_new(const struct dr_mesh *mesh, struct dr_body *const *body, size_t bodies,
                            struct dr_contact **ret, drape_error *reterr)
{
    struct dr_contact *contact = calloc(1, sizeof *contact);
    if (!contact)
        return dr_out_of_memory(reterr);
    contact->mesh = mesh;
    contact->bodies = bodies;
    contact->samples = mesh->nodes;
    contact->body = calloc(bodies ? bodies : 1, sizeof(struct dr_body *));
    contact->node_area = calloc(mesh->nodes ? mesh->nodes : 1, sizeof *contact->node_area);
    contact->pieces = malloc(mesh->triangles ? mesh->triangles : 1);
    bool ok = contact->body && contact->node_area && contact->pieces;
    for (size_t t = 0; ok && t < mesh->triangles; t++)
        contact->pieces[t] = count_pieces(mesh->rest + 6 * t);
    ok = ok && make_patterns(contact);
    for (size_t t = 0; ok && t < mesh->triangles; t++)
        contact->samples += contact->pattern[contact->pieces[t]].points;
    if (!ok || !make_sights(contact)) {
        dr_contact_free(contact);
        return dr_out_of_memory(reterr);
    }
    find_halves(contact);
    for (size_t b = 0; b < bodies; b++)
        contact->body[b] = body[b];
    for (size_t t = 0; t < mesh->triangles; t++) {
        for (int k = 0; k < 3; k++)
            contact->node_area[mesh->triangle[3 * t + (size_t)k]] += mesh->area[t] / 3;
    }
    *ret = contact;
    return DRAPE_OK;
}

void dr_contact_lend(struct dr_contact *contact, struct dr_hand *hand)
{
    contact->hand = contact->samples * contact->bodies < WORTH_SHARING ? NULL : hand;
}

struct dr_contact *dr_contact_free(struct dr_contact *contact)
{
    if (contact) {
        free(contact->body);
        free(contact->node_area);
        free(contact->pieces);
        free(contact->point);
        free(contact->at);
        free(contact->sight);
        free(contact);
    }
    return NULL;
}

size_t dr_contact_bytes(const struct dr_contact *contact)
{
    return sizeof *contact + contact->bodies * sizeof(struct dr_body *) +
           contact->mesh->nodes * sizeof *contact->node_area +
           contact->mesh->triangles * sizeof *contact->pieces + contact->points * sizeof *contact->point +
           3 * contact->mesh->nodes * sizeof *contact->at +
           contact->samples * contact->bodies * sizeof *contact->sight;
}

/* ---- the penalty ----------------------------------------------------------------------------- */

struct dr_penalty dr_penalty(double stiffness, double offset, double depth)
{
    double w = offset / 2, s = depth, e = s - w;
    if (s <= 0)
        return (struct dr_penalty){0, 0, 0};
    if (e < 0)
        return (struct dr_penalty){stiffness * s * s * s / (6 * w), stiffness * s * s / (2 * w),
                                   stiffness * s / w};
    return (struct dr_penalty){stiffness * (w * w / 6 + w * e / 2 + e * e / 2), stiffness * (w / 2 + e),
                               stiffness};
}

static double node_stiffness(const struct dr_contact *contact, size_t node)
{
    return DR_CONTACT_STIFFNESS * contact->node_area[node] / 2;
}

static double point_stiffness(const struct dr_contact *contact, size_t triangle, const struct point *point)
{
    return DR_CONTACT_STIFFNESS * contact->mesh->area[triangle] * point->part;
}

static void locate(const struct point *point, const uint32_t corner[3], const double *x, double ret[3])
{
    const double *a = x + 3 * (size_t)corner[0], *b = x + 3 * (size_t)corner[1],
                 *c = x + 3 * (size_t)corner[2];
    for (int d = 0; d < 3; d++)
        ret[d] = point->share[0] * a[d] + point->share[1] * b[d] + point->share[2] * c[d];
}

/* ---- the distances --------------------------------------------------------------------------- */

static void look_from(const struct dr_contact *contact, const double x[3], struct sight *sight)
{
    for (size_t b = 0; b < contact->bodies; b++)
        if (!dr_body_distance(contact->body[b], x, &sight[b].phi, sight[b].n))
            sight[b].phi = INFINITY;
}

static size_t count_moves(const struct dr_contact *contact)
{
    size_t moves = 0;
    for (size_t b = 0; b < contact->bodies; b++)
        moves += dr_body_moves(contact->body[b]);
    return moves;
}

static bool has_looked(const struct dr_contact *contact, const double *x)
{
    return contact->looked && contact->moves == count_moves(contact) &&
           !memcmp(contact->at, x, 3 * contact->mesh->nodes * sizeof *x);
}

/* For dr_hand_both. */
struct looking {
    const struct dr_contact *contact;
    const double *x; /* 3*nodes */
};

static void look_half(void *data, int half)
{
    const struct looking *looking = data;
    const struct dr_contact *contact = looking->contact;
    const struct dr_mesh *mesh = contact->mesh;
    const double *x = looking->x;
    size_t end = half ? mesh->nodes : contact->node_halfway;
    for (size_t v = half ? contact->node_halfway : 0; v < end; v++)
        look_from(contact, x + 3 * v, contact->sight + v * contact->bodies);
    struct sight *sight =
        contact->sight + (mesh->nodes + (half ? contact->point_halfway : 0)) * contact->bodies;
    end = half ? mesh->triangles : contact->triangle_halfway;
    for (size_t t = half ? contact->triangle_halfway : 0; t < end; t++) {
        const struct pattern *pattern = contact->pattern + contact->pieces[t];
        for (const struct point *p = pattern->point; p < pattern->point + pattern->points; p++) {
            double at[3];
            locate(p, mesh->triangle + 3 * t, x, at);
            look_from(contact, at, sight);
            sight += contact->bodies;
        }
    }
}

/* The distances of all samples at x: of the nodes, then of the triangles' points. */
static const struct sight *look(struct dr_contact *contact, const double *x)
{
    if (has_looked(contact, x))
        return contact->sight;
    dr_hand_both(contact->hand, look_half, &(struct looking){contact, x});
    memcpy(contact->at, x, 3 * contact->mesh->nodes * sizeof *x);
    contact->moves = count_moves(contact);
    contact->looked = true;
    return contact->sight;
}

/* Whether a sample feels a body at all; few do. */
static bool touches(const struct dr_contact *contact, const struct sight *sight)
{
    for (size_t b = 0; b < contact->bodies; b++)
        if (sight[b].phi < dr_body_offset(contact->body[b]))
            return true;
    return false;
}

static struct dr_penalty press(const struct dr_body *body, const struct sight *sight, double stiffness)
{
    double offset = dr_body_offset(body);
    return dr_penalty(stiffness, offset, offset - sight->phi);
}

/* ---- the sums -------------------------------------------------------------------------------- */

/* Energy of one sample against all bodies; its gradient is written to g. */
static double sample_energy(const struct dr_contact *contact, const struct sight *sight, double stiffness,
                            double g[3])
{
    double energy = 0;
    g[0] = g[1] = g[2] = 0;
    for (size_t b = 0; b < contact->bodies; b++) {
        struct dr_penalty psi = press(contact->body[b], sight + b, stiffness);
        if (!(psi.force > 0))
            continue;
        energy += psi.energy;
        for (int d = 0; d < 3; d++)
            g[d] -= psi.force * sight[b].n[d]; /* ds = -n.dx */
    }
    return energy;
}

double dr_contact_energy(struct dr_contact *contact, const double *x, double *g)
{
    const struct dr_mesh *mesh = contact->mesh;
    const struct sight *sight = look(contact, x);
    double energy = 0, sample[3];
    for (size_t v = 0; v < mesh->nodes; v++, sight += contact->bodies) {
        if (!touches(contact, sight))
            continue;
        energy += sample_energy(contact, sight, node_stiffness(contact, v), sample);
        for (int d = 0; g && d < 3; d++)
            g[3 * v + (size_t)d] += sample[d];
    }
    for (size_t t = 0; t < mesh->triangles; t++) {
        const uint32_t *corner = mesh->triangle + 3 * t;
        const struct pattern *pattern = contact->pattern + contact->pieces[t];
        const struct point *end = pattern->point + pattern->points;
        for (const struct point *p = pattern->point; p < end; p++, sight += contact->bodies) {
            if (!touches(contact, sight))
                continue;
            energy += sample_energy(contact, sight, point_stiffness(contact, t, p), sample);
            for (int k = 0; g && k < 3; k++)
                for (int d = 0; d < 3; d++)
                    g[3 * (size_t)corner[k] + (size_t)d] += p->share[k] * sample[d];
        }
    }
    return energy;
}

/* Where the loads of all nodes are summed: see dr_contact_loads. */
struct loads {
    const double *own, *rest;
    double *load, *grip;
};

/* Adds what the bodies do to a sample to the loads and grips of the `nodes` that share it. */
static void add_load(const struct dr_contact *contact, const struct sight *sight, double stiffness,
                     const uint32_t *node, const double *share, size_t nodes, const struct loads *to)
{
    for (size_t b = 0; b < contact->bodies; b++) {
        struct dr_penalty psi = press(contact->body[b], sight + b, stiffness);
        const double *n = sight[b].n;
        if (!(psi.force > 0))
            continue;
        double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (size_t k = 0; k < nodes; k++) {
            size_t v = node[k];
            double mu = to->own[v] + to->rest[v] * dr_body_friction(contact->body[b]);
            for (size_t d = 0; d < 3; d++)
                to->load[3 * v + d] += share[k] * psi.force * n[d];
            to->grip[v] += share[k] * mu * psi.force * length;
        }
    }
}

void dr_contact_loads(struct dr_contact *contact, const double *x, const double *own, const double *rest,
                      double *load, double *grip)
{
    const struct dr_mesh *mesh = contact->mesh;
    const struct loads to = {own, rest, load, grip};
    const struct sight *sight = look(contact, x);
    memset(load, 0, 3 * mesh->nodes * sizeof *load);
    memset(grip, 0, mesh->nodes * sizeof *grip);
    for (size_t v = 0; v < mesh->nodes; v++, sight += contact->bodies)
        if (touches(contact, sight))
            add_load(contact, sight, node_stiffness(contact, v), (const uint32_t[]){(uint32_t)v},
                     (const double[]){1}, 1, &to);
    for (size_t t = 0; t < mesh->triangles; t++) {
        const struct pattern *pattern = contact->pattern + contact->pieces[t];
        const struct point *end = pattern->point + pattern->points;
        for (const struct point *p = pattern->point; p < end; p++, sight += contact->bodies)
            if (touches(contact, sight))
                add_load(contact, sight, point_stiffness(contact, t, p), mesh->triangle + 3 * t, p->share, 3,
                         &to);
    }
}

/* Hessian of one sample, kappa A (psi'' n n' - psi' curvature) summed over the bodies, as the lower triangle
 * xx, yx, yy, zx, zy, zz. */
static void sample_hessian(const struct dr_contact *contact, const double x[3], const struct sight *sight,
                           double stiffness, double curvature, double H[6])
{
    memset(H, 0, 6 * sizeof *H);
    for (size_t b = 0; b < contact->bodies; b++) {
        struct dr_penalty psi = press(contact->body[b], sight + b, stiffness);
        const double *n = sight[b].n;
        if (!(psi.force > 0))
            continue;
        double bent[6] = {0, 0, 0, 0, 0, 0};
        if (curvature > 0)
            dr_body_curvature(contact->body[b], x, bent);
        for (int i = 0, entry = 0; i < 3; i++)
            for (int j = 0; j <= i; j++, entry++)
                H[entry] += psi.curvature * n[i] * n[j] - curvature * psi.force * bent[entry];
    }
}

/* Each pair of corners gets H times the product of the point's shares in their moves. */
static void add_point(struct dr_matrix *A, size_t t, const struct point *point, const double H[6])
{
    static const int entry[3][3] = {{0, 1, 3}, {1, 2, 4}, {3, 4, 5}};
    double block[9][9];
    for (int i = 0; i < 9; i++)
        for (int j = 0; j < 9; j++)
            block[i][j] = point->share[i / 3] * point->share[j / 3] * H[entry[i % 3][j % 3]];
    dr_matrix_add_triangle(A, t, (const double(*)[9])block);
}

void dr_contact_hessian(struct dr_contact *contact, const double *x, double curvature, struct dr_matrix *A)
{
    const struct dr_mesh *mesh = contact->mesh;
    const struct sight *sight = look(contact, x);
    double H[6], at[3];
    for (size_t v = 0; v < mesh->nodes; v++, sight += contact->bodies) {
        if (!touches(contact, sight))
            continue;
        sample_hessian(contact, x + 3 * v, sight, node_stiffness(contact, v), curvature, H);
        dr_matrix_add_node(A, (uint32_t)v, H);
    }
    for (size_t t = 0; t < mesh->triangles; t++) {
        const struct pattern *pattern = contact->pattern + contact->pieces[t];
        const struct point *end = pattern->point + pattern->points;
        for (const struct point *p = pattern->point; p < end; p++, sight += contact->bodies) {
            if (!touches(contact, sight))
                continue;
            locate(p, mesh->triangle + 3 * t, x, at);
            sample_hessian(contact, at, sight, point_stiffness(contact, t, p), curvature, H);
            add_point(A, t, p, H);
        }
    }
}

/* ---- one by one ------------------------------------------------------------------------------ */

size_t dr_contact_samples(const struct dr_contact *contact)
{
    return contact->samples * contact->bodies;
}

static void visit_bodies(const struct dr_contact *contact, const struct sight *sight,
                         struct dr_sample *sample, void (*visit)(const struct dr_sample *sample, void *data),
                         void *data)
{
    for (size_t b = 0; b < contact->bodies; b++) {
        if (!(sight[b].phi < INFINITY))
            continue;
        sample->phi = sight[b].phi;
        memcpy(sample->n, sight[b].n, sizeof sample->n);
        sample->offset = dr_body_offset(contact->body[b]);
        visit(sample, data);
    }
}

void dr_contact_each(struct dr_contact *contact, const double *x,
                     void (*visit)(const struct dr_sample *sample, void *data), void *data)
{
    const struct dr_mesh *mesh = contact->mesh;
    const struct sight *sight = look(contact, x);
    for (size_t v = 0; v < mesh->nodes; v++, sight += contact->bodies) {
        struct dr_sample sample = {.node = {(uint32_t)v, (uint32_t)v, (uint32_t)v},
                                   .share = {1, 0, 0},
                                   .stiffness = node_stiffness(contact, v)};
        visit_bodies(contact, sight, &sample, visit, data);
    }
    for (size_t t = 0; t < mesh->triangles; t++) {
        const uint32_t *corner = mesh->triangle + 3 * t;
        const struct pattern *pattern = contact->pattern + contact->pieces[t];
        const struct point *end = pattern->point + pattern->points;
        for (const struct point *p = pattern->point; p < end; p++, sight += contact->bodies) {
            struct dr_sample sample = {.node = {corner[0], corner[1], corner[2]},
                                       .share = {p->share[0], p->share[1], p->share[2]},
                                       .stiffness = point_stiffness(contact, t, p)};
            visit_bodies(contact, sight, &sample, visit, data);
        }
    }
}

/* ---- the limit on a step --------------------------------------------------------------------- */

/* A point of the path x + t w and the distance there; beyond reach the distance counts as the reach,
 * which is less, and the gradient as zero. */
struct stop {
    double t, phi, grad[3];
    double rise; /* of the distance along w, per unit of t */
};

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static struct stop stop_at(const struct dr_body *body, const double x[3], const double w[3], double t)
{
    struct stop stop = {.t = t, .phi = DR_BODY_REACH};
    double at[3];
    for (int d = 0; d < 3; d++) {
        double move = t * w[d]; /* rounded as the caller's x + w will be */
        at[d] = x[d] + move;
    }
    dr_body_distance(body, at, &stop.phi, stop.grad);
    stop.rise = dot(stop.grad, w);
    return stop;
}

/* Is a part of the body, or its medial axis, between the last stop outside and this one? Then the
 * distance fell before and rises behind, and points the other way. (Between two bodies it is the
 * reverse: it rises first.) */
static bool crossed(const struct stop *outside, const struct stop *behind)
{
    return outside->rise < 0 && behind->rise > 0 && dot(outside->grad, behind->grad) < 0;
}

/* How much of the move w from x one body allows, of at most `limit`; both in parts of w. `sight`: the
 * distance at x, or NULL. */
static double walk(const struct dr_body *body, const struct sight *sight, const double x[3],
                   const double w[3], double limit, double depth)
{
    double length = sqrt(dot(w, w));
    if (sight && fmin(sight->phi, DR_BODY_REACH) > STEEPEST * length)
        return limit; /* as the next stop would tell */
    struct stop here = stop_at(body, x, w, 0), outside = here;
    bool was_outside = here.phi >= 0;
    double lowest = fmin(here.phi, 0) - depth;
    double step = fmax(here.phi - lowest - depth, depth / 2);
    for (int n = 0; n < DR_CONTACT_MAX_WALK && here.t < limit; n++) {
        struct stop next = stop_at(body, x, w, fmin(here.t + step / length, limit));
        bool might_cross = was_outside && step > here.phi; /* else no solid is that near */
        if (next.phi >= lowest && !(might_cross && crossed(&outside, &next))) {
            here = next;
            if (here.phi >= 0) {
                outside = here;
                was_outside = true;
                lowest = -depth;
            }
            step = fmax(here.phi - lowest - depth, depth / 2);
        } else if (step > depth / 2) {
            step = fmax(step / 2, depth / 2); /* the distance changed faster than the way */
        } else {
            break;
        }
    }
    return here.t;
}

/* The same for all bodies. A body that cuts the move may end it between two stops of an earlier
 * body's walk, which must then look at that end, too. */
static double walk_all(const struct dr_contact *contact, const struct sight *sight, const double x[3],
                       const double w[3], double depth)
{
    double allowed = 1, before;
    do {
        before = allowed;
        for (size_t b = 0; b < contact->bodies; b++)
            allowed = walk(contact->body[b], sight ? sight + b : NULL, x, w, allowed, depth);
    } while (allowed < before && contact->bodies > 1);
    return allowed;
}

/* For dr_hand_both. */
struct clipping {
    const struct dr_contact *contact;
    const struct sight *sight; /* at x; NULL: not known */
    const double *x;
    double *w, depth;
    size_t shortened[2]; /* of each half */
};

static void clip_half(void *data, int half)
{
    struct clipping *clipping = data;
    const struct dr_contact *contact = clipping->contact;
    const struct sight *sight = clipping->sight;
    size_t shortened = 0, end = half ? contact->mesh->nodes : contact->node_halfway;
    for (size_t v = half ? contact->node_halfway : 0; v < end; v++) {
        double *move = clipping->w + 3 * v;
        if (move[0] == 0 && move[1] == 0 && move[2] == 0)
            continue;
        double allowed = walk_all(contact, sight ? sight + v * contact->bodies : NULL, clipping->x + 3 * v,
                                  move, clipping->depth);
        if (allowed < 1) {
            shortened++;
            for (int d = 0; d < 3; d++)
                move[d] *= allowed;
        }
    }
    clipping->shortened[half] = shortened;
}

size_t dr_contact_clip(const struct dr_contact *contact, const double *x, double *w, double depth)
{
    const struct sight *sight = has_looked(contact, x) ? contact->sight : NULL;
    struct clipping clipping = {contact, sight, x, w, depth, {0, 0}};
    assert(depth > 0);
    dr_hand_both(contact->hand, clip_half, &clipping);
    return clipping.shortened[0] + clipping.shortened[1];
}

uint32_t dr_contact_penetrations(const struct dr_contact *contact, const double *x, double *ret_deepest,
                                 double ret_where[3])
{
    uint32_t inside = 0;
    *ret_deepest = 0;
    for (size_t v = 0; v < contact->mesh->nodes; v++) {
        double depth = 0, phi, unused[3];
        for (size_t b = 0; b < contact->bodies; b++)
            if (dr_body_distance(contact->body[b], x + 3 * v, &phi, unused))
                depth = fmax(depth, -phi);
        inside += depth > 0;
        if (depth > *ret_deepest) {
            *ret_deepest = depth;
            memcpy(ret_where, x + 3 * v, 3 * sizeof *ret_where);
        }
    }
    return inside;
}
