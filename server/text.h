/* text.h - lines, words and numbers out of text files, the same in every locale. */
#ifndef DRAPED_TEXT_H
#define DRAPED_TEXT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* A piece of text not yet read; it borrows the file's bytes, which need no terminator. */
struct text {
    const char *at, *end;
    size_t line; /* number of the line last taken, from 1 */
};

struct word { /* borrowed likewise; bytes 0: there was none */
    const char *at;
    size_t bytes;
};

/* The next line without its end (LF or CRLF), as a text of its own; false at the end. */
bool text_line(struct text *text, struct text *ret_line);

/* The next word of a line, blanks skipped. */
struct word text_word(struct text *line);

bool word_is(struct word word, const char *name);

/* A finite decimal number, all of the word; false otherwise ("nan", "inf" and hexadecimal are no
 * numbers here). */
bool word_double(struct word word, double *ret);

/* A decimal integer, all of the word, at most 18 digits. */
bool word_integer(struct word word, int64_t *ret);

/* The word as a short string for an error message: printable ASCII, others as '?'. Returns `ret`. */
const char *word_quote(struct word word, char ret[32]);

#endif
