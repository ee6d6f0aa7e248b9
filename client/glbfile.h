/* glbfile.h - reads the first mesh of a binary glTF 2.0 file. */
#ifndef DRAPE_CLIENT_GLBFILE_H
#define DRAPE_CLIENT_GLBFILE_H

#include "failure.h"
#include "surface.h"

/* Positions and triangles of the first primitive of the first mesh (float positions, 8-, 16- or 32-bit
 * indices, data in the file's own binary chunk, no sparse or compressed data). `path` is for messages. */
int glbfile_parse(const char *path, const char *data, size_t bytes, struct surface *ret,
                  struct failure *failure);

/* Gives a mesh that glbfile_parse read from the same file the `attribute` of its vertices as their values: a
 * float, or of a vector (a strain: weft, warp, shear) the size sqrt(x^2 + y^2 + z^2/2). 0, with no values
 * where the file has no such attribute, or -1 with *failure. */
int glbfile_read_values(const char *path, const char *data, size_t bytes, const char *attribute,
                        struct surface *mesh, struct failure *failure);

#endif
