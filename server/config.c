/* config.c - see config.h. */
#include "config.h"

#include <argp.h>
#include <arpa/inet.h>
#include <ctype.h>
#include <errno.h>
#include <netinet/in.h>
#include <sched.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sysexits.h>
#include <unistd.h>

#include "conffile.h"
#include "cors.h"
#include "drape.h"

/* ---- the table --------------------------------------------------------------------------------------- */

enum kind {
    ADDRESS,  /* struct sockaddr_storage */
    TEXT,     /* char[CONFIG_TEXT_SIZE] */
    ORIGINS,  /* char[CONFIG_TEXT_SIZE], blanks between them; a flag adds to those before it */
    CHOICE,   /* an enumeration from 0 */
    UNSIGNED, /* unsigned */
    SIZE,     /* size_t */
    SECONDS,  /* double, whole seconds */
    HOURS,    /* int64_t, milliseconds */
};

/* The flag --name, the line `name = value` of the file, and the variable DRAPED_NAME. In the order of
 * reading. NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding) */
struct setting {
    const char *name;
    enum kind kind;
    size_t offset; /* of its member in struct config, whose default config_set_defaults gives */
    const char *argument;
    unsigned long long low, high;          /* of numbers */
    const char *(*choice_name)(int value); /* NULL beyond the last */
    int group;                             /* in --help: 1 in general, 2 what is kept, 3 limits */
    const char *help;
};

#define HOUR_MS ((int64_t)3600000)

#define AT(member) offsetof(struct config, member)

#define THE_FILE 0 /* the setting that says which file to read, and so cannot stand in it */

static const struct setting setting_table[] = {
    {"config", TEXT, AT(file), "FILE", 0, 0, NULL, 1,
     "File of settings, `name = value' a line; not there itself (" CONFIG_DEFAULT_DIR "/draped.conf if it is "
     "there)"},
    {"listen", ADDRESS, AT(listen), "HOST:PORT", 0, 0, NULL, 1,
     "Where the API listens; port 0: any free one"},
    {"admin", ADDRESS, AT(admin), "HOST:PORT", 0, 0, NULL, 1, "Where health and metrics listen"},
    {"cors-origin", ORIGINS, AT(cors_origins), "ORIGIN...", 0, 0, NULL, 1,
     "Web pages that may use the API, as https://shop.example; may be given several times"},
    {"data", TEXT, AT(data), "DIR", 0, 0, NULL, 1, "Folder of jobs, results and meshes"},
    {"keys", TEXT, AT(keys), "FILE", 0, 0, NULL, 1,
     "Whom to serve: JSON of hashed API keys; without, whoever is on this machine"},
    {"workers", UNSIGNED, AT(workers), "N", 1, CONFIG_MAX_WORKERS, NULL, 1,
     "Jobs solved at a time; unless given, as many as there are usable processors"},
    {"url-file", TEXT, AT(url_file), "PATH", 0, 0, NULL, 1,
     "Once ready, holds the API's URL and the admin URL, one a line"},
    {"log-level", CHOICE, AT(log_level), "LEVEL", 0, 0, log_level_name, 1, "error, warning, info or debug"},
    {"log-format", CHOICE, AT(log_format), "FORM", 0, 0, log_format_name, 1,
     "text or json lines, journal, or auto: the journal where standard error goes there, else text"},
    {"drain-timeout", UNSIGNED, AT(drain_seconds), "SECONDS", 0, 86400, NULL, 1,
     "How long SIGTERM lets running jobs go on"},
    {"field-cache", SIZE, AT(field_cache_bytes), "BYTES", 0, 1ull << 40, NULL, 1,
     "For the distance fields of bodies, kept from job to job"},
    {"analysis-cache", SIZE, AT(analysis_cache_bytes), "BYTES", 0, 1ull << 40, NULL, 1,
     "For the symbolic factors of cloths, kept from job to job"},
    {"min-free", SIZE, AT(min_free_bytes), "BYTES", 0, 1ull << 50, NULL, 1,
     "Space on the disk of the data folder below which nothing new is taken"},
    {"retain-jobs", SIZE, AT(retain.jobs), "N", 0, 1000000000, NULL, 2, "Kept at most"},
    {"retain-hours", HOURS, AT(retain.age_ms), "HOURS", 1, 876000, NULL, 2,
     "Since their end; also of meshes that no job names"},
    {"retain-bytes", SIZE, AT(retain.bytes), "BYTES", 0, 1ull << 50, NULL, 2,
     "Of their documents and results"},
    {"memory", SIZE, AT(limits.memory), "BYTES", 1000000, 1ull << 50, NULL, 3,
     "Of all running jobs together, as estimated; others wait"},
    {"job-memory", SIZE, AT(limits.job_memory), "BYTES", 1000000, 1ull << 50, NULL, 3,
     "Of one job, at most those of all"},
    {"max-body", SIZE, AT(limits.body_bytes), "BYTES", 1024, 1ull << 32, NULL, 3, "Of a request's body"},
    {"max-vertices", SIZE, AT(limits.vertices), "N", 3, DRAPE_MAX_VERTICES, NULL, 3,
     "Of the cloth, and of each body"},
    {"max-triangles", SIZE, AT(limits.triangles), "N", 1, DRAPE_MAX_TRIANGLES, NULL, 3,
     "Of the cloth, and of each body"},
    {"max-queued", SIZE, AT(limits.queued_jobs), "N", 1, 1000000, NULL, 3, "Jobs queued and running"},
    {"max-connections", SIZE, AT(limits.connections), "N", 8, 65536, NULL, 3, "Connections to the API"},
    {"max-streams", SIZE, AT(limits.streams), "N", 1, 65535, NULL, 3,
     "Event streams; fewer than connections"},
    {"max-streams-per-key", SIZE, AT(limits.streams_per_key), "N", 1, 65535, NULL, 3,
     "Event streams of one API key"},
    {"max-reading", SIZE, AT(limits.reading), "N", 1, 65536, NULL, 3,
     "Whole request bodies waiting to be parsed"},
    {"max-time", SECONDS, AT(limits.time_limit_s), "SECONDS", 1, 1000000, NULL, 3, "A job's own time limit"},
};

#define SETTINGS (sizeof setting_table / sizeof *setting_table)
_Static_assert(SETTINGS <= CONFIG_MAX_SETTINGS, "one origin for each setting");

static unsigned usable_processors(void)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    int count = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    return count < 1 ? 1 : count > CONFIG_MAX_WORKERS ? CONFIG_MAX_WORKERS : (unsigned)count;
}

/* The value of an environment variable; an empty one counts as none. */
static const char *variable(const char *name)
{
    const char *text = getenv(name);
    return text != NULL && text[0] != '\0' ? text : NULL;
}

static void set_default_keys(struct config *config)
{
    const char *credentials = variable("CREDENTIALS_DIRECTORY");
    if (credentials != NULL)
        snprintf(config->keys, sizeof config->keys, "%s/" CONFIG_KEYS_CREDENTIAL, credentials);
    if (access(config->keys, F_OK) != 0)
        config->keys[0] = '\0';
}

void config_set_defaults(struct config *ret)
{
    const char *state = variable("STATE_DIRECTORY");
    *ret = (struct config){
        .workers = usable_processors(),
        .drain_seconds = 10,
        .field_cache_bytes = CONFIG_FIELD_CACHE_BYTES,
        .analysis_cache_bytes = CONFIG_ANALYSIS_CACHE_BYTES,
        .min_free_bytes = CONFIG_MIN_FREE_BYTES,
        .retain = {CONFIG_RETAIN_JOBS, CONFIG_RETAIN_BYTES, CONFIG_RETAIN_HOURS * HOUR_MS},
        .log_level = LOG_LEVEL_INFO,
        .limits = limits_default,
    };
    snprintf(ret->data, sizeof ret->data, "%s", state != NULL ? state : CONFIG_DEFAULT_DATA);
    config_parse_address("127.0.0.1:8080", &ret->listen, NULL, 0);
    config_parse_address("127.0.0.1:8081", &ret->admin, NULL, 0);
    set_default_keys(ret);
}

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

bool config_is_loopback(const struct sockaddr_storage *address)
{
    if (address->ss_family == AF_INET)
        return ntohl(((const struct sockaddr_in *)address)->sin_addr.s_addr) >> 24 == 127;
    return IN6_IS_ADDR_LOOPBACK(&((const struct sockaddr_in6 *)address)->sin6_addr);
}

socklen_t config_address_size(const struct sockaddr_storage *address)
{
    return address->ss_family == AF_INET ? sizeof(struct sockaddr_in) : sizeof(struct sockaddr_in6);
}

void config_format_address(const struct sockaddr_storage *address, char ret[CONFIG_ADDRESS_SIZE])
{
    char host[INET6_ADDRSTRLEN] = "";
    const struct sockaddr_in *v4 = (const struct sockaddr_in *)address;
    const struct sockaddr_in6 *v6 = (const struct sockaddr_in6 *)address;
    if (address->ss_family == AF_INET) {
        inet_ntop(AF_INET, &v4->sin_addr, host, sizeof host);
        snprintf(ret, CONFIG_ADDRESS_SIZE, "%s:%u", host, ntohs(v4->sin_port));
    } else {
        inet_ntop(AF_INET6, &v6->sin6_addr, host, sizeof host);
        snprintf(ret, CONFIG_ADDRESS_SIZE, "[%s]:%u", host, ntohs(v6->sin6_port));
    }
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
        return refuse(message, message_size, "\"%.100s\" is not HOST:PORT", text);
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

/* ---- one value --------------------------------------------------------------------------------------- */

static int take_text(const char *text, char *ret, char *message, size_t size)
{
    size_t n = strlen(text);
    if (n == 0)
        return refuse(message, size, "it must not be empty");
    if (n >= CONFIG_TEXT_SIZE)
        return refuse(message, size, "it is longer than %d bytes", CONFIG_TEXT_SIZE - 1);
    for (size_t i = 0; i < n; i++)
        if (iscntrl((unsigned char)text[i]))
            return refuse(message, size, "it holds a control character");
    memcpy(ret, text, n + 1);
    return 0;
}

/* One origin or several; they join those that are there. */
static int take_origins(const char *text, char *ret, char *message, size_t size)
{
    for (const char *p = text + strspn(text, " "); *p != '\0'; p += strspn(p, " ")) {
        size_t n = strcspn(p, " "), used = strlen(ret);
        const char *fault = cors_origin_fault(p, n);
        if (fault != NULL)
            return refuse(message, size, "\"%.*s\" is not an origin: %s", (int)(n > 100 ? 100 : n), p, fault);
        if (used + n + 2 > CONFIG_TEXT_SIZE)
            return refuse(message, size, "the origins are longer than %d bytes", CONFIG_TEXT_SIZE - 1);
        snprintf(ret + used, CONFIG_TEXT_SIZE - used, "%s%.*s", used > 0 ? " " : "", (int)n, p);
        p += n;
    }
    return *ret != '\0' ? 0 : refuse(message, size, "it must not be empty");
}

static int take_choice(const struct setting *s, const char *text, int *ret, char *message, size_t size)
{
    for (int i = 0; s->choice_name(i) != NULL; i++)
        if (strcmp(s->choice_name(i), text) == 0) {
            *ret = i;
            return 0;
        }
    return refuse(message, size, "\"%.100s\" is none of: %s", text, s->help);
}

static int take_number(const struct setting *s, const char *text, void *member, char *message, size_t size)
{
    unsigned long long value;
    if (parse_number(text, s->low, s->high, &value) != 0)
        return refuse(message, size, "\"%.100s\" is not a number from %llu to %llu", text, s->low, s->high);
    if (s->kind == UNSIGNED)
        *(unsigned *)member = (unsigned)value;
    else if (s->kind == SIZE)
        *(size_t *)member = value;
    else if (s->kind == HOURS)
        *(int64_t *)member = (int64_t)value * HOUR_MS;
    else
        *(double *)member = (double)value;
    return 0;
}

static int take_value(const struct setting *s, const char *text, struct config *config, char *message,
                      size_t size)
{
    void *member = (char *)config + s->offset;
    switch (s->kind) {
    case ADDRESS:
        return config_parse_address(text, member, message, size);
    case TEXT:
        return take_text(text, member, message, size);
    case ORIGINS:
        return take_origins(text, member, message, size);
    case CHOICE:
        return take_choice(s, text, member, message, size);
    default:
        return take_number(s, text, member, message, size);
    }
}

/* As it could be given again; "" for no text. */
static void format_value(const struct setting *s, const struct config *config, char *ret, size_t size)
{
    const void *member = (const char *)config + s->offset;
    char address[CONFIG_ADDRESS_SIZE];
    switch (s->kind) {
    case ADDRESS:
        config_format_address(member, address);
        snprintf(ret, size, "%s", address);
        break;
    case TEXT:
    case ORIGINS:
        snprintf(ret, size, "%s", (const char *)member);
        break;
    case CHOICE:
        snprintf(ret, size, "%s", s->choice_name(*(const int *)member));
        break;
    case UNSIGNED:
        snprintf(ret, size, "%u", *(const unsigned *)member);
        break;
    case SIZE:
        snprintf(ret, size, "%zu", *(const size_t *)member);
        break;
    case SECONDS:
        snprintf(ret, size, "%.0f", *(const double *)member);
        break;
    case HOURS:
        snprintf(ret, size, "%lld", (long long)(*(const int64_t *)member / HOUR_MS));
        break;
    }
}

/* Takes setting `i` from a source called `where` in a message. */
static int take(struct config *config, size_t i, const char *text, struct config_origin origin,
                const char *where, char *message, size_t size)
{
    char why[256];
    if (setting_table[i].kind == ORIGINS && config->origin[i].source != origin.source)
        *((char *)config + setting_table[i].offset) = '\0'; /* a stronger source replaces a weaker one's */
    if (take_value(&setting_table[i], text, config, why, sizeof why) != 0)
        return refuse(message, size, "%s: %s", where, why);
    config->origin[i] = origin;
    return 0;
}

/* ---- the file ---------------------------------------------------------------------------------------- */

static int on_pair(const char *name, const char *value, unsigned line, void *data, char *message,
                   size_t message_size)
{
    struct config *config = data;
    for (size_t i = 0; i < SETTINGS; i++) {
        if (i == THE_FILE || strcmp(setting_table[i].name, name) != 0)
            continue;
        if (config->origin[i].source == CONFIG_FILE)
            return refuse(message, message_size, "%s stands in line %u already", name,
                          config->origin[i].line);
        return take(config, i, value, (struct config_origin){CONFIG_FILE, line}, name, message, message_size);
    }
    return refuse(message, message_size, "there is no setting \"%s\"", name);
}

int config_read(FILE *in, const char *path, struct config *config, char *message, size_t message_size)
{
    char why[512];
    unsigned line;
    if (conffile_read(in, on_pair, config, &line, why, sizeof why) != 0)
        return refuse(message, message_size, "%s:%u: %s", path, line, why);
    return 0;
}

/* The file to be read into config->file, "": none. `flag` may be NULL. Whether it must be there. */
static bool find_file(struct config *config, const char *flag)
{
    const char *named = flag != NULL ? flag : variable("DRAPED_CONFIG");
    const char *dir = variable("CONFIGURATION_DIRECTORY");
    if (named != NULL)
        snprintf(config->file, sizeof config->file, "%s", named);
    else
        snprintf(config->file, sizeof config->file, "%s/draped.conf", dir != NULL ? dir : CONFIG_DEFAULT_DIR);
    return named != NULL;
}

static int read_file(struct config *config, const char *flag, char *message, size_t message_size)
{
    bool wanted = find_file(config, flag);
    char path[CONFIG_TEXT_SIZE];
    FILE *in = fopen(config->file, "re");
    memcpy(path, config->file, sizeof path);
    if (in == NULL && errno == ENOENT && !wanted) {
        config->file[0] = '\0';
        return 0;
    }
    if (in == NULL)
        return refuse(message, message_size, "%s: %s", path, strerror(errno));
    int failed = config_read(in, path, config, message, message_size);
    fclose(in);
    return failed;
}

/* ---- environment and flags --------------------------------------------------------------------------- */

static void variable_name(const struct setting *s, char *ret, size_t size)
{
    int n = snprintf(ret, size, "DRAPED_%s", s->name);
    for (int i = 0; i < n; i++)
        ret[i] = ret[i] == '-' ? '_' : (char)toupper((unsigned char)ret[i]);
}

static int take_environment(struct config *config, char *message, size_t message_size)
{
    for (size_t i = 0; i < SETTINGS; i++) {
        char name[64];
        variable_name(&setting_table[i], name, sizeof name);
        const char *text = variable(name);
        if (text != NULL && take(config, i, text, (struct config_origin){CONFIG_ENVIRONMENT, 0}, name,
                                 message, message_size) != 0)
            return -1;
    }
    return 0;
}

#define FIRST_KEY 256 /* beyond the characters: there are no short flags */
#define KEY_CHECK (FIRST_KEY + CONFIG_MAX_SETTINGS)
#define KEY_MAKE  (KEY_CHECK + 1)

struct flags {
    const char *text[SETTINGS];         /* NULL: not given */
    char origins[2 * CONFIG_TEXT_SIZE]; /* of all the flags for them, with blanks between; past that is too
                                           long */
    const char *stray;
    const char *make_key;
    bool check_only;
};

static int take_flags(struct config *config, const struct flags *flags, char *message, size_t message_size)
{
    if (flags->stray != NULL)
        return refuse(message, message_size, "\"%s\" is not a flag", flags->stray);
    for (size_t i = 0; i < SETTINGS; i++) {
        char name[64];
        snprintf(name, sizeof name, "--%s", setting_table[i].name);
        if (flags->text[i] != NULL && take(config, i, flags->text[i], (struct config_origin){CONFIG_FLAG, 0},
                                           name, message, message_size) != 0)
            return -1;
    }
    config->check_only = flags->check_only;
    config->make_key = flags->make_key;
    return 0;
}

static void take_flag(struct flags *flags, size_t i, const char *text)
{
    flags->text[i] = text;
    if (setting_table[i].kind != ORIGINS)
        return;
    size_t used = strlen(flags->origins);
    snprintf(flags->origins + used, sizeof flags->origins - used, "%s ", text);
    flags->text[i] = flags->origins;
}

static error_t on_option(int key, char *text, struct argp_state *state)
{
    struct flags *flags = state->input;
    if (key == ARGP_KEY_ARG)
        flags->stray = text;
    else if (key == KEY_CHECK)
        flags->check_only = true;
    else if (key == KEY_MAKE)
        flags->make_key = text;
    else if (key >= FIRST_KEY && key < FIRST_KEY + (int)SETTINGS)
        take_flag(flags, (size_t)(key - FIRST_KEY), text);
    else
        return ARGP_ERR_UNKNOWN;
    return 0;
}

/* Adds its default to the help of a setting. */
static char *help_with_default(int key, const char *text, void *input)
{
    (void)input;
    struct config defaults;
    char value[CONFIG_TEXT_SIZE], *help = NULL;
    if (key < FIRST_KEY || key >= FIRST_KEY + (int)SETTINGS)
        return (char *)(uintptr_t)text; /* as argp has it: the same, or one to free */
    config_set_defaults(&defaults);
    format_value(&setting_table[key - FIRST_KEY], &defaults, value, sizeof value);
    if (value[0] == '\0' || asprintf(&help, "%s (%s)", text, value) < 0)
        return (char *)(uintptr_t)text;
    return help;
}

static void print_version(FILE *out, struct argp_state *state)
{
    (void)state;
    fprintf(out, "draped %s\n", drape_version());
}

static error_t parse_flags(int argc, char **argv, struct flags *ret)
{
    struct argp_option options[SETTINGS + 5] = {
        {"check-config", KEY_CHECK, NULL, 0, "Print every setting with its source, and leave", 1},
        {"make-key", KEY_MAKE, "NAME", 0, "Print a new key and its entry for the key file, and leave", 1},
        {NULL, 0, NULL, 0, "Ended jobs are removed, the oldest first, beyond:", 2},
        {NULL, 0, NULL, 0, "Limits:", 3},
    };
    for (size_t i = 0; i < SETTINGS; i++) {
        const struct setting *s = &setting_table[i];
        options[4 + i] = (struct argp_option){s->name, FIRST_KEY + (int)i, s->argument, 0, s->help, s->group};
    }
    const struct argp argp = {
        .options = options,
        .parser = on_option,
        .doc =
            "draped: finds how garments hang at rest, and serves it over HTTP.\v"
            "A setting may also stand in the file, as `workers = 2', or in the environment, as "
            "DRAPED_WORKERS=2. Flags win over the environment, and that over the file.\n\n"
            "SIGTERM stops the daemon in order: running jobs get the drain timeout to finish and then go "
            "back to the queue; a second SIGTERM sends them back at once. SIGHUP reads the key file again.",
        .help_filter = help_with_default,
    };
    argp_program_version_hook = print_version;
    return argp_parse(&argp, argc, argv, 0, NULL, ret);
}

/* ---- all together ------------------------------------------------------------------------------------ */

/* Where a setting comes from: "--workers", "DRAPED_WORKERS" or "/etc/draped/draped.conf:3: workers". */
static void format_origin(const struct config *config, size_t i, char *ret, size_t size)
{
    const struct config_origin *origin = &config->origin[i];
    if (origin->source == CONFIG_FILE)
        snprintf(ret, size, "%s:%u: %s", config->file, origin->line, setting_table[i].name);
    else if (origin->source == CONFIG_ENVIRONMENT)
        variable_name(&setting_table[i], ret, size);
    else
        snprintf(ret, size, "--%s", setting_table[i].name);
}

/* Refuses a setting for what only another one makes wrong; the exit status. */
__attribute__((format(printf, 5, 6))) static int refuse_setting(const struct config *config, size_t offset,
                                                                char *message, size_t message_size,
                                                                const char *format, ...)
{
    char where[CONFIG_TEXT_SIZE + 100], why[256];
    size_t i = 0;
    va_list args;
    va_start(args, format);
    vsnprintf(why, sizeof why, format, args);
    va_end(args);
    while (setting_table[i].offset != offset)
        i++;
    format_origin(config, i, where, sizeof where);
    refuse(message, message_size, "%s: %s", where, why);
    return config->origin[i].source == CONFIG_FILE ? EX_CONFIG : EX_USAGE;
}

static int check_loopback(const struct config *config, size_t offset, char *message, size_t message_size)
{
    const struct sockaddr_storage *address = (const void *)((const char *)config + offset);
    char text[CONFIG_ADDRESS_SIZE];
    if (config_is_loopback(address))
        return 0;
    config_format_address(address, text);
    return refuse_setting(config, offset, message, message_size,
                          "%s is not a loopback address: without --keys only this machine is served", text);
}

/* What no setting can say alone; 0 or the exit status. */
static int check_together(const struct config *config, char *message, size_t message_size)
{
    const struct limits *limits = &config->limits;
    /* Streams alone must not shut everybody else out. */
    if (limits->streams >= limits->connections)
        return refuse_setting(config, AT(limits.streams), message, message_size,
                              "%zu must be below max-connections, %zu", limits->streams, limits->connections);
    /* A job that is accepted can run. */
    if (limits->job_memory > limits->memory)
        return refuse_setting(config, AT(limits.job_memory), message, message_size,
                              "%llu must not be above memory, %llu", (unsigned long long)limits->job_memory,
                              (unsigned long long)limits->memory);
    if (config->keys[0] != '\0')
        return 0;
    int status = check_loopback(config, AT(listen), message, message_size);
    return status != 0 ? status : check_loopback(config, AT(admin), message, message_size);
}

int config_parse(int argc, char **argv, struct config *ret, char *message, size_t message_size)
{
    struct flags flags = {0};
    if (parse_flags(argc, argv, &flags) != 0) {
        refuse(message, message_size, "out of memory");
        return EX_USAGE;
    }
    config_set_defaults(ret);
    if (read_file(ret, flags.text[THE_FILE], message, message_size) != 0)
        return EX_CONFIG;
    if (take_environment(ret, message, message_size) != 0 ||
        take_flags(ret, &flags, message, message_size) != 0)
        return EX_USAGE;
    return check_together(ret, message, message_size);
}

/* A misspelt variable says nothing by itself. */
static void print_unknown_variables(FILE *out)
{
    for (char **v = environ; *v != NULL; v++) {
        char name[64];
        size_t i = 0, n = strcspn(*v, "=");
        for (; i < SETTINGS; i++) {
            variable_name(&setting_table[i], name, sizeof name);
            if (strlen(name) == n && strncmp(*v, name, n) == 0)
                break;
        }
        if (i == SETTINGS && strncmp(*v, "DRAPED_", 7) == 0)
            fprintf(out, "# %.*s is in the environment, and no setting\n", (int)n, *v);
    }
}

void config_print(FILE *out, const struct config *config)
{
    for (size_t i = 0; i < SETTINGS; i++) {
        char value[CONFIG_TEXT_SIZE], from[CONFIG_TEXT_SIZE + 100] = "default";
        format_value(&setting_table[i], config, value, sizeof value);
        if (config->origin[i].source != CONFIG_DEFAULT)
            format_origin(config, i, from, sizeof from);
        /* What a file cannot say, its own name and the absence of a text, stands in a comment. */
        fprintf(out, "%s%s = %s  ; %s\n", value[0] == '\0' || i == THE_FILE ? "# " : "",
                setting_table[i].name, value, from);
    }
    print_unknown_variables(out);
}
