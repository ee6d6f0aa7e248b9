/* fuzz_multipart.c - libFuzzer entry: a line that is a Content-Type, and then any bytes as its form. */
#include <string.h>

#include "fuzz.h"
#include "multipart.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    char type[256], boundary[MULTIPART_BOUNDARY_SIZE];
    struct multipart_file file;
    struct problem problem = {0};
    const uint8_t *end = memchr(data, '\n', size);
    size_t n = end == NULL ? size : (size_t)(end - data);
    if (n >= sizeof type)
        return 0;
    memcpy(type, data, n);
    type[n] = '\0';
    int form = multipart_boundary(type, boundary, &problem);
    fuzz_require(form != -1 || problem.code == PROBLEM_BAD_REQUEST);
    if (form != 0 || end == NULL)
        return 0;
    fuzz_require(boundary[0] != '\0' && strlen(boundary) < sizeof boundary);
    const char *body = (const char *)end + 1;
    size_t bytes = size - n - 1;
    if (multipart_parse(body, bytes, boundary, &file, &problem) == 0) {
        fuzz_require(file.data >= body && file.bytes <= bytes && file.data + file.bytes <= body + bytes);
        fuzz_require(strlen(file.type) < sizeof file.type && strlen(file.filename) < sizeof file.filename);
    } else {
        fuzz_require(problem.code == PROBLEM_BAD_REQUEST && problem.detail[0] != '\0');
    }
    return 0;
}
