/* test_fields.c - a body is built once, whoever asks; the cache stays within its bytes and leaks nothing. */
#include "test.h"

#include <pthread.h>

#include "fields.h"
#include "metrics.h"

enum { ASKERS = 6 };

/* A tetrahedron, about 0.2 m, whose numbers differ with `size`. */
struct shape {
    double positions[12];
    uint32_t triangle[12];
    drape_body body;
};

static void shape_make(struct shape *shape, double size)
{
    const double positions[12] = {0, 0, 0, size, 0, 0, 0, 0, size, 0, size, 0};
    const uint32_t triangle[12] = {0, 1, 2, 0, 3, 1, 1, 3, 2, 0, 2, 3};
    memcpy(shape->positions, positions, sizeof positions);
    memcpy(shape->triangle, triangle, sizeof triangle);
    shape->body = (drape_body){.kind = DRAPE_BODY_MESH,
                               .offset = DRAPE_DEFAULT_OFFSET,
                               .positions = shape->positions,
                               .triangle = shape->triangle,
                               .vertices = 4,
                               .triangles = 4};
}

static double figure(struct metrics *metrics, const char *name)
{
    char *text = metrics_text(metrics), line[80];
    assert_non_null(text);
    snprintf(line, sizeof line, "\n%s ", name);
    const char *at = strstr(text, line);
    assert_non_null(at);
    double value = strtod(at + strlen(line), NULL);
    free(text);
    return value;
}

static void expect(struct metrics *metrics, int hits, int misses, size_t bytes)
{
    assert_close(figure(metrics, "draped_field_cache_hits_total"), hits, 0);
    assert_close(figure(metrics, "draped_field_cache_misses_total"), misses, 0);
    assert_close(figure(metrics, "draped_field_cache_bytes"), (double)bytes, 0);
}

/* Asks, and gives back at once; the bytes of what there was. */
static size_t ask(struct fields *fields, double size, drape_field **ret_seen)
{
    struct shape shape;
    drape_field *field = NULL;
    drape_error error;
    shape_make(&shape, size);
    assert_int_equal(fields_get(fields, &shape.body, 0, NULL, &field, &error), DRAPE_OK);
    assert_non_null(field);
    size_t bytes = drape_field_bytes(field);
    if (ret_seen)
        *ret_seen = field;
    drape_field_unref(field);
    return bytes;
}

static void test_fields__the_same_numbers_are_built_once(void **state)
{
    (void)state;
    struct metrics *metrics = metrics_new();
    struct fields *fields = fields_new((size_t)1 << 30, metrics);
    drape_field *first, *again, *other;
    size_t bytes = ask(fields, 0.2, &first);
    expect(metrics, 0, 1, bytes);
    ask(fields, 0.2, &again);
    assert_ptr_equal(first, again);
    expect(metrics, 1, 1, bytes);
    bytes += ask(fields, nextafter(0.2, 1), &other);
    assert_ptr_not_equal(first, other);
    expect(metrics, 1, 2, bytes);
    assert_close(figure(metrics, "draped_field_build_seconds_count"), 2, 0);
    assert_null(fields_free(fields));
    assert_null(fields_free(NULL));
    metrics_free(metrics);
}

struct asker {
    pthread_t thread;
    struct fields *fields;
    double size;
    drape_field *field;
    drape_status status;
};

static void *ask_and_keep(void *data)
{
    struct asker *asker = data;
    struct shape shape;
    drape_error error;
    shape_make(&shape, asker->size);
    if (asker->size == 0)
        shape.body.triangles = 3;
    asker->status = fields_get(asker->fields, &shape.body, 0, NULL, &asker->field, &error);
    return NULL;
}

static void ask_at_once(struct asker asker[ASKERS], struct fields *fields, const double size[ASKERS])
{
    for (int i = 0; i < ASKERS; i++) {
        asker[i] = (struct asker){.fields = fields, .size = size[i]};
        assert_int_equal(pthread_create(&asker[i].thread, NULL, ask_and_keep, &asker[i]), 0);
    }
    for (int i = 0; i < ASKERS; i++)
        pthread_join(asker[i].thread, NULL);
}

static void test_fields__of_those_who_ask_at_once_one_builds(void **state)
{
    (void)state;
    struct metrics *metrics = metrics_new();
    struct fields *fields = fields_new((size_t)1 << 30, metrics);
    struct asker asker[ASKERS];
    ask_at_once(asker, fields, (const double[ASKERS]){0.2, 0.2, 0.21, 0.2, 0.21, 0.2});
    for (int i = 0; i < ASKERS; i++) {
        assert_int_equal(asker[i].status, DRAPE_OK);
        assert_ptr_equal(asker[i].field, asker[asker[i].size == 0.2 ? 0 : 2].field);
    }
    expect(metrics, ASKERS - 2, 2, drape_field_bytes(asker[0].field) + drape_field_bytes(asker[2].field));
    fields_free(fields); /* what is lent outlives the cache */
    for (int i = 0; i < ASKERS; i++)
        drape_field_unref(asker[i].field);
    metrics_free(metrics);
}

static void test_fields__what_is_refused_is_refused_to_all_and_not_kept(void **state)
{
    (void)state;
    struct metrics *metrics = metrics_new();
    struct fields *fields = fields_new((size_t)1 << 30, metrics);
    struct asker asker[ASKERS];
    ask_at_once(asker, fields, (const double[ASKERS]){0});
    for (int i = 0; i < ASKERS; i++) {
        assert_int_equal(asker[i].status, DRAPE_EINVAL);
        assert_null(asker[i].field);
    }
    expect(metrics, 0, ASKERS, 0);

    struct shape shape;
    drape_field *field = NULL;
    drape_error error;
    shape_make(&shape, 0.2);
    shape.body.triangles = 3; /* too few to enclose anything */
    assert_int_equal(fields_get(fields, &shape.body, 5, NULL, &field, &error), DRAPE_EINVAL);
    assert_int_equal(error.body, 5);
    assert_int_equal(error.place, DRAPE_AT_BODY);
    fields_free(fields);
    metrics_free(metrics);
}

static void test_fields__the_one_used_longest_ago_goes_first(void **state)
{
    (void)state;
    struct metrics *metrics = metrics_new();
    struct fields *fields = fields_new(0, NULL);
    size_t bytes = ask(fields, 0.2, NULL);
    fields_free(fields);
    fields = fields_new(2 * bytes, metrics);
    assert_int_equal(ask(fields, nextafter(0.2, 0), NULL), bytes); /* as large, but another */
    ask(fields, 0.2, NULL);
    expect(metrics, 0, 2, 2 * bytes); /* exactly the limit */
    ask(fields, nextafter(0.2, 0), NULL);
    ask(fields, nextafter(0.2, 1), NULL); /* in the place of 0.2 */
    expect(metrics, 1, 3, 2 * bytes);
    ask(fields, nextafter(0.2, 0), NULL);
    expect(metrics, 2, 3, 2 * bytes);
    ask(fields, 0.2, NULL);
    expect(metrics, 2, 4, 2 * bytes);
    fields_free(fields);
    metrics_free(metrics);
}

static void test_fields__a_field_past_the_limit_is_lent_but_not_kept(void **state)
{
    (void)state;
    struct metrics *metrics = metrics_new();
    struct fields *fields = fields_new(1000, metrics);
    struct shape shape;
    drape_field *field;
    drape_error error;
    shape_make(&shape, 0.2);
    assert_int_equal(fields_get(fields, &shape.body, 0, NULL, &field, &error), DRAPE_OK);
    expect(metrics, 0, 1, 0);
    assert_true(drape_field_bytes(field) > 1000);
    drape_field_unref(field);
    fields_free(fields);
    metrics_free(metrics);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_fields__the_same_numbers_are_built_once),
        cmocka_unit_test(test_fields__of_those_who_ask_at_once_one_builds),
        cmocka_unit_test(test_fields__what_is_refused_is_refused_to_all_and_not_kept),
        cmocka_unit_test(test_fields__the_one_used_longest_ago_goes_first),
        cmocka_unit_test(test_fields__a_field_past_the_limit_is_lent_but_not_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
