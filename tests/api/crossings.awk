# crossings.awk - random pairs of triangles, and in how many ways they meet, found by other means than crossings.c:
# the point where the line of an edge meets the plane of a triangle, as a ratio of whole numbers, and separating
# axes where both lie in one plane. Coordinates are whole numbers of 1/1024 m up to `reach` <= 30, so that all
# stays exact in doubles. A small reach makes mostly touching pairs, a large one mostly crossing ones.
# usage: awk -v pairs=N -v reach=R -v out=FOLDER -f crossings.awk
# Writes FOLDER/N.a.obj and N.b.obj, and all pairs that share no point, side by side, to FOLDER/all.obj; prints for
# each N "N crossings touches", and for those in all.obj "all crossings touches" in sum.

function random(n) { seed = (seed * 16807) % 2147483647; return int(seed / 2147483647 * n) }
function cross(n, u, v,    k) {
    for (k = 0; k < 3; k++)
        n[k] = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3]
}
function dot(u, v) { return u[0] * v[0] + u[1] * v[1] + u[2] * v[2] }
function minus(w, i, j,    k) { for (k = 0; k < 3; k++) w[k] = x[i, k] - x[j, k] }
function along(n, i) { return n[0] * x[i, 0] + n[1] * x[i, 1] + n[2] * x[i, 2] }
function normal(n, a,    u, v) {
    minus(u, a + 1, a)
    minus(v, a + 2, a)
    cross(n, u, v)
    return n[0] != 0 || n[1] != 0 || n[2] != 0
}

# Does the direction n part the triangle a.. from the edge p, q?
function parts(n, a, p, q,    i, h, low, high, s, t) {
    low = high = along(n, a)
    for (i = 1; i < 3; i++) {
        h = along(n, a + i)
        if (h < low) low = h
        if (h > high) high = h
    }
    s = along(n, p)
    t = along(n, q)
    return (s < low && t < low) || (s > high && t > high)
}
function flat_meet(n, a, p, q,    i, e, m) {
    for (i = 0; i < 3; i++) {
        minus(e, a + (i + 1) % 3, a + i)
        cross(m, n, e)
        if (parts(m, a, p, q)) return 0
    }
    minus(e, q, p)
    cross(m, n, e)
    return !parts(m, a, p, q)
}

# 0: apart, 1: touching, 2: crossing.
function meet(a, p, q,    n, s, t, i, k, e, f, g, m, meeting) {
    normal(n, a)
    s = along(n, p) - along(n, a)
    t = along(n, q) - along(n, a)
    if (s * t > 0) return 0
    if (s == 0 && t == 0) return flat_meet(n, a, p, q)
    meeting = s * t < 0 ? 2 : 1
    for (i = 0; i < 3; i++) { # (s q - t p) / (s - t) on the inner side of each side of the triangle
        minus(e, a + (i + 1) % 3, a + i)
        for (k = 0; k < 3; k++)
            f[k] = s * x[q, k] - t * x[p, k] - (s - t) * x[a + i, k]
        cross(g, e, f)
        m = dot(n, g) * (s > t ? 1 : -1)
        if (m < 0) return 0
        if (m == 0) meeting = 1
    }
    return meeting
}
function edges(a, b,    i, way) { # the edges of b with the triangle a
    for (i = 0; i < 3; i++) {
        way = meet(a, b + i, b + (i + 1) % 3)
        crossings += way == 2
        touches += way == 1
    }
}

function share(    i, j) {
    for (i = 0; i < 3; i++)
        for (j = 3; j < 6; j++)
            if (x[i, 0] == x[j, 0] && x[i, 1] == x[j, 1] && x[i, 2] == x[j, 2]) return 1
    return 0
}
function print_triangle(a, file, shift, first,    i) {
    for (i = 0; i < 3; i++)
        printf "v %.10f %.10f %.10f\n", (x[a + i, 0] + 128 * (shift % 8)) / 1024,
            (x[a + i, 1] + 128 * (int(shift / 8) % 8)) / 1024, (x[a + i, 2] + 128 * int(shift / 64)) / 1024 >file
    printf "f %d %d %d\n", first, first + 1, first + 2 >file
}

BEGIN {
    seed = 7
    all = out "/all.obj"
    while (pair < pairs) {
        for (i = 0; i < 6; i++)
            for (k = 0; k < 3; k++)
                x[i, k] = random(2 * reach + 1) - reach
        if (!normal(n, 0) || !normal(n, 3)) continue
        crossings = touches = 0
        edges(0, 3)
        edges(3, 0)
        print ++pair, crossings, touches
        for (i = 0; i < 2; i++) {
            file = out "/" pair (i ? ".b.obj" : ".a.obj")
            print_triangle(3 * i, file, 0, 1)
            close(file)
        }
        if (share()) continue
        print_triangle(0, all, pair, 6 * joint + 1)
        print_triangle(3, all, pair, 6 * joint + 4)
        joint++
        all_crossings += crossings
        all_touches += touches
    }
    print "all", all_crossings, all_touches
}
