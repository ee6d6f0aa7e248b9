/* problem.h - turns the server's refusals (RFC 9457 problem+json) into words for a person. */
#ifndef DRAPE_CLIENT_PROBLEM_H
#define DRAPE_CLIENT_PROBLEM_H

#include "http.h"

/* Fills *failure (EXIT_REFUSED) from an answer of status 400 or more: what was refused, the server's
 * detail, each errors[] entry, the request id, and what to try next. Returns -1. `what` is a short
 * phrase such as "the job". */
int problem_explain(const struct http_reply *reply, const char *what, struct failure *failure);

/* http_send, then problem_explain for statuses of 400 and more. */
int problem_send(struct http *http, const struct http_request *request, const char *what,
                 struct http_reply *reply, struct failure *failure);

#endif
