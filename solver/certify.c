/* certify.c - carries a drape at rest on to round-off, and proves that it is a strict local minimum.
 *
 * Newton on the true Hessian H, bodies included, shifted by mu M where H is not positive definite:
 * (H + mu M) w = f. There the lowest mode of H w.r.t. M, by inverse iteration with the same factor, is a
 * direction of negative curvature: the cloth is pushed along it as far as the energy falls. A push that ends
 * away from rest is handed back to the job's method, which drapes on from there. A factor serves for as long
 * as each step with it is a tenth of the one before.
 *
 * The proof. Cholesky running to its end on H - c I in floating point proves H positive definite when c is
 * at least g/(1 - g) tr(H), g = n u/(1 - n u), with n two more than the widest row of the factor and u the
 * unit round-off (Rump, "Verification of positive definiteness", BIT 46, 2006, theorem 2.3): the Hessian as
 * assembled at the positions as stored. Tried first on H - lambda/2 M - c I, lambda the lowest mode's
 * curvature, which bounds how slowly anything can swing about the rest state. */
#include "certify.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"

#define MOST_STEPS   100 /* factors tried at one state at rest */
#define MOST_ESCAPES 20  /* along negative curvature, in all */
#define MOST_POWERS  60  /* of inverse iteration */
#define MOST_LANCZOS 40
#define SETTLED      1e-4  /* change of the curvature by one of those steps, relative, that ends them */
#define CHORD        0.1   /* of the move before, up to which a factor serves another step */
#define ROUND_OFF    1e-12 /* of an edge: smaller moves are nothing else */
#define FIRST_SHIFT  10.0  /* 1/s^2: swings of two seconds */
#define MOST_SHIFT   1e20
#define NOISE        1e-12 /* of the energies' size: differences below this say nothing */
#define FIRST_PUSH   0.01  /* of an edge */
#define MOST_TRIALS  30    /* along one direction */

#define TOO_LITTLE_TIME "the time limit leaves too little for the certificate"

struct polish {
    struct dr_state *s;
    drape_certificate *certificate;
    double shift;  /* mu, 1/s^2 */
    double before; /* m: the last move by an unshifted step; INFINITY: none */
    unsigned
        used; /* steps in a row with the factor at hand, of H where the first began; 0: a new one is due */
    bool escaped;
};

static double size_of(const drape_energies *e)
{
    return e->stretch + e->bend + e->contact + fabs(e->gravity);
}

static double largest_move(const struct dr_state *s)
{
    double largest = 0;
    for (size_t i = 0; i < s->cloth->mesh->nodes; i++) {
        const double *w = s->w + 3 * i;
        largest = fmax(largest, sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]));
    }
    return largest;
}

/* The legs of as many equal right-angled triangles, m. */
static double mean_leg(const struct dr_mesh *mesh)
{
    return sqrt(2 * dr_mesh_area(mesh) / (double)mesh->triangles);
}

/* Makes x + w the state. */
static void go(struct dr_state *s, const drape_energies *energy)
{
    size_t bytes = 3 * s->cloth->mesh->nodes * sizeof *s->x;
    memcpy(s->x, s->x_next, bytes);
    memcpy(s->f, s->f_next, bytes);
    s->row.energy = *energy;
    s->row.energy.kinetic = 0;
    s->row.residual_force = dr_cloth_largest_force(s->cloth, s->f) / s->weight;
}

static double look(struct dr_state *s, const double *direction, double scale, drape_energies *ret)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    for (size_t i = 0; i < count; i++)
        s->x_next[i] = s->x[i] + scale * direction[i];
    return dr_cloth_energy(s->cloth, s->x_next, ret, s->f_next);
}

/* The same random numbers in -1 to 1 each time, zero on held nodes. */
static void shuffle(const struct dr_mesh *mesh, double *d)
{
    uint64_t random = 1;
    for (size_t i = 0; i < 3 * mesh->nodes; i++) {
        random = random * 6364136223846793005u + 1442695040888963407u;
        d[i] = mesh->held[i / 3] ? 0 : (double)(random >> 11) * 0x1p-52 - 1;
    }
}

/* The lowest mode of H: the curvature *ret_lambda (1/s^2) and, in s->best, its shape d with d.Md = 1. The
 * matrix in factor is H + mu M. */
static drape_status lowest_mode(struct polish *p, double *ret_lambda, drape_error *reterr)
{
    struct dr_state *s = p->s;
    const struct dr_mesh *mesh = s->cloth->mesh;
    double *d = s->best, *Md = s->x_next, *y = s->f_next, lambda = INFINITY, scale = 1;
    shuffle(mesh, d);
    for (int power = 0; power < MOST_POWERS; power++) {
        for (size_t i = 0; i < 3 * mesh->nodes; i++)
            Md[i] = mesh->mass[i / 3] * d[i] * scale;
        drape_status status = dr_state_solve(s, 1, (const double *[]){Md}, (double *[]){y}, reterr);
        if (status < 0)
            return status;
        long double yMy = 0;
        for (size_t i = 0; i < 3 * mesh->nodes; i++)
            yMy += mesh->mass[i / 3] * y[i] * y[i];
        double now = (double)(dr_state_dot(s, y, Md) / yMy) - p->shift; /* y.Hy/y.My, as (H + mu M)y = Md */
        bool settled = power > 2 && fabs(now - lambda) <= 1e-6 * fabs(now);
        lambda = now;
        scale = (double)(1 / sqrtl(yMy));
        memcpy(d, y, 3 * mesh->nodes * sizeof *d);
        if (settled)
            break;
    }
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        d[i] *= scale;
    *ret_lambda = lambda;
    return DRAPE_OK;
}

/* How many eigenvalues of the symmetric tridiagonal matrix are greater than theta (Sturm's sequence). */
static unsigned count_above(const double *diagonal, const double *beside, unsigned n, double theta)
{
    double pivot = 1;
    unsigned count = 0;
    for (unsigned i = 0; i < n; i++) {
        pivot = diagonal[i] - theta - (i ? beside[i - 1] * beside[i - 1] / pivot : 0);
        if (pivot == 0)
            pivot = 1e-300;
        count += pivot > 0;
    }
    return count;
}

/* Its largest, all being positive, by bisection. */
static double largest_of(const double *diagonal, const double *beside, unsigned n)
{
    double low = 0, high = 0;
    for (unsigned i = 0; i < n; i++)
        high = fmax(high, diagonal[i] + (i ? beside[i - 1] : 0) + (i + 1 < n ? beside[i] : 0));
    for (int k = 0; k < 52; k++) {
        double middle = 0.5 * (low + high);
        *(count_above(diagonal, beside, n, middle) ? &low : &high) = middle;
    }
    return high;
}

/* The lowest curvature of H, whose factor is at hand, alone: by Lanczos' method on H^-1 M, which needs a
 * fifth of the solves that inverse iteration does where modes crowd. From above. */
static drape_status lowest_curvature(struct dr_state *s, double *ret_lambda, drape_error *reterr)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    size_t count = 3 * mesh->nodes;
    double *d = s->best, *before = s->x_next, *y = s->f_next, *Md = s->w;
    double diagonal[MOST_LANCZOS], beside[MOST_LANCZOS], theta = 0;
    shuffle(mesh, y);
    memset(d, 0, count * sizeof *d);
    for (unsigned k = 0; k < MOST_LANCZOS; k++) {
        long double yMy = 0;
        for (size_t i = 0; i < count; i++)
            yMy += mesh->mass[i / 3] * y[i] * y[i];
        double norm = sqrt((double)yMy), last = theta;
        if (!(norm > 0))
            break;
        if (k)
            beside[k - 1] = norm;
        for (size_t i = 0; i < count; i++) {
            before[i] = d[i];
            d[i] = y[i] / norm;
            Md[i] = mesh->mass[i / 3] * d[i];
        }
        drape_status status = dr_state_solve(s, 1, (const double *[]){Md}, (double *[]){y}, reterr);
        if (status < 0)
            return status;
        diagonal[k] = dr_state_dot(s, y, Md);
        for (size_t i = 0; i < count; i++)
            y[i] -= diagonal[k] * d[i] + (k ? norm * before[i] : 0);
        theta = largest_of(diagonal, beside, k + 1);
        if (k > 2 && theta - last <= SETTLED * theta)
            break;
    }
    *ret_lambda = 1 / theta;
    return DRAPE_OK;
}

/* As far along the direction in s->best as the energy falls, downhill first. False: nowhere. */
static bool push(struct dr_state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    size_t count = 3 * mesh->nodes;
    drape_energies energy;
    double longest = 0, noise = NOISE * size_of(&s->row.energy), lowest = s->row.energy.potential - noise;
    for (size_t i = 0; i < count; i++)
        longest = fmax(longest, fabs(s->best[i]));
    double first = FIRST_PUSH * mean_leg(mesh) / longest, found = 0;
    first = copysign(first, dr_state_dot(s, s->f, s->best));
    for (int side = 0; side < 2 && found == 0; side++, first = -first) {
        double scale = first;
        for (int trial = 0; trial < MOST_TRIALS; trial++) {
            double potential = look(s, s->best, scale, &energy);
            if (potential < lowest) {
                lowest = potential;
                found = scale;
                scale *= 2;
            } else if (found != 0 || trial > MOST_TRIALS / 2) {
                break;
            } else {
                scale /= 2;
            }
        }
    }
    if (found == 0)
        return false;
    for (size_t i = 0; i < count; i++)
        s->w[i] = found * s->best[i];
    dr_state_limit(s);
    double before = s->row.energy.potential;
    if (!(look(s, s->w, 1, &energy) < before)) /* a body cut it short */
        return false;
    go(s, &energy);
    return true;
}

/* H has a mode of negative curvature: pushes the cloth along it. */
static drape_status escape(struct polish *p, drape_error *reterr)
{
    struct dr_state *s = p->s;
    double lambda;
    drape_status status = lowest_mode(p, &lambda, reterr);
    if (status < 0)
        return status;
    if (lambda >= 0 || !push(s)) {
        p->certificate->reason = "round-off hides the sign of the Hessian's lowest curvature";
        return DRAPE_OK;
    }
    p->certificate->escapes++;
    p->certificate->curvature = fmin(p->certificate->curvature, lambda);
    p->before = INFINITY;
    p->escaped = s->row.residual_force > s->sim->options.tolerance;
    return DRAPE_OK;
}

/* Takes the step s->w as far as the energy does not rise; false: not at all. Near the end differences of
 * energies are noise, and the step is as good as its model. */
static bool descend(struct dr_state *s, double predicted)
{
    drape_energies energy;
    double size = size_of(&s->row.energy), here = s->row.energy.potential;
    dr_state_limit(s);
    for (double scale = 1; scale > 1e-6; scale /= 2) {
        double there = look(s, s->w, scale, &energy);
        if (there <= here + (predicted < NOISE * size ? NOISE * size : 0)) {
            go(s, &energy);
            return true;
        }
    }
    return false;
}

static drape_status factorise(struct polish *p, double shift, bool *ret_definite, drape_error *reterr)
{
    struct dr_state *s = p->s;
    dr_cloth_stress(s->cloth, s->x, NULL);
    dr_matrix_set_base(s->cloth->A, shift);
    return dr_state_factorise(s, 1, ret_definite, reterr);
}

/* Whether H - bound M is positive definite beyond round-off. */
static drape_status is_above(struct dr_state *s, double bound, enum dr_factored *ret, drape_error *reterr)
{
    struct dr_matrix *A = s->cloth->A;
    dr_cloth_stress(s->cloth, s->x, NULL);
    dr_matrix_set_base(A, -bound);
    drape_status status = dr_cloth_assemble(s->cloth, s->x, 1, reterr);
    if (status < 0)
        return status;
    dr_matrix_lower_by_round_off(A);
    return dr_sim_factorise(s->sim, s->cloth, ret, reterr);
}

/* The factor of H succeeded and Newton has converged: is H positive definite beyond round-off? */
static drape_status prove(struct polish *p, drape_error *reterr)
{
    struct dr_state *s = p->s;
    double lambda;
    enum dr_factored factored = DR_NOT_DEFINITE;
    drape_status status = lowest_curvature(s, &lambda, reterr);
    p->certificate->reason = "positive definite, but too little to prove it beside round-off";
    for (int attempt = 0; status >= 0 && attempt < 2 && factored == DR_NOT_DEFINITE; attempt++) {
        p->certificate->curvature = attempt ? 0 : 0.5 * lambda;
        status = is_above(s, p->certificate->curvature, &factored, reterr);
    }
    p->certificate->certified = status >= 0 && factored == DR_FACTORED;
    if (factored == DR_NO_TIME)
        p->certificate->reason = TOO_LITTLE_TIME;
    if (p->certificate->certified)
        p->certificate->reason = "a strict local minimum: the Hessian is positive definite beyond round-off";
    return status;
}

/* One factor, and what follows from it; sets the reason when there is nothing more to do. */
static drape_status step(struct polish *p, drape_error *reterr)
{
    struct dr_state *s = p->s;
    drape_certificate *certificate = p->certificate;
    bool definite = true;
    unsigned used = p->used;
    drape_status status = used ? DRAPE_OK : factorise(p, p->shift, &definite, reterr);
    p->used = 0;
    if (status < 0)
        return status;
    if (s->gave_up) {
        certificate->reason = TOO_LITTLE_TIME;
        s->gave_up = NULL; /* the rest that was found is not touched by that */
        return DRAPE_OK;
    }
    if (!definite) {
        p->shift = p->shift > 0 ? 4 * p->shift : FIRST_SHIFT;
        if (p->shift > MOST_SHIFT)
            certificate->reason = "the Hessian could not be factorised";
        return DRAPE_OK;
    }
    status = dr_state_solve(s, 1, (const double *[]){s->f}, (double *[]){s->w}, reterr);
    if (status < 0)
        return status;
    double move = largest_move(s), left = 0.5 * dr_state_dot(s, s->f, s->w), shift = p->shift;
    if (shift == 0) {
        certificate->largest_move = move;
        certificate->energy_left = left;
        bool ended = !used || move <= ROUND_OFF * mean_leg(s->cloth->mesh); /* else its factor is to blame */
        if (left <= 1e-14 * size_of(&s->row.energy) && move > 0.5 * p->before && ended)
            return prove(p, reterr);
        if (!used || move <= CHORD * p->before)
            p->used = used + 1;
        p->before = move;
    }
    certificate->steps++;
    bool moved = descend(s, left);
    if (!moved)
        p->used = 0;
    if (shift > 0 && (!moved || left <= 1e-9 * size_of(&s->row.energy))) {
        status = escape(p, reterr);
        p->shift = 0;
    } else if (!moved) {
        p->shift = FIRST_SHIFT;
    } else {
        p->shift = shift > FIRST_SHIFT ? shift / 4 : 0;
    }
    return status;
}

static drape_status polish(struct polish *p, drape_error *reterr)
{
    struct dr_state *s = p->s;
    drape_certificate *certificate = p->certificate;
    drape_status status = DRAPE_OK;
    for (int n = 0; status >= 0 && !certificate->reason && !p->escaped; n++) {
        dr_sim_tell(s->sim, &(drape_progress){DRAPE_PHASE_CERTIFYING, s->row, s->sim->report.stops, 0});
        if (dr_sim_interrupted(s->sim))
            certificate->reason = atomic_load(&s->sim->cancelled) ? "cancelled" : "the time limit ran out";
        else if (n == MOST_STEPS)
            certificate->reason = "Newton's method did not come down to round-off";
        else if (certificate->escapes == MOST_ESCAPES)
            certificate->reason = "negative curvature again and again";
        else
            status = step(p, reterr);
    }
    return status;
}

/* A cloth with the Cholesky matrix of the whole Hessian: the method's own, or for methods that have none
 * another; the one it replaces is kept. */
static drape_status lend_matrix(struct dr_state *s, struct dr_cloth **ret_own, drape_error *reterr)
{
    struct dr_cloth_plan plan = s->sim->plan.welded;
    *ret_own = s->cloth;
    if (s->method->matrix == DR_MATRIX_CHOLESKY || s->method->matrix == DR_MATRIX_PRECONDITIONER)
        return dr_cloth_make_exact(s->cloth, true, reterr);
    plan.matrix = DR_MATRIX_CHOLESKY;
    plan.friction = plan.self = false;
    drape_status status = dr_cloth_new(&plan, s->cloth->start, &s->cloth, reterr);
    if (status >= 0) { /* the anchors are the method's */
        s->cloth->friction = (*ret_own)->friction;
        s->cloth->self = (*ret_own)->self;
    }
    return status;
}

static void take_back(struct dr_state *s, struct dr_cloth *own)
{
    size_t bytes[DR_TERMS] = {0}, held = 3 * own->mesh->nodes * sizeof(double);
    if (s->cloth != own) {
        s->cloth->friction = NULL;
        s->cloth->self = NULL;
        dr_cloth_bytes(s->cloth, bytes);
        dr_cloth_free(s->cloth);
    }
    for (int t = 0; t < DR_TERMS; t++)
        held += bytes[t];
    s->cloth = own;
    dr_state_hold(s, DRAPE_PHASE_CERTIFYING, held);
}

/* What the certificate took is its own affair: the method's counts and times stay the method's. */
static void account(struct drape_sim *sim, double began, const double stage[DR_STAGES], uint32_t factors,
                    uint32_t solves, drape_work work)
{
    memcpy(sim->stage, stage, sizeof sim->stage);
    sim->stage[DR_STAGE_CERTIFY] += dr_clock() - began;
    sim->report.certificate.factorizations += sim->report.factorizations - factors;
    sim->report.factorizations = factors;
    sim->report.solves = solves;
    sim->report.work = work;
}

drape_status dr_certify(struct dr_state *s, bool *ret_escaped, drape_error *reterr)
{
    struct drape_sim *sim = s->sim;
    struct polish p = {.s = s, .certificate = &sim->report.certificate, .before = INFINITY};
    size_t bytes = 3 * s->cloth->mesh->nodes * sizeof(double);
    uint32_t factors = sim->report.factorizations, solves = sim->report.solves;
    drape_work work = sim->report.work;
    double began = dr_clock(), stage[DR_STAGES];
    struct dr_cloth *own;
    memcpy(stage, sim->stage, sizeof stage);

    double *rest = malloc(bytes); /* where the method came to rest */
    drape_row row = s->row;
    drape_status status = rest ? lend_matrix(s, &own, reterr) : dr_out_of_memory(reterr);
    if (status < 0)
        goto cleanup;
    memcpy(rest, s->x, bytes);
    status = polish(&p, reterr);
    if (p.escaped && s->row.iteration == sim->options.max_iterations) {
        p.certificate->reason = "the iterations ran out below a saddle";
        p.escaped = false;
    }
    take_back(s, own);
    if (status >= 0 && p.escaped && s->method->matrix == DR_MATRIX_PRECONDITIONER)
        status = dr_cloth_make_exact(s->cloth, false, reterr);
    account(sim, began, stage, factors, solves, work);
    s->row.factorizations = row.factorizations;
    if (status >= 0 && !p.escaped && s->row.residual_force > sim->options.tolerance) {
        memcpy(s->x, rest, bytes); /* lower, but on its way */
        s->row = row;
    }
    if (p.certificate->certified)
        s->row.residual_energy = p.certificate->energy_left;
    *ret_escaped = p.escaped;

cleanup:
    free(rest);
    return status;
}
