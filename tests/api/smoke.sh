#!/bin/bash
# A short session with every kind of request once, small enough to run under each sanitizer.
. "$(dirname "$0")/lib.sh"
start_daemon --workers 2

request GET "$admin/livez"; is 'livez answers 200' "$code" 200
request GET "$admin/readyz"; is 'readyz answers 200' "$code" 200
json 'and names its checks' '.ready and ([.checks[]] | unique == ["ok"])'

square 8 '.name = "smoke"' >"$work/job"
submit "$work/job"; is 'a job is accepted' "$code" 202
first=$id
square 6 '.pins = [1]' >"$work/bad"
submit "$work/bad"; problem 'an unknown member is refused' 422 invalid /pins
printf '{"cloth":' >"$work/bad"
submit "$work/bad"; problem 'half a document is refused' 400 bad-json
curl -sN --max-time 120 "$url/v1/jobs/$first/events" >"$work/events"
check 'the event stream ends with the job' grep -q '^event: end' "$work/events"
check 'the job succeeds' wait_for "$first" succeeded 120
for format in json obj glb; do
    request GET "/v1/jobs/$first/result?format=$format"; is "the result comes as $format" "$code" 200
done
for format in json csv svg; do
    request GET "/v1/jobs/$first/trace?format=$format"; is "the trace comes as $format" "$code" 200
done
# Two jobs on one body, side by side: its distance field is built once.
square 6 '.bodies = [{mesh: {positions: [0,-0.3,0, 0.2,-0.3,0, 0,-0.3,0.2, 0,-0.1,0],
    triangles: [0,1,2, 0,3,1, 1,3,2, 0,2,3]}}]' >"$work/job"
submit "$work/job"; one=$id
submit "$work/job"
check 'a job on a body succeeds' wait_for "$one" succeeded 120
check 'and another on the same' wait_for "$id" succeeded 120
request GET "$admin/metrics"
like 'the body was built once' "$(grep '^draped_field_cache_' "$body" | tr '\n' ' ')" \
    'hits_total 1 .*misses_total 1 .*bytes [1-9]'
# Nor is their cloth analysed again for a third job. The figures are a second old at most.
submit "$work/job"
check 'a third succeeds' wait_for "$id" succeeded 120
deadline=$((SECONDS + 10))
until request GET "$admin/metrics"; analysis=$(grep '^draped_analysis_cache_' "$body" | tr '\n' ' ')
    [[ $analysis =~ hits_total\ [1-9] ]] || ((SECONDS >= deadline)); do sleep 0.1; done
like 'the cloth had been analysed' "$analysis" 'hits_total [1-9].*misses_total [1-9].*bytes [1-9]'
request GET /v1/jobs; is 'jobs are listed' "$code" 200
request GET /v1/materials; is 'materials are listed' "$code" 200
request GET /v1/info; is 'info is given' "$code" 200
request GET "$admin/metrics"; is 'metrics are given' "$code" 200

endless 10 >"$work/job"
submit "$work/job"; running=$id
check 'a long job runs' wait_for "$running" running 60
request DELETE "/v1/jobs/$running"; is 'it can be cancelled' "$code" 202
check 'and is' wait_for "$running" canceled 60
submit "$work/job"; check 'another one runs' wait_for "$id" running 60
stop_daemon; is 'SIGTERM in the middle of it ends the daemon with status 0' "$status" 0
finish
