#!/bin/bash
# `make bench-methods`: the 22 scenes of tests/bench/scene.jq and the square of [VMT07] under several methods,
# through the API. Leaves a page, rows and figures of each scene in build/bench-methods/, the table in
# build/bench-methods.md, and the sums in README.md. SCENES='square*' runs those alone and leaves README.md.
. "$(dirname "$0")/lib.sh"
out=build/bench-methods
table=build/bench-methods.md
scenes=${SCENES:-*}
most=300 # iterations of a run, and what a level that is never reached counts in the sums
members='{"tolerance": 1e-6, "max_iterations": '$most', "time_limit_s": 1200, "time_step": 0.02}'
ways=(auto stop-and-go:stop_on=kinetic stop-and-go:stop_on=potential velocity-correction dynamic quasi-static
    newton:line_search=true newton)
head='| auto | stop-and-go, kinetic | stop-and-go, potential | velocity-correction | dynamic | quasi-static '
head+='| newton, line search | newton |'
ruler="|$(printf ' --- |%.0s' auto "${ways[@]}")"

mkdir -p "$out"
start_daemon

# ---- 22 scenes -------------------------------------------------------------------------------------

# run_scene SHAPE N_PER_M N_M: a skirt starts from its drape at a bending of 1e-3 N m.
run_scene() {
    local name=$1-$2-$3
    # shellcheck disable=SC2053 # a pattern is meant
    [[ $name == $scenes ]] || return 0
    jq -cn -f tests/bench/scene.jq --arg name "$name" --arg shape "$1" --argjson stretch "$2" --argjson bend "$3" \
        >"$work/job"
    if [[ $1 == skirt ]]; then
        settle "$work/job" "$work/positions" 1e-3
        jq -c --slurpfile x "$work/positions" '.cloth.mesh.positions = $x[0]' "$work/job" >"$work/draped"
        mv "$work/draped" "$work/job"
    fi
    compare "$name" "$work/job" "$members" "${ways[@]}"
    figures+=("$out/$name.json")
}

# What each run took, a/b/c. A run that does not rest is measured from the lowest energy reached, be it its own: that
# flatters it, but only down to the comparison's floor.
# shellcheck disable=SC2016 # the variables are jq's
costs='
def costs: .distance_floor as $floor | .methods[] | [1e-3, 1e-6, 1e-9] as $level
    | if .outcome == "at-rest" then [.["own_1e-03", "own_1e-06", "own_1e-09"].factorizations]
      else [.["to_1e-03", "to_1e-06", "to_1e-09"].factorizations]
          | [range(3) as $i | if $level[$i] < $floor then null else .[$i] end] end;
def power: (log10 | floor) as $e | "\(. / pow(10; $e) | round)e\($e)";
def place: if .outcome == "at-rest" and .other_minimum then " +\(.distance | power)" else "" end;'

print_scenes() {
    echo "| scene, N/m, N m $head"
    echo "$ruler"
    jq -r "$costs"' [[costs | map(. // "-") | join("/")], [.methods[] | place]] | transpose | map(add)
        | "| \(input_filename | split("/")[-1] | rtrimstr(".json") | split("-")
               | .[0] + " " + .[1] + " " + (.[2:] | join("-"))) | \(join(" | ")) |"' "$@"
}

print_sums() {
    echo "| $head"
    echo "$ruler"
    jq -nr --argjson most "$most" "$costs"' [inputs | [costs | map(. // $most)]] | transpose
        | map(transpose | map(add)) | transpose as [$a, $b, $c]
        | ["1e-3", $a], ["1e-6", $b], ["1e-9", $c] | "| to \(.[0]) | \(.[1] | map(tostring) | join(" | ")) |"' "$@"
}

# The scene on which auto compares worst with the best of the others at 1e-6.
print_worst() {
    jq -nr "$costs"' [inputs | ([costs] | map(.[1])) as $to | ($to[1:] | map(select(. != null)) | min) as $best
            | select($best != null) | {scene: (input_filename | split("/")[-1] | rtrimstr(".json")), ratio: ($to[0] / $best)}]
        | max_by(.ratio)
        | "To 1e-6 `auto` takes at most \(.ratio * 100 | round / 100) times the factorisations of the best other method (\(.scene))."' "$@"
}

# Seconds of the paper's stop-and-go for one of auto, to 1e-6, as each run tells them.
print_seconds() {
    jq -nr '[inputs | (input_filename | split("/")[-1] | rtrimstr(".json")) as $scene
            | [.methods[] | {method, s: .["own_1e-06"].seconds}]
            | .[0].s as $auto | .[] | select(.method | startswith("stop-and-go")) | select(.s != null)
            | {$scene, method: (.method | split("=")[1]), ratio: (.s / $auto)}] | group_by(.method)[]
        | (map(.ratio | log) | add / length | exp * 10 | round / 10) as $mean | min_by(.ratio) as $least
        | "Stop-and-go (\(.[0].method)) takes \($mean) times the seconds of `auto` to 1e-6 (geometric mean of \(length) scenes; at least \($least.ratio * 10 | round / 10), \($least.scene))."' "$@"
}

# ---- the square of the paper -----------------------------------------------------------------------

# Low and high damping are two of the paper's pictures; how high it does not say.
run_paper_square() {
    build/drape example square --triangles 5000 >"$work/job"
    compare paper-square "$work/job" "$members" "${ways[@]}" dynamic:damping.air=1 dynamic:damping.air=10
    for rule in kinetic potential; do first_stops "stop-and-go:stop_on=$rule" >"$work/$rule"; done
}

first_stops() {
    get_trace paper-square "$1" |
        jq -r '(.columns | index("stop")) as $stop | [.rows[] | select(.[$stop] == 1) | .[0]][:8] | join(", ")'
}

print_paper_square() {
    echo "The paper's square (0.5 m, 10 N/m, 20 ms; 5 000 triangles) first stops at iterations $(<"$work/kinetic")"
    echo "by the kinetic rule and at $(<"$work/potential") by the potential rule;"
    echo 'in the paper at 16, 19, 34, 38, 45, 61, 68, 75.'
}

# ---- all of it -------------------------------------------------------------------------------------

figures=()
for bend in 1e-5 1e-7; do
    for scene in square-10 square-1000 square-10000 skirt-10 skirt-500 arc-10 arc-1000 noise-10 noise-1000 \
        fold-10 fold-1000; do
        run_scene "${scene%-*}" "${scene#*-}" "$bend"
    done
done
# shellcheck disable=SC2053
[[ paper-square == $scenes ]] && run_paper_square

{
    echo '# Methods by scene'
    echo
    cat <<EOF
a/b/c: factorisations, failed ones included, until \`(E - E*)/(E0 - E*)\` stays below 1e-3, 1e-6 and 1e-9. \`E*\` is the
energy at which the run itself rests; where it does not rest, the lowest that any method reached, which flatters it.
"-": not in $most iterations, which the sums count as $most. "+x": it rests higher than the lowest energy that any
method reached, by x of \`E0 - E*\`: in another minimum.
EOF
    echo
    if ((${#figures[@]})); then
        print_scenes "${figures[@]}"
        echo
        { print_sums "${figures[@]}" && echo && print_worst "${figures[@]}" && print_seconds "${figures[@]}"; } | tee "$work/sums"
        echo
    fi
    [[ ! -s $work/potential ]] || print_paper_square | tee "$work/square"
} >"$table"
if [[ $scenes == '*' ]]; then
    { cat "$work/sums" && echo && cat "$work/square"; } | put_in_readme bench-methods
fi
cat "$table"
say "see $table and the pages in $out"
