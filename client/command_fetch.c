/* command_fetch.c - `drape result` and `drape trace`: files of a job that has ended. */
#include "cli.h"

#include <string.h>

#include "job.h"
#include "textfile.h"

struct arguments {
    struct cli *cli;
    const char *id, *output, *format;
    bool plot;
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        cli_init(state, arguments->cli);
        return 0;
    case 'o':
        arguments->output = argument;
        return 0;
    case 'f':
        arguments->format = argument;
        return 0;
    case 'p':
        arguments->plot = true;
        return 0;
    case ARGP_KEY_ARG:
        if (arguments->id) {
            argp_error(state, "too many arguments");
        }
        arguments->id = argument;
        return 0;
    case ARGP_KEY_END:
        if (!arguments->id) {
            argp_error(state, "which ID?");
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static int fetch(const struct arguments *arguments, const char *kind, const char *format,
                 struct failure *failure)
{
    struct http *http = NULL;
    struct http_reply reply = {0};
    int status = cli_connect(arguments->cli, &http, failure);
    if (status == 0) {
        status = job_fetch(http, arguments->id, kind, format, &reply, failure);
    }
    if (status == 0) {
        status =
            textfile_write(arguments->output ? arguments->output : "-", reply.body, reply.bytes, failure);
    }
    http_reply_done(&reply);
    http_free(http);
    return status;
}

/* --format, else the output's extension, else `fallback`; "" when it is not a word of the list. */
static const char *choose_format(const struct arguments *arguments, const char *const *known,
                                 const char *fallback, char extension[16])
{
    const char *wanted = arguments->format;
    extension[0] = '\0';
    if (!wanted && arguments->output) {
        textfile_extension(arguments->output, extension);
        wanted = extension;
    }
    if (!wanted || !wanted[0]) {
        return fallback;
    }
    for (size_t i = 0; known[i]; i++) {
        if (strcmp(known[i], wanted) == 0) {
            return known[i];
        }
    }
    return "";
}

static const char *const result_formats[] = {"glb", "obj", "ply", "json", NULL};
static const char *const trace_formats[] = {"csv", "json", "svg", NULL};

static const struct argp_option result_options[] = {
    {"output", 'o', "FILE", 0, "Where it goes (standard output)", 0},
    {"format", 'f', "FORMAT", 0, "glb, obj, ply or json (else the file's extension, else json)", 0},
    {0},
};

static const struct argp result_argp = {
    .options = result_options,
    .parser = parse,
    .args_doc = "ID",
    .children = cli_children,
    .doc = "Fetches the drape of a job that has ended.",
};

int command_result(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli};
    char extension[16];
    argp_parse(&result_argp, argc, argv, 0, NULL, &arguments);
    const char *format = choose_format(&arguments, result_formats, "json", extension);
    if (!format[0]) {
        return failure_set(failure, EXIT_USAGE,
                           "the format must be glb, obj, ply or json\ntry: --format glb");
    }
    return fetch(&arguments, "result", format, failure);
}

static const struct argp_option trace_options[] = {
    {"output", 'o', "FILE", 0, "Where it goes (standard output)", 0},
    {"format", 'f', "FORMAT", 0, "csv, json or svg (else the file's extension, else csv)", 0},
    {"plot", 'p', NULL, 0, "The plot: the same as --format svg", 0},
    {0},
};

static const struct argp trace_argp = {
    .options = trace_options,
    .parser = parse,
    .args_doc = "ID",
    .children = cli_children,
    .doc = "Fetches a job's trace: one row per iteration with seconds, energies and residuals.\v"
           "  drape trace ID --plot -o trace.svg",
};

int command_trace(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli};
    char extension[16];
    argp_parse(&trace_argp, argc, argv, 0, NULL, &arguments);
    if (arguments.plot) {
        arguments.format = "svg";
    }
    const char *format = choose_format(&arguments, trace_formats, "csv", extension);
    if (!format[0]) {
        return failure_set(failure, EXIT_USAGE, "the format must be csv, json or svg\ntry: --plot");
    }
    return fetch(&arguments, "trace", format, failure);
}
