/* id.c - see id.h. */
#include "id.h"

#include <string.h>

#include <sodium.h>

int id_init(void)
{
    return sodium_init() < 0 ? -1 : 0;
}

void id_new(char ret[ID_SIZE])
{
    unsigned char bits[16];
    randombytes_buf(bits, sizeof bits);
    sodium_bin2hex(ret, ID_SIZE, bits, sizeof bits);
}

static bool lower_hex(const char *text, size_t digits)
{
    return strlen(text) == digits && strspn(text, "0123456789abcdef") == digits;
}

bool id_valid(const char *text)
{
    return lower_hex(text, ID_SIZE - 1);
}

void sha256_hex(const void *data, size_t bytes, char ret[SHA256_SIZE])
{
    unsigned char digest[crypto_hash_sha256_BYTES];
    crypto_hash_sha256(digest, data, bytes);
    sodium_bin2hex(ret, SHA256_SIZE, digest, sizeof digest);
}

bool sha256_valid(const char *text)
{
    return lower_hex(text, SHA256_SIZE - 1);
}

void id_stamp(const void *data, size_t bytes, char ret[STAMP_SIZE])
{
    static const unsigned char key[crypto_shorthash_KEYBYTES]; /* nothing secret: the same after a restart */
    unsigned char hash[crypto_shorthash_BYTES];
    crypto_shorthash(hash, data, bytes, key);
    sodium_bin2hex(ret, STAMP_SIZE, hash, sizeof hash);
}
