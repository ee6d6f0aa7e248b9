/* test_curve.c - strain-stress curves against closed forms, differences and quadrature. */
#include "test.h"

#include "curve.h"

/* Shaped like a woven cloth under a tensile tester: crimp first, then the yarns. */
static const double WOVEN[] = {0, 0, 0.01, 4, 0.03, 22, 0.04, 25, 0.05, 90, 0.051, 90, 0.06, 260};

static struct dr_curve *make(const double *point, size_t points)
{
    drape_curve curve = {points, point};
    drape_error error;
    if (dr_curve_check(&curve, 0, "stretch_weft", &error) < 0)
        fail_msg("%s", error.message);
    struct dr_curve *made = dr_curve_new(&curve);
    assert_non_null(made);
    return made;
}

#define MAKE(array) make(array, sizeof(array) / sizeof *(array) / 2)

static void test_curve__one_point_is_a_straight_line(void **state)
{
    (void)state;
    const double point[] = {0.2, 30};
    struct dr_curve *curve = MAKE(point);
    assert_close(dr_curve_rest_slope(curve), 150, 1e-15);
    for (double x = 0; x < 2; x += 0.05) {
        struct dr_curve_value at = dr_curve_at(curve, x);
        assert_near(at.stress, 150 * x, 1e-15, 30);
        assert_near(at.slope, 150, 1e-14, 0);
        assert_near(at.work, 75 * x * x, 1e-15, 3);
    }
    dr_curve_free(curve);
}

static void test_curve__slope_of_an_inner_knot_is_the_weighted_harmonic_mean(void **state)
{
    (void)state;
    /* Steps 1 and 2 long with slopes 2 and 6: weights 1 + 2*2 and 2*1 + 2 give 9/(5/2 + 4/6) = 54/19. */
    const double point[] = {1, 2, 3, 14};
    struct dr_curve *curve = MAKE(point);
    const double m = 54.0 / 19;
    struct dr_curve_value at = dr_curve_at(curve, 1);
    assert_close(at.stress, 2, 1e-15);
    assert_close(at.slope, m, 1e-15);
    /* Cubic of Hermite: the middle is (a + b)/2 + h (m0 - m1)/8, the area h (a + b)/2 + h^2 (m0 - m1)/12. */
    assert_close(dr_curve_at(curve, 0.5).stress, 1 + (2 - m) / 8, 1e-15);
    assert_close(at.work, 1 + (2 - m) / 12, 1e-15);
    assert_close(dr_curve_at(curve, 2).stress, 8 + (m - 6) / 4, 1e-15);
    assert_close(dr_curve_at(curve, 3).work - at.work, 16 + (m - 6) / 3, 1e-15);
    dr_curve_free(curve);
}

static void test_curve__meets_its_points_whether_rest_is_given_or_not(void **state)
{
    (void)state;
    struct dr_curve *given = MAKE(WOVEN), *implied = make(WOVEN + 2, 6);
    for (int i = 0; i < 7; i++)
        assert_close(dr_curve_at(given, WOVEN[2 * i]).stress, WOVEN[2 * i + 1], 1e-15);
    for (double x = 0; x < 0.1; x += 0.0007) {
        struct dr_curve_value a = dr_curve_at(given, x), b = dr_curve_at(implied, x);
        assert_memory_equal(&a, &b, sizeof a);
    }
    assert_int_equal(dr_curve_bytes(given), dr_curve_bytes(implied));
    dr_curve_free(given);
    dr_curve_free(implied);
}

static void test_curve__value_slope_and_work_are_continuous_at_the_knots(void **state)
{
    (void)state;
    struct dr_curve *curve = MAKE(WOVEN);
    for (int i = 1; i < 7; i++) {
        double x = WOVEN[2 * i];
        struct dr_curve_value below = dr_curve_at(curve, nextafter(x, 0)), at = dr_curve_at(curve, x);
        assert_near(below.stress, at.stress, 1e-12, 1);
        assert_near(below.slope, at.slope, 1e-9, 100);
        assert_near(below.work, at.work, 1e-13, 0.01);
    }
    dr_curve_free(curve);
}

static void test_curve__never_falls_and_its_slope_is_the_difference(void **state)
{
    (void)state;
    struct dr_curve *curve = MAKE(WOVEN);
    double last = -1, flattest = 1e9, steepest = 0;
    for (int i = 0; i <= 7000; i++) {
        double x = 1e-5 * i, h = 1e-7;
        struct dr_curve_value at = dr_curve_at(curve, x);
        assert_true(at.stress >= last && at.slope >= 0);
        last = at.stress;
        flattest = fmin(flattest, at.slope);
        steepest = fmax(steepest, at.slope);
        if (i % 100 == 50) { /* between knots */
            double up = dr_curve_at(curve, x + h).stress, down = dr_curve_at(curve, x - h).stress;
            assert_near((up - down) / (2 * h), at.slope, 1e-6, 1000);
        }
    }
    assert_true(flattest == 0 && steepest > 6000); /* a plateau and a cliff: the curve is a hard one */
    dr_curve_free(curve);
}

static void test_curve__work_is_the_integral_of_the_stress(void **state)
{
    (void)state;
    /* Simpson's rule is exact for cubics: one panel for each stretch between knots and 0.06 to 0.08. */
    struct dr_curve *curve = MAKE(WOVEN);
    double work = 0, from = 0;
    for (int i = 1; i <= 7; i++) {
        double to = i < 7 ? WOVEN[2 * i] : 0.08;
        work += (to - from) / 6 *
                (dr_curve_at(curve, from).stress + 4 * dr_curve_at(curve, (from + to) / 2).stress +
                 dr_curve_at(curve, to).stress);
        assert_close(dr_curve_at(curve, to).work, work, 1e-14);
        from = to;
    }
    dr_curve_free(curve);
}

static void test_curve__goes_on_straight_past_its_last_point(void **state)
{
    (void)state;
    struct dr_curve *curve = MAKE(WOVEN);
    const double slope = 170 / 0.009;
    for (double x = 0.06; x < 30; x *= 1.7) {
        struct dr_curve_value at = dr_curve_at(curve, x);
        assert_close(at.slope, slope, 1e-13);
        assert_close(at.stress, 260 + slope * (x - 0.06), 1e-13);
    }
    assert_close(dr_curve_rest_slope(curve), 400, 1e-15);
    dr_curve_free(curve);
}

static void test_curve__random_curves_are_monotone(void **state)
{
    (void)state;
    uint64_t seed = 7;
    for (int trial = 0; trial < 500; trial++) {
        double point[2 * DRAPE_MAX_CURVE_POINTS], x = 0, y = 0;
        size_t points = 1 + (size_t)(trial % DRAPE_MAX_CURVE_POINTS);
        for (size_t i = 0; i < points; i++) {
            double rise = exp(8 * test_random(&seed)), flat = test_random(&seed);
            x += exp(4 * test_random(&seed));
            y += flat > 0.5 && i > 0 && i + 1 < points ? 0 : rise;
            point[2 * i] = x;
            point[2 * i + 1] = y;
        }
        struct dr_curve *curve = make(point, points);
        double last = 0;
        for (int i = 0; i <= 2000; i++) {
            double stress = dr_curve_at(curve, x * i / 1900).stress;
            assert_true(stress >= last - 1e-13 * y); /* a plateau is flat to rounding */
            last = stress;
        }
        dr_curve_free(curve);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_curve__one_point_is_a_straight_line),
        cmocka_unit_test(test_curve__slope_of_an_inner_knot_is_the_weighted_harmonic_mean),
        cmocka_unit_test(test_curve__meets_its_points_whether_rest_is_given_or_not),
        cmocka_unit_test(test_curve__value_slope_and_work_are_continuous_at_the_knots),
        cmocka_unit_test(test_curve__never_falls_and_its_slope_is_the_difference),
        cmocka_unit_test(test_curve__work_is_the_integral_of_the_stress),
        cmocka_unit_test(test_curve__goes_on_straight_past_its_last_point),
        cmocka_unit_test(test_curve__random_curves_are_monotone),
    };
    return cmocka_run_group_tests_name("curve", tests, NULL, NULL);
}
