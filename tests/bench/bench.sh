#!/bin/bash
# `make bench`: what a drape costs, by scene, size and method, in one run through the API; ratios first. Leaves the
# comparison of each scene (its page shows error against run time) and its jobs' reports in build/bench/, the tables in
# build/bench.md, and the same as a page in build/bench.html.
#   SCENES='square-5000-* shirt'   only those of: square-{5000,20000,60000,200000}-{10,1000,10000} (triangles, N/m)
#                                  wrinkles-{20000,100000} shirt skirt8 dress; workers: jobs alone and beside each other;
#                                  waits: what a configurator waits for; blender: its cloth on a square of 19 200
#                                  (installs Debian's blender)
#   METHODS='auto dynamic'         (auto stop-and-go:stop_on=potential dynamic newton:line_search=true)
#   TIME_LIMIT=60                  seconds of a run               (300)
#   ITERATIONS=100                 iterations of a run            (1000)
#   FRAMES=200                     of Blender's, 25 a second      (500)
#   WORKERS=2                      of the daemon: a job alone borrows the other ones' processors  (1)
. "$(dirname "$0")/lib.sh"
out=build/bench
shared=../shared/data
limit=${TIME_LIMIT:-300}
most=${ITERATIONS:-1000}
frames=${FRAMES:-500}
workers=${WORKERS:-1}
read -ra wanted <<<"${SCENES:-*}"
read -ra methods <<<"${METHODS:-auto stop-and-go:stop_on=potential dynamic newton:line_search=true}"

mkdir -p "$out"
build/release/tests/bench/floor >"$work/floor"
start_daemon "$workers"

is_wanted() {
    local scene
    for scene in "${wanted[@]}"; do
        # shellcheck disable=SC2053 # a pattern is meant
        [[ $1 == $scene ]] && return
    done
    return 1
}

# solve NAME JOB TRIANGLES METHOD...: compares them, `auto` with a certificate, and keeps the reports.
solve() {
    local members id name=$1 job=$2 triangles=$3
    shift 3
    members='{"tolerance": 1e-6, "max_iterations": '$most', "time_limit_s": '$limit', "time_step": 0.02}'
    # Newton's LDL' of a large matrix takes minutes; who asks for less time means it.
    compare "$name" "$job" "$members" "${@/#auto/auto:certify=true}"
    : >"$work/reports"
    for id in $(jq -r '.methods[].id // empty' "$out/$name.json"); do
        curl -sSf "$url/v1/jobs/$id" >>"$work/reports"
    done
    jq -s 'map({key: .id, value: .report}) | from_entries' "$work/reports" >"$out/$name.reports"
    jq -c --arg scene "$name" --argjson triangles "$triangles" --slurpfile report "$out/$name.reports" \
        '{$scene, $triangles, methods: [.methods[] | . + {report: $report[0][.id // ""]}]}' "$out/$name.json" >>"$work/rows"
}

triangles_of() { jq '.cloth.mesh.triangles | length / 3' "$1"; }

# ---- scenes ----------------------------------------------------------------------------------------

run_square() { # run_square TRIANGLES N_PER_M
    is_wanted "square-$1-$2" || return 0
    build/drape example square --triangles "$1" |
        jq -c --argjson k "$2" '.cloth.materials[0].stretch = {weft: $k, warp: $k, shear: ($k / 2)}' >"$work/job"
    solve "square-$1-$2" "$work/job" "$(triangles_of "$work/job")" "${methods[@]}"
}

run_wrinkles() { # run_wrinkles TRIANGLES: see wrinkles.sh
    is_wanted "wrinkles-$1" || return 0
    build/drape example skirt --triangles "$1" >"$work/skirt"
    settle "$work/skirt" "$work/positions" 1e-3
    jq -c --slurpfile x "$work/positions" '.cloth.mesh.positions = $x[0]' "$work/skirt" >"$work/job"
    solve "wrinkles-$1" "$work/job" "$(triangles_of "$work/job")" "${methods[@]}"
}

has_data() { [[ -r $shared/bodies/body_f_A.obj ]] || { say "$shared is absent: no $1" && return 1; }; }

garment() { # garment NAME: its job, as in garments.sh
    build/drape scene --garment "$shared/garments/$1.obj" --seams "$shared/garments/$1.seams" \
        --body "$shared/bodies/body_f_A.obj" --material cotton-poplin --friction 0.3 --self-contact on |
        jq -c 'del(.cloth.triangle_material) | .cloth.materials = [{density: 0.17,
            stretch: {weft: 400, warp: 400, shear: 100}, poisson: 0, bend: {weft: 1e-5, warp: 1e-5, twist: 5e-6}}]'
}

run_garment() { # run_garment NAME: without Newton, whose whole steps go through cloth, which is refused
    is_wanted "$1" && has_data "$1" || return 0
    local method kept=()
    for method in "${methods[@]}"; do [[ $method == newton* ]] || kept+=("$method"); done
    garment "$1" >"$work/job"
    solve "$1" "$work/job" "$(triangles_of "$work/job")" "${kept[@]}"
}

# wait_for NAME WORKERS JOB [FROM]: posts it and watches its events; sets `id`.
wait_for() {
    local posted=$EPOCHREALTIME shown='' line
    id=$(build/drape submit "$3" ${4:+--from "$4"} -q --json | jq -r .id)
    while IFS= read -r line; do
        [[ ${line%$'\r'} != 'event: preview' ]] || shown=${shown:-$EPOCHREALTIME}
    done < <(curl -sSfN "$url/v1/jobs/$id/events")
    local ended=$EPOCHREALTIME
    curl -sSf "$url/v1/jobs/$id" >"$work/ended"
    curl -sSf "$url/v1/jobs/$id/trace?format=json" >"$work/trace"
    jq -c --arg name "$1" --argjson workers "$2" --argjson shown "${shown:-null}" --argjson posted "$posted" \
        --argjson ended "$ended" --slurpfile trace "$work/trace" '{$name, $workers, verdict, report,
            shown: (if $shown then $shown - $posted else null end), ended: ($ended - $posted), trace: $trace[0]}' \
        "$work/ended" >>"$work/waits"
}

# From scratch in a daemon that has not seen the body, then again with a larger pattern.
run_waits() {
    is_wanted waits && has_data waits || return 0
    local count name
    for count in 1 2; do
        for name in shirt dress; do
            stop_daemon
            start_daemon "$count"
            say "$name on $count workers"
            garment "$name" | jq -c '.solver.tolerance = 1e-3' >"$work/job"
            wait_for "$name" "$count" "$work/job"
            jq -c '.cloth.mesh.pattern |= map(. * 1.05)' "$work/job" >"$work/larger"
            wait_for "$name, pattern 5 % larger" "$count" "$work/larger" "$id"
        done
    done
    stop_daemon
    start_daemon "$workers"
}

# One job on one worker and on two, of which it borrows the other's processor; then four jobs alike. From the first one's
# beginning to the last one's end.
run_workers() {
    is_wanted workers || return 0
    local count jobs id ids
    build/drape example square --triangles 60000 | jq -c '.solver = {tolerance: 1e-3}' >"$work/job"
    for count in 1 2; do
        stop_daemon
        start_daemon "$count"
        for jobs in 1 4; do
            say "$jobs jobs on $count workers"
            ids=()
            for ((i = 0; i < jobs; i++)); do ids+=("$(build/drape submit "$work/job" -q --json | jq -r .id)"); done
            for id in "${ids[@]}"; do build/drape watch "$id" -q >"$work/said"; done
            for id in "${ids[@]}"; do curl -sSf "$url/v1/jobs/$id"; done | jq -cs --argjson workers "$count" '
                def seconds: (.[:19] + "Z" | fromdateiso8601) + (.[19:-1] | if . == "" then 0 else "0" + . | tonumber end);
                {$workers, jobs: length, seconds: ((map(.finished_at | seconds) | max) - (map(.started_at | seconds) | min))}' \
                >>"$work/workers"
        done
    done
    stop_daemon
    start_daemon "$workers"
}

# The same square by Blender's cloth, in seconds of processor time until the potential energy in gravity stays within
# 0.01 % of its last. Draped's are its seconds times what the daemon used of a processor meanwhile.
run_blender() {
    is_wanted blender || return 0
    command -v blender >/dev/null && python3 -c 'import numpy' 2>"$work/said" ||
        apt-get install -y --no-install-recommends blender python3-numpy >"$work/said" 2>&1 ||
        { say "blender could not be installed: $(tail -n 1 "$work/said")" && return; }
    local id before used
    build/drape example square --triangles 19200 | jq -c '.solver = {tolerance: 1e-6, time_step: 0.02}' >"$work/job"
    say 'the square by auto'
    before=$(cpu_seconds)
    id=$(build/drape run "$work/job" -q --json | jq -r .id)
    used=$(jq -n "$(cpu_seconds) - $before")
    curl -sSf "$url/v1/jobs/$id/trace?format=json" | jq -c --argjson used "$used" '.columns as $columns
        | [.rows[] | [$columns, .] | transpose | map({key: .[0], value: .[1]}) | from_entries]
        | (.[-1].seconds) as $all | {program: "auto", rows: map([.seconds * $used / $all, .gravity])}' >>"$work/blender"
    say "the square by Blender's cloth"
    blender --background --factory-startup --threads 1 --python tests/bench/blender.py -- "$work/job" "$frames" >"$work/frames"
    jq -cRn '[inputs | select(startswith("row ")) | split(" ") | map(tonumber? // .)]
        | {program: "Blender", speed: .[-1][4], rows: map([.[2], .[3]])}' "$work/frames" >>"$work/blender"
}

# Of the daemon's process since its start; a second old at most.
cpu_seconds() {
    sleep 1.5
    curl -sSf "$(tail -n 1 "$work/url")/metrics" | awk '/^process_cpu_seconds_total/ {print $2}'
}

# ---- all of it -------------------------------------------------------------------------------------

: >"$work/rows"
: >"$work/workers"
: >"$work/blender"
: >"$work/waits"
for size in 5000 20000 60000 200000; do
    for stretch in 10 1000 10000; do run_square "$size" "$stretch"; done
done
for size in 20000 100000; do run_wrinkles "$size"; done
for garment in shirt skirt8 dress; do run_garment "$garment"; done
run_waits
run_workers
run_blender
for form in md html; do
    jq -rn -f tests/bench/bench.jq --arg form "$form" --slurpfile rows "$work/rows" --slurpfile floor "$work/floor" \
        --slurpfile workers "$work/workers" --slurpfile waits "$work/waits" --argjson count "$workers" --slurpfile blender "$work/blender" --argjson limit "$limit" --argjson most "$most" \
        --arg processors "$(nproc)" >"build/bench.$form"
done
cat build/bench.md
say 'see build/bench.html'
