/* config.c - see config.h. */
#include "config.h"

#include <argp.h>
#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <sched.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "drape.h"

enum flag {
    FLAG_LISTEN = 256, /* beyond the characters: there are no short flags */
    FLAG_ADMIN,
    FLAG_DATA,
    FLAG_KEYS,
    FLAG_MAKE_KEY,
    FLAG_WORKERS,
    FLAG_URL_FILE,
    FLAG_LOG_LEVEL,
    FLAG_DRAIN_TIMEOUT,
    FLAG_FIELD_CACHE,
    FLAG_MAX_BODY,
    FLAG_MAX_VERTICES,
    FLAG_MAX_TRIANGLES,
    FLAG_MAX_QUEUED,
    FLAG_MAX_CONNECTIONS,
    FLAG_MAX_STREAMS,
    FLAG_MAX_READING,
    FLAG_MAX_TIME,
};

static const struct argp_option options[] = {
    {"listen", FLAG_LISTEN, "HOST:PORT", 0, "Where the API listens (127.0.0.1:8080; port 0: any free one)",
     1},
    {"admin", FLAG_ADMIN, "HOST:PORT", 0, "Where health and metrics listen (127.0.0.1:8081)", 1},
    {"data", FLAG_DATA, "DIR", 0,
     "Folder of jobs, results and meshes ($STATE_DIRECTORY, else " CONFIG_DEFAULT_DATA ")", 1},
    {"keys", FLAG_KEYS, "FILE", 0,
     "Whom to serve: JSON of hashed API keys ($CREDENTIALS_DIRECTORY/" CONFIG_KEYS_CREDENTIAL
     " where there is one; without, whoever is on this machine)",
     1},
    {"make-key", FLAG_MAKE_KEY, "NAME", 0, "Print a new key, and the entry to put in the file; then leave",
     1},
    {"workers", FLAG_WORKERS, "N", 0, "Jobs solved at a time (the number of usable processors)", 1},
    {"url-file", FLAG_URL_FILE, "PATH", 0, "Once ready, holds the API's URL and the admin URL, one a line",
     1},
    {"log-level", FLAG_LOG_LEVEL, "LEVEL", 0, "error, warning, info or debug (info)", 1},
    {"drain-timeout", FLAG_DRAIN_TIMEOUT, "SECONDS", 0, "How long SIGTERM lets running jobs go on (10)", 1},
    {"field-cache", FLAG_FIELD_CACHE, "BYTES", 0,
     "For the distance fields of bodies, kept from job to job (268435456)", 1},
    {NULL, 0, NULL, 0, "Limits:", 2},
    {"max-body", FLAG_MAX_BODY, "BYTES", 0, "Of a request's body (67108864)", 2},
    {"max-vertices", FLAG_MAX_VERTICES, "N", 0, "Of the cloth, and of each body (200000)", 2},
    {"max-triangles", FLAG_MAX_TRIANGLES, "N", 0, "Of the cloth, and of each body (400000)", 2},
    {"max-queued", FLAG_MAX_QUEUED, "N", 0, "Jobs queued and running (1000)", 2},
    {"max-connections", FLAG_MAX_CONNECTIONS, "N", 0, "Connections to the API (512)", 2},
    {"max-streams", FLAG_MAX_STREAMS, "N", 0, "Event streams; fewer than connections (128)", 2},
    {"max-reading", FLAG_MAX_READING, "N", 0, "Whole request bodies waiting to be parsed (16)", 2},
    {"max-time", FLAG_MAX_TIME, "SECONDS", 0, "A job's own time limit (3600)", 2},
    {0},
};

struct parse {
    struct config *config;
    char *message;
    size_t message_size;
};

__attribute__((format(printf, 3, 4))) static int refuse(char *message, size_t size, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    vsnprintf(message, size, format, args);
    va_end(args);
    return -1;
}

/* ---- addresses -------------------------------------------------------------------------------------- */

/* Splits at the last colon; the host loses its brackets. 0 or -1. */
static int split_address(const char *text, char *host, size_t host_size, const char **ret_port)
{
    const char *colon = strrchr(text, ':');
    if (colon == NULL)
        return -1;
    size_t n = (size_t)(colon - text);
    if (n >= 2 && text[0] == '[' && colon[-1] == ']') {
        text++;
        n -= 2;
    } else if (memchr(text, ':', n) != NULL) {
        return -1; /* IPv6 without brackets: which colon is the port's? */
    }
    if (n == 0 || n >= host_size)
        return -1;
    memcpy(host, text, n);
    host[n] = '\0';
    *ret_port = colon + 1;
    return 0;
}

static bool is_loopback(const struct sockaddr_storage *address)
{
    if (address->ss_family == AF_INET)
        return ntohl(((const struct sockaddr_in *)address)->sin_addr.s_addr) >> 24 == 127;
    return IN6_IS_ADDR_LOOPBACK(&((const struct sockaddr_in6 *)address)->sin6_addr);
}

socklen_t config_address_size(const struct sockaddr_storage *address)
{
    return address->ss_family == AF_INET ? sizeof(struct sockaddr_in) : sizeof(struct sockaddr_in6);
}

static int parse_number(const char *text, unsigned long long low, unsigned long long high,
                        unsigned long long *ret)
{
    size_t n = strlen(text);
    if (n == 0 || n > 18 || strspn(text, "0123456789") != n)
        return -1;
    *ret = strtoull(text, NULL, 10);
    return *ret < low || *ret > high ? -1 : 0;
}

int config_parse_address(const char *text, struct sockaddr_storage *ret, char *message, size_t message_size)
{
    char host[64];
    const char *port_text;
    unsigned long long port;
    struct sockaddr_storage address = {0};
    struct sockaddr_in *v4 = (struct sockaddr_in *)&address;
    struct sockaddr_in6 *v6 = (struct sockaddr_in6 *)&address;
    if (split_address(text, host, sizeof host, &port_text) != 0 ||
        parse_number(port_text, 0, 65535, &port) != 0)
        return refuse(message, message_size, "\"%s\" is not HOST:PORT", text);
    if (inet_pton(AF_INET, strcmp(host, "localhost") == 0 ? "127.0.0.1" : host, &v4->sin_addr) == 1) {
        v4->sin_family = AF_INET;
        v4->sin_port = htons((uint16_t)port);
    } else if (inet_pton(AF_INET6, host, &v6->sin6_addr) == 1) {
        v6->sin6_family = AF_INET6;
        v6->sin6_port = htons((uint16_t)port);
    } else {
        return refuse(message, message_size, "\"%s\" is neither localhost nor a numeric address", host);
    }
    *ret = address;
    return 0;
}

/* ---- flags ------------------------------------------------------------------------------------------- */

struct number_flag {
    int key;
    unsigned long long low, high;
};

static const struct number_flag number_table[] = {
    {FLAG_WORKERS, 1, CONFIG_MAX_WORKERS},
    {FLAG_DRAIN_TIMEOUT, 0, 86400},
    {FLAG_FIELD_CACHE, 0, 1ull << 40},
    {FLAG_MAX_BODY, 1024, 1ull << 32},
    {FLAG_MAX_VERTICES, 3, DRAPE_MAX_VERTICES},
    {FLAG_MAX_TRIANGLES, 1, DRAPE_MAX_TRIANGLES},
    {FLAG_MAX_QUEUED, 1, 1000000},
    {FLAG_MAX_CONNECTIONS, 8, 65536},
    {FLAG_MAX_STREAMS, 1, 65535},
    {FLAG_MAX_READING, 1, 65536},
    {FLAG_MAX_TIME, 1, 1000000},
};

static void set_number(struct config *config, int key, unsigned long long value)
{
    switch (key) {
    case FLAG_WORKERS:
        config->workers = (unsigned)value;
        break;
    case FLAG_DRAIN_TIMEOUT:
        config->drain_seconds = (unsigned)value;
        break;
    case FLAG_FIELD_CACHE:
        config->field_cache_bytes = value;
        break;
    case FLAG_MAX_BODY:
        config->limits.body_bytes = value;
        break;
    case FLAG_MAX_VERTICES:
        config->limits.vertices = value;
        break;
    case FLAG_MAX_TRIANGLES:
        config->limits.triangles = value;
        break;
    case FLAG_MAX_QUEUED:
        config->limits.queued_jobs = value;
        break;
    case FLAG_MAX_CONNECTIONS:
        config->limits.connections = value;
        break;
    case FLAG_MAX_STREAMS:
        config->limits.streams = value;
        break;
    case FLAG_MAX_READING:
        config->limits.reading = value;
        break;
    case FLAG_MAX_TIME:
        config->limits.time_limit_s = (double)value;
        break;
    default:
        break;
    }
}

/* 0, -1 with the message, or 1 when the key is not a number's. */
static int take_number(struct parse *parse, int key, const char *text)
{
    for (size_t i = 0; i < sizeof number_table / sizeof *number_table; i++) {
        const struct number_flag *flag = &number_table[i];
        unsigned long long value;
        if (flag->key != key)
            continue;
        if (parse_number(text, flag->low, flag->high, &value) != 0)
            return refuse(parse->message, parse->message_size, "\"%s\" is not a number from %llu to %llu",
                          text, flag->low, flag->high);
        set_number(parse->config, key, value);
        return 0;
    }
    return 1;
}

/* 0, or -1: too long. */
static int set_keys(struct config *config, const char *path)
{
    return snprintf(config->keys, sizeof config->keys, "%s", path) < (int)sizeof config->keys ? 0 : -1;
}

static int take_flag(struct parse *parse, int key, char *text)
{
    struct config *config = parse->config;
    int level;
    switch (key) {
    case FLAG_LISTEN:
        return config_parse_address(text, &config->listen, parse->message, parse->message_size);
    case FLAG_ADMIN:
        return config_parse_address(text, &config->admin, parse->message, parse->message_size);
    case FLAG_DATA:
        config->data = text;
        return text[0] != '\0' ? 0 : refuse(parse->message, parse->message_size, "--data needs a folder");
    case FLAG_KEYS:
        return set_keys(config, text) == 0 && text[0] != '\0'
                   ? 0
                   : refuse(parse->message, parse->message_size, "--keys needs a path");
    case FLAG_MAKE_KEY:
        config->make_key = text;
        return 0;
    case FLAG_URL_FILE:
        config->url_file = text;
        return text[0] != '\0' ? 0 : refuse(parse->message, parse->message_size, "--url-file needs a path");
    case FLAG_LOG_LEVEL:
        level = log_level_from_name(text);
        if (level < 0)
            return refuse(parse->message, parse->message_size, "\"%s\" is not error, warning, info or debug",
                          text);
        config->log_level = (enum log_level)level;
        return 0;
    default:
        return take_number(parse, key, text);
    }
}

static error_t on_option(int key, char *text, struct argp_state *state)
{
    if (key == ARGP_KEY_ARG) {
        struct parse *parse = state->input;
        refuse(parse->message, parse->message_size, "\"%s\" is not a flag", text);
        return EINVAL;
    }
    if (key < FLAG_LISTEN || key > FLAG_MAX_TIME)
        return ARGP_ERR_UNKNOWN;
    return take_flag(state->input, key, text) == 0 ? 0 : EINVAL;
}

static void print_version(FILE *out, struct argp_state *state)
{
    (void)state;
    fprintf(out, "draped %s\n", drape_version());
}

static unsigned usable_processors(void)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return count < 1 ? 1 : count > CONFIG_MAX_WORKERS ? CONFIG_MAX_WORKERS : (unsigned)count;
}

static void set_default_keys(struct config *config)
{
    const char *credentials = getenv("CREDENTIALS_DIRECTORY");
    char path[CONFIG_PATH_SIZE];
    if (credentials != NULL &&
        snprintf(path, sizeof path, "%s/" CONFIG_KEYS_CREDENTIAL, credentials) < (int)sizeof path &&
        access(path, F_OK) == 0)
        set_keys(config, path);
}

static void set_defaults(struct config *config)
{
    const char *state = getenv("STATE_DIRECTORY");
    *config = (struct config){
        .data = state != NULL && state[0] != '\0' ? state : CONFIG_DEFAULT_DATA,
        .workers = usable_processors(),
        .drain_seconds = 10,
        .field_cache_bytes = CONFIG_FIELD_CACHE_BYTES,
        .log_level = LOG_LEVEL_INFO,
        .limits = limits_default,
    };
    config_parse_address("127.0.0.1:8080", &config->listen, NULL, 0);
    config_parse_address("127.0.0.1:8081", &config->admin, NULL, 0);
    set_default_keys(config);
}

/* What is wrong with no flag alone. */
static int check_together(const struct config *config, char *message, size_t message_size)
{
    if (config->keys[0] == '\0' && !(is_loopback(&config->listen) && is_loopback(&config->admin)))
        return refuse(message, message_size,
                      "%s is not a loopback address: without --keys only this machine is served",
                      is_loopback(&config->listen) ? "--admin" : "--listen");
    /* Streams alone must not shut everybody else out. */
    if (config->limits.streams >= config->limits.connections)
        return refuse(message, message_size, "--max-streams (%zu) must be below --max-connections (%zu)",
                      config->limits.streams, config->limits.connections);
    return 0;
}

int config_parse(int argc, char **argv, struct config *ret, char *message, size_t message_size)
{
    static const struct argp argp = {
        .options = options,
        .parser = on_option,
        .doc = "draped: finds how garments hang at rest, and serves it over HTTP.\v"
               "SIGTERM stops it in order: running jobs get the drain timeout to finish and then go back to "
               "the queue; a second SIGTERM sends them back at once. SIGHUP reads the key file again.",
    };
    struct config config;
    struct parse parse = {&config, message, message_size};
    set_defaults(&config);
    argp_program_version_hook = print_version;
    int error = argp_parse(&argp, argc, argv, 0, NULL, &parse);
    if (error == ENOMEM)
        return refuse(message, message_size, "out of memory");
    if (error != 0 || check_together(&config, message, message_size) != 0)
        return -1;
    *ret = config;
    return 0;
}
