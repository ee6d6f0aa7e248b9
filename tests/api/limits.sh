#!/bin/bash
# Each limit holds at the limit and refuses past it, with its own status.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
request GET /v1/info
cp "$body" "$work/info"
limit_now() { curl -s "$url/v1/info" | jq ".limits.$1"; }
limit() { jq ".limits.$1" "$work/info"; }
post() { request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$work/job"; }

# ---- one request body
bytes=$(limit body_bytes)
job=$(square 4 '.solver.max_iterations = 1')
# Blanks among the positions: a large mesh, as far as the reader can tell.
{ printf '%s' "${job%%\"positions\":*}\"positions\":[0,"
    head -c $((bytes - ${#job})) /dev/zero | tr '\0' ' '
    printf '%s' "${job#*\"positions\":[0,}"; } >"$work/job"
post; is "a body of $bytes bytes is read" "$code $(jq -r .detail "$body")" '202 null'
printf ' ' >>"$work/job"
post; problem 'one byte more is 413' 413 body-too-large
request POST /v1/jobs -H 'Content-Type: application/json' -H 'Transfer-Encoding: chunked' --data-binary "@$work/job"
problem 'in chunks as well' 413 body-too-large
rm "$work/job"

# ---- counts in the document
count() { # count NAME POINTER FILTER-AT-LIMIT FILTER-PAST-IT
    square 4 ".solver.max_iterations = 1 | $3" >"$work/job"
    post; like "$1: at the limit" "$code" '^202$'
    square 4 ".solver.max_iterations = 1 | $4" >"$work/job"
    post; like "$1: past the limit" "$code $(jq -r '.code' "$body")" '^422 (too-large|invalid)$'
    json "$1: names the place" "[.errors[].pointer] | any(startswith(\"$2\"))"
}
n=$(limit materials)
count materials /cloth/materials "[range($n)] as \$n | .cloth.materials |= [\$n[] as \$_ | .[0]]" \
    "[range($n + 1)] as \$n | .cloth.materials |= [\$n[] as \$_ | .[0]]"
n=$(limit bodies)
count bodies /bodies ".bodies = [range($n) | {plane: {point: [0, -9, 0], normal: [0, 1, 0]}}]" \
    ".bodies = [range($n + 1) | {plane: {point: [0, -9, 0], normal: [0, 1, 0]}}]"
n=$(limit lines)
count lines /lines ".lines = [range($n) | {name: \"l\", vertices: [0, 1]}]" \
    ".lines = [range($n + 1) | {name: \"l\", vertices: [0, 1]}]"
n=$(limit line_vertices)
count 'vertices of lines' /lines/0/vertices ".lines = [{name: \"l\", vertices: [range($n) | . % 25]}]" \
    ".lines = [{name: \"l\", vertices: [range($n + 1) | . % 25]}]"
n=$(limit name_bytes)
count name /name ".name = (\"n\" * $n)" ".name = (\"n\" * ($n + 1))"
n=$(limit labels)
count labels /labels ".labels = ([range($n) | {key: \"l\(.)\", value: \"v\"}] | from_entries)" \
    ".labels = ([range($n + 1) | {key: \"l\(.)\", value: \"v\"}] | from_entries)"
n=$(limit max_iterations)
count iterations /solver/max_iterations ".solver.max_iterations = $n" ".solver.max_iterations = $n + 1"
n=$(limit time_limit_s)
count time /solver/time_limit_s ".solver.time_limit_s = $n" ".solver.time_limit_s = $n + 1"
stop_daemon

# ---- vertices and triangles, with limits small enough to reach
start_daemon --workers 1 --max-vertices 25 --max-triangles 32
square 4 '.solver.max_iterations = 1' >"$work/job"
post; is 'a cloth of as many vertices and triangles as allowed' "$code" 202
square 4 '.cloth.mesh.positions += [1, 0, 1] | .cloth.mesh.pattern += [1, 1]' >"$work/job"
post; problem 'a vertex more' 422 too-large /cloth/mesh/positions
square 4 '.cloth.mesh.triangles += [0, 1, 6]' >"$work/job"
post; problem 'a triangle more' 422 too-large /cloth/mesh/triangles
stop_daemon

# ---- the queue
start_daemon --workers 1 --max-queued 3
endless >"$work/job"
for n in 1 2 3; do post; is "job $n of three" "$code" 202; done
post; problem 'the fourth is refused' 503 queue-full
like 'with a time to try again' "$(header retry-after)" '^[0-9]+$'
json 'and may be tried again' '.retryable'
id=$(curl -s "$url/v1/jobs?status=queued&limit=1" | jq -r '.jobs[0].id')
request DELETE "/v1/jobs/$id"; wait_for "$id" canceled
post; is 'a place that came free is given' "$code" 202
stop_daemon; is 'the daemon stops with status 0' "$status" 0

# ---- memory: the estimate of a job at the limit, and a byte past it
square 30 '.solver.max_iterations = 1' >"$work/job"
start_daemon --workers 1 --job-memory 1000000
post; problem 'a job that would need more memory than one may have' 422 too-large-memory
bytes=$(jq -r .detail "$body" | grep -o '[0-9]*' | head -n 1)
like 'is told how much' "$bytes" '^[0-9]{7,}$'
stop_daemon
start_daemon --workers 1 --job-memory $((bytes - 1))
post; problem "a limit of one byte less than $bytes refuses it" 422 too-large-memory
stop_daemon
start_daemon --workers 1 --job-memory "$bytes"
post; is 'at the limit it is taken' "$code" 202
is 'info tells the limit' "$(limit_now job_memory)" "$bytes"
stop_daemon
endless 30 >"$work/job"
start_daemon --workers 1 --job-memory 1000000
post; bytes=$(jq -r .detail "$body" | grep -o '[0-9]*' | head -n 1)
stop_daemon
data=$work/data-memory
# What it comes to need may be more than was expected.
start_daemon --workers 2 --job-memory $((3 * bytes / 2)) --memory $((2 * bytes - 1))
running() { curl -s "$admin/metrics" | awk '/^draped_jobs\{state="running"/ {print $2}'; }
post; first=$(jq -r .id "$body"); check 'one job runs' wait_for "$first" running
post; second=$(jq -r .id "$body"); sleep 0.5
is 'a byte short of two, the other waits' "$(status_of "$second") $(running)" 'queued 1'
request DELETE "/v1/jobs/$first"
check 'until there is room' wait_for "$second" running
stop_daemon

# ---- streams
start_daemon --workers 1 --max-streams 2
endless >"$work/job"
submit "$work/job"
for n in 1 2; do curl -sN --max-time 20 "$url/v1/jobs/$id/events" >/dev/null & done
sleep 0.5
request GET "/v1/jobs/$id/events" --max-time 5; problem 'a stream more than allowed' 429 too-many-streams
request GET "/v1/jobs/$id"; is 'the job itself can still be asked for' "$code" 200
request GET "$admin/livez"; is 'and health' "$code" 200
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
