/* stretch.c - energy, force and Hessian of the membrane.
 *
 * Each loop over the triangles is written once and compiled twice, with `curved` a constant: the loop of
 * linear fabrics knows nothing of curves, and executes the instructions it had before there were any. */
#include "stretch.h"

#include <math.h>
#include <stdlib.h>

#include "curve.h"
#include "error.h"

struct elasticity {
    double d11, d12, d22, d33; /* N/m */
};

struct dr_stretch {
    const struct dr_mesh *mesh;
    size_t materials;
    struct elasticity *elasticity; /* by material; 0 in the place of a component that has a curve */
    struct dr_curve **curve;       /* 3*materials: weft, warp, shear, NULL where linear; NULL: all linear */
};

/* The curved copy stands in a function of its own, so that its registers do not spoil the linear one's. */
#define inlined static inline __attribute__((always_inline))
#define apart   static __attribute__((noinline))

static double stiffness(double number, const drape_curve *curve)
{
    return curve->points ? 0 : number;
}

static bool any_curve(const drape_material *material, size_t materials)
{
    for (size_t m = 0; m < materials; m++)
        if (material[m].curve_weft.points || material[m].curve_warp.points || material[m].curve_shear.points)
            return true;
    return false;
}

static drape_status new_curves(struct dr_stretch *stretch, const drape_material *material,
                               drape_error *reterr)
{
    stretch->curve = calloc(3 * stretch->materials, sizeof(struct dr_curve *));
    if (!stretch->curve)
        return dr_out_of_memory(reterr);
    for (size_t i = 0; i < 3 * stretch->materials; i++) {
        const drape_material *of = material + i / 3;
        const drape_curve *curve[] = {&of->curve_weft, &of->curve_warp, &of->curve_shear};
        if (!curve[i % 3]->points)
            continue;
        stretch->curve[i] = dr_curve_new(curve[i % 3]);
        if (!stretch->curve[i])
            return dr_out_of_memory(reterr);
    }
    return DRAPE_OK;
}

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
        double weft = stiffness(material[m].stretch_weft, &material[m].curve_weft);
        double warp = stiffness(material[m].stretch_warp, &material[m].curve_warp);
        stretch->elasticity[m] = (struct elasticity){
            .d11 = weft / lateral,
            .d22 = warp / lateral,
            .d12 = nu * sqrt(weft) * sqrt(warp) / lateral,
            .d33 = stiffness(material[m].stretch_shear, &material[m].curve_shear),
        };
    }
    drape_status status = any_curve(material, materials) ? new_curves(stretch, material, reterr) : DRAPE_OK;
    if (status < 0) {
        dr_stretch_free(stretch);
        return status;
    }
    *ret = stretch;
    return DRAPE_OK;
}

struct dr_stretch *dr_stretch_free(struct dr_stretch *stretch)
{
    if (stretch) {
        for (size_t i = 0; stretch->curve && i < 3 * stretch->materials; i++)
            dr_curve_free(stretch->curve[i]);
        free(stretch->curve);
        free(stretch->elasticity);
        free(stretch);
    }
    return NULL;
}

size_t dr_stretch_curve_bytes(const struct dr_stretch *stretch)
{
    size_t bytes = 0;
    for (size_t i = 0; stretch->curve && i < 3 * stretch->materials; i++)
        bytes += sizeof(struct dr_curve *) + (stretch->curve[i] ? dr_curve_bytes(stretch->curve[i]) : 0);
    return bytes;
}

size_t dr_stretch_bytes(const struct dr_stretch *stretch)
{
    return sizeof *stretch + stretch->materials * sizeof *stretch->elasticity +
           dr_stretch_curve_bytes(stretch);
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

/* ---- curves ------------------------------------------------------------------------------------- */

/* What one component of the strain gives, N/m each. */
struct response {
    double stress, tangent, energy;
};

/* S(E) = P(l - 1)/l with l = sqrt(1 + 2E), since the work P dl is S dE; compressed, the linear fabric of
 * the slope at rest, which joins it with one tangent. dS/dE = (P' - P/l)/l^2 falls below 0 where the
 * curve bends down. */
static struct response pull(const struct dr_curve *curve, double E)
{
    if (E <= 0) {
        double k = dr_curve_rest_slope(curve);
        return (struct response){k * E, k, 0.5 * k * E * E};
    }
    double l = sqrt(1 + 2 * E);
    struct dr_curve_value P = dr_curve_at(curve, 2 * E / (1 + l)); /* l - 1 without cancellation */
    double S = P.stress / l;
    return (struct response){S, (P.slope - S) / (l * l), P.work};
}

static struct response shear(const struct dr_curve *curve, double strain)
{
    struct dr_curve_value at = dr_curve_at(curve, fabs(strain));
    return (struct response){copysign(at.stress, strain), at.slope, at.work};
}

/* The stress s of material m at the strain e, and the elasticity D there with tangents in the place of
 * stiffnesses; gives the energy per area. Of a negative tangent the part `negative` in [0, 1] is kept:
 * without it the Hessian is semi-definite, and the geometric part still holds the yarn. Components do
 * not couple where there is a curve (poisson is 0). */
static double curve_response(const struct dr_stretch *stretch, size_t m, const double e[3], double negative,
                             double s[3], struct elasticity *D)
{
    double *diagonal[] = {&D->d11, &D->d22, &D->d33}, energy = 0;
    *D = stretch->elasticity[m];
    stress_of(D, e, s);
    for (int i = 0; i < 3; i++) {
        const struct dr_curve *curve = stretch->curve[3 * m + (size_t)i];
        if (!curve) {
            energy += 0.5 * s[i] * e[i];
            continue;
        }
        struct response r = i < 2 ? pull(curve, e[i]) : shear(curve, e[i]);
        energy += r.energy;
        s[i] = r.stress;
        *diagonal[i] = r.tangent < 0 ? negative * r.tangent : r.tangent;
    }
    return energy;
}

/* ---- loops over the triangles ------------------------------------------------------------------- */

inlined double energy_loop(const struct dr_stretch *stretch, const double *x, double *g, const bool curved)
{
    const struct dr_mesh *mesh = stretch->mesh;
    long double sum = 0;
    for (size_t t = 0; t < mesh->triangles; t++) {
        double fu[3], fv[3], e[3], s[3];
        gradient_of(mesh, t, x, fu, fv);
        green_strain(fu, fv, e);
        double area = mesh->area[t];
        if (curved) {
            struct elasticity unused;
            sum += area * curve_response(stretch, mesh->material[t], e, 0, s, &unused);
        } else {
            stress_of(&stretch->elasticity[mesh->material[t]], e, s);
            sum += 0.5 * area * (s[0] * e[0] + s[1] * e[1] + s[2] * e[2]);
        }
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

apart double curved_energy(const struct dr_stretch *stretch, const double *x, double *g)
{
    return energy_loop(stretch, x, g, true);
}

double dr_stretch_energy(const struct dr_stretch *stretch, const double *x, double *g)
{
    return stretch->curve ? curved_energy(stretch, x, g) : energy_loop(stretch, x, g, false);
}

/* B w = (F_u.w_u, F_v.w_v, F_u.w_v + F_v.w_u) of triangle t, added to e. */
inlined void add_strain_step(const struct dr_mesh *mesh, size_t t, const double fu[3], const double fv[3],
                             const double *w, double e[3])
{
    double wu[3], wv[3];
    gradient_of(mesh, t, w, wu, wv);
    e[0] += dot(fu, wu);
    e[1] += dot(fv, wv);
    e[2] += dot(fu, wv) + dot(fv, wu);
}

static void predict_on_curves(const struct dr_stretch *stretch, size_t t, const double fu[3],
                              const double fv[3], const double e[3], const double *w, double s[3])
{
    struct elasticity D;
    double step[3] = {0, 0, 0}, more[3];
    curve_response(stretch, stretch->mesh->material[t], e, 0, s, &D);
    if (!w)
        return;
    add_strain_step(stretch->mesh, t, fu, fv, w, step);
    stress_of(&D, step, more);
    for (int i = 0; i < 3; i++)
        s[i] += more[i];
}

inlined void stress_loop(const struct dr_stretch *stretch, const double *x, const double *w, double *stress,
                         const bool curved)
{
    const struct dr_mesh *mesh = stretch->mesh;
    for (size_t t = 0; t < mesh->triangles; t++) {
        double fu[3], fv[3], e[3];
        gradient_of(mesh, t, x, fu, fv);
        green_strain(fu, fv, e);
        if (curved) {
            predict_on_curves(stretch, t, fu, fv, e, w, stress + 3 * t);
            continue;
        }
        if (w)
            add_strain_step(mesh, t, fu, fv, w, e);
        stress_of(&stretch->elasticity[mesh->material[t]], e, stress + 3 * t);
    }
}

apart void curved_stress(const struct dr_stretch *stretch, const double *x, const double *w, double *stress)
{
    stress_loop(stretch, x, w, stress, true);
}

void dr_stretch_stress(const struct dr_stretch *stretch, const double *x, const double *w, double *stress)
{
    if (stretch->curve)
        curved_stress(stretch, x, w, stress);
    else
        stress_loop(stretch, x, w, stress, false);
}

void dr_stretch_strain(const struct dr_stretch *stretch, const double *x, double *strain)
{
    for (size_t t = 0; t < stretch->mesh->triangles; t++) {
        double fu[3], fv[3];
        gradient_of(stretch->mesh, t, x, fu, fv);
        green_strain(fu, fv, strain + 3 * t);
    }
}

/* Replaces the symmetric 2x2 (s0 s2; s2 s1) by its positive part, sum of max(lambda,0) v v'. */
inlined void tensile_part(double s[3])
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

/* As many triangles as the processor may work on at once. */
#define LANES DR_MATRIX_BATCH
typedef double quad __attribute__((vector_size(LANES * sizeof(double)), aligned(sizeof(double)), may_alias));

/* What their Hessians are made of. */
struct batch {
    double fu[3][LANES], fv[3][LANES], grad[6][LANES], area[LANES], stress[3][LANES];
    double d11[LANES], d12[LANES], d22[LANES], d33[LANES];
};

inlined void fill_lane(const struct dr_stretch *stretch, size_t t, const double *x, const double *stress,
                       double compression, struct batch *batch, size_t lane, const bool curved)
{
    const struct dr_mesh *mesh = stretch->mesh;
    const struct elasticity *D = &stretch->elasticity[mesh->material[t]];
    struct elasticity tangent;
    double fu[3], fv[3], s[3] = {stress[3 * t], stress[3 * t + 1], stress[3 * t + 2]};
    gradient_of(mesh, t, x, fu, fv);
    if (curved) {
        double e[3], unused[3];
        green_strain(fu, fv, e);
        curve_response(stretch, mesh->material[t], e, compression, unused, &tangent);
        D = &tangent;
    }
    tensile_part(s);
    for (size_t k = 0; k < 3; k++) {
        batch->fu[k][lane] = fu[k];
        batch->fv[k][lane] = fv[k];
        batch->stress[k][lane] = s[k] + compression * (stress[3 * t + k] - s[k]);
    }
    for (size_t k = 0; k < 6; k++)
        batch->grad[k][lane] = mesh->grad[6 * t + k];
    batch->area[lane] = mesh->area[t];
    batch->d11[lane] = D->d11;
    batch->d12[lane] = D->d12;
    batch->d22[lane] = D->d22;
    batch->d33[lane] = D->d33;
}

inlined const quad *lanes(const double number[LANES])
{
    return (const quad *)number;
}

/* The lower triangles of the Hessians, row by row. */
inlined void find_hessians_in(const struct batch *batch, double ret[45][LANES])
{
    const quad area = *lanes(batch->area), *s = lanes(batch->stress[0]), *grad = lanes(batch->grad[0]);
    const quad d11 = *lanes(batch->d11), d12 = *lanes(batch->d12), d22 = *lanes(batch->d22),
               d33 = *lanes(batch->d33), *fu = lanes(batch->fu[0]), *fv = lanes(batch->fv[0]);
    quad B[3][9], DB[3][9], *H = (quad *)ret[0];
    for (int a = 0; a < 3; a++)
        for (int d = 0; d < 3; d++) {
            B[0][3 * a + d] = fu[d] * grad[2 * a];
            B[1][3 * a + d] = fv[d] * grad[2 * a + 1];
            B[2][3 * a + d] = fu[d] * grad[2 * a + 1] + fv[d] * grad[2 * a];
        }
    for (int i = 0; i < 9; i++) {
        DB[0][i] = area * (d11 * B[0][i] + d12 * B[1][i]);
        DB[1][i] = area * (d12 * B[0][i] + d22 * B[1][i]);
        DB[2][i] = area * d33 * B[2][i];
    }
    for (int i = 0; i < 9; i++)
        for (int j = 0; j <= i; j++)
            H[i * (i + 1) / 2 + j] = B[0][i] * DB[0][j] + B[1][i] * DB[1][j] + B[2][i] * DB[2][j];
    for (int a = 0; a < 3; a++)
        for (int b = 0; b <= a; b++) {
            const quad *ga = grad + 2 * a, *gb = grad + 2 * b;
            quad geometric =
                area * (ga[0] * (s[0] * gb[0] + s[2] * gb[1]) + ga[1] * (s[2] * gb[0] + s[1] * gb[1]));
            for (int d = 0; d < 3; d++)
                H[(3 * a + d) * (3 * a + d + 1) / 2 + 3 * b + d] += geometric;
        }
}

#ifdef __x86_64__
__attribute__((target("avx2"))) static void find_hessians_fast(const struct batch *batch,
                                                               double ret[45][LANES])
{
    find_hessians_in(batch, ret);
}
#endif

/* The same bytes either way. */
static void find_hessians(const struct batch *batch, double ret[45][LANES])
{
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx2")) {
        find_hessians_fast(batch, ret);
        return;
    }
#endif
    find_hessians_in(batch, ret);
}

inlined void hessian_loop(const struct dr_stretch *stretch, const double *x, const double *stress,
                          double compression, struct dr_matrix *A, const bool curved)
{
    size_t triangles = stretch->mesh->triangles;
    struct batch batch = {0};
    for (size_t t = 0; t < triangles; t += LANES) {
        size_t count = triangles - t < LANES ? triangles - t : LANES;
        double H[45][LANES];
        for (size_t k = 0; k < count; k++)
            fill_lane(stretch, t + k, x, stress, compression, &batch, k, curved);
        find_hessians(&batch, H);
        dr_matrix_add_triangles(A, t, count, (const double(*)[LANES])H);
    }
}

apart void curved_hessian(const struct dr_stretch *stretch, const double *x, const double *stress,
                          double compression, struct dr_matrix *A)
{
    hessian_loop(stretch, x, stress, compression, A, true);
}

void dr_stretch_hessian(const struct dr_stretch *stretch, const double *x, const double *stress,
                        double compression, struct dr_matrix *A)
{
    if (stretch->curve)
        curved_hessian(stretch, x, stress, compression, A);
    else
        hessian_loop(stretch, x, stress, compression, A, false);
}

/* S_-(p) = (S - its tensile part) grad p, plus F D_- B p with D_- the negative tangents. */
inlined void left_out_loop(const struct dr_stretch *stretch, const double *x, const double *stress,
                           const double *p, double *q, const bool curved)
{
    const struct dr_mesh *mesh = stretch->mesh;
    for (size_t t = 0; t < mesh->triangles; t++) {
        const double *grad = mesh->grad + 6 * t, *all = stress + 3 * t;
        double area = mesh->area[t], pu[3], pv[3], hu[3], hv[3], s[3] = {all[0], all[1], all[2]};
        tensile_part(s);
        for (int k = 0; k < 3; k++)
            s[k] = all[k] - s[k];
        gradient_of(mesh, t, p, pu, pv);
        for (int d = 0; d < 3; d++) {
            hu[d] = s[0] * pu[d] + s[2] * pv[d];
            hv[d] = s[2] * pu[d] + s[1] * pv[d];
        }
        if (curved) {
            double fu[3], fv[3], e[3], step[3] = {0, 0, 0}, with[3], without[3], unused[3];
            struct elasticity D;
            gradient_of(mesh, t, x, fu, fv);
            green_strain(fu, fv, e);
            add_strain_step(mesh, t, fu, fv, p, step);
            curve_response(stretch, mesh->material[t], e, 1, unused, &D);
            stress_of(&D, step, with);
            curve_response(stretch, mesh->material[t], e, 0, unused, &D);
            stress_of(&D, step, without);
            for (int k = 0; k < 3; k++)
                with[k] -= without[k];
            for (int d = 0; d < 3; d++) {
                hu[d] += with[0] * fu[d] + with[2] * fv[d];
                hv[d] += with[2] * fu[d] + with[1] * fv[d];
            }
        }
        for (size_t a = 0; a < 3; a++)
            for (size_t d = 0; d < 3; d++)
                q[3 * (size_t)mesh->triangle[3 * t + a] + d] +=
                    area * (hu[d] * grad[2 * a] + hv[d] * grad[2 * a + 1]);
    }
}

apart void curved_left_out(const struct dr_stretch *stretch, const double *x, const double *stress,
                           const double *p, double *q)
{
    left_out_loop(stretch, x, stress, p, q, true);
}

void dr_stretch_left_out(const struct dr_stretch *stretch, const double *x, const double *stress,
                         const double *p, double *q)
{
    if (stretch->curve)
        curved_left_out(stretch, x, stress, p, q);
    else
        left_out_loop(stretch, x, stress, p, q, false);
}

inlined double second_order_loop(const struct dr_stretch *stretch, const double *x, const double *w,
                                 double *ret_strain, const bool curved)
{
    const struct dr_mesh *mesh = stretch->mesh;
    long double sum = 0;
    double largest = 0;
    for (size_t t = 0; t < mesh->triangles; t++) {
        struct elasticity D = stretch->elasticity[mesh->material[t]];
        double wu[3], wv[3], s[3];
        gradient_of(mesh, t, w, wu, wv);
        if (curved) {
            double fu[3], fv[3], e[3];
            gradient_of(mesh, t, x, fu, fv);
            green_strain(fu, fv, e);
            curve_response(stretch, mesh->material[t], e, 0, s, &D);
        }
        double e2[3] = {0.5 * dot(wu, wu), 0.5 * dot(wv, wv), dot(wu, wv)};
        stress_of(&D, e2, s);
        sum += 0.5 * mesh->area[t] * (s[0] * e2[0] + s[1] * e2[1] + s[2] * e2[2]);
        largest = fmax(largest, fmax(e2[0], e2[1]));
    }
    *ret_strain = largest;
    return (double)sum;
}

apart double curved_second_order(const struct dr_stretch *stretch, const double *x, const double *w,
                                 double *ret_strain)
{
    return second_order_loop(stretch, x, w, ret_strain, true);
}

double dr_stretch_second_order(const struct dr_stretch *stretch, const double *x, const double *w,
                               double *ret_strain)
{
    return stretch->curve ? curved_second_order(stretch, x, w, ret_strain)
                          : second_order_loop(stretch, x, w, ret_strain, false);
}
