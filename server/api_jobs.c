/* api_jobs.c - jobs: posted, listed, looked at, followed, cancelled, and their results. */
#include "api.h"

#include <inttypes.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "digest.h"
#include "drape.h"
#include "jsonout.h"
#include "log.h"
#include "memout.h"
#include "meshref.h"
#include "negotiate.h"
#include "output.h"
#include "represent.h"
#include "schema.h"
#include "start.h"

#define LIST_DEFAULT 50
#define LIST_MAX     200

/* ---- answers ------------------------------------------------------------------------------------- */

#define ETAG_SIZE (REVISION_SIZE + STAMP_SIZE + 3)

/* The revision, for people, and a stamp of all that is told: a place in the line moves without a revision,
 * and what is strong must tell (RFC 9110 section 8.8.1). */
static void format_etag(struct revision revision, const char *body, char ret[ETAG_SIZE])
{
    char text[REVISION_SIZE], stamp[STAMP_SIZE];
    revision_format(revision, text);
    id_stamp(body, strlen(body), stamp);
    snprintf(ret, ETAG_SIZE, "\"%s-%s\"", text, stamp);
}

/* Takes `body`. With `known`, a list of tags that the client has (NULL: none), perhaps a 304. */
static struct http_answer *answer_body(int status, struct revision revision, char *body, bool ended,
                                       const char *known)
{
    char etag[ETAG_SIZE];
    format_etag(revision, body, etag);
    struct http_answer *answer = http_answer_text(status, "application/json", body);
    if (negotiate_unchanged(known, etag))
        answer = http_answer_unmodified(answer);
    http_answer_header(answer, "ETag", "%s", etag);
    http_answer_header(answer, "Cache-Control", "no-cache");
    if (!ended)
        http_answer_header(answer, "Retry-After", "1");
    return answer;
}

void job_refuse_unknown(struct call *call, int found, const struct problem *problem)
{
    if (found == STORE_NONE)
        call_refuse(call, PROBLEM_NOT_FOUND, "There is no such job.");
    else if (found == STORE_GONE)
        call_refuse(call, PROBLEM_GONE, "The job was removed.");
    else
        call_problem(call, problem);
}

int job_look_up(struct api *api, const char *owner, const char *id, char **ret_body,
                struct revision *ret_revision, bool *ret_ended, struct problem *reterr)
{
    struct job job;
    int found = queue_body(api->queue, owner, id, ret_body, ret_revision);
    if (found != QUEUE_NONE) {
        *ret_ended = false;
        return found == 0 ? 0 : problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    }
    found = store_job_get(api->store, owner, id, &job, reterr);
    if (found != 0)
        return found;
    *ret_body = job_body(&job, 0);
    *ret_revision = job.revision;
    *ret_ended = job_status_ended(job.status);
    job_done(&job);
    return *ret_body != NULL ? 0 : problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
}

/* ---- waiting --------------------------------------------------------------------------------------- */

/* The answer of a POST: 202, or 200 when it saw the end. Takes `body`. */
static struct http_answer *answer_post(const struct call *call, const char *id, struct revision revision,
                                       char *body, bool ended, bool waited)
{
    struct http_answer *answer = answer_body(ended ? 200 : 202, revision, body, ended, NULL);
    if (call->replayed)
        http_answer_header(answer, "Idempotency-Replayed", "true");
    http_answer_header(answer, "Location", "/v1/jobs/%s", id);
    if (ended && waited)
        http_answer_header(answer, "Preference-Applied", "wait");
    return answer;
}

static struct http_answer *answer_get(struct call *call, struct revision revision, char *body, bool ended)
{
    return answer_body(200, revision, body, ended, http_header(call->request, "If-None-Match"));
}

static struct http_answer *answer_waiting(struct call *call, struct revision revision, char *body, bool ended)
{
    if (call->job_id[0] != '\0')
        return answer_post(call, call->job_id, revision, body, ended, true);
    struct http_answer *answer = answer_get(call, revision, body, ended);
    http_answer_header(answer, "Preference-Applied", "wait");
    return answer;
}

void job_wait_changed(struct http_request *request, struct revision revision, bool ended, const char *body,
                      void *data)
{
    struct call *call = http_context(request);
    (void)data;
    char *copy = strdup(body);
    http_send(request, copy == NULL ? NULL : answer_waiting(call, revision, copy, ended));
}

/* On the clerk's thread: the time is up, and the job may have ended at that very moment. */
static void answer_expired(struct call *call)
{
    struct problem problem;
    struct revision revision;
    char *body;
    bool ended;
    const char *id = call->job_id[0] != '\0' ? call->job_id : call->id;
    int found = job_look_up(call->api, call->owner, id, &body, &revision, &ended, &problem);
    if (found != 0)
        job_refuse_unknown(call, found, &problem);
    else
        http_send(call->request, answer_waiting(call, revision, body, ended));
}

void job_wait_expired(struct http_request *request, void *data)
{
    struct call *call = http_context(request);
    (void)data;
    call_pass(call, call->api->clerk, answer_expired);
}

/* Waits up to `seconds` for job `id` to end, or to pass `seen`. The call may be gone when it returns. */
static void wait_for_job(struct call *call, const char *id, struct revision seen, int seconds)
{
    struct api *api = call->api;
    struct problem problem;
    struct revision revision;
    char *body, copy[ID_SIZE], owner[KEY_NAME_SIZE];
    bool ended;
    snprintf(copy, sizeof copy, "%s", id);
    memcpy(owner, call->owner, sizeof owner);
    call->untimed = true;
    if (waits_add(api->waits, call->request, copy, seen, clock_monotonic_ms() + 1000 * (int64_t)seconds) !=
        0) {
        answer_expired(call);
        return;
    }
    /* It may have happened just before the wait began. */
    if (job_look_up(api, owner, copy, &body, &revision, &ended, &problem) == 0) {
        waits_changed(api->waits, copy, revision, ended, body);
        free(body);
    }
}

/* ---- POST ------------------------------------------------------------------------------------------ */

/* What a checked document says about the job itself; 0, or -1 when out of memory. */
static int fill_job(const struct job_spec *spec, struct job *ret)
{
    id_new(ret->id);
    ret->priority = spec->priority;
    if (spec->name[0] != '\0' && (ret->name = strdup(spec->name)) == NULL)
        return -1;
    if (spec->labels != NULL && (ret->labels = jsonout_text(json_incref(spec->labels))) == NULL)
        return -1;
    if (spec->warnings != NULL && (ret->warnings = jsonout_text(json_incref(spec->warnings))) == NULL)
        return -1;
    return 0;
}

/* Notes what the solve is expected to need. 0, or -1 with *reterr: more than a job may have. */
static int estimate_memory(const struct job_spec *spec, const struct limits *limits, struct job *job,
                           struct problem *reterr)
{
    job->memory = drape_memory_estimate(&spec->scene, &spec->options);
    if (job->memory <= limits->job_memory)
        return 0;
    return problem_set(reterr, PROBLEM_TOO_LARGE_MEMORY,
                       "It would take about %llu bytes of memory; a job may have %llu.",
                       (unsigned long long)job->memory, (unsigned long long)limits->job_memory);
}

/* Checks and commits the body in *submission; 0 with the job's id and body, QUEUE_TAKEN, or -1 with *reterr.
 */
static int accept_job(struct call *call, struct store_submission *submission, char ret_id[ID_SIZE],
                      char **ret_body, struct problem *reterr)
{
    struct api *api = call->api;
    struct meshref_list meshes = {0};
    struct meshref meshref = {api->store, call->owner, &api->config->limits, &meshes};
    struct job_spec *spec = NULL;
    struct job job = {0};
    char trace_id[TRACE_ID_SIZE];
    int failed = schema_job_parse(submission->document, submission->bytes, &api->config->limits, meshref_load,
                                  &meshref, &spec, reterr);
    if (!failed && (failed = fill_job(spec, &job)) != 0)
        problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    if (!failed)
        failed = estimate_memory(spec, &api->config->limits, &job, reterr);
    memcpy(job.owner, call->owner, sizeof job.owner);
    traceparent_parse(http_header(call->request, "traceparent"), trace_id);
    memcpy(job.trace_id, trace_id, sizeof job.trace_id);
    memcpy(ret_id, job.id, sizeof job.id);
    if (!failed && spec->start_from[0] != '\0')
        failed = start_keep(&meshref, ret_id, spec, reterr);
    job_spec_free(spec);
    submission->mesh = (const char(*)[SHA256_SIZE])meshes.sha256;
    submission->meshes = meshes.count;
    if (!failed)
        failed = queue_submit(api->queue, &job, submission, ret_body, reterr);
    job_done(&job);
    meshref_list_done(&meshes);
    if (!failed)
        log_event(LOG_LEVEL_INFO, "job.accepted", "job=%s bytes=%zu request=%s trace=%s", ret_id,
                  submission->bytes, http_request_id(call->request), trace_id);
    return failed;
}

/* Whether a job that was accepted once has not been removed since. */
static bool is_there(struct call *call, const char *id)
{
    struct problem problem;
    struct revision revision;
    char *body;
    bool ended;
    if (job_look_up(call->api, call->owner, id, &body, &revision, &ended, &problem) != 0)
        return false;
    free(body);
    return true;
}

/* Answers for a job that is on disk; takes `body`, that of its first answer. */
static void answer_accepted(struct call *call, const char *id, char *body)
{
    int seconds = negotiate_wait(http_header(call->request, "Prefer"), WAIT_MAX_S);
    if (seconds > 0 && (!call->replayed || is_there(call, id))) {
        free(body);
        memcpy(call->job_id, id, sizeof call->job_id);
        wait_for_job(call, id, (struct revision){0, 0}, seconds);
    } else {
        http_send(call->request, answer_post(call, id, (struct revision){1, 1}, body, false, false));
    }
}

/* Gives the first answer again where the key and the body are those of an earlier request: 0, STORE_NONE
 * where the key is new, -1 with *reterr. */
static int find_answer(struct call *call, const char *digest, char ret_id[ID_SIZE], char **ret_body,
                       struct problem *reterr)
{
    struct store_answer answer;
    int found =
        store_answer_get(call->api->store, call->owner, call->key, clock_steady_ms(), &answer, reterr);
    if (found != 0)
        return found;
    if (strcmp(answer.digest, digest) != 0) {
        free(answer.body);
        return problem_set(reterr, PROBLEM_KEY_MISMATCH,
                           "This Idempotency-Key came before, with another body.");
    }
    memcpy(ret_id, answer.job, sizeof answer.job);
    *ret_body = answer.body;
    call->replayed = true;
    log_event(LOG_LEVEL_INFO, "job.replayed", "job=%s request=%s", ret_id, http_request_id(call->request));
    return 0;
}

void job_post(struct call *call)
{
    struct store_submission submission = {.at_ms = clock_steady_ms()};
    struct problem problem;
    char id[ID_SIZE], digest[SHA256_SIZE], *body;
    int result = STORE_NONE;
    if (http_body(call->request, &submission.document, &submission.bytes) != 0) {
        result = problem_set(&problem, PROBLEM_STORAGE, "The body could not be read: %s.", strerror(errno));
    } else if (digest_check(http_header(call->request, "Content-Digest"), submission.document,
                            submission.bytes, &problem) != 0 ||
               call_body(call, &submission.document, &submission.bytes, &problem) != 0) {
        result = -1;
    } else if (call->key[0] != '\0') {
        sha256_hex(submission.document, submission.bytes, digest);
        submission.key = call->key;
        submission.digest = digest;
        result = find_answer(call, digest, id, &body, &problem);
    }
    if (result == STORE_NONE)
        result = accept_job(call, &submission, id, &body, &problem);
    claims_release(call->api->claims, &call->claim);
    http_drop_body(call->request);
    if (result == 0)
        answer_accepted(call, id, body);
    else if (result == QUEUE_TAKEN)
        call_refuse(call, PROBLEM_KEY_IN_FLIGHT, "Another request with this key was just faster.");
    else
        call_problem(call, &problem);
}

/* ---- GET, DELETE ------------------------------------------------------------------------------------- */

static void get_stored(struct call *call)
{
    struct problem problem;
    struct revision revision;
    char *body;
    bool ended;
    int found = job_look_up(call->api, call->owner, call->id, &body, &revision, &ended, &problem);
    if (found != 0)
        job_refuse_unknown(call, found, &problem);
    else
        http_send(call->request, answer_get(call, revision, body, ended));
}

/* Whether what the client has is not the job as it stands: there is nothing to wait for. */
static bool is_news(const struct call *call, struct revision revision, const char *body)
{
    char etag[ETAG_SIZE];
    const char *header = http_header(call->request, "If-None-Match");
    format_etag(revision, body, etag);
    return header != NULL && !negotiate_unchanged(header, etag);
}

/* A long poll, on the clerk's thread. With If-None-Match it waits for another revision, else for the end. */
static void get_waiting(struct call *call)
{
    struct problem problem;
    struct revision revision, end = {0, 0};
    char *body;
    bool ended;
    int found = job_look_up(call->api, call->owner, call->id, &body, &revision, &ended, &problem);
    if (found != 0) {
        job_refuse_unknown(call, found, &problem);
    } else if (is_news(call, revision, body)) {
        http_send(call->request, answer_get(call, revision, body, ended));
    } else {
        bool conditional = http_header(call->request, "If-None-Match") != NULL;
        free(body);
        wait_for_job(call, call->id, conditional ? revision : end,
                     negotiate_wait(http_header(call->request, "Prefer"), WAIT_MAX_S));
    }
}

/* Of jobs that have not ended, from memory: costs microseconds, whatever the workers and the disk do. */
void job_get(struct call *call)
{
    struct revision revision;
    char *body;
    bool wait = negotiate_wait(http_header(call->request, "Prefer"), WAIT_MAX_S) > 0;
    int found = queue_body(call->api->queue, call->owner, call->id, &body, &revision);
    if (found == QUEUE_NONE)
        call_defer(call, call->api->clerk, get_stored);
    else if (found < 0)
        http_send(call->request, NULL);
    else if (wait) {
        free(body);
        call_defer(call, call->api->clerk, get_waiting);
    } else {
        http_send(call->request, answer_get(call, revision, body, false));
    }
}

/* `remove`: also where it has ended. */
static void cancel_or_remove(struct call *call, bool remove)
{
    struct problem problem;
    char *body;
    int found = queue_cancel(call->api->queue, call->owner, call->id, &body, &problem);
    if (found == 0) {
        log_event(LOG_LEVEL_INFO, "job.cancel", "job=%s request=%s", call->id,
                  http_request_id(call->request));
        http_send(call->request, http_answer_text(202, "application/json", body));
        return;
    }
    if (found == QUEUE_NONE && !remove) {
        call_refuse(call, PROBLEM_PRECONDITION, "The job has just ended.");
        return;
    }
    if (found == QUEUE_NONE)
        found = store_job_remove(call->api->store, call->owner, call->id, clock_steady_ms(), &problem);
    if (found == 0 || found == STORE_GONE)
        http_send(call->request, http_answer_empty(204));
    else
        job_refuse_unknown(call, found, &problem);
}

/* Holds If-Match against the job as it stands: as job_look_up, or -1 where it is another. */
static int check_match(struct call *call, const char *if_match, bool *ret_ended, struct problem *reterr)
{
    struct revision revision;
    char *body, etag[ETAG_SIZE];
    int found = job_look_up(call->api, call->owner, call->id, &body, &revision, ret_ended, reterr);
    if (found != 0)
        return found;
    format_etag(revision, body, etag);
    free(body);
    return negotiate_matches(if_match, etag) ? 0
                                             : problem_set(reterr, PROBLEM_PRECONDITION, "It is %s.", etag);
}

/* What ends behind the look is not removed: whoever named it by If-Match has not seen what came of it. */
void job_delete(struct call *call)
{
    struct problem problem;
    bool ended = true;
    const char *if_match = http_header(call->request, "If-Match");
    int found = if_match == NULL ? 0 : check_match(call, if_match, &ended, &problem);
    if (found == 0)
        cancel_or_remove(call, ended);
    else if (found == STORE_GONE) /* as it was asked for */
        http_send(call->request, http_answer_empty(204));
    else
        job_refuse_unknown(call, found, &problem);
}

/* ---- list ---------------------------------------------------------------------------------------------- */

struct listing {
    struct api *api;
    FILE *out;
    size_t count;
};

/* Jobs that have not ended are shown as they are in memory, progress and all. */
static int list_job(const struct job *job, void *data)
{
    struct listing *listing = data;
    struct revision revision;
    char *body = NULL;
    if (job_status_ended(job->status) ||
        queue_body(listing->api->queue, job->owner, job->id, &body, &revision) == QUEUE_NONE)
        body = job_body(job, 0);
    if (body == NULL)
        return -1;
    fprintf(listing->out, "%s%s", listing->count++ > 0 ? "," : "", body);
    free(body);
    return 0;
}

/* A cursor is a place in the store's order, marked so that other numbers are not taken for one. */
static int parse_cursor(const char *text, int64_t *ret)
{
    size_t n = strlen(text);
    if (n < 2 || n > 17 || text[0] != 'c' || strspn(text + 1, "0123456789abcdef") != n - 1)
        return -1;
    *ret = (int64_t)strtoull(text + 1, NULL, 16);
    return *ret > 0 ? 0 : -1;
}

struct list_query {
    struct store_filter filter;
    char status[16], label[512], created_after[64], cursor[32], limit[8];
};

/* Reads one argument; `buffer` is "" when it is absent. -1 with *reterr. */
static int read_argument(const struct call *call, const char *name, char *buffer, size_t size,
                         struct problem *reterr)
{
    buffer[0] = '\0';
    if (http_query(call->request, name, buffer, size) < 0)
        return problem_set(reterr, PROBLEM_BAD_REQUEST, "The argument %s is malformed.", name);
    return 0;
}

static int read_query(const struct call *call, struct list_query *ret, struct problem *reterr)
{
    struct store_filter *filter = &ret->filter;
    *filter = (struct store_filter){.owner = call->owner,
                                    .status = -1,
                                    .created_after_ms = -1,
                                    .before = INT64_MAX,
                                    .limit = LIST_DEFAULT};
    if (read_argument(call, "status", ret->status, sizeof ret->status, reterr) != 0 ||
        read_argument(call, "label", ret->label, sizeof ret->label, reterr) != 0 ||
        read_argument(call, "created_after", ret->created_after, sizeof ret->created_after, reterr) != 0 ||
        read_argument(call, "cursor", ret->cursor, sizeof ret->cursor, reterr) != 0 ||
        read_argument(call, "limit", ret->limit, sizeof ret->limit, reterr) != 0)
        return -1;
    if (ret->status[0] != '\0' && (filter->status = job_status_from_name(ret->status)) < 0)
        return problem_set(reterr, PROBLEM_BAD_REQUEST, "There is no such status.");
    if (ret->created_after[0] != '\0' && clock_parse(ret->created_after, &filter->created_after_ms) != 0)
        return problem_set(reterr, PROBLEM_BAD_REQUEST, "created_after must be a date-time as of RFC 3339.");
    if (ret->cursor[0] != '\0' && parse_cursor(ret->cursor, &filter->before) != 0)
        return problem_set(reterr, PROBLEM_BAD_CURSOR, "The cursor is not one that this server gave.");
    if (ret->limit[0] != '\0') {
        filter->limit = strtoul(ret->limit, NULL, 10);
        if (strspn(ret->limit, "0123456789") != strlen(ret->limit) || filter->limit < 1 ||
            filter->limit > LIST_MAX)
            return problem_set(reterr, PROBLEM_BAD_REQUEST, "The limit must be from 1 to %d.", LIST_MAX);
    }
    char *colon = strchr(ret->label, ':');
    if (ret->label[0] != '\0' && colon == NULL)
        return problem_set(reterr, PROBLEM_BAD_REQUEST, "A label is given as name:value.");
    if (colon != NULL) {
        *colon = '\0';
        filter->label_name = ret->label;
        filter->label_value = colon + 1;
    }
    return 0;
}

/* Appends text of an argument with everything but letters and digits escaped. */
static void write_escaped(FILE *out, const char *text)
{
    for (; *text != '\0'; text++) {
        unsigned char c = (unsigned char)*text;
        bool plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
        fprintf(out, plain ? "%c" : "%%%02X", c);
    }
}

static void add_next_link(struct http_answer *answer, const struct list_query *query, int64_t last)
{
    char link[2048];
    FILE *out = fmemopen(link, sizeof link, "w");
    if (out == NULL)
        return;
    fprintf(out, "</v1/jobs?cursor=c%" PRIx64 "&limit=%zu", (uint64_t)last, query->filter.limit);
    if (query->status[0] != '\0')
        fprintf(out, "&status=%s", query->status);
    if (query->filter.label_name != NULL) {
        fputs("&label=", out);
        write_escaped(out, query->filter.label_name);
        fputs("%3A", out);
        write_escaped(out, query->filter.label_value);
    }
    if (query->created_after[0] != '\0') {
        fputs("&created_after=", out);
        write_escaped(out, query->created_after);
    }
    fputs(">; rel=\"next\"", out);
    fclose(out);
    http_answer_header(answer, "Link", "%s", link);
}

void job_list(struct call *call)
{
    struct problem problem;
    struct list_query query;
    struct listing listing = {call->api, NULL, 0};
    struct memout memout;
    int64_t last;
    bool more;
    if (read_query(call, &query, &problem) != 0) {
        call_problem(call, &problem);
        return;
    }
    listing.out = memout_open(&memout);
    if (listing.out == NULL) {
        http_send(call->request, NULL);
        return;
    }
    fputs("{\"jobs\":[", listing.out);
    int failed = store_job_list(call->api->store, &query.filter, list_job, &listing, &last, &more, &problem);
    fputs("]}", listing.out);
    fclose(listing.out);
    char *text = memout_take(&memout, NULL);
    if (text == NULL && !failed)
        failed = problem_set(&problem, PROBLEM_INTERNAL, "Out of memory.");
    if (failed) {
        free(text);
        call_problem(call, &problem);
        return;
    }
    struct http_answer *answer = http_answer_text(200, "application/json", text);
    http_answer_header(answer, "Cache-Control", "no-cache");
    if (more)
        add_next_link(answer, &query, last);
    http_send(call->request, answer);
}

/* ---- results ----------------------------------------------------------------------------------------------
 */

#define MAX_REPRESENTATIONS 8

struct representation {
    const char *name, *type, *file;
};

static const struct representation result_table[] = {
    {"json", "application/json", OUTPUT_RESULT_JSON},
    {"glb", "model/gltf-binary", OUTPUT_RESULT_GLB},
    {"obj", "model/obj", OUTPUT_RESULT_OBJ},
    {"ply", "application/x-ply", OUTPUT_RESULT_PLY},
};

static const struct representation trace_table[] = {
    {"json", "application/json", OUTPUT_TRACE_JSON},
    {"csv", "text/csv", OUTPUT_TRACE_CSV},
    {"svg", "image/svg+xml", OUTPUT_TRACE_SVG},
};

/* By ?format=, else by Accept; NULL when none will do. */
static const struct representation *choose(const struct call *call, const struct representation *table,
                                           size_t count)
{
    char format[16];
    const char *type[MAX_REPRESENTATIONS];
    int given = http_query(call->request, "format", format, sizeof format);
    for (size_t i = 0; i < count; i++) {
        if (given == 0 && strcmp(format, table[i].name) == 0)
            return &table[i];
        type[i] = table[i].type;
    }
    if (given != 1)
        return NULL;
    int best = negotiate_accept(http_header(call->request, "Accept"), type, count);
    return best < 0 ? NULL : &table[best];
}

static void refuse_formats(struct call *call, const struct representation *table, size_t count)
{
    const char *name[MAX_REPRESENTATIONS], *type[MAX_REPRESENTATIONS];
    for (size_t i = 0; i < count; i++) {
        name[i] = table[i].name;
        type[i] = table[i].type;
    }
    represent_refuse(call, name, type, count);
}

/* The job when it has ended; otherwise answers, and is false. */
static bool find_ended(struct call *call, struct job *ret)
{
    struct problem problem;
    int found = store_job_get(call->api->store, call->owner, call->id, ret, &problem);
    if (found != 0) {
        job_refuse_unknown(call, found, &problem);
        return false;
    }
    if (job_status_ended(ret->status))
        return true;
    job_done(ret);
    call_refuse(call, PROBLEM_NOT_READY, "The job has not ended yet.");
    return false;
}

/* Opens the file in the coding that the client likes best of those that are there. 0; 1 when it has been
 * answered that none will do; STORE_NONE; or -1 with *reterr. */
static int open_representation(struct call *call, const struct job *job, const struct representation *r,
                               enum coding *ret_coding, int *ret_fd, uint64_t *ret_bytes,
                               struct problem *reterr)
{
    unsigned offered = (1u << CODINGS) - 1;
    for (;;) {
        char file[32];
        int coding = represent_choose(call, offered);
        if (coding < 0)
            return ANSWERED;
        const char *suffix = coding_suffix((enum coding)coding);
        snprintf(file, sizeof file, "%s%s%s", r->file, *suffix ? "." : "", suffix);
        int found = store_result_open(call->api->store, job->id, job->revision.attempt, file, ret_fd,
                                      ret_bytes, reterr);
        *ret_coding = (enum coding)coding;
        if (found != STORE_NONE || coding == CODING_IDENTITY)
            return found;
        offered &= ~CODING_BIT(coding);
    }
}

static void send_file(struct call *call, const struct job *job, const struct representation *r)
{
    struct problem problem;
    enum coding coding;
    uint64_t bytes;
    int fd, found = STORE_NONE;
    char tag[64];
    if (job->status == JOB_SUCCEEDED)
        found = open_representation(call, job, r, &coding, &fd, &bytes, &problem);
    if (found == ANSWERED)
        return;
    if (found > 0)
        problem_set(&problem, PROBLEM_NO_RESULT, "The job ended as %s, without a result.",
                    job_status_name(job->status));
    if (found != 0) {
        call_problem(call, &problem);
        return;
    }
    snprintf(tag, sizeof tag, "%s-%" PRIu32 "-%s", job->id, job->revision.attempt, r->name);
    struct representing as = {tag, coding, "Accept, Accept-Encoding", "no-cache"};
    represent_send(call, http_answer_file(200, r->type, fd, bytes), &as);
}

static void send_representation(struct call *call, const struct representation *table, size_t count)
{
    struct job job;
    if (!find_ended(call, &job))
        return;
    const struct representation *r = choose(call, table, count);
    if (r == NULL)
        refuse_formats(call, table, count);
    else
        send_file(call, &job, r);
    job_done(&job);
}

void job_result(struct call *call)
{
    send_representation(call, result_table, sizeof result_table / sizeof *result_table);
}

void job_trace(struct call *call)
{
    send_representation(call, trace_table, sizeof trace_table / sizeof *trace_table);
}

/* ---- the preview --------------------------------------------------------------------------------------- */

/* From memory while the job runs; the store only knows whether there is such a job. */
void job_preview(struct call *call)
{
    struct problem problem;
    struct revision revision;
    char *glb, *body, tag[SHA256_SIZE + 34];
    size_t bytes;
    bool ended;
    int found = queue_preview(call->api->queue, call->owner, call->id, &glb, &bytes, &revision);
    if (found == 0) {
        snprintf(tag, sizeof tag, "%s-%" PRIu32 ".%" PRIu32 "-preview", call->id, revision.attempt,
                 revision.counter);
        struct representing as = {tag, CODING_IDENTITY, "Accept", "no-cache"};
        represent_send(call, http_answer_bytes(200, "model/gltf-binary", glb, bytes), &as);
    } else if (found != QUEUE_NONE) {
        http_send(call->request, NULL);
    } else if ((found = job_look_up(call->api, call->owner, call->id, &body, &revision, &ended, &problem)) !=
               0) {
        job_refuse_unknown(call, found, &problem);
    } else {
        free(body);
        call_refuse(call, PROBLEM_NOT_FOUND,
                    ended ? "The job has ended: see its result." : "The job has no preview yet.");
    }
}
