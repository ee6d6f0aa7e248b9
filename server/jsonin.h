/* jsonin.h - JSON text into a jansson tree: whole, or not at all.
 *
 * jansson 2.14's json_loadb is not used alone: its lexer leaves out a byte for which its buffer finds no room
 * and goes on (load.c, lex_save). Short of memory it reads another text or number, fails an assertion, or
 * looks for the lost quote at the end of a text in whatever lies behind the buffer, which ends the process.
 */
#ifndef DRAPED_JSONIN_H
#define DRAPED_JSONIN_H

#include <jansson.h>

#define JSONIN_BAD 1

/* 0 with *ret, JSONIN_BAD with *reterr where it is no JSON or has duplicate members, -1 when out of memory.
 * Any thread. */
int jsonin_load(const char *text, size_t bytes, json_t **ret, json_error_t *reterr);

#endif
