/* cloth.c - sums the terms of one mesh's mechanics. */
#include "cloth.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

drape_status dr_cloth_new(const drape_scene *scene, const struct dr_mesh *mesh, const struct dr_bend *bend,
                          const double gravity[3], const double *start, const uint32_t *link, size_t links,
                          enum dr_cloth_matrix matrix, struct dr_cloth **ret, drape_error *reterr)
{
    drape_status status;
    struct dr_bend_stiffness *stiffness = NULL;
    struct dr_cloth *cloth = calloc(1, sizeof *cloth);
    if (!cloth)
        return dr_out_of_memory(reterr);
    cloth->mesh = mesh;
    cloth->bend = bend;
    memcpy(cloth->gravity, gravity, sizeof cloth->gravity);
    cloth->start = malloc(3 * mesh->nodes * sizeof *cloth->start);
    if (matrix != DR_MATRIX_NONE)
        cloth->stress = calloc(3 * mesh->triangles, sizeof *cloth->stress);
    if (!cloth->start || (matrix != DR_MATRIX_NONE && !cloth->stress)) {
        status = dr_out_of_memory(reterr);
        goto cleanup;
    }
    memcpy(cloth->start, start, 3 * mesh->nodes * sizeof *start);
    status = dr_stretch_new(mesh, scene->material, scene->materials, &cloth->stretch, reterr);
    if (status >= 0 && scene->bodies)
        status = dr_contact_new(mesh, scene->body, scene->bodies, &cloth->contact, reterr);
    if (status >= 0 && bend && matrix != DR_MATRIX_NONE)
        status = dr_bend_stiffness_new(bend, mesh->nodes, &stiffness, reterr);
    if (status >= 0 && matrix != DR_MATRIX_NONE)
        status = dr_matrix_new(mesh, stiffness, link, links, matrix == DR_MATRIX_LDL ? DR_LDL : DR_CHOLESKY,
                               &cloth->A, reterr);
    if (status >= 0) {
        *ret = cloth;
        cloth = NULL;
    }

cleanup:
    dr_bend_stiffness_free(stiffness);
    dr_cloth_free(cloth);
    return status;
}

struct dr_cloth *dr_cloth_free(struct dr_cloth *cloth)
{
    if (cloth) {
        dr_matrix_free(cloth->A);
        dr_contact_free(cloth->contact);
        dr_stretch_free(cloth->stretch);
        free(cloth->start);
        free(cloth->stress);
        free(cloth);
    }
    return NULL;
}

size_t dr_cloth_bytes(const struct dr_cloth *cloth)
{
    size_t bytes = sizeof *cloth + dr_stretch_bytes(cloth->stretch) + 3 * cloth->mesh->nodes * sizeof(double);
    if (cloth->A)
        bytes += dr_matrix_bytes(cloth->A) + 3 * cloth->mesh->triangles * sizeof(double);
    if (cloth->contact)
        bytes += dr_contact_bytes(cloth->contact);
    return bytes;
}

double dr_cloth_energy(const struct dr_cloth *cloth, const double *x, drape_energies *ret, double *f)
{
    const struct dr_mesh *mesh = cloth->mesh;
    const double *g = cloth->gravity;
    memset(f, 0, 3 * mesh->nodes * sizeof *f);

    /* The terms add their gradient; f is its negative, gravity included. */
    ret->stretch = dr_stretch_energy(cloth->stretch, x, f);
    ret->bend = cloth->bend ? dr_bend_energy(cloth->bend, x, f) : 0;
    ret->contact = cloth->contact ? dr_contact_energy(cloth->contact, x, f) : 0;
    long double gravity = 0;
    for (size_t i = 0; i < mesh->nodes; i++) {
        double fall = 0;
        for (size_t d = 0; d < 3; d++) {
            fall += g[d] * (x[3 * i + d] - cloth->start[3 * i + d]);
            f[3 * i + d] = mesh->mass[i] * g[d] - f[3 * i + d];
        }
        gravity -= mesh->mass[i] * fall;
    }
    ret->gravity = (double)gravity;
    ret->potential = ret->stretch + ret->bend + ret->contact + ret->gravity;
    return ret->potential;
}

void dr_cloth_assemble(struct dr_cloth *cloth, const double *x, double indefinite)
{
    dr_matrix_reset(cloth->A);
    dr_stretch_hessian(cloth->stretch, x, cloth->stress, indefinite, cloth->A);
    if (cloth->contact)
        dr_contact_hessian(cloth->contact, x, indefinite, cloth->A);
}

double dr_cloth_largest_force(const struct dr_cloth *cloth, const double *f)
{
    double largest = 0; /* squared */
    for (size_t i = 0; i < cloth->mesh->nodes; i++) {
        double square = f[3 * i] * f[3 * i] + f[3 * i + 1] * f[3 * i + 1] + f[3 * i + 2] * f[3 * i + 2];
        if (cloth->mesh->held[i])
            continue;
        if (isnan(square))
            return square;
        largest = fmax(largest, square);
    }
    return sqrt(largest);
}

double dr_cloth_mean_weight(const struct dr_cloth *cloth)
{
    const struct dr_mesh *mesh = cloth->mesh;
    const double *g = cloth->gravity;
    double mass = 0, size = sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]);
    for (size_t i = 0; i < mesh->nodes; i++)
        mass += mesh->mass[i];
    return mass / (double)mesh->nodes * (size > 0 ? size : 9.81);
}
