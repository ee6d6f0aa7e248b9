#!/bin/bash
# Runs one test program (cmocka's or a script's TAP) and writes what became of each of its tests.
# usage: tests/run_one.sh LABEL LOG COMMAND [ARG...]
# Appends to LOG all that the program said, to LOG.result lines `pass|fail|skip LABEL: NAME`,
# and prints one summary line, followed by the log when something failed.
# A program that crashes, times out, runs too few tests or none counts as one failed test more.
label=$1 log=$2
shift 2
mkdir -p "$(dirname "$log")"
started=$EPOCHREALTIME
timeout -k 10 "${TEST_TIMEOUT:-600}" "$@" >"$log" 2>&1 </dev/null
status=$?
seconds=$(awk -v a="$started" -v b="$EPOCHREALTIME" 'BEGIN {printf "%.1f", b - a}')

# cmocka prints a plan per group, numbers each group from 1, and calls a skipped test `not ok`.
awk -v label="$label" -v status="$status" '
    function note(what, name) { print what " " label ": " name; count[what]++ }
    /^1\.\.[0-9]+/      { planned += substr($1, 4); has_plan = 1; if ($0 ~ /# *[Ss][Kk][Ii][Pp]/) note("skip", $0) }
    /^(not )?ok( |$)/   {
        seen++
        name = $0
        sub(/^(not )?ok *[0-9]* *(- *)?/, "", name)
        if (name ~ /^# *[Ss][Kk][Ii][Pp]|[^\\]# *[Ss][Kk][Ii][Pp]/) note("skip", name)
        else note($1 == "ok" ? "pass" : "fail", name)
    }
    END {
        if (status == 124 || status == 137) note("fail", "timed out")
        else if (status > 128) note("fail", "ended by signal " status - 128)
        else if (status && !count["fail"]) note("fail", "exit status " status)
        if (!seen && !has_plan) note("fail", "ran no test")
        else if (!has_plan) note("fail", "no plan: the program stopped early")
        else if (seen != planned && status <= 128) note("fail", "planned " planned " tests, ran " seen + 0)
    }' "$log" >"$log.result"

passed=$(grep -c '^pass' "$log.result")
failed=$(grep -c '^fail' "$log.result")
skipped=$(grep -c '^skip' "$log.result")
printf '%-4s %-44s %4d passed%s%s %7s s\n' "$( ((failed)) && echo FAIL || echo ok)" "$label" "$passed" \
    "$( ((failed)) && echo ", $failed failed")" "$( ((skipped)) && echo ", $skipped skipped")" "$seconds"
grep '^skip' "$log.result" | sed 's/^skip/     SKIP/'
if ((failed)); then
    grep '^fail' "$log.result" | sed 's/^fail/     FAILED/'
    grep -v '^ok ' "$log" | sed 's/^/     | /' | tail -n 80
fi
exit 0
