/* scarce.h - replaces the allocator of a test program, so that the n-th allocation can be made to fail.
 *
 * Include it in one file of the program. fail_at(n), or `countdown` set to n, has the n-th allocation from
 * now on fail once, counted from 0; afterwards `countdown` is -1. With `lasting` every one after it fails,
 * too, until has_failed() or `countdown` set to -1. `denied` counts those that failed, `asked` the
 * allocations asked for, `held` those not yet freed.
 *
 * Allocations made by the BLAS and by libgomp never fail and are not counted as asked for: OpenBLAS's small
 * kernels take scratch and do not check it, and libgomp ends the process, which is not ours to test. Another
 * library than libgomp is spared where SCARCE_SPARES names it before. Under AddressSanitizer memory is its
 * own; ThreadSanitizer lets nobody between: without CAN_FAIL_ALLOCATIONS such a test skips itself.
 *
 * All of it is each thread's own: what OpenBLAS's threads ask for as they start, or AddressSanitizer for
 * them, is no concern of the test's. */
#ifndef DRAPED_TEST_SCARCE_H
#define DRAPED_TEST_SCARCE_H

#include <dlfcn.h>
#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#if defined(__GLIBC__) && !defined(__SANITIZE_THREAD__)
#define CAN_FAIL_ALLOCATIONS 1

/* What is below runs before AddressSanitizer has its shadow. */
#ifdef __SANITIZE_ADDRESS__
#define ALLOCATOR(name) __interceptor_##name
#define UNWATCHED       __attribute__((no_sanitize_address))
#else
#define ALLOCATOR(name) __libc_##name
#define UNWATCHED
#endif

void *ALLOCATOR(malloc)(size_t);
void *ALLOCATOR(calloc)(size_t, size_t);
void *ALLOCATOR(realloc)(void *, size_t);
void *ALLOCATOR(memalign)(size_t, size_t);
void ALLOCATOR(free)(void *);
int posix_memalign(void **ret, size_t alignment, size_t size);
void *aligned_alloc(size_t alignment, size_t size);
void *memalign(size_t alignment, size_t size);

#ifndef SCARCE_SPARES
#define SCARCE_SPARES "libgomp"
#endif

static _Thread_local long countdown = -1; /* allocations that still succeed; -1: all */
static _Thread_local bool lasting;
static _Thread_local long denied;
static _Thread_local long asked;
static _Thread_local long held;
static bool begun; /* the program: its libraries are loaded */

__attribute__((constructor)) static void begin_to_count(void)
{
    begun = true;
}

UNWATCHED static bool fails(const void *caller)
{
    Dl_info info;
    if (!begun)
        return false;
    if (dladdr(caller, &info) && (strstr(info.dli_fname, "blas") || strstr(info.dli_fname, SCARCE_SPARES)))
        return false;
    asked++;
    if (countdown < 0)
        return false;
    if (countdown > 0) {
        countdown--;
        return false;
    }
    if (!lasting)
        countdown = -1;
    denied++;
    errno = ENOMEM;
    return true;
}

UNWATCHED static void *counted(void *fresh)
{
    held += fresh != NULL;
    return fresh;
}

UNWATCHED void *malloc(size_t size)
{
    return fails(__builtin_return_address(0)) ? NULL : counted(ALLOCATOR(malloc)(size));
}

UNWATCHED void *calloc(size_t count, size_t size)
{
    return fails(__builtin_return_address(0)) ? NULL : counted(ALLOCATOR(calloc)(count, size));
}

UNWATCHED void *realloc(void *old, size_t size)
{
    if (fails(__builtin_return_address(0)))
        return NULL;
    void *fresh = ALLOCATOR(realloc)(old, size);
    return old ? fresh : counted(fresh);
}

/* The BLAS alone asks for alignment. */
UNWATCHED int posix_memalign(void **ret, size_t alignment, size_t size)
{
    *ret = counted(ALLOCATOR(memalign)(alignment, size));
    return *ret ? 0 : ENOMEM;
}

UNWATCHED void *aligned_alloc(size_t alignment, size_t size)
{
    return counted(ALLOCATOR(memalign)(alignment, size));
}

UNWATCHED void *memalign(size_t alignment, size_t size)
{
    return counted(ALLOCATOR(memalign)(alignment, size));
}

#ifdef __SANITIZE_ADDRESS__
/* Its own would take memory past us. */
char *strdup(const char *text)
{
    size_t bytes = strlen(text) + 1;
    char *copy = malloc(bytes);
    return copy ? memcpy(copy, text, bytes) : NULL;
}
#endif

UNWATCHED void free(void *p)
{
    held -= p != NULL;
    ALLOCATOR(free)(p);
}

/* The n-th allocation from now on fails, counted from 0. */
static inline void fail_at(long n)
{
    denied = 0;
    countdown = n;
}

/* None fails from now on; whether one did since. */
static inline bool has_failed(void)
{
    countdown = -1;
    return denied > 0;
}
#endif

#endif
