#!/bin/bash
# How many status requests a second the daemon answers while every worker solves, and how late the slowest come.
# usage: tests/bench/load.sh        SECONDS_EACH (10); the table lands in build/bench-load.md
cd "$(dirname "$0")/../.." || exit 1
. tests/api/lib.sh
seconds=${SECONDS_EACH:-10}
workers=$(nproc)
start_daemon --workers "$workers"
endless 60 >"$work/job"
for ((n = 0; n < workers; n++)); do submit "$work/job"; wait_for "$id" running; done
square 4 '.solver.max_iterations = 1' >"$work/small"
curl -s -o "$work/info" "$url/v1/info"

# measure NAME PATH [LUA]: one row.
measure() {
    wrk -t 1 -c "$2" -d "${seconds}s" --latency "$url$3" >"$work/wrk" || return
    awk -v name="$1" '
        $1 == "99%" {p99 = $2}
        $1 == "Requests/sec:" {rate = $2}
        /Non-2xx|Socket errors/ {bad = bad " " $0}
        END {printf "| %s | %.0f | %s |%s\n", name, rate, p99, bad}' "$work/wrk"
}
{
    echo "$workers processors, $workers workers, all of them solving; one thread of wrk on the same processors."
    echo
    echo '| requests | answers a second | 99 of 100 within |'
    echo '| --- | --- | --- |'
    measure 'GET /v1/jobs/{id}, 16 connections' 16 "/v1/jobs/$id"
    measure 'GET /v1/jobs/{id}, 100 connections' 100 "/v1/jobs/$id"
    measure 'GET /v1/info, 16 connections' 16 /v1/info
} | tee build/bench-load.md
request GET "/v1/jobs/$id"
[[ $(jq -r .status "$body") == running ]] || { echo "the job has ended: $(jq -c '{status, verdict}' "$body")"; exit 1; }
stop_daemon
