/* drape.h - the public interface of libdrape: cloth at rest.
 *
 * Conventions, stated once:
 *   - SI units: metres, kilograms, newtons, seconds, joules. Right-handed axes; the caller picks "up"
 *     by choosing gravity (the default is y up).
 *   - Positions are packed xyz doubles, pattern coordinates packed uv doubles (u weft, v warp).
 *   - Indices are zero-based uint32_t; a triangle is three of them, counter-clockwise from outside.
 *   - A drape_scene never changes once made and may be shared by any number of threads.
 *     A drape_sim belongs to one thread at a time; only drape_sim_cancel may be called from others.
 *   - Functions return a drape_status: 0 is fine, > 0 a result with a caveat, < 0 no result.
 *     `ret` arguments are written on success (>= 0) only, `reterr` on failure (< 0) only; either
 *     reterr may be NULL. Nothing here prints, exits, or reads files, the environment or the clock
 *     other than CLOCK_MONOTONIC for the seconds it reports and the time limit.
 *   - The same input gives the same bytes, whatever else the machine is doing (a time limit that
 *     strikes is the one exception).
 *
 * Volino & Magnenat-Thalmann, "Stop-and-go cloth draping", The Visual Computer 2007, is cited below
 * as [VMT07].
 */
#ifndef DRAPE_H
#define DRAPE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct drape_scene drape_scene; /* what stays: mesh, material, bodies */
typedef struct drape_sim drape_sim;     /* what moves: positions, velocities, workspace */

/* ---- status and errors ------------------------------------------------------------------- */

typedef enum drape_status {
    DRAPE_OK = 0,
    DRAPE_NOT_AT_REST = 1, /* a budget was spent, or nothing can come to rest; best state is there */
    DRAPE_CANCELLED = 2,   /* drape_sim_cancel or the progress callback; best state is there */
    DRAPE_EINVAL = -1,     /* the input is wrong; the error says where */
    DRAPE_ENOMEM = -2,
    DRAPE_ENUMERIC = -3 /* a non-finite number or a factorisation that failed at every attempt */
} drape_status;

const char *drape_status_name(drape_status status); /* "not-at-rest"; stable, never NULL */

/* Which array of the input an error speaks of; drape_error.element is the index into it. */
typedef enum drape_place {
    DRAPE_AT_NOWHERE = 0,
    DRAPE_AT_VERTEX,            /* cloth vertex: its position */
    DRAPE_AT_PATTERN,           /* cloth vertex: its pattern coordinates */
    DRAPE_AT_TRIANGLE,          /* cloth triangle */
    DRAPE_AT_SEAM,              /* seam pair */
    DRAPE_AT_PIN,               /* entry of the pin list */
    DRAPE_AT_MATERIAL,          /* material; `member` names the field */
    DRAPE_AT_TRIANGLE_MATERIAL, /* entry of triangle_material */
    DRAPE_AT_BODY,              /* body; `member` names the field, if any */
    DRAPE_AT_BODY_VERTEX,       /* vertex of body number `body` */
    DRAPE_AT_BODY_TRIANGLE,     /* triangle of body number `body` */
    DRAPE_AT_ELASTIC,           /* elastic; `member` names the field */
    DRAPE_AT_ELASTIC_EDGE,      /* edge of elastic number `body` */
    DRAPE_AT_FOLD,              /* fold; `member` names the field */
    DRAPE_AT_FOLD_EDGE,         /* edge of fold number `body` */
    DRAPE_AT_TACK,              /* tack; `member` names the field, if any */
    DRAPE_AT_BODY_KEYFRAME,     /* keyframe of the motion of body number `body` */
    DRAPE_AT_SCENE,             /* a scalar of the scene; `member` names it */
    DRAPE_AT_OPTION             /* a member of drape_options; `member` names it */
} drape_place;

typedef struct drape_error {
    drape_status status;
    drape_place place;
    int64_t element;    /* index into the array of `place`; -1: none */
    int64_t body;       /* body number for DRAPE_AT_BODY_*, line number for *_EDGE; -1: none */
    const char *member; /* static string, the C member's name; NULL: none */
    char message[160];  /* one line, no full stop, does not repeat the place */
} drape_error;

/* ---- the scene ------------------------------------------------------------------------------ */

/* Past this many points a curve is refused: a tensile test smoothed for use has a dozen or two. */
#define DRAPE_MAX_CURVE_POINTS 64

/* A measured strain-stress curve in the place of one stiffness of a fabric. Points are (strain, N/m) from
 * rest on; (0, 0) is their start whether given or not.
 *   - weft, warp: what a tensile tester gives, elongation over rest length against force per rest width.
 *   - shear: S_uv against 2 E_uv, which for small strains is the shear angle in radians.
 * Strains rise strictly, stresses never fall, and the first and the last step rise, by DRAPE_MIN_MATERIAL
 * N/m at least; no step by more than DRAPE_MAX_MATERIAL. Between points runs the monotone C1 cubic of
 * Fritsch and Butland (SIAM J. Sci. Stat. Comput. 5, 1984); it leaves rest with the slope of its first
 * step and goes on past the last point with the slope of its last step.
 * Shear is odd. What compression does is not in a tensile test: there the cloth is the linear fabric of
 * the curve's slope at rest. Energy is the exact integral, so that forces are conservative. */
typedef struct drape_curve {
    size_t points;       /* 0: no curve */
    const double *point; /* 2*points: strain, N/m */
} drape_curve;

/* A fabric. Membrane: St. Venant-Kirchhoff on Green strain E, energy per rest area 1/2 e'De with
 * e = (E_uu, E_vv, 2 E_uv); D11 = weft/(1-nu^2), D22 = warp/(1-nu^2), D12 = nu sqrt(weft warp)/(1-nu^2),
 * D33 = shear, where nu = poisson is the geometric mean of the two Poisson ratios. A curve replaces its
 * one stiffness, which is then not read; beside any curve poisson must be 0, as D12 has no meaning there.
 * Bending: plate rigidities on the curvatures (k_uu, k_vv, 2 k_uv): diag(weft, warp, twist). */
typedef struct drape_material {
    double density;       /* kg/m^2, DRAPE_MIN_MATERIAL to DRAPE_MAX_MATERIAL, as the rest */
    double stretch_weft;  /* N/m, > 0 */
    double stretch_warp;  /* N/m, > 0 */
    double stretch_shear; /* N/m, > 0 */
    double poisson;       /* (-1, 1) */
    double bend_weft;     /* N m, >= 0 */
    double bend_warp;     /* N m, >= 0 */
    double bend_twist;    /* N m, >= 0; an isotropic plate of Poisson ratio 0 has half of bend_weft */
    drape_curve curve_weft, curve_warp, curve_shear; /* errors name them as stretch_weft and so on */
    double friction; /* Coulomb's coefficient against bodies, to DRAPE_MAX_FRICTION; 0: the bodies' own */
    double shrink_weft, shrink_warp; /* how much shorter it rests than it was cut, +-DRAPE_MAX_SHRINK of the
                                      * pattern; strains are told from there, and it weighs what was cut; 0 */
} drape_material;

/* Processors that sims share. A running sim uses one; while there is one that none uses, it borrows that,
 * some milliseconds at a time, for half of its linear algebra, of its distances to bodies and of its searches
 * for cloth near cloth. So does a field in the making. What comes out is the same to the last bit. Lent by
 * `count` / 2 threads, or as many as the system grants, which wait meanwhile and leave with
 * drape_processors_free. One lock inside; any thread. */
typedef struct drape_processors drape_processors;

/* NULL: out of memory. */
drape_processors *drape_processors_new(size_t count);
drape_processors *
drape_processors_free(drape_processors *processors); /* no sim uses them; NULL is fine; returns NULL */

/* A closed mesh as a signed distance, which takes about a second to build for 27 000 triangles. Immutable,
 * and shareable by scenes and threads: references are counted, and the last one given back frees it. */
typedef struct dr_field drape_field;

typedef enum drape_body_kind {
    DRAPE_BODY_MESH = 0, /* closed triangle mesh, outward normals; a few self-crossings are fine */
    DRAPE_BODY_SPHERE,
    DRAPE_BODY_PLANE, /* solid on the side away from the normal */
    DRAPE_BODY_CAPSULE
} drape_body_kind;

/* An obstacle: static, or a mesh that moves before the drape and then stands in the last of its keyframes,
 * postures of the same triangles. Only the members of its kind are read. */
typedef struct drape_body {
    drape_body_kind kind;
    double offset;   /* m, > 0: cloth starts to feel the body this far from its surface */
    double friction; /* Coulomb's coefficient, 0 to DRAPE_MAX_FRICTION, of the fabrics that say none */
    const double *positions;  /* MESH: 3*vertices */
    const uint32_t *triangle; /* MESH: 3*triangles */
    size_t vertices, triangles;
    /* MESH: what drape_field_new made of these very arrays (where it moves, with the last keyframe for its
     * positions), which are then not checked again; the scene takes a reference of its own. NULL: the scene
     * builds it. */
    drape_field *field;
    double point[3];               /* SPHERE centre; PLANE any point of it; CAPSULE one end of the axis */
    double axis[3];                /* PLANE outward normal, any length > 0; CAPSULE the other end */
    double radius;                 /* SPHERE, CAPSULE: m, > 0 */
    size_t keyframes;              /* MESH: to DRAPE_MAX_KEYFRAMES; 0: it does not move */
    const double *const *keyframe; /* MESH: keyframes pointers to 3*vertices */
    double motion_seconds;         /* s, from `positions` to the last keyframe, DRAPE_MIN_MOTION to
                                    * DRAPE_MAX_MOTION; read with keyframes only */
} drape_body;

/* Checks the arrays of a MESH and builds its field; *ret is one reference, the caller's. `number` is the
 * body's in its scene, for the error. `processors` (NULL: none) may lend one for the time, without a
 * difference to the field. */
drape_status drape_field_new(const drape_body *body, size_t number, drape_processors *processors,
                             drape_field **ret, drape_error *reterr);
drape_field *drape_field_ref(drape_field *field);   /* one reference more; returns the field */
drape_field *drape_field_unref(drape_field *field); /* gives one back; NULL is fine; returns NULL */
size_t drape_field_bytes(const drape_field *field);

/* Whether cloth feels cloth. AUTO decides from the scene, and the report's plan says what it decided: it
 * does where there are seams, bodies or several separate pieces; else it does not, nor by
 * DRAPE_METHOD_NEWTON, which takes its steps whole. ON is refused with that method. */
typedef enum drape_self_contact {
    DRAPE_SELF_CONTACT_AUTO = 0,
    DRAPE_SELF_CONTACT_ON,
    DRAPE_SELF_CONTACT_OFF
} drape_self_contact;

/* Whether the cloth is sewn, or where nothing has to be sewn draped, on an automatically coarsened mesh
 * first, of about a ninth of its triangles (solver/coarsen.h), and begins from there. The result is of the
 * whole mesh either way; the report's plan says what was decided. Only cloth that starts where its pieces
 * were placed, among bodies that stand, has a coarse mesh. Where the coarse cloth does not come out well, or
 * crosses itself once carried up, all begins anew without. From DRAPE_COARSE_FROM triangles on AUTO does it
 * where there are open seams, all of one garment; and by DRAPE_METHOD_AUTO where nothing has to be sewn, nor
 * a body touched, and all triangles start in one plane. SEWN is AUTO but for the latter: it saves the scene a
 * mesh that no other method would use. */
#define DRAPE_COARSE_FROM 2000
typedef enum drape_coarse {
    DRAPE_COARSE_AUTO = 0,
    DRAPE_COARSE_ON,
    DRAPE_COARSE_OFF,
    DRAPE_COARSE_SEWN
} drape_coarse;

/* A tape along edges of the cloth: a bar on each, of rest length R = factor times the edge's pattern length
 * (as cut), with the energy stiffness R/2 (l/R - 1)^2 at length l. It pulls with `stiffness` newtons per unit
 * of elongation, however fine the mesh, and pushes alike where it is longer than the cloth. */
typedef struct drape_elastic {
    const uint32_t *edge; /* 2*edges: vertices that are two corners of one triangle; one named twice has two
                           * bars */
    size_t edges;
    double factor;    /* DRAPE_MIN_FACTOR to DRAPE_MAX_FACTOR: below 1 it gathers, above it flares */
    double stiffness; /* N, DRAPE_MIN_MATERIAL to DRAPE_MAX_MATERIAL */
} drape_elastic;

/* A crease or pleat along edges that have cloth on both sides, seams included. `angle` is the angle between
 * the normals of the two sides that the fold wants, positive where the edge is a mountain seen from where the
 * normals point (where a seam joins cloth of unlike orientation, from the side whose vertices are named).
 * Energy per metre: stiffness/2 (angle - rest)^2, in series with the bending of the cloth between the edge
 * and the middles of its two triangles. Bending passes no moment across a fold: it is the only spring there.
 * Angles are told apart over a whole turn around rest/2, so that a fold of 180 degrees reaches past itself to
 * 270, and back to -90. */
typedef struct drape_fold {
    const uint32_t *edge; /* 2*edges, as of an elastic */
    size_t edges;
    double angle;     /* rad, -pi to pi */
    double stiffness; /* N m per rad and metre of edge, DRAPE_MIN_MATERIAL to DRAPE_MAX_MATERIAL */
} drape_fold;

/* A stitch that holds a cloth vertex at a point of a body by DRAPE_TACK_STIFFNESS. A point that lies nearer
 * to the surface than the body's offset, or within DRAPE_REACH below it, is lifted to the offset, where cloth
 * can lie. Cloth starts wherever it likes and is pulled there; sewing pulls, too. */
typedef struct drape_tack {
    uint32_t vertex;
    uint32_t body;
    uint32_t triangle;     /* of a MESH, whose points `barycentric` tells; DRAPE_NO_TRIANGLE: `point` */
    double barycentric[2]; /* weights of the triangle's first two corners, >= 0 and at most 1 together */
    double point[3];       /* m; read without a triangle, which a body that moves must have */
} drape_tack;

#define DRAPE_NO_TRIANGLE UINT32_MAX

/* A motion. Straight lines lead each vertex from posture to posture, which follow each other evenly in time;
 * the whole begins and ends gently (3 u^2 - 2 u^3 of the time). Meanwhile the cloth, sewn by then, follows by
 * plain dynamics: backward Euler with a little air, starting each step from where the body carries it (see
 * drape_carry). Pins stay where they are. Where the time limit strikes or the run is cancelled on the way,
 * the cloth is carried to the last keyframe at once. With max_iterations 0 nothing moves, and the start is
 * evaluated against the last keyframe. */
#define DRAPE_MAX_KEYFRAMES  32
#define DRAPE_MIN_MOTION     0.01 /* s */
#define DRAPE_MAX_MOTION     60   /* s */
#define DRAPE_DEFAULT_MOTION 1.0  /* s, unless the scene says otherwise */

/* All arrays, the points of curves too, are the caller's and are copied; none need outlive
 * drape_scene_new. */
typedef struct drape_scene_desc {
    size_t vertices, triangles, seams, pins, materials, bodies;
    const double *positions;           /* 3*vertices: the start */
    const double *pattern;             /* 2*vertices: flat rest shape, m */
    const uint32_t *triangle;          /* 3*triangles */
    const uint32_t *seam;              /* 2*seams: vertices sewn together (a vertex to itself: nothing);
                                        * NULL if none */
    const uint32_t *pin;               /* pins: vertices held where they start; NULL if none */
    const drape_material *material;    /* materials, at least one */
    const uint32_t *triangle_material; /* triangles; NULL: material 0 everywhere */
    const drape_body *body;            /* bodies; NULL if none */
    size_t elastics, folds, tacks;
    const drape_elastic *elastic;    /* elastics; NULL if none */
    const drape_fold *fold;          /* folds; NULL if none */
    const drape_tack *tack;          /* tacks, not of pinned vertices; NULL if none */
    double gravity[3];               /* m/s^2 */
    drape_self_contact self_contact; /* DRAPE_SELF_CONTACT_AUTO */
    drape_coarse coarse;             /* DRAPE_COARSE_AUTO */
    double thickness;                /* m: cloth feels cloth this far away, from middle to middle;
                                      * DRAPE_MIN_THICKNESS to DRAPE_MAX_THICKNESS */
    const double *start_pattern;     /* 2*vertices: the start is a finished drape of this pattern. Friction
                                      * holds it from the first, and where `pattern` is another the rest shape
                                      * goes there from this one, in steps if far (solver/ramp.h). NULL: the
                                      * start is where pieces were placed */
} drape_scene_desc;

/* A description with no arrays, the default gravity 0 -9.81 0 and the default thickness. */
drape_scene_desc drape_scene_desc_default(void);

/* m. The least is a hundredth of the finest fabric, the most thicker than a quilt: past them lies a length
 * in the wrong unit. */
#define DRAPE_DEFAULT_THICKNESS 0.002
#define DRAPE_MIN_THICKNESS     1e-5
#define DRAPE_MAX_THICKNESS     0.05

/* The distance at which a body is felt, unless the scene says otherwise (m). */
#define DRAPE_DEFAULT_OFFSET 0.003

/* Sizes past which a scene is refused (the arrays are indexed with 32 bits; see solver/scene.c). */
#define DRAPE_MAX_VERTICES  1000000
#define DRAPE_MAX_TRIANGLES 2000000
#define DRAPE_MAX_BODIES    16

/* Elastics, and folds, of a scene; and the edges of all of either together. */
#define DRAPE_MAX_LINES      10000
#define DRAPE_MAX_LINE_EDGES 1000000

/* How far from its surface a body is resolved (m): what is farther away neither feels nor measures it. */
#define DRAPE_REACH 0.03

/* Magnitudes past which numbers are refused as absurd, so that no square or product leaves the range of
 * a double: coordinates (m, pattern too), gravity (m/s^2), and the least and largest density, stretch and
 * bending of a material in its SI unit (bending may be 0). */
#define DRAPE_MAX_COORDINATE 1e6
#define DRAPE_MAX_GRAVITY    1e6
#define DRAPE_MIN_MATERIAL   1e-12
#define DRAPE_MAX_MATERIAL   1e12

/* Cloth on skin has 0.2 to 0.6; ten times that is glue. */
#define DRAPE_MAX_FRICTION 10

/* Rest length of an elastic over its edges' pattern length, and the part that cloth may shrink or give by. */
#define DRAPE_MIN_FACTOR 0.1
#define DRAPE_MAX_FACTOR 2
#define DRAPE_MAX_SHRINK 0.5

/* N/m: a kilogram hangs 0.1 mm below its tack, and skin's penalty moves it by hundredths. */
#define DRAPE_TACK_STIFFNESS 1e5

/* Everything that drape_scene_new would refuse except what only building the bodies' distance
 * fields can tell; costs O(n log n) time in the input. For the border of a service. */
drape_status drape_scene_check(const drape_scene_desc *desc, drape_error *reterr);

#define DRAPE_MAX_WARNINGS 16

/* What a checked scene does that is allowed but hardly meant, each with status DRAPE_OK and its place, into
 * ret (the first DRAPE_MAX_WARNINGS; *ret_count has how many there are in all):
 *   - seams whose sides are sewn in crossed directions, or that join a piece wound inside out. Pairs that
 *     follow each other along edges of the cloth count as one seam, told of at its first pair;
 *   - triangles whose neighbours run round the other way. The mechanics do not mind either, but there is
 *     then no outer side: normals disagree.
 * Costs about as much as drape_scene_check. */
drape_status drape_scene_warnings(const drape_scene_desc *desc, drape_error ret[DRAPE_MAX_WARNINGS],
                                  size_t *ret_count, drape_error *reterr);

/* Compiles the scene: welds, measures the rest shape, builds the bodies' distance fields (about a
 * second for a mesh of 27 000 triangles). */
drape_status drape_scene_new(const drape_scene_desc *desc, drape_scene **ret, drape_error *reterr);
drape_scene *drape_scene_free(drape_scene *scene); /* NULL is fine; returns NULL */

/* Takes cloth along with a body mesh that changes its posture or its size: each point keeps its place in the
 * frame of the body triangle nearest to it, evened out over the cloth and its seams so that neighbours which
 * follow different limbs stay together. `positions` (3*desc->vertices, in and out) is where the cloth is; of
 * `desc` the counts, triangles and seams are read. `to` has the vertices and the triangles of `from`. A start
 * for a drape, not a drape: a millimetre or two off where the body bends, and blind to other bodies. */
drape_status drape_carry(const drape_scene_desc *desc, const drape_body *from, const drape_body *to,
                         double *positions, drape_error *reterr);

/* ---- what jobs share ------------------------------------------------------------------------ */

/* Elimination orders and symbolic factors of step matrices, kept for the next sim whose cloth has the same
 * triangles, seams and pins, whatever its fabric, pattern and place. They depend on nothing else, so that a
 * run is the same to the last bit with them and without. Only the matrix that a phase begins with is looked
 * for: places that cloth touching itself adds are analysed as they come. One lock inside; any thread. */
typedef struct drape_analyses drape_analyses;

typedef struct drape_analyses_counts {
    uint64_t hits, misses; /* of matrices looked for */
    size_t bytes;          /* held */
} drape_analyses_counts;

/* Past `max_bytes` those used longest ago are let go. NULL: out of memory. */
drape_analyses *drape_analyses_new(size_t max_bytes);
drape_analyses *
drape_analyses_free(drape_analyses *analyses); /* no sim uses it; NULL is fine; returns NULL */
drape_analyses_counts drape_analyses_count(drape_analyses *analyses);

/* ---- options -------------------------------------------------------------------------------- */

typedef enum drape_method {
    DRAPE_METHOD_AUTO = 0,            /* the mixed-stress Newton of solver/mixed.c */
    DRAPE_METHOD_STOP_AND_GO,         /* [VMT07]: undamped dynamics, all velocities cut at each stop */
    DRAPE_METHOD_DYNAMIC,             /* plain dynamics, never stopped */
    DRAPE_METHOD_VELOCITY_CORRECTION, /* [VMT07]'s other baseline: dynamics in which each node drops what of
                                       * its velocity runs against its force: v -= (v.f) f/|f|^2 where
                                       * v.f < 0, at each state, whose kinetic energy is then what is left */
    DRAPE_METHOD_QUASI_STATIC, /* [VMT07] eq. 2: backward Euler that forgets its velocities at each step */
    DRAPE_METHOD_NEWTON        /* [VMT07] eq. 3: Newton on the statics */
} drape_method;

/* How stop-and-go, dynamic and velocity-correction step in time. RK4 is explicit: no Jacobian, no
 * factorisation, and time steps that must resolve the fastest wave in the mesh. */
typedef enum drape_integrator {
    DRAPE_BACKWARD_EULER = 0,
    DRAPE_BDF2,
    DRAPE_IMPLICIT_MIDPOINT,
    DRAPE_RK4
} drape_integrator;

typedef enum drape_stop_rule {
    DRAPE_STOP_ON_POTENTIAL = 0, /* when the potential energy passes a minimum [VMT07] */
    DRAPE_STOP_ON_KINETIC        /* when the kinetic energy passes a maximum [VMT07] */
} drape_stop_rule;

typedef struct drape_energies { /* joules */
    double stretch;             /* elastics included */
    double bend;                /* folds included */
    double gravity;             /* relative to the start */
    double contact;             /* the penalty, what friction has stored, and the tacks */
    double kinetic;
    double potential; /* stretch + bend + gravity + contact */
} drape_energies;

typedef enum drape_phase {
    DRAPE_PHASE_SEWING = 0,
    DRAPE_PHASE_MOVING, /* rows count frames of the motion */
    DRAPE_PHASE_DRAPING,
    DRAPE_PHASE_CERTIFYING, /* rows repeat the iteration they start from */
    DRAPE_PHASE_RAMPING,    /* before draping: from the pattern of the start, see drape_scene_desc */
    DRAPE_PHASE_COARSE      /* before draping: of the coarse cloth, see drape_coarse */
} drape_phase;

#define DRAPE_PHASES (DRAPE_PHASE_COARSE + 1)

/* One iteration; row 0 is the start (after sewing and ramp). Where cloth that has not to be sewn was draped
 * coarse, row 1 is what was carried up. One row of the trace. */
typedef struct drape_row {
    uint32_t iteration;
    double seconds; /* since drape_sim_run began, sewing included */
    drape_energies energy;
    double residual_energy;     /* J: E - E* where the report has reference_rows. Else an
                                 * estimate, half the Newton decrement 1/2 f'A^-1 f with the step matrix A. A
                                 * holds M/dt^2, so the estimate is low while slow modes are left: 5 to 100
                                 * times on the paper's square until it hangs still. NAN where there is none:
                                 * rk4, newton where its Jacobian is indefinite, the start of what was draped
                                 * coarse, and where the time limit left no time for the factorisation */
    double residual_force;      /* max over free nodes of |f_i| / (mean node mass * |g|) */
    bool stop;                  /* all velocities were cut to zero at this state */
    double time_step;           /* s */
    uint32_t linear_iterations; /* back-solves of the step that led here */
    uint32_t factorizations;    /* attempted since the last row, failed ones included; row 0 has its own. All
                                 * rows together have those of the report but for the ones of sewing, motion
                                 * and ramp */
} drape_row;

typedef struct drape_progress {
    drape_phase phase;
    drape_row row;   /* while sewing: iteration counts sewing steps, energies as far as known; while
                      * bodies move: frames */
    uint32_t stops;  /* so far */
    double seam_gap; /* m: largest distance between vertices of one seam; 0 once welded */
} drape_progress;

/* Runs on the solving thread after each iteration and must not call into the same sim except
 * drape_sim_cancel. Nonzero cancels. */
typedef int drape_progress_fn(const drape_progress *progress, void *data);

/* The cloth at the vertices of the coarse mesh of drape_coarse: a look at the drape, long before it rests.
 * All is lent until the callback returns. */
typedef struct drape_preview {
    size_t vertices, triangles, seams;
    const double *positions;  /* 3*vertices */
    const uint32_t *vertex;   /* vertices: of the scene's, each */
    const uint32_t *triangle; /* 3*triangles, of these vertices */
    const uint32_t *seam;     /* 2*seams, likewise */
} drape_preview;

/* Runs on the solving thread: once the coarse cloth is sewn or, where nothing has to be sewn, at rest; and
 * after iterations 1, 2, 4, 8 and so on of the whole cloth. Only where there is a coarse mesh. */
typedef void drape_preview_fn(const drape_preview *preview, void *data);

typedef struct drape_options {    /* start from drape_options_default() */
    drape_method method;          /* DRAPE_METHOD_AUTO */
    drape_stop_rule stop_on;      /* DRAPE_STOP_ON_POTENTIAL; read by stop-and-go only */
    drape_integrator integrator;  /* DRAPE_BACKWARD_EULER; read by methods that step in time */
    double time_step;             /* s, DRAPE_MIN_TIME_STEP to DRAPE_MAX_TIME_STEP; 0.02 */
    double air_damping;           /* 1/s, >= 0: force -air_damping M v; 0. Backward Euler only */
    double material_damping;      /* s, >= 0: force -material_damping H v; 0. Backward Euler only */
    bool line_search;             /* newton halves a step that raises the potential; false: as published */
    bool certify;                 /* carry rest on to round-off and prove it a minimum; false */
    bool fit;                     /* measure how the drape fits, see drape_fit; false */
    double tolerance;             /* at rest when residual_force <= tolerance, > 0; 1e-3 */
    uint32_t max_iterations;      /* of draping, <= DRAPE_MAX_ITERATIONS; 2000. 0: evaluate the start only */
    double time_limit;            /* s of wall time, > 0; 120: see below */
    size_t memory_limit;          /* bytes, see below; 0: none */
    drape_analyses *analyses;     /* to take from and to add to, which must outlive the sim; may be NULL */
    drape_processors *processors; /* to borrow one from, which must outlive the sim; may be NULL */
    drape_progress_fn *progress;  /* may be NULL */
    void *progress_data;
    drape_preview_fn *preview; /* may be NULL */
    void *preview_data;
} drape_options;

/* The time limit. The clock is looked at between iterations and before each factorisation, the long part of
 * an iteration of a large scene. One that cannot be expected to end in time is not begun, unless it should
 * take less than a second; the run then ends there and says so, be it with the start as its result. What to
 * expect follows from the count of operations and from how fast the last factorisation went; before there is
 * one, from 5e9 operations a second (newton: 1e9). So a run overruns its limit by the rest of one iteration
 * (2 s at 200 000 triangles) and by what a factorisation takes longer than expected. */

/* The memory limit. What scene and sim hold is looked at once an iteration and before each factorisation,
 * that of the factor included, whose size is known then; past the limit the run ends with DRAPE_ENOMEM, at
 * option memory_limit, and without a result. Counted is as in drape_report.peak_bytes, but for a phase's own
 * few arrays of nodes; what is lent for a moment is not (CHOLMOD's analysis takes as much as its matrix). */

#define DRAPE_MAX_ITERATIONS 100000
#define DRAPE_MIN_TIME_STEP  1e-6 /* s */
#define DRAPE_MAX_TIME_STEP  1e3  /* s */

drape_options drape_options_default(void);

/* Everything drape_sim_new would refuse about options. For the border of a service. */
drape_status drape_options_check(const drape_options *options, drape_error *reterr);

/* Everything drape_scene_check and drape_options_check would refuse, and what scene and options refuse of
 * each other, as drape_sim_new does. */
drape_status drape_check(const drape_scene_desc *desc, const drape_options *options, drape_error *reterr);

const char *drape_method_name(drape_method method);             /* "stop-and-go": as in the HTTP contract */
const char *drape_integrator_name(drape_integrator integrator); /* "backward-euler": likewise */

/* The bytes that scene and sim will hold, as drape_report.peak_bytes counts them, told from sizes before
 * anything is built: O(triangles of cloth and bodies). For the border of a service; `desc` must have passed
 * drape_check. Within a fifth of what it comes to, for squares and skirts of 500 to 60 000 triangles and for
 * sewn garments on a body; many layers in one place may take more. Not in it: building the field of a body
 * takes nearly four times the field, which is over before there is a sim. */
size_t drape_memory_estimate(const drape_scene_desc *desc, const drape_options *options);

/* ---- solving -------------------------------------------------------------------------------- */

/* `scene` must outlive the sim; `options` is copied. All memory the iterations need is allocated
 * here or in the first iteration of each phase. */
drape_status drape_sim_new(const drape_scene *scene, const drape_options *options, drape_sim **ret,
                           drape_error *reterr);
drape_sim *drape_sim_free(drape_sim *sim); /* NULL is fine; returns NULL */

/* Sews, follows the bodies' motion, then drapes until rest or until a budget is spent. Call once. The calling
 * thread's OpenMP nesting is switched off (CHOLMOD's own parallel regions made it six times slower). */
drape_status drape_sim_run(drape_sim *sim, drape_error *reterr);

/* Any thread, any time; a flag read once an iteration. */
void drape_sim_cancel(drape_sim *sim);

typedef enum drape_verdict {
    DRAPE_VERDICT_NOT_AT_REST = 0,
    DRAPE_VERDICT_AT_REST,
    DRAPE_VERDICT_SLID_OFF,    /* a piece that nothing holds fell below every body */
    DRAPE_VERDICT_INTERSECTING /* a node ended deeper than 1 mm inside a body, or the cloth passes through
                                * itself (told only where self-contact is kept) */
} drape_verdict;

const char *drape_verdict_name(drape_verdict verdict); /* "at-rest": the name the HTTP contract uses */

/* One term of the plan, which is compiled from scene and options before the first step: what this run needs,
 * what it leaves out, and why. What is left out costs neither an instruction nor a byte. */
typedef struct drape_term {
    const char *name; /* "stretch", "bend", "contact", "jacobian", ... */
    bool kept;
    size_t bytes;       /* the most that it held; every byte of scene and sim belongs to one term */
    const char *reason; /* static string: "no body in the scene"; "" when kept */
} drape_term;

#define DRAPE_MAX_TERMS 24

/* What became of options.certify. From rest, Newton on the true Hessian H (bodies included) goes on to
 * round-off; there Cholesky of H less a bound of its own round-off proves a strict local minimum. Where H has
 * negative curvature, the cloth is pushed along it and draped on. The trace stays the method's, and so do the
 * report's iterations, factorizations and solves: what the certificate took is told here. */
typedef struct drape_certificate {
    bool certified;
    const char *reason;      /* static string: why, or why not; NULL: not asked for */
    double largest_move;     /* m: max over nodes of |H^-1 f|, to first order what is left to go */
    double energy_left;      /* J: 1/2 f'H^-1 f, likewise. Both NAN where H never was positive definite */
    double curvature;        /* 1/s^2: certified, H - curvature M is positive definite, too: no swing about
                              * rest is slower than 2 pi/sqrt(curvature) s, if > 0. Else the most negative
                              * curvature d'Hd/d'Md met; 0: none */
    uint32_t escapes;        /* pushes along negative curvature */
    uint32_t steps;          /* of Newton */
    uint32_t factorizations; /* failed ones included */
} drape_certificate;

typedef struct drape_stage { /* where the seconds went */
    const char *name;        /* "sew", "assemble", "factorise", ... */
    double seconds;
} drape_stage;

#define DRAPE_MAX_STAGES 16

/* What the stages "factorise" and "solve" had to do at least; 0 for rk4. */
typedef struct drape_work {
    double factor_flops; /* floating-point operations of the factorisations; one that failed counts whole */
    double solve_bytes;  /* of the factor, read twice by each back-solve */
} drape_work;

#define DRAPE_NOT_COUNTED UINT32_MAX

/* Valid after drape_sim_run returned >= 0. Plain data, no pointers to free. */
typedef struct drape_report {
    drape_verdict verdict;
    const char *reason;          /* static string: why it ended */
    drape_method method;         /* the one that ran; AUTO: the mixed-stress Newton, to the end */
    drape_stop_rule stop_on;     /* the rule that ran */
    drape_integrator integrator; /* the one that ran */
    uint32_t iterations, stops, factorizations, solves;
    uint32_t sewing_iterations; /* of the coarse cloth where there is one */
    size_t coarse_triangles;    /* 0: there is no coarse cloth */
    bool coarse_carried;        /* the cloth began from there; false: there is none, or it began anew */
    uint32_t coarse_iterations, coarse_factorizations; /* of draping and of all it took, beside those above */
    uint32_t motion_frames;                            /* steps in time while bodies moved; 0: none did */
    double seam_gap; /* m: largest gap left when the seams were welded; 0 without seams */
    double change;   /* from start_pattern to pattern: the largest relative change of a length; 0 without */
    uint32_t ramp_steps, ramp_iterations; /* in which that was made, and what they took beside `iterations` */
    double seconds;
    double borrowed_seconds; /* of a second processor, see drape_processors */
    drape_row state;         /* the row of the state that drape_sim_positions returns; certified, its
                              * residual_energy is the certificate's energy_left */
    drape_certificate certificate;
    /* The rows tell E - E* of the certified minimum. Not with friction, whose anchors are renewed: then the
     * rows are of different energies. */
    bool reference_rows;
    uint32_t penetrations;    /* nodes inside a body (distance < 0) in that state */
    double deepest;           /* m: depth of the deepest of them; 0 when none */
    double drop;              /* m: slid off, how much lower than when draping began the highest point of the
                               * fallen piece is, along gravity; of several the farthest. Else 0 */
    size_t nodes, free_nodes; /* after welding */
    size_t triangles;
    size_t phase_bytes[DRAPE_PHASES]; /* by drape_phase: held by scene and sim together while it ran; 0: it
                                       * did not. A shared field is counted whole, ramping in draping */
    size_t peak_bytes;                /* the most of them: less than the terms' sum where there is more than
                                       * one, as each gives back what only it needs */
    /* Edges of the cloth through its triangles in that state; DRAPE_NOT_COUNTED without self-contact. */
    uint32_t self_intersections;
    /* m: where the deepest node inside a body is, else where the first self-intersection is; else NAN. */
    double intersection[3];
    drape_term term[DRAPE_MAX_TERMS];
    size_t terms;
    drape_work work;
    drape_stage stage[DRAPE_MAX_STAGES];
    size_t stages;
} drape_report;

const drape_report *drape_sim_report(const drape_sim *sim); /* lives as long as the sim */
const drape_row *drape_sim_trace(const drape_sim *sim, size_t *ret_rows);

/* The best state (at rest: the last; else the lowest potential energy seen), in the job's own
 * vertices and order: vertices of one seam share their position exactly. 3*vertices; valid until
 * the sim is freed. With max_iterations 0, the start. */
const double *drape_sim_positions(const drape_sim *sim, size_t *ret_vertices);

/* How the drape of drape_sim_positions fits; of the cloth by triangle, of the bodies by vertex, both in the
 * job's own order. Strain is Green's and stress second Piola's, along the yarns of the pattern: force per
 * rest width over the yarn's stretch l = sqrt(1 + 2E), so that S l is the force that a metre of rest width
 * carries along the stretched yarn. A fabric's limit is the last strain of its curve: elongation l - 1 of
 * weft and warp (nothing of it is used where compressed), |2 E_uv| of shear; NAN stands where there is no
 * curve. The cloth lies on a body at a gap of up to the body's offset. */
typedef struct drape_fit {
    size_t vertices, triangles;
    const double *strain;      /* 3*triangles: E_uu (weft), E_vv (warp), 2 E_uv (shear) */
    const double *stress;      /* 3*triangles, N/m: S_uu, S_vv, S_uv, by curves where the fabric has them */
    const double *utilization; /* 3*triangles: parts of the fabric's limit, see above; NULL without curves */
    const double *pressure;    /* vertices, Pa: what all bodies push with, over the vertex's rest area (that
                                * of all vertices sewn together); 0 where nothing touches */
    const double *gap;         /* vertices, m: distance to the nearest body, < 0 inside; NAN past
                                * DRAPE_REACH and for a vertex of no triangle */
} drape_fit;

/* NULL unless options.fit; valid after drape_sim_run returned >= 0, and lives as long as the sim. */
const drape_fit *drape_sim_fit(const drape_sim *sim);

/* ---- about the library ---------------------------------------------------------------------- */

const char *drape_version(void); /* "0.1.0" */

/* The instruction set of the factor in single precision, which the processor chooses: "AVX-512", "AVX2", or
 * "none" beyond what every machine has. The same job has the same bytes with one of them, not with another.
 */
const char *drape_kernels(void);

/* Sets the BLAS to one thread per caller, process-wide; call once before the first sim, from the
 * main thread. Returns the name of the BLAS kernel in use, e.g. "Haswell" ("Prescott" on a modern
 * machine means that the BLAS did not know it: set OPENBLAS_CORETYPE). Static string. */
const char *drape_blas_prepare(void);

#ifdef __cplusplus
}
#endif

#endif
