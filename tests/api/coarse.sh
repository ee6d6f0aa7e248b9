#!/bin/bash
# Coarse to fine over the API: a garment that is to be draped on a coarse mesh first, and one that is not.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# drape NAME CHOICE [FILTER [TRIANGLES]]: the example's garment; leaves its id.
drape() {
    build/drape example garment --triangles ${4:-600} | jq -c --arg coarse "$2" ".solver.coarse = \$coarse${3:+ | $3}" >"$work/job"
    submit "$work/job"
    check "$1 is solved" wait_for "$id" succeeded 120
}

drape 'a garment, coarse first' on
json 'it comes to rest whole' '.verdict == "at-rest" and .report.self_intersections == 0 and .report.penetrations == 0'
json 'the report says what came of the coarse mesh' '.report.coarse | .carried and .iterations > 0
    and .factorizations > .iterations and .triangles > 40 and .triangles < 150'
json 'it is a term of the plan, and a stage' '(.report.plan.kept | any(.[]; .name == "coarse" and .bytes > 0))
    and .report.stages.coarse > 0 and .report.stages.sew == 0'
request GET "/v1/jobs/$id/result?format=json"
json 'the result is of the whole mesh' ".triangles | length == $(jq '.cloth.mesh.triangles | length' "$work/job")"

drape 'the same without' off '.solver.max_iterations = 2'
json 'nothing is coarse' '(.report.coarse == {triangles: 0, iterations: 0, factorizations: 0, carried: false})
    and (.report.plan.left_out | any(.[]; .name == "coarse" and .reason == "switched off"))'
drape 'a coarse one left to itself' auto '.solver.max_iterations = 2'
json 'is sewn whole' '.report.plan.left_out | any(.[]; .name == "coarse" and .reason == "auto: the mesh is coarse itself")'
drape 'a fine one left to itself' auto '.solver.max_iterations = 2' 2400
json 'is sewn coarse' '.report.coarse | .carried and .triangles < 500'

build/drape example square --triangles 2400 | jq -c '.solver = {method: "auto", coarse: "auto", tolerance: 1e-6}' >"$work/job"
submit "$work/job"
check 'a flat sheet is solved' wait_for "$id" succeeded 120
json 'draped coarse first' '.report.coarse | .carried and .triangles < 500 and .iterations > 1'
json 'which its seconds hold' '.report.seconds > .report.stages.coarse and .report.stages.coarse > 0'
request GET "/v1/jobs/$id/trace?format=json"
json 'the trace begins at its own start' '(.columns | index("potential")) as $e
    | (.rows[0][$e] | fabs) < 1e-12 and .rows[1][$e] < -0.01 and .rows[0][.columns | index("residual_energy")] == null'
jq -c '.solver.method = "stop-and-go" | .solver.max_iterations = 1' "$work/job" >"$work/paper"
submit "$work/paper"
check 'the same by another method is solved' wait_for "$id" succeeded 120
json 'is draped as it is' '.report.plan.left_out | any(.[]; .name == "coarse" and .reason == "auto: nothing has to be sewn")'

# ---- the preview -----------------------------------------------------------------------------------

glb_triangles() { # of the file's first chunk, which is JSON
    python3 -c 'import json, struct, sys
data = open(sys.argv[1], "rb").read()
gltf = json.loads(data[20:20 + struct.unpack_from("<I", data, 12)[0]])
primitive = gltf["meshes"][0]["primitives"][0]
print(gltf["accessors"][primitive["indices"]]["count"] // 3, " ".join(sorted(primitive["attributes"])))' "$1"
}
slow='.solver.tolerance = 1e-12 | .solver.max_iterations = 100000 | .bodies[].friction = 0.3' # it is cancelled; without friction round-off would end it

endless 8 >"$work/job"
submit "$work/job"
request GET "/v1/jobs/$id/preview"
problem 'a job without a coarse mesh has no preview' 404 not-found
like 'and is told so' "$(jq -r .detail "$body")" 'no preview yet'
request GET "/v1/jobs/$id"
json 'nor a link to it' '.links | has("preview") and .preview == null'
request DELETE "/v1/jobs/$id"
check 'it is cancelled' wait_for "$id" canceled 60

build/drape example garment --triangles 2400 | jq -c ".solver.coarse = \"on\" | $slow" >"$work/job"
submit "$work/job"
timeout 120 curl -sN "$url/v1/jobs/$id/events" | sed '/^event: preview/q' >"$work/stream"
event=$(tail -n 1 "$work/stream")
is 'the garment as it was sewn is an event' "$event" 'event: preview'
request HEAD "/v1/jobs/$id/preview"
sewn=$(header etag)
timeout 120 curl -sN "$url/v1/jobs/$id/events" -H 'Last-Event-ID: 1.2' |
    awk '{ print } /^event: preview/ && ++n == 4 { exit }' >"$work/stream"
is 'and others follow as it is draped' "$(grep -c '^event: preview' "$work/stream")" 4
check 'while the job runs' bash -c '! grep -q "^event: end" "$1"' - "$work/stream"
request GET "/v1/jobs/$id"
json 'the job links to it' '.status == "running" and .links.preview == .links.self + "/preview"'
request GET "/v1/jobs/$id/preview"
is 'it is there' "$code $(header content-type)" '200 model/gltf-binary'
like 'a ninth of the triangles, with normals and the pattern' "$(glb_triangles "$body")" \
    '^(1[5-9].|[23]..|4[0-4].) NORMAL POSITION TEXCOORD_0$'
check 'not what it was when sewn' test -n "$sewn" -a "$(header etag)" != "$sewn"
# What comes between two requests is newer: each pair is asked for again until nothing does.
for try in {1..20}; do
    request GET "/v1/jobs/$id/preview"
    etag=$(header etag)
    request GET "/v1/jobs/$id/preview" -H "If-None-Match: $etag"
    [[ $(header etag) == "$etag" ]] && break
done
is 'it is not sent again' "$code $(header etag)" "304 $etag"
is 'and varies by Accept' "$(header vary)" Accept
for try in {1..20}; do
    request GET "/v1/jobs/$id/preview"
    etag=$(header etag)
    request HEAD "/v1/jobs/$id/preview"
    [[ $(header etag) == "$etag" ]] && break
done
is 'its head tells as much' "$code $(header etag)" "200 $etag"
request GET "/v1/jobs/$id/preview" -H 'Accept: text/html'
problem 'it comes as GLB only' 406 not-acceptable
request GET "/v1/jobs/$id/preview?format=obj"
problem 'and takes no arguments' 400 bad-request
timeout 5 curl -sN "$url/v1/jobs/$id/events" -H 'Last-Event-ID: 1.2' >"$work/stream"
check 'who was cut off before them gets the events' test "$(grep -c '^event: preview' "$work/stream")" -ge 4
request DELETE "/v1/jobs/$id"
check 'the job is cancelled' wait_for "$id" canceled 60
json 'the link is gone' '.links.preview == null'
request GET "/v1/jobs/$id/preview"
problem 'and so is the preview' 404 not-found
request GET "/v1/jobs/00000000000000000000000000000000/preview"
problem 'no job, no preview' 404 not-found
stop_daemon
finish
