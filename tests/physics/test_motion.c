/* test_motion.c - bodies that move before the drape: what they take along, what they leave, what they never
 * pass through. */
#include "run.h"
#include "solver/shapes.h"

#define TRAVEL 0.3 /* m */

/* A body mesh and one keyframe of it, moved by `shift`. */
struct mover {
    struct shape shape;
    double *moved;
    const double *keyframe[1];
    drape_body body;
};

static void mover_init(struct mover *mover, struct shape shape, const double shift[3], double seconds)
{
    mover->shape = shape;
    mover->moved = malloc(3 * shape.vertices * sizeof *mover->moved);
    assert_non_null(mover->moved);
    for (size_t i = 0; i < 3 * shape.vertices; i++)
        mover->moved[i] = shape.x[i] + shift[i % 3];
    mover->keyframe[0] = mover->moved;
    mover->body = shape_body(&mover->shape);
    mover->body.keyframes = 1;
    mover->body.keyframe = mover->keyframe;
    mover->body.motion_seconds = seconds;
}

static void mover_done(struct mover *mover)
{
    free(mover->moved);
    shape_free(&mover->shape);
}

static double mean_along(const struct setup *setup, const double *x, size_t d)
{
    double sum = 0;
    for (size_t i = 0; i < setup->grid.vertices; i++)
        sum += x[3 * i + d];
    return sum / (double)setup->grid.vertices;
}

/* A patch of 0.1 m on a slab, 3 mm over it. */
static struct setup *patch_on(struct mover *mover)
{
    struct setup *setup = setup_new(grid_new(GRID_ALTERNATING, 6, 6, 0.1, 0.1, 0), isotropic(0.2, 400, 1e-4));
    for (size_t i = 0; i < setup->grid.vertices; i++)
        setup->x[3 * i + 1] = 0.0029;
    setup->desc.body = &mover->body;
    setup->desc.bodies = 1;
    return setup;
}

static void slab(struct mover *mover, double friction)
{
    static const double low[3] = {-0.5, -0.2, -0.5}, high[3] = {1, 0, 0.5}, shift[3] = {TRAVEL, 0, 0};
    mover_init(mover, shape_box(low, high), shift, 1);
    mover->body.friction = friction;
}

/* The slab speeds up by at most 6 TRAVEL/s^2 = 0.18 g: a coefficient of 0.5 holds that, none holds nothing.
 */
static void test_motion__friction_takes_cloth_along_and_without_it_stays(void **state)
{
    (void)state;
    for (int rough = 0; rough < 2; rough++) {
        struct mover mover;
        slab(&mover, rough ? 0.5 : 0);
        struct setup *setup = patch_on(&mover);
        drape_options options = drape_options_default();
        struct run run = run_new(&setup->desc, &options);
        double moved = mean_along(setup, run.x, 0) - mean_along(setup, setup->x, 0);
        print_message("  friction %g: moved %.6f m with a slab that moved %g m, %u frames, %s\n",
                      mover.body.friction, moved, TRAVEL, run.report->motion_frames, run.report->reason);
        assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_true(run.report->motion_frames >= 50);
        if (rough)
            assert_near(moved, TRAVEL, 1e-3, 1); /* twice the slip */
        else
            assert_near(moved, 0, 1e-6, 1);
        run_done(&run);
        setup_free(setup);
        mover_done(&mover);
    }
}

/* Without friction the tacks alone take it along. */
static void test_motion__tacks_go_along_with_their_triangles(void **state)
{
    (void)state;
    struct mover mover;
    slab(&mover, 0);
    struct setup *setup = patch_on(&mover);
    drape_options options = drape_options_default();
    uint32_t top = 0; /* a triangle of the slab's upper side */
    for (size_t t = 0; t < mover.shape.triangles; t++) {
        const uint32_t *v = mover.shape.triangle + 3 * t;
        if (mover.shape.x[3 * v[0] + 1] == 0 && mover.shape.x[3 * v[1] + 1] == 0 &&
            mover.shape.x[3 * v[2] + 1] == 0)
            top = (uint32_t)t;
    }
    const uint32_t *v = mover.shape.triangle + 3 * top;
    drape_tack tack = {.vertex = 0, .triangle = top, .barycentric = {0.3, 0.3}};
    for (size_t d = 0; d < 3; d++) { /* where the patch's corner is to be tacked, it starts */
        double at = 0.3 * mover.shape.x[3 * v[0] + d] + 0.3 * mover.shape.x[3 * v[1] + d] +
                    0.4 * mover.shape.x[3 * v[2] + d];
        double shift = d == 1 ? 0 : at - setup->x[d];
        for (size_t i = 0; i < setup->grid.vertices; i++)
            setup->x[3 * i + d] += shift;
    }
    setup->desc.tack = &tack;
    setup->desc.tacks = 1;
    struct run run = run_new(&setup->desc, &options);
    print_message("  the tacked corner moved %.6f m, its slab %g m, %s\n", run.x[0] - setup->x[0], TRAVEL,
                  run.report->reason);
    assert_near(run.x[0] - setup->x[0], TRAVEL, 1e-4, 1);
    run_done(&run);
    tack.triangle = DRAPE_NO_TRIANGLE;
    drape_error error;
    assert_int_equal(drape_scene_check(&setup->desc, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, DRAPE_AT_TACK);
    assert_string_equal(error.member, "point");
    setup_free(setup);
    mover_done(&mover);
}

/* A field that comes along is that of where the body goes, and changes nothing. */
static void test_motion__a_shared_field_is_that_of_the_last_posture(void **state)
{
    (void)state;
    struct mover mover;
    slab(&mover, 0.5);
    struct setup *setup = patch_on(&mover);
    drape_options options = drape_options_default();
    struct run own = run_new(&setup->desc, &options);
    drape_body last = mover.body;
    last.positions = mover.moved;
    assert_int_equal(drape_field_new(&last, 0, NULL, &mover.body.field, NULL), DRAPE_OK);
    struct run shared = run_new(&setup->desc, &options);
    drape_field_unref(mover.body.field);
    assert_int_equal(own.report->iterations, shared.report->iterations);
    assert_memory_equal(own.x, shared.x, 3 * setup->grid.vertices * sizeof *own.x);
    run_done(&own);
    run_done(&shared);
    setup_free(setup);
    mover_done(&mover);
}

/* Too fast for friction: by Coulomb the cloth gets mu g t^2/2, forwards, and the slab is gone. A quarter more
 * is what 23 steps make of it. */
static void test_motion__a_tablecloth_is_left_behind_by_a_table_that_is_pulled_away(void **state)
{
    (void)state;
    const double seconds = 0.1;
    struct mover mover;
    slab(&mover, 0.3);
    mover.body.motion_seconds = seconds;
    struct setup *setup = patch_on(&mover);
    drape_options options = drape_options_default();
    struct run run = run_new(&setup->desc, &options);
    double moved = mean_along(setup, run.x, 0) - mean_along(setup, setup->x, 0);
    double most = 0.5 * 0.3 * 9.81 * seconds * seconds;
    print_message("  moved %.2f mm, Coulomb allows %.2f mm\n", 1e3 * moved, 1e3 * most);
    assert_near(moved, most, 0.25, 0);
    run_done(&run);
    setup_free(setup);
    mover_done(&mover);
}

/* A sheet that nothing holds hovers before a wall, which is on it at up to 150 m/s. */
static void test_motion__a_wall_sweeps_a_sheet_along_however_fast_it_is(void **state)
{
    (void)state;
    static const double seconds[] = {1, 0.05, 0.01};
    for (size_t n = 0; n < sizeof seconds / sizeof *seconds; n++) {
        static const double low[3] = {-0.06, -1, -1}, high[3] = {0, 1, 1}, shift[3] = {1, 0, 0};
        struct mover mover;
        mover_init(&mover, shape_box(low, high), shift, seconds[n]);
        struct setup *setup = setup_new(grid_new(GRID_RANDOM, 8, 8, 0.3, 0.3, 7), isotropic(0.2, 400, 1e-5));
        for (size_t i = 0; i < setup->grid.vertices; i++) { /* upright, 50 mm before it, a little crumpled */
            double *x = setup->x + 3 * i, u = x[0], v = x[2];
            x[0] = 0.05 + 0.005 * sin(40 * u) * cos(30 * v);
            x[1] = u - 0.15;
            x[2] = v + 0.15;
        }
        setup->desc.body = &mover.body;
        setup->desc.bodies = 1;
        setup->desc.gravity[1] = 0;
        drape_options options = drape_options_default();
        options.max_iterations = 30;
        struct run run = run_new(&setup->desc, &options);
        double least = INFINITY;
        for (size_t i = 0; i < setup->grid.vertices; i++)
            least = fmin(least, run.x[3 * i]);
        print_message("  in %g s: %u frames, the sheet ends %.2f mm before the wall at least\n", seconds[n],
                      run.report->motion_frames, 1e3 * (least - 1));
        assert_int_equal(run.report->penetrations, 0);
        assert_true(least > 1);
        run_done(&run);
        setup_free(setup);
        mover_done(&mover);
    }
}

/* A ball on a static floor rolls under nothing but pushes a sheet that lies over it; what stands stays. */
static void test_motion__cloth_between_a_ball_that_moves_and_a_floor_that_stands_is_in_neither(void **state)
{
    (void)state;
    struct mover mover;
    const double centre[3] = {0.1, 0.06, -0.15}, shift[3] = {0.1, 0, 0};
    mover_init(&mover, shape_sphere(centre, 0.05, 8), shift, 1);
    struct setup *setup =
        setup_new(grid_new(GRID_ALTERNATING, 12, 12, 0.3, 0.3, 0), isotropic(0.2, 400, 1e-5));
    drape_body body[2] = {mover.body,
                          {.kind = DRAPE_BODY_PLANE, .offset = 0.003, .friction = 0.3, .axis = {0, 1, 0}}};
    body[0].friction = 0.3;
    for (size_t i = 0; i < setup->grid.vertices; i++)
        setup->x[3 * i + 1] = 0.115;
    setup->desc.body = body;
    setup->desc.bodies = 2;
    drape_options options = drape_options_default();
    options.max_iterations = 500;
    struct run run = run_new(&setup->desc, &options), again = run_new(&setup->desc, &options);
    print_message("  %s after %u frames and %u iterations, %u inside, deepest %g mm\n",
                  drape_verdict_name(run.report->verdict), run.report->motion_frames, run.report->iterations,
                  run.report->penetrations, 1e3 * run.report->deepest);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(run.report->penetrations, 0);
    assert_memory_equal(run.x, again.x, 3 * setup->grid.vertices * sizeof(double));
    run_done(&run);
    run_done(&again);
    setup_free(setup);
    mover_done(&mover);
}

static int note_contact(const drape_progress *progress, void *data)
{
    double *most = data;
    if (progress->phase == DRAPE_PHASE_MOVING)
        *most = fmax(*most, progress->row.energy.contact);
    return 0;
}

/* Over a ball that goes nowhere the contact never stores what the whole sheet has to give by falling as far
 * as the ball's radius; steps that are taken as they are press it in five times as hard. */
static void test_motion__no_correction_pushes_crumpled_cloth_into_a_body(void **state)
{
    (void)state;
    const double radius = 0.1, density = 0.17, side = 0.3;
    const double centre[3] = {side / 2, -radius, -side / 2}, shift[3] = {0, 0, 0};
    double most = 0, weight = density * side * side * 9.81;
    struct mover mover;
    mover_init(&mover, shape_sphere(centre, radius, 8), shift, 0.4);
    mover.body.friction = 0.3;
    struct setup *setup =
        setup_new(grid_new(GRID_RANDOM, 10, 10, side, side, 7), isotropic(density, 400, 1e-5));
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        double *x = setup->x + 3 * i;
        x[1] = 0.01 + 0.005 * sin(90 * x[0]) * cos(70 * x[2]);
        x[0] = 0.15 + 0.7 * (x[0] - 0.15);
    }
    setup->desc.body = &mover.body;
    setup->desc.bodies = 1;
    setup->desc.self_contact = DRAPE_SELF_CONTACT_ON;
    drape_options options = drape_options_default();
    options.max_iterations = 1;
    options.progress = note_contact;
    options.progress_data = &most;
    struct run run = run_new(&setup->desc, &options);
    print_message("  %u frames, %.2f mJ of contact at most, %.2f mJ allowed\n", run.report->motion_frames,
                  1e3 * most, 1e3 * weight * radius);
    assert_true(most > 0);
    assert_true(most < weight * radius);
    run_done(&run);
    setup_free(setup);
    mover_done(&mover);
}

/* ---- ends --------------------------------------------------------------------------------------- */

static int cancel_at_three(const drape_progress *progress, void *data)
{
    unsigned *calls = data;
    if (progress->phase == DRAPE_PHASE_MOVING)
        ++*calls;
    return *calls == 3;
}

/* Cut short, the motion ends as a carry: the cloth is where the body is. */
static void test_motion__cancelled_on_the_way_the_cloth_still_arrives(void **state)
{
    (void)state;
    struct mover mover;
    unsigned calls = 0;
    slab(&mover, 0.5);
    struct setup *setup = patch_on(&mover);
    drape_options options = drape_options_default();
    options.progress = cancel_at_three;
    options.progress_data = &calls;
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.status, DRAPE_CANCELLED);
    assert_int_equal(calls, 3);
    assert_int_equal(run.report->motion_frames, 3);
    assert_near(mean_along(setup, run.x, 0) - mean_along(setup, setup->x, 0), TRAVEL, 2e-3, 1);
    run_done(&run);
    setup_free(setup);
    mover_done(&mover);
}

static void test_motion__a_body_that_goes_nowhere_changes_nothing_much(void **state)
{
    (void)state;
    struct mover mover;
    slab(&mover, 0.5);
    memcpy(mover.moved, mover.shape.x, 3 * mover.shape.vertices * sizeof *mover.moved);
    struct setup *setup = patch_on(&mover);
    drape_options options = drape_options_default();
    struct run run = run_new(&setup->desc, &options);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(run.report->motion_frames, 50); /* 1 s in steps of 20 ms */
    for (size_t i = 0; i < 3 * setup->grid.vertices; i++)
        assert_near(run.x[i], setup->x[i], 1e-3, 1);
    run_done(&run);
    setup_free(setup);
    mover_done(&mover);
}

static void test_motion__pins_stay_where_they_are_in_space(void **state)
{
    (void)state;
    struct mover mover;
    slab(&mover, 0.5);
    struct setup *setup = patch_on(&mover);
    pin_columns(setup, 1);
    drape_options options = drape_options_default();
    options.max_iterations = 20;
    struct run run = run_new(&setup->desc, &options);
    for (size_t p = 0; p < setup->desc.pins; p++)
        for (size_t d = 0; d < 3; d++)
            assert_true(run.x[3 * (size_t)setup->pin[p] + d] == setup->x[3 * (size_t)setup->pin[p] + d]);
    run_done(&run);
    setup_free(setup);
    mover_done(&mover);
}

/* ---- refusals ----------------------------------------------------------------------------------- */

static void refused(const struct setup *setup, drape_place place, int64_t element, const char *member)
{
    drape_error error = {0};
    assert_int_equal(drape_scene_check(&setup->desc, &error), DRAPE_EINVAL);
    assert_int_equal(error.place, place);
    assert_int_equal(error.element, element);
    assert_int_equal(error.body, 0);
    assert_string_equal(error.member, member);
}

static void test_motion__refuses_what_is_no_motion(void **state)
{
    (void)state;
    struct mover mover;
    drape_error error = {0};
    slab(&mover, 0.5);
    struct setup *setup = patch_on(&mover);
    assert_int_equal(drape_scene_check(&setup->desc, NULL), DRAPE_OK);
    static const double wrong[] = {0, 0.0099, 60.001, -1, NAN}, right[] = {0.01, 60};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        mover.body.motion_seconds = wrong[i];
        refused(setup, DRAPE_AT_BODY, 0, "motion_seconds");
    }
    for (size_t i = 0; i < sizeof right / sizeof *right; i++) {
        mover.body.motion_seconds = right[i];
        assert_int_equal(drape_scene_check(&setup->desc, NULL), DRAPE_OK);
    }
    const double *many[DRAPE_MAX_KEYFRAMES + 1];
    for (size_t k = 0; k <= DRAPE_MAX_KEYFRAMES; k++)
        many[k] = mover.moved;
    mover.body.keyframe = many;
    mover.body.keyframes = DRAPE_MAX_KEYFRAMES;
    assert_int_equal(drape_scene_check(&setup->desc, NULL), DRAPE_OK);
    mover.body.keyframes++;
    refused(setup, DRAPE_AT_BODY, 0, "keyframes");

    double *bad = malloc(3 * mover.shape.vertices * sizeof *bad);
    assert_non_null(bad);
    mover.body.keyframes = 6;
    many[5] = bad;
    memcpy(bad, mover.moved, 3 * mover.shape.vertices * sizeof *bad);
    bad[7] = NAN;
    refused(setup, DRAPE_AT_BODY_KEYFRAME, 5, "positions");
    for (size_t i = 0; i < 3 * mover.shape.vertices; i++)
        bad[i] = -mover.moved[i]; /* a mirror image is inside out */
    refused(setup, DRAPE_AT_BODY_KEYFRAME, 5, "positions");
    mover.body.kind = DRAPE_BODY_SPHERE;
    mover.body.radius = 0.1;
    refused(setup, DRAPE_AT_BODY, 0, "keyframes");
    assert_int_equal(drape_scene_check(&setup->desc, &error), DRAPE_EINVAL);
    free(bad);
    setup_free(setup);
    mover_done(&mover);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_motion__friction_takes_cloth_along_and_without_it_stays),
        cmocka_unit_test(test_motion__tacks_go_along_with_their_triangles),
        cmocka_unit_test(test_motion__a_shared_field_is_that_of_the_last_posture),
        cmocka_unit_test(test_motion__a_tablecloth_is_left_behind_by_a_table_that_is_pulled_away),
        cmocka_unit_test(test_motion__a_wall_sweeps_a_sheet_along_however_fast_it_is),
        cmocka_unit_test(test_motion__cloth_between_a_ball_that_moves_and_a_floor_that_stands_is_in_neither),
        cmocka_unit_test(test_motion__no_correction_pushes_crumpled_cloth_into_a_body),
        cmocka_unit_test(test_motion__cancelled_on_the_way_the_cloth_still_arrives),
        cmocka_unit_test(test_motion__a_body_that_goes_nowhere_changes_nothing_much),
        cmocka_unit_test(test_motion__pins_stay_where_they_are_in_space),
        cmocka_unit_test(test_motion__refuses_what_is_no_motion),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
