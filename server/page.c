/* page.c - see page.h. */
#include "page.h"

#include <ctype.h>
#include <jansson.h>
#include <stdio.h>

#include "jsonin.h"
#include "memout.h"

static const char head[] =
    "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
    "<meta name=\"viewport\" content=\"width=device-width\">\n<title>draped</title>\n<style>\n"
    "body { font: 1rem/1.5 system-ui, sans-serif; max-width: 54rem; margin: 2rem auto; padding: 0 1rem; }\n"
    "table { border-collapse: collapse; } td { padding: .15rem 1rem .15rem 0; vertical-align: top; }\n"
    "code, pre { font-family: ui-monospace, monospace; } pre { padding: .6rem .8rem; overflow-x: auto;\n"
    "  border: 1px solid #8886; border-radius: .3rem; }\n"
    "dl { display: flex; gap: 2.5rem; } dt { opacity: .7; } dd { margin: 0; font-size: 1.6rem; }\n"
    "@media (prefers-color-scheme: dark) { body { background: #181a1b; color: #ddd; } a { color: #8bf; } }\n"
    "</style>\n</head>\n<body>\n<h1>draped</h1>\n"
    "<p>Finds how garments hang at rest: a pattern, its seams and a body go in, the drape comes out, with "
    "an\n"
    "account of how far it is from rest.</p>\n";

static const char documents[] =
    "<h2>Documents</h2>\n<ul>\n"
    "<li><a href=\"/openapi.json\">/openapi.json</a>: the interface (OpenAPI 3.1), every member and every\n"
    "refusal</li>\n"
    "<li><a href=\"/v1/info\">/v1/info</a>: version, limits, formats, methods</li>\n"
    "<li><a href=\"/v1/materials\">/v1/materials</a>: the fabrics known by name, each with its source</li>\n"
    "<li><a href=\"/v1/jobs\">/v1/jobs</a>: the jobs, newest first</li>\n</ul>\n"
    "<h2>A first drape</h2>\n"
    "<pre>drape example garment &gt; dress.json\n"
    "curl -H 'Content-Type: application/json' -H 'Prefer: wait=25' --data-binary @dress.json \\\n"
    "    \"$URL/v1/jobs\"                            # 202, or 200 once it has ended\n"
    "curl -N \"$URL/v1/jobs/$ID/events\"            # watch it\n"
    "curl \"$URL/v1/jobs/$ID/result?format=glb\" -o dress.glb</pre>\n"
    "<h2>The interface</h2>\n<table>\n";

static void put_escaped(FILE *out, const char *text)
{
    for (; *text != '\0'; text++) {
        switch (*text) {
        case '<':
            fputs("&lt;", out);
            break;
        case '&':
            fputs("&amp;", out);
            break;
        case '"':
            fputs("&quot;", out);
            break;
        default:
            fputc(*text, out);
        }
    }
}

static void put_fact(FILE *out, const char *name, size_t value)
{
    fprintf(out, "<div><dt>%s</dt><dd>%zu</dd></div>\n", name, value);
}

static void put_operation(FILE *out, const char *path, const char *method, const char *summary)
{
    fputs("<tr><td><code>", out);
    for (const char *p = method; *p != '\0'; p++)
        fputc(toupper((unsigned char)*p), out);
    fputs("</code></td><td><code>", out);
    put_escaped(out, path);
    fputs("</code></td><td>", out);
    put_escaped(out, summary);
    fputs("</td></tr>\n", out);
}

/* The operations of one path. */
static void put_path(FILE *out, const char *path, json_t *operations)
{
    const char *method;
    json_t *operation;
    json_object_foreach(operations, method, operation)
    {
        const char *summary = json_string_value(json_object_get(operation, "summary"));
        if (summary != NULL)
            put_operation(out, path, method, summary);
    }
}

static void put_paths(FILE *out, const json_t *openapi)
{
    const char *path;
    json_t *operations;
    json_object_foreach(json_object_get(openapi, "paths"), path, operations)
    {
        if (json_object_get(operations, "servers") == NULL) /* else it is answered elsewhere */
            put_path(out, path, operations);
    }
}

char *page_interface(const char *openapi, size_t openapi_bytes)
{
    struct memout memout;
    json_t *document = NULL;
    json_error_t error;
    FILE *out = jsonin_load(openapi, openapi_bytes, &document, &error) == 0 ? memout_open(&memout) : NULL;
    if (out != NULL) {
        put_paths(out, document);
        fclose(out);
    }
    json_decref(document);
    return out == NULL ? NULL : memout_take(&memout, NULL);
}

char *page_html(const struct page_facts *facts, const char *interface)
{
    struct memout memout;
    FILE *out = memout_open(&memout);
    if (out == NULL)
        return NULL;
    fputs(head, out);
    if (facts->counts) {
        fputs("<h2>Now</h2>\n<dl>\n", out);
        put_fact(out, "queued", facts->queued);
        put_fact(out, "running", facts->running);
        put_fact(out, "workers", facts->workers);
        put_fact(out, "event streams", facts->streams);
        fputs("</dl>\n", out);
    }
    fputs(documents, out);
    fputs(interface, out);
    fputs("</table>\n<p>Version ", out);
    put_escaped(out, facts->version);
    fputs("</p>\n</body>\n</html>\n", out);
    fclose(out);
    return memout_take(&memout, NULL);
}
