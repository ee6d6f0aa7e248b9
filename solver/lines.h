/* lines.h - what a scene says about edges and points of its cloth (elastics, folds, tacks), checked and
 * compiled to bars, hinges and tacks of the welded mesh. */
#ifndef DR_LINES_H
#define DR_LINES_H

#include "scene.h"

/* What can be checked without the mesh: numbers and indices. The counts have been checked. */
drape_status dr_lines_check(const drape_scene_desc *desc, drape_error *reterr);

/* Fills the scene's bars, hinges and tacks (which then await dr_lines_lift), where there are any. */
drape_status dr_lines_compile(const drape_scene_desc *desc, drape_scene *scene, drape_error *reterr);

/* Lifts the tacks to where cloth can lie, once there are bodies. */
void dr_lines_lift(drape_scene *scene);

/* The mesh with no neighbour across any hinge, for bending: shares all arrays but `neighbor`, which is the
 * caller's to free. NULL neighbours: out of memory. */
struct dr_mesh dr_lines_cut(const struct dr_mesh *mesh, const struct dr_hinge *hinge, size_t hinges);

#endif
