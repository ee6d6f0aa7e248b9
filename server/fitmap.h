/* fitmap.h - how a drape fits, by vertex, for the mesh formats that can carry it (PLY, GLB). */
#ifndef DRAPED_FITMAP_H
#define DRAPED_FITMAP_H

#include "drape.h"
#include "meshfile.h"

struct fitmap {       /* owns its arrays; zero-initialise */
    double *pressure; /* vertices, Pa */
    double *gap;      /* vertices, m; DRAPE_REACH where the solver knows none: these formats have no null */
    double *strain;   /* 3*vertices: E_uu, E_vv, 2 E_uv, means over the triangles by rest area */
    double *color;    /* 3*vertices: linear RGB of the size of that strain */
    double full;      /* the size at the end of the colour map: the largest there is */
};

/* The size of a strain is sqrt(E_uu^2 + E_vv^2 + 2 E_uv^2), whichever way the yarns run. `mesh` is that of
 * the job, pattern included. 0, or -1 when out of memory. */
int fitmap_new(const drape_fit *fit, const struct mesh *mesh, struct fitmap *ret);
void fitmap_done(struct fitmap *map); /* empties without freeing the struct */

#endif
