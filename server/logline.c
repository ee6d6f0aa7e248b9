/* logline.c - see logline.h. */
#include "logline.h"

#include <ctype.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

/* ---- from a format to fields -------------------------------------------------------------------------- */

struct spec { /* one conversion */
    char text[16];
    char length; /* 'h', 'l', 'L' for ll, 'z', or 0 */
    char kind;
};

/* Reads "%...": the bytes read, 0 when it is none that is understood. */
static size_t read_spec(const char *at, struct spec *ret)
{
    size_t n = 1 + strspn(at + 1, ".0123456789");
    ret->length = 0;
    for (; at[n] != '\0' && strchr("hlz", at[n]) != NULL; n++)
        ret->length = ret->length == 'l' ? 'L' : at[n];
    ret->kind = at[n++];
    if (ret->kind == '\0' || strchr("diuxsgf", ret->kind) == NULL || n >= sizeof ret->text)
        return 0;
    memcpy(ret->text, at, n);
    ret->text[n] = '\0';
    return n;
}

/* The formats were checked by the compiler where log_event was called. */
#pragma GCC diagnostic ignored "-Wformat-nonliteral"

static void print_spec(const struct spec *spec, char *ret, size_t size, va_list *args)
{
    if (spec->kind == 's') {
        const char *text = va_arg(*args, const char *);
        snprintf(ret, size, spec->text, text != NULL ? text : "");
    } else if (spec->kind == 'g' || spec->kind == 'f') {
        snprintf(ret, size, spec->text, va_arg(*args, double));
    } else if (spec->length == 'L') {
        snprintf(ret, size, spec->text, va_arg(*args, long long));
    } else if (spec->length == 'l') {
        snprintf(ret, size, spec->text, va_arg(*args, long));
    } else if (spec->length == 'z') {
        snprintf(ret, size, spec->text, va_arg(*args, size_t));
    } else {
        snprintf(ret, size, spec->text, va_arg(*args, int));
    }
}

/* One value, up to the blank or the end of the format; where it ends, NULL when it cannot be understood. */
static const char *take_value(const char *at, struct log_field *field, va_list *args)
{
    size_t n = 0, pieces = 0;
    for (; *at != ' ' && *at != '\0'; pieces++) {
        struct spec spec;
        if (*at == '%') {
            size_t read = read_spec(at, &spec);
            if (read == 0)
                return NULL;
            print_spec(&spec, field->value + n, sizeof field->value - n, args);
            n += strlen(field->value + n);
            field->number = pieces == 0 && strchr("diu", spec.kind) != NULL;
            at += read;
        } else {
            field->number = false;
            if (*at != '"' && n + 1 < sizeof field->value)
                field->value[n++] = *at;
            at++;
        }
        field->value[n] = '\0';
    }
    field->number &= pieces == 1;
    return at;
}

static void set_name(struct log_field *field, const char *name, size_t bytes)
{
    memset(field, 0, sizeof *field);
    memcpy(field->name, name, bytes < sizeof field->name ? bytes : sizeof field->name - 1);
}

void logline_take(struct log_record *ret, const char *format, va_list args)
{
    va_list rest;
    va_copy(rest, args);
    while (format != NULL && *format != '\0' && ret->fields < LOGLINE_FIELDS) {
        struct log_field *field = &ret->field[ret->fields];
        size_t n = strcspn(format, "= ");
        set_name(field, format, n);
        if (format[n] != '=')
            break;
        format = take_value(format + n + 1, field, &rest);
        ret->fields += format != NULL && field->value[0] != '\0';
        if (format != NULL && *format == ' ')
            format++;
    }
    va_end(rest);
}

void logline_add(struct log_record *record, const char *name, const char *value)
{
    if (record->fields == LOGLINE_FIELDS || value[0] == '\0')
        return;
    struct log_field *field = &record->field[record->fields++];
    set_name(field, name, strlen(name));
    snprintf(field->value, sizeof field->value, "%s", value);
}

/* ---- lines --------------------------------------------------------------------------------------------- */

struct line {
    char *text;
    size_t bytes;
    bool full;
};

static void put(struct line *line, const char *text, size_t bytes)
{
    if (line->bytes + bytes > LOGLINE_SIZE - 2) /* one for the brace, one for the line's end */
        line->full = true;
    if (line->full)
        return;
    memcpy(line->text + line->bytes, text, bytes);
    line->bytes += bytes;
}

/* The bytes of the UTF-8 character at `at`, 0 when it is none (RFC 3629: no overlong forms, no surrogates).
 */
static size_t character(const unsigned char *at)
{
    size_t n = at[0] < 0x80 ? 1 : at[0] >= 0xc2 && at[0] < 0xe0 ? 2 : at[0] >= 0xe0 && at[0] < 0xf0 ? 3 : 4;
    if (at[0] >= 0x80 && (at[0] < 0xc2 || at[0] > 0xf4))
        return 0;
    for (size_t i = 1; i < n; i++)
        if ((at[i] & 0xc0) != 0x80)
            return 0;
    if ((at[0] == 0xe0 && at[1] < 0xa0) || (at[0] == 0xed && at[1] > 0x9f) ||
        (at[0] == 0xf0 && at[1] < 0x90) || (at[0] == 0xf4 && at[1] > 0x8f))
        return 0;
    return n;
}

static void put_escape(struct line *line, unsigned code)
{
    char text[8];
    int n = code == '"' || code == '\\' ? snprintf(text, sizeof text, "\\%c", code)
                                        : snprintf(text, sizeof text, "\\u%04x", code);
    put(line, text, (size_t)n);
}

/* As a JSON string; so nothing in it ends a line, or moves the cursor of a terminal. */
static void put_quoted(struct line *line, const char *text)
{
    const unsigned char *at = (const unsigned char *)text;
    put(line, "\"", 1);
    while (*at != '\0') {
        size_t n = character(at);
        if (n == 0)
            put_escape(line, 0xfffd);
        else if (*at < 0x20 || *at == 0x7f || *at == '"' || *at == '\\')
            put_escape(line, *at);
        else if (at[0] == 0xc2 && at[1] < 0xa0) /* U+0080 to U+009F */
            put_escape(line, at[1]);
        else
            put(line, (const char *)at, n);
        at += n > 0 ? n : 1;
    }
    put(line, "\"", 1);
}

static bool is_plain(const char *text)
{
    for (; *text != '\0'; text++)
        if (*text <= ' ' || *text > '~' || strchr("\"\\=", *text) != NULL)
            return false;
    return true;
}

static void put_pair(struct line *line, const struct log_field *field)
{
    put(line, field->name, strlen(field->name));
    put(line, "=", 1);
    if (is_plain(field->value))
        put(line, field->value, strlen(field->value));
    else
        put_quoted(line, field->value);
}

static void put_member(struct line *line, const struct log_field *field)
{
    put_quoted(line, field->name);
    put(line, ":", 1);
    if (field->number)
        put(line, field->value, strlen(field->value));
    else
        put_quoted(line, field->value);
}

/* All fields from `first` on, with `between` them; one that does not fit, and all after it, not at all. */
static void put_fields(struct line *line, const struct log_record *record, size_t first,
                       void (*put_field)(struct line *line, const struct log_field *field),
                       const char *between)
{
    for (size_t i = first; i < record->fields && !line->full; i++) {
        size_t before = line->bytes;
        if (i > first)
            put(line, between, 1);
        put_field(line, &record->field[i]);
        if (line->full)
            line->bytes = before;
    }
}

size_t logline_text(const struct log_record *record, char ret[LOGLINE_SIZE])
{
    struct line line = {.text = ret};
    if (record->fields > 0) /* the time, without its name */
        put(&line, record->field[0].value, strlen(record->field[0].value));
    put(&line, " ", 1);
    put_fields(&line, record, 1, put_pair, " ");
    return line.bytes;
}

size_t logline_json(const struct log_record *record, char ret[LOGLINE_SIZE])
{
    struct line line = {.text = ret};
    put(&line, "{", 1);
    put_fields(&line, record, 0, put_member, ",");
    ret[line.bytes++] = '}'; /* put leaves room for it */
    return line.bytes;
}

/* ---- entries of the journal ------------------------------------------------------------------------------
 */

/* Those that have another name there; see systemd.journal-fields(7). */
static const struct {
    const char *name, *journal;
} renamed[] = {{"job", "JOB_ID"}, {"request", "REQUEST_ID"}, {"trace", "TRACE_ID"}, {"ms", "DURATION_MS"}};

static const char *journal_name(const char *name, char ret[LOGLINE_NAME])
{
    for (size_t i = 0; i < sizeof renamed / sizeof *renamed; i++)
        if (strcmp(renamed[i].name, name) == 0)
            return renamed[i].journal;
    for (size_t i = 0; i < LOGLINE_NAME; i++)
        ret[i] = name[i] == '-' ? '_' : (char)toupper((unsigned char)name[i]);
    return ret;
}

static void add_part(struct log_entry *entry, char *text, size_t bytes)
{
    entry->part[entry->parts++] = (struct iovec){text, bytes};
}

void logline_entry(const struct log_record *record, size_t head, int priority, struct log_entry *ret)
{
    struct line line = {.text = ret->message};
    ret->parts = 0;
    put(&line, "MESSAGE=", 8);
    if (record->fields > head) /* the event, without its name */
        put(&line, record->field[head].value, strlen(record->field[head].value));
    put(&line, " ", 1);
    put_fields(&line, record, head + 1, put_pair, " ");
    add_part(ret, ret->message, line.bytes);
    add_part(ret, ret->priority,
             (size_t)snprintf(ret->priority, sizeof ret->priority, "PRIORITY=%d", priority));
    for (size_t i = head; i < record->fields; i++) {
        char name[LOGLINE_NAME];
        int n = snprintf(ret->text[i], sizeof ret->text[i], "%s=%s",
                         journal_name(record->field[i].name, name), record->field[i].value);
        add_part(ret, ret->text[i], (size_t)n);
    }
}
