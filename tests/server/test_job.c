/* test_job.c - revisions are ordered, and the job body has every member of the contract. */
#include "test.h"

#include "../solver/scarce.h"

#include <jansson.h>

#include "job.h"

static void test_job__revisions_are_written_and_read_back(void **state)
{
    (void)state;
    char text[REVISION_SIZE];
    struct revision r = {2, 17}, back;
    revision_format(r, text);
    assert_string_equal(text, "2.17");
    assert_int_equal(revision_parse("4294967295.4294967295", &back), 0);
    revision_format(back, text);
    assert_string_equal(text, "4294967295.4294967295");
}

static void test_job__revisions_that_are_none_are_refused(void **state)
{
    (void)state;
    const char *refused[] = {"",     "1",    "1.",   ".1",           "1.2.3",         "1.2 ",
                             " 1.2", "+1.2", "1.-2", "4294967296.1", "1.99999999999", "x"};
    struct revision r = {7, 7};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        assert_int_equal(revision_parse(refused[i], &r), -1);
    assert_int_equal(r.attempt, 7); /* untouched */
}

static void test_job__revisions_are_ordered_by_attempt_then_counter(void **state)
{
    (void)state;
    assert_true(revision_compare((struct revision){1, 9}, (struct revision){2, 1}) < 0);
    assert_true(revision_compare((struct revision){2, 10}, (struct revision){2, 9}) > 0);
    assert_int_equal(revision_compare((struct revision){2, 9}, (struct revision){2, 9}), 0);
}

static void test_job__status_names_go_both_ways(void **state)
{
    (void)state;
    for (int i = 0; i < JOB_STATUSES; i++)
        assert_int_equal(job_status_from_name(job_status_name((enum job_status)i)), i);
    assert_int_equal(job_status_from_name("sleeping"), -1);
    assert_false(job_status_ended(JOB_RUNNING));
    assert_true(job_status_ended(JOB_CANCELED));
}

static json_t *body(const struct job *job, size_t position)
{
    char *text = job_body(job, position);
    assert_non_null(text);
    assert_null(strchr(text, '\n')); /* one data line of an event stream */
    json_t *json = json_loads(text, JSON_REJECT_DUPLICATES, NULL);
    assert_non_null(json);
    free(text);
    return json;
}

static void test_job__body_has_every_member_of_the_contract(void **state)
{
    (void)state;
    const char *member[] = {"id",      "name",           "labels",     "status",      "verdict",  "revision",
                            "attempt", "created_at",     "started_at", "finished_at", "progress", "report",
                            "error",   "queue_position", "links",      "warnings",    "priority", "trace_id"};
    struct job job = {
        .id = "0123456789abcdef0123456789abcdef", .revision = {1, 3}, .created_ms = 1182763800125};
    json_t *json = body(&job, 4);
    for (size_t i = 0; i < sizeof member / sizeof *member; i++)
        assert_non_null(json_object_get(json, member[i]));
    assert_int_equal(json_object_size(json), sizeof member / sizeof *member);
    assert_string_equal(json_string_value(json_object_get(json, "created_at")), "2007-06-25T09:30:00.125Z");
    assert_string_equal(json_string_value(json_object_get(json, "revision")), "1.3");
    assert_int_equal(json_integer_value(json_object_get(json, "queue_position")), 4);
    assert_true(json_is_null(json_object_get(json, "verdict")));
    assert_true(json_is_null(json_object_get(json, "trace_id")));
    assert_int_equal(json_array_size(json_object_get(json, "warnings")), 0);
    assert_string_equal(json_string_value(json_object_get(json, "priority")), "normal");
    assert_true(json_is_null(json_object_get(json_object_get(json, "links"), "preview")));
    json_decref(json);
    job.priority = JOB_PRIORITY_LOW;
    job.preview = true;
    char warnings[] = "[{\"pointer\":\"/cloth/seams/0\",\"detail\":\"crossed\"}]";
    job.warnings = warnings;
    memset(job.trace_id, 'a', sizeof job.trace_id - 1);
    json = body(&job, 0);
    assert_string_equal(json_string_value(json_object_get(json, "trace_id")), job.trace_id);
    assert_int_equal(json_array_size(json_object_get(json, "warnings")), 1);
    assert_string_equal(json_string_value(json_object_get(json, "priority")), "low");
    assert_string_equal(json_string_value(json_object_get(json_object_get(json, "links"), "preview")),
                        "/v1/jobs/0123456789abcdef0123456789abcdef/preview");
    json_decref(json);
}

static void test_job__names_are_escaped(void **state)
{
    (void)state;
    char name[] = "a \"b\" \\ \n\x01 \xc3\xa9";
    struct job job = {.id = "0", .name = name};
    json_t *json = body(&job, 0);
    assert_string_equal(json_string_value(json_object_get(json, "name")), name);
    assert_true(json_is_null(json_object_get(json, "queue_position")));
    json_decref(json);
}

static void test_job__a_copy_owns_its_texts(void **state)
{
    (void)state;
    struct job job = {.id = "1", .revision = {3, 4}, .name = strdup("n"), .report = strdup("{}")}, copy;
    assert_int_equal(job_copy(&job, &copy), 0);
    job_done(&job);
    assert_string_equal(copy.name, "n");
    assert_string_equal(copy.report, "{}");
    assert_null(copy.error);
    assert_int_equal(copy.revision.counter, 4);
    job_done(&copy);
}

#ifdef CAN_FAIL_ALLOCATIONS

static void test_job__a_copy_is_whole_or_none(void **state)
{
    (void)state;
    char *text[] = {strdup("n"), strdup("{}"), strdup("[]"), strdup("{}"), strdup("{}"), strdup("{}")};
    struct job job = {.id = "1",
                      .name = text[0],
                      .labels = text[1],
                      .warnings = text[2],
                      .progress = text[3],
                      .report = text[4],
                      .error = text[5]},
               copy = {.id = "other"};
    for (long n = 0; n <= 6; n++) {
        long before = held;
        countdown = n;
        assert_int_equal(job_copy(&job, &copy), n < 6 ? -1 : 0);
        assert_int_equal(held, n < 6 ? before : before + 6);
        assert_string_equal(copy.id, n < 6 ? "other" : "1");
    }
    countdown = -1;
    job_done(&copy);
    job_done(&job);
}

/* A body of some kilobytes grows while it is written. */
static void test_job__a_body_is_whole_or_none(void **state)
{
    (void)state;
    char name[20000];
    memset(name, '"', sizeof name);
    name[sizeof name - 1] = '\0';
    struct job job = {.id = "0", .name = name};
    char *whole = job_body(&job, 0), *text;
    long refusals = 0, n = 0, before = held;
    do {
        countdown = n++;
        text = job_body(&job, 0);
        refusals += text == NULL;
        assert_true(text != NULL || held == before);
        if (text != NULL)
            assert_string_equal(text, whole);
        free(text);
    } while (countdown < 0);
    countdown = -1;
    assert_true(refusals > 3);
    free(whole);
}
#endif

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_job__revisions_are_written_and_read_back),
        cmocka_unit_test(test_job__revisions_that_are_none_are_refused),
        cmocka_unit_test(test_job__revisions_are_ordered_by_attempt_then_counter),
        cmocka_unit_test(test_job__status_names_go_both_ways),
        cmocka_unit_test(test_job__body_has_every_member_of_the_contract),
        cmocka_unit_test(test_job__names_are_escaped),
        cmocka_unit_test(test_job__a_copy_owns_its_texts),
#ifdef CAN_FAIL_ALLOCATIONS
        cmocka_unit_test(test_job__a_copy_is_whole_or_none),
        cmocka_unit_test(test_job__a_body_is_whole_or_none),
#endif
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
