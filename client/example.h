/* example.h - the generated scenes of `drape example`: the three of [VMT07], and a dress on a form.
 *
 * [VMT07] Volino & Magnenat-Thalmann, "Stop-and-go cloth draping", The Visual Computer 2007. */
#ifndef DRAPE_CLIENT_EXAMPLE_H
#define DRAPE_CLIENT_EXAMPLE_H

#include "failure.h"
#include "scene.h"

struct example {
    const char *name;
    const char *summary; /* one line */
    size_t default_triangles;
    size_t min_triangles;
    /* Fills *scene, which is scene_default(); 0, or -1 with *failure. */
    int (*build)(size_t triangles, struct scene *scene, struct failure *failure);
};

#define EXAMPLE_MAX_TRIANGLES 1000000

/* NULL when there is no such example. */
const struct example *example_find(const char *name);

/* All of them, ended by a NULL name. */
extern const struct example example_list[];

/* Builds one with about `triangles` triangles (0: its default). 0 and *ret to be emptied with
 * scene_done, or -1 with *failure. */
int example_build(const struct example *example, size_t triangles, struct scene *ret,
                  struct failure *failure);

#endif
