/* test_gap.c - contact as a step sees it, against contact itself and its own derivatives. */
#include "test.h"

#include "gap.h"
#include "scarce.h"

enum { SIDE = 5, NODES = SIDE * SIDE, N = 3 * NODES };

struct scene {
    struct dr_mesh *mesh;
    struct dr_body *body[2];
    struct dr_contact *contact;
    struct dr_gaps *gaps;
    double x[N], w[N];
};

static const drape_body ground = {.kind = DRAPE_BODY_PLANE, .offset = 0.004, .axis = {0.48, 0.6, 0.64}};
static const drape_body ball = {.kind = DRAPE_BODY_SPHERE, .offset = 0.003, .radius = 0.02};

/* A sheet of 40 mm about `height` above the ground, shaken by 2 mm; a step of up to 4 mm. */
static void make(struct scene *s, size_t bodies, double height)
{
    static double pattern[2 * NODES];
    static uint32_t triangle[6 * (SIDE - 1) * (SIDE - 1)];
    const double across[2][3] = {{0.8, -0.64, 0}, {0.36, 0.48, -0.8}}, density = 0.2;
    uint64_t seed = 4;
    size_t count = 0;
    for (uint32_t j = 0; j + 1 < SIDE; j++)
        for (uint32_t i = 0; i + 1 < SIDE; i++) {
            uint32_t a = j * SIDE + i, cell[] = {a, a + 1, a + SIDE, a + 1, a + SIDE + 1, a + SIDE};
            memcpy(triangle + count, cell, sizeof cell);
            count += 6;
        }
    for (size_t v = 0; v < NODES; v++) {
        pattern[2 * v] = 0.01 * ((double)(v % SIDE) - 2);
        pattern[2 * v + 1] = 0.01 * ((double)(v / SIDE) - 2);
        for (size_t d = 0; d < 3; d++) {
            s->x[3 * v + d] = pattern[2 * v] * across[0][d] + pattern[2 * v + 1] * across[1][d] +
                              height * ground.axis[d] + 0.002 * test_random(&seed);
            s->w[3 * v + d] = 0.004 * test_random(&seed);
        }
    }
    assert_int_equal(
        dr_mesh_new(NODES, count / 3, triangle, triangle, pattern, NULL, &density, NULL, &s->mesh, NULL), 0);
    assert_int_equal(dr_body_new(&ground, 0, &s->body[0], NULL), 0);
    assert_int_equal(dr_body_new(&ball, 1, &s->body[1], NULL), 0);
    assert_int_equal(dr_contact_new(s->mesh, s->body, bodies, &s->contact, NULL), 0);
    assert_int_equal(dr_gaps_new(s->contact, NULL, &s->gaps, NULL), 0);
    assert_int_equal(dr_gaps_take(s->gaps, s->x, NULL), 0);
}

static void release(struct scene *s)
{
    dr_gaps_free(s->gaps);
    dr_contact_free(s->contact);
    dr_body_free(s->body[0]);
    dr_body_free(s->body[1]);
    dr_mesh_free(s->mesh);
}

/* Over planes gaps are linear: force and stiffness at x, to second order, and the surplus are the contact at
 * x + w. The stiffness is a difference of gradients. */
static void test_gap__completes_the_quadratic_model_to_the_contact(void **state)
{
    (void)state;
    struct scene s;
    double g[N] = {0}, first[N] = {0}, ahead[N] = {0}, behind[N] = {0}, at[N], step = 1e-6, model = 0;
    make(&s, 1, 0.003);
    model += dr_contact_energy(s.contact, s.x, first);
    for (int sign = -1; sign <= 1; sign += 2) {
        for (size_t i = 0; i < N; i++)
            at[i] = s.x[i] + sign * step * s.w[i];
        dr_contact_energy(s.contact, at, sign < 0 ? behind : ahead);
    }
    for (size_t i = 0; i < N; i++) {
        model += first[i] * s.w[i] + 0.5 * s.w[i] * (ahead[i] - behind[i]) / (2 * step);
        at[i] = s.x[i] + s.w[i];
    }
    double surplus = dr_gaps_surplus(s.gaps, s.w, g), energy = dr_contact_energy(s.contact, at, NULL);
    assert_true(fabs(surplus) > 0.05 * energy); /* it matters */
    assert_close(model + surplus, energy, 1e-7);
    release(&s);
}

static void test_gap__without_a_step_there_is_no_surplus(void **state)
{
    (void)state;
    struct scene s;
    double zero[N] = {0}, g[N] = {0}, product[N] = {0};
    make(&s, 2, 0.002);
    assert_true(dr_gaps_surplus(s.gaps, zero, g) == 0);
    dr_gaps_add_product(s.gaps, s.w, product);
    for (size_t i = 0; i < N; i++)
        assert_true(g[i] == 0 && product[i] == 0);
    release(&s);
}

static void test_gap__gradient_and_product_are_derivatives(void **state)
{
    (void)state;
    struct scene s;
    double g[N] = {0}, p[N], product[N] = {0}, second[N] = {0}, step = 1e-7, largest = 0, most = 0;
    uint64_t seed = 8;
    make(&s, 2, 0.003);
    for (size_t i = 0; i < N; i++)
        p[i] = test_random(&seed);
    dr_gaps_surplus(s.gaps, s.w, g);
    dr_gaps_add_product(s.gaps, p, product);
    for (size_t i = 0; i < N; i++) {
        largest = fmax(largest, fabs(product[i]));
        most = fmax(most, fabs(g[i]));
    }
    assert_true(largest > 10 && most > 1e-2); /* N/m, N */
    for (int sign = -1; sign <= 1; sign += 2) {
        double at[N], there[N] = {0};
        for (size_t i = 0; i < N; i++)
            at[i] = s.w[i] + sign * step * p[i];
        dr_gaps_surplus(s.gaps, at, there);
        for (size_t i = 0; i < N; i++)
            second[i] += sign * there[i] / (2 * step);
    }
    for (size_t i = 0; i < N; i++) {
        double kept = s.w[i], unused[N] = {0};
        assert_near(second[i], product[i], 1e-4, largest);
        s.w[i] = kept + step;
        double above = dr_gaps_surplus(s.gaps, s.w, unused);
        s.w[i] = kept - step;
        double below = dr_gaps_surplus(s.gaps, s.w, unused);
        s.w[i] = kept;
        assert_near((above - below) / (2 * step), g[i], 1e-5, most);
    }
    release(&s);
}

/* What is out of contact now and in it after the step: the step matrix at x cannot know of it. */
static void test_gap__sees_contacts_that_the_step_makes(void **state)
{
    (void)state;
    struct scene s;
    double g[N] = {0}, down[N], sideways[N];
    make(&s, 1, 0.008);
    assert_true(dr_contact_energy(s.contact, s.x, NULL) == 0);
    for (size_t i = 0; i < N; i++) {
        down[i] = -0.006 * ground.axis[i % 3];
        sideways[i] = 0.006 * (double[]){0.8, -0.64, 0}[i % 3];
    }
    assert_true(dr_gaps_surplus(s.gaps, down, g) > 1e-4);
    assert_true(fabs(dr_gaps_surplus(s.gaps, sideways, g)) < 1e-12);
    release(&s);
}

static void test_gap__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct scene s;
    make(&s, 1, 0.003);
    long before = held;
    struct dr_gaps *gaps = NULL;
    countdown = 0;
    assert_int_equal(dr_gaps_new(s.contact, NULL, &gaps, NULL), DRAPE_ENOMEM);
    assert_int_equal(held, before);
    assert_int_equal(dr_gaps_new(s.contact, NULL, &gaps, NULL), DRAPE_OK);
    countdown = 0;
    assert_int_equal(dr_gaps_take(gaps, s.x, NULL), DRAPE_ENOMEM);
    assert_int_equal(dr_gaps_take(gaps, s.x, NULL), DRAPE_OK);
    countdown = 0;
    assert_int_equal(dr_gaps_take(gaps, s.x, NULL), DRAPE_OK); /* the room is there */
    countdown = -1;
    dr_gaps_free(gaps);
    assert_int_equal(held, before);
    release(&s);
#else
    print_message("SKIP: allocations cannot be made to fail in this flavour\n");
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gap__completes_the_quadratic_model_to_the_contact),
        cmocka_unit_test(test_gap__without_a_step_there_is_no_surplus),
        cmocka_unit_test(test_gap__gradient_and_product_are_derivatives),
        cmocka_unit_test(test_gap__sees_contacts_that_the_step_makes),
        cmocka_unit_test(test_gap__every_allocation_may_fail),
    };
    return cmocka_run_group_tests_name("gap", tests, NULL, NULL);
}
