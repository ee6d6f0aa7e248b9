#!/bin/bash
# Who connects just before the daemon is told to stop is answered: the loop knows of the connection, but is
# held up before it accepts it.
. "$(dirname "$0")/lib.sh"

for round in 1 2 3; do
    ACCEPT_MS=200 LD_PRELOAD=build/release/tests/preload/accept.so start_daemon --workers 1
    address=${url#http://}
    exec {client}<>"/dev/tcp/${address%:*}/${address#*:}"
    printf 'GET /v1/info HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n' >&"$client"
    sleep 0.05
    stop_daemon
    read -r -t 10 answer <&"$client" || answer='nothing'
    exec {client}>&-
    like "round $round: a connection on its way in is answered" "$answer" '^HTTP/1.1 (200|503) '
    is 'the daemon stops with status 0' "$status" 0
done
finish
