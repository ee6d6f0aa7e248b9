#!/bin/bash
# What a scene does not need costs nothing, and the trace next to nothing: counted, not timed.
# tests/counts/driver.c drapes one square. It is linked to the whole library, and for each of four scenes to a
# library in which all that the scene does not need is replaced by stubs that abort (LEAN_ in the Makefile):
# both must execute as many instructions, and ask for as many bytes, to the last one.
# usage: tests/counts/counts.sh [FOLDER OF THE PROGRAMS]
programs=$(realpath "${1-build/release/tests/counts}")
. "$(dirname "$0")/../api/lib.sh"
counts=$PWD/tests/counts

# run NAME PROGRAM ARGUMENT...: leaves in $work/NAME what the program said (said), the instructions in drape_it
# by function (functions), and callgrind's profile. Paths of equal length, equal arguments and environments, and
# nothing bound on first use: else the stack's alignment and the linker's searches would count, too.
run() {
    local folder
    folder=$(mktemp -d "$work/XXXXXX") && ln -s "$folder" "$work/$1" || return
    cp "$programs/$2" "$folder/driver" && cd "$folder" || return
    env -i PATH="$PATH" LD_BIND_NOW=1 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 \
        valgrind -q --tool=callgrind --toggle-collect=drape_it --callgrind-out-file=profile \
        --compress-strings=no --compress-pos=no ./driver "${@:3}" >said 2>log
    echo $? >status
    LC_ALL=C awk -f "$counts/functions.awk" profile | sort -k2 >functions
}
value() { awk -v name="$2" '$1 == name {print $2}' "$work/$1/said"; }
bytes_of() { awk -v name="$2" '$2 == name {print $3}' "$work/$1/said"; }
instructions() { awk '{n += $1} END {print n + 0}' "$work/$1/functions"; }

# ran NAME: the run ended well, and did something to count.
ran() {
    [[ $(cat "$work/$1/status") == 0 && $(instructions "$1") -gt 1000000 ]] && return
    tail -n 5 "$work/$1/log"
    return 1
}

# same NAME NAME: as many instructions, allocations and allocated bytes.
same() {
    ran "$1" && ran "$2" || return
    [[ $(instructions "$1") == "$(instructions "$2")" && $(value "$1" allocations) == "$(value "$2" allocations)" &&
        $(value "$1" allocated) == "$(value "$2" allocated)" ]] && return
    diff "$work/$1/said" "$work/$2/said"
    diff "$work/$1/functions" "$work/$2/functions"
    return 1
}
# more NAME THAN: more of both.
more() {
    ran "$1" && ran "$2" || return
    (($(instructions "$1") > $(instructions "$2") && $(value "$1" allocated) > $(value "$2" allocated)))
}
# calls NAME PATTERN: a function that matches was executed; to free nothing does not count.
calls() { grep -E " $2" "$work/$1/functions" | grep -v '_free$'; }
calls_none() { ran "$1" && ! calls "$@"; }

# 392 triangles; two at a time.
while read -r name program arguments; do
    run "$name" "$program" $arguments 2>/dev/null &
    while (($(jobs -rp | wc -l) >= 2)); do wait -n; done
done <<'LIST'
steps      whole  plain backward-euler 14 5
steps-lean steps  plain backward-euler 14 5
auto       whole  plain auto 14 5
auto-lean  auto   plain auto 14 5
rk4        whole  plain rk4 14 5
rk4-lean   rk4    plain rk4 14 5
limp       whole  limp backward-euler 14 5
limp-lean  limp   limp backward-euler 14 5
sphere     whole  sphere rk4 14 5
curve      whole  curve rk4 14 5
at-once    whole  plain at-once 14 1
certify    whole  plain certify 14 1
fit        whole  plain fit 14 1
damned     rk4    sphere rk4 14 5
large      whole  plain rk4 50 3
LIST
wait

for name in steps auto rk4 limp; do
    check "$name: what the scene does not need costs no instruction and no byte" same "$name" "$name-lean"
    echo "# $name: $(instructions "$name") instructions, $(value "$name" allocations) allocations," \
        "$(value "$name" allocated) bytes"
done
check 'the stubs bite: a sphere in the scene ends the lean program' test "$(cat "$work/damned/status")" -gt 128
check 'a sphere far away costs instructions and bytes' more sphere rk4
check 'a sphere far away runs the contact code' calls sphere dr_contact_energy
check 'a curve costs instructions and bytes' more curve rk4
check 'a curve runs the code of curves' calls curve dr_curve_at
check 'without either, neither runs' calls_none steps '(dr_(contact|body|field|winding|curve|lines|elastic|fold|hinge|tacks?)_|curved_)'
check 'a certificate costs instructions and bytes' more certify at-once
check 'a certificate runs its code' calls certify dr_certify
check 'without one, none of it runs' calls_none at-once 'dr_(certify|matrix_lower_by_round_off)'
is 'a certificate not asked for: no byte' "$(bytes_of at-once certificate)" 0
check 'the measures of the fit cost instructions and bytes' more fit at-once
check 'the measures of the fit run their code' calls fit dr_fit_measure
check 'without them, none of it runs' calls_none at-once 'dr_(fit_|stretch_strain)'
is 'a fit not asked for: no byte' "$(bytes_of at-once fit)" 0
# libraries NAME: which of the numerical libraries it entered.
libraries() { sed -nE 's/^c?ob=.*\/lib(cholmod|amd|openblas)[^/]*$/\1/p' "$work/$1/profile" | sort -u | paste -sd ' '; }
check 'implicit steps factorise' calls steps dr_matrix_factorise
is 'implicit steps enter CHOLMOD, its ordering and the BLAS' "$(libraries steps)" 'amd cholmod openblas'
check 'explicit steps have no matrix' calls_none rk4 '(dr_matrix_|dr_state_(factorise|solve))'
is 'explicit steps enter none of them' "$(libraries rk4)" ''
is 'explicit steps: no byte for a Jacobian' "$(bytes_of rk4 jacobian) $(bytes_of rk4 geometric-stiffness)" '0 0'
check 'bending runs the code of bending' calls steps dr_bend_stiffness_new
check 'cloth without bending runs none of it' calls_none limp dr_bend_
is 'cloth without bending: no byte for it' "$(bytes_of limp bend)" 0

# peak_bytes NAME: what the report accounts for is what malloc held, to 2 %.
peak_bytes() {
    local held peak
    held=$(value "$1" held) peak=$(value "$1" peak)
    echo "malloc held $held bytes, the report says $peak"
    ((50 * (held > peak ? held - peak : peak - held) < held))
}
for name in steps auto rk4 limp sphere curve fit; do
    check "$name: peak_bytes is what malloc held" peak_bytes "$name"
done

# trace_cost NAME: how often relax.c's record() was called, and its instructions with those that it called.
trace_cost() {
    awk '/^cfn=/   { callee = substr($0, 5) }
         /^calls=/ { n = substr($1, 7); getline; if (callee == "record") { calls += n; cost += $2 } }
         END       { print calls + 0, cost + 0 }' "$work/$1/profile"
}
# cheap_trace NAME ROWS: so many rows were recorded, for less than 1 % of all instructions.
cheap_trace() {
    local rows cost
    read -r rows cost < <(trace_cost "$1")
    echo "$rows rows, $cost of $(instructions "$1") instructions"
    ((rows == $2 && cost > 0 && 100 * cost < $(instructions "$1")))
}
# An iteration of rk4 is the cheapest there is, so that the share is the largest.
check 'the trace costs less than 1 %: 5 000 triangles, rk4' cheap_trace large 4
check 'the trace costs less than 1 %: 392 triangles, backward Euler' cheap_trace steps 6
check 'the trace costs less than 1 %: 392 triangles, auto' cheap_trace auto 6
for name in large steps auto; do
    read -r rows cost < <(trace_cost "$name")
    echo "# $name: $rows rows take $cost of $(instructions "$name") instructions"
done
finish
