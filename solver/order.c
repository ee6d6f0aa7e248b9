/* order.c - see order.h. Each part is halved across whichever of nine directions has the smallest separator.
 *
 * A direction is a difference of distances from one or two of four nodes far from one another and from as
 * many others; a part is cut at its median, and the least set of nodes that meets every edge of the cut
 * separates the halves: as large as the largest matching of those edges (Koenig). */
#include "order.h"

#include <limits.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define LEAF       240 /* nodes of a part that is left to minimum degree */
#define PIVOTS     4
#define DIRECTIONS 9
#define FAR        1000000 /* distance of what cannot be reached */

enum side { OUTSIDE, LOW, HIGH, BETWEEN };

struct entry {
    int64_t key;
    int node;
};

struct dissection {
    const int *start, *neighbor;
    int *rank, ranks;
    int *distance[PIVOTS]; /* nodes: edges from the pivot, within the part */
    unsigned char *side;   /* nodes: OUTSIDE but for the part at hand */
    int *mate;             /* nodes: in the matching, -1: none */
    int *reached_by;       /* nodes */
    int *seen, sight;      /* nodes: seen[i] == sight in this search */
    int *queue;            /* nodes */
    struct entry *entry;   /* nodes */
};

static bool precedes(struct entry a, struct entry b)
{
    return a.key != b.key ? a.key < b.key : a.node < b.node;
}

/* Brings the `lower` first of them to the front, in any order (Hoare's quickselect). */
static void select_lower(struct entry *entry, int count, int lower)
{
    int first = 0, last = count - 1;
    while (first < last) {
        struct entry pivot = entry[first + (last - first) / 2];
        int i = first, j = last;
        while (i <= j) {
            while (precedes(entry[i], pivot))
                i++;
            while (precedes(pivot, entry[j]))
                j--;
            if (i <= j) {
                struct entry swap = entry[i];
                entry[i++] = entry[j];
                entry[j--] = swap;
            }
        }
        if (lower <= j + 1)
            last = j;
        else
            first = i;
        if (lower == j + 1 || lower == i)
            return;
    }
}

static void mark(struct dissection *d, const int *part, int count, enum side side)
{
    for (int i = 0; i < count; i++)
        d->side[part[i]] = (unsigned char)side;
}

/* Distances within the part; returns a node that is farthest of those reached. */
static int measure(struct dissection *d, const int *part, int count, int from, int *distance)
{
    int head = 0, tail = 0;
    for (int i = 0; i < count; i++)
        distance[part[i]] = FAR;
    distance[from] = 0;
    for (d->queue[tail++] = from; head < tail; head++) {
        int u = d->queue[head];
        for (int k = d->start[u]; k < d->start[u + 1]; k++) {
            int v = d->neighbor[k];
            if (d->side[v] != OUTSIDE && distance[v] == FAR) {
                distance[v] = distance[u] + 1;
                d->queue[tail++] = v;
            }
        }
    }
    return d->queue[tail - 1];
}

/* Fills the distances from four nodes, each far from those before. */
static void choose_pivots(struct dissection *d, const int *part, int count)
{
    int pivot = measure(d, part, count, part[0], d->distance[0]);
    for (int p = 0; p < PIVOTS; p++) {
        int farthest = -1;
        measure(d, part, count, pivot, d->distance[p]);
        for (int i = 0; i < count; i++) {
            int nearest = INT_MAX;
            for (int q = 0; q <= p; q++)
                nearest = d->distance[q][part[i]] < nearest ? d->distance[q][part[i]] : nearest;
            if (nearest > farthest) {
                farthest = nearest;
                pivot = part[i];
            }
        }
    }
}

static int64_t along(const struct dissection *d, int v, int direction)
{
    static const int weight[DIRECTIONS][PIVOTS] = {{1, -1, 0, 0},  {0, 0, 1, -1},  {1, 0, -1, 0},
                                                   {0, 1, 0, -1},  {1, 0, 0, -1},  {0, 1, -1, 0},
                                                   {1, 1, -1, -1}, {1, -1, 1, -1}, {1, -1, -1, 1}};
    int64_t sum = 0;
    for (int p = 0; p < PIVOTS; p++)
        sum += (int64_t)weight[direction][p] * d->distance[p][v];
    return sum;
}

/* Puts the lower half of the part along one direction, ties along the next, first; marks LOW and HIGH. */
static void halve(struct dissection *d, int *part, int count, int direction)
{
    for (int i = 0; i < count; i++) {
        int64_t first = along(d, part[i], direction),
                second = along(d, part[i], (direction + 1) % DIRECTIONS);
        d->entry[i] = (struct entry){first * 8 * FAR + second, part[i]};
    }
    select_lower(d->entry, count, count / 2);
    for (int i = 0; i < count; i++)
        part[i] = d->entry[i].node;
    mark(d, part, count / 2, LOW);
    mark(d, part + count / 2, count - count / 2, HIGH);
}

/* Finds a mate for u, a node of the lower side, by an augmenting path that begins there. */
static bool find_mate(struct dissection *d, int u)
{
    int head = 0, tail = 0;
    d->sight++;
    for (d->queue[tail++] = u; head < tail; head++) {
        int low = d->queue[head];
        for (int k = d->start[low]; k < d->start[low + 1]; k++) {
            int high = d->neighbor[k];
            if (d->side[high] != HIGH || d->seen[high] == d->sight)
                continue;
            d->seen[high] = d->sight;
            d->reached_by[high] = low;
            if (d->mate[high] >= 0) {
                d->queue[tail++] = d->mate[high];
                continue;
            }
            for (int next; high >= 0; high = next) { /* back along the path */
                int by = d->reached_by[high];
                next = d->mate[by];
                d->mate[by] = high;
                d->mate[high] = by;
            }
            return true;
        }
    }
    return false;
}

/* The largest matching of the edges between the halves; returns its size, or `most` if it is no smaller. */
static int match(struct dissection *d, const int *part, int count, int most)
{
    int size = 0;
    for (int i = 0; i < count; i++)
        d->mate[part[i]] = -1;
    for (int i = 0; i < count / 2 && size < most; i++)
        size += find_mate(d, part[i]);
    return size;
}

/* Marks the separator BETWEEN: with what alternating paths from unmatched nodes of the lower side reach, the
 * matched nodes that are LOW and not reached or HIGH and reached. */
static void separate(struct dissection *d, const int *part, int count)
{
    int head = 0, tail = 0;
    d->sight++;
    for (int i = 0; i < count / 2; i++)
        if (d->mate[part[i]] < 0) {
            d->seen[part[i]] = d->sight;
            d->queue[tail++] = part[i];
        }
    for (; head < tail; head++) {
        int low = d->queue[head];
        for (int k = d->start[low]; k < d->start[low + 1]; k++) {
            int high = d->neighbor[k];
            if (d->side[high] != HIGH || d->seen[high] == d->sight)
                continue;
            d->seen[high] = d->sight; /* and its mate: else the matching were not the largest */
            d->seen[d->mate[high]] = d->sight;
            d->queue[tail++] = d->mate[high];
        }
    }
    for (int i = 0; i < count; i++) {
        int v = part[i];
        if (d->mate[v] >= 0 && (d->seen[v] == d->sight) == (d->side[v] == HIGH))
            d->queue[i] = BETWEEN;
        else
            d->queue[i] = d->side[v];
    }
    for (int i = 0; i < count; i++)
        d->side[part[i]] = (unsigned char)d->queue[i];
}

/* Puts the lower side first and the separator last. */
static void sort_out(const struct dissection *d, int *part, int count, int ret_count[2])
{
    int at = 0;
    for (enum side side = LOW; side <= BETWEEN; side++) {
        int before = at;
        for (int i = 0; i < count; i++)
            if (d->side[d->entry[i].node] == side)
                part[at++] = d->entry[i].node;
        if (side < BETWEEN)
            ret_count[side - LOW] = at - before;
    }
}

/* Cuts the part in two, which come first in it, and a separator; two empty ones where that is too large. */
static void cut(struct dissection *d, int *part, int count, int ret_count[2])
{
    int best = -1, least = count / 4; /* a larger separator is not worth it */
    mark(d, part, count, LOW);
    choose_pivots(d, part, count);
    for (int direction = 0; direction < DIRECTIONS; direction++) {
        halve(d, part, count, direction);
        int size = match(d, part, count, least);
        if (size < least) {
            least = size;
            best = direction;
        }
    }
    if (best >= 0) {
        halve(d, part, count, best);
        match(d, part, count, INT_MAX);
        separate(d, part, count);
        sort_out(d, part, count, ret_count);
    }
    mark(d, part, count, OUTSIDE);
}

static void give_rank(struct dissection *d, const int *part, int count)
{
    for (int i = 0; i < count; i++)
        d->rank[part[i]] = d->ranks;
    d->ranks += count > 0;
}

/* Halves parts until they are leaves; a part's halves come before its separator. */
static void dissect(struct dissection *d, int *part, int count)
{
    int half[2] = {0, 0};
    if (count > LEAF)
        cut(d, part, count, half);
    if (!half[0] || !half[1]) {
        give_rank(d, part, count);
        return;
    }
    dissect(d, part, half[0]);
    dissect(d, part + half[0], half[1]);
    give_rank(d, part + half[0] + half[1], count - half[0] - half[1]);
}

bool dr_order_dissect(size_t n, const int *start, const int *neighbor, int *rank)
{
    struct dissection d = {.start = start, .neighbor = neighbor, .rank = rank};
    int *part = NULL, **array[] = {&d.mate, &d.reached_by, &d.seen, &d.queue, &part};
    size_t arrays = sizeof array / sizeof *array;
    bool made = true;
    for (size_t i = 0; i < arrays; i++)
        made = (*array[i] = calloc(n + 1, sizeof(int))) && made;
    for (size_t p = 0; p < PIVOTS; p++)
        made = (d.distance[p] = calloc(n + 1, sizeof(int))) && made;
    d.side = calloc(n + 1, sizeof *d.side);
    d.entry = calloc(n + 1, sizeof *d.entry);
    made = d.side && d.entry && made;
    for (size_t i = 0; made && i < n; i++)
        part[i] = (int)i;
    if (made)
        dissect(&d, part, (int)n);
    for (size_t i = 0; i < arrays; i++)
        free(*array[i]);
    for (size_t p = 0; p < PIVOTS; p++)
        free(d.distance[p]);
    free(d.side);
    free(d.entry);
    return made;
}
