#!/bin/bash
# The page at /: it names every operation of the interface and tells how the queue stands.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
fact() { sed -n "s/.*<dt>$1<\/dt><dd>\([0-9]*\)<.*/\1/p" "$body"; }
request GET /
is 'the page answers 200' "$code" 200
like 'as HTML' "$(header content-type)" '^text/html'
like 'which may run nothing' "$(header content-security-policy)" "default-src 'none'"
is 'nothing is queued' "$(fact queued) $(fact running) $(fact workers)" '0 0 1'
missing=$(jq -r '.paths | to_entries[] | select(.value.servers == null) | .key as $p | .value | keys[] | "<code>\(ascii_upcase)</code></td><td><code>\($p)<"' \
    server/openapi.json | while read -r row; do grep -qF "$row" "$body" || echo "$row"; done)
is 'every operation is on it' "$missing" ''
# Every link leads somewhere.
for link in $(grep -o 'href="[^"]*"' "$body" | cut -d'"' -f2); do
    request GET "$link"; is "$link answers 200" "$code" 200
done
endless >"$work/job"
for n in 1 2 3; do submit "$work/job"; done
for ((i = 0; i < 200; i++)); do
    [[ $(curl -s "$url/v1/jobs?status=running" | jq '.jobs | length') == 1 ]] && break
    sleep 0.05
done
request GET /
is 'then two are, and one runs' "$(fact queued) $(fact running)" '2 1'
request HEAD /; is 'HEAD answers 200' "$code" 200
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
