/* matrix.c - pattern, slots, assembly and CHOLMOD factorisation of the step matrix.
 *
 * Layout. Free node number j (in elimination order) owns the scalar columns 3j, 3j+1, 3j+2. Its column
 * of blocks holds the diagonal block first, then the blocks below it in ascending order; with `length`
 * = 3 * (number of blocks) the three scalar columns have length, length-1, length-2 entries:
 *
 *     column 3j   | xx yx zx | block 1: 3 rows | block 2 ...        starts at first
 *     column 3j+1 |    yy zy | block 1: 3 rows | ...                starts at first + length
 *     column 3j+2 |       zz | block 1: 3 rows | ...                starts at first + 2 length - 1
 *
 * so entry (r, c) of the block whose column-0 rows start at `at` sits at at + c*length - c(c+1)/2 + r. */
#include "matrix.h"

#include <assert.h>
#include <cholmod.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "analysis.h"
#include "error.h"
#include "front.h"
#include "order.h"

/* Where a block lives in the values. length 0: one of its nodes is held, there is no block. */
struct slot {
    int at;          /* entry (0,0) */
    unsigned length; /* of the first scalar column; top bit: store transposed */
};

#define TRANSPOSED  0x80000000u
#define AHEAD       256 /* values fetched before a product needs them: its columns are too short to foresee */
#define MOST_DOUBTS 2   /* running; then every factor is in double */

struct dr_matrix {
    const struct dr_mesh *mesh;
    size_t free;           /* free nodes */
    uint32_t *row;         /* nodes: free number in elimination order, DR_NONE if held */
    uint32_t *node;        /* free: the node of each */
    size_t *block_start;   /* free+1: into block_row */
    uint32_t *block_row;   /* blocks: ascending, the diagonal first */
    struct slot *diagonal; /* free */
    struct slot *triangle; /* 6 per triangle: corner pairs 00 10 11 20 21 22 */
    struct slot *link;     /* links: their off-diagonal block */
    uint32_t *link_node;   /* 2*links */
    size_t links;
    double *base;                         /* blocks: M/dt^2 + bending, each the unit matrix times that */
    double mass_factor;                   /* that base was made for; NAN: none yet */
    const struct dr_bend_stiffness *bend; /* NULL: none */
    uint32_t *bend_block;                 /* the block of each of its entries; DR_NONE: a held node's */
    cholmod_common common;
    enum dr_factor factor;
    double flops;   /* of one factorisation */
    double entries; /* of the factor */
    cholmod_sparse *A;
    cholmod_factor *L;
    struct dr_hand *hand;   /* NULL: none */
    struct dr_front *front; /* NULL: not DR_SINGLE */
    bool single;            /* the last factor is the front's */
    bool in_doubt;          /* it could not be made: the next one is CHOLMOD's */
    int doubts;             /* matrices, one after the other, that single precision could not judge */
    cholmod_dense *w;       /* right-hand sides, then solutions: two columns */
    cholmod_dense *e;       /* workspace of the triangular solves */
};

/* ---- pattern ---------------------------------------------------------------------------------- */

/* A pair of free nodes as one sortable number: column (the lower number) first. */
static uint64_t pair_key(uint32_t a, uint32_t b)
{
    uint32_t low = a < b ? a : b, high = a < b ? b : a;
    return (uint64_t)low << 32 | high;
}

struct pairs {
    uint64_t *key;
    size_t count;
};

/* Sorts the keys, whose columns and rows are less than n: by rows, then by columns, each by counting. False:
 * out of memory. */
static bool sort_pairs(struct pairs *pairs, size_t n)
{
    uint64_t *from = pairs->key, *to = malloc(pairs->count * sizeof *to);
    size_t *place = malloc((n + 1) * sizeof *place);
    bool room = to && place;
    for (int shift = 0; room && shift < 64; shift += 32) {
        memset(place, 0, (n + 1) * sizeof *place);
        for (size_t i = 0; i < pairs->count; i++)
            place[(from[i] >> shift & UINT32_MAX) + 1]++;
        for (size_t k = 0; k < n; k++)
            place[k + 1] += place[k];
        for (size_t i = 0; i < pairs->count; i++)
            to[place[from[i] >> shift & UINT32_MAX]++] = from[i];
        uint64_t *last = from;
        from = to;
        to = last;
    }
    free(to); /* twice exchanged: its own again */
    free(place);
    return room;
}

static void push_pair(struct pairs *pairs, const uint32_t *row, uint32_t a, uint32_t b)
{
    if (row[a] != DR_NONE && row[b] != DR_NONE)
        pairs->key[pairs->count++] = pair_key(row[a], row[b]);
}

/* Every pair of free nodes that share an element, numbered by `row`, sorted, each once, the diagonal
 * included. */
static bool collect_pairs(const struct dr_mesh *mesh, const struct dr_bend_stiffness *bend,
                          const uint32_t *link, size_t links, const uint32_t *row, struct pairs *ret)
{
    size_t most = mesh->nodes + 3 * mesh->triangles + (bend ? bend->start[mesh->nodes] : 0) + links;
    *ret = (struct pairs){malloc(most * sizeof *ret->key), 0};
    if (!ret->key)
        return false;
    for (uint32_t i = 0; i < mesh->nodes; i++)
        push_pair(ret, row, i, i);
    for (size_t t = 0; t < mesh->triangles; t++)
        for (int k = 0; k < 3; k++)
            push_pair(ret, row, mesh->triangle[3 * t + k], mesh->triangle[3 * t + (k + 1) % 3]);
    for (uint32_t j = 0; bend && j < mesh->nodes; j++)
        for (size_t i = bend->start[j]; i < bend->start[j + 1]; i++)
            if (bend->row[i] != j)
                push_pair(ret, row, j, bend->row[i]);
    for (size_t i = 0; i < links; i++)
        push_pair(ret, row, link[2 * i], link[2 * i + 1]);

    if (!sort_pairs(ret, mesh->nodes)) {
        free(ret->key);
        ret->key = NULL;
        return false;
    }
    size_t kept = 0;
    for (size_t i = 0; i < ret->count; i++)
        if (!i || ret->key[i] != ret->key[i - 1])
            ret->key[kept++] = ret->key[i];
    ret->count = kept;
    return true;
}

#define DISSECTED 1000 /* nodes from which nested dissection is worth a try */

/* The order of nested dissection, minimum degree within each rank, into perm; false: out of memory. */
static bool dissect(cholmod_sparse *graph, int *perm, cholmod_common *common)
{
    bool done = false;
    int *rank = malloc(graph->nrow * sizeof *rank);
    cholmod_sparse *both = cholmod_copy(graph, 0, -1, common); /* without the diagonal */
    if (rank && both && dr_order_dissect(graph->nrow, both->p, both->i, rank))
        done = cholmod_camd(graph, NULL, 0, rank, perm, common);
    cholmod_free_sparse(&both, common);
    free(rank);
    return done;
}

/* Analyses the node graph, in minimum degree order or, if that takes fewer operations, in dissection's; NULL:
 * out of memory. */
static cholmod_factor *analyse_nodes(cholmod_sparse *graph, cholmod_common *common)
{
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_AMD;
    common->postorder = true;
    common->supernodal = CHOLMOD_SIMPLICIAL; /* only the order is wanted */
    cholmod_factor *best = cholmod_analyze(graph, common);
    double least = common->fl;
    if (!best || graph->nrow < DISSECTED)
        return best;
    int *perm = malloc(graph->nrow * sizeof *perm);
    common->method[0].ordering = CHOLMOD_GIVEN;
    cholmod_factor *other =
        perm && dissect(graph, perm, common) ? cholmod_analyze_p(graph, perm, NULL, 0, common) : NULL;
    if (!other || common->fl < least)
        cholmod_free_factor(&best, common);
    else
        cholmod_free_factor(&other, common);
    free(perm);
    return best ? best : other;
}

/* Elimination order of the node graph with CHOLMOD's postordering, on n nodes instead of 3n rows. */
static bool order_nodes(struct dr_matrix *A, const struct pairs *pairs, uint32_t *ret)
{
    cholmod_common *common = &A->common;
    cholmod_sparse *graph =
        cholmod_allocate_sparse(A->free, A->free, pairs->count, true, true, -1, CHOLMOD_PATTERN, common);
    if (!graph)
        return false;
    int *p = graph->p, *i = graph->i;
    size_t at = 0;
    for (size_t j = 0; j < A->free; j++) {
        p[j] = (int)at;
        for (; at < pairs->count && pairs->key[at] >> 32 == j; at++)
            i[at] = (int)(pairs->key[at] & UINT32_MAX);
    }
    p[A->free] = (int)at;

    cholmod_factor *analysis = analyse_nodes(graph, common);
    bool ordered = analysis;
    const int *perm = ordered ? analysis->Perm : NULL; /* perm[k] = the row eliminated k-th */
    for (size_t k = 0; ordered && k < A->free; k++)
        ret[k] = (uint32_t)perm[k];
    cholmod_free_factor(&analysis, common);
    cholmod_free_sparse(&graph, common);
    return ordered;
}

/* Numbers the free nodes anew: order[k] comes k-th. */
static bool renumber(struct dr_matrix *A, const uint32_t *order)
{
    uint32_t *node = malloc(A->free * sizeof *node);
    if (!node)
        return false;
    for (size_t k = 0; k < A->free; k++) {
        node[k] = A->node[order[k]];
        A->row[node[k]] = (uint32_t)k;
    }
    free(A->node);
    A->node = node;
    return true;
}

static bool build_columns(struct dr_matrix *A, const struct pairs *pairs)
{
    A->block_start = malloc((A->free + 1) * sizeof *A->block_start);
    A->block_row = malloc(pairs->count * sizeof *A->block_row);
    if (!A->block_start || !A->block_row)
        return false;
    size_t at = 0;
    for (size_t j = 0; j < A->free; j++) {
        A->block_start[j] = at;
        for (; at < pairs->count && pairs->key[at] >> 32 == j; at++)
            A->block_row[at] = (uint32_t)(pairs->key[at] & UINT32_MAX);
    }
    A->block_start[A->free] = at;

    size_t entries = 9 * at - 3 * A->free; /* a diagonal block has 6, the others 9 */
    A->A =
        cholmod_allocate_sparse(3 * A->free, 3 * A->free, entries, true, true, -1, CHOLMOD_REAL, &A->common);
    if (!A->A)
        return false;
    int *p = A->A->p, *i = A->A->i;
    int entry = 0;
    for (size_t j = 0; j < A->free; j++)
        for (int c = 0; c < 3; c++) {
            p[3 * j + (size_t)c] = entry;
            for (size_t k = A->block_start[j]; k < A->block_start[j + 1]; k++)
                for (int r = k == A->block_start[j] ? c : 0; r < 3; r++)
                    i[entry++] = 3 * (int)A->block_row[k] + r;
        }
    p[3 * A->free] = entry;
    memset(A->A->x, 0, entries * sizeof(double));
    return true;
}

/* ---- slots -------------------------------------------------------------------------------------- */

/* The block of a pair of nodes, or the last one before where it would be; DR_NONE: one of them is held. */
static uint32_t find_block(const struct dr_matrix *A, uint32_t node_row, uint32_t node_column)
{
    uint32_t a = A->row[node_row], b = A->row[node_column];
    if (a == DR_NONE || b == DR_NONE)
        return DR_NONE;
    uint32_t row = a < b ? b : a, column = a < b ? a : b;
    size_t low = A->block_start[column], high = A->block_start[column + 1];
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (A->block_row[middle] <= row)
            low = middle;
        else
            high = middle;
    }
    return (uint32_t)low;
}

static struct slot find_slot(const struct dr_matrix *A, uint32_t node_row, uint32_t node_column)
{
    uint32_t block = find_block(A, node_row, node_column);
    if (block == DR_NONE)
        return (struct slot){0, 0};
    uint32_t row = A->row[node_row], column = A->row[node_column];
    unsigned transposed = row < column ? TRANSPOSED : 0;
    size_t low = transposed ? row : column, first = A->block_start[low];
    const int *p = A->A->p;
    return (struct slot){p[3 * low] + 3 * (int)(block - first),
                         3 * (unsigned)(A->block_start[low + 1] - first) | transposed};
}

static size_t count_bends(const struct dr_matrix *A)
{
    return A->bend ? A->bend->start[A->bend->nodes] : 0;
}

static bool build_slots(struct dr_matrix *A, const uint32_t *link, size_t links)
{
    const struct dr_mesh *mesh = A->mesh;
    const struct dr_bend_stiffness *bend = A->bend;
    size_t bends = count_bends(A);
    A->links = links;
    A->diagonal = malloc(A->free * sizeof *A->diagonal);
    A->triangle = malloc(6 * mesh->triangles * sizeof *A->triangle);
    A->base = malloc(A->block_start[A->free] * sizeof *A->base);
    A->link = links ? malloc(links * sizeof *A->link) : NULL;
    A->link_node = links ? malloc(2 * links * sizeof *A->link_node) : NULL;
    A->bend_block = bends ? malloc(bends * sizeof *A->bend_block) : NULL;
    if (!A->diagonal || !A->triangle || !A->base || (links && (!A->link || !A->link_node)) ||
        (bends && !A->bend_block))
        return false;

    for (size_t j = 0; j < A->free; j++)
        A->diagonal[j] = find_slot(A, A->node[j], A->node[j]);
    for (size_t t = 0; t < mesh->triangles; t++) {
        struct slot *slot = A->triangle + 6 * t;
        const uint32_t *node = mesh->triangle + 3 * t;
        for (int a = 0; a < 3; a++)
            for (int b = 0; b <= a; b++)
                *slot++ = find_slot(A, node[a], node[b]);
    }
    for (size_t i = 0; i < links; i++) {
        A->link[i] = find_slot(A, link[2 * i], link[2 * i + 1]);
        A->link_node[2 * i] = link[2 * i];
        A->link_node[2 * i + 1] = link[2 * i + 1];
    }
    for (uint32_t j = 0; bends && j < mesh->nodes; j++)
        for (size_t i = bend->start[j]; i < bend->start[j + 1]; i++)
            A->bend_block[i] = find_block(A, bend->row[i], j);
    return true;
}

/* The symbolic factor of the columns as they are. */
static bool analyse(struct dr_matrix *A)
{
    cholmod_common *common = &A->common;
    common->method[0].ordering = CHOLMOD_NATURAL; /* the numbering already is the elimination order */
    common->postorder = false;
    common->supernodal = A->factor == DR_LDL ? CHOLMOD_SIMPLICIAL : CHOLMOD_SUPERNODAL;
    A->L = cholmod_analyze(A->A, common);
    A->flops = common->fl;
    A->entries = common->lnz;
    return A->L;
}

static bool build_workspace(struct dr_matrix *A)
{
    A->w = cholmod_zeros(3 * A->free, 2, CHOLMOD_REAL, &A->common);
    A->e = cholmod_zeros(A->L->maxesize ? A->L->maxesize : 1, 2, CHOLMOD_REAL, &A->common);
    return A->w && A->e;
}

static bool build_front(struct dr_matrix *A)
{
    if (A->factor == DR_SINGLE)
        A->front = dr_front_new(A->A, A->L);
    return A->front || A->factor != DR_SINGLE;
}

/* Orders the nodes, lays out the columns and analyses them, or takes order and analysis from `analyses`
 * (NULL: there are none to take and none to keep) and lays out the columns. */
static bool order_and_analyse(struct dr_matrix *A, const uint32_t *link, size_t links, size_t named,
                              drape_analyses *analyses, const struct pairs *pairs, uint32_t *order)
{
    struct dr_analysis analysis = {.free = A->free,
                                   .pairs = pairs->count,
                                   .key = pairs->key,
                                   .order = order,
                                   .simplicial = A->factor == DR_LDL};
    struct pairs ordered = {NULL, 0};
    bool found = analyses && dr_analyses_find(analyses, &analysis, &A->common);
    A->L = analysis.L;
    A->flops = analysis.flops;
    A->entries = analysis.entries;
    bool built = (found || order_nodes(A, pairs, order)) && renumber(A, order) &&
                 collect_pairs(A->mesh, A->bend, link, links, A->row, &ordered) && build_columns(A, &ordered);
    free(ordered.key);
    built = built && build_slots(A, link, named) && (found || analyse(A)) && build_workspace(A);
    if (built && analyses && !found) {
        analysis.L = A->L;
        analysis.flops = A->flops;
        analysis.entries = A->entries;
        dr_analyses_keep(analyses, &analysis);
    }
    return built;
}

/* Numbers the free nodes, lays out the columns and has CHOLMOD analyse them. The first `named` links can be
 * added to by number. */
static drape_status build(struct dr_matrix *A, const uint32_t *link, size_t links, size_t named,
                          drape_analyses *analyses, drape_error *reterr)
{
    struct pairs pairs = {NULL, 0};
    A->mass_factor = NAN;
    A->free = 0;
    A->row = malloc(A->mesh->nodes * sizeof *A->row);
    A->node = malloc(A->mesh->nodes * sizeof *A->node);
    if (!A->row || !A->node)
        return dr_out_of_memory(reterr);
    for (size_t i = 0; i < A->mesh->nodes; i++) {
        A->row[i] = A->mesh->held[i] ? DR_NONE : (uint32_t)A->free;
        if (!A->mesh->held[i])
            A->node[A->free++] = (uint32_t)i;
    }
    if (!A->free)
        return DRAPE_OK;
    if (!collect_pairs(A->mesh, A->bend, link, links, A->row, &pairs))
        return dr_out_of_memory(reterr);
    if (pairs.count > (size_t)INT_MAX / 9) {
        free(pairs.key);
        return dr_fail(reterr, DRAPE_EINVAL, DRAPE_AT_NOWHERE, -1,
                       "the step matrix needs more than 2^31 entries: too many vertices");
    }
    uint32_t *order = malloc(A->free * sizeof *order);
    bool built = order && order_and_analyse(A, link, links, named, analyses, &pairs, order);
    free(order);
    free(pairs.key); /* the front is the larger part: nothing is held beside it that can go */
    return built && build_front(A) ? DRAPE_OK : dr_out_of_memory(reterr);
}

/* Frees what build made; what is left is a matrix of no free node. */
static void raze(struct dr_matrix *A)
{
    A->front = dr_front_free(A->front);
    A->single = A->in_doubt = false;
    cholmod_free_sparse(&A->A, &A->common);
    cholmod_free_factor(&A->L, &A->common);
    cholmod_free_dense(&A->w, &A->common);
    cholmod_free_dense(&A->e, &A->common);
    void *array[] = {A->row,      A->node, A->block_start, A->block_row, A->diagonal,
                     A->triangle, A->link, A->link_node,   A->base,      A->bend_block};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        free(array[i]);
    A->row = A->node = A->block_row = A->link_node = A->bend_block = NULL;
    A->block_start = NULL;
    A->diagonal = A->triangle = A->link = NULL;
    A->base = NULL;
    A->free = A->links = 0;
}

drape_status dr_matrix_new(const struct dr_mesh *mesh, const struct dr_bend_stiffness *bend,
                           const uint32_t *link, size_t links, enum dr_factor factor,
                           drape_analyses *analyses, struct dr_matrix **ret, drape_error *reterr)
{
    struct dr_matrix *A = calloc(1, sizeof *A);
    if (!A)
        return dr_out_of_memory(reterr);
    cholmod_start(&A->common);
    A->common.print = 0;
    A->common.quick_return_if_not_posdef = true;
    A->common.final_ll = factor != DR_LDL;
    A->mesh = mesh;
    A->bend = bend;
    A->factor = factor;
    drape_status status = build(A, link, links, links, analyses, reterr);
    if (status < 0)
        dr_matrix_free(A);
    else
        *ret = A;
    return status;
}

void dr_matrix_lend(struct dr_matrix *A, struct dr_hand *hand)
{
    A->hand = hand;
}

drape_status dr_matrix_relink(struct dr_matrix *A, const uint32_t *link, size_t links, drape_error *reterr)
{
    double mass_factor = A->mass_factor;
    size_t named = A->links, bytes = 2 * (named + links) * sizeof *link;
    uint32_t *joined = malloc(bytes ? bytes : 1);
    if (!joined)
        return dr_out_of_memory(reterr);
    if (named)
        memcpy(joined, A->link_node, 2 * named * sizeof *joined);
    if (links)
        memcpy(joined + 2 * named, link, 2 * links * sizeof *joined);
    raze(A);
    drape_status status = build(A, joined, named + links, named, NULL, reterr);
    free(joined);
    if (status < 0)
        raze(A);
    else if (!isnan(mass_factor))
        dr_matrix_set_base(A, mass_factor);
    return status;
}

drape_status dr_matrix_rebend(struct dr_matrix *A, const struct dr_bend_stiffness *bend, drape_error *reterr)
{
    A->bend = bend;
    return dr_matrix_relink(A, NULL, 0, reterr);
}

struct dr_matrix *dr_matrix_free(struct dr_matrix *A)
{
    if (A) {
        raze(A);
        cholmod_finish(&A->common);
        free(A);
    }
    return NULL;
}

size_t dr_matrix_bytes(const struct dr_matrix *A)
{
    size_t blocks = A->free ? A->block_start[A->free] : 0;
    size_t own = sizeof *A + 2 * A->mesh->nodes * sizeof *A->row + (A->free + 1) * sizeof *A->block_start +
                 blocks * (sizeof *A->block_row + sizeof *A->base) +
                 (A->free + 6 * A->mesh->triangles) * sizeof(struct slot) +
                 A->links * (sizeof(struct slot) + 2 * sizeof *A->link_node) +
                 count_bends(A) * sizeof *A->bend_block;
    return A->front ? own + dr_front_bytes(A->front) + A->common.memory_inuse : own + A->common.memory_usage;
}

size_t dr_matrix_bytes_to_come(const struct dr_matrix *A)
{
    if (!A->free || A->L->xtype != CHOLMOD_PATTERN || (A->factor == DR_SINGLE && !A->in_doubt))
        return 0;
    return A->L->is_super ? A->L->xsize * sizeof(double)
                          : (size_t)A->entries * (sizeof(double) + sizeof(int));
}

size_t dr_matrix_free_nodes(const struct dr_matrix *A)
{
    return A->free;
}

enum dr_factor dr_matrix_factor(const struct dr_matrix *A)
{
    return A->factor;
}

size_t dr_matrix_factor_bytes(const struct dr_matrix *A)
{
    return (size_t)A->entries * (A->single ? sizeof(float) : sizeof(double));
}

bool dr_matrix_is_single(const struct dr_matrix *A)
{
    return A->single;
}

bool dr_matrix_prefer(struct dr_matrix *A, enum dr_factor factor)
{
    assert(A->factor != DR_LDL && factor != DR_LDL);
    if (factor == A->factor || (factor == DR_SINGLE && A->doubts >= MOST_DOUBTS))
        return true;
    if (factor == DR_SINGLE && A->free && !(A->front = dr_front_new(A->A, A->L)))
        return false;
    if (factor == DR_CHOLESKY)
        A->front = dr_front_free(A->front);
    A->factor = factor;
    A->single = false;
    return true;
}

double dr_matrix_flops(const struct dr_matrix *A)
{
    return A->flops;
}

/* ---- assembly ----------------------------------------------------------------------------------- */

static void add_scalar(double *value, struct slot slot, double scalar)
{
    int length = (int)(slot.length & ~TRANSPOSED);
    if (!length)
        return;
    double *first = value + slot.at;
    first[0] += scalar;
    first[length] += scalar;
    first[2 * length - 1] += scalar;
}

/* Adds a 3x3 block, the entries of whose rows are `step` apart, to an off-diagonal slot. */
static inline void add_block(double *value, struct slot slot, const double *row0, const double *row1,
                             const double *row2, const size_t step)
{
    int length = (int)(slot.length & ~TRANSPOSED);
    if (!length)
        return;
    const double *row[3] = {row0, row1, row2};
    double *c0 = value + slot.at, *c1 = c0 + length - 1, *c2 = c1 + length - 2;
    if (slot.length & TRANSPOSED) {
        for (size_t r = 0; r < 3; r++) {
            c0[r] += row0[r * step];
            c1[r] += row1[r * step];
            c2[r] += row2[r * step];
        }
    } else {
        for (size_t r = 0; r < 3; r++) {
            c0[r] += row[r][0];
            c1[r] += row[r][step];
            c2[r] += row[r][2 * step];
        }
    }
}

/* Adds xx yx yy zx zy zz to a diagonal slot. */
static void add_diagonal(double *value, struct slot slot, double xx, double yx, double yy, double zx,
                         double zy, double zz)
{
    int length = (int)slot.length;
    if (!length)
        return;
    double *first = value + slot.at;
    first[0] += xx;
    first[1] += yx;
    first[2] += zx;
    first[length] += yy;
    first[length + 1] += zy;
    first[2 * length - 1] += zz;
}

/* Three scalar columns of such blocks, from `value` on; returns where they end. */
static double *put_column(const double *scalar, size_t blocks, double *value)
{
#pragma GCC unroll 3
    for (size_t c = 0; c < 3; c++) {
        *value++ = scalar[0];
        for (size_t r = c + 1; r < 3; r++)
            *value++ = 0;
        for (size_t k = 1; k < blocks; k++, value += 3) {
            value[0] = value[1] = value[2] = 0;
            value[c] = scalar[k];
        }
    }
    return value;
}

void dr_matrix_set_base(struct dr_matrix *A, double mass_factor)
{
    if (!A->free || mass_factor == A->mass_factor) /* a constant time step asks for the same at each step */
        return;
    A->mass_factor = mass_factor;
    memset(A->base, 0, A->block_start[A->free] * sizeof *A->base);
    for (size_t j = 0; j < A->free; j++)
        A->base[A->block_start[j]] += A->mesh->mass[A->node[j]] * mass_factor;
    for (size_t i = 0; i < count_bends(A); i++)
        if (A->bend_block[i] != DR_NONE)
            A->base[A->bend_block[i]] += A->bend->value[i];
}

void dr_matrix_reset(struct dr_matrix *A)
{
    A->in_doubt = false;
    double *value = A->free ? A->A->x : NULL;
    for (size_t j = 0; j < A->free; j++)
        value = put_column(A->base + A->block_start[j], A->block_start[j + 1] - A->block_start[j], value);
}

void dr_matrix_add_node(struct dr_matrix *A, uint32_t node, const double H[6])
{
    uint32_t row = A->row[node];
    if (row != DR_NONE)
        add_diagonal(A->A->x, A->diagonal[row], H[0], H[1], H[2], H[3], H[4], H[5]);
}

void dr_matrix_add_triangle(struct dr_matrix *A, size_t t, const double H[9][9])
{
    if (!A->free)
        return;
    double *value = A->A->x;
    const struct slot *slot = A->triangle + 6 * t;
    for (int a = 0; a < 3; a++) {
        for (int b = 0; b < a; b++)
            add_block(value, *slot++, &H[3 * a][3 * b], &H[3 * a + 1][3 * b], &H[3 * a + 2][3 * b], 1);
        const double *d0 = &H[3 * a][3 * a], *d1 = d0 + 9, *d2 = d1 + 9;
        add_diagonal(value, *slot++, d0[0], d1[0], d1[1], d2[0], d2[1], d2[2]);
    }
}

void dr_matrix_add_triangles(struct dr_matrix *A, size_t t, size_t count, const double H[45][DR_MATRIX_BATCH])
{
    if (!A->free)
        return;
    double *value = A->A->x;
    const struct slot *slot = A->triangle + 6 * t;
    for (size_t k = 0; k < count; k++) {
        const double *at = &H[0][k];
#pragma GCC unroll 3
        for (size_t a = 0; a < 3; a++) {
            const size_t step = DR_MATRIX_BATCH;
            const double *row0 = at + step * (3 * a * (3 * a + 1) / 2);
            const double *row1 = row0 + step * (3 * a + 1), *row2 = row1 + step * (3 * a + 2);
            for (size_t b = 0; b < a; b++, row0 += 3 * step, row1 += 3 * step, row2 += 3 * step)
                add_block(value, *slot++, row0, row1, row2, step);
            add_diagonal(value, *slot++, row0[0], row1[0], row1[step], row2[0], row2[step], row2[2 * step]);
        }
    }
}

bool dr_matrix_has(const struct dr_matrix *A, uint32_t a, uint32_t b)
{
    uint32_t block = find_block(A, a, b), row = A->row[a], column = A->row[b];
    return block == DR_NONE || A->block_row[block] == (row < column ? column : row);
}

void dr_matrix_add_between(struct dr_matrix *A, uint32_t a, uint32_t b, const double H[3][3])
{
    if (A->free)
        add_block(A->A->x, find_slot(A, a, b), H[0], H[1], H[2], 1);
}

void dr_matrix_add_link(struct dr_matrix *A, size_t i, double stiffness)
{
    const double H[6] = {stiffness, 0, stiffness, 0, 0, stiffness};
    if (!A->free)
        return;
    dr_matrix_add_node(A, A->link_node[2 * i], H);
    dr_matrix_add_node(A, A->link_node[2 * i + 1], H);
    add_scalar(A->A->x, A->link[i], -stiffness);
}

void dr_matrix_add_pair(struct dr_matrix *A, size_t i, const double H[9])
{
    if (A->free)
        add_block(A->A->x, A->link[i], H, H + 3, H + 6, 1);
}

/* Entries of the fullest row of L: each supernode lists its rows, which are as wide as it has columns. */
static double fullest_row(const struct dr_matrix *A)
{
    const cholmod_factor *L = A->L;
    const int *column = L->super, *start = L->pi, *row = L->s;
    double *width = A->w->x, fullest = 0; /* the solution's place is free until the next solve */
    memset(width, 0, L->n * sizeof *width);
    for (size_t k = 0; k < L->nsuper; k++)
        for (int i = start[k]; i < start[k + 1]; i++)
            width[row[i]] += column[k + 1] - column[k];
    for (size_t i = 0; i < L->n; i++)
        fullest = fmax(fullest, width[i]);
    return fullest;
}

void dr_matrix_lower_by_round_off(struct dr_matrix *A)
{
    if (!A->free)
        return;
    assert(A->factor == DR_CHOLESKY);
    const int *first = A->A->p;
    double *value = A->A->x, trace = 0, g = (fullest_row(A) + 2) * 0x1p-53;
    for (size_t i = 0; i < 3 * A->free; i++)
        trace += value[first[i]]; /* a column begins with its diagonal */
    double c = g / (1 - 2 * g) * trace;
    for (size_t i = 0; i < 3 * A->free; i++)
        value[first[i]] -= c;
}

/* q_j += D p_j for a diagonal block D. */
static void multiply_diagonal(const double *column[3], const double *p, double *q)
{
    for (int r = 0; r < 3; r++) {
        q[r] += column[r][0] * p[r];
        for (int c = 0; c < r; c++) {
            q[r] += column[c][r - c] * p[c];
            q[c] += column[c][r - c] * p[r];
        }
    }
}

/* q_i += B p_j and ret_j += B' p_i for a block B, whose columns begin at c0, c1 and c2. */
static inline void multiply_block(const double *c0, const double *c1, const double *c2, const double *pi,
                                  const double pj[3], double *restrict qi, double ret_j[3])
{
    for (int r = 0; r < 3; r++) {
        qi[r] = qi[r] + c0[r] * pj[0] + c1[r] * pj[1] + c2[r] * pj[2];
        ret_j[0] += c0[r] * pi[r];
        ret_j[1] += c1[r] * pi[r];
        ret_j[2] += c2[r] * pi[r];
    }
}

void dr_matrix_multiply(const struct dr_matrix *A, const double *p, double *q)
{
    const int *start = A->free ? A->A->p : NULL;
    memset(q, 0, 3 * A->mesh->nodes * sizeof *q);
    for (size_t j = 0; j < A->free; j++, start += 3) {
        const double *value = A->A->x, *column[3] = {value + start[0], value + start[1], value + start[2]};
        double *qj = q + 3 * (size_t)A->node[j], sum[3];
        double pj[3];
        memcpy(pj, p + 3 * (size_t)A->node[j], sizeof pj);
        multiply_diagonal(column, pj, qj);
        memcpy(sum, qj, sizeof sum);
        const double *c0 = column[0] + 3, *c1 = column[1] + 2, *c2 = column[2] + 1;
        for (size_t k = A->block_start[j] + 1; k < A->block_start[j + 1]; k++, c0 += 3, c1 += 3, c2 += 3) {
            size_t at = 3 * (size_t)A->node[A->block_row[k]];
            __builtin_prefetch(column[0] + 9 * (k - A->block_start[j]) + AHEAD);
            multiply_block(c0, c1, c2, p + at, pj, q + at, sum);
        }
        memcpy(qj, sum, sizeof sum);
    }
}

/* ---- solving ------------------------------------------------------------------------------------ */

bool dr_matrix_in_doubt(const struct dr_matrix *A)
{
    return A->in_doubt;
}

bool dr_matrix_factorise(struct dr_matrix *A, bool *ret_memory)
{
    *ret_memory = A->single = false;
    if (!A->free)
        return true;
    if (A->factor == DR_SINGLE && !A->in_doubt) {
        enum dr_front_result result = dr_front_factorise(A->front, A->hand);
        A->single = result == DR_FRONT_DONE;
        A->in_doubt = result == DR_FRONT_UNCERTAIN;
        A->doubts = A->in_doubt ? A->doubts + 1 : 0;
        return A->single;
    }
    if (A->doubts >= MOST_DOUBTS)
        dr_matrix_prefer(A, DR_CHOLESKY);
    A->in_doubt = false;
    A->common.status = CHOLMOD_OK;
    bool done = cholmod_factorize(A->A, A->L, &A->common);
    *ret_memory = A->common.status == CHOLMOD_OUT_OF_MEMORY;
    return done && A->common.status == CHOLMOD_OK && A->L->minor == A->L->n;
}

bool dr_matrix_solve(struct dr_matrix *A, size_t count, const double *const b[], double *const solution[])
{
    for (size_t k = 0; k < count; k++)
        memset(solution[k], 0, 3 * A->mesh->nodes * sizeof *solution[k]);
    if (!A->free)
        return true;
    cholmod_dense w = *A->w, *fresh = NULL;
    double *value = w.x;
    w.ncol = count;
    for (size_t k = 0; k < count; k++)
        for (size_t j = 0; j < A->free; j++)
            memcpy(value + k * w.d + 3 * j, b[k] + 3 * (size_t)A->node[j], 3 * sizeof *value);
    if (A->single) {
        for (size_t k = 0; k < count; k++)
            dr_front_solve(A->front, A->hand, value + k * w.d);
    } else if (A->factor != DR_LDL) {
        /* In place and without the permutations of cholmod_solve: the numbering is the elimination order. */
        cholmod_super_lsolve(A->L, &w, A->e, &A->common);
        cholmod_super_ltsolve(A->L, &w, A->e, &A->common);
    } else {
        fresh = cholmod_solve(CHOLMOD_A, A->L, &w, &A->common);
        if (!fresh)
            return false;
        value = fresh->x;
    }
    for (size_t k = 0; k < count; k++)
        for (size_t j = 0; j < A->free; j++)
            memcpy(solution[k] + 3 * (size_t)A->node[j], value + k * w.d + 3 * j, 3 * sizeof *value);
    cholmod_free_dense(&fresh, &A->common);
    return true;
}
