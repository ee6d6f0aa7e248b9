/* test_self.c - cloth against cloth: energies against their derivatives, friction of layers, the gaps a step
 * sees, the limit on steps. */
#include "test.h"

#include "contact.h"
#include "gap.h"
#include "scarce.h"
#include "self.h"

/* ---- a dense matrix in place of the sparse one ----------------------------------------------- */

enum { SIDE = 4, LAYER = SIDE * SIDE, NODES = 2 * LAYER, N = 3 * NODES };

struct dr_matrix {
    double a[N][N];
};

void dr_matrix_add_node(struct dr_matrix *A, uint32_t node, const double H[6])
{
    static const int entry[3][3] = {{0, 1, 3}, {1, 2, 4}, {3, 4, 5}};
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3; j++)
            A->a[3 * node + i][3 * node + j] += H[entry[i][j]];
}

void dr_matrix_add_between(struct dr_matrix *A, uint32_t a, uint32_t b, const double H[3][3])
{
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3; j++) {
            A->a[3 * a + i][3 * b + j] += H[i][j];
            A->a[3 * b + j][3 * a + i] += H[i][j];
        }
}

void dr_matrix_add_triangle(struct dr_matrix *A, size_t t, const double H[9][9])
{
    (void)A, (void)t, (void)H;
}

bool dr_matrix_has(const struct dr_matrix *A, uint32_t a, uint32_t b)
{
    (void)A, (void)a, (void)b;
    return true;
}

/* ---- two sheets of 10 mm cells, one above the other ------------------------------------------ */

struct scene {
    struct dr_mesh *mesh;
    struct dr_self *self;
    double x[N];
};

#define THICKNESS 0.002

/* The upper one `height` above, turned by `angle` about the vertical, both shaken by `noise`. */
static void make(struct scene *s, double height, double angle, double noise)
{
    static double pattern[2 * NODES];
    static uint32_t triangle[2 * 6 * (SIDE - 1) * (SIDE - 1)];
    static const double density = 0.2;
    uint64_t seed = 4;
    size_t count = 0;
    for (uint32_t layer = 0; layer < 2; layer++)
        for (uint32_t j = 0; j + 1 < SIDE; j++)
            for (uint32_t i = 0; i + 1 < SIDE; i++) {
                uint32_t a = layer * LAYER + j * SIDE + i,
                         cell[] = {a, a + 1, a + SIDE, a + 1, a + SIDE + 1, a + SIDE};
                memcpy(triangle + count, cell, sizeof cell);
                count += 6;
            }
    for (size_t v = 0; v < NODES; v++) {
        double u = 0.01 * (double)(v % SIDE) - 0.015, w = 0.01 * (double)(v % LAYER / SIDE) - 0.015;
        double turn = v < LAYER ? 0 : angle;
        pattern[2 * v] = u;
        pattern[2 * v + 1] = w;
        s->x[3 * v] = cos(turn) * u - sin(turn) * w;
        s->x[3 * v + 1] = v < LAYER ? 0 : height;
        s->x[3 * v + 2] = -sin(turn) * u - cos(turn) * w;
        for (size_t d = 0; d < 3; d++)
            s->x[3 * v + d] += noise * test_random(&seed);
    }
    assert_int_equal(
        dr_mesh_new(NODES, count / 3, triangle, triangle, pattern, NULL, &density, NULL, &s->mesh, NULL), 0);
    assert_int_equal(dr_self_new(s->mesh, THICKNESS, &s->self, NULL), 0);
}

static void release(struct scene *s)
{
    dr_self_free(s->self);
    dr_mesh_free(s->mesh);
}

static double largest_of(const double *g)
{
    double largest = 0;
    for (size_t i = 0; i < N; i++)
        largest = fmax(largest, fabs(g[i]));
    return largest;
}

/* Energy against gradient, gradient against the exact Hessian, at s->x. */
static void check_derivatives(struct scene *s, double precision)
{
    static struct dr_matrix exact;
    double g[N] = {0}, step = 1e-9, stiffest = 0;
    memset(&exact, 0, sizeof exact);
    assert_true(dr_self_energy(s->self, s->x, g) > 0);
    dr_self_hessian(s->self, s->x, 1, &exact);
    for (size_t i = 0; i < N; i++)
        for (size_t j = 0; j < N; j++)
            stiffest = fmax(stiffest, fabs(exact.a[i][j]));
    for (size_t i = 0; i < N; i++) {
        double above[N] = {0}, below[N] = {0}, kept = s->x[i];
        s->x[i] = kept + step;
        double high = dr_self_energy(s->self, s->x, above);
        s->x[i] = kept - step;
        double low = dr_self_energy(s->self, s->x, below);
        s->x[i] = kept;
        assert_near((high - low) / (2 * step), g[i], precision, largest_of(g));
        for (size_t j = 0; j < N; j++)
            assert_near((above[j] - below[j]) / (2 * step), exact.a[i][j], precision, stiffest);
    }
}

/* ---- the penalty ----------------------------------------------------------------------------- */

static void test_self__forces_and_hessian_are_derivatives(void **state)
{
    (void)state;
    static const struct {
        double height, angle, noise;
    } at[] = {{0.0015, 0.3, 1e-4}, {0.0006, 0.8, 1e-4}, {0.0012, 0.5, 5e-4}, {0.0012, 0.02, 2e-4}};
    for (size_t k = 0; k < sizeof at / sizeof *at; k++) {
        struct scene s;
        make(&s, at[k].height, at[k].angle, at[k].noise);
        check_derivatives(&s, 2e-5);
        release(&s);
    }
}

/* What steps are made with: without the curvature of distances nothing has negative curvature. */
static void test_self__steps_see_no_negative_curvature(void **state)
{
    (void)state;
    struct scene s;
    static struct dr_matrix A;
    uint64_t seed = 8;
    memset(&A, 0, sizeof A);
    make(&s, 0.001, 0.03, 3e-4);
    dr_self_hessian(s.self, s.x, 0, &A);
    for (int trial = 0; trial < 1000; trial++) {
        double p[N], Ap, sum = 0, size = 0;
        for (size_t i = 0; i < N; i++)
            p[i] = test_random(&seed);
        for (size_t i = 0; i < N; i++) {
            Ap = 0;
            for (size_t j = 0; j < N; j++) {
                assert_near(A.a[i][j], A.a[j][i], 1e-12, 1e3);
                Ap += A.a[i][j] * p[j];
            }
            sum += p[i] * Ap;
            size += fabs(p[i] * Ap);
        }
        assert_true(sum >= -1e-12 * size);
    }
    release(&s);
}

/* Layers a thickness apart feel nothing; the pressure of flat layers is that of the penalty per area, up to
 * what the free edges and the parallel threads leave. */
static void test_self__energy_begins_at_the_thickness(void **state)
{
    (void)state;
    struct scene s;
    make(&s, THICKNESS * (1 + 1e-9), 0.4, 0);
    assert_true(dr_self_energy(s.self, s.x, NULL) == 0);
    release(&s);
    make(&s, THICKNESS * (1 - 1e-3), 0.4, 0);
    assert_true(dr_self_energy(s.self, s.x, NULL) > 0);
    release(&s);
}

/* A sheet finer than the thickness does not feel itself. */
static void test_self__flat_cloth_feels_nothing_at_any_thickness(void **state)
{
    (void)state;
    struct scene s;
    struct dr_self *thick;
    make(&s, 0.04, 0, 0);
    assert_int_equal(dr_self_new(s.mesh, 0.05, &thick, NULL), 0);
    assert_true(dr_self_energy(thick, s.x, NULL) == 0);
    dr_self_free(thick);
    release(&s);
}

/* A search more or less changes no bit. */
static void test_self__energy_does_not_depend_on_where_it_was_searched(void **state)
{
    (void)state;
    struct scene s, t;
    uint64_t seed = 21;
    double g[N] = {0}, h[N] = {0};
    make(&s, 0.003, 0.3, 1e-4);
    make(&t, 0.003, 0.3, 1e-4);
    for (int step = 0; step < 8; step++) { /* t goes there in steps, some of them too short to search */
        for (size_t i = 0; i < N; i++)
            t.x[i] += (i % 3 == 1 && i >= N / 2 ? -2.5e-4 : 0) + 1e-5 * test_random(&seed);
        dr_self_energy(t.self, t.x, NULL);
    }
    memset(h, 0, sizeof h);
    double there = dr_self_energy(t.self, t.x, h), here = dr_self_energy(s.self, t.x, g);
    assert_true(here > 0 && here == there);
    assert_memory_equal(g, h, sizeof g);
    release(&s);
    release(&t);
}

/* What was known of the pairs wears off by twice the most that a node has moved, as both sheets may come. A
 * search looks 7.3 mm far here: what begins closer is in the lists. */
static void test_self__what_is_known_wears_off_with_every_move(void **state)
{
    (void)state;
    static const double gap[][2] = {
        {0.0071, 0.0019}, {0.0075, 0.0019}, {0.012, 0.004}}; /* m: before, after */
    for (size_t k = 0; k < sizeof gap / sizeof *gap; k++) {
        struct scene s, fresh;
        double w[N] = {0}, g[N] = {0}, h[N] = {0};
        make(&s, gap[k][0], 0.3, 0);
        make(&fresh, gap[k][0], 0.3, 0);
        assert_true(dr_self_energy(s.self, s.x, NULL) == 0);
        for (size_t v = 0; v < NODES; v++) {
            s.x[3 * v + 1] += (v < LAYER ? 0.5 : -0.5) * (gap[k][0] - gap[k][1]);
            w[3 * v + 1] = v < LAYER ? 0 : -0.99 * gap[k][1];
        }
        double allowed = dr_self_allows(s.self, s.x, w);
        assert_true(allowed < 1);
        assert_near(allowed, dr_self_allows(fresh.self, s.x, w), 1e-12, 1);
        double energy = dr_self_energy(s.self, s.x, g);
        assert_true((energy > 0) == (gap[k][1] < THICKNESS));
        assert_true(energy == dr_self_energy(fresh.self, s.x, h));
        assert_memory_equal(g, h, sizeof g);
        release(&s);
        release(&fresh);
    }
}

/* ---- friction -------------------------------------------------------------------------------- */

/* Between parts, then but for what is to be welded: what was found before does not stay. */
static void test_self__welding_changes_what_feels_what(void **state)
{
    (void)state;
    static struct scene s;
    static const uint32_t part[NODES] = {0};
    static uint32_t weld[NODES];
    make(&s, 0.001, 0.3, 1e-5);
    double all = dr_self_energy(s.self, s.x, NULL);
    assert_true(all > 0);
    for (uint32_t i = 0; i < NODES; i++)
        weld[i] = i;
    release(&s);
    make(&s, 0.001, 0.3, 1e-5);
    dr_self_between(s.self, part);
    assert_true(dr_self_energy(s.self, s.x, NULL) == 0);
    dr_self_weld(s.self, weld);
    assert_true(dr_self_energy(s.self, s.x, NULL) == all);
    for (uint32_t i = 0; i < NODES; i++)
        weld[i] = i % SIDE ? i : i % LAYER; /* one column of each layer with the other's */
    dr_self_weld(s.self, weld);
    double some = dr_self_energy(s.self, s.x, NULL);
    assert_true(some > 0 && some < all);
    release(&s);
}

static void roughen(struct scene *s, double mu)
{
    double own[NODES] = {0}, rest[NODES];
    for (size_t v = 0; v < NODES; v++)
        rest[v] = 1;
    assert_int_equal(dr_self_roughen(s->self, own, rest, mu, NULL), 0);
}

static void test_self__friction_is_a_potential(void **state)
{
    (void)state;
    static const double slip[] = {1e-4, 8e-4};
    for (size_t k = 0; k < sizeof slip / sizeof *slip; k++) {
        struct scene s;
        make(&s, 0.0012, 0.4, 1e-4);
        roughen(&s, 0.5);
        assert_true(dr_self_held(s.self, s.x) == 0);
        dr_self_renew(s.self, s.x);
        assert_true(dr_self_held(s.self, s.x) == 0);
        for (size_t v = LAYER; v < NODES; v++)
            s.x[3 * v] += slip[k];
        assert_true(dr_self_held(s.self, s.x) > 0);
        check_derivatives(&s, 2e-5);
        release(&s);
    }
}

/* The upper layer dragged sideways for long: the force is mu times what presses it. */
static void test_self__layers_that_slip_pull_with_coulombs_force(void **state)
{
    (void)state;
    struct scene s;
    double mu = 0.5, g[N], press = 0, pull = 0;
    make(&s, 0.0012, 0, 0);
    roughen(&s, mu);
    for (int step = 0; step < 20; step++) {
        dr_self_renew(s.self, s.x);
        for (size_t v = LAYER; v < NODES; v++)
            s.x[3 * v] += 1e-4;
    }
    dr_self_renew(s.self, s.x);
    memset(g, 0, sizeof g);
    dr_self_energy(s.self, s.x, g);
    for (size_t v = LAYER; v < NODES; v++) {
        pull += g[3 * v];
        press -= g[3 * v + 1];
    }
    assert_true(press > 0.1);
    assert_true(pull > 0.9 * mu * press && pull <= mu * press * (1 + 1e-9));
    release(&s);
}

/* A pair that sticks keeps its anchor over updates: it is held, and does not creep. */
static void test_self__what_sticks_is_held_over_updates(void **state)
{
    (void)state;
    struct scene s;
    make(&s, 0.0012, 0, 0);
    roughen(&s, 0.5);
    dr_self_renew(s.self, s.x);
    for (size_t v = LAYER; v < NODES; v++)
        s.x[3 * v] += 1e-4;
    double slipped = dr_self_held(s.self, s.x);
    dr_self_renew(s.self, s.x); /* other points of the threads are closest now */
    double first = dr_self_held(s.self, s.x);
    assert_true(slipped > 0);
    assert_close(first, slipped, 0.02);
    for (int update = 0; update < 5; update++)
        dr_self_renew(s.self, s.x);
    assert_close(dr_self_held(s.self, s.x), first, 1e-9);
    release(&s);
}

/* ---- steps ----------------------------------------------------------------------------------- */

static void test_self__gaps_see_layers_come_together(void **state)
{
    (void)state;
    struct scene s;
    struct dr_gaps *gaps;
    double w[N] = {0}, g[N] = {0};
    make(&s, 0.004, 0.4, 0);
    assert_int_equal(dr_gaps_new(NULL, s.self, &gaps, NULL), 0);
    assert_int_equal(dr_gaps_take(gaps, s.x, NULL), 0);
    assert_true(dr_gaps_surplus(gaps, w, g) == 0);
    for (size_t v = LAYER; v < NODES; v++)
        w[3 * v + 1] = -0.003;
    double seen = dr_gaps_surplus(gaps, w, g);
    for (size_t i = 0; i < N; i++)
        s.x[i] += w[i];
    double is = dr_self_energy(s.self, s.x, NULL);
    assert_true(is > 0 && seen > is && seen < 1.5 * is); /* linear gaps are exact but at the rims */
    dr_gaps_free(gaps);
    release(&s);
}

static void test_self__a_step_stops_before_layers_pass(void **state)
{
    (void)state;
    struct scene s;
    double w[N] = {0}, at[3];
    make(&s, 0.004, 0.4, 1e-4);
    for (size_t v = LAYER; v < NODES; v++)
        w[3 * v + 1] = -0.02;
    double allowed = dr_self_allows(s.self, s.x, w);
    assert_true(allowed > 0.1 && allowed < 0.2); /* touching comes at a fifth, a fifth of that is kept */
    assert_true(dr_self_clip(s.self, s.x, w) > 0);
    for (size_t i = 0; i < N; i++)
        s.x[i] += w[i];
    assert_int_equal(dr_self_crossings(s.self, s.x, at), 0);
    release(&s);
}

static void test_self__crossings_are_counted_where_they_are(void **state)
{
    (void)state;
    struct scene s;
    double at[3] = {NAN, NAN, NAN};
    make(&s, 0.004, 0.4, 0);
    assert_int_equal(dr_self_crossings(s.self, s.x, at), 0);
    s.x[3 * (LAYER + 5) + 1] = -0.002;
    assert_true(dr_self_crossings(s.self, s.x, at) > 0);
    assert_true(fabs(at[1]) < 1e-12 && fabs(at[0]) < 0.02 && fabs(at[2]) < 0.02);
    release(&s);
}

/* A sheet of which all nodes lie within a hundredth of a millimetre has more pairs than are listed. */
static void test_self__tells_when_cloth_is_crowded(void **state)
{
    (void)state;
    enum { ROW = 14 };
    static double pattern[2 * ROW * ROW], x[3 * ROW * ROW];
    static uint32_t triangle[6 * (ROW - 1) * (ROW - 1)];
    const double density = 0.2;
    struct dr_mesh *mesh;
    struct dr_self *self;
    uint64_t seed = 6;
    size_t count = 0;
    for (uint32_t j = 0; j + 1 < ROW; j++)
        for (uint32_t i = 0; i + 1 < ROW; i++) {
            uint32_t a = j * ROW + i, cell[] = {a, a + 1, a + ROW, a + 1, a + ROW + 1, a + ROW};
            memcpy(triangle + count, cell, sizeof cell);
            count += 6;
        }
    for (size_t v = 0; v < ROW * ROW; v++) {
        pattern[2 * v] = x[3 * v] = 0.01 * (double)(v % ROW);
        pattern[2 * v + 1] = x[3 * v + 2] = 0.01 * (double)(v / ROW);
    }
    assert_int_equal(
        dr_mesh_new(ROW * ROW, count / 3, triangle, triangle, pattern, NULL, &density, NULL, &mesh, NULL), 0);
    assert_int_equal(dr_self_new(mesh, THICKNESS, &self, NULL), 0);
    dr_self_energy(self, x, NULL);
    assert_false(dr_self_crowded(self));
    for (size_t i = 0; i < 3 * ROW * ROW; i++)
        x[i] = 1e-5 * test_random(&seed);
    dr_self_energy(self, x, NULL);
    assert_true(dr_self_crowded(self));
    dr_self_free(self);
    dr_mesh_free(mesh);
}

static void test_self__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct scene s;
    make(&s, 0.0012, 0.4, 0);
    long before = held, n = 0, refused = 0;
    for (bool failed = true; failed; n++) {
        struct dr_self *self = NULL;
        countdown = n;
        drape_status status = dr_self_new(s.mesh, THICKNESS, &self, NULL);
        if (status >= 0) {
            double energy = dr_self_energy(self, s.x, NULL);
            status = dr_self_error(self, NULL);
            assert_true(isinf(energy) == (status < 0));
        }
        failed = countdown == -1;
        if (status < 0) /* sorting can do without its scratch */
            assert_true(failed && status == DRAPE_ENOMEM);
        refused += status < 0;
        countdown = -1;
        dr_self_free(self);
        assert_int_equal(held, before);
    }
    assert_true(refused > 5);
    release(&s);
#else
    print_message("SKIP: allocations cannot be made to fail in this flavour\n");
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_self__forces_and_hessian_are_derivatives),
        cmocka_unit_test(test_self__steps_see_no_negative_curvature),
        cmocka_unit_test(test_self__energy_begins_at_the_thickness),
        cmocka_unit_test(test_self__flat_cloth_feels_nothing_at_any_thickness),
        cmocka_unit_test(test_self__energy_does_not_depend_on_where_it_was_searched),
        cmocka_unit_test(test_self__what_is_known_wears_off_with_every_move),
        cmocka_unit_test(test_self__welding_changes_what_feels_what),
        cmocka_unit_test(test_self__friction_is_a_potential),
        cmocka_unit_test(test_self__layers_that_slip_pull_with_coulombs_force),
        cmocka_unit_test(test_self__what_sticks_is_held_over_updates),
        cmocka_unit_test(test_self__gaps_see_layers_come_together),
        cmocka_unit_test(test_self__a_step_stops_before_layers_pass),
        cmocka_unit_test(test_self__crossings_are_counted_where_they_are),
        cmocka_unit_test(test_self__tells_when_cloth_is_crowded),
        cmocka_unit_test(test_self__every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("self", tests, NULL, NULL);
}
