/* test_scene.c - what a scene refuses and where it says the fault is; welding. */
#include "test.h"

#include "scarce.h"
#include "scene.h"
#include "stretch.h"

/* Two unit squares side by side, 5 mm apart: vertices 0-3 and 4-7, to be sewn 1-4 and 3-6. */
struct example {
    double positions[24], pattern[16];
    uint32_t triangle[12], seam[4], pin[2];
    drape_material material;
    drape_scene_desc desc;
};

static struct example make(void)
{
    struct example e = {
        .positions = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 1.005, 0, 0, 2, 0, 0, 1.005, 1, 0, 2, 1, 0},
        .pattern = {0, 0, 1, 0, 0, 1, 1, 1, 5, 5, 6, 5, 5, 6, 6, 6},
        .triangle = {0, 1, 2, 1, 3, 2, 4, 5, 6, 5, 7, 6},
        .seam = {1, 4, 3, 6},
        .pin = {0, 2},
        .material = {.density = 0.1,
                     .stretch_weft = 10,
                     .stretch_warp = 10,
                     .stretch_shear = 5,
                     .bend_weft = 1e-5,
                     .bend_warp = 1e-5,
                     .bend_twist = 5e-6},
    };
    e.desc = drape_scene_desc_default();
    e.desc.vertices = 8;
    e.desc.triangles = 4;
    e.desc.seams = 2;
    e.desc.pins = 2;
    e.desc.materials = 1;
    return e;
}

static void bind(struct example *e) /* after any copy */
{
    e->desc.positions = e->positions;
    e->desc.pattern = e->pattern;
    e->desc.triangle = e->triangle;
    e->desc.seam = e->seam;
    e->desc.pin = e->pin;
    e->desc.material = &e->material;
}

static void refused(struct example *e, drape_place place, int64_t element, const char *member,
                    const char *says)
{
    drape_error error = {0};
    drape_scene *scene = NULL;
    assert_int_equal(drape_scene_check(&e->desc, &error), DRAPE_EINVAL);
    if (error.place != place || error.element != element || !strstr(error.message, says))
        fail_msg("place %d element %lld: %s", error.place, (long long)error.element, error.message);
    if (member)
        assert_string_equal(error.member, member);
    assert_int_equal(drape_scene_new(&e->desc, &scene, NULL), DRAPE_EINVAL); /* reterr may be NULL */
    assert_null(scene);
}

static void test_scene__the_pattern_of_the_start_is_checked_and_compared(void **state)
{
    (void)state;
    struct example e = make();
    double old[16];
    drape_scene *scene = NULL;
    bind(&e);
    e.desc.start_pattern = old;
    for (int i = 0; i < 16; i++) /* the pieces in places of their own: the sizes alone count */
        old[i] = e.pattern[i] + (i < 8 ? 7 : -2);
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_true(scene->draped && !scene->old_stretch && scene->change == 0);
    drape_scene_free(scene);
    for (int i = 0; i < 16; i++)
        old[i] = e.pattern[i] / (i % 2 ? 1.25 : 1);
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_close(scene->change, 0.25, 1e-12);
    for (size_t t = 0; t < 4; t++) {
        assert_close(scene->old_stretch[3 * t], 1, 1e-12);
        assert_near(scene->old_stretch[3 * t + 1], 0, 1e-12, 1);
        assert_close(scene->old_stretch[3 * t + 2], 0.8, 1e-12);
    }
    drape_scene_free(scene);
    old[9] = NAN;
    refused(&e, DRAPE_AT_PATTERN, 4, NULL, "start's");
    old[9] = 0;
    old[8] = old[12] = old[10] = 5; /* triangle 2 on a line */
    refused(&e, DRAPE_AT_TRIANGLE, 2, NULL, "degenerate");
}

static void test_scene__welds_seams_in_the_order_of_the_vertices(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    drape_scene *scene = NULL;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    const uint32_t expected[] = {0, 1, 2, 3, 1, 4, 3, 5};
    assert_memory_equal(scene->vertex_node, expected, sizeof expected);
    assert_int_equal(scene->mesh->nodes, 6);
    assert_int_equal(scene->parts, 1);
    assert_non_null(scene->pieces); /* 5 mm is wider than the weld gap */
    assert_int_equal(scene->pieces->nodes, 8);
    double x[18];
    dr_scene_weld(scene, e.positions, x);
    assert_close(x[3], 1.0025, 1e-15);
    assert_true(x[0] == 0 && x[3 * 5] == 2);
    assert_true(dr_scene_bytes(scene) > 1000);
    drape_scene_free(scene);
}

static void test_scene__closed_seams_need_no_sewing(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.positions[12] = e.positions[18] = 1;
    drape_scene *scene = NULL;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_null(scene->pieces);
    assert_null(scene->pieces_bend);
    drape_scene_free(scene);
}

static void test_scene__a_pinned_node_sits_at_its_pin(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.pin[1] = 4;
    drape_scene *scene = NULL;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    double x[18];
    dr_scene_weld(scene, e.positions, x);
    assert_true(x[3] == 1.005);
    assert_true(scene->mesh->held[1]);
    drape_scene_free(scene);
}

static void test_scene__names_the_vertex_that_is_not_finite(void **state)
{
    (void)state;
    const double bad[] = {NAN, INFINITY, -INFINITY};
    for (int k = 0; k < 3; k++) {
        struct example e = make();
        bind(&e);
        e.positions[16] = bad[k];
        refused(&e, DRAPE_AT_VERTEX, 5, NULL, "finite");
        e = make();
        bind(&e);
        e.pattern[7] = bad[k];
        refused(&e, DRAPE_AT_PATTERN, 3, NULL, "finite");
        e = make();
        bind(&e);
        e.desc.gravity[1] = bad[k];
        refused(&e, DRAPE_AT_SCENE, -1, "gravity", "finite");
    }
}

static void test_scene__names_every_index_out_of_range(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.triangle[7] = 7; /* the last that exists */
    e.triangle[8] = 8; /* one past */
    refused(&e, DRAPE_AT_TRIANGLE, 2, NULL, "vertex 8 does not exist");
    e = make();
    bind(&e);
    e.seam[3] = 8;
    refused(&e, DRAPE_AT_SEAM, 1, NULL, "vertex 8 does not exist");
    e = make();
    bind(&e);
    e.pin[1] = 8;
    refused(&e, DRAPE_AT_PIN, 1, NULL, "vertex 8 does not exist");
    e = make();
    bind(&e);
    const uint32_t of_material[] = {0, 0, 0, 1};
    e.desc.triangle_material = of_material;
    refused(&e, DRAPE_AT_TRIANGLE_MATERIAL, 3, NULL, "material 1 does not exist");
}

static void test_scene__names_the_material_member_at_fault(void **state)
{
    (void)state;
    const struct {
        size_t offset;
        const char *member;
        double bad;
    } row[] = {
        {offsetof(drape_material, density), "density", 0},
        {offsetof(drape_material, density), "density", NAN},
        {offsetof(drape_material, stretch_weft), "stretch_weft", -1},
        {offsetof(drape_material, stretch_warp), "stretch_warp", 0},
        {offsetof(drape_material, stretch_shear), "stretch_shear", INFINITY},
        {offsetof(drape_material, poisson), "poisson", 1},
        {offsetof(drape_material, poisson), "poisson", -1},
        {offsetof(drape_material, poisson), "poisson", NAN},
        {offsetof(drape_material, bend_weft), "bend_weft", -1e-9},
        {offsetof(drape_material, bend_warp), "bend_warp", NAN},
        {offsetof(drape_material, bend_twist), "bend_twist", -1},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        struct example e = make();
        bind(&e);
        memcpy((char *)&e.material + row[i].offset, &row[i].bad, sizeof(double));
        refused(&e, DRAPE_AT_MATERIAL, 0, row[i].member, "");
    }
}

static const struct {
    size_t curve;
    const char *member;
} CURVE[] = {{offsetof(drape_material, curve_weft), "stretch_weft"},
             {offsetof(drape_material, curve_warp), "stretch_warp"},
             {offsetof(drape_material, curve_shear), "stretch_shear"}};

static void test_scene__names_the_curve_at_fault_and_its_point(void **state)
{
    (void)state;
    const struct {
        size_t points;
        double point[6];
        const char *says;
    } row[] = {
        {3, {0, 0, 0.1, 2, 0.1, 3}, "point 2 has strain 0.1, not above"},
        {2, {0.1, 2, 0.2, 1}, "point 1 has stress 1, below"},
        {3, {0, 0, 0.1, 0, 0.2, 1}, "point 1 has stress 0 after 0: the first step must rise"},
        {2, {0.1, 2, 0.2, 2}, "the last step"},
        {1, {-0.1, 2}, "point 0 has strain -0.1"},
        {1, {0.1, -2}, "point 0 has stress -2"},
        {2, {0, 1, 0.1, 2}, "starts at rest"},
        {1, {0, 0}, "beyond rest"},
        {2, {0.1, 2, NAN, 3}, "point 1 is not finite"},
        {2, {0.1, 2, 0.2, INFINITY}, "point 1 is not finite"},
        {1, {1e-300, 1e300}, "rises by inf"},
        {1, {1, nextafter(DRAPE_MAX_MATERIAL, INFINITY)}, "rises by 1e+12"},
        {1, {1, nextafter(DRAPE_MIN_MATERIAL, 0)}, "the first step must rise"},
        {DRAPE_MAX_CURVE_POINTS + 1, {0.1, 2}, "65 points are more than the limit of 64"},
    };
    for (size_t c = 0; c < 3; c++) {
        for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
            struct example e = make();
            bind(&e);
            drape_curve curve = {row[i].points, row[i].point};
            memcpy((char *)&e.material + CURVE[c].curve, &curve, sizeof curve);
            refused(&e, DRAPE_AT_MATERIAL, 0, CURVE[c].member, row[i].says);
        }
        struct example e = make();
        bind(&e);
        drape_curve curve = {1, NULL};
        memcpy((char *)&e.material + CURVE[c].curve, &curve, sizeof curve);
        refused(&e, DRAPE_AT_MATERIAL, 0, CURVE[c].member, "missing");
        for (int most = 0; most < 2; most++) { /* exactly the limits are fine */
            const double limit[] = {1, most ? DRAPE_MAX_MATERIAL : DRAPE_MIN_MATERIAL};
            curve.point = limit;
            memcpy((char *)&e.material + CURVE[c].curve, &curve, sizeof curve);
            assert_int_equal(drape_scene_check(&e.desc, NULL), DRAPE_OK);
        }
        curve.point = (const double[]){0.1, 2};
        memcpy((char *)&e.material + CURVE[c].curve, &curve, sizeof curve);
        e.material.poisson = 1e-9;
        refused(&e, DRAPE_AT_MATERIAL, 0, "poisson", "beside a strain-stress curve");
    }
}

static void test_scene__copies_curves_and_reads_no_number_beside_them(void **state)
{
    (void)state;
    double weft[2 * DRAPE_MAX_CURVE_POINTS], shear[] = {0.2, 3};
    for (int i = 0; i < DRAPE_MAX_CURVE_POINTS; i++) { /* exactly the limit is fine */
        weft[2 * i] = 0.01 * (i + 1);
        weft[2 * i + 1] = i + 1;
    }
    struct example e = make();
    bind(&e);
    drape_scene *plain = NULL, *scene = NULL;
    assert_int_equal(drape_scene_new(&e.desc, &plain, NULL), DRAPE_OK);
    e.material.curve_weft = (drape_curve){DRAPE_MAX_CURVE_POINTS, weft};
    e.material.curve_shear = (drape_curve){1, shear};
    e.material.stretch_weft = e.material.stretch_shear = NAN;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    const drape_curve *kept = &scene->material->curve_weft;
    assert_true(kept->point != weft && kept->points == DRAPE_MAX_CURVE_POINTS);
    assert_memory_equal(kept->point, weft, sizeof weft);
    assert_true(scene->material->curve_shear.point != shear);
    assert_memory_equal(scene->material->curve_shear.point, shear, sizeof shear);
    assert_null(scene->material->curve_warp.point);
    assert_null(plain->curve_point);
    assert_int_equal(dr_scene_bytes(scene) - dr_scene_bytes(plain), sizeof weft + sizeof shear);
    drape_scene_free(plain);
    drape_scene_free(scene);
}

#ifdef CAN_FAIL_ALLOCATIONS
static void test_scene__every_allocation_of_a_curved_cloth_may_fail(void **state)
{
    (void)state;
    const double point[] = {0.1, 2, 0.2, 6};
    struct example e = make();
    bind(&e);
    e.material.curve_weft = e.material.curve_warp = e.material.curve_shear = (drape_curve){2, point};
    long failed = 0;
    for (long n = 0;; n++) {
        drape_scene *scene = NULL;
        struct dr_stretch *stretch = NULL;
        long before = held;
        countdown = n;
        drape_status status = drape_scene_new(&e.desc, &scene, NULL);
        if (status >= 0)
            status = dr_stretch_new(scene->mesh, scene->material, scene->materials, &stretch, NULL);
        bool reached = countdown < 0;
        countdown = -1;
        dr_stretch_free(stretch);
        drape_scene_free(scene);
        assert_int_equal(held, before);
        if (!reached)
            break;
        if (status < 0) { /* a failure may also be survived, as by CHOLMOD's second try */
            assert_int_equal(status, DRAPE_ENOMEM);
            failed++;
        }
    }
    print_message("made %ld allocations fail\n", failed);
    assert_true(failed > 20);
}
#endif

static void test_scene__blames_the_seam_that_ruins_the_surface(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.seam[0] = 0, e.seam[1] = 1; /* two corners of one triangle */
    refused(&e, DRAPE_AT_SEAM, 0, NULL, "once sewn");
    /* A third flap on the edge that two squares already share. */
    struct example flap = make();
    bind(&flap);
    double positions[33], pattern[22];
    uint32_t triangle[15], seam[8] = {1, 4, 3, 6, 1, 8, 3, 9};
    memcpy(positions, flap.positions, sizeof flap.positions);
    memcpy(pattern, flap.pattern, sizeof flap.pattern);
    memcpy(triangle, flap.triangle, sizeof flap.triangle);
    const double more[] = {1, 0, 0, 1, 1, 0, 1, 0, 1}, flat[] = {0, 0, 0, 1, 1, 0};
    memcpy(positions + 24, more, sizeof more);
    memcpy(pattern + 16, flat, sizeof flat);
    triangle[12] = 8, triangle[13] = 10, triangle[14] = 9;
    flap.desc.positions = positions;
    flap.desc.pattern = pattern;
    flap.desc.triangle = triangle;
    flap.desc.seam = seam;
    flap.desc.vertices = 11;
    flap.desc.triangles = 5;
    flap.desc.seams = 4;
    refused(&flap, DRAPE_AT_SEAM, 2, NULL, "shared by 3 triangles");
}

/* Many points may be sewn to one: listed as a star or as a chain, in any order, twice or in a ring. */
static void test_scene__many_vertices_are_sewn_to_one_point(void **state)
{
    (void)state;
    static const struct {
        size_t seams;
        uint32_t seam[8];
    } lists[] = {{3, {0, 3, 0, 6, 0, 9}},       /* a star */
                 {3, {0, 3, 3, 6, 6, 9}},       /* a chain */
                 {3, {9, 6, 3, 0, 6, 3}},       /* the same from behind */
                 {4, {0, 3, 3, 6, 6, 9, 9, 0}}, /* a ring */
                 {4, {0, 3, 6, 9, 9, 3, 3, 0}}};
    double positions[36], pattern[24], x[27];
    uint32_t triangle[12], pin[1] = {1};
    for (uint32_t p = 0; p < 4; p++) /* four triangles with their first corners about the origin */
        for (uint32_t k = 0; k < 3; k++) {
            double flat[2] = {k == 1, k == 2},
                   turned[2] = {p % 2 ? -flat[1] : flat[0], p % 2 ? flat[0] : flat[1]};
            double sign = p < 2 ? 1 : -1, away = 0.01 * (p + 1.0);
            memcpy(pattern + 2 * (3 * p + k), flat, sizeof flat);
            memcpy(positions + 3 * (3 * p + k), (double[]){sign * turned[0], sign * turned[1], away},
                   3 * sizeof away);
            triangle[3 * p + k] = 3 * p + k;
        }
    for (size_t l = 0; l < sizeof lists / sizeof *lists; l++) {
        struct example e = make();
        bind(&e);
        e.desc.vertices = 12;
        e.desc.positions = positions;
        e.desc.pattern = pattern;
        e.desc.triangle = triangle;
        e.desc.seam = lists[l].seam;
        e.desc.seams = lists[l].seams;
        e.desc.pin = pin;
        e.desc.pins = 1;
        drape_scene *scene = NULL;
        assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
        assert_int_equal(scene->mesh->nodes, 9);
        assert_int_equal(scene->parts, 1);
        for (uint32_t v = 0; v < 12; v += 3)
            assert_int_equal(scene->vertex_node[v], 0);
        dr_scene_weld(scene, positions, x);
        assert_close(x[2], 0.025, 1e-12); /* the mean of the four, however they are listed */
        drape_scene_free(scene);
    }
}

static void test_scene__a_vertex_sewn_to_itself_asks_for_nothing(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.seam[1] = 1;
    drape_scene *scene = NULL;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(scene->seams, 1);
    assert_int_equal(scene->seam[0], 3);
    assert_int_equal(scene->mesh->nodes, 7);
    drape_scene_free(scene);
}

static void test_scene__pins_of_one_node_must_agree(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.pin[0] = 1, e.pin[1] = 4; /* sewn together, 5 mm apart */
    refused(&e, DRAPE_AT_PIN, 1, NULL, "pinned 0.005 m apart");
    e.positions[12] = 1;
    assert_int_equal(drape_scene_check(&e.desc, NULL), DRAPE_OK);
}

static void test_scene__a_piece_that_nothing_holds_is_refused(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.desc.seams = 0; /* the second square is now on its own */
    refused(&e, DRAPE_AT_VERTEX, 4, NULL, "nothing holds");
    const drape_body floor = {
        .kind = DRAPE_BODY_PLANE, .offset = 0.003, .point = {0, -1, 0}, .axis = {0, 1, 0}};
    e.desc.body = &floor;
    e.desc.bodies = 1;
    assert_int_equal(drape_scene_check(&e.desc, NULL), DRAPE_OK);
}

static void test_scene__thickness_and_self_contact_have_limits(void **state)
{
    (void)state;
    static const double fine[] = {DRAPE_MIN_THICKNESS, DRAPE_DEFAULT_THICKNESS, DRAPE_MAX_THICKNESS};
    const double bad[] = {0,   -0.001,  nextafter(DRAPE_MIN_THICKNESS, 0), nextafter(DRAPE_MAX_THICKNESS, 1),
                          NAN, INFINITY};
    struct example e = make();
    bind(&e);
    assert_close(e.desc.thickness, DRAPE_DEFAULT_THICKNESS, 0);
    for (size_t i = 0; i < sizeof fine / sizeof *fine; i++) {
        drape_scene *scene = NULL;
        e.desc.thickness = fine[i];
        e.desc.self_contact = DRAPE_SELF_CONTACT_OFF;
        assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
        assert_close(scene->thickness, fine[i], 0);
        assert_int_equal(scene->self_contact, DRAPE_SELF_CONTACT_OFF);
        drape_scene_free(scene);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        e.desc.thickness = bad[i];
        refused(&e, DRAPE_AT_SCENE, -1, "thickness", "is not between");
    }
    e.desc.thickness = DRAPE_DEFAULT_THICKNESS;
    e.desc.self_contact = DRAPE_SELF_CONTACT_OFF + 1;
    refused(&e, DRAPE_AT_SCENE, -1, "self_contact", "out of range");
}

static void test_scene__counts_have_limits(void **state)
{
    (void)state;
    static const struct {
        size_t offset, most;
        const char *member;
    } row[] = {
        {offsetof(drape_scene_desc, vertices), DRAPE_MAX_VERTICES, "vertices"},
        {offsetof(drape_scene_desc, triangles), DRAPE_MAX_TRIANGLES, "triangles"},
        {offsetof(drape_scene_desc, bodies), DRAPE_MAX_BODIES, "bodies"},
    };
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        struct example e = make();
        bind(&e);
        size_t past = row[i].most + 1;
        memcpy((char *)&e.desc + row[i].offset, &past, sizeof past);
        refused(&e, DRAPE_AT_SCENE, -1, row[i].member, "more than the limit");
    }
    drape_body body[DRAPE_MAX_BODIES];
    for (int i = 0; i < DRAPE_MAX_BODIES; i++) /* exactly the limit is fine */
        body[i] =
            (drape_body){.kind = DRAPE_BODY_SPHERE, .offset = 0.003, .radius = 0.1, .point = {i, -3, 0}};
    struct example e = make();
    bind(&e);
    e.desc.body = body;
    e.desc.bodies = DRAPE_MAX_BODIES;
    assert_int_equal(drape_scene_check(&e.desc, NULL), DRAPE_OK);

    e = make();
    bind(&e);
    e.desc.triangle = NULL;
    refused(&e, DRAPE_AT_SCENE, -1, "triangles", "missing");
    e = make();
    bind(&e);
    e.desc.triangles = 0;
    refused(&e, DRAPE_AT_SCENE, -1, "triangles", "at least 1");
    e = make();
    bind(&e);
    e.desc.materials = 0;
    refused(&e, DRAPE_AT_SCENE, -1, "materials", "at least 1");
}

static void test_scene__a_vertex_of_no_triangle_is_carried_along(void **state)
{
    (void)state;
    struct example e = make();
    bind(&e);
    e.desc.triangles = 3; /* vertex 7 is used by the last triangle only */
    drape_scene *scene = NULL;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(scene->vertex_node[7], DR_NONE);
    assert_int_equal(scene->mesh->nodes, 5);
    drape_scene_free(scene);
    e.seam[3] = 7;
    refused(&e, DRAPE_AT_SEAM, 1, NULL, "belongs to no triangle");
}

/* Two garments of two squares each, whose seams stand in turns. */
static void test_scene__seams_of_several_garments_go_in_the_order_of_these(void **state)
{
    (void)state;
    struct example e = make();
    double positions[48], pattern[32];
    uint32_t triangle[24];
    const uint32_t seam[] = {9, 12, 1, 4, 11, 14, 3, 6}, pin[] = {0, 8};
    const uint32_t sorted[] = {1, 4, 3, 6, 9, 12, 11, 14};
    for (int i = 0; i < 48; i++)
        positions[i] = e.positions[i % 24] + (i >= 24 && i % 3 == 2 ? 0.5 : 0);
    for (int i = 0; i < 32; i++)
        pattern[i] = e.pattern[i % 16];
    for (int i = 0; i < 24; i++)
        triangle[i] = e.triangle[i % 12] + (i >= 12 ? 8 : 0);
    bind(&e);
    e.desc.vertices = 16;
    e.desc.triangles = 8;
    e.desc.seams = 4;
    e.desc.positions = positions;
    e.desc.pattern = pattern;
    e.desc.triangle = triangle;
    e.desc.seam = seam;
    e.desc.pin = pin;
    drape_scene *scene = NULL;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(scene->parts, 2);
    assert_memory_equal(scene->seam, sorted, sizeof sorted);
    for (uint32_t v = 0; v < 16; v++)
        assert_int_equal(scene->piece_part[v], v / 8);
    drape_scene_free(scene);
    e.desc.vertices = 8;
    e.desc.triangles = 4;
    e.desc.seams = 2;
    bind(&e);
    e.desc.pins = 1;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_null(scene->piece_part); /* one garment has no need of it */
    drape_scene_free(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_scene__the_pattern_of_the_start_is_checked_and_compared),
        cmocka_unit_test(test_scene__seams_of_several_garments_go_in_the_order_of_these),
        cmocka_unit_test(test_scene__welds_seams_in_the_order_of_the_vertices),
        cmocka_unit_test(test_scene__closed_seams_need_no_sewing),
        cmocka_unit_test(test_scene__a_pinned_node_sits_at_its_pin),
        cmocka_unit_test(test_scene__names_the_vertex_that_is_not_finite),
        cmocka_unit_test(test_scene__names_every_index_out_of_range),
        cmocka_unit_test(test_scene__names_the_material_member_at_fault),
        cmocka_unit_test(test_scene__names_the_curve_at_fault_and_its_point),
        cmocka_unit_test(test_scene__copies_curves_and_reads_no_number_beside_them),
#ifdef CAN_FAIL_ALLOCATIONS
        cmocka_unit_test(test_scene__every_allocation_of_a_curved_cloth_may_fail),
#endif
        cmocka_unit_test(test_scene__blames_the_seam_that_ruins_the_surface),
        cmocka_unit_test(test_scene__many_vertices_are_sewn_to_one_point),
        cmocka_unit_test(test_scene__a_vertex_sewn_to_itself_asks_for_nothing),
        cmocka_unit_test(test_scene__pins_of_one_node_must_agree),
        cmocka_unit_test(test_scene__a_piece_that_nothing_holds_is_refused),
        cmocka_unit_test(test_scene__thickness_and_self_contact_have_limits),
        cmocka_unit_test(test_scene__counts_have_limits),
        cmocka_unit_test(test_scene__a_vertex_of_no_triangle_is_carried_along),
    };
    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
