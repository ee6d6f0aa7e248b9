/* floor.c - prints as JSON what one processor of this machine can do at best: what `make bench` measures the
 * solver's factorisations and back-solves against.
 *   dgemm_flops    floating-point operations a second of a large matrix product, by the BLAS of the solver
 *   stream_bytes   bytes a second read from memory */
#include <cblas.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define SIZE  1536               /* of the matrices */
#define WORDS ((size_t)32 << 20) /* 256 MiB of doubles, far more than any cache */
#define TIMES 7                  /* the best of them counts: the others were disturbed */

void openblas_set_num_threads(int threads);

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double best_product(const double *a, double *c)
{
    double best = 0;
    for (int i = 0; i < TIMES; i++) {
        double began = now();
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, SIZE, SIZE, SIZE, 1, a, SIZE, a, SIZE, 0, c,
                    SIZE);
        double rate = 2.0 * SIZE * SIZE * SIZE / (now() - began);
        best = rate > best ? rate : best;
    }
    return best;
}

/* *sum keeps the compiler from leaving the loop out. */
static double best_stream(const double *a, double *sum)
{
    double best = 0;
    for (int i = 0; i < TIMES; i++) {
        double began = now(), part[8] = {0};
        for (size_t j = 0; j < WORDS; j += 8)
            for (size_t k = 0; k < 8; k++)
                part[k] += a[j + k];
        double rate = (double)(WORDS * sizeof *a) / (now() - began);
        best = rate > best ? rate : best;
        for (size_t k = 0; k < 8; k++)
            *sum += part[k];
    }
    return best;
}

int main(void)
{
    double *a = malloc(WORDS * sizeof *a), *c = malloc(sizeof *c * SIZE * SIZE), sum = 0;
    if (!a || !c)
        return 1;
    openblas_set_num_threads(1);
    for (size_t i = 0; i < WORDS; i++)
        a[i] = 1e-3 * (double)(i % 1000);
    double flops = best_product(a, c), bytes = best_stream(a, &sum);
    printf("{\"dgemm_flops\": %.3e, \"stream_bytes\": %.3e}\n", flops, bytes);
    free(a);
    free(c);
    return sum < 0;
}
