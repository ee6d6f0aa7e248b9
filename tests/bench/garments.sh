#!/bin/bash
# `make bench-garments`: real garments of ../shared/data on a real body, through the API, with friction and a
# certificate: how each ends, where it crosses the body and itself by the exact test of tests/api/crossings.c,
# what it costs by stage. Leaves job, report, drape, figures and picture (front, side, back) of each in
# build/bench-garments/ and the tables in build/bench-garments.md.
#   GARMENTS='shirt dress'   only those                     (shirt_coarse shirt skirt8 dress)
#   METHODS='auto dynamic'   NAME or NAME:MEMBER=WORD,...   (auto stop-and-go:stop_on=kinetic dynamic)
#   TIME_LIMIT=60            seconds of a run               (600)
#   ITERATIONS=100           iterations of a run            (400)
. "$(dirname "$0")/lib.sh"
out=build/bench-garments
table=build/bench-garments.md
shared=../shared/data
avatar=$shared/bodies/body_f_A.obj
tools=build/release/tests/api
fabric=cotton-poplin
friction=0.3
limit=${TIME_LIMIT:-600}
most=${ITERATIONS:-400}
read -ra garments <<<"${GARMENTS:-shirt_coarse shirt skirt8 dress}"
read -ra methods <<<"${METHODS:-auto stop-and-go:stop_on=kinetic dynamic}"

[[ -r $avatar ]] || { say "$avatar is absent: there is nothing to drape" && exit 1; }
mkdir -p "$out"
start_daemon

# ---- one run ---------------------------------------------------------------------------------------

# make_job GARMENT METHOD
make_job() {
    build/drape scene --garment "$shared/garments/$1.obj" --seams "$shared/garments/$1.seams" \
        --body "$avatar" --material "$fabric" --friction "$friction" --name "$1 by $2" \
        --time-limit "$limit" --max-iterations "$most" |
        jq -c --arg method "$2" '($method | split(":")) as [$name, $members]
            | .solver += {certify: true, method: $name}
            + ($members // "" | split(",") | map(split("=") | {(.[0]): .[1]}) | add // {})'
}

# look_at NAME GARMENT: crossings, depth and seams of the drape $out/NAME.obj.
look_at() {
    "$tools/crossings" "$out/$1.obj" "$avatar" >"$work/crossings"
    "$tools/measure" "$out/$1.obj" "$shared/garments/$2.seams" "$avatar" >"$work/measure"
    jq -cs '.[0] + .[1]' "$work/crossings" "$work/measure"
}

# run_garment GARMENT METHOD: leaves GARMENT-METHOD.job, .json (the report), .obj, .glb, .png and .figures.
run_garment() {
    local name=$1-${2//[:=,]/-} status=0 id
    rm -f "$out/$name".*
    make_job "$1" "$2" >"$out/$name.job"
    say "$1 by $2"
    build/drape run "$out/$name.job" --quiet --json >"$out/$name.json" || status=$?
    ((status == 0 || status == 4 || status == 5)) || { say "$name: drape run ended with status $status" && exit 1; }
    id=$(jq -r .id "$out/$name.json")
    if build/drape result "$id" -o "$out/$name.glb" 2>"$work/said"; then
        build/drape result "$id" -o "$out/$name.obj"
        build/drape picture "$out/$name.job" "$out/$name.glb" -o "$out/$name.png"
        look_at "$name" "$1" >"$out/$name.figures"
    else
        say "$name: no drape: $(<"$work/said")"
        echo null >"$out/$name.figures"
    fi
    jq -c --arg garment "$1" --arg method "$2" --arg triangles "$(grep -c '^f ' "$shared/garments/$1.obj")" \
        --slurpfile figures "$out/$name.figures" \
        '{$garment, $method, $triangles, job: ., figures: $figures[0]}' "$out/$name.json" >>"$work/rows"
}

# ---- the tables ------------------------------------------------------------------------------------

# shellcheck disable=SC2016 # the variables are jq's
words='
def text: if . == null then "-" else tostring end;
def row: "| \(map(text) | join(" | ")) |";
def scaled($by; $digits): if . == null then null else
    pow(10; $digits) as $unit | (. * $by * $unit | round) as $n
    | "\($n / $unit | floor)." + ("000\($n % $unit)" | .[-$digits:]) end;
def power: if . == null then null elif . == 0 then "0" else
    (log10 | floor) as $e | "\(. / pow(10; $e) * 10 | round / 10)e\($e)" end;
def ran: .job.report.method as $name
    | if $name == null or (.method | startswith($name)) then "" else ", as `\($name)`" end;
def certified: .job.report.certificate.certified | if . == null then null elif . then "yes" else "no" end;
def counts: if . == null then null elif .touches > 0 then "\(.crossings) + \(.touches)" else .crossings end;'

print_ends() {
    jq -nr "$words"' ["garment", "triangles", "method", "verdict", "certified", "iterations", "residual force",
        "crossings with the body", "with itself", "vertices inside", "deepest, mm", "seam gap, m"]
        | row, (map("---") | row)'
    jq -r "$words"' [.garment, .triangles, "`\(.method)`\(ran)", .job.verdict // .job.status, certified,
        .job.report.iterations, (.job.report.residual_force | power),
        (.figures | (.cloth_body | counts), (.cloth_cloth | counts), .inside, (.deepest | scaled(1e3; 2)),
            (.seam_gap | power))] | row' "$work/rows"
}

print_costs() {
    local stages
    stages=$(jq -cs '[.[].job.report.stages // {} | keys_unsorted[]]
        | reduce .[] as $stage ([]; if index($stage) then . else . + [$stage] end)' "$work/rows")
    jq -nr --argjson stages "$stages" "$words"'
        ["garment", "method", "factorisations", "seconds"] + $stages + ["peak, MB", "terms, MB"]
        | row, (map("---") | row)'
    jq -r --argjson stages "$stages" "$words"' .job.report as $report
        | [.garment, "`\(.method)`", $report.factorizations, ($report.seconds | scaled(1; 1))]
            + [$stages[] | $report.stages[.] | scaled(1; 1)]
            + [($report.peak_bytes | scaled(1e-6; 1)),
               ($report.plan.kept // [] | sort_by(-.bytes)
                   | map(select(.bytes >= 1e6) | "\(.name) \(.bytes | scaled(1e-6; 1))") | join(", "))]
        | row' "$work/rows"
}

: >"$work/rows"
for garment in "${garments[@]}"; do
    for method in "${methods[@]}"; do run_garment "$garment" "$method"; done
done
{
    echo '# Garments on bodies'
    echo
    cat <<EOF
Garments of \`shared/data\` in $fabric on \`$(basename "$avatar" .obj)\`, friction $friction, at most $most iterations
and $limit s; $(nproc) processors. Crossings are edges through triangles, decided exactly by \`tests/api/crossings.c\`;
"+ n": n more only touch. Vertices inside the body, their depth and the seams are measured by
\`tests/api/measure.c\`. Neither shares code with the solver. "-": there is no such figure.
EOF
    echo
    print_ends
    echo
    cat <<'EOF'
Seconds by stage. Memory that scene and solver hold, at most at a time, and terms of the plan of 1 MB or more, which
do not all stand at a time:
EOF
    echo
    print_costs
} >"$table"
cat "$table"
say "see $table and the pictures in $out"
