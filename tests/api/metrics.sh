#!/bin/bash
# The metrics keep to the format, and to what happened.
. "$(dirname "$0")/lib.sh"
faults() { awk -f tests/api/exposition.awk "$1"; }
sample() { curl -s "$admin/metrics" | sed -n "s/^$1 //p"; }
# counted NAME VALUE: within some seconds, for gauges are set four times a second.
counted() {
    local i
    for ((i = 0; i < 200; i++)); do
        [[ $(sample "$1") == "$2" ]] && return 0
        sleep 0.05
    done
    curl -s "$admin/metrics" | grep "^${1%%\{*}"
    return 1
}

start_daemon --workers 1
square 4 >"$work/small"
endless >"$work/long"
submit "$work/small"; wait_for "$id" succeeded
submit "$work/long"; long=$id
wait_for "$long" running
submit "$work/small"
curl -sN "$url/v1/jobs/$long/events" >"$work/events" & stream=$!
check 'jobs are counted by state' counted 'draped_jobs{state="running"}' 1
check 'also those that wait' counted 'draped_jobs{state="queued"}' 1
check 'streams are counted' counted 'draped_streams' 1
is 'requests by route template, method and code' "$(sample 'draped_http_requests_total{route="\/v1\/jobs",method="POST",code="202"}')" 3
request GET "/v1/jobs/0123456789abcdef0123456789abcdef"
request GET "/no/such/path/$id"
request 'BREW' /v1/jobs
is 'of ends, each by its status' "$(sample 'draped_jobs_ended_total{status="succeeded"}')" 1
is 'the wait in the queue has a histogram' "$(sample draped_queue_seconds_count)" 2
is 'so has the run' "$(sample draped_run_seconds_count)" 1
for name in draped_oldest_queued_seconds draped_data_free_bytes process_cpu_seconds_total process_resident_memory_bytes \
    process_open_fds draped_commit_seconds_sum; do
    check "$name is above nothing" awk -v v="$(sample $name)" 'BEGIN {exit !(v > 0)}'
done
is 'the build is told' "$(sample "draped_build_info{version=\"$("$DRAPED" --version | sed 's/.* //')\"}")" 1
curl -s "$admin/metrics" >"$work/metrics"
is 'the whole keeps to the format' "$(faults "$work/metrics")" ''
if command -v promtool >/dev/null; then
    check 'promtool finds nothing' promtool check metrics <"$work/metrics"
fi
request DELETE "/v1/jobs/$long"
wait "$stream"
stop_daemon

# The rules can fail: each of these breaks one.
broken() {
    sed "$2" "$work/metrics" >"$work/broken"
    check "noticed is $1" test -n "$(faults "$work/broken")"
}
broken 'a counter without _total' 's/draped_iterations_total/draped_iterations/'
broken 'a second sample' '/^draped_streams /p'
broken 'a missing TYPE' '/^# TYPE draped_streams /d'
broken 'a bucket that falls' 's/^\(draped_queue_seconds_bucket{le="1000"}\) .*/\1 0/'
broken 'an id as a route' 's/route="none"/route="\/v1\/jobs\/0123456789abcdef"/'
broken 'milliseconds' 's/draped_oldest_queued_seconds/draped_oldest_queued_ms/'
broken 'an unescaped quote' 's/version="/version=""/'
finish
