/* api_meshes.c - uploaded meshes: checked, kept under their SHA-256, given back byte for byte. */
#include "api.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "clock.h"
#include "log.h"
#include "meshfile.h"
#include "negotiate.h"

static void answer_mesh(struct call *call, int status, const struct store_mesh *mesh)
{
    json_t *json =
        json_pack("{s:s, s:s, s:I, s:I, s:I}", "sha256", mesh->sha256, "format",
                  mesh_format_name((enum mesh_format)mesh->format), "bytes", (json_int_t)mesh->bytes,
                  "vertices", (json_int_t)mesh->vertices, "triangles", (json_int_t)mesh->triangles);
    struct http_answer *answer = answer_json(status, json);
    http_answer_header(answer, "Location", "/v1/meshes/%s", mesh->sha256);
    http_answer_header(answer, "ETag", "\"%s\"", mesh->sha256);
    http_send(call->request, answer);
}

/* Whether the key may keep `bytes` more; 0, or -1 with *reterr. All uploads come one after the other, on the
 * reader's thread, so that no other gets between this look and the row. */
static int check_quota(const struct call *call, size_t bytes, struct problem *reterr)
{
    uint64_t held;
    if (call->api->keys == NULL)
        return 0;
    uint64_t most = keys_quota(call->api->keys, call->owner).mesh_bytes;
    if (store_mesh_bytes(call->api->store, call->owner, &held, reterr) != 0)
        return -1;
    if (held <= most && bytes <= most - held)
        return 0;
    return problem_set(reterr, PROBLEM_QUOTA_MESHES, "The key keeps %llu of %llu bytes; this mesh has %zu.",
                       (unsigned long long)held, (unsigned long long)most, bytes);
}

/* Parses and keeps a mesh that is not there yet; 0, or -1 with *reterr. */
static int keep_mesh(struct call *call, const void *data, size_t bytes, struct store_mesh *mesh,
                     struct problem *reterr)
{
    struct mesh parsed = {0};
    mesh->format = mesh_format_from_media_type(http_header(call->request, "Content-Type"));
    mesh->bytes = bytes;
    if (check_quota(call, bytes, reterr) != 0 ||
        meshfile_parse((enum mesh_format)mesh->format, data, bytes, &call->api->config->limits, &parsed,
                       reterr) != 0)
        return -1;
    mesh->vertices = parsed.vertices;
    mesh->triangles = parsed.triangles;
    mesh_done(&parsed);
    return store_mesh_add(call->api->store, call->owner, mesh, data, clock_wall_ms(), reterr);
}

/* `expected`: the digest in the path, or NULL. */
static void take_mesh(struct call *call, const char *expected)
{
    struct problem problem;
    struct store_mesh mesh;
    const void *data;
    size_t bytes;
    if (http_body(call->request, &data, &bytes) != 0) {
        call_refuse(call, PROBLEM_STORAGE, "The body could not be read: %s.", strerror(errno));
        return;
    }
    char digest[SHA256_SIZE];
    sha256_hex(data, bytes, digest);
    if (expected != NULL && strcmp(expected, digest) != 0) {
        call_refuse(call, PROBLEM_DIGEST_MISMATCH, "The body's SHA-256 is %s.", digest);
        return;
    }
    int found = store_mesh_get(call->api->store, call->owner, digest, &mesh, &problem);
    bool known = found == 0;
    if (found == STORE_NONE) {
        memcpy(mesh.sha256, digest, sizeof digest);
        found = keep_mesh(call, data, bytes, &mesh, &problem);
    }
    if (found < 0) {
        call_problem(call, &problem);
        return;
    }
    if (!known)
        log_event(LOG_LEVEL_INFO, "mesh.kept", "sha256=%s bytes=%zu request=%s", digest, bytes,
                  http_request_id(call->request));
    answer_mesh(call, known ? 200 : 201, &mesh);
}

void mesh_put(struct call *call)
{
    take_mesh(call, call->id);
}

void mesh_post(struct call *call)
{
    take_mesh(call, NULL);
}

void mesh_get(struct call *call)
{
    struct problem problem;
    struct store_mesh mesh;
    char etag[SHA256_SIZE + 2];
    int fd;
    int found = store_mesh_open(call->api->store, call->owner, call->id, &mesh, &fd, &problem);
    if (found != 0) {
        if (found > 0)
            problem_set(&problem, PROBLEM_NOT_FOUND, "There is no such mesh.");
        call_problem(call, &problem);
        return;
    }
    snprintf(etag, sizeof etag, "\"%s\"", call->id);
    struct http_answer *answer =
        http_answer_file(200, mesh_format_media_type((enum mesh_format)mesh.format), fd, mesh.bytes);
    if (negotiate_unchanged(http_header(call->request, "If-None-Match"), etag)) {
        http_answer_free(answer);
        answer = http_answer_empty(304);
    }
    http_answer_header(answer, "ETag", "%s", etag);
    http_answer_header(answer, "Cache-Control", "private, max-age=31536000, immutable");
    http_send(call->request, answer);
}
