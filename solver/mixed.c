/* mixed.c - the fast way to rest: a regularised Newton method with predicted stress.
 *
 * Each iteration solves (M/h^2 + H) w = f and moves by w; h is a regularisation, not a time, and there are
 * no velocities. Three things make it fast, each the cure of one delay:
 *
 *  1. The geometric stiffness uses the stress S = D(e(x) + B(x)w) that the last linear step predicted, not
 *     D e(x + w), whose second-order strain would lock every rotation of stiff cloth. This is Newton on
 *     displacements and stresses (Hellinger-Reissner) with the stresses condensed out, the
 *     mixed-integration-point Newton of the shell literature (Magisano, Leonetti, Garcea).
 *  2. H is the true Hessian, whose compressive stress makes wrinkles move in whole steps and the end
 *     quadratic, wherever the last step was smooth. It is factorised where it is positive definite. Elsewhere
 *     its positive semi-definite part H+ is, and conjugate gradients with that factor go from H+ to H: a few
 *     back-solves, no further factor. Negative curvature among them is the way off a saddle, and is followed
 *     as far as the step may turn the cloth (Steihaug, SIAM J. Numer. Anal. 20, 1983). What is factorised
 *     has hinges in the place of bending (bend.h), at a third of the operations, and that in single precision
 *     (front.h); conjugate gradients put that right, too, and where they meet negative curvature H was not
 *     positive definite.
 *  3. A step is judged by the decrease of energy without the known second-order stretch Q of the step, so
 *     that the energy may peak on the way and the following steps remove it.
 *
 * With bodies three more:
 *
 *  4. The step looks at the gaps that it closes or opens (gap.h) by Newton's method on the model, conjugate
 *     gradients with the same factor; steps are scaled down as a whole to what the model holds, and
 *     friction's anchors are renewed at every other state. Without that new contacts come as a surprise,
 *     steps are refused and h collapses. Gaps between parts of the cloth are seen alike, and the step is also
 *     scaled down to what takes no part through another (sweep.h); where that is next to nothing, only the
 *     nodes that would go through are held back.
 *  5. The false stretch Q that a step makes is taken out at once where it matters, by one or two Newton steps
 *     from where it led, with the semi-definite Hessian there. Else every other iteration does nothing but
 *     that. This is the second-order correction of constrained optimisation (Nocedal and Wright, Numerical
 *     optimization, 2006, section 18.3); after it the energy itself may tell that the step was good.
 *  6. Once the true Hessian is positive definite, each of its factors serves several steps, friction's
 *     anchors renewed between them.
 *
 * A watchdog goes back to the best state when nothing has improved for long; the third time stop-and-go
 * takes over. Constants: found on 22 scenes (squares, skirts, arcs, folds, noise; 10 to 10 000 N/m) at first
 * h of 5, 20 and 50 ms; `make bench-methods` runs them. */
#include <math.h>
#include <string.h>

#include "state.h"

#define FIRST_H_MIN   0.005 /* s: the job's time step, held to this range, is the first h */
#define FIRST_H_MAX   0.05
#define H_MAX         0.2 /* s, about sqrt(height/g); free once the whole true Hessian is positive definite; */
#define H_MAX_BODIES  0.4  /* with bodies steps are scaled down besides */
#define GROWTH        2    /* of h after a step that the model foresaw */
#define SMOOTH        0.02 /* strain of the last step below which the true Hessian is used */
#define GOOD_FIT      0.25 /* actual over predicted decrease */
#define BAD_FIT       (-2.0)
#define MOST_REJECTED 4    /* steps in a row; then one is taken as it is */
#define WAIT          2    /* iterations, this one included, without Cholesky on H after it failed */
#define MOST_CG       20   /* conjugate gradient steps */
#define CG_PRECISION  0.03 /* of the preconditioned residual, relative */
#define MOST_PRECISE  100  /* likewise where nothing but bending is left out of the factor */
#define PRECISE       1e-4
#define FLAT          1e-3 /* curvature along a direction, relative to that of H+, that counts as negative */
#define FIRST_LIMIT   0.05 /* strain at which a corrected step is cut: the threads turn by 0.3 rad */
#define WORTH         100 /* false stretch over predicted decrease: the next step leaves about 1/100 of it; */
#define WORTH_BODIES  10  /* with bodies the corrections, which are cheaper, leave about a tenth */
#define LIMIT_MIN     1e-5
#define LIMIT_MAX     0.1
#define LIMIT_FIT     0.5 /* fit of a cut step from which the limit grows */
#define PATIENCE      60  /* iterations without a better state until the watchdog bites */
#define CAUTIOUS      20  /* iterations with H+ alone after it */
#define MOST_BITES    3
#define MOST_ATTEMPTS 8    /* at a factor */
#define WORTH_SHARING 8000 /* triangles: a product takes longer than waking somebody */
#define MOST_NOISY    8    /* Newton steps in a row whose decrease is below round-off; */
#define NOISY_GAIN    2    /* they divide the force by more, or that is round-off, too */

/* With bodies */
#define MOST_ROUNDS    3    /* of looking again at which gaps the step closes */
#define MOST_TOUCH     20   /* conjugate gradient steps of a round */
#define PRECISE_BODIES 1e-2 /* instead of PRECISE */
#define GAP_PRECISION  0.3  /* of the preconditioned residual, relative to that of the whole force */
#define LONGEST_MOVE   0.05 /* m; a longer step is scaled down as a whole */
#define MOST_STRAIN    0.5  /* likewise */
#define MOST_TRUE      0.25 /* likewise, of a step with the true Hessian */
#define MOST_HALVINGS  20   /* of a step that the model says climbs */
#define LOCKED         0.1  /* part of a step that the cloth allows; below, single nodes are held */
#define MOST_TURN      0.6  /* rad: of a corrected step, while its gaps are looked at */
#define MOST_FALSE     30 /* false stretch over predicted decrease of a corrected step; beyond it is trimmed */
#define MOST_TRIMS     4

/* Of the second-order correction */
#define FALSE_PART  0.02 /* of false stretch in what was gained, up to which there is nothing to correct */
#define MOST_PASSES 2
#define MOST_TRIES  3 /* whole, halved, halved again */

#define MOST_CHORDS 5 /* steps with the factor of the true Hessian at hand, after the one it was made for */

/* The method's own arrays: residual of the quadratic model, direction p, A+ p, what the projection dropped,
 * times p; with bodies also the residual of the model with its gaps, the gaps' share of its product, where
 * the step began and the force there. */
enum {
    RESIDUAL,
    DIRECTION,
    KEPT,
    DROPPED,
    ARRAYS,
    TOUCHING = ARRAYS,
    GAPPED,
    START,
    START_FORCE,
    ARRAYS_WITH_BODIES
};

static double first_h(const struct dr_state *s)
{
    return fmin(fmax(s->sim->options.time_step, FIRST_H_MIN), FIRST_H_MAX);
}

static bool smooth(const struct dr_state *s)
{
    return !s->cautious && s->strain < SMOOTH && s->ratio > GOOD_FIT;
}

/* *ret_whole: the factor is that of the true Hessian. */
static drape_status factorise_true(struct dr_state *s, bool *ret_whole, drape_error *reterr)
{
    dr_matrix_set_base(s->cloth->A, 1 / (s->h * s->h));
    *ret_whole = false;
    if (!smooth(s) || s->wait || s->negative)
        return DRAPE_OK;
    return dr_state_factorise(s, 1, ret_whole, reterr);
}

/* The same of its positive semi-definite part. */
static drape_status factorise_part(struct dr_state *s, drape_error *reterr)
{
    for (int attempt = 0; attempt < MOST_ATTEMPTS; attempt++) {
        bool definite;
        drape_status status = dr_state_factorise(s, 0, &definite, reterr);
        if (status < 0 || definite || s->gave_up)
            return status;
        s->h /= 30; /* round-off made it indefinite: more mass, a shorter step */
        dr_matrix_set_base(s->cloth->A, 1 / (s->h * s->h));
    }
    s->gave_up = "the step matrix could not be factorised";
    return DRAPE_OK;
}

/* Whether a solution with the factor is not yet the model's. */
static bool lacks(const struct dr_state *s)
{
    return s->corrected || s->cloth->remainder || dr_matrix_is_single(s->cloth->A);
}

/* How far a move turns or stretches any thread: its largest gradient, a norm. */
static double turn(const struct dr_state *s, const double *move)
{
    double strain;
    dr_cloth_second_order(s->cloth, s->x, move, &strain);
    return sqrt(2 * strain);
}

/* For dr_hand_both: KEPT, the matrix times DIRECTION, and DROPPED, what it lacks of the model. */
static void multiply_half(void *data, int half)
{
    struct dr_state *s = data;
    const double *p = s->extra[DIRECTION];
    double *dropped = s->extra[DROPPED];
    if (half == 0) {
        dr_matrix_multiply(s->cloth->A, p, s->extra[KEPT]);
        return;
    }
    memset(dropped, 0, 3 * s->cloth->mesh->nodes * sizeof *dropped);
    if (s->corrected)
        dr_cloth_left_out(s->cloth, s->x, p, dropped);
    dr_cloth_add_remainder(s->cloth, p, dropped);
}

/* Curvature of the model along DIRECTION, and *ret_kept of the matrix alone; leaves KEPT and DROPPED. */
static double curvature(struct dr_state *s, double *ret_kept)
{
    const double *p = s->extra[DIRECTION];
    bool shared = s->cloth->mesh->triangles >= WORTH_SHARING && (s->corrected || s->cloth->remainder);
    dr_hand_both(shared ? &s->sim->hand : NULL, multiply_half, s);
    *ret_kept = dr_state_dot(s, p, s->extra[KEPT]);
    return *ret_kept + dr_state_dot(s, p, s->extra[DROPPED]);
}

/* w += length p, RESIDUAL with it. */
static void go_along(struct dr_state *s, double length)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    for (size_t i = 0; i < 3 * mesh->nodes; i++) {
        if (mesh->held[i / 3])
            continue;
        s->w[i] += length * s->extra[DIRECTION][i];
        s->extra[RESIDUAL][i] -= length * (s->extra[KEPT][i] + s->extra[DROPPED][i]);
    }
}

/* DIRECTION conjugate to the last one, from z, what the factor makes of the residual. */
static void next_direction(struct dr_state *s, const double *z, double beta)
{
    double *p = s->extra[DIRECTION];
    for (size_t i = 0; i < 3 * s->cloth->mesh->nodes; i++)
        p[i] = z[i] + beta * p[i];
}

/* How far to go along DIRECTION, `most` or a half, a quarter... of it, down to `least`: a false stretch of
 * more than the decrease is worth would undo it. `slope` is what the model gains per length there. */
static double worthwhile(struct dr_state *s, double most, double least, double slope, double curved)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    double *end = s->x_next, strain; /* free until the move */
    double worth = s->gaps ? WORTH_BODIES : WORTH;
    double so_far = 0.5 * (dr_state_dot(s, s->f, s->w) + dr_state_dot(s, s->extra[RESIDUAL], s->w));
    for (; most > least; most /= 2) {
        for (size_t i = 0; i < count; i++)
            end[i] = s->w[i] + most * s->extra[DIRECTION][i];
        double decrease = so_far + most * (slope - 0.5 * most * curved);
        if (dr_cloth_second_order(s->cloth, s->x, end, &strain) <= worth * decrease)
            return most;
    }
    return least;
}

/* From w = P^-1 f, with P factorised, towards A^-1 f of the model: conjugate gradients on A, preconditioned
 * by P, which is A in single precision but for bending (see dr_cloth_add_remainder) and, where the step is to
 * be corrected, made with H+ in the place of the true Hessian. They end where precise enough or on negative
 * curvature; those of a corrected step also where it would turn a thread past the limit, up to which negative
 * curvature is followed then. The first step of these is never cut below P^-1 f. */
static drape_status correct(struct dr_state *s, drape_error *reterr)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    double *r = s->extra[RESIDUAL], *p = s->extra[DIRECTION], *z = s->x_next; /* free until the move */
    double precise = s->gaps ? PRECISE_BODIES : PRECISE, precision = s->corrected ? CG_PRECISION : precise;
    int steps = s->corrected ? MOST_CG : MOST_PRECISE;
    memcpy(r, s->f, count * sizeof *r);
    memcpy(p, s->w, count * sizeof *p);
    memset(s->w, 0, count * sizeof *s->w);
    s->cut = s->negative = false;
    double rz = dr_state_dot(s, r, p), first = rz;
    for (int k = 0; k < steps && rz > precision * precision * first; k++) {
        if (k) {
            drape_status status = dr_state_solve(s, 1, (const double *[]){r}, (double *[]){z}, reterr);
            if (status < 0)
                return status;
            s->solves++;
            double last = rz;
            rz = dr_state_dot(s, r, z);
            if (!(rz > precision * precision * first))
                break;
            next_direction(s, z, rz / last);
        }
        double along, curved = curvature(s, &along), most = INFINITY;
        if (s->corrected)
            most = fmax((sqrt(2 * s->limit) - turn(s, s->w)) / turn(s, p), k ? 0 : 1);
        s->negative = curved <= FLAT * along;
        if (s->negative && !s->corrected)
            break;
        s->cut = s->negative || rz > most * curved;
        if (s->cut)
            most = worthwhile(s, most, k ? most / 1024 : 1, rz, curved);
        go_along(s, s->cut ? most : rz / curved);
        if (s->cut)
            break;
    }
    return DRAPE_OK;
}

/* w and RESIDUAL of the model with the factor at hand. */
static drape_status solve_model(struct dr_state *s, drape_error *reterr)
{
    drape_status status = dr_state_solve(s, 1, (const double *[]){s->f}, (double *[]){s->w}, reterr);
    s->solves++;
    s->row.residual_energy = 0.5 * dr_state_dot(s, s->f, s->w);
    s->cut = false;
    if (status >= 0 && lacks(s))
        return correct(s, reterr);
    memset(s->extra[RESIDUAL], 0, 3 * s->cloth->mesh->nodes * sizeof(double));
    return status;
}

/* The step without regard to gaps: a factor, and what it makes of the force. */
static drape_status find_step(struct dr_state *s, drape_error *reterr)
{
    s->solves = 0;
    s->corrected = s->pivot_failed = false;
    bool tried = smooth(s) && !s->wait && !s->negative;
    drape_status status = factorise_true(s, &s->whole, reterr);
    if (status >= 0 && s->whole) {
        status = solve_model(s, reterr);
        s->whole = !s->negative;
    }
    if (status < 0 || s->whole || s->gave_up)
        return status;
    if (tried) {
        s->pivot_failed = true;
        s->wait = WAIT;
    }
    if (s->wait)
        s->wait--;
    status = factorise_part(s, reterr);
    if (status < 0 || s->gave_up)
        return status;
    s->corrected = smooth(s);
    return solve_model(s, reterr);
}

/* ---- contact ------------------------------------------------------------------------------------- */

/* TOUCHING = the residual f - Aw - grad X(w) of the model with its gaps. */
static void look_at_gaps(struct dr_state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    double *r = s->extra[TOUCHING], *surplus = s->extra[GAPPED];
    memset(surplus, 0, 3 * mesh->nodes * sizeof *surplus);
    s->surplus = dr_gaps_surplus(s->gaps, s->w, surplus);
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        r[i] = mesh->held[i / 3] ? 0 : s->extra[RESIDUAL][i] - surplus[i];
}

/* One step of conjugate gradients along DIRECTION on A + X''(w); false: there is no curvature that way, or it
 * goes as far as a corrected step may turn the cloth. */
static bool go_touching(struct dr_state *s, double rz)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    double *p = s->extra[DIRECTION], *kept = s->extra[KEPT], *dropped = s->extra[DROPPED],
           *gapped = s->extra[GAPPED], along, curved = curvature(s, &along);
    memset(gapped, 0, 3 * mesh->nodes * sizeof *gapped);
    dr_gaps_add_product(s->gaps, p, gapped);
    curved += dr_state_dot(s, p, gapped);
    if (!(curved > FLAT * along))
        return false;
    double length = rz / curved, most = INFINITY;
    if (s->corrected)
        most = fmax(0, (MOST_TURN - turn(s, s->w)) / turn(s, p));
    bool cut = length > most;
    if (cut)
        length = most;
    for (size_t i = 0; i < 3 * mesh->nodes; i++) {
        if (mesh->held[i / 3])
            continue;
        s->w[i] += length * p[i];
        s->extra[RESIDUAL][i] -= length * (kept[i] + dropped[i]);
        s->extra[TOUCHING][i] -= length * (kept[i] + dropped[i] + gapped[i]);
    }
    return !cut;
}

/* From TOUCHING and what the factor makes of it, DIRECTION, whose product with the residual is rz. */
static drape_status round_of_touch(struct dr_state *s, double rz, drape_error *reterr)
{
    double *r = s->extra[TOUCHING], *z = s->x_next;
    double enough = GAP_PRECISION * GAP_PRECISION * rz;
    for (int k = 0; k < MOST_TOUCH && rz > enough && go_touching(s, rz); k++) {
        drape_status status = dr_state_solve(s, 1, (const double *[]){r}, (double *[]){z}, reterr);
        if (status < 0)
            return status;
        s->solves++;
        double last = rz;
        rz = dr_state_dot(s, r, z);
        next_direction(s, z, rz / last);
    }
    return DRAPE_OK;
}

/* Newton's method on the model with its gaps, from the step w of the one without. */
static drape_status touch(struct dr_state *s, drape_error *reterr)
{
    drape_status status = dr_gaps_take(s->gaps, s->x, reterr);
    if (status < 0)
        return status;
    for (int round = 0; round < MOST_ROUNDS; round++) {
        look_at_gaps(s);
        status = dr_state_solve(s, 1, (const double *[]){s->extra[TOUCHING]},
                                (double *[]){s->extra[DIRECTION]}, reterr);
        if (status < 0)
            return status;
        s->solves++;
        double rz = dr_state_dot(s, s->extra[TOUCHING], s->extra[DIRECTION]);
        if (!(rz > 2 * GAP_PRECISION * GAP_PRECISION * s->row.residual_energy))
            return DRAPE_OK;
        status = round_of_touch(s, rz, reterr);
        if (status < 0)
            return status;
    }
    look_at_gaps(s);
    return DRAPE_OK;
}

/* What rounding may make of a difference of energies here, J. */
static double noise_of(const struct dr_state *s)
{
    const drape_energies *e = &s->row.energy;
    return 1e-13 * (e->stretch + e->bend + e->contact + fabs(e->gravity));
}

/* The model's decrease f.w - w'Hw/2 - X(w), with w'(M/h^2 + H)w = (f - r).w where r is the residual. */
static double predict(const struct dr_state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    long double inertia = 0;
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        inertia += mesh->mass[i / 3] * s->w[i] * s->w[i]; /* w is zero on held nodes */
    double left = dr_state_dot(s, s->extra[RESIDUAL], s->w);
    return 0.5 * (dr_state_dot(s, s->f, s->w) + left + (double)inertia / (s->h * s->h)) - s->surplus;
}

/* w and its residual, times `scale`. */
static void scale_step(struct dr_state *s, double scale)
{
    for (size_t i = 0; i < 3 * s->cloth->mesh->nodes; i++) {
        s->w[i] *= scale;
        s->extra[RESIDUAL][i] = scale * s->extra[RESIDUAL][i] + (1 - scale) * s->f[i];
    }
    look_at_gaps(s);
}

/* RESIDUAL and TOUCHING of a step that is not conjugate gradients' own. */
static void find_residual(struct dr_state *s)
{
    const struct dr_mesh *mesh = s->cloth->mesh;
    double *r = s->extra[RESIDUAL], *dropped = s->extra[DROPPED];
    memset(dropped, 0, 3 * mesh->nodes * sizeof *dropped);
    if (s->corrected)
        dr_cloth_left_out(s->cloth, s->x, s->w, dropped);
    dr_matrix_multiply(s->cloth->A, s->w, r);
    dr_cloth_add_remainder(s->cloth, s->w, r);
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        r[i] = mesh->held[i / 3] ? 0 : s->f[i] - r[i] - dropped[i];
    look_at_gaps(s);
}

/* Newton's method on the gaps may have ended so early that its step climbs from the start, however short:
 * then what the factor makes of the force is the step. */
static drape_status descend(struct dr_state *s, drape_error *reterr)
{
    if (dr_state_dot(s, s->f, s->w) > 0)
        return DRAPE_OK;
    drape_status status = dr_state_solve(s, 1, (const double *[]){s->f}, (double *[]){s->w}, reterr);
    s->solves++;
    if (status >= 0)
        find_residual(s);
    return status;
}

/* Shortens the moves of only those nodes that would run into one another. A pair that is all but shut would
 * hold the whole cloth: each step closes a part of what is left, and the next one is scaled down to less. */
static void hold_single(struct dr_state *s)
{
    dr_self_clip(s->cloth->self, s->x, s->w);
    find_residual(s);
}

/* How far a node moves at most, m. */
static double longest_move(const struct dr_state *s)
{
    double longest = 0;
    for (size_t i = 0; i < 3 * s->cloth->mesh->nodes; i += 3)
        longest =
            fmax(longest, sqrt(s->w[i] * s->w[i] + s->w[i + 1] * s->w[i + 1] + s->w[i + 2] * s->w[i + 2]));
    return longest;
}

/* Scales a step down that is too long for the model to hold, beyond `limit` of second-order strain. False: it
 * was not, but may have been for the cloth. */
static bool shorten(struct dr_state *s, double limit)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    double strain;
    dr_cloth_second_order(s->cloth, s->x, s->w, &strain);
    double scale = fmin(1, fmin(sqrt(limit / strain), LONGEST_MOVE / longest_move(s)));
    bool shortened = scale < 1, locked = false;
    if (s->cloth->self) {
        for (size_t i = 0; i < count; i++)
            s->x_next[i] = scale * s->w[i]; /* free until the move */
        double allowed = dr_self_allows(s->cloth->self, s->x, s->x_next);
        locked = allowed < LOCKED;
        scale *= locked ? 1 : allowed;
    }
    if (scale < 1)
        scale_step(s, scale);
    if (locked)
        hold_single(s);
    /* Newton's method on the gaps may have ended early, above where it began. */
    for (int i = 0; i < MOST_HALVINGS && predict(s) < -noise_of(s); i++) {
        shortened = true;
        scale_step(s, 0.5);
    }
    return shortened;
}

/* Scales a corrected step down until its false stretch is in proportion to what it gains. Where the model is
 * all but flat it goes as far as it may turn, for next to nothing, and what corrections make of that is as
 * often above where it began as below. */
static void trim(struct dr_state *s)
{
    for (int i = 0; i < MOST_TRIMS; i++) {
        double strain, gain = predict(s);
        double false_stretch = dr_cloth_second_order(s->cloth, s->x, s->w, &strain); /* as the fourth power */
        if (!(gain > 0 && false_stretch > 1.05 * MOST_FALSE * gain))
            return;
        scale_step(s, fmax(0.25, sqrt(sqrt(MOST_FALSE * gain / false_stretch))));
    }
}

/* ---- second-order correction ---------------------------------------------------------------------- */

/* The step w from x with the semi-definite Hessian there, by Newton's method on the model with its gaps.
 * *ret_found: there is one. */
static drape_status find_correction(struct dr_state *s, bool *ret_found, drape_error *reterr)
{
    drape_status status = dr_state_factorise(s, 0, ret_found, reterr);
    if (status < 0 || !*ret_found)
        return status;
    status = solve_model(s, reterr);
    return status < 0 ? status : touch(s, reterr);
}

/* w such that the whole step stops at the bodies and takes no part of the cloth through another. `allowed`:
 * it does not as it is, but stopping a node may let others run into it. */
static void clip(struct dr_state *s, bool allowed)
{
    bool stopped = s->cloth->contact && dr_contact_clip(s->cloth->contact, s->x, s->w, DR_CONTACT_DEPTH);
    if (s->cloth->self && (stopped || !allowed))
        dr_self_clip(s->cloth->self, s->x, s->w);
}

/* x_next = x + w, with *ret_there and f_next there; returns the potential energy. */
static double look_ahead(struct dr_state *s, drape_energies *ret_there)
{
    for (size_t i = 0; i < 3 * s->cloth->mesh->nodes; i++)
        s->x_next[i] = s->x[i] + s->w[i];
    return dr_cloth_energy(s->cloth, s->x_next, ret_there, s->f_next);
}

/* One pass of the correction. *ret_more: the energy fell, and another one is worth it. */
static drape_status pass(struct dr_state *s, bool *ret_more, drape_error *reterr)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    double here = s->row.energy.potential, strain;
    drape_energies there = s->row.energy;
    bool found;
    *ret_more = false;
    drape_status status = find_correction(s, &found, reterr);
    if (status < 0 || !found)
        return status;
    shorten(s, MOST_STRAIN);
    clip(s, true);
    for (int tries = 0; tries < MOST_TRIES; tries++) {
        double drop = here - look_ahead(s, &there);
        if (drop > 0 && isfinite(drop)) {
            double false_stretch = dr_cloth_second_order(s->cloth, s->x, s->w, &strain);
            *ret_more = false_stretch > FALSE_PART * drop;
            s->strain = strain;
            dr_state_arrive(s, &there);
            return DRAPE_OK;
        }
        for (size_t i = 0; i < count; i++)
            s->w[i] /= 2;
    }
    return DRAPE_OK;
}

/* Takes out the false stretch that the step from START has made (Maratos' effect): Newton steps from where it
 * led. What is known of that step stays. */
static drape_status take_out_false_stretch(struct dr_state *s, drape_error *reterr)
{
    bool more = true, corrected = s->corrected, cut = s->cut, negative = s->negative;
    drape_status status = DRAPE_OK;
    s->corrected = false;
    for (int i = 0; i < MOST_PASSES && more && status >= 0; i++)
        status = pass(s, &more, reterr);
    s->corrected = corrected;
    s->cut = cut;
    s->negative = negative;
    return status;
}

/* ---- the end -------------------------------------------------------------------------------------- */

/* Newton steps with the factor of the true Hessian that is at hand (the chord method), each for friction's
 * anchors taken afresh. They end at rest or with one that the factor did not foresee, which is not taken. */
static drape_status chords(struct dr_state *s, drape_error *reterr)
{
    for (int i = 0; i < MOST_CHORDS; i++) {
        drape_energies there = s->row.energy;
        if (dr_cloth_has_anchors(s->cloth)) {
            dr_cloth_renew_anchors(s->cloth, s->x);
            s->anchored = s->row.iteration + 1;
            dr_cloth_energy(s->cloth, s->x, &s->row.energy, s->f);
        }
        if (dr_cloth_largest_force(s->cloth, s->f) <= s->sim->options.tolerance * s->weight)
            return DRAPE_OK;
        drape_status status = solve_model(s, reterr);
        if (status < 0 || s->negative || longest_move(s) > LONGEST_MOVE)
            return status;
        clip(s, false);
        double strain, foreseen = 0.5 * dr_state_dot(s, s->f, s->w);
        dr_cloth_second_order(s->cloth, s->x, s->w, &strain);
        double drop = s->row.energy.potential - look_ahead(s, &there);
        if (!isfinite(drop) || foreseen < -noise_of(s) || drop < GOOD_FIT * foreseen - noise_of(s))
            return DRAPE_OK;
        s->strain = strain;
        dr_state_arrive(s, &there);
    }
    return DRAPE_OK;
}

/* ---- the method ---------------------------------------------------------------------------------- */

static void begin(struct dr_state *s)
{
    s->h = first_h(s);
    s->limit = FIRST_LIMIT;
    s->ratio = 1;
    s->lowest = s->lowest_force = INFINITY;
}

/* Whether the last MOST_NOISY steps, all of them Newton's with the true Hessian, promised less than rounding
 * hides of an energy and the force did not care: then it is nothing but round-off. */
static bool at_round_off(struct dr_state *s)
{
    bool noise = s->row.iteration && s->whole && !dr_cloth_has_anchors(s->cloth) && /* which move the force */
                 fabs(s->predicted) < noise_of(s);
    s->noisy = noise ? s->noisy + 1 : 0;
    if (s->noisy <= 1)
        s->noisy_force = s->row.residual_force;
    if (s->noisy <= MOST_NOISY)
        return false;
    s->noisy = 0;
    return s->row.residual_force * NOISY_GAIN > s->noisy_force;
}

static drape_status assess(struct dr_state *s, drape_error *reterr)
{
    if (s->h == 0)
        begin(s);
    if (at_round_off(s)) {
        s->gave_up = "the residual force is round-off, and above the tolerance";
        return DRAPE_OK;
    }
    drape_status status = find_step(s, reterr);
    if (status < 0 || s->gave_up)
        return status;
    s->row.time_step = s->h;
    if (s->gaps) {
        status = touch(s, reterr);
        if (status >= 0)
            status = descend(s, reterr);
        if (status < 0)
            return status;
        s->shortened = shorten(s, s->whole || s->corrected ? MOST_TRUE : MOST_STRAIN);
        if (s->corrected)
            trim(s);
    }
    s->predicted = predict(s);
    if (s->cautious)
        s->cautious--;
    return status;
}

/* Whether the state has got better lately; notes it if so. */
static bool improved(struct dr_state *s, double size)
{
    bool better =
        s->row.energy.potential < s->lowest - 1e-12 * size || s->row.residual_force < 0.99 * s->lowest_force;
    if (better || !s->row.iteration)
        s->lowest_at = s->row.iteration;
    s->lowest = fmin(s->lowest, s->row.energy.potential);
    s->lowest_force = fmin(s->lowest_force, s->row.residual_force);
    return s->row.iteration - s->lowest_at < PATIENCE;
}

/* Back to the best state, carefully; the last time, over to stop-and-go. */
static drape_status bite(struct dr_state *s, drape_error *reterr)
{
    size_t count = 3 * s->cloth->mesh->nodes;
    memcpy(s->x, s->best, count * sizeof *s->x);
    dr_cloth_energy(s->cloth, s->x, &s->row.energy, s->f);
    dr_cloth_stress(s->cloth, s->x, NULL);
    s->h = first_h(s);
    s->limit = FIRST_LIMIT;
    s->strain = 0;
    s->ratio = 1;
    s->cautious = CAUTIOUS;
    s->wait = s->rejected = 0;
    s->negative = s->whole = false;
    s->lowest_at = s->row.iteration + 1;
    s->lowest_force = INFINITY;
    if (++s->bites < MOST_BITES)
        return DRAPE_OK;
    s->sim->report.method = DRAPE_METHOD_STOP_AND_GO;
    s->row.time_step = s->sim->options.time_step;
    return dr_state_hand_over(s, &dr_backward_euler, reterr);
}

/* Sets h and the limit for the next step by how this one fitted; false: it is not to be taken. */
static bool adapt(struct dr_state *s)
{
    bool noise = fabs(s->predicted) < noise_of(s); /* below round-off the force alone decides */
    if (noise)
        s->ratio = 1;
    else if (s->predicted < 0) /* a step that the model says climbs is never one that it foresaw */
        s->ratio = -INFINITY;
    bool rejected = s->ratio < BAD_FIT && s->rejected < MOST_REJECTED;
    s->rejected = rejected ? s->rejected + 1 : 0;
    if (s->ratio < GOOD_FIT)
        s->h = fmax(first_h(s) / 4, s->h / (rejected ? 4 : 2));
    else if (noise || (!s->pivot_failed && !s->shortened))
        s->h *= GROWTH;
    if (!s->whole)
        s->h = fmin(s->h, s->gaps ? H_MAX_BODIES : H_MAX);
    if (s->corrected && s->ratio < GOOD_FIT)
        s->limit = fmax(s->limit / 4, LIMIT_MIN);
    else if (s->cut && s->ratio > LIMIT_FIT)
        s->limit = fmin(s->limit * 2, LIMIT_MAX);
    return !rejected;
}

/* Seconds of this run in stages that have their own account. */
static double accounted(const struct dr_state *s)
{
    const double *stage = s->sim->stage;
    return stage[DR_STAGE_ASSEMBLE] + stage[DR_STAGE_FACTORISE] + stage[DR_STAGE_SOLVE];
}

/* Takes the step that leads to x_next, or not. */
static drape_status settle(struct dr_state *s, const drape_energies *there, drape_error *reterr)
{
    if (!adapt(s))
        return DRAPE_OK;
    if (!isfinite(there->potential))
        return bite(s, reterr);
    dr_state_arrive(s, there);
    return DRAPE_OK;
}

/* The same with the second-order correction, after which the energy itself may tell that the step was good.
 */
static drape_status settle_corrected(struct dr_state *s, const drape_energies *there, drape_error *reterr)
{
    size_t size = 3 * s->cloth->mesh->nodes * sizeof *s->x;
    drape_energies here = s->row.energy;
    double predicted = s->predicted, strain = s->strain;
    memcpy(s->extra[START], s->x, size);
    memcpy(s->extra[START_FORCE], s->f, size);
    dr_state_arrive(s, there);
    drape_status status = take_out_false_stretch(s, reterr);
    if (predicted > 0)
        s->ratio = fmax(s->ratio, (here.potential - s->row.energy.potential) / predicted);
    if (status < 0 || adapt(s))
        return status;
    memcpy(s->x, s->extra[START], size);
    memcpy(s->f, s->extra[START_FORCE], size);
    dr_cloth_stress(s->cloth, s->x, NULL);
    s->row.energy = here;
    s->strain = strain;
    return status;
}

static drape_status advance(struct dr_state *s, drape_error *reterr)
{
    const drape_energies *here = &s->row.energy;
    double began = dr_clock() - accounted(s);
    double size = here->stretch + here->bend + here->contact + fabs(here->gravity);
    drape_energies there = {0};

    if (!improved(s, size))
        return bite(s, reterr);
    clip(s, true);
    double false_stretch = dr_cloth_second_order(s->cloth, s->x, s->w, &s->strain);
    double potential = look_ahead(s, &there);
    s->ratio = isfinite(potential) ? (here->potential - potential + false_stretch) / s->predicted : -INFINITY;
    bool chord = s->gaps && s->whole && s->ratio > GOOD_FIT; /* which take it out, too */
    bool correct =
        s->gaps && !chord && isfinite(potential) && false_stretch > FALSE_PART * fabs(s->predicted);
    drape_status status = correct ? settle_corrected(s, &there, reterr) : settle(s, &there, reterr);
    if (status >= 0 && chord)
        status = chords(s, reterr);
    s->row.linear_iterations = s->solves;
    s->sim->stage[DR_STAGE_MOVE] += dr_clock() - accounted(s) - began;
    return status;
}

const struct dr_method dr_mixed = {.matrix = DR_MATRIX_PRECONDITIONER,
                                   .extra = ARRAYS,
                                   .conjugate = true,
                                   .assess = assess,
                                   .advance = advance};
const struct dr_method dr_mixed_touching = {.matrix = DR_MATRIX_PRECONDITIONER,
                                            .extra = ARRAYS_WITH_BODIES,
                                            .gaps = true,
                                            .conjugate = true,
                                            .assess = assess,
                                            .advance = advance};
