/* files.c - see files.h. */
#include "files.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

int files_make_dir(int dirfd, const char *name, int *ret_fd)
{
    if (mkdirat(dirfd, name, 0700) != 0 && errno != EEXIST)
        return -1;
    int fd = openat(dirfd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return -1;
    *ret_fd = fd;
    return 0;
}

int files_write_all(int fd, const void *data, size_t bytes)
{
    const char *p = data;
    while (bytes > 0) {
        ssize_t n = write(fd, p, bytes);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return -1;
        p += n;
        bytes -= (size_t)n;
    }
    return 0;
}

/* Writes `name` aside and renames it; with `sync` both survive a power cut. */
static int replace_file(int dirfd, const char *name, const void *data, size_t bytes, bool sync)
{
    char aside[256];
    /* Named after the thread: two that write the same name do not write into each other's file. */
    if (snprintf(aside, sizeof aside, "%s.%d.tmp", name, (int)gettid()) >= (int)sizeof aside) {
        errno = ENAMETOOLONG;
        return -1;
    }
    int fd = openat(dirfd, aside, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd < 0)
        return -1;
    bool written = files_write_all(fd, data, bytes) == 0 && (!sync || fsync(fd) == 0);
    int error = errno;
    if (close(fd) != 0 && written) {
        written = false;
        error = errno;
    }
    if (written && (renameat(dirfd, aside, dirfd, name) != 0 || (sync && fsync(dirfd) != 0))) {
        written = false;
        error = errno;
    }
    if (!written) {
        unlinkat(dirfd, aside, 0);
        errno = error;
        return -1;
    }
    return 0;
}

int files_write_durably(int dirfd, const char *name, const void *data, size_t bytes)
{
    return replace_file(dirfd, name, data, bytes, true);
}

int files_write_whole(const char *path, const void *data, size_t bytes)
{
    return replace_file(AT_FDCWD, path, data, bytes, false);
}

int files_publish_dir(int dirfd, const char *name, const char *new_name)
{
    int fd = openat(dirfd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return -1;
    int failed = fsync(fd);
    close(fd);
    if (failed || files_remove(dirfd, new_name) != 0)
        return -1;
    return renameat(dirfd, name, dirfd, new_name) != 0 ? -1 : fsync(dirfd);
}

int files_open_unnamed(const char *dir)
{
    int fd = open(dir, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd >= 0 || (errno != EOPNOTSUPP && errno != EISDIR))
        return fd;
    char path[4096];
    if (snprintf(path, sizeof path, "%s/spool.XXXXXX", dir) >= (int)sizeof path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    fd = mkostemp(path, O_CLOEXEC);
    if (fd >= 0)
        unlink(path);
    return fd;
}

int files_probe(const char *dir)
{
    static const char page[4096];
    int fd = open(dir, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (fd < 0)
        return errno == EOPNOTSUPP || errno == EISDIR ? 0 : -1; /* no such files here: nothing to learn */
    int failed = files_write_all(fd, page, sizeof page);
    int error = errno;
    close(fd);
    errno = error;
    return failed;
}

struct removal {
    int dirfd;
    int failed;
};

static void remove_file(const char *name, void *data)
{
    struct removal *removal = data;
    if (unlinkat(removal->dirfd, name, 0) != 0 && errno != ENOENT)
        removal->failed = errno;
}

int files_remove(int dirfd, const char *name)
{
    if (unlinkat(dirfd, name, 0) == 0 || errno == ENOENT)
        return 0;
    if (errno != EISDIR && errno != EPERM)
        return -1;
    struct removal removal = {openat(dirfd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC), 0};
    if (removal.dirfd < 0)
        return -1;
    if (files_list(removal.dirfd, remove_file, &removal) != 0)
        removal.failed = errno;
    close(removal.dirfd);
    if (removal.failed) {
        errno = removal.failed;
        return -1;
    }
    return unlinkat(dirfd, name, AT_REMOVEDIR);
}

struct sum {
    int dirfd;
    uint64_t bytes;
};

static void add_size(const char *name, void *data)
{
    struct sum *sum = data;
    struct stat st;
    if (fstatat(sum->dirfd, name, &st, AT_SYMLINK_NOFOLLOW) == 0)
        sum->bytes += (uint64_t)st.st_size;
}

uint64_t files_size(int dirfd, const char *name)
{
    struct stat st;
    if (fstatat(dirfd, name, &st, AT_SYMLINK_NOFOLLOW) != 0)
        return 0;
    if (!S_ISDIR(st.st_mode))
        return (uint64_t)st.st_size;
    struct sum sum = {openat(dirfd, name, O_RDONLY | O_DIRECTORY | O_CLOEXEC), 0};
    if (sum.dirfd < 0)
        return 0;
    files_list(sum.dirfd, add_size, &sum);
    close(sum.dirfd);
    return sum.bytes;
}

/* Reads exactly `bytes`; a file that ends early is an error. */
static int read_all(int fd, char *data, size_t bytes)
{
    size_t got = 0;
    while (got < bytes) {
        ssize_t n = read(fd, data + got, bytes - got);
        if (n < 0 && errno == EINTR)
            continue;
        if (n == 0)
            errno = EIO;
        if (n <= 0)
            return -1;
        got += (size_t)n;
    }
    return 0;
}

int files_read(int dirfd, const char *name, char **ret, size_t *ret_bytes)
{
    int fd = openat(dirfd, name, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return -1;
    struct stat st;
    char *data = NULL;
    if (fstat(fd, &st) != 0)
        goto cleanup;
    data = malloc((size_t)st.st_size + 1);
    if (data == NULL || read_all(fd, data, (size_t)st.st_size) != 0)
        goto cleanup;
    close(fd);
    data[st.st_size] = '\0';
    *ret = data;
    *ret_bytes = (size_t)st.st_size;
    return 0;

cleanup:;
    int error = errno;
    free(data);
    close(fd);
    errno = error;
    return -1;
}

int files_list(int dirfd, void (*each)(const char *name, void *data), void *data)
{
    int fd = openat(dirfd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (fd < 0)
        return -1;
    DIR *dir = fdopendir(fd);
    if (dir == NULL) {
        int error = errno;
        close(fd);
        errno = error;
        return -1;
    }
    const struct dirent *entry;
    while (errno = 0, (entry = readdir(dir)) != NULL)
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0)
            each(entry->d_name, data);
    int error = errno;
    closedir(dir);
    errno = error;
    return error ? -1 : 0;
}
