/* digest.c - see digest.h. The syntax is that of structured fields (RFC 8941), without parameters. */
#include "digest.h"

#include <sodium.h>
#include <stdbool.h>
#include <string.h>

#define MAX_HASH crypto_hash_sha512_BYTES

static const struct algorithm {
    const char *name;
    size_t bytes;
    int (*hash)(unsigned char *ret, const unsigned char *data, unsigned long long bytes);
} algorithms[] = {
    {"sha-256", crypto_hash_sha256_BYTES, crypto_hash_sha256},
    {"sha-512", crypto_hash_sha512_BYTES, crypto_hash_sha512},
};

/* NULL: not one of ours. */
static const struct algorithm *find_algorithm(const char *name, size_t bytes)
{
    for (size_t i = 0; i < sizeof algorithms / sizeof *algorithms; i++)
        if (strlen(algorithms[i].name) == bytes && memcmp(algorithms[i].name, name, bytes) == 0)
            return &algorithms[i];
    return NULL;
}

static int malformed(struct problem *reterr)
{
    return problem_set(reterr, PROBLEM_BAD_REQUEST, "Content-Digest must be a list like sha-256=:BASE64:.");
}

static int compare(const struct algorithm *algorithm, const char *base64, size_t base64_bytes,
                   const void *data, size_t bytes, struct problem *reterr)
{
    unsigned char said[MAX_HASH], is[MAX_HASH];
    char text[sodium_base64_ENCODED_LEN(MAX_HASH, sodium_base64_VARIANT_ORIGINAL)];
    size_t said_bytes;
    if (sodium_base642bin(said, sizeof said, base64, base64_bytes, NULL, &said_bytes, NULL,
                          sodium_base64_VARIANT_ORIGINAL) != 0 ||
        said_bytes != algorithm->bytes)
        return malformed(reterr);
    algorithm->hash(is, data, bytes);
    if (memcmp(said, is, said_bytes) == 0)
        return 0;
    sodium_bin2base64(text, sizeof text, is, algorithm->bytes, sodium_base64_VARIANT_ORIGINAL);
    return problem_set(reterr, PROBLEM_DIGEST_MISMATCH, "The body's %s is :%s:.", algorithm->name, text);
}

/* One algorithm=:base64: at **at, which is moved behind it. */
static int check_member(const char **at, const void *data, size_t bytes, struct problem *reterr)
{
    size_t name = strspn(*at, "abcdefghijklmnopqrstuvwxyz0123456789_-.*");
    const char *value = *at + name;
    if (name == 0 || strncmp(value, "=:", 2) != 0)
        return malformed(reterr);
    value += 2;
    size_t n = strspn(value, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/=");
    if (value[n] != ':')
        return malformed(reterr);
    const struct algorithm *algorithm = find_algorithm(*at, name);
    *at = value + n + 1;
    return algorithm == NULL ? 0 : compare(algorithm, value, n, data, bytes, reterr);
}

int digest_check(const char *content_digest, const void *data, size_t bytes, struct problem *reterr)
{
    if (content_digest == NULL)
        return 0;
    for (const char *at = content_digest;;) {
        if (check_member(&at, data, bytes, reterr) != 0)
            return -1;
        at += strspn(at, " \t");
        if (*at == '\0')
            return 0;
        if (*at++ != ',')
            return malformed(reterr);
        at += strspn(at, " \t");
    }
}
