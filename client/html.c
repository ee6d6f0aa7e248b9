/* html.c - see html.h. */
#include "html.h"

void html_text(FILE *file, const char *text)
{
    for (; *text; text++) {
        switch (*text) {
        case '&':
            fputs("&amp;", file);
            break;
        case '<':
            fputs("&lt;", file);
            break;
        case '>':
            fputs("&gt;", file);
            break;
        case '"':
            fputs("&quot;", file);
            break;
        case '\'':
            fputs("&#39;", file);
            break;
        case '\t':
        case '\n':
            fputc(*text, file);
            break;
        default:
            if ((unsigned char)*text < ' ' || *text == 0x7F) {
                fputs("\xEF\xBF\xBD", file);
            } else {
                fputc(*text, file);
            }
        }
    }
}
