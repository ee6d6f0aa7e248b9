#!/bin/bash
# A disk that is full, read-only, broken or stuck; no descriptors left; a clock that jumps. What is refused is
# refused with 503, what need not be written goes on, and soon after relief all is as before.
# DRAPED_TEST_ROUNDS (2) says how often each disk fails.
. "$(dirname "$0")/lib.sh"
tools=build/release/tests
rounds=${DRAPED_TEST_ROUNDS:-2}
export DISK_ROOT=$data DISK_CONTROL=$work/disk
endless >"$work/long"
square 6 >"$work/small"
printf 'v 0 0 0\nv 0.1 0 0\nv 0 0 0.1\nf 1 2 3\n' >"$work/triangle.obj"

disk() { printf '%s' "$1" >"$DISK_CONTROL"; }
# within SECONDS COMMAND...: until it succeeds.
within() {
    local deadline=$((SECONDS + $1))
    shift
    until "$@"; do
        ((SECONDS <= deadline)) || return 1
        sleep 0.05
    done
}
readyz_is() { request GET "$admin/readyz"; [[ $code == "$1" ]]; }
# In this shell, not in check's: it sets id.
post_is() { submit "$work/small"; [[ $code == "$1" ]]; }

# ---- the disk refuses

# refused WHAT: every kind of write is a 503 that says so, and reading goes on.
refused() {
    local i
    for i in 1 2 3; do submit "$work/small"; problem "$1: a job is refused" 503 storage; done
    request POST /v1/meshes -H 'Content-Type: model/obj' --data-binary "@$work/triangle.obj"
    problem "$1: so is a mesh" 503 storage
    json "$1: and may be sent again" '.retryable'
    request GET "/v1/jobs/$long"; is "$1: status goes on" "$code $(jq -r .status "$body")" '200 running'
    request GET /v1/jobs; is "$1: so does the list" "$code" 200
    request GET "$admin/livez"; is "$1: and liveness" "$code" 200
}

for kind in full readonly broken; do
    disk ''
    LD_PRELOAD=$tools/preload/disk.so start_daemon --workers 1 --min-free 0
    for ((round = 1; round <= rounds; round++)); do
        submit "$work/long"; long=$id
        wait_for "$long" running
        submit "$work/small"; first=$id
        submit "$work/small"; second=$id
        disk "$kind"
        check "$kind disk, round $round: it is not ready" within 5 readyz_is 503
        json "$kind: and says why" '.checks.store != "ok"'
        refused "$kind"
        if [[ $kind == full ]]; then
            request DELETE "/v1/jobs/$first"; is 'full: a queued job is cancelled' "$code" 202
            request GET "/v1/jobs/$first"; json 'full: at once' '.status == "canceled"'
            request DELETE "/v1/jobs/$first"; is 'full: and removed' "$code" 204
            request DELETE "/v1/jobs/$long"; is 'full: so is a running one' "$code" 202
            check 'full: it ends' wait_for "$long" canceled 10
        else
            request DELETE "/v1/jobs/$first"; problem "$kind: what cannot be written is not cancelled" 503 storage
            request GET "/v1/jobs/$first"; json "$kind: and still waits" '.status == "queued"'
        fi
        disk ''
        within 5 post_is 202; is "$kind: a job is taken within 5 s of relief" "$code" 202
        third=$id
        check "$kind: and it is ready" within 5 readyz_is 200
        [[ $kind == full ]] || { request DELETE "/v1/jobs/$long"; wait_for "$long" canceled 30; }
        for id in "$second" "$third"; do
            check "$kind: what waited has not been lost" wait_for "$id" succeeded 30
            json "$kind: nor run twice" '.attempt == 1'
        done
    done
    stop_daemon
    is "$kind: the daemon stops with status 0" "$status" 0
done

disk readonly
LD_PRELOAD=$tools/preload/disk.so "$DRAPED" --listen 127.0.0.1:0 --admin 127.0.0.1:0 --data "$data" 2>"$work/refusal"
is 'on a read-only disk it does not start' $? 1
like 'and says why' "$(cat "$work/refusal")" 'event=start.failed what=store why=".*(Read-only|readonly)'
disk ''

# A real file system where one may be made: of 24 MiB, and somebody else fills it to the last byte.
mkdir "$work/small-disk"
if mount -t tmpfs -o size=24m tmpfs "$work/small-disk" 2>/dev/null; then
    trap 'umount -l "$work/small-disk"; leave' EXIT
    was=$data data=$work/small-disk/data
    start_daemon --workers 1 --min-free 1000000
    submit "$work/long"; long=$id
    wait_for "$long" running
    submit "$work/small"; first=$id
    head -c 100M /dev/zero >"$work/small-disk/filler" 2>/dev/null
    check 'tmpfs: it is not ready' within 5 readyz_is 503
    json 'tmpfs: for want of space' '.checks.space | startswith("0 bytes")'
    refused tmpfs
    request DELETE "/v1/jobs/$first"; is 'tmpfs: a queued job is cancelled' "$code" 202
    request DELETE "/v1/jobs/$long"; is 'tmpfs: so is a running one' "$code" 202
    check 'tmpfs: it ends' wait_for "$long" canceled 10
    rm "$work/small-disk/filler"
    within 5 post_is 202; is 'tmpfs: a job is taken within 5 s of relief' "$code" 202
    check 'tmpfs: and succeeds' wait_for "$id" succeeded
    stop_daemon
    is 'tmpfs: the daemon stops with status 0' "$status" 0
    data=$was
else
    skip 'no file system may be made here: only the simulated disk was full'
fi

# ---- the disk holds everything up

hear_notices "$work/told"
pinged() { grep -q 'WATCHDOG=1' "$work/told"; }
NOTIFY_SOCKET=$work/notify WATCHDOG_USEC=2000000 LD_PRELOAD=$tools/preload/disk.so start_daemon --workers 1
check 'the watchdog is pinged' within 10 pinged
disk stuck
curl -s -o "$work/late" -w '%{http_code}' --max-time 60 -H 'Content-Type: application/json' \
    --data-binary "@$work/small" "$url/v1/jobs" >"$work/late.code" & late=$!
check 'a commit that does not come back is told' within 20 readyz_is 503
json 'as stale' '.checks.watchdog | startswith("stale")'
request GET "$admin/livez"; is 'alive is who says so' "$code" 200
sleep 1 # one ping may be on its way
: >"$work/told"
sleep 2
is 'the pings have stopped' "$(grep -c WATCHDOG=1 "$work/told")" 0
disk ''
check 'they come again when the disk does' within 10 pinged
wait "$late"
is 'and what waited for it is done' "$(<"$work/late.code")" 202
check 'the daemon is ready again' within 5 readyz_is 200
stop_daemon
kill "$ear"; wait "$ear" 2>/dev/null

# ---- no descriptors

cpu_ticks() { awk '{print $14 + $15}' "/proc/$pid/stat"; }
start_daemon --workers 1
post_is 202; wait_for "$id" succeeded
fds=("/proc/$pid/fd/"*)
limit=${#fds[@]}
# Room for the connection, and none for what its body is spooled to.
prlimit --pid "$pid" --nofile=$((limit + 1)):4096
for ((i = 0; i < 20; i++)); do
    submit "$work/small"
    [[ $code == 503 ]] && break
done
problem 'without a descriptor for its body a job is refused' 503 storage
prlimit --pid "$pid" --nofile="$limit":4096
from=$(cpu_ticks)
for i in 1 2 3; do curl -s -o /dev/null --max-time 1 "$url/v1/info" & done
sleep 2
took=$(($(cpu_ticks) - from))
check "without one for a connection it waits and does not spin ($took of 200 ticks)" test "$took" -lt 100
check 'and lives' kill -0 "$pid"
prlimit --pid "$pid" --nofile=1024:4096
info_is() { request GET /v1/info --max-time 1; [[ $code == "$1" ]]; }
check 'it accepts within 5 s of relief' within 5 info_is 200
check 'also at its other listener' within 5 readyz_is 200
post_is 202; is 'and takes jobs' "$code" 202
check 'which succeed' wait_for "$id" succeeded
stop_daemon
is 'it stops with status 0' "$status" 0

# ---- the clock

faketime=$(ls /usr/lib/*/faketime/libfaketimeMT.so.1 2>/dev/null | head -n 1)
if [[ -z $faketime ]]; then
    skip 'libfaketime is not here: the clock did not jump'
    finish
    exit 0
fi
clock() { echo "$1" >"$work/clock.new"; mv "$work/clock.new" "$work/clock"; }
clock +0
LD_PRELOAD=$faketime FAKETIME_TIMESTAMP_FILE=$work/clock FAKETIME_NO_CACHE=1 DONT_FAKE_MONOTONIC=1 \
    start_daemon --workers 1
post_is 202; before=$id
wait_for "$before" succeeded
ids=()
for jump in +3600 -3600 +315360000 -315360000 +0; do
    submit "$work/long"; long=$id
    wait_for "$long" running
    submit "$work/small"; behind=$id
    request GET "/v1/jobs/$behind"; etag=$(header etag)
    curl -s -o /dev/null -w '%{time_total}' --max-time 30 "$url/v1/jobs/$behind" -H "If-None-Match: $etag" \
        -H 'Prefer: wait=2' >"$work/waited" & poll=$!
    curl -sN --max-time 30 "$url/v1/jobs/$long/events" >"$work/events" & stream=$!
    until [[ -s $work/events ]]; do sleep 0.01; done
    clock "$jump"
    request GET "/v1/jobs/$long"; json "clock $jump: the job that runs goes on" '.status == "running" and .attempt == 1'
    wait "$poll"
    check "clock $jump: who waits 2 s is not answered early ($(<"$work/waited") s)" \
        awk -v t="$(<"$work/waited")" 'BEGIN {exit !(t > 1.9)}'
    request DELETE "/v1/jobs/$long"
    wait "$stream"; is "clock $jump: the stream goes on to the end" "$? $(grep -c '^event: end' "$work/events")" '0 1'
    check "clock $jump: the next job succeeds" wait_for "$behind" succeeded
    json "clock $jump: at its first attempt" '.attempt == 1'
    wait_for "$long" canceled
    request GET "/v1/jobs/$before"; is "clock $jump: what had ended is still there" "$code" 200
    ids+=("$long" "$behind")
done
negative=0
for id in "${ids[@]}"; do
    request GET "/v1/jobs/$id"
    jq -e '(.started_at // .created_at) >= .created_at and .finished_at >= (.started_at // .created_at)
        and (.report == null or .report.seconds >= 0)' "$body" >/dev/null || negative=$((negative + 1))
done
is 'no time of a job lies before the one it follows' "$negative" 0
is 'no metric is negative' "$(curl -s "$admin/metrics" | grep -c ' -')" 0
is 'the format of metrics is kept' "$(curl -s "$admin/metrics" | awk -f tests/api/exposition.awk)" ''
check 'it is ready' within 5 readyz_is 200
stop_daemon
is 'it stops with status 0' "$status" 0
start_daemon
request GET "/v1/jobs/${ids[0]}"; is 'the next daemon, of our time, knows the jobs' "$code" 200
stop_daemon
echo "# $rounds rounds of each failing disk, of EMFILE and of jumping clocks: $tests checks"
finish
