#!/bin/bash
# Waiting for a job within a request, and cancelling it while it is queued, running and over.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
now() { echo "${EPOCHREALTIME/[.,]/}"; } # microseconds

endless >"$work/long"
square 6 >"$work/small"
submit "$work/long"; running=$id
check 'the first job runs' wait_for "$running" running
submit "$work/small"; queued=$id
json 'the second waits in the queue' '.status == "queued" and .queue_position == 1'
submit "$work/small"; second=$id
json 'and the third behind it' '.status == "queued" and .queue_position == 2'

from=$(now)
request POST /v1/jobs -H 'Content-Type: application/json' -H 'Prefer: wait=1' --data-binary "@$work/small"
took=$(($(now) - from))
is 'Prefer: wait that ran out answers 202' "$code" 202
check "after about the second it asked for ($((took / 1000)) ms)" test "$took" -ge 900000 -a "$took" -lt 6000000
third=$(jq -r .id "$body")

request GET "/v1/jobs/$queued"
etag=$(header etag)
from=$(now)
request GET "/v1/jobs/$queued" -H "If-None-Match: $etag" -H 'Prefer: wait=1'
took=$(($(now) - from))
like 'a long poll of an unchanged job answers' "$code" '^(200|304)$'
check "after its time ($((took / 1000)) ms)" test "$took" -ge 500000 -a "$took" -lt 6000000
from=$(now)
request GET "/v1/jobs/$queued" -H "If-None-Match: W/$etag" -H 'Prefer: wait=1'
took=$(($(now) - from))
is 'a tag that a proxy has weakened is waited for too' "$code" 304
check "for as long ($((took / 1000)) ms)" test "$took" -ge 500000 -a "$took" -lt 6000000
request GET "/v1/jobs/$second"; behind=$(header etag)
request GET "/v1/jobs/$second" -H "If-None-Match: $behind"; is 'the tag of one that waits holds while it does' "$code" 304
(sleep 0.5; curl -s -X DELETE "$url/v1/jobs/$queued" >/dev/null) &
from=$(now)
request GET "/v1/jobs/$queued" -H "If-None-Match: $etag" -H 'Prefer: wait=20'
took=$(($(now) - from))
is 'a long poll answers 200 when the job changes' "$code" 200
json 'with the change' '.status == "canceled" and .verdict == null'
check "at once ($((took / 1000)) ms)" test "$took" -lt 8000000
wait $!
request GET "/v1/jobs/$second"; json 'those behind move up' '.queue_position == 1'
request GET "/v1/jobs/$second" -H "If-None-Match: $behind"
is 'and their tags hold no longer' "$code $(jq .queue_position "$body")" '200 1'
request GET "/v1/jobs/$second" -H "If-None-Match: $behind" -H 'Prefer: wait=20'
is 'which is no reason to wait' "$code $(header preference-applied)" '200 '
is 'there is another' "$([[ $(header etag) != "$behind" ]] && echo other)" other
request DELETE "/v1/jobs/$second" -H "If-Match: $behind"
problem 'nor is the job cancelled that a client saw elsewhere in the line' 412 precondition-failed
request GET "/v1/jobs/$second"; json 'it waits on' '.status == "queued"'
submit "$work/small"; fourth=$id
request GET "/v1/jobs/$fourth"; seen=$(header etag)
request DELETE "/v1/jobs/$fourth" -H "If-Match: \"x\", $seen"; is 'one is that is as it was seen' "$code" 202
request DELETE "/v1/jobs/$fourth" -H "If-Match: $seen"; problem 'it is not removed by the same' 412 precondition-failed
request DELETE "/v1/jobs/$fourth" -H 'If-Match: *'; is 'but by a star' "$code" 204
request GET "/v1/jobs/$queued/result"; problem 'a job cancelled in the queue has no result' 409 no-result

# Who hangs up gives the place back long before the time is up, and who only says no more is answered.
connections() { curl -s "$admin/metrics" | sed -n 's/^draped_connections //p'; }
for ((i = 0; i < 100; i++)); do [[ $(connections) == 0 ]] && break; sleep 0.05; done # of those before
before=$(connections)
for i in {1..20}; do
    timeout 1 curl -s "$url/v1/jobs/$second" -H 'Prefer: wait=25' >/dev/null &
done
sleep 0.7; like 'twenty wait' "$(connections)" '^2[0-9]$'
wait $(jobs -p | grep -vx "$pid")
for ((i = 0; i < 100; i++)); do
    [[ $(connections) == "$before" ]] && break
    sleep 0.05
done
is 'none of them is kept five seconds after they hung up' "$(connections)" "$before"
poll="GET /v1/jobs/$second HTTP/1.1\r\nHost: h\r\nPrefer: wait=25\r\n\r\n"
like 'a client that has said its last word is answered' "$(python3 -c '
import socket, sys
s = socket.create_connection((sys.argv[1], int(sys.argv[2])), 20)
s.sendall(sys.argv[3].encode().decode("unicode_escape").encode())
s.shutdown(socket.SHUT_WR)
print(s.recv(12).decode())' 127.0.0.1 "${url##*:}" "$poll")" 'HTTP/1.1 200'

from=$(now)
request DELETE "/v1/jobs/$running"
is 'cancelling a running job answers 202' "$code" 202
wait_for "$running" canceled 30
took=$(($(now) - from))
check "and it stops soon ($((took / 1000)) ms)" test "$took" -lt 10000000
request DELETE "/v1/jobs/$running"; is 'cancelling again, now that it has ended, removes it' "$code" 204
request DELETE "/v1/jobs/$running"; is 'and once more does no harm' "$code" 204
check 'the next one runs and succeeds' wait_for "$second" succeeded
check 'and the next' wait_for "$third" succeeded
request GET "/v1/jobs/$third"
etag=$(header etag)
from=$(now)
request GET "/v1/jobs/$third" -H "If-None-Match: $etag" -H 'Prefer: wait=20'
took=$(($(now) - from))
check "nobody waits for a job that is over ($((took / 1000)) ms)" test "$took" -lt 5000000
request DELETE "/v1/jobs/$third" -H "If-Match: W/$etag"; problem 'a weakened tag removes nothing' 412 precondition-failed
request DELETE "/v1/jobs/$third" -H "If-Match: $etag"; is 'the tag itself does' "$code" 204
request DELETE "/v1/jobs/$third" -H "If-Match: $etag"; is 'and once more does no harm' "$code" 204
request DELETE "/v1/jobs/$(printf '0%.0s' {1..32})" -H 'If-Match: *'; problem 'none is no job of ours' 404 not-found
request POST /v1/jobs -H 'Content-Type: application/json' -H 'Prefer: wait=rubbish' --data-binary "@$work/small"
is 'a preference that is none is ignored' "$code" 202

# Many cancels against many ends: each job ends in one state and stays there.
ids=()
for i in {1..12}; do
    submit "$work/small"; ids+=("$id")
    (sleep "0.0$((i * 7 % 10))"; curl -s -o /dev/null -X DELETE "$url/v1/jobs/$id") &
done
wait $(jobs -p | grep -vx "$pid")
odd=0
for id in "${ids[@]}"; do
    request GET "/v1/jobs/$id"
    [[ $code =~ ^(404|410)$ ]] && continue # ended before the DELETE, which then removed it
    wait_for "$id" 'succeeded|canceled' 60 || odd=$((odd + 1))
done
is 'of twelve races between cancel and end none is left open' "$odd" 0
finish
