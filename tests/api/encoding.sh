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
zstd -qc "$work/job" >"$work/job.zst"

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
zstd -qc "$work/mesh" >"$work/mesh.zst"
request POST /v1/meshes -H 'Content-Type: model/obj' -H 'Content-Encoding: zstd' --data-binary "@$work/mesh.zst"
is 'the same in zstd is known' "$code" 200
is 'under the same name' "$(header location)" "/v1/meshes/$sha"
request PUT "/v1/meshes/$(sha256sum "$work/mesh.gz" | cut -d' ' -f1)" -H 'Content-Type: model/obj' \
    -H 'Content-Encoding: gzip' --data-binary "@$work/mesh.gz"
problem 'the digest of the gzipped bytes is another' 400 digest-mismatch
request POST /v1/meshes -H 'Content-Type: model/obj' -H 'Content-Encoding: br' --data-binary "@$work/mesh.gz"
problem 'a mesh in another encoding' 415 unsupported-encoding

# ---- answers
decode() { case $1 in gzip) gzip -dc ;; zstd) zstd -dqc ;; *) cat ;; esac; }
# representations NAME PATH [CURL-ARGUMENT...]: each coding decodes to the plain bytes, has an ETag of its own,
# and is not sent again to who has it; HEAD says the same.
plain=$work/plain
representations() {
    local name=$1 path=$2 coding etag etags='' length
    shift 2
    request GET "$path" "$@"
    cp "$body" "$plain"
    is "$name, as it is" "$code $(header content-encoding)" '200 '
    for coding in identity gzip zstd; do
        request GET "$path" -H "Accept-Encoding: $coding" "$@"
        is "$name in $coding" "$code $(header content-encoding)" "200 ${coding/identity/}"
        check "$name in $coding is the same" cmp "$plain" <(decode $coding <"$body")
        is "$name in $coding varies" "$(header vary)" 'Accept, Accept-Encoding'
        etag=$(header etag)
        etags+="$etag "
        length=$(stat -c %s "$body")
        [[ $coding == identity ]] || check "$name in $coding is smaller" test "$length" -lt "$(stat -c %s "$plain")"
        request HEAD "$path" -H "Accept-Encoding: $coding" "$@"
        is "HEAD of $name in $coding" "$code $(header etag) $(header content-length)" "200 $etag $length"
        : >"$body"
        request GET "$path" -H "Accept-Encoding: $coding" -H "If-None-Match: \"x\", $etag" "$@"
        is "$name in $coding is not sent again" "$code $(header etag) $(stat -c %s "$body")" "304 $etag 0"
        is "and the length is that of $name in $coding" "$(header content-length)" "$length"
    done
    is "$name has three ETags" "$(tr ' ' '\n' <<<"$etags" | grep -c '^".*"$') $(tr ' ' '\n' <<<"$etags" | sort -u | grep -c '"')" '3 3'
    request GET "$path" -H 'Accept-Encoding: gzip' -H "If-None-Match: ${etags%% *}" "$@"
    is "$name has another ETag when coded" "$code" 200
    request GET "$path" -H 'If-None-Match: *' "$@"; is "$name for a star" "$code" 304
}
square 12 >"$work/job"
submit "$work/job"
check 'a job succeeds' wait_for "$id" succeeded
for format in json obj ply glb; do representations "the result as $format" "/v1/jobs/$id/result?format=$format"; done
for format in csv json svg; do representations "the trace as $format" "/v1/jobs/$id/trace?format=$format"; done
representations 'the contract' /openapi.json
representations 'the materials' /v1/materials
request GET /openapi.json -H 'Accept-Encoding: identity;q=0, br'
problem 'without any coding that is there' 406 not-acceptable
request GET / -H 'Accept-Encoding: gzip'
is 'a page that fits into a packet comes as it is' "$code $(header content-encoding)" '200 '
request GET "/v1/jobs/$id" -H 'Accept-Encoding: gzip'
is 'a job comes as it is' "$code $(header content-encoding)" '200 '
request GET /v1/nothing -H 'Accept-Encoding: gzip'
is 'and so does a problem' "$code $(header content-encoding)" '404 '
request GET "/v1/jobs/$id/events" -H 'Accept-Encoding: gzip'
is 'and so do events' "$code $(header content-encoding)" '200 '

awk 'BEGIN {for (i = 0; i < 300; i++) print "v", i / 10, i % 7, i % 3; for (i = 1; i < 299; i++) print "f", i, i + 1, i + 2}' >"$work/mesh"
sha=$(sha256sum "$work/mesh" | cut -d' ' -f1)
request POST /v1/meshes -H 'Content-Type: model/obj' --data-binary "@$work/mesh"
is 'a mesh is kept' "$code" 201
representations 'the mesh' "/v1/meshes/$sha"
is 'the codings asked for are kept beside it' "$(cd "$data/meshes" && ls "$sha".* | tr '\n' ' ')" "$sha.gz $sha.zst "
kill_daemon
start_daemon --workers 1
is 'until the next start' "$(cd "$data/meshes" && ls "$sha"*)" "$sha"
representations 'the mesh, made again,' "/v1/meshes/$sha"

stop_daemon; is 'it stops with status 0' "$status" 0
finish
