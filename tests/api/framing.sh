#!/bin/bash
# Requests that two readers could read differently are refused and the connection closed, so that nothing
# hidden in them or behind them is ever served: every case of framing.cases, byte by byte.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
address=${url#http://}

build/release/tests/api/framing "${address%:*}" "${address##*:}" tests/api/framing.cases
request GET "$admin/metrics"
is 'no hidden request was ever served' "$(grep -c 'route="/v1/materials",method="GET",code="2' "$body")" 0
like 'the honest ones were' "$(<"$body")" 'route="/v1/info",method="GET",code="200"'
request GET /v1/info; is 'the daemon still answers' "$code" 200
stop_daemon; is 'and stops with status 0' "$status" 0
finish
