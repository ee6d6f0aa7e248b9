/* html.h - text that is safe inside an HTML element or a quoted attribute. */
#ifndef DRAPE_CLIENT_HTML_H
#define DRAPE_CLIENT_HTML_H

#include <stdio.h>

/* Writes `text` (UTF-8) with & < > " ' as references and control characters, which HTML does not
 * allow, as U+FFFD; tab and newline stay. */
void html_text(FILE *file, const char *text);

#endif
