#!/bin/bash
# Pages of other origins: those named by --cors-origin may read every answer, all others none; a preflight
# needs no key. Without the flag nothing of it is said.
. "$(dirname "$0")/lib.sh"
shop=https://shop.example
other=http://localhost:5173

# ---- off
start_daemon --workers 1
request GET /v1/info -H "Origin: $shop"
is 'without origins nothing is said of them' "$code $(grep -ci '^access-control\|^vary: origin' "$headers")" '200 0'
request OPTIONS /v1/jobs -H "Origin: $shop" -H 'Access-Control-Request-Method: POST'
is 'a preflight is any OPTIONS' "$code $(header allow) $(grep -ci '^access-control' "$headers")" '204 POST, GET, HEAD, OPTIONS 0'
request OPTIONS /v1/nothing; problem 'OPTIONS of no path' 404 not-found
request OPTIONS '*'
is 'OPTIONS of them all' "$(raw "OPTIONS * HTTP/1.1\r\nHost: h\r\nConnection: close\r\n\r\n" | tr -d '\r' | grep -c '^HTTP/1.1 204\|^Allow: .*DELETE, OPTIONS')" 2
stop_daemon

# ---- on
for bad in '*' null https://shop.example/ "$shop,$other" https://shop.example:443; do
    check "$bad is no origin" bash -c "! $DRAPED --cors-origin '$bad' --check-config >/dev/null 2>&1"
done
start_daemon --workers 1 --cors-origin $shop --cors-origin $other
# allowed NAME ORIGIN: the last answer may be read by that page.
allowed() {
    is "$1" "$(header access-control-allow-origin) $(grep -ci '^vary: origin' "$headers") $(grep -ci '^access-control-allow-credentials' "$headers")" "$2 1 0"
    like "$1, with its headers" "$(header access-control-expose-headers)" 'Location, Retry-After, ETag, Link, Preference-Applied'
}
denied() { is "$1" "$(grep -ci '^access-control' "$headers") $(grep -ci '^vary: origin' "$headers")" '0 1'; }
square 4 >"$work/job"
for origin in $shop $other; do
    request GET /v1/info -H "Origin: $origin"; allowed "GET from $origin" $origin
done
submit "$work/job"; denied 'without an origin'
wait_for "$id" succeeded
for origin in null https://evil.example http://shop.example https://shop.example:8443 "$shop $other" HTTPS://SHOP.EXAMPLE; do
    request GET /v1/info -H "Origin: $origin"; denied "GET from $origin"
    is "is answered all the same" "$code" 200
done
request GET /v1/info -H "Origin: $shop" -H "Origin: $other"; denied 'GET from two origins at once'
request POST /v1/jobs -H "Origin: $shop" -H 'Content-Type: application/json' --data-binary "@$work/job"
is 'a POST is taken' "$code" 202; allowed 'and its answer read' $shop
request POST /v1/jobs -H "Origin: $shop" -H 'Content-Type: text/plain' --data-binary x
problem 'a refusal' 415 unsupported-media-type; allowed 'is read, too' $shop
request GET /v1/nothing -H "Origin: $shop"; is 'nothing there' "$code" 404; allowed 'is read, too' $shop
request PATCH /v1/jobs -H "Origin: $shop"; is 'a wrong method' "$code" 405; allowed 'is read, too' $shop
request GET "/v1/jobs/$id" -H "Origin: $shop" -H "If-None-Match: *"
is 'what has not changed' "$code" 304; allowed 'is read, too' $shop
request GET "/v1/jobs/$id/events" -H "Origin: $shop"
like 'events' "$code $(header content-type)" '^200 text/event-stream'; allowed 'are read, too' $shop
raw "POST /v1/jobs HTTP/1.1\r\nHost: h\r\nOrigin: $shop\r\nContent-Length: 2\r\nContent-Length: 2\r\n\r\n{}" >"$headers"
like 'bad framing' "$(<"$headers")" '^HTTP/1.1 400'; allowed 'is read, too' $shop

# preflight PATH METHOD ORIGIN
preflight() { request OPTIONS "$1" -H "Origin: $3" -H "Access-Control-Request-Method: $2" -H 'Access-Control-Request-Headers: authorization,content-type'; }
preflight /v1/jobs POST $shop
is 'a preflight' "$code $(header access-control-max-age) $(header access-control-allow-origin)" "204 7200 $shop"
is 'names the methods' "$(header access-control-allow-methods)" 'GET, HEAD, POST, PUT, DELETE'
for name in Authorization Content-Type Idempotency-Key Last-Event-ID If-Match If-None-Match Prefer traceparent; do
    like "and $name" "$(header access-control-allow-headers)" "(^|, )$name(,|$)"
done
preflight "/v1/jobs/$id" DELETE $other; is 'a preflight from the other' "$code $(header access-control-allow-origin)" "204 $other"
preflight /v1/nothing GET $shop; is 'a preflight of no path' "$code" 204
preflight /v1/jobs POST https://evil.example
is 'a preflight from elsewhere' "$code $(grep -ci '^access-control' "$headers")" '204 0'
preflight /v1/nothing POST https://evil.example; is 'learns nothing more' "$code" 404
request GET "$admin/livez" -H "Origin: $shop"
is 'the admin listener is for no page' "$code $(grep -ci '^access-control\|^vary' "$headers")" '200 0'
stop_daemon; is 'it stops with status 0' "$status" 0
finish
