/* jsontext.c - JSON text into a small jansson tree and plain arrays of numbers. */
#include "jsontext.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "jsonin.h"
#include "text.h"

/* ---- counting, before anything is allocated --------------------------------------------------- */

/* What a tree of the text would hold. Counts are exact for valid JSON; for any other text they only
 * need to be bounds, since the parser refuses it soon after. */
struct census {
    size_t depth;  /* deepest nesting */
    size_t values; /* numbers, strings, literals, arrays and objects */
    size_t arrays;
    size_t members; /* of objects */
};

/* The byte after the string whose opening quote is at `at`. */
static const char *skip_string(const char *at, const char *end)
{
    for (at++; at < end && *at != '"'; at++)
        if (*at == '\\')
            at++;
    return at < end ? at + 1 : end;
}

static bool is_blank(char c)
{
    return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

/* A container with n > 0 commas or any content holds n + 1 values; an empty one holds none. */
static struct census take_census(const char *text, size_t bytes)
{
    struct census census = {.values = 1};
    size_t depth = 0;
    bool opened = false; /* nothing but blanks since a bracket opened */
    const char *end = text + bytes;

    for (const char *at = text; at < end;) {
        char c = *at++;
        if (is_blank(c))
            continue;
        census.values += opened && c != ']' && c != '}';
        opened = c == '[' || c == '{';
        if (opened && ++depth > census.depth)
            census.depth = depth;
        depth -= (c == ']' || c == '}') && depth > 0;
        census.arrays += c == '[';
        census.members += c == ':';
        census.values += c == ',';
        if (c == '"')
            at = skip_string(at - 1, end);
    }
    return census;
}

/* ---- taking the numbers out -------------------------------------------------------------------- */

/* Where the text and what remains of it ran apart: to turn places in one into places in the other. */
struct cut {
    size_t in_rest, in_text;
};

struct lift {
    const char *text, *at, *end;
    char *rest;
    size_t rest_bytes;
    size_t rest_left; /* bytes of the text that may still be copied to it */
    double *value;
    size_t values;
    struct numbers *array;
    struct cut *cut;
    size_t arrays;
};

/* Line and column, both from 1, the column in bytes. */
static int syntax_problem(struct problem *reterr, const char *text, size_t offset, const char *detail)
{
    size_t line = 1, start = 0;
    for (size_t i = 0; i < offset; i++)
        if (text[i] == '\n') {
            line++;
            start = i + 1;
        }
    return problem_set(reterr, PROBLEM_BAD_JSON, "line %zu, column %zu: %s", line, offset - start + 1,
                       detail);
}

static void skip_blanks(struct lift *lift)
{
    while (lift->at < lift->end && is_blank(*lift->at))
        lift->at++;
}

static bool is_number_byte(char c)
{
    return (c >= '0' && c <= '9') || c == '.' || c == '-' || c == '+' || c == 'e' || c == 'E';
}

/* RFC 8259, section 6: -?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)? */
static bool is_json_number(struct word word)
{
    const char *at = word.at, *end = word.at + word.bytes;
    const char *digits;
    at += at < end && *at == '-';
    digits = at;
    while (at < end && *at >= '0' && *at <= '9')
        at++;
    if (at == digits || (*digits == '0' && at - digits > 1))
        return false;
    if (at < end && *at == '.') {
        digits = ++at;
        while (at < end && *at >= '0' && *at <= '9')
            at++;
        if (at == digits)
            return false;
    }
    if (at < end && (*at == 'e' || *at == 'E')) {
        at++;
        at += at < end && (*at == '+' || *at == '-');
        digits = at;
        while (at < end && *at >= '0' && *at <= '9')
            at++;
        if (at == digits)
            return false;
    }
    return at == end;
}

static bool begins_number(const struct lift *lift)
{
    return lift->at < lift->end && (*lift->at == '-' || (*lift->at >= '0' && *lift->at <= '9'));
}

static int lift_number(struct lift *lift, struct problem *reterr)
{
    const char *start = lift->at;
    while (lift->at < lift->end && is_number_byte(*lift->at))
        lift->at++;
    struct word word = {start, (size_t)(lift->at - start)};
    if (!is_json_number(word))
        return syntax_problem(reterr, lift->text, (size_t)(start - lift->text), "not a JSON number");
    if (!word_double(word, lift->value + lift->values))
        return syntax_problem(reterr, lift->text, (size_t)(start - lift->text),
                              "a number out of range or too long");
    lift->values++;
    return 0;
}

/* After an element that is no number: to the closing bracket of this array, or the end of the text. */
static void skip_array(struct lift *lift)
{
    for (size_t depth = 1; lift->at < lift->end;) {
        char c = *lift->at;
        if (c == '"') {
            lift->at = skip_string(lift->at, lift->end);
            continue;
        }
        depth += c == '[' || c == '{';
        depth -= c == ']' || c == '}';
        if (depth == 0)
            return;
        lift->at++;
    }
}

static int lift_problem(struct lift *lift, const char *detail, struct problem *reterr)
{
    return syntax_problem(reterr, lift->text, (size_t)(lift->at - lift->text), detail);
}

/* From the first number of an array to its ']'. */
static int lift_elements(struct lift *lift, struct numbers *array, struct problem *reterr)
{
    for (;;) {
        if (lift_number(lift, reterr))
            return -1;
        array->count++;
        skip_blanks(lift);
        if (lift->at < lift->end && *lift->at == ']')
            return 0;
        if (lift->at == lift->end || *lift->at != ',')
            return lift_problem(lift, "',' or ']' expected", reterr);
        lift->at++;
        skip_blanks(lift);
        if (begins_number(lift))
            continue;
        if (lift->at == lift->end || strchr("]},:", *lift->at))
            return lift_problem(lift, "a value expected", reterr);
        array->odd = array->count;
        skip_array(lift);
        return lift->at < lift->end && *lift->at == ']' ? 0 : lift_problem(lift, "']' expected", reterr);
    }
}

static int lift_array(struct lift *lift, struct problem *reterr)
{
    struct numbers *array = &lift->array[lift->arrays];
    *array = (struct numbers){.value = lift->value + lift->values, .odd = SIZE_MAX};
    if (lift_elements(lift, array, reterr))
        return -1;
    lift->rest_bytes += (size_t)sprintf(lift->rest + lift->rest_bytes, "%zu", lift->arrays);
    lift->cut[lift->arrays++] = (struct cut){lift->rest_bytes, (size_t)(lift->at - lift->text)};
    return 0;
}

/* Copies the text to `rest`, arrays of numbers as [k]. */
static int lift_all(struct lift *lift, struct problem *reterr)
{
    while (lift->at < lift->end) {
        const char *from = lift->at;
        bool opens = *from == '[';
        lift->at = *from == '"' ? skip_string(from, lift->end) : from + 1;
        if (opens)
            skip_blanks(lift);
        size_t n = (size_t)(lift->at - from);
        if (n > lift->rest_left)
            return problem_at(reterr, PROBLEM_TOO_LARGE, "", "more than %zu bytes outside arrays of numbers",
                              JSONTEXT_MAX_REST);
        memcpy(lift->rest + lift->rest_bytes, from, n);
        lift->rest_bytes += n;
        lift->rest_left -= n;
        if (opens && begins_number(lift) && lift_array(lift, reterr))
            return -1;
    }
    return 0;
}

/* ---- the tree ---------------------------------------------------------------------------------- */

/* The place in the text of a place in what remained of it. */
static size_t text_offset(const struct lift *lift, size_t in_rest)
{
    struct cut last = {0, 0};
    for (size_t i = 0; i < lift->arrays && lift->cut[i].in_rest <= in_rest; i++)
        last = lift->cut[i];
    return last.in_text + (in_rest - last.in_rest);
}

/* jansson's text without its quotation of the input, which may be cut within a character. */
static int tree_problem(const struct lift *lift, json_error_t *error, struct problem *reterr)
{
    char *near = strstr(error->text, " near '");
    if (near)
        *near = '\0';
    size_t offset = text_offset(lift, error->position > 0 ? (size_t)error->position : 0);
    size_t bytes = (size_t)(lift->end - lift->text);
    return syntax_problem(reterr, lift->text, offset < bytes ? offset : bytes, error->text);
}

static int check_census(const struct census *census, const struct limits *limits, struct problem *reterr)
{
    if (census->depth > limits->json_depth)
        return problem_set(reterr, PROBLEM_BAD_JSON, "nested %zu deep, the limit is %zu", census->depth,
                           limits->json_depth);
    if (census->values > limits->json_values)
        return problem_at(reterr, PROBLEM_TOO_LARGE, "", "%zu values, the limit is %zu", census->values,
                          limits->json_values);
    if (census->arrays + census->members > JSONTEXT_MAX_NODES)
        return problem_at(reterr, PROBLEM_TOO_LARGE, "", "%zu arrays and members, the limit is %d",
                          census->arrays + census->members, JSONTEXT_MAX_NODES);
    return 0;
}

/* The number of a lifted array in decimal, at most. */
#define INDEX_BYTES (sizeof "65535" - 1)

/* The sizes are bounds that the work below can only fall short of; pages never written cost nothing. */
static int lift_alloc(struct lift *lift, size_t bytes, const struct census *census)
{
    lift->rest_left = bytes < JSONTEXT_MAX_REST ? bytes : JSONTEXT_MAX_REST;
    lift->rest = malloc(lift->rest_left + INDEX_BYTES * census->arrays + 1);
    lift->value = malloc(census->values * sizeof *lift->value);
    lift->array = calloc(census->arrays + 1, sizeof *lift->array);
    lift->cut = calloc(census->arrays + 1, sizeof *lift->cut);
    return lift->rest && lift->value && lift->array && lift->cut ? 0 : -1;
}

int jsontext_parse(const char *text, size_t bytes, const struct limits *limits, struct jsontext *ret,
                   struct problem *reterr)
{
    struct census census = take_census(text, bytes);
    struct lift lift = {.text = text, .at = text, .end = text + bytes};
    json_t *root = NULL;
    json_error_t error;
    int rc = -1;

    if (check_census(&census, limits, reterr))
        return -1;
    if (lift_alloc(&lift, bytes, &census)) {
        problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
        goto cleanup;
    }
    if (lift_all(&lift, reterr))
        goto cleanup;
    census = take_census(lift.rest, lift.rest_bytes);
    if (census.values + census.members > 2 * JSONTEXT_MAX_NODES) {
        problem_at(reterr, PROBLEM_TOO_LARGE, "", "too many values outside arrays of numbers");
        goto cleanup;
    }
    switch (jsonin_load(lift.rest, lift.rest_bytes, &root, &error)) {
    case 0:
        break;
    case JSONIN_BAD:
        tree_problem(&lift, &error, reterr);
        goto cleanup;
    default:
        problem_set(reterr, PROBLEM_INTERNAL, "out of memory");
        goto cleanup;
    }
    *ret = (struct jsontext){root, lift.value, lift.array, lift.arrays};
    lift.value = NULL;
    lift.array = NULL;
    rc = 0;

cleanup:
    free(lift.rest);
    free(lift.value);
    free(lift.array);
    free(lift.cut);
    return rc;
}

void jsontext_done(struct jsontext *json)
{
    json_decref(json->root);
    free(json->value);
    free(json->array);
    *json = (struct jsontext){0};
}

struct numbers jsontext_numbers(const struct jsontext *json, const json_t *value)
{
    const json_t *first = json_array_get(value, 0);
    if (json_is_array(value) && !first)
        return (struct numbers){.odd = SIZE_MAX};
    if (!json_is_integer(first) || (size_t)json_integer_value(first) >= json->arrays)
        return (struct numbers){.odd = 0};
    return json->array[json_integer_value(first)];
}

static int element_problem(struct problem *reterr, const char *pointer, size_t i, const char *detail)
{
    char at[JSONTEXT_POINTER_BYTES], index[24];
    snprintf(index, sizeof index, "%zu", i);
    jsontext_pointer(at, sizeof at, pointer, index);
    return problem_at(reterr, PROBLEM_INVALID, at, "%s", detail);
}

int jsontext_get_numbers(const struct jsontext *json, const json_t *value, const char *pointer,
                         struct numbers *ret, struct problem *reterr)
{
    if (!json_is_array(value))
        return problem_at(reterr, PROBLEM_INVALID, pointer, "must be an array of numbers");
    *ret = jsontext_numbers(json, value);
    if (ret->odd != SIZE_MAX)
        return element_problem(reterr, pointer, ret->odd, "must be a number");
    return 0;
}

int jsontext_indices(struct numbers numbers, size_t bound, const char *pointer, uint32_t *ret,
                     struct problem *reterr)
{
    char detail[96];
    for (size_t i = 0; i < numbers.count; i++) {
        double value = numbers.value[i];
        if (value != floor(value))
            return element_problem(reterr, pointer, i, "must be an integer");
        if (!(value >= 0 && value < (double)bound)) {
            snprintf(detail, sizeof detail, "%.17g is out of range: there are %zu, counted from 0", value,
                     bound);
            return element_problem(reterr, pointer, i, detail);
        }
        ret[i] = (uint32_t)value;
    }
    return 0;
}

void jsontext_pointer(char *ret, size_t size, const char *pointer, const char *member)
{
    size_t n = strlen(pointer);
    if (n > size - 1)
        n = size - 1;
    memcpy(ret, pointer, n);
    if (n < size - 1)
        ret[n++] = '/';
    for (const char *at = member; *at;) {
        /* one UTF-8 character: a lead byte and its continuation bytes */
        size_t width = 1;
        while (((unsigned char)at[width] & 0xC0) == 0x80)
            width++;
        const char *piece = *at == '~' ? "~0" : *at == '/' ? "~1" : at;
        size_t bytes = piece == at ? width : 2;
        if (n + bytes > size - 1)
            break;
        memcpy(ret + n, piece, bytes);
        n += bytes;
        at += width;
    }
    ret[n] = '\0';
}

static bool is_known(const char *member, const char *const *known)
{
    for (; *known; known++)
        if (strcmp(member, *known) == 0)
            return true;
    return false;
}

int jsontext_check_members(const json_t *object, const char *pointer, const char *const *known,
                           struct problem *reterr)
{
    char at[JSONTEXT_POINTER_BYTES];
    int rc = 0;
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)object, key, value)
    {
        if (is_known(key, known))
            continue;
        jsontext_pointer(at, sizeof at, pointer, key);
        if (rc == 0) {
            rc = problem_at(reterr, PROBLEM_INVALID, at, "unknown member");
        } else if (reterr && reterr->error_count < PROBLEM_MAX_ERRORS) {
            struct problem_member *error = &reterr->errors[reterr->error_count++];
            snprintf(error->pointer, sizeof error->pointer, "%s", at);
            snprintf(error->detail, sizeof error->detail, "unknown member");
        }
    }
    return rc;
}
