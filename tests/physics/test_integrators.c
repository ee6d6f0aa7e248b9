/* test_integrators.c - each integrator's order of accuracy and what it does to the energy, on one triangle
 * that swings and stretches: two corners held, the third free. */
#include "test.h"

#include "drape.h"

static const double pattern[] = {0, 0, 1, 0, 0.4, 1};
static const double start[] = {0, 0, 0, 1, 0, 0, 0.45, -1.02, 0.12};
static const uint32_t triangle[] = {0, 1, 2}, pin[] = {0, 1};
/* The free node weighs 1/6 kg: its periods are 0.4 to 2 s. */
static const drape_material material = {
    .density = 1, .stretch_weft = 40, .stretch_warp = 40, .stretch_shear = 20};

/* Runs `options` over `steps` steps; the last row. */
static drape_row last_row(drape_options options, uint32_t steps)
{
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = 3;
    desc.triangles = desc.materials = 1;
    desc.pins = 2;
    desc.positions = start;
    desc.pattern = pattern;
    desc.triangle = triangle;
    desc.pin = pin;
    desc.material = &material;
    drape_scene *scene = NULL;
    drape_sim *sim = NULL;
    options.tolerance = 1e-12; /* never at rest */
    options.max_iterations = steps;
    assert_int_equal(drape_scene_new(&desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(drape_sim_new(scene, &options, &sim, NULL), DRAPE_OK);
    assert_true(drape_sim_run(sim, NULL) >= 0);
    size_t rows;
    const drape_row *row = drape_sim_trace(sim, &rows);
    drape_row last = row[rows - 1];
    drape_sim_free(sim);
    drape_scene_free(scene);
    return last;
}

#define DURATION 0.9 /* s */

static drape_row swing(drape_integrator integrator, uint32_t steps, double air, double material_damping)
{
    drape_options options = drape_options_default();
    options.method = DRAPE_METHOD_DYNAMIC;
    options.integrator = integrator;
    options.time_step = DURATION / steps;
    options.air_damping = air;
    options.material_damping = material_damping;
    return last_row(options, steps);
}

static double rest_energy(void)
{
    drape_options options = drape_options_default();
    return last_row(options, 60).energy.potential;
}

static void test_integrators__each_has_its_order(void **state)
{
    (void)state;
    static const struct {
        drape_integrator integrator;
        double order;
    } row[] = {{DRAPE_BACKWARD_EULER, 1}, {DRAPE_BDF2, 2}, {DRAPE_IMPLICIT_MIDPOINT, 2}, {DRAPE_RK4, 4}};
    double exact = swing(DRAPE_RK4, 6400, 0, 0).energy.potential;
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        uint32_t steps = row[i].integrator == DRAPE_RK4 ? 100 : 800;
        double coarse = fabs(swing(row[i].integrator, steps, 0, 0).energy.potential - exact);
        double fine = fabs(swing(row[i].integrator, 2 * steps, 0, 0).energy.potential - exact);
        double order = log2(coarse / fine);
        print_message("%s: error %.3g J, then %.3g J: order %.3f\n", drape_integrator_name(row[i].integrator),
                      coarse, fine, order);
        assert_true(order > row[i].order - 0.1);
    }
}

static double total(drape_row row)
{
    return row.energy.potential + row.energy.kinetic;
}

static void test_integrators__backward_euler_loses_most_energy_and_rk4_least(void **state)
{
    (void)state;
    double before = total(swing(DRAPE_RK4, 6400, 0, 0)); /* to 1e-12 what it was at the start */
    double loss[4];
    for (int i = 0; i < 4; i++) {
        loss[i] = before - total(swing((drape_integrator)i, 200, 0, 0));
        print_message("%s loses %.3g J\n", drape_integrator_name((drape_integrator)i), loss[i]);
    }
    assert_true(loss[DRAPE_BACKWARD_EULER] > 10 * fabs(loss[DRAPE_BDF2]));
    assert_true(fabs(loss[DRAPE_BDF2]) > fabs(loss[DRAPE_RK4]));
    assert_true(fabs(loss[DRAPE_IMPLICIT_MIDPOINT]) < 0.02 * loss[DRAPE_BACKWARD_EULER]);
    assert_true(fabs(loss[DRAPE_RK4]) < 1e-6);
}

static void test_integrators__air_takes_the_power_it_should(void **state)
{
    (void)state;
    /* dE/dt = -a |v|^2_M = -2 a K: over a short damped run the loss is a times twice the mean kinetic energy
     * of the undamped one, to first order in a. */
    const uint32_t steps = 3200;
    const double a = 0.01;
    double kinetic = 0;
    for (uint32_t k = 1; k <= 40; k++) { /* mean by the trapezoid rule on 40 pieces */
        drape_options options = drape_options_default();
        options.method = DRAPE_METHOD_DYNAMIC;
        options.time_step = DURATION / steps;
        double here = last_row(options, steps * k / 40).energy.kinetic;
        kinetic += k < 40 ? here / 40 : here / 80;
    }
    double lost =
        total(swing(DRAPE_BACKWARD_EULER, steps, 0, 0)) - total(swing(DRAPE_BACKWARD_EULER, steps, a, 0));
    assert_near(lost, 2 * a * kinetic * DURATION, 0.02, 0);
}

static void test_integrators__damping_leaves_the_rest_state_alone(void **state)
{
    (void)state;
    double rest = rest_energy();
    drape_options options = drape_options_default();
    options.method = DRAPE_METHOD_DYNAMIC;
    options.air_damping = 4;
    options.material_damping = 0.05;
    drape_row row = last_row(options, 1500);
    assert_true(row.residual_force < 1e-6);
    assert_near(row.energy.potential, rest, 1e-9, 1);
    double free = total(swing(DRAPE_BACKWARD_EULER, 400, 0, 0)),
           damped = total(swing(DRAPE_BACKWARD_EULER, 400, 0, 0.05));
    assert_true(damped < free && damped > rest);
}

int main(void)
{
    drape_blas_prepare();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_integrators__each_has_its_order),
        cmocka_unit_test(test_integrators__backward_euler_loses_most_energy_and_rk4_least),
        cmocka_unit_test(test_integrators__air_takes_the_power_it_should),
        cmocka_unit_test(test_integrators__damping_leaves_the_rest_state_alone),
    };
    return cmocka_run_group_tests_name("integrators", tests, NULL, NULL);
}
