/* test_config.c - flags, environment and file: who wins, and what is refused where. */
#include "test.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <sysexits.h>

#include "conffile.h"
#include "config.h"
#include "scratch.h"

static struct config config;
static char message[CONFIG_MESSAGE_SIZE];

static int parse(const char *a, const char *b)
{
    char name[] = "draped", first[CONFIG_TEXT_SIZE + 16], second[256];
    char *argv[] = {name, first, second, NULL};
    snprintf(first, sizeof first, "%s", a ? a : "");
    snprintf(second, sizeof second, "%s", b ? b : "");
    message[0] = '\0';
    return config_parse(a == NULL ? 1 : b == NULL ? 2 : 3, argv, &config, message, sizeof message);
}

static void test_config__no_flags_give_the_documented_defaults(void **state)
{
    (void)state;
    unsetenv("STATE_DIRECTORY");
    unsetenv("CREDENTIALS_DIRECTORY");
    assert_int_equal(parse(NULL, NULL), 0);
    const struct sockaddr_in *listen = (const struct sockaddr_in *)&config.listen;
    const struct sockaddr_in *admin = (const struct sockaddr_in *)&config.admin;
    assert_int_equal(listen->sin_addr.s_addr, htonl(INADDR_LOOPBACK));
    assert_int_equal(ntohs(listen->sin_port), 8080);
    assert_int_equal(ntohs(admin->sin_port), 8081);
    assert_string_equal(config.data, CONFIG_DEFAULT_DATA);
    assert_true(config.workers >= 1);
    assert_int_equal(config.drain_seconds, 10);
    assert_string_equal(config.url_file, "");
    assert_string_equal(config.keys, "");
    assert_false(config.check_only);
    assert_null(config.make_key);
    assert_memory_equal(&config.limits, &limits_default, sizeof limits_default);
}

static void test_config__origins_may_be_given_several_times(void **state)
{
    (void)state;
    assert_int_equal(parse("--cors-origin=https://a.example", "--cors-origin=http://b:5173"), 0);
    assert_string_equal(config.cors_origins, "https://a.example http://b:5173");
    setenv("DRAPED_CORS_ORIGIN", " https://c.example  https://d.example ", 1);
    assert_int_equal(parse(NULL, NULL), 0);
    assert_string_equal(config.cors_origins, "https://c.example https://d.example");
    assert_int_equal(parse("--cors-origin=https://a.example", NULL), 0);
    assert_string_equal(config.cors_origins, "https://a.example"); /* a flag replaces the environment's */
    unsetenv("DRAPED_CORS_ORIGIN");
    assert_int_equal(parse("--cors-origin=https://a.example", "--cors-origin=*"), EX_USAGE);
    assert_non_null(strstr(message, "--cors-origin: \"*\" is not an origin"));
    assert_int_equal(parse("--cors-origin=", NULL), EX_USAGE);
}

static void test_config__the_folder_of_a_service_is_systemds(void **state)
{
    (void)state;
    setenv("STATE_DIRECTORY", "/var/lib/draped", 1);
    assert_int_equal(parse(NULL, NULL), 0);
    assert_string_equal(config.data, "/var/lib/draped");
    unsetenv("STATE_DIRECTORY");
}

static void test_config__the_keys_of_a_service_are_its_credential(void **state)
{
    char path[600], file[700];
    snprintf(path, sizeof path, "%s", (char *)*state);
    snprintf(file, sizeof file, "%s/keys", path);
    setenv("CREDENTIALS_DIRECTORY", path, 1);
    assert_int_equal(parse(NULL, NULL), 0);
    assert_string_equal(config.keys, ""); /* it has none of that name */
    FILE *out = fopen(file, "w");
    assert_non_null(out);
    fclose(out);
    assert_int_equal(parse("--listen=0.0.0.0:80", NULL), 0);
    assert_string_equal(config.keys, file);
    assert_int_equal(parse("--keys=/else/where", NULL), 0);
    assert_string_equal(config.keys, "/else/where");
    unsetenv("CREDENTIALS_DIRECTORY");
}

static void test_config__each_flag_sets_its_own_member(void **state)
{
    (void)state;
    assert_int_equal(parse("--listen=[::1]:0", "--admin=localhost:9"), 0);
    assert_int_equal(config.listen.ss_family, AF_INET6);
    assert_int_equal(ntohs(((struct sockaddr_in *)&config.admin)->sin_port), 9);
    assert_int_equal(parse("--workers=7", "--drain-timeout=0"), 0);
    assert_int_equal(config.workers, 7);
    assert_int_equal(config.drain_seconds, 0);
    assert_int_equal(parse("--max-body=4096", "--max-queued=3"), 0);
    assert_int_equal(config.limits.body_bytes, 4096);
    assert_int_equal(config.limits.queued_jobs, 3);
    assert_int_equal(parse("--max-vertices=25", "--max-triangles=32"), 0);
    assert_int_equal(config.limits.vertices, 25);
    assert_int_equal(config.limits.triangles, 32);
    assert_int_equal(parse("--max-streams=9", "--max-connections=10"), 0);
    assert_int_equal(config.limits.streams, 9);
    assert_int_equal(config.limits.connections, 10);
    assert_int_equal(parse("--memory=2000000", "--job-memory=1000000"), 0);
    assert_int_equal(config.limits.memory, 2000000);
    assert_int_equal(config.limits.job_memory, 1000000);
    assert_int_equal(parse("--max-reading=5", "--max-time=60"), 0);
    assert_int_equal(config.limits.reading, 5);
    assert_close(config.limits.time_limit_s, 60, 0);
    assert_int_equal(config.field_cache_bytes, CONFIG_FIELD_CACHE_BYTES);
    assert_int_equal(parse("--field-cache=0", NULL), 0);
    assert_int_equal(config.field_cache_bytes, 0);
    assert_int_equal(config.analysis_cache_bytes, CONFIG_ANALYSIS_CACHE_BYTES);
    assert_int_equal(parse("--analysis-cache=0", NULL), 0);
    assert_int_equal(config.analysis_cache_bytes, 0);
    assert_int_equal(parse("--log-level=debug", "--url-file=/tmp/u"), 0);
    assert_int_equal(config.log_level, LOG_LEVEL_DEBUG);
    assert_string_equal(config.url_file, "/tmp/u");
}

static void test_config__without_keys_only_loopback_is_served(void **state)
{
    (void)state;
    const char *refused[] = {"--listen=0.0.0.0:8080", "--listen=192.168.1.2:8080", "--listen=[::]:8080",
                             "--admin=0.0.0.0:0", "--listen=128.0.0.1:1"};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        assert_int_equal(parse(refused[i], NULL), EX_USAGE);
        assert_non_null(strstr(message, "loopback"));
    }
    assert_int_equal(parse("--listen=127.255.0.1:1", NULL), 0);
}

static void test_config__with_keys_any_address_is_served(void **state)
{
    (void)state;
    assert_int_equal(parse("--keys=k.json", "--listen=0.0.0.0:8080"), 0);
    assert_string_equal(config.keys, "k.json");
    assert_int_equal(parse("--listen=[::]:0", "--keys=k.json"), 0); /* in either order */
    assert_int_equal(parse("--admin=192.0.2.1:0", "--keys=k.json"), 0);
}

static void test_config__addresses_that_are_none_are_refused(void **state)
{
    (void)state;
    const char *refused[] = {"",
                             "8080",
                             ":8080",
                             "127.0.0.1",
                             "127.0.0.1:",
                             "127.0.0.1:65536",
                             "127.0.0.1:+1",
                             "127.0.0.1: 1",
                             "::1:80",
                             "[::1]",
                             "[]:1",
                             "example.org:80",
                             "127.0.0.1:99999999999"};
    struct sockaddr_storage address;
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        assert_int_equal(config_parse_address(refused[i], &address, message, sizeof message), -1);
    assert_int_equal(config_parse_address("127.0.0.1:65535", &address, message, sizeof message), 0);
}

static void test_config__numbers_out_of_range_are_refused(void **state)
{
    (void)state;
    const char *refused[] = {"--workers=0",
                             "--workers=257",
                             "--workers=-1",
                             "--workers=two",
                             "--workers=",
                             "--drain-timeout=1.5",
                             "--max-body=1",
                             "--job-memory=999999",
                             "--field-cache=-1",
                             "--analysis-cache=-1",
                             "--max-queued=0",
                             "--max-vertices=99999999",
                             "--max-queued=99999999999999999999",
                             "--log-level=loud",
                             "--data=",
                             "--keys=",
                             "stray"};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        assert_int_equal(parse(refused[i], NULL), EX_USAGE);
        assert_true(strlen(message) > 5);
    }
}

static void test_config__streams_must_leave_connections_for_others(void **state)
{
    (void)state;
    assert_int_equal(parse("--max-streams=10", "--max-connections=10"), EX_USAGE);
    assert_non_null(strstr(message, "--max-streams"));
}

static void test_config__texts_may_be_as_long_as_a_path(void **state)
{
    (void)state;
    char flag[CONFIG_TEXT_SIZE + 16] = "--data=";
    size_t head = strlen(flag);
    memset(flag + head, 'x', CONFIG_TEXT_SIZE - 1);
    assert_int_equal(parse(flag, NULL), 0);
    assert_int_equal(strlen(config.data), CONFIG_TEXT_SIZE - 1);
    flag[head + CONFIG_TEXT_SIZE - 1] = 'x';
    assert_int_equal(parse(flag, NULL), EX_USAGE);
    assert_non_null(strstr(message, "--data: it is longer"));
    assert_int_equal(parse("--data=a\nb", NULL), EX_USAGE);
}

/* ---- the file ---------------------------------------------------------------------------------------- */

static const char *scratch_dir;
static char path[300];

/* Parses with a file of `text`, and up to one flag more. */
static int parse_file(const char *text, size_t bytes, const char *flag)
{
    char config_flag[320];
    snprintf(path, sizeof path, "%s/draped.conf", scratch_dir);
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    assert_int_equal(fwrite(text, 1, bytes, out), bytes);
    fclose(out);
    snprintf(config_flag, sizeof config_flag, "--config=%s", path);
    return parse(config_flag, flag);
}

static void refused_in_file(const char *text, size_t bytes, const char *where_and_why)
{
    char expected[512];
    assert_int_equal(parse_file(text, bytes, NULL), EX_CONFIG);
    snprintf(expected, sizeof expected, "%s:%s", path, where_and_why);
    assert_string_equal(message, expected);
}
#define REFUSED_IN_FILE(text, why) refused_in_file(text, sizeof(text) - 1, why)

static void test_config__a_file_gives_settings(void **state)
{
    (void)state;
    static const char text[] = "\xEF\xBB\xBF# comment\n; another\n\nworkers = 3\r\n  max-queued=7 ; why\n"
                               "\tdata : /srv/x y\nlisten = [::1]:0\nlog-level = error\nmax-time = 9";
    assert_int_equal(parse_file(text, sizeof text - 1, NULL), 0);
    assert_int_equal(config.workers, 3);
    assert_int_equal(config.limits.queued_jobs, 7);
    assert_string_equal(config.data, "/srv/x y");
    assert_int_equal(config.listen.ss_family, AF_INET6);
    assert_int_equal(config.log_level, LOG_LEVEL_ERROR);
    assert_close(config.limits.time_limit_s, 9, 0);
    assert_string_equal(config.file, path);
    assert_int_equal(parse_file("", 0, NULL), 0);
}

static void test_config__what_is_wrong_in_a_file_is_named_with_its_line(void **state)
{
    (void)state;
    REFUSED_IN_FILE("\nworker = 3\n", "2: there is no setting \"worker\"");
    REFUSED_IN_FILE("workers = 3\n# x\nworkers = 3\n", "3: workers stands in line 1 already");
    REFUSED_IN_FILE("workers = 3\n workers = 4\n", "2: workers stands in line 1 already");
    REFUSED_IN_FILE("workers = 0\n", "1: workers: \"0\" is not a number from 1 to 256");
    REFUSED_IN_FILE("workers =\n", "1: workers: \"\" is not a number from 1 to 256");
    REFUSED_IN_FILE("data =\n", "1: data: it must not be empty");
    REFUSED_IN_FILE("data = a\x01z\n", "1: data: it holds a control character");
    REFUSED_IN_FILE("log-level = loud\n", "1: log-level: \"loud\" is none of: error, warning, info or debug");
    REFUSED_IN_FILE("listen = here\n", "1: listen: \"here\" is not HOST:PORT");
    REFUSED_IN_FILE("[limits]\nmax-queued = 3\n", "2: there are no [sections] here");
    REFUSED_IN_FILE("workers\nworkers = x\n", "1: this is not `name = value'");
    REFUSED_IN_FILE("[limits\n", "1: this is not `name = value'");
    REFUSED_IN_FILE("= 3\n", "1: there is no setting \"\"");
    REFUSED_IN_FILE("workers = 3\ndata = x\0y\n", "2: a NUL byte");
    REFUSED_IN_FILE("config = /etc/other\n", "1: there is no setting \"config\"");
    REFUSED_IN_FILE(
        "listen = 0.0.0.0:1\n",
        "1: listen: 0.0.0.0:1 is not a loopback address: without --keys only this machine is served");
    REFUSED_IN_FILE("max-connections = 10\nmax-streams = 10\n",
                    "2: max-streams: 10 must be below max-connections, 10");
}

static void test_config__a_line_is_taken_whole_or_refused(void **state)
{
    (void)state;
    char text[CONFFILE_LINE_SIZE + 1] = "data = ";
    size_t head = strlen(text), longest = CONFFILE_LINE_SIZE - 1; /* its end counted */
    memset(text + head, 'x', sizeof text - head);
    text[longest - 1] = '\n';
    assert_int_equal(parse_file(text, longest, NULL), 0);
    assert_int_equal(strlen(config.data), longest - 1 - head);
    text[longest - 1] = 'x';
    text[longest] = '\n';
    refused_in_file(text, longest + 1, "1: this line is too long");
}

static void test_config__a_file_that_is_asked_for_must_be_there(void **state)
{
    (void)state;
    assert_int_equal(parse("--config=/nonexistent/draped.conf", NULL), EX_CONFIG);
    assert_string_equal(message, "/nonexistent/draped.conf: No such file or directory");
    assert_int_equal(parse("--config=/", NULL), EX_CONFIG);
    assert_int_equal(parse(NULL, NULL), 0);
    assert_string_equal(config.file, "");
    parse_file("workers = 5\n", 12, NULL);
    setenv("CONFIGURATION_DIRECTORY", scratch_dir, 1);
    assert_int_equal(parse(NULL, NULL), 0);
    assert_int_equal(config.workers, 5);
    setenv("CONFIGURATION_DIRECTORY", "/nonexistent", 1);
    setenv("DRAPED_CONFIG", "/nonexistent/draped.conf", 1);
    assert_int_equal(parse(NULL, NULL), EX_CONFIG);
    assert_int_equal(parse_file("workers = 6\n", 12, NULL), 0);
    assert_int_equal(config.workers, 6);
    unsetenv("DRAPED_CONFIG");
}

/* ---- who wins ---------------------------------------------------------------------------------------- */

static void test_config__flags_win_over_the_environment_and_that_over_the_file(void **state)
{
    (void)state;
    static const char text[] = "workers = 3\nmax-queued = 30\n";
    setenv("DRAPED_WORKERS", "4", 1);
    setenv("DRAPED_DRAIN_TIMEOUT", "", 1); /* empty: as if it were not there */
    assert_int_equal(parse_file(text, sizeof text - 1, "--workers=5"), 0);
    assert_int_equal(config.workers, 5);
    assert_int_equal(config.drain_seconds, 10);
    assert_int_equal(parse_file(text, sizeof text - 1, NULL), 0);
    assert_int_equal(config.workers, 4);
    assert_int_equal(config.limits.queued_jobs, 30);
    unsetenv("DRAPED_WORKERS");
    unsetenv("DRAPED_DRAIN_TIMEOUT");
    assert_int_equal(parse_file(text, sizeof text - 1, NULL), 0);
    assert_int_equal(config.workers, 3);
}

static void test_config__a_bad_value_is_refused_also_where_another_wins(void **state)
{
    (void)state;
    setenv("DRAPED_WORKERS", "four", 1);
    assert_int_equal(parse("--workers=5", NULL), EX_USAGE);
    assert_string_equal(message, "DRAPED_WORKERS: \"four\" is not a number from 1 to 256");
    unsetenv("DRAPED_WORKERS");
    assert_int_equal(parse_file("workers = x\n", 12, "--workers=5"), EX_CONFIG);
}

/* ---- what is in force -------------------------------------------------------------------------------- */

static char *printed(void)
{
    char *text = NULL;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    assert_non_null(out);
    config_print(out, &config);
    fclose(out);
    return text;
}

static void test_config__check_prints_every_setting_with_its_source(void **state)
{
    (void)state;
    char line[400];
    setenv("DRAPED_MAX_QUEUED", "8", 1);
    setenv("DRAPED_WORKER", "8", 1);
    assert_int_equal(parse_file("# one\nmax-body = 2048\n", 22, "--check-config"), 0);
    assert_true(config.check_only);
    char *text = printed();
    snprintf(line, sizeof line, "max-body = 2048  ; %s:2: max-body\n", path);
    assert_non_null(strstr(text, line));
    assert_non_null(strstr(text, "max-queued = 8  ; DRAPED_MAX_QUEUED\n"));
    assert_non_null(strstr(text, "max-streams = 128  ; default\n"));
    assert_non_null(strstr(text, "listen = 127.0.0.1:8080  ; default\n"));
    assert_non_null(strstr(text, "# url-file =   ; default\n"));
    assert_non_null(strstr(text, "# DRAPED_WORKER is in the environment, and no setting\n"));
    free(text);
    unsetenv("DRAPED_MAX_QUEUED");
    unsetenv("DRAPED_WORKER");
}

static void test_config__what_check_prints_is_a_file_of_the_same_settings(void **state)
{
    (void)state;
    static const char text[] = "workers = 9\nlisten = [::1]:1\nfield-cache = 5\nlog-level = debug\n"
                               "max-time = 77\nurl-file = /run/u\nmax-streams = 9\n";
    assert_int_equal(parse_file(text, sizeof text - 1, NULL), 0);
    struct config first = config;
    char *again = printed();
    assert_int_equal(parse_file(again, strlen(again), NULL), 0);
    free(again);
    memset(first.origin, 0, sizeof first.origin);
    memset(config.origin, 0, sizeof config.origin);
    assert_memory_equal(&config.limits, &first.limits, sizeof first.limits);
    assert_memory_equal(&config.listen, &first.listen, sizeof first.listen);
    assert_string_equal(config.url_file, first.url_file);
    assert_int_equal(config.workers, 9);
    assert_int_equal(config.field_cache_bytes, 5);
    assert_int_equal(config.log_level, LOG_LEVEL_DEBUG);
}

static int set_up(void **state)
{
    /* None of what this machine has. */
    unsetenv("STATE_DIRECTORY");
    setenv("CONFIGURATION_DIRECTORY", "/nonexistent", 1);
    int failed = scratch_new(state);
    scratch_dir = *state;
    return failed;
}

static void test_config__one_job_must_fit_into_the_memory_of_all(void **state)
{
    (void)state;
    assert_int_equal(parse("--memory=5000000", "--job-memory=5000000"), 0);
    assert_int_equal(parse("--memory=5000000", "--job-memory=5000001"), EX_USAGE);
    assert_non_null(strstr(message, "--job-memory"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_config__no_flags_give_the_documented_defaults),
        cmocka_unit_test(test_config__origins_may_be_given_several_times),
        cmocka_unit_test(test_config__the_folder_of_a_service_is_systemds),
        cmocka_unit_test_setup_teardown(test_config__the_keys_of_a_service_are_its_credential, scratch_new,
                                        scratch_free),
        cmocka_unit_test(test_config__each_flag_sets_its_own_member),
        cmocka_unit_test(test_config__without_keys_only_loopback_is_served),
        cmocka_unit_test(test_config__with_keys_any_address_is_served),
        cmocka_unit_test(test_config__addresses_that_are_none_are_refused),
        cmocka_unit_test(test_config__numbers_out_of_range_are_refused),
        cmocka_unit_test(test_config__one_job_must_fit_into_the_memory_of_all),
        cmocka_unit_test(test_config__streams_must_leave_connections_for_others),
        cmocka_unit_test(test_config__texts_may_be_as_long_as_a_path),
        cmocka_unit_test(test_config__a_file_gives_settings),
        cmocka_unit_test(test_config__what_is_wrong_in_a_file_is_named_with_its_line),
        cmocka_unit_test(test_config__a_line_is_taken_whole_or_refused),
        cmocka_unit_test(test_config__a_file_that_is_asked_for_must_be_there),
        cmocka_unit_test(test_config__flags_win_over_the_environment_and_that_over_the_file),
        cmocka_unit_test(test_config__a_bad_value_is_refused_also_where_another_wins),
        cmocka_unit_test(test_config__check_prints_every_setting_with_its_source),
        cmocka_unit_test(test_config__what_check_prints_is_a_file_of_the_same_settings),
    };
    return cmocka_run_group_tests(tests, set_up, scratch_free);
}
