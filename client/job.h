/* job.h - the job routes of the v1 contract, one function each. */
#ifndef DRAPE_CLIENT_JOB_H
#define DRAPE_CLIENT_JOB_H

#include <jansson.h>

#include "http.h"

#define JOB_ID_SIZE   128
#define JOB_PATH_SIZE 512

/* Fills "/v1/jobs/ID" plus `tail` ("/events", or ""); -1 with *failure when the id is not one that a
 * path can hold (letters, digits, '-', '_'). */
int job_path(const char *id, const char *tail, char path[JOB_PATH_SIZE], struct failure *failure);

/* POST /v1/jobs. *ret: the job body, a new reference. */
int job_submit(struct http *http, const char *text, size_t bytes, json_t **ret, struct failure *failure);

/* GET /v1/jobs/{id}; waits up to wait_s (0: not at all) for it to end. *ret: a new reference. */
int job_get(struct http *http, const char *id, int wait_s, json_t **ret, struct failure *failure);

/* DELETE /v1/jobs/{id}; *ret_removed tells "removed" (204) from "being cancelled" (202). */
int job_cancel(struct http *http, const char *id, bool *ret_removed, struct failure *failure);

/* GET /v1/jobs/{id}/`kind`?format=`format`: kind "result" or "trace". *reply: to be emptied. */
int job_fetch(struct http *http, const char *id, const char *kind, const char *format,
              struct http_reply *reply, struct failure *failure);

/* Says on `file` what the server warns of, a line each. */
void job_print_warnings(FILE *file, const json_t *job);

const char *job_id(const json_t *job); /* "" when it has none; lives as long as the job */
const char *job_status(const json_t *job);
bool job_ended(const json_t *job);

/* How a script should see the end of this job: at rest, not at rest, or failed. */
enum exit_code job_exit_code(const json_t *job);

#endif
