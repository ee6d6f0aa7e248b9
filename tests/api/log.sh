#!/bin/bash
# The log in its three forms, and what must not be in it.
. "$(dirname "$0")/lib.sh"
square 4 '.name = "x\nlevel=error event=forged \u001b[31m" | .labels = {order: "4711\n{}"}' >"$work/job"

# one_job: what the daemon says of a job, in $log; with a request that has a key, which is no business of the log.
one_job() {
    : >"$log"
    start_daemon --log-level debug "$@"
    request POST /v1/jobs -H 'Content-Type: application/json' -H 'X-Request-Id: req-1' -H 'Prefer: wait=20' \
        -H 'Authorization: Bearer s3cret-key' --data-binary "@$work/job"
    id=$(jq -r .id "$body")
    raw 'GET /forged%%20level=error HTTP/1.1\r\nHost: h\r\nConnection: close\r\n\r\n' >/dev/null
    stop_daemon
}

one_job --log-format json
check 'every line is JSON' jq -e '.time and .level and .event' "$log"
is 'a request line has job, request, route, status and time' "$(jq -r --arg id "$id" \
    'select(.event == "http.request" and .request == "req-1" and .job == $id) | "\(.route) \(.status) \(.ms | type)"' "$log")" \
    '/v1/jobs 200 number'
is 'so have those of the job' "$(jq -r --arg id "$id" 'select(.job == $id and .event != "http.request") | .event' "$log" | tr '\n' ' ')" \
    'job.accepted job.started job.ended '
is 'a path from outside is no route' "$(jq -r 'select(.status == 404) | .route' "$log")" none
is 'nothing forged an event' "$(jq -r 'select(.event == "forged")' "$log")" ''
check 'neither keys nor bodies are logged' bash -c '! grep -q "s3cret\|positions\|forged" "$0"' "$log"

one_job --log-format text
is 'every line of text begins with time and level' \
    "$(grep -cvE '^20[0-9-]+T[0-9:.]+Z level=(error|warning|info|debug) event=[a-z.-]+( |$)' "$log")" 0
check 'neither keys nor bodies are logged there' bash -c '! grep -q "s3cret\|positions\|forged" "$0"' "$log"

# Where no journal listens its library drops what it is sent: seen is only that nothing is written beside it.
: >"$log"
export JOURNAL_STREAM
JOURNAL_STREAM=$(stat -c %d:%i "$log")
start_daemon; stop_daemon
is 'with the journal behind standard error nothing is written to it' "$(grep -c event= "$log")" 0
JOURNAL_STREAM=1:1
start_daemon; stop_daemon
check 'a standard error that goes elsewhere is written to' grep -q 'event=stopped' "$log"
finish
