/* command_compare.c - `drape compare`: one job under several methods, and what each of them costs. */
#include "cli.h"

#include <stdlib.h>
#include <string.h>

#include "compare.h"
#include "compare_figures.h"
#include "compare_page.h"
#include "job.h"
#include "methodspec.h"
#include "textfile.h"
#include "watch.h"

struct arguments {
    struct cli *cli;
    const char *job, *output, *csv;    /* paths; output and csv may be NULL */
    char *spec[COMPARE_MAX_RUNS];      /* owned */
    json_t *members[COMPARE_MAX_RUNS]; /* owned; what each puts into "solver" */
    size_t specs;
};

enum { OPTION_METHODS = 0x200, OPTION_CSV };

static const struct argp_option options[] = {
    {"methods", OPTION_METHODS, "NAME,NAME...", 0, "Methods by their names alone", 0},
    {"method", 'm', "NAME[:MEMBER=VALUE,...]", 0,
     "One method with its own solver members; may be given again and again", 0},
    {"output", 'o', "HTML", 0, "Where the report goes: one page with plots and tables", 0},
    {"csv", OPTION_CSV, "CSV", 0, "Where every row of every trace goes, with its distance", 0},
    {0},
};

/* ---- arguments ----------------------------------------------------------------------------------- */

static void add_method(struct argp_state *state, struct arguments *arguments, const char *text, size_t bytes)
{
    struct failure failure;
    if (arguments->specs == COMPARE_MAX_RUNS) {
        argp_error(state, "at most %d methods can be compared", COMPARE_MAX_RUNS);
    }
    char *spec = strndup(text, bytes);
    if (!spec) {
        argp_failure(state, EXIT_LOCAL, 0, "out of memory");
        return;
    }
    if (methodspec_parse(spec, &arguments->members[arguments->specs], &failure) < 0) {
        argp_error(state, "%s", failure.message);
    }
    for (size_t i = 0; i < arguments->specs; i++) {
        if (strcmp(arguments->spec[i], spec) == 0) {
            argp_error(state, "the method %.200s is given twice", spec);
        }
    }
    arguments->spec[arguments->specs++] = spec;
}

/* Commas stand between names here, and between members in --method: hence two options. */
static void add_methods(struct argp_state *state, struct arguments *arguments, const char *list)
{
    if (strpbrk(list, ":=")) {
        argp_error(state, "--methods takes names alone; for solver members give --method NAME:MEMBER=VALUE");
    }
    for (;;) {
        size_t bytes = strcspn(list, ",");
        add_method(state, arguments, list, bytes);
        if (list[bytes] == '\0') {
            return;
        }
        list += bytes + 1;
    }
}

static void check_extension(struct argp_state *state, const char *option, const char *path,
                            const char *wanted)
{
    char extension[16];
    textfile_extension(path, extension);
    if (strcmp(extension, wanted) != 0) {
        argp_error(state, "%s: --%s takes a name that ends in .%s", path, option, wanted);
    }
}

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        cli_init(state, arguments->cli);
        return 0;
    case OPTION_METHODS:
        add_methods(state, arguments, argument);
        return 0;
    case 'm':
        add_method(state, arguments, argument, strlen(argument));
        return 0;
    case 'o':
        check_extension(state, "output", argument, "html");
        arguments->output = argument;
        return 0;
    case OPTION_CSV:
        check_extension(state, "csv", argument, "csv");
        arguments->csv = argument;
        return 0;
    case ARGP_KEY_ARG:
        if (arguments->job) {
            argp_error(state, "too many arguments");
        }
        arguments->job = argument;
        return 0;
    case ARGP_KEY_END:
        if (!arguments->job) {
            argp_error(state, "which JOB? a file, or - for standard input");
        }
        if (arguments->specs == 0) {
            argp_error(state, "which methods? such as --methods auto,stop-and-go,dynamic");
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .options = options,
    .parser = parse,
    .args_doc = "JOB",
    .children = cli_children,
    .doc = "Solves one job by several methods, one after the other, and tells what each of them costs.\v"
           "  drape compare JOB --methods auto,stop-and-go,dynamic -o report.html\n"
           "  drape compare JOB -m stop-and-go -m stop-and-go:stop_on=kinetic \\\n"
           "      -m stop-and-go:integrator=bdf2,time_step=0.01 --csv rows.csv\n"
           "\n"
           "A method replaces those members of the job's \"solver\" that it names and keeps the others. Any "
           "member will do, damping.air=0.1 reaches into an object, and the server checks them all: a method "
           "that it refuses is reported with its reason while the others go on.\n"
           "\n"
           "Distances are (E - E*) / (E0 - E*): E0 is the potential energy at the start, E* the lowest "
           "certified one at the end, or the lowest of all when none is certified, and the report says so. "
           "Each method is asked for a certificate, which its costs leave out, unless the job or the method "
           "says certify=false. The table is printed too; with --json it is JSON.\n"
           "\n"
           "Exits with the worst of: 0 all came to rest, 5 some did not, 4 a job failed, 2 the server "
           "refused one.",
};

/* ---- running ------------------------------------------------------------------------------------- */

/* The server's words on one line: its own detail is indented under the title. */
static char *flatten(const char *message)
{
    static const char prefix[] = "the server refused the job: ";
    message += strncmp(message, prefix, strlen(prefix)) == 0 ? strlen(prefix) : 0;
    char *made = strdup(message), *end = made;
    for (const char *c = message; made && *c; c++) {
        if (strncmp(c, "\ntry: ", 6) == 0 || strncmp(c, "\nrequest id: ", 13) == 0) {
            c += strcspn(c + 1, "\n"); /* neither belongs into a table */
            continue;
        }
        *end++ = *c == '\n' ? ':' : *c;
        if (*c == '\n') {
            c += strspn(c + 1, " ");
            *end++ = ' ';
        }
    }
    if (made) {
        *end = '\0';
    }
    return made;
}

/* Keeps a refusal with its run; anything else ends the command. 0 when kept. */
static int keep_refusal(struct compare_run *run, struct failure *failure)
{
    if (failure->code != EXIT_REFUSED) {
        return -1;
    }
    run->refusal = flatten(failure->message);
    return run->refusal ? 0 : failure_no_memory(failure);
}

static int fetch_trace(struct http *http, struct compare_run *run, struct failure *failure)
{
    struct http_reply reply;
    int status = job_fetch(http, job_id(run->job), "trace", "json", &reply, failure);
    if (status == 0) {
        status = trace_parse(reply.body, reply.bytes, &run->trace, failure);
    }
    http_reply_done(&reply);
    /* a job that failed has no trace, and its own error says more */
    if (status < 0 && failure->code == EXIT_REFUSED && strcmp(job_status(run->job), "succeeded") != 0) {
        return 0;
    }
    return status < 0 ? keep_refusal(run, failure) : 0;
}

static int submit(struct http *http, json_t *job, json_t *members, json_t **ret, struct failure *failure)
{
    json_t *document = methodspec_apply(members, job);
    char *text = document ? json_dumps(document, JSON_COMPACT) : NULL;
    int status = text ? job_submit(http, text, strlen(text), ret, failure) : failure_no_memory(failure);
    free(text);
    json_decref(document);
    return status;
}

/* Certified minima make E* sure; the job's own word on it counts more. */
static int ask_for_certificate(const json_t *job, json_t *members, struct failure *failure)
{
    const json_t *solver = json_object_get(job, "solver");
    if (json_object_get(solver, "certify") || json_object_get(members, "certify")) {
        return 0;
    }
    return json_object_set_new(members, "certify", json_true()) < 0 ? failure_no_memory(failure) : 0;
}

static int run_method(struct http *http, json_t *job, json_t *members, struct meter *meter,
                      struct compare_run *run, struct failure *failure)
{
    json_t *submitted = NULL;
    if (ask_for_certificate(job, members, failure) < 0) {
        return -1;
    }
    if (submit(http, job, members, &submitted, failure) < 0) {
        return keep_refusal(run, failure);
    }
    int status = watch_job(http, job_id(submitted), meter, NULL, &run->job, failure);
    json_decref(submitted);
    return status < 0 ? keep_refusal(run, failure) : fetch_trace(http, run, failure);
}

static void say_end(FILE *file, const struct compare_run *run)
{
    if (!run->job) {
        fprintf(file, "refused: %s\n", compare_reason(run));
        return;
    }
    fprintf(file, "%s after %.0f iterations, %.2f s\n", compare_outcome(run),
            compare_figure(run, "iterations"), compare_figure(run, "seconds"));
}

static int run_all(struct http *http, const struct arguments *arguments, json_t *job, struct comparison *c,
                   struct failure *failure)
{
    for (size_t i = 0; i < c->runs; i++) {
        struct meter meter = meter_new(stderr, arguments->cli->quiet);
        if (meter.file) {
            fprintf(meter.file, "method %zu of %zu: %s\n", i + 1, c->runs, c->run[i].spec);
        }
        if (run_method(http, job, arguments->members[i], &meter, &c->run[i], failure) < 0) {
            return -1;
        }
        if (meter.file) {
            say_end(meter.file, &c->run[i]);
        }
    }
    return 0;
}

/* ---- reporting ----------------------------------------------------------------------------------- */

static int write_csv(const struct comparison *c, const char *path, struct failure *failure)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&text, &bytes);
    if (!file) {
        return failure_no_memory(failure);
    }
    compare_put_csv(file, c);
    bool whole = !ferror(file);
    int status =
        fclose(file) == 0 && whole ? textfile_write(path, text, bytes, failure) : failure_no_memory(failure);
    free(text);
    return status;
}

static int write_page(const struct comparison *c, const json_t *job, const char *path,
                      struct failure *failure)
{
    char *page = NULL;
    size_t bytes = 0;
    int status = compare_page(c, job, &page, &bytes, failure);
    if (status == 0) {
        status = textfile_write(path, page, bytes, failure);
    }
    free(page);
    return status;
}

static int print_json(const struct comparison *c, struct failure *failure)
{
    json_t *figures = compare_to_json(c);
    if (!figures) {
        return failure_no_memory(failure);
    }
    json_dumpf(figures, stdout, JSON_INDENT(2) | JSON_PRESERVE_ORDER);
    fputc('\n', stdout);
    json_decref(figures);
    return 0;
}

static int report(const struct arguments *arguments, const struct comparison *c, const json_t *job,
                  struct failure *failure)
{
    if (arguments->cli->json) {
        if (print_json(c, failure) < 0) {
            return -1;
        }
    } else if (!arguments->cli->quiet) {
        compare_put_table(stdout, c);
    }
    if (arguments->csv && write_csv(c, arguments->csv, failure) < 0) {
        return -1;
    }
    return arguments->output ? write_page(c, job, arguments->output, failure) : 0;
}

/* Worst first: refused, failed, not at rest. */
static enum exit_code exit_code_of(const struct comparison *c)
{
    enum exit_code worst = EXIT_AT_REST;
    for (size_t i = 0; i < c->runs; i++) {
        enum exit_code code = c->run[i].refusal ? EXIT_REFUSED : job_exit_code(c->run[i].job);
        if (code != EXIT_AT_REST && (worst == EXIT_AT_REST || code < worst)) {
            worst = code;
        }
    }
    return worst;
}

static int read_job(const char *path, json_t **ret, struct failure *failure)
{
    char *text = NULL;
    size_t bytes = 0;
    json_error_t error;
    if (textfile_read(path, &text, &bytes, failure) < 0) {
        return -1;
    }
    *ret = json_loadb(text, bytes, JSON_REJECT_DUPLICATES, &error);
    free(text);
    if (!json_is_object(*ret)) {
        json_decref(*ret);
        *ret = NULL;
        return failure_set(failure, EXIT_USAGE,
                           "%s is not a job: line %d: %s\ntry: check it with `jq . FILE`", path, error.line,
                           error.text[0] ? error.text : "not an object");
    }
    return 0;
}

static int compare(const struct arguments *arguments, struct failure *failure)
{
    struct compare_run run[COMPARE_MAX_RUNS] = {{0}};
    struct comparison comparison = {.run = run, .runs = arguments->specs};
    struct http *http = NULL;
    json_t *job = NULL;
    int code = -1;
    for (size_t i = 0; i < arguments->specs; i++) {
        run[i].spec = arguments->spec[i];
    }
    if (read_job(arguments->job, &job, failure) == 0 && cli_connect(arguments->cli, &http, failure) == 0 &&
        run_all(http, arguments, job, &comparison, failure) == 0) {
        compare_reckon(&comparison);
        code = report(arguments, &comparison, job, failure) == 0 ? (int)exit_code_of(&comparison) : -1;
    }
    for (size_t i = 0; i < arguments->specs; i++) {
        compare_run_done(&run[i]);
    }
    http_free(http);
    json_decref(job);
    return code;
}

int command_compare(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli};
    argp_parse(&argp, argc, argv, 0, NULL, &arguments);
    int code = compare(&arguments, failure);
    for (size_t i = 0; i < arguments.specs; i++) {
        free(arguments.spec[i]);
        json_decref(arguments.members[i]);
    }
    return code;
}
