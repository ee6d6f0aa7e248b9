/* measure.c - how deep a drape lies inside a body and how far its seams gape, found the plain way.
 *
 * usage: measure DRAPE.obj SEAMS BODY.obj
 * Shares no code with the solver: inside means that rays along x, y and z cross the body an odd
 * number of times (two of three decide), depth is the distance to the nearest triangle, by trying all.
 * Prints one JSON object; lengths in metres. */
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct obj {
    double *x;   /* 3 per vertex */
    uint32_t *t; /* 3 per triangle */
    size_t vertices, triangles;
};

static void die(const char *what, const char *where)
{
    fprintf(stderr, "measure: %s: %s\n", what, where);
    exit(2);
}

static void *grow(void *array, size_t count, size_t size)
{
    if (count & (count - 1)) /* doubles at powers of two */
        return array;
    void *grown = realloc(array, (count ? 2 * count : 1) * size);
    if (grown == NULL)
        die("out of memory", "");
    return grown;
}

static struct obj obj_read(const char *path)
{
    struct obj obj = {0};
    char line[512];
    FILE *file = fopen(path, "r");
    if (file == NULL)
        die("cannot read", path);
    while (fgets(line, sizeof line, file)) {
        double p[3];
        uint32_t v[3];
        if (sscanf(line, "v %lf %lf %lf", &p[0], &p[1], &p[2]) == 3) {
            obj.x = grow(obj.x, obj.vertices, sizeof p);
            memcpy(obj.x + 3 * obj.vertices++, p, sizeof p);
        } else if (sscanf(line, "f %u%*[^ ] %u%*[^ ] %u", &v[0], &v[1], &v[2]) == 3 ||
                   sscanf(line, "f %u %u %u", &v[0], &v[1], &v[2]) == 3) {
            obj.t = grow(obj.t, obj.triangles, sizeof v);
            for (int k = 0; k < 3; k++)
                obj.t[3 * obj.triangles + (size_t)k] = v[k] - 1;
            obj.triangles++;
        }
    }
    fclose(file);
    for (size_t i = 0; i < 3 * obj.triangles; i++)
        if (obj.t[i] >= obj.vertices)
            die("face of no vertex", path);
    return obj;
}

/* Does the ray from p along axis k cross triangle abc? Ties go to one side by the strict/loose pair. */
static bool crosses(const double *p, const double *a, const double *b, const double *c, int k)
{
    int u = (k + 1) % 3, v = (k + 2) % 3;
    const double *corner[3] = {a, b, c};
    bool odd = false;
    for (int i = 0; i < 3; i++) { /* point in the triangle's shadow, by edge crossings */
        const double *q = corner[i], *r = corner[(i + 1) % 3];
        if ((q[v] > p[v]) != (r[v] > p[v]) && p[u] < q[u] + (p[v] - q[v]) / (r[v] - q[v]) * (r[u] - q[u]))
            odd = !odd;
    }
    if (!odd)
        return false;
    double e[3], f[3], n[3];
    for (int i = 0; i < 3; i++) {
        e[i] = b[i] - a[i];
        f[i] = c[i] - a[i];
    }
    for (int i = 0; i < 3; i++)
        n[i] = e[(i + 1) % 3] * f[(i + 2) % 3] - e[(i + 2) % 3] * f[(i + 1) % 3];
    return a[k] - (n[u] * (p[u] - a[u]) + n[v] * (p[v] - a[v])) / n[k] > p[k];
}

static bool is_inside(const struct obj *body, const double *p)
{
    int votes = 0;
    for (int k = 0; k < 3; k++) {
        bool odd = false;
        for (size_t t = 0; t < body->triangles; t++) {
            const uint32_t *v = body->t + 3 * t;
            odd ^= crosses(p, body->x + 3 * v[0], body->x + 3 * v[1], body->x + 3 * v[2], k);
        }
        votes += odd;
    }
    return votes >= 2;
}

static double dot(const double *a, const double *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double to_segment(const double *p, const double *a, const double *b)
{
    double d[3], e[3];
    for (int i = 0; i < 3; i++) {
        d[i] = b[i] - a[i];
        e[i] = p[i] - a[i];
    }
    double s = dot(d, d) > 0 ? fmin(fmax(dot(d, e) / dot(d, d), 0), 1) : 0;
    for (int i = 0; i < 3; i++)
        e[i] -= s * d[i];
    return sqrt(dot(e, e));
}

static double to_triangle(const double *p, const double *a, const double *b, const double *c)
{
    double d = fmin(to_segment(p, a, b), fmin(to_segment(p, b, c), to_segment(p, c, a)));
    double e[3], f[3], w[3];
    for (int i = 0; i < 3; i++) {
        e[i] = b[i] - a[i];
        f[i] = c[i] - a[i];
        w[i] = p[i] - a[i];
    }
    double ee = dot(e, e), ef = dot(e, f), ff = dot(f, f), we = dot(w, e), wf = dot(w, f);
    double det = ee * ff - ef * ef;
    double s = (ff * we - ef * wf) / det, r = (ee * wf - ef * we) / det;
    if (!(det > 0) || s < 0 || r < 0 || s + r > 1)
        return d;
    for (int i = 0; i < 3; i++)
        w[i] -= s * e[i] + r * f[i];
    return fmin(d, sqrt(dot(w, w)));
}

static double depth_of(const struct obj *body, const double *p)
{
    double least = DBL_MAX;
    for (size_t t = 0; t < body->triangles; t++) {
        const uint32_t *v = body->t + 3 * t;
        least = fmin(least, to_triangle(p, body->x + 3 * v[0], body->x + 3 * v[1], body->x + 3 * v[2]));
    }
    return least;
}

/* The largest distance between the two vertices of one seam pair. */
static double widest_seam(const struct obj *drape, const char *path)
{
    char line[128];
    double widest = 0;
    FILE *file = fopen(path, "r");
    if (file == NULL)
        die("cannot read", path);
    while (fgets(line, sizeof line, file)) {
        size_t i, j;
        if (sscanf(line, "%zu %zu", &i, &j) != 2)
            continue;
        if (i < 1 || j < 1 || i > drape->vertices || j > drape->vertices)
            die("seam of no vertex", path);
        double d[3];
        for (size_t k = 0; k < 3; k++)
            d[k] = drape->x[3 * (i - 1) + k] - drape->x[3 * (j - 1) + k];
        widest = fmax(widest, sqrt(dot(d, d)));
    }
    fclose(file);
    return widest;
}

int main(int argc, char **argv)
{
    if (argc != 4)
        die("usage", "measure DRAPE.obj SEAMS BODY.obj");
    struct obj drape = obj_read(argv[1]), body = obj_read(argv[3]);
    size_t inside = 0;
    double deepest = 0;
    bool finite = drape.vertices > 0 && body.triangles > 0;
    for (size_t i = 0; i < drape.vertices; i++) {
        const double *p = drape.x + 3 * i;
        finite = finite && isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
        if (!finite || !is_inside(&body, p))
            continue;
        inside++;
        deepest = fmax(deepest, depth_of(&body, p));
    }
    printf("{\"vertices\":%zu,\"finite\":%s,\"inside\":%zu,\"deepest\":%.6g,\"seam_gap\":%.6g}\n",
           drape.vertices, finite ? "true" : "false", inside, deepest, widest_seam(&drape, argv[2]));
    free(drape.x);
    free(drape.t);
    free(body.x);
    free(body.t);
    return 0;
}
