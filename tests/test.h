/* test.h - cmocka, plus checks that print both values and the error between them. */
#ifndef DRAPED_TEST_H
#define DRAPED_TEST_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

/* |a - b| <= tol * max(|a|, |b|, scale) */
static inline void test_close(double a, double b, double tol, double scale, const char *what,
                              const char *file, int line)
{
    double size = fmax(fmax(fabs(a), fabs(b)), scale);
    double error = size > 0 ? fabs(a - b) / size : 0;
    if (!(error <= tol)) {
        print_error("%s:%d: %s: %.17g against %.17g, relative error %.3g > %.3g\n", file, line, what, a, b,
                    error, tol);
        fail();
    }
}
#define assert_close(a, b, tol)       test_close((a), (b), (tol), 0, #a " = " #b, __FILE__, __LINE__)
#define assert_near(a, b, tol, scale) test_close((a), (b), (tol), (scale), #a " = " #b, __FILE__, __LINE__)

/* A small generator with a fixed seed: the same numbers on every machine (xorshift64*). */
static inline double test_random(uint64_t *state) /* uniform in [-1, 1) */
{
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    return (double)((*state * 0x2545F4914F6CDD1DULL) >> 11) * 0x1p-52 - 1;
}

#endif
