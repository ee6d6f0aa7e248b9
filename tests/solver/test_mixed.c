/* test_mixed.c - the fast method's linear steps: conjugate gradients beside a direct solve of the same model.
 */
#include "physics/run.h"

#include "contact.h"

/* mixed.c is compiled in, for its static functions, and with a clip that leads where it is told. */
static double *led_to; /* led_count; NULL: it cuts nothing */
static size_t led_count;
static size_t lead(const struct dr_contact *contact, const double *x, double *w, double depth);
#define dr_contact_clip lead
#include "mixed.c"

struct example {
    struct setup *setup;
    drape_scene *scene;
    drape_sim *sim;
    struct dr_state s;
    size_t count;
    drape_body floor;
};

static size_t lead(const struct dr_contact *contact, const double *x, double *w, double depth)
{
    (void)contact;
    (void)depth;
    for (size_t i = 0; led_to && i < led_count; i++)
        w[i] = led_to[i] - x[i];
    return led_to != NULL;
}

/* A square under its weight, clamped at one edge, flat but shaken, `stretched` times as long as at rest, a
 * metre above a plane; k and B in N/m and N m. */
static void make_on(struct example *e, struct grid grid, double k, double B, double stretched, double shake)
{
    uint64_t seed = 4;
    memset(e, 0, sizeof *e);
    e->setup = setup_new(grid, isotropic(0.1, k, B));
    pin_columns(e->setup, 2);
    e->floor = (drape_body){
        .kind = DRAPE_BODY_PLANE, .offset = DRAPE_DEFAULT_OFFSET, .point = {0, -1, 0}, .axis = {0, 1, 0}};
    e->setup->desc.body = &e->floor;
    e->setup->desc.bodies = 1;
    e->setup->desc.self_contact = DRAPE_SELF_CONTACT_OFF;
    drape_options options = drape_options_default();
    assert_int_equal(drape_scene_new(&e->setup->desc, &e->scene, NULL), DRAPE_OK);
    assert_int_equal(drape_sim_new(e->scene, &options, &e->sim, NULL), DRAPE_OK);
    struct dr_state *s = &e->s;
    const double *start = e->sim->positions; /* nodes are vertices here */
    assert_int_equal(dr_cloth_new(&e->sim->plan.welded, start, &s->cloth, NULL), DRAPE_OK);
    e->count = 3 * s->cloth->mesh->nodes;
    s->sim = e->sim;
    s->method = e->sim->plan.method;
    double **array[] = {&s->x,        &s->f,        &s->w,        &s->x_next,  &s->f_next,
                        &s->extra[0], &s->extra[1], &s->extra[2], &s->extra[3]};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        assert_non_null(*array[i] = calloc(e->count, sizeof(double)));
    for (size_t i = 0; i < e->count; i++) {
        double noise = shake * test_random(&seed);
        s->x[i] = (i % 3 == 0 ? stretched : 1) * start[i] + (s->cloth->mesh->held[i / 3] ? 0 : noise);
    }
    dr_cloth_energy(s->cloth, s->x, &s->row.energy, s->f);
    dr_cloth_stress(s->cloth, s->x, NULL);
    s->weight = dr_cloth_mean_weight(s->cloth);
    s->sim->began = dr_clock();
    s->h = 0.05;
}

static void make(struct example *e, double k, double B, double stretched, double shake)
{
    make_on(e, grid_new(GRID_DELAUNAY, 12, 12, 0.3, 0.3, 0), k, B, stretched, shake);
}

static void release(struct example *e)
{
    struct dr_state *s = &e->s;
    double *array[] = {s->x,        s->f,        s->w,        s->x_next,  s->f_next,
                       s->extra[0], s->extra[1], s->extra[2], s->extra[3]};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        free(array[i]);
    dr_cloth_free(s->cloth);
    drape_sim_free(e->sim);
    drape_scene_free(e->scene);
    setup_free(e->setup);
}

/* w_direct of (M/h^2 + H(indefinite)) w = f with all of the bending in the factor; false: not definite. */
static bool solve_directly(struct example *e, double indefinite, double *ret)
{
    struct dr_state *s = &e->s;
    bool definite;
    assert_int_equal(dr_cloth_make_exact(s->cloth, true, NULL), DRAPE_OK);
    assert_null(s->cloth->remainder);
    dr_matrix_set_base(s->cloth->A, 1 / (s->h * s->h));
    assert_int_equal(dr_state_factorise(s, indefinite, &definite, NULL), DRAPE_OK);
    if (definite)
        dr_matrix_solve(s->cloth->A, 1, (const double *[]){s->f}, (double *[]){ret});
    return definite;
}

/* The same by the method, from hinges. */
static void factorise_hinges(struct example *e, double indefinite, bool *ret_definite)
{
    struct dr_state *s = &e->s;
    assert_int_equal(dr_cloth_make_exact(s->cloth, false, NULL), DRAPE_OK);
    assert_non_null(s->cloth->remainder);
    dr_matrix_set_base(s->cloth->A, 1 / (s->h * s->h));
    assert_int_equal(dr_state_factorise(s, indefinite, ret_definite, NULL), DRAPE_OK);
}

static void test_mixed__steps_from_hinges_are_those_of_a_factor_with_all_of_the_bending(void **state)
{
    (void)state;
    const struct {
        double k, B, stretched, shake, h, indefinite;
    } cases[] = {
        {10, 1e-5, 1, 2e-3, 0.02, 0},   {10, 1e-5, 1, 2e-3, 0.2, 0},      {1000, 1e-5, 1, 2e-3, 0.2, 0},
        {1000, 1e-3, 1, 2e-3, 0.2, 0},  {100, 1e-4, 1.1, 1e-4, 0.2, 1},   {100, 1e-4, 1.1, 1e-4, 1e3, 1},
        {1000, 1e-2, 1, 1e-4, 0.02, 1}, {1000, 1e-7, 1.05, 1e-5, 0.2, 1},
    };
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        struct example e;
        bool definite;
        make(&e, cases[c].k, cases[c].B, cases[c].stretched, cases[c].shake);
        struct dr_state *s = &e.s;
        double *direct = calloc(e.count, sizeof *direct), *q = calloc(e.count, sizeof *q);
        s->h = cases[c].h;
        assert_true(solve_directly(&e, cases[c].indefinite, direct));
        factorise_hinges(&e, cases[c].indefinite, &definite);
        assert_true(definite);
        assert_int_equal(solve_model(s, NULL), DRAPE_OK);
        assert_false(s->negative);
        /* its residual is what it says, and in the energy norm it is as precise as it should be */
        double size = 0, error = 0, most = 0;
        dr_matrix_multiply(s->cloth->A, s->w, q);
        dr_cloth_add_remainder(s->cloth, s->w, q);
        for (size_t i = 0; i < e.count; i++)
            most = fmax(most, s->cloth->mesh->held[i / 3] ? 0 : fabs(s->f[i]));
        for (size_t i = 0; i < e.count; i++) {
            if (s->cloth->mesh->held[i / 3]) {
                assert_true(s->w[i] == 0);
                continue;
            }
            assert_near(s->f[i] - q[i], s->extra[RESIDUAL][i], 1e-9, most);
            size += s->f[i] * direct[i];
            error += (s->w[i] - direct[i]) * s->extra[RESIDUAL][i]; /* - e.Ae */
        }
        print_message("  case %zu: %u solves, error %.1e\n", c, s->solves, sqrt(fabs(error) / size));
        assert_true(sqrt(fabs(error) / size) < 3 * PRECISE);
        assert_true(s->solves > 1 && s->solves < 40);
        free(direct);
        free(q);
        release(&e);
    }
}

/* A plate pressed together until it buckles: hinges, half as stiff again, hold longer than the element, and
 * conjugate gradients must find out. */
static void test_mixed__what_hinges_alone_hold_up_is_told_to_buckle(void **state)
{
    (void)state;
    unsigned told = 0, direct = 0;
    for (double pressed = 1e-5; pressed < 2e-4; pressed *= 1.05) {
        struct example e;
        bool definite;
        make(&e, 1000, 1e-3, 1 - pressed, 0);
        double *w = calloc(e.count, sizeof *w);
        e.s.h = 1e3;
        bool whole = solve_directly(&e, 1, w);
        factorise_hinges(&e, 1, &definite);
        uint64_t seed = 3;
        for (size_t i = 0; i < e.count; i++)
            e.s.f[i] = e.s.cloth->mesh->held[i / 3] ? 0 : test_random(&seed);
        direct += definite && !whole;
        if (definite) {
            assert_int_equal(solve_model(&e.s, NULL), DRAPE_OK);
            assert_int_equal(e.s.negative, !whole);
            told += e.s.negative;
        }
        free(w);
        release(&e);
    }
    print_message("  %u of %u told\n", told, direct);
    assert_true(direct > 1 && told == direct);
}

/* Without bending there is nothing that a factor in double lacks, and little that one in single precision. */
static void test_mixed__a_limp_cloth_takes_one_solve_in_double_and_few_in_single(void **state)
{
    (void)state;
    struct example e;
    bool definite;
    make(&e, 10, 0, 1, 2e-3);
    for (int i = 0; i < 3; i++) {
        bool exact = i == 1;
        assert_int_equal(dr_cloth_make_exact(e.s.cloth, exact, NULL), DRAPE_OK);
        assert_null(e.s.cloth->remainder);
        dr_matrix_set_base(e.s.cloth->A, 1 / (e.s.h * e.s.h));
        assert_int_equal(dr_state_factorise(&e.s, 0, &definite, NULL), DRAPE_OK);
        assert_int_equal(dr_matrix_is_single(e.s.cloth->A), !exact);
        e.s.solves = 0;
        e.s.extra[RESIDUAL][5] = 1;
        assert_int_equal(solve_model(&e.s, NULL), DRAPE_OK);
        assert_in_range(e.s.solves, exact ? 1 : 2, exact ? 1 : 3);
        assert_true(exact ? e.s.extra[RESIDUAL][5] == 0 : fabs(e.s.extra[RESIDUAL][5]) < 1e-3);
    }
    release(&e);
}

/* A tolerance that no force in doubles comes to: the run says so soon, and its state is as good as it gets.
 */
static void test_mixed__a_force_that_is_round_off_ends_the_run(void **state)
{
    (void)state;
    struct setup *setup = setup_new(grid_new(GRID_DELAUNAY, 12, 12, 0.3, 0.3, 0), isotropic(0.1, 1000, 1e-5));
    pin_columns(setup, 2);
    drape_options options = drape_options_default();
    drape_scene *scene;
    drape_sim *sim;
    options.tolerance = 1e-15;
    assert_int_equal(drape_scene_new(&setup->desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(drape_sim_new(scene, &options, &sim, NULL), DRAPE_OK);
    assert_int_equal(drape_sim_run(sim, NULL), DRAPE_NOT_AT_REST);
    const drape_report *report = drape_sim_report(sim);
    print_message("  %u iterations, force %.1e\n", report->iterations, report->state.residual_force);
    assert_string_equal(report->reason, "the residual force is round-off, and above the tolerance");
    assert_true(report->iterations < 50);
    assert_true(report->state.residual_force < 1e-8);
    drape_sim_free(sim);
    drape_scene_free(scene);
    setup_free(setup);
}

/* Where the clip makes of a step that falls one that climbs at first, and comes down behind the hump: from a
 * sheet pressed together to its mirror image at rest, folded over the clamp. */
static void test_mixed__a_chord_step_that_climbs_is_not_taken_however_low_it_leads(void **state)
{
    (void)state;
    for (int led = 0; led < 2; led++) {
        struct example e;
        bool definite;
        make_on(&e, grid_new(GRID_ALTERNATING, 12, 12, 0.3, 0.3, 0), 1000, 1e-7, 0.99, 0);
        struct dr_state *s = &e.s;
        const double *start = e.sim->positions;
        double *image = calloc(e.count, sizeof *image), *before = calloc(e.count, sizeof *before);
        double clamp = 0.3 / 12, climb = 0;
        drape_energies there;
        memcpy(before, s->x, e.count * sizeof *before);
        memcpy(image, s->x, e.count * sizeof *image);
        for (size_t i = 0; i < e.count; i += 3)
            if (!s->cloth->mesh->held[i / 3])
                image[i] = 1.99 * clamp - start[i];
        s->h = 2e-3; /* too short to fall far */
        factorise_hinges(&e, 0, &definite);
        assert_true(definite);
        double low = dr_cloth_energy(s->cloth, image, &there, s->f_next);
        for (size_t i = 0; i < e.count; i++)
            climb += s->f[i] * (image[i] - s->x[i]);
        assert_true(climb < 0 && low < s->row.energy.potential);
        led_to = led ? image : NULL;
        led_count = e.count;
        assert_int_equal(chords(s, NULL), DRAPE_OK);
        led_to = NULL;
        assert_int_equal(memcmp(s->x, before, e.count * sizeof *before) != 0, !led);
        free(image);
        free(before);
        release(&e);
    }
}

/* Nor is one of metres, from a factor that was all but singular, whatever the clip would make of it: to know
 * what such a step runs into takes longer than ten iterations. */
static void test_mixed__a_chord_step_that_is_too_long_is_not_looked_at(void **state)
{
    (void)state;
    const double h[] = {0.01, 0.5}; /* s, of free fall: 1 mm, 2.5 m */
    for (int i = 0; i < 2; i++) {
        struct example e;
        bool definite;
        make_on(&e, grid_new(GRID_ALTERNATING, 12, 12, 0.3, 0.3, 0), 1000, 1e-7, 1, 0);
        struct dr_state *s = &e.s;
        double *lower = calloc(e.count, sizeof *lower), *before = calloc(e.count, sizeof *before);
        memcpy(before, s->x, e.count * sizeof *before);
        memcpy(lower, s->x, e.count * sizeof *lower);
        for (size_t k = 0; k < e.count; k += 3)
            lower[k + 1] -= 1e-3 * fmax(0, s->x[k] - 0.3 / 12);
        s->h = h[i];
        factorise_hinges(&e, 0, &definite);
        assert_true(definite);
        led_to = lower;
        led_count = e.count;
        assert_int_equal(chords(s, NULL), DRAPE_OK);
        led_to = NULL;
        assert_int_equal(memcmp(s->x, before, e.count * sizeof *before) != 0, i == 0);
        free(lower);
        free(before);
        release(&e);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mixed__steps_from_hinges_are_those_of_a_factor_with_all_of_the_bending),
        cmocka_unit_test(test_mixed__what_hinges_alone_hold_up_is_told_to_buckle),
        cmocka_unit_test(test_mixed__a_force_that_is_round_off_ends_the_run),
        cmocka_unit_test(test_mixed__a_limp_cloth_takes_one_solve_in_double_and_few_in_single),
        cmocka_unit_test(test_mixed__a_chord_step_that_climbs_is_not_taken_however_low_it_leads),
        cmocka_unit_test(test_mixed__a_chord_step_that_is_too_long_is_not_looked_at),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
