# shellcheck shell=bash disable=SC2154 # $out is the script's own
# lib.sh - what the benches share: a daemon of their own, comparisons, blocks of README.md.
# Sourced by the scripts beside it, which run from the root of the tree.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

me=$(basename "$0" .sh)
work=$(mktemp -d "${TMPDIR:-/tmp}/draped-bench.XXXXXX")
pid='' url=''

say() { echo "$me: $*" >&2; }

stop_daemon() {
    if [[ -n $pid ]] && kill -TERM "$pid" 2>/dev/null; then wait "$pid" || true; fi
    pid=''
}

# The daemon is stopped and its folder removed however this ends.
leave() {
    status=$?
    stop_daemon
    if ((status)) && [[ -s $work/log ]]; then
        say 'failed; the daemon said:'
        tail -n 20 "$work/log" >&2
    fi
    rm -rf "$work"
}
trap leave EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# start_daemon [WORKERS]: one if not said otherwise, so that nothing else is solved while seconds are counted.
start_daemon() {
    rm -f "$work/url"
    build/draped --listen 127.0.0.1:0 --admin 127.0.0.1:0 --data "$work/data" --url-file "$work/url" \
        --workers "${1:-1}" --drain-timeout 1 2>"$work/log" &
    pid=$!
    for ((i = 0; i < 200; i++)); do
        [[ -s $work/url ]] && break
        kill -0 "$pid" 2>/dev/null || { pid='' && say 'the daemon did not start' && exit 1; }
        sleep 0.05
    done
    url=$(head -n 1 "$work/url")
    export DRAPED_URL=$url
}

# settle JOB POSITIONS BEND: the job's rest state with that bending (N m) instead of its own, by auto.
settle() {
    local id
    jq -c --argjson bend "$3" '.cloth.materials[0].bend = {weft: $bend, warp: $bend, twist: ($bend / 2)}
        | .solver = {tolerance: 1e-6, max_iterations: 2000, time_limit_s: 1200}' "$1" >"$work/settle.job"
    id=$(build/drape run "$work/settle.job" -q --json | jq -r .id)
    curl -sSf "$url/v1/jobs/$id/result?format=json" | jq -c .positions >"$2"
}

# compare NAME JOB SOLVER-MEMBERS METHOD...: leaves the page, the rows and the figures in $out/NAME.html, .csv, .json.
compare() {
    local name=$1 job=$2 members=$3 method methods=() status=0
    shift 3
    for method in "$@"; do methods+=(--method "$method"); done
    jq -c --arg name "$name" --argjson members "$members" \
        '.name = $name | .solver = $members' "$job" >"$work/compare.job"
    say "$name: $# methods"
    build/drape compare "$work/compare.job" "${methods[@]}" --quiet --json \
        -o "$out/$name.html" --csv "$out/$name.csv" >"$out/$name.json" || status=$?
    ((status == 0 || status == 5)) || { say "$name: drape compare ended with status $status" && exit 1; }
}

# get_trace NAME METHOD: the trace of that method in the comparison NAME, as JSON.
get_trace() {
    local id
    id=$(jq -r --arg method "$2" '.methods[] | select(.method == $method) | .id' "$out/$1.json")
    curl -sSf "$url/v1/jobs/$id/trace?format=json"
}

# put_in_readme TARGET: standard input in place of what stands between the target's two marks.
put_in_readme() {
    BLOCK=$(cat) awk -v target="$1" '
        $0 == "<!-- /" target " -->" {inside = 0; ends++}
        !inside {print}
        $0 == "<!-- " target " -->" {print ENVIRON["BLOCK"]; inside = 1; starts++}
        END {exit !(starts == 1 && ends == 1)}' README.md >"$work/README.md" ||
        { say "README.md has no pair of marks for $1" && exit 1; }
    cmp -s "$work/README.md" README.md || cat "$work/README.md" >README.md
}
