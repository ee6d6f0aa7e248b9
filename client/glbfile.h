/* glbfile.h - reads the first mesh of a binary glTF 2.0 file. */
#ifndef DRAPE_CLIENT_GLBFILE_H
#define DRAPE_CLIENT_GLBFILE_H

#include "failure.h"
#include "surface.h"

/* Positions and triangles of the first primitive of the first mesh (float positions, 8-, 16- or 32-bit
 * indices, data in the file's own binary chunk, no sparse or compressed data). `path` is for messages. */
int glbfile_parse(const char *path, const char *data, size_t bytes, struct surface *ret,
                  struct failure *failure);

#endif
