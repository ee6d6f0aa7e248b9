# bench.jq - the tables of bench.sh, in Markdown or as a page.
# usage: jq -rn -f bench.jq --arg form md|html --slurpfile rows ROWS --slurpfile floor FLOOR --slurpfile workers WORKERS
#            --slurpfile waits WAITS --argjson count WORKERS --slurpfile blender BLENDER --argjson limit SECONDS --argjson most ITERATIONS --arg processors N
# A row of ROWS is a scene: {scene, triangles, methods: [{method, outcome, "own_1e-03": {...}, ..., report}]}.

def digits($n): pow(10; $n) as $unit | . * $unit | round / $unit;
def text: if . == null then "-" elif type != "number" then . elif . >= 100 then round
    elif . >= 1 then digits(1) elif . >= 0.01 then digits(3) else digits(5) end | tostring;
def per_cent: if . == null then null else "\(. * 100 | round) %" end;
def over($other): if . == null or ($other // 0) == 0 then null else . / $other end;
def geometric_mean: map(values) | if length == 0 then null else map(log) | add / length | exp end;

# What it took to that distance: from where it rests itself, or from the lowest energy met where it does not.
def cost($level): if .outcome == "at-rest" then .["own_\($level)"] else .["to_\($level)"] end;
def auto: .methods | map(select(.method | startswith("auto"))) | first;
def both(f): [("1e-03", "1e-06") | f | text] | join(" / "); # f: from a level to a figure

# Times as long as `auto` takes, for each method but itself.
def ratio($method; $level): auto as $auto | .methods | map(select(.method == $method)) | first
    | if . == null then null else cost($level).seconds | over($auto | cost($level).seconds) end;
([$rows[].methods[].method | select(startswith("auto") | not)] | reduce .[] as $m ([]; if index($m) then . else . + [$m] end))
    as $others

| def ratios: {title: "auto against the others",
    text: "Seconds of a method for one second of auto, until (E - E*)/(E0 - E*) stays below 1e-3 / 1e-6; \"-\": not in \($most) iterations or \($limit) s.",
    head: (["scene"] + $others),
    rows: (if $rows == [] or $others == [] then [] else ($rows | map(. as $row | [.scene] + [$others[] as $m | both(. as $level | $row | ratio($m; $level))]))
        + [["geometric mean of those that get there"]
            + [$others[] as $m | both(. as $level | [$rows[] | ratio($m; $level)] | geometric_mean)]] end)};

def costs: {title: "Iterations and seconds",
    text: "To 1e-3 / 1e-6 and to rest (residual force of 1e-6; auto then certifies). The page of each scene shows error against run time.",
    head: ["scene", "triangles", "method", "iterations", "seconds", "rest: iterations", "seconds", "certified", "with the certificate, s"],
    rows: [$rows[] | . as $row | .methods[] | . as $run | [$row.scene, $row.triangles, .method,
        both(. as $level | $run | cost($level).iterations), both(. as $level | $run | cost($level).seconds), .to_rest.iterations, .to_rest.seconds,
        (if .report.plan.kept // [] | any(.name == "certificate") then (if .certified then "yes" else "no" end), .seconds
         else null, null end)]]};

def stages: ["coarse", "prepare", "sew", "assemble", "factorise", "solve", "move", "certify", "broad-phase", "narrow-phase"];
def shares: {title: "Where auto spends its seconds", text: "Share of each stage in the whole, by the job's report.",
    head: (["scene", "seconds"] + stages + ["bytes a triangle"]),
    rows: [$rows[] | . as $row | auto | select(.report) | [$row.scene, .report.seconds]
        + [.report as $report | stages[] as $stage | $report.stages[$stage] | over($report.seconds) | per_cent]
        + [.report.peak_bytes / $row.triangles | round]]};

def floors: $floor[0] as $best | {title: "Above the floor",
    text: "The floor: operations of the factorisations at dgemm's rate (\($best.dgemm_flops / 1e9 | digits(1)) GF/s here, one processor), bytes of the factor read twice by each back-solve at the rate of reading (\($best.stream_bytes / 1e9 | digits(1)) GB/s). Times the floor that auto's stages take, and that its iterations take: assembly, factorisations, back-solves and moves.",
    head: ["scene", "factorisations", "back-solves", "floor: factorise, s", "solve, s", "factorise over its floor", "solve over its floor", "iterations over both"],
    rows: [$rows[] | . as $row | auto | .report | select(.work)
        | (.work.factor_flops / $best.dgemm_flops) as $factor | (.work.solve_bytes / $best.stream_bytes) as $solve
        | [$row.scene, .factorizations, .solves, $factor, $solve, (.stages.factorise | over($factor)),
            (.stages.solve | over($solve)), ([.stages | .assemble, .factorise, .solve, .move] | add | over($factor + $solve))]]};

# Exponent of triangles in auto's seconds, from each size to the next and from the first to the last.
def exponent($a; $b): ($a | auto | cost("1e-06").seconds) as $from | ($b | auto | cost("1e-06").seconds) as $to
    | if $from == null or $to == null then null else ($to / $from | log) / ($b.triangles / $a.triangles | log) | digits(2) | tostring end;
def growth: {title: "Growth", text: "p, where the seconds of auto to 1e-6 grow as triangles to the power of p.",
    head: ["square", "5k to 20k", "20k to 60k", "60k to 200k", "5k to 200k"],
    rows: [("10", "1000", "10000") as $stretch
        | [("5000", "20000", "60000", "200000") as $n | $rows | map(select(.scene == "square-\($n)-\($stretch)")) | first]
        | select(map(values) | length > 1) as $size
        | ["\($stretch) N/m"] + [range(3) as $i | if $size[$i] and $size[$i + 1] then exponent($size[$i]; $size[$i + 1]) else null end]
            + [if $size[0] and $size[3] then exponent($size[0]; $size[3]) else null end]]};

def throughput: {title: "One job and four, on one worker and on two",
    text: "Squares of 60 000 triangles, to a residual force of 1e-3, with reading the job and writing its results. A job alone on two workers borrows the other one's processor.",
    head: ["jobs", "on one worker, s", "on two, s", "times as fast"],
    rows: [(1, 4) as $jobs | [$workers[] | select(.jobs == $jobs).seconds] | select(length == 2)
        | [$jobs, .[0], .[1], .[0] / .[1]]]};

# Seconds until the potential energy stays within a thousandth of its whole drop of the last one.
def nearly: (.trace.columns | index("seconds")) as $s | (.trace.columns | index("potential")) as $e
    | .trace.rows as $rows | $rows[-1][$e] as $last | (($rows[0][$e] - $last) * 1e-3) as $near
    | [range($rows | length) | select(($rows[.][$e] - $last | fabs) > $near)] | (max // -1) + 1 | $rows[.][$s];
def waiting: {title: "What a configurator waits for",
    text: "Seconds from posting a job to a daemon that has not seen the body until its first preview and until its end; of the run, until the energy stays within a thousandth of its drop, and until the residual force is 1e-3. With friction 0.3 and self-contact, on one worker and on two. Re-drapes begin from the drape above; theirs is no preview.",
    head: ["garment", "workers", "first preview", "the end", "run: energy to 1e-3", "run: rest to 1e-3", "iterations", "verdict"],
    rows: [$waits[] | [.name, .workers, .shown, .ended, nearly, .report.seconds, .report.iterations, .verdict]]};

# Seconds until the energy stays within 0.01 % of the last one.
def settled: .rows as $rows | $rows[-1][1] as $last
    | [range($rows | length) | select(($rows[.][1] - $last | fabs) > 1e-4 * ($last | fabs))] | (max // -1) + 1
    | $rows[.][0];
def yardstick: {title: "Beside Blender's cloth",
    text: "The square of 19 200 triangles: processor time until the potential energy in gravity stays within 0.01 % of its last, and the speed of the fastest vertex then. Blender's springs are not the same material, so the last differs.",
    head: ["program", "states", "seconds", "times auto's", "last energy, J", "fastest vertex at the end, m/s"],
    rows: ([$blender[] | . + {seconds: settled}] | .[0].seconds as $auto
        | map([.program, (.rows | length), .seconds, (.seconds | over($auto)), .rows[-1][1], .speed // 0]))};

[(ratios, costs, shares, floors, growth, waiting, throughput, yardstick) | select(.rows != [])] as $tables
| "At most \($most) iterations and \($limit) s a run; workers: \($count), processors: \($processors)." as $said
| if $form == "md" then
    "# What a drape costs", "", $said, ($tables[]
        | "", "## \(.title)", "", .text, "", (.head, (.head | map("---")), .rows[] | "| \(map(text) | join(" | ")) |"))
  else
    "<!doctype html>", "<html lang=\"en\"><meta charset=\"utf-8\"><title>What a drape costs</title>",
    "<style>body{font:15px/1.4 sans-serif;margin:2em;max-width:80em}table{border-collapse:collapse}td,th{padding:.2em .7em;border-bottom:1px solid #ccc;text-align:right}td:first-child,th:first-child{text-align:left}</style>",
    "<h1>What a drape costs</h1>", (@html "<p>\($said)</p>"),
    ($tables[] | @html "<h2>\(.title)</h2><p>\(.text)</p>", "<table>",
        (.head | "<tr>" + (map(@html "<th>\(.)</th>") | add) + "</tr>"),
        (.rows[] | "<tr>" + (map(text | @html "<td>\(.)</td>") | add) + "</tr>"), "</table>"),
    "<h2>Error against run time</h2><ul>",
    ($rows[] | @html "<li><a href=\"bench/\(.scene).html\">\(.scene)</a></li>"), "</ul></html>"
  end
