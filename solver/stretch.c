/* stretch.c - energy, force and Hessian of the St. Venant-Kirchhoff membrane. */
#include "stretch.h"

#include <math.h>
#include <stdlib.h>

#include "error.h"

struct elasticity {
    double d11, d12, d22, d33; /* N/m */
};

struct dr_stretch {
    const struct dr_mesh *mesh;
    size_t materials;
    struct elasticity *elasticity; /* by material */
};

drape_status dr_stretch_new(const struct dr_mesh *mesh, const drape_material *material, size_t materials,
                            struct dr_stretch **ret, drape_error *reterr)
{
    struct dr_stretch *stretch = calloc(1, sizeof *stretch);
    if (stretch)
        stretch->elasticity = calloc(materials, sizeof *stretch->elasticity);
    if (!stretch || !stretch->elasticity) {
        dr_stretch_free(stretch);
        return dr_out_of_memory(reterr);
    }
    stretch->mesh = mesh;
    stretch->materials = materials;
    for (size_t m = 0; m < materials; m++) {
        double nu = material[m].poisson, lateral = 1 - nu * nu;
        stretch->elasticity[m] = (struct elasticity){
            .d11 = material[m].stretch_weft / lateral,
            .d22 = material[m].stretch_warp / lateral,
            .d12 = nu * sqrt(material[m].stretch_weft) * sqrt(material[m].stretch_warp) / lateral,
            .d33 = material[m].stretch_shear,
        };
    }
    *ret = stretch;
    return DRAPE_OK;
}

struct dr_stretch *dr_stretch_free(struct dr_stretch *stretch)
{
    if (stretch) {
        free(stretch->elasticity);
        free(stretch);
    }
    return NULL;
}

size_t dr_stretch_bytes(const struct dr_stretch *stretch)
{
    return sizeof *stretch + stretch->materials * sizeof *stretch->elasticity;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The columns F_u = dx/du and F_v = dx/dv of triangle t for the field x: from differences to the
 * first corner, so that a cloth far from the origin keeps its digits. */
static void gradient_of(const struct dr_mesh *mesh, size_t t, const double *x, double fu[3], double fv[3])
{
    const uint32_t *node = mesh->triangle + 3 * t;
    const double *grad = mesh->grad + 6 * t;
    const double *x0 = x + 3 * (size_t)node[0], *x1 = x + 3 * (size_t)node[1], *x2 = x + 3 * (size_t)node[2];
    for (int d = 0; d < 3; d++) {
        double e1 = x1[d] - x0[d], e2 = x2[d] - x0[d];
        fu[d] = e1 * grad[2] + e2 * grad[4];
        fv[d] = e1 * grad[3] + e2 * grad[5];
    }
}

/* e = (E_uu, E_vv, 2 E_uv). (|F_u|^2 - 1)/2 is formed as (|F_u| - 1)(|F_u| + 1)/2, exact near rest. */
static void green_strain(const double fu[3], const double fv[3], double e[3])
{
    double u = sqrt(dot(fu, fu)), v = sqrt(dot(fv, fv));
    e[0] = 0.5 * (u - 1) * (u + 1);
    e[1] = 0.5 * (v - 1) * (v + 1);
    e[2] = dot(fu, fv);
}

static void stress_of(const struct elasticity *D, const double e[3], double s[3])
{
    s[0] = D->d11 * e[0] + D->d12 * e[1];
    s[1] = D->d12 * e[0] + D->d22 * e[1];
    s[2] = D->d33 * e[2];
}

double dr_stretch_energy(const struct dr_stretch *stretch, const double *x, double *g)
{
    const struct dr_mesh *mesh = stretch->mesh;
    long double sum = 0;
    for (size_t t = 0; t < mesh->triangles; t++) {
        double fu[3], fv[3], e[3], s[3];
        gradient_of(mesh, t, x, fu, fv);
        green_strain(fu, fv, e);
        stress_of(&stretch->elasticity[mesh->material[t]], e, s);
        double area = mesh->area[t];
        sum += 0.5 * area * (s[0] * e[0] + s[1] * e[1] + s[2] * e[2]);
        if (!g)
            continue;
        /* dE/dx_a = A F S grad a */
        const double *grad = mesh->grad + 6 * t;
        for (int a = 0; a < 3; a++) {
            double cu = area * (s[0] * grad[2 * a] + s[2] * grad[2 * a + 1]);
            double cv = area * (s[2] * grad[2 * a] + s[1] * grad[2 * a + 1]);
            double *ga = g + 3 * (size_t)mesh->triangle[3 * t + a];
            for (int d = 0; d < 3; d++)
                ga[d] += cu * fu[d] + cv * fv[d];
        }
    }
    return (double)sum;
}

void dr_stretch_stress(const struct dr_stretch *stretch, const double *x, const double *w, double *stress)
{
    const struct dr_mesh *mesh = stretch->mesh;
    for (size_t t = 0; t < mesh->triangles; t++) {
        double fu[3], fv[3], e[3];
        gradient_of(mesh, t, x, fu, fv);
        green_strain(fu, fv, e);
        if (w) { /* B w = (F_u.w_u, F_v.w_v, F_u.w_v + F_v.w_u) */
            double wu[3], wv[3];
            gradient_of(mesh, t, w, wu, wv);
            e[0] += dot(fu, wu);
            e[1] += dot(fv, wv);
            e[2] += dot(fu, wv) + dot(fv, wu);
        }
        stress_of(&stretch->elasticity[mesh->material[t]], e, stress + 3 * t);
    }
}

/* Replaces the symmetric 2x2 (s0 s2; s2 s1) by its positive part, sum of max(lambda,0) v v'. */
static void tensile_part(double s[3])
{
    double mean = 0.5 * (s[0] + s[1]), half = 0.5 * (s[0] - s[1]);
    double radius = hypot(half, s[2]);
    double high = mean + radius, low = mean - radius;
    if (low >= 0)
        return;
    if (high <= 0) {
        s[0] = s[1] = s[2] = 0;
        return;
    }
    /* One positive eigenvalue: high * (S - low I) / (high - low). */
    double c = high / (high - low);
    s[0] = c * (s[0] - low);
    s[1] = c * (s[1] - low);
    s[2] = c * s[2];
}

void dr_stretch_hessian(const struct dr_stretch *stretch, const double *x, const double *stress,
                        struct dr_matrix *A)
{
    const struct dr_mesh *mesh = stretch->mesh;
    for (size_t t = 0; t < mesh->triangles; t++) {
        const struct elasticity *D = &stretch->elasticity[mesh->material[t]];
        const double *grad = mesh->grad + 6 * t;
        double area = mesh->area[t];
        double fu[3], fv[3], B[3][9], DB[3][9], H[9][9];
        gradient_of(mesh, t, x, fu, fv);
        for (int a = 0; a < 3; a++)
            for (int d = 0; d < 3; d++) {
                B[0][3 * a + d] = fu[d] * grad[2 * a];
                B[1][3 * a + d] = fv[d] * grad[2 * a + 1];
                B[2][3 * a + d] = fu[d] * grad[2 * a + 1] + fv[d] * grad[2 * a];
            }
        for (int i = 0; i < 9; i++) {
            DB[0][i] = area * (D->d11 * B[0][i] + D->d12 * B[1][i]);
            DB[1][i] = area * (D->d12 * B[0][i] + D->d22 * B[1][i]);
            DB[2][i] = area * D->d33 * B[2][i];
        }
        for (int i = 0; i < 9; i++)
            for (int j = 0; j <= i; j++)
                H[i][j] = B[0][i] * DB[0][j] + B[1][i] * DB[1][j] + B[2][i] * DB[2][j];

        double s[3] = {stress[3 * t], stress[3 * t + 1], stress[3 * t + 2]};
        tensile_part(s);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b <= a; b++) {
                const double *ga = grad + 2 * a, *gb = grad + 2 * b;
                double geometric =
                    area * (ga[0] * (s[0] * gb[0] + s[2] * gb[1]) + ga[1] * (s[2] * gb[0] + s[1] * gb[1]));
                for (int d = 0; d < 3; d++)
                    H[3 * a + d][3 * b + d] += geometric;
            }
        dr_matrix_add_triangle(A, t, H);
    }
}
