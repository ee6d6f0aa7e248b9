/* test_pairs.c - near pairs and crossings against looking at everything; closest points against sampling. */
#include "test.h"

#include "pairs.h"
#include "scarce.h"
#include "sheets.h"

/* ---- closest points --------------------------------------------------------------------------- */

/* |r|^2 at parameters (p, q): of the triangle's or of the two edges'. */
static double square_at(const double *x, bool edges, double p, double q)
{
    double square = 0;
    for (int d = 0; d < 3; d++) {
        double r = edges ? x[d] + p * (x[3 + d] - x[d]) - x[6 + d] - q * (x[9 + d] - x[6 + d])
                         : x[d] - x[3 + d] - p * (x[6 + d] - x[3 + d]) - q * (x[9 + d] - x[3 + d]);
        square += r * r;
    }
    return square;
}

/* The least of a function convex in q, given p, by golden section. */
static double least_along(const double *x, bool edges, double p)
{
    double low = 0, high = edges ? 1 : 1 - p, golden = 0.6180339887498949;
    for (int i = 0; i < 60; i++) {
        double a = high - golden * (high - low), b = low + golden * (high - low);
        if (square_at(x, edges, p, a) < square_at(x, edges, p, b))
            high = b;
        else
            low = a;
    }
    return fmin(square_at(x, edges, p, low),
                fmin(square_at(x, edges, p, 0), square_at(x, edges, p, edges ? 1 : 1 - p)));
}

static double least_square(const double *x, bool edges)
{
    double low = 0, high = 1, golden = 0.6180339887498949;
    for (int i = 0; i < 60; i++) {
        double a = high - golden * (high - low), b = low + golden * (high - low);
        if (least_along(x, edges, a) < least_along(x, edges, b))
            high = b;
        else
            low = a;
    }
    return fmin(least_along(x, edges, low), fmin(least_along(x, edges, 0), least_along(x, edges, 1)));
}

static struct dr_closest closest(const double *x, bool edges)
{
    static const uint32_t node[4] = {0, 1, 2, 3};
    return edges ? dr_closest_edge_edge(x, node) : dr_closest_vertex_face(x, node);
}

/* The weights are those of clamped parameters, give r, and the free directions are perpendicular to r. */
static void check_closest(const double *x, bool edges, double size, double tolerance)
{
    struct dr_closest c = closest(x, edges);
    double total = 0, rr = 0;
    for (int i = 0; i < 4; i++) {
        double most = edges ? (i < 2 ? 1 : 0) : i == 0, least = edges ? (i < 2 ? 0 : -1) : i == 0 ? 1 : -1;
        assert_true(c.weight[i] <= most + 1e-15 && c.weight[i] >= least - 1e-15);
        total += c.weight[i];
    }
    assert_near(total, 0, 1e-15, 1);
    for (int d = 0; d < 3; d++) {
        double r = 0;
        for (int i = 0; i < 4; i++)
            r += c.weight[i] * (x[3 * i + d] - x[d]);
        assert_near(r, c.r[d], 1e-12, size);
        rr += c.r[d] * c.r[d];
    }
    assert_near(rr, c.square, 1e-14, size * size * 1e-20);
    assert_near(sqrt(c.square), sqrt(least_square(x, edges)), tolerance, size);
    assert_true(c.free <= 2);
    for (int k = 0; k < c.free; k++) {
        double along = 0, length = 0;
        for (int d = 0; d < 3; d++) {
            double e = x[3 * c.edge[k][0] + d] - x[3 * c.edge[k][1] + d];
            along += e * c.r[d];
            length += e * e;
        }
        assert_true(fabs(along) <= 1e-7 * size * sqrt(length));
    }
}

static void test_closest__random_parts_against_minimisation(void **state)
{
    (void)state;
    uint64_t random = 7;
    size_t free[2][3] = {{0}};
    for (int i = 0; i < 4000; i++) {
        double x[12];
        bool edges = i % 2;
        for (int k = 0; k < 12; k++)
            x[k] = test_random(&random);
        check_closest(x, edges, 1, 2e-8);
        free[edges][closest(x, edges).free]++;
    }
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            assert_true(free[i][k] > 50); /* corners, edges and insides have all been seen */
}

static void test_closest__needles_parallels_and_points(void **state)
{
    (void)state;
    uint64_t random = 11;
    for (int i = 0; i < 4000; i++) {
        double x[12], tilt = pow(10, -1 - 17 * (double)(i % 100) / 100);
        for (int k = 0; k < 12; k++)
            x[k] = test_random(&random);
        for (int d = 0; d < 3; d++) {
            if (i % 4 == 0) /* edges that are nearly parallel */
                x[9 + d] = x[6 + d] + (0.5 + tilt) * (x[3 + d] - x[d]) + tilt * x[9 + d];
            if (i % 4 == 1) /* a needle */
                x[9 + d] = 0.3 * x[3 + d] + 0.7 * x[6 + d] + tilt * x[9 + d];
            if (i % 4 == 2) /* an edge, or a side, of no length */
                x[9 + d] = x[6 + d];
            if (i % 4 == 3) /* a triangle that is a point; two edges in one point */
                x[3 + d] = x[6 + d] = x[9 + d] = i % 8 == 3 ? x[d] : x[9 + d];
        }
        check_closest(x, i % 8 < 4 ? i % 4 != 1 : false, 1, 5e-8);
    }
}

static void test_closest__parallel_edges_meet_in_the_middle_of_their_overlap(void **state)
{
    (void)state;
    const double x[] = {0, 0, 0, 4, 0, 0, 1, 1, 0, 3, 1, 0}; /* overlap 1..3 of 0..4 */
    struct dr_closest c = closest(x, true);
    const double expected[] = {0.5, 0.5, -0.5, -0.5};
    for (int i = 0; i < 4; i++)
        assert_close(c.weight[i], expected[i], 1e-15);
    assert_int_equal(c.free, 1); /* moving both along is no parameter of its own */
    assert_close(c.square, 1, 1e-15);
    const double apart[] = {0, 0, 0, 1, 0, 0, 3, 0, 0, 2, 0, 0}; /* end to end, against each other */
    c = closest(apart, true);
    assert_close(c.square, 1, 1e-15);
    assert_int_equal(c.free, 0);
    assert_close(c.weight[1], 1, 1e-15);
    assert_close(c.weight[3], -1, 1e-15);
}

static void test_closest__nan_and_infinity_are_near_nothing(void **state)
{
    (void)state;
    for (int i = 0; i < 24; i++) {
        double x[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
        x[i % 12] = i < 12 ? (double)NAN : (double)INFINITY;
        assert_false(closest(x, true).square < 1e-6);
        assert_false(closest(x, false).square < 1e-6);
    }
}

/* ---- search ----------------------------------------------------------------------------------- */

static struct dr_pairs *make(const struct dr_mesh *mesh)
{
    struct dr_pairs *pairs = NULL;
    assert_int_equal(dr_pairs_new(mesh, &pairs, NULL), DRAPE_OK);
    return pairs;
}

static bool shares(const uint32_t *p, size_t np, const uint32_t *q, size_t nq)
{
    for (size_t i = 0; i < np; i++)
        for (size_t j = 0; j < nq; j++)
            if (p[i] == q[j])
                return true;
    return false;
}

/* Coordinates so large that the distance to what is near the origin is round-off: such a pair may be listed.
 */
static bool is_wild(const double *x, const uint32_t node[4])
{
    for (size_t i = 0; i < 12; i++)
        if (!(fabs(x[3 * (size_t)node[i / 3] + i % 3]) < 1e9))
            return true;
    return false;
}

/* Every vertex that a triangle has, against every triangle, in the order of the list. */
static size_t check_faces(const struct dr_pairs *pairs, const double *x, double radius)
{
    const struct dr_mesh *mesh = pairs->mesh;
    size_t found = 0;
    for (uint32_t v = 0; v < mesh->nodes; v++) {
        if (pairs->first_side[v] == pairs->first_side[v + 1])
            continue;
        for (uint32_t t = 0; t < mesh->triangles; t++) {
            const uint32_t *corner = mesh->triangle + 3 * (size_t)t;
            const uint32_t node[4] = {v, corner[0], corner[1], corner[2]};
            if (shares(&v, 1, corner, 3) || !(dr_closest_vertex_face(x, node).square < radius * radius))
                continue;
            if (is_wild(x, node) &&
                (found == pairs->face_count || pairs->faces[found].a != v || pairs->faces[found].b != t))
                continue;
            assert_true(found < pairs->face_count);
            assert_int_equal(pairs->faces[found].a, v);
            assert_int_equal(pairs->faces[found].b, t);
            assert_memory_equal(pairs->faces[found].node, node, sizeof node);
            found++;
        }
    }
    assert_int_equal(found, pairs->face_count);
    return found;
}

static size_t check_edges(const struct dr_pairs *pairs, const double *x, double radius)
{
    size_t found = 0;
    for (uint32_t a = 0; a < pairs->sides; a++) {
        for (uint32_t b = a + 1; b < pairs->sides; b++) {
            const uint32_t *p = pairs->side + 2 * (size_t)a, *q = pairs->side + 2 * (size_t)b;
            const uint32_t node[4] = {p[0], p[1], q[0], q[1]};
            if (shares(p, 2, q, 2) || !(dr_closest_edge_edge(x, node).square < radius * radius))
                continue;
            if (is_wild(x, node) &&
                (found == pairs->edge_count || pairs->edges[found].a != a || pairs->edges[found].b != b))
                continue;
            assert_true(found < pairs->edge_count);
            assert_int_equal(pairs->edges[found].a, a);
            assert_int_equal(pairs->edges[found].b, b);
            assert_memory_equal(pairs->edges[found].node, node, sizeof node);
            found++;
        }
    }
    assert_int_equal(found, pairs->edge_count);
    return found;
}

/* Gives how many pairs there are. */
static size_t check_find(struct dr_pairs *pairs, const double *x, double radius)
{
    assert_int_equal(dr_pairs_find(pairs, x, radius, NULL), DRAPE_OK);
    assert_true(pairs->radius == radius);
    return check_faces(pairs, x, radius) + check_edges(pairs, x, radius);
}

static void test_pairs__edges_of_the_mesh_are_each_listed_once(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(5, 2, 0.01, 0.1);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    assert_int_equal(pairs->sides, 2 * (2 * 5 * 6 + 25));
    assert_int_equal(pairs->first_side[mesh->nodes], 2 * pairs->sides);
    for (uint32_t v = 0; v < mesh->nodes; v++) {
        for (uint32_t i = pairs->first_side[v]; i < pairs->first_side[v + 1]; i++) {
            const uint32_t *end = pairs->side + 2 * (size_t)pairs->node_side[i];
            assert_true(end[0] == v || end[1] == v);
        }
    }
    for (size_t e = 0; e < pairs->sides; e++) {
        assert_true(pairs->side[2 * e] < pairs->side[2 * e + 1]);
        for (int k = 0; k < 2; k++) {
            uint32_t t = pairs->side_triangle[2 * e + (size_t)k];
            if (k == 0)
                assert_true(t != DR_NONE);
            if (t != DR_NONE)
                for (int i = 0; i < 2; i++)
                    assert_true(
                        dr_pairs_shares_node(mesh->triangle + 3 * (size_t)t, pairs->side[2 * e + (size_t)i]));
        }
    }
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_pairs__crumpled_sheets_against_everything(void **state)
{
    (void)state;
    uint64_t random = 3;
    struct shape shape = sheets_stack(9, 2, 0.01, 0.004);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    const double radius[] = {0.006, 0.0005, 0.006, 0.009};
    for (int i = 0; i < 4; i++) { /* the tree keeps the shape of the first, however wild the rest */
        assert_true(check_find(pairs, shape.x, radius[i]) > 20);
        sheets_shake(&shape, 0.005, &random);
    }
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

/* `list` is sorted, with no pair twice, and has all of `part`. */
static void check_includes(const struct dr_pair *list, size_t count, const struct dr_pair *part, size_t parts)
{
    size_t found = 0;
    for (size_t i = 0; i < count; i++) {
        assert_true(!i || list[i - 1].a < list[i].a ||
                    (list[i - 1].a == list[i].a && list[i - 1].b < list[i].b));
        if (found < parts && list[i].a == part[found].a && list[i].b == part[found].b) {
            assert_memory_equal(list + i, part + found, sizeof *list);
            found++;
        }
    }
    assert_int_equal(found, parts);
}

/* Two layers 12 mm apart: one bulges towards the other, then both go a metre away. */
static void test_pairs__what_has_come_near_is_added(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(20, 2, 0.01, 0.012);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh), *afresh = make(mesh);
    size_t coordinates = 3 * mesh->nodes, most = 0;
    double *x = malloc(coordinates * sizeof *x);
    assert_non_null(x);
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.008, NULL), DRAPE_OK);
    for (int step = 0; step <= 10; step++) {
        for (size_t v = 0; v < mesh->nodes; v++) {
            const double *o = shape.x + 3 * v;
            double a = (o[0] - 0.04) / 0.02, b = (o[2] - 0.04) / 0.02;
            bool upper = v >= mesh->nodes / 2;
            memcpy(x + 3 * v, o, 3 * sizeof *x);
            x[3 * v] += step == 10;
            x[3 * v + 1] -= upper ? 0.001 * step * exp(-a * a - b * b) : 0;
        }
        assert_true(dr_pairs_add(pairs, shape.x, x, 0.006));
        assert_int_equal(dr_pairs_find(afresh, x, 0.006, NULL), DRAPE_OK);
        check_includes(pairs->faces, pairs->face_count, afresh->faces, afresh->face_count);
        check_includes(pairs->edges, pairs->edge_count, afresh->edges, afresh->edge_count);
        most = afresh->face_count > most ? afresh->face_count : most;
    }
    assert_true(most > 10);
    uint64_t random = 5;
    memcpy(x, shape.x, coordinates * sizeof *x);
    sheets_shake(&shape, 0.005, &random);
    assert_false(dr_pairs_add(pairs, x, shape.x, 0.006)); /* nothing moves as one */
    free(x);
    dr_pairs_free(pairs);
    dr_pairs_free(afresh);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_pairs__a_stack_of_layers_against_everything(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(6, 6, 0.01, 0.002);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    assert_true(check_find(pairs, shape.x, 0.003) > 1000);
    /* Layers 2 mm apart, none of whose own parts are closer than 7 mm. */
    assert_int_equal(check_find(pairs, shape.x, 0.0019), 0);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

/* Of four layers within the radius of each other: the pairs between parts are found, those within none. */
static void test_pairs__between_parts_finds_only_those(void **state)
{
    (void)state;
    const size_t per = 9;
    struct shape shape = sheets_stack(2, 4, 0.01, 0.002);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    uint32_t part[36];
    for (size_t v = 0; v < 36; v++)
        part[v] = v / per == 2; /* layers 0, 1 and 3 are of one part */
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.003, NULL), DRAPE_OK);
    size_t wanted[2] = {0}, found[2] = {0};
    for (size_t i = 0; i < pairs->face_count; i++)
        wanted[0] += part[pairs->faces[i].node[0]] != part[pairs->faces[i].node[1]];
    for (size_t i = 0; i < pairs->edge_count; i++)
        wanted[1] += part[pairs->edges[i].node[0]] != part[pairs->edges[i].node[2]];
    assert_true(wanted[0] > 0 && wanted[0] < pairs->face_count);
    dr_pairs_between(pairs, part);
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.003, NULL), DRAPE_OK);
    for (size_t i = 0; i < pairs->face_count; i++)
        found[0] += part[pairs->faces[i].node[0]] != part[pairs->faces[i].node[1]];
    for (size_t i = 0; i < pairs->edge_count; i++)
        found[1] += part[pairs->edges[i].node[0]] != part[pairs->edges[i].node[2]];
    assert_int_equal(pairs->face_count, wanted[0]);
    assert_int_equal(pairs->edge_count, wanted[1]);
    assert_int_equal(found[0], wanted[0]);
    assert_int_equal(found[1], wanted[1]);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

/* The second of three layers within the radius of each other is absent: the pairs of the others are found. */
static void test_pairs__of_absent_nodes_there_are_none(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(3, 3, 0.01, 0.002);
    const size_t per = shape.vertices / 3;
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    bool absent[64];
    size_t wanted[2] = {0};
    assert_in_range(shape.vertices, 3, 64);
    for (size_t v = 0; v < shape.vertices; v++)
        absent[v] = v / per == 1;
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.005, NULL), DRAPE_OK);
    for (size_t i = 0; i < pairs->face_count; i++)
        wanted[0] += !absent[pairs->faces[i].node[0]] && !absent[pairs->faces[i].node[1]];
    for (size_t i = 0; i < pairs->edge_count; i++)
        wanted[1] += !absent[pairs->edges[i].node[0]] && !absent[pairs->edges[i].node[2]];
    assert_true(wanted[0] > 0 && wanted[0] < pairs->face_count);
    assert_true(wanted[1] > 0 && wanted[1] < pairs->edge_count);
    dr_pairs_without(pairs, absent);
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.005, NULL), DRAPE_OK);
    assert_int_equal(pairs->face_count, wanted[0]);
    assert_int_equal(pairs->edge_count, wanted[1]);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static bool would_share_a_node(const struct dr_pair *pair, size_t split, const uint32_t *weld)
{
    for (size_t i = 0; i < split; i++)
        for (size_t j = split; j < 4; j++)
            if (weld[pair->node[i]] == weld[pair->node[j]])
                return true;
    return false;
}

/* Layers 0 and 1 are to be sewn together along one side: they are pairs but for what meets at that seam. */
static void test_pairs__welded_nodes_count_as_one(void **state)
{
    (void)state;
    const size_t per = 9;
    struct shape shape = sheets_stack(2, 3, 0.01, 0.002);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    static const uint32_t part[27] = {0};
    uint32_t weld[27];
    for (uint32_t v = 0; v < 27; v++)
        weld[v] = v >= per && v < per + 3 ? v - (uint32_t)per : v;
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.003, NULL), DRAPE_OK);
    size_t all[2] = {pairs->face_count, pairs->edge_count}, wanted[2] = {0};
    for (size_t i = 0; i < all[0]; i++)
        wanted[0] += !would_share_a_node(pairs->faces + i, 1, weld);
    for (size_t i = 0; i < all[1]; i++)
        wanted[1] += !would_share_a_node(pairs->edges + i, 2, weld);
    assert_in_range(wanted[0], 1, all[0] - 1);
    assert_in_range(wanted[1], 1, all[1] - 1);
    dr_pairs_between(pairs, part);
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.003, NULL), DRAPE_OK);
    assert_int_equal(pairs->face_count + pairs->edge_count, 0); /* one part */
    dr_pairs_weld(pairs, weld);
    assert_int_equal(dr_pairs_find(pairs, shape.x, 0.003, NULL), DRAPE_OK);
    assert_int_equal(pairs->face_count, wanted[0]);
    assert_int_equal(pairs->edge_count, wanted[1]);
    for (size_t i = 0; i < pairs->face_count; i++)
        assert_false(would_share_a_node(pairs->faces + i, 1, weld));
    for (size_t i = 0; i < pairs->edge_count; i++)
        assert_false(would_share_a_node(pairs->edges + i, 2, weld));
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_pairs__a_kilometre_away_is_as_here(void **state)
{
    (void)state;
    uint64_t random = 5;
    struct shape shape = sheets_stack(8, 2, 0.01, 0.004);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *here = make(mesh), *there = make(mesh);
    sheets_shake(&shape, 0.004, &random);
    size_t near = check_find(here, shape.x, 0.005);
    for (size_t i = 0; i < 3 * shape.vertices; i++)
        shape.x[i] += i % 3 ? -1000 : 1000;
    assert_true(near > 100);
    assert_int_equal(check_find(there, shape.x, 0.005), near);
    assert_memory_equal(here->faces, there->faces, here->face_count * sizeof *here->faces);
    assert_memory_equal(here->edges, there->edges, here->edge_count * sizeof *here->edges);
    dr_pairs_free(here);
    dr_pairs_free(there);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_pairs__triangles_collapsed_to_lines_and_points(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(7, 2, 0.01, 0.004);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    for (size_t v = 0; v < shape.vertices; v++)
        if (v % 8 < 5) /* all of a row's first five in one line */
            shape.x[3 * v] = 0.02;
    assert_true(check_find(pairs, shape.x, 0.003) > 100);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void check_lists(const struct dr_pairs *pairs, const struct dr_pairs *other)
{
    assert_true(pairs->radius == other->radius);
    assert_int_equal(pairs->face_count, other->face_count);
    assert_int_equal(pairs->edge_count, other->edge_count);
    assert_memory_equal(pairs->faces, other->faces, pairs->face_count * sizeof *pairs->faces);
    assert_memory_equal(pairs->edges, other->edges, pairs->edge_count * sizeof *pairs->edges);
}

static void test_pairs__on_a_borrowed_processor_are_the_same(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(40, 3, 0.01, 0.004);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *alone = make(mesh), *helped = make(mesh);
    drape_processors *processors = drape_processors_new(2);
    assert_non_null(processors);
    struct dr_hand hand = {.processors = processors};
    dr_processors_enter(processors);
    dr_pairs_lend(helped, &hand);
    uint64_t random = 53;
    for (int round = 0; round < 5; round++) {
        assert_int_equal(dr_pairs_find(alone, shape.x, 0.006, NULL), DRAPE_OK);
        assert_int_equal(dr_pairs_find(helped, shape.x, 0.006, NULL), DRAPE_OK);
        assert_true(alone->face_count > 1000 && alone->edge_count > 1000);
        check_lists(helped, alone);
        double *x = malloc(3 * mesh->nodes * sizeof *x);
        assert_non_null(x);
        memcpy(x, shape.x, 3 * mesh->nodes * sizeof *x);
        for (size_t i = 0; i < 600; i++) /* a part of it crumples */
            x[i] += 0.002 * test_random(&random);
        bool whole = dr_pairs_add(alone, shape.x, x, 0.004);
        assert_true(dr_pairs_add(helped, shape.x, x, 0.004) == whole);
        check_lists(helped, alone);
        free(x);
        sheets_shake(&shape, 0.001, &random);
    }
    assert_true(hand.seconds > 0);
    dr_processors_leave(processors);
    drape_processors_free(processors);
    dr_pairs_free(alone);
    dr_pairs_free(helped);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_pairs__a_heap_shrinks_the_radius_and_stays_small(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(40, 1, 0.01, 0);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    double *x = calloc(3 * mesh->nodes, sizeof *x);
    assert_non_null(x);
    assert_int_equal(dr_pairs_find(pairs, x, 0.006, NULL), DRAPE_OK); /* all in one point */
    assert_true(pairs->radius == 0);
    assert_int_equal(pairs->face_count + pairs->edge_count, 0);
    size_t most = DR_PAIRS_PER_TRIANGLE * mesh->triangles * sizeof(struct dr_pair);
    assert_true(dr_pairs_bytes(pairs) < 2 * most);
    assert_int_equal(dr_pairs_crossings(pairs, x, NULL), 0);

    for (size_t i = 0; i < 3 * mesh->nodes;
         i++) /* a radius that takes in everything: less is found, but all of it */
        x[i] = shape.x[i];
    assert_int_equal(dr_pairs_find(pairs, x, 0.1, NULL), DRAPE_OK);
    assert_true(pairs->radius > 0.01 && pairs->radius < 0.1);
    assert_true(check_faces(pairs, x, pairs->radius) + check_edges(pairs, x, pairs->radius) >
                mesh->triangles);
    assert_true(pairs->face_count + pairs->edge_count <= DR_PAIRS_PER_TRIANGLE * mesh->triangles);
    free(x);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_pairs__any_coordinates_end_and_find_only_what_is_finite(void **state)
{
    (void)state;
    const double odd[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 1e200, 1e-320, 0};
    struct shape shape = sheets_stack(6, 2, 0.01, 0.003);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    double *x = malloc(3 * mesh->nodes * sizeof *x);
    assert_non_null(x);
    for (size_t every = 1; every < 50; every += 7) {
        struct dr_pairs *pairs = make(mesh);
        for (size_t i = 0; i < 3 * mesh->nodes; i++)
            x[i] = i % every ? shape.x[i] : odd[(i / every) % 8];
        check_find(pairs, x, 0.004);
        dr_pairs_crossings(pairs, x, NULL);
        check_find(pairs, shape.x, 0.004); /* whatever shape the tree has */
        dr_pairs_free(pairs);
    }
    free(x);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_pairs__no_triangles_and_one_triangle(void **state)
{
    (void)state;
    const double x[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const uint32_t triangle[] = {0, 1, 2};
    for (size_t triangles = 0; triangles < 2; triangles++) {
        struct dr_mesh *mesh = sheets_mesh(3, triangles, triangle);
        struct dr_pairs *pairs = make(mesh);
        assert_int_equal(pairs->sides, triangles ? 3 : 0);
        assert_int_equal(check_find(pairs, x, 10), 0);
        assert_int_equal(dr_pairs_crossings(pairs, x, NULL), 0);
        dr_pairs_free(pairs);
        dr_mesh_free(mesh);
    }
}

static void test_pairs__a_real_shirt_against_everything(void **state)
{
    (void)state;
    struct shape shape;
    if (!sheets_garment("../shared/data/garments/shirt_coarse", &shape))
        skip();
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    assert_true(check_find(pairs, shape.x, 0.025) > 100);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

#ifdef CAN_FAIL_ALLOCATIONS
static void test_pairs__every_allocation_may_fail(void **state)
{
    (void)state;
    struct shape shape = sheets_stack(9, 2, 0.01, 0.002);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    bool failed[2] = {false, false};
    long before = held;
    for (long n = 0;; n++) {
        struct dr_pairs *pairs = NULL;
        countdown = n;
        drape_status made = dr_pairs_new(mesh, &pairs, NULL);
        drape_status found = made < 0 ? made : dr_pairs_find(pairs, shape.x, 0.006, NULL);
        bool spent = countdown < 0; /* an allocation has failed: qsort copes with its own */
        countdown = -1;
        failed[0] |= made < 0;
        if (made >= 0) {
            failed[1] |= found < 0;
            if (found < 0) {
                assert_int_equal(found, DRAPE_ENOMEM);
                assert_int_equal(pairs->face_count + pairs->edge_count, 0);
            }
            check_find(pairs, shape.x, 0.006); /* fit for use after a failure */
        } else {
            assert_int_equal(made, DRAPE_ENOMEM);
            assert_null(pairs);
        }
        dr_pairs_free(pairs);
        assert_int_equal(held, before);
        if (!spent)
            break;
    }
    assert_true(failed[0] && failed[1]);
    dr_mesh_free(mesh);
    shape_free(&shape);
}
#endif

/* ---- crossings -------------------------------------------------------------------------------- */

/* Six times the signed volume of four points, in more than double precision. */
static long double volume(const double *a, const double *b, const double *c, const double *d)
{
    long double u[3], v[3], w[3];
    for (int k = 0; k < 3; k++) {
        u[k] = (long double)b[k] - a[k];
        v[k] = (long double)c[k] - a[k];
        w[k] = (long double)d[k] - a[k];
    }
    return u[0] * (v[1] * w[2] - v[2] * w[1]) + u[1] * (v[2] * w[0] - v[0] * w[2]) +
           u[2] * (v[0] * w[1] - v[1] * w[0]);
}

/* By the signs of five volumes. */
static bool crosses(const double *x, const uint32_t end[2], const uint32_t corner[3])
{
    const double *p = x + 3 * (size_t)end[0], *q = x + 3 * (size_t)end[1];
    const double *a = x + 3 * (size_t)corner[0], *b = x + 3 * (size_t)corner[1],
                 *c = x + 3 * (size_t)corner[2];
    if (volume(a, b, c, p) * volume(a, b, c, q) >= 0)
        return false;
    long double u = volume(p, q, a, b), v = volume(p, q, b, c), w = volume(p, q, c, a);
    return (u >= 0 && v >= 0 && w >= 0) || (u <= 0 && v <= 0 && w <= 0);
}

static size_t count_crossings(const struct dr_pairs *pairs, const double *x, struct dr_crossing *ret_first)
{
    size_t count = 0;
    for (uint32_t e = 0; e < pairs->sides; e++) {
        for (uint32_t t = 0; t < pairs->mesh->triangles; t++) {
            const uint32_t *end = pairs->side + 2 * (size_t)e,
                           *corner = pairs->mesh->triangle + 3 * (size_t)t;
            if (shares(end, 2, corner, 3) || !crosses(x, end, corner))
                continue;
            if (!count++)
                *ret_first = (struct dr_crossing){.side = e, .triangle = t};
        }
    }
    return count;
}

static void test_crossings__crumpled_sheets_against_everything(void **state)
{
    (void)state;
    uint64_t random = 13;
    struct shape shape = sheets_stack(8, 2, 0.01, 0.004);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    struct dr_pairs *pairs = make(mesh);
    size_t seen = 0;
    for (int i = 0; i < 8; i++) {
        struct dr_crossing expected = {0}, first = {.side = 77};
        size_t count = count_crossings(pairs, shape.x, &expected);
        assert_int_equal(dr_pairs_crossings(pairs, shape.x, &first), count);
        if (!count)
            assert_int_equal(first.side, 77); /* untouched */
        if (count) {
            assert_int_equal(first.side, expected.side);
            assert_int_equal(first.triangle, expected.triangle);
            const double *p = shape.x + 3 * (size_t)pairs->side[2 * (size_t)first.side],
                         *q = shape.x + 3 * (size_t)pairs->side[2 * (size_t)first.side + 1];
            double ap = 0, pq = 0, aq = 0; /* the place is on the edge */
            for (int d = 0; d < 3; d++) {
                ap += (first.at[d] - p[d]) * (first.at[d] - p[d]);
                aq += (first.at[d] - q[d]) * (first.at[d] - q[d]);
                pq += (p[d] - q[d]) * (p[d] - q[d]);
            }
            assert_near(sqrt(ap) + sqrt(aq), sqrt(pq), 1e-9, 0);
        }
        seen += count;
        sheets_shake(&shape, 0.003, &random);
    }
    assert_true(seen > 100);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

static void test_crossings__touching_is_none_and_through_a_shared_edge_is_two(void **state)
{
    (void)state;
    /* A square of two triangles, 0 1 2 and 1 3 2, in y = 0, and an upright triangle 4 5 6. */
    double x[] = {0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 1, 0.25, 0, 0.25, 0.25, 1, 0.25, 0.2, 1, 0.3};
    const uint32_t triangle[] = {0, 1, 2, 1, 3, 2, 4, 5, 6};
    struct dr_mesh *mesh = sheets_mesh(7, 3, triangle);
    struct dr_pairs *pairs = make(mesh);
    assert_int_equal(dr_pairs_crossings(pairs, x, NULL), 0); /* its tip touches the square */
    x[13] = -1;
    assert_int_equal(dr_pairs_crossings(pairs, x, NULL), 2); /* both its edges go through */
    x[12] = x[14] = x[15] = x[17] = 0.5; /* one goes through the diagonal, which goes through it */
    assert_int_equal(dr_pairs_crossings(pairs, x, NULL), 4);
    for (int i = 4; i < 7; i++)
        x[3 * i + 1] = 0; /* flat in the plane of the others */
    assert_int_equal(dr_pairs_crossings(pairs, x, NULL), 0);
    dr_pairs_free(pairs);
    dr_mesh_free(mesh);
}

static void test_crossings__a_flat_sheet_in_any_position_has_none(void **state)
{
    (void)state;
    uint64_t random = 17;
    struct shape shape = sheets_stack(12, 1, 0.01, 0);
    struct dr_mesh *mesh = sheets_mesh(shape.vertices, shape.triangles, shape.triangle);
    double *x = malloc(3 * mesh->nodes * sizeof *x);
    assert_non_null(x);
    for (int i = 0; i < 30; i++) { /* sheared and turned: its plane is no axis's, so heights are round-off */
        double map[3][3];
        for (int k = 0; k < 9; k++)
            map[k / 3][k % 3] = test_random(&random);
        for (size_t k = 0; k < 3 * mesh->nodes; k++)
            x[k] = map[k % 3][0] * shape.x[k / 3 * 3] + map[k % 3][1] * shape.x[k / 3 * 3 + 2] +
                   (i % 2 ? 1000 : 0) * map[k % 3][2];
        struct dr_pairs *pairs = make(mesh);
        assert_int_equal(dr_pairs_crossings(pairs, x, NULL), 0);
        dr_pairs_free(pairs);
    }
    free(x);
    dr_mesh_free(mesh);
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_closest__random_parts_against_minimisation),
        cmocka_unit_test(test_closest__needles_parallels_and_points),
        cmocka_unit_test(test_closest__parallel_edges_meet_in_the_middle_of_their_overlap),
        cmocka_unit_test(test_closest__nan_and_infinity_are_near_nothing),
        cmocka_unit_test(test_pairs__edges_of_the_mesh_are_each_listed_once),
        cmocka_unit_test(test_pairs__crumpled_sheets_against_everything),
        cmocka_unit_test(test_pairs__what_has_come_near_is_added),
        cmocka_unit_test(test_pairs__a_stack_of_layers_against_everything),
        cmocka_unit_test(test_pairs__between_parts_finds_only_those),
        cmocka_unit_test(test_pairs__of_absent_nodes_there_are_none),
        cmocka_unit_test(test_pairs__welded_nodes_count_as_one),
        cmocka_unit_test(test_pairs__a_kilometre_away_is_as_here),
        cmocka_unit_test(test_pairs__triangles_collapsed_to_lines_and_points),
        cmocka_unit_test(test_pairs__on_a_borrowed_processor_are_the_same),
        cmocka_unit_test(test_pairs__a_heap_shrinks_the_radius_and_stays_small),
        cmocka_unit_test(test_pairs__any_coordinates_end_and_find_only_what_is_finite),
        cmocka_unit_test(test_pairs__no_triangles_and_one_triangle),
        cmocka_unit_test(test_pairs__a_real_shirt_against_everything),
#ifdef CAN_FAIL_ALLOCATIONS
        cmocka_unit_test(test_pairs__every_allocation_may_fail),
#endif
        cmocka_unit_test(test_crossings__crumpled_sheets_against_everything),
        cmocka_unit_test(test_crossings__touching_is_none_and_through_a_shared_edge_is_two),
        cmocka_unit_test(test_crossings__a_flat_sheet_in_any_position_has_none),
    };
    return cmocka_run_group_tests_name("pairs", tests, NULL, NULL);
}
