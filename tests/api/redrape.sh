#!/bin/bash
# start_from: a finished job draped again, with nothing changed, in another size, on another body, with other
# pins; what it refuses; that it needs the other job no more once it is posted. DRAPED_TEST_GARMENTS=no leaves
# out the garment on a body, which takes minutes where two processors are shared.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
crossings=build/release/tests/api/crossings
tight='| .solver.tolerance = 1e-5'

# redrape FROM FILTER: what was posted as $work/job with start_from and the filter, as $work/again; sets id.
redrape() {
    jq -c --arg from "$1" '.start_from = $from | '"$2" "$work/job" >"$work/again"
    submit "$work/again"
}
solved() { check "$1 is solved" wait_for "$id" succeeded 120; }
drape_of() { curl -s "$url/v1/jobs/$1/result?format=json"; }
# energy ID JOB: what is stored in cloth and contact, and its weight's from the origin: comparable between starts.
energy() {
    jq -n --slurpfile drape <(drape_of "$1") --slurpfile job "$2" \
        --slurpfile ended <(curl -s "$url/v1/jobs/$1") '
        $drape[0].positions as $x | $job[0].cloth as $cloth | $cloth.mesh.pattern as $p
        | $cloth.materials[0].density as $density
        | ([$cloth.mesh.triangles | _nwise(3) | . as [$a, $b, $c]
            | (($p[2*$b] - $p[2*$a]) * ($p[2*$c+1] - $p[2*$a+1]) - ($p[2*$c] - $p[2*$a]) * ($p[2*$b+1] - $p[2*$a+1]))
            | (if . < 0 then -. else . end) * ($x[3*$a+1] + $x[3*$b+1] + $x[3*$c+1]) / 6] | add) * $density * 9.81
        + ($ended[0].report.energies | .stretch + .bend + .contact)'
}
same() { # NAME A B: within 1e-3
    check "$1: $2 J and $3 J" awk -v a="$2" -v b="$3" 'BEGIN {exit !((a - b) ^ 2 <= 1e-6 * a * a)}'
}

# ---- a square ----------------------------------------------------------------------------------------

square 8 ". $tight" >"$work/job"
submit "$work/job"
solved 'the first'
first=$id rest=$(energy "$id" "$work/job")
redrape "$first" .
is 'draped again: accepted' "$code" 202
solved 'the same again'
json 'it rests at once' '.verdict == "at-rest" and .report.iterations == 1'
json 'and says that there was nothing to ramp' '.report.ramp == {steps: 0, iterations: 0, change: 0}
    and (.report.plan.left_out | any(.[]; .name == "ramp" and .reason == "the start is a drape of this pattern"))'
same 'the same energy' "$(energy "$id" "$work/again")" "$rest"
chained=$id
redrape "$chained" .
solved 'one that starts from one that started from another'
json 'it rests at once, too' '.report.iterations == 1'

"$DRAPE" run "$work/job" --from "$first" --url "$url" --quiet --json >"$work/run"
json 'drape run --from does the same' '.report.iterations == 1' "$work/run"
"$DRAPE" run "$work/run" --from "$first" --url "$url" --quiet 2>"$work/said"
is 'drape run --from of what is no job: refused by the server' $? 2
printf 'v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n' >"$work/triangle.obj"
"$DRAPE" scene --garment "$work/triangle.obj" --material cotton-poplin --from "$first" >"$work/scene"
json 'drape scene --from writes it' ".start_from == \"$first\"" "$work/scene"

for by in 1.05 1.4; do
    # Its pins, too, where the larger pattern has them: the clamped edge would buckle, this way or that.
    redrape "$first" ".cloth.mesh |= (.pattern |= map(. * $by) | .positions |= map(. * $by))"
    solved "the pattern x$by"
    json "x$by: at rest, the change is told" '.verdict == "at-rest"
        and ((.report.ramp.change - '"$by"' + 1) | . < 1e-9 and . > -1e-9)'
    json "x$by: ramped when far" '.report.ramp | if .change > 0.06 then .steps > 1 and .iterations > 0 else .steps == 1 end'
    warm=$(energy "$id" "$work/again")
    jq -c 'del(.start_from)' "$work/again" >"$work/scratch"
    submit "$work/scratch"
    solved "x$by from scratch"
    same "x$by: the same minimum as from scratch" "$warm" "$(energy "$id" "$work/scratch")"
done

redrape "$first" '.cloth.materials[0].bend |= map_values(. * 20)'
solved 'another fabric'
json 'another fabric: at rest' '.verdict == "at-rest"'
redrape "$first" '.cloth.mesh.positions[1] = 0.01 | .cloth.pins += [80]'
solved 'other pins'
drape_of "$id" >"$work/new"
drape_of "$first" >"$work/old"
check 'a pin that was moved is where it was moved to, a new one where the drape was, the rest where they were' \
    jq -en --slurpfile new "$work/new" --slurpfile old "$work/old" '($new[0].positions) as $n
        | ($old[0].positions) as $o | $n[1] == 0.01 and $n[240:243] == $o[240:243] and $n[3:6] == $o[3:6]'

# ---- refusals ----------------------------------------------------------------------------------------

redrape 0123 .
problem 'no id' 422 invalid /start_from
redrape 00000000000000000000000000000000 .
problem 'an unknown job' 404 not-found /start_from
redrape "$first" '.start_from = 7'
problem 'no string' 422 invalid /start_from
jq -c --arg from "$first" '.start_from = $from' <(square 7) >"$work/again"
submit "$work/again"
problem 'another number of vertices' 422 invalid /start_from
square 8 '.solver.max_iterations = 0' >"$work/start"
submit "$work/start"
solved 'the start alone'
redrape "$id" .
problem 'a job without a drape' 409 no-result /start_from
endless >"$work/endless"
submit "$work/endless"
busy=$id
check 'it runs' wait_for "$busy" running
redrape "$busy" .
problem 'a job that runs' 409 not-ready /start_from

# ---- the other job may go ----------------------------------------------------------------------------

jq -c --arg from "$first" '.start_from = $from' "$work/job" >"$work/again"
submit "$work/again"
waiting=$id
submit "$work/again"
unwanted=$id
request DELETE "/v1/jobs/$first"
is 'the first is removed while others wait to start from it' "$code" 204
redrape "$first" .
problem 'a removed job' 410 gone /start_from
request DELETE "/v1/jobs/$unwanted"
is 'one that waits is cancelled' "$code" 202
is 'it keeps no start' "$(find "$data/jobs" -name "$unwanted.[fs]*" | wc -l)" 0
is 'the other does' "$(find "$data/jobs" -name "$waiting.[fs]*" | wc -l)" 2
kill_daemon
start_daemon --workers 1
request DELETE "/v1/jobs/$busy"
id=$waiting
solved 'after the daemon was killed, the one that waited'
json 'from the drape of the removed job' '.verdict == "at-rest" and .report.iterations == 1'
is 'a start is kept no longer than its job needs it' "$(find "$data/jobs" -name '*.from' -o -name '*.start' | wc -l)" 0

# ---- a garment on a body -----------------------------------------------------------------------------

[[ ${DRAPED_TEST_GARMENTS-} == no ]] && { stop_daemon; finish; exit; }

# on_body NAME FILE: the ended job $id of $work/again has no crossing with its body.
on_body() {
    request GET "/v1/jobs/$id/result?format=obj"
    cp "$body" "$work/drape.obj"
    # Not _nwise, whose time grows with the square of the length.
    jq -r '.bodies[0].mesh | (.positions as $x | range(0; $x | length; 3) | "v \($x[.]) \($x[. + 1]) \($x[. + 2])"),
        (.triangles as $t | range(0; $t | length; 3) | "f \($t[.] + 1) \($t[. + 1] + 1) \($t[. + 2] + 1)")' \
        "$2" >"$work/body.obj"
    "$crossings" "$work/drape.obj" "$work/body.obj" >"$work/crossings"
    check "$1: it is looked at" test -s "$work/crossings"
    json "$1: no crossing with the body" '.cloth_body.crossings == 0' "$work/crossings"
}
"$DRAPE" example garment | jq -c '.bodies[0].friction = 0.3' >"$work/job"
submit "$work/job"
solved 'a garment'
first=$id
json 'it was sewn' '.report.sewing.iterations > 0'
redrape "$first" .
solved 'the same garment'
json 'nothing changed: at rest in 3 iterations or fewer, nothing to sew' '.verdict == "at-rest"
    and .report.iterations <= 3 and .report.sewing.iterations == 0
    and (.report.plan.left_out | any(.[]; .name == "sewing" and .reason == "the seams start closed"))'
# at_most_half NAME FILTER: from the drape and from scratch; sewing counts where there is any.
at_most_half() {
    local warm
    redrape "$first" "$2"
    solved "$1"
    json "$1: at rest" '.verdict == "at-rest"'
    warm=$(jq '.report | .iterations + .sewing.iterations + .ramp.iterations' "$body")
    on_body "$1" "$work/again"
    jq -c 'del(.start_from)' "$work/again" >"$work/scratch"
    submit "$work/scratch"
    solved "$1 from scratch"
    json "$1: in $warm iterations, at most half of what it takes from scratch" \
        '.report | '"$warm"' <= (.iterations + .sewing.iterations) / 2'
}
at_most_half 'a larger size' '.cloth.mesh.pattern |= map(. * 1.05)'
at_most_half 'a larger body' '.bodies[0].mesh.positions |= [range(length) as $i | .[$i] * (if $i % 3 == 1 then 1 else 1.03 end)]'
stop_daemon
finish
