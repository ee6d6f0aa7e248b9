/* place.h - where a garment starts: larger, or farther from the body, so that it can go over another. */
#ifndef DRAPE_CLIENT_PLACE_H
#define DRAPE_CLIENT_PLACE_H

#include "surface.h"

/* Scales the pattern, and the start about the middle of its box, so that nothing is strained by it. */
void place_scale(struct surface *garment, double factor);

/* Moves each piece (what triangles join) by `way` metres along the level part of its mean normal. A piece
 * whose mean normal is upright, or none, stays. y is up. 0, or -1 (memory) with nothing moved. */
int place_outwards(struct surface *garment, double way);

#endif
