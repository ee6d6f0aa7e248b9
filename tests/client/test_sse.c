/* test_sse.c - an event stream means the same however it is cut into pieces. */
#include "test.h"

#include "sse.h"

static const char stream[] = ": heartbeat\n\nid: 1.2\nevent: state\ndata: {\"a\":1}\n\n"
                             "data: first\r\ndata:second\r\n\r\nid: 1.3\n\nevent: nothing\n\n"
                             "unknown: x\nid:1.4\nevent:end\ndata\ndata: z\n\n";
static const char expected[] = "state={\"a\":1}@1.2|message=first\nsecond@1.2|end=\nz@1.4|";

struct log {
    char text[512];
    struct sse *sse;
    int stop_after;
};

static int on_event(const char *name, const char *data, size_t bytes, void *user)
{
    struct log *log = user;
    size_t used = strlen(log->text);
    assert_int_equal(strlen(data), bytes);
    snprintf(log->text + used, sizeof log->text - used, "%s=%s@%s|", name, data, log->sse->last_id);
    return log->stop_after > 0 && --log->stop_after == 0;
}

static struct sse *new_parser(struct log *log)
{
    struct sse *sse = calloc(1, sizeof *sse);
    assert_non_null(sse);
    *log = (struct log){.sse = sse};
    sse->on_event = on_event;
    sse->user = log;
    return sse;
}

static void test_sse__reads_a_stream_cut_anywhere(void **state)
{
    struct log log;
    (void)state;
    for (size_t cut = 0; cut < sizeof stream; cut++) {
        struct sse *sse = new_parser(&log);
        assert_int_equal(sse_feed(sse, stream, cut), 0);
        assert_int_equal(sse_feed(sse, stream + cut,
                                  sizeof stream - 1 - (cut < sizeof stream - 1 ? cut : sizeof stream - 1)),
                         0);
        assert_string_equal(log.text, expected);
        free(sse);
    }
}

static void test_sse__restart_drops_half_an_event_and_its_id(void **state)
{
    struct log log;
    struct sse *sse = new_parser(&log);
    (void)state;
    const char half[] = "id: 6\n\nid: 7\nevent: x\ndata: lost\nda", next[] = "data: kept\n\n";
    assert_int_equal(sse_feed(sse, half, strlen(half)), 0);
    sse_restart(sse);
    assert_int_equal(sse_feed(sse, next, strlen(next)), 0);
    assert_string_equal(log.text, "message=kept@6|");
    free(sse);
}

static void test_sse__an_id_too_long_to_keep_is_not_cut_short(void **state)
{
    struct log log;
    struct sse *sse = new_parser(&log);
    char text[SSE_ID_SIZE + 64];
    (void)state;
    for (int over = 0; over < 2; over++) {
        int digits = SSE_ID_SIZE - 1 + over;
        int n = snprintf(text, sizeof text, "id: %0*d\ndata: x\n\n", digits, 5);
        assert_int_equal(sse_feed(sse, text, (size_t)n), 0);
        assert_int_equal(strlen(sse->last_id), SSE_ID_SIZE - 1); /* the second leaves the first in place */
        assert_int_equal(sse->last_id[SSE_ID_SIZE - 2], '5');
    }
    free(sse);
}

static void test_sse__ends_when_asked_and_when_a_line_never_ends(void **state)
{
    struct log log;
    struct sse *sse = new_parser(&log);
    (void)state;
    log.stop_after = 1;
    assert_int_equal(sse_feed(sse, stream, sizeof stream - 1), 1);
    sse_restart(sse);
    int status = 0;
    for (size_t i = 0; i < SSE_MAX_BYTES && status == 0; i++) {
        status = sse_feed(sse, "x", 1);
    }
    assert_int_equal(status, -1);
    free(sse);
    sse = new_parser(&log);
    status = 0;
    for (size_t i = 0; i < SSE_MAX_BYTES && status == 0; i++) {
        status = sse_feed(sse, "data: 0123456789\n", 17);
    }
    assert_int_equal(status, -1);
    free(sse);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sse__reads_a_stream_cut_anywhere),
        cmocka_unit_test(test_sse__restart_drops_half_an_event_and_its_id),
        cmocka_unit_test(test_sse__an_id_too_long_to_keep_is_not_cut_short),
        cmocka_unit_test(test_sse__ends_when_asked_and_when_a_line_never_ends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
