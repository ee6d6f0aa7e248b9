/* test_contact.c - the penalty against its derivatives and closed forms; what the clip guarantees. */
#include "test.h"

#include "contact.h"
#include "scarce.h"
#include "shapes.h"

static const double KAPPA = DR_CONTACT_STIFFNESS;

/* ---- a dense matrix in place of the sparse one ----------------------------------------------- */

struct dr_matrix {
    const struct dr_mesh *mesh;
    size_t n;  /* 3*nodes */
    double *a; /* n*n, row-major, both triangles */
};

void dr_matrix_add_node(struct dr_matrix *A, uint32_t node, const double H[6])
{
    static const int entry[3][3] = {{0, 1, 3}, {1, 2, 4}, {3, 4, 5}};
    for (size_t i = 0; i < 3; i++)
        for (size_t j = 0; j < 3; j++)
            A->a[(3 * node + i) * A->n + 3 * node + j] += H[entry[i][j]];
}

void dr_matrix_add_triangle(struct dr_matrix *A, size_t t, const double H[9][9])
{
    const uint32_t *corner = A->mesh->triangle + 3 * t;
    for (size_t i = 0; i < 9; i++)
        for (size_t j = 0; j < 9; j++) /* the lower triangle only, as promised */
            A->a[(3 * corner[i / 3] + i % 3) * A->n + 3 * corner[j / 3] + j % 3] +=
                H[i > j ? i : j][i > j ? j : i];
}

/* ---- cloth and bodies ------------------------------------------------------------------------ */

/* A flat square of n x n x 2 triangles, `edge` m long. */
static struct dr_mesh *square_mesh(size_t n, double edge)
{
    size_t nodes = (n + 1) * (n + 1), triangles = 2 * n * n;
    double *pattern = calloc(2 * nodes, sizeof *pattern), density = 0.2;
    uint32_t *triangle = calloc(3 * triangles, sizeof *triangle);
    struct dr_mesh *mesh = NULL;
    assert_non_null(pattern);
    assert_non_null(triangle);
    for (size_t v = 0; v < nodes; v++) {
        pattern[2 * v] = edge * (double)(v % (n + 1)) / (double)n;
        pattern[2 * v + 1] = edge * (double)(v / (n + 1)) / (double)n;
    }
    for (size_t q = 0; q < n * n; q++) {
        uint32_t a = (uint32_t)(q / n * (n + 1) + q % n), up = (uint32_t)n + 1;
        const uint32_t two[6] = {a, a + 1, a + up, a + 1, a + up + 1, a + up};
        memcpy(triangle + 6 * q, two, sizeof two);
    }
    assert_int_equal(
        dr_mesh_new(nodes, triangles, triangle, triangle, pattern, NULL, &density, NULL, &mesh, NULL),
        DRAPE_OK);
    free(pattern);
    free(triangle);
    return mesh;
}

/* The square laid into the xz plane about the origin, each point shifted by up to `noise` and lifted. */
static double *place(const struct dr_mesh *mesh, double edge, double height, double noise)
{
    uint64_t seed = 7;
    size_t row = (size_t)lround(sqrt((double)mesh->nodes));
    double *x = calloc(3 * mesh->nodes, sizeof *x);
    assert_non_null(x);
    for (size_t v = 0; v < mesh->nodes; v++) {
        x[3 * v] = edge * ((double)(v % row) / (double)(row - 1) - 0.5) + noise * test_random(&seed);
        x[3 * v + 1] = height + noise * test_random(&seed);
        x[3 * v + 2] = edge * (0.5 - (double)(v / row) / (double)(row - 1)) + noise * test_random(&seed);
    }
    return x;
}

static struct dr_body *make_body(drape_body desc)
{
    struct dr_body *body = NULL;
    drape_error error = {.message = ""};
    if (dr_body_new(&desc, 0, &body, &error) != DRAPE_OK)
        print_error("%s\n", error.message);
    assert_non_null(body);
    return body;
}

static struct dr_body *make_sphere_mesh(double radius, double offset)
{
    struct shape sphere = shape_sphere((double[]){0, 0, 0}, radius, 16);
    drape_body desc = shape_body(&sphere);
    desc.offset = offset;
    struct dr_body *body = make_body(desc);
    shape_free(&sphere);
    return body;
}

static const drape_body ground = {.kind = DRAPE_BODY_PLANE, .offset = 0.004, .axis = {0, 1, 0}};
static const drape_body slope = {.kind = DRAPE_BODY_PLANE, .offset = 0.003, .axis = {0.36, 0.48, 0.8}};
static const drape_body wire = {
    .kind = DRAPE_BODY_CAPSULE, .offset = 0.003, .point = {-0.2, 0, 0}, .axis = {0.2, 0, 0}, .radius = 0.001};
static const drape_body ball = {.kind = DRAPE_BODY_SPHERE, .offset = 0.003, .radius = 0.05};

static struct dr_contact *make_contact(const struct dr_mesh *mesh, struct dr_body **body, size_t bodies)
{
    struct dr_contact *contact = NULL;
    assert_int_equal(dr_contact_new(mesh, body, bodies, &contact, NULL), DRAPE_OK);
    return contact;
}

/* psi by its definition: the integral of psi' = s^2/(2w) up to w, then of w/2 + s - w. */
static double psi(double s, double w)
{
    return s <= 0 ? 0 : s < w ? s * s * s / (6 * w) : w * w / 6 + w / 2 * (s - w) + (s - w) * (s - w) / 2;
}

/* ---- energy ---------------------------------------------------------------------------------- */

static void test_contact__flat_cloth_over_a_plane_has_the_closed_form(void **state)
{
    (void)state;
    static const double height[] = {0.005, 0.004, 0.0039, 0.003, 0.002, 0.001, 0, -0.05};
    struct dr_mesh *mesh = square_mesh(25, 0.2);
    struct dr_body *body = make_body(ground);
    struct dr_contact *contact = make_contact(mesh, &body, 1);
    for (size_t i = 0; i < sizeof height / sizeof *height; i++) {
        double *x = place(mesh, 0.2, height[i], 0);
        double expected = KAPPA * 0.04 * psi(ground.offset - height[i], ground.offset / 2);
        assert_near(dr_contact_energy(contact, x, NULL), expected, 1e-12, 1e-12);
        free(x);
    }
    dr_contact_free(contact);
    dr_body_free(body);
    dr_mesh_free(mesh);
}

/* Cut into n^2 pieces a triangle has its corners' weight of a half and 1 - 1/(2 n^2) more. */
static void test_contact__long_triangles_are_sampled_like_short_ones(void **state)
{
    (void)state;
    static const struct {
        double longest;
        int pieces;
    } cases[] = {{0.99, 1}, {1.01, 2}, {2.01, 3}, {2.99, 3}, {6.01, 7}, {7.01, 8}, {20, 8}};
    struct dr_body *body = make_body(ground);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double edge = cases[i].longest * DR_CONTACT_SPACING / sqrt(2), n = cases[i].pieces;
        struct dr_mesh *mesh = square_mesh(1, edge);
        struct dr_contact *contact = make_contact(mesh, &body, 1);
        double *x = place(mesh, edge, 0.002, 0);
        double whole = KAPPA * edge * edge * psi(ground.offset - 0.002, ground.offset / 2);
        assert_close(dr_contact_energy(contact, x, NULL), whole * (1.5 - 0.5 / (n * n)), 1e-12);
        assert_int_equal(dr_contact_samples(contact), 4 + 2 * ((n + 1) * (n + 2) / 2 - 3 + n * n));
        free(x);
        dr_contact_free(contact);
        dr_mesh_free(mesh);
    }
    dr_body_free(body);
}

/* A ball of 5 mm under a square of 60 mm, wherever it stands, is felt before it comes through. */
static void test_contact__nothing_comes_through_between_the_corners(void **state)
{
    (void)state;
    struct dr_mesh *mesh = square_mesh(1, 0.06);
    double *x = place(mesh, 0.06, 0.0052, 0);
    for (int i = 0; i < 400; i++) {
        drape_body small = ball;
        small.radius = 0.005;
        small.point[0] = 0.003 * (i % 20 - 9.5);
        small.point[2] = 0.003 * (i / 20 - 9.5);
        struct dr_body *body = make_body(small);
        struct dr_contact *contact = make_contact(mesh, &body, 1);
        assert_true(dr_contact_energy(contact, x, NULL) > 0);
        dr_contact_free(contact);
        dr_body_free(body);
    }
    free(x);
    dr_mesh_free(mesh);
}

static void test_contact__each_body_acts_at_its_own_offset(void **state)
{
    (void)state;
    struct dr_mesh *mesh = square_mesh(12, 0.1);
    drape_body wide = ground;
    wide.offset = 0.01;
    struct dr_body *body[2] = {make_body(ground), make_body(wide)};
    struct dr_contact *both = make_contact(mesh, body, 2);
    double *x = place(mesh, 0.1, 0.003, 0);
    double expected = KAPPA * 0.01 * (psi(0.001, 0.002) + psi(0.007, 0.005));
    assert_close(dr_contact_energy(both, x, NULL), expected, 1e-12);
    free(x);
    dr_contact_free(both);
    dr_body_free(body[0]);
    dr_body_free(body[1]);
    dr_mesh_free(mesh);
}

/* With one body there are too few distances to share, with two enough. */
static void test_contact__a_second_processor_changes_no_byte(void **state)
{
    (void)state;
    struct dr_mesh *mesh = square_mesh(51, 0.48);
    struct dr_body *body[] = {make_sphere_mesh(0.2, 0.004), make_body(ground)};
    struct dr_hand hand = {.processors = drape_processors_new(2)};
    assert_non_null(hand.processors);
    double *x = place(mesh, 0.48, 0.003, 0.01), *g[2], *w[2];
    for (size_t bodies = 1; bodies <= 2; bodies++) {
        double energy[2];
        size_t clipped[2];
        for (int lent = 0; lent < 2; lent++) {
            struct dr_contact *contact = make_contact(mesh, body, bodies);
            dr_contact_lend(contact, lent ? &hand : NULL);
            g[lent] = calloc(3 * mesh->nodes, sizeof *g[lent]);
            w[lent] = calloc(3 * mesh->nodes, sizeof *w[lent]);
            assert_non_null(g[lent]);
            assert_non_null(w[lent]);
            energy[lent] = dr_contact_energy(contact, x, g[lent]);
            assert_true(energy[lent] > 0);
            for (size_t i = 0; i < 3 * mesh->nodes; i++)
                w[lent][i] = i % 3 < 2 ? -0.02 : 0;
            clipped[lent] = dr_contact_clip(contact, x, w[lent], 0.002);
            dr_contact_free(contact);
        }
        assert_true(energy[0] == energy[1]);
        assert_memory_equal(g[0], g[1], 3 * mesh->nodes * sizeof *x);
        assert_memory_equal(w[0], w[1], 3 * mesh->nodes * sizeof *x);
        assert_true(clipped[0] > mesh->nodes / 100 && clipped[0] == clipped[1]);
        for (int lent = 0; lent < 2; lent++) {
            free(g[lent]);
            free(w[lent]);
        }
        assert_true((hand.seconds > 0) == (bodies == 2));
    }
    free(x);
    drape_processors_free(hand.processors);
    dr_body_free(body[0]);
    dr_body_free(body[1]);
    dr_mesh_free(mesh);
}

/* Distances are kept from one call to the next: they must be those of this x and of where the body is now. */
static void test_contact__what_is_kept_is_of_this_place_and_posture(void **state)
{
    (void)state;
    struct dr_mesh *mesh = square_mesh(12, 0.1);
    struct shape box = shape_box((double[]){-0.2, -0.1, -0.2}, (double[]){0.2, 0, 0.2});
    drape_body desc = shape_body(&box);
    struct dr_body *body = NULL;
    desc.offset = 0.004;
    assert_int_equal(dr_body_new_moving(&desc, &body, NULL), DRAPE_OK);
    struct dr_contact *contact = make_contact(mesh, &body, 1);
    double *x = place(mesh, 0.1, 0.003, 0), *y = place(mesh, 0.1, 0.002, 0);
    double at_x = KAPPA * 0.01 * psi(0.001, 0.002), at_y = KAPPA * 0.01 * psi(0.002, 0.002);
    assert_close(dr_contact_energy(contact, x, NULL), at_x, 1e-12);
    assert_close(dr_contact_energy(contact, y, NULL), at_y, 1e-12);
    assert_close(dr_contact_energy(contact, x, NULL), at_x, 1e-12);
    assert_close(dr_contact_energy(contact, x, NULL), at_x, 1e-12);
    for (size_t v = 0; v < box.vertices; v++)
        box.x[3 * v + 1] += 0.001;
    dr_body_move(body, box.x);
    assert_close(dr_contact_energy(contact, x, NULL), at_y, 1e-12);
    free(x);
    free(y);
    dr_contact_free(contact);
    dr_body_free(body);
    shape_free(&box);
    dr_mesh_free(mesh);
}

static void test_contact__without_bodies_there_is_nothing(void **state)
{
    (void)state;
    struct dr_mesh *mesh = square_mesh(2, 0.1);
    struct dr_contact *contact = make_contact(mesh, NULL, 0);
    double *x = place(mesh, 0.1, 0, 0), w[27] = {0.1, 0.2}, deepest = 1, where[3];
    assert_true(dr_contact_energy(contact, x, NULL) == 0);
    assert_int_equal(dr_contact_clip(contact, x, w, 1e-3), 0);
    assert_true(w[0] == 0.1 && w[1] == 0.2);
    assert_int_equal(dr_contact_penetrations(contact, x, &deepest, where), 0);
    assert_true(deepest == 0);
    assert_true(dr_contact_bytes(contact) >= 9 * sizeof(double));
    free(x);
    assert_null(dr_contact_free(contact));
    assert_null(dr_contact_free(NULL));
    dr_mesh_free(mesh);
}

static void test_contact__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct dr_mesh *mesh = square_mesh(2, 0.1);
    struct dr_body *body = make_body(ground);
    for (long n = 0; n < 7; n++) {
        struct dr_contact *contact = NULL;
        drape_error error;
        long before = held;
        countdown = n;
        assert_int_equal(dr_contact_new(mesh, &body, 1, &contact, &error), DRAPE_ENOMEM);
        assert_int_equal(countdown, -1);
        assert_int_equal(error.status, DRAPE_ENOMEM);
        assert_null(contact);
        assert_int_equal(held, before);
    }
    dr_body_free(body);
    dr_mesh_free(mesh);
#else
    print_message("SKIP: allocations cannot be made to fail in this flavour\n");
#endif
}

static void test_contact__evaluation_allocates_nothing(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct dr_mesh *mesh = square_mesh(4, 0.1);
    struct dr_body *body = make_sphere_mesh(0.05, 0.003);
    struct dr_contact *contact = make_contact(mesh, &body, 1);
    double *x = place(mesh, 0.1, 0.049, 0), *g = calloc(3 * mesh->nodes, sizeof *g), deepest, where[3];
    struct dr_matrix A = {mesh, 3 * mesh->nodes, calloc(9 * mesh->nodes * mesh->nodes, sizeof(double))};
    countdown = 0; /* the next allocation would use this up */
    assert_true(dr_contact_energy(contact, x, g) > 0);
    dr_contact_hessian(contact, x, 1, &A);
    dr_contact_clip(contact, x, g, 1e-3);
    dr_contact_penetrations(contact, x, &deepest, where);
    long left = countdown;
    countdown = -1;
    assert_int_equal(left, 0);
    free(x);
    free(g);
    free(A.a);
    dr_contact_free(contact);
    dr_body_free(body);
    dr_mesh_free(mesh);
#else
    print_message("SKIP: allocations cannot be counted in this flavour\n");
#endif
}

/* psi is C2: value, slope and curvature of the energy meet at s = 0 and at s = w. */
static void test_contact__the_penalty_is_twice_differentiable(void **state)
{
    (void)state;
    const double w = ground.offset / 2, joint[2] = {0, w}, step = 1e-7;
    struct dr_mesh *mesh = square_mesh(1, 0.009);
    struct dr_body *body = make_body(ground);
    struct dr_contact *contact = make_contact(mesh, &body, 1);
    for (int k = 0; k < 2; k++) {
        double energy[2], slope_[2], curvature[2];
        for (int side = 0; side < 2; side++) {
            double slope_at[2];
            for (int i = 0; i < 2; i++) { /* at one and two steps to this side of the joint */
                double s = joint[k] + (side ? 1 : -1) * (i + 1) * step, g[12] = {0};
                double *x = place(mesh, 0.009, ground.offset - s, 0);
                energy[side] = dr_contact_energy(contact, x, g) / (KAPPA * 0.009 * 0.009);
                slope_at[i] = -(g[1] + g[4] + g[7] + g[10]) / (KAPPA * 0.009 * 0.009); /* d/ds = -d/dy */
                free(x);
            }
            slope_[side] = slope_at[0];
            curvature[side] = (slope_at[1] - slope_at[0]) / (side ? step : -step);
        }
        assert_near(energy[0], energy[1], 1e-3, 1e-6);
        assert_near(slope_[0], slope_[1], 1e-3, 1e-3);
        assert_near(curvature[0], curvature[1], 1e-3, 1);
        assert_near(curvature[1], k, 1e-3, 1); /* psi'' = s/w: 0, then 1 */
    }
    dr_contact_free(contact);
    dr_body_free(body);
    dr_mesh_free(mesh);
}

/* ---- derivatives ----------------------------------------------------------------------------- */

static void check_gradient(struct dr_body **body, size_t bodies, size_t cells, double height)
{
    struct dr_mesh *mesh = square_mesh(cells, 0.12);
    struct dr_contact *contact = make_contact(mesh, body, bodies);
    double *x = place(mesh, 0.12, height, 0.002), *g = calloc(3 * mesh->nodes, sizeof *g), largest = 0;
    const double step = 1e-6, before = 3.5;
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        g[i] = before; /* the gradient is added */
    assert_true(dr_contact_energy(contact, x, g) > 1e-6);
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        largest = fmax(largest, fabs(g[i] - before));
    assert_true(largest > 1e-3); /* not trivially small: the cloth weighs 1e-3 N a node */
    for (size_t i = 0; i < 3 * mesh->nodes; i++) {
        double kept = x[i];
        x[i] = kept + step;
        double above = dr_contact_energy(contact, x, NULL);
        x[i] = kept - step;
        double below = dr_contact_energy(contact, x, NULL);
        x[i] = kept;
        assert_near((above - below) / (2 * step), g[i] - before, 1e-5, largest);
    }
    free(x);
    free(g);
    dr_contact_free(contact);
    dr_mesh_free(mesh);
}

static void test_contact__gradients_are_derivatives(void **state)
{
    (void)state;
    struct dr_body *body[5] = {make_body(ground), make_body(slope), make_body(wire), make_body(ball),
                               make_sphere_mesh(0.05, 0.003)};
    for (size_t cells = 3; cells <= 14; cells += 11) { /* of 40 mm, cut into pieces, and of 9 mm */
        check_gradient(&body[0], 1, cells, 0.002);
        check_gradient(&body[1], 1, cells, 0);
        check_gradient(&body[2], 1, cells, 0.002);
        check_gradient(&body[3], 1, cells, 0.049);
        check_gradient(&body[4], 1, cells, 0.049);
        check_gradient(body, 5, cells, 0.003);
    }
    for (int b = 0; b < 5; b++)
        dr_body_free(body[b]);
}

static struct dr_matrix dense(const struct dr_mesh *mesh)
{
    struct dr_matrix A = {mesh, 3 * mesh->nodes, calloc(9 * mesh->nodes * mesh->nodes, sizeof(double))};
    assert_non_null(A.a);
    return A;
}

static double largest_entry(const struct dr_matrix *A)
{
    double largest = 0;
    for (size_t i = 0; i < A->n * A->n; i++)
        largest = fmax(largest, fabs(A->a[i]));
    return largest;
}

/* The Hessian with the share `curvature` of the bodies' curvature is the derivative of the gradient. */
static void check_hessian(struct dr_body **body, size_t bodies, double height, double curvature)
{
    struct dr_mesh *mesh = square_mesh(4, 0.05);
    struct dr_contact *contact = make_contact(mesh, body, bodies);
    struct dr_matrix A = dense(mesh);
    double *x = place(mesh, 0.05, height, 0.003), *above = calloc(A.n, sizeof *above),
           *below = calloc(A.n, sizeof *below);
    const double step = 1e-7;
    dr_contact_hessian(contact, x, curvature, &A);
    double largest = largest_entry(&A);
    assert_true(largest > 100); /* kappa A/2 is about 500 N/m a sample */
    for (size_t i = 0; i < A.n; i++) {
        double kept = x[i];
        memset(above, 0, A.n * sizeof *above);
        memset(below, 0, A.n * sizeof *below);
        x[i] = kept + step;
        dr_contact_energy(contact, x, above);
        x[i] = kept - step;
        dr_contact_energy(contact, x, below);
        x[i] = kept;
        for (size_t j = 0; j < A.n; j++)
            assert_near((above[j] - below[j]) / (2 * step), A.a[i * A.n + j], 1e-4, largest);
    }
    free(A.a);
    free(x);
    free(above);
    free(below);
    dr_contact_free(contact);
    dr_mesh_free(mesh);
}

static void test_contact__without_curvature_the_hessian_is_exact_for_a_plane(void **state)
{
    (void)state;
    struct dr_body *body = make_body(slope);
    check_hessian(&body, 1, -0.001, 0);
    dr_body_free(body);
}

static void test_contact__with_curvature_the_hessian_is_exact_for_every_body(void **state)
{
    (void)state;
    struct dr_body *body[5] = {make_body(ground), make_body(slope), make_body(wire), make_body(ball),
                               make_sphere_mesh(0.05, 0.003)};
    check_hessian(&body[2], 1, 0.002, 1);
    check_hessian(&body[3], 1, 0.049, 1);
    check_hessian(&body[4], 1, 0.049, 1);
    check_hessian(body, 5, 0.003, 1);
    for (int b = 0; b < 5; b++)
        dr_body_free(body[b]);
}

static void test_contact__the_hessian_is_positive_semidefinite(void **state)
{
    (void)state;
    struct dr_mesh *mesh = square_mesh(6, 0.08);
    struct dr_body *body[3] = {make_body(wire), make_body(ball), make_sphere_mesh(0.049, 0.003)};
    struct dr_contact *contact = make_contact(mesh, body, 3);
    struct dr_matrix A = dense(mesh);
    double *x = place(mesh, 0.08, 0, 0.05);
    uint64_t seed = 19;
    dr_contact_hessian(contact, x, 0, &A);
    double largest = largest_entry(&A);
    assert_true(largest > 100);
    for (int trial = 0; trial < 200; trial++) {
        double v[3 * 49], quadratic = 0, square = 0;
        for (size_t i = 0; i < A.n; i++) {
            v[i] = test_random(&seed);
            square += v[i] * v[i];
        }
        for (size_t i = 0; i < A.n; i++) {
            for (size_t j = 0; j < A.n; j++) {
                assert_true(A.a[i * A.n + j] == A.a[j * A.n + i]);
                quadratic += v[i] * A.a[i * A.n + j] * v[j];
            }
        }
        assert_true(quadratic >= -1e-12 * largest * square);
    }
    free(A.a);
    free(x);
    dr_contact_free(contact);
    for (int b = 0; b < 3; b++)
        dr_body_free(body[b]);
    dr_mesh_free(mesh);
}

/* ---- the clip -------------------------------------------------------------------------------- */

/* One node of a one-triangle cloth is moved; the others stay put. */
struct mover {
    struct dr_mesh *mesh;
    struct dr_contact *contact;
};

static struct mover mover_new(struct dr_body **body, size_t bodies)
{
    static const uint32_t corner[3] = {0, 1, 2};
    static const double pattern[6] = {0, 0, 0.01, 0, 0, 0.01}, density = 0.2;
    struct mover mover = {NULL, NULL};
    assert_int_equal(dr_mesh_new(3, 1, corner, corner, pattern, NULL, &density, NULL, &mover.mesh, NULL),
                     DRAPE_OK);
    mover.contact = make_contact(mover.mesh, body, bodies);
    return mover;
}

static void mover_free(struct mover *mover)
{
    dr_contact_free(mover->contact);
    dr_mesh_free(mover->mesh);
}

/* Clips the move w from `start`, the same whether distances there are known or not; the number of nodes
 * shortened. */
static size_t clip(const struct mover *mover, const double start[3], double w[3], double depth)
{
    double x[9] = {start[0], start[1], start[2], 9, 9, 9, 9, 9, 9}, all[9] = {w[0], w[1], w[2]};
    double again[9] = {w[0], w[1], w[2]};
    size_t shortened = dr_contact_clip(mover->contact, x, all, depth);
    dr_contact_energy(mover->contact, x, NULL);
    assert_int_equal(dr_contact_clip(mover->contact, x, again, depth), shortened);
    assert_memory_equal(again, all, sizeof all);
    memcpy(w, all, 3 * sizeof *w);
    for (int i = 3; i < 9; i++)
        assert_true(all[i] == 0);
    return shortened;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* phi at x + t w, "far" counting as reach. */
static double phi_at(const struct dr_body *body, const double x[3], const double w[3], double t)
{
    double at[3], phi = DR_BODY_REACH, unused[3];
    for (int d = 0; d < 3; d++)
        at[d] = x[d] + t * w[d];
    dr_body_distance(body, at, &phi, unused);
    return phi;
}

static void test_contact__a_head_on_move_ends_within_depth(void **state)
{
    (void)state;
    struct dr_body *body = make_body(ground);
    struct mover mover = mover_new(&body, 1);
    for (int i = 0; i < 4; i++) {
        const double start[3] = {0, (double[]){0.5, 0.02, 0.0022, 0}[i], 0}, depth = 1e-3;
        double w[3] = {0.01, -1, 0};
        assert_int_equal(clip(&mover, start, w, depth), 1);
        assert_true(start[1] + w[1] >= -depth && start[1] + w[1] <= -depth / 2 + 1e-12);
        assert_close(w[0], -0.01 * w[1], 1e-12); /* shortened, not turned */
    }
    mover_free(&mover);
    dr_body_free(body);
}

/* Distances that are known excuse no move that could get there, on a plane or a mesh's field. */
static void test_contact__moves_about_as_long_as_the_distance_are_walked(void **state)
{
    (void)state;
    struct dr_body *body[] = {make_body(ground), make_sphere_mesh(0.05, 0.003)};
    const double surface[] = {0, 0.05}, depth = 1e-5;
    for (size_t b = 0; b < 2; b++) {
        struct mover mover = mover_new(body + b, 1);
        for (int percent = 60; percent <= 160; percent += 2) {
            const double length = 0.01, start[3] = {0, surface[b] + 0.01 * percent * length, 0};
            double w[3] = {0, -length, 0};
            size_t shortened = clip(&mover, start, w, depth);
            if (percent < 95 || percent > 105)
                assert_int_equal(shortened, percent < 100);
        }
        mover_free(&mover);
        dr_body_free(body[b]);
    }
}

static void test_contact__free_moves_are_left_alone(void **state)
{
    (void)state;
    struct dr_body *body[2] = {make_body(ground), make_body(ball)};
    struct mover mover = mover_new(body, 2);
    static const double move[][6] = {
        {0, 3, 0, 2, -2, 1},             /* through free space */
        {0.3, 0.0022, 0, 0.02, 0, 0.01}, /* sliding on the ground at the usual gap */
        {0.3, 0.0022, 0, 0.02, 0.5, 0},  /* up and away */
        {0.3, 0.01, 0, 0, -0.0105, 0},   /* into the ground by less than the depth */
        {0.2, -0.1, 0, 0, 0.3, 0},       /* out of the ground */
        {0, 0.04, 0, 0, 0.1, 0},         /* out of the ball */
        {0, 0, 0, 0.2, 0.2, 0},          /* from its very centre, and out of the ground's surface */
    };
    for (size_t i = 0; i < sizeof move / sizeof *move; i++) {
        double w[3] = {move[i][3], move[i][4], move[i][5]};
        assert_int_equal(clip(&mover, move[i], w, 1e-3), 0);
        assert_memory_equal(w, move[i] + 3, sizeof w);
    }
    mover_free(&mover);
    dr_body_free(body[0]);
    dr_body_free(body[1]);
}

static void test_contact__nothing_passes_through_a_wire(void **state)
{
    (void)state;
    struct dr_body *body = make_body(wire); /* 2 mm thick; the moves are up to 400 mm long */
    struct mover mover = mover_new(&body, 1);
    uint64_t seed = 29;
    int aimed = 0;
    for (int i = 0; i < 5000; i++) {
        /* From a random point outside through a random point near the axis. */
        double depth = (double[]){2e-4, 1e-3, 5e-3}[i % 3], start[3], through[3], w[3];
        for (int d = 0; d < 3; d++) {
            start[d] = 0.15 * test_random(&seed);
            through[d] = (d ? 2e-3 : 0.15) * test_random(&seed);
            w[d] = 2 * (through[d] - start[d]);
        }
        if (hypot(start[1], start[2]) < 0.0011)
            continue;
        const double full[3] = {w[0], w[1], w[2]}, square = w[1] * w[1] + w[2] * w[2];
        double nearest =
            -(start[1] * w[1] + start[2] * w[2]) / square; /* where the path comes nearest the axis */
        double axial = start[0] + nearest * w[0],
               gap = fabs(start[1] * w[2] - start[2] * w[1]) / sqrt(square);
        clip(&mover, start, w, depth);
        assert_true(phi_at(body, start, w, 1) >= -depth);
        if (gap > 0.0005 || fabs(axial) > 0.19 || nearest > 1)
            continue; /* it would not have met the core of the wire */
        aimed++;
        /* Where it ends it is still inside the wire, or has not come to it. */
        assert_true(dot(w, full) >= 0 && sqrt(dot(w, w)) <= sqrt(dot(full, full)));
        if (phi_at(body, start, w, 1) >= 0)
            assert_true(sqrt(dot(w, w) / dot(full, full)) < nearest);
    }
    assert_in_range(aimed, 500, 5000);
    mover_free(&mover);
    dr_body_free(body);
}

/* Random moves against several bodies at once, from inside and outside; the path is sampled densely. */
static void test_contact__the_clip_keeps_its_word(void **state)
{
    (void)state;
    enum { BODIES = 4 };
    struct dr_body *body[BODIES] = {make_body(ground), make_body(ball), make_body(wire),
                                    make_sphere_mesh(0.06, 0.003)};
    struct mover mover = mover_new(body, BODIES);
    uint64_t seed = 37;
    size_t shortened = 0;
    for (int i = 0; i < 4000; i++) {
        const double depth = i % 2 ? 1e-3 : 4e-3, size = (double[]){0.003, 0.02, 0.3}[i % 3];
        double start[3], w[3];
        for (int d = 0; d < 3; d++) {
            start[d] = 0.08 * test_random(&seed);
            w[d] = size * test_random(&seed);
        }
        shortened += clip(&mover, start, w, depth);
        for (int b = 0; b < BODIES; b++) {
            double first = phi_at(body[b], start, w, 0), lowest = fmin(first, 0) - depth;
            assert_true(phi_at(body[b], start, w, 1) >= lowest);
            for (int k = 0; k <= 500; k++) {
                double phi = phi_at(body[b], start, w, k / 500.0);
                assert_true(phi >= lowest - 0.3 * depth);
                if (phi >= 0)
                    lowest = -depth;
            }
        }
    }
    print_message("%zu of 4000 random moves shortened\n", shortened);
    assert_in_range(shortened, 500, 3500);
    mover_free(&mover);
    for (int b = 0; b < BODIES; b++)
        dr_body_free(body[b]);
}

static void test_contact__a_node_inside_may_always_leave(void **state)
{
    (void)state;
    struct dr_body *body[3] = {make_body(ball), make_body(wire), make_sphere_mesh(0.05, 0.003)};
    uint64_t seed = 43;
    for (int b = 0; b < 3; b++) {
        struct mover mover = mover_new(&body[b], 1);
        int checked = 0;
        for (int i = 0; i < 3000; i++) {
            double radius = b == 1 ? 0.001 : 0.04, x[3], w[3], phi, grad[3];
            for (int d = 0; d < 3; d++)
                x[d] = radius * test_random(&seed);
            assert_true(dr_body_distance(body[b], x, &phi, grad) || b == 1);
            if (phi >= 0)
                continue;
            for (int d = 0; d < 3; d++)
                w[d] = 0.1 * grad[d];
            double wanted[3] = {w[0], w[1], w[2]};
            assert_int_equal(clip(&mover, x, w, 5e-4), 0);
            assert_memory_equal(w, wanted, sizeof w);
            checked++;
        }
        assert_in_range(checked, 500, 3000);
        mover_free(&mover);
    }
    for (int b = 0; b < 3; b++)
        dr_body_free(body[b]);
}

static void test_contact__repeated_clips_never_stick(void **state)
{
    (void)state;
    struct dr_body *body = make_body(ground);
    struct mover mover = mover_new(&body, 1);
    double x[3] = {0, 0.0022, 0};
    for (int i = 0; i < 400; i++) { /* pressed down at 45 degrees again and again, as a bad step would */
        double w[3] = {0.01, -0.01, 0};
        clip(&mover, x, w, 1e-3);
        assert_true(w[0] >= 0.0005 / sqrt(2) - 1e-12); /* depth/2 is always free */
        for (int d = 0; d < 3; d++)
            x[d] += w[d];
        x[1] += 0.0012; /* what the penalty gives back */
    }
    mover_free(&mover);
    dr_body_free(body);
}

static void test_contact__penetrations_are_counted_once(void **state)
{
    (void)state;
    struct dr_mesh *mesh = square_mesh(2, 0.02);
    struct dr_body *body[2] = {make_body(ground), make_body(ball)};
    struct dr_contact *contact = make_contact(mesh, body, 2);
    double *x = place(mesh, 0.02, 0.06, 0), deepest = -1, where[3] = {7};
    assert_int_equal(dr_contact_penetrations(contact, x, &deepest, where), 0);
    assert_true(deepest == 0 && where[0] == 7);
    x[3 * 4 + 1] = -0.01; /* the middle: 10 mm under the ground, 40 mm inside the ball */
    x[3 * 0 + 1] = 0.001; /* a corner: above the ground, inside the ball */
    x[3 * 8] = 1;         /* another: away from the ball, 20 mm under the ground */
    x[3 * 8 + 1] = -0.02;
    assert_int_equal(dr_contact_penetrations(contact, x, &deepest, where), 3);
    assert_close(deepest, 0.04, 1e-12);
    assert_memory_equal(where, x + 3 * 4, sizeof where);
    free(x);
    dr_contact_free(contact);
    dr_body_free(body[0]);
    dr_body_free(body[1]);
    dr_mesh_free(mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_contact__flat_cloth_over_a_plane_has_the_closed_form),
        cmocka_unit_test(test_contact__long_triangles_are_sampled_like_short_ones),
        cmocka_unit_test(test_contact__nothing_comes_through_between_the_corners),
        cmocka_unit_test(test_contact__each_body_acts_at_its_own_offset),
        cmocka_unit_test(test_contact__a_second_processor_changes_no_byte),
        cmocka_unit_test(test_contact__what_is_kept_is_of_this_place_and_posture),
        cmocka_unit_test(test_contact__without_bodies_there_is_nothing),
        cmocka_unit_test(test_contact__every_allocation_may_fail),
        cmocka_unit_test(test_contact__evaluation_allocates_nothing),
        cmocka_unit_test(test_contact__the_penalty_is_twice_differentiable),
        cmocka_unit_test(test_contact__gradients_are_derivatives),
        cmocka_unit_test(test_contact__without_curvature_the_hessian_is_exact_for_a_plane),
        cmocka_unit_test(test_contact__with_curvature_the_hessian_is_exact_for_every_body),
        cmocka_unit_test(test_contact__the_hessian_is_positive_semidefinite),
        cmocka_unit_test(test_contact__a_head_on_move_ends_within_depth),
        cmocka_unit_test(test_contact__moves_about_as_long_as_the_distance_are_walked),
        cmocka_unit_test(test_contact__free_moves_are_left_alone),
        cmocka_unit_test(test_contact__nothing_passes_through_a_wire),
        cmocka_unit_test(test_contact__the_clip_keeps_its_word),
        cmocka_unit_test(test_contact__a_node_inside_may_always_leave),
        cmocka_unit_test(test_contact__repeated_clips_never_stick),
        cmocka_unit_test(test_contact__penetrations_are_counted_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
