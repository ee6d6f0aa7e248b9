/* seam.h - what a scene's seams would do that is hardly meant: warnings before anything is solved. */
#ifndef DR_SEAM_H
#define DR_SEAM_H

#include "drape.h"

/* As drape_scene_warnings, which see; `vertex_node`: vertices, node of each once the seams are welded. */
drape_status dr_seam_warnings(const drape_scene_desc *desc, const uint32_t *vertex_node, drape_error *ret,
                              size_t *ret_count, drape_error *reterr);

#endif
