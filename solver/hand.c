/* hand.c - see hand.h. */
#include "hand.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>

#include "clock.h"

/* Looks before sleeping, about 0.1 ms: halves often come close behind one another, and waking takes as long.
 */
#define LOOKS 4000

/* A thread that waits for a half to run. */
struct helper {
    pthread_t thread;
    drape_processors *processors;
    pthread_cond_t called, done;
    bool lent;
    _Atomic(dr_half_fn *) run; /* NULL: nothing to do, or done */
    void *context;
    double seconds; /* that the last half took: written while it is lent */
};

struct drape_processors {
    pthread_mutex_t lock; /* guards all below, and the helpers' work */
    size_t count;
    size_t used; /* by sims, and by helpers at work */
    bool leaving;
    size_t helpers;
    struct helper helper[];
};

/* Waits a little until there is something to do (or there is not). */
static void look_out(struct helper *helper, bool for_work)
{
    for (int i = 0; i < LOOKS && (atomic_load(&helper->run) != NULL) != for_work; i++) {
#if defined(__x86_64__)
        __builtin_ia32_pause();
#endif
    }
}

static void *help(void *data)
{
    struct helper *helper = data;
    drape_processors *processors = helper->processors;
    pthread_mutex_lock(&processors->lock);
    for (;;) {
        while (!helper->run && !processors->leaving)
            pthread_cond_wait(&helper->called, &processors->lock);
        if (!helper->run)
            break;
        dr_half_fn *run = helper->run;
        pthread_mutex_unlock(&processors->lock);
        double began = dr_clock();
        run(helper->context, 1);
        helper->seconds = dr_clock() - began;
        pthread_mutex_lock(&processors->lock);
        helper->run = NULL;
        pthread_cond_signal(&helper->done);
        pthread_mutex_unlock(&processors->lock);
        look_out(helper, true);
        pthread_mutex_lock(&processors->lock);
    }
    pthread_mutex_unlock(&processors->lock);
    return NULL;
}

static bool start_helper(drape_processors *processors)
{
    struct helper *helper = processors->helper + processors->helpers;
    *helper = (struct helper){.processors = processors};
    pthread_cond_init(&helper->called, NULL);
    pthread_cond_init(&helper->done, NULL);
    if (pthread_create(&helper->thread, NULL, help, helper) == 0) {
        pthread_setname_np(helper->thread, "drape-helper");
        processors->helpers++;
        return true;
    }
    pthread_cond_destroy(&helper->called);
    pthread_cond_destroy(&helper->done);
    return false;
}

drape_processors *drape_processors_new(size_t count)
{
    size_t helpers = count / 2; /* a sim has one and borrows one */
    drape_processors *processors = calloc(1, sizeof *processors + helpers * sizeof *processors->helper);
    if (!processors)
        return NULL;
    pthread_mutex_init(&processors->lock, NULL);
    processors->count = count;
    while (processors->helpers < helpers && start_helper(processors))
        ;
    return processors;
}

drape_processors *drape_processors_free(drape_processors *processors)
{
    if (!processors)
        return NULL;
    pthread_mutex_lock(&processors->lock);
    processors->leaving = true;
    pthread_mutex_unlock(&processors->lock);
    for (size_t i = 0; i < processors->helpers; i++) {
        struct helper *helper = processors->helper + i;
        pthread_cond_signal(&helper->called);
        pthread_join(helper->thread, NULL);
        pthread_cond_destroy(&helper->called);
        pthread_cond_destroy(&helper->done);
    }
    pthread_mutex_destroy(&processors->lock);
    free(processors);
    return NULL;
}

void dr_processors_enter(drape_processors *processors)
{
    pthread_mutex_lock(&processors->lock);
    processors->used++;
    pthread_mutex_unlock(&processors->lock);
}

void dr_processors_leave(drape_processors *processors)
{
    pthread_mutex_lock(&processors->lock);
    processors->used--;
    pthread_mutex_unlock(&processors->lock);
}

/* NULL: there is none. */
static struct helper *call(drape_processors *processors, dr_half_fn *run, void *context)
{
    struct helper *helper = NULL;
    pthread_mutex_lock(&processors->lock);
    for (size_t i = 0; i < processors->helpers && !helper && processors->used < processors->count; i++)
        if (!processors->helper[i].lent)
            helper = processors->helper + i;
    if (helper) {
        processors->used++;
        helper->lent = true;
        helper->run = run;
        helper->context = context;
        pthread_cond_signal(&helper->called);
    }
    pthread_mutex_unlock(&processors->lock);
    return helper;
}

/* Until its half has ended; returns the seconds that took. */
static double dismiss(drape_processors *processors, struct helper *helper)
{
    look_out(helper, false);
    pthread_mutex_lock(&processors->lock);
    while (helper->run)
        pthread_cond_wait(&helper->done, &processors->lock);
    processors->used--;
    helper->lent = false;
    double seconds = helper->seconds;
    pthread_mutex_unlock(&processors->lock);
    return seconds;
}

void dr_hand_borrow(struct dr_hand *hand, dr_half_fn *run, void *context)
{
    struct helper *helper = call(hand->processors, run, context);
    run(context, 0);
    if (helper)
        hand->seconds += dismiss(hand->processors, helper);
    else
        run(context, 1);
}
