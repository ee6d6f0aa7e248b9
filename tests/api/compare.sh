#!/bin/bash
# drape compare against the real daemon: reports of several methods, a refused one among them.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
export DRAPED_URL=$url

# compare NAME STATUS ARGUMENT...: the exit status; output in $work/out and $work/err.
compare() {
    local name=$1 want=$2 got
    shift 2
    "$DRAPE" compare "$@" >"$work/out" 2>"$work/err" </dev/null
    got=$?
    if [[ $got == "$want" ]]; then ok "$name"; else
        not_ok "$name" "status $got, wanted $want" "$(tail -c 400 "$work/out")" "$(tail -c 600 "$work/err")"
    fi
}

square 6 >"$work/job"
compare 'methods that come to rest' 0 "$work/job" --methods auto,stop-and-go -m stop-and-go:stop_on=kinetic,time_step=0.01 \
    -o "$work/report.html" --csv "$work/rows.csv" --json
json 'all did' '.methods | length == 3 and all(.outcome == "at-rest")' "$work/out"
json 'E* is the lowest of them' '.best_energy == ([.methods[].energy] | min) and .best_energy < .start_energy' "$work/out"
json 'a certified one, as all are' '.certified and (.methods | all(.certified))' "$work/out"
json 'one minimum' '.minima_differ == false and .starts_differ == false' "$work/out"
json 'each came within a thousandth before it came to rest' \
    '.methods | all(."to_1e-03".iterations > 0 and ."to_1e-03".iterations <= .to_rest.iterations)' "$work/out"
json 'and tells what it took of factorisations' '.methods | all(."to_1e-03".factorizations > 0
    and ."to_1e-03".factorizations <= .to_rest.factorizations and .to_rest.factorizations == .factorizations)' "$work/out"
json 'the members went into the job' '[.methods[].iterations] | unique | length > 1' "$work/out"
is 'a picture of convergence and one for each method' "$(grep -o '<svg' "$work/report.html" | wc -l)" 4
check 'the page is whole' grep -q '</html>' "$work/report.html"
check 'and needs no script' bash -c '! grep -qi "<script\|src=\|href=" "$0"' "$work/report.html"
rows=$(jq '[.methods[].iterations + 1] | add' "$work/out")
is 'the CSV has every row' "$(($(wc -l <"$work/rows.csv") - 1))" "$rows"
like 'it quotes what has commas' "$(<"$work/rows.csv")" '"stop-and-go:stop_on=kinetic,time_step=0.01",0,'
like 'a live line for each' "$(<"$work/err")" 'method 3 of 3: stop-and-go:stop_on=kinetic'

compare 'a refused method does not stop the others' 2 "$work/job" --methods auto,prayer -m auto:cloths=1 -o "$work/report.html"
like 'its reason is told' "$(<"$work/out")" '/solver/cloths'
check 'on the page as well' grep -q '/solver/cloths' "$work/report.html"
like 'the other is there' "$(<"$work/out")" 'auto +at-rest'

compare 'a method that wants no certificate' 0 "$work/job" -m auto:certify=false -m stop-and-go --json
json 'gets none' '[.methods[].certified] == [false, true]' "$work/out"
jq -c '.solver.certify = false' "$work/job" >"$work/short"
compare 'nor does a job' 0 "$work/short" --methods auto --json
json 'that says so' '[.methods[].certified] == [false]' "$work/out"
jq -c '.solver.max_iterations = 3' "$work/job" >"$work/short"
compare 'not at rest' 5 "$work/short" --methods auto
jq -c '.solver.max_iterations = 0' "$work/job" >"$work/short"
compare 'the start alone' 5 "$work/short" --methods auto -o "$work/report.html"
like 'has no distance' "$(<"$work/out")" 'no distance to measure'
check 'and still a page' grep -q 'no distance to draw' "$work/report.html"
compare 'a page that cannot be written' 6 "$work/job" --methods auto -o "$work/no/report.html"
echo 'no job' >"$work/bad"
compare 'a file that is no job' 1 "$work/bad" --methods auto
stop_daemon
compare 'no server' 3 "$work/job" --methods auto
finish
