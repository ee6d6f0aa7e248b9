/* command_scene.c - `drape scene`: turns a garment, its seams and a body into a job. */
#include "cli.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "objfile.h"
#include "scene.h"

enum { MAX_BODIES = 16, MAX_KEYFRAMES = 32, MAX_LINES = 64 };

/* FILE:SHAPE:STIFFNESS of an elastic or a fold. */
struct line_argument {
    char *file; /* cut off in the argument itself */
    double shape, stiffness;
};

struct arguments {
    struct cli *cli;
    const char *garment, *seams, *lines, *body[MAX_BODIES];
    size_t bodies;
    struct line_argument elastic[MAX_LINES], fold[MAX_LINES];
    size_t elastics, folds;
    const char *keyframe[MAX_KEYFRAMES];
    size_t keyframes;
    struct scene scene; /* only members without arrays are set while parsing */
};

enum {
    OPTION_TIME_STEP = 0x200,
    OPTION_TIME_LIMIT,
    OPTION_STOP_ON,
    OPTION_FRICTION,
    OPTION_OFFSET,
    OPTION_MOTION,
    OPTION_MOTION_SECONDS,
    OPTION_NAME,
    OPTION_ELASTIC,
    OPTION_FOLD,
    OPTION_SELF_CONTACT,
    OPTION_THICKNESS,
    OPTION_LINES,
    OPTION_FIT,
    OPTION_FROM
};

static const struct argp_option options[] = {
    {NULL, 0, NULL, 0, "What hangs on what:", 1},
    {"garment", 'g', "OBJ", 0, "The garment: v = where it starts, vt = flat rest shape in metres", 1},
    {"seams", 's', "FILE", 0, "Lines \"i j [stitch]\": vertices sewn together, counted from 1", 1},
    {"elastic", OPTION_ELASTIC, "FILE:FACTOR:N", 0,
     "A tape along the edges of FILE (lines \"i j\", counted from 1), FACTOR times as long as they are in "
     "the "
     "pattern, that pulls with N newtons per unit of elongation; may be given again",
     1},
    {"fold", OPTION_FOLD, "FILE:DEGREES:N", 0,
     "A crease along the edges of FILE, above 0 a mountain seen from the front, of N newton metres per "
     "radian "
     "and metre; may be given again",
     1},
    {"body", 'b', "OBJ", 0, "A body, closed, normals outwards; may be given again", 1},
    {"motion", OPTION_MOTION, "OBJ", 0, "A posture that the last body moves to, may be given again", 1},
    {"motion-seconds", OPTION_MOTION_SECONDS, "S", 0, "How long it moves", 1},
    {"material", 'm', "NAME", 0, "A fabric of `drape materials`", 1},
    {"name", OPTION_NAME, "TEXT", 0, "What to call the job (the garment's file name)", 1},
    {"friction", OPTION_FRICTION, "MU", 0, "Between cloth and bodies", 1},
    {"offset", OPTION_OFFSET, "M", 0, "Distance at which a body is felt (m)", 1},
    {"self-contact", OPTION_SELF_CONTACT, "auto|on|off", 0, "Whether cloth feels cloth", 1},
    {"thickness", OPTION_THICKNESS, "M", 0, "Distance at which cloth feels cloth (m)", 1},
    {"lines", OPTION_LINES, "FILE", 0, "Lines \"NAME i j k ...\": girths and lengths to be measured", 1},
    {"fit", OPTION_FIT, NULL, 0, "Measure strain, stress, pressure and gap", 1},
    {"from", OPTION_FROM, "ID", 0, "Begin at the drape of that job, which has as many vertices", 1},
    {NULL, 0, NULL, 0, "How to solve it (the server's defaults hold otherwise):", 2},
    {"method", 'M', "NAME", 0, "auto, stop-and-go, dynamic, ...", 2},
    {"stop-on", OPTION_STOP_ON, "potential|kinetic", 0, "When stop-and-go stops", 2},
    {"tolerance", 't', "R", 0, "At rest when the residual force is this part of the mean vertex weight", 2},
    {"max-iterations", 'i', "N", 0, "Give up after so many", 2},
    {"time-step", OPTION_TIME_STEP, "S", 0, "Seconds per iteration", 2},
    {"time-limit", OPTION_TIME_LIMIT, "S", 0, "Give up after so many seconds", 2},
    {0},
};

/* Splits FILE:SHAPE:STIFFNESS at its last two colons. */
static void parse_line(struct argp_state *state, const char *option, char *argument, double low, double high,
                       struct line_argument *line, size_t *lines)
{
    char *stiffness = strrchr(argument, ':'), *shape = NULL;
    if (stiffness) {
        *stiffness = '\0';
        shape = strrchr(argument, ':');
    }
    if (!shape || shape == argument) {
        argp_error(state, "--%s takes a file and two numbers, joined by colons", option);
        return;
    }
    if (*lines == MAX_LINES) {
        argp_error(state, "more than %d of --%s", MAX_LINES, option);
        return;
    }
    *shape = '\0';
    line[(*lines)++] = (struct line_argument){
        .file = argument,
        .shape = cli_number(state, option, shape + 1, low, high),
        .stiffness = cli_number(state, option, stiffness + 1, 1e-12, 1e12),
    };
}

static error_t parse_solver(int key, char *argument, struct argp_state *state, struct scene_solver *solver)
{
    switch (key) {
    case 'M':
        solver->method = argument;
        return 0;
    case OPTION_STOP_ON:
        solver->stop_on = argument;
        return 0;
    case 't':
        solver->tolerance = cli_number(state, "tolerance", argument, 1e-15, 1e6);
        return 0;
    case 'i':
        solver->max_iterations = cli_integer(state, "max-iterations", argument, 0, 1000000000);
        return 0;
    case OPTION_TIME_STEP:
        solver->time_step = cli_number(state, "time-step", argument, 1e-9, 1e6);
        return 0;
    case OPTION_TIME_LIMIT:
        solver->time_limit = cli_number(state, "time-limit", argument, 1e-3, 1e9);
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static void check_complete(const struct arguments *arguments, struct argp_state *state)
{
    if (!arguments->garment) {
        argp_error(state, "--garment is missing");
    }
    if (arguments->keyframes > 0 && arguments->bodies == 0) {
        argp_error(state, "--motion without a --body that moves");
    }
    if (!arguments->scene.material.preset) {
        argp_error(state, "--material is missing; `drape materials` lists them");
    }
}

static error_t parse(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    struct scene *scene = &arguments->scene;
    switch (key) {
    case ARGP_KEY_INIT:
        cli_init(state, arguments->cli);
        return 0;
    case 'g':
        arguments->garment = argument;
        return 0;
    case 's':
        arguments->seams = argument;
        return 0;
    case 'b':
        if (arguments->bodies == MAX_BODIES) {
            argp_error(state, "more than %d bodies", MAX_BODIES);
        }
        arguments->body[arguments->bodies++] = argument;
        return 0;
    case OPTION_MOTION:
        if (arguments->keyframes == MAX_KEYFRAMES) {
            argp_error(state, "more than %d postures", MAX_KEYFRAMES);
        }
        arguments->keyframe[arguments->keyframes++] = argument;
        return 0;
    case OPTION_MOTION_SECONDS:
        scene->motion_seconds = cli_number(state, "motion-seconds", argument, 1e-3, 1e4);
        return 0;
    case 'm':
        scene->material.preset = argument;
        return 0;
    case OPTION_NAME:
        scene->name = argument;
        return 0;
    case OPTION_ELASTIC:
        parse_line(state, "elastic", argument, 0.1, 2, arguments->elastic, &arguments->elastics);
        return 0;
    case OPTION_FOLD:
        parse_line(state, "fold", argument, -180, 180, arguments->fold, &arguments->folds);
        return 0;
    case OPTION_FRICTION:
        scene->body_friction = cli_number(state, "friction", argument, 0, 10);
        return 0;
    case OPTION_OFFSET:
        scene->body_offset = cli_number(state, "offset", argument, 1e-6, 1);
        return 0;
    case OPTION_SELF_CONTACT:
        scene->self_contact = argument;
        return 0;
    case OPTION_FROM:
        scene->start_from = argument;
        return 0;
    case OPTION_LINES:
        arguments->lines = argument;
        return 0;
    case OPTION_FIT:
        scene->fit = true;
        return 0;
    case OPTION_THICKNESS:
        scene->thickness = cli_number(state, "thickness", argument, 1e-6, 1);
        return 0;
    case ARGP_KEY_ARG:
        argp_error(state, "\"%s\" is not an option; files go with --garment, --seams and --body", argument);
        return 0;
    case ARGP_KEY_END:
        check_complete(arguments, state);
        return 0;
    default:
        return parse_solver(key, argument, state, &scene->solver);
    }
}

static const struct argp argp = {
    .options = options,
    .parser = parse,
    .children = cli_children,
    .doc =
        "Prints a job made of files, for `drape run`. Metres, y up.\v"
        "  drape scene -g shirt.obj -s shirt.seams -b body.obj -m cotton-poplin | drape run - -o shirt.glb",
};

/* The edges of each line from its file. */
static int read_lines(const struct line_argument *argument, size_t arguments, size_t vertices,
                      struct scene_edges **ret, size_t *ret_lines, struct failure *failure)
{
    *ret = arguments > 0 ? calloc(arguments, sizeof **ret) : NULL;
    if (arguments > 0 && !*ret) {
        return failure_no_memory(failure);
    }
    for (; *ret_lines < arguments; ++*ret_lines) {
        struct scene_edges *line = *ret + *ret_lines;
        line->shape = argument[*ret_lines].shape;
        line->stiffness = argument[*ret_lines].stiffness;
        if (objfile_read_seams(argument[*ret_lines].file, vertices, &line->edge, &line->edges, failure) < 0) {
            return -1;
        }
    }
    return 0;
}

static int read_files(const struct arguments *arguments, struct scene *scene, struct failure *failure)
{
    if (objfile_read(arguments->garment, true, &scene->cloth, failure) < 0) {
        return -1;
    }
    if (arguments->seams && objfile_read_seams(arguments->seams, scene->cloth.vertices, &scene->seam,
                                               &scene->seams, failure) < 0) {
        return -1;
    }
    if (arguments->lines && objfile_read_lines(arguments->lines, scene->cloth.vertices, &scene->line,
                                               &scene->lines, failure) < 0) {
        return -1;
    }
    if (read_lines(arguments->elastic, arguments->elastics, scene->cloth.vertices, &scene->elastic,
                   &scene->elastics, failure) < 0 ||
        read_lines(arguments->fold, arguments->folds, scene->cloth.vertices, &scene->fold, &scene->folds,
                   failure) < 0) {
        return -1;
    }
    scene->body = calloc(MAX_BODIES, sizeof *scene->body);
    scene->keyframe = calloc(MAX_KEYFRAMES, sizeof *scene->keyframe);
    if (!scene->body || !scene->keyframe) {
        return failure_no_memory(failure);
    }
    for (; scene->bodies < arguments->bodies; scene->bodies++) {
        if (objfile_read(arguments->body[scene->bodies], false, &scene->body[scene->bodies], failure) < 0) {
            return -1;
        }
    }
    for (; scene->keyframes < arguments->keyframes; scene->keyframes++) {
        if (objfile_read(arguments->keyframe[scene->keyframes], false, &scene->keyframe[scene->keyframes],
                         failure) < 0) {
            return -1;
        }
    }
    return 0;
}

int command_scene(struct cli *cli, int argc, char **argv, struct failure *failure)
{
    struct arguments arguments = {.cli = cli, .scene = scene_default()};
    argp_parse(&argp, argc, argv, 0, NULL, &arguments);
    struct scene *scene = &arguments.scene;
    if (!scene->name) {
        const char *slash = strrchr(arguments.garment, '/');
        scene->name = slash ? slash + 1 : arguments.garment;
    }
    int status = read_files(&arguments, scene, failure);
    if (status == 0 && scene_write(stdout, scene) < 0) {
        status = failure_set(failure, EXIT_LOCAL, "cannot write the job: %s", strerror(errno));
    }
    scene_done(scene);
    return status;
}
