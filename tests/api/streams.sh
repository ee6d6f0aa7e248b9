#!/bin/bash
# A hundred event streams that break off and come back lose nothing: tests/api/streams.c says what is held.
# STREAMS, JOBS and SECONDS_AT_MOST make it longer: STREAMS=500 JOBS=2000 SECONDS_AT_MOST=3600 tests/api/streams.sh
. "$(dirname "$0")/lib.sh"
streams=build/release/tests/api/streams
n=${STREAMS:-100}
start_daemon --workers 2 --max-streams $((2 * n)) --max-connections $((3 * n + 200)) --max-queued 100000
endless 10 ' | .solver.max_iterations = 150' >"$work/job"
"$streams" "$url" "$work/job" -n "$n" -j "${JOBS:-60}" -k 10 -c 30 -s 1 -t "${SECONDS_AT_MOST:-200}" >"$work/said"
said=$?
sed 's/^/# /' "$work/said"
is 'every stream saw every state once, in order, and the end' "$said" 0
line=$(tail -n 1 "$work/said")
counts() { sed -n "s/.*[ (]\([0-9]*\) $1.*/\1/p" <<<"$line"; }
check 'streams did break off' [ "$(counts 'dropped in')" -ge "$n" ]
check 'and were resumed' [ "$(counts resumed)" -ge "$n" ]
check 'and long polls saw changes' [ "$(counts changed)" -gt 0 ]
# All are gone: so are their places.
streams_open() { curl -s "$admin/metrics" | sed -n 's/^draped_streams //p'; }
for ((i = 0; i < 900; i++)); do [[ $(streams_open) == 0 ]] && break; sleep 0.05; done
is 'no place is held for a client that left' "$(streams_open)" 0
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
