/* error.h - filling a caller's drape_error in one line. */
#ifndef DR_ERROR_H
#define DR_ERROR_H

#include "drape.h"

/* Writes *reterr; NULL is fine. */
__attribute__((format(printf, 7, 8))) void dr_error_set(drape_error *reterr, drape_status status,
                                                        drape_place place, int64_t element, int64_t body,
                                                        const char *member, const char *format, ...);

/* Fill the error and give back `status` (evaluated twice), so that a function can end with them. Macros,
 * so that a reader's tools see which status that is. */
#define dr_fail_at(reterr, status, place, element, body, member, ...)                                        \
    (dr_error_set((reterr), (status), (place), (element), (body), (member), __VA_ARGS__), (status))
#define dr_fail(reterr, status, place, element, ...)                                                         \
    dr_fail_at((reterr), (status), (place), (element), -1, NULL, __VA_ARGS__)
#define dr_out_of_memory(reterr) dr_fail((reterr), DRAPE_ENOMEM, DRAPE_AT_NOWHERE, -1, "out of memory")

#endif
