#!/bin/bash
# Elastics, folds, tacks, shrinkage and interfacing over the API: a square that is gathered, creased, held.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# drape NAME FILTER: solves a square of 8 by 8 cells, held along its first two columns (vertices 9 i + j of column
# i); leaves its id and its result in $body.
drape() {
    square 8 "$2" >"$work/job"
    submit "$work/job"
    check "$1 is solved" wait_for "$id" succeeded 60
    json "$1 is at rest" '.verdict == "at-rest"'
    cp "$body" "$work/report"
    request GET "/v1/jobs/$id/result?format=json"
}
kept() { json "$1 is a term of the plan" ".report.plan.kept | any(.[]; .name == \"$1\" and .bytes > 0)" "$work/report"; }
# column I: the pairs of vertices along it, as jq.
column() { echo "[range(8) | $1 * 9 + ., $1 * 9 + . + 1]"; }
fine='.solver.tolerance = 1e-5'

# Of 0.2 m the half beyond the fold hangs down, a mountain from above, where the normals point.
drape 'a creased square' "$fine | .gravity = [0,0,0]
    | .cloth.folds = [{edges: $(column 4), angle: 90, stiffness: 1e-3}]"
kept folds
json 'it is bent down by a right angle along the crease, and flat beside it' '.positions | [range(9) as $j
    | .[3*(72+$j)] - 0.1, .[3*(72+$j)+1] + 0.1, .[3*(36+$j)] - 0.1, .[3*(36+$j)+1]]
    | all(. < 1e-5 and . > -1e-5)'
drape 'a square creased the other way' "$fine | .gravity = [0,0,0]
    | .cloth.folds = [{edges: $(column 4), angle: -90, stiffness: 1e-3}]"
json 'it is bent up' '.positions[217] > 0.09999 and .positions[217] < 0.10001'

# length of the free edge, column 8
length='.positions as $x | [range(8) | [range(3) as $d | $x[3*(73+.)+$d] - $x[3*(72+.)+$d] | . * .] | add | sqrt] | add'
drape 'a gathered square' "$fine | .cloth.elastics = [{edges: $(column 8), factor: 0.7, stiffness: 30}]"
kept elastics
json 'its hem is nearly as short as the tape' "$length | . < 0.15 and . > 0.14"
drape 'a flared square' "$fine | .cloth.elastics = [{edges: $(column 8), factor: 1.3, stiffness: 3}]"
json 'its hem is longer than it was cut' "$length | . > 0.21 and . < 0.26"

ground='.bodies = [{plane: {point: [0, -1, 0], normal: [0, 1, 0]}}]'
drape 'a tacked square' "$fine | del(.cloth.pins) | $ground
    | .cloth.tacks = [{vertex: 0, body: 0, point: [0.5, 0.2, 0.1]}, {vertex: 8, body: 0, point: [0.5, 0.2, 0.25]}]"
kept tacks
json 'it hangs at the two points' '[.positions[0] - 0.5, .positions[1] - 0.2, .positions[2] - 0.1, .positions[24] - 0.5,
    .positions[25] - 0.2, .positions[26] - 0.25] | all(. < 1e-4 and . > -1e-4)'
tetrahedron='{mesh: {positions: [0,0.3,0, 0.3,0.3,0, 0,0.3,0.3, 0,0.6,0], triangles: [0,1,2, 0,3,1, 1,3,2, 0,2,3]}}'
drape 'a square tacked to the underside of a mesh' "$fine | del(.cloth.pins) | .bodies = [$tetrahedron]
    | .cloth.tacks = [{vertex: 0, body: 0, triangle: 0, barycentric: [0.5, 0.3]}]"
json 'it hangs from the point, an offset below the face' '.positions | .[0] > 0.089 and .[0] < 0.091
    and .[1] > 0.2955 and .[1] < 0.2975 and .[2] > 0.059 and .[2] < 0.061'

drape 'a square that shrank' "$fine | .gravity = [0,0,0] | .cloth.pins = [0]
    | .cloth.materials[0].shrink = {weft: 0.1, warp: 0.05}"
json 'it is smaller by as much' '.positions as $x | [range(3) | $x[240+.] - $x[.] | . * .] | add | sqrt
    | . > 0.2617 and . < 0.2618'

lowest='[range(81) as $i | .positions[3*$i+1]] | min'
drape 'a plain square' "$fine"
plain=$(jq "$lowest" "$body")
drape 'an interfaced square' "$fine | .cloth.materials[1] = (.cloth.materials[0] | .bend = 3e-3)
    | .cloth.triangle_material = [range(128) | if . < 80 then 1 else 0 end]"
json "interfaced over five of its eight columns it stands out further than $plain m" "$lowest | . > $plain + 0.04"
stop_daemon
finish
