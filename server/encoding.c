/* encoding.c - see encoding.h. */
#include "encoding.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#define ZLIB_CONST
#include <zlib.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "memout.h"

#define PIECE 65536

#define GZIP_WBITS  (15 + 16) /* the largest window, in gzip's frame */
#define ZSTD_WINDOW 23        /* log2: what the "zstd" coding allows (RFC 9659) */

/* Of a drape of 30 000 vertices as JSON (3.4 MB): gzip -2 0.68 MB in 34 ms, -4 0.58 in 137, -6 0.54 in 588;
 * zstd -1 0.50 in 30, -3 0.46 in 41, -6 0.46 in 129. */
#define GZIP_LEVEL 2
#define ZSTD_LEVEL 3

static const struct {
    const char *name, *suffix;
} coding_table[CODINGS] = {
    [CODING_IDENTITY] = {"identity", ""}, [CODING_GZIP] = {"gzip", "gz"}, [CODING_ZSTD] = {"zstd", "zst"}};

const char *coding_name(enum coding coding)
{
    return coding_table[coding].name;
}

const char *coding_suffix(enum coding coding)
{
    return coding_table[coding].suffix;
}

int coding_from_name(const char *name, size_t bytes)
{
    for (int i = 0; i < CODINGS; i++)
        if (strlen(coding_table[i].name) == bytes && strncasecmp(name, coding_table[i].name, bytes) == 0)
            return i;
    return bytes == 6 && strncasecmp(name, "x-gzip", 6) == 0 ? CODING_GZIP : -1; /* RFC 9110, 8.4.1.3 */
}

/* ---- decoding ---------------------------------------------------------------------------------------- */

struct decoder { /* what both share: where the pieces go, and how many bytes still may */
    encoding_sink_fn *sink;
    void *sink_data;
    size_t left;
    const char *why;
    unsigned char piece[PIECE];
};

static enum decoding corrupt(struct decoder *d, const char *why)
{
    d->why = why;
    return DECODING_CORRUPT;
}

/* Hands on the `bytes` in d->piece. */
static enum decoding pass(struct decoder *d, size_t bytes)
{
    if (bytes > d->left)
        return DECODING_TOO_LARGE;
    d->left -= bytes;
    return bytes > 0 && d->sink(d->piece, bytes, d->sink_data) != 0 ? DECODING_STOPPED : DECODING_OK;
}

static enum decoding gzip_member(struct decoder *d, z_stream *z, const unsigned char *end)
{
    for (;;) {
        size_t left = (size_t)(end - z->next_in);
        z->avail_in = left > PIECE ? PIECE : (uInt)left;
        z->next_out = d->piece;
        z->avail_out = PIECE;
        int code = inflate(z, Z_NO_FLUSH);
        if (code == Z_MEM_ERROR)
            return DECODING_NO_MEMORY;
        if (code != Z_OK && code != Z_STREAM_END && code != Z_BUF_ERROR)
            return corrupt(d, "it is not gzip, or damaged");
        enum decoding result = pass(d, PIECE - z->avail_out);
        if (result != DECODING_OK || code == Z_STREAM_END)
            return result;
        if (z->next_in == end && z->avail_out > 0)
            return corrupt(d, "it ends early");
    }
}

static enum decoding decode_gzip(struct decoder *d, const unsigned char *data, size_t bytes)
{
    z_stream z = {.next_in = data};
    const unsigned char *end = data + bytes;
    enum decoding result;
    if (inflateInit2(&z, GZIP_WBITS) != Z_OK)
        return DECODING_NO_MEMORY;
    do
        result = gzip_member(d, &z, end);
    while (result == DECODING_OK && z.next_in < end && inflateReset(&z) == Z_OK);
    inflateEnd(&z);
    return result;
}

static enum decoding decode_zstd(struct decoder *d, const unsigned char *data, size_t bytes)
{
    ZSTD_DCtx *z = ZSTD_createDCtx();
    ZSTD_inBuffer in = {data, bytes, 0};
    enum decoding result = DECODING_OK;
    if (z == NULL)
        return DECODING_NO_MEMORY;
    ZSTD_DCtx_setParameter(z, ZSTD_d_windowLogMax, ZSTD_WINDOW);
    for (size_t more = 1; result == DECODING_OK && (in.pos < in.size || more != 0);) {
        ZSTD_outBuffer out = {d->piece, PIECE, 0};
        size_t before = in.pos;
        more = ZSTD_decompressStream(z, &out, &in);
        if (ZSTD_isError(more)) {
            /* Its words name the cause: an unknown prefix, a wrong checksum, too wide a window. */
            result = ZSTD_getErrorCode(more) == ZSTD_error_memory_allocation
                         ? DECODING_NO_MEMORY
                         : corrupt(d, ZSTD_getErrorName(more));
            break;
        }
        result = pass(d, out.pos);
        if (result == DECODING_OK && more != 0 && in.pos == in.size && in.pos == before && out.pos == 0)
            result = corrupt(d, "it ends early");
    }
    ZSTD_freeDCtx(z);
    return result;
}

enum decoding encoding_decode(enum coding coding, const void *data, size_t bytes, size_t cap,
                              encoding_sink_fn *sink, void *sink_data, const char **ret_why)
{
    struct decoder *d = malloc(sizeof *d);
    enum decoding result;
    if (d == NULL)
        return DECODING_NO_MEMORY;
    d->sink = sink;
    d->sink_data = sink_data;
    d->left = cap;
    d->why = "";
    if (coding == CODING_GZIP)
        result = decode_gzip(d, data, bytes);
    else if (coding == CODING_ZSTD)
        result = decode_zstd(d, data, bytes);
    else
        result = bytes > cap                         ? DECODING_TOO_LARGE
                 : sink(data, bytes, sink_data) != 0 ? DECODING_STOPPED
                                                     : DECODING_OK;
    *ret_why = d->why;
    free(d);
    return result;
}

/* ---- encoding ----------------------------------------------------------------------------------------- */

static int encode_gzip(const void *data, size_t bytes, encoding_sink_fn *sink, void *sink_data,
                       unsigned char *piece)
{
    z_stream z = {.next_in = data};
    const unsigned char *end = z.next_in + bytes;
    int code = Z_OK, failed = 0;
    if (deflateInit2(&z, GZIP_LEVEL, Z_DEFLATED, GZIP_WBITS, 8, Z_DEFAULT_STRATEGY) != Z_OK)
        return -1;
    while (!failed && code != Z_STREAM_END) {
        size_t left = (size_t)(end - z.next_in);
        z.avail_in = left > PIECE ? PIECE : (uInt)left;
        z.next_out = piece;
        z.avail_out = PIECE;
        code = deflate(&z, left > PIECE ? Z_NO_FLUSH : Z_FINISH);
        failed = code == Z_STREAM_ERROR || sink(piece, PIECE - z.avail_out, sink_data) != 0;
    }
    deflateEnd(&z);
    return failed ? -1 : 0;
}

static int encode_zstd(const void *data, size_t bytes, encoding_sink_fn *sink, void *sink_data,
                       unsigned char *piece)
{
    ZSTD_CCtx *z = ZSTD_createCCtx();
    ZSTD_inBuffer in = {data, bytes, 0};
    size_t more = 1;
    if (z == NULL)
        return -1;
    ZSTD_CCtx_setParameter(z, ZSTD_c_compressionLevel, ZSTD_LEVEL);
    ZSTD_CCtx_setParameter(z, ZSTD_c_checksumFlag, 1);
    ZSTD_CCtx_setPledgedSrcSize(z, bytes); /* small things then get a small window */
    bool failed = false;
    while (!failed && more != 0) {
        ZSTD_outBuffer out = {piece, PIECE, 0};
        more = ZSTD_compressStream2(z, &out, &in, ZSTD_e_end);
        failed = ZSTD_isError(more) || sink(piece, out.pos, sink_data) != 0;
    }
    ZSTD_freeCCtx(z);
    return failed ? -1 : 0;
}

int encoding_encode(enum coding coding, const void *data, size_t bytes, encoding_sink_fn *sink,
                    void *sink_data)
{
    unsigned char *piece = malloc(PIECE);
    int failed = piece == NULL;
    if (!failed && coding == CODING_GZIP)
        failed = encode_gzip(data, bytes, sink, sink_data, piece);
    else if (!failed && coding == CODING_ZSTD)
        failed = encode_zstd(data, bytes, sink, sink_data, piece);
    else if (!failed)
        failed = sink(data, bytes, sink_data);
    free(piece);
    return failed ? -1 : 0;
}

static int write_to(const void *data, size_t bytes, void *sink_data)
{
    return fwrite(data, 1, bytes, sink_data) == bytes ? 0 : -1;
}

int encoding_encode_whole(enum coding coding, const void *data, size_t bytes, char **ret, size_t *ret_bytes)
{
    struct memout memout;
    size_t coded_bytes;
    FILE *out = memout_open(&memout);
    if (out == NULL)
        return -1;
    int failed = encoding_encode(coding, data, bytes, write_to, out);
    fclose(out);
    char *coded = memout_take(&memout, &coded_bytes);
    if (failed || coded == NULL) {
        free(coded);
        return -1;
    }
    *ret = coded;
    *ret_bytes = coded_is_worth(bytes, coded_bytes) ? coded_bytes : 0;
    return 0;
}
