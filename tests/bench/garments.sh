#!/bin/bash
# `make bench-garments`: real garments of ../shared/data on a real body, through the API, with friction and a
# certificate: how each ends, where it crosses the body and itself by the exact test of tests/api/crossings.c,
# what it costs by stage. Leaves job, report, drape, figures and picture (front, side, back) of each in
# build/bench-garments/ and the tables in build/bench-garments.md.
#   GARMENTS='shirt dress'   only those rows: shirt_coarse shirt skirt8 dress; layers: shirt_coarse+shirt_coarse
#                            shirt+shirt dress+skirt8; from a finished job: shirt@larger shirt@large_body; a body that
#                            moves: shirt@posture skirt8@posture                    (all but shirt_coarse+shirt_coarse)
#   METHODS='auto dynamic'   NAME or NAME:MEMBER=WORD,...   (auto stop-and-go:stop_on=kinetic dynamic)
#   FABRIC=denim             a preset instead of the fabric of the targets
#   TIME_LIMIT=60            seconds of a run               (1800)
#   ITERATIONS=100           iterations of a run            (400)
. "$(dirname "$0")/lib.sh"
out=build/bench-garments
table=build/bench-garments.md
shared=../shared/data
avatar=$shared/bodies/body_f_A.obj
tools=build/release/tests/api
bodies=$shared/bodies
fabric=${FABRIC:-'the fabric of the targets (0.17 kg/m2, 400/400/100 N/m, bending 1e-5 N m)'}
friction=0.3
limit=${TIME_LIMIT:-1800}
most=${ITERATIONS:-400}
rows='shirt_coarse shirt skirt8 dress shirt+shirt dress+skirt8'
rows+=' shirt@larger shirt@large_body shirt@posture skirt8@posture'
read -ra garments <<<"${GARMENTS:-$rows}"
read -ra methods <<<"${METHODS:-auto stop-and-go:stop_on=kinetic dynamic}"

[[ -r $avatar ]] || { say "$avatar is absent: there is nothing to drape" && exit 1; }
mkdir -p "$out"
start_daemon

# ---- one run ---------------------------------------------------------------------------------------

# The most iterations that `auto` may take.
declare -A target=([shirt]=60 [skirt8]=120 [dress]=150)

# What a layer needs to start outside of the one below as that is once sewn.
declare -A outer=(
    [shirt+shirt]='--scale 1.1 --outwards 0.1'
    [shirt_coarse+shirt_coarse]='--scale 1.1 --outwards 0.1'
    [dress+skirt8]='--outwards 0.1' # more, and its sides start outside of the arms
)

# variant ROW: sets `avatar` (where the row's drape ends, what its crossings are counted against), `options` for drape
# scene, and `begins`: from (a finished drape), motion (a body that is then moved), or nothing (apart).
variant() {
    avatar=$bodies/body_f_A.obj options=() begins=''
    case $1 in
    *@larger) options=(--scale 1.05) begins=from ;;
    *@large_body) avatar=$bodies/body_f_large_A.obj begins=from ;;
    *@posture)
        avatar=$bodies/body_f_standing05.obj begins=motion
        options=(--motion "$bodies/body_f_standing05_half.obj" --motion "$avatar")
        ;;
    esac
}

# scene ROW: the job of `drape scene`, without a method.
scene() {
    local worn=${1%%@*} body=$avatar part part_options=() from=()
    for part in ${worn//+/ }; do
        part_options+=(--garment "$shared/garments/$part.obj" --seams "$shared/garments/$part.seams")
    done
    # shellcheck disable=SC2206 # words
    [[ $worn != *+* ]] || part_options+=(${outer[$worn]})
    [[ $begins != motion ]] || body=$bodies/body_f_A.obj
    [[ $begins != from ]] || from=(--from "$(first_drape "$worn")")
    build/drape scene "${part_options[@]}" --body "$body" --material "${FABRIC:-cotton-poplin}" \
        --friction "$friction" --self-contact on --time-limit "$limit" --max-iterations "$most" "${options[@]}" "${from[@]}"
}

# first_drape GARMENT: the id of its job by auto on the first body, made now if there is none.
first_drape() {
    local file=$out/$1-auto.json
    [[ -s $work/$1.id ]] || {
        (variant "$1" && make_job "$1" auto) >"$work/first.job"
        build/drape run "$work/first.job" --quiet --json >"$file" || (($? == 4))
        jq -r .id "$file" >"$work/$1.id"
    }
    cat "$work/$1.id"
}

# make_job ROW METHOD: with a method, a certificate and the fabric.
make_job() {
    scene "$1" | jq -c --arg name "$1 by $2" --arg method "$2" --arg preset "${FABRIC:-}" \
        '($method | split(":")) as [$method, $members] | .name = $name
            | if $preset == "" then del(.cloth.triangle_material) | .cloth.materials = [{density: 0.17,
                stretch: {weft: 400, warp: 400, shear: 100}, poisson: 0,
                bend: {weft: 1e-5, warp: 1e-5, twist: 5e-6}}] else . end
            | .solver += {certify: true, method: $method}
            + ($members // "" | split(",") | map(split("=") | {(.[0]): .[1]}) | add // {})'
}

# seams ROW: the seams of all its garments, numbered as in its mesh.
seams() {
    local part base=0 worn=${1%%@*}
    for part in ${worn//+/ }; do
        awk -v base="$base" '!/^#/ && NF {print $1 + base, $2 + base}' "$shared/garments/$part.seams"
        base=$((base + $(grep -c '^v ' "$shared/garments/$part.obj")))
    done
}

# look_at NAME ROW: crossings, depth and seams of the drape $out/NAME.obj.
look_at() {
    "$tools/crossings" "$out/$1.obj" "$avatar" >"$work/crossings"
    "$tools/measure" "$out/$1.obj" <(seams "$2") "$avatar" >"$work/measure"
    jq -cs '.[0] + .[1]' "$work/crossings" "$work/measure"
}

# run_garment ROW METHOD: leaves ROW-METHOD.job, .json (the report), .obj, .glb, .png and .figures.
run_garment() {
    local name=$1-${2//[:=,]/-} status=0 id
    variant "$1"
    rm -f "$out/$name".*
    make_job "$1" "$2" >"$out/$name.job"
    say "$1 by $2"
    build/drape run "$out/$name.job" --quiet --json >"$out/$name.json" || status=$?
    ((status == 0 || status == 4 || status == 5)) || { say "$name: drape run ended with status $status" && exit 1; }
    id=$(jq -r .id "$out/$name.json")
    [[ $2 != auto ]] || echo "$id" >"$work/$1.id"
    if build/drape result "$id" -o "$out/$name.glb" 2>"$work/said"; then
        build/drape result "$id" -o "$out/$name.obj"
        build/drape picture "$out/$name.job" "$out/$name.glb" -o "$out/$name.png"
        look_at "$name" "$1" >"$out/$name.figures"
    else
        say "$name: no drape: $(<"$work/said")"
        echo null >"$out/$name.figures"
    fi
    jq -c --arg garment "$1" --arg method "$2" --arg target "${target[$1]:-}" \
        --slurpfile figures "$out/$name.figures" \
        --slurpfile posted "$out/$name.job" '{$garment, $method, $target,
            triangles: ($posted[0].cloth.mesh.triangles | length / 3), job: ., figures: $figures[0]}' "$out/$name.json" >>"$work/rows"
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
    jq -nr "$words"' ["garment", "triangles", "method", "verdict", "certified", "iterations", "target", "residual force",
        "crossings with the body", "with itself", "vertices inside", "deepest, mm", "seam gap, m"]
        | row, (map("---") | row)'
    jq -r "$words"' [.garment, .triangles, "`\(.method)`\(ran)", .job.verdict // .job.status, certified,
        .job.report.iterations, (if .method == "auto" and .target != "" then .target else null end),
        (.job.report.residual_force | power),
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
Garments of \`shared/data\` in $fabric on \`body_f_A\`,
self-contact on, friction $friction, at most $most iterations and $limit s; $(nproc) processors. Crossings are edges
through triangles, decided exactly by \`tests/api/crossings.c\`; "+ n": n more only touch. Vertices inside the body, their
depth and the seams are measured by \`tests/api/measure.c\`. Neither shares code with the solver. "-": there is no such
figure. "a+b": b over a; "@larger", "@large_body": the pattern 1.05 times as large, or the larger body, from the finished
drape; "@posture": the body moves to \`standing05\`. Target: the most iterations that \`auto\` may take.
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
