#!/bin/bash
# A body that moves before the drape, through the API: by reference and inline, what progress and report say of it;
# and a real shirt carried from one real posture through another to a third.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# ---- a table --------------------------------------------------------------------------------------

table='[-3, -0.003, -2, 3, -0.003, -2, 0, -0.003, 4, 0, -3, 0]'
# patch KEYFRAMES: a patch of cloth on a table that moves to them.
patch() {
    jq -n --argjson table "$table" --argjson motion "$1" '
        {cloth: {mesh: {positions: [0,0,0, 0.1,0,0, 0,0,0.1, 0.1,0,0.1], triangles: [0,2,1, 1,2,3],
                        pattern: [0,0, 0.1,0, 0,0.1, 0.1,0.1]}, materials: [{preset: "cotton-poplin"}]},
         bodies: [{friction: 0.5, mesh: {positions: $table, triangles: [0,2,1, 0,1,3, 1,2,3, 2,0,3]},
                   motion: $motion, motion_seconds: 0.5}]}'
}
moved=$(jq -nc --argjson table "$table" '[$table | _nwise(3) | .[0] + 0.1, .[1], .[2]]')
keyframe=$(jq -nc --argjson p "$moved" '{positions: $p, triangles: [0,2,1, 0,1,3, 1,2,3, 2,0,3]}')
request POST /v1/meshes -H 'Content-Type: application/json' --data-binary "$keyframe"
like 'a keyframe is uploaded' "$code" '^20[01]$'
ref=$(jq -r '.sha256 // .id' "$body")
for kind in inline ref; do
    case $kind in
        inline) motion="[{\"positions\": $moved}]" ;;
        ref) motion="[{\"ref\": \"$ref\"}]" ;;
    esac
    patch "$motion" >"$work/$kind.json"
    submit "$work/$kind.json"
    is "$kind: the job is accepted" "$code" 202
    check "$kind: it ends" wait_for "$id" succeeded 60
    json "$kind: it comes to rest" '.verdict == "at-rest"'
    json "$kind: the report counts the frames" '.report.motion.frames >= 25 and .report.stages.motion > 0'
    json "$kind: the plan keeps motion" '[.report.plan.kept[].name] | index("motion") != null'
    request GET "/v1/jobs/$id/result?format=json"
    json "$kind: the cloth went along" '.positions[0] | . > 0.0985 and . < 0.1015'
    jq -c .positions "$body" >"$work/$kind.positions"
done
check 'by reference and inline are the same bytes' cmp "$work/inline.positions" "$work/ref.positions"
patch '[]' >"$work/none.json"
jq 'del(.bodies[0].motion_seconds)' "$work/none.json" >"$work/still.json"
submit "$work/still.json"
check 'no keyframes: it ends' wait_for "$id" succeeded 60
json 'no keyframes: no frames' '.report.motion.frames == 0'
json 'no keyframes: the plan says why' '.report.plan.left_out[] | select(.name == "motion").reason == "no body moves"'

# ---- progress ------------------------------------------------------------------------------------

"$DRAPE" example square --triangles 5000 | jq --argjson of "$(<"$work/inline.json")" '
    .bodies = $of.bodies | .bodies[0].motion_seconds = 60' >"$work/slow.json"
submit "$work/slow.json"
phase=''
for ((i = 0; i < 600; i++)); do
    request GET "/v1/jobs/$id"
    phase=$(jq -r '.progress.phase // .status' "$body")
    [[ $phase == queued || $phase == running ]] || break
    sleep 0.02
done
is 'progress names the phase' "$phase" moving
request DELETE "/v1/jobs/$id"
check 'and a job can be cancelled in it' wait_for "$id" canceled 30

# ---- a person ------------------------------------------------------------------------------------

shared=../shared/data
if [[ ! -r $shared/bodies/body_f_standing05.obj ]]; then
    skip 'a shirt follows a person: ../shared/data is absent'
    stop_daemon
    finish
    exit 0
fi
crossings=build/release/tests/api/crossings
"$DRAPE" scene --garment "$shared/garments/shirt_coarse.obj" --seams "$shared/garments/shirt_coarse.seams" \
    --body "$shared/bodies/body_f_A.obj" --motion "$shared/bodies/body_f_standing05_half.obj" \
    --motion "$shared/bodies/body_f_standing05.obj" --material cotton-poplin --friction 0.3 --time-limit 300 \
    >"$work/shirt.json"
submit "$work/shirt.json"
is 'shirt_coarse: the job is accepted' "$code" 202
check 'shirt_coarse: it ends' wait_for "$id" succeeded 400
cp "$body" "$work/shirt.job"
jq -r '"# shirt_coarse: \(.verdict), \(.report.motion.frames) frames, \(.report.iterations) iterations, \(.report.seconds) s, \(.report.stages | tojson)"' "$work/shirt.job"
json 'shirt_coarse: at rest on the last posture' '.verdict == "at-rest" and .report.penetrations == 0' "$work/shirt.job"
request GET "/v1/jobs/$id/result?format=obj"
cp "$body" "$work/shirt.obj"
"$crossings" "$work/shirt.obj" "$shared/bodies/body_f_standing05.obj" >"$work/shirt.crossings"
"$crossings" "$work/shirt.obj" "$shared/bodies/body_f_A.obj" >"$work/start.crossings"
jq -r '"# shirt_coarse: \(.cloth_body.crossings) crossings with the body, \(.cloth_cloth.crossings) with itself"' "$work/shirt.crossings"
json 'shirt_coarse: the body of the last posture does not come through' '.cloth_body.crossings == 0' \
    "$work/shirt.crossings"
# It would be 0 had the shirt stayed.
json 'shirt_coarse: it is not where the first posture was' '.cloth_body.crossings > 100' "$work/start.crossings"
stop_daemon
is 'the daemon stops with status 0' "$status" 0
finish
