#!/bin/bash
# One call of the system fails, another one in each session: memory, files, syncs, renames, statements of the
# database. The daemon may refuse, or fail to start; it must not crash, and what it accepted must be there.
# Memory is filled when it is taken and freed, so that whoever reads past what is there dies of it each time.
# DRAPED_TEST_FAULTS: sessions of each kind, spread evenly; "all": one for every call (hours; make break-long).
. "$(dirname "$0")/lib.sh"
sessions=${DRAPED_TEST_FAULTS:-12}
shim=$PWD/build/release/tests/preload/faults.so
square 4 '.solver.max_iterations = 3' >"$work/job"
printf 'v 0 0 0\nv 0.1 0 0\nv 0 0 0.1\nf 1 2 3\n' >"$work/mesh.obj"
: >"$work/accepted"
: >"$work/odd"

# session KIND AT: a daemon of which that call fails, and what a client does with it. Its end in $status.
session() {
    local kind=$1 at=$2 id
    rm -f "$work/url" "$work/count"
    FAULT_KIND=$kind FAULT_AT=$at FAULT_COUNT=$work/count LD_PRELOAD=$shim "$DRAPED" --listen 127.0.0.1:0 \
        --admin 127.0.0.1:0 --data "$data" --url-file "$work/url" --drain-timeout 1 --workers 1 2>"$work/last-log" &
    pid=$!
    for ((i = 0; i < 500; i++)); do
        [[ -s $work/url ]] && { read -r url && read -r admin; } <"$work/url" && break
        kill -0 "$pid" 2>/dev/null || break
        sleep 0.01
    done
    if [[ -s $work/url ]]; then
        visit "$kind $at"
        kill -TERM "$pid" 2>/dev/null
    fi
    for ((i = 0; i < 1500; i++)); do kill -0 "$pid" 2>/dev/null || break; sleep 0.01; done
    kill -KILL "$pid" 2>/dev/null
    wait "$pid" 2>/dev/null
    status=$?
    pid=''
    ((status < 128)) || { echo "$kind $at: status $status" >>"$work/odd"; tail -n 5 "$work/last-log" >>"$work/odd"; }
}

# visit LABEL: each answer may be the right one or a refusal, 000 when there was no memory for one.
visit() {
    local label=$1
    expect() { [[ $code =~ ^($1|500|503|000)$ ]] || echo "$label: $2 gave $code $(head -c 200 "$body")" >>"$work/odd"; }
    request POST /v1/meshes -H 'Content-Type: model/obj' --data-binary "@$work/mesh.obj"; expect '200|201' mesh
    request POST /v1/jobs -H 'Content-Type: application/json' --data-binary "@$work/job"; expect 202 post
    [[ $code == 202 ]] || return
    id=$(jq -r .id "$body")
    echo "$id $label" >>"$work/accepted"
    request GET "/v1/jobs/$id?" -H 'Prefer: wait=5'; expect 200 wait
    [[ $code == 200 && $(jq -r .status "$body") == succeeded ]] || return
    request GET "/v1/jobs/$id/result?format=glb"; expect 200 result
    request GET "/v1/jobs/$id/trace?format=csv"; expect 200 trace
    request GET '/v1/jobs?limit=2'; expect 200 list
    ((RANDOM % 2)) || return
    request DELETE "/v1/jobs/$id"; expect 204 delete
    # Without an answer nobody knows whether it was removed.
    [[ $code =~ ^(204|000)$ ]] && sed -i '$d' "$work/accepted"
}

# GLIBC_TUNABLES: memory kept back for each thread would not be filled.
export MALLOC_PERTURB_=165 GLIBC_TUNABLES=glibc.malloc.tcache_count=0
RANDOM=20261123
total=0
for kind in malloc open write sync rename step; do
    session "$kind" 0
    calls=$(cat "$work/count" 2>/dev/null || echo 0)
    check "$kind: there are calls to fail" test "$calls" -gt 0
    wanted=$sessions
    [[ $wanted == all || $wanted -gt $calls ]] && wanted=$calls
    for ((n = 0; n < wanted; n++)); do
        session "$kind" $((1 + n * calls / wanted))
    done
    total=$((total + wanted))
    is "$kind: $wanted of $calls calls fail: no crash, no wrong answer" "$(cat "$work/odd")" ''
    : >"$work/odd"
done

# ---- what was accepted is there, and runs to its end
start_daemon --workers 2
lost=0 open=0 accepted=$(grep -c . "$work/accepted")
while read -r id fault; do
    wait_for "$id" 'succeeded|failed|canceled' 20 2>/dev/null ||
        { open=$((open + 1)); echo "# after fault $fault: $code $(head -c 900 "$body")"; }
    [[ $code == 200 ]] || { lost=$((lost + 1)); echo "# lost after fault $fault: $code"; }
    [[ $(jq -r .status "$body" 2>/dev/null) == succeeded ]] || continue
    request GET "/v1/jobs/$id/result?format=json"
    [[ $code == 200 ]] || { lost=$((lost + 1)); echo "# no result after fault $fault: $code $(head -c 300 "$body")"; }
done <"$work/accepted"
is "of $accepted accepted jobs none is lost" "$lost" 0
is 'and none is stuck' "$open" 0
stop_daemon; is 'the daemon stops with status 0' "$status" 0
check 'the database is whole' test "$(sqlite3 "$data/draped.db" 'PRAGMA integrity_check')" = ok
echo "# $total faults, $accepted jobs accepted, $lost lost"
finish
