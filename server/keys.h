/* keys.h - who may ask: API keys, kept as hashes in one file, each with its quotas.
 *
 *   {"keys": [{"name": "shop", "sha256": "<of the key's text, hex>",
 *              "queued": 100, "running": 2, "mesh_bytes": 1000000000}]}
 *
 * The quotas are optional. A key is 256 random bits, so that a plain SHA-256 of it cannot be searched. Its
 * name is the owner of what is made with it, and is no secret; the key itself is never kept nor logged.
 *
 * Any thread may call anything but open and free. One lock inside, a leaf; no file is touched under it. */
#ifndef DRAPED_KEYS_H
#define DRAPED_KEYS_H

#include <stdbool.h>

#include "id.h"
#include "limits.h"
#include "problem.h"

#define KEY_NAME_SIZE 32          /* letters, digits, '.', '_', '-'; and a NUL */
#define KEY_TEXT_SIZE SHA256_SIZE /* 64 hex digits of a key as we make it */

/* A file this long, or with more keys, is no key file. */
#define KEYS_FILE_BYTES ((size_t)1 << 20)
#define KEYS_MAX        1000

struct keys;

struct key {
    char name[KEY_NAME_SIZE];
    unsigned char digest[32]; /* SHA-256 of the text */
    struct quota quota;
};

/* Reads a key file's text; absent quotas are those of `defaults`. 0 and *ret (count of them; the caller
 * frees it), or -1 with *reterr and the JSON pointer of what is wrong. */
int keys_parse(const char *text, size_t bytes, const struct quota *defaults, struct key **ret,
               size_t *ret_count, struct problem *reterr);

/* `path` is copied. 0, or -1 with *reterr. A file that everybody may read is warned of in the log. */
int keys_open(const char *path, const struct quota *defaults, struct keys **ret, struct problem *reterr);
struct keys *keys_free(struct keys *keys); /* NULL is fine; returns NULL */

/* Reads the file again. 0, or -1 with *reterr and the old keys in force. */
int keys_reload(struct keys *keys, struct problem *reterr);

/* Whose key an Authorization header holds (NULL: none given): true and the owner's name. All keys are
 * compared, each in constant time. */
bool keys_owner(struct keys *keys, const char *authorization, char ret[KEY_NAME_SIZE]);

/* Of an owner whose key is gone, whose jobs run on: the defaults. */
struct quota keys_quota(struct keys *keys, const char *owner);

/* A new key for `name` and the line of JSON to put in the file (malloc'd); 0, or -1: not a name for a key, or
 * out of memory. */
int keys_make(const char *name, char ret_key[KEY_TEXT_SIZE], char **ret_entry);

#endif
