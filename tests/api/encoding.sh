#!/bin/bash
# Bodies that arrive compressed, answers that leave so, and what is refused of both.
. "$(dirname "$0")/lib.sh"
cap=100000
start_daemon --workers 1 --max-body $cap
json='Content-Type: application/json'

# post NAME STATUS CODE ENCODING FILE
post() {
    request POST /v1/jobs -H "$json" -H "Content-Encoding: $4" --data-binary "@$5"
    if [[ $2 == 202 ]]; then is "$1" "$code" 202; else problem "$1" "$2" "$3"; fi
}
square 4 >"$work/job"
gzip -c "$work/job" >"$work/job.gz"
# zstd of a few bytes without the program: a frame of one raw block, without a checksum.
raw_zstd() {
    local n
    n=$(stat -c %s "$1")
    # magic; a frame with a content size of 4 bytes; the size; a last raw block of so many bytes
    printf '\x28\xb5\x2f\xfd\xa0'
    printf "\\x$(printf %02x $((n & 255)))\\x$(printf %02x $((n >> 8 & 255)))\\x$(printf %02x $((n >> 16 & 255)))\\x00"
    local header=$(((n << 3) | 1))
    printf "\\x$(printf %02x $((header & 255)))\\x$(printf %02x $((header >> 8 & 255)))\\x$(printf %02x $((header >> 16 & 255)))"
    cat "$1"
}
raw_zstd "$work/job" >"$work/job.zst"

# ---- bodies
post 'a gzipped job' 202 '' gzip "$work/job.gz"
post 'by its old name' 202 '' X-GZip "$work/job.gz"
post 'a job in zstd' 202 '' zstd "$work/job.zst"
post 'a job as it is' 202 '' identity "$work/job"
cat "$work/job.gz" <(gzip -c </dev/null) >"$work/members"
post 'of two members' 202 '' gzip "$work/members"
post 'a job that is not gzip' 400 bad-encoding gzip "$work/job"
like 'says so' "$(jq -r .detail "$body")" 'gzip'
post 'a job that is not zstd' 400 bad-encoding zstd "$work/job.gz"
head -c -1 "$work/job.gz" >"$work/short"
post 'a gzipped job cut short' 400 bad-encoding gzip "$work/short"
like 'says where' "$(jq -r .detail "$body")" 'ends early'
head -c -1 "$work/job.zst" >"$work/short"
post 'a job in zstd cut short' 400 bad-encoding zstd "$work/short"
cat "$work/job.gz" "$work/job" >"$work/more"
post 'a gzipped job that goes on' 400 bad-encoding gzip "$work/more"
: >"$work/nothing"
post 'nothing at all' 400 bad-encoding gzip "$work/nothing"
gzip -c "$work/job.gz" >"$work/twice"
post 'gzipped twice, said once' 400 bad-json gzip "$work/twice"
for coding in br deflate compress 'gzip, gzip' 'gzip,identity' gzipp; do
    post "another encoding: $coding" 415 unsupported-encoding "$coding" "$work/job.gz"
done
is 'which names those it takes' "$(header accept-encoding)" 'gzip, zstd'
request POST /v1/jobs -H "$json" -H 'Content-Encoding: gzip' -H 'Content-Encoding: gzip' --data-binary "@$work/twice"
problem 'given in two lines' 415 unsupported-encoding

# fill BYTES: a job of so many bytes, blanks at its end.
fill() { cat "$work/job" && head -c $(($1 - $(stat -c %s "$work/job"))) /dev/zero | tr '\0' ' '; }
fill $cap | gzip -c >"$work/full"
post 'a job of as many bytes as a body may have' 202 '' gzip "$work/full"
fill $((cap + 1)) | gzip -c >"$work/full"
post 'and one more' 413 body-too-large gzip "$work/full"
head -c 64000000 /dev/zero | gzip -9c >"$work/bomb"
request POST /v1/jobs -H "$json" -H 'Content-Encoding: gzip' --data-binary "@$work/bomb"
problem 'a bomb of a thousand to one' 413 body-too-large
for _ in {1..1000}; do printf x | gzip -c; done >"$work/many"
post 'a thousand members' 400 bad-json gzip "$work/many"

# ---- meshes: their name is that of what they decode to
printf 'v 0 0 0\nv 0.1 0 0\nv 0 0 0.1\nf 1 2 3\n' >"$work/mesh"
sha=$(sha256sum "$work/mesh" | cut -d' ' -f1)
gzip -c "$work/mesh" >"$work/mesh.gz"
request PUT "/v1/meshes/$sha" -H 'Content-Type: model/obj' -H 'Content-Encoding: gzip' --data-binary "@$work/mesh.gz"
is 'a gzipped mesh by its digest' "$code" 201
json 'has the bytes it decodes to' ".bytes == $(stat -c %s "$work/mesh")"
raw_zstd "$work/mesh" >"$work/mesh.zst"
request POST /v1/meshes -H 'Content-Type: model/obj' -H 'Content-Encoding: zstd' --data-binary "@$work/mesh.zst"
is 'the same in zstd is known' "$code" 200
is 'under the same name' "$(header location)" "/v1/meshes/$sha"
request PUT "/v1/meshes/$(sha256sum "$work/mesh.gz" | cut -d' ' -f1)" -H 'Content-Type: model/obj' \
    -H 'Content-Encoding: gzip' --data-binary "@$work/mesh.gz"
problem 'the digest of the gzipped bytes is another' 400 digest-mismatch
request POST /v1/meshes -H 'Content-Type: model/obj' -H 'Content-Encoding: br' --data-binary "@$work/mesh.gz"
problem 'a mesh in another encoding' 415 unsupported-encoding

stop_daemon; is 'it stops with status 0' "$status" 0
finish
