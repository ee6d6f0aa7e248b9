/* sew.c - the first phase: pulls loose pieces together along their seams, round the bodies.
 *
 * Zero-length springs between sewn vertices grow while the pieces, stiff in bending, move without
 * velocity, gravity or friction: (M/dt^2 + H) w = f, H with hinges for bending. The measured record: welding
 * at once leaves sleeves passed through the bodice; soft pieces invert along the seam.
 *
 * The pieces of the first garment may pass through one another on their way, but garments (parts of the
 * welded mesh) are sewn one after the other, in the order of their first vertices, and none through those
 * before: two shirts closed at a time lock, each caught in the other's open seams. What has yet to be sewn
 * waits where it is, and nothing feels it: it need only start outside of what is sewn by then. To be outside
 * of a dress's flat pieces a skirt had to start beyond the arms, and was pulled up along them to the neck. A
 * garment that goes over another is kept off itself, too: held away from the body by what is under it, it
 * folds over at the armpits and is caught so. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "error.h"
#include "sim.h"

#define TIME_STEP            0.02 /* s: the mass is only a regulariser here */
#define SPRING_FIRST         0.2  /* N/m */
#define SPRING_LAST          1e5  /* N/m */
#define SPRING_GROWTH        1.15 /* per step */
#define PULL_FIRST           3  /* N per metre of seam, where layers must not be pulled through one another */
#define PULL_LAST            30 /* but SPRING_GROWTH times more for each step that closes nothing */
#define CLOSING              5e-4  /* m: that the widest seam narrows by, or nothing closes */
#define SLIDES               4     /* rounds over the pairs of layers */
#define LONGEST_MOVE         0.005 /* m per node and step: pieces slide round a body, never through it */
#define CONTACT_DEPTH        0.002 /* m below a surface that one step may end */
#define STEPS_BESIDES_TRAVEL 250   /* over what the widest seam needs at the longest move */

/* From the first vertex to the second, m; returns the length. */
static double seam_gap(const double *x, const uint32_t seam[2], double gap[3])
{
    for (size_t d = 0; d < 3; d++)
        gap[d] = x[3 * (size_t)seam[1] + d] - x[3 * (size_t)seam[0] + d];
    return sqrt(gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]);
}

double dr_seam_stiffness(double gap, double stiffness, double most)
{
    return gap * stiffness > most ? most / gap : stiffness;
}

double dr_seam_energy(const uint32_t *seam, size_t seams, double stiffness, double most, const double *x,
                      double *f, double *ret_gap)
{
    double sum = 0;
    *ret_gap = 0;
    for (size_t s = 0; s < seams; s++) {
        double gap[3], width = seam_gap(x, seam + 2 * s, gap);
        double k = dr_seam_stiffness(width, stiffness, most);
        for (size_t d = 0; d < 3; d++) {
            f[3 * (size_t)seam[2 * s] + d] += k * gap[d];
            f[3 * (size_t)seam[2 * s + 1] + d] -= k * gap[d];
        }
        sum += k < stiffness ? most * (width - most / stiffness / 2) : k * width * width / 2;
        *ret_gap = fmax(*ret_gap, width);
    }
    return sum;
}

static void limit_moves(const struct dr_mesh *mesh, double *w)
{
    for (size_t i = 0; i < mesh->nodes; i++) {
        double *move = w + 3 * i;
        double length = sqrt(move[0] * move[0] + move[1] * move[1] + move[2] * move[2]);
        if (length > LONGEST_MOVE)
            for (int d = 0; d < 3; d++)
                move[d] *= LONGEST_MOVE / length;
    }
}

/* The seams that are being closed: `first` up to `end`. Those before are closed, those behind have yet to be.
 */
struct turn {
    size_t first, end;
    uint32_t part;
    double spring; /* N/m */
    double most;   /* N: of one spring; INFINITY: no bound */
    double last;   /* N: that it grows to */
    double least;  /* m: the widest seam, when last it had narrowed */
};

/* The springs' energy; forces added to f; *ret_gap: the widest seam of this turn and those before, and
 * *ret_widest: of all. */
static double pull(const drape_scene *scene, const struct turn *turn, const double *x, double *f,
                   double *ret_gap, double *ret_widest)
{
    double before = 0, now, after = 0, energy = 0;
    if (turn->first)
        energy = dr_seam_energy(scene->seam, turn->first, SPRING_LAST, INFINITY, x, f, &before);
    energy += dr_seam_energy(scene->seam + 2 * turn->first, turn->end - turn->first, turn->spring, turn->most,
                             x, f, &now);
    if (turn->end < scene->seams)
        dr_seam_energy(scene->seam + 2 * turn->end, scene->seams - turn->end, 0, INFINITY, x, f, &after);
    *ret_gap = fmax(before, now);
    *ret_widest = fmax(*ret_gap, after);
    return energy;
}

/* A move, of the nodes of parts up to `part`. */
struct slide {
    double *w;
    const uint32_t *piece_part;
    uint32_t part;
};

/* Takes from the move what would bring two layers nearer than half their thickness, so that they
 * slide along each other: what the limit on steps shortens stops sliding, too, and locks. */
static void slide(const struct dr_self_gap *gap, void *data)
{
    const struct slide *slide = data;
    double closing = 0, share = 0, goal = fmin(gap->distance, gap->offset / 2);
    for (int k = 0; k < 4; k++) {
        const double *move = slide->w + 3 * (size_t)gap->node[k];
        closing += gap->weight[k] * (gap->n[0] * move[0] + gap->n[1] * move[1] + gap->n[2] * move[2]);
        if (slide->piece_part[gap->node[k]] <= slide->part)
            share += gap->weight[k] * gap->weight[k];
    }
    double lack = goal - gap->distance - closing;
    if (!(lack > 0) || !(share > 0))
        return;
    for (int k = 0; k < 4; k++)
        for (size_t d = 0; d < 3 && slide->piece_part[gap->node[k]] <= slide->part; d++)
            slide->w[3 * (size_t)gap->node[k] + d] += lack / share * gap->weight[k] * gap->n[d];
}

/* Makes w, a solution of the step's equation, one that may be taken. */
static void restrain(const struct dr_cloth *cloth, const uint32_t *piece_part, uint32_t part, const double *x,
                     double *w)
{
    for (size_t i = 0; piece_part && i < cloth->mesh->nodes; i++)
        if (piece_part[i] > part)
            memset(w + 3 * i, 0, 3 * sizeof *w);
    limit_moves(cloth->mesh, w);
    for (int round = 0; cloth->self && round < SLIDES; round++)
        dr_self_each(cloth->self, x, slide, &(struct slide){w, piece_part, part});
    if (cloth->self)
        limit_moves(cloth->mesh, w);
    if (cloth->contact)
        dr_contact_clip(cloth->contact, x, w, CONTACT_DEPTH);
    if (cloth->self)
        dr_self_clip(cloth->self, x, w);
}

/* The step from the forces f, into w. *ret_stepped: false where no time was left. */
static drape_status find_step(struct drape_sim *sim, struct dr_cloth *cloth, const struct turn *turn,
                              const double *f, double *w, bool *ret_stepped, drape_error *reterr)
{
    enum dr_factored factored;
    drape_status status = dr_cloth_assemble(cloth, sim->positions, 0, reterr);
    if (status < 0)
        return status;
    for (size_t s = 0; s < turn->end; s++) {
        double way[3], gap = seam_gap(sim->positions, sim->scene->seam + 2 * s, way);
        bool before = s < turn->first;
        dr_matrix_add_link(
            cloth->A, s,
            dr_seam_stiffness(gap, before ? SPRING_LAST : turn->spring, before ? INFINITY : turn->most));
    }
    status = dr_sim_factorise(sim, cloth, &factored, reterr);
    *ret_stepped = factored == DR_FACTORED;
    if (status < 0 || factored == DR_NO_TIME)
        return status;
    if (factored == DR_NOT_DEFINITE)
        return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                       "the step matrix could not be factorised while sewing, step %u",
                       sim->report.sewing_iterations);
    dr_matrix_solve(cloth->A, 1, (const double *[]){f}, (double *[]){w});
    sim->report.solves++;
    restrain(cloth, sim->scene->piece_part, turn->part, sim->positions, w);
    return DRAPE_OK;
}

/* Springs for the next step; the widest of their seams is now `gap`. Their force is bounded so that what lies
 * between yields in time. Where that has come to a halt it takes more, at most what the stiffest spring has:
 * a waistband of 0.8 m gathers a dress where it is 1.1 m wide, and 30 N/m left it open by 15 mm. */
static void tighten(struct turn *turn, double gap)
{
    turn->spring = fmin(turn->spring * SPRING_GROWTH, SPRING_LAST);
    if (gap < turn->least - CLOSING)
        turn->least = gap;
    else if (turn->most >= turn->last)
        turn->last *= SPRING_GROWTH;
    turn->most = fmin(turn->most * SPRING_GROWTH, turn->last);
}

/* Closes the seams of one turn, as far as `most` steps do it. */
static drape_status sew_turn(struct drape_sim *sim, struct dr_cloth *cloth, struct turn *turn, uint32_t most,
                             double *f, double *w, drape_error *reterr)
{
    double *x = sim->positions, gap;
    drape_progress progress = {.phase = DRAPE_PHASE_SEWING};
    for (uint32_t step = 0;; step++, sim->report.sewing_iterations++) {
        drape_energies energy = {0};
        bool stepped;
        double potential = dr_cloth_energy(cloth, x, &energy, f);
        double seams = pull(sim->scene, turn, x, f, &gap, &progress.seam_gap);
        if (cloth->self && dr_self_error(cloth->self, reterr) < 0)
            return DRAPE_ENOMEM;
        if (!isfinite(potential + seams))
            return dr_fail(reterr, DRAPE_ENUMERIC, DRAPE_AT_NOWHERE, -1,
                           "a non-finite energy while sewing, step %u", sim->report.sewing_iterations);
        energy.potential += seams;
        progress.row = (drape_row){.iteration = sim->report.sewing_iterations,
                                   .seconds = dr_clock() - sim->began,
                                   .energy = energy,
                                   .time_step = TIME_STEP,
                                   .linear_iterations = 1};
        progress.row.residual_force = dr_cloth_largest_force(cloth, f) / dr_cloth_mean_weight(cloth);
        sim->report.seam_gap = progress.seam_gap;
        dr_sim_tell(sim, &progress);
        if (gap <= DR_WELD_GAP || step == most || dr_sim_interrupted(sim))
            return DRAPE_OK;
        drape_status status = find_step(sim, cloth, turn, f, w, &stepped, reterr);
        if (status < 0 || !stepped)
            return status;
        dr_cloth_stress(cloth, x, w);
        for (size_t i = 0; i < 3 * cloth->mesh->nodes; i++)
            x[i] += w[i];
        tighten(turn, gap);
    }
}

/* Behind the last seam of the part of seam `first`. */
static size_t end_of_part(const drape_scene *scene, size_t first)
{
    size_t end = first;
    if (!scene->piece_part)
        return scene->seams;
    while (end < scene->seams &&
           scene->piece_part[scene->seam[2 * end]] == scene->piece_part[scene->seam[2 * first]])
        end++;
    return end;
}

/* What is sewn over another garment has springs that are stiff from the beginning, so that seams which are
 * closed stay so and no other layer gets between; and none pulls harder than contact can hold. The innermost
 * garment has nothing under it but the bodies, and is sewn as if it were alone. */
static struct turn begin_turn(const struct dr_cloth *cloth, const drape_scene *scene, size_t first,
                              size_t end)
{
    struct turn turn = {.first = first,
                        .end = end,
                        .spring = SPRING_FIRST,
                        .most = INFINITY,
                        .last = INFINITY,
                        .least = INFINITY};
    if (scene->piece_part)
        turn.part = scene->piece_part[scene->seam[2 * first]];
    if (cloth->self && turn.part > 0) {
        double edge = dr_mesh_edge(cloth->mesh);
        turn.spring = SPRING_LAST;
        turn.most = PULL_FIRST * edge;
        turn.last = PULL_LAST * edge;
    }
    return turn;
}

/* Marks the nodes of the garments with open seams from number `end` on: these have their turn yet. */
static void find_waiting(const drape_scene *scene, size_t end, const double *x, bool *waiting)
{
    double way[3];
    memset(waiting, 0, scene->vertices * sizeof *waiting);
    for (size_t s = end, next; s < scene->seams; s = next) {
        bool open = false;
        next = end_of_part(scene, s);
        for (size_t i = s; i < next; i++)
            open = open || seam_gap(x, scene->seam + 2 * i, way) > DR_WELD_GAP;
        for (size_t i = 0; open && i < scene->vertices; i++)
            waiting[i] = waiting[i] || scene->piece_part[i] == scene->piece_part[scene->seam[2 * s]];
    }
}

/* `waiting`: vertices. */
static drape_status sew_pieces(struct drape_sim *sim, struct dr_cloth *cloth, double *f, double *w,
                               bool *waiting, drape_error *reterr)
{
    const drape_scene *scene = sim->scene;
    uint32_t most =
        STEPS_BESIDES_TRAVEL + (uint32_t)fmin(scene->seam_gap / LONGEST_MOVE, DRAPE_MAX_ITERATIONS);
    drape_status status = DRAPE_OK;
    for (size_t first = 0, end; first < scene->seams && status >= 0; first = end) {
        end = end_of_part(scene, first);
        struct turn turn = begin_turn(cloth, scene, first, end);
        if (cloth->self) {
            find_waiting(scene, end, sim->positions, waiting);
            dr_self_without(cloth->self, waiting);
        }
        if (cloth->self && turn.part > 0)
            dr_self_weld(cloth->self, scene->vertex_node);
        status = sew_turn(sim, cloth, &turn, most, f, w, reterr);
    }
    return status;
}

drape_status dr_sew(struct drape_sim *sim, drape_error *reterr)
{
    const drape_scene *scene = sim->scene;
    double began = dr_clock();
    struct dr_cloth *cloth = NULL;
    double *f = malloc(3 * scene->vertices * sizeof *f), *w = malloc(3 * scene->vertices * sizeof *w);
    bool *waiting = malloc(scene->vertices * sizeof *waiting);
    drape_status status = f && w && waiting ? DRAPE_OK : dr_out_of_memory(reterr);
    if (status >= 0)
        status = dr_cloth_new(&sim->plan.pieces, sim->positions, &cloth, reterr);
    if (status >= 0) {
        dr_matrix_set_base(cloth->A, 1 / (TIME_STEP * TIME_STEP));
        dr_cloth_stress(cloth, sim->positions, NULL);
        status = sew_pieces(sim, cloth, f, w, waiting, reterr);
        size_t bytes[DR_TERMS] = {[DR_TERM_SEWING] = scene->vertices * (6 * sizeof *f + sizeof *waiting)};
        dr_cloth_bytes(cloth, bytes);
        dr_plan_hold(&sim->plan, DRAPE_PHASE_SEWING, bytes);
    }
    dr_cloth_free(cloth);
    free(f);
    free(w);
    free(waiting);
    sim->stage[DR_STAGE_SEW] = dr_clock() - began;
    return status;
}
