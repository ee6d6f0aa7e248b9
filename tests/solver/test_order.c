/* test_order.c - nested dissection: what it separates, and what it fills. */
#include "test.h"

#include <math.h>

/* order.c is compiled in, so that each of its allocations can be made to fail in turn. */
static long allocations_left = -1; /* < 0: as many as it likes */

static void *test_order_calloc(size_t count, size_t size)
{
    return allocations_left >= 0 && allocations_left-- == 0 ? NULL : calloc(count, size);
}

#define calloc test_order_calloc
#include "order.c"
#undef calloc

struct graph {
    int n, *start, *neighbor, *rank;
};

/* Whether nodes i and j are neighbours. */
typedef bool joins(int i, int j, int width);

static bool in_grid(int i, int j, int width) /* with all diagonals */
{
    return abs(i % width - j % width) <= 1 && abs(i / width - j / width) <= 1;
}

static bool in_path(int i, int j, int width)
{
    (void)width;
    return abs(i - j) == 1;
}

static bool in_star(int i, int j, int width)
{
    (void)width;
    return i == 0 || j == 0;
}

static bool in_clique(int i, int j, int width)
{
    (void)i, (void)j, (void)width;
    return true;
}

static bool nowhere(int i, int j, int width)
{
    (void)i, (void)j, (void)width;
    return false;
}

/* Two grids apart. */
static bool in_two_grids(int i, int j, int width)
{
    int half = width * width / 2;
    return (i < half) == (j < half) && in_grid(i, j, width);
}

static struct graph make(int n, int width, joins *joined)
{
    struct graph g = {.n = n};
    g.start = calloc((size_t)n + 1, sizeof *g.start);
    g.rank = calloc((size_t)n, sizeof *g.rank);
    for (int pass = 0; pass < 2; pass++) {
        int at = 0;
        for (int i = 0; i < n; i++) {
            g.start[i] = at;
            for (int j = 0; j < n; j++)
                if (i != j && joined(i, j, width)) {
                    if (pass)
                        g.neighbor[at] = j;
                    at++;
                }
        }
        g.start[n] = at;
        if (!pass)
            assert_non_null(g.neighbor = calloc((size_t)at + 1, sizeof *g.neighbor));
    }
    return g;
}

static void release(struct graph *g)
{
    free(g->start);
    free(g->neighbor);
    free(g->rank);
}

static int highest(const struct graph *g)
{
    int rank = 0;
    for (int i = 0; i < g->n; i++)
        rank = g->rank[i] > rank ? g->rank[i] : rank;
    return rank;
}

static int count_of(const struct graph *g, int rank)
{
    int count = 0;
    for (int i = 0; i < g->n; i++)
        count += g->rank[i] == rank;
    return count;
}

/* The largest connected part of what is left without the nodes of one rank. */
static int largest_without(const struct graph *g, int rank)
{
    int *label = calloc((unsigned)g->n, sizeof *label), *stack = calloc((unsigned)g->n, sizeof *stack),
        largest = 0;
    for (int i = 0; i < g->n; i++) {
        int top = 0, size = 0;
        if (label[i] || g->rank[i] == rank)
            continue;
        label[i] = 1;
        for (stack[top++] = i; top;) {
            int u = stack[--top];
            size++;
            for (int k = g->start[u]; k < g->start[u + 1]; k++)
                if (!label[g->neighbor[k]] && g->rank[g->neighbor[k]] != rank) {
                    label[g->neighbor[k]] = 1;
                    stack[top++] = g->neighbor[k];
                }
        }
        largest = size > largest ? size : largest;
    }
    free(label);
    free(stack);
    return largest;
}

/* Entries of the factor when nodes are eliminated by rank, then number. */
static double fill(const struct graph *g)
{
    size_t n = (size_t)g->n;
    bool *joined = calloc(n * n, sizeof *joined);
    int *order = calloc(n, sizeof *order), at = 0;
    double entries = 0;
    for (int rank = 0; rank <= highest(g); rank++)
        for (int i = 0; i < g->n; i++)
            if (g->rank[i] == rank)
                order[at++] = i;
    assert_int_equal(at, g->n);
    for (size_t i = 0; i < n; i++)
        for (int k = g->start[i]; k < g->start[i + 1]; k++)
            joined[i * n + (size_t)g->neighbor[k]] = true;
    bool *gone = calloc(n, sizeof *gone);
    for (size_t k = 0; k < n; k++) {
        size_t u = (size_t)order[k];
        gone[u] = true;
        entries++;
        for (size_t a = 0; a < n; a++) {
            if (gone[a] || !joined[u * n + a])
                continue;
            entries++;
            for (size_t b = 0; b < n; b++)
                joined[a * n + b] = joined[a * n + b] || (joined[u * n + b] && b != a);
        }
    }
    free(joined);
    free(order);
    free(gone);
    return entries;
}

/* George's bound of what nested dissection fills on a square of m x m nodes: 31/4 m^2 log2 m. */
static void test_order__a_square_is_halved_across_and_fills_no_more_than_georges_bound(void **state)
{
    (void)state;
    for (int m = 20; m <= 40; m += 10) {
        struct graph g = make(m * m, m, in_grid);
        assert_true(dr_order_dissect((size_t)g.n, g.start, g.neighbor, g.rank));
        int top = highest(&g), across = count_of(&g, top), left = largest_without(&g, top);
        double entries = fill(&g), bound = 7.75 * m * m * log2(m);
        print_message("  %d x %d: separator %d, %d of %d left, fill %.0f of %.0f\n", m, m, across, left, g.n,
                      entries, bound);
        assert_true(across <= 3 * m / 2 && left <= g.n / 2);
        assert_true(entries < bound);
        release(&g);
    }
}

static void test_order__every_graph_gets_ranks_and_the_same_ones_again(void **state)
{
    (void)state;
    const struct {
        joins *joined;
        int n, width, ranks; /* 0: any */
    } cases[] = {
        {in_path, 1000, 0, 0},  {in_star, 1000, 0, 0},     {in_clique, 300, 0, 1},     {nowhere, 1000, 0, 0},
        {in_grid, LEAF, 16, 1}, {in_path, LEAF + 1, 0, 3}, {in_two_grids, 900, 30, 0}, {nowhere, 0, 0, 1},
    };
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct graph g = make(cases[c].n, cases[c].width, cases[c].joined);
        int *again = calloc((size_t)g.n + 1, sizeof *again);
        assert_true(dr_order_dissect((size_t)g.n, g.start, g.neighbor, g.rank));
        assert_true(dr_order_dissect((size_t)g.n, g.start, g.neighbor, again));
        int ranks = highest(&g) + 1;
        print_message("  case %zu: %d ranks\n", c, ranks);
        if (cases[c].ranks)
            assert_int_equal(ranks, cases[c].ranks);
        for (int i = 0; i < g.n; i++)
            assert_true(g.rank[i] >= 0 && g.rank[i] == again[i]);
        for (int rank = 0; rank < ranks && g.n; rank++)
            assert_true(count_of(&g, rank) > 0);
        free(again);
        release(&g);
    }
}

static void test_order__fails_for_want_of_memory_alone(void **state)
{
    (void)state;
    struct graph g = make(400, 20, in_grid);
    long failures = 0;
    for (bool done = false; !done; failures += !done) {
        allocations_left = failures;
        done = dr_order_dissect((size_t)g.n, g.start, g.neighbor, g.rank);
        allocations_left = -1;
    }
    assert_int_equal(failures, 11);
    release(&g);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order__a_square_is_halved_across_and_fills_no_more_than_georges_bound),
        cmocka_unit_test(test_order__every_graph_gets_ranks_and_the_same_ones_again),
        cmocka_unit_test(test_order__fails_for_want_of_memory_alone),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
