/* http.c - requests over one libcurl handle; see http.h. */
#include "http.h"

#include <curl/curl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "interrupt.h"

#define CONNECT_TIMEOUT_S 10L
#define SILENCE_S         60L

struct http {
    CURL *curl;
    char *url, *authorization; /* authorization: the whole header line, or NULL */
};

struct transfer {
    struct http *http;
    const struct http_request *request;
    struct http_reply *reply;
    size_t capacity; /* of reply->body */
    bool too_large, no_memory, ended_by_sink;
};

/* The header line that carries a key; NULL when out of memory. */
static char *authorization_line(const char *key)
{
    char *line = NULL;
    return asprintf(&line, "Authorization: Bearer %s", key) < 0 ? NULL : line;
}

int http_new(const char *url, const char *key, struct http **ret, struct failure *failure)
{
    if (strncasecmp(url, "http://", 7) != 0 && strncasecmp(url, "https://", 8) != 0) {
        return failure_set(failure, EXIT_USAGE,
                           "the server URL must begin with http:// or https://, not \"%s\"", url);
    }
    struct http *http = calloc(1, sizeof *http);
    if (!http || curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) {
        free(http);
        return failure_no_memory(failure);
    }
    http->curl = curl_easy_init();
    http->url = strdup(url);
    http->authorization = key ? authorization_line(key) : NULL;
    if (!http->curl || !http->url || (key && !http->authorization)) {
        http_free(http);
        return failure_no_memory(failure);
    }
    for (size_t n = strlen(http->url); n > 0 && http->url[n - 1] == '/'; n--) {
        http->url[n - 1] = '\0';
    }
    *ret = http;
    return 0;
}

struct http *http_free(struct http *http)
{
    if (http) {
        curl_easy_cleanup(http->curl);
        free(http->url);
        free(http->authorization);
        free(http);
        curl_global_cleanup();
    }
    return NULL;
}

const char *http_url(const struct http *http)
{
    return http->url;
}

void http_reply_done(struct http_reply *reply)
{
    free(reply->body);
    *reply = (struct http_reply){0};
}

/* ---- what libcurl calls -------------------------------------------------------------------------- */

static int keep_body(struct transfer *transfer, const char *data, size_t bytes)
{
    struct http_reply *reply = transfer->reply;
    if (bytes > HTTP_MAX_BODY - reply->bytes) {
        transfer->too_large = true;
        return -1;
    }
    if (reply->bytes + bytes + 1 > transfer->capacity) {
        size_t capacity = 2 * (reply->bytes + bytes) + 1;
        char *body = realloc(reply->body, capacity);
        if (!body) {
            transfer->no_memory = true;
            return -1;
        }
        reply->body = body;
        transfer->capacity = capacity;
    }
    memcpy(reply->body + reply->bytes, data, bytes);
    reply->bytes += bytes;
    reply->body[reply->bytes] = '\0';
    return 0;
}

/* Returning another number than it was given makes libcurl end the transfer. */
static size_t on_body(char *data, size_t size, size_t count, void *user)
{
    struct transfer *transfer = user;
    size_t bytes = size * count;
    long status = 0;
    curl_easy_getinfo(transfer->http->curl, CURLINFO_RESPONSE_CODE, &status);
    if (transfer->request->sink && status == 200) {
        transfer->ended_by_sink = transfer->request->sink(data, bytes, transfer->request->user) != 0;
        return transfer->ended_by_sink ? 0 : bytes;
    }
    return keep_body(transfer, data, bytes) < 0 ? 0 : bytes;
}

/* Copies the value of header `name` when the line is that header. */
static void take_header(const char *line, size_t bytes, const char *name, char *value, size_t size)
{
    size_t n = strlen(name);
    if (bytes <= n || strncasecmp(line, name, n) != 0 || line[n] != ':') {
        return;
    }
    const char *from = line + n + 1, *end = line + bytes;
    while (from < end && (*from == ' ' || *from == '\t')) {
        from++;
    }
    while (end > from && (end[-1] == '\r' || end[-1] == '\n' || end[-1] == ' ')) {
        end--;
    }
    snprintf(value, size, "%.*s", (int)(end - from), from);
}

static size_t on_header(char *line, size_t size, size_t count, void *user)
{
    struct http_reply *reply = ((struct transfer *)user)->reply;
    size_t bytes = size * count;
    take_header(line, bytes, "Content-Type", reply->content_type, sizeof reply->content_type);
    take_header(line, bytes, "X-Request-Id", reply->request_id, sizeof reply->request_id);
    take_header(line, bytes, "Retry-After", reply->retry_after, sizeof reply->retry_after);
    take_header(line, bytes, "Link", reply->link, sizeof reply->link);
    return bytes;
}

static int on_progress(void *user, curl_off_t a, curl_off_t b, curl_off_t c, curl_off_t d)
{
    (void)user, (void)a, (void)b, (void)c, (void)d;
    return interrupt_seen();
}

/* ---- one request --------------------------------------------------------------------------------- */

/* Adds "name: value" unless the value is NULL; false when out of memory. */
static bool add_header(struct curl_slist **list, const char *name, const char *value)
{
    char *line = NULL;
    if (!value) {
        return true;
    }
    if (asprintf(&line, "%s: %s", name, value) < 0) {
        return false;
    }
    struct curl_slist *longer = curl_slist_append(*list, line);
    free(line);
    *list = longer ? longer : *list;
    return longer != NULL;
}

static bool add_headers(struct curl_slist **list, const struct http *http, const struct http_request *request)
{
    if (http->authorization) {
        struct curl_slist *longer = curl_slist_append(*list, http->authorization);
        if (!longer) {
            return false;
        }
        *list = longer;
    }
    /* "Expect: 100-continue" costs a second where a proxy ignores it */
    return add_header(list, "Content-Type", request->body ? "application/json" : NULL) &&
           add_header(list, "Expect", request->body ? "" : NULL) &&
           add_header(list, "Accept", request->accept) && add_header(list, "Prefer", request->prefer) &&
           add_header(list, "Last-Event-ID", request->last_event_id);
}

static void set_options(struct transfer *transfer, const char *url, struct curl_slist *headers)
{
    CURL *curl = transfer->http->curl;
    const struct http_request *request = transfer->request;
    curl_easy_reset(curl);
    curl_easy_setopt(curl, CURLOPT_URL, url);
    curl_easy_setopt(curl, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(curl, CURLOPT_USERAGENT, "drape");
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_CONNECTTIMEOUT, CONNECT_TIMEOUT_S);
    curl_easy_setopt(curl, CURLOPT_LOW_SPEED_LIMIT, 1L);
    curl_easy_setopt(curl, CURLOPT_LOW_SPEED_TIME, request->silence_s > 0 ? request->silence_s : SILENCE_S);
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, headers);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, on_body);
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, transfer);
    curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, on_header);
    curl_easy_setopt(curl, CURLOPT_HEADERDATA, transfer);
    curl_easy_setopt(curl, CURLOPT_XFERINFOFUNCTION, on_progress);
    curl_easy_setopt(curl, CURLOPT_NOPROGRESS, 0L);
    if (request->body) {
        curl_easy_setopt(curl, CURLOPT_POST, 1L);
        curl_easy_setopt(curl, CURLOPT_POSTFIELDS, request->body);
        curl_easy_setopt(curl, CURLOPT_POSTFIELDSIZE_LARGE, (curl_off_t)request->bytes);
    }
    curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, request->method);
}

static int explain_transport(const struct transfer *transfer, CURLcode code, const char *detail,
                             struct failure *failure)
{
    const char *url = transfer->http->url;
    if (interrupt_seen()) {
        return failure_set(failure, EXIT_INTERRUPTED, "interrupted");
    }
    if (transfer->no_memory || code == CURLE_OUT_OF_MEMORY) {
        return failure_no_memory(failure);
    }
    if (transfer->too_large) {
        return failure_set(failure, EXIT_LOCAL, "the answer is longer than %zu MiB", HTTP_MAX_BODY >> 20);
    }
    failure_set(failure, EXIT_UNREACHABLE, "cannot reach the server at %s: %s", url,
                detail[0] ? detail : curl_easy_strerror(code));
    if (code == CURLE_COULDNT_CONNECT || code == CURLE_COULDNT_RESOLVE_HOST) {
        failure_add(failure, "try: start it with `draped`, or name another with --url or DRAPED_URL");
    } else if (code == CURLE_OPERATION_TIMEDOUT) {
        failure_add(failure, "try: ask again; if it stays silent, look at the server's log");
    }
    return -1;
}

int http_send(struct http *http, const struct http_request *request, struct http_reply *reply,
              struct failure *failure)
{
    int status = -1;
    char *url = NULL, detail[CURL_ERROR_SIZE] = "";
    struct curl_slist *headers = NULL;
    struct transfer transfer = {.http = http, .request = request, .reply = reply};
    *reply = (struct http_reply){0};
    /* an empty body to begin with: one that never comes reads as "" */
    if (asprintf(&url, "%s%s", http->url, request->path) < 0 || keep_body(&transfer, "", 0) < 0 ||
        !add_headers(&headers, http, request)) {
        failure_no_memory(failure);
        goto cleanup;
    }
    set_options(&transfer, url, headers);
    curl_easy_setopt(http->curl, CURLOPT_ERRORBUFFER, detail);
    CURLcode code = curl_easy_perform(http->curl);
    curl_easy_setopt(http->curl, CURLOPT_ERRORBUFFER, NULL);
    if (code != CURLE_OK && !transfer.ended_by_sink) {
        explain_transport(&transfer, code, detail, failure);
        goto cleanup;
    }
    curl_easy_getinfo(http->curl, CURLINFO_RESPONSE_CODE, &reply->status);
    status = 0;
cleanup:
    curl_slist_free_all(headers);
    free(url);
    return status;
}
