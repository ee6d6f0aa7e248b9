/* scene.h - what a compiled scene holds: welded mesh, unsewn pieces, bending, bodies. */
#ifndef DR_SCENE_H
#define DR_SCENE_H

#include "bend.h"
#include "body.h"
#include "coarsen.h"
#include "elastic.h"
#include "fold.h"
#include "mesh.h"
#include "tack.h"

/* Seams that start no wider than this are welded at once; sewing pulls wider ones shut to it (m). */
#define DR_WELD_GAP 1e-3

#define DR_COARSER 3 /* edges of the coarse mesh over those of the fine one */

/* Bending rigidity of the pieces while they are being sewn (N m): soft pieces fold in and invert along a
 * seam, stiff ones close cleanly. At 1e-3 a shirt of 12 mm edges left sewing with 58 crossings of its own,
 * one of 30 mm with 26, a dress with 2; at 5e-3 one of 30 mm in poplin with 11, at 1e-2 all with none. From
 * 2e-2 on shirts crossed the body. */
#define DR_SEWING_RIGIDITY 1e-2

/* How a body mesh moves. */
struct dr_path {
    drape_body desc;     /* at its start; the arrays are ours */
    double *positions;   /* 3*vertices * (keyframes + 1), the start first */
    uint32_t *triangle;  /* 3*triangles */
    double longest_move; /* m: of any vertex from one keyframe to the next */
};

struct drape_scene {
    size_t vertices;
    double *positions;     /* 3*vertices: the start */
    uint32_t *vertex_node; /* vertices: node of each; DR_NONE for a vertex of no triangle */
    double *vertex_share;  /* vertices: its weight in its node's position; they sum to 1 */
    size_t seams;
    uint32_t *seam;  /* 2*seams; in the order of the parts where there is a piece_part */
    double seam_gap; /* m: widest seam at the start */
    size_t materials;
    drape_material *material;
    size_t curve_points; /* of all strain-stress curves together */
    double *curve_point; /* 2*curve_points; the materials' curves point into it; NULL: no curve */
    double gravity[3];
    /* As asked for: the plan decides. In m. */
    drape_self_contact self_contact;
    double thickness;
    bool draped;                 /* the start is a drape, of this or another pattern */
    double change;               /* from that pattern to this one, see ramp.h */
    double *old_stretch;         /* 3*triangles: likewise; NULL: there is no change */
    struct dr_mesh *mesh;        /* welded */
    struct dr_bend *bend;        /* NULL: no rigidity anywhere */
    struct dr_mesh *pieces;      /* one node a vertex; NULL: nothing to sew */
    struct dr_bend *pieces_bend; /* NULL with pieces */
    size_t bars, hinges, tacks;
    struct dr_bar *bar;     /* of the elastics, edge by edge; NULL if none, as the next two */
    struct dr_hinge *hinge; /* of the folds, likewise */
    struct dr_tack *tack;
    size_t bodies;
    struct dr_body **body;       /* bodies: as they stand when the cloth is draped */
    struct dr_body **first_body; /* bodies: as they stand when it is sewn; NULL: those above */
    struct dr_path **path;       /* bodies: how each moves, NULL for one that stands; NULL: none moves */
    size_t parts;                /* connected components of the welded mesh */
    uint32_t *part;              /* nodes: component of each */
    bool *part_held;             /* parts: it has a held node, or a tacked one */
    uint32_t *piece_part;        /* vertices: part that each will be in; NULL: one part, or nothing to sew */
    struct dr_coarse *coarse;    /* the way up from a coarse mesh; NULL: there is none */
    drape_scene *coarse_scene;   /* of it; NULL with coarse */
    const char *coarse_left_out; /* static string: why there is none */
    bool coarse_asked_for;       /* DRAPE_COARSE_ON */
    double coarse_seconds;       /* that making both took */
};

/* Bytes held by the scene, and those of them that only motion, or only the coarse mesh, needs. */
size_t dr_scene_bytes(const drape_scene *scene);
size_t dr_scene_motion_bytes(const drape_scene *scene);
size_t dr_scene_coarse_bytes(const drape_scene *scene);

/* Why a scene has no coarse mesh, see drape_coarse; NULL: it gets one, if its mesh lets itself be coarsened.
 * sewn: it has open seams. Several garments are not looked for. */
const char *dr_scene_without_coarse(const drape_scene_desc *desc, bool sewn);

/* Node positions x (3*nodes) for vertex positions v (3*vertices). */
void dr_scene_weld(const drape_scene *scene, const double *v, double *x);

/* And back: v of vertices with a node from x; of others it stays. What is sewn is in one place. */
void dr_scene_unweld(const drape_scene *scene, const double *x, double *v);

#endif
