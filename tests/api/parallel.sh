#!/bin/bash
# Two jobs on two workers run side by side, and the daemon answers all the while.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 2
endless 32 ' | .solver.max_iterations = 150' >"$work/job"

submit "$work/job"
wait_for "$id" succeeded 120
one=$(jq .report.seconds "$body")

from=${EPOCHREALTIME/[.,]/}
submit "$work/job"; a=$id
submit "$work/job"; b=$id
both=0 probes=0 slow=0 worst=0 failures=0
while :; do
    read -r answer seconds < <(curl -s -o /dev/null --max-time 5 -w '%{http_code} %{time_total}\n' "$admin/livez")
    probes=$((probes + 1))
    [[ $answer == 200 ]] || failures=$((failures + 1))
    ms=$(awk -v s="$seconds" 'BEGIN {printf "%d", s * 1000}')
    ((ms > worst)) && worst=$ms
    ((ms >= 50)) && slow=$((slow + 1))
    sa=$(status_of "$a") sb=$(status_of "$b")
    [[ $sa == running && $sb == running ]] && both=1
    [[ $sa == succeeded && $sb == succeeded ]] && break
    [[ $sa == failed || $sb == failed ]] && break
    ((${EPOCHREALTIME/[.,]/} - from > 120000000)) && break
    sleep 0.02
done
two=$(awk -v a="$from" -v b="${EPOCHREALTIME/[.,]/}" 'BEGIN {printf "%.2f", (b - a) / 1e6}')
echo "# one job $one s, two jobs at once $two s, $(nproc) processors"
echo "# livez: $probes probes, slowest $worst ms, $slow of them 50 ms or more"
is 'both jobs ran at once' "$both" 1
is 'both succeeded' "$sa $sb" 'succeeded succeeded'
is 'livez answered 200 every time' "$failures" 0
check 'and was asked often' test "$probes" -ge 10
# On a busy machine a probe may wait for the processor; a blocked listener would wait for the jobs.
check "no livez took half a second (the slowest $worst ms)" test "$worst" -lt 500
if (($(nproc) >= 2)); then
    # One after the other would take twice as long, plus nothing: leave room for what else runs here.
    check 'two at once take less than one after the other, within the noise of a shared machine' \
        awk -v one="$one" -v two="$two" 'BEGIN {exit !(two < 2.5 * one + 1)}'
fi
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
