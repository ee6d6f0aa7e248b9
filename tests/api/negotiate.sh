#!/bin/bash
# What a request may ask for and what it is told when it cannot have it: types, arguments, methods, ETags,
# request ids, traces.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1 --log-level debug
square 4 >"$work/job"
json='Content-Type: application/json'

# ---- request ids
request GET /v1/info -H 'X-Request-Id: web-4711'
is 'a request id is given back' "$(header x-request-id)" web-4711
request GET /v1/nothing -H 'X-Request-Id: a"b=c/{d}'
is 'any visible characters' "$(header x-request-id)" 'a"b=c/{d}'
is 'in the problem, too' "$(jq -r .request_id "$body")" 'a"b=c/{d}'
check 'and in the log, where it cannot forge a value' grep -qF 'request="a\"b=c/{d}"' "$log"
long=$(printf 'i%.0s' {1..64})
request GET /v1/info -H "X-Request-Id: $long"; is 'with up to 64 bytes' "$(header x-request-id)" "$long"
for bad in "${long}i" 'a b' $'\xc3\xa9' 'a, b'; do
    request GET /v1/info -H "X-Request-Id: $bad"
    like "instead of '${bad:0:20}' it gets one of ours" "$(header x-request-id)" '^[0-9a-f]{32}$'
done
request GET /v1/info -H 'X-Request-Id;'; like 'instead of an empty one, too' "$(header x-request-id)" '^[0-9a-f]{32}$'
request GET "$admin/livez" -H 'X-Request-Id: probe'; is 'the admin listener does so, too' "$(header x-request-id)" probe

# ---- traces
trace=0af7651916cd43dd8448eb211c80319c
request POST /v1/jobs -H "$json" -H "traceparent: 00-$trace-b7ad6b7169203331-01" -H 'X-Request-Id: traced' --data-binary "@$work/job"
json 'a job tells which trace it belongs to' ".trace_id == \"$trace\""
id=$(jq -r .id "$body")
wait_for "$id" succeeded
json 'at its end, too' ".trace_id == \"$trace\""
check 'the log has it when the job is taken' grep -q "event=job.accepted job=$id .*request=traced trace=$trace" "$log"
check 'and when it ends' grep -q "event=job.ended job=$id .*trace=$trace" "$log"
kill_daemon
start_daemon --workers 1 --log-level debug
request GET "/v1/jobs/$id"; json 'and after a restart' ".trace_id == \"$trace\""
for bad in "00-${trace^^}-b7ad6b7169203331-01" "00-$trace-0000000000000000-01" "ff-$trace-b7ad6b7169203331-01" nonsense; do
    request POST /v1/jobs -H "$json" -H "traceparent: $bad" --data-binary "@$work/job"
    is "'$bad' is ignored" "$code $(jq -r .trace_id "$body")" '202 null'
done
request POST /v1/jobs -H "$json" -H "traceparent: 00-$trace-b7ad6b7169203331-01" -H "traceparent: 00-$trace-b7ad6b7169203331-01" --data-binary "@$work/job"
is 'and so are two' "$code $(jq -r .trace_id "$body")" '202 null'

# ---- types that are wanted, and those that are given
while read -r method path type; do
    [[ $method == POST ]] && set -- -H "$json" --data-binary "@$work/job" || set --
    request "$method" "$path" -H 'Accept: image/png' "$@"
    problem "$method $path as a picture" 406 not-acceptable
    like "$method $path says what it comes as" "$(jq -r .detail "$body")" "$type"
    request "$method" "$path" -H "Accept: image/png, ${type%%/*}/*;q=0.1" "$@"
    like "$method $path as the next best" "$code" '^20.$'
done <<END
GET /v1/info application/json
GET /v1/materials application/json
GET /openapi.json application/json
GET / text/html
GET /v1/jobs application/json
GET /v1/jobs/$id application/json
POST /v1/jobs application/json
GET /v1/jobs/$id/events text/event-stream
END
request DELETE "/v1/meshes/$(printf '0%.0s' {1..64})" -H 'Accept: image/png'
problem 'nor does a refusal to remove come as a picture' 406 not-acceptable
request POST /v1/jobs -H 'Content-Type: text/plain' --data-binary "@$work/job"
problem 'a job of another type' 415 unsupported-media-type
is 'says which it may be' "$(header accept)" application/json
request POST /v1/meshes -H 'Content-Type: image/png' --data-binary "@$work/job"
problem 'a mesh of another type' 415 unsupported-media-type
like 'says which it may be' "$(header accept)" 'model/obj.*application/json'

# ---- arguments
for path in '/v1/jobs?stauts=failed' "/v1/jobs/$id?x" '/v1/info?format=json' "/v1/jobs/$id/result?format=json&pretty=1" \
    "/v1/jobs/$id/result?%66ormat=json" '/?utm_source=x'; do
    request GET "$path"; problem "$path" 400 bad-request
done
request GET '/v1/jobs?limit=1&limit=2'; problem 'an argument given twice' 400 bad-request
like 'is named' "$(jq -r .detail "$body")" 'limit'
request POST '/v1/jobs?dry_run=1' -H "$json" --data-binary "@$work/job"; problem 'POST with an argument' 400 bad-request
request GET '/v1/jobs?'; is 'an empty query is none' "$code" 200

# ---- methods
for path in /v1/info /v1/materials /openapi.json / /v1/jobs "/v1/jobs/$id" "/v1/jobs/$id/result" "/v1/jobs/$id/trace"; do
    request GET "$path"
    length=$(header content-length)
    request HEAD "$path"; is "HEAD $path" "$code $(header content-length)" "200 $length"
done
request HEAD "/v1/jobs/$id/events"; is 'HEAD of events' "$code $(header content-type)" '200 text/event-stream'
while read -r path allow; do
    request OPTIONS "$path"; is "OPTIONS $path" "$code $(header allow)" "204 $allow"
    request BREW "$path"; problem "BREW $path" 405 method-not-allowed
    is "BREW $path says what there is" "$(header allow)" "$allow"
done <<END
/v1/info GET, HEAD, OPTIONS
/v1/jobs POST, GET, HEAD, OPTIONS
/v1/jobs/$id GET, HEAD, DELETE, OPTIONS
/v1/meshes POST, OPTIONS
END

# ---- ETags
request GET "/v1/jobs/$id"
etag=$(header etag)
length=$(header content-length)
like 'the ETag of a job is strong' "$etag" '^"[0-9.]+-[0-9a-f]{16}"$'
for list in '*' "$etag" "W/$etag" "\"a\", $etag" "\"a\",\"b,c\" , W/$etag"; do
    request GET "/v1/jobs/$id" -H "If-None-Match: $list"; is "If-None-Match: $list" "$code $(header etag)" "304 $etag"
done
request GET "/v1/jobs/$id" -H 'If-None-Match: "a"' -H "If-None-Match: $etag"; is 'in two lines' "$code" 304
is 'with what a cache wants to know' "$(header cache-control) $(header content-length)" "no-cache $length"
for list in '"a"' "${etag//\"/}" '"*"' ''; do
    request GET "/v1/jobs/$id" -H "If-None-Match: $list"; is "If-None-Match: $list" "$code" 200
done
request GET "/v1/jobs/$id/result?format=json" -H 'Accept-Encoding: gzip'
is 'a result varies by type and coding' "$(header vary)" 'Accept, Accept-Encoding'

stop_daemon; is 'it stops with status 0' "$status" 0
finish
