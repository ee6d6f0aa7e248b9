/* scarce.h - replaces the allocator of a test program, so that the n-th allocation can be made to fail.
 *
 * Include it in one file of the program. Set `countdown` to n for the n-th allocation from now on,
 * counted from 0, to fail once; afterwards it is -1. `asked` counts the allocations asked for, `held`
 * those not yet freed. Allocations made by the BLAS never fail and are not counted as asked for:
 * OpenBLAS's small kernels take scratch and do not check it, which is not ours to test. Sanitizers
 * bring their own allocator: without CAN_FAIL_ALLOCATIONS such a test skips itself. One thread; or, where
 * SCARCE_PER is defined as _Thread_local before, each thread for itself. */
#ifndef DRAPED_TEST_SCARCE_H
#define DRAPED_TEST_SCARCE_H

#include <dlfcn.h>
#include <errno.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define CAN_FAIL_ALLOCATIONS 1

void *__libc_malloc(size_t);
void *__libc_calloc(size_t, size_t);
void *__libc_realloc(void *, size_t);
void *__libc_memalign(size_t, size_t);
void __libc_free(void *);
int posix_memalign(void **ret, size_t alignment, size_t size);
void *aligned_alloc(size_t alignment, size_t size);
void *memalign(size_t alignment, size_t size);

#ifndef SCARCE_PER
#define SCARCE_PER
#endif

static SCARCE_PER long countdown = -1; /* allocations that still succeed; -1: all */
static SCARCE_PER long asked;
static SCARCE_PER long held;

static bool fails(const void *caller)
{
    Dl_info info;
    if (dladdr(caller, &info) && strstr(info.dli_fname, "blas"))
        return false;
    asked++;
    if (countdown < 0 || countdown-- > 0)
        return false;
    errno = ENOMEM;
    return true;
}

static void *counted(void *fresh)
{
    held += fresh != NULL;
    return fresh;
}

void *malloc(size_t size)
{
    return fails(__builtin_return_address(0)) ? NULL : counted(__libc_malloc(size));
}

void *calloc(size_t count, size_t size)
{
    return fails(__builtin_return_address(0)) ? NULL : counted(__libc_calloc(count, size));
}

void *realloc(void *old, size_t size)
{
    if (fails(__builtin_return_address(0)))
        return NULL;
    void *fresh = __libc_realloc(old, size);
    return old ? fresh : counted(fresh);
}

/* The BLAS alone asks for alignment. */
int posix_memalign(void **ret, size_t alignment, size_t size)
{
    *ret = counted(__libc_memalign(alignment, size));
    return *ret ? 0 : ENOMEM;
}

void *aligned_alloc(size_t alignment, size_t size)
{
    return counted(__libc_memalign(alignment, size));
}

void *memalign(size_t alignment, size_t size)
{
    return counted(__libc_memalign(alignment, size));
}

void free(void *p)
{
    held -= p != NULL;
    __libc_free(p);
}
#endif

#endif
