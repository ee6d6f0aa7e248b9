/* files.h - files that are whole or not there: written aside, synced, renamed, folder synced.
 *
 * All functions but one return 0, or -1 with errno. Descriptors are close-on-exec. */
#ifndef DRAPED_FILES_H
#define DRAPED_FILES_H

#include <stddef.h>
#include <stdint.h>

int files_make_dir(int dirfd, const char *name, int *ret_fd); /* opens it; existing is fine */

/* Writes all of `data` to `fd`, going on after short writes and signals. */
int files_write_all(int fd, const void *data, size_t bytes);

/* Afterwards `name` holds exactly `data`, also after a power cut. */
int files_write_durably(int dirfd, const char *name, const void *data, size_t bytes);

/* Readers of `path` see the old file or all of the new one. */
int files_write_whole(const char *path, const void *data, size_t bytes);

/* Renames a folder whose files are synced, durably; an older folder of the new name is removed. */
int files_publish_dir(int dirfd, const char *name, const char *new_name);

/* Removes a file, or a folder with the files in it; one that is not there is fine. */
int files_remove(int dirfd, const char *name);

/* The bytes of a file, or of the files in a folder; 0 for what is not there. */
uint64_t files_size(int dirfd, const char *name);

/* A file without a name in `dir`, for reading and writing: nothing is left behind whatever happens. The
 * descriptor, or -1. */
int files_open_unnamed(const char *dir);

/* Whether `dir` takes writes now: a page goes into an unnamed file. */
int files_probe(const char *dir);

/* Reads a whole file; the caller frees *ret, which ends with a NUL that is not counted. */
int files_read(int dirfd, const char *name, char **ret, size_t *ret_bytes);

/* Calls `each` for every entry but "." and "..". */
int files_list(int dirfd, void (*each)(const char *name, void *data), void *data);

#endif
