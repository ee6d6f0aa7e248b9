/* motion.c - the phase in which bodies move: the cloth follows by plain dynamics.
 *
 * One frame of dt:
 *   1. carry    every node goes along with the body point nearest to it (carry.h), as far as other cloth lets
 *               it: x0; friction's anchors, too
 *   2. move     the bodies take their new places
 *   3. correct  backward Euler from there, by steps of Newton on |x - y|^2_M / (2 dt^2) + E(x), none of which
 *               climbs, y = x_old + dt v_old; friction with its true Hessian, so that what slipped slides on
 *   4. v = (x - x_old) / dt, less what the air takes
 * Frictionless or far from the body the cloth thus ends up where inertia has it, however it was carried. But
 * it starts outside of what it was outside of, and every step from there is walked (dr_contact_clip): the
 * motion of the body itself, however fast, takes it through nothing. A node that another body reaches, or
 * that other cloth keeps from coming along, is inside by no more than that body moves in one frame, and is
 * pushed out on the side that is nearest. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "sim.h"
#include "state.h"

#define LONGEST_FRAME 0.02 /* s */
#define LONGEST_SWEEP 0.02 /* m: of a body vertex in one frame; thinner than a limb */
#define MOST_FRAMES   3000 /* DRAPE_MAX_MOTION in the longest frames */
#define EASE_SPEED    1.5  /* the greatest slope of 3 u^2 - 2 u^3 */
#define AIR           2.0  /* 1/s: cloth that swings freely is calm after a second */
#define CORRECTIONS   3    /* of Newton per frame, at most */
#define LET_GO        0.5  /* of all friction: so much more calls for another */
#define LONGEST_MOVE  0.05 /* m per node and correction */
#define MOST_HALVINGS 6    /* of a correction that climbs */

struct mover {
    struct drape_sim *sim;
    struct dr_cloth *cloth;
    struct dr_body **body;     /* scene->bodies: those that move are ours, the others the scene's */
    double *next;              /* where a moving body goes: 3 * the most vertices of any */
    double *x, *v, *w;         /* 3*nodes; x is the caller's, w the next step */
    double *old, *from;        /* 3*nodes: x when the frame began, and when the correction did */
    double *f, value;          /* 3*nodes: minus the gradient of what a frame minimises, and that, at x */
    drape_energies energy;     /* at x, likewise */
    double *distance;          /* nodes: to the nearest body, m */
    double *scratch;           /* DR_CARRY_SCRATCH*nodes */
    struct dr_motor *motor;    /* nodes */
    struct dr_motor *smoothed; /* nodes */
    double step;               /* s */
    uint32_t frames;
};

/* ---- time ------------------------------------------------------------------------------------ */

static double longest_motion(const drape_scene *scene)
{
    double longest = 0;
    for (size_t b = 0; b < scene->bodies; b++)
        if (scene->path[b])
            longest = fmax(longest, scene->path[b]->desc.motion_seconds);
    return longest;
}

static uint32_t count_frames(const drape_scene *scene, double seconds)
{
    double frames = seconds / LONGEST_FRAME;
    for (size_t b = 0; b < scene->bodies; b++) {
        const struct dr_path *path = scene->path[b];
        if (!path)
            continue;
        double speed =
            EASE_SPEED * path->longest_move * (double)path->desc.keyframes / path->desc.motion_seconds;
        frames = fmax(frames, speed * seconds / LONGEST_SWEEP);
    }
    return (uint32_t)fmin(ceil(frames * (1 - 1e-12)), MOST_FRAMES); /* seconds > 0, so at least 1 */
}

/* Where a body is at a time (s): between two keyframes, exactly on the last one at the end. */
static void place_body(const struct dr_path *path, double time, double *ret)
{
    size_t numbers = 3 * path->desc.vertices, keyframes = path->desc.keyframes;
    double u = time / path->desc.motion_seconds;
    double s = u < 1 ? u * u * (3 - 2 * u) * (double)keyframes : (double)keyframes;
    size_t k = s < (double)keyframes ? (size_t)s : keyframes - 1;
    const double *from = path->positions + k * numbers, *to = from + numbers;
    double part = s - (double)k;
    for (size_t i = 0; i < numbers; i++)
        ret[i] = part < 1 ? from[i] + part * (to[i] - from[i]) : to[i];
}

/* ---- 1. and 2. ------------------------------------------------------------------------------- */

/* Nodes nearer to this body than to those before it are to move with it. */
static void offer_moving(struct mover *m, const struct dr_path *path, const struct dr_body *body)
{
    const double *centre = m->x;
    for (size_t i = 0; i < m->cloth->mesh->nodes; i++) {
        struct dr_place place;
        dr_body_nearest(body, m->x + 3 * i, &place);
        double distance = sqrt(place.square);
        if (!(distance < m->distance[i]))
            continue;
        m->distance[i] = distance;
        m->motor[i] = dr_motor_at(&place, path->triangle, dr_body_positions(body), m->next, centre);
    }
}

/* And those nearer to this one are to stand. */
static void offer_standing(struct mover *m, const struct dr_body *body)
{
    for (size_t i = 0; i < m->cloth->mesh->nodes; i++) {
        double phi, unused[3];
        if (!dr_body_distance(body, m->x + 3 * i, &phi, unused) || !(fabs(phi) < m->distance[i]))
            continue;
        m->distance[i] = fabs(phi);
        m->motor[i] = (struct dr_motor){{1, 0, 0, 0}, {0, 0, 0, 0}};
    }
}

/* Tacks go along with the triangles they are named by. */
static void carry_tacks(struct mover *m)
{
    const drape_scene *scene = m->sim->scene;
    for (size_t i = 0; i < scene->tacks; i++) {
        const struct dr_tack *tack = scene->tack + i;
        const struct dr_path *path = scene->path[tack->body];
        double at[3];
        if (!path)
            continue;
        dr_tack_point(path->triangle + 3 * (size_t)tack->triangle, dr_body_positions(m->body[tack->body]),
                      tack->barycentric, at);
        dr_tack_lift(m->body[tack->body], at);
        dr_tacks_move(m->cloth->tacks, i, at);
    }
}

/* Moves the bodies to where they are at `time`, and anchors with them; where the nodes would go along to is
 * left in w. */
static void carry(struct mover *m, double time)
{
    const drape_scene *scene = m->sim->scene;
    const struct dr_mesh *mesh = m->cloth->mesh;
    double centre[3] = {m->x[0], m->x[1], m->x[2]};
    for (size_t i = 0; i < mesh->nodes; i++)
        m->distance[i] = INFINITY;
    for (size_t b = 0; b < scene->bodies; b++) {
        if (!scene->path[b])
            continue;
        place_body(scene->path[b], time, m->next);
        offer_moving(m, scene->path[b], m->body[b]);
        dr_body_move(m->body[b], m->next);
    }
    for (size_t b = 0; b < scene->bodies; b++)
        if (!scene->path[b])
            offer_standing(m, m->body[b]);
    if (m->cloth->tacks)
        carry_tacks(m);
    if (m->cloth->friction)
        dr_friction_carry(m->cloth->friction, m->motor, centre);
    memcpy(m->smoothed, m->motor, mesh->nodes * sizeof *m->motor);
    dr_carry_smooth(m->x, mesh->nodes, mesh->triangle, mesh->triangles, m->distance, m->scratch, m->smoothed);
    memcpy(m->w, m->x, 3 * mesh->nodes * sizeof *m->w);
    for (size_t i = 0; i < mesh->nodes; i++)
        if (!mesh->held[i])
            dr_motor_move(m->smoothed + i, centre, m->w + 3 * i);
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        m->w[i] -= m->x[i];
}

static void go(struct mover *m)
{
    for (size_t i = 0; i < 3 * m->cloth->mesh->nodes; i++)
        m->x[i] += m->w[i];
}

/* ---- 3. correct ------------------------------------------------------------------------------ */

static void limit_moves(const struct mover *m)
{
    for (size_t i = 0; i < m->cloth->mesh->nodes; i++) {
        double *move = m->w + 3 * i;
        double length = sqrt(move[0] * move[0] + move[1] * move[1] + move[2] * move[2]);
        for (int d = 0; d < 3 && length > LONGEST_MOVE; d++)
            move[d] *= LONGEST_MOVE / length;
    }
    dr_contact_clip(m->cloth->contact, m->x, m->w, DR_CONTACT_DEPTH);
    if (m->cloth->self)
        dr_self_clip(m->cloth->self, m->x, m->w);
}

static drape_status check_self(const struct mover *m, drape_error *reterr)
{
    return m->cloth->self ? dr_self_error(m->cloth->self, reterr) : DRAPE_OK;
}

/* Finds value, energy and f at x. */
static void measure(struct mover *m)
{
    const struct dr_mesh *mesh = m->cloth->mesh;
    double inertia = 1 / (m->step * m->step);
    m->value = dr_cloth_energy(m->cloth, m->x, &m->energy, m->f);
    for (size_t i = 0; i < 3 * mesh->nodes; i++) {
        double gap = m->old[i] + m->step * m->v[i] - m->x[i], force = inertia * mesh->mass[i / 3] * gap;
        m->value += 0.5 * force * gap;
        m->f[i] += force;
    }
}

/* Goes along w, or a half, a quarter... of it, to where the value is no more than it was, but for the false
 * stretch of a linear step that turns threads: the next one takes that away. The part of it that was gone. */
static double descend(struct mover *m)
{
    size_t count = 3 * m->cloth->mesh->nodes;
    double part = 1, before = m->value, strain;
    memcpy(m->from, m->x, count * sizeof *m->x);
    for (int halvings = 0;; halvings++) {
        go(m);
        measure(m);
        double stretch = dr_cloth_second_order(m->cloth, m->from, m->w, &strain);
        if (m->value <= before + stretch || halvings == MOST_HALVINGS)
            return part;
        part /= 2;
        for (size_t i = 0; i < count; i++)
            m->w[i] /= 2;
        memcpy(m->x, m->from, count * sizeof *m->x);
    }
}

/* A step of Newton. *ret_whole: there was time for it. *ret_again: it was not enough. One does for what a
 * drape starts from, unless only a part of it could be gone. And it counts on friction to hold as it held;
 * where most of it lets go, the force would be many times what friction can. */
static drape_status correct(struct mover *m, bool *ret_whole, bool *ret_again, drape_error *reterr)
{
    struct dr_cloth *cloth = m->cloth;
    enum dr_factored factored;
    drape_status status = dr_cloth_assemble(cloth, m->x, 0, reterr);
    if (status < 0)
        return status;
    status = dr_sim_factorise(m->sim, cloth, &factored, reterr);
    *ret_whole = factored != DR_NO_TIME;
    if (status < 0 || !*ret_whole)
        return status;
    if (factored == DR_NOT_DEFINITE)
        return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                       "the step matrix could not be factorised while the bodies move, frame %u",
                       m->sim->report.motion_frames);
    dr_matrix_solve(cloth->A, 1, (const double *[]){m->f}, (double *[]){m->w});
    m->sim->report.solves++;
    limit_moves(m);
    *ret_again = descend(m) < 1;
    if (cloth->friction && dr_friction_let_go(cloth->friction, m->from, m->w) > LET_GO)
        *ret_again = true;
    dr_cloth_stress(cloth, m->from, m->w);
    return DRAPE_OK;
}

/* ---- frames ---------------------------------------------------------------------------------- */

static void tell(const struct mover *m, uint32_t corrections)
{
    drape_progress progress = {.phase = DRAPE_PHASE_MOVING, .seam_gap = m->sim->report.seam_gap};
    const struct dr_mesh *mesh = m->cloth->mesh;
    progress.row = (drape_row){.iteration = m->sim->report.motion_frames,
                               .seconds = dr_clock() - m->sim->began,
                               .energy = m->energy,
                               .time_step = m->step,
                               .linear_iterations = corrections,
                               .residual_energy = NAN,
                               .residual_force = NAN};
    for (size_t i = 0; i < 3 * mesh->nodes; i++)
        progress.row.energy.kinetic += 0.5 * mesh->mass[i / 3] * m->v[i] * m->v[i];
    dr_sim_tell(m->sim, &progress);
}

/* From where the last frame left to frame n of all. *ret_whole as above. */
static drape_status advance(struct mover *m, uint32_t n, bool *ret_whole, drape_error *reterr)
{
    size_t count = 3 * m->cloth->mesh->nodes;
    memcpy(m->old, m->x, count * sizeof *m->x);
    drape_status status = DRAPE_OK;
    uint32_t corrections = 0;
    bool again = true;
    *ret_whole = true;
    carry(m, n == m->frames ? INFINITY : n * m->step);
    if (m->cloth->self)
        dr_self_clip(m->cloth->self, m->x, m->w);
    go(m);
    measure(m);
    if (check_self(m, reterr) < 0)
        return DRAPE_ENOMEM;
    if (!isfinite(m->value))
        return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                       "a non-finite energy while the bodies move, frame %u", m->sim->report.motion_frames);
    for (; status >= 0 && *ret_whole && again && corrections < CORRECTIONS; corrections++)
        status = correct(m, ret_whole, &again, reterr);
    if (status < 0 || !*ret_whole)
        return status;
    for (size_t i = 0; i < count; i++)
        m->v[i] = (m->x[i] - m->old[i]) / (m->step * (1 + AIR * m->step));
    dr_cloth_renew_anchors(m->cloth, m->x);
    m->sim->report.motion_frames = n;
    tell(m, corrections);
    return check_self(m, reterr);
}

static drape_status follow(struct mover *m, drape_error *reterr)
{
    drape_status status = DRAPE_OK;
    bool whole = true;
    m->cloth->slides = true;
    dr_matrix_set_base(m->cloth->A, 1 / (m->step * m->step));
    dr_cloth_stress(m->cloth, m->x, NULL);
    for (uint32_t n = 1; n <= m->frames && status >= 0 && whole; n++) {
        whole = !dr_sim_interrupted(m->sim);
        if (whole)
            status = advance(m, n, &whole, reterr);
    }
    if (!whole) {
        carry(m, INFINITY);
        go(m);
    }
    return status;
}

/* ---- made and freed -------------------------------------------------------------------------- */

static bool allocate(struct mover *m, size_t nodes, size_t vertices)
{
    double **array[] = {&m->v, &m->f, &m->w, &m->old, &m->from};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++)
        if (!(*array[i] = calloc(3 * nodes, sizeof(double))))
            return false;
    m->next = malloc(3 * vertices * sizeof *m->next);
    m->distance = malloc(nodes * sizeof *m->distance);
    m->scratch = malloc(DR_CARRY_SCRATCH * nodes * sizeof *m->scratch);
    m->motor = malloc(nodes * sizeof *m->motor);
    m->smoothed = malloc(nodes * sizeof *m->smoothed);
    m->body = calloc(m->sim->scene->bodies, sizeof(struct dr_body *));
    return m->next && m->distance && m->scratch && m->motor && m->smoothed && m->body;
}

static size_t most_vertices(const drape_scene *scene)
{
    size_t most = 0;
    for (size_t b = 0; b < scene->bodies; b++)
        if (scene->path[b] && scene->path[b]->desc.vertices > most)
            most = scene->path[b]->desc.vertices;
    return most;
}

static drape_status prepare(struct mover *m, drape_error *reterr)
{
    const drape_scene *scene = m->sim->scene;
    drape_status status = DRAPE_OK;
    if (!allocate(m, scene->mesh->nodes, most_vertices(scene)))
        return dr_out_of_memory(reterr);
    for (size_t b = 0; b < scene->bodies && status >= 0; b++) {
        if (scene->path[b])
            status = dr_body_new_moving(&scene->path[b]->desc, &m->body[b], reterr);
        else
            m->body[b] = scene->body[b];
    }
    if (status < 0)
        return status;
    m->sim->plan.moved.body = m->body;
    return dr_cloth_new(&m->sim->plan.moved, m->x, &m->cloth, reterr);
}

static void note_bytes(const struct mover *m)
{
    const drape_scene *scene = m->sim->scene;
    size_t nodes = scene->mesh->nodes, bytes[DR_TERMS] = {0};
    bytes[DR_TERM_MOTION] = (3 * most_vertices(scene) + (16 + DR_CARRY_SCRATCH) * nodes) * sizeof(double) +
                            2 * nodes * sizeof *m->motor + scene->bodies * sizeof(struct dr_body *);
    for (size_t b = 0; b < scene->bodies; b++)
        if (scene->path[b])
            bytes[DR_TERM_MOTION] += dr_body_bytes(m->body[b]);
    dr_cloth_bytes(m->cloth, bytes);
    dr_plan_hold(&m->sim->plan, DRAPE_PHASE_MOVING, bytes);
}

static void finish(struct mover *m)
{
    const drape_scene *scene = m->sim->scene;
    dr_cloth_free(m->cloth);
    for (size_t b = 0; m->body && b < scene->bodies; b++)
        if (scene->path[b])
            dr_body_free(m->body[b]);
    m->sim->plan.moved.body = NULL;
    free(m->body);
    free(m->next);
    free(m->v);
    free(m->f);
    free(m->w);
    free(m->old);
    free(m->from);
    free(m->distance);
    free(m->scratch);
    free(m->motor);
    free(m->smoothed);
}

drape_status dr_move(struct drape_sim *sim, double *x, drape_error *reterr)
{
    double began = dr_clock(), seconds = longest_motion(sim->scene);
    struct mover mover = {.sim = sim, .x = x, .frames = count_frames(sim->scene, seconds)};
    mover.step = seconds / mover.frames;
    drape_status status = prepare(&mover, reterr);
    if (status >= 0)
        status = follow(&mover, reterr);
    if (status >= 0)
        note_bytes(&mover);
    finish(&mover);
    sim->stage[DR_STAGE_FOLLOW] = dr_clock() - began;
    return status;
}
