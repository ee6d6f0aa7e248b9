/* groups.c - see groups.h. */
#include "groups.h"

#include <stdlib.h>

uint32_t *groups_new(size_t n)
{
    uint32_t *group = malloc((n > 0 ? n : 1) * sizeof *group);
    for (size_t i = 0; group != NULL && i < n; i++)
        group[i] = (uint32_t)i;
    return group;
}

uint32_t groups_root(uint32_t *group, uint32_t i)
{
    while (group[i] != i)
        i = group[i] = group[group[i]];
    return i;
}

void groups_unite(uint32_t *group, uint32_t a, uint32_t b)
{
    group[groups_root(group, a)] = groups_root(group, b);
}
