#!/bin/bash
# The README does what it says: each of its ```sh blocks runs, in order, against a daemon on other ports.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1

awk -v dir="$work" '/^```sh$/ {on = 1; n++; file = sprintf("%s/block%02d", dir, n); next}
    /^```/ {on = 0} on {print >file}' README.md
export PATH=$PWD/build:$PATH
tree=$PWD
mkdir "$work/folder"
cd "$work/folder" || exit 1
cp -r "$tree/build/drape" .
for block in "$work"/block*; do
    sed -i "s|http://127.0.0.1:8080|$url|; s|http://127.0.0.1:8081|$admin|; s|build/drape |drape |g" "$block"
    failed=''
    set -o pipefail
    trap 'failed+="line failed: $BASH_COMMAND; "' ERR
    . "$block" >"$work/said" 2>&1 </dev/null
    trap - ERR
    is "README: $(head -n 1 "$block")" "$failed$( [[ -n $failed ]] && tail -c 400 "$work/said")" ''
done
check 'the README has blocks to run' test "$(ls "$work"/block* | wc -l)" -ge 5
# Every route that the daemon has stands in the README.
for route in 'POST /v1/jobs' 'GET /v1/jobs' 'GET /v1/jobs/{id}' 'DELETE /v1/jobs/{id}' 'GET /v1/jobs/{id}/events' \
    'GET /v1/jobs/{id}/result' 'GET /v1/jobs/{id}/trace' 'PUT /v1/meshes/{sha256}' 'POST /v1/meshes' \
    'GET /v1/meshes/{sha256}' 'GET /v1/materials' 'GET /v1/info' 'GET /livez' 'GET /readyz' 'GET /metrics'; do
    check "README names $route" grep -qF "$route" "$tree/README.md"
done
for flag in $("$tree/build/draped" --help | grep -o -- '--[a-z][a-z-]*' | grep -v -x -e --usage | sort -u); do
    check "README names $flag" grep -qF -- "$flag" "$tree/README.md"
done
cd "$tree" || exit 1
finish
