/* text.c - lines, words and numbers out of text files, the same in every locale. */
#include "text.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Longer numbers are refused; 17 significant digits, a sign, a point and an exponent need 24, and the
 * smallest double written out in full about 1080. */
#define NUMBER_BYTES 1100

bool text_line(struct text *text, struct text *ret_line)
{
    if (text->at == text->end)
        return false;
    const char *feed = memchr(text->at, '\n', (size_t)(text->end - text->at));
    const char *end = feed ? feed : text->end;
    text->line++;
    *ret_line = (struct text){text->at, end, text->line};
    if (ret_line->end > ret_line->at && ret_line->end[-1] == '\r')
        ret_line->end--;
    text->at = feed ? feed + 1 : end;
    return true;
}

static bool is_blank(char c)
{
    return c == ' ' || c == '\t' || c == '\v' || c == '\f' || c == '\r';
}

struct word text_word(struct text *line)
{
    while (line->at < line->end && is_blank(*line->at))
        line->at++;
    struct word word = {line->at, 0};
    while (line->at < line->end && !is_blank(*line->at))
        line->at++;
    word.bytes = (size_t)(line->at - word.at);
    return word;
}

bool word_is(struct word word, const char *name)
{
    return word.bytes == strlen(name) && memcmp(word.at, name, word.bytes) == 0;
}

/* Powers of ten that a double holds exactly. */
static const double POWER[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                               1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/* A plain decimal of up to 15 digits is a quotient of two exact doubles, so one division rounds it
 * correctly (Clinger 1990); false: too long or too odd for that. Covers nearly every mesh file and is
 * several times faster than strtod. */
static bool plain_decimal(struct word word, double *ret)
{
    size_t i = word.bytes > 0 && (word.at[0] == '-' || word.at[0] == '+');
    int64_t mantissa = 0;
    size_t digits = 0, decimals = 0;
    bool point = false;
    for (; i < word.bytes; i++) {
        char c = word.at[i];
        if (c == '.' && !point) {
            point = true;
        } else if (c >= '0' && c <= '9') {
            mantissa = mantissa * 10 + (c - '0');
            decimals += point;
            if (++digits > 15)
                return false;
        } else {
            return false;
        }
    }
    if (digits == 0)
        return false;
    double value = (double)mantissa / POWER[decimals];
    *ret = word.at[0] == '-' ? -value : value;
    return true;
}

bool word_double(struct word word, double *ret)
{
    char copy[NUMBER_BYTES];
    if (plain_decimal(word, ret))
        return true;
    if (word.bytes == 0 || word.bytes >= sizeof copy)
        return false;
    memcpy(copy, word.at, word.bytes);
    copy[word.bytes] = '\0';
    if (strspn(copy, "0123456789+-.eE") != word.bytes)
        return false;

    /* glibc's "C" locale is a static object: this neither allocates nor can fail */
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!c_locale)
        return false;
    char *end;
    double value = strtod_l(copy, &end, c_locale);
    freelocale(c_locale);
    if (*end != '\0' || !isfinite(value))
        return false;
    *ret = value;
    return true;
}

bool word_integer(struct word word, int64_t *ret)
{
    size_t start = word.bytes > 0 && (word.at[0] == '-' || word.at[0] == '+');
    if (word.bytes == start || word.bytes - start > 18)
        return false;
    int64_t value = 0;
    for (size_t i = start; i < word.bytes; i++) {
        if (word.at[i] < '0' || word.at[i] > '9')
            return false;
        value = value * 10 + (word.at[i] - '0');
    }
    *ret = word.at[0] == '-' ? -value : value;
    return true;
}

const char *word_quote(struct word word, char ret[32])
{
    size_t n = word.bytes < 31 ? word.bytes : 31;
    for (size_t i = 0; i < n; i++)
        ret[i] = word.at[i] >= ' ' && word.at[i] <= '~' ? word.at[i] : '?';
    ret[n] = '\0';
    return ret;
}
