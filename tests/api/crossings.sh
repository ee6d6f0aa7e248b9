#!/bin/bash
# What tests/api/crossings.c counts, against figures worked out by hand and against another way of deciding.
. "$(dirname "$0")/lib.sh"
crossings=build/release/tests/api/crossings

# obj FILE: "x y z" lines are vertices, "i j k" lines after a "faces" line are triangles.
obj() { awk '/^faces/ {faces = 1; next} NF {print (faces ? "f" : "v"), $0}' >"$1"; }
# count NAME WANTED CLOTH [BODY]: WANTED is "crossings touches" of the cloth with the body, if given, else itself.
count() {
    local kind=cloth_cloth
    (($# < 4)) || kind=cloth_body
    is "$1" "$("$crossings" "${@:3}" | jq -r ".$kind | \"\(.crossings) \(.touches)\"")" "$2"
}
refused() { # NAME WORDS FILE
    "$crossings" "$3" >"$work/said" 2>&1
    is "$1: exit status" $? 2
    like "$1" "$(<"$work/said")" "$2"
}

# ---- by hand ---------------------------------------------------------------------------------------

flat='0 0 0
1 0 0
0 1 0'
pair() { printf '%s\n%s\nfaces\n1 2 3\n4 5 6\n' "$flat" "$2" | obj "$work/$1"; }
pair through '.25 .25 -1
.25 .25 1
3 3 0'
count 'two triangles through each other: an edge of each' '2 0' "$work/through"
pair stuck '.25 .25 -1
.25 .5 -1
.25 .25 1'
count 'one stuck through the other: two edges of it' '2 0' "$work/stuck"
pair above '.25 .25 .001
.25 .25 1
3 3 0'
count 'one above the other' '0 0' "$work/above"
pair standing '.25 .25 0
.25 .25 1
3 3 1'
count 'a corner on the triangle: both edges that end there touch' '0 2' "$work/standing"
pair shifted '.25 .25 0
1.25 .25 0
.25 1.25 0'
count 'overlapping in one plane: three edges touch' '0 3' "$work/shifted"
pair within '.1 .1 0
.2 .1 0
.1 .2 0'
count 'one inside the other in one plane: its three edges touch' '0 3' "$work/within"
pair beside '2 0 0
3 0 0
2 1 0'
count 'apart in one plane' '0 0' "$work/beside"
pair hinge '1 0 0
0 1 0
1 1 1'
count 'a shut seam: corners of equal coordinates are one' '0 0' "$work/hinge"
pair gaping '1 .001 0
.001 1 0
1 1 -1'
count 'an open seam that does not cross' '0 0' "$work/gaping"
pair lapped '.9 -.001 .01
-.001 .9 .01
1 1 -1'
count 'an open seam that laps over' '2 0' "$work/lapped"
obj "$work/fan" <<<"$flat
.3 .3 -.5
.3 .3 .5
faces
1 2 3
1 4 5"
count 'two triangles that share a corner: the edge opposite to it' '1 0' "$work/fan"
obj "$work/needle" <<<"$flat
.3 .3 -1
.3 .3 1
.3 .3 0
faces
1 2 3
4 5 6"
json 'a triangle without area counts as such, and its edges still cross' \
    '.cloth.without_area == 1 and .cloth_cloth.crossings == 1 and .cloth_cloth.touches == 2' \
    <("$crossings" "$work/needle")

# A sheet of two triangles through a box: the four upright edges and the four diagonals of the walls cross the
# sheet, the sheet's diagonal crosses two walls.
obj "$work/box" <<<'-.5 -.5 -.5
.5 -.5 -.5
.5 -.5 .5
-.5 -.5 .5
-.5 .5 -.5
.5 .5 -.5
.5 .5 .5
-.5 .5 .5
faces
1 2 3
1 3 4
5 7 6
5 8 7
1 6 2
1 5 6
2 7 3
2 6 7
3 8 4
3 7 8
4 5 1
4 8 5'
obj "$work/sheet" <<<'-1 .1 -1.2
1.1 .1 -1
1 .1 1.3
-1.2 .1 1
faces
1 2 3
1 3 4'
count 'a sheet through a box' '10 0' "$work/sheet" "$work/box"
count 'the sheet with itself' '0 0' "$work/sheet"
count 'the box with itself' '0 0' "$work/box"
sed 's/ \.1 / .5 /' "$work/sheet" >"$work/lid"
# Eight: the edges of the top with the sheet's two triangles, three of them over its diagonal. Eight: the ends of
# uprights and diagonals. Four: the sheet's diagonal with the top and, at its rim, with two walls.
count 'a sheet on a box touches only' '0 20' "$work/lid" "$work/box"
sed 's/ \.1 / .5000001 /' "$work/sheet" >"$work/lid"
count 'a sheet 0.1 micrometre above a box' '0 0' "$work/lid" "$work/box"
json 'the first pairs are named by their vertices' \
    '.cloth_body.first_crossings | length == 5 and all(.[]; (.edge_of == "cloth" and .edge == [1, 3]) or
        (.edge_of == "body" and (.triangle == [1, 2, 3] or .triangle == [1, 3, 4])))' \
    <("$crossings" "$work/sheet" "$work/box")

# A triangle of 15 m, its normal (xz - y, -z, 1) of coprime numbers, its centre at the origin, so that (0, 0, 1)
# is beside it by a part in 2^80: doubles cannot tell on which side. Edges between points 2^-30 m apart.
beside() {
    awk -v p="$1" -v q="$2" 'BEGIN {
        unit = 2 ^ 30; a = 65521; x = 65537; y = 64951; z = 50021
        b[0] = 1; b[1] = x; b[2] = y; c[0] = a; c[1] = a * x + 1; c[2] = a * y + z
        line = "%.17g %.17g %.17g\n"
        printf line, -(b[0] + c[0]) / unit, -(b[1] + c[1]) / unit, -(b[2] + c[2]) / unit
        printf line line, b[0] / unit, b[1] / unit, b[2] / unit, c[0] / unit, c[1] / unit, c[2] / unit
        printf "0 0 %.17g\n0 0 %.17g\n%.17g 0 4\nfaces\n1 2 3\n4 5 6\n", p / unit, q / unit, 1 / unit
    }' | obj "$work/beside"
}
beside 1 2 && count 'a nanometre above a slanting triangle' '0 0' "$work/beside"
beside -1 1 && count 'from a nanometre below it to one above' '2 0' "$work/beside"
beside 0 1 && count 'from its very centre' '0 2' "$work/beside"

# ---- at random -------------------------------------------------------------------------------------

# at_random REACH: 250 pairs, one by one as cloth and body, and side by side as one cloth.
at_random() {
    local reach=$1 n wanted
    mkdir -p "$work/random"
    rm -f "$work/random"/*
    awk -v pairs=250 -v reach="$reach" -v out="$work/random" -f tests/api/crossings.awk >"$work/wanted"
    while read -r n wanted; do
        if [[ $n == all ]]; then
            count "all at once within $reach" "$wanted" "$work/random/all.obj"
        else
            echo "$n $("$crossings" "$work/random/$n.a.obj" "$work/random/$n.b.obj")" >>"$work/random/said"
        fi
    done <"$work/wanted"
    sed 's/^[0-9]* //' "$work/random/said" |
        jq -r '.cloth_body | "\(input_line_number) \(.crossings) \(.touches)"' >"$work/random/counts"
    check "250 pairs within $reach: each as decided otherwise" diff <(grep -v all "$work/wanted") "$work/random/counts"
    check "$(awk '$1 != "all" {cross += $2 > 0; touch += $3 > 0} END {print cross " cross, " touch " touch"}' \
        "$work/wanted")" awk '$1 != "all" {cross += $2 > 0; touch += $3 > 0; apart += $2 + $3 == 0}
            END {exit !(cross >= 20 && apart >= 20 && (touch >= 20 || '"$reach"' > 3))}' "$work/wanted"
}
at_random 2
at_random 30

# ---- refusals --------------------------------------------------------------------------------------

obj "$work/far" <<<"$flat
9 0 0
faces
1 2 3"
refused 'beyond 8 m' 'farther than 8 m' "$work/far"
sed 's/^v 9/v nan/' "$work/far" >"$work/nan"
refused 'not a number' 'not a number' "$work/nan"
obj "$work/none" <<<"$flat
faces
1 2 4"
refused 'a face of no vertex' 'face of no vertex' "$work/none"
obj "$work/four" <<<"$flat
1 1 0
faces
1 2 4 3"
refused 'a face of four corners' 'no triangle' "$work/four"
refused 'no file' 'cannot read' "$work/absent"
finish
