#!/bin/bash
# Line and branch coverage of each file of some folders by gcov, and their sum, after tests have run.
# usage: tests/cover.sh FOLDER...       $MAKE is the make command to build with
# For server/ the API scripts that need no garments drive the instrumented daemon as well.
cd "$(dirname "$0")/.." || exit 1
MAKE=${MAKE:-make -j$(nproc)}
api=(routes refusals limits events keys idempotency retention uploads negotiate cors encoding config log metrics page
    wait_cancel framing service smoke lines fit redrape)
logs=build/cover/logs
$MAKE FLAVOUR=cover all tests >/dev/null || exit 1
find build/cover -name '*.gcda' -delete
mkdir -p "$logs"
failed=0
run() { # run NAME COMMAND...
    local name=$1
    shift
    "$@" >"$logs/$name.log" 2>&1 || { echo "FAIL $name (see $logs/$name.log)"; failed=1; }
    grep -q '^not ok' "$logs/$name.log" && { echo "FAIL $name (see $logs/$name.log)"; failed=1; }
}
for folder in "$@"; do
    [[ $folder == solver ]] && more='tests/physics/test_*.c' || more=
    for source in tests/"$folder"/test_*.c $more; do
        name=${source#tests/}
        run "$(basename "${name%.c}")" "build/cover/tests/${name%.c}"
    done
    [[ $folder == server ]] || continue
    $MAKE tests >/dev/null # the tools that the scripts measure with
    for name in "${api[@]}"; do
        DRAPED=build/cover/draped DRAPE=build/drape run "api-$name" tests/api/"$name".sh
    done
done
pattern=$(IFS='|'; echo "$*")
(cd build/cover && gcov -n -b $(find . -path '*/obj/s*' -name '*.gcda' -o -path '*/obj/client/*' -name '*.gcda') 2>/dev/null) |
    awk -v pattern="^($pattern)/" '
        /^File/ {split($0, part, "\047"); file = part[2]; keep = file ~ pattern && file ~ /\.c$/; next}
        !keep {next}
        /^Lines executed/ {split($0, n, /[:% ]+/); line[file] = n[3]; lines[file] = n[5]}
        /^Taken at least once/ {split($0, n, /[:% ]+/); branch[file] = n[5]; branches[file] = n[7]}
        END {
            for (f in lines) {
                printf "%-28s %6.1f %% of %5d lines  %6.1f %% of %5d branches\n", f, line[f], lines[f], branch[f], branches[f]
                a += line[f] * lines[f] / 100; b += lines[f]; c += branch[f] * branches[f] / 100; d += branches[f]
            }
            printf "%-28s %6.1f %% of %5d lines  %6.1f %% of %5d branches\n", "~ all", 100 * a / b, b, 100 * c / d, d
        }' | sort
exit "$failed"
