/* command_picture.c - `drape picture`: draws a job's bodies with its cloth, draped or as it starts. */
#include "cli.h"

#include <stdlib.h>

#include "jobfile.h"
#include "textfile.h"

struct arguments {
    struct cli *cli;
    const char *job, *result, *output, *map;
};

static const struct argp_option options[] = {
    {"output", 'o', "PNG", 0, "Where the picture goes", 0},
    {"colour", 'c', "MAP", 0,
     "What the colours show: strain, pressure, gap or none (strain, where RESULT has it)", 0},
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
    case 'c':
        if (!picture_map_find(argument)) {
            argp_error(state, "there is no map \"%s\"", argument);
        }
        arguments->map = argument;
        return 0;
    case ARGP_KEY_ARG:
        if (arguments->result) {
            argp_error(state, "too many arguments");
        } else if (arguments->job) {
            arguments->result = argument;
        } else {
            arguments->job = argument;
        }
        return 0;
    case ARGP_KEY_END:
        if (!arguments->job || !arguments->output) {
            argp_error(state, "JOB and -o PNG are needed");
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .options = options,
    .parser = parse,
    .args_doc = "JOB [RESULT]",
    .children = cli_children,
    .doc = "Draws front, side and back of a drape beside each other, at one scale.\v"
           "JOB gives the bodies, RESULT (JSON or GLB, as `drape result` fetches them) the cloth; without "
           "RESULT the cloth is shown as it starts. A GLB of a job with \"fit\": true is drawn in colours "
           "from dark "
           "to light, and the values at their ends are printed.",
};

static int load(const struct arguments *arguments, struct picture *picture, struct failure *failure)
{
    char *text = NULL;
    size_t bytes = 0, skipped = 0;
    if (textfile_read(arguments->job, &text, &bytes, failure) < 0) {
        return -1;
    }
    int status = jobfile_parse(arguments->job, text, bytes, picture, &skipped, failure);
    free(text);
    if (status < 0 || !arguments->result) {
        return status;
    }
    if (skipped > 0 && !arguments->cli->quiet) {
        fprintf(stderr, "%zu bodies are given by reference and not shown\n", skipped);
    }
    if (textfile_read(arguments->result, &text, &bytes, failure) < 0) {
        return -1;
    }
    status = jobfile_set_result(arguments->result, text, bytes, arguments->map, picture, failure);
    free(text);
    return status;
}

int command_picture(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli};
    struct picture picture = {0};
    argp_parse(&argp, argc, argv, 0, NULL, &arguments);
    int status = load(&arguments, &picture, failure);
    if (status == 0) {
        status = picture_save(&picture, arguments.output, failure);
    }
    if (status == 0 && picture.map && !cli->quiet) {
        double range[2];
        picture_range(&picture, range);
        fprintf(stderr, "colours: %s from %.3g %s (dark) to %.3g %s (light)\n", picture.map->name,
                range[0] * picture.map->per_unit, picture.map->unit, range[1] * picture.map->per_unit,
                picture.map->unit);
    }
    picture_done(&picture);
    return status;
}
