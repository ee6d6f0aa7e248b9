/* id.h - names that cannot be guessed (128 random bits) and names that follow from content (SHA-256). */
#ifndef DRAPED_ID_H
#define DRAPED_ID_H

#include <stdbool.h>
#include <stddef.h>

#define ID_SIZE     33 /* 32 lower-case hex digits and a NUL */
#define SHA256_SIZE 65 /* 64 lower-case hex digits and a NUL */
#define STAMP_SIZE  17 /* 16 lower-case hex digits and a NUL */

int id_init(void); /* once, before any other; 0, or -1 when the system has no randomness */
void id_new(char ret[ID_SIZE]);
bool id_valid(const char *text);

void sha256_hex(const void *data, size_t bytes, char ret[SHA256_SIZE]);
bool sha256_valid(const char *text);

/* A hash (SipHash-2-4) that tells one version of a thing from the next, not from what somebody made up. */
void id_stamp(const void *data, size_t bytes, char ret[STAMP_SIZE]);

#endif
