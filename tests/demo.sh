#!/bin/bash
# `make demo`: drapes the generated garment on the mannequin through a daemon of its own, and shows it.
# Leaves drape.glb, drape.png, trace.svg and garment.json in build/demo/.
set -euo pipefail
cd "$(dirname "$0")/.."
out=build/demo
rest=0.01 # the residual force asked for, in mean vertex weights
work=$(mktemp -d "${TMPDIR:-/tmp}/draped-demo.XXXXXX")
pid=''

# The daemon is stopped and its folder removed however this ends.
leave() {
    status=$?
    if [[ -n $pid ]] && kill -TERM "$pid" 2>/dev/null; then wait "$pid" || true; fi
    if ((status)); then echo "demo: failed; the daemon said:" >&2; tail -n 20 "$work/log" >&2 || true; fi
    rm -rf "$work"
}
trap leave EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

mkdir -p "$out"
build/draped --listen 127.0.0.1:0 --admin 127.0.0.1:0 --data "$work/data" --url-file "$work/url" 2>"$work/log" &
pid=$!
for ((i = 0; i < 200; i++)); do
    [[ -s $work/url ]] && break
    kill -0 "$pid" 2>/dev/null || { pid=''; echo "demo: the daemon did not start" >&2; exit 1; }
    sleep 0.05
done
url=$(head -n 1 "$work/url")
echo "demo: draped runs at $url"

build/drape example garment >"$out/garment.json"
echo "demo: a dress of $(jq '.cloth.mesh.triangles | length / 3' "$out/garment.json") triangles," \
    "$(jq '.cloth.seams | length / 2' "$out/garment.json") seam pairs, on a mannequin"
build/drape run "$out/garment.json" --url "$url" -o "$out/drape.glb" \
    --picture "$out/drape.png" --trace "$out/trace.svg"

# The client has printed the summary of the trace; whether it is good enough, the server's report says.
id=$(curl -sf "$url/v1/jobs?limit=1" | jq -r '.jobs[0].id')
curl -sf "$url/v1/jobs/$id" >"$work/job"
jq -e --argjson rest "$rest" '.status == "succeeded" and .verdict == "at-rest" and .report.residual_force <= $rest' \
    "$work/job" >/dev/null ||
    { echo "demo: not at rest to $rest" >&2; exit 1; }
for file in drape.glb drape.png trace.svg; do
    [[ -s $out/$file ]] || { echo "demo: $out/$file is missing" >&2; exit 1; }
done

kill -TERM "$pid"
wait "$pid" || { echo "demo: the daemon ended with status $?" >&2; pid=''; exit 1; }
pid=''
echo "demo: see $out/drape.png, $out/drape.glb, $out/trace.svg"
