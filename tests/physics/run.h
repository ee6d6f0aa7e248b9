/* run.h - a grid of cloth run through the public interface, with everything a physics test asks of it. */
#ifndef DRAPED_RUN_H
#define DRAPED_RUN_H

#include "drape.h"
#include "grids.h"

/* What a scene is made of; the arrays are the setup's own. */
struct setup {
    struct grid grid;
    double *x;     /* 3*vertices: the start */
    uint32_t *pin; /* room for all vertices */
    drape_material material;
    drape_scene_desc desc; /* points into the rest */
};

/* An isotropic cloth of membrane stiffness k (N/m) and rigidity B (N m), Poisson ratio 0. */
static inline drape_material isotropic(double density, double k, double B)
{
    return (drape_material){.density = density,
                            .stretch_weft = k,
                            .stretch_warp = k,
                            .stretch_shear = k / 2,
                            .bend_weft = B,
                            .bend_warp = B,
                            .bend_twist = B / 2};
}

/* Takes the grid over. The start is the flat rest shape in the plane y = 0: u along x, v along -z, so
 * that with gravity along -y the upper side is the front. Fill pins, then call setup_desc. */
static inline struct setup *setup_new(struct grid grid, drape_material material)
{
    struct setup *setup = calloc(1, sizeof *setup);
    assert_non_null(setup);
    setup->grid = grid;
    setup->material = material;
    setup->x = calloc(3 * grid.vertices, sizeof *setup->x);
    setup->pin = calloc(grid.vertices, sizeof *setup->pin);
    assert_non_null(setup->x);
    assert_non_null(setup->pin);
    for (size_t i = 0; i < grid.vertices; i++) {
        setup->x[3 * i] = grid.uv[2 * i];
        setup->x[3 * i + 2] = -grid.uv[2 * i + 1];
    }
    setup->desc = drape_scene_desc_default();
    setup->desc.vertices = grid.vertices;
    setup->desc.triangles = grid.triangles;
    setup->desc.positions = setup->x;
    setup->desc.pattern = grid.uv;
    setup->desc.triangle = grid.triangle;
    setup->desc.pin = setup->pin;
    setup->desc.material = &setup->material;
    setup->desc.materials = 1;
    return setup;
}

/* Pins the first `columns` columns of points (u smallest). */
static inline void pin_columns(struct setup *setup, size_t columns)
{
    for (size_t j = 0; j <= setup->grid.ny; j++)
        for (size_t i = 0; i < columns; i++)
            setup->pin[setup->desc.pins++] = grid_at(&setup->grid, i, j);
}

/* A grid whose middle column of cells is cut out, its right half laid over the left, 1 mm above it and half
 * a cell aside. */
static inline struct setup *setup_layers(void)
{
    struct setup *setup =
        setup_new(grid_new(GRID_ALTERNATING, 13, 6, 0.26, 0.12, 0), isotropic(0.2, 400, 1e-4));
    const struct grid *grid = &setup->grid;
    size_t kept = 0, columns = grid->nx + 1, half = columns / 2;
    for (size_t t = 0; t < grid->triangles; t++) {
        size_t right = 0;
        for (size_t k = 0; k < 3; k++)
            right += grid->triangle[3 * t + k] % columns >= half;
        if (right % 3 == 0)
            memmove(grid->triangle + 3 * kept++, grid->triangle + 3 * t, 3 * sizeof *grid->triangle);
    }
    setup->desc.triangles = setup->grid.triangles = kept;
    for (size_t i = 0; i < grid->vertices; i++) {
        bool upper = i % columns >= half;
        double *x = setup->x + 3 * i;
        x[0] -= upper ? grid->uv[2 * half] + 0.01 : 0;
        x[1] = 0.0029 + (upper ? 0.001 : 0);
        x[2] += upper ? 0.007 : 0;
    }
    return setup;
}

static inline void setup_free(struct setup *setup)
{
    grid_done(&setup->grid);
    free(setup->x);
    free(setup->pin);
    free(setup);
}

struct run {
    drape_scene *scene;
    drape_sim *sim;
    drape_status status;
    const drape_report *report;
    const drape_row *row; /* the trace */
    size_t rows;
    const double *x; /* 3*vertices: the result */
};

static inline struct run run_new(const drape_scene_desc *desc, const drape_options *options)
{
    struct run run = {0};
    drape_error error = {0};
    size_t vertices;
    drape_blas_prepare();
    run.status = drape_scene_new(desc, &run.scene, &error);
    if (run.status >= 0)
        run.status = drape_sim_new(run.scene, options, &run.sim, &error);
    if (run.status >= 0)
        run.status = drape_sim_run(run.sim, &error);
    if (run.status < 0)
        fail_msg("%s: %s", drape_status_name(run.status), error.message);
    run.report = drape_sim_report(run.sim);
    run.row = drape_sim_trace(run.sim, &run.rows);
    run.x = drape_sim_positions(run.sim, &vertices);
    assert_int_equal(vertices, desc->vertices);
    return run;
}

static inline void run_done(struct run *run)
{
    drape_sim_free(run->sim);
    drape_scene_free(run->scene);
    memset(run, 0, sizeof *run);
}

static inline double total_energy(const drape_row *row)
{
    return row->energy.potential + row->energy.kinetic;
}

#endif
