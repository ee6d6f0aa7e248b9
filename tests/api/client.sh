#!/bin/bash
# The commands of drape from end to end: what they print, what they write, and their exit statuses.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
export DRAPED_URL=$url

# run NAME STATUS COMMAND...: the exit status; output in $work/out and $work/err.
run() {
    local name=$1 want=$2 got
    shift 2
    "$@" >"$work/out" 2>"$work/err" </dev/null
    got=$?
    if [[ $got == "$want" ]]; then ok "$name"; else
        not_ok "$name" "status $got, wanted $want" "$(tail -c 400 "$work/out")" "$(tail -c 600 "$work/err")"
    fi
}
out() { tail -n 1 "$work/out"; }

# ---- help
run 'drape --help' 0 "$DRAPE" --help
commands=$(sed -n 's/^  \([a-z]*\)  .*/\1/p' "$work/out")
for command in example scene run submit status watch result trace compare cancel list materials picture; do
    check "names $command" grep -qx "$command" <<<"$commands"
    run "drape $command --help" 0 "$DRAPE" "$command" --help
done
run 'no command is wrong usage' 1 "$DRAPE"
run 'an unknown command is wrong usage' 1 "$DRAPE" dance
like 'and is named' "$(<"$work/err")" dance
run 'an unknown option is wrong usage' 1 "$DRAPE" example square --colour red

# ---- examples
for example in square arc skirt garment; do
    run "drape example $example" 0 "$DRAPE" example "$example"
    cp "$work/out" "$work/$example.json"
    json "$example is a job" '(.cloth.mesh.triangles | length) > 300 and (.cloth.materials | length) > 0' "$work/$example.json"
    jq '.solver.max_iterations = 2' "$work/$example.json" >"$work/short"
    submit "$work/short"
    is "the daemon takes $example" "$code" 202
    wait_for "$id" 'succeeded|failed' 60
    json "$example runs" '.status == "succeeded"'
done
run 'drape example square --triangles 5000' 0 "$DRAPE" example square --triangles 5000
json 'gives about as many' '.cloth.mesh.triangles | length / 3 | . > 4500 and . < 5500' "$work/out"
json 'the garment has seams and a body' '(.cloth.seams | length) > 20 and (.bodies | length) == 1' "$work/garment.json"
run 'an unknown example is wrong usage' 1 "$DRAPE" example sock

# ---- a job in one go
run 'a small square' 0 "$DRAPE" example square --triangles 300
cp "$work/out" "$work/small.json"
run 'drape run drapes it' 0 "$DRAPE" run "$work/small.json" -o "$work/out.glb" --picture "$work/out.png" --trace "$work/out.svg"
is 'a GLB is there' "$(head -c 4 "$work/out.glb")" glTF
is 'a PNG is there' "$(head -c 4 "$work/out.png" | tail -c 3)" PNG
check 'an SVG is there' grep -q '</svg>' "$work/out.svg"
run 'drape run - reads a pipe' 0 bash -c '"$0" run - -o "$1" <"$2"' "$DRAPE" "$work/out.obj" "$work/small.json"
check 'the name says the format' grep -q '^v ' "$work/out.obj"

# ---- warnings before anything is solved
jq -n '{cloth: {mesh: {positions: [0,0,0, 1,0,0, 0,1,0, 1.1,0,0, 1.1,1,0, 0.1,1,0], triangles: [0,1,2, 3,4,5],
    pattern: [0,0, 1,0, 0,1, 1,0, 1,1, 0,1]}, seams: [1,5, 2,3], pins: [0], materials: [{preset: "linen"}]},
    solver: {max_iterations: 1}}' >"$work/crossed.json"
run 'a job with a crossed seam is taken' 0 "$DRAPE" submit "$work/crossed.json"
like 'and warned of' "$(cat "$work/out" "$work/err" 2>/dev/null)" 'warning: seam 0: .*crossed directions.*\(/cloth/seams/0\)'
id=$(grep -o '[0-9a-f]\{32\}' "$work/out" | head -n 1)
request GET "$url/v1/jobs/$id"
json 'the job says so, too' '.warnings | length == 1 and .[0].pointer == "/cloth/seams/0" and (.[0].detail | length > 20)'

# ---- step by step
run 'drape submit' 0 "$DRAPE" submit "$work/small.json"
id=$(grep -o '[0-9a-f]\{32\}' "$work/out" | head -n 1)
like 'prints the id' "$id" '^[0-9a-f]{32}$'
run 'drape watch sees the end' 0 "$DRAPE" watch "$id"
run 'drape status' 0 "$DRAPE" status "$id"
like 'says that it succeeded' "$(<"$work/out")" succeeded
run 'drape status --json' 0 "$DRAPE" status "$id" --json
json 'prints the job' '.status == "succeeded"' "$work/out"
run 'drape result' 0 "$DRAPE" result "$id" -o "$work/result.ply"
is 'writes PLY' "$(head -c 3 "$work/result.ply")" ply
run 'drape trace --plot' 0 "$DRAPE" trace "$id" --plot
check 'draws an SVG' grep -q "</svg>" "$work/out"
run 'drape trace' 0 "$DRAPE" trace "$id"
like 'prints the rows' "$(<"$work/out")" iteration

run 'drape list' 0 "$DRAPE" list
like 'lists the job' "$(<"$work/out")" "$id"
run 'drape materials' 0 "$DRAPE" materials
like 'lists the fabrics' "$(<"$work/out")" cotton-poplin
run 'drape picture' 0 "$DRAPE" picture "$work/small.json" "$work/out.glb" -o "$work/again.png"
check 'draws the same picture as run' cmp "$work/again.png" "$work/out.png"

# ---- cancel, and jobs that do not end well
endless >"$work/long"
run 'a long job' 0 "$DRAPE" submit "$work/long"
id=$(grep -o '[0-9a-f]\{32\}' "$work/out" | head -n 1)
wait_for "$id" running
run 'a result too soon is refused' 2 "$DRAPE" result "$id" -o "$work/early.glb"
check 'and no file is left behind' test ! -e "$work/early.glb"
run 'drape cancel' 0 "$DRAPE" cancel "$id"
wait_for "$id" canceled
run 'watching a cancelled job tells so' 4 "$DRAPE" watch "$id"
jq '.solver.max_iterations = 2' "$work/small.json" >"$work/short"
run 'a drape not at rest has its own status' 5 "$DRAPE" run "$work/short" -o "$work/short.glb"
check 'and its best state is written' test -s "$work/short.glb"
run 'an output that cannot be written' 6 "$DRAPE" run "$work/small.json" -o "$work/nowhere/out.glb"
like 'says how to fetch the drape again' "$(<"$work/err")" 'drape result [0-9a-f]{32} -o'

# ---- refusals and errors
jq '.cloths = 1' "$work/small.json" >"$work/bad"
run 'a job the server refuses' 2 "$DRAPE" run "$work/bad" -o "$work/bad.glb"
like 'says where' "$(<"$work/err")" '/cloths'
run 'an unknown job' 2 "$DRAPE" status 00000000000000000000000000000000
run 'a file that is not there' 1 "$DRAPE" submit "$work/nothing.json"
like 'is named' "$(<"$work/err")" 'nothing.json'
run 'an output that cannot be written' 6 "$DRAPE" run "$work/small.json" -o "$work/no/folder.glb"
DRAPED_URL=http://127.0.0.1:1 run 'no server' 3 "$DRAPE" status 00000000000000000000000000000000
like 'is named' "$(<"$work/err")" '127.0.0.1:1'
stop_daemon
run 'a server that went away' 3 "$DRAPE" status 00000000000000000000000000000000
finish
