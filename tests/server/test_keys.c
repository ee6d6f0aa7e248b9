/* test_keys.c - key files, and whose key a request holds, while the file is read again. */
#include "scratch.h"

#include <pthread.h>
#include <stdatomic.h>
#include <sys/stat.h>

#include "keys.h"
#include "log.h"

#define DIGEST_OF_ABC                                                                                        \
    "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad" /* FIPS 180-2, B.1                    \
                                                                        */
#define OTHER_DIGEST "00000000000000000000000000000000000000000000000000000000000000ff"

static const struct quota defaults = {.queued = 7, .running = 3, .mesh_bytes = 500};

/* ---- the file ---------------------------------------------------------------------------------------- */

static int parse(const char *text, struct problem *problem)
{
    struct key *key;
    size_t count;
    memset(problem, 0, sizeof *problem);
    int failed = keys_parse(text, strlen(text), &defaults, &key, &count, problem);
    if (!failed)
        free(key);
    return failed;
}

static void test_keys__a_file_gives_names_hashes_and_quotas(void **state)
{
    (void)state;
    const char *text = "{\"keys\":[{\"name\":\"shop\",\"sha256\":\"" DIGEST_OF_ABC "\"},"
                       "{\"name\":\"b.a-c_9\",\"sha256\":\"" OTHER_DIGEST "\",\"queued\":0,\"running\":1,"
                       "\"mesh_bytes\":1125899906842624}]}";
    struct problem problem;
    struct key *key;
    size_t count;
    assert_int_equal(keys_parse(text, strlen(text), &defaults, &key, &count, &problem), 0);
    assert_int_equal(count, 2);
    assert_string_equal(key[0].name, "shop");
    assert_int_equal(key[0].digest[0], 0xba);
    assert_int_equal(key[0].digest[31], 0xad);
    assert_memory_equal(&key[0].quota, &defaults, sizeof defaults);
    assert_string_equal(key[1].name, "b.a-c_9");
    assert_int_equal(key[1].quota.queued, 0);
    assert_int_equal(key[1].quota.running, 1);
    assert_int_equal(key[1].quota.mesh_bytes, QUOTA_MAX_BYTES);
    free(key);
    assert_int_equal(parse("{\"keys\":[]}", &problem), 0);
}

static void test_keys__what_is_wrong_is_named_by_its_pointer(void **state)
{
    (void)state;
#define KEY "{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\"}"
    static const struct {
        const char *text, *pointer;
    } wrong[] = {
        {"[]", ""},
        {"{}", "/keys"},
        {"{\"keys\":{}}", "/keys"},
        {"{\"keys\":[],\"kes\":1}", "/kes"},
        {"{\"keys\":[1]}", "/keys/0"},
        {"{\"keys\":[{\"name\":\"a\"}]}", "/keys/0/sha256"},
        {"{\"keys\":[{\"sha256\":\"" DIGEST_OF_ABC "\"}]}", "/keys/0/name"},
        {"{\"keys\":[" KEY ",{\"name\":\"\",\"sha256\":\"" OTHER_DIGEST "\"}]}", "/keys/1/name"},
        {"{\"keys\":[{\"name\":\"a b\",\"sha256\":\"" OTHER_DIGEST "\"}]}", "/keys/0/name"},
        {"{\"keys\":[{\"name\":5,\"sha256\":\"" OTHER_DIGEST "\"}]}", "/keys/0/name"},
        {"{\"keys\":[" KEY ",{\"name\":\"a\",\"sha256\":\"" OTHER_DIGEST "\"}]}", "/keys/1/name"},
        {"{\"keys\":[" KEY ",{\"name\":\"b\",\"sha256\":\"" DIGEST_OF_ABC "\"}]}", "/keys/1/sha256"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"ba78\"}]}", "/keys/0/sha256"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "0\"}]}", "/keys/0/sha256"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":"
         "\"xa7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad\"}]}",
         "/keys/0/sha256"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\",\"key\":\"abc\"}]}", "/keys/0/key"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\",\"queued\":-1}]}", "/keys/0/queued"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\",\"queued\":1000001}]}",
         "/keys/0/queued"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\",\"running\":0}]}", "/keys/0/running"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\",\"running\":1.0}]}", "/keys/0/running"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\",\"mesh_bytes\":\"1\"}]}",
         "/keys/0/mesh_bytes"},
        {"{\"keys\":[{\"name\":\"a\",\"sha256\":\"" DIGEST_OF_ABC "\",\"mesh_bytes\":1125899906842625}]}",
         "/keys/0/mesh_bytes"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct problem problem;
        assert_int_equal(parse(wrong[i].text, &problem), -1);
        assert_int_equal(problem.code, PROBLEM_INVALID);
        assert_int_equal(problem.error_count, 1);
        assert_string_equal(problem.errors[0].pointer, wrong[i].pointer);
    }
}

static void test_keys__syntax_is_named_by_line_and_column(void **state)
{
    (void)state;
    static const char *const wrong[] = {"", "{", "{\"keys\":[],\"keys\":[]}", "{\"keys\":[]} x"};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct problem problem;
        assert_int_equal(parse(wrong[i], &problem), -1);
        assert_int_equal(problem.code, PROBLEM_BAD_JSON);
        assert_non_null(strstr(problem.detail, "Line 1, column "));
    }
}

/* A file of `count` keys; the caller frees it. */
static char *many(size_t count)
{
    char *text;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    fputs("{\"keys\":[", out);
    for (size_t i = 0; i < count; i++)
        fprintf(out, "%s{\"name\":\"k%zu\",\"sha256\":\"%064zx\"}", i ? "," : "", i, i);
    fputs("]}", out);
    fclose(out);
    return text;
}

static void test_keys__the_most_keys_are_taken_and_one_more_is_not(void **state)
{
    (void)state;
    struct problem problem;
    char *text = many(KEYS_MAX);
    assert_int_equal(parse(text, &problem), 0);
    free(text);
    text = many(KEYS_MAX + 1);
    assert_int_equal(parse(text, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_TOO_LARGE);
    assert_string_equal(problem.errors[0].pointer, "/keys");
    free(text);
}

static void test_keys__the_longest_name_and_the_longest_file_are_taken_and_a_byte_more_is_not(void **state)
{
    (void)state;
    struct problem problem;
    char text[256], *file = malloc(KEYS_FILE_BYTES + 2);
    for (int n = 31; n <= 32; n++) {
        snprintf(text, sizeof text, "{\"keys\":[{\"name\":\"%.*s\",\"sha256\":\"" DIGEST_OF_ABC "\"}]}", n,
                 "0123456789012345678901234567890123456789");
        assert_int_equal(parse(text, &problem), n == 31 ? 0 : -1);
    }
    memset(file, ' ', KEYS_FILE_BYTES + 1);
    memcpy(file, "{\"keys\":[]}", 11);
    file[KEYS_FILE_BYTES + 1] = '\0';
    assert_int_equal(parse(file, &problem), -1);
    assert_int_equal(problem.code, PROBLEM_TOO_LARGE);
    file[KEYS_FILE_BYTES] = '\0';
    assert_int_equal(parse(file, &problem), 0);
    free(file);
}

/* ---- the keys in force --------------------------------------------------------------------------------- */

static void write_file(const char *path, const char *text)
{
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    fputs(text, out);
    assert_int_equal(fclose(out), 0);
}

static const char *key_path(void **state)
{
    static char path[512];
    snprintf(path, sizeof path, "%s/keys.json", (char *)*state);
    return path;
}

/* A file with the given names, each with a key of its own in `key`. */
static void write_keys(const char *path, size_t count, char key[][KEY_TEXT_SIZE])
{
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    fputs("{\"keys\":[", out);
    for (size_t i = 0; i < count; i++) {
        char name[32], *entry;
        snprintf(name, sizeof name, "owner%zu", i);
        assert_int_equal(keys_make(name, key[i], &entry), 0);
        fprintf(out, "%s%s", i ? "," : "", entry);
        free(entry);
    }
    fputs("]}", out);
    assert_int_equal(fclose(out), 0);
}

static bool owner_of(struct keys *keys, const char *scheme, const char *key, char owner[KEY_NAME_SIZE])
{
    char header[1024];
    snprintf(header, sizeof header, "%s%s", scheme, key);
    return keys_owner(keys, header, owner);
}

static void test_keys__a_key_that_was_made_is_its_owners_and_no_other_is(void **state)
{
    char key[3][KEY_TEXT_SIZE], owner[KEY_NAME_SIZE] = "untouched", wrong[KEY_TEXT_SIZE];
    struct problem problem;
    struct keys *keys;
    write_keys(key_path(state), 3, key);
    assert_int_equal(keys_open(key_path(state), &defaults, &keys, &problem), 0);
    memcpy(wrong, key[1], sizeof wrong);
    wrong[63] = wrong[63] == '0' ? '1' : '0';
    const char *refused[] = {wrong, "", " ", "abc"};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        assert_false(owner_of(keys, "Bearer ", refused[i], owner));
    assert_false(owner_of(keys, "Basic ", key[1], owner));
    assert_false(owner_of(keys, "", key[1], owner));
    assert_false(owner_of(keys, "Bearer", key[1], owner));
    assert_false(keys_owner(keys, NULL, owner));
    assert_string_equal(owner, "untouched");
    assert_true(owner_of(keys, "Bearer ", key[1], owner));
    assert_string_equal(owner, "owner1");
    assert_true(owner_of(keys, "bearer   ", key[2], owner)); /* RFC 9110: schemes have no case */
    assert_string_equal(owner, "owner2");
    keys_free(keys);
}

static void test_keys__a_token_may_have_512_bytes(void **state)
{
    char text[512], token[514], digest[SHA256_SIZE], owner[KEY_NAME_SIZE];
    struct problem problem;
    struct keys *keys;
    memset(token, 'x', 513);
    token[512] = '\0';
    sha256_hex(token, 512, digest);
    snprintf(text, sizeof text, "{\"keys\":[{\"name\":\"long\",\"sha256\":\"%s\"}]}", digest);
    write_file(key_path(state), text);
    assert_int_equal(keys_open(key_path(state), &defaults, &keys, &problem), 0);
    assert_true(owner_of(keys, "Bearer ", token, owner));
    keys_free(keys);

    token[512] = 'x';
    token[513] = '\0';
    sha256_hex(token, 513, digest);
    snprintf(text, sizeof text, "{\"keys\":[{\"name\":\"longer\",\"sha256\":\"%s\"}]}", digest);
    write_file(key_path(state), text);
    assert_int_equal(keys_open(key_path(state), &defaults, &keys, &problem), 0);
    assert_false(owner_of(keys, "Bearer ", token, owner));
    keys_free(keys);
}

static void test_keys__the_quota_of_an_owner_without_a_key_is_the_default(void **state)
{
    struct problem problem;
    struct keys *keys;
    write_file(key_path(state),
               "{\"keys\":[{\"name\":\"shop\",\"sha256\":\"" DIGEST_OF_ABC "\",\"queued\":1}]}");
    assert_int_equal(keys_open(key_path(state), &defaults, &keys, &problem), 0);
    assert_int_equal(keys_quota(keys, "shop").queued, 1);
    assert_int_equal(keys_quota(keys, "shop").running, 3);
    assert_int_equal(keys_quota(keys, "gone").queued, 7);
    assert_int_equal(keys_quota(keys, "").mesh_bytes, 500);
    keys_free(keys);
}

static void test_keys__a_file_read_again_counts_and_a_broken_one_does_not(void **state)
{
    char first[1][KEY_TEXT_SIZE], second[2][KEY_TEXT_SIZE], owner[KEY_NAME_SIZE];
    struct problem problem;
    struct keys *keys;
    write_keys(key_path(state), 1, first);
    assert_int_equal(keys_open(key_path(state), &defaults, &keys, &problem), 0);
    write_keys(key_path(state), 2, second);
    assert_false(owner_of(keys, "Bearer ", second[1], owner)); /* not yet */
    assert_int_equal(keys_reload(keys, &problem), 0);
    assert_true(owner_of(keys, "Bearer ", second[1], owner));
    assert_false(owner_of(keys, "Bearer ", first[0], owner)); /* gone */
    write_file(key_path(state), "{\"keys\":[");
    assert_int_equal(keys_reload(keys, &problem), -1);
    assert_true(owner_of(keys, "Bearer ", second[0], owner));
    assert_int_equal(remove(key_path(state)), 0);
    assert_int_equal(keys_reload(keys, &problem), -1);
    assert_non_null(strstr(problem.detail, "No such file"));
    assert_int_equal(mkdir(key_path(state), 0700), 0);
    assert_int_equal(keys_reload(keys, &problem), -1);
    assert_true(owner_of(keys, "Bearer ", second[1], owner));
    keys_free(keys);
    assert_int_equal(keys_open(key_path(state), &defaults, &keys, &problem), -1);
}

static void test_keys__made_keys_differ_and_names_are_checked(void **state)
{
    (void)state;
    char a[KEY_TEXT_SIZE], b[KEY_TEXT_SIZE], *entry;
    const char *refused[] = {"", "a b", "a\"b", "\xc3\xa4", "01234567890123456789012345678901"};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        assert_int_equal(keys_make(refused[i], a, &entry), -1);
    assert_int_equal(keys_make("shop", a, &entry), 0);
    assert_null(strstr(entry, a));
    free(entry);
    assert_int_equal(keys_make("shop", b, &entry), 0);
    free(entry);
    assert_true(sha256_valid(a) && sha256_valid(b));
    assert_string_not_equal(a, b);
}

/* ---- readers while the file is read again ----------------------------------------------------------------
 */

struct reading {
    struct keys *keys;
    const char *key; /* in every file */
    atomic_bool done;
    atomic_ulong reads;
};

static void *read_keys(void *data)
{
    struct reading *reading = data;
    char owner[KEY_NAME_SIZE];
    while (!atomic_load(&reading->done)) {
        if (!owner_of(reading->keys, "Bearer ", reading->key, owner) || strcmp(owner, "shop") != 0 ||
            keys_quota(reading->keys, "shop").queued > 1)
            abort();
        atomic_fetch_add(&reading->reads, 1);
    }
    return NULL;
}

static void test_keys__readers_never_miss_a_key_that_stays(void **state)
{
    static const char *const file[] = {"{\"keys\":[{\"name\":\"shop\",\"sha256\":\"" DIGEST_OF_ABC
                                       "\",\"queued\":0}]}",
                                       "{\"keys\":[{\"name\":\"other\",\"sha256\":\"" OTHER_DIGEST "\"},"
                                       "{\"name\":\"shop\",\"sha256\":\"" DIGEST_OF_ABC "\",\"queued\":1}]}"};
    struct problem problem;
    struct reading reading = {.key = "abc"};
    pthread_t thread[2];
    write_file(key_path(state), file[0]);
    assert_int_equal(keys_open(key_path(state), &defaults, &reading.keys, &problem), 0);
    for (int i = 0; i < 2; i++)
        assert_int_equal(pthread_create(&thread[i], NULL, read_keys, &reading), 0);
    for (int i = 0; i < 200 || atomic_load(&reading.reads) < 200; i++) {
        write_file(key_path(state), file[i % 2]);
        assert_int_equal(keys_reload(reading.keys, &problem), 0);
    }
    atomic_store(&reading.done, true);
    for (int i = 0; i < 2; i++)
        pthread_join(thread[i], NULL);
    keys_free(reading.keys);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_keys__a_file_gives_names_hashes_and_quotas),
        TEST(test_keys__what_is_wrong_is_named_by_its_pointer),
        TEST(test_keys__syntax_is_named_by_line_and_column),
        TEST(test_keys__the_most_keys_are_taken_and_one_more_is_not),
        TEST(test_keys__the_longest_name_and_the_longest_file_are_taken_and_a_byte_more_is_not),
        TEST(test_keys__a_key_that_was_made_is_its_owners_and_no_other_is),
        TEST(test_keys__a_token_may_have_512_bytes),
        TEST(test_keys__the_quota_of_an_owner_without_a_key_is_the_default),
        TEST(test_keys__a_file_read_again_counts_and_a_broken_one_does_not),
        TEST(test_keys__made_keys_differ_and_names_are_checked),
        TEST(test_keys__readers_never_miss_a_key_that_stays),
    };
    id_init();
    log_open(LOG_LEVEL_ERROR);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
