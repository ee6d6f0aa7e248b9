#!/bin/bash
# What was accepted survives kill -9: jobs, results, and which attempt it was.
. "$(dirname "$0")/lib.sh"
RANDOM=20260101 # the same kills every time, as far as the clock allows

# ---- a kill in the middle of a job
start_daemon --workers 1
endless 24 ' | .solver.max_iterations = 1500 | .name = "cut"' >"$work/long"
square 4 '.name = "behind"' >"$work/small"
submit "$work/small"; before=$id
wait_for "$before" succeeded
curl -s "$url/v1/jobs/$before/result?format=json" >"$work/before.json"
submit "$work/long"; long=$id
submit "$work/small"; behind=$id
wait_for "$long" running
sleep 0.3
kill_daemon
start_daemon --workers 1
request GET "/v1/jobs/$long"
json 'after kill -9 the job is there, queued or running again' '.status == "queued" or .status == "running"'
check 'it succeeds' wait_for "$long" succeeded 120
json 'at the second attempt' '.attempt == 2'
check 'so does the one behind it' wait_for "$behind" succeeded
json 'at its first, for it had not begun' '.attempt == 1'
request GET "/v1/jobs/$before"; json 'what had succeeded stays so' '.status == "succeeded" and .attempt == 1'
curl -s "$url/v1/jobs/$before/result?format=json" >"$work/after.json"
check 'with the same result, byte for byte' cmp "$work/before.json" "$work/after.json"

# ---- SIGTERM in the middle of a job
endless >"$work/long"
submit "$work/long"; long=$id
wait_for "$long" running
stop_daemon
is 'SIGTERM in the middle of a job ends with status 0' "$status" 0
start_daemon --workers 1
request GET "/v1/jobs/$long"
json 'and the job is back in the queue, or already running' '.status == "queued" or .status == "running"'
request DELETE "/v1/jobs/$long"
wait_for "$long" canceled
kill_daemon
start_daemon --workers 1
request GET "/v1/jobs/$long"; json 'a cancelled job stays cancelled' '.status == "canceled"'

# ---- a job that takes the daemon down with it each time
submit "$work/long"; long=$id
for crash in 1 2 3; do
    check "attempt $crash runs" wait_for "$long" running
    json "and is counted" ".attempt == $crash"
    kill_daemon
    start_daemon --workers 1
done
request GET "/v1/jobs/$long"
json 'the third crash fails it as worker-crash' '.status == "failed" and .error.code == "worker-crash"'
request GET "/v1/jobs/$long/result"; problem 'without a result' 409 no-result
submit "$work/small"; check 'and others run as ever' wait_for "$id" succeeded
stop_daemon

# ---- many kills at random moments under load
kills=${DRAPED_TEST_KILLS:-200}
data=$work/data-kills
square 4 '.solver.max_iterations = 20' >"$work/small"
: >"$work/accepted"
post_for_ever() {
    while :; do
        curl -s -o - -w ' %{http_code}\n' -H 'Content-Type: application/json' --data-binary "@$work/small" \
            "$url/v1/jobs" 2>/dev/null | sed -n 's/.*"id": *"\([0-9a-f]*\)".* 202$/\1/p' >>"$work/accepted"
        sleep 0.05
    done
}
slowest=0
for ((n = 0; n < kills; n++)); do
    from=${EPOCHREALTIME/[.,]/}
    start_daemon --workers 2
    took=$(((${EPOCHREALTIME/[.,]/} - from) / 1000))
    ((took > slowest)) && slowest=$took
    post_for_ever & poster=$!
    sleep "0.$(printf '%03d' $((50 + RANDOM % 250)))"
    kill_daemon
    kill "$poster"; wait "$poster" 2>/dev/null
done
start_daemon --workers 2
accepted=$(grep -c . "$work/accepted")
lost=0 open=0 odd=0 given_up=0
while read -r id; do
    wait_for "$id" 'succeeded|failed|canceled' 60 || open=$((open + 1))
    [[ $code == 200 ]] || lost=$((lost + 1))
    # Whoever ran at three kills is taken for the cause.
    case $(jq -r '.status + " " + (.error.code // "")' "$body") in
    'succeeded ') ;;
    'failed worker-crash') given_up=$((given_up + 1)) ;;
    *) odd=$((odd + 1)) ;;
    esac
done <"$work/accepted"
check 'jobs were accepted between the kills' test "$accepted" -ge $((kills / 4))
is "of $accepted jobs none is lost after $kills kills" "$lost" 0
is 'none is stuck' "$open" 0
is 'each has succeeded, or ran at three kills' "$odd" 0
request GET "/v1/jobs?limit=200"; is 'the list is whole' "$code" 200
stop_daemon; is 'and the daemon stops with status 0' "$status" 0
is 'the database is whole' "$(sqlite3 "$data/draped.db" 'PRAGMA integrity_check')" ok
is 'no job has two results' "$(ls "$data/results" | sed 's/\..*//' | sort | uniq -d | wc -l)" 0
echo "# $kills kills, $accepted jobs accepted, $lost lost, $given_up ran at three kills, slowest start $slowest ms"
finish
