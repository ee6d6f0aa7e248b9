/* bend.c - the Morley-type bending element "SM8": edge slopes from nearby nodes, curvature from slopes.
 *
 * Every inner edge has one slope, shared by its two triangles: the slope of the hinge (a weighted
 * mean of the two flat triangles' slopes) plus a correction that makes it exact for quadratics. With
 * s the slope along the edge's normal n and x_,n|T that of the flat triangle,
 *   K_T = sum over edges of (2/h_T) (s - x_,n|T) m(n),   m(n) = (n_u^2, n_v^2, 2 n_u n_v)
 * is the curvature of Morley's plate element (Aeronautical Quarterly 19, 1968), whose only states
 * without energy are affine.
 *
 * Edge frame, with both sides unfolded into one plane: origin at mid-edge, x from end a to end b, y
 * out of side 0, whose opposite corner is (p, -h0); that of side 1 is (q, h1). H = h0 + h1.
 *
 *              N' (q, h1)
 *             /  \
 *            /    \     side 1      y
 *           a--+---b                |
 *            \    /     side 0      +-- x
 *             \  /
 *              P (p, -h0)
 *
 * What an edge does depends on what lies across it:
 *   nothing, or cloth without rigidity    free: no moment passes, the slope is eliminated exactly
 *   a triangle whose corners are all held  clamped: the slope is that of the held triangle
 *   any other triangle                     one slope for both, with one moment where rigidities differ
 * A held triangle without rigidity clamps nothing. A slope is never computed from nodes beyond cloth
 * without rigidity, which may be creased there, and only where no others suffice from nodes beyond a clamp or
 * another fabric's border: the curvature jumps there, and the clamped row would bend up to 8 per cent wrong
 * on a Delaunay mesh, worse on a graded one. */
#include "bend.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

/* 4 nodes of the hinge, one across each of its 4 outer edges, one across the 2 far edges of each of
 * those: two entries for a node that is met twice. */
#define PATCH_NODES 16

/* 3 corners, and from each edge at most PATCH_NODES less the corners. */
#define TRIANGLE_NODES (3 + 3 * (PATCH_NODES - 3))

/* Constraints on a correction: none on affine maps (1, X, Y), exact on quadratics (X^2/2, XY, Y^2/2). */
#define AFFINE      3
#define CONSTRAINTS 6

/* A quadratic seen by the patch less than this (square of the part that no other explains, against
 * the largest) counts as unseen. */
#define UNSEEN 1e-9

/* A correction is exact when it leaves less than this part of what it must correct. */
#define EXACT 1e-9

/* A hinge this close to a parallelogram (relative) needs no correction: its slope is exact already. */
#define PARALLELOGRAM 1e-12

/* A correction longer than this many times the hinge's own slope calls for a larger patch: 3 such
 * edges of a graded mesh raised its highest eigenvalue 17 times. */
#define LONG_CORRECTION 2

/* What is left of a direction's rigidity below this part of the whole is round-off, not rigidity. */
#define NO_RIGIDITY 1e-14

struct plate { /* what the construction reads */
    const struct dr_mesh *mesh;
    const double *rigidity; /* 3 per material: weft, warp, twist, N m */
};

static const double *rigidity_of(const struct plate *plate, size_t t)
{
    return plate->rigidity + 3 * (size_t)plate->mesh->material[t];
}

static bool is_limp(const struct plate *plate, size_t t)
{
    const double *b = rigidity_of(plate, t);
    return b[0] == 0 && b[1] == 0 && b[2] == 0;
}

static bool is_held(const struct plate *plate, size_t t)
{
    const uint32_t *node = plate->mesh->triangle + 3 * t;
    const bool *held = plate->mesh->held;
    return held[node[0]] && held[node[1]] && held[node[2]];
}

/* The triangle across the edge opposite corner k if a moment can pass there, else DR_NONE. */
static uint32_t stiff_neighbor(const struct plate *plate, size_t t, unsigned k)
{
    uint32_t n = plate->mesh->neighbor[3 * t + k];
    return n == DR_NONE || is_limp(plate, n) ? DR_NONE : n;
}

/* ---- unfolding ------------------------------------------------------------------------------- */

/* An edge as one of its triangles sees it; lengths only, so the triangle's frame may be mirrored. */
struct side {
    double length, foot, height; /* m; foot: of the opposite corner, from mid-edge towards end b */
};

/* The edge of t opposite corner k; end b is the one at node `b`. */
static struct side measure_side(const struct dr_mesh *mesh, size_t t, size_t k, uint32_t b)
{
    size_t i = (k + 1) % 3, j = (k + 2) % 3;
    if (mesh->triangle[3 * t + j] != b) {
        size_t swap = i;
        i = j;
        j = swap;
    }
    const double *P = mesh->rest + 6 * t + 2 * k, *A = mesh->rest + 6 * t + 2 * i,
                 *B = mesh->rest + 6 * t + 2 * j;
    double u = B[0] - A[0], v = B[1] - A[1], length = sqrt(u * u + v * v);
    /* (P - (A + B)/2) . (B - A)/l, from differences */
    double along = ((P[0] - A[0]) * u + (P[1] - A[1]) * v) / length;
    return (struct side){length, along - length / 2, 2 * mesh->area[t] / length};
}

/* A triangle laid out in the plane of an edge frame. */
struct placed {
    size_t triangle;
    double at[3][2]; /* corners, m */
};

/* Lays out the neighbour across the edge opposite corner k by the rigid motion that puts its copy of
 * the edge on this one, middle on middle. Where the two copies differ in length (an eased seam) the
 * distances from the middle are kept. */
static struct placed unfold(const struct dr_mesh *mesh, const struct placed *from, unsigned k)
{
    unsigned i = (k + 1) % 3, j = (k + 2) % 3;
    const double *A = from->at[i], *B = from->at[j], *P = from->at[k];
    double mid[2] = {(A[0] + B[0]) / 2, (A[1] + B[1]) / 2};
    double u = B[0] - A[0], v = B[1] - A[1], length = sqrt(u * u + v * v);
    double along[2] = {u / length, v / length}, out[2] = {along[1], -along[0]};
    if ((P[0] - A[0]) * out[0] + (P[1] - A[1]) * out[1] > 0) { /* away from P */
        out[0] = -out[0];
        out[1] = -out[1];
    }

    struct placed to = {.triangle = mesh->neighbor[3 * from->triangle + k]};
    unsigned top = mesh->across[3 * from->triangle + k];
    uint32_t b = mesh->triangle[3 * from->triangle + j];
    struct side side = measure_side(mesh, to.triangle, top, b);
    for (unsigned c = 0; c < 3; c++) {
        bool is_b = mesh->triangle[3 * to.triangle + c] == b;
        double x = c == top ? side.foot : is_b ? side.length / 2 : -side.length / 2;
        double y = c == top ? side.height : 0;
        for (int d = 0; d < 2; d++)
            to.at[c][d] = mid[d] + x * along[d] + y * out[d];
    }
    return to;
}

/* m(n) of the edge of t opposite corner k, in t's own frame. */
static void edge_moment(const struct dr_mesh *mesh, size_t t, size_t k, double m[3])
{
    const double *A = mesh->rest + 6 * t + 2 * ((k + 1) % 3), *B = mesh->rest + 6 * t + 2 * ((k + 2) % 3);
    double u = B[0] - A[0], v = B[1] - A[1], square = u * u + v * v; /* n = (v, -u)/l */
    m[0] = v * v / square;
    m[1] = u * u / square;
    m[2] = -2 * u * v / square;
}

/* ---- the slope of an edge -------------------------------------------------------------------- */

struct hinge { /* an inner edge with its two triangles, in the edge frame above */
    size_t triangle[2];
    unsigned corner[2]; /* opposite the edge */
    struct side side[2];
    double length;      /* mean of the two sides', m */
    bool border;        /* the two sides resist bending across the edge differently */
    double rigidity[2]; /* how much, m(n)'D m(n), N m */
    double part[2];     /* of the two flat triangles' slopes in the hinge's own; they sum to 1 */
};

/* Rigidities across an edge that differ by no more than this are the same but for round-off (relative). */
#define SAME_RIGIDITY 1e-6

/* The parts of the flat slopes: those of least energy, area/2 (2/h)^2 D (s - x_,n|T)^2 summed, which make the
 * moment the same on both sides; for one D the heights of the opposite sides. */
static void share_slope(const struct plate *plate, struct hinge *hinge)
{
    const double *h[2] = {&hinge->side[0].height, &hinge->side[1].height};
    double *D = hinge->rigidity;
    for (int s = 0; s < 2; s++) {
        const double *b = rigidity_of(plate, hinge->triangle[s]);
        double m[3];
        edge_moment(plate->mesh, hinge->triangle[s], hinge->corner[s], m);
        D[s] = b[0] * m[0] * m[0] + b[1] * m[1] * m[1] + b[2] * m[2] * m[2];
    }
    hinge->border = fabs(D[0] - D[1]) > SAME_RIGIDITY * (D[0] + D[1]);
    for (int s = 0; s < 2; s++)
        hinge->part[s] =
            hinge->border ? D[s] * *h[!s] / (D[0] * *h[1] + D[1] * *h[0]) : *h[!s] / (*h[0] + *h[1]);
}

/* All of it but rigidities and parts. Side 0 is the triangle of lower index, so that both triangles get the
 * same slope to the last bit. */
static struct hinge find_sides(const struct dr_mesh *mesh, size_t t, unsigned k)
{
    size_t n = mesh->neighbor[3 * t + k];
    unsigned across = mesh->across[3 * t + k];
    struct hinge hinge = {.triangle = {t, n}, .corner = {k, across}};
    if (n < t)
        hinge = (struct hinge){.triangle = {n, t}, .corner = {across, k}};
    uint32_t b = mesh->triangle[3 * hinge.triangle[0] + (hinge.corner[0] + 2) % 3];
    for (int s = 0; s < 2; s++)
        hinge.side[s] = measure_side(mesh, hinge.triangle[s], hinge.corner[s], b);
    hinge.length = (hinge.side[0].length + hinge.side[1].length) / 2;
    return hinge;
}

static struct hinge find_hinge(const struct plate *plate, size_t t, unsigned k)
{
    struct hinge hinge = find_sides(plate->mesh, t, k);
    share_slope(plate, &hinge);
    return hinge;
}

struct patch { /* nodes near an edge, unfolded into its frame; the first four are a, b, P, N' */
    unsigned nodes;
    uint32_t node[PATCH_NODES];
    double at[PATCH_NODES][2]; /* m */
};

static void add_to_patch(struct patch *patch, uint32_t node, double x, double y)
{
    patch->node[patch->nodes] = node;
    patch->at[patch->nodes][0] = x;
    patch->at[patch->nodes][1] = y;
    patch->nodes++;
}

/* How far a patch goes. */
struct reach {
    unsigned rings;  /* of outer nodes, 0 to 2: at most 4, 8, 16 nodes */
    bool past_jumps; /* of curvature, at clamps and where another fabric begins */
};

static const struct reach HINGE_ONLY = {0, false};

/* Adds the far corner of each triangle across an edge of `from` other than the one opposite `entry`,
 * and goes on from there for the rings left. */
static void add_outer(const struct plate *plate, const struct placed *from, unsigned entry,
                      struct reach reach, struct patch *patch)
{
    for (unsigned step = 1; reach.rings > 0 && step < 3; step++) {
        unsigned k = (entry + step) % 3;
        uint32_t across = stiff_neighbor(plate, from->triangle, k);
        if (across == DR_NONE)
            continue;
        bool jumps =
            is_held(plate, across) || plate->mesh->material[across] != plate->mesh->material[from->triangle];
        if (jumps && !reach.past_jumps)
            continue;
        struct placed outer = unfold(plate->mesh, from, k);
        unsigned top = plate->mesh->across[3 * from->triangle + k];
        add_to_patch(patch, plate->mesh->triangle[3 * outer.triangle + top], outer.at[top][0],
                     outer.at[top][1]);
        add_outer(plate, &outer, top, (struct reach){reach.rings - 1, reach.past_jumps}, patch);
    }
}

/* The hinge's four nodes and what is in reach. */
static void find_patch(const struct plate *plate, const struct hinge *hinge, struct reach reach,
                       struct patch *patch)
{
    const struct dr_mesh *mesh = plate->mesh;
    unsigned k = hinge->corner[0], i = (k + 1) % 3, j = (k + 2) % 3;
    const uint32_t *node = mesh->triangle + 3 * hinge->triangle[0];
    const struct side *low = hinge->side, *high = hinge->side + 1;

    patch->nodes = 0;
    add_to_patch(patch, node[i], -hinge->length / 2, 0);
    add_to_patch(patch, node[j], hinge->length / 2, 0);
    add_to_patch(patch, node[k], low->foot, -low->height);
    add_to_patch(patch, mesh->triangle[3 * hinge->triangle[1] + hinge->corner[1]], high->foot, high->height);

    struct placed first = {.triangle = hinge->triangle[0]};
    first.at[i][0] = -low->length / 2;
    first.at[j][0] = low->length / 2;
    first.at[k][0] = low->foot;
    first.at[k][1] = -low->height;
    struct placed second = unfold(mesh, &first, k);
    add_outer(plate, &first, k, reach, patch);
    add_outer(plate, &second, hinge->corner[1], reach, patch);
}

/* The slope of side 1 less the slope of side 0, as coefficients of a, b, P, N'. */
static void hinge_jump(const struct hinge *hinge, double jump[4])
{
    double p = hinge->side[0].foot / hinge->length, h0 = hinge->side[0].height;
    double q = hinge->side[1].foot / hinge->length, h1 = hinge->side[1].height;
    jump[0] = -((0.5 - p) / h0 + (0.5 - q) / h1);
    jump[1] = -((0.5 + p) / h0 + (0.5 + q) / h1);
    jump[2] = 1 / h0;
    jump[3] = 1 / h1;
}

/* Sum of the magnitudes of the coefficients of the hinge's own slope, for one rigidity
 * (h1 x_,n|0 + h0 x_,n|1) / H: the yardstick for a correction. */
static double hinge_slope_size(const struct hinge *hinge)
{
    double p = hinge->side[0].foot / hinge->length, h0 = hinge->side[0].height;
    double q = hinge->side[1].foot / hinge->length, h1 = hinge->side[1].height;
    double w0 = hinge->part[0] / h0, w1 = hinge->part[1] / h1;
    return w0 + w1 + fabs((0.5 - p) * w0 - (0.5 - q) * w1) + fabs((0.5 + p) * w0 - (0.5 + q) * w1);
}

/* The same at a border of rigidities, for X^2/2, XY and the sheet bent across the edge with one moment on
 * both sides (see constraint_rows), with X = x/l. The hinge's own slope is right for the last. */
static void border_error(const struct hinge *hinge, double error[3])
{
    double p = hinge->side[0].foot / hinge->length, h0 = hinge->side[0].height;
    double q = hinge->side[1].foot / hinge->length, h1 = hinge->side[1].height;
    const double *part = hinge->part;
    error[0] = part[0] * (p * p / 2 - 0.125) / h0 - part[1] * (q * q / 2 - 0.125) / h1;
    error[1] = -(part[0] * p + part[1] * q) / (h0 + h1);
    error[2] = 0;
}

/* The true slope at mid-edge (zero) less the hinge's own, 1/m, for the quadratics X^2/2, XY, Y^2/2 of
 * the sheared and scaled coordinates X = (x - y (q - p)/H)/l, Y = y/H. Zero for a parallelogram. */
static void hinge_error(const struct hinge *hinge, double error[3])
{
    if (hinge->border) {
        border_error(hinge, error);
        return;
    }
    double p = hinge->side[0].foot, h0 = hinge->side[0].height;
    double q = hinge->side[1].foot, h1 = hinge->side[1].height;
    double H = h0 + h1, X0 = (p * h1 + q * h0) / (H * hinge->length); /* X of both P and N' */
    error[0] = -(X0 * X0 / 2 - 0.125) * (h0 - h1) / (h0 * h1);
    error[1] = -X0 / H;
    error[2] = 0;
    if (fabs(X0) <= PARALLELOGRAM && fabs(h0 - h1) <= PARALLELOGRAM * H)
        error[0] = error[1] = 0;
}

static double dot(size_t n, const double *a, const double *b)
{
    double sum = 0;
    for (size_t i = 0; i < n; i++)
        sum += a[i] * b[i];
    return sum;
}

/* Gram-Schmidt on the constraints: orthonormal rows that span those imposed so far. */
struct basis {
    size_t n; /* nodes */
    unsigned count;
    double q[CONSTRAINTS][PATCH_NODES];
};

/* Removes from v what the basis explains; returns |v|^2. */
static double remove_known(const struct basis *basis, double v[PATCH_NODES])
{
    for (unsigned i = 0; i < basis->count; i++) {
        double part = dot(basis->n, basis->q[i], v);
        for (size_t j = 0; j < basis->n; j++)
            v[j] -= part * basis->q[i][j];
    }
    return dot(basis->n, v, v);
}

/* Extends the basis by `left` (what remove_known left of `row`) and moves d along it to where
 * row . d = value; the constraints met before stay met. */
static void impose(struct basis *basis, const double row[PATCH_NODES], const double left[PATCH_NODES],
                   double value, double d[PATCH_NODES])
{
    double norm = sqrt(dot(basis->n, left, left)), part = (value - dot(basis->n, row, d)) / norm;
    double *q = basis->q[basis->count++];
    for (size_t j = 0; j < basis->n; j++) {
        q[j] = left[j] / norm;
        d[j] += part * q[j];
    }
}

/* At a border of rigidities the coordinates are not sheared, as only what bends across the edge jumps there,
 * and Y^2/2 has on each side the curvature of one moment, 1 on the softer side. */
static void constraint_rows(const struct hinge *hinge, const struct patch *patch,
                            double row[CONSTRAINTS][PATCH_NODES])
{
    double H = hinge->side[0].height + hinge->side[1].height;
    double shear = hinge->border ? 0 : (hinge->side[1].foot - hinge->side[0].foot) / H;
    double stiffer = fmax(hinge->rigidity[0], hinge->rigidity[1]);
    for (unsigned i = 0; i < patch->nodes; i++) {
        double X = (patch->at[i][0] - shear * patch->at[i][1]) / hinge->length, Y = patch->at[i][1] / H;
        row[0][i] = 1;
        row[1][i] = X;
        row[2][i] = Y;
        row[3][i] = X * X / 2;
        row[4][i] = X * Y;
        row[5][i] = Y * Y / 2;
        if (hinge->border)
            row[5][i] *= hinge->rigidity[Y < 0] / stiffer; /* the other side's */
    }
}

/* The least correction d (one coefficient per node of the patch, 1/m) that vanishes on affine maps
 * and takes the values `error` on the quadratics. Returns whether it is exact: the nodes may not tell
 * all quadratics apart. */
static bool fit_correction(const struct hinge *hinge, const struct patch *patch, const double error[3],
                           double d[PATCH_NODES])
{
    double row[CONSTRAINTS][PATCH_NODES] = {{0}}, left[CONSTRAINTS][PATCH_NODES];
    struct basis basis = {.n = patch->nodes};
    constraint_rows(hinge, patch, row);
    memcpy(left, row, sizeof row);
    memset(d, 0, PATCH_NODES * sizeof *d);
    for (unsigned i = 0; i < AFFINE; i++) {
        remove_known(&basis, left[i]);
        impose(&basis, row[i], left[i], 0, d);
    }

    bool used[CONSTRAINTS] = {false};
    double largest = 0;
    while (basis.count < CONSTRAINTS) { /* the quadratic that the nodes see best comes next */
        unsigned best = AFFINE;
        double size = -1;
        for (unsigned i = AFFINE; i < CONSTRAINTS; i++) {
            double unexplained = used[i] ? -1 : remove_known(&basis, left[i]);
            if (unexplained > size) {
                size = unexplained;
                best = i;
            }
        }
        largest = fmax(largest, size);
        if (size <= UNSEEN * largest)
            break;
        used[best] = true;
        impose(&basis, row[best], left[best], error[best - AFFINE], d);
    }

    double scale = fmax(fabs(error[0]), fabs(error[1]));
    for (unsigned i = AFFINE; i < CONSTRAINTS; i++)
        if (fabs(error[i - AFFINE] - dot(basis.n, row[i], d)) > EXACT * scale)
            return false;
    return true;
}

static double size_of(const double d[PATCH_NODES])
{
    double sum = 0;
    for (int i = 0; i < PATCH_NODES; i++)
        sum += fabs(d[i]);
    return sum;
}

/* Finds the correction of an edge's slope: from the nearest ring if that is exact and not long, else
 * the shorter of one and two rings; past a clamp or another fabric's border if none this side is exact. Where
 * none is exact (fewer than 6 nodes in reach) there is none; for a pair of triangles alone that is the slope
 * of least energy. `patch` is left with the nodes that have a part in it. */
static void find_correction(const struct plate *plate, const struct hinge *hinge, struct patch *patch,
                            double d[PATCH_NODES])
{
    double error[3], limit = LONG_CORRECTION * hinge_slope_size(hinge);
    hinge_error(hinge, error);
    memset(d, 0, PATCH_NODES * sizeof *d);
    find_patch(plate, hinge, HINGE_ONLY, patch);
    if (error[0] == 0 && error[1] == 0)
        return;

    double best = INFINITY;
    const struct reach reach[] = {{1, false}, {2, false}, {1, true}, {2, true}};
    for (int i = 0; i < 4 && best > limit; i++) {
        struct patch wider;
        double fitted[PATCH_NODES];
        if (reach[i].past_jumps && best < INFINITY)
            break;
        find_patch(plate, hinge, reach[i], &wider);
        if (fit_correction(hinge, &wider, error, fitted) && size_of(fitted) < best) {
            best = size_of(fitted);
            *patch = wider;
            memcpy(d, fitted, sizeof fitted);
        }
    }
}

/* ---- the curvature of a triangle -------------------------------------------------------------- */

struct curvature { /* C of one triangle under construction */
    unsigned nodes;
    uint32_t node[TRIANGLE_NODES];
    double c[TRIANGLE_NODES][3]; /* 1/m^2 */
};

static void add_to_curvature(struct curvature *K, uint32_t node, double factor, const double m[3])
{
    unsigned i = 0;
    while (i < K->nodes && K->node[i] != node)
        i++;
    if (i == K->nodes) {
        K->node[i] = node;
        memset(K->c[i], 0, sizeof K->c[i]);
        K->nodes++;
    }
    for (int r = 0; r < 3; r++)
        K->c[i][r] += factor * m[r];
}

/* K_T += (2/h_T) (s - x_,n|T) m(n) for one inner edge of t. */
static void add_edge(const struct plate *plate, size_t t, unsigned k, struct curvature *K)
{
    struct hinge hinge = find_hinge(plate, t, k);
    unsigned mine = hinge.triangle[0] == t ? 0 : 1;
    double h = hinge.side[mine].height, H = hinge.side[0].height + hinge.side[1].height;
    double m[3], jump[4], d[PATCH_NODES];
    struct patch patch;
    edge_moment(plate->mesh, t, k, m);
    hinge_jump(&hinge, jump);

    if (is_held(plate, hinge.triangle[!mine])) { /* s is the held triangle's own slope: s - x_,n|T = J */
        find_patch(plate, &hinge, HINGE_ONLY, &patch);
        for (unsigned i = 0; i < 4; i++)
            add_to_curvature(K, patch.node[i], 2 / h * jump[i], m);
        return;
    }
    /* s - x_,n|T = J h_T/H + delta, with n out of T: delta changes sign with the side */
    double share = hinge.border ? 2 / h * hinge.part[!mine] : 2 / H;
    find_correction(plate, &hinge, &patch, d);
    double sign = mine == 0 ? 1 : -1;
    for (unsigned i = 0; i < patch.nodes; i++)
        add_to_curvature(K, patch.node[i], (i < 4 ? share * jump[i] : 0) + sign * 2 / h * d[i], m);
}

/* D -= (D f)(D f)' / (f' D f): the moment along f becomes zero. Eliminating columns one after the
 * other is the block formula D - D F (F' D F)^+ F' D; a column without rigidity has no moment yet. */
static void eliminate(double D[3][3], const double f[3], double floor)
{
    double w[3];
    for (int i = 0; i < 3; i++)
        w[i] = dot(3, D[i], f);
    double s = dot(3, w, f);
    if (s <= floor)
        return;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            D[i][j] -= w[i] * w[j] / s;
}

/* Area times rigidity of t, its free edges' slopes eliminated: lower triangle. */
static void find_rigidity(const struct plate *plate, size_t t, double d[6])
{
    const double *b = rigidity_of(plate, t);
    double D[3][3] = {{b[0], 0, 0}, {0, b[1], 0}, {0, 0, b[2]}};
    double floor = NO_RIGIDITY * (b[0] + b[1] + b[2]);
    for (unsigned k = 0; k < 3; k++)
        if (stiff_neighbor(plate, t, k) == DR_NONE) {
            double m[3];
            edge_moment(plate->mesh, t, k, m);
            eliminate(D, m, floor);
        }
    for (int i = 0, at = 0; i < 3; i++)
        for (int j = 0; j <= i; j++)
            d[at++] = plate->mesh->area[t] * D[i][j];
}

/* Leaves K without nodes if t carries no energy. */
static void find_curvature(const struct plate *plate, size_t t, struct curvature *K)
{
    unsigned inner = 0;
    K->nodes = 0;
    for (unsigned k = 0; k < 3; k++)
        inner += stiff_neighbor(plate, t, k) != DR_NONE;
    if (inner == 0 || is_limp(plate, t) || is_held(plate, t))
        return;
    for (unsigned k = 0; k < 3; k++) /* corners first: entry 0 is the one differences are taken from */
        add_to_curvature(K, plate->mesh->triangle[3 * t + k], 0, (const double[3]){0});
    for (unsigned k = 0; k < 3; k++)
        if (stiff_neighbor(plate, t, k) != DR_NONE)
            add_edge(plate, t, k, K);
}

/* ---- the element's arrays --------------------------------------------------------------------- */

/* Makes room for `entries`. Doubles, so that the work stays linear. */
static bool reserve(struct dr_bend *bend, size_t entries, size_t *capacity)
{
    if (entries <= *capacity)
        return true;
    size_t wanted = entries > SIZE_MAX / 2 ? SIZE_MAX : 2 * entries;
    if (wanted > SIZE_MAX / (3 * sizeof *bend->c) || entries > UINT32_MAX)
        return false;
    uint32_t *node = realloc(bend->node, wanted * sizeof *node);
    if (!node)
        return false;
    bend->node = node;
    double *c = realloc(bend->c, 3 * wanted * sizeof *c);
    if (!c)
        return false;
    bend->c = c;
    *capacity = wanted;
    return true;
}

/* Gives back what doubling left over; a refusal is harmless. */
static void trim(struct dr_bend *bend)
{
    size_t entries = bend->start[bend->triangles] ? bend->start[bend->triangles] : 1;
    uint32_t *node = realloc(bend->node, entries * sizeof *node);
    if (node)
        bend->node = node;
    double *c = realloc(bend->c, 3 * entries * sizeof *c);
    if (c)
        bend->c = c;
}

/* Appends C of triangle t. The first coefficient is minus the sum of the others, as the differences
 * imply: what dr_bend_energy computes and what Q says then agree far from the origin, too. */
static bool append(struct dr_bend *bend, size_t t, const struct curvature *K, size_t *capacity)
{
    size_t first = bend->start[t];
    if (!reserve(bend, first + K->nodes, capacity))
        return false;
    bend->start[t + 1] = (uint32_t)(first + K->nodes);
    for (unsigned r = 0; r < 3 && K->nodes > 0; r++) {
        double sum = 0;
        for (unsigned i = 1; i < K->nodes; i++) {
            bend->c[3 * (first + i) + r] = K->c[i][r];
            sum += K->c[i][r];
        }
        bend->c[3 * first + r] = -sum;
    }
    for (unsigned i = 0; i < K->nodes; i++)
        bend->node[first + i] = K->node[i];
    return true;
}

drape_status dr_bend_new(const struct dr_mesh *mesh, const double *rigidity, struct dr_bend **ret,
                         drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    struct plate plate = {mesh, rigidity};
    size_t capacity = 0, triangles = mesh->triangles;
    struct dr_bend *bend = calloc(1, sizeof *bend);
    if (!bend)
        return dr_out_of_memory(reterr);
    bend->triangles = triangles;
    bend->start = calloc(triangles + 1, sizeof *bend->start);
    bend->d = calloc(triangles ? triangles : 1, 6 * sizeof *bend->d);
    if (!bend->start || !bend->d || !reserve(bend, 1, &capacity)) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    for (size_t t = 0; t < triangles; t++) {
        struct curvature K;
        find_curvature(&plate, t, &K);
        if (K.nodes > 0)
            find_rigidity(&plate, t, bend->d + 6 * t);
        if (!append(bend, t, &K, &capacity)) {
            status = dr_out_of_memory(reterr);
            goto cleanup;
        }
    }
    trim(bend);
    *ret = bend;
    bend = NULL;

cleanup:
    dr_bend_free(bend);
    return status;
}

struct dr_bend *dr_bend_free(struct dr_bend *bend)
{
    if (bend) {
        free(bend->start);
        free(bend->node);
        free(bend->c);
        free(bend->d);
        free(bend);
    }
    return NULL;
}

size_t dr_bend_bytes(const struct dr_bend *bend)
{
    size_t entries = bend->start[bend->triangles];
    return sizeof *bend + (bend->triangles + 1) * sizeof *bend->start +
           entries * (sizeof *bend->node + 3 * sizeof *bend->c) + bend->triangles * 6 * sizeof *bend->d;
}

/* ---- energy and gradient ---------------------------------------------------------------------- */

/* y = D x, D given by its lower triangle. */
static void times_rigidity(const double d[6], const double x[3], double y[3])
{
    y[0] = d[0] * x[0] + d[1] * x[1] + d[3] * x[2];
    y[1] = d[1] * x[0] + d[2] * x[1] + d[4] * x[2];
    y[2] = d[3] * x[0] + d[4] * x[1] + d[5] * x[2];
}

/* Two coordinates that the processor may work on at once. */
typedef double lanes __attribute__((vector_size(2 * sizeof(double)), aligned(sizeof(double)), may_alias));

static inline void lanes_times_rigidity(const double d[6], const lanes x[3], lanes y[3])
{
    y[0] = d[0] * x[0] + d[1] * x[1] + d[3] * x[2];
    y[1] = d[1] * x[0] + d[2] * x[1] + d[4] * x[2];
    y[2] = d[3] * x[0] + d[4] * x[1] + d[5] * x[2];
}

double dr_bend_energy(const struct dr_bend *bend, const double *x, double *g)
{
    double energy = 0;
    for (size_t t = 0; t < bend->triangles; t++) {
        size_t first = bend->start[t], end = bend->start[t + 1];
        if (first == end)
            continue;
        const double *origin = x + 3 * (size_t)bend->node[first], *d = bend->d + 6 * t;
        const lanes origin_xy = *(const lanes *)origin;
        lanes K_xy[3] = {{0}}, M_xy[3]; /* by component: curvature, moment times area */
        double K_z[3] = {0}, M_z[3];
        for (size_t e = first + 1; e < end; e++) {
            const double *at = x + 3 * (size_t)bend->node[e], *c = bend->c + 3 * e;
            const lanes xy = *(const lanes *)at - origin_xy;
            const double z = at[2] - origin[2];
            for (int r = 0; r < 3; r++) {
                K_xy[r] += c[r] * xy;
                K_z[r] += c[r] * z;
            }
        }
        lanes_times_rigidity(d, K_xy, M_xy);
        times_rigidity(d, K_z, M_z);
        const lanes of_xy = K_xy[0] * M_xy[0] + K_xy[1] * M_xy[1] + K_xy[2] * M_xy[2];
        energy += of_xy[0] / 2;
        energy += of_xy[1] / 2;
        energy += (K_z[0] * M_z[0] + K_z[1] * M_z[1] + K_z[2] * M_z[2]) / 2;
        if (!g)
            continue;
        for (size_t e = first; e < end; e++) {
            const double *c = bend->c + 3 * e;
            double *to = g + 3 * (size_t)bend->node[e];
            *(lanes *)to += c[0] * M_xy[0] + c[1] * M_xy[1] + c[2] * M_xy[2];
            to[2] += c[0] * M_z[0] + c[1] * M_z[1] + c[2] * M_z[2];
        }
    }
    return energy;
}

/* ---- the stiffness ----------------------------------------------------------------------------- */

/* Q = sum_t C_t' (A D)_t C_t, one column after the other: the entries that meet the column's node say
 * which triangles have a part in it. */
struct columns {
    const struct dr_bend *bend;
    size_t *start;      /* nodes+1: of the entries by node */
    uint32_t *entry;    /* entries, by node, ascending */
    uint32_t *triangle; /* of each of those */
    uint32_t *seen;     /* nodes: the last column that reached this row, plus 1 */
    double *sum;        /* nodes: its value there */
    uint32_t *row;      /* nodes: the rows reached */
};

static void columns_done(struct columns *columns)
{
    free(columns->start);
    free(columns->entry);
    free(columns->triangle);
    free(columns->seen);
    free(columns->sum);
    free(columns->row);
}

/* Lists the entries of each node (a counting sort). False: out of memory. */
static bool columns_init(struct columns *columns, const struct dr_bend *bend, size_t nodes)
{
    size_t entries = bend->start[bend->triangles];
    *columns = (struct columns){.bend = bend};
    columns->start = calloc(nodes + 2, sizeof *columns->start);
    columns->entry = malloc((entries + 1) * sizeof *columns->entry);
    columns->triangle = malloc((entries + 1) * sizeof *columns->triangle);
    columns->seen = calloc(nodes + 1, sizeof *columns->seen);
    columns->sum = malloc((nodes + 1) * sizeof *columns->sum);
    columns->row = malloc((nodes + 1) * sizeof *columns->row);
    if (!columns->start || !columns->entry || !columns->triangle || !columns->seen || !columns->sum ||
        !columns->row)
        return false;

    size_t *next = columns->start + 1; /* while filling, next[j] is where node j's next entry goes */
    for (size_t e = 0; e < entries; e++)
        next[bend->node[e] + 1]++;
    for (size_t j = 0; j < nodes; j++)
        next[j + 1] += next[j];
    for (size_t t = 0; t < bend->triangles; t++)
        for (size_t e = bend->start[t]; e < bend->start[t + 1]; e++) {
            size_t slot = next[bend->node[e]]++;
            columns->entry[slot] = (uint32_t)e;
            columns->triangle[slot] = (uint32_t)t;
        }
    return true;
}

static int compare_rows(const void *left, const void *right)
{
    uint32_t a = *(const uint32_t *)left, b = *(const uint32_t *)right;
    return (a > b) - (a < b);
}

/* Sums column j from its diagonal down into columns->sum; its rows, ascending, go to columns->row.
 * Returns how many: the diagonal is always among them. */
static size_t sum_column(struct columns *columns, uint32_t j)
{
    const struct dr_bend *bend = columns->bend;
    size_t rows = 1;
    columns->row[0] = j;
    columns->seen[j] = j + 1;
    columns->sum[j] = 0;
    for (size_t i = columns->start[j]; i < columns->start[j + 1]; i++) {
        size_t t = columns->triangle[i];
        double Dc[3];
        times_rigidity(bend->d + 6 * t, bend->c + 3 * (size_t)columns->entry[i], Dc);
        for (size_t e = bend->start[t]; e < bend->start[t + 1]; e++) {
            uint32_t row = bend->node[e];
            if (row < j)
                continue;
            if (columns->seen[row] != j + 1) {
                columns->seen[row] = j + 1;
                columns->sum[row] = 0;
                columns->row[rows++] = row;
            }
            columns->sum[row] += dot(3, bend->c + 3 * e, Dc);
        }
    }
    qsort(columns->row, rows, sizeof *columns->row, compare_rows);
    return rows;
}

drape_status dr_bend_stiffness_new(const struct dr_bend *bend, size_t nodes, struct dr_bend_stiffness **ret,
                                   drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    struct columns columns = {0};
    struct dr_bend_stiffness *q = calloc(1, sizeof *q);
    if (!q || !columns_init(&columns, bend, nodes)) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    q->nodes = nodes;
    q->start = calloc(nodes + 1, sizeof *q->start);
    if (!q->start) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    /* Once to learn the length of each column, once to keep it. */
    for (size_t j = 0; j < nodes; j++)
        q->start[j + 1] = q->start[j] + sum_column(&columns, (uint32_t)j);
    q->row = malloc((q->start[nodes] + 1) * sizeof *q->row);
    q->value = malloc((q->start[nodes] + 1) * sizeof *q->value);
    if (!q->row || !q->value) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    memset(columns.seen, 0, nodes * sizeof *columns.seen);
    for (size_t j = 0; j < nodes; j++) {
        size_t rows = sum_column(&columns, (uint32_t)j), at = q->start[j];
        for (size_t i = 0; i < rows; i++) {
            q->row[at + i] = columns.row[i];
            q->value[at + i] = columns.sum[columns.row[i]];
        }
    }
    *ret = q;
    q = NULL;

cleanup:
    columns_done(&columns);
    dr_bend_stiffness_free(q);
    return status;
}

/* Area times rigidity of t across its edge opposite corner k; 0: t carries no energy. */
static double rigidity_across(const struct dr_bend *bend, const struct dr_mesh *mesh, size_t t, unsigned k)
{
    double m[3], moment[3];
    if (bend->start[t] == bend->start[t + 1])
        return 0;
    edge_moment(mesh, t, k, m);
    times_rigidity(bend->d + 6 * t, m, moment);
    return dot(3, m, moment);
}

/* Appends the hinge of t's edge opposite corner k as an element of its own, with the one "curvature" J. */
static bool append_hinge(const struct dr_bend *bend, const struct dr_mesh *mesh, size_t t, unsigned k,
                         struct dr_bend *hinges, size_t *capacity)
{
    struct hinge hinge = find_sides(mesh, t, k);
    double jump[4], rigidity = 0, area = 0;
    struct curvature K = {0};
    unsigned i = hinge.corner[0];
    const uint32_t *node = mesh->triangle + 3 * hinge.triangle[0];
    const uint32_t of[4] = {node[(i + 1) % 3], node[(i + 2) % 3], node[i],
                            mesh->triangle[3 * hinge.triangle[1] + hinge.corner[1]]};
    for (int s = 0; s < 2; s++) {
        double across = rigidity_across(bend, mesh, hinge.triangle[s], hinge.corner[s]);
        rigidity += across;
        area += across > 0 ? mesh->area[hinge.triangle[s]] : 0;
    }
    if (!(rigidity > 0))
        return true;
    hinge_jump(&hinge, jump);
    for (int j = 0; j < 4; j++)
        add_to_curvature(&K, of[j], jump[j], (const double[3]){1, 0, 0});
    hinges->d[6 * hinges->triangles] =
        2 * DR_HINGE_WEIGHT * rigidity / area * hinge.length / (hinge.side[0].height + hinge.side[1].height);
    return append(hinges, hinges->triangles++, &K, capacity);
}

/* Whether the element has a slope of the edge of t opposite corner k, t the lower of its triangles. */
static bool has_hinge(const struct dr_bend *bend, const struct dr_mesh *mesh, size_t t, unsigned k)
{
    const struct plate plate = {mesh, NULL};
    uint32_t n = mesh->neighbor[3 * t + k];
    if (n == DR_NONE || n < t)
        return false;
    bool bends[2] = {bend->start[t] < bend->start[t + 1], bend->start[n] < bend->start[n + 1]};
    return (bends[0] && bends[1]) || (bends[0] && is_held(&plate, n)) || (bends[1] && is_held(&plate, t));
}

drape_status dr_bend_hinges_new(const struct dr_bend *bend, const struct dr_mesh *mesh,
                                struct dr_bend_stiffness **ret, drape_error *reterr)
{
    size_t most = 3 * mesh->triangles / 2 + 1, capacity = 0;
    struct dr_bend hinges = {.start = calloc(most + 1, sizeof *hinges.start),
                             .d = calloc(6 * most, sizeof *hinges.d)};
    bool made = hinges.start && hinges.d && reserve(&hinges, 1, &capacity);
    for (size_t t = 0; made && t < mesh->triangles; t++)
        for (unsigned k = 0; made && k < 3; k++)
            if (has_hinge(bend, mesh, t, k))
                made = append_hinge(bend, mesh, t, k, &hinges, &capacity);
    drape_status status =
        made ? dr_bend_stiffness_new(&hinges, mesh->nodes, ret, reterr) : dr_out_of_memory(reterr);
    free(hinges.start);
    free(hinges.node);
    free(hinges.c);
    free(hinges.d);
    return status;
}

void dr_bend_stiffness_subtract(struct dr_bend_stiffness *q, const struct dr_bend_stiffness *hinges)
{
    for (size_t j = 0; j < q->nodes; j++) {
        size_t at = q->start[j], end = q->start[j + 1];
        for (size_t i = hinges->start[j]; i < hinges->start[j + 1]; i++) {
            while (at < end && q->row[at] < hinges->row[i])
                at++;
            if (at < end && q->row[at] == hinges->row[i])
                q->value[at] -= hinges->value[i];
        }
    }
}

void dr_bend_stiffness_multiply(const struct dr_bend_stiffness *q, const double *from, double *to)
{
    for (size_t j = 0; j < q->nodes; j++) {
        const double *x = from + 3 * j, diagonal = q->value[q->start[j]], z = x[2];
        const lanes xy = *(const lanes *)x;
        lanes sum_xy = diagonal * xy;
        double sum_z = diagonal * z;
        for (size_t i = q->start[j] + 1; i < q->start[j + 1]; i++) {
            const double *other = from + 3 * (size_t)q->row[i], value = q->value[i];
            double *there = to + 3 * (size_t)q->row[i];
            sum_xy += value * *(const lanes *)other;
            sum_z += value * other[2];
            *(lanes *)there += value * xy;
            there[2] += value * z;
        }
        *(lanes *)(to + 3 * j) += sum_xy;
        to[3 * j + 2] += sum_z;
    }
}

struct dr_bend_stiffness *dr_bend_stiffness_free(struct dr_bend_stiffness *q)
{
    if (q) {
        free(q->start);
        free(q->row);
        free(q->value);
        free(q);
    }
    return NULL;
}

size_t dr_bend_stiffness_bytes(const struct dr_bend_stiffness *q)
{
    return sizeof *q + (q->nodes + 1) * sizeof *q->start +
           q->start[q->nodes] * (sizeof *q->row + sizeof *q->value);
}
