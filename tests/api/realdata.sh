#!/bin/bash
# Real garments on a real body, from files, through the client: an honest end, no cloth in the body, seams shut.
. "$(dirname "$0")/lib.sh"
shared=../shared/data
if [[ ! -r $shared/bodies/body_f_A.obj ]]; then
    echo "1..0 # SKIP ../shared/data is absent: no real garment was draped"
    exit 0
fi
start_daemon --workers 2
measure=build/release/tests/api/measure
crossings=build/release/tests/api/crossings

# drape NAME SECONDS VERDICTS [OPTION...]
drape() {
    local name=$1
    check "$name: drape scene makes a job" bash -c '"$@" >"$0"' "$work/$name.json" "$DRAPE" scene \
        --garment "$shared/garments/$name.obj" --seams "$shared/garments/$name.seams" \
        --body "$shared/bodies/body_f_A.obj" --material cotton-poplin "${@:4}"
    submit "$work/$name.json"
    is "$name: the job is accepted" "$code" 202
    check "$name: it ends within $2 s" wait_for "$id" succeeded "$2"
    cp "$body" "$work/$name.job"
    jq -r '"# '"$name"': \(.verdict), \(.report.iterations) iterations, \(.report.stops) stops, \(.report.seconds) s, residual force \(.report.residual_force), \(.report.reason), \(.report.stages | tojson)"' "$work/$name.job"
    like "$name: its verdict is honest" "$(jq -r .verdict "$work/$name.job")" "^($3)\$"
    request GET "/v1/jobs/$id/result?format=obj"
    is "$name: there is a result" "$code" 200
    cp "$body" "$work/$name.obj"
    is "$name: it has the garment's vertices" "$(grep -c '^v ' "$body")" "$(grep -c '^v ' "$shared/garments/$name.obj")"
    "$measure" "$work/$name.obj" "$shared/garments/$name.seams" "$shared/bodies/body_f_A.obj" >"$work/$name.measure"
    echo "# $name: measured $(cat "$work/$name.measure")"
    "$crossings" "$work/$name.obj" "$shared/bodies/body_f_A.obj" >"$work/$name.crossings"
    jq -r --arg name "$name" '"# \($name): \(.cloth_body.crossings) crossings with the body and \(.cloth_body.touches) touches, "
        + "\(.cloth_cloth.crossings) with itself and \(.cloth_cloth.touches)"' "$work/$name.crossings"
    json "$name: every position is finite" '.finite' "$work/$name.measure"
    json "$name: no vertex lies more than 1 mm inside the body" '.deepest <= 0.001' "$work/$name.measure"
    json "$name: no seam is open" '.seam_gap <= 1e-6' "$work/$name.measure"
    check "$name: the report counts the vertices inside as they are" jq -e --slurpfile m "$work/$name.measure" \
        '(.report.penetrations > 0) or ($m[0].deepest < 0.001)' "$work/$name.job"
}
drape shirt_coarse 300 'at-rest'
# With friction: 20 to 27 iterations at 0.29 to 0.31; 40 to 50 without the second-order correction and the chords.
drape shirt_coarse 300 'at-rest' --friction 0.3
json 'shirt_coarse: its steps are corrected' '.report.iterations <= 35' "$work/shirt_coarse.job"
json 'shirt_coarse: it crosses neither the body nor itself' '.cloth_body.crossings + .cloth_cloth.crossings == 0' \
    "$work/shirt_coarse.crossings"
# Without friction nothing holds a skirt up but its waist: it may slide, and must then say so. A minute
# is not enough for it to rest.
drape skirt8 300 'at-rest|not-at-rest|slid-off' --time-limit 60
# Its edges are 12 mm; between the vertices of the shirt's 30 mm the body comes through.
json 'skirt8: it neither crosses nor touches the body' '.cloth_body.crossings + .cloth_body.touches == 0' \
    "$work/skirt8.crossings"
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
