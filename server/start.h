/* start.h - where a re-drape begins: the result of the job that `start_from` names.
 *
 * It is settled when the job is posted: the new job keeps its own names for the other's document and drape
 * (store_start_keep), so that the other may be removed at any time and a restart changes nothing.
 *
 * The cloth begins where the other job's drape lies, with two exceptions:
 *   - a pinned vertex whose place in `cloth.mesh.positions` is not the other document's goes to that place;
 *   - where a body is a mesh of the same triangles in both jobs, but of other positions, cloth goes with the
 *     body's surface below it (drape_carry). Pins that do not move stay.
 * The other job's pattern comes along where its triangles are the same, so that a large change of the rest
 * shape is made in steps (see drape_scene_desc.start_pattern). */
#ifndef DRAPED_START_H
#define DRAPED_START_H

#include "meshref.h"
#include "schema.h"

/* For a job that is being posted, not added yet, under `id`: keeps what it starts from, which must be of the
 * same owner (rooms->owner), and checks that it can. 0, or -1 with *reterr and nothing kept; the refusals
 * (404 not-found, 409 not-ready and no-result, 410 gone, 422) point at /start_from. */
int start_keep(const struct meshref *rooms, const char *id, struct job_spec *spec, struct problem *reterr);

/* The same for the worker of job `id`, from what it has kept: fills spec->start and spec->start_pattern. */
int start_load(const struct meshref *rooms, const char *id, struct job_spec *spec, struct problem *reterr);

#endif
