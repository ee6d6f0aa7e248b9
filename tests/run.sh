#!/bin/bash
# Builds and runs the tests; the last line is the count `N passed, N failed` over all of them.
# usage: tests/run.sh [PART...]    parts: unit asan ubsan tsan fuzz api; none: all of them
# A build that fails is a failed test, so that the count always stands on the last line.
# Logs stay in build/check/. $MAKE is the make command to build with.
cd "$(dirname "$0")/.." || exit 1
MAKE=${MAKE:-make -j$(nproc)}
parts=("$@")
(( ${#parts[@]} )) || parts=(unit asan ubsan tsan fuzz api)
logs=build/check
rm -rf "$logs"
mkdir -p "$logs"

export CMOCKA_MESSAGE_OUTPUT=TAP
export ASAN_OPTIONS=detect_leaks=1:detect_stack_use_after_return=1
export UBSAN_OPTIONS=print_stacktrace=1
export TSAN_OPTIONS=halt_on_error=1:second_deadlock_stack=1:suppressions=$PWD/tests/tsan.supp

# build LABEL MAKE-ARGUMENT...: says nothing unless it fails.
build() {
    local label=$1
    shift
    if ! $MAKE "$@" >"$logs/build-$label.log" 2>&1; then
        echo "FAIL build of $label: make $*"
        grep -E '(error|warning): |\*\*\*|undefined reference' "$logs/build-$label.log" | head -n 40 | sed 's/^/     | /'
        echo "fail build of $label" >"$logs/build-$label.log.result"
        return 1
    fi
}

# programs FLAVOUR FOLDER...: the test programs that the sources in tests/FOLDER make.
programs() {
    local flavour=$1 source name
    shift
    for source in $(printf 'tests/%s/test_*.c ' "$@"); do
        [[ -e $source ]] || continue
        name=${source#tests/}
        name=${name%.c}
        printf '%s\0' "$flavour $name" "$logs/$flavour/$name.log" "build/$flavour/tests/$name"
    done
}

# Two programs at a time: on two processors that is what there is.
run_parallel() { xargs -0 -r -n 3 -P 2 tests/run_one.sh; }

unit() {
    build release all tests || return
    {
        programs release solver server client physics
        printf '%s\0' "release counts" "$logs/release/counts.log" tests/counts/counts.sh
    } | run_parallel
}

# The sanitizers see the units and the whole daemon under a short session of requests. The physics
# tests exercise no code that the unit tests do not, ten times slower, so they stay out.
sanitized() {
    local flavour=$1
    build "$flavour" FLAVOUR="$flavour" all unit-tests || return
    # libgomp is not built with ThreadSanitizer: its barriers would look like races.
    [[ $flavour == tsan ]] && export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
    programs "$flavour" solver server client | run_parallel
    DRAPED=build/$flavour/draped DRAPE=build/$flavour/drape \
        tests/run_one.sh "$flavour api/smoke" "$logs/$flavour/api/smoke.log" tests/api/smoke.sh
}

fuzz() {
    local source name
    # gcc is the compiler whose warnings count; clang has its own opinions.
    build fuzz FLAVOUR=fuzz CC=clang WERROR= fuzzers || return
    for source in tests/fuzz/fuzz_*.c; do
        [[ -e $source ]] || continue
        name=$(basename "$source" .c)
        printf '%s\0' "fuzz $name" "$logs/fuzz/$name.log" "$name"
    done | xargs -0 -r -n 3 -P 2 bash -c 'tests/run_one.sh "$0" "$1" tests/run_fuzz.sh "$2"'
}

# One at a time: some of these tests look at how long things take.
api() {
    local script name
    build release all api-tools || return
    for script in tests/api/*.sh; do
        name=$(basename "$script" .sh)
        [[ $name == lib ]] && continue
        tests/run_one.sh "api $name" "$logs/api/$name.log" "$script"
    done
}

for part in "${parts[@]}"; do
    echo "== $part"
    part_started=$SECONDS
    case $part in
    unit) unit ;;
    asan | ubsan | tsan) (sanitized "$part") ;;
    fuzz) fuzz ;;
    api) api ;;
    *) echo "unknown part: $part"; echo "fail part $part" >"$logs/$part.result" ;;
    esac
    echo "== $part took $((SECONDS - part_started)) s"
done

results=$(find "$logs" -name '*.result' -exec cat {} +)
passed=$(grep -c '^pass' <<<"$results")
failed=$(grep -c '^fail' <<<"$results")
skipped=$(grep -c '^skip' <<<"$results")
((skipped)) && { echo "$skipped skipped:"; grep '^skip' <<<"$results" | sed 's/^skip/  /'; }
((failed)) && { echo "failed:"; grep '^fail' <<<"$results" | sed 's/^fail/  /'; }
echo "$passed passed, $failed failed"
((failed == 0 && passed > 0))
