#!/bin/bash
# Requests whose length or host two readers could read differently are refused and the connection closed,
# so that nothing hidden in them is ever served.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 1
host=${url#http://}
hidden='GET /v1/info HTTP/1.1\r\nHost: x\r\n\r\n'

# closed NAME REQUEST: refused, the connection closed, and the request hidden behind it not served.
closed() {
    local name=$1 answer
    answer=$(raw "$2$hidden" 10)
    if [[ $answer == *'HTTP/1.1 2'* || $answer != 'HTTP/1.1 4'* || ${answer,,} != *'connection: close'* ]]; then
        not_ok "$name" "${answer:0:600}"
    else
        ok "$name"
    fi
}
post='POST /v1/jobs HTTP/1.1\r\nHost: '$host'\r\nContent-Type: application/json\r\n'
closed 'two content lengths' "${post}Content-Length: 2\r\nContent-Length: 2\r\n\r\n{}"
closed 'two different content lengths' "${post}Content-Length: 2\r\nContent-Length: 30\r\n\r\n{}"
closed 'a length and chunks' "${post}Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
closed 'chunks and a length' "${post}Transfer-Encoding: chunked\r\nContent-Length: 4\r\n\r\n0\r\n\r\n"
closed 'two transfer encodings' "${post}Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
closed 'a coding before the chunks' "${post}Transfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n"
closed 'a coding that is none' "${post}Transfer-Encoding: chunky\r\n\r\n0\r\n\r\n"
closed 'a length with a sign' "${post}Content-Length: +2\r\n\r\n{}"
closed 'a length that is no number' "${post}Content-Length: two\r\n\r\n{}"
closed 'a length past 64 bits' "${post}Content-Length: 99999999999999999999\r\n\r\n{}"
closed 'two hosts' "POST /v1/jobs HTTP/1.1\r\nHost: $host\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n{}"
closed 'no host' 'GET /v1/jobs HTTP/1.1\r\n\r\n'
closed 'a blank before the colon' "${post}Content-Length : 2\r\n\r\n{}"

answer=$(raw "GET /v1/info HTTP/1.1\r\nHost: $host\r\n\r\nGET /v1/materials HTTP/1.1\r\nHost: $host\r\nConnection: close\r\n\r\n")
is 'two honest requests in a row are both answered' "$(grep -o 'HTTP/1.1 200 ' <<<"$answer" | wc -l)" 2
answer=$(raw "${post}Transfer-Encoding: chunked\r\nConnection: close\r\n\r\n2\r\n{}\r\n0\r\n\r\n")
like 'an honest chunked body is read' "$answer" '^HTTP/1.1 422'
answer=$(raw 'rubbish\r\n\r\n')
like 'rubbish is refused' "${answer:-HTTP/1.1 400}" '^HTTP/1.[01] 400'
answer=$(raw "GET /v1/$(printf 'a%.0s' {1..40000}) HTTP/1.1\r\nHost: $host\r\n\r\n")
like 'an endless path is refused' "${answer:0:60}" '^HTTP/1.1 (404|414|431)'
request GET /v1/info; is 'the daemon still answers' "$code" 200
stop_daemon; is 'and stops with status 0' "$status" 0
finish
