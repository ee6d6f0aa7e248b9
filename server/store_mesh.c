/* store_mesh.c - meshes: rows by owner and digest, over files that equal ones share.
 *
 * A file is removed under the database's lock, once no row speaks of it; a row is added under it, once the
 * file is seen there. So no row is left without its file, whoever adds and removes at the same time. */
#include "store_rooms.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

#include "encoding.h"
#include "files.h"
#include "id.h"

#define TOUCH_MS ((int64_t)60 * 60 * 1000) /* between two notes that a mesh is in use */

struct addition {
    struct store *store;
    const char *owner;
    const struct store_mesh *mesh;
    int64_t now_ms;
};

static int run_addition(struct db *db, void *data)
{
    const struct addition *a = data;
    if (faccessat(a->store->meshes, a->mesh->sha256, F_OK, 0) != 0)
        return STORE_NONE; /* another owner has just removed it */
    db_bind(db, SQL_MESH_ADD, "ttiiiii", a->owner, a->mesh->sha256, (int64_t)a->mesh->format,
            (int64_t)a->mesh->bytes, (int64_t)a->mesh->vertices, (int64_t)a->mesh->triangles, a->now_ms);
    return db_run(db, SQL_MESH_ADD);
}

int store_mesh_add(struct store *store, const char *owner, const struct store_mesh *mesh, const void *data,
                   int64_t now_ms, struct problem *reterr)
{
    struct addition addition = {store, owner, mesh, now_ms};
    int result;
    do {
        if (!db_restore_reserve(store->db)) {
            errno = ENOSPC;
            return store_fail_file(store, "keep the mesh", reterr);
        }
        if (files_write_durably(store->meshes, mesh->sha256, data, mesh->bytes) != 0)
            return store_fail_file(store, "keep the mesh", reterr);
        result = db_transact(store->db, DB_ADDS, "add the mesh", run_addition, &addition, reterr);
    } while (result == STORE_NONE);
    return result;
}

int store_mesh_get(struct store *store, const char *owner, const char *sha256, struct store_mesh *ret,
                   struct problem *reterr)
{
    db_lock(store->db);
    sqlite3_stmt *s = db_bind(store->db, SQL_MESH_GET, "tt", owner, sha256);
    int found = db_row(store->db, SQL_MESH_GET);
    if (found > 0) {
        snprintf(ret->sha256, sizeof ret->sha256, "%s", sha256);
        ret->format = sqlite3_column_int(s, 0);
        ret->bytes = (uint64_t)sqlite3_column_int64(s, 1);
        ret->vertices = (size_t)sqlite3_column_int64(s, 2);
        ret->triangles = (size_t)sqlite3_column_int64(s, 3);
    } else if (found < 0) {
        db_fail(store->db, "read the mesh", reterr);
    }
    db_reset(store->db, SQL_MESH_GET);
    db_unlock(store->db);
    return found > 0 ? 0 : found == 0 ? STORE_NONE : -1;
}

int store_mesh_open(struct store *store, const char *owner, const char *sha256, struct store_mesh *ret,
                    int *ret_fd, struct problem *reterr)
{
    int found = store_mesh_get(store, owner, sha256, ret, reterr);
    if (found != 0)
        return found;
    struct stat st;
    int fd = openat(store->meshes, sha256, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return errno == ENOENT ? STORE_NONE : store_fail_file(store, "open the mesh", reterr);
    if (fstat(fd, &st) != 0 || (uint64_t)st.st_size != ret->bytes) { /* who maps it would end by SIGBUS */
        close(fd);
        return problem_set(reterr, PROBLEM_STORAGE, "The file of the mesh %s is not as it was written.",
                           sha256);
    }
    *ret_fd = fd;
    return 0;
}

struct mesh_work {
    struct store *store;
    const char *owner, *sha256;
    int64_t now_ms;
};

static int run_touch(struct db *db, void *data)
{
    const struct mesh_work *w = data;
    db_bind(db, SQL_MESH_TOUCH, "ttii", w->owner, w->sha256, w->now_ms, TOUCH_MS);
    return db_run(db, SQL_MESH_TOUCH);
}

int store_mesh_touch(struct store *store, const char *owner, const char *sha256, int64_t now_ms,
                     struct problem *reterr)
{
    struct mesh_work work = {store, owner, sha256, now_ms};
    return db_transact(store->db, DB_ADDS, "touch the mesh", run_touch, &work, reterr);
}

static int run_removal(struct db *db, void *data)
{
    const struct mesh_work *w = data;
    db_bind(db, SQL_MESH_NEEDED, "tt", w->owner, w->sha256);
    int needed = db_row(db, SQL_MESH_NEEDED);
    db_reset(db, SQL_MESH_NEEDED);
    db_bind(db, SQL_MESH_REMOVE, "tt", w->owner, w->sha256);
    if (needed < 0 || db_run(db, SQL_MESH_REMOVE) != 0)
        return -1;
    if (db_changes(db) == 0)
        return STORE_NONE;
    return needed ? STORE_IN_USE : 0;
}

int store_mesh_remove(struct store *store, const char *owner, const char *sha256, struct problem *reterr)
{
    struct mesh_work work = {store, owner, sha256, 0};
    int result = db_transact(store->db, DB_FREES, "remove the mesh", run_removal, &work, reterr);
    if (result == 0)
        store_mesh_file_remove(store, sha256);
    return result;
}

#define CODED_NAME_SIZE (SHA256_SIZE + 8)

static void coded_name(const char *sha256, const char *coding, char ret[CODED_NAME_SIZE])
{
    snprintf(ret, CODED_NAME_SIZE, "%s.%s", sha256, coding);
}

/* Under the lock. */
static bool wanted(struct store *store, const char *name)
{
    db_bind(store->db, SQL_MESH_KNOWN, "t", name);
    int known = db_row(store->db, SQL_MESH_KNOWN);
    db_reset(store->db, SQL_MESH_KNOWN);
    return known != 0;
}

bool store_mesh_wanted(struct store *store, const char *name)
{
    db_lock(store->db);
    bool is = wanted(store, name);
    db_unlock(store->db);
    return is;
}

void store_mesh_file_remove(struct store *store, const char *sha256)
{
    char name[CODED_NAME_SIZE];
    db_lock(store->db);
    if (!wanted(store, sha256)) {
        files_remove(store->meshes, sha256);
        for (int coding = CODING_IDENTITY + 1; coding < CODINGS; coding++) {
            coded_name(sha256, coding_suffix((enum coding)coding), name);
            files_remove(store->meshes, name);
        }
    }
    db_unlock(store->db);
}

int store_mesh_coded_open(struct store *store, const char *sha256, const char *coding, int *ret_fd,
                          uint64_t *ret_bytes, struct problem *reterr)
{
    char name[CODED_NAME_SIZE];
    coded_name(sha256, coding, name);
    return store_open_file(store, store->meshes, name, "open the mesh", ret_fd, ret_bytes, reterr);
}

int store_mesh_coded_add(struct store *store, const char *sha256, const char *coding, const void *data,
                         size_t bytes, struct problem *reterr)
{
    char name[CODED_NAME_SIZE];
    coded_name(sha256, coding, name);
    if (files_write_durably(store->meshes, name, data, bytes) != 0)
        return store_fail_file(store, "keep the coded mesh", reterr);
    return 0;
}

int store_mesh_bytes(struct store *store, const char *owner, uint64_t *ret, struct problem *reterr)
{
    db_lock(store->db);
    sqlite3_stmt *s = db_bind(store->db, SQL_MESH_BYTES, "t", owner);
    int result = db_row(store->db, SQL_MESH_BYTES) > 0 ? 0 : db_fail(store->db, "count the meshes", reterr);
    if (result == 0)
        *ret = (uint64_t)sqlite3_column_int64(s, 0);
    db_reset(store->db, SQL_MESH_BYTES);
    db_unlock(store->db);
    return result;
}
