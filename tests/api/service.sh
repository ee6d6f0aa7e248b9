#!/bin/bash
# Under a service manager: what it is told and when, the watchdog, how the daemon stops, and restarts behind
# sockets that somebody else holds. DRAPED_TEST_RESTARTS (5) says how many.
. "$(dirname "$0")/lib.sh"
endless >"$work/long"
square 6 >"$work/small"

# ---- what systemd is told

told=$work/told
hear_notices "$told"
# told_within SECONDS PATTERN [COUNT]: until so many lines of notices match.
told_within() {
    local deadline=$((SECONDS + $1))
    until (($(grep -cE "$2" "$told") >= ${3:-1})); do
        ((SECONDS < deadline)) || { tail -n 5 "$told"; return 1; }
        sleep 0.05
    done
}
listening() { NOTIFY_SOCKET=$work/notify WATCHDOG_USEC=2000000 start_daemon "$@"; }

listening --workers 1 --drain-timeout 60
check 'systemd is told when the daemon is ready' told_within 5 ' READY=1$'
check 'and pinged again and again' told_within 10 ' WATCHDOG=1$' 4
submit "$work/long"; long=$id
wait_for "$long" running
submit "$work/small"; behind=$id
check 'the status has the counts' told_within 10 'STATUS=Serving: 1 running, 1 queued, 0 streams'
: >"$told"
check 'and pings go on while a worker solves' told_within 10 ' WATCHDOG=1$' 3

# ---- stopping in order

curl -sN "$url/v1/jobs/$long/events" >"$work/events" & stream=$!
until [[ -s $work/events ]]; do sleep 0.01; done
kill -TERM "$pid"
check 'it is told of the stop' told_within 5 ' STOPPING=1$'
request GET "$admin/readyz"
is 'a daemon that drains is not ready' "$code" 503
json 'and says so' '.ready == false and (.checks.serving | startswith("draining")) and .checks.store == "ok"'
request GET "$admin/livez"; is 'but alive' "$code" 200
submit "$work/small"
problem 'it takes no job' 503 draining
like 'and says when to try again' "$(header retry-after)" '^[0-9]+$'
request GET "/v1/jobs/$long"
json 'the job that runs goes on' '.status == "running"'
check 'more time is asked for meanwhile' told_within 10 ' EXTEND_TIMEOUT_USEC=[0-9]+$' 2
from=$SECONDS
kill -TERM "$pid"
wait "$pid"; status=$?; pid=''
is 'a second SIGTERM ends the drain: status 0' "$status" 0
check 'at once, not after the minute' test $((SECONDS - from)) -lt 30
wait "$stream"; is 'the stream has ended, not broken off' $? 0
kill "$ear"; wait "$ear" 2>/dev/null

start_daemon --workers 1 --drain-timeout 60
request GET "/v1/jobs/$long"
json 'the job that ran is back, at its next attempt' '(.status == "queued" or .status == "running") and .attempt == 2'
request DELETE "/v1/jobs/$long"
check 'the one behind it has not been lost' wait_for "$behind" succeeded
square 24 '.solver.max_iterations = 60 | .solver.tolerance = 1e-9' >"$work/some"
submit "$work/some"; some=$id
wait_for "$some" running
stop_daemon
is 'a job that ends within the drain is waited for: status 0' "$status" 0
start_daemon --workers 1
request GET "/v1/jobs/$some"
json 'and has ended at its first attempt' '.status == "succeeded" and .attempt == 1'
stop_daemon

# ---- sockets that somebody else holds

if ! command -v systemd-socket-activate >/dev/null; then
    skip 'systemd-socket-activate is not here: no restart behind held sockets'
    finish
    exit 0
fi
# Ports that were free a moment ago.
start_daemon; held=$url held_admin=$admin
stop_daemon
cat >"$work/again" <<'AGAIN'
# The holder of the sockets: starts a daemon, and another when that has ended.
# A subshell of its own, for the sockets are meant for the process that LISTEN_PID names.
until [[ -e $WORK/enough ]]; do
    (export LISTEN_PID=$BASHPID; exec "$DRAPED" --data "$WORK/data" --drain-timeout 1 --url-file "$WORK/url" 2>>"$WORK/log") &
    echo $! >"$WORK/pid"
    wait $!
    echo $? >>"$WORK/statuses"
done
AGAIN
export WORK=$work DRAPED
let_go() { # of the holder and its daemon, whatever has failed
    touch "$work/enough"
    kill "$(<"$work/pid")" "$holder" 2>/dev/null
    leave
}
trap let_go EXIT
: >"$work/statuses"
rm -f "$work/url"
systemd-socket-activate -l "${held#http://}" -l "${held_admin#http://}" --fdname=api:admin -E WORK -E DRAPED \
    bash "$work/again" 2>"$work/activated" &
holder=$!
until grep -q 'Listening on.*4\.$' "$work/activated" || ! kill -0 "$holder" 2>/dev/null; do sleep 0.01; done
is 'a request that comes before the daemon is started is answered' \
    "$(curl -s -o /dev/null -w '%{http_code}' --max-time 30 "$held/v1/info")" 200
ready() { [[ $(curl -s -o /dev/null -w '%{http_code}' --max-time 30 "$held_admin/readyz") == 200 ]]; }
until ready; do sleep 0.05; done
is 'its URL is that of the socket it was given' "$(head -n 1 "$work/url")" "$held"

# Names that the daemon does not know are a mistake in the units, not sockets to be forgotten.
systemd-socket-activate -l "$work/other.sock" --fdname=other "$DRAPED" --data "$work/other" 2>"$work/refusal" &
other=$!
until grep -q 'Listening on' "$work/refusal" || ! kill -0 "$other" 2>/dev/null; do sleep 0.01; done
curl -s -o /dev/null --max-time 5 --unix-socket "$work/other.sock" http://other/
wait "$other"; is 'a socket of a strange name is refused: status 1' $? 1
like 'by its name' "$(cat "$work/refusal")" 'event=start.failed what=sockets why=".*other'

load() {
    while [[ ! -e $work/enough ]]; do
        curl -s -o /dev/null --max-time 30 -w '%{http_code} %{exitcode}\n' "$held/v1/info"
        curl -s -o /dev/null --max-time 30 -w '%{http_code} %{exitcode}\n' -H 'Content-Type: application/json' \
            --data-binary "@$work/small" "$held/v1/jobs"
    done >"$work/answers.$1"
}
loads=()
for i in 1 2 3; do load $i & loads+=($!); done
restarts=${DRAPED_TEST_RESTARTS:-5}
for ((n = 1; n <= restarts; n++)); do
    until ready; do sleep 0.05; done
    sleep 0.2
    kill -TERM "$(<"$work/pid")"
    while (($(grep -c . "$work/statuses") < n)); do sleep 0.02; done
done
until ready; do sleep 0.05; done
touch "$work/enough"
wait "${loads[@]}"
kill -TERM "$(<"$work/pid")"
wait "$holder"
answers=$(cat "$work"/answers.*)
echo "# $restarts restarts, $(wc -l <<<"$answers") requests: $(sort <<<"$answers" | uniq -c | tr -s ' \n' ' ')"
is 'of the requests over the restarts none was refused or broken off' "$(grep -cvE '^(200|202|503) 0$' <<<"$answers")" 0
check 'and many were served' test "$(grep -cE '^20' <<<"$answers")" -gt 20
is 'every daemon ended with status 0' "$(sort -u "$work/statuses")" 0
finish
