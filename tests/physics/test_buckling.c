/* test_buckling.c - a strip on edge, or standing, falls over at the exact load: bending and twist together.
 */
#include "run.h"

#define GRAVITY 9.81
#define LENGTH  0.1 /* m, beyond the clamp */
#define DENSITY 0.2 /* kg/m^2 */

/* ---- critical Gamma = density g L^3 / B ---- */

/* Greenhill's column: theta'' + Gamma s theta = 0 from the free end, s = 0, where theta' = 0, to the clamp,
 * s = 1, where theta = 0. In powers of s^3 theta(1) = sum (-Gamma)^k / prod (3j - 1)(3j), a multiple of
 * the Bessel function J_-1/3(2/3 sqrt(Gamma)). */
static double column_slope(double gamma)
{
    double sum = 0, term = 1;
    for (int k = 1; k < 40; k++) {
        sum += term;
        term *= -gamma / ((3 * k - 1) * (3 * k));
    }
    return sum;
}

static double column_load(void)
{
    double low = 5, high = 10; /* positive, negative */
    for (int i = 0; i < 60; i++) {
        double mid = (low + high) / 2;
        *(column_slope(mid) > 0 ? &low : &high) = mid;
    }
    return low;
}

/* A plate on edge, unit length, width w, clamped at x = 0, B = 1, Poisson ratio 0, by Ritz's method with the
 * functions x^2 x^i y^j. The weight stresses it in its plane as Airy's polynomials say (s = 1 - x, c = w/2,
 * I = w^3/12):
 *   N_xx = w s^2 y/2I - w (y^3 - 3/5 c^2 y)/3I,  N_xy = -w s (c^2 - y^2)/2I,
 *   N_yy = y - w (c^2 y - y^3/3)/2I.
 * The bending energy less Gamma times the work of these stresses is positive definite below the load. */
enum { ALONG = 9, ACROSS = 6, TERMS = ALONG * ACROSS };

struct ritz {
    double bending[TERMS][TERMS], stress[TERMS][TERMS];
};

static void ritz_add(struct ritz *ritz, double weight, double x, double y, double w)
{
    double c = w / 2, I = w * w * w / 12, s = 1 - x, f[TERMS][5];
    double xx = w * s * s * y / (2 * I) - w * (y * y * y - 0.6 * c * c * y) / (3 * I);
    double xy = -w * s * (c * c - y * y) / (2 * I), yy = y - w * (c * c * y - y * y * y / 3) / (2 * I);
    for (int i = 0; i < TERMS; i++) {
        int p = 2 + i % ALONG, q = i / ALONG;
        double X = pow(x, p), dX = p * pow(x, p - 1), ddX = p * (p - 1) * pow(x, p - 2);
        double Y = pow(y / c, q), dY = q > 0 ? q * pow(y / c, q - 1) / c : 0;
        double ddY = q > 1 ? q * (q - 1) * pow(y / c, q - 2) / (c * c) : 0;
        f[i][0] = dX * Y;
        f[i][1] = X * dY;
        f[i][2] = ddX * Y;
        f[i][3] = X * ddY;
        f[i][4] = 2 * dX * dY;
    }
    for (int i = 0; i < TERMS; i++)
        for (int j = 0; j < TERMS; j++) {
            const double *a = f[i], *b = f[j];
            ritz->bending[i][j] += weight * (a[2] * b[2] + a[3] * b[3] + a[4] * b[4] / 2);
            ritz->stress[i][j] +=
                weight * (xx * a[0] * b[0] + yy * a[1] * b[1] + xy * (a[0] * b[1] + a[1] * b[0]));
        }
}

static bool ritz_stands(const struct ritz *ritz, double gamma)
{
    double L[TERMS][TERMS]; /* Cholesky */
    for (int i = 0; i < TERMS; i++)
        for (int j = 0; j <= i; j++) {
            double sum = ritz->bending[i][j] + gamma * ritz->stress[i][j];
            for (int k = 0; k < j; k++)
                sum -= L[i][k] * L[j][k];
            if (i == j && sum <= 0)
                return false;
            L[i][j] = i == j ? sqrt(sum) : sum / L[j][j];
        }
    return true;
}

static double on_edge_load(double w)
{
    enum { PANELS = 8 }; /* of 4 Gauss points */
    static const double at[] = {-0.8611363115940526, -0.3399810435848563, 0.3399810435848563,
                                0.8611363115940526};
    static const double part[] = {0.3478548451374538, 0.6521451548625461, 0.6521451548625461,
                                  0.3478548451374538};
    static struct ritz ritz;
    memset(&ritz, 0, sizeof ritz);
    for (int i = 0; i < 4 * PANELS; i++)
        for (int j = 0; j < 4 * PANELS; j++) {
            double x = (i / 4 + (1 + at[i % 4]) / 2) / PANELS, y = (j / 4 + (1 + at[j % 4]) / 2) / PANELS;
            ritz_add(&ritz, part[i % 4] * part[j % 4] * w / (4 * PANELS * PANELS), x, w * (y - 0.5), w);
        }
    double low = 0, high = 100;
    for (int i = 0; i < 50; i++) {
        double mid = (low + high) / 2;
        *(ritz_stands(&ritz, mid) ? &low : &high) = mid;
    }
    return low;
}

static void test_buckling__the_exact_loads_are_the_published_ones(void **state)
{
    (void)state;
    double column = column_load(), on_edge = on_edge_load(0.2);
    print_message("  standing: Gamma %.5f; on edge: %.4f\n", column, on_edge);
    assert_near(column, 7.83735, 1e-6, 0); /* 9/4 of the square of 1.86635, first zero of J_-1/3 */
    assert_near(on_edge, 20.64, 2e-3, 0);  /* from above, as Ritz's method comes */
}

/* ---- the strip ---- */

struct pose {
    size_t cells, across;
    int along, aside, wide; /* axes */
};

static const struct pose STANDING = {40, 6, 1, 0, 2}, EDGEWISE = {50, 10, 0, 2, 1};

/* Starts the strip bent sideways by 5 % of its length and returns how far its tip is off in the end. */
static double tip_offset(const struct pose *pose, enum grid_kind kind, double gamma)
{
    drape_material material = isotropic(DENSITY, 1000, DENSITY * GRAVITY * LENGTH * LENGTH * LENGTH / gamma);
    struct setup *setup = setup_new(grid_strip(kind, pose->cells, pose->across, LENGTH), material);
    const struct grid *grid = &setup->grid;
    double clamp = grid->uv[2 * (size_t)grid_at(grid, 1, 0)];
    pin_columns(setup, 2);
    for (size_t i = 0; i < grid->vertices; i++) {
        double s = grid->uv[2 * i] - clamp, bent = s > 0 ? s / LENGTH : 0;
        setup->x[3 * i + (size_t)pose->along] = s;
        setup->x[3 * i + (size_t)pose->aside] = 0.05 * LENGTH * bent * bent;
        setup->x[3 * i + (size_t)pose->wide] = grid->uv[2 * i + 1];
    }
    drape_options options = drape_options_default();
    options.tolerance = 1e-5;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    size_t tip = grid_at(grid, grid->nx, pose->across / 2);
    double offset = run.x[3 * tip + (size_t)pose->aside] / LENGTH;
    run_done(&run);
    setup_free(setup);
    return fabs(offset);
}

/* `demand`: relative distance from the critical load at which the strip must stand, and must fall. The
 * load of the mesh itself lies between; a few bisections tell where. */
static void check_buckling(const struct pose *pose, double critical, double demand)
{
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        double stands = 1 - demand, falls = 1 + demand;
        double below = tip_offset(pose, kind, stands * critical);
        double above = tip_offset(pose, kind, falls * critical);
        for (int i = 0; i < 9; i++) {
            double mid = (stands + falls) / 2;
            *(tip_offset(pose, kind, mid * critical) < 0.01 ? &stands : &falls) = mid;
        }
        print_message(
            "  %-16s tip off by %.5f L at %.0f %% of the load, %.3f L at %.0f %%; error of the load "
            "%+.2f %%, demand %.0f %%\n",
            grid_name[kind], below, 100 * (1 - demand), above, 100 * (1 + demand),
            100 * ((stands + falls) / 2 - 1), 100 * demand);
        assert_true(below < 1e-3);
        assert_true(above > 0.09);
    }
}

static void test_buckling__a_column_falls_over_at_greenhills_load(void **state)
{
    (void)state;
    check_buckling(&STANDING, column_load(), 0.02);
}

static void test_buckling__a_strip_on_edge_tips_over_at_the_exact_load(void **state)
{
    (void)state;
    check_buckling(&EDGEWISE, on_edge_load(0.2), 0.03);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_buckling__the_exact_loads_are_the_published_ones),
        cmocka_unit_test(test_buckling__a_column_falls_over_at_greenhills_load),
        cmocka_unit_test(test_buckling__a_strip_on_edge_tips_over_at_the_exact_load),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
