#!/bin/bash
# What is refused, with which status, code and place: requests, documents, scenes, limits.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# refuse NAME STATUS CODE POINTER FILTER: a good job, spoilt by the jq filter.
refuse() {
    square 4 "$5" >"$work/bad"
    request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$work/bad"
    problem "$1" "$2" "$3" "$4"
}
# refuse_text NAME STATUS CODE TEXT
refuse_text() {
    printf '%s' "$4" >"$work/bad"
    request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$work/bad"
    problem "$1" "$2" "$3"
}
job=$(square 4)

# ---- not JSON
refuse_text 'an empty body' 400 bad-json ''
refuse_text 'half a document' 400 bad-json "${job:0:200}"
refuse_text 'two documents' 400 bad-json "$job$job"
refuse_text 'a duplicate member' 400 bad-json '{"name":"a","name":"b"}'
refuse_text 'NaN is not JSON' 400 bad-json "${job/\"density\":0.15/\"density\":NaN}"
refuse_text 'bytes that are not UTF-8' 400 bad-json $'{"name":"\xff"}'
deep=$(printf '[%.0s' {1..5000})
refuse_text 'nesting without end' 400 bad-json "$deep"
refuse_text 'a byte order mark' 400 bad-json $'\xef\xbb\xbf'"$job"

# ---- wrong types and unknown members
refuse_text 'an array' 422 invalid '[]'
refuse_text 'a number alone' 400 bad-json '42'
refuse_text 'an empty object' 422 invalid '{}'
refuse 'an unknown member' 422 invalid /cloths '.cloths = 1'
refuse 'an unknown member inside' 422 invalid /cloth/mesh/colour '.cloth.mesh.colour = 1'
refuse 'a slash in a member name is escaped in the pointer' 422 invalid '/cloth/a~1b~0c' '.cloth["a/b~c"] = 1'
refuse 'a string for an array' 422 invalid /cloth/mesh/positions '.cloth.mesh.positions = "x"'
refuse 'a string among numbers' 422 invalid /cloth/mesh/positions/4 '.cloth.mesh.positions[4] = "x"'
refuse 'null among numbers' 422 invalid /cloth/mesh/positions/4 '.cloth.mesh.positions[4] = null'
refuse 'a fraction as index' 422 invalid /cloth/mesh/triangles/3 '.cloth.mesh.triangles[3] = 1.5'
refuse 'a negative index' 422 invalid /cloth/mesh/triangles/3 '.cloth.mesh.triangles[3] = -1'
refuse 'an index past 32 bits' 422 invalid /cloth/mesh/triangles/3 '.cloth.mesh.triangles[3] = 4294967296'
refuse 'positions not in threes' 422 invalid /cloth/mesh/positions '.cloth.mesh.positions |= .[:-1]'
refuse 'triangles not in threes' 422 invalid /cloth/mesh/triangles '.cloth.mesh.triangles |= .[:-1]'
refuse 'pattern of another length' 422 invalid /cloth/mesh/pattern '.cloth.mesh.pattern |= .[:-2]'
refuse 'seams not in pairs' 422 invalid /cloth/seams '.cloth.seams = [0]'
refuse 'no mesh' 422 invalid '' 'del(.cloth.mesh)'
refuse 'no materials' 422 invalid '' 'del(.cloth.materials)'
refuse 'an empty list of materials' 422 invalid /cloth/materials '.cloth.materials = []'
refuse 'an unknown preset' 422 invalid /cloth/materials/0/preset '.cloth.materials = [{preset: "unobtainium"}]'
refuse 'an unknown method' 422 invalid /solver/method '.solver.method = "magic"'
refuse 'a certificate neither asked for nor not' 422 invalid /solver/certify '.solver.certify = "yes"'
refuse 'a coarse mesh of an unknown kind' 422 invalid /solver/coarse '.solver.coarse = true'
refuse 'a fit neither asked for nor not' 422 invalid /fit '.fit = 1'
refuse 'damping where there is none' 422 invalid /solver/damping/air '.solver.damping.air = 1'
refuse 'a negative tolerance' 422 invalid /solver/tolerance '.solver.tolerance = -1'
refuse 'a tolerance that free fall would meet' 422 invalid /solver/tolerance '.solver.tolerance = 1.5'
refuse 'no time step' 422 invalid /solver/time_step '.solver.time_step = 0'
refuse 'gravity of two numbers' 422 invalid /gravity '.gravity = [0, 1]'
refuse 'a name too long' 422 invalid /name '.name = ("n" * 201)'
refuse 'labels that are no strings' 422 invalid /labels/order '.labels = {order: 1}'

# ---- scenes that cannot be
refuse 'a triangle of a vertex that is not there' 422 invalid /cloth/mesh/triangles/3 '.cloth.mesh.triangles[3] = 25'
refuse 'a pin that is not there' 422 invalid /cloth/pins/1 '.cloth.pins = [0, 25]'
refuse 'a seam to nowhere' 422 invalid /cloth/seams/1 '.cloth.seams = [0, 25]'
refuse 'a seam between two corners of a triangle' 422 invalid /cloth/seams/0 '.cloth.seams = .cloth.mesh.triangles[-3:-1]'
refuse 'a material that is not there' 422 invalid /cloth/triangle_material/5 \
    '.cloth.triangle_material = [range(32) | 0] | .cloth.triangle_material[5] = 1'
refuse 'an elastic along no edge' 422 invalid /cloth/elastics/1/edges/2 '.cloth.elastics =
    [{edges: [0, 1], factor: 0.7, stiffness: 30}, {edges: [1, 2, 1, 5], factor: 0.7, stiffness: 30}]'
refuse 'an elastic of no length' 422 invalid /cloth/elastics/0/factor '.cloth.elastics = [{edges: [0, 1], factor: 0, stiffness: 30}]'
refuse 'a fold along a border' 422 invalid /cloth/folds/0/edges/0 '.cloth.folds = [{edges: [0, 1], angle: 90, stiffness: 1e-3}]'
refuse 'a fold past a full one' 422 invalid /cloth/folds/0/angle '.cloth.folds = [{edges: [5, 6], angle: 181, stiffness: 1e-3}]'
refuse 'a tack to no body' 422 invalid /cloth/tacks/0/body '.cloth.tacks = [{vertex: 24, body: 0, point: [0, 0, 0]}]'
refuse 'a tack of a pinned vertex' 422 invalid /cloth/tacks/0/vertex '.cloth.tacks = [{vertex: 0, body: 0, point: [0, 0, 0]}]
    | .bodies = [{sphere: {center: [0, -1, 0], radius: 0.1}}]'
refuse 'cloth that shrinks to nothing' 422 invalid /cloth/materials/0/shrink/warp '.cloth.materials[0].shrink = {warp: 1}'
refuse 'too few materials for the triangles' 422 invalid /cloth/triangle_material '.cloth.triangle_material = [0]'
refuse 'a triangle of two vertices' 422 invalid '' '.cloth.mesh.triangles[0:3] = [0, 0, 1]'
refuse 'a triangle without area in the pattern' 422 invalid '' '.cloth.mesh.pattern[2:4] = .cloth.mesh.pattern[0:2]'
refuse 'an edge of three triangles' 422 invalid '' '.cloth.mesh.triangles += [0, 6, 12]
    | .cloth.mesh.triangles += [0, 6, 18]'
refuse 'a seam that makes an edge of three triangles' 422 invalid '' '.cloth.seams = [0, 10, 1, 11]'
square 4 '.cloth.mesh.positions[0] = "HUGE"' | sed 's/"HUGE"/1e999/' >"$work/huge"
request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$work/huge"
like 'a number too large for a double' "$code" '^(400|422)$'
refuse 'no density' 422 invalid /cloth/materials/0/density '.cloth.materials[0].density = 0'
refuse 'negative stiffness' 422 invalid /cloth/materials/0/stretch/weft '.cloth.materials[0].stretch.weft = -1'
refuse 'a Poisson ratio of one' 422 invalid /cloth/materials/0/poisson '.cloth.materials[0].poisson = 1'
refuse 'negative bending' 422 invalid /cloth/materials/0/bend '.cloth.materials[0].bend = -1'
refuse 'a sphere without radius' 422 invalid /bodies/0/sphere/radius '.bodies = [{sphere: {center: [0,0,0], radius: 0}}]'
refuse 'a body of two shapes' 422 invalid /bodies/0 '.bodies = [{sphere: {center: [0,0,0], radius: 1}, plane: {point: [0,0,0], normal: [0,1,0]}}]'
refuse 'a plane without direction' 422 invalid /bodies/0/plane/normal '.bodies = [{plane: {point: [0,0,0], normal: [0,0,0]}}]'
refuse 'an open body' 422 invalid '' '.bodies = [{mesh: {positions: [0,0,0,1,0,0,0,1,0], triangles: [0,1,2]}}]'
refuse 'a sphere that moves' 422 invalid /bodies/0/motion '.bodies = [{sphere: {center: [0,0,0], radius: 1},
    motion: [{ref: ("0" * 64)}], motion_seconds: 1}]'
refuse 'a keyframe of other vertices' 422 invalid /bodies/0/motion/0 '.bodies = [{mesh: {positions: [0,0,0,1,0,0,0,1,0,0,0,1],
    triangles: [0,2,1,0,1,3,0,3,2,1,2,3]}, motion: [{positions: [0,0,0,1,0,0,0,1,0]}]}]'
refuse 'a mesh that was never uploaded' 422 invalid /cloth/mesh/ref '.cloth.mesh = {ref: ("0" * 64)}'

# ---- requests
request POST /v1/jobs -H 'Content-Type: text/plain' --data-binary "$job"; problem 'another media type' 415 unsupported-media-type
request POST /v1/jobs -H 'Content-Type:' --data-binary "$job"; problem 'no media type' 415 unsupported-media-type
request GET /v1/jobs/00000000000000000000000000000000; problem 'an unknown job' 404 not-found
request GET /v1/jobs/nonsense; problem 'an id that is none' 404 not-found
request GET /v1/jobs/nonsense/result; problem 'its result' 404 not-found
request GET /v1/jobs/nonsense/events; problem 'its events' 404 not-found
request GET /v1/jobs/nonsense/trace; problem 'its trace' 404 not-found
request DELETE /v1/jobs/00000000000000000000000000000000; like 'DELETE of an unknown job' "$code" '^(204|404)$'
request GET /v1/nothing; problem 'an unknown route' 404 not-found
request GET /; like 'the root' "$code" '^(200|404)$'
for case in 'PUT /v1/jobs' 'DELETE /v1/info' 'POST /v1/materials' 'PATCH /v1/jobs/00000000000000000000000000000000' \
    'TRACE /v1/info'; do
    read -r method path <<<"$case"
    request "$method" "$path"; problem "$case" 405 method-not-allowed
    like "$case names the methods allowed" "$(header allow)" '(GET|POST)'
done
request GET '/v1/jobs?cursor=rubbish'; problem 'a cursor that is none' 400 bad-cursor
request GET '/v1/jobs?limit=0'; is 'a limit of none' "$code" 400
request GET '/v1/jobs?limit=201'; is 'a limit past 200' "$code" 400
request GET '/v1/jobs?limit=200'; is 'a limit of 200 is taken' "$code" 200
request GET '/v1/jobs?limit=00000001'; is 'a limit of eight digits' "$code" 400
request GET '/v1/jobs?limit=2x'; is 'a limit that is no number' "$code" 400
request GET '/v1/jobs?label=colonless'; problem 'a label without its value' 400 bad-request
request GET '/v1/jobs?cursor=cxyz'; problem 'a cursor of other digits' 400 bad-cursor
request GET '/v1/jobs?cursor=c0'; problem 'a cursor before all' 400 bad-cursor
request GET '/v1/jobs?created_after=yesterday'; problem 'a day without a date' 400 bad-request
request GET '/v1/jobs?status=sleeping'; is 'a status that is none' "$code" 400
request GET "/v1/jobs/$(printf '%%00')abc"; is 'a NUL in the path' "$code" 404
like 'is said to be none of the ids' "$(jq -r .code "$body")" '^(not-found|bad-request)$'
square 4 >"$work/good"
submit "$work/good"
request GET "/v1/jobs/$id%00"; like 'a NUL behind a good id does not cut it short' "$code" '^(400|404)$'
request GET "/v1/jobs/$id%2fresult"; like 'an escaped slash is none' "$code" '^(400|404)$'
request GET "/v1/jobs/../jobs/$id" --path-as-is; like 'nor does the path climb' "$code" '^(400|404)$'

# ---- meshes
mesh() { request POST /v1/meshes -H "Content-Type: $1" --data-binary "$2"; }
mesh model/obj $'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n'; problem 'an OBJ face of a vertex that is not there' 422 invalid
mesh model/obj $'v 0 0 zero\n'; problem 'an OBJ vertex that is no number' 422 invalid
mesh model/gltf-binary 'glTF'; problem 'a GLB cut short' 422 invalid
mesh application/x-ply $'ply\nformat ascii 1.0\nelement vertex 3\n'; problem 'a PLY cut short' 422 invalid
mesh image/png 'x'; problem 'a mesh of another media type' 415 unsupported-media-type
request PUT "/v1/meshes/$(printf '0%.0s' {1..64})" -H 'Content-Type: model/obj' --data-binary $'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n'
problem 'a mesh that is not what its digest says' 400 digest-mismatch
request GET "/v1/meshes/$(printf '0%.0s' {1..64})"; problem 'a mesh that is not there' 404 not-found

# ---- not yet
endless >"$work/long"
submit "$work/long"
wait_for "$id" running
request GET "/v1/jobs/$id/result"; problem 'a result before the end' 409 not-ready
like 'says when to ask again' "$(header retry-after)" '^[0-9]+$'
request DELETE "/v1/jobs/$id"
wait_for "$id" canceled

check 'the daemon is alive after all this' kill -0 "$pid"
stop_daemon; is 'and stops with status 0' "$status" 0
finish
