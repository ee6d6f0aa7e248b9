# exposition.awk - whether metrics keep to the Prometheus text format 0.0.4 and to what promtool asks of names.
# Prints what is wrong, one line each; nothing: all is well.
function bad(what) { print FNR ": " what ": " $0 }
function family(name) {
    if (!(name in type)) {
        stem = name
        if (sub(/_(bucket|sum|count)$/, "", stem) && (stem in type) && type[stem] == "histogram") return stem
    }
    return name
}
/^# HELP / {
    if ($3 in help) bad("a second HELP")
    if (NF < 4) bad("HELP says nothing")
    help[$3] = current = $3
    if ($3 !~ /^[a-z_:][a-z0-9_:]*$/) bad("name")
    if ($3 ~ /(_ms|_milliseconds|_kb|_mb|_kilobytes|_percent)(_total)?$/) bad("not a base unit")
    next
}
/^# TYPE / {
    if ($3 != current) bad("TYPE without its HELP before it")
    if ($3 in type) bad("a second TYPE")
    if ($4 !~ /^(counter|gauge|histogram)$/) bad("type")
    if (($4 == "counter") != ($3 ~ /_total$/)) bad("counters, and only they, end in _total")
    if ($4 != "histogram" && $3 ~ /_(bucket|sum|count)$/) bad("a name of a histogram's part")
    type[$3] = $4
    next
}
/^#/ || /^$/ { bad("neither HELP, TYPE nor a sample"); next }
{
    # name{label="value",...} value
    if (!match($0, /^[a-z_:][a-z0-9_:]*(\{([a-z_]+="([^"\\]|\\["\\n])*",?)*\})? (NaN|[+-]Inf|-?[0-9.]+(e[+-]?[0-9]+)?)$/)) {
        bad("no sample")
        next
    }
    series = $0; sub(/ [^ ]*$/, "", series)
    name = series; sub(/\{.*/, "", name)
    value = $NF + 0
    if (series in seen) bad("a second time")
    seen[series] = value
    base = family(name)
    if (base != current) bad("away from its HELP and TYPE")
    if ((base in type) && type[base] == "counter" && value < 0) bad("a negative count")
    if (series ~ /[0-9a-f]{32}/ || series ~ /[0-9a-f][0-9a-f][0-9a-f][0-9a-f][0-9a-f][0-9a-f][0-9a-f][0-9a-f]/) bad("an id in a label")
    if (series ~ /route="/ && series !~ /route="(none|\/[a-z0-9.{}\/]*)"/) bad("a route that is no template")
    if (!(base in type) || type[base] != "histogram") next
    if (name ~ /_bucket$/) {
        le = series; sub(/.*le="/, "", le); sub(/".*/, "", le)
        if (base in last && value < last[base]) bad("buckets fall")
        if (base in last_le && le != "+Inf" && le + 0 <= last_le[base] + 0) bad("bounds fall")
        last[base] = value; last_le[base] = le
    } else if (name ~ /_count$/) {
        if (last_le[base] != "+Inf" || last[base] != value) bad("the last bucket is not all")
    }
}
END {
    for (name in help) if (!(name in type)) print name ": no TYPE"
    for (name in type) {
        if (type[name] == "histogram" && !((name "_sum") in seen && (name "_count") in seen)) print name ": no sum or count"
    }
    if (NR == 0) print "nothing at all"
}
