/* config.h - the daemon's settings: from flags, else the environment, else one file, else defaults. */
#ifndef DRAPED_CONFIG_H
#define DRAPED_CONFIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/socket.h>

#include "limits.h"
#include "log.h"
#include "store.h"

#define CONFIG_MAX_WORKERS 256 /* OpenBLAS as Debian builds it serves few callers more */

/* A person's field takes 14 MiB, the largest there can be 80: room for the bodies of a shop's few sizes. */
#define CONFIG_FIELD_CACHE_BYTES    ((size_t)256 << 20)
#define CONFIG_ANALYSIS_CACHE_BYTES ((size_t)64 << 20)

/* The largest result, a cloth of 200 000 vertices in every format with its trace, takes some 60 MB. */
#define CONFIG_MIN_FREE_BYTES ((size_t)64 << 20)

/* A week of a job a minute and some more; at some 150 kB each, that many take the bytes. */
#define CONFIG_RETAIN_JOBS  100000
#define CONFIG_RETAIN_HOURS 168
#define CONFIG_RETAIN_BYTES ((uint64_t)16 << 30)

#define CONFIG_TEXT_SIZE    4096 /* of a path, its end included */
#define CONFIG_MAX_SETTINGS 64
#define CONFIG_MESSAGE_SIZE (CONFIG_TEXT_SIZE + 1024) /* for a path and what is wrong there */

enum config_source { CONFIG_DEFAULT = 0, CONFIG_FILE, CONFIG_ENVIRONMENT, CONFIG_FLAG };

struct config {
    struct sockaddr_storage listen, admin; /* loopback only, unless there are keys */
    char file[CONFIG_TEXT_SIZE];           /* the file that was read; "": none */
    char data[CONFIG_TEXT_SIZE];
    char keys[CONFIG_TEXT_SIZE];         /* the key file; "": none */
    char url_file[CONFIG_TEXT_SIZE];     /* "": none */
    char cors_origins[CONFIG_TEXT_SIZE]; /* with blanks between them; "": none */
    unsigned workers;
    unsigned drain_seconds;
    size_t field_cache_bytes;    /* see fields.h */
    size_t analysis_cache_bytes; /* see drape_analyses_new */
    size_t min_free_bytes;
    struct store_policy retain;
    enum log_level log_level;
    enum log_format log_format;
    struct limits limits;

    bool check_only;       /* --check-config: print the settings and leave */
    const char *make_key;  /* --make-key: make a key of this name and leave; of argv; NULL: serve */
    struct config_origin { /* of each row of the table in config.c */
        enum config_source source;
        unsigned line; /* in the file */
    } origin[CONFIG_MAX_SETTINGS];
};

/* Without `data`: the folder systemd made for the service, else this one below the current folder. */
#define CONFIG_DEFAULT_DATA "draped-data"

/* Without `keys`: the credential of this name that systemd has loaded for the service, if it has. */
#define CONFIG_KEYS_CREDENTIAL "keys"

/* Without `config`: draped.conf in the folder systemd names, else in this one, if it is there. */
#define CONFIG_DEFAULT_DIR "/etc/draped"

/* 0 and *ret; or EX_USAGE (flags, environment) or EX_CONFIG (the file) of <sysexits.h>, and one line in
 * `message` that names the flag, the variable, or file and line. --help, --version and unknown flags print
 * and exit, as argp does. */
int config_parse(int argc, char **argv, struct config *ret, char *message, size_t message_size);

/* Every setting with its source in a comment; fit to be a file of settings itself. */
void config_print(FILE *out, const struct config *config);

void config_set_defaults(struct config *ret);

/* Takes the settings of an open file named `path`. 0, or -1 and `message`. */
int config_read(FILE *in, const char *path, struct config *config, char *message, size_t message_size);

/* "127.0.0.1:8080", "localhost:0", "[::1]:8080". */
int config_parse_address(const char *text, struct sockaddr_storage *ret, char *message, size_t message_size);
bool config_is_loopback(const struct sockaddr_storage *address);
socklen_t config_address_size(const struct sockaddr_storage *address);

#define CONFIG_ADDRESS_SIZE 64
void config_format_address(const struct sockaddr_storage *address, char ret[CONFIG_ADDRESS_SIZE]);

#endif
