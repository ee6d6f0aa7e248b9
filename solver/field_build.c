/* field_build.c - from a closed mesh to its distance field.
 *
 *   1. place    a grid around the mesh; all that follows is in node units (spacing 1)
 *   2. inside   winding numbers along the grid lines
 *   3. mark     the blocks within reach of the surface, and those with a node inside
 *   4. splat    exact distances from each triangle to the nodes within SPLAT of it
 *   5. spread   nearest triangles from node to node, over all that is left
 *   6. finish   square roots, signs, metres
 *   7. sharpen  from distances to the spline's coefficients
 *
 * Steps 1 to 3 tell what the field will cost; too much, and they start again with a wider spacing. Steps 3 to
 * 5 are done in two halves of the grid (hand.h), cut where half of the triangles lie on either side; what has
 * to be handed across the cut follows. */
#include "field.h"

#include <assert.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "winding.h"

#define SPLAT       4.0 /* nodes: distances are exact this far from the surface */
#define STENCIL     3.5 /* nodes: no node of a 4x4x4 stencil is farther from the point it serves */
#define NO_TRIANGLE UINT32_MAX

/* A triangle a + v ab + w ac, with the dot products that the closest point needs. */
struct facet {
    double a[3], ab[3], ac[3];
    double bb, bc, cc;      /* ab.ab, ab.ac, ac.ac */
    double low[3], high[3]; /* bounding box */
};

/* Blocks from .. to-1 along an axis: all of the grid, or half of it. */
struct span {
    int axis;
    uint32_t from, to;
};

/* Each half works with a copy of it. */
struct builder {
    const uint32_t *triangle;
    size_t triangles, vertices;
    struct dr_field *field; /* under construction */
    double *point;          /* 3*vertices, node units */
    struct facet *facet;    /* triangles, node units */
    struct dr_run *run;     /* runs of inside nodes */
    size_t runs;
    double band;       /* nodes: outside distances matter up to here */
    uint32_t *place;   /* field->blocks: index of the block in the table */
    uint32_t *nearest; /* nodes: triangle; NO_TRIANGLE: none yet */
    size_t work;       /* point-triangle distances of this pass, done or foreseen */
    struct dr_hand *hand;
    struct span span;    /* where it works */
    uint32_t cut;        /* between the halves, along that axis */
    struct queue *queue; /* of step 5: 2 */
};

/* ---- the distance to a triangle -------------------------------------------------------------- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void facet_init(struct facet *f, const double *a, const double *b, const double *c)
{
    for (int d = 0; d < 3; d++) {
        f->a[d] = a[d];
        f->ab[d] = b[d] - a[d];
        f->ac[d] = c[d] - a[d];
        f->low[d] = fmin(a[d], fmin(b[d], c[d]));
        f->high[d] = fmax(a[d], fmax(b[d], c[d]));
    }
    f->bb = dot(f->ab, f->ab);
    f->bc = dot(f->ab, f->ac);
    f->cc = dot(f->ac, f->ac);
}

static double ratio(double part, double whole)
{
    return whole > 0 ? part / whole : 0; /* a collapsed edge or triangle */
}

/* Squared distance from p. The closest point is found by Voronoi region (Ericson, Real-Time Collision
 * Detection, 5.1.5), with b and c measured from a, so that only two dot products are new. */
static double facet_square(const struct facet *f, const double p[3])
{
    double ap[3] = {p[0] - f->a[0], p[1] - f->a[1], p[2] - f->a[2]}, v, w;
    double a1 = dot(f->ab, ap), a2 = dot(f->ac, ap); /* p - a against the two edges */
    double b1 = a1 - f->bb, b2 = a2 - f->bc;         /* p - b */
    double c1 = a1 - f->bc, c2 = a2 - f->cc;         /* p - c */
    double in_c = a1 * b2 - b1 * a2, in_b = c1 * a2 - a1 * c2, in_a = b1 * c2 - c1 * b2;
    if (a1 <= 0 && a2 <= 0) {
        v = w = 0;
    } else if (b1 >= 0 && b2 <= b1) {
        v = 1;
        w = 0;
    } else if (c2 >= 0 && c1 <= c2) {
        v = 0;
        w = 1;
    } else if (in_c <= 0 && a1 >= 0 && b1 <= 0) {
        v = ratio(a1, a1 - b1);
        w = 0;
    } else if (in_b <= 0 && a2 >= 0 && c2 <= 0) {
        v = 0;
        w = ratio(a2, a2 - c2);
    } else if (in_a <= 0 && b2 >= b1 && c1 >= c2) {
        w = ratio(b2 - b1, (b2 - b1) + (c1 - c2));
        v = 1 - w;
    } else {
        v = ratio(in_b, in_a + in_b + in_c);
        w = ratio(in_c, in_a + in_b + in_c);
    }
    double square = 0;
    for (int d = 0; d < 3; d++) {
        double gap = ap[d] - v * f->ab[d] - w * f->ac[d];
        square += gap * gap;
    }
    return square;
}

/* Numbers that the processor works on at once; comparing them gives 0 or -1 each. */
#define LANES 4
typedef double quad __attribute__((vector_size(LANES * sizeof(double))));
typedef float quad_float __attribute__((vector_size(LANES * sizeof(float))));
typedef int64_t mask __attribute__((vector_size(LANES * sizeof(int64_t))));
typedef int32_t mask_float __attribute__((vector_size(LANES * sizeof(int32_t))));

#define inlined                static inline __attribute__((always_inline))
#define CHOOSE(which, yes, no) ((quad)(((which) & (mask)(yes)) | (~(which) & (mask)(no))))

/* facet_square of several points, to the same bytes. */
inlined void find_squares(const struct facet *f, const quad p[3], quad *ret)
{
    const double *ab = f->ab, *ac = f->ac;
    const quad zero = {0}, one = 1 - zero;
    quad ap[3] = {p[0] - f->a[0], p[1] - f->a[1], p[2] - f->a[2]};
    quad a1 = ab[0] * ap[0] + ab[1] * ap[1] + ab[2] * ap[2]; /* p - a against the two edges */
    quad a2 = ac[0] * ap[0] + ac[1] * ap[1] + ac[2] * ap[2];
    quad b1 = a1 - f->bb, b2 = a2 - f->bc; /* p - b */
    quad c1 = a1 - f->bc, c2 = a2 - f->cc; /* p - c */
    quad in_c = a1 * b2 - b1 * a2, in_b = c1 * a2 - a1 * c2, in_a = b1 * c2 - c1 * b2;

    mask at_a = (a1 <= 0) & (a2 <= 0);
    mask at_b = (b1 >= 0) & (b2 <= b1) & ~at_a, corner = at_a | at_b;
    mask at_c = (c2 >= 0) & (c1 <= c2) & ~corner;
    corner |= at_c;
    mask on_ab = (in_c <= 0) & (a1 >= 0) & (b1 <= 0) & ~corner, found = corner | on_ab;
    mask on_ac = (in_b <= 0) & (a2 >= 0) & (c2 <= 0) & ~found;
    found |= on_ac;
    mask on_bc = (in_a <= 0) & (b2 >= b1) & (c1 >= c2) & ~found;

    /* a + v ab + w ac, v and w being parts of a whole; on bc v is what w leaves. */
    quad v = CHOOSE(at_b, one, CHOOSE(on_ab, a1, CHOOSE(found, zero, in_b)));
    quad w = CHOOSE(on_bc, b2 - b1, in_c), whole = CHOOSE(on_bc, (b2 - b1) + (c1 - c2), in_a + in_b + in_c);
    w = CHOOSE(at_c, one, CHOOSE(on_ac, a2, CHOOSE(found, zero, w)));
    whole = CHOOSE(corner, one, CHOOSE(on_ab, a1 - b1, CHOOSE(on_ac, a2 - c2, whole)));
    mask sound = whole > 0; /* not so: a collapsed edge or triangle */
    v = CHOOSE(sound, v / whole, zero);
    w = CHOOSE(sound, w / whole, zero);
    v = CHOOSE(on_bc, 1 - w, v);
    *ret = zero;
    for (int d = 0; d < 3; d++) {
        quad gap = ap[d] - v * ab[d] - w * ac[d];
        *ret += gap * gap;
    }
}

/* Neighbours along x: their place on the grid, and those from .. to - 1 that count. */
struct row {
    uint32_t first, from, to, j, k;
};

/* Squared distances from the triangle's bounding box: no point is nearer to the triangle itself. */
inlined void find_box_squares(const struct facet *f, const quad p[3], quad *ret)
{
    const quad zero = {0};
    *ret = zero;
    for (int d = 0; d < 3; d++) {
        quad below = f->low[d] - p[d], above = p[d] - f->high[d], gap = CHOOSE(below > above, below, above);
        gap = CHOOSE(gap > 0, gap, zero);
        *ret += gap * gap;
    }
}

/* Offers triangle t to a row, whose nodes have those squared distances and triangles: it stays with those
 * that it is nearer to. */
inlined void offer_row_in(const struct facet *f, uint32_t t, const struct row *row, float *value,
                          uint32_t *nearest)
{
    const mask_float i = (mask_float){0, 1, 2, 3} + (int32_t)row->first;
    const mask_float counts = (i >= (int32_t)row->from) & (i < (int32_t)row->to);
    const quad zero = {0}, p[3] = {__builtin_convertvector(i, quad), zero + row->j, zero + row->k};
    quad_float before;
    mask_float triangle;
    quad exact;
    memcpy(&before, value, sizeof before);
    memcpy(&triangle, nearest, sizeof triangle);

    find_box_squares(f, p, &exact); /* farther by more than round-off: most are */
    mask_float nearer = (__builtin_convertvector(exact, quad_float) < before * 1.00001f + 0.00001f) & counts;
    uint64_t any[2];
    memcpy(any, &nearer, sizeof any);
    if (!(any[0] | any[1]))
        return;
    find_squares(f, p, &exact);
    quad_float square = __builtin_convertvector(exact, quad_float);
    nearer = (square < before) & counts;
    before = (quad_float)((nearer & (mask_float)square) | (~nearer & (mask_float)before));
    triangle = (nearer & (int32_t)t) | (~nearer & triangle);
    memcpy(value, &before, sizeof before);
    memcpy(nearest, &triangle, sizeof triangle);
}

#ifdef __x86_64__
__attribute__((target("avx2"))) static void
offer_row_fast(const struct facet *f, uint32_t t, const struct row *row, float *value, uint32_t *nearest)
{
    offer_row_in(f, t, row, value, nearest);
}
#endif

/* The same bytes either way. */
static void offer_row(const struct facet *f, uint32_t t, const struct row *row, float *value,
                      uint32_t *nearest)
{
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2")) {
        offer_row_fast(f, t, row, value, nearest);
        return;
    }
#endif
    offer_row_in(f, t, row, value, nearest);
}

/* Whether the distance from p is no more than `far`: a corner or the box tells most of the time. */
static bool is_within(const struct facet *f, const double p[3], double far)
{
    double corner = 0, box = 0;
    for (int d = 0; d < 3; d++) {
        double below = f->low[d] - p[d], above = p[d] - f->high[d], gap = below > above ? below : above;
        gap = (gap + fabs(gap)) / 2; /* 0 inside; a comparison would be a branch */
        corner += (p[d] - f->a[d]) * (p[d] - f->a[d]);
        box += gap * gap;
    }
    return corner <= far * far || (box <= far * far && facet_square(f, p) <= far * far);
}

/* ---- 1. place -------------------------------------------------------------------------------- */

/* Puts the grid around the mesh; false when its table would break the limit. The margin leaves the
 * outermost layer of blocks farther than the band from the mesh. The odd fractions keep grid lines
 * off the round coordinates that meshes like. */
static bool place_grid(struct builder *b, const double low[3], const double high[3], double spacing)
{
    static const double fraction[3] = {0.413, 0.271, 0.339};
    struct dr_field *field = b->field;
    double blocks = 1;
    field->spacing = spacing;
    b->band = field->reach / spacing + STENCIL;
    double margin = ceil(b->band) + DR_BLOCK + 1;
    for (int d = 0; d < 3; d++) {
        field->origin[d] = low[d] - (margin + fraction[d]) * spacing;
        double nodes = (high[d] - low[d]) / spacing + 2 * margin + 1;
        double side = ceil(nodes / DR_BLOCK);
        blocks *= side;
        if (!(blocks <= DR_FIELD_MAX_TABLE))
            return false;
        field->side[d] = (uint32_t)side;
    }
    return true;
}

static void measure_box(const double *positions, size_t vertices, double low[3], double high[3])
{
    for (int d = 0; d < 3; d++) {
        low[d] = INFINITY;
        high[d] = -INFINITY;
        for (size_t v = 0; v < vertices; v++) {
            low[d] = fmin(low[d], positions[3 * v + d]);
            high[d] = fmax(high[d], positions[3 * v + d]);
        }
    }
}

static void scale_mesh(struct builder *b, const double *positions)
{
    for (size_t i = 0; i < 3 * b->vertices; i++)
        b->point[i] = (positions[i] - b->field->origin[i % 3]) / b->field->spacing;
    for (size_t t = 0; t < b->triangles; t++) {
        const uint32_t *corner = b->triangle + 3 * t;
        facet_init(b->facet + t, b->point + 3 * (size_t)corner[0], b->point + 3 * (size_t)corner[1],
                   b->point + 3 * (size_t)corner[2]);
    }
}

/* ---- halves ---------------------------------------------------------------------------------- */

/* Triangles that reach below block `at` of the axis. */
static size_t count_below(const struct builder *b, int axis, uint32_t at)
{
    size_t count = 0;
    for (size_t t = 0; t < b->triangles; t++)
        count += b->facet[t].low[axis] < (double)DR_BLOCK * at;
    return count;
}

/* The first cut along the longest side that half of the triangles lie below. */
static void choose_cut(struct builder *b)
{
    const uint32_t *side = b->field->side;
    int axis = side[1] >= side[0] && side[1] >= side[2] ? 1 : side[2] > side[0] ? 2 : 0;
    uint32_t low = 1, high = side[axis] - 1; /* there are three blocks at least: the outermost are empty */
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (2 * count_below(b, axis, middle) < b->triangles)
            low = middle + 1;
        else
            high = middle;
    }
    b->span = (struct span){axis, 0, side[axis]};
    b->cut = low;
}

typedef void half_step(struct builder *b);

struct halves {
    struct builder builder[2];
    half_step *step;
};

static void run_half(void *context, int half)
{
    struct halves *halves = context;
    halves->step(halves->builder + half);
}

/* Takes a step in both halves of the grid, which write to no block of each other's. */
static void in_halves(struct builder *b, half_step *step)
{
    struct halves halves = {{*b, *b}, step};
    halves.builder[0].span.to = halves.builder[1].span.from = b->cut;
    halves.builder[0].work = halves.builder[1].work = 0;
    dr_hand_both(b->hand, run_half, &halves);
    b->work += halves.builder[0].work + halves.builder[1].work;
}

/* ---- 3. mark --------------------------------------------------------------------------------- */

static size_t table_index(const struct dr_field *field, uint32_t i, uint32_t j, uint32_t k)
{
    return ((size_t)k * field->side[1] + j) * field->side[0] + i;
}

/* A box of blocks, both ends included. */
struct block_box {
    uint32_t low[3], high[3];
};

typedef void block_visitor(struct builder *b, uint32_t triangle, const uint32_t block[3]);

/* Visits the blocks of the box that have nodes within `band` of triangle t, and perhaps a few more:
 * halves the box until it is one block or its bounding sphere is out of the band. */
static void visit_near_blocks(struct builder *b, uint32_t t, struct block_box box, double band,
                              block_visitor *visit)
{
    double centre[3], half[3];
    int longest = 0;
    for (int d = 0; d < 3; d++) {
        double first = (double)DR_BLOCK * box.low[d], last = (double)DR_BLOCK * box.high[d] + DR_BLOCK - 1;
        centre[d] = (first + last) / 2;
        half[d] = (last - first) / 2;
        if (half[d] > half[longest])
            longest = d;
    }
    double far = band + sqrt(dot(half, half));
    b->work++;
    if (!is_within(b->facet + t, centre, far))
        return;
    if (box.low[longest] == box.high[longest]) {
        visit(b, t, box.low);
        return;
    }
    struct block_box upper = box;
    uint32_t middle = box.low[longest] + (box.high[longest] - box.low[longest]) / 2;
    box.high[longest] = middle;
    upper.low[longest] = middle + 1;
    visit_near_blocks(b, t, box, band, visit);
    visit_near_blocks(b, t, upper, band, visit);
}

/* Visits, for every triangle, the blocks of the span within `band` of it, until that is too much work. A half
 * knows only of its own: what is refused in the end may have taken twice the limit. */
static void visit_surface(struct builder *b, double band, block_visitor *visit)
{
    const struct span *span = &b->span;
    for (uint32_t t = 0; t < b->triangles && b->work <= DR_FIELD_MAX_WORK; t++) {
        struct block_box box;
        for (int d = 0; d < 3; d++) {
            box.low[d] = (uint32_t)(b->facet[t].low[d] - band) / DR_BLOCK;
            box.high[d] = (uint32_t)(b->facet[t].high[d] + band) / DR_BLOCK;
        }
        if (box.low[span->axis] < span->from)
            box.low[span->axis] = span->from;
        if (box.high[span->axis] >= span->to)
            box.high[span->axis] = span->to - 1;
        if (box.low[span->axis] <= box.high[span->axis])
            visit_near_blocks(b, t, box, band, visit);
    }
}

/* The nodes of one block that lie within SPLAT of a triangle's bounding box: from .. to-1. */
struct node_box {
    uint32_t from[3], to[3];
};

static struct node_box splat_box(const struct facet *f, const uint32_t block[3])
{
    struct node_box box;
    for (int d = 0; d < 3; d++) {
        double first = (double)DR_BLOCK * block[d];
        box.from[d] = (uint32_t)fmax(first, ceil(f->low[d] - SPLAT));
        box.to[d] = (uint32_t)fmin(first + DR_BLOCK, floor(f->high[d] + SPLAT) + 1);
    }
    return box;
}

/* Marks the block, and counts what step 4 will have to do there. */
static void mark_block(struct builder *b, uint32_t t, const uint32_t block[3])
{
    struct node_box box = splat_box(b->facet + t, block);
    size_t nodes = 1;
    for (int d = 0; d < 3; d++)
        nodes *= box.to[d] > box.from[d] ? box.to[d] - box.from[d] : 0;
    b->work += nodes;
    b->field->table[table_index(b->field, block[0], block[1], block[2])] = 1;
}

static void mark_half(struct builder *b)
{
    visit_surface(b, b->band, mark_block);
}

/* Marks the blocks that the field needs and numbers them; false when they are too many, or too much work. */
static bool mark_blocks(struct builder *b)
{
    struct dr_field *field = b->field;
    in_halves(b, mark_half);
    if (b->work > DR_FIELD_MAX_WORK)
        return false;
    for (size_t r = 0; r < b->runs; r++) {
        const struct dr_run *run = b->run + r;
        for (uint32_t i = run->from / DR_BLOCK; i <= (run->to - 1) / DR_BLOCK; i++)
            field->table[table_index(field, i, run->j / DR_BLOCK, run->k / DR_BLOCK)] = 1;
    }
    size_t table = table_index(field, 0, 0, field->side[2]);
    field->blocks = 1; /* the far block */
    for (size_t i = 0; i < table; i++)
        if (field->table[i])
            field->table[i] = (uint32_t)field->blocks++;
    return field->blocks <= DR_FIELD_MAX_BLOCKS;
}

/* Steps 1 to 3 at one spacing. *ret_fits: within the limits. */
static drape_status try_spacing(struct builder *b, const double *positions, const double low[3],
                                const double high[3], double spacing, bool *ret_fits, drape_error *reterr)
{
    struct dr_field *field = b->field;
    *ret_fits = false;
    b->work = 0;
    free(b->run);
    free(field->table);
    b->run = NULL;
    field->table = NULL;
    if (!place_grid(b, low, high, spacing))
        return DRAPE_OK;
    scale_mesh(b, positions);
    struct dr_run *run = NULL;
    size_t runs = 0, work = 0;
    drape_status status =
        dr_winding_runs(b->point, b->triangle, b->triangles, DR_FIELD_MAX_WORK, &work, &run, &runs, reterr);
    if (status < 0 || !run)
        return status;
    b->run = run;
    b->runs = runs;
    b->work = work;
    field->table = calloc(table_index(field, 0, 0, field->side[2]), sizeof *field->table);
    if (!field->table)
        return dr_out_of_memory(reterr);
    choose_cut(b);
    *ret_fits = mark_blocks(b);
    return DRAPE_OK;
}

static drape_status choose_spacing(struct builder *b, const double *positions, int64_t number,
                                   drape_error *reterr)
{
    double low[3], high[3];
    bool fits = false;
    measure_box(positions, b->vertices, low, high);
    for (double spacing = DR_FIELD_FINEST; spacing < 1.001 * DR_FIELD_COARSEST && !fits; spacing *= sqrt(2)) {
        drape_status status = try_spacing(b, positions, low, high, spacing, &fits, reterr);
        if (status < 0)
            return status;
    }
    if (!fits)
        return dr_fail_at(reterr, DRAPE_EINVAL, DRAPE_AT_BODY, number, number, NULL,
                          "too large for a distance field: %.3g x %.3g x %.3g m even at %g mm between nodes",
                          high[0] - low[0], high[1] - low[1], high[2] - low[2], 1e3 * DR_FIELD_COARSEST);
    return DRAPE_OK;
}

/* ---- 4. splat -------------------------------------------------------------------------------- */

/* Squared distances to start from: outside nothing beyond the band matters, inside everything does. */
static bool allocate_nodes(struct builder *b)
{
    struct dr_field *field = b->field;
    size_t nodes = field->blocks * DR_BLOCK_NODES;
    b->nearest = malloc(nodes * sizeof *b->nearest);
    b->place = malloc(field->blocks * sizeof *b->place);
    field->value = malloc(nodes * sizeof *field->value);
    if (!b->nearest || !b->place || !field->value)
        return false;
    for (size_t n = 0; n < nodes; n++) {
        b->nearest[n] = NO_TRIANGLE;
        field->value[n] = (float)(b->band * b->band);
    }
    for (size_t i = 0, table = table_index(field, 0, 0, field->side[2]); i < table; i++)
        b->place[field->table[i]] = (uint32_t)i; /* whatever lands in the far block's entry is not used */
    return true;
}

/* Of a node in its block. */
static size_t local_index(uint32_t i, uint32_t j, uint32_t k)
{
    return ((size_t)(k % DR_BLOCK) * DR_BLOCK + j % DR_BLOCK) * DR_BLOCK + i % DR_BLOCK;
}

static size_t node_index(const struct dr_field *field, uint32_t i, uint32_t j, uint32_t k)
{
    size_t block = field->table[table_index(field, i / DR_BLOCK, j / DR_BLOCK, k / DR_BLOCK)];
    return block * DR_BLOCK_NODES + local_index(i, j, k);
}

/* The node before (k even) or after a node of a block that exists, along axis k/2. No block of the outermost
 * layer exists. */
static size_t neighbor_of(const struct builder *b, size_t node, int k)
{
    const uint32_t *side = b->field->side;
    const size_t steps[3] = {1, side[0], (size_t)side[0] * side[1]};
    size_t local = node % DR_BLOCK_NODES, stride = (size_t)1 << 3 * (k / 2), end = DR_BLOCK - 1;
    size_t at = local / stride % DR_BLOCK, place = b->place[node / DR_BLOCK_NODES];
    if (k % 2)
        return at < end ? node + stride
                        : b->field->table[place + steps[k / 2]] * DR_BLOCK_NODES + local - end * stride;
    return at > 0 ? node - stride
                  : b->field->table[place - steps[k / 2]] * DR_BLOCK_NODES + local + end * stride;
}

/* Applies `change` to the values of all inside nodes. */
static void change_inside(struct builder *b, float (*change)(float))
{
    for (size_t r = 0; r < b->runs; r++) {
        for (uint32_t i = b->run[r].from; i < b->run[r].to; i++) {
            float *value = b->field->value + node_index(b->field, i, b->run[r].j, b->run[r].k);
            *value = change(*value);
        }
    }
}

static float unbounded(float value)
{
    (void)value;
    return FLT_MAX;
}

static float negated(float value)
{
    return -value;
}

/* Offers triangle t to the nodes of one block that lie within SPLAT of its bounding box. */
static void splat_block(struct builder *b, uint32_t t, const uint32_t block[3])
{
    struct node_box box = splat_box(b->facet + t, block);
    struct row row = {.from = box.from[0], .to = box.to[0]};
    size_t first = DR_BLOCK_NODES * b->field->table[table_index(b->field, block[0], block[1], block[2])];
    for (row.k = box.from[2]; row.k < box.to[2]; row.k++)
        for (row.j = box.from[1]; row.j < box.to[1]; row.j++)
            for (row.first = row.from / LANES * LANES; row.first < row.to; row.first += LANES) {
                size_t node = first + local_index(row.first, row.j, row.k);
                offer_row(b->facet + t, t, &row, b->field->value + node, b->nearest + node);
            }
}

static void splat_half(struct builder *b)
{
    visit_surface(b, SPLAT, splat_block);
}

/* ---- 5. spread ------------------------------------------------------------------------------- */

/* First in, first out; a node waits at most once, so that one slot per node suffices. */
struct queue {
    uint32_t *node;
    bool *waiting; /* by node */
    size_t capacity, head, count;
};

static void queue_push(struct queue *queue, size_t node)
{
    if (queue->waiting[node])
        return;
    queue->waiting[node] = true;
    queue->node[(queue->head + queue->count++) % queue->capacity] = (uint32_t)node;
}

static size_t queue_pop(struct queue *queue)
{
    size_t node = queue->node[queue->head];
    queue->head = (queue->head + 1) % queue->capacity;
    queue->count--;
    queue->waiting[node] = false;
    return node;
}

/* Where on the grid a node is. */
static void node_place(const struct builder *b, size_t node, uint32_t ret[3])
{
    const uint32_t *side = b->field->side;
    uint32_t place = b->place[node / DR_BLOCK_NODES], local = (uint32_t)(node % DR_BLOCK_NODES);
    ret[0] = place % side[0] * DR_BLOCK + local % DR_BLOCK;
    ret[1] = place / side[0] % side[1] * DR_BLOCK + local / DR_BLOCK % DR_BLOCK;
    ret[2] = place / side[0] / side[1] * DR_BLOCK + local / DR_BLOCK / DR_BLOCK;
}

/* Offers triangle t to a node at p; true when it is nearer than the one before. */
static bool offer(struct builder *b, size_t node, const double p[3], uint32_t t)
{
    float square = (float)facet_square(b->facet + t, p);
    if (square >= b->field->value[node])
        return false;
    b->field->value[node] = square;
    b->nearest[node] = t;
    return true;
}

/* Offers a node's triangle to its six neighbours in the span; those that take it will hand it on. */
static void spread_from(struct builder *b, struct queue *queue, size_t node)
{
    const struct dr_field *field = b->field;
    const struct span *span = &b->span;
    uint32_t at[3];
    node_place(b, node, at);
    /* A neighbour is one unit away: this triangle is at least the distance less one from it. */
    double least = fmax(sqrt((double)field->value[node]) - 1, 0);
    for (int k = 0; k < 6; k++) {
        uint32_t along = at[k / 2] + (k % 2 ? 1 : -1u);
        if (k / 2 == span->axis && along / DR_BLOCK - span->from >= span->to - span->from)
            continue;
        size_t neighbor = neighbor_of(b, node, k);
        if (neighbor < DR_BLOCK_NODES || b->nearest[neighbor] == b->nearest[node] ||
            (double)field->value[neighbor] <= least * least)
            continue; /* the far block, nothing new, or nearer already */
        double p[3] = {at[0], at[1], at[2]};
        p[k / 2] = along;
        if (offer(b, neighbor, p, b->nearest[node]))
            queue_push(queue, neighbor);
    }
}

/* Hands nearest triangles on until nothing changes. */
static void spread(struct builder *b, struct queue *queue)
{
    while (queue->count)
        spread_from(b, queue, queue_pop(queue));
}

/* Along the axis of the halves. */
static uint32_t block_along(const struct builder *b, size_t block)
{
    const uint32_t *side = b->field->side;
    const uint32_t of[3] = {b->place[block] % side[0], b->place[block] / side[0] % side[1],
                            b->place[block] / side[0] / side[1]};
    return of[b->span.axis];
}

/* From the outer shell of the splatted nodes of the span. */
static void spread_half(struct builder *b)
{
    struct queue *queue = b->queue + (b->span.from > 0);
    for (size_t block = 1; block < b->field->blocks; block++) {
        if (block_along(b, block) - b->span.from >= b->span.to - b->span.from)
            continue;
        for (size_t n = block * DR_BLOCK_NODES; n < (block + 1) * DR_BLOCK_NODES; n++)
            if (b->nearest[n] != NO_TRIANGLE && b->field->value[n] > (SPLAT - 1) * (SPLAT - 1))
                queue_push(queue, n);
    }
    spread(b, queue);
}

/* From both sides of the cut. */
static void spread_across(struct builder *b, struct queue *queue)
{
    for (size_t block = 1; block < b->field->blocks; block++) {
        uint32_t along = block_along(b, block);
        if (along + 1 != b->cut && along != b->cut)
            continue;
        size_t layer = along == b->cut ? 0 : DR_BLOCK - 1;
        for (size_t n = 0; n < DR_BLOCK_NODES; n++) {
            size_t node = block * DR_BLOCK_NODES + n;
            if ((n >> 3 * b->span.axis) % DR_BLOCK == layer && b->nearest[node] != NO_TRIANGLE)
                queue_push(queue, node);
        }
    }
    spread(b, queue);
}

/* False: out of memory. */
static bool spread_all(struct builder *b)
{
    size_t blocks = b->field->blocks, nodes = blocks * DR_BLOCK_NODES, lower = 0;
    for (size_t block = 1; block < blocks; block++)
        lower += block_along(b, block) < b->cut;
    lower *= DR_BLOCK_NODES;
    uint32_t *node = malloc(nodes * sizeof *node);
    bool *waiting = calloc(nodes, sizeof *waiting);
    if (node && waiting) {
        struct queue half[2] = {{node, waiting, lower, 0, 0}, {node + lower, waiting, nodes - lower, 0, 0}},
                     whole = {node, waiting, nodes, 0, 0};
        b->queue = half;
        in_halves(b, spread_half);
        b->queue = NULL;
        spread_across(b, &whole);
    }
    bool done = node && waiting;
    free(node);
    free(waiting);
    return done;
}

/* ---- 7. sharpen ------------------------------------------------------------------------------ */

/* The coefficients of a row of a block, along x: a node's distance less a sixth of what the six around it
 * change it by (see field.h). Next to a node that is not resolved the distance itself serves. */
static void sharpen_row(const struct builder *b, size_t row, float *sharp)
{
    const float *value = b->field->value, *mine = value + row, *side[4];
    float line[DR_BLOCK + 2]; /* with the nodes before and after */
    size_t before = neighbor_of(b, row, 0), after = neighbor_of(b, row + DR_BLOCK - 1, 1);
    memcpy(sharp, mine, DR_BLOCK * sizeof *sharp);
    for (int k = 0; k < 4; k++) {
        size_t neighbor = neighbor_of(b, row, k + 2);
        if (neighbor < DR_BLOCK_NODES)
            return;
        side[k] = value + neighbor;
    }
    line[0] = value[before];
    memcpy(line + 1, mine, DR_BLOCK * sizeof *line);
    line[DR_BLOCK + 1] = value[after];
    for (int i = before < DR_BLOCK_NODES; i < DR_BLOCK - (after < DR_BLOCK_NODES); i++) {
        float sum = line[i] + line[i + 2] + side[0][i] + side[1][i] + side[2][i] + side[3][i];
        sharp[i] = 2 * mine[i] - sum / 6;
    }
}

/* Puts the coefficients in the distances' place; false when out of memory. */
static bool sharpen(struct builder *b)
{
    struct dr_field *field = b->field;
    size_t nodes = field->blocks * DR_BLOCK_NODES;
    float *sharp = malloc(nodes * sizeof *sharp);
    if (!sharp)
        return false;
    memcpy(sharp, field->value, DR_BLOCK_NODES * sizeof *sharp); /* the far block */
    for (size_t row = DR_BLOCK_NODES; row < nodes; row += DR_BLOCK)
        sharpen_row(b, row, sharp + row);
    free(field->value);
    field->value = sharp;
    return true;
}

/* ---- all ------------------------------------------------------------------------------------- */

static drape_status build(struct builder *b, const double *positions, int64_t number, drape_error *reterr)
{
    struct dr_field *field = b->field;
    drape_status status = choose_spacing(b, positions, number, reterr);
    if (status < 0)
        return status;
    assert(field->table && b->run); /* of the spacing that fits */
    if (!allocate_nodes(b))
        return dr_out_of_memory(reterr);
    change_inside(b, unbounded);
    b->work = 0;
    in_halves(b, splat_half);
    assert(b->work <= DR_FIELD_MAX_WORK); /* step 3 counted at least this much */
    if (!spread_all(b))
        return dr_out_of_memory(reterr);

    for (size_t n = 0; n < field->blocks * DR_BLOCK_NODES; n++)
        field->value[n] = (float)(field->spacing * sqrt((double)field->value[n]));
    change_inside(b, negated);
    return sharpen(b) ? DRAPE_OK : dr_out_of_memory(reterr);
}

drape_status dr_field_new(const double *positions, size_t vertices, const uint32_t *triangle,
                          size_t triangles, double reach, int64_t number, struct dr_hand *hand,
                          struct dr_field **ret, drape_error *reterr)
{
    struct builder b = {.triangle = triangle, .triangles = triangles, .vertices = vertices, .hand = hand};
    if (vertices > SIZE_MAX / (3 * sizeof *b.point) || triangles > SIZE_MAX / sizeof *b.facet)
        return dr_out_of_memory(reterr);
    b.field = calloc(1, sizeof *b.field);
    b.point = calloc(3 * vertices, sizeof *b.point);
    b.facet = calloc(triangles, sizeof *b.facet);
    drape_status status;
    if (b.field)
        atomic_init(&b.field->references, 1);
    if (b.field && b.point && b.facet) {
        b.field->reach = reach;
        status = build(&b, positions, number, reterr);
    } else {
        status = dr_out_of_memory(reterr);
    }
    free(b.point);
    free(b.facet);
    free(b.run);
    free(b.place);
    free(b.nearest);
    if (status < 0)
        dr_field_unref(b.field);
    else
        *ret = b.field;
    return status;
}
