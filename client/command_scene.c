/* command_scene.c - `drape scene`: turns garments, their seams and bodies into a job. */
#include "cli.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "objfile.h"
#include "place.h"
#include "scene.h"

enum { MAX_BODIES = 16, MAX_GARMENTS = SCENE_MAX_MATERIALS, MAX_KEYFRAMES = 32, MAX_LINES = 64 };

/* What was asked for one garment; NULL and 0: nothing. */
struct piece_of_clothing {
    const char *garment, *seams, *lines, *material;
    double scale, outwards;
};

/* FILE:SHAPE:STIFFNESS of an elastic or a fold. */
struct line_argument {
    size_t garment; /* that it is on */
    char *file;     /* cut off in the argument itself */
    double shape, stiffness;
};

struct arguments {
    struct cli *cli;
    struct piece_of_clothing worn[MAX_GARMENTS]; /* from the inside out, as given */
    const char *body[MAX_BODIES];
    size_t garments, bodies;
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
    OPTION_FROM,
    OPTION_SCALE,
    OPTION_OUTWARDS
};

static const struct argp_option options[] = {
    {NULL, 0, NULL, 0, "What hangs on what:", 1},
    {"garment", 'g', "OBJ", 0,
     "A garment: v = where it starts, vt = flat rest shape in metres; may be given again: layers", 1},
    {"seams", 's', "FILE", 0, "Lines \"i j [stitch]\": its vertices sewn together, counted from 1", 1},
    {"scale", OPTION_SCALE, "FACTOR", 0, "Its pattern and start so much larger", 1},
    {"outwards", OPTION_OUTWARDS, "M", 0, "Its pieces start so much farther out, each along its normal", 1},
    {"elastic", OPTION_ELASTIC, "FILE:FACTOR:N", 0,
     "A tape along its edges in FILE (lines \"i j\", counted from 1), FACTOR times as long as they are in "
     "the "
     "pattern, that pulls with N newtons per unit of elongation; may be given again",
     1},
    {"fold", OPTION_FOLD, "FILE:DEGREES:N", 0,
     "A crease along its edges in FILE, above 0 a mountain seen from the front, of N newton metres per "
     "radian "
     "and metre; may be given again",
     1},
    {"body", 'b', "OBJ", 0, "A body, closed, normals outwards; may be given again", 1},
    {"motion", OPTION_MOTION, "OBJ", 0, "A posture that the last body moves to, may be given again", 1},
    {"motion-seconds", OPTION_MOTION_SECONDS, "S", 0, "How long it moves", 1},
    {"material", 'm', "NAME", 0, "A fabric of `drape materials`, of this garment and those after it", 1},
    {"name", OPTION_NAME, "TEXT", 0, "What to call the job (the garment's file name)", 1},
    {"friction", OPTION_FRICTION, "MU", 0, "Between cloth and bodies", 1},
    {"offset", OPTION_OFFSET, "M", 0, "Distance at which a body is felt (m)", 1},
    {"self-contact", OPTION_SELF_CONTACT, "auto|on|off", 0, "Whether cloth feels cloth", 1},
    {"thickness", OPTION_THICKNESS, "M", 0, "Distance at which cloth feels cloth (m)", 1},
    {"lines", OPTION_LINES, "FILE", 0, "Lines \"NAME i j k ...\": its girths and lengths to be measured", 1},
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

/* The garment that an option speaks of: the last one, or, before any, the first. */
static size_t last_garment(const struct arguments *arguments)
{
    return arguments->garments > 0 ? arguments->garments - 1 : 0;
}

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
        .garment = last_garment(state->input),
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

/* Garments without a fabric have that of the one before; the first ones, that of the next that has any. */
static void share_materials(struct arguments *arguments)
{
    struct piece_of_clothing *worn = arguments->worn;
    for (size_t g = 1; g < arguments->garments; g++) {
        worn[g].material = worn[g].material ? worn[g].material : worn[g - 1].material;
    }
    for (size_t g = arguments->garments; g-- > 1;) {
        worn[g - 1].material = worn[g - 1].material ? worn[g - 1].material : worn[g].material;
    }
}

static void check_complete(struct arguments *arguments, struct argp_state *state)
{
    if (arguments->garments == 0) {
        argp_error(state, "--garment is missing");
    }
    if (arguments->keyframes > 0 && arguments->bodies == 0) {
        argp_error(state, "--motion without a --body that moves");
    }
    share_materials(arguments);
    if (!arguments->worn[0].material) {
        argp_error(state, "--material is missing; `drape materials` lists them");
    }
}

static void set_once(struct argp_state *state, const char *name, const char *value, const char **ret)
{
    if (*ret) {
        argp_error(state, "--%s is given twice for one garment: \"%s\" and \"%s\"", name, *ret, value);
    }
    *ret = value;
}

/* What belongs to one garment. */
static error_t parse_garment(int key, char *argument, struct argp_state *state)
{
    struct arguments *arguments = state->input;
    struct piece_of_clothing *worn = &arguments->worn[last_garment(arguments)];
    switch (key) {
    case 'g':
        if (arguments->garments == MAX_GARMENTS) {
            argp_error(state, "more than %d garments", MAX_GARMENTS);
        }
        arguments->worn[arguments->garments++].garment = argument;
        return 0;
    case 's':
        set_once(state, "seams", argument, &worn->seams);
        return 0;
    case 'm':
        set_once(state, "material", argument, &worn->material);
        return 0;
    case OPTION_LINES:
        set_once(state, "lines", argument, &worn->lines);
        return 0;
    case OPTION_ELASTIC:
        parse_line(state, "elastic", argument, 0.1, 2, arguments->elastic, &arguments->elastics);
        return 0;
    case OPTION_FOLD:
        parse_line(state, "fold", argument, -180, 180, arguments->fold, &arguments->folds);
        return 0;
    case OPTION_SCALE:
        worn->scale = cli_number(state, "scale", argument, 1e-3, 1e3);
        return 0;
    case OPTION_OUTWARDS:
        worn->outwards = cli_number(state, "outwards", argument, -10, 10);
        return 0;
    default:
        return parse_solver(key, argument, state, &arguments->scene.solver);
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
    case OPTION_NAME:
        scene->name = argument;
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
        return parse_garment(key, argument, state);
    }
}

static const struct argp argp = {
    .options = options,
    .parser = parse,
    .children = cli_children,
    .doc =
        "Prints a job made of files, for `drape run`. Metres, y up. --seams, --material, --lines, --elastic, "
        "--fold, --scale and --outwards speak of the garment before them (or of the first, if they come "
        "before it).\v"
        "  drape scene -g shirt.obj -s shirt.seams -b body.obj -m cotton-poplin | drape run - -o shirt.glb\n"
        "Layers are given from the inside out. The pieces of each must start outside of those before\n"
        "as they are once sewn:\n"
        "  drape scene -g shirt.obj -s shirt.seams -m silk \\\n"
        "    -g shirt.obj -s shirt.seams -m denim --scale 1.1 --outwards 0.1 -b body.obj",
};

/* Appends what `from` holds (count elements of `size` bytes) to *to, which has *held; frees `from`. */
static int append(void **to, size_t *held, void *from, size_t count, size_t size)
{
    void *longer = realloc(*to, (*held + count + 1) * size);
    if (longer) {
        memcpy((char *)longer + *held * size, from, count * size);
        *to = longer;
        *held += count;
    }
    free(from);
    return longer ? 0 : -1;
}

static int add_seams(const char *path, size_t vertices, size_t base, struct scene *scene,
                     struct failure *failure)
{
    uint32_t *seam = NULL;
    size_t seams = 0, held = 2 * scene->seams;
    if (objfile_read_seams(path, vertices, &seam, &seams, failure) < 0) {
        return -1;
    }
    for (size_t i = 0; i < 2 * seams; i++) {
        seam[i] += (uint32_t)base;
    }
    void *array = scene->seam;
    int status = append(&array, &held, seam, 2 * seams, sizeof *seam);
    scene->seam = array;
    scene->seams = held / 2;
    return status < 0 ? failure_no_memory(failure) : 0;
}

static int add_lines(const char *path, size_t vertices, size_t base, struct scene *scene,
                     struct failure *failure)
{
    struct objfile_line *line = NULL;
    size_t lines = 0;
    if (objfile_read_lines(path, vertices, &line, &lines, failure) < 0) {
        return -1;
    }
    for (size_t i = 0; i < lines; i++) {
        for (size_t k = 0; k < line[i].vertices; k++) {
            line[i].vertex[k] += (uint32_t)base;
        }
    }
    void *array = scene->line;
    int status = append(&array, &scene->lines, line, lines, sizeof *line);
    scene->line = array;
    return status < 0 ? failure_no_memory(failure) : 0;
}

/* The edges of each line that is on that garment, from its file, after the *ret_lines that `line` holds. */
static int add_edges(const struct line_argument *argument, size_t arguments, size_t garment, size_t vertices,
                     size_t base, struct scene_edges *line, size_t *ret_lines, struct failure *failure)
{
    for (size_t a = 0; a < arguments; a++) {
        if (argument[a].garment != garment) {
            continue;
        }
        struct scene_edges *to = line + *ret_lines;
        *to = (struct scene_edges){.shape = argument[a].shape, .stiffness = argument[a].stiffness};
        if (objfile_read_seams(argument[a].file, vertices, &to->edge, &to->edges, failure) < 0) {
            return -1;
        }
        ++*ret_lines;
        for (size_t i = 0; i < 2 * to->edges; i++) {
            to->edge[i] += (uint32_t)base;
        }
    }
    return 0;
}

/* The number of that fabric in the scene, which gets it unless it has it. */
static uint32_t find_material(const char *preset, struct scene *scene)
{
    size_t m = 0;
    while (m < scene->materials && strcmp(scene->material[m].preset, preset) != 0) {
        m++;
    }
    if (m == scene->materials) {
        scene->material[scene->materials++].preset = preset;
    }
    return (uint32_t)m;
}

/* Reads the mesh of one garment and puts it beside those that the scene has. */
static int add_mesh(const struct piece_of_clothing *worn, struct scene *scene, struct failure *failure)
{
    struct surface garment = {0};
    int status = 0;
    if (objfile_read(worn->garment, true, &garment, failure) < 0) {
        return -1;
    }
    if (worn->scale > 0) {
        place_scale(&garment, worn->scale);
    }
    if ((worn->outwards != 0 && place_outwards(&garment, worn->outwards) < 0) ||
        surface_append(&scene->cloth, &garment) < 0) {
        status = failure_no_memory(failure);
    }
    surface_done(&garment);
    return status;
}

/* Reads one garment with all that is on it. */
static int add_garment(const struct arguments *arguments, size_t g, struct scene *scene,
                       struct failure *failure)
{
    const struct piece_of_clothing *worn = &arguments->worn[g];
    size_t base = scene->cloth.vertices;
    if (add_mesh(worn, scene, failure) < 0) {
        return -1;
    }
    size_t vertices = scene->cloth.vertices - base;
    if ((worn->seams && add_seams(worn->seams, vertices, base, scene, failure) < 0) ||
        (worn->lines && add_lines(worn->lines, vertices, base, scene, failure) < 0) ||
        add_edges(arguments->elastic, arguments->elastics, g, vertices, base, scene->elastic,
                  &scene->elastics, failure) < 0) {
        return -1;
    }
    return add_edges(arguments->fold, arguments->folds, g, vertices, base, scene->fold, &scene->folds,
                     failure);
}

static int read_garments(const struct arguments *arguments, struct scene *scene, struct failure *failure)
{
    size_t end[MAX_GARMENTS];
    uint32_t material[MAX_GARMENTS];
    scene->materials = 0;
    for (size_t g = 0; g < arguments->garments; g++) {
        if (add_garment(arguments, g, scene, failure) < 0) {
            return -1;
        }
        end[g] = scene->cloth.triangles;
        material[g] = find_material(arguments->worn[g].material, scene);
    }
    if (scene->materials == 1) {
        return 0;
    }
    scene->triangle_material = malloc(scene->cloth.triangles * sizeof *scene->triangle_material);
    if (!scene->triangle_material) {
        return failure_no_memory(failure);
    }
    for (size_t g = 0, t = 0; g < arguments->garments; g++) {
        for (; t < end[g]; t++) {
            scene->triangle_material[t] = material[g];
        }
    }
    return 0;
}

static int read_files(const struct arguments *arguments, struct scene *scene, struct failure *failure)
{
    scene->elastic = calloc(MAX_LINES, sizeof *scene->elastic);
    scene->fold = calloc(MAX_LINES, sizeof *scene->fold);
    scene->body = calloc(MAX_BODIES, sizeof *scene->body);
    scene->keyframe = calloc(MAX_KEYFRAMES, sizeof *scene->keyframe);
    if (!scene->elastic || !scene->fold || !scene->body || !scene->keyframe) {
        return failure_no_memory(failure);
    }
    if (read_garments(arguments, scene, failure) < 0) {
        return -1;
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
        const char *slash = strrchr(arguments.worn[0].garment, '/');
        scene->name = slash ? slash + 1 : arguments.worn[0].garment;
    }
    int status = read_files(&arguments, scene, failure);
    if (status == 0 && scene_write(stdout, scene) < 0) {
        status = failure_set(failure, EXIT_LOCAL, "cannot write the job: %s", strerror(errno));
    }
    scene_done(scene);
    return status;
}
