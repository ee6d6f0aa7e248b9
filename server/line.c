/* line.c - see line.h. */
#include "line.h"

#include <stdlib.h>
#include <string.h>

struct line {
    struct keys *keys;
    const struct limits *limits;
    struct share *first, *last; /* whose turn is next, whose was last */
    size_t taken;
    uint64_t memory;
};

struct line *line_new(struct keys *keys, const struct limits *limits)
{
    struct line *line = calloc(1, sizeof *line);
    if (line != NULL) {
        line->keys = keys;
        line->limits = limits;
    }
    return line;
}

struct line *line_free(struct line *line)
{
    while (line != NULL && line->first != NULL) {
        struct share *share = line->first;
        line->first = share->next;
        free(share);
    }
    free(line);
    return NULL;
}

/* ---- shares ----------------------------------------------------------------------------------------- */

static void append_share(struct line *line, struct share *share)
{
    share->next = NULL;
    share->prev = line->last;
    *(line->last != NULL ? &line->last->next : &line->first) = share;
    line->last = share;
}

static void unlink_share(struct line *line, struct share *share)
{
    *(share->prev != NULL ? &share->prev->next : &line->first) = share->next;
    *(share->next != NULL ? &share->next->prev : &line->last) = share->prev;
}

static struct share *find_share(const struct line *line, const char *owner)
{
    struct share *share = line->first;
    while (share != NULL && strcmp(share->owner, owner) != 0)
        share = share->next;
    return share;
}

struct share *line_hold(struct line *line, const char *owner)
{
    struct share *share = find_share(line, owner);
    if (share == NULL) {
        share = calloc(1, sizeof *share);
        if (share == NULL)
            return NULL;
        memcpy(share->owner, owner, strnlen(owner, sizeof share->owner - 1));
        append_share(line, share);
    }
    share->holds++;
    return share;
}

void line_let_go(struct line *line, struct share *share)
{
    if (--share->holds > 0)
        return;
    unlink_share(line, share);
    free(share);
}

size_t line_queued(const struct line *line, const char *owner)
{
    const struct share *share = find_share(line, owner);
    return share == NULL ? 0 : share->queued;
}

/* ---- places ----------------------------------------------------------------------------------------- */

/* From the highest priority, 0, to the lowest. */
static size_t rank(const struct place *place)
{
    return (size_t)(JOB_PRIORITY_HIGH - place->priority);
}

void line_enter(struct line *line, struct place *place, bool first)
{
    struct share *share = place->share;
    struct place **head = &share->first[rank(place)], **tail = &share->last[rank(place)];
    (void)line;
    place->waiting = true;
    share->waiting++;
    place->prev = first ? NULL : *tail;
    place->next = first ? *head : NULL;
    *(place->prev != NULL ? &place->prev->next : head) = place;
    *(place->next != NULL ? &place->next->prev : tail) = place;
}

void line_leave(struct line *line, struct place *place)
{
    struct share *share = place->share;
    (void)line;
    if (!place->waiting)
        return;
    place->waiting = false;
    share->waiting--;
    *(place->prev != NULL ? &place->prev->next : &share->first[rank(place)]) = place->next;
    *(place->next != NULL ? &place->next->prev : &share->last[rank(place)]) = place->prev;
}

/* Of a share of which something waits. */
static struct place *first_place(const struct share *share)
{
    size_t r = 0;
    while (share->first[r] == NULL)
        r++;
    return share->first[r];
}

/* ---- turns ------------------------------------------------------------------------------------------ */

static bool may_start(const struct line *line, const struct share *share)
{
    return share->waiting > 0 &&
           (line->keys == NULL || share->taken < keys_quota(line->keys, share->owner).running);
}

struct place *line_take(struct line *line)
{
    struct share *share = line->first;
    while (share != NULL && !may_start(line, share))
        share = share->next;
    if (share == NULL)
        return NULL;
    struct place *place = first_place(share);
    if (line->taken > 0 && line->memory + place->memory > line->limits->memory)
        return NULL;
    line_leave(line, place);
    unlink_share(line, share);
    append_share(line, share);
    share->taken++;
    share->holds++;
    line->taken++;
    line->memory += place->memory;
    return place;
}

void line_give_back(struct line *line, struct share *share, uint64_t memory)
{
    share->taken--;
    line->taken--;
    line->memory -= memory;
    line_let_go(line, share);
}

size_t line_position(const struct line *line, const struct place *place)
{
    size_t turns = 1, others = 0; /* turns of its owner until it starts */
    bool before = true;
    if (!place->waiting)
        return 0;
    for (size_t r = 0; r < rank(place); r++)
        for (const struct place *p = place->share->first[r]; p != NULL; p = p->next)
            turns++;
    for (const struct place *p = place->prev; p != NULL; p = p->prev)
        turns++;
    for (const struct share *share = line->first; share != NULL; share = share->next) {
        size_t most = before ? turns : turns - 1;
        if (share == place->share)
            before = false;
        else
            others += share->waiting < most ? share->waiting : most;
    }
    return turns + others;
}

size_t line_next(const struct line *line, const char *owner)
{
    const struct share *share = find_share(line, owner);
    return share == NULL || share->waiting == 0 ? 0 : line_position(line, first_place(share));
}

void line_heads(const struct line *line, void (*each)(const struct place *place, void *data), void *data)
{
    for (const struct share *share = line->first; share != NULL; share = share->next)
        for (size_t r = 0; r < JOB_PRIORITIES; r++)
            if (share->first[r] != NULL)
                each(share->first[r], data);
}

uint64_t line_memory(const struct line *line)
{
    return line->memory;
}
