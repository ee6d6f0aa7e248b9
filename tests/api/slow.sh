#!/bin/bash
# Clients that dribble or stall hold nobody else up, and are cut.
# DRAPED_TEST_SLOW: how many of each kind; DRAPED_TEST_TIMES=1 also holds health to 50 ms (make break-long does both).
. "$(dirname "$0")/lib.sh"
clients=${DRAPED_TEST_SLOW:-200}
slow=build/release/tests/api/slow_clients
ulimit -n 8192 2>/dev/null || ulimit -n "$(ulimit -Hn)"
start_daemon --workers 1 --max-connections $((3 * clients + 64)) --max-streams 16
port=${url##*:}
square 4 '.solver.max_iterations = 1' >"$work/job"
square 90 '.solver.max_iterations = 1' >"$work/large"
submit "$work/large"; large=$id
wait_for "$large" succeeded
connections() { curl -s --max-time 10 "$admin/metrics" | awk '$1 == "draped_connections" {print $2}'; }
resident() { awk '/^VmRSS/ {print $2}' "/proc/$pid/status"; }
before=$(resident)

# ---- all three kinds at once
declare -A slow_pid
begin() { # begin KIND SECONDS [PATH]
    "$slow" "$1" "$clients" "$2" "$port" "${@:3}" >"$work/slow-$1" 2>&1 &
    slow_pid[$1]=$!
    for ((i = 0; i < 400; i++)); do [[ -s $work/slow-$1 ]] && break; sleep 0.05; done
    is "$1: all are connected" "$(head -n 1 "$work/slow-$1")" "$clients opened"
}
begin body 90 /v1/jobs
begin head 40
begin reader 90 "/v1/jobs/$large/result?format=json"
for ((i = 0; i < 20; i++)); do (($(connections) >= 3 * clients)) && break; sleep 0.5; done
check 'the daemon holds them all' test "$(connections)" -ge $((3 * clients))

# ---- honest jobs, and probes of health, beside them
refused=0 slowest=0
for ((n = 0; n < 60; n++)); do
    curl -s -o "$work/livez" --max-time 10 -w '%{time_total} %{http_code}\n' "$admin/livez" >>"$work/health"
    posted=${EPOCHREALTIME/[.,]/}
    request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$work/job"
    took=$(((${EPOCHREALTIME/[.,]/} - posted) / 1000))
    ((took > slowest)) && slowest=$took
    [[ $code == 202 ]] || refused=$((refused + 1))
    sleep 0.1
done
during=$(resident)
is "every one of $n honest jobs is taken" "$refused" 0
is 'health answers each time' "$(grep -c ' 200$' "$work/health")" "$n"
p99=$(sort -n "$work/health" | awk '{t[NR] = $1} END {printf "%.1f", 1000 * t[int(NR * 0.99 + 0.5)]}')
if [[ -n ${DRAPED_TEST_TIMES-} ]]; then
    check 'health answers 99 of 100 times within 50 ms' awk -v p="$p99" 'BEGIN {exit !(p < 50)}'
fi

# ---- cut, each in its time: the client looks once a second, and the daemon four times
ended() { # ended KIND SECONDS
    wait "${slow_pid[$1]}"
    like "$1: all were cut" "$(tail -n 1 "$work/slow-$1")" "^$clients opened, $clients cut, "
    check "$1: within $2 s" awk -v most="$2" 'END {exit !($(NF - 1) <= most + 3)}' "$work/slow-$1"
    echo "# $1: $(tail -n 1 "$work/slow-$1")"
}
ended head 15
ended body 60
for ((i = 0; i < 120; i++)); do (($(connections) <= 1)) && break; sleep 0.5; done
check 'stalled readers are let go too' test "$(connections)" -le 1
kill "${slow_pid[reader]}" 2>/dev/null
wait "${slow_pid[reader]}" 2>/dev/null
echo "# $clients of each kind: health p99 $p99 ms, $n honest posts, $refused refused, slowest $slowest ms, memory +$(((during - before) / 1024)) MiB"
request GET "/v1/jobs/$large"; is 'the daemon answers as ever' "$code" 200
stop_daemon; is 'and stops with status 0' "$status" 0
finish
