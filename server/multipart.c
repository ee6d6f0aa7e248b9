/* multipart.c - see multipart.h. */
#include "multipart.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#define ALPHANUMERIC "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
#define TOKEN        ALPHANUMERIC "!#$%&'*+-.^_`|~" /* RFC 9110 section 5.6.2 */
#define BOUNDARY     ALPHANUMERIC "'()+_,-./:=? "   /* RFC 2046 section 5.1.1 */
#define BLANKS       " \t"

/* ---- parameters of a header's value ------------------------------------------------------------------ */

/* A token or a quoted string at **at, moved behind it. What does not fit loses its beginning, where a
 * filename's folders are. -1: it is neither. */
static int take_value(const char **at, char *ret, size_t size)
{
    const char *p = *at;
    bool quoted = *p == '"';
    size_t n = 0;
    p += quoted;
    while (quoted ? *p != '\0' && *p != '"' : *p != '\0' && strchr(TOKEN, *p) != NULL) {
        if (quoted && *p == '\\' && p[1] != '\0')
            p++;
        if (n + 1 == size) {
            memmove(ret, ret + 1, n - 1);
            n--;
        }
        ret[n++] = *p++;
    }
    ret[n] = '\0';
    if (quoted ? *p != '"' : p == *at)
        return -1;
    *at = p + quoted;
    return 0;
}

/* The next `; name=value` at **at: 1, 0 at the end, -1 when it is malformed. A name too long is none of ours.
 */
static int take_parameter(const char **at, char *name, size_t name_size, char *value, size_t value_size)
{
    const char *p = *at + strspn(*at, BLANKS);
    if (*p == '\0')
        return 0;
    if (*p++ != ';')
        return -1;
    p += strspn(p, BLANKS);
    size_t n = strspn(p, TOKEN);
    if (n == 0 || p[n] != '=')
        return -1;
    snprintf(name, name_size, "%.*s", n < name_size ? (int)n : 0, p);
    *at = p + n + 1;
    return take_value(at, value, value_size) == 0 ? 1 : -1;
}

static bool is_boundary(const char *text)
{
    size_t n = strlen(text);
    return n > 0 && n < MULTIPART_BOUNDARY_SIZE && strspn(text, BOUNDARY) == n && text[n - 1] != ' ';
}

int multipart_boundary(const char *content_type, char ret[MULTIPART_BOUNDARY_SIZE], struct problem *reterr)
{
    static const char type[] = "multipart/form-data";
    char name[16], value[MULTIPART_BOUNDARY_SIZE + 1]; /* + 1: one that is too long shows */
    size_t found = 0;
    int more;
    if (content_type == NULL || strncasecmp(content_type, type, sizeof type - 1) != 0)
        return 1;
    const char *at = content_type + sizeof type - 1;
    if (*at != '\0' && strchr("; \t", *at) == NULL)
        return 1;
    while ((more = take_parameter(&at, name, sizeof name, value, sizeof value)) > 0)
        if (strcasecmp(name, "boundary") == 0) {
            found++;
            if (!is_boundary(value))
                more = -1;
            else
                memcpy(ret, value, strlen(value) + 1);
            if (more < 0)
                break;
        }
    if (more < 0 || found != 1)
        return problem_set(reterr, PROBLEM_BAD_REQUEST,
                           "Content-Type: multipart/form-data needs one boundary of 1 to 70 characters.");
    return 0;
}

/* ---- the body --------------------------------------------------------------------------------------- */

struct body {
    const char *start, *at, *end;
    char dash_boundary[MULTIPART_BOUNDARY_SIZE + 4]; /* CRLF, two dashes, the boundary */
    size_t dash_bytes;
    struct problem *reterr;
};

static int refuse(const struct body *body, const char *at, const char *why)
{
    return problem_set(body->reterr, PROBLEM_BAD_REQUEST, "Byte %zu of the form: %s.",
                       (size_t)(at - body->start), why);
}

/* What a line that begins with the boundary is, by what follows it at `p`: 1 it opens a part, 2 it ends the
 * body, 0 it is no boundary; *ret is moved behind it. RFC 2046 lets blanks follow. */
static int boundary_kind(const struct body *body, const char *p, const char **ret)
{
    int kind = 1;
    if (body->end - p >= 2 && p[0] == '-' && p[1] == '-') {
        kind = 2;
        p += 2;
    }
    while (p < body->end && (*p == ' ' || *p == '\t'))
        p++;
    if (body->end - p >= 2 && p[0] == '\r' && p[1] == '\n')
        p += 2;
    else if (kind == 1 || p != body->end)
        return 0;
    *ret = p;
    return kind;
}

/* The first line: the boundary without the CRLF before it. */
static int take_first(struct body *body)
{
    const char *start = body->at;
    size_t n = body->dash_bytes - 2;
    if ((size_t)(body->end - start) < n || memcmp(start, body->dash_boundary + 2, n) != 0 ||
        boundary_kind(body, start + n, &body->at) != 1)
        return refuse(body, start, "it must begin with the boundary that Content-Type names");
    return 0;
}

/* One line of the part's header, without its CRLF, in `line`; 1, 0 for the empty one, or -1. */
static int take_line(struct body *body, const char *limit, char *line, size_t size)
{
    const char *cr = memmem(body->at, (size_t)(limit - body->at), "\r\n", 2);
    if (cr == NULL)
        return refuse(body, body->at,
                      limit < body->end ? "the part's header is too long" : "the part's header does not end");
    for (const char *p = body->at; p < cr; p++)
        if (((unsigned char)*p < ' ' && *p != '\t') || *p == 0x7f)
            return refuse(body, p, "a control character in the part's header");
    snprintf(line, size, "%.*s", (int)(cr - body->at), body->at);
    body->at = cr + 2;
    return line[0] != '\0';
}

static int take_disposition(const struct body *body, const char *at, const char *value,
                            struct multipart_file *ret)
{
    char name[16], text[sizeof ret->filename];
    bool named = false;
    int more = -1;
    if (strncasecmp(value, "form-data", 9) == 0) {
        value += 9;
        while ((more = take_parameter(&value, name, sizeof name, text, sizeof text)) > 0) {
            named |= strcasecmp(name, "name") == 0;
            if (strcasecmp(name, "filename") == 0)
                memcpy(ret->filename, text, sizeof text);
        }
    }
    if (more < 0 || !named)
        return refuse(body, at, "Content-Disposition must be form-data with a name");
    return 0;
}

static int take_encoding(const struct body *body, const char *at, const char *value)
{
    static const char *const known[] = {"binary", "8bit", "7bit"};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (strcasecmp(value, known[i]) == 0)
            return 0;
    return refuse(body, at, "the part must come as it is, without Content-Transfer-Encoding");
}

static int take_field(const struct body *body, const char *at, char *line, bool *disposed,
                      struct multipart_file *ret)
{
    size_t n = strspn(line, TOKEN);
    if (n == 0 || line[n] != ':')
        return refuse(body, at, "no header");
    line[n] = '\0';
    char *value = line + n + 1;
    value += strspn(value, BLANKS);
    for (size_t end = strlen(value); end > 0 && strchr(BLANKS, value[end - 1]) != NULL; end--)
        value[end - 1] = '\0';
    if (strcasecmp(line, "Content-Transfer-Encoding") == 0)
        return take_encoding(body, at, value);
    if (strcasecmp(line, "Content-Type") == 0) {
        if (ret->type[0] != '\0' || strlen(value) >= sizeof ret->type)
            return refuse(body, at, "Content-Type is given twice, or too long");
        memcpy(ret->type, value, strlen(value) + 1);
    } else if (strcasecmp(line, "Content-Disposition") == 0) {
        if (*disposed)
            return refuse(body, at, "Content-Disposition is given twice");
        *disposed = true;
        return take_disposition(body, at, value, ret);
    }
    return 0;
}

static int take_header(struct body *body, struct multipart_file *ret)
{
    char line[MULTIPART_MAX_HEADERS + 1];
    const char *start = body->at, *limit = body->end, *at;
    bool disposed = false;
    int more;
    if (limit - start > MULTIPART_MAX_HEADERS)
        limit = start + MULTIPART_MAX_HEADERS;
    while (at = body->at, (more = take_line(body, limit, line, sizeof line)) > 0)
        if (take_field(body, at, line, &disposed, ret) != 0)
            return -1;
    if (more == 0 && !disposed)
        return refuse(body, start, "a part without Content-Disposition");
    return more;
}

/* Up to the next boundary, of which the CRLF before it is a part. 1: a part follows, 2: the body ends, -1. */
static int take_data(struct body *body, struct multipart_file *ret)
{
    ret->data = body->at;
    for (const char *p = body->at;; p += 2) {
        p = memmem(p, (size_t)(body->end - p), body->dash_boundary, body->dash_bytes);
        if (p == NULL)
            return refuse(body, body->end, "the last boundary is missing");
        int kind = boundary_kind(body, p + body->dash_bytes, &body->at);
        if (kind == 0)
            continue; /* as the data have it */
        ret->bytes = (size_t)(p - ret->data);
        return kind;
    }
}

int multipart_parse(const char *data, size_t bytes, const char *boundary, struct multipart_file *ret,
                    struct problem *reterr)
{
    struct body body = {.start = data, .at = data, .end = data + bytes, .reterr = reterr};
    body.dash_bytes = (size_t)snprintf(body.dash_boundary, sizeof body.dash_boundary, "\r\n--%s", boundary);
    *ret = (struct multipart_file){0};
    if (take_first(&body) != 0 || take_header(&body, ret) != 0)
        return -1;
    int kind = take_data(&body, ret);
    if (kind == 1)
        return refuse(&body, body.at, "a second part; one file is taken");
    if (kind == 2 && body.at != body.end)
        return refuse(&body, body.at, "something behind the last boundary");
    return kind == 2 ? 0 : -1;
}
