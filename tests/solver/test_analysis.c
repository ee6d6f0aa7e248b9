/* Symbolic factorisations that matrices share: the same bytes with them as without, and no more than may be
 * kept. */
#include "analysis.h"

#include <pthread.h>

#include "../test.h"
#include "matrix.h"
#include "scarce.h"
#include "sheets.h"

#define LIMIT ((size_t)1 << 30)

/* A mesh of n x n squares as cloth without bending, and a right-hand side. */
struct cloth {
    struct dr_mesh *mesh;
    double *b, *w;
};

static struct cloth cloth_new(size_t n)
{
    struct shape shape = sheets_stack(n, 1, 0.1, 0.1);
    struct cloth cloth = {sheets_mesh(shape.vertices, shape.triangles, shape.triangle), NULL, NULL};
    cloth.b = calloc(3 * shape.vertices, sizeof *cloth.b);
    cloth.w = calloc(3 * shape.vertices, sizeof *cloth.w);
    assert_non_null(cloth.b);
    assert_non_null(cloth.w);
    uint64_t random = 3;
    for (size_t i = 0; i < 3 * shape.vertices; i++)
        cloth.b[i] = test_random(&random);
    shape_free(&shape);
    return cloth;
}

static void cloth_free(struct cloth *cloth)
{
    dr_mesh_free(cloth->mesh);
    free(cloth->b);
    free(cloth->w);
}

/* Makes the matrix with one link, solves with it into w. */
static drape_status solve(struct cloth *cloth, uint32_t linked, enum dr_factor factor,
                          drape_analyses *analyses)
{
    const uint32_t link[] = {0, linked};
    struct dr_matrix *A = NULL;
    bool memory = false;
    drape_status status = dr_matrix_new(cloth->mesh, NULL, link, 1, factor, analyses, &A, NULL);
    if (status < 0)
        return status;
    dr_matrix_set_base(A, 100);
    dr_matrix_reset(A);
    dr_matrix_add_link(A, 0, 1.5);
    if (!dr_matrix_factorise(A, &memory))
        status = DRAPE_ENOMEM;
    else if (!dr_matrix_solve(A, 1, (const double *[]){cloth->b}, (double *[]){cloth->w}))
        status = DRAPE_ENOMEM;
    assert_true(status == DRAPE_OK || memory || factor == DR_LDL);
    dr_matrix_free(A);
    return status;
}

/* As solve by Cholesky, which must succeed. */
static void solved(struct cloth *cloth, uint32_t linked, drape_analyses *analyses)
{
    assert_int_equal(solve(cloth, linked, DR_CHOLESKY, analyses), 0);
}

/* The bytes that are kept of the matrices with these links, all together. */
static size_t bytes_of(struct cloth *cloth, uint32_t linked, uint32_t count)
{
    drape_analyses *analyses = drape_analyses_new(LIMIT);
    for (uint32_t i = 0; i < count; i++)
        solved(cloth, linked + i, analyses);
    size_t bytes = drape_analyses_count(analyses).bytes;
    drape_analyses_free(analyses);
    return bytes;
}

static void expect(drape_analyses *analyses, uint64_t hits, uint64_t misses)
{
    drape_analyses_counts counts = drape_analyses_count(analyses);
    assert_int_equal(counts.hits, hits);
    assert_int_equal(counts.misses, misses);
}

static void test_analysis__a_kept_one_changes_no_byte(void **state)
{
    (void)state;
    for (enum dr_factor factor = 0; factor < DR_FACTORS; factor++) {
        struct cloth cloth = cloth_new(9);
        size_t size = 3 * cloth.mesh->nodes * sizeof *cloth.w;
        double *alone = malloc(size);
        assert_non_null(alone);
        drape_analyses *analyses = drape_analyses_new(LIMIT);
        assert_int_equal(solve(&cloth, 50, factor, NULL), 0);
        memcpy(alone, cloth.w, size);
        for (uint64_t i = 0; i < 3; i++) {
            memset(cloth.w, 0, size);
            assert_int_equal(solve(&cloth, 50, factor, analyses), 0);
            assert_memory_equal(cloth.w, alone, size);
            expect(analyses, i, 1);
        }
        drape_analyses_free(analyses);
        free(alone);
        cloth_free(&cloth);
    }
}

static void test_analysis__another_graph_or_factor_is_another_one(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(5), larger = cloth_new(6);
    drape_analyses *analyses = drape_analyses_new(LIMIT);
    solved(&cloth, 20, analyses);
    solved(&cloth, 21, analyses); /* as many pairs, but others */
    assert_int_equal(solve(&cloth, 20, DR_LDL, analyses), 0);
    solved(&larger, 20, analyses);
    cloth.mesh->held[7] = true;
    solved(&cloth, 20, analyses);
    expect(analyses, 0, 5);
    solved(&cloth, 20, analyses);
    expect(analyses, 1, 5);
    drape_analyses_free(analyses);
    cloth_free(&cloth);
    cloth_free(&larger);
}

static void test_analysis__the_limit_holds_at_its_value_and_not_one_below(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(5);
    size_t bytes = bytes_of(&cloth, 20, 1);
    assert_true(bytes > 36 * sizeof(uint64_t));
    for (size_t less = 0; less < 2; less++) {
        drape_analyses *analyses = drape_analyses_new(bytes - less);
        solved(&cloth, 20, analyses);
        assert_int_equal(drape_analyses_count(analyses).bytes, less ? 0 : bytes);
        solved(&cloth, 20, analyses);
        expect(analyses, less ? 0 : 1, less ? 2 : 1);
        drape_analyses_free(analyses);
    }
    cloth_free(&cloth);
}

static void test_analysis__the_one_used_longest_ago_goes(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(5);
    drape_analyses *analyses = /* two of them, not three */
        drape_analyses_new(bytes_of(&cloth, 20, 2) + bytes_of(&cloth, 20, 1) / 2);
    solved(&cloth, 20, analyses);
    solved(&cloth, 21, analyses);
    solved(&cloth, 20, analyses); /* used again */
    expect(analyses, 1, 2);
    solved(&cloth, 22, analyses); /* 21 goes */
    solved(&cloth, 20, analyses);
    expect(analyses, 2, 3);
    solved(&cloth, 21, analyses);
    expect(analyses, 2, 4);
    drape_analyses_free(analyses);
    cloth_free(&cloth);
}

static void *solve_often(void *data)
{
    for (uint32_t i = 0; i < 40; i++) {
        struct cloth cloth = cloth_new(4);
        solved(&cloth, 20 + i % 4, data);
        assert_true(drape_analyses_count(data).bytes > 0);
        cloth_free(&cloth);
    }
    return NULL;
}

static void test_analysis__threads_share_them(void **state)
{
    (void)state;
    struct cloth cloth = cloth_new(4);
    drape_analyses *analyses =
        drape_analyses_new(bytes_of(&cloth, 20, 1) * 5 / 2); /* so that some go while others are looked for */
    pthread_t thread[4];
    for (int t = 0; t < 4; t++)
        assert_int_equal(pthread_create(thread + t, NULL, solve_often, analyses), 0);
    for (int t = 0; t < 4; t++)
        pthread_join(thread[t], NULL);
    drape_analyses_counts counts = drape_analyses_count(analyses);
    assert_int_equal(counts.hits + counts.misses, 160);
    drape_analyses_free(analyses);
    cloth_free(&cloth);
}

/* A sewn and pinned sheet: pieces and garment have an analysis each, which serves another fabric. */
static void test_analysis__a_drape_is_the_same_with_those_of_another_fabric(void **state)
{
    (void)state;
    const double x[] = {0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 1, 1.2, 0, 0, 2, 0, 0, 1.2, 0, 1, 2, 0, 1};
    const double pattern[] = {0, 0, 1, 0, 0, 1, 1, 1, 1, 0, 2, 0, 1, 1, 2, 1};
    const uint32_t triangle[] = {0, 2, 1, 1, 2, 3, 4, 6, 5, 5, 6, 7}, seam[] = {1, 4, 3, 6}, pin[] = {0};
    drape_material material = {.density = 0.2, .stretch_weft = 50, .stretch_warp = 50, .stretch_shear = 20};
    drape_scene_desc desc = drape_scene_desc_default();
    desc.vertices = 8, desc.positions = x, desc.pattern = pattern;
    desc.triangles = 4, desc.triangle = triangle;
    desc.seams = 2, desc.seam = seam;
    desc.pins = 1, desc.pin = pin;
    desc.materials = 1, desc.material = &material;
    drape_analyses *analyses = drape_analyses_new(LIMIT);
    double alone[24];
    for (int run = 0; run < 3; run++) {
        drape_options options = drape_options_default();
        drape_scene *scene = NULL;
        drape_sim *sim = NULL;
        size_t vertices;
        options.max_iterations = 5;
        options.analyses = run ? analyses : NULL;
        material.stretch_weft = run == 1 ? 80 : 50;
        assert_int_equal(drape_scene_new(&desc, &scene, NULL), 0);
        assert_int_equal(drape_sim_new(scene, &options, &sim, NULL), 0);
        assert_true(drape_sim_run(sim, NULL) >= 0);
        const double *end = drape_sim_positions(sim, &vertices);
        if (!run)
            memcpy(alone, end, sizeof alone);
        else if (run == 1)
            assert_memory_not_equal(end, alone, sizeof alone);
        else
            assert_memory_equal(end, alone, sizeof alone);
        drape_sim_free(sim);
        drape_scene_free(scene);
    }
    expect(analyses, 2, 2);
    drape_analyses_free(analyses);
}

static void test_analysis__every_allocation_may_fail(void **state)
{
    (void)state;
#ifdef CAN_FAIL_ALLOCATIONS
    struct cloth cloth = cloth_new(3);
    long before = held, n = 0;
    for (int kept = 0; kept < 2; kept++) {
        for (n = 0;; n++) {
            drape_analyses *analyses = drape_analyses_new(LIMIT);
            assert_non_null(analyses);
            if (kept)
                solved(&cloth, 10, analyses);
            long of_old = held;
            fail_at(n);
            drape_status status = solve(&cloth, 10, DR_CHOLESKY, analyses);
            bool failed = has_failed();
            assert_true(status == DRAPE_OK || status == DRAPE_ENOMEM);
            assert_true(kept ? held == of_old : held >= of_old);
            /* what went wrong leaves what is right to the next */
            solved(&cloth, 10, analyses);
            drape_analyses_free(analyses);
            assert_int_equal(held, before);
            if (!failed)
                break;
        }
        assert_true(n > 20);
    }
    fail_at(0);
    assert_null(drape_analyses_new(LIMIT));
    assert_true(has_failed());
    cloth_free(&cloth);
#else
    skip();
#endif
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_analysis__a_kept_one_changes_no_byte),
        cmocka_unit_test(test_analysis__another_graph_or_factor_is_another_one),
        cmocka_unit_test(test_analysis__the_limit_holds_at_its_value_and_not_one_below),
        cmocka_unit_test(test_analysis__the_one_used_longest_ago_goes),
        cmocka_unit_test(test_analysis__threads_share_them),
        cmocka_unit_test(test_analysis__a_drape_is_the_same_with_those_of_another_fabric),
        cmocka_unit_test(test_analysis__every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
