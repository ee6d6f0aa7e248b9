/* plan.c - lists the terms that a run kept and left out. */
#include "plan.h"

static void add(drape_report *report, const char *name, bool kept, size_t bytes, const char *reason)
{
    report->term[report->terms++] = (drape_term){name, kept, kept ? bytes : 0, kept ? "" : reason};
}

void dr_plan(struct drape_sim *sim)
{
    const drape_scene *scene = sim->scene;
    drape_report *report = &sim->report;
    size_t body_bytes = 0;
    for (size_t b = 0; b < scene->bodies; b++)
        body_bytes += dr_body_bytes(scene->body[b]);
    const double *g = scene->gravity;

    add(report, "stretch", true, dr_mesh_bytes(scene->mesh), "");
    add(report, "bend", scene->bend != NULL, scene->bend ? dr_bend_bytes(scene->bend) : 0,
        "no material has bending rigidity");
    add(report, "gravity", g[0] != 0 || g[1] != 0 || g[2] != 0, 3 * scene->mesh->nodes * sizeof(double),
        "gravity is zero");
    add(report, "contact", scene->bodies > 0, body_bytes, "no body in the scene");
    add(report, "sewing", report->sewing_iterations > 0,
        scene->pieces ? dr_mesh_bytes(scene->pieces) + dr_bend_bytes(scene->pieces_bend) : 0,
        !scene->seams ? "no seams" : "the seams start closed");
    add(report, "friction", false, 0, "not in this version");
    add(report, "self-contact", false, 0, "not in this version");
    add(report, "jacobian", report->integrator != DRAPE_RK4, 0, "the integrator is explicit");
    add(report, "compressive-stress",
        report->method == DRAPE_METHOD_AUTO || report->method == DRAPE_METHOD_NEWTON, 0,
        "the method keeps its matrix positive semi-definite");
}
