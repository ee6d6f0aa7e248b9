/* test_body.c - distances against closed forms and brute force; what a body may not be. */
#include "test.h"

#include <time.h>

#include "body.h"
#include "field.h"
#include "scarce.h"
#include "shapes.h"

#define BODY_FILE "../shared/data/bodies/body_f_A.obj"

static const double PI = 3.14159265358979323846;

/* ---- independent formulas -------------------------------------------------------------------- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double norm(const double a[3])
{
    return sqrt(dot(a, a));
}

static void cross(const double a[3], const double b[3], double ret[3])
{
    for (int d = 0; d < 3; d++)
        ret[d] = a[(d + 1) % 3] * b[(d + 2) % 3] - a[(d + 2) % 3] * b[(d + 1) % 3];
}

static void subtract(const double a[3], const double b[3], double ret[3])
{
    for (int d = 0; d < 3; d++)
        ret[d] = a[d] - b[d];
}

static double segment_distance(const double p[3], const double a[3], const double b[3])
{
    double ab[3], ap[3], q[3];
    subtract(b, a, ab);
    subtract(p, a, ap);
    double t = fmin(fmax(dot(ab, ap) / dot(ab, ab), 0), 1);
    for (int d = 0; d < 3; d++)
        q[d] = ap[d] - t * ab[d];
    return norm(q);
}

/* The least of the distances to the edges and, where p projects into the triangle, to its plane. */
static double triangle_distance(const double p[3], const double a[3], const double b[3], const double c[3])
{
    double ab[3], ac[3], n[3], ap[3], least = segment_distance(p, a, b);
    least = fmin(least, fmin(segment_distance(p, b, c), segment_distance(p, c, a)));
    subtract(b, a, ab);
    subtract(c, a, ac);
    subtract(p, a, ap);
    cross(ab, ac, n);
    const double *corner[4] = {a, b, c, a};
    for (int k = 0; k < 3; k++) {
        double edge[3], to[3], side[3];
        subtract(corner[k + 1], corner[k], edge);
        subtract(p, corner[k], to);
        cross(edge, to, side);
        if (dot(side, n) < 0)
            return least;
    }
    return fmin(least, fabs(dot(ap, n)) / norm(n));
}

static double brute_distance(const struct shape *shape, const double p[3])
{
    double least = INFINITY;
    for (size_t t = 0; t < shape->triangles; t++) {
        const uint32_t *k = shape->triangle + 3 * t;
        least = fmin(least, triangle_distance(p, shape->x + 3 * (size_t)k[0], shape->x + 3 * (size_t)k[1],
                                              shape->x + 3 * (size_t)k[2]));
    }
    return least;
}

/* How often the surface winds about p: its solid angle over 4 pi (van Oosterom & Strackee 1983). */
static double winding_number(const struct shape *shape, const double p[3])
{
    double sum = 0;
    for (size_t t = 0; t < shape->triangles; t++) {
        double r[3][3], l[3], bc[3];
        for (int k = 0; k < 3; k++) {
            subtract(shape->x + 3 * (size_t)shape->triangle[3 * t + (size_t)k], p, r[k]);
            l[k] = norm(r[k]);
        }
        cross(r[1], r[2], bc);
        sum += 2 * atan2(dot(r[0], bc), l[0] * l[1] * l[2] + dot(r[0], r[1]) * l[2] + dot(r[1], r[2]) * l[0] +
                                            dot(r[2], r[0]) * l[1]);
    }
    return sum / (4 * PI);
}

/* ---- helpers --------------------------------------------------------------------------------- */

static struct dr_body *make(const drape_body *desc)
{
    struct dr_body *body = NULL;
    drape_error error = {.message = ""};
    if (dr_body_new(desc, 0, &body, &error) != DRAPE_OK)
        print_error("%s\n", error.message);
    assert_non_null(body);
    return body;
}

static struct dr_body *make_shape(const struct shape *shape)
{
    drape_body desc = shape_body(shape);
    return make(&desc);
}

static void random_in_box(uint64_t *seed, const double centre[3], const double half[3], double ret[3])
{
    for (int d = 0; d < 3; d++)
        ret[d] = centre[d] + half[d] * test_random(seed);
}

/* Checks the gradient at x against central differences of the distance; false out of reach. */
static bool gradient_is_derivative(const struct dr_body *body, const double x[3], double step,
                                   double tolerance)
{
    double phi, grad[3];
    if (!dr_body_distance(body, x, &phi, grad))
        return false;
    for (int d = 0; d < 3; d++) {
        double left[3] = {x[0], x[1], x[2]}, right[3] = {x[0], x[1], x[2]}, below, above, unused[3];
        left[d] -= step;
        right[d] += step;
        if (!dr_body_distance(body, left, &below, unused) || !dr_body_distance(body, right, &above, unused))
            return false;
        assert_near((above - below) / (2 * step), grad[d], tolerance, 1);
    }
    return true;
}

/* ---- formulas -------------------------------------------------------------------------------- */

static const drape_body ball = {
    .kind = DRAPE_BODY_SPHERE, .offset = 0.003, .point = {1, 2, 3}, .radius = 0.25};
static const drape_body floor_plane = {
    .kind = DRAPE_BODY_PLANE, .offset = 0.003, .point = {0, 0.5, 0}, .axis = {0, 1e-3, 0}};
static const drape_body limb = {
    .kind = DRAPE_BODY_CAPSULE, .offset = 0.003, .point = {0, 0, 0}, .axis = {0, 0, 2}, .radius = 0.1};

static void check_distance(const drape_body *desc, const double x[3], double expected, const double grad[3])
{
    struct dr_body *body = make(desc);
    double phi, got[3];
    assert_true(dr_body_distance(body, x, &phi, got));
    assert_near(phi, expected, 1e-14, 1);
    for (int d = 0; d < 3; d++)
        assert_near(got[d], grad[d], 1e-13, 1);
    dr_body_free(body);
}

static void test_body__sphere_plane_and_capsule_are_exact(void **state)
{
    (void)state;
    check_distance(&ball, (double[]){1, 2.27, 3}, 0.02, (double[]){0, 1, 0});
    check_distance(&ball, (double[]){1, 2, 2.9}, -0.15, (double[]){0, 0, -1});
    check_distance(&ball, (double[]){1.06, 2.08, 3}, -0.15, (double[]){0.6, 0.8, 0});
    check_distance(&floor_plane, (double[]){7, 0.51, -9}, 0.01, (double[]){0, 1, 0});
    check_distance(&floor_plane, (double[]){7, -4, -9}, -4.5, (double[]){0, 1, 0});
    check_distance(&limb, (double[]){0.12, 0, 1}, 0.02, (double[]){1, 0, 0});
    check_distance(&limb, (double[]){0, -0.03, 0.5}, -0.07, (double[]){0, -1, 0});
    check_distance(&limb, (double[]){0.06, 0, 2.08}, 0, (double[]){0.6, 0, 0.8});
    check_distance(&limb, (double[]){0, 0, -0.11}, 0.01, (double[]){0, 0, -1});
}

static void test_body__a_capsule_of_no_length_is_a_sphere(void **state)
{
    (void)state;
    drape_body dot_limb = limb;
    dot_limb.axis[2] = 0;
    check_distance(&dot_limb, (double[]){0.06, 0.08, 0}, 0, (double[]){0.6, 0.8, 0});
}

static void test_body__gradients_of_formulas_are_derivatives(void **state)
{
    (void)state;
    const drape_body *desc[] = {&ball, &floor_plane, &limb};
    uint64_t seed = 11;
    for (int k = 0; k < 3; k++) {
        struct dr_body *body = make(desc[k]);
        int checked = 0;
        for (int i = 0; i < 1000; i++) {
            double x[3];
            random_in_box(&seed, desc[k]->point, (double[]){0.2, 0.2, 0.2}, x);
            checked += gradient_is_derivative(body, x, 1e-6, 1e-6);
        }
        assert_in_range(checked, 200, 1000);
        dr_body_free(body);
    }
}

/* Checks the curvature at x against central differences of the gradient; false out of reach. */
static bool curvature_is_derivative(const struct dr_body *body, const double x[3], double step,
                                    double tolerance)
{
    static const int entry[3][3] = {{0, 1, 3}, {1, 2, 4}, {3, 4, 5}};
    double unused, here[3], bent[6];
    if (!dr_body_distance(body, x, &unused, here))
        return false;
    dr_body_curvature(body, x, bent);
    for (int d = 0; d < 3; d++) {
        double left[3] = {x[0], x[1], x[2]}, right[3] = {x[0], x[1], x[2]}, below[3], above[3];
        left[d] -= step;
        right[d] += step;
        if (!dr_body_distance(body, left, &unused, below) || !dr_body_distance(body, right, &unused, above))
            return false;
        for (int i = 0; i < 3; i++)
            assert_near((above[i] - below[i]) / (2 * step), bent[entry[i][d]], tolerance, 1);
    }
    return true;
}

static void test_body__curvatures_are_derivatives(void **state)
{
    (void)state;
    const double middle[3] = {0.05, 0.03, 0.9}, cap[3] = {0.04, 0.03, -0.06};
    const struct {
        const drape_body *desc;
        const double *centre;
    } where[] = {{&ball, ball.point}, {&floor_plane, floor_plane.point}, {&limb, middle}, {&limb, cap}};
    uint64_t seed = 13;
    for (int k = 0; k < 4; k++) {
        struct dr_body *body = make(where[k].desc);
        double half = k < 2 ? 0.2 : 0.025; /* clear of the axis, and of where the cap begins */
        int checked = 0;
        for (int i = 0; i < 1000; i++) {
            double x[3];
            random_in_box(&seed, where[k].centre, (double[]){half, half, half}, x);
            double r[3];
            subtract(x, where[k].centre, r);
            if (where[k].desc == &ball && norm(r) < 0.05)
                continue; /* 1/r changes too fast for differences */
            checked += curvature_is_derivative(body, x, 1e-6, 1e-4);
        }
        assert_in_range(checked, 200, 1000);
        dr_body_free(body);
    }
}

static void test_body__a_mesh_curvature_is_the_derivative(void **state)
{
    (void)state;
    struct shape box = shape_box((double[]){-0.05, -0.04, -0.03}, (double[]){0.05, 0.04, 0.03});
    struct dr_body *body = make_shape(&box);
    uint64_t seed = 23;
    int checked = 0;
    for (int i = 0; i < 3000; i++) {
        double x[3], phi, grad[3];
        random_in_box(&seed, (double[]){0, 0, 0}, (double[]){0.08, 0.07, 0.06}, x);
        if (!dr_body_distance(body, x, &phi, grad) || (phi < 0 && norm(grad) < 0.02))
            continue; /* on the medial axis the gradient may be the stand-in */
        checked += curvature_is_derivative(body, x, 1e-6, 1e-2); /* of 250/m; it is only C0 between cells */
    }
    assert_in_range(checked, 1000, 3000);
    dr_body_free(body);
    shape_free(&box);
}

static void test_body__centre_and_axis_have_a_unit_gradient(void **state)
{
    (void)state;
    const double centre[3] = {1, 2, 3}, on_axis[3] = {0, 0, 0.7};
    double phi, grad[3];
    struct dr_body *body = make(&ball);
    assert_true(dr_body_distance(body, centre, &phi, grad));
    assert_close(phi, -0.25, 1e-15);
    assert_close(norm(grad), 1, 1e-15);
    dr_body_free(body);
    body = make(&limb);
    assert_true(dr_body_distance(body, on_axis, &phi, grad));
    assert_close(phi, -0.1, 1e-15);
    assert_close(norm(grad), 1, 1e-15);
    assert_true(grad[2] == 0); /* along the axis there is no way out */
    dr_body_free(body);
}

static void check_out_of_reach(const struct dr_body *body, const double x[3])
{
    double phi = 7, grad[3] = {8, 9, 10};
    assert_false(dr_body_distance(body, x, &phi, grad));
    assert_true(phi == 7 && grad[0] == 8 && grad[1] == 9 && grad[2] == 10);
}

static void test_body__out_of_reach_leaves_the_results_alone(void **state)
{
    (void)state;
    struct shape sphere = shape_sphere((double[]){0, 0, 0}, 0.05, 8);
    drape_body mesh = shape_body(&sphere);
    const drape_body *desc[] = {&ball, &floor_plane, &limb, &mesh};
    for (int k = 0; k < 4; k++) {
        struct dr_body *body = make(desc[k]);
        check_out_of_reach(body, (double[]){9, 9, 9});
        check_out_of_reach(body, (double[]){NAN, 0, 0});
        check_out_of_reach(body, (double[]){0, INFINITY, 0});
        check_out_of_reach(body, (double[]){0, 1e300, 0});
        dr_body_free(body);
    }
    struct dr_body *body = make(&ball);
    double phi, grad[3];
    assert_true(dr_body_distance(body, (double[]){1, 2, 3.2799}, &phi, grad));
    check_out_of_reach(body, (double[]){1, 2, 3.2801});
    dr_body_free(body);
    shape_free(&sphere);
}

static void test_body__support_is_the_lowest_point(void **state)
{
    (void)state;
    const double up[3] = {0, 2, 0}, down[3] = {0, -2, 0}, lean[3] = {0.6, 0, 0.8};
    struct shape box = shape_box((double[]){-1, -2, -3}, (double[]){1, 2, 3});
    struct dr_body *body = make(&ball);
    assert_close(dr_body_support_min(body, up), 2 * 1.75, 1e-15);
    dr_body_free(body);
    body = make(&limb);
    assert_close(dr_body_support_min(body, lean), -0.1, 1e-15);
    assert_close(dr_body_support_min(body, (double[]){0, 0, -1}), -2.1, 1e-15);
    dr_body_free(body);
    body = make(&floor_plane);
    assert_true(dr_body_support_min(body, up) == -INFINITY);
    assert_true(dr_body_support_min(body, lean) == -INFINITY);
    assert_close(dr_body_support_min(body, down), -1, 1e-15);
    dr_body_free(body);
    body = NULL;
    drape_body desc = shape_body(&box);
    desc.offset = 0.002;
    struct shape small = shape_box((double[]){-0.1, -0.2, -0.3}, (double[]){0.1, 0.2, 0.3});
    desc.positions = small.x;
    body = make(&desc);
    assert_close(dr_body_support_min(body, lean), -0.06 - 0.24, 1e-14);
    assert_close(dr_body_offset(body), 0.002, 0);
    dr_body_free(body);
    shape_free(&box);
    shape_free(&small);
}

/* ---- meshes ---------------------------------------------------------------------------------- */

static void test_body__a_mesh_sphere_matches_the_sphere(void **state)
{
    (void)state;
    const double centre[3] = {0.3, -0.2, 0.1}, radius = 0.1, half[3] = {0.13, 0.13, 0.13};
    struct shape sphere = shape_sphere(centre, radius, 60);
    struct dr_body *body = make_shape(&sphere);
    uint64_t seed = 5;
    double near = 0, far = 0;
    int checked = 0;
    for (int i = 0; i < 10000; i++) {
        double x[3], r[3], phi, grad[3];
        random_in_box(&seed, centre, half, x);
        subtract(x, centre, r);
        double rho = norm(r), exact = rho - radius;
        bool within = dr_body_distance(body, x, &phi, grad);
        if (exact > DR_BODY_REACH + 1e-4)
            assert_false(within);
        if (exact > DR_BODY_REACH - DR_FIELD_FINEST / 10 || rho < 0.03)
            continue; /* the limit itself; and the centre, where the spline rounds the tip of the cone */
        assert_true(within);
        /* The facets lie below the sphere by up to edge^2/(8 R), 0.02 mm along the diagonals. Away from the
         * surface the spline adds up to h^2/6 times the Laplacian 2/rho. */
        double error = phi - exact, smoothed = DR_FIELD_FINEST * DR_FIELD_FINEST / (3 * rho);
        if (fabs(exact) < 0.004)
            near = fmax(near, fabs(error));
        far = fmax(far, fmax(error - smoothed, -error));
        double off = fabs(exact) < 0.015 ? 0.01 : 0.05; /* of the gradient's length and direction */
        assert_true(dot(grad, r) / rho > 1 - off && norm(grad) < 1 + off);
        checked++;
    }
    print_message("mesh sphere: worst error %.3g mm near the surface, %.3g mm elsewhere, %d points\n",
                  1e3 * near, 1e3 * far, checked);
    assert_in_range(checked, 3000, 10000);
    assert_true(near < 3e-5 && far < DR_FIELD_FINEST / 15);
    dr_body_free(body);
    shape_free(&sphere);
}

/* With the distances themselves as the spline's coefficients the first two shrink by 0.91 and 0.56 mm, and a
 * shirt went through such a tip. */
static void test_body__small_parts_keep_their_size(void **state)
{
    (void)state;
    const double radius[] = {0.006, 0.01, 0.02};
    for (int i = 0; i < 3; i++) {
        struct shape tip = shape_sphere((double[]){0.0011, 0.0007, 0.0023}, radius[i], 16);
        struct dr_body *body = make_shape(&tip);
        double worst = 0, phi, grad[3];
        for (size_t v = 0; v < tip.vertices; v++) {
            assert_true(dr_body_distance(body, tip.x + 3 * v, &phi, grad));
            worst = fmax(worst, fabs(phi));
        }
        print_message("ball of %g mm: surface off by up to %.3f mm\n", 1e3 * radius[i], 1e3 * worst);
        assert_true(worst < 1e-4);
        dr_body_free(body);
        shape_free(&tip);
    }
}

static void test_body__a_mesh_far_from_the_origin_loses_nothing(void **state)
{
    (void)state;
    struct shape here = shape_sphere((double[]){0, 0, 0}, 0.08, 12),
                 there = shape_sphere((double[]){0, 0, 0}, 0.08, 12);
    for (size_t i = 0; i < 3 * there.vertices; i++)
        there.x[i] += 1024;
    struct dr_body *near = make_shape(&here), *far = make_shape(&there);
    uint64_t seed = 3;
    int checked = 0;
    for (int i = 0; i < 1000; i++) {
        double x[3], phi, grad[3], phi_far, grad_far[3];
        random_in_box(&seed, (double[]){0, 0, 0}, (double[]){0.1, 0.1, 0.1}, x);
        if (!dr_body_distance(near, x, &phi, grad) || phi > 0.029)
            continue;
        for (int d = 0; d < 3; d++)
            x[d] += 1024;
        assert_true(dr_body_distance(far, x, &phi_far, grad_far));
        assert_near(phi, phi_far, 1e-9, 1);
        checked++;
    }
    assert_in_range(checked, 500, 1000);
    dr_body_free(near);
    dr_body_free(far);
    shape_free(&here);
    shape_free(&there);
}

/* Second differences of phi along a line: the largest jump between neighbours, and the largest. */
static void test_body__a_mesh_field_is_twice_differentiable(void **state)
{
    (void)state;
    struct shape sphere = shape_sphere((double[]){0, 0, 0}, 0.06, 20);
    struct dr_body *body = make_shape(&sphere);
    const double step = 1e-5; /* 400 to a node spacing: every kind of cell boundary is passed */
    double last = 0, jump = 0, largest = 0, before[3] = {0, 0, 0};
    for (int i = 0; i < 4000; i++) {
        double x[3] = {-0.02 + step * i, 0.0631 - 0.1 * step * i, 0.011 + 0.3 * step * i}, phi, grad[3];
        assert_true(dr_body_distance(body, x, &phi, grad));
        double curvature = (grad[0] - before[0]) / step;
        if (i > 1)
            jump = fmax(jump, fabs(curvature - last));
        if (i > 0)
            largest = fmax(largest, fabs(curvature));
        last = curvature;
        memcpy(before, grad, sizeof before);
    }
    print_message("curvature up to %.3g /m, jumps up to %.3g /m between points 10 um apart\n", largest, jump);
    assert_true(largest > 5); /* about 1/R = 16.7 */
    /* A C1 field would jump by as much as the curvature itself; here a third derivative of up to
     * about curvature/spacing = 4000/m^2, times the step. */
    assert_true(jump < 0.01 * largest);
    dr_body_free(body);
    shape_free(&sphere);
}

/* A scene that shares a field has the distances and the bytes of one that builds its own. */
static void test_body__bodies_share_a_field_until_the_last_gives_it_back(void **state)
{
    (void)state;
    struct shape box = shape_box((double[]){-0.05, -0.04, -0.03}, (double[]){0.05, 0.04, 0.03});
    drape_body desc = shape_body(&box);
    struct dr_body *own = make_shape(&box), *first = NULL, *second = NULL;
    drape_field *field = NULL;
    assert_int_equal(drape_field_new(&desc, 0, NULL, &field, NULL), DRAPE_OK);
    assert_true(drape_field_bytes(field) > 100000);
    desc.field = field;
    assert_int_equal(dr_body_new(&desc, 0, &first, NULL), DRAPE_OK);
    assert_int_equal(dr_body_new(&desc, 0, &second, NULL), DRAPE_OK);
    assert_int_equal(atomic_load(&field->references), 3);
    assert_null(drape_field_unref(field)); /* the bodies have theirs */
    dr_body_free(first);
    assert_true(dr_body_bytes(second) == dr_body_bytes(own));
    uint64_t seed = 3;
    for (int i = 0; i < 1000; i++) {
        double x[3], phi[2] = {0}, grad[2][3] = {{0}};
        random_in_box(&seed, (double[]){0, 0, 0}, (double[]){0.08, 0.07, 0.06}, x);
        assert_int_equal(dr_body_distance(own, x, phi, grad[0]),
                         dr_body_distance(second, x, phi + 1, grad[1]));
        assert_true(phi[0] == phi[1]);
        assert_memory_equal(grad[0], grad[1], sizeof grad[0]);
    }
    assert_int_equal(atomic_load(&field->references), 1);
    dr_body_free(second);
    dr_body_free(own);
    shape_free(&box);
}

static void test_body__a_field_of_an_open_mesh_is_refused(void **state)
{
    (void)state;
    struct shape box = shape_box((double[]){-0.05, -0.04, -0.03}, (double[]){0.05, 0.04, 0.03});
    drape_body desc = shape_body(&box);
    drape_field *field = NULL;
    drape_error error;
    desc.triangles--;
    assert_int_equal(drape_field_new(&desc, 2, NULL, &field, &error), DRAPE_EINVAL);
    assert_null(field);
    assert_int_equal(error.place, DRAPE_AT_BODY_TRIANGLE);
    assert_int_equal(error.body, 2);
    assert_null(drape_field_unref(NULL));
    shape_free(&box);
}

static void test_body__a_mesh_gradient_is_the_derivative(void **state)
{
    (void)state;
    struct shape box = shape_box((double[]){-0.05, -0.04, -0.03}, (double[]){0.05, 0.04, 0.03});
    struct dr_body *body = make_shape(&box);
    uint64_t seed = 17;
    int checked = 0;
    for (int i = 0; i < 3000; i++) {
        double x[3], phi, grad[3];
        random_in_box(&seed, (double[]){0, 0, 0}, (double[]){0.08, 0.07, 0.06}, x);
        if (!dr_body_distance(body, x, &phi, grad) || (phi < 0 && norm(grad) < 0.02))
            continue; /* on the medial axis the gradient may be the stand-in */
        checked += gradient_is_derivative(body, x, 1e-6, 1e-6);
    }
    assert_in_range(checked, 1000, 3000);
    dr_body_free(body);
    shape_free(&box);
}

/* Follows the gradient in steps of 1 mm; true when it comes out. */
static bool comes_out(const struct dr_body *body, const double start[3])
{
    double x[3] = {start[0], start[1], start[2]}, phi = -1, grad[3];
    for (int i = 0; i < 2000 && phi < 0; i++) {
        if (!dr_body_distance(body, x, &phi, grad))
            return true;
        double length = norm(grad);
        assert_true(length > 1e-3);
        for (int d = 0; d < 3; d++)
            x[d] += 1e-3 * grad[d] / length;
    }
    return phi >= 0;
}

static void test_body__a_symmetric_centre_has_a_gradient(void **state)
{
    (void)state;
    struct shape box = shape_box((double[]){-0.05, -0.05, -0.05}, (double[]){0.05, 0.05, 0.05});
    struct dr_body *body = make_shape(&box);
    double lowest[3] = {0, 0, 0}, phi = 0, grad[3] = {0.5, 0, 0};
    /* Down the gradient to the deepest point, where the exact gradient vanishes and a unit vector replaces
     * it. */
    for (int i = 0; i < 20000 && fabs(norm(grad) - 1) > 1e-12; i++) {
        for (int d = 0; i > 0 && d < 3; d++)
            lowest[d] -= 1e-6 * grad[d];
        assert_true(dr_body_distance(body, lowest, &phi, grad));
    }
    assert_true(phi < -0.04);
    assert_close(norm(grad), 1, 1e-12);
    assert_true(comes_out(body, lowest));
    dr_body_free(body);
    shape_free(&box);
}

static void test_body__pieces_that_overlap_are_inside_and_a_cavity_is_outside(void **state)
{
    (void)state;
    struct shape pair = shape_join(shape_sphere((double[]){0, 0, 0}, 0.05, 12),
                                   shape_sphere((double[]){0.06, 0, 0}, 0.05, 12));
    struct dr_body *body = make_shape(&pair);
    uint64_t seed = 23;
    int inside = 0;
    for (int i = 0; i < 4000; i++) {
        double x[3], phi = 1, grad[3];
        random_in_box(&seed, (double[]){0.03, 0, 0}, (double[]){0.1, 0.07, 0.07}, x);
        double a = norm(x), b = norm((double[]){x[0] - 0.06, x[1], x[2]});
        dr_body_distance(body, x, &phi, grad);
        /* Right next to a hidden piece of surface the distance is small, and the spline may lift it
         * above zero; but never where cloth comes in from outside. */
        if (fmin(a, b) > 0.0505)
            assert_true(phi > 0);
        if (fmin(a, b) < 0.0495 && fabs(a - 0.05) > 0.003 && fabs(b - 0.05) > 0.003) {
            assert_true(phi < 0);
            inside++;
        }
    }
    assert_in_range(inside, 200, 4000);
    dr_body_free(body);
    shape_free(&pair);

    struct shape hollow = shape_sphere((double[]){0, 0, 0}, 0.02, 12);
    shape_reverse(&hollow);
    hollow = shape_join(shape_sphere((double[]){0, 0, 0}, 0.05, 12), hollow);
    body = make_shape(&hollow);
    double phi, grad[3];
    assert_true(dr_body_distance(body, (double[]){0.015, 0, 0}, &phi, grad));
    assert_near(phi, 0.005, 1e-3, 1);
    assert_true(dr_body_distance(body, (double[]){0, 0.042, 0}, &phi, grad));
    assert_near(phi, -0.008, 1e-3, 1);
    dr_body_free(body);
    shape_free(&hollow);
}

static void test_body__a_sheet_thinner_than_the_grid_is_never_inverted(void **state)
{
    (void)state;
    struct shape sheet = shape_box((double[]){-0.1, -0.1, -0.0005}, (double[]){0.1, 0.1, 0.0005});
    struct dr_body *body = make_shape(&sheet);
    uint64_t seed = 31;
    for (int i = 0; i < 4000; i++) {
        double x[3], phi, grad[3];
        random_in_box(&seed, (double[]){0, 0, 0}, (double[]){0.09, 0.09, 0.02}, x);
        assert_true(dr_body_distance(body, x, &phi, grad));
        if (fabs(x[2]) > 0.012) { /* three spacings off, distances are as they should be, and point away */
            assert_near(phi, fabs(x[2]) - 0.0005, 1e-5, 1);
            assert_true(grad[2] * x[2] > 0.99 * fabs(x[2]));
        }
    }
    dr_body_free(body);
    shape_free(&sheet);
}

static void test_body__large_meshes_take_a_wider_grid_or_are_refused(void **state)
{
    (void)state;
    struct shape slab = shape_box((double[]){-5, -0.1, -5}, (double[]){5, 0, 5});
    struct dr_body *body = make_shape(&slab);
    double phi, grad[3];
    assert_true(dr_body_distance(body, (double[]){2.3, 0.01, -4.1}, &phi, grad));
    assert_near(phi, 0.01, 1e-6, 1);
    assert_near(grad[1], 1, 1e-6, 1);
    assert_true(dr_body_bytes(body) < 90u << 20);
    dr_body_free(body);
    shape_free(&slab);

    struct shape huge = shape_box((double[]){-50, -50, -50}, (double[]){50, 50, 50});
    drape_body desc = shape_body(&huge);
    drape_error error;
    body = NULL;
    assert_int_equal(dr_body_check(&desc, 4, &error), DRAPE_OK);
    assert_int_equal(dr_body_new(&desc, 4, &body, &error), DRAPE_EINVAL);
    assert_null(body);
    assert_int_equal(error.place, DRAPE_AT_BODY);
    assert_int_equal(error.element, 4);
    print_message("refused: %s\n", error.message);
    shape_free(&huge);
}

/* ---- refusals -------------------------------------------------------------------------------- */

static void check_refusal(const drape_body *desc, drape_place place, int64_t element, const char *member)
{
    drape_error error = {.status = DRAPE_OK};
    struct dr_body *body = NULL;
    assert_int_equal(dr_body_check(desc, 2, NULL), DRAPE_EINVAL);
    assert_int_equal(dr_body_new(desc, 2, &body, &error), DRAPE_EINVAL);
    assert_null(body);
    assert_int_equal(error.status, DRAPE_EINVAL);
    assert_int_equal(error.place, place);
    assert_int_equal(error.element, element);
    assert_int_equal(error.body, 2);
    if (member)
        assert_string_equal(error.member, member);
    assert_true(strlen(error.message) > 0);
}

static void test_body__refuses_bad_shapes_by_member(void **state)
{
    (void)state;
    static const double bad_offset[] = {0, -0.001, NAN, INFINITY, 0.0201};
    static const double bad_radius[] = {0, -1, NAN, INFINITY, 1.1e6};
    drape_body desc = ball;
    for (int i = 0; i < 5; i++) {
        desc = ball;
        desc.offset = bad_offset[i];
        check_refusal(&desc, DRAPE_AT_BODY, 2, "offset");
        desc = limb;
        desc.radius = bad_radius[i];
        check_refusal(&desc, DRAPE_AT_BODY, 2, "radius");
    }
    desc = ball;
    desc.offset = DR_BODY_MAX_OFFSET;
    assert_int_equal(dr_body_check(&desc, 0, NULL), DRAPE_OK);
    desc.point[1] = NAN;
    check_refusal(&desc, DRAPE_AT_BODY, 2, "point");
    desc = limb;
    desc.axis[0] = INFINITY;
    check_refusal(&desc, DRAPE_AT_BODY, 2, "axis");
    desc = floor_plane;
    desc.axis[1] = 0;
    check_refusal(&desc, DRAPE_AT_BODY, 2, "axis");
    desc.axis[1] = 1e-300; /* short, but a direction */
    check_distance(&desc, (double[]){0, 0.5, 0}, 0, (double[]){0, 1, 0});
    desc.kind = (drape_body_kind)99;
    check_refusal(&desc, DRAPE_AT_BODY, 2, "kind");
}

static void test_body__refuses_meshes_that_enclose_nothing(void **state)
{
    (void)state;
    struct shape box = shape_box((double[]){0, 0, 0}, (double[]){0.1, 0.1, 0.1});
    drape_body desc = shape_body(&box);
    assert_int_equal(dr_body_check(&desc, 2, NULL), DRAPE_OK);

    desc.triangles = 11; /* the last triangle, 1 7 5, leaves a hole, whose edge 1-5 is triangle 4's */
    check_refusal(&desc, DRAPE_AT_BODY_TRIANGLE, 4, NULL);
    desc.triangles = 3;
    check_refusal(&desc, DRAPE_AT_BODY, 2, "triangles");
    desc = shape_body(&box);
    desc.positions = NULL;
    check_refusal(&desc, DRAPE_AT_BODY, 2, NULL);

    desc = shape_body(&box);
    shape_reverse(&box);
    check_refusal(&desc, DRAPE_AT_BODY, 2, "triangle");
    shape_reverse(&box);

    uint32_t *last = box.triangle + 33, kept = last[0];
    last[0] = 8;
    check_refusal(&desc, DRAPE_AT_BODY_TRIANGLE, 11, NULL);
    last[0] = last[1];
    check_refusal(&desc, DRAPE_AT_BODY_TRIANGLE, 11, NULL);
    last[0] = kept;
    uint32_t swap = last[1]; /* one triangle turned over: its neighbours disagree */
    last[1] = last[2];
    last[2] = swap;
    check_refusal(&desc, DRAPE_AT_BODY_TRIANGLE, 11, NULL);
    last[2] = last[1];
    last[1] = swap;

    box.x[3 * 6 + 1] = NAN;
    check_refusal(&desc, DRAPE_AT_BODY_VERTEX, 6, NULL);
    box.x[3 * 6 + 1] = 2e6;
    check_refusal(&desc, DRAPE_AT_BODY_VERTEX, 6, NULL);
    shape_free(&box);
}

static void test_body__refuses_an_edge_of_four_triangles(void **state)
{
    (void)state;
    struct shape pair = shape_join(shape_box((double[]){0, 0, 0}, (double[]){0.1, 0.1, 0.1}),
                                   shape_box((double[]){0.1, 0.1, 0}, (double[]){0.2, 0.2, 0.1}));
    drape_body desc = shape_body(&pair);
    assert_int_equal(dr_body_check(&desc, 2, NULL), DRAPE_OK);
    for (size_t i = 3 * 12; i < 3 * pair.triangles; i++) { /* weld the boxes along their common edge */
        if (pair.triangle[i] == 8)
            pair.triangle[i] = 3;
        if (pair.triangle[i] == 12)
            pair.triangle[i] = 7;
    }
    drape_error error;
    assert_int_equal(dr_body_check(&desc, 2, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, DRAPE_AT_BODY_TRIANGLE);
    assert_true(error.element >= 12);
    assert_non_null(strstr(error.message, "3-7"));
    shape_free(&pair);
}

/* ---- memory ---------------------------------------------------------------------------------- */

static void test_body__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct shape sphere = shape_sphere((double[]){0, 0, 0}, 0.03, 8);
    drape_body desc = shape_body(&sphere);
    int failures = 0;
    for (long n = 0;; n++) {
        struct dr_body *body = NULL;
        drape_error error = {.status = DRAPE_OK};
        long before = held;
        countdown = n;
        drape_status status = dr_body_new(&desc, 0, &body, &error);
        bool reached = countdown < 0;
        countdown = -1;
        if (status < 0) {
            assert_int_equal(status, DRAPE_ENOMEM);
            assert_int_equal(error.status, DRAPE_ENOMEM);
            assert_null(body);
            failures++;
        }
        dr_body_free(body);
        assert_int_equal(held, before);
        if (!reached)
            break;
    }
    print_message("%d allocations failed in turn\n", failures);
    assert_in_range(failures, 10, 1000);
    shape_free(&sphere);
#else
    print_message("SKIP: allocations cannot be made to fail in this flavour\n");
#endif
}

/* ---- a person -------------------------------------------------------------------------------- */

struct person {
    struct shape shape;
    struct dr_body *body;
};

static int load_person(void **state)
{
    static struct person person;
    *state = NULL;
    if (!shape_read(BODY_FILE, &person.shape))
        return 0;
    struct timespec from, to;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
    person.body = make_shape(&person.shape);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
    print_message("%zu triangles: built in %.2f s of processor time, %zu bytes\n", person.shape.triangles,
                  (double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec),
                  dr_body_bytes(person.body));
    *state = &person;
    return 0;
}

static int drop_person(void **state)
{
    struct person *person = *state;
    if (person) {
        dr_body_free(person->body);
        shape_free(&person->shape);
    }
    return 0;
}

static struct person *person_or_skip(void **state)
{
    if (!*state)
        print_message("SKIP: no body to test with\n");
    return *state;
}

/* A random vertex moved by up to `spread` along each axis. */
static void random_near(const struct shape *shape, uint64_t *seed, double spread, double ret[3])
{
    size_t v = (size_t)((test_random(seed) + 1) / 2 * (double)shape->vertices) % shape->vertices;
    random_in_box(seed, shape->x + 3 * v, (double[]){spread, spread, spread}, ret);
}

static void test_body__a_person_has_the_right_signs(void **state)
{
    struct person *person = person_or_skip(state);
    if (!person)
        return;
    uint64_t seed = 41;
    int checked = 0, inside = 0, wrong = 0, wrong_above = 0;
    while (checked < 500) {
        double x[3], phi = DR_BODY_REACH, grad[3];
        random_near(&person->shape, &seed, checked % 2 ? 0.01 : 0.05, x);
        if (brute_distance(&person->shape, x) < 0.002)
            continue;
        bool is_inside = winding_number(&person->shape, x) > 0.5;
        dr_body_distance(person->body, x, &phi, grad);
        checked++;
        inside += is_inside;
        if ((phi < 0) != is_inside) {
            wrong++;
            wrong_above += x[1] > 0.05; /* the toes, where the mesh crosses itself, are below */
        }
    }
    print_message("%d points farther than 2 mm, %d inside: %d signs differ, %d of them above the toes\n",
                  checked, inside, wrong, wrong_above);
    assert_in_range(inside, 80, 420);
    assert_int_equal(wrong_above, 0);
    assert_in_range(wrong, 0, 10);
}

static int compare_doubles(const void *left, const void *right)
{
    double a = *(const double *)left, b = *(const double *)right;
    return a < b ? -1 : a > b;
}

static void test_body__a_person_has_the_right_distances(void **state)
{
    struct person *person = person_or_skip(state);
    if (!person)
        return;
    enum { POINTS = 400 };
    static double error[POINTS];
    uint64_t seed = 43;
    double worst_deep = 0;
    for (int i = 0; i < POINTS;) {
        double x[3], phi, grad[3];
        random_near(&person->shape, &seed, 0.02, x);
        bool where_cloth_lies = x[1] > 0.15 && x[1] < 1.4 && fabs(x[0]) < 0.35; /* no hands, feet, face */
        if (!where_cloth_lies || !dr_body_distance(person->body, x, &phi, grad))
            continue;
        error[i] = fabs(fabs(phi) - brute_distance(&person->shape, x));
        if (phi < -0.02)
            worst_deep = fmax(worst_deep, error[i]);
        i++;
    }
    qsort(error, POINTS, sizeof *error, compare_doubles);
    print_message(
        "distance error: median %.3g, 90%% %.3g, 99%% %.3g, worst %.3g mm; worst deeper than 20 mm %.3g mm\n",
        1e3 * error[POINTS / 2], 1e3 * error[POINTS * 9 / 10], 1e3 * error[POINTS * 99 / 100],
        1e3 * error[POINTS - 1], 1e3 * worst_deep);
    /* Smoothing, mostly far from the surface, by h^2/6 times the sum of curvatures: 0.05 mm on limbs of 5 cm,
     * more at fingers, toes and on the medial axis, at most about half a spacing. */
    assert_true(error[POINTS / 2] < 5e-5);
    assert_true(error[POINTS * 9 / 10] < 2e-4);
    assert_true(error[POINTS - 1] < DR_FIELD_FINEST);
}

static void test_body__from_anywhere_in_a_person_the_gradient_leads_out(void **state)
{
    struct person *person = person_or_skip(state);
    if (!person)
        return;
    uint64_t seed = 47;
    int checked = 0, out = 0;
    while (checked < 2000) {
        double x[3], phi = 1, grad[3];
        random_near(&person->shape, &seed, 0.15, x);
        if (!dr_body_distance(person->body, x, &phi, grad) || phi >= 0)
            continue;
        checked++;
        out += comes_out(person->body, x);
    }
    print_message("%d of %d points inside came out\n", out, checked);
    assert_int_equal(out, checked);
}

static void test_body__a_person_has_exact_gradients_and_the_same_bytes_twice(void **state)
{
    struct person *person = person_or_skip(state);
    if (!person)
        return;
    struct dr_body *again = make_shape(&person->shape);
    uint64_t seed = 53;
    int checked = 0;
    for (int i = 0; i < 2000; i++) {
        double x[3], phi, grad[3], phi_again = 0, grad_again[3];
        random_near(&person->shape, &seed, 0.03, x);
        bool within = dr_body_distance(person->body, x, &phi, grad);
        assert_int_equal(within, dr_body_distance(again, x, &phi_again, grad_again));
        if (!within)
            continue;
        assert_memory_equal(&phi, &phi_again, sizeof phi);
        assert_memory_equal(grad, grad_again, sizeof grad);
        if (phi > 0 || norm(grad) > 0.02)
            checked += gradient_is_derivative(person->body, x, 1e-6, 1e-6);
    }
    assert_in_range(checked, 500, 2000);
    dr_body_free(again);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_body__sphere_plane_and_capsule_are_exact),
        cmocka_unit_test(test_body__a_capsule_of_no_length_is_a_sphere),
        cmocka_unit_test(test_body__gradients_of_formulas_are_derivatives),
        cmocka_unit_test(test_body__curvatures_are_derivatives),
        cmocka_unit_test(test_body__a_mesh_curvature_is_the_derivative),
        cmocka_unit_test(test_body__centre_and_axis_have_a_unit_gradient),
        cmocka_unit_test(test_body__out_of_reach_leaves_the_results_alone),
        cmocka_unit_test(test_body__support_is_the_lowest_point),
        cmocka_unit_test(test_body__a_mesh_sphere_matches_the_sphere),
        cmocka_unit_test(test_body__small_parts_keep_their_size),
        cmocka_unit_test(test_body__a_mesh_far_from_the_origin_loses_nothing),
        cmocka_unit_test(test_body__a_mesh_field_is_twice_differentiable),
        cmocka_unit_test(test_body__bodies_share_a_field_until_the_last_gives_it_back),
        cmocka_unit_test(test_body__a_field_of_an_open_mesh_is_refused),
        cmocka_unit_test(test_body__a_mesh_gradient_is_the_derivative),
        cmocka_unit_test(test_body__a_symmetric_centre_has_a_gradient),
        cmocka_unit_test(test_body__pieces_that_overlap_are_inside_and_a_cavity_is_outside),
        cmocka_unit_test(test_body__a_sheet_thinner_than_the_grid_is_never_inverted),
        cmocka_unit_test(test_body__large_meshes_take_a_wider_grid_or_are_refused),
        cmocka_unit_test(test_body__refuses_bad_shapes_by_member),
        cmocka_unit_test(test_body__refuses_meshes_that_enclose_nothing),
        cmocka_unit_test(test_body__refuses_an_edge_of_four_triangles),
        cmocka_unit_test(test_body__every_allocation_may_fail),
    };
    const struct CMUnitTest person[] = {
        cmocka_unit_test(test_body__a_person_has_the_right_signs),
        cmocka_unit_test(test_body__a_person_has_the_right_distances),
        cmocka_unit_test(test_body__from_anywhere_in_a_person_the_gradient_leads_out),
        cmocka_unit_test(test_body__a_person_has_exact_gradients_and_the_same_bytes_twice),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    return failed + cmocka_run_group_tests(person, load_person, drop_person);
}
