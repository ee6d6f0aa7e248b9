/* problem.c - see problem.h. */
#include "problem.h"

#include <jansson.h>
#include <string.h>

/* What to try next, by the problem's code; a code the table does not know falls back on its status. */
static const struct advice {
    const char *code;
    long status;
    const char *text;
} advice_table[] = {
    {"queue-full", 0, "wait, then submit again; `drape list --status queued` shows what is ahead"},
    {"draining", 0, "the server is shutting down: wait until it is back, then ask again"},
    {"busy", 0, "ask again in a moment"},
    {"too-many-streams", 0, "use `drape status ID --wait`, or close another `drape watch`"},
    {"storage", 0, "look at the free space of the server's data folder"},
    {"not-ready", 0, "`drape watch ID` waits for the end"},
    {"no-result", 0, "`drape status ID` says why the job ended without one"},
    {"not-found", 0, "`drape list` shows the jobs this server knows"},
    {"gone", 0, "the job was removed: submit it again"},
    {"too-large", 0, "use a coarser mesh; GET /v1/info shows the server's limits"},
    {"body-too-large", 0, "use a coarser mesh; GET /v1/info shows the server's limits"},
    {"unsupported", 0, "leave the member out, or set it to what the detail names"},
    {"invalid", 0, "correct the member named above and submit again"},
    {"bad-json", 0, "check the file with `jq . FILE`"},
    {"quota-queued", 0, "wait for some of your jobs; `drape list --status queued` shows them"},
    {"quota-meshes", 0, "remove meshes that no job needs any more"},
    {"too-large-memory", 0, "use a coarser mesh; GET /v1/info shows the server's limits"},
    {"", 401, "give a key with --key-file, DRAPED_KEY_FILE or DRAPED_KEY"},
    {"", 403, "use a key that may do this"},
    {"", 404, "check the id; `drape list` shows the jobs this server knows, and --url which server is asked"},
    {"", 413, "use a coarser mesh; GET /v1/info shows the server's limits"},
    {"", 429, "ask again later"},
    {"", 500, "the server's log has more under the request id"},
    {"", 502, "the server behind this address may be down: ask again later"},
    {"", 503, "ask again later"},
    {NULL, 0, NULL},
};

static const char *find_advice(const char *code, long status)
{
    for (const struct advice *a = advice_table; a->code; a++) {
        if (a->code[0] ? strcmp(a->code, code) == 0 : a->status == status) {
            return a->text;
        }
    }
    return NULL;
}

static const char *member(const json_t *object, const char *key)
{
    const char *text = json_string_value(json_object_get(object, key));
    return text ? text : "";
}

/* The entries of errors[], unless the only one is what the detail says already. */
static void add_errors(const json_t *problem, struct failure *failure)
{
    size_t i;
    json_t *error;
    const json_t *errors = json_object_get(problem, "errors");
    const char *detail = member(problem, "detail");
    json_array_foreach(errors, i, error)
    {
        const char *pointer = member(error, "pointer"), *text = member(error, "detail");
        if (json_array_size(errors) == 1 && strstr(detail, pointer) && strstr(detail, text)) {
            return;
        }
        failure_add(failure, "  at %s: %s", pointer[0] ? pointer : "the whole document", text);
    }
}

int problem_explain(const struct http_reply *reply, const char *what, struct failure *failure)
{
    json_t *problem = json_loadb(reply->body, reply->bytes, 0, NULL);
    const char *title = member(problem, "title"), *code = member(problem, "code");
    const char *id = member(problem, "request_id");
    failure_set(failure, EXIT_REFUSED, "the server refused %s: %s (%ld%s%s)", what,
                title[0] ? title : "no reason given", reply->status, code[0] ? " " : "", code);
    if (member(problem, "detail")[0]) {
        failure_add(failure, "  %s", member(problem, "detail"));
    }
    add_errors(problem, failure);
    const char *advice = find_advice(code, reply->status);
    if (advice) {
        failure_add(failure, "try: %s", advice);
    }
    if (reply->retry_after[0]) {
        failure_add(failure, "the server suggests to wait %s s", reply->retry_after);
    }
    id = id[0] ? id : reply->request_id;
    if (id[0]) {
        failure_add(failure, "request id: %s", id);
    }
    json_decref(problem);
    return -1;
}

int problem_send(struct http *http, const struct http_request *request, const char *what,
                 struct http_reply *reply, struct failure *failure)
{
    if (http_send(http, request, reply, failure) < 0) {
        return -1;
    }
    return reply->status >= 400 ? problem_explain(reply, what, failure) : 0;
}
