/* mannequin.h - a generated dress form: neck stump, sloping shoulders, bust, waist and hips. */
#ifndef DRAPE_CLIENT_MANNEQUIN_H
#define DRAPE_CLIENT_MANNEQUIN_H

#include "surface.h"

/* One closed, watertight, outward-oriented triangle mesh of genus 0 with edges of about `spacing`
 * metres, [0.004, 0.1]; y up, z to the front. 0, or -1 when out of memory. */
int mannequin_build(double spacing, struct surface *ret);

/* Edge length giving about 8 000 triangles. */
#define MANNEQUIN_SPACING 0.0165

/* Landmarks that a pattern is drafted from (m). */
#define MANNEQUIN_TOP    1.50 /* end of the neck stump */
#define MANNEQUIN_BOTTOM 0.49

#endif
