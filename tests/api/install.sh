#!/bin/bash
# `make install` and `make deb` put a working service in place, and its sandbox is as tight as promised.
. "$(dirname "$0")/lib.sh"
root=$work/root
check 'make install succeeds' make --no-print-directory install DESTDIR="$root" PREFIX=/opt/draped
units=$root/opt/draped/lib/systemd/system
doc=$root/opt/draped/share/doc/draped
unit=$units/draped.service
for file in bin/draped bin/drape; do check "$file is in place" test -x "$root/opt/draped/$file"; done
for file in README.md LICENSE examples/draped.conf; do check "$file is in place" test -s "$doc/$file"; done
for page in man8/draped.8 man1/drape.1; do
    check "the manual page $page is in place" gzip -dc "$root/opt/draped/share/man/$page.gz"
done
check 'the unit starts the installed daemon' grep -q '^ExecStart=/opt/draped/bin/draped$' "$unit"
check 'no placeholder is left in it' bash -c '! grep -q @ <(grep -v "^SystemCallFilter=\|^#" "$0")' "$unit"
sed 's/^# \([a-z-]* = \)/\1/' "$doc/examples/draped.conf" >"$work/draped.conf"
check 'the daemon knows every setting of the example' "$DRAPED" --config "$work/draped.conf" --check-config
check 'and there are some' grep -q '^workers = ' "$work/draped.conf"

if command -v systemd-analyze >/dev/null; then
    # The threshold is in tenths: an overall exposure of at most 1.0.
    check 'systemd-analyze scores it 1.0 or better' systemd-analyze security --offline=true --threshold=10 --no-pager "$unit"
    systemd-analyze security --offline=true --no-pager "$unit" | sed -n 's/^.*Overall/# Overall/p'
    for name in draped.service draped.socket draped-admin.socket; do
        sed 's|^ExecStart=.*|ExecStart=/bin/true|; s|^Documentation=.*||' "$units/$name" >"$work/$name"
    done
    is 'systemd-analyze finds no fault in the units' \
        "$(cd "$work" && systemd-analyze verify --man=no draped.service draped.socket draped-admin.socket 2>&1 | grep '^draped\|/draped')" ''
else
    skip 'systemd-analyze is not here: the units were not scored'
fi

# ---- the package, unpacked and run from there

check 'make deb succeeds' make --no-print-directory deb
deb=build/draped_$("$DRAPED" --version | sed 's/^draped //')_$(dpkg --print-architecture).deb
if command -v lintian >/dev/null; then
    lintian --allow-root --fail-on error "$deb" >"$work/lintian" 2>&1
    is 'lintian finds no error in it' $? 0
    sed 's/^/# /' "$work/lintian"
else
    skip 'lintian is not here: the package was not looked through'
fi
check 'it unpacks' dpkg-deb -x "$deb" "$work/unpacked"
check 'it depends on what it is linked to' grep -q 'libmicrohttpd' <(dpkg-deb -f "$deb" Depends)
check 'its units are where systemd looks' test -s "$work/unpacked/lib/systemd/system/draped.socket"
DRAPED=$work/unpacked/usr/bin/draped
start_daemon
square 6 >"$work/small"
check 'its client drapes by its daemon' "$work/unpacked/usr/bin/drape" run "$work/small" --url "$url" -o "$work/small.glb" --quiet
stop_daemon
is 'which stops with status 0' "$status" 0
finish
