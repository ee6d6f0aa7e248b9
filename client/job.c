/* job.c - see job.h. */
#include "job.h"

#include <stdio.h>
#include <string.h>

#include "problem.h"

int job_path(const char *id, const char *tail, char path[JOB_PATH_SIZE], struct failure *failure)
{
    const char *allowed = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_";
    size_t length = strlen(id);
    if (length == 0 || length >= JOB_ID_SIZE || strspn(id, allowed) != length) {
        return failure_set(failure, EXIT_USAGE, "\"%.64s\" is not a job id\ntry: `drape list` shows the ids",
                           id);
    }
    snprintf(path, JOB_PATH_SIZE, "/v1/jobs/%s%s", id, tail);
    return 0;
}

/* Parses a job body; 0 or -1 when it is not one. */
static int parse_job(const struct http_reply *reply, json_t **ret, struct failure *failure)
{
    json_error_t error;
    json_t *job = json_loadb(reply->body, reply->bytes, 0, &error);
    if (!job || job_id(job)[0] == '\0' || job_status(job)[0] == '\0') {
        json_decref(job);
        return failure_set(
            failure, EXIT_REFUSED,
            "the answer is not a job of the v1 interface\ntry: check that --url points to a draped server");
    }
    *ret = job;
    return 0;
}

int job_submit(struct http *http, const char *text, size_t bytes, json_t **ret, struct failure *failure)
{
    struct http_request request = {.method = "POST", .path = "/v1/jobs", .body = text, .bytes = bytes};
    struct http_reply reply;
    int status = problem_send(http, &request, "the job", &reply, failure);
    if (status == 0) {
        status = parse_job(&reply, ret, failure);
    }
    http_reply_done(&reply);
    return status;
}

int job_get(struct http *http, const char *id, int wait_s, json_t **ret, struct failure *failure)
{
    char path[JOB_PATH_SIZE], prefer[32];
    if (job_path(id, "", path, failure) < 0) {
        return -1;
    }
    snprintf(prefer, sizeof prefer, "wait=%d", wait_s);
    struct http_request request = {.method = "GET", .path = path, .prefer = wait_s > 0 ? prefer : NULL};
    struct http_reply reply;
    int status = problem_send(http, &request, "the job's status", &reply, failure);
    if (status == 0) {
        status = parse_job(&reply, ret, failure);
    }
    http_reply_done(&reply);
    return status;
}

int job_cancel(struct http *http, const char *id, bool *ret_removed, struct failure *failure)
{
    char path[JOB_PATH_SIZE];
    if (job_path(id, "", path, failure) < 0) {
        return -1;
    }
    struct http_request request = {.method = "DELETE", .path = path};
    struct http_reply reply;
    int status = problem_send(http, &request, "to cancel the job", &reply, failure);
    *ret_removed = reply.status == 204;
    http_reply_done(&reply);
    return status;
}

int job_fetch(struct http *http, const char *id, const char *kind, const char *format,
              struct http_reply *reply, struct failure *failure)
{
    char path[JOB_PATH_SIZE], tail[64], what[64];
    *reply = (struct http_reply){0};
    snprintf(tail, sizeof tail, "/%s?format=%s", kind, format);
    snprintf(what, sizeof what, "the job's %s", kind);
    if (job_path(id, tail, path, failure) < 0) {
        return -1;
    }
    struct http_request request = {.method = "GET", .path = path};
    return problem_send(http, &request, what, reply, failure);
}

static const char *text_member(const json_t *job, const char *key)
{
    const char *text = json_string_value(json_object_get(job, key));
    return text ? text : "";
}

void job_print_warnings(FILE *file, const json_t *job)
{
    size_t i;
    const json_t *warning;
    json_array_foreach(json_object_get(job, "warnings"), i, warning)
    {
        fprintf(file, "warning: %s (%s)\n", text_member(warning, "detail"), text_member(warning, "pointer"));
    }
}

const char *job_id(const json_t *job)
{
    return text_member(job, "id");
}

const char *job_status(const json_t *job)
{
    return text_member(job, "status");
}

bool job_ended(const json_t *job)
{
    const char *status = job_status(job);
    return strcmp(status, "succeeded") == 0 || strcmp(status, "failed") == 0 ||
           strcmp(status, "canceled") == 0;
}

enum exit_code job_exit_code(const json_t *job)
{
    if (strcmp(job_status(job), "succeeded") != 0) {
        return EXIT_JOB_FAILED;
    }
    return strcmp(text_member(job, "verdict"), "at-rest") == 0 ? EXIT_AT_REST : EXIT_NOT_AT_REST;
}
