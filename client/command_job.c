/* command_job.c - `drape status`, `cancel`, `list` and `materials`: short questions to the server. */
#include "cli.h"

#include <stdlib.h>
#include <string.h>

#include "job.h"
#include "problem.h"
#include "report.h"

struct arguments {
    struct cli *cli;
    const char *id;
    const char *status, *label;
    long limit;
    bool wait;
    bool needs_id;
};

/* Seconds of one long poll; the contract allows 25. */
#define WAIT_S 20
/* The contract's largest page. */
#define LIST_LIMIT   200
#define LIST_DEFAULT 20

enum { OPTION_WAIT = 0x200, OPTION_STATUS, OPTION_LABEL };

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        cli_init(state, arguments->cli);
        return 0;
    case OPTION_WAIT:
        arguments->wait = true;
        return 0;
    case OPTION_STATUS:
        arguments->status = argument;
        return 0;
    case OPTION_LABEL:
        arguments->label = argument;
        return 0;
    case 'l':
        arguments->limit = cli_integer(state, "limit", argument, 1, LIST_LIMIT);
        return 0;
    case ARGP_KEY_ARG:
        if (arguments->id || !arguments->needs_id) {
            argp_error(state, "too many arguments");
        }
        arguments->id = argument;
        return 0;
    case ARGP_KEY_END:
        if (arguments->needs_id && !arguments->id) {
            argp_error(state, "which ID?");
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static void print_json(const json_t *value)
{
    json_dumpf(value, stdout, JSON_INDENT(2) | JSON_PRESERVE_ORDER);
    fputc('\n', stdout);
}

/* GET `path` as JSON. *ret: a new reference; *ret_more: a next page exists. */
static int get_json(struct http *http, const char *path, const char *what, json_t **ret, bool *ret_more,
                    struct failure *failure)
{
    struct http_request request = {.method = "GET", .path = path, .accept = "application/json"};
    struct http_reply reply;
    int status = problem_send(http, &request, what, &reply, failure);
    if (status == 0) {
        *ret = json_loadb(reply.body, reply.bytes, 0, NULL);
        *ret_more = strstr(reply.link, "rel=\"next\"") != NULL;
        if (!*ret) {
            status = failure_set(failure, EXIT_REFUSED,
                                 "the answer is not JSON\ntry: check that --url points to a draped server");
        }
    }
    http_reply_done(&reply);
    return status;
}

/* ---- status -------------------------------------------------------------------------------------- */

static const struct argp_option status_options[] = {
    {"wait", OPTION_WAIT, NULL, 0, "Wait for the job to end", 0},
    {0},
};

static const struct argp status_argp = {
    .options = status_options,
    .parser = parse,
    .args_doc = "ID",
    .children = cli_children,
    .doc =
        "Shows where a job stands.\v"
        "Exits with 0 while the job is queued or running and when it is at rest, else as `drape run` would.",
};

static int wait_for(struct http *http, const struct arguments *arguments, json_t **ret,
                    struct failure *failure)
{
    json_t *job = NULL;
    for (;;) {
        if (job_get(http, arguments->id, arguments->wait ? WAIT_S : 0, &job, failure) < 0) {
            return -1;
        }
        if (!arguments->wait || job_ended(job)) {
            *ret = job;
            return 0;
        }
        json_decref(job);
    }
}

int command_status(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli, .needs_id = true};
    struct http *http = NULL;
    json_t *job = NULL;
    int code = -1;
    argp_parse(&status_argp, argc, argv, 0, NULL, &arguments);
    if (cli_connect(cli, &http, failure) == 0 && wait_for(http, &arguments, &job, failure) == 0) {
        if (cli->json) {
            print_json(job);
        } else if (!cli->quiet) {
            report_job(stdout, job);
        }
        code = job_ended(job) ? (int)job_exit_code(job) : 0;
    }
    json_decref(job);
    http_free(http);
    return code;
}

/* ---- cancel -------------------------------------------------------------------------------------- */

static const struct argp cancel_argp = {
    .parser = parse,
    .args_doc = "ID",
    .children = cli_children,
    .doc = "Cancels a job that is queued or running; removes one that has ended. May be repeated.",
};

int command_cancel(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli, .needs_id = true};
    struct http *http = NULL;
    bool removed = false;
    int code = -1;
    argp_parse(&cancel_argp, argc, argv, 0, NULL, &arguments);
    if (cli_connect(cli, &http, failure) == 0 && job_cancel(http, arguments.id, &removed, failure) == 0) {
        if (!cli->quiet) {
            printf("job %s %s\n", arguments.id, removed ? "removed" : "is being canceled");
        }
        code = 0;
    }
    http_free(http);
    return code;
}

/* ---- list ---------------------------------------------------------------------------------------- */

static const struct argp_option list_options[] = {
    {"status", OPTION_STATUS, "NAME", 0, "Only jobs that are queued, running, succeeded, failed or canceled",
     0},
    {"label", OPTION_LABEL, "LABEL", 0, "Only jobs with this label", 0},
    {"limit", 'l', "N", 0, "At most so many, up to 200 (20)", 0},
    {0},
};

static const struct argp list_argp = {
    .options = list_options,
    .parser = parse,
    .children = cli_children,
    .doc = "Lists jobs, one a line: id, status, verdict, when it was created, name.",
};

/* Appends "&name=value" with the value escaped; 0 or -1. */
static int append_query(FILE *file, const char *name, const char *value)
{
    if (!value) {
        return 0;
    }
    fprintf(file, "&%s=", name);
    for (const char *c = value; *c; c++) {
        bool plain = (*c >= 'a' && *c <= 'z') || (*c >= 'A' && *c <= 'Z') || (*c >= '0' && *c <= '9') ||
                     *c == '-' || *c == '_' || *c == '.';
        fprintf(file, plain ? "%c" : "%%%02X", (unsigned char)*c);
    }
    return ferror(file) ? -1 : 0;
}

static char *list_path(const struct arguments *arguments)
{
    char *path = NULL;
    size_t bytes = 0;
    FILE *file = open_memstream(&path, &bytes);
    if (!file) {
        return NULL;
    }
    fprintf(file, "/v1/jobs?limit=%ld", arguments->limit);
    int status =
        append_query(file, "status", arguments->status) | append_query(file, "label", arguments->label);
    if (fclose(file) != 0 || status != 0) {
        free(path);
        return NULL;
    }
    return path;
}

static void print_list(const struct cli *cli, const json_t *list, bool more)
{
    const json_t *jobs = json_is_array(list) ? list : json_object_get(list, "jobs");
    size_t i;
    json_t *job;
    if (cli->json) {
        print_json(list);
        return;
    }
    json_array_foreach(jobs, i, job)
    {
        report_line(stdout, job);
    }
    if (more && !cli->quiet) {
        fprintf(stderr, "there are more; --limit shows up to %d, --status and --label choose\n", LIST_LIMIT);
    }
}

int command_list(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli, .limit = LIST_DEFAULT};
    struct http *http = NULL;
    json_t *list = NULL;
    bool more = false;
    int code = -1;
    argp_parse(&list_argp, argc, argv, 0, NULL, &arguments);
    char *path = list_path(&arguments);
    if (!path) {
        return failure_no_memory(failure);
    }
    if (cli_connect(cli, &http, failure) == 0 &&
        get_json(http, path, "the list of jobs", &list, &more, failure) == 0) {
        print_list(cli, list, more);
        code = 0;
    }
    json_decref(list);
    http_free(http);
    free(path);
    return code;
}

/* ---- materials ----------------------------------------------------------------------------------- */

static const struct argp materials_argp = {
    .parser = parse,
    .children = cli_children,
    .doc = "Lists the fabrics the server knows by name; --json has every number and where it comes from.",
};

static double number(const json_t *object, const char *key)
{
    return json_number_value(json_object_get(object, key));
}

static void print_material(const json_t *m)
{
    const json_t *stretch = json_object_get(m, "stretch"), *bend = json_object_get(m, "bend");
    const char *name = json_string_value(json_object_get(m, "name"));
    name = name ? name : json_string_value(json_object_get(m, "preset"));
    printf("%-18s %7.1f %8.0f %8.0f %8.0f %10.2e %10.2e\n", name ? name : "?", 1000 * number(m, "density"),
           number(stretch, "weft"), number(stretch, "warp"), number(stretch, "shear"), number(bend, "weft"),
           number(bend, "warp"));
}

int command_materials(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli};
    struct http *http = NULL;
    json_t *answer = NULL;
    bool more = false;
    int code = -1;
    argp_parse(&materials_argp, argc, argv, 0, NULL, &arguments);
    if (cli_connect(cli, &http, failure) == 0 &&
        get_json(http, "/v1/materials", "the list of materials", &answer, &more, failure) == 0) {
        if (cli->json) {
            print_json(answer);
        } else {
            const json_t *list = json_is_array(answer) ? answer : json_object_get(answer, "materials");
            size_t i;
            json_t *material;
            printf("%-18s %7s %26s %21s\n", "", "g/m2", "stretch weft/warp/shear N/m", "bend weft/warp N m");
            json_array_foreach(list, i, material)
            {
                print_material(material);
            }
        }
        code = 0;
    }
    json_decref(answer);
    http_free(http);
    return code;
}
