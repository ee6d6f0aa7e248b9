/* problem.c - the one table of error codes, and the JSON body of each. */
#include "problem.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

/* A stable name for each code; nothing to fetch. */
#define PROBLEM_TYPE_PREFIX "urn:draped:problem:"

struct problem_row {
    const char *name, *title;
    int status;
    bool retryable; /* the same request may succeed later, unchanged */
};

static const struct problem_row problem_table[PROBLEM_CODES] = {
    [PROBLEM_NONE] = {"none", "No problem", 200, false},
    [PROBLEM_BAD_REQUEST] = {"bad-request", "The request is malformed", 400, false},
    [PROBLEM_BAD_JSON] = {"bad-json", "The body is not JSON", 400, false},
    [PROBLEM_BAD_CURSOR] = {"bad-cursor", "The cursor is not one of ours", 400, false},
    [PROBLEM_BAD_ENCODING] = {"bad-encoding", "The body is not in its Content-Encoding", 400, false},
    [PROBLEM_DIGEST_MISMATCH] = {"digest-mismatch", "The body has another SHA-256", 400, false},
    [PROBLEM_UNAUTHORIZED] = {"unauthorized", "A key is needed here", 401, false},
    [PROBLEM_NOT_FOUND] = {"not-found", "There is no such thing here", 404, false},
    [PROBLEM_METHOD_NOT_ALLOWED] = {"method-not-allowed", "The method does not apply here", 405, false},
    [PROBLEM_NOT_ACCEPTABLE] = {"not-acceptable", "None of the accepted formats is on offer", 406, false},
    [PROBLEM_NOT_READY] = {"not-ready", "The job has not ended yet", 409, true},
    [PROBLEM_NO_RESULT] = {"no-result", "The job ended without a result", 409, false},
    [PROBLEM_IN_USE] = {"in-use", "A job that has not ended needs this", 409, true},
    [PROBLEM_KEY_IN_FLIGHT] = {"idempotency-in-flight", "The first request with this key is under way", 409,
                               true},
    [PROBLEM_GONE] = {"gone", "The job was removed", 410, false},
    [PROBLEM_PRECONDITION] = {"precondition-failed", "This is not what If-Match names", 412, false},
    [PROBLEM_LENGTH] = {"body-too-large", "The body is too large", 413, false},
    [PROBLEM_MEDIA_TYPE] = {"unsupported-media-type", "The content type is not supported", 415, false},
    [PROBLEM_ENCODING] = {"unsupported-encoding", "The content encoding is not supported", 415, false},
    [PROBLEM_EXPECTATION] = {"expectation-failed", "The expectation cannot be met", 417, false},
    [PROBLEM_INVALID] = {"invalid", "The document is not valid", 422, false},
    [PROBLEM_UNSUPPORTED] = {"unsupported", "This version cannot do that", 422, false},
    [PROBLEM_TOO_LARGE] = {"too-large", "The document exceeds a limit", 422, false},
    [PROBLEM_KEY_MISMATCH] = {"idempotency-mismatch", "The key came with another body", 422, false},
    [PROBLEM_TOO_LARGE_MEMORY] = {"too-large-memory", "The job needs too much memory", 422, false},
    [PROBLEM_TOO_MANY_STREAMS] = {"too-many-streams", "Too many event streams are open", 429, true},
    [PROBLEM_QUOTA_QUEUED] = {"quota-queued", "This key has as many jobs queued as it may", 429, true},
    [PROBLEM_QUOTA_MESHES] = {"quota-meshes", "This key keeps as many bytes of meshes as it may", 429, true},
    [PROBLEM_INTERNAL] = {"internal", "The server failed", 500, true},
    [PROBLEM_QUEUE_FULL] = {"queue-full", "The queue is full", 503, true},
    [PROBLEM_DRAINING] = {"draining", "The server is shutting down", 503, true},
    [PROBLEM_STORAGE] = {"storage", "The server could not store this", 503, true},
    [PROBLEM_BUSY] = {"busy", "The server is busy reading other requests", 503, true},
    [PROBLEM_SOLVER] = {"solver", "The solver gave no result", 500, false},
    [PROBLEM_WORKER_CRASH] = {"worker-crash", "The job ended the server three times", 500, false},
    [PROBLEM_MEMORY_LIMIT] = {"memory-limit", "The job came to need too much memory", 500, false},
};

static const struct problem_row *row_of(enum problem_code code)
{
    return &problem_table[(unsigned)code < PROBLEM_CODES ? code : PROBLEM_INTERNAL];
}

int problem_status(enum problem_code code)
{
    return row_of(code)->status;
}

const char *problem_name(enum problem_code code)
{
    return row_of(code)->name;
}

const char *problem_title(enum problem_code code)
{
    return row_of(code)->title;
}

bool problem_retryable(enum problem_code code)
{
    return row_of(code)->retryable;
}

int problem_set(struct problem *p, enum problem_code code, const char *format, ...)
{
    if (p == NULL)
        return -1;
    memset(p, 0, sizeof *p);
    p->code = code;
    va_list args;
    va_start(args, format);
    vsnprintf(p->detail, sizeof p->detail, format, args);
    va_end(args);
    return -1;
}

int problem_at(struct problem *p, enum problem_code code, const char *pointer, const char *format, ...)
{
    if (p == NULL)
        return -1;
    memset(p, 0, sizeof *p);
    p->code = code;
    p->error_count = 1;
    snprintf(p->errors[0].pointer, sizeof p->errors[0].pointer, "%s", pointer);
    va_list args;
    va_start(args, format);
    vsnprintf(p->errors[0].detail, sizeof p->errors[0].detail, format, args);
    va_end(args);
    snprintf(p->detail, sizeof p->detail, "%s: %s", pointer[0] ? pointer : "the document",
             p->errors[0].detail);
    return -1;
}

/* A detail may quote the client's bytes, and a cut at the buffer's end may split a character. */
static json_t *text_json(const char *text)
{
    json_t *value = json_string(text);
    if (value != NULL)
        return value;
    char ascii[256];
    size_t n = 0;
    for (; text[n] != '\0' && n < sizeof ascii - 1; n++)
        ascii[n] = (text[n] & 0x80) ? '?' : text[n];
    ascii[n] = '\0';
    return json_string(ascii);
}

static json_t *errors_json(const struct problem *p)
{
    json_t *list = json_array();
    for (size_t i = 0; list != NULL && i < p->error_count && i < PROBLEM_MAX_ERRORS; i++) {
        json_t *entry = json_object();
        if (entry == NULL || json_object_set_new(entry, "pointer", text_json(p->errors[i].pointer)) != 0 ||
            json_object_set_new(entry, "detail", text_json(p->errors[i].detail)) != 0 ||
            json_array_append(list, entry) != 0) {
            json_decref(list);
            list = NULL;
        }
        json_decref(entry);
    }
    return list;
}

json_t *problem_json(const struct problem *p, const char *instance, const char *request_id)
{
    const struct problem_row *row = row_of(p->code);
    char type[128];
    snprintf(type, sizeof type, "%s%s", PROBLEM_TYPE_PREFIX, row->name);
    json_t *body = json_object();
    if (body == NULL)
        return NULL;
    int failed = json_object_set_new(body, "type", json_string(type));
    failed |= json_object_set_new(body, "title", json_string(row->title));
    failed |= json_object_set_new(body, "status", json_integer(row->status));
    failed |= json_object_set_new(body, "detail", text_json(p->detail[0] ? p->detail : row->title));
    if (instance != NULL)
        failed |= json_object_set_new(body, "instance", text_json(instance));
    failed |= json_object_set_new(body, "code", json_string(row->name));
    if (request_id != NULL)
        failed |= json_object_set_new(body, "request_id", text_json(request_id));
    failed |= json_object_set_new(body, "retryable", json_boolean(row->retryable));
    failed |= json_object_set_new(body, "errors", errors_json(p));
    if (failed) {
        json_decref(body);
        return NULL;
    }
    return body;
}

const char problem_no_memory[] =
    "{\"type\":\"" PROBLEM_TYPE_PREFIX "internal\",\"title\":\"The server failed\",\"status\":500,"
    "\"detail\":\"out of memory\",\"code\":\"internal\",\"retryable\":true,\"errors\":[]}";
