/* encoding.h - content codings: gzip (RFC 1952) and zstd (RFC 8878), there and back, from memory to
 * whoever takes the pieces. Knows no HTTP. Works with a few hundred kilobytes, and for decoding zstd with
 * the window that the frame asks for, up to 8 MiB (RFC 9659); never with the size that a body claims. */
#ifndef DRAPED_ENCODING_H
#define DRAPED_ENCODING_H

#include <stdbool.h>
#include <stddef.h>

enum coding { CODING_IDENTITY = 0, CODING_GZIP, CODING_ZSTD, CODINGS };

#define CODING_LIST "gzip, zstd" /* for Accept-Encoding */

const char *coding_name(enum coding coding);          /* "gzip" */
const char *coding_suffix(enum coding coding);        /* "gz"; "" of identity */
int coding_from_name(const char *name, size_t bytes); /* any case; -1: unknown */

/* Smaller things are not worth coding: they fit into one packet as they are. */
#define CODED_LEAST 1400
/* Nor are those that lose less than a tenth. */
static inline bool coded_is_worth(size_t bytes, size_t coded_bytes)
{
    return bytes >= CODED_LEAST && coded_bytes <= bytes / 10 * 9;
}

/* Takes the next piece; nonzero stops the work. */
typedef int encoding_sink_fn(const void *data, size_t bytes, void *sink_data);

enum decoding { DECODING_OK = 0, DECODING_CORRUPT, DECODING_TOO_LARGE, DECODING_STOPPED, DECODING_NO_MEMORY };

/* Decodes all of `data`: one or more members or frames, nothing behind them. The sink never sees more than
 * `cap` bytes. CORRUPT: *ret_why says what is wrong, in a few words. */
enum decoding encoding_decode(enum coding coding, const void *data, size_t bytes, size_t cap,
                              encoding_sink_fn *sink, void *sink_data, const char **ret_why);

/* 0, or -1: the sink stopped it, or out of memory. */
int encoding_encode(enum coding coding, const void *data, size_t bytes, encoding_sink_fn *sink,
                    void *sink_data);

/* All at once, into memory that the caller frees: *ret_bytes, none where it is not worth it. 0, or -1 when
 * out of memory. */
int encoding_encode_whole(enum coding coding, const void *data, size_t bytes, char **ret, size_t *ret_bytes);

#endif
