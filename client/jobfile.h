/* jobfile.h - what a picture needs from a job document and from its result. */
#ifndef DRAPE_CLIENT_JOBFILE_H
#define DRAPE_CLIENT_JOBFILE_H

#include "failure.h"
#include "picture.h"

/* The bodies of a job document, and its cloth as it starts. Bodies given by reference are left out;
 * *ret_skipped counts them. `path` is for messages. 0 and *ret to be emptied, or -1 with *failure. */
int jobfile_parse(const char *path, const char *text, size_t bytes, struct picture *ret, size_t *ret_skipped,
                  struct failure *failure);

/* Replaces the cloth by a result: GLB, or the contract's JSON. `map` names what its colours are to show, one
 * of picture_maps, which a GLB of a job with `fit` has; NULL: the first where it is there. */
int jobfile_set_result(const char *path, const char *data, size_t bytes, const char *map,
                       struct picture *picture, struct failure *failure);

#endif
