/* test_plot.c - the plot where memory is short: there is none, and the process lives. Each in a child of its
 * own, which has not loaded PLplot's drivers yet. */
#include "test.h"

#include <signal.h>
#include <stdio.h>
#include <sys/wait.h>
#include <unistd.h>

/* It does not look whether it got what it asked for; nor does tests/preload/faults.c fail it. */
#define SCARCE_SPARES "libplplot"
#include "../solver/scarce.h"
#include "plot.h"
#include "scratch.h"

#ifdef CAN_FAIL_ALLOCATIONS

enum { DRAWN, NOT_DRAWN, NONE_DENIED };

static int plot(void)
{
    drape_row row[4];
    char *svg = NULL;
    size_t bytes;
    memset(row, 0, sizeof row);
    for (uint32_t i = 0; i < 4; i++) {
        row[i].iteration = i;
        row[i].seconds = 0.1 * i;
        row[i].residual_force = row[i].residual_energy = 1.0 / (1 + i);
    }
    int failed = plot_trace_svg(row, 4, 1e-2, "not-at-rest after 3 iterations", &svg, &bytes);
    bool whole = !failed && bytes > 1000;
    free(svg);
    return whole ? DRAWN : NOT_DRAWN;
}

/* Runs it in a child; how that ended. */
static int in_child(int (*run)(long n), long n)
{
    int status;
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        signal(SIGSEGV, SIG_DFL); /* not cmocka's, which would go on to the next test */
        _exit(freopen("/dev/null", "w", stderr) ? run(n) : 99);
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    if (!WIFEXITED(status))
        fail_msg("the child died of signal %d, n = %ld", WTERMSIG(status), n);
    return WEXITSTATUS(status);
}

/* Two plots, of which the n-th allocation fails; with `lasting` all that follow it in the first one. */
static int plot_twice(long n)
{
    fail_at(n);
    plot();
    return has_failed() ? plot() : NONE_DENIED;
}

static void test_plot__no_failed_allocation_but_plplots_own_ends_the_process(void **state)
{
    setenv("TMPDIR", *state, 1); /* PLplot leaves a file when it is left: there, or where it stands */
    assert_int_equal(chdir(*state), 0);
    long drawn = 0, n;
    for (int all = 0; all < 2; all++) {
        lasting = all;
        for (n = 0;; n++) {
            int end = in_child(plot_twice, n);
            if (end == NONE_DENIED)
                break;
            assert_in_range(end, DRAWN, NOT_DRAWN);
            drawn += end == DRAWN;
        }
        assert_true(n > 40);
    }
    lasting = false;
    assert_true(drawn > 40); /* most failures are over with the plot they befell */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_plot__no_failed_allocation_but_plplots_own_ends_the_process,
                                        scratch_new, scratch_free),
    };
    return cmocka_run_group_tests_name("plot", tests, NULL, NULL);
}
#else
static void test_plot__no_failed_allocation_but_plplots_own_ends_the_process(void **state)
{
    (void)state;
    skip(); /* allocations cannot be made to fail here */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_plot__no_failed_allocation_but_plplots_own_ends_the_process)};
    return cmocka_run_group_tests_name("plot", tests, NULL, NULL);
}
#endif
