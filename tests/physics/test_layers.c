/* test_layers.c - cloth on cloth: what lies between layers carries their weight at the penalty's own
 * distance, friction holds them below its angle, and nothing passes through. */
#include "run.h"

#define GRAVITY   9.81
#define STIFFNESS 1e7 /* N/m^3: kappa of self.h and contact.h */
#define SIDE      0.05
#define CELLS     3
#define TURN      0.4188790204786391 /* 24 degrees */
#define MU        0.3

/* ---- sheets above one another ------------------------------------------------------------------ */

/* `layers` equal square sheets in one setup, the first in y = 0, each `gap` above the last; every other one
 * is turned about its middle: nodes lie over faces and edges cross, all by a millimetre at least, and no
 * weight is off the middle. */
struct stack {
    struct setup *setup;
    size_t layers, each; /* vertices of a layer */
    drape_body ground;
};

/* (u, v) turned about the middle of a sheet. */
static void turned(const double uv[2], double ret[2])
{
    double u = uv[0] - SIDE / 2, v = uv[1] - SIDE / 2;
    ret[0] = SIDE / 2 + u * cos(TURN) - v * sin(TURN);
    ret[1] = SIDE / 2 + u * sin(TURN) + v * cos(TURN);
}

static void stack_new(struct stack *stack, size_t layers, double gap, drape_material material)
{
    struct grid one = grid_new(GRID_ONE, CELLS, CELLS, SIDE, SIDE, 0), all = one;
    stack->layers = layers;
    stack->each = one.vertices;
    all.vertices = layers * one.vertices;
    all.triangles = layers * one.triangles;
    all.uv = malloc(2 * all.vertices * sizeof *all.uv);
    all.triangle = malloc(3 * all.triangles * sizeof *all.triangle);
    assert_non_null(all.uv);
    assert_non_null(all.triangle);
    for (size_t l = 0; l < layers; l++) {
        memcpy(all.uv + 2 * l * one.vertices, one.uv, 2 * one.vertices * sizeof *one.uv);
        for (size_t i = 0; i < 3 * one.triangles; i++)
            all.triangle[3 * l * one.triangles + i] = (uint32_t)(l * one.vertices) + one.triangle[i];
    }
    grid_done(&one);
    stack->setup = setup_new(all, material);
    for (size_t i = 0; i < all.vertices; i++) {
        size_t layer = i / stack->each;
        double *p = stack->setup->x + 3 * i, place[2];
        turned(all.uv + 2 * i, place);
        if (layer % 2) {
            p[0] = place[0];
            p[2] = -place[1]; /* v runs along -z */
        }
        p[1] = gap * (double)layer;
    }
}

static void lay_on_ground(struct stack *stack, double friction)
{
    stack->ground = (drape_body){.kind = DRAPE_BODY_PLANE,
                                 .offset = DRAPE_DEFAULT_OFFSET,
                                 .friction = friction,
                                 .point = {0, -DRAPE_DEFAULT_OFFSET, 0},
                                 .axis = {0, 1, 0}};
    stack->setup->desc.body = &stack->ground;
    stack->setup->desc.bodies = 1;
}

static double mean_of(const struct stack *stack, size_t layer, const double *x, size_t axis)
{
    double sum = 0;
    for (size_t i = 0; i < stack->each; i++)
        sum += x[3 * (layer * stack->each + i) + axis];
    return sum / (double)stack->each;
}

static void tell(const char *what, const struct run *run)
{
    print_message("  %s: %s after %u iterations, residual %.3g, %u crossings: %s\n", what,
                  drape_verdict_name(run->report->verdict), run->report->iterations,
                  run->report->state.residual_force, run->report->self_intersections, run->report->reason);
}

/* ---- the closed form ---------------------------------------------------------------------------- */

/* What presses in the area of two sheets, one turned, in units of kappa: half the area of each node that
 * lies over the other sheet, and for each crossing of their edges half the smaller of the two edges' areas,
 * an edge having a third of its triangles. Counted in the plane, from the grid alone. */
struct edge {
    double a[2], b[2], area;
};

static size_t edges_of(const struct grid *grid, bool turn, struct edge *edge)
{
    size_t count = 0, triangles = 2 * grid->nx * grid->ny;
    double third = SIDE * SIDE / (double)triangles / 3;
    for (size_t i = 0; i < 3 * triangles; i++) {
        const uint32_t *t = grid->triangle + i / 3 * 3;
        const double *p = grid->uv + 2 * t[i % 3], *q = grid->uv + 2 * t[(i + 1) % 3];
        struct edge e = {{p[0], p[1]}, {q[0], q[1]}, third};
        size_t k = 0;
        if (turn) {
            turned(p, e.a);
            turned(q, e.b);
        }
        while (k < count && (memcmp(edge[k].a, e.b, sizeof e.a) || memcmp(edge[k].b, e.a, sizeof e.a)))
            k++;
        if (k < count)
            edge[k].area += third;
        else
            edge[count++] = e;
    }
    return count;
}

static double side_of(const double a[2], const double b[2], const double c[2])
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static bool cross(const struct edge *p, const struct edge *q)
{
    return side_of(p->a, p->b, q->a) * side_of(p->a, p->b, q->b) < 0 &&
           side_of(q->a, q->b, p->a) * side_of(q->a, q->b, p->b) < 0;
}

static double pressing_area(const struct grid *grid)
{
    static struct edge low[3 * 2 * CELLS * CELLS], high[3 * 2 * CELLS * CELLS];
    size_t lows = edges_of(grid, false, low), highs = edges_of(grid, true, high);
    double sum = 0, third = SIDE * SIDE / (2 * CELLS * CELLS) / 3;
    for (size_t i = 0; i < 3 * 2 * grid->nx * grid->ny; i++) { /* a node's third of each of its triangles */
        double place[2]; /* of the upper one's; the lower one's lie over the upper as these over the lower */
        turned(grid->uv + 2 * grid->triangle[i], place);
        if (place[0] > 0 && place[0] < SIDE && place[1] > 0 && place[1] < SIDE)
            sum += 2 * third / 2;
    }
    for (size_t i = 0; i < lows; i++)
        for (size_t j = 0; j < highs; j++)
            if (cross(low + i, high + j))
                sum += fmin(low[i].area, high[j].area) / 2;
    return sum;
}

/* How far into the offset of half that width of transition `load` presses: kappa A s^2/(2 width) = load. */
static double depth_of(double load, double area, double offset)
{
    double s = sqrt(offset * load / (STIFFNESS * area));
    assert_true(s < offset / 2);
    return s;
}

/* Stiff sheets, so that they stay flat. */
static void test_layers__carry_the_weight_above_at_the_penaltys_distance(void **state)
{
    (void)state;
    enum { LAYERS = 5 };
    double density = 2, weight = density * SIDE * SIDE * GRAVITY, push = 0;
    struct stack stack;
    drape_options options = drape_options_default();
    stack_new(&stack, LAYERS, 1.1 * DRAPE_DEFAULT_THICKNESS, isotropic(density, 1e4, 10));
    lay_on_ground(&stack, MU);
    options.fit = true;
    options.tolerance = 1e-6;
    struct run run = run_new(&stack.setup->desc, &options);
    tell("five sheets", &run);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(run.report->self_intersections, 0);

    const drape_fit *fit = drape_sim_fit(run.sim);
    for (size_t i = 0; i < 3 * stack.setup->desc.triangles; i++)
        push += fit->pressure[stack.setup->desc.triangle[i]] * SIDE * SIDE / (2 * CELLS * CELLS) / 3;
    print_message("  the ground carries %.9g N of %.9g N\n", push, LAYERS * weight);
    assert_close(push, LAYERS * weight, 1e-6);
    double sunk = -mean_of(&stack, 0, run.x, 1), area = pressing_area(&stack.setup->grid);
    /* Sides of 24 mm are sampled against bodies in their middles, too: three points a triangle, each with
     * half a third of the three quarter triangles about it (solver/contact.h). */
    double sampled = (1 + 3 * 3.0 / 4 / 6) * SIDE * SIDE;
    assert_close(sunk, depth_of(LAYERS * weight, sampled, DRAPE_DEFAULT_OFFSET), 0.01);
    for (size_t l = 1; l < LAYERS; l++) {
        double gap = mean_of(&stack, l, run.x, 1) - mean_of(&stack, l - 1, run.x, 1);
        double depth = depth_of((double)(LAYERS - l) * weight, area, DRAPE_DEFAULT_THICKNESS);
        print_message("  under %zu sheets: %.4g um into the thickness, closed form %.4g um\n", LAYERS - l,
                      (DRAPE_DEFAULT_THICKNESS - gap) * 1e6, depth * 1e6);
        assert_close(DRAPE_DEFAULT_THICKNESS - gap, depth, 0.01);
    }
    run_done(&run);
    setup_free(stack.setup);
}

/* Sheets let go a little apart all arrive. The model of each step has to see every layer that it closes up
 * on: what it says must descend, or the heap is compressed at the first step and never comes apart. */
static void test_layers__let_go_apart_all_arrive(void **state)
{
    (void)state;
    enum { LAYERS = 20 };
    struct stack stack;
    drape_options options = drape_options_default();
    stack_new(&stack, LAYERS, 1.25 * DRAPE_DEFAULT_THICKNESS, isotropic(0.1, 50, 1e-5));
    lay_on_ground(&stack, MU); /* or the heap slides apart */
    stack.setup->material.friction = MU;
    options.max_iterations = 60;
    struct run run = run_new(&stack.setup->desc, &options);
    tell("twenty sheets", &run);
    for (size_t i = 1; i < run.rows; i++)
        assert_true(run.row[i].energy.potential < run.row[0].energy.potential);
    assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
    assert_int_equal(run.report->self_intersections, 0);
    for (size_t l = 1; l < LAYERS; l++) {
        double gap = mean_of(&stack, l, run.x, 1) - mean_of(&stack, l - 1, run.x, 1);
        assert_true(gap > 0.9 * DRAPE_DEFAULT_THICKNESS && gap < DRAPE_DEFAULT_THICKNESS);
    }
    run_done(&run);
    setup_free(stack.setup);
}

/* ---- friction between layers -------------------------------------------------------------------- */

/* A small sheet on a larger one, all of which is pinned; gravity is turned by `slope` (the tangent). */
static void slope_new(struct stack *stack, double slope)
{
    stack_new(stack, 2, 0.95 * DRAPE_DEFAULT_THICKNESS, isotropic(0.2, 400, 1e-4));
    struct setup *setup = stack->setup;
    double steepness = atan(slope);
    for (size_t i = 0; i < stack->each; i++) {
        setup->pin[setup->desc.pins++] = (uint32_t)i;
        for (size_t d = 0; d < 2; d++) /* the same cells, four times as many square metres */
            setup->grid.uv[2 * i + d] *= 2;
        setup->x[3 * i] = 2 * setup->x[3 * i] - SIDE / 2;
        setup->x[3 * i + 2] = 2 * setup->x[3 * i + 2] + SIDE / 2;
    }
    lay_on_ground(stack, 0); /* far below: what nothing could hold is refused */
    stack->ground.point[1] = -1;
    setup->material.friction = MU;
    setup->desc.gravity[0] = GRAVITY * sin(steepness);
    setup->desc.gravity[1] = -GRAVITY * cos(steepness);
}

static double slid(const struct stack *stack, const struct run *run)
{
    return mean_of(stack, 1, run->x, 0) - mean_of(stack, 1, stack->setup->x, 0);
}

static void test_layers__a_sheet_on_a_sheet_is_held_below_the_angle_and_slides_above(void **state)
{
    (void)state;
    const drape_method method[] = {DRAPE_METHOD_AUTO, DRAPE_METHOD_STOP_AND_GO, DRAPE_METHOD_QUASI_STATIC};
    for (size_t m = 0; m < sizeof method / sizeof *method; m++)
        for (int above = 0; above < 2; above++) {
            struct stack stack;
            drape_options options = drape_options_default();
            slope_new(&stack, (above ? 1.05 : 0.95) * MU);
            options.method = method[m];
            options.max_iterations = 500;
            struct run run = run_new(&stack.setup->desc, &options);
            tell(above ? "above" : "below", &run);
            print_message("  slid %.4g mm\n", slid(&stack, &run) * 1e3);
            if (above) {
                assert_int_not_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
                assert_true(slid(&stack, &run) > 2e-3);
            } else { /* E'(l) = 0.95 mu N at l = (1 - sqrt(0.05)) of the slip */
                assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
                assert_near(slid(&stack, &run), 0.5e-3 * (1 - sqrt(0.05)), 1e-5, 1);
            }
            assert_int_equal(run.report->self_intersections, 0);
            run_done(&run);
            setup_free(stack.setup);
        }
}

/* The tolerance is out of reach, so that the iterations go on. */
static void test_layers__what_is_held_does_not_creep(void **state)
{
    (void)state;
    const uint32_t iterations[2] = {500, 10500};
    double where[2];
    for (int late = 0; late < 2; late++) {
        struct stack stack;
        drape_options options = drape_options_default();
        slope_new(&stack, 0.9 * MU);
        options.tolerance = 1e-300;
        options.max_iterations = iterations[late];
        struct run run = run_new(&stack.setup->desc, &options);
        tell("for long", &run);
        where[late] = slid(&stack, &run);
        run_done(&run);
        setup_free(stack.setup);
    }
    print_message("  crept by %.3g m in 10 000 iterations\n", where[1] - where[0]);
    assert_near(where[0], where[1], 1e-6, 1);
}

/* ---- a fold ------------------------------------------------------------------------------------- */

/* A strip held at one end that turns back over itself half way, 20 mm above, and falls on itself. */
static struct setup *fold_new(drape_body *ground)
{
    const double radius = 0.01, length = 0.4;
    struct setup *setup = setup_new(grid_strip(GRID_ALTERNATING, 40, 4, length), isotropic(0.2, 400, 1e-5));
    for (size_t i = 0; i < setup->grid.vertices; i++) {
        double u = setup->grid.uv[2 * i], straight = length / 2, *p = setup->x + 3 * i;
        double angle = fmin(fmax((u - straight) / radius, 0), acos(-1));
        double back = fmax(u - straight - acos(-1) * radius, 0);
        p[0] = fmin(u, straight) + radius * sin(angle) - back;
        p[1] = radius * (1 - cos(angle));
    }
    pin_columns(setup, 2);
    *ground = (drape_body){.kind = DRAPE_BODY_PLANE,
                           .offset = 0.003,
                           .friction = MU,
                           .point = {0, -0.003, 0},
                           .axis = {0, 1, 0}};
    setup->desc.body = ground;
    setup->desc.bodies = 1;
    return setup;
}

/* Crossings of the setup's cloth at x. */
static uint32_t crossings_at(struct setup *setup, const double *x)
{
    drape_options options = drape_options_default();
    drape_scene_desc desc = setup->desc;
    desc.positions = x;
    desc.self_contact = DRAPE_SELF_CONTACT_ON;
    options.max_iterations = 0;
    struct run run = run_new(&desc, &options);
    uint32_t crossings = run.report->self_intersections;
    run_done(&run);
    return crossings;
}

static void test_layers__a_fold_does_not_pass_through_itself(void **state)
{
    (void)state;
    const drape_method method[] = {DRAPE_METHOD_AUTO, DRAPE_METHOD_STOP_AND_GO, DRAPE_METHOD_DYNAMIC};
    drape_body ground;
    for (size_t m = 0; m < sizeof method / sizeof *method; m++) {
        struct setup *setup = fold_new(&ground);
        drape_options options = drape_options_default();
        options.method = method[m];
        options.max_iterations = 1000;
        assert_int_equal(crossings_at(setup, setup->x), 0);
        struct run run = run_new(&setup->desc, &options);
        tell(drape_method_name(method[m]), &run);
        if (method[m] != DRAPE_METHOD_DYNAMIC)
            assert_int_equal(run.report->verdict, DRAPE_VERDICT_AT_REST);
        assert_int_equal(run.report->self_intersections, 0);
        run_done(&run);
        setup_free(setup);
    }
    struct setup *setup = fold_new(&ground); /* without self-contact it does */
    drape_options options = drape_options_default();
    setup->desc.self_contact = DRAPE_SELF_CONTACT_OFF;
    struct run run = run_new(&setup->desc, &options);
    tell("switched off", &run);
    assert_int_equal(run.report->self_intersections, DRAPE_NOT_COUNTED);
    assert_true(crossings_at(setup, run.x) > 0);
    run_done(&run);
    setup_free(setup);
}

/* One sheet falls on another, all of which is pinned, at 6 m/s: in explicit steps, which only the limit on
 * moves stops. What it stops has lost its speed, else it presses on with all of it. */
static void test_layers__explicit_steps_do_not_run_away_where_layers_stop(void **state)
{
    (void)state;
    struct stack stack;
    drape_options options = drape_options_default();
    stack_new(&stack, 2, 0.02, isotropic(0.1, 50, 1e-5));
    for (size_t i = 0; i < stack.each; i++)
        stack.setup->pin[stack.setup->desc.pins++] = (uint32_t)i;
    lay_on_ground(&stack, 0);
    stack.ground.point[1] = -1;
    stack.setup->desc.gravity[1] = -1000;
    options.method = DRAPE_METHOD_DYNAMIC;
    options.integrator = DRAPE_RK4;
    options.time_step = 2e-4;
    options.max_iterations = 500;
    struct run run = run_new(&stack.setup->desc, &options);
    tell("rk4", &run);
    double fall = 0.1 * SIDE * SIDE * 1000 * 0.02, most = -INFINITY;
    for (size_t i = 0; i < run.rows; i++)
        most = fmax(most, total_energy(run.row + i));
    print_message("  from 0 to %.3g J at most, of %.3g J that it fell by\n", most, fall);
    assert_true(most < fall); /* the penalty is too stiff for this step: the bounce gains something */
    assert_true(run.report->state.energy.gravity < -0.8 * fall);
    assert_int_equal(run.report->self_intersections, 0);
    run_done(&run);
    setup_free(stack.setup);
}

/* The uppermost of three sheets presses harder on the middle one, all of which is pinned, than the penalty
 * bears, so that its pairs close as far as any step lets them. The lowest, pinned along one edge, comes to
 * hang all the same. */
static void test_layers__where_two_are_shut_the_rest_goes_on(void **state)
{
    (void)state;
    struct stack stack;
    drape_options options = drape_options_default();
    stack_new(&stack, 3, 0.01, isotropic(0.1, 1e5, 1e-5));
    struct setup *setup = stack.setup;
    for (size_t i = 0; i < 2 * stack.each; i++)
        if (i >= stack.each || setup->grid.uv[2 * i] == 0)
            setup->pin[setup->desc.pins++] = (uint32_t)i;
    lay_on_ground(&stack, 0);
    stack.ground.point[1] = -1;
    setup->desc.gravity[1] = -2e5;
    options.max_iterations = 100;
    struct run run = run_new(&setup->desc, &options);
    tell("pressed shut", &run);
    print_message("  the lowest has sunk by %.3g mm, the uppermost is %.3g um above the middle one\n",
                  -1e3 * mean_of(&stack, 0, run.x, 1),
                  1e6 * (mean_of(&stack, 2, run.x, 1) - mean_of(&stack, 1, run.x, 1)));
    assert_true(mean_of(&stack, 0, run.x, 1) < -0.48 * SIDE);
    assert_int_equal(run.report->self_intersections, 0);
    run_done(&run);
    setup_free(setup);
}

/* ---- the plan ----------------------------------------------------------------------------------- */

static const drape_term *self_contact_term(const drape_report *report)
{
    for (size_t t = 0; t < report->terms; t++)
        if (!strcmp(report->term[t].name, "self-contact"))
            return report->term + t;
    fail_msg("no such term");
    return NULL;
}

static void test_layers__the_plan_says_whether_cloth_feels_cloth_and_why(void **state)
{
    (void)state;
    static const struct {
        drape_self_contact asked;
        size_t layers;
        bool ground;
        drape_method method;
        bool kept;
        const char *reason;
    } row[] = {
        {DRAPE_SELF_CONTACT_AUTO, 1, false, DRAPE_METHOD_AUTO, false, "auto: one piece, no seams, no body"},
        {DRAPE_SELF_CONTACT_AUTO, 1, true, DRAPE_METHOD_AUTO, true, ""},
        {DRAPE_SELF_CONTACT_AUTO, 2, false, DRAPE_METHOD_STOP_AND_GO, true, ""},
        {DRAPE_SELF_CONTACT_AUTO, 2, true, DRAPE_METHOD_NEWTON, false,
         "auto: plain Newton takes its steps whole"},
        {DRAPE_SELF_CONTACT_ON, 1, false, DRAPE_METHOD_AUTO, true, ""},
        {DRAPE_SELF_CONTACT_OFF, 2, true, DRAPE_METHOD_AUTO, false, "switched off"},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        struct stack stack;
        drape_options options = drape_options_default();
        stack_new(&stack, row[i].layers, 0.01, isotropic(0.1, 50, 1e-5));
        for (size_t l = 0; l < row[i].layers; l++)
            stack.setup->pin[stack.setup->desc.pins++] = (uint32_t)(l * stack.each);
        if (row[i].ground)
            lay_on_ground(&stack, 0);
        stack.setup->desc.self_contact = row[i].asked;
        options.method = row[i].method;
        options.max_iterations = 1;
        struct run run = run_new(&stack.setup->desc, &options);
        const drape_term *term = self_contact_term(run.report);
        assert_int_equal(term->kept, row[i].kept);
        assert_string_equal(term->reason, row[i].reason);
        assert_int_equal(term->bytes > 0, row[i].kept);
        assert_int_equal(run.report->self_intersections, row[i].kept ? 0 : DRAPE_NOT_COUNTED);
        run_done(&run);
        setup_free(stack.setup);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_layers__carry_the_weight_above_at_the_penaltys_distance),
        cmocka_unit_test(test_layers__let_go_apart_all_arrive),
        cmocka_unit_test(test_layers__a_sheet_on_a_sheet_is_held_below_the_angle_and_slides_above),
        cmocka_unit_test(test_layers__what_is_held_does_not_creep),
        cmocka_unit_test(test_layers__a_fold_does_not_pass_through_itself),
        cmocka_unit_test(test_layers__explicit_steps_do_not_run_away_where_layers_stop),
        cmocka_unit_test(test_layers__where_two_are_shut_the_rest_goes_on),
        cmocka_unit_test(test_layers__the_plan_says_whether_cloth_feels_cloth_and_why),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
