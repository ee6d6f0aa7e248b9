/* fields.h - distance fields of body meshes, kept for the next job and shared by those that run.
 *
 * A field is found by the SHA-256 of its mesh's numbers, so that a body is built once, whether it is uploaded
 * or sent along with each job. Of two jobs that ask for the same new body at once, one builds and the other
 * waits. Past the limit of bytes the fields that were used longest ago are let go; those in use live on until
 * their jobs end. Any thread may call anything but new and free. One lock inside, under it only that of the
 * metrics; building runs outside of it. */
#ifndef DRAPED_FIELDS_H
#define DRAPED_FIELDS_H

#include <stddef.h>

#include "drape.h"

struct fields;
struct metrics;

struct fields *fields_new(size_t max_bytes, struct metrics *metrics); /* NULL when out of memory */

/* The field of a body that is a mesh, number `number` of its scene: a reference that the caller gives back.
 * Refuses what drape_field_new refuses. `processors`: see there. */
drape_status fields_get(struct fields *fields, const drape_body *body, size_t number,
                        drape_processors *processors, drape_field **ret, drape_error *reterr);

struct fields *fields_free(struct fields *fields); /* nobody waits any more; NULL is fine; returns NULL */

#endif
