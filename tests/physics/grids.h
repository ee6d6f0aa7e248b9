/* grids.h - flat rectangular test meshes of several characters, the same on every machine. */
#ifndef DRAPED_GRIDS_H
#define DRAPED_GRIDS_H

#include <stdbool.h>

#include "test.h"

enum grid_kind {
    GRID_ONE,         /* all diagonals the same way */
    GRID_ALTERNATING, /* diagonals turn from cell to cell */
    GRID_RANDOM,      /* diagonals at random */
    GRID_DELAUNAY,    /* inner points moved by up to 0.3 cell, then Delaunay */
    GRID_GRADED,      /* the same with cells that grow 1:4 in both directions */
    GRID_KINDS
};

static const char *const grid_name[GRID_KINDS] = {"one diagonal", "alternating", "random diagonals",
                                                  "Delaunay", "graded"};

struct grid {
    size_t nx, ny; /* cells; vertex (i, j) has index j (nx + 1) + i, moved or not */
    size_t still;  /* columns of points that are not moved */
    size_t vertices, triangles;
    double *uv;         /* 2*vertices, m: u in [0, width], v in [0, height] */
    uint32_t *triangle; /* 3*triangles, counter-clockwise */
};

static inline uint32_t grid_at(const struct grid *grid, size_t i, size_t j)
{
    return (uint32_t)(j * (grid->nx + 1) + i);
}

/* ---- Delaunay by flips ---- */

struct grid_side {
    uint32_t low, high, triangle, corner;
};

static inline int grid_compare_sides(const void *left, const void *right)
{
    const struct grid_side *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    if (a->high != b->high)
        return a->high < b->high ? -1 : 1;
    return a->triangle < b->triangle ? -1 : 1;
}

/* Twice the signed area. */
static inline double grid_area2(const struct grid *grid, uint32_t a, uint32_t b, uint32_t c)
{
    const double *A = grid->uv + 2 * (size_t)a, *B = grid->uv + 2 * (size_t)b, *C = grid->uv + 2 * (size_t)c;
    return (B[0] - A[0]) * (C[1] - A[1]) - (B[1] - A[1]) * (C[0] - A[0]);
}

/* Cotangent of the angle at p in triangle (p, a, b). */
static inline double grid_cot(const struct grid *grid, uint32_t p, uint32_t a, uint32_t b)
{
    const double *P = grid->uv + 2 * (size_t)p, *A = grid->uv + 2 * (size_t)a, *B = grid->uv + 2 * (size_t)b;
    return ((A[0] - P[0]) * (B[0] - P[0]) + (A[1] - P[1]) * (B[1] - P[1])) / grid_area2(grid, p, a, b);
}

/* The line up to which the points were not moved stays a chain of edges, so that it can be a clamp. */
static inline bool grid_on_clamp(const struct grid *grid, uint32_t a)
{
    return grid->still > 0 && a % (grid->nx + 1) == grid->still - 1;
}

/* One sweep over all edges; returns how many it flipped. An edge is flipped when the opposite angles
 * sum to more than half a turn (their cotangents to less than zero). */
static inline size_t grid_flip_sweep(struct grid *grid, struct grid_side *side, bool *touched)
{
    size_t flips = 0, count = 3 * grid->triangles;
    for (size_t i = 0; i < count; i++) {
        const uint32_t *t = grid->triangle + i / 3 * 3;
        uint32_t a = t[(i + 1) % 3], b = t[(i + 2) % 3];
        side[i] = (struct grid_side){a < b ? a : b, a < b ? b : a, (uint32_t)(i / 3), (uint32_t)(i % 3)};
    }
    qsort(side, count, sizeof *side, grid_compare_sides);
    memset(touched, 0, grid->triangles * sizeof *touched);
    for (size_t i = 0; i + 1 < count; i++) {
        if (side[i].low != side[i + 1].low || side[i].high != side[i + 1].high)
            continue;
        uint32_t *t = grid->triangle + 3 * (size_t)side[i].triangle;
        uint32_t *s = grid->triangle + 3 * (size_t)side[i + 1].triangle;
        uint32_t k = side[i].corner, p = t[k], a = t[(k + 1) % 3], b = t[(k + 2) % 3],
                 q = s[side[i + 1].corner];
        if (touched[side[i].triangle] || touched[side[i + 1].triangle] ||
            (grid_on_clamp(grid, a) && grid_on_clamp(grid, b)) ||
            grid_cot(grid, p, a, b) + grid_cot(grid, q, b, a) >= -1e-9)
            continue;
        memcpy(t, (uint32_t[3]){p, a, q}, 3 * sizeof *t);
        memcpy(s, (uint32_t[3]){p, q, b}, 3 * sizeof *s);
        touched[side[i].triangle] = touched[side[i + 1].triangle] = true;
        flips++;
    }
    return flips;
}

static inline void grid_make_delaunay(struct grid *grid)
{
    struct grid_side *side = malloc(3 * grid->triangles * sizeof *side);
    bool *touched = malloc(grid->triangles * sizeof *touched);
    assert_non_null(side);
    assert_non_null(touched);
    int sweeps = 0;
    while (grid_flip_sweep(grid, side, touched) > 0)
        assert_true(++sweeps < 100);
    free(side);
    free(touched);
}

/* ---- making one ---- */

/* u ~ s + 1.5 s^2: slopes 1 to 4 */
static inline double grid_grading(enum grid_kind kind)
{
    return kind == GRID_GRADED ? 1.5 : 0;
}

static inline void grid_place(struct grid *grid, enum grid_kind kind, double width, double height)
{
    uint64_t seed = 20240229;
    double amount = kind == GRID_DELAUNAY || kind == GRID_GRADED ? 0.3 : 0;
    double grading = grid_grading(kind);
    for (size_t j = 0; j <= grid->ny; j++)
        for (size_t i = 0; i <= grid->nx; i++) {
            double r[2] = {test_random(&seed), test_random(&seed)};
            double s[2] = {(double)i / (double)grid->nx, (double)j / (double)grid->ny};
            if (i >= grid->still && i > 0 && j > 0 && i < grid->nx && j < grid->ny) {
                s[0] += amount * r[0] / (double)grid->nx;
                s[1] += amount * r[1] / (double)grid->ny;
            }
            double *uv = grid->uv + 2 * (size_t)grid_at(grid, i, j);
            uv[0] = width * s[0] * (1 + grading * s[0]) / (1 + grading);
            uv[1] = height * s[1] * (1 + grading * s[1]) / (1 + grading);
        }
}

static inline void grid_connect(struct grid *grid, enum grid_kind kind)
{
    uint64_t seed = 77;
    uint32_t *t = grid->triangle;
    for (size_t j = 0; j < grid->ny; j++)
        for (size_t i = 0; i < grid->nx; i++, t += 6) {
            uint32_t a = grid_at(grid, i, j), b = grid_at(grid, i + 1, j);
            uint32_t c = grid_at(grid, i + 1, j + 1), d = grid_at(grid, i, j + 1);
            bool turn =
                (kind == GRID_ALTERNATING && (i + j) % 2) || (kind == GRID_RANDOM && test_random(&seed) > 0);
            if (turn)
                memcpy(t, (uint32_t[6]){a, b, d, b, c, d}, 6 * sizeof *t);
            else
                memcpy(t, (uint32_t[6]){a, b, c, a, c, d}, 6 * sizeof *t);
        }
}

/* `still`: the first so many columns of points are not moved (rows to be held). */
static inline struct grid grid_new(enum grid_kind kind, size_t nx, size_t ny, double width, double height,
                                   size_t still)
{
    struct grid grid = {
        .nx = nx, .ny = ny, .vertices = (nx + 1) * (ny + 1), .triangles = 2 * nx * ny, .still = still};
    grid.uv = malloc(2 * grid.vertices * sizeof *grid.uv);
    grid.triangle = malloc(3 * grid.triangles * sizeof *grid.triangle);
    assert_non_null(grid.uv);
    assert_non_null(grid.triangle);
    grid_place(&grid, kind, width, height);
    grid_connect(&grid, kind);
    if (kind == GRID_DELAUNAY || kind == GRID_GRADED)
        grid_make_delaunay(&grid);
    for (size_t t = 0; t < grid.triangles; t++)
        assert_true(
            grid_area2(&grid, grid.triangle[3 * t], grid.triangle[3 * t + 1], grid.triangle[3 * t + 2]) > 0);
    return grid;
}

/* A strip to be clamped by its first two columns of points, which are not moved: beyond the second, the
 * clamp line, lie `cells` by `across` cells, `length` long and across/cells of that wide. */
static inline struct grid grid_strip(enum grid_kind kind, size_t cells, size_t across, double length)
{
    /* The first column of cells is 1/(cells + 1) of the whole, or less where the mesh is graded. */
    double s = 1 / (double)(cells + 1), grading = grid_grading(kind);
    double first = s * (1 + grading * s) / (1 + grading);
    return grid_new(kind, cells + 1, across, length / (1 - first), length * (double)across / (double)cells,
                    2);
}

static inline void grid_done(struct grid *grid)
{
    free(grid->uv);
    free(grid->triangle);
    memset(grid, 0, sizeof *grid);
}

/* Order of convergence: minus the slope of the line through log(error) over log(cells) in the least-squares
 * sense. On irregular meshes each size is another random mesh with an error of its own luck, so that the
 * order from one size to the next means little there. */
static inline double observed_order(size_t sizes, const size_t *cells, const double *error)
{
    double x = 0, y = 0, xx = 0, xy = 0, n = (double)sizes;
    for (size_t i = 0; i < sizes; i++) {
        double lx = log((double)cells[i]), ly = log(error[i]);
        x += lx;
        y += ly;
        xx += lx * lx;
        xy += lx * ly;
    }
    return -(n * xy - x * y) / (n * xx - x * x);
}

#endif
