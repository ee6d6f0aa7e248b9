#!/bin/bash
# The short form of one fuzzer, as one TAP test: its corpus, then FUZZ_RUNS inputs from a fixed seed.
# usage: tests/run_fuzz.sh fuzz_NAME
name=$1
found=build/fuzz/found
mkdir -p "$found"
echo 1..1
corpus=()
[[ -d tests/fuzz/corpus/$name ]] && corpus=("tests/fuzz/corpus/$name")
empty=$(mktemp -d)
trap 'rm -rf "$empty"' EXIT
# New inputs go to the empty folder: the corpus in the tree stays as it is.
if "build/fuzz/tests/fuzz/$name" -runs="${FUZZ_RUNS:-100000}" -seed=1 -timeout=10 -rss_limit_mb=2048 \
    -print_final_stats=1 -artifact_prefix="$found/" "$empty" "${corpus[@]}"; then
    echo "ok 1 - $name"
else
    echo "not ok 1 - $name (the input is in $found/)"
fi
