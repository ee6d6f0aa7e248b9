/* shapes.h - closed meshes for tests: spheres, boxes, and bodies from OBJ files. */
#ifndef DRAPED_TEST_SHAPES_H
#define DRAPED_TEST_SHAPES_H

#include "drape.h"
#include "test.h"

struct shape {
    double *x;          /* 3*vertices */
    uint32_t *triangle; /* 3*triangles, counter-clockwise from outside */
    size_t vertices, triangles;
};

static inline struct shape shape_new(size_t vertices, size_t triangles)
{
    struct shape shape = {calloc(3 * vertices, sizeof(double)), calloc(3 * triangles, sizeof(uint32_t)),
                          vertices, triangles};
    assert_non_null(shape.x);
    assert_non_null(shape.triangle);
    return shape;
}

static inline void shape_free(struct shape *shape)
{
    free(shape->x);
    free(shape->triangle);
    *shape = (struct shape){NULL, NULL, 0, 0};
}

static inline drape_body shape_body(const struct shape *shape)
{
    return (drape_body){.kind = DRAPE_BODY_MESH,
                        .offset = 0.003,
                        .positions = shape->x,
                        .triangle = shape->triangle,
                        .vertices = shape->vertices,
                        .triangles = shape->triangles};
}

/* An axis-aligned box of 12 triangles. */
static inline struct shape shape_box(const double low[3], const double high[3])
{
    static const uint32_t quad[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                        {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    struct shape shape = shape_new(8, 12);
    for (size_t v = 0; v < 8; v++)
        for (size_t d = 0; d < 3; d++)
            shape.x[3 * v + d] = v >> d & 1 ? high[d] : low[d];
    for (size_t q = 0; q < 6; q++) {
        uint32_t *t = shape.triangle + 6 * q;
        t[0] = t[3] = quad[q][0];
        t[1] = quad[q][1];
        t[2] = t[4] = quad[q][2];
        t[5] = quad[q][3];
    }
    return shape;
}

/* A sphere of n x n x 6 x 2 triangles: a cube of squares blown up, its vertices on the sphere. */
static inline struct shape shape_sphere(const double centre[3], double radius, size_t n)
{
    size_t side = n + 1, faces = 6, vertices = 0;
    struct shape shape = shape_new(6 * n * n + 2, 12 * n * n);
    uint32_t *number = calloc(side * side * side, sizeof *number); /* of a cube's surface point, plus 1 */
    assert_non_null(number);
    size_t t = 0;
    for (size_t face = 0; face < faces; face++) {
        size_t axis = face / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        for (size_t i = 0; i < n; i++) {
            for (size_t j = 0; j < n; j++) {
                uint32_t quad[4];
                for (size_t c = 0; c < 4; c++) { /* counter-clockwise seen from +axis */
                    size_t at[3];
                    at[axis] = face % 2 ? n : 0;
                    at[u] = i + (c == 1 || c == 2);
                    at[v] = j + (c >= 2);
                    uint32_t *mark = number + (at[2] * side + at[1]) * side + at[0];
                    if (!*mark) {
                        *mark = (uint32_t)++vertices;
                        double p[3], square = 0;
                        for (size_t d = 0; d < 3; d++) {
                            p[d] = tan((2.0 * (double)at[d] / (double)n - 1) * 0.78539816339744831);
                            square += p[d] * p[d];
                        }
                        for (size_t d = 0; d < 3; d++)
                            shape.x[3 * (vertices - 1) + d] = centre[d] + radius * p[d] / sqrt(square);
                    }
                    quad[c] = *mark - 1;
                }
                const size_t out[6] = {0, 1, 2, 0, 2, 3}, in[6] = {0, 2, 1, 0, 3, 2};
                for (size_t c = 0; c < 6; c++)
                    shape.triangle[3 * t + c] = quad[face % 2 ? out[c] : in[c]];
                t += 2;
            }
        }
    }
    assert_int_equal(vertices, shape.vertices);
    assert_int_equal(t, shape.triangles);
    free(number);
    return shape;
}

/* Both shapes as one mesh; the parts are freed. */
static inline struct shape shape_join(struct shape a, struct shape b)
{
    struct shape both = shape_new(a.vertices + b.vertices, a.triangles + b.triangles);
    memcpy(both.x, a.x, 3 * a.vertices * sizeof *a.x);
    memcpy(both.x + 3 * a.vertices, b.x, 3 * b.vertices * sizeof *b.x);
    memcpy(both.triangle, a.triangle, 3 * a.triangles * sizeof *a.triangle);
    for (size_t i = 0; i < 3 * b.triangles; i++)
        both.triangle[3 * a.triangles + i] = b.triangle[i] + (uint32_t)a.vertices;
    shape_free(&a);
    shape_free(&b);
    return both;
}

static inline void shape_reverse(struct shape *shape)
{
    for (size_t t = 0; t < shape->triangles; t++) {
        uint32_t *corner = shape->triangle + 3 * t, first = corner[0];
        corner[0] = corner[1];
        corner[1] = first;
    }
}

/* The triangles of an OBJ file ("v x y z" and "f a b c" lines); false, loudly, when it is absent. */
static inline bool shape_read(const char *path, struct shape *ret)
{
    FILE *file = fopen(path, "r");
    if (!file) {
        print_message("SKIP: %s is absent\n", path);
        return false;
    }
    char line[256];
    for (int pass = 0; pass < 2; pass++) {
        size_t v = 0, t = 0;
        double x[3];
        unsigned corner[3];
        rewind(file);
        while (fgets(line, sizeof line, file)) {
            if (sscanf(line, "v %lf %lf %lf", &x[0], &x[1], &x[2]) == 3) {
                for (size_t d = 0; pass && d < 3; d++)
                    ret->x[3 * v + d] = x[d];
                v++;
            } else if (sscanf(line, "f %u%*[^ ] %u%*[^ ] %u", &corner[0], &corner[1], &corner[2]) == 3 ||
                       sscanf(line, "f %u %u %u", &corner[0], &corner[1], &corner[2]) == 3) {
                for (size_t d = 0; pass && d < 3; d++)
                    ret->triangle[3 * t + d] = corner[d] - 1;
                t++;
            }
        }
        if (!pass)
            *ret = shape_new(v, t);
    }
    fclose(file);
    return true;
}

#endif
