/* config.h - the daemon's settings, from its command line. */
#ifndef DRAPED_CONFIG_H
#define DRAPED_CONFIG_H

#include <stddef.h>
#include <sys/socket.h>

#include "limits.h"
#include "log.h"

#define CONFIG_MAX_WORKERS 256 /* OpenBLAS as Debian builds it serves few callers more */

/* A person's field takes 14 MiB, the largest there can be 80: room for the bodies of a shop's few sizes. */
#define CONFIG_FIELD_CACHE_BYTES ((size_t)256 << 20)

#define CONFIG_PATH_SIZE 4096 /* PATH_MAX */

struct config {                            /* strings are borrowed from argv or the environment */
    struct sockaddr_storage listen, admin; /* loopback only, unless there are keys */
    const char *data;
    const char *url_file;        /* NULL: none */
    const char *make_key;        /* make a key of this name and leave; NULL: serve */
    char keys[CONFIG_PATH_SIZE]; /* the key file; "": none */
    unsigned workers;
    unsigned drain_seconds;
    size_t field_cache_bytes; /* see fields.h */
    enum log_level log_level;
    struct limits limits;
};

/* Without --data: the folder systemd made for the service, else this one below the current folder. */
#define CONFIG_DEFAULT_DATA "draped-data"

/* Without --keys: the credential of this name that systemd has loaded for the service, if it has. */
#define CONFIG_KEYS_CREDENTIAL "keys"

/* 0 and *ret, or -1 and one line in `message`. --help, --version and unknown flags print and exit, as
 * argp does. */
int config_parse(int argc, char **argv, struct config *ret, char *message, size_t message_size);

/* "127.0.0.1:8080", "localhost:0", "[::1]:8080". */
int config_parse_address(const char *text, struct sockaddr_storage *ret, char *message, size_t message_size);
socklen_t config_address_size(const struct sockaddr_storage *address);

#endif
