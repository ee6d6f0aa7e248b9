/* test_config.c - flags, and what is refused at the command line. */
#include "scratch.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include "config.h"

static struct config config;
static char message[256];

static int parse(const char *a, const char *b)
{
    static char name[] = "draped", first[256], second[256]; /* config points into them */
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
    assert_null(config.url_file);
    assert_null(config.make_key);
    assert_string_equal(config.keys, "");
    assert_memory_equal(&config.limits, &limits_default, sizeof limits_default);
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
    assert_int_equal(parse("--max-reading=5", "--max-time=60"), 0);
    assert_int_equal(config.limits.reading, 5);
    assert_close(config.limits.time_limit_s, 60, 0);
    assert_int_equal(config.field_cache_bytes, CONFIG_FIELD_CACHE_BYTES);
    assert_int_equal(parse("--field-cache=0", NULL), 0);
    assert_int_equal(config.field_cache_bytes, 0);
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
        assert_int_equal(parse(refused[i], NULL), -1);
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
                             "--field-cache=-1",
                             "--max-queued=0",
                             "--max-vertices=99999999",
                             "--max-queued=99999999999999999999",
                             "--log-level=loud",
                             "--data=",
                             "--keys=",
                             "stray"};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        assert_int_equal(parse(refused[i], NULL), -1);
        assert_true(strlen(message) > 5);
    }
}

static void test_config__streams_must_leave_connections_for_others(void **state)
{
    (void)state;
    assert_int_equal(parse("--max-streams=10", "--max-connections=10"), -1);
    assert_non_null(strstr(message, "--max-streams"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_config__no_flags_give_the_documented_defaults),
        cmocka_unit_test(test_config__the_folder_of_a_service_is_systemds),
        cmocka_unit_test_setup_teardown(test_config__the_keys_of_a_service_are_its_credential, scratch_new,
                                        scratch_free),
        cmocka_unit_test(test_config__each_flag_sets_its_own_member),
        cmocka_unit_test(test_config__without_keys_only_loopback_is_served),
        cmocka_unit_test(test_config__with_keys_any_address_is_served),
        cmocka_unit_test(test_config__addresses_that_are_none_are_refused),
        cmocka_unit_test(test_config__numbers_out_of_range_are_refused),
        cmocka_unit_test(test_config__streams_must_leave_connections_for_others),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
