/* api_meshes.c - uploaded meshes: checked, kept under their SHA-256, given back byte for byte or in another
 * format. */
#include "api.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "clock.h"
#include "digest.h"
#include "drape.h"
#include "files.h"
#include "log.h"
#include "meshfile.h"
#include "meshref.h"
#include "multipart.h"
#include "negotiate.h"
#include "represent.h"

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

struct upload { /* the file in a request's body */
    const void *data;
    size_t bytes;
    enum mesh_format format;
};

/* Of a file in a form: by its type, or by the ending of its name where the type says nothing, as browsers
 * send most meshes; -1: unknown. */
static int form_format(const struct multipart_file *file)
{
    const char *dot = strrchr(file->filename, '.');
    bool says_nothing = file->type[0] == '\0' || negotiate_is_type(file->type, "application/octet-stream") ||
                        negotiate_is_type(file->type, "text/plain");
    if (!says_nothing)
        return mesh_format_from_media_type(file->type);
    return dot == NULL ? -1 : mesh_format_from_name(dot + 1);
}

/* 0, or -1 with *reterr. */
static int take_form(const char *boundary, struct upload *upload, struct problem *reterr)
{
    struct multipart_file file;
    if (multipart_parse(upload->data, upload->bytes, boundary, &file, reterr) != 0)
        return -1;
    int format = form_format(&file);
    if (format < 0)
        return problem_set(
            reterr, PROBLEM_MEDIA_TYPE,
            "The file's Content-Type, or else the ending of its name, must be that of a mesh.");
    *upload = (struct upload){file.data, file.bytes, (enum mesh_format)format};
    return 0;
}

/* 0, or -1 with *reterr. */
static int read_upload(struct call *call, struct upload *ret, struct problem *reterr)
{
    const char *type = http_header(call->request, "Content-Type");
    char boundary[MULTIPART_BOUNDARY_SIZE];
    if (http_body(call->request, &ret->data, &ret->bytes) != 0)
        return problem_set(reterr, PROBLEM_STORAGE, "The body could not be read: %s.", strerror(errno));
    if (digest_check(http_header(call->request, "Content-Digest"), ret->data, ret->bytes, reterr) != 0 ||
        call_body(call, &ret->data, &ret->bytes, reterr) != 0)
        return -1;
    int form = multipart_boundary(type, boundary, reterr);
    if (form < 0)
        return -1;
    if (form == 0)
        return take_form(boundary, ret, reterr);
    ret->format = (enum mesh_format)mesh_format_from_media_type(type);
    return 0;
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
    problem_set(reterr, PROBLEM_QUOTA_MESHES, "The key keeps %llu of %llu bytes; this mesh has %zu.",
                (unsigned long long)held, (unsigned long long)most, bytes);
    reterr->retry_s = QUEUE_RETRY_MAX_S; /* no job that ends helps: meshes go when they are removed or old */
    return -1;
}

/* Parses and keeps a mesh that is not there yet; 0, or -1 with *reterr. */
static int keep_mesh(struct call *call, const struct upload *upload, struct store_mesh *mesh,
                     struct problem *reterr)
{
    struct mesh parsed = {0};
    mesh->format = (int)upload->format;
    mesh->bytes = upload->bytes;
    if (check_quota(call, upload->bytes, reterr) != 0 ||
        meshfile_parse(upload->format, upload->data, upload->bytes, &call->api->config->limits, &parsed,
                       reterr) != 0)
        return -1;
    mesh->vertices = parsed.vertices;
    mesh->triangles = parsed.triangles;
    mesh_done(&parsed);
    return store_mesh_add(call->api->store, call->owner, mesh, upload->data, clock_steady_ms(), reterr);
}

/* `expected`: the digest in the path, or NULL. */
static void take_mesh(struct call *call, const char *expected)
{
    struct problem problem;
    struct store_mesh mesh;
    struct upload upload;
    if (read_upload(call, &upload, &problem) != 0) {
        call_problem(call, &problem);
        return;
    }
    char digest[SHA256_SIZE];
    sha256_hex(upload.data, upload.bytes, digest);
    if (expected != NULL && strcmp(expected, digest) != 0) {
        call_refuse(call, PROBLEM_DIGEST_MISMATCH, "The body's SHA-256 is %s.", digest);
        return;
    }
    int found = store_mesh_get(call->api->store, call->owner, digest, &mesh, &problem);
    bool known = found == 0;
    if (known)
        found = store_mesh_touch(call->api->store, call->owner, digest, clock_steady_ms(), &problem);
    if (found == STORE_NONE) {
        memcpy(mesh.sha256, digest, sizeof digest);
        found = keep_mesh(call, &upload, &mesh, &problem);
    }
    if (found < 0) {
        call_problem(call, &problem);
        return;
    }
    if (!known)
        log_event(LOG_LEVEL_INFO, "mesh.kept", "sha256=%s bytes=%zu request=%s", digest, upload.bytes,
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

/* ---- GET ------------------------------------------------------------------------------------------------
 */

#define VARY "Accept, Accept-Encoding"

/* By ?format=, else by Accept, where what was uploaded is as good as any; -1: none will do. */
static int choose_format(const struct call *call, enum mesh_format kept)
{
    char name[16];
    int format[MESH_FORMATS] = {(int)kept}, formats = 1;
    const char *type[MESH_FORMATS];
    int given = http_query(call->request, "format", name, sizeof name);
    if (given <= 0)
        return given == 0 ? mesh_format_from_name(name) : -1;
    for (int i = 0; i < MESH_FORMATS; i++)
        if (i != (int)kept)
            format[formats++] = i;
    for (int i = 0; i < MESH_FORMATS; i++)
        type[i] = mesh_format_media_type((enum mesh_format)format[i]);
    int best = negotiate_accept(http_header(call->request, "Accept"), type, MESH_FORMATS);
    return best < 0 ? -1 : format[best];
}

static void refuse_formats(struct call *call)
{
    const char *name[MESH_FORMATS], *type[MESH_FORMATS];
    for (int i = 0; i < MESH_FORMATS; i++) {
        name[i] = mesh_format_name((enum mesh_format)i);
        type[i] = mesh_format_media_type((enum mesh_format)i);
    }
    represent_refuse(call, name, type, MESH_FORMATS);
}

/* What is sent of a mesh, and how. */
struct outgoing {
    struct store_mesh mesh;
    enum coding coding;
    int fd;
    uint64_t bytes; /* in that coding */
};

/* The mesh as it was uploaded, and the format to send it in; false: answered that there is none. */
static bool open_mesh(struct call *call, struct outgoing *ret, enum mesh_format *ret_format)
{
    struct problem problem;
    int found = store_mesh_open(call->api->store, call->owner, call->id, &ret->mesh, &ret->fd, &problem);
    if (found > 0)
        problem_set(&problem, PROBLEM_NOT_FOUND, "There is no such mesh.");
    if (found != 0) {
        call_problem(call, &problem);
        return false;
    }
    int format = choose_format(call, (enum mesh_format)ret->mesh.format);
    if (format < 0) {
        close(ret->fd);
        refuse_formats(call);
        return false;
    }
    ret->coding = CODING_IDENTITY;
    ret->bytes = ret->mesh.bytes;
    *ret_format = (enum mesh_format)format;
    return true;
}

/* ---- in another format than was uploaded */

/* The answer with a mesh in another format, by way of an unnamed file; NULL with *reterr. */
static struct http_answer *convert(struct call *call, enum mesh_format format, struct problem *reterr)
{
    struct meshref ref = {call->api->store, call->owner, &call->api->config->limits, NULL};
    struct mesh mesh = {0};
    if (meshref_load(call->id, &mesh, reterr, &ref) != 0)
        return NULL;
    int fd = files_open_unnamed(call->api->config->data);
    int copy = fd < 0 ? -1 : fcntl(fd, F_DUPFD_CLOEXEC, 0);
    FILE *file = copy < 0 ? NULL : fdopen(copy, "w");
    bool written = file != NULL && meshfile_write(format, file, &mesh) == 0;
    int error = errno;
    off_t bytes = written ? ftello(file) : -1;
    mesh_done(&mesh);
    if (file != NULL)
        fclose(file);
    else if (copy >= 0)
        close(copy);
    if (bytes >= 0)
        return http_answer_file(200, mesh_format_media_type(format), fd, (uint64_t)bytes);
    if (fd >= 0)
        close(fd);
    problem_set(reterr, PROBLEM_STORAGE, "The mesh could not be written: %s.", strerror(error));
    return NULL;
}

/* On the reader's thread. The tag names the version: our writers may differ from one to the next. */
static void mesh_convert(struct call *call)
{
    struct problem problem = {.code = PROBLEM_INTERNAL};
    struct outgoing out;
    enum mesh_format format;
    char tag[SHA256_SIZE + 32];
    if (!open_mesh(call, &out, &format))
        return;
    close(out.fd);
    snprintf(tag, sizeof tag, "%s-%s-%s", out.mesh.sha256, mesh_format_name(format), drape_version());
    struct http_answer *answer = convert(call, format, &problem);
    struct representing as = {tag, CODING_IDENTITY, VARY, "private, no-cache"};
    if (answer != NULL)
        represent_send(call, answer, &as);
    else
        call_problem(call, &problem);
}

/* ---- as it was uploaded */

static void send_mesh(struct call *call, const struct outgoing *out)
{
    struct representing as = {call->id, out->coding, VARY, "private, max-age=31536000, immutable"};
    const char *type = mesh_format_media_type((enum mesh_format)out->mesh.format);
    represent_send(call, http_answer_file(200, type, out->fd, out->bytes), &as);
}

/* The coding that the client likes best of those that are worth it. 0 with the file open in it; STORE_NONE:
 * it has yet to be made, in out->coding; ANSWERED: none will do. */
static int open_coded(struct call *call, struct outgoing *out)
{
    unsigned offered = out->mesh.bytes >= CODED_LEAST ? (1u << CODINGS) - 1 : CODING_BIT(CODING_IDENTITY);
    for (;;) {
        int fd, coding = represent_choose(call, offered);
        uint64_t bytes;
        if (coding < 0)
            return ANSWERED;
        out->coding = (enum coding)coding;
        if (coding == CODING_IDENTITY)
            return 0;
        int found =
            store_mesh_coded_open(call->api->store, call->id, coding_suffix(out->coding), &fd, &bytes, NULL);
        if (found == 0 && bytes > 0) {
            close(out->fd);
            out->fd = fd;
            out->bytes = bytes;
        } else if (found == 0) {
            close(fd); /* known not to be worth it */
        }
        if (found == STORE_NONE || (found == 0 && bytes > 0))
            return found;
        offered &= ~CODING_BIT(coding);
    }
}

/* Makes and keeps it in that coding; 0 or -1. */
static int encode_mesh(struct call *call, const struct outgoing *out)
{
    char *coded;
    size_t bytes;
    void *data = mmap(NULL, out->mesh.bytes, PROT_READ, MAP_PRIVATE, out->fd, 0);
    if (data == MAP_FAILED)
        return -1;
    int failed = encoding_encode_whole(out->coding, data, out->mesh.bytes, &coded, &bytes);
    munmap(data, out->mesh.bytes);
    if (failed)
        return -1;
    failed = store_mesh_coded_add(call->api->store, call->id, coding_suffix(out->coding), coded, bytes, NULL);
    free(coded);
    return failed;
}

/* On the reader's thread: of several who ask for it, the first makes it. */
static void send_coded(struct call *call)
{
    struct outgoing out;
    enum mesh_format format;
    int found;
    if (!open_mesh(call, &out, &format))
        return;
    while ((found = open_coded(call, &out)) == STORE_NONE)
        if (encode_mesh(call, &out) != 0) {
            out.coding = CODING_IDENTITY; /* acceptable or not: better than none */
            found = 0;
            break;
        }
    if (found == ANSWERED)
        close(out.fd);
    else
        send_mesh(call, &out);
}

/* Takes the open file. */
static void send_kept(struct call *call, struct outgoing *out)
{
    int fd = out->fd, found = open_coded(call, out);
    if (found == ANSWERED || (found == STORE_NONE && call_try_pass(call, call->api->reader, send_coded))) {
        close(fd);
        return;
    }
    if (found == STORE_NONE)
        out->coding = CODING_IDENTITY;
    send_mesh(call, out);
}

void mesh_get(struct call *call)
{
    struct outgoing out;
    enum mesh_format format;
    if (!open_mesh(call, &out, &format))
        return;
    /* Whoever looks whether it is there means to name it: it should not be pruned just then. */
    store_mesh_touch(call->api->store, call->owner, call->id, clock_steady_ms(), NULL);
    if (format == (enum mesh_format)out.mesh.format) {
        send_kept(call, &out);
    } else {
        close(out.fd);
        call_pass(call, call->api->reader, mesh_convert);
    }
}

void mesh_delete(struct call *call)
{
    struct problem problem;
    int found = store_mesh_remove(call->api->store, call->owner, call->id, &problem);
    if (found == STORE_NONE)
        problem_set(&problem, PROBLEM_NOT_FOUND, "There is no such mesh.");
    else if (found == STORE_IN_USE)
        problem_set(&problem, PROBLEM_IN_USE, "A job that has not ended names the mesh.");
    if (found != 0) {
        call_problem(call, &problem);
        return;
    }
    log_event(LOG_LEVEL_INFO, "mesh.removed", "sha256=%s request=%s", call->id,
              http_request_id(call->request));
    http_send(call->request, http_answer_empty(204));
}
