/* routes.h - one table: method, path, where it runs, body cap, handler. */
#ifndef DRAPED_ROUTES_H
#define DRAPED_ROUTES_H

#include "http.h"

/* The callbacks of an http_setup; `data` is a struct routes. */
enum routes_side { ROUTES_API, ROUTES_ADMIN };

struct routes {
    struct api *api;
    enum routes_side side;
};

void routes_begin(struct http_request *request, void *data);
void routes_leaving(struct http_request *request, struct http_answer *answer, void *data);
void routes_handle(struct http_request *request, void *data);
void routes_finished(struct http_request *request, int status, int64_t milliseconds, void *data);

#endif
