# scene.jq - prints a job of `make bench-methods`: a structured grid of cloth held along its first row.
# usage: jq -cn -f scene.jq --arg name NAME --arg shape SHAPE --argjson stretch N_PER_M --argjson bend N_M
#   square  0.5 m, level, held by one edge; 1 800 triangles as all but the skirt
#   noise   the same, shaken by 5 mm
#   fold    the same, its free half laid back over the other
#   arc     level, from a held half-circle of radius 0.25 m to a straight hem
#   skirt   level half annulus of radii 0.15 and 0.45 m, held along the inner arc; 3 600 triangles
30 as $rows
| (if $shape == "skirt" then 60 else 30 end) as $columns
| (3 * ($rows + 1) * ($columns + 1)) as $numbers
| ([range($rows + 1) as $j | range($columns + 1) as $i | [$i / $columns, $j / $rows]]) as $points

# Where grid point [s, r], each 0 to 1, lies in the pattern; r = 0 is held.
| def place: . as [$s, $r] | (3.141592653589793 * (1 - $s)) as $angle
    | if $shape == "skirt" then [(0.15 + 0.3 * $r) * ($angle | cos), (0.15 + 0.3 * $r) * ($angle | sin)]
      elif $shape == "arc" then [(1 - $r) * 0.25 * ($angle | cos) + $r * (0.5 * $s - 0.25),
                                 (1 - $r) * 0.25 * ($angle | sin) - $r * 0.25]
      else [0.5 * $s, -0.5 * $r] end;

# u to the right (x), v away from the viewer (-z).
def start: . as [$s, $r] | place as [$u, $v]
    | if $shape == "fold" and $r > 0.5 then [$u, 0.002, 0.5 * (1 - $r)] else [$u, 0, -$v] end;

# Up to 5 mm each way, by the minimal standard generator (Park and Miller 1988).
def shake: . as $x | [limit($numbers; 12345 | recurse(. * 16807 % 2147483647))] as $random
    | [range($numbers)
       | if . < 3 * ($columns + 1) then $x[.] else $x[.] + 0.005 * ($random[.] / 1073741823.5 - 1) end];

# Two triangles a cell, their diagonals alternating.
def cell: . as [$i, $j] | ($j * ($columns + 1) + $i) as $a | ($a + $columns + 1) as $c
    | if ($i + $j) % 2 == 1 then $a, $a + 1, $c + 1, $a, $c + 1, $c else $a, $a + 1, $c, $a + 1, $c + 1, $c end;

{
    name: $name,
    cloth: {
        mesh: {
            positions: ([$points[] | start[]] | if $shape == "noise" then shake else . end),
            pattern: [$points[] | place[]],
            triangles: [range($rows) as $j | range($columns) as $i | [$i, $j] | cell]
        },
        pins: [range($columns + 1)],
        materials: [{
            density: 0.1,
            stretch: {weft: $stretch, warp: $stretch, shear: ($stretch / 2)},
            poisson: 0,
            bend: {weft: $bend, warp: $bend, twist: ($bend / 2)}
        }]
    }
}
