#!/bin/bash
# Prints the C source of stand-ins for object files: functions that abort, data that is zero. Only to free
# nothing is allowed.
# usage: tests/counts/stubs.sh OBJECT...
echo '#include <stdlib.h>'
(($#)) || exit 0
nm -g --defined-only "$@" | awk '
    $2 == "T" && $3 ~ /_free$/ { print "void *" $3 "(void *p) { if (p) abort(); return NULL; }"; next }
    $2 == "T"                  { print "void " $3 "(void) { abort(); }" }
    $2 ~ /^[RDB]$/             { print "const char " $3 "[4096] = {0};" }'
