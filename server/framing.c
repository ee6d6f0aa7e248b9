/* framing.c - see framing.h. */
#include "framing.h"

#include <stdint.h>
#include <string.h>
#include <strings.h>

/* A head has at most so many bytes (http.c bounds it lower): beyond, two texts lie in different places. */
#define MAX_HEAD ((uintptr_t)1 << 20)

/* Of a token (RFC 9110 section 5.6.2): of methods and of headers' names. */
static const char token_bytes[] =
    "!#$%&'*+-.^_`|~0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";

static const char host_bytes[] = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ-._~";

/* What is no list (RFC 9110 section 5.3), and would be heeded. */
static const char *const single_headers[] = {"Authorization", "Content-Type", "Idempotency-Key"};

static void find_fault(struct framing *f, bool faulty, enum problem_code code, const char *fault)
{
    if (!faulty || f->fault != NULL)
        return;
    f->code = code;
    f->fault = fault;
}

static void find_bad(struct framing *f, bool faulty, const char *fault)
{
    find_fault(f, faulty, PROBLEM_BAD_REQUEST, fault);
}

/* Only visible ASCII: neither blanks nor control characters nor what is not ASCII. */
static bool is_visible(const char *text)
{
    for (; *text != '\0'; text++)
        if ((unsigned char)*text <= ' ' || (unsigned char)*text >= 0x7f)
            return false;
    return true;
}

void framing_target(struct framing *f, bool in_place, const char *target)
{
    *f = (struct framing){.in_place = in_place, .target = target, .target_bytes = strlen(target)};
    find_bad(f, !is_visible(target), "The request target has blanks or characters that must be escaped.");
}

void framing_line(struct framing *f, const char *method, const char *version)
{
    f->http_1_0 = strcmp(version, "HTTP/1.0") == 0;
    find_bad(f, method[strspn(method, token_bytes)] != '\0', "A method has letters only.");
    find_bad(f,
             f->in_place &&
                 (method + strlen(method) + 1 != f->target || f->target + f->target_bytes + 1 != version),
             "The request line is not three words, each one blank apart.");
    f->start = method;
    f->at = version + strlen(version) + 2;
}

/* ---- headers ------------------------------------------------------------------------------------------ */

/* Whether a name and its value lie as in "name: value". */
static bool are_together(const char *name, size_t name_bytes, const char *value)
{
    uintptr_t end = (uintptr_t)(name + name_bytes + 1);
    if ((uintptr_t)value < end || (uintptr_t)value - end > MAX_HEAD)
        return false;
    for (const char *p = name + name_bytes + 1; p != value; p++)
        if (*p != ' ' && *p != '\t')
            return false;
    return true;
}

static bool has_controls(const char *value, size_t bytes)
{
    for (size_t i = 0; i < bytes; i++)
        if (((unsigned char)value[i] < ' ' && value[i] != '\t') || value[i] == 0x7f)
            return true;
    return false;
}

/* A name or an address in brackets, and perhaps a port. */
static bool is_host(const char *value)
{
    size_t n = *value == '[' ? strspn(value + 1, "0123456789abcdefABCDEF:.") + 1 : strspn(value, host_bytes);
    if (*value == '[' && value[n++] != ']')
        return false;
    if (n == 0)
        return false;
    value += n;
    if (*value == ':')
        value += 1 + strspn(value + 1, "0123456789");
    return *value == '\0';
}

static void check_single(struct framing *f, const char *name)
{
    for (unsigned i = 0; i < sizeof single_headers / sizeof *single_headers; i++) {
        if (strcasecmp(name, single_headers[i]) != 0)
            continue;
        find_bad(f, (f->seen & 1u << i) != 0,
                 "Authorization, Content-Type and Idempotency-Key may be given once each.");
        f->seen |= 1u << i;
    }
}

void framing_header(struct framing *f, const char *name, size_t name_bytes, const char *value,
                    size_t value_bytes)
{
    find_bad(f, name_bytes == 0 || strspn(name, token_bytes) != name_bytes,
             "A header's name has characters that no name has.");
    find_bad(f, has_controls(value, value_bytes), "A header's value has control characters.");
    find_bad(f, f->in_place && (name != f->at || !are_together(name, name_bytes, value)),
             "A line of the head is folded, has a NUL, or does not end in CR LF.");
    check_single(f, name);
    f->at = value + value_bytes + 2;
    if (strcasecmp(name, "Content-Length") == 0) {
        f->content_lengths++;
        find_bad(f, value_bytes == 0 || strspn(value, "0123456789") != value_bytes,
                 "Content-Length must be one number.");
    } else if (strcasecmp(name, "Transfer-Encoding") == 0) {
        f->transfer_encodings++;
        find_bad(f, f->http_1_0 || strcasecmp(value, "chunked") != 0,
                 "The only transfer encoding understood is chunked, in HTTP/1.1.");
    } else if (strcasecmp(name, "Host") == 0) {
        f->hosts++;
        f->host = value;
        find_bad(f, !is_host(value), "Host must be a name or an address, and perhaps a port.");
    } else if (strcasecmp(name, "Expect") == 0) {
        find_fault(f, strcasecmp(value, "100-continue") != 0, PROBLEM_EXPECTATION,
                   "The only expectation that can be met is 100-continue.");
    }
}

const char *framing_end(struct framing *f, size_t bytes, enum problem_code *ret_code, bool *ret_body)
{
    find_bad(f, f->in_place && f->start + bytes != f->at + 2,
             "A line of the head is folded, has a NUL, or does not end in CR LF.");
    find_bad(f, f->content_lengths > 1, "Content-Length must be one number.");
    find_bad(f, f->transfer_encodings > 1, "Transfer-Encoding must be given once.");
    find_bad(f, f->content_lengths > 0 && f->transfer_encodings > 0,
             "Content-Length and Transfer-Encoding exclude each other.");
    find_bad(f, f->hosts > 1 || (f->hosts == 0 && !f->http_1_0), "There must be one Host header.");
    *ret_code = f->code;
    *ret_body = f->content_lengths + f->transfer_encodings > 0;
    return f->fault;
}

/* ---- targets ------------------------------------------------------------------------------------------ */

const char *framing_path(const char *method, const char *target, const char *host)
{
    if (*target == '/' || (strcmp(target, "*") == 0 && strcmp(method, "OPTIONS") == 0))
        return target;
    if (host == NULL || strncasecmp(target, "http://", 7) != 0)
        return NULL;
    target += 7;
    size_t n = strcspn(target, "/");
    if (n != strlen(host) || strncasecmp(target, host, n) != 0)
        return NULL;
    return target[n] == '\0' ? "/" : target + n;
}
