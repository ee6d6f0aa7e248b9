/* command_run.c - `drape run`, `submit` and `watch`: what sends a job or follows it to its end. */
#include "cli.h"

#include <stdlib.h>
#include <string.h>

#include "job.h"
#include "jobfile.h"
#include "report.h"
#include "textfile.h"
#include "watch.h"

struct arguments {
    struct cli *cli;
    const char *what;                     /* JOB or ID */
    const char *output, *picture, *trace; /* paths; NULL: not wanted */
    const char *from;                     /* the job to start from; NULL: as JOB says */
    const char *missing;                  /* what to say when `what` is not given */
};

/* ---- run ----------------------------------------------------------------------------------------- */

enum { OPTION_PICTURE = 0x200, OPTION_TRACE, OPTION_FROM };

#define FROM_OPTION                                                                                          \
    {                                                                                                        \
        "from", OPTION_FROM, "ID", 0, "Begin at the drape of that job, whatever start_from says", 0          \
    }

static const struct argp_option run_options[] = {
    {"output", 'o', "FILE", 0, "Where the drape goes: .glb, .obj, .ply or .json", 0},
    {"picture", OPTION_PICTURE, "PNG", 0, "Draw front, side and back of the drape", 0},
    FROM_OPTION,
    {"trace", OPTION_TRACE, "FILE", 0, "Where the trace goes: .csv, .json, or .svg for the plot", 0},
    {0},
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
    case OPTION_PICTURE:
        arguments->picture = argument;
        return 0;
    case OPTION_TRACE:
        arguments->trace = argument;
        return 0;
    case OPTION_FROM:
        arguments->from = argument;
        return 0;
    case ARGP_KEY_ARG:
        if (arguments->what) {
            argp_error(state, "too many arguments");
        }
        arguments->what = argument;
        return 0;
    case ARGP_KEY_END:
        if (!arguments->what) {
            argp_error(state, "%s", arguments->missing);
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp run_argp = {
    .options = run_options,
    .parser = parse,
    .args_doc = "JOB",
    .children = cli_children,
    .doc =
        "Submits a job, shows how it goes, prints a summary and fetches what was asked for.\v"
        "JOB is a document of POST /v1/jobs, as `drape example` and `drape scene` print it; \"-\" is "
        "standard "
        "input. With --json the ended job is printed as JSON instead of the summary. Ctrl-C leaves the job "
        "running at the server. What the server warns of, a seam sewn in crossed directions say, is told "
        "first.",
};

/* The format that a path's extension names, if it is in the list; or -1 with *failure. */
static int check_extension(const char *path, const char *const *known, const char *list, char ret[16],
                           struct failure *failure)
{
    textfile_extension(path, ret);
    for (size_t i = 0; known[i]; i++) {
        if (strcmp(known[i], ret) == 0) {
            return 0;
        }
    }
    return failure_set(failure, EXIT_USAGE, "%s: the name must end in %s", path, list);
}

static const char *const result_formats[] = {"glb", "obj", "ply", "json", NULL};
static const char *const trace_formats[] = {"csv", "json", "svg", NULL};

/* A drape is not lost because the file could not be written. */
static void hint_fetch(const char *id, const char *kind, struct failure *failure)
{
    if (failure->code == EXIT_LOCAL) {
        failure_add(failure, "try: the server keeps it: `drape %s %s -o FILE` fetches it again", kind, id);
    }
}

static int fetch_file(struct http *http, const char *id, const char *kind, const char *path,
                      struct failure *failure)
{
    char format[16];
    struct http_reply reply;
    textfile_extension(path, format);
    int status = job_fetch(http, id, kind, format, &reply, failure);
    if (status == 0) {
        status = textfile_write(path, reply.body, reply.bytes, failure);
        if (status < 0) {
            hint_fetch(id, kind, failure);
        }
    }
    http_reply_done(&reply);
    return status;
}

static int fetch_picture(struct http *http, const char *id, const struct arguments *arguments,
                         const char *job_text, size_t job_bytes, struct failure *failure)
{
    struct picture picture = {0};
    struct http_reply reply;
    size_t skipped = 0;
    int status = job_fetch(http, id, "result", "glb", &reply, failure);
    if (status == 0) {
        status = jobfile_parse(arguments->what, job_text, job_bytes, &picture, &skipped, failure);
    }
    if (skipped > 0 && !arguments->cli->quiet) {
        fprintf(stderr, "%zu bodies are given by reference and not shown\n", skipped);
    }
    if (status == 0) {
        status = jobfile_set_result("the result", reply.body, reply.bytes, NULL, &picture, failure);
    }
    if (status == 0) {
        status = picture_save(&picture, arguments->picture, failure);
    }
    picture_done(&picture);
    http_reply_done(&reply);
    return status;
}

/* The job's paragraph, and the trace below it if there is one. */
static void print_summary(struct http *http, const json_t *job)
{
    struct http_reply reply;
    struct failure ignored; /* a job that failed early has no trace */
    report_job(stdout, job);
    if (strcmp(job_status(job), "succeeded") == 0 &&
        job_fetch(http, job_id(job), "trace", "csv", &reply, &ignored) == 0) {
        report_trace(stdout, reply.body);
        http_reply_done(&reply);
    }
}

static void print_end(const struct cli *cli, struct http *http, const json_t *job)
{
    if (cli->json) {
        json_dumpf(job, stdout, JSON_INDENT(2) | JSON_PRESERVE_ORDER);
        fputc('\n', stdout);
    } else if (!cli->quiet) {
        print_summary(http, job);
    }
    fflush(stdout);
}

static int fetch_all(struct http *http, const json_t *job, const struct arguments *arguments,
                     const char *text, size_t bytes, struct failure *failure)
{
    const char *id = job_id(job);
    if (strcmp(job_status(job), "succeeded") != 0) {
        return 0; /* there is nothing to fetch, and the summary has said why */
    }
    if (arguments->trace && fetch_file(http, id, "trace", arguments->trace, failure) < 0) {
        return -1;
    }
    if (arguments->output && fetch_file(http, id, "result", arguments->output, failure) < 0) {
        return -1;
    }
    return arguments->picture ? fetch_picture(http, id, arguments, text, bytes, failure) : 0;
}

/* Reads JOB, and puts --from into it. The caller frees *ret. */
static int read_job(const struct arguments *arguments, char **ret, size_t *ret_bytes, struct failure *failure)
{
    json_error_t error;
    if (textfile_read(arguments->what, ret, ret_bytes, failure) < 0 || !arguments->from) {
        return *ret ? 0 : -1;
    }
    json_t *job = json_loadb(*ret, *ret_bytes, JSON_REJECT_DUPLICATES, &error);
    int failed = !job || json_object_set_new(job, "start_from", json_string(arguments->from)) < 0;
    char *text = failed ? NULL : json_dumps(job, JSON_COMPACT | JSON_PRESERVE_ORDER);
    json_decref(job);
    if (!text) {
        return failure_set(failure, EXIT_USAGE, "%s is no job: line %d: %s", arguments->what,
                           job ? 1 : error.line, job ? "not an object" : error.text);
    }
    free(*ret);
    *ret = text;
    *ret_bytes = strlen(text);
    return 0;
}

static int run_job(struct http *http, const struct arguments *arguments, const char *text, size_t bytes,
                   struct failure *failure)
{
    struct meter meter = meter_new(stderr, arguments->cli->quiet || arguments->cli->json);
    json_t *job = NULL, *ended = NULL;
    int code = -1;
    if (job_submit(http, text, bytes, &job, failure) < 0) {
        return -1;
    }
    job_print_warnings(stderr, job);
    if (meter.file) {
        fprintf(meter.file, "job %s\n", job_id(job));
    }
    if (watch_job(http, job_id(job), &meter, NULL, &ended, failure) == 0) {
        print_end(arguments->cli, http, ended);
        if (fetch_all(http, ended, arguments, text, bytes, failure) == 0) {
            code = (int)job_exit_code(ended);
        }
    }
    json_decref(job);
    json_decref(ended);
    return code;
}

int command_run(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli, .missing = "which JOB? a file, or - for standard input"};
    char format[16], *text = NULL;
    size_t bytes = 0;
    struct http *http = NULL;
    int code = -1;
    argp_parse(&run_argp, argc, argv, 0, NULL, &arguments);
    if ((arguments.output && check_extension(arguments.output, result_formats, ".glb, .obj, .ply or .json",
                                             format, failure) < 0) ||
        (arguments.trace &&
         check_extension(arguments.trace, trace_formats, ".csv, .json or .svg", format, failure) < 0)) {
        return -1;
    }
    if (read_job(&arguments, &text, &bytes, failure) == 0 && cli_connect(cli, &http, failure) == 0) {
        code = run_job(http, &arguments, text, bytes, failure);
    }
    http_free(http);
    free(text);
    return code;
}

/* ---- submit -------------------------------------------------------------------------------------- */

static const struct argp_option submit_options[] = {FROM_OPTION, {0}};

static const struct argp submit_argp = {
    .options = submit_options,
    .parser = parse,
    .args_doc = "JOB",
    .children = cli_children,
    .doc = "Submits a job and prints its id (with --json the whole answer); warnings go to standard error.",
};

int command_submit(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli, .missing = "which JOB? a file, or - for standard input"};
    char *text = NULL;
    size_t bytes = 0;
    struct http *http = NULL;
    json_t *job = NULL;
    int code = -1;
    argp_parse(&submit_argp, argc, argv, 0, NULL, &arguments);
    if (read_job(&arguments, &text, &bytes, failure) == 0 && cli_connect(cli, &http, failure) == 0 &&
        job_submit(http, text, bytes, &job, failure) == 0) {
        job_print_warnings(stderr, job);
        if (cli->json) {
            json_dumpf(job, stdout, JSON_INDENT(2) | JSON_PRESERVE_ORDER);
            fputc('\n', stdout);
        } else {
            printf("%s\n", job_id(job));
        }
        code = 0;
    }
    json_decref(job);
    http_free(http);
    free(text);
    return code;
}

/* ---- watch --------------------------------------------------------------------------------------- */

static const struct argp watch_argp = {
    .parser = parse,
    .args_doc = "ID",
    .children = cli_children,
    .doc = "Follows a job to its end and prints the summary.\v"
           "The connection may break and the server restart: watching goes on where it left off. With --json "
           "each event is one line of JSON, and the last line is the ended job.",
};

int command_watch(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli, .missing = "which ID?"};
    struct http *http = NULL;
    json_t *job = NULL;
    int code = -1;
    argp_parse(&watch_argp, argc, argv, 0, NULL, &arguments);
    struct meter meter = meter_new(stderr, cli->quiet || cli->json);
    if (cli_connect(cli, &http, failure) == 0 &&
        watch_job(http, arguments.what, &meter, cli->json ? stdout : NULL, &job, failure) == 0) {
        if (cli->json) {
            json_dumpf(job, stdout, JSON_COMPACT | JSON_PRESERVE_ORDER);
            fputc('\n', stdout);
        } else if (!cli->quiet) {
            print_summary(http, job);
        }
        code = (int)job_exit_code(job);
    }
    json_decref(job);
    http_free(http);
    return code;
}
