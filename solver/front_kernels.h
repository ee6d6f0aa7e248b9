/* front_kernels.h - the dense kernels of front.c, which includes it once for each instruction set.
 *
 * It takes LANES, the floats of a vector; WIDE, the columns of a tile, as many as registers hold, 4 or 16;
 * TARGET, an attribute of functions; NAME, which users read; and KERNEL(name). All work is done on strips of
 * STRIP rows, on whose multiples all columns begin and end, padded by zeros. */
#define VECTOR  KERNEL(vector)
#define LOOSE   KERNEL(loose)   /* a vector anywhere */
#define PARTS   (STRIP / LANES) /* vectors of a strip */
#define inlined static inline __attribute__((always_inline)) TARGET

typedef float VECTOR __attribute__((vector_size(4 * LANES), may_alias));
typedef float LOOSE __attribute__((vector_size(4 * LANES), may_alias, aligned(4)));

inlined void KERNEL(load)(VECTOR tile[][PARTS], const int w, const float *from, size_t lead)
{
#pragma GCC unroll 16
    for (int j = 0; j < w; j++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++)
            tile[j][p] = ((const VECTOR *)(from + (size_t)j * lead))[p];
}

inlined void KERNEL(store)(VECTOR tile[][PARTS], const int w, float *to, size_t lead)
{
#pragma GCC unroll 16
    for (int j = 0; j < w; j++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++)
            ((VECTOR *)(to + (size_t)j * lead))[p] = tile[j][p];
}

/* tile -= A B' of a strip A and w rows B of `depth` columns. */
inlined void KERNEL(subtract)(VECTOR tile[][PARTS], const int w, const float *a, const float *b, size_t lead,
                              size_t depth)
{
    for (size_t k = 0; k < depth; k++, a += lead, b += lead) {
        VECTOR part[PARTS];
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++)
            part[p] = ((const VECTOR *)a)[p];
#pragma GCC unroll 16
        for (int j = 0; j < w; j++)
#pragma GCC unroll 4
            for (int p = 0; p < PARTS; p++)
                tile[j][p] -= part[p] * b[j];
    }
}

/* tile = tile L^-T */
inlined void KERNEL(divide)(VECTOR tile[][PARTS], const int w, float L[][STRIP], const float *inverse)
{
#pragma GCC unroll 16
    for (int k = 0; k < w; k++)
#pragma GCC unroll 4
        for (int p = 0; p < PARTS; p++) {
            tile[k][p] *= inverse[k];
#pragma GCC unroll 16
            for (int j = k + 1; j < w; j++)
                tile[j][p] -= tile[k][p] * L[k][j];
        }
}

/* L of w columns whose first w rows are a symmetric matrix's lower triangle, and the inverses of its pivots.
 * Returns w or, the columns before it being done, the first one whose pivot is too small. */
inlined int KERNEL(factorise_block)(float L[][STRIP], const int w, float *inverse)
{
    for (int k = 0; k < w; k++) {
        if (!(L[k][k] > LEAST_PIVOT))
            return k;
        inverse[k] = 1 / sqrtf(L[k][k]);
        VECTOR *of_k = (VECTOR *)L[k];
        for (int p = 0; p < PARTS; p++)
            of_k[p] *= inverse[k];
        for (int j = k + 1; j < w; j++)
            for (int p = 0; p < PARTS; p++)
                ((VECTOR *)L[j])[p] -= of_k[p] * L[k][j];
    }
    return w;
}

/* Puts L where it belongs, `at` rows down a strip; zeros above it and on its diagonal, for which there are
 * the inverses. */
inlined void KERNEL(put)(float L[][STRIP], const int w, size_t at, float *strip, size_t lead)
{
    for (int j = 0; j < w; j++, strip += lead) {
        for (size_t i = 0; i <= at + (size_t)j; i++)
            strip[i] = 0;
        for (int i = j + 1; i < w; i++)
            strip[at + (size_t)i] = L[j][i];
    }
}

/* Columns k .. k + w - 1 down to row `end`, those before them being done; returns as factorise_block does. */
inlined int KERNEL(factorise_columns)(const struct panel *panel, size_t k, size_t end, const int w)
{
    _Alignas(64) float L[WIDE][STRIP] = {{0}};
    VECTOR tile[WIDE][PARTS];
    const size_t lead = panel->lead, first = k / STRIP * STRIP, at = k - first;
    const float *rows = panel->value + k; /* of these columns */
    float *column = panel->value + k * lead, *inverse = panel->inverse + k;

    KERNEL(load)(tile, w, column + first, lead);
    KERNEL(subtract)(tile, w, panel->value + first, rows, lead, k);
    KERNEL(store)(tile, w, column + first, lead);
    for (int j = 0; j < w; j++)
        memcpy(L[j], column + (size_t)j * lead + k, (size_t)w * sizeof(float));
    int done = KERNEL(factorise_block)(L, w, inverse);
    if (at + (size_t)w < STRIP && done == w) {
        KERNEL(divide)(tile, w, L, inverse);
        KERNEL(store)(tile, w, column + first, lead);
    }
    KERNEL(put)(L, w, at, column + first, lead);
    for (size_t i = first + STRIP; i < end && done == w; i += STRIP) {
        KERNEL(load)(tile, w, column + i, lead);
        KERNEL(subtract)(tile, w, panel->value + i, rows, lead, k);
        KERNEL(divide)(tile, w, L, inverse);
        KERNEL(store)(tile, w, column + i, lead);
    }
    return done;
}

/* The strips from row `first` to row `end` of columns k .. k + w - 1, which are done above. */
inlined void KERNEL(divide_columns)(const struct panel *panel, size_t k, size_t first, size_t end,
                                    const int w)
{
    float L[WIDE][STRIP];
    VECTOR tile[WIDE][PARTS];
    const size_t lead = panel->lead;
    float *column = panel->value + k * lead;
    for (int j = 0; j < w; j++)
        memcpy(L[j], column + (size_t)j * lead + k, (size_t)w * sizeof(float));
    for (size_t i = first; i < end; i += STRIP) {
        KERNEL(load)(tile, w, column + i, lead);
        KERNEL(subtract)(tile, w, panel->value + i, panel->value + k, lead, k);
        KERNEL(divide)(tile, w, L, panel->inverse + k);
        KERNEL(store)(tile, w, column + i, lead);
    }
}

/* Calls f(..., w) with the width w, known when it is compiled, of the next columns of those `left`. */
#if WIDE == 16
#define WITH_WIDTH(left, f, ...)                                                                             \
    ((left) == 4    ? KERNEL(f)(__VA_ARGS__, 4)                                                              \
     : (left) == 8  ? KERNEL(f)(__VA_ARGS__, 8)                                                              \
     : (left) == 12 ? KERNEL(f)(__VA_ARGS__, 12)                                                             \
                    : KERNEL(f)(__VA_ARGS__, 16))
#else
#define WITH_WIDTH(left, f, ...) KERNEL(f)(__VA_ARGS__, WIDE)
#endif

/* Columns from .. to - 1 of the pivots down to row to - 1, those before them being done; `from` is a multiple
 * of STRIP, and `to` one or `columns`. Returns `to` or the column before which it stopped. */
TARGET static size_t KERNEL(factorise_panel)(const struct panel *panel, size_t from, size_t to)
{
    const size_t end = (to + STRIP - 1) / STRIP * STRIP;
    for (size_t k = from; k < to; k += WIDE) {
        size_t done = (size_t)WITH_WIDTH(to - k, factorise_columns, panel, k, end);
        if (done < WIDE && k + done < to)
            return k + done;
    }
    return to;
}

/* The same columns from row `first` to row `end`, multiples of STRIP. */
TARGET static void KERNEL(divide_panel)(const struct panel *panel, size_t from, size_t to, size_t first,
                                        size_t end)
{
    for (size_t k = from; k < to; k += WIDE)
        WITH_WIDTH(to - k, divide_columns, panel, k, first, end);
}

inlined void KERNEL(multiply_columns)(const struct panel *panel, size_t k, float *update, const int w)
{
    const size_t rows = panel->rows - panel->pivots, first = k / STRIP * STRIP;
    const float *below = panel->value + panel->pivots;
    float *to = update + update_column(rows, k);
    for (size_t i = first; i < rows; i += STRIP) {
        VECTOR tile[WIDE][PARTS] = {{{0}}};
        KERNEL(subtract)(tile, w, below + i, below + k, panel->lead, panel->columns);
        KERNEL(store)(tile, w, to + i, rows - first);
    }
}

/* update = -B B' (lower triangle) of the rows B below the pivots. */
TARGET static void KERNEL(multiply_panel)(const struct panel *panel, float *update)
{
    for (size_t k = 0; k < panel->updates; k += WIDE)
        WITH_WIDTH(panel->updates - k, multiply_columns, panel, k, update);
}

/* Adds `length` rows of three columns from row_from on to those from row_to on. */
inlined void KERNEL(add_rows)(float *const to[3], size_t row_to, const float *const from[3], size_t row_from,
                              size_t length)
{
    size_t i = 0;
    for (; i + LANES <= length; i += LANES)
#pragma GCC unroll 3
        for (size_t c = 0; c < 3; c++)
            *(LOOSE *)(to[c] + row_to + i) += *(const LOOSE *)(from[c] + row_from + i);
#if LANES == 16
    const __mmask16 rest = (__mmask16)((1u << (length - i)) - 1);
#pragma GCC unroll 3
    for (size_t c = 0; c < 3 && rest; c++) {
        __m512 a = _mm512_maskz_loadu_ps(rest, to[c] + row_to + i);
        __m512 b = _mm512_maskz_loadu_ps(rest, from[c] + row_from + i);
        _mm512_mask_storeu_ps(to[c] + row_to + i, rest, _mm512_add_ps(a, b));
    }
#else
    for (; i < length; i++)
        for (size_t c = 0; c < 3; c++)
            to[c][row_to + i] += from[c][row_from + i];
#endif
}

/* Adds the columns of a run, from the diagonal down; the rows end with those of the run before `end`. */
TARGET static void KERNEL(add_run)(const struct run *run, const struct run *end,
                                   const struct addition *addition)
{
    const size_t base = addition->base, lead_to = addition->lead_to;
    for (size_t j = 0; j < run->length; j += 3) {
        const float *from[3];
        float *to[3];
        size_t row_from = run->from + j, row_to = run->to + j - base;
        for (size_t c = 0; c < 3; c++) {
            from[c] = addition->from + update_column(addition->rows_from, row_from + c);
            to[c] = addition->to +
                    (lead_to ? (row_to + c) * lead_to : update_column(addition->rows_to, row_to + c));
        }
        for (size_t c = 0; c < 3; c++)
            for (size_t r = c; r < 3; r++)
                to[c][row_to + r] += from[c][row_from + r];
        KERNEL(add_rows)(to, row_to + 3, from, row_from + 3, run->length - j - 3);
        for (const struct run *other = run + 1; other < end; other++)
            KERNEL(add_rows)(to, other->to - base, from, other->from, other->length);
    }
}

/* Four strips' worth of the factor, which is read from memory, panel by panel from end to end; panels are too
 * short for the processor to foresee that. */
inlined void KERNEL(fetch)(const float *ahead)
{
    __builtin_prefetch(ahead, 0, 2);
    __builtin_prefetch(ahead + STRIP, 0, 2);
    __builtin_prefetch(ahead + 2 * STRIP, 0, 2);
    __builtin_prefetch(ahead + 3 * STRIP, 0, 2);
}

/* x: the panel's rows. Solves with the pivots' rows and subtracts what that makes in those below. */
TARGET static void KERNEL(forward)(const struct panel *panel, float *x)
{
    const size_t lead = panel->lead;
    for (size_t k = 0; k < panel->columns; k += 4) {
        const size_t first = k / STRIP * STRIP;
        const float *a = panel->value + k * lead, *b = a + lead, *c = b + lead, *d = c + lead;
        const float *inverse = panel->inverse + k;
        float xa = x[k] * inverse[0], xb = (x[k + 1] - a[k + 1] * xa) * inverse[1];
        float xc = (x[k + 2] - a[k + 2] * xa - b[k + 2] * xb) * inverse[2];
        float xd = (x[k + 3] - a[k + 3] * xa - b[k + 3] * xb - c[k + 3] * xc) * inverse[3];
        for (size_t i = first; i < panel->rows; i += LANES) {
            if (i % STRIP == 0)
                KERNEL(fetch)(a + 4 * (i - first) + AHEAD);
            *(VECTOR *)(x + i) -= *(const VECTOR *)(a + i) * xa + *(const VECTOR *)(b + i) * xb +
                                  *(const VECTOR *)(c + i) * xc + *(const VECTOR *)(d + i) * xd;
        }
        x[k] = xa, x[k + 1] = xb, x[k + 2] = xc, x[k + 3] = xd;
    }
}

inlined float KERNEL(sum)(const VECTOR *v)
{
    float part[LANES];
    memcpy(part, v, sizeof part);
#pragma GCC unroll 4
    for (int half = LANES / 2; half; half /= 2)
#pragma GCC unroll 8
        for (int i = 0; i < half; i++)
            part[i] += part[i + half];
    return part[0];
}

/* The transposed: the rows below are given, those of the pivots solved for. */
TARGET static void KERNEL(backward)(const struct panel *panel, float *x)
{
    const size_t lead = panel->lead;
    for (size_t k = panel->columns; k > 0;) {
        k -= 4;
        const size_t first = k / STRIP * STRIP;
        const float *a = panel->value + k * lead, *b = a + lead, *c = b + lead, *d = c + lead;
        const float *inverse = panel->inverse + k;
        float xa = x[k], xb = x[k + 1], xc = x[k + 2], xd = x[k + 3];
        VECTOR sum[4] = {{0}};
        x[k] = x[k + 1] = x[k + 2] = x[k + 3] = 0;
        for (size_t i = first; i < panel->rows; i += LANES) {
            VECTOR of_x = *(VECTOR *)(x + i);
            if (i % STRIP == 0)
                KERNEL(fetch)(a + 4 * (i - first) - AHEAD);
            sum[0] += *(const VECTOR *)(a + i) * of_x;
            sum[1] += *(const VECTOR *)(b + i) * of_x;
            sum[2] += *(const VECTOR *)(c + i) * of_x;
            sum[3] += *(const VECTOR *)(d + i) * of_x;
        }
        xd = (xd - KERNEL(sum)(sum + 3)) * inverse[3];
        xc = (xc - KERNEL(sum)(sum + 2) - c[k + 3] * xd) * inverse[2];
        xb = (xb - KERNEL(sum)(sum + 1) - b[k + 2] * xc - b[k + 3] * xd) * inverse[1];
        xa = (xa - KERNEL(sum)(sum) - a[k + 1] * xb - a[k + 2] * xc - a[k + 3] * xd) * inverse[0];
        x[k] = xa, x[k + 1] = xb, x[k + 2] = xc, x[k + 3] = xd;
    }
}

static const struct kernels KERNEL(kernels) = {NAME,
                                               KERNEL(factorise_panel),
                                               KERNEL(divide_panel),
                                               KERNEL(multiply_panel),
                                               KERNEL(forward),
                                               KERNEL(backward),
                                               KERNEL(add_run)};

#undef VECTOR
#undef LOOSE
#undef PARTS
#undef WITH_WIDTH
#undef inlined
#undef LANES
#undef WIDE
#undef TARGET
#undef KERNEL
#undef NAME
