# wrinkles.jq - the table of wrinkles.sh in Markdown.
# usage: jq -rs -f wrinkles.jq --argjson figures COMPARISON --arg measure METHOD --argjson mark ITERATIONS TRACE...
# The traces come in the order of the comparison's methods.
def power: (log10 | floor) as $e | "\(. / pow(10; $e) * 10 | round / 10)e\($e)";
def dash: if . == null then "-" else . end;

[., $figures.methods] | transpose
| map(. as [$trace, $run] | $run + {rows:
    [$trace.rows[] | [$trace.columns, .] | transpose | map({key: .[0], value: .[1]}) | from_entries]})
| (map(select(.method == $measure)) | first | .rows[$mark].potential) as $goal
| $figures.best_energy as $best

# The first row that is as low, and the one from which on all are: a cloth that swings rises again.
| def first_below: map(.potential != null and .potential <= $goal) | index(true);
  def stays_below: . as $rows | until(length == 0 or .[-1].potential == null or .[-1].potential > $goal; .[:-1])
    | if length < ($rows | length) then length else null end;

"To the residual energy that stop-and-go by the potential rule has after \($mark) iterations,",
"`(E - E*)/(E0 - E*)` = \(($goal - $best) / ($figures.start_energy - $best) | power) with `E*` of "
+ "`\($figures.best_method)`:",
"",
"| method | iterations until there | until there to stay | factorisations | seconds | the run |",
"| --- | --- | --- | --- | --- | --- |",
(.[] | (.rows | stays_below) as $row
    | (if $row == null then {} else {seconds: (.rows[$row].seconds * 10 | round / 10),
          count: (.rows[:$row + 1] | map(.factorizations) | add)} end) as $cost
    | "| `\(.method)` | \(.rows | first_below | dash) | \($row | dash) | \($cost.count | dash) "
      + "| \($cost.seconds | dash) | \(.outcome) after \(.iterations) |")
