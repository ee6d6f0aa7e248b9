/* scratch.h - a fresh data folder for a test, removed afterwards. */
#ifndef DRAPED_SCRATCH_H
#define DRAPED_SCRATCH_H

#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "test.h"

static inline int scratch_remove_entry(const char *path, const struct stat *st, int type, struct FTW *ftw)
{
    (void)st, (void)type, (void)ftw;
    return remove(path);
}

static inline int scratch_new(void **state)
{
    const char *base = getenv("TMPDIR");
    char *path;
    if (asprintf(&path, "%s/draped-unit.XXXXXX", base ? base : "/tmp") < 0 || mkdtemp(path) == NULL)
        return -1;
    *state = path;
    return 0;
}

static inline int scratch_free(void **state)
{
    nftw(*state, scratch_remove_entry, 16, FTW_DEPTH | FTW_PHYS);
    free(*state);
    return 0;
}

/* A job: a square cloth of 2 n^2 triangles, 0.2 m wide, held along an edge. The caller frees it. */
static inline char *scratch_square(int n, const char *method, int max_iterations)
{
    char *text;
    size_t size;
    FILE *out = open_memstream(&text, &size);
    int m = n + 1;
    fputs("{\"name\":\"square\",\"labels\":{\"order\":\"4711\"},\"cloth\":{\"mesh\":{\"positions\":[", out);
    for (int i = 0; i < m * m; i++)
        fprintf(out, "%s%g,0,%g", i ? "," : "", 0.2 / n * (i / m), 0.2 / n * (i % m));
    fputs("],\"pattern\":[", out);
    for (int i = 0; i < m * m; i++)
        fprintf(out, "%s%g,%g", i ? "," : "", 0.2 / n * (i / m), 0.2 / n * (i % m));
    fputs("],\"triangles\":[", out);
    for (int i = 0; i < n * n; i++) {
        int a = i / n * m + i % n, b = a + m;
        fprintf(out, "%s%d,%d,%d,%d,%d,%d", i ? "," : "", a, a + 1, b + 1, a, b + 1, b);
    }
    fputs("]},\"pins\":[", out);
    for (int i = 0; i < m; i++)
        fprintf(out, "%s%d", i ? "," : "", i);
    fprintf(out,
            "],\"materials\":[{\"density\":0.15,\"stretch\":{\"weft\":400,\"warp\":400,\"shear\":150},"
            "\"poisson\":0.2,\"bend\":{\"weft\":1e-5,\"warp\":1e-5,\"twist\":5e-6}}]},"
            "\"solver\":{\"method\":\"%s\",\"tolerance\":%s,\"max_iterations\":%d}}",
            method, strcmp(method, "dynamic") == 0 ? "1e-12" : "0.01", max_iterations);
    fclose(out);
    return text;
}

#endif
