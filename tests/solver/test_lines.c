/* test_lines.c - elastics, folds and tacks of a scene: what is refused and where, limits, what they become.
 */
#include "test.h"

#include "cloth.h"
#include "lines.h"
#include "scarce.h"

/* Two unit squares side by side, touching, sewn 1-4 and 3-6, over a tetrahedron:
 *
 *     2 --- 3 6 --- 7
 *     |   / | |   / |
 *     0 --- 1 4 --- 5
 */
struct example {
    double positions[24], pattern[16], corner[12];
    uint32_t triangle[12], seam[4], pin[1], face[12], elastic_edge[4], fold_edge[4];
    drape_material material;
    drape_body body[2];
    drape_elastic elastic[2];
    drape_fold fold[2];
    drape_tack tack[2];
    drape_scene_desc desc;
};

static void make(struct example *e)
{
    *e = (struct example){
        .positions = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 1, 0, 0, 2, 0, 0, 1, 1, 0, 2, 1, 0},
        .pattern = {0, 0, 1, 0, 0, 1, 1, 1, 5, 5, 6, 5, 5, 6, 6, 6},
        .corner = {0, 0, -1, 0.1, 0, -1, 0, 0.1, -1, 0, 0, -0.9},
        .triangle = {0, 1, 3, 0, 3, 2, 4, 5, 7, 4, 7, 6},
        .seam = {1, 4, 3, 6},
        .face = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3},
        .elastic_edge = {5, 7, 4, 6},
        .fold_edge = {0, 3, 6, 4},
        .material = {.density = 0.1,
                     .stretch_weft = 10,
                     .stretch_warp = 10,
                     .stretch_shear = 5,
                     .bend_weft = 1e-5,
                     .bend_warp = 1e-5,
                     .bend_twist = 5e-6},
    };
    e->body[0] =
        (drape_body){.kind = DRAPE_BODY_PLANE, .offset = 0.003, .point = {0, -3, 0}, .axis = {0, 1, 0}};
    e->body[1] = (drape_body){.kind = DRAPE_BODY_MESH,
                              .offset = 0.003,
                              .positions = e->corner,
                              .triangle = e->face,
                              .vertices = 4,
                              .triangles = 4};
    for (int i = 0; i < 2; i++) {
        e->elastic[i] = (drape_elastic){e->elastic_edge, 2, 0.5, 30};
        e->fold[i] = (drape_fold){e->fold_edge, 2, 1, 1e-3};
    }
    e->tack[0] = (drape_tack){.vertex = 5, .triangle = DRAPE_NO_TRIANGLE, .point = {3, 0, 0}};
    e->tack[1] = (drape_tack){.vertex = 6, .body = 1, .triangle = 3, .barycentric = {0.5, 0.25}};
    e->desc = (drape_scene_desc){.thickness = DRAPE_DEFAULT_THICKNESS,
                                 .vertices = 8,
                                 .triangles = 4,
                                 .seams = 2,
                                 .pins = 1,
                                 .materials = 1,
                                 .bodies = 2,
                                 .positions = e->positions,
                                 .pattern = e->pattern,
                                 .triangle = e->triangle,
                                 .seam = e->seam,
                                 .pin = e->pin,
                                 .material = &e->material,
                                 .body = e->body,
                                 .elastics = 2,
                                 .folds = 2,
                                 .tacks = 2,
                                 .elastic = e->elastic,
                                 .fold = e->fold,
                                 .tack = e->tack};
}

static void refused(const struct example *e, drape_place place, int64_t element, int64_t outer,
                    const char *member, const char *says)
{
    drape_error error = {0};
    assert_int_equal(drape_scene_check(&e->desc, &error), DRAPE_EINVAL);
    if (error.place != place || error.element != element || error.body != outer ||
        !strstr(error.message, says))
        fail_msg("place %d element %lld of %lld: %s", error.place, (long long)error.element,
                 (long long)error.body, error.message);
    if (member)
        assert_string_equal(error.member, member);
}

static void taken(const struct example *e)
{
    drape_error error = {0};
    if (drape_scene_check(&e->desc, &error) != DRAPE_OK)
        fail_msg("refused: %s", error.message);
}

static void test_lines__become_bars_hinges_and_tacks_of_the_welded_mesh(void **state)
{
    (void)state;
    struct example e;
    drape_scene *scene = NULL;
    make(&e);
    e.material.shrink_weft = 0.25; /* tapes are measured along the cloth as cut */
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(scene->bars, 4);
    const struct dr_bar *bar = scene->bar + 1;
    assert_int_equal(bar->node[0], 1); /* vertex 4 is sewn to 1, 6 to 3 */
    assert_int_equal(bar->node[1], 3);
    assert_close(bar->rest, 0.5, 1e-15);
    assert_close(bar->stiffness, 30, 0);

    assert_int_equal(scene->hinges, 4);
    const struct dr_hinge *hinge = scene->hinge + 1; /* seen from the triangle of vertices 4, 7 and 6 */
    const uint32_t node[4] = {3, 1, 5, 0};
    assert_memory_equal(hinge->node, node, sizeof node);
    /* in series with 0.75 m of cloth of 1e-5 N m on the one side and on the other, half of each */
    assert_close(hinge->weight, 1 / (1 / 1e-3 + 0.75 / 1e-5), 1e-12);
    assert_close(hinge->rest, 1, 0);

    assert_int_equal(scene->tacks, 2);
    const double point[3] = {3, 0, 0};
    assert_memory_equal(scene->tack[0].at, point, sizeof point);
    assert_int_equal(scene->tack[1].node, 3);
    for (int d = 0; d < 3; d++) { /* half corner 1, a quarter of 2 and of 3, lifted out of the body */
        const double mean[3] = {0.05, 0.025, -0.975};
        assert_true(scene->tack[1].at[d] > mean[d]);
        assert_near(scene->tack[1].at[d], mean[d], 2e-3, 1);
    }
    drape_scene_free(scene);
}

/* No triangle bends with one beyond a fold. */
static void test_lines__bending_is_cut_along_folds(void **state)
{
    (void)state;
    struct example e;
    drape_scene *scene = NULL;
    make(&e);
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_int_equal(scene->bend->start[1], 0); /* the first has no other neighbour than across the fold */
    for (size_t i = scene->bend->start[2]; i < scene->bend->start[4]; i++)
        assert_true(scene->bend->node[i] != 0 && scene->bend->node[i] != 2); /* left of the seam */
    drape_scene_free(scene);
    e.desc.folds = 0;
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    assert_true(scene->bend->start[1] > 0);
    drape_scene_free(scene);
}

static void test_lines__numbers_end_at_their_limits(void **state)
{
    (void)state;
    static const struct {
        size_t member; /* of struct example */
        double least, most;
        drape_place place;
        const char *name;
    } cases[] = {
        {offsetof(struct example, elastic[1].factor), DRAPE_MIN_FACTOR, DRAPE_MAX_FACTOR, DRAPE_AT_ELASTIC,
         "factor"},
        {offsetof(struct example, elastic[1].stiffness), DRAPE_MIN_MATERIAL, DRAPE_MAX_MATERIAL,
         DRAPE_AT_ELASTIC, "stiffness"},
        {offsetof(struct example, fold[1].angle), -M_PI, M_PI, DRAPE_AT_FOLD, "angle"},
        {offsetof(struct example, fold[1].stiffness), DRAPE_MIN_MATERIAL, DRAPE_MAX_MATERIAL, DRAPE_AT_FOLD,
         "stiffness"},
        {offsetof(struct example, material.shrink_weft), -DRAPE_MAX_SHRINK, DRAPE_MAX_SHRINK,
         DRAPE_AT_MATERIAL, "shrink_weft"},
        {offsetof(struct example, material.shrink_warp), -DRAPE_MAX_SHRINK, DRAPE_MAX_SHRINK,
         DRAPE_AT_MATERIAL, "shrink_warp"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct example e;
        double *value = (double *)(void *)((char *)&e + cases[i].member);
        int64_t element = cases[i].place == DRAPE_AT_MATERIAL ? 0 : 1;
        const double past[] = {nextafter(cases[i].least, -INFINITY), nextafter(cases[i].most, INFINITY), NAN};
        make(&e);
        *value = cases[i].least;
        taken(&e);
        *value = cases[i].most;
        taken(&e);
        for (int k = 0; k < 3; k++) {
            *value = past[k];
            refused(&e, cases[i].place, element, -1, cases[i].name, "not between");
        }
    }
}

static void test_lines__edges_must_be_edges(void **state)
{
    (void)state;
    struct example e;
    make(&e);
    e.elastic_edge[3] = 8;
    refused(&e, DRAPE_AT_ELASTIC_EDGE, 1, 0, NULL, "vertex 8 does not exist");
    make(&e);
    e.elastic[1].edge = (const uint32_t[4]){0, 1, 1, 2};
    refused(&e, DRAPE_AT_ELASTIC_EDGE, 1, 1, NULL, "1 and 2 are not two corners of one triangle");
    make(&e);
    e.fold[1].edge = (const uint32_t[4]){0, 3, 3, 3};
    refused(&e, DRAPE_AT_FOLD_EDGE, 1, 1, NULL, "3 and 3 are not two corners");
    make(&e);
    e.fold_edge[2] = 0;
    e.fold_edge[3] = 1;
    refused(&e, DRAPE_AT_FOLD_EDGE, 1, 0, NULL, "on one side only");
    make(&e);
    e.desc.seams = 0; /* unsewn, the edge of the second fold is a border */
    e.desc.seam = NULL;
    refused(&e, DRAPE_AT_FOLD_EDGE, 1, 0, NULL, "on one side only");
    make(&e);
    e.elastic[0].edge = NULL;
    refused(&e, DRAPE_AT_ELASTIC, 0, -1, "edge", "missing");
    make(&e);
    e.fold[1].edge = NULL;
    e.fold[1].edges = 0; /* none: fine */
    taken(&e);
}

static void test_lines__tacks_hold_what_is_there(void **state)
{
    (void)state;
    struct example e;
    make(&e);
    e.tack[1].vertex = 8;
    refused(&e, DRAPE_AT_TACK, 1, -1, "vertex", "vertex 8 does not exist");
    make(&e);
    e.tack[0].vertex = 0;
    refused(&e, DRAPE_AT_TACK, 0, -1, "vertex", "vertex 0 is pinned");
    make(&e);
    e.tack[1].body = 2;
    refused(&e, DRAPE_AT_TACK, 1, -1, "body", "body 2 does not exist");
    make(&e);
    e.tack[1].body = 0;
    refused(&e, DRAPE_AT_TACK, 1, -1, "triangle", "no mesh");
    make(&e);
    e.tack[1].triangle = 4;
    refused(&e, DRAPE_AT_TACK, 1, -1, "triangle", "triangle 4 does not exist");
    make(&e);
    e.tack[0].point[1] = NAN;
    refused(&e, DRAPE_AT_TACK, 0, -1, "point", "finite");
    const double good[][2] = {{0, 0}, {1, 0}, {0, 1}, {0.5, 0.5}};
    const double bad[][2] = {{-1e-9, 0}, {0, -1e-9}, {0.5, 0.5 + 1e-9}, {NAN, 0}};
    for (int i = 0; i < 4; i++) {
        make(&e);
        memcpy(e.tack[1].barycentric, good[i], sizeof good[i]);
        taken(&e);
        memcpy(e.tack[1].barycentric, bad[i], sizeof bad[i]);
        refused(&e, DRAPE_AT_TACK, 1, -1, "barycentric", "at most 1 together");
    }
}

static void test_lines__there_are_so_many_and_no_more(void **state)
{
    (void)state;
    struct example e;
    make(&e);
    drape_elastic *elastic = malloc((DRAPE_MAX_LINES + 1) * sizeof *elastic);
    drape_fold *fold = malloc((DRAPE_MAX_LINES + 1) * sizeof *fold);
    uint32_t *edge = malloc(2 * sizeof *edge * (DRAPE_MAX_LINE_EDGES + 1));
    assert_true(elastic && fold && edge);
    for (size_t i = 0; i <= DRAPE_MAX_LINES; i++) {
        elastic[i] = e.elastic[0];
        fold[i] = e.fold[0];
    }
    for (size_t i = 0; i <= DRAPE_MAX_LINE_EDGES; i++) {
        edge[2 * i] = 0;
        edge[2 * i + 1] = 3;
    }
    e.desc.elastic = elastic;
    e.desc.fold = fold;
    e.desc.elastics = e.desc.folds = DRAPE_MAX_LINES;
    taken(&e);
    e.desc.elastics++;
    refused(&e, DRAPE_AT_SCENE, -1, -1, "elastics", "more than the limit of 10000");
    e.desc.elastics--;
    e.desc.folds++;
    refused(&e, DRAPE_AT_SCENE, -1, -1, "folds", "more than the limit of 10000");
    make(&e);
    e.elastic[1].edge = e.fold[1].edge = edge;
    e.elastic[1].edges = e.fold[1].edges = DRAPE_MAX_LINE_EDGES - 2;
    taken(&e);
    e.elastic[1].edges++;
    refused(&e, DRAPE_AT_ELASTIC, 1, -1, "edge", "more edges than the limit of 1000000");
    e.elastic[1].edges--;
    e.fold[1].edges++;
    refused(&e, DRAPE_AT_FOLD, 1, -1, "edge", "more edges than the limit of 1000000");
    make(&e);
    e.desc.tacks = DRAPE_MAX_VERTICES + 1;
    refused(&e, DRAPE_AT_SCENE, -1, -1, "tacks", "more than the limit of 1000000");
    e.desc.tacks = 2;
    e.desc.tack = NULL;
    refused(&e, DRAPE_AT_SCENE, -1, -1, "tacks", "missing");
    free(elastic);
    free(fold);
    free(edge);
}

#ifdef CAN_FAIL_ALLOCATIONS
/* Of the scene and of a cloth that has all three. */
static drape_status make_all(const struct example *e, drape_error *reterr)
{
    drape_scene *scene = NULL;
    struct dr_cloth *cloth = NULL;
    drape_status status = drape_scene_new(&e->desc, &scene, reterr);
    if (status >= 0) {
        const struct dr_cloth_plan plan = {.scene = scene,
                                           .mesh = scene->mesh,
                                           .bend = scene->bend,
                                           .elastics = true,
                                           .folds = true,
                                           .tacks = true,
                                           .matrix = DR_MATRIX_CHOLESKY};
        status = dr_cloth_new(&plan, e->positions, &cloth, reterr);
    }
    dr_cloth_free(cloth);
    drape_scene_free(scene);
    return status;
}
#endif

static void test_lines__survive_any_failed_allocation(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct example e;
    make(&e);
    e.tack[1] = e.tack[0];
    e.desc.bodies = 1; /* a distance field has its own test */
    assert_int_equal(make_all(&e, NULL), DRAPE_OK);
    long before = held, n = 0;
    for (bool reached = true; reached; n++) {
        drape_error error = {0};
        countdown = n;
        drape_status status = make_all(&e, &error);
        reached = countdown < 0;
        countdown = -1;
        assert_true(status == DRAPE_OK || (status == DRAPE_ENOMEM && error.status == DRAPE_ENOMEM));
        assert_int_equal(held, before);
    }
    assert_true(n > 50);
#else
    skip();
#endif
}

/* The step matrix of a cloth with all three undoes the difference of its forces: link numbers, seams. */
static void test_lines__the_step_matrix_has_them_where_they_belong(void **state)
{
    (void)state;
    enum { NODES = 6, STEP = 3 * NODES };
    struct example e;
    drape_scene *scene = NULL;
    struct dr_cloth *cloth = NULL;
    drape_energies energy;
    double x[STEP], y[STEP] = {0}, moved[STEP], up[STEP], down[STEP], b[STEP], w[STEP], unused;
    const double h = 1e-6, stiff = 1e4;
    uint64_t seed = 9;
    bool memory;
    make(&e);
    assert_int_equal(drape_scene_new(&e.desc, &scene, NULL), DRAPE_OK);
    const uint32_t link[] = {0, 5}; /* of the plan's own: numbered before the others */
    const struct dr_cloth_plan plan = {.scene = scene,
                                       .mesh = scene->mesh,
                                       .bend = scene->bend,
                                       .elastics = true,
                                       .folds = true,
                                       .tacks = true,
                                       .link = link,
                                       .links = 1,
                                       .matrix = DR_MATRIX_CHOLESKY};
    dr_scene_weld(scene, e.positions, x);
    assert_int_equal(dr_cloth_new(&plan, x, &cloth, NULL), DRAPE_OK);
    for (int i = 0; i < STEP; i++) {
        x[i] += 0.1 * test_random(&seed);
        y[i] = i < 3 ? 0 : test_random(&seed);
    }
    for (int i = 0; i < STEP; i++)
        moved[i] = x[i] + h * y[i];
    dr_cloth_energy(cloth, moved, &energy, up);
    assert_true(energy.stretch > 1 && energy.bend > 1e-6 && energy.contact > 1e4);
    for (int i = 0; i < STEP; i++)
        moved[i] = x[i] - h * y[i];
    dr_cloth_energy(cloth, moved, &energy, down);
    for (int i = 0; i < STEP; i++) /* b = (stiff M + H) y */
        b[i] = (down[i] - up[i]) / (2 * h) + stiff * scene->mesh->mass[i / 3] * y[i];
    dr_cloth_stress(cloth, x, NULL);
    dr_matrix_set_base(cloth->A, stiff);
    assert_int_equal(dr_cloth_assemble(cloth, x, 1, NULL), 0);
    assert_true(dr_matrix_factorise(cloth->A, &memory));
    dr_matrix_solve(cloth->A, 1, (const double *[]){b}, (double *[]){w});
    for (int i = 0; i < STEP; i++)
        assert_near(w[i], y[i], 1e-6, 1);

    /* What the projection left out is the difference of the two matrices. */
    double q[STEP] = {0}, semi[STEP], whole = 0, part = 0;
    dr_cloth_left_out(cloth, x, y, q);
    assert_int_equal(dr_cloth_assemble(cloth, x, 0, NULL), 0);
    assert_true(dr_matrix_factorise(cloth->A, &memory));
    for (int i = 0; i < STEP; i++)
        b[i] -= q[i];
    dr_matrix_solve(cloth->A, 1, (const double *[]){b}, (double *[]){semi});
    for (int i = 3; i < STEP; i++) {
        assert_near(semi[i], y[i], 1e-6, 1);
        whole += q[i] * q[i];
    }
    assert_true(whole > 1e-3);
    memset(q, 0, sizeof q);
    dr_stretch_left_out(cloth->stretch, x, cloth->stress, y, q);
    for (int i = 3; i < STEP; i++)
        part += q[i] * q[i];
    assert_true(fabs(part - whole) > 1e-4);
    assert_true(dr_cloth_second_order(cloth, x, y, &unused) >
                dr_stretch_second_order(cloth->stretch, x, y, &unused));
    dr_cloth_free(cloth);
    drape_scene_free(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_lines__become_bars_hinges_and_tacks_of_the_welded_mesh),
        cmocka_unit_test(test_lines__bending_is_cut_along_folds),
        cmocka_unit_test(test_lines__numbers_end_at_their_limits),
        cmocka_unit_test(test_lines__edges_must_be_edges),
        cmocka_unit_test(test_lines__tacks_hold_what_is_there),
        cmocka_unit_test(test_lines__there_are_so_many_and_no_more),
        cmocka_unit_test(test_lines__the_step_matrix_has_them_where_they_belong),
        cmocka_unit_test(test_lines__survive_any_failed_allocation),
    };
    return cmocka_run_group_tests_name("lines", tests, NULL, NULL);
}
