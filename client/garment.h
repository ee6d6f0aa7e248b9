/* garment.h - a sleeveless A-line dress, cut from two flat pieces and placed around the mannequin. */
#ifndef DRAPE_CLIENT_GARMENT_H
#define DRAPE_CLIENT_GARMENT_H

#include "failure.h"
#include "scene.h"

/* Fewer triangles than this cannot follow the neckline and the armholes. */
#define GARMENT_MIN_TRIANGLES 600

/* Cloth (front and back panel of together about `triangles` triangles), side and shoulder seams, and
 * the mannequin as the only body. Nothing is pinned: the shoulders hold it. Fills cloth, seam and
 * body of *scene, which must be empty; 0, or -1 with *failure. */
int garment_build(size_t triangles, struct scene *scene, struct failure *failure);

#endif
