/* test_friction.c - the potential of the anchors against its derivatives, Coulomb's bound, what an update
 * does. */
#include "test.h"

#include "friction.h"
#include "scarce.h"

#define MU 0.4

/* ---- a dense matrix in place of the sparse one ----------------------------------------------- */

enum { NODES = 4, N = 3 * NODES };

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

void dr_matrix_add_triangle(struct dr_matrix *A, size_t t, const double H[9][9])
{
    (void)A, (void)t, (void)H;
}

/* ---- two triangles pressed onto a slanting plane and a ball in it ---------------------------- */

struct scene {
    struct dr_mesh *mesh;
    struct dr_body *body[2];
    struct dr_contact *contact;
    struct dr_friction *friction;
    double x[N];
};

static void make(struct scene *s, double friction)
{
    static const uint32_t triangle[] = {0, 1, 2, 1, 3, 2};
    static const double pattern[] = {0, 0, 0.02, 0, 0, 0.02, 0.02, 0.02}, density = 0.2;
    const drape_material material = {.friction = friction};
    const drape_body plane = {
        .kind = DRAPE_BODY_PLANE, .offset = 0.004, .friction = MU, .axis = {0.48, 0.6, 0.64}};
    const drape_body ball = {.kind = DRAPE_BODY_SPHERE, .offset = 0.004, .friction = 2 * MU, .radius = 0.01};
    const double across[2][3] = {{0.8, -0.64, 0}, {0.36, 0.48, -0.8}};
    uint64_t seed = 3;
    assert_int_equal(dr_mesh_new(NODES, 2, triangle, triangle, pattern, NULL, &density, NULL, &s->mesh, NULL),
                     0);
    assert_int_equal(dr_body_new(&plane, 0, &s->body[0], NULL), 0);
    assert_int_equal(dr_body_new(&ball, 1, &s->body[1], NULL), 0);
    assert_int_equal(dr_contact_new(s->mesh, s->body, 2, &s->contact, NULL), 0);
    assert_int_equal(dr_friction_new(s->contact, s->mesh, &material, &s->friction, NULL), 0);
    for (size_t v = 0; v < NODES; v++)
        for (size_t d = 0; d < 3; d++)
            s->x[3 * v + d] = pattern[2 * v] * across[0][d] + pattern[2 * v + 1] * across[1][d] +
                              0.002 * plane.axis[d] + 5e-4 * test_random(&seed);
}

static void release(struct scene *s)
{
    dr_friction_free(s->friction);
    dr_contact_free(s->contact);
    dr_body_free(s->body[0]);
    dr_body_free(s->body[1]);
    dr_mesh_free(s->mesh);
}

/* Moves every node by about `slip` from where it is anchored. */
static void displace(struct scene *s, double slip)
{
    uint64_t seed = 11;
    for (size_t i = 0; i < N; i++)
        s->x[i] += slip * test_random(&seed);
}

/* ---- tests ----------------------------------------------------------------------------------- */

static void test_friction__forces_and_hessian_are_derivatives(void **state)
{
    (void)state;
    static const double slip[] = {1e-4, 3e-4, 4e-3}; /* all stick, some slip, all slip */
    for (size_t k = 0; k < sizeof slip / sizeof *slip; k++) {
        struct scene s;
        struct dr_matrix exact = {0};
        double g[N] = {0}, step = 1e-8, largest = 0, stiffest = 0;
        make(&s, 0);
        dr_friction_update(s.friction, s.x);
        assert_true(dr_friction_energy(s.friction, s.x, g) == 0);
        displace(&s, slip[k]);
        dr_friction_energy(s.friction, s.x, g);
        dr_friction_hessian(s.friction, s.x, 1, &exact);
        for (size_t i = 0; i < N; i++) {
            largest = fmax(largest, fabs(g[i]));
            stiffest = fmax(stiffest, fabs(exact.a[i][i]));
        }
        assert_true(largest > 0.1); /* N */
        for (size_t i = 0; i < N; i++) {
            double above[N] = {0}, below[N] = {0}, kept = s.x[i];
            s.x[i] = kept + step;
            double high = dr_friction_energy(s.friction, s.x, above);
            s.x[i] = kept - step;
            double low = dr_friction_energy(s.friction, s.x, below);
            s.x[i] = kept;
            assert_near((high - low) / (2 * step), g[i], 1e-6, largest);
            for (size_t j = 0; j < N; j++)
                assert_near((above[j] - below[j]) / (2 * step), exact.a[i][j], 1e-5, stiffest);
        }
        release(&s);
    }
}

/* No node is pulled with more than mu times its normal force, and at the end of the slip with just that. */
static void test_friction__no_force_is_above_coulombs(void **state)
{
    (void)state;
    static const double own = 0.7;
    for (int fabric = 0; fabric < 2; fabric++) {
        struct scene s;
        make(&s, fabric ? own : 0);
        double zero[NODES] = {0}, one[NODES] = {1, 1, 1, 1}, mine[NODES] = {own, own, own, own};
        double load[N], grip[NODES], g[N] = {0};
        dr_contact_loads(s.contact, s.x, fabric ? mine : zero, fabric ? zero : one, load, grip);
        dr_friction_update(s.friction, s.x);
        displace(&s, 0.05);
        dr_friction_energy(s.friction, s.x, g);
        for (size_t v = 0; v < NODES; v++) {
            const double *n = load + 3 * v, *f = g + 3 * v;
            double force = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
            double normal = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
            assert_true(normal > 0.1);
            assert_close(force, grip[v], 1e-12);
            assert_near(f[0] * n[0] + f[1] * n[1] + f[2] * n[2], 0, 1e-12, force * normal);
            if (fabric) /* with one coefficient; two bodies push in somewhat different directions */
                assert_true(force >= own * normal * (1 - 1e-9) && force < 2 * own * normal);
            else
                assert_true(force >= MU * normal * (1 - 1e-9) && force < 4 * MU * normal);
        }
        release(&s);
    }
}

static void test_friction__the_step_matrix_majorises_and_both_are_semidefinite(void **state)
{
    (void)state;
    struct scene s;
    struct dr_matrix exact = {0}, step = {0};
    uint64_t seed = 5;
    make(&s, 0);
    dr_friction_update(s.friction, s.x);
    displace(&s, 3e-4);
    dr_friction_hessian(s.friction, s.x, 1, &exact);
    dr_friction_hessian(s.friction, s.x, 0, &step);
    for (int trial = 0; trial < 1000; trial++) {
        double v[N], low = 0, high = 0;
        for (size_t i = 0; i < N; i++)
            v[i] = test_random(&seed);
        for (size_t i = 0; i < N; i++)
            for (size_t j = 0; j < N; j++) {
                low += v[i] * exact.a[i][j] * v[j];
                high += v[i] * step.a[i][j] * v[j];
            }
        assert_true(low >= -1e-12 * high);
        assert_true(high >= low * (1 - 1e-12));
    }
    release(&s);
}

/* Within the slip an update keeps anchors; beyond, it leaves them one slip behind; out of contact, none. */
static void test_friction__an_update_drags_anchors_and_forgets_them(void **state)
{
    (void)state;
    struct scene s;
    make(&s, 0);
    dr_friction_update(s.friction, s.x);
    displace(&s, 1e-4);
    double stored = dr_friction_energy(s.friction, s.x, NULL);
    dr_friction_update(s.friction, s.x);
    assert_true(stored > 0);
    double kept = dr_friction_energy(s.friction, s.x, NULL); /* with new normal forces */
    assert_true(kept > 0.2 * stored && kept < 5 * stored);

    displace(&s, 0.01);
    for (size_t v = 0; v < NODES; v++) { /* back into contact */
        double height = 0.48 * s.x[3 * v] + 0.6 * s.x[3 * v + 1] + 0.64 * s.x[3 * v + 2];
        for (size_t d = 0; d < 3; d++)
            s.x[3 * v + d] += (0.002 - height) * (double[]){0.48, 0.6, 0.64}[d];
    }
    dr_friction_update(s.friction, s.x);
    double g[N] = {0}, zero[NODES] = {0}, one[NODES] = {1, 1, 1, 1}, load[N], grip[NODES], most = 0;
    dr_contact_loads(s.contact, s.x, zero, one, load, grip);
    for (size_t v = 0; v < NODES; v++)
        most += grip[v] * DR_FRICTION_SLIP * 2 / 3; /* E(s) = 2/3 g s */
    assert_close(dr_friction_energy(s.friction, s.x, g), most, 1e-9);

    for (size_t i = 0; i < N; i++)
        s.x[i] += 0.1 * (double[]){0.48, 0.6, 0.64}[i % 3];
    dr_friction_update(s.friction, s.x);
    assert_true(dr_friction_energy(s.friction, s.x, g) == 0);
    release(&s);
}

/* After holding a force, friction balances what of it runs along the surface, up to mu N. */
static void test_friction__a_cloth_at_rest_is_held_from_the_first(void **state)
{
    (void)state;
    for (int heavy = 0; heavy < 2; heavy++) {
        struct scene s;
        make(&s, 0);
        double none[NODES] = {0}, one[NODES] = {1, 1, 1, 1}, load[N], grip[NODES], f[N], g[N] = {0};
        uint64_t seed = 5;
        dr_contact_loads(s.contact, s.x, none, one, load, grip);
        for (size_t i = 0; i < N; i++)
            f[i] = (heavy ? 10 : 0.3) * grip[i / 3] * test_random(&seed);
        double left[N];
        memcpy(left, f, sizeof left);
        dr_friction_update(s.friction, s.x);
        double change = dr_friction_brace(s.friction, s.x, left);
        dr_friction_energy(s.friction, s.x, g);
        for (size_t i = 0; i < N; i++)
            assert_near(left[i], f[i] - g[i], 1e-9, fabs(f[i]));
        assert_true(dr_friction_brace(s.friction, s.x, left) < 1e-6 * change); /* all of it at once */
        for (size_t v = 0; v < NODES; v++) {
            double n[3], off = 0, force = 0, pull = 0, size = 0;
            for (size_t d = 0; d < 3; d++)
                force += load[3 * v + d] * load[3 * v + d];
            for (size_t d = 0; d < 3; d++) {
                n[d] = load[3 * v + d] / sqrt(force);
                off += f[3 * v + d] * n[d];
            }
            for (size_t d = 0; d < 3; d++) {
                size += (f[3 * v + d] - off * n[d]) * (f[3 * v + d] - off * n[d]);
                pull += g[3 * v + d] * g[3 * v + d];
            }
            assert_true(sqrt(size) > 0.01 * grip[v]);
            assert_close(sqrt(pull), fmin(sqrt(size), grip[v]), 1e-9);
            for (size_t d = 0; d < 3; d++)
                assert_near(g[3 * v + d] / sqrt(pull), (f[3 * v + d] - off * n[d]) / sqrt(size), 1e-9, 1);
        }
        release(&s);
    }
}

static void test_friction__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct scene s;
    const drape_material material = {.friction = 0.5};
    make(&s, 0);
    long before = held;
    for (long n = 0;; n++) {
        struct dr_friction *friction = NULL;
        drape_error error = {0};
        countdown = n;
        drape_status status = dr_friction_new(s.contact, s.mesh, &material, &friction, &error);
        bool reached = countdown < 0;
        countdown = -1;
        if (status >= 0 && !reached) {
            dr_friction_free(friction);
            assert_true(n > 3);
            break;
        }
        assert_int_equal(status, DRAPE_ENOMEM);
        assert_int_equal(held, before);
    }
    release(&s);
#else
    print_message("SKIP: allocations cannot be made to fail in this flavour\n");
#endif
}

/* A body that turns and shifts takes anchors and normals along: of the same cloth, moved the same way, it
 * asks the same force, turned. */
static void test_friction__anchors_ride_on_a_body_that_moves(void **state)
{
    (void)state;
    static const double corner[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0}, moved[9] = {3, 1, 2, 3, 2, 2, 3, 1, 3};
    static const double centre[3] = {0.3, -0.2, 0.1};
    static const uint32_t sides[3] = {0, 1, 2};
    const struct dr_place place = {0, {1, 0, 0}, 0};
    struct scene s;
    struct dr_motor motor[NODES];
    double before[N] = {0}, after[N] = {0};
    make(&s, 0);
    dr_friction_update(s.friction, s.x);
    displace(&s, 3e-4);
    double energy = dr_friction_energy(s.friction, s.x, before);
    for (size_t v = 0; v < NODES; v++) {
        motor[v] = dr_motor_at(&place, sides, corner, moved, centre);
        dr_motor_move(motor + v, centre, s.x + 3 * v);
        dr_motor_turn(motor + v, before + 3 * v);
    }
    double left = dr_friction_energy(s.friction, s.x, NULL); /* with the anchors still behind */
    dr_friction_carry(s.friction, motor, centre);
    assert_true(energy > 0 && left > 100 * energy);
    assert_close(dr_friction_energy(s.friction, s.x, after), energy, 1e-9);
    for (size_t i = 0; i < N; i++)
        assert_near(after[i], before[i], 1e-9, 1e-3);
    release(&s);
}

static void test_friction__tells_how_much_of_it_lets_go(void **state)
{
    (void)state;
    struct scene s;
    double w[N] = {0};
    make(&s, 0);
    assert_true(dr_friction_let_go(s.friction, s.x, w) == 0); /* no anchors yet */
    dr_friction_update(s.friction, s.x);
    assert_true(dr_friction_let_go(s.friction, s.x, w) == 0);
    for (size_t v = 0; v < NODES; v++) { /* along the plane */
        w[3 * v] = 0.8 * 1.8 * DR_FRICTION_SLIP;
        w[3 * v + 1] = -0.64 * 1.8 * DR_FRICTION_SLIP;
    }
    assert_true(dr_friction_let_go(s.friction, s.x, w) == 0);
    for (size_t i = 0; i < N; i++)
        w[i] *= 2;
    assert_true(dr_friction_let_go(s.friction, s.x, w) > 0.99);
    for (size_t i = 0; i < N; i++) /* what slips already does not let go */
        s.x[i] += w[i];
    assert_true(dr_friction_let_go(s.friction, s.x, w) == 0);
    release(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_friction__anchors_ride_on_a_body_that_moves),
        cmocka_unit_test(test_friction__tells_how_much_of_it_lets_go),
        cmocka_unit_test(test_friction__forces_and_hessian_are_derivatives),
        cmocka_unit_test(test_friction__no_force_is_above_coulombs),
        cmocka_unit_test(test_friction__the_step_matrix_majorises_and_both_are_semidefinite),
        cmocka_unit_test(test_friction__an_update_drags_anchors_and_forgets_them),
        cmocka_unit_test(test_friction__a_cloth_at_rest_is_held_from_the_first),
        cmocka_unit_test(test_friction__every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("friction", tests, NULL, NULL);
}
