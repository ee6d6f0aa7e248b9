# Self instructions by function from a profile that callgrind wrote with its names in full, one line each:
# `COUNT NAME`. Functions without a symbol count for their library.
/^ob=/    { library = $0; sub(/.*\//, "", library) }
/^fn=/    { name = substr($0, 4); if (name ~ /^0x/) name = library }
/^calls=/ { getline; next } # the callee's
/^[0-9]/  { count[name] += $2 }
END       { for (name in count) print count[name], name }
