/* textfile.c - see textfile.h. */
#include "textfile.h"

#include <ctype.h>
#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int read_all(FILE *file, const char *path, char **ret, size_t *ret_bytes, struct failure *failure)
{
    size_t bytes = 0, capacity = 65536;
    char *text = malloc(capacity);
    while (text) {
        bytes += fread(text + bytes, 1, capacity - bytes - 1, file);
        if (bytes + 1 < capacity) {
            break;
        }
        if (capacity > TEXTFILE_MAX_BYTES) {
            free(text);
            return failure_set(failure, EXIT_USAGE, "%s is longer than %zu MiB", path,
                               TEXTFILE_MAX_BYTES >> 20);
        }
        char *longer = realloc(text, 2 * capacity);
        if (!longer) {
            free(text);
        }
        text = longer;
        capacity *= 2;
    }
    if (!text) {
        return failure_no_memory(failure);
    }
    if (ferror(file)) {
        free(text);
        return failure_set(failure, EXIT_USAGE, "cannot read %s: %s", path, strerror(errno));
    }
    text[bytes] = '\0';
    *ret = text;
    *ret_bytes = bytes;
    return 0;
}

int textfile_read(const char *path, char **ret, size_t *ret_bytes, struct failure *failure)
{
    if (strcmp(path, "-") == 0) {
        return read_all(stdin, "standard input", ret, ret_bytes, failure);
    }
    FILE *file = fopen(path, "rbe");
    if (!file) {
        return failure_set(failure, EXIT_USAGE, "cannot open %s: %s", path, strerror(errno));
    }
    int status = read_all(file, path, ret, ret_bytes, failure);
    fclose(file);
    return status;
}

int textfile_write(const char *path, const char *data, size_t bytes, struct failure *failure)
{
    bool standard = strcmp(path, "-") == 0;
    FILE *file = standard ? stdout : fopen(path, "wbe");
    if (!file) {
        return failure_set(failure, EXIT_LOCAL, "cannot write %s: %s", path, strerror(errno));
    }
    bool written = fwrite(data, 1, bytes, file) == bytes && fflush(file) == 0;
    int error = errno;
    if (!standard && fclose(file) != 0 && written) {
        written = false;
        error = errno;
    }
    if (!written) {
        return failure_set(failure, EXIT_LOCAL, "cannot write %s: %s", path, strerror(error));
    }
    return 0;
}

void textfile_extension(const char *path, char ret[16])
{
    const char *dot = strrchr(path, '.');
    ret[0] = '\0';
    if (!dot || strchr(dot, '/') || strlen(dot + 1) >= 16) {
        return;
    }
    size_t n = 0;
    for (const char *c = dot + 1; *c; c++) {
        ret[n++] = (char)tolower((unsigned char)*c);
    }
    ret[n] = '\0';
}
