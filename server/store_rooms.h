/* store_rooms.h - what the files of the store share, and nobody else sees. */
#ifndef DRAPED_STORE_ROOMS_H
#define DRAPED_STORE_ROOMS_H

#include "database.h"
#include "store.h"

struct store {
    struct db *db;
    struct metrics *metrics;
    int dir, jobs, results, meshes; /* open folders */
    int lock_file;
};

/* Logs and counts errno; -1 with *reterr. */
int store_fail_file(struct store *store, const char *what, struct problem *reterr);

/* Opens a file for reading; 0, STORE_NONE when it is not there, or -1 with *reterr. */
int store_open_file(struct store *store, int dirfd, const char *path, const char *what, int *ret_fd,
                    uint64_t *ret_bytes, struct problem *reterr);

/* Within a transaction: the row of an ended job becomes a tombstone. 0, STORE_NONE or -1. Its files go
 * afterwards: should that fail, they are orphans and go at the next start. */
int store_row_remove(struct db *db, const char *owner, const char *id, int64_t now_ms);
void store_files_remove(struct store *store, const char *id, uint32_t attempt);

/* Within the transaction of a job: what is answered under its key. 0, STORE_TAKEN or -1. */
int store_answer_add(struct db *db, const struct job *job, const struct store_submission *submission);

/* Whether any owner has the mesh of that name; also when the database cannot tell. */
bool store_mesh_wanted(struct store *store, const char *name);
/* Removes the file of a mesh that no owner has (any more). */
void store_mesh_file_remove(struct store *store, const char *sha256);

#endif
