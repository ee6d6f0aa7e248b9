/* api.h - what the handlers behind the routes share: the rooms they may enter, and one call.
 *
 * A handler runs where its route says: on the HTTP thread (must not block), on the clerk's (short work
 * with the store) or on the reader's (parsing whole bodies). It answers once, through http_send or the
 * functions below; from then on the call may be freed at any moment and must not be touched. */
#ifndef DRAPED_API_H
#define DRAPED_API_H

#include <stdbool.h>

#include "config.h"
#include "executor.h"
#include "fields.h"
#include "health.h"
#include "http.h"
#include "id.h"
#include "idempotency.h"
#include "keys.h"
#include "metrics.h"
#include "queue.h"
#include "store.h"
#include "stream.h"
#include "waits.h"

/* A document that stays as it is while the daemon runs (represent.h). */
struct page {
    const char *type;
    char tag[SHA256_SIZE];
    char *data[CODINGS]; /* owned; NULL: not in this coding */
    size_t bytes[CODINGS];
};

enum page_name { PAGE_OPENAPI = 0, PAGE_MATERIALS, PAGES };

struct api { /* wired by main; outlives the listeners */
    const struct config *config;
    struct keys *keys; /* NULL: none are needed, everything is the owner's "" */
    struct store *store;
    struct queue *queue;
    struct hub *hub;
    struct metrics *metrics;
    struct fields *fields;
    drape_analyses *analyses;
    drape_processors *processors;
    struct waits *waits;
    struct claims *claims;
    struct executor *clerk, *reader;
    struct page page[PAGES];
    char *interface;  /* of the page at / (page.h); owned */
    const char *blas; /* the BLAS kernel in use */
    struct health health;
};

struct call;
typedef void call_fn(struct call *call);

struct call {
    struct api *api;
    struct http_request *request;
    const struct route *route;
    char owner[KEY_NAME_SIZE];      /* whose jobs and meshes it sees: the name of its key; "" without keys */
    char id[SHA256_SIZE];           /* the {id} or {sha256} of the path; "" for routes without */
    char allow[64];                 /* the methods that the path takes; "": there is no such path */
    enum coding coding;             /* of the body as it was sent */
    char job_id[ID_SIZE];           /* of the job that a waiting POST made */
    call_fn *next;                  /* what the executor is to run */
    char key[IDEMPOTENCY_KEY_SIZE]; /* of a POST; "": none */
    struct claim claim;             /* of that key, until the job is committed or refused */
    bool replayed;                  /* the answer is one that was given before */
    bool untimed;                   /* a stream or a wait: says nothing about our speed */
};

/* Goes on with `next` on the clerk's or the reader's thread. call_defer is for the HTTP thread and
 * suspends the request; call_pass is for a request that is suspended already. */
void call_defer(struct call *call, struct executor *executor, call_fn *next);
void call_pass(struct call *call, struct executor *executor, call_fn *next);
bool call_try_pass(struct call *call, struct executor *executor,
                   call_fn *next); /* false: no room, nothing done */

/* The body, decoded; valid until http_drop_body or the answer's end. On a thread that may block. 0, or -1
 * with *reterr. */
int call_body(struct call *call, const void **ret, size_t *ret_bytes, struct problem *reterr);

/* Answers with a problem. */
__attribute__((format(printf, 3, 4))) void call_refuse(struct call *call, enum problem_code code,
                                                       const char *format, ...);
void call_problem(struct call *call, const struct problem *problem);

/* Answers with JSON; takes the reference (NULL: out of memory). */
struct http_answer *answer_json(int status, json_t *json);

/* ---- handlers ------------------------------------------------------------------------------------ */

/* api_jobs.c */
call_fn job_post, job_list, job_get, job_delete, job_result, job_trace, job_preview;
/* The body of a job as it stands, wherever it is. On the clerk's or the reader's thread. 0, STORE_NONE,
 * STORE_GONE, or -1 with *reterr; job_refuse_unknown answers with what was not 0. */
int job_look_up(struct api *api, const char *owner, const char *id, char **ret_body,
                struct revision *ret_revision, bool *ret_ended, struct problem *reterr);
void job_refuse_unknown(struct call *call, int found, const struct problem *problem);
/* The hooks of waits.h; `data` unused. */
void job_wait_changed(struct http_request *request, struct revision revision, bool ended, const char *body,
                      void *data);
void job_wait_expired(struct http_request *request, void *data);

/* api_events.c */
call_fn job_events, jobs_events;

/* api_meshes.c */
call_fn mesh_put, mesh_post, mesh_get, mesh_delete;

/* api_about.c */
int about_open(struct api *api); /* makes the pages; 0, or -1 when out of memory */
void about_close(struct api *api);
call_fn about_info, about_materials, about_openapi, about_root, admin_livez, admin_readyz, admin_metrics;

#endif
