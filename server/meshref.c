/* meshref.c - see meshref.h. */
#include "meshref.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

void meshref_list_done(struct meshref_list *list)
{
    free(list->sha256);
    memset(list, 0, sizeof *list);
}

/* 0, or -1 when out of memory. */
static int note(struct meshref_list *list, const char *sha256)
{
    for (size_t i = 0; i < list->count; i++)
        if (strcmp(list->sha256[i], sha256) == 0)
            return 0;
    if (list->count == list->room) {
        size_t room = list->room ? 2 * list->room : 8;
        void *more = reallocarray(list->sha256, room, sizeof *list->sha256);
        if (more == NULL)
            return -1;
        list->sha256 = more;
        list->room = room;
    }
    memcpy(list->sha256[list->count++], sha256, SHA256_SIZE);
    return 0;
}

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
    if (ref->loaded != NULL && note(ref->loaded, mesh.sha256) != 0) {
        close(fd);
        return problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    }
    void *map = mmap(NULL, mesh.bytes, PROT_READ, MAP_PRIVATE, fd, 0);
    int error = errno;
    close(fd);
    if (map == MAP_FAILED)
        return problem_set(reterr, PROBLEM_STORAGE, "The mesh could not be read: %s.", strerror(error));
    int result = meshfile_parse((enum mesh_format)mesh.format, map, mesh.bytes, ref->limits, ret, reterr);
    munmap(map, mesh.bytes);
    return result;
}
