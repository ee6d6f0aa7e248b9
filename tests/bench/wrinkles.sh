#!/bin/bash
# `make bench-wrinkles`: the wrinkle test of [VMT07] through the API. A skirt of 19 250 triangles, draped with a bending
# of 1e-3 N m, is let go at 1e-5 N m under every method; counted is how long each takes until its energy stays at or
# below what stop-and-go (potential rule) has after 100 iterations. Leaves build/bench-wrinkles.html, .csv and .json,
# the table in build/bench-wrinkles.md, and the same in README.md.
. "$(dirname "$0")/lib.sh"
out=build
table=build/bench-wrinkles.md
mark=100         # iterations of stop-and-go
most=500         # of a run
newton_limit=300 # s; an iteration of newton, an LDL' of the true Hessian, takes as long as ten to twenty others
members='{"tolerance": 1e-4, "max_iterations": '$most', "time_limit_s": 3600, "time_step": 0.02}'
measure=stop-and-go:stop_on=potential
ways=(auto "$measure" stop-and-go:stop_on=kinetic "$measure,integrator=bdf2"
    dynamic dynamic:integrator=bdf2 quasi-static
    "newton:time_limit_s=$newton_limit" "newton:line_search=true,time_limit_s=$newton_limit")

start_daemon
build/drape example skirt --triangles 19200 >"$work/skirt"
settle "$work/skirt" "$work/positions" 1e-3
jq -c --slurpfile x "$work/positions" '.cloth.mesh.positions = $x[0]' "$work/skirt" >"$work/job"
compare bench-wrinkles "$work/job" "$members" "${ways[@]}"

for method in "${ways[@]}"; do get_trace bench-wrinkles "$method"; done |
    jq -rs -f tests/bench/wrinkles.jq --argjson figures "$(<"$out/bench-wrinkles.json")" --arg measure "$measure" \
        --argjson mark "$mark" >"$work/table"
{
    echo '# The wrinkle test'
    echo
    cat "$work/table"
} >"$table"
put_in_readme bench-wrinkles <"$work/table"
cat "$table"
say "see $table and $out/bench-wrinkles.html"
