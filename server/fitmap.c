/* fitmap.c - means over triangles, and colours. */
#include "fitmap.h"

#include <math.h>
#include <stdlib.h>

/* ---- colours ---------------------------------------------------------------------------------- */

/* Five even stops of viridis (S. van der Walt, N. Smith and E. Firing, in Matplotlib; CC0): lightness rises
 * evenly, for colour-blind eyes too. sRGB. */
static const unsigned char STOP[][3] = {
    {0x44, 0x01, 0x54}, {0x3B, 0x52, 0x8B}, {0x21, 0x91, 0x8C}, {0x5E, 0xC9, 0x62}, {0xFD, 0xE7, 0x25}};
enum { STOPS = sizeof STOP / sizeof *STOP };

/* IEC 61966-2-1; glTF wants COLOR_0 linear. */
static double linear(double srgb)
{
    return srgb <= 0.04045 ? srgb / 12.92 : pow((srgb + 0.055) / 1.055, 2.4);
}

/* Of a value in [0, 1], linear between the stops. */
static void colour(double value, double ret[3])
{
    double at = value * (STOPS - 1);
    size_t low = at < STOPS - 2 ? (size_t)at : STOPS - 2;
    for (size_t k = 0; k < 3; k++)
        ret[k] = linear((STOP[low][k] + (at - (double)low) * (STOP[low + 1][k] - STOP[low][k])) / 255);
}

static void colour_strain(const struct mesh *mesh, struct fitmap *map)
{
    for (size_t i = 0; i < mesh->vertices; i++) {
        const double *e = map->strain + 3 * i;
        map->color[3 * i] = sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2] / 2);
        map->full = fmax(map->full, map->color[3 * i]);
    }
    for (size_t i = 0; i < mesh->vertices; i++)
        colour(map->full > 0 ? map->color[3 * i] / map->full : 0, map->color + 3 * i);
}

/* ---- by vertex -------------------------------------------------------------------------------- */

/* Of the flat rest shape, twice. */
static double rest_area(const struct mesh *mesh, const uint32_t *corner)
{
    const double *a = mesh->pattern + 2 * (size_t)corner[0], *b = mesh->pattern + 2 * (size_t)corner[1],
                 *c = mesh->pattern + 2 * (size_t)corner[2];
    return fabs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]));
}

/* `area`: vertices, zero. A vertex of no triangle keeps a strain of 0. */
static void average_strain(const drape_fit *fit, const struct mesh *mesh, double *area, double *strain)
{
    for (size_t i = 0; i < 3 * mesh->triangles; i++) {
        size_t t = i / 3, vertex = mesh->triangle[i];
        double weight = rest_area(mesh, mesh->triangle + 3 * t);
        area[vertex] += weight;
        for (size_t k = 0; k < 3; k++)
            strain[3 * vertex + k] += weight * fit->strain[3 * t + k];
    }
    for (size_t i = 0; i < 3 * mesh->vertices; i++)
        if (area[i / 3] > 0)
            strain[i] /= area[i / 3];
}

int fitmap_new(const drape_fit *fit, const struct mesh *mesh, struct fitmap *ret)
{
    size_t vertices = mesh->vertices;
    struct fitmap map = {.pressure = calloc(vertices, sizeof(double)),
                         .gap = calloc(vertices, sizeof(double)),
                         .strain = calloc(vertices, 3 * sizeof(double)),
                         .color = calloc(vertices, 3 * sizeof(double))};
    double *area = calloc(vertices, sizeof *area);
    int rc = map.pressure && map.gap && map.strain && map.color && area ? 0 : -1;
    if (rc == 0) {
        for (size_t i = 0; i < vertices; i++) {
            map.pressure[i] = fit->pressure[i];
            map.gap[i] = isnan(fit->gap[i]) ? DRAPE_REACH : fit->gap[i];
        }
        average_strain(fit, mesh, area, map.strain);
        colour_strain(mesh, &map);
        *ret = map;
    } else {
        fitmap_done(&map);
    }
    free(area);
    return rc;
}

void fitmap_done(struct fitmap *map)
{
    free(map->pressure);
    free(map->gap);
    free(map->strain);
    free(map->color);
    *map = (struct fitmap){0};
}
