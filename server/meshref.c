/* meshref.c - see meshref.h. */
#include "meshref.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

int meshref_load(const char *sha256, struct mesh *ret, struct problem *reterr, void *data)
{
    const struct meshref *ref = data;
    struct store_mesh mesh;
    int fd;
    int found = store_mesh_open(ref->store, ref->owner, sha256, &mesh, &fd, reterr);
    if (found > 0)
        return problem_set(reterr, PROBLEM_INVALID, "There is no mesh %s.", sha256);
    if (found < 0)
        return -1;
    void *map = mmap(NULL, mesh.bytes, PROT_READ, MAP_PRIVATE, fd, 0);
    int error = errno;
    close(fd);
    if (map == MAP_FAILED)
        return problem_set(reterr, PROBLEM_STORAGE, "The mesh could not be read: %s.", strerror(error));
    int result = meshfile_parse((enum mesh_format)mesh.format, map, mesh.bytes, ref->limits, ret, reterr);
    munmap(map, mesh.bytes);
    return result;
}
