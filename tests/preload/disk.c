/* disk.c - LD_PRELOAD: a disk that misbehaves on demand, below the folder DISK_ROOT. The file that
 * DISK_CONTROL names says how: "full" (nothing grows, ENOSPC), "readonly" (EROFS), "broken" (EIO); "stuck":
 * what syncs waits until it says otherwise. No such file, or an empty one: all is well. */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

/* The next definition of a function, of the type that ours has. */
#define NEXT(name) ((__typeof__(&name))(uintptr_t)dlsym(RTLD_NEXT, #name))

static bool control_is(const char *word)
{
    char said[16] = "";
    const char *path = getenv("DISK_CONTROL");
    int fd = path == NULL ? -1 : NEXT(open)(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return false;
    ssize_t n = read(fd, said, sizeof said - 1);
    close(fd);
    return n > 0 && strncmp(said, word, strlen(word)) == 0;
}

static bool is_below(const char *path)
{
    const char *root = getenv("DISK_ROOT");
    return root != NULL && strncmp(path, root, strlen(root)) == 0;
}

static bool is_on_disk(int fd)
{
    char link[64], path[4096];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t n = readlink(link, path, sizeof path - 1);
    path[n > 0 ? n : 0] = '\0';
    return is_below(path);
}

static _Atomic long long freed; /* bytes, while the disk is full */

static bool is_full(void)
{
    bool full = control_is("full");
    if (!full)
        freed = 0;
    return full;
}

#define BLOCK 4096 /* what a new file or folder takes */

/* 0, or the error of a change by which a file grows by so many bytes. */
static int refusal(long long growth)
{
    if (control_is("readonly"))
        return EROFS;
    if (control_is("broken"))
        return EIO;
    if (growth <= 0 || !is_full())
        return 0;
    if (freed < growth)
        return ENOSPC;
    freed -= growth;
    return 0;
}

static int fail(int error)
{
    errno = error;
    return -1;
}

/* ---- opening and removing ------------------------------------------------------------------------------ */

static int check_open(int dir, const char *path, int flags)
{
    bool below = path[0] == '/' || dir == AT_FDCWD ? is_below(path) : is_on_disk(dir);
    bool makes =
        (flags & O_TMPFILE) == O_TMPFILE || ((flags & O_CREAT) && faccessat(dir, path, F_OK, 0) != 0);
    return below && (flags & (O_CREAT | O_WRONLY | O_RDWR)) ? refusal(makes ? BLOCK : 0) : 0;
}

#define OPEN(name)                                                                                           \
    int name(const char *path, int flags, ...)                                                               \
    {                                                                                                        \
        va_list args;                                                                                        \
        va_start(args, flags);                                                                               \
        int error = check_open(AT_FDCWD, path, flags), mode = va_arg(args, int);                             \
        va_end(args);                                                                                        \
        return error ? fail(error) : NEXT(name)(path, flags, mode);                                          \
    }
OPEN(open)
OPEN(open64)

#define OPENAT(name)                                                                                         \
    int name(int dir, const char *path, int flags, ...)                                                      \
    {                                                                                                        \
        va_list args;                                                                                        \
        va_start(args, flags);                                                                               \
        int error = check_open(dir, path, flags), mode = va_arg(args, int);                                  \
        va_end(args);                                                                                        \
        return error ? fail(error) : NEXT(name)(dir, path, flags, mode);                                     \
    }
OPENAT(openat)
OPENAT(openat64)

int mkdirat(int dir, const char *path, mode_t mode)
{
    int error = is_on_disk(dir) ? refusal(BLOCK) : 0;
    return error ? fail(error) : NEXT(mkdirat)(dir, path, mode);
}

int unlinkat(int dir, const char *path, int flags)
{
    int error = is_on_disk(dir) ? refusal(0) : 0;
    return error ? fail(error) : NEXT(unlinkat)(dir, path, flags);
}

int renameat(int from_dir, const char *from, int to_dir, const char *to)
{
    int error = is_on_disk(to_dir) ? refusal(0) : 0;
    return error ? fail(error) : NEXT(renameat)(from_dir, from, to_dir, to);
}

/* ---- writing and syncing --------------------------------------------------------------------------------
 */

/* Of `bytes` at `offset`; -1: where the file stands. */
static int check_write(int fd, size_t bytes, off_t offset)
{
    struct stat st;
    if (!is_on_disk(fd) || fstat(fd, &st) != 0)
        return 0;
    off_t at = offset >= 0 ? offset : lseek(fd, 0, SEEK_CUR);
    return refusal(at + (off_t)bytes - st.st_size);
}

ssize_t write(int fd, const void *data, size_t bytes)
{
    int error = check_write(fd, bytes, -1);
    return error ? fail(error) : NEXT(write)(fd, data, bytes);
}

#define PWRITE(name)                                                                                         \
    ssize_t name(int fd, const void *data, size_t bytes, off_t offset)                                       \
    {                                                                                                        \
        int error = check_write(fd, bytes, offset);                                                          \
        return error ? fail(error) : NEXT(name)(fd, data, bytes, offset);                                    \
    }
PWRITE(pwrite)
PWRITE(pwrite64)

static int check_resize(int fd, off_t size)
{
    struct stat st;
    if (!is_on_disk(fd) || fstat(fd, &st) != 0)
        return 0;
    int error = refusal(size - st.st_size);
    if (error == 0 && size < st.st_size && is_full())
        freed += st.st_size - size;
    return error;
}

#define FTRUNCATE(name)                                                                                      \
    int name(int fd, off_t size)                                                                             \
    {                                                                                                        \
        int error = check_resize(fd, size);                                                                  \
        return error ? fail(error) : NEXT(name)(fd, size);                                                   \
    }
FTRUNCATE(ftruncate)
FTRUNCATE(ftruncate64)

int posix_fallocate(int fd, off_t offset, off_t bytes)
{
    int error = check_write(fd, (size_t)bytes, offset);
    return error ? error : NEXT(posix_fallocate)(fd, offset, bytes);
}

static int check_sync(int fd)
{
    struct timespec moment = {0, 20000000};
    if (!is_on_disk(fd))
        return 0;
    while (control_is("stuck"))
        nanosleep(&moment, NULL);
    return control_is("broken") ? EIO : 0;
}

int fsync(int fd)
{
    int error = check_sync(fd);
    return error ? fail(error) : NEXT(fsync)(fd);
}

int fdatasync(int fd)
{
    int error = check_sync(fd);
    return error ? fail(error) : NEXT(fdatasync)(fd);
}
