/* waits.c - see waits.h. */
#include "waits.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct waiter {
    struct waiter *next;
    struct http_request *request;
    char id[ID_SIZE];
    struct revision seen; /* {0,0}: the end is waited for */
    int64_t deadline_ms;
};

struct waits {
    struct wait_answers answers;
    pthread_mutex_t lock; /* guards the rest */
    struct waiter *first;
    bool closed;
};

struct waits *waits_new(const struct wait_answers *answers)
{
    struct waits *waits = calloc(1, sizeof *waits);
    if (waits == NULL)
        return NULL;
    waits->answers = *answers;
    pthread_mutex_init(&waits->lock, NULL);
    return waits;
}

struct waits *waits_free(struct waits *waits)
{
    if (waits != NULL)
        pthread_mutex_destroy(&waits->lock);
    free(waits);
    return NULL;
}

int waits_add(struct waits *waits, struct http_request *request, const char *id, struct revision seen,
              int64_t deadline_ms)
{
    struct waiter *waiter = calloc(1, sizeof *waiter);
    if (waiter == NULL)
        return -1;
    waiter->request = request;
    snprintf(waiter->id, sizeof waiter->id, "%s", id);
    waiter->seen = seen;
    waiter->deadline_ms = deadline_ms;
    pthread_mutex_lock(&waits->lock);
    bool closed = waits->closed;
    if (!closed) {
        waiter->next = waits->first;
        waits->first = waiter;
    }
    pthread_mutex_unlock(&waits->lock);
    if (closed)
        free(waiter);
    return closed ? -1 : 0;
}

static bool satisfied(const struct waiter *waiter, const char *id, struct revision revision, bool ended)
{
    if (strcmp(waiter->id, id) != 0)
        return false;
    bool for_end = waiter->seen.attempt == 0 && waiter->seen.counter == 0;
    return ended || (!for_end && revision_compare(revision, waiter->seen) > 0);
}

/* The three ways out take waiters off the list under the lock, so none is answered twice. */
void waits_changed(struct waits *waits, const char *id, struct revision revision, bool ended,
                   const char *body)
{
    struct waiter *taken = NULL;
    pthread_mutex_lock(&waits->lock);
    for (struct waiter **p = &waits->first; *p != NULL;) {
        struct waiter *waiter = *p;
        if (satisfied(waiter, id, revision, ended)) {
            *p = waiter->next;
            waiter->next = taken;
            taken = waiter;
        } else {
            p = &waiter->next;
        }
    }
    pthread_mutex_unlock(&waits->lock);
    while (taken != NULL) {
        struct waiter *next = taken->next;
        waits->answers.changed(taken->request, revision, ended, body, waits->answers.data);
        free(taken);
        taken = next;
    }
}

void waits_tick(struct waits *waits, int64_t now_ms)
{
    struct waiter *taken = NULL;
    pthread_mutex_lock(&waits->lock);
    for (struct waiter **p = &waits->first; *p != NULL;) {
        struct waiter *waiter = *p;
        if (now_ms >= waiter->deadline_ms || waits->answers.deserted(waiter->request)) {
            *p = waiter->next;
            waiter->next = taken;
            taken = waiter;
        } else {
            p = &waiter->next;
        }
    }
    pthread_mutex_unlock(&waits->lock);
    while (taken != NULL) {
        struct waiter *next = taken->next;
        waits->answers.expired(taken->request, waits->answers.data);
        free(taken);
        taken = next;
    }
}

void waits_close(struct waits *waits)
{
    pthread_mutex_lock(&waits->lock);
    waits->closed = true;
    pthread_mutex_unlock(&waits->lock);
    waits_tick(waits, INT64_MAX);
}
