#!/bin/bash
# Runs what tries to break the daemon and prints what came of it, one row for each; the rows of the README's table.
# usage: tests/break.sh short|long [NAME...]     short: as make check does; long: the sizes meant for a night
# Each row is the last summary that the test printed (a line that begins with "#"); a test that failed says so.
cd "$(dirname "$0")/.." || exit 1
form=${1-short}
shift
logs=build/break
mkdir -p "$logs"
pick() { [[ $form == long ]] && echo "$2" || echo "$1"; }
failed=0

# row NAME PATTERN VARIABLE=VALUE... -- COMMAND...
row() {
    local name=$1 pattern=$2 settings=() said
    shift 2
    ((${#wanted[@]})) && [[ " ${wanted[*]} " != *" $name "* ]] && return
    while [[ $1 != -- ]]; do settings+=("$1"); shift; done
    shift
    env "${settings[@]}" "$@" >"$logs/$name.log" 2>&1
    local status=$?
    said=$(grep -E "$pattern" "$logs/$name.log" | tail -n 1 | sed 's/^# *//')
    if grep -q '^not ok' "$logs/$name.log" || ((status)); then
        failed=1
        said="FAILED: $(grep -m 1 '^not ok' "$logs/$name.log" || echo "status $status") (see $logs/$name.log). $said"
    fi
    printf '| %s | %s |\n' "$name" "$said" | tee -a "build/break-$form.md"
}
wanted=("$@")
: >"build/break-$form.md"
row kill '^# [0-9]+ kills' DRAPED_TEST_KILLS="$(pick 200 10000)" -- tests/api/crash.sh
row faults '^# [0-9]+ faults' DRAPED_TEST_FAULTS="$(pick 12 all)" -- tests/api/faults.sh
row adversity '^# [0-9]+ rounds' DRAPED_TEST_ROUNDS="$(pick 1 25)" -- tests/api/adversity.sh
row framing '^# [0-9]+ refused' -- tests/api/framing.sh
row slow '^# [0-9]+ of each kind' DRAPED_TEST_SLOW="$(pick 200 1000)" DRAPED_TEST_TIMES="$(pick '' 1)" -- tests/api/slow.sh
row streams '^# [0-9]+ streams' STREAMS="$(pick 100 500)" JOBS="$(pick 60 1500)" SECONDS_AT_MOST="$(pick 200 3600)" -- tests/api/streams.sh
row idempotency '^# [0-9]+ keys' DRAPED_TEST_RACES="$(pick 10 200)" DRAPED_TEST_RACE_KILLS="$(pick 3 20)" -- tests/api/idempotency.sh
row restarts '^# [0-9]+ restarts' DRAPED_TEST_RESTARTS="$(pick 5 100)" -- tests/api/service.sh
for fuzzer in tests/fuzz/fuzz_*.c; do
    name=$(basename "$fuzzer" .c)
    row "$name" '^Done [0-9]+ runs' FUZZ_RUNS="$(pick 100000 10000000)" -- tests/run_fuzz.sh "$name"
done
exit "$failed"
