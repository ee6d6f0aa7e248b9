/* hand.h - a second processor that a sim borrows, for a moment at a time (drape_processors, in drape.h).
 *
 * Work is cut in two halves that share nothing they write to, the same two whether anybody lends or not: what
 * comes out doesn't depend on it, to the last bit. */
#ifndef DR_HAND_H
#define DR_HAND_H

#include "drape.h"

/* Of one sim, whose thread it belongs to. */
struct dr_hand {
    drape_processors *processors; /* borrowed; NULL: there is nothing to lend */
    double seconds;               /* for which a second processor was borrowed */
};

typedef void dr_half_fn(void *context, int half);

/* As dr_hand_both, from what there is to lend. */
void dr_hand_borrow(struct dr_hand *hand, dr_half_fn *run, void *context);

/* Runs both halves: 0 here and 1 on a processor that nobody uses or, where there is none, afterwards. Returns
 * when both have ended. hand: NULL is fine. */
static inline void dr_hand_both(struct dr_hand *hand, dr_half_fn *run, void *context)
{
    if (hand && hand->processors) {
        dr_hand_borrow(hand, run, context);
    } else {
        run(context, 0);
        run(context, 1);
    }
}

/* The caller begins to use a processor of its own, and ends. */
void dr_processors_enter(drape_processors *processors);
void dr_processors_leave(drape_processors *processors);

#endif
