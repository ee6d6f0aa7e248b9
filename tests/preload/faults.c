/* faults.c - makes one call of the C library fail, in a program that knows nothing of it (LD_PRELOAD).
 *
 *   FAULT_KIND   malloc | open | write | sync | rename | step (sqlite3_step)
 *   FAULT_AT     which call of that kind fails, from 1 on; 0: none, they are only counted
 *   FAULT_COUNT  a file that gets how many calls there were, when the program ends in order
 *
 * Calls made by the libraries in `spared` are neither counted nor made to fail: they end the process when
 * memory is short, and nobody above them can help it. Writes to stderr and to sockets do not count.
 * Memory comes straight from glibc's own entry points, since dlsym allocates. */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <unistd.h>

enum kind { NONE, MALLOC, OPEN, WRITE, SYNC, RENAME, STEP };

static const char *const names[] = {"", "malloc", "open", "write", "sync", "rename", "step"};
static const char *const spared[] = {"/libgomp.", "/libopenblas", "/libplplot", "/libgcc_s.", "/ld-linux"};

static enum kind kind;
static long fault_at;
static atomic_long calls;
static const char *count_file;

void *__libc_malloc(size_t bytes);
void *__libc_calloc(size_t n, size_t bytes);
void *__libc_realloc(void *old, size_t bytes);
void *__libc_memalign(size_t alignment, size_t bytes);

__attribute__((constructor)) static void begin(void)
{
    const char *name = getenv("FAULT_KIND"), *at = getenv("FAULT_AT");
    count_file = getenv("FAULT_COUNT");
    fault_at = at != NULL ? atol(at) : 0;
    for (int k = MALLOC; name != NULL && k <= STEP; k++)
        if (strcmp(name, names[k]) == 0)
            kind = (enum kind)k;
}

__attribute__((destructor)) static void end(void)
{
    long n = atomic_load(&calls);
    kind = NONE;
    FILE *out = count_file != NULL ? fopen(count_file, "w") : NULL;
    if (out == NULL)
        return;
    fprintf(out, "%ld\n", n);
    fclose(out);
}

/* Whether `address` lies in a library of that name; so does one that lies nowhere. dladdr takes no memory. */
static bool is_in(void *address, const char *library)
{
    Dl_info info;
    return dladdr(address, &info) == 0 || info.dli_fname == NULL || strstr(info.dli_fname, library) != NULL;
}

static bool is_spared(void *address)
{
    for (size_t i = 0; i < sizeof spared / sizeof spared[0]; i++)
        if (is_in(address, spared[i]))
            return true;
    return false;
}

/* Whether this call, made from `caller`, is the one to fail. */
static bool fails(enum kind which, void *caller)
{
    static _Thread_local bool inside;
    if (kind != which || inside)
        return false;
    inside = true;
    bool fault = !is_spared(caller) && atomic_fetch_add(&calls, 1) + 1 == fault_at;
    inside = false;
    return fault;
}

#define FAILS(which) fails(which, __builtin_return_address(0))

/* The function of that name that would have been called without us. */
#define NEXT(type, name)                                                                                     \
    static type *next;                                                                                       \
    if (next == NULL)                                                                                        \
    next = (type *)dlsym(RTLD_NEXT, name)

/* ---- memory ------------------------------------------------------------------------------------------ */

static void *no_memory(void)
{
    errno = ENOMEM;
    return NULL;
}

void *malloc(size_t bytes)
{
    return FAILS(MALLOC) ? no_memory() : __libc_malloc(bytes);
}

void *calloc(size_t n, size_t bytes)
{
    return FAILS(MALLOC) ? no_memory() : __libc_calloc(n, bytes);
}

void *realloc(void *old, size_t bytes)
{
    return FAILS(MALLOC) ? no_memory() : __libc_realloc(old, bytes);
}

int posix_memalign(void **ret, size_t alignment, size_t bytes)
{
    void *memory = FAILS(MALLOC) ? NULL : __libc_memalign(alignment, bytes);
    if (memory == NULL)
        return ENOMEM;
    *ret = memory;
    return 0;
}

void *aligned_alloc(size_t alignment, size_t bytes)
{
    return FAILS(MALLOC) ? no_memory() : __libc_memalign(alignment, bytes);
}

/* ---- files ------------------------------------------------------------------------------------------- */

static int no_file(int error)
{
    errno = error;
    return -1;
}

typedef int open_fn(const char *path, int flags, ...);
typedef int openat_fn(int dirfd, const char *path, int flags, ...);

#define MODE(last)                                                                                           \
    mode_t mode = 0;                                                                                         \
    if (last & (O_CREAT | __O_TMPFILE)) {                                                                    \
        va_list rest;                                                                                        \
        va_start(rest, last);                                                                                \
        mode = va_arg(rest, mode_t);                                                                         \
        va_end(rest);                                                                                        \
    }

int open(const char *path, int flags, ...)
{
    MODE(flags)
    NEXT(open_fn, "open");
    return FAILS(OPEN) ? no_file(EMFILE) : next(path, flags, mode);
}

int open64(const char *path, int flags, ...)
{
    MODE(flags)
    NEXT(open_fn, "open64");
    return FAILS(OPEN) ? no_file(EMFILE) : next(path, flags, mode);
}

int openat(int dirfd, const char *path, int flags, ...)
{
    MODE(flags)
    NEXT(openat_fn, "openat");
    return FAILS(OPEN) ? no_file(EMFILE) : next(dirfd, path, flags, mode);
}

int openat64(int dirfd, const char *path, int flags, ...)
{
    MODE(flags)
    NEXT(openat_fn, "openat64");
    return FAILS(OPEN) ? no_file(EMFILE) : next(dirfd, path, flags, mode);
}

static bool is_file(int fd)
{
    struct stat status;
    return fd != STDERR_FILENO && fstat(fd, &status) == 0 && S_ISREG(status.st_mode);
}

typedef ssize_t write_fn(int fd, const void *data, size_t bytes);
typedef ssize_t pwrite_fn(int fd, const void *data, size_t bytes, off_t offset);

ssize_t write(int fd, const void *data, size_t bytes)
{
    NEXT(write_fn, "write");
    return is_file(fd) && FAILS(WRITE) ? no_file(ENOSPC) : next(fd, data, bytes);
}

ssize_t pwrite(int fd, const void *data, size_t bytes, off_t offset)
{
    NEXT(pwrite_fn, "pwrite");
    return FAILS(WRITE) ? no_file(ENOSPC) : next(fd, data, bytes, offset);
}

ssize_t pwrite64(int fd, const void *data, size_t bytes, off_t offset)
{
    NEXT(pwrite_fn, "pwrite64");
    return FAILS(WRITE) ? no_file(ENOSPC) : next(fd, data, bytes, offset);
}

typedef int sync_fn(int fd);

int fsync(int fd)
{
    NEXT(sync_fn, "fsync");
    return FAILS(SYNC) ? no_file(EIO) : next(fd);
}

int fdatasync(int fd)
{
    NEXT(sync_fn, "fdatasync");
    return FAILS(SYNC) ? no_file(EIO) : next(fd);
}

typedef int rename_fn(const char *from, const char *to);
typedef int renameat_fn(int from_dir, const char *from, int to_dir, const char *to);

int rename(const char *from, const char *to)
{
    NEXT(rename_fn, "rename");
    return FAILS(RENAME) ? no_file(ENOSPC) : next(from, to);
}

int renameat(int from_dir, const char *from, int to_dir, const char *to)
{
    NEXT(renameat_fn, "renameat");
    return FAILS(RENAME) ? no_file(ENOSPC) : next(from_dir, from, to_dir, to);
}

/* ---- SQLite ------------------------------------------------------------------------------------------ */

typedef int step_fn(void *statement);
int sqlite3_step(void *statement);

/* A full disk at any statement, COMMIT among them. The statement is not run. SQLite's own calls, for instance
 * to read the schema, look for the error in the statement and would take it for read to its end: they pass.
 */
int sqlite3_step(void *statement)
{
    NEXT(step_fn, "sqlite3_step");
    void *caller = __builtin_return_address(0);
    return !is_in(caller, "/libsqlite3.") && fails(STEP, caller) ? 13 /* SQLITE_FULL */ : next(statement);
}
