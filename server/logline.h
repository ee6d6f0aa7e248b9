/* logline.h - the fields of a log event, and the forms they are written in. Knows no sink. */
#ifndef DRAPED_LOGLINE_H
#define DRAPED_LOGLINE_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <sys/uio.h>

#define LOGLINE_FIELDS 16
#define LOGLINE_NAME   24
#define LOGLINE_VALUE  256  /* bytes, the NUL among them; what is longer is cut */
#define LOGLINE_SIZE   8192 /* of a line; fields that do not fit are left out whole */

struct log_field {
    char name[LOGLINE_NAME];
    char value[LOGLINE_VALUE];
    bool number;
};

struct log_record {
    size_t fields;
    struct log_field field[LOGLINE_FIELDS];
};

/* From "name=%s other=%d": the pairs are those of the format, whatever the arguments hold. It understands
 * d i u x, with h l ll z, g f, and s with .N; what comes after anything else is left out. */
void logline_take(struct log_record *ret, const char *format, va_list args);
void logline_add(struct log_record *record, const char *name, const char *value);

/* Each returns the bytes written to `ret`, without a line's end and without a NUL. */
size_t logline_text(const struct log_record *record, char ret[LOGLINE_SIZE]);
size_t logline_json(const struct log_record *record, char ret[LOGLINE_SIZE]);

struct log_entry { /* of the journal */
    char message[LOGLINE_SIZE + 8], priority[16];
    char text[LOGLINE_FIELDS][LOGLINE_NAME + LOGLINE_VALUE];
    struct iovec part[LOGLINE_FIELDS + 2];
    int parts;
};

/* The parts point into *ret. `head` is how many of the first fields (time, level) the journal knows itself.
 */
void logline_entry(const struct log_record *record, size_t head, int priority, struct log_entry *ret);

#endif
