/* methodspec.h - "NAME:MEMBER=VALUE,...": one way to solve a job, in words on a command line. */
#ifndef DRAPE_CLIENT_METHODSPEC_H
#define DRAPE_CLIENT_METHODSPEC_H

#include <jansson.h>

#include "failure.h"

/* The members that `spec` puts into a job's "solver", "method" among them. A value is a number, true,
 * false or null where it reads as one, else text; "damping.air=0.1" reaches into an object. Which
 * members and values there are is the server's business. *ret: a new reference. 0, or -1 with
 * *failure (EXIT_USAGE). */
int methodspec_parse(const char *spec, json_t **ret, struct failure *failure);

/* `job` with those members of its "solver" replaced, the others kept: a new reference that shares the
 * rest (the meshes) with `job`; NULL when memory ran out. */
json_t *methodspec_apply(json_t *members, json_t *job);

#endif
