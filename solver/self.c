/* self.c - see self.h. */
#include "self.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "contact.h"
#include "error.h"
#include "rub.h"
#include "sweep.h"

#define KEEP     0.2   /* of each distance, that a step leaves */
#define MARGIN   0.004 /* m beyond the thickness, in which a step sees gaps */
#define SEARCH   1.5   /* margins beyond the thickness that a search looks: it serves for a while */
#define PARALLEL 0.01  /* squared sine below which the energy of two edges fades */

struct dr_self {
    const struct dr_mesh *mesh;
    struct dr_pairs *pairs;
    double thickness, margin; /* m */
    double *area;             /* nodes: a third of each incident rest area, m^2 */
    double *edge_area;        /* edges: likewise */
    double *thin;             /* nodes: half the least altitude of the triangles about it, m */
    double *searched;         /* 3*nodes: where the pairs were last searched for */
    double radius;            /* m, of that search; 0: none yet */
    double *at;               /* 3*nodes: where the lists were last brought up to date */
    double complete;          /* m: the lists had all that were closer, there */
    double *near;             /* pairs, as pair_at numbers them: how close they were there, m */
    size_t near_room;
    double moved;         /* m: the most that a node has moved since then */
    double broad, narrow; /* s: spent on searching, and on the pairs */
    drape_status failed;  /* of a search or renewal; stays */
    struct dr_rub *rub;   /* NULL: no friction */
    uint32_t *link;       /* scratch of dr_self_links */
    size_t link_room;
};

/* ---- made and freed -------------------------------------------------------------------------- */

static void measure(struct dr_self *self)
{
    const struct dr_mesh *mesh = self->mesh;
    for (size_t v = 0; v < mesh->nodes; v++)
        self->thin[v] = INFINITY;
    for (size_t t = 0; t < mesh->triangles; t++) {
        const double *p = mesh->rest + 6 * t;
        double longest = 0;
        for (int k = 0; k < 3; k++) {
            int i = (k + 1) % 3, j = (k + 2) % 3;
            double side = hypot(p[2 * i] - p[2 * j], p[2 * i + 1] - p[2 * j + 1]);
            longest = fmax(longest, side);
            self->area[mesh->triangle[3 * t + (size_t)k]] += mesh->area[t] / 3;
        }
        for (int k = 0; k < 3; k++) { /* the altitude is twice the area over the side */
            double *thin = self->thin + mesh->triangle[3 * t + (size_t)k];
            *thin = fmin(*thin, mesh->area[t] / longest);
        }
    }
    for (size_t e = 0; e < self->pairs->sides; e++)
        for (int k = 0; k < 2; k++) {
            uint32_t t = self->pairs->side_triangle[2 * e + (size_t)k];
            self->edge_area[e] += t == DR_NONE ? 0 : mesh->area[t] / 3;
        }
    double sum = 0;
    for (size_t v = 0; v < mesh->nodes; v++)
        sum += self->thin[v];
    self->margin = fmin(MARGIN, sum / (double)mesh->nodes);
}

drape_status dr_self_new(const struct dr_mesh *mesh, double thickness, struct dr_self **ret,
                         drape_error *reterr)
{
    struct dr_self *self = calloc(1, sizeof *self);
    if (!self)
        return dr_out_of_memory(reterr);
    self->mesh = mesh;
    self->thickness = thickness;
    drape_status status = dr_pairs_new(mesh, &self->pairs, reterr);
    if (status < 0) {
        dr_self_free(self);
        return status;
    }
    self->area = calloc(mesh->nodes, sizeof *self->area);
    self->thin = calloc(mesh->nodes, sizeof *self->thin);
    self->searched = calloc(3 * mesh->nodes, sizeof *self->searched);
    self->at = calloc(3 * mesh->nodes, sizeof *self->at);
    self->edge_area = calloc(self->pairs->sides, sizeof *self->edge_area);
    if (!self->area || !self->thin || !self->searched || !self->at || !self->edge_area) {
        dr_self_free(self);
        return dr_out_of_memory(reterr);
    }
    measure(self);
    *ret = self;
    return DRAPE_OK;
}

void dr_self_lend(struct dr_self *self, struct dr_hand *hand)
{
    dr_pairs_lend(self->pairs, hand);
}

void dr_self_between(struct dr_self *self, const uint32_t *part)
{
    dr_pairs_between(self->pairs, part);
}

void dr_self_weld(struct dr_self *self, const uint32_t *weld)
{
    dr_pairs_weld(self->pairs, weld);
    self->radius = 0; /* the pairs found before are others */
}

void dr_self_without(struct dr_self *self, const bool *absent)
{
    dr_pairs_without(self->pairs, absent);
    self->radius = 0;
}

drape_status dr_self_roughen(struct dr_self *self, const double *own, const double *rest, double mu,
                             drape_error *reterr)
{
    return dr_rub_new(own, rest, mu, self->mesh->nodes, &self->rub, reterr);
}

struct dr_self *dr_self_free(struct dr_self *self)
{
    if (self) {
        dr_pairs_free(self->pairs);
        dr_rub_free(self->rub);
        free(self->area);
        free(self->edge_area);
        free(self->thin);
        free(self->searched);
        free(self->at);
        free(self->near);
        free(self->link);
        free(self);
    }
    return NULL;
}

size_t dr_self_bytes(const struct dr_self *self)
{
    return sizeof *self + self->near_room * sizeof *self->near + dr_pairs_bytes(self->pairs) +
           (self->rub ? dr_rub_bytes(self->rub) : 0) +
           (8 * self->mesh->nodes + self->pairs->sides) * sizeof(double) +
           2 * self->link_room * sizeof *self->link;
}

/* ---- the search ------------------------------------------------------------------------------ */

/* Number i of all pairs, vertices and faces first. */
static const struct dr_pair *pair_at(const struct dr_self *self, size_t i, bool *ret_edges)
{
    const struct dr_pairs *pairs = self->pairs;
    *ret_edges = i >= pairs->face_count;
    return *ret_edges ? pairs->edges + (i - pairs->face_count) : pairs->faces + i;
}

static size_t pair_count(const struct dr_self *self)
{
    return self->pairs->face_count + self->pairs->edge_count;
}

static struct dr_closest closest(const struct dr_pair *pair, bool edges, const double *x)
{
    return edges ? dr_closest_edge_edge(x, pair->node) : dr_closest_vertex_face(x, pair->node);
}

/* How close each pair is at x. */
static drape_status measure_pairs(struct dr_self *self, const double *x)
{
    size_t count = pair_count(self);
    if (count > self->near_room) {
        double *near = realloc(self->near, 2 * count * sizeof *near);
        if (!near)
            return DRAPE_ENOMEM;
        self->near = near;
        self->near_room = 2 * count;
    }
    for (size_t i = 0; i < count; i++) {
        bool edges;
        const struct dr_pair *pair = pair_at(self, i, &edges);
        self->near[i] = sqrt(closest(pair, edges, x).square);
    }
    return DRAPE_OK;
}

/* The most that a node has moved since the lists were up to date, m. */
static double moved_since(const struct dr_self *self, const double *x)
{
    double farthest = 0; /* squared */
    for (size_t i = 0; i < 3 * self->mesh->nodes && self->radius > 0; i += 3) {
        double a = x[i] - self->at[i], b = x[i + 1] - self->at[i + 1], c = x[i + 2] - self->at[i + 2],
               square = a * a + b * b + c * c;
        if (!(square <= farthest))
            farthest = square; /* NaN stays */
    }
    return sqrt(farthest);
}

/* Brings the lists up to date: they get what a part of the cloth has brought near, or are made anew. */
static drape_status update(struct dr_self *self, const double *x, double range)
{
    size_t size = 3 * self->mesh->nodes * sizeof *x;
    double complete = (self->radius + range) / 2; /* to serve for a while */
    if (!(complete < self->radius) || !dr_pairs_add(self->pairs, self->searched, x, complete)) {
        drape_status status = dr_pairs_find(self->pairs, x, self->thickness + SEARCH * self->margin, NULL);
        if (status < 0)
            return status;
        complete = self->radius = self->pairs->radius; /* less where a heap has too many */
        memcpy(self->searched, x, size);
    }
    self->complete = complete;
    self->moved = 0;
    memcpy(self->at, x, size);
    return measure_pairs(self, x);
}

/* After it the pairs hold all that are closer than `range` at x, m. Once one has failed, all do. */
static bool search(struct dr_self *self, const double *x, double range)
{
    double began = dr_clock();
    if (self->failed < 0)
        return false;
    self->moved = moved_since(self, x);
    if (!(self->radius > 0 && self->complete - 2 * self->moved >= range)) {
        self->failed = update(self, x, range);
        if (self->failed < 0)
            self->radius = 0;
    }
    self->broad += dr_clock() - began;
    return self->failed >= 0;
}

/* Where looking at the pairs begins and ends: it is the narrow phase but for the searches between. */
static double begin(const struct dr_self *self)
{
    return dr_clock() - self->broad;
}

static void end(struct dr_self *self, double began)
{
    self->narrow += dr_clock() - self->broad - began;
}

void dr_self_seconds(const struct dr_self *self, double *ret_broad, double *ret_narrow)
{
    *ret_broad = self->broad;
    *ret_narrow = self->narrow;
}

drape_status dr_self_error(const struct dr_self *self, drape_error *reterr)
{
    return self->failed < 0 ? dr_out_of_memory(reterr) : DRAPE_OK;
}

/* ---- one pair -------------------------------------------------------------------------------- */

struct touch {
    uint32_t node[4];
    struct dr_closest closest;
    double distance, offset;
    double stiffness; /* kappa A, N/m */
    double n[3];      /* of the distance's gradient: that at node k is weight[k] n */
    bool edges;
};

static double offset_of(const struct dr_self *self, const uint32_t node[4])
{
    double least = self->thickness;
    for (int k = 0; k < 4; k++)
        least = fmin(least, self->thin[node[k]]);
    return least;
}

/* False when pair i is not closer than its thickness and `margin`, or has no direction. */
static bool look_at(const struct dr_self *self, size_t i, const double *x, double margin, struct touch *ret)
{
    bool edges;
    if (self->near[i] - 2 * self->moved >= self->thickness + margin) /* nor can it have come closer */
        return false;
    const struct dr_pair *pair = pair_at(self, i, &edges);
    memcpy(ret->node, pair->node, sizeof ret->node);
    ret->edges = edges;
    ret->offset = offset_of(self, pair->node);
    ret->closest = closest(pair, edges, x);
    double reach = ret->offset + margin;
    if (!(ret->closest.square < reach * reach && ret->closest.square > 0))
        return false;
    ret->distance = sqrt(ret->closest.square);
    for (int d = 0; d < 3; d++)
        ret->n[d] = ret->closest.r[d] / ret->distance;
    double area = edges ? fmin(self->edge_area[pair->a], self->edge_area[pair->b]) : self->area[pair->a];
    ret->stiffness = DR_CONTACT_STIFFNESS * area / 2;
    return true;
}

/* The mollifier of two edges, with its derivatives in c, and c's in the positions of the four nodes. */
struct fade {
    double value, first, second;
    double u[2][3], P[2][3][3]; /* unit edges, projectors across them */
    double length[2], cosine;
};

/* False: 1, as everything but nearly parallel edges. */
static bool fade_of(const struct touch *touch, const double *x, struct fade *ret)
{
    if (!touch->edges)
        return false;
    double dot = 0;
    for (int e = 0; e < 2; e++) {
        const double *a = x + 3 * (size_t)touch->node[2 * e], *b = x + 3 * (size_t)touch->node[2 * e + 1];
        double square = 0;
        for (int d = 0; d < 3; d++) {
            ret->u[e][d] = b[d] - a[d];
            square += ret->u[e][d] * ret->u[e][d];
        }
        ret->length[e] = sqrt(square);
        for (int d = 0; d < 3; d++)
            ret->u[e][d] = square > 0 ? ret->u[e][d] / ret->length[e] : 0;
    }
    for (int d = 0; d < 3; d++)
        dot += ret->u[0][d] * ret->u[1][d];
    double c = 1 - dot * dot;
    if (c >= PARALLEL)
        return false;
    c = fmax(c, 0);
    ret->cosine = dot;
    ret->value = c / PARALLEL * (2 - c / PARALLEL);
    ret->first = 2 / PARALLEL * (1 - c / PARALLEL);
    ret->second = -2 / (PARALLEL * PARALLEL);
    for (int e = 0; e < 2; e++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                ret->P[e][i][j] = (i == j) - ret->u[e][i] * ret->u[e][j];
    return true;
}

/* Gradient of the cosine in the two edges: P u' / length. */
static void cosine_gradient(const struct fade *fade, double g[2][3])
{
    for (int e = 0; e < 2; e++)
        for (int i = 0; i < 3; i++) {
            g[e][i] = 0;
            for (int j = 0; j < 3; j++)
                g[e][i] += fade->P[e][i][j] * fade->u[1 - e][j] / fade->length[e];
        }
}

/* Gradient of c in the four nodes. */
static void fade_gradient(const struct fade *fade, double dc[12])
{
    double g[2][3];
    cosine_gradient(fade, g);
    for (int e = 0; e < 2; e++)
        for (int d = 0; d < 3; d++) {
            dc[6 * e + d] = 2 * fade->cosine * g[e][d];
            dc[6 * e + 3 + d] = -2 * fade->cosine * g[e][d];
        }
}

static double add_pair_energy(const struct dr_self *self, size_t i, const double *x, double *g)
{
    struct touch touch;
    struct fade fade;
    double dc[12];
    if (!look_at(self, i, x, 0, &touch))
        return 0;
    struct dr_penalty psi = dr_penalty(touch.stiffness, touch.offset, touch.offset - touch.distance);
    bool fades = fade_of(&touch, x, &fade);
    double m = fades ? fade.value : 1;
    if (fades && g)
        fade_gradient(&fade, dc);
    for (int k = 0; g && k < 4; k++)
        for (int d = 0; d < 3; d++) {
            double *at = g + 3 * (size_t)touch.node[k] + d;
            *at -= m * psi.force * touch.closest.weight[k] * touch.n[d];
            if (fades)
                *at += psi.energy * fade.first * dc[3 * k + d];
        }
    return m * psi.energy;
}

double dr_self_energy(struct dr_self *self, const double *x, double *g)
{
    double began = begin(self), sum = 0;
    if (!search(self, x, self->thickness))
        return INFINITY;
    for (size_t i = 0; i < pair_count(self); i++)
        sum += add_pair_energy(self, i, x, g);
    if (self->rub)
        sum += dr_rub_energy(self->rub, x, g);
    end(self, began);
    return sum;
}

double dr_self_held(const struct dr_self *self, const double *x)
{
    return self->rub ? dr_rub_energy(self->rub, x, NULL) : 0;
}

/* ---- the Hessian ----------------------------------------------------------------------------- */

typedef double block12[12][12];

/* H += scale * (Hessian of the distance). With f = r.r/2 at its least over the free parameters t, df/dx_i =
 * b_i r, and f_xx - f_xt f_tt^-1 f_tx is f's Hessian; that of sqrt(2f) follows. */
static void add_distance_hessian(const struct touch *touch, const double *x, double scale, block12 H)
{
    const struct dr_closest *c = &touch->closest;
    double along[2][3], slope[2][12], G[2][2] = {{1, 0}, {0, 1}};
    for (int a = 0; a < c->free; a++) {
        int to = c->edge[a][0], from = c->edge[a][1];
        dr_between(x + 3 * (size_t)touch->node[from], x + 3 * (size_t)touch->node[to], along[a]);
        for (int k = 0; k < 4; k++)
            for (int d = 0; d < 3; d++)
                slope[a][3 * k + d] = c->weight[k] * along[a][d] + ((k == to) - (k == from)) * c->r[d];
    }
    for (int a = 0; a < c->free; a++)
        for (int b = 0; b < c->free; b++)
            G[a][b] = dr_dot(along[a], along[b]);
    double det = G[0][0] * G[1][1] - G[0][1] * G[1][0];
    double inverse[2][2] = {{G[1][1] / det, -G[0][1] / det}, {-G[1][0] / det, G[0][0] / det}};
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 12; j++) {
            double bb = c->weight[i / 3] * c->weight[j / 3];
            double sum = bb * ((i % 3 == j % 3) - touch->n[i % 3] * touch->n[j % 3]);
            for (int a = 0; a < c->free; a++)
                for (int b = 0; b < c->free; b++)
                    sum -= slope[a][i] * inverse[a][b] * slope[b][j];
            H[i][j] += scale * sum / touch->distance;
        }
}

/* Second derivative of the cosine in edges e and f, entry (i, j). */
static double cosine_second(const struct fade *fade, const double g[2][3], int e, int f, int i, int j)
{
    double sum = 0;
    if (e == f)
        return -(fade->u[e][i] * g[e][j] + g[e][i] * fade->u[e][j]) / fade->length[e] -
               fade->cosine * fade->P[e][i][j] / (fade->length[e] * fade->length[e]);
    for (int k = 0; k < 3; k++)
        sum += fade->P[e][i][k] * fade->P[f][k][j];
    return sum / (fade->length[e] * fade->length[f]);
}

/* What the mollifier adds to the Hessian of m psi. */
static void add_fade_hessian(const struct touch *touch, const struct fade *fade, const struct dr_penalty *psi,
                             block12 H)
{
    double g[2][3], dc[12];
    cosine_gradient(fade, g);
    fade_gradient(fade, dc);
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 12; j++) {
            int e = i / 6, f = j / 6;
            double sign = (i / 3 % 2 ? 1.0 : -1.0) * (j / 3 % 2 ? 1.0 : -1.0);
            double second =
                -2 * sign *
                (g[e][i % 3] * g[f][j % 3] + fade->cosine * cosine_second(fade, g, e, f, i % 3, j % 3));
            double gi = touch->closest.weight[i / 3] * touch->n[i % 3],
                   gj = touch->closest.weight[j / 3] * touch->n[j % 3];
            H[i][j] += psi->energy * (fade->second * dc[i] * dc[j] + fade->first * second) -
                       psi->force * fade->first * (dc[i] * gj + gi * dc[j]);
        }
}

static void add_block(const uint32_t node[4], block12 H, struct dr_matrix *A)
{
    for (int a = 0; a < 4; a++) {
        double *d[3] = {H[3 * a] + 3 * a, H[3 * a + 1] + 3 * a, H[3 * a + 2] + 3 * a};
        dr_matrix_add_node(A, node[a],
                           (const double[]){d[0][0], d[1][0], d[1][1], d[2][0], d[2][1], d[2][2]});
        for (int b = 0; b < a; b++) {
            double block[3][3];
            for (int i = 0; i < 3; i++)
                memcpy(block[i], H[3 * a + i] + 3 * b, sizeof block[i]);
            dr_matrix_add_between(A, node[a], node[b], (const double(*)[3])block);
        }
    }
}

static void add_pair_hessian(const struct dr_self *self, size_t number, const double *x, double exact,
                             struct dr_matrix *A)
{
    struct touch touch;
    struct fade fade;
    block12 H;
    if (!look_at(self, number, x, 0, &touch))
        return;
    struct dr_penalty psi = dr_penalty(touch.stiffness, touch.offset, touch.offset - touch.distance);
    bool fades = fade_of(&touch, x, &fade);
    double m = fades ? fade.value : 1;
    const double *b = touch.closest.weight;
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 12; j++)
            H[i][j] = m * psi.curvature * b[i / 3] * b[j / 3] * touch.n[i % 3] * touch.n[j % 3];
    if (exact > 0) {
        add_distance_hessian(&touch, x, -m * psi.force, H);
        if (fades)
            add_fade_hessian(&touch, &fade, &psi, H);
    }
    add_block(touch.node, H, A);
}

void dr_self_hessian(struct dr_self *self, const double *x, double exact, struct dr_matrix *A)
{
    double began = begin(self);
    if (!search(self, x, self->thickness))
        return;
    for (size_t i = 0; i < pair_count(self); i++)
        add_pair_hessian(self, i, x, exact, A);
    if (self->rub)
        dr_rub_hessian(self->rub, x, exact, A);
    end(self, began);
}

/* ---- what others need of the pairs ----------------------------------------------------------- */

bool dr_self_crowded(const struct dr_self *self)
{
    return self->radius < self->thickness;
}

bool dr_self_holds(const struct dr_self *self)
{
    return self->rub;
}

static bool has_places(const struct dr_matrix *A, const uint32_t node[4])
{
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < a; b++)
            if (!dr_matrix_has(A, node[a], node[b]))
                return false;
    return true;
}

bool dr_self_fits(struct dr_self *self, const double *x, const struct dr_matrix *A)
{
    uint32_t node[4];
    if (!search(self, x, self->thickness))
        return true;
    for (size_t i = 0; i < pair_count(self); i++) {
        struct touch touch;
        if (look_at(self, i, x, 0, &touch) && !has_places(A, touch.node))
            return false;
    }
    for (size_t i = 0; self->rub && dr_rub_nodes(self->rub, i, node); i++)
        if (!has_places(A, node))
            return false;
    return true;
}

/* Appends the links of one pair; false: out of memory. */
static bool add_links(struct dr_self *self, const uint32_t node[4], size_t *links)
{
    if (*links + 6 > self->link_room) {
        size_t room = 2 * self->link_room + 600;
        uint32_t *link = realloc(self->link, 2 * room * sizeof *link);
        if (!link)
            return false;
        self->link = link;
        self->link_room = room;
    }
    for (int a = 0; a < 4; a++)
        for (int b = 0; b < a; b++, ++*links) {
            self->link[2 * *links] = node[a];
            self->link[2 * *links + 1] = node[b];
        }
    return true;
}

drape_status dr_self_links(struct dr_self *self, const double *x, const uint32_t **ret, size_t *ret_links,
                           drape_error *reterr)
{
    size_t links = 0;
    uint32_t node[4];
    bool room = true;
    if (!search(self, x, self->thickness + self->margin / 4))
        return dr_out_of_memory(reterr);
    for (size_t i = 0; room && i < pair_count(self); i++) {
        struct touch touch;
        if (look_at(self, i, x, self->margin / 4, &touch))
            room = add_links(self, touch.node, &links);
    }
    for (size_t i = 0; room && self->rub && dr_rub_nodes(self->rub, i, node); i++)
        room = add_links(self, node, &links);
    *ret = self->link;
    *ret_links = links;
    return room ? DRAPE_OK : dr_out_of_memory(reterr);
}

void dr_self_each(struct dr_self *self, const double *x,
                  void (*visit)(const struct dr_self_gap *gap, void *data), void *data)
{
    double began = begin(self);
    if (!search(self, x, self->thickness + self->margin))
        return;
    for (size_t i = 0; i < pair_count(self); i++) {
        struct touch touch;
        struct fade fade;
        bool edges;
        const struct dr_pair *pair = pair_at(self, i, &edges);
        if (!look_at(self, i, x, self->margin, &touch))
            continue;
        struct dr_self_gap gap = {.edges = edges,
                                  .a = pair->a,
                                  .b = pair->b,
                                  .distance = touch.distance,
                                  .offset = touch.offset,
                                  .stiffness =
                                      touch.stiffness * (fade_of(&touch, x, &fade) ? fade.value : 1)};
        memcpy(gap.node, touch.node, sizeof gap.node);
        memcpy(gap.weight, touch.closest.weight, sizeof gap.weight);
        memcpy(gap.n, touch.n, sizeof gap.n);
        visit(&gap, data);
    }
    end(self, began);
}

struct renewal {
    struct dr_self *self;
    const double *x;
};

static void anchor(const struct dr_self_gap *gap, void *data)
{
    struct renewal *renewal = data;
    struct dr_penalty psi = dr_penalty(gap->stiffness, gap->offset, gap->offset - gap->distance);
    struct dr_rub_pair pair = {.edges = gap->edges, .a = gap->a, .b = gap->b, .force = psi.force};
    if (!(psi.force > 0))
        return;
    memcpy(pair.node, gap->node, sizeof pair.node);
    memcpy(pair.weight, gap->weight, sizeof pair.weight);
    memcpy(pair.n, gap->n, sizeof pair.n);
    if (!dr_rub_take(renewal->self->rub, &pair, renewal->x))
        renewal->self->failed = DRAPE_ENOMEM;
}

void dr_self_renew(struct dr_self *self, const double *x)
{
    if (!self->rub)
        return;
    dr_rub_begin(self->rub);
    dr_self_each(self, x, anchor, &(struct renewal){self, x});
}

double dr_self_brace(struct dr_self *self, const double *x, double *f)
{
    return self->rub ? dr_rub_brace(self->rub, x, f) : 0;
}

/* ---- the limit on a step --------------------------------------------------------------------- */

/* All pairs closer than this at x are known, m. */
static double known(const struct dr_self *self, const double *x)
{
    return self->radius > 0 ? self->complete - 2 * moved_since(self, x) : 0;
}

double dr_self_allows(struct dr_self *self, const double *x, const double *w)
{
    double began = dr_clock(), allowed = dr_sweep(self->pairs, x, w, KEEP, known(self, x));
    self->broad += dr_clock() - began;
    return allowed;
}

size_t dr_self_clip(struct dr_self *self, const double *x, double *w)
{
    double began = dr_clock();
    size_t shortened = dr_sweep_clip(self->pairs, x, w, KEEP, known(self, x));
    self->broad += dr_clock() - began;
    return shortened;
}

size_t dr_self_crossings(struct dr_self *self, const double *x, double ret_at[3])
{
    struct dr_crossing first;
    size_t count = dr_pairs_crossings(self->pairs, x, &first);
    if (count)
        memcpy(ret_at, first.at, sizeof first.at);
    return count;
}
