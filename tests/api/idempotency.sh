#!/bin/bash
# Idempotency-Key: a repeated POST makes one job, whatever happens in between.
. "$(dirname "$0")/lib.sh"

# post_key KEY FILE [CURL-ARGUMENT...]
post_key() {
    local key=$1 file=$2
    shift 2
    request POST /v1/jobs -H 'Content-Type: application/json' -H "Idempotency-Key: $key" \
        --data-binary "@$file" "$@"
}
count_jobs() { curl -s "$url/v1/jobs?limit=200&label=$1" | jq '.jobs | length'; }

square 4 '.labels = {"t": "one"}' >"$work/job"
square 4 '.labels = {"t": "two"}' >"$work/other"
start_daemon --workers 1 --max-queued 3

# ---- the first answer again
post_key k1 "$work/job"
is 'a job with a key is accepted' "$code" 202
is 'and it is no repetition' "$(header idempotency-replayed)" ''
cp "$body" "$work/first"
location=$(header location) etag=$(header etag) id=$(jq -r .id "$body")
check 'it succeeds' wait_for "$id" succeeded
post_key k1 "$work/job"
is 'repeated, it gets the first status' "$code" 202
check 'the first body, byte for byte' cmp "$work/first" "$body"
is 'the first Location' "$(header location)" "$location"
is 'the first ETag' "$(header etag)" "$etag"
is 'and is told so' "$(header idempotency-replayed)" true
post_key '"k1"' "$work/job"
is 'a key in quotes is the same key' "$(header location)" "$location"
is 'there is one job' "$(count_jobs t:one)" 1
post_key k1 "$work/job" -H 'Prefer: wait=10'
is 'repeated with Prefer: wait it sees the end' "$code $(jq -r .status "$body")" '200 succeeded'
is 'and is told so too' "$(header idempotency-replayed)" true
post_key k1 "$work/other"
problem 'another body under the key is refused' 422 idempotency-mismatch
json 'and need not be tried again' '.retryable == false'
post_key k2 "$work/other"
is 'under a key of its own it is taken' "$code $(header idempotency-replayed)" '202 '

# ---- keys that are none
for key in 'a b' '""' '"a' '"a";x=1' "$(printf 'k%.0s' {1..256})"; do
    post_key "$key" "$work/job"
    problem "the key ${key:0:10} is refused" 400 bad-request
done
post_key "$(printf 'k%.0s' {1..255})" "$work/job"
is 'one of 255 characters is not' "$code" 202
submit "$work/job"
is 'without a key each is another job' "$(count_jobs t:one)" 3

# ---- refusals are not kept
echo '{"cloths": 1}' >"$work/bad"
post_key k3 "$work/bad"
problem 'an invalid job is refused as ever' 422 invalid
post_key k3 "$work/job"
is 'its key is free' "$code $(header idempotency-replayed)" '202 '
request POST /v1/jobs -H 'Content-Type: text/plain' -H 'Idempotency-Key: k4' --data-binary "@$work/job"
problem 'what is refused by its head' 415 unsupported-media-type
post_key k4 "$work/job"
is 'leaves its key free too' "$code" 202

# ---- a full queue
endless >"$work/long"
submit "$work/long"; long=$id
wait_for "$long" running
for i in 1 2 3 4; do post_key "fill$i" "$work/long"; done
problem 'the queue is full' 503 queue-full
post_key fill4 "$work/long"
problem 'a key that got no job gets none now' 503 queue-full
post_key k1 "$work/job"
is 'one that has its job is told so however full it is' "$code $(header location)" "202 $location"
for job in $(curl -s "$url/v1/jobs?limit=200" | jq -r '.jobs[] | select(.finished_at == null) | .id'); do
    request DELETE "/v1/jobs/$job"
    wait_for "$job" canceled
done

# ---- in flight: its body is there, and it waits for its turn behind large ones
square 100 '.solver.max_iterations = 100000000 | .labels = {"t": "large"}' >"$work/large" # one too many: refused
answers=
for ((round = 0; round < 50; round++)); do
    for i in 1 2 3; do
        curl -s -o /dev/null -H 'Content-Type: application/json' --data-binary "@$work/large" "$url/v1/jobs" &
    done
    curl -s -o "$work/slow" -w '%{http_code}' -H 'Content-Type: application/json' \
        -H "Idempotency-Key: slow$round" --data-binary "@$work/job" "$url/v1/jobs" >"$work/slow.code" & other=$!
    post_key "slow$round" "$work/job"
    wait "$other"
    answers="$(<"$work/slow.code") $code"
    [[ $answers == '202 409' ]] && break # which of the two comes first is chance
done
is 'while the first is in flight the second is refused' "$answers" '202 409'
problem 'by its code' 409 idempotency-in-flight
json 'and may be tried again' '.retryable == true'
like 'it is told when' "$(header retry-after)" '^[0-9]+$'
post_key "slow$round" "$work/job"
check 'then it gets the answer of the first' cmp "$work/slow" "$body"

address=${url#http://}
exec 3<>"/dev/tcp/${address%:*}/${address##*:}"
printf 'POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nIdempotency-Key: lost\r\nContent-Length: 9\r\n\r\n{' >&3
sleep 0.1
post_key lost "$work/job"
is 'a first that stops half-way holds nobody up' "$code $(header idempotency-replayed)" '202 '
exec 3>&-

# ---- removed, and after a restart
request DELETE "$location"
is 'a job may be removed' "$code" 204
post_key k1 "$work/job"
is 'its key still gets the first answer' "$code $(header location)" "202 $location"
post_key k1 "$work/job" -H 'Prefer: wait=10'
is 'at once, for there is no end to wait for' "$code $(header location)" "202 $location"
request GET "$location"
problem 'which leads to where it was' 410 gone
stop_daemon
start_daemon --workers 1
post_key k1 "$work/job"
check 'after a restart too, byte for byte' cmp "$work/first" "$body"
post_key k1 "$work/other"
problem 'and another body is refused as before' 422 idempotency-mismatch
stop_daemon

# ---- eight who post the same, again and again, while the daemon is killed
races=${DRAPED_TEST_RACES:-10} kills=${DRAPED_TEST_RACE_KILLS:-3}
data=$work/data-race
square 2 '.solver.max_iterations = 1 | .labels = {"t": "race"}' >"$work/small"
start_daemon --workers 2 --max-queued 100000
echo "$url" >"$work/where"
post_all() { # as a client: until there is an answer
    local n got
    for ((n = 0; n < races; n++)); do
        for ((;;)); do
            got=$(curl -s --max-time 10 -o - -w ' %{http_code}' -H 'Content-Type: application/json' \
                -H "Idempotency-Key: race-$n" --data-binary "@$work/small" "$(<"$work/where")/v1/jobs")
            [[ $got == *' 202' ]] && break
            [[ $got == *' 409' || $got == *' 503' || $got == *'000' ]] || echo "race-$n ${got:0:300}" >>"$work/odd"
            sleep 0.01
        done
        jq -r --arg n "$n" '"\($n) \(.id)"' <<<"${got% *}" >>"$work/told.$1"
    done
}
: >"$work/odd"
posters=()
for who in 1 2 3 4 5 6 7 8; do
    post_all "$who" & posters+=($!)
done
for ((k = 0; k < kills; k++)); do
    sleep 0.4
    kill_daemon
    start_daemon --workers 2 --max-queued 100000
    echo "$url" >"$work/where"
done
wait "${posters[@]}"
is 'nobody gets an answer that is not expected' "$(<"$work/odd")" ''
is "each of 8 is told of $races jobs" "$(cat "$work"/told.* | wc -l)" $((8 * races))
is 'all of the same ones' "$(sort -u "$work"/told.* | wc -l)" "$races"
listed=0 cursor=
while :; do
    request GET "/v1/jobs?limit=200&label=t:race$cursor"
    listed=$((listed + $(jq '.jobs | length' "$body")))
    next=$(header link); [[ $next =~ cursor=(c[0-9a-f]+) ]] || break
    cursor="&cursor=${BASH_REMATCH[1]}"
done
is "and there are $races jobs, after $kills kills" "$listed" "$races"
echo "# $races keys, 8 posters each, $kills kills: $listed jobs"
stop_daemon; is 'the daemon stops with status 0' "$status" 0
finish
