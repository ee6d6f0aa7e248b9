/* api_about.c - what the daemon says of itself: information, materials, documents, health, metrics. */
#include "api.h"

#include <stdlib.h>
#include <string.h>

#include "assets.h"
#include "clock.h"
#include "drape.h"
#include "jsonout.h"
#include "meshfile.h"
#include "page.h"
#include "represent.h"
#include "schema.h"

static json_t *limits_json(const struct limits *limits)
{
    return json_pack(
        "{s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:f, s:I, s:I, s:I, s:I, s:I, s:I, "
        "s:I, s:I, "
        "s:i}",
        "body_bytes", (json_int_t)limits->body_bytes, "json_depth", (json_int_t)limits->json_depth,
        "json_values", (json_int_t)limits->json_values, "vertices", (json_int_t)limits->vertices, "triangles",
        (json_int_t)limits->triangles, "bodies", (json_int_t)limits->bodies, "materials",
        (json_int_t)limits->materials, "lines", (json_int_t)limits->lines, "line_vertices",
        (json_int_t)limits->line_vertices, "name_bytes", (json_int_t)limits->name_bytes, "labels",
        (json_int_t)limits->labels, "max_iterations", (json_int_t)limits->max_iterations, "time_limit_s",
        limits->time_limit_s, "memory", (json_int_t)limits->memory, "job_memory",
        (json_int_t)limits->job_memory, "queued_jobs", (json_int_t)limits->queued_jobs, "connections",
        (json_int_t)limits->connections, "streams", (json_int_t)limits->streams, "streams_per_key",
        (json_int_t)limits->streams_per_key, "stream_jobs", (json_int_t)limits->stream_jobs, "reading",
        (json_int_t)limits->reading, "wait_s", WAIT_MAX_S);
}

/* The names of the values 0, 1, ... up to `last` of an enumeration of the solver. */
static json_t *names_json(unsigned last, const char *(*name)(unsigned value))
{
    json_t *names = json_array();
    for (unsigned i = 0; names != NULL && i <= last; i++)
        json_array_append_new(names, json_string(name(i)));
    return names;
}

static const char *method_name(unsigned value)
{
    return drape_method_name((drape_method)value);
}

static const char *integrator_name(unsigned value)
{
    return drape_integrator_name((drape_integrator)value);
}

void about_info(struct call *call)
{
    const struct config *config = call->api->config;
    json_t *json =
        json_pack("{s:s, s:s, s:s, s:i, s:s, s:s, s:{s:[s,s,s,s], s:[s,s,s,s], s:[s,s,s]}, s:o, s:o, s:o}",
                  "name", "draped", "version", drape_version(), "api", "v1", "workers", (int)config->workers,
                  "blas", call->api->blas, "kernels", drape_kernels(), "formats", "mesh",
                  mesh_format_name(MESH_OBJ), mesh_format_name(MESH_PLY), mesh_format_name(MESH_GLB),
                  mesh_format_name(MESH_JSON), "result", "json", "obj", "ply", "glb", "trace", "json", "csv",
                  "svg", "methods", names_json(DRAPE_METHOD_NEWTON, method_name), "integrators",
                  names_json(DRAPE_RK4, integrator_name), "limits", limits_json(&config->limits));
    http_send(call->request, answer_json(200, json));
}

int about_open(struct api *api)
{
    char *materials = jsonout_text(schema_materials_json());
    const size_t openapi_bytes = (size_t)(asset_openapi_end - asset_openapi);
    api->interface = page_interface(asset_openapi, openapi_bytes);
    int failed =
        materials == NULL || api->interface == NULL ||
        page_make("application/json", materials, strlen(materials), &api->page[PAGE_MATERIALS]) != 0 ||
        page_make("application/json", asset_openapi, openapi_bytes, &api->page[PAGE_OPENAPI]) != 0;
    free(materials);
    return failed ? -1 : 0;
}

void about_close(struct api *api)
{
    for (size_t i = 0; i < PAGES; i++)
        page_done(&api->page[i]);
    free(api->interface);
}

void about_materials(struct call *call)
{
    page_send(call, &call->api->page[PAGE_MATERIALS]);
}

void about_openapi(struct call *call)
{
    page_send(call, &call->api->page[PAGE_OPENAPI]);
}

void about_root(struct call *call)
{
    const struct api *api = call->api;
    struct page_facts facts = {.version = drape_version(),
                               .counts =
                                   api->keys == NULL, /* how many others there are is nobody's business */
                               .workers = api->config->workers,
                               .streams = hub_followers(api->hub)};
    queue_count(api->queue, &facts.queued, &facts.running);
    struct http_answer *answer =
        http_answer_text(200, "text/html; charset=utf-8", page_html(&facts, api->interface));
    http_answer_header(answer, "Cache-Control", "no-cache");
    http_answer_header(answer, "Content-Security-Policy", "default-src 'none'; style-src 'unsafe-inline'");
    http_answer_header(answer, "X-Content-Type-Options", "nosniff");
    http_send(call->request, answer);
}

/* Alive is whoever can say so: asks nobody, least of all the store. */
void admin_livez(struct call *call)
{
    http_send(call->request, http_answer_static(200, "text/plain; charset=utf-8", "ok\n", 3));
}

void admin_readyz(struct call *call)
{
    bool ready;
    json_t *json = health_json(&call->api->health, clock_monotonic_ms(), &ready);
    http_send(call->request, answer_json(ready ? 200 : 503, json));
}

void admin_metrics(struct call *call)
{
    http_send(call->request, http_answer_text(200, "text/plain; version=0.0.4; charset=utf-8",
                                              metrics_text(call->api->metrics)));
}
