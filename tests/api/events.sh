#!/bin/bash
# The event stream of a job: order, numbering, resuming, and what an idle one costs.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

# as_json FILE: an event stream as a JSON array of {event, id, data}.
as_json() {
    awk '/^event: / {event = substr($0, 8)} /^id: / {id = substr($0, 5)} /^data: / {data = data substr($0, 7)}
        /^$/ {if (event != "") printf "{\"event\":\"%s\",\"id\":\"%s\",\"data\":%s}\n", event, id, data == "" ? "null" : data
              event = ""; data = ""}' "$1" | jq -s .
}

endless 24 ' | .solver.max_iterations = 300' >"$work/job"
submit "$work/job"
curl -sN --max-time 60 -D "$headers" "$url/v1/jobs/$id/events" >"$work/stream"
is 'the server ends the stream after the end' "$?" 0
like 'its type is text/event-stream' "$(header content-type)" '^text/event-stream'
is 'proxies are asked not to buffer' "$(header x-accel-buffering)" no
like 'caches are asked not to store' "$(header cache-control)" 'no-store'
as_json "$work/stream" >"$work/events"
json 'the first event is the state' '.[0].event == "state"' "$work/events"
json 'then there is progress' 'any(.[]; .event == "progress")' "$work/events"
json 'and tells what can still be gained' 'all(.[] | select(.event == "progress"); .data.progress | has("residual_energy"))' "$work/events"
is 'a browser is told when to come back' "$(head -n 1 "$work/stream")" 'retry: 3000'
json 'the last event is the end' '.[-1].event == "end" and ([.[] | select(.event == "end")] | length == 1)' "$work/events"
json 'there are no other kinds' 'all(.[]; .event | IN("state", "progress", "end"))' "$work/events"
json 'ids are revisions and rise' '[.[].id | split(".") | map(tonumber)] | . == (unique) and length > 2' "$work/events"
json 'progress tells iterations in order' '[.[] | select(.event == "progress") | .data | (.progress // .).iteration]
    | . == sort' "$work/events"
request GET "/v1/jobs/$id"
check 'the end tells the truth of the job' jq -e --slurpfile job "$body" \
    '.[-1] | .id == $job[0].revision and .data.status == $job[0].status and .data.verdict == $job[0].verdict' "$work/events"
seconds=$(jq -r '.report.seconds' "$body")
check 'progress comes at most four times a second' jq -e --argjson s "$seconds" \
    '[.[] | select(.event == "progress")] | length <= 4 * $s + 2' "$work/events"

last=$(jq -r '.[-1].id' "$work/events")
first=$(jq -r '.[0].id' "$work/events")
request GET "/v1/jobs/$id/events" -H "Last-Event-ID: $last"
is 'whoever has seen the end gets 204' "$code" 204
curl -sN --max-time 30 -H "Last-Event-ID: $first" "$url/v1/jobs/$id/events" >"$work/stream"
as_json "$work/stream" >"$work/again"
check 'whoever missed it gets the end' jq -e '.[-1].event == "end"' "$work/again"
check 'and nothing that was seen before' jq -e --arg first "$first" 'all(.[]; .id != $first)' "$work/again"

# A stream resumed in the middle, by a client that was cut off.
endless 24 ' | .solver.max_iterations = 1000' >"$work/job"
submit "$work/job"
curl -sN --max-time 1 "$url/v1/jobs/$id/events" >"$work/stream"
as_json "$work/stream" >"$work/before"
last=$(jq -r '.[-1].id' "$work/before")
curl -sN --max-time 60 -H "Last-Event-ID: $last" "$url/v1/jobs/$id/events" >"$work/stream"
as_json "$work/stream" >"$work/after"
check 'resuming goes on behind the last id' jq -e --arg last "$last" \
    '($last | split(".") | map(tonumber)) as $l | all(.[]; (.id | split(".") | map(tonumber)) > $l)' "$work/after"
check 'until the end' jq -e '.[-1].event == "end"' "$work/after"
request GET "/v1/jobs/$id/events" -H 'Last-Event-ID: rubbish' --max-time 20
like 'an id that is none starts afresh or is refused' "$code" '^(200|400)$'

# Two watchers of one job see the same end; a third hangs up and harms nobody.
endless 24 ' | .solver.max_iterations = 200' >"$work/job"
submit "$work/job"
curl -sN --max-time 60 "$url/v1/jobs/$id/events" >"$work/a" & a=$!
curl -sN --max-time 60 "$url/v1/jobs/$id/events" >"$work/b" & b=$!
curl -sN --max-time 0.3 "$url/v1/jobs/$id/events" >/dev/null
wait $a $b
is 'two watchers see the same end' "$(grep -A2 '^event: end' "$work/a")" "$(grep -A2 '^event: end' "$work/b")"

# An HTTP/1.0 client gets the same, unchunked, to the end of the connection.
curl -sN0 --max-time 60 -D "$headers" "$url/v1/jobs/$id/events" >"$work/old"
is 'an HTTP/1.0 client is told no transfer coding' "$(header transfer-encoding)" ''
as_json "$work/old" >"$work/events"
json 'and gets its event' 'length == 1 and .[0].event == "end"' "$work/events"

# ---- several jobs in one stream
ids=()
# The first must not have ended before the stream is there, however slow the machine.
for n in 300 330 360; do
    endless 24 " | .solver.max_iterations = $n" >"$work/job"
    submit "$work/job"
    ids+=("$id")
done
query="job=${ids[0]}&job=${ids[1]}&job=${ids[2]}"
curl -sN --max-time 60 "$url/v1/events?$query" >"$work/stream"
is 'one stream of three jobs ends after them' "$?" 0
as_json "$work/stream" >"$work/events"
json 'it begins with the state of each' '[.[0:3][] | .event] == ["state", "state", "state"] and ([.[0:3][].data.id] | unique | length == 3)' "$work/events"
json 'it has the end of each' '[.[] | select(.event == "end") | .data.id] | length == 3 and (unique | length == 3)' "$work/events"
check 'every id names the revision of its own event' jq -e 'all(.[]; .data as $d | .id | split(",") | index($d.id + "=" + $d.revision) != null)' "$work/events"
json 'every job goes through its states in order' 'group_by(.data.id) | all(.[]; [.[] | select(.event != "progress") | .data.status] | . == ["queued", "running", "succeeded"] or . == ["running", "succeeded"])' "$work/events"
last=$(jq -r '.[-1].id' "$work/events")
request GET "/v1/events?$query" -H "Last-Event-ID: $last"; is 'whoever has seen all ends gets 204' "$code" 204
# As if cut off before the last event: only that one comes again.
before=$(jq -r '.[-2].id' "$work/events")
curl -sN --max-time 20 -H "Last-Event-ID: $before" "$url/v1/events?$query" >"$work/stream"
as_json "$work/stream" >"$work/again"
check 'resuming gives what was missed' jq -e --slurpfile all "$work/events" 'length == 1 and .[0].data == $all[0][-1].data' "$work/again"
request GET "/v1/events?$query&job=${ids[0]}" --max-time 5; problem 'a job given twice' 400 bad-request
request GET "/v1/events" --max-time 5; problem 'no job' 400 bad-request
request GET "/v1/events?job=xyz" --max-time 5; problem 'what is no id' 400 bad-request
request GET "/v1/events?$query&job=00000000000000000000000000000000" --max-time 5; problem 'a job that is not there' 404 not-found
like 'is named' "$(jq -r .detail "$body")" 00000000000000000000000000000000
request GET "/v1/events?$query" -H 'Accept: application/json' --max-time 5; problem 'another format' 406 not-acceptable
many=$(for i in $(seq 64); do printf 'job=%032x&' "$i"; done)
request GET "/v1/events?${many%&}" --max-time 5; problem 'as many jobs as allowed are looked for' 404 not-found
request GET "/v1/events?${many}job=${ids[0]}" --max-time 5; problem 'one more is refused' 400 bad-request
request DELETE "/v1/jobs/${ids[0]}"
request GET "/v1/events?$query" --max-time 5; problem 'a job that was removed' 410 gone

# An idle stream (a queued job) costs no processor time: suspended, not spinning.
endless >"$work/job"
submit "$work/job"; running=$id
square 4 >"$work/small"
submit "$work/small"; queued=$id
for i in 1 2 3 4 5 6 7 8; do curl -sN --max-time 30 "$url/v1/jobs/$queued/events" >"$work/idle$i" & done
sleep 0.5
check 'a watcher of a queued job is told so' grep -q '"status":"queued"' "$work/idle1"
request DELETE "/v1/jobs/$queued"; is 'a queued job can be cancelled' "$code" 202
wait_for "$queued" canceled
sleep 0.5
check 'and its watchers see the end' grep -q '^event: end' "$work/idle8"
request DELETE "/v1/jobs/$running"
wait_for "$running" canceled
submit "$work/job"
curl -sN --max-time 30 "$url/v1/jobs/$id/events" >"$work/stream" & stream=$!
wait_for "$id" running
stop_daemon; is 'SIGTERM with a stream open ends the daemon with status 0' "$status" 0
wait $stream; is 'and ends the stream in order' "$?" 0

# ---- our own client, through a daemon that is killed and comes back
start_daemon --workers 1
request DELETE "/v1/jobs/$id" # of the daemon before
wait_for "$id" canceled
endless 24 ' | .solver.max_iterations = 400' >"$work/job"
submit "$work/job"
DRAPED_URL=$url "$DRAPE" watch "$id" --json >"$work/lines" 2>"$work/said" & watcher=$!
for ((i = 0; i < 400; i++)); do grep -q '"event":"progress"' "$work/lines" && break; sleep 0.05; done
kill_daemon
start_daemon --workers 1 --listen "${url#http://}"
wait $watcher; is 'drape watch goes on to the end' "$?" 5 # not at rest: so the job was made
jq -s . "$work/lines" >"$work/events"
json 'no event came twice, and none out of order' '[.[] | select(.event) | .id | split(".") | map(tonumber)] | length > 2 and . == unique' "$work/events"
json 'the second attempt was seen' 'any(.[] | select(.event); .id | startswith("2."))' "$work/events"
json 'and the end, once' '[.[] | select(.event == "end")] | length == 1' "$work/events"
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
