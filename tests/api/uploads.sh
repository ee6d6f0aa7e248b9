#!/bin/bash
# Meshes uploaded as they are and in forms, checked against the sender's digest, and given back in any format.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
meshes() { request POST /v1/meshes "$@"; }
# digest ALGORITHM FILE: in base64
digest() { printf "$("$1sum" "$2" | cut -d' ' -f1 | sed 's/../\\x&/g')" | base64 -w 0; }
# Positions and triangles of a JSON mesh, as this script compares them.
printf 'v 0 0 0\nv 0.1 0 0\nv 0 0.1 0.25\nv 1 1 1\nvt 0 0\nvt 0.1 0\nvt 0 0.1\nvt 0.5 0.5\nf 1/1 2/2 3/3\nf 2/2 4/4 3/3\n' >"$work/m.obj"
sha=$(sha256sum "$work/m.obj" | cut -d' ' -f1)

# ---- forms
meshes -F "mesh=@$work/m.obj"
is 'a form with a file is a new mesh, by the ending of its name' "$code" 201
json 'what is kept is the file' ".sha256 == \"$sha\" and .format == \"obj\" and .vertices == 4"
meshes -F "mesh=@$work/m.obj;type=model/obj;filename=x"; is 'by its type, and known' "$code" 200
meshes -F "mesh=@$work/m.obj;type=model/gltf-binary"; is 'a known mesh is known whatever it is called' "$code" 200
sed 's/0.25/0.5/' "$work/m.obj" >"$work/n.obj"
meshes -F "mesh=@$work/n.obj;filename=shirt"; problem 'neither type nor ending' 415 unsupported-media-type
meshes -F "mesh=@$work/n.obj;type=image/png"; problem 'another type' 415 unsupported-media-type
meshes -F "mesh=@$work/n.obj;type=model/gltf-binary"; problem 'a type that it is not of' 422 invalid
meshes -F "mesh=@$work/n.obj" -F "note=hello"; problem 'two parts' 400 bad-request
like 'the byte is named' "$(jq -r .detail "$body")" '^Byte [0-9]+ of the form: a second part'
meshes -H 'Content-Type: multipart/form-data' --data-binary x; problem 'no boundary' 400 bad-request
meshes -H 'Content-Type: multipart/form-data; boundary=b' --data-binary x; problem 'no form' 400 bad-request
request PUT "/v1/meshes/$sha" -F "mesh=@$work/m.obj"; problem 'a form that is put' 415 unsupported-media-type

# ---- digests
obj='Content-Type: model/obj'
meshes -H "$obj" -H "Content-Digest: sha-256=:$(digest sha256 "$work/n.obj"):" --data-binary "@$work/n.obj"
is 'a body with its digest is taken' "$code" 201
meshes -H "$obj" -H "Content-Digest: sha-512=:$(digest sha512 "$work/n.obj"):" --data-binary "@$work/n.obj"
is 'or with a longer one' "$code" 200
meshes -H "$obj" -H "Content-Digest: sha-256=:$(digest sha256 "$work/m.obj"):" --data-binary "@$work/n.obj"
problem 'with that of another' 400 digest-mismatch
meshes -H "$obj" -H "Content-Digest: sha-256=abc" --data-binary "@$work/n.obj"; problem 'with none' 400 bad-request
request PUT "/v1/meshes/$sha" -H "$obj" -H "Content-Digest: sha-256=:$(digest sha256 "$work/n.obj"):" --data-binary "@$work/m.obj"
problem 'PUT too' 400 digest-mismatch
square 4 >"$work/job"
request POST /v1/jobs -H 'Content-Type: application/json' -H "Content-Digest: sha-256=:$(digest sha256 "$work/m.obj"):" --data-binary "@$work/job"
problem 'and a job' 400 digest-mismatch
request POST /v1/jobs -H 'Content-Type: application/json' -H "Content-Digest: sha-256=:$(digest sha256 "$work/job"):" --data-binary "@$work/job"
is 'a job with its digest is taken' "$code" 202
# ---- back, in any format
is_mesh() { # FILE: the same mesh as JSON, by way of another upload
    [[ $code == 200 ]] || { echo "status $code"; return 1; }
    local type=$1 sha2
    cp "$body" "$work/back"
    sha2=$(curl -sS -H "Content-Type: $type" --data-binary "@$work/back" "$url/v1/meshes" | jq -r .sha256)
    curl -sS "$url/v1/meshes/$sha2?format=json" | jq -c . >"$work/back.json"
    cmp "$work/back.json" "$work/as.json"
}
request GET "/v1/meshes/$sha"; check 'as it was uploaded' cmp "$body" "$work/m.obj"
is 'with its type' "$(header content-type)" model/obj
is 'a strong tag' "$(header etag)" "\"$sha\""
is 'and what it depends on' "$(header vary)" 'Accept, Accept-Encoding'
request GET "/v1/meshes/$sha?format=json"; jq -c . "$body" >"$work/as.json"
json 'as JSON' '.positions == [0,0,0,0.1,0,0,0,0.1,0.25,1,1,1] and .triangles == [0,1,2,1,3,2] and .pattern == [0,0,0.1,0,0,0.1,0.5,0.5]'
etag=$(header etag)
like 'under a tag of its own' "$etag" "^\"$sha-json-"
request GET "/v1/meshes/$sha?format=json" -H "If-None-Match: $etag"; is 'which answers 304' "$code" 304
request GET "/v1/meshes/$sha?format=json" -H "If-None-Match: \"$sha\""; is 'but not to that of the upload' "$code" 200
# 0.1 has no float of 32 bits: its nine digits come back all the same.
sed -i 's/0\.1/0.125/g' "$work/m.obj"
meshes -H "$obj" --data-binary "@$work/m.obj"; sha=$(jq -r .sha256 "$body")
request GET "/v1/meshes/$sha?format=json"; jq -c . "$body" >"$work/as.json"
for format in obj ply glb json; do
    request GET "/v1/meshes/$sha?format=$format"; check "as $format, which reads back the same" is_mesh "$format"
done
request GET "/v1/meshes/$sha" -H 'Accept: model/gltf-binary'; is 'by Accept' "$(header content-type)" model/gltf-binary
request GET "/v1/meshes/$sha" -H 'Accept: */*'; is 'anything is the upload' "$(header content-type)" model/obj
request GET "/v1/meshes/$sha" -H 'Accept: image/png'; problem 'no mesh' 406 not-acceptable
request GET "/v1/meshes/$sha?format=stl"; problem 'no format of ours' 406 not-acceptable
is 'it says what there is' "$(jq -r .detail "$body")" \
    'There are obj (model/obj), ply (application/x-ply), glb (model/gltf-binary), json (application/json).'
request HEAD "/v1/meshes/$sha?format=ply"; is 'HEAD too' "$code:$(header content-type)" 200:application/x-ply
like 'tells the length' "$(header content-length)" '^[1-9]'
request GET "/v1/meshes/$(printf '%064d' 1)?format=ply"; problem 'a mesh that is not there' 404 not-found
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
