/* test_files.c - files are whole or not there. */
#include "scratch.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "files.h"

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

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, scratch_new, scratch_free)
    const struct CMUnitTest tests[] = {
        TEST(test_files__what_was_written_is_read_back),
        TEST(test_files__a_failed_write_leaves_the_old_file_and_nothing_else),
        TEST(test_files__a_published_folder_replaces_an_older_one),
        TEST(test_files__removing_takes_files_folders_and_what_is_not_there),
        TEST(test_files__a_probe_tells_whether_a_folder_takes_writes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
