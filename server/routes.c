/* routes.c - see routes.h. */
#include "routes.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "api.h"
#include "cors.h"
#include "jsonout.h"
#include "log.h"
#include "meshfile.h"
#include "multipart.h"
#include "negotiate.h"

enum where { ON_LOOP = 0, ON_CLERK, ON_READER };
enum body { NO_BODY = 0, JOB_BODY, MESH_BODY }; /* each up to limits.body_bytes */

struct route {
    enum routes_side side;
    const char *method, *path; /* {id}: a job's; {sha256}: a mesh's */
    enum where where;
    enum body body;
    const char *gives;     /* the type of what it answers; NULL: the handler sees to that */
    const char *arguments; /* of its query, all that there are */
    call_fn *handler;
};

#define JSON       "application/json"
#define MESH_TYPES "model/obj, application/x-ply, model/gltf-binary, application/json"

static const struct route route_table[] = {
    {ROUTES_API, "POST", "/v1/jobs", ON_READER, JOB_BODY, JSON, "", job_post},
    {ROUTES_API, "GET", "/v1/jobs", ON_CLERK, NO_BODY, JSON, "status label created_after limit cursor",
     job_list},
    {ROUTES_API, "GET", "/v1/jobs/{id}", ON_LOOP, NO_BODY, JSON, "", job_get},
    {ROUTES_API, "DELETE", "/v1/jobs/{id}", ON_CLERK, NO_BODY, JSON, "", job_delete},
    {ROUTES_API, "GET", "/v1/jobs/{id}/events", ON_LOOP, NO_BODY, "text/event-stream", "", job_events},
    {ROUTES_API, "GET", "/v1/events", ON_CLERK, NO_BODY, "text/event-stream", NULL,
     jobs_events}, /* many jobs */
    {ROUTES_API, "GET", "/v1/jobs/{id}/result", ON_CLERK, NO_BODY, NULL, "format", job_result},
    {ROUTES_API, "GET", "/v1/jobs/{id}/preview", ON_CLERK, NO_BODY, "model/gltf-binary", "", job_preview},
    {ROUTES_API, "GET", "/v1/jobs/{id}/trace", ON_CLERK, NO_BODY, NULL, "format", job_trace},
    {ROUTES_API, "POST", "/v1/meshes", ON_READER, MESH_BODY, JSON, "", mesh_post},
    {ROUTES_API, "PUT", "/v1/meshes/{sha256}", ON_READER, MESH_BODY, JSON, "", mesh_put},
    {ROUTES_API, "GET", "/v1/meshes/{sha256}", ON_CLERK, NO_BODY, NULL, "format", mesh_get},
    {ROUTES_API, "DELETE", "/v1/meshes/{sha256}", ON_CLERK, NO_BODY, JSON, "", mesh_delete},
    {ROUTES_API, "GET", "/v1/materials", ON_LOOP, NO_BODY, JSON, "", about_materials},
    {ROUTES_API, "GET", "/v1/info", ON_LOOP, NO_BODY, JSON, "", about_info},
    {ROUTES_API, "GET", "/openapi.json", ON_LOOP, NO_BODY, JSON, "", about_openapi},
    {ROUTES_API, "GET", "/", ON_LOOP, NO_BODY, "text/html", "", about_root},
    {ROUTES_ADMIN, "GET", "/livez", ON_LOOP, NO_BODY, NULL, "", admin_livez},
    {ROUTES_ADMIN, "GET", "/readyz", ON_LOOP, NO_BODY, NULL, "", admin_readyz},
    {ROUTES_ADMIN, "GET", "/metrics", ON_LOOP, NO_BODY, NULL, "", admin_metrics},
};

#define ROUTES (sizeof route_table / sizeof *route_table)

/* Segment by segment, so that neither an escape nor a slash can hide in an id. */
static bool path_matches(const char *template, const char *path, char ret_id[SHA256_SIZE])
{
    ret_id[0] = '\0';
    while (*template != '\0') {
        size_t n = strcspn(path, "/");
        if (*template != '{') {
            if (*template ++ != *path++)
                return false;
            continue;
        }
        bool job = strncmp(template, "{id}", 4) == 0;
        if (n >= SHA256_SIZE)
            return false;
        memcpy(ret_id, path, n);
        ret_id[n] = '\0';
        if (job ? !id_valid(ret_id) : !sha256_valid(ret_id))
            return false;
        template += strcspn(template, "/");
        path += n;
    }
    return *path == '\0';
}

static bool method_matches(const struct route *route, const char *method)
{
    return strcmp(route->method, method) == 0 ||
           (strcmp(method, "HEAD") == 0 && strcmp(route->method, "GET") == 0);
}

/* The route, or NULL with the methods that the path would take in `allow` ("": no such path). */
static const struct route *find_route(enum routes_side side, const char *method, const char *path,
                                      char ret_id[SHA256_SIZE], char *allow, size_t allow_size)
{
    allow[0] = '\0';
    for (size_t i = 0; i < ROUTES; i++) {
        const struct route *route = &route_table[i];
        if (route->side != side || !path_matches(route->path, path, ret_id))
            continue;
        if (method_matches(route, method))
            return route;
        size_t n = strlen(allow);
        snprintf(allow + n, allow_size - n, "%s%s%s", n ? ", " : "", route->method,
                 strcmp(route->method, "GET") == 0 ? ", HEAD" : "");
    }
    if (strcmp(path, "*") == 0)
        snprintf(allow, allow_size, CORS_METHODS);
    if (allow[0] != '\0')
        strncat(allow, ", OPTIONS", allow_size - strlen(allow) - 1);
    return NULL;
}

/* ---- calls -------------------------------------------------------------------------------------- */

static void run_call(void *data)
{
    struct call *call = data;
    call->next(call);
}

bool call_try_pass(struct call *call, struct executor *executor, call_fn *next)
{
    call->next = next;
    return executor_submit(executor, run_call, call) == 0;
}

void call_pass(struct call *call, struct executor *executor, call_fn *next)
{
    if (!call_try_pass(call, executor, next))
        call_refuse(call, PROBLEM_BUSY, "Too many requests are being worked on.");
}

void call_defer(struct call *call, struct executor *executor, call_fn *next)
{
    http_suspend(call->request);
    call_pass(call, executor, next);
}

int call_body(struct call *call, const void **ret, size_t *ret_bytes, struct problem *reterr)
{
    enum coding coding = call->coding;
    call->coding = CODING_IDENTITY;
    if (coding != CODING_IDENTITY && http_decode_body(call->request, coding, reterr) != 0)
        return -1;
    if (http_body(call->request, ret, ret_bytes) != 0)
        return problem_set(reterr, PROBLEM_STORAGE, "The body could not be read: %s.", strerror(errno));
    return 0;
}

void call_problem(struct call *call, const struct problem *problem)
{
    struct http_answer *answer = http_answer_problem(call->request, problem);
    if (problem->code == PROBLEM_NOT_READY || problem->code == PROBLEM_KEY_IN_FLIGHT)
        http_answer_header(answer, "Retry-After", "1");
    if (problem->code == PROBLEM_ENCODING)
        http_answer_header(answer, "Accept-Encoding", CODING_LIST);
    if (problem->code == PROBLEM_MEDIA_TYPE)
        http_answer_header(answer, "Accept", "%s", call->route->body == JOB_BODY ? JSON : MESH_TYPES);
    http_send(call->request, answer);
}

void call_refuse(struct call *call, enum problem_code code, const char *format, ...)
{
    struct problem problem;
    char detail[sizeof problem.detail];
    va_list args;
    va_start(args, format);
    vsnprintf(detail, sizeof detail, format, args);
    va_end(args);
    problem_set(&problem, code, "%s", detail);
    call_problem(call, &problem);
}

struct http_answer *answer_json(int status, json_t *json)
{
    char *text = jsonout_text(json);
    return http_answer_text(status, "application/json", text);
}

/* ---- the callbacks of http ------------------------------------------------------------------------ */

static void refuse_route(struct call *call, const char *allow)
{
    struct problem problem;
    if (allow[0] == '\0')
        problem_set(&problem, PROBLEM_NOT_FOUND, "There is nothing at this path.");
    else
        problem_set(&problem, PROBLEM_METHOD_NOT_ALLOWED, "This path takes %s.", allow);
    struct http_answer *answer = http_answer_problem(call->request, &problem);
    if (allow[0] != '\0')
        http_answer_header(answer, "Allow", "%s", allow);
    http_send(call->request, answer);
}

/* Finds the owner; the documents of the interface are for everybody. Paths and methods that are none need a
 * key, too: what there is, is nobody else's business. A preflight cannot bring one. */
static bool authorized(enum routes_side side, struct call *call)
{
    if (call->api->keys == NULL || side != ROUTES_API || strcmp(http_method(call->request), "OPTIONS") == 0 ||
        (call->route != NULL &&
         (call->route->handler == about_root || call->route->handler == about_openapi)))
        return true;
    return keys_owner(call->api->keys, http_header(call->request, "Authorization"), call->owner);
}

static void refuse_stranger(struct call *call)
{
    bool given = http_header(call->request, "Authorization") != NULL;
    struct problem problem;
    problem_set(&problem, PROBLEM_UNAUTHORIZED,
                given ? "The key is not one of this server's." : "Send a key: Authorization: Bearer <key>.");
    struct http_answer *answer = http_answer_problem(call->request, &problem);
    /* RFC 6750, section 3: without credentials no error is told of. */
    http_answer_header(answer, "WWW-Authenticate", "Bearer%s", given ? " error=\"invalid_token\"" : "");
    http_send(call->request, answer);
}

static int read_key(struct call *call, const char *header, struct problem *reterr)
{
    if (idempotency_key_parse(header, call->key) == 0)
        return 0;
    return problem_set(reterr, PROBLEM_BAD_REQUEST,
                       "An Idempotency-Key is a string of 1 to %d visible ASCII characters.",
                       IDEMPOTENCY_KEY_SIZE - 1);
}

/* What can be refused before a body is read; 0, or -1 with *reterr. */
static int check_body_head(struct call *call, struct problem *reterr)
{
    const char *type = http_header(call->request, "Content-Type");
    const char *key = http_header(call->request, "Idempotency-Key");
    const char *name = http_header(call->request, "Content-Encoding");
    int coding = name == NULL ? CODING_IDENTITY : coding_from_name(name, strlen(name));
    if (coding < 0)
        return problem_set(reterr, PROBLEM_ENCODING,
                           "A body may have one of these encodings: " CODING_LIST ".");
    call->coding = (enum coding)coding;
    if (call->route->body == JOB_BODY) {
        if (!negotiate_is_type(type, "application/json"))
            return problem_set(reterr, PROBLEM_MEDIA_TYPE, "A job is application/json.");
        if (key != NULL)
            return read_key(call, key, reterr); /* what was accepted before is told however full it is now */
        if (health_has_space(&call->api->health, reterr) != 0)
            return -1;
        return queue_admits(call->api->queue, call->owner, reterr);
    }
    if (health_has_space(&call->api->health, reterr) != 0)
        return -1;
    if (strcmp(call->route->method, "POST") == 0) {
        char boundary[MULTIPART_BOUNDARY_SIZE];
        int form = multipart_boundary(type, boundary, reterr);
        if (form <= 0)
            return form;
    }
    if (type == NULL || mesh_format_from_media_type(type) < 0)
        return problem_set(reterr, PROBLEM_MEDIA_TYPE, "A mesh is one of: " MESH_TYPES ".");
    return 0;
}

/* ---- OPTIONS, and pages of other origins ----------------------------------------------------------------
 */

/* A preflight asks on behalf of a page, of any path and without a key. */
static bool is_preflight(const struct call *call)
{
    return http_header(call->request, "Access-Control-Request-Method") != NULL &&
           cors_allows(call->api->config->cors_origins, http_header(call->request, "Origin"));
}

static void answer_options(struct call *call)
{
    struct http_answer *answer = http_answer_empty(204);
    if (call->allow[0] != '\0')
        http_answer_header(answer, "Allow", "%s", call->allow);
    if (is_preflight(call)) {
        http_answer_header(answer, "Access-Control-Allow-Methods", CORS_METHODS);
        http_answer_header(answer, "Access-Control-Allow-Headers", CORS_HEADERS);
        http_answer_header(answer, "Access-Control-Max-Age", CORS_MAX_AGE);
    }
    http_send(call->request, answer);
}

static const struct route options_route = {ROUTES_API, "OPTIONS", "*",  ON_LOOP,
                                           NO_BODY,    NULL,      NULL, answer_options};

void routes_leaving(struct http_request *request, struct http_answer *answer, void *data)
{
    const struct routes *routes = data;
    const char *origins = routes->api->config->cors_origins, *origin = http_header(request, "Origin");
    if (routes->side != ROUTES_API || origins[0] == '\0')
        return;
    http_answer_header(answer, "Vary", "Origin");
    if (!cors_allows(origins, origin))
        return;
    http_answer_header(answer, "Access-Control-Allow-Origin", "%s", origin);
    http_answer_header(answer, "Access-Control-Expose-Headers", CORS_EXPOSED);
}

/* ---- requests --------------------------------------------------------------------------------------------
 */

struct arguments {
    const char *known; /* names with blanks between them */
    unsigned seen;     /* a bit for each of them that was given */
    char fault[96];
};

/* What we do not know we cannot heed, and a misspelt filter would list everything. */
static int check_argument(const char *name, void *data)
{
    struct arguments *arguments = data;
    unsigned bit = 1;
    for (const char *p = arguments->known; *p != '\0'; bit <<= 1) {
        size_t n = strcspn(p, " ");
        if (n == strlen(name) && memcmp(p, name, n) == 0) {
            if (arguments->seen & bit)
                snprintf(arguments->fault, sizeof arguments->fault, "The argument %s is given twice.", name);
            arguments->seen |= bit;
            return arguments->fault[0] != '\0';
        }
        p += n + strspn(p + n, " ");
    }
    snprintf(arguments->fault, sizeof arguments->fault, "There is no argument %.40s here.", name);
    return 1;
}

/* Whether the request makes sense for its route, before its body; 0, or -1 with *reterr. */
static int check_request(struct call *call, struct problem *reterr)
{
    const struct route *route = call->route;
    struct arguments arguments = {route->arguments, 0, ""};
    if (route->arguments != NULL && http_each_argument(call->request, check_argument, &arguments) != 0)
        return problem_set(reterr, PROBLEM_BAD_REQUEST, "%s", arguments.fault);
    if (route->gives != NULL && negotiate_accept(http_header(call->request, "Accept"), &route->gives, 1) < 0)
        return problem_set(reterr, PROBLEM_NOT_ACCEPTABLE, "This comes as %s.", route->gives);
    return route->body == NO_BODY ? 0 : check_body_head(call, reterr);
}

void routes_begin(struct http_request *request, void *data)
{
    const struct routes *routes = data;
    struct problem problem;
    struct call *call = calloc(1, sizeof *call);
    if (call == NULL) {
        http_send(request, NULL);
        return;
    }
    call->api = routes->api;
    call->request = request;
    http_set_context(request, call);
    call->route = find_route(routes->side, http_method(request), http_path(request), call->id, call->allow,
                             sizeof call->allow);
    if (strcmp(http_method(request), "OPTIONS") == 0 && (call->allow[0] != '\0' || is_preflight(call)))
        call->route = &options_route;
    if (!authorized(routes->side, call))
        refuse_stranger(call);
    else if (call->route == NULL)
        refuse_route(call, call->allow);
    else if (check_request(call, &problem) != 0)
        call_problem(call, &problem);
    else if (call->route->body != NO_BODY)
        http_expect_body(request, call->api->config->limits.body_bytes);
}

void routes_handle(struct http_request *request, void *data)
{
    struct call *call = http_context(request);
    (void)data;
    /* Not before the body is whole: of one that hung up half-way nobody would hear for a minute. */
    if (call->key[0] != '\0' && !claims_take(call->api->claims, &call->claim, call->owner, call->key))
        call_refuse(call, PROBLEM_KEY_IN_FLIGHT, "The first request with this key is still being worked on.");
    else if (call->route->where == ON_LOOP)
        call->route->handler(call);
    else if (call->route->where == ON_CLERK)
        call_defer(call, call->api->clerk, call->route->handler);
    else
        call_defer(call, call->api->reader, call->route->handler);
}

/* Methods become a label of the metrics: only known ones, lest a client invent thousands. */
static const char *known_method(const char *method)
{
    static const char *const known[] = {"GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS", "PATCH"};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcmp(method, known[i]) == 0)
            return known[i];
    return "other";
}

/* The job that a request was about; "": none. */
static const char *job_of(const struct call *call)
{
    return call == NULL ? "" : id_valid(call->id) ? call->id : call->job_id;
}

void routes_finished(struct http_request *request, int status, int64_t milliseconds, void *data)
{
    const struct routes *routes = data;
    struct call *call = http_context(request);
    const char *route = call != NULL && call->route != NULL ? call->route->path : "none";
    metrics_request(routes->api->metrics, route, known_method(http_method(request)), status);
    if (call == NULL || !call->untimed)
        metrics_observe(routes->api->metrics, METRIC_REQUEST_SECONDS, (double)milliseconds / 1000);
    log_event(status >= 500 ? LOG_LEVEL_WARNING : LOG_LEVEL_DEBUG, "http.request",
              "method=%s route=%s status=%d ms=%lld request=%s job=%s", known_method(http_method(request)),
              route, status, (long long)milliseconds, http_request_id(request), job_of(call));
    if (call != NULL)
        claims_release(routes->api->claims, &call->claim); /* of one that was never handled */
    free(call);
}
