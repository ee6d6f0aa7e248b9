/* test_work.c - the energy of every term is the integral of its force, along random paths. */
#include "cloth.h"
#include "run.h"
#include "solver/shapes.h"

#define DEMAND 1e-8
#define CELLS  5
#define SIDE   0.2 /* m */
#define NODES  ((CELLS + 1) * (CELLS + 1))

/* A panel above a body of every kind, which feel it from 2 cm off: a slanting plane, and a ball, a capsule
 * and a meshed ball under a quarter each. */
struct panel {
    struct setup *setup;
    struct shape shape;
    drape_body body[4];
    drape_scene *scene;
    struct dr_cloth *cloth;
};

/* Vertices that feel a body where they start. */
static size_t touching(const struct panel *panel, size_t body)
{
    size_t count = 0;
    for (size_t i = 0; i < NODES; i++) {
        double phi, grad[3];
        count += dr_body_distance(panel->scene->body[body], panel->setup->x + 3 * i, &phi, grad) &&
                 phi < panel->body[body].offset;
    }
    return count;
}

static struct panel panel_new(enum grid_kind kind, drape_material material)
{
    struct panel panel = {.setup = setup_new(grid_new(kind, CELLS, CELLS, SIDE, SIDE, 0), material)};
    struct setup *setup = panel.setup;
    panel.shape = shape_sphere((const double[3]){0.15, -0.06, -0.15}, 0.05, 8);
    panel.body[0] = (drape_body){.kind = DRAPE_BODY_PLANE, .point = {0, -0.02, 0}, .axis = {0.3, 1, 0.2}};
    panel.body[1] = (drape_body){.kind = DRAPE_BODY_SPHERE, .point = {0.15, -0.06, -0.05}, .radius = 0.05};
    panel.body[2] = (drape_body){.kind = DRAPE_BODY_CAPSULE,
                                 .point = {0.02, -0.04, -0.15},
                                 .axis = {0.08, -0.05, -0.16},
                                 .radius = 0.03};
    panel.body[3] = shape_body(&panel.shape);
    for (int i = 0; i < 4; i++)
        panel.body[i].offset = 0.02;
    setup->desc.body = panel.body;
    setup->desc.bodies = 4;
    assert_int_equal(drape_scene_new(&setup->desc, &panel.scene, NULL), DRAPE_OK);
    const struct dr_cloth_plan plan = {.scene = panel.scene,
                                       .mesh = panel.scene->mesh,
                                       .bend = panel.scene->bend,
                                       .gravity = true,
                                       .contact = true,
                                       .matrix = DR_MATRIX_NONE};
    assert_int_equal(dr_cloth_new(&plan, setup->x, &panel.cloth, NULL), DRAPE_OK);
    for (size_t i = 0; i < 4; i++)
        assert_true(touching(&panel, i) > 0);
    return panel;
}

static void panel_done(struct panel *panel)
{
    dr_cloth_free(panel->cloth);
    drape_scene_free(panel->scene);
    shape_free(&panel->shape);
    setup_free(panel->setup);
}

/* ---- the terms: energy at x, its gradient into g ---- */

typedef double energy_fn(const struct dr_cloth *cloth, const double *x, double *g);

static double stretch(const struct dr_cloth *cloth, const double *x, double *g)
{
    memset(g, 0, 3 * NODES * sizeof *g);
    return dr_stretch_energy(cloth->stretch, x, g);
}

static double bend(const struct dr_cloth *cloth, const double *x, double *g)
{
    memset(g, 0, 3 * NODES * sizeof *g);
    return dr_bend_energy(cloth->bend, x, g);
}

static double contact(const struct dr_cloth *cloth, const double *x, double *g)
{
    memset(g, 0, 3 * NODES * sizeof *g);
    return dr_contact_energy(cloth->contact, x, g);
}

static double everything(const struct dr_cloth *cloth, const double *x, double *g)
{
    drape_energies unused;
    double energy = dr_cloth_energy(cloth, x, &unused, g);
    for (size_t i = 0; i < 3 * NODES; i++)
        g[i] = -g[i];
    return energy;
}

/* ---- paths ---- */

enum { WAVES = 3 };

/* x(t) = start + t way + sum_k wave_k sin(k pi t), 0 <= t <= 1 */
struct path {
    double start[3 * NODES], way[3 * NODES], wave[WAVES][3 * NODES];
};

static void path_random(struct path *path, const double *flat, uint64_t *seed)
{
    for (size_t i = 0; i < 3 * NODES; i++) {
        path->start[i] = flat[i] + 0.006 * test_random(seed);
        path->way[i] = 0.015 * test_random(seed);
        for (int k = 0; k < WAVES; k++)
            path->wave[k][i] = 0.005 * test_random(seed);
    }
}

static void path_at(const struct path *path, double t, double *x, double *velocity)
{
    const double pi = acos(-1);
    for (size_t i = 0; i < 3 * NODES; i++) {
        x[i] = path->start[i] + t * path->way[i];
        velocity[i] = path->way[i];
    }
    for (int k = 0; k < WAVES; k++) {
        double s = sin((k + 1) * pi * t), c = (k + 1) * pi * cos((k + 1) * pi * t);
        for (size_t i = 0; i < 3 * NODES; i++) {
            x[i] += s * path->wave[k][i];
            velocity[i] += c * path->wave[k][i];
        }
    }
}

/* The work against the force less the energy it should have stored, over the most that is stored on the way.
 * Three Gauss points a panel: the force is smooth but for kinks in its slope, at the points of curves and
 * where a contact begins, whose panels err by the square of their width. */
static double path_misfit(energy_fn *energy, const struct dr_cloth *cloth, const struct path *path,
                          size_t panels)
{
    const double at[] = {-sqrt(0.6), 0, sqrt(0.6)}, part[] = {5.0 / 18, 8.0 / 18, 5.0 / 18};
    double x[3 * NODES], velocity[3 * NODES], g[3 * NODES], most = 0, width = 1 / (double)panels;
    long double work = 0;
    path_at(path, 0, x, velocity);
    double start = energy(cloth, x, g);
    for (size_t i = 0; i < 3 * panels; i++) {
        path_at(path, width * ((double)(i / 3) + (1 + at[i % 3]) / 2), x, velocity);
        most = fmax(most, fabs(energy(cloth, x, g) - start));
        double power = 0;
        for (size_t j = 0; j < 3 * NODES; j++)
            power += g[j] * velocity[j];
        work += width * part[i % 3] * power;
    }
    path_at(path, 1, x, velocity);
    double stored = energy(cloth, x, g) - start;
    most = fmax(most, fabs(stored));
    assert_true(most > 1e-4); /* J */
    return fabs((double)work - stored) / most;
}

static const drape_material LINEAR = {.density = 0.15,
                                      .stretch_weft = 300,
                                      .stretch_warp = 800,
                                      .stretch_shear = 50,
                                      .poisson = 0.2,
                                      .bend_weft = 2e-3,
                                      .bend_warp = 5e-3,
                                      .bend_twist = 1e-3};

/* Crimp first, then the yarns; a cloth that softens; strain, N/m. */
static drape_material curved(void)
{
    static const double weft[] = {0.01, 4, 0.03, 22, 0.06, 90, 0.1, 260, 0.15, 600};
    static const double warp[] = {0.02, 40, 0.05, 70, 0.1, 90, 0.2, 100, 0.3, 105};
    static const double shear[] = {0.1, 2, 0.3, 12};
    drape_material material = LINEAR;
    material.poisson = 0;
    material.curve_weft = (drape_curve){5, weft};
    material.curve_warp = (drape_curve){5, warp};
    material.curve_shear = (drape_curve){2, shear};
    return material;
}
static void check_work(energy_fn *energy, drape_material material, size_t panels)
{
    enum { PATHS = 5 };
    for (enum grid_kind kind = 0; kind < GRID_KINDS; kind++) {
        struct panel panel = panel_new(kind, material);
        double worst = 0;
        uint64_t seed = 1 + (uint64_t)kind;
        for (int n = 0; n < PATHS; n++) {
            struct path path;
            path_random(&path, panel.setup->x, &seed);
            worst = fmax(worst, path_misfit(energy, panel.cloth, &path, panels));
        }
        print_message("  %-16s work and energy differ by %.1e at most (demand %.0e)\n", grid_name[kind],
                      worst, DEMAND);
        assert_true(worst < DEMAND);
        panel_done(&panel);
    }
}

static void test_work__of_linear_stretch_is_its_energy(void **state)
{
    (void)state;
    check_work(stretch, LINEAR, 200);
}

static void test_work__of_measured_curves_is_their_energy(void **state)
{
    (void)state;
    check_work(stretch, curved(), 1500);
}

static void test_work__of_bending_is_its_energy(void **state)
{
    (void)state;
    check_work(bend, LINEAR, 200);
}

static void test_work__of_contact_is_its_energy(void **state)
{
    (void)state;
    check_work(contact, LINEAR, 1500);
}

static void test_work__of_all_terms_and_gravity_is_the_potential(void **state)
{
    (void)state;
    check_work(everything, curved(), 1500);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_work__of_linear_stretch_is_its_energy),
        cmocka_unit_test(test_work__of_measured_curves_is_their_energy),
        cmocka_unit_test(test_work__of_bending_is_its_energy),
        cmocka_unit_test(test_work__of_contact_is_its_energy),
        cmocka_unit_test(test_work__of_all_terms_and_gravity_is_the_potential),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
