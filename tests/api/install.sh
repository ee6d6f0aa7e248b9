#!/bin/bash
# `make install` puts a working service in place, and its sandbox is as tight as promised.
. "$(dirname "$0")/lib.sh"
root=$work/root
check 'make install succeeds' make --no-print-directory install DESTDIR="$root" PREFIX=/opt/draped
unit=$root/opt/draped/lib/systemd/system/draped.service
check 'the daemon is in place' test -x "$root/opt/draped/bin/draped"
check 'the client is in place' test -x "$root/opt/draped/bin/drape"
check 'the README is in place' test -s "$root/opt/draped/share/doc/draped/README.md"
check 'the unit starts the installed daemon' grep -q '^ExecStart=/opt/draped/bin/draped ' "$unit"
check 'no placeholder is left in it' bash -c '! grep -q @ <(grep -v "^SystemCallFilter=\|^#" "$0")' "$unit"
help=$("$DRAPED" --help 2>&1)
for flag in $(grep -o -- ' --[a-z-]*' "$unit"); do
    like "the daemon knows $flag" "$help" "$flag"
done
if command -v systemd-analyze >/dev/null; then
    # The threshold is in tenths: an overall exposure of at most 1.0.
    check 'systemd-analyze scores it 1.0 or better' systemd-analyze security --offline=true --threshold=10 --no-pager "$unit"
    sed 's|^ExecStart=.*|ExecStart=/bin/true \\|' "$unit" >"$work/draped.service"
    check 'systemd-analyze finds no fault in it' bash -c '! systemd-analyze verify --man=no "$0" 2>&1 | grep draped.service' \
        "$work/draped.service"
else
    skip 'systemd-analyze is not here: the unit was not scored'
fi

# READY=1 and STOPPING=1 arrive where systemd listens.
if command -v python3 >/dev/null; then
    python3 - "$work/notify" >"$work/notified" <<'PY' &
import socket, sys
s = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
s.bind(sys.argv[1])
s.settimeout(30)
try:
    while True:
        text = s.recv(4096).decode()
        print(text, flush=True)
        if "STOPPING=1" in text:
            break
except TimeoutError:
    pass
PY
    listener=$!
    for i in {1..100}; do [[ -S $work/notify ]] && break; sleep 0.02; done
    export NOTIFY_SOCKET=$work/notify
    start_daemon
    unset NOTIFY_SOCKET
    stop_daemon
    kill "$listener" 2>/dev/null
    wait "$listener" 2>/dev/null
    check 'systemd is told when the daemon is ready' grep -q 'READY=1' "$work/notified"
    check 'and when it stops' grep -q 'STOPPING=1' "$work/notified"
else
    skip 'python3 is not here: the notices to systemd were not seen'
fi
finish
