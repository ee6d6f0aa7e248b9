/* materials.h - named fabrics in SI units, each with where its numbers come from. */
#ifndef DRAPED_MATERIALS_H
#define DRAPED_MATERIALS_H

#include <stddef.h>

#include "drape.h"

struct material_preset {
    const char *name;    /* "cotton-poplin": part of the API */
    const char *summary; /* a few words for a list */
    const char *source;  /* which numbers were measured, by whom, and which are only typical */
    drape_material material;
};

/* All presets, in the order of GET /v1/materials; static. */
const struct material_preset *materials_all(size_t *ret_count);

/* NULL: no preset of that name. */
const struct material_preset *materials_find(const char *name);

#endif
