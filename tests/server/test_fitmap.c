/* test_fitmap.c - the fit by vertex, and its colours. */
#include "test.h"

#include "fitmap.h"

/* Two triangles that share the edge 1 2, the second three times as large, and a vertex of neither. */
static double pattern[] = {0, 0, 1, 0, 0, 1, 3, 1, 9, 9};
static uint32_t triangle[] = {0, 1, 2, 1, 3, 2};
static const struct mesh mesh = {NULL, triangle, pattern, 5, 2};

static struct fitmap map_of(const double strain[6])
{
    const double pressure[5] = {0, 10, 20, 30, 0}, gap[5] = {0.001, -0.002, 0.03, 0, NAN};
    const drape_fit fit = {5, 2, strain, strain, NULL, pressure, gap};
    struct fitmap map;
    assert_int_equal(fitmap_new(&fit, &mesh, &map), 0);
    return map;
}

static void test_fitmap__strain_is_averaged_by_rest_area(void **state)
{
    (void)state;
    const double strain[6] = {0.01, -0.02, 0.04, 0.05, 0.02, 0};
    struct fitmap map = map_of(strain);
    for (size_t k = 0; k < 3; k++) {
        double mean = (strain[k] + 3 * strain[3 + k]) / 4;
        assert_near(map.strain[k], strain[k], 1e-15, 1);
        assert_near(map.strain[3 + k], mean, 1e-15, 1);
        assert_near(map.strain[6 + k], mean, 1e-15, 1);
        assert_near(map.strain[9 + k], strain[3 + k], 1e-15, 1);
        assert_true(map.strain[12 + k] == 0);
    }
    assert_close(map.full, hypot(0.05, 0.02), 1e-12);
    fitmap_done(&map);
    assert_null(map.color);
}

static void test_fitmap__a_gap_out_of_reach_is_the_reach(void **state)
{
    (void)state;
    const double strain[6] = {0};
    struct fitmap map = map_of(strain);
    assert_true(map.gap[1] == -0.002 && map.gap[4] == DRAPE_REACH);
    assert_true(map.pressure[3] == 30);
    fitmap_done(&map);
}

/* sRGB of a linear value, in 255 steps (IEC 61966-2-1). */
static double srgb(double c)
{
    return 255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * pow(c, 1 / 2.4) - 0.055);
}

static void expect_color(const struct fitmap *map, size_t vertex, int r, int g, int b)
{
    const int expected[3] = {r, g, b};
    for (size_t k = 0; k < 3; k++)
        assert_near(srgb(map->color[3 * vertex + k]), expected[k], 0.1, 1);
}

/* The ends of viridis, its middle at half the size (the first triangle has half the second's strain), and
 * lightness that rises with the strain. */
static void test_fitmap__colours_run_along_viridis(void **state)
{
    (void)state;
    const double strain[6] = {0.01, 0, 0, 0.02, 0, 0};
    struct fitmap map = map_of(strain);
    expect_color(&map, 4, 0x44, 0x01, 0x54);
    expect_color(&map, 0, 0x21, 0x91, 0x8C);
    expect_color(&map, 3, 0xFD, 0xE7, 0x25);
    fitmap_done(&map);

    double last = -1;
    for (int i = 0; i <= 100; i++) { /* shear counts half its square: 2 E_uv^2 */
        const double rising[6] = {0, 0, 0.01 * i * sqrt(2), 1, 0, 0};
        map = map_of(rising);
        double luminance = 0.2126 * map.color[0] + 0.7152 * map.color[1] + 0.0722 * map.color[2];
        assert_true(luminance > last);
        last = luminance;
        fitmap_done(&map);
    }
    assert_close(last, 0.2126 + 0.7152 + 0.0722, 0.3); /* nearly white */
}

static void test_fitmap__without_strain_all_is_dark(void **state)
{
    (void)state;
    const double strain[6] = {0};
    struct fitmap map = map_of(strain);
    for (size_t i = 0; i < 5; i++)
        expect_color(&map, i, 0x44, 0x01, 0x54);
    assert_true(map.full == 0);
    fitmap_done(&map);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fitmap__strain_is_averaged_by_rest_area),
        cmocka_unit_test(test_fitmap__a_gap_out_of_reach_is_the_reach),
        cmocka_unit_test(test_fitmap__colours_run_along_viridis),
        cmocka_unit_test(test_fitmap__without_strain_all_is_dark),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
