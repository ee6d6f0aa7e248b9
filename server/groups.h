/* groups.h - things that belong together, pair by pair: a union-find over 0 .. n-1. */
#ifndef DRAPED_GROUPS_H
#define DRAPED_GROUPS_H

#include <stddef.h>
#include <stdint.h>

uint32_t *groups_new(size_t n); /* everything on its own; malloc'd, NULL when out of memory */

/* The one that stands for the group of `i`; halves the paths as it goes. */
uint32_t groups_root(uint32_t *group, uint32_t i);
void groups_unite(uint32_t *group, uint32_t a, uint32_t b);

#endif
