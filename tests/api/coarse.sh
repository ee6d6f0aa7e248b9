#!/bin/bash
# Coarse to fine over the API: a garment that is to be draped on a coarse mesh first, and one that is not.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# drape NAME CHOICE [FILTER]: the example's garment; leaves its id.
drape() {
    build/drape example garment --triangles 600 | jq -c --arg coarse "$2" ".solver.coarse = \$coarse${3:+ | $3}" >"$work/job"
    submit "$work/job"
    check "$1 is solved" wait_for "$id" succeeded 120
}

drape 'a garment, coarse first' on
json 'it comes to rest whole' '.verdict == "at-rest" and .report.self_intersections == 0 and .report.penetrations == 0'
json 'the report says what came of the coarse mesh' '.report.coarse | .carried and .iterations > 0
    and .factorizations > .iterations and .triangles > 75 and .triangles < 300'
json 'it is a term of the plan, and a stage' '(.report.plan.kept | any(.[]; .name == "coarse" and .bytes > 0))
    and .report.stages.coarse > 0 and .report.stages.sew == 0'
request GET "/v1/jobs/$id/result?format=json"
json 'the result is of the whole mesh' ".triangles | length == $(jq '.cloth.mesh.triangles | length' "$work/job")"

drape 'the same without' off '.solver.max_iterations = 2'
json 'nothing is coarse' '(.report.coarse == {triangles: 0, iterations: 0, factorizations: 0, carried: false})
    and (.report.plan.left_out | any(.[]; .name == "coarse" and .reason == "switched off"))'
drape 'one left to itself' auto '.solver.max_iterations = 2'
json 'is draped whole' '.report.plan.left_out | any(.[]; .name == "coarse" and (.reason | startswith("auto: ")))'
stop_daemon
finish
