/* test_front.c - the factor in single precision, against residuals and CHOLMOD's factor in double; and the
 * matrix that has it. */
#include "test.h"

#include "front.c"
#include "matrix.h"
#include "scarce.h"
#include "sheets.h"
#include "sim.h"

/* ---- on its own ----------------------------------------------------------------------------------- */

/* A stiffness matrix on side x side nodes, each of them joined to its eight neighbours, in an order of nested
 * dissection. */
struct grid {
    cholmod_common common;
    cholmod_sparse *A;
    cholmod_factor *L;
    size_t n;
    double *b;
};

/* Numbers the nodes x0 .. x1 - 1 by y0 .. y1 - 1: two halves, then the line between them. */
static void dissect(int side, int x0, int x1, int y0, int y1, int *number, int *next)
{
    int wide = x1 - x0, high = y1 - y0, x = (x0 + x1) / 2, y = (y0 + y1) / 2;
    if (wide > 3 && wide >= high) {
        dissect(side, x0, x, y0, y1, number, next);
        dissect(side, x + 1, x1, y0, y1, number, next);
        dissect(side, x, x + 1, y0, y1, number, next);
    } else if (high > 3) {
        dissect(side, x0, x1, y0, y, number, next);
        dissect(side, x0, x1, y + 1, y1, number, next);
        dissect(side, x0, x1, y, y + 1, number, next);
    } else
        for (int j = y0; j < y1; j++)
            for (int i = x0; i < x1; i++)
                number[j * side + i] = (*next)++;
}

/* Adds B (x) (1 -1; -1 1) of a random positive definite B between nodes i and j. */
static void join(cholmod_triplet *triplet, int i, int j, uint64_t *seed)
{
    double r[3][3], B[3][3] = {{0}};
    for (int a = 0; a < 9; a++)
        r[a / 3][a % 3] = test_random(seed);
    for (int a = 0; a < 27; a++)
        B[a / 9][a / 3 % 3] += r[a / 9][a % 3] * r[a / 3 % 3][a % 3];
    const int pair[4][2] = {{i, i}, {j, j}, {i, j}, {j, i}};
    for (int k = 0; k < 4; k++)
        for (int a = 0; a < 9; a++) {
            int row = 3 * pair[k][0] + a / 3, column = 3 * pair[k][1] + a % 3;
            if (row < column)
                continue;
            ((int *)triplet->i)[triplet->nnz] = row;
            ((int *)triplet->j)[triplet->nnz] = column;
            ((double *)triplet->x)[triplet->nnz++] = k < 2 ? B[a / 3][a % 3] : -B[a / 3][a % 3];
        }
}

static struct grid *grid_new(int side, double mass)
{
    struct grid *grid = calloc(1, sizeof *grid);
    int *number = calloc((size_t)(side * side), sizeof *number), next = 0;
    uint64_t seed = 11;
    assert_non_null(grid);
    assert_non_null(number);
    cholmod_common *common = &grid->common;
    cholmod_start(common);
    common->print = 0;
    common->final_ll = true;
    grid->n = 3 * (size_t)(side * side);
    dissect(side, 0, side, 0, side, number, &next);
    assert_int_equal(next, side * side);
    cholmod_triplet *triplet =
        cholmod_allocate_triplet(grid->n, grid->n, 40 * 4 * grid->n, -1, CHOLMOD_REAL, common);
    for (int y = 0; y < side; y++)
        for (int x = 0; x < side; x++) {
            const int to[4][2] = {{1, 0}, {0, 1}, {1, 1}, {-1, 1}};
            for (int k = 0; k < 4; k++)
                if (x + to[k][0] >= 0 && x + to[k][0] < side && y + to[k][1] < side)
                    join(triplet, number[y * side + x], number[(y + to[k][1]) * side + x + to[k][0]], &seed);
        }
    for (int i = 0; i < (int)grid->n; i++) {
        for (int k = i; k < i - i % 3 + 3; k++) { /* so that all 3x3 blocks are whole */
            ((int *)triplet->i)[triplet->nnz] = k;
            ((int *)triplet->j)[triplet->nnz] = i;
            ((double *)triplet->x)[triplet->nnz++] = k == i ? mass : 0;
        }
    }
    grid->A = cholmod_triplet_to_sparse(triplet, 0, common);
    assert_non_null(grid->A);
    cholmod_free_triplet(&triplet, common);
    free(number);
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_NATURAL;
    common->postorder = false;
    common->supernodal = CHOLMOD_SUPERNODAL;
    grid->L = cholmod_analyze(grid->A, common);
    grid->b = calloc(grid->n, sizeof *grid->b);
    assert_non_null(grid->L);
    assert_non_null(grid->b);
    for (size_t i = 0; i < grid->n; i++)
        grid->b[i] = test_random(&seed);
    return grid;
}

static void grid_free(struct grid *grid)
{
    cholmod_free_factor(&grid->L, &grid->common);
    cholmod_free_sparse(&grid->A, &grid->common);
    cholmod_finish(&grid->common);
    free(grid->b);
    free(grid);
}

/* |A x - b| over |b|, largest entries. */
static double residual(const struct grid *grid, const double *x)
{
    const int *p = grid->A->p, *row = grid->A->i;
    const double *value = grid->A->x;
    double *r = malloc(grid->n * sizeof *r), worst = 0, largest = 0;
    assert_non_null(r);
    memcpy(r, grid->b, grid->n * sizeof *r);
    for (size_t j = 0; j < grid->n; j++)
        for (int k = p[j]; k < p[j + 1]; k++) {
            r[row[k]] -= value[k] * x[j];
            if (row[k] != (int)j)
                r[j] -= value[k] * x[row[k]];
        }
    for (size_t i = 0; i < grid->n; i++) {
        worst = fmax(worst, fabs(r[i]));
        largest = fmax(largest, fabs(grid->b[i]));
    }
    free(r);
    return worst / largest;
}

static double *solution(const struct grid *grid, struct dr_front *front)
{
    double *x = malloc(grid->n * sizeof *x);
    assert_non_null(x);
    memcpy(x, grid->b, grid->n * sizeof *x);
    dr_front_solve(front, NULL, x);
    return x;
}

static size_t kernels_here(const struct kernels *ret[3])
{
    size_t count = 0;
    ret[count++] = &kernels_any;
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        ret[count++] = &kernels_avx2;
    if (__builtin_cpu_supports("avx512f"))
        ret[count++] = &kernels_avx512;
#endif
    return count;
}

static void test_front__solves_to_single_precision_with_every_instruction_set(void **state)
{
    (void)state;
    static const int side[] = {1, 2, 3, 4, 5, 7, 8, 11, 16, 23, 40};
    const struct kernels *kernels[3];
    size_t sets = kernels_here(kernels);
    for (size_t i = 0; i < sizeof side / sizeof *side; i++) {
        struct grid *grid = grid_new(side[i], 0.3);
        struct dr_front *front = dr_front_new(grid->A, grid->L);
        assert_non_null(front);
        for (size_t k = 0; k < sets; k++) {
            front->kernels = kernels[k];
            assert_int_equal(dr_front_factorise(front, NULL), DR_FRONT_DONE);
            double *x = solution(grid, front), left = residual(grid, x);
            if (i + 1 == sizeof side / sizeof *side)
                print_message("  %d x %d nodes, instruction set %zu: residual %.1e\n", side[i], side[i], k,
                              left);
            assert_true(left < 1e-5);
            free(x);
        }
        dr_front_free(front);
        grid_free(grid);
    }
}

static void test_front__the_same_matrix_has_the_same_bytes(void **state)
{
    (void)state;
    struct grid *grid = grid_new(23, 0.3);
    struct dr_front *front = dr_front_new(grid->A, grid->L), *other = dr_front_new(grid->A, grid->L);
    double *value = grid->A->x, kept = value[0];
    assert_int_equal(dr_front_factorise(front, NULL), DR_FRONT_DONE);
    double *x = solution(grid, front);
    value[0] *= 3; /* the other's memory holds another factor first */
    assert_int_equal(dr_front_factorise(other, NULL), DR_FRONT_DONE);
    double *y = solution(grid, other);
    assert_memory_not_equal(x, y, grid->n * sizeof *x);
    free(y);
    value[0] = kept;
    assert_int_equal(dr_front_factorise(other, NULL), DR_FRONT_DONE);
    y = solution(grid, other);
    assert_memory_equal(x, y, grid->n * sizeof *x);
    free(x);
    free(y);
    dr_front_free(front);
    dr_front_free(other);
    grid_free(grid);
}

/* Units change no digit, though they leave the range of single precision far behind. */
static void test_front__powers_of_two_scale_the_solution_alone(void **state)
{
    (void)state;
    struct grid *grid = grid_new(11, 0.3);
    struct dr_front *front = dr_front_new(grid->A, grid->L);
    double *value = grid->A->x;
    assert_int_equal(dr_front_factorise(front, NULL), DR_FRONT_DONE);
    double *x = solution(grid, front);
    for (size_t i = 0; i < grid->A->nzmax; i++)
        value[i] = ldexp(value[i], 200);
    for (size_t i = 0; i < grid->n; i++)
        grid->b[i] = ldexp(grid->b[i], -150);
    assert_int_equal(dr_front_factorise(front, NULL), DR_FRONT_DONE);
    double *y = solution(grid, front);
    for (size_t i = 0; i < grid->n; i++)
        assert_true(y[i] == ldexp(x[i], -350));
    free(y);
    memset(grid->b, 0, grid->n * sizeof *grid->b);
    y = solution(grid, front);
    for (size_t i = 0; i < grid->n; i++)
        assert_true(y[i] == 0);
    free(x);
    free(y);
    dr_front_free(front);
    grid_free(grid);
}

/* The sign of one eigenvalue is the question: all nodes moving alike have the curvature `mass`. */
static void test_front__what_round_off_may_have_made_is_uncertain(void **state)
{
    (void)state;
    static const struct {
        double mass;
        enum dr_front_result result;
    } told[] = {
        {1e-3, DR_FRONT_DONE},        {1e-9, DR_FRONT_UNCERTAIN},   {0, DR_FRONT_UNCERTAIN},
        {-1e-15, DR_FRONT_UNCERTAIN}, {-1e-3, DR_FRONT_INDEFINITE}, {-0.3, DR_FRONT_INDEFINITE},
        {-1000, DR_FRONT_INDEFINITE}, {NAN, DR_FRONT_UNCERTAIN},    {INFINITY, DR_FRONT_UNCERTAIN},
    };
    const struct kernels *kernels[3];
    size_t sets = kernels_here(kernels);
    for (int side = 1; side < 20; side += 6)
        for (size_t i = 0; i < sizeof told / sizeof *told; i++) {
            if (side == 1 && told[i].result != DR_FRONT_INDEFINITE) /* nothing but the mass */
                continue;
            struct grid *grid = grid_new(side, told[i].mass);
            struct dr_front *front = dr_front_new(grid->A, grid->L);
            for (size_t k = 0; k < sets; k++) {
                front->kernels = kernels[k];
                assert_int_equal(dr_front_factorise(front, NULL), told[i].result);
            }
            dr_front_free(front);
            grid_free(grid);
        }
}

/* Wherever the column is whose pivot is too small. */
static void test_front__one_negative_direction_is_found_anywhere(void **state)
{
    (void)state;
    struct grid *grid = grid_new(7, 0.3);
    struct dr_front *front = dr_front_new(grid->A, grid->L);
    const int *p = grid->A->p;
    double *value = grid->A->x;
    const struct kernels *kernels[3];
    size_t sets = kernels_here(kernels);
    for (size_t j = 0; j < grid->n; j++) {
        double kept = value[p[j]];
        for (size_t k = 0; k < sets; k++) {
            front->kernels = kernels[k];
            value[p[j]] = 0.05 * kept;
            assert_int_equal(dr_front_factorise(front, NULL), DR_FRONT_INDEFINITE);
            value[p[j]] = kept;
            assert_int_equal(dr_front_factorise(front, NULL), DR_FRONT_DONE);
        }
    }
    dr_front_free(front);
    grid_free(grid);
}

/* Both shares and the top have about what they should, and whoever does them leaves the same bytes. */
static void test_front__a_second_processor_changes_no_byte(void **state)
{
    (void)state;
    struct grid *grid = grid_new(70, 0.3);
    struct dr_front *front = dr_front_new(grid->A, grid->L);
    struct dr_hand hand = {.processors = drape_processors_new(2)};
    assert_non_null(hand.processors);
    const struct node *root = front->node + front->nodes - 1; /* wide enough for its own rows to be shared */
    assert_true(root->share == TOP && (root->columns - CHUNK) * CHUNK * CHUNK > LEAST_ROWS);
    double entries[SHARES] = {0};
    for (size_t i = 0; i < front->nodes; i++)
        entries[front->node[i].share] +=
            (double)front->node[i].columns * (front->node[i].columns + front->node[i].below);
    print_message("  entries of the shares: %.0f, %.0f, of the top %.0f\n", entries[LEFT], entries[RIGHT],
                  entries[TOP]);
    assert_true(fmax(entries[LEFT], entries[RIGHT]) + entries[TOP] <
                0.65 * (entries[LEFT] + entries[RIGHT] + entries[TOP]));

    assert_int_equal(dr_front_factorise(front, NULL), DR_FRONT_DONE);
    double *x = solution(grid, front), *y = malloc(grid->n * sizeof *y);
    assert_non_null(y);
    for (int i = 0; i < 20; i++) {
        assert_int_equal(dr_front_factorise(front, &hand), DR_FRONT_DONE);
        memcpy(y, grid->b, grid->n * sizeof *y);
        dr_front_solve(front, &hand, y);
        assert_memory_equal(x, y, grid->n * sizeof *x);
    }
    assert_true(hand.seconds > 0);
    free(x);
    free(y);
    drape_processors_free(hand.processors);
    dr_front_free(front);
    grid_free(grid);
}

/* In either share, in the top, or in all of them: the verdict does not depend on who looks. */
static void test_front__what_is_indefinite_is_so_in_every_share(void **state)
{
    (void)state;
    struct grid *grid = grid_new(70, 0.3);
    struct dr_front *front = dr_front_new(grid->A, grid->L);
    struct dr_hand hand = {.processors = drape_processors_new(2)};
    assert_non_null(hand.processors);
    const int *p = grid->A->p;
    double *value = grid->A->x;
    for (int which = 1; which < 1 << SHARES; which++) { /* a bit for each share */
        double kept[SHARES];
        int at[SHARES] = {0};
        for (size_t i = 0; i < front->nodes; i++)
            at[front->node[i].share] = p[front->node[i].column];
        for (int share = 0; share < SHARES; share++) {
            kept[share] = value[at[share]];
            value[at[share]] *= which >> share & 1 ? 0.05 : 1;
        }
        for (int i = 0; i < 10; i++)
            assert_int_equal(dr_front_factorise(front, i ? &hand : NULL), DR_FRONT_INDEFINITE);
        for (int share = 0; share < SHARES; share++)
            value[at[share]] = kept[share];
        assert_int_equal(dr_front_factorise(front, &hand), DR_FRONT_DONE);
    }
    drape_processors_free(hand.processors);
    dr_front_free(front);
    grid_free(grid);
}

/* ---- as a matrix's factor --------------------------------------------------------------------------- */

/* A sheet of n x n squares. */
struct cloth {
    struct dr_mesh *mesh;
    size_t size; /* of a vector */
    double *b, *x, *r, *p, *q;
};

static struct cloth cloth_new(size_t n)
{
    struct shape shape = sheets_stack(n, 1, 0.1, 0.1);
    struct cloth cloth = {.mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle)};
    uint64_t seed = 3;
    cloth.size = 3 * shape.vertices;
    double **vector[] = {&cloth.b, &cloth.x, &cloth.r, &cloth.p, &cloth.q};
    for (size_t i = 0; i < 5; i++) {
        *vector[i] = calloc(cloth.size, sizeof **vector[i]);
        assert_non_null(*vector[i]);
    }
    for (size_t i = 0; i < cloth.size; i++)
        cloth.b[i] = test_random(&seed);
    shape_free(&shape);
    return cloth;
}

static void cloth_free(struct cloth *cloth)
{
    double *vector[] = {cloth->b, cloth->x, cloth->r, cloth->p, cloth->q};
    for (size_t i = 0; i < 5; i++)
        free(vector[i]);
    dr_mesh_free(cloth->mesh);
}

/* Random stiffness of each triangle against what does not move it as a whole, and mass. */
static void assemble_cloth(struct dr_matrix *A, const struct cloth *cloth, double mass)
{
    uint64_t seed = 21;
    dr_matrix_set_base(A, 0);
    dr_matrix_reset(A);
    for (size_t t = 0; t < cloth->mesh->triangles; t++) {
        double r[9], H[9][9];
        for (int i = 0; i < 6; i++)
            r[i] = test_random(&seed);
        for (int i = 6; i < 9; i++)
            r[i] = -r[i - 3] - r[i - 6];
        for (int i = 0; i < 9; i++)
            for (int j = 0; j < 9; j++)
                H[i][j] = r[i] * r[j] + (i % 3 == j % 3 ? (i == j ? 2 : -1) : 0);
        dr_matrix_add_triangle(A, t, H);
    }
    const double H[6] = {mass, 0, mass, 0, 0, mass};
    for (uint32_t i = 0; i < cloth->mesh->nodes; i++)
        dr_matrix_add_node(A, i, H);
}

static struct dr_matrix *matrix_new(const struct cloth *cloth, enum dr_factor factor)
{
    struct dr_matrix *A = NULL;
    assert_int_equal(dr_matrix_new(cloth->mesh, NULL, NULL, 0, factor, NULL, &A, NULL), DRAPE_OK);
    return A;
}

static double dot(const struct cloth *cloth, const double *a, const double *b)
{
    double sum = 0;
    for (size_t i = 0; i < cloth->size; i++)
        sum += a[i] * b[i];
    return sum;
}

static void solve_once(struct dr_matrix *A, const double *b, double *x)
{
    assert_true(dr_matrix_solve(A, 1, (const double *[]){b}, (double *[]){x}));
}

/* Conjugate gradients with the factor; steps until the residual is 1e-12 of b. */
static int solve_whole(struct dr_matrix *A, struct cloth *cloth)
{
    double *z = malloc(cloth->size * sizeof *z), *r = cloth->r, *p = cloth->p;
    int steps = 0;
    assert_non_null(z);
    memset(cloth->x, 0, cloth->size * sizeof *z);
    memcpy(r, cloth->b, cloth->size * sizeof *z);
    solve_once(A, r, z);
    memcpy(p, z, cloth->size * sizeof *z);
    for (double rz = dot(cloth, r, z); dot(cloth, r, r) > 1e-24 * dot(cloth, cloth->b, cloth->b); steps++) {
        assert_true(steps < 20);
        dr_matrix_multiply(A, p, cloth->q);
        double length = rz / dot(cloth, p, cloth->q);
        for (size_t i = 0; i < cloth->size; i++) {
            cloth->x[i] += length * p[i];
            r[i] -= length * cloth->q[i];
        }
        solve_once(A, r, z);
        double next = dot(cloth, r, z);
        for (size_t i = 0; i < cloth->size; i++)
            p[i] = z[i] + next / rz * p[i];
        rz = next;
    }
    free(z);
    return steps;
}

static void test_front__few_conjugate_gradient_steps_make_it_double(void **state)
{
    (void)state;
    static const size_t side[] = {1, 2, 3, 9, 40};
    for (size_t i = 0; i < sizeof side / sizeof *side; i++) {
        struct cloth cloth = cloth_new(side[i]);
        struct dr_matrix *A = matrix_new(&cloth, DR_SINGLE), *B = matrix_new(&cloth, DR_CHOLESKY);
        bool memory;
        double *x = malloc(cloth.size * sizeof *x), largest = 0, apart = 0;
        assert_non_null(x);
        assemble_cloth(A, &cloth, 1e-3);
        assemble_cloth(B, &cloth, 1e-3);
        assert_false(dr_matrix_is_single(A));
        assert_true(dr_matrix_factorise(A, &memory));
        assert_true(dr_matrix_is_single(A));
        assert_true(dr_matrix_factorise(B, &memory));
        assert_false(dr_matrix_is_single(B));
        assert_int_equal(2 * dr_matrix_factor_bytes(A), dr_matrix_factor_bytes(B));
        solve_once(B, cloth.b, x);
        solve_once(A, cloth.b, cloth.x);
        for (size_t k = 0; k < cloth.size; k++) {
            largest = fmax(largest, fabs(x[k]));
            apart = fmax(apart, fabs(x[k] - cloth.x[k]));
        }
        assert_true(apart > 0 && apart < 1e-2 * largest);
        int steps = solve_whole(A, &cloth);
        print_message("  %zu nodes: %.1e from double at first, then %d steps\n", cloth.mesh->nodes,
                      apart / largest, steps);
        assert_in_range(steps, 2, 5);
        for (size_t k = 0; k < cloth.size; k++)
            assert_near(cloth.x[k], x[k], 1e-9, largest);
        free(x);
        dr_matrix_free(A);
        dr_matrix_free(B);
        cloth_free(&cloth);
    }
}

static void test_front__two_right_hand_sides_are_solved_alike(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(9);
    struct dr_matrix *A = matrix_new(&cloth, DR_SINGLE);
    bool memory;
    assemble_cloth(A, &cloth, 1e-3);
    assert_true(dr_matrix_factorise(A, &memory));
    assert_true(dr_matrix_solve(A, 2, (const double *[]){cloth.b, cloth.b}, (double *[]){cloth.x, cloth.p}));
    solve_once(A, cloth.b, cloth.q);
    assert_memory_equal(cloth.x, cloth.q, cloth.size * sizeof *cloth.x);
    assert_memory_equal(cloth.p, cloth.q, cloth.size * sizeof *cloth.x);
    dr_matrix_free(A);
    cloth_free(&cloth);
}

/* CHOLMOD's factor is there only once it is needed, and the front until it is no longer. */
static void test_front__double_judges_what_single_cannot_and_stays_the_second_time(void **state)
{
    (void)state;
    static const struct {
        double mass;
        bool definite, single;
    } step[] = {{-0.1, false, false},                                           /* for sure */
                {1e-3, true, true},   {1e-10, true, false}, {1e-3, true, true}, /* and trusted again */
                {1e-10, true, false}, {1e-10, true, false}, {1e-3, true, false}};
    const size_t second_running = 5;
    struct cloth cloth = cloth_new(9);
    struct dr_matrix *A = matrix_new(&cloth, DR_SINGLE);
    size_t bytes = 0;
    bool tried = false; /* in double */
    for (size_t i = 0; i < sizeof step / sizeof *step; i++) {
        bool memory = true;
        assemble_cloth(A, &cloth, step[i].mass);
        assert_int_equal(dr_matrix_bytes_to_come(A), 0);
        bool definite = dr_matrix_factorise(A, &memory);
        assert_int_equal(dr_matrix_in_doubt(A), step[i].definite && !step[i].single && i <= second_running);
        if (dr_matrix_in_doubt(A)) {
            assert_int_equal(dr_matrix_bytes_to_come(A) > 0, !tried);
            definite = dr_matrix_factorise(A, &memory);
            tried = true;
        }
        assert_int_equal(definite, step[i].definite);
        assert_false(memory);
        assert_int_equal(dr_matrix_is_single(A), step[i].single);
        assert_int_equal(dr_matrix_factor(A), i < second_running ? DR_SINGLE : DR_CHOLESKY);
        if (i == second_running)
            assert_true(dr_matrix_bytes(A) < bytes); /* the front is gone */
        bytes = dr_matrix_bytes(A);
        if (step[i].definite)
            solve_once(A, cloth.b, cloth.x);
        assert_true(dr_matrix_prefer(A, DR_SINGLE)); /* in vain, at last */
    }
    dr_matrix_free(A);
    cloth_free(&cloth);
}

static void test_front__a_run_has_doubts_settled_at_once(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(9);
    struct dr_cloth in_run = {.mesh = cloth.mesh, .A = matrix_new(&cloth, DR_SINGLE)};
    drape_sim sim = {.began = dr_clock(), .options = drape_options_default()};
    const double mass[] = {1e-3, 1e-10, -0.1};
    for (uint32_t i = 0; i < sizeof mass / sizeof *mass; i++) {
        enum dr_factored factored;
        assemble_cloth(in_run.A, &cloth, mass[i]);
        assert_int_equal(dr_sim_factorise(&sim, &in_run, &factored, NULL), DRAPE_OK);
        assert_int_equal(factored, mass[i] > 0 ? DR_FACTORED : DR_NOT_DEFINITE);
        assert_int_equal(dr_matrix_is_single(in_run.A), i == 0);
        assert_false(dr_matrix_in_doubt(in_run.A));
        assert_int_equal(sim.report.factorizations, i + 1);
    }
    dr_matrix_free(in_run.A);
    cloth_free(&cloth);
}

/* Whatever is done about a doubt: it counts. */
static void test_front__doubts_that_are_dropped_count(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(9);
    struct dr_matrix *A = matrix_new(&cloth, DR_SINGLE);
    bool memory;
    for (int i = 0; i < 3; i++) {
        assemble_cloth(A, &cloth, 1e-10); /* which begins with a reset */
        assert_false(dr_matrix_factorise(A, &memory));
        assert_true(dr_matrix_in_doubt(A));
        assert_int_equal(dr_matrix_factor(A), DR_SINGLE);
    }
    assert_true(dr_matrix_factorise(A, &memory));
    assert_int_equal(dr_matrix_factor(A), DR_CHOLESKY);
    assert_true(dr_matrix_prefer(A, DR_SINGLE));
    assert_int_equal(dr_matrix_factor(A), DR_CHOLESKY);
    dr_matrix_free(A);
    cloth_free(&cloth);
}

static void test_front__double_can_be_asked_for_and_single_again(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(9);
    struct dr_matrix *A = matrix_new(&cloth, DR_SINGLE);
    bool memory;
    for (int i = 0; i < 3; i++) {
        enum dr_factor factor = i == 1 ? DR_CHOLESKY : DR_SINGLE;
        assert_true(dr_matrix_prefer(A, factor));
        assert_int_equal(dr_matrix_factor(A), factor);
        assert_false(dr_matrix_is_single(A));
        assemble_cloth(A, &cloth, 1e-3);
        assert_true(dr_matrix_factorise(A, &memory));
        assert_int_equal(dr_matrix_is_single(A), factor == DR_SINGLE);
        solve_once(A, cloth.b, cloth.x);
        dr_matrix_multiply(A, cloth.x, cloth.q);
        for (size_t k = 0; k < cloth.size; k++)
            assert_near(cloth.q[k], cloth.b[k], factor == DR_SINGLE ? 1e-3 : 1e-11, 1);
    }
    dr_matrix_free(A);
    cloth_free(&cloth);
}

static void test_front__another_pattern_has_another_front(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(9);
    const uint32_t link[] = {0, 99, 9, 90};
    struct dr_matrix *A = matrix_new(&cloth, DR_SINGLE), *B = matrix_new(&cloth, DR_SINGLE);
    bool memory;
    size_t alone = dr_matrix_bytes(A);
    assert_int_equal(dr_matrix_relink(A, link, 2, NULL), DRAPE_OK);
    assert_true(dr_matrix_bytes(A) > alone);
    assemble_cloth(A, &cloth, 1e-3);
    dr_matrix_add_between(A, 99, 0, (const double[3][3]){{0.1, 0, 0}, {0, 0.2, 0}, {0, 0, 0.1}});
    assert_true(dr_matrix_factorise(A, &memory));
    assert_true(dr_matrix_is_single(A));
    assert_in_range(solve_whole(A, &cloth), 2, 5);
    assert_int_equal(dr_matrix_relink(A, NULL, 0, NULL), DRAPE_OK);
    assert_false(dr_matrix_is_single(A));
    struct dr_matrix *both[] = {A, B};
    for (int i = 0; i < 2; i++) {
        assemble_cloth(both[i], &cloth, 1e-3);
        assert_true(dr_matrix_factorise(both[i], &memory));
        solve_once(both[i], cloth.b, i ? cloth.q : cloth.p);
    }
    assert_memory_equal(cloth.p, cloth.q, cloth.size * sizeof *cloth.p);
    dr_matrix_free(A);
    dr_matrix_free(B);
    cloth_free(&cloth);
}

static void test_front__one_free_node_and_none(void **state)
{
    (void)state;
    const double pattern[] = {0, 0, 1, 0, 0, 1}, density = 1;
    const uint32_t one[] = {0, 1, 2};
    for (int free_nodes = 0; free_nodes < 2; free_nodes++) {
        const bool fixed[] = {!free_nodes, true, true};
        struct dr_mesh *mesh;
        struct dr_matrix *A;
        bool memory;
        double b[9] = {4, 2, -8, 1}, w[9];
        assert_int_equal(dr_mesh_new(3, 1, one, one, pattern, NULL, &density, fixed, &mesh, NULL), 0);
        assert_int_equal(dr_matrix_new(mesh, NULL, NULL, 0, DR_SINGLE, NULL, &A, NULL), 0);
        dr_matrix_set_base(A, 0);
        dr_matrix_reset(A);
        dr_matrix_add_node(A, 0, (const double[6]){4, 0, 16, 0, 0, 64});
        for (int i = 0; i < 2; i++) {
            assert_true(dr_matrix_factorise(A, &memory));
            assert_int_equal(dr_matrix_is_single(A), free_nodes);
            solve_once(A, b, w);
            const double expected[9] = {1, 0.125, -0.125};
            for (int k = 0; k < 9; k++)
                assert_true(w[k] == (free_nodes ? expected[k] : 0));
            assert_true(dr_matrix_prefer(A, DR_CHOLESKY));
            assert_true(dr_matrix_prefer(A, DR_SINGLE));
        }
        assert_int_equal(dr_matrix_relink(A, NULL, 0, NULL), DRAPE_OK);
        assert_true(dr_matrix_bytes(A) > 0);
        dr_matrix_free(A);
        dr_mesh_free(mesh);
    }
}

#ifdef CAN_FAIL_ALLOCATIONS
/* Makes a matrix, has it factorised in single precision, then in double, and links it anew. */
static drape_status go_through(const struct cloth *cloth)
{
    const uint32_t link[] = {0, 15};
    struct dr_matrix *A = NULL;
    bool memory = false;
    drape_status status = dr_matrix_new(cloth->mesh, NULL, NULL, 0, DR_SINGLE, NULL, &A, NULL);
    if (status < 0)
        return status;
    assemble_cloth(A, cloth, 1e-3);
    bool single = dr_matrix_factorise(A, &memory);
    assert_true(single && !memory); /* which takes no memory */
    assemble_cloth(A, cloth, 1e-10);
    assert_false(dr_matrix_factorise(A, &memory));
    assert_true(dr_matrix_in_doubt(A) && !memory);
    if (!dr_matrix_factorise(A, &memory)) {
        assert_true(memory);
        status = DRAPE_ENOMEM;
    } else if (!dr_matrix_prefer(A, DR_CHOLESKY) || !dr_matrix_prefer(A, DR_SINGLE))
        status = DRAPE_ENOMEM;
    else
        status = dr_matrix_relink(A, link, 1, NULL);
    dr_matrix_free(A);
    return status;
}
#endif

static void test_front__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct cloth cloth = cloth_new(3);
    long before = held, n = 0;
    for (bool failed = true; failed; n++) {
        fail_at(n);
        drape_status status = go_through(&cloth);
        failed = has_failed();
        assert_int_equal(held, before);
        assert_int_equal(status, failed ? DRAPE_ENOMEM : DRAPE_OK);
    }
    print_message("  %ld allocations\n", n - 1);
    assert_true(n > 60);
    cloth_free(&cloth);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_front__solves_to_single_precision_with_every_instruction_set),
        cmocka_unit_test(test_front__the_same_matrix_has_the_same_bytes),
        cmocka_unit_test(test_front__powers_of_two_scale_the_solution_alone),
        cmocka_unit_test(test_front__what_round_off_may_have_made_is_uncertain),
        cmocka_unit_test(test_front__one_negative_direction_is_found_anywhere),
        cmocka_unit_test(test_front__a_second_processor_changes_no_byte),
        cmocka_unit_test(test_front__what_is_indefinite_is_so_in_every_share),
        cmocka_unit_test(test_front__few_conjugate_gradient_steps_make_it_double),
        cmocka_unit_test(test_front__two_right_hand_sides_are_solved_alike),
        cmocka_unit_test(test_front__double_judges_what_single_cannot_and_stays_the_second_time),
        cmocka_unit_test(test_front__a_run_has_doubts_settled_at_once),
        cmocka_unit_test(test_front__doubts_that_are_dropped_count),
        cmocka_unit_test(test_front__double_can_be_asked_for_and_single_again),
        cmocka_unit_test(test_front__another_pattern_has_another_front),
        cmocka_unit_test(test_front__one_free_node_and_none),
        cmocka_unit_test(test_front__every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("front", tests, NULL, NULL);
}
