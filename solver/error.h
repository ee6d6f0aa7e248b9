/* error.h - filling a caller's drape_error in one line. */
#ifndef DR_ERROR_H
#define DR_ERROR_H

#include "drape.h"

/* Writes *reterr (NULL is fine) and returns `status`, so that a function can end with it. */
__attribute__((format(printf, 5, 6)))
drape_status dr_fail(drape_error *reterr, drape_status status, drape_place place, int64_t element,
                     const char *format, ...);

/* The same with a body number or a member's name. */
__attribute__((format(printf, 7, 8)))
drape_status dr_fail_at(drape_error *reterr, drape_status status, drape_place place, int64_t element,
                        int64_t body, const char *member, const char *format, ...);

/* The one message for a failed allocation. */
drape_status dr_out_of_memory(drape_error *reterr);

#endif
