#!/usr/bin/awk -f
# A manual page of what a program's --help says: its second line is what it does, and the rest stands as it is.
# usage: PROGRAM --help | man.awk -v name=draped -v section=8
{
    gsub(/\\/, "\\e")
    gsub(/-/, "\\-")
    sub(/^\./, "\\\\\\&.")
    sub(/^'/, "\\\\\\&'")
    line[NR] = $0
}
END {
    what = line[2]
    sub("^" name ": ", "", what)
    sub(/\.$/, "", what)
    printf ".TH %s %d\n.SH NAME\n%s \\- %s\n.SH SYNOPSIS\n%s\n.SH DESCRIPTION\n.nf\n", toupper(name), section, name, what, \
        substr(line[1], length("Usage: ") + 1)
    for (i = 3; i <= NR; i++) print line[i]
    print ".fi"
}
