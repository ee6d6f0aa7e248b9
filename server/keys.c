/* keys.c - see keys.h. */
#include "keys.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include <sodium.h>

#include "files.h"
#include "jsonin.h"
#include "jsontext.h"
#include "log.h"

/* Of a token that is looked at; ours have 64. */
#define TOKEN_BYTES 512

struct keys {
    char *path;
    struct quota defaults;
    pthread_mutex_t lock; /* guards the two below */
    struct key *key;      /* by name */
    size_t count;
};

_Static_assert(sizeof((struct key *)0)->digest == crypto_hash_sha256_BYTES, "a digest is a SHA-256");

/* ---- the file ---------------------------------------------------------------------------------------- */

static bool name_valid(const char *name)
{
    size_t n = strlen(name);
    return n > 0 && n < KEY_NAME_SIZE &&
           strspn(name, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789._-") == n;
}

/* The text of a member; NULL when it is absent or none. */
static const char *text_of(const json_t *entry, const char *member)
{
    return json_string_value(json_object_get(entry, member));
}

/* A whole number from `low` to `high`; absent, *ret stays. 0, or -1 with *reterr. */
static int read_number(const json_t *entry, const char *pointer, const char *member, uint64_t low,
                       uint64_t high, uint64_t *ret, struct problem *reterr)
{
    char at[JSONTEXT_POINTER_BYTES];
    const json_t *value = json_object_get(entry, member);
    json_int_t number = json_integer_value(value);
    if (value == NULL)
        return 0;
    jsontext_pointer(at, sizeof at, pointer, member);
    if (!json_is_integer(value) || number < 0 || (uint64_t)number < low || (uint64_t)number > high)
        return problem_at(reterr, PROBLEM_INVALID, at, "must be a whole number from %llu to %llu",
                          (unsigned long long)low, (unsigned long long)high);
    *ret = (uint64_t)number;
    return 0;
}

static int read_quota(const json_t *entry, const char *pointer, struct quota *quota, struct problem *reterr)
{
    return read_number(entry, pointer, "queued", 0, QUOTA_MAX_JOBS, &quota->queued, reterr) ||
           read_number(entry, pointer, "running", 1, QUOTA_MAX_JOBS, &quota->running, reterr) ||
           read_number(entry, pointer, "mesh_bytes", 0, QUOTA_MAX_BYTES, &quota->mesh_bytes, reterr);
}

/* Key number `at` of the list, whose `key[0..at)` are read. */
static int read_key(const json_t *entry, struct key *key, size_t at, const struct quota *defaults,
                    struct problem *reterr)
{
    static const char *const known[] = {"name", "sha256", "queued", "running", "mesh_bytes", NULL};
    char pointer[JSONTEXT_POINTER_BYTES], member[JSONTEXT_POINTER_BYTES];
    struct key *ret = &key[at];
    snprintf(pointer, sizeof pointer, "/keys/%zu", at);
    if (!json_is_object(entry))
        return problem_at(reterr, PROBLEM_INVALID, pointer, "must be an object");
    if (jsontext_check_members(entry, pointer, known, reterr) != 0)
        return -1;

    const char *name = text_of(entry, "name"), *digest = text_of(entry, "sha256");
    jsontext_pointer(member, sizeof member, pointer, "name");
    if (name == NULL || !name_valid(name))
        return problem_at(reterr, PROBLEM_INVALID, member,
                          "must be 1 to %d letters, digits, dots, hyphens or underscores", KEY_NAME_SIZE - 1);
    for (size_t i = 0; i < at; i++)
        if (strcmp(key[i].name, name) == 0)
            return problem_at(reterr, PROBLEM_INVALID, member, "is the name of /keys/%zu, too", i);
    strcpy(ret->name, name);

    jsontext_pointer(member, sizeof member, pointer, "sha256");
    if (digest == NULL || !sha256_valid(digest))
        return problem_at(reterr, PROBLEM_INVALID, member, "must be 64 lower-case hex digits");
    sodium_hex2bin(ret->digest, sizeof ret->digest, digest, strlen(digest), NULL, NULL, NULL);
    for (size_t i = 0; i < at; i++)
        if (memcmp(key[i].digest, ret->digest, sizeof ret->digest) == 0)
            return problem_at(reterr, PROBLEM_INVALID, member, "is that of /keys/%zu, too", i);
    ret->quota = *defaults;
    return read_quota(entry, pointer, &ret->quota, reterr);
}

static int read_list(const json_t *root, const struct quota *defaults, struct key **ret, size_t *ret_count,
                     struct problem *reterr)
{
    static const char *const known[] = {"keys", NULL};
    const json_t *list = json_object_get(root, "keys");
    if (!json_is_object(root))
        return problem_at(reterr, PROBLEM_INVALID, "", "must be an object");
    if (jsontext_check_members(root, "", known, reterr) != 0)
        return -1;
    if (!json_is_array(list))
        return problem_at(reterr, PROBLEM_INVALID, "/keys", "must be an array");
    size_t count = json_array_size(list);
    if (count > KEYS_MAX)
        return problem_at(reterr, PROBLEM_TOO_LARGE, "/keys", "has %zu keys, more than %d", count, KEYS_MAX);
    struct key *key = calloc(count + 1, sizeof *key);
    if (key == NULL)
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    for (size_t i = 0; i < count; i++)
        if (read_key(json_array_get(list, i), key, i, defaults, reterr) != 0) {
            free(key);
            return -1;
        }
    *ret = key;
    *ret_count = count;
    return 0;
}

int keys_parse(const char *text, size_t bytes, const struct quota *defaults, struct key **ret,
               size_t *ret_count, struct problem *reterr)
{
    json_error_t error;
    if (bytes > KEYS_FILE_BYTES)
        return problem_set(reterr, PROBLEM_TOO_LARGE, "The key file has %zu bytes, more than %zu.", bytes,
                           KEYS_FILE_BYTES);
    json_t *root = NULL;
    int loaded = jsonin_load(text, bytes, &root, &error);
    if (loaded < 0)
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    if (loaded == JSONIN_BAD)
        return problem_set(reterr, PROBLEM_BAD_JSON, "Line %d, column %d: %s.", error.line, error.column,
                           error.text);
    int failed = read_list(root, defaults, ret, ret_count, reterr);
    json_decref(root);
    return failed;
}

static int load(const char *path, const struct quota *defaults, struct key **ret, size_t *ret_count,
                struct problem *reterr)
{
    struct stat st;
    char *text;
    size_t bytes;
    if (stat(path, &st) != 0)
        return problem_set(reterr, PROBLEM_STORAGE, "%s: %s.", path, strerror(errno));
    if (!S_ISREG(st.st_mode) || st.st_size > (off_t)KEYS_FILE_BYTES)
        return problem_set(reterr, PROBLEM_STORAGE, "%s is no file of up to %zu bytes.", path,
                           KEYS_FILE_BYTES);
    if (st.st_mode & S_IROTH)
        log_event(LOG_LEVEL_WARNING, "keys.readable",
                  "path=\"%s\" why=\"everybody may read it; try chmod 600\"", path);
    if (files_read(AT_FDCWD, path, &text, &bytes) != 0)
        return problem_set(reterr, PROBLEM_STORAGE, "%s: %s.", path, strerror(errno));
    int failed = keys_parse(text, bytes, defaults, ret, ret_count, reterr);
    free(text);
    return failed;
}

/* ---- the keys in force --------------------------------------------------------------------------------- */

int keys_open(const char *path, const struct quota *defaults, struct keys **ret, struct problem *reterr)
{
    struct keys *keys = calloc(1, sizeof *keys);
    if (keys == NULL || (keys->path = strdup(path)) == NULL) {
        free(keys);
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    }
    keys->defaults = *defaults;
    pthread_mutex_init(&keys->lock, NULL);
    if (keys_reload(keys, reterr) != 0) {
        keys_free(keys);
        return -1;
    }
    *ret = keys;
    return 0;
}

struct keys *keys_free(struct keys *keys)
{
    if (keys == NULL)
        return NULL;
    pthread_mutex_destroy(&keys->lock);
    free(keys->key);
    free(keys->path);
    free(keys);
    return NULL;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(((const struct key *)a)->name, ((const struct key *)b)->name);
}

int keys_reload(struct keys *keys, struct problem *reterr)
{
    struct key *key;
    size_t count;
    if (load(keys->path, &keys->defaults, &key, &count, reterr) != 0)
        return -1;
    qsort(key, count, sizeof *key, compare_names);
    pthread_mutex_lock(&keys->lock);
    struct key *old = keys->key;
    keys->key = key;
    keys->count = count;
    pthread_mutex_unlock(&keys->lock);
    free(old);
    log_event(LOG_LEVEL_INFO, "keys.loaded", "count=%zu", count);
    return 0;
}

/* The token of "Bearer <token>" (RFC 6750, section 2.1); NULL: none that could be a key. */
static const char *bearer_token(const char *authorization)
{
    if (authorization == NULL || strncasecmp(authorization, "Bearer ", 7) != 0)
        return NULL;
    const char *token = authorization + 7 + strspn(authorization + 7, " ");
    return *token != '\0' && strlen(token) <= TOKEN_BYTES ? token : NULL;
}

bool keys_owner(struct keys *keys, const char *authorization, char ret[KEY_NAME_SIZE])
{
    unsigned char digest[crypto_hash_sha256_BYTES];
    const char *token = bearer_token(authorization);
    bool found = false;
    if (token == NULL)
        return false;
    crypto_hash_sha256(digest, (const unsigned char *)token, strlen(token));
    pthread_mutex_lock(&keys->lock);
    for (size_t i = 0; i < keys->count; i++) /* to the end, whatever is found */
        if (sodium_memcmp(keys->key[i].digest, digest, sizeof digest) == 0) {
            memcpy(ret, keys->key[i].name, KEY_NAME_SIZE);
            found = true;
        }
    pthread_mutex_unlock(&keys->lock);
    return found;
}

struct quota keys_quota(struct keys *keys, const char *owner)
{
    struct key wanted = {0};
    memcpy(wanted.name, owner, strnlen(owner, sizeof wanted.name - 1));
    pthread_mutex_lock(&keys->lock);
    const struct key *found = bsearch(&wanted, keys->key, keys->count, sizeof wanted, compare_names);
    struct quota quota = found != NULL ? found->quota : keys->defaults;
    pthread_mutex_unlock(&keys->lock);
    return quota;
}

int keys_make(const char *name, char ret_key[KEY_TEXT_SIZE], char **ret_entry)
{
    unsigned char bits[32];
    char digest[SHA256_SIZE];
    if (!name_valid(name))
        return -1;
    randombytes_buf(bits, sizeof bits);
    sodium_bin2hex(ret_key, KEY_TEXT_SIZE, bits, sizeof bits);
    sodium_memzero(bits, sizeof bits);
    sha256_hex(ret_key, strlen(ret_key), digest);
    return asprintf(ret_entry, "{\"name\":\"%s\",\"sha256\":\"%s\"}", name, digest) < 0 ? -1 : 0;
}
