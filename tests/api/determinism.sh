#!/bin/bash
# The same job gives the same bytes: alone on one worker, beside others on two, and alone on two, where it borrows the
# processor that nobody uses.
. "$(dirname "$0")/lib.sh"
square 16 '.bodies = [{sphere: {center: [0.1, -0.08, 0.1], radius: 0.05}, offset: 0.003}] | del(.cloth.pins)' >"$work/job"
square 12 '.solver.stop_on = "potential"' >"$work/other"
# Seconds are the one column that differs from run to run.
without_seconds() { cut -d, -f1,3- "$1"; }

# drape_copies NAME WORKERS COPIES
drape_copies() {
    local name=$1 workers=$2 copies=$3 ids=() i
    data=$work/data-$name
    start_daemon --workers "$workers"
    for ((i = 0; i < copies; i++)); do
        submit "$work/job"; ids+=("$id")
        ((copies > 1)) && submit "$work/other"
    done
    for ((i = 0; i < copies; i++)); do
        wait_for "${ids[i]}" succeeded 120
        for format in json obj ply glb; do
            curl -s "$url/v1/jobs/${ids[i]}/result?format=$format" >"$work/$name-$i.$format"
        done
        curl -s "$url/v1/jobs/${ids[i]}/trace?format=csv" >"$work/$name-$i.csv"
        curl -s "$url/v1/jobs/${ids[i]}" >"$work/$name-$i.job"
    done
    stop_daemon
}
drape_copies alone 1 1
drape_copies busy 2 4
json 'the reference is a drape' '(.positions | length) == 867 and .verdict != null' "$work/alone-0.json"
for ((i = 0; i < 4; i++)); do
    for format in json obj ply glb; do
        check "copy $i of four on two workers: the same $format" cmp "$work/alone-0.$format" "$work/busy-$i.$format"
    done
    is "copy $i: the same trace" "$(without_seconds "$work/busy-$i.csv" | sha256sum)" \
        "$(without_seconds "$work/alone-0.csv" | sha256sum)"
done

# Large enough for halves of everything to be worth sharing: factorisations, products, distances, searches of cloth near cloth.
"$DRAPE" example square --triangles 10000 | jq -c '.solver = {max_iterations: 6} | .self_contact = "on"
    | .bodies = [{sphere: {center: [0.25, 0.898, -0.25], radius: 0.1}, offset: 0.003}]' >"$work/job"
drape_copies one 1 1
drape_copies two 2 1
json 'it touches the body, and looks for itself' '.report.energies.contact > 0 and .report.stages["broad-phase"] > 0' "$work/one-0.job"
check 'with a borrowed processor: the same glb' cmp "$work/one-0.glb" "$work/two-0.glb"
is 'and the same trace' "$(without_seconds "$work/two-0.csv" | sha256sum)" "$(without_seconds "$work/one-0.csv" | sha256sum)"
json 'one worker has nothing to lend' '.report.borrowed_seconds == 0' "$work/one-0.job"
json 'two have' '.report.borrowed_seconds > 0' "$work/two-0.job"
finish
