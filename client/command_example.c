/* command_example.c - `drape example`: prints a generated job. */
#include "cli.h"

#include <errno.h>
#include <string.h>

#include "example.h"

struct arguments {
    struct cli *cli;
    const char *name;
    long triangles;
};

static const struct argp_option options[] = {
    {"triangles", 'n', "N", 0, "About how many triangles the cloth gets", 0},
    {0},
};

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        cli_init(state, arguments->cli);
        return 0;
    case 'n':
        arguments->triangles = cli_integer(state, "triangles", argument, 1, EXAMPLE_MAX_TRIANGLES);
        return 0;
    case ARGP_KEY_ARG:
        if (arguments->name) {
            argp_error(state, "one example at a time");
        }
        arguments->name = argument;
        return 0;
    case ARGP_KEY_END:
        if (!arguments->name) {
            argp_error(state, "which example? square, arc, skirt or garment");
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp argp = {
    .options = options,
    .parser = parse,
    .args_doc = "square|arc|skirt|garment",
    .children = cli_children,
    .doc =
        "Prints a complete job, generated on the spot, for `drape run`.\v"
        "  square   0.5 m square, level, held by one edge (5 000 triangles)\n"
        "  arc      level panel held along its half-circular upper edge of radius 0.25 m (5 000; the paper's "
        "wrinkle scene had about 19 000)\n"
        "  skirt    half annulus of radii 0.15 and 0.45 m, level, held along the inner arc (5 000)\n"
        "  garment  sleeveless dress of two flat panels, to be sewn round a mannequin (4 000)\n"
        "\n"
        "The first three have the cloth of Volino and Magnenat-Thalmann, Stop-and-go cloth draping (2007): "
        "0.1 kg/m2, 10 N/m, steps of 20 ms.",
};

int command_example(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli};
    struct scene scene;
    argp_parse(&argp, argc, argv, 0, NULL, &arguments);
    const struct example *example = example_find(arguments.name);
    if (!example) {
        return failure_set(failure, EXIT_USAGE,
                           "there is no example \"%s\"\ntry: square, arc, skirt or garment", arguments.name);
    }
    if (example_build(example, (size_t)arguments.triangles, &scene, failure) < 0) {
        return -1;
    }
    int status = scene_write(stdout, &scene);
    if (status < 0) {
        failure_set(failure, EXIT_LOCAL, "cannot write the job: %s", strerror(errno));
    }
    scene_done(&scene);
    return status;
}
