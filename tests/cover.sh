#!/bin/bash
# Line and branch coverage of each file of some folders by gcov, and their sum, after tests have run.
# usage: tests/cover.sh FOLDER...       $MAKE is the make command to build with
# For server/ API scripts drive the instrumented daemon as well, and the branches that nothing took are listed
# for what should have none: the queue, the states of jobs, idempotency.
# Logs stay in build/cover/logs/. Fails when a test does. Some ten minutes for server/.
cd "$(dirname "$0")/.." || exit 1
MAKE=${MAKE:-make -j$(nproc)}
whole='queue job line idempotency'
api=(routes refusals limits events keys idempotency retention uploads negotiate cors encoding config log metrics page
    wait_cancel framing service smoke lines fit redrape)
logs=build/cover/logs
flush=$PWD/build/release/tests/preload/flush.so flushed=$PWD/build/cover/flushed
export CMOCKA_MESSAGE_OUTPUT=TAP DRAPED_TEST_GARMENTS=no
$MAKE FLAVOUR=cover all tests >/dev/null || exit 1
find build/cover -name '*.gcda' -delete
rm -rf "$logs"

run() { tests/run_one.sh "$1" "$logs/$1.log" "${@:2}"; } # NAME COMMAND...
for folder in "$@"; do
    [[ $folder == solver ]] && more='tests/physics/test_*.c' || more=
    for source in tests/"$folder"/test_*.c $more; do
        name=${source#tests/}
        run "${name%.c}" "build/cover/tests/${name%.c}"
    done
    [[ $folder == server ]] || continue
    # What the scripts measure with and put below the daemon.
    tools=$(printf 'build/release/%s\n' tests/api/*.c tests/preload/*.c | sed '/preload/s/\.c$/.so/; s/\.c$//')
    $MAKE $tools >/dev/null || exit 1
    for name in "${api[@]}"; do
        FLUSHED=$flushed LD_PRELOAD=$flush DRAPED=build/cover/draped DRAPE=build/cover/drape \
            run "api/$name" tests/api/"$name".sh
    done
done

# counts FOLDER...: what gcov has of each file, as JSON; of those, too, that no test has run.
counts() {
    (cd build/cover && find "${@/#/obj/}" -name '*.gcno' -print0 |
        xargs -0 gcov --branch-probabilities --json-format --stdout 2>/dev/null)
}
echo
counts "$@" | jq -r '.files[] | select(.file | test("^[a-z]+/[^/]*\\.c$")) | .file as $file
    | [.lines[].branches[].count] as $branch
    | [$file, (.lines | length), ([.lines[] | select(.count > 0)] | length),
       ($branch | length), ($branch | map(select(. > 0)) | length)]
    | @tsv' | sort | awk -F '\t' '
    function show(name, lines, run, branches, taken) {
        printf "%-24s %6.1f %% of %5d lines %7.1f %% of %5d branches\n", name, lines ? 100 * run / lines : 100, lines,
            branches ? 100 * taken / branches : 100, branches
    }
    {show($1, $2, $3, $4, $5); lines += $2; run += $3; branches += $4; taken += $5}
    END {show("all", lines, run, branches, taken)}'

if [[ " $* " == *' server '* ]]; then
    echo
    echo "branches never taken in $whole:"
    counts $(printf 'server/%s.gcno ' $whole) | jq -r '.files[] | select(.file | test("^server/.*\\.c$")) | .file as $file
        | .lines[] | ([.branches[] | select(.count == 0)] | length) as $missed | select($missed > 0)
        | [$file, .line_number, "\($missed) of \(.branches | length)"] | @tsv' |
        while IFS=$'\t' read -r file line missed; do
            printf '%s:%s: %s: %s\n' "$file" "$line" "$missed" "$(sed -n "${line}s/^ *//p" "$file")"
        done
fi
results=$(find "$logs" -name '*.result' -exec cat {} +)
failed=$(grep -c '^fail' <<<"$results")
echo
((failed)) && { echo "failed:"; grep '^fail' <<<"$results" | sed 's/^fail/  /'; }
echo "$(grep -c '^pass' <<<"$results") passed, $failed failed, in $SECONDS s"
((failed == 0))
