#!/bin/bash
# Every route of the contract answers as promised when asked politely.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# ---- about the daemon
request GET /v1/info
is 'GET /v1/info answers 200' "$code" 200
json 'info has a version' '.version | test("^[0-9]+\\.[0-9]+\\.[0-9]+$")'
json 'info has limits, all positive' '.limits | type == "object" and length >= 5 and all(.[]; . > 0)'
# What info names is what a job may name: both are held to the same document.
openapi=server/openapi.json
check 'the OpenAPI document is in order' tests/api/contract.py lint
for list in method integrator; do
    json "info names every $list of the contract" ".${list}s == $(jq -c ".components.schemas.Solver.properties.$list.enum" $openapi)"
done
json 'info has formats' '.formats | tostring | test("glb") and test("obj")'
request GET /v1/materials
is 'GET /v1/materials answers 200' "$code" 200
json 'there are at least eight presets' '.materials | length >= 8'
json 'each preset has a name, SI numbers and a source' '.materials | all(.[]; (.name | test("^[a-z0-9-]+$"))
    and .density > 0.02 and .density < 1 and .stretch.weft > 0 and .stretch.warp > 0 and .stretch.shear > 0
    and (.source | length > 5))'
json 'preset names are unique' '[.materials[].name] | length == (unique | length)'
cp "$body" "$work/materials"

# ---- the admin listener
request GET "$admin/livez"; is 'GET /livez answers 200' "$code" 200
request GET "$admin/readyz"; is 'GET /readyz answers 200' "$code" 200
request GET "$admin/metrics"
is 'GET /metrics answers 200' "$code" 200
like 'metrics are Prometheus text 0.0.4' "$(header content-type)" '^text/plain; *version=0\.0\.4'
check 'every metric has help and type before it' awk '
    /^# HELP / {help[$3] = 1; next}
    /^# TYPE / {if (!help[$3]) exit bad = 1; type[$3] = 1; next}
    /^$/ {next}
    {name = $1; sub(/{.*/, "", name); base = name; sub(/_(bucket|sum|count)$/, "", base)
     if (!type[name] && !type[base]) exit bad = 1; lines++}
    END {exit bad || !lines}' "$body"
request GET /livez; problem 'the API listener does not serve the admin routes' 404 not-found
request GET "$admin/v1/info"; is 'the admin listener does not serve the API' "$code" 404

# ---- a job, from POST to DELETE
square 10 '.name = "blue square" | .labels = {"order": "4711"}' >"$work/job"
submit "$work/job"
is 'POST /v1/jobs answers 202' "$code" 202
is 'Location names the job' "$(header location)" "/v1/jobs/$id"
like 'Retry-After is given in seconds' "$(header retry-after)" '^[0-9]+$'
like 'ids are 128 random bits' "$id" '^[0-9a-f]{32}$'
json 'the job is queued or running' '.status == "queued" or .status == "running"'
json 'the job body has every member of the contract' '
    (keys | contains(["id","name","labels","status","verdict","revision","attempt","created_at","started_at",
    "finished_at","queue_position","progress","report","error","links","warnings","trace_id","priority"]))
    and .warnings == [] and .priority == "normal"
    and .name == "blue square" and .labels == {"order": "4711"} and .verdict == null and .report == null
    and .error == null and (.created_at | type == "string")'
check 'the job succeeds' wait_for "$id" succeeded
json 'it comes to rest' '.verdict == "at-rest"'
json 'its report is complete' '.report | (.plan | has("kept") and has("left_out")) and .method == "auto"
    and .iterations > 0 and .stops == 0 and .factorizations > 0 and .solves > 0 and .seconds > 0
    and (.stages | length > 0) and .peak_bytes > 0 and (.peak_bytes_by_phase | keys) == ["draping"]
    and .peak_bytes_by_phase.draping == .peak_bytes and .bytes_per_triangle > 0 and (.energies | has("stretch") and has("bend") and
    has("gravity") and has("contact") and has("kinetic") and has("potential")) and .residual_force <= 0.01
    and (.residual_energy | type == "number") and .penetrations == 0 and (.reason | length > 3)'
json 'its progress is complete' '.progress | .iteration > 0 and .elapsed_ms >= 0 and (.energy | has("potential"))
    and .residual_force <= 0.01 and .stops == 0 and has("percent")'
json 'times are in order' '.created_at <= .started_at and .started_at <= .finished_at and .attempt == 1'
etag=$(header etag)
like 'its ETag begins with its revision' "$etag" "^\"$(jq -r .revision "$body")-"
request GET "/v1/jobs/$id" -H "If-None-Match: $etag"; is 'an unchanged job answers 304' "$code" 304
request GET "/v1/jobs/$id" -H 'If-None-Match: "0"'; is 'a changed one answers 200' "$code" 200

request GET "/v1/jobs/$id/result"
is 'GET result answers 200' "$code" 200
request GET "/v1/jobs/$id/result?format=json"
like 'the result as JSON' "$(header content-type)" '^application/json'
json 'has as many vertices as the job, in its order' '(.positions | length) == 363 and (.normals | length) == 363
    and (.triangles | length) == 600 and (.pattern | length) == 242 and .verdict == "at-rest"'
check 'pins stay where they were' jq -e --slurpfile job "$work/job" '.positions as $x
    | $job[0].cloth.mesh.positions as $x0 | all($job[0].cloth.pins[]; [$x[3*.:3*.+3], $x0[3*.:3*.+3]]
    | transpose | all(.[]; (.[0] - .[1]) | . < 1e-6 and . > -1e-6))' "$body"
json 'the free edge hangs' '[.positions[3*110+1], .positions[3*120+1]] | all(.[]; . < -0.05)'
json 'normals are of unit length' '[.normals | _nwise(3) | (.[0]*.[0] + .[1]*.[1] + .[2]*.[2])]
    | all(.[]; . > 0.999 and . < 1.001)'
like 'a result has an ETag' "$(header etag)" '^"'
etag=$(header etag)
request GET "/v1/jobs/$id/result?format=json" -H "If-None-Match: $etag"; is 'an unchanged result answers 304' "$code" 304
like 'and varies by Accept' "$(header vary)" 'Accept'
request GET "/v1/jobs/$id/result" -H 'Accept: model/obj'
like 'Accept: model/obj gives OBJ' "$(header content-type)" '^model/obj'
is 'OBJ has the vertices' "$(grep -c '^v ' "$body")" 121
is 'OBJ has the triangles' "$(grep -c '^f ' "$body")" 200
request GET "/v1/jobs/$id/result" -H 'Accept: model/gltf-binary'
is 'GLB starts with its magic' "$(head -c 4 "$body")" glTF
is 'GLB states its own length' "$(od -An -tu4 -j8 -N4 "$body" | tr -d ' ')" "$(stat -c %s "$body")"
request GET "/v1/jobs/$id/result?format=ply"; is 'PLY starts with its magic' "$(head -c 3 "$body")" ply
request GET "/v1/jobs/$id/result" -H 'Accept: text/html'; problem 'another type is not acceptable' 406 not-acceptable
request GET "/v1/jobs/$id/result?format=fbx"; problem 'nor is another format' 406 not-acceptable
is 'it says what there is' "$(jq -r .detail "$body")" \
    'There are json (application/json), glb (model/gltf-binary), obj (model/obj), ply (application/x-ply).'

request GET "/v1/jobs/$id/trace?format=csv"
like 'the trace as CSV' "$(header content-type)" '^text/csv'
is 'has the header line of the contract' "$(head -n 1 "$body" | tr -d '\r')" \
    iteration,seconds,stretch,bend,gravity,contact,kinetic,potential,residual_energy,residual_force,stop,time_step,linear_iterations,factorizations
check 'each row has fourteen numbers, iterations count up' awk -F, 'NR > 1 {
    if (NF != 14 || $1 != NR - 2 || $2 < seconds) exit bad = 1; seconds = $2} END {exit bad || NR < 3}' "$body"
check 'potential energy is the sum of its parts' awk -F, 'NR > 1 {d = $3 + $4 + $5 + $6 - $8
    if (d > 1e-9 || d < -1e-9) exit bad = 1} END {exit bad}' "$body"
rows=$(($(wc -l <"$body") - 1))
request GET "/v1/jobs/$id/trace?format=json"
check 'the trace as JSON has as many rows' jq -e --argjson n "$rows" '(.rows // .) | length == $n' "$body"
request GET "/v1/jobs/$id/trace?format=svg"
like 'the trace as SVG' "$(header content-type)" '^image/svg\+xml'
check 'is a drawing' grep -q '</svg>' "$body"

request GET '/v1/jobs?label=order:4711'
is 'GET /v1/jobs answers 200' "$code" 200
json 'jobs are found by label' '(.jobs | length) == 1'
request GET '/v1/jobs?status=failed'; json 'and by status' '(.jobs | length) == 0'

# ---- pages
for n in 1 2 3 4; do
    square 4 ".name = \"page $n\"" >"$work/small"
    submit "$work/small"
done
wait_for "$id" succeeded
# turn_pages PATH: the ids on it and on the pages it leads to in $seen, the number of pages in $page.
turn_pages() {
    local path=$1
    seen=''
    for ((page = 0; page < 9 && ${#path}; page++)); do
        request GET "$path"
        seen+=$(jq -r '.jobs[].id' "$body")$'\n'
        path=$(header link | sed -n 's/.*<\([^>]*\)>; *rel="next".*/\1/p')
    done
}
turn_pages '/v1/jobs?limit=2'
is 'pages give each job once' "$(sort -u <<<"$seen" | grep -c .)" 5
is 'in three pages of two' "$page" 3
for n in 1 2 3; do
    square 4 '.labels = {"size & fit": "3 = L/XL"}' >"$work/small"
    submit "$work/small"
done
wait_for "$id" succeeded
turn_pages '/v1/jobs?limit=1&status=succeeded&label=size%20%26%20fit:3%20%3D%20L%2FXL'
is 'pages keep to the label and the status asked for' "$page $(sort -u <<<"$seen" | grep -c .)" '3 3'

# ---- uploaded meshes
printf 'v 0 0 0\nv 0.1 0 0\nv 0 0 0.1\nvt 0 0\nvt 0.1 0\nvt 0 0.1\nf 1/1 2/2 3/3\n' >"$work/mesh.obj"
sha=$(sha256sum "$work/mesh.obj" | cut -d' ' -f1)
request POST /v1/meshes -H 'Content-Type: model/obj' --data-binary "@$work/mesh.obj"
is 'a new mesh answers 201' "$code" 201
is 'at its digest' "$(header location)" "/v1/meshes/$sha"
request PUT "/v1/meshes/$sha" -H 'Content-Type: model/obj' --data-binary "@$work/mesh.obj"
is 'a known mesh answers 200' "$code" 200
request GET "/v1/meshes/$sha"
is 'GET of a mesh answers 200' "$code" 200
is 'and gives the same bytes' "$(sha256sum <"$body" | cut -d' ' -f1)" "$sha"
request HEAD "/v1/meshes/$sha"; is 'HEAD of a mesh answers 200' "$code" 200
jq -n --arg ref "$sha" '{cloth: {mesh: {ref: $ref}, pins: [0, 1], materials: [{preset: "cotton-poplin"}]}}' >"$work/small"
submit "$work/small"
is 'a job may name it' "$code" 202
check 'and drapes it' wait_for "$id" succeeded

# ---- presets all work
while read -r name; do
    square 4 ".cloth.materials = [{preset: \"$name\"}] | .solver.max_iterations = 3" >"$work/small"
    submit "$work/small"
    is "preset $name is taken" "$code" 202
done < <(jq -r '.materials[].name' "$work/materials")

# ---- the end of a job
square 4 >"$work/small"
request POST /v1/jobs -H 'Content-Type: application/json' -H 'Prefer: wait=20' --data-binary "@$work/small"
is 'Prefer: wait sees the end and answers 200' "$code" 200
like 'and says that it was heeded' "$(header preference-applied)" '^wait'
json 'with the finished job' '.status == "succeeded"'
id=$(jq -r .id "$body")
request DELETE "/v1/jobs/$id"; is 'DELETE of an ended job answers 204' "$code" 204
request GET "/v1/jobs/$id"; like 'and it is gone' "$code" '^(404|410)$'
request DELETE "/v1/jobs/$id"; like 'DELETE is repeatable' "$code" '^(204|404|410)$'

square 6 '.solver.max_iterations = 0' >"$work/small"
request POST /v1/jobs -H 'Content-Type: application/json' -H 'Prefer: wait=20' --data-binary "@$work/small"
json 'evaluate-only ends not-at-rest with the energies of the start' '.status == "succeeded" and
    .verdict == "not-at-rest" and .report.iterations == 0 and .report.energies.stretch < 1e-9'
request GET "/v1/jobs/$(jq -r .id "$body")/result"; problem 'but an undraped start is no result' 409 no-result

# ---- a data folder that went away; the daemon looks every five seconds
rm -rf "$data"
for ((i = 0; i < 100; i++)); do
    request GET "$admin/readyz"
    [[ $code == 503 ]] && break
    sleep 0.1
done
is 'without its data folder it is not ready' "$code" 503
like 'and says why' "$(<"$body")" 'data folder'
request GET "$admin/livez"; is 'but alive' "$code" 200
stop_daemon; is 'and stops with status 0' "$status" 0
finish
