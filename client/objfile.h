/* objfile.h - reads garments and bodies as OBJ, and the list of vertices to be sewn. */
#ifndef DRAPE_CLIENT_OBJFILE_H
#define DRAPE_CLIENT_OBJFILE_H

#include "failure.h"
#include "surface.h"

/* An OBJ mesh: v, f (polygons are cut into fans), and, where `with_pattern`, vt as the flat rest shape
 * in metres. A job has one pattern point per vertex, so each v must go with one vt everywhere. Other
 * statements are passed over. 0 and *ret to be emptied, or -1 with *failure naming file and line. */
int objfile_read(const char *path, bool with_pattern, struct surface *ret, struct failure *failure);

/* Lines "i j [stitch]", one-based vertices, # comments. *ret: 2 * *ret_seams zero-based, to be freed. */
int objfile_read_seams(const char *path, size_t vertices, uint32_t **ret, size_t *ret_seams,
                       struct failure *failure);

/* A line on the garment to be measured; owns both. */
struct objfile_line {
    char *name;
    uint32_t *vertex; /* vertices, zero-based */
    size_t vertices;
};

/* Lines "NAME i j k ...", one-based vertices, # comments. *ret: *ret_lines, to be emptied one by one with
 * objfile_line_done and freed. */
int objfile_read_lines(const char *path, size_t vertices, struct objfile_line **ret, size_t *ret_lines,
                       struct failure *failure);
void objfile_line_done(struct objfile_line *line);

#endif
