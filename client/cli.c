/* cli.c - see cli.h. */
#include "cli.h"

#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "textfile.h"

#define VERSION "drape 0.1.0"

static const struct cli_command commands[] = {
    {"example", "print a complete job: square, arc, skirt or garment", command_example},
    {"scene", "print a job made of garment, seam and body files", command_scene},
    {"run", "submit a job, show how it goes, fetch the drape", command_run},
    {"compare", "solve a job by several methods and report what each costs", command_compare},
    {"submit", "submit a job and print its id", command_submit},
    {"watch", "follow a job to its end", command_watch},
    {"status", "show where a job stands", command_status},
    {"result", "fetch a drape as GLB, OBJ, PLY or JSON", command_result},
    {"trace", "fetch energies and residuals over iterations, or their plot", command_trace},
    {"cancel", "cancel a job", command_cancel},
    {"list", "list jobs", command_list},
    {"materials", "list the fabrics the server knows", command_materials},
    {"picture", "draw a drape: front, side and back", command_picture},
};

/* ---- global options ------------------------------------------------------------------------------ */

enum { OPTION_URL = 'u', OPTION_KEY = 0x100, OPTION_KEY_FILE, OPTION_JSON };

static const struct argp_option global_options[] = {
    {"url", OPTION_URL, "URL", 0, "The server (else DRAPED_URL, else " CLI_DEFAULT_URL ")", 0},
    {"key", OPTION_KEY, "KEY", 0,
     "Sent as a bearer token (else DRAPED_KEY; none by default). Others on this machine can see it: use a "
     "file",
     0},
    {"key-file", OPTION_KEY_FILE, "FILE", 0, "Holds the key (else DRAPED_KEY_FILE)", 0},
    {"json", OPTION_JSON, NULL, 0, "Print what the server said, as JSON, for scripts", 0},
    {"quiet", 'q', NULL, 0, "Show no progress and no summary", 0},
    {0},
};

static error_t parse_global(int key, char *argument, struct argp_state *state)
{
    struct cli *cli = state->input;
    switch (key) {
    case OPTION_URL:
        cli->url = argument;
        return 0;
    case OPTION_KEY:
        cli->key = argument;
        return 0;
    case OPTION_KEY_FILE:
        cli->key_file = argument;
        cli->key = NULL;
        return 0;
    case OPTION_JSON:
        cli->json = true;
        return 0;
    case 'q':
        cli->quiet = true;
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp global_argp = {.options = global_options, .parser = parse_global};

const struct argp_child cli_children[] = {{&global_argp, 0, "Common to all commands:", 7}, {0}};

void cli_init(struct argp_state *state, struct cli *cli)
{
    state->child_inputs[0] = cli;
}

double cli_number(struct argp_state *state, const char *option, const char *text, double low, double high)
{
    char *end = NULL;
    double value = strtod(text, &end);
    if (end == text || *end != '\0' || !(value >= low && value <= high)) {
        argp_error(state, "--%s takes a number from %g to %g, not \"%s\"", option, low, high, text);
    }
    return value;
}

long cli_integer(struct argp_state *state, const char *option, const char *text, long low, long high)
{
    char *end = NULL;
    errno = 0;
    long value = strtol(text, &end, 10);
    if (errno != 0 || end == text || *end != '\0' || value < low || value > high) {
        argp_error(state, "--%s takes a whole number from %ld to %ld, not \"%s\"", option, low, high, text);
    }
    return value;
}

/* The first line of the key file, to be freed; 0, or -1 with *failure. */
static int read_key(const char *path, char **ret, struct failure *failure)
{
    size_t bytes;
    if (textfile_read(path, ret, &bytes, failure) < 0) {
        return -1;
    }
    (*ret)[strcspn(*ret, "\r\n")] = '\0';
    for (const char *c = *ret; *c; c++) {
        if (*c <= ' ' || *c > '~') { /* else it could add to the request's head */
            **ret = '\0';
            break;
        }
    }
    if (!**ret) {
        free(*ret);
        return failure_set(failure, EXIT_USAGE, "the first line of %s is no key", path);
    }
    return 0;
}

int cli_connect(const struct cli *cli, struct http **ret, struct failure *failure)
{
    char *key = NULL;
    if (!cli->key && cli->key_file && read_key(cli->key_file, &key, failure) < 0) {
        return -1;
    }
    int status = http_new(cli->url, cli->key ? cli->key : key, ret, failure);
    free(key);
    return status;
}

/* ---- the whole program --------------------------------------------------------------------------- */

struct invocation {
    struct cli cli;
    int command_at; /* index of the command's name in argv; 0: none given */
};

/* Everything from the command's name on belongs to the command. */
static error_t parse_top(int key, char *argument, struct argp_state *state)
{
    struct invocation *invocation = state->input;
    (void)argument;
    switch (key) {
    case ARGP_KEY_INIT:
        cli_init(state, &invocation->cli);
        return 0;
    case ARGP_KEY_ARG:
        invocation->command_at = state->next - 1;
        state->next = state->argc;
        return 0;
    case ARGP_KEY_NO_ARGS:
        argp_error(state, "no command given");
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const char top_doc[] =
    "Finds how garments hang at rest, by asking a draped server.\v"
    "A first drape:\n"
    "  drape example garment > dress.json\n"
    "  drape run dress.json -o dress.glb --picture dress.png\n"
    "\n"
    "`drape COMMAND --help` tells more about each. JOB files are documents of POST /v1/jobs; \"-\" is "
    "standard input. ID is a job's id, as `submit` prints it.\n"
    "\n"
    "Exit codes:\n"
    "    0  done; where a drape was asked for, it is at rest\n"
    "    1  wrong arguments, or an input file that cannot be used\n"
    "    2  the server refused the request\n"
    "    3  the server cannot be reached\n"
    "    4  the job failed or was canceled\n"
    "    5  the job ended, but its drape is not at rest\n"
    "    6  out of memory, or an output file that cannot be written\n"
    "  130  interrupted (Ctrl-C); a submitted job goes on at the server\n";

/* Puts the table of commands between the two parts of the text. */
static char *filter_help(int key, const char *text, void *input)
{
    (void)input;
    if (key != ARGP_KEY_HELP_PRE_DOC || !text) {
        return (char *)(uintptr_t)text;
    }
    char *made = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&made, &bytes);
    if (!file) {
        return (char *)(uintptr_t)text;
    }
    fprintf(file, "%s\n\nCommands:\n", text);
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        fprintf(file, "  %-10s %s\n", commands[i].name, commands[i].summary);
    }
    return fclose(file) == 0 ? made : (char *)(uintptr_t)text;
}

static const struct argp top_argp = {
    .parser = parse_top,
    .args_doc = "COMMAND [ARGUMENT...]",
    .doc = top_doc,
    .children = cli_children,
    .help_filter = filter_help,
};

static const struct cli_command *find_command(const char *name)
{
    for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        if (strcmp(commands[i].name, name) == 0) {
            return &commands[i];
        }
    }
    return NULL;
}

static const char *from_environment(const char *name, const char *fallback)
{
    const char *value = getenv(name);
    return value && value[0] ? value : fallback;
}

/* Runs the command with argv[0] replaced by "drape NAME", so that its help and errors say so. */
static int run_command(const struct cli_command *command, struct cli *cli, int argc, char **argv)
{
    char title[64];
    struct failure failure = {.code = EXIT_LOCAL};
    snprintf(title, sizeof title, "drape %s", command->name);
    argv[0] = title;
    int code = command->run(cli, argc, argv, &failure);
    if (code < 0) {
        fprintf(stderr, "%s: %s\n", title, failure.message);
        code = (int)failure.code;
    }
    if (fflush(stdout) != 0 && code == 0) {
        fprintf(stderr, "%s: cannot write the output: %s\n", title, strerror(errno));
        code = EXIT_LOCAL;
    }
    return code;
}

int cli_run(int argc, char **argv)
{
    struct invocation invocation = {.cli = {.url = from_environment("DRAPED_URL", CLI_DEFAULT_URL),
                                            .key = from_environment("DRAPED_KEY", NULL),
                                            .key_file = from_environment("DRAPED_KEY_FILE", NULL)}};
    argp_program_version = VERSION;
    argp_err_exit_status = EXIT_USAGE;
    argp_parse(&top_argp, argc, argv, ARGP_IN_ORDER, NULL, &invocation);
    const char *name = argv[invocation.command_at];
    const struct cli_command *command = find_command(name);
    if (!command) {
        fprintf(stderr, "drape: there is no command \"%s\"\ntry: `drape --help` lists them\n", name);
        return EXIT_USAGE;
    }
    return run_command(command, &invocation.cli, argc - invocation.command_at, argv + invocation.command_at);
}
