/* schema.c - job documents (JSON) to scene descriptions and options.
 *
 * Reading runs over the tree once, top down; each function reads one object, knows its JSON pointer and
 * ends at the first thing wrong. Absent members leave what was there: the defaults of the solver. What
 * the contract has and this version cannot do is refused at its place, never passed over. */
#include "schema.h"

#include "weld.h"

#include <float.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "job.h"
#include "materials.h"

/* Names of labels; their values may be as long as a job's name. */
#define MAX_LABEL_NAME 64
#define SHA256_DIGITS  64

struct reader {
    struct jsontext json;
    const struct limits *limits;
    schema_mesh_fn *load_mesh;
    void *data;
    struct job_spec *spec;
    struct problem *problem;
};

struct range {
    double min, max;
    const char *text;
};

static const struct range POSITIVE = {DBL_MIN, DBL_MAX, "must be > 0"};
/* A vertex in free fall is out of balance by its weight: no larger tolerance tells rest from motion. */
static const struct range TOLERANCE = {DBL_MIN, 1, "must be > 0 and at most 1"};
static const struct range NOT_NEGATIVE = {0, DBL_MAX, "must be >= 0"};
static const struct range FRICTION = {0, DRAPE_MAX_FRICTION, "must be between 0 and 10"};
/* Whose limits the solver knows. */
static const struct range ANY = {-DBL_MAX, DBL_MAX, ""};

/* ---- members of an object ------------------------------------------------------------------- */

__attribute__((format(printf, 5, 6))) static int refuse(struct reader *r, enum problem_code code,
                                                        const char *pointer, const char *member,
                                                        const char *format, ...)
{
    char at[JSONTEXT_POINTER_BYTES], detail[200];
    va_list list;
    va_start(list, format);
    vsnprintf(detail, sizeof detail, format, list);
    va_end(list);
    jsontext_pointer(at, sizeof at, pointer, member);
    return problem_at(r->problem, code, at, "%s", detail);
}

static int out_of_memory(struct reader *r)
{
    return problem_set(r->problem, PROBLEM_INTERNAL, "out of memory");
}

static int check_object(struct reader *r, const json_t *object, const char *pointer, const char *const *known)
{
    if (!json_is_object(object))
        return problem_at(r->problem, PROBLEM_INVALID, pointer, "must be an object");
    return jsontext_check_members(object, pointer, known, r->problem);
}

static int get_number(struct reader *r, const json_t *object, const char *pointer, const char *member,
                      const struct range *range, double *ret)
{
    const json_t *value = json_object_get(object, member);
    if (!value)
        return 0;
    if (!json_is_number(value))
        return refuse(r, PROBLEM_INVALID, pointer, member, "must be a number");
    double number = json_number_value(value);
    if (!(number >= range->min && number <= range->max))
        return refuse(r, PROBLEM_INVALID, pointer, member, "%s", range->text);
    *ret = number;
    return 0;
}

static int get_vector(struct reader *r, const json_t *object, const char *pointer, const char *member,
                      bool required, double *ret)
{
    char at[JSONTEXT_POINTER_BYTES];
    struct numbers numbers;
    const json_t *value = json_object_get(object, member);
    if (!value)
        return required ? refuse(r, PROBLEM_INVALID, pointer, member, "is missing") : 0;
    jsontext_pointer(at, sizeof at, pointer, member);
    if (jsontext_get_numbers(&r->json, value, at, &numbers, r->problem))
        return -1;
    if (numbers.count != 3)
        return problem_at(r->problem, PROBLEM_INVALID, at, "must have three numbers");
    memcpy(ret, numbers.value, 3 * sizeof *ret);
    return 0;
}

/* Indices below `bound`, a multiple of `stride` of them; absent or empty leaves *ret NULL. */
static int get_indices(struct reader *r, const json_t *object, const char *pointer, const char *member,
                       size_t stride, size_t bound, uint32_t **ret, size_t *ret_count)
{
    char at[JSONTEXT_POINTER_BYTES];
    struct numbers numbers;
    const json_t *value = json_object_get(object, member);
    if (!value)
        return 0;
    jsontext_pointer(at, sizeof at, pointer, member);
    if (jsontext_get_numbers(&r->json, value, at, &numbers, r->problem))
        return -1;
    if (numbers.count % stride != 0)
        return problem_at(r->problem, PROBLEM_INVALID, at, "has an odd number of vertices: these are pairs");
    if (numbers.count == 0)
        return 0;
    *ret = malloc(numbers.count * sizeof **ret);
    if (!*ret)
        return out_of_memory(r);
    *ret_count = numbers.count / stride;
    return jsontext_indices(numbers, bound, at, *ret, r->problem);
}

/* A word of the contract, and what it means here. */
struct choice {
    const char *name;
    int value;
};

static int get_choice(struct reader *r, const json_t *object, const char *pointer, const char *member,
                      const struct choice *choice, size_t choices, int *ret)
{
    char names[128] = "";
    const json_t *value = json_object_get(object, member);
    if (!value)
        return 0;
    for (size_t i = 0; i < choices; i++) {
        if (json_is_string(value) && strcmp(json_string_value(value), choice[i].name) == 0) {
            *ret = choice[i].value;
            return 0;
        }
        size_t n = strlen(names);
        snprintf(names + n, sizeof names - n, "%s%s", n > 0 ? ", " : "", choice[i].name);
    }
    return refuse(r, PROBLEM_INVALID, pointer, member, "must be one of: %s", names);
}

static int read_boolean(struct reader *r, const json_t *object, const char *pointer, const char *member,
                        bool *ret)
{
    const json_t *value = json_object_get(object, member);
    if (value && !json_is_boolean(value))
        return refuse(r, PROBLEM_INVALID, pointer, member, "must be true or false");
    *ret = value ? json_is_true(value) : *ret;
    return 0;
}

/* Like get_number; absent is refused. */
static int require_number(struct reader *r, const json_t *object, const char *pointer, const char *member,
                          const struct range *range, double *ret)
{
    if (!json_object_get(object, member))
        return refuse(r, PROBLEM_INVALID, pointer, member, "is missing");
    return get_number(r, object, pointer, member, range, ret);
}

/* An index; whether there is such a thing is for drape_scene_check to say. */
static int require_index(struct reader *r, const json_t *object, const char *pointer, const char *member,
                         uint32_t *ret)
{
    double value = 0;
    if (require_number(r, object, pointer, member, &ANY, &value))
        return -1;
    if (!(value >= 0 && value < UINT32_MAX && value == floor(value)))
        return refuse(r, PROBLEM_INVALID, pointer, member, "must be an integer from 0 on");
    *ret = (uint32_t)value;
    return 0;
}

static void element_pointer(char *ret, size_t size, const char *array, size_t i)
{
    char index[24];
    snprintf(index, sizeof index, "%zu", i);
    jsontext_pointer(ret, size, array, index);
}

/* ---- the job it starts from ------------------------------------------------------------------- */

static int read_start_from(struct reader *r, const json_t *root)
{
    const json_t *id = json_object_get(root, "start_from");
    if (!id)
        return 0;
    if (!json_is_string(id) || !id_valid(json_string_value(id)))
        return refuse(r, PROBLEM_INVALID, "", "start_from", "must be the id of a job");
    memcpy(r->spec->start_from, json_string_value(id), ID_SIZE);
    return 0;
}

/* ---- name and labels -------------------------------------------------------------------------- */

static int read_name(struct reader *r, const json_t *root)
{
    const json_t *name = json_object_get(root, "name");
    if (!name)
        return 0;
    size_t bytes = json_string_length(name);
    if (!json_is_string(name))
        return refuse(r, PROBLEM_INVALID, "", "name", "must be a string");
    if (bytes > r->limits->name_bytes || bytes >= sizeof r->spec->name)
        return refuse(r, PROBLEM_INVALID, "", "name", "has %zu bytes, the limit is %zu", bytes,
                      r->limits->name_bytes);
    memcpy(r->spec->name, json_string_value(name), bytes + 1);
    return 0;
}

static int read_labels(struct reader *r, json_t *root)
{
    json_t *labels = json_object_get(root, "labels");
    const char *name;
    json_t *value;
    if (!labels)
        return 0;
    if (!json_is_object(labels))
        return refuse(r, PROBLEM_INVALID, "", "labels", "must be an object of strings");
    if (json_object_size(labels) > r->limits->labels)
        return refuse(r, PROBLEM_INVALID, "", "labels", "%zu, the limit is %zu", json_object_size(labels),
                      r->limits->labels);
    json_object_foreach(labels, name, value)
    {
        if (strlen(name) > MAX_LABEL_NAME)
            return refuse(r, PROBLEM_INVALID, "/labels", name, "a name longer than %d bytes", MAX_LABEL_NAME);
        if (!json_is_string(value) || json_string_length(value) > r->limits->name_bytes)
            return refuse(r, PROBLEM_INVALID, "/labels", name, "must be a string of at most %zu bytes",
                          r->limits->name_bytes);
    }
    r->spec->labels = json_incref(labels);
    return 0;
}

/* ---- meshes ----------------------------------------------------------------------------------- */

static bool is_sha256(const char *text)
{
    return text && strlen(text) == SHA256_DIGITS && strspn(text, "0123456789abcdef") == SHA256_DIGITS;
}

static int load_ref(struct reader *r, const json_t *object, const char *pointer, struct mesh *ret)
{
    static const char *const MEMBERS[] = {"ref", NULL};
    const char *ref = json_string_value(json_object_get(object, "ref"));
    struct problem problem;
    if (jsontext_check_members(object, pointer, MEMBERS, r->problem))
        return -1;
    if (!is_sha256(ref))
        return refuse(r, PROBLEM_INVALID, pointer, "ref", "must be a SHA-256 in 64 lower-case hex digits");
    if (!r->load_mesh)
        return refuse(r, PROBLEM_INVALID, pointer, "ref", "there are no uploaded meshes here");
    if (r->load_mesh(ref, ret, &problem, r->data) == 0)
        return 0;
    if (problem.code == PROBLEM_NOT_FOUND)
        return refuse(r, PROBLEM_INVALID, pointer, "ref", "no mesh with this SHA-256 has been uploaded");
    return refuse(r, problem.code, pointer, "ref", "%.190s", problem.detail);
}

/* {positions, triangles, pattern} or {ref}, at member "mesh" of the object at `pointer`. */
static int read_mesh(struct reader *r, const json_t *object, const char *pointer, struct mesh *ret)
{
    char at[JSONTEXT_POINTER_BYTES];
    const json_t *mesh = json_object_get(object, "mesh");
    jsontext_pointer(at, sizeof at, pointer, "mesh");
    if (!json_is_object(mesh))
        return problem_at(r->problem, PROBLEM_INVALID, at, mesh ? "must be an object" : "is missing");
    if (json_object_get(mesh, "ref"))
        return load_ref(r, mesh, at, ret);
    return meshfile_from_json(&r->json, mesh, at, r->limits, ret, r->problem);
}

/* ---- materials -------------------------------------------------------------------------------- */

/* Members not given are NAN until fill_material(). */
static const drape_material UNKNOWN = {.density = NAN,
                                       .stretch_weft = NAN,
                                       .stretch_warp = NAN,
                                       .stretch_shear = NAN,
                                       .poisson = NAN,
                                       .bend_weft = NAN,
                                       .bend_warp = NAN,
                                       .bend_twist = NAN};

static int read_preset(struct reader *r, const json_t *object, const char *pointer, drape_material *ret)
{
    const json_t *name = json_object_get(object, "preset");
    if (!name)
        return 0;
    const struct material_preset *preset =
        json_is_string(name) ? materials_find(json_string_value(name)) : NULL;
    if (!preset)
        return refuse(r, PROBLEM_INVALID, pointer, "preset", "is none of the presets at /v1/materials");
    *ret = preset->material;
    return 0;
}

/* The points of a strain-stress curve: pairs of a strain and a stress in N/m. Whether they make a curve
 * is for drape_scene_check to say. */
static int read_curve(struct reader *r, const json_t *array, const char *pointer, double **points,
                      drape_curve *ret)
{
    size_t n = json_array_size(array);
    struct numbers pair;
    char at[JSONTEXT_POINTER_BYTES];
    if (n == 0)
        return problem_at(r->problem, PROBLEM_INVALID, pointer, "a curve needs at least one point");
    if (n > DRAPE_MAX_CURVE_POINTS)
        return problem_at(r->problem, PROBLEM_TOO_LARGE, pointer, "%zu points, the limit is %d", n,
                          DRAPE_MAX_CURVE_POINTS);
    *points = malloc(2 * n * sizeof **points);
    if (!*points)
        return out_of_memory(r);
    for (size_t i = 0; i < n; i++) {
        element_pointer(at, sizeof at, pointer, i);
        if (jsontext_get_numbers(&r->json, json_array_get(array, i), at, &pair, r->problem))
            return -1;
        if (pair.count != 2)
            return problem_at(r->problem, PROBLEM_INVALID, at, "must be a strain and a stress in N/m");
        memcpy(*points + 2 * i, pair.value, 2 * sizeof **points);
    }
    ret->points = n;
    ret->point = *points;
    return 0;
}

/* A number (N/m) or a strain-stress curve. Of a curve, *ret becomes the slope of its first step, which
 * stands for the cloth where a default asks for one number. */
static int get_stiffness(struct reader *r, const json_t *object, const char *pointer, const char *member,
                         double **points, drape_curve *ret_curve, double *ret)
{
    const json_t *value = json_object_get(object, member);
    char at[JSONTEXT_POINTER_BYTES];
    if (!json_is_array(value))
        return get_number(r, object, pointer, member, &POSITIVE, ret);
    jsontext_pointer(at, sizeof at, pointer, member);
    if (read_curve(r, value, at, points, ret_curve))
        return -1;
    const double *p = ret_curve->point;
    if (p[0] == 0 && ret_curve->points > 1)
        p += 2;
    *ret = p[1] / p[0];
    return 0;
}

static int read_stretch(struct reader *r, const json_t *object, const char *pointer, double **points,
                        drape_material *ret)
{
    static const char *const MEMBERS[] = {"weft", "warp", "shear", NULL};
    char at[JSONTEXT_POINTER_BYTES];
    const json_t *stretch = json_object_get(object, "stretch");
    if (!stretch)
        return 0;
    jsontext_pointer(at, sizeof at, pointer, "stretch");
    if (check_object(r, stretch, at, MEMBERS) ||
        get_stiffness(r, stretch, at, "weft", points, &ret->curve_weft, &ret->stretch_weft) ||
        get_stiffness(r, stretch, at, "warp", points + 1, &ret->curve_warp, &ret->stretch_warp))
        return -1;
    return get_stiffness(r, stretch, at, "shear", points + 2, &ret->curve_shear, &ret->stretch_shear);
}

/* One number B stands for an isotropic plate; it replaces all three of a preset. */
static int read_bend(struct reader *r, const json_t *object, const char *pointer, drape_material *ret)
{
    static const char *const MEMBERS[] = {"weft", "warp", "twist", NULL};
    char at[JSONTEXT_POINTER_BYTES];
    const json_t *bend = json_object_get(object, "bend");
    if (json_is_number(bend)) {
        ret->bend_twist = NAN;
        if (get_number(r, object, pointer, "bend", &NOT_NEGATIVE, &ret->bend_weft))
            return -1;
        ret->bend_warp = ret->bend_weft;
        return 0;
    }
    if (!bend)
        return 0;
    jsontext_pointer(at, sizeof at, pointer, "bend");
    if (!json_is_object(bend))
        return problem_at(r->problem, PROBLEM_INVALID, at, "must be a number or an object");
    if (check_object(r, bend, at, MEMBERS) ||
        get_number(r, bend, at, "weft", &NOT_NEGATIVE, &ret->bend_weft) ||
        get_number(r, bend, at, "warp", &NOT_NEGATIVE, &ret->bend_warp))
        return -1;
    return get_number(r, bend, at, "twist", &NOT_NEGATIVE, &ret->bend_twist);
}

static int read_shrink(struct reader *r, const json_t *object, const char *pointer, drape_material *ret)
{
    static const char *const MEMBERS[] = {"weft", "warp", NULL};
    char at[JSONTEXT_POINTER_BYTES];
    const json_t *shrink = json_object_get(object, "shrink");
    if (!shrink)
        return 0;
    jsontext_pointer(at, sizeof at, pointer, "shrink");
    if (check_object(r, shrink, at, MEMBERS) || get_number(r, shrink, at, "weft", &ANY, &ret->shrink_weft))
        return -1;
    return get_number(r, shrink, at, "warp", &ANY, &ret->shrink_warp);
}

/* Defaults of what was not given, and a refusal of what has none. Isotropic cloth of modulus E and
 * Poisson ratio nu has the shear modulus E / (2 (1 + nu)); a plate of rigidity B without Poisson effect
 * the twisting rigidity B / 2. For different weft and warp, their means are put in. */
static int fill_material(struct reader *r, const char *pointer, drape_material *m)
{
    const struct {
        const char *member;
        double value;
    } required[] = {{"density", m->density},
                    {"stretch/weft", m->curve_weft.points ? 0 : m->stretch_weft},
                    {"stretch/warp", m->curve_warp.points ? 0 : m->stretch_warp},
                    {"bend/weft", m->bend_weft},
                    {"bend/warp", m->bend_warp}};
    for (size_t i = 0; i < sizeof required / sizeof *required; i++)
        if (isnan(required[i].value)) {
            char at[JSONTEXT_POINTER_BYTES];
            snprintf(at, sizeof at, "%.90s/%s", pointer, required[i].member);
            return problem_at(r->problem, PROBLEM_INVALID, at, "is missing, and no preset gives it");
        }
    if (isnan(m->poisson))
        m->poisson = 0;
    if (isnan(m->stretch_shear) && !m->curve_shear.points)
        m->stretch_shear = (m->stretch_weft + m->stretch_warp) / (4 * (1 + m->poisson));
    if (isnan(m->bend_twist))
        m->bend_twist = (m->bend_weft + m->bend_warp) / 4;
    return 0;
}

static int read_material(struct reader *r, const json_t *object, const char *pointer, double **points,
                         drape_material *ret)
{
    static const char *const MEMBERS[] = {"preset", "density",  "stretch", "poisson",
                                          "bend",   "friction", "shrink",  NULL};
    static const struct range POISSON = {-1 + DBL_EPSILON, 1 - DBL_EPSILON, "must be between -1 and 1"};
    *ret = UNKNOWN;
    if (check_object(r, object, pointer, MEMBERS) || read_preset(r, object, pointer, ret) ||
        get_number(r, object, pointer, "density", &POSITIVE, &ret->density) ||
        get_number(r, object, pointer, "poisson", &POISSON, &ret->poisson) ||
        get_number(r, object, pointer, "friction", &FRICTION, &ret->friction) ||
        read_stretch(r, object, pointer, points, ret) || read_bend(r, object, pointer, ret) ||
        read_shrink(r, object, pointer, ret))
        return -1;
    return fill_material(r, pointer, ret);
}

static int read_materials(struct reader *r, const json_t *cloth)
{
    struct job_spec *spec = r->spec;
    const json_t *array = json_object_get(cloth, "materials");
    size_t n = json_array_size(array);
    char at[JSONTEXT_POINTER_BYTES];
    if (n == 0)
        return refuse(r, PROBLEM_INVALID, "/cloth", "materials", "must be an array of at least one material");
    if (n > r->limits->materials)
        return refuse(r, PROBLEM_TOO_LARGE, "/cloth", "materials", "%zu, the limit is %zu", n,
                      r->limits->materials);
    spec->material = calloc(n, sizeof *spec->material);
    spec->curve = calloc(3 * n, sizeof *spec->curve);
    if (!spec->material || !spec->curve)
        return out_of_memory(r);
    spec->scene.materials = n;
    for (size_t i = 0; i < n; i++) {
        element_pointer(at, sizeof at, "/cloth/materials", i);
        if (read_material(r, json_array_get(array, i), at, spec->curve + 3 * i, &spec->material[i]))
            return -1;
    }
    return 0;
}

/* ---- elastics, folds and tacks ---------------------------------------------------------------- */

/* How long the array in member `name` of the cloth is; 0 when absent. */
static int count_array(struct reader *r, const json_t *cloth, const char *name, size_t most, size_t *ret)
{
    const json_t *array = json_object_get(cloth, name);
    size_t n = json_array_size(array);
    if (array && !json_is_array(array))
        return refuse(r, PROBLEM_INVALID, "/cloth", name, "must be an array");
    if (n > most)
        return refuse(r, PROBLEM_TOO_LARGE, "/cloth", name, "%zu, the limit is %zu", n, most);
    *ret = n;
    return 0;
}

/* The vertex pairs of an elastic or a fold; *ret owns them, *ret_lent borrows them. */
static int get_edges(struct reader *r, const json_t *object, const char *pointer, uint32_t **ret,
                     const uint32_t **ret_lent, size_t *ret_count)
{
    if (!json_object_get(object, "edges"))
        return refuse(r, PROBLEM_INVALID, pointer, "edges", "is missing");
    int rc = get_indices(r, object, pointer, "edges", 2, r->spec->cloth.vertices, ret, ret_count);
    *ret_lent = *ret;
    return rc;
}

static int read_elastics(struct reader *r, const json_t *cloth)
{
    static const char *const MEMBERS[] = {"edges", "factor", "stiffness", NULL};
    struct job_spec *spec = r->spec;
    const json_t *array = json_object_get(cloth, "elastics");
    char at[JSONTEXT_POINTER_BYTES];
    size_t n = 0;
    if (count_array(r, cloth, "elastics", DRAPE_MAX_LINES, &n))
        return -1;
    if (n == 0)
        return 0;
    spec->elastic = calloc(n, sizeof *spec->elastic);
    spec->elastic_edge = calloc(n, sizeof(uint32_t *));
    if (!spec->elastic || !spec->elastic_edge)
        return out_of_memory(r);
    spec->scene.elastics = n;
    for (size_t i = 0; i < spec->scene.elastics; i++) {
        const json_t *object = json_array_get(array, i);
        drape_elastic *elastic = spec->elastic + i;
        element_pointer(at, sizeof at, "/cloth/elastics", i);
        if (check_object(r, object, at, MEMBERS) ||
            get_edges(r, object, at, spec->elastic_edge + i, &elastic->edge, &elastic->edges) ||
            require_number(r, object, at, "factor", &ANY, &elastic->factor) ||
            require_number(r, object, at, "stiffness", &POSITIVE, &elastic->stiffness))
            return -1;
    }
    return 0;
}

static int read_folds(struct reader *r, const json_t *cloth)
{
    static const char *const MEMBERS[] = {"edges", "angle", "stiffness", NULL};
    static const struct range ANGLE = {-180, 180, "must be between -180 and 180 degrees"};
    struct job_spec *spec = r->spec;
    const json_t *array = json_object_get(cloth, "folds");
    char at[JSONTEXT_POINTER_BYTES];
    size_t n = 0;
    if (count_array(r, cloth, "folds", DRAPE_MAX_LINES, &n))
        return -1;
    if (n == 0)
        return 0;
    spec->fold = calloc(n, sizeof *spec->fold);
    spec->fold_edge = calloc(n, sizeof(uint32_t *));
    if (!spec->fold || !spec->fold_edge)
        return out_of_memory(r);
    spec->scene.folds = n;
    for (size_t i = 0; i < spec->scene.folds; i++) {
        const json_t *object = json_array_get(array, i);
        drape_fold *fold = spec->fold + i;
        element_pointer(at, sizeof at, "/cloth/folds", i);
        if (check_object(r, object, at, MEMBERS) ||
            get_edges(r, object, at, spec->fold_edge + i, &fold->edge, &fold->edges) ||
            require_number(r, object, at, "angle", &ANGLE, &fold->angle) ||
            require_number(r, object, at, "stiffness", &POSITIVE, &fold->stiffness))
            return -1;
        fold->angle *= M_PI / 180;
    }
    return 0;
}

/* A point of space, or of a triangle of the body. */
static int read_hold(struct reader *r, const json_t *object, const char *pointer, drape_tack *ret)
{
    char at[JSONTEXT_POINTER_BYTES];
    struct numbers numbers;
    bool point = json_object_get(object, "point");
    if (point == (json_object_get(object, "triangle") != NULL))
        return problem_at(r->problem, PROBLEM_INVALID, pointer, "needs either point or triangle");
    if (point && json_object_get(object, "barycentric"))
        return refuse(r, PROBLEM_INVALID, pointer, "barycentric", "goes with a triangle, not with a point");
    ret->triangle = DRAPE_NO_TRIANGLE;
    if (point)
        return get_vector(r, object, pointer, "point", true, ret->point);
    if (!json_object_get(object, "barycentric"))
        return refuse(r, PROBLEM_INVALID, pointer, "barycentric", "is missing");
    jsontext_pointer(at, sizeof at, pointer, "barycentric");
    if (require_index(r, object, pointer, "triangle", &ret->triangle) ||
        jsontext_get_numbers(&r->json, json_object_get(object, "barycentric"), at, &numbers, r->problem))
        return -1;
    if (numbers.count != 2)
        return problem_at(r->problem, PROBLEM_INVALID, at, "must have two numbers");
    memcpy(ret->barycentric, numbers.value, sizeof ret->barycentric);
    return 0;
}

static int read_tacks(struct reader *r, const json_t *cloth)
{
    static const char *const MEMBERS[] = {"vertex", "body", "point", "triangle", "barycentric", NULL};
    struct job_spec *spec = r->spec;
    const json_t *array = json_object_get(cloth, "tacks");
    char at[JSONTEXT_POINTER_BYTES];
    size_t n = 0;
    if (count_array(r, cloth, "tacks", DRAPE_MAX_VERTICES, &n))
        return -1;
    if (n == 0)
        return 0;
    spec->tack = calloc(n, sizeof *spec->tack);
    if (!spec->tack)
        return out_of_memory(r);
    spec->scene.tacks = n;
    for (size_t i = 0; i < spec->scene.tacks; i++) {
        const json_t *object = json_array_get(array, i);
        element_pointer(at, sizeof at, "/cloth/tacks", i);
        if (check_object(r, object, at, MEMBERS) ||
            require_index(r, object, at, "vertex", &spec->tack[i].vertex) ||
            require_index(r, object, at, "body", &spec->tack[i].body) ||
            read_hold(r, object, at, spec->tack + i))
            return -1;
    }
    return 0;
}

/* ---- cloth ------------------------------------------------------------------------------------ */

static int read_triangle_material(struct reader *r, const json_t *cloth)
{
    struct job_spec *spec = r->spec;
    size_t count = spec->cloth.triangles;
    if (get_indices(r, cloth, "/cloth", "triangle_material", 1, spec->scene.materials,
                    &spec->triangle_material, &count))
        return -1;
    if (spec->triangle_material && count != spec->cloth.triangles)
        return refuse(r, PROBLEM_INVALID, "/cloth", "triangle_material",
                      "has %zu entries where the mesh has %zu triangles", count, spec->cloth.triangles);
    return 0;
}

static int read_cloth(struct reader *r, const json_t *root)
{
    static const char *const MEMBERS[] = {"mesh",      "seams",    "pins",  "materials", "triangle_material",
                                          "thickness", "elastics", "folds", "tacks",     NULL};
    struct job_spec *spec = r->spec;
    const json_t *cloth = json_object_get(root, "cloth");
    if (!cloth)
        return refuse(r, PROBLEM_INVALID, "", "cloth", "is missing");
    if (check_object(r, cloth, "/cloth", MEMBERS) || read_mesh(r, cloth, "/cloth", &spec->cloth))
        return -1;
    if (!spec->cloth.pattern)
        return refuse(r, PROBLEM_INVALID, "/cloth", "mesh", "has no pattern: the flat rest shape is needed");
    size_t vertices = spec->cloth.vertices;
    if (get_indices(r, cloth, "/cloth", "seams", 2, vertices, &spec->seam, &spec->scene.seams) ||
        get_indices(r, cloth, "/cloth", "pins", 1, vertices, &spec->pin, &spec->scene.pins) ||
        read_materials(r, cloth) || read_triangle_material(r, cloth) || read_elastics(r, cloth) ||
        read_folds(r, cloth) || read_tacks(r, cloth))
        return -1;
    return get_number(r, cloth, "/cloth", "thickness", &ANY, &spec->scene.thickness);
}

/* ---- lines to be measured --------------------------------------------------------------------- */

static int read_line_name(struct reader *r, const json_t *object, const char *pointer, char **ret)
{
    const json_t *name = json_object_get(object, "name");
    size_t bytes = json_string_length(name);
    if (!json_is_string(name) || bytes == 0 || bytes > r->limits->name_bytes)
        return refuse(r, PROBLEM_INVALID, pointer, "name", "must be a string of 1 to %zu bytes",
                      r->limits->name_bytes);
    *ret = strdup(json_string_value(name));
    return *ret ? 0 : out_of_memory(r);
}

static int read_line(struct reader *r, const json_t *object, const char *pointer, size_t *room,
                     struct line *ret)
{
    static const char *const MEMBERS[] = {"name", "vertices", "closed", NULL};
    if (check_object(r, object, pointer, MEMBERS) || read_line_name(r, object, pointer, &ret->name) ||
        read_boolean(r, object, pointer, "closed", &ret->closed) ||
        get_indices(r, object, pointer, "vertices", 1, r->spec->cloth.vertices, &ret->vertex, &ret->vertices))
        return -1;
    if (ret->vertices < 2)
        return refuse(r, PROBLEM_INVALID, pointer, "vertices", "must be at least two vertices");
    if (ret->vertices > *room)
        return refuse(r, PROBLEM_TOO_LARGE, pointer, "vertices", "all lines together have more than %zu",
                      r->limits->line_vertices);
    *room -= ret->vertices;
    return 0;
}

static int read_lines(struct reader *r, const json_t *root)
{
    const json_t *array = json_object_get(root, "lines");
    size_t n = json_array_size(array), room = r->limits->line_vertices;
    char at[JSONTEXT_POINTER_BYTES];
    if (array && !json_is_array(array))
        return refuse(r, PROBLEM_INVALID, "", "lines", "must be an array");
    if (n > r->limits->lines)
        return refuse(r, PROBLEM_TOO_LARGE, "", "lines", "%zu, the limit is %zu", n, r->limits->lines);
    if (n == 0)
        return 0;
    r->spec->lines = lines_new(n);
    if (!r->spec->lines)
        return out_of_memory(r);
    for (size_t i = 0; i < n; i++) {
        element_pointer(at, sizeof at, "/lines", i);
        if (read_line(r, json_array_get(array, i), at, &room, &r->spec->lines->line[i]))
            return -1;
    }
    return 0;
}

/* In a scene that has been checked. */
static int join_lines(struct reader *r)
{
    size_t line = 0, at = 0;
    char pointer[JSONTEXT_POINTER_BYTES];
    int rc = r->spec->lines ? lines_join(r->spec->lines, &r->spec->scene, &line, &at) : 0;
    if (rc < 0)
        return out_of_memory(r);
    if (rc != LINES_APART)
        return 0;
    const struct line *of = &r->spec->lines->line[line];
    snprintf(pointer, sizeof pointer, "/lines/%zu/vertices/%zu", line, at);
    return problem_at(r->problem, PROBLEM_INVALID, pointer,
                      "vertices %u and %u are in pieces apart, and neither is sewn to the other's",
                      of->vertex[at], of->vertex[(at + 1) % of->vertices]);
}

/* ---- bodies ----------------------------------------------------------------------------------- */

static int get_radius(struct reader *r, const json_t *object, const char *pointer, double *ret)
{
    if (!json_object_get(object, "radius"))
        return refuse(r, PROBLEM_INVALID, pointer, "radius", "is missing");
    return get_number(r, object, pointer, "radius", &POSITIVE, ret);
}

static int read_sphere(struct reader *r, const json_t *sphere, const char *pointer, drape_body *ret)
{
    static const char *const MEMBERS[] = {"center", "radius", NULL};
    if (check_object(r, sphere, pointer, MEMBERS) ||
        get_vector(r, sphere, pointer, "center", true, ret->point))
        return -1;
    return get_radius(r, sphere, pointer, &ret->radius);
}

static int read_plane(struct reader *r, const json_t *plane, const char *pointer, drape_body *ret)
{
    static const char *const MEMBERS[] = {"point", "normal", NULL};
    if (check_object(r, plane, pointer, MEMBERS) ||
        get_vector(r, plane, pointer, "point", true, ret->point) ||
        get_vector(r, plane, pointer, "normal", true, ret->axis))
        return -1;
    if (!(fabs(ret->axis[0]) + fabs(ret->axis[1]) + fabs(ret->axis[2]) > 0))
        return refuse(r, PROBLEM_INVALID, pointer, "normal", "must not be zero");
    return 0;
}

static int read_capsule(struct reader *r, const json_t *capsule, const char *pointer, drape_body *ret)
{
    static const char *const MEMBERS[] = {"a", "b", "radius", NULL};
    if (check_object(r, capsule, pointer, MEMBERS) ||
        get_vector(r, capsule, pointer, "a", true, ret->point) ||
        get_vector(r, capsule, pointer, "b", true, ret->axis))
        return -1;
    return get_radius(r, capsule, pointer, &ret->radius);
}

static int read_body_mesh(struct reader *r, const json_t *object, const char *pointer, struct mesh *mesh,
                          drape_body *ret)
{
    if (read_mesh(r, object, pointer, mesh))
        return -1;
    ret->positions = mesh->positions;
    ret->triangle = mesh->triangle;
    ret->vertices = mesh->vertices;
    ret->triangles = mesh->triangles;
    return 0;
}

static int read_body_shape(struct reader *r, const json_t *object, const char *pointer, struct mesh *mesh,
                           drape_body *ret)
{
    static const struct {
        const char *member;
        drape_body_kind kind;
        int (*read)(struct reader *r, const json_t *shape, const char *pointer, drape_body *ret);
    } SHAPE[] = {{"mesh", DRAPE_BODY_MESH, NULL},
                 {"sphere", DRAPE_BODY_SPHERE, read_sphere},
                 {"plane", DRAPE_BODY_PLANE, read_plane},
                 {"capsule", DRAPE_BODY_CAPSULE, read_capsule}};
    const size_t shapes = sizeof SHAPE / sizeof *SHAPE;
    size_t found = shapes, count = 0;
    char at[JSONTEXT_POINTER_BYTES];
    for (size_t i = 0; i < shapes; i++)
        if (json_object_get(object, SHAPE[i].member)) {
            found = i;
            count++;
        }
    if (count != 1)
        return problem_at(r->problem, PROBLEM_INVALID, pointer,
                          "needs exactly one of mesh, sphere, plane and capsule");
    ret->kind = SHAPE[found].kind;
    if (ret->kind == DRAPE_BODY_MESH)
        return read_body_mesh(r, object, pointer, mesh, ret);
    jsontext_pointer(at, sizeof at, pointer, SHAPE[found].member);
    return SHAPE[found].read(r, json_object_get(object, SHAPE[found].member), at, ret);
}

/* {positions} alone: the triangles are the body's. */
static int read_positions(struct reader *r, const json_t *object, const char *pointer, struct mesh *ret)
{
    static const char *const MEMBERS[] = {"positions", NULL};
    char at[JSONTEXT_POINTER_BYTES];
    struct numbers numbers;
    const json_t *positions = json_object_get(object, "positions");
    jsontext_pointer(at, sizeof at, pointer, "positions");
    if (check_object(r, object, pointer, MEMBERS))
        return -1;
    if (!positions)
        return problem_at(r->problem, PROBLEM_INVALID, at, "is missing");
    if (jsontext_get_numbers(&r->json, positions, at, &numbers, r->problem))
        return -1;
    if (numbers.count % 3 != 0)
        return problem_at(r->problem, PROBLEM_INVALID, at, "has %zu numbers, which is not a multiple of 3",
                          numbers.count);
    ret->positions = malloc((numbers.count + 1) * sizeof *ret->positions);
    if (!ret->positions)
        return out_of_memory(r);
    if (numbers.count)
        memcpy(ret->positions, numbers.value, numbers.count * sizeof *ret->positions);
    ret->vertices = numbers.count / 3;
    return 0;
}

/* One posture of the body's mesh: a mesh of the same triangles, or its positions alone. */
static int read_keyframe(struct reader *r, const json_t *object, const char *pointer, const drape_body *body,
                         struct mesh *ret)
{
    int failed = json_object_get(object, "ref") ? load_ref(r, object, pointer, ret)
                 : json_object_get(object, "triangles")
                     ? meshfile_from_json(&r->json, object, pointer, r->limits, ret, r->problem)
                     : read_positions(r, object, pointer, ret);
    if (failed)
        return -1;
    if (ret->vertices != body->vertices)
        return problem_at(r->problem, PROBLEM_INVALID, pointer, "%zu vertices, where the body has %zu",
                          ret->vertices, body->vertices);
    if (ret->triangle &&
        (ret->triangles != body->triangles ||
         memcmp(ret->triangle, body->triangle, 3 * body->triangles * sizeof *body->triangle) != 0))
        return problem_at(r->problem, PROBLEM_INVALID, pointer,
                          "its triangles are not those of the body's mesh");
    return 0;
}

static int read_motion(struct reader *r, const json_t *object, const char *pointer, struct motion *motion,
                       drape_body *ret)
{
    static const struct range SECONDS = {DRAPE_MIN_MOTION, DRAPE_MAX_MOTION, "must be between 0.01 and 60"};
    char at[JSONTEXT_POINTER_BYTES], frame[JSONTEXT_POINTER_BYTES];
    const json_t *array = json_object_get(object, "motion");
    size_t n = json_array_size(array);
    ret->motion_seconds = DRAPE_DEFAULT_MOTION;
    if (get_number(r, object, pointer, "motion_seconds", &SECONDS, &ret->motion_seconds))
        return -1;
    if (!array)
        return json_object_get(object, "motion_seconds")
                   ? refuse(r, PROBLEM_INVALID, pointer, "motion_seconds", "there is no motion")
                   : 0;
    if (!json_is_array(array))
        return refuse(r, PROBLEM_INVALID, pointer, "motion", "must be an array of meshes");
    if (n > DRAPE_MAX_KEYFRAMES)
        return refuse(r, PROBLEM_TOO_LARGE, pointer, "motion", "%zu, the limit is %d", n,
                      DRAPE_MAX_KEYFRAMES);
    if (ret->kind != DRAPE_BODY_MESH)
        return refuse(r, PROBLEM_INVALID, pointer, "motion", "only a mesh moves");
    if (n == 0)
        return 0;
    jsontext_pointer(at, sizeof at, pointer, "motion");
    motion->mesh = calloc(n, sizeof *motion->mesh);
    motion->positions = calloc(n, sizeof *motion->positions);
    if (!motion->mesh || !motion->positions)
        return out_of_memory(r);
    for (; motion->keyframes < n; motion->keyframes++) {
        struct mesh *mesh = motion->mesh + motion->keyframes;
        element_pointer(frame, sizeof frame, at, motion->keyframes);
        if (read_keyframe(r, json_array_get(array, motion->keyframes), frame, ret, mesh)) {
            mesh_done(mesh);
            return -1;
        }
        motion->positions[motion->keyframes] = mesh->positions;
    }
    ret->keyframes = n;
    ret->keyframe = motion->positions;
    return 0;
}

static int read_body(struct reader *r, const json_t *object, const char *pointer, struct mesh *mesh,
                     struct motion *motion, drape_body *ret)
{
    static const char *const MEMBERS[] = {"mesh",   "sphere",         "plane",    "capsule", "offset",
                                          "motion", "motion_seconds", "friction", NULL};
    ret->offset = DRAPE_DEFAULT_OFFSET;
    if (check_object(r, object, pointer, MEMBERS) ||
        get_number(r, object, pointer, "friction", &FRICTION, &ret->friction) ||
        get_number(r, object, pointer, "offset", &POSITIVE, &ret->offset) ||
        read_body_shape(r, object, pointer, mesh, ret) || read_motion(r, object, pointer, motion, ret))
        return -1;
    /* After the postures, whose triangles must be those that were sent. */
    if (ret->kind == DRAPE_BODY_MESH && weld_body(mesh) != 0)
        return out_of_memory(r);
    return 0;
}

static int read_bodies(struct reader *r, const json_t *root)
{
    struct job_spec *spec = r->spec;
    const json_t *array = json_object_get(root, "bodies");
    size_t n = json_array_size(array);
    char at[JSONTEXT_POINTER_BYTES];
    if (array && !json_is_array(array))
        return refuse(r, PROBLEM_INVALID, "", "bodies", "must be an array");
    if (n > r->limits->bodies)
        return refuse(r, PROBLEM_TOO_LARGE, "", "bodies", "%zu, the limit is %zu", n, r->limits->bodies);
    if (n == 0)
        return 0;
    spec->body = calloc(n, sizeof *spec->body);
    spec->body_mesh = calloc(n, sizeof *spec->body_mesh);
    spec->motion = calloc(n, sizeof *spec->motion);
    if (!spec->body || !spec->body_mesh || !spec->motion)
        return out_of_memory(r);
    spec->scene.bodies = n;
    for (size_t i = 0; i < n; i++) {
        element_pointer(at, sizeof at, "/bodies", i);
        if (read_body(r, json_array_get(array, i), at, &spec->body_mesh[i], &spec->motion[i], &spec->body[i]))
            return -1;
    }
    return 0;
}

/* ---- solver ----------------------------------------------------------------------------------- */

static const struct choice METHOD[] = {{"auto", DRAPE_METHOD_AUTO},
                                       {"stop-and-go", DRAPE_METHOD_STOP_AND_GO},
                                       {"dynamic", DRAPE_METHOD_DYNAMIC},
                                       {"velocity-correction", DRAPE_METHOD_VELOCITY_CORRECTION},
                                       {"quasi-static", DRAPE_METHOD_QUASI_STATIC},
                                       {"newton", DRAPE_METHOD_NEWTON}};
static const struct choice STOP_ON[] = {{"potential", DRAPE_STOP_ON_POTENTIAL},
                                        {"kinetic", DRAPE_STOP_ON_KINETIC}};
static const struct choice INTEGRATOR[] = {{"backward-euler", DRAPE_BACKWARD_EULER},
                                           {"bdf2", DRAPE_BDF2},
                                           {"implicit-midpoint", DRAPE_IMPLICIT_MIDPOINT},
                                           {"rk4", DRAPE_RK4}};
static const struct choice SELF_CONTACT[] = {
    {"auto", DRAPE_SELF_CONTACT_AUTO}, {"on", DRAPE_SELF_CONTACT_ON}, {"off", DRAPE_SELF_CONTACT_OFF}};

static const struct choice COARSE[] = {
    {"auto", DRAPE_COARSE_AUTO}, {"on", DRAPE_COARSE_ON}, {"off", DRAPE_COARSE_OFF}};

static const struct choice PRIORITY[] = {
    {"low", JOB_PRIORITY_LOW}, {"normal", JOB_PRIORITY_NORMAL}, {"high", JOB_PRIORITY_HIGH}};

#define GET_CHOICE(r, object, pointer, member, table, ret)                                                   \
    get_choice(r, object, pointer, member, table, sizeof table / sizeof *table, ret)

static int read_words(struct reader *r, const json_t *solver, drape_options *ret)
{
    int method = (int)ret->method, stop_on = (int)ret->stop_on, integrator = (int)ret->integrator;
    if (GET_CHOICE(r, solver, "/solver", "method", METHOD, &method) ||
        GET_CHOICE(r, solver, "/solver", "stop_on", STOP_ON, &stop_on) ||
        GET_CHOICE(r, solver, "/solver", "integrator", INTEGRATOR, &integrator))
        return -1;
    ret->method = (drape_method)method;
    ret->stop_on = (drape_stop_rule)stop_on;
    ret->integrator = (drape_integrator)integrator;
    return 0;
}

static int read_max_iterations(struct reader *r, const json_t *solver, drape_options *ret)
{
    double limit =
        r->limits->max_iterations < DRAPE_MAX_ITERATIONS ? r->limits->max_iterations : DRAPE_MAX_ITERATIONS;
    double value = ret->max_iterations;
    if (get_number(r, solver, "/solver", "max_iterations", &ANY, &value))
        return -1;
    if (!(value >= 0 && value <= limit && value == floor(value)))
        return refuse(r, PROBLEM_INVALID, "/solver", "max_iterations", "must be an integer from 0 to %.0f",
                      limit);
    ret->max_iterations = (uint32_t)value;
    return 0;
}

static int read_time_limit(struct reader *r, const json_t *solver, drape_options *ret)
{
    double value = fmin(ret->time_limit, r->limits->time_limit_s);
    if (get_number(r, solver, "/solver", "time_limit_s", &ANY, &value))
        return -1;
    if (!(value > 0 && value <= r->limits->time_limit_s))
        return refuse(r, PROBLEM_INVALID, "/solver", "time_limit_s", "must be > 0 and at most %g",
                      r->limits->time_limit_s);
    ret->time_limit = value;
    return 0;
}

static int read_damping(struct reader *r, const json_t *solver, drape_options *ret)
{
    static const char *const MEMBERS[] = {"air", "material", NULL};
    const json_t *damping = json_object_get(solver, "damping");
    if (!damping)
        return 0;
    if (check_object(r, damping, "/solver/damping", MEMBERS) ||
        get_number(r, damping, "/solver/damping", "air", &NOT_NEGATIVE, &ret->air_damping))
        return -1;
    return get_number(r, damping, "/solver/damping", "material", &NOT_NEGATIVE, &ret->material_damping);
}

static int read_solver(struct reader *r, const json_t *root)
{
    static const char *const MEMBERS[] = {"method",  "integrator",  "stop_on",        "time_step",
                                          "damping", "tolerance",   "max_iterations", "time_limit_s",
                                          "certify", "line_search", "coarse",         NULL};
    static const struct range TIME_STEP = {DRAPE_MIN_TIME_STEP, DRAPE_MAX_TIME_STEP,
                                           "must be between 1e-6 and 1000 s"};
    const json_t *solver = json_object_get(root, "solver");
    drape_options *options = &r->spec->options;
    int coarse = (int)r->spec->scene.coarse;
    if (solver && check_object(r, solver, "/solver", MEMBERS))
        return -1;
    if (read_words(r, solver, options) ||
        get_number(r, solver, "/solver", "time_step", &TIME_STEP, &options->time_step) ||
        get_number(r, solver, "/solver", "tolerance", &TOLERANCE, &options->tolerance) ||
        read_max_iterations(r, solver, options) || read_time_limit(r, solver, options) ||
        read_damping(r, solver, options) ||
        read_boolean(r, solver, "/solver", "line_search", &options->line_search) ||
        GET_CHOICE(r, solver, "/solver", "coarse", COARSE, &coarse))
        return -1;
    r->spec->scene.coarse = (drape_coarse)coarse;
    return read_boolean(r, solver, "/solver", "certify", &options->certify);
}

/* ---- the job ---------------------------------------------------------------------------------- */

static int read_job(struct reader *r)
{
    static const char *const MEMBERS[] = {"name",         "labels",     "cloth",    "bodies",
                                          "self_contact", "gravity",    "solver",   "fit",
                                          "lines",        "start_from", "priority", NULL};
    json_t *root = r->json.root;
    int self_contact = (int)r->spec->scene.self_contact;
    if (check_object(r, root, "", MEMBERS) || read_start_from(r, root) || read_name(r, root) ||
        read_labels(r, root) || GET_CHOICE(r, root, "", "priority", PRIORITY, &r->spec->priority) ||
        GET_CHOICE(r, root, "", "self_contact", SELF_CONTACT, &self_contact) ||
        get_vector(r, root, "", "gravity", false, r->spec->scene.gravity) || read_solver(r, root) ||
        read_boolean(r, root, "", "fit", &r->spec->options.fit) || read_cloth(r, root))
        return -1;
    r->spec->scene.self_contact = (drape_self_contact)self_contact;
    return read_lines(r, root) ? -1 : read_bodies(r, root);
}

/* Points the scene at the arrays of the spec, which by now stay where they are. */
static void link_scene(struct job_spec *spec)
{
    spec->scene.vertices = spec->cloth.vertices;
    spec->scene.triangles = spec->cloth.triangles;
    spec->scene.positions = spec->start ? spec->start : spec->cloth.positions;
    spec->scene.start_pattern = spec->start_pattern;
    spec->scene.pattern = spec->cloth.pattern;
    spec->scene.triangle = spec->cloth.triangle;
    spec->scene.seam = spec->seam;
    spec->scene.pin = spec->pin;
    spec->scene.material = spec->material;
    spec->scene.triangle_material = spec->triangle_material;
    spec->scene.elastic = spec->elastic;
    spec->scene.fold = spec->fold;
    spec->scene.tack = spec->tack;
    spec->scene.body = spec->body;
}

/* A pointer into a mesh that was given by its hash ends at the hash. */
static void point_at_ref(const struct reader *r, struct problem *problem)
{
    if (!problem || problem->error_count == 0)
        return;
    char *pointer = problem->errors[0].pointer, *mesh = strstr(pointer, "/mesh/");
    const json_t *object = json_object_get(r->json.root, "cloth");
    unsigned body;
    if (sscanf(pointer, "/bodies/%u/", &body) == 1)
        object = json_array_get(json_object_get(r->json.root, "bodies"), body);
    if (mesh && json_object_get(json_object_get(object, "mesh"), "ref"))
        strcpy(mesh, "/mesh/ref"); /* never longer than "/mesh/positions/0" */
}

/* Places and words of a warning are those of an error. */
static json_t *warning_json(const struct reader *r, const drape_error *warning)
{
    struct problem problem;
    drape_error error = *warning;
    error.status = DRAPE_EINVAL;
    schema_solver_problem(&error, &problem);
    point_at_ref(r, &problem);
    return json_pack("{s:s,s:s}", "pointer", problem.errors[0].pointer, "detail", problem.errors[0].detail);
}

static int find_warnings(struct reader *r)
{
    drape_error warning[DRAPE_MAX_WARNINGS], error;
    size_t count = 0;
    if (drape_scene_warnings(&r->spec->scene, warning, &count, &error) < 0)
        return out_of_memory(r);
    if (count == 0)
        return 0;
    r->spec->warnings = json_array();
    for (size_t i = 0; i < count && i < DRAPE_MAX_WARNINGS; i++)
        if (json_array_append_new(r->spec->warnings, warning_json(r, &warning[i])))
            return out_of_memory(r);
    return 0;
}

int schema_scene_check(struct job_spec *spec, struct problem *reterr)
{
    drape_error error;
    link_scene(spec);
    if (drape_check(&spec->scene, &spec->options, &error) >= 0)
        return 0;
    return schema_solver_problem(&error, reterr);
}

static int check_scene(struct reader *r)
{
    if (schema_scene_check(r->spec, r->problem) == 0)
        return join_lines(r) < 0 ? -1 : find_warnings(r);
    point_at_ref(r, r->problem);
    return -1;
}

int schema_job_parse(const char *text, size_t bytes, const struct limits *limits, schema_mesh_fn *load_mesh,
                     void *data, struct job_spec **ret, struct problem *reterr)
{
    struct reader r = {.limits = limits, .load_mesh = load_mesh, .data = data, .problem = reterr};
    int rc = -1;
    if (jsontext_parse(text, bytes, limits, &r.json, reterr))
        return -1;
    r.spec = calloc(1, sizeof *r.spec);
    if (!r.spec) {
        out_of_memory(&r);
        goto cleanup;
    }
    r.spec->scene = drape_scene_desc_default();
    r.spec->options = drape_options_default();
    if (read_job(&r) || check_scene(&r))
        goto cleanup;
    *ret = r.spec;
    r.spec = NULL;
    rc = 0;

cleanup:
    job_spec_free(r.spec);
    jsontext_done(&r.json);
    return rc;
}

static void motion_done(struct motion *motion)
{
    for (size_t k = 0; k < motion->keyframes; k++)
        mesh_done(motion->mesh + k);
    free(motion->mesh);
    free(motion->positions);
}

struct job_spec *job_spec_free(struct job_spec *spec)
{
    if (!spec)
        return NULL;
    for (size_t i = 0; spec->body_mesh && i < spec->scene.bodies; i++)
        mesh_done(&spec->body_mesh[i]);
    for (size_t i = 0; spec->motion && i < spec->scene.bodies; i++)
        motion_done(&spec->motion[i]);
    mesh_done(&spec->cloth);
    lines_free(spec->lines);
    json_decref(spec->labels);
    json_decref(spec->warnings);
    free(spec->seam);
    free(spec->pin);
    free(spec->start);
    free(spec->start_pattern);
    free(spec->triangle_material);
    for (size_t i = 0; spec->curve && i < 3 * spec->scene.materials; i++)
        free(spec->curve[i]);
    free(spec->curve);
    for (size_t i = 0; spec->elastic_edge && i < spec->scene.elastics; i++)
        free(spec->elastic_edge[i]);
    for (size_t i = 0; spec->fold_edge && i < spec->scene.folds; i++)
        free(spec->fold_edge[i]);
    free(spec->elastic_edge);
    free(spec->fold_edge);
    free(spec->elastic);
    free(spec->fold);
    free(spec->tack);
    free(spec->material);
    free(spec->body_mesh);
    free(spec->motion);
    free(spec->body);
    free(spec);
    return NULL;
}
