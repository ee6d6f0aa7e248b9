/* front.c - see front.h.
 *
 * A supernode's columns are a panel: the rows of its pivots first, then those below, each part padded to a
 * multiple of STRIP rows, the columns to a multiple of 4 (of the unit matrix). A panel's diagonal is zero in
 * memory; the pivots' inverses stand for it.
 *
 * What a supernode leaves to its parent waits on one of two stacks of its share, by the parity of its depth:
 * so a front never lies where one of its children does, and nothing is moved. Where it lies is known
 * beforehand. */
#include "front.h"

#include <math.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define STRIP       16
#define AHEAD       4096 /* floats that a back-solve fetches, past the first cache, before it needs them */
#define LEAST_PIVOT 0x1p-18f /* of a diagonal of 1 to 4; single round-off is 2^-24 of each term */
#define CURVED      1e-12    /* curvature that double round-off cannot make, of the terms it sums */
#define NONE        UINT32_MAX

/* Who does what: nodes of the two shares have their descendants in the same one. */
enum share { LEFT, RIGHT, TOP, SHARES };

#define CHUNK      96  /* columns of a node of the top, after which rows are shared; a multiple of STRIP */
#define LEAST_ROWS 1e6 /* multiplications that are worth it */

/* To cut the tree: */
#define MOST_SUBTREES 64
#define SOLVES        500 /* operations for an entry of the factor, for the eight back-solves to a factorisation */
#define LEAST_WORK    5e8 /* operations: less is not worth waking anybody */
#define WORTH         0.8 /* of the work, that the busier of two does */

/* A panel's shape and place, as the kernels want it. */
struct panel {
    float *value, *inverse;
    size_t columns; /* a multiple of 4 */
    size_t pivots;  /* rows of pivots, padded */
    size_t rows;    /* all, padded */
    size_t lead;    /* from column to column */
    size_t updates; /* columns that are left to the parent, a multiple of 4 */
};

/* What a supernode leaves to its parent is a lower triangle of `rows` rows, a multiple of STRIP: STRIP
 * columns after STRIP columns, without the rows above them. Where row 0 of column j would be. */
static inline size_t update_column(size_t rows, size_t j)
{
    size_t above = j / STRIP * STRIP;
    return above * rows - above * (above - STRIP) / 2 + j % STRIP * (rows - above) - above;
}

/* Rows of what a child leaves that are neighbours in its parent, too: all among its pivots or all below. */
struct run {
    uint32_t from;   /* among the rows below the child's pivots */
    uint32_t to;     /* in the parent's panel */
    uint32_t length; /* a multiple of 3, as rows come in threes */
};

/* From what a child leaves to where its parent has it, which begins with row and column `base` of the
 * parent's panel. */
struct addition {
    const float *from;
    float *to;
    size_t rows_from, rows_to;
    size_t lead_to; /* of a panel; 0: to what the parent leaves, of rows_to rows */
    size_t base;
};

struct kernels {
    const char *name;
    size_t (*factorise)(const struct panel *panel, size_t from, size_t to);
    void (*divide)(const struct panel *panel, size_t from, size_t to, size_t first, size_t end);
    void (*multiply)(const struct panel *panel, float *update);
    void (*forward)(const struct panel *panel, float *x);
    void (*backward)(const struct panel *panel, float *x);
    void (*add)(const struct run *run, const struct run *end, const struct addition *addition);
};

#if defined(__x86_64__)
#include <immintrin.h>

#define LANES        16
#define WIDE         16
#define TARGET       __attribute__((target("avx512f")))
#define KERNEL(name) name##_avx512
#define NAME         "AVX-512"
#include "front_kernels.h"

#define LANES        8
#define WIDE         4
#define TARGET       __attribute__((target("avx2,fma")))
#define KERNEL(name) name##_avx2
#define NAME         "AVX2"
#include "front_kernels.h"
#endif

#define LANES 4
#define WIDE  4
#define TARGET
#define KERNEL(name) name##_any
#define NAME         "none"
#include "front_kernels.h"

struct node {
    size_t panel;  /* in `value` */
    size_t update; /* in `stack` */
    uint32_t column, columns, below;
    const int *row; /* below: of A */
    size_t first_run, runs;
    uint32_t parent, first_child, next_child; /* NONE: no more */
    enum share share;
};

struct dr_front {
    const cholmod_sparse *A;
    const struct kernels *kernels;
    size_t nodes;
    struct node *node;
    struct run *run;
    uint32_t *place; /* of each of A's blocks, by columns: row in its supernode's panel */
    double *scale;   /* A's rows */
    float *inverse;  /* of the pivots, padded as the panels are: of node i from padded[i] */
    size_t *padded;
    float *value, *stack;  /* aligned */
    float *x[2], *work[2]; /* of LEFT, which TOP uses, too, and RIGHT; n, and the longest panel */
    void *memory;          /* that these share */
    size_t bytes;
    bool shared; /* else all is LEFT's */
};

static size_t pad(size_t count, size_t to)
{
    return (count + to - 1) / to * to;
}

/* Columns a multiple of 512 bytes apart would share a few lines of the cache. */
static size_t lead_of(size_t rows)
{
    return rows / STRIP % 8 || !rows ? rows : rows + STRIP;
}

static struct panel panel_of(const struct dr_front *front, size_t i)
{
    const struct node *node = front->node + i;
    size_t pivots = pad(node->columns, STRIP), below = pad(node->below, STRIP);
    return (struct panel){.value = front->value ? front->value + node->panel : NULL,
                          .inverse = front->inverse ? front->inverse + front->padded[i] : NULL,
                          .columns = pad(node->columns, 4),
                          .pivots = pivots,
                          .rows = pivots + below,
                          .lead = lead_of(pivots + below),
                          .updates = pad(node->below, 4)};
}

static size_t update_size(const struct panel *panel)
{
    return update_column(panel->rows - panel->pivots, panel->updates) + panel->updates / STRIP * STRIP;
}

/* ---- plan --------------------------------------------------------------------------------------- */

/* The row in the panel of a row of A, which the node has; *hint rows below the pivots come before it. */
static uint32_t place_of(const struct node *node, int row, size_t *hint)
{
    if ((uint32_t)row < node->column + node->columns)
        return (uint32_t)row - node->column;
    while (node->row[*hint] < row)
        ++*hint;
    return (uint32_t)(pad(node->columns, STRIP) + *hint);
}

/* Finds the runs of a node in its parent and appends them, if there is where. */
static size_t find_runs(const struct node *node, const struct node *parent, struct run *run)
{
    size_t runs = 0, hint = 0, pivots = pad(parent->columns, STRIP);
    uint32_t expected = NONE;
    for (uint32_t i = 0; i < node->below; i++, expected++) {
        uint32_t place = place_of(parent, node->row[i], &hint);
        if (place != expected || place == pivots) {
            if (run)
                run[runs] = (struct run){i, place, 0};
            runs++;
            expected = place;
        }
        if (run)
            run[runs - 1].length++;
    }
    return runs;
}

static void lay_out_nodes(struct dr_front *front, const cholmod_factor *L)
{
    const int *super = L->super, *start = L->pi, *row = L->s;
    size_t inverses = 0;
    for (size_t i = 0; i < front->nodes; i++) {
        struct node *node = front->node + i;
        uint32_t columns = (uint32_t)(super[i + 1] - super[i]);
        *node = (struct node){.column = (uint32_t)super[i],
                              .columns = columns,
                              .below = (uint32_t)(start[i + 1] - start[i]) - columns,
                              .row = row + start[i] + columns,
                              .parent = NONE,
                              .first_child = NONE,
                              .next_child = NONE};
        front->padded[i] = inverses;
        inverses += pad(columns, 4);
    }
}

/* Children are listed in ascending order. of_column: room for a number for each of A's. */
static void find_parents(struct dr_front *front, uint32_t *of_column)
{
    for (size_t i = 0; i < front->nodes; i++)
        for (uint32_t k = 0; k < front->node[i].columns; k++)
            of_column[front->node[i].column + k] = (uint32_t)i;
    for (size_t i = front->nodes; i-- > 0;) {
        struct node *node = front->node + i;
        if (!node->below)
            continue;
        node->parent = of_column[node->row[0]];
        node->next_child = front->node[node->parent].first_child;
        front->node[node->parent].first_child = (uint32_t)i;
    }
}

static bool find_all_runs(struct dr_front *front)
{
    size_t runs = 0;
    for (struct node *node = front->node; node < front->node + front->nodes; node++)
        runs += node->parent == NONE ? 0 : find_runs(node, front->node + node->parent, NULL);
    front->run = malloc((runs + 1) * sizeof *front->run);
    if (!front->run)
        return false;
    runs = 0;
    for (struct node *node = front->node; node < front->node + front->nodes; node++) {
        node->first_run = runs;
        node->runs =
            node->parent == NONE ? 0 : find_runs(node, front->node + node->parent, front->run + runs);
        runs += node->runs;
    }
    front->bytes += (runs + 1) * sizeof *front->run;
    return true;
}

/* Subtrees, the most laborious first. */
struct subtrees {
    size_t count;
    struct subtree {
        double work;
        uint32_t root;
        enum share share;
    } subtree[MOST_SUBTREES];
};

static void insert(struct subtrees *list, uint32_t root, double work)
{
    size_t i = list->count++;
    for (; i > 0 && list->subtree[i - 1].work < work; i--)
        list->subtree[i] = list->subtree[i - 1];
    list->subtree[i] = (struct subtree){work, root, LEFT};
}

/* Each subtree goes to whom less was given so far. Returns how long two take, `all` the work of the tree. */
static double deal(struct subtrees *list, double all)
{
    double given[2] = {0, 0};
    for (size_t i = 0; i < list->count; i++) {
        enum share share = given[RIGHT] < given[LEFT] ? RIGHT : LEFT;
        list->subtree[i].share = share;
        given[share] += list->subtree[i].work;
    }
    return all - fmin(given[LEFT], given[RIGHT]);
}

/* Puts the children of the first subtree's root in its place; false: there are none, or no room. */
static bool split(const struct dr_front *front, const double *work, struct subtrees *list)
{
    size_t children = 0;
    uint32_t first = list->count ? front->node[list->subtree[0].root].first_child : NONE;
    for (uint32_t i = first; i != NONE; i = front->node[i].next_child)
        children++;
    if (!children || list->count - 1 + children > MOST_SUBTREES)
        return false;
    list->count--;
    memmove(list->subtree, list->subtree + 1, list->count * sizeof *list->subtree);
    for (uint32_t i = first; i != NONE; i = front->node[i].next_child)
        insert(list, i, work[i]);
    return true;
}

/* Cuts the tree such that two who take a share each, and one of them the top, are done soonest. work: room
 * for a number of each node. */
static void find_shares(struct dr_front *front, double *work)
{
    struct subtrees list = {.count = 0}, best = list;
    double all = 0, soonest;
    for (size_t i = 0; i < front->nodes; i++)
        work[i] = 0;
    for (size_t i = 0; i < front->nodes; i++) { /* a child comes before its parent */
        const struct node *node = front->node + i;
        double rows = node->columns + node->below;
        work[i] += node->columns * rows * (rows + SOLVES);
        if (node->parent != NONE)
            work[node->parent] += work[i];
        else {
            all += work[i];
            if (list.count < MOST_SUBTREES)
                insert(&list, (uint32_t)i, work[i]);
        }
    }
    soonest = WORTH * all;
    do {
        double time = all < LEAST_WORK ? all : deal(&list, all);
        if (time < soonest) {
            soonest = time;
            best = list;
        }
    } while (split(front, work, &list));
    front->shared = best.count;
    for (size_t i = 0; i < front->nodes; i++)
        front->node[i].share = best.count ? TOP : LEFT;
    for (size_t i = 0; i < best.count; i++)
        front->node[best.subtree[i].root].share = best.subtree[i].share;
    for (size_t i = front->nodes; i-- > 0;) {
        uint32_t parent = front->node[i].parent;
        if (parent != NONE && front->node[parent].share != TOP)
            front->node[i].share = front->node[parent].share;
    }
}

/* Where each panel and each update lies. depth: room for a number of each node. */
static void lay_out_memory(struct dr_front *front, uint32_t *depth, size_t *values, size_t *stacked,
                           size_t *longest)
{
    size_t top[SHARES][2] = {{0}}, most[SHARES][2] = {{0}}, first[SHARES][2];
    *values = *longest = *stacked = 0;
    for (size_t i = front->nodes; i-- > 0;)
        depth[i] = front->node[i].parent == NONE ? 0 : depth[front->node[i].parent] + 1;
    for (size_t i = 0; i < front->nodes; i++) {
        struct node *node = front->node + i;
        struct panel panel = panel_of(front, i);
        size_t *mine = &top[node->share][depth[i] & 1], *children = &top[node->share][~depth[i] & 1];
        node->panel = *values;
        *values += panel.columns * panel.lead;
        *longest = panel.rows > *longest ? panel.rows : *longest;
        uint32_t child = node->first_child;
        while (child != NONE && front->node[child].share != node->share)
            child = front->node[child].next_child;
        if (child != NONE)
            *children = front->node[child].update;
        node->update = *mine;
        *mine += update_size(&panel);
        size_t *peak = &most[node->share][depth[i] & 1];
        *peak = *mine > *peak ? *mine : *peak;
    }
    for (int k = 0; k < 2 * SHARES; k++) {
        first[k / 2][k % 2] = *stacked;
        *stacked += most[k / 2][k % 2];
    }
    for (size_t i = 0; i < front->nodes; i++)
        front->node[i].update += first[front->node[i].share][depth[i] & 1];
}

static bool find_places(struct dr_front *front)
{
    const int *p = front->A->p, *row = front->A->i;
    size_t blocks = 0;
    for (size_t j = 0; j < front->A->ncol; j += 3)
        blocks += (size_t)(p[j + 1] - p[j]) / 3;
    front->place = malloc(blocks * sizeof *front->place);
    if (!front->place)
        return false;
    uint32_t *place = front->place;
    for (size_t i = 0; i < front->nodes; i++) {
        const struct node *node = front->node + i;
        for (size_t j = node->column; j < node->column + node->columns; j += 3) {
            size_t hint = 0;
            for (int k = p[j]; k < p[j + 1]; k += 3)
                *place++ = place_of(node, row[k], &hint);
        }
    }
    front->bytes += blocks * sizeof *front->place;
    return true;
}

/* A factor of many megabytes is gone through again and again: large pages save a tenth of the time, and most
 * of what first touching it takes. The system may decline. */
static void ask_for_large_pages(void *memory, size_t bytes)
{
    const uintptr_t page = 4096;
    uintptr_t first = ((uintptr_t)memory + page - 1) & ~(page - 1),
              end = ((uintptr_t)memory + bytes) & ~(page - 1);
    if (first < end)
        madvise((void *)first, end - first, MADV_HUGEPAGE);
}

/* What `memory` holds, behind one another from a multiple of 64 bytes. */
static bool share_memory(struct dr_front *front, size_t values, size_t stacked, size_t longest)
{
    size_t work = pad(longest, STRIP), x = pad(front->A->nrow, STRIP);
    size_t bytes = (values + stacked + 2 * (work + x) + STRIP) * sizeof(float);
    front->memory = malloc(bytes);
    if (!front->memory)
        return false;
    ask_for_large_pages(front->memory, bytes);
    front->value = (float *)(((uintptr_t)front->memory + 63) & ~(uintptr_t)63);
    front->stack = front->value + values;
    for (size_t i = 0; i < 2; i++) {
        front->work[i] = front->stack + stacked + i * (work + x);
        front->x[i] = front->work[i] + work;
    }
    front->bytes += bytes;
    return true;
}

static const struct kernels *choose_kernels(void)
{
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f"))
        return &kernels_avx512;
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return &kernels_avx2;
#endif
    return &kernels_any;
}

const char *dr_front_kernels(void)
{
    return choose_kernels()->name;
}

/* scratch: room for a number for each of A's columns; work: likewise for each node. */
static bool plan(struct dr_front *front, uint32_t *scratch, double *work)
{
    size_t values, stacked, longest;
    find_parents(front, scratch);
    find_shares(front, work);
    if (!find_all_runs(front) || !find_places(front))
        return false;
    lay_out_memory(front, scratch, &values, &stacked, &longest);
    return share_memory(front, values, stacked, longest);
}

struct dr_front *dr_front_new(const cholmod_sparse *A, const cholmod_factor *L)
{
    struct dr_front *front = calloc(1, sizeof *front);
    if (!front)
        return NULL;
    size_t n = A->nrow, inverses = n + 3 * L->nsuper;
    front->A = A;
    front->kernels = choose_kernels();
    front->nodes = L->nsuper;
    front->node = malloc(front->nodes * sizeof *front->node);
    front->padded = malloc(front->nodes * sizeof *front->padded);
    front->scale = malloc(n * sizeof *front->scale);
    front->inverse = malloc(inverses * sizeof *front->inverse);
    front->bytes = sizeof *front + front->nodes * (sizeof *front->node + sizeof *front->padded) +
                   n * sizeof *front->scale + inverses * sizeof *front->inverse;
    uint32_t *scratch = malloc(n * sizeof *scratch);
    double *work = malloc(front->nodes * sizeof *work);
    bool built = front->node && front->padded && front->scale && front->inverse && scratch && work;
    if (built) {
        lay_out_nodes(front, L);
        built = plan(front, scratch, work);
    }
    free(scratch);
    free(work);
    return built ? front : dr_front_free(front);
}

struct dr_front *dr_front_free(struct dr_front *front)
{
    if (front) {
        free(front->node);
        free(front->run);
        free(front->place);
        free(front->scale);
        free(front->inverse);
        free(front->padded);
        free(front->memory);
        free(front);
    }
    return NULL;
}

size_t dr_front_bytes(const struct dr_front *front)
{
    return front->bytes;
}

/* ---- factor ------------------------------------------------------------------------------------- */

/* The power of two that brings a diagonal entry to 1 .. 4. */
static double scale_of(double entry)
{
    int exponent;
    frexp(entry, &exponent);
    return ldexp(1, -((exponent - 1) >> 1));
}

/* Whether the diagonal is positive. */
static enum dr_front_result find_scales(struct dr_front *front)
{
    const int *p = front->A->p;
    const double *value = front->A->x;
    for (size_t j = 0; j < front->A->ncol; j++) {
        double entry = value[p[j]]; /* a column begins with its diagonal */
        if (!(entry > 0) || isinf(entry))
            return entry <= 0 ? DR_FRONT_INDEFINITE : DR_FRONT_UNCERTAIN;
        front->scale[j] = scale_of(entry);
    }
    return DR_FRONT_DONE;
}

/* Adds the columns of A that are the panel's. */
static void assemble(const struct dr_front *front, const struct node *node, const struct panel *panel)
{
    const int *p = front->A->p, *row = front->A->i;
    const double *value = front->A->x, *scale = front->scale;
    /* Three columns have three entries less than nine for each of their blocks. */
    const uint32_t *place = front->place + ((size_t)p[node->column] + node->column) / 9;
    for (size_t j = node->column; j < node->column + node->columns; j += 3) {
        size_t blocks = (size_t)(p[j + 1] - p[j]) / 3;
        for (size_t c = 0; c < 3; c++) {
            float *column = panel->value + (j - node->column + c) * panel->lead;
            const double *entry = value + p[j + c], of_column = scale[j + c];
            for (size_t r = c; r < 3; r++)
                column[place[0] + r] = (float)(*entry++ * of_column * scale[j + r]);
            for (size_t k = 1; k < blocks; k++) {
                const double *of_row = scale + row[p[j] + 3 * (int)k];
                for (size_t r = 0; r < 3; r++)
                    column[place[k] + r] = (float)(*entry++ * of_column * of_row[r]);
            }
        }
        place += blocks;
    }
}

/* Adds what the children left: to the panel, or to what the parent leaves itself. */
static void add_children(const struct dr_front *front, const struct node *node, const struct panel *panel,
                         bool pivots)
{
    struct addition addition = {.to = pivots ? panel->value : front->stack + node->update,
                                .lead_to = pivots ? panel->lead : 0,
                                .rows_to = panel->rows - panel->pivots,
                                .base = pivots ? 0 : panel->pivots};
    for (uint32_t i = node->first_child; i != NONE; i = front->node[i].next_child) {
        const struct node *child = front->node + i;
        const struct run *run = front->run + child->first_run, *end = run + child->runs;
        addition.from = front->stack + child->update;
        addition.rows_from = pad(child->below, STRIP);
        for (; run < end; run++)
            if ((run->to < panel->pivots) == pivots)
                front->kernels->add(run, end, &addition);
    }
}

static void clear(const struct node *node, const struct panel *panel)
{
    memset(panel->value, 0, panel->columns * panel->lead * sizeof *panel->value);
    for (size_t k = node->columns; k < panel->columns; k++)
        panel->value[k * panel->lead + k] = 1;
}

/* x = L^-T x for the rows of a node's pivots, after those below. */
static void step_backward(const struct dr_front *front, size_t i, float *x, float *work)
{
    const struct node *node = front->node + i;
    struct panel panel = panel_of(front, i);
    memcpy(work, x + node->column, node->columns * sizeof *work);
    memset(work + node->columns, 0, (panel.pivots - node->columns) * sizeof *work);
    for (size_t k = 0; k < node->below; k++)
        work[panel.pivots + k] = x[node->row[k]];
    memset(work + panel.pivots + node->below, 0, (panel.rows - panel.pivots - node->below) * sizeof *work);
    front->kernels->backward(&panel, work);
    memcpy(x + node->column, work, node->columns * sizeof *work);
}

/* Whether A curves down along x, which is scaled. */
static bool curves_down(const struct dr_front *front)
{
    const int *p = front->A->p, *row = front->A->i;
    const double *value = front->A->x, *scale = front->scale;
    const float *x = front->x[LEFT];
    double curvature = 0, size = 0;
    for (size_t j = 0; j < front->A->ncol; j++) {
        double of_column = (double)x[j] * scale[j];
        for (int k = p[j]; of_column != 0 && k < p[j + 1]; k++) { /* off the diagonal twice */
            double term = (k > p[j] ? 2 : 1) * value[k] * of_column * (double)x[row[k]] * scale[row[k]];
            curvature += term;
            size += fabs(term);
        }
    }
    return curvature < -CURVED * size;
}

/* The pivot in that column of a node is too small, or below zero. Then A should curve down along the column
 * of L^-T that the pivot is about; it is zero but for the node and its descendants. */
static enum dr_front_result judge(struct dr_front *front, size_t i, size_t column)
{
    const struct node *node = front->node + i;
    struct panel panel = panel_of(front, i);
    float *work = front->work[LEFT], *x = front->x[LEFT];
    size_t first = i;
    while (front->node[first].first_child != NONE)
        first = front->node[first].first_child;
    memset(x, 0, pad(front->A->nrow, STRIP) * sizeof *x);
    memset(work, 0, panel.rows * sizeof *work);
    for (size_t k = column; k < panel.columns; k++)
        panel.inverse[k] = 0;
    work[column] = 1;
    for (size_t k = column; k-- > 0;) {
        float sum = 0;
        for (size_t r = k + 1; r <= column; r++)
            sum += panel.value[k * panel.lead + r] * work[r];
        work[k] = -sum * panel.inverse[k];
    }
    memcpy(x + node->column, work, node->columns * sizeof *work);
    while (i-- > first)
        step_backward(front, i, x, work);
    return curves_down(front) ? DR_FRONT_INDEFINITE : DR_FRONT_UNCERTAIN;
}

/* For dr_hand_both: the rows from `first` on of columns that are done above. */
struct division {
    const struct dr_front *front;
    const struct panel *panel;
    size_t from, to; /* columns */
    size_t first;
};

static void divide_half(void *data, int half)
{
    const struct division *work = data;
    size_t middle = work->first + pad((work->panel->rows - work->first) / 2, STRIP);
    work->front->kernels->divide(work->panel, work->from, work->to, half ? middle : work->first,
                                 half ? work->panel->rows : middle);
}

/* Returns the columns done: all, or that of the first pivot that is too small. hand: NULL where nothing is to
 * be shared. */
static size_t factorise_panel(const struct dr_front *front, struct dr_hand *hand, const struct panel *panel)
{
    size_t step = hand ? CHUNK : panel->columns;
    for (size_t from = 0, to; from < panel->columns; from = to) {
        to = from + step < panel->columns ? from + step : panel->columns;
        size_t done = front->kernels->factorise(panel, from, to);
        if (done < to)
            return done;
        struct division work = {front, panel, from, to, pad(to, STRIP)};
        if (hand && (double)(panel->rows - work.first) * (double)(step * to) >= LEAST_ROWS)
            dr_hand_both(hand, divide_half, &work);
        else
            front->kernels->divide(panel, from, to, work.first, panel->rows);
    }
    return panel->columns;
}

/* Returns as factorise_panel does. */
static size_t factorise_node(const struct dr_front *front, struct dr_hand *hand, size_t i)
{
    const struct node *node = front->node + i;
    struct panel panel = panel_of(front, i);
    clear(node, &panel);
    assemble(front, node, &panel);
    add_children(front, node, &panel, true);
    size_t done = factorise_panel(front, hand, &panel);
    if (done < panel.columns)
        return done;
    front->kernels->multiply(&panel, front->stack + node->update);
    add_children(front, node, &panel, false);
    return panel.columns;
}

/* Where a share stopped short of its end. */
struct stop {
    size_t node; /* front->nodes: it did not */
    size_t column;
};

struct factorisation {
    const struct dr_front *front;
    struct dr_hand *hand;
    struct stop stop[SHARES];
    atomic_bool left_stopped; /* then the right one is not looked at */
};

static void factorise_share(void *data, int share)
{
    struct factorisation *work = data;
    const struct dr_front *front = work->front;
    struct stop *stop = &work->stop[share];
    *stop = (struct stop){front->nodes, 0};
    for (size_t i = 0; i < front->nodes; i++) {
        const struct node *node = front->node + i;
        if ((int)node->share != share)
            continue;
        if (share == RIGHT && atomic_load_explicit(&work->left_stopped, memory_order_relaxed))
            return;
        size_t done = factorise_node(front, share == TOP ? work->hand : NULL, i);
        if (done < pad(node->columns, 4)) {
            *stop = (struct stop){i, done};
            break;
        }
    }
    if (share == LEFT && stop->node < front->nodes)
        atomic_store_explicit(&work->left_stopped, true, memory_order_relaxed);
}

enum dr_front_result dr_front_factorise(struct dr_front *front, struct dr_hand *hand)
{
    struct factorisation work = {.front = front, .hand = hand};
    enum dr_front_result result = find_scales(front);
    if (result != DR_FRONT_DONE)
        return result;
    atomic_init(&work.left_stopped, false);
    dr_hand_both(front->shared ? hand : NULL, factorise_share, &work);
    for (int share = LEFT; share < SHARES; share++) {
        if (share == TOP)
            factorise_share(&work, TOP);
        if (work.stop[share].node < front->nodes)
            return judge(front, work.stop[share].node, work.stop[share].column);
    }
    return DR_FRONT_DONE;
}

/* ---- solve -------------------------------------------------------------------------------------- */

/* What a share leaves to the rows of the top, it adds to those of its own x. */
static void go_forward(void *data, int share)
{
    const struct dr_front *front = data;
    int whose = share == TOP ? LEFT : share;
    float *work = front->work[whose], *x = front->x[whose];
    for (size_t i = 0; i < front->nodes; i++) {
        const struct node *node = front->node + i;
        if ((int)node->share != share)
            continue;
        struct panel panel = panel_of(front, i);
        memcpy(work, x + node->column, node->columns * sizeof *work);
        memset(work + node->columns, 0, (panel.rows - node->columns) * sizeof *work);
        front->kernels->forward(&panel, work);
        memcpy(x + node->column, work, node->columns * sizeof *work);
        for (size_t k = 0; k < node->below; k++)
            x[node->row[k]] += work[panel.pivots + k];
    }
}

static void go_backward(void *data, int share)
{
    const struct dr_front *front = data;
    int whose = share == TOP ? LEFT : share;
    for (size_t i = front->nodes; i-- > 0;)
        if ((int)front->node[i].share == share)
            step_backward(front, i, front->x[whose], front->work[whose]);
}

/* x = A^-1 x, of the scaled matrix; x is that of LEFT. */
static void solve(struct dr_front *front, struct dr_hand *hand)
{
    float *left = front->x[LEFT], *right = front->x[RIGHT];
    for (size_t i = 0; i < front->nodes; i++) {
        const struct node *node = front->node + i;
        if (node->share == RIGHT)
            memcpy(right + node->column, left + node->column, node->columns * sizeof *right);
        else if (node->share == TOP)
            memset(right + node->column, 0, node->columns * sizeof *right);
    }
    dr_hand_both(front->shared ? hand : NULL, go_forward, front);
    for (size_t i = 0; i < front->nodes; i++) {
        const struct node *node = front->node + i;
        for (size_t k = node->column; k < node->column + node->columns && node->share == TOP; k++)
            left[k] += right[k];
    }
    go_forward(front, TOP);
    go_backward(front, TOP);
    for (size_t i = 0; i < front->nodes; i++) {
        const struct node *node = front->node + i;
        if (node->share == TOP)
            memcpy(right + node->column, left + node->column, node->columns * sizeof *right);
    }
    dr_hand_both(front->shared ? hand : NULL, go_backward, front);
    for (size_t i = 0; i < front->nodes; i++) {
        const struct node *node = front->node + i;
        if (node->share == RIGHT)
            memcpy(left + node->column, right + node->column, node->columns * sizeof *left);
    }
}

void dr_front_solve(struct dr_front *front, struct dr_hand *hand, double *x)
{
    size_t n = front->A->nrow;
    float *scaled = front->x[LEFT];
    double largest = 0;
    int exponent;
    for (size_t i = 0; i < n; i++)
        largest = fmax(largest, fabs(x[i] * front->scale[i]));
    if (largest == 0)
        return;
    frexp(largest, &exponent);
    double down = ldexp(1, -exponent), up = ldexp(1, exponent);
    for (size_t i = 0; i < n; i++)
        scaled[i] = (float)(x[i] * front->scale[i] * down);
    solve(front, hand);
    for (size_t i = 0; i < n; i++)
        x[i] = (double)scaled[i] * front->scale[i] * up;
}
