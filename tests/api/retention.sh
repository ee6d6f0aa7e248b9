#!/bin/bash
# What is kept, and for how long; and that a full disk hinders nobody who makes room.
# The disk is a small file system of its own, where the system lets us mount one.
if [[ -z ${DRAPED_TEST_MOUNTS-} ]]; then
    if unshare -rm true 2>/dev/null; then DRAPED_TEST_MOUNTS=yes exec unshare -rm "$0"; fi
    DRAPED_TEST_MOUNTS=no
fi
. "$(dirname "$0")/lib.sh"

post_named() { square 2 ".solver.max_iterations = 1 | .name = \"$1\"" >"$work/small"; submit "$work/small"; }
# until COMMAND...: holds within half a minute
until_true() {
    local i
    for ((i = 0; i < 300; i++)); do "$@" && return 0; sleep 0.1; done
    return 1
}
code_is() { request GET "$1" && [[ $code == "$2" ]]; }
files() { find "$data/$1" -mindepth 1 -maxdepth 1 | wc -l; }

# ---- by number
start_daemon --workers 1 --retain-jobs 2
for i in 1 2 3 4; do
    post_named "n$i"; ids[i]=$id
    wait_for "$id" succeeded
done
check 'beyond two ended jobs the oldest is pruned' until_true code_is "/v1/jobs/${ids[2]}" 410
request GET "/v1/jobs/${ids[1]}"; problem 'as the one before it' 410 gone
request GET "/v1/jobs/${ids[1]}/result"; problem 'with its result' 410 gone
request DELETE "/v1/jobs/${ids[1]}"; is 'DELETE of it is no error' "$code" 204
request GET "/v1/jobs/${ids[3]}"; is 'two are there' "$code" 200
request GET /v1/jobs; json 'and in the list' '[.jobs[].name] == ["n4", "n3"]'
is 'their files too, and no others' "$(files jobs) $(files results)" '2 2'
request GET "$admin/metrics"
like 'it is counted' "$(<"$body")" 'draped_jobs_pruned_total 2'
endless >"$work/long"
submit "$work/long"; long=$id
wait_for "$long" running
post_named waits; waits=$id
stop_daemon

# ---- at the start, and never what has not ended
start_daemon --workers 1 --retain-jobs 0
check 'a start with fewer prunes at once' until_true code_is "/v1/jobs/${ids[4]}" 410
request GET "/v1/jobs/$long"; is 'one that runs is not touched' "$code" 200
request GET "/v1/jobs/$waits"; is 'nor one that waits' "$code" 200
request DELETE "/v1/jobs/$long"
stop_daemon

# ---- by size
start_daemon --workers 1 --retain-bytes 1
post_named large
check 'a job larger than all that may be kept goes after its end' until_true code_is "/v1/jobs/$id" 410
stop_daemon
start_daemon --workers 1
post_named kept; wait_for "$id" succeeded
request GET "/v1/jobs/$id"; is 'without flags it stays' "$code" 200
request GET "/v1/jobs?created_after=$(date -u -d '-1 hour' +%FT%TZ)"; json 'it is in the list since an hour ago' '.jobs | length == 1'
request GET "/v1/jobs?created_after=$(date -u -d '+1 hour' +%FT%TZ)"; json 'but not in that from in an hour on' '.jobs == []'
request GET '/v1/jobs?created_after=yesterday'; problem 'yesterday is no date-time' 400 bad-request
for i in 1 2 3; do post_named "p$i"; wait_for "$id" succeeded; done
request GET "/v1/jobs?limit=2&created_after=$(date -u -d '-1 hour' +%FT%T.5%%2B00:00)"
next=$(header link); next=${next#<}; next=${next%%>*}
like 'the link to the next page keeps it' "$next" 'created_after=.*%2B00%3A00'
post_named newer
request GET "$next"; json 'and leads on, whatever came meanwhile' '[.jobs[].name] == ["p1", "kept"]'

# ---- meshes
printf 'v 0 -5 0\nv 1 -5 0\nv 0 -5 1\nv 0 -4 0\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n' >"$work/mesh.obj"
sha=$(sha256sum "$work/mesh.obj" | cut -d' ' -f1)
put() { request PUT "/v1/meshes/$sha" -H 'Content-Type: model/obj' --data-binary "@$work/mesh.obj"; }
put; is 'a mesh is kept' "$code" 201
request DELETE "/v1/meshes/$sha"; is 'and removed' "$code" 204
request GET "/v1/meshes/$sha"; problem 'it is gone' 404 not-found
request DELETE "/v1/meshes/$sha"; problem 'and cannot be removed again' 404 not-found
is 'with its file' "$(files meshes)" 0
put
square 24 ".solver.max_iterations = 1 | .bodies = [{mesh: {ref: \"$sha\"}}]" >"$work/by-ref"
submit "$work/by-ref"; from=$id
wait_for "$from" succeeded
endless 24 " | .start_from = \"$from\"" >"$work/again"
submit "$work/again"; again=$id
is 'a job is draped again, without its body' "$code" 202
request DELETE "/v1/jobs/$from"
request DELETE "/v1/meshes/$sha"; problem 'it holds the mesh of the job it starts from' 409 in-use
request DELETE "/v1/jobs/$again"
wait_for "$again" canceled
endless 24 " | .bodies = [{mesh: {ref: \"$sha\"}}]" >"$work/by-ref"
submit "$work/by-ref"; user=$id
if [[ $code == 202 ]]; then
    request DELETE "/v1/meshes/$sha"; problem 'a job that has not ended holds it' 409 in-use
    json 'for as long' '.retryable == true'
    request DELETE "/v1/jobs/$user"
    wait_for "$user" canceled
    request DELETE "/v1/meshes/$sha"; is 'then it may go' "$code" 204
else
    not_ok 'a job may name the mesh as a body' "$(<"$body")"
fi
submit "$work/by-ref"; problem 'nobody may name it any more' 422 invalid /bodies/0/mesh/ref
stop_daemon; is 'the daemon stops with status 0' "$status" 0

# ---- a full disk
if [[ $DRAPED_TEST_MOUNTS == no ]]; then
    skip 'a full disk: nothing may be mounted here'
    finish
    exit
fi
data=$work/disk/data
mkdir "$work/disk"
mount -t tmpfs -o size=20m none "$work/disk"
start_daemon --workers 1 --min-free 0
for i in 1 2 3; do post_named "d$i"; ids[i]=$id; wait_for "$id" succeeded; done
submit "$work/long"; long=$id
wait_for "$long" running
post_named waits; waits=$id
dd if=/dev/zero of="$work/disk/others" bs=4096 2>/dev/null # until there is no more
is 'the disk is full' "$(df --output=avail "$work/disk" | tail -n 1 | tr -d ' ')" 0
post_named none; problem 'no job is accepted' 503 storage
request PUT "/v1/meshes/$sha" -H 'Content-Type: model/obj' --data-binary "@$work/mesh.obj"; problem 'no mesh' 503 storage
request GET "/v1/jobs/${ids[1]}"; is 'status is told' "$code" 200
request DELETE "/v1/jobs/${ids[1]}"; is 'a job that has ended is removed' "$code" 204
request GET "/v1/jobs/${ids[1]}"; problem 'for good' 410 gone
request DELETE "/v1/jobs/$waits"; is 'one that waits is cancelled' "$code" 202
request DELETE "/v1/jobs/$long"; is 'so is one that runs' "$code" 202
check 'and ends' wait_for "$long" canceled
kill_daemon
start_daemon --workers 1 --min-free 0 --retain-jobs 0
check 'killed and started on the full disk it prunes' until_true code_is "/v1/jobs/${ids[3]}" 410
rm "$work/disk/others"
post_named after; is 'relieved it accepts at once' "$code" 202
check 'and solves' until_true code_is "/v1/jobs/$id" 410
is 'its reserve is whole again' "$(stat -c %s "$data/draped.reserve")" $((8 << 20))
stop_daemon; is 'and the daemon stops with status 0' "$status" 0
umount "$work/disk"
finish
