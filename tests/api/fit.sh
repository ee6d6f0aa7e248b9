#!/bin/bash
# How a drape fits, over the API: a square that lies on a plane, one that slides off, one that was not asked.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# drape NAME FILTER: solves a square of 8 by 8 cells; leaves its id.
drape() {
    square 8 "$2" >"$work/job"
    submit "$work/job"
    check "$1 is solved" wait_for "$id" succeeded 60
}
ground='del(.cloth.pins) | .solver.tolerance = 1e-4
    | .bodies = [{plane: {point: [0, -0.0029, 0], normal: [0, 1, 0]}, offset: 0.003}]'

drape 'a square on the ground' "$ground | .fit = true"
json 'it lies there' '.verdict == "at-rest" and .report.drop == 0'
json 'the fit is a term of the plan' '.report.plan.kept | any(.[]; .name == "fit" and .bytes > 0)'
request GET "/v1/jobs/$id/result?format=json"
json 'strain and stress are of triangles, pressure and gap of vertices' '.fit | (.strain | length) == 384
    and (.stress | length) == 384 and (.pressure | length) == 81 and (.gap | length) == 81
    and .utilization == null and .reach == 0.03'
# What a vertex weighs is its share of the rest area times 0.15 kg/m^2.
json 'pressure carries the weight to a thousandth' '.pattern as $p | .fit.pressure as $P
    | [.triangles | _nwise(3) | map([$p[2*.], $p[2*.+1], $P[.]])
        | ((.[1][0]-.[0][0]) * (.[2][1]-.[0][1]) - (.[2][0]-.[0][0]) * (.[1][1]-.[0][1])) / 2
            * (.[0][2] + .[1][2] + .[2][2]) / 3] | add | if . < 0 then -. else . end
    | . / (0.15 * 9.81 * 0.04) | . > 0.999 and . < 1.001'
json 'the gap is the height above the plane' '.positions as $x | [.fit.gap, [range(81) | $x[3*.+1] + 0.0029]]
    | transpose | all(.[]; (.[0] - .[1]) | . < 1e-8 and . > -1e-8)'
request GET "/v1/jobs/$id/result?format=glb"
check 'GLB has the attributes and colours' grep -aq '"COLOR_0":[0-9]*,"_STRAIN":[0-9]*,"_PRESSURE":[0-9]*,"_GAP":' "$body"
request GET "/v1/jobs/$id/result?format=ply"
check 'PLY has pressure and gap' grep -aqx 'property float gap' "$body"

drape 'the same without its fit' "$ground"
json 'not asked for it is left out' '.report.plan.left_out | any(.[]; .name == "fit")'
request GET "/v1/jobs/$id/result?format=json"
json 'and not in the result' 'has("fit") | not'
request GET "/v1/jobs/$id/result?format=glb"
check 'nor in the GLB' bash -c '! grep -aq COLOR_0 "$1"' - "$body"

drape 'a square that nothing holds' 'del(.cloth.pins) | .bodies = [{sphere: {center: [5, -0.2, 0], radius: 0.05}}]'
json 'a square that misses the body slid off, by what it fell' '.verdict == "slid-off" and .report.drop > 0.253'
# A strip of 0.175 m that hangs by its weight, weft down: at the height s above its end the force per width is
# w s, w = 0.15 * 9.81, so that k E l = w s with E = (l^2 - 1)/2; to second order E = a - a^2, l = 1 + a - 3 a^2 / 2
# with a = w s / k, in all L (A/2 - A^2/2) longer with A = w L / k.
drape 'a strip that hangs' '.cloth.materials = [{density: 0.15, stretch: {weft: 20, warp: 20, shear: 10}, bend: 0}]
    | .solver.tolerance = 1e-5 | .lines = [{name: "length", vertices: [13, 76]}, {name: "round", closed: true,
        vertices: [9, 17, 80, 72]}]'
json 'it comes to rest' '.verdict == "at-rest"'
json 'its line is as much longer as its weight makes it' '(0.15 * 9.81 * 0.175 / 20) as $A | .report.lines[0]
    | .name == "length" and (.rest - 0.175 | . < 1e-12 and . > -1e-12)
    and (.elongation / ($A / 2 - $A * $A / 2) | . > 0.998 and . < 1.002)'
json 'a closed line goes round' '.report.lines[1] | .closed and (.rest - 0.75 | . < 1e-12 and . > -1e-12)'
json 'the others have none' '.report.lines | length == 2'
stop_daemon
finish
