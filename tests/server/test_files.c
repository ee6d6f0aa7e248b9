/* test_files.c - files are whole or not there, whichever call of the system fails.
 *
 * The calls that files.c makes are replaced in this program: one in turn fails, or does less than it might.
 */
#include "scratch.h"

#include "../solver/scarce.h"

#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "files.h"

/* ---- the system ----------------------------------------------------------------------------------- */

static long calls = -1;   /* until one fails with EIO; -1: none does */
static int unnamed_error; /* of open with O_TMPFILE; 0: it works */
static bool grudging;     /* every other read and write is interrupted, the rest move a byte */
static bool early_end;    /* reads find the end of the file */

static bool fault(void)
{
    if (calls < 0 || calls-- > 0)
        return false;
    errno = EIO;
    return true;
}

/* The function of that name that would have been called without us. */
#define NEXT(name) ((__typeof__(&name))(uintptr_t)dlsym(RTLD_NEXT, #name))

/* How much of `bytes` a call moves; -1: none, interrupted. */
static ssize_t share_of(size_t bytes)
{
    static unsigned n;
    if (!grudging)
        return (ssize_t)bytes;
    errno = EINTR;
    return n++ % 2 == 0 ? -1 : bytes > 0;
}

ssize_t write(int fd, const void *data, size_t bytes)
{
    ssize_t share = share_of(bytes);
    return fault() || share < 0 ? -1 : NEXT(write)(fd, data, (size_t)share);
}

ssize_t read(int fd, void *data, size_t bytes)
{
    ssize_t share = share_of(bytes);
    if (early_end)
        return 0;
    return fault() || share < 0 ? -1 : NEXT(read)(fd, data, (size_t)share);
}

int open(const char *path, int flags, ...)
{
    va_list rest;
    va_start(rest, flags);
    mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    if (unnamed_error != 0 && (flags & O_TMPFILE) == O_TMPFILE) {
        errno = unnamed_error;
        return -1;
    }
    return fault() ? -1 : NEXT(open)(path, flags, mode);
}

int openat(int dirfd, const char *path, int flags, ...)
{
    va_list rest;
    va_start(rest, flags);
    mode_t mode = (flags & (O_CREAT | O_TMPFILE)) != 0 ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return fault() ? -1 : NEXT(openat)(dirfd, path, flags, mode);
}

int close(int fd)
{
    int result = NEXT(close)(fd);
    return fault() ? -1 : result;
}

int fsync(int fd)
{
    return fault() ? -1 : NEXT(fsync)(fd);
}

int renameat(int from_dir, const char *from, int to_dir, const char *to)
{
    return fault() ? -1 : NEXT(renameat)(from_dir, from, to_dir, to);
}

int unlinkat(int dirfd, const char *name, int flags)
{
    return fault() ? -1 : NEXT(unlinkat)(dirfd, name, flags);
}

int mkdirat(int dirfd, const char *name, mode_t mode)
{
    return fault() ? -1 : NEXT(mkdirat)(dirfd, name, mode);
}

int fstat(int fd, struct stat *st)
{
    return fault() ? -1 : NEXT(fstat)(fd, st);
}

DIR *fdopendir(int fd)
{
    return fault() ? NULL : NEXT(fdopendir)(fd);
}

struct dirent *readdir(DIR *dir)
{
    return fault() ? NULL : NEXT(readdir)(dir);
}

/* ---- what they do --------------------------------------------------------------------------------- */

static int open_dir(void **state)
{
    int fd = open(*state, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    assert_true(fd >= 0);
    return fd;
}

static void count(const char *name, void *data)
{
    (void)name;
    ++*(int *)data;
}

static int entries(int dirfd)
{
    int n = 0;
    assert_int_equal(files_list(dirfd, count, &n), 0);
    return n;
}

static void test_files__what_was_written_is_read_back(void **state)
{
    int dir = open_dir(state);
    char *text;
    size_t bytes;
    assert_int_equal(files_write_durably(dir, "a", "first", 5), 0);
    assert_int_equal(files_write_durably(dir, "a", "2nd\0x", 5), 0);
    assert_int_equal(files_read(dir, "a", &text, &bytes), 0);
    assert_int_equal(bytes, 5);
    assert_memory_equal(text, "2nd\0x", 6); /* with the NUL behind it */
    free(text);
    assert_int_equal(files_write_durably(dir, "empty", "", 0), 0);
    assert_int_equal(files_read(dir, "empty", &text, &bytes), 0);
    assert_int_equal(bytes, 0);
    free(text);
    assert_int_equal(files_read(dir, "none", &text, &bytes), -1);
    assert_int_equal(errno, ENOENT);
    close(dir);
}

static void test_files__a_failed_write_leaves_the_old_file_and_nothing_else(void **state)
{
    int dir = open_dir(state);
    struct rlimit old, small;
    char *text, big[5000] = "";
    size_t bytes;
    assert_int_equal(files_write_durably(dir, "a", "old", 3), 0);
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
    small = (struct rlimit){1000, old.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    int written = files_write_durably(dir, "a", big, sizeof big);
    int error = errno;
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
    assert_int_equal(written, -1);
    assert_int_equal(error, EFBIG);
    assert_int_equal(entries(dir), 1);
    assert_int_equal(files_read(dir, "a", &text, &bytes), 0);
    assert_string_equal(text, "old");
    free(text);
    close(dir);
}

static void test_files__a_published_folder_replaces_an_older_one(void **state)
{
    int dir = open_dir(state), fd;
    struct stat st;
    assert_int_equal(files_make_dir(dir, "old", &fd), 0);
    assert_int_equal(files_write_durably(fd, "x", "1", 1), 0);
    close(fd);
    assert_int_equal(files_make_dir(dir, "new.tmp", &fd), 0);
    assert_int_equal(files_write_durably(fd, "y", "2", 1), 0);
    close(fd);
    assert_int_equal(files_publish_dir(dir, "new.tmp", "old"), 0);
    assert_int_equal(fstatat(dir, "old/y", &st, 0), 0);
    assert_int_equal(fstatat(dir, "old/x", &st, 0), -1);
    assert_int_equal(entries(dir), 1);
    assert_int_equal(files_publish_dir(dir, "none.tmp", "old"), -1);
    assert_int_equal(fstatat(dir, "old/y", &st, 0), 0); /* untouched */
    close(dir);
}

static void test_files__removing_takes_files_folders_and_what_is_not_there(void **state)
{
    int dir = open_dir(state), fd;
    assert_int_equal(files_make_dir(dir, "d", &fd), 0);
    for (int i = 0; i < 20; i++) {
        char name[2] = {(char)('a' + i), '\0'};
        assert_int_equal(files_write_durably(fd, name, "x", 1), 0);
    }
    close(fd);
    assert_int_equal(files_write_durably(dir, "f", "x", 1), 0);
    assert_int_equal(files_remove(dir, "d"), 0);
    assert_int_equal(files_remove(dir, "f"), 0);
    assert_int_equal(files_remove(dir, "f"), 0);
    assert_int_equal(entries(dir), 0);
    close(dir);
}

static void test_files__a_probe_tells_whether_a_folder_takes_writes(void **state)
{
    char missing[4096];
    int dir = open_dir(state);
    snprintf(missing, sizeof missing, "%s/missing", (const char *)*state);
    assert_int_equal(files_probe(*state), 0);
    assert_int_equal(entries(dir), 0);
    assert_int_equal(files_probe(missing), -1);
    assert_int_equal(errno, ENOENT);
    close(dir);
}

/* ---- what they do when something fails ------------------------------------------------------------ */

static bool holds(int dir, const char *name, const char *wanted)
{
    char *text = NULL;
    size_t bytes;
    bool same = files_read(dir, name, &text, &bytes) == 0 && strcmp(text, wanted) == 0;
    free(text);
    return same;
}

static int do_write(int dir)
{
    return files_write_durably(dir, "a", "new", 3);
}

static int do_publish(int dir)
{
    return files_publish_dir(dir, "d.tmp", "d");
}

static int do_remove(int dir)
{
    return files_remove(dir, "d");
}

static int do_read(int dir)
{
    char *text = NULL;
    size_t bytes;
    int result = files_read(dir, "a", &text, &bytes);
    assert_int_equal(text == NULL, result != 0);
    free(text);
    return result;
}

static int do_make(int dir)
{
    int fd = -1, result = files_make_dir(dir, "d", &fd);
    assert_int_equal(fd < 0, result != 0);
    if (fd >= 0)
        close(fd);
    return result;
}

static int do_list(int dir)
{
    int n = 0;
    return files_list(dir, count, &n);
}

static const char *path_of_dir;

static int do_probe(int dir)
{
    (void)dir;
    return files_probe(path_of_dir);
}

static int do_unnamed(int dir)
{
    (void)dir;
    int fd = files_open_unnamed(path_of_dir);
    if (fd >= 0)
        close(fd);
    return fd >= 0 ? 0 : -1;
}

/* a: "old"; d with "old" in x; d.tmp with "new" in x. */
static void lay_out(int dir)
{
    const char *const folder[] = {"d", "d.tmp"}, *const text[] = {"old", "new"};
    assert_int_equal(files_write_durably(dir, "a", "old", 3), 0);
    for (int i = 0; i < 2; i++) {
        int fd;
        assert_int_equal(files_make_dir(dir, folder[i], &fd), 0);
        assert_int_equal(files_write_durably(fd, "x", text[i], 3), 0);
        close(fd);
    }
}

/* Each call that `run` makes fails in turn, but for the closing of what was read: -1 and EIO, and what there
 * was before is there, or what was to be, and nothing besides. Returns how many failed. */
static int sweep_calls(void **state, int (*run)(int dir))
{
    int dir = open_dir(state), failed = 0;
    bool over = false;
    path_of_dir = *state;
    for (long n = 0; !over; n++) {
        lay_out(dir);
        calls = n;
        int result = run(dir), error = errno;
        over = calls >= 0;
        calls = -1;
        assert_true(result == 0 || (result == -1 && error == EIO && !over));
        failed -= result;
        assert_true(holds(dir, "a", "old") || holds(dir, "a", "new"));
        assert_true(run == do_remove || holds(dir, "d.tmp/x", "new") || holds(dir, "d/x", "new"));
        assert_true(entries(dir) <= 3);
        if (result != 0 && run != do_publish)
            assert_int_equal(run(dir), 0);
    }
    close(dir);
    return failed;
}

static void test_files__each_call_may_fail(void **state)
{
    assert_int_equal(sweep_calls(state, do_write), 6); /* open, write, sync, close, rename, sync */
    assert_int_equal(sweep_calls(state, do_make), 2);
    assert_int_equal(sweep_calls(state, do_probe), 2);
    assert_int_equal(sweep_calls(state, do_unnamed), 1);
    assert_true(sweep_calls(state, do_list) >= 3);
    assert_true(sweep_calls(state, do_read) >= 3);
    assert_true(sweep_calls(state, do_remove) >= 6);
    assert_true(sweep_calls(state, do_publish) >= 8);
}

static void test_files__a_read_without_memory_or_of_a_file_cut_short_fails(void **state)
{
    int dir = open_dir(state);
    char *text = NULL;
    size_t bytes;
    lay_out(dir);
    early_end = true;
    assert_int_equal(files_read(dir, "a", &text, &bytes), -1);
    assert_int_equal(errno, EIO);
    early_end = false;
#ifdef CAN_FAIL_ALLOCATIONS
    countdown = 0;
    assert_int_equal(files_read(dir, "a", &text, &bytes), -1);
    assert_int_equal(errno, ENOMEM);
    countdown = -1;
#endif
    assert_null(text);
    close(dir);
}

static void test_files__short_and_interrupted_calls_go_on(void **state)
{
    int dir = open_dir(state);
    grudging = true;
    assert_int_equal(files_write_durably(dir, "a", "slowly", 6), 0);
    assert_true(holds(dir, "a", "slowly"));
    grudging = false;
    assert_true(holds(dir, "a", "slowly"));
    close(dir);
}

static void test_files__without_unnamed_files_one_is_unlinked_at_once(void **state)
{
    const int none[] = {EOPNOTSUPP, EISDIR};
    int dir = open_dir(state);
    char path[5000];
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) {
        unnamed_error = none[i];
        int fd = files_open_unnamed(*state);
        assert_true(fd >= 0);
        assert_int_equal(write(fd, "x", 1), 1);
        assert_int_equal(entries(dir), 0);
        close(fd);
        assert_int_equal(files_probe(*state), 0);
        memset(path, '/', sizeof path - 1);
        path[4096 - sizeof "/spool.XXXXXX"] = '\0';
        fd = files_open_unnamed(path); /* longest: it is the root, by many slashes */
        if (fd >= 0)
            close(fd);
        assert_true(fd >= 0 || errno != ENAMETOOLONG);
        path[4096 - sizeof "/spool.XXXXXX"] = '/';
        path[4097 - sizeof "/spool.XXXXXX"] = '\0';
        assert_int_equal(files_open_unnamed(path), -1);
        assert_int_equal(errno, ENAMETOOLONG);
    }
    unnamed_error = ENOSPC;
    assert_int_equal(files_open_unnamed(*state), -1);
    assert_int_equal(files_probe(*state), -1);
    assert_int_equal(errno, ENOSPC);
    unnamed_error = 0;
    close(dir);
}

static void test_files__a_name_too_long_is_refused(void **state)
{
    int dir = open_dir(state);
    char name[257];
    memset(name, 'n', sizeof name - 1);
    name[256] = '\0';
    assert_int_equal(files_write_durably(dir, name, "x", 1), -1);
    assert_int_equal(errno, ENAMETOOLONG);
    assert_int_equal(entries(dir), 0);
    close(dir);
}

static void test_files__sizes_are_those_of_the_files(void **state)
{
    int dir = open_dir(state), fd;
    lay_out(dir);
    assert_int_equal(files_size(dir, "a"), 3);
    assert_int_equal(files_make_dir(dir, "d", &fd), 0);
    assert_int_equal(files_write_durably(fd, "y", "12345", 5), 0);
    close(fd);
    assert_int_equal(files_size(dir, "d"), 8);
    assert_int_equal(files_size(dir, "none"), 0);
    calls = 0; /* a folder that cannot be opened */
    assert_int_equal(files_size(dir, "d"), 0);
    calls = -1;
    close(dir);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_files__what_was_written_is_read_back),
        TEST(test_files__a_failed_write_leaves_the_old_file_and_nothing_else),
        TEST(test_files__a_published_folder_replaces_an_older_one),
        TEST(test_files__removing_takes_files_folders_and_what_is_not_there),
        TEST(test_files__a_probe_tells_whether_a_folder_takes_writes),
        TEST(test_files__each_call_may_fail),
        TEST(test_files__a_read_without_memory_or_of_a_file_cut_short_fails),
        TEST(test_files__short_and_interrupted_calls_go_on),
        TEST(test_files__without_unnamed_files_one_is_unlinked_at_once),
        TEST(test_files__a_name_too_long_is_refused),
        TEST(test_files__sizes_are_those_of_the_files),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
