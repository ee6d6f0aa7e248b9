/* negotiate.c - see negotiate.h. */
#include "negotiate.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

static const char *skip_blanks(const char *p)
{
    return p + strspn(p, " \t");
}

/* The next element of a comma-separated list: its start, *ret_bytes without blanks at its end, and *list
 * moved behind it; NULL at the end. Elements may hold quoted strings. */
static const char *next_element(const char **list, size_t *ret_bytes)
{
    const char *p = *list;
    while (*p == ',' || *p == ' ' || *p == '\t')
        p++;
    if (*p == '\0')
        return NULL;
    const char *start = p;
    for (bool quoted = false; *p != '\0' && (quoted || *p != ','); p++)
        if (*p == '"')
            quoted = !quoted;
    *list = p;
    while (p > start && (p[-1] == ' ' || p[-1] == '\t'))
        p--;
    *ret_bytes = (size_t)(p - start);
    return start;
}

/* In thousandths (RFC 9110 section 12.4.2); 0 for what is no weight. */
static int weight_of(const char *text, const char *end)
{
    int value = *text == '1' ? 1000 : 0;
    if (text == end || (*text != '0' && *text != '1'))
        return 0;
    if (++text < end && *text == '.')
        for (int unit = 100; ++text < end && unit > 0 && *text >= '0' && *text <= '9'; unit /= 10)
            value += unit * (*text - '0');
    return value > 1000 || (text < end && strchr("; \t", *text) == NULL) ? 0 : value;
}

/* The weight of one element of a list in thousandths; 1000 without a q parameter. */
static int quality(const char *element, size_t bytes)
{
    for (size_t i = 0; i + 2 < bytes; i++) {
        if (element[i] != ';')
            continue;
        const char *p = skip_blanks(element + i + 1);
        if (p + 1 < element + bytes && (*p == 'q' || *p == 'Q') && p[1] == '=')
            return weight_of(p + 2, element + bytes);
    }
    return 1000;
}

/* How closely a range of `bytes` fits a type: 3 exact, 2 of its kind, 1 anything, 0 not at all. */
static int fit(const char *range, size_t bytes, const char *type)
{
    const char *slash = strchr(type, '/');
    size_t kind = slash == NULL ? 0 : (size_t)(slash - type) + 1;
    if (bytes == strlen(type) && strncasecmp(range, type, bytes) == 0)
        return 3;
    if (bytes == kind + 1 && range[kind] == '*' && strncasecmp(range, type, kind) == 0)
        return 2;
    return bytes == 3 && strncmp(range, "*/*", 3) == 0;
}

/* The weight that the closest range gives a type; 0: not acceptable. */
static int weight(const char *accept, const char *type)
{
    int best_fit = 0, best = 0;
    size_t bytes;
    const char *element;
    while ((element = next_element(&accept, &bytes)) != NULL) {
        size_t range = 0;
        while (range < bytes && strchr("; \t", element[range]) == NULL)
            range++;
        int f = fit(element, range, type);
        if (f > best_fit) {
            best_fit = f;
            best = quality(element, bytes);
        }
    }
    return best;
}

int negotiate_accept(const char *accept, const char *const *offer, size_t offers)
{
    int best = -1, best_weight = 0;
    if (accept == NULL)
        return 0;
    for (size_t i = 0; i < offers; i++) {
        int w = weight(accept, offer[i]);
        if (w > best_weight) {
            best_weight = w;
            best = (int)i;
        }
    }
    return best;
}

/* The weight that Accept-Encoding gives a coding, -1: it does not say. */
static int coding_weight(const char *accept_encoding, enum coding coding)
{
    int any = -1, named = -1;
    size_t bytes;
    const char *element;
    while ((element = next_element(&accept_encoding, &bytes)) != NULL) {
        size_t name = 0;
        while (name < bytes && strchr("; \t", element[name]) == NULL)
            name++;
        if (name == 1 && *element == '*')
            any = quality(element, bytes);
        else if (coding_from_name(element, name) == (int)coding)
            named = quality(element, bytes);
    }
    return named >= 0 ? named : any;
}

int negotiate_coding(const char *accept_encoding, unsigned offered)
{
    static const enum coding order[CODINGS] = {CODING_ZSTD, CODING_GZIP, CODING_IDENTITY};
    int best = -1, best_weight = 0;
    for (size_t i = 0; accept_encoding != NULL && i < CODINGS; i++) {
        int w = coding_weight(accept_encoding, order[i]);
        if (order[i] == CODING_IDENTITY && w < 0 && best < 0)
            w = 1; /* acceptable unless it is excluded, if nothing better is */
        if ((offered & 1u << order[i]) && w > best_weight) {
            best_weight = w;
            best = (int)order[i];
        }
    }
    return accept_encoding == NULL ? CODING_IDENTITY : best;
}

/* Whether a list of tags has this one or is "*". `weakly`: W/ before one of the list does not count. */
static bool has_tag(const char *list, const char *etag, bool weakly)
{
    size_t bytes, wanted = strlen(etag);
    const char *element;
    while ((element = next_element(&list, &bytes)) != NULL) {
        if (bytes == 1 && *element == '*')
            return true;
        if (weakly && bytes > 2 && strncmp(element, "W/", 2) == 0) {
            element += 2;
            bytes -= 2;
        }
        if (bytes == wanted && memcmp(element, etag, bytes) == 0)
            return true;
    }
    return false;
}

bool negotiate_unchanged(const char *if_none_match, const char *etag)
{
    return if_none_match != NULL && has_tag(if_none_match, etag, true);
}

bool negotiate_matches(const char *if_match, const char *etag)
{
    return if_match == NULL || has_tag(if_match, etag, false);
}

int negotiate_wait(const char *prefer, int max)
{
    size_t bytes;
    const char *element;
    while (prefer != NULL && (element = next_element(&prefer, &bytes)) != NULL) {
        if (bytes < 6 || strncasecmp(element, "wait", 4) != 0)
            continue;
        const char *p = skip_blanks(element + 4);
        if (*p != '=')
            continue;
        p = skip_blanks(p + 1);
        size_t digits = strspn(p, "0123456789");
        if (digits == 0 || p + digits > element + bytes || strchr("; \t,", p[digits]) == NULL)
            continue;
        return digits > 6 || atoi(p) > max ? max : atoi(p);
    }
    return 0;
}

bool negotiate_is_type(const char *content_type, const char *media_type)
{
    if (content_type == NULL)
        return false;
    size_t bytes = strcspn(content_type, "; \t");
    return bytes == strlen(media_type) && strncasecmp(content_type, media_type, bytes) == 0;
}
